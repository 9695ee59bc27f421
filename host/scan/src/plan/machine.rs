//! The machine as the specification tells it: table, head, spindle's orientation, and where the sensor is mounted.
//!
//! A point p of the part stands in the machine at `T1 T2 (R_part p + t_part)`, a point s of the spindle's frame at
//! `(X, Y, Z) + H1 H2 Rz(S) s`. All frames are right-handed, all angles right-handed about their axis.

use nalgebra::{Matrix3, Vector3};
use umi_kinematics::branches::{self, Aim, ChainRotation};
use umi_kinematics::{AxisChain, Drive, Joint, JointKind, Pose};

/// A rotary axis: a directed line in space at zero angles.
#[derive(Debug, Clone, PartialEq)]
pub struct TurnAxis {
    /// The word of the axis, such as `B`.
    pub name: String,
    /// Unit vector; positive angles turn right-handed about it.
    pub direction: Vector3<f64>,
    /// Any point of the axis.
    pub point_mm: Vector3<f64>,
    /// Least and largest angle.
    pub limits_deg: [f64; 2],
}

/// A pose of the sensor in the part file's frame. Beam and line are unit vectors at a right angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorPose {
    /// Where the rays come from.
    pub origin_mm: Vector3<f64>,
    /// Direction of the middle ray.
    pub beam: Vector3<f64>,
    /// Direction of the laser line.
    pub line: Vector3<f64>,
}

impl SensorPose {
    /// The feed's direction: beam x line.
    pub fn feed(&self) -> Vector3<f64> {
        self.beam.cross(&self.line)
    }
}

/// A spindle that turns the line and nothing else.
pub(super) struct LineSpindle {
    pub limits_deg: [f64; 2],
    /// It has less than a whole turn: not every line is reached.
    pub narrow: bool,
}

/// The chain from axis values to the sensor's pose on the part, and back.
///
/// Axis values are in the order X, Y, Z (mm), table, head, then S where the spindle turns (degrees).
#[derive(Debug, Clone)]
pub struct PlanMachine {
    /// Least and largest X, Y, Z.
    pub travel_mm: [[f64; 2]; 3],
    /// Limits of the spindle's orientation, where it turns.
    pub orient_deg: Option<[f64; 2]>,
    /// The word of the spindle's orientation in a program.
    pub orient_word: String,
    /// Table axes, from the base outwards.
    pub table: Vec<TurnAxis>,
    /// Head axes, from the carriage outwards.
    pub head: Vec<TurnAxis>,
    /// The same as joints: X Y Z, table, head, S; beam = -z and line = x of the sensor's frame.
    pub chain: AxisChain,
}

/// Table and head at certain angles.
#[derive(Debug, Clone, Copy)]
pub struct AxesStand {
    /// Machine from part.
    table: Pose,
    /// Carriage from the sensor's frame.
    head: Pose,
}

impl AxesStand {
    /// Machine from part, and carriage from the sensor's frame.
    pub(super) fn of(table: Pose, head: Pose) -> Self {
        AxesStand { table, head }
    }

    /// The beam in the part's frame.
    pub fn beam(&self) -> Vector3<f64> {
        -self.table.rotation.tr_mul(&self.head.rotation.column(2))
    }

    /// The line in the part's frame.
    pub fn line(&self) -> Vector3<f64> {
        self.table.rotation.tr_mul(&self.head.rotation.column(0))
    }

    /// X, Y, Z that bring the sensor's origin to a point of the part's frame.
    pub fn carriage(&self, origin_mm: &Vector3<f64>) -> Vector3<f64> {
        self.table.point(origin_mm) - self.head.translation_mm
    }
}

/// What stands between a pose and its axis values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReachFault {
    /// The rotary axes can point the sensor so only outside their limits, or X, Y, Z end before.
    AxisLimit,
    /// No angles whatever point the sensor so.
    Unreachable,
}

/// All ways of the axes to one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct ReachedPose {
    /// One set of axis values for each branch within the limits; angles nearest to zero.
    pub solutions: Vec<Vec<f64>>,
    /// An axis is free, at a pole or because three rotations have a beam alone to point: it stands at zero, or at the angle
    /// nearest to zero that the limits allow.
    pub singular: bool,
}

/// Beam and line of a table are unit vectors at a right angle by this: six decimals.
pub(super) const UNIT: f64 = 2e-6;

