//! What a correction program itself refuses on the control, and LinuxCNC's interpreter as a
//! second reader.

use umi_protocol::job::{Dialect, ProgramEnd};
use umi_tests::referee::{Before, Referee};
use umi_virtual::nc::{Control, ControlSettings};

use crate::dialects::control::{corrected, language, path};
use crate::dialects::{V, made, points, read, rigid, spec};

/// A value that changes on its way, or that does not arrive, is an alarm before the first
/// move, wherever a check value is read back.
#[test]
fn a_damaged_value_is_an_alarm() {
    let transform = rigid([1e-3, -2e-3, 0.02], [1.0, -20.0, 0.5]);
    for dialect in [
        Dialect::FanucSettingError,
        Dialect::Variables,
        Dialect::HaasVariables,
    ] {
        let spec = spec(dialect);
        let text = made(&spec, &transform);
        let points = points(&spec);
        let run = |text: &str| {
            let mut control = Control::new(ControlSettings::of(language(dialect)));
            corrected(&mut control, &spec, text, &points)
        };
        assert!(run(&text).is_ok(), "{text}");
        let values: Vec<&str> = text
            .lines()
            .filter(|line| line.starts_with(['#', 'E']) && !line.contains("=#"))
            .collect();
        assert!(values.len() >= 4);
        for line in values {
            let at = line.rfind(|c: char| c.is_ascii_digit()).unwrap();
            let digit = if line.ends_with('0') { "1" } else { "0" };
            let damaged = format!("{}{digit}{}", &line[..at], &line[at + 1..]);
            if damaged != line && !line.ends_with('.') {
                let alarm = run(&text.replace(line, &damaged)).expect_err(line);
                let is_named = alarm.message.contains("CORRECTION") || line == "#33=1";
                assert!(is_named, "{line}: {alarm}");
            }
            let alarm = run(&text.replace(&format!("{line}\n"), "")).expect_err(line);
            // Without its number the set is none.
            let is_named = alarm.message.contains("CORRECTION") || line == "#33=1";
            assert!(is_named, "{line}: {alarm}");
        }
        // Exchanged values do not pass either.
        let lines: Vec<&str> = text.lines().filter(|l| l.starts_with(['#', 'E'])).collect();
        let value = |line: &str| line.split(['=', ' ']).nth(1).unwrap().to_string();
        let (one, two) = (lines[0], lines[1]);
        let exchanged = text
            .replace(one, &one.replace(&value(one), "ONE"))
            .replace(two, &two.replace(&value(two), &value(one)))
            .replace("ONE", &value(two));
        assert!(run(&exchanged).is_err(), "{exchanged}");
    }
}

/// A macro that has applied a correction does not apply it again: the next setup's must
/// have come.
#[test]
fn a_correction_by_variables_of_a_haas_is_taken_once() {
    let spec = spec(Dialect::HaasVariables);
    let text = made(&spec, &rigid([0.0; 3], [1.0, 2.0, 3.0]));
    let mut control = Control::new(ControlSettings::of(language(spec.dialect)));
    assert!(corrected(&mut control, &spec, &text, &points(&spec)).is_ok());
    assert!(corrected(&mut control, &spec, "", &points(&spec)).is_err());
}

/// A Haas' macro compares the run in which a correction was measured with its own count, before it
/// sets anything; and takes one that says none.
#[test]
fn a_correction_by_variables_of_a_haas_belongs_to_its_run() {
    let spec = spec(Dialect::HaasVariables);
    let text = made(&spec, &rigid([0.0; 3], [1.0, 2.0, 3.0]));
    let of_run = |run: u32| {
        // As the board writes it: the run, and a tenth of it in the check value.
        let (before, value) = text.split_once("E158 0.\nE157 ").unwrap();
        let value: f64 = value.trim().parse().unwrap();
        format!(
            "{before}E158 {run}.\nE157 {:.3}\n",
            value + f64::from(run) / 10.0
        )
    };
    let carried_out = |text: &str, count: u32| {
        let mut control = Control::new(ControlSettings::of(language(spec.dialect)));
        let counted = format!("E531 {count}.\n{text}");
        corrected(&mut control, &spec, &counted, &points(&spec))
    };
    assert!(carried_out(&text, 7).is_ok());
    for run in [1, 17, 99_999] {
        assert!(carried_out(&of_run(run), run).is_ok(), "{run}");
        let alarm = carried_out(&of_run(run), run + 1).unwrap_err();
        assert!(alarm.message.contains("OF ANOTHER RUN"), "{alarm}");
        // A run that was damaged on its way is not the check value's.
        let damaged = of_run(run).replace(&format!("E158 {run}."), &format!("E158 {}.", run + 1));
        let alarm = carried_out(&damaged, run + 1).unwrap_err();
        assert!(alarm.message.contains("NOT RECEIVED"), "{alarm}");
    }
}

/// LinuxCNC's own interpreter ends every move where the virtual machine's does, and so
/// where the part stands within what is stated.
#[test]
fn the_referee_agrees_on_linuxcnc() {
    let Some(referee) = Referee::find(env!("CARGO_TARGET_TMPDIR")) else {
        return;
    };
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("referee/dialects");
    for (number, ends_with) in [ProgramEnd::M99, ProgramEnd::M30].into_iter().enumerate() {
        for (axis, shift) in [
            ([0.0, 0.0, 0.02], [1.0, -20.0, 0.5]),
            ([1e-4, 2e-4, -1.3], [-48.4, 0.1234, -0.02]),
            ([0.0, 0.0, 3.0], [0.0, 0.0, 0.0]),
        ] {
            let mut spec = spec(Dialect::LinuxCnc);
            spec.ends_with = ends_with;
            let transform = rigid(axis, shift);
            let text = made(&spec, &transform);
            let points = points(&spec);
            let path = path(&points);
            let program = match ends_with {
                ProgramEnd::M99 => {
                    let sub = text.strip_suffix("M2\n").unwrap();
                    format!("{sub}o<umi_correction> call\n{path}M2\n")
                }
                ProgramEnd::M30 => {
                    let body = text.strip_suffix("M30\n").unwrap();
                    format!("{body}G55\n{path}M2\n")
                }
            };
            let folder = folder.join(number.to_string());
            let theirs = referee
                .end_points(&folder, &Before::default(), &program)
                .unwrap();
            let ours = read(&spec, &text, &points);
            assert_eq!(ours.len(), theirs.len());
            for (ours, theirs) in ours.iter().zip(theirs) {
                assert!(
                    (ours - V::from(theirs)).amax() < 2e-4,
                    "{ours} {theirs:?}\n{program}"
                );
            }
        }
    }
}
