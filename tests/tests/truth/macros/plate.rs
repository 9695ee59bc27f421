//! The plate of three spheres, misplaced.

use umi_core::brain::{Brain, Output};
use umi_core::units::Micros;
use umi_protocol::feature::Shape;
use umi_protocol::job::Job;

use crate::macros::bench::*;

const RADIUS_MM: f64 = 12.7;
/// Above where sphere 1 should be.
const START_MM: [f64; 3] = [-100.0, -80.0, 125.0];
/// Spheres 2 and 3 from sphere 1.
const SECOND_MM: [f64; 3] = [180.0, 20.0, 0.0];
const THIRD_MM: [f64; 3] = [60.0, 150.0, 5.0];

/// A plate with its spheres on posts, moved and turned about `pivot_mm`.
fn scene(shift_mm: [f64; 3], turn_deg: [f64; 3], pivot_mm: [f64; 3]) -> String {
    let mut text = format!(
        "[[group]]\nname = \"PLATE\"\ntranslation_mm = {shift_mm:?}\n\
         rotation_deg = {turn_deg:?}\npivot_mm = {pivot_mm:?}\n\
         [[body]]\nname = \"PLATE\"\ngroup = \"PLATE\"\nshape = {{ block = {{ size_mm = [300.0, 300.0, 20.0] }} }}\n\
         position_mm = [-20.0, -20.0, 50.0]\n"
    );
    for (number, [x, y, z]) in [(1, [0.0; 3]), (2, SECOND_MM), (3, THIRD_MM)] {
        let (x, y, z) = (START_MM[0] + x, START_MM[1] + y, 95.0 + z);
        text.push_str(&format!(
            "[[body]]\nname = \"BALL{number}\"\ngroup = \"PLATE\"\n\
             shape = {{ sphere = {{ radius_mm = {RADIUS_MM} }} }}\nposition_mm = [{x}, {y}, {z}]\n\
             [[body]]\nname = \"POST{number}\"\ngroup = \"PLATE\"\n\
             shape = {{ cylinder = {{ radius_mm = 5.0, height_mm = 40.0 }} }}\nposition_mm = [{x}, {y}, {}]\n",
            z - 5.0
        ));
    }
    text
}

fn call(seek_deg: f64) -> Call {
    let [x, y, z] = SECOND_MM;
    let [u, v, w] = THIRD_MM;
    Call::new(
        8822,
        "UMI_PLATE",
        // 25 mm reach 8 mm below the top of a ball that stands where it should.
        &[
            ('D', 2.0 * RADIUS_MM),
            ('B', 1.0),
            ('Q', 22.0),
            ('X', x),
            ('Y', y),
            ('Z', z),
            ('U', u),
            ('V', v),
            ('W', w),
            ('A', seek_deg),
        ],
    )
}

fn assert_found(family: Family, scene: &str) {
    let radius = Some(RADIUS_MM);
    let features: Vec<_> = (1..=3).map(|id| (id, "sphere", 5, radius)).collect();
    let job = job(Tip::OnBoard, &features);
    let ran = run(family, scene, START_MM, &[call(10.0)]);
    for (number, shape) in (1..).zip(ran.shapes(&job)) {
        let name = format!("BALL{number}");
        let bodies = ran.machine.scene().bodies();
        let body = bodies.iter().find(|body| body.name == name).unwrap();
        let wanted: [f64; 3] = body.placed().translation_mm.into();
        let Shape::Sphere {
            center_mm,
            radius_mm,
            ..
        } = shape
        else {
            panic!("{name}: no sphere but {shape:?}");
        };
        let off = distance(center_mm, wanted);
        assert!(
            off <= TOLERANCE_MM,
            "{family:?} {name}: off by {off}\n{scene}\n{ran}"
        );
        assert!((radius_mm - RADIUS_MM).abs() <= TOLERANCE_MM, "{radius_mm}");
    }
}

/// Turned by up to 10 degrees about sphere 1, shifted by up to 8 mm in X and in Y and
/// by up to 4 mm in height.
#[test]
fn turned_and_shifted() {
    let pivot = [START_MM[0], START_MM[1], 50.0];
    for (place, turn) in [-10.0, -7.3, -3.0, 0.0, 0.7, 5.0, 10.0]
        .into_iter()
        .enumerate()
    {
        for x in [-8.0, 0.0, 8.0] {
            for y in [-8.0, 3.0, 8.0] {
                let z = [0.0, 4.0, -3.0][place % 3];
                assert_found(Family::Fanuc, &scene([x, y, z], [0.0, 0.0, turn], pivot));
            }
        }
    }
    for family in FAMILIES {
        for (turn, x, y) in [(-10.0, 8.0, -8.0), (10.0, -8.0, -8.0), (2.0, 3.0, 8.0)] {
            assert_found(family, &scene([x, y, 0.0], [0.0, 0.0, turn], pivot));
        }
    }
}

