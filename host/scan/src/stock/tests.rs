use nalgebra::Vector6;

use super::*;
use crate::rigid::rotation;
use crate::solve::measure;

const SIZE: [f64; 3] = [60.0, 40.0, 20.0];

/// A box about the origin.
fn block() -> Mesh {
    let c = |i: usize| {
        Vec3::from_fn(|k, _| {
            if i & (1 << k) == 0 {
                -SIZE[k] / 2.0
            } else {
                SIZE[k] / 2.0
            }
        })
    };
    let faces = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let corners: Vec<[Vec3; 3]> = faces
        .iter()
        .flat_map(|f| [[c(f[0]), c(f[1]), c(f[2])], [c(f[0]), c(f[2]), c(f[3])]])
        .collect();
    Mesh::new(&corners).unwrap()
}

/// A lattice of points on each face, away from edges, with this stock (−x, +x, −y, +y, −z, +z), where `place` puts it.
fn raw(stock: [Option<f64>; 6], place: &Pose) -> Vec<Vec3> {
    let mut points = Vec::new();
    for (face, stock) in stock.iter().enumerate() {
        let Some(stock) = stock else { continue };
        let (axis, sign) = (face / 2, if face % 2 == 0 { -1.0 } else { 1.0 });
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for i in 0..20 {
            for j in 0..20 {
                let mut p = Vec3::zeros();
                p[axis] = sign * (SIZE[axis] / 2.0 + stock);
                p[u] = SIZE[u] * (f64::from(i) / 19.0 - 0.5) * 0.8;
                p[v] = SIZE[v] * (f64::from(j) / 19.0 - 0.5) * 0.8;
                points.push(place.point(&p));
            }
        }
    }
    points
}

fn task<'a>(model: &'a Mesh, points: &'a [Vec3]) -> StockTask<'a> {
    StockTask {
        model,
        points,
        objective: Objective::Min,
        locked: [false; 6],
        pivot: Vec3::zeros(),
        start: Pose::identity(),
        require_mm: None,
        apart_is_raw: false,
        demands: &[],
        threads: Threads::new(2),
    }
}

fn moved() -> Pose {
    Pose {
        rotation: rotation(&Vec3::new(0.012, -0.007, 0.02)),
        translation_mm: Vec3::new(0.9, -0.6, 0.4),
    }
}

const UNEVEN: [Option<f64>; 6] = [
    Some(1.0),
    Some(0.2),
    Some(0.5),
    Some(0.3),
    Some(0.9),
    Some(0.3),
];

#[test]
fn the_least_stock_is_as_large_as_the_narrowest_pair_of_faces_allows_and_no_motion_improves_it() {
    let (model, points) = (block(), raw(UNEVEN, &moved()));
    let found = task(&model, &points).find().unwrap();
    assert!((found.min_mm - 0.4).abs() < 1e-6, "{}", found.min_mm);
    assert_eq!((found.n_used, found.reasons.len()), (2400, 0));
    improves_none(&model, &points, &found, 2_000);
}

/// A few minutes: run by hand (docs: tests/bench/LOCALISE.md).
#[test]
#[ignore = "minutes"]
fn a_million_small_motions_improve_no_place() {
    let model = block();
    for stock in [
        UNEVEN,
        [Some(0.5); 6],
        [0.7, 0.1, 0.2, 0.9, 0.4, 0.4].map(Some),
    ] {
        let points = raw(stock, &moved());
        let found = task(&model, &points).find().unwrap();
        improves_none(&model, &points, &found, 1_000_000 / 3 + 1);
    }
}

