//! Ways to a wrong part that a program's text shows: calls of what is not there, a second
//! rewriting, words that controls understand differently. Each is refused unless somebody says
//! what is meant.

use std::string::String;

use super::super::refusal::{RewriteRefusal, Why};
use super::super::{AllowedCalls, RewriteDialect, RewriteSettings, Rewriter, StartModes};
use super::{level, of, rewritten, settings, text, turned};

fn allowing(calls: &str) -> RewriteSettings {
    RewriteSettings {
        allowed_calls: AllowedCalls::try_from(calls).unwrap(),
        ..settings(level(90.0, [0.0; 3]))
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
/// Heights of a cycle that were said in `G90` and are used in `G91`: places for one control,
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
/// What goes on in a cycle under another offset or in another plane is refused; a count alone, or a
/// What a control takes for an R or a bottom that nobody said does not move with the part: the hole
/// Holes that a count repeats stay holes where no G0 to G3 was said before the cycle: a code would
/// A cycle that begins where nobody knows is above its R on one machine and below it in the part's
/// Some controls begin with G98, others (LinuxCNC's interpreter) with G99, and each keeps what the
/// Behind `;` stands a comment, or a block: a control whose `;` ends blocks reads all of it.
#[test]
fn a_comment_is_one_for_the_control() {
    let said = |family: Option<RewriteDialect>, behind: &str| {
        let settings = RewriteSettings {
            dialect: family,
            ..settings(level(1.0, [0.0; 3]))
        };
        let program = ["G21 G90 G17 G0 X0. Y0. Z0. ;", behind, "\nM30\n"].concat();
        rewritten(&settings, &program).err().map(|it| it.reason)
    };
    let refused = Some(RewriteRefusal::Semicolon);
    for (behind, anybody, fanuc) in [
        ("", None, None),
        (" (5 MM END MILL)", None, None),
        (" 5 MM END MILL", None, refused),
        (" IF NEEDED CHANGE THE TOOL", None, refused),
        ("4 Y56.2 Z-43.", None, refused),
        (" #5221=7", refused, refused),
        ("/X5.", refused, refused),
        ("IF[#1EQ1]GOTO5", refused, refused),
    ] {
        assert_eq!(said(None, behind), anybody, "{behind}");
        assert_eq!(said(Some(RewriteDialect::Fanuc), behind), fanuc, "{behind}");
        assert_eq!(
            said(Some(RewriteDialect::LinuxCnc), behind),
            None,
            "{behind}"
        );
    }
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

/// G54.1 and G154 without P name no offset, also where P stands in the next block: whatever the
/// language, none is carried as if the one before still held.
#[test]
fn an_additional_offset_needs_its_number() {
    let dialects = [
        None,
        Some(RewriteDialect::Fanuc),
        Some(RewriteDialect::LinuxCnc),
    ];
    for dialect in dialects {
        let settings = RewriteSettings {
            dialect,
            ..settings(level(20.0, [1.0, 2.0, 3.0]))
        };
        for line in ["G54.1", "G0 G154 X1.", "G154\nP3"] {
            let program = ["G21 G90 G17\n", line, "\nG0 X50. Y20. Z5.\nM30\n"].concat();
            let refused = rewritten(&settings, &program).unwrap_err();
            assert_eq!(
                (refused.line, refused.reason),
                (2, RewriteRefusal::OffsetNumber),
                "{line}"
            );
        }
        let program = "G21 G90 G17\nG54.1 P3\nG0 X50. Y20. Z5.\nM30\n";
        rewritten(&settings, program).unwrap();
    }
}

/// P beside G54 is the number of an additional offset only where no other word of the block takes it;
/// where it may be both, nobody knows how a control takes it.
#[test]
fn a_p_beside_g54_belongs_to_one_word() {
    let program = |first: &str| {
        [
            "G21 G90 G17\n",
            first,
            "\nG0 X50. Y20. Z5.\nG1 Z1. F9\nM30\n",
        ]
        .concat()
    };
    let with = |dialect, first: &str| {
        let settings = RewriteSettings {
            dialect,
            measured_in: Some(umi_protocol::job::WorkOffset::G54),
            ..settings(level(20.0, [1.0, 2.0, 3.0]))
        };
        rewritten(&settings, &program(first)).map_err(|refused| (refused.line, refused.reason))
    };
    for plain in ["G54 G4 P500", "G54 G4 P0.5", "G4 P5\nG54"] {
        with(None, plain).unwrap();
    }
    with(Some(RewriteDialect::LinuxCnc), "G54 G4 P5").unwrap();
    for both in ["G54 G4 P5", "G54 M98 P5", "G54.1 M98 P500", "G54 G65 P7"] {
        assert_eq!(
            with(None, both).unwrap_err(),
            (2, RewriteRefusal::TwoTakeP),
            "{both}"
        );
    }
    // The second of the additional ones, and where that lies nobody has said.
    let (_, elsewhere) = with(None, "G54 P2 M8").unwrap_err();
    assert_eq!(elsewhere, RewriteRefusal::WorkOffset);
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
