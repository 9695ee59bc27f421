//! The finished path with its figures, proved on its own rows.

use std::fmt::Write as _;

use serde::Serialize;

use super::super::drive::price::{RAPID_MM_PER_S, seconds};
use super::super::drive::realise::{Obstructed, Pass};
use super::super::machine::{PlanMachine, SensorPose};
use super::super::map::flatten::MapQuality;
use super::super::proof::figures::{JudgedOverlap, judged_overlap, stand};
use super::super::proof::samples::SamplePoint;
use super::super::proof::see::see;
use super::super::spec::ScanSpec;
use super::unseen::{Uncovered, reasons};
use super::{PlanOptions, Workshop};
use crate::ScanError;

/// A row of the path. Between rows all axes move linearly together.
#[derive(Debug, Clone)]
pub struct PathRow {
    /// Number of the pass, -1 for a link.
    pub pass: i32,
    /// Scanning.
    pub laser: bool,
    /// Values of the axes.
    pub axes: Vec<f64>,
    /// Pose of the sensor on the part.
    pub pose: SensorPose,
}

/// What a plan is, for `--json`.
#[derive(Debug, Clone, Serialize)]
pub struct PlanFigures {
    /// "scan_plan".
    pub kind: &'static str,
    /// How many passes.
    pub passes: usize,
    /// Poses with the laser on.
    pub poses: usize,
    /// Share of the area that is seen.
    pub coverage: f64,
    /// Way of the middle ray's point with the laser on.
    pub scan_length_mm: f64,
    /// The same over all rows.
    pub path_length_mm: f64,
    /// Time at the feed told, with rapid 100 mm/s and 30 degrees/s for links and turning.
    pub duration_s: f64,
    /// Largest difference of the middle ray from the reference distance.
    pub stand_off_max_mm: f64,
    /// Largest angle of the middle ray against the facet it meets.
    pub tilt_max_deg: f64,
    /// Of neighbouring passes; none where there is one pass.
    pub overlap: Option<JudgedOverlap>,
    /// By how much the sensor's box could grow on all sides before it touches.
    pub clearance_mm: f64,
    /// How true the map is.
    pub map: Option<MapQuality>,
    /// What is not seen, by reason.
    pub uncovered: Vec<Uncovered>,
    /// What a user should know.
    pub warnings: Vec<String>,
}

/// A proved plan.
#[derive(Debug, Clone)]
pub struct ScanPlan {
    /// In the order driven.
    pub rows: Vec<PathRow>,
    /// Its figures.
    pub figures: PlanFigures,
    /// Points that stand for the surface, with the number of passes that see each.
    pub seen: Vec<(SamplePoint, usize)>,
    /// Area of the part.
    pub area_mm2: f64,
    /// The charts' triangles in the plane, with the length there of a millimetre on the surface.
    pub flat: Vec<Vec<FlatTriangle>>,
}

/// A triangle of a map, and its scale.
pub type FlatTriangle = ([[f64; 2]; 3], f64);

/// The clearance is told up to this.
const MOST_CLEARANCE_MM: f64 = 100.0;

fn tip(spec: &ScanSpec, pose: &SensorPose) -> nalgebra::Vector3<f64> {
    pose.origin_mm + pose.beam * spec.sensor.reference_mm
}

/// Proves rows and gives them figures.
pub fn proved(
    shop: &Workshop<'_>,
    rows: Vec<PathRow>,
    passes: &[Pass],
    map: Option<MapQuality>,
    obstructed: &Obstructed,
    options: PlanOptions,
) -> Result<ScanPlan, ScanError> {
    let spec = shop.spec;
    let all: Vec<&Pass> = passes.iter().collect();
    let scenery = &shop.realiser.scenery;
    let seen = see(&spec.sensor, scenery, &shop.samples, &all);
    let coverage = seen.share();
    let uncovered = reasons(shop, &seen, obstructed);
    let wanted = spec.plan.min_coverage;
    if rows.is_empty() || (coverage < wanted && !options.allow_partial) {
        return Err(unreachable(coverage, wanted, rows.is_empty(), &uncovered));
    }
    let stand = stand(spec, scenery, &all);
    check(shop, &rows, &stand)?;
    let mut warnings = Vec::new();
    if shop.part.dropped > 0 {
        warnings.push(format!(
            "{} triangles without area were left out.",
            shop.part.dropped
        ));
    }
    let overlap = judged_overlap(spec, scenery, shop.part, &all);
    if let Some(o) = overlap
        && !o.holds()
    {
        warnings.push(format!(
            "A tenth of the strips overlap by {:.3} of the line or less; {} was wanted.",
            o.tenth, spec.plan.overlap
        ));
    }
    if coverage < wanted {
        warnings.push(format!(
            "{:.1} % of the area are seen; {:.1} % were wanted.",
            coverage * 100.0,
            wanted * 100.0
        ));
    }
    let mut figures = PlanFigures {
        kind: "scan_plan",
        passes: passes.len(),
        poses: rows.iter().filter(|r| r.laser).count(),
        coverage,
        scan_length_mm: passes.iter().map(|p| p.length_mm(spec)).sum(),
        path_length_mm: 0.0,
        duration_s: 0.0,
        stand_off_max_mm: stand.stand_off_max_mm,
        tilt_max_deg: stand.tilt_max_deg,
        overlap,
        clearance_mm: MOST_CLEARANCE_MM,
        map,
        uncovered,
        warnings,
    };
    for pair in rows.windows(2) {
        shop.deadline.check()?;
        let [a, b] = [&pair[0], &pair[1]];
        let way = (tip(spec, &b.pose) - tip(spec, &a.pose)).norm();
        figures.path_length_mm += way;
        figures.duration_s += if a.laser && b.laser && a.pass == b.pass {
            (way / (options.feed_mm_per_min / 60.0)).max(seconds(&a.axes, &b.axes, RAPID_MM_PER_S))
        } else {
            seconds(&a.axes, &b.axes, RAPID_MM_PER_S)
        };
        figures.clearance_mm =
            scenery.clearance(&spec.machine, &a.axes, &b.axes, figures.clearance_mm);
    }
    if figures.clearance_mm < spec.plan.clearance_mm {
        return Err(unproved(format!(
            "the sensor's box comes as near as {:.3} mm",
            figures.clearance_mm
        )));
    }
    let sights = seen.sights.iter().map(Vec::len);
    Ok(ScanPlan {
        rows,
        figures,
        seen: shop.samples.iter().copied().zip(sights).collect(),
        area_mm2: shop.part.surface.area_mm2(),
        flat: Vec::new(),
    })
}

