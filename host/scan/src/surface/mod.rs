//! The nominal: triangles, balls and cones, with exact signed distances.

mod bvh;
mod facets;
mod flaws;
mod mesh;
mod nearest;
mod outward;
mod ray;
mod shapes;
mod stl;
#[cfg(test)]
mod tests;
mod triangle;

pub use mesh::Mesh;
pub(crate) use mesh::box_corners;
pub use nearest::Near;
pub(crate) use outward::outward;
pub use ray::{RayHit, StandingBox};
pub use shapes::{BallShape, CompositeSurface, Cone};
pub(crate) use stl::{begins_as_text, is_stl};
pub use stl::{read_stl, stl_from_bytes};
pub(crate) use stl::{stl_triangles, whole_file};
pub use triangle::Triangle;
pub(crate) use triangle::bounds;
