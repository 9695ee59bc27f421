//! Triangles become a surface: vertices at one place are one, every edge knows both its sides.

use std::collections::HashMap;

use nalgebra::Vector3;

use super::RawMesh;
use crate::ScanError;
use crate::cloud::curve;
use crate::surface::Mesh;

/// No neighbour: the edge is a border.
pub const BORDER: u32 = u32::MAX;

/// The largest part that is planned, in mm across; more is a slip of units.
const LARGEST_MM: f64 = 1e5;

/// The most triangles of a part: a plan of them takes 3.6 GB. Of obstacles ten times as many.
const MOST_TRIANGLES: usize = 2_000_000;

/// One side of an edge: the triangle, which of its edges, and whether it runs from the lower vertex number up.
type Side = (u32, u8, bool);

/// A welded, oriented surface with borders.
#[derive(Debug, Clone)]
pub struct PartMesh {
    /// Places of the vertices.
    pub vertices: Vec<Vector3<f64>>,
    /// Corners of each triangle, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// Across the edge from corner k to corner k + 1, or [`BORDER`].
    pub neighbours: Vec<[u32; 3]>,
    /// Which connected piece each triangle is of.
    pub component: Vec<u32>,
    /// How many connected pieces there are.
    pub components: u32,
    /// The same triangles in a tree, with normals and areas.
    pub surface: Mesh,
    /// Triangles without area that were left out.
    pub dropped: usize,
    /// How far before a border the middle ray stays, so that it meets the part: where the triangles are not the surface
    /// itself, another mesh of it may end a little before.
    pub inset_mm: f64,
}

/// Of a mesh as it is given: what rounding of axis values and rays needs, and no more.
const INSET_MM: f64 = 1e-5;

/// Refuses coordinates that are no numbers.
pub(crate) fn check_finite(raw: &RawMesh) -> Result<(), ScanError> {
    let used = raw.faces.iter().flatten().map(|&i| &raw.vertices[i]);
    match used.clone().position(|v| !v.iter().all(|x| x.is_finite())) {
        Some(place) => Err(ScanError::refused(
            "mesh_not_finite",
            format_args!(
                "Triangle {} has a corner that is no finite number.",
                place / 3 + 1
            ),
        )),
        None => Ok(()),
    }
}

/// Vertices within `tolerance` become one; the new number of each.
fn merge(vertices: &[Vector3<f64>], tolerance: f64) -> (Vec<Vector3<f64>>, Vec<u32>) {
    // Cells are far larger than the tolerance, so that nearly every vertex asks one cell alone.
    let cell = tolerance * 4096.0;
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut kept: Vec<Vector3<f64>> = Vec::new();
    let mut numbers = Vec::with_capacity(vertices.len());
    for v in vertices {
        let low = v.map(|x| ((x - tolerance) / cell).floor() as i64);
        let high = v.map(|x| ((x + tolerance) / cell).floor() as i64);
        let mut found = None;
        'search: for x in low.x..=high.x {
            for y in low.y..=high.y {
                for z in low.z..=high.z {
                    let here = cells.get(&[x, y, z]).map_or(&[][..], Vec::as_slice);
                    found = here
                        .iter()
                        .copied()
                        .find(|&k| (kept[k as usize] - v).amax() <= tolerance);
                    if found.is_some() {
                        break 'search;
                    }
                }
            }
        }
        let number = found.unwrap_or_else(|| {
            let number = kept.len() as u32;
            kept.push(*v);
            let home = v.map(|x| (x / cell).floor() as i64);
            cells
                .entry([home.x, home.y, home.z])
                .or_default()
                .push(number);
            number
        });
        numbers.push(number);
    }
    (kept, numbers)
}

