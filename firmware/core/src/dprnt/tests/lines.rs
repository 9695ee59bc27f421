//! Line ends, control codes, lengths, losses, time.

use std::vec;
use std::vec::Vec;

use umi_protocol::fault::{FaultCode, FaultKind};
use umi_protocol::line::LineStatus::{Damaged, Matched, NotUnderstood, Separator};
use umi_protocol::pattern::{Coding, ReceiverConfig};

use super::support::*;
use crate::dprnt::{Item, LineSplitter, MAX_LINE};
use crate::units::Micros;

const POINT: &[u8] = b"POINT: 1.0000 2.0000 3.0000";
const XYZ: [f64; 3] = [1.0, 2.0, 3.0];

/// Rule 7: every line end that controls send, and runs of them, is one end; a run makes
/// no blank lines.
#[test]
fn all_line_ends() {
    for end in [
        "\n", "\r", "\n\r", "\n\r\r", "\r\n", "\r\r", "\n\n", "\r\n\r\n",
    ] {
        let end = end.as_bytes();
        let bytes = joined(&[POINT, end, POINT, end]);
        for bytes in [bytes.clone(), iso(&bytes)] {
            let seen = run(&config(&[point_line()]), &bytes);
            assert_eq!(seen.points(), [XYZ; 2], "{end:?}");
            assert_eq!(seen.lines.len(), 2);
            assert_eq!(seen.codes(), []);
        }
    }
}

/// Lines of blanks or asterisks separate; they carry nothing and are no fault.
#[test]
fn blank_lines_separate() {
    let seen = run(&config(&[point_line()]), b"   \r\n***\r\n * \r\n\r\n");
    assert_eq!(seen.statuses(), [Separator; 3]);
    assert_eq!(seen.codes(), []);
}

/// Rules 8 and 9: DC2 and DC4 around the text, before it (as Autodesk's post sends them), and
/// alone: none spoils a line.
#[test]
fn session_marks_spoil_nothing() {
    for (before, after) in [
        (&b"\x12"[..], &b"\x14"[..]),
        (b"\x14\x12", b"\x14"),
        (b"\0\0\x12\0\0", b"\0\x14\0"),
        (b"\x12\x12", b"\x14\x14"),
    ] {
        let bytes = joined(&[before, POINT, b"\n", after, before, POINT, b"\n", after]);
        let seen = run(&config(&[point_line()]), &bytes);
        assert_eq!((seen.points(), seen.codes()), (vec![XYZ; 2], vec![]));
        assert_eq!(seen.texts()[0].as_bytes(), POINT);
    }
}

/// Rule 8: NUL, DEL, XON, XOFF, SI and SO are dropped wherever they stand.
#[test]
fn control_codes_are_dropped_anywhere() {
    for (code, name) in [
        (0x00, "NUL"),
        (0x7F, "DEL"),
        (0x11, "XON"),
        (0x13, "XOFF"),
        (0x0F, "SI"),
        (0x0E, "SO"),
    ] {
        for at in 0..=POINT.len() {
            let (head, tail) = POINT.split_at(at);
            let bytes = joined(&[head, &[code], tail, b"\n"]);
            for bytes in [bytes.clone(), iso(&bytes)] {
                let seen = run(&config(&[point_line()]), &bytes);
                assert_eq!(seen.points(), [XYZ], "{name} at {at}");
                assert_eq!(seen.codes(), []);
            }
        }
    }
}

/// A READ is told between lines, and neither within a line nor within a block or program that
/// is not at its end.
#[test]
fn a_read_between_setups_is_told() {
    let header: &[u8] = b"SPHERE1\n1\n";
    let reads = |parts: &[&[u8]]| {
        let seen = run(&config(&[block(), point_line()]), &joined(parts));
        seen.log.iter().filter(|item| *item == "Reads").count()
    };
    assert_eq!(reads(&[b"\x11", POINT, b"\n\x11\x11"]), 3);
    assert_eq!(reads(&[POINT, b"\x11\n"]), 0);
    assert_eq!(reads(&[header, b"\x11"]), 0);
    assert_eq!(reads(&[header, b" 1.0000 2.0000 3.0000\n\x11"]), 1);
    assert_eq!(reads(&[b"%\nO1\nG0\n\x11"]), 0);
    assert_eq!(reads(&[b"%\nO1\nG0\n%\n\x11"]), 1);
}

