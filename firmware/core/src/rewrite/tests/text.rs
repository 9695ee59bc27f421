//! What appears, and what stays as it was.

use std::string::ToString;

use super::super::{Integers, ProgramIdentity, RewriteSettings, Rewriter, Unit};
use super::{level, rewritten, settings, text, turned};
use crate::registration::RigidTransform;

const PROGRAM: &str = "%\nO1234(part)\nN10 g21 G90 G17\n\nN20 G0 X10. Y20. Z5. (there) S1000 M3\n\
    N30 G01 Z-1 F200\nx30.000 ; slow\nY-2.5 M8\n/ 2\nM30\n%\nleft behind G1 X\n";

/// Nothing changes under the identity, whatever stands there.
#[test]
fn identity_is_byte_for_byte() {
    for program in [
        PROGRAM,
        "no % program ( at all\r\n\0\x11#1=[",
        "G1 X#1\r\rG2",
        "%\r\n\r\nG41 G68 A90.\r\n",
    ] {
        assert_eq!(text(RigidTransform::identity(), program), program);
    }
}

/// What a board sets aside for a program of any length.
#[test]
fn state_is_small() {
    assert!(size_of::<Rewriter>() < 7_000, "{}", size_of::<Rewriter>());
}

/// Words that change stay in their place, others appear behind them, all else is copied.
#[test]
fn only_what_changes_appears() {
    let program = "%\nO7 (A)\nN1 G21 G90\nN2 G0 X10. Y20. Z5. (GO) S9\nx30.\n  Y0 M8 (C)\nZ-1.\n\
        G1 X3. Y4.F100\nM30\n%\n";
    // A quarter turn: (x, y) becomes (-y, x).
    assert_eq!(
        text(level(90.0, [0.0, 0.0, 0.0]), program),
        "%\nO7 (A)\nN1 G21 G90\nN2 G0 X-20. Y10. Z5. (GO) S9\nx-20. Y30.\n  X0. Y30. M8 (C)\nZ-1.\n\
         G1 X-4. Y3.F100\nM30\n%\n"
    );
    // A shift: only its axis.
    assert_eq!(
        text(
            level(0.0, [0.0, 0.5, 0.0]),
            "G90 G0 X1. Y1.0 Z1.\nX2.0\nY2.0\n"
        ),
        "G90 G0 X1. Y1.5 Z1.\nX2.0\nY2.5\n"
    );
}

/// Words run together stay together; words in small letters stay small.
#[test]
fn style_is_the_programs() {
    assert_eq!(
        text(level(90.0, [0.0; 3]), "G90G0X1.Y2.Z3.\ng1x5.f9\n"),
        "G90G0X-2.Y1.Z3.\ng1x-2.Y5.f9\n"
    );
}

/// In inches with one decimal more, and back.
#[test]
fn inches() {
    assert_eq!(
        text(
            level(0.0, [1.0, 0.0, 0.0]),
            "G20 G90 G0 X1. Y0. Z0.\nG21 X0.\nG20 G91 X1.\n"
        ),
        // 1 mm is 0.03937 inch.
        "G20 G90 G0 X1.0394 Y0. Z0.\nG21 X1.\nG20 G91 X1.\n"
    );
}

/// A number without a point means what was said, or is refused.
#[test]
fn integers() {
    let with = |integers| RewriteSettings {
        integers,
        ..settings(level(0.0, [1.0, 0.0, 0.0]))
    };
    let program = "G90 G0 X1500 Y0 Z0\n";
    let made = |integers| rewritten(&with(integers), program).map(|(text, _)| text);
    assert_eq!(
        made(Some(Integers::Units)).unwrap(),
        "G90 G0 X1501. Y0 Z0\n"
    );
    assert_eq!(made(Some(Integers::Steps)).unwrap(), "G90 G0 X2.5 Y0 Z0\n");
    assert_eq!(
        made(None).unwrap_err().to_string(),
        "line 1, column 8: X has no decimal point: whether it counts units or increments must be \
         said"
    );
}

/// A hundred thousand increments: the sum of what is written is the rounded image.
#[test]
fn rounding_never_adds_up() {
    let transform = turned([0.01, -0.02, 7.3], [1.0, 2.0, 3.0]);
    let mut program = std::string::String::from("G21 G90 G0 X0. Y0. Z0.\nG91 G1 F100\n");
    for n in 0..10_000 {
        program += &std::format!(
            "X{} Y0.0{} Z-0.001\n",
            ["0.001", "0.0125", "0.3"][n % 3],
            n % 9
        );
    }
    let words = |text: &str| {
        let (mut sum, mut exact) = ([0_i64; 3], [0.0; 3]);
        for word in text.split_whitespace() {
            let axis = match word.as_bytes()[0] {
                b'X' => 0,
                b'Y' => 1,
                b'Z' => 2,
                _ => continue,
            };
            let value: f64 = word[1..].parse().unwrap();
            sum[axis] += (value * 1e4).round() as i64;
            exact[axis] = sum[axis] as f64 / 1e4;
        }
        exact
    };
    let nominal = words(&program);
    let wanted = transform.apply(crate::units::Point::from_array_mm(nominal));
    let written = words(&text(transform, &program));
    for (written, wanted) in written.iter().zip(wanted.to_array_mm()) {
        assert!((written - wanted).abs() <= 0.0005001, "{written} {wanted}");
    }
}

