//! Points of equal area on the part, the same for every path.

use nalgebra::Vector3;

use super::super::mesh::PartMesh;

/// How many points stand for a surface at least.
pub const SAMPLES: usize = 6000;

/// How many stand for it at most.
const MOST_SAMPLES: usize = 80_000;

/// Points of a large part lie this share of the laser line apart: an overlap of a tenth is still told.
const APART: f64 = 0.08;

/// How many points a part deserves under a line of this length.
pub fn sample_count(area_mm2: f64, line_mm: f64) -> usize {
    let wanted = area_mm2 / (APART * line_mm).powi(2);
    // A conversion saturates.
    (wanted as usize).clamp(SAMPLES, MOST_SAMPLES)
}

/// A point of the surface.
#[derive(Debug, Clone, Copy)]
pub struct SamplePoint {
    /// Where it lies.
    pub at: Vector3<f64>,
    /// Normal of its triangle.
    pub normal: Vector3<f64>,
    /// Its triangle.
    pub face: u32,
}

/// Spreads points evenly: by area over the triangles, within them by the R2 sequence (Roberts, 2018).
pub fn samples(part: &PartMesh, count: usize) -> Vec<SamplePoint> {
    const G: f64 = 1.324_717_957_244_746;
    let total: f64 = part.surface.area_mm2();
    let mut points = Vec::with_capacity(count);
    let (mut face, mut before) = (0, 0.0);
    for i in 0..count {
        let wanted = (i as f64 + 0.5) / count as f64 * total;
        while face + 1 < part.faces.len() && before + part.area_mm2(face) <= wanted {
            before += part.area_mm2(face);
            face += 1;
        }
        let n = (i + 1) as f64;
        let (mut a, mut b) = ((n / G).fract(), (n / (G * G)).fract());
        if a + b > 1.0 {
            (a, b) = (1.0 - a, 1.0 - b);
        }
        let t = part.corners(face);
        points.push(SamplePoint {
            at: t[0] + (t[1] - t[0]) * a + (t[2] - t[0]) * b,
            normal: part.normal(face),
            face: face as u32,
        });
    }
    points
}
