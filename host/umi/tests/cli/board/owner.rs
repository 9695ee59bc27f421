//! What the owner of a board allows: `umi config`, `umi log ack`, and what is refused for it.

use std::sync::Arc;

use serde_json::{Value, json};
use umi_virtual::serve::{Port, PortPlace};
use umi_virtual::{BoardTime, Config, VirtualBoard};

use crate::rig::run::{Folder, Ran, project, umi};

fn start(config: &Config) -> (Arc<VirtualBoard>, String) {
    let board = Arc::new(VirtualBoard::start(config.clone()).unwrap());
    let port = Port::open(&PortPlace::Tcp(0)).unwrap();
    let address = port.address.clone();
    port.serve_host(&board);
    (board, address)
}

fn config() -> Config {
    Config {
        time: BoardTime::Real,
        ..Config::default()
    }
}

fn error(ran: Ran) -> Value {
    ran.exits(2).json()["error"].clone()
}

/// Fields are read, set, compared and applied; they hold after a restart, and what is wrong is
/// named.
#[test]
fn a_board_is_configured() {
    let (folder, config) = (Folder::new(), config());
    let (board, port) = start(&config);
    let get = ["config", "get", "--json", "--port", &port];
    let before = umi(&get).exits(0).json();
    assert_eq!(before["config"]["ceilings"]["always"], true);
    assert_eq!(before["config"]["journal"]["full"], "overwrite");
    assert_eq!(
        (&before["version"], &before["fallbacks"]),
        (&2.into(), &Value::Array(vec![]))
    );
    let access = serde_json::json!({
        "locked_reading": "operators", "session_idle_s": null, "button_off": false,
    });
    assert_eq!(before["config"]["access"], access);
    let set =
        |field: &str, value: &str| umi(&["config", "set", field, value, "--json", "--port", &port]);
    set("ceilings.rms_mm", "0.5").exits(0);
    let after = set("journal.full", "refuse").exits(0).json();
    assert_eq!(after["config"]["ceilings"]["rms_mm"], 0.5);
    assert_eq!(after["config"]["journal"]["full"], "refuse");
    for (field, value) in [
        ("ceilings.rms_mm", "-1"),
        ("ceilings.rms", "1"),
        ("journal.full", "x"),
        ("access.session_idle_s", "9"),
        ("access.locked_reading", "me"),
    ] {
        let error = error(set(field, value));
        assert_eq!(
            (&error["code"], &error["field"]),
            (&"config_field".into(), &field.into())
        );
    }
    let file = folder.path("board.toml");
    let text = umi(&["config", "get", "--port", &port]).exits(0).out;
    std::fs::write(&file, text.replace("0.5", "0.25")).unwrap();
    umi(&["config", "check", &file]).exits(0);
    let diff = ["config", "diff", &file, "--json", "--port", &port];
    let told = umi(&diff).exits(0).json();
    assert_eq!(told["same"], false);
    assert_eq!(told["differences"][0]["field"], "ceilings.rms_mm");
    umi(&["config", "apply", &file, "--port", &port]).exits(0);
    assert_eq!(umi(&diff).exits(0).json()["same"], true);
    drop(board);
    std::thread::sleep(std::time::Duration::from_millis(50));
    let (_board, port) = start(&config);
    let again = umi(&["config", "get", "--json", "--port", &port])
        .exits(0)
        .json();
    assert_eq!(again["config"]["ceilings"]["rms_mm"], 0.25);
    let listed = umi(&["log", "--json", "--port", &port])
        .exits(0)
        .json_lines();
    assert!(listed.iter().any(|of| of["type"] == "config_set"));
    let later = folder.file("later.toml", "version = 3\n[walls]\nheight_m = 2\n");
    let told = error(umi(&["config", "check", &later, "--json"]));
    assert_eq!(told["code"], "config_version");
    let bad = folder.file("bad.toml", "[ceilings]\nwide = 1\n");
    assert_eq!(
        error(umi(&["config", "check", &bad, "--json"]))["code"],
        "config_syntax"
    );
}

