//! `umi scan filter`, `crop`, `sample` and `convert`: what stays, what goes and why, and what is refused.

use std::fmt::Write as _;

use serde_json::{Value, json};

use crate::rig::run::{Folder, umi};

/// Two profiles of a plane, a spike among them, and a point that is none.
fn cloud(folder: &Folder) -> String {
    let mut text = String::from("profile,index,x_mm,y_mm,z_mm,intensity\n");
    for profile in 0..2 {
        for index in 0..10 {
            let z = if (profile, index) == (1, 4) {
                7.5
            } else {
                0.25
            };
            writeln!(
                text,
                "{profile},{index},{index}.5,{profile},{z},{}",
                10 * index
            )
            .unwrap();
        }
    }
    text += "2,0,nan,0,0,5\n";
    folder.file("cloud.csv", &text)
}

fn done(args: &[&str]) -> Value {
    let args: Vec<&str> = [&["scan"][..], args, &["--json"]].concat();
    umi(&args).exits(0).json()
}

#[test]
fn every_point_is_kept_or_counted() {
    let folder = Folder::new();
    let cloud = cloud(&folder);
    let (out, gone) = (folder.path("out.csv"), folder.path("gone.csv"));
    let found = done(&[
        "filter",
        &cloud,
        "--spike",
        "3",
        "--beam",
        "0,0,-1",
        "--intensity",
        "0,80",
        "--dropped",
        &gone,
        "-o",
        &out,
    ]);
    assert_eq!(
        found,
        json!({"kind": "filter", "points": 21, "kept": 17, "not_finite": 1,
            "dropped": [{"reason": "bright", "points": 2}, {"reason": "spike", "points": 1}]})
    );
    let text = std::fs::read_to_string(&out).unwrap();
    assert_eq!(text.lines().count(), 18);
    assert!(text.starts_with("profile,index,x_mm,y_mm,z_mm,intensity\n0,0,0.5,0,0.25,0\n"));
    let text = std::fs::read_to_string(&gone).unwrap();
    assert!(text.contains("\n1,4,4.5,1,7.5,"), "{text}");
    assert_eq!(text.lines().count(), 4);

    let out = folder.path("crop.ply");
    let found = done(&[
        "crop",
        &cloud,
        "--box",
        "9,1,9,2,-1,-9",
        "--profiles",
        "1-1",
        "-o",
        &out,
    ]);
    assert_eq!(found["kept"], 7);
    assert_eq!(
        found["dropped"],
        json!([{"reason": "outside_box", "points": 6}, {"reason": "other_profile", "points": 7}])
    );

    let out = folder.path("sample.csv");
    let found = done(&["sample", &cloud, "--voxel", "5", "-o", &out]);
    assert_eq!(
        (&found["kept"], &found["dropped"][0]["reason"]),
        (&json!(3), &json!("merged"))
    );
    let found = done(&[
        "sample",
        &cloud,
        "--every",
        "4",
        "-o",
        &folder.path("every.pcd"),
    ]);
    assert_eq!(found["kept"], 5);
}

/// A file without points would be taken for a part that is not there.
#[test]
fn what_leaves_no_point_is_refused_and_leaves_no_file() {
    let folder = Folder::new();
    let cloud = folder.file(
        "three.csv",
        "profile,index,x_mm,y_mm,z_mm\n4,0,0,0,0\n4,1,1,0,0\n5,0,0,1,0\n",
    );
    let empty = folder.file("empty.csv", "x_mm,y_mm,z_mm\n");
    let (out, rest) = (folder.path("out.csv"), folder.path("rest.csv"));
    for (args, said) in [
        (
            &["crop", &cloud, "--box", "5,5,5,9,9,9", "--dropped", &rest][..],
            "3 ",
        ),
        (&["crop", &cloud, "--profiles", "100-250"], "3 "),
        (&["filter", &cloud, "--isolated", "0.1,1"], "3 isolated"),
        (&["sample", &empty, "--every", "2"], "has no points"),
        (&["convert", &empty], "has no points"),
    ] {
        let args = [&["scan"], args, &["-o", &out, "--json"]].concat();
        let error = umi(&args).exits(2).json()["error"].clone();
        assert_eq!(error["code"], "nothing_left", "{args:?}: {error}");
        assert!(error["message"].as_str().unwrap().contains(said), "{error}");
        for path in [&out, &rest] {
            assert!(!std::path::Path::new(path).exists(), "{args:?} left {path}");
        }
    }
    let args = ["crop", &cloud, "--profiles", "5-250", "-o", &out];
    assert_eq!(done(&args)["kept"], 1);
}

