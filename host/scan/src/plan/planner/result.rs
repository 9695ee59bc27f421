//! The finished path with its figures, proved on its own rows.

use std::fmt::Write as _;

use serde::Serialize;

use super::super::drive::price::{RAPID_MM_PER_S, TURN_DEG_PER_S, seconds};
use super::super::drive::realise::{Obstructed, Pass};
use super::super::machine::{PlanMachine, SensorPose};
use super::super::map::flatten::MapQuality;
use super::super::proof::figures::JudgedOverlap;
use super::super::proof::row::PathRow;
use super::super::proof::samples::{SamplePoint, sample_count, samples};
use super::super::proof::see::see;
use super::super::spec::ScanSpec;
use super::super::verify::findings;
use super::unseen::{AXIS_LIMIT, Uncovered, reasons};
use super::{PlanOptions, Workshop};
use crate::ScanError;

/// What a plan is, for `--json`.
#[derive(Debug, Clone, Serialize)]
pub struct PlanFigures {
    /// "scan_plan".
    pub kind: &'static str,
    /// How many passes.
    pub passes: usize,
    /// Poses with the laser on.
    pub poses: usize,
    /// Poses of them to which the point on the part does not move: the line or the beam turns on the spot.
    pub turning_poses: usize,
    /// Share of the area that is seen.
    pub coverage: f64,
    /// Way of the middle ray's point with the laser on.
    pub scan_length_mm: f64,
    /// The same over all rows.
    pub path_length_mm: f64,
    /// Time at the speeds of `duration_at`.
    pub duration_s: f64,
    /// What the time is reckoned with.
    pub duration_at: Speeds,
    /// Largest difference of the middle ray from the reference distance.
    pub stand_off_max_mm: f64,
    /// Largest angle of the middle ray against the facet it meets.
    pub tilt_max_deg: f64,
    /// Of neighbouring passes; none where no strip has a neighbour, as with one pass.
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

/// Speeds that a path's time is reckoned with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Speeds {
    /// With the laser on, on the part.
    pub feed_mm_per_min: f64,
    /// X, Y, Z together, on links and wherever they would be faster than this.
    pub rapid_mm_per_s: f64,
    /// Each rotary axis.
    pub turn_deg_per_s: f64,
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
    /// Why it is no plan where none may be partial.
    pub refusal: Option<ScanError>,
    /// It is refused, and clearly more than may go unseen lies where no pose within the limits would see it: no other try
    /// mends that.
    pub beyond_limits: bool,
    /// The angle of a spindle that was planned as one that stands.
    pub stands_at_deg: Option<f64>,
    /// The charts' triangles in the plane, with the length there of a millimetre on the surface.
    pub flat: Vec<Vec<FlatTriangle>>,
}

/// A triangle of a map, and its scale.
pub type FlatTriangle = ([[f64; 2]; 3], f64);

/// Less of the part can be seen than is wanted.
pub(super) const COVERAGE_UNREACHABLE: &str = "coverage_unreachable";

/// Neighbouring strips overlap less than is wanted.
const OVERLAP_UNREACHABLE: &str = "overlap_unreachable";

/// The fault of a path whose strips overlap too little.
const OVERLAP: &str = "overlap";

/// Less way is none: axis values are rounded.
const ON_THE_SPOT_MM: f64 = 1e-6;

/// A part of less than this share of the line is more likely one of another unit.
const FAR_TOO_SMALL: f64 = 0.3;

