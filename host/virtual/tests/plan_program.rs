//! The program of a scan path, as the virtual machine drives it: the same axes within 0.001.

use std::path::Path;

use umi_scan::plan::program::{PathDialect, ProgramMode, ProgramStyle, program};
use umi_scan::plan::proof::row::PathRow;
use umi_scan::plan::spec::ScanSpec;
use umi_virtual::cell::Cell;
use umi_virtual::machine::Unwired;
use umi_virtual::nc::{Alarm, AxisDrives as _, check};
use umi_virtual::scene::Scene;

/// A table that tilts and turns, and a spindle that orients itself, as the reference's machine.
fn scene(dialect: &str) -> Scene {
    scene_with(dialect, "")
}

/// The same, and more of its text.
fn scene_with(dialect: &str, more: &str) -> Scene {
    let text = format!(
        r#"
        [machine]
        travel_min_mm = [-900, -900, -900]
        travel_max_mm = [900, 900, 900]
        reference_mm = [0, 0, 900]
        start_mm = [0, 0, 500]
        [[machine.rotary]]
        word = "A"
        carries = "workpiece"
        axis = [1, 0, 0]
        point_mm = [0, 3.0, -60.0]
        limits_deg = [-110, 110]
        [[machine.rotary]]
        word = "C"
        carries = "workpiece"
        axis = [0, 0, 1]
        point_mm = [1.0, -2.0, 0]
        [[machine.rotary]]
        word = "W"
        carries = "spindle"
        axis = [0, 0, 1]
        [control.nc]
        dialect = "{dialect}"
        {more}
        "#
    );
    Scene::parse(&text).unwrap()
}

#[test]
fn a_program_goes_to_the_rows_of_its_path() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan");
    let spec = ScanSpec::open(&folder.join("kinematics_ac.toml")).unwrap();
    let table = std::fs::read_to_string(folder.join("kinematics_ac.axes.csv")).unwrap();
    let rows: Vec<PathRow> = table
        .lines()
        .skip(1)
        .map(|line| {
            let axes: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            PathRow {
                pass: 0,
                laser: true,
                pose: spec.machine.forward(&axes),
                axes,
            }
        })
        .collect();
    assert!(rows.len() > 10);
    for (dialect, name) in [
        (PathDialect::Fanuc, "fanuc"),
        (PathDialect::LinuxCnc, "linuxcnc"),
    ] {
        let style = ProgramStyle {
            dialect,
            mode: ProgramMode::Rotary,
            feed_mm_per_min: 600.0,
            number: 1000,
        };
        let text = program(&spec, Vec::new(), &rows, style).unwrap().text;
        let scene = scene(name);
        assert_eq!(check(&text, &scene.control.nc), [], "{text}");
        let mut cell = Cell::new(scene, 1, Unwired);
        let mut reached = 0;
        cell.run(&text, |cell, step| {
            if step.text.trim_start().starts_with("G1 ") {
                let machine = &cell.machine;
                let mut at = machine.position().to_array_mm().to_vec();
                at.extend(machine.turned_deg());
                for (wanted, at) in rows[reached].axes.iter().zip(&at) {
                    assert!(
                        (wanted - at).abs() < 0.000_501,
                        "{name} row {reached}: {wanted} {at}"
                    );
                }
                reached += 1;
            }
            Ok::<(), Alarm>(())
        })
        .unwrap();
        assert_eq!(reached, rows.len(), "{name}");
    }
}

/// Whether a control glues the frame of X Y Z to the table as it stands at `G43.4` or at zero: it stands at zero there.
#[test]
fn a_carried_point_is_the_same_by_both_readings_of_g43_4() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan");
    let text = std::fs::read_to_string(folder.join("kinematics_ac.toml")).unwrap();
    let text = text
        .replace("[10.0, 5.0, -30.0]", "[0, 0, 0]")
        .replace("[16.327, -20.445, -137.91]", "[0, 0, -150]");
    let spec = ScanSpec::read(&text, &folder).unwrap();
    let rows = [40.0, 40.5, 41.0].map(|x| {
        let axes = vec![x, 10.0, 300.0, 50.0 + x / 10.0, 100.0 + x, 15.0];
        PathRow {
            pass: 0,
            laser: true,
            pose: spec.machine.forward(&axes),
            axes,
        }
    });
    let style = ProgramStyle {
        dialect: PathDialect::Fanuc,
        mode: ProgramMode::Rtcp,
        feed_mm_per_min: 600.0,
        number: 1000,
    };
    let text = program(&spec, Vec::new(), &rows, style).unwrap().text;
    let offsets =
        "[offsets_mm]\nG54 = [30.0, -20.0, 12.0]\n[tools.1]\nlength_mm = 210\nradius_mm = 1\n";
    let scene = scene_with("fanuc", offsets);
    let mut cell = Cell::new(scene, 1, Unwired);
    let (mut carried, mut reached) = (false, 0);
    cell.run(&text, |cell, step| {
        let machine = &cell.machine;
        let mut at = machine.position().to_array_mm().to_vec();
        at.extend(machine.turned_deg());
        if step.text.contains("G43.4 H1") {
            assert_eq!(at[3..5], [0.0, 0.0]);
            carried = true;
        }
        let near = |row: &PathRow| row.axes.iter().zip(&at).all(|(a, b)| (a - b).abs() < 0.02);
        if carried && rows.get(reached).is_some_and(near) {
            reached += 1;
        }
        Ok::<(), Alarm>(())
    })
    .unwrap();
    assert_eq!((carried, reached), (true, rows.len()), "{text}");
}

/// The chain of the scene is that of the plan: a sensor that is mounted as there sees from the
/// same place in the same direction.
#[test]
fn the_scene_has_the_machine_of_the_plan() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan");
    let spec = ScanSpec::open(&folder.join("kinematics_ac.toml")).unwrap();
    let planned = &spec.machine.chain;
    let chain = scene("fanuc").machine.chain(planned.sensor);
    let axes = [154.5, -43.5, 6.7, -4.1, -104.1, 71.8];
    let made = planned
        .workpiece
        .inverse()
        .after(&chain.sensor_in_workpiece(&axes));
    let wanted = planned.sensor_in_workpiece(&axes);
    assert!((made.translation_mm - wanted.translation_mm).norm() < 1e-9);
    assert!((made.rotation - wanted.rotation).norm() < 1e-12);
}
