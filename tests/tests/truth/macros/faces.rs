//! Plane, web, pocket and corner.

use umi_protocol::feature::Shape;

use crate::macros::bench::*;

/// A plate tilted about X and Y, its top through (10, 20, 60).
fn tilted(x_deg: f64, y_deg: f64) -> String {
    format!(
        "[[group]]\nname = \"PART\"\ntranslation_mm = [10.0, 20.0, 60.0]\nrotation_deg = [{x_deg}, {y_deg}, 0.0]\n\
         [[body]]\nname = \"PLATE\"\ngroup = \"PART\"\nshape = {{ block = {{ size_mm = [160.0, 140.0, 20.0] }} }}\n"
    )
}

fn plane_call(depth: f64, field: [f64; 2], hits: [f64; 2]) -> Call {
    let [u, v] = field;
    let [i, j] = hits;
    let values = [
        ('B', 5.0),
        ('Q', depth),
        ('U', u),
        ('V', v),
        ('I', i),
        ('J', j),
    ];
    Call::new(8823, "UMI_PLANE", &values)
}

/// Tilted by up to 10 degrees: the normal of the tip's plane is that of the face, and its
/// offset that of the face and the tip's radius.
#[test]
fn plane_tilted() {
    for family in FAMILIES {
        for (x_deg, y_deg) in [(0.0, 0.0), (1.0, -0.5), (10.0, 0.0), (-6.0, 7.0)] {
            for (field, hits) in [([80.0, -60.0], [2.0, 2.0]), ([-80.0, 60.0], [5.0, 4.0])] {
                let count = (hits[0] * hits[1]) as usize;
                let from = [10.0 - field[0] / 2.0, 20.0 - field[1] / 2.0, 90.0];
                let ran = run(
                    family,
                    &tilted(x_deg, y_deg),
                    from,
                    &[plane_call(60.0, field, hits)],
                );
                let shapes = ran.shapes(&job(Tip::InRadius, &[(5, "plane", count, None)]));
                let [
                    Shape::Plane {
                        point_mm, normal, ..
                    },
                ] = shapes[..]
                else {
                    panic!("one plane, not {shapes:?}");
                };
                let wanted = ran.machine.scene().bodies()[0]
                    .placed()
                    .rotation
                    .column(2)
                    .into_owned();
                let normal = if normal[2] < 0.0 {
                    normal.map(|n| -n)
                } else {
                    normal
                };
                let what = format!("{family:?} {x_deg} {y_deg} {hits:?}");
                // 2 µm over 100 mm.
                assert!(
                    distance(normal, wanted.into()) <= 2e-5,
                    "{what}: {normal:?}\n{ran}"
                );
                let off: f64 = (0..3)
                    .map(|axis| (point_mm[axis] - [10.0, 20.0, 60.0][axis]) * wanted[axis])
                    .sum();
                assert!((off - TIP_MM).abs() <= TOLERANCE_MM, "{what}: {off}");
            }
        }
    }
}

/// A web of 30 by 90, its top at 50; also the walls of a pocket of 64 by 104 around it.
fn web(turned: bool) -> String {
    let size = if turned {
        [90.0, 30.0, 50.0]
    } else {
        [30.0, 90.0, 50.0]
    };
    format!(
        "[[body]]\nname = \"WEB\"\nshape = {{ block = {{ size_mm = {size:?} }} }}\nposition_mm = [15.5, -8.25, 50.0]\n\
         [[body]]\nname = \"TABLE\"\nshape = \"half_space\"\n"
    )
}

fn pocket() -> String {
    let wall = |name: &str, x: f64, y: f64, size: [f64; 3]| {
        format!(
            "[[body]]\nname = \"{name}\"\nshape = {{ block = {{ size_mm = {size:?} }} }}\nposition_mm = [{x}, {y}, 50.0]\n"
        )
    };
    // From -20 to 44 in X, from -60 to 44 in Y.
    [
        wall("LEFT", -30.0, -8.0, [20.0, 144.0, 40.0]),
        wall("RIGHT", 54.0, -8.0, [20.0, 144.0, 40.0]),
        wall("FRONT", 12.0, -70.0, [104.0, 20.0, 40.0]),
        wall("BACK", 12.0, 54.0, [104.0, 20.0, 40.0]),
    ]
    .concat()
}

