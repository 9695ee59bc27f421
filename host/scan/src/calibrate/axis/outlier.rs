//! A centre that lies off all others, and the angle at which it would not.

use nalgebra::Vector3;
use serde::Serialize;

use super::{AxisModel, TurnedCentre};
use crate::calibrate::misfit::stray::stray;
use crate::calibrate::solve::descend;

/// A wrong angle leaves a ball on its circle: of what it is off by, at most this share is not along that, or so many
/// standard deviations of a coordinate.
const OFF_CIRCLE: f64 = 0.1;
const OF_NOISE: f64 = 5.0;

/// A centre that lies off all others.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AxisOutlier {
    /// Its row in the file, counted from 1 behind the header.
    pub row: usize,
    /// What it stands at.
    pub angle_deg: f64,
    /// How far it lies from where the others have it, in mm.
    pub off_mm: f64,
    /// The chance that one of so many lies so far off where all belong together.
    pub p: f64,
    /// The angle at which the others have the ball there, where the angle alone may be wrong.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_by_others_deg: Option<f64>,
}

impl AxisOutlier {
    /// What is to be said of it.
    #[must_use]
    pub fn words(&self) -> String {
        let head = format!(
            "row {} (at {} degrees) lies {:.4} mm from where all others have that ball",
            self.row, self.angle_deg, self.off_mm
        );
        match self.angle_by_others_deg {
            Some(angle) => format!(
                "{head}; they have it there at {angle:.4} degrees: look at the angle in that row, or measure it again"
            ),
            None => {
                format!("{head}: look at its coordinates and the ball's name, or measure it again")
            }
        }
    }
}

/// Looks for one at the optimum.
pub(super) fn outlier(model: &AxisModel<'_>) -> Option<AxisOutlier> {
    let found = stray(model, 3)?;
    let mut centres: Vec<TurnedCentre> = model.centres.to_vec();
    let mut angles_rad = model.angles_rad.clone();
    let centre = centres.remove(found.place);
    let angle_rad = angles_rad.remove(found.place);
    let mut others = AxisModel {
        centres: &centres,
        angles_rad,
        origin_mm: model.origin_mm,
        direction: model.direction,
        point_mm: model.point_mm,
        balls_mm: model.balls_mm.clone(),
    };
    descend(&mut others, 100);
    let seen = centre.measured_mm - model.origin_mm;
    let off = seen - others.place(centre.ball, angle_rad);
    let turned_rad = others.turned_to(centre.ball, &seen);
    let left = seen - others.place(centre.ball, turned_rad);
    let on_circle = left.norm() < (OFF_CIRCLE * off.norm()).max(OF_NOISE * found.others_mm);
    let angle_by_others_deg = on_circle.then(|| turned_rad.to_degrees()).map(|found| {
        // In the turn that the file counts.
        let turns = ((centre.angle_deg - found) / 360.0).round();
        found + 360.0 * turns
    });
    Some(AxisOutlier {
        row: found.place + 1,
        angle_deg: centre.angle_deg,
        off_mm: off.norm(),
        p: found.p,
        angle_by_others_deg,
    })
}

impl AxisModel<'_> {
    /// Where a ball is at an angle.
    fn place(&self, ball: usize, angle_rad: f64) -> Vector3<f64> {
        let turn = umi_kinematics::Pose::turn(&self.direction, &self.point_mm, angle_rad);
        turn.point(&self.balls_mm[ball])
    }

    /// The angle at which a ball comes nearest to a place.
    fn turned_to(&self, ball: usize, place_mm: &Vector3<f64>) -> f64 {
        let u = &self.direction;
        let (from, to) = (
            self.balls_mm[ball] - self.point_mm,
            place_mm - self.point_mm,
        );
        let sin = u.dot(&from.cross(&to));
        let cos = from.dot(&to) - u.dot(&from) * u.dot(&to);
        sin.atan2(cos)
    }
}
