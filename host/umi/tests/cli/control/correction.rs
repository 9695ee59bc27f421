//! `umi correction` and `umi dialects`: programs in every dialect, or a refusal.

use crate::rig::run::{Folder, umi};

/// Two degrees about Z, 0.01 degree of tilt.
const MOVED: &str = r#"{"rotation": [[0.999390827, -0.034899497, 0.000174533],
    [0.034899497, 0.999390827, 0], [-0.000174426, 0.0000060911, 0.999999985]],
    "translation_mm": [-47.6405, -0.3266, -0.0041]}"#;

const PLACE: [&str; 8] = [
    "--origin",
    "-400,-250,-310",
    "--part-min",
    "0,0,-20",
    "--part-max",
    "100,80,0",
    "--limit",
    "0.005",
];

/// A transform, in the words of a control that can express it; what it leaves is stated, and
/// the program says that no board has made it.
#[test]
fn a_transform_becomes_a_program() {
    let folder = Folder::new();
    let moved = folder.file("moved.json", MOVED);
    let program = |more: &[&str]| {
        let args = [&["correction", "--transform", &moved], &PLACE[..], more].concat();
        umi(&args).exits(0).out
    };
    let text = program(&["--dialect", "siemens", "--number", "77"]);
    assert!(text.starts_with("%_N_UMI0077_SPF\n"), "{text}");
    assert!(text.contains("; MADE BY UMI AND NOT BY A BOARD\n; FROM TRANSFORM MOVED\n"));
    assert!(text.contains("; LEFT AT PART 0.00") && text.contains("LIMIT 0.0050 MM"));
    assert!(text.contains("\n$P_UIFR[2]=CTRANS(X,-447."), "{text}");
    let text = program(&["--dialect", "fanuc-g54.4", "--set", "3", "--main"]);
    assert!(
        text.contains("\n#26035=2.000\n") && text.contains("\nM30\n"),
        "{text}"
    );
    let text = program(&["--dialect", "g68-3d", "--write-to", "G54.1P12"]);
    assert!(text.contains("\nG10 L20 P12 X") && text.contains("\nG54.1 P12\nG68 X0. Y0. Z0. I"));
    let args = [
        "correction",
        "--transform",
        &moved,
        "--dialect",
        "heidenhain",
        "--json",
    ];
    let json = umi(&[&args[..], &PLACE].concat()).exits(0).json();
    assert_eq!(json["dialect"], "heidenhain");
    assert_eq!(json["limit_mm"], 0.005);
    assert!(json["leftover_mm"].as_f64().unwrap() < 0.001);
    assert!(
        json["text"]
            .as_str()
            .unwrap()
            .starts_with("BEGIN PGM UMI9010 MM\n")
    );
}

/// Tilt on a control that turns about Z only, numbers beyond the format, places that a
/// dialect does not have, options that are missing: each is refused by name.
#[test]
fn what_does_not_suffice_is_refused() {
    let folder = Folder::new();
    let moved = folder.file("moved.json", MOVED);
    let run = |dialect: &str, more: &[&str]| {
        let start = ["correction", "--transform", &moved, "--dialect", dialect];
        umi(&[&start[..], &PLACE, more].concat())
    };
    for dialect in ["g10-g68", "variables", "haas", "haas-e", "linuxcnc", "grbl"] {
        run(dialect, &[])
            .exits(2)
            .says("at the part's corners, limit 0.0050");
    }
    let error = run("g10-g68", &["--json"]).exits(2).json();
    assert_eq!(error["error"]["code"], "leftover");
    // 0.01 degree at the corner of 100 by 80 by 20 mm.
    let left = error["error"]["leftover_mm"].as_f64().unwrap();
    assert!((0.008..0.011).contains(&left), "{left}");
    run("siemens", &["--write-to", "G59"])
        .exits(1)
        .says("no such `write_to`");
    run("mazak-g54.4", &["--set", "9"])
        .exits(1)
        .says("no such `set`");
    run("siemens", &["--write-to", "G54"])
        .exits(1)
        .says("--write-to");
    run("klingon", &[]).exits(1).says("umi dialects");
    // A maker of controls is no dialect: those of its controls are named.
    run("fanuc", &[])
        .exits(1)
        .says("did you mean g10-g68 or g68-3d or fanuc-g54.4?");
    let far = MOVED.replace("-47.6405", "1e6");
    let far = folder.file("far.json", &far);
    let args = ["correction", "--transform", &far, "--dialect", "siemens"];
    umi(&[&args[..], &PLACE].concat())
        .exits(2)
        .says("does not fit the numbers");
    let args = ["correction", "--transform", &moved, "--dialect", "siemens"];
    umi(&args).exits(1).says("--origin is missing");
}

