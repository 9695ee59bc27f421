//! What a sensor saw of planes and balls, and where the machine held it.

use std::collections::HashMap;
use std::io::BufRead;

use nalgebra::Vector3;
use umi_kinematics::{AxisChain, JointKind, Pose};

use super::misfit::slips::AxisSlip;
use crate::ScanError;
use crate::format::table::TableReader;
use crate::pose::JointColumns;

/// A point of a profile that lies on a feature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Its place among [`Observations::flanges`].
    pub flange: usize,
    /// Its place among [`Observations::features`].
    pub feature: usize,
    /// In the sensor's frame: (x, 0, z).
    pub seen_mm: Vector3<f64>,
}

/// All that was seen.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Observations {
    /// The names of the features, in the order of their appearance.
    pub features: Vec<String>,
    /// The names of the profiles that saw something, in the order of their appearance.
    pub profiles: Vec<String>,
    /// For each of these, the flange in the workpiece's frame.
    pub flanges: Vec<Pose>,
    /// The flanges if the angles were radians; only where all of them are within one turn as such.
    pub flanges_by_radians: Option<Vec<Pose>>,
    /// What may be wrong about the machine's axes, with what each would do at the flanges.
    pub slips: Vec<AxisSlip>,
    /// By profile.
    pub points: Vec<Observation>,
}

impl Observations {
    /// What a profile is called; its place, where it has no name.
    pub(super) fn profile_name(&self, place: usize) -> String {
        let name = self.profiles.get(place);
        format!(
            "profile {}",
            name.map_or_else(|| place.to_string(), Clone::clone)
        )
    }
}

/// Reads `profile,feature,x_mm,z_mm`, and for each profile the joints' positions.
///
/// # Errors
/// `not_finite`, `missing_axis`, `missing_position` for a profile without one, or the
/// tables' own.
pub fn read<R: BufRead, P: BufRead>(
    machine: &AxisChain,
    mut observed: TableReader<R>,
    positions: TableReader<P>,
) -> Result<Observations, ScanError> {
    let (flanges, by_radians) = read_positions(machine, positions)?;
    let mut joints = Vec::new();
    let profile = observed.column("profile")?;
    let feature = observed.column("feature")?;
    let (x, z) = (observed.column("x_mm")?, observed.column("z_mm")?);
    let name = observed.name().to_owned();
    let mut used: HashMap<String, usize> = HashMap::new();
    let mut all = Observations {
        flanges_by_radians: by_radians.as_ref().map(|_| Vec::new()),
        ..Observations::default()
    };
    while let Some(row) = observed.next_row()? {
        let key = row.text(profile);
        let flange = match used.get(key) {
            Some(&place) => place,
            None => {
                let pose = flanges.get(key).ok_or_else(|| {
                    ScanError::refused(
                        "missing_position",
                        format_args!(
                            "{name}, line {}: profile {key} has no row among the positions",
                            row.line()
                        ),
                    )
                })?;
                let (pose, q) = pose;
                all.flanges.push(*pose);
                joints.push(q.clone());
                if let (Some(all), Some(poses)) = (&mut all.flanges_by_radians, &by_radians) {
                    all.push(poses.get(key).copied().unwrap_or(*pose));
                }
                all.profiles.push(key.to_owned());
                used.insert(key.to_owned(), all.flanges.len() - 1);
                all.flanges.len() - 1
            }
        };
        let key = row.text(feature);
        let place = all.features.iter().position(|known| known == key);
        let feature = place.unwrap_or_else(|| {
            all.features.push(key.to_owned());
            all.features.len() - 1
        });
        all.points.push(Observation {
            flange,
            feature,
            seen_mm: Vector3::new(row.finite(x)?, 0.0, row.finite(z)?),
        });
    }
    all.slips = AxisSlip::of(machine, &joints);
    Ok(all)
}

/// Poses of the flange, and the joints' values, by the profiles' names.
type Flanges = HashMap<String, (Pose, Vec<f64>)>;

/// The flanges; and what they would be by radians, where the angles look like these.
fn read_positions<R: BufRead>(
    machine: &AxisChain,
    mut positions: TableReader<R>,
) -> Result<(Flanges, Option<HashMap<String, Pose>>), ScanError> {
    const TURN: f64 = std::f64::consts::TAU + 1e-6;
    let columns = JointColumns::find(machine, &positions)?;
    let profile = positions.column("profile")?;
    let rotary: Vec<usize> = machine
        .moving()
        .filter(|(_, joint)| joint.kind == JointKind::Rotary && joint.constant().is_none())
        .map(|(place, _)| place)
        .collect();
    let mut flanges = HashMap::new();
    let mut by_radians = HashMap::new();
    let mut within_turn = !rotary.is_empty();
    while let Some(row) = positions.next_row()? {
        let mut q = columns.values(&row)?;
        let pose = machine.flange_in_workpiece(&q);
        let key = row.text(profile).to_owned();
        if flanges.insert(key.clone(), (pose, q.clone())).is_some() {
            return Err(row.wrong(profile, "one row for each profile"));
        }
        within_turn &= rotary.iter().all(|&place| q[place].abs() <= TURN);
        if within_turn {
            rotary
                .iter()
                .for_each(|&place| q[place] = q[place].to_degrees());
            by_radians.insert(key, machine.flange_in_workpiece(&q));
        }
    }
    Ok((flanges, within_turn.then_some(by_radians)))
}

/// Reads `feature,x_mm,y_mm,z_mm`: centres that are known, in the workpiece's frame.
///
/// # Errors
/// `not_finite`, or the table's own.
pub fn read_centres<R: BufRead>(
    mut table: TableReader<R>,
) -> Result<HashMap<String, Vector3<f64>>, ScanError> {
    let feature = table.column("feature")?;
    let x = table.column("x_mm")?;
    let (y, z) = (table.column("y_mm")?, table.column("z_mm")?);
    let mut centres = HashMap::new();
    while let Some(row) = table.next_row()? {
        let centre = Vector3::new(row.finite(x)?, row.finite(y)?, row.finite(z)?);
        if centres
            .insert(row.text(feature).to_owned(), centre)
            .is_some()
        {
            return Err(row.wrong(feature, "one centre for each feature"));
        }
    }
    Ok(centres)
}
