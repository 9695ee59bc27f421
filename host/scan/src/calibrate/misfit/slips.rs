//! What may be wrong about a machine's axes, and what each of it would do to where the flange stands.

use nalgebra::Vector3;
use umi_kinematics::{AxisChain, JointKind, Pose};

use crate::rigid::{rotation, rotation_vector};

/// One thing that may be wrong about one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisSlip {
    /// In the words of a machine: "the zero of A".
    pub what: String,
    /// Of its amount.
    pub unit: &'static str,
    /// For each flange what a unit of it does.
    pub moves: Vec<SmallMotion>,
}

/// A small motion, for each unit of what causes it: a point `p` moves by `turn × p + shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmallMotion {
    /// In rad.
    pub turn: Vector3<f64>,
    /// In mm.
    pub shift_mm: Vector3<f64>,
}

impl SmallMotion {
    /// What moves at a point.
    pub(in crate::calibrate) fn at(&self, p_mm: &Vector3<f64>) -> Vector3<f64> {
        self.turn.cross(p_mm) + self.shift_mm
    }
}

/// The machine and the joints' values, off by an amount.
type Wrong<'a> = Box<dyn Fn(&mut AxisChain, &mut Vec<f64>, f64) + 'a>;

impl AxisSlip {
    /// All that may be wrong about the axes that move: the zero and place of a rotary one, the direction and
    /// scale of any; what happens most comes first. What of it shows at all is for the data to say.
    #[must_use]
    pub fn of(machine: &AxisChain, joints: &[Vec<f64>]) -> Vec<Self> {
        let moving = machine
            .moving()
            .filter(|(_, joint)| joint.constant().is_none());
        // One that stands still: whatever is wrong about it, the mount or the artefact takes all of it.
        let moved = moving.filter(|(place, _)| {
            let first = joints.first().and_then(|q| q.get(*place));
            joints.iter().any(|q| q.get(*place) != first)
        });
        let mut slips = Vec::new();
        for (place, joint) in moved {
            let mut take =
                |rank: u8, what: String, unit: &'static str, step: f64, wrong: Wrong<'_>| {
                    let slip = Self::by(what, unit, (machine, joints), (step, &wrong));
                    slips.push((rank, slip));
                };
            let name = &joint.name;
            let rotary = joint.kind == JointKind::Rotary;
            if rotary {
                let wrong: Wrong<'_> = Box::new(move |_, q, deg| q[place] += deg);
                take(0, format!("the zero of {name}"), "deg", 1e-3, wrong);
            }
            let wrong: Wrong<'_> = Box::new(move |_, q, ppm| q[place] *= 1.0 + ppm * 1e-6);
            take(3, format!("the scale of {name}"), "ppm", 10.0, wrong);
            let along = joint.direction.iamax();
            for axis in (0..3).filter(|axis| *axis != along) {
                let by = ["X", "Y", "Z"][axis];
                if rotary {
                    let wrong: Wrong<'_> =
                        Box::new(move |machine, _, mm| machine.joints[place].point_mm[axis] += mm);
                    take(
                        1,
                        format!("the place of {name} along {by}"),
                        "mm",
                        1e-2,
                        wrong,
                    );
                }
                let wrong: Wrong<'_> = Box::new(move |machine, _, deg| {
                    let turn = rotation(&Vector3::ith(axis, deg.to_radians()));
                    let joint = &mut machine.joints[place];
                    joint.direction = turn * joint.direction;
                });
                take(
                    2,
                    format!("the direction of {name} about {by}"),
                    "deg",
                    1e-3,
                    wrong,
                );
            }
        }
        slips.sort_by_key(|(rank, _)| *rank);
        slips.into_iter().map(|(_, slip)| slip).collect()
    }

    /// By differences of the flange's place, so much to either side.
    fn by(
        what: String,
        unit: &'static str,
        (machine, joints): (&AxisChain, &[Vec<f64>]),
        (step, wrong): (f64, &Wrong<'_>),
    ) -> Self {
        let flange = |q: &[f64], amount: f64| {
            let (mut machine, mut q) = (machine.clone(), q.to_vec());
            wrong(&mut machine, &mut q, amount);
            machine.flange_in_workpiece(&q)
        };
        let moves = joints.iter().map(|q| {
            let (up, down): (Pose, Pose) = (flange(q, step), flange(q, -step));
            let by = 0.5 / step;
            let turn = rotation_vector(&(up.rotation * down.rotation.transpose())) * by;
            let middle = 0.5 * (up.translation_mm + down.translation_mm);
            SmallMotion {
                turn,
                shift_mm: (up.translation_mm - down.translation_mm) * by - turn.cross(&middle),
            }
        });
        Self {
            what,
            unit,
            moves: moves.collect(),
        }
    }
}
