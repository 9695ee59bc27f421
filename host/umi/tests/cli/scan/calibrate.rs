//! From a plan to a scan, from the scan to what was seen of the ball, from that to the mount.

use std::fmt::Write as _;

use serde_json::Value;
use umi_kinematics::AxisChain;

use crate::rig::run::{Folder, umi};

const RADIUS_MM: f64 = 12.7;
const BALL_MM: [f64; 3] = [40.0, 25.0, 30.0];
/// The mount as it is.
const TRUTH: &str = "[sensor]\nrotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n\
                     translation_mm = [0.7, 28.2, -120.7]\n";
/// The mount as somebody measured it: 0.6 degrees and 3 mm off.
const GUESS: &str = "[sensor]\nrotation = [[0.99995, -0.01, 0], [0.01, 0.99995, 0], [0, 0, 1]]\n\
                     translation_mm = [2.5, 26.2, -119.7]\n";

/// The preset of a tilting and turning table with a mount.
fn machine(mount: &str) -> String {
    let preset = umi(&["scan", "machine", "new", "c800u"]).exits(0).out;
    let (chains, _) = preset.split_once("[sensor]").unwrap();
    let mount = mount.replace("0.99995, -0.01", "0.999950001249938, -0.01");
    format!(
        "{chains}{}",
        mount.replace("0.01, 0.99995,", "0.01, 0.999950001249938,")
    )
}

/// The streams of a scan at these positions: a ball on a table, 5 µm of noise, spikes.
fn scan(truth: &AxisChain, poses: &str) -> (String, String) {
    scan_of(truth, poses, RADIUS_MM)
}

/// The same of a ball of another radius.
fn scan_of(truth: &AxisChain, poses: &str, radius_mm: f64) -> (String, String) {
    let mut profiles = String::from("profile,frame,t_us,encoder,index,x_mm,z_mm\n");
    let mut latches = String::from(
        "event,number,cause,t_ns,x_counts,y_counts,z_counts,w_counts,axis5_counts,axis6_counts,lost\n",
    );
    let mut noise = 1_u64;
    for (number, row) in poses.lines().skip(1).enumerate() {
        let q: Vec<f64> = row.split(',').skip(1).map(|v| v.parse().unwrap()).collect();
        let counts: Vec<i64> = q
            .iter()
            .zip([1e3, 1e3, 1e3, 1e4, 1e4])
            .map(|(q, scale)| (q * scale).round() as i64)
            .collect();
        // An uneven rhythm has one pairing only.
        let t_us = 1_000_000 + 100_000 * number as u64 + 777 * (number as u64 * number as u64 % 13);
        let [x, y, z, a, c] = counts[..] else {
            panic!("{row}");
        };
        writeln!(
            latches,
            "latch,{number},output,{}000,{x},{y},{z},{a},{c},,0",
            t_us + 5_000_000
        )
        .unwrap();
        let back = truth.sensor_in_workpiece(&q).inverse();
        let ball = back.point(&BALL_MM.into());
        let up = back.rotation.column(2).into_owned();
        let table = up.dot(&back.point(&[0.0, 0.0, 0.0].into()));
        for i in 0..600 {
            let x = -30.0 + 0.1 * f64::from(i);
            let height = radius_mm.powi(2) - ball.y.powi(2) - (x - ball.x).powi(2);
            let on_table = (table - up.x * x) / up.z;
            let mut at = if height > 0.0 {
                ball.z + height.sqrt()
            } else {
                on_table
            };
            let mut sum = 0.0;
            for _ in 0..4 {
                noise = noise
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                sum += (noise >> 40) as f64 / f64::from(1 << 24) - 0.5;
            }
            at += 0.005 * sum * 3.0_f64.sqrt();
            if i % 41 == 0 {
                at += 1.5;
            }
            writeln!(profiles, "{number},{number},{t_us},,{i},{x},{at}").unwrap();
        }
    }
    (profiles, latches)
}

