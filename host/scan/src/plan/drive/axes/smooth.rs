//! The steps of the candidates' raster are taken out.

use super::super::super::course::RunPoint;
use super::{Driver, Stance};

/// B-splines of B-splines, as many as the limits allow: over a few poses to either side, so that steps of 2 degrees are gone.
const ROUNDS: [usize; 3] = [60, 20, 6];

impl Driver<'_> {
    /// Smooths as much as the largest turn and the travel allow.
    ///
    /// Smoothing moves the beam, and the line is laid across the way again behind it: where that turns fast, as on a
    /// fillet that is gone along askew, the spindle's steps can grow beyond those that the search has kept. And where the
    /// beam leans otherwise, X Y Z stand elsewhere. How far they stayed from the ends of their travel.
    pub(in crate::plan::drive) fn smooth_within_limits(
        &self,
        rows: &mut Vec<Vec<f64>>,
        points: &[RunPoint],
        stance: Stance,
    ) -> f64 {
        let room_mm = |rows: &[Vec<f64>]| {
            let each = rows.iter().zip(points);
            each.map(|(angles, point)| {
                self.room_mm(&self.with_carriage(angles, point, stance)[..3])
            })
            .fold(f64::INFINITY, f64::min)
        };
        let mut least = f64::INFINITY;
        for rounds in ROUNDS {
            let mut tried = rows.clone();
            self.smooth(&mut tried, points, rounds);
            let kept = tried.windows(2).all(|w| {
                w[0].iter()
                    .zip(&w[1])
                    .all(|(a, b)| (b - a).abs() <= self.turn_deg + 1e-9)
            });
            if kept {
                let room = room_mm(&tried);
                least = least.min(room);
                // By a billionth, as the machine's limits are kept.
                if room >= -1e-9 {
                    *rows = tried;
                    break;
                }
            }
        }
        least
    }

    /// Takes the steps of the candidates' raster out. An axis' angles are the control polygon of a uniform cubic B-spline, whose
    /// values at its knots (a sixth, four sixths, a sixth) take their places; its ends stay. A pose that would lean too far
    /// keeps its angle. The next round does the same with what is left.
    fn smooth(&self, rows: &mut [Vec<f64>], points: &[RunPoint], rounds: usize) {
        if self.aiming.is_empty() || (!self.spindle && self.aiming.len() > 2) || rows.len() < 3 {
            return;
        }
        let leans_too_far = |angles: &[f64], k: usize| {
            !(self.wished).holds(&self.machine.beam(angles), &points[k].normal)
        };
        let rough = rows.windows(3).any(|w| {
            self.aiming
                .iter()
                .any(|(p, _)| (w[0][*p] - 2.0 * w[1][*p] + w[2][*p]).abs() > 0.8)
        });
        if !rough {
            return;
        }
        for _ in 0..rounds {
            for (p, turn) in &self.aiming {
                let polygon: Vec<f64> = rows.iter().map(|row| row[*p]).collect();
                let [low, high] = turn.limits_deg;
                for (k, around) in (1..).zip(polygon.windows(3)) {
                    let at_knot = (around[0] + 4.0 * around[1] + around[2]) / 6.0;
                    rows[k][*p] = at_knot.clamp(low, high);
                    if leans_too_far(&rows[k], k) {
                        rows[k][*p] = around[1];
                    }
                }
            }
        }
        if !self.spindle {
            return;
        }
        // The line again, which follows from the beam's angles.
        let s = self.machine.turns();
        for (row, point) in rows.iter_mut().zip(points) {
            let held = row[s];
            let (beam, line_held) = self.machine.pointing(row);
            let square = point.along.cross(&beam);
            if let Some(square) = square.try_normalize(1e-9) {
                let square = square * square.dot(&line_held).signum();
                let about = beam * self.machine.mounted().0.z.signum();
                row[s] = held
                    + square
                        .dot(&about.cross(&line_held))
                        .atan2(square.dot(&line_held))
                        .to_degrees();
            }
        }
        self.unwind(rows);
    }
}
