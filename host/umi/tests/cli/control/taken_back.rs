//! A correction leaves by a verdict only as long as the board stands by it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use umi_virtual::serve::{Port, PortPlace};
use umi_virtual::{BoardTime, Config, VirtualBoard};

use crate::rig::run::{Folder, project, umi};

const JOB: &str = include_str!("../../../../../examples/three-spheres.toml");
const SESSION: &str = include_str!("../../../../../examples/session.txt");

/// So many lines of a clamping of the session, from its first.
fn lines(clamping: usize, count: usize) -> String {
    let lines = SESSION.split_inclusive('\n');
    lines.skip(27 * clamping).take(count).collect()
}

/// A board in real time, and the address at which a host finds it.
fn served() -> (Arc<VirtualBoard>, String) {
    let config = Config {
        time: BoardTime::Real,
        ..Config::default()
    };
    let board = Arc::new(VirtualBoard::start(config).unwrap());
    let port = Port::open(&PortPlace::Tcp(0)).unwrap();
    let at = port.address.clone();
    port.serve_host(&board);
    (board, at)
}

/// The next clamping has begun, or teaching was asked for again: neither board nor journal lets the
/// correction of the one before out.
#[test]
fn what_the_board_has_taken_back_corrects_nothing() {
    let (board, at) = served();
    let folder = Folder::new();
    let (job, program) = (folder.file("j.toml", JOB), project("examples/part.nc"));
    let info = || {
        let info = umi(&["info", "--json", "--port", &at]).exits(0);
        info.json()["status"].clone()
    };
    let until = |is: &dyn Fn(&serde_json::Value) -> bool| {
        let begun = Instant::now();
        while !is(&info()) {
            assert!(begun.elapsed() < Duration::from_secs(20), "{}", info());
        }
    };
    let out = folder.path("out.nc");
    let by_board = ["--verdict", "board", "--port", at.as_str()];
    let correction = || umi(&[&["correction"][..], &by_board].concat());
    let rewrite = || {
        let rewrite = ["nc", "rewrite", &program, "-o", &out, "--force", "--json"];
        umi(&[&rewrite[..], &by_board].concat())
    };
    let check = || umi(&[&["nc", "check", &program][..], &by_board].concat());
    let pulled = |plate: &[&str]| {
        let journal = folder.path("j.umij");
        umi(&["log", "--port", &at, "-o", &journal, "--force"]).exits(0);
        // This board has no key.
        umi(&[&["correction", "--unsigned", "--verdict", &journal], plate].concat())
    };
    let measure = |clamping, verdicts: u32| {
        board.control_sends(lines(clamping, 27).as_bytes());
        until(&|status| status["verdicts"] == verdicts);
    };
    umi(&["job", "set", &job, "--port", &at]).exits(0);
    measure(0, 1);
    measure(1, 2);
    let made = correction().exits(0).out;
    rewrite().exits(0);
    check().exits(0);
    assert_eq!(pulled(&[]).exits(0).out, made);

    let refused = || {
        correction().exits(2).says("taken back its OK on setup 1");
        check().exits(2).says("probe the part again");
        assert_eq!(rewrite().exits(2).json()["error"]["code"], "taken_back");
        pulled(&[]).exits(2).says("the board has taken it back");
        // Who names the setup looks back.
        assert_eq!(pulled(&["--plate", "1"]).exits(0).out, made);
    };
    umi(&["teach", "--again", "--port", &at]).exits(0);
    refused();
    measure(0, 3);
    measure(1, 4);
    correction().exits(0);
    board.control_sends(lines(2, 3).as_bytes());
    until(&|status| status["last_verdict_ok"].is_null());
    correction().exits(2).says("taken back its OK on setup 3");
    let said = pulled(&[]).exits(2).err;
    let (_, entry) = said.split_once("--entry ").unwrap();
    let entry: String = entry.chars().take_while(char::is_ascii_digit).collect();
    let named = pulled(&["--entry", &entry]).exits(0).out;
    assert_eq!(named, pulled(&["--plate", "3"]).exits(0).out);

    // The job is set anew, and setups count from 0: a number names two of them.
    umi(&["job", "set", &job, "--port", &at]).exits(0);
    measure(0, 5);
    measure(2, 6);
    let other = correction().exits(0).out;
    assert_ne!(other, made);
    let said = pulled(&["--plate", "1"])
        .exits(2)
        .says("2 setups have the number 1")
        .err;
    let entries: Vec<String> = said
        .split("--entry ")
        .skip(1)
        .map(|rest| rest.chars().take_while(char::is_ascii_digit).collect())
        .collect();
    let [first, second] = entries.as_slice() else {
        panic!("{said}")
    };
    assert_eq!(pulled(&["--entry", first]).exits(0).out, made);
    assert_eq!(pulled(&["--entry", second]).exits(0).out, other);
    pulled(&["--entry", "1"]).exits(1);
}

/// A job that counts runs corrects in no words that compare none.
#[test]
fn a_correction_that_compares_no_run_is_refused() {
    let (board, at) = served();
    let job = project("examples/four-spheres.toml");
    umi(&["job", "set", &job, "--port", &at]).exits(0);
    board.control_sends(include_bytes!("../../../../../examples/four-spheres.txt"));
    let begun = Instant::now();
    while umi(&["info", "--json", "--port", &at]).json()["status"]["verdicts"] != 2 {
        assert!(begun.elapsed() < Duration::from_secs(20));
    }
    let by_board = ["correction", "--verdict", "board", "--port", &at, "--json"];
    let made = umi(&by_board).exits(0).json()["text"].to_string();
    assert!(made.contains("#531EQ2"), "{made}");
    let args = [&by_board[..], &["--dialect", "grbl", "--limit", "5"]].concat();
    assert_eq!(umi(&args).exits(2).json()["error"]["code"], "not_compared");
}

/// An OK that is older than the job allows corrects nothing, also out of the journal; who names the verdict
/// looks back.
#[test]
fn what_is_too_old_corrects_nothing() {
    let (board, at) = served();
    let folder = Folder::new();
    let job = JOB.replace("plate_timeout_s = 1800", "plate_timeout_s = 2");
    assert_ne!(job, JOB);
    let job = folder.file("j.toml", job);
    umi(&["job", "set", &job, "--port", &at]).exits(0);
    board.control_sends(lines(0, 54).as_bytes());
    let begun = Instant::now();
    let status = || umi(&["info", "--json", "--port", &at]).json()["status"].clone();
    while status()["verdicts"] != 2 || !status()["last_verdict_ok"].is_null() {
        assert!(begun.elapsed() < Duration::from_secs(20), "{}", status());
    }
    let journal = folder.path("j.umij");
    umi(&["log", "--port", &at, "-o", &journal]).exits(0);
    let by_journal = ["correction", "--unsigned", "--verdict", &journal];
    let said = umi(&by_journal).exits(2).says("plate_timeout_s").err;
    let (_, entry) = said.split_once("--entry ").unwrap();
    let entry: String = entry.chars().take_while(char::is_ascii_digit).collect();
    umi(&[&by_journal[..], &["--entry", &entry]].concat()).exits(0);
}