/// A job with a wider limit is refused, whoever sets it, and a ceiling below the job in force too;
/// so are jobs without a witness and programs without a verdict.
#[test]
fn nothing_passes_a_ceiling() {
    let (folder, config) = (Folder::new(), config());
    let (_board, port) = start(&config);
    let job = project("examples/three-spheres.toml");
    let set_job = || umi(&["job", "set", &job, "--json", "--port", &port]);
    let set =
        |field: &str, value: &str| umi(&["config", "set", field, value, "--json", "--port", &port]);
    set("ceilings.tilt_deg", "0.001").exits(0);
    let told = error(set_job());
    assert_eq!(told["code"], "beyond_ceiling");
    assert_eq!(
        (&told["field"], &told["ceiling"], &told["given"]),
        (&"limits.tilt_deg".into(), &0.001.into(), &0.010.into())
    );
    set("ceilings.tilt_deg", "none").exits(0);
    set("ceilings.require_witness", "true").exits(0);
    let told = error(set_job());
    assert_eq!(
        (&told["code"], &told["field"]),
        (&"beyond_ceiling".into(), &"require_witness".into())
    );
    set("ceilings.require_witness", "false").exits(0);
    set_job().exits(0);
    assert_eq!(
        error(set("ceilings.tilt_deg", "0.001"))["code"],
        "beyond_ceiling"
    );
    set("ceilings.always", "false").exits(0);
    let program = folder.file("O0009.nc", "%\nO0009\nM30\n%\n");
    let put = |release: &str| {
        umi(&[
            "program",
            "put",
            &program,
            "--release",
            release,
            "--json",
            "--port",
            &port,
        ])
    };
    assert_eq!(error(put("always"))["code"], "beyond_ceiling");
    put("after-verdict").exits(0);
}

/// Where the owner says so, nobody reads a board that is locked: no job, program, journal or
/// configuration, by whatever key. Who the board is and that it is locked is told all the same, also
/// behind a restart, and the owner unlocks it.
#[test]
fn nobody_reads_a_locked_board_where_its_owner_says_so() {
    let mut rig = super::access::Rig::claimed();
    let set = ["config", "set", "access.locked_reading", "nobody"];
    rig.as_of("anna", &set).exits(0);
    rig.as_of("anna", &["access", "lock"]).exits(0);
    for is_again in [false, true] {
        if is_again {
            rig.start(false);
        }
        for name in ["olga", "ben", "anna"] {
            for asked in [
                &["job", "show"][..],
                &["program", "list"],
                &["log"],
                &["config", "get"],
                &["log", "ack", "1"],
            ] {
                let told = error(rig.as_of(name, asked));
                assert_eq!(told["code"], "locked", "{name} {asked:?}");
            }
            let shown = rig.as_of(name, &["access", "show"]).exits(0).json();
            assert_eq!(shown["mode"], "locked");
            assert!(shown["keys"].is_null(), "{shown}");
            let info = rig.as_of(name, &["info"]).exits(0).json();
            assert_eq!(info["access"]["mode"], "locked");
            assert!(info["journal"].is_null(), "{info}");
        }
    }
    rig.as_of("anna", &["access", "unlock"]).exits(0);
    rig.as_of("olga", &["log"]).exits(0);
    let refused = rig.entries("olga", "access_refused");
    assert!(
        refused.iter().any(|of| of["why"] == "locked"),
        "{refused:?}"
    );
    let got = rig.as_of("olga", &["config", "get"]).exits(0).json();
    assert_eq!(got["config"]["access"]["locked_reading"], "nobody");
}

/// A board whose flash an earlier one has left.
fn left_by(folder: &str, names: &[&str]) -> super::access::Rig {
    let mut rig = super::access::Rig::new(false);
    rig.stop();
    for name in names {
        let file = rig.folder.path(&format!("state/{name}.flash"));
        let mut bytes = vec![0xFF; std::fs::metadata(&file).unwrap().len() as usize];
        let found = project(&format!("tests/reference/{folder}/{name}.flash"));
        let found = std::fs::read(found).unwrap();
        bytes[..found.len()].copy_from_slice(&found);
        std::fs::write(&file, bytes).unwrap();
    }
    rig.start(false);
    rig
}

