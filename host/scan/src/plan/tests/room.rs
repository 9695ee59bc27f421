//! Machines with little room: a spindle that turns by less than a whole turn, a travel that hardly suffices.

use super::*;
use crate::plan::verify::verify;

/// The reference's case, its spindle with this room.
fn with_room(room: &str) -> ScanSpec {
    let text = std::fs::read_to_string(folder().join("three_axes.toml")).unwrap();
    let spindle = |line: &str| {
        if line.starts_with("spindle") {
            format!("spindle = {{ orient_deg = {room} }}")
        } else {
            line.to_string()
        }
    };
    let changed: Vec<String> = text.lines().map(spindle).collect();
    spec(&changed.join("\n")).unwrap()
}

/// A spindle may stand wherever its limits let it: it sees no less than one that cannot turn.
#[test]
fn a_spindle_with_little_room_sees_no_less_than_one_that_stands() {
    let part = read_part(&folder().join("three_axes.obj")).unwrap();
    for room in ["[90, 90]", "[0, 15]", "[-40, 40]"] {
        let spec = with_room(room);
        let plan = plan(&part, &[], &spec, options(false)).unwrap();
        keeps(&plan, &spec);
        println!(
            "{room}: {} of the area, {} mm",
            plan.figures.coverage, plan.figures.scan_length_mm
        );
        assert!(
            plan.figures.coverage > 0.99,
            "{room}: {}",
            plan.figures.coverage
        );
        let found = verify(&part, &[], &spec, &plan.rows);
        assert!(found.holds, "{room}: {:?}", found.faults);
    }
}

/// Wherever Z ends, the plan keeps to it, and says what it does not reach.
#[test]
fn a_travel_that_hardly_suffices_is_kept() {
    let raw = height_field([30.0, 30.0], 16, |x, y| (x * x - y * y) / 150.0);
    let part = PartMesh::weld(raw, true).unwrap();
    let wide = upright();
    let whole = plan(&part, &[], &wide, options(false)).unwrap();
    let z = |row: &crate::plan::proof::row::PathRow| row.axes[2];
    let scanning = || whole.rows.iter().filter(|row| row.laser).map(z);
    let low = scanning().fold(f64::INFINITY, f64::min);
    let high = scanning().fold(f64::NEG_INFINITY, f64::max);
    let mut cut = 0;
    for k in [0, 5] {
        for travel in [
            [low + (high - low) * 0.08 * f64::from(k), 900.0],
            [-900.0, high - (high - low) * 0.08 * f64::from(k)],
        ] {
            let mut spec = wide.clone();
            spec.machine.travel_mm[2] = travel;
            match plan(&part, &[], &spec, options(true)) {
                Ok(plan) => {
                    keeps(&plan, &spec);
                    let reasons = &plan.figures.uncovered;
                    cut += usize::from(reasons.iter().any(|u| u.reason == "axis_limit"));
                }
                Err(error) => {
                    assert_ne!(error.code, "plan_unproved", "{travel:?}: {}", error.message)
                }
            }
        }
    }
    assert!(cut > 0);
}

/// A step of 3 mm at 45 degrees, which no beam of three axes sees as steep as its tilt allows: a line that stands slanted reaches over
/// it from the flat beside it, whatever room the spindle has.
#[test]
fn a_step_is_seen_by_a_slanted_line() {
    let raw = height_field([40.0, 25.0], 80, |x, _| x.clamp(-1.5, 1.5) + 1.5);
    let part = PartMesh::weld(raw, true).unwrap();
    for room in ["[-360, 360]", "[-30, 100]"] {
        let mut spec = upright();
        spec.machine = with_room(room).machine;
        spec.machine.travel_mm = [[-900.0, 900.0]; 3];
        spec.sensor = with_room(room).sensor;
        spec.plan.min_coverage = 0.97;
        let plan = plan(&part, &[], &spec, options(false)).unwrap();
        keeps(&plan, &spec);
        println!("{room}: {} of the area", plan.figures.coverage);
        assert!(plan.figures.coverage >= 0.97, "{room}");
        let found = verify(&part, &[], &spec, &plan.rows);
        assert!(found.holds, "{room}: {:?}", found.faults);
    }
}