/// So many random motions of up to 2 µm and 0.05 mrad leave no more stock than the place that was found, by
/// more than 1e-7 mm.
fn improves_none(model: &Mesh, points: &[Vec3], found: &StockFound, count: u32) {
    let surface = CompositeSurface::from(model.clone());
    let least = |points: &[Vec3], place: &Pose| {
        span(
            &measure(&surface, points, place, &[], Threads::new(1)),
            0..points.len(),
        )
        .0
    };
    // Where stock is short already: if these have no more, all have no more.
    let stock = measure(&surface, points, &found.motion, &[], Threads::new(1));
    let tight: Vec<Vec3> = points
        .iter()
        .zip(&stock)
        .filter(|(_, here)| here.distance_mm < found.min_mm + 1e-5)
        .map(|(point, _)| *point)
        .collect();
    assert!(tight.len() >= 6, "{}", tight.len());
    let mut state = 7_u64;
    let mut random = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
    };
    for _ in 0..count {
        let step = Vector6::from_fn(|i, _| random() * if i < 3 { 1e-4 } else { 4e-3 });
        let other = crate::rigid::stepped(&found.motion, &step, &Vec3::zeros());
        if least(&tight, &other) > found.min_mm + 1e-7 {
            assert!(least(points, &other) <= found.min_mm + 1e-7, "{step}");
        }
    }
}

#[test]
fn locked_components_stay_exactly_and_cost_what_they_must() {
    let model = block();
    let points = raw(UNEVEN, &Pose::identity());
    let mut task = task(&model, &points);
    task.locked = [false, true, false, true, true, true];
    for objective in [Objective::Min, Objective::Balanced, Objective::LeastSquares] {
        task.objective = objective;
        let found = task.find().unwrap();
        assert_eq!(found.motion.translation_mm.y, 0.0);
        assert_eq!(found.motion.rotation, Pose::identity().rotation);
        if objective == Objective::Min {
            // y is as it was: 0.3 on one side.
            assert!((found.min_mm - 0.3).abs() < 1e-9);
        } else {
            assert!((found.motion.translation_mm.x + 0.4).abs() < 1e-9);
        }
    }
}

#[test]
fn what_is_wrong_is_named() {
    let model = block();
    let codes = |stock: [Option<f64>; 6], require: Option<f64>| -> Vec<&'static str> {
        let points = raw(stock, &moved());
        let mut task = task(&model, &points);
        task.require_mm = require;
        task.find()
            .unwrap()
            .reasons
            .iter()
            .map(|r| r.code)
            .collect()
    };
    assert_eq!(codes(UNEVEN, Some(0.41)), ["too_little_stock"]);
    assert_eq!(codes(UNEVEN, Some(0.39)), [""; 0]);
    let too_small = [
        Some(-0.3),
        Some(0.1),
        Some(0.5),
        Some(0.5),
        Some(0.5),
        Some(0.5),
    ];
    assert_eq!(codes(too_small, None), ["no_stock"]);
    let mut open = UNEVEN;
    open[5] = None;
    assert_eq!(codes(open, None), ["unmeasured"]);
}

#[test]
fn spikes_are_left_out_and_counted_and_a_dent_is_none() {
    let model = block();
    let mut points = raw(UNEVEN, &Pose::identity());
    points[410].x -= 3.0;
    points[900].y += 4.0;
    // Two points beside each other show a dent.
    points[2210].z -= 0.6;
    points[2211].z -= 0.6;
    let found = task(&model, &points).find().unwrap();
    assert_eq!(found.spikes, [410, 900]);
    assert!(found.min_mm < 0.4);
}