#[test]
fn a_cloud_goes_into_every_format_and_stays_the_same() {
    let folder = Folder::new();
    let cloud = cloud(&folder);
    for extension in ["ply", "pcd", "las", "laz", "e57", "parquet", "csv"] {
        let out = folder.path(&format!("out.{extension}"));
        let found = done(&["convert", &cloud, "-o", &out, "--double"]);
        assert_eq!(
            (&found["kept"], &found["not_finite"]),
            (&json!(20), &json!(1)),
            "{extension}"
        );
        let warned = found["warnings"].to_string().contains("millimetres");
        assert_eq!(warned, extension.starts_with("la"), "{extension}: {found}");
        assert!(std::fs::metadata(&out).unwrap().len() > 200);
    }
    let back = folder.path("back.csv");
    done(&["convert", &folder.path("out.ply"), "-o", &back]);
    assert_eq!(
        std::fs::read_to_string(&back).unwrap(),
        std::fs::read_to_string(folder.path("out.csv")).unwrap()
    );
    // What is there stays there without --force; what is read is never written.
    let args = ["scan", "convert", &cloud, "-o", &back];
    assert_eq!(
        umi(&[&args[..], &["--json"]].concat()).exits(1).json()["error"]["code"],
        "file"
    );
    umi(&[&args[..], &["--force"]].concat()).exits(0);
    umi(&["scan", "convert", &cloud, "-o", &cloud, "--force"]).exits(1);
}

/// A coarse grid has its pitch for no height, with the beam known or not; where it is not that is said. Standard error, which
/// is no terminal here, gets no line of progress.
#[test]
fn the_pitch_of_a_grid_is_no_spike_and_hides_none() {
    let folder = Folder::new();
    let mut text = String::from("profile,index,x_mm,y_mm,z_mm\n");
    for profile in 0..20 {
        for index in 0..60 {
            let z = if (profile, index) == (7, 30) {
                8.0
            } else {
                0.0
            };
            writeln!(text, "{profile},{index},{index},{profile},{z}").unwrap();
        }
    }
    let grid = folder.file("grid.csv", &text);
    let out = folder.path("out.csv");
    let filter = |more: &[&str]| {
        let args = ["scan", "filter", &grid, "-o", &out, "--force"];
        umi(&[&args[..], more].concat()).exits(0)
    };
    for beam in [&[][..], &["--beam", "0,0,-1"]] {
        for (how, gone) in [(["--spike", "0.5"], 1), (["--mixed", "0.3,2"], 0)] {
            let found = filter(&[&how[..], beam, &["--json"]].concat()).json();
            assert_eq!(found["kept"], 1200 - gone, "{found}");
            let notes = found["warnings"].to_string();
            assert_eq!(notes.contains("no_beam"), beam.is_empty(), "{found}");
        }
    }
    let told = filter(&["--spike", "0.5"]);
    assert!(
        told.out.contains("1 spike") && told.out.contains("note: no_beam"),
        "{}",
        told.out
    );
    assert!(told.err.is_empty(), "{}", told.err);
}

/// On a terminal the work says how far it is, and with --json not. `script` makes the terminal; without it nothing is asked.
#[cfg(target_os = "linux")]
#[test]
fn long_work_says_how_far_it_is_on_a_terminal_only() {
    let folder = Folder::new();
    let cloud = cloud(&folder);
    let out = folder.path("out.csv");
    let shown = |more: &str| {
        let command = format!(
            "{} scan convert {cloud} -o {out} --force {more}",
            env!("CARGO_BIN_EXE_umi")
        );
        let ran = std::process::Command::new("script")
            .args(["-qec", &command, "/dev/null"])
            .env("TERM", "xterm")
            .stdin(std::process::Stdio::null())
            .output();
        ran.ok()
            .map(|ran| String::from_utf8_lossy(&ran.stdout).into_owned())
    };
    let Some(text) = shown("") else {
        return;
    };
    assert!(
        text.contains("points read") && text.contains("20 of 21 points"),
        "{text}"
    );
    let text = shown("--json").unwrap();
    assert!(
        text.starts_with('{') && !text.contains("points read"),
        "{text}"
    );
}

