//! Byte-exact captures: recorded (R), printed in manuals (M), constructed (C).

use std::vec;
use std::vec::Vec;

use umi_protocol::fault::{FaultCode, FaultKind};
use umi_protocol::line::LineStatus::{Damaged, Matched, NotUnderstood, Program};
use umi_protocol::pattern::{
    FieldFormat, LabelledWordsPattern, LinePattern, Overflow, ReceiverConfig, Travel,
};

use super::support::*;
use crate::dprnt::{Digits, Doubts};

/// Brother NC Programming Manual eCOM3NCPR6 (2019), section 6.6: `DPRNT`, leading
/// zeros as blanks. ISO code, CR LF, a blank between sign and digits, high digits
/// dropped, integer part missing.
const M1: [u8; 32] = [
    0xD8, 0xA0, 0x2D, 0xA0, 0xB1, 0xB2, 0x33, 0x2E, 0xB4, 0x35, 0x36, 0x30, 0x59, 0xA0, 0xA0, 0xB2,
    0x33, 0x2E, 0xB4, 0x36, 0x5A, 0xA0, 0xA0, 0xA0, 0x30, 0xA0, 0x2D, 0x2E, 0xB4, 0x36, 0x8D, 0x0A,
];
/// The same without leading blanks.
const M2: [u8; 28] = [
    0xD8, 0xA0, 0x2D, 0xB1, 0xB2, 0x33, 0x2E, 0xB4, 0x35, 0x36, 0x30, 0x59, 0xA0, 0xB2, 0x33, 0x2E,
    0xB4, 0x36, 0x5A, 0xA0, 0x30, 0xA0, 0x2D, 0x2E, 0xB4, 0x36, 0x8D, 0x0A,
];

fn brother() -> [LinePattern; 1] {
    [template("X{x}Y{y}Z{skip}", None)]
}

/// Rules 1, 5 and 8. M1 and M2: the text is as printed, X has its sign, Y its remaining digits.
#[test]
fn m1_m2_brother_dprnt() {
    let m1 = run(&config(&brother()), &M1);
    assert_eq!(m1.texts(), ["X - 123.4560Y  23.46Z   0 -.46"]);
    let m2 = run(&config(&brother()), &M2);
    assert_eq!(m2.texts(), ["X -123.4560Y 23.46Z 0 -.46"]);
    for seen in [m1, m2] {
        assert_eq!(seen.points(), [[-123.456, 23.46, 0.0]]);
        let digits = [
            Some(Digits {
                integer: 3,
                decimals: 4,
            }),
            Some(Digits {
                integer: 2,
                decimals: 2,
            }),
            None,
        ];
        assert_eq!(seen.hits[0].digits, digits);
        assert_eq!(seen.codes(), []);
    }
}

/// Rule 2. M1 again as a job would declare it, `[22]` for Y: 23.46 may have been
/// 123.46.
#[test]
fn m1_dropped_digits_are_suspect() {
    let format = FieldFormat {
        integer_digits: 2,
        decimals: 2,
        overflow: Overflow::DropsDigits,
    };
    let config = config(&[template("X{skip}Y{y}Z{z} -.46", Some(format))]);
    let with_z = run(&config, b"X - 123.4560Y  23.46Z   0.00 -.46\r\n");
    assert!(with_z.hits[0].doubts.contains(Doubts::OVERFLOW_SUSPECT));
    assert!(with_z.codes().contains(&FaultCode::OverflowSuspect));
}

/// Rule 11. M3, M4 and C5: BPRNT of Brother, NCT and Fanuc is refused by its name and
/// gives no point, whatever the pattern.
#[test]
fn m3_m4_c5_bprnt_is_refused() {
    let m3 = [
        0x44, 0x41, 0xD4, 0x41, 0xA0, 0xD8, 0xA0, 0x00, 0x00, 0x30, 0x3A, 0x59, 0xA0, 0xFF, 0xFF,
        0xCF, 0xC6, 0x5A, 0xA0, 0x00, 0x00, 0x00, 0x00, 0x8D, 0x0A,
    ];
    let m4 = [
        0xC3, 0xA0, 0xAF, 0xD8, 0x00, 0x04, 0xDC, 0x1E, 0x59, 0x00, 0x00, 0x02, 0xD3, 0x4D, 0x00,
        0x00, 0x00, 0x18, 0x0A,
    ];
    let c5 = [
        0xC3, 0xA0, 0xA0, 0xD8, 0x00, 0x00, 0x01, 0x96, 0x59, 0xFF, 0xE7, 0x00, 0x00, 0x4D, 0x00,
        0x00, 0x00, 0x0C, 0x0A,
    ];
    let patterns = [
        words("DATA", "X", "M"),
        words("C", "X", "M"),
        template("{skip}X{x}Y{y}", None),
    ];
    for capture in [&m3[..], &m4, &c5] {
        let seen = run(&config(&patterns), capture);
        assert_eq!(seen.points(), Vec::<[f64; 3]>::new());
        assert_eq!(seen.statuses(), [Damaged]);
        assert_eq!(seen.codes(), [FaultCode::BinaryData]);
    }
}