/// Turned about the plate's middle, so that sphere 1 leaves its place, and tilted.
#[test]
fn turned_about_the_middle_and_tilted() {
    let pivot = [-20.0, -20.0, 50.0];
    for family in FAMILIES {
        for turn in [-10.0, 6.0, 10.0] {
            for tilt in [[0.0, 0.0], [0.5, -0.3], [-0.4, 0.5]] {
                let turns = [tilt[0], tilt[1], turn];
                assert_found(family, &scene([0.0; 3], turns, pivot));
            }
        }
    }
}

/// Four balls, each top twice, and one, two or three of them again at the end: they have not
/// moved, so they are found where they were.
#[test]
fn four_balls_and_some_again() {
    let fourth = [190.0, 160.0, -8.0];
    let pivot = [-20.0, -20.0, 50.0];
    for family in FAMILIES {
        for (turn, again) in [(-10.0, 0), (7.0, 1), (-9.0, 2), (10.0, 3), (-10.0, 3)] {
            let mut text = scene([3.0, -2.0, 0.0], [0.0, 0.0, turn], pivot);
            let [x, y, z] =
                [0, 1, 2].map(|axis| [START_MM[0], START_MM[1], 95.0][axis] + fourth[axis]);
            text += &format!(
                "[[body]]\nname = \"BALL4\"\ngroup = \"PLATE\"\n\
                 shape = {{ sphere = {{ radius_mm = {RADIUS_MM} }} }}\nposition_mm = [{x}, {y}, {z}]\n"
            );
            let mut call = call(10.0);
            let [r, s, t] = fourth;
            call.macro_b += &format!(" R{r:.4} S{s:.4} T{t:.4} C9. H2.");
            call.linuxcnc += &format!(" [{r:.4}] [{s:.4}] [{t:.4}] [9] [2]");
            // Left out it is one.
            if again > 0 {
                call.macro_b += &format!(" K{again}.");
                call.linuxcnc += &format!(" [{again}]");
            }
            let again = again.max(1);
            let ran = run(family, &text, START_MM, &[call]);
            let radius = Some(RADIUS_MM);
            let numbers = [1, 2, 3, 4, 9, 10, 11].into_iter().take(4 + again);
            let features: Vec<_> = numbers.map(|id| (id, "sphere", 6, radius)).collect();
            let twice = "hits = 6\napproach = [\"-z\", \"-x\", \"+x\", \"-y\", \"+y\", \"-z\"]\n";
            let job = job(Tip::OnBoard, &features).replace("hits = 6\n", twice)
                + "[again]\nwithin_mm = 0.002\n";
            let centers: Vec<[f64; 3]> = ran
                .shapes(&job)
                .iter()
                .filter_map(Shape::position_mm)
                .collect();
            for (name, center) in [
                "BALL1", "BALL2", "BALL3", "BALL4", "BALL1", "BALL4", "BALL2",
            ]
            .iter()
            .zip(&centers)
            {
                let bodies = ran.machine.scene().bodies();
                let body = bodies.iter().find(|body| body.name == *name).unwrap();
                let off = distance(*center, body.placed().translation_mm.into());
                assert!(
                    off <= TOLERANCE_MM,
                    "{family:?} {name}: off by {off}\n{ran}"
                );
            }
            assert_eq!(centers.len(), 4 + again);
        }
    }
}

/// K is 1 to 3, and nothing without C.
#[test]
fn how_many_are_probed_again() {
    let flat = scene([0.0; 3], [0.0; 3], [0.0; 3]);
    for (again, says) in [
        (("C9. K4.", "[0] [0] [0] [9] [1] [4]"), "NOT 1"),
        (("C9. K1.5", "[0] [0] [0] [9] [1] [1.5]"), "NOT 1"),
        (("C9. K-1.", "[0] [0] [0] [9] [1] [-1]"), "NOT 1"),
        (("K2.", "[0] [0] [0] [0] [1] [2]"), "WITHOUT C"),
        (("C998. K3.", "[0] [0] [0] [998] [1] [3]"), "C NOT 0"),
    ] {
        for family in FAMILIES {
            let mut call = call(10.0);
            call.macro_b += &format!(" {}", again.0);
            call.linuxcnc += &format!(" {}", again.1);
            run(family, &flat, START_MM, &[call]).refused(says);
        }
    }
    // Of three balls the last one is the third.
    for family in FAMILIES {
        let mut call = call(10.0);
        call.macro_b += " C9. K3.";
        call.linuxcnc += " [0] [0] [0] [9] [1] [3]";
        let ran = run(family, &flat, START_MM, &[call]);
        let features = [1, 2, 3, 9, 10, 11].map(|id| (id, "sphere", 5, Some(RADIUS_MM)));
        let shapes = ran.shapes(&job(Tip::OnBoard, &features));
        let centers: Vec<[f64; 3]> = shapes.iter().filter_map(Shape::position_mm).collect();
        assert_eq!(centers.len(), 6, "{family:?}");
        for (again, first) in [(3, 0), (4, 2), (5, 1)] {
            let off = distance(centers[again], centers[first]);
            assert!(off <= TOLERANCE_MM, "{family:?} {again}: {off}");
        }
    }
}