/// Steps in which an axis is held that is free, where it cannot stand at zero.
const HELD_STEP_DEG: f64 = 0.5;

fn joint(name: &str, kind: JointKind, direction: Vector3<f64>, point_mm: Vector3<f64>) -> Joint {
    Joint {
        name: name.into(),
        kind,
        direction,
        point_mm,
        drive: Drive::Named,
    }
}

impl PlanMachine {
    /// Puts the chain together; `mount` is origin, beam and line in the spindle's frame.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn new(
        travel_mm: [[f64; 2]; 3],
        orient_deg: Option<[f64; 2]>,
        orient_word: String,
        mount: [Vector3<f64>; 3],
        table: Vec<TurnAxis>,
        head: Vec<TurnAxis>,
        part_rotation_deg: Vector3<f64>,
        part_translation_mm: Vector3<f64>,
    ) -> Self {
        let origin = Vector3::zeros();
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
        let mut joints: Vec<Joint> = [("X", x), ("Y", y), ("Z", z)]
            .map(|(name, along)| joint(name, JointKind::Linear, along, origin))
            .to_vec();
        for a in table.iter().chain(&head) {
            joints.push(joint(&a.name, JointKind::Rotary, a.direction, a.point_mm));
        }
        let heads = 3 + table.len()..joints.len();
        let mut sensor_chain: Vec<usize> = (0..3).chain(heads).collect();
        if orient_deg.is_some() {
            sensor_chain.push(joints.len());
            joints.push(joint("S", JointKind::Rotary, z, origin));
        }
        let [mount_origin_mm, beam, line] = mount;
        // A residue below the reader's 1e-6 goes, so that beam and line are square to the last digit.
        let line = (line - beam * beam.dot(&line)).normalize();
        let turns = part_rotation_deg.map(f64::to_radians);
        let part = Pose::turn(&z, &origin, turns.z)
            .after(&Pose::turn(&y, &origin, turns.y))
            .after(&Pose::turn(&x, &origin, turns.x));
        PlanMachine {
            chain: AxisChain {
                sensor_chain,
                workpiece_chain: (3..3 + table.len()).collect(),
                sensor: Pose {
                    rotation: Matrix3::from_columns(&[line, line.cross(&beam), -beam]),
                    translation_mm: mount_origin_mm,
                },
                sensor_covariance: None,
                workpiece: Pose {
                    rotation: part.rotation,
                    translation_mm: part_translation_mm,
                },
                joints,
            },
            travel_mm,
            orient_deg,
            orient_word,
            table,
            head,
        }
    }

    /// Names of the axes in the order of their values.
    pub fn names(&self) -> Vec<&str> {
        let mut names = vec!["X", "Y", "Z"];
        names.extend(self.table.iter().chain(&self.head).map(|a| a.name.as_str()));
        if self.orient_deg.is_some() {
            names.push("S");
        }
        names
    }

    /// Limits of the axes in the order of their values.
    pub fn limits(&self) -> Vec<[f64; 2]> {
        let mut limits = self.travel_mm.to_vec();
        limits.extend(self.table.iter().chain(&self.head).map(|a| a.limits_deg));
        limits.extend(self.orient_deg);
        limits
    }

    /// How many table and head axes there are.
    pub fn turns(&self) -> usize {
        self.table.len() + self.head.len()
    }

    /// Machine from part, at these angles (table, head, S).
    fn table_at(&self, angles: &[f64]) -> Pose {
        self.turned_by(0..self.table.len(), angles)
            .after(&self.chain.workpiece)
    }

    /// Carriage from the sensor's frame, at these angles.
    fn head_at(&self, angles: &[f64]) -> Pose {
        self.turned_by(self.table.len()..self.chain.joints.len() - 3, angles)
            .after(&self.chain.sensor)
    }

    /// Rotary axes one behind the other; an axis at zero turns nothing.
    fn turned_by(&self, places: std::ops::Range<usize>, angles: &[f64]) -> Pose {
        let joints = &self.chain.joints[3..];
        let turning = places.filter(|k| angles[*k] != 0.0);
        turning
            .map(|k| joints[k].transform(angles[k]))
            .reduce(|pose, next| pose.after(&next))
            .unwrap_or_else(Pose::identity)
    }

    /// The sensor's pose in the part file's frame. `axes` are as many as [`Self::names`].
    pub fn forward(&self, axes: &[f64]) -> SensorPose {
        let pose = self.chain.sensor_in_workpiece(axes);
        SensorPose {
            origin_mm: pose.translation_mm,
            beam: -pose.rotation.column(2),
            line: pose.rotation.column(0).into_owned(),
        }
    }

    /// Table and head at these angles (table, head, S).
    pub fn stand(&self, angles: &[f64]) -> AxesStand {
        AxesStand {
            table: self.table_at(angles),
            head: self.head_at(angles),
        }
    }

    /// Beam and line in the part's frame at these angles (table, head, S).
    pub fn pointing(&self, angles: &[f64]) -> (Vector3<f64>, Vector3<f64>) {
        let stand = self.stand(angles);
        (stand.beam(), stand.line())
    }

    /// The beam of [`Self::pointing`] alone: of a vector that is turned about each axis, not of two poses.
    pub fn beam(&self, angles: &[f64]) -> Vector3<f64> {
        let joints = &self.chain.joints[3..];
        let turned = |v: Vector3<f64>, joint: &Joint, degrees: f64| {
            let (s, c) = degrees.to_radians().sin_cos();
            let axis = joint.direction;
            v * c + axis.cross(&v) * s + axis * (axis.dot(&v) * (1.0 - c))
        };
        let mut beam = -self.chain.sensor.rotation.column(2).into_owned();
        for k in (self.table.len()..joints.len()).rev() {
            beam = turned(beam, &joints[k], angles[k]);
        }
        for k in 0..self.table.len() {
            beam = turned(beam, &joints[k], -angles[k]);
        }
        self.chain.workpiece.rotation.tr_mul(&beam)
    }

    /// X, Y, Z that bring the sensor's origin to a point of the part's frame, at these angles (table, head, S).
    pub fn carriage(&self, origin_mm: &Vector3<f64>, angles: &[f64]) -> Vector3<f64> {
        self.stand(angles).carriage(origin_mm)
    }

    /// A direction of the part's frame in the machine's, at these angles.
    pub fn direction_off_part(&self, direction: &Vector3<f64>, angles: &[f64]) -> Vector3<f64> {
        self.table_at(angles).rotation * direction
    }

    /// The part in the machine, at these angles (table, head, S).
    pub(super) fn part_in_machine(&self, angles: &[f64]) -> Pose {
        self.table_at(angles)
    }

    /// The sensor's frame (line, -feed, -beam) from X Y Z, at these angles.
    pub(super) fn sensor_on_carriage(&self, angles: &[f64]) -> Pose {
        self.head_at(angles)
    }

    /// Do all values lie within the limits, by a billionth at most?
    pub fn within_limits(&self, axes: &[f64]) -> bool {
        axes.iter()
            .zip(self.limits())
            .all(|(v, [low, high])| *v >= low - 1e-9 && *v <= high + 1e-9)
    }

    /// Does the spindle turn the line about the beam and nothing else?
    pub fn line_by_spindle(&self) -> bool {
        self.orient_deg.is_some() && self.mounted().0.cross(&Vector3::z()).norm() < 1e-9
    }

    /// A spindle that turns the line alone.
    pub(super) fn line_spindle(&self) -> Option<LineSpindle> {
        let limits_deg = self.orient_deg.filter(|_| self.line_by_spindle())?;
        let [low, high] = limits_deg;
        let narrow = high - low < 360.0;
        Some(LineSpindle { limits_deg, narrow })
    }

    /// The same machine with its spindle standing at an angle: its axis values are these without S.
    pub(super) fn with_spindle_at(&self, degrees: f64) -> Self {
        let mut machine = self.clone();
        if machine.orient_deg.take().is_some()
            && let Some(spindle) = machine.chain.joints.pop()
        {
            machine.chain.sensor_chain.pop();
            machine.chain.sensor = spindle.transform(degrees).after(&machine.chain.sensor);
        }
        machine
    }

    /// The rotations from the sensor inwards to the part, with the place of each in the angles. As seen from the
    /// sensor, head and spindle turn the part the other way.
    fn joints(&self) -> Vec<(usize, ChainRotation)> {
        let mut joints = Vec::new();
        if let Some(limits_deg) = self.orient_deg {
            joints.push((
                self.turns(),
                ChainRotation {
                    direction: -Vector3::z(),
                    limits_deg,
                },
            ));
        }
        for (k, a) in self.head.iter().enumerate().rev() {
            joints.push((
                self.table.len() + k,
                ChainRotation {
                    direction: -a.direction,
                    limits_deg: a.limits_deg,
                },
            ));
        }
        for (k, a) in self.table.iter().enumerate() {
            joints.push((
                k,
                ChainRotation {
                    direction: a.direction,
                    limits_deg: a.limits_deg,
                },
            ));
        }
        joints
    }

    /// All axis values that bring origin and beam there, and the line where one is given.
    ///
    /// Without a line, the spindle stays at zero (or its limit nearest to it), as does the rotation nearest to the
    /// sensor where three would have to share a direction.
    ///
    /// # Errors
    ///
    /// [`ReachFault`] where no branch lies within the limits.
    pub fn inverse(
        &self,
        origin_mm: &Vector3<f64>,
        beam: &Vector3<f64>,
        line: Option<&Vector3<f64>>,
    ) -> Result<ReachedPose, ReachFault> {
        let joints = self.joints();
        let turns: Vec<ChainRotation> = joints.iter().map(|(_, t)| t.clone()).collect();
        let mounted = self.mounted();
        let aim = Aim {
            beam: (self.part_direction(beam), mounted.0),
            line: line.map(|l| (self.part_direction(l), mounted.1)),
        };
        let found = branches::aim(&turns, &aim);
        let complete = |angles: &[f64]| {
            let mut axes = vec![0.0; 3 + joints.len()];
            for ((place, turn), angle) in joints.iter().zip(angles) {
                axes[3 + place] = branches::nearest_turn(*angle, turn.limits_deg, 0.0)?;
            }
            let x = self.carriage(origin_mm, &axes[3..]);
            axes[..3].copy_from_slice(x.as_slice());
            self.within_limits(&axes).then_some(axes)
        };
        let mut solutions: Vec<Vec<f64>> =
            found.branches.iter().filter_map(|a| complete(a)).collect();
        if found.singular {
            // Every set of angles is the same pose here; one is enough.
            solutions.truncate(1);
        }
        let endless = found.singular || (line.is_none() && turns.len() > 2);
        let mut reached = !found.branches.is_empty();
        if solutions.is_empty() && endless {
            // The free axis cannot stand at zero: the least angle is taken that all limits allow.
            let mut steps: Vec<(usize, f64)> = Vec::new();
            for (k, turn) in turns.iter().enumerate() {
                let [low, high] = turn.limits_deg.map(|limit| limit.clamp(-360.0, 360.0));
                let count = ((high - low) / HELD_STEP_DEG).ceil().max(1.0);
                let held = |j: usize| low + (high - low) * j as f64 / count;
                steps.extend((0..=count as usize).map(|j| (k, held(j))));
            }
            steps.sort_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
            for (k, held) in steps {
                let sets = branches::with_held(&turns, &aim, k, held);
                reached |= !sets.is_empty();
                solutions.extend(sets.iter().filter_map(|set| complete(set)));
                if !solutions.is_empty() {
                    break;
                }
            }
            if found.singular {
                solutions.truncate(1);
            }
        }
        if solutions.is_empty() {
            return Err(if reached {
                ReachFault::AxisLimit
            } else {
                ReachFault::Unreachable
            });
        }
        Ok(ReachedPose {
            solutions,
            singular: endless,
        })
    }

    /// The rotations that aim the beam, from the sensor inwards, with their places; where they are at most two and
    /// the spindle is not among them. The planner searches over these.
    pub(super) fn aiming_joints(&self) -> Vec<(usize, ChainRotation)> {
        let mut joints = self.joints();
        if self.line_by_spindle() {
            joints.remove(0);
        }
        joints
    }

    /// A direction of the part file's frame as it stands before the table's axes turn it.
    pub(super) fn part_direction(&self, v: &Vector3<f64>) -> Vector3<f64> {
        self.chain.workpiece.rotation * v
    }

    /// Beam and line in the spindle's frame.
    pub(super) fn mounted(&self) -> (Vector3<f64>, Vector3<f64>) {
        let r = &self.chain.sensor.rotation;
        (-r.column(2), r.column(0).into_owned())
    }
}
