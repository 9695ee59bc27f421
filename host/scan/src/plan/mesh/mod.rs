//! The part as triangles that know their neighbours.
//!
//! * [`read`]: STL, OBJ, PLY by the file's extension.
//! * [`weld`]: vertices at one place become one; edges, borders, components; what is no oriented surface is refused.

mod obj;
mod ply;
mod polygon;
pub mod read;
mod step;
mod unreadable;
pub mod weld;

pub use read::{part_from_bytes, read_part};
pub use weld::PartMesh;

use nalgebra::Vector3;

/// Corners of triangles as a file lists them, before anything is checked.
#[derive(Debug, Clone, Default)]
pub(crate) struct RawMesh {
    pub vertices: Vec<Vector3<f64>>,
    pub faces: Vec<[usize; 3]>,
}