#[test]
fn what_cannot_be_done_is_named_and_writes_nothing() {
    let folder = Folder::new();
    let cloud = cloud(&folder);
    let bare = folder.file("bare.csv", "x,y,z\n1,2,3\n");
    let cut = folder.file(
        "cut.ply",
        "ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n",
    );
    let out = folder.path("out.ply");
    for (args, status, code) in [
        (&["filter", &cloud][..], 2, "no_filter"),
        (&["filter", &bare, "--spike", "1"], 2, "no_profiles"),
        (&["filter", &bare, "--intensity", "0,1"], 2, "no_intensity"),
        (
            &["filter", &cloud, "--statistical", "50,3"],
            2,
            "too_few_points",
        ),
        (&["crop", &cloud], 2, "no_region"),
        (&["crop", &bare, "--profiles", "0-1"], 2, "no_profiles"),
        (&["convert", &cut], 1, "bad_file"),
        (
            &["sample", &folder.path("none.csv"), "--every", "2"],
            1,
            "file",
        ),
    ] {
        let args: Vec<&str> = [&["scan"][..], args, &["-o", &out, "--json"]].concat();
        assert_eq!(
            umi(&args).exits(status).json()["error"]["code"],
            code,
            "{args:?}"
        );
        assert!(!std::path::Path::new(&out).exists());
    }
    let odd = folder.path("out.xyz");
    let args = ["scan", "convert", &cloud, "-o", &odd, "--json"];
    assert_eq!(umi(&args).exits(1).json()["error"]["code"], "format");
    for args in [
        ["sample", &cloud, "--every", "0"],
        ["sample", &cloud, "--voxel", "-1"],
        ["crop", &cloud, "--ball", "0,0,0,-2"],
        ["crop", &cloud, "--side", "0,0,0,0,0,0"],
        ["filter", &cloud, "--isolated", "1,0.5"],
    ] {
        umi(&[&["scan"][..], &args[..], &["-o", &out]].concat()).exits(1);
    }
}

#[test]
fn a_preset_of_a_machine_is_one_and_is_shown() {
    let folder = Folder::new();
    let path = folder.path("machine.toml");
    for (preset, joints) in [
        ("mill", 3),
        ("c800u", 5),
        ("fork-head", 5),
        ("bridge-cmm", 5),
    ] {
        umi(&["scan", "machine", "new", preset, "-o", &path, "--force"]).exits(0);
        let found = done(&["machine", "check", &path]);
        assert_eq!(found["joints"].as_array().unwrap().len(), joints);
        assert_eq!(found["warnings"].as_array().unwrap().len(), 1);
        let shown = umi(&["scan", "machine", "check", &path]).exits(0).out;
        assert!(shown.starts_with("base\n├─ X"), "{shown}");
    }
    umi(&["scan", "machine", "new", "mill", "-o", &path]).exits(1);
    let text = std::fs::read_to_string(&path).unwrap();
    let wrong = folder.file("wrong.toml", text.replace("\"Z\", \"B\"", "\"Q\", \"B\""));
    let args = ["scan", "machine", "check", &wrong, "--json"];
    assert_eq!(umi(&args).exits(2).json()["error"]["code"], "machine");
}