/// Binary values whose bytes happen to be digits do not become coordinates.
#[test]
fn binary_digits_are_no_numbers() {
    let bytes = [
        b'X', 0, 0, b'3', b'1', b'Y', 0, 0, b'4', b'2', b'Z', 0, 0, b'5', b'3', b'\n',
    ];
    let seen = run(&config(&[words("", "XYZ", "")]), &bytes);
    assert_eq!(
        (seen.hits.len(), seen.codes()),
        (0, vec![FaultCode::BinaryData])
    );
}

/// M5: HEIDENHAIN TNC 306/406 technical manual: NUL leader, CR LF, ETX, EOT.
#[test]
fn m5_heidenhain_transfer() {
    let line = b"POINT: 1.0000 2.0000 3.0000\r\n";
    let capture = joined(&[b"\x11\0\0\0", line, line, b"\x03", b"\x04"]);
    let seen = run(&config(&[point_line()]), &capture);
    assert_eq!(seen.points(), [[1.0, 2.0, 3.0]; 2]);
    assert_eq!(seen.codes(), []);
    // The marks of one transfer do not spoil the next.
    let twice = joined(&[&capture, &capture]);
    assert_eq!(run(&config(&[point_line()]), &twice).points().len(), 4);
}

/// R1: a classic Haas sends a program by XMODEM (recorded 2017-10-30). Nothing
/// in it is a point; the program is recognised inside the packets.
#[test]
fn r1_haas_xmodem_program() {
    let capture = joined(&[
        b"\x01\x01\xfe\n%\nO05555(CS390_Test_NC)\n(Using G0 which travels along dogleg path.)\n",
        b"(T1 D=2. CR=0. - ZMIN=-0.125 - face mill)\n(T3 D=0.5 CR=0. -\x98",
        b"\x01\x08\xf70.\n\nN66435M05\nN66440M09\nN66445G53G00Z0.\nN66455X2.1875\nX1.Y2.Z3.\n",
        b"N66460G53Y0.\nN66465M30\n\n%\n",
        &[0x1a; 48],
        b"\xe4\x04",
    ]);
    let patterns = [words("", "XYZ", ""), words("N66455", "X", "")];
    let seen = run(&config(&patterns), &capture);
    assert_eq!(seen.points(), Vec::<[f64; 3]>::new());
    assert!(seen.codes().contains(&FaultCode::ProgramReceived));
    assert!(seen.texts().contains(&"X1.Y2.Z3."));
}

/// R2: what the Haas sends while it receives (NAK, ACK, CAN) is no text.
#[test]
fn r2_haas_xmodem_answers() {
    let seen = run(
        &config(&[point_line()]),
        b"\x15\x15\x15\x06\x15\x06\x18\x18\x18",
    );
    assert_eq!((seen.hits.len(), seen.statuses()), (0, vec![Damaged]));
    assert_eq!(seen.codes().len(), 1, "{:?}", seen.faults);
}

