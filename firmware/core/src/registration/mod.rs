//! Rigid registration: the rotation and translation that carry one list of
//! points onto another (MCS←CAD), and what is known about its error.

pub mod distances;
pub mod rigid;
#[cfg(test)]
mod tests;
pub mod transform;

pub use distances::{Distance, distances};
pub use rigid::{Registration, register};
pub use transform::RigidTransform;
