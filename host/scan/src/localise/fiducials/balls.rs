//! Balls of a known radius: every point says that the centre lies one radius away along its normal.

use nalgebra::{Matrix4, Vector4};

use crate::cloud::tree::PointTree;
use crate::localise::search::oriented::Oriented;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};

/// How near votes must come to each other, in radii.
const NEAR: f64 = 0.14;
/// Votes that a centre needs.
const LEAST: usize = 7;
/// Votes that are counted at most.
const MOST: usize = 48;
/// Centres that are tried at most.
const TRIED: usize = 120;

/// Places where a ball may be, most likely first.
pub(super) fn starts(places: &[Oriented], radius_mm: f64, threads: Threads) -> Vec<Pose> {
    let votes: Vec<Vec3> = places
        .iter()
        .filter(|o| o.is_oriented())
        .flat_map(|o| [o.at + o.normal * radius_mm, o.at - o.normal * radius_mm])
        .collect();
    let tree = PointTree::new(&votes);
    let reach = NEAR * radius_mm;
    let mut counted: Vec<(usize, usize)> = threads
        .each(votes.len(), |i| {
            let mut found = Vec::new();
            tree.within(&votes[i], reach, MOST, &mut found);
            (found.len(), i)
        })
        .into_iter()
        .filter(|(count, _)| *count >= LEAST)
        .collect();
    counted.sort_unstable_by_key(|(count, i)| (std::cmp::Reverse(*count), *i));
    let mut centres: Vec<Vec3> = Vec::new();
    let mut found = Vec::new();
    for (_, i) in counted {
        if centres.len() >= TRIED {
            break;
        }
        if centres
            .iter()
            .any(|c| (c - votes[i]).norm() < 0.35 * radius_mm)
        {
            continue;
        }
        tree.within(&votes[i], reach, 4 * MOST, &mut found);
        let sum: Vec3 = found.iter().map(|f| votes[f.1 as usize]).sum();
        centres.push(sum / found.len() as f64);
    }
    centres
        .into_iter()
        .map(|centre| Pose {
            translation_mm: centre,
            ..Pose::identity()
        })
        .collect()
}

/// The radius of a ball by its own points.
#[derive(Clone, Copy, Debug)]
pub(super) struct RadiusSeen {
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
pub(super) fn radius_seen(points: &[Vec3], about: &Vec3, radius_mm: f64) -> Option<RadiusSeen> {
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
pub(super) fn other_radius(
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
