//! Everything that cannot be transformed truly is refused, by line, column and reason.

use std::borrow::ToOwned;
use std::string::ToString;

use super::super::refusal::RewriteRefusal;
use super::super::{MeasuredIn, RewriteSettings, Rewriter, Why};
use super::{level, rewritten, settings, turned};
use crate::registration::RigidTransform;
use nalgebra::Vector3;

const START: &str = "G21 G90 G0 X0. Y0. Z0.\n";

/// Programs that are refused in their second line: column and reason.
const REFUSED: &[(&str, usize, RewriteRefusal)] = &[
    ("G1 X#1 F9", 4, RewriteRefusal::Expression('X')),
    ("G1 X[1+2] F9", 4, RewriteRefusal::Expression('X')),
    ("G#1 X1.", 1, RewriteRefusal::Expression('G')),
    ("IF[#1EQ1]GOTO5", 1, RewriteRefusal::Flow),
    ("WHILE[#1LT2]DO1", 1, RewriteRefusal::Flow),
    ("O<sub> call", 1, RewriteRefusal::NamedCall),
    ("o9010 Call [1]", 1, RewriteRefusal::NumberedCall(9010)),
    ("o100 if [#1 GT 2]", 1, RewriteRefusal::Flow),
    ("o<sub> sub", 1, RewriteRefusal::Flow),
    ("N7 M98 P9010", 4, RewriteRefusal::NotHere(9010)),
    ("(UMI REWRITTEN FROM CRC32 0)", 1, RewriteRefusal::Rewritten),
    ("; UMI REWRITTEN FROM CRC32 0", 1, RewriteRefusal::Rewritten),
    ("M96 P10 Q8", 1, RewriteRefusal::Flow),
    ("M97 P5", 1, RewriteRefusal::CallsFrom('P')),
    ("M97", 1, RewriteRefusal::Flow),
    ("#5221=1.", 1, RewriteRefusal::SystemVariable),
    ("#1=2 G0 X1.", 6, RewriteRefusal::NotAWord),
    (
        "G68 X0 Y0 R5.",
        1,
        RewriteRefusal::Code(680, Why::Coordinates),
    ),
    ("G16", 1, RewriteRefusal::Code(160, Why::Coordinates)),
    (
        "G51 X0 Y0 P2",
        1,
        RewriteRefusal::Code(510, Why::Coordinates),
    ),
    ("G51.1 X0", 1, RewriteRefusal::Code(511, Why::Coordinates)),
    ("G54.4 P1", 1, RewriteRefusal::Code(544, Why::Coordinates)),
    ("G43.4 H1", 1, RewriteRefusal::Code(434, Why::Coordinates)),
    ("G31 Z-5. F9", 1, RewriteRefusal::Code(310, Why::Motion)),
    ("G33 Z-5. F9", 1, RewriteRefusal::Code(330, Why::Motion)),
    ("G5.1 X1. Y1. I1.", 1, RewriteRefusal::Code(51, Why::Motion)),
    ("G5 X1. Y1. I1.", 1, RewriteRefusal::Code(50, Why::Motion)),
    ("G65 P9010 X1.", 1, RewriteRefusal::NotHere(9010)),
    ("G66 P9010 X1.", 1, RewriteRefusal::Code(660, Why::Macro)),
    ("G90 G28 Z50.", 9, RewriteRefusal::Code(280, Why::Through)),
    ("G91 G28 X1.", 9, RewriteRefusal::Code(280, Why::Through)),
    ("G91 G30 X1.", 9, RewriteRefusal::Code(300, Why::Through)),
    ("G10 L20 P1 X0", 1, RewriteRefusal::Code(100, Why::Offsets)),
    ("G777", 1, RewriteRefusal::UnknownCode(7770)),
    ("G0 G1 X1.", 4, RewriteRefusal::TwoMotions),
    ("G90 X1. G91 Y2.", 9, RewriteRefusal::TwoOfGroup(910)),
    ("G91 G90 X1.", 5, RewriteRefusal::TwoOfGroup(900)),
    ("G20 G21", 5, RewriteRefusal::TwoOfGroup(210)),
    ("G40 G41 D1", 5, RewriteRefusal::TwoOfGroup(410)),
    ("G98 G99", 5, RewriteRefusal::TwoOfGroup(990)),
    ("G17 G18", 5, RewriteRefusal::TwoOfGroup(180)),
    ("G93 G94", 5, RewriteRefusal::TwoOfGroup(940)),
    ("G90.1 G91.1", 7, RewriteRefusal::TwoOfGroup(911)),
    ("G54 G55", 5, RewriteRefusal::TwoOfGroup(550)),
    (
        "G81 G80 X1. Z-1. R1. F9",
        5,
        RewriteRefusal::TwoOfGroup(800),
    ),
    ("G0 X1. G91", 8, RewriteRefusal::ModeBehind(910, 'X')),
    ("G1 Z1. F9 G20", 11, RewriteRefusal::ModeBehind(200, 'Z')),
    ("G4 P1. G0 X1.", 11, RewriteRefusal::TwoMotions),
    ("G4 P500 X1.", 9, RewriteRefusal::TwoMotions),
    ("G4 Y1.", 4, RewriteRefusal::TwoMotions),
    ("G0 X1. X2.", 8, RewriteRefusal::Twice('X')),
    ("G1 X1. Q3. F9", 8, RewriteRefusal::Meaningless('Q')),
    ("G1 X1. R3. F9", 8, RewriteRefusal::Meaningless('R')),
    ("G0 X1. A90.", 8, RewriteRefusal::Rotary('A')),
    ("G0 U1.", 4, RewriteRefusal::SecondaryAxis('U')),
    ("G2 X1. Y1. F9", 4, RewriteRefusal::Arc),
    ("G2 X10. Y0. R1. F9", 4, RewriteRefusal::Arc),
    ("G2 X10. Y0. I3. J0. F9", 4, RewriteRefusal::Arc),
    (
        "G2 X10. Y0. I5. K0. F9",
        17,
        RewriteRefusal::Meaningless('K'),
    ),
    ("G2 X10. Y0. I5. J0. P2 F9", 21, RewriteRefusal::Turns),
    ("G2 X10. Y0. R5. P1 M8 F9", 17, RewriteRefusal::Turns),
    (
        "G3 X10. Y0. I5. J0. L2 F9",
        21,
        RewriteRefusal::Meaningless('L'),
    ),
    (
        "G3 X10. Y0. I5. J0. Q2 F9",
        21,
        RewriteRefusal::Meaningless('Q'),
    ),
    ("G81 X1. Z-1. R1. F9", 5, RewriteRefusal::BelowR),
    ("G81 X1. Z-1. R1. K2000 F9", 5, RewriteRefusal::OutOfRange),
    (
        "G81 X1. Z-1. R1. K2 L3 F9",
        21,
        RewriteRefusal::Meaningless('L'),
    ),
    ("G0 X1000000000.", 4, RewriteRefusal::OutOfRange),
    ("G0 X1. (no end", 8, RewriteRefusal::UnclosedComment),
    ("G0 X1. =", 8, RewriteRefusal::NotAWord),
    ("G0 X", 4, RewriteRefusal::NotAWord),
    ("G0 X1.2.3", 8, RewriteRefusal::NotAWord),
    ("/G91", 1, RewriteRefusal::OptionalMode),
    ("G55 X1.", 5, RewriteRefusal::WorkOffset),
    ("G54.1 P7 X1.", 10, RewriteRefusal::WorkOffset),
    ("G80.9010", 1, RewriteRefusal::NoCode),
    ("M98", 1, RewriteRefusal::CallsNothing),
    ("G65 A1.", 1, RewriteRefusal::CallsNothing),
    ("M98 P2 Q10", 8, RewriteRefusal::CallsFrom('Q')),
    ("M98 Q10", 5, RewriteRefusal::CallsFrom('Q')),
    ("M98 P2 H10", 8, RewriteRefusal::CallsFrom('H')),
    ("M198 P2", 1, RewriteRefusal::Elsewhere(2)),
    ("G66 P9010 A1.", 1, RewriteRefusal::Code(660, Why::Macro)),
    (
        "G80(umi rewritten from crc32 1)",
        4,
        RewriteRefusal::Rewritten,
    ),
    ("( Umi Rewritten)", 1, RewriteRefusal::Rewritten),
    ("G41 G1 X1. D1 F9", 1, RewriteRefusal::Tilted('Z')),
    ("G1 X1. ,R2. F9", 8, RewriteRefusal::Tilted('Z')),
    ("G84 X1. Z-1. R0. F9", 5, RewriteRefusal::TiltedCycle(840)),
    ("G83 X1. Z-1. R0. F9", 5, RewriteRefusal::CycleLacks('Q')),
    ("G81 X1. Z1. R-1. F9", 5, RewriteRefusal::CycleDepth),
    ("G93 G1 X1.", 8, RewriteRefusal::NoFeed),
    ("G1 X1. ,A30. F9", 8, RewriteRefusal::Comma('A')),
    ("G92.1 X1.", 1, RewriteRefusal::Code(921, Why::Offsets)),
    ("G50 X1.", 1, RewriteRefusal::Code(500, Why::Offsets)),
    ("G15 H1", 1, RewriteRefusal::Code(150, Why::Coordinates)),
    ("M72", 1, RewriteRefusal::Restores(72)),
    ("M73", 1, RewriteRefusal::Restores(73)),
    ("L100", 1, RewriteRefusal::Meaningless('L')),
    ("N5 L100 P2", 4, RewriteRefusal::Meaningless('L')),
    ("G1 X1. F9; X2.", 12, RewriteRefusal::Semicolon),
    ("(;) G1 X1. F9 (;); (a) G91", 24, RewriteRefusal::Semicolon),
    ("#100=1 ; M98 P2", 10, RewriteRefusal::Semicolon),
    ("G1 X1. F9 ;/G1 Y2.", 12, RewriteRefusal::Semicolon),
    ("G1 X1. F9 ; #5221=7", 13, RewriteRefusal::Semicolon),
    ("G1 X1. F9 ;IF[#1EQ1]GOTO5", 12, RewriteRefusal::Semicolon),
    ("G58 X5.", 1, RewriteRefusal::Code(580, Why::Datum)),
    ("G59 Y5.", 1, RewriteRefusal::Code(590, Why::Datum)),
    ("G92 X1.\nG52 X1.", 1, RewriteRefusal::TwoShifts),
    ("%\n(more)\nO2", 1, RewriteRefusal::BehindEnd),
    ("IF[#531EQ42]GOTO7\nN7", 1, RewriteRefusal::Flow),
];

