//! `umi events`: what happens on a board, what was lost, and scans.

use umi_protocol::latch::{LatchBatch, LatchCause, LatchReport, LatchStep};
use umi_protocol::line::HitReport;
use umi_protocol::message::{Event, Record};

use crate::rig::board::Board;
use crate::rig::run::{Folder, Machine, project, umi};

fn latch(number: u32, missed: u32) -> LatchReport {
    LatchReport {
        number,
        cause: LatchCause::Trigger,
        counts: [i64::from(number) * 10, -7, 3].into_iter().collect(),
        t_ns: 1_000_000 + u64::from(number) * 100_000,
        missed,
    }
}

fn batch(first: LatchReport, steps: usize) -> Event {
    let step = LatchStep {
        dt_ns: 100_000,
        dcounts: [10, 0, 0].into_iter().collect(),
    };
    Event::Latches(LatchBatch {
        first,
        steps: std::iter::repeat_n(step, steps).collect(),
    })
}

fn hit() -> Event {
    Event::Hit(HitReport {
        line: 3,
        t_us: 2_000_000,
        feature: Some("S1".try_into().unwrap()),
        position_mm: [1.0, 2.0, 3.5],
        approach: None,
        feed_mm_per_min: Some(300.0),
    })
}

/// A board that tells of these, in a job with a scale of 10 counts per millimetre.
fn telling(events: Vec<Event>) -> String {
    board(events).serve()
}

fn board(events: Vec<Event>) -> Board {
    let text = std::fs::read_to_string(project("examples/three-spheres-witnessed.toml")).unwrap();
    let text = text.replace(
        "counts_per_mm = [10000.0, 10000.0, 10000.0]",
        "counts_per_mm = [10.0, 10.0, 10.0]",
    );
    let mut board = Board::new(0);
    board.job = Some(umi_client::files::job_file::parse(&text).unwrap());
    board.events = events;
    board
}

/// A connection that is lost ends the list with what had come until then, as not complete.
#[test]
fn a_lost_connection_ends_the_list() {
    let mut board = board(vec![hit()]);
    // Status, job, status, positions, live; it is gone when it is asked for its status at the end.
    board.hangs_up_after = Some(6);
    let lines = umi(&["events", "--port", &board.serve(), "--for", "0.3", "--json"])
        .exits(1)
        .json_lines();
    let end = lines.iter().find(|line| line["type"] == "end").unwrap();
    assert_eq!(
        (&end["complete"], &end["shown"]),
        (&false.into(), &1.into()),
        "{end}"
    );
}

/// Nothing lost: every latch of every batch, with its position, and status 0.
#[test]
fn latches_are_unfolded() {
    let port = telling(vec![batch(latch(5, 0), 15), hit(), batch(latch(21, 0), 3)]);
    let args = ["events", "--port", &port, "--for", "0.3", "--json"];
    let lines = umi(&args).exits(0).json_lines();
    let numbers: Vec<u64> = lines
        .iter()
        .filter(|line| line["type"] == "latch")
        .map(|line| line["number"].as_u64().unwrap())
        .collect();
    assert_eq!(numbers, (5..25).collect::<Vec<_>>());
    assert_eq!(lines[3]["position_mm"][0], 8.0);
    assert_eq!(lines[3]["t_ns"], 1_800_000);
    let end = lines.last().unwrap();
    assert_eq!(
        (&end["shown"], &end["latches_lost"]),
        (&21.into(), &0.into())
    );
}

/// What is missing stands where it is missing, and the exit status tells it.
#[test]
fn losses_are_told_in_their_place() {
    let events = || {
        vec![
            batch(latch(0, 0), 1),
            batch(latch(4, 0), 0),
            hit(),
            batch(latch(5, 3), 0),
            Event::Dropped { count: 9 },
        ]
    };
    let port = telling(events());
    let args = ["events", "--port", &port, "--for", "0.3", "--json"];
    let lines = umi(&args).exits(2).json_lines();
    let told: Vec<(&str, u64)> = lines
        .iter()
        .map(|line| {
            let number = line["count"].as_u64().or(line["number"].as_u64());
            (line["type"].as_str().unwrap(), number.unwrap_or(0))
        })
        .collect();
    assert_eq!(
        told,
        [
            ("latch", 0),
            ("latch", 1),
            ("loss", 2),
            ("latch", 4),
            ("hit", 0),
            ("loss", 3),
            ("latch", 5),
            ("loss", 9),
            ("end", 0)
        ]
    );
    let end = lines.last().unwrap();
    assert_eq!(
        (&end["latches_lost"], &end["events_lost"]),
        (&5.into(), &9.into())
    );

    let text = umi(&["events", "--port", &port, "--for", "0.3"])
        .exits(2)
        .out;
    for words in [
        "lost: 2 latches by trigger from number 2 on did not arrive",
        "lost: 3 edges of trigger came and could not be captured",
        "hit on S1 at (1.0000, 2.0000, 3.5000) mm, feed 300 mm/min",
        "lost: 5 edges and latches, 9 events",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
}

/// Only what is wanted, and so many; a loss is shown all the same.
#[test]
fn kinds_and_number_can_be_chosen() {
    let port = telling(vec![
        hit(),
        batch(latch(0, 0), 1),
        batch(latch(9, 0), 5),
        hit(),
    ]);
    let args = [
        "events", "--port", &port, "--only", "latches", "--count", "3",
    ];
    let text = umi(&args).exits(2).out;
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 5, "{text}");
    assert!(lines[2].contains("lost: 7 latches") && lines[3].contains("latch 9"));
    assert!(!text.contains("hit"));
}

