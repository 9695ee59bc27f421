//! Where the machine holds the sensor, for a list of positions.

use std::io::BufRead;

use serde::Serialize;
use umi_kinematics::{AxisChain, Joint, JointKind, Pose};

use crate::ScanError;
use crate::format::machine;
use crate::format::table::{Column, Row, TableReader};

/// The answer of `umi scan pose`.
#[derive(Debug, Clone, Serialize)]
pub struct Poses {
    /// One for each row of positions.
    pub poses: Vec<PoseAnswer>,
    /// What may be a slip: of the machine file, and of the angles' unit.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// The sensor's frame in the workpiece's frame.
#[derive(Debug, Clone, Serialize)]
pub struct PoseAnswer {
    /// Three rows.
    pub rotation: [[f64; 3]; 3],
    /// The origin of the sensor's frame.
    pub translation_mm: [f64; 3],
}

impl From<&Pose> for PoseAnswer {
    fn from(pose: &Pose) -> Self {
        Self {
            rotation: pose.rows(),
            translation_mm: pose.translation_mm.into(),
        }
    }
}

/// The poses at all positions of a table that has a column for every joint, by its name,
/// in millimetres and degrees.
///
/// # Errors
/// `missing_axis` where a joint has no column, `no_positions`, `not_finite`, or the table's own.
pub fn poses<R: BufRead>(
    machine: &AxisChain,
    mut positions: TableReader<R>,
) -> Result<Poses, ScanError> {
    let columns = JointColumns::find(machine, &positions)?;
    let mut poses = Vec::new();
    let mut largest_deg = vec![0.0_f64; machine.joints.len()];
    while let Some(row) = positions.next_row()? {
        let values = columns.values(&row)?;
        for (largest, value) in largest_deg.iter_mut().zip(&values) {
            *largest = largest.max(value.abs());
        }
        poses.push(PoseAnswer::from(&machine.sensor_in_workpiece(&values)));
    }
    if poses.is_empty() {
        return Err(ScanError::refused(
            "no_positions",
            format_args!(
                "{}: there is no position behind the head of the table",
                positions.name()
            ),
        ));
    }
    let mut warnings = machine::warnings(machine);
    warnings.extend(small_angles(machine, &largest_deg));
    Ok(Poses { poses, warnings })
}

/// Angles that would all lie within a turn in radians: only whoever wrote them knows.
fn small_angles(machine: &AxisChain, largest_deg: &[f64]) -> Option<String> {
    let turning = |(place, joint): &(usize, &Joint)| {
        joint.kind == JointKind::Rotary && joint.constant().is_none() && largest_deg[*place] > 0.0
    };
    let turning: Vec<(usize, &Joint)> = machine.moving().filter(turning).collect();
    let small = |(place, _): &(usize, &Joint)| largest_deg[*place] <= std::f64::consts::TAU + 1e-3;
    let names: Vec<&str> = turning
        .iter()
        .map(|(_, joint)| joint.name.as_str())
        .collect();
    (!turning.is_empty() && turning.iter().all(small)).then(|| {
        format!(
            "No angle of {} is above 6.3, a whole turn in radians. They were taken for degrees.",
            names.join(", ")
        )
    })
}

/// Where the values of all joints stand in a table of positions.
pub struct JointColumns {
    sources: Vec<Source>,
}

enum Source {
    Constant(f64),
    Column(Column),
}

impl JointColumns {
    /// Looks for each joint that moves.
    ///
    /// # Errors
    /// `missing_axis`: a joint of a chain has neither a column nor a constant value.
    pub fn find<R: BufRead>(
        machine: &AxisChain,
        table: &TableReader<R>,
    ) -> Result<Self, ScanError> {
        let mut sources: Vec<_> = machine
            .joints
            .iter()
            .map(|joint| Source::Constant(joint.constant().unwrap_or(0.0)))
            .collect();
        for (place, joint) in machine.moving() {
            if joint.constant().is_some() {
                continue;
            }
            let column = table.optional(&joint.name).ok_or_else(|| {
                ScanError::refused(
                    "missing_axis",
                    format_args!(
                        "{}: there is no column for the joint {:?} of the machine",
                        table.name(),
                        joint.name
                    ),
                )
                .with("joint", joint.name.as_str())
            })?;
            sources[place] = Source::Column(column);
        }
        Ok(Self { sources })
    }

    /// The values of all joints in a row, in the machine's order, in mm and degrees.
    ///
    /// # Errors
    /// A cell is no finite number.
    pub fn values(&self, row: &Row<'_>) -> Result<Vec<f64>, ScanError> {
        self.sources
            .iter()
            .map(|source| match source {
                Source::Constant(value) => Ok(*value),
                Source::Column(column) => row.finite(*column),
            })
            .collect()
    }
}
