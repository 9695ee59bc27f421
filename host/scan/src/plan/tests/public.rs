//! The public cases of the reference of scan plans that are not kept as files: their meshes follow from formulas, which were
//! fitted to the reference's files (saddle and hole within 0.3 µm, cylinder patch within its single precision, 2026-11-29).
//! All have the specification of `step_wavy`. `baseline` is the way of a raster that was told the formula.

use super::*;
use crate::plan::verify::verify;

fn wavy() -> ScanSpec {
    ScanSpec::open(&folder().join("step_wavy.toml")).unwrap()
}

/// Planned, kept, at most 0.95 of the raster's way, and holding by a look at the rows.
fn holds(raw: RawMesh, spec: &ScanSpec, baseline_mm: f64) {
    let part = PartMesh::weld(raw, true).unwrap();
    let plan = plan(&part, &[], spec, options(false)).unwrap();
    keeps(&plan, spec);
    let way = plan.figures.scan_length_mm;
    println!("{way:.1} mm of {baseline_mm}");
    assert!(way <= 0.95 * baseline_mm, "{way}");
    assert!(plan.figures.coverage >= spec.plan.min_coverage);
    let found = verify(&part, &[], spec, &plan.rows);
    assert!(found.holds, "{:?}", found.faults);
}

#[test]
fn the_saddle_of_the_reference() {
    let raw = height_field([40.0, 32.0], 48, |x, y| (x * x - y * y) / 160.0);
    holds(raw, &wavy(), 518.718);
}

/// 40 x 32 cells; those whose middle lies within 9 mm of (-6, 4) are left out.
#[test]
fn the_hole_of_the_reference() {
    let mut raw = RawMesh::default();
    let at = |i: usize, j: usize| [2.0 * i as f64 - 40.0, 1.875 * j as f64 - 30.0];
    for i in 0..=40 {
        for j in 0..=32 {
            let [x, y] = at(i, j);
            let z = 6.0 - (x * x + y * y) / 900.0;
            raw.vertices.push(Vector3::new(x, y, z));
        }
    }
    let number = |i: usize, j: usize| 33 * i + j;
    for i in 0..40 {
        for j in 0..32 {
            let [x, y] = at(i, j);
            if (x + 1.0 + 6.0).hypot(y + 0.9375 - 4.0) < 9.0 {
                continue;
            }
            let [a, b] = [number(i, j), number(i + 1, j)];
            raw.faces.push([a, b, b + 1]);
            raw.faces.push([a, b + 1, a + 1]);
        }
    }
    assert_eq!(raw.faces.len(), 2428);
    let mut spec = wavy();
    spec.plan.min_coverage = 0.96;
    holds(raw, &spec, 415.567);
}

/// 60 mm of radius, 48 degrees to either side.
#[test]
fn the_cylinder_patch_of_the_reference() {
    let mut raw = height_field([40.0, 48.0], 48, |_, _| 0.0);
    for v in &mut raw.vertices {
        let (s, c) = v.y.to_radians().sin_cos();
        *v = Vector3::new(v.x, 60.0 * s, 60.0 * c - 20.0);
    }
    holds(raw, &wavy(), 724.691);
}

/// A binary STL that ends before its triangles do, and passes that overlap wholly.
#[test]
fn what_is_bad_in_the_reference_is_refused_by_its_name() {
    let mut stl = vec![0_u8; 80];
    stl.extend(4_u32.to_le_bytes());
    for k in 0..4 {
        let corners = [
            [0.0_f32; 3],
            [k as f32, 0.0, 0.0],
            [k as f32, 1.0, 0.0],
            [k as f32 + 1.0, 0.0, 0.0],
        ];
        stl.extend(corners.iter().flatten().flat_map(|v| v.to_le_bytes()));
        stl.extend([0; 2]);
    }
    let path = std::env::temp_dir().join(format!("umi-public-{}.stl", std::process::id()));
    for (bytes, read) in [
        (stl.len(), true),
        (stl.len() / 2, false),
        (stl.len() - 1, false),
    ] {
        std::fs::write(&path, &stl[..bytes]).unwrap();
        let found = read_part(&path);
        assert_eq!(
            found.as_ref().err().map(|e| e.code),
            (!read).then_some("mesh_unreadable")
        );
    }
    std::fs::remove_file(&path).unwrap();
    let text = std::fs::read_to_string(super::folder().join("step_wavy.toml")).unwrap();
    let whole = text.replace("overlap = 0.15", "overlap = 1.0");
    assert_ne!(whole, text);
    assert_eq!(spec(&whole).unwrap_err().code, "plan_spec");
}
