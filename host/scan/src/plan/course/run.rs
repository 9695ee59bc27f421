//! A level line as points for the middle ray, evenly spaced.

use nalgebra::Vector3;

use super::level::LinePoint;
use crate::plan::laser_run::{LaserRun, RunPoint};

/// How a run ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunEnds {
    /// How far before the border the middle ray stays, so that it meets the part.
    pub inset_mm: f64,
    /// What is shorter is no run.
    pub shortest_mm: f64,
}

/// Makes a run with steps of at most `step_mm`; normals and directions are smoothed over `smooth_mm` to either side.
pub fn run(line: &[LinePoint], step_mm: f64, smooth_mm: f64, ends: RunEnds) -> Option<LaserRun> {
    let inset = ends.inset_mm;
    let mut ways = Vec::with_capacity(line.len());
    let mut way = 0.0;
    for (k, p) in line.iter().enumerate() {
        if k > 0 {
            way += (p.at - line[k - 1].at).norm();
        }
        ways.push(way);
    }
    let length = way - 2.0 * inset;
    if length.is_nan() || length < ends.shortest_mm {
        return None;
    }
    let at = |s: f64| {
        let k = ways.partition_point(|w| *w < s).clamp(1, line.len() - 1);
        let w = ((s - ways[k - 1]) / (ways[k] - ways[k - 1]).max(1e-12)).clamp(0.0, 1.0);
        let (a, b) = (&line[k - 1], &line[k]);
        let normal = a.normal * (1.0 - w) + b.normal * w;
        (
            a.at + (b.at - a.at) * w,
            normal.try_normalize(1e-9).unwrap_or(a.normal),
        )
    };
    // Smoothing looks at points closer than the steps.
    let fine = (length / (step_mm / 3.0).min(0.7)).ceil().clamp(2.0, 2e6) as usize;
    let fine_step = length / fine as f64;
    let dense: Vec<_> = (0..=fine)
        .map(|k| at(inset + fine_step * k as f64))
        .collect();
    let reach = (smooth_mm / fine_step).ceil() as usize;
    let count = (length / step_mm).ceil().max(1.0) as usize;
    let mut points = Vec::with_capacity(count + 1);
    for k in 0..=count {
        let s = length * k as f64 / count as f64;
        let (place, _) = at(inset + s);
        let centre = ((s / fine_step).round() as usize).min(fine);
        let (from, to) = (centre.saturating_sub(reach), (centre + reach).min(fine));
        // One-sided windows at the ends would lean; they shrink to stay even.
        let even = (centre - from).min(to - centre).max(1);
        let (from, to) = (centre.saturating_sub(even), (centre + even).min(fine));
        let mut normal = Vector3::zeros();
        for (j, (_, n)) in dense[from..=to].iter().enumerate() {
            let x = (from + j).abs_diff(centre) as f64 / (even as f64 + 1.0);
            normal += n * (1.0 - x * x);
        }
        let normal = normal.try_normalize(1e-9).unwrap_or(dense[centre].1);
        // The direction of a short stretch, a smoothing of its own: a level line on triangles wavers.
        let wide = reach.max(2);
        let (from, to) = (centre.saturating_sub(wide), (centre + wide).min(fine));
        let chord = dense[to].0 - dense[from].0;
        let along = (chord - normal * normal.dot(&chord)).try_normalize(1e-9)?;
        points.push(RunPoint {
            at: place,
            normal,
            along,
        });
    }
    Some(LaserRun {
        points,
        borders: [line.first()?.edge, line.last()?.edge],
    })
}
