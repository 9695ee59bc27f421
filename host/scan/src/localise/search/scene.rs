//! A scan made ready for a search: thinned to one density, with normals.

use crate::cloud::curve;
use crate::cloud::tree::PointTree;
use crate::localise::search::oriented::{NEIGHBOURS, Oriented, orient, sample, thin};
use crate::localise::search::pairs::spread;
use crate::localise::search::rough::Points;
use crate::parallel::Threads;
use crate::rigid::Vec3;
use crate::surface::Mesh;

/// The scan in two densities.
pub(in crate::localise) struct Scene {
    /// Points to search with.
    pub places: Vec<Oriented>,
    /// Points to refine and to compare with, neighbours after each other.
    pub fine: Vec<Vec3>,
    /// The noise along the normals by the flatness of neighbourhoods, in mm.
    pub noise_mm: f64,
    /// Edge of the cubes of which one point each is searched with, in mm.
    pub cell_mm: f64,
    /// The points to search with, by place.
    pub tree: PointTree,
}

/// Points of the fine cloud at most.
const FINE: usize = 40_000;
/// Points to search with at most.
const PLACES: usize = 12_000;
/// A normal is that of the points so many cubes' edges around.
pub(in crate::localise) const NORMALS: f64 = 1.6;

/// The edge of a search's cubes: a part's area is some 1500 of them.
pub(in crate::localise) fn cell_mm(mesh: &Mesh) -> f64 {
    (mesh.area_mm2() / 1500.0).sqrt()
}

impl Scene {
    pub fn new(mesh: &Mesh, points: &[Vec3], threads: Threads) -> Self {
        let mut cell = cell_mm(mesh);
        let mut fine = thin(points, cell / 3.0, threads);
        while fine.len() > 8 * FINE {
            cell *= 1.5;
            fine = thin(&fine, cell / 3.0, threads);
        }
        let mut coarse = thin(&fine, cell, threads);
        while coarse.len() > PLACES {
            cell *= 1.3;
            coarse = thin(&coarse, cell, threads);
        }
        let (places, noise_mm) = orient(&coarse, &fine, NORMALS * cell, NEIGHBOURS, threads);
        Self {
            tree: tree(&places),
            places,
            fine: some(&fine, FINE),
            noise_mm,
            cell_mm: cell,
        }
    }

    /// Where the points to search with are.
    pub fn at(&self) -> Vec<Vec3> {
        self.places.iter().map(|o| o.at).collect()
    }

    /// At most `most` of the points to search with, spread evenly.
    pub fn some(&self, most: usize) -> Points {
        let chosen = spread(self.places.len(), most);
        Points::new(chosen.into_iter().map(|i| &self.places[i]))
    }

    /// The scan seen in a mirror (x becomes −x).
    pub fn mirrored(&self) -> Self {
        let turn = |v: &Vec3| Vec3::new(-v.x, v.y, v.z);
        let mirrored = self.places.iter().map(|o| Oriented {
            at: turn(&o.at),
            normal: turn(&o.normal),
        });
        let places: Vec<Oriented> = mirrored.collect();
        Self {
            tree: tree(&places),
            places,
            fine: self.fine.iter().map(turn).collect(),
            noise_mm: self.noise_mm,
            cell_mm: self.cell_mm,
        }
    }
}

/// At most `most` of the points, neighbours after each other.
pub(in crate::localise) fn some(points: &[Vec3], most: usize) -> Vec<Vec3> {
    let order = curve::in_order(points, spread(points.len(), most));
    order.into_iter().map(|k| points[k]).collect()
}

fn tree(places: &[Oriented]) -> PointTree {
    let at: Vec<Vec3> = places.iter().map(|o| o.at).collect();
    PointTree::new(&at)
}

/// The share of the part's surface near which there are points; these in part coordinates.
pub(in crate::localise) fn coverage(mesh: &Mesh, points: &[Vec3]) -> f64 {
    let samples = sample(mesh, 1500);
    let cell = cell_mm(mesh);
    let thinned = thin(points, cell / 3.0, Threads::new(1));
    let tree = PointTree::new(&thinned);
    let mut found = Vec::new();
    let seen = samples
        .iter()
        .filter(|s| {
            tree.within(&s.at, 1.2 * cell, 1, &mut found);
            !found.is_empty()
        })
        .count();
    seen as f64 / samples.len().max(1) as f64
}
