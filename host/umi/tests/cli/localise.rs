//! `umi scan localise` against the reference cases, and what it says of files that are wrong.

use serde_json::Value;

use crate::run::{Folder, Ran, command, project};

/// Runs a command in the folder of the cases, with `--json`.
fn run(args: &[&str]) -> Ran {
    let args: Vec<&str> = args.iter().copied().chain(["--json"]).collect();
    let output = command(&args)
        .current_dir(project("tests/reference/scan/localise"))
        .output()
        .unwrap();
    Ran {
        status: output.status.code().unwrap(),
        out: String::from_utf8(output.stdout).unwrap(),
        err: String::from_utf8(output.stderr).unwrap(),
    }
}

fn case(id: &str) -> Value {
    let path = project(&format!("tests/reference/scan/localise/{id}.json"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn three(value: &Value) -> [f64; 3] {
    std::array::from_fn(|i| value[i].as_f64().unwrap())
}

/// Where a pose puts a point.
fn image(pose: &Value, p: &Value) -> [f64; 3] {
    let (t, p) = (three(&pose["translation_mm"]), three(p));
    std::array::from_fn(|i| {
        let row = three(&pose["rotation"][i]);
        row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + t[i]
    })
}

/// The command's answer to a case, judged by its pose.
fn answered(id: &str) -> (Value, Value) {
    let case = case(id);
    let args: Vec<&str> = case["args"]
        .as_array()
        .unwrap()
        .iter()
        .map(|arg| arg.as_str().unwrap())
        .collect();
    let got = run(&args).exits(0).json();
    assert_eq!(got["verdict"], "OK", "{id}");
    let tolerance = case["tol_mm"].as_f64().unwrap();
    for p in case["probes"].as_array().unwrap() {
        let (a, b) = (image(&got, p), image(&case["pose"], p));
        let off = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
        assert!(
            off <= tolerance,
            "{id}: {off:e} mm off, {tolerance:e} allowed"
        );
    }
    (case, got)
}

#[test]
fn a_stated_problem_is_answered_with_its_optimum() {
    for id in ["optimum_balls", "optimum_bracket"] {
        let (case, got) = answered(id);
        let off = got["rms_mm"].as_f64().unwrap() - case["rms_mm"].as_f64().unwrap();
        assert!(
            off.abs() <= case["tol_rms_mm"].as_f64().unwrap(),
            "{id}: {off:e}"
        );
        assert_eq!(got["n_used"], got["n"], "{id}");
    }
}

/// Two corners, an inner one among them of which the scanner does not see one side.
#[test]
fn a_corner_of_which_one_side_is_hidden_is_found() {
    let (_, got) = answered("fiducials_corners");
    for fiducial in got["fiducials"].as_array().unwrap() {
        assert_eq!(fiducial["found"], true, "{fiducial}");
    }
}

/// The part had been turned by a right angle about the machine's X between the two scans: both say where it is.
#[test]
fn scans_of_a_part_that_was_turned_are_carried_back() {
    let folder = Folder::new();
    let here = project("tests/reference/scan/localise");
    let list = folder.file(
        "scans.toml",
        format!(
            "[[scan]]\nfile = \"{here}/optimum_balls.ply\"\n\
             [[scan]]\nfile = \"{here}/optimum_balls.ply\"\ncarried = true\n\
             moved = {{ rotation = [[1,0,0],[0,0,-1],[0,1,0]], translation_mm = [0,0,5] }}\n"
        ),
    );
    let page = folder.path("page.html");
    let args = [
        "scan",
        "localise",
        "--scans",
        &list,
        "--fiducials",
        "optimum_balls.toml",
        "--seed",
        "3",
        "--report",
        &page,
    ];
    let got = run(&args).exits(0).json();
    let page = std::fs::read_to_string(page).unwrap();
    assert!(page.contains("S3") && page.contains("<circle"), "{page}");
    let scans = got["scans"].as_array().unwrap();
    let case = case("optimum_balls");
    for p in case["probes"].as_array().unwrap() {
        let first = image(&scans[0], p);
        let second = image(&scans[1], p);
        let carried = [first[0], -first[2], first[1] + 5.0];
        for i in 0..3 {
            assert!(
                (second[i] - carried[i]).abs() < 1e-6,
                "{second:?} {carried:?}"
            );
        }
    }
}

#[test]
fn a_file_of_fiducials_that_is_wrong_is_told_so() {
    let folder = Folder::new();
    for (text, word) in [
        ("", "fiducial"),
        (
            "[[fiducial]]\nname = \"A\"\nposition_mm = [0,0,0]\n",
            "shape",
        ),
        (
            "[[fiducial]]\nname = \"A\"\nposition_mm = [0,0,0]\nshape = { sphere = { radius_mm = -1 } }\n",
            "positive",
        ),
        (
            "[[fiducial]]\nname = \"A\"\nposition_mm = [0,0,0]\nshape = { sphere = { radius_mm = 5 } }\n\
             rotation = [[1,0,0],[0,1,0],[0,0,-1]]\n",
            "mirror",
        ),
        (
            "[[fiducial]]\nname = \"A\"\nposition_mm = [0,0,0]\nshape = { sphere = { radius_mm = 5 } }\n\
             [[fiducial]]\nname = \"A\"\nposition_mm = [9,0,0]\nshape = { sphere = { radius_mm = 5 } }\n",
            "two of this name",
        ),
    ] {
        let file = folder.file("fiducials.toml", text);
        let error = &run(&[
            "scan",
            "localise",
            "optimum_balls.ply",
            "--fiducials",
            &file,
        ])
        .exits(1)
        .json()["error"];
        assert_eq!(error["code"], "bad_file", "{error}");
        assert!(error["message"].as_str().unwrap().contains(word), "{error}");
    }
    let neither = run(&["scan", "localise", "optimum_balls.ply"]);
    assert_eq!(neither.status, 1);
}
