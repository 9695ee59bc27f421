//! The sphere, with five hits and with many.

use umi_protocol::feature::Shape;

use crate::macros::bench::*;

const RADIUS_MM: f64 = 12.7;
const CENTER_MM: [f64; 3] = [31.25, -17.5, 80.0];

/// A ball on a post on a table.
const SCENE: &str = r#"
[[body]]
name = "BALL"
shape = { sphere = { radius_mm = 12.7 } }
position_mm = [31.25, -17.5, 80.0]
[[body]]
name = "POST"
shape = { cylinder = { radius_mm = 4.0, height_mm = 60.0 } }
position_mm = [31.25, -17.5, 70.0]
[[body]]
name = "TABLE"
shape = "half_space"
"#;

fn five(depth: f64) -> Call {
    Call::new(
        8820,
        "UMI_SPHERE",
        &[('D', 2.0 * RADIUS_MM), ('B', 7.0), ('Q', depth)],
    )
}

fn many(rings: f64, hits: f64) -> Call {
    let values = [
        ('D', 2.0 * RADIUS_MM),
        ('B', 7.0),
        ('Q', 60.0),
        ('I', rings),
        ('K', hits),
    ];
    Call::new(8821, "UMI_SPHERE_N", &values)
}

/// Start positions: beside the centre in radii, above the top in mm.
fn start(beside: [f64; 2], above: f64) -> [f64; 3] {
    let [x, y, z] = CENTER_MM;
    [
        x + beside[0] * RADIUS_MM,
        y + beside[1] * RADIUS_MM,
        z + RADIUS_MM + TIP_MM + above,
    ]
}

fn assert_ball(ran: &Ran, job: &str, radius_mm: f64, what: &str) {
    let shapes = ran.shapes(job);
    let [
        Shape::Sphere {
            center_mm,
            radius_mm: fitted,
            ..
        },
    ] = shapes[..]
    else {
        panic!("{what}: one sphere, not {shapes:?}");
    };
    let off = distance(center_mm, CENTER_MM);
    assert!(
        off <= TOLERANCE_MM,
        "{what}: {center_mm:?}, off by {off}\n{ran}"
    );
    assert!(
        (fitted - radius_mm).abs() <= TOLERANCE_MM,
        "{what}: radius {fitted}\n{ran}"
    );
}

/// Beside the centre by 0.6 of the radius in X and in Y, 2 to 40 mm above: the ball.
#[test]
fn five_hits_from_bad_starts() {
    let job = job(Tip::OnBoard, &[(7, "sphere", 5, Some(RADIUS_MM))]);
    for family in FAMILIES {
        for x in [-0.6, -0.3, 0.0, 0.6] {
            for y in [-0.6, 0.0, 0.45, 0.6] {
                for above in [2.0, 11.3, 40.0] {
                    let what = format!("{family:?} from {x} {y} {above}");
                    let ran = run(family, SCENE, start([x, y], above), &[five(60.0)]);
                    assert_ball(&ran, &job, RADIUS_MM, &what);
                }
            }
        }
    }
}

/// With the top touched once more, by the job that holds the two against each other: the
/// ball, and the last hit where the first one was.
#[test]
fn six_hits_from_bad_starts() {
    let job = job(Tip::OnBoard, &[(7, "sphere", 6, Some(RADIUS_MM))])
        + "approach = [\"-z\", \"-x\", \"+x\", \"-y\", \"+y\", \"-z\"]\n[again]\nwithin_mm = 0.002\n";
    let call = |tops: f64| {
        let mut call = five(60.0);
        call.macro_b += &format!(" H{tops:.1}");
        call.linuxcnc += &format!(" [{tops:.1}]");
        call
    };
    for family in FAMILIES {
        for (x, y, above) in [(0.0, 0.0, 11.3), (-0.6, 0.6, 2.0), (0.6, 0.45, 40.0)] {
            let what = format!("{family:?} from {x} {y} {above}");
            let ran = run(family, SCENE, start([x, y], above), &[call(2.0)]);
            assert_ball(&ran, &job, RADIUS_MM, &what);
        }
        for tops in [0.5, 3.0, -1.0] {
            let ran = run(family, SCENE, start([0.0, 0.0], 20.0), &[call(tops)]);
            ran.refused_as(&["H ", "TOPS"]);
            assert!(ran.machine.hits().is_empty());
        }
    }
}

/// Pole and rings: hits along the normals, the tip's radius in that of the sphere.
#[test]
fn many_hits_from_bad_starts() {
    let radius_mm = RADIUS_MM + TIP_MM;
    for family in FAMILIES {
        for (rings, hits) in [(1.0, 4.0), (2.0, 8.0), (3.0, 12.0), (6.0, 10.0)] {
            let count = 1 + (rings * hits) as usize;
            let job = job(Tip::InRadius, &[(7, "sphere", count, Some(radius_mm))]);
            for (x, y) in [(0.0, 0.0), (-0.6, 0.6), (0.6, 0.3)] {
                let what = format!("{family:?}, {rings} rings of {hits} from {x} {y}");
                let ran = run(family, SCENE, start([x, y], 15.0), &[many(rings, hits)]);
                assert_ball(&ran, &job, radius_mm, &what);
            }
        }
    }
}

