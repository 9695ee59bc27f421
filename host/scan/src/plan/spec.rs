//! The specification of a plan: part, sensor, wishes and machine, read from TOML.
//!
//! Millimetres and degrees as in the file; axes and beams are made unit vectors here. Unknown keys are refused: a
//! misspelt limit must not become no limit.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::ScanError;

use super::machine::{PlanMachine, TurnAxis};

/// The line laser, in its own frame: along the line, along the feed (beam x line), along the beam.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorSpec {
    /// Length of the line at the reference distance; it grows with the distance from the origin.
    pub line_mm: f64,
    /// Stand-off: from the origin, where the rays come from, along the beam.
    pub reference_mm: f64,
    /// Least and largest distance along the beam that is measured.
    pub range_mm: [f64; 2],
    /// Of a ray against the facet's normal, for its point to be measured.
    pub max_incidence_deg: f64,
    /// The receiver's place; all zero: not tested for shadow.
    pub receiver_mm: Vector3<f64>,
    /// The housing's box: least corner, largest corner.
    pub body_mm: [Vector3<f64>; 2],
}

/// What a plan must keep.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanWishes {
    /// Overlap of neighbouring passes as a share of the line's length, 0 up to less than 1.
    pub overlap: f64,
    /// Of the middle ray from the reference distance.
    pub stand_off_tolerance_mm: f64,
    /// Middle ray against the normal where it meets the part.
    pub max_tilt_deg: f64,
    /// Least share of the area that must be seen.
    pub min_coverage: f64,
    /// The housing's box is larger by this on each side.
    pub clearance_mm: f64,
    /// Way of origin + reference x beam between poses of a pass.
    pub max_step_mm: f64,
    /// Of any rotary axis between poses of a pass.
    pub max_turn_deg: f64,
}

