//! A digit that changes on a line without parity, on its way to the control: what becomes of a
//! correction in which any one of them is another one.

use std::panic::{AssertUnwindSafe, catch_unwind};

use umi_core::correction::dialect::is_read_back;
use umi_protocol::job::Dialect;
use umi_tests::referee::{Before, Referee};
use umi_virtual::nc::{Control, ControlSettings, Recorder};

use crate::dialects::control::{language, moved, path};
use crate::dialects::{V, made, points, rigid, spec};

/// What became of programs with a wrong digit.
#[derive(Debug, Default, PartialEq)]
struct Digits {
    alarms: usize,
    /// The lines of those whose alarm came behind a move.
    late: Vec<String>,
    right: usize,
    /// The lines of those that put the part elsewhere.
    wrong: Vec<String>,
}

/// Every digit outside of comments, and of the lines that say a program's number or end LinuxCNC's
/// file, in turn each of the other nine.
fn changed(dialect: Dialect, is_turned: bool) -> Digits {
    let spec = spec(dialect);
    let text = made(&spec, &rigid([0.0, 0.0, 0.013], [1.734_2, -2.301_1, 0.412]));
    let points: Vec<V> = points(&spec);
    let run = |text: &str| {
        let home = umi_core::units::Point::from_mm(0.0, 0.0, 0.0);
        let mut axes = Recorder::new(home, home);
        let mut control = Control::new(ControlSettings::of(language(dialect)));
        control.offsets_mut().set_length(1, 7.0);
        // What stood there before: a digit that names another offset or variable finds this.
        let stood = "G10 L2 P2 X-401. Y-251. Z-311.\nG10 L2 P3 X-402. Y-252. Z-312.\n";
        let stood = match dialect {
            Dialect::LinuxCnc | Dialect::Grbl => format!("{stood}M2\n"),
            // And a tool's length, and a rotation that is still on.
            _ => {
                let turned = if is_turned { "G68 X5. Y7. R3.\n" } else { "" };
                format!("%\nO0003\n{stood}G43 H1\n{turned}M00\nM30\n%\n")
            }
        };
        control
            .load(&stood)
            .and_then(|loaded| control.select(loaded[0]))
            .and_then(|()| control.run(&mut axes))
            .expect("it stands there");
        // What the bench cannot make a program of is none for the control either.
        let ends = catch_unwind(AssertUnwindSafe(|| {
            moved(&mut control, &mut axes, &spec, text, &points)
        }));
        match ends {
            Ok(Ok(ends)) => Ok(ends),
            _ => Err(axes
                .motions
                .iter()
                .any(|(_, motion)| motion.to.mm.norm() > 0.0)),
        }
    };
    let due = run(&text).expect("it is whole");
    let mut found = Digits::default();
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let code = line.split(['(', ';']).next().unwrap_or_default();
        let is_frame = line.starts_with('O') || line.starts_with("M2");
        for (at, digit) in code
            .bytes()
            .enumerate()
            .filter(|(_, byte)| byte.is_ascii_digit())
        {
            for other in (b'0'..=b'9').filter(|other| *other != digit && !is_frame) {
                let mut damaged = text.clone().into_bytes();
                damaged[start + at] = other;
                let damaged = String::from_utf8(damaged).unwrap();
                match run(&damaged) {
                    Err(false) => found.alarms += 1,
                    Err(_) => found
                        .late
                        .push(damaged[start..start + line.len()].trim_end().to_owned()),
                    Ok(ends) => {
                        let off = ends.iter().zip(&due).map(|(is, due)| (is - due).norm());
                        let off_mm = off.fold(0.0, f64::max);
                        if ends.len() == due.len() && off_mm < 0.001 {
                            found.right += 1;
                        } else {
                            let end = start + line.len();
                            found.wrong.push(damaged[start..end].trim_end().to_owned());
                        }
                    }
                }
            }
        }
        start += line.len();
    }
    found
}

/// A correction that is read back is an alarm before anything moves, or is right. Without that most
/// digits move the part.
#[test]
fn a_wrong_digit_is_an_alarm() {
    for dialect in Dialect::ALL {
        if matches!(
            dialect,
            Dialect::Siemens
                | Dialect::Heidenhain
                // Their values are keyed in.
                | Dialect::MazakSettingError
                | Dialect::MitsubishiSettingError
        ) {
            continue;
        }
        for is_turned in [false, true] {
            let found = changed(dialect, is_turned);
            let (alarms, late) = (found.alarms, found.late.len());
            let (right, wrong) = (found.right, found.wrong.len());
            println!(
                "{}, turned before {is_turned}: {alarms} alarms, {late} behind a move, {right} right, {wrong} wrong",
                dialect.name()
            );
            if is_read_back(dialect) {
                assert_eq!(found.wrong, [""; 0], "{}", dialect.name());
                assert_eq!(found.late, [""; 0], "{}", dialect.name());
            } else {
                // What is counted here is real.
                assert!(wrong > 100, "{found:?}");
            }
            assert!(alarms > 20, "{found:?}");
        }
    }
}

/// LinuxCNC's own interpreter, whose offsets are in inches where the virtual machine's are in mm: each
/// digit with the next one in its place is an alarm, or the part is where it was.
#[test]
fn a_wrong_digit_is_an_alarm_of_linuxcnc() {
    let Some(referee) = Referee::find(env!("CARGO_TARGET_TMPDIR")) else {
        return;
    };
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("referee/digits");
    let spec = spec(Dialect::LinuxCnc);
    let text = made(&spec, &rigid([0.0, 0.0, 0.013], [1.734_2, -2.301_1, 0.412]));
    let sub = text.strip_suffix("M2\n").unwrap();
    let rest = format!("o<umi_correction> call\n{}M2\n", path(&points(&spec)));
    let run = |sub: &str| {
        let program = format!("{sub}{rest}");
        referee.end_points(&folder, &Before::default(), &program)
    };
    let due = run(sub).expect("it is whole");
    let (mut start, mut alarms) = (0, 0);
    for line in sub.split_inclusive('\n') {
        let code = line.split('(').next().unwrap_or_default();
        for (at, digit) in code
            .bytes()
            .enumerate()
            .filter(|(_, byte)| byte.is_ascii_digit())
        {
            let mut damaged = sub.to_owned().into_bytes();
            damaged[start + at] = b'0' + (digit - b'0' + 1) % 10;
            let Ok(ends) = run(core::str::from_utf8(&damaged).unwrap()) else {
                alarms += 1;
                continue;
            };
            let off = ends
                .iter()
                .zip(&due)
                .map(|(is, due)| (V::from(*is) - V::from(*due)).amax());
            assert_eq!(ends.len(), due.len(), "{line}");
            assert!(off.fold(0.0, f64::max) < 2e-4, "{line}");
        }
        start += line.len();
    }
    assert!(alarms > 60, "{alarms}");
}
