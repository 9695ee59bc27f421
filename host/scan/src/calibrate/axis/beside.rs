//! An axis beside the one that a machine file has: whether it is that joint's, and certain enough to go into the file.

use nalgebra::Vector3;
use serde::Serialize;
use umi_kinematics::{Joint, JointKind};

use super::AxisAnswer;
use crate::ScanError;

/// Axes of machines lie where they are drawn to within some hundredths of a degree; another axis, or a head's oblique
/// one, lies by far more than this from it.
const ANOTHER_DEG: f64 = 10.0;
/// What lies farther from the file's axis than this may be another's, or in another unit.
const FAR_MM: f64 = 5.0;
/// It is another's where it lies so many times as near to that.
const NEARER: f64 = 0.2;
/// As a mount's, the most that goes into a machine file: standard uncertainties.
const MOST_TURN: f64 = 1e-3;
const MOST_SHIFT_MM: f64 = 1.0;

/// How far an axis was found from where a machine file has it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AxisMove {
    /// Its name there.
    pub joint: String,
    /// The angle between both.
    pub turned_deg: f64,
    /// How far the file's `point_mm` lies from the axis.
    pub moved_mm: f64,
}

impl AxisAnswer {
    /// How the axis lies beside the one that a machine file has; `others`: all joints there.
    ///
    /// # Errors
    /// `other_axis` where it turns the other way, points elsewhere, or lies near another joint: the centres are that one's.
    pub fn beside(&self, joint: &Joint, others: &[Joint]) -> Result<AxisMove, ScanError> {
        let (name, u) = (&joint.name, Vector3::from(self.direction));
        let cosine = u.dot(&joint.direction);
        let turn_deg = u.cross(&joint.direction).norm().atan2(cosine).to_degrees();
        if turn_deg > 180.0 - ANOTHER_DEG {
            return Err(ScanError::refused(
                "other_axis",
                format_args!(
                    "{name} turns the other way than the machine file has it: its direction and the angles of these centres \
                     contradict each other. Look at the sign of counts_per_deg and of the column angle_deg"
                ),
            ));
        }
        if turn_deg > ANOTHER_DEG {
            return Err(ScanError::refused(
                "other_axis",
                format_args!(
                    "the axis lies {turn_deg:.1} degrees from {name} of the machine file: these centres are of another axis, or \
                     stand in another frame. Look at --axis"
                ),
            ));
        }
        let moved_mm = self.apart_mm(joint);
        let is_nearer = |other: &&Joint| {
            other.name != *name && self.is_along(other) && self.apart_mm(other) < NEARER * moved_mm
        };
        if let Some(other) = others.iter().filter(is_nearer).find(|_| moved_mm > FAR_MM) {
            return Err(ScanError::refused(
                "other_axis",
                format_args!(
                    "the axis lies {moved_mm:.1} mm from {name} of the machine file, and {:.1} mm from {}: these centres are of \
                     that one. Look at --axis",
                    self.apart_mm(other),
                    other.name
                ),
            ));
        }
        Ok(AxisMove {
            joint: name.clone(),
            turned_deg: turn_deg,
            moved_mm,
        })
    }

    /// Whether a joint of the file turns about a line of this direction, either way.
    fn is_along(&self, joint: &Joint) -> bool {
        let cross = Vector3::from(self.direction).cross(&joint.direction);
        joint.kind == JointKind::Rotary && cross.norm() < ANOTHER_DEG.to_radians().sin()
    }

    /// How far the point of a joint lies from the axis.
    fn apart_mm(&self, joint: &Joint) -> f64 {
        let from = joint.point_mm - Vector3::from(self.point_mm);
        from.cross(&Vector3::from(self.direction)).norm()
    }

