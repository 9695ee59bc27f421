//! Points of other things: a wall behind a face that nobody scanned belongs to that face by its distance, and is none of
//! its stock.
//!
//! What is left out stands off the part by more than the rest of the scan, and apart from it: a raw part with much stock on one
//! face is scanned without a gap around its edges. Where such a face is scanned with a gap it is left out as well, and told as
//! not scanned: no verdict is OK by what may be a wall.

use std::collections::HashMap;

use crate::cloud::tree::PointTree;
use crate::parallel::Threads;
use crate::rigid::Vec3;
use crate::solve::{Measured, median};

/// Points are apart if two cubes lie between them that are so many spacings wide, and this share of the part's size.
const SPACINGS: f64 = 3.0;
const CUBE: f64 = 0.02;
/// The raw part is what has most points within this share of the part's size.
const ABOUT: f64 = 0.1;
/// Something stands off if nearly all of it has so many times the stock of nearly all of the raw part, and this share of
/// the part's size.
const TIMES: f64 = 2.5;
const OFF: f64 = 0.03;
/// Nearly all: but this share.
const BUT: f64 = 0.1;
/// Points that the spacing is seen by.
const ASKED: usize = 400;

/// The numbers of the points that are of other things, by where the part lies about. Nothing within the part is: material
/// that is missing stays.
pub(super) fn find(
    points: &[Vec3],
    measured: &[Measured],
    diagonal_mm: f64,
    threads: Threads,
) -> Vec<usize> {
    let cube = (SPACINGS * spacing(points, threads)).max(CUBE * diagonal_mm);
    let bodies = bodies(points, cube);
    let count = bodies.iter().max().map_or(0, |last| last + 1);
    if count < 2 {
        return Vec::new();
    }
    let mut stocks: Vec<Vec<f64>> = vec![Vec::new(); count];
    for (body, m) in bodies.iter().zip(measured) {
        stocks[*body].push(m.distance_mm);
    }
    let about = |stocks: &Vec<f64>| {
        let near = stocks.iter().filter(|mm| mm.abs() < ABOUT * diagonal_mm);
        near.count()
    };
    let Some(raw) = (0..count).max_by_key(|&k| (about(&stocks[k]), std::cmp::Reverse(k))) else {
        return Vec::new();
    };
    let mut sizes: Vec<f64> = stocks[raw].iter().map(|mm| mm.abs()).collect();
    let limit = (TIMES * quantile(&mut sizes, 1.0 - BUT)).max(OFF * diagonal_mm);
    let is_off: Vec<bool> = (0..count)
        .map(|k| k != raw && quantile(&mut stocks[k], BUT) > limit)
        .collect();
    (0..points.len()).filter(|&i| is_off[bodies[i]]).collect()
}

/// The value below which this share lies; 0 of nothing.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let k = ((values.len() - 1) as f64 * share) as usize;
    *values.select_nth_unstable_by(k, f64::total_cmp).1
}

/// How far points lie from their neighbours.
fn spacing(points: &[Vec3], threads: Threads) -> f64 {
    let tree = PointTree::new(points);
    let step = points.len().div_ceil(ASKED).max(1);
    let some: Vec<usize> = (0..points.len()).step_by(step).collect();
    let mut all = threads.each(some.len(), |k| {
        let mut found = Vec::new();
        tree.nearest(&points[some[k]], 3, &mut found);
        found.last().map_or(0.0, |(squared, _)| squared.sqrt())
    });
    median(&mut all)
}

/// The body of each point: what is linked by cubes that touch.
fn bodies(points: &[Vec3], cube: f64) -> Vec<usize> {
    let key = |q: &Vec3| [q.x, q.y, q.z].map(|x| (x / cube).floor() as i64);
    let mut cells: HashMap<[i64; 3], usize> = HashMap::new();
    let mut order: Vec<[i64; 3]> = Vec::new();
    let of: Vec<usize> = points
        .iter()
        .map(|q| {
            *cells.entry(key(q)).or_insert_with(|| {
                order.push(key(q));
                order.len() - 1
            })
        })
        .collect();
    let mut body = vec![usize::MAX; order.len()];
    let mut count = 0;
    for seed in 0..order.len() {
        if body[seed] != usize::MAX {
            continue;
        }
        body[seed] = count;
        let mut front = vec![seed];
        while let Some(at) = front.pop() {
            let [x, y, z] = order[at];
            for step in 0..27_i64 {
                let next = [
                    x.saturating_add(step % 3 - 1),
                    y.saturating_add(step / 3 % 3 - 1),
                    z.saturating_add(step / 9 - 1),
                ];
                if let Some(&next) = cells.get(&next)
                    && body[next] == usize::MAX
                {
                    body[next] = count;
                    front.push(next);
                }
            }
        }
        count += 1;
    }
    of.into_iter().map(|cell| body[cell]).collect()
}
