//! A place of the part in its raw part, with the margins of all points there.

use nalgebra::Vector6;

use super::demand::Rule;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3, stepped};
use crate::solve::linear::{MarginRow, WIDTH, highest};
use crate::solve::{Measured, measure};
use crate::surface::CompositeSurface;

/// A search for the best place.
pub(super) struct Search<'a> {
    /// The finished part.
    pub surface: &'a CompositeSurface,
    /// The points of the raw part.
    pub points: &'a [Vec3],
    /// What each face demands.
    pub rules: &'a [Rule],
    /// Turns, then shifts.
    pub locked: [bool; 6],
    /// Where the turns go through, in the frame of the scan.
    pub pivot: Vec3,
    /// Scan from part, where the search begins.
    pub start: Pose,
    /// The corners of the part, in its coordinates.
    pub corners: [Vec3; 8],
    /// How far the part may go at most from where its stock is most even, in mm.
    pub far_mm: f64,
    /// Threads.
    pub threads: Threads,
}

/// What every stock gains at least of a motion by which the part leaves, per mm: draft of a tenth of a degree is more.
const LEAVES: f64 = 1e-3;

/// The shift of the part, in the frame of the scan, by which every margin grows without end; none where one does not.
///
/// `locked`: turns, then shifts.
pub(super) fn free_motion(
    measured: &[Measured],
    rules: &[Rule],
    locked: &[bool; WIDTH],
) -> Option<Vec3> {
    if (measured.iter()).any(|m| matches!(rules[m.face], Rule::Profile(_))) {
        return None;
    }
    let gains =
        |m: &Measured| Vec3::from_fn(|i, _| if locked[3 + i] { 0.0 } else { -m.direction[i] });
    let row = |gains: Vec3| MarginRow {
        value: 0.0,
        gradient: [0.0, 0.0, 0.0, gains.x, gains.y, gains.z],
    };
    let rows: Vec<MarginRow> = measured.iter().map(|m| row(gains(m))).collect();
    let [.., x, y, z] = highest(&rows, 1.0)?.step;
    // The programme's own is a corner of its reach: where the mean is a way out too, it is the straighter one.
    [measured.iter().map(gains).sum::<Vec3>(), Vec3::new(x, y, z)]
        .iter()
        .filter_map(|away| away.try_normalize(0.0))
        .find(|away| measured.iter().all(|m| gains(m).dot(away) > LEAVES))
}

/// A place that was tried.
pub(super) struct Place {
    /// The step from the start: turns about the pivot, then shifts in mm.
    pub x: Vector6<f64>,
    /// Scan from part.
    pub motion: Pose,
    /// Every point there.
    pub measured: Vec<Measured>,
    /// The least margin in mm.
    pub least: f64,
}

impl Search<'_> {
    /// The place that is `x` from the start. `faces`: those that were nearest a moment ago, or nothing.
    pub fn place(&self, x: Vector6<f64>, faces: &[usize]) -> Place {
        let mut x = x;
        for i in 0..6 {
            if self.locked[i] {
                x[i] = 0.0;
            }
        }
        let motion = stepped(&self.start, &x, &self.pivot);
        let measured = measure(self.surface, self.points, &motion, faces, self.threads);
        let least = measured
            .iter()
            .map(|m| self.rules[m.face].margin(m.distance_mm))
            .fold(f64::INFINITY, f64::min);
        Place {
            x,
            motion,
            measured,
            least,
        }
    }

    /// How the distance from `q` to a plane that stands still changes with a step from `here`, the plane's normal or the
    /// direction of a distance being `direction`; with the sign turned.
    pub fn slopes(&self, here: &Place, q: &Vec3, direction: &Vec3, arm: f64) -> [f64; WIDTH] {
        let pivot = self.pivot + Vec3::new(here.x[3], here.x[4], here.x[5]);
        let turned = crate::solve::left_jacobian(&Vec3::new(here.x[0], here.x[1], here.x[2]));
        let turn = turned.tr_mul(&(q - pivot).cross(direction)) / arm;
        let all = [
            turn.x,
            turn.y,
            turn.z,
            direction.x,
            direction.y,
            direction.z,
        ];
        std::array::from_fn(|i| if self.locked[i] { 0.0 } else { all[i] })
    }
}