fn numbers(value: &Value) -> Vec<f64> {
    let list = value.as_array().unwrap();
    list.iter().map(|v| v.as_f64().unwrap()).collect()
}

#[test]
fn a_planned_scan_of_a_ball_becomes_the_mount_with_the_uncertainty_that_was_expected() {
    let folder = Folder::new();
    let guess = folder.file("guess.toml", machine(GUESS));
    let truth = AxisChain::parse(&machine(TRUTH)).unwrap();
    let poses = folder.path("poses.csv");
    let ball = ["--at", "40,25,30", "--radius-mm", "12.7"];
    let swings = ["--swing", "A=-25..25", "--swing", "C=-180..180"];
    let base = [
        "scan",
        "calibrate",
        "plan",
        "--machine",
        &guess,
        "-o",
        &poses,
        "--json",
    ];
    let plan = umi(&[&base[..], &ball, &swings, &["--noise-mm", "0.005"]].concat());
    let plan = plan.exits(0).json();
    let table = std::fs::read_to_string(&poses).unwrap();
    assert_eq!(table.lines().next(), Some("profile,X,Y,Z,A,C"));
    assert_eq!(table.lines().count(), 31);

    let (profiles, latches) = scan(&truth, &table);
    let profiles = folder.file("profiles.csv", profiles);
    let latches = folder.file("latches.csv", latches);
    let (seen, at) = (folder.path("seen.csv"), folder.path("at.csv"));
    let observe = |more: &[&str]| {
        let args = [
            "scan",
            "calibrate",
            "observe",
            &profiles,
            &latches,
            "--machine",
            &guess,
        ];
        let out = ["-o", &seen, "--positions", &at, "--json"];
        umi(&[&args[..], &out, more].concat())
    };
    let observed = observe(&["--on", "sphere", "--radius-mm", "12.7"])
        .exits(0)
        .json();
    assert_eq!(observed["paired"], 30);
    let used = observed["used"].as_u64().unwrap();
    assert!(used >= 28, "{observed}");
    assert!(
        observed["samples_beside"].as_u64().unwrap() > 1000,
        "{observed}"
    );
    assert_eq!(observed["features"].as_array().unwrap().len(), 1);

    let out = folder.path("found.toml");
    let args = [
        "scan",
        "calibrate",
        "sensor",
        &seen,
        &at,
        "--machine",
        &guess,
        "--on",
        "sphere",
    ];
    let more = ["--radius-mm", "12.7", "-o", &out, "--json"];
    let found = umi(&[&args[..], &more].concat()).exits(0).json();
    let sigma = found["sigma_mm"].as_f64().unwrap();
    assert!((0.003..0.006).contains(&sigma), "{found}");
    assert_eq!(found.get("warnings"), None, "{found}");
    for (k, (value, right)) in numbers(&found["translation_mm"])
        .into_iter()
        .zip([0.7, 28.2, -120.7])
        .enumerate()
    {
        let u = found["covariance_scatter"][3 + k][3 + k]
            .as_f64()
            .unwrap()
            .sqrt();
        assert!(
            (value - right).abs() < 4.0 * u && u < 0.003,
            "{k}: {value} {u}"
        );
        // The plan reckoned with other samples; its figure is of the same size.
        let expected = plan["u_shift_mm"][k].as_f64().unwrap();
        assert!((0.4..2.5).contains(&(u / expected)), "{u} {expected}");
        let turn = found["covariance_scatter"][k][k].as_f64().unwrap().sqrt();
        assert!(turn < 1e-4, "{turn}");
    }

    // Another radius is told: as a warning, or with the refusal.
    let more = ["--radius-mm", "12.72", "--json"];
    let other = umi(&[&args[..], &more].concat()).json().to_string();
    let (_, wanted) = other.split_once("the residuals want a radius of ").unwrap();
    let wanted: f64 = wanted.split(' ').next().unwrap().parse().unwrap();
    assert!((wanted - RADIUS_MM).abs() < 0.002, "{other}");
    // Positions in radians.
    let text = std::fs::read_to_string(&at).unwrap();
    let mut radians = String::new();
    for (i, row) in text.lines().enumerate() {
        let mut cells: Vec<String> = row.split(',').map(str::to_owned).collect();
        if i > 0 {
            for cell in &mut cells[4..] {
                *cell = cell.parse::<f64>().unwrap().to_radians().to_string();
            }
        }
        radians += &(cells.join(",") + "\n");
    }
    let radians = folder.file("radians.csv", radians);
    let args = [
        "scan",
        "calibrate",
        "sensor",
        &seen,
        &radians,
        "--machine",
        &guess,
    ];
    let error = umi(&[
        &args[..],
        &["--on", "sphere", "--radius-mm", "12.7", "--json"],
    ]
    .concat());
    assert_eq!(error.exits(2).json()["error"]["code"], "angle_unit");
}

