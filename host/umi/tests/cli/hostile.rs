//! What a stranger may name or leave behind: shown in letters, never obeyed.

use umi_client::programs;
use umi_core::journal::Chain;
use umi_protocol::hello::{Hello, VERSION, Version};
use umi_protocol::message::Record;
use umi_protocol::program::{ProgramInfo, Release, Stated};
use umi_virtual::serve::{Port, PortPlace};
use umi_virtual::{Config, VirtualBoard};

use crate::rig::board::{Board, identity};
use crate::rig::run::{Folder, Ran, umi_with};

/// Sets the title of a terminal and clears it. Fits in a name.
const HOSTILE: &str = "\u{1b}]0;owned\u{7}\u{9b}2J";
/// The same in letters.
const LETTERS: &str = r"\u001b]0;owned\u0007\u009b2J";

/// As on a terminal with colours: whatever was to go out has gone out.
fn on_terminal(args: &[&str]) -> Ran {
    umi_with(("CLICOLOR_FORCE", "1"), args)
}

/// Every escape on both outputs begins a colour, and no other control character is there.
fn assert_harmless(ran: &Ran) {
    for text in [&ran.out, &ran.err] {
        let mut rest = text.as_str();
        while let Some((_, behind)) = rest.split_once('\u{1b}') {
            let codes = behind.strip_prefix('[').and_then(|b| b.split_once('m'));
            let (codes, more) = codes.unwrap_or_else(|| panic!("{behind:?}"));
            let is_colour = codes.bytes().all(|b| b.is_ascii_digit() || b == b';');
            assert!(is_colour, "{codes:?} in {text:?}");
            rest = more;
        }
        let steers = |c: char| c.is_control() && !matches!(c, '\n' | '\u{1b}');
        assert!(!text.contains(steers), "{text:?}");
    }
}

/// The greeting of a board, in an error on standard error and as JSON.
#[test]
fn a_greeting_does_not_steer_the_terminal() {
    let mut board = Board::new(0);
    let newer = Version {
        minor: VERSION.minor + 1,
        ..VERSION
    };
    board.hello = Hello::of(newer, 1, HOSTILE);
    let port = board.serve();
    let told = on_terminal(&["info", "--port", &port]).exits(1);
    assert_harmless(&told);
    let told = told.says(LETTERS);
    assert!(told.err.contains("\u{1b}[1;31merror:"), "{:?}", told.err);
    let json = on_terminal(&["info", "--port", &port, "--json"]).exits(1);
    assert_harmless(&json);
    let message = json.json()["error"]["message"].clone();
    assert!(message.as_str().unwrap().contains(HOSTILE), "{message}");
}

/// Names of a board in what is listed of it, and of a program that somebody has put there.
#[test]
fn a_name_does_not_steer_the_terminal() {
    let mut board = Board::new(0);
    let mut named = identity();
    named.serial = HOSTILE.try_into().unwrap();
    board.push(&Record::Boot {
        identity: named,
        reset: umi_protocol::message::ResetReason::PowerOn,
    });
    let port = board.serve();
    for more in [&[][..], &["--json"]] {
        let listed = on_terminal(&[&["log", "--port", &port], more].concat()).exits(0);
        assert_harmless(&listed);
        assert!(listed.out.contains("owned"), "{:?}", listed.out);
    }

    let board = std::sync::Arc::new(VirtualBoard::start(Config::default()).unwrap());
    let place = Port::open(&PortPlace::Tcp(0)).unwrap();
    let port = place.address.clone();
    place.serve_host(&board);
    let folder = Folder::new();
    let file = folder.file(&format!("{HOSTILE}.nc"), "%\nO7\nG21\nM30\n%\n");
    let port = ["--port", port.as_str()];
    let put = on_terminal(&[&["program", "put", &file], &port[..]].concat());
    assert_harmless(&put.exits(0));
    for more in [&[][..], &["--json"]] {
        let listed = on_terminal(&[&["program", "list"], more, &port].concat()).exits(0);
        assert_harmless(&listed);
        assert!(listed.out.contains("owned"), "{:?}", listed.out);
    }
}

