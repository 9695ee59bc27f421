//! A centre that lies off all others, or all centres at an angle that was written down wrong, and the angle at which they
//! would not.

use nalgebra::Vector3;
use serde::Serialize;
use umi_kinematics::Pose;

use super::stray::{Observed, Stray, stray};
use super::{AxisModel, TurnedCentre};
use crate::calibrate::solve::descend;

/// A wrong angle leaves a ball on its circle: of what it is off by, at most this share is not along that, or so many
/// standard deviations of a coordinate.
const OFF_CIRCLE: f64 = 0.1;
const OF_NOISE: f64 = 5.0;

/// What lies off all others.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AxisOutlier {
    /// The rows in the file, counted from 1 behind the header: one, all at an angle, or two that hide each other.
    pub rows: Vec<usize>,
    /// What they stand at, where that is one angle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_deg: Option<f64>,
    /// How far the farthest lies from where the others have it, in mm.
    pub off_mm: f64,
    /// The chance that one of so many lies so far off where all belong together.
    pub p: f64,
    /// The angle at which the others have them there, where the angle alone may be wrong.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_by_others_deg: Option<f64>,
}

impl AxisOutlier {
    /// What is to be said of it.
    #[must_use]
    pub fn words(&self) -> String {
        let (rows, all) = match &self.rows[..] {
            [row] => (format!("row {row}"), "lies"),
            rows => {
                let rows: Vec<String> = rows.iter().map(ToString::to_string).collect();
                (format!("rows {}", rows.join(", ")), "lie up to")
            }
        };
        let at = self
            .angle_deg
            .map_or_else(String::new, |angle| format!(" (at {angle} degrees)"));
        let head = format!(
            "{rows}{at} {all} {:.4} mm from where the others have the ball",
            self.off_mm
        );
        match self.angle_by_others_deg {
            Some(angle) => format!(
                "{head}; they have it there at {angle:.4} degrees: look at the angle that was written there, or measure \
                 again"
            ),
            None => {
                format!("{head}: look at the coordinates and the ball's name, or measure again")
            }
        }
    }
}

/// Looks for a centre, or an angle with several, that lies off the others, at the optimum.
pub(super) fn outlier(model: &AxisModel<'_>) -> Option<AxisOutlier> {
    let (angles, at_angle) = model.by_angle();
    let mut at_each = vec![0; angles.len()];
    for place in &at_angle {
        at_each[*place] += 1;
    }
    let by_centre = stray(
        model,
        &Observed {
            of: &|row| row / 3,
            residuals: &|_| 3,
        },
    );
    let by_angle = stray(
        model,
        &Observed {
            of: &|row| at_angle[row / 3],
            residuals: &|angle| 3 * at_each[angle],
        },
    );
    // Of an angle with one centre both say the same.
    let centres = by_centre.map(|found| (found.numbers.clone(), found));
    let angles = by_angle.map(|found| {
        let all = 0..model.centres.len();
        let there = all.filter(|&centre| found.numbers.contains(&at_angle[centre]));
        (there.collect(), found)
    });
    // The simplest of what there may be: one rather than two.
    let all = [centres, angles].into_iter().flatten();
    let (out, found) = all.min_by(|a, b| {
        let few = |of: &(Vec<usize>, Stray)| of.1.numbers.len();
        few(a).cmp(&few(b)).then(a.1.p.total_cmp(&b.1.p))
    })?;
    Some(model.without(&out, &found))
}

impl AxisModel<'_> {
    /// The angles in the order of their appearance, and for each centre which it is at.
    pub(super) fn by_angle(&self) -> (Vec<f64>, Vec<usize>) {
        let mut angles: Vec<f64> = Vec::new();
        let at = self.centres.iter().map(|centre| {
            let place = angles.iter().position(|known| *known == centre.angle_deg);
            place.unwrap_or_else(|| {
                angles.push(centre.angle_deg);
                angles.len() - 1
            })
        });
        let at = at.collect();
        (angles, at)
    }

    /// What the others say of these centres.
    fn without(&self, out: &[usize], found: &Stray) -> AxisOutlier {
        let kept = |place: &usize| !out.contains(place);
        let centres: Vec<TurnedCentre> = (0..self.centres.len())
            .filter(kept)
            .map(|place| self.centres[place])
            .collect();
        let angles_rad = (0..self.centres.len())
            .filter(kept)
            .map(|place| self.angles_rad[place])
            .collect();
        let mut others = AxisModel {
            centres: &centres,
            angles_rad,
            origin_mm: self.origin_mm,
            direction: self.direction,
            point_mm: self.point_mm,
            balls_mm: self.balls_mm.clone(),
        };
        descend(&mut others, 100);
        let seen = || {
            out.iter().map(|&place| {
                let centre = &self.centres[place];
                (centre.ball, centre.measured_mm - self.origin_mm)
            })
        };
        let off_mm = |angle_rad: f64| {
            let each = seen().map(|(ball, at)| (at - others.place(ball, angle_rad)).norm());
            each.fold(0.0, f64::max)
        };
        let written = out
            .iter()
            .zip(seen())
            .map(|(&place, (ball, at))| (at - others.place(ball, self.angles_rad[place])).norm());
        let off = written.fold(0.0, f64::max);
        let first = self.centres[out[0]].angle_deg;
        let is_one = out.iter().all(|&at| self.centres[at].angle_deg == first);
        let angle_deg = is_one.then_some(first);
        let turned_rad = others.turned_to(seen());
        let on_circle = off_mm(turned_rad) < (OFF_CIRCLE * off).max(OF_NOISE * found.others_mm);
        AxisOutlier {
            rows: out.iter().map(|place| place + 1).collect(),
            angle_deg,
            off_mm: off,
            p: found.p,
            angle_by_others_deg: angle_deg.filter(|_| on_circle).map(|written_deg| {
                let found_deg = turned_rad.to_degrees();
                // In the turn that the file counts.
                found_deg + 360.0 * ((written_deg - found_deg) / 360.0).round()
            }),
        }
    }

    /// Where a ball is at an angle.
    fn place(&self, ball: usize, angle_rad: f64) -> Vector3<f64> {
        let turn = Pose::turn(&self.direction, &self.point_mm, angle_rad);
        turn.point(&self.balls_mm[ball])
    }

    /// The angle at which balls come nearest to places, in least squares.
    fn turned_to(&self, seen: impl Iterator<Item = (usize, Vector3<f64>)>) -> f64 {
        let u = &self.direction;
        let (mut sin, mut cos) = (0.0, 0.0);
        for (ball, place_mm) in seen {
            let (from, to) = (
                self.balls_mm[ball] - self.point_mm,
                place_mm - self.point_mm,
            );
            sin += u.dot(&from.cross(&to));
            cos += from.dot(&to) - u.dot(&from) * u.dot(&to);
        }
        sin.atan2(cos)
    }
}
