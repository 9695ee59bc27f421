//! What no control does: motions to nowhere, runs without end; and how deep calls go.

use super::mock::{Mock, alarm, fanuc, run, run_in, run_with};
use crate::cell::control;
use crate::nc::{Control, ControlFamily, ControlSettings};
use crate::scene::Scene;

/// The message at which a program of a dialect stops; no motion was made that is not one.
fn refused(dialect: ControlFamily, text: &str) -> String {
    let mut mock = Mock::default();
    let (_, end) = run_with(ControlSettings::of(dialect), &mut mock, text);
    for end in mock.ends() {
        assert!(end.iter().all(|value| value.is_finite()), "{text}: {end:?}");
    }
    end.expect_err(text).message
}

/// Words too long for a number reach no axis, neither as a place nor as a feed.
#[test]
fn numbers_are_finite() {
    let nines = "9".repeat(400);
    for dialect in [ControlFamily::LinuxCnc, ControlFamily::Grbl] {
        for text in [
            format!("G2 X1 I{nines} F10\nM2"),
            format!("G2 X1 R{nines} F10\nM2"),
            format!("G1 X1 F{nines}\nM2"),
            format!("G1 X-{nines} F1\nM2"),
            format!("G91\nG0 X{nines}\nM2"),
            format!("G4 P{nines}\nM2"),
        ] {
            let why = refused(dialect, &text);
            assert!(why.contains("too large"), "{why}");
        }
        // Finite, and yet infinite in millimetres or squared.
        let long = "9".repeat(308);
        for text in [
            format!("G20 G1 X1 F{long}\nM2"),
            format!("G2 X1 I{long} F10\nM2"),
            format!("G20\nG10 L2 P1 X{long}\nM2"),
        ] {
            assert!(refused(dialect, &text).contains("too large"));
        }
        assert!(refused(dialect, "G2 I99999999999 F10\nM2").contains("too far"));
    }
    let why = refused(ControlFamily::LinuxCnc, "G20\n#5221=[10**308]\nG0 X0\nM2");
    assert!(why.contains("too large"), "{why}");
    assert_eq!(alarm("#100=100000000.\n#5221=#100*#100").number, Some(32));
}

/// G81 below R: LinuxCNC climbs to R before it moves, and comes back to R; a Fanuc moves
/// at its height and comes back to it.
#[test]
fn cycle_begins_below_r() {
    let text = "G0 Z2\nG98 G81 X10 Y0 R5 Z-10 F100\nX20\nM30\n";
    let (_, mock) = run_in(ControlFamily::LinuxCnc, text);
    let xz = |mock: &Mock| -> Vec<[f64; 2]> {
        let mut ends: Vec<_> = mock.ends().iter().map(|end| [end[0], end[2]]).collect();
        ends.dedup();
        ends
    };
    let first = [[10.0, 5.0], [10.0, -10.0], [10.0, 5.0]];
    let second = [[20.0, 5.0], [20.0, -10.0], [20.0, 5.0]];
    let climbs = [[0.0, 2.0], [0.0, 5.0]];
    assert_eq!(xz(&mock), [&climbs[..], &first, &second].concat());
    let (_, mock) = run("G0Z2.\nG98G81X10.Y0R5.Z-10.F100.\nX20.");
    let hole = |x: f64| [[x, 2.0], [x, 5.0], [x, -10.0], [x, 2.0]];
    assert_eq!(
        xz(&mock),
        [&[[0.0, 2.0]][..], &hole(10.0), &hole(20.0)].concat()
    );
}

/// Ten pecks of a tenth of the depth are ten, whatever their sum in binary is.
#[test]
fn pecks_are_whole() {
    for (text, pecks) in [
        ("G83X1.R0Z-1.Q0.1F100.", 10),
        ("G73X1.R0Z-1.Q0.1F100.", 10),
        ("G83X1.R0Z-0.7Q0.1F100.", 7),
        ("G83X1.R0Z-1.001Q0.1F100.", 11),
        ("G83X1.R0Z-1.Q5.F100.", 1),
    ] {
        let (_, mock) = run(text);
        let feeds: Vec<_> = mock.ends().into_iter().filter(|end| end[3] > 0.0).collect();
        assert_eq!(feeds.len(), pecks, "{text}: {feeds:?}");
    }
}

