//! `umi replay` of a captured session.

use crate::rig::run::{project, umi};

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
