//! The program that takes the place of a correction: whoever calls it goes no further.

use std::path::PathBuf;

use umi_core::correction::{RunCheck, alarm};
use umi_core::units::Point;
use umi_protocol::job::{Dialect, ProgramEnd};
use umi_protocol::pattern::Coding;
use umi_protocol::program::Withheld;
use umi_tests::referee::{Before, Referee};
use umi_virtual::nc::{Control, ControlSettings, Recorder};

use crate::dialects::control::{O8830, assignments, language};
use crate::dialects::spec;

/// A program that calls it and then cuts; in one file where the control wants that.
fn calling(control: &mut Control, dialect: Dialect, text: &str) -> String {
    match dialect {
        Dialect::LinuxCnc => {
            let sub = text.strip_suffix("M2\n").unwrap();
            format!("{sub}G21 G90\no<umi_correction> call\nG0 X1.\nM2\n")
        }
        Dialect::HaasVariables => {
            control.load(O8830).unwrap();
            format!("%\nO0001\n{}M98 P8830\nG0 X1.\nM30\n%\n", assignments(text))
        }
        _ => {
            control.load(text).unwrap();
            "%\nO0001\nM98 P9010\nG0 X1.\nM30\n%\n".into()
        }
    }
}

/// It raises an alarm in every control that the virtual machine speaks for, and nothing has
/// moved.
#[test]
fn whoever_calls_it_stops() {
    let mut tried = 0;
    let whys = [
        Withheld::NoVerdict,
        Withheld::OnlyTaught,
        Withheld::CorrectionGone,
        Withheld::JournalFull,
    ];
    let each = |why| Dialect::ALL.map(|dialect| (dialect, why));
    for (dialect, why) in whys.iter().flat_map(each) {
        let Some(text) = alarm(&spec(dialect), why, None, Coding::Ascii) else {
            assert_eq!(dialect, Dialect::Grbl);
            continue;
        };
        if matches!(dialect, Dialect::Siemens | Dialect::Heidenhain) {
            continue;
        }
        let mut control = Control::new(ControlSettings::of(language(dialect)));
        let main = calling(&mut control, dialect, &text);
        let loaded = control.load(&main).unwrap();
        control.select(loaded[0]).unwrap();
        let home = Point::from_mm(0.0, 0.0, 0.0);
        let mut axes = Recorder::new(home, home);
        let raised = control.run(&mut axes).unwrap_err().to_string();
        let says = match (dialect, why) {
            // An alarm of its own is shorter.
            (Dialect::HaasVariables, Withheld::JournalFull) => "UMI JOURNAL FULL".to_owned(),
            _ => format!("UMI {}", why.alarm()),
        };
        assert!(raised.contains(&says), "{dialect:?}: {raised}");
        assert!(axes.motions.is_empty(), "{dialect:?}: {:?}", axes.motions);
        tried += 1;
    }
    assert_eq!(tried, 4 * 9);
}

/// Text of an old run that comes late may teach: the control that is in another run says so.
#[test]
fn another_run_has_not_taught() {
    let mut tried = 0;
    for dialect in Dialect::ALL {
        let check = RunCheck::of_correction(dialect, 531, 25);
        let Some(text) = alarm(&spec(dialect), &Withheld::OnlyTaught, check, Coding::Ascii) else {
            assert_eq!(dialect, Dialect::Grbl);
            continue;
        };
        if matches!(dialect, Dialect::Siemens | Dialect::Heidenhain) {
            assert!(text.contains("UMI TAUGHT BY RUN 25"), "{text}");
            continue;
        }
        // A run that is not known is compared with none; only O8830 can be given such a one.
        let text = text.as_str();
        let unknown = text.replace("E158 25.", "E158 0.");
        let known = if unknown == text {
            "UMI TAUGHT BY "
        } else {
            "UMI TAUGHT - NO CORRECTION"
        };
        for (text, run, says) in [
            (text, 25, "UMI TAUGHT - NO CORRECTION"),
            (text, 26, "UMI TAUGHT BY "),
            (unknown.as_str(), 26, known),
        ] {
            let mut control = Control::new(ControlSettings::of(language(dialect)));
            let main = calling(&mut control, dialect, text);
            let main = main.replacen("M98 P", &format!("#531={run}\nM98 P"), 1);
            let main = main.replacen("G21 G90\n", &format!("G21 G90\n#531={run}\n"), 1);
            let loaded = control.load(&main).unwrap();
            control.select(loaded[0]).unwrap();
            let home = Point::from_mm(0.0, 0.0, 0.0);
            let mut axes = Recorder::new(home, home);
            let raised = control.run(&mut axes).unwrap_err().to_string();
            assert!(raised.contains(says), "{dialect:?}, run {run}: {raised}");
            assert!(axes.motions.is_empty(), "{dialect:?}");
            tried += 1;
        }
    }
    assert_eq!(tried, 3 * 9);
}

/// LinuxCNC's own interpreter stops at it too, called or as a program.
#[test]
fn linuxcnc_stops_at_it() {
    let tmp = env!("CARGO_TARGET_TMPDIR");
    let Some(referee) = Referee::find(tmp) else {
        return;
    };
    let folder = PathBuf::from(tmp).join("referee").join("alarm");
    for ends_with in [ProgramEnd::M99, ProgramEnd::M30] {
        let mut spec = spec(Dialect::LinuxCnc);
        spec.ends_with = ends_with;
        let text = alarm(&spec, &Withheld::OnlyTaught, None, Coding::Ascii).unwrap();
        let program = match ends_with {
            ProgramEnd::M99 => {
                let sub = text.strip_suffix("M2\n").unwrap();
                format!("{sub}G21 G90\no<umi_correction> call\nG0 X1.\nM2\n")
            }
            ProgramEnd::M30 => text.replace("M2\n", "G21 G90 G0 X1.\nM2\n"),
        };
        let said = referee
            .end_points(&folder, &Before::default(), &program)
            .unwrap_err();
        assert!(said.contains("UMI TAUGHT - NO CORRECTION"), "{said}");
        assert!(!said.contains("STRAIGHT_TRAVERSE"), "{said}");
        // Without the alarm it is a program that moves.
        let without = program.replace("(ABORT, ", "(");
        assert_eq!(
            referee
                .end_points(&folder, &Before::default(), &without)
                .map(|ends| ends.len()),
            Ok(1)
        );
    }
}
