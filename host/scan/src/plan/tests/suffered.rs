//! What users of other flatteners and planners suffer, by their issues.

use super::*;

fn all(part: &PartMesh) -> Vec<u32> {
    (0..part.faces.len() as u32).collect()
}

/// libigl, issue 2409: a map of half a cylinder. It unrolls without stretch.
#[test]
fn half_a_cylinder_unrolls() {
    let mut raw = height_field([30.0, 90.0], 40, |_, _| 0.0);
    for v in &mut raw.vertices {
        let (s, c) = v.y.to_radians().sin_cos();
        *v = Vector3::new(v.x, 20.0 * s, 20.0 * c);
    }
    let part = PartMesh::weld(raw, true).unwrap();
    let map = super::super::map::FlatMap::new(&part, &all(&part));
    let q = map.quality;
    assert_eq!(q.flips, 0);
    assert!(q.max_angle_error_deg < 0.1, "{}", q.max_angle_error_deg);
    assert!(
        q.scale_max / q.scale_min < 1.002,
        "{} {}",
        q.scale_min,
        q.scale_max
    );
    assert!(!map.lies_over_itself());
    let spec = upright();
    let plan = plan(&part, &[], &spec, options(true)).unwrap();
    keeps(&plan, &spec);
    assert!(plan.figures.coverage > 0.97, "{}", plan.figures.coverage);
}

/// libigl, issue 66: vertices that no triangle uses, among many pieces.
#[test]
fn unused_vertices_among_many_pieces_change_nothing() {
    let mut plain = RawMesh::default();
    let mut strewn = RawMesh::default();
    for k in 0..6 {
        let field = height_field([6.0, 8.0], 5, |x, _| x * x / 80.0);
        let away = Vector3::new(14.0 * f64::from(k), 0.0, 0.0);
        for (mesh, unused) in [(&mut plain, 0), (&mut strewn, 40)] {
            let first = mesh.vertices.len() + unused;
            let far = |j: i32| Vector3::new(f64::from(j * k) * 1e3, -5e4, 7e4);
            mesh.vertices.extend((0..unused as i32).map(far));
            mesh.vertices
                .extend(field.vertices.iter().map(|v| v + away));
            let faces = field.faces.iter().map(|f| f.map(|c| c + first));
            mesh.faces.extend(faces);
        }
    }
    let spec = upright();
    let planned = [plain, strewn].map(|raw| {
        let part = PartMesh::weld(raw, true).unwrap();
        assert_eq!(part.components, 6);
        assert_eq!(part.vertices.len(), 6 * 36);
        let plan = plan(&part, &[], &spec, options(false)).unwrap();
        keeps(&plan, &spec);
        plan
    });
    assert!(planned[0].figures.coverage > 0.97);
    let rows = |k: usize| planned[k].rows.iter().map(|r| r.axes.clone());
    assert!(rows(0).eq(rows(1)));
}

/// noether, issues 197 and 118: a flat part, and one that lies far from its file's origin.
#[test]
fn a_flat_part_and_one_far_from_its_origin_are_planned_alike() {
    let near = upright();
    let mut lengths = Vec::new();
    for far in [0.0, 4e5] {
        let mut raw = height_field([30.0, 20.0], 10, |_, _| 0.0);
        for v in &mut raw.vertices {
            *v += Vector3::new(far, -far, far);
        }
        let text = SPEC
            .replace("[10.0, 5.0, -30.0]", "[0, 0, 0]")
            .replace("[0.6, 0.8, 0]", "[0, 1, 0]");
        let place = text
            .lines()
            .find(|l| l.starts_with("translation_mm"))
            .unwrap();
        let there = near.machine.chain.workpiece.translation_mm - Vector3::new(far, -far, far);
        let here = format!(
            "translation_mm = [{:?}, {:?}, {:?}]",
            there.x, there.y, there.z
        );
        let spec = spec(&text.replace(place, &here)).unwrap();
        let part = PartMesh::weld(raw, true).unwrap();
        let plan = plan(&part, &[], &spec, options(false)).unwrap();
        keeps(&plan, &spec);
        assert!(plan.figures.coverage > 0.97, "{far}");
        lengths.push(plan.figures.scan_length_mm);
    }
    let [a, b] = [lengths[0], lengths[1]];
    assert!((a / b - 1.0).abs() < 1e-3, "{a} {b}");
}

/// noether, issue 185: near a hole the triangles are fine, and poses must not crowd there.
#[test]
fn poses_do_not_crowd_where_the_triangles_do() {
    let mut raw = RawMesh::default();
    let (rings, around) = (24, 48);
    for i in 0..=rings {
        // From 3 mm out to 30: 0.3 mm wide at the hole, 2.8 at the border.
        let r = 3.0 * 10.0_f64.powf(f64::from(i) / f64::from(rings));
        for j in 0..around {
            let (s, c) = (std::f64::consts::TAU * f64::from(j) / f64::from(around)).sin_cos();
            raw.vertices
                .push(Vector3::new(r * c, r * s, -r * r / 400.0));
        }
    }
    let number = |i: i32, j: i32| (i * around + j % around) as usize;
    for i in 0..rings {
        for j in 0..around {
            let [a, b] = [number(i, j), number(i + 1, j)];
            let [c, d] = [number(i + 1, j + 1), number(i, j + 1)];
            raw.faces.push([a, b, c]);
            raw.faces.push([a, c, d]);
        }
    }
    let part = PartMesh::weld(raw, true).unwrap();
    let spec = upright();
    let plan = plan(&part, &[], &spec, options(false)).unwrap();
    keeps(&plan, &spec);
    assert!(plan.figures.coverage >= 0.97, "{}", plan.figures.coverage);
    let tip = |r: &super::super::proof::row::PathRow| {
        r.pose.origin_mm + r.pose.beam * spec.sensor.reference_mm
    };
    let steps = plan
        .rows
        .windows(2)
        .filter(|w| w[0].laser && w[0].pass == w[1].pass);
    let mut steps: Vec<f64> = steps.map(|w| (tip(&w[1]) - tip(&w[0])).norm()).collect();
    // Turning on the spot is no step.
    steps.retain(|s| *s > 1e-6);
    steps.sort_by(f64::total_cmp);
    let middle = steps[steps.len() / 2];
    assert!(steps[0] > 0.4 * middle, "{} of {middle}", steps[0]);
}
