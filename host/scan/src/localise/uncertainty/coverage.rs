//! Whether the truth lies where the covariance says, over many simulated scans.
//!
//! Long form, 2000 scans of each kind (`cargo test -p umi-scan --release -- --ignored --nocapture coverage`):
//! see the table in `docs/promises.md`.

use nalgebra::Vector6;

use crate::localise::tests::{Random, bracket, scan, task};
use crate::localise::*;
use crate::rigid::{rotation_vector, stepped};

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

/// How often the region held the truth, and the root of what was stated over what was right, at the worst corner.
fn coverage(runs: u64, noise_mm: f64, shared: Option<(f64, f64)>, seed: u64) -> (f64, f64) {
    let model = bracket();
    let corners = model.corners();
    let mut inside = 0;
    let (mut stated, mut right) = ([0.0; 8], [0.0; 8]);
    for run in 0..runs {
        let mut random = Random(seed.wrapping_add(run.wrapping_mul(0x5851_f42d_4c95_7f2d)));
        let pose = random.pose();
        let eye = random.vector().normalize();
        let mut points = scan(&model, 2500, noise_mm, &pose, &mut random, |n| {
            n.dot(&eye) > -0.3
        });
        let surface = CompositeSurface::from(model.clone());
        if let Some((sigma, length)) = shared {
            let field = Shared::new(&mut random, length);
            let there = solve::measure(&surface, &points, &pose, &[], Threads::new(1));
            for (q, m) in points.iter_mut().zip(&there) {
                // Along the face's normal: noise of a point on an edge has another direction.
                let normal = pose.rotation * model.triangles()[m.face].normal;
                *q += normal * (sigma * field.at(&pose.undo(q)));
            }
        }
        let mut task = task(&model, &points);
        task.threads = Threads::new(1);
        let off = Vector6::from_fn(|i, _| (random.next() - 0.5) * if i < 3 { 0.004 } else { 0.2 });
        let start = stepped(&pose, &off, &pose.point(&corners[0]));
        // The fit alone: that the start leads to the right place is known.
        let near = task.near_start(&surface, &start).unwrap();
        let found = task
            .finish(&surface, &near.motion, near.sigma_mm, Vec::new())
            .unwrap();
        let turn = rotation_vector(&(pose.rotation * found.motion.rotation.transpose()));
        let shift = pose.translation_mm - found.motion.translation_mm;
        let error = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
        let inverse = found.certainty.cov.try_inverse().unwrap();
        inside += u64::from(error.dot(&(inverse * error)) < REGION);
        for (k, p) in corners.iter().enumerate() {
            stated[k] += found.certainty.at(&found.motion, p).trace();
            right[k] += (found.motion.point(p) - pose.point(p)).norm_squared();
        }
    }
    let wide = (0..8)
        .map(|k| (stated[k] / right[k]).sqrt())
        .fold(0.0, f64::max);
    (inside as f64 / runs as f64, wide)
}

const NOISE_MM: f64 = 0.03;

#[test]
fn regions_of_95_percent_hold_the_truth_about_as_often() {
    let (white, wide) = coverage(120, NOISE_MM, None, 1);
    // 95 % less and more three standard deviations of 120 draws.
    assert!(white > 0.89 && wide < 1.3, "{white} {wide}");
    let (shared, wide) = coverage(120, NOISE_MM, Some((NOISE_MM, 15.0)), 2);
    assert!(shared > 0.82 && wide < 2.0, "{shared} {wide}");
}

#[test]
#[ignore = "2000 scans of each kind"]
fn coverage_of_2000_scans() {
    for (name, noise, shared) in [
        ("white noise", NOISE_MM, None),
        (
            "as much shared over 15 mm",
            NOISE_MM,
            Some((NOISE_MM, 15.0)),
        ),
        (
            "three times as much",
            NOISE_MM / 3.0,
            Some((NOISE_MM, 15.0)),
        ),
    ] {
        let (inside, wide) = coverage(2000, noise, shared, 77);
        println!(
            "{name}: {:.2} % inside, {wide:.2} times as wide as right",
            inside * 100.0
        );
        let (least, most) = if shared.is_none() {
            (0.94, 0.96)
        } else {
            (0.90, 1.0)
        };
        assert!((least..=most).contains(&inside) && wide < 2.0);
    }
}
