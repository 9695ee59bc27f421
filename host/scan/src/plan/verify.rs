//! Any path, proved: what is promised of a plan is looked at on the rows of a file.

use std::io::BufRead;

use serde::Serialize;

use super::drive::deadline::Deadline;
use super::drive::realise::Pass;
use super::drive::touch::Scenery;
use super::machine::{SensorPose, UNIT};
use super::mesh::PartMesh;
use super::proof::figures::{JudgedOverlap, OverlapPoints, stand};
use super::proof::on_machine::OnMachine;
use super::proof::row::PathRow;
use super::proof::samples::{sample_count, samples};
use super::proof::see::{SampleSights, see};
use super::spec::ScanSpec;
use crate::ScanError;
use crate::format::table::TableReader;
use crate::surface::Mesh;
use nalgebra::Vector3;

/// A promise that a path does not keep.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathFault {
    /// `kinematics`, `axis_limit`, `max_step`, `max_turn`, `stand_off`, `tilt`, `off_part`, `collision`, `coverage` or
    /// `overlap`.
    pub fault: &'static str,
    /// What is so and what is allowed.
    pub message: String,
}

/// What a path is found to be.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathFindings {
    /// "scan_verify".
    pub kind: &'static str,
    /// Nothing that was promised is broken.
    pub holds: bool,
    /// What is broken.
    pub faults: Vec<PathFault>,
    /// What a user should know of a path that holds.
    pub warnings: Vec<String>,
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
    /// Largest difference of the middle ray from the reference distance, on the ways between the rows, too.
    pub stand_off_max_mm: f64,
    /// Largest angle of the middle ray against the facet it meets, on the ways between the rows, too.
    pub tilt_max_deg: f64,
    /// Poses whose middle ray meets no part.
    pub off_part: usize,
    /// Of neighbouring passes; none where there is one pass.
    pub overlap: Option<JudgedOverlap>,
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

/// Pose and axes of a row are the same place by this.
const SAME_MM: f64 = 1e-6;
/// The same for beam and line.
const SAME_RAD: f64 = 1e-8;

/// By how much a row's pose differs from that of its axes: at the origin, in mm, and of beam and line.
fn off_its_axes(spec: &ScanSpec, row: &PathRow) -> [f64; 2] {
    let pose = spec.machine.forward(&row.axes);
    let turned = (pose.beam - row.pose.beam)
        .amax()
        .max((pose.line - row.pose.line).amax());
    [(pose.origin_mm - row.pose.origin_mm).amax(), turned]
}

impl PathFindings {
    /// Do poses and axes contradict each other?
    fn differs(&self) -> bool {
        self.kinematics_mm > SAME_MM || self.kinematics_rad > SAME_RAD
    }
}

/// Refuses a path whose poses are not those of its axes: what is driven would not be what was looked at.
///
/// # Errors
/// `bad_path`, with the first such row.
pub fn same_place(spec: &ScanSpec, rows: &[PathRow]) -> Result<(), ScanError> {
    for (number, row) in rows.iter().enumerate() {
        let [mm, rad] = off_its_axes(spec, row);
        if mm > SAME_MM || rad > SAME_RAD {
            return Err(ScanError::refused(
                "bad_path",
                format_args!(
                    "Row {}: the pose differs from that of its axes by {mm:.6} mm and {rad:.2e} rad. The path was made for another specification, or columns were changed: plan it again.",
                    number + 1
                ),
            ));
        }
    }
    Ok(())
}

/// The largest number of a pass.
const MOST_PASSES: f64 = 1e6;