/// Each is refused where it stands, and says what to do.
#[test]
fn what_cannot_be_followed_is_refused() {
    let settings = settings(turned([0.5, 0.0, 20.0], [1.0, 2.0, 3.0]));
    for (line, column, reason) in REFUSED {
        let program = std::format!("{START}{line}\nM30\n");
        let Err(refusal) = rewritten(&settings, &program) else {
            panic!("not refused: {line}");
        };
        assert_eq!(
            (refusal.line, refusal.column, refusal.reason),
            (1 + line.lines().count() as u64, *column, *reason),
            "{line}: {refusal}"
        );
        assert!(refusal.to_string().len() > 30, "{refusal}");
    }
}

/// A part that is turned is carried in the work offset in which it was probed, and in no other,
/// unless the origins of both are known: then its motions are where they belong.
#[test]
fn a_turned_part_is_carried_where_it_was_probed() {
    use umi_protocol::job::WorkOffset;
    let turn = turned([0.0, 0.0, 90.0], [1.0, 2.0, 3.0]);
    let probed_in =
        |offset, origin_mm| settings(turn).measured_at(MeasuredIn { offset, origin_mm });
    let in_offset = |word: &str| std::format!("G90\n{word}\nG0 X10. Y0. Z5.\n");
    let ends = |settings: &RewriteSettings, program: &str| {
        let made = rewritten(settings, program).map(|(text, _)| text);
        made.map(|text| text.lines().last().unwrap().to_owned())
            .map_err(|refusal| refusal.reason)
    };
    let g54 = probed_in(WorkOffset::G54, None);
    let carried = Ok("G0 X1. Y12. Z8.".to_owned());
    assert_eq!(ends(&g54, &in_offset("G54")), carried);
    assert_eq!(ends(&g54, &in_offset("(NONE SAID)")), carried);
    for other in [
        "G55",
        "G59",
        "G59.1",
        "G54.1 P3",
        "G154 P1",
        "G54 P1",
        "G110",
        "G10 L2 P1 X7.",
    ] {
        let program = in_offset(other);
        assert_eq!(
            ends(&g54, &program),
            Err(RewriteRefusal::WorkOffset),
            "{other}"
        );
        // Of a transform nobody says where it holds, and one that turns nothing is the same in all.
        assert_eq!(ends(&settings(turn), &program), carried, "{other}");
        let straight = turned([0.0; 3], [1.0, 2.0, 3.0]);
        let place = MeasuredIn {
            offset: WorkOffset::G54,
            origin_mm: None,
        };
        let moved = ends(&settings(straight).measured_at(place), &program);
        assert_eq!(moved, Ok("G0 X11. Y2. Z8.".to_owned()), "{other}");
    }
    // In G55, whose zero is 100 mm beside, X10 is X110 of G54.
    let known = RewriteSettings {
        origins_mm: {
            let mut origins = probed_in(WorkOffset::G54, Some([20.0, 0.0, 0.0])).origins_mm;
            origins[1] = Some([120.0, 0.0, 0.0]);
            origins
        },
        ..g54.clone()
    };
    let beside = Ok("G0 X-99. Y112. Z8.".to_owned());
    assert_eq!(ends(&known, &in_offset("G55")), beside);
    // The same where the program sets it, or moves the one that was probed.
    let by_job = probed_in(WorkOffset::G54, Some([20.0, 0.0, 0.0]));
    assert_eq!(
        ends(&by_job, &in_offset("G10 L2 P2 X120. Y0 Z0\nG55")),
        beside
    );
    assert_eq!(ends(&by_job, &in_offset("G10 L2 P1 X120.")), beside);
    assert_eq!(ends(&by_job, &in_offset("G10 L2 P1 X20.")), carried);
    let further = probed_in(WorkOffset::Extended(3), Some([20.0, 0.0, 0.0]));
    assert_eq!(ends(&further, &in_offset("G54.1 P3")), carried);
    assert_eq!(
        ends(&further, &in_offset("G54")),
        Err(RewriteRefusal::WorkOffset)
    );
    // A program that was called before it chose its offset, and one that nobody has called.
    let called = "G90\nM98 P2\nM30\nO2\nG55 G0 X10. Y0. Z5.\nM99\n";
    let alone = "G90\nG0 X10. Y0. Z5.\nM30\nO2\nG90 G55 G0 X10. Y0. Z5.\nM30\n";
    for program in [called, alone] {
        assert_eq!(
            ends(&g54, program),
            Err(RewriteRefusal::WorkOffset),
            "{program}"
        );
    }
}

