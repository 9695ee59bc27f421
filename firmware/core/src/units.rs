//! Quantities with their unit in the type.
//!
//! Scalars that travel between rooms are newtypes; a position is [`Point`].
//! Inside one formula the bare `f64` is taken out once and the unit stays in
//! the variable's name.

use nalgebra::Vector3;

/// A length in millimetres.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Default)]
pub struct Mm(pub f64);

/// An angle in radians.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Default)]
pub struct Rad(pub f64);

impl Rad {
    /// The same angle in degrees.
    #[must_use]
    pub fn to_degrees(self) -> f64 {
        self.0 * (180.0 / core::f64::consts::PI)
    }

    /// An angle given in degrees.
    #[must_use]
    pub fn from_degrees(degrees: f64) -> Self {
        Self(degrees * (core::f64::consts::PI / 180.0))
    }
}

/// A moment on the board's monotonic clock, microseconds since it started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Micros(pub u64);

/// A position along an axis, in counts of its encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Counts(pub i64);

/// An instant on the clock that captures, in its cycles since it was started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Cycles(pub u64);

impl Cycles {
    /// So many cycles later; the last instant there is at most.
    #[must_use]
    pub const fn after(self, cycles: u64) -> Self {
        Self(self.0.saturating_add(cycles))
    }

    /// So many cycles before; the start at least.
    #[must_use]
    pub const fn before(self, cycles: u64) -> Self {
        Self(self.0.saturating_sub(cycles))
    }
}

/// A position in space, millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// The coordinates x, y, z in millimetres.
    pub mm: Vector3<f64>,
}

impl Point {
    /// A position from its coordinates in millimetres.
    #[must_use]
    pub const fn from_mm(x: f64, y: f64, z: f64) -> Self {
        Self {
            mm: Vector3::new(x, y, z),
        }
    }

    /// A position from an array x, y, z in millimetres.
    #[must_use]
    pub const fn from_array_mm(mm: [f64; 3]) -> Self {
        Self::from_mm(mm[0], mm[1], mm[2])
    }

    /// The coordinates x, y, z in millimetres.
    #[must_use]
    pub fn to_array_mm(self) -> [f64; 3] {
        [self.mm.x, self.mm.y, self.mm.z]
    }

    /// True if no coordinate is NaN or infinite.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.mm.iter().all(|c| c.is_finite())
    }
}
