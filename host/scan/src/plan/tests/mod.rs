//! Reference cases, and what users of other planners suffer.

mod damage;
mod judge;
mod kept;
mod links;
mod peers;
mod public;
mod reach;
mod room;
mod suffered;

use std::path::{Path, PathBuf};
use std::time::Duration;

use nalgebra::Vector3;
use serde_json::Value;

use super::course::field::{Spacing, fields};
use super::map::chart::charts;
use super::mesh::{PartMesh, RawMesh, read_part};
use super::planner::{PlanOptions, plan, result::ScanPlan};
use super::poses::{forward, inverse};
use super::proof::see::{Eye, SightDepth};
use super::spec::ScanSpec;
use crate::ScanError;
use crate::format::table::TableReader;
use crate::parallel::Threads;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan")
}

fn case(id: &str) -> Value {
    let text = std::fs::read_to_string(folder().join(format!("{id}.json"))).unwrap();
    serde_json::from_str(&text).unwrap()
}

pub(super) fn spec(text: &str) -> Result<ScanSpec, ScanError> {
    ScanSpec::read(text, Path::new(""))
}

pub(super) const SPEC: &str =
    include_str!("../../../../../tests/reference/plan/kinematics_ac.toml");

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
fn a_pose_beyond_the_limits_is_told_with_its_figures() {
    let spec = ScanSpec::open(&folder().join("kinematics_ac.toml")).unwrap();
    let names = spec.machine.names();
    let a = names.iter().position(|n| *n == "A").unwrap();
    let row = |angle: f64| {
        let values = (0..names.len()).map(|k| if k == a { angle } else { 0.0 });
        values.map(|v| v.to_string()).collect::<Vec<_>>().join(",")
    };
    let text = format!("{}\n{}\n{}\n", names.join(","), row(110.0), row(111.0));
    let table = TableReader::new(std::io::Cursor::new(text), "axes".into()).unwrap();
    let poses = forward(&spec.machine, table).unwrap();
    assert_eq!([poses[0].status, poses[1].status], ["ok", "axis_limit"]);
    assert!(poses[1].origin_mm.iter().all(|v| v.is_finite()));
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

/// Spindle, A and C have a beam alone to point: whatever the spindle's angle, the other two follow.
#[test]
fn without_a_line_an_axis_is_free_at_every_pose() {
    let spec = ScanSpec::open(&folder().join("kinematics_ac.toml")).unwrap();
    let read = |columns: usize| {
        let text = std::fs::read_to_string(folder().join("kinematics_ac.poses.csv")).unwrap();
        let cut = |line: &str| line.split(',').take(columns).collect::<Vec<_>>().join(",");
        let text: Vec<String> = text.lines().map(cut).collect();
        let table =
            TableReader::new(std::io::Cursor::new(text.join("\n") + "\n"), "poses".into()).unwrap();
        inverse(&spec.machine, table).unwrap()
    };
    let with_line = read(9);
    assert!(with_line.iter().any(|pose| !pose.singular));
    for pose in read(6) {
        assert_eq!(pose.status, "ok");
        assert!(pose.singular);
        assert!(pose.solutions.iter().all(|axes| axes["S"] == 0.0));
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
        (
            "receiver_mm = [0.0, 30.0, -10.0]",
            "receiver_mm = [0.0, 30.0, 52.0]",
            "sensor_spec",
        ),
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
    assert!(plan.figures.overlap.unwrap().min >= spec.plan.overlap);
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
    // Normals pass under the axis C, where an exact inverse turns C by 180 degrees.
    let raw = height_field([30.0, 14.0], 24, |x, y| -x * x / 160.0 - y * y / 400.0);
    let part = PartMesh::weld(raw, true).unwrap();
    for (name, spec) in machines_with_c() {
        let plan = plan(&part, &[], &spec, options(false)).unwrap();
        keeps(&plan, &spec);
        assert!(plan.figures.coverage > 0.97, "{name}");
        let c = spec.machine.names().iter().position(|n| *n == "C").unwrap();
        let most = plan
            .rows
            .windows(2)
            .filter(|w| w[0].laser && w[1].laser && w[0].pass == w[1].pass)
            .map(|w| (w[1].axes[c] - w[0].axes[c]).abs())
            .fold(0.0, f64::max);
        let naive = naive_turn(&spec, c);
        println!(
            "{name}: C turns by {most:.3} degrees a pose at most, {naive:.1} by arc cosine and tangent"
        );
        assert!(most < 3.0, "{name}: C turns by {most} degrees in a step");
        assert!(naive > 170.0, "{name}: {naive}");
    }
}

/// The largest turn of C, over steps of 2 mm along the ridge, 0.02 mm beside its top, as formulas have it that take the other
/// axis' angle from an arc cosine: never below 0.
fn naive_turn(spec: &ScanSpec, c: usize) -> f64 {
    let names = spec.machine.names();
    let tilt = names.iter().position(|n| matches!(*n, "A" | "B")).unwrap();
    let angle = |x: f64| {
        let y = 0.02;
        let at = Vector3::new(x, y, -x * x / 160.0 - y * y / 400.0);
        let beam = -Vector3::new(x / 80.0, y / 200.0, 1.0).normalize();
        let origin = at - beam * spec.sensor.reference_mm;
        let reached = spec.machine.inverse(&origin, &beam, None).unwrap();
        let leant = |axes: &&Vec<f64>| axes[tilt] >= 0.0;
        reached.solutions.iter().find(leant).map(|axes| axes[c])
    };
    let angles: Vec<f64> = (0..30)
        .filter_map(|k| angle(2.0 * f64::from(k) - 29.0))
        .collect();
    assert_eq!(angles.len(), 30);
    let off = |d: f64| (d - 360.0 * (d / 360.0).round()).abs();
    angles
        .windows(2)
        .map(|w| off(w[1] - w[0]))
        .fold(0.0, f64::max)
}

/// Machines whose C is upright where the others are at zero: on the table, in the head, on either side; with a spindle that
/// turns and with one that stands.
fn machines_with_c() -> Vec<(&'static str, ScanSpec)> {
    let head = SPEC
        .split("[machine]")
        .next()
        .unwrap()
        .replace("[10.0, 5.0, -30.0]", "[0, 0, 0]");
    let axis = |where_: &str, name: &str, axis: [i32; 3]| {
        format!(
            "[[machine.{where_}]]\nname = \"{name}\"\naxis = {axis:?}\npoint_mm = [0, 0, -20]\nlimits_deg = [-360, 360]\n"
        )
    };
    let (table, carried) = ("table", "head");
    [
        (
            "tables A and C, spindle turns",
            true,
            [axis(table, "A", [1, 0, 0]), axis(table, "C", [0, 0, 1])],
        ),
        (
            "tables B and C",
            false,
            [axis(table, "B", [0, 1, 0]), axis(table, "C", [0, 0, 1])],
        ),
        (
            "table C, head B",
            false,
            [axis(table, "C", [0, 0, 1]), axis(carried, "B", [0, 1, 0])],
        ),
        (
            "table C, head B, spindle turns",
            true,
            [axis(table, "C", [0, 0, 1]), axis(carried, "B", [0, 1, 0])],
        ),
        (
            "head C and A",
            false,
            [axis(carried, "C", [0, 0, 1]), axis(carried, "A", [1, 0, 0])],
        ),
    ]
    .map(|(name, turns, axes)| {
        let spindle = if turns { "spindle = { orient_deg = [-360, 360] }\n" } else { "" };
        let text = format!(
            "{head}[machine]\ntravel_mm = {{ X = [-900, 900], Y = [-900, 900], Z = [-900, 900] }}\n{spindle}mount = {{ origin_mm = [0, 0, -150], beam = [0, 0, -1], line = [0, 1, 0] }}\n{}",
            axes.concat()
        );
        (name, spec(&text).unwrap())
    })
    .into()
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
    assert!(plan.figures.overlap.unwrap().min >= spec.plan.overlap);
}

/// Tables B and C, and a spindle that stands: the line lies along the slope's level lines, wherever the beam is exact.
fn fixed_line() -> ScanSpec {
    let text = fixed_line_text();
    spec(&text.replace("[10.0, 5.0, -30.0]", "[0, 0, 0]")).unwrap()
}

/// The same as text, the part's place as in the reference.
fn fixed_line_text() -> String {
    SPEC.replace("[0.6, 0.8, 0]", "[0, 1, 0]")
        .replace(
            "name = \"A\"\naxis = [1, 0, 0]",
            "name = \"B\"\naxis = [0, 1, 0]",
        )
        .lines()
        .filter(|l| !l.starts_with("spindle"))
        .map(|l| format!("{l}\n"))
        .collect()
}

#[test]
fn a_saddle_under_a_line_that_follows_from_the_beam_takes_less_than_twice_the_bound() {
    // Five times the bound, where the tilt that is allowed was not spent on laying the line across the way.
    let raw = height_field([36.0, 36.0], 30, |x, y| (x * x - y * y) / 160.0);
    let part = PartMesh::weld(raw, true).unwrap();
    let spec = fixed_line();
    let plan = plan(&part, &[], &spec, options(false)).unwrap();
    keeps(&plan, &spec);
    let bound = part.surface.area_mm2() * plan.figures.coverage / spec.sensor.line_mm;
    let ratio = plan.figures.scan_length_mm / bound;
    assert!(ratio < 2.0, "{ratio}");
}

/// Steps of 10 mm joined what shorter ones see: 97.3 % in three times the way, where a turn of 1.5 degrees was allowed.
#[test]
fn looser_limits_do_no_worse() {
    let raw = height_field([30.0, 14.0], 24, |x, y| -x * x / 160.0 - y * y / 400.0);
    let part = PartMesh::weld(raw, true).unwrap();
    let mut spec = fixed_line();
    spec.plan.min_coverage = 0.985;
    let mut ways = Vec::new();
    for (step, turn) in [
        (1.0, 1.5),
        (2.0, 1.5),
        (10.0, 1.5),
        (10.0, 6.0),
        (100.0, 360.0),
    ] {
        spec.plan.max_step_mm = step;
        spec.plan.max_turn_deg = turn;
        let plan = plan(&part, &[], &spec, options(false)).unwrap();
        keeps(&plan, &spec);
        ways.push(plan.figures.scan_length_mm);
    }
    let shortest = ways.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(ways.iter().all(|w| *w < 1.01 * shortest), "{ways:?}");
}

#[test]
fn a_part_of_half_a_millimetre_and_a_whole_plate_are_planned() {
    let mut spec = upright();
    for half in [[0.3, 0.2], [0.5, 0.5]] {
        let part = PartMesh::weld(height_field(half, 4, |x, _| 0.1 * x * x), true).unwrap();
        let plan = plan(&part, &[], &spec, options(false)).unwrap();
        keeps(&plan, &spec);
        assert!(plan.figures.coverage > 0.99, "{}", plan.figures.coverage);
    }
    spec.plan.min_coverage = 1.0;
    let part = PartMesh::weld(height_field([30.0, 20.0], 8, |_, _| 0.0), true).unwrap();
    let plan = plan(&part, &[], &spec, options(false)).unwrap();
    keeps(&plan, &spec);
    assert_eq!(plan.figures.coverage, 1.0);
}

/// A shelf over the sensor's box leaves room only where the sensor stands nearer than its reference.
#[test]
fn where_the_box_would_touch_another_distance_is_taken() {
    let mut spec = upright();
    spec.plan.stand_off_tolerance_mm = 5.0;
    let part = PartMesh::weld(height_field([20.0, 4.0], 8, |_, _| 0.0), true).unwrap();
    let flat = PartMesh::weld(height_field([60.0, 60.0], 2, |_, _| 0.0), false).unwrap();
    let high = spec.sensor.body_mm[0].z.abs() + spec.sensor.reference_mm;
    let shelf = |z: f64| {
        let corners: Vec<_> = flat
            .surface
            .triangles()
            .iter()
            .map(|t| t.corners.map(|c| c + Vector3::z() * z))
            .collect();
        crate::surface::Mesh::new(&corners).unwrap()
    };
    let free = plan(&part, &[shelf(high + 10.0)], &spec, options(false)).unwrap();
    assert!(free.figures.stand_off_max_mm < 0.1);
    let low = plan(
        &part,
        &[shelf(high + spec.plan.clearance_mm - 2.0)],
        &spec,
        options(false),
    )
    .unwrap();
    keeps(&low, &spec);
    assert!(low.figures.stand_off_max_mm > 2.0, "{:?}", low.figures);
}

/// The same part turned and shifted on its table, and the table's frame with it: the same plan.
#[test]
fn a_rigid_motion_of_part_and_fixture_together_changes_nothing() {
    for raw in &shapes(20) {
        moves_alike(raw);
    }
}

/// Surfaces of several kinds.
fn shapes(cells: usize) -> [RawMesh; 4] {
    let waves = |x: f64, y: f64| 4.0 * (x / 17.0).sin() * (y / 21.0).cos() - x * x / 300.0;
    [
        height_field([30.0, 24.0], cells, waves),
        height_field([30.0, 24.0], cells, |x, y| {
            (80.0_f64.powi(2) - x * x - y * y).sqrt() - 80.0
        }),
        height_field([30.0, 24.0], cells, |x, y| (x * x - y * y) / 140.0),
        height_field([40.0, 12.0], cells, |x, y| {
            x * (y / 60.0).sin() - x * x / 200.0
        }),
    ]
}

fn moves_alike(raw: &RawMesh) {
    let spec_at = |turns: Vector3<f64>, shift: Vector3<f64>| {
        let text = SPEC
            .replace(
                "[10.0, 5.0, -30.0]",
                &format!("[{}, {}, {}]", turns.x, turns.y, turns.z),
            )
            .replace(
                "[30.0, -20.0, 12.0]",
                &format!("[{}, {}, {}]", shift.x, shift.y, shift.z),
            );
        assert_ne!(text, SPEC);
        spec(&text).unwrap()
    };
    // The part's frame in the table's: p_table = R p + t. Of a part that was moved by M, it is R M^-1.
    let about = |turns: Vector3<f64>| {
        let r = |axis: Vector3<f64>, degrees: f64| {
            nalgebra::Rotation3::new(axis * degrees.to_radians()).into_inner()
        };
        r(Vector3::z(), turns.z) * r(Vector3::y(), turns.y) * r(Vector3::x(), turns.x)
    };
    let still = {
        let part = PartMesh::weld(raw.clone(), true).unwrap();
        plan(
            &part,
            &[],
            &spec_at(Vector3::new(0.0, 4.0, 0.0), Vector3::new(5.0, 6.0, 7.0)),
            options(true),
        )
        .unwrap()
    };
    for (turns, shift) in [
        (
            Vector3::new(3.0, -2.0, 37.0),
            Vector3::new(120.0, -45.0, 8.0),
        ),
        (
            Vector3::new(25.0, -50.0, 110.0),
            Vector3::new(-30.0, 0.5, 300.0),
        ),
    ] {
        let motion = about(turns);
        let mut moved = raw.clone();
        for v in &mut moved.vertices {
            *v = motion * *v + shift;
        }
        let part = PartMesh::weld(moved, true).unwrap();
        // R' M = R and R' m + t' = t.
        let wanted = about(Vector3::new(0.0, 4.0, 0.0)) * motion.transpose();
        let angles = nalgebra::Rotation3::from_matrix_unchecked(wanted).euler_angles();
        let back = Vector3::new(angles.0, angles.1, angles.2).map(f64::to_degrees);
        assert!((about(back) - wanted).amax() < 1e-12);
        let there = Vector3::new(5.0, 6.0, 7.0) - wanted * shift;
        let spec = spec_at(back, there);
        let again = plan(&part, &[], &spec, options(true)).unwrap();
        keeps(&again, &spec);
        assert_alike(&still, &again, 0.01, 0.01);
    }
}

/// Coverage and way of two plans differ by no more than a share; the way with its links by another.
fn assert_alike(a: &ScanPlan, b: &ScanPlan, share: f64, with_links: f64) {
    let (a, b) = (&a.figures, &b.figures);
    assert!(
        (a.coverage - b.coverage).abs() <= share,
        "{} {}",
        a.coverage,
        b.coverage
    );
    assert!(
        (a.scan_length_mm / b.scan_length_mm - 1.0).abs() <= share,
        "{} {}",
        a.scan_length_mm,
        b.scan_length_mm
    );
    assert!(
        (a.path_length_mm / b.path_length_mm - 1.0).abs() <= with_links,
        "with links {} {}",
        a.path_length_mm,
        b.path_length_mm
    );
}

#[test]
fn a_mesh_written_otherwise_is_planned_alike() {
    for raw in shapes(20) {
        is_written_alike(&raw, &upright(), 0.01);
    }
    // A line that follows from the beam: two directions can be as good in way, and unlike in links.
    for raw in &shapes(20)[..2] {
        is_written_alike(raw, &fixed_line(), 0.1);
    }
}

fn is_written_alike(raw: &RawMesh, spec: &ScanSpec, with_links: f64) {
    let of = |raw: RawMesh| {
        let part = PartMesh::weld(raw, true).unwrap();
        let plan = plan(&part, &[], spec, options(true)).unwrap();
        keeps(&plan, spec);
        plan
    };
    let plain = of(raw.clone());
    // Triangles in another order, beginning at another corner.
    let mut shuffled = raw.clone();
    let count = shuffled.faces.len();
    shuffled.faces = (0..count)
        .map(|k| {
            let mut f = raw.faces[(k * 1009 + 17) % count];
            f.rotate_left(k % 3);
            f
        })
        .collect();
    assert_alike(&plain, &of(shuffled), 1e-9, 1e-9);
    // Corners of their own for each triangle, in single precision, as STL has them.
    let mut loose = RawMesh::default();
    for f in &raw.faces {
        for &v in f {
            loose
                .vertices
                .push(raw.vertices[v].map(|x| f64::from(x as f32)));
        }
        let n = loose.vertices.len();
        loose.faces.push([n - 3, n - 2, n - 1]);
    }
    assert_alike(&plain, &of(loose), 0.01, with_links);
    // Each triangle in four: the same surface.
    let mut fine = RawMesh {
        vertices: raw.vertices.clone(),
        faces: Vec::new(),
    };
    for f in &raw.faces {
        let corner = f.map(|v| raw.vertices[v]);
        let n = fine.vertices.len();
        for k in 0..3 {
            fine.vertices.push((corner[k] + corner[(k + 1) % 3]) / 2.0);
        }
        fine.faces.extend([
            [f[0], n, n + 2],
            [n, f[1], n + 1],
            [n + 2, n + 1, f[2]],
            [n, n + 1, n + 2],
        ]);
    }
    assert_alike(&plain, &of(fine), 0.01, with_links);
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

/// A part of the size of Guo and others: 135 x 380 x 650 mm, normals to 60 degrees.
fn papers_part(cells: usize) -> RawMesh {
    let pi = std::f64::consts::PI;
    height_field([190.0, 325.0], cells, |x, y| {
        110.0 * (1.0 - (x / 190.0).abs().powf(2.985)) - 122.5 + 12.5 * (pi * y / 325.0).cos()
    })
}

/// Guo and others have one scale for the whole map (eq. 6). The least and the largest overlap, which is wanted to be 0.15,
/// with their distance and with ours, on the same lines of the same map; then the shares of 3 and 97 percent of the area.
#[test]
fn equal_distances_on_a_map_are_no_equal_overlap_and_ours_are_nowhere_too_wide() {
    let (line, wanted) = (16.0, 0.15);
    let shapes: [(&str, RawMesh); 3] = [
        (
            "dome",
            height_field([60.0, 60.0], 40, |x, y| {
                (90.0_f64.powi(2) - x * x - y * y).sqrt()
            }),
        ),
        (
            "saddle",
            height_field([60.0, 60.0], 40, |x, y| (x * x - y * y) / 90.0),
        ),
        (
            "blade",
            height_field([60.0, 90.0], 40, |x, y| {
                let twist = (y / 90.0) * 0.5;
                x * twist.sin() - x * x / 110.0 * (1.0 + y / 180.0)
            }),
        ),
    ];
    for (name, raw) in shapes {
        let part = PartMesh::weld(raw, true).unwrap();
        let charts = charts(&part, 25.0, || Ok(())).unwrap();
        assert_eq!(charts.len(), 1, "{name}");
        let chart = &charts[0];
        let scales = chart.map.scales(&part, &chart.faces);
        let ratios = scales.iter().map(|(_, s)| 1.0 / (s * s));
        // Eq. 6: L / l, the root of the facets' mean ratio of areas.
        let ratio = (ratios.sum::<f64>() / scales.len() as f64).sqrt();
        let field = &fields(&part, chart)[0];
        let spacing = Spacing {
            width_mm: line,
            pitch_mm: line * (1.0 - wanted),
        };
        let levels = field.levels(&part, chart, spacing, &vec![1.0; chart.faces.len()]);
        let share = |at: f64, overlaps: &mut Vec<(f64, f64)>| {
            overlaps.sort_by(|a, b| a.0.total_cmp(&b.0));
            let all: f64 = overlaps.iter().map(|o| o.1).sum();
            let mut sum = 0.0;
            overlaps
                .iter()
                .find(|o| {
                    sum += o.1;
                    sum >= at * all
                })
                .unwrap()
                .0
        };
        let (mut theirs, mut ours) = (Vec::new(), Vec::new());
        for (k, f) in chart.map.faces.iter().enumerate() {
            let area = part.area_mm2(chart.faces[k] as usize);
            let h = f.iter().map(|v| field.height[*v as usize]).sum::<f64>() / 3.0;
            let slope = field.slope[k].norm();
            let apart = line * (1.0 - wanted) / ratio / slope;
            theirs.push((1.0 - apart / line, area));
            let next = levels.partition_point(|l| *l <= h);
            if next > 0 && next < levels.len() {
                let apart = (levels[next] - levels[next - 1]) / slope;
                ours.push((1.0 - apart / line, area));
            }
        }
        let mut shares = |at: f64| [share(at, &mut theirs), share(at, &mut ours)];
        let [least, few, many, most] = [0.0, 0.03, 0.97, 1.0 - 1e-12].map(&mut shares);
        println!(
            "{name}: eq. 6 {:.3} to {:.3} (3 and 97 %: {:.3} to {:.3}), by the local scale {:.3} to {:.3} ({:.3} to {:.3})",
            least[0], most[0], few[0], many[0], least[1], most[1], few[1], many[1]
        );
        assert!(least[1] > least[0], "{name}: {least:?}");
        let (theirs, ours) = ([few[0], many[0]], [few[1], many[1]]);
        assert!(theirs[0] < wanted - 0.01, "{name}: {theirs:?}");
        assert!(ours[0] > wanted - 0.01, "{name}: {ours:?}");
    }
}

/// The comparison of Guo and others on a part of its size; `cargo test --release -p umi-scan -- --ignored papers_part
/// --nocapture`. Last figures: tests/bench/PLAN.md.
#[test]
#[ignore = "some ten seconds"]
fn the_papers_part_on_five_axes_and_on_three() {
    let part = PartMesh::weld(papers_part(125), true).unwrap();
    let machine = |text: &str| {
        let head = SPEC.split("[machine]").next().unwrap();
        let head = head.replace("[30.0, -20.0, 12.0]", "[0, 0, 0]");
        head + "[machine]\ntravel_mm = { X = [-900, 900], Y = [-900, 900], Z = [-900, 900] }\n"
            + text
    };
    // A lathe that mills: the part lies along C, which rolls it; B swings the head; the spindle stands.
    let five = machine(
        "mount = { origin_mm = [-150, 0, 0], beam = [-1, 0, 0], line = [0, 1, 0] }\n\
         [[machine.table]]\nname = \"C\"\naxis = [0, 0, 1]\npoint_mm = [-100, 0, 0]\nlimits_deg = [-360, 360]\n\
         [[machine.head]]\nname = \"B\"\naxis = [0, 1, 0]\npoint_mm = [0, 0, 0]\nlimits_deg = [-110, 110]\n",
    )
    .replace("[10.0, 5.0, -30.0]", "[90, 0, 90]");
    // The same machine with B and C clamped.
    let three = five.split("[[machine.table]]").next().unwrap().to_owned();
    let any_tilt = |text: &str| text.replace("max_tilt_deg = 10.0", "max_tilt_deg = 65.0");
    let quarter = three.replace("line = [0, 1, 0]", "line = [0, 0, 1]");
    let spindle = three
        .replace(
            "[machine]\n",
            "[machine]\nspindle = { orient_deg = [-360, 360] }\n",
        )
        .replace("[90, 0, 90]", "[0, 0, 0]")
        .replace(
            "origin_mm = [-150, 0, 0], beam = [-1, 0, 0]",
            "origin_mm = [0, 0, -150], beam = [0, 0, -1]",
        );
    for (name, text) in [
        ("five axes", five.clone()),
        ("three, 10 degrees", three.clone()),
        ("three, any tilt", any_tilt(&three)),
        (
            "three, sensor turned by a quarter, any tilt",
            any_tilt(&quarter),
        ),
        (
            "three and a spindle that turns, any tilt",
            any_tilt(&spindle),
        ),
    ] {
        let spec = spec(&text).unwrap();
        let options = PlanOptions {
            feed_mm_per_min: 120.0,
            ..options(true)
        };
        let begun = std::time::Instant::now();
        let plan = plan(&part, &[], &spec, options).unwrap();
        let took = begun.elapsed().as_secs_f64();
        keeps(&plan, &spec);
        let passes = super::verify::passes_of(&plan.rows);
        let all: Vec<_> = passes.iter().collect();
        let samples: Vec<_> = plan.seen.iter().map(|(s, _)| *s).collect();
        let scenery = super::drive::touch::Scenery::new(&spec, vec![&part.surface]);
        let seen =
            Eye::new(&spec.sensor, &scenery, &samples).see(&all, SightDepth::Range, Threads::all());
        // Noise of a point: its root is the incidence's secant, by which the line's spot on the part grows.
        let noise: Vec<f64> = samples
            .iter()
            .zip(&seen.sights)
            .filter_map(|(s, sights)| {
                let sight = sights.first()?;
                let pose = &all[sight.pass as usize].poses[sight.step as usize];
                let ray = (s.at - pose.origin_mm).normalize();
                Some(1.0 / -ray.dot(&s.normal))
            })
            .collect();
        let rms = (noise.iter().map(|n| n * n).sum::<f64>() / noise.len() as f64).sqrt();
        let f = &plan.figures;
        println!(
            "{name}: way {:.0} mm, in all {:.0} mm, {:.0} s at 120 mm/min, {} passes, {} poses, coverage {:.3}, deviation {rms:.3} of that straight on, planned in {took:.1} s",
            f.scan_length_mm, f.path_length_mm, f.duration_s, f.passes, f.poses, f.coverage
        );
    }
}