/// Rules 6, 7 and 8. C1, C2, C3: Fanuc, `[53][53][20]`, with and without leading blanks, LF and
/// LF CR, between DC2 and DC4.
#[test]
fn c1_c2_c3_fanuc_xyt() {
    let c1 = [
        0x12, 0xD8, 0xA0, 0xA0, 0xA0, 0xB1, 0xB2, 0xB8, 0x2E, 0xB4, 0xB7, 0xB4, 0x59, 0x2D, 0xA0,
        0xA0, 0xA0, 0x39, 0xB1, 0x2E, 0xB2, 0x30, 0x30, 0xD4, 0xA0, 0xB2, 0x33, 0x0A, 0x14,
    ];
    let c2 = b"\x12X128.474Y-91.200T23\n\x14";
    let c3 = b"\x12X   128.474Y-   91.200T 23\n\r\x14";
    let patterns = [words("", "XY", "T")];
    for (capture, text) in [
        (&c1[..], "X   128.474Y-   91.200T 23"),
        (c2, "X128.474Y-91.200T23"),
        (&iso(c2), "X128.474Y-91.200T23"),
        (c3, "X   128.474Y-   91.200T 23"),
        (&iso(c3), "X   128.474Y-   91.200T 23"),
    ] {
        let seen = run(&config(&patterns), capture);
        assert_eq!(seen.texts(), [text]);
        assert_eq!(seen.points(), [[128.474, -91.2, 0.0]]);
        assert_eq!(seen.hits[0].digits[2], None);
        assert_eq!(seen.codes(), []);
    }
}

/// C4: the same in EIA code, ended by EOB.
#[test]
fn c4_eia() {
    let c4 = [
        0x37, 0x10, 0x10, 0x10, 0x01, 0x02, 0x08, 0x6B, 0x04, 0x07, 0x04, 0x38, 0x40, 0x10, 0x10,
        0x10, 0x19, 0x01, 0x6B, 0x02, 0x20, 0x20, 0x80,
    ];
    assert_eq!(eia(b"X   128.474Y-   91.200\n"), c4);
    let seen = run(&config(&[words("", "XY", "")]), &c4);
    assert_eq!(seen.texts(), ["X   128.474Y-   91.200"]);
    assert_eq!(seen.points(), [[128.474, -91.2, 0.0]]);
}

fn p_words(integer_digits: u8) -> [LinePattern; 1] {
    let format = FieldFormat {
        integer_digits,
        decimals: 3,
        overflow: Overflow::DropsDigits,
    };
    let pattern = LabelledWordsPattern {
        format: Some(format),
        ..LabelledWordsPattern::default()
    };
    [LinePattern::LabelledWords(pattern)]
}

/// Rule 4. C6: a negative zero is zero.
#[test]
fn c6_negative_zero() {
    let seen = run(&config(&p_words(4)), b"P 1 X  12.346 Y-  0.000 Z-100.000\n");
    assert_eq!(seen.points(), [[12.346, 0.0, -100.0]]);
    assert!(seen.hits[0].position.mm.y.is_sign_positive());
    assert_eq!(seen.hits[0].index, Some(1));
    assert_eq!(seen.codes(), []);
}

/// Rule 3. C7: two null coordinates beside a real one cannot be told from a point on
/// the axis; three can, and are doubted.
#[test]
fn c7_null_prints_as_zero() {
    let seen = run(&config(&p_words(4)), b"P 1 X   0.000 Y   0.000 Z-  0.500\n");
    assert_eq!(seen.points(), [[0.0, 0.0, -0.5]]);
    assert!(seen.hits[0].doubts.is_empty());

    let seen = run(&config(&p_words(4)), b"P 1 X   0.000 Y-  0.000 Z   0.000\n");
    assert_eq!(seen.hits[0].doubts, Doubts::NULL_POINT);
    assert_eq!(seen.codes(), [FaultCode::NullPoint]);
}

/// Rule 2. C8: 1234.5678 and -1234.5 in `[33]` lose a digit. With the travel known, X
/// and Y are suspect and Z is not; without it, all full fields are.
#[test]
fn c8_overflow_is_suspected() {
    let line = b"P 1 X 234.568 Y-234.500 Z   0.000\n";
    let travel = Travel {
        x: [-1500.0, 1500.0],
        y: [-1500.0, 1500.0],
        z: [-400.0, 0.0],
    };
    let with_travel = ReceiverConfig {
        travel_mm: Some(travel),
        ..config(&p_words(3))
    };
    for config in [config(&p_words(3)), with_travel] {
        let seen = run(&config, line);
        assert!(seen.hits[0].doubts.contains(Doubts::OVERFLOW_SUSPECT));
        let axes: Vec<_> = seen.faults.iter().map(|fault| fault.kind).collect();
        let suspect = |axis| FaultKind::OverflowSuspect {
            axis,
            integer_digits: 3,
        };
        assert_eq!(axes, [suspect(0), suspect(1)]);
    }
}

