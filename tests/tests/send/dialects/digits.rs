//! A digit that changes on a line without parity, on its way to the control: what becomes of a
//! correction in which any one of them is another one.

use std::panic::{AssertUnwindSafe, catch_unwind};

use umi_protocol::job::Dialect;
use umi_virtual::nc::{Control, ControlSettings};

use crate::dialects::control::{corrected, language};
use crate::dialects::{V, made, points, rigid, spec};

/// What became of programs with a wrong digit.
#[derive(Debug, Default, PartialEq)]
struct Digits {
    alarms: usize,
    right: usize,
    /// The lines of those that put the part elsewhere.
    wrong: Vec<String>,
}

/// Every digit outside of comments, and of the lines that say a program's number and end, in turn
/// each of the other nine.
fn changed(dialect: Dialect) -> Digits {
    let spec = spec(dialect);
    let text = made(&spec, &rigid([0.0, 0.0, 0.013], [1.734_2, -2.301_1, 0.412]));
    let points: Vec<V> = points(&spec);
    let run = |text: &str| {
        let mut control = Control::new(ControlSettings::of(language(dialect)));
        // What stood there before: a digit that names another variable reads this.
        let stood = "G10 L2 P2 X-401. Y-251. Z-311.\nG10 L2 P3 X-402. Y-252. Z-312.\n";
        let stood = match dialect {
            Dialect::LinuxCnc => format!("{stood}M2\n"),
            _ => format!("%\nO0003\n{stood}M30\n%\n"),
        };
        control
            .load(&stood)
            .and_then(|loaded| control.select(loaded[0]))
            .and_then(|()| {
                let home = umi_core::units::Point::from_mm(0.0, 0.0, 0.0);
                control.run(&mut umi_virtual::nc::Recorder::new(home, home))
            })
            .ok()?;
        // What the bench cannot make a program of is none for the control either.
        catch_unwind(AssertUnwindSafe(|| {
            corrected(&mut control, &spec, text, &points)
        }))
        .ok()?
        .ok()
    };
    let due = run(&text).expect("it is whole");
    let mut found = Digits::default();
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let code = line.split(['(', ';']).next().unwrap_or_default();
        let is_frame = line.starts_with('O') || line.starts_with("M2") || line.starts_with("M99");
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
                    None => found.alarms += 1,
                    Some(ends) => {
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

/// The check value of `haas-e` holds every digit. Without one most of them move the part; one
/// over the stored values leaves what is no value.
#[test]
fn a_wrong_digit_is_an_alarm() {
    for dialect in [
        Dialect::HaasVariables,
        Dialect::FanucSettingError,
        Dialect::Variables,
        Dialect::LinuxCnc,
        Dialect::G10G68,
        Dialect::Haas,
    ] {
        let found = changed(dialect);
        let (alarms, right, wrong) = (found.alarms, found.right, found.wrong.len());
        println!(
            "{}: {alarms} alarms, {right} right, {wrong} wrong",
            dialect.name()
        );
        match dialect {
            Dialect::HaasVariables => assert_eq!(found.wrong, [""; 0]),
            Dialect::FanucSettingError => assert!(wrong < 182, "{found:?}"),
            Dialect::Variables => assert!(wrong < 61, "{found:?}"),
            // What is counted here is real.
            _ => assert!(wrong > 100, "{found:?}"),
        }
        assert!(alarms > 20, "{found:?}");
    }
}
