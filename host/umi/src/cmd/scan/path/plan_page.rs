//! What `umi scan plan --report` shows.

use std::path::Path;

use umi_report::pages::path_plan::{PlanPage, PlanRow, PlannedAxis, SeenPoint};
use umi_report::pages::scan::FigureTable;
use umi_scan::plan::planner::result::ScanPlan;
use umi_scan::plan::spec::ScanSpec;
use umi_scan::rigid::Vec3;

/// The page on a plan.
pub fn page(mesh: &Path, spec: &ScanSpec, plan: &ScanPlan) -> PlanPage {
    let f = &plan.figures;
    let array = |v: &Vec3| [v.x, v.y, v.z];
    let mut facts = vec![
        ("passes", f.passes.to_string()),
        (
            "poses with the laser on",
            format!("{}, of which {} turn on the spot", f.poses, f.turning_poses),
        ),
        (
            "way with the laser on",
            format!("{:.1} mm", f.scan_length_mm),
        ),
        ("way in all", format!("{:.1} mm", f.path_length_mm)),
        ("time", format!("{:.0} s", f.duration_s)),
        (
            "stand-off",
            format!(
                "within {:.3} mm of {} mm ({} mm allowed)",
                f.stand_off_max_mm, spec.sensor.reference_mm, spec.plan.stand_off_tolerance_mm
            ),
        ),
        (
            "tilt",
            format!(
                "up to {:.2}\u{b0} ({}\u{b0} allowed, and 1.5\u{b0} more for facets)",
                f.tilt_max_deg, spec.plan.max_tilt_deg
            ),
        ),
        (
            "clearance",
            format!(
                "{:.2} mm ({} mm wanted)",
                f.clearance_mm, spec.plan.clearance_mm
            ),
        ),
    ];
    if let Some(o) = f.overlap {
        facts.push((
            "overlap",
            format!(
                "a tenth of the strips {:.3} of the line or less, in the middle {:.3} ({} wanted)",
                o.tenth, o.median, spec.plan.overlap
            ),
        ));
    }
    if let Some(map) = f.map {
        facts.push((
            "maps",
            format!(
                "angles within {:.2}\u{b0}, scale {:.3} to {:.3}, {} triangles upside down",
                map.max_angle_error_deg, map.scale_min, map.scale_max, map.flips
            ),
        ));
    }
    let uncovered = FigureTable {
        caption: "What is not seen, by reason".into(),
        heads: vec!["reason", "area, mm\u{b2}"],
        rows: f
            .uncovered
            .iter()
            .map(|u| vec![u.reason.to_string(), format!("{:.1}", u.area_mm2)])
            .collect(),
    };
    let names = spec.machine.names().into_iter().zip(spec.machine.limits());
    PlanPage {
        title: format!(
            "Scan path of {}",
            mesh.file_name().unwrap_or_default().to_string_lossy()
        ),
        result: format!(
            "{:.1} % of the surface is seen ({:.1} % wanted)",
            f.coverage * 100.0,
            spec.plan.min_coverage * 100.0
        ),
        facts,
        tables: vec![uncovered],
        remarks: f.warnings.clone(),
        rows: plan
            .rows
            .iter()
            .map(|row| PlanRow {
                pass: row.pass,
                laser: row.laser,
                tip_mm: array(&(row.pose.origin_mm + row.pose.beam * spec.sensor.reference_mm)),
                beam: array(&row.pose.beam),
                axes: row.axes.clone(),
            })
            .collect(),
        seen: plan
            .seen
            .iter()
            .map(|(point, passes)| SeenPoint {
                at_mm: array(&point.at),
                normal: array(&point.normal),
                passes: *passes,
            })
            .collect(),
        flat: plan.flat.clone(),
        axes: names
            .enumerate()
            .map(|(k, (name, limits))| PlannedAxis {
                name: name.to_owned(),
                unit: if k < 3 { "mm" } else { "\u{b0}" },
                limits,
            })
            .collect(),
    }
}
