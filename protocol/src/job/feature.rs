//! A feature: its geometry, its hits and who compensates them.

use heapless::Vec;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use super::{MAX_HITS, Name};

/// One feature of the part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct FeatureSpec {
    /// The name that the control prints, or any name where it prints none.
    pub name: Name,
    /// The number that a checked line carries as feature id.
    #[serde(default)]
    pub id: Option<u16>,
    /// The geometry fitted to the hits.
    pub kind: FeatureKind,
    /// Hits that make the feature complete; fewer or more are refused.
    pub hits: u16,
    /// Nominal position: centre (sphere, circle) or apex (cone), CAD frame.
    #[serde(default)]
    pub position_mm: Option<[f64; 3]>,
    /// Nominal radius of a sphere, circle or cylinder.
    #[serde(default)]
    pub radius_mm: Option<f64>,
    /// Direction of motion at each hit, in the order of the hits. Needed for
    /// compensation on the board where the lines do not carry it, and for the
    /// approach check. Empty: not known.
    #[serde(default)]
    pub approach: Vec<Approach, MAX_HITS, u8>,
    /// Whether its position takes part in the registration (spheres, circles
    /// and cones; other kinds have no position).
    #[serde(default = "yes")]
    pub datum: bool,
}

const fn yes() -> bool {
    true
}

/// The geometry fitted to a feature's hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum FeatureKind {
    /// Centre and radius.
    Sphere,
    /// Point, normal.
    Plane,
    /// Point, direction.
    Line,
    /// Circle in space: plane first, then the circle in it.
    Circle,
    /// Axis and radius.
    Cylinder,
    /// Apex, axis and half angle.
    Cone,
}

impl FeatureKind {
    /// Whether the fit gives one point that can serve as a datum position.
    #[must_use]
    pub const fn has_position(self) -> bool {
        matches!(self, Self::Sphere | Self::Circle | Self::Cone)
    }

    /// Whether the fit gives a radius.
    #[must_use]
    pub const fn has_radius(self) -> bool {
        matches!(self, Self::Sphere | Self::Circle | Self::Cylinder)
    }

    /// Hits that the fit needs at least.
    #[must_use]
    pub const fn min_hits(self) -> u16 {
        match self {
            Self::Line => 2,
            Self::Plane | Self::Circle => 3,
            Self::Sphere => 4,
            Self::Cylinder => 5,
            Self::Cone => 6,
        }
    }
}

/// Direction of motion when the probe touched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum Approach {
    /// Moving towards larger X.
    #[serde(rename = "+x")]
    PlusX,
    /// Moving towards smaller X.
    #[serde(rename = "-x")]
    MinusX,
    /// Moving towards larger Y.
    #[serde(rename = "+y")]
    PlusY,
    /// Moving towards smaller Y.
    #[serde(rename = "-y")]
    MinusY,
    /// Moving towards larger Z.
    #[serde(rename = "+z")]
    PlusZ,
    /// Moving towards smaller Z.
    #[serde(rename = "-z")]
    MinusZ,
}

impl Approach {
    /// The axis (0 X, 1 Y, 2 Z) and the sign of the motion.
    #[must_use]
    pub const fn axis_and_sign(self) -> (usize, f64) {
        match self {
            Self::PlusX => (0, 1.0),
            Self::MinusX => (0, -1.0),
            Self::PlusY => (1, 1.0),
            Self::MinusY => (1, -1.0),
            Self::PlusZ => (2, 1.0),
            Self::MinusZ => (2, -1.0),
        }
    }
}

/// Who turns a skip position into a contact point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum Compensation {
    /// The macro has added tip radius and pretravel: the lines hold contact points.
    InMacro,
    /// The lines hold skip positions of the tip centre; the board adds
    /// `tip radius - pretravel` along the approach.
    OnBoard {
        /// Radius of the stylus tip.
        tip_radius_mm: f64,
        /// Pretravel along X, Y and Z (ISO 230-10: the travel between contact
        /// and the trigger), not negative.
        pretravel_mm: [f64; 3],
    },
}