impl PartMesh {
    /// Welds triangles. With `surface_wanted`, what is no oriented surface is refused.
    pub(crate) fn weld(raw: RawMesh, surface_wanted: bool) -> Result<Self, ScanError> {
        let most = if surface_wanted {
            MOST_TRIANGLES
        } else {
            10 * MOST_TRIANGLES
        };
        if raw.faces.len() > most {
            return Err(ScanError::refused(
                "mesh_scale",
                format_args!("More than {most} triangles are not planned on: thin the mesh."),
            ));
        }
        let used: Vec<Vector3<f64>> = raw
            .faces
            .iter()
            .flatten()
            .map(|&i| raw.vertices[i])
            .collect();
        let (low, high) = used.iter().fold(
            (
                Vector3::repeat(f64::INFINITY),
                Vector3::repeat(f64::NEG_INFINITY),
            ),
            |(low, high), v| (low.inf(v), high.sup(v)),
        );
        let across = (high - low).norm();
        let far = low.amax().max(high.amax());
        // Not `<`: a NaN is no size either.
        if across == 0.0 {
            return Err(ScanError::refused(
                "mesh_degenerate",
                "All corners of the mesh are one point.",
            ));
        }
        if surface_wanted && !(0.5..=LARGEST_MM).contains(&across)
            || far.is_nan()
            || far > 100.0 * LARGEST_MM
        {
            return Err(ScanError::refused(
                "mesh_scale",
                format_args!(
                    "The mesh is {across:.3e} mm across and up to {far:.3e} mm from its origin: it seems to be in another unit. Millimetres are needed, 0.5 to {LARGEST_MM} across."
                ),
            ));
        }
        // What single precision leaves of one place, as far out as it lies.
        let tolerance = (far * 1e-9).max(1e-7);
        let (vertices, numbers) = merge(&used, tolerance);
        let listed = raw.faces.len();
        let faces: Vec<[u32; 3]> = numbers
            .chunks_exact(3)
            .map(|n| [n[0], n[1], n[2]])
            .filter(|[a, b, c]| {
                let at = |k: &u32| vertices[*k as usize];
                a != b && b != c && a != c && has_area(&[at(a), at(b), at(c)])
            })
            .collect();
        let (vertices, faces) = in_order(vertices, faces, low, across);
        let corners: Vec<[Vector3<f64>; 3]> = faces
            .iter()
            .map(|f| f.map(|k| vertices[k as usize]))
            .collect();
        let surface = Mesh::new(&corners).map_err(|_| {
            ScanError::refused("mesh_degenerate", "No triangle of the file has an area.")
        })?;
        let mut part = PartMesh {
            dropped: listed - faces.len(),
            neighbours: vec![[BORDER; 3]; faces.len()],
            component: vec![0; faces.len()],
            components: 1,
            vertices,
            faces,
            surface,
            inset_mm: INSET_MM,
        };
        if surface_wanted {
            part.join()?;
            part.count_components();
        }
        Ok(part)
    }

