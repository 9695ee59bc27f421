//! Reference cases, and what users of other planners suffer.

use std::path::{Path, PathBuf};
use std::time::Duration;

use nalgebra::Vector3;
use serde_json::Value;

use super::mesh::{PartMesh, RawMesh, read_part};
use super::planner::{PlanOptions, plan, result::ScanPlan};
use super::poses::{forward, inverse};
use super::spec::ScanSpec;
use crate::ScanError;
use crate::format::table::TableReader;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan")
}

fn case(id: &str) -> Value {
    let text = std::fs::read_to_string(folder().join(format!("{id}.json"))).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn spec(text: &str) -> Result<ScanSpec, ScanError> {
    ScanSpec::read(text, Path::new(""))
}

const SPEC: &str = include_str!("../../../../tests/reference/plan/kinematics_ac.toml");

#[test]
fn poses_of_the_reference_within_a_hundredth_of_a_nanometre() {
    let case = case("kinematics_ac");
    let spec = ScanSpec::open(&folder().join("kinematics_ac.toml")).unwrap();
    let table = TableReader::open(&folder().join("kinematics_ac.axes.csv")).unwrap();
    let poses = forward(&spec.machine, table).unwrap();
    let wanted = case["forward"].as_array().unwrap();
    assert_eq!(poses.len(), wanted.len());
    for (pose, wanted) in poses.iter().zip(wanted) {
        for (k, found) in [pose.origin_mm, pose.beam, pose.line].iter().enumerate() {
            for (j, v) in found.iter().enumerate() {
                assert!((v - wanted[k][j].as_f64().unwrap()).abs() < 1e-8);
            }
        }
    }
}

#[test]
fn all_branches_of_the_reference_and_each_leads_back_to_its_pose() {
    let case = case("kinematics_ac");
    let spec = ScanSpec::open(&folder().join("kinematics_ac.toml")).unwrap();
    let table = TableReader::open(&folder().join("kinematics_ac.poses.csv")).unwrap();
    let found = inverse(&spec.machine, table).unwrap();
    let wanted = case["inverse"].as_array().unwrap();
    assert_eq!(found.len(), wanted.len());
    let text = std::fs::read_to_string(folder().join("kinematics_ac.poses.csv")).unwrap();
    for ((pose, wanted), line) in found.iter().zip(wanted).zip(text.lines().skip(1)) {
        assert_eq!(pose.status, "ok");
        assert_eq!(pose.singular, wanted["singular"].as_bool().unwrap());
        assert_eq!(
            pose.solutions.len() as u64,
            wanted["solutions"].as_u64().unwrap()
        );
        let v: Vec<f64> = line.split(',').map(|w| w.parse().unwrap()).collect();
        for solution in &pose.solutions {
            let axes: Vec<f64> = spec
                .machine
                .names()
                .iter()
                .map(|n| solution[*n].as_f64().unwrap())
                .collect();
            let back = spec.machine.forward(&axes);
            let all = back.origin_mm.iter().chain(&back.beam).chain(&back.line);
            for (a, b) in all.zip(&v) {
                assert!((a - b).abs() < 1e-8, "{a} {b}");
            }
        }
    }
}

#[test]
fn wrong_specifications_are_refused_by_their_section() {
    for (from, to, code) in [
        ("overlap = 0.15", "overlap = 1.0", "plan_spec"),
        ("overlap = 0.15", "overlap = nan", "plan_spec"),
        ("max_step_mm = 2.0", "max_step_mm = 0", "plan_spec"),
        ("max_tilt_deg", "max_tlt_deg", "plan_spec"),
        ("line_mm = 16.0", "line_mm = -16.0", "sensor_spec"),
        ("reference_mm = 60.0", "reference_mm = 70.0", "sensor_spec"),
        (
            "line = [0.6, 0.8, 0]",
            "line = [0.6, 0.8, 0.1]",
            "machine_spec",
        ),
        ("axis = [1, 0, 0]", "axis = [0, 0, 0]", "machine_spec"),
        ("name = \"C\"", "name = \"A\"", "machine_spec"),
        (
            "limits_deg = [-110, 110]",
            "limits_deg = [110, -110]",
            "machine_spec",
        ),
        ("[part]", "[prat]", "bad_spec"),
        (
            "rotation_deg = [10.0, 5.0, -30.0]",
            "rotation_deg = [10.0, inf, -30.0]",
            "bad_spec",
        ),
        ("[sensor]", "[sensor", "bad_spec"),
    ] {
        let text = SPEC.replacen(from, to, 1);
        assert_ne!(text, SPEC, "{from}");
        assert_eq!(spec(&text).unwrap_err().code, code, "{to}");
    }
    assert!(spec(SPEC).is_ok());
}

fn options(allow_partial: bool) -> PlanOptions {
    PlanOptions {
        allow_partial,
        time_limit: Duration::from_secs(120),
        feed_mm_per_min: 600.0,
    }
}

/// What every plan must keep, looked at on its rows.
fn keeps(plan: &ScanPlan, spec: &ScanSpec) {
    let figures = &plan.figures;
    assert!(figures.stand_off_max_mm <= spec.plan.stand_off_tolerance_mm);
    assert!(figures.tilt_max_deg <= spec.plan.max_tilt_deg + 1.5);
    assert!(figures.clearance_mm >= spec.plan.clearance_mm);
    for pair in plan.rows.windows(2) {
        let [a, b] = [&pair[0], &pair[1]];
        assert!(spec.machine.within_limits(&a.axes));
        let back = spec.machine.forward(&a.axes);
        assert!((back.origin_mm - a.pose.origin_mm).norm() < 1e-6);
        if a.laser && b.laser && a.pass == b.pass {
            let tip =
                |p: &super::machine::SensorPose| p.origin_mm + p.beam * spec.sensor.reference_mm;
            assert!((tip(&b.pose) - tip(&a.pose)).norm() <= spec.plan.max_step_mm + 1e-9);
            for (x, y) in a.axes[3..].iter().zip(&b.axes[3..]) {
                assert!((x - y).abs() <= spec.plan.max_turn_deg + 1e-9);
            }
        }
    }
}

#[test]
fn the_reference_is_covered_in_less_way_than_a_raster_that_knows_the_formula() {
    let case = case("three_axes");
    let spec = ScanSpec::open(&folder().join("three_axes.toml")).unwrap();
    let part = read_part(&folder().join("three_axes.obj")).unwrap();
    let plan = plan(&part, &[], &spec, options(false)).unwrap();
    keeps(&plan, &spec);
    assert!(plan.figures.coverage > 0.99, "{}", plan.figures.coverage);
    let raster = case["baseline"]["scan_length_mm"].as_f64().unwrap();
    assert!(
        plan.figures.scan_length_mm < 0.95 * raster,
        "{}",
        plan.figures.scan_length_mm
    );
    assert!(plan.figures.overlap.unwrap().min > spec.plan.overlap - 0.05);
}

/// A height over a rectangle, as a mesh.
fn height_field(half: [f64; 2], cells: usize, z: impl Fn(f64, f64) -> f64) -> RawMesh {
    let mut raw = RawMesh::default();
    let at = |k: usize, half: f64| (2.0 * k as f64 / cells as f64 - 1.0) * half;
    for i in 0..=cells {
        for j in 0..=cells {
            let (x, y) = (at(i, half[0]), at(j, half[1]));
            raw.vertices.push(Vector3::new(x, y, z(x, y)));
        }
    }
    let number = |i: usize, j: usize| i * (cells + 1) + j;
    for i in 0..cells {
        for j in 0..cells {
            let [a, b, c, d] = [
                number(i, j),
                number(i + 1, j),
                number(i + 1, j + 1),
                number(i, j + 1),
            ];
            raw.faces.push([a, b, c]);
            raw.faces.push([a, c, d]);
        }
    }
    raw
}

/// The machine of the reference, upright and with a plain mount.
fn upright() -> ScanSpec {
    let text = SPEC
        .replace("[10.0, 5.0, -30.0]", "[0, 0, 0]")
        .replace("[0.6, 0.8, 0]", "[0, 1, 0]");
    spec(&text).unwrap()
}

#[test]
fn a_ridge_under_the_pole_is_passed_without_whirling() {
    let spec = upright();
    // Normals pass near the axis C, where an exact inverse turns C by nearly 180 degrees.
    let raw = height_field([30.0, 14.0], 24, |x, y| -x * x / 160.0 - y * y / 400.0);
    let part = PartMesh::weld(raw, true).unwrap();
    let plan = plan(&part, &[], &spec, options(false)).unwrap();
    keeps(&plan, &spec);
    assert!(plan.figures.coverage > 0.97);
}

#[test]
fn a_sharp_ridge_is_seen_up_to_its_edge() {
    // The normals on either side say nothing about the other: 53 degrees lie between them.
    let raw = height_field([30.0, 20.0], 16, |x, _| -x.abs() * 0.5);
    let part = PartMesh::weld(raw, true).unwrap();
    let spec = upright();
    let plan = plan(&part, &[], &spec, options(false)).unwrap();
    keeps(&plan, &spec);
    assert!(plan.figures.coverage > 0.98, "{}", plan.figures.coverage);
}

#[test]
fn without_any_turning_axis_passes_run_across_the_fixed_line() {
    let text = std::fs::read_to_string(folder().join("three_axes.toml")).unwrap();
    let fixed: String = text
        .lines()
        .filter(|l| !l.starts_with("spindle"))
        .map(|l| format!("{l}\n"))
        .collect();
    assert_ne!(fixed, text);
    let spec = spec(&fixed).unwrap();
    let part = read_part(&folder().join("three_axes.obj")).unwrap();
    let plan = plan(&part, &[], &spec, options(false)).unwrap();
    keeps(&plan, &spec);
    let most = case("three_axes")["max_scan_length_mm"].as_f64().unwrap();
    assert!(
        plan.figures.scan_length_mm < most,
        "{}",
        plan.figures.scan_length_mm
    );
}

#[test]
fn a_narrow_strip_is_seen_as_far_as_wanted() {
    let raw = height_field([100.0, 3.0], 40, |x, _| x * x / 2000.0);
    let part = PartMesh::weld(raw, true).unwrap();
    let spec = upright();
    let plan = plan(&part, &[], &spec, options(false)).unwrap();
    keeps(&plan, &spec);
    assert!(plan.figures.coverage >= 0.97);
}

#[test]
fn a_step_surface_is_planned_like_a_mesh() {
    let case = case("step_wavy");
    let spec = ScanSpec::open(&folder().join("step_wavy.toml")).unwrap();
    let part = read_part(&folder().join("step_wavy.step")).unwrap();
    let plan = plan(&part, &[], &spec, options(false)).unwrap();
    keeps(&plan, &spec);
    assert!(plan.figures.coverage > 0.99, "{}", plan.figures.coverage);
    let raster = case["baseline"]["scan_length_mm"].as_f64().unwrap();
    assert!(
        plan.figures.scan_length_mm < 0.95 * raster,
        "{}",
        plan.figures.scan_length_mm
    );
}

#[test]
fn what_no_surface_is_is_refused_by_name() {
    let square = height_field([20.0, 20.0], 2, |_, _| 0.0);
    let code = |change: &dyn Fn(&mut RawMesh)| {
        let mut raw = square.clone();
        change(&mut raw);
        super::mesh::weld::check_finite(&raw)
            .and_then(|()| PartMesh::weld(raw, true).map(|_| ()))
            .unwrap_err()
            .code
    };
    assert_eq!(code(&|r| r.faces[3].swap(0, 1)), "mesh_not_oriented");
    assert_eq!(
        code(&|r| {
            r.vertices.push(Vector3::new(0.0, 0.0, 9.0));
            let n = r.vertices.len() - 1;
            r.faces.push([0, 4, n]);
            r.faces.push([4, 0, n]);
        }),
        "mesh_not_manifold"
    );
    assert_eq!(
        code(&|r| r.vertices.iter_mut().for_each(|v| *v *= 0.001)),
        "mesh_scale"
    );
    assert_eq!(code(&|r| r.vertices[4].z = f64::NAN), "mesh_not_finite");
    assert_eq!(
        code(&|r| r.vertices.iter_mut().for_each(|v| v.y = v.x)),
        "mesh_degenerate"
    );
    assert_eq!(
        code(&|r| r.vertices.iter_mut().for_each(|v| *v *= 1e300)),
        "mesh_scale"
    );
}

#[test]
fn what_cannot_be_seen_is_refused_with_its_reason() {
    let mut text = SPEC.to_string();
    // A table that cannot tilt far enough for a wall.
    text = text.replace("limits_deg = [-110, 110]", "limits_deg = [-20, 20]");
    let spec = spec(&text).unwrap();
    let mut raw = height_field([20.0, 20.0], 6, |_, _| 0.0);
    for v in &mut raw.vertices {
        *v = Vector3::new(v.x, 0.0, v.y);
    }
    let part = PartMesh::weld(raw, true).unwrap();
    let refused = plan(&part, &[], &spec, options(false)).unwrap_err();
    assert_eq!(refused.code, "axis_limit");
    assert!(
        refused.details["uncovered"][0]["area_mm2"]
            .as_f64()
            .unwrap()
            > 1000.0
    );
}
