//! A control's NC interpreter.

mod motion;

pub use motion::{Axes, Motion, Path, Rate, Skip, Trip};
