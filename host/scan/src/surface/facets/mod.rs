//! The triangles as the nearest one is sought.

mod boxes;
mod facet;
mod seams;

use std::sync::OnceLock;

use super::bvh::Tree;
use super::triangle::Triangle;
use crate::rigid::Vec3;
use boxes::Boxes;
pub(super) use facet::Facet;
use seams::Seams;

/// The triangles as the nearest one is sought.
#[derive(Clone, Debug)]
pub(super) struct Facets {
    pub boxes: Boxes,
    /// Those of a leaf side by side.
    pub all: Vec<Facet>,
    /// The place there of each triangle.
    pub places: Vec<u32>,
    /// Found when the first point asks, since not every mesh is asked.
    seams: OnceLock<Seams>,
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
            seams: OnceLock::new(),
        }
    }

    /// The way out of the surface on the border of a triangle, where the point nearest to `q` lies; none where the surface
    /// is not closed there.
    pub fn outward_at_border(&self, triangles: &[Triangle], face: u32, q: &Vec3) -> Option<Vec3> {
        let place = *self.places.get(face as usize)?;
        let border = self.all.get(place as usize)?.border(q);
        let seams = self.seams.get_or_init(|| Seams::new(triangles));
        seams.outward(face as usize, border)
    }
}
