//! The shapes that are fitted, a file each: what it is, its fit, its refusals.

pub mod circle;
pub mod circle2d;
pub mod cone;
pub mod cylinder;
pub mod line;
pub mod plane;
pub mod sphere;