    /// Finds both sides of every edge.
    fn join(&mut self) -> Result<(), ScanError> {
        let mut edges: HashMap<(u32, u32), Vec<Side>> =
            HashMap::with_capacity(self.faces.len() * 2);
        for (f, face) in self.faces.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (face[k], face[(k + 1) % 3]);
                edges
                    .entry((a.min(b), a.max(b)))
                    .or_default()
                    .push((f as u32, k as u8, a < b));
            }
        }
        let mut fault: Option<((u32, u32), bool)> = None;
        for (edge, sides) in &edges {
            match sides.as_slice() {
                [_] => {}
                [(f, k, up), (g, j, down)] if up != down => {
                    self.neighbours[*f as usize][*k as usize] = *g;
                    self.neighbours[*g as usize][*j as usize] = *f;
                }
                more => {
                    // The first one by number, so that the message is the same each time; many sides come first.
                    let many = more.len() > 2;
                    let before = fault.is_none_or(|(first, m)| {
                        (many, std::cmp::Reverse(*edge)) > (m, std::cmp::Reverse(first))
                    });
                    if before {
                        fault = Some((*edge, many));
                    }
                }
            }
        }
        let Some(((a, _), many)) = fault else {
            return Ok(());
        };
        let at = self.vertices[a as usize];
        let place = format!("near ({:.3}, {:.3}, {:.3})", at.x, at.y, at.z);
        Err(if many {
            ScanError::refused(
                "mesh_not_manifold",
                format_args!(
                    "More than two triangles share an edge {place}: which side is outside, nobody can say. Mend the mesh."
                ),
            )
        } else {
            ScanError::refused(
                "mesh_not_oriented",
                format_args!(
                    "Two neighbouring triangles run the same way round their common edge {place}: one looks outwards, one inwards. Orient the mesh."
                ),
            )
        })
    }

    fn count_components(&mut self) {
        let mut seen = vec![false; self.faces.len()];
        let mut number = 0;
        for start in 0..self.faces.len() {
            if seen[start] {
                continue;
            }
            seen[start] = true;
            let mut open = vec![start];
            while let Some(f) = open.pop() {
                self.component[f] = number;
                for &g in &self.neighbours[f] {
                    if g != BORDER && !seen[g as usize] {
                        seen[g as usize] = true;
                        open.push(g as usize);
                    }
                }
            }
            number += 1;
        }
        self.components = number;
    }

    /// The corners of a triangle.
    pub fn corners(&self, face: usize) -> &[Vector3<f64>; 3] {
        &self.surface.triangles()[face].corners
    }

    /// The outward normal of a triangle.
    pub fn normal(&self, face: usize) -> Vector3<f64> {
        self.surface.triangles()[face].normal
    }

    /// Is the mesh closed, and do its triangles look inwards, those of every piece?
    pub fn inside_out(&self) -> bool {
        if self.neighbours.iter().flatten().any(|n| *n == BORDER) {
            return false;
        }
        // Of each piece, six times what it encloses, positive where its triangles look out of it.
        let mut volumes = vec![0.0; self.components as usize];
        let near = self.vertices.first().copied().unwrap_or_default();
        for (k, component) in self.component.iter().enumerate() {
            let [a, b, c] = self.corners(k).map(|p| p - near);
            if let Some(volume) = volumes.get_mut(*component as usize) {
                *volume += a.dot(&b.cross(&c));
            }
        }
        !volumes.is_empty() && volumes.iter().all(|v| *v < 0.0)
    }

    /// The area of a triangle.
    pub fn area_mm2(&self, face: usize) -> f64 {
        self.surface.triangles()[face].area_mm2
    }

    /// How far some triangles reach: twice from their middle to the corner furthest off. A motion or another mesh of the
    /// same surface does not change it.
    pub fn across_mm(&self, faces: &[u32]) -> f64 {
        let (mut area, mut middle) = (0.0, Vector3::zeros());
        for &f in faces {
            let here = self.area_mm2(f as usize);
            area += here;
            middle += self.corners(f as usize).iter().sum::<Vector3<f64>>() * (here / 3.0);
        }
        middle /= f64::max(area, f64::MIN_POSITIVE);
        let corners = faces.iter().flat_map(|&f| self.corners(f as usize));
        2.0 * corners.map(|c| (c - middle).norm()).fold(0.0, f64::max)
    }
}

/// Vertices and triangles in the order of their places along a [`curve`]: how a file lists them changes nothing.
fn in_order(
    vertices: Vec<Vector3<f64>>,
    faces: Vec<[u32; 3]>,
    low: Vector3<f64>,
    across: f64,
) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let code = curve::along(low, across);
    let places = |a: &Vector3<f64>, b: &Vector3<f64>| {
        let each = a.iter().zip(b.iter()).map(|(x, y)| x.total_cmp(y));
        each.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
    };
    let mut sorted: Vec<(u64, u32)> = vertices.iter().map(&code).zip(0..).collect();
    sorted.sort_by(|a, b| {
        let by_place = || places(&vertices[a.1 as usize], &vertices[b.1 as usize]);
        a.0.cmp(&b.0).then_with(by_place)
    });
    let mut number = vec![0_u32; vertices.len()];
    for ((_, old), new) in sorted.iter().zip(0..) {
        number[*old as usize] = new;
    }
    let moved: Vec<Vector3<f64>> = sorted.iter().map(|(_, k)| vertices[*k as usize]).collect();
    let mut sorted: Vec<(u64, [u32; 3])> = faces
        .iter()
        .map(|f| {
            let mut f = f.map(|k| number[k as usize]);
            let least = (0..3).min_by_key(|k| f[*k]).unwrap_or(0);
            f.rotate_left(least);
            let middle = f.map(|k| moved[k as usize]).iter().sum::<Vector3<f64>>() / 3.0;
            (code(&middle), f)
        })
        .collect();
    sorted.sort_unstable();
    (moved, sorted.into_iter().map(|(_, f)| f).collect())
}

/// The same bound as [`Mesh::new`] has, so that both drop the same triangles.
fn has_area(t: &[Vector3<f64>; 3]) -> bool {
    let (a, b, c) = (t[1] - t[0], t[2] - t[0], t[2] - t[1]);
    let side = a.norm_squared().max(b.norm_squared()).max(c.norm_squared());
    let twice = a.cross(&b).norm();
    twice > 1e-12 * side && twice.is_finite()
}
