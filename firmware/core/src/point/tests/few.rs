//! Few readings more than unknowns fit wrong beams by chance: what is told is the minimum that the truth leads to.
//!
//! `OPENUMI_LONG=1 cargo test -p umi-core --release point::tests::few -- --nocapture` tries ten times as many sets.

use std::collections::BTreeMap;
use std::vec::Vec;

use nalgebra::Vector3;

use super::super::model::View;
use super::super::{BallReading, CalibrationBall, PointQuestion, PointSensor, calibrate};
use super::reading_at;
use crate::fit::solve::least_squares::descend;
use crate::fit::solve::linalg::perpendicular_frame;
use crate::fit::tests::Random;
use crate::units::{Mm, Point};

/// How sets come: tilt of the beam and half the cone in radians, lengths in mm.
#[derive(Clone, Copy)]
struct Kind {
    tilt: f64,
    cone: f64,
    radius: f64,
    depth: f64,
    noise: f64,
}

/// 12.7 mm, 60 degrees, 7 mm of stand-off, 1 µm.
const GOOD: Kind = Kind {
    tilt: 0.004,
    cone: 1.05,
    radius: 12.7,
    depth: 7.0,
    noise: 1e-3,
};

impl Kind {
    /// Whatever a shop has.
    fn any(random: &mut Random) -> Self {
        let mut one = |of: &[f64]| of[(random.unit() * of.len() as f64) as usize];
        let (tilt, cone) = (
            one(&[0.2, 2.0, 10.0, 30.0, 50.0]),
            one(&[30.0, 45.0, 60.0, 75.0]),
        );
        let (depth, noise) = (one(&[2.0, 8.0]), one(&[1e-4, 5e-4, 1e-3, 3e-3, 1e-2]));
        Self {
            tilt: tilt.to_radians() * random.unit(),
            cone: cone.to_radians(),
            radius: 3.0 + 27.0 * random.unit(),
            depth,
            noise,
        }
    }

    fn set(
        &self,
        number: usize,
        random: &mut Random,
    ) -> (PointSensor, CalibrationBall, Vec<BallReading>) {
        let turn = core::f64::consts::TAU * random.unit();
        let (sin, cos) = (libm::sin(self.tilt), libm::cos(self.tilt));
        let sensor = PointSensor {
            offset: Point::from_mm(1.3, -0.8, -120.0),
            direction: Vector3::new(sin * libm::cos(turn), sin * libm::sin(turn), -cos),
            gain: 1.0,
        };
        let ball = CalibrationBall {
            center: Point::from_mm(0.0, 0.0, 0.0),
            radius: Mm(self.radius),
            u_center: Mm(0.0),
            u_radius: Mm(0.0),
        };
        let (e1, e2) = perpendicular_frame(&sensor.direction);
        let least = libm::cos(self.cone);
        let readings = (0..number).map(|_| {
            let cos = least + (1.0 - least) * random.unit();
            let turn = core::f64::consts::TAU * random.unit();
            let aside = e1 * libm::cos(turn) + e2 * libm::sin(turn);
            let normal = aside * libm::sqrt(1.0 - cos * cos) - sensor.direction * cos;
            let gamma = 44.0 + self.depth * (random.unit() - 0.5);
            let mut reading = reading_at(&sensor, &ball, &normal, gamma);
            reading.gamma.0 += self.noise * random.normal();
            reading
        });
        (sensor, ball, readings.collect())
    }
}

/// What became of sets.
#[derive(Debug, Default)]
struct Tally {
    told: usize,
    /// Another minimum than the one that the truth leads to.
    wrong: usize,
    /// A point at the mean reading off by more than 5 standard uncertainties; by more than 20.
    beyond: [usize; 2],
    refused: BTreeMap<&'static str, usize>,
}

impl Tally {
    fn of(number: usize, sets: usize, kind: impl Fn(&mut Random) -> Kind) -> Self {
        let mut random = Random(70 + number as u64);
        let mut tally = Self::default();
        for _ in 0..sets {
            let (truth, ball, readings) = kind(&mut random).set(number, &mut random);
            tally.add(&truth, ball, &readings);
        }
        tally
    }

    fn add(&mut self, truth: &PointSensor, ball: CalibrationBall, readings: &[BallReading]) {
        let wanted = PointQuestion::default();
        let balls = [ball];
        let fit = match calibrate(readings, &balls, &wanted) {
            Ok(fit) => fit,
            Err(error) => {
                *self.refused.entry(error.code()).or_default() += 1;
                return;
            }
        };
        self.told += 1;
        let origin = Point::from_mm(0.0, 0.0, 0.0);
        let place = |sensor: &PointSensor| sensor.place(origin, fit.mean_gamma).mm;
        let off = place(&fit.sensor) - place(truth);
        let u = fit.place_uncertainty(fit.mean_gamma).unwrap().u;
        let times = (0..3).fold(0.0_f64, |most, k| most.max(off[k].abs() / u[k].0));
        for (count, limit) in self.beyond.iter_mut().zip([5.0, 20.0]) {
            *count += usize::from(times > limit);
        }
        let view = View::<5>::new(readings, &balls, &wanted).unwrap();
        let start = view.beam(place(truth), truth.direction);
        if let Ok(near) = descend(start, &view.sightings(), 200) {
            let apart = (near.surface.direction - fit.sensor.direction).norm();
            self.wrong += usize::from(apart > 0.01);
        }
    }

    fn refused(&self) -> usize {
        self.refused.values().sum()
    }
}

fn sets(quick: usize) -> usize {
    if std::env::var_os("OPENUMI_LONG").is_some() {
        10 * quick
    } else {
        quick
    }
}

/// Six readings to eight: hardly a wrong beam is told, and good sets are not refused beyond need.
#[test]
fn few_readings_tell_no_other_beam() {
    // Of a thousand good sets so many are refused at most.
    for (number, refused) in [(6, 250), (7, 30), (8, 5)] {
        let good = Tally::of(number, sets(600), |_| GOOD);
        let any = Tally::of(number, sets(1200), Kind::any);
        std::println!("{number}: good {good:?}; any {any:?}");
        for tally in [&good, &any] {
            assert!(tally.wrong * 1000 <= tally.told, "{number}: {tally:?}");
        }
        let share = good.refused() * 1000 / (good.told + good.refused());
        assert!(share <= refused, "{number}: {good:?}");
        assert!(any.refused() < any.told, "{number}: {any:?}");
    }
}

/// Six readings of a ball over a good cone that fit a beam 42 degrees off the true one to 0.1 µm.
#[test]
fn a_wrong_beam_that_fits_better_is_not_told() {
    let readings = [
        [85.021118624, 108.723181326, 223.266918724, 21.372697305],
        [85.686864496, 103.371177935, 223.671835261, 21.637829897],
        [85.797879504, 106.532168996, 222.470909769, 19.881359494],
        [85.700440151, 106.094075401, 223.803855861, 21.137315966],
        [83.700829833, 106.180049368, 224.226482337, 21.497465872],
        [84.649074313, 102.698820823, 221.661456147, 19.727489166],
    ]
    .map(|[x, y, z, gamma]| BallReading {
        axes: Point::from_mm(x, y, z),
        gamma: Mm(gamma),
        ball: 0,
    });
    let ball = CalibrationBall {
        center: Point::from_mm(28.862980685, 248.313608839, 147.674689651),
        radius: Mm(5.284758312),
        u_center: Mm(0.002),
        u_radius: Mm(0.0),
    };
    let told = calibrate(&readings, &[ball], &PointQuestion::default());
    assert_eq!(told.unwrap_err().code(), "ambiguous");
}
