//! Lists of poses: axis values to poses, poses to all axis values.

use std::io::BufRead;

use nalgebra::Vector3;
use serde::Serialize;
use serde_json::{Map, Value};

use super::machine::{PlanMachine, ReachFault, UNIT};
use crate::ScanError;
use crate::format::table::TableReader;

/// Where a set of axis values holds the sensor, in the part file's frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ForwardPose {
    /// `ok` or `axis_limit`: an axis is beyond its limits. The pose is told all the same.
    pub status: &'static str,
    /// Where the rays come from.
    pub origin_mm: [f64; 3],
    /// Direction of the middle ray, a unit vector.
    pub beam: [f64; 3],
    /// Direction of the laser line, a unit vector.
    pub line: [f64; 3],
}

/// All axis values that bring the sensor to a pose.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InversePose {
    /// `ok`, `axis_limit` (every branch leaves the limits) or `unreachable` (no angles point so).
    pub status: &'static str,
    /// An axis is free, at a pole or without a line to point; it stands at zero.
    pub singular: bool,
    /// One object of axis values, by name, for each branch within the limits.
    pub solutions: Vec<Map<String, Value>>,
}

/// Axis values, a column for each axis by its name, to poses.
///
/// # Errors
/// A column is missing, a cell is no finite number.
pub fn forward<R: BufRead>(
    machine: &PlanMachine,
    mut table: TableReader<R>,
) -> Result<Vec<ForwardPose>, ScanError> {
    let columns = machine
        .names()
        .iter()
        .map(|name| table.column(name))
        .collect::<Result<Vec<_>, _>>()?;
    let mut poses = Vec::new();
    while let Some(row) = table.next_row()? {
        let mut axes = Vec::with_capacity(columns.len());
        for column in &columns {
            axes.push(row.finite(*column)?);
        }
        let pose = machine.forward(&axes);
        poses.push(ForwardPose {
            status: if machine.within_limits(&axes) {
                "ok"
            } else {
                "axis_limit"
            },
            origin_mm: pose.origin_mm.into(),
            beam: pose.beam.into(),
            line: pose.line.into(),
        });
    }
    Ok(poses)
}

/// Poses (`ox_mm,oy_mm,oz_mm,bx,by,bz[,lx,ly,lz]`) to all axis values.
///
/// # Errors
/// A column is missing, a cell is no finite number, beam and line are no unit vectors at a right angle (`bad_pose`).
pub fn inverse<R: BufRead>(
    machine: &PlanMachine,
    mut table: TableReader<R>,
) -> Result<Vec<InversePose>, ScanError> {
    let three = |table: &TableReader<R>, names: [&str; 3]| -> Result<_, ScanError> {
        Ok([
            table.column(names[0])?,
            table.column(names[1])?,
            table.column(names[2])?,
        ])
    };
    let origin = three(&table, ["ox_mm", "oy_mm", "oz_mm"])?;
    let beam = three(&table, ["bx", "by", "bz"])?;
    let line = match table.optional("lx") {
        Some(_) => Some(three(&table, ["lx", "ly", "lz"])?),
        None => None,
    };
    let names: Vec<String> = machine.names().into_iter().map(String::from).collect();
    let mut poses = Vec::new();
    let mut number = 0;
    while let Some(row) = table.next_row()? {
        number += 1;
        let vector = |columns: [_; 3]| -> Result<Vector3<f64>, ScanError> {
            Ok(Vector3::new(
                row.finite(columns[0])?,
                row.finite(columns[1])?,
                row.finite(columns[2])?,
            ))
        };
        let bad =
            |what: &str| ScanError::refused("bad_pose", format_args!("Pose {number}: {what}"));
        let direction = |v: Vector3<f64>, what: &str| {
            let length = v.norm();
            if (length - 1.0).abs() <= UNIT {
                Ok(v / length)
            } else {
                Err(bad(&format!(
                    "the {what} is {length:.9} long; a unit vector is needed."
                )))
            }
        };
        let at = vector(origin)?;
        let beam = direction(vector(beam)?, "beam")?;
        let line = match line {
            Some(columns) => {
                let line = direction(vector(columns)?, "line")?;
                if line.dot(&beam).abs() > UNIT {
                    return Err(bad("beam and line are not at a right angle."));
                }
                Some((line - beam * beam.dot(&line)).normalize())
            }
            None => None,
        };
        poses.push(match machine.inverse(&at, &beam, line.as_ref()) {
            Ok(reached) => InversePose {
                status: "ok",
                singular: reached.singular,
                solutions: reached
                    .solutions
                    .iter()
                    .map(|axes| {
                        let values = axes.iter().map(|v| Value::from(*v));
                        names.iter().cloned().zip(values).collect()
                    })
                    .collect(),
            },
            Err(fault) => InversePose {
                status: match fault {
                    ReachFault::AxisLimit => "axis_limit",
                    ReachFault::Unreachable => "unreachable",
                },
                singular: false,
                solutions: Vec::new(),
            },
        });
    }
    Ok(poses)
}
