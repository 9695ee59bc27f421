//! What leaves the planner keeps what it must, or it is refused by name: narrow parts, small ones, wide overlaps.

use nalgebra::Vector3;

use super::super::mesh::{PartMesh, RawMesh};
use super::super::planner::plan;
use super::super::planner::result::ScanPlan;
use super::super::proof::figures::JudgedOverlap;
use super::super::spec::ScanSpec;
use super::super::verify::verify;
use super::{fixed_line, height_field, machines_with_c, options, upright};

/// Plans, and looks the path through as anybody may.
fn kept(name: &str, raw: RawMesh, spec: &ScanSpec) -> ScanPlan {
    let part = PartMesh::weld(raw, true).unwrap();
    let plan = plan(&part, &[], spec, options(false)).unwrap_or_else(|e| panic!("{name}: {e}"));
    let found = verify(&part, &[], spec, &plan.rows);
    assert!(found.holds, "{name}: {:?}", found.faults);
    assert_eq!(found.coverage, plan.figures.coverage, "{name}");
    plan
}

#[test]
fn strips_on_a_part_narrower_than_the_line_overlap() {
    for (length, width) in [(120.0, 4.0), (120.0, 1.0), (60.0, 6.0), (200.0, 10.0)] {
        let flat = || height_field([length / 2.0, width / 2.0], 24, |_, _| 0.0);
        for (machine, spec) in [("turns", upright()), ("stands", fixed_line())] {
            let name = format!("{length} x {width}, the line {machine}");
            let plan = kept(&name, flat(), &spec);
            assert!(
                plan.figures.scan_length_mm < 1.05 * length,
                "{name}: {} mm",
                plan.figures.scan_length_mm
            );
        }
    }
}

#[test]
fn a_small_dome_is_seen_within_a_few_degrees_a_pose() {
    for max_turn_deg in [3.0, 5.0, 6.0] {
        let mut spec = upright();
        spec.plan.max_turn_deg = max_turn_deg;
        spec.plan.min_coverage = 0.9;
        let dome = height_field([1.2, 1.2], 24, |x, y| (4.0 - x * x - y * y).sqrt());
        let plan = kept(&format!("{max_turn_deg} degrees"), dome, &spec);
        let told = plan.figures.warnings.iter();
        assert_eq!(told.filter(|w| w.contains("is its file in mm?")).count(), 1);
    }
}

/// The outside of a tube about Z.
fn tube(radius_mm: f64, length_mm: f64) -> RawMesh {
    let (around, along) = (40, 8);
    let mut raw = RawMesh::default();
    for i in 0..around {
        let (s, c) = (std::f64::consts::TAU * f64::from(i) / f64::from(around)).sin_cos();
        for j in 0..=along {
            let z = length_mm * (f64::from(j) / f64::from(along) - 0.5);
            let at = Vector3::new(radius_mm * c, radius_mm * s, z);
            raw.vertices.push(at);
        }
    }
    let number = |i: i32, j: i32| ((i % around) * (along + 1) + j) as usize;
    for i in 0..around {
        for j in 0..along {
            let [a, b] = [number(i, j), number(i + 1, j)];
            raw.faces.push([a, b, b + 1]);
            raw.faces.push([a, b + 1, a + 1]);
        }
    }
    raw
}

#[test]
fn strips_on_both_sides_of_a_cut_overlap() {
    let mut spec = fixed_line();
    spec.plan.min_coverage = 0.95;
    kept("tube", tube(24.28, 33.437), &spec);
}

/// Where the axes point the beam at nothing, a partial path is none either, and the mesh may be inside out.
#[test]
fn what_cannot_help_is_not_advised() {
    // Its outer side lies below.
    let mut raw = height_field([10.0, 10.0], 4, |_, _| 0.0);
    for face in &mut raw.faces {
        face.swap(0, 1);
    }
    let part = PartMesh::weld(raw, true).unwrap();
    for partial in [false, true] {
        let error = plan(&part, &[], &upright(), options(partial)).unwrap_err();
        assert_eq!(error.code, "axis_limit");
        assert!(
            !error.message.contains("--allow-partial"),
            "{}",
            error.message
        );
        assert!(error.message.contains("inside out"), "{}", error.message);
    }
}

#[test]
fn more_than_half_an_overlap_is_planned_and_told() {
    for overlap in [0.5, 0.6, 0.75, 0.9] {
        let mut spec = upright();
        spec.plan.overlap = overlap;
        let wavy = height_field([25.0, 20.0], 24, |x, y| (x / 15.0).sin() + (y / 12.0).cos());
        let plan = kept(&format!("overlap {overlap}"), wavy, &spec);
        let found = plan.figures.overlap.unwrap();
        assert!(found.tenth > overlap - 0.02, "{found:?}");
        assert!(found.median < overlap + 0.1, "{found:?}");
    }
}

#[test]
fn a_part_narrower_than_the_line_takes_no_longer_than_one_straight_pass() {
    for (width, most_passes) in [(4.0, 9), (10.0, 1)] {
        let flat = || height_field([60.0, width / 2.0], 24, |_, _| 0.0);
        for (machine, spec) in [("turns", upright()), ("stands", fixed_line())] {
            let name = format!("120 x {width}, the line {machine}");
            let found = kept(&name, flat(), &spec).figures;
            // 120 mm by 10 mm/s.
            assert!(found.duration_s < 12.01, "{name}: {} s", found.duration_s);
            assert!(found.passes <= most_passes, "{name}: {}", found.passes);
        }
    }
}

#[test]
fn a_part_that_one_pass_sees_whole_has_no_overlap_to_keep() {
    for (machine, mut spec) in [("turns", upright()), ("stands", fixed_line())] {
        spec.plan.overlap = 0.7;
        let flat = height_field([60.0, 0.3], 24, |_, _| 0.0);
        let found = kept(machine, flat, &spec).figures;
        assert_eq!((found.passes, found.overlap), (1, None), "{machine}");
    }
}