/// What no pose within the limits sees is known from a raster of poses: so much of what may go unseen, and of all, on top.
const SURELY: [f64; 2] = [1.5, 0.01];

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
    let uncovered = reasons(shop, &seen, obstructed);
    let wanted = spec.plan.min_coverage;
    if rows.is_empty() {
        return Err(unreachable(shop, 0.0, &uncovered, obstructed, options));
    }
    // The same look as `umi scan verify` takes, at the same points and by the limits that are given.
    let judged = &ScanSpec {
        plan: shop.given.plan.clone(),
        ..spec.clone()
    };
    let count = sample_count(shop.part.surface.area_mm2(), spec.sensor.line_mm);
    let found = if shop.samples.len() == count {
        findings(shop.part, scenery, judged, &rows, &seen)
    } else {
        let same = see(&spec.sensor, scenery, &samples(shop.part, count), &all);
        findings(shop.part, scenery, judged, &rows, &same)
    };
    let coverage = seen.share().min(found.coverage);
    let mut refusal =
        (coverage < wanted).then(|| unreachable(shop, coverage, &uncovered, obstructed, options));
    let mut warnings = Vec::new();
    if shop.part.dropped > 0 {
        warnings.push(format!(
            "{} triangles without area were left out.",
            shop.part.dropped
        ));
    }
    if shop.across_mm < FAR_TOO_SMALL * spec.sensor.line_mm {
        warnings.push(format!(
            "The part is {:.3} mm across, far less than the line of {} mm: is its file in mm?",
            shop.across_mm, spec.sensor.line_mm
        ));
    }
    for fault in &found.faults {
        match fault.fault {
            // Told below.
            "coverage" => {}
            OVERLAP => {
                refusal.get_or_insert_with(|| too_little_overlap(shop, &fault.message, coverage));
                warnings.push(fault.message.clone());
            }
            _ => return Err(unproved(&fault.message)),
        }
    }
    warnings.extend(found.warnings);
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
        turning_poses: 0,
        coverage,
        scan_length_mm: passes.iter().map(|p| p.length_mm(spec)).sum(),
        path_length_mm: 0.0,
        duration_s: 0.0,
        duration_at: Speeds {
            feed_mm_per_min: options.feed_mm_per_min,
            rapid_mm_per_s: RAPID_MM_PER_S,
            turn_deg_per_s: TURN_DEG_PER_S,
        },
        stand_off_max_mm: found.stand_off_max_mm,
        tilt_max_deg: found.tilt_max_deg,
        overlap: found.overlap,
        clearance_mm: MOST_CLEARANCE_MM.max(2.0 * spec.plan.clearance_mm + 1.0),
        map,
        uncovered,
        warnings,
    };
    for pair in rows.windows(2) {
        shop.deadline.check()?;
        let [a, b] = [&pair[0], &pair[1]];
        let way = (tip(spec, &b.pose) - tip(spec, &a.pose)).norm();
        figures.path_length_mm += way;
        let scans = a.laser && b.laser && a.pass == b.pass;
        figures.turning_poses += usize::from(scans && way < ON_THE_SPOT_MM);
        figures.duration_s += if scans {
            (way / (options.feed_mm_per_min / 60.0)).max(seconds(&a.axes, &b.axes, RAPID_MM_PER_S))
        } else {
            seconds(&a.axes, &b.axes, RAPID_MM_PER_S)
        };
        figures.clearance_mm =
            scenery.nearest(&spec.machine, &a.axes, &b.axes, figures.clearance_mm);
    }
    figures.clearance_mm = scenery.told(figures.clearance_mm);
    if figures.clearance_mm < spec.plan.clearance_mm {
        return Err(unproved(&format!(
            "The sensor's box comes as near as {:.3} mm.",
            figures.clearance_mm
        )));
    }
    let area_mm2 = shop.part.surface.area_mm2();
    let beyond = figures.uncovered.iter().find(|u| u.reason == AXIS_LIMIT);
    let beyond = beyond.map_or(0.0, |u| u.area_mm2) / area_mm2;
    let beyond_limits = refusal.is_some() && beyond > SURELY[0] * (1.0 - wanted) + SURELY[1];
    let sights = seen.sights.iter().map(Vec::len);
    Ok(ScanPlan {
        rows,
        figures,
        seen: shop.samples.iter().copied().zip(sights).collect(),
        area_mm2,
        refusal,
        beyond_limits,
        stands_at_deg: None,
        flat: Vec::new(),
    })
}