/// What a program has not said yet.
#[test]
fn what_was_not_said_is_refused() {
    let with_unit = settings(turned([0.5, 0.0, 20.0], [1.0, 2.0, 3.0]));
    let bare = RewriteSettings {
        unit: None,
        ..with_unit.clone()
    };
    for (settings, program, line, reason) in [
        (&bare, "G90 G0 X1.", 1, RewriteRefusal::NoUnit),
        (&with_unit, "G21 G0 X1.", 1, RewriteRefusal::NoDistanceMode),
        (&with_unit, "G90 X1.", 1, RewriteRefusal::NoMotion),
        (
            &with_unit,
            "G90 G0 X1.",
            1,
            RewriteRefusal::UnknownPlace('Y'),
        ),
        (
            &with_unit,
            "G90 G0 X1. Y1.\nG1 X2. F9",
            2,
            RewriteRefusal::UnknownPlace('Z'),
        ),
        (
            &with_unit,
            "G91 G0 X1.",
            1,
            RewriteRefusal::UnknownPlace('X'),
        ),
        (
            &with_unit,
            "G90 G92 X0",
            1,
            RewriteRefusal::UnknownPlace('X'),
        ),
        (
            &with_unit,
            "G90 G0 X1. Y1. Z1.\nM6\nG1 X2. F9",
            3,
            RewriteRefusal::UnknownPlace('Y'),
        ),
        (
            &with_unit,
            "G90 G0 X1. Y1. Z1.\nG43 H1\nG1 X2. F9",
            3,
            RewriteRefusal::UnknownPlace('Z'),
        ),
        (
            &with_unit,
            "G90 G0 X1. Y1. Z1.\n/X9.\nG1 Y2. F9",
            3,
            RewriteRefusal::UnknownPlace('X'),
        ),
        (
            &with_unit,
            "G90 G0 X1. Y1. Z1.\n/G1 X9. F9\nY2.",
            3,
            RewriteRefusal::NoMotionHere,
        ),
        (
            &with_unit,
            "G90 G0 X1. Y1. Z1.\nM98 P2\nX2.",
            3,
            RewriteRefusal::NoMotionHere,
        ),
        (
            &with_unit,
            "O1\nG90 G0 X1. Y1. Z1.\nM98 P2\nM30\nO2\nG91 G1 X1. F9\nM99",
            7,
            RewriteRefusal::SubprogramModes,
        ),
        (
            &with_unit,
            "O1\nG90 G0 X1. Y1. Z1.\nM98 P2 L3\nM30\nO2\nG91 G1 X1. F9\nG90 M99",
            7,
            RewriteRefusal::SubprogramDrifts,
        ),
    ] {
        let Err(refusal) = rewritten(settings, program) else {
            panic!("not refused: {program}");
        };
        assert_eq!((refusal.line, refusal.reason), (line, reason), "{program}");
    }
}

