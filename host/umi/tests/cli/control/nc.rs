//! `umi nc`: a tool path is checked and rewritten, or refused before anything is written.

use crate::rig::run::{Folder, command, project, umi};

const PROGRAM: &str =
    "%\r\nO7 (PART)\r\nG21 G90 G54\r\nG0 X10. Y0. Z5.\r\nG1 X20. F100\r\nM30\r\n%\r\n";

const QUARTER: &str =
    r#"{"rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "translation_mm": [1, 0, 0]}"#;

/// The transform of a file; the header says where the program comes from.
#[test]
fn a_path_is_rewritten() {
    let folder = Folder::new();
    let (program, transform) = (folder.file("p.nc", PROGRAM), folder.file("t.json", QUARTER));
    let out = folder.path("out.nc");
    let args = [
        "nc",
        "rewrite",
        &program,
        "-o",
        &out,
        "--transform",
        &transform,
    ];
    let ran = umi(&args).exits(0);
    assert!(ran.out.contains("1 rapid, 1 line, 0 arcs"), "{}", ran.out);
    let made = std::fs::read_to_string(&out).unwrap();
    assert!(
        made.starts_with("%\r\nO7 (PART)\r\n(UMI REWRITTEN FROM CRC32 "),
        "{made}"
    );
    assert!(made.contains("(TRANSFORM T)\r\n"), "{made}");
    assert!(
        made.ends_with("G21 G90 G54\r\nG0 X1. Y10. Z5.\r\nG1 X1. Y20. F100\r\nM30\r\n%\r\n"),
        "{made}"
    );
    let again = [&args[..], &["--json", "--force"]].concat();
    let json = umi(&again).exits(0).json();
    assert_eq!(json["feeds"], 1);
    assert_eq!(json["written_max_mm"][1], 20.0);
    // Standard output gets the program, and nothing else.
    let shown = umi(&[
        "nc",
        "rewrite",
        &program,
        "-o",
        "-",
        "--transform",
        &transform,
    ]);
    assert_eq!(shown.exits(0).out, made);
}

/// A program twenty times as long takes no more memory: its lines pass, and nothing grows beside them.
#[test]
#[cfg(target_os = "linux")]
fn memory_does_not_grow_with_the_program() {
    use std::io::Read as _;
    let folder = Folder::new();
    let (program, transform) = (folder.path("long.nc"), folder.file("t.json", QUARTER));
    let peak_kb = |megabytes: usize| {
        let cut = "G1 X10.5 Y-20.25 Z3. F400\r\nX11. Y-20. Z2.5\r\n";
        let cuts = megabytes * 1_000_000 / cut.len();
        std::fs::write(&program, format!("G21 G90 G54\r\n{}", cut.repeat(cuts))).unwrap();
        let mut rewrite = command(&[
            "nc",
            "rewrite",
            &program,
            "-o",
            "-",
            "--transform",
            &transform,
        ])
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
        let mut out = rewrite.stdout.take().unwrap();
        // Nearly all has come, and the command waits for somebody to take the rest.
        let mut most = vec![0; megabytes * 900_000];
        out.read_exact(&mut most).unwrap();
        let status = std::fs::read_to_string(format!("/proc/{}/status", rewrite.id())).unwrap();
        std::io::copy(&mut out, &mut std::io::sink()).unwrap();
        assert!(rewrite.wait().unwrap().success());
        let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let peak = peak
            .and_then(|peak| peak.trim().strip_suffix(" kB"))
            .unwrap();
        peak.parse::<u64>().unwrap()
    };
    let (short, long) = (peak_kb(1), peak_kb(20));
    // Pages come and go; the program has grown by 19 MB.
    assert!(long < short + 1000, "{short} kB, then {long} kB");
}

/// The identity changes no byte.
#[test]
fn the_identity_changes_nothing() {
    let folder = Folder::new();
    let program = folder.file("p.nc", PROGRAM);
    let same = r#"{"rotation": [[1,0,0],[0,1,0],[0,0,1]], "translation_mm": [0,0,0]}"#;
    let (same, out) = (folder.file("same.json", same), folder.path("out.nc"));
    umi(&["nc", "rewrite", &program, "-o", &out, "--transform", &same]).exits(0);
    assert_eq!(std::fs::read_to_string(&out).unwrap(), PROGRAM);
}

/// What cannot be transformed is refused by line, and no file appears.
#[test]
fn a_refused_path_is_not_written() {
    let folder = Folder::new();
    let bad = folder.file("bad.nc", PROGRAM.replace("G1 X20.", "G1 X#101"));
    let (transform, out) = (folder.file("t.json", QUARTER), folder.path("out.nc"));
    let args = ["nc", "rewrite", &bad, "-o", &out, "--transform", &transform];
    umi(&args)
        .exits(2)
        .says("line 5, column 4: X has a value that only the control knows");
    assert!(!std::path::Path::new(&out).exists());
    let error = umi(&[&args[..], &["--json"]].concat()).exits(2).json();
    assert_eq!(error["error"]["line"], 5);
    umi(&["nc", "rewrite", &bad, "-o", &out])
        .exits(1)
        .says("--verdict");
    let skewed = folder.file("s.json", QUARTER.replace("-1", "-1.01"));
    umi(&["nc", "rewrite", &bad, "-o", &out, "--transform", &skewed])
        .exits(1)
        .says("orthogonal");
}

