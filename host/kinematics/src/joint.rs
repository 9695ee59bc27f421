//! One axis of a machine.

use nalgebra::Vector3;

use crate::Pose;

/// The encoder inputs of a board, as its table of latches names them (`x_counts`, …).
pub const COLUMNS: [&str; 6] = ["x", "y", "z", "w", "axis5", "axis6"];

/// An axis as a line in space, all joints at 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Its name in the machine file.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Unit vector in the machine's frame.
    pub direction: Vector3<f64>,
    /// A point of a rotary axis; nothing to a linear one.
    pub point_mm: Vector3<f64>,
    /// Where its value comes from.
    pub drive: Drive,
}

/// How an axis moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Along its direction, in millimetres.
    Linear,
    /// Right-handed about its axis, in degrees.
    Rotary,
}

/// Where the value of a joint comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Drive {
    /// An encoder at the board: `value = (counts - origin_counts) / counts_per_unit`.
    Encoder {
        /// The board's input, one of [`COLUMNS`].
        column: &'static str,
        /// Counts a millimetre or a degree; negative where counts fall as the value rises.
        counts_per_unit: f64,
        /// What the counter shows at value 0.
        origin_counts: f64,
    },
    /// A value that never changes, as the position of an indexing head, in mm or degrees.
    Constant(f64),
    /// Only positions that carry the joint's name.
    Named,
}

impl Joint {
    /// What the joint does to everything behind it in its chain.
    #[must_use]
    pub fn transform(&self, value: f64) -> Pose {
        match self.kind {
            JointKind::Linear => Pose::shift_mm(self.direction * value),
            JointKind::Rotary => Pose::turn(&self.direction, &self.point_mm, value.to_radians()),
        }
    }

    /// The joint's value where its counter shows `counts`; none for a joint without encoder.
    #[must_use]
    pub fn value(&self, counts: f64) -> Option<f64> {
        match self.drive {
            Drive::Encoder {
                counts_per_unit,
                origin_counts,
                ..
            } => Some((counts - origin_counts) / counts_per_unit),
            Drive::Constant(_) | Drive::Named => None,
        }
    }

    /// Its value, if that never changes.
    #[must_use]
    pub const fn constant(&self) -> Option<f64> {
        match self.drive {
            Drive::Constant(value) => Some(value),
            Drive::Encoder { .. } | Drive::Named => None,
        }
    }
}
