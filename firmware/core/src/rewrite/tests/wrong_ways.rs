//! Ways to a wrong part that a program's text shows: calls of what is not there, a second
//! rewriting, words that controls understand differently. Each is refused unless somebody says
//! what is meant.

use std::string::String;

use super::super::refusal::{RewriteRefusal, Why};
use super::super::{AllowedCalls, RewriteDialect, RewriteSettings, Rewriter, StartModes};
use super::{level, rewritten, settings, text, turned};

fn allowing(calls: &str) -> RewriteSettings {
    RewriteSettings {
        allowed_calls: AllowedCalls::try_from(calls).unwrap(),
        ..settings(level(90.0, [0.0; 3]))
    }
}

fn of(family: RewriteDialect, degrees: [f64; 3]) -> RewriteSettings {
    RewriteSettings {
        dialect: Some(family),
        ..settings(turned(degrees, [0.0; 3]))
    }
}

const CALLS: &str = "G21 G90 G0 X1. Y0. Z0.\n{}\nG0 X2. Y0. Z0.\nM30\n";

/// A call of what is not in the file is allowed by its number or name, and by no other; the
/// call itself stays as it was, and motion and place are named anew behind it.
#[test]
fn calls_are_allowed_by_name() {
    for (call, name) in [
        ("M98 P9010", "9010"),
        ("G65 P9010 A1. B2. X3.", "9010"),
        ("o9010 call [1] [2]", "9010"),
        ("O<Finish> CALL", "<finish>"),
    ] {
        let program = CALLS.replace("{}", call);
        let (made, _) = rewritten(&allowing(name), &program).unwrap();
        assert_eq!(
            made,
            std::format!("G21 G90 G0 X0. Y1. Z0.\n{call}\nG0 X0. Y2. Z0.\nM30\n")
        );
        for other in ["", "9011", "<other>", "90,10"] {
            rewritten(&allowing(other), &program).unwrap_err();
        }
        let goes_on = program.replace("G0 X2. Y0. Z0.", "G0 X2.");
        let refused = rewritten(&allowing(name), &goes_on).unwrap_err();
        assert_eq!(
            (refused.line, refused.reason),
            (3, RewriteRefusal::UnknownPlace('Y'))
        );
    }
}

/// Each program that is not there is told, where it is called first.
#[test]
fn all_missing_programs_are_told() {
    let program = "G21 G90 G0 X1. Y0. Z0.\nM98 P1\n M98 P2\nM98 P3\nM98 P1\nM30\nO2\nM99\n";
    let mut rewriter = Rewriter::new(&allowing("")).unwrap();
    rewriter.push(program.as_bytes(), &mut |_| ()).unwrap();
    let mut told = std::vec::Vec::new();
    while let Err(refused) = rewriter.finish(&mut |_| ()) {
        told.push((refused.line, refused.column, refused.reason));
        rewriter.go_on();
    }
    assert_eq!(
        told,
        [
            (2, 1, RewriteRefusal::NotHere(1)),
            (4, 1, RewriteRefusal::NotHere(3))
        ]
    );
}

/// What was rewritten is rewritten again on demand only.
#[test]
fn a_second_time_is_asked_for() {
    let once = RewriteSettings {
        again: true,
        ..settings(level(90.0, [0.0; 3]))
    };
    let mut made = String::new();
    let mut sink = |bytes: &[u8]| made.push_str(core::str::from_utf8(bytes).unwrap());
    let mut rewriter = Rewriter::new(&once).unwrap();
    rewriter
        .push(b"%\nO7 (PART)\nG21 G90 G0 X1. Y0. Z0.\n%\n", &mut sink)
        .unwrap();
    rewriter.finish(&mut sink).unwrap();
    let refused = rewritten(&settings(level(90.0, [0.0; 3])), &made).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (3, RewriteRefusal::Rewritten)
    );
    let (twice, _) = rewritten(&once, &made).unwrap();
    assert!(twice.contains("X-1. Y0. Z0."), "{twice}");
}

