//! `umi replay` of a captured session.

use crate::rig::run::{Folder, project, umi};

/// The session that ships for the job to begin with: taught in its first run, corrected in its
/// second, and the correction is for that run alone.
#[test]
fn the_first_job_comes_to_ok() {
    let args = [
        "replay",
        &project("examples/four-spheres.txt"),
        "--job",
        &project("examples/four-spheres.toml"),
    ];
    let said = umi(&args).exits(0).out;
    for words in [
        "this clamping is the reference",
        "measured in run 2",
        "G55 = G54 +4.000 -3.000 0.000 mm, rotation +0.500",
    ] {
        assert!(said.contains(words), "no {words:?} in\n{said}");
    }
    assert!(!said.contains("not guarded"), "{said}");
    let json = umi(&[args.as_slice(), &["--json"]].concat()).exits(0).out;
    assert!(json.contains("IF[#531EQ2]GOTO7"), "{json}");
}

/// A text that came twice is told in a few lines; machines get each of its faults.
#[test]
fn a_text_that_came_twice_is_no_page_of_faults() {
    let folder = Folder::new();
    let job = project("examples/four-spheres.toml");
    let text = std::fs::read_to_string(project("examples/four-spheres.txt")).unwrap();
    let run: String = text
        .lines()
        .take(45)
        .map(|line| format!("{line}\n"))
        .collect();
    let twice = folder.file("twice.txt", run.repeat(2));
    let all = umi(&["replay", &twice, "--job", &job, "--json"])
        .exits(0)
        .out;
    assert_eq!(all.matches("\"code\":\"repeat\"").count(), 45, "{all}");
    let told = umi(&["replay", &twice, "--job", &job]).exits(0);
    assert_eq!(told.out.matches("came again").count(), 4, "{}", told.out);
    let rest = "42 faults more of this kind (all by --json), the last: line 90 ";
    assert!(told.out.contains(rest), "{}", told.out);
}
