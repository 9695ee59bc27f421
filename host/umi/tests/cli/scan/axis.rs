//! A rotary axis from centres of balls: its residuals, its page, and its place in the machine file.

use umi_kinematics::AxisChain;

use crate::rig::run::{Folder, project, umi};

/// Where the reference case has the axis: 1.1 minutes of arc off Z.
const CENTRES: &str = "tests/reference/scan/axis_c.csv";

fn preset(folder: &Folder) -> String {
    let path = folder.path("machine.toml");
    umi(&["scan", "machine", "new", "c800u", "-o", &path]).exits(0);
    path
}

fn lines(path: &str) -> Vec<String> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().map(str::to_owned).collect()
}

/// Two lines of the joint change, to the last bit of the answer, and nothing else; what is written is where the next
/// calibration finds the axis.
#[test]
fn an_axis_goes_into_its_joint_of_the_machine_file_alone() {
    let folder = Folder::new();
    let machine = preset(&folder);
    let out = folder.path("turned.toml");
    let axis = |machine: &str, more: &[&str]| {
        let centres = project(CENTRES);
        let fixed = ["scan", "calibrate", "axis", &centres, "--json"];
        umi(&[&fixed[..], &["--machine", machine, "--axis", "C"], more].concat())
    };
    let found = axis(&machine, &["-o", &out]).exits(0).json();
    let (before, after) = (lines(&machine), lines(&out));
    assert_eq!(before.len(), after.len());
    let changed = before.iter().zip(&after).filter(|(a, b)| a != b);
    let changed: Vec<_> = changed.collect();
    assert_eq!(changed.len(), 2, "{changed:?}");
    for (old, new) in changed {
        let comment = &old[old.find('#').unwrap()..];
        assert!(new.ends_with(comment), "{new}");
    }
    let chain = AxisChain::parse(&std::fs::read_to_string(&out).unwrap()).unwrap();
    let joint = chain.joints.iter().find(|joint| joint.name == "C").unwrap();
    for i in 0..3 {
        let of = |name: &str| found[name][i].as_f64().unwrap();
        assert_eq!(joint.point_mm[i], of("point_mm"));
        assert!((joint.direction[i] - of("direction")).abs() < 1e-15);
    }
    // How far it lay off: the distance of 0,0,0 from the axis, and the angle to Z.
    let beside =
        |found: &serde_json::Value, name: &str| found["beside_file"][name].as_f64().unwrap();
    let foot = (0..2)
        .map(|i| found["point_mm"][i].as_f64().unwrap().powi(2))
        .sum::<f64>();
    assert!((beside(&found, "moved_mm") - foot.sqrt()).abs() < 1e-3);
    assert!((beside(&found, "turned_deg") - 0.0246).abs() < 1e-3);
    let again = axis(&out, &[]).exits(0).json();
    assert!(beside(&again, "moved_mm") < 1e-9 && beside(&again, "turned_deg") < 1e-9);
    assert_eq!(again["point_mm"], found["point_mm"]);
    // The machine file is never replaced, another output only if that is wanted.
    axis(&machine, &["-o", &machine, "--force"]).exits(1);
    axis(&machine, &["-o", &out]).exits(1);
}

/// Another joint's centres, a joint that turns the other way or is none: each has its name, and no file is left.
#[test]
fn an_axis_of_another_joint_is_refused() {
    let folder = Folder::new();
    let machine = preset(&folder);
    let text = std::fs::read_to_string(&machine).unwrap();
    let turned = text.replace(
        "direction = [0, 0, 1]      #",
        "direction = [0, 0, -1]     #",
    );
    assert_ne!(text, turned);
    let turned = folder.file("turned.toml", turned);
    let out = folder.path("out.toml");
    let page = folder.path("page.html");
    let centres = project(CENTRES);
    let run = |more: &[&str]| {
        let fixed = ["scan", "calibrate", "axis", &centres, "--json"];
        umi(&[&fixed[..], more].concat())
    };
    for (machine, axis, code, word) in [
        (&machine, "A", "other_axis", "of another axis"),
        (&turned, "C", "other_axis", "counts_per_deg"),
        (&machine, "B", "missing_axis", "A, C"),
        (&machine, "X", "machine", "linear"),
    ] {
        let told = run(&[
            "--machine",
            machine,
            "--axis",
            axis,
            "-o",
            &out,
            "--report",
            &page,
        ]);
        let error = told.exits(2).json();
        assert_eq!(error["error"]["code"], code);
        let message = error["error"]["message"].as_str().unwrap();
        assert!(message.contains(word), "{message}");
        for path in [&out, &page] {
            assert!(!std::path::Path::new(path).exists(), "{path}");
        }
    }
    run(&["-o", &out]).exits(1);
    run(&["--machine", &machine]).exits(1);
}