/// A name with a line end makes no line of its own that looks like one of ours: of a program, in its list and in the
/// journal, of a key, of a board in its greeting.
#[test]
fn a_name_makes_no_line() {
    const LINES: &str = "a\r\n  9999  SAFE";
    let has_none = |text: &str| {
        assert!(text.contains(r"a\r\n  9999"), "{text}");
        assert!(
            !text
                .lines()
                .any(|line| line.trim_start().starts_with("9999")),
            "{text}"
        );
    };
    let board = std::sync::Arc::new(VirtualBoard::start(Config::default()).unwrap());
    let mut client = umi_desk::client(&board).unwrap();
    let text = b"%\nO0077\nM30\n%\n";
    let program = ProgramInfo {
        number: 77,
        name: LINES.try_into().unwrap(),
        bytes: text.len() as u32,
        crc32: programs::check_value(text),
        release: Release::Always,
        hold_s: 5,
        stated: Stated::default(),
    };
    programs::put(&mut client, &program, text, |_| {}).unwrap();
    drop(client);
    let place = Port::open(&PortPlace::Tcp(0)).unwrap();
    let port = place.address.clone();
    place.serve_host(&board);
    for args in [&["program", "list"][..], &["log"]] {
        has_none(
            &umi_with(("NO_COLOR", "1"), &[args, &["--port", &port]].concat())
                .exits(0)
                .out,
        );
    }
    let mut stranger = Board::new(0);
    let newer = Version {
        minor: VERSION.minor + 1,
        ..VERSION
    };
    stranger.hello = Hello::of(newer, 1, LINES);
    has_none(
        &umi_with(("NO_COLOR", "1"), &["info", "--port", &stranger.serve()])
            .exits(1)
            .err,
    );
    let mut named = Board::new(0);
    let mut identity = identity();
    identity.serial = LINES.try_into().unwrap();
    named.push(&Record::Boot {
        identity,
        reset: umi_protocol::message::ResetReason::PowerOn,
    });
    has_none(
        &umi_with(("NO_COLOR", "1"), &["log", "--port", &named.serve()])
            .exits(0)
            .out,
    );
}

/// A link under the name of a file that is not complete yet is taken away, not written through.
#[test]
#[cfg(unix)]
fn an_unfinished_file_follows_no_link() {
    let mut board = Board::new(0);
    board.chain_before = Chain::GENESIS;
    let port = board.serve();
    let folder = Folder::new();
    let (victim, out) = (folder.file("victim", "mine"), folder.path("out.umij"));
    std::os::unix::fs::symlink(&victim, format!("{out}.part")).unwrap();
    umi_with(("NO_COLOR", "1"), &["log", "--port", &port, "-o", &out]).exits(0);
    assert_eq!(std::fs::read_to_string(&victim).unwrap(), "mine");
    assert!(std::fs::symlink_metadata(&out).unwrap().is_file());
}

/// A pull takes the place of a file, and of nothing else: a device, a socket or a pipe stays what it is.
#[test]
#[cfg(unix)]
fn a_pull_takes_no_devices_place() {
    use std::os::unix::fs::FileTypeExt as _;
    let (folder, port) = (Folder::new(), Board::new(0).serve());
    let out = folder.path("socket");
    let _socket = std::os::unix::net::UnixListener::bind(&out).unwrap();
    for args in [
        &["log", "pull", &out][..],
        &["log", "pull", &out, "--force"],
        &["log", "-o", &out],
    ] {
        umi_with(("NO_COLOR", "1"), &[args, &["--port", &port]].concat())
            .exits(1)
            .says("is no file");
        let found = std::fs::symlink_metadata(&out).unwrap();
        assert!(found.file_type().is_socket());
    }
}
