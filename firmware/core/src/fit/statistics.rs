//! Statistics of a fit's residuals.

use super::EXACT_FIT_ROUNDINGS;
use super::solve::cloud::count;
use crate::units::Mm;

/// Statistics of the residuals of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// Number of points (of pairs for a registration).
    pub n: usize,
    /// Degrees of freedom: observations minus parameters.
    pub dof: usize,
    /// `sqrt(sum d² / n)`. For a line the distances, for a registration the
    /// lengths of the residual vectors are summed.
    pub rms: Mm,
    /// `sqrt(sum d² / dof)`, the estimate of the standard deviation of one
    /// coordinate of a point. None if there are no degrees of freedom, or if
    /// the points fit to the rounding of their coordinates, so that the
    /// residuals say nothing about noise.
    pub sigma: Option<Mm>,
    /// Largest absolute residual.
    pub max_abs_residual: Mm,
}

impl Statistics {
    /// From residuals in mm and the worth of one rounding in mm.
    pub(crate) fn new(residuals_mm: impl Iterator<Item = f64>, dof: usize, rounding: Mm) -> Self {
        let mut n = 0_usize;
        let mut sum = 0.0;
        let mut largest = 0.0_f64;
        for d in residuals_mm {
            n = n.saturating_add(1);
            sum += d * d;
            largest = largest.max(d.abs());
        }
        let rms = libm::sqrt(sum / count(n.max(1)));
        let noisy = dof > 0 && rms > EXACT_FIT_ROUNDINGS * rounding.0;
        Self {
            n,
            dof,
            rms: Mm(rms),
            sigma: noisy.then(|| Mm(libm::sqrt(sum / count(dof)))),
            max_abs_residual: Mm(largest),
        }
    }

    /// `sigma²` in mm², the factor between unit and true covariance.
    #[must_use]
    pub fn variance_mm2(&self) -> Option<f64> {
        self.sigma.map(|sigma| sigma.0 * sigma.0)
    }

    /// The covariance for the estimated noise, from that for unit noise.
    #[must_use]
    pub fn covariance<const K: usize>(&self, unit: &[[f64; K]; K]) -> Option<[[f64; K]; K]> {
        self.variance_mm2()
            .map(|variance| super::solve::linalg::scaled(unit, variance))
    }

    /// The standard uncertainty that belongs to a variance for unit noise.
    #[must_use]
    pub fn standard_uncertainty(&self, unit_variance: f64) -> Option<f64> {
        self.sigma
            .map(|sigma| sigma.0 * libm::sqrt(unit_variance.max(0.0)))
    }

    /// Standard uncertainties that belong to the diagonal of a covariance for
    /// unit noise.
    #[must_use]
    pub fn uncertainties<const K: usize>(&self, unit: &[[f64; K]; K]) -> Option<[f64; K]> {
        let sigma = self.sigma?.0;
        Some(
            super::solve::linalg::diagonal(unit)
                .map(|variance| sigma * libm::sqrt(variance.max(0.0))),
        )
    }
}