/// For LinuxCNC P on an arc counts turns: it stays with the arc, and as chords each turn is cut.
#[test]
fn turns_of_an_arc_are_kept() {
    let program = "G21 G90 G0 X10. Y0. Z0.\nG3 X10. Y0. I-10. J0. Z-3. P3 F9\n";
    let (made, _) = rewritten(&of(RewriteDialect::LinuxCnc, [0.0, 0.0, 90.0]), program).unwrap();
    assert!(
        made.ends_with("G3 X0. Y10. I0. J-10. Z-3. P3 F9\n"),
        "{made}"
    );
    let lean = of(RewriteDialect::LinuxCnc, [20.0, 0.0, 0.0]);
    let (three, counted) = rewritten(&lean, program).unwrap();
    let (_, one) = rewritten(&lean, &program.replace(" P3", "")).unwrap();
    // Three turns need as many chords as thrice one, less what rounding up adds.
    let thrice = 3 * one.chords;
    assert!(
        (thrice - 3..=thrice).contains(&counted.chords),
        "{counted:?}"
    );
    assert!(!three.contains('P'), "{three}");
    let refused = rewritten(&of(RewriteDialect::Fanuc, [0.0, 0.0, 90.0]), program).unwrap_err();
    assert_eq!(refused.reason, RewriteRefusal::Turns);
    for none in ["P0", "P1001", "P99999"] {
        let none = program.replace("P3", none);
        let refused = rewritten(&lean, &none).unwrap_err();
        assert_eq!(refused.reason, RewriteRefusal::TurnsOutOfRange);
    }
}

/// A cycle that begins below R: one control moves across and then to R, another rises first and
/// never comes back below it.
#[test]
fn below_r_each_control_goes_its_way() {
    let program = "G21 G90 G0 X0. Y0. Z1.\nG98 G81 X10. Y0. Z-5. R2. F100\nG80\nG91 G0 Z1.\n";
    let refused = rewritten(&settings(turned([0.0, 0.1, 0.0], [0.0; 3])), program).unwrap_err();
    assert_eq!((refused.line, refused.reason), (2, RewriteRefusal::BelowR));
    // sin 0.1 degrees is 0.001745.
    let (made, _) = rewritten(&of(RewriteDialect::Fanuc, [0.0, 0.1, 0.0]), program).unwrap();
    let lines: std::vec::Vec<&str> = made.lines().take(5).collect();
    assert_eq!(
        lines,
        [
            "G21 G90 G0 X0.002 Y0. Z1.",
            "G98 G0 X10.002 Y0. Z0.983 F100",
            "X10.003 Z1.983",
            "G1 X9.991 Z-5.017",
            "G0 X10.002 Z0.983",
        ],
        "{made}"
    );
    let (made, _) = rewritten(&of(RewriteDialect::LinuxCnc, [0.0, 0.1, 0.0]), program).unwrap();
    let lines: std::vec::Vec<&str> = made.lines().skip(1).take(4).collect();
    assert_eq!(
        lines,
        [
            "G98 G0 X0.003 Z2. F100",
            "X10.003 Z1.983",
            "G1 X9.991 Z-5.017",
            "G0 X10.003 Z1.983",
        ],
        "{made}"
    );
    // In increments, too: R stays 2 mm above where the cycle began, and the tool stays there.
    let holes = "G21 G90 G0 X0. Y0. Z1.\nG91 G98 G81 X1. Y0. Z-5. R2. L2 F100\nY1.\nG80\nG0 Z1.\n";
    let (made, _) = rewritten(&of(RewriteDialect::LinuxCnc, [0.0, 0.0, 90.0]), holes).unwrap();
    assert_eq!(
        made,
        "G21 G90 G0 X0. Y0. Z1.\nG91 G98 G81 X0. Y1. Z-5. R2. F100\nY1.\nX-1. Y0.\nG80\nG0 Z1.\n"
    );
}

