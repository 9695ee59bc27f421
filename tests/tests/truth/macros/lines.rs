//! What all macros have in common: the texts, the lines they print, the modes they leave.

use umi_protocol::feature::Shape;

use crate::macros::bench::*;

const BALL: &str = "[[body]]\nname = \"BALL\"\nshape = { sphere = { radius_mm = 10.0 } }\n\
                    position_mm = [20.0, 30.0, 60.0]\n";

/// A machinist reads them on a screen: capitals, at most 80 columns but for the block that
/// prints, which cannot be split.
#[test]
fn texts_can_be_read() {
    for family in FAMILIES {
        for (name, text) in family.programs() {
            for line in text.lines() {
                let prints = line.starts_with("DPRNT[") || line.starts_with("(LOG,");
                assert!(line.len() <= 80 || prints, "{family:?} {name}: {line}");
                let capital = !line.bytes().any(|b| b.is_ascii_lowercase());
                let port = line.starts_with("(LOGOPEN,") || line.starts_with("(LOG,");
                assert!(capital || port, "{family:?} {name}: {line}");
                assert!(line.is_ascii(), "{family:?} {name}: {line}");
            }
        }
    }
}

/// The printing macro is the one that the receiver's documentation has, whose arithmetic in
/// eight digits is tested there.
#[test]
fn printing_macro_is_the_documented_one() {
    let source = include_str!("../../../../firmware/core/src/dprnt/line/checked.rs");
    let documented: Vec<&str> = source
        .lines()
        .filter_map(|line| line.strip_prefix("//! "))
        .skip_while(|line| !line.starts_with("O8810"))
        .take_while(|line| *line != "```")
        .collect();
    let programs = Family::Fanuc.programs();
    let (_, text) = programs
        .iter()
        .find(|(name, _)| name.starts_with("O8810"))
        .unwrap();
    let shipped: Vec<&str> = text
        .lines()
        .filter(|line| *line != "%" && !line.starts_with("(THE ONE LONG"))
        .collect();
    assert_eq!(shipped, documented);
}

/// One source: where families speak the same language they differ in the settings only.
/// Copy `fanuc/` over the others after a change.
#[test]
fn families_differ_in_settings_only() {
    let fanuc = Family::Fanuc.programs();
    assert!(fanuc.len() >= 15);
    for family in [Family::Haas, Family::MitsubishiMazak] {
        let mut programs = family.programs();
        // What comes by E commands, which only Haas has.
        programs.retain(|(name, _)| name != "O8830-correction.nc");
        assert_eq!(fanuc.len(), programs.len(), "{family:?}");
        for ((name, text), (other_name, other)) in fanuc.iter().zip(&programs) {
            assert_eq!(name, other_name);
            assert!(
                text == other || matches!(name.as_str(), "O8811-start.nc" | "O8841-sensor.nc"),
                "{family:?}: {name} differs"
            );
        }
    }
}

/// An alarm says what is wrong in at most 26 characters, what old screens show, and has
/// one number for one text's kind.
#[test]
fn alarms_fit_the_screen() {
    for family in [Family::Fanuc, Family::Haas, Family::MitsubishiMazak] {
        for (name, text) in family.programs() {
            for line in text.lines().filter(|line| line.contains("#3000")) {
                let said = line.split(['(', ')']).nth(1).expect("a text");
                assert!(said.len() <= 26, "{name}: {said}");
                let label = line.trim_start_matches('N').split('#').next().unwrap_or("");
                assert!(line.contains(&format!("#3000={label}(")), "{name}: {line}");
            }
        }
    }
}

