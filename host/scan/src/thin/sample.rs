//! Fewer of the same points.

use std::cell::RefCell;
use std::collections::HashMap;

use super::drops::{Drops, judged};
use crate::ScanError;
use crate::cloud::{CloudPoint, Points};

/// Each n-th point, the first among them.
pub fn every<'a>(points: Points<'a>, n: u64, drops: &'a RefCell<Drops>) -> Points<'a> {
    let mut number = 0;
    judged(points, drops, move |_| {
        let stays = number % n.max(1) == 0;
        number += 1;
        (!stays).then_some("sampled")
    })
}

/// The points of a cell.
struct Cell {
    sum: [f64; 3],
    intensity: f64,
    /// Of the mount: one error that all points have together, so that a mean has the mean of it.
    mount_u_mm: f64,
    /// One of them was: then so was their mean.
    interpolated: bool,
    n: u64,
}

/// One point for each cell of a grid about the origin: the mean of those in it, in the order in which the cells were met. The
/// memory is that of the cells, not of the points. Points merged into others are counted as `merged`.
///
/// # Errors
/// What the points answer; `not_finite` where a coordinate is too far out for the grid.
pub fn voxels(
    points: Points<'_>,
    cell_mm: f64,
    drops: &RefCell<Drops>,
) -> Result<Vec<CloudPoint>, ScanError> {
    let mut places: HashMap<[i64; 3], usize> = HashMap::new();
    let mut cells: Vec<Cell> = Vec::new();
    for point in points {
        let point = point?;
        let place = point.at.map(|x| (x / cell_mm).floor());
        if place.iter().any(|x| x.abs() > 9e15) {
            return Err(ScanError::refused(
                "not_finite",
                "A point lies too far out for cells of this size.",
            ));
        }
        let place = place.map(|x| x as i64);
        let number = *places.entry(place).or_insert(cells.len());
        if number == cells.len() {
            cells.push(Cell {
                sum: point.at,
                intensity: point.intensity,
                mount_u_mm: point.mount_u_mm,
                interpolated: point.interpolated,
                n: 1,
            });
            continue;
        }
        let cell = &mut cells[number];
        for (sum, x) in cell.sum.iter_mut().zip(point.at) {
            *sum += x;
        }
        cell.intensity += point.intensity;
        cell.mount_u_mm += point.mount_u_mm;
        cell.interpolated |= point.interpolated;
        cell.n += 1;
        drops.borrow_mut().drop_point("merged", &point)?;
    }
    let mean = |cell: &Cell| CloudPoint {
        at: cell.sum.map(|s| s / cell.n as f64),
        intensity: cell.intensity / cell.n as f64,
        mount_u_mm: cell.mount_u_mm / cell.n as f64,
        interpolated: cell.interpolated,
        ..CloudPoint::default()
    };
    Ok(cells.iter().map(mean).collect())
}
