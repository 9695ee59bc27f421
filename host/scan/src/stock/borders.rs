//! Borders between faces of unlike demands. A point that crosses one demands more at once, which no slope foretells: a
//! programme is told of the border, and its solution slides along it.

use super::place::{Place, Search};
use crate::rigid::{Pose, Vec3};
use crate::solve::linear::MarginRow;
use crate::surface::Mesh;

/// How much more a border counts than a margin: a row of a programme may give way by the gain of a step.
const STIFF: f64 = 10.0;
/// Points stay this far from a border, in mm.
const APART_MM: f64 = 1e-7;
/// Borders that are remembered at most.
const MOST: usize = 120;

/// A point that is to stay where the plane of one face decides, and not that of another.
#[derive(Clone, Copy, PartialEq)]
struct Border {
    point: usize,
    from: usize,
    to: usize,
}

/// The borders that steps have run into.
#[derive(Default)]
pub(super) struct Borders(Vec<Border>);

impl Borders {
    /// Remembers what the step from `here` to `there` has run into. No: there was nothing new.
    pub fn learn(&mut self, search: &Search<'_>, here: &Place, there: &Place) -> bool {
        let known = self.0.len();
        for (point, (a, b)) in here.measured.iter().zip(&there.measured).enumerate() {
            let (old, new) = (search.rules[a.face], search.rules[b.face]);
            if old == new || new.margin(b.distance_mm) > here.least + 1e-12 {
                continue;
            }
            let border = Border {
                point,
                from: a.face,
                to: b.face,
            };
            let blocks = old.margin(b.distance_mm) > new.margin(b.distance_mm);
            let Some(mesh) = &search.surface.mesh else {
                continue;
            };
            let q = &search.points[point];
            let crossed =
                border.side(mesh, q, &here.motion) * border.side(mesh, q, &there.motion) < 0.0;
            if blocks && crossed && self.0.len() < MOST && !self.0.contains(&border) {
                self.0.push(border);
            }
        }
        self.0.len() > known
    }

    /// Rows that hold the points on their side.
    pub fn rows(&self, search: &Search<'_>, here: &Place, arm: f64) -> Vec<MarginRow> {
        let Some(mesh) = &search.surface.mesh else {
            return Vec::new();
        };
        self.0
            .iter()
            .filter(|border| here.measured[border.point].face == border.from)
            .map(|border| {
                let q = &search.points[border.point];
                let side = border.side(mesh, q, &here.motion);
                let sign = STIFF * if side < 0.0 { -1.0 } else { 1.0 };
                let slopes = |face: usize| {
                    let height = height(mesh, face, q, &here.motion);
                    let normal = here.motion.rotation * mesh.triangles()[face].normal;
                    let outward = if height < 0.0 { 1.0 } else { -1.0 };
                    search
                        .slopes(here, q, &normal, arm)
                        .map(|slope| sign * outward * slope)
                };
                let (from, to) = (slopes(border.from), slopes(border.to));
                MarginRow {
                    value: here.least + STIFF * (side.abs() - APART_MM),
                    gradient: std::array::from_fn(|i| from[i] - to[i]),
                }
            })
            .collect()
    }
}

impl Border {
    /// Where the point lies: the border is where this changes its sign, in mm. At a convex edge outside the farther plane
    /// decides, at others the nearer.
    fn side(&self, mesh: &Mesh, q: &Vec3, motion: &Pose) -> f64 {
        height(mesh, self.from, q, motion).abs() - height(mesh, self.to, q, motion).abs()
    }
}

/// How high a point stands over the plane of a face, in mm.
fn height(mesh: &Mesh, face: usize, q: &Vec3, motion: &Pose) -> f64 {
    let t = &mesh.triangles()[face];
    t.normal.dot(&(motion.undo(q) - t.corners[0]))
}
