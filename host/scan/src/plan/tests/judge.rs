//! What a proof says of paths that somebody else has laid.

use nalgebra::Vector3;

use super::super::machine::SensorPose;
use super::super::mesh::PartMesh;
use super::super::proof::row::PathRow;
use super::super::spec::ScanSpec;
use super::super::verify::{PathFindings, verify};
use super::{height_field, upright};

/// Straight passes along X over a flat plate of 80 mm, so many mm apart; the outermost lie 5 mm within its edges, or further.
fn judged(count: i32, apart_mm: f64, half_mm: f64) -> (ScanSpec, PathFindings) {
    judged_by(upright(), count, apart_mm, half_mm)
}

/// The same with a sensor of which more is said.
fn judged_by(
    mut spec: ScanSpec,
    count: i32,
    apart_mm: f64,
    half_mm: f64,
) -> (ScanSpec, PathFindings) {
    // What lies between strips that do not touch goes unseen.
    spec.plan.min_coverage = 0.9;
    let part = PartMesh::weld(height_field([40.0, half_mm], 16, |_, _| 0.0), true).unwrap();
    let mut rows = Vec::new();
    for pass in 0..count {
        let y = f64::from(2 * pass + 1 - count) / 2.0 * apart_mm;
        let mut row = |x: f64, pass: i32, up: f64| {
            let pose = SensorPose {
                origin_mm: Vector3::new(x, y, spec.sensor.reference_mm + up),
                beam: -Vector3::z(),
                line: Vector3::y(),
            };
            let reached = spec
                .machine
                .inverse(&pose.origin_mm, &pose.beam, Some(&pose.line));
            let axes = reached.unwrap().solutions.swap_remove(0);
            rows.push(PathRow {
                pass,
                laser: pass >= 0,
                pose: spec.machine.forward(&axes),
                axes,
            });
        };
        for k in 0..=50 {
            row(-39.99 + 79.98 * f64::from(k) / 50.0, pass, 0.0);
        }
        row(39.99, -1, 30.0);
        row(-39.99, -1, 30.0);
    }
    let found = verify(&part, &[], &spec, &rows);
    (spec, found)
}

#[test]
fn strips_that_overlap_too_little_are_told_by_name() {
    let names =
        |found: &PathFindings| -> Vec<&str> { found.faults.iter().map(|f| f.fault).collect() };
    let five = |apart_mm: f64| judged(5, apart_mm, 2.0 * apart_mm + 5.0);
    let (spec, found) = five(16.0 * (1.0 - 0.16));
    assert_eq!(names(&found), [""; 0], "{:?}", found.faults);
    assert!(found.holds);
    let overlap = found.overlap.unwrap();
    assert_eq!(overlap.wanted, spec.plan.overlap);
    assert!((overlap.median - 0.16).abs() < 0.01, "{overlap:?}");
    // More than half of the line, too: there the part's edge cuts some strips, by up to an eighth of the line.
    for share in [0.5, 0.6, 0.7, 0.85] {
        let (_, found) = five(16.0 * (1.0 - share));
        let overlap = found.overlap.unwrap();
        assert!(
            (overlap.median - share).abs() < 0.015,
            "{share}: {overlap:?}"
        );
    }
    // Too little; none at all, where nothing is seen by two passes; and a gap of a twentieth of the line.
    for (share, most) in [(0.08, 0.09), (0.0, 0.002), (-0.05, 0.0)] {
        let (_, found) = five(16.0 * (1.0 - share));
        assert_eq!(names(&found), ["overlap"], "{share}: {:?}", found.faults);
        assert!(!found.holds);
        let overlap = found.overlap.unwrap();
        assert!(
            overlap.min <= most && overlap.median <= most,
            "{share}: {overlap:?}"
        );
    }
    // A single strip has no neighbour.
    let (_, found) = judged(1, 0.0, 30.0);
    assert_eq!(found.overlap, None);
    assert_eq!(names(&found), ["coverage"]);
}

/// From 60 mm a line of 64 mm lies within 20 degrees for 43.7 mm of it: what overlaps is counted from there.
#[test]
fn strips_that_the_incidence_cuts_short_of_the_line_overlap_by_what_is_seen() {
    let mut spec = upright();
    spec.sensor.line_mm = 64.0;
    spec.sensor.max_incidence_deg = 20.0;
    let seen_mm = 2.0 * spec.sensor.reference_mm * f64::to_radians(20.0).tan();
    for share in [0.25, 0.16, 0.08, 0.0, -0.05] {
        let apart_mm = seen_mm - 64.0 * share;
        let (_, found) = judged_by(spec.clone(), 3, apart_mm, apart_mm + 15.0);
        let overlap = found.overlap.unwrap();
        let wanted = f64::max(share, 0.0);
        assert!(
            (overlap.median - wanted).abs() < 0.01,
            "{share}: {overlap:?}"
        );
        assert_eq!(found.holds, share > 0.15, "{share}: {:?}", found.faults);
    }
}

/// A plate is open: from below nothing stands between a receiver and the points above it.
#[test]
fn a_receiver_behind_the_surface_sees_nothing() {
    let mut spec = upright();
    for (along_beam, all) in [(-10.0, true), (70.0, false)] {
        spec.sensor.receiver_mm = Vector3::new(0.0, 30.0, along_beam);
        let (_, found) = judged_by(spec.clone(), 5, 13.0, 30.0);
        assert_eq!(found.coverage > 0.9, all, "{}", found.coverage);
        assert!(all || found.coverage == 0.0);
    }
}