/// Every macro of a program prints under one run number, counting from 1; the next program
/// has the next number. All hits have one feed.
#[test]
fn runs_and_sequences() {
    let call = Call::new(8820, "UMI_SPHERE", &[('D', 20.0), ('B', 7.0), ('Q', 60.0)]);
    let two = [
        call.clone(),
        Call {
            macro_b: call.macro_b.replace("B7", "B8"),
            linuxcnc: call.linuxcnc.replace("[7.", "[8."),
        },
    ];
    for family in FAMILIES {
        let ran = run(family, BALL, [21.0, 28.0, 90.0], &two);
        assert_eq!(ran.alarm, None);
        let text = String::from_utf8_lossy(ran.bytes()).replace(' ', "");
        let lines: Vec<&str> = text
            .split(['\r', '\n', '\u{12}', '\u{14}'])
            .filter(|line| !line.is_empty())
            .collect();
        let [first, second, third, lines @ ..] = &lines[..] else {
            panic!("{lines:?}");
        };
        let frame = "UMI1R1S1B1A7T0F0.000X0.000Y0.000Z0.000C";
        assert!(first.starts_with(frame), "{family:?}: {first}");
        let moved = "UMI1R1S2B0A9T0F0.000X0.000Y0.000Z0.000C";
        assert!(second.starts_with(moved), "{family:?}: {second}");
        let shifted = "UMI1R1S3B1A7T1F0.000X0.000Y0.000Z0.000C";
        assert!(third.starts_with(shifted), "{family:?}: {third}");
        assert_eq!(lines.len(), 10, "{family:?}: {lines:?}");
        for (number, line) in lines.iter().enumerate() {
            let feature = 7 + number / 5;
            let begin = format!("UMI1R1S{}B{feature}A", number + 4);
            assert!(line.starts_with(&begin), "{family:?}: {line} {begin}");
            assert!(line.contains("T1F50.000X"), "{line}");
            let approach = ["A6", "A2", "A1", "A4", "A3"][number % 5];
            assert!(line.contains(approach), "{line}");
        }
    }
}

/// The modes and the feed of the caller are those before the call; without O8811 nothing
/// moves; nor in inches, with a rotation, or in a canned cycle.
#[test]
fn modes_come_back_or_are_refused() {
    for family in [Family::Fanuc, Family::Haas, Family::MitsubishiMazak] {
        let modes = "G65 P8820 D20. B7. Q60.";
        let body = format!(
            "G21 G40 G80 G90 G94 G54\nG0 X21. Y28. Z90.\nG65 P8811\nG18 G91 F250.\nG2\n{modes}\n\
             IF[#4001NE2]GOTO9\nIF[#4002NE18]GOTO9\nIF[#4003NE91]GOTO9\nIF[#4005NE94]GOTO9\n\
             IF[#4109NE250]GOTO9\nGOTO10\nN9#3000=1(MODES ARE LOST)\nN10\n"
        );
        let ran = run_text(family, BALL, &body);
        assert_eq!(ran.alarm, None, "{family:?}");
        assert_eq!(ran.machine.hits().len(), 15);

        for (before, said) in [
            ("G20", "SET G21"),
            ("G68 X0 Y0 R5.", "SET G21"),
            ("G81 Z89. R90. F100.", "SET G21"),
            ("", "P8811 COMES FIRST"),
        ] {
            let start = if before.is_empty() { "" } else { "G65 P8811" };
            for call in [modes, "G65 P8813 Z80."] {
                let body = format!("G21 G90 G54\nG0 X21. Y28. Z90.\n{start}\n{before}\n{call}\n");
                let ran = run_text(family, BALL, &body);
                ran.refused(said);
                assert!(ran.machine.hits().is_empty());
            }
        }
    }
}

/// With a work offset and the length of the probe in force (G43) the lines hold the tip's
/// centre in work coordinates.
#[test]
fn work_offset_and_tool_length() {
    let scene = format!("[probe]\nlength_mm = 120.5\n{BALL}");
    for family in FAMILIES {
        let (start, call) = match family {
            Family::LinuxCnc => (
                "G10 L1 P1 Z120.5\nT1\nG43 H1\nO<UMI_START> CALL",
                "O<UMI_SPHERE> CALL [20] [7] [60]",
            ),
            _ => (
                "G10 L10 P1 R120.5\nG43 H1\nG65 P8811",
                "G65 P8820 D20. B7. Q60.",
            ),
        };
        let body = format!(
            "G21 G40 G80 G90 G94\nG10 L2 P2 X100. Y-50. Z10.\nG55\n{start}\nG0 Z80.\nG0 X-79. Y78.\n{call}\n"
        );
        let ran = run_text(family, &scene, &body);
        let shapes = ran.shapes(&job(Tip::OnBoard, &[(7, "sphere", 5, Some(10.0))]));
        let [Shape::Sphere { center_mm, .. }] = shapes[..] else {
            panic!("{shapes:?}");
        };
        let off = distance(center_mm, [-80.0, 80.0, 50.0]);
        assert!(off <= TOLERANCE_MM, "{family:?}: {center_mm:?}\n{ran}");
    }
}