#[test]
fn a_plan_says_what_its_poses_leave_open() {
    let folder = Folder::new();
    let machine = folder.file("machine.toml", machine(TRUTH));
    let out = folder.path("poses.csv");
    let plan = |more: &[&str]| {
        let args = [
            "scan",
            "calibrate",
            "plan",
            "--machine",
            &machine,
            "-o",
            &out,
            "--json",
        ];
        umi(&[&args[..], &["--at", "40,25,30"], more].concat())
    };
    let error = plan(&["--radius-mm", "12.7"]).exits(2).json();
    assert_eq!(
        (&error["error"]["code"], &error["error"]["free"]),
        (&"unidentifiable".into(), &3.into())
    );
    let error = plan(&["--radius-mm", "12.7", "--swing", "B=0..10"])
        .exits(2)
        .json();
    assert_eq!(error["error"]["code"], "missing_axis");
    plan(&["--radius-mm", "12.7", "--swing", "A"]).exits(1);
    plan(&[]).exits(1);
    let swings = ["--swing", "A=-25..25", "--swing", "C=-180..180"];
    let error = plan(&[&["--on", "plane"], &swings[..]].concat())
        .exits(2)
        .json();
    assert_eq!(error["error"]["free"], 1, "{error}");
    plan(&[&["--on", "plane", "--normal", "0.3,-0.2,1"], &swings[..]].concat()).exits(0);
    assert!(std::path::Path::new(&out).exists());
}

