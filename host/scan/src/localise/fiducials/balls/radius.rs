//! The radius of a ball as its points show it, and what it does to the pose if it is not the stated one.

use nalgebra::{Matrix4, Matrix6, Vector4, Vector6};

use super::LEAST;
use crate::ScanError;
use crate::localise::fiducials::{Fiducial, FiducialShape};
use crate::localise::fit::{middle, row};
use crate::localise::uncertainty::at_origin;
use crate::rigid::{Pose, Vec3};
use crate::solve::Measured;

/// The radius of a ball by its own points.
#[derive(Clone, Copy, Debug)]
pub(in crate::localise::fiducials) struct RadiusSeen {
    pub centre_mm: Vec3,
    pub radius_mm: f64,
    /// Its standard uncertainty.
    pub u_mm: f64,
    /// What is left of the distances, in mm.
    pub noise_mm: f64,
}

/// Steps of a fit that begins at the stated radius.
const STEPS: usize = 12;

/// The sphere of least squares through these points (Gauss and Newton), from about the right centre; none if they do not hold it.
pub(in crate::localise::fiducials) fn radius_seen(
    points: &[Vec3],
    about: &Vec3,
    radius_mm: f64,
) -> Option<RadiusSeen> {
    let (mut centre, mut radius) = (*about, radius_mm);
    let (mut inverse, mut squares) = (Matrix4::zeros(), 0.0);
    for _ in 0..STEPS {
        let (mut h, mut g) = (Matrix4::zeros(), Vector4::zeros());
        squares = 0.0;
        for q in points {
            let out = q - centre;
            let n = out.normalize();
            let row = Vector4::new(n.x, n.y, n.z, 1.0);
            let left = out.norm() - radius;
            h += row * row.transpose();
            g += row * left;
            squares += left * left;
        }
        inverse = h.try_inverse()?;
        let step = inverse * g;
        centre += step.xyz();
        radius += step.w;
    }
    let noise_mm = (squares / (points.len() as f64 - 4.0).max(1.0)).sqrt();
    let u_mm = noise_mm * inverse[(3, 3)].max(0.0).sqrt();
    Some(RadiusSeen {
        centre_mm: centre,
        radius_mm: radius,
        u_mm,
        noise_mm,
    })
}

/// How far from where it should be a ball's surface is looked for, over its radius.
const ABOUT: f64 = 0.1;
/// Rounds in which what is not on the sphere is left out.
const ROUNDS: usize = 5;
/// And that is what lies off it by so many times the noise.
const BESIDE: f64 = 4.0;

/// The radius of a ball that has no points where its stated radius puts its surface, by those about there, without what lies
/// beside a sphere (its post). None where most of them lie on no sphere as smooth as the scan.
pub(in crate::localise::fiducials) fn other_radius(
    points: &[Vec3],
    about: &Vec3,
    radius_mm: f64,
    noise_mm: f64,
) -> Option<RadiusSeen> {
    let reach = ABOUT * radius_mm;
    let is_near = |q: &&Vec3| ((**q - about).norm() - radius_mm).abs() < reach;
    let near: Vec<Vec3> = points.iter().filter(is_near).copied().collect();
    let mut on = near.clone();
    let mut seen = None;
    for _ in 0..ROUNDS {
        if on.len() < LEAST.max(near.len() / 2) {
            return None;
        }
        let sphere = radius_seen(&on, about, radius_mm)?;
        let limit = BESIDE * sphere.noise_mm.max(noise_mm);
        let off = |q: &Vec3| ((q - sphere.centre_mm).norm() - sphere.radius_mm).abs();
        on = near.iter().filter(|q| off(q) < limit).copied().collect();
        seen = Some(sphere);
    }
    seen.filter(|sphere| {
        sphere.noise_mm < 2.0 * noise_mm && (sphere.centre_mm - about).norm() < reach
    })
}

/// How far a radius is off, with its standard uncertainty and the noise.
#[derive(Clone, Copy, Debug)]
struct Off {
    by_mm: f64,
    u_mm: f64,
    noise_mm: f64,
}

impl Off {
    fn of(fiducial: &Fiducial, seen: &RadiusSeen) -> Option<Self> {
        let FiducialShape::Ball { radius_mm } = fiducial.shape else {
            return None;
        };
        Some(Self {
            by_mm: seen.radius_mm - radius_mm,
            // Points without noise leave none.
            u_mm: seen.u_mm.max(1e-9),
            noise_mm: seen.noise_mm,
        })
    }

