//! Table and head for very many angles.
//!
//! A search asks for a hundred candidates at each pose. What is the same for all of them is worked out once: the parts of each axis'
//! rotation, and the whole pose of an axis at an angle of the raster. The answers are those of
//! [`PlanMachine::stand`] to the last digit: sums and products are the same, in the same order.

use nalgebra::{Matrix3, Vector3};
use umi_kinematics::Pose;

use super::super::super::machine::{AxesStand, PlanMachine};

/// A rotary axis, made ready for many angles.
struct Turner {
    /// Its direction as a cross product, and that twice.
    cross: Matrix3<f64>,
    square: Matrix3<f64>,
    point_mm: Vector3<f64>,
}

impl Turner {
    fn at(&self, degrees: f64) -> Pose {
        let angle = degrees.to_radians();
        let half = (0.5 * angle).sin();
        let rotation =
            Matrix3::identity() + self.cross * angle.sin() + self.square * (2.0 * half * half);
        Pose {
            rotation,
            translation_mm: self.point_mm - rotation * self.point_mm,
        }
    }
}

/// The rotary axes of a machine, with what they carry.
pub(super) struct Turners {
    axes: Vec<Turner>,
    tables: usize,
    workpiece: Pose,
    sensor: Pose,
}

/// Where table and head stand, and the head without the sensor: the spindle comes between them.
pub(super) struct Standing {
    table: Pose,
    turned: Option<Pose>,
    head: Pose,
}

impl Standing {
    pub(super) fn axes(&self) -> AxesStand {
        AxesStand::of(self.table, self.head)
    }
}

impl Turners {
    pub(super) fn new(machine: &PlanMachine) -> Self {
        let axis = |joint: &umi_kinematics::Joint| {
            let cross = joint.direction.cross_matrix();
            Turner {
                cross,
                square: cross * cross,
                point_mm: joint.point_mm,
            }
        };
        Turners {
            axes: machine.chain.joints[3..].iter().map(axis).collect(),
            tables: machine.table.len(),
            workpiece: machine.chain.workpiece,
            sensor: machine.chain.sensor,
        }
    }

    /// The pose of one axis at an angle.
    pub(super) fn one(&self, place: usize, degrees: f64) -> Pose {
        self.axes[place].at(degrees)
    }

    /// One behind the other; an axis at zero turns nothing.
    fn behind(
        &self,
        places: std::ops::Range<usize>,
        angles: &[f64],
        known: Option<(usize, &Pose)>,
    ) -> Option<Pose> {
        let turning = places.filter(|k| angles[*k] != 0.0);
        turning
            .map(|k| match known {
                Some((place, pose)) if place == k => *pose,
                _ => self.axes[k].at(angles[k]),
            })
            .reduce(|pose, next| pose.after(&next))
    }

    /// Table and head at these angles (table, head, S); `known` is the pose of an axis at its angle.
    pub(super) fn stand(&self, angles: &[f64], known: Option<(usize, &Pose)>) -> Standing {
        let or_still = |pose: Option<Pose>| pose.unwrap_or_else(Pose::identity);
        let table = or_still(self.behind(0..self.tables, angles, known)).after(&self.workpiece);
        let turned = self.behind(self.tables..self.axes.len(), angles, known);
        Standing {
            table,
            turned,
            head: or_still(turned).after(&self.sensor),
        }
    }

    /// The same with the last axis, a spindle that stood at zero, at an angle.
    pub(super) fn with_spindle(&self, standing: &Standing, degrees: f64) -> AxesStand {
        let head = match (self.axes.last(), degrees != 0.0) {
            (Some(spindle), true) => {
                let spindle = spindle.at(degrees);
                let turned = standing.turned.map_or(spindle, |pose| pose.after(&spindle));
                turned.after(&self.sensor)
            }
            _ => standing.head,
        };
        AxesStand::of(standing.table, head)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::Vector3;

    use super::Turners;
    use crate::plan::spec::ScanSpec;

    /// Bit for bit: a plan must not change by how its poses are reckoned.
    #[test]
    fn table_and_head_are_the_machines_to_the_last_digit() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan");
        let at = Vector3::new(17.3, -40.1, 8.25);
        for file in ["step_wavy.toml", "kinematics_ac.toml", "three_axes.toml"] {
            let machine = ScanSpec::open(&folder.join(file)).unwrap().machine;
            let turners = Turners::new(&machine);
            let count = machine.limits().len() - 3;
            for k in 0..200 {
                let mut angles: Vec<f64> = (0..count)
                    .map(|axis| {
                        let angle = 360.0 * (f64::from(k) * 0.37 + 0.21 * axis as f64).sin();
                        // An axis at zero turns nothing: some stand there.
                        if (k as usize + axis).is_multiple_of(5) {
                            0.0
                        } else {
                            angle
                        }
                    })
                    .collect();
                let places = 0..count;
                let known: Vec<_> = places.map(|p| turners.one(p, angles[p])).collect();
                for (place, pose) in known.iter().enumerate() {
                    let stand = turners.stand(&angles, Some((place, pose))).axes();
                    let wanted = machine.stand(&angles);
                    assert_eq!(stand.beam(), wanted.beam());
                    assert_eq!(stand.line(), wanted.line());
                    assert_eq!(stand.carriage(&at), wanted.carriage(&at));
                }
                if machine.orient_deg.is_some() {
                    let spindle = std::mem::replace(&mut angles[count - 1], 0.0);
                    let standing = turners.stand(&angles, None);
                    let found = turners.with_spindle(&standing, spindle);
                    angles[count - 1] = spindle;
                    let wanted = machine.stand(&angles);
                    assert_eq!(found.beam(), wanted.beam());
                    assert_eq!(found.line(), wanted.line());
                    assert_eq!(found.carriage(&at), wanted.carriage(&at));
                }
            }
        }
    }
}