/// An interrupt leaves no part of a cloud, and what a killed run left does not stand in the next one's way.
#[cfg(unix)]
#[test]
fn a_run_that_is_ended_leaves_nothing_behind() {
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};
    let folder = Folder::new();
    let mut text = String::from("profile,index,x_mm,y_mm,z_mm\n");
    for i in 0..600_000 {
        writeln!(
            text,
            "{},{},{}.25,{}.5,0.125",
            i / 1000,
            i % 1000,
            i % 1000,
            i / 1000
        )
        .unwrap();
    }
    let cloud = folder.file("large.csv", &text);
    let out = folder.path("out.ply");
    let part = format!("{out}.part");
    // Who runs the tests under nohup has them ignore the hang-up, as all that they start.
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    let ignores_hang_up = ignored.is_some_and(|mask| mask & 1 != 0);
    let umi = ["env", env!("CARGO_BIN_EXE_umi")];
    let no_hang_up = ["nohup", env!("CARGO_BIN_EXE_umi")];
    for (umi, signal) in [
        (umi, "-TERM"),
        (umi, "-INT"),
        (umi, "-HUP"),
        (no_hang_up, "-TERM"),
        (umi, "-KILL"),
    ] {
        if signal == "-HUP" && ignores_hang_up {
            continue;
        }
        let mut child = Command::new(umi[0])
            .args([umi[1], "scan", "convert", &cloud, "-o", &out])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let begun = Instant::now();
        while !std::fs::exists(&part).unwrap() {
            assert!(
                begun.elapsed() < Duration::from_secs(60),
                "{signal}: no part"
            );
            std::thread::sleep(Duration::from_millis(2));
        }
        let id = child.id().to_string();
        assert!(
            Command::new("kill")
                .args([signal, &id])
                .status()
                .unwrap()
                .success()
        );
        let status = child.wait().unwrap();
        assert!(
            !status.success() && !std::fs::exists(&out).unwrap(),
            "{signal}: {status}"
        );
        let is_killed = signal == "-KILL";
        assert_eq!(std::fs::exists(&part).unwrap(), is_killed, "{signal}");
    }
    let small = self::cloud(&folder);
    let found = done(&["convert", &small, "-o", &out]);
    assert_eq!(found["kept"], 20, "{found}");
    assert!(std::fs::exists(&out).unwrap() && !std::fs::exists(&part).unwrap());
}

/// `umi fit` takes the clouds that the scan commands write, by their ending, and comes to the same geometry as from the
/// table; what is no list of points is refused with the endings that are.
#[test]
fn a_geometry_is_fitted_to_every_format_of_cloud() {
    let folder = Folder::new();
    let mut text = String::from("x_mm,y_mm,z_mm\n");
    for k in 0..200 {
        let (turn, up) = (0.7 * f64::from(k), f64::from(k) / 200.0);
        let across = (1.0 - up * up).sqrt() * 12.7;
        let (x, y) = (100.0 + across * turn.cos(), 20.0 + across * turn.sin());
        writeln!(text, "{x},{y},{}", 12.7 * up - 30.0).unwrap();
    }
    let table = folder.file("ball.csv", &text);
    let fitted = |path: &str| umi(&["fit", "sphere", path, "--json"]).exits(0).json();
    let wanted = fitted(&folder.file("names.csv", text.replace("_mm", "")));
    assert!(
        (wanted["radius_mm"].as_f64().unwrap() - 12.7).abs() < 1e-9,
        "{wanted}"
    );
    for extension in ["ply", "pcd", "las", "laz", "e57"] {
        let cloud = folder.path(&format!("a.{extension}"));
        done(&["convert", &table, "-o", &cloud, "--double"]);
        let found = fitted(&cloud);
        assert_eq!(
            (&found["n"], &found["not_finite"]),
            (&json!(200), &json!(0))
        );
        // LAS has steps of 0.1 µm.
        let within = if extension.starts_with("la") {
            1e-4
        } else {
            1e-9
        };
        let off = found["radius_mm"].as_f64().unwrap() - 12.7;
        assert!(off.abs() < within, "{extension}: {found}");
        for k in 0..3 {
            let of = |value: &Value| value["center_mm"][k].as_f64().unwrap();
            assert!(
                (of(&found) - of(&wanted)).abs() < within,
                "{extension}: {found}"
            );
        }
    }
    // A point that is none is counted, and said.
    let holed = "ply\nformat ascii 1.0\nelement vertex 6\nproperty double x\nproperty double y\nproperty double z\n\
                 end_header\n0 0 1\n1 0 0\n-1 0 0\n0 1 0\nnan 0 0\n0 -1 0\n";
    let holed = folder.file("holed.ply", holed);
    assert_eq!(fitted(&holed)["not_finite"], 1);
    let said = umi(&["fit", "sphere", &holed]).exits(0).out;
    assert!(said.contains("1 point without numbers left out"), "{said}");
    for name in ["a.parquet", "a.stl"] {
        let path = folder.file(name, "PAR1");
        let error = umi(&["fit", "sphere", &path, "--json"]).exits(1).json();
        assert_eq!(error["error"]["code"], "format", "{error}");
        assert!(
            error.to_string().contains(".ply, .pcd, .las, .laz, .e57"),
            "{error}"
        );
    }
    let cut = folder.file(
        "cut.ply",
        "ply\nformat binary_little_endian 1.0\nelement vertex 9\n",
    );
    umi(&["fit", "sphere", &cut, "--json"]).exits(1);
}
