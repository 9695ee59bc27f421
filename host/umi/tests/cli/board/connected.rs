//! Commands that talk to a board: `info`, `log`, `job show|set|get`.

use std::fs;

use umi_protocol::hello::{Hello, VERSION, Version};
use umi_protocol::latch::Positions;
use umi_protocol::message::ResetReason;

use crate::rig::board::Board;
use crate::rig::run::{Folder, project, umi, umi_with};

/// Who the board is and what it has counted, in words and as JSON.
#[test]
fn info_says_who_and_what() {
    let port = Board::new(0).serve();
    let text = umi(&["info", "--port", &port]).exits(0).out;
    for words in [
        "board test, serial number 0042",
        "1:02:05",
        "2 OK, 1 NG",
        "0 to 4",
        "1234",
        "bad_parity",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
    let value = umi(&["info", "--port", &port, "--json"]).exits(0).json();
    assert_eq!(value["board"]["serial"], "0042");
    assert_eq!(value["status"]["verdicts"], 3);
    assert_eq!(value["status"]["counters"]["faults"]["bad_parity"], 1);
    assert_eq!(value["journal"]["next_seq"], 5);
}

/// What the axes and latches have lost is shown, and that the firmware hung.
#[test]
fn info_shows_the_health_of_the_axes() {
    let mut board = Board::new(0);
    board.positions = Positions {
        counts: [1_234_567, -5].into_iter().collect(),
        t_ns: 7,
        illegal: [0, 17].into_iter().collect(),
        lost_samples: 3,
    };
    board.latches.skips = 41;
    board.latches.untold = 29;
    board.reset = ResetReason::Watchdog;
    let port = board.serve();
    let text = umi(&["info", "--port", &port]).exits(0).out;
    let line = |begin: &str| {
        let line = text.lines().find(|line| line.trim().starts_with(begin));
        let line = line.unwrap_or_else(|| panic!("no {begin:?} in\n{text}"));
        line.split_whitespace()
            .skip(1)
            .collect::<Vec<_>>()
            .join(" ")
    };
    assert_eq!(line("X "), "1234567 ? 0");
    assert_eq!(line("Y "), "-5 ? 17");
    assert_eq!(line("probe"), "41");
    assert!(line("positions NOT VALID").contains("could not keep up 3 times"));
    assert!(line("captured").ends_with(" 29"));
    assert!(line("running for").contains("by its watchdog: the firmware hung"));
    let value = umi(&["info", "--port", &port, "--json"]).exits(0).json();
    assert_eq!(value["positions"]["illegal"][1], 17);
    assert_eq!(value["positions"]["valid"], false);
    assert_eq!(value["status"]["reset"], "watchdog");
    assert_eq!(value["status"]["latches"]["untold"], 29);
}

/// The address may come from the environment; an option goes before it.
#[test]
fn the_port_may_come_from_the_environment() {
    let port = Board::new(0).serve();
    umi_with(("UMI_PORT", &port), &["info"]).exits(0);
    umi_with(
        ("UMI_PORT", "tcp://127.0.0.1:1"),
        &["info", "--port", &port],
    )
    .exits(0);
}

/// A newer board is named as newer, with the side to update; nothing else is asked.
#[test]
fn a_newer_board_is_named() {
    let mut board = Board::new(0);
    let newer = Version {
        minor: VERSION.minor + 1,
        ..VERSION
    };
    board.hello = Hello::of(newer, 1, "test 0042 0.9.0");
    let port = board.serve();
    umi(&["info", "--port", &port])
        .exits(1)
        .says("board speaks a newer protocol")
        .says("update umi")
        .says("0.9.0");
    let error = umi(&["info", "--port", &port, "--json"]).exits(1).json();
    assert_eq!(error["error"]["code"], "version_mismatch");
}

/// Where nobody listens, the message says what it tried and what to look at.
#[test]
fn nobody_there_is_named() {
    umi(&["info", "--port", "tcp://127.0.0.1:1"])
        .exits(1)
        .says("tcp://127.0.0.1:1");
    umi(&["info", "--port", "/dev/nowhere"])
        .exits(1)
        .says("there is no port /dev/nowhere");
    umi(&["info", "--port", "http://board"])
        .exits(1)
        .says("tcp://host:port");
}

/// A pulled file holds what the board holds, and lists as the board itself does.
#[test]
fn a_pulled_journal_lists_like_the_board() {
    let folder = Folder::new();
    let file = folder.path("log.umij");
    let port = Board::new(0).serve();
    let pulled = umi(&["log", "--port", &port, "-o", &file, "--json"])
        .exits(0)
        .json();
    assert_eq!(pulled["first_seq"], 0);
    assert_eq!(pulled["next_seq"], 5);
    let from_board = umi(&["log", "--port", &port]).exits(0).out;
    let from_file = umi(&["log", &file]).exits(0).out;
    // A file says besides whether anybody vouches for it.
    let lines = from_file
        .lines()
        .filter(|line| !line.starts_with("unsigned"));
    assert!(lines.eq(from_board.lines()), "{from_file}");
    for words in [
        "0  0:00:00.000000  started by power: board test 0042, firmware 0.1.0",
        r#"received 18 bytes: "SPHERE1\r\n-135.0190""#,
        "3 bytes lost before the receiver",
        "entries 0 to 4: read whole",
        pulled["chain"].as_str().unwrap(),
    ] {
        assert!(from_file.contains(words), "no {words:?} in\n{from_file}");
    }
    // Only some of it, and all of it verified.
    for (only, is_there) in [("records", true), ("verdicts,faults", false)] {
        let some = umi(&["log", &file, "--only", only]).exits(0).out;
        assert_eq!(some.contains("3 bytes lost before"), is_there, "{some}");
        assert!(some.contains("entries 0 to 4: read whole"), "{some}");
    }
    assert!(!std::path::Path::new(&folder.path("log.umij.part")).exists());
}

/// A file is listed whatever board the environment names.
#[test]
fn a_file_needs_no_board() {
    let folder = Folder::new();
    let file = folder.path("log.umij");
    let port = Board::new(0).serve();
    umi(&["log", "--port", &port, "-o", &file]).exits(0);
    umi_with(("UMI_PORT", "tcp://127.0.0.1:1"), &["log", &file]).exits(0);
}

/// As JSON, each entry is an object with number, time and type; the last line is the proof.
#[test]
fn a_journal_lists_as_json() {
    let port = Board::new(0).serve();
    let lines = umi(&["log", "--port", &port, "--json"])
        .exits(0)
        .json_lines();
    let types: Vec<&str> = lines
        .iter()
        .map(|line| line["type"].as_str().unwrap())
        .collect();
    assert_eq!(
        types,
        [
            "boot",
            "bytes",
            "bytes_lost",
            "time",
            "input_end",
            "verified"
        ]
    );
    assert_eq!(lines[1]["seq"], 1);
    assert_eq!(lines[1]["t_us"], 1_000_000);
    assert_eq!(lines[2]["count"], 3);
    assert_eq!(lines[5]["chain"].as_str().unwrap().len(), 64);
}

/// A pull may begin anywhere, also where the ring has given up what was before;
/// the file is proven from there on.
#[test]
fn a_pull_may_begin_anywhere() {
    let folder = Folder::new();
    let file = folder.path("part.umij");
    let port = Board::new(70_000).serve();
    let pulled = umi(&[
        "log", "--port", &port, "-o", &file, "--from", "70002", "--json",
    ]);
    let pulled = pulled.exits(0).json();
    assert_eq!(
        (&pulled["first_seq"], &pulled["next_seq"]),
        (&70_002.into(), &70_005.into())
    );
    let whole = umi(&["log", "--port", &port, "--json"])
        .exits(0)
        .json_lines();
    assert_eq!(whole.last().unwrap()["chain"], pulled["chain"]);
    let lines = umi(&["log", &file, "--json"]).exits(0).json_lines();
    assert_eq!(lines[0]["seq"], 70_002);
    let lines = umi(&["log", &file, "--json", "--from", "70004"])
        .exits(0)
        .json_lines();
    assert_eq!(lines[0]["seq"], 70_004);

    umi(&["log", "--port", &port, "--from", "3"])
        .exits(1)
        .says("start at 70000");
    umi(&["log", "--port", &port, "--from", "80000"])
        .exits(1)
        .says("does not exist yet");
}

/// One changed bit in an entry ends the pull with its number and status 2; what
/// came before stays, under a name that does not pass for the whole.
#[test]
fn a_damaged_entry_ends_the_pull() {
    let mut board = Board::new(0);
    board.entries[3][4] ^= 1;
    let port = board.serve();
    let folder = Folder::new();
    let file = folder.path("log.umij");
    let ran = umi(&["log", "--port", &port, "-o", &file]).exits(2);
    let ran = ran.says("entry 3 is damaged").says("log.umij.part");
    assert!(ran.out.is_empty());
    assert!(!std::path::Path::new(&file).exists());
    umi(&["log", &folder.path("log.umij.part")]).exits(0);
}

/// An entry that is whole but was exchanged for another is found by the chain.
#[test]
fn an_exchanged_entry_breaks_the_chain() {
    let mut board = Board::new(0);
    let mut other = Board::new(70_000);
    // The same number, content and check value as an entry may have, another past.
    other.first_seq = 0;
    other.entries.clear();
    other.chains.clear();
    for entry in ["a", "b", "c"] {
        let raw = heapless::Vec::from_slice(entry.as_bytes()).unwrap();
        other.push(&umi_protocol::message::Record::Bytes { raw });
    }
    board.entries[2] = other.entries[2].clone();
    let port = board.serve();
    let lines = umi(&["log", "--port", &port, "--json"])
        .exits(2)
        .json_lines();
    let error = &lines.last().unwrap()["error"];
    assert_eq!(error["code"], "chain_broken");
    assert_eq!(error["seq"], 2);
}

/// Entries that follow from each other but are not those that the board has
/// proven last are found too: the end is compared with the board's own value.
#[test]
fn the_end_is_compared_with_the_board() {
    let mut board = Board::new(0);
    let last = board.chains.last_mut().unwrap();
    last.0[31] ^= 1;
    let port = board.serve();
    let error = umi(&["log", "--port", &port, "--json"])
        .exits(2)
        .json_lines();
    assert_eq!(error.last().unwrap()["error"]["code"], "chain_broken");
}

/// A file that was cut, or is none, is named; an older file is not overwritten.
#[test]
fn files_are_checked_and_kept() {
    let folder = Folder::new();
    let file = folder.path("log.umij");
    let port = Board::new(0).serve();
    umi(&["log", "--port", &port, "-o", &file]).exits(0);
    umi(&["log", "--port", &port, "-o", &file])
        .exits(1)
        .says("--force");
    umi(&["log", "--port", &port, "-o", &file, "--force"]).exits(0);
    let bytes = fs::read(&file).unwrap();
    let cut = folder.file("cut.umij", &bytes[..bytes.len() - 5]);
    umi(&["log", &cut]).exits(2).says("ends inside entry 4");
    let none = folder.file("none.umij", "hello");
    umi(&["log", &none]).exits(1).says("not a journal");
}

/// A job goes to the board and comes back the same.
#[test]
fn a_job_goes_there_and_back() {
    let port = Board::new(0).serve();
    let job = project("examples/three-spheres.toml");
    umi(&["job", "show", "--port", &port])
        .exits(2)
        .says("umi job set");
    let set = umi(&["job", "set", &job, "--port", &port]).exits(0).out;
    assert!(set.contains("now works on job THREE SPHERES"), "{set}");
    let shown = umi(&["job", "show", "--port", &port, "--json"])
        .exits(0)
        .json();
    let checked = umi(&["job", "check", &job, "--json"]).exits(0).json();
    assert_eq!(shown["job"], checked["job"]);

    let folder = Folder::new();
    let back = folder.path("back.toml");
    umi(&["job", "get", "--port", &port, "-o", &back]).exits(0);
    let again = umi(&["job", "check", &back, "--json"]).exits(0).json();
    assert_eq!(again, checked);
}

/// A bad job is refused here, before any board is asked; one that the board does
/// not keep is noticed.
#[test]
fn only_a_job_that_the_board_keeps_is_set() {
    let folder = Folder::new();
    let bad = folder.file("bad.toml", "name = \"X\"\n");
    umi(&["job", "set", &bad, "--port", "tcp://127.0.0.1:1"])
        .exits(2)
        .says("missing field");
    let mut board = Board::new(0);
    board.forgetful = true;
    let port = board.serve();
    let job = project("examples/three-spheres.toml");
    umi(&["job", "set", &job, "--port", &port])
        .exits(1)
        .says("has another one now");
}
