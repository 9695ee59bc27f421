//! Clouds from files.
//!
//! * [`CloudReader`]: point by point, with what the file says of each.
//! * [`read_cloud`]: all points at once, of every format that is known.

mod las;
mod pcd;
mod ply;
mod points;
mod table;
#[cfg(test)]
mod tests;
mod whole;

pub use points::CloudReader;
pub use whole::{cloud_from_bytes, read_cloud};
