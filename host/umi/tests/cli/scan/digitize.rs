//! A part digitized through the tool: the reference scenes, and what is refused.

use serde_json::{Value, json};

use crate::rig::run::{Folder, Ran, project, umi};

fn reference(name: &str) -> String {
    project(&format!("tests/reference/point/digitize/{name}"))
}

/// A calibration that says what the scene says.
fn calibration(folder: &Folder, change: impl Fn(&mut Value)) -> String {
    let mut file = json!({
        "kind": "point_sensor",
        "offset_mm": [1.3, -0.8, -120.0],
        "direction": [0.003_490_646_098_723_725, -0.001_745_317_732_793_025_8, -0.999_992_384_598_915_4],
        "gain": 1,
        "covariance": null,
    });
    change(&mut file);
    folder.file("sensor.json", file.to_string().as_bytes())
}

/// A run of a reference scene with some options changed.
fn digitize(
    folder: &Folder,
    id: &str,
    calibration: &str,
    strategy: &str,
    changed: &[(&str, &str)],
) -> (Ran, String) {
    let text = std::fs::read_to_string(reference(&format!("{id}.json"))).unwrap();
    let case: Value = serde_json::from_str(&text).unwrap();
    let scene = folder.path(&format!("{id}.toml"));
    // Another scene of this case may be there.
    if !std::path::Path::new(&scene).exists() {
        std::fs::copy(reference(&format!("{id}.toml")), &scene).unwrap();
    }
    let cloud = folder.path("cloud.csv");
    let mut args: Vec<String> = ["scan", "digitize", "--scene", &scene, "--calibration"]
        .map(str::to_owned)
        .into();
    args.extend([calibration.to_owned(), "--strategy".into(), strategy.into()]);
    for (name, value) in case["options"].as_object().unwrap() {
        if !changed.iter().any(|(changed, _)| changed == name) {
            args.extend([format!("--{name}"), value.as_str().unwrap().to_owned()]);
        }
    }
    for (name, value) in changed {
        args.extend([format!("--{name}"), (*value).to_owned()]);
    }
    args.extend([
        "-o".into(),
        cloud.clone(),
        "--force".into(),
        "--json".into(),
    ]);
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    (umi(&args), cloud)
}

/// The cloud's lines, without the first.
fn rows(cloud: &str) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(cloud).unwrap();
    let mut lines = text.lines();
    assert_eq!(
        lines.next(),
        Some("row,col,x_mm,y_mm,z_mm,gamma_mm,qx_mm,qy_mm,qz_mm,snr,total,status")
    );
    lines
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect()
}

/// How far a point is from the surface of a case.
fn off(surface: &Value, p: [f64; 3]) -> f64 {
    let number = |value: &Value| value.as_f64().unwrap();
    let radius = number(&surface["radius_mm"]);
    if surface["kind"] == "sphere" {
        let c: Vec<f64> = surface["center_mm"]
            .as_array()
            .unwrap()
            .iter()
            .map(number)
            .collect();
        let squares: f64 = p.iter().zip(c).map(|(p, c)| (p - c) * (p - c)).sum();
        return squares.sqrt() - radius;
    }
    assert_eq!(surface["kind"], "cylinder_y");
    let axis: Vec<f64> = surface["axis_mm"]
        .as_array()
        .unwrap()
        .iter()
        .map(number)
        .collect();
    (p[0] - axis[0]).hypot(p[2] - axis[1]) - radius
}

#[test]
fn the_reference_scenes_hold() {
    let folder = Folder::new();
    let sensor = calibration(&folder, |_| {});
    for id in ["ball_8mm", "cylinder_25mm_lens"] {
        let text = std::fs::read_to_string(reference(&format!("{id}.json"))).unwrap();
        let case: Value = serde_json::from_str(&text).unwrap();
        let [columns, rows_of_grid] = [0, 1].map(|k| case["grid"][k].as_u64().unwrap());
        let list = |name: &str| -> Vec<f64> {
            let text = case["options"][name].as_str().unwrap();
            text.split(',').map(|x| x.parse().unwrap()).collect()
        };
        let (at, step) = (list("at"), list("step"));
        let tol = |name: &str| case[name].as_f64().unwrap();
        let mut times = std::collections::HashMap::new();
        for (strategy, wanted) in case["strategies"].as_object().unwrap() {
            let (ran, cloud) = digitize(&folder, id, &sensor, strategy, &[]);
            let said = ran.exits(0).json();
            let missing = said["missing"].as_u64().unwrap();
            let limits = [0, 1].map(|k| wanted["missing"][k].as_u64().unwrap());
            assert!(
                (limits[0]..=limits[1]).contains(&missing),
                "{id} {strategy} {said}"
            );
            times.insert(strategy.clone(), said["duration_s"].as_f64().unwrap());
            let rows = rows(&cloud);
            assert_eq!(rows.len() as u64, columns * rows_of_grid);
            for row in &rows {
                if row[11] != "ok" {
                    assert!(row[2..11].iter().all(String::is_empty), "{row:?}");
                    continue;
                }
                let number = |k: usize| row[k].parse::<f64>().unwrap();
                let from = off(&case["surface"], [2, 3, 4].map(number));
                assert!(
                    from.abs() <= tol("surface_tol_mm"),
                    "{id} {strategy} {row:?} {from}"
                );
                for (q, index, k) in [(6, 1, 0), (7, 0, 1)] {
                    let place = at[k] + number(index) * step[k];
                    assert!((number(q) - place).abs() <= tol("grid_tol_mm"), "{row:?}");
                }
            }
            if strategy != "non-adaptive" {
                let most = said["dof_deviation_mm"]["max"].as_f64().unwrap();
                assert!(most <= tol("dof_tol_mm"), "{id} {strategy} {said}");
            }
        }
        let [faster, slower] = [0, 1].map(|k| times[case["faster"][k].as_str().unwrap()]);
        assert!(faster < slower, "{id} {times:?}");
    }
}