/// An angle that was written down wrong in one row is named with the right one, and the axis goes into no file.
#[test]
fn a_wrong_angle_is_named_and_leaves_no_file() {
    let folder = Folder::new();
    let machine = preset(&folder);
    let out = folder.path("out.toml");
    let right = std::fs::read_to_string(project(CENTRES)).unwrap();
    let (row, line) = (right.lines().enumerate().skip(1))
        .find(|(_, line)| line.starts_with("45"))
        .unwrap();
    let wrong = right.replacen(line, &line.replacen("45", "46", 1), 1);
    let centres = folder.file("centres.csv", wrong);
    let found = umi(&["scan", "calibrate", "axis", &centres, "--json"])
        .exits(0)
        .json();
    assert_eq!(found["outlier"]["rows"], serde_json::json!([row]));
    let angle = found["outlier"]["angle_by_others_deg"].as_f64().unwrap();
    assert!((angle - 45.0).abs() < 0.05, "{angle}");
    let file = ["--machine", &machine, "--axis", "C", "-o", &out, "--json"];
    let told = umi(&[&["scan", "calibrate", "axis", &centres][..], &file].concat());
    assert_eq!(told.exits(2).json()["error"]["code"], "outlier");
    assert!(!std::path::Path::new(&out).exists());
}

/// The residuals of the table have the answer's standard deviation, and each stands there by the axis as well; the page has
/// them all.
#[test]
fn residuals_of_an_axis_stand_in_a_table_and_on_a_page() {
    let folder = Folder::new();
    let (residuals, page) = (folder.path("residuals.csv"), folder.path("page.html"));
    let centres = project(CENTRES);
    let fixed = ["scan", "calibrate", "axis", &centres];
    let more = ["--residuals", &residuals, "--report", &page, "--json"];
    let found = umi(&[&fixed[..], &more].concat()).exits(0).json();
    let table = lines(&residuals);
    assert_eq!(table.len() as u64, 1 + found["n"].as_u64().unwrap());
    let (mut plain, mut by_axis) = (0.0, 0.0);
    for row in &table[1..] {
        let row: Vec<f64> = row.split(',').map(|v| v.parse().unwrap()).collect();
        let squares = |of: &[f64]| of.iter().map(|v| v * v).sum::<f64>();
        assert!((squares(&row[5..8]) - squares(&row[8..11])).abs() < 1e-15);
        plain += squares(&row[5..8]);
        by_axis += squares(&row[8..11]);
    }
    let sigma = found["sigma_mm"].as_f64().unwrap();
    for squares in [plain, by_axis] {
        let of_table = (squares / found["dof"].as_f64().unwrap()).sqrt();
        assert!((of_table / sigma - 1.0).abs() < 1e-9);
    }
    let html = std::fs::read_to_string(&page).unwrap();
    for shown in [
        &*format!("{sigma:.6} mm"),
        "Residuals of each centre",
        "Content-Security-Policy",
        "<svg",
    ] {
        assert!(html.contains(shown), "{shown}");
    }
    assert!(!html.contains("NaN") && !html.contains("src=\"http"));
    let told = umi(&fixed).exits(0).out;
    assert!(told.contains("axial, µm"), "{told}");
    let rows = told
        .lines()
        .filter(|line| line.trim_start().starts_with("45.0000"));
    assert_eq!(rows.count(), 2, "{told}");
}