/// What a control says to whoever sends to it (NAK and SYN behind XOFF, NAK for XMODEM) is no
/// line when nothing follows it; before text it is damage; and in EIA these are digits.
#[test]
fn talk_alone_is_no_line() {
    let talk: [&[u8]; 4] = [b"\x15", b"\x15\x15\x11", b"\x13\x15", b"\x93\x16"];
    for talk in talk {
        let line = joined(&[POINT, b"\n"]);
        let seen = run_pieces(&config(&[point_line()]), &[(0, talk), (120_000, &line)]);
        assert_eq!((seen.statuses(), seen.codes()), (vec![Matched], vec![]));
        let seen = run(&config(&[point_line()]), &joined(&[talk, &line]));
        assert_eq!((seen.statuses(), seen.points()), (vec![Damaged], vec![]));
    }
    let mut eia = config(&[point_line()]);
    eia.coding = Coding::Eia;
    let seen = run_pieces(&eia, &[(0, b"\x15"), (120_000, b"")]);
    assert_ne!(seen.statuses(), []);
}

/// Noise before DC2 is a damaged line of its own; the first line is whole.
#[test]
fn noise_before_a_session() {
    let bytes = joined(&[b"\x07\xF1~\x12", POINT, b"\n\x14"]);
    let seen = run(&config(&[point_line()]), &bytes);
    assert_eq!(seen.points(), [XYZ]);
    assert_eq!(seen.statuses(), [Damaged, Matched]);
}

/// A line that is too long is named once, with its head; the next is read.
#[test]
fn too_long() {
    let long: Vec<u8> = b"A".repeat(MAX_LINE + 500);
    let bytes = joined(&[&long, b"\n", POINT, b"\n"]);
    let seen = run(&config(&[point_line()]), &bytes);
    assert_eq!(seen.statuses(), [Damaged, Matched]);
    assert_eq!(seen.texts()[0].len(), MAX_LINE);
    assert_eq!(seen.faults[0].kind, FaultKind::LineTooLong { kept: 160 });
    assert_eq!(seen.counters.bytes_discarded, 500);
    // The longest that is not.
    let bytes = joined(&[&long[..MAX_LINE], b"\n"]);
    assert_eq!(
        run(&config(&[point_line()]), &bytes).statuses(),
        [NotUnderstood]
    );
}

/// A long line whose end would be a point is no point.
#[test]
fn too_long_is_never_a_point() {
    let blanks = b" ".repeat(MAX_LINE);
    for bytes in [
        joined(&[POINT, &blanks, b"\n"]),
        joined(&[&blanks, POINT, b"\n"]),
    ] {
        let seen = run(&config(&[point_line()]), &bytes);
        assert_eq!(
            (seen.hits.len(), seen.codes()),
            (0, vec![FaultCode::LineTooLong])
        );
    }
}

/// Bytes lost before the receiver damage the line in which they were lost.
#[test]
fn lost_bytes_damage_the_line() {
    for at in 0..POINT.len() {
        let mut receiver = LineSplitter::new(&config(&[point_line()]));
        let mut seen = Seen::default();
        let mut sink = |item: Item<'_>| seen.take(item);
        let (head, tail) = POINT.split_at(at);
        receiver.receive(head, Micros(1), &mut sink);
        receiver.lost(3, Micros(1), &mut sink);
        receiver.receive(&joined(&[tail, b"\n", POINT, b"\n"]), Micros(1), &mut sink);
        assert_eq!(seen.statuses(), [Damaged, Matched]);
        assert_eq!(seen.faults[0].kind, FaultKind::BufferOverrun { lost: 3 });
        assert_eq!(seen.faults[0].line, 1);
        assert_eq!(receiver.counters().bytes_lost, 3);
    }
}

