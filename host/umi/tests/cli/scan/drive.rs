//! `umi scan drive`: a planned path over the virtual machine, to a cloud and its deviations.

use std::fs;

use serde_json::Value;

use crate::rig::run::{Folder, Ran, project, umi};

/// A path on the reference's wavy STEP surface, for its table A, head B and orientable spindle.
struct Planned {
    folder: Folder,
    part: String,
    spec: String,
    path: String,
    program: String,
}

fn planned() -> Planned {
    let folder = Folder::new();
    let part = project("tests/reference/plan/step_wavy.step");
    let spec = project("tests/reference/plan/step_wavy.toml");
    let (path, program) = (folder.path("path.csv"), folder.path("path.nc"));
    umi(&[
        "scan",
        "plan",
        &part,
        "--spec",
        &spec,
        "-o",
        &path,
        "--nc",
        &program,
        "--feed",
        "1200",
        "--dialect",
        "linuxcnc",
    ])
    .exits(0);
    Planned {
        folder,
        part,
        spec,
        path,
        program,
    }
}

impl Planned {
    fn drive(&self, path: &str, more: &[&str]) -> Ran {
        let args = ["scan", "drive", &self.part, "--spec", &self.spec, path];
        let sparse = ["--every-ms", "50", "--columns", "17", "--json"];
        umi(&[&args[..], &sparse, more].concat())
    }
}

fn figure(answer: &Value, name: &str) -> f64 {
    answer["deviations"][name].as_f64().unwrap()
}

