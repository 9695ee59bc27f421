//! Ways between passes, and from safety: round an obstacle at its side, and by another branch of the axes.

use super::*;
use crate::plan::drive::links::clear_above;
use crate::plan::drive::touch::Scenery;
use crate::plan::program::{PathDialect, ProgramMode, ProgramStyle, program};
use crate::plan::proof::row::PathRow;
use crate::plan::verify::verify;
use crate::surface::Mesh;

/// A box, closed.
fn block(low: [f64; 3], high: [f64; 3]) -> Mesh {
    let at = |k: usize| {
        let of = |axis: usize| [low[axis], high[axis]][k >> axis & 1];
        nalgebra::Vector3::new(of(0), of(1), of(2))
    };
    let sides = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let triangles: Vec<[nalgebra::Vector3<f64>; 3]> = sides
        .iter()
        .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
        .map(|t| t.map(at))
        .collect();
    Mesh::new(&triangles).unwrap()
}

/// Two plates with a wall between them that stands higher than Z reaches.
fn plates_beside_a_wall() -> (PartMesh, ScanSpec) {
    let mut raw = RawMesh::default();
    for left in [-75.0, 25.0] {
        let first = raw.vertices.len();
        for j in 0..=12 {
            for i in 0..=10 {
                let [x, y] = [5.0 * f64::from(i), 5.0 * f64::from(j) - 30.0];
                raw.vertices.push(nalgebra::Vector3::new(left + x, y, 0.0));
            }
        }
        for j in 0..12 {
            for i in 0..10 {
                let a = first + j * 11 + i;
                raw.faces.push([a, a + 1, a + 12]);
                raw.faces.push([a, a + 12, a + 11]);
            }
        }
    }
    let mut spec = ScanSpec::open(&folder().join("three_axes.toml")).unwrap();
    spec.machine.travel_mm = [[-900.0, 900.0], [-900.0, 900.0], [-900.0, 215.0]];
    spec.machine.orient_deg = Some([-360.0, 360.0]);
    spec.plan.min_coverage = 0.97;
    (PartMesh::weld(raw, true).unwrap(), spec)
}

fn wall(half_mm: f64) -> Mesh {
    block([-1.0, -half_mm, -10.0], [1.0, half_mm, 225.0])
}

/// Beside a wall the sensor stands farther off: from there the points of a dome lie farther apart than on it. A looser stand-off had
/// led to steps of 1.013 mm where 1 is allowed, and to a refusal.
#[test]
fn a_dome_beside_a_wall_is_passed_in_steps_within_the_limit() {
    let dome = height_field([30.0, 25.0], 20, |x, y| -(x * x + y * y) / 150.0);
    let part = PartMesh::weld(dome, true).unwrap();
    // A table A, a head B and a spindle that turns.
    let text = std::fs::read_to_string(folder().join("three_axes.toml")).unwrap();
    let [at, limits] = ["point_mm = [0, 0, 0]", "limits_deg = [-180, 180]"];
    let text = format!(
        "{text}\n[[machine.table]]\nname = \"A\"\naxis = [1, 0, 0]\n{at}\n{limits}\n\n[[machine.head]]\nname = \"B\"\naxis = [0, 1, 0]\n{at}\n{limits}\n"
    );
    let mut spec = spec(&text).unwrap();
    spec.plan.stand_off_tolerance_mm = 4.0;
    spec.plan.max_step_mm = 1.0;
    spec.plan.min_coverage = 0.7;
    let obstacles = [block([39.0, -60.0, 0.0], [51.0, 60.0, 60.0])];
    let plan = plan(&part, &obstacles, &spec, options(false)).unwrap();
    keeps(&plan, &spec);
    assert!(plan.figures.stand_off_max_mm > 1.0, "{:?}", plan.figures);
    let found = verify(&part, &obstacles, &spec, &plan.rows);
    assert!(found.holds, "{:?}", found.faults);
}

#[test]
fn a_wall_that_cannot_be_gone_over_is_gone_round() {
    let (part, spec) = plates_beside_a_wall();
    let obstacles = [wall(50.0)];
    let plan = plan(&part, &obstacles, &spec, options(false)).unwrap();
    keeps(&plan, &spec);
    assert!(plan.figures.coverage > 0.97, "{}", plan.figures.coverage);
    let found = verify(&part, &obstacles, &spec, &plan.rows);
    assert!(found.holds, "{:?}", found.faults);
    // Over it there is no way: some link goes beside the wall's ends.
    let beside = |r: &PathRow| !r.laser && r.axes[1].abs() > 50.0;
    assert!(plan.rows.iter().any(beside));
}

#[test]
fn a_way_that_there_is_not_is_called_so() {
    let (part, mut spec) = plates_beside_a_wall();
    spec.machine.travel_mm[1] = [-120.0, 120.0];
    let obstacles = [wall(400.0)];
    let refused = plan(&part, &obstacles, &spec, options(false))
        .err()
        .unwrap();
    assert_eq!(refused.code, "coverage_unreachable");
    let said = &refused.message;
    assert!(said.contains("no way to them was found"), "{said}");
    assert!(!said.contains("Allow more tilt"), "{said}");
    // The larger share that hangs together is there all the same.
    let partial = plan(&part, &obstacles, &spec, options(true)).unwrap();
    assert!(
        partial.figures.coverage > 0.45,
        "{}",
        partial.figures.coverage
    );
}

