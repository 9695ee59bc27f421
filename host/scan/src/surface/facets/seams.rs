//! Which way is out where triangles meet: at their corners and along their sides.
//!
//! # Design
//! Of the triangles that meet at a corner no single one tells the side that a point is on, if the corner is sharp: the plane
//! of the one that looks most at the point may pass behind it. The sum of their normals, each by its angle there, does
//! (J. A. Bærentzen, H. Aanæs, *Signed distance computation using the angle weighted pseudonormal*, 2005), and along a side
//! the plain sum of both. The proof needs only that the triangles bound a body around the place: all sides there must be run
//! along in either direction as often. Where they are not there is no answer.

use std::collections::HashMap;

use super::facet::Border;
use crate::rigid::Vec3;
use crate::surface::triangle::Triangle;

/// The ways out, by triangle.
#[derive(Clone, Debug)]
pub(super) struct Seams {
    /// Of each triangle the numbers of its corners (a, b, c) and of its sides (ab, ac, bc).
    of: Vec<[u32; 6]>,
    /// Not of length 1; zero where the surface is open, or at odds.
    corners: Vec<Vec3>,
    sides: Vec<Vec3>,
}

/// A side of a triangle: the numbers of its ends, the lesser first; whose it is, and whether it runs upwards.
struct Run {
    ends: (u32, u32),
    triangle: usize,
    side: usize,
    upwards: bool,
}

impl Seams {
    pub fn new(triangles: &[Triangle]) -> Self {
        let mut numbers = HashMap::new();
        let mut of = vec![[0; 6]; triangles.len()];
        let mut corners: Vec<Vec3> = Vec::new();
        let mut runs: Vec<Run> = Vec::with_capacity(3 * triangles.len());
        for (place, t) in triangles.iter().enumerate() {
            for (k, corner) in t.corners.iter().enumerate() {
                let key = corner.map(|x| (x + 0.0).to_bits());
                let number = *numbers.entry([key.x, key.y, key.z]).or_insert_with(|| {
                    corners.push(Vec3::zeros());
                    corners.len() as u32 - 1
                });
                of[place][k] = number;
                corners[number as usize] += t.normal * angle(t, k);
            }
            for (side, [begin, end]) in [[0, 1], [2, 0], [1, 2]].into_iter().enumerate() {
                let (begin, end) = (of[place][begin], of[place][end]);
                runs.push(Run {
                    ends: (begin.min(end), begin.max(end)),
                    triangle: place,
                    side,
                    upwards: begin < end,
                });
            }
        }
        runs.sort_unstable_by_key(|run| run.ends);
        let mut sides = Vec::with_capacity(runs.len() / 2);
        let mut at_odds = Vec::new();
        for same in runs.chunk_by(|a, b| a.ends == b.ends) {
            let upwards = same.iter().filter(|run| run.upwards).count();
            let mut sum = Vec3::zeros();
            for run in same {
                of[run.triangle][3 + run.side] = sides.len() as u32;
                sum += triangles[run.triangle].normal;
            }
            if 2 * upwards != same.len() {
                at_odds.push(same[0].ends);
                sum = Vec3::zeros();
            }
            sides.push(sum);
        }
        for (begin, end) in at_odds {
            corners[begin as usize] = Vec3::zeros();
            corners[end as usize] = Vec3::zeros();
        }
        Self { of, corners, sides }
    }

    /// The way out at a part of a triangle's border, of any length; none where nothing tells.
    pub fn outward(&self, triangle: usize, border: Border) -> Option<Vec3> {
        let of = self.of.get(triangle)?;
        let way = match border {
            Border::Corner(k) => self.corners.get(of[k] as usize)?,
            Border::Side(k) => self.sides.get(of[3 + k] as usize)?,
        };
        (way.norm_squared() > 0.0).then_some(*way)
    }
}

/// The angle of a triangle at one of its corners.
fn angle(t: &Triangle, k: usize) -> f64 {
    let at = t.corners[k];
    let (one, other) = (t.corners[(k + 1) % 3] - at, t.corners[(k + 2) % 3] - at);
    one.cross(&other).norm().atan2(one.dot(&other))
}
