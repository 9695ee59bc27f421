//! Streams: cut anywhere, of any line ends, of any length.

use std::string::String;
use std::vec;
use std::vec::Vec;

use proptest::prelude::*;

use super::super::refusal::RewriteRefusal;
use super::super::{Check, MAX_AT_ONCE, MAX_LINE, RefusedLine, RewriteSettings, Rewriter};
use super::{level, rewritten, settings, turned};

/// The bytes that come out when the program comes in pieces of these lengths.
fn in_pieces(
    settings: &RewriteSettings,
    program: &[u8],
    pieces: &[usize],
) -> (Vec<u8>, Option<RefusedLine>) {
    let mut out = Vec::new();
    let mut sink = |bytes: &[u8]| out.extend_from_slice(bytes);
    let mut rewriter = Rewriter::new(settings).unwrap();
    let mut rest = program;
    let mut lengths = pieces.iter().cycle();
    let mut done = Ok(());
    while !rest.is_empty() && done.is_ok() {
        let length = lengths.next().copied().unwrap_or(1).clamp(1, rest.len());
        let (piece, more) = rest.split_at(length);
        done = rewriter.push(piece, &mut sink);
        rest = more;
    }
    let done = done.and_then(|()| rewriter.finish(&mut sink).map(|_| ()));
    (out, done.err())
}

/// The bytes that come out line by line, in pieces of the most that one call may give.
fn line_by_line(settings: &RewriteSettings, program: &[u8]) -> (Vec<u8>, Option<RefusedLine>) {
    let mut out = Vec::new();
    let mut rewriter = Rewriter::new(settings).unwrap();
    let mut rest = program;
    let done = loop {
        let before = out.len();
        let mut sink = |bytes: &[u8]| out.extend_from_slice(bytes);
        match rewriter.push_line(rest, &mut sink) {
            Err(refusal) => break Err(refusal),
            Ok(progress) => {
                rest = &rest[progress.taken..];
                if rest.is_empty() && !progress.has_more {
                    break rewriter.finish(&mut sink).map(|_| ());
                }
            }
        }
        assert!(out.len() - before <= MAX_AT_ONCE);
    };
    (out, done.err())
}

const PROGRAM: &str = "%\nO1\nG21 G90 G17 G98\nG0 X10. Y0. Z5.\nG3 X0. Y10. I-10. J0. F100\n\nG81 X5. Y5. \
    Z-5. R2.\nX7.\nG80\n(LONG COMMENT HERE) G91 G1 X-1. Y-2.\nG90 G28 X0\n";

/// One call gives a line and no more, of what becomes thousands of lines as well: chords,
/// pecks, counted holes; and of the longest line with the header before it.
#[test]
fn little_comes_out_at_once() {
    let comment = "C".repeat(MAX_LINE - 60);
    let program = std::format!(
        "G21 G90 G17 G94 F100 X1. Y2. Z3. G0 M8 S1234 T1 ({comment})\nG0 X0. Y0. Z5.\n\
         G2 X0. Y0. I400. J0.\nG91 G98 G83 X1. Y1. Z-90. R-1. Q0.1 K5\nG80\n"
    );
    let mut settings = settings(turned([3.0, 2.0, 12.0], [1.0, 2.0, 3.0]));
    settings.original = Some(Check::default().finish());
    settings.source = "S".repeat(96).parse().unwrap();
    let whole = in_pieces(&settings, program.as_bytes(), &[usize::MAX]);
    assert_eq!(whole.1, None);
    let lines = whole.0.iter().filter(|byte| **byte == b'\n').count();
    assert!(lines > 2000, "{lines}");
    assert!(whole == line_by_line(&settings, program.as_bytes()));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// However a stream is cut, and whatever it says, the same comes out.
    #[test]
    fn any_split_gives_the_same(
        lines in prop::collection::vec(
            prop_oneof![
                "[GXYZ][0-9]{1,2}[.]?[0-9]{0,3} ?[XYZIJR]-?[0-9]{1,2}[.][0-9]{0,3}",
                "G[0-3] X[0-9][.] Y[0-9][.] [IJR][0-9][.]",
                "[ -~]{0,20}",
                Just(String::from("G21 G90 G0 X1. Y2. Z3.")),
            ],
            0..12,
        ),
        end in prop::sample::select(vec!["\n", "\r\n", "\r", "\n\r", "\n\r\r"]),
        pieces in prop::collection::vec(1usize..9, 1..5),
        tilt in 0.0f64..2.0,
    ) {
        let settings = settings(turned([tilt, 0.0, 12.0], [1.0, 2.0, 3.0]));
        let mut program: String = "G21 G90 G0 X1. Y2. Z3.".into();
        for line in &lines {
            program += end;
            program += line;
        }
        let whole = in_pieces(&settings, program.as_bytes(), &[usize::MAX]);
        let cut = in_pieces(&settings, program.as_bytes(), &pieces);
        prop_assert_eq!(&whole, &cut);
        prop_assert_eq!(&whole, &line_by_line(&settings, program.as_bytes()));
    }

    /// Any bytes at all: no panic, and the identity changes none.
    #[test]
    fn any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let tilted = settings(turned([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]));
        let _ = in_pieces(&tilted, &bytes, &[7]);
        let same = settings(crate::registration::RigidTransform::identity());
        let (out, refusal) = in_pieces(&same, &bytes, &[7]);
        if refusal.is_none() {
            prop_assert_eq!(out, bytes);
        }
    }

    /// There and back: every place within the rounding of two passes.
    #[test]
    fn there_and_back(
        points in prop::collection::vec(prop::array::uniform3(-500_000i32..500_000), 1..20),
        degrees in prop::array::uniform3(-40.0f64..40.0),
        shift in prop::array::uniform3(-100.0f64..100.0),
        incremental in any::<bool>(),
    ) {
        let transform = turned(degrees, shift);
        let mut program = String::from("G21 G90 G0 X0. Y0. Z0.\nG1 F100\n");
        let mut before = [0; 3];
        for (n, point) in points.iter().enumerate() {
            let words = "XYZ".chars().zip(*point).zip(before);
            for ((letter, to), from) in words {
                // Some axes stay unnamed.
                if incremental || n % 3 != 2 || letter != 'Y' {
                    let value = if incremental { to - from } else { to };
                    program += &std::format!("{letter}{:.3} ", f64::from(value) / 1000.0);
                }
            }
            program += "\n";
            if n == 0 && incremental {
                program = program.replace("G1 F100", "G91 G1 F100");
            }
            before = *point;
        }
        let there = rewritten(&settings(transform), &program).unwrap().0;
        let back = rewritten(&settings(transform.inverse()), &there).unwrap().0;
        let ends = |text: &str| {
            let (mut at, mut ends) = ([0.0; 3], Vec::new());
            let mut adds = false;
            for line in text.lines() {
                for word in line.split_whitespace() {
                    adds |= word == "G91";
                    let axis = match word.as_bytes()[0] { b'X' => 0, b'Y' => 1, b'Z' => 2, _ => continue };
                    let value: f64 = word[1..].parse().unwrap();
                    at[axis] = if adds { at[axis] + value } else { value };
                }
                ends.push(at);
            }
            ends
        };
        for (a, b) in ends(&program).iter().zip(ends(&back)) {
            for (a, b) in a.iter().zip(b) {
                // Half a step from each pass, the first in any direction.
                prop_assert!((a - b).abs() <= 0.0005 * (1.0 + 3f64.sqrt()) + 1e-6, "{a} {b}");
            }
        }
    }
}