/// A null takes its place among the arguments: behind `I#0` a second I is #7.
#[test]
fn null_arguments() {
    let text = "G65P2I#0I5.\nM30\nO2\n#100=#4\n#101=#7\nM99";
    let (control, _) = run(text);
    assert_eq!([100, 101].map(|n| control.variable(n)), [None, Some(5.0)]);
}

/// Four macros nest, and ten subprograms apart from them.
#[test]
fn nesting() {
    let chain = |call: &str, first: u32, last: u32| -> String {
        (first..last)
            .map(|n| format!("O{n}\n{call}P{}\nM99\n", n + 1))
            .collect()
    };
    let both = |macros: u32, subprograms: u32| {
        format!(
            "G65P10\nM30\n{}O{}\nM98P100\nM99\n{}O{}\n#100=1\nM99",
            chain("G65", 10, 9 + macros),
            9 + macros,
            chain("M98", 100, 99 + subprograms),
            99 + subprograms,
        )
    };
    let (control, _) = run(&both(4, 10));
    assert_eq!(control.variable(100), Some(1.0));
    let five = alarm(&both(5, 1));
    assert_eq!(five.number, Some(77));
    assert!(five.message.contains("more than 4 macros"), "{five}");
    let eleven = alarm(&both(1, 11));
    assert!(
        eleven.message.contains("more than 10 subprograms"),
        "{eleven}"
    );
}

/// M99 in the main program stops soon and says what to do; loops say where their bound is.
#[test]
fn main_program_repeats() {
    let text = "O1\n#500=#500+1\nM99\n";
    let (control, end) = run_with(fanuc(), &mut Mock::default(), text);
    assert!(
        end.expect_err("without end")
            .message
            .contains("end it with M30")
    );
    assert_eq!(control.variable(500), Some(3.0));
    let mut settings = fanuc();
    settings.limits.main_repeats = 10;
    let (control, end) = run_with(settings, &mut Mock::default(), text);
    assert!(end.is_err());
    assert_eq!(control.variable(500), Some(11.0));
    let endless = alarm("N1GOTO1").message;
    assert!(
        endless.contains("`loops` in the scene's [control.nc.limits]"),
        "{endless}"
    );
}

/// G54.4 turns about X, then Y, then Z, then shifts, by what the scene says; a set that
/// nobody gave is an alarm, not a compensation by nothing.
#[test]
fn setting_errors() {
    let scene = Scene::parse(
        "[setting_errors.P2]\ntranslation_mm = [1.0, 2.0, 3.0]\nrotation_deg = [90.0, 0.0, 90.0]\n\
         [setting_errors.P3]\nrotation_deg = [0.0, 90.0, 90.0]",
    )
    .expect("a valid scene");
    let run = |control: &mut Control, text: &str| {
        control.load(text).expect("loads");
        control.select(1).expect("there");
        let mut mock = Mock::default();
        let end = control.run(&mut mock);
        (mock, end)
    };
    let mut control = control(&scene);
    let (mock, end) = run(
        &mut control,
        "O1\nG54.4P2\nG0X0Y10.Z0\nG54.4P3\nX0Y0Z10.\nX10.Z0\nG54.4P0\nX0Y0Z0\nM30",
    );
    assert!(end.is_ok(), "{end:?}");
    assert_eq!(
        mock.ends(),
        [
            [1.0, 2.0, 13.0, 0.0],
            // Z goes to X (about Y), then to Y (about Z); X goes to -Z.
            [0.0, 10.0, 0.0, 0.0],
            [0.0, 0.0, -10.0, 0.0],
            [0.0, 0.0, 0.0, 0.0]
        ]
    );
    let (_, end) = run(&mut control, "O1\nG54.4P1\nG0X0\nM30");
    assert!(end.expect_err("not set").message.contains("never set"));
}

/// A repetition that is no number of times says what it may be.
#[test]
fn repetitions() {
    let why = alarm("G65P2L999999999").message;
    assert!(
        why.contains("how often is a whole number from 0 to 9999"),
        "{why}"
    );
}
