//! Heights of canned cycles, where one control does this and another that: where the tool rises, where it
//! comes back to, which height was said. Each is refused unless somebody says whose program it is.

use super::super::refusal::{RewriteRefusal, Why};
use super::super::{RewriteDialect, RewriteSettings, StartModes};
use super::{level, of, rewritten, settings, turned};

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

/// With I and J the pecks of a Haas become smaller, down to K: there K counts no holes, and stays.
#[test]
fn pecks_that_narrow_count_no_holes() {
    let begin = "G21 G90 G17 G98 G0 X0. Y0. Z10.\n";
    let small = level(1.0, [0.0; 3]);
    let made = |settings: &RewriteSettings, cycle: &str| {
        rewritten(settings, &[begin, cycle, "\nG80\nM30\n"].concat()).map(|(text, _)| text)
    };
    let ordinary = "G83 X10. Y0. Z-5. R2. I3. J1. K0.5 F9";
    let text = made(&settings(small), ordinary).unwrap();
    assert!(text.contains("I3. J1. K0.5 F9\nG80"), "{text}");
    let text = made(&settings(small), "G91 G83 X10. Z-5. R-8. I3. J1. K2. L2 F9").unwrap();
    assert!(text.contains("I3. J1. K2. F9\nX"), "{text}");
    // Without them it does.
    let text = made(&settings(small), "G91 G83 X10. Z-5. R-8. Q1. K2 F9").unwrap();
    assert!(text.contains("Q1. F9\nX"), "{text}");
    let leaning = settings(turned([0.3, 0.0, 0.0], [0.0; 3]));
    let refused = made(&leaning, ordinary).unwrap_err().reason;
    assert_eq!(refused, RewriteRefusal::TiltedCycle(830));
}

/// In inverse time every motion needs an F: what a cycle is written out to has none.
#[test]
fn a_cycle_in_inverse_time_is_not_written_out() {
    let leaning = of(RewriteDialect::Fanuc, [0.3, 0.0, 0.0]);
    let cycle = "G21 G90 G17 G99 G0 X0. Y0. Z10.\nG93 G81 X5. Y5. Z-5. R2. F3.\nG80\nM30\n";
    let refused = rewritten(&leaning, cycle).unwrap_err().reason;
    assert_eq!(refused, RewriteRefusal::NoFeed);
    rewritten(&of(RewriteDialect::Fanuc, [0.0, 0.0, 1.0]), cycle).unwrap();
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
