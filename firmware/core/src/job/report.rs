//! A fit of any kind, and its record for the wire: the one place where fits
//! become protocol types.

use heapless::Vec;
use umi_protocol::feature::{FitReport, Shape};
use umi_protocol::job::FeatureKind;
use umi_protocol::reason::FitRefusal;

use crate::fit::{FitError, SphereFit, Statistics, sphere};
use crate::units::{Mm, Point};

/// A fit of any kind.
#[derive(Clone, Copy, Debug)]
pub enum Fitted {
    /// See [`sphere`].
    Sphere(SphereFit),
}

/// Fits points with the geometry asked for.
///
/// # Errors
/// As the fit of that kind.
pub fn fit(kind: FeatureKind, points: &[Point]) -> Result<Fitted, FitError> {
    match kind {
        FeatureKind::Sphere => sphere::fit(points).map(Fitted::Sphere),
        _ => Err(FitError::NoConvergence { iterations: 0 }),
    }
}

impl Fitted {
    /// Geometry and unit covariance.
    #[must_use]
    pub fn shape(&self) -> Shape {
        match self {
            Self::Sphere(fit) => Shape::Sphere {
                center_mm: fit.center.to_array_mm(),
                radius_mm: fit.radius.0,
                cov_unit: fit.cov_unit,
            },
        }
    }

    /// Statistics of the residuals.
    #[must_use]
    pub fn stats(&self) -> &Statistics {
        match self {
            Self::Sphere(fit) => &fit.stats,
        }
    }

    /// Distance of a point from the fitted geometry, as the fit defines it.
    #[must_use]
    pub fn residual(&self, p: Point) -> Mm {
        match self {
            Self::Sphere(fit) => fit.residual(p),
        }
    }

    /// The record of this fit to `points`.
    #[must_use]
    pub fn report(&self, points: &[Point]) -> FitReport {
        let stats = self.stats();
        let mut residuals_mm = Vec::new();
        for point in points {
            // Bounded: a feature's points come from a list of this size.
            let _ = residuals_mm.push(self.residual(*point).0);
        }
        FitReport {
            shape: self.shape(),
            dof: u32::try_from(stats.dof).unwrap_or(u32::MAX),
            rms_mm: stats.rms.0,
            sigma_mm: stats.sigma.map(|sigma| sigma.0),
            residuals_mm,
        }
    }
}

/// The error's class for the wire.
#[must_use]
pub const fn refusal(error: &FitError) -> FitRefusal {
    match error {
        FitError::TooFewPoints { .. } => FitRefusal::TooFewPoints,
        FitError::NotFinite { .. } | FitError::OutOfRange { .. } => FitRefusal::NotFinite,
        FitError::Degenerate { .. } => FitRefusal::Degenerate,
        FitError::IllConditioned { .. }
        | FitError::Uncertain { .. }
        | FitError::Ambiguous { .. } => FitRefusal::IllConditioned,
        FitError::CapTooSmall { .. } => FitRefusal::CapTooSmall,
        FitError::NoConvergence { .. } => FitRefusal::NoConvergence,
        FitError::LengthMismatch { .. } => FitRefusal::LengthMismatch,
    }
}
