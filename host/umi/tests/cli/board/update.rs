//! Signed updates: `umi image`, `umi update`, by the codes and the exit statuses that programs rest
//! on.

use std::io::Write as _;
use std::net::TcpStream;

use serde_json::{Value, json};

use super::access::{Rig, code};
use crate::rig::run::umi;

const WORKS: &str = "umi-virtual-image\nconfirms = true\n";
const FAILS: &str = "umi-virtual-image\nconfirms = false\n";

/// A board that has the maker's key.
fn rig() -> Rig {
    let mut rig = Rig::new(false);
    rig.stop();
    std::fs::remove_dir_all(rig.folder.path("state")).unwrap();
    for name in ["fw", "forger"] {
        umi(&["key", "new", &rig.folder.path(name), "--no-passphrase"]).exits(0);
    }
    rig.more = vec!["--firmware-key".to_owned(), rig.folder.path("fw.pub")];
    rig.start(false);
    rig
}

/// A signed image: its file.
fn image(rig: &Rig, payload: &str, version: &str, counter: u32, by: &str, board: &str) -> String {
    let text = rig.folder.file("payload.txt", payload.as_bytes());
    let file = rig
        .folder
        .path(&format!("{board}-{version}-{counter}-{by}.umif"));
    let (key, counter) = (rig.folder.path(by), counter.to_string());
    umi(&[
        "image",
        "sign",
        &text,
        "--board",
        board,
        "--version",
        version,
        "--counter",
        &counter,
        "--key",
        &key,
        "-o",
        &file,
        "--json",
        "--force",
    ])
    .exits(0);
    file
}

fn shown(rig: &Rig) -> Value {
    rig.run(&["info"]).exits(0).json()["image"].clone()
}

/// An image is taken, tried and kept, over restarts; one that does not confirm itself is gone.
#[test]
fn an_image_is_tried_before_it_counts() {
    let mut rig = rig();
    let new = shown(&rig);
    assert_eq!(new["slot"], "built_in");
    assert_eq!(new["confirmed"], true);
    assert_eq!(new["sha512"], Value::Null);

    let first = image(&rig, WORKS, "1.0.0", 1, "fw", "virtual");
    let told = rig.run(&["update", &first]).exits(0).json();
    let from = new["version"].as_str().unwrap();
    assert_eq!(
        told,
        json!({"from": from, "to": "1.0.0", "state": "confirmed"})
    );
    let sha512 = umi(&["image", "show", &first, "--json"]).exits(0).json()["sha512"].clone();
    let runs = shown(&rig);
    let expected = json!({
        "version": "1.0.0", "counter": 1, "slot": "a", "confirmed": true, "sha512": sha512,
    });
    assert_eq!(runs, expected);
    // What it tells of itself is what was signed.
    let info = rig.run(&["info"]).exits(0).json();
    assert_eq!(info["board"]["firmware"], "1.0.0");
    // Heads name the image that they were signed under. The board signs when its inputs have been quiet for a while.
    let first_half = &sha512.as_str().unwrap()[..64];
    let is_signed = |rig: &Rig| {
        let told = rig.run(&["log"]).exits(0).json_lines();
        told.iter()
            .any(|of| of["type"] == "head" && of["image"] == first_half)
    };
    assert!((0..100).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(100));
        is_signed(&rig)
    }));

    let fails = image(&rig, FAILS, "1.1.0", 2, "fw", "virtual");
    assert_eq!(code(rig.run(&["update", &fails])), "image_not_confirmed");
    assert_eq!(shown(&rig), expected);
    // The key that a state has taken stays.
    rig.more[1] = rig.folder.path("forger.pub");
    rig.start(false);
    assert_eq!(shown(&rig), expected);
    let second = image(&rig, WORKS, "1.1.0", 2, "fw", "virtual");
    rig.run(&["update", &second]).exits(0);
    assert_eq!(shown(&rig)["slot"], "b");

    let told = rig.run(&["log"]).exits(0).json_lines();
    let of = |kind: &str| {
        let found = told.iter().filter(|of| of["type"] == kind);
        found.cloned().collect::<Vec<_>>()
    };
    let updates: Vec<_> = of("update")
        .iter()
        .map(|of| format!("{} {} {}", of["what"], of["from"], of["to"]).replace('"', ""))
        .collect();
    let expected = [
        format!("trial {from} 1.0.0"),
        format!("confirmed {from} 1.0.0"),
        "trial 1.0.0 1.1.0".to_owned(),
        "reverted 1.0.0 1.1.0".to_owned(),
        "trial 1.0.0 1.1.0".to_owned(),
        "confirmed 1.0.0 1.1.0".to_owned(),
    ];
    assert_eq!(updates, expected);
}