/// Behind G52 another G92 takes the shift of its axis over; zeros behind G92.1 end both.
#[test]
fn shifts_end_as_the_control_ends_them() {
    let program = "G21 G90 G0 X1. Y0. Z0.\nG52 X1.\nG92 X5.\nG52 X0.\nG0 X5. Y0.\n";
    // For Fanuc it has ended, a Haas still has it.
    for family in [None, Some(RewriteDialect::Fanuc)] {
        let level = RewriteSettings {
            dialect: family,
            ..settings(level(90.0, [0.0; 3]))
        };
        let refused = rewritten(&level, program).unwrap_err();
        assert_eq!(
            (refused.line, refused.reason),
            (4, RewriteRefusal::ShiftTaken)
        );
        let ended = program
            .replace("G92", "G52 X0.\nG92")
            .replace("G52 X0.\nG0", "G0");
        let (made, _) = rewritten(&level, &ended).unwrap();
        // It stands where it stood: Y1.
        assert!(made.ends_with("G92 X5.\nG0 X5. Y1.\n"), "{made}");
    }
    let ended = program
        .replace("G52 X0.", "G92.1 X0.")
        .replace("X5. Y0.", "X2. Y0.");
    let (made, _) = rewritten(&settings(level(90.0, [0.0; 3])), &ended).unwrap();
    assert!(made.ends_with("G92.1 X0.\nG0 X0. Y2.\n"), "{made}");
    rewritten(&of(RewriteDialect::LinuxCnc, [0.0; 3]), &ended).unwrap();
    let lathe = rewritten(&of(RewriteDialect::LinuxCnc, [0.0, 0.0, 90.0]), &ended).unwrap_err();
    assert_eq!(lathe.reason, RewriteRefusal::TwoMotions);
    // Mirrors that end are no places.
    let (made, _) = rewritten(
        &settings(level(90.0, [0.0; 3])),
        "G50.1 X0 Y0\nG21 G90 G0 X1. Y0. Z0.\nG50.1 X0 Y0\nX2.\n",
    )
    .unwrap();
    assert_eq!(
        made,
        "G50.1 X0 Y0\nG21 G90 G0 X0. Y1. Z0.\nG50.1 X0 Y0\nX0. Y2.\n"
    );
}

/// What is no block stays, wherever it stands: comments, ends of file, names, marks of editors.
#[test]
fn what_is_no_block_stays() {
    let turn = || settings(level(90.0, [0.0; 3]));
    for (program, made) in [
        (
            "\u{feff}%\nG21 G90 G0 X1. Y0. Z0.\n%\n",
            "\u{feff}%\nG21 G90 G0 X0. Y1. Z0.\n%\n",
        ),
        (
            "%\n<PART-1> (x)\nG21 G90 G0 X1. Y0. Z0.\n",
            "%\n<PART-1> (x)\nG21 G90 G0 X0. Y1. Z0.\n",
        ),
        (
            "G21 G90 G0 X1. Y0. Z0.;\n;T1 D=6\n; 5 mm\nM30;\n\x1a",
            "G21 G90 G0 X0. Y1. Z0.;\n;T1 D=6\n; 5 mm\nM30;\n\x1a",
        ),
        (
            "%\nG21 G90 G0 X1. Y0. Z0.\n%\n\x1a\x1a\nend of tape\n",
            "%\nG21 G90 G0 X0. Y1. Z0.\n%\n\x1a\x1a\nend of tape\n",
        ),
    ] {
        assert_eq!(rewritten(&turn(), program).unwrap().0, made, "{program}");
    }
    // A name in the middle is another program's.
    let refused = rewritten(&turn(), "G21 G90 G0 X1. Y0. Z0.\n<B>\n").unwrap_err();
    assert_eq!(refused.reason, RewriteRefusal::NotAWord);
    let linuxcnc = of(RewriteDialect::LinuxCnc, [0.0, 0.0, 90.0]);
    let (made, _) = rewritten(&linuxcnc, "G21 G90 G0 X1. Y0. Z0. ; X9.\n").unwrap();
    assert_eq!(made, "G21 G90 G0 X0. Y1. Z0. ; X9.\n");
}

/// A subprogram may stand before its caller, and its number may have five digits.
#[test]
fn a_subprogram_is_found_wherever_it_stands() {
    let turn = || settings(level(90.0, [0.0; 3]));
    let first = "%\nO2\nG21 G90 G0 X1. Y0. Z0.\nG1 Z-1. F9\nM99\nO1\nG21 G90 G0 X2. Y0. Z0.\n\
                 M98 P2\nG90 G0 X1. Y0. Z0.\nM30\n%\n";
    let (made, _) = rewritten(&turn(), first).unwrap();
    assert_eq!(
        made,
        first
            .replace("X1. Y0.", "X0. Y1.")
            .replace("X2. Y0.", "X0. Y2.")
    );
    // With other modes than it had when it was read.
    let other = first.replace("Z0.\nM98", "Z0.\nG18\nM98");
    let refused = rewritten(&turn(), &other).unwrap_err();
    assert_eq!(refused.reason, RewriteRefusal::SubprogramModes);
    for (call, number) in [("P12345", 12345), ("P22345", 2345), ("P2345 L2", 2345)] {
        let program = std::format!(
            "%\nO1\nG21 G90 G0 X2. Y0. Z0.\nM98 {call}\nG90 G0 X1. Y0. Z0.\nM30\n\
             O{number}\nG91 G1 X1. F9\nX-1.\nG90\nM99\n%\n"
        );
        let (made, _) = rewritten(&turn(), &program).unwrap();
        assert!(made.contains("G91 G1 X0. Y1. F9\nX0. Y-1.\n"), "{made}");
    }
}