/// The last verdict of a replay moves the path; one that is NG moves nothing.
#[test]
fn a_verdict_moves_the_path() {
    let folder = Folder::new();
    let program = folder.file("p.nc", PROGRAM);
    let session = project("tests/reference/sessions/session_a.txt");
    let job = project("examples/three-spheres.toml");
    let replay = umi(&["replay", &session, "--job", &job, "--json"]).out;
    let verdicts = folder.file("v.jsonl", &replay);
    let out = folder.path("out.nc");
    let ran = umi(&[
        "nc",
        "rewrite",
        &program,
        "-o",
        &out,
        "--verdict",
        &verdicts,
    ])
    .exits(0);
    assert!(ran.out.contains("1 line"), "{}", ran.out);
    let made = std::fs::read_to_string(&out).unwrap();
    assert!(made.contains("(VERDICT OK - V - SETUP 4)"), "{made}");
    let bad = folder.file("bad.jsonl", replay.replace("\"OK\"", "\"NG\""));
    umi(&["nc", "rewrite", &program, "-o", &out, "--verdict", &bad])
        .exits(2)
        .says("NG");
}

/// A rapid that only a leaning part keeps from being carried: the option is for that part, and a
/// level one needs none.
#[test]
fn a_check_offers_no_option_that_is_not_needed() {
    let folder = Folder::new();
    let program = folder.file(
        "p.nc",
        "G90 G21 G17 G54\nG0 X0. Y0.\nZ9.\nG1 Z-1. F9\nM30\n",
    );
    let ran = umi(&["nc", "check", &program]).exits(0);
    for says in [
        "p.nc only where the part leans: line 2, column 4: where Z is",
        "(--allow-rapids, where it does lean)",
        "0 reasons against rewriting it, 1 only where the part leans",
    ] {
        assert!(ran.out.contains(says), "{says}: {}", ran.out);
    }
    let lines = umi(&["nc", "check", &program, "--json"])
        .exits(0)
        .json_lines();
    assert_eq!(lines[0]["only_leaning"], true);
    assert_eq!(lines[0]["option"], "--allow-rapids");
    let level = r#"{"rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "translation_mm": [1, 2, 3]}"#;
    let level = folder.file("level.json", level);
    let ran = umi(&["nc", "check", &program, "--transform", &level]).exits(0);
    assert!(!ran.out.contains("--allow-rapids"), "{}", ran.out);
}

/// A check lists every reason, and tells what only a leaning part brings.
#[test]
fn a_check_lists_all_reasons() {
    let folder = Folder::new();
    let good = folder.file("p.nc", PROGRAM);
    let ran = umi(&["nc", "check", &good]).exits(0);
    assert!(
        ran.out
            .contains("0 reasons against rewriting it, also where the part leans")
    );
    let bad = "G21 G90 G0 X0. Y0. Z0.\nG41 D1 G1 X1. F9\nG40 X0.\nG68 R5.\nG1 X#1\n";
    let bad = folder.file("bad.nc", bad);
    let ran = umi(&["nc", "check", &bad]).exits(2);
    for says in [
        "line 4, column 1: G68",
        "line 5, column 4: X",
        "line 2, column 1: the transform tilts",
        "2 reasons",
        "1 only where the part leans",
    ] {
        assert!(ran.out.contains(says), "{says}: {}", ran.out);
    }
    let lines = umi(&["nc", "check", &bad, "--json"]).exits(2).json_lines();
    let end = lines.last().unwrap();
    assert_eq!(
        (&end["refusals"], &end["refusals_only_leaning"]),
        (&2.into(), &1.into())
    );
}

/// A rewritten program has every motion's image, chords of arcs included; one number that is
/// off is found, with its lines and by how much; the page shows it.
#[test]
fn a_difference_is_found() {
    let folder = Folder::new();
    let program = project("tests/nc/06-arcs-three-planes.nc");
    let lean =
        r#"{"rotation": [[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]], "translation_mm": [1, 2, 3]}"#;
    let (transform, out, page) = (
        folder.file("t.json", lean),
        folder.path("out.nc"),
        folder.path("diff.html"),
    );
    let rewrite = ["nc", "rewrite", &program, "-o", &out];
    umi(&[&rewrite[..], &["--transform", &transform]].concat()).exits(0);
    let diff = ["nc", "diff", &program, &out, "--transform", &transform];
    let same = umi(&[&diff[..], &["--json"]].concat()).exits(0).json();
    assert_eq!(same["complete"], true);
    assert_eq!(same["matched"], same["moves_a"]);
    assert!(same["moves_b"].as_u64() > same["moves_a"].as_u64());
    let mm =
        |value: &serde_json::Value, which: &str| value[which]["deviation_mm"].as_f64().unwrap();
    assert!(mm(&same, "largest_end") < 0.0009 && mm(&same, "largest_way") < 0.0101);

    // The end of the last motion, 0.02 mm off: near enough to be meant.
    let made = std::fs::read_to_string(&out).unwrap();
    let last = made.lines().rfind(|line| line.contains('X')).unwrap();
    let number = last
        .split('X')
        .nth(1)
        .unwrap()
        .split([' ', 'Y', 'Z'])
        .next()
        .unwrap();
    let moved = format!("X{:.3}", number.parse::<f64>().unwrap() + 0.02);
    let wrong = last.replacen(&format!("X{number}"), &moved, 1);
    std::fs::write(&out, made.replace(last, &wrong)).unwrap();
    let off = umi(&[&diff[..], &["--json", "-o", &page]].concat())
        .exits(0)
        .json();
    assert!((mm(&off, "largest_end") - 0.02).abs() < 0.0011, "{off}");
    let line = 1 + made.lines().position(|line| line == last).unwrap();
    assert_eq!(off["largest_end"]["line_b"], line);
    assert!(std::fs::read_to_string(&page).unwrap().contains("<svg"));

    // Another place is no image; one motion less is missed.
    std::fs::write(&out, made.replace(&format!("{last}\n"), "")).unwrap();
    let ran = umi(&diff).exits(2);
    assert!(ran.out.contains("not found"), "{}", ran.out);
}
