//! A fit of any kind, and its record for the wire: the one place where fits
//! become protocol types.

use heapless::Vec;
use umi_protocol::feature::{FitReport, Shape};
use umi_protocol::job::FeatureKind;
use umi_protocol::reason::FitRefusal;

use crate::fit::{
    CircleFit, ConeFit, CylinderFit, FitError, LineFit, PlaneFit, SphereFit, Statistics,
};
use crate::fit::{circle, cone, cylinder, line, plane, sphere};
use crate::units::{Mm, Point};

/// A fit of any kind.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "each is the fit of the same name")]
pub enum Fitted {
    Sphere(SphereFit),
    Plane(PlaneFit),
    Line(LineFit),
    Circle(CircleFit),
    Cylinder(CylinderFit),
    Cone(ConeFit),
}

/// Fits points with the geometry asked for.
///
/// # Errors
/// As the fit of that kind.
pub fn fit(kind: FeatureKind, points: &[Point]) -> Result<Fitted, FitError> {
    match kind {
        FeatureKind::Sphere => sphere::fit(points).map(Fitted::Sphere),
        FeatureKind::Plane => plane::fit(points).map(Fitted::Plane),
        FeatureKind::Line => line::fit(points).map(Fitted::Line),
        FeatureKind::Circle => circle::fit(points).map(Fitted::Circle),
        FeatureKind::Cylinder => cylinder::fit(points).map(Fitted::Cylinder),
        FeatureKind::Cone => cone::fit(points).map(Fitted::Cone),
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
            Self::Plane(fit) => Shape::Plane {
                point_mm: fit.point.to_array_mm(),
                normal: fit.normal.into(),
                offset_mm: fit.offset.0,
                cov_unit_normal: fit.cov_unit_normal,
                var_unit_offset: fit.var_unit_offset_at_point,
            },
            Self::Line(fit) => Shape::Line {
                point_mm: fit.point.to_array_mm(),
                direction: fit.direction.into(),
                cov_unit_direction: fit.cov_unit_direction,
                cov_unit_point: fit.cov_unit_point,
            },
            Self::Circle(fit) => Shape::Circle {
                center_mm: fit.center.to_array_mm(),
                normal: fit.normal.into(),
                radius_mm: fit.radius.0,
                cov_unit: fit.cov_unit,
                rms_plane_mm: fit.rms_plane.0,
            },
            Self::Cylinder(fit) => Shape::Cylinder {
                point_mm: fit.point.to_array_mm(),
                direction: fit.direction.into(),
                radius_mm: fit.radius.0,
                cov_unit_direction: fit.cov_unit_direction,
                cov_unit_point: fit.cov_unit_point,
                var_unit_radius: fit.var_unit_radius,
            },
            Self::Cone(fit) => Shape::Cone {
                apex_mm: fit.apex.to_array_mm(),
                direction: fit.direction.into(),
                half_angle_rad: fit.half_angle.0,
                cov_unit_apex: fit.cov_unit_apex,
                cov_unit_direction: fit.cov_unit_direction,
                var_unit_half_angle: fit.var_unit_half_angle,
            },
        }
    }

    /// Statistics of the residuals.
    #[must_use]
    pub fn stats(&self) -> &Statistics {
        match self {
            Self::Sphere(fit) => &fit.stats,
            Self::Plane(fit) => &fit.stats,
            Self::Line(fit) => &fit.stats,
            Self::Circle(fit) => &fit.stats,
            Self::Cylinder(fit) => &fit.stats,
            Self::Cone(fit) => &fit.stats,
        }
    }

    /// Rms over all directions in which the points may be off: of a circle, in
    /// its plane and across it.
    #[must_use]
    pub fn rms_total_mm(&self) -> f64 {
        let rms = self.stats().rms.0;
        match self {
            Self::Circle(fit) => libm::sqrt(rms * rms + fit.rms_plane.0 * fit.rms_plane.0),
            _ => rms,
        }
    }

    /// Distance of a point from the fitted geometry, as the fit defines it.
    #[must_use]
    pub fn residual(&self, p: Point) -> Mm {
        match self {
            Self::Sphere(fit) => fit.residual(p),
            Self::Plane(fit) => fit.residual(p),
            Self::Line(fit) => fit.residual(p),
            Self::Circle(fit) => fit.residual(p),
            Self::Cylinder(fit) => fit.residual(p),
            Self::Cone(fit) => fit.residual(p),
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
        FitError::Degenerate { .. } | FitError::NoDirection => FitRefusal::Degenerate,
        FitError::IllConditioned { .. }
        | FitError::Uncertain { .. }
        | FitError::Ambiguous { .. } => FitRefusal::IllConditioned,
        FitError::CapTooSmall { .. } => FitRefusal::CapTooSmall,
        FitError::NoConvergence { .. } => FitRefusal::NoConvergence,
        FitError::LengthMismatch { .. } => FitRefusal::LengthMismatch,
    }
}