/// The coordinate of a face along an axis: the line through its hits must lie in it.
fn assert_face(shape: &Shape, axis: usize, wanted_mm: f64, what: &str) {
    let Shape::Line {
        point_mm,
        direction,
        ..
    } = shape
    else {
        panic!("{what}: no line but {shape:?}");
    };
    let off = point_mm[axis] - wanted_mm;
    assert!(
        off.abs() <= TOLERANCE_MM,
        "{what}: {point_mm:?} is off by {off}"
    );
    assert!(direction[axis].abs() <= 1e-4, "{what}: {direction:?}");
}

fn two_lines(id: u16, hits: usize) -> String {
    job(
        Tip::OnBoard,
        &[(id, "line", hits, None), (id + 1, "line", hits, None)],
    )
}

/// Off the middle by up to a quarter of the width, both axes, two hits and five.
#[test]
fn web_from_bad_starts() {
    for family in FAMILIES {
        for (axis, turned) in [(0, false), (1, true)] {
            for beside in [-7.5, 0.0, 4.0, 7.5] {
                for hits in [2, 5] {
                    let mut from = [15.5, -8.25, 56.0];
                    from[axis] += beside;
                    from[1 - axis] -= 30.0;
                    let values = [
                        ('A', 1.0 + axis as f64),
                        ('D', 30.0),
                        ('B', 1.0),
                        ('H', 20.0),
                        ('U', 60.0),
                        ('K', f64::from(hits)),
                    ];
                    let call = Call::new(8826, "UMI_WEB", &values);
                    let ran = run(family, &web(turned), from, &[call]);
                    let what = format!("{family:?} axis {axis} beside {beside}");
                    let middle = [15.5, -8.25][axis];
                    let shapes = ran.shapes(&two_lines(1, hits as usize));
                    assert_face(&shapes[0], axis, middle + 15.0, &what);
                    assert_face(&shapes[1], axis, middle - 15.0, &what);
                }
            }
        }
    }
}

/// The same inside a pocket.
#[test]
fn pocket_from_bad_starts() {
    for family in FAMILIES {
        for (axis, width, low) in [(0, 64.0, -20.0), (1, 104.0, -60.0)] {
            for beside in [-0.25, 0.0, 0.25] {
                let mut from = [12.0, -8.0, 40.0];
                from[axis] += beside * width;
                from[1 - axis] -= 15.0;
                let values = [
                    ('A', 1.0 + axis as f64),
                    ('D', width),
                    ('B', 1.0),
                    ('U', 30.0),
                    ('K', 3.0),
                ];
                let call = Call::new(8827, "UMI_POCKET", &values);
                let ran = run(family, &pocket(), from, &[call]);
                let what = format!("{family:?} axis {axis} beside {beside}");
                let shapes = ran.shapes(&two_lines(1, 3));
                assert_face(&shapes[0], axis, low + width, &what);
                assert_face(&shapes[1], axis, low, &what);
            }
        }
    }
}

fn corner_call(x: f64, y: f64, side: f64) -> Call {
    let values = [
        ('X', x),
        ('Y', y),
        ('C', side),
        ('B', 1.0),
        ('U', 8.0),
        ('K', 2.0),
        ('Q', 10.0),
    ];
    Call::new(8828, "UMI_CORNER", &values)
}

/// All four corners of the web from outside and of the pocket from inside; the corner is
/// up to 4 mm off its place.
#[test]
fn corners() {
    for family in FAMILIES {
        for (right, back) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            for off in [-4.0, 0.0, 4.0] {
                let what = format!("{family:?} {right} {back} {off}");
                let (x, y) = (15.5 + right * 15.0, -8.25 + back * 45.0);
                let from = [x + right * 12.0, y + back * 12.0, 40.0];
                let ran = run(
                    family,
                    &web(false),
                    from,
                    &[corner_call(x + off, y - off, 1.0)],
                );
                let shapes = ran.shapes(&two_lines(1, 2));
                assert_face(&shapes[0], 0, x, &what);
                assert_face(&shapes[1], 1, y, &what);

                let (x, y) = (12.0 + right * 32.0, -8.0 + back * 52.0);
                let from = [x - right * 12.0, y - back * 12.0, 40.0];
                let ran = run(
                    family,
                    &pocket(),
                    from,
                    &[corner_call(x + off, y - off, 2.0)],
                );
                let shapes = ran.shapes(&two_lines(1, 2));
                assert_face(&shapes[0], 0, x, &what);
                assert_face(&shapes[1], 1, y, &what);
            }
        }
    }
}