/// Modes that a program takes for granted can be stated, once each.
#[test]
fn modes_to_begin_with_are_stated() {
    let stated = |codes: &[u16]| {
        codes
            .iter()
            .try_fold(StartModes::default(), |modes, code| modes.with(*code))
    };
    let start = stated(&[900, 190, 210, 0, 800, 990]).unwrap();
    let with = RewriteSettings {
        start,
        unit: None,
        ..settings(level(90.0, [0.0; 3]))
    };
    let program = "X1. Y0. Z0.\nG1 X2. F9\n";
    let (made, _) = rewritten(&with, program).unwrap();
    assert_eq!(made, "X0. Y1. Z0.\nG1 X0. Y2. F9\n");
    let same = std::format!("G90 G21 G0 {program}");
    assert_eq!(
        text(level(90.0, [0.0; 3]), &same),
        std::format!("G90 G21 G0 {made}")
    );
    for codes in [&[900, 910][..], &[200, 210], &[170, 180], &[40], &[7770]] {
        assert_eq!(stated(codes), None, "{codes:?}");
    }
    assert!(stated(&[900, 900]).is_some());
}

/// What is kept of stated modes with a program is what was stated, or nothing is kept.
#[test]
fn stated_modes_are_kept_as_they_are() {
    let of = |tenths: &[u16]| {
        tenths
            .iter()
            .try_fold(StartModes::default(), |modes, code| modes.with(*code))
    };
    assert_eq!(of(&[]).unwrap().packed(), Some(0));
    let mut seen = 0;
    for packed in 0..=u16::MAX {
        let Some(modes) = StartModes::unpacked(packed) else {
            continue;
        };
        seen += 1;
        assert_eq!(modes.packed(), Some(packed));
        assert_eq!(of(&modes.tenths()), Some(modes));
    }
    // Two of distance, units, centres and returns, three of planes and feeds, six offsets,
    // four motions, and none of each.
    assert_eq!(seen, 3 * 3 * 4 * 3 * 4 * 3 * 7 * 5);
    let all = [910, 200, 180, 901, 950, 990, 570, 20];
    assert_eq!(of(&all).unwrap().tenths(), all);
    // G59.1 finds no room, and G40 is what begins anyway.
    assert_eq!(of(&[591]).unwrap().packed(), None);
    assert_eq!(of(&[400]).unwrap().packed(), Some(0));
}

/// A step down that is repeated from where it ended needs no rounding where the part lies level;
/// a way in the plane, or in a part that leans, does.
#[test]
fn steps_down_are_repeated() {
    let program = "O1\nG21 G90 G0 X1. Y0. Z0.\nM98 P2 L4\nG90 G0 X1. Y0. Z0.\nM30\n\
                   O2\nG91 G1 Z-1. F9\nX1.\nX-1.\nG90\nM99\n";
    let level = of(RewriteDialect::Fanuc, [0.0, 0.0, 37.0]);
    let (made, _) = rewritten(&level, program).unwrap();
    assert!(
        made.ends_with("G91 G1 Z-1. F9\nX0.799 Y0.602\nX-0.799 Y-0.602\nG90\nM99\n"),
        "{made}"
    );
    let across = program.replace("X-1.\n", "X-2.\n");
    for (settings, program) in [
        (&level, across.as_str()),
        (&of(RewriteDialect::Fanuc, [1.0, 0.0, 0.0]), program),
    ] {
        let refused = rewritten(settings, program).unwrap_err();
        assert_eq!(refused.reason, RewriteRefusal::SubprogramDrifts);
    }
}

/// Heights of a cycle that were said in `G90` and are used in `G91`: places for one control,
/// numbers that count from elsewhere for another.
#[test]
fn heights_are_said_in_the_mode_that_uses_them() {
    let program = "G21 G90 G0 X0. Y0. Z9.\nG99 G81 X1. Y0. Z-5. R2. F9\nG91 X1.\nG80\nM30\n";
    let refused = rewritten(&settings(level(90.0, [0.0; 3])), program).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (3, RewriteRefusal::HeightsSaidElsewise)
    );
    let linuxcnc = of(RewriteDialect::LinuxCnc, [0.0, 0.0, 90.0]);
    rewritten(&linuxcnc, program).unwrap_err();
    rewritten(&linuxcnc, &program.replace("G91 X1.", "G91 X1. Z-7. R-7.")).unwrap();
    let fanuc = of(RewriteDialect::Fanuc, [0.0, 0.0, 90.0]);
    let (made, _) = rewritten(&fanuc, program).unwrap();
    assert!(made.contains("\nG91 X0. Y1.\nG80\n"), "{made}");
    // Another height of the coordinates is another height of the hole, or is not.
    let shifted = program.replace("G91 X1.", "G52 Z1.\nX2.");
    let refused = rewritten(&fanuc, &shifted).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (4, RewriteRefusal::HeightsMoved)
    );
}

