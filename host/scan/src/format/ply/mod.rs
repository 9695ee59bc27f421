//! PLY (Turk, The PLY Polygon File Format, 1994): what clouds and meshes share of it.
//!
//! * `scalar`: the numbers of a file, text or bytes of either order.
//! * `header`: what a file says that it holds.
//! * `points`: its vertices, one after the other.
//! * `begin`: the header of a file that is written.

mod begin;
mod header;
mod points;
mod scalar;

pub(crate) use begin::begin;
pub(crate) use header::Header;
pub(crate) use points::PlyReader;
pub(crate) use scalar::{Encoding, Scalar};
