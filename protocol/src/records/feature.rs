//! A fitted feature: its hits, geometry and statistics.
//!
//! The definitions of residual, rms, sigma and covariances are those of
//! `tests/reference/fits/README.md`.

use heapless::Vec;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::job::{FeatureKind, MAX_HITS, Name};
use crate::records::reason::Reason;

/// Reasons kept with one feature, at most; a feature has no more kinds of doubt.
pub const MAX_FEATURE_REASONS: usize = 12;

/// One probed feature, fitted or refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct FeatureResult {
    /// Counts every feature that arrived since the job was set, from 0.
    pub index: u32,
    /// The setup (clamping) to which it belongs, from 0.
    pub setup: u32,
    /// Name as in the job.
    pub name: Name,
    /// The geometry that was to be fitted.
    pub kind: FeatureKind,
    /// Why it is refused; empty means that it is good.
    pub reasons: Vec<Reason, MAX_FEATURE_REASONS>,
    /// Contact points as used in the fit (after compensation).
    pub points_mm: Vec<[f64; 3], MAX_HITS>,
    /// The fit, also of a feature refused by a limit; none if it could not be fitted.
    pub fit: Option<FitReport>,
}

impl FeatureResult {
    /// True if the feature may take part in a verdict OK.
    #[must_use]
    pub fn is_ok(&self) -> bool {
        self.reasons.is_empty() && self.fit.is_some()
    }
}

/// A fit with its statistics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct FitReport {
    /// The fitted geometry and its covariance for unit noise.
    pub shape: Shape,
    /// Degrees of freedom: residual components less parameters.
    pub dof: u32,
    /// sqrt(sum d^2 / n).
    pub rms_mm: f64,
    /// sqrt(sum d^2 / dof); none without degrees of freedom.
    pub sigma_mm: Option<f64>,
    /// One per point, in the order of the points.
    pub residuals_mm: Vec<f64, MAX_HITS>,
}

/// A 3x3 matrix by rows.
pub type Matrix3 = [[f64; 3]; 3];
/// A 4x4 matrix by rows.
pub type Matrix4 = [[f64; 4]; 4];

/// A fitted geometry. Every `cov_unit…` is the covariance that noise of 1 mm
/// would give: inv(JᵀJ); times sigma² it is the covariance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum Shape {
    /// Centre and radius.
    Sphere {
        /// Centre.
        center_mm: [f64; 3],
        /// Radius.
        radius_mm: f64,
        /// Of x, y, z, radius.
        cov_unit: Matrix4,
    },
    /// Plane through `point` with `normal`.
    Plane {
        /// Centroid of the points.
        point_mm: [f64; 3],
        /// Unit normal.
        normal: [f64; 3],
        /// normal . point.
        offset_mm: f64,
        /// Of the normal, rank 2.
        cov_unit_normal: Matrix3,
        /// Variance of the offset along the normal at the centroid.
        var_unit_offset: f64,
    },
    /// Line through `point` along `direction`.
    Line {
        /// Centroid of the points.
        point_mm: [f64; 3],
        /// Unit direction.
        direction: [f64; 3],
        /// Of the direction, rank 2.
        cov_unit_direction: Matrix3,
        /// Of the point, rank 2 (none along the line).
        cov_unit_point: Matrix3,
    },
    /// Circle in space.
    Circle {
        /// Centre.
        center_mm: [f64; 3],
        /// Unit normal of its plane.
        normal: [f64; 3],
        /// Radius.
        radius_mm: f64,
        /// Of x, y, z (in-plane part), radius.
        cov_unit: Matrix4,
        /// Rms of the plane fit.
        rms_plane_mm: f64,
    },
    /// Cylinder about an axis.
    Cylinder {
        /// Foot of the centroid on the axis.
        point_mm: [f64; 3],
        /// Unit direction of the axis.
        direction: [f64; 3],
        /// Radius.
        radius_mm: f64,
        /// Of the direction, rank 2.
        cov_unit_direction: Matrix3,
        /// Of the point, rank 2 (none along the axis).
        cov_unit_point: Matrix3,
        /// Variance of the radius.
        var_unit_radius: f64,
    },
    /// Cone from its apex into the points.
    Cone {
        /// Apex.
        apex_mm: [f64; 3],
        /// Unit direction from the apex into the points.
        direction: [f64; 3],
        /// Half angle.
        half_angle_rad: f64,
        /// Of the apex.
        cov_unit_apex: Matrix3,
        /// Of the direction, rank 2.
        cov_unit_direction: Matrix3,
        /// Variance of the half angle, 1/mm².
        var_unit_half_angle: f64,
    },
}

impl Shape {
    /// The point that can serve as a datum position: centre or apex.
    #[must_use]
    pub const fn position_mm(&self) -> Option<[f64; 3]> {
        match self {
            Self::Sphere { center_mm, .. } | Self::Circle { center_mm, .. } => Some(*center_mm),
            Self::Cone { apex_mm, .. } => Some(*apex_mm),
            _ => None,
        }
    }

    /// The radius, where the geometry has one.
    #[must_use]
    pub const fn radius_mm(&self) -> Option<f64> {
        match self {
            Self::Sphere { radius_mm, .. }
            | Self::Circle { radius_mm, .. }
            | Self::Cylinder { radius_mm, .. } => Some(*radius_mm),
            _ => None,
        }
    }
}