/// Nothing there, something in the way, another width.
#[test]
fn refused_outside() {
    for family in FAMILIES {
        let plane = plane_call(20.0, [80.0, 60.0], [3.0, 3.0]);
        run(family, &tilted(0.0, 0.0), [-30.0, -10.0, 90.0], &[plane]).refused("NO TOUCH");
        // The field reaches beyond the plate.
        let plane = plane_call(60.0, [200.0, 60.0], [3.0, 3.0]);
        run(family, &tilted(0.0, 0.0), [-30.0, -10.0, 90.0], &[plane]).refused("NO TOUCH");
        // The face rises into the way between two rows.
        let plane = plane_call(60.0, [80.0, 60.0], [3.0, 3.0]);
        run(family, &tilted(30.0, 0.0), [-30.0, -10.0, 65.0], &[plane]).refused("PATH OBSTRUCTED");

        let web_call = |width: f64, depth: f64| {
            let values = [
                ('A', 1.0),
                ('D', width),
                ('B', 1.0),
                ('H', depth),
                ('U', 60.0),
                ('K', 2.0),
            ];
            Call::new(8826, "UMI_WEB", &values)
        };
        let above = [15.5, -38.25, 56.0];
        run(family, &web(false), above, &[web_call(27.0, 20.0)]).refused("NOT THIS SIZE");
        run(family, &web(false), above, &[web_call(34.0, 20.0)]).refused("NOT THIS SIZE");
        run(family, &web(false), above, &[web_call(30.0, 60.0)]).refused("PATH OBSTRUCTED");
        run(family, &web(false), above, &[web_call(30.0, 2.0)]).refused("NO TOUCH");

        let call = corner_call(60.0, 60.0, 1.0);
        run(family, &web(false), [80.0, 80.0, 40.0], &[call]).refused("NO TOUCH");
        let call = corner_call(30.5, 36.75, 1.0);
        run(family, &web(false), [33.0, 50.0, 40.0], &[call]).refused("TOO NEAR");

        let narrow = |width: f64| {
            let values = [
                ('A', 1.0),
                ('D', width),
                ('B', 1.0),
                ('U', 20.0),
                ('K', 3.0),
            ];
            let call = Call::new(8827, "UMI_POCKET", &values);
            run(family, &pocket(), [12.0, -18.0, 40.0], &[call])
        };
        narrow(62.0).refused("NOT THIS SIZE");
        narrow(66.0).refused("NOT THIS SIZE");
    }
}

/// Something else of the size that was asked for: a square hole is no bore, a square block
/// no boss, a round boss with a flat top no ball.
#[test]
fn other_shapes_are_refused() {
    let square = "[[body]]\nname = \"BLOCK\"\nshape = { block = { size_mm = [40.0, 40.0, 50.0] } }\nposition_mm = [15.5, -8.25, 50.0]\n";
    let flat = "[[body]]\nname = \"BOSS\"\nshape = { cylinder = { radius_mm = 12.7, height_mm = 50.0 } }\nposition_mm = [15.5, -8.25, 50.0]\n";
    for family in FAMILIES {
        let values = [('D', 64.0), ('B', 1.0), ('K', 4.0)];
        let bore = Call::new(8824, "UMI_BORE", &values);
        let oblong = pocket();
        let square_hole = oblong.replace("[12, -70, 50.0]", "[12, -30, 50.0]");
        assert_ne!(oblong, square_hole);
        for hole in [oblong, square_hole] {
            run(
                family,
                &hole,
                [22.0, 27.0, 40.0],
                std::slice::from_ref(&bore),
            )
            .refused_as(&["NO TOUCH", "NOT THIS SIZE"]);
        }
        let values = [('D', 40.0), ('B', 1.0), ('H', 20.0), ('K', 4.0)];
        let boss = Call::new(8825, "UMI_BOSS", &values);
        run(family, square, [23.5, 1.75, 60.0], &[boss]).refused("NOT THIS SIZE");
        let values = [('D', 25.4), ('B', 1.0), ('Q', 30.0)];
        let ball = Call::new(8820, "UMI_SPHERE", &values);
        run(family, flat, [17.5, -7.25, 60.0], &[ball]).refused("NOT THIS SIZE");
    }
}