/// A verdict that was printed; one that is NG makes nothing.
#[test]
fn a_printed_verdict() {
    let folder = Folder::new();
    let verdict = |ok: &str| {
        let moved = MOVED.replace('\n', "");
        format!(
            "{{\"type\":\"verdict\",\"verdict\":\"{ok}\",\"plate\":4,\"registration\":{moved}}}\n"
        )
    };
    let good = folder.file("good.jsonl", verdict("OK"));
    let args = ["correction", "--dialect", "g68-3d", "--verdict", &good];
    let text = umi(&[&args[..], &PLACE].concat()).exits(0).out;
    assert!(
        text.contains("(FROM VERDICT OK - GOOD - SETUP 4)\n"),
        "{text}"
    );
    let bad = folder.file("bad.jsonl", verdict("NG"));
    let args = ["correction", "--dialect", "g68-3d", "--verdict", &bad];
    umi(&[&args[..], &PLACE].concat()).exits(2).says("NG");
}

/// What was cut off is no older verdict, an OK has no reasons against it, and a pose that is NG moves nothing.
#[test]
fn what_is_no_whole_ok_corrects_nothing() {
    let folder = Folder::new();
    let moved = MOVED.replace('\n', "");
    let verdict = |more: &str| {
        format!(
            "{{\"type\":\"verdict\",\"verdict\":\"OK\",\"plate\":4,\"registration\":{moved}{more}}}"
        )
    };
    let torn = format!("{}\n{{\"type\":\"verdict\",\"plate\":5,\"verd", verdict(""));
    let reasons = verdict(",\"reasons\":[{\"code\":\"rms\"}]");
    for (text, status, says) in [
        (verdict(",\"reasons\":[],\"reasons_dropped\":0"), 0, ""),
        (torn, 1, "line 2 is no JSON"),
        (reasons, 2, "reasons against it"),
        (verdict(",\"reasons_dropped\":3"), 2, "reasons against it"),
    ] {
        let file = folder.file("verdict.jsonl", text);
        let args = ["correction", "--dialect", "g68-3d", "--verdict", &file];
        umi(&[&args[..], &PLACE].concat()).exits(status).says(says);
    }
    let pose = moved.replacen('{', "{\"verdict\":\"NG\",", 1);
    let pose = folder.file("pose.json", pose);
    let args = ["correction", "--dialect", "g68-3d", "--transform", &pose];
    umi(&[&args[..], &PLACE].concat())
        .exits(2)
        .says("its verdict is not OK");
}

/// The table names every dialect with what it can do, and its sources.
#[test]
fn the_table() {
    let text = umi(&["dialects"]).exits(0).out;
    let lines = umi(&["dialects", "--json"]).exits(0).out;
    let rows: Vec<serde_json::Value> = lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(rows.len(), 12);
    for row in &rows {
        let name = row["dialect"].as_str().unwrap();
        assert!(text.contains(name), "{name}");
        for field in ["controls", "tried", "sources"] {
            assert!(!row[field].as_str().unwrap().is_empty(), "{name}");
        }
        let own = umi(&["dialects", name]).exits(0).out;
        assert!(own.contains(row["sources"].as_str().unwrap()));
    }
    let grbl = rows.iter().find(|row| row["dialect"] == "grbl").unwrap();
    assert_eq!(
        (&grbl["degrees_of_freedom"], &grbl["rotation"]),
        (&3.into(), &"none".into())
    );
    umi(&["dialects", "klingon"])
        .exits(1)
        .says("no such dialect");
}
