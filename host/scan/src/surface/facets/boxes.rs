//! The tree of boxes as the nearest triangle is sought: four boxes side by side, in single precision.
//!
//! Half as many steps down as by twos, and four distances at the cost of one. Single precision never says too much: the
//! point is taken as a small box that holds all that rounding can have moved.

use super::super::bvh::Tree;
use crate::rigid::Vec3;

/// What rounding can move: four times the last place of single precision, of the largest number that comes in.
const SLACK: f64 = 1.0 / (1 << 22) as f64;
/// Squares of larger numbers do not fit in single precision.
const LARGE: f64 = 1e15;
/// A sum of squares is rounded up by less than this share.
const LESS: f64 = 1.0 - 1e-6;

/// Up to four boxes with what is in them.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Quad {
    /// By axis, then by box.
    low: [[f32; 4]; 3],
    high: [[f32; 4]; 3],
    within: [Within; 4],
    used: u8,
}

/// What is in a box.
#[derive(Clone, Copy, Debug, Default)]
struct Within {
    /// Leaf: its first triangle, in the tree's order. Else: the quad.
    start: u32,
    /// Triangles in the leaf; 0 for a quad.
    count: u32,
}

/// The boxes, about the middle of the whole.
#[derive(Clone, Debug)]
pub(in crate::surface) struct Boxes {
    quads: Vec<Quad>,
    middle: Vec3,
    /// The largest coordinate from there, in mm.
    extent: f64,
}

/// A point about the middle, as a box that holds it.
struct Rounded {
    low: [f32; 3],
    high: [f32; 3],
}

/// Boxes that can wait: three at each of the 15 levels by fours of 2³² triangles, and the last four.
const DEPTH: usize = 3 * 15 + 4;

impl Boxes {
    pub fn new(tree: &Tree) -> Self {
        let root = &tree.nodes[0];
        let middle = (root.low + root.high) / 2.0;
        let mut boxes = Self {
            quads: Vec::with_capacity(tree.nodes.len() / 3 + 1),
            middle,
            extent: (root.high - middle).amax(),
        };
        boxes.gather(tree, 0);
        boxes
    }

    /// The quad of what is in a node, with all below it.
    fn gather(&mut self, tree: &Tree, node: usize) -> u32 {
        let halves = |node: usize| match tree.nodes[node] {
            inner if inner.count == 0 => vec![node + 1, inner.start as usize],
            _ => vec![node],
        };
        let fourths: Vec<usize> = halves(node).into_iter().flat_map(halves).collect();
        let at = self.quads.len();
        self.quads.push(Quad {
            low: [[f32::INFINITY; 4]; 3],
            high: [[f32::NEG_INFINITY; 4]; 3],
            within: [Within::default(); 4],
            used: fourths.len() as u8,
        });
        for (k, &child) in fourths.iter().enumerate() {
            let node = &tree.nodes[child];
            for i in 0..3 {
                self.quads[at].low[i][k] = (node.low[i] - self.middle[i]) as f32;
                self.quads[at].high[i][k] = (node.high[i] - self.middle[i]) as f32;
            }
            self.quads[at].within[k] = if node.count > 0 {
                Within {
                    start: node.start,
                    count: node.count,
                }
            } else {
                Within {
                    start: self.gather(tree, child),
                    count: 0,
                }
            };
        }
        at as u32
    }

    /// Calls `leaf` with the places of the triangles in each leaf that may be nearer than the root of `limit`, the nearest
    /// boxes first; it answers how near they must be from then on, squared.
    #[inline]
    pub fn nearest(
        &self,
        q: &Vec3,
        mut limit: f64,
        mut leaf: impl FnMut(std::ops::Range<usize>) -> f64,
    ) {
        let q = self.rounded(q);
        // The square of the distance, and the box: its quad times four, and its place there.
        let mut stack = [(0.0_f32, 0_u32); DEPTH];
        let mut height = 0;
        let mut next = 0;
        loop {
            let quad = &self.quads[next];
            let all = quad.squared(&q);
            let base = height;
            for (k, squared) in all.into_iter().enumerate().take(usize::from(quad.used)) {
                if f64::from(squared) * LESS > limit {
                    continue;
                }
                // The nearest on top.
                let mut place = height;
                while place > base && stack[place - 1].0 < squared {
                    stack[place] = stack[place - 1];
                    place -= 1;
                }
                stack[place] = (squared, (next * 4 + k) as u32);
                height += 1;
            }
            next = loop {
                if height == 0 {
                    return;
                }
                height -= 1;
                let (squared, at) = stack[height];
                if f64::from(squared) * LESS > limit {
                    continue;
                }
                let within = &self.quads[at as usize / 4].within[at as usize % 4];
                let start = within.start as usize;
                if within.count == 0 {
                    break start;
                }
                limit = leaf(start..start + within.count as usize);
            };
        }
    }

    fn rounded(&self, q: &Vec3) -> Rounded {
        let q = q - self.middle;
        let size = q.amax() + self.extent;
        let slack = if size < LARGE {
            (size * SLACK) as f32
        } else {
            f32::INFINITY
        };
        Rounded {
            low: std::array::from_fn(|i| q[i] as f32 - slack),
            high: std::array::from_fn(|i| q[i] as f32 + slack),
        }
    }
}

impl Quad {
    /// The squares of the distances to the boxes.
    #[inline]
    fn squared(&self, q: &Rounded) -> [f32; 4] {
        let larger = |a: f32, b: f32| if a > b { a } else { b };
        let mut sum = [0.0; 4];
        for i in 0..3 {
            for (k, sum) in sum.iter_mut().enumerate() {
                let (below, above) = (self.low[i][k] - q.high[i], q.low[i] - self.high[i][k]);
                let off = larger(larger(below, above), 0.0);
                *sum += off * off;
            }
        }
        sum
    }
}