    /// What all of them have in common; nothing of none.
    fn common(all: impl Iterator<Item = Self>) -> Self {
        let (mut by, mut weight, mut noise, mut count) = (0.0, 0.0, 0.0, 0.0_f64);
        for off in all {
            let of_this = off.u_mm.powi(-2);
            by += of_this * off.by_mm;
            weight += of_this;
            noise += off.noise_mm;
            count += 1.0;
        }
        if count == 0.0 {
            return Self {
                by_mm: 0.0,
                u_mm: 0.0,
                noise_mm: 0.0,
            };
        }
        Self {
            by_mm: by / weight,
            u_mm: weight.sqrt().recip(),
            noise_mm: noise / count,
        }
    }

    fn is_sure(&self) -> bool {
        self.by_mm.abs() > SURELY * self.u_mm + ROUGH * self.noise_mm
    }
}

/// A radius is off if it is by so many times its uncertainty and, beyond that, by so many times the noise:
/// points of one ball share errors, and some of its post are among them.
const SURELY: f64 = 4.0;
const ROUGH: f64 = 1.0;

/// What makes balls NG: another radius than their file says. A ball seen from one side puts its centre off by as much and
/// more. Where none is surely off by itself, all of them together may be. `seen`: of each fiducial, if it is a ball.
pub(in crate::localise::fiducials) fn wrong(
    fiducials: &[Fiducial],
    seen: &[Option<RadiusSeen>],
) -> Vec<ScanError> {
    let offs = || {
        let all = fiducials.iter().zip(seen);
        all.filter_map(|(f, seen)| Some((f, Off::of(f, seen.as_ref()?)?)))
    };
    let refused = |what: String, by: f64| {
        ScanError::refused(
            "wrong_radius",
            format_args!(
                "{what} ({by:+.3} mm): is the file right, and does spray lie on the ball?"
            ),
        )
    };
    let each = offs()
        .filter(|(_, off)| off.is_sure())
        .map(|(fiducial, off)| {
            let FiducialShape::Ball { radius_mm } = fiducial.shape else {
                unreachable!("only balls have a radius")
            };
            let what = format!(
                "{} has a radius of {:.3} mm in the scan, and {radius_mm} mm in its file",
                fiducial.name,
                radius_mm + off.by_mm
            );
            refused(what, off.by_mm)
        });
    let each: Vec<ScanError> = each.collect();
    let all = Off::common(offs().map(|(_, off)| off));
    if each.is_empty() && all.is_sure() {
        let what = "the balls together have other radii in the scan than in their file".to_owned();
        return vec![refused(what, all.by_mm)];
    }
    each
}

/// What is added to the covariance of a pose by the radii as they are seen: a common error of all of them, and what each is
/// off beyond it, as far as the points do not tell it from their noise. `on`: the points that the pose is fitted to, with the
/// fiducial of each. Of (turn, translation at the origin), as [`super::super::super::Certainty`] has it.
pub(in crate::localise::fiducials) fn doubt(
    fiducials: &[Fiducial],
    seen: &[Option<RadiusSeen>],
    on: &[(Vec3, Measured, usize)],
    motion: &Pose,
) -> Matrix6<f64> {
    let offs: Vec<Option<Off>> = (fiducials.iter().zip(seen))
        .map(|(f, seen)| Off::of(f, seen.as_ref()?))
        .collect();
    let points: Vec<Vec3> = on.iter().map(|(q, ..)| *q).collect();
    let about = middle(&points);
    let squares: f64 = points.iter().map(|q| (q - about).norm_squared()).sum();
    let arm = (squares / points.len().max(1) as f64).sqrt().max(1e-6);
    let mut information = Matrix6::zeros();
    let mut by_radius = vec![Vector6::zeros(); fiducials.len()];
    for (q, m, body) in on {
        let row = row(q, m, &about, arm);
        information += row * row.transpose();
        by_radius[*body] += row;
    }
    let Some(inverse) = information.try_inverse() else {
        return Matrix6::zeros();
    };
    let common_mm = Off::common(offs.iter().flatten().copied()).by_mm;
    let mut all = Vector6::zeros();
    let mut doubt = Matrix6::zeros();
    for (off, row) in offs.iter().zip(by_radius) {
        let Some(off) = off else {
            continue;
        };
        all += inverse * row * common_mm;
        let own = inverse * row * (off.by_mm - common_mm);
        doubt += own * own.transpose();
    }
    let origin = at_origin(arm, &about, motion);
    origin * (doubt + all * all.transpose()) * origin.transpose()
}
