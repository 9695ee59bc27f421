//! `umi scan plan` and `verify`: outputs, names of axes, programs and damaged paths.

use std::fs;

use crate::rig::run::{Folder, Ran, project, umi};

/// The name of a refusal or trouble.
fn code(ran: Ran, status: i32) -> String {
    let told = ran.exits(status).json();
    told["error"]["code"].as_str().unwrap().to_owned()
}

/// The reference's machine with other words for its rotary axes.
fn spec_with(folder: &Folder, name: &str, changes: &[(&str, &str)]) -> String {
    let text = fs::read_to_string(project("tests/reference/plan/step_wavy.toml")).unwrap();
    let text = changes.iter().fold(text, |text, (from, to)| {
        let changed = text.replace(from, to);
        assert_ne!(changed, text, "{from}");
        changed
    });
    let path = folder.path(name);
    fs::write(&path, text).unwrap();
    path
}

const PART: &str = "tests/reference/plan/three_axes.obj";
const SPEC: &str = "tests/reference/plan/three_axes.toml";

#[test]
fn outputs_of_one_plan_are_different_files_and_none_is_an_input() {
    let folder = Folder::new();
    let (part, spec) = (project(PART), project(SPEC));
    let path = folder.path("path.csv");
    let same = folder.path("sub/../path.csv");
    fs::create_dir(folder.path("sub")).unwrap();
    let plan = [
        "scan", "plan", &part, "--spec", &spec, "-o", &path, "--json",
    ];
    for other in [&path, &same] {
        let ran = umi(&[&plan[..], &["--nc", other, "--force"]].concat());
        assert_eq!(code(ran, 1), "file");
        assert!(!fs::exists(&path).unwrap());
    }
}

#[test]
fn a_refusal_leaves_no_path_and_keeps_the_older_one_beside() {
    let folder = Folder::new();
    let part = project(PART);
    let spec = spec_with(&folder, "spec.toml", &[("overlap = 0.15", "overlap = 1.0")]);
    let path = folder.path("path.csv");
    fs::write(&path, "older").unwrap();
    let ran = umi(&[
        "scan", "plan", &part, "--spec", &spec, "-o", &path, "--force", "--json",
    ]);
    assert_eq!(code(ran, 2), "plan_spec");
    assert!(!fs::exists(&path).unwrap());
    assert_eq!(fs::read_to_string(format!("{path}.old")).unwrap(), "older");
    // One that succeeds replaces it.
    fs::write(&path, "older").unwrap();
    let spec = project(SPEC);
    umi(&[
        "scan", "plan", &part, "--spec", &spec, "-o", &path, "--force", "--json",
    ])
    .exits(0);
    assert!(
        fs::read_to_string(&path)
            .unwrap()
            .starts_with("pass,laser,")
    );
    assert!(!fs::exists(format!("{path}.old1")).unwrap());
}

#[test]
fn words_that_a_control_reads_as_something_else_are_refused_by_name() {
    let folder = Folder::new();
    let part = project("tests/reference/plan/step_wavy.step");
    let orient = "orient_deg = [-360, 360]";
    for (number, (from, to, dialect)) in [
        (orient, "orient_deg = [-360, 360], word = \"X\"", "fanuc"),
        (orient, "orient_deg = [-360, 360], word = \"B\"", "fanuc"),
        (
            orient,
            "orient_deg = [-360, 360], word = \"SPOS\"",
            "siemens",
        ),
        ("name = \"B\"", "name = \"F\"", "heidenhain"),
        ("name = \"B\"", "name = \"B1\"", "linuxcnc"),
        ("name = \"B\"", "name = \"BETA\"", "siemens"),
    ]
    .into_iter()
    .enumerate()
    {
        let spec = spec_with(&folder, &format!("{number}.toml"), &[(from, to)]);
        let (path, program) = (folder.path("path.csv"), folder.path("path.nc"));
        let ran = umi(&[
            "scan",
            "plan",
            &part,
            "--spec",
            &spec,
            "-o",
            &path,
            "--nc",
            &program,
            "--dialect",
            dialect,
            "--json",
        ]);
        assert_eq!(code(ran, 2), "machine_spec", "{to}");
        assert!(!fs::exists(&path).unwrap() && !fs::exists(&program).unwrap());
    }
}

