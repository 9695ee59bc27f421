//! What the tool makes of input that is dressed differently, wrong, or not there.

use crate::rig::run::{Folder, project, umi, umi_reads, umi_with};

const FOUR: &str = "1,0,0\n-1,0,0\n0,1,0\n0,0,1\n";

/// Points come from standard input as from a file.
#[test]
fn points_come_from_standard_input() {
    let value = umi_reads(FOUR.as_bytes(), &["fit", "sphere", "-", "--json"])
        .exits(0)
        .json();
    assert!((value["radius_mm"].as_f64().unwrap() - 1.0).abs() < 1e-9);
    assert!(value["sigma_mm"].is_null());
}

/// Spreadsheet dress, byte order mark and comments in another code change no digit.
#[test]
fn dress_changes_no_digit() {
    let plain = umi_reads(FOUR.as_bytes(), &["fit", "sphere", "-", "--json"])
        .exits(0)
        .out;
    for dressed in [
        "\u{FEFF}x;y;z\r\n1;0;0\r\n-1;0;0\r\n0;1;0\r\n0;0;1\r\n"
            .as_bytes()
            .to_vec(),
        b"# gemessen f\xFCr die Probe\n1\t0\t0\n-1\t0\t0\n0\t1\t0\n0\t0\t1".to_vec(),
        b"n,z,y,x\n1,0,0,1\n2,0,0,-1\n3,0,1,0\n4,1,0,0\n".to_vec(),
    ] {
        let ran = umi_reads(&dressed, &["fit", "sphere", "-", "--json"]).exits(0);
        assert_eq!(ran.out, plain);
    }
}

/// No points, only a header, or too few are refused by the fit: status 2, by name.
#[test]
fn an_empty_file_has_too_few_points() {
    for text in ["", "x,y,z\n", "# nothing\n", "1,2,3\n"] {
        let ran = umi_reads(text.as_bytes(), &["fit", "plane", "-", "--json"]).exits(2);
        assert_eq!(ran.json()["error"]["code"], "too_few_points", "{text:?}");
    }
}

/// NaN and infinity reach the fit, which refuses them and names the point.
#[test]
fn what_is_not_finite_is_refused_by_name() {
    for bad in ["nan", "inf", "-inf", "1e999"] {
        let text = format!("{FOUR}1,{bad},2\n");
        let ran = umi_reads(text.as_bytes(), &["fit", "sphere", "-", "--json"]).exits(2);
        let error = &ran.json()["error"];
        assert_eq!(error["code"], "not_finite", "{bad}");
        assert!(
            error["message"].as_str().unwrap().contains("point 5"),
            "{error}"
        );
    }
}

/// A line that is not understood ends the run with its number; nothing is fitted.
#[test]
fn a_bad_line_is_named() {
    let text = "x,y,z\n1,0,0\n-1,0,0\n0,1\n0,0,1\n1,1,1\n";
    let ran = umi_reads(text.as_bytes(), &["fit", "sphere", "-"]).exits(1);
    let ran = ran.says("standard input, line 4: 2 columns");
    assert!(ran.out.is_empty());
    let ran = umi_reads(text.as_bytes(), &["fit", "sphere", "-", "--json"]).exits(1);
    assert_eq!(ran.json()["error"]["code"], "bad_row");
    assert_eq!(ran.json()["error"]["line"], 4);
    assert!(ran.err.is_empty(), "{}", ran.err);
}

/// Text in another code than ASCII or UTF-8 is named as such.
#[test]
fn wide_text_is_named() {
    let wide: Vec<u8> = "\u{FEFF}1,2,3\n"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    umi_reads(&wide, &["fit", "sphere", "-"])
        .exits(1)
        .says("UTF-16");
}

/// A file that is not there: status 1, the file is named, in JSON too.
#[test]
fn a_missing_file_is_named() {
    umi(&["fit", "sphere", "/nowhere/points.csv"])
        .exits(1)
        .says("/nowhere/points.csv");
    let ran = umi(&["register", "/nowhere/pairs.csv", "--json"]).exits(1);
    assert_eq!(ran.json()["error"]["code"], "file");
}

/// Lists of different length are refused, not cut.
#[test]
fn lists_of_different_length_are_refused() {
    let folder = Folder::new();
    let four = folder.file("four.csv", FOUR);
    let three = folder.file("three.csv", "1,0,0\n-1,0,0\n0,1,0\n");
    let ran = umi(&["register", &four, &three, "--json"]).exits(2);
    assert_eq!(ran.json()["error"]["code"], "length_mismatch");
}

/// Both lists cannot come from standard input, and three columns are no pairs.
#[test]
fn one_list_is_not_two() {
    umi(&["register", "-", "-"])
        .exits(1)
        .says("one of the two lists");
    umi_reads(FOUR.as_bytes(), &["register", "-"])
        .exits(1)
        .says("px, py, pz, qx, qy, qz");
}

/// Wrong use is status 1, not clap's 2 which here means a refusal.
#[test]
fn wrong_use_has_status_one() {
    for args in [
        &["fit", "ball", "x.csv"][..],
        &["fit", "sphere"],
        &["nonsense"],
        &[],
        &["register", "a.csv", "--at", "1,2"],
        &["log", "a.umij", "-o", "b.umij"],
    ] {
        let ran = umi(args).exits(1);
        assert!(!ran.err.is_empty() && ran.out.is_empty(), "{args:?}");
    }
    umi(&["fit", "ball", "x.csv"]).says("cylinder");
}

/// Help and version are no errors.
#[test]
fn help_and_version_have_status_zero() {
    let version = umi(&["--version"]).exits(0).out;
    assert!(
        version.starts_with("umi ") && version.contains('.'),
        "{version}"
    );
    umi(&["--help"]).exits(0);
    umi(&["help", "fit"]).exits(0);
}

/// Output that is no terminal has no colour codes, unless asked for; never with NO_COLOR.
#[test]
fn colour_is_for_terminals() {
    let points = project("tests/reference/fits/sphere_five_1um.csv");
    let args = ["fit", "sphere", points.as_str()];
    assert!(!umi(&args).exits(0).out.contains('\u{1b}'));
    assert!(
        umi_with(("CLICOLOR_FORCE", "1"), &args)
            .out
            .contains('\u{1b}')
    );
    assert!(!umi_with(("NO_COLOR", "1"), &args).out.contains('\u{1b}'));
}

/// A reader that goes away, as `head` does, is no error and no panic.
#[test]
#[cfg(unix)]
fn a_reader_may_go_away() {
    use std::process::{Command, Stdio};
    let points: String = (0..60)
        .map(|n| format!("{n},{},{}\n", n * n % 7, n % 11))
        .collect();
    let folder = Folder::new();
    let file = folder.file("points.csv", points);
    let mut child = Command::new(env!("CARGO_BIN_EXE_umi"))
        .args(["fit", "plane", &file])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert!(output.stderr.is_empty());
}

/// `--json` and `--port` stand before a command or behind it, also where it fails.
#[test]
fn global_options_stand_anywhere() {
    let behind = umi_reads(FOUR.as_bytes(), &["fit", "sphere", "-", "--json"]).exits(0);
    let before = umi_reads(FOUR.as_bytes(), &["--json", "fit", "sphere", "-"]).exits(0);
    assert_eq!(behind.out, before.out);
    for args in [
        ["--json", "info", "--port", "nowhere"],
        ["--port", "nowhere", "info", "--json"],
        ["--json", "--port", "nowhere", "info"],
    ] {
        let error = umi(&args).exits(1).json();
        assert_eq!(error["error"]["code"], "no_such_port", "{args:?}");
    }
}
