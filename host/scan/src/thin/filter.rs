//! What is no surface.

use std::cell::RefCell;
use std::collections::HashMap;

use super::drops::{Drops, judged};
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

/// Points that stand out of their own profile: a `spike` lies further than `off_mm` from both its neighbours in the profile,
/// while these lie within `off_mm` of each other. Neighbours follow each other in the file; the ends of a profile stay.
pub fn spikes<'a>(points: Points<'a>, off_mm: f64, drops: &'a RefCell<Drops>) -> Points<'a> {
    let mut points = points;
    // The point before, the point in question; what comes next decides.
    let mut before: Option<CloudPoint> = None;
    let mut here: Option<CloudPoint> = None;
    let mut ended = false;
    Box::new(std::iter::from_fn(move || {
        loop {
            if ended {
                return here.take().map(Ok);
            }
            let next = match points.next() {
                Some(Ok(next)) => next,
                Some(Err(error)) => return Some(Err(error)),
                None => {
                    ended = true;
                    continue;
                }
            };
            let Some(middle) = here else {
                here = Some(next);
                continue;
            };
            let far = |a: &CloudPoint, b: &CloudPoint| {
                (Vec3::from(a.at) - Vec3::from(b.at)).norm() > off_mm
            };
            let spike = before.is_some_and(|b| {
                b.profile == middle.profile
                    && next.profile == middle.profile
                    && far(&middle, &b)
                    && far(&middle, &next)
                    && !far(&b, &next)
            });
            here = Some(next);
            if spike {
                if let Err(error) = drops.borrow_mut().drop_point("spike", &middle) {
                    return Some(Err(error));
                }
                continue;
            }
            before = Some(middle);
            return Some(Ok(middle));
        }
    }))
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

pub(super) fn keep(
    points: Vec<CloudPoint>,
    drops: &RefCell<Drops>,
    reason: &'static str,
    stays: impl Fn(usize, &CloudPoint) -> bool,
) -> Result<Vec<CloudPoint>, ScanError> {
    let mut kept = Vec::with_capacity(points.len());
    for (i, p) in points.into_iter().enumerate() {
        if stays(i, &p) {
            kept.push(p);
        } else {
            drops.borrow_mut().drop_point(reason, &p)?;
        }
    }
    Ok(kept)
}
