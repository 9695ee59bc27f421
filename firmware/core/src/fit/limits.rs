//! The documented limits between an answer and a refusal.

use super::solve::least_squares::Stopped;
use super::{FitError, MAX_CONDITION, MAX_RELATIVE_UNCERTAINTY, Quantity, Statistics};

/// Radius, in sizes of the point set, at which a round surface is called flat.
pub(crate) const FLAT: f64 = 1e7;

/// The refusal of a quantity whose standard uncertainty is too large against
/// `size` (in mm, or rad for angles).
pub(crate) fn uncertain(
    stats: &Statistics,
    quantity: Quantity,
    unit_variance: f64,
    size: f64,
) -> Result<(), FitError> {
    let limit = MAX_RELATIVE_UNCERTAINTY;
    let relative_uncertainty = relative(stats, unit_variance, size);
    // Written so that NaN is refused too.
    if relative_uncertainty <= limit {
        return Ok(());
    }
    Err(FitError::Uncertain {
        quantity,
        relative_uncertainty,
        limit,
    })
}

/// The same for a radius, whose refusal has a name of its own.
pub(crate) fn curved(stats: &Statistics, unit_variance: f64, radius: f64) -> Result<(), FitError> {
    let limit = MAX_RELATIVE_UNCERTAINTY;
    let relative_uncertainty = relative(stats, unit_variance, radius);
    if relative_uncertainty <= limit {
        return Ok(());
    }
    Err(FitError::CapTooSmall {
        relative_uncertainty,
        limit,
    })
}

/// The refusal of a quantity whose condition is too large.
pub(crate) fn conditioned(quantity: Quantity, unit_variance: f64) -> Result<(), FitError> {
    let condition = libm::sqrt(unit_variance);
    if condition <= MAX_CONDITION {
        return Ok(());
    }
    Err(FitError::IllConditioned {
        quantity,
        condition,
        limit: MAX_CONDITION,
    })
}

fn relative(stats: &Statistics, unit_variance: f64, size: f64) -> f64 {
    stats
        .standard_uncertainty(unit_variance)
        .map_or(0.0, |u| u / size)
}

/// The refusal when the best round surface is flat.
pub(crate) fn flat() -> FitError {
    FitError::CapTooSmall {
        relative_uncertainty: f64::INFINITY,
        limit: MAX_RELATIVE_UNCERTAINTY,
    }
}

/// The refusal when an iteration stopped at a surface of this radius in local
/// units.
pub(crate) fn stopped<S>(stopped: &Stopped<S>, radius: f64) -> FitError {
    // On the way to a plane there is no minimum: the radius only grows.
    if radius > 1e3 {
        flat()
    } else {
        FitError::NoConvergence {
            iterations: stopped.iterations,
        }
    }
}
