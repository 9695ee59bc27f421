//! What the limits let a machine reach is reached, and what is told of it is one figure.

use super::*;
use crate::plan::verify::verify;

/// Tables A and C with little room, a spindle that turns: the axes' limits cut the reach of either.
fn little_table() -> ScanSpec {
    let text = SPEC
        .replace("[10.0, 5.0, -30.0]", "[3, 2, 40]")
        .replace("limits_deg = [-110, 110]", "limits_deg = [-100, 20]")
        .replace("limits_deg = [-360, 360]", "limits_deg = [0, 200]");
    let spec = spec(&text).unwrap();
    assert_eq!(spec.machine.table[0].limits_deg, [-100.0, 20.0]);
    assert_eq!(spec.machine.table[1].limits_deg, [0.0, 200.0]);
    spec
}

/// An axis that stands at its limit may still point the beam within the tilt: nine tenths were seen of this dome.
#[test]
fn the_tilt_is_spent_where_an_axis_ends() {
    let mut spec = little_table();
    spec.plan.min_coverage = 0.97;
    let raw = height_field([24.0, 24.0], 24, |x, y| {
        (4900.0 - x * x - y * y).sqrt() - 70.0
    });
    let part = PartMesh::weld(raw, true).unwrap();
    let plan = plan(&part, &[], &spec, options(true)).unwrap();
    keeps(&plan, &spec);
    println!("{} of the area", plan.figures.coverage);
    assert!(plan.figures.coverage >= 0.97, "{}", plan.figures.coverage);
    assert!(verify(&part, &[], &spec, &plan.rows).holds);
}

/// A plate with chamfers as wide as a line reaches: 6 mm.
fn chamfered(down: f64) -> PartMesh {
    let raw = height_field([40.0, 24.0], 80, |x, y| {
        -down * (x.abs() - 34.0).max(y.abs() - 18.0).max(0.0)
    });
    PartMesh::weld(raw, true).unwrap()
}

fn three_axes() -> ScanSpec {
    let mut spec = ScanSpec::open(&folder().join("three_axes.toml")).unwrap();
    spec.machine.travel_mm = [[-900.0, 900.0]; 3];
    spec.plan.min_coverage = 0.97;
    spec
}

/// Their corners are seen by a line that lies askew where a pass along the edge ends.
#[test]
fn chamfers_are_seen_from_the_flat_beside_them_corners_too() {
    for down in [0.577, 1.0] {
        let (part, spec) = (chamfered(down), three_axes());
        let plan = plan(&part, &[], &spec, options(false)).unwrap();
        keeps(&plan, &spec);
        println!("{down}: {} of the area", plan.figures.coverage);
        assert!(plan.figures.coverage >= 0.97);
        assert!(verify(&part, &[], &spec, &plan.rows).holds, "{down}");
    }
}

/// A refusal tells what the partial plan sees.
#[test]
fn a_refusal_and_the_partial_plan_tell_one_figure() {
    let waves = height_field([30.0, 20.0], 60, |x, _| 5.0 * (x / 5.0).sin());
    let mut little = three_axes();
    little.machine.orient_deg = Some([-30.0, 100.0]);
    little.plan.min_coverage = 0.999;
    let dome = height_field([24.0, 24.0], 16, |x, y| (3000.0 - x * x - y * y).sqrt());
    let mut narrow = little_table();
    narrow.plan.min_coverage = 0.999;
    for (raw, mut spec) in [(waves, little), (dome, narrow)] {
        let part = PartMesh::weld(raw, true).unwrap();
        let refused = plan(&part, &[], &spec, options(false)).err().unwrap();
        assert_eq!(refused.code, "coverage_unreachable");
        let partial = plan(&part, &[], &spec, options(true)).unwrap();
        let told = refused.details["coverage"].as_f64().unwrap();
        assert_eq!(told, partial.figures.coverage);
        // What is told is reached.
        spec.plan.min_coverage = told - 1e-9;
        assert!(verify(&part, &[], &spec, &partial.rows).coverage >= told - 1e-9);
    }
}

/// A slope that the middle ray may not meet, beside a flat from which the line sees it: no limit keeps it away. One that is wider
/// than the line reaches is kept away by the axes that are not there.
#[test]
fn a_limit_is_blamed_only_for_what_no_pose_within_it_sees() {
    let spec = three_axes();
    let area = |width: f64| {
        let raw = height_field([30.0, 20.0], 60, |x, _| -(x - 30.0 + width).max(0.0));
        let part = PartMesh::weld(raw, true).unwrap();
        let mut spec = spec.clone();
        spec.plan.min_coverage = 1.0;
        let plan = plan(&part, &[], &spec, options(true)).unwrap();
        let limited = plan
            .figures
            .uncovered
            .iter()
            .filter(|u| u.reason == "axis_limit");
        limited.map(|u| u.area_mm2).sum::<f64>()
    };
    assert_eq!(area(5.0), 0.0);
    assert!(area(20.0) > 300.0, "{}", area(20.0));
}

/// A flat part leans by 0.95 of what is allowed, or 0.98: the tilt was cut short by 0.6 degrees or a fifth, and the part refused
/// as beyond the axes' limits. What leans by more than is allowed still is.
#[test]
fn a_part_that_leans_within_the_tilt_is_seen() {
    let plate = || PartMesh::weld(height_field([30.0, 20.0], 6, |_, _| 0.0), true).unwrap();
    for [lean, allowed] in [
        [9.5, 10.0],
        [9.4, 10.0],
        [2.5, 3.0],
        [0.85, 1.0],
        [19.6, 20.0],
        [10.0, 10.0],
    ] {
        let leaning = |lean: f64| {
            let text = std::fs::read_to_string(folder().join("three_axes.toml")).unwrap();
            let text: String = (text.lines())
                .map(|line| match line.split(" =").next() {
                    Some("rotation_deg") => format!("rotation_deg = [{lean}, 0, 0]\n"),
                    Some("max_tilt_deg") => format!("max_tilt_deg = {allowed}\n"),
                    _ => format!("{line}\n"),
                })
                .collect();
            let spec = spec(&text).unwrap();
            assert_eq!(spec.plan.max_tilt_deg, allowed);
            spec
        };
        let found = leaning(lean);
        let plan_there = plan(&plate(), &[], &found, options(false)).unwrap();
        keeps(&plan_there, &found);
        // All facets are the surface itself here: none needs more than is allowed.
        assert!(plan_there.figures.tilt_max_deg <= allowed + 1e-6);
        assert!(
            verify(&plate(), &[], &found, &plan_there.rows).holds,
            "{lean} of {allowed}"
        );
        let beyond = leaning(allowed + 0.05);
        let refused = plan(&plate(), &[], &beyond, options(false)).err().unwrap();
        assert_eq!(refused.code, "axis_limit", "{allowed}");
    }
}
