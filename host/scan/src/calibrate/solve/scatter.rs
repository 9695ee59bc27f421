//! The covariance of an optimum where residuals scatter differently from place to place.
//!
//! `sigma² inv(JᵀJ)` reckons with residuals that are alike. A sensor whose range alone is
//! unsharp leaves smaller ones on flanks, and one whose noise grows with the distance leaves
//! larger ones far away. Every residual then speaks for itself: with `a` the change of the
//! unknowns by a residual `r` and `h` the residual's leverage, the covariance is the sum of
//! `a aᵀ r² / (1 - h)²` (HC3 of MacKinnon and White, 1985).
//!
//! Such a sum is less sure than `sigma²`: it has the degrees of freedom of the Wishart matrix that
//! scatters alike, `k (k + 1) / (2 Σ b⁴)` with `b²` a residual's share in the k targets.

use nalgebra::{DMatrix, DVector};

use super::jacobi::Jacobi;
use super::{Model, range, reduce};

/// Columns that are seen less than this share of the best one are left out.
const UNSEEN: f64 = 1e-10;
/// A residual with a leverage above this says nothing of its own scatter.
const MOST_LEVERAGE: f64 = 0.999;

/// The targets' covariance in their units, and its degrees of freedom; none where a residual alone decides an unknown, or
/// where there is no more than one for each unknown.
pub(in crate::calibrate) fn scatter_covariance<M: Model>(model: &M) -> Option<(DMatrix<f64>, f64)> {
    let (nuisances, targets) = model.unknowns();
    if model.residuals() <= nuisances + targets {
        return None;
    }
    let whiten = whiten(model);
    let to_targets = whiten.columns(nuisances, targets).transpose();
    // The targets' own covariance, residuals of 1 alike: what shares are measured by.
    let alike = (&to_targets * to_targets.transpose()).cholesky()?;
    let mut covariance = DMatrix::zeros(targets, targets);
    let mut line = DVector::zeros(nuisances + targets);
    let (mut decided, mut shares) = (false, 0.0);
    model.rows(&mut |value, derivatives| {
        line.fill(0.0);
        derivatives(line.as_mut_slice());
        let white = &whiten * &line;
        let leverage = white.norm_squared();
        decided |= leverage > MOST_LEVERAGE;
        let change = &to_targets * white;
        let share = change.dot(&alike.solve(&change));
        shares += share * share;
        let weight = value / (1.0 - leverage);
        covariance.ger(weight * weight, &change, &change, 1.0);
    });
    let k = targets as f64;
    (!decided && shares > 0.0).then(|| (covariance, k * (k + 1.0) / (2.0 * shares)))
}

/// `W` with `Wᵀ W = inv(JᵀJ)` over all unknowns that are seen.
pub(in crate::calibrate) fn whiten<M: Model>(model: &M) -> DMatrix<f64> {
    let mut r = reduce(model).r;
    let norms: Vec<f64> = r
        .column_iter()
        .map(|column| column.norm().max(1e-300))
        .collect();
    for (mut column, norm) in r.column_iter_mut().zip(&norms) {
        column /= *norm;
    }
    let svd = Jacobi::new(r);
    let least = UNSEEN * svd.largest();
    let seen = svd.values.iter().filter(|value| **value > least).count();
    // Rows of S⁻¹ Vᵀ; the values fall.
    DMatrix::from_fn(seen, norms.len(), |i, k| {
        svd.v[(k, i)] / (svd.values[i] * norms[k])
    })
}

/// The standard uncertainty of what changes by `gradient` with the unknowns, where residuals have one
/// of 1.
pub(in crate::calibrate) fn unit_uncertainty<M: Model>(model: &M, gradient: &DVector<f64>) -> f64 {
    (whiten(model) * gradient).norm()
}

/// How long a column of an unknown is, and what all the others leave of it: the unknown's standard uncertainty is one over
/// that, where residuals have one of 1. Nothing is left of an unknown that the data do not determine.
pub(in crate::calibrate) fn left_of_column<M: Model>(model: &M, unknown: usize) -> (f64, f64) {
    let mut others = reduce(model).r;
    let column = others.column(unknown).into_owned();
    others = others.remove_column(unknown);
    for mut other in others.column_iter_mut() {
        let norm = other.norm().max(1e-300);
        other /= norm;
    }
    let basis = range(&others);
    let project = |v: DVector<f64>| &v - &basis * basis.tr_mul(&v);
    // Twice, so that nothing of what was projected away is left but rounding.
    (column.norm(), project(project(column.clone())).norm())
}