/// The feed of a carried point is that of the part; the program's number is its file's.
#[test]
fn plain_language_holds_the_feed_at_the_point_that_it_carries() {
    let folder = Folder::new();
    let part = project("tests/reference/plan/step_wavy.step");
    let spec = project("tests/reference/plan/step_wavy.toml");
    let (path, program) = (folder.path("path.csv"), folder.path("O0815.h"));
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
        "--dialect",
        "heidenhain",
        "--nc-mode",
        "rtcp",
        "--feed",
        "700",
        "--json",
    ])
    .exits(0);
    let text = fs::read_to_string(&program).unwrap();
    assert!(text.starts_with("BEGIN PGM SCAN815 MM\n"));
    let feeds: Vec<&str> = text
        .lines()
        .filter_map(|line| line.split(" R0 F").nth(1))
        .filter(|feed| !feed.starts_with("MAX"))
        .collect();
    let held = feeds.iter().filter(|feed| **feed == "700").count();
    // Where an axis turns at its most, it is less; links are faster.
    assert!(held * 10 > feeds.len() * 8, "{held} of {}", feeds.len());
    // A sensor beside the spindle's axis cannot be said by a tool's length.
    let spec = spec_with(
        &folder,
        "beside.toml",
        &[("origin_mm = [0, 0, -150.0]", "origin_mm = [20, 0, -150.0]")],
    );
    let beside = folder.path("beside.csv");
    let ran = umi(&[
        "scan",
        "plan",
        &part,
        "--spec",
        &spec,
        "-o",
        &beside,
        "--nc",
        &folder.path("b.nc"),
        "--nc-mode",
        "rtcp",
        "--json",
    ]);
    assert_eq!(code(ran, 2), "nc_mode");
    // And a control without a rotary axis has no word for it.
    let text = fs::read_to_string(project(SPEC)).unwrap();
    let turning = "spindle = { orient_deg = [-360, 360] }\n";
    assert!(text.contains(turning));
    let spec = folder.file("still.toml", text.replace(turning, ""));
    let (mesh, path, program) = (
        project(PART),
        folder.path("still.csv"),
        folder.path("still.nc"),
    );
    let args = [
        "scan", "plan", &mesh, "--spec", &spec, "-o", &path, "--nc", &program,
    ];
    let ran = umi(&[&args[..], &["--nc-mode", "rtcp", "--json"]].concat());
    assert_eq!(code(ran, 2), "nc_mode");
    assert!(!std::fs::exists(&path).unwrap() && !std::fs::exists(&program).unwrap());
}