/// A plate that looks down, on table A and C below head B: A turns it up, or B leads the sensor under it.
const UNDER: &str = r#"
[part]
rotation_deg = [0, 180, 0]
[sensor]
line_mm = 25.0
reference_mm = 100.0
range_mm = [94.0, 106.0]
max_incidence_deg = 60.0
receiver_mm = [0, 30, -10]
body_mm = [[-20, -20, -100], [20, 50, -5]]
[plan]
overlap = 0.05
stand_off_tolerance_mm = 2.0
max_tilt_deg = 10.0
min_coverage = 0.97
clearance_mm = 3.0
max_step_mm = 2.0
max_turn_deg = 6.0
[machine]
travel_mm = { X = [-900, 900], Y = [-900, 900], Z = [-900, 900] }
mount = { origin_mm = [4, 3, -120], beam = [0, 0, -1], line = [1, 0, 0] }
[[machine.table]]
name = "A"
axis = [1, 0, 0]
point_mm = [-30, -21, 29]
limits_deg = [0, 360]
[[machine.table]]
name = "C"
axis = [0, 0, 1]
point_mm = [-34, 0, 1]
limits_deg = [-360, 360]
[[machine.head]]
name = "B"
axis = [0, 1, 0]
point_mm = [-59, 54, 45]
limits_deg = [-180, 180]
"#;

/// The beginning and the end of a path, and whether the way straight up from each is free.
fn ends_clear(part: &PartMesh, spec: &ScanSpec, rows: &[PathRow]) -> bool {
    let scenery = Scenery::new(spec, vec![&part.surface]);
    let ends = [&rows[0], &rows[rows.len() - 1]];
    ends.iter()
        .all(|row| clear_above(&spec.machine, &scenery, &row.axes))
}

fn program_of(part: &PartMesh, spec: &ScanSpec, rows: &[PathRow]) -> Result<String, ScanError> {
    let style = ProgramStyle {
        dialect: PathDialect::Siemens,
        mode: ProgramMode::Rotary,
        feed_mm_per_min: 600.0,
        number: 1,
    };
    program(spec, vec![&part.surface], rows, style).map(|made| made.text)
}

/// Of the branches of the axes one is taken whose ends a program can come to; a subset of the limits had it already.
#[test]
fn the_way_from_safety_has_a_part_in_the_choice_of_the_branch() {
    let plate = height_field([30.0, 20.0], 6, |_, _| 0.0);
    let part = PartMesh::weld(plate, true).unwrap();
    for limits in ["[-180, 180]", "[-95, 95]", "[150, 180]"] {
        let spec = spec(&UNDER.replace("[-180, 180]", limits)).unwrap();
        let plan = plan(&part, &[], &spec, options(false)).unwrap();
        keeps(&plan, &spec);
        assert!(ends_clear(&part, &spec, &plan.rows), "{limits}");
        assert!(verify(&part, &[], &spec, &plan.rows).holds, "{limits}");
        assert!(program_of(&part, &spec, &plan.rows).is_ok(), "{limits}");
        // Under the plate alone: a link leads out from below it, and is no pass.
        let led = !plan.rows[0].laser;
        assert_eq!(led, limits == "[150, 180]");
    }
}

/// Of three rotations the one nearest to the sensor must stand at half a turn, at the far end of its limits: nowhere near
/// that end does the beam meet the plate. Its courses were not laid then, only gaps filled: three strips, 0.1 apart.
#[test]
fn a_head_that_must_stand_at_half_a_turn_lays_its_strips_as_wanted() {
    let plate = height_field([30.0, 20.0], 6, |_, _| 0.0);
    let part = PartMesh::weld(plate, true).unwrap();
    for limits in ["[-180, 180]", "[150, 180]"] {
        let text = UNDER
            .replace("[-180, 180]", limits)
            .replace("overlap = 0.05", "overlap = 0.15");
        let spec = spec(&text).unwrap();
        assert_eq!(spec.plan.overlap, 0.15);
        let plan = plan(&part, &[], &spec, options(false)).unwrap();
        keeps(&plan, &spec);
        let overlap = plan.figures.overlap.unwrap();
        assert!(overlap.tenth >= 0.15, "{limits}: {overlap:?}");
        assert!(verify(&part, &[], &spec, &plan.rows).holds, "{limits}");
        // Two strips along the plate, or three across it.
        assert!(plan.figures.scan_length_mm < 121.0, "{limits}");
    }
}

/// Where the travel leaves no other way, the plan says so, and a program is refused by its name.
#[test]
fn a_path_that_no_program_comes_to_is_refused_by_name() {
    let plate = height_field([30.0, 20.0], 6, |_, _| 0.0);
    let part = PartMesh::weld(plate, true).unwrap();
    let mut narrow = spec(&UNDER.replace("[-180, 180]", "[170, 180]")).unwrap();
    // Room for some strips along the plate, and for nothing beside it.
    narrow.machine.travel_mm[0] = [75.75, 107.75];
    narrow.machine.travel_mm[1] = [0.0, 62.0];
    let plan = plan(&part, &[], &narrow, options(true)).unwrap();
    let warned = |w: &String| w.contains("nc_approach");
    assert!(
        plan.figures.warnings.iter().any(warned),
        "{:?}",
        plan.figures.warnings
    );
    let refused = program_of(&part, &narrow, &plan.rows).err().unwrap();
    assert_eq!(refused.code, "nc_approach");
}
