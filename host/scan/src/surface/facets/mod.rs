//! The triangles as the nearest one is sought.

mod boxes;
mod facet;

use super::bvh::Tree;
use super::triangle::Triangle;
use boxes::Boxes;
pub(super) use facet::Facet;

/// The triangles as the nearest one is sought.
#[derive(Clone, Debug)]
pub(super) struct Facets {
    pub boxes: Boxes,
    /// Those of a leaf side by side.
    pub all: Vec<Facet>,
    /// The place there of each triangle.
    pub places: Vec<u32>,
}

impl Facets {
    pub fn new(triangles: &[Triangle], tree: &Tree) -> Self {
        let mut places = vec![0; triangles.len()];
        let all = tree.order.iter().enumerate().map(|(place, &face)| {
            places[face as usize] = place as u32;
            Facet::new(&triangles[face as usize], face)
        });
        Self {
            all: all.collect(),
            places,
            boxes: Boxes::new(tree),
        }
    }
}
