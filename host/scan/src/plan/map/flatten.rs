//! Least squares conformal map with a free border.
//!
//! Of the maps that keep angles, this one needs one linear system and takes any border, so that holes stay holes.
//! Minimised is Dirichlet's energy less the signed area (Mullen and others, 2008, eq. 3): zero where every angle is
//! kept. Two border vertices far apart are held. The system is solved by conjugate gradients from the projection onto
//! the mean plane: it is sparse, and neither memory nor time grow faster than the mesh times its width.

use nalgebra::{Vector2, Vector3};

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

const MOST_STEPS: usize = 2500;

impl FlatMap {
    /// Flattens the faces of a chart.
    pub fn new(part: &PartMesh, chart: &[u32]) -> Self {
        let mut number = vec![u32::MAX; part.vertices.len()];
        let mut vertices = Vec::new();
        let faces: Vec<[u32; 3]> = chart
            .iter()
            .map(|&f| {
                part.faces[f as usize].map(|v| {
                    let slot = &mut number[v as usize];
                    if *slot == u32::MAX {
                        *slot = vertices.len() as u32;
                        vertices.push(v);
                    }
                    *slot
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
        let energy = Energy::new(&at, &faces);
        energy.relax(&mut places, farthest_pair(&at));
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

/// The quadratic form: for each vertex, its neighbours with the cotangent weight and the border's turn.
struct Energy {
    rows: Vec<Vec<(u32, f64, f64)>>,
    diagonal: Vec<f64>,
}

impl Energy {
    fn new(at: &[Vector3<f64>], faces: &[[u32; 3]]) -> Self {
        let mut rows: Vec<Vec<(u32, f64, f64)>> = vec![Vec::with_capacity(7); at.len()];
        let mut add = |i: u32, j: u32, weight: f64, turn: f64| {
            let row = &mut rows[i as usize];
            match row.iter_mut().find(|(k, _, _)| *k == j) {
                Some((_, w, t)) => {
                    *w += weight;
                    *t += turn;
                }
                None => row.push((j, weight, turn)),
            }
        };
        for f in faces {
            for k in 0..3 {
                let (i, j, o) = (f[k], f[(k + 1) % 3], f[(k + 2) % 3]);
                let (a, b) = (
                    at[i as usize] - at[o as usize],
                    at[j as usize] - at[o as usize],
                );
                // A sliver's cotangent is bounded, so that one damaged triangle does not own the system.
                let cot = (a.dot(&b) / a.cross(&b).norm().max(1e-300)).clamp(-1e4, 1e4);
                add(i, j, cot / 2.0, 0.5);
                add(j, i, cot / 2.0, -0.5);
            }
        }
        // Inside, each edge is run both ways and its turns cancel; the border's stay.
        let diagonal = rows
            .iter()
            .map(|row| row.iter().map(|r| r.1).sum::<f64>().max(1e-9))
            .collect();
        Energy { rows, diagonal }
    }

    fn apply(&self, x: &[Vector2<f64>], out: &mut [Vector2<f64>]) {
        for (i, row) in self.rows.iter().enumerate() {
            let mut sum = Vector2::zeros();
            for &(j, weight, turn) in row {
                let other = x[j as usize];
                sum += (x[i] - other) * weight;
                // Of the signed area: its gradient is the neighbour turned by a right angle.
                sum += Vector2::new(-other.y, other.x) * turn;
            }
            out[i] = sum;
        }
    }

    /// Conjugate gradients with a diagonal preconditioner; the held vertices stay.
    fn relax(&self, x: &mut [Vector2<f64>], held: [usize; 2]) {
        let n = x.len();
        let zero = Vector2::zeros();
        let free = |v: &mut [Vector2<f64>]| {
            for h in held {
                v[h] = zero;
            }
        };
        let dot = |a: &[Vector2<f64>], b: &[Vector2<f64>]| {
            a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>()
        };
        let mut product = vec![zero; n];
        self.apply(x, &mut product);
        let mut rest: Vec<_> = product.iter().map(|p| -p).collect();
        free(&mut rest);
        let mut step: Vec<_> = rest
            .iter()
            .zip(&self.diagonal)
            .map(|(r, d)| r / *d)
            .collect();
        let mut size = dot(&rest, &step);
        let goal = size * 1e-12;
        for _ in 0..MOST_STEPS {
            if size.is_nan() || size <= goal || size < 1e-300 {
                break;
            }
            self.apply(&step, &mut product);
            free(&mut product);
            let curvature = dot(&step, &product);
            if curvature.is_nan() || curvature <= 0.0 {
                break;
            }
            let length = size / curvature;
            for k in 0..n {
                x[k] += step[k] * length;
                rest[k] -= product[k] * length;
            }
            let next: f64 = rest
                .iter()
                .zip(&self.diagonal)
                .map(|(r, d)| r.norm_squared() / d)
                .sum();
            let keep = next / size;
            for k in 0..n {
                step[k] = rest[k] / self.diagonal[k] + step[k] * keep;
            }
            size = next;
        }
    }
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
