//! Every reference case through the tool: the answers within their stated
//! tolerance, every bad case refused with the right class and status.

use serde_json::Value;

use crate::rig::run::{Folder, Ran, project, umi};

fn read(name: &str) -> Value {
    let path = project(&format!("tests/reference/fits/{name}"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap()
}

fn cases() -> Vec<Value> {
    let index = read("index.json");
    let list = index["cases"].as_array().unwrap().clone();
    let id = |case: &Value| case["id"].as_str().unwrap().to_owned();
    list.iter()
        .map(|case| read(&format!("{}.json", id(case))))
        .collect()
}

fn text<'a>(case: &'a Value, field: &str) -> &'a str {
    case[field].as_str().unwrap()
}

/// What the tool prints for the points of a case.
fn run(case: &Value) -> Ran {
    let points = project(&format!(
        "tests/reference/fits/{}",
        text(case, "points_csv")
    ));
    match text(case, "kind") {
        "registration" => umi(&["register", &points, "--json"]),
        kind => umi(&["fit", kind, &points, "--json"]),
    }
}

/// All numbers in a value, in order.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Number(number) => vec![number.as_f64().unwrap()],
        Value::Array(list) => list.iter().flat_map(numbers).collect(),
        other => panic!("{other} is no number"),
    }
}

fn close(id: &str, field: &str, got: &Value, wanted: &Value, tolerance: f64) {
    let (got, wanted) = (numbers(got), numbers(wanted));
    assert_eq!(got.len(), wanted.len(), "{id} {field}");
    for (g, w) in got.iter().zip(&wanted) {
        let error = (g - w).abs();
        assert!(
            error <= tolerance,
            "{id} {field}: {g} not {w}, off {error:e} > {tolerance:e}"
        );
    }
}

/// The name in the tool's object for a name in the reference.
fn printed(kind: &str, name: &str) -> String {
    match (kind, name) {
        ("registration", "R") => "rotation".into(),
        ("registration", "t") => "translation_mm".into(),
        ("registration", "cov_rotvec") => "cov_rotvec_rad2".into(),
        (_, "half_angle") => "half_angle_rad".into(),
        (_, "var_half_angle") => "var_half_angle_rad2".into(),
        (
            _,
            "center" | "radius" | "point" | "offset" | "apex" | "rms" | "sigma" | "rms_plane"
            | "max_abs_residual" | "residuals",
        ) => format!("{name}_mm"),
        (_, "cov" | "cov_point" | "cov_apex" | "cov_t" | "var_radius" | "var_offset_at_point") => {
            format!("{name}_mm2")
        }
        _ => name.into(),
    }
}

/// The reference direction with the sign that the tool chose, where both are right.
fn same_sign(got: &Value, wanted: &Value) -> Value {
    let (g, w) = (numbers(got), numbers(wanted));
    let dot: f64 = g.iter().zip(&w).map(|(a, b)| a * b).sum();
    w.iter().map(|x| x * dot.signum()).collect()
}

fn compare(case: &Value, got: &Value) -> usize {
    let (id, kind) = (text(case, "id"), text(case, "kind"));
    assert_eq!(got["kind"], *kind, "{id}");
    assert_eq!(got["n"], case["n"], "{id}");
    let mut compared = 0;
    for (name, wanted) in case["result"].as_object().unwrap() {
        let field = printed(kind, name);
        let got = &got[&field];
        let tol = |name: &str| case["tol"][name].as_f64();
        match name.as_str() {
            // Steps on the way, and the same things in other words.
            "linear_fit" | "rms_total" | "radius_at_point" => continue,
            "point" if kind == "cone" => continue,
            "angle" => continue,
            "sigma" if wanted.is_null() => assert!(got.is_null(), "{id} {field}"),
            "dof" => assert_eq!(got, wanted, "{id} {field}"),
            "normal" | "direction" if kind != "cone" => {
                close(id, &field, got, &same_sign(got, wanted), tol(name).unwrap());
            }
            // A plane's offset has the sign of its normal.
            "offset" => {
                let magnitude = |v: &Value| Value::from(v.as_f64().unwrap().abs());
                close(
                    id,
                    &field,
                    &magnitude(got),
                    &magnitude(wanted),
                    tol("point").unwrap(),
                );
            }
            name if name.starts_with("cov") || name.starts_with("var") => {
                let largest = numbers(wanted).iter().fold(0.0, |m: f64, x| m.max(x.abs()));
                close(id, &field, got, wanted, 1e-6 * largest);
            }
            name => {
                let tolerance = tol(name).or(tol("t")).or(tol("rms")).unwrap();
                close(id, &field, got, wanted, tolerance);
            }
        }
        compared += 1;
    }
    compared
}

/// Every number of every good reference case, at its stated tolerance.
#[test]
fn reference_cases_are_fitted() {
    let mut fitted = 0;
    for case in cases().iter().filter(|case| case["expect"] == "fit") {
        let ran = run(case);
        if case["may_refuse"] == true && ran.status == 2 {
            continue;
        }
        let ran = ran.exits(0);
        assert!(ran.err.is_empty(), "{}", ran.err);
        assert!(compare(case, &ran.json()) >= 6, "{case}");
        fitted += 1;
    }
    assert!(fitted >= 20, "{fitted}");
}

