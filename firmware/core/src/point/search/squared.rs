//! Where a beam can be at all.
//!
//! Squared, the equation of a reading is linear. With f = Q - C, the reading s from its mean and
//! the point's distance d from the ball, |f + c + s a|² = (R + d)² is
//!
//! 2 f·c + 2 s f·a + |c|² + 2 s c·a = R² - |f|² - s² + d (2 R + d)
//!
//! in c, a, |c|² and c·a: eight unknowns, one solution, no start. It is near the least minimum; and
//! because every beam that fits solves it but for its own d, all that fit are within an ellipsoid about it.
//! Where that is small there is one minimum, and no search need look for others.
//!
//! Axes in a plane do not see what lies across it: six unknowns are left. |a| = 1 then gives the part of a
//! across the plane but for its sign, and c·a that of c: two beams, each the mirror image of the other.

// Every index runs over arrays of length 3 or COLUMNS.
#![allow(clippy::indexing_slicing, clippy::needless_range_loop)]

use nalgebra::Vector3;

use super::super::model::{Beam, View};
use crate::fit::solve::linalg::{Qr, Triangle, norm, unit};

/// Unknowns of axes in space: c and a in the plane that the axes are nearest to, |c|², c·a, then c
/// and a across it. Of axes in a plane the last two are left out.
const SPACE: usize = 8;
const PLANE: usize = 6;

/// The unknowns, and the right side.
const COLUMNS: usize = SPACE + 1;

/// Least part of a beam across the axes' plane that its sign is told by.
const LEAST_ACROSS: f64 = 0.2;

/// The squared equations of all readings.
pub(super) struct Squared<'a, const K: usize> {
    view: &'a View<'a, K>,
    /// Mean of f.
    middle: Vector3<f64>,
    /// The plane that the axes are nearest to: two directions in it, its normal.
    frame: [Vector3<f64>; 3],
    triangle: Triangle<COLUMNS>,
    /// Root of the sum of the squares of the axes' distances from the plane, and the largest of them.
    off_plane: [f64; 2],
    /// The largest radius that a point may have been measured on.
    radius: f64,
}

/// The beam that solves the equations best, and how far from it those can be that fit.
pub(super) struct Region<const K: usize> {
    pub(super) beam: Beam<K>,
    /// Its mirror image does as well.
    pub(super) mirrored: bool,
    /// How far from these a foot can be, mm.
    pub(super) foot: f64,
    /// How far from these a direction can be, radians.
    pub(super) direction: f64,
}

impl<'a, const K: usize> Squared<'a, K> {
    pub(super) fn new(view: &'a View<'a, K>) -> Self {
        let middle = middle(view);
        let frame = plane(view, &middle);
        let (mut qr, mut squares, mut most, mut radius) = (Qr::new(), 0.0, 0.0_f64, 0.0_f64);
        for seen in view.sightings() {
            let off = seen.from_center - middle;
            let [x, y, z] = frame.map(|axis| axis.dot(&off));
            let s = seen.spread;
            let right = seen.radius * seen.radius - off.dot(&off) - s * s;
            let row = [
                2.0 * x,
                2.0 * y,
                2.0 * s * x,
                2.0 * s * y,
                1.0,
                2.0 * s,
                2.0 * z,
                2.0 * s * z,
                right,
            ];
            qr.add(row, 0.0);
            squares += z * z;
            most = most.max(z.abs());
            radius = radius.max(seen.radius);
        }
        Self {
            view,
            middle,
            frame,
            triangle: qr.triangle(),
            off_plane: [libm::sqrt(squares), most],
            radius: radius * view.largest_swelling(),
        }
    }

    /// Where every beam is that fits within an rms: about one beam, or about two that mirror each other. None where
    /// the readings leave more open than that.
    pub(super) fn region(&self, rms: f64) -> Option<Region<K>> {
        self.in_space(rms).or_else(|| self.in_plane(rms))
    }

    /// An rms that the best beam surely has, but for what is nonlinear.
    pub(super) fn least_rms(&self) -> f64 {
        let (_, left) = self.triangle.leading::<SPACE>();
        libm::sqrt(left / self.view.count()) / (2.0 * self.radius)
    }

    /// The largest length of d (2 R + d) over all readings: no sum of fourth powers is more than the square of
    /// the sum of squares.
    fn room(&self, rms: f64) -> f64 {
        let length = rms * libm::sqrt(self.view.count());
        length * (2.0 * self.radius + length)
    }

    fn in_space(&self, rms: f64) -> Option<Region<K>> {
        let (triangle, left) = self.triangle.leading::<SPACE>();
        let [c1, c2, a1, a2, _, _, c3, a3] = triangle.solve()?;
        let gram = triangle.inverse_gram()?;
        let room = self.room(rms);
        let reach2 = room * room - left;
        let direction = unit(&Vector3::new(a1, a2, a3))?;
        let (mut along, mut all) = (0.0, 0.0);
        for (i, row) in [2, 3, 7].into_iter().enumerate() {
            all += gram[row][row];
            for (j, column) in [2, 3, 7].into_iter().enumerate() {
                along += direction[i] * gram[row][column] * direction[j];
            }
        }
        // A unit vector whose part along another one is positive is told by its part across it.
        let is_ahead = reach2 * along < 0.25;
        is_ahead.then_some(Region {
            beam: self.beam([c1, c2, c3], direction),
            mirrored: false,
            foot: libm::sqrt(reach2 * (gram[0][0] + gram[1][1] + gram[6][6])),
            direction: libm::sqrt(reach2 * (all - along).max(0.0)),
        })
    }

