//! Least squares conformal map with a free border.
//!
//! Of the maps that keep angles, this one needs one linear system and takes any border, so that holes stay holes.
//! Two vertices far apart are held. The system is sparse and has no negative eigenvalue; it is solved by a Cholesky
//! factorisation. Where that fails, the surface is projected along its mean normal; what is said of the map's
//! quality is measured on it in any case.

use std::collections::HashMap;

use nalgebra::{Vector2, Vector3};
use umi_sparse::SparseSystem;

use super::super::mesh::PartMesh;

/// A chart's triangles in the plane.
#[derive(Debug, Clone)]
pub struct FlatMap {
    /// Numbers of the chart's vertices in the part.
    pub vertices: Vec<u32>,
    /// Their places in the plane; the whole has the area of the surface.
    pub places: Vec<Vector2<f64>>,
    /// Triangles by places in `vertices`, in the order of the chart's faces.
    pub faces: Vec<[u32; 3]>,
    /// How true it is.
    pub quality: MapQuality,
}

impl FlatMap {
    /// Each triangle in the plane, with the length in the plane of a millimetre on the surface there. `chart`: the
    /// chart's faces, in the order of the map's.
    pub fn scales(&self, part: &PartMesh, chart: &[u32]) -> Vec<([[f64; 2]; 3], f64)> {
        self.faces
            .iter()
            .zip(chart)
            .map(|(f, &face)| {
                let flat = doubled(&self.places, f).abs() / 2.0;
                let scale = (flat / part.area_mm2(face as usize)).sqrt();
                let corner = |k: u32| self.places[k as usize].into();
                (f.map(corner), scale)
            })
            .collect()
    }
}

/// How true a map is.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct MapQuality {
    /// The largest change of a triangle's angle.
    pub max_angle_error_deg: f64,
    /// Least length in the plane of a millimetre on the surface.
    pub scale_min: f64,
    /// Largest length in the plane of a millimetre on the surface.
    pub scale_max: f64,
    /// Triangles that lie upside down.
    pub flips: usize,
}

impl MapQuality {
    /// The worse of both in everything.
    pub fn worst(self, other: Self) -> Self {
        MapQuality {
            max_angle_error_deg: self.max_angle_error_deg.max(other.max_angle_error_deg),
            scale_min: self.scale_min.min(other.scale_min),
            scale_max: self.scale_max.max(other.scale_max),
            flips: self.flips + other.flips,
        }
    }
}

impl FlatMap {
    /// Flattens the faces of a chart.
    pub fn new(part: &PartMesh, chart: &[u32]) -> Self {
        // Not one slot for each of the part's vertices: a part can have as many charts as triangles.
        let mut number: HashMap<u32, u32> = HashMap::with_capacity(chart.len());
        let mut vertices = Vec::new();
        let faces: Vec<[u32; 3]> = chart
            .iter()
            .map(|&f| {
                part.faces[f as usize].map(|v| {
                    *number.entry(v).or_insert_with(|| {
                        vertices.push(v);
                        vertices.len() as u32 - 1
                    })
                })
            })
            .collect();
        let at: Vec<Vector3<f64>> = vertices
            .iter()
            .map(|&v| part.vertices[v as usize])
            .collect();
        let mean: Vector3<f64> = chart
            .iter()
            .map(|&f| part.normal(f as usize) * part.area_mm2(f as usize))
            .sum();
        let (x, y) = across(&mean);
        let centre = at.iter().sum::<Vector3<f64>>() / at.len().max(1) as f64;
        let mut places: Vec<Vector2<f64>> = at
            .iter()
            .map(|p| Vector2::new((p - centre).dot(&x), (p - centre).dot(&y)))
            .collect();
        if let Some(conformal) = conformal(&at, &faces, farthest_pair(&at)) {
            places = conformal;
        }
        normalise(part, chart, &faces, &mut places);
        let quality = quality(part, chart, &faces, &places);
        FlatMap {
            vertices,
            places,
            faces,
            quality,
        }
    }
}

/// Two unit vectors across a direction (z if it has none).
pub(crate) fn across(direction: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let n = direction.try_normalize(1e-12).unwrap_or_else(Vector3::z);
    let seed = if n.x.abs() < 0.7 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let x = (seed - n * n.dot(&seed)).normalize();
    (x, n.cross(&x))
}

fn farthest_pair(at: &[Vector3<f64>]) -> [usize; 2] {
    let far = |from: &Vector3<f64>| {
        let d = |p: &Vector3<f64>| (p - from).norm_squared();
        (0..at.len())
            .max_by(|a, b| d(&at[*a]).total_cmp(&d(&at[*b])))
            .unwrap_or(0)
    };
    let a = far(&at[0]);
    [a, far(&at[a])]
}

/// A triangle's area counts as no less than this share of its longest edge's square: a sliver does not own the system.
const LEAST_AREA: f64 = 1e-5;