/// Every bad reference case is refused with its class, as JSON and in words.
#[test]
fn bad_reference_cases_are_refused() {
    let mut refused = 0;
    for case in cases().iter().filter(|case| case["expect"] == "error") {
        let error = run(case).exits(2).json()["error"].clone();
        let classes = case["error_any_of"].as_array().unwrap();
        assert!(classes.contains(&error["code"]), "{}: {error}", case["id"]);
        assert!(!error["message"].as_str().unwrap().is_empty());
        refused += 1;
    }
    assert!(refused >= 10, "{refused}");
}

/// The two lists of a registration as two files give what the one file gives, to the bit.
#[test]
fn two_files_register_like_one() {
    let pairs = project("tests/reference/fits/registration_coplanar4_15um.csv");
    let text = std::fs::read_to_string(&pairs).unwrap();
    let columns = |from: usize| -> String {
        let rows = text.lines().skip(1);
        rows.map(|row| {
            let fields: Vec<&str> = row.split(',').skip(from).take(3).collect();
            fields.join(" ") + "\n"
        })
        .collect()
    };
    let folder = Folder::new();
    let nominal = folder.file("nominal.txt", columns(0));
    let measured = folder.file("measured.txt", columns(3));
    let one = umi(&["register", &pairs, "--json"]).exits(0);
    let two = umi(&["register", &nominal, &measured, "--json"]).exits(0);
    assert_eq!(one.out, two.out);
}

/// Distances, angle and the expected error at a point are those of the definitions.
#[test]
fn a_registration_says_distances_and_expected_error() {
    let pairs = project("tests/reference/fits/registration_half_turn_n8_15um.csv");
    let ran = umi(&["register", &pairs, "--at", "-10,20,30.5", "--json"]).exits(0);
    let value = ran.json();
    assert_eq!(value["distances"].as_array().unwrap().len(), 8 * 7 / 2);
    let first = &value["distances"][0];
    let difference =
        first["measured_mm"].as_f64().unwrap() - first["reference_mm"].as_f64().unwrap();
    assert!((first["error_mm"].as_f64().unwrap() - difference).abs() < 1e-12);
    let angle = read("registration_half_turn_n8_15um.json")["result"]["angle"]
        .as_f64()
        .unwrap();
    assert!((value["angle_deg"].as_f64().unwrap() - angle.to_degrees()).abs() < 1e-9);

    let place = &value["at"][0];
    assert_eq!(numbers(&place["point_mm"]), [-10.0, 20.0, 30.5]);
    let rows: Vec<Vec<f64>> = value["rotation"]
        .as_array()
        .unwrap()
        .iter()
        .map(numbers)
        .collect();
    for ((row, t), image) in rows
        .iter()
        .zip(numbers(&value["translation_mm"]))
        .zip(numbers(&place["image_mm"]))
    {
        let wanted = row[0] * -10.0 + row[1] * 20.0 + row[2] * 30.5 + t;
        assert!((image - wanted).abs() < 1e-9);
    }
    // Between that of the centroid, sigma sqrt(3/n), and something sensible.
    let sigma = value["sigma_mm"].as_f64().unwrap();
    let error = place["expected_error_mm"].as_f64().unwrap();
    assert!(
        (sigma * (3.0_f64 / 8.0).sqrt()..3.0 * sigma).contains(&error),
        "{error}"
    );
}

/// The tool has no limit of 64 points, and its histogram counts each of them.
#[test]
fn many_points_are_fitted() {
    let points: String = (0..5000)
        .map(|n| {
            let (a, z) = (f64::from(n) * 2.399_963, f64::from(n) / 2501.0 - 0.999);
            let r = 25.0 + 0.003 * (f64::from(n) * 0.7).sin();
            let ring = (1.0 - z * z).max(0.0).sqrt();
            format!("{} {} {}\n", r * ring * a.cos(), r * ring * a.sin(), r * z)
        })
        .collect();
    let folder = Folder::new();
    let file = folder.file("ball.txt", points);
    let value = umi(&["fit", "sphere", &file, "--json"]).exits(0).json();
    assert_eq!(value["n"], 5000);
    assert_eq!(value["residuals_mm"].as_array().unwrap().len(), 5000);
    assert!((value["radius_mm"].as_f64().unwrap() - 25.0).abs() < 0.001);
    let text = umi(&["fit", "sphere", &file]).exits(0).out;
    let counted: u32 = text
        .lines()
        .filter(|line| line.trim_end().ends_with('#'))
        .filter_map(|line| line.split_whitespace().nth(1)?.parse::<u32>().ok())
        .sum();
    assert_eq!(counted, 5000, "{text}");
}

/// For people: parameters with uncertainty, statistics, and every residual with its bar.
#[test]
fn a_fit_is_readable() {
    let points = project("tests/reference/fits/sphere_thesis_table_4_1.csv");
    let text = umi(&["fit", "sphere", &points]).exits(0).out;
    for words in [
        "sphere through 5 points",
        "center X  -136.7105 mm         0.0103 mm",
        "radius      12.7118 mm         0.0073 mm",
        "sigma 0.0145 mm with 1 degree of freedom",
        "5  -136.7120  123.6930  136.1330   +0.0072              |############",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
}
