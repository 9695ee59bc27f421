//! `umi scan localise` against the reference cases, and what it says of files that are wrong.

use serde_json::Value;

use crate::rig::run::{Folder, Ran, command, project};

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

/// A transform says from which coordinates into which it leads: of a scanner, of a part by
/// fiducials, and of a part in a scan, whose coordinates somebody says; and how well it is known.
#[test]
fn a_pose_says_whose_coordinates_it_leads_to() {
    let folder = Folder::new();
    let out = folder.path("t.json");
    let leads = |id: &str, more: &[&str]| {
        let case = case(id);
        let args = case["args"].as_array().unwrap().iter();
        let args: Vec<&str> = args.map(|arg| arg.as_str().unwrap()).collect();
        let said = run(&[&args[..], &["-o", &out, "--force"], more].concat())
            .exits(0)
            .json();
        let written: Value = serde_json::from_str(&std::fs::read_to_string(&out).unwrap()).unwrap();
        // So that `umi correction` and `umi nc rewrite` can hold it where the part ends.
        assert!(written["cov"][5][5].as_f64().unwrap() > 0.0);
        assert_eq!(written["cov"], said["cov"]);
        [written["from"].clone(), written["to"].clone()]
    };
    assert_eq!(leads("optimum_balls", &[]), ["scanner", "machine"]);
    assert_eq!(leads("optimum_bracket", &[]), ["part", "scan"]);
    let in_offset = leads("optimum_bracket", &["--scan-in", "offset"]);
    assert_eq!(in_offset, ["part", "offset"]);
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
        (
            "[[fiducial]]\nname = \"A\"\nposition_mm = [0,0,0]\nshape = { sphere = { radius_mm = 5 } }\n\
             u_position_mm = 1e300\n",
            "from 0 to 1000",
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
    // Pose and page would overwrite each other.
    let (scan, part) = ("optimum_balls.ply", "bracket.stl");
    let both = folder.path("both");
    for also in [both.clone(), folder.path("./both")] {
        let twice = [
            "scan", "localise", scan, "--part", part, "-o", &both, "--report", &also,
        ];
        let error = &run(&twice).exits(1).json()["error"];
        let message = error["message"].as_str().unwrap();
        assert!(message.contains("a name of its own"), "{error}");
    }
}

/// Three balls on a table: what the scanner of a scene sees, and where they say that it stands.
const SCENE: &str = "
[scanner]
position_mm = [60.0, -250.0, 380.0]
look_at_mm = [70.0, 60.0, 30.0]
field_deg = [34.0, 30.0]
distance_mm = 460.0
spacing_mm = 1.2
noise_mm = 0.02
drop_out = 0.02
grazing_deg = 75.0
baseline_mm = 100.0
[[body]]
name = \"TABLE\"
shape = \"half_space\"
[[body]]
name = \"B1\"
shape = { sphere = { radius_mm = 12.7 } }
position_mm = [0.0, 0.0, 50.0]
[[body]]
name = \"B2\"
shape = { sphere = { radius_mm = 12.7 } }
position_mm = [150.0, 20.0, 35.0]
[[body]]
name = \"B3\"
shape = { sphere = { radius_mm = 12.7 } }
position_mm = [40.0, 130.0, 60.0]
[[body]]
name = \"POST\"
shape = { cone = { half_angle_deg = 20.0, height_mm = 40.0 } }
position_mm = [90.0, 70.0, 40.0]
";

#[test]
fn what_a_scanner_of_a_scene_sees_is_placed_where_it_stands() {
    let folder = Folder::new();
    let cell = folder.file("cell.toml", SCENE);
    let balls: String = [
        ("B1", "0, 0, 50"),
        ("B2", "150, 20, 35"),
        ("B3", "40, 130, 60"),
    ]
    .iter()
    .map(|(name, at)| {
        format!(
            "[[fiducial]]\nname = \"{name}\"\nposition_mm = [{at}]\n\
             shape = {{ sphere = {{ radius_mm = 12.7 }} }}\n"
        )
    })
    .collect();
    let balls = folder.file("balls.toml", balls);
    let [cloud, again, pose] = ["scan.ply", "again.ply", "truth.json"].map(|f| folder.path(f));
    let simulate = |out: &str, more: &[&str]| {
        let args = ["scan", "simulate", &cell, "-o", out];
        run(&[&args[..], more].concat()).exits(0).json()
    };
    let truth = simulate(&cloud, &["--pose", &pose, "--threads", "1"]);
    assert!(truth["points"].as_u64().unwrap() > 20_000, "{truth}");
    assert!(truth["shadowed"].as_u64().unwrap() > 100, "{truth}");
    simulate(&again, &["--threads", "3"]);
    assert_eq!(
        std::fs::read(&cloud).unwrap(),
        std::fs::read(&again).unwrap()
    );
    let got = run(&["scan", "localise", &cloud, "--fiducials", &balls])
        .exits(0)
        .json();
    let written: Value = serde_json::from_slice(&std::fs::read(&pose).unwrap()).unwrap();
    for p in ["[0, 0, 450]", "[80, 80, 400]", "[-80, 60, 500]"] {
        let p: Value = serde_json::from_str(p).unwrap();
        let (a, b) = (image(&got, &p), image(&written, &p));
        let off = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
        assert!(off < 0.03, "{off}");
    }
    // What it cannot be asked.
    let none = folder.path("none.ply");
    let refused = |scene: &str, code: &str| {
        let scene = folder.file("other.toml", scene);
        let got = run(&["scan", "simulate", &scene, "-o", &none])
            .exits(2)
            .json();
        assert_eq!(got["error"]["code"], code);
        assert!(!std::path::Path::new(&none).exists());
    };
    refused("", "no_scanner");
    let up = SCENE.replace("[70.0, 60.0, 30.0]", "[60.0, -250.0, 900.0]");
    refused(&up, "nothing_seen");
    refused(
        &SCENE.replace("spacing_mm = 1.2", "spacing_mm = 0"),
        "scene",
    );
}

/// Corners of a mesh as its scan: they lie on it exactly, and nothing of the pose is worth a sign.
#[test]
fn zero_is_printed_without_a_sign() {
    let here = project("tests/reference/scan/localise/bracket.stl");
    // The corners of a model alone lie on no face: its own pose is stated, and stays.
    let start = r#"{"rotation":[[1,0,0],[0,1,0],[0,0,1]],"translation_mm":[0,0,0]}"#;
    let folder = Folder::new();
    let start = folder.file("start.json", start);
    let args = ["scan", "localise", &here, "--part", &here];
    let ran = crate::rig::run::umi(&args).exits(2);
    assert!(ran.err.contains("hold the pose"), "{}", ran.err);
    let stated = ["--start", &start, "--kernel", "none"];
    let ran = crate::rig::run::umi(&[&args[..], &stated].concat()).exits(0);
    assert!(ran.out.contains("1.000000000"), "{}", ran.out);
    for token in ran.out.split([' ', ',', '\n']) {
        let is_zero = token
            .strip_prefix('-')
            .is_some_and(|digits| !digits.is_empty() && digits.bytes().all(|b| b"0.".contains(&b)));
        assert!(!is_zero, "{}", ran.out);
    }
}

#[test]
fn files_that_hold_no_scan_or_no_part_are_told_as_what_they_are() {
    let folder = Folder::new();
    let nan = folder.file("nan.csv", "x,y,z\nnan,2,3\n4,inf,6\n");
    let few = folder.file("few.csv", "x,y,z\n1,2,3\n4,5,6\n");
    let empty = folder.file("empty.stl", "solid x\nendsolid x\n");
    for (scan, part, status, code, word) in [
        (
            nan.as_str(),
            "bracket.stl",
            2,
            "not_finite",
            "none of its 2 points",
        ),
        (few.as_str(), "bracket.stl", 2, "too_few_points", "2 points"),
        (
            "fiducials_corners.ply",
            empty.as_str(),
            2,
            "empty_model",
            "no triangle",
        ),
        (
            "fiducials_corners.ply",
            "optimum_balls.ply",
            1,
            "bad_file",
            "a PLY file",
        ),
    ] {
        let error = &run(&["scan", "localise", scan, "--part", part])
            .exits(status)
            .json()["error"];
        assert_eq!(error["code"], code, "{error}");
        assert!(error["message"].as_str().unwrap().contains(word), "{error}");
    }
}

/// A table in inches with decimal commas says so in the names of its columns: it is the scan that it was in mm, and another
/// unit beside that is refused.
#[test]
fn the_unit_that_a_table_names_is_followed() {
    let folder = Folder::new();
    let (mm, inches) = (folder.path("mm.csv"), folder.path("inches.csv"));
    run(&["scan", "convert", "optimum_bracket.ply", "-o", &mm]).exits(0);
    let text = std::fs::read_to_string(&mm).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let place = |name: &str| names.iter().position(|n| *n == name).unwrap();
    let axes = ["x_mm", "y_mm", "z_mm"].map(place);
    let rows = lines.map(|line| {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        let [x, y, z] = axes.map(|i| format!("{}", cells[i] / 25.4).replace('.', ","));
        format!("{x};{y};{z}\r\n")
    });
    let table = format!("X [inch];Y [inch];Z [inch]\r\n{}", rows.collect::<String>());
    std::fs::write(&inches, table).unwrap();
    let case = case("optimum_bracket");
    let args = case["args"].as_array().unwrap().iter();
    let mut args: Vec<&str> = args.map(|arg| arg.as_str().unwrap()).collect();
    args[2] = &inches;
    let got = run(&args).exits(0).json();
    for p in case["probes"].as_array().unwrap() {
        let (a, b) = (image(&got, p), image(&case["pose"], p));
        assert!((0..3).all(|i| (a[i] - b[i]).abs() < 1e-5), "{a:?} {b:?}");
    }
    run(&[&args[..], &["--unit", "inch"]].concat()).exits(0);
    let other = run(&[&args[..], &["--unit", "mm"]].concat())
        .exits(1)
        .json();
    assert_eq!(other["error"]["code"], "usage", "{other}");
}

/// A point, a start and a place that are asked for where nothing can be: refused, and no answer without numbers.
#[test]
fn what_is_too_far_out_is_no_answer_without_numbers() {
    let folder = Folder::new();
    let far = folder.path("far.csv");
    run(&["scan", "convert", "optimum_bracket.ply", "-o", &far]).exits(0);
    let text = std::fs::read_to_string(&far).unwrap();
    let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let cells = names
        .iter()
        .map(|name| if name.ends_with("_mm") { "1e300" } else { "0" });
    let row = cells.collect::<Vec<_>>().join(",");
    std::fs::write(&far, format!("{text}{row}\n")).unwrap();
    let case = case("optimum_bracket");
    let args = case["args"].as_array().unwrap().iter();
    let args: Vec<&str> = args.map(|arg| arg.as_str().unwrap()).collect();
    let mut stray = args.clone();
    stray[2] = &far;
    let error = &run(&stray).exits(2).json()["error"];
    assert_eq!(error["code"], "not_finite", "{error}");
    assert!(
        error["message"].as_str().unwrap().contains("take it out"),
        "{error}"
    );
    run(&[&args[..], &["--at", "1e300,0,0"]].concat()).exits(1);
}

/// Nothing is larger than what is no number: a limit of it would make every scan OK.
#[test]
fn a_limit_that_is_no_number_is_refused() {
    for value in ["nan", "inf", "-inf", "1e400"] {
        for option in ["--limit", "--scale-limit-ppm"] {
            let said = format!("{option}={value}");
            let args = [
                "scan",
                "localise",
                "optimum_bracket.ply",
                "--part",
                "bracket.stl",
            ];
            run(&[&args[..], &[&said]].concat()).exits(1);
        }
        let said = format!("--require={value}");
        run(&["scan", "stock", "bracket.stl", "stock_min.ply", &said]).exits(1);
    }
}