/// The conformal map (Lévy and others, 2002, eq. 4): of a triangle with edges W opposite to its corners, as complex
/// numbers in its own plane, the sum of W U over the corners' places U is zero where every angle is kept. The squares of
/// these sums by area are minimised; two vertices are held, as far apart as on the part. None where the system cannot be
/// solved.
fn conformal(
    at: &[Vector3<f64>],
    faces: &[[u32; 3]],
    [first, second]: [usize; 2],
) -> Option<Vec<Vector2<f64>>> {
    let apart = (at[second] - at[first]).norm();
    if first == second || apart.is_nan() || apart <= 0.0 {
        return None;
    }
    let held = |k: usize| Vector2::new(if k == second { apart } else { 0.0 }, 0.0);
    // The held vertices are no unknowns; each other one is two.
    let mut count = 0;
    let unknown: Vec<Option<u32>> = (0..at.len())
        .map(|k| {
            (k != first && k != second).then(|| {
                count += 2;
                count - 2
            })
        })
        .collect();
    let mut system = SparseSystem::new(count, 13 * faces.len());
    let mut right = vec![0.0; count as usize];
    for f in faces {
        let [a, b, c] = f.map(|k| at[k as usize]);
        let (u, v) = (b - a, c - a);
        let Some(x) = u.try_normalize(1e-300) else {
            continue;
        };
        // Corners in the triangle's plane: a at zero, b along its first edge.
        let height = u.cross(&v).norm() / u.norm();
        let corners = [
            Vector2::zeros(),
            Vector2::new(u.norm(), 0.0),
            Vector2::new(v.dot(&x), height),
        ];
        let w = [0, 1, 2].map(|k| corners[(k + 2) % 3] - corners[(k + 1) % 3]);
        let longest = w.iter().map(Vector2::norm_squared).fold(0.0, f64::max);
        let twice = (u.norm() * height).max(2.0 * LEAST_AREA * longest);
        for i in 0..3 {
            let Some(row) = unknown[f[i] as usize] else {
                continue;
            };
            for j in 0..3 {
                // The conjugate of W_i times W_j.
                let (same, turned) = (w[i].dot(&w[j]) / twice, w[i].perp(&w[j]) / twice);
                match unknown[f[j] as usize] {
                    Some(column) => {
                        system.add(row, column, same);
                        system.add(row + 1, column + 1, same);
                        if i != j {
                            system.add(row, column + 1, -turned);
                            system.add(row + 1, column, turned);
                        }
                    }
                    None => {
                        let there = held(f[j] as usize);
                        right[row as usize] -= same * there.x - turned * there.y;
                        right[row as usize + 1] -= turned * there.x + same * there.y;
                    }
                }
            }
        }
    }
    let solved = system.solve(&right)?;
    let place = |k: usize| match unknown[k] {
        Some(u) => Vector2::new(solved[u as usize], solved[u as usize + 1]),
        None => held(k),
    };
    Some((0..at.len()).map(place).collect())
}

fn doubled(places: &[Vector2<f64>], f: &[u32; 3]) -> f64 {
    let [a, b, c] = f.map(|k| places[k as usize]);
    (b - a).perp(&(c - a))
}

/// The area of the surface, most triangles the right way up, the middle at zero.
fn normalise(part: &PartMesh, chart: &[u32], faces: &[[u32; 3]], places: &mut [Vector2<f64>]) {
    let solid: f64 = chart.iter().map(|&f| part.area_mm2(f as usize)).sum();
    let flat: f64 = faces.iter().map(|f| doubled(places, f)).sum::<f64>() / 2.0;
    let scale = (solid / flat.abs().max(1e-300)).sqrt();
    let scale = if scale.is_finite() { scale } else { 1.0 };
    let centre = places.iter().sum::<Vector2<f64>>() / places.len().max(1) as f64;
    for p in places {
        *p = (*p - centre) * scale;
        if flat < 0.0 {
            p.x = -p.x;
        }
    }
}

fn quality(
    part: &PartMesh,
    chart: &[u32],
    faces: &[[u32; 3]],
    places: &[Vector2<f64>],
) -> MapQuality {
    let mut q = MapQuality {
        max_angle_error_deg: 0.0,
        scale_min: f64::INFINITY,
        scale_max: 0.0,
        flips: 0,
    };
    for (f, &face) in faces.iter().zip(chart) {
        let area = part.area_mm2(face as usize);
        let flat = doubled(places, f) / 2.0;
        if flat <= 0.0 {
            q.flips += 1;
        }
        let scale = (flat.abs() / area).sqrt();
        q.scale_min = q.scale_min.min(scale);
        q.scale_max = q.scale_max.max(scale);
        let solid = part.corners(face as usize);
        let plane = f.map(|k| places[k as usize]);
        for k in 0..3 {
            let (i, j, o) = (k, (k + 1) % 3, (k + 2) % 3);
            let (a, b) = (solid[i] - solid[o], solid[j] - solid[o]);
            let true_angle = a.cross(&b).norm().atan2(a.dot(&b));
            let (a, b) = (plane[i] - plane[o], plane[j] - plane[o]);
            let angle = a.perp(&b).atan2(a.dot(&b));
            q.max_angle_error_deg = q
                .max_angle_error_deg
                .max((angle - true_angle).abs().to_degrees());
        }
    }
    q
}