#[test]
fn faces_have_demands_of_their_own() {
    let model = block();
    let points = raw([Some(0.5); 6], &moved());
    let face = |name: &str, keep: &dyn Fn(f64) -> bool, rule: Rule| Demand {
        name: name.into(),
        mesh: Mesh::new(
            &model
                .triangles()
                .iter()
                .filter(|t| keep(t.normal.z))
                .map(|t| t.corners)
                .collect::<Vec<_>>(),
        )
        .unwrap(),
        rule,
    };
    // The top needs 0.8, of 1.0 between top and bottom; the bottom is as built, ±0.6.
    let demands = [
        face("top", &|z| z > 0.5, Rule::Stock(0.8)),
        face("bottom", &|z| z < -0.5, Rule::Profile(1.2)),
    ];
    let mut task = task(&model, &points);
    task.demands = &demands;
    let found = task.find().unwrap();
    assert!(found.reasons.is_empty(), "{:?}", found.reasons);
    // Moved down by m: the top has 0.5 + m − 0.8, the bottom 0.6 − |0.5 − m|, the sides 0.5.
    // The least is largest at m = 0.7, where top and bottom both have 0.4.
    assert!((found.margin_mm - 0.4).abs() < 1e-3, "{}", found.margin_mm);
    assert_eq!(found.faces[0].points.len(), 400);
}

/// Points of one face that a small motion would bring over an edge, to a face that demands more.
#[test]
fn no_small_motion_improves_a_place_at_the_border_of_two_demands() {
    let model = block();
    let face = |name: &str, top: bool, rule: Rule| Demand {
        name: name.into(),
        mesh: Mesh::new(
            &model
                .triangles()
                .iter()
                .filter(|t| (t.normal.z > 0.5) == top)
                .map(|t| t.corners)
                .collect::<Vec<_>>(),
        )
        .unwrap(),
        rule,
    };
    let demands = [
        face("top", true, Rule::Stock(0.3)),
        face("others", false, Rule::Profile(1.2)),
    ];
    let mut state = 3_u64;
    let mut random = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
    };
    // Sides up to the edge, and beyond it as high as what they have beside it.
    let mut points = raw(
        [
            Some(0.1),
            Some(0.15),
            Some(0.1),
            Some(0.05),
            Some(0.1),
            Some(0.7),
        ],
        &Pose::identity(),
    );
    for _ in 0..300 {
        let along = random() * 50.0;
        let over = random() * 0.3;
        points.push(Vec3::new(along, 20.0 + 0.1 + 0.1 * random(), 10.0 + over));
        points.push(Vec3::new(along, -20.0 - 0.1 + 0.1 * random(), 10.0 + over));
    }
    let points: Vec<Vec3> = points.iter().map(|p| moved().point(p)).collect();
    let mut task = task(&model, &points);
    task.demands = &demands;
    let found = task.find().unwrap();
    let rules = demand::rules(&model, &demands, None);
    let surface = CompositeSurface::from(model.clone());
    let kept: Vec<Vec3> = (0..points.len())
        .filter(|i| found.spikes.binary_search(i).is_err())
        .map(|i| points[i])
        .collect();
    for k in 0..400 {
        let size = [1.0, 0.1][k % 2];
        let step = Vector6::from_fn(|i, _| size * random() * if i < 3 { 4e-4 } else { 1e-2 });
        let other = crate::rigid::stepped(&found.motion, &step, &Vec3::zeros());
        let margin = measure(&surface, &kept, &other, &[], Threads::new(1))
            .iter()
            .map(|m| rules[m.face].margin(m.distance_mm))
            .fold(f64::INFINITY, f64::min);
        assert!(
            margin <= found.margin_mm + 5e-4,
            "{margin} {}",
            found.margin_mm
        );
    }
}

#[test]
fn five_points_are_too_few() {
    let model = block();
    let points = [Vec3::zeros(); 5];
    assert_eq!(
        task(&model, &points).find().unwrap_err().code,
        "too_few_points"
    );
}

/// What lies where nothing can be is refused, and no place is made of it.
#[test]
fn what_is_too_far_out_is_refused() {
    let model = block();
    let mut points = raw(UNEVEN, &Pose::identity());
    points.push(Vec3::x() * 1e200);
    let far = Vec3::y() * 1e160;
    let mut start = task(&model, &points);
    start.start.translation_mm = far;
    let mut pivot = task(&model, &points);
    pivot.pivot = far;
    let mut apart = task(&model, &points);
    apart.apart_is_raw = true;
    for wrong in [start, pivot, apart] {
        assert_eq!(wrong.find().unwrap_err().code, "not_finite");
    }
    // A point that is left out as another thing puts the part nowhere else.
    let found = task(&model, &points).find().unwrap();
    assert!((found.min_mm - 0.4).abs() < 1e-6, "{}", found.min_mm);
}

