//! The motion of a cloud that brings it nearest to its nominal: least squares of the signed
//! distances, by Gauss and Newton from where the cloud lies.
//!
//! This is the last step only. A cloud that lies elsewhere is placed by `localise` first.

use nalgebra::{Matrix6, Vector6};
use serde::Serialize;

use super::{Nominal, nearest};
use crate::ScanError;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3, stepped};
use crate::solve::eigen;

/// Which of wx wy wz tx ty tz stay 0: turns about the middle of the points, shifts along the axes.
pub type Locked = [bool; 6];

/// What an alignment did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CloudAlignment {
    /// Three rows: an aligned point is `rotation · p + translation_mm`.
    pub rotation: [[f64; 3]; 3],
    /// The shift.
    pub translation_mm: [f64; 3],
    /// How many of the directions that are not locked change no distance, as the turn of a cylinder
    /// about its axis: along them nothing was moved.
    pub unseen: usize,
    /// Root mean square of the distances before.
    pub rms_before_mm: f64,
}

const MOST_STEPS: usize = 200;
/// An eigenvalue below this share of the largest moves nothing; turns are worth the cloud's own
/// size.
const UNSEEN: f64 = 1e-10;
/// Steps are shortened so often, by a half each time.
const HALVINGS: i32 = 12;

/// Aligns the points in place.
///
/// # Errors
/// `too_few_points` with fewer than what is sought; `not_finite`; `no_convergence`.
pub fn align(
    points: &mut [Vec3],
    nominal: &Nominal,
    locked: Locked,
    threads: Threads,
) -> Result<CloudAlignment, ScanError> {
    let sought = locked.iter().filter(|locked| !**locked).count();
    if points.len() < sought.max(1) {
        return Err(ScanError::refused(
            "too_few_points",
            format_args!("{} points for {sought} unknowns", points.len()),
        ));
    }
    let sum: Vec3 = points.iter().sum();
    let pivot = sum / points.len() as f64;
    let arms: f64 = points.iter().map(|p| (p - pivot).norm_squared()).sum();
    let reach_mm = (arms / points.len() as f64).sqrt().max(1e-9);
    let start = points.to_vec();
    let place = |motion: &Pose, points: &mut [Vec3]| {
        for (to, from) in points.iter_mut().zip(&start) {
            *to = motion.point(from);
        }
    };
    let mut motion = Pose::identity();
    let mut now = normal_equations(points, nominal, &pivot, reach_mm, &locked, threads)?;
    let before = now.ssq;
    let mut settled = false;
    for _ in 0..MOST_STEPS {
        let step = now.step();
        let mut next = None;
        for halving in 0..HALVINGS {
            let mut part = step.0 * 0.5_f64.powi(halving);
            part.fixed_rows_mut::<3>(0).scale_mut(1.0 / reach_mm);
            let tried = stepped(&motion, &part, &pivot);
            place(&tried, points);
            let equations = normal_equations(points, nominal, &pivot, reach_mm, &locked, threads)?;
            if equations.ssq <= now.ssq * (1.0 + 1e-12) {
                next = Some((tried, equations));
                break;
            }
        }
        let Some((tried, equations)) = next else {
            // No shorter step is better either: the optimum, up to rounding and edges.
            settled = true;
            break;
        };
        let gained = now.ssq - equations.ssq;
        (motion, now) = (tried, equations);
        if gained <= 1e-13 * now.ssq || step.0.amax() < 1e-12 {
            settled = true;
            break;
        }
    }
    if !settled {
        return Err(ScanError::refused(
            "no_convergence",
            "the cloud does not settle on the nominal: place it first with umi scan localise",
        ));
    }
    place(&motion, points);
    Ok(CloudAlignment {
        rotation: motion.rows(),
        translation_mm: motion.translation_mm.into(),
        unseen: now.step().1.saturating_sub(6 - sought),
        rms_before_mm: (before / points.len() as f64).sqrt(),
    })
}

/// Sums over all points, with turns worth the cloud's size.
struct NormalEquations {
    matrix: Matrix6<f64>,
    right: Vector6<f64>,
    ssq: f64,
}