/// Rule 9. C9: Autodesk's post closes the port before it opens it; START, END and the
/// header lines are text, the points are read.
#[test]
fn c9_fusion_results() {
    let capture = b"\x14\x12START\nRESULTSFILE PART1-RESULTS\nG330 N     1 A0. B0. C0. X0 Y0 Z0 I0 R0\n\
        G800 N1 X10. Y0. Z-5. I1. J0. K0. O0. U0.1 L-0.1\nG801 N1 X 10.003 Y- 0.001 Z- 5.000 R3.000\nEND\n\x14";
    let seen = run(&config(&[words("G801", "XYZ", "R")]), capture);
    assert_eq!(seen.points(), [[10.003, -0.001, -5.0]]);
    let other = NotUnderstood;
    assert_eq!(
        seen.statuses(),
        [other, other, other, other, Matched, other]
    );
    assert_eq!(seen.hits[0].index, Some(1));
}

/// Rule 8. C10: XOFF and XON inside a number.
#[test]
fn c10_xon_xoff_inside_a_number() {
    let patterns = [words("G801", "X", "")];
    let seen = run(&config(&patterns), b"G801 N1 X1\x13\x112.3456\r\n");
    assert_eq!(seen.points(), [[12.3456, 0.0, 0.0]]);
    // In ISO code XOFF has a parity bit; from a device without parity it is
    // known by the XON after it.
    for pair in [b"\x93\x11", b"\x13\x11"] {
        let capture = joined(&[&iso(b"G801 N1 X1"), pair, &iso(b"2.3456\r\n")]);
        let seen = run(&config(&patterns), &capture);
        assert_eq!(seen.points(), [[12.3456, 0.0, 0.0]]);
        assert_eq!(seen.codes(), []);
    }
}

/// C11: Fanuc punch with NUL feed and LF CR CR: a program, no points.
#[test]
fn c11_fanuc_punch() {
    let nul = [0; 40];
    let capture = joined(&[
        b"\x12",
        &nul,
        b"%\n\r\rO1234\n\r\rX1.0Y2.0Z3.0\n\r\rM30\n\r\r%",
        &nul,
        b"\x14",
    ]);
    for capture in [capture.clone(), iso(&capture)] {
        let seen = run(&config(&[words("", "XYZ", "")]), &capture);
        assert_eq!(seen.hits.len(), 0);
        let kinds: Vec<_> = seen.faults.iter().map(|fault| fault.kind).collect();
        assert_eq!(kinds, [FaultKind::ProgramReceived { lines: 3 }]);
        assert_eq!(seen.statuses()[1..], [Program; 4]);
    }
}

/// C12: Okuma puts SI in front of the text, and SO in front of katakana.
#[test]
fn c12_okuma_shift_codes() {
    let config = config(&[template("X{x} Y{y}", None)]);
    let seen = run(
        &config,
        b"\x0fCYCLETIME-7200\n\x0fX1.5 Y2.5\n\x0eX1.5 Y2.5\n",
    );
    assert_eq!(seen.texts(), ["CYCLETIME-7200", "X1.5 Y2.5", "X1.5 Y2.5"]);
    assert_eq!(seen.points(), [[1.5, 2.5, 0.0]; 2]);
    let seen = run(
        &config,
        &iso(b"\x0fCYCLETIME-7200\n\x0fX1.5 Y2.5\n\x0eX1.5 Y2.5\n"),
    );
    assert_eq!(seen.points().len(), 2);
}

/// C13: what GRBL and LinuxCNC print, from their source code.
#[test]
fn c13_grbl_and_linuxcnc() {
    let config = config(&[LinePattern::GrblProbe, LinePattern::LinuxCncProbe]);
    let seen = run(&config, b"[PRB:-0.000,12.346,-5.000:1]\r\n");
    assert_eq!(seen.points(), [[0.0, 12.346, -5.0]]);
    assert_eq!(seen.hits[0].touched, Some(true));
    let seen = run(
        &config,
        b"1.000000 2.000000 -3.123456 0.000000 0.000000 0.000000 0.000000 0.000000 0.000000\n",
    );
    assert_eq!(seen.points(), [[1.0, 2.0, -3.123456]]);
    // No touch, no hit.
    let seen = run(&config, b"[PRB:0.000,0.000,0.000:0]\r\n");
    assert_eq!(
        (seen.hits.len(), seen.codes()),
        (0, vec![FaultCode::NotTouched])
    );
}