/// An unfinished last line counts if its format shows that it is whole: a file
/// without a last line end. A cut one does not.
#[test]
fn unfinished_last_line() {
    let seen = run(&config(&[point_line()]), POINT);
    assert_eq!((seen.points(), seen.codes()), (vec![XYZ], vec![]));
    for cut in 1..POINT.len() {
        let seen = run(&config(&[point_line()]), &POINT[..cut]);
        assert_eq!((seen.hits.len(), seen.faults.len()), (0, 1), "cut at {cut}");
    }
    // Without a format nothing shows whether digits are missing.
    let seen = run(&config(&[words("", "XYZ", "")]), b"X1.5Y2.5Z3.5");
    assert_eq!(
        (seen.hits.len(), seen.codes()),
        (0, vec![FaultCode::LineUnterminated])
    );
}

/// Silence ends an unfinished line, at the deadline and not before, whether
/// `on_time` is called or the next byte shows it.
#[test]
fn silence_ends_a_line() {
    let config = ReceiverConfig {
        idle_timeout_s: 5,
        ..config(&[point_line()])
    };
    let mut receiver = LineSplitter::new(&config);
    let mut seen = Seen::default();
    assert_eq!(receiver.deadline(), None);
    receiver.receive(b"POINT: 1.0", Micros(1_000_000), &mut |item| {
        seen.take(item)
    });
    assert_eq!(receiver.deadline(), Some(Micros(6_000_000)));
    receiver.on_time(Micros(5_999_999), &mut |item| seen.take(item));
    assert!(seen.log.is_empty());
    let mut other = receiver.clone();
    receiver.on_time(Micros(6_000_000), &mut |item| seen.take(item));
    assert_eq!(seen.codes(), [FaultCode::LineUnterminated]);
    assert_eq!(receiver.deadline(), None);

    let mut by_byte = Seen::default();
    other.push(b'P', Micros(6_000_000), &mut |item| by_byte.take(item));
    assert_eq!(by_byte.codes(), [FaultCode::LineUnterminated]);
}

/// A line says when its first and last byte came and where it stands.
#[test]
fn line_times_and_places() {
    let mut receiver = LineSplitter::new(&config(&[point_line()]));
    let mut lines = Vec::new();
    let mut sink = |item: Item<'_>| {
        if let Item::Line(line) = item {
            lines.push((line.number, line.byte_offset, line.first, line.last));
        }
    };
    for (place, byte) in (0u64..).zip(b"\x12AB\r\n\0CD\n") {
        receiver.push(*byte, Micros(place * 1000), &mut sink);
    }
    assert_eq!(
        lines,
        [
            (1, 1, Micros(1000), Micros(3000)),
            (2, 6, Micros(6000), Micros(8000))
        ]
    );
}

/// Foreign lines are kept and named, and do not disturb.
#[test]
fn not_understood_is_kept() {
    let bytes = joined(&[b"PART-ABC OP10\n", POINT, b"\n"]);
    let seen = run(&config(&[point_line()]), &bytes);
    assert_eq!(seen.statuses(), [NotUnderstood, Matched]);
    assert_eq!(seen.faults[0].text.as_str(), "PART-ABC OP10");
    assert_eq!(seen.counters.lines_not_understood, 1);
}

/// A carriage return alone ends lines in every code that has one (Haas).
#[test]
fn carriage_return_alone() {
    let bytes = joined(&[POINT, b"\r", POINT, b"\r"]);
    for coding in [Coding::Auto, Coding::Ascii] {
        let config = ReceiverConfig {
            coding,
            ..config(&[point_line()])
        };
        assert_eq!(run(&config, &bytes).points(), [XYZ; 2]);
    }
    let config = ReceiverConfig {
        coding: Coding::AsciiOdd,
        ..config(&[point_line()])
    };
    assert_eq!(run(&config, &odd(&bytes)).points(), [XYZ; 2]);
}