fn unreachable(coverage: f64, wanted: f64, nothing: bool, uncovered: &[Uncovered]) -> ScanError {
    let mut why = String::new();
    for u in uncovered {
        // Writing to a string cannot fail.
        let _ = write!(
            why,
            "{}{} {:.0} mm2",
            if why.is_empty() { "" } else { ", " },
            u.reason,
            u.area_mm2
        );
    }
    let limits = nothing && uncovered.iter().all(|u| u.reason == "axis_limit");
    let code = if limits {
        "axis_limit"
    } else {
        "coverage_unreachable"
    };
    ScanError::refused(
        code,
        format_args!(
            "{:.1} % of the area can be seen, {:.1} % are wanted. Not seen: {why}. Allow more tilt, stand the part otherwise, or take --allow-partial.",
            coverage * 100.0,
            wanted * 100.0
        ),
    )
    .with("coverage", coverage)
    .with("uncovered", serde_json::to_value(uncovered).unwrap_or_default())
}

fn unproved(what: String) -> ScanError {
    ScanError::refused(
        "plan_unproved",
        format_args!(
            "The finished path does not keep its promise: {what}. It is not written; this is a fault of the planner."
        ),
    )
}

/// Everything a row must keep, looked at again on the rows themselves.
fn check(
    shop: &Workshop<'_>,
    rows: &[PathRow],
    stand: &super::super::proof::figures::Stand,
) -> Result<(), ScanError> {
    let (spec, plan) = (shop.spec, &shop.spec.plan);
    if stand.off_part > 0 {
        return Err(unproved(format!(
            "the middle ray of {} poses misses the part",
            stand.off_part
        )));
    }
    if stand.stand_off_max_mm > plan.stand_off_tolerance_mm {
        return Err(unproved(format!(
            "the stand-off is off by {:.3} mm",
            stand.stand_off_max_mm
        )));
    }
    if stand.tilt_max_deg > plan.max_tilt_deg + 1.5 {
        return Err(unproved(format!(
            "the beam leans by {:.2} degrees",
            stand.tilt_max_deg
        )));
    }
    for (k, row) in rows.iter().enumerate() {
        if !spec.machine.within_limits(&row.axes) {
            return Err(unproved(format!("row {k} leaves the limits of an axis")));
        }
        let Some(next) = rows
            .get(k + 1)
            .filter(|n| n.laser && row.laser && n.pass == row.pass)
        else {
            continue;
        };
        let step = (tip(spec, &next.pose) - tip(spec, &row.pose)).norm();
        let turn = row.axes[3..]
            .iter()
            .zip(&next.axes[3..])
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        if step > plan.max_step_mm + 1e-9 || turn > plan.max_turn_deg + 1e-9 {
            return Err(unproved(format!(
                "row {k} steps {step:.3} mm and turns {turn:.3} degrees"
            )));
        }
    }
    Ok(())
}

/// The path as its file has it.
pub fn csv(machine: &PlanMachine, rows: &[PathRow]) -> String {
    let mut text = String::from("pass,laser,ox_mm,oy_mm,oz_mm,bx,by,bz,lx,ly,lz");
    for name in machine.names() {
        text.push(',');
        text.push_str(name);
    }
    text.push('\n');
    for row in rows {
        let p = &row.pose;
        // Writing to a string cannot fail.
        let _ = write!(text, "{},{}", row.pass, u8::from(row.laser));
        for v in p.origin_mm.iter().chain(&p.beam).chain(&p.line) {
            let _ = write!(text, ",{:.12}", v + 0.0);
        }
        for v in &row.axes {
            let _ = write!(text, ",{v:.9}");
        }
        text.push('\n');
    }
    text
}
