//! What errors neighbours share: a covariance that falls with the distance, fitted to the products of residuals.
//!
//! Residuals of a fit are smaller than the errors: the pose has taken its part of them, and the more, the further they are
//! shared. So what is compared with the data is not a covariance C(r) = s² ρ(r/L) but what the fit leaves of it,
//! (1 − H) C (1 − H), with the fit's own H = A (AᵀA)⁻¹ Aᵀ. And few patches say little of s²: the region of 95 % is that of
//! F with as many degrees of freedom as the patches have (Satterthwaite: tr(M)² / tr(M²)).

use nalgebra::{DMatrix, SMatrix, SVector};

use crate::localise::search::pairs::spread;
use crate::rigid::Vec3;

/// Points whose pairs are looked at, and of those the points with which a covariance is tried.
const PAIRED: usize = 1200;
const TRIED: usize = 300;
/// Steps of the distance: 60 make the extent of the points.
const BINS: usize = 24;
const STEPS: f64 = 60.0;
/// Lengths that are tried: the first in steps, each next one so many times as long.
const FIRST: f64 = 1.5;
const LONGER: f64 = 1.35;
const LENGTHS: usize = 8;
/// Near pairs, in steps, show whether anything is shared at all.
const NEAR: usize = 4;

/// A covariance that falls with the distance.
#[derive(Clone, Copy, Debug)]
struct Falling {
    length_mm: f64,
    /// As exp(−r²/L²); else as exp(−r/L).
    smooth: bool,
}

impl Falling {
    fn at(&self, r: f64) -> f64 {
        let x = r / self.length_mm;
        if self.smooth {
            (-x * x).exp()
        } else {
            (-x).exp()
        }
    }
}

/// The sum over pairs of what their points share of each other's rows, in mm²; zero if neighbours share nothing.
/// `residual`: what a fit has left of a point's distance, in mm; `row`: what of the fit moves it.
pub(in crate::localise) fn shared<const N: usize>(
    points: &[Vec3],
    on_part: &[usize],
    sigma: f64,
    residual: &impl Fn(usize) -> f64,
    row: &impl Fn(usize) -> SVector<f64, N>,
) -> SMatrix<f64, N, N> {
    let pick = |most: usize| -> Vec<usize> {
        let chosen = spread(on_part.len(), most);
        chosen.into_iter().map(|k| on_part[k]).collect()
    };
    let chosen = pick(PAIRED);
    let (low, high) = crate::surface::bounds(chosen.iter().map(|&i| &points[i]));
    let step = (high - low).norm() / STEPS;
    let zero = SMatrix::zeros();
    if chosen.len() < 30 || step <= 0.0 {
        return zero;
    }
    let apart = |i: usize, j: usize| (points[i] - points[j]).norm();
    let mut seen = [(0.0, 0.0); BINS];
    for (a, &i) in chosen.iter().enumerate() {
        for &j in &chosen[..a] {
            let bin = (apart(i, j) / step) as usize;
            if bin < BINS {
                seen[bin].0 += residual(i) * residual(j);
                seen[bin].1 += 1.0;
            }
        }
    }
    let near = |k: fn(&(f64, f64)) -> f64| seen[..NEAR].iter().map(k).sum::<f64>();
    let (sum, count) = (near(|s| s.0), near(|s| s.1));
    // More than chance makes of noise that is each point's own.
    if count < 10.0 || sum < 3.0 * sigma * sigma * count.sqrt() {
        return zero;
    }
    let Some((falling, square)) = fitted(&pick(TRIED), &apart, &seen, step, sigma, row) else {
        return zero;
    };
    let rows: Vec<SVector<f64, N>> = chosen.iter().map(|&i| row(i)).collect();
    let mut extra = zero;
    for a in 0..chosen.len() {
        let mut others = SVector::<f64, N>::zeros();
        for b in 0..a {
            others += rows[b] * falling.at(apart(chosen[a], chosen[b]));
        }
        let pair = rows[a] * others.transpose() * square;
        extra += pair + pair.transpose();
    }
    let more = on_part.len() as f64 / chosen.len() as f64;
    extra * more * more
}

/// The covariance of which the fit leaves what is seen, and its square at no distance in mm².
fn fitted<const N: usize>(
    few: &[usize],
    apart: &impl Fn(usize, usize) -> f64,
    seen: &[(f64, f64); BINS],
    step: f64,
    sigma: f64,
    row: &impl Fn(usize) -> SVector<f64, N>,
) -> Option<(Falling, f64)> {
    let n = few.len();
    let rows = DMatrix::from_fn(n, N, |a, k| row(few[a])[k]);
    let inverse = (rows.transpose() * &rows).try_inverse()?;
    let taken = &rows * inverse;
    let distance = DMatrix::from_fn(n, n, |a, b| apart(few[a], few[b]));
    let mut best: Option<(f64, Falling, f64, DMatrix<f64>)> = None;
    for smooth in [true, false] {
        for k in 0..LENGTHS {
            let length_mm = FIRST * LONGER.powi(k as i32) * step;
            let falling = Falling { length_mm, smooth };
            let whole = distance.map(|r| falling.at(r));
            let left = without(&whole, &rows, &taken);
            let mut of = [(0.0, 0.0); BINS];
            for a in 0..n {
                for b in 0..a {
                    let bin = (distance[(a, b)] / step) as usize;
                    if bin < BINS {
                        of[bin].0 += left[(a, b)];
                        of[bin].1 += 1.0;
                    }
                }
            }
            let pairs = || {
                seen.iter()
                    .zip(&of)
                    .filter(|(s, o)| s.1 > 0.0 && o.1 > 0.0)
                    .map(|(s, o)| (s.1, s.0 / s.1, o.0 / o.1))
            };
            let both: f64 = pairs().map(|(w, s, o)| w * s * o).sum();
            let own: f64 = pairs().map(|(w, _, o)| w * o * o).sum();
            let square = both / own.max(1e-300);
            let misfit: f64 = pairs().map(|(w, s, o)| w * (s - square * o).powi(2)).sum();
            if square > 0.0 && best.as_ref().is_none_or(|b| misfit < b.0) {
                best = Some((misfit, falling, square, left));
            }
        }
    }
    let (_, falling, square, left) = best?;
    let trace = left.trace();
    let freedom = (trace * trace / left.norm_squared().max(1e-300)).max(4.0);
    // The 95 % point of F, six times, over that of χ²: within 3 % of this from 8 degrees of freedom on.
    let wider = (freedom + 2.0) / (freedom - 2.0);
    Some((falling, square.min(4.0 * sigma * sigma) * wider))
}

/// (1 − H) C (1 − H), with H = `taken` · `rows`ᵀ.
fn without(whole: &DMatrix<f64>, rows: &DMatrix<f64>, taken: &DMatrix<f64>) -> DMatrix<f64> {
    let once = whole - taken * (rows.transpose() * whole);
    &once - (&once * rows) * taken.transpose()
}