#[test]
fn what_cannot_be_is_refused_by_name() {
    let folder = Folder::new();
    let sensor = calibration(&folder, |_| {});
    let refused = |changed: &[(&str, &str)]| {
        let (ran, _) = digitize(&folder, "ball_8mm", &sensor, "adaptive", changed);
        ran.exits(2).json()["error"].clone()
    };
    for (changed, code, letter) in [
        (("at", "-300,0,223.5"), "over_travel", Value::Null),
        (("at", "-8,-8,240"), "no_signal", Value::Null),
        (("at", "-8,-8,170"), "collision", Value::Null),
        (("rate-hz", "9500"), "rate_too_high", json!("W")),
        (("size", "0,16"), "bad_input", json!("D")),
        (("size", "16,x"), "bad_input", json!("E")),
        (("step", "2,0"), "bad_input", json!("H")),
        (("at", "-8,-8"), "bad_input", json!("Z of --at")),
        (("at", "x,-8,223.5"), "bad_input", json!("X of --at")),
        (("safe-z", "100"), "bad_input", json!("Q")),
        (("captures", "1"), "bad_input", json!("Z")),
        (("by", "pulses"), "bad_input", json!("R")),
    ] {
        let error = refused(&[changed]);
        assert_eq!(
            (&error["code"], &error["letter"]),
            (&json!(code), &letter),
            "{error}"
        );
    }
    let other = calibration(&folder, |file| file["stand_off_mm"] = json!(18.2));
    let (ran, _) = digitize(&folder, "ball_8mm", &other, "adaptive", &[]);
    assert_eq!(ran.exits(2).json()["error"]["code"], "other_lens");
    // The beam the other way round: the first two readings tell it.
    let swapped = calibration(&folder, |file| file["direction"] = json!([0.0, 0.0, 1.0]));
    let (ran, _) = digitize(&folder, "ball_8mm", &swapped, "adaptive", &[]);
    let error = ran.exits(2).json()["error"].clone();
    assert_eq!(error["code"], "alarm");
    assert!(
        error["message"].as_str().unwrap().contains("BEAM WRONG"),
        "{error}"
    );
}

/// A calibration whose gain is not the scene's is refused, and the one that has it is taken: it was the other way round, and
/// points were 0.13 mm off and `ok`.
#[test]
fn the_gain_of_a_scene_is_in_the_check_of_its_lens() {
    let folder = Folder::new();
    let text = std::fs::read_to_string(reference("ball_8mm.toml")).unwrap();
    let table = "[point_sensor]\n";
    assert!(text.contains(table));
    let text = text.replacen(table, &format!("{table}gain_error_ppm = 3000\n"), 1);
    folder.file("ball_8mm.toml", text);
    for (gain, right) in [(1.003, true), (1.0, false), (1.006, false)] {
        let sensor = calibration(&folder, |file| file["gain"] = json!(gain));
        let (ran, cloud) = digitize(&folder, "ball_8mm", &sensor, "adaptive", &[]);
        if !right {
            assert_eq!(ran.exits(2).json()["error"]["code"], "other_lens", "{gain}");
            continue;
        }
        assert_eq!(ran.exits(0).json()["points"], 81);
        let case = std::fs::read_to_string(reference("ball_8mm.json")).unwrap();
        let case: Value = serde_json::from_str(&case).unwrap();
        for row in rows(&cloud) {
            let p = [2, 3, 4].map(|k| row[k].parse().unwrap());
            assert!(off(&case["surface"], p).abs() < 0.02, "{row:?}");
        }
    }
}

/// A run in which no place has a point is no success; the table has the reason of each.
#[test]
fn a_run_without_a_point_is_refused() {
    let folder = Folder::new();
    let sensor = calibration(&folder, |_| {});
    let changed = [("at", "-8,-8,260")];
    let (ran, cloud) = digitize(&folder, "ball_8mm", &sensor, "non-adaptive", &changed);
    let error = ran.exits(2).json()["error"].clone();
    assert_eq!(
        (&error["code"], &error["points"]),
        (&json!("no_points"), &json!(0))
    );
    assert_eq!(rows(&cloud).len(), 81);
}

/// The program that is kept is the one that was run, whole: a shop can load it.
#[test]
fn the_program_is_kept() {
    let folder = Folder::new();
    let sensor = calibration(&folder, |_| {});
    let nc = folder.path("part.nc");
    let changed = [
        ("nc", nc.as_str()),
        ("by", "trip"),
        ("baud", "115200"),
        ("captures", "10"),
    ];
    let (ran, _) = digitize(
        &folder,
        "ball_8mm",
        &sensor,
        "predictive-adaptive",
        &changed,
    );
    assert_eq!(ran.exits(0).json()["points"], 81);
    let said = umi(&["machine", "check", &nc, "--json"]).exits(0);
    let text = std::fs::read_to_string(&nc).unwrap();
    for macro_ in ["O0001", "O8840", "O8841", "O8842"] {
        assert!(text.contains(macro_), "{macro_} {}", said.out);
    }
}
