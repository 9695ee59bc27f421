//! Starts and poses far outside what the macros promise: the truth, or an alarm of the
//! macro's own. Never a collision, a broken stylus, an error in the program, or a wrong
//! answer that the job would take.

use umi_core::brain::{Brain, Output};
use umi_core::units::Micros;
use umi_protocol::feature::{FeatureResult, Shape};
use umi_protocol::job::Job;

use crate::macros::bench::*;

/// What the scene has: one of these at Z 20 to 80 over a table.
const BALL: &str = "shape = { sphere = { radius_mm = 12.7 } }\nposition_mm = [10.0, 20.0, 60.0]";
const BOSS: &str = "shape = { cylinder = { radius_mm = 20.0, height_mm = 60.0 } }\nposition_mm = [10.0, 20.0, 60.0]";
const RING: &str = "shape = { ring = { radius_mm = 20.0, outer_radius_mm = 32.0, height_mm = 60.0 } }\nposition_mm = [10.0, 20.0, 60.0]";
const WEB: &str =
    "shape = { block = { size_mm = [40.0, 100.0, 60.0] } }\nposition_mm = [10.0, 20.0, 60.0]";

fn scene(body: &str) -> String {
    format!(
        "[[body]]\nname = \"BODY\"\n{body}\n[[body]]\nname = \"TABLE\"\nshape = \"half_space\"\n"
    )
}

/// The features that are in order; faults and refusals are allowed here.
fn accepted(ran: &Ran, job: &str) -> Vec<FeatureResult> {
    let job: Job = toml::from_str(job).unwrap();
    let mut brain = Brain::new(job).unwrap();
    let mut features = Vec::new();
    brain.bytes(Micros(1), ran.bytes(), &mut |output| {
        if let Output::Feature(feature) = output
            && feature.is_ok()
        {
            features.push(feature.clone());
        }
    });
    features
}

/// Runs a macro from many starts; `is_true` judges every feature that the job accepts.
/// Returns how many runs ended well.
fn from_anywhere(
    family: Family,
    body: &str,
    call: &Call,
    job: &str,
    starts: impl Fn(u32) -> [f64; 3],
    is_true: impl Fn(&Shape, &str) -> bool,
) -> u32 {
    let mut well = 0;
    for number in 1..=60 {
        let start = starts(number);
        let ran = run(family, &scene(body), start, std::slice::from_ref(call));
        let what = format!("{family:?} {call:?} from {start:?}");
        match &ran.alarm {
            // The start itself lies in a body: the G0 of the part program ran into it.
            Some(alarm) if alarm.block.starts_with("G0 ") => continue,
            Some(alarm) => assert!(is_own_alarm(alarm), "{what}: {alarm}\n{ran}"),
            None => well += 1,
        }
        for feature in accepted(&ran, job) {
            let shape = feature.fit.as_ref().unwrap().shape;
            assert!(is_true(&shape, &feature.name), "{what}: {feature:?}\n{ran}");
        }
    }
    well
}

fn around(number: u32, beside: f64, low: f64, high: f64) -> [f64; 3] {
    let at = spread(number, 3);
    let z = low + (high - low) * (at[2] + 1.0) / 2.0;
    [10.0 + beside * at[0], 20.0 + beside * at[1], z]
}

#[test]
fn sphere() {
    let values = [('D', 25.4), ('B', 1.0), ('Q', 50.0)];
    let call = Call::new(8820, "UMI_SPHERE", &values);
    let job = job(Tip::OnBoard, &[(1, "sphere", 5, Some(12.7))]);
    for family in FAMILIES {
        let well = from_anywhere(
            family,
            BALL,
            &call,
            &job,
            |number| around(number, 25.0, 50.0, 120.0),
            |shape, _| matches!(shape, Shape::Sphere { center_mm, .. } if distance(*center_mm, [10.0, 20.0, 60.0]) < TOLERANCE_MM),
        );
        assert!((5..50).contains(&well), "{well}");
    }
}

#[test]
fn boss_and_bore() {
    let boss = [('D', 40.0), ('B', 1.0), ('H', 30.0), ('K', 4.0)];
    let boss = Call::new(8825, "UMI_BOSS", &boss);
    let bore = [('D', 40.0), ('B', 1.0), ('K', 4.0)];
    let bore = Call::new(8824, "UMI_BORE", &bore);
    let job = job(Tip::OnBoard, &[(1, "circle", 4, Some(20.0))]);
    let is_true = |shape: &Shape, _: &str| {
        let Shape::Circle {
            center_mm: [x, y, _],
            ..
        } = shape
        else {
            return false;
        };
        distance([*x, *y, 0.0], [10.0, 20.0, 0.0]) < TOLERANCE_MM
    };
    for family in FAMILIES {
        let well = from_anywhere(
            family,
            BOSS,
            &boss,
            &job,
            |n| around(n, 35.0, 40.0, 95.0),
            is_true,
        );
        assert!((5..50).contains(&well), "{well}");
        let well = from_anywhere(
            family,
            RING,
            &bore,
            &job,
            |n| around(n, 30.0, 10.0, 80.0),
            is_true,
        );
        assert!((5..50).contains(&well), "{well}");
    }
}

/// Three hits on a face: one that touched its edge shows in the others.
#[test]
fn web() {
    let values = [
        ('A', 1.0),
        ('D', 40.0),
        ('B', 1.0),
        ('H', 30.0),
        ('U', 20.0),
        ('K', 3.0),
    ];
    let call = Call::new(8826, "UMI_WEB", &values);
    let job = job(Tip::OnBoard, &[(1, "line", 3, None), (2, "line", 3, None)]);
    for family in FAMILIES {
        let well = from_anywhere(
            family,
            WEB,
            &call,
            &job,
            // No higher: an edge at the top, touched all along it, looks like a face.
            |number| around(number, 45.0, 50.0, 89.9),
            |shape, name| {
                let face = if name == "F1" { 30.0 } else { -10.0 };
                matches!(shape, Shape::Line { point_mm, .. } if (point_mm[0] - face).abs() < TOLERANCE_MM)
            },
        );
        assert!((5..50).contains(&well), "{well}");
    }
}
