//! Distances to a model on a grid: rough, and as fast as memory.

use crate::parallel::Threads;
use crate::rigid::Vec3;
use crate::surface::Mesh;

/// Cells along the model's diagonal.
const CELLS: f64 = 64.0;

/// The distances around a model.
#[derive(Clone, Debug)]
pub(in crate::localise) struct HeightField {
    low: Vec3,
    cell: f64,
    size: [usize; 3],
    /// Cells a mm, and those along each axis, as single numbers.
    per_mm: f32,
    ends: [f32; 3],
    values: Vec<(f32, u32)>,
}

impl HeightField {
    /// The field around `mesh`, with a margin of a tenth of its diagonal.
    pub fn new(mesh: &Mesh, threads: Threads) -> Self {
        let (low, high) = mesh.bounds();
        let diagonal = (high - low).norm();
        let cell = diagonal / CELLS;
        let margin = Vec3::repeat(diagonal * 0.1);
        let low = low - margin;
        let span = high + margin - low;
        let size: [usize; 3] = std::array::from_fn(|i| (span[i] / cell) as usize + 1);
        let rows = size[1] * size[2];
        let values = threads
            .chunks(rows, 16, |range| {
                let mut part = Vec::with_capacity(range.len() * size[0]);
                let mut last = 0;
                for row in range {
                    for x in 0..size[0] {
                        let index =
                            Vec3::new(x as f64, (row % size[1]) as f64, (row / size[1]) as f64);
                        let near = mesh.near_from(&(low + index.add_scalar(0.5) * cell), last);
                        last = near.face;
                        part.push((near.distance_mm as f32, near.face as u32));
                    }
                }
                part
            })
            .concat();
        Self {
            low,
            cell,
            per_mm: (1.0 / cell) as f32,
            ends: size.map(|n| n as f32),
            size,
            values,
        }
    }

    /// Where the grid begins: the origin of its own frame, in mm.
    pub fn low(&self) -> &Vec3 {
        &self.low
    }

    /// As [`HeightField::at`], for a point in the grid's own frame.
    #[inline]
    pub fn near(&self, p: &[f32; 3]) -> Option<(f32, u32)> {
        let mut place = 0;
        for i in [2, 1, 0] {
            let index = p[i] * self.per_mm;
            if !(index >= 0.0 && index < self.ends[i]) {
                return None;
            }
            place = place * self.size[i] + index as usize;
        }
        Some(self.values[place])
    }

    /// The distance of the middle of the cell around `p` in mm, and the face nearest to it; none outside of the grid.
    pub fn at(&self, p: &Vec3) -> Option<(f64, usize)> {
        let index = (p - self.low) / self.cell;
        let mut place = 0;
        for i in [2, 1, 0] {
            if index[i].is_nan() || index[i] < 0.0 || index[i] >= self.size[i] as f64 {
                return None;
            }
            place = place * self.size[i] + index[i] as usize;
        }
        let (distance, face) = self.values[place];
        Some((f64::from(distance), face as usize))
    }

    /// Infinite, with the sign of the distance, if `p` is surely farther than `limit` mm from the model; none if that
    /// cannot be said without the model.
    pub fn beyond(&self, p: &Vec3, limit: f64) -> Option<f64> {
        let (distance, _) = self.at(p)?;
        // From the middle of a cell to its corner, and what single precision rounds.
        let slack = 0.8661 * self.cell + 1e-6 * distance.abs();
        (distance.abs() - slack > limit).then(|| f64::INFINITY.copysign(distance))
    }
}
