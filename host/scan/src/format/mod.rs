//! Files in and out.
//!
//! * [`table`]: CSV with named columns, row by row.
//! * [`machine`]: the machine file.
//! * [`clouds`]: clouds point by point, in and out, by the extension of the file.
//! * `ply`: what clouds and meshes share of PLY files.
//! * [`points`]: merged points out, by the extension of the file; [`poses`]: where the sensor was.
//! * [`profiles`]: what the sensor tells; [`triggers`]: what the board tells.

pub mod clouds;
pub mod machine;
mod partial;
pub(crate) mod ply;
pub mod points;
pub mod poses;
pub mod profiles;
pub mod table;
pub mod triggers;

pub use partial::remove_unfinished;
