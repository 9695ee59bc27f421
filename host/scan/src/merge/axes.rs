//! What the latches of a scan say against its machine file: an axis that moved and carries nothing, and angles that look
//! like radians.

use std::f64::consts::TAU;

use umi_kinematics::{AxisChain, COLUMNS, Drive, JointKind};

use crate::format::triggers::TriggerLatch;

/// An encoder at rest flickers by less.
const REST_COUNTS: u64 = 100;
/// A swing of less says nothing of its unit.
const LEAST_SWING_DEG: f64 = 0.7;

/// A line for each, with its code in front.
pub(super) fn warnings(machine: &AxisChain, latches: &[TriggerLatch]) -> Vec<String> {
    let mut all = Vec::new();
    for (axis, column) in COLUMNS.iter().enumerate() {
        let Some((least, most)) = span(latches, axis) else {
            continue;
        };
        let moved = most.abs_diff(least);
        if moved <= REST_COUNTS {
            continue;
        }
        let of_column =
            |drive: &Drive| matches!(drive, Drive::Encoder { column: c, .. } if c == column);
        if machine.moving().any(|(_, joint)| of_column(&joint.drive)) {
            continue;
        }
        let idle = machine.joints.iter().find(|joint| of_column(&joint.drive));
        all.push(match idle {
            Some(joint) => format!(
                "idle_axis: {} moved by {moved} counts in the scan and is in neither chain: the points do not follow it",
                joint.name
            ),
            None => format!(
                "idle_axis: the board's input {column} counted {moved} in the scan, and no joint of the machine has it: the \
                 points do not follow it"
            ),
        });
    }
    all.extend(radians(machine, latches));
    all
}

/// The least and the greatest counts of an axis.
fn span(latches: &[TriggerLatch], axis: usize) -> Option<(i64, i64)> {
    let counts = || latches.iter().filter_map(|latch| latch.counts[axis]);
    Some((counts().min()?, counts().max()?))
}

/// Angles of axes that moved which would all lie within a turn in radians.
fn radians(machine: &AxisChain, latches: &[TriggerLatch]) -> Option<String> {
    let mut names = Vec::new();
    for (_, joint) in machine.moving() {
        let Drive::Encoder { column, .. } = joint.drive else {
            continue;
        };
        let axis = COLUMNS.iter().position(|known| *known == column);
        let Some((least, most)) = axis.and_then(|axis| span(latches, axis)) else {
            continue;
        };
        let ends = [least, most].map(|counts| joint.value(counts as f64).unwrap_or(0.0));
        if joint.kind != JointKind::Rotary || (ends[1] - ends[0]).abs() < LEAST_SWING_DEG {
            continue;
        }
        if ends.iter().any(|deg| deg.abs() > TAU + 1e-3) {
            return None;
        }
        names.push(format!("{} ({:.4} to {:.4})", joint.name, ends[0], ends[1]));
    }
    (!names.is_empty()).then(|| {
        format!(
            "angle_unit: no angle of {} is above 6.3, a whole turn in radians. If these axes turned further, counts_per_deg is \
             in counts a radian: 57.3 times too large",
            names.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// C by `counts_per_deg` at axis5, X at x; `chain` carries the sensor.
    fn told(counts_per_deg: f64, chain: &str, latches: &[[i64; 3]]) -> Vec<String> {
        let text = format!(
            "[[joint]]\nname = \"X\"\nkind = \"linear\"\ndirection = [1, 0, 0]\ncolumn = \"x\"\ncounts_per_mm = 1000\n\
             [[joint]]\nname = \"C\"\nkind = \"rotary\"\ndirection = [0, 0, 1]\npoint_mm = [0, 0, 0]\ncolumn = \"axis5\"\n\
             counts_per_deg = {counts_per_deg}\n[chain]\nsensor = {chain}\n"
        );
        let latches: Vec<TriggerLatch> = latches
            .iter()
            .map(|&[x, y, c]| TriggerLatch {
                number: 0,
                t_ns: 0,
                counts: [Some(x), Some(y), None, None, Some(c), None],
            })
            .collect();
        warnings(&AxisChain::parse(&text).unwrap(), &latches)
    }

    #[test]
    fn a_turn_that_is_taken_for_six_degrees_is_told() {
        let both = "[\"X\", \"C\"]";
        let turn = [[0, 0, 0], [5000, 0, 1_800_000], [9000, 0, 3_600_000]];
        assert_eq!(told(10_000.0, both, &turn), Vec::<String>::new());
        let all = told(572_958.0, both, &turn);
        assert_eq!(all.len(), 1, "{all:?}");
        assert!(
            all[0].starts_with("angle_unit") && all[0].contains("C (0.0000 to 6.2832)"),
            "{all:?}"
        );
        // At rest, or nearly: nothing to tell of.
        let rest = [[0, 0, 30_000], [5000, 0, 30_002]];
        assert_eq!(told(10_000.0, both, &rest), Vec::<String>::new());
    }

    #[test]
    fn an_axis_that_carries_nothing_is_told_when_it_moves() {
        let turn = [[0, 0, 0], [5000, 0, 1_800_000]];
        let all = told(10_000.0, "[\"X\"]", &turn);
        assert_eq!(all.len(), 1, "{all:?}");
        assert!(
            all[0].starts_with("idle_axis: C moved by 1800000 counts"),
            "{all:?}"
        );
        let all = told(
            10_000.0,
            "[\"X\", \"C\"]",
            &[[0, 0, 0], [5000, 4000, 1_800_000]],
        );
        assert_eq!(all.len(), 1, "{all:?}");
        assert!(all[0].contains("input y counted 4000"), "{all:?}");
        assert_eq!(
            told(10_000.0, "[\"X\"]", &[[0, 0, 0], [5000, 99, -100]]),
            Vec::<String>::new()
        );
    }
}