/// Nothing of the refused line comes out, nor anything after it; then the machine is stopped.
#[test]
fn a_refused_program_stops_safely() {
    let settings = settings(level(90.0, [0.0; 3]));
    let mut rewriter = Rewriter::new(&settings).unwrap();
    let mut out = std::vec::Vec::new();
    let mut sink = |bytes: &[u8]| out.extend_from_slice(bytes);
    let program = b"G21 G90 G0 X1. Y0. Z0.\nG1 X2. F9\nG1 X3. Y#5\nG1 X4.\n";
    let refusal = rewriter.push(program, &mut sink).unwrap_err();
    assert_eq!(rewriter.push(b"G1 X5.\n", &mut sink), Err(refusal));
    assert_eq!(rewriter.finish(&mut sink), Err(refusal));
    rewriter.safe_stop(&mut sink);
    let out = std::string::String::from_utf8(out).unwrap();
    assert!(
        out.ends_with("X0. Y1. Z0.\nG1 X0. Y2. F9\n(UMI STOPPED AT LINE 3)\nM0\n"),
        "{out}"
    );
}

/// A check finds every reason, not only the first.
#[test]
fn a_check_goes_on() {
    let settings = settings(level(90.0, [0.0; 3]));
    let mut rewriter = Rewriter::new(&settings).unwrap();
    let mut found = std::vec::Vec::new();
    for line in
        "G21 G90 G0 X0. Y0. Z0.\nG1 X#1 F9\nX5.\nG68 R5.\nG1 Y2.\nG777\n".split_inclusive('\n')
    {
        if let Err(refusal) = rewriter.push(line.as_bytes(), &mut |_| ()) {
            found.push(refusal.line);
            rewriter.go_on();
        }
    }
    assert_eq!(found, [2, 4, 6]);
}

