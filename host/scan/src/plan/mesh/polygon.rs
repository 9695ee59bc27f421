//! Polygons of more than three corners become triangles, whatever corner they begin at.

use std::collections::{HashMap, VecDeque};

use nalgebra::Vector3;
use spade::handles::FixedDirectedEdgeHandle;
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation, mitigate_underflow};

use super::RawMesh;
use super::unreadable::unreadable;
use crate::ScanError;

/// Area below this share of its extent's square is rounding: what lies straight has none.
const NO_AREA: f64 = 1e-9;

/// The polygons of a mesh that is being read. Its vertices may follow later.
#[derive(Debug, Default)]
pub(super) struct Polygons(Vec<Vec<usize>>);

impl Polygons {
    /// Takes a face; a triangle is one already.
    pub fn add(&mut self, raw: &mut RawMesh, corners: Vec<usize>) {
        match <[usize; 3]>::try_from(corners) {
            Ok(triangle) => raw.faces.push(triangle),
            Err(corners) => self.0.push(corners),
        }
    }

    /// Cuts the polygons into triangles, once all vertices are read.
    ///
    /// # Errors
    /// `mesh_unreadable`: a face names a vertex that is not there, its sides cross, or its corners lie so far from a
    /// plane that its triangles would lie over each other.
    pub fn cut(self, raw: &mut RawMesh) -> Result<(), ScanError> {
        let named = || raw.faces.iter().flatten().chain(self.0.iter().flatten());
        if named().any(|&i| i >= raw.vertices.len()) {
            return Err(unreadable("a face names a vertex that is not there"));
        }
        for corners in &self.0 {
            let places: Vec<Vector3<f64>> = corners.iter().map(|&i| raw.vertices[i]).collect();
            let triangles = triangles(&places).ok_or_else(|| {
                unreadable(
                    "a face of more than three corners has sides that cross, or corners far from a plane: cut \
                     such faces into triangles",
                )
            })?;
            let faces = triangles.into_iter().map(|t| t.map(|k| corners[k]));
            raw.faces.extend(faces);
        }
        Ok(())
    }
}