/// The sides of the block that `keep` takes, as an open model.
fn open(keep: impl Fn(&Vec3) -> bool) -> Mesh {
    let model = block();
    let kept = model.triangles().iter().filter(|t| keep(&t.normal));
    Mesh::new(&kept.map(|t| t.corners).collect::<Vec<_>>()).unwrap()
}

/// Only the top is to be machined and was scanned, beyond its border too: downwards every stock grows without end.
#[test]
fn a_part_that_no_scanned_face_holds_is_refused_and_one_that_sides_or_locks_hold_is_not() {
    let top = open(|normal| normal.z > 0.5);
    let mut only_top = [None; 6];
    only_top[5] = Some(1.0);
    let beyond = |p: &Vec3| p.component_mul(&Vec3::new(1.3, 1.3, 1.0));
    let inside = raw(only_top, &Pose::identity());
    let points: Vec<Vec3> = inside.iter().map(beyond).collect();
    for (points, objective) in [
        (&inside, Objective::Min),
        (&points, Objective::Min),
        (&points, Objective::Balanced),
    ] {
        let mut task = task(&top, points);
        task.objective = objective;
        let error = task.find().map(|f| f.min_mm).expect_err("moved away");
        assert_eq!(error.code, "unbounded");
        assert!(error.message.contains("-1.000 of the scan"), "{error}");
    }
    let mut locked = task(&top, &inside);
    locked.locked[2] = true;
    assert!((locked.find().unwrap().min_mm - 1.0).abs() < 1e-6);

    let five = open(|normal| normal.z > -0.5);
    let mut stock = UNEVEN;
    stock[4] = None;
    let found = task(&five, &raw(stock, &moved())).find().unwrap();
    assert_eq!(found.reasons, []);
    assert!((found.min_mm - 0.4).abs() < 1e-6, "{}", found.min_mm);
}

#[test]
fn a_face_that_is_not_on_the_model_is_a_bad_file_and_one_that_no_point_shows_is_named() {
    let model = block();
    let mut points = raw([Some(0.5); 6], &moved());
    let top = open(|normal| normal.z > 0.5);
    let by = |scale: f64, up: f64| {
        let corners = top.triangles().iter().map(|t| t.corners);
        let moved = corners.map(|c| c.map(|c| c * scale + Vec3::z() * up));
        Mesh::new(&moved.collect::<Vec<_>>()).unwrap()
    };
    let top_twice = |mesh| {
        [("top", top.clone()), ("second", mesh)].map(|(name, mesh)| Demand {
            name: name.into(),
            mesh,
            rule: Rule::Stock(0.1),
        })
    };
    // 5 mm above, in inches, and a face that another has already.
    for (mesh, words) in [
        (by(1.0, 5.0), "5.000 mm off"),
        (by(1.0 / 25.4, 0.0), "9.606 mm off"),
        (by(1.0, 0.0), "owns"),
    ] {
        let demands = top_twice(mesh);
        let mut task = task(&model, &points);
        task.demands = &demands;
        let found = task.find().map(|found| found.faces);
        let error = found.expect_err("a demand that no point is asked");
        assert_eq!(error.code, "bad_file");
        assert!(error.message.contains("`second`"), "{error}");
        assert!(error.message.contains(words), "{error}");
    }
    points.truncate(2000);
    let demands = &top_twice(by(1.0, 0.0))[..1];
    let mut task = task(&model, &points);
    task.demands = demands;
    let reasons = task.find().unwrap().reasons;
    let named = |r: &ScanError| r.code == "unmeasured" && r.message.contains("`top`");
    assert!(reasons.iter().any(named), "{reasons:?}");
}