/// A cap of a ball, 2.4 mm across.
fn cap() -> RawMesh {
    let (around, rings) = (48, 8);
    let mut raw = RawMesh::default();
    raw.vertices.push(Vector3::new(0.0, 0.0, 4.0));
    for ring in 1..=rings {
        let radius = 1.2 * f64::from(ring) / f64::from(rings);
        for k in 0..around {
            let (s, c) = (std::f64::consts::TAU * f64::from(k) / f64::from(around)).sin_cos();
            let z = (16.0 - radius * radius).sqrt();
            let at = Vector3::new(radius * c, radius * s, z);
            raw.vertices.push(at);
        }
    }
    let number = |ring: i32, k: i32| (1 + (ring - 1) * around + k % around) as usize;
    for k in 0..around {
        raw.faces.push([0, number(1, k), number(1, k + 1)]);
        for ring in 1..rings {
            let [a, b] = [number(ring, k), number(ring, k + 1)];
            let [c, d] = [number(ring + 1, k), number(ring + 1, k + 1)];
            raw.faces.push([a, c, d]);
            raw.faces.push([a, d, b]);
        }
    }
    raw
}

#[test]
fn a_dome_much_smaller_than_the_line_is_seen_whole_by_every_machine_with_c() {
    for (name, spec) in machines_with_c() {
        let found = kept(name, cap(), &spec).figures;
        assert!(found.coverage > 0.99, "{name}: {}", found.coverage);
    }
}

#[test]
fn an_overlap_that_is_less_somewhere_is_a_warning() {
    let mut judged = JudgedOverlap {
        wanted: 0.15,
        min: 0.066,
        tenth: 0.152,
        median: 0.17,
        resolution: 0.01,
    };
    let warning = judged.warning().unwrap();
    assert!(warning.contains("0.066") && warning.contains("0.152"));
    judged.min = 0.145;
    assert_eq!(judged.warning(), None);
    // Too little everywhere is a fault, told as one.
    (judged.min, judged.tenth) = (0.0, 0.05);
    assert_eq!(judged.warning(), None);
}

/// A line of 64 mm of which 43.7 mm are seen: passes lie as close as that needs, and the overlap is told.
#[test]
fn where_incidence_cuts_the_line_passes_lie_closer() {
    let mut spec = upright();
    spec.sensor.line_mm = 64.0;
    spec.sensor.max_incidence_deg = 20.0;
    let plan = kept("plate", height_field([60.0, 40.0], 8, |_, _| 0.0), &spec);
    let overlap = plan.figures.overlap.unwrap();
    assert!(overlap.holds() && overlap.median < 0.4, "{overlap:?}");
}

/// The part stands half a metre beside the table's axis: a turn of a few degrees carries the point off its chord.
#[test]
fn the_driven_way_keeps_the_stand_off_between_the_rows() {
    let text = super::SPEC
        .replace("[30.0, -20.0, 12.0]", "[400.0, 300.0, 20.0]")
        .replace("[10.0, 5.0, -30.0]", "[0, 0, 0]")
        .replace("[0.6, 0.8, 0]", "[0, 1, 0]")
        .replace(
            "stand_off_tolerance_mm = 1.0",
            "stand_off_tolerance_mm = 0.1",
        );
    let spec = super::spec(&text).unwrap();
    let dome = || height_field([10.0, 8.0], 12, |x, y| (900.0 - x * x - y * y).sqrt());
    let plan = kept("dome", dome(), &spec);
    let part = PartMesh::weld(dome(), true).unwrap();
    let mut most: f64 = 0.0;
    for pair in plan.rows.windows(2) {
        if !pair[0].laser || pair[0].pass != pair[1].pass {
            continue;
        }
        for k in 1..16 {
            let axes = pair[0].axes.iter().zip(&pair[1].axes);
            let axes: Vec<f64> = axes
                .map(|(a, b)| a + (b - a) * f64::from(k) / 16.0)
                .collect();
            let pose = spec.machine.forward(&axes);
            if let Some(hit) = part.surface.first_hit(&pose.origin_mm, &pose.beam, 100.0) {
                most = most.max((hit.at - spec.sensor.reference_mm).abs());
            }
        }
    }
    assert!(most <= 0.1, "{most}");
    let told = plan.figures.stand_off_max_mm;
    assert!(told > 0.0 && (told - most).abs() < 0.01, "{told} {most}");
}

/// Triangles that hang together nowhere take all the time there is; more of it would not help.
#[test]
fn a_mesh_of_loose_triangles_is_told_to_be_welded_when_the_time_is_up() {
    let whole = height_field([8.0, 8.0], 4, |_, _| 0.0);
    let vertices = whole
        .faces
        .iter()
        .flatten()
        .map(|&v| whole.vertices[v] + Vector3::z());
    let mut loose = RawMesh {
        vertices: vertices.collect(),
        faces: (0..whole.faces.len())
            .map(|k| [3 * k, 3 * k + 1, 3 * k + 2])
            .collect(),
    };
    for (k, v) in loose.vertices.iter_mut().enumerate() {
        v.z += 0.01 * (k / 3) as f64;
    }
    let mut at_once = options(false);
    at_once.time_limit = std::time::Duration::ZERO;
    for (raw, pieces) in [(whole, false), (loose, true)] {
        let part = PartMesh::weld(raw, true).unwrap();
        let error = plan(&part, &[], &upright(), at_once).unwrap_err();
        assert_eq!(error.code, "time_limit");
        assert_eq!(error.message.contains("weld"), pieces, "{error}");
    }
}