fn doubled_area([a, b, c]: [Vector3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

/// Triangles of a polygon, as places in the list of its corners; none where its sides cross or no plane is near.
fn triangles(corners: &[Vector3<f64>]) -> Option<Vec<[usize; 3]>> {
    let fan: Vec<[usize; 3]> = (2..corners.len()).map(|k| [0, k - 1, k]).collect();
    let area = |t: &[usize; 3]| doubled_area(t.map(|k| corners[k]));
    let whole: Vector3<f64> = fan.iter().map(area).sum();
    let all: f64 = fan.iter().map(|t| area(t).norm()).sum();
    let out = corners.iter().map(|c| (c - corners[0]).norm_squared());
    // What is no number is refused by its own name; what has no area is dropped, behind.
    if !all.is_finite() || all <= NO_AREA * out.fold(0.0, f64::max) {
        return Some(fan);
    }
    if whole.norm() <= NO_AREA * all {
        return None;
    }
    let upright = |t: &[usize; 3]| area(t).dot(&whole) >= -NO_AREA * whole.norm_squared();
    // Seen from the first corner, the sides of a fan that is its polygon go round by less than a turn.
    let angle = |t: &[usize; 3]| {
        let [a, b] = [corners[t[1]] - corners[0], corners[t[2]] - corners[0]];
        a.cross(&b).norm().atan2(a.dot(&b))
    };
    if fan.iter().all(upright)
        && fan.iter().map(angle).sum::<f64>() < std::f64::consts::TAU - NO_AREA
    {
        return Some(fan);
    }
    let found = inside(&seen_along(corners, &whole), corners)?;
    found.iter().all(upright).then_some(found)
}

/// The corners in a plane, counter-clockwise: the coordinate along which the polygon is seen widest is left out, so that
/// nothing is rounded.
fn seen_along(corners: &[Vector3<f64>], area: &Vector3<f64>) -> Vec<Point2<f64>> {
    let out = area.iamax();
    let (mut x, mut y) = ((out + 1) % 3, (out + 2) % 3);
    if area[out] < 0.0 {
        std::mem::swap(&mut x, &mut y);
    }
    let seen = |c: &Vector3<f64>| mitigate_underflow(Point2::new(c[x], c[y]));
    corners.iter().map(seen).collect()
}

/// Triangles of the region that the sides go round once; none where they cross, go round it clockwise or twice.
///
/// Sides may lie on each other where they run to and fro: so a polygon with a hole is written as one border.
fn inside(places: &[Point2<f64>], corners: &[Vector3<f64>]) -> Option<Vec<[usize; 3]>> {
    type Net = ConstrainedDelaunayTriangulation<Point2<f64>>;
    let mut net = Net::new();
    // Of each vertex of the net, the first corner there.
    let mut first: Vec<usize> = Vec::new();
    let mut handles = Vec::with_capacity(places.len());
    for (k, place) in places.iter().enumerate() {
        let handle = net.insert(*place).ok()?;
        if handle.index() == first.len() {
            first.push(k);
        }
        // Above each other: no plane has both.
        if corners[first[handle.index()]] != corners[k] {
            return None;
        }
        handles.push(handle);
    }
    let pairs = || (0..handles.len()).map(|k| (handles[k], handles[(k + 1) % handles.len()]));
    let sides = pairs().filter(|(from, to)| from != to);
    for (from, to) in sides.clone() {
        if net.try_add_constraint(from, to).is_empty() {
            return None;
        }
    }
    // Only now do the net's edges stay. A side on which other corners lie is several of them.
    let mut gone: HashMap<FixedDirectedEdgeHandle, i32> = HashMap::new();
    for (from, to) in sides {
        for edge in net.try_add_constraint(from, to) {
            *gone.entry(edge).or_insert(0) += 1;
            *gone.entry(edge.rev()).or_insert(0) -= 1;
        }
    }
    // How often the sides go round each face, from the outside in.
    let mut round: Vec<Option<i32>> = vec![None; net.num_all_faces()];
    let outer = net.outer_face().fix();
    round[outer.index()] = Some(0);
    let mut open: VecDeque<_> = net
        .convex_hull()
        .flat_map(|edge| [edge.fix(), edge.rev().fix()])
        .filter(|edge| net.directed_edge(*edge).face().fix() == outer)
        .collect();
    while let Some(edge) = open.pop_front() {
        let edge = net.directed_edge(edge);
        let here = round[edge.face().fix().index()]?;
        let beyond = edge.rev().face();
        // What lies to the left of a side is gone round once more than what lies to its right.
        let there = here - gone.get(&edge.fix()).copied().unwrap_or(0);
        let known = &mut round[beyond.fix().index()];
        if known.is_none() {
            *known = Some(there);
            if let Some(face) = beyond.as_inner() {
                open.extend(face.adjacent_edges().map(|e| e.fix()));
            }
        }
    }
    let mut found = Vec::new();
    for face in net.inner_faces() {
        match round[face.fix().index()]? {
            0 => {}
            1 => found.push(face.vertices().map(|v| first[v.fix().index()])),
            _ => return None,
        }
    }
    (!found.is_empty()).then_some(found)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{RawMesh, obj, ply};
    use super::*;

    fn obj_of(corners: &[[f64; 3]]) -> String {
        let line = |[x, y, z]: &[f64; 3]| format!("v {x} {y} {z}\n");
        let mut text: String = corners.iter().map(line).collect();
        text.push('f');
        for k in 1..=corners.len() {
            text.push_str(&format!(" {k}"));
        }
        text
    }

    fn ply_of(corners: &[[f64; 3]]) -> String {
        let mut text = format!(
            "ply\nformat ascii 1.0\nelement vertex {0}\nproperty double x\nproperty double y\nproperty double z\n\
             element face 1\nproperty list uchar int vertex_indices\nend_header\n",
            corners.len()
        );
        for [x, y, z] in corners {
            text.push_str(&format!("{x} {y} {z}\n"));
        }
        text.push_str(&corners.len().to_string());
        for k in 0..corners.len() {
            text.push_str(&format!(" {k}"));
        }
        text.push('\n');
        text
    }

    fn read(corners: &[[f64; 3]]) -> Result<RawMesh, ScanError> {
        let found = obj::read(obj_of(corners).as_bytes());
        let same = ply::read(ply_of(corners).as_bytes());
        assert_eq!(
            found.as_ref().map(|raw| &raw.faces).map_err(|e| e.code),
            same.as_ref().map(|raw| &raw.faces).map_err(|e| e.code)
        );
        found
    }

    /// The same corners, begun at each of them.
    fn begun_anywhere(corners: &[[f64; 3]]) -> impl Iterator<Item = Vec<[f64; 3]>> {
        (0..corners.len()).map(|k| [&corners[k..], &corners[..k]].concat())
    }

    /// As many triangles as a polygon has, all with their outer side on its own, and together its area.
    fn is_the_polygon(raw: &RawMesh, triangles: usize) {
        let area = |t: &[usize; 3]| doubled_area(t.map(|k| raw.vertices[k]));
        let corners: Vec<usize> = (0..raw.vertices.len()).collect();
        let whole: Vector3<f64> = corners[1..]
            .windows(2)
            .map(|p| area(&[0, p[0], p[1]]))
            .sum();
        assert_eq!(raw.faces.len(), triangles);
        assert!(raw.faces.iter().all(|t| area(t).dot(&whole) > 0.0));
        let all: f64 = raw.faces.iter().map(|t| area(t).norm()).sum();
        assert!((all / whole.norm() - 1.0).abs() < 1e-9);
    }

    const DART: [[f64; 3]; 4] = [
        [0.0, 0.0, 0.0],
        [10.0, 0.0, 0.0],
        [2.0, 2.0, 0.0],
        [0.0, 10.0, 0.0],
    ];

    #[test]
    fn a_polygon_is_read_whatever_corner_it_begins_at() {
        let comb: Vec<[f64; 3]> = [
            (0, 0),
            (9, 0),
            (9, 5),
            (8, 5),
            (8, 1),
            (6, 1),
            (6, 5),
            (5, 5),
            (5, 1),
            (3, 1),
            (3, 5),
            (0, 5),
        ]
        .map(|(x, y)| {
            [
                f64::from(x),
                f64::from(y),
                0.5 * f64::from(x) - f64::from(y),
            ]
        })
        .to_vec();
        for polygon in [DART.to_vec(), comb] {
            for corners in begun_anywhere(&polygon) {
                is_the_polygon(&read(&corners).unwrap(), corners.len() - 2);
                // From below, too.
                let turned: Vec<_> = corners.iter().rev().copied().collect();
                is_the_polygon(&read(&turned).unwrap(), corners.len() - 2);
            }
        }
        // A flat square, and one whose corners do not lie in a plane.
        for z in [0.0, 1.0] {
            let square = [
                [0.0, 0.0, 0.0],
                [10.0, 0.0, 0.0],
                [10.0, 10.0, z],
                [0.0, 10.0, 0.0],
            ];
            assert_eq!(read(&square).unwrap().faces.len(), 2);
        }
    }

    /// A plate with a hole, its border cut open between both.
    #[test]
    fn a_border_that_goes_to_a_hole_and_back_leaves_the_hole() {
        let ring = [
            (0, 0),
            (9, 0),
            (9, 9),
            (0, 9),
            (0, 0),
            (3, 3),
            (3, 6),
            (6, 6),
            (6, 3),
            (3, 3),
        ]
        .map(|(x, y)| [f64::from(x), f64::from(y), 0.0]);
        for corners in begun_anywhere(&ring) {
            is_the_polygon(&read(&corners).unwrap(), 8);
        }
    }

    #[test]
    fn sides_that_cross_and_corners_far_from_a_plane_are_refused() {
        let flat = |corners: &[(f64, f64)]| -> Vec<[f64; 3]> {
            corners.iter().map(|(x, y)| [*x, *y, 0.0]).collect()
        };
        let star = (0..5).map(|k| (f64::from(k) * 0.8 * std::f64::consts::PI).sin_cos());
        let twice = (0..12).map(|k| {
            let (s, c) = (f64::from(k) * std::f64::consts::FRAC_PI_3 + 0.1).sin_cos();
            (s * f64::from(k + 9), c * f64::from(k + 9))
        });
        for bad in [
            // Bows: with unequal loops, with equal ones, and with loops that touch in a corner.
            flat(&[(0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 5.0)]),
            flat(&[(0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 10.0)]),
            flat(&[
                (0.0, 0.0),
                (9.0, 0.0),
                (9.0, 9.0),
                (0.0, 0.0),
                (0.0, -5.0),
                (-5.0, -5.0),
                (-5.0, 0.0),
            ]),
            flat(&star.collect::<Vec<_>>()),
            // Twice round the first corner.
            flat(&std::iter::once((0.0, 0.0)).chain(twice).collect::<Vec<_>>()),
            // Three sides of a box, wound up.
            vec![
                [0.0, 0.0, 0.0],
                [4.0, 0.0, 0.0],
                [4.0, 4.0, 0.0],
                [4.0, 4.0, 9.0],
                [0.0, 4.0, 9.0],
                [2.0, 2.0, 9.0],
                [2.0, 2.0, -9.0],
            ],
        ] {
            for corners in begun_anywhere(&bad) {
                assert_eq!(
                    read(&corners).unwrap_err().code,
                    "mesh_unreadable",
                    "{corners:?}"
                );
            }
        }
        // Straight ones have no area, and what is no number is told by that.
        let straight = flat(&[(0.0, 0.0), (1.0, 1.0), (2.0, 2.0), (3.0, 3.0)]);
        assert!(read(&straight).is_ok());
        let mut text = obj_of(&DART);
        text = text.replacen("10", "NaN", 1);
        assert!(obj::read(text.as_bytes()).is_ok());
        assert!(obj::read(b"v 0 0 0\nf 1 1 1 2\n").is_err());
    }

    proptest! {
        /// Corners around a middle at any distance from it: a simple polygon, leant and far from the origin.
        #[test]
        fn a_star_shaped_polygon_is_its_triangles(
            out in proptest::collection::vec(0.05_f64..1.0, 4..40),
            lean in proptest::array::uniform3(-1.0_f64..1.0),
            far in -1e3_f64..1e3,
        ) {
            let lean = nalgebra::Rotation3::new(Vector3::from(lean) * 3.0);
            let corners: Vec<[f64; 3]> = out.iter().enumerate().map(|(k, r)| {
                let (s, c) = (std::f64::consts::TAU * k as f64 / out.len() as f64).sin_cos();
                (lean * Vector3::new(c * r, s * r, 0.0) + Vector3::repeat(far)).into()
            }).collect();
            for corners in begun_anywhere(&corners) {
                is_the_polygon(&read(&corners).unwrap(), corners.len() - 2);
            }
        }
    }
}