/// A cone-shaped pit that two points show, with its tip; a single low point; and one that is low but has enough.
#[test]
fn a_pit_that_two_points_show_counts_and_a_single_low_point_is_named() {
    let model = block();
    let low = |lowered: &[(usize, f64)]| {
        let mut points = raw([Some(0.5); 6], &Pose::identity());
        for (point, by) in lowered {
            points[*point].z -= by;
        }
        task(&model, &points).find().unwrap()
    };
    let codes = |found: &StockFound| found.reasons.iter().map(|r| r.code).collect::<Vec<_>>();
    let pit = low(&[(2210, 2.0), (2211, 0.4)]);
    assert_eq!((codes(&pit), pit.spikes), (vec!["no_stock"], vec![]));
    assert!(pit.min_mm < -0.4, "{}", pit.min_mm);

    let single = low(&[(2210, 2.0)]);
    assert_eq!(
        (codes(&single), &single.spikes[..]),
        (vec!["spike_below"], &[2210][..])
    );
    let told = &single.reasons[0].message;
    assert!(told.contains("-1.500"), "{told}");

    let enough = low(&[(2210, 0.3)]);
    assert_eq!((codes(&enough), enough.spikes), (vec![], vec![2210]));
}

#[test]
fn a_closed_mesh_goes_around_what_is_inside_once() {
    let model = block();
    let of = |z| model.winding(&Vec3::new(3.0, 2.0, z));
    assert!((of(9.9) - 1.0).abs() < 1e-9 && of(10.1).abs() < 1e-9);
}

#[test]
fn no_objective_says_ok_where_material_is_missing() {
    let model = block();
    let mut stock = [Some(0.5); 6];
    // From top to bottom the raw part is too small.
    (stock[4], stock[5]) = (Some(-0.2), Some(0.1));
    let points = raw(stock, &moved());
    let top = [Demand {
        name: "top".into(),
        mesh: open(|normal| normal.z > 0.5),
        rule: Rule::Stock(0.8),
    }];
    let even = raw([Some(0.5); 6], &moved());
    for objective in [Objective::Balanced, Objective::LeastSquares, Objective::Min] {
        let mut bare = task(&model, &points);
        bare.objective = objective;
        assert_eq!(bare.find().unwrap().reasons[0].code, "no_stock");
    }
    let mut missed = task(&model, &even);
    (missed.objective, missed.demands) = (Objective::Balanced, &top);
    let reasons = missed.find().unwrap().reasons;
    assert_eq!(reasons[0].code, "too_little_stock");
    assert!(reasons[0].message.contains("`top`"), "{reasons:?}");
}

/// A point to some 135 mm² of a part of 75 mm: what lies between them nobody saw.
#[test]
fn a_scan_of_few_points_leaves_the_surface_unmeasured() {
    let model = block();
    let points: Vec<Vec3> = raw([Some(0.5); 6], &Pose::identity())
        .into_iter()
        .step_by(37)
        .collect();
    let found = task(&model, &points).find().unwrap();
    let codes: Vec<&str> = found.reasons.iter().map(|r| r.code).collect();
    assert_eq!(codes, ["unmeasured"]);
}

/// A wall of points across X, about as large as the end of the block.
fn wall(x: f64, place: &Pose) -> Vec<Vec3> {
    let at = |i: i32, j: i32| Vec3::new(x, 2.2 * f64::from(i), 1.2 * f64::from(j));
    let all = (-10..=10).flat_map(|i| (-10..=10).map(move |j| at(i, j)));
    all.map(|p| place.point(&p)).collect()
}

