//! B-splines, plain and rational (Piegl and Tiller, The NURBS Book, algorithms A2.1 to A2.3, A3.1 and A3.5).

use nalgebra::{Vector3, Vector4};

use super::super::unreadable::unreadable;
use crate::ScanError;

/// The highest degree that is read.
const HIGHEST: usize = 12;

/// The knots of one direction.
#[derive(Debug, Clone)]
pub(super) struct Knots {
    degree: usize,
    knots: Vec<f64>,
}

impl Knots {
    /// From degree, knots with their multiplicities, and the number of control points.
    pub fn new(
        degree: f64,
        values: &[f64],
        multiplicities: &[f64],
        points: usize,
    ) -> Result<Self, ScanError> {
        if !(1.0..=HIGHEST as f64).contains(&degree) || degree.fract() != 0.0 {
            return Err(unreadable(format_args!(
                "a spline's degree is 1 to {HIGHEST}, not {degree}"
            )));
        }
        let degree = degree as usize;
        let wrong = || unreadable("knots and control points of a spline do not fit together");
        if values.len() != multiplicities.len() || points <= degree {
            return Err(wrong());
        }
        let mut knots = Vec::with_capacity(points + degree + 1);
        for (k, m) in values.iter().zip(multiplicities) {
            if !(1.0..=(degree + 1) as f64).contains(m) || m.fract() != 0.0 {
                return Err(wrong());
            }
            knots.extend(std::iter::repeat_n(*k, *m as usize));
        }
        let rising = knots.windows(2).all(|w| w[0] <= w[1]);
        if knots.len() != points + degree + 1 || !rising || knots[degree] >= knots[points] {
            return Err(wrong());
        }
        Ok(Self { degree, knots })
    }

    /// Where the spline begins and ends.
    pub fn ends(&self) -> [f64; 2] {
        [
            self.knots[self.degree],
            self.knots[self.knots.len() - 1 - self.degree],
        ]
    }

    /// The knots between, each once, with both ends.
    pub fn breaks(&self) -> Vec<f64> {
        let inner = &self.knots[self.degree..self.knots.len() - self.degree];
        let mut breaks = inner.to_vec();
        breaks.dedup();
        breaks
    }

    /// The first control point that counts at `u`, and the weights of it and the next `degree` ones, with derivatives.
    fn basis(&self, u: f64) -> (usize, [f64; HIGHEST + 1], [f64; HIGHEST + 1]) {
        let p = self.degree;
        let [low, high] = self.ends();
        let u = u.clamp(low, high);
        let last = self.knots.len() - p - 2;
        let span = (self.knots.partition_point(|k| *k <= u).max(p + 1) - 1).min(last);
        let mut n = [0.0; HIGHEST + 1];
        let mut lower = [0.0; HIGHEST + 1];
        n[0] = 1.0;
        for j in 1..=p {
            if j == p {
                lower = n;
            }
            let mut saved = 0.0;
            for (r, slot) in n.iter_mut().enumerate().take(j) {
                let right = self.knots[span + r + 1] - u;
                let left = u - self.knots[span + 1 + r - j];
                let sum = right + left;
                let share = if sum > 0.0 { *slot / sum } else { 0.0 };
                *slot = saved + right * share;
                saved = left * share;
            }
            n[j] = saved;
        }
        let mut d = [0.0; HIGHEST + 1];
        for (r, slot) in d.iter_mut().enumerate().take(p + 1) {
            let part = |k: usize, value: f64| {
                let width = self.knots[k + p] - self.knots[k];
                if width > 0.0 { value / width } else { 0.0 }
            };
            let i = span - p + r;
            let first = if r > 0 { part(i, lower[r - 1]) } else { 0.0 };
            let second = if r < p { part(i + 1, lower[r]) } else { 0.0 };
            *slot = p as f64 * (first - second);
        }
        (span - p, n, d)
    }
}

/// A point with its weight, as splines carry them.
pub(super) fn weighted(at: &Vector3<f64>, weight: f64) -> Vector4<f64> {
    Vector4::new(at.x * weight, at.y * weight, at.z * weight, weight)
}

/// Place and derivative from sums that carry weights.
fn plain(sum: &Vector4<f64>, slope: &Vector4<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let at = sum.xyz() / sum.w;
    (at, (slope.xyz() - at * slope.w) / sum.w)
}

/// A spline curve.
#[derive(Debug, Clone)]
pub(super) struct SplineCurve {
    pub knots: Knots,
    pub points: Vec<Vector4<f64>>,
}