/// A return that may be left out: behind it the subprogram may leave other modes. In a main
/// program nobody comes back to it.
#[test]
fn an_optional_return_is_no_end() {
    let turn = || settings(level(90.0, [0.0; 3]));
    let program = "O1\nG21 G90 G0 X1. Y0. Z0.\nM98 P2\nG0 X1. Y0. Z0.\n/M99\nM30\n\
                   O2\n/M99\nG91\nM99\n";
    let refused = rewritten(&turn(), program).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (8, RewriteRefusal::OptionalMode)
    );
    let refused = rewritten(&turn(), &program.replace("O2\n/M99\n", "O2\n")).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (9, RewriteRefusal::SubprogramModes)
    );
    let main = program.replace("O2\n/M99\nG91\n", "O2\n");
    rewritten(&turn(), &main).unwrap();
    // The first of the file may be one, too.
    let first = "O2\nG21 G90 G0 X1. Y0. Z0.\n/M99\nG18\nM99\nO1\nG21 G90 G17 G0 X1. Y0. Z0.\n\
                 M98 P2\nG0 X1. Y0. Z0.\nM30\n";
    let refused = rewritten(&turn(), first).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (8, RewriteRefusal::SubprogramModes)
    );
    rewritten(&turn(), &first.replace("M99\nO1", "M99 L2\nO1")).unwrap_err();
}

/// Programs whose holes or paths would be elsewhere than said, without a word about it.
#[test]
fn holes_whose_place_or_depth_is_not_said_are_refused() {
    let small = level(1.0, [0.0; 3]);
    let leaning = turned([0.3, 0.0, 0.0], [0.0; 3]);
    let begin = "G17 G21 G90 G54 G0 X0. Y80. Z30.\n";
    for (transform, family, program, line, reason) in [
        // Y is where a change of tool has put it.
        (
            &small,
            None,
            "M6\nG43 H2 Z50.\nG81 X100. Z-5. R2. F100.\n",
            4,
            RewriteRefusal::UnknownPlace('Y'),
        ),
        // A depth in increments goes with R.
        (
            &leaning,
            None,
            "G91 G98 G81 X10. R-22. Z-5. F100.\nX10. R-15.\n",
            3,
            RewriteRefusal::CycleLacks('Z'),
        ),
        // LinuxCNC rises first.
        (
            &leaning,
            Some(RewriteDialect::LinuxCnc),
            "G99 G81 X5. Z-5. R2. F100.\nX10.\nG98 X20.\n",
            4,
            RewriteRefusal::TiltedCycle(810),
        ),
        (
            &small,
            None,
            "#1=5 #5221=1\n",
            2,
            RewriteRefusal::SystemVariable,
        ),
        (
            &small,
            None,
            "G91 G10 L2 P1 X5.\nG90 G1 X1. Y1. Z1. F9\n",
            2,
            RewriteRefusal::OffsetStep,
        ),
    ] {
        let settings = RewriteSettings {
            dialect: family,
            ..settings(*transform)
        };
        let refused = rewritten(&settings, &std::format!("{begin}{program}M30\n")).unwrap_err();
        assert_eq!((refused.line, refused.reason), (line, reason), "{program}");
    }
}

