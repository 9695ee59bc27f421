//! Rotary axes of a scene's machine.

use nalgebra::Vector3;
use serde::Deserialize;
use umi_kinematics::{AxisChain, Drive, Joint, JointKind, Pose};

use super::SceneError;

/// Encoder inputs of a board, less those of X, Y, Z.
const MOST: usize = 3;

/// What an axis carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AxisLoad {
    /// The workpiece: an axis of the table. All bodies of the scene turn with it.
    Workpiece,
    /// The spindle: an axis of the head, or the spindle's own orientation.
    Spindle,
}

/// A rotary axis: `[[machine.rotary]]`. Of several with the same load, the first stands on the
/// machine's base (or on the carriage of X, Y, Z), each next on the one before.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RotarySpec {
    /// Its word in programs: one of A, B, C, U, V, W.
    pub word: char,
    /// What it carries.
    pub carries: AxisLoad,
    /// Positive angles turn right-handed about it; of any length.
    pub axis: [f64; 3],
    /// A point of it, all axes at 0.
    #[serde(default)]
    pub point_mm: [f64; 3],
    /// Least and largest angle.
    #[serde(default = "full_turns")]
    pub limits_deg: [f64; 2],
    /// Where it stands at the start.
    #[serde(default)]
    pub start_deg: f64,
    /// Encoder counts per degree, negative where they count down.
    #[serde(default = "ten_thousand")]
    pub counts_per_deg: f64,
    /// Encoder counts at angle 0.
    #[serde(default)]
    pub origin_counts: i64,
    /// Its fastest motion.
    #[serde(default = "ten_turns")]
    pub deg_per_min: f64,
}

fn full_turns() -> [f64; 2] {
    [-360.0, 360.0]
}

fn ten_thousand() -> f64 {
    10_000.0
}

fn ten_turns() -> f64 {
    3600.0
}

impl RotarySpec {
    /// What its counter holds at an angle.
    #[must_use]
    pub fn counts(&self, deg: f64) -> i64 {
        let lines = libm::floor(deg * self.counts_per_deg) as i64;
        self.origin_counts.saturating_add(lines)
    }
}

/// A machine with these rotary axes as a chain; see [`super::MachineSpec::chain`].
pub(super) fn chain(rotary: &[RotarySpec], mount: Pose) -> AxisChain {
    let linear = [
        ("X", Vector3::x()),
        ("Y", Vector3::y()),
        ("Z", Vector3::z()),
    ];
    let mut joints: Vec<Joint> = linear
        .map(|(name, direction)| Joint {
            name: name.into(),
            kind: JointKind::Linear,
            direction,
            point_mm: Vector3::zeros(),
            drive: Drive::Named,
        })
        .into();
    let mut chains = [vec![0, 1, 2], Vec::new()];
    for axis in rotary {
        chains[usize::from(axis.carries == AxisLoad::Workpiece)].push(joints.len());
        joints.push(Joint {
            name: axis.word.to_string(),
            kind: JointKind::Rotary,
            direction: Vector3::from(axis.axis).normalize(),
            point_mm: Vector3::from(axis.point_mm),
            drive: Drive::Named,
        });
    }
    let [sensor_chain, workpiece_chain] = chains;
    AxisChain {
        joints,
        sensor_chain,
        workpiece_chain,
        sensor: mount,
        sensor_covariance: None,
        workpiece: Pose::identity(),
    }
}

/// What no single number tells.
pub(super) fn check(rotary: &[RotarySpec]) -> Result<(), SceneError> {
    let refuse = |message: String| Err(SceneError { message });
    if rotary.len() > MOST {
        return refuse(format!(
            "`machine.rotary`: {} axes; a board has encoder inputs for {MOST} beside X, Y, Z",
            rotary.len()
        ));
    }
    for (place, axis) in rotary.iter().enumerate() {
        let word = axis.word;
        if !"ABCUVW".contains(word) {
            return refuse(format!(
                "`machine.rotary`: the word {word:?} is none of A, B, C, U, V, W"
            ));
        }
        if rotary[..place].iter().any(|other| other.word == word) {
            return refuse(format!("`machine.rotary`: there are two axes {word}"));
        }
        if Vector3::from(axis.axis).norm() < 1e-9 {
            return refuse(format!("`machine.rotary` {word}: `axis` has no direction"));
        }
        if axis.counts_per_deg == 0.0 {
            return refuse(format!(
                "`machine.rotary` {word}: `counts_per_deg` is 0: the encoder would not count"
            ));
        }
        let [least, most] = axis.limits_deg;
        if least >= most || !(least..=most).contains(&axis.start_deg) {
            return refuse(format!(
                "`machine.rotary` {word}: `limits_deg` needs the lower angle first, and \
                     `start_deg` {} between them",
                axis.start_deg
            ));
        }
    }
    Ok(())
}
