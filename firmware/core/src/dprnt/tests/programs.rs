//! Part programs punched on the same port.

use std::string::{String, ToString as _};
use std::vec;
use std::vec::Vec;

use umi_protocol::fault::{BlockEndCause, FaultCode, FaultKind};
use umi_protocol::line::LineStatus::{Matched, Program, Separator};
use umi_protocol::pattern::{BlockPattern, LinePattern, ReceiverConfig};

use super::support::*;
use crate::dprnt::LineSplitter;
use crate::dprnt::line::checked::CheckedLine;
use crate::units::Micros;

const POINT: &[u8] = b"X1.000 Y2.000 Z3.000\n";

fn all_patterns() -> ReceiverConfig {
    config(&[block(), point_line(), words("", "XYZ", ""), checked()])
}

/// A program as the thesis' sphere routine, full of what looks like points.
const BODY: &[u8] = b"(POINT: 1.0000 2.0000 3.0000)\nPOINT: 1.0000 2.0000 3.0000\n\
    X1.0Y2.0Z3.0\nN10 X1.0 Y2.0 Z3.0\nDPRNT[SPHERE1]\n2\n 1.0000 2.0000 3.0000\nM30\n";
const BODY_LINES: u32 = 8;

fn programs(seen: &Seen) -> Vec<FaultKind> {
    seen.faults.iter().map(|fault| fault.kind).collect()
}

/// Nothing in a program becomes a point, however it is introduced, and what
/// comes after its end is read again.
#[test]
fn no_points_from_programs() {
    for head in [
        &b"%\nO1050\n"[..],
        b"%\nO1050(PROBES 1)\n",
        b"%\n:1050\n",
        b"%\r\n\r\nO1050 (PROBES 1)\r\n",
        b"O1050\n",
        b"O1050(PROBES 1)\n",
        b":0001\n",
        b"\0\0\0%\n\r\rO1050\n\r\r",
    ] {
        let bytes = joined(&[head, BODY, b"%\n", POINT]);
        let seen = run(&all_patterns(), &bytes);
        let kinds = programs(&seen);
        assert_eq!(
            kinds,
            [FaultKind::ProgramReceived {
                lines: BODY_LINES + 1
            }],
            "{head:?}"
        );
        assert_eq!(seen.points(), [[1.0, 2.0, 3.0]]);
        assert_eq!(seen.statuses().last(), Some(&Matched));
        assert_eq!(seen.starts.len(), 0);
    }
}

/// Programs whose name stands at the `%`, and programs without a number.
#[test]
fn named_and_nameless_programs() {
    for head in [
        &b"%1050,MX,\n"[..],
        b"%_N_PROBE_MPF\n",
        b"$PROBE.MIN%\n",
        b"%\n(PROBES 1)\n",
        b"%\nG21 G40 G90 G54\n",
        b"%\nN1 G90\n",
        b"%\n<PROBE>\n",
        b"%\n/M1\n",
    ] {
        let bytes = joined(&[head, BODY, b"%\n", POINT]);
        let seen = run(&all_patterns(), &bytes);
        assert_eq!(
            programs(&seen),
            [FaultKind::ProgramReceived {
                lines: BODY_LINES + 1
            }]
        );
        assert_eq!(seen.points().len(), 1);
    }
}

/// Printed text that begins and ends with `%` is printed text.
#[test]
fn percent_alone_is_no_program() {
    let printed = joined(&[b"%\n", POINT, POINT, b"%\n"]);
    let seen = run(&all_patterns(), &joined(&[&printed, &printed]));
    assert_eq!((seen.points().len(), seen.codes()), (4, vec![]));
    assert_eq!(
        seen.statuses()[..4],
        [Separator, Matched, Matched, Separator]
    );

    let block = b"%\r\nSPHERE1\r\n***\r\n1\r\n 1.0000 2.0000 3.0000\r\n***\r\n%\r\n";
    let seen = run(&all_patterns(), block);
    assert_eq!((seen.points().len(), seen.codes()), (1, vec![]));

    // A text line makes it printed text too, also where NC words follow.
    let text = b"%\nSTART\nG330 N 1 A0. B0. C0.\nX1.000 Y2.000 Z3.000\n%\n";
    assert_eq!(run(&all_patterns(), text).points().len(), 1);
}