/// Without noise the cloud lies on the part to the steps of profiles and encoders, from the path
/// and from its program; a machine file whose axis is elsewhere would show it.
#[test]
fn a_planned_path_is_driven_to_a_cloud_on_the_part() {
    let of = planned();
    let (cloud, kept) = (of.folder.path("cloud.csv"), of.folder.path("kept"));
    let page = of.folder.path("page.html");
    let quiet = ["--noise-um", "0", "--feed", "1200", "-o", &cloud];
    let kept_too = ["--recording", &kept, "--report", &page];
    let driven = of.drive(&of.path, &[&quiet[..], &kept_too].concat());
    let driven = driven.exits(0).json();
    assert_eq!(driven["paired"], driven["profiles"], "{driven}");
    assert_eq!(driven["profiles"], driven["pulses"]);
    assert!(driven["lit"].as_u64() < driven["pulses"].as_u64());
    assert!(driven["coverage"].as_f64().unwrap() > 0.97, "{driven}");
    assert!(figure(&driven, "rms_mm") < 2e-4, "{driven}");
    assert!(figure(&driven, "max_mm") < 1e-3, "{driven}");
    let text = fs::read_to_string(&page).unwrap();
    assert!(text.contains("The points are simulated") && text.contains("WITHOUT noise"));

    // What was driven, driven again; a limit that it would pass is an alarm.
    let file = |name: &str| format!("{kept}/{name}");
    let (program, scene) = (file("program.nc"), file("scene.toml"));
    let run = |scene: &str| umi(&["machine", "run", &program, "--scene", scene, "--json"]);
    run(&scene).exits(0);
    let text = fs::read_to_string(&scene).unwrap();
    let narrow = text.replace(
        "limits_deg = [-95.0005, 95.0005]",
        "limits_deg = [-1.0, 1.0]",
    );
    assert_ne!(narrow, text);
    run(&of.folder.file("narrow.toml", narrow)).exits(2);

    // The same recording through the commands that a real one goes through.
    let merge = |machine: &str, out: &str| {
        let (profiles, triggers) = (file("profiles.gocator"), file("triggers.csv"));
        let args = ["scan", "merge", &profiles, &triggers, "--json"];
        umi(&[&args[..], &["--machine", machine, "-o", out]].concat())
            .exits(0)
            .json()
    };
    let merged = of.folder.path("merged.csv");
    assert_eq!(
        merge(&file("machine.toml"), &merged)["points"],
        driven["points"]
    );
    let rows = |path: &str| -> Vec<[f64; 3]> {
        let text = fs::read_to_string(path).unwrap();
        let mut lines = text.lines();
        let names: Vec<&str> = lines.next().unwrap().split(',').collect();
        let places = ["x_mm", "y_mm", "z_mm"]
            .map(|name| names.iter().position(|other| *other == name).unwrap());
        lines
            .map(|line| {
                let cells: Vec<&str> = line.split(',').collect();
                places.map(|place| cells[place].parse().unwrap())
            })
            .collect()
    };
    let far = |a: &[[f64; 3]], b: &[[f64; 3]]| {
        let apart = a.iter().flatten().zip(b.iter().flatten());
        apart.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    assert!(far(&rows(&cloud), &rows(&merged)) < 1e-9);
    let machine = fs::read_to_string(file("machine.toml")).unwrap();
    let machine = machine.replace(
        "point_mm = [0.0, 0.0, -50.0]",
        "point_mm = [0.0, 0.3, -50.0]",
    );
    let other = of.folder.file("other.toml", machine);
    let wrong = of.folder.path("wrong.csv");
    merge(&other, &wrong);
    assert!(far(&rows(&cloud), &rows(&wrong)) > 0.01);

    // The program says where the laser is off; LinuxCNC's control reads it.
    let second = of.folder.path("second.ply");
    let more = ["--noise-um", "0", "--dialect", "linuxcnc", "-o", &second];
    let again = of.drive(&of.program, &more).exits(0).json();
    assert!(figure(&again, "rms_mm") < 2e-4, "{again}");
    // The control carries the point on the part.
    let third = of.folder.path("third.csv");
    let more = ["--nc-mode", "rtcp", "-o", &third];
    let carried = of
        .drive(&of.path, &[&quiet[..4], &more].concat())
        .exits(0)
        .json();
    assert!(figure(&carried, "rms_mm") < 2e-4, "{carried}");
    assert!(carried["coverage"].as_f64().unwrap() > 0.97, "{carried}");

    let apart = again["lit"].as_f64().unwrap() / driven["lit"].as_f64().unwrap();
    assert!((apart - 1.0).abs() < 0.02, "{apart}");
}

/// The noise is that which was asked for, and what cannot be driven leaves no file.
#[test]
fn noise_is_seen_and_what_touches_is_refused() {
    let of = planned();
    let cloud = of.folder.path("cloud.pcd");
    let noisy = ["--noise-um", "20", "--feed", "1200", "-o", &cloud];
    let noisy = of.drive(&of.path, &noisy).exits(0).json();
    let std = figure(&noisy, "std_mm");
    assert!((0.018..0.023).contains(&std), "{noisy}");

    let crash = "%\nO1\nG21 G90 G54 G94\nG0 X0 Y0 Z300.\nG1 Z150. F3000.\nM30\n%\n";
    let limit = "%\nO1\nG21 G90 G54 G94\nG0 A120.\nM30\n%\n";
    let blind = "%\nO1\nG21 G90 G54 G94\nG1 Z890. F3000.\nM30\n%\n";
    for (program, code) in [
        (crash, "collision"),
        (limit, "alarm"),
        (blind, "too_few_points"),
    ] {
        let program = of.folder.file("wrong.nc", program);
        let out = of.folder.path("none.ply");
        let refused = of.drive(&program, &["-o", &out]).exits(2).json();
        assert_eq!(refused["error"]["code"], code, "{refused}");
        assert!(fs::metadata(&out).is_err(), "{code}");
    }
    let out = of.folder.path("none.xyz");
    let refused = of.drive(&of.path, &["-o", &out]).exits(1).json();
    assert_eq!(refused["error"]["code"], "format");
    let again = of.drive(&of.path, &["-o", &cloud]).exits(1).json();
    assert_eq!(again["error"]["code"], "file", "{again}");
}
