//! The flat sides of a body, and whether those that a scan shows meet at their edges.
//!
//! Who sees two sides sees them up to the edge between them. Where a side lies by the other face of a wall instead, its
//! neighbour has no points beside the edge, as far as the wall is thick.

use super::super::own::{Own, is_apart, sharp};
use crate::rigid::Vec3;
use crate::surface::Mesh;

/// The flat sides of a mesh.
pub(in super::super) struct Sides {
    /// The side of each triangle.
    of: Vec<usize>,
    area_mm2: Vec<f64>,
    /// Two sides, and the edges that they share.
    meeting: Vec<([usize; 2], Vec<[Vec3; 2]>)>,
}

/// Whether two sides meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in super::super) enum Meeting {
    /// Both have points up to their edge.
    Closed,
    /// One has none there, and would have some.
    Gaping,
    /// Too few points are seen to say.
    Unsure,
}

/// Points that a side needs, and a strip beside an edge if it is to be closed.
const SEEN: usize = 6;
const CLOSES: usize = 3;
/// Points that a strip is made wide enough for, up to this share of the body's size.
const WANTED: f64 = 10.0;
const WIDEST: f64 = 0.12;
/// Beside a closed edge a side is as dense as elsewhere, or this share of it.
const DENSE: f64 = 0.4;
/// Fewer points than expected are no chance from so many standard deviations on.
const SURELY: f64 = 3.0;
/// More sides than that are facets of something round: nothing is said of them.
const MOST: usize = 64;

impl Meeting {
    /// Of all: none but closed ones are closed.
    pub fn of_all(all: impl Iterator<Item = Self>) -> Self {
        let worse = |a: Option<Self>, b| match (a, b) {
            (Some(Self::Gaping), _) | (_, Self::Gaping) => Some(Self::Gaping),
            (Some(Self::Unsure), _) | (_, Self::Unsure) => Some(Self::Unsure),
            _ => Some(Self::Closed),
        };
        all.fold(None, worse).unwrap_or(Self::Unsure)
    }
}

impl Sides {
    pub fn new(mesh: &Mesh) -> Self {
        let mut planes: Vec<(Vec3, f64)> = Vec::new();
        let mut sides = Self {
            of: Vec::new(),
            area_mm2: Vec::new(),
            meeting: Vec::new(),
        };
        let flat = 1e-4 * mesh.diagonal_mm();
        for t in mesh.triangles() {
            let off = t.normal.dot(&t.corners[0]);
            let like = |(normal, at): &(Vec3, f64)| {
                normal.dot(&t.normal) > 0.9999 && (at - off).abs() < flat
            };
            let side = planes.iter().position(like).unwrap_or(planes.len());
            if side == planes.len() {
                if side == MOST {
                    sides.meeting.clear();
                    return sides;
                }
                planes.push((t.normal, off));
                sides.area_mm2.push(0.0);
            }
            sides.of.push(side);
            sides.area_mm2[side] += t.area_mm2;
        }
        for (edge, triangles) in sharp(mesh) {
            let mut pair = [sides.of[triangles[0]], sides.of[triangles[1]]];
            pair.sort_unstable();
            match sides.meeting.iter_mut().find(|(p, _)| *p == pair) {
                Some((_, edges)) => edges.push(edge),
                None => sides.meeting.push((pair, vec![edge])),
            }
        }
        sides
    }

    /// The side that a triangle is of.
    pub fn of(&self, triangle: usize) -> Option<usize> {
        self.of.get(triangle).copied()
    }

    pub fn count(&self) -> usize {
        self.area_mm2.len()
    }

    /// How the sides that the points show meet. The points stay `margin` mm from edges; `size`: of the body, in mm.
    pub fn meet(&self, own: &Own, margin: f64, size: f64) -> Vec<([usize; 2], Meeting)> {
        let mut feet: Vec<Vec<Vec3>> = vec![Vec::new(); self.count()];
        for (q, m) in &own.on {
            if let Some(side) = self.of(m.face) {
                feet[side].push(own.motion.undo(&(q - m.direction * m.distance_mm)));
            }
        }
        let seen = |pair: &[usize; 2]| pair.iter().all(|&s| feet[s].len() >= SEEN);
        (self.meeting.iter().filter(|(pair, _)| seen(pair)))
            .map(|(pair, edges)| {
                let length: f64 = edges.iter().map(|[a, b]| (b - a).norm()).sum();
                let length = (length - 2.0 * margin).max(0.0);
                let strips = pair.map(|s| {
                    let a_mm = feet[s].len() as f64 / self.area_mm2[s] * length;
                    let width = (WANTED / a_mm).clamp(margin, WIDEST * size);
                    let is_beside = |foot: &&Vec3| !is_apart(foot, edges, margin + width);
                    let count = feet[s].iter().filter(is_beside).count();
                    strip(count, a_mm * width)
                });
                (*pair, Meeting::of_all(strips.into_iter()))
            })
            .collect()
    }
}

/// A strip of one side with so many points.
fn strip(count: usize, expected: f64) -> Meeting {
    let seen = count as f64;
    if count >= CLOSES && seen > DENSE * expected {
        Meeting::Closed
    } else if seen < DENSE * expected && expected - seen > SURELY * expected.sqrt() {
        Meeting::Gaping
    } else {
        Meeting::Unsure
    }
}
