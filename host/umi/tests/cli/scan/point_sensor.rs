//! A point sensor through the tool: every reference case, and its points.

use serde_json::Value;

use crate::rig::run::{Folder, Ran, project, umi};

fn reference(name: &str) -> String {
    project(&format!("tests/reference/point/{name}"))
}

fn read(name: &str) -> Value {
    let path = reference(name);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(values) => values.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().unwrap()],
    }
}

fn close(id: &str, got: &Value, wanted: &Value, tol: f64) {
    let (got, wanted) = (numbers(got), numbers(wanted));
    assert_eq!(got.len(), wanted.len(), "{id}");
    for (got, wanted) in got.iter().zip(wanted) {
        assert!((got - wanted).abs() <= tol, "{id}: {got} {wanted}");
    }
}

#[test]
fn reference_cases_hold() {
    let index = read("index.json");
    for id in index["cases"].as_array().unwrap() {
        let id = id.as_str().unwrap();
        let case = read(&format!("{id}.json"));
        let readings = reference(case["readings_csv"].as_str().unwrap());
        let spheres = reference(case["spheres"].as_str().unwrap());
        let mut args = vec![
            "scan",
            "calibrate",
            "point",
            &readings,
            "--spheres",
            &spheres,
        ];
        for free in case["free"].as_array().unwrap() {
            args.extend(["--free", free.as_str().unwrap()]);
        }
        args.push("--json");
        if case["expect"] == "error" {
            let said = umi(&args).exits(2).json();
            let names = case["error_any_of"].as_array().unwrap();
            assert!(names.contains(&said["error"]["code"]), "{id} {said}");
            continue;
        }
        let said = umi(&args).exits(0).json();
        let (result, tol) = (&case["result"], &case["tol"]);
        for (ours, theirs) in [
            ("offset_mm", "offset"),
            ("direction", "direction"),
            ("residuals_mm", "residuals"),
            ("rms_mm", "rms"),
        ] {
            close(
                id,
                &said[ours],
                &result[theirs],
                tol[theirs].as_f64().unwrap(),
            );
        }
        assert_eq!(said["kind"], "point_sensor");
        assert_eq!(said["used"], result["used"]);
        assert_eq!(said["dof"], result["dof"]);
        assert_eq!(
            said["sigma_mm"].is_null(),
            result["sigma"].is_null(),
            "{id}"
        );
        assert_eq!(
            said["covariance"].is_null(),
            result["sigma"].is_null(),
            "{id}"
        );
    }
}

/// Readings and balls of a case.
fn files(case: &str) -> [String; 2] {
    [".csv", ".spheres.toml"].map(|end| reference(&format!("{case}{end}")))
}

fn calibrate(case: &str, options: &[&str]) -> Ran {
    let [readings, spheres] = files(case);
    let command = [
        "scan",
        "calibrate",
        "point",
        &readings,
        "--spheres",
        &spheres,
    ];
    umi(&[&command[..], options].concat())
}

#[test]
fn a_calibration_makes_points() {
    let folder = Folder::new();
    let [readings, spheres] = files("rings_13_exact");
    let said = calibrate("rings_13_exact", &["--json"]).exits(0);
    let sensor = folder.file("sensor.json", said.out.as_bytes());
    let cloud = folder.path("cloud.csv");
    let points = [
        "scan",
        "points",
        &readings,
        "--calibration",
        &sensor,
        "-o",
        &cloud,
    ];
    let said = umi(&[&points[..], &["--json"]].concat()).exits(0).json();
    assert_eq!(said["points"], 13);
    let text = std::fs::read_to_string(&cloud).unwrap();
    assert_eq!(text.lines().next(), Some("x_mm,y_mm,z_mm"));
    assert_eq!(text.lines().count(), 14);
    // A reading that this lens does not have, as one whose sign is exchanged, is no point.
    let text = std::fs::read_to_string(&readings).unwrap();
    let last = text.trim_end().rsplit(',').next().unwrap();
    let wrong = format!("{}-{last}\n", text.trim_end().strip_suffix(last).unwrap());
    let wrong = folder.file("wrong.csv", wrong);
    let from = [
        "scan",
        "points",
        &wrong,
        "--calibration",
        &sensor,
        "-o",
        &cloud,
    ];
    let told = umi(&[&from[..], &["--force", "--json"]].concat()).exits(2);
    assert_eq!(told.json()["error"]["code"], "other_lens");
    // In words, too.
    let said = calibrate("rings_13_exact", &[]).exits(0).out;
    assert!(said.contains("13 of 13 readings used"));
    umi(&[
        "scan",
        "points",
        &readings,
        "--calibration",
        &spheres,
        "--force",
        "-o",
        &cloud,
    ])
    .exits(2)
    .says("no JSON");
    umi(&[
        "scan",
        "points",
        "nothing.csv",
        "--calibration",
        &sensor,
        "-o",
        &cloud,
    ])
    .exits(1);
}

