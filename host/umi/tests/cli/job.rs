//! `umi job check`

use crate::run::{Folder, project, umi, umi_reads};

fn example() -> String {
    std::fs::read_to_string(project("examples/three-spheres.toml")).unwrap()
}

/// The example job is good: shown in words, and as JSON with all its fields.
#[test]
fn the_example_is_good() {
    let file = project("examples/three-spheres.toml");
    let text = umi(&["job", "check", &file]).exits(0).out;
    for words in [
        "job THREE SPHERES",
        "SPHERE3",
        "12.7 mm",
        "g10-g68",
        "can be used",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
    let value = umi(&["job", "check", &file, "--json"]).exits(0).json();
    assert_eq!(value["status"], "ok");
    assert_eq!(value["job"]["features"][2]["name"], "SPHERE3");
    assert_eq!(value["job"]["limits"]["tilt_deg"], 0.010);
}

/// A fault is refused with file, line, column, the line itself and what is allowed.
#[test]
fn a_fault_is_shown_in_its_line() {
    let folder = Folder::new();
    let text = example().replace("tilt_deg = 0.010 ", "tilt_deg = -1.0 ");
    let line = text
        .lines()
        .position(|l| l.starts_with("tilt_deg"))
        .unwrap()
        + 1;
    let file = folder.file("bad.toml", &text);
    umi(&["job", "check", &file])
        .exits(2)
        .says(&format!("{file}:{line}:1: "))
        .says("`limits.tilt_deg` cannot be -1")
        .says(&format!("{line} | tilt_deg = -1.0"));
    let error = umi(&["job", "check", &file, "--json"]).exits(2).json()["error"].clone();
    assert_eq!(error["code"], "bad_value");
    assert_eq!(
        (&error["line"], &error["column"]),
        (&line.into(), &1.into())
    );
    assert_eq!(error["file"], *file);
}

/// A misspelt name is refused with the names that there are; also from standard input.
#[test]
fn a_misspelt_name_is_refused_with_those_that_exist() {
    let text = example().replace("hits = 5", "hit = 5");
    let ran = umi_reads(text.as_bytes(), &["job", "check", "-"]).exits(2);
    ran.says("standard input:").says("`hit`").says("`hits`");
}

/// A file that is not there is no refusal: status 1.
#[test]
fn a_missing_job_is_named() {
    umi(&["job", "check", "/nowhere/job.toml"])
        .exits(1)
        .says("/nowhere/job.toml");
}