/// What is no rotation is no transform; nor are increments and tolerances beyond reason.
#[test]
fn settings_are_checked() {
    use super::super::BadSettings;
    use crate::units::Mm;
    let good = settings(level(1.0, [0.0; 3]));
    let refused = |settings: RewriteSettings| Rewriter::new(&settings).err();
    assert_eq!(refused(good.clone()), None);
    let mut scaled = good.transform;
    scaled.rotation *= 1.00001;
    let mirror = RigidTransform {
        rotation: nalgebra::Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0)),
        ..good.transform
    };
    let far = RigidTransform {
        translation_mm: Vector3::new(f64::NAN, 0.0, 0.0),
        ..good.transform
    };
    for transform in [scaled, mirror, far] {
        let settings = RewriteSettings {
            transform,
            ..good.clone()
        };
        assert_eq!(refused(settings), Some(BadSettings::Transform));
    }
    for (settings, why) in [
        (
            RewriteSettings {
                decimals_mm: 0,
                ..good.clone()
            },
            BadSettings::Decimals,
        ),
        (
            RewriteSettings {
                decimals_mm: 7,
                ..good.clone()
            },
            BadSettings::Decimals,
        ),
        (
            RewriteSettings {
                chord: Mm(0.001),
                ..good.clone()
            },
            BadSettings::Chord,
        ),
        (
            RewriteSettings {
                clearance: Mm(-1.0),
                ..good.clone()
            },
            BadSettings::Clearance,
        ),
        (
            RewriteSettings {
                origins_mm: [Some([1e6; 3]), None, None, None, None, None],
                ..good.clone()
            },
            BadSettings::Origin,
        ),
    ] {
        assert_eq!(refused(settings), Some(why), "{why}");
    }
}