/// A job that a board of protocol 2.24 has kept, with one probing sigma for the three axes, is in force on
/// this one, with its reference. Its journal is read as it was, and played again it comes to the same
/// verdicts to the last digit.
#[test]
fn one_sigma_of_before_is_taken_over() {
    let rig = left_by("kept-2.24", &["settings"]);
    let shown = rig.run(&["job", "show"]).exits(0).json();
    assert_eq!(shown["job"]["name"], "THREE OF 2-24");
    let probing = &shown["job"]["guards"]["probing"];
    assert_eq!(probing["sigma_mm"], json!([0.0012, 0.0012, 0.0012]));
    assert_eq!(probing["dof"], 24);
    assert_eq!(shown["job"]["guards"]["warmth"]["at_most_k"], 1.0);
    assert_eq!(shown["taught_mm"].as_array().unwrap().len(), 3);

    let file = project("tests/reference/kept-2.24/journal.umij");
    let listed = umi(&["log", &file, "--json"]).exits(0).json_lines();
    assert!(!listed.iter().any(|of| of["type"] == "unreadable"));
    let told: Vec<_> = listed.iter().filter(|of| of["type"] == "job_set").collect();
    assert_eq!(told.len(), 2, "{told:?}");
    for told in told {
        assert_eq!(told["job"]["guards"]["probing"], *probing);
    }
    umi(&["replay", &file]).exits(0);
}

/// What a board of protocol 2.23 has kept is in force on this one, and its journal is read as it was:
/// verified, with the configuration that it tells.
#[test]
fn a_board_of_before_is_taken_over() {
    let mut rig = left_by("kept", &["settings", "custody"]);
    let info = rig.run(&["info"]).exits(0).json();
    assert_eq!(info["status"]["job"], "THREE BY RUN", "{info}");
    assert_eq!(info["teachings"], 1);
    let got = rig.run(&["config", "get"]).exits(0).json();
    assert_eq!(got["fallbacks"], Value::Array(vec![]));
    assert_eq!(got["config"]["ceilings"]["rms_mm"], 0.5);
    assert_eq!(got["config"]["access"]["session_idle_s"], Value::Null);
    rig.run(&["config", "set", "access.session_idle_s", "600"])
        .exits(0);
    rig.start(false);
    let got = rig.run(&["config", "get"]).exits(0).json();
    assert_eq!(got["config"]["ceilings"]["shift_mm"], 75.0);
    assert_eq!(got["config"]["access"]["session_idle_s"], 600);

    let file = project("tests/reference/kept/journal.umij");
    let verified = umi(&["log", "verify", &file, "--json"]).exits(0).json();
    assert_eq!(verified["signed_to"], 51, "{verified}");
    let listed = umi(&["log", &file, "--json"]).exits(0).json_lines();
    let told: Vec<_> = listed
        .iter()
        .filter(|of| of["type"] == "config_set")
        .collect();
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(
        told[0].to_string().contains("\"rms_mm\":0.5"),
        "{}",
        told[0]
    );
    assert!(!listed.iter().any(|of| of["type"] == "unreadable"));
}

/// Entries that somebody keeps elsewhere are acknowledged; nobody can keep what is not there yet.
#[test]
fn entries_are_acknowledged() {
    let (_board, port) = start(&config());
    let ack = |seq: &str| umi(&["log", "ack", seq, "--json", "--port", &port]);
    let told = ack("1").exits(0).json();
    assert_eq!((&told["acked_seq"], &told["lost"]), (&1.into(), &0.into()));
    assert_eq!(error(ack("999"))["code"], "out_of_range");
    let info = umi(&["info", "--json", "--port", &port]).exits(0).json();
    assert_eq!(info["journal"]["acked_seq"], 1);
}

/// A bit of the journal's memory has changed: the pull names the entry, and where it goes on behind the damage.
#[test]
fn a_board_with_a_damaged_entry_says_where_it_goes_on() {
    let mut rig = super::access::Rig::new(false);
    rig.start(false);
    rig.stop();
    let flash = rig.folder.path("state/journal.flash");
    let mut bytes = std::fs::read(&flash).unwrap();
    let used: Vec<usize> = (0..bytes.len()).filter(|at| bytes[*at] != 0xFF).collect();
    bytes[used[used.len() / 2]] ^= 1;
    std::fs::write(&flash, bytes).unwrap();
    rig.start(false);
    let file = rig.folder.path("journal.umij");
    let error = rig.run(&["log", "pull", &file]).exits(2).json()["error"].clone();
    assert_eq!(error["code"], "entry_damaged", "{error}");
    let from = error["readable_from"].as_u64().unwrap().to_string();
    let pulled = rig.run(&["log", "pull", &file, "--from", &from, "--force"]);
    pulled.exits(0);
}
