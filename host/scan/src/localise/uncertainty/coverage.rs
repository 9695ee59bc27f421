//! Whether the truth lies where the covariance says, over many simulated scans.
//!
//! Long form (`UMI_COVERAGE_SCANS=60 UMI_COVERAGE_ONLY=views cargo test -p umi-scan --release -- --ignored --nocapture
//! coverage`): the table in `tests/bench/LOCALISE.md`.

use nalgebra::Vector6;

use crate::localise::tests::{Random, bracket, scan, task};
use crate::localise::*;
use crate::rigid::rotation_vector;

/// The 95 % point of χ² with six degrees of freedom.
const REGION: f64 = 12.592;

/// What neighbours share: a field of waves (random Fourier features) with the correlation exp(−r²/L²).
struct Shared(Vec<(Vec3, f64)>);

const WAVES: usize = 200;

impl Shared {
    fn new(random: &mut Random, length_mm: f64) -> Self {
        let waves = (0..WAVES).map(|_| {
            let wave = random.vector() * (2.0_f64.sqrt() / length_mm);
            (wave, random.next() * std::f64::consts::TAU)
        });
        Self(waves.collect())
    }

    /// Of variance 1.
    fn at(&self, p: &Vec3) -> f64 {
        let sum: f64 = self.0.iter().map(|(k, turn)| (k.dot(p) + turn).cos()).sum();
        sum * (2.0 / WAVES as f64).sqrt()
    }
}

/// What is simulated.
#[derive(Clone, Copy)]
struct Kind {
    points: usize,
    noise_mm: f64,
    /// Errors that neighbours share: their size, and how far they reach.
    shared_mm: Option<(f64, f64)>,
    /// Views, and by how much each of them stands off the others.
    views: Option<(usize, f64)>,
    /// How many times as dense the points are at one end as at the other, in powers of e.
    uneven: f64,
    /// Each point is there once to four times.
    repeated: bool,
}

const NOISE_MM: f64 = 0.03;
const WHITE: Kind = Kind {
    points: 2500,
    noise_mm: NOISE_MM,
    shared_mm: None,
    views: None,
    uneven: 0.0,
    repeated: false,
};

/// How often the region held the truth; the median over the runs of what was stated, over the root mean square of the
/// error, at the worst corner.
fn coverage(runs: u64, kind: Kind, seed: u64) -> (f64, f64) {
    let model = bracket();
    let corners = model.corners();
    let surface = CompositeSurface::from(model.clone());
    let mut inside = 0;
    let mut stated = vec![Vec::new(); 8];
    let mut right = [0.0; 8];
    for run in 0..runs {
        let mut random = Random(seed.wrapping_add(run.wrapping_mul(0x5851_f42d_4c95_7f2d)));
        let pose = random.pose();
        let (views, off_mm) = kind.views.unwrap_or((1, 0.0));
        let first = random.vector().normalize();
        let across = first.cross(&random.vector()).normalize();
        let mut points = Vec::new();
        for view in 0..views {
            // Around the part, so that each sees faces that the others do not.
            let turn = std::f64::consts::TAU * view as f64 / views as f64;
            let eye = first * turn.cos() + across * turn.sin();
            let mut seen = scan(
                &model,
                kind.points / views,
                kind.noise_mm,
                &pose,
                &mut random,
                |n| n.dot(&eye) > if views > 1 { 0.1 } else { -0.3 },
            );
            let off = pose.rotation * random.vector() * off_mm;
            seen.iter_mut().for_each(|q| *q += off);
            points.extend(seen);
        }
        if kind.uneven > 0.0 {
            points
                .retain(|q| random.next() < (-kind.uneven * pose.undo(q).x.max(0.0) / 68.0).exp());
        }
        if let Some((sigma, length)) = kind.shared_mm {
            let field = Shared::new(&mut random, length);
            let there = solve::measure(&surface, &points, &pose, &[], Threads::new(1));
            for (q, m) in points.iter_mut().zip(&there) {
                // Along the face's normal: noise of a point on an edge has another direction.
                let normal = pose.rotation * model.triangles()[m.face].normal;
                *q += normal * (sigma * field.at(&pose.undo(q)));
            }
        }
        if kind.repeated {
            for i in 0..points.len() {
                for _ in 0..(random.next() * 4.0) as usize {
                    points.push(points[i]);
                }
            }
        }
        let mut task = task(&model, &points);
        task.threads = Threads::new(1);
        // The fit alone: that a start or a search leads to the right place is known.
        let near = task.near_start(&surface, &pose).unwrap();
        let mut near = super::super::verdict::Decided::alone(near);
        let found = task.finish(&surface, &mut near).unwrap();
        let turn = rotation_vector(&(pose.rotation * found.motion.rotation.transpose()));
        let shift = pose.translation_mm - found.motion.translation_mm;
        let error = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
        let inverse = found.certainty.cov.try_inverse().unwrap();
        inside += u64::from(error.dot(&(inverse * error)) < REGION);
        for (k, p) in corners.iter().enumerate() {
            stated[k].push(found.certainty.at(&found.motion, p).trace().sqrt());
            right[k] += (found.motion.point(p) - pose.point(p)).norm_squared() / runs as f64;
        }
    }
    let wide = (0..8)
        .map(|k| crate::solve::median(&mut stated[k]) / right[k].sqrt())
        .fold(0.0, f64::max);
    (inside as f64 / runs as f64, wide)
}

