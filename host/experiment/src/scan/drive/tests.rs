//! The machine, the sensor and the part of a driven path.

use std::path::Path;

use nalgebra::Vector3;
use umi_kinematics::AxisChain;
use umi_scan::plan::mesh::read_part;
use umi_scan::plan::spec::ScanSpec;
use umi_virtual::scanner::{LaserTarget as _, LineSample, Optics};

use super::rig::{Parts, machine_file, machine_text, scanner, scene, scene_text};
use super::{ControlLanguage, DriveOptions, grown};

const OPTIONS: DriveOptions = DriveOptions {
    dialect: ControlLanguage::Fanuc,
    interval_us: 25_000,
    columns: 33,
    noise_um: 0.0,
    noise_power: 1.0,
    seed: 1,
};

fn reference(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/reference/plan")
        .join(name)
}

fn spec(name: &str) -> ScanSpec {
    ScanSpec::open(&reference(name)).unwrap()
}

/// A place of the line scanner's frame is where the plan's sensor sees it.
#[test]
fn the_machine_file_is_the_specifications_machine() {
    for name in ["kinematics_ac.toml", "step_wavy.toml", "three_axes.toml"] {
        let spec = spec(name);
        let file = machine_file(&spec);
        let read = AxisChain::parse(&machine_text(&file)).unwrap();
        let axes = [14.5, -43.5, 6.7, -4.1, -104.1, 71.8];
        let axes = &axes[..spec.machine.names().len()];
        let planned = spec.machine.forward(axes);
        for (along, distance) in [(0.0, 52.0), (3.0, 60.0), (-7.0, 67.0)] {
            let wanted = planned.origin_mm + planned.line * along + planned.beam * distance;
            for chain in [&file, &read] {
                let at = chain.sensor_in_workpiece(axes).point(&Vector3::new(
                    along,
                    0.0,
                    60.0 - distance,
                ));
                assert!((at - wanted).norm() < 1e-9, "{name} {at} {wanted}");
            }
        }
    }
}

/// The outermost columns end where the specification's line does, at every distance; the camera
/// is where the receiver is.
#[test]
fn the_sensor_is_the_specifications_sensor() {
    let spec = spec("step_wavy.toml");
    let sensor = scanner(&spec, &OPTIONS).unwrap();
    let optics = Optics::new(sensor.clone());
    for z in [-8.0, 0.0, 8.0] {
        let width = optics.place(32, z) - optics.place(0, z);
        assert!((width - 16.0 * (60.0 - z) / 60.0).abs() < 1e-9, "{width}");
    }
    let pose = spec.machine.forward(&[0.0; 6]);
    let receiver = spec.sensor.receiver_mm;
    let wanted =
        pose.origin_mm + pose.line * receiver.x + pose.feed() * receiver.y + pose.beam * receiver.z;
    let at = machine_file(&spec)
        .sensor_in_workpiece(&[0.0; 6])
        .point(&sensor.camera_mm());
    assert!((at - wanted).norm() < 1e-9, "{at} {wanted}");
}

#[test]
fn a_machine_that_the_board_cannot_have_is_refused() {
    let mut four = spec("kinematics_ac.toml");
    let axis = four.machine.table[0].clone();
    four.machine.head.push(axis);
    let refused = scene_text(&four, &OPTIONS, false)
        .and_then(|text| scene(&text))
        .unwrap_err();
    assert_eq!(refused.code, "machine_spec", "{refused}");
    let mut named = spec("step_wavy.toml");
    named.machine.head[0].name = "B2".into();
    let refused = scene_text(&named, &OPTIONS, false)
        .and_then(|text| scene(&text))
        .unwrap_err();
    assert!(refused.message.contains("B2"), "{refused}");
}

/// An open mesh is met by a beam; of two, the nearer one is.
#[test]
fn a_beam_meets_the_nearest_mesh() {
    let part = read_part(&reference("three_axes.obj")).unwrap().surface;
    let lifted = part
        .moved(&umi_kinematics::Pose {
            translation_mm: Vector3::new(0.0, 0.0, 5.0),
            ..umi_kinematics::Pose::identity()
        })
        .unwrap();
    assert!(!part.is_closed());
    let from = Vector3::new(1.3, 2.1, 50.0);
    let way = |meshes| {
        let parts = Parts { meshes };
        parts.beam(&from, &-Vector3::z(), 100.0).unwrap()
    };
    let alone = way(vec![&part]);
    assert!(alone.normal.z > 0.5);
    for meshes in [vec![&part, &lifted], vec![&lifted, &part]] {
        assert!((way(meshes).way_mm - (alone.way_mm - 5.0)).abs() < 1e-9);
    }
    let parts = Parts {
        meshes: vec![&part],
    };
    assert!(parts.beam(&from, &Vector3::z(), 100.0).is_none());
}

/// At 60 degrees: the secant is 2, its square 4. What the sensor does not see stays unseen.
#[test]
fn the_noise_grows_by_the_power_that_is_asked_for() {
    let sample = LineSample {
        x_mm: 1.0,
        z_mm: -2.0,
        cosine: 0.5,
        is_false: false,
    };
    for (power, cosine) in [(0.0, 1.0), (1.0, 0.5), (2.0, 0.25)] {
        let profile = grown(vec![None, Some(sample)], power);
        assert_eq!(profile, [None, Some(LineSample { cosine, ..sample })]);
    }
}
