//! `umi watch`: what it knows of a board, moving axes, and a board that goes away.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, ChildStdout, Stdio};

use serde_json::Value;
use umi_protocol::latch::Positions;

use crate::rig::board::Board;
use crate::rig::run::{Folder, Machine, command, umi};

/// A run of `umi watch --json`, line by line. Ends with this value.
struct Watching(Child, BufReader<ChildStdout>);

impl Watching {
    fn start(port: &str) -> Self {
        let mut child = command(&["watch", "--port", port, "--json"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let out = BufReader::new(child.stdout.take().unwrap());
        Self(child, out)
    }

    /// The first of the next lines for which this holds.
    fn until(&mut self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        for _ in 0..300 {
            let mut line = String::new();
            self.1.read_line(&mut line).unwrap();
            let value: Value = serde_json::from_str(&line).unwrap();
            if holds(&value) {
                return value;
            }
        }
        panic!("{what} is not seen");
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// One picture as text and as JSON, from the board's own figures.
#[test]
fn one_picture() {
    let mut board = Board::new(0);
    board.positions = Positions {
        counts: [1_234_567, -5].into_iter().collect(),
        t_ns: 7,
        illegal: [0, 17].into_iter().collect(),
        lost_samples: 3,
    };
    let port = board.serve();
    let text = umi(&["watch", "--port", &port, "--once"]).exits(0).out;
    for words in [
        "board test 0042",
        "connected",
        "1234567 counts",
        "illegal transitions 17",
        "lost samples        3",
        "positions NOT VALID",
        "2 OK, 1 NG",
        "started by          power",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
    assert!(!text.contains('\u{1b}'));
    let value = umi(&["watch", "--port", &port, "--once", "--json"])
        .exits(0)
        .json();
    assert_eq!(value["positions"]["counts"][0], 1_234_567);
    assert_eq!(value["status"]["verdicts"], 3);
    // Without a terminal there is nothing to draw on.
    umi(&["watch", "--port", &port]).exits(1).says("--once");
}

/// The axes of a machine at work are seen moving, in millimetres and at their feed, and
/// the position at rest is where the program sent them.
#[test]
fn a_machine_at_work_is_seen() {
    let folder = Folder::new();
    let machine = Machine::start(
        &folder,
        "%\nO1\nG21 G90 G54\nG4 P2000\nG1 X-60. F1200.\nG4 P60000\nM30\n%\n",
    );
    let mut watching = Watching::start(&machine.port);
    let x = |value: &Value| value["positions"]["position_mm"][0].as_f64().unwrap();
    watching.until("a machine at rest", |value| x(value) == 0.0);
    watching.until("the feed", |value| {
        let feed = value["feed_mm_per_min"].as_f64();
        x(value) < -1.0 && feed.is_some_and(|feed| (feed - 1200.0).abs() < 1.0)
    });
    let end = watching.until("the end of the motion", |value| {
        value["feed_mm_per_min"] == 0.0 && x(value) < -50.0
    });
    assert!((x(&end) + 60.0).abs() < 1e-3, "{end}");
    assert_eq!(end["connected"], true);
}

/// A board that goes away is said to be gone, with the reason, and is there again when
/// it comes back.
#[test]
fn a_board_that_goes_away_comes_back() {
    let mut board = Board::new(0);
    board.hangs_up_after = Some(12);
    let mut watching = Watching::start(&board.serve());
    let gone = watching.until("the loss", |value| value["connected"] == false);
    assert!(gone["link"]["why"].as_str().unwrap().len() > 5, "{gone}");
    let back = watching.until("the return", |value| value["connected"] == true);
    assert_eq!(back["link"]["reconnected"], 1);
    assert!(back["link"]["why"].is_null());
}

/// A terminal that is closed ends `umi watch` also where no signal says so, and the end of its
/// input ends it.
#[test]
#[cfg(unix)]
fn the_end_of_the_terminal_ends_it() {
    use std::fs::File;
    use std::io::Read as _;
    use std::time::{Duration, Instant};

    use rustix::io::{FdFlags, fcntl_setfd};
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

    let ends = |child: &mut Child| {
        let end = Instant::now() + Duration::from_secs(20);
        while child.try_wait().unwrap().is_none() {
            if Instant::now() > end {
                let _ = child.kill();
                panic!("it goes on without a terminal");
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    };
    for closed in [true, false] {
        let port = Board::new(0).serve();
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        // Else the program would hold its own terminal open.
        fcntl_setfd(&master, FdFlags::CLOEXEC).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap();
        let terminal = || {
            let path = name.to_str().unwrap();
            File::options().read(true).write(true).open(path).unwrap()
        };
        let stdin = if closed {
            Stdio::from(terminal())
        } else {
            Stdio::null()
        };
        let mut child = command(&["watch", "--port", &port])
            .stdin(stdin)
            .stdout(terminal())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut master = File::from(master);
        if closed {
            // It draws: then its terminal goes.
            let mut bytes = [0; 64];
            assert!(master.read(&mut bytes).unwrap() > 0);
            drop(master);
            ends(&mut child);
        } else {
            // Somebody must take what it draws.
            std::thread::spawn(move || std::io::copy(&mut master, &mut std::io::sink()));
            ends(&mut child);
        }
    }
}

/// While one program is a board's host, another is told at once, and since when.
#[test]
fn a_busy_board_says_since_when() {
    let folder = Folder::new();
    let machine = Machine::start(&folder, "%\nO1\nG4 P60000\nM30\n%\n");
    let mut watching = Watching::start(&machine.port);
    watching.until("the board", |value| value["connected"] == true);
    let begun = std::time::Instant::now();
    umi(&["info", "--port", &machine.port])
        .exits(1)
        .says("busy, connected since ");
    assert!(begun.elapsed() < std::time::Duration::from_secs(2));
    let value = umi(&["info", "--port", &machine.port, "--json"])
        .exits(1)
        .json();
    assert_eq!(value["error"]["code"], "busy");
    watching.until("the board still", |value| value["connected"] == true);
}