/// A program begins after printed text, and printed text after a program.
#[test]
fn programs_and_print_in_turn() {
    let bytes = joined(&[
        b"%\n",
        POINT,
        b"%\n%\nO1\n",
        BODY,
        b"%\n",
        POINT,
        b"%\n",
        POINT,
        b"%\n",
    ]);
    let seen = run(&all_patterns(), &bytes);
    assert_eq!(seen.points().len(), 3);
    assert_eq!(
        programs(&seen),
        [FaultKind::ProgramReceived {
            lines: BODY_LINES + 1
        }]
    );
}

/// DC4 ends a program properly; DC2, silence and the end of the input end one
/// that has no end, and say so.
#[test]
fn unterminated_programs() {
    let program = joined(&[b"%\nO1\n", BODY]);
    let lines = BODY_LINES + 1;
    let ends: [(Vec<u8>, FaultKind); 3] = [
        (
            joined(&[&program, b"\x14", POINT]),
            FaultKind::ProgramReceived { lines },
        ),
        (
            joined(&[&program, b"\x12", POINT]),
            FaultKind::ProgramUnterminated { lines },
        ),
        (program.clone(), FaultKind::ProgramUnterminated { lines }),
    ];
    for (bytes, kind) in ends {
        let seen = run(&all_patterns(), &bytes);
        assert_eq!(programs(&seen), [kind]);
        assert_eq!(
            seen.points().len(),
            usize::from(bytes.len() > program.len())
        );
    }
    let seen = run_pieces(&all_patterns(), &[(0, &program), (120_000, POINT)]);
    assert_eq!(programs(&seen), [FaultKind::ProgramUnterminated { lines }]);
    assert_eq!(seen.points().len(), 1);
    // Not a moment too early.
    let seen = run_pieces(&all_patterns(), &[(0, &program), (119_999, POINT)]);
    assert_eq!(seen.points().len(), 0);
}

/// The last `%` of a punch often has no line end. It ends the program all the same.
#[test]
fn last_percent_without_line_end() {
    let program = joined(&[b"%\nO1\n", BODY, b"%\0\0\0"]);
    for next in [&b"\x12"[..], b"\x14\x12", b""] {
        let seen = run(&all_patterns(), &joined(&[&program, next]));
        assert_eq!(
            programs(&seen),
            [FaultKind::ProgramReceived {
                lines: BODY_LINES + 1
            }]
        );
    }
    // The feed after it shows that nothing more belongs to it, in every code.
    for encode in [<[u8]>::to_vec, iso, odd] {
        let mut bytes = encode(&program[..program.len() - 3]);
        bytes.extend_from_slice(&[0; 3]);
        bytes.extend_from_slice(&encode(POINT));
        let seen = run(&all_patterns(), &bytes);
        assert_eq!(
            (seen.codes(), seen.hits.len()),
            (vec![FaultCode::ProgramReceived], 1)
        );
    }
    // Without feed, silence does.
    let program = &program[..program.len() - 3];
    let seen = run_pieces(&all_patterns(), &[(0, program), (120_000, POINT)]);
    assert_eq!(
        (seen.codes(), seen.hits.len()),
        (vec![FaultCode::ProgramReceived], 1)
    );
}

/// A damaged line in a program belongs to it and ends nothing.
#[test]
fn damage_inside_a_program() {
    let mut bytes = iso(&joined(&[b"%\nO1\nG0\n%\n", POINT]));
    // Neither line can be read any more; without its `%` the program goes on.
    bytes[6] ^= 0x01;
    bytes[8] ^= 0x01;
    let seen = run(&all_patterns(), &bytes);
    assert_eq!(seen.hits.len(), 0);
    assert_eq!(seen.codes().last(), Some(&FaultCode::ProgramUnterminated));
    assert!(seen.statuses().contains(&Program));
}