/// What is wrong with an image has its code, and what runs stays.
#[test]
fn what_is_wrong_with_an_image_is_named() {
    let rig = rig();
    let good = image(&rig, WORKS, "2.0.0", 5, "fw", "virtual");
    rig.run(&["update", &good]).exits(0);
    let runs = shown(&rig);

    let long = format!("{WORKS}{}", "x".repeat(700_000));
    for (payload, version, counter, by, board, expected) in [
        (WORKS, "3.0.0", 6, "forger", "virtual", "image_signature"),
        (WORKS, "3.0.0", 6, "fw", "pico", "image_board"),
        (WORKS, "1.9.9", 6, "fw", "virtual", "image_rollback"),
        (WORKS, "3.0.0", 4, "fw", "virtual", "image_rollback"),
        (long.as_str(), "3.0.0", 6, "fw", "virtual", "image_too_long"),
    ] {
        let file = image(&rig, payload, version, counter, by, board);
        assert_eq!(code(rig.run(&["update", &file])), expected);
        assert_eq!(shown(&rig), runs);
    }

    // A board that there cannot be.
    let (text, key) = (
        rig.folder.file("payload.txt", WORKS.as_bytes()),
        rig.folder.path("fw"),
    );
    for board in ["", "vir\ntual", "\u{1b}[31m"] {
        let out = rig.folder.path("none.umif");
        let args = [
            "image",
            "sign",
            &text,
            "--board",
            board,
            "--version",
            "1.0.0",
        ];
        let more = ["--counter", "1", "--key", &key, "-o", &out, "--json"];
        let refused = umi(&[&args[..], &more].concat()).exits(1).json();
        assert_eq!(refused["error"]["code"], "usage", "{board:?}");
        assert!(!std::path::Path::new(&out).exists());
    }

    let bytes = std::fs::read(image(&rig, WORKS, "3.0.0", 6, "fw", "virtual")).unwrap();
    // Magic, version, signature, payload; cut; longer.
    for (at, expected) in [
        (0, "image_damaged"),
        (29, "image_signature"),
        (140, "image_signature"),
        (200, "image_damaged"),
    ] {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1;
        let file = rig.folder.file("damaged.umif", &damaged);
        assert_eq!(code(rig.run(&["update", &file])), expected, "byte {at}");
    }
    for damaged in [
        &bytes[..100],
        &bytes[..bytes.len() - 1],
        &[&bytes[..], b"x"].concat()[..],
    ] {
        let file = rig.folder.file("damaged.umif", damaged);
        assert_eq!(code(rig.run(&["update", &file])), "image_damaged");
        assert_eq!(
            code(umi(&["image", "show", &file, "--json"])),
            "image_damaged"
        );
    }
    assert_eq!(shown(&rig), runs);
}

/// Of several files the board gets the one that is for it. Where none is, and one is for the place that runs,
/// the other place's is asked for.
#[test]
fn the_image_for_the_free_place_is_sent() {
    let rig = rig();
    let other = image(&rig, WORKS, "2.0.0", 5, "fw", "virtual-a");
    let good = image(&rig, WORKS, "2.0.0", 5, "fw", "virtual");
    rig.run(&["update", &other, &good]).exits(0);
    assert_eq!(shown(&rig)["slot"], "a");
    let refused = rig.run(&["update", &other]);
    let message = refused.json()["error"]["message"].to_string();
    assert!(message.contains("give the one for virtual-b"), "{message}");
    assert_eq!(code(refused), "image_board");
}

/// While a clamping is measured nothing is taken.
#[test]
fn a_board_that_measures_takes_no_image() {
    let rig = rig();
    let job = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../examples/three-spheres.toml"
    );
    rig.run(&["job", "set", job]).exits(0);
    let mut control = TcpStream::connect(rig.cnc.strip_prefix("tcp://").unwrap()).unwrap();
    // A clamping that has begun.
    let session = include_str!("../../../../../examples/session.txt");
    for line in session.lines().take(8) {
        control.write_all(format!("{line}\r\n").as_bytes()).unwrap();
    }
    let file = image(&rig, WORKS, "1.0.0", 1, "fw", "virtual");
    let hits = || rig.run(&["info"]).exits(0).json()["status"]["counters"]["hits"].clone();
    while hits() == 0 {}
    assert_eq!(code(rig.run(&["update", &file])), "board_busy");
}

/// A board with an owner takes an image from nobody else.
#[test]
fn an_owner_updates() {
    let mut rig = rig();
    rig.start(true);
    rig.enrol("anna", "owner", &[]).exits(0);
    let anna = rig.folder.path("anna");
    rig.enrol("ben", "engineer", &["--key", &anna]).exits(0);
    let file = image(&rig, WORKS, "1.0.0", 1, "fw", "virtual");
    assert_eq!(code(rig.run(&["update", &file])), "key_needed");
    assert_eq!(code(rig.as_of("ben", &["update", &file])), "role_too_low");
    rig.as_of("anna", &["access", "lock"]).exits(0);
    assert_eq!(code(rig.as_of("anna", &["update", &file])), "locked");
    rig.as_of("anna", &["access", "unlock"]).exits(0);
    rig.as_of("anna", &["update", &file]).exits(0);
    assert_eq!(shown(&rig)["version"], "1.0.0");
}
