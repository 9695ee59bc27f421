//! `umi demo`: what it prints and what it leaves behind.

use crate::rig::run::{Folder, umi};

/// The figures of the surface, every table of the thesis and the maps are there, with a
/// journal and the corrections; the spread over seeds where there is more than one.
#[test]
fn the_demo_shows_the_experiment() {
    let folder = Folder::new();
    let out = folder.path("demo");
    let ran = umi(&[
        "demo",
        "--stepover-mm",
        "0.5",
        "--seeds",
        "2",
        "--out",
        &out,
    ])
    .exits(0);
    for text in [
        "thesis, cases 1-4 against 0, table 5.1",
        "corrected, cases 1-4 against 0",
        "corrected, section 4",
        "uncorrected, whole",
        "spread",
        "replayed identical to the last bit",
    ] {
        assert!(ran.out.contains(text), "no {text:?} in {}", ran.out);
    }
    let page = std::fs::read_to_string(folder.path("demo/report.html")).unwrap();
    for text in [
        "Table 4.1",
        "Table 4.2",
        "Table 5.1",
        "Table 5.2",
        "Table 5.3",
        "Table 5.4",
        "Table 5.5",
        "Corrected, in detail",
        "Not corrected, in detail",
        "other seeds",
        "id=\"setup-4\"",
    ] {
        assert!(page.contains(text), "no {text:?} in the report");
    }
    for case in 1..=4 {
        let path = folder.path(&format!("demo/case-{case}-correction.nc"));
        let program = std::fs::read_to_string(path).unwrap();
        assert!(program.contains("G68 X") && program.contains("G10 L2 P2"));
    }
    for case in 0..=4 {
        let path = folder.path(&format!("demo/case-{case}-finish.nc"));
        let program = std::fs::read_to_string(path).unwrap();
        assert_eq!(program.contains("M98 P9010"), case > 0);
    }
    // What lies there can be run again by hand.
    let file = |name: &str| folder.path(&format!("demo/{name}"));
    let (plate, sphere) = (file("plate.nc"), file("sphere.nc"));
    let (scene, job) = (file("scene.toml"), file("job.toml"));
    let again = [
        "machine",
        "run",
        &plate,
        "--load",
        &sphere,
        "--scene",
        &scene,
        "--board",
        "virtual",
        "--job",
        &job,
        "--set",
        "101=-135",
        "--set",
        "#102=-137",
        "--set",
        "103=160",
    ];
    assert!(umi(&again).exits(0).out.contains("the reference"));
    // The journal replays by itself.
    let journal = folder.path("demo/journal.umij");
    umi(&["replay", &journal]).exits(0);
    // The correction that the board made, from its journal (it has no key), to the letter; and in the words
    // of a control that can express the tilt.
    for setup in [1, 4] {
        let number = setup.to_string();
        let made = umi(&[
            "correction",
            "--unsigned",
            "--verdict",
            &journal,
            "--plate",
            &number,
        ])
        .exits(0)
        .out;
        let verdicts = umi(&["replay", &journal, "--json"]).exits(0).out;
        let sent = verdicts
            .lines()
            .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap())
            .rfind(|v| v["type"] == "verdict" && v["plate"] == setup)
            .unwrap();
        assert_eq!(sent["correction"]["text"], made);
        // Nobody owned the board that reached it.
        assert_eq!(sent["access"], "open");
        let args = [
            "correction",
            "--unsigned",
            "--verdict",
            &journal,
            "--plate",
            &number,
            "--json",
        ];
        let better = umi(&[&args[..], &["--dialect", "g68-3d"]].concat())
            .exits(0)
            .json();
        let left = |value: &serde_json::Value| value["leftover_mm"].as_f64().unwrap();
        assert!(left(&better) < left(&sent["correction"]) && left(&better) < 0.002);
    }
    umi(&[
        "correction",
        "--unsigned",
        "--verdict",
        &journal,
        "--plate",
        "0",
    ])
    .exits(2)
    .says("taught");
}

/// For machines: each decision, each surface, and where the report is.
#[test]
fn the_demo_for_machines() {
    let folder = Folder::new();
    let out = folder.path("demo");
    let args = ["demo", "--ideal", "--seed", "7", "--json", "--out", &out];
    let lines = umi(&args).exits(0).json_lines();
    let of = |kind: &str| -> Vec<_> { lines.iter().filter(|l| l["type"] == kind).collect() };
    assert_eq!(of("feature").len(), 15);
    assert_eq!(of("verdict").len(), 5);
    assert_eq!(of("plate_surface").len(), 5);
    let surfaces = of("surface");
    let [corrected, uncorrected] = surfaces.as_slice() else {
        panic!("{surfaces:?}");
    };
    assert_eq!(corrected["seed"], 7);
    let whole = &corrected["whole"];
    assert!(whole["max_mm"].as_f64().unwrap() < 0.002, "{whole}");
    assert!(whole["min_mm"].as_f64().unwrap() > -0.002, "{whole}");
    assert!(uncorrected["whole"]["share_uncut"].as_f64().unwrap() > 0.2);
    assert!(uncorrected["whole"]["std_mm"].as_f64().unwrap() > 0.4);
    let against = &corrected["cases_1_to_4_against_case_0"];
    assert!(against["std_mm"].as_f64().unwrap() < 0.001, "{against}");
    assert_eq!(of("demo").len(), 1);
}

/// A stepover that makes no path is refused before anything is written.
#[test]
fn a_wrong_stepover_is_refused() {
    let folder = Folder::new();
    let out = folder.path("demo");
    umi(&["demo", "--stepover-mm", "0", "--out", &out])
        .exits(1)
        .says("from 0.05 to 4 mm");
    assert!(!std::path::Path::new(&out).exists());
}

/// The long one is tried by hand; here, that nothing of an older run is lost before it begins.
#[test]
fn demo_localise_replaces_nothing_unasked() {
    let folder = Folder::new();
    let page = folder.path("stock.html");
    std::fs::write(&page, "mine").unwrap();
    let ran = umi(&["demo", "localise", "--out", &folder.path("")]).exits(1);
    assert!(ran.err.contains("is there already"), "{}", ran.err);
    assert_eq!(std::fs::read_to_string(&page).unwrap(), "mine");
}
