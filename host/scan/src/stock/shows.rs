//! Which points show the face that they are nearest to.
//!
//! Stock on a floor reaches into its corners: there it is nearer to the wall than to the floor, and of a wall that nobody has
//! scanned it would own a tenth. So the scanned surface about a point is asked which way it looks. Where it is no plane, as on
//! an edge, or looks as the face does, the point shows that face.

use crate::cloud::oriented::orient;
use crate::parallel::Threads;
use crate::rigid::Vec3;

/// Points that are asked; of more, so many stand for all.
const ASKED: usize = 60_000;
/// The neighbours that say which way the surface looks.
const NEIGHBOURS: usize = 12;
/// The least cosine to the face's normal.
const ALIKE: f64 = 0.6;

/// A point over a face.
#[derive(Clone, Copy)]
pub(super) struct PointOver {
    /// Where it is, on the model.
    pub at: Vec3,
    pub foot: Vec3,
    pub face: usize,
    /// Of the face.
    pub normal: Vec3,
}

/// Those that show their face.
pub(super) fn showing(over: &[PointOver], threads: Threads) -> Vec<PointOver> {
    let asked = over.len().min(ASKED);
    let asked: Vec<PointOver> = (0..asked).map(|k| over[k * over.len() / asked]).collect();
    let at: Vec<Vec3> = asked.iter().map(|point| point.at).collect();
    let (looks, _) = orient(&at, &at, f64::INFINITY, NEIGHBOURS, threads);
    let shows = |(point, looks): (PointOver, Vec3)| {
        let is_alike = looks == Vec3::zeros() || looks.dot(&point.normal).abs() >= ALIKE;
        is_alike.then_some(point)
    };
    let looks = looks.into_iter().map(|of| of.normal);
    asked.into_iter().zip(looks).filter_map(shows).collect()
}