    /// Refuses an axis that is too uncertain to go into a machine file, which has no room for that, or one of centres of
    /// which one lies off all others.
    ///
    /// # Errors
    /// `outlier`, and which centre; `uncertain`, and what to measure.
    pub fn refuse_doubtful(&self) -> Result<(), ScanError> {
        if let Some(outlier) = &self.outlier {
            return Err(ScanError::refused("outlier", outlier.words()));
        }
        let largest = |of: &Option<[[f64; 3]; 3]>| {
            of.map(|rows| (0..3).fold(0.0, |most: f64, i| most.max(rows[i][i])).sqrt())
        };
        let turn = largest(&self.cov_direction_poses.or(self.cov_direction));
        let shift = largest(&self.cov_point_poses.or(self.cov_point));
        let (Some(turn), Some(shift)) = (turn, shift) else {
            return Err(ScanError::refused(
                "uncertain",
                "so few centres do not say how uncertain the axis is: measure each ball at one angle more",
            ));
        };
        if turn <= MOST_TURN && shift <= MOST_SHIFT_MM {
            return Ok(());
        }
        Err(ScanError::refused(
            "uncertain",
            format_args!(
                "the axis is uncertain by {:.2} mrad and {shift:.3} mm (standard uncertainties; {} mrad and {MOST_SHIFT_MM} mm are \
                 the most that go into a machine file): measure the balls all around, farther from the axis",
                turn * 1e3,
                MOST_TURN * 1e3
            ),
        ))
    }

    /// What is odd about where the axis lies, in words; none where it lies as near as axes do.
    #[must_use]
    pub fn far(&self, beside: &AxisMove) -> Option<String> {
        (beside.moved_mm > FAR_MM).then(|| {
            format!(
                "far: the axis lies {:.1} mm from where the machine file has {}. A preset may be so far off; a machine's own file is \
                 not: look at the unit of the centres, at the frame that they stand in, and at --axis",
                beside.moved_mm, beside.joint
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use umi_kinematics::Drive;

    use super::*;
    use crate::calibrate::axis::{TurnedCentre, axis};

    /// Centres of a ball that turns about Z through (`x_mm`, 0), at these angles.
    fn about(x_mm: f64, angles_deg: &[f64]) -> AxisAnswer {
        let centres: Vec<TurnedCentre> = angles_deg
            .iter()
            .enumerate()
            .map(|(place, &angle_deg)| {
                let (sin, cos) = angle_deg.to_radians().sin_cos();
                let off = if place % 2 == 0 { 1e-3 } else { -1e-3 };
                let measured_mm = Vector3::new(x_mm + (80.0 + off) * cos, 80.0 * sin, off);
                TurnedCentre {
                    angle_deg,
                    ball: 0,
                    measured_mm,
                }
            })
            .collect();
        axis(&centres).unwrap()
    }

    /// What lies at another joint of the file is that one's; what lies far from all of them is told.
    #[test]
    fn an_axis_at_another_joint_is_that_ones() {
        let joint = |name: &str, x_mm: f64| Joint {
            name: name.to_owned(),
            kind: JointKind::Rotary,
            direction: Vector3::z(),
            point_mm: Vector3::new(x_mm, 0.0, 50.0),
            drive: Drive::Named,
        };
        let joints = [joint("C", 0.0), joint("C2", 300.0)];
        let found = about(300.2, &[0.0, 60.0, 120.0, 180.0, 240.0, 300.0]);
        let of = |at: usize| found.beside(&joints[at], &joints);
        let error = of(0).unwrap_err();
        assert!(
            error.code == "other_axis" && error.message.contains("from C2"),
            "{error}"
        );
        assert!(found.far(&of(1).unwrap()).is_none());
        let alone = found.beside(&joints[0], &joints[..1]).unwrap();
        assert!(
            found
                .far(&alone)
                .is_some_and(|text| text.contains("300.2 mm"))
        );
    }

    /// A short arc leaves the axis too uncertain for a machine file, a whole turn does not.
    #[test]
    fn an_uncertain_axis_goes_into_no_file() {
        let error = about(0.0, &[0.0, 1.0, 2.0, 3.0, 4.0])
            .refuse_doubtful()
            .unwrap_err();
        assert!(
            error.code == "uncertain" && error.message.contains("all around"),
            "{error}"
        );
        assert!(
            about(0.0, &[0.0, 72.0, 144.0, 216.0, 288.0])
                .refuse_doubtful()
                .is_ok()
        );
    }
}