#[test]
fn regions_of_95_percent_hold_the_truth_about_as_often() {
    let (white, wide) = coverage(30, WHITE, 1);
    // 95 % less and more three standard deviations of 30 draws.
    assert!(white > 0.83 && wide < 1.2, "{white} {wide}");
    let shared_mm = Some((NOISE_MM, 15.0));
    let (shared, wide) = coverage(30, Kind { shared_mm, ..WHITE }, 2);
    assert!(shared > 0.83 && wide < 2.0, "{shared} {wide}");
}

#[test]
fn errors_shared_over_little_in_a_dense_cloud_are_in_the_region() {
    let kind = Kind {
        points: 12_000,
        noise_mm: NOISE_MM / 3.0,
        shared_mm: Some((NOISE_MM, 1.0)),
        ..WHITE
    };
    let (inside, _) = coverage(8, kind, 3);
    assert!(inside > 0.7, "{inside}");
}

#[test]
fn points_that_are_there_again_make_nothing_more_certain() {
    let kind = Kind {
        repeated: true,
        ..WHITE
    };
    let (inside, _) = coverage(8, kind, 4);
    assert!(inside > 0.8, "{inside}");
}

#[test]
fn views_that_stand_off_each_other_are_in_the_region() {
    let kind = Kind {
        points: 6000,
        noise_mm: 0.01,
        views: Some((3, 0.03)),
        ..WHITE
    };
    let (inside, _) = coverage(8, kind, 5);
    assert!(inside > 0.6, "{inside}");
}

#[test]
#[ignore = "thousands of scans"]
fn coverage_of_many_scans() {
    let runs = std::env::var("UMI_COVERAGE_SCANS")
        .ok()
        .and_then(|v| v.parse().ok())
        .unwrap_or(60);
    let only = std::env::var("UMI_COVERAGE_ONLY").unwrap_or_default();
    let say = |name: String, kind: Kind| {
        if !name.contains(&only) {
            return;
        }
        let (inside, wide) = coverage(runs, kind, 77);
        println!("{name}: {inside:.3} inside, {wide:.2} times as wide as right");
        // 95 % with white noise, 90 % and more with what is shared over 15 mm, but for what chance makes of so many.
        let chance = 3.0 * (0.95 * 0.05 / runs as f64).sqrt();
        match (kind.shared_mm, kind.views) {
            (None, None) => assert!((inside - 0.95).abs() < chance, "{name}"),
            (Some((_, 15.0)), None) => assert!(inside > 0.9 - chance, "{name}"),
            _ => {}
        }
    };
    for points in [2500, 6000, 20_000, 60_000, 200_000] {
        say(format!("white {points}"), Kind { points, ..WHITE });
    }
    for (points, repeated, uneven) in [(6000, true, 0.0), (20_000, true, 0.0), (20_000, false, 4.0)]
    {
        let kind = Kind {
            points,
            repeated,
            uneven,
            ..WHITE
        };
        say(
            format!("white {points} repeated {repeated} uneven {uneven}"),
            kind,
        );
    }
    for points in [6000, 20_000, 60_000, 200_000] {
        for length in [0.4, 1.0, 2.0, 4.0, 15.0, 80.0] {
            for (more, white) in [(1.0, 0.3), (1.0, 1.0), (0.3, 1.0)] {
                let kind = Kind {
                    points,
                    noise_mm: white * NOISE_MM,
                    shared_mm: Some((more * NOISE_MM, length)),
                    ..WHITE
                };
                say(
                    format!("shared {points} {length} mm {more} {white} even"),
                    kind,
                );
                if points == 20_000 && white == 1.0 {
                    let kind = Kind {
                        uneven: 4.0,
                        ..kind
                    };
                    say(
                        format!("shared {points} {length} mm {more} {white} uneven"),
                        kind,
                    );
                }
            }
        }
    }
    for views in 2..=6 {
        for off in [0.005, 0.01, 0.03, 0.1] {
            let kind = Kind {
                points: 12_000,
                noise_mm: 0.01,
                views: Some((views, off)),
                ..WHITE
            };
            say(format!("views {views} off {off}"), kind);
        }
    }
}
