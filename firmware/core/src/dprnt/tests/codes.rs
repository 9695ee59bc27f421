//! Codes and parity: configured, detected, damaged, changed.

use std::vec;
use std::vec::Vec;

use umi_protocol::fault::{FaultCode, FaultKind};
use umi_protocol::line::LineStatus::{Damaged, Matched};
use umi_protocol::pattern::{Coding, ReceiverConfig};

use super::support::*;
use crate::dprnt::LineSplitter;
use crate::units::Micros;

const POINT: &[u8] = b"POINT: -135.5105 -136.3415 72.0620\n";
const XYZ: [f64; 3] = [-135.5105, -136.3415, 72.062];

type Encode = fn(&[u8]) -> Vec<u8>;

fn ascii(text: &[u8]) -> Vec<u8> {
    text.to_vec()
}

const CODINGS: [(Coding, Encode); 4] = [
    (Coding::Ascii, ascii),
    (Coding::IsoEven, iso),
    (Coding::AsciiOdd, odd),
    (Coding::Eia, eia),
];

fn config_for(coding: Coding) -> ReceiverConfig {
    // EIA has no colon, so a label that every code has.
    let pattern = template("PT {x} {y} {z}", None);
    ReceiverConfig {
        coding,
        ..config(&[pattern])
    }
}

fn line() -> &'static [u8] {
    b"PT -135.5105 -136.3415 72.0620\n"
}

/// Every code is read when configured, and detected when not.
#[test]
fn each_code_is_read_and_detected() {
    for (coding, encode) in CODINGS {
        for configured in [coding, Coding::Auto] {
            let mut receiver = LineSplitter::new(&config_for(configured));
            let mut seen = Seen::default();
            let bytes = encode(line());
            receiver.receive(&bytes, Micros(0), &mut |item| seen.take(item));
            assert_eq!(seen.points(), [XYZ], "{coding} as {configured}");
            assert_eq!(receiver.coding(), coding);
            assert_eq!(seen.codes(), []);
        }
    }
}

/// Our EIA encoder for tests follows RS-244: odd parity everywhere, and the
/// letters and digits of the standard.
#[test]
fn test_encoder_follows_rs244() {
    let all = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ .,+-/&()%";
    let codes = [
        0x20, 0x01, 0x02, 0x13, 0x04, 0x15, 0x16, 0x07, 0x08, 0x19, 0x61, 0x62, 0x73, 0x64, 0x75,
        0x76, 0x67, 0x68, 0x79, 0x51, 0x52, 0x43, 0x54, 0x45, 0x46, 0x57, 0x58, 0x49, 0x32, 0x23,
        0x34, 0x25, 0x26, 0x37, 0x38, 0x29, 0x10, 0x6B, 0x3B, 0x70, 0x40, 0x31, 0x0E, 0x1A, 0x4A,
        0x0B,
    ];
    assert_eq!(eia(all), codes);
    assert!(codes.iter().all(|code| code.count_ones() % 2 == 1));
    // And the receiver reads all of them back.
    let config = ReceiverConfig {
        coding: Coding::Eia,
        ..config(&[point_line()])
    };
    let seen = run(&config, &joined(&[&codes, &[0x80]]));
    assert_eq!(seen.texts(), [core::str::from_utf8(all).unwrap()]);
}

/// Rule 8: in a code with parity no single wrong bit gets through, wherever it is: the
/// wrong point is never reported, and the line (or its end) is named.
#[test]
fn no_single_wrong_bit_gets_through() {
    for (coding, encode) in &CODINGS[1..] {
        let good = encode(&line().repeat(3));
        for configured in [*coding, Coding::Auto] {
            for bit in 0..good.len() * 8 {
                let mut bytes = good.clone();
                bytes[bit / 8] ^= 1 << (bit % 8);
                let seen = run(&config_for(configured), &bytes);
                assert!(seen.hits.len() < 3, "{coding} as {configured}, bit {bit}");
                assert!(seen.points().iter().all(|point| *point == XYZ));
                assert!(
                    !seen.faults.is_empty(),
                    "{coding} as {configured}, bit {bit}"
                );
            }
        }
    }
}

/// A damaged line is kept and named with the number of wrong characters and the
/// place of the first.
#[test]
fn damaged_line_is_kept() {
    let mut bytes = iso(&POINT.repeat(2));
    bytes[8] ^= 0x04;
    bytes[20] ^= 0x80;
    let seen = run(&config(&[point_line()]), &bytes);
    assert_eq!(seen.statuses(), [Damaged, Matched]);
    assert_eq!(seen.texts()[0], "POINT: -?35.5105 -13?.3415 72.0620");
    assert_eq!(
        seen.faults[0].kind,
        FaultKind::BadParity { count: 2, first: 9 }
    );
    assert_eq!((seen.faults[0].line, seen.faults[0].byte_offset), (1, 0));
    assert_eq!(seen.counters.of(FaultCode::BadParity), 1);
    assert_eq!(seen.counters.lines_damaged, 1);
}