/// A rapid over an axis whose place is not said ends beside its place where the part leans: it is
/// allowed by name only, and a feed never.
#[test]
fn rapids_over_an_unknown_axis_are_asked_for() {
    let leaning = turned([0.3, 0.0, 0.0], [0.0; 3]);
    let strict = RewriteSettings {
        loose_rapids: false,
        ..settings(leaning)
    };
    let begin = "G21 G90 G0 X0. Y0. Z50.\nG91 G28 Z0.\nG90 ";
    for (block, reason) in [
        ("G0 Y5.", Some(RewriteRefusal::RapidOver('Z'))),
        ("G1 Y5. F9", Some(RewriteRefusal::UnknownPlace('Z'))),
        // Y stands still, and whether it should is not known.
        ("G0 X5.", Some(RewriteRefusal::RapidOver('Z'))),
        ("G0 Y5. Z30.", None),
    ] {
        let program = [begin, block, "\nG0 X0. Y0. Z9.\nM30\n"].concat();
        let refused = rewritten(&strict, &program).err();
        assert_eq!(refused.map(|it| it.reason), reason, "{block}");
        let is_feed = block.starts_with("G1");
        assert_eq!(rewritten(&settings(leaning), &program).is_err(), is_feed);
        // On a level part all of it is exact.
        let level = RewriteSettings {
            loose_rapids: false,
            ..settings(level(30.0, [1.0, 2.0, 0.0]))
        };
        let named = program
            .replace("G90 G0 Y5.", "G90 G0 X0. Y5.")
            .replace("G90 G0 X5.", "G90 G0 X5. Y0.");
        rewritten(&level, &named).map(|_| ()).unwrap();
    }
}

/// Words that lead over the hole do not stay in the block that rises to R, and where a cycle begins
/// at an unknown height, it does not end at R.
#[test]
fn linuxcnc_rises_where_it_stands() {
    let program = "G21 G90 G17 G0 X0. Y0. Z10.\nG92 X0. Y0. Z0.\nG18 G98 G82 Z4. X2. Y-9. R5. P1 F9\nG80\nM2\n";
    let half = of(RewriteDialect::LinuxCnc, [0.0, 0.0, 180.0]);
    let (made, _) = rewritten(&half, program).unwrap();
    // Y first, alone: its image is the other way, and Z stays.
    assert!(made.contains("G18 G98 G0 Y-5. F9\nX-2. Z4.\n"), "{made}");
    let unknown = "G21 G90 G17 G0 X0. Y0.\nG98 G83 X1. Y1. Z-5. R2. Q1. F9\nG80\nG91 G1 Z1.\nM2\n";
    let refused = rewritten(&half, unknown).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (4, RewriteRefusal::UnknownPlace('Z'))
    );
    // R in increments counts from there.
    let counted = "G21 G90 G17 G0 X0. Y0.\nG91 G99 G81 X1. Z-5. R-2. F9\nG80\nM2\n";
    let refused = rewritten(&half, counted).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (2, RewriteRefusal::UnknownPlace('Z'))
    );
}

/// What goes on in a cycle under another offset or in another plane is refused; a count alone, or a
/// cycle's code alone, drills for one control and not for another.
#[test]
fn a_cycle_goes_on_as_it_began() {
    let fanuc = of(RewriteDialect::Fanuc, [0.0, 0.0, 90.0]);
    let begin = "G21 G90 G17 G0 X0. Y0. Z30.\nG2 X2. Y0. I1. J0. F9\nG81 X1. Y1. Z-5. R2.\n";
    for (block, reason) in [
        ("X5.", None),
        ("G18 X5. Z1.", Some(RewriteRefusal::HeightsMoved)),
        ("G92 Z30.\nX5.", None),
        ("G92 Z29.\nX5.", Some(RewriteRefusal::HeightsMoved)),
        ("K2", Some(RewriteRefusal::Meaningless('K'))),
        ("G82", Some(RewriteRefusal::CycleLacks('Z'))),
    ] {
        let program = [begin, block, "\nG80\nM30\n"].concat();
        let refused = rewritten(&fanuc, &program).err();
        assert_eq!(refused.map(|it| it.reason), reason, "{block}");
    }
    // The program that is written has another shift: the part lies higher.
    let higher = RewriteSettings {
        dialect: Some(RewriteDialect::Fanuc),
        ..settings(level(90.0, [0.0, 0.0, 3.0]))
    };
    let refused = rewritten(&higher, &[begin, "G92 Z30.\nX5.\nM30\n"].concat()).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (5, RewriteRefusal::HeightsMoved)
    );
}

/// What a control takes for an R or a bottom that nobody said does not move with the part: the hole
/// is refused where the part lies higher or lower, and copied where it does not.
#[test]
fn a_hole_needs_its_heights() {
    let higher = settings(level(1.0, [0.0, 0.0, 3.0]));
    let alike = settings(level(1.0, [1.0, 2.0, 0.0]));
    let begin = "G21 G90 G17 G98 G0 X0. Y0. Z30.\n";
    for (cycle, lacks) in [
        ("G81 X1. Y1. Z-5. F9", Some('R')),
        ("G81 X1. Y1. R2. F9", Some('Z')),
        ("G84 X1. Y1. Z-5. R2. F9\nG80\nG84 X2. Z-5.", Some('R')),
        ("G81 X1. Y1. Z-5. R2. F9\nG82 X3.", None),
    ] {
        let program = [begin, cycle, "\nG80\nM30\n"].concat();
        let refused = rewritten(&higher, &program).err().map(|it| it.reason);
        assert_eq!(refused, lacks.map(RewriteRefusal::CycleLacks), "{cycle}");
        rewritten(&alike, &program).unwrap();
    }
}