/// What moves a run's coordinates besides the offset's values is printed: external offset,
/// tool length, and a rotation where the language has one beside the modes that are refused.
#[test]
fn the_second_line_says_what_else_moves() {
    let said = |family: Family, body: &str| {
        let ran = run_text(family, BALL, body);
        assert_eq!(ran.alarm, None, "{family:?}");
        let text = String::from_utf8_lossy(ran.bytes()).replace(' ', "");
        let line = text
            .split(['\r', '\n', '\u{12}'])
            .find(|line| line.contains("S2B"));
        line.unwrap().split('C').next().unwrap().to_owned()
    };
    for family in [Family::Fanuc, Family::Haas, Family::MitsubishiMazak] {
        let body = "G21 G90 G54\n#5201=0.5\n#5203=-0.25\n#2001=81.5\nG43 H1 Z100.\nG68 X0 Y0 R5.\nG65 P8811\n";
        assert_eq!(
            said(family, body),
            "UMI1R1S2B1A9T0F81.500X0.500Y0.000Z-0.250",
            "{family:?}"
        );
    }
    let body = "G21 G90 G54\nG10 L2 P1 R5\nO<UMI_START> CALL\n";
    let line = said(Family::LinuxCnc, body);
    assert!(line.starts_with("UMI1R1S2B1A9T0F0.000X"), "{line}");
}

/// The macros raise an alarm of their own where another work offset than the stated one is
/// active: nothing moves, and nothing is printed.
#[test]
fn another_work_offset_is_refused() {
    for family in FAMILIES {
        for (active, stated, is_refused) in [
            ("G54", "54", false),
            ("G55", "54", true),
            ("G54", "59", true),
            ("G59", "59", false),
        ] {
            let start = match family {
                Family::LinuxCnc => format!("O<UMI_START> CALL [0] [{stated}]"),
                _ => format!("G65 P8811 W{stated}."),
            };
            let ran = run_text(family, BALL, &format!("G21 G90 {active}\n{start}\n"));
            if is_refused {
                ran.refused("OTHER WORK OFFSET");
                assert_eq!(ran.bytes(), b"");
            } else {
                assert_eq!(ran.alarm, None, "{family:?} {active} {stated}");
            }
        }
    }
    for (p, stated, is_refused) in [("7", "107", false), ("8", "107", true)] {
        let body = format!("G21 G90 G54.1 P{p}\nG65 P8811 W{stated}.\n");
        let ran = run_text(Family::Fanuc, BALL, &body);
        assert_eq!(ran.alarm.is_some(), is_refused, "{p} {stated}");
    }
}

/// The first line of a run says in which run the control was last asked to teach, this one too: so the board sees a request
/// that it has not read.
#[test]
fn a_run_says_which_one_was_last_to_teach() {
    for family in FAMILIES {
        let [plain, teach, again] = match family {
            Family::LinuxCnc => [
                "O<UMI_START> CALL",
                "O<UMI_START> CALL [1]",
                "O<UMI_START> CALL [2]",
            ],
            _ => ["G65 P8811", "G65 P8811 T1.", "G65 P8811 T2."],
        };
        let body = [plain, teach, plain, again, plain, plain].join("\n");
        let ran = run_text(
            family,
            BALL,
            &format!("G21 G17 G40 G49 G80 G90 G94 G54\n{body}\n"),
        );
        assert_eq!(ran.alarm, None, "{family:?}");
        let text = String::from_utf8_lossy(ran.bytes()).replace(' ', "");
        // Each control ends its lines in its own way.
        let said: Vec<String> = text
            .split("UMI1R")
            .filter(|line| line.contains("A7T0"))
            .map(|line| {
                let (run, rest) = line.split_once('S').unwrap();
                let (_, rest) = rest.split_once('F').unwrap();
                let (asked_in, _) = rest.split_once('.').unwrap();
                format!("{run} {asked_in}")
            })
            .collect();
        let expected = ["1 0", "2 2", "3 2", "4 4", "5 4", "6 4"];
        assert_eq!(said, expected, "{family:?}: {text}");
    }
}