impl NormalEquations {
    /// The step over all that is seen, and how many directions are not.
    fn step(&self) -> (Vector6<f64>, usize) {
        let (values, vectors) = eigen(&self.matrix);
        let floor = values.amax() * UNSEEN;
        let (mut step, mut unseen) = (Vector6::zeros(), 0);
        for (value, vector) in values.iter().zip(vectors.column_iter()) {
            if *value > floor {
                step -= vector * (vector.dot(&self.right) / value);
            } else {
                unseen += 1;
            }
        }
        (step, unseen)
    }
}

fn normal_equations(
    points: &[Vec3],
    nominal: &Nominal,
    pivot: &Vec3,
    reach_mm: f64,
    locked: &Locked,
    threads: Threads,
) -> Result<NormalEquations, ScanError> {
    let near = nearest(points, nominal, threads)?;
    let mut all = NormalEquations {
        matrix: Matrix6::zeros(),
        right: Vector6::zeros(),
        ssq: 0.0,
    };
    for (point, near) in points.iter().zip(&near) {
        let turn = (point - pivot).cross(&near.direction) / reach_mm;
        let by = near.direction;
        let mut row = Vector6::new(turn.x, turn.y, turn.z, by.x, by.y, by.z);
        for (value, locked) in row.iter_mut().zip(locked) {
            if *locked {
                *value = 0.0;
            }
        }
        all.matrix += row * row.transpose();
        all.right += row * near.distance_mm;
        all.ssq += near.distance_mm * near.distance_mm;
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::{deviations_mm, summary};

    /// Points on the faces of a box, as a nominal of planes cannot have them: on a ball and a torus.
    fn on_torus() -> Vec<Vec3> {
        let mut points = Vec::new();
        for i in 0..40 {
            for k in 0..20 {
                let (u, v) = (0.11 * f64::from(i), 0.3 * f64::from(k));
                let across = 20.0 + 4.0 * v.cos();
                points.push(Vec3::new(across * u.cos(), across * u.sin(), 4.0 * v.sin()));
            }
        }
        points
    }

    fn torus() -> Nominal {
        Nominal::parse(
            "kind = \"torus\"\ncenter_mm = [0, 0, 0]\ndirection = [0, 0, 1]\n\
             major_radius_mm = 20\nminor_radius_mm = 4",
        )
        .unwrap()
    }

    #[test]
    fn a_moved_cloud_comes_back_but_for_what_nothing_sees() {
        let motion = stepped(
            &Pose::identity(),
            &Vector6::new(0.05, -0.03, 0.4, 0.5, -0.7, 0.3),
            &Vec3::new(1.0, 2.0, 3.0),
        );
        let mut points: Vec<Vec3> = on_torus().iter().map(|p| motion.point(p)).collect();
        let done = align(&mut points, &torus(), [false; 6], Threads::new(1)).unwrap();
        assert_eq!(done.unseen, 1, "the turn about the torus' axis");
        assert!(done.rms_before_mm > 0.1);
        let found = summary(&deviations_mm(&points, &torus())).unwrap();
        assert!(found.rms_mm < 1e-9, "{found:?}");
    }

    #[test]
    fn what_is_locked_does_not_move() {
        let shift = Vec3::new(0.2, 0.1, -0.3);
        let mut points: Vec<Vec3> = on_torus().iter().map(|p| p + shift).collect();
        // Only the height is free.
        let locked = [true, true, true, true, true, false];
        let done = align(&mut points, &torus(), locked, Threads::new(2)).unwrap();
        assert_eq!(done.rotation, Pose::identity().rows());
        assert_eq!(done.translation_mm[..2], [0.0, 0.0]);
        assert_eq!(done.unseen, 0);
        assert!((done.translation_mm[2] - 0.3).abs() < 0.01, "{done:?}");
        let error = align(&mut points[..3], &torus(), [false; 6], Threads::new(1)).unwrap_err();
        assert_eq!(error.code, "too_few_points");
    }
}