/// `G53` sends an axis to a place of the machine, which a move of the part does not carry: a cut
/// that leaves the axis there would lie beside the part. It is refused until the program names
/// the axis, unless the part has not moved along it; rapids may pass.
#[test]
fn no_cut_goes_on_from_a_place_of_the_machine() {
    let moved = settings(level(0.0, [1.0, 2.0, 0.0]));
    let head = "G21 G90 G0 X1. Y0. Z0.\nG53 G1 X5. Y5. F100.\n";
    for (line, letter) in [
        ("G1 X7.", Some('Y')),
        ("X7.", Some('Y')),
        ("G1 Y7. Z1.", Some('X')),
    ] {
        let refused = rewritten(&moved, &std::format!("{head}{line}\nM30\n")).map(|_| ());
        let refused = refused.map_err(|of| (of.line, of.reason)).unwrap_err();
        assert_eq!(
            Some(refused),
            letter.map(|of| (3, RewriteRefusal::UnknownPlace(of)))
        );
    }
    // The same where it has been sent in a rapid, or in a block that may be left out.
    for sends in ["G53 G0 Y5.", "/G53 G0 Y5.", "G53 G0 Y5.\n/G0 Y3."] {
        let program = std::format!("G21 G90 G0 X1. Y0. Z0.\n{sends}\nG1 X7. F100.\nM30\n");
        let refused = rewritten(&moved, &program).unwrap_err();
        assert_eq!(refused.reason, RewriteRefusal::UnknownPlace('Y'), "{sends}");
    }
    for (line, made) in [
        ("G1 X7. Y7.", "G1 X8. Y9."),
        ("G0 X7.", "G0 X8."),
        ("G0 X7. Y7.\nG1 X8.", "G0 X8. Y9.\nG1 X9."),
    ] {
        let (text, _) = rewritten(&moved, &std::format!("{head}{line}\nM30\n")).unwrap();
        assert!(text.ends_with(&std::format!("{made}\nM30\n")), "{text}");
    }
    let along_x = settings(level(0.0, [1.0, 0.0, 3.0]));
    let (text, _) = rewritten(&along_x, &std::format!("{head}G1 X7.\nM30\n")).unwrap();
    assert!(text.ends_with("G1 X8.\nM30\n"), "{text}");
}