/// Tool length, home, tool change: the words stay, the axes are known when they are said.
#[test]
fn machine_moves_stay() {
    let program = "G21 G90 G0 X0. Y0. Z100.\nG91 G28 Z0. H0\nG28 X0. Y0.\nT1 M6\nG90 G54\n\
        G0 X10. Y0.\nG43 Z50. H1 M8\nG1 Z1. F100\nG53 G0 Z0.\n";
    assert_eq!(
        text(level(90.0, [0.0, 0.0, 2.0]), program),
        "G21 G90 G0 X0. Y0. Z102.\nG91 G28 Z0. H0\nG28 X0. Y0.\nT1 M6\nG90 G54\n\
         G0 X0. Y10.\nG43 Z52. H1 M8\nG1 Z3. F100\nG53 G0 Z0.\n"
    );
    // Tilted, the axes that the height moves join it.
    assert_eq!(
        text(
            turned([0.0, 1.0, 0.0], [0.0; 3]),
            "G21 G91 G28 Z0.\nG90 G0 X0. Y0.\nG43 Z100. H1\n"
        ),
        "G21 G91 G28 Z0.\nG90 G0 X0. Y0.\nG43 X1.745 Z99.985 H1\n"
    );
}

/// G52 and G92 stay as they are, and move what is written after them.
#[test]
fn shifts_are_followed() {
    let quarter = level(90.0, [100.0, 0.0, 0.0]);
    // (1, 2) in G52 X10 is (11, 2), its image (98, 11), that is (88, 11) in G52 X10.
    assert_eq!(
        text(
            quarter,
            "G21 G90 G52 X10.\nG0 X1. Y2. Z0.\nG52 X0.\nG0 X1. Y2.\n"
        ),
        "G21 G90 G52 X10.\nG0 X88. Y11. Z0.\nG52 X0.\nG0 X98. Y1.\n"
    );
    // Where the tool stands is called X0 in both programs.
    assert_eq!(
        text(
            quarter,
            "G21 G90 G0 X1. Y2. Z0.\nG92 X0. Y0.\nG0 X1. Y0.\nG92.1\nX1. Y2.\n"
        ),
        "G21 G90 G0 X98. Y1. Z0.\nG92 X0. Y0.\nG0 X0. Y1.\nG92.1\nX98. Y1.\n"
    );
}

/// Another work offset needs its origin, from the settings or from the program.
#[test]
fn work_offsets() {
    let quarter = level(90.0, [0.0; 3]);
    let program = "G21 G90 G54 G0 X1. Y0. Z0.\nG55 X1. Y0.\n";
    assert!(rewritten(&settings(quarter), program).is_err());
    let known = RewriteSettings {
        origins_mm: [
            Some([0.0; 3]),
            Some([10.0, 0.0, 0.0]),
            None,
            None,
            None,
            None,
        ],
        ..settings(quarter)
    };
    // (11, 0) of G54 becomes (0, 11), that is (-10, 11) of G55.
    let expected = "G21 G90 G54 G0 X0. Y1. Z0.\nG55 X-10. Y11.\n";
    assert_eq!(rewritten(&known, program).unwrap().0, expected);
    let in_program =
        "G21 G90 G10 L2 P1 X0 Y0 Z0\nG10 L2 P2 X10. Y0 Z0\nG54 G0 X1. Y0. Z0.\nG55 X1. Y0.\n";
    let made = text(quarter, in_program);
    assert!(made.ends_with("G55 X-10. Y11.\n"), "{made}");
    // A translation is the same in all of them.
    assert_eq!(
        text(level(0.0, [1.0, 0.0, 0.0]), program),
        "G21 G90 G54 G0 X2. Y0. Z0.\nG55 X2. Y0.\n"
    );
}

/// An increment subprogram turns its steps; its callers name their place anew.
#[test]
fn subprograms() {
    let program = "O1\nG21 G90 G0 X10. Y0. Z5.\nM98 P2\nG90 G0 X20. Y0. Z5.\nM98 P2\nM30\n\
        O2\nG91 G1 X1. F50\nY2.\nX-1. Y-2.\nG90\nM99\n";
    assert_eq!(
        text(level(90.0, [0.0; 3]), program),
        "O1\nG21 G90 G0 X0. Y10. Z5.\nM98 P2\nG90 G0 X0. Y20. Z5.\nM98 P2\nM30\n\
         O2\nG91 G1 X0. Y1. F50\nX-2. Y0.\nX2. Y-1.\nG90\nM99\n"
    );
}

/// The header says where the program comes from, before the first block.
#[test]
fn header() {
    let settings = RewriteSettings {
        original: Some(ProgramIdentity {
            crc32: 0xCBF4_3926,
            bytes: 9,
        }),
        source: "Job test_1 - setup 3".parse().unwrap(),
        unit: Some(Unit::Millimetre),
        ..settings(level(90.0, [1.0, -2.0, 0.5]))
    };
    let mut made = std::vec::Vec::new();
    let mut rewriter = Rewriter::new(&settings).unwrap();
    let program = "%\r\nO7(NAME)\r\n(MORE)\r\nG90 G0 X1. Y0 Z0\r\n";
    let mut sink = |bytes: &[u8]| made.extend_from_slice(bytes);
    rewriter.push(program.as_bytes(), &mut sink).unwrap();
    rewriter.finish(&mut sink).unwrap();
    assert_eq!(
        std::str::from_utf8(&made).unwrap(),
        "%\r\nO7(NAME)\r\n(MORE)\r\n(UMI REWRITTEN FROM CRC32 CBF43926 OF 9 BYTES)\r\n\
         (JOB TEST-1 - SETUP 3)\r\n\
         (R 0.000000000 -1.000000000 0.000000000)\r\n(R 1.000000000 0.000000000 0.000000000)\r\n\
         (R 0.000000000 0.000000000 1.000000000)\r\n(T 1.000000 -2.000000 0.500000 MM)\r\n\
         (STEP 0.001 MM - ARCS WITHIN 0.0100 MM)\r\nG90 G0 X1. Y-1. Z0.5\r\n"
    );
}