/// A program breaks an open block, and the block says so.
#[test]
fn program_breaks_a_block() {
    let seen = run(
        &all_patterns(),
        b"SPHERE1\n2\n 1.0000 2.0000 3.0000\n%\nO1\nM30\n%\n",
    );
    assert_eq!(seen.ends[0].ended_by, BlockEndCause::Program);
    assert!(!seen.ends[0].complete);
}

/// A header or a whole checked line is in no program: what seemed to be one ends there, and
/// the setup is read. A letter with a number is in every program, and so is a checked line
/// with a wrong check value.
#[test]
fn a_setup_ends_what_seemed_a_program() {
    let line = checked_line();
    let damaged = line.replace('3', "4");
    let block = "SPHERE1\n1\n 1.0000 2.0000 3.0000\n***\n";
    for (text, hits, code) in [
        (block, 1, FaultCode::ProgramUnterminated),
        (&line, 1, FaultCode::ProgramUnterminated),
        (&damaged, 0, FaultCode::ProgramReceived),
    ] {
        let bytes = std::format!("O1050\n{text}\n%\n");
        let seen = run(&all_patterns(), bytes.as_bytes());
        assert_eq!(
            (seen.hits.len(), seen.codes()),
            (hits, vec![code]),
            "{text}"
        );
    }
    let mut letter = config(&[block_of("N")]);
    letter.idle_timeout_s = 1;
    let seen = run(&letter, b"%\nO1050\nN1\n1\n 1.0000 2.0000 3.0000\n%\n");
    assert_eq!(
        (seen.hits.len(), seen.codes()),
        (0, vec![FaultCode::ProgramReceived])
    );
}

fn checked_line() -> String {
    CheckedLine {
        run: 1,
        sequence: 1,
        feature: 1,
        approach: None,
        touched: true,
        feed_um_per_min: 0,
        point_um: [1000, 2000, 3000],
    }
    .to_string()
}

/// A program whose end does not come is told after ten seconds of quiet and not before, until its `%`, a
/// header or a checked line ends it.
#[test]
fn a_program_without_an_end_is_told() {
    const QUIET_US: u64 = 10_000_000;
    for (end, ends) in [
        ("%", true),
        ("SPHERE1", true),
        (&checked_line(), true),
        ("X1.0Y2.0", false),
        (&checked_line().replace('3', "4"), false),
    ] {
        let mut receiver = LineSplitter::new(&all_patterns());
        let mut told = |text: &str, quiet_us: u64| {
            receiver.receive(text.as_bytes(), Micros(1), &mut |_| ());
            receiver.punched_lines(Micros(1 + quiet_us))
        };
        assert_eq!(told("X1.000 Y2.000 Z3.000\n", QUIET_US), None);
        assert_eq!(told("%\nO1050\nX1.0Y2.0Z3.0\n", QUIET_US - 1), None);
        assert_eq!(told("", QUIET_US), Some(2));
        let left = told(&std::format!("{end}\n"), QUIET_US);
        assert_eq!(left, (!ends).then_some(3), "{end}");
    }
}

fn block_of(header: &str) -> LinePattern {
    LinePattern::Block(BlockPattern {
        headers: [header.try_into().unwrap()].into_iter().collect(),
        ..BlockPattern::default()
    })
}

/// A job's own pattern has precedence over an O-number that only looks like one.
#[test]
fn a_pattern_may_begin_with_o() {
    let config = config(&[template("O{i} X{x} Y{y}", None)]);
    let seen = run(&config, b"O1234 X1.5 Y2.5\nO1235 X1.5 Y2.5\n");
    assert_eq!((seen.points().len(), seen.codes()), (2, vec![]));
}