/// Reads a path as `umi scan plan` writes it.
///
/// # Errors
/// A column is missing or a cell is no finite number; `bad_path` where there is no row, where beam and line are no unit
/// vectors at a right angle, or where pass and laser contradict each other.
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
        let line_number = row.line();
        let bad =
            |what: &str| ScanError::refused("bad_path", format_args!("Line {line_number}: {what}"));
        let three = |at: usize| Vector3::new(v[at], v[at + 1], v[at + 2]);
        let (beam, line) = (three(3), three(6));
        for (name, v) in [("beam", beam), ("line", line)] {
            if (v.norm() - 1.0).abs() > UNIT {
                return Err(bad(&format!(
                    "the {name} is {:.9} long; a unit vector is needed.",
                    v.norm()
                )));
            }
        }
        if beam.dot(&line).abs() > UNIT {
            return Err(bad("beam and line are not at a right angle."));
        }
        let number = row.finite(pass)?;
        if number.fract() != 0.0 || !(-1.0..=MOST_PASSES).contains(&number) {
            return Err(bad(
                "pass needs a whole number: 0, 1, and so on, or -1 for a link.",
            ));
        }
        let on = match row.finite(laser)? {
            0.0 => false,
            1.0 => true,
            _ => return Err(bad("laser needs 0 or 1.")),
        };
        if on != (number >= 0.0) {
            return Err(bad(if on {
                "the laser is on in a link (pass -1)."
            } else {
                "the laser is off in a pass: a link has pass -1."
            }));
        }
        rows.push(PathRow {
            pass: number as i32,
            laser: on,
            pose: SensorPose {
                origin_mm: three(0),
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
    // Where it was planned: the same points stand for the surface.
    let Some(placed) = OnMachine::new(part, obstacles, spec) else {
        return verify_there(part, obstacles, spec, rows);
    };
    let there = |row: &PathRow| PathRow {
        pose: placed.pose(&row.pose),
        ..row.clone()
    };
    let rows: Vec<PathRow> = rows.iter().map(there).collect();
    verify_there(&placed.part, &placed.obstacles, &placed.spec, &rows)
}

fn verify_there(
    part: &PartMesh,
    obstacles: &[Mesh],
    spec: &ScanSpec,
    rows: &[PathRow],
) -> PathFindings {
    let mut meshes = vec![&part.surface];
    meshes.extend(obstacles);
    let scenery = &Scenery::new(spec, meshes);
    let count = sample_count(part.surface.area_mm2(), spec.sensor.line_mm);
    let points = samples(part, count);
    let passes = passes_of(rows);
    let all: Vec<&Pass> = passes.iter().collect();
    let seen = see(&spec.sensor, scenery, &points, &all);
    findings(part, scenery, spec, rows, &seen)
}

/// The same of a path of which it is known what it sees: [`sample_count`] points or more.
pub(super) fn findings(
    part: &PartMesh,
    scenery: &Scenery<'_>,
    spec: &ScanSpec,
    rows: &[PathRow],
    seen: &SampleSights,
) -> PathFindings {
    let passes = passes_of(rows);
    let all: Vec<&Pass> = passes.iter().collect();
    let stand = stand(spec, scenery, &all);
    let tip = |p: &SensorPose| p.origin_mm + p.beam * spec.sensor.reference_mm;
    let mut found = PathFindings {
        kind: "scan_verify",
        holds: false,
        faults: Vec::new(),
        warnings: Vec::new(),
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
        overlap: OverlapPoints::new(part).judge(spec, scenery, &all, Deadline::never()),
        kinematics_mm: 0.0,
        kinematics_rad: 0.0,
        max_step_mm: 0.0,
        max_turn_deg: 0.0,
        collisions: 0,
    };
    let mut beyond = 0;
    for (k, row) in rows.iter().enumerate() {
        let [mm, rad] = off_its_axes(spec, row);
        found.kinematics_mm = found.kinematics_mm.max(mm);
        found.kinematics_rad = found.kinematics_rad.max(rad);
        beyond += usize::from(!spec.machine.within_limits(&row.axes));
        let Some(next) = rows.get(k + 1) else {
            continue;
        };
        if !scenery.keeps_clear(&spec.machine, &row.axes, &next.axes) {
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
    found
        .warnings
        .extend(found.overlap.and_then(|o| o.warning()));
    if stand.gaps > 0 {
        found.warnings.push(format!(
            "On {} ways from pose to pose the middle ray meets no part in between, as over a slot: stand-off and tilt are told of what it meets.",
            stand.gaps
        ));
    }
    if found.overlap.is_none() && found.passes > part.components as usize {
        found.warnings.push(format!(
            "Of {} passes no two see a common strip of a smooth surface, and none ends beside another: there is no overlap to tell.",
            found.passes
        ));
    }
    found.holds = found.faults.is_empty();
    found
}

fn faults(spec: &ScanSpec, f: &PathFindings, beyond: usize) -> Vec<PathFault> {
    let plan = &spec.plan;
    let mut faults = Vec::new();
    let mut need = |holds: bool, fault: &'static str, message: String| {
        if !holds {
            faults.push(PathFault { fault, message });
        }
    };
    need(
        !f.differs(),
        "kinematics",
        format!(
            "Pose and axes differ by {:.2e} mm and {:.2e} rad.",
            f.kinematics_mm, f.kinematics_rad
        ),
    );
    need(
        beyond == 0,
        "axis_limit",
        format!("{beyond} rows leave the limits of an axis."),
    );
    need(
        f.max_step_mm <= plan.max_step_mm + 1e-6,
        "max_step",
        format!(
            "A step is {:.3} mm long; {} is allowed.",
            f.max_step_mm, plan.max_step_mm
        ),
    );
    need(
        f.max_turn_deg <= plan.max_turn_deg + 1e-6,
        "max_turn",
        format!(
            "An axis turns by {:.3} degrees in a step; {} is allowed.",
            f.max_turn_deg, plan.max_turn_deg
        ),
    );
    need(
        f.stand_off_max_mm <= plan.stand_off_tolerance_mm,
        "stand_off",
        format!(
            "The stand-off is off by {:.3} mm; {} is allowed.",
            f.stand_off_max_mm, plan.stand_off_tolerance_mm
        ),
    );
    need(
        f.tilt_max_deg <= plan.max_tilt_deg + 1.5,
        "tilt",
        format!(
            "The beam leans by {:.2} degrees; {} is allowed, and 1.5 more for facets.",
            f.tilt_max_deg, plan.max_tilt_deg
        ),
    );
    need(
        f.off_part == 0,
        "off_part",
        format!("The middle ray of {} poses misses the part.", f.off_part),
    );
    need(
        f.collisions == 0,
        "collision",
        format!(
            "The sensor's box touches something between {} pairs of rows.",
            f.collisions
        ),
    );
    need(
        f.coverage >= plan.min_coverage,
        "coverage",
        format!(
            "{:.1} % of the area are seen; {:.1} % are wanted.",
            f.coverage * 100.0,
            plan.min_coverage * 100.0
        ),
    );
    if let Some(overlap) = &f.overlap {
        need(
            overlap.holds(),
            "overlap",
            format!(
                "Neighbouring strips overlap by {:.3} of the line or less on a tenth of their length, by {:.3} in the middle; {} is wanted everywhere.",
                overlap.tenth, overlap.median, overlap.wanted
            ),
        );
    }
    faults
}
