//! A tree of boxes around triangles.

use super::triangle::{Triangle, bounds};
use crate::rigid::Vec3;

/// Triangles in a leaf at most.
const LEAF: usize = 4;

/// A box with what is in it: two more boxes, or a few triangles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    pub low: Vec3,
    pub high: Vec3,
    /// Leaf: the first place in [`Tree::order`]. Else: the second child; the first one follows its parent.
    pub start: u32,
    /// Triangles in the leaf; 0 for an inner node.
    pub count: u32,
}

/// The tree, parents before children.
#[derive(Clone, Debug)]
pub(super) struct Tree {
    pub nodes: Vec<Node>,
    /// Triangles by number, those of a leaf side by side.
    pub order: Vec<u32>,
}

impl Tree {
    /// Split at the median of the longest side: as deep as the logarithm of the count, whatever the shape.
    pub fn new(triangles: &[Triangle]) -> Self {
        let centres: Vec<Vec3> = triangles
            .iter()
            .map(|t| (t.corners[0] + t.corners[1] + t.corners[2]) / 3.0)
            .collect();
        let mut tree = Self {
            nodes: Vec::with_capacity(triangles.len()),
            order: (0..u32::try_from(triangles.len()).unwrap_or(u32::MAX)).collect(),
        };
        let all = tree.order.len();
        tree.split(triangles, &centres, 0, all);
        tree
    }

    fn split(&mut self, triangles: &[Triangle], centres: &[Vec3], from: usize, to: usize) {
        let here = &self.order[from..to];
        let (low, high) = bounds(
            here.iter()
                .flat_map(|&k| triangles[k as usize].corners.iter()),
        );
        let at = self.nodes.len();
        // Counts fit: `order` was made of u32.
        self.nodes.push(Node {
            low,
            high,
            start: from as u32,
            count: (to - from) as u32,
        });
        if to - from <= LEAF {
            return;
        }
        let (first, last) = bounds(here.iter().map(|&k| &centres[k as usize]));
        let axis = (last - first).imax();
        let middle = from + (to - from) / 2;
        self.order[from..to].select_nth_unstable_by(middle - from, |&a, &b| {
            centres[a as usize][axis]
                .total_cmp(&centres[b as usize][axis])
                .then(a.cmp(&b))
        });
        self.split(triangles, centres, from, middle);
        let second = self.nodes.len();
        self.split(triangles, centres, middle, to);
        self.nodes[at].start = second as u32;
        self.nodes[at].count = 0;
    }
}