impl SplineCurve {
    pub fn at(&self, u: f64) -> Vector3<f64> {
        let (first, n, _) = self.knots.basis(u);
        let mut sum = Vector4::zeros();
        for (point, weight) in self.points[first..].iter().zip(&n[..=self.knots.degree]) {
            sum += point * *weight;
        }
        sum.xyz() / sum.w
    }
}

/// A spline surface; the points of one `u` stand together.
#[derive(Debug, Clone)]
pub(super) struct SplineSurface {
    pub u: Knots,
    pub v: Knots,
    pub points: Vec<Vector4<f64>>,
    pub columns: usize,
}

impl SplineSurface {
    /// Place and both derivatives.
    pub fn at(&self, u: f64, v: f64) -> (Vector3<f64>, Vector3<f64>, Vector3<f64>) {
        let (fu, nu, du) = self.u.basis(u);
        let (fv, nv, dv) = self.v.basis(v);
        let (mut sum, mut by_u, mut by_v) = (Vector4::zeros(), Vector4::zeros(), Vector4::zeros());
        for i in 0..=self.u.degree {
            let row = &self.points[(fu + i) * self.columns + fv..];
            let (mut across, mut slope) = (Vector4::zeros(), Vector4::zeros());
            for j in 0..=self.v.degree {
                across += row[j] * nv[j];
                slope += row[j] * dv[j];
            }
            sum += across * nu[i];
            by_u += across * du[i];
            by_v += slope * nu[i];
        }
        let (at, along_u) = plain(&sum, &by_u);
        let (_, along_v) = plain(&sum, &by_v);
        (at, along_u, along_v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A quarter circle as a rational spline: exact everywhere.
    #[test]
    fn a_rational_arc_is_round() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let curve = SplineCurve {
            knots: Knots::new(2.0, &[0.0, 1.0], &[3.0, 3.0], 3).unwrap(),
            points: vec![
                weighted(&Vector3::new(1.0, 0.0, 0.0), 1.0),
                weighted(&Vector3::new(1.0, 1.0, 0.0), half),
                weighted(&Vector3::new(0.0, 1.0, 0.0), 1.0),
            ],
        };
        for k in 0..=10 {
            let at = curve.at(f64::from(k) / 10.0);
            assert!((at.norm() - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let points = (0..30)
            .map(|k| {
                let (i, j) = (f64::from(k / 6), f64::from(k % 6));
                weighted(
                    &Vector3::new(i, j, (i * 1.3).sin() + j * j * 0.1),
                    1.0 + 0.1 * j,
                )
            })
            .collect();
        let surface = SplineSurface {
            u: Knots::new(3.0, &[0.0, 0.4, 1.0], &[4.0, 1.0, 4.0], 5).unwrap(),
            v: Knots::new(
                2.0,
                &[0.0, 0.2, 0.5, 0.7, 1.0],
                &[3.0, 1.0, 1.0, 1.0, 3.0],
                6,
            )
            .unwrap(),
            points,
            columns: 6,
        };
        let h = 1e-6;
        for (u, v) in [(0.1, 0.9), (0.41, 0.3), (0.8, 0.55)] {
            let (_, by_u, by_v) = surface.at(u, v);
            let slope_u = (surface.at(u + h, v).0 - surface.at(u - h, v).0) / (2.0 * h);
            let slope_v = (surface.at(u, v + h).0 - surface.at(u, v - h).0) / (2.0 * h);
            assert!((by_u - slope_u).norm() < 1e-7);
            assert!((by_v - slope_v).norm() < 1e-7);
        }
    }

    #[test]
    fn knots_that_do_not_fit_are_refused() {
        for (degree, knots, multiplicities, points) in [
            (3.0, &[0.0, 1.0][..], &[4.0, 4.0][..], 5),
            (3.0, &[1.0, 0.0], &[4.0, 4.0], 4),
            (0.5, &[0.0, 1.0], &[4.0, 4.0], 4),
            (3.0, &[0.0, 1.0], &[4.0], 4),
            (40.0, &[0.0, 1.0], &[41.0, 41.0], 41),
            (3.0, &[0.0, 0.0], &[4.0, 4.0], 4),
        ] {
            let refused = Knots::new(degree, knots, multiplicities, points).unwrap_err();
            assert_eq!(refused.code, "mesh_unreadable");
        }
    }
}
