//! Any path, proved: what is promised of a plan is looked at on the rows of a file.

use std::io::BufRead;

use serde::Serialize;

use super::drive::axes::Driver;
use super::drive::realise::{Pass, Realiser};
use super::drive::touch::Scenery;
use super::machine::SensorPose;
use super::mesh::PartMesh;
use super::planner::result::PathRow;
use super::proof::figures::{Overlap, overlap, stand};
use super::proof::samples::{sample_count, samples};
use super::proof::see::see;
use super::spec::ScanSpec;
use crate::ScanError;
use crate::format::table::TableReader;
use crate::surface::Mesh;
use nalgebra::Vector3;

/// What a path is found to be.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathFindings {
    /// "scan_verify".
    pub kind: &'static str,
    /// Nothing that was promised is broken.
    pub holds: bool,
    /// What is broken.
    pub faults: Vec<String>,
    /// Passes with the laser on.
    pub passes: usize,
    /// Poses with the laser on.
    pub poses: usize,
    /// Share of the area that is seen.
    pub coverage: f64,
    /// Way of the middle ray's point with the laser on.
    pub scan_length_mm: f64,
    /// The same over all rows.
    pub path_length_mm: f64,
    /// Largest difference of the middle ray from the reference distance.
    pub stand_off_max_mm: f64,
    /// Largest angle of the middle ray against the facet it meets.
    pub tilt_max_deg: f64,
    /// Poses whose middle ray meets no part.
    pub off_part: usize,
    /// Of neighbouring passes.
    pub overlap: Option<Overlap>,
    /// By how much the pose of a row differs from that of its axes.
    pub kinematics_mm: f64,
    /// The same for beam and line.
    pub kinematics_rad: f64,
    /// The longest step of a pass.
    pub max_step_mm: f64,
    /// The largest turn of an axis in a step.
    pub max_turn_deg: f64,
    /// Ways between rows on which the sensor's box touches something.
    pub collisions: usize,
}

/// Reads a path as `umi scan plan` writes it.
///
/// # Errors
/// A column is missing or a cell is no finite number; `bad_path` where there is no row.
pub fn read_path<R: BufRead>(
    spec: &ScanSpec,
    mut table: TableReader<R>,
) -> Result<Vec<PathRow>, ScanError> {
    let pass = table.column("pass")?;
    let laser = table.column("laser")?;
    let mut nine = Vec::new();
    for name in [
        "ox_mm", "oy_mm", "oz_mm", "bx", "by", "bz", "lx", "ly", "lz",
    ] {
        nine.push(table.column(name)?);
    }
    let axes = spec
        .machine
        .names()
        .iter()
        .map(|n| table.column(n))
        .collect::<Result<Vec<_>, _>>()?;
    let mut rows = Vec::new();
    while let Some(row) = table.next_row()? {
        let mut v = [0.0; 9];
        for (value, column) in v.iter_mut().zip(&nine) {
            *value = row.finite(*column)?;
        }
        let unit = |at: usize| Vector3::new(v[at], v[at + 1], v[at + 2]).try_normalize(1e-6);
        let (Some(beam), Some(line)) = (unit(3), unit(6)) else {
            return Err(ScanError::refused(
                "bad_path",
                format_args!("Line {}: beam or line have no direction.", row.line()),
            ));
        };
        rows.push(PathRow {
            pass: row.finite(pass)? as i32,
            laser: row.finite(laser)? != 0.0,
            pose: SensorPose {
                origin_mm: Vector3::new(v[0], v[1], v[2]),
                beam,
                line,
            },
            axes: axes
                .iter()
                .map(|c| row.finite(*c))
                .collect::<Result<_, _>>()?,
        });
    }
    if rows.is_empty() {
        return Err(ScanError::refused("bad_path", "The path has no row."));
    }
    Ok(rows)
}

/// Passes of a path: neighbouring rows of one number with the laser on.
pub(super) fn passes_of(rows: &[PathRow]) -> Vec<Pass> {
    let mut passes: Vec<Pass> = Vec::new();
    let mut before: Option<&PathRow> = None;
    for row in rows {
        if row.laser {
            if !before.is_some_and(|b| b.laser && b.pass == row.pass) {
                passes.push(Pass {
                    axes: Vec::new(),
                    poses: Vec::new(),
                });
            }
            if let Some(pass) = passes.last_mut() {
                pass.axes.push(row.axes.clone());
                pass.poses.push(row.pose);
            }
        }
        before = Some(row);
    }
    passes
}