/// A machine file whose zero of A is wrong by 0.05 degrees: refused, with what to add to which axis; with --allow-misfit
/// told, and the machine file has the covariance of the poses.
#[test]
fn a_zero_of_an_axis_that_is_wrong_is_refused_by_its_name() {
    let folder = Folder::new();
    let truth = AxisChain::parse(&machine(TRUTH)).unwrap();
    let right = folder.file("right.toml", machine(TRUTH));
    let poses = folder.path("poses.csv");
    let plan = [
        "scan",
        "calibrate",
        "plan",
        "--machine",
        &right,
        "-o",
        &poses,
        "--at",
        "40,25,30",
        "--radius-mm",
        "12.7",
        "--swing",
        "A=-15..15",
        "--swing",
        "C=-30..30",
        "--json",
    ];
    umi(&plan).exits(0);
    let (profiles, latches) = scan(&truth, &std::fs::read_to_string(&poses).unwrap());
    let (profiles, latches) = (
        folder.file("profiles.csv", profiles),
        folder.file("latches.csv", latches),
    );
    // 500 counts of 10000 a degree.
    let (mut before, mut after) = (String::new(), String::new());
    let text = machine(TRUTH);
    let (head, tail) = text.split_once("name = \"A\"").unwrap();
    before += head;
    after += tail;
    assert!(after.contains("origin_counts = 0"), "{after}");
    let wrong = format!(
        "{before}name = \"A\"{}",
        after.replacen("origin_counts = 0", "origin_counts = 500", 1)
    );
    let wrong = folder.file("wrong.toml", wrong);
    let (seen, at) = (folder.path("seen.csv"), folder.path("at.csv"));
    let calibrate = |machine: &str, more: &[&str]| {
        let ball = [
            "--on",
            "sphere",
            "--radius-mm",
            "12.7",
            "--json",
            "--machine",
            machine,
        ];
        let args = [
            "scan",
            "calibrate",
            "observe",
            &profiles,
            &latches,
            "-o",
            &seen,
        ];
        umi(&[&args[..], &["--positions", &at, "--force"], &ball].concat()).exits(0);
        let args = ["scan", "calibrate", "sensor", &seen, &at];
        umi(&[&args[..], &ball, more].concat())
    };
    let clean = calibrate(&right, &[]).exits(0).json();
    assert_eq!(clean.get("warnings"), None, "{clean}");
    assert!(clean["misfit"]["p"].as_f64().unwrap() > 1e-3, "{clean}");
    let error = calibrate(&wrong, &[]).exits(2).json();
    assert_eq!(error["error"]["code"], "misfit", "{error}");
    let slip = &error["error"]["misfit"]["slip"];
    assert_eq!(slip["what"], "the zero of A", "{error}");
    let add = slip["add"].as_f64().unwrap();
    assert!((add - 0.05).abs() < 0.003, "{error}");
    let out = folder.path("found.toml");
    let told = calibrate(&wrong, &["--allow-misfit", "-o", &out])
        .exits(0)
        .json();
    let warning = told["warnings"][0].as_str().unwrap();
    assert!(
        warning.starts_with("misfit: ") && warning.contains("the zero of A"),
        "{warning}"
    );
    let found = AxisChain::parse(&std::fs::read_to_string(&out).unwrap()).unwrap();
    let in_file = found.sensor_covariance.unwrap();
    for i in 0..6 {
        let by_poses = told["covariance_poses"][i][i].as_f64().unwrap();
        assert!((in_file[i][i] / by_poses - 1.0).abs() < 1e-12, "{told}");
    }
}

/// Positions over the ball at angles of C, with the axes of the machine as they are; between two angles some profiles
/// while C turns. A stands at an angle.
fn stands(truth: &AxisChain, a: f64, angles: &[f64]) -> String {
    let mut text = String::from("profile,X,Y,Z,A,C\n");
    let mut number = 0;
    let mut put = |c: f64, across: f64| {
        let flange = truth.flange_in_workpiece(&[0.0, 0.0, 0.0, a, c]);
        // The ball's middle at this place of the sensor.
        let sees = truth.sensor.point(&[0.0, across, 0.0].into());
        let t = flange.undo(&BALL_MM.into()) - sees;
        let round = |mm: f64| (mm * 1e3).round() / 1e3;
        let [x, y, z] = [t.x, t.y, t.z].map(round);
        writeln!(text, "{number},{x},{y},{z},{a},{c}").unwrap();
        number += 1;
    };
    for (k, c) in angles.iter().enumerate() {
        for step in -5..=5 {
            put(*c, 1.5 * f64::from(step));
        }
        let next = angles.get(k + 1).copied().unwrap_or(*c + 30.0);
        for share in [0.25, 0.5, 0.75] {
            put(c + share * (next - c), 0.0);
        }
    }
    text
}