/// The table has its documented columns, a row for each latch and each loss.
#[test]
fn a_table_has_a_row_for_each() {
    let folder = Folder::new();
    let file = folder.path("scan.csv");
    let port = telling(vec![batch(latch(1, 0), 0), hit(), batch(latch(4, 6), 0)]);
    let args = [
        "events", "--port", &port, "--for", "0.3", "--csv", "-o", &file,
    ];
    let said = umi(&args).exits(2).out;
    assert!(said.contains("2 events, lost: 8 edges"), "{said}");
    let table = std::fs::read_to_string(&file).unwrap();
    let rows: Vec<&str> = table.lines().collect();
    let help = umi(&["events", "--help"]).out;
    for column in rows[0].split(',') {
        assert!(help.contains(column), "{column} is not documented");
    }
    assert_eq!(
        rows[1..],
        [
            "latch,1,trigger,1100000,10,-7,3,,,,1.000000,-0.700000,0.300000,0,",
            "loss,2,trigger,1400000,,,,,,,,,,2,latches",
            "loss,,trigger,1400000,,,,,,,,,,6,edges",
            "latch,4,trigger,1400000,40,-7,3,,,,4.000000,-0.700000,0.300000,0,",
        ]
    );
    for row in &rows {
        assert_eq!(row.split(',').count(), 15, "{row}");
    }
    umi(&args).exits(1).says("--force");
}

/// A journal tells the same way, from the board or from a file.
#[test]
fn a_journal_is_told_too() {
    let mut board = Board::new(0);
    let skip = |number| LatchReport {
        cause: LatchCause::Skip,
        ..latch(number, 0)
    };
    board.push(&Record::Latch(skip(0)));
    board.push(&Record::Latch(skip(2)));
    let port = board.serve();
    let folder = Folder::new();
    let file = folder.path("log.umij");
    umi(&["log", "--port", &port, "-o", &file]).exits(0);
    let from_board = umi(&["events", "--port", &port, "--journal", "--json"]).exits(2);
    let from_file = umi(&["events", &file, "--json"]).exits(2);
    assert_eq!(from_board.out, from_file.out);
    let lines = from_file.json_lines();
    let types: Vec<&str> = lines.iter().map(|l| l["type"].as_str().unwrap()).collect();
    // Three bytes of the control were lost, and a latch.
    assert_eq!(
        types,
        [
            "boot",
            "bytes",
            "loss",
            "bytes_lost",
            "time",
            "input_end",
            "latch",
            "loss",
            "latch",
            "end"
        ]
    );
    assert_eq!(lines[6]["seq"], 5);
    let only = umi(&["events", &file, "--only", "latches"]).exits(2).out;
    for words in [
        "latch 0 by probe",
        "lost: 1 latch by probe",
        "latch 2 by probe",
    ] {
        assert!(only.contains(words), "no {words:?} in\n{only}");
    }
    assert!(!only.contains("started"));
}

/// A scan that the board cannot do is refused, and so is one that nobody can compute.
#[test]
fn impossible_scans_are_refused() {
    let mut board = Board::new(0);
    board.scanner = false;
    let port = board.serve();
    let scan = |more: &[&str]| umi(&[&["events", "--port", &port][..], more].concat());
    scan(&["--trigger-every-us", "100"])
        .exits(2)
        .says("sends no trigger pulses");
    scan(&["--laser"]).exits(2).says("no output for a laser");
    scan(&["--trigger-every-mm", "0.1", "--axis", "x"])
        .exits(1)
        .says("[witness]");
    scan(&["--axis", "x"]).exits(1).says("--trigger-every-mm");
    for alone in [["--trigger-width-us", "20"], ["--trigger-rests", "high"]] {
        scan(&alone).exits(1).says("--trigger-every-us");
    }
    for width in ["0", "1001"] {
        scan(&["--trigger-every-us", "5000", "--trigger-width-us", width])
            .exits(1)
            .says("1..=1000");
    }
    scan(&["--trigger-every-mm", "0.1"]).exits(1).says("--axis");
    scan(&["--trigger-every-counts", "5", "--axis", "q"])
        .exits(1)
        .says("x, y, z, w");
    let port = telling(Vec::new());
    umi(&[
        "events",
        "--port",
        &port,
        "--trigger-every-mm",
        "0.001",
        "--axis",
        "x",
    ])
    .exits(1)
    .says("0.001 mm are 0 counts");
}

/// A scan on a moving machine: a pulse each half millimetre, each with the position of
/// its line, none missing, as a table.
#[test]
fn a_scan_of_a_moving_axis() {
    let folder = Folder::new();
    // 3 s for whoever wants to watch, then 40 mm at 1200 mm/min.
    let machine = Machine::start(
        &folder,
        "%\nO1\nG21 G90 G54\nG4 P3000\nG1 X-40. F1200.\nG4 P60000\nM30\n%\n",
    );
    let file = folder.path("scan.csv");
    umi(&[
        "events",
        "--port",
        &machine.port,
        "--trigger-every-mm",
        "0.5",
        "--axis",
        "x",
        "--laser",
        "--csv",
        "-o",
        &file,
        "--count",
        "80",
    ])
    .exits(0);
    let table = std::fs::read_to_string(&file).unwrap();
    let x: Vec<f64> = table
        .lines()
        .skip(1)
        .map(|row| row.split(',').nth(10).unwrap().parse().unwrap())
        .collect();
    assert_eq!(x.len(), 80);
    for pair in x.windows(2) {
        assert!((pair[0] - pair[1] - 0.5).abs() < 1e-9, "{pair:?}");
    }
}