/// LinuxCNC feeds out of G89 as far as it comes out, others to R.
#[test]
fn boring_feeds_out() {
    let program = "G21 G90 G17 G0 X0. Y0. Z30.\nG98 G89 X0. Y0. Z-5. R2. P1 F9\nG80\nM30\n";
    let lean = [0.01, 0.0, 0.0];
    let none = settings(turned(lean, [0.0; 3]));
    let refused = rewritten(&none, program).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (2, RewriteRefusal::FeedsOut)
    );
    rewritten(&none, &program.replace("G98", "G99")).unwrap();
    for (family, height) in [
        (RewriteDialect::Fanuc, "Z2."),
        (RewriteDialect::LinuxCnc, "Z30."),
    ] {
        let (made, _) = rewritten(&of(family, lean), program).unwrap();
        let mut lines = made.lines().skip_while(|line| !line.starts_with("G4"));
        let out = lines.nth(1).unwrap();
        // The feed is in force still.
        assert!(!out.starts_with("G0") && out.ends_with(height), "{made}");
    }
}

/// Holes that a count repeats stay holes where no G0 to G3 was said before the cycle: a code would
/// end it.
#[test]
fn repeated_holes_are_drilled() {
    let program = "G21 G90 G17 G54\nG99 G81 X1. Y1. Z-5. R2.\nG91 Y-5. K3\nG80\nM30\n";
    let fanuc = RewriteSettings {
        dialect: Some(RewriteDialect::Fanuc),
        ..settings(level(0.0, [10.0, 0.0, 0.0]))
    };
    let (made, _) = rewritten(&fanuc, program).unwrap();
    let holes = "G91 Y-5.\nY-5.\nY-5.\nG80\n";
    assert!(made.contains(holes), "{made}");
}

/// A cycle that begins where nobody knows is above its R on one machine and below it in the part's
/// new place: LinuxCNC would rise to another height.
#[test]
fn a_cycle_begins_at_a_known_height() {
    let lies = |shift: [f64; 3], dialect| RewriteSettings {
        dialect,
        ..settings(level(0.0, shift))
    };
    let program = "G21 G90 G17 G54\nG0 X0. Y0.\nG99 G81 X1. Y1. Z-5. R2.\nG80\nM30\n";
    let high = [1.0, 2.0, 3.0];
    for dialect in [None, Some(RewriteDialect::LinuxCnc)] {
        let refused = rewritten(&lies(high, dialect), program).unwrap_err();
        let why = RewriteRefusal::UnknownPlace('Z');
        assert_eq!((refused.line, refused.reason), (3, why));
        let named = program.replace("X0. Y0.", "X0. Y0. Z9.");
        rewritten(&lies(high, dialect), &named).unwrap();
        rewritten(&lies([1.0, 2.0, 0.0], dialect), program).unwrap();
    }
    // Others go across where they are, whatever R is.
    rewritten(&lies(high, Some(RewriteDialect::Fanuc)), program).unwrap();
}

/// Some controls begin with G98, others (LinuxCNC's interpreter) with G99, and each keeps what the
/// program before has left: where holes are written out, somebody must have said it.
#[test]
fn the_height_of_return_is_said() {
    let lean = settings(turned([0.3, 0.0, 0.0], [0.0; 3]));
    let program = "G21 G90 G17 G54\nG0 X0. Y0. Z30.\nG81 X5. Y5. Z-5. R2. F50\nX9.\nG80\nM30\n";
    let refused = rewritten(&lean, program).unwrap_err();
    assert_eq!(
        (refused.line, refused.column, refused.reason),
        (3, 5, RewriteRefusal::NoReturn)
    );
    for (says, tenths) in [("G98 ", 980), ("G99 ", 990)] {
        let said = program.replace("G81", &[says, "G81"].concat());
        let (in_text, _) = rewritten(&lean, &said).unwrap();
        let stated = RewriteSettings {
            start: StartModes::default().with(tenths).unwrap(),
            ..lean.clone()
        };
        let (stated, _) = rewritten(&stated, program).unwrap();
        assert_eq!(stated, in_text.replace(says, ""));
    }
    // Fanuc's kind begins with G98.
    let fanuc = of(RewriteDialect::Fanuc, [0.3, 0.0, 0.0]);
    let said = program.replace("G81", "G98 G81");
    let said = rewritten(&fanuc, &said).unwrap().0.replace("G98 ", "");
    assert_eq!(rewritten(&fanuc, program).unwrap().0, said);
    let linuxcnc = of(RewriteDialect::LinuxCnc, [0.3, 0.0, 0.0]);
    let refused = rewritten(&linuxcnc, program).unwrap_err();
    assert_eq!(refused.reason, RewriteRefusal::NoReturn);
    // Where it begins at R both are the same, and where it stays, the control does it.
    rewritten(&lean, &program.replace("R2.", "R30.")).unwrap();
    rewritten(&settings(level(20.0, [1.0; 3])), program).unwrap();
}

