//! One rule for what commands write: a file that is there is replaced with `--force` only, and
//! what is read never.

use crate::rig::run::{Folder, project, umi};

const PROGRAM: &str = "G21 G90\nG0 X10. Y0. Z5.\nM30\n";
const QUARTER: &str =
    r#"{"rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "translation_mm": [1, 0, 0]}"#;

/// The input is never replaced, by whatever name it is meant; another file with --force only.
#[test]
fn what_is_read_is_never_replaced() {
    let folder = Folder::new();
    let (program, transform) = (folder.file("p.nc", PROGRAM), folder.file("t.json", QUARTER));
    let dotted = format!("{}/./p.nc", folder.path("").trim_end_matches('/'));
    let hard = folder.path("hard.nc");
    std::fs::hard_link(&program, &hard).unwrap();
    let mut others = vec![program.clone(), dotted, hard, transform.clone()];
    if cfg!(unix) {
        let soft = folder.path("soft.nc");
        #[cfg(unix)]
        std::os::unix::fs::symlink(&program, &soft).unwrap();
        others.push(soft);
    }
    let rewrite = |out: &str, more: &[&str]| {
        let args = ["nc", "rewrite", &program, "-o", out];
        umi(&[&args[..], &["--transform", &transform], more].concat())
    };
    for out in &others {
        for more in [&[][..], &["--force"]] {
            rewrite(out, more).exits(1).says("which is read");
        }
    }
    assert_eq!(std::fs::read_to_string(&program).unwrap(), PROGRAM);
    assert_eq!(std::fs::read_to_string(&transform).unwrap(), QUARTER);

    let out = folder.file("out.nc", "mine");
    rewrite(&out, &[])
        .exits(1)
        .says("is there already")
        .says("--force");
    assert_eq!(std::fs::read_to_string(&out).unwrap(), "mine");
    rewrite(&out, &["--force"]).exits(0);
    assert!(
        std::fs::read_to_string(&out)
            .unwrap()
            .contains("G0 X1. Y10. Z5.")
    );
    // Nothing is left beside it.
    let left: Vec<_> = std::fs::read_dir(folder.path(""))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.contains("part"))
        .collect();
    assert!(left.is_empty(), "{left:?}");
    // A device is no file that could be lost.
    if cfg!(unix) {
        rewrite("/dev/null", &[]).exits(0);
        assert!(!std::fs::metadata("/dev/null").unwrap().is_file());
    }
}

/// Every command that writes a file keeps the rule.
#[test]
fn every_command_asks() {
    let folder = Folder::new();
    let (program, transform) = (folder.file("p.nc", PROGRAM), folder.file("t.json", QUARTER));
    let there = folder.file("there", "mine");
    let demo = folder.path("demo");
    std::fs::create_dir(&demo).unwrap();
    std::fs::write(format!("{demo}/report.html"), "mine").unwrap();
    let scene = project("examples/scenes/three-spheres.toml");
    let commands: &[&[&str]] = &[
        &[
            "nc",
            "rewrite",
            &program,
            "--transform",
            &transform,
            "-o",
            &there,
        ],
        &["nc", "diff", &program, &program, "-o", &there],
        &[
            "machine", "run", &program, "--scene", &scene, "--serial", &there,
        ],
        &["job", "get", "-o", &there],
        &["log", "-o", &there],
        &["events", "-o", &there],
        &["program", "get", "7", "-o", &there],
        &["demo", "--out", &demo],
        &["scan", "stock", &program, &program, "-o", &there],
        &["scan", "stock", &program, &program, "--map", &there],
        &[
            "scan", "localise", &program, "--part", &program, "-o", &there,
        ],
        &["scan", "plan", &program, "--spec", &program, "-o", &there],
        &[
            "scan",
            "points",
            &program,
            "--calibration",
            &program,
            "-o",
            &there,
        ],
    ];
    for command in commands {
        umi(command)
            .exits(1)
            .says("is there already")
            .says("--force");
    }
    assert_eq!(std::fs::read_to_string(&there).unwrap(), "mine");
}
