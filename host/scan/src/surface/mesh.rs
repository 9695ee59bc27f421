//! Triangles with what a query asks of them, in a tree of boxes.

use super::bvh::Tree;
use super::facets::Facets;
use super::triangle::{Triangle, bounds};
use crate::ScanError;
use crate::rigid::{Pose, Vec3};

/// The triangles of a model.
#[derive(Clone, Debug)]
pub struct Mesh {
    pub(super) triangles: Vec<Triangle>,
    pub(super) tree: Tree,
    pub(super) facets: Box<Facets>,
    pub(super) dropped: usize,
    pub(super) turned: usize,
}

impl Mesh {
    /// A mesh of these triangles in mm; those without area are left out and counted.
    ///
    /// # Errors
    /// `not_finite` if a corner is not finite, `empty_model` if no triangle has an area.
    pub fn new(corners: &[[Vec3; 3]]) -> Result<Self, ScanError> {
        let mut triangles = Vec::with_capacity(corners.len());
        for (i, t) in corners.iter().enumerate() {
            if !t.iter().all(|c| c.iter().all(|x| x.is_finite())) {
                return Err(ScanError::refused(
                    "not_finite",
                    format_args!(
                        "triangle {} of the model has a corner that is not a finite number: export the model again",
                        i + 1
                    ),
                ));
            }
            let cross = (t[1] - t[0]).cross(&(t[2] - t[0]));
            let twice = cross.norm();
            // 1e-12 of the longest side squared: what single precision leaves of three points in line.
            let side = (t[1] - t[0])
                .norm_squared()
                .max((t[2] - t[0]).norm_squared())
                .max((t[2] - t[1]).norm_squared());
            if twice > 1e-12 * side && twice.is_finite() {
                triangles.push(Triangle {
                    corners: *t,
                    normal: cross / twice,
                    area_mm2: twice / 2.0,
                });
            }
        }
        if triangles.is_empty() {
            return Err(ScanError::refused(
                "empty_model",
                "the model has no triangle with an area: export it as a mesh of its surface",
            ));
        }
        let tree = Tree::new(&triangles);
        Ok(Self {
            dropped: corners.len() - triangles.len(),
            turned: 0,
            facets: Box::new(Facets::new(&triangles, &tree)),
            triangles,
            tree,
        })
    }

    /// The triangles, in the order of the file without those that have no area.
    #[must_use]
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    /// How many triangles without area were left out.
    #[must_use]
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// How many triangles of a closed surface looked inwards in their file and were turned.
    #[must_use]
    pub fn turned(&self) -> usize {
        self.turned
    }

    /// Whether every edge has a triangle on either side: then there is an inside.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        let key = |c: &Vec3| c.map(|x| (x + 0.0).to_bits());
        let mut sides = std::collections::HashMap::new();
        for t in &self.triangles {
            for k in 0..3 {
                let (a, b) = (key(&t.corners[k]), key(&t.corners[(k + 1) % 3]));
                let (ends, way) = if a.as_slice() < b.as_slice() {
                    ((a, b), 1)
                } else {
                    ((b, a), -1)
                };
                *sides.entry(ends).or_insert(0_i64) += way;
            }
        }
        sides.values().all(|way| *way == 0)
    }

    /// The area in mm².
    #[must_use]
    pub fn area_mm2(&self) -> f64 {
        self.triangles.iter().map(|t| t.area_mm2).sum()
    }

    /// The least and the largest coordinates in mm.
    #[must_use]
    pub fn bounds(&self) -> (Vec3, Vec3) {
        bounds(self.triangles.iter().flat_map(|t| t.corners.iter()))
    }

    /// The diagonal of the box around the model in mm.
    #[must_use]
    pub fn diagonal_mm(&self) -> f64 {
        let (low, high) = self.bounds();
        (high - low).norm()
    }

    /// The corners of the box around the model, x slowest.
    #[must_use]
    pub fn corners(&self) -> [Vec3; 8] {
        let (low, high) = self.bounds();
        box_corners(&low, &high)
    }

    /// The mesh where `motion` carries it.
    ///
    /// # Errors
    /// As [`Mesh::new`].
    pub fn moved(&self, motion: &Pose) -> Result<Self, ScanError> {
        let corners: Vec<[Vec3; 3]> = self
            .triangles
            .iter()
            .map(|t| t.corners.map(|c| motion.point(&c)))
            .collect();
        Ok(Self {
            dropped: self.dropped,
            turned: self.turned,
            ..Self::new(&corners)?
        })
    }
}

/// The corners of a box, x slowest.
pub(crate) fn box_corners(low: &Vec3, high: &Vec3) -> [Vec3; 8] {
    std::array::from_fn(|i| {
        let pick = |bit: usize, axis: usize| if i & bit == 0 { low[axis] } else { high[axis] };
        Vec3::new(pick(4, 0), pick(2, 1), pick(1, 2))
    })
}
