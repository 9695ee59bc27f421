//! Bore, boss and ring gauge.

use umi_protocol::feature::Shape;

use crate::macros::bench::*;

const CENTER_MM: [f64; 2] = [-42.125, 63.5];
const MEASURED_MM: f64 = 40.0;

/// A ring of this bore on a table, its top at 50.
fn ring(bore_mm: f64) -> String {
    format!(
        "[[body]]\nname = \"RING\"\n\
         shape = {{ ring = {{ radius_mm = {}, outer_radius_mm = {}, height_mm = 30.0 }} }}\n\
         position_mm = [{}, {}, 50.0]\n\
         [[body]]\nname = \"TABLE\"\nshape = \"half_space\"\n",
        bore_mm / 2.0,
        bore_mm / 2.0 + 15.0,
        CENTER_MM[0],
        CENTER_MM[1]
    )
}

/// A boss on a table, its top at 50.
fn boss(diameter_mm: f64) -> String {
    format!(
        "[[body]]\nname = \"BOSS\"\nshape = {{ cylinder = {{ radius_mm = {}, height_mm = 50.0 }} }}\n\
         position_mm = [{}, {}, 50.0]\n\
         [[body]]\nname = \"TABLE\"\nshape = \"half_space\"\n",
        diameter_mm / 2.0,
        CENTER_MM[0],
        CENTER_MM[1]
    )
}

fn bore_call(diameter: f64, hits: f64) -> Call {
    Call::new(
        8824,
        "UMI_BORE",
        &[('D', diameter), ('B', 3.0), ('K', hits)],
    )
}

fn boss_call(diameter: f64, depth: f64, hits: f64) -> Call {
    let values = [('D', diameter), ('B', 3.0), ('H', depth), ('K', hits)];
    Call::new(8825, "UMI_BOSS", &values)
}

fn start(beside_mm: [f64; 2], z: f64) -> [f64; 3] {
    [CENTER_MM[0] + beside_mm[0], CENTER_MM[1] + beside_mm[1], z]
}

/// The tip's circle, or with four hits the contacts'.
fn assert_round(ran: &Ran, hits: usize, radius_mm: f64, tip_mm: f64, what: &str) {
    let (tip, radius) = if hits == 4 {
        (Tip::OnBoard, radius_mm)
    } else {
        (Tip::InRadius, radius_mm + tip_mm)
    };
    let job = job(tip, &[(3, "circle", hits, Some(radius))]);
    let shapes = ran.shapes(&job);
    let [
        Shape::Circle {
            center_mm,
            radius_mm: fitted,
            ..
        },
    ] = shapes[..]
    else {
        panic!("{what}: one circle, not {shapes:?}");
    };
    let off = distance(center_mm, [CENTER_MM[0], CENTER_MM[1], MEASURED_MM]);
    assert!(
        off <= TOLERANCE_MM,
        "{what}: {center_mm:?}, off by {off}\n{ran}"
    );
    assert!(
        (fitted - radius).abs() <= TOLERANCE_MM,
        "{what}: radius {fitted}\n{ran}"
    );
}

/// Beside the axis by up to 0.6 of what the tip has room, in X, in Y, or in between.
#[test]
fn bore_from_bad_starts() {
    for family in FAMILIES {
        for diameter in [12.0, 30.0, 80.05] {
            let room = diameter / 2.0 - TIP_MM;
            for (x, y) in [
                (0.0, 0.0),
                (0.6, 0.0),
                (0.0, -0.6),
                (-0.42, 0.42),
                (0.3, -0.5),
            ] {
                for hits in [4, 7, 36] {
                    // The back-off has to fit between start and wall.
                    let what = format!("{family:?} D{diameter} from {x} {y}, {hits} hits");
                    let from = start([x * room, y * room], MEASURED_MM);
                    let ran = run(
                        family,
                        &ring(diameter),
                        from,
                        &[bore_call(diameter, f64::from(hits))],
                    );
                    assert_round(&ran, hits as usize, diameter / 2.0, -TIP_MM, &what);
                }
            }
        }
    }
}

/// The ring gauge in 36 directions.
#[test]
fn ring_gauge() {
    for family in FAMILIES {
        let values = [('D', 50.0), ('B', 3.0), ('K', 36.0)];
        let call = Call::new(8829, "UMI_RING", &values);
        let ran = run(
            family,
            &ring(50.0),
            start([8.0, -6.0], MEASURED_MM),
            &[call],
        );
        assert_round(&ran, 36, 25.0, -TIP_MM, &format!("{family:?}"));
    }
}

/// Beside the axis by 0.6 of the radius in X and in Y.
#[test]
fn boss_from_bad_starts() {
    for family in FAMILIES {
        for diameter in [10.0, 40.0, 70.0] {
            for (x, y) in [
                (0.0, 0.0),
                (0.6, 0.6),
                (-0.6, 0.6),
                (0.0, -0.6),
                (0.35, 0.1),
            ] {
                for (hits, above) in [(4, 3.0), (5, 20.0), (16, 8.0)] {
                    let what = format!("{family:?} D{diameter} from {x} {y}, {hits} hits");
                    let radius = diameter / 2.0;
                    let z = 50.0 + TIP_MM + above;
                    let from = start([x * radius, y * radius], z);
                    let call = boss_call(diameter, z - MEASURED_MM, f64::from(hits));
                    let ran = run(family, &boss(diameter), from, &[call]);
                    assert_round(&ran, hits as usize, radius, TIP_MM, &what);
                }
            }
        }
    }
}

/// Another size, no wall, no boss, too deep, too near: an alarm of the macro's own.
#[test]
fn refused_outside() {
    for family in FAMILIES {
        let inside = start([1.0, 2.0], MEASURED_MM);
        let bore = |diameter: f64| run(family, &ring(30.0), inside, &[bore_call(diameter, 4.0)]);
        bore(28.0).refused("NOT THIS SIZE");
        bore(32.0).refused("NOT THIS SIZE");
        bore(14.0).refused("NO TOUCH");
        // Above the ring.
        let above = start([1.0, 2.0], 60.0);
        run(family, &ring(30.0), above, &[bore_call(30.0, 4.0)]).refused("NO TOUCH");
        // Nearly at the wall.
        let near = start([12.2, 0.0], MEASURED_MM);
        run(family, &ring(30.0), near, &[bore_call(30.0, 4.0)]).refused("TOO NEAR");

        let z = 60.0;
        let on = |diameter: f64, depth: f64, beside: [f64; 2]| {
            run(
                family,
                &boss(40.0),
                start(beside, z),
                &[boss_call(diameter, depth, 4.0)],
            )
        };
        on(37.0, 20.0, [1.0, 2.0]).refused("NOT THIS SIZE");
        on(43.0, 20.0, [1.0, 2.0]).refused("NOT THIS SIZE");
        // Down beside it: onto the table; past it: onto nothing; on top of it.
        on(40.0, 58.0, [1.0, 2.0]).refused("PATH OBSTRUCTED");
        on(40.0, 2.0, [1.0, 2.0]).refused("NO TOUCH");
        on(40.0, 20.0, [30.0, 0.0]).refused("NO TOUCH");
        on(40.0, 20.0, [70.0, 0.0]).refused("NO TOUCH");
        on(40.0, 20.0, [-40.0, 0.0]).refused("PATH OBSTRUCTED");
    }
}