/// Outside: turned too far, gone, or another plate. No alarm is a collision.
#[test]
fn refused_outside() {
    let pivot = [START_MM[0], START_MM[1], 50.0];
    for family in FAMILIES {
        for turn in [-45.0, -25.0, 25.0, 90.0, 180.0] {
            let ran = run(
                family,
                &scene([0.0; 3], [0.0, 0.0, turn], pivot),
                START_MM,
                &[call(10.0)],
            );
            ran.refused("NO SPHERE 2 FOUND");
        }
        // Turned by 10 degrees where 4 are allowed.
        let ran = run(
            family,
            &scene([0.0; 3], [0.0, 0.0, 10.0], pivot),
            START_MM,
            &[call(4.0)],
        );
        ran.refused_as(&["NO SPHERE 2", "NOT THIS PLATE"]);
        // Found while looking for 4 degrees, but turned by more.
        let ran = run(
            family,
            &scene([0.0; 3], [0.0, 0.0, 6.0], pivot),
            START_MM,
            &[call(4.0)],
        );
        ran.refused("NOT THIS PLATE");
        // 60 mm away from where it should be.
        let ran = run(
            family,
            &scene([60.0, 0.0, 0.0], [0.0; 3], pivot),
            START_MM,
            &[call(10.0)],
        );
        ran.refused("NO SPHERE 1 FOUND");
        // Sphere 3 of another plate: not there.
        let other = scene([0.0; 3], [0.0; 3], pivot).replace("[-40, 70,", "[-40, 20,");
        let ran = run(family, &other, START_MM, &[call(10.0)]);
        ran.refused("NO TOUCH");
        // Sphere 2 is 4 mm farther away.
        let other = scene([0.0; 3], [0.0; 3], pivot).replace("[80, -60,", "[84, -60,");
        let ran = run(family, &other, START_MM, &[call(10.0)]);
        ran.refused("NOT THIS PLATE");
    }
}

/// The example job: the first plate is taught, the misplaced one after it is corrected by
/// what the scene says, on every family's control.
#[test]
fn example_job_corrects() {
    let job: Job = toml::from_str(include_str!("../../../../examples/probed-plate.toml")).unwrap();
    let pivot = [START_MM[0], START_MM[1], 50.0];
    let places = [([0.0; 3], 0.0), ([8.0, -5.0, 0.5], -9.5)];
    for family in FAMILIES {
        let mut brain = Brain::new(job.clone()).unwrap();
        let mut verdicts = Vec::new();
        for (number, (shift, turn)) in (1u64..).zip(places) {
            let scene = scene(shift, [0.0, 0.0, turn], pivot);
            // Switched on anew; the second program is the control's second run.
            let again = Call {
                macro_b: "G65 P8811".into(),
                linuxcnc: "O<UMI_START> CALL".into(),
            };
            let mut calls = vec![again; number as usize - 1];
            calls.push(call(10.0));
            let ran = run(family, &scene, START_MM, &calls);
            assert_eq!(ran.alarm, None, "{family:?}");
            brain.bytes(Micros(number), ran.bytes(), &mut |output| {
                if let Output::Verdict(verdict) = output {
                    verdicts.push(verdict.clone());
                }
            });
        }
        let [taught, corrected] = &verdicts[..] else {
            panic!("{family:?}: two verdicts, not {verdicts:?}");
        };
        assert!(taught.ok && taught.correction.is_none(), "{taught:?}");
        assert!(
            corrected.ok && corrected.correction.is_some(),
            "{corrected:?}"
        );
        let registration = corrected.registration.as_ref().unwrap();
        let turn_deg = registration.angle_deg * registration.axis[2];
        assert!((turn_deg + 9.5).abs() < 0.001, "{registration:?}");
    }
}

/// Job, program and scene of the ring gauge fit: the program runs through, and the ring is
/// found to be larger by the scene's pretravel of 0.062 mm, plus half of what a control
/// that answers within 4 ms adds at 50 mm/min (1.7 µm).
#[test]
fn example_job_of_the_ring_gauge() {
    let scene = include_str!("../../../../examples/scenes/ring-gauge.toml");
    let program = include_str!("../../../../examples/probe-ring.nc");
    let (_, body) = program.split_once("O0200").unwrap();
    let (body, _) = body.split_once("M30").unwrap();
    let (_, body) = body.split_once('\n').unwrap();
    let ran = run_text(Family::Fanuc, scene, body);
    let shapes = ran.shapes(include_str!("../../../../examples/ring-gauge.toml"));
    let [Shape::Circle { radius_mm, .. }] = shapes[..] else {
        panic!("{shapes:?}");
    };
    let pretravel_mm = radius_mm - (71.1327 / 2.0 - 2.5);
    assert!((pretravel_mm - 0.0637).abs() < 0.001, "{pretravel_mm}");
}