#[test]
fn a_damaged_path_is_refused_by_name() {
    let folder = Folder::new();
    let (part, spec) = (project(PART), project(SPEC));
    let path = folder.path("path.csv");
    umi(&[
        "scan", "plan", &part, "--spec", &spec, "-o", &path, "--json",
    ])
    .exits(0);
    let rows = fs::read_to_string(&path).unwrap();
    let rows: Vec<&str> = rows.lines().collect();
    let damaged = |cell: usize, value: &str| {
        let mut rows: Vec<String> = rows.iter().map(|row| (*row).to_owned()).collect();
        let mut cells: Vec<&str> = rows[5].split(',').collect();
        cells[cell] = value;
        rows[5] = cells.join(",");
        rows.join("\n") + "\n"
    };
    for (text, status, named) in [
        (damaged(7, "-1.1"), 2, "bad_path"),
        (damaged(8, "0.01"), 2, "bad_path"),
        (damaged(1, "2"), 2, "bad_path"),
        (damaged(0, "-1"), 2, "bad_path"),
        (damaged(1, "0"), 2, "bad_path"),
        (damaged(0, "0.5"), 2, "bad_path"),
        (damaged(0, "1e300"), 2, "bad_path"),
        (damaged(2, "nan"), 2, "not_finite"),
        (damaged(2, "x"), 1, "corrupt"),
        (format!("{}\n", rows[0]), 2, "bad_path"),
        (
            rows[..9].join("\n").replace(",S", ",T") + "\n",
            1,
            "missing_column",
        ),
    ] {
        let damage = folder.path("damaged.csv");
        fs::write(&damage, text).unwrap();
        let ran = umi(&["scan", "verify", &part, "--spec", &spec, &damage, "--json"]);
        assert_eq!(code(ran, status), named);
        let cloud = folder.path("cloud.ply");
        let ran = umi(&[
            "scan", "drive", &part, "--spec", &spec, &damage, "-o", &cloud, "--json",
        ]);
        assert_eq!(code(ran, status), named, "drive");
    }
}

/// The poses tell what was planned, the axes what is driven: where they are at odds, nothing is driven.
#[test]
fn a_path_whose_axes_are_not_at_its_poses_is_not_driven() {
    let folder = Folder::new();
    let (part, spec) = (project(PART), project(SPEC));
    let path = folder.path("path.csv");
    let planned = umi(&[
        "scan", "plan", &part, "--spec", &spec, "-o", &path, "--feed", "900", "--json",
    ]);
    let at = &planned.exits(0).json()["duration_at"];
    assert_eq!(at["feed_mm_per_min"], 900.0);
    assert_eq!(at["rapid_mm_per_s"], 100.0);
    assert_eq!(at["turn_deg_per_s"], 30.0);
    let shifted: String = fs::read_to_string(&path)
        .unwrap()
        .lines()
        .enumerate()
        .map(|(number, line)| {
            let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
            if number > 0 {
                let x: f64 = cells[11].parse().unwrap();
                cells[11] = (x + 1.0).to_string();
            }
            cells.join(",") + "\n"
        })
        .collect();
    let other = folder.path("other.csv");
    fs::write(&other, shifted).unwrap();
    let cloud = folder.path("cloud.ply");
    let ran = umi(&[
        "scan", "drive", &part, "--spec", &spec, &other, "-o", &cloud, "--json",
    ]);
    assert_eq!(code(ran, 2), "bad_path");
    assert!(!fs::exists(&cloud).unwrap());
}

#[test]
fn standard_output_is_no_file_of_a_path_and_a_beam_is_a_unit_vector() {
    let folder = Folder::new();
    let (part, spec) = (project(PART), project(SPEC));
    let ran = umi(&["scan", "plan", &part, "--spec", &spec, "-o", "-", "--json"]);
    assert_eq!(code(ran, 1), "file");
    let poses = folder.path("poses.csv");
    for (bz, status) in [("-1", 0), ("-2", 2), ("0", 2), ("-1.00001", 2)] {
        fs::write(
            &poses,
            format!("ox_mm,oy_mm,oz_mm,bx,by,bz\n0,0,60,0,0,{bz}\n"),
        )
        .unwrap();
        let ran = umi(&[
            "scan",
            "kinematics",
            "--spec",
            &spec,
            "--inverse",
            &poses,
            "--json",
        ]);
        if status == 0 {
            ran.exits(0);
        } else {
            assert_eq!(code(ran, status), "bad_pose", "{bz}");
        }
    }
}

