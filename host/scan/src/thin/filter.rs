//! What is no surface.

use std::cell::RefCell;
use std::collections::HashMap;

use super::beside::{ProfileLine, by_profile};
use super::drops::{Drops, judged, keep};
use super::seen::Beams;
use crate::ScanError;
use crate::cloud::tree::PointTree;
use crate::cloud::{CloudPoint, Points};
use crate::parallel::Threads;
use crate::rigid::Vec3;

/// Points whose intensity is within bounds: `dark` and `bright` ones are left out.
pub fn intensity<'a>(
    points: Points<'a>,
    least: f64,
    most: f64,
    drops: &'a RefCell<Drops>,
) -> Points<'a> {
    judged(points, drops, move |p| {
        // A NaN is not bright enough.
        if p.intensity > most {
            Some("bright")
        } else if p.intensity >= least {
            None
        } else {
            Some("dark")
        }
    })
}

/// Points that stand out of their own profile: a `spike` stands off the line between its two neighbours by more than
/// `off_mm`, and off the lines that carry on what is before it and what is behind it, while these agree with each other
/// within `off_mm`. How far is taken along the beam, where `beams` says it, and else square to each line: the pitch between
/// neighbours is no height. Neighbours follow each other in the file; the ends of a profile stay, and so does what has one
/// neighbour only on either side.
pub fn spikes<'a>(
    points: Points<'a>,
    off_mm: f64,
    beams: Option<Beams>,
    drops: &'a RefCell<Drops>,
) -> Points<'a> {
    by_profile(points, "spike", drops, move |profile| {
        let beam = profile.first().and_then(|p| beams.as_ref()?.of(p.profile));
        let at: Vec<Vec3> = profile.iter().map(|p| Vec3::from(p.at)).collect();
        (0..at.len())
            .map(|place| is_spike(&at, place, off_mm, beam))
            .collect()
    })
}

/// So many samples are looked at on either side of a spike.
const BESIDE: usize = 4;

fn is_spike(at: &[Vec3], place: usize, off_mm: f64, beam: Option<Vec3>) -> bool {
    let (Some(before), Some(behind)) = (place.checked_sub(1), at.get(place + 1)) else {
        return false;
    };
    let (here, before) = (&at[place], &at[before]);
    let is_off = |line: &ProfileLine, p: &Vec3| line.off(p).norm() > off_mm;
    let between = ProfileLine::through(before, behind, beam);
    if !between.is_some_and(|line| is_off(&line, here)) {
        return false;
    }
    let left: Vec<Vec3> = at[..place].iter().rev().take(BESIDE).copied().collect();
    let right: Vec<Vec3> = at[place + 1..].iter().take(BESIDE).copied().collect();
    // Each with the neighbour on its other side, which may lie on it.
    let sides = [(left, behind), (right, before)];
    let lines: Vec<(ProfileLine, &Vec3)> = (sides.iter())
        .filter_map(|(side, other)| Some((ProfileLine::beside(side, off_mm, beam)?, *other)))
        .collect();
    lines.iter().all(|(line, _)| is_off(line, here))
        && lines.iter().any(|(line, other)| !is_off(line, other))
}

/// All points, held in memory.
///
/// # Errors
/// What the points answer.
pub fn held(points: Points<'_>) -> Result<Vec<CloudPoint>, ScanError> {
    points.collect()
}

/// Leaves out `isolated` points: those with fewer than `least` others in their cell of `cell_mm` and the 26 about it.
///
/// # Errors
/// Dropped points cannot be written; `not_finite` where a coordinate is too far out for the cells.
pub fn isolated(
    points: Vec<CloudPoint>,
    cell_mm: f64,
    least: u64,
    drops: &RefCell<Drops>,
) -> Result<Vec<CloudPoint>, ScanError> {
    if points
        .iter()
        .flat_map(|p| p.at)
        .any(|x| (x / cell_mm).abs() > 9e15)
    {
        return Err(ScanError::refused(
            "not_finite",
            "A point lies too far out for cells of this size.",
        ));
    }
    let place = |p: &CloudPoint| p.at.map(|x| (x / cell_mm).floor() as i64);
    let mut cells: HashMap<[i64; 3], u64> = HashMap::new();
    for p in &points {
        *cells.entry(place(p)).or_default() += 1;
    }
    let about = |[x, y, z]: [i64; 3]| -> u64 {
        let mut sum = 0;
        for dx in -1..=1 {
            for dy in -1..=1 {
                for dz in -1..=1 {
                    sum += cells.get(&[x + dx, y + dy, z + dz]).copied().unwrap_or(0);
                }
            }
        }
        sum
    };
    keep(points, drops, "isolated", |_, p| about(place(p)) > least)
}

/// Leaves out `outlier`s: points whose mean distance to their `k` nearest others is more than `sigmas` standard deviations
/// above the mean of all points (Rusu and others, 2008: statistical outlier removal).
///
/// # Errors
/// `too_few_points`; dropped points cannot be written.
pub fn statistical(
    points: Vec<CloudPoint>,
    k: usize,
    sigmas: f64,
    drops: &RefCell<Drops>,
) -> Result<Vec<CloudPoint>, ScanError> {
    if points.len() <= k {
        return Err(ScanError::refused(
            "too_few_points",
            format_args!("{} points have no {k} neighbours each", points.len()),
        ));
    }
    let places: Vec<Vec3> = points.iter().map(|p| Vec3::from(p.at)).collect();
    let tree = PointTree::new(&places);
    let means: Vec<f64> = Threads::all().each(places.len(), |i| {
        // The nearest is the point itself.
        let mut near = Vec::with_capacity(k + 2);
        tree.nearest(&places[i], k + 1, &mut near);
        let sum: f64 = near.iter().map(|(d2, _)| d2.sqrt()).sum();
        sum / k as f64
    });
    let n = means.len() as f64;
    let mean = means.iter().sum::<f64>() / n;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    let most = mean + sigmas * variance.sqrt();
    keep(points, drops, "outlier", |i, _| means[i] <= most)
}
