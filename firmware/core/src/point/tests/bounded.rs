//! Where the squared equations bound the beams, no search finds another answer.
//!
//! `OPENUMI_LONG=1 cargo test -p umi-core --release point::tests::bounded -- --nocapture` tries 700 000
//! sets, of which the equations bound a sixth; without it, as many as a second takes.

use std::collections::BTreeMap;
use std::string::{String, ToString};
use std::vec::Vec;

use nalgebra::Vector3;

use super::super::model::View;
use super::super::search::{self, Outcome};
use super::super::{BallReading, CalibrationBall, PointQuestion};
use super::{cap, reading_at};
use crate::fit::tests::Random;
use crate::point::PointSensor;
use crate::units::{Mm, Point};

/// A set of readings as one may come: good, thin, crowded, of one height, of one circle, of two balls, noisy.
struct Set {
    readings: Vec<BallReading>,
    balls: Vec<CalibrationBall>,
    wanted: PointQuestion,
}

impl Set {
    fn random(random: &mut Random) -> Self {
        let choice = |random: &mut Random, of: usize| (random.unit() * of as f64) as usize;
        // Sizes over decades: as many small ones as large ones.
        let size = |random: &mut Random, a: f64, b: f64| a * libm::pow(b / a, random.unit());
        let rough = Vector3::new(0.0, 0.0, -1.0);
        let tilt = [0.01, 0.1, 0.4, 0.8][choice(random, 4)];
        let sensor = PointSensor {
            offset: Point::from_mm(3.2, -54.3, -138.1),
            direction: (rough + random.normal3() * tilt).normalize(),
            gain: 1.0,
        };
        let radius = size(random, 2.0, 30.0);
        let balls: Vec<_> = (0..1 + choice(random, 2))
            .map(|k| CalibrationBall {
                center: Point::from_mm(209.85 + 250.0 * k as f64, -98.61, -614.52),
                radius: Mm(radius * (1.0 + 0.2 * k as f64)),
                u_center: Mm(0.0),
                u_radius: Mm(0.0),
            })
            .collect();
        let most = [6, 30, 120][choice(random, 3)];
        let number = 6 + choice(random, most);
        let least = [0.02, 0.5][choice(random, 2)];
        let half_angle = size(random, least, 1.4);
        let least = [0.02, 1.0][choice(random, 2)];
        let depth = size(random, least, 12.0);
        let up = (-sensor.direction + random.normal3() * 0.1).normalize();
        let kind = choice(random, 5);
        let e = up.cross(&Vector3::new(0.3, 0.8, 0.1)).normalize();
        let mut readings: Vec<_> = cap(&up, half_angle, number)
            .into_iter()
            .enumerate()
            .map(|(k, normal)| {
                let ball = k % balls.len();
                // Thin across one direction, down to a great circle.
                let normal = if kind == 1 {
                    (normal - e * (normal.dot(&e) * 0.999)).normalize()
                } else {
                    normal
                };
                let place = (k * 7 % 5) as f64 / 4.0 - 0.5;
                let gamma = 44.0 + depth * place;
                let mut reading = reading_at(&sensor, &balls[ball], &normal, gamma);
                if kind >= 3 && balls.len() == 1 {
                    // The axes stay at one height, or wander about it.
                    let height = balls[0].center.mm.z + 150.0 + 44.0;
                    let wander = if kind == 4 {
                        0.01 * random.normal()
                    } else {
                        0.0
                    };
                    let more = (height + wander - reading.axes.mm.z) / sensor.direction.z;
                    reading.axes.mm += sensor.direction * more;
                    reading.gamma.0 -= more;
                }
                reading.ball = ball;
                reading
            })
            .collect();
        let sigma = [0.0, 1e-5, 1e-3, 1e-3, 3e-3, 0.03][choice(random, 6)];
        for reading in &mut readings {
            reading.gamma.0 += sigma * random.normal();
            if choice(random, 2) == 0 {
                reading.axes.mm += random.normal3() * sigma;
            }
        }
        let wanted = PointQuestion {
            direction: (rough + random.normal3() * 0.3).normalize(),
            free_radius: balls.len() == 1 && choice(random, 5) == 0,
            ..PointQuestion::default()
        };
        Self {
            readings,
            balls,
            wanted,
        }
    }
}

/// What a search says, and where.
fn said<const K: usize>(view: &View<'_, K>, outcome: &Outcome<K>) -> (String, Option<[f64; 6]>) {
    match outcome {
        Outcome::Found(found) => {
            let single = search::single(view, found).map_err(|error| error.code());
            let (c, a) = (found.beam.foot, found.beam.direction);
            // Of two that fit alike either may be named first.
            let is_one = single.is_ok();
            let at = is_one.then_some([c.x, c.y, c.z, a.x, a.y, a.z]);
            (std::format!("{single:?}, mirror {}", found.mirror), at)
        }
        Outcome::Nowhere(_) => ("nowhere".into(), None),
        Outcome::Valley(_) => ("valley".into(), None),
        Outcome::OtherWay { .. } => ("other way".into(), None),
    }
}

/// What becomes of a set: its outcome where the equations bound the beams, else that it was searched.
fn compared<const K: usize>(set: &Set) -> Option<String> {
    let view = View::<K>::new(&set.readings, &set.balls, &set.wanted).ok()?;
    let rough = set.wanted.direction;
    let Some(bounded) = search::bounded(&view, &rough) else {
        return Some("searched".into());
    };
    let (short, at) = said(&view, &search::outcome(&bounded));
    let (long, searched) = said(&view, &search::outcome(&search::searched(&view, &rough)));
    assert_eq!(short, long, "{at:?} {searched:?}");
    if let Some((a, b)) = at.zip(searched) {
        let off = (0..6).fold(0.0_f64, |most, k| most.max((a[k] - b[k]).abs()));
        assert!(off < 1e-7, "{a:?} {b:?}");
    }
    Some(short)
}

#[test]
fn no_search_finds_another_answer() {
    let mut random = Random(17);
    let mut tally = BTreeMap::new();
    let is_long = std::env::var_os("OPENUMI_LONG").is_some();
    for _ in 0..if is_long { 700_000 } else { 400 } {
        let set = Set::random(&mut random);
        let what = if set.wanted.free_radius {
            compared::<6>(&set)
        } else {
            compared::<5>(&set)
        };
        *tally.entry(what).or_insert(0) += 1;
    }
    std::println!("{tally:?}");
    for what in ["Ok(()), mirror false", "Ok(()), mirror true", "searched"] {
        assert!(
            tally.get(&Some(what.to_string())) > Some(&5),
            "{what} {tally:?}"
        );
    }
}