/// A PLY has the uncertainties that a CSV has; a file that is called otherwise is not written as either.
#[test]
fn points_are_written_by_the_ending() {
    let folder = Folder::new();
    let [readings, _] = files("center_uncertain_1um");
    let said = calibrate("center_uncertain_1um", &["--json"]).exits(0);
    let sensor = folder.file("sensor.json", said.out.as_bytes());
    let write = |cloud: &str| {
        let points = [
            "scan",
            "points",
            &readings,
            "--calibration",
            &sensor,
            "-o",
            cloud,
        ];
        umi(&[&points[..], &["--json"]].concat())
    };
    let [csv, ply, las] = ["cloud.csv", "cloud.ply", "cloud.las"].map(|name| folder.path(name));
    for cloud in [&csv, &ply] {
        assert_eq!(write(cloud).exits(0).json()["uncertainty"], true);
    }
    let text = std::fs::read_to_string(&csv).unwrap();
    let bytes = std::fs::read(&ply).unwrap();
    let header = String::from_utf8_lossy(&bytes);
    assert!(
        header.contains("property double u_x_mm\nproperty double u_y_mm\nproperty double u_z_mm")
    );
    let rows: Vec<f64> = text
        .lines()
        .skip(1)
        .flat_map(|line| line.split(','))
        .map(|cell| cell.parse().unwrap())
        .collect();
    let body = &bytes[bytes.len() - rows.len() * 8..];
    let doubles: Vec<f64> = body
        .chunks_exact(8)
        .map(|eight| f64::from_le_bytes(eight.try_into().unwrap()))
        .collect();
    assert_eq!(doubles, rows);
    assert_eq!(write(&las).exits(1).json()["error"]["code"], "format");
    assert!(!std::path::Path::new(&las).exists());
}

/// A quality that is no number would leave nothing out; another unit is told as what it is.
#[test]
fn what_is_no_limit_is_refused() {
    let [readings, spheres] = files("rings_13_exact");
    calibrate("rings_13_exact", &["--min-snr", "nan"])
        .exits(1)
        .says("finite");
    let folder = Folder::new();
    let text = std::fs::read_to_string(&readings).unwrap();
    let mut in_um = String::from("x,y,z,gamma\n");
    for line in text.lines().skip(1) {
        let (axes, gamma) = line.rsplit_once(',').unwrap();
        let gamma: f64 = gamma.parse().unwrap();
        in_um += &format!("{axes},{}\n", gamma * 1e3);
    }
    let in_um = folder.file("um.csv", in_um.as_bytes());
    let said = umi(&[
        "scan",
        "calibrate",
        "point",
        &in_um,
        "--spheres",
        &spheres,
        "--json",
    ]);
    let error = said.exits(2).json()["error"].clone();
    assert_eq!(error["code"], "residual_too_large", "{error}");
}

/// Each control's program is read by that control.
#[test]
fn a_plan_is_written_with_what_to_expect() {
    let folder = Folder::new();
    let program = folder.path("plan.nc");
    let args = [
        "scan",
        "calibrate",
        "plan",
        "--point-sensor",
        "--ball",
        "200,-100,-600",
        "--radius-mm",
        "10",
        "--offset",
        "3,-54,-138",
        "--safe-z",
        "-300",
        "-o",
        &program,
        "--json",
    ];
    let said = umi(&args).exits(0).json();
    assert_eq!(said["places"].as_array().unwrap().len(), 25);
    for (control, says) in [
        ("fanuc", "DPRNT["),
        ("haas", "DPRNT["),
        ("mitsubishi", "DPRNT["),
        ("linuxcnc", "(LOG,%"),
        ("grbl", "M0\n"),
    ] {
        let more = ["--control", control, "--force"];
        umi(&[&args[..], &more].concat()).exits(0);
        let text = std::fs::read_to_string(&program).unwrap();
        assert_eq!(text.matches(says).count(), 25, "{control}");
        umi(&["machine", "check", "--control", control, &program]).exits(0);
    }
}
