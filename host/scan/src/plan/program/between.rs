//! What a control drives between two rows when it carries the point on the part.
//!
//! The plan is proved with all axes linear between rows. A control that carries the point leads this point along a
//! straight line of the part and turns the rotary axes linearly: at each moment the sensor stands as in the plan, shifted
//! by the distance between that line and the plan's curve. Rows of the proved way are put between until this distance is
//! at most [`APART_MM`], so that the proof holds for the program, too.

use super::super::proof::row::PathRow;
use super::super::spec::ScanSpec;
use super::tip;

/// The program's way stays this near to the proved one.
pub const APART_MM: f64 = 0.02;

/// Where a linear axis stands at the end of its travel, the way stays within this of it: half the last digit of a word.
const AT_THE_END_MM: f64 = 0.0005;

/// Places at which a step's distance is measured.
const PLACES: u32 = 16;

/// The rows, with rows of the proved way between them.
pub(super) fn with_rows_between(spec: &ScanSpec, rows: &[PathRow]) -> Vec<PathRow> {
    let mut all: Vec<PathRow> = Vec::with_capacity(rows.len());
    for row in rows {
        // Each step that is too long is halved; its halves lie a quarter as far apart from their lines.
        let mut ahead = vec![row.clone()];
        while let Some(next) = ahead.pop() {
            match all.last() {
                Some(last) if apart_mm(spec, last, &next) > allowed_mm(spec, last, &next) => {
                    let middle = middle(spec, last, &next);
                    ahead.push(next);
                    ahead.push(middle);
                }
                _ => all.push(next),
            }
        }
    }
    all
}

/// Half way between two rows in all axes.
fn middle(spec: &ScanSpec, a: &PathRow, b: &PathRow) -> PathRow {
    let axes = at(a, b, 0.5);
    let scans = a.laser && b.laser && a.pass == b.pass;
    PathRow {
        pass: if scans { a.pass } else { -1 },
        laser: scans,
        pose: spec.machine.forward(&axes),
        axes,
    }
}

fn at(a: &PathRow, b: &PathRow, share: f64) -> Vec<f64> {
    let pairs = a.axes.iter().zip(&b.axes);
    pairs.map(|(x, y)| x + (y - x) * share).collect()
}

/// How far the way may lie from the proved one: both ends are within the travel, by some room or none.
fn allowed_mm(spec: &ScanSpec, a: &PathRow, b: &PathRow) -> f64 {
    let travel = spec.machine.travel_mm.iter().enumerate();
    let room = travel.flat_map(|(k, [low, high])| {
        [&a.axes, &b.axes].map(|axes| (axes[k] - low).min(high - axes[k]))
    });
    room.fold(APART_MM, f64::min).max(AT_THE_END_MM)
}

/// Upper bound of the distance between the plan's curve of the point and the straight line that the control leads it
/// along, at the same angles.
fn apart_mm(spec: &ScanSpec, a: &PathRow, b: &PathRow) -> f64 {
    let turn = a.axes[3..].iter().zip(&b.axes[3..]);
    let turn: f64 = turn.map(|(x, y)| (x - y).to_radians().abs()).sum();
    if turn == 0.0 {
        return 0.0;
    }
    let (from, to) = (tip(spec, a), tip(spec, b));
    let measured = (1..PLACES).map(|k| {
        let share = f64::from(k) / f64::from(PLACES);
        let pose = spec.machine.forward(&at(a, b, share));
        let point = pose.origin_mm + pose.beam * spec.sensor.reference_mm;
        (point - (from + (to - from) * share)).norm()
    });
    // Between two places the distance is larger by an eighth of their distance squared times the curve's second
    // derivative, at most; this is bounded by turns and levers.
    let machine = &spec.machine;
    let carriage = |row: &PathRow| nalgebra::Vector3::from_column_slice(&row.axes[..3]);
    let joints = machine.table.iter().chain(&machine.head);
    let lever = carriage(a).norm().max(carriage(b).norm())
        + machine.chain.sensor.translation_mm.norm()
        + spec.sensor.reference_mm
        + joints.map(|j| 2.0 * j.point_mm.norm()).sum::<f64>();
    let bend = turn * (turn * lever + 2.0 * (carriage(b) - carriage(a)).norm());
    measured.fold(0.0, f64::max) + bend / (8.0 * f64::from(PLACES * PLACES))
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::super::proof::row::PathRow;
    use super::super::super::tests::spec;
    use super::{APART_MM, with_rows_between};
    use nalgebra::Vector3;

    pub const TABLES: &str = r#"
[sensor]
line_mm = 16.0
reference_mm = 60.0
range_mm = [52.0, 68.0]
max_incidence_deg = 60.0
receiver_mm = [0, 30, -10]
body_mm = [[-20, -20, -100], [20, 60, -5]]
[plan]
stand_off_tolerance_mm = 1.0
max_tilt_deg = 10.0
overlap = 0.15
min_coverage = 0.9
clearance_mm = 3.0
max_step_mm = 2.0
max_turn_deg = 6.0
[machine]
travel_mm = { X = [-900, 900], Y = [-900, 900], Z = [-900, 150] }
mount = { origin_mm = [0, 0, -150], beam = [0, 0, -1], line = [0, 1, 0] }
[[machine.table]]
name = "A"
axis = [1, 0, 0]
point_mm = [0, 0, -50]
limits_deg = [-95, 95]
[[machine.table]]
name = "C"
axis = [0, 0, 1]
point_mm = [0, 0, 0]
limits_deg = [-360, 360]
"#;

    #[test]
    fn a_control_that_carries_the_point_stays_by_the_proved_way() {
        let spec = spec(TABLES).unwrap();
        let row = |pass: i32, axes: [f64; 5]| PathRow {
            pass,
            laser: pass >= 0,
            pose: spec.machine.forward(&axes),
            axes: axes.to_vec(),
        };
        // A step of a pass, a link, and one along the end of Z.
        let rows = [
            row(0, [40.0, 10.0, 80.0, 10.0, 0.0]),
            row(0, [41.0, 11.0, 80.0, 12.0, 5.0]),
            row(-1, [-90.0, 120.0, 150.0, -60.0, 200.0]),
            row(1, [80.0, -60.0, 150.0, 70.0, -30.0]),
        ];
        let all = with_rows_between(&spec, &rows);
        for r in &rows {
            assert!(
                all.iter().any(|o| o.axes == r.axes),
                "a row of the plan is gone"
            );
        }
        let tip = |p: &super::super::super::machine::SensorPose| p.origin_mm + p.beam * 60.0;
        for w in all.windows(2) {
            let scans = w[0].laser && w[1].laser;
            assert!(!scans || w[0].pass == w[1].pass);
            for k in 0..=50 {
                let share = f64::from(k) / 50.0;
                let axes = super::at(&w[0], &w[1], share);
                let proved = spec.machine.forward(&axes);
                let driven = tip(&w[0].pose).lerp(&tip(&w[1].pose), share);
                let off: Vector3<f64> = driven - tip(&proved);
                assert!(off.norm() <= APART_MM, "{}", off.norm());
                let carriage = spec
                    .machine
                    .carriage(&(driven - proved.beam * 60.0), &axes[3..]);
                assert!(carriage.z <= 150.0006, "{}", carriage.z);
            }
        }
        // The first step is scanned to its end, and nothing of the links is.
        let scanned: Vec<i32> = all.iter().map(|r| r.pass).collect();
        let first = scanned.iter().take_while(|p| **p == 0).count();
        assert!(first > 2 && scanned[first..scanned.len() - 1].iter().all(|p| *p == -1));
    }
}
