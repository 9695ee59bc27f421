//! The fixed paths for GRBL: whatever the start within what they say, the fits of what GRBL
//! reports are the truth; outside, GRBL's own alarm.

use std::fs;

use umi_protocol::feature::Shape;
use umi_virtual::machine::VirtualMachine;
use umi_virtual::nc::{Control, ControlFamily, ControlSettings};
use umi_virtual::scene::Scene;

use crate::macros::bench::*;

/// Runs a program from a start position.
fn run_grbl(program: &str, scene: &str, start_mm: [f64; 3]) -> Ran {
    run_overridden(program, scene, start_mm, 100.0)
}

/// The same with the operator's override at another place, percent.
fn run_overridden(program: &str, scene: &str, start_mm: [f64; 3], percent: f64) -> Ran {
    let path = format!(
        "{}/../hw/control/grbl/{program}",
        env!("CARGO_MANIFEST_DIR")
    );
    let text = fs::read_to_string(path).unwrap();
    let mut settings = ControlSettings::of(ControlFamily::Grbl);
    settings.feed_override_percent = percent;
    let mut control = Control::new(settings);
    let main = control.load(&text).unwrap();
    control.select(main[0]).unwrap();
    let mut scene = Scene::parse(scene).unwrap();
    scene.machine.start_mm = start_mm;
    let mut machine = VirtualMachine::new(scene, 1, Serial::default());
    let alarm = control.run(&mut machine).err();
    Ran { machine, alarm }
}

/// The job of a program: GRBL's lines name no feature.
fn grbl_job(kind: &str, hits: usize, radius: Option<f64>) -> String {
    job(Tip::InRadius, &[(1, kind, hits, radius)])
        .replace("checked = {}", "grbl_probe = {}")
        .replace(
            "patterns = [{ grbl_probe = {} }]",
            "patterns = [\"grbl_probe\"]",
        )
}

#[test]
fn sphere() {
    let scene = "[[body]]\nname = \"BALL\"\nshape = { sphere = { radius_mm = 12.7 } }\n\
                 position_mm = [10.0, 20.0, 60.0]\n";
    let job = grbl_job("sphere", 9, Some(15.2));
    for (x, y, above) in [
        (0.0, 0.0, 5.0),
        (3.0, 0.0, 15.0),
        (-2.1, 2.1, 10.0),
        (0.0, -3.0, 7.5),
    ] {
        let ran = run_grbl("sphere.nc", scene, [10.0 + x, 20.0 + y, 75.2 + above]);
        let [Shape::Sphere { center_mm, .. }] = ran.shapes(&job)[..] else {
            panic!("{ran}");
        };
        assert!(
            distance(center_mm, [10.0, 20.0, 60.0]) < TOLERANCE_MM,
            "{center_mm:?}\n{ran}"
        );
    }
    let ran = run_grbl("sphere.nc", scene, [60.0, 20.0, 80.0]);
    assert!(ran.alarm.is_some());
}

#[test]
fn plane() {
    let scene = "[[body]]\nname = \"PLATE\"\nshape = { block = { size_mm = [200.0, 200.0, 20.0] } }\n\
                 position_mm = [0.0, 0.0, 50.0]\nrotation_deg = [3.0, -2.0, 0.0]\n";
    let ran = run_grbl("plane.nc", scene, [-40.0, -30.0, 66.0]);
    let [Shape::Plane { normal, .. }] = ran.shapes(&grbl_job("plane", 9, None))[..] else {
        panic!("{ran}");
    };
    let wanted = ran.machine.scene().bodies()[0]
        .placed()
        .rotation
        .column(2)
        .into_owned();
    assert!(distance(normal, wanted.into()) < 4e-5, "{normal:?}");
}

#[test]
fn bore() {
    let scene = "[[body]]\nname = \"RING\"\n\
                 shape = { ring = { radius_mm = 25.0, outer_radius_mm = 40.0, height_mm = 30.0 } }\n\
                 position_mm = [10.0, 20.0, 60.0]\n";
    let job = grbl_job("circle", 8, Some(22.5));
    for (x, y) in [(0.0, 0.0), (5.0, 0.0), (-3.5, 3.5)] {
        let ran = run_grbl("bore.nc", scene, [10.0 + x, 20.0 + y, 50.0]);
        let [Shape::Circle { center_mm, .. }] = ran.shapes(&job)[..] else {
            panic!("{ran}");
        };
        assert!(
            distance(center_mm, [10.0, 20.0, 50.0]) < TOLERANCE_MM,
            "{center_mm:?}"
        );
    }
    let ran = run_grbl("bore.nc", scene, [10.0, 20.0, 90.0]);
    assert!(ran.alarm.is_some());
}

/// Nothing holds GRBL's override off, and no line says it. With a delay of 4 ms each touch at 50 mm/min
/// comes 3.3 µm later at 200 %: a ball is smaller by that and stays where it is, a plane sinks by it.
#[test]
fn an_override_moves_planes_and_no_balls() {
    let late = "[control]\nskip_delay_ms = [4.0, 4.0]\n";
    let ball = "[[body]]\nname = \"BALL\"\nshape = { sphere = { radius_mm = 12.7 } }\n\
                position_mm = [10.0, 20.0, 60.0]\n";
    let plate = "[[body]]\nname = \"PLATE\"\nposition_mm = [0.0, 0.0, 50.0]\n\
                 shape = { block = { size_mm = [200.0, 200.0, 20.0] } }\n";
    let sphere = |percent: f64| {
        let start_mm = [10.0, 20.0, 80.2];
        let ran = run_overridden("sphere.nc", &format!("{ball}{late}"), start_mm, percent);
        // Its radius is what changes: no limit holds it here.
        let job = grbl_job("sphere", 9, None);
        match ran.shapes(&job)[..] {
            [
                Shape::Sphere {
                    center_mm,
                    radius_mm,
                    ..
                },
            ] => (center_mm, radius_mm),
            _ => panic!("{ran}"),
        }
    };
    let plane = |percent: f64| {
        let start_mm = [-40.0, -30.0, 66.0];
        let ran = run_overridden("plane.nc", &format!("{plate}{late}"), start_mm, percent);
        match ran.shapes(&grbl_job("plane", 9, None))[..] {
            [Shape::Plane { point_mm, .. }] => point_mm[2],
            _ => panic!("{ran}"),
        }
    };
    let (center_mm, radius_mm) = sphere(100.0);
    let height_mm = plane(100.0);
    for percent in [50.0, 150.0, 200.0] {
        let later_mm = 50.0 / 60_000.0 * 4.0 * (percent / 100.0 - 1.0);
        let (center, radius) = sphere(percent);
        assert!(distance(center, center_mm) < TOLERANCE_MM, "{center:?}");
        // GRBL reports steps of a micrometre.
        assert!((radius_mm - radius - later_mm).abs() < 0.001, "{radius}");
        let height = plane(percent);
        assert!((height_mm - height - later_mm).abs() < 0.001, "{height}");
    }
}