fn unreachable(
    shop: &Workshop<'_>,
    coverage: f64,
    uncovered: &[Uncovered],
    obstructed: &Obstructed,
    options: PlanOptions,
) -> ScanError {
    let plan = &shop.spec.plan;
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
    let limits = coverage == 0.0 && uncovered.iter().all(|u| u.reason == AXIS_LIMIT);
    let code = if limits {
        AXIS_LIMIT
    } else {
        COVERAGE_UNREACHABLE
    };
    ScanError::refused(
        code,
        format_args!(
            "The best plan found sees {:.1} % of the area, {:.1} % are wanted. Not seen: {why}.{}{}",
            coverage * 100.0,
            plan.min_coverage * 100.0,
            pieces(shop.part.components),
            if shop.part.inside_out() {
                INSIDE_OUT.to_owned()
            } else if limits {
                BEYOND.to_owned()
            } else {
                advice(obstructed, options.allow_partial || coverage == 0.0)
            }
        ),
    )
    .with("coverage", coverage)
    .with(
        "uncovered",
        serde_json::to_value(uncovered).unwrap_or_default(),
    )
}

/// What helps where the axes point the beam at nothing of the part.
const BEYOND: &str = " Stand the part otherwise, so that the beam meets it within the axes' limits and travels; or turn the mesh inside out, if its triangles look away from the outer side (an outer side is that from which the corners run counter-clockwise).";

/// What helps where the mesh is closed and looks inwards.
const INSIDE_OUT: &str = " The mesh is closed and all its triangles look inwards: it is inside out. Turn them over (the outer side is that from which the corners run counter-clockwise).";

/// What to do with a surface that a file has in pieces: each is planned by itself.
pub(super) fn pieces(components: u32) -> String {
    match components {
        0 | 1 => String::new(),
        n => format!(
            " The mesh is {n} pieces without common edges, and each is planned by itself: if they are one surface, weld its vertices, also where a corner lies on another triangle's edge."
        ),
    }
}

/// What helps where too little is seen, by what stood in the way.
fn advice(obstructed: &Obstructed, allow_partial: bool) -> String {
    let (broken, or_turn) = match obstructed.breaks {
        0 => (String::new(), ""),
        n => (
            format!(" At {n} places an axis would turn too far from pose to pose (max_turn_deg)."),
            " or turn",
        ),
    };
    let partial = if allow_partial {
        ": there is not even a partial path"
    } else {
        ", or take --allow-partial"
    };
    if obstructed.unlinked > 0 {
        return format!(
            "{broken} {} passes touch nothing where they lie, but no way to them was found on which the sensor touches nothing, neither over what stands in between nor round its sides. Give the machine more room there, or plan either side by itself{partial}.",
            obstructed.unlinked
        );
    }
    format!("{broken} Allow more tilt{or_turn}, or stand the part otherwise{partial}.")
}

fn too_little_overlap(shop: &Workshop<'_>, what: &str, coverage: f64) -> ScanError {
    ScanError::refused(
        OVERLAP_UNREACHABLE,
        format_args!(
            "{what} No path was found that keeps it.{} Want less overlap, or take --allow-partial.",
            pieces(shop.part.components)
        ),
    )
    .with("coverage", coverage)
}

fn unproved(what: &str) -> ScanError {
    ScanError::refused(
        "plan_unproved",
        format_args!(
            "The finished path does not keep its promise. {what} It is not written; this is a fault of the planner."
        ),
    )
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

#[cfg(test)]
mod tests {
    use super::{Obstructed, advice, pieces};

    #[test]
    fn a_mesh_in_pieces_is_told_to_be_welded() {
        assert_eq!(pieces(1), "");
        assert!(pieces(625).contains("625 pieces") && pieces(625).contains("weld"));
    }

    #[test]
    fn the_limit_that_breaks_courses_is_named_and_nothing_is_advised_twice() {
        let broken_at = |breaks: usize| Obstructed {
            breaks,
            ..Obstructed::default()
        };
        assert_eq!(
            advice(&broken_at(0), false),
            " Allow more tilt, or stand the part otherwise, or take --allow-partial."
        );
        let broken = advice(&broken_at(3), true);
        assert!(broken.contains("At 3 places") && broken.contains("max_turn_deg"));
        assert!(!broken.contains("--allow-partial"));
    }
}