/// Looks a path through.
pub fn verify(
    part: &PartMesh,
    obstacles: &[Mesh],
    spec: &ScanSpec,
    rows: &[PathRow],
) -> PathFindings {
    let mut meshes = vec![&part.surface];
    meshes.extend(obstacles);
    let realiser = Realiser {
        spec,
        driver: Driver::new(spec),
        scenery: Scenery::new(spec, meshes),
    };
    let scenery = &realiser.scenery;
    let passes = passes_of(rows);
    let all: Vec<&Pass> = passes.iter().collect();
    let count = sample_count(part.surface.area_mm2(), spec.sensor.line_mm);
    let seen = see(&spec.sensor, scenery, &samples(part, count), &all);
    let stand = stand(spec, scenery, &all);
    let tip = |p: &SensorPose| p.origin_mm + p.beam * spec.sensor.reference_mm;
    let mut found = PathFindings {
        kind: "scan_verify",
        holds: false,
        faults: Vec::new(),
        passes: passes.len(),
        poses: rows.iter().filter(|r| r.laser).count(),
        coverage: seen.share(),
        scan_length_mm: passes.iter().map(|p| p.length_mm(spec)).sum(),
        path_length_mm: rows
            .windows(2)
            .map(|w| (tip(&w[1].pose) - tip(&w[0].pose)).norm())
            .sum(),
        stand_off_max_mm: stand.stand_off_max_mm,
        tilt_max_deg: stand.tilt_max_deg,
        off_part: stand.off_part,
        overlap: overlap(spec, &all, &seen),
        kinematics_mm: 0.0,
        kinematics_rad: 0.0,
        max_step_mm: 0.0,
        max_turn_deg: 0.0,
        collisions: 0,
    };
    let mut beyond = 0;
    for (k, row) in rows.iter().enumerate() {
        let pose = spec.machine.forward(&row.axes);
        found.kinematics_mm = found
            .kinematics_mm
            .max((pose.origin_mm - row.pose.origin_mm).amax());
        let turned = (pose.beam - row.pose.beam)
            .amax()
            .max((pose.line - row.pose.line).amax());
        found.kinematics_rad = found.kinematics_rad.max(turned);
        beyond += usize::from(!spec.machine.within_limits(&row.axes));
        let Some(next) = rows.get(k + 1) else {
            continue;
        };
        if scenery.touches_between(&spec.machine, &row.axes, &next.axes) {
            found.collisions += 1;
        }
        if row.laser && next.laser && row.pass == next.pass {
            found.max_step_mm = found
                .max_step_mm
                .max((tip(&next.pose) - tip(&row.pose)).norm());
            let turn = row.axes[3..]
                .iter()
                .zip(&next.axes[3..])
                .map(|(a, b)| (a - b).abs());
            found.max_turn_deg = turn.fold(found.max_turn_deg, f64::max);
        }
    }
    found.faults = faults(spec, &found, beyond);
    found.holds = found.faults.is_empty();
    found
}

fn faults(spec: &ScanSpec, f: &PathFindings, beyond: usize) -> Vec<String> {
    let plan = &spec.plan;
    let mut faults = Vec::new();
    let mut need = |holds: bool, fault: String| {
        if !holds {
            faults.push(fault);
        }
    };
    need(
        f.kinematics_mm <= 1e-6 && f.kinematics_rad <= 1e-8,
        format!(
            "Pose and axes differ by {:.2e} mm and {:.2e} rad.",
            f.kinematics_mm, f.kinematics_rad
        ),
    );
    need(
        beyond == 0,
        format!("{beyond} rows leave the limits of an axis."),
    );
    need(
        f.max_step_mm <= plan.max_step_mm + 1e-6,
        format!(
            "A step is {:.3} mm long; {} is allowed.",
            f.max_step_mm, plan.max_step_mm
        ),
    );
    need(
        f.max_turn_deg <= plan.max_turn_deg + 1e-6,
        format!(
            "An axis turns by {:.3} degrees in a step; {} is allowed.",
            f.max_turn_deg, plan.max_turn_deg
        ),
    );
    need(
        f.stand_off_max_mm <= plan.stand_off_tolerance_mm,
        format!(
            "The stand-off is off by {:.3} mm; {} is allowed.",
            f.stand_off_max_mm, plan.stand_off_tolerance_mm
        ),
    );
    need(
        f.tilt_max_deg <= plan.max_tilt_deg + 1.5,
        format!(
            "The beam leans by {:.2} degrees; {} is allowed, and 1.5 more for facets.",
            f.tilt_max_deg, plan.max_tilt_deg
        ),
    );
    need(
        f.off_part == 0,
        format!("The middle ray of {} poses misses the part.", f.off_part),
    );
    need(
        f.collisions == 0,
        format!(
            "The sensor's box touches something between {} pairs of rows.",
            f.collisions
        ),
    );
    need(
        f.coverage >= plan.min_coverage,
        format!(
            "{:.1} % of the area are seen; {:.1} % are wanted.",
            f.coverage * 100.0,
            plan.min_coverage * 100.0
        ),
    );
    faults
}