/// A minus sign with one wrong bit is a CR without parity. In ISO code it does
/// not end the line, or the rest would be a point with a lost sign.
#[test]
fn wrong_minus_does_not_split_the_line() {
    let block = b"SPHERE1\n2\n -135.0190 -136.6200 148.6090\n -122.3130 -136.6200 135.9090\n";
    let mut bytes = iso(block);
    let minus = bytes.iter().position(|b| *b == 0x2D).unwrap();
    bytes[minus] = 0x0D;
    let seen = run(&config(&[super::support::block()]), &bytes);
    assert_eq!(seen.points(), [[-122.313, -136.62, 135.909]]);
    assert_eq!(seen.hits[0].index, Some(2));
    assert!(!seen.ends[0].complete);
}

/// ASCII and ISO lines are not split at 0x80, whatever the coding says.
#[test]
fn eob_does_not_split_iso_or_ascii() {
    for encode in [ascii, iso] {
        let mut bytes = encode(&POINT.repeat(3));
        bytes[POINT.len() + 12] = 0x80;
        let seen = run(&config(&[point_line()]), &bytes);
        assert_eq!(seen.statuses(), [Matched, Damaged, Matched]);
    }
}

/// A single wrong bit in a one-character line does not change the code: the
/// count 3 of an ISO block is not read as an ASCII 2.
#[test]
fn short_lines_do_not_change_the_code() {
    let mut bytes = iso(b"SPHERE1\n3\n");
    let count = bytes.len() - 2;
    assert_eq!(bytes[count], 0x33);
    bytes[count] = 0x32;
    let seen = run(&config(&[block()]), &bytes);
    assert_eq!(seen.statuses(), [Matched, Damaged]);
    assert_eq!(seen.codes()[0], FaultCode::BadParity);
}

/// The control is set to another code while we listen: the first line that is
/// long enough to show it is read in the new one, and the change is named.
#[test]
fn change_of_code_is_followed_and_named() {
    for (from, before) in CODINGS {
        for (to, after) in CODINGS {
            if from == to {
                continue;
            }
            let bytes = joined(&[&before(line()), &after(&line().repeat(2))]);
            let seen = run(&config_for(Coding::Auto), &bytes);
            assert_eq!(seen.points(), [XYZ; 3], "{from} to {to}: {:#?}", seen.log);
            let kinds: Vec<_> = seen.faults.iter().map(|fault| fault.kind).collect();
            assert_eq!(kinds, [FaultKind::CodingChanged { from, to }]);
        }
    }
}

/// Short lines alone take a few until the change is believed; none of them is
/// misread meanwhile.
#[test]
fn change_of_code_in_short_lines() {
    let bytes = joined(&[&iso(POINT), &b"1 2 4\n".repeat(9)]);
    let seen = run(&config(&[point_line()]), &bytes);
    let codes = seen.codes();
    assert_eq!(
        codes
            .iter()
            .filter(|code| **code == FaultCode::CodingChanged)
            .count(),
        1
    );
    assert_eq!(codes[0], FaultCode::BadParity);
    assert!(
        seen.texts()[1..]
            .iter()
            .all(|text| text.contains('?') || *text == "1 2 4")
    );
    assert_eq!(seen.texts().last(), Some(&"1 2 4"));
}

/// Device controls are no parity errors in EIA code, though their parity is even.
#[test]
fn device_controls_in_eia() {
    let bytes = joined(&[
        &[0x12],
        &eia(b"PT 1.0 "),
        &[0x93, 0x11],
        &eia(b"2.0 3.0\n"),
        &[0x14],
    ]);
    for coding in [Coding::Eia, Coding::Auto] {
        let seen = run(&config_for(coding), &bytes);
        assert_eq!(
            (seen.points(), seen.codes()),
            (vec![[1.0, 2.0, 3.0]], vec![])
        );
    }
}

/// A three in EIA code is the code of XOFF, and stays a three.
#[test]
fn eia_three_is_not_xoff() {
    let seen = run(&config_for(Coding::Auto), &eia(b"PT 33.3 -3.0 0.3\n"));
    assert_eq!(seen.points(), [[33.3, -3.0, 0.3]]);
}

/// Bytes with bit 7 set in a plain ASCII text (quotes from a word processor)
/// are unknown characters, not another code.
#[test]
fn high_bytes_in_ascii() {
    let bytes = joined(&[POINT, b"PART \xE2\x80\x9CA1\xE2\x80\x9D\n", POINT]);
    let seen = run(&config(&[point_line()]), &bytes);
    assert_eq!(seen.statuses(), [Matched, Damaged, Matched]);
    assert_eq!(
        seen.faults[0].kind,
        FaultKind::UnknownCharacter {
            count: 6,
            first: 6,
            byte: 0xE2
        }
    );
}