/// A scan of a ball that turns with C, at eight angles and while it turns, becomes the line of C where it truly lies:
/// 0.1 mm and 0.02 degrees beside the machine file. A stands tilted, which the machine file's A takes back.
#[test]
fn a_ball_scanned_at_angles_of_an_axis_becomes_its_line() {
    let folder = Folder::new();
    let file = machine(TRUTH);
    let axis = "direction = [0, 0, 1]      # the axis";
    let (at, lies) = file.rsplit_once(axis).unwrap();
    let moved = lies.replacen("point_mm = [0, 0, 0]", "point_mm = [0.1, -0.06, 0]", 1);
    let truly = format!("{at}direction = [0.0003, -0.0002, 1] # {moved}");
    let truth = AxisChain::parse(&truly).unwrap();
    let file = folder.file("m.toml", &file);
    let angles: Vec<f64> = (0..8).map(|k| 45.0 * f64::from(k)).collect();
    let centres = folder.path("centres.csv");
    let found = |a: f64, radius_mm: f64, more: &[&str]| {
        let (profiles, latches) = scan_of(&truth, &stands(&truth, a, &angles), radius_mm);
        let profiles = folder.file("profiles.csv", profiles);
        let latches = folder.file("latches.csv", latches);
        let args = [
            "scan",
            "calibrate",
            "centres",
            &profiles,
            &latches,
            "--machine",
            &file,
        ];
        let rest = ["--radius-mm", "12.7", "-o", &centres, "--force", "--json"];
        umi(&[&args[..], &rest, more].concat())
    };
    for a in [0.0, 12.0] {
        let seen = found(a, RADIUS_MM, &["--axis", "C"]).exits(0).json();
        let all = seen["centres"].as_array().unwrap();
        assert_eq!(all.len(), angles.len(), "{seen}");
        for (centre, angle) in all.iter().zip(&angles) {
            assert!(
                (centre["angle_deg"].as_f64().unwrap() - angle).abs() < 1e-4,
                "{centre}"
            );
            assert!(centre["rms_mm"].as_f64().unwrap() < 0.01, "{centre}");
            assert_eq!(centre["profiles"], 11, "{centre}");
        }
        // What was seen while C turned is counted, and in no centre.
        assert_eq!(seen["too_narrow"], 3 * angles.len(), "{seen}");
        assert!(seen["warnings"].is_null(), "{seen}");
        let line = umi(&["scan", "calibrate", "axis", &centres, "--json"])
            .exits(0)
            .json();
        let (direction, point) = (numbers(&line["direction"]), numbers(&line["point_mm"]));
        let joint = truth.joints.iter().find(|joint| joint.name == "C").unwrap();
        let turned = joint.direction.iter().zip(&direction);
        assert!(
            turned.clone().all(|(t, f)| (t - f).abs() < 1e-4),
            "A {a}: {line}"
        );
        // How far the true line's point lies from the found line.
        let arm: Vec<f64> = (point.iter().zip(joint.point_mm.iter()))
            .map(|(found, truly)| found - truly)
            .collect();
        let along: f64 = arm
            .iter()
            .zip(joint.direction.iter())
            .map(|(a, d)| a * d)
            .sum();
        for (arm, d) in arm.iter().zip(joint.direction.iter()) {
            let beside = arm - along * d;
            assert!(beside.abs() < 0.003, "A {a}: {beside} {line}");
        }
        assert!(line["sigma_mm"].as_f64().unwrap() < 0.005, "{line}");
    }
    // A ball of another radius is told, and not believed without a word.
    let seen = found(0.0, RADIUS_MM + 0.02, &["--axis", "C"])
        .exits(0)
        .json();
    assert!(seen["warnings"].to_string().contains("12.72"), "{seen}");
    // A is turned by nothing here, but carries C, which was: the ball moved on the part.
    let refusals = [("A", "moved"), ("X", "missing_axis"), ("B", "missing_axis")];
    for (axis, code) in refusals {
        let error = found(0.0, RADIUS_MM, &["--axis", axis]).exits(2).json();
        assert_eq!(error["error"]["code"], code, "{error}");
    }
    std::fs::remove_file(&centres).unwrap();
    let error = found(0.0, RADIUS_MM, &["--axis", "C", "--within-mm", "0.0000001"])
        .exits(2)
        .json();
    assert_eq!(error["error"]["code"], "too_few_points", "{error}");
    assert!(!std::path::Path::new(&centres).exists());
}