/// What stands behind an end that nobody scanned does not show that end, and moves nothing.
#[test]
fn a_wall_behind_a_bare_face_shows_nothing_of_it() {
    let model = block();
    let stock = [Some(0.6), None, Some(0.6), Some(0.6), Some(0.6), Some(0.6)];
    let own = raw(stock, &moved());
    let alone = task(&model, &own).find().unwrap();
    assert!(alone.reasons.iter().any(|r| r.code == "unmeasured"));
    for x in [50.0, 90.0, 600.0] {
        let points = [own.clone(), wall(x, &moved())].concat();
        let found = task(&model, &points).find().unwrap();
        let codes: Vec<&str> = found.reasons.iter().map(|r| r.code).collect();
        assert_eq!(codes, ["unmeasured"], "{x}");
        assert_eq!(found.clutter.len(), points.len() - own.len(), "{x}");
        assert_eq!(found.clutter[0], own.len());
        let apart = found.motion.apart_mm(&alone.motion, &model.corners());
        assert!(apart < 1e-9, "{x}: {apart} mm");
    }
}

/// A table about a block does not show the side that stands on it: its points lie beyond the edges.
#[test]
fn a_table_about_the_part_does_not_show_its_lower_side() {
    let model = block();
    let stock = [Some(0.6), Some(0.6), Some(0.6), Some(0.6), None, Some(0.6)];
    let mut points = raw(stock, &Pose::identity());
    let mut task_of = |table: bool| {
        if table {
            for i in -40..=40 {
                for j in -30..=30 {
                    let p = Vec3::new(f64::from(i), f64::from(j), -10.6);
                    if p.x.abs() > 31.0 || p.y.abs() > 21.0 {
                        points.push(p);
                    }
                }
            }
        }
        let mut task = task(&model, &points);
        task.locked = [false, false, true, true, true, false];
        let found = task.find().unwrap();
        found.reasons.iter().any(|r| r.code == "unmeasured")
    };
    assert!(task_of(false) && task_of(true));
}

/// Much stock on one face is no other thing: 15 mm of it, as a rough casting has, with the scan going on around its edges or
/// not.
#[test]
fn much_stock_on_one_face_is_stock() {
    let model = block();
    let mut points = raw([0.6; 6].map(Some), &moved());
    points.retain(|q| moved().undo(q).x < 30.3);
    // The raw end, and the sides on the way to it.
    points.extend(wall(45.0, &moved()));
    for i in 0..=22 {
        for j in -10..=10 {
            let x = 24.0 + f64::from(i);
            for side in [-1.0, 1.0] {
                let (y, z) = (20.6 * side, 10.6 * side);
                points.push(moved().point(&Vec3::new(x, y, f64::from(j))));
                points.push(moved().point(&Vec3::new(x, 2.0 * f64::from(j), z)));
            }
        }
    }
    let mut task = task(&model, &points);
    task.start = moved();
    task.locked = [true, false, false, true, true, true];
    let found = task.find().unwrap();
    assert_eq!(found.clutter.len(), 0);
    assert!(found.reasons.is_empty(), "{:?}", found.reasons);
    assert!(found.max_mm > 14.0, "{}", found.max_mm);
    // Ten times the stock of the others on faces that are scanned apart from each other may be a wall; and twice may not.
    let faces = |mm: [f64; 6]| raw(mm.map(Some), &moved());
    let points = faces([4.0, 4.0, 0.4, 0.4, 0.4, 0.4]);
    let found = self::task(&model, &points).find().unwrap();
    assert!(!found.clutter.is_empty());
    assert!(
        found.reasons.iter().any(|of| of.code == "unmeasured"),
        "{:?}",
        found.reasons
    );
    // Unless somebody says that it is the raw part's.
    let mut told = self::task(&model, &points);
    told.apart_is_raw = true;
    let found = told.find().unwrap();
    assert_eq!((found.clutter.len(), found.reasons.len()), (0, 0));
    let points = faces([4.0, 4.0, 2.0, 2.0, 2.0, 2.0]);
    let found = self::task(&model, &points).find().unwrap();
    assert_eq!((found.clutter.len(), found.reasons.len()), (0, 0));
}