/// A whole specification.
#[derive(Debug, Clone)]
pub struct ScanSpec {
    /// The line laser.
    pub sensor: SensorSpec,
    /// What the plan must keep.
    pub plan: PlanWishes,
    /// The machine, with the part's place on its table.
    pub machine: PlanMachine,
    /// Meshes beside the part that shadow and collide.
    pub obstacles: Vec<PathBuf>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPart {
    #[serde(default)]
    translation_mm: [f64; 3],
    #[serde(default)]
    rotation_deg: [f64; 3],
    #[serde(default)]
    obstacles: Vec<PathBuf>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawSensor {
    line_mm: f64,
    reference_mm: f64,
    range_mm: [f64; 2],
    max_incidence_deg: f64,
    #[serde(default)]
    receiver_mm: [f64; 3],
    body_mm: [[f64; 3]; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPlan {
    overlap: f64,
    stand_off_tolerance_mm: f64,
    max_tilt_deg: f64,
    min_coverage: f64,
    clearance_mm: f64,
    max_step_mm: f64,
    max_turn_deg: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawTravel {
    #[serde(rename = "X")]
    x: [f64; 2],
    #[serde(rename = "Y")]
    y: [f64; 2],
    #[serde(rename = "Z")]
    z: [f64; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawSpindle {
    orient_deg: [f64; 2],
    word: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawMount {
    origin_mm: [f64; 3],
    beam: [f64; 3],
    line: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawAxis {
    name: String,
    axis: [f64; 3],
    #[serde(default)]
    point_mm: [f64; 3],
    limits_deg: [f64; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawMachine {
    travel_mm: RawTravel,
    spindle: Option<RawSpindle>,
    mount: RawMount,
    #[serde(default)]
    table: Vec<RawAxis>,
    #[serde(default)]
    head: Vec<RawAxis>,
}

impl ScanSpec {
    /// Reads a specification's file.
    ///
    /// # Errors
    /// `file` where it cannot be read, and those of [`Self::read`].
    pub fn open(path: &Path) -> Result<Self, ScanError> {
        let bytes = std::fs::read(path).map_err(|e| ScanError::file("read", path, &e))?;
        let text = String::from_utf8(bytes)
            .map_err(|_| ScanError::refused("bad_spec", "The specification is no UTF-8 text."))?;
        Self::read(&text, path.parent().unwrap_or(Path::new("")))
    }

    /// Reads a specification. Obstacles are looked for in `folder`, which is the specification's own.
    ///
    /// # Errors
    ///
    /// `bad_spec` for what is no TOML, for missing or unknown sections and for the part's section; `sensor_spec`,
    /// `plan_spec` and `machine_spec` for theirs.
    pub fn read(text: &str, folder: &Path) -> Result<Self, ScanError> {
        let mut whole: toml::Table = text.parse().map_err(|e| {
            ScanError::refused("bad_spec", format!("The specification is no TOML: {e}"))
        })?;
        let part: RawPart = match whole.remove("part") {
            Some(value) => section(value, "part", "bad_spec")?,
            None => RawPart {
                translation_mm: [0.0; 3],
                rotation_deg: [0.0; 3],
                obstacles: Vec::new(),
            },
        };
        let sensor: RawSensor = take(&mut whole, "sensor", "sensor_spec")?;
        let plan: RawPlan = take(&mut whole, "plan", "plan_spec")?;
        let machine: RawMachine = take(&mut whole, "machine", "machine_spec")?;
        if let Some(key) = whole.keys().next() {
            return Err(ScanError::refused(
                "bad_spec",
                format!(
                    "The specification has a section or key `{key}` that nobody knows. Known are part, sensor, plan, machine."
                ),
            ));
        }
        let plan = check_plan(plan)?;
        let sensor = check_sensor(sensor, &plan)?;
        let (rotation, translation) = check_part(&part)?;
        let machine = check_machine(machine, rotation, translation)?;
        Ok(ScanSpec {
            sensor,
            plan,
            machine,
            obstacles: part.obstacles.iter().map(|o| folder.join(o)).collect(),
        })
    }
}

fn section<T: DeserializeOwned>(
    value: toml::Value,
    name: &str,
    code: &'static str,
) -> Result<T, ScanError> {
    value.try_into().map_err(|e: toml::de::Error| {
        ScanError::refused(code, format!("[{name}]: {}", plainly(&e.to_string())))
    })
}

/// What the TOML reader says of a list with too many numbers names no number that it wants.
fn plainly(message: &str) -> String {
    let count = message
        .strip_prefix("invalid length ")
        .and_then(|rest| rest.split_once(", expected fewer elements in array"));
    match count {
        Some((count, place)) => format!("a list has {count} numbers, which are too many{place}"),
        None => message.to_string(),
    }
}

fn take<T: DeserializeOwned>(
    whole: &mut toml::Table,
    name: &str,
    code: &'static str,
) -> Result<T, ScanError> {
    let value = whole.remove(name).ok_or_else(|| {
        ScanError::refused(code, format!("The specification has no section [{name}]."))
    })?;
    section(value, name, code)
}

/// Refuses unless the condition holds.
fn need(holds: bool, code: &'static str, message: impl std::fmt::Display) -> Result<(), ScanError> {
    if holds {
        Ok(())
    } else {
        Err(ScanError::refused(code, message))
    }
}

/// A length beyond this is a slip of units, and would cost digits.
const FAR_MM: f64 = 1e6;

fn near(values: &[f64]) -> bool {
    values.iter().all(|v| v.is_finite() && v.abs() <= FAR_MM)
}

fn check_part(part: &RawPart) -> Result<(Vector3<f64>, Vector3<f64>), ScanError> {
    need(
        near(&part.translation_mm) && near(&part.rotation_deg),
        "bad_spec",
        "[part] translation_mm and rotation_deg need finite numbers below a million.",
    )?;
    Ok((part.rotation_deg.into(), part.translation_mm.into()))
}

fn check_plan(p: RawPlan) -> Result<PlanWishes, ScanError> {
    let code = "plan_spec";
    need(
        p.overlap >= 0.0 && p.overlap <= 0.95,
        code,
        format!(
            "[plan] overlap is {}; it needs 0 to 0.95 of the line, or passes hardly advance.",
            p.overlap
        ),
    )?;
    need(
        p.stand_off_tolerance_mm > 0.0 && near(&[p.stand_off_tolerance_mm]),
        code,
        "[plan] stand_off_tolerance_mm needs a length above 0 and below a million.",
    )?;
    need(
        p.max_tilt_deg > 0.0 && p.max_tilt_deg < 90.0,
        code,
        "[plan] max_tilt_deg needs an angle above 0 and below 90.",
    )?;
    need(
        p.min_coverage > 0.0 && p.min_coverage <= 1.0,
        code,
        "[plan] min_coverage needs a share above 0, at most 1.",
    )?;
    need(
        p.clearance_mm >= 0.0 && near(&[p.clearance_mm]),
        code,
        "[plan] clearance_mm needs a length, 0 or more and below a million.",
    )?;
    need(
        p.max_step_mm >= 0.01 && near(&[p.max_step_mm]),
        code,
        "[plan] max_step_mm needs a length of at least 0.01 and below a million.",
    )?;
    need(
        p.max_turn_deg >= 0.01 && p.max_turn_deg <= 360.0,
        code,
        "[plan] max_turn_deg needs an angle from 0.01 to 360.",
    )?;
    Ok(PlanWishes {
        overlap: p.overlap,
        stand_off_tolerance_mm: p.stand_off_tolerance_mm,
        max_tilt_deg: p.max_tilt_deg,
        min_coverage: p.min_coverage,
        clearance_mm: p.clearance_mm,
        max_step_mm: p.max_step_mm,
        max_turn_deg: p.max_turn_deg,
    })
}

fn check_sensor(s: RawSensor, plan: &PlanWishes) -> Result<SensorSpec, ScanError> {
    let code = "sensor_spec";
    need(
        s.line_mm > 0.0 && near(&[s.line_mm]),
        code,
        "[sensor] line_mm needs a length above 0.",
    )?;
    let [least, largest] = s.range_mm;
    need(
        near(&s.range_mm) && least > 0.0 && least < largest,
        code,
        "[sensor] range_mm needs two distances above 0, the smaller one first.",
    )?;
    need(
        s.reference_mm >= least && s.reference_mm <= largest,
        code,
        format!(
            "[sensor] reference_mm {} lies outside range_mm {least} to {largest}.",
            s.reference_mm
        ),
    )?;
    need(
        s.max_incidence_deg > 0.0 && s.max_incidence_deg < 90.0,
        code,
        "[sensor] max_incidence_deg needs an angle above 0 and below 90.",
    )?;
    need(
        near(&s.receiver_mm),
        code,
        "[sensor] receiver_mm needs three finite lengths.",
    )?;
    need(
        s.receiver_mm[2] < least,
        code,
        format!(
            "[sensor] receiver_mm lies {} mm along the beam, beyond the nearest point of range_mm, {least}: it would stand in the part or behind it.",
            s.receiver_mm[2]
        ),
    )?;
    let [low, high] = s.body_mm;
    need(
        near(&low) && near(&high) && low.iter().zip(&high).all(|(l, h)| l < h),
        code,
        "[sensor] body_mm needs the least corner, then the largest, in every direction.",
    )?;
    let c = plan.clearance_mm;
    let swallows = (0..2).all(|k| low[k] - c <= 0.0 && high[k] + c >= 0.0)
        && low[2] - c <= s.reference_mm
        && high[2] + c >= s.reference_mm;
    need(
        !swallows,
        code,
        "[sensor] body_mm with the clearance holds the very point that is to be measured, so it would touch the part at every pose.",
    )?;
    Ok(SensorSpec {
        line_mm: s.line_mm,
        reference_mm: s.reference_mm,
        range_mm: s.range_mm,
        max_incidence_deg: s.max_incidence_deg,
        receiver_mm: s.receiver_mm.into(),
        body_mm: [low.into(), high.into()],
    })
}

fn unit(v: [f64; 3], what: &str) -> Result<Vector3<f64>, ScanError> {
    let v: Vector3<f64> = v.into();
    let length = v.norm();
    need(
        length.is_finite() && length > 1e-9,
        "machine_spec",
        format!("[machine] {what} needs a direction: three finite numbers, not all zero."),
    )?;
    Ok(v / length)
}

fn limits(pair: [f64; 2], what: &str) -> Result<[f64; 2], ScanError> {
    need(
        near(&pair) && pair[0] <= pair[1],
        "machine_spec",
        format!(
            "[machine] {what} needs two numbers within a million, the smaller one first, not {} and {}.",
            pair[0], pair[1]
        ),
    )?;
    Ok(pair)
}

/// Columns of a path beside its rotary axes.
const TAKEN: [&str; 15] = [
    "X", "Y", "Z", "S", "pass", "laser", "ox_mm", "oy_mm", "oz_mm", "bx", "by", "bz", "lx", "ly",
    "lz",
];

fn check_axes(raw: Vec<RawAxis>, names: &mut Vec<String>) -> Result<Vec<TurnAxis>, ScanError> {
    let mut axes = Vec::new();
    for a in raw {
        let name = a.name;
        need(
            !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_'),
            "machine_spec",
            format!("[machine] An axis is named `{name}`; letters, digits and _ make a name."),
        )?;
        need(
            !names.contains(&name),
            "machine_spec",
            format!(
                "[machine] The name {name} is given twice, or is one of the path's other columns (X, Y, Z, S, pass, laser and the pose's)."
            ),
        )?;
        need(
            near(&a.point_mm),
            "machine_spec",
            format!("[machine] point_mm of axis {name} needs three finite lengths."),
        )?;
        axes.push(TurnAxis {
            direction: unit(a.axis, &format!("axis of {name}"))?,
            point_mm: a.point_mm.into(),
            limits_deg: limits(a.limits_deg, &format!("limits_deg of axis {name}"))?,
            name: name.clone(),
        });
        names.push(name);
    }
    Ok(axes)
}

fn check_machine(
    m: RawMachine,
    part_rotation_deg: Vector3<f64>,
    part_translation_mm: Vector3<f64>,
) -> Result<PlanMachine, ScanError> {
    let code = "machine_spec";
    let travel_mm = [
        limits(m.travel_mm.x, "travel_mm X")?,
        limits(m.travel_mm.y, "travel_mm Y")?,
        limits(m.travel_mm.z, "travel_mm Z")?,
    ];
    need(
        near(&m.mount.origin_mm),
        code,
        "[machine] mount origin_mm needs three finite lengths.",
    )?;
    let beam = unit(m.mount.beam, "mount beam")?;
    let line = unit(m.mount.line, "mount line")?;
    need(
        beam.dot(&line).abs() < 1e-6,
        code,
        "[machine] The mount's beam and line need a right angle between them.",
    )?;
    let mut names: Vec<String> = TAKEN.map(String::from).to_vec();
    let table = check_axes(m.table, &mut names)?;
    let head = check_axes(m.head, &mut names)?;
    let (orient_deg, orient_word) = match m.spindle {
        Some(s) => {
            let word = s.word.unwrap_or_else(|| "W".into());
            need(
                !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric()),
                code,
                "[machine.spindle] word needs letters or digits, such as W.",
            )?;
            need(
                !["X", "Y", "Z"].contains(&word.as_str()),
                code,
                format!("[machine.spindle] word {word} is that of a linear axis."),
            )?;
            (Some(limits(s.orient_deg, "spindle orient_deg")?), word)
        }
        None => (None, "W".into()),
    };
    let rotations = table.len() + head.len() + usize::from(orient_deg.is_some());
    need(
        rotations <= 3,
        code,
        format!(
            "[machine] {rotations} rotations (table, head, spindle) leave endless ways to every pose; at most 3 have a known end."
        ),
    )?;
    Ok(PlanMachine::new(
        travel_mm,
        orient_deg,
        orient_word,
        [m.mount.origin_mm.into(), beam, line],
        table,
        head,
        part_rotation_deg,
        part_translation_mm,
    ))
}