/// The alarms that a ball which is not the one wanted can give.
const NOT_THE_BALL: [&str; 4] = ["NOT THIS SIZE", "OBSTRUCTED", "NO TOUCH", "TOO FAR OFF"];

/// Outside the grid: an alarm of the macro's own.
#[test]
fn refused_outside() {
    for family in FAMILIES {
        // Nothing there as deep as it may seek.
        run(family, SCENE, start([5.0, 0.0], 20.0), &[five(30.0)]).refused("NO TOUCH");
        run(family, SCENE, start([0.0, 0.0], 35.0), &[five(30.0)]).refused("NO TOUCH");
        // The table instead of the ball: it cannot go down beside it.
        run(family, SCENE, start([5.0, 0.0], 20.0), &[five(150.0)]).refused("PATH OBSTRUCTED");
        // On the very flank of the ball: the ball, or an alarm.
        let job = job(Tip::OnBoard, &[(7, "sphere", 5, Some(RADIUS_MM))]);
        let mut refused = 0;
        for beside in [0.7, 0.9, 1.0, 1.05, 1.1, 1.15, 1.19] {
            for (x, y) in [(1.0, 0.0), (0.0, -1.0), (-0.6, 0.8)] {
                let from = start([beside * x, beside * y], 20.0);
                let ran = run(family, SCENE, from, &[five(60.0)]);
                if ran.alarm.is_some() {
                    ran.refused_as(&NOT_THE_BALL);
                    refused += 1;
                } else {
                    assert_ball(&ran, &job, RADIUS_MM, &format!("{family:?} from {beside}"));
                }
            }
        }
        assert!(refused > 0, "{family:?}");
        // Another ball than asked for.
        for diameter in [20.0, 24.0, 27.0, 40.0] {
            let values = [('D', diameter), ('B', 7.0), ('Q', 60.0)];
            let call = Call::new(8820, "UMI_SPHERE", &values);
            let ran = run(family, SCENE, start([0.2, 0.1], 20.0), &[call]);
            ran.refused_as(&NOT_THE_BALL);
        }
    }
}

/// Arguments that are missing or absurd: the alarm names the letter, nothing moves.
#[test]
fn arguments_are_checked() {
    let good = [('D', 25.4), ('B', 7.0), ('Q', 60.0), ('I', 2.0), ('K', 8.0)];
    for family in [Family::Fanuc, Family::Haas, Family::MitsubishiMazak] {
        for (program, letters) in [(8820, 3), (8821, 5)] {
            for (place, (letter, _)) in good.iter().enumerate().take(letters) {
                let mut left_out = good[..letters].to_vec();
                left_out.remove(place);
                let mut absurd = good[..letters].to_vec();
                absurd[place].1 = -3.0;
                for values in [left_out, absurd] {
                    let call = Call::new(program, "UMI_SPHERE", &values);
                    let ran = run(family, SCENE, start([0.0, 0.0], 20.0), &[call]);
                    ran.refused(&format!("{letter} "));
                    assert!(ran.machine.hits().is_empty());
                }
            }
        }
    }
    for (place, word) in ["DIAMETER", "FEATURE", "DEPTH", "RINGS", "HITS"]
        .iter()
        .enumerate()
    {
        let mut absurd = good;
        absurd[place].1 = -3.0;
        let call = Call::new(0, "UMI_SPHERE_N", &absurd);
        let ran = run(Family::LinuxCnc, SCENE, start([0.0, 0.0], 20.0), &[call]);
        ran.refused(word);
    }
}

/// A machine as it is: lag, a control that is up to 4 ms late, a probe with pretravel,
/// lobes and scatter. The macros still find the ball, at one feed, and the centre is right
/// but for what no compensation by axis takes out.
#[test]
fn real_machine() {
    let errors = "[machine]\nposition_gain_per_s = 30.0\nposition_noise_um = 1.0\n\
                  [control]\nskip_delay_ms = [0.0, 4.0]\n\
                  [probe]\npretravel_mm = 0.062\nlobing_mm = 0.005\naxial_pretravel_mm = 0.002\n\
                  repeatability_um = 1.0\n";
    let job = job(Tip::OnBoard, &[(7, "sphere", 5, Some(RADIUS_MM))])
        // Pretravel, and half of what 4 ms are at 50 mm/min.
        .replace("[0.0, 0.0, 0.0]", "[0.0637, 0.0637, 0.0037]")
        .replace("radius_error_mm = 0.003", "radius_error_mm = 0.010")
        .replace("rms_mm = 0.003", "rms_mm = 0.010");
    for family in FAMILIES {
        for (x, y, above) in [(0.0, 0.0, 20.0), (0.6, -0.6, 2.0), (-0.6, 0.3, 40.0)] {
            let scene = format!("{errors}{SCENE}");
            let ran = run(family, &scene, start([x, y], above), &[five(60.0)]);
            let shapes = ran.shapes(&job);
            let [Shape::Sphere { center_mm, .. }] = shapes[..] else {
                panic!("{shapes:?}");
            };
            // The lobes: 5 µm; the delay: 1.7 µm either way; the tip's height.
            let off = distance(center_mm, CENTER_MM);
            assert!(off < 0.012, "{family:?}: off by {off}\n{ran}");
        }
    }
}