/// The laser is on from a pass's first pose to its last, and off on every way to one.
#[test]
fn a_program_says_where_the_laser_is_off() {
    let folder = Folder::new();
    let part = project("examples/scan-plan/blade.obj");
    let spec = project("examples/scan-plan/spec.toml");
    for dialect in ["fanuc", "siemens", "heidenhain", "linuxcnc"] {
        let (path, program) = (
            folder.path(&format!("{dialect}.csv")),
            folder.path(&format!("{dialect}.nc")),
        );
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
            "--dialect",
            dialect,
            "--json",
        ])
        .exits(0);
        let text = fs::read_to_string(&program).unwrap();
        // It comes from the top of the machine's Z and goes back there, wherever the machine's zero is.
        let safety = match dialect {
            "fanuc" | "linuxcnc" => "G90 G53 G0 Z400.000",
            "siemens" => "SUPA G0 Z400.000 D0",
            _ => "L Z+400.000 R0 FMAX M91",
        };
        let rapids: Vec<&str> = text
            .lines()
            .filter(|line| line.contains("G0 ") || line.contains("FMAX"))
            .collect();
        assert_eq!(rapids.first(), Some(&safety), "{dialect}");
        assert_eq!(rapids.last(), Some(&safety), "{dialect}");
        // Of each block of a row: the laser while it runs.
        let mut on = false;
        let mut lit = Vec::new();
        for line in text.lines() {
            if line.contains("LASER ON") {
                assert!(!on, "{dialect}: {line}");
                on = true;
            } else if line.contains("LASER OFF") {
                assert!(on || line.contains("START"), "{dialect}: {line}");
                on = false;
            } else if line.starts_with("G1 ") || (line.starts_with("L X") && !line.contains("FMAX"))
            {
                lit.push(on);
            }
        }
        assert!(!on, "{dialect}");
        let rows = fs::read_to_string(&path).unwrap();
        let passes: Vec<&str> = rows
            .lines()
            .skip(1)
            .map(|row| row.split(',').next().unwrap())
            .collect();
        let wanted: Vec<bool> = (0..passes.len())
            .map(|k| k > 0 && passes[k] != "-1" && passes[k] == passes[k - 1])
            .collect();
        assert_eq!(lit, wanted, "{dialect}");
        assert!(
            wanted[1..].iter().any(|lit| !lit),
            "{dialect}: one pass only"
        );
    }
}

/// Where no row of a path is lit, the sensor sees nothing.
#[test]
fn a_dark_path_gives_no_points() {
    let folder = Folder::new();
    let part = project("examples/scan-plan/blade.obj");
    let spec = project("examples/scan-plan/spec.toml");
    let (path, dark) = (folder.path("path.csv"), folder.path("dark.csv"));
    umi(&["scan", "plan", &part, "--spec", &spec, "-o", &path]).exits(0);
    let rows = fs::read_to_string(&path).unwrap();
    let mut text = String::new();
    for (number, row) in rows.lines().enumerate() {
        let mut words: Vec<&str> = row.split(',').collect();
        if number > 0 {
            (words[0], words[1]) = ("-1", "0");
        }
        text += &(words.join(",") + "\n");
    }
    fs::write(&dark, text).unwrap();
    let cloud = folder.path("cloud.ply");
    let driven = umi(&[
        "scan", "drive", &part, "--spec", &spec, &dark, "-o", &cloud, "--json",
    ]);
    driven.exits(2);
    assert!(!std::path::Path::new(&cloud).exists());
}

/// The page's commands run as they are printed, one after the other.
#[test]
fn the_commands_of_the_page_run() {
    let folder = Folder::new();
    let page = fs::read_to_string(project("docs/scan-plan.md")).unwrap();
    let mut run = 0;
    for line in page.lines().filter(|line| line.starts_with("umi scan ")) {
        let place = |word: &str| match word {
            word if word.starts_with("examples/") => project(word),
            word if word.contains('.') => folder.path(word),
            word => word.to_owned(),
        };
        let words: Vec<String> = line.split(' ').skip(1).map(place).collect();
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let ran = umi(&[&words[..], &["--json"]].concat()).exits(0).json();
        if words[1] == "verify" {
            assert_eq!(ran["holds"], true, "{ran}");
        }
        run += 1;
    }
    assert_eq!(run, 3);
}
