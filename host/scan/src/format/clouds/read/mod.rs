//! Clouds from files.
//!
//! * [`CloudReader`]: point by point, with what the file says of each.
//! * [`read_cloud`]: all points at once, of every format that is known.
//! * [`read_bounded`]: all points at once, thinned where they are too many for the memory.

mod bounded;
#[cfg(feature = "cloud-formats")]
mod e57;
#[cfg(feature = "cloud-formats")]
mod foreign;
mod las;
#[cfg(feature = "cloud-formats")]
mod laz;
mod pcd;
mod ply;
mod points;
mod table;
#[cfg(test)]
mod tests;
mod whole;

pub use bounded::{BoundedCloud, read_bounded};
pub use points::CloudReader;
pub use whole::{cloud_from_bytes, read_cloud};