    fn in_plane(&self, rms: f64) -> Option<Region<K>> {
        let (triangle, left) = self.triangle.leading::<PLANE>();
        let [c1, c2, a1, a2, _, ca] = triangle.solve()?;
        let gram = triangle.inverse_gram()?;
        // What the axes leave the plane by is unknown times the point's distance from it, which the ball limits.
        let [off_plane, most] = self.off_plane;
        let height = self.radius + rms * libm::sqrt(self.view.count()) + most;
        let room = self.room(rms) + 2.0 * off_plane * height;
        let reach2 = room * room - left;
        let within = |i: usize, j: usize| libm::sqrt(reach2 * (gram[i][i] + gram[j][j]));
        let (foot, turn, product) = (within(0, 1), within(2, 3), within(5, 5));
        let aside = norm2(a1, a2) + turn;
        let across2 = 1.0 - aside * aside;
        if across2.is_nan() || across2 < LEAST_ACROSS * LEAST_ACROSS {
            return None;
        }
        let across = libm::sqrt(across2);
        let a3 = libm::sqrt(1.0 - a1 * a1 - a2 * a2);
        // c·a, but for what lies in the plane.
        let rest = ca - c1 * a1 - c2 * a2;
        let turned = aside * turn / across;
        let deep =
            (product + norm2(c1, c2) * turn + foot * aside + (rest / a3).abs() * turned) / across;
        Some(Region {
            beam: self.beam([c1, c2, rest / a3], Vector3::new(a1, a2, a3)),
            mirrored: true,
            foot: norm2(foot, deep),
            direction: turn / across,
        })
    }

    /// The beam that axes in a plane would see beside it: |c|² gives its foot's distance from the plane, and c·a the
    /// part of its direction across. None where the readings leave more open, or where that distance is none.
    pub(super) fn beside(&self) -> Option<Beam<K>> {
        let (triangle, _) = self.triangle.leading::<PLANE>();
        let [c1, c2, a1, a2, cc, ca] = triangle.solve()?;
        let c3 = libm::sqrt(cc - c1 * c1 - c2 * c2);
        let a3 = (ca - c1 * a1 - c2 * a2) / c3;
        let direction = Vector3::new(a1, a2, a3);
        unit(&direction).map(|_| self.beam([c1, c2, c3], direction))
    }

    /// A beam mirrored in the plane that the axes are nearest to.
    pub(super) fn image(&self, beam: &Beam<K>) -> Option<Beam<K>> {
        let [_, _, normal] = self.frame;
        image(beam, &self.middle, &normal)
    }

    /// The beam with a foot and a direction in the plane's frame.
    fn beam(&self, foot: [f64; 3], direction: Vector3<f64>) -> Beam<K> {
        let turned = |v: [f64; 3]| {
            let [e1, e2, e3] = self.frame;
            e1 * v[0] + e2 * v[1] + e3 * v[2]
        };
        let direction = turned([direction.x, direction.y, direction.z]);
        let direction = direction / norm(&direction);
        self.view.beam(turned(foot) - self.middle, direction)
    }
}

/// A beam mirrored in the plane through `middle`, a mean of f.
pub(super) fn image<const K: usize>(
    beam: &Beam<K>,
    middle: &Vector3<f64>,
    normal: &Vector3<f64>,
) -> Option<Beam<K>> {
    let flip = |v: &Vector3<f64>| v - normal * (2.0 * v.dot(normal));
    let mut image = *beam;
    // (middle + c) is mirrored; middle itself stays.
    image.foot = flip(&(beam.foot + middle)) - middle;
    image.turn(unit(&flip(&beam.direction))?);
    Some(image)
}

/// The mean of f.
pub(super) fn middle<const K: usize>(view: &View<'_, K>) -> Vector3<f64> {
    let n = view.count();
    view.sightings()
        .fold(Vector3::zeros(), |sum: Vector3<f64>, seen| {
            sum + seen.from_center / n
        })
}

fn norm2(x: f64, y: f64) -> f64 {
    libm::sqrt(x * x + y * y)
}

/// The plane that the axes' positions are nearest to: two directions in it, and its normal.
pub(super) fn plane<const K: usize>(
    view: &View<'_, K>,
    middle: &Vector3<f64>,
) -> [Vector3<f64>; 3] {
    let mut spread = Qr::<3>::new();
    for seen in view.sightings() {
        let off = seen.from_center - middle;
        spread.add([off.x, off.y, off.z], 0.0);
    }
    spread.triangle().svd().right
}
