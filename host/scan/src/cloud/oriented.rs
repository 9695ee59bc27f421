//! Points with the direction of the surface around them.

use nalgebra::Matrix3;

use super::tree::PointTree;
use crate::parallel::Threads;
use crate::rigid::Vec3;
use crate::solve::{eigen, median};

/// A point of a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Oriented {
    /// Where it is, in mm.
    pub at: Vec3,
    /// The normal, of either sign in a scan; zero where the neighbourhood has none.
    pub normal: Vec3,
}

impl Oriented {
    /// Whether the neighbourhood has a direction.
    pub fn is_oriented(&self) -> bool {
        self.normal != Vec3::zeros()
    }
}

/// Neighbours that a normal is taken from, where a surface has many.
pub(crate) const NEIGHBOURS: usize = 24;
/// Neighbours that a normal needs.
const LEAST: usize = 7;

/// The points of `places` with normals by their neighbours among `points` within `radius` mm, and the noise along the
/// normals (mm, the median over the points; 0 if there are none). A normal is taken from the nearest `most` of them.
pub(crate) fn orient(
    places: &[Vec3],
    points: &[Vec3],
    radius: f64,
    most: usize,
    threads: Threads,
) -> (Vec<Oriented>, f64) {
    let tree = PointTree::new(points);
    let all = threads.each(places.len(), |i| {
        let mut found = Vec::new();
        tree.within(&places[i], radius, most, &mut found);
        let none = (
            Oriented {
                at: places[i],
                normal: Vec3::zeros(),
            },
            f64::NAN,
        );
        if found.len() < LEAST {
            return none;
        }
        let n = found.len() as f64;
        let middle = found.iter().map(|f| points[f.1 as usize]).sum::<Vec3>() / n;
        let mut spread = Matrix3::zeros();
        for f in &found {
            let off = points[f.1 as usize] - middle;
            spread += off * off.transpose();
        }
        let (values, vectors) = eigen(&spread);
        // Flat enough to have a direction, and no line.
        if values[0] > 0.12 * values[1] || values[1] < 0.02 * values[2] {
            return none;
        }
        let noise = (values[0].max(0.0) / (n - 3.0)).sqrt();
        (
            Oriented {
                at: places[i],
                normal: vectors.column(0).into_owned(),
            },
            noise,
        )
    });
    let mut noises: Vec<f64> = all.iter().map(|a| a.1).filter(|x| x.is_finite()).collect();
    let noise = median(&mut noises);
    (all.into_iter().map(|a| a.0).collect(), noise)
}