/// Words that move or shift on one control and do nothing on others.
#[test]
fn words_of_other_controls_are_refused() {
    let begin = "G21 G90 G17 G54\nG0 X0. Y0. Z30.\nG1 X1. F9\n";
    let level = settings(level(20.0, [1.0, 2.0, 3.0]));
    for (line, column, reason) in [
        // LinuxCNC measures a tool where the axes are, and they are elsewhere now.
        ("G10 L10 P1 Z5.", 1, RewriteRefusal::Code(100, Why::Offsets)),
        ("G10 L11 P1 X5.", 1, RewriteRefusal::Code(100, Why::Offsets)),
        // A pole, and straight lines by angle and radius from it (Heidenhain).
        ("I5. J5.", 1, RewriteRefusal::Meaningless('I')),
        ("G11 R20. H45.", 1, RewriteRefusal::Code(110, Why::Motion)),
        ("G10 R20. H45.", 1, RewriteRefusal::OffsetNumber),
    ] {
        let refused = rewritten(&level, &[begin, line, "\nM30\n"].concat()).unwrap_err();
        let refused = (refused.line, refused.column, refused.reason);
        assert_eq!(refused, (4, column, reason), "{line}");
    }
    for line in ["G10 L10 P1 R5.", "G10 P1 R5.", "G10 L1 P1 Z5.", "G11"] {
        rewritten(&level, &[begin, line, "\nM30\n"].concat()).unwrap();
    }
}

/// G76 bores on a mill and cuts a thread on LinuxCNC, where R divides the passes and is no height.
#[test]
fn a_thread_is_no_bore() {
    let begin = "G21 G90 G17\nG0 X0. Y0. Z10.\n";
    let program = |cycle: &str| [begin, cycle, "\nG80\nM30\n"].concat();
    let bore = program("G76 X5. Y5. Z-5. R2. Q1. F100.");
    let thread = program("G76 P1. Z-5. I-1. J0.5 R1. K2. Q29.");
    let with = |dialect, program: &str| {
        let shifted = [12.5, -8.25, 0.04];
        let settings = RewriteSettings {
            dialect,
            ..settings(level(0.0, shifted))
        };
        rewritten(&settings, program).map_err(|refused| refused.reason)
    };
    let refused = RewriteRefusal::Code(760, Why::Motion);
    for (dialect, program) in [
        (Some(RewriteDialect::LinuxCnc), &bore),
        (Some(RewriteDialect::LinuxCnc), &thread),
        (None, &thread),
    ] {
        assert_eq!(with(dialect, program).unwrap_err(), refused, "{program}");
    }
    with(None, &bore).unwrap();
    with(Some(RewriteDialect::Fanuc), &bore).unwrap();
}

/// A byte order mark stays before everything, the header too; elsewhere it is no word.
#[test]
fn a_byte_order_mark_stays_first() {
    let program = "\u{feff}G21 G90 G17\nG0 X1. Y0. Z0.\n";
    let with_header = RewriteSettings {
        original: Some(super::super::Check::default().finish()),
        ..settings(level(90.0, [0.0; 3]))
    };
    let (made, _) = rewritten(&with_header, program).unwrap();
    assert!(made.starts_with("\u{feff}(UMI REWRITTEN"), "{made}");
    assert!(made.ends_with(")\nG21 G90 G17\nG0 X0. Y1. Z0.\n"), "{made}");
    let refused = rewritten(&with_header, "G21 G90\n\u{feff}G0 X1. Y0. Z0.\n").unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (2, RewriteRefusal::NotAWord)
    );
}