/// Lines end as they did, also those that are added.
#[test]
fn line_ends() {
    let transform = turned([2.0, 0.0, 0.0], [0.0; 3]);
    for end in ["\n", "\r\n", "\n\r\r", "\n\r"] {
        let program = PROGRAM.replace("G90 G28 X0\n", "").replace('\n', end);
        let (out, refusal) = in_pieces(&settings(transform), program.as_bytes(), &[5]);
        assert_eq!(refusal, None);
        let out = String::from_utf8(out).unwrap();
        assert!(out.matches(end).count() > program.matches(end).count());
        let without = out.replace(end, "");
        assert!(!without.contains(['\r', '\n']), "{end:?}: {out:?}");
    }
}

/// The line of a refusal is that of the file, whatever ends its lines.
#[test]
fn lines_are_counted() {
    for end in ["\n", "\r\n", "\r", "\n\r\r", "\n\r"] {
        let program = PROGRAM.replace('\n', end);
        let refusal = in_pieces(&settings(level(5.0, [0.0; 3])), program.as_bytes(), &[3]).1;
        assert_eq!(refusal.map(|r| r.line), Some(11), "{end:?}");
    }
}

/// A line without end takes no memory, and is named.
#[test]
fn long_lines_are_refused() {
    let settings = settings(level(5.0, [0.0; 3]));
    let fits = std::format!("({})\n", "X".repeat(MAX_LINE - 2));
    assert!(rewritten(&settings, &fits).is_ok());
    let long = std::format!("G21\n({})\n", "X".repeat(MAX_LINE));
    for pieces in [&[usize::MAX][..], &[100]] {
        let refusal = in_pieces(&settings, long.as_bytes(), pieces).1.unwrap();
        assert_eq!(
            (refusal.line, refusal.reason),
            (2, RewriteRefusal::LineTooLong)
        );
    }
}

/// The check value is the one of zip and PNG.
#[test]
fn check_value() {
    let mut check = Check::default();
    check.update(b"1234");
    check.update(b"56789");
    let identity = check.finish();
    assert_eq!((identity.crc32, identity.bytes), (0xCBF4_3926, 9));
}

/// Two lines for one control are one for another, where CR and LF both end some: refused
/// before a control could run a line that was read otherwise here.
#[test]
fn mixed_line_ends_are_refused() {
    let settings = settings(level(90.0, [0.0; 3]));
    for (program, line) in [
        ("G21 G90 G0 X0. Y0.\nG2 \rG1 X5. F9\n", 3),
        ("G21 G90 G0 X0. Y0.\r\nG2 \rG1 X5. F9\r\n", 3),
        ("G21 G90 G0 X0. Y0.\rG1 X5. F9\nX6.\n", 2),
    ] {
        for pieces in [&[usize::MAX][..], &[1], &[3, 20]] {
            let refusal = in_pieces(&settings, program.as_bytes(), pieces).1.unwrap();
            assert_eq!(
                (refusal.line, refusal.reason),
                (line, RewriteRefusal::LineEnds)
            );
        }
    }
    for fine in [
        "G21 G90 G0 X0. Y0.\nX5.\r\nX6.\n",
        "G21 G90 G0 X0. Y0.\r\nX5.\nX6.\r\n",
        "G21 G90 G0 X0. Y0.\n\rX5.\n\rX6.",
        "G21 G90 G0 X0. Y0.\n\r\rX5.\n\r\rX6.",
        "G21 G90 G0 X0. Y0.\rX5.\r\rX6.\r",
        "\r\n\r\nG21 G90 G0 X0. Y0.\r\r\nX5.\r\r\n",
    ] {
        assert_eq!(
            in_pieces(&settings, fine.as_bytes(), &[2]).1,
            None,
            "{fine:?}"
        );
    }
}
