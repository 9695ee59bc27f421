use nalgebra::{Matrix3, Rotation3, Vector3};
use std::vec::Vec;
use umi_protocol::job::{CorrectionSpec, Dialect, ProgramEnd, SendWhen, WorkOffset};

use umi_protocol::job_error::Field;

use super::*;

fn spec() -> CorrectionSpec {
    CorrectionSpec {
        dialect: Dialect::G10G68,
        probed_in: WorkOffset::G54,
        probed_origin_mm: [-400.0, -250.5, -310.123],
        write_to: WorkOffset::G55,
        set: None,
        program_number: 9010,
        ends_with: ProgramEnd::M99,
        part_min_mm: [-26.0, -36.0, 0.0],
        part_max_mm: [26.0, 36.0, 26.0],
        leftover_mm: 0.03,
        send: SendWhen::OnRequest,
    }
}

fn rigid(rotation: &Matrix3<f64>, translation_mm: &Vector3<f64>) -> RigidTransform {
    RigidTransform {
        rotation: *rotation,
        translation_mm: *translation_mm,
    }
}

/// An independent reading of the program: where would the control put `p`?
fn interpret(text: &str, p: Vector3<f64>) -> Vector3<f64> {
    let word = |line: &str, letter: char| -> f64 {
        line.split_whitespace()
            .find(|w| w.starts_with(letter))
            .map(|w| {
                assert!(w.contains('.'), "{w} has no decimal point");
                w[1..].parse().unwrap()
            })
            .unwrap()
    };
    let g10 = text.lines().find(|l| l.starts_with("G10 L2 P2 ")).unwrap();
    let g68 = text.lines().find(|l| l.starts_with("G68 ")).unwrap();
    let origin = Vector3::new(word(g10, 'X'), word(g10, 'Y'), word(g10, 'Z'));
    let center = Vector3::new(word(g68, 'X'), word(g68, 'Y'), 0.0);
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), word(g68, 'R').to_radians());
    origin + center + turn * (p - center)
}

fn program(rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> (Plan, std::string::String) {
    let spec = spec();
    let plan = plan(&spec, &rigid(rotation, translation)).unwrap();
    let figures = Figures {
        job: "three spheres_1",
        setup: 3,
        rms_mm: 0.00038,
        turn_deg: 1.0001,
        tilt_deg: 0.005,
        run: None,
    };
    let text = write(&Cleared::if_no_reasons(0).unwrap(), &spec, &plan, &figures).unwrap();
    (plan, text.as_str().into())
}

/// The program puts every point of the part where it stands, within the
/// uncorrected error that it states, for tilted and turned clampings.
#[test]
fn program_moves_the_part_to_where_it_stands() {
    for (axis, degrees) in [
        (Vector3::new(0.0, 0.0, 1.0), 1.0),
        (Vector3::new(0.0, 0.0, 1.0), -2.0),
        (Vector3::new(0.004, 0.003, 1.0), 1.0),
        (Vector3::new(0.0, 0.01, -1.0), 179.5),
        (Vector3::new(0.0, 0.0, 1.0), 0.0),
    ] {
        let rotation = Rotation3::new(axis.normalize() * f64::to_radians(degrees)).into_inner();
        let translation = Vector3::new(-47.6405, -0.3266, -0.0041);
        let (plan, text) = program(&rotation, &translation);
        let origin = Vector3::from(spec().probed_origin_mm);
        let mut worst: f64 = 0.0;
        for corner in corners(&spec().part_min_mm.into(), &spec().part_max_mm.into()) {
            let wanted = origin + rotation * corner + translation;
            worst = worst.max((interpret(&text, corner) - wanted).norm());
        }
        assert!(
            (worst - plan.uncorrected.0).abs() < 1e-9,
            "{worst} {plan:?}"
        );
        // Without tilt only rounding is left: sqrt(3) half micrometres and
        // half a thousandth of a degree at 45 mm.
        if axis.x == 0.0 && axis.y == 0.0 {
            assert!(worst < 0.0009 + 0.0004, "{worst}");
        }
    }
}

/// The uncorrected error of a pure tilt is the tilt times the lever to the far corner.
#[test]
fn uncorrected_is_the_tilt_at_the_corner() {
    let tilt = 1e-3;
    let rotation = Rotation3::new(Vector3::new(0.0, tilt, 0.0)).into_inner();
    let (plan, _) = program(&rotation, &Vector3::zeros());
    // lever in the XZ plane from the middle: (26, 13) mm
    let expected = tilt * f64::hypot(26.0, 13.0);
    assert!((plan.uncorrected.0 - expected).abs() < 1e-3, "{plan:?}");
}

/// Pinned: the whole program, as a control reads it.
#[test]
fn program_text() {
    let rotation = Rotation3::new(Vector3::new(0.0, 0.0, f64::to_radians(1.0))).into_inner();
    let (_, text) = program(&rotation, &Vector3::new(1.0, 0.0, -0.0004));
    assert_eq!(
        text.lines().collect::<Vec<_>>(),
        [
            "%",
            "O9010(UMI CORRECTION G55)",
            "(VERDICT OK - SETUP 3)",
            "(JOB THREE SPHERES-1)",
            "(REGISTRATION RMS 0.0004 MM)",
            "(TURN 1.0001 DEG - TILT 0.0050 DEG)",
            "(LEFT AT PART 0.0004 MM - LIMIT 0.0300 MM)",
            "(G54 WAS X-400.000 Y-250.500 Z-310.123 - RUN WITH G55)",
            "(LEAVES G17 G21 G90 G68 ACTIVE - CALLER MUST NOT G69)",
            "G17 G21 G90",
            "G69",
            "G10 L2 P2 X-399.000 Y-250.500 Z-310.123",
            "G55",
            "G68 X0.000 Y0.000 R1.000",
            "M99",
            "%",
        ]
    );
}

/// Numbers that the control cannot hold are refused, never wrapped.
#[test]
fn too_large_or_not_finite_is_refused() {
    let identity = Matrix3::identity();
    for dialect in Dialect::ALL {
        let spec = CorrectionSpec { dialect, ..spec() };
        let at = |x| plan(&spec, &rigid(&identity, &Vector3::new(x, 0.0, 0.0)));
        assert!(at(50.0).is_ok());
        for x in [1.1e5, -1e6, 1e300, f64::INFINITY, f64::NAN] {
            assert_eq!(at(x), Err(NotExpressible), "{dialect:?}");
        }
        let limit = dialect::form(dialect).limit_mm;
        assert_eq!(at(limit + 400.1), Err(NotExpressible), "{dialect:?}");
    }
}

/// The longest name and largest figures still fit the buffer, in every dialect, and no
/// program has a key that the writer does not know.
#[test]
fn the_longest_program_fits() {
    let figures = Figures {
        job: "SIXTEEN-CHARS-16",
        setup: u32::MAX,
        rms_mm: 1e6,
        turn_deg: -180.0,
        tilt_deg: 180.0,
        run: Some((98_499, 99_999)),
    };
    for dialect in Dialect::ALL {
        for ends_with in [ProgramEnd::M99, ProgramEnd::M30] {
            let mut spec = spec();
            (spec.dialect, spec.ends_with) = (dialect, ends_with);
            spec.leftover_mm = 1e4;
            let form = dialect::form(dialect);
            if let Some((_, _, _, last)) = form.further {
                (spec.write_to, spec.probed_in) =
                    (WorkOffset::Extended(last), WorkOffset::Extended(last));
            }
            spec.set = form.set.map(|(_, last, _)| last);
            assert_eq!(dialect::check(&spec), Ok(()), "{dialect:?}");
            spec.probed_origin_mm = [-form.limit_mm; 3];
            let mut plan = plan(&spec, &RigidTransform::identity()).unwrap();
            let largest = -99_999 * 10i64.pow(form.decimals_mm.into()) - 999;
            plan.shift = [largest; 3];
            plan.point = [largest; 2];
            plan.axis = [largest; 3];
            plan.angles = [-180 * 10i64.pow(form.decimals_deg.into()); 3];
            plan.uncorrected = Mm(9999.0);
            let text = write(&Cleared::if_no_reasons(0).unwrap(), &spec, &plan, &figures);
            let text = text.unwrap_or_else(|_| panic!("{dialect:?}"));
            assert!(!text.contains(['{', '}', '^', '|']), "{text}");
        }
    }
}

/// What the job check says of the tape code EIA is so of each dialect, with the comparison of runs and without.
#[test]
fn eia_carries_what_it_is_said_to() {
    for dialect in Dialect::ALL {
        let mut spec = spec();
        spec.dialect = dialect;
        spec.set = dialect::form(dialect).set.map(|(_, last, _)| last);
        let plan = plan(&spec, &RigidTransform::identity()).unwrap();
        for run in [None, Some((531, 17))] {
            let figures = Figures {
                job: "three spheres_1",
                setup: 3,
                rms_mm: 0.0,
                turn_deg: 0.0,
                tilt_deg: 0.0,
                run,
            };
            let text = write(&Cleared::if_no_reasons(0).unwrap(), &spec, &plan, &figures).unwrap();
            let is_carried = text.bytes().all(|byte| {
                crate::dprnt::encode(umi_protocol::pattern::Coding::Eia, byte).is_some()
            });
            let said = dialect::eia_carries(dialect, run.is_some());
            assert_eq!(said, is_carried, "{dialect:?} {run:?}: {text}");
        }
    }
}

/// The run is compared for being another one, older or newer, before anything is set; where a dialect cannot, nothing of it
/// stands there.
#[test]
fn the_run_is_compared_before_anything_is_set() {
    let figures = Figures {
        job: "three spheres_1",
        setup: 3,
        rms_mm: 0.0,
        turn_deg: 0.0,
        tilt_deg: 0.0,
        run: Some((531, 17)),
    };
    for dialect in Dialect::ALL {
        let mut spec = spec();
        spec.dialect = dialect;
        spec.set = dialect::form(dialect).set.map(|(_, last, _)| last);
        let plan = plan(&spec, &RigidTransform::identity()).unwrap();
        let text = write(&Cleared::if_no_reasons(0).unwrap(), &spec, &plan, &figures).unwrap();
        if !dialect::compares_runs(dialect) {
            assert!(!text.contains("531"), "{dialect:?}: {text}");
            continue;
        }
        let check = match dialect {
            Dialect::LinuxCnc => {
                "o531 if [#531 NE 17]\n(ABORT, UMI CORRECTION OF RUN 17)\no531 endif\n"
            }
            Dialect::Siemens => {
                "IF R531==17 GOTOF UMI_RUN\nUMI_STOP:\nSETAL(65000,\"UMI CORRECTION OF RUN 17\")\n\
                 M0\nGOTOB UMI_STOP\nUMI_RUN:\n"
            }
            Dialect::Heidenhain => {
                "; UMI CORRECTION OF RUN 17\nFN 9: IF +QR531 EQU +17 GOTO LBL 2\nLBL 1\n\
                 FN 14: ERROR = 1072\nSTOP\nFN 9: IF +0 EQU +0 GOTO LBL 1\nLBL 2\n"
            }
            // What O8830 compares, before the check value that holds it.
            Dialect::HaasVariables => "E158 17.\nE157 ",
            _ => "IF[#531EQ17]GOTO7\n#3000=2(UMI CORRECTION OF RUN 17)\nN7\n",
        };
        let (before, _) = text
            .split_once(check)
            .unwrap_or_else(|| panic!("{dialect:?}: {text}"));
        let begin = ['(', '%', 'O', 'o', ';'];
        // A Haas sets variables, and O8830 applies them.
        let is_head = |line: &str| line.starts_with("BEGIN") || line.starts_with("E15");
        let sets_nothing = |line: &str| line.is_empty() || line.starts_with(begin) || is_head(line);
        assert!(before.lines().all(sets_nothing), "{dialect:?}: {before}");
    }
}

/// What is stated is never less than what is left, by any digit of it.
#[test]
fn what_is_left_is_stated_rounded_up() {
    let mut plan = plan(&spec(), &RigidTransform::identity()).unwrap();
    for (left, stated) in [
        (0.0, "0.0000"),
        (0.000_1, "0.0001"),
        (0.000_101, "0.0002"),
        (0.012_300_01, "0.0124"),
        (0.03, "0.0300"),
    ] {
        plan.uncorrected = Mm(left);
        let text = write_given(&spec(), &plan, "here").unwrap();
        let line = std::format!("(LEFT AT PART {stated} MM - LIMIT 0.0300 MM)");
        assert!(text.lines().any(|l| l == line), "{left} {text}");
        assert!(text.contains("NOT BY A BOARD)\n(FROM HERE)\n") && !text.contains("VERDICT"));
    }
}

/// A place that a dialect does not have is refused by the name of its field.
#[test]
fn places_that_a_dialect_does_not_have() {
    let with = |dialect, write_to, set| {
        let mut spec = spec();
        (spec.dialect, spec.write_to, spec.set) = (dialect, write_to, set);
        dialect::check(&spec)
    };
    let extended = WorkOffset::Extended;
    for (dialect, offset, set, expected) in [
        (Dialect::G10G68, extended(300), None, Ok(())),
        (Dialect::G10G68, extended(0), None, Err(Field::WriteTo)),
        (Dialect::G10G68, extended(301), None, Err(Field::WriteTo)),
        (Dialect::G10G68, WorkOffset::G55, Some(1), Err(Field::Set)),
        (Dialect::Variables, extended(300), None, Ok(())),
        (
            Dialect::Variables,
            WorkOffset::G59,
            Some(500),
            Err(Field::Set),
        ),
        (Dialect::Haas, extended(99), None, Ok(())),
        (Dialect::Haas, extended(100), None, Err(Field::WriteTo)),
        (Dialect::FanucSettingError, WorkOffset::G55, Some(7), Ok(())),
        (
            Dialect::FanucSettingError,
            WorkOffset::G55,
            Some(8),
            Err(Field::Set),
        ),
        (
            Dialect::MazakSettingError,
            WorkOffset::G55,
            Some(0),
            Err(Field::Set),
        ),
        (Dialect::Siemens, WorkOffset::G57, None, Ok(())),
        (Dialect::Siemens, WorkOffset::G58, None, Err(Field::WriteTo)),
        (Dialect::Siemens, extended(4), None, Err(Field::WriteTo)),
        (Dialect::Siemens, extended(99), None, Ok(())),
        (Dialect::LinuxCnc, extended(7), None, Err(Field::WriteTo)),
        (Dialect::Grbl, WorkOffset::G59, None, Ok(())),
        (Dialect::Heidenhain, WorkOffset::G55, Some(9999), Ok(())),
    ] {
        assert_eq!(
            with(dialect, offset, set),
            expected,
            "{dialect:?} {offset:?} {set:?}"
        );
    }
}

/// What a control cannot express stays at the part and is said: tilt where it turns about
/// Z only, the turn where it does not turn.
#[test]
fn what_a_control_cannot_do_is_left() {
    let left = |dialect, ends_with, axis: Vector3<f64>| {
        let mut spec = spec();
        (spec.dialect, spec.ends_with) = (dialect, ends_with);
        let rotation = Rotation3::new(axis).into_inner();
        plan(&spec, &rigid(&rotation, &Vector3::new(1.0, 2.0, 3.0)))
            .unwrap()
            .uncorrected
            .0
    };
    let (tilt, turn) = (Vector3::new(0.0, 1e-3, 0.0), Vector3::new(0.0, 0.0, 1e-3));
    let (tilted, turned) = (1e-3 * f64::hypot(26.0, 13.0), 1e-3 * f64::hypot(26.0, 36.0));
    for dialect in Dialect::ALL {
        let kind = dialect::form(dialect).turn;
        let kept = !dialect::form(dialect).turn_ends_with_program;
        let full = matches!(kind, Turn::Axis | Turn::Angles);
        for (ends_with, stays) in [(ProgramEnd::M99, true), (ProgramEnd::M30, kept)] {
            for (axis, alone, can) in [
                (tilt, tilted, full && stays),
                (turn, turned, kind != Turn::No && stays),
            ] {
                let left = left(dialect, ends_with, axis);
                let expected = if can { 0.0 } else { alone };
                assert!(
                    (left - expected).abs() < 2e-3,
                    "{dialect:?} {left} {expected}"
                );
            }
        }
    }
}

/// Three angles near 90 degrees of the middle one are not unique: refused.
#[test]
fn angles_that_are_not_unique_are_refused() {
    for dialect in Dialect::ALL {
        let mut spec = spec();
        spec.dialect = dialect;
        let plan_at = |degrees: f64| {
            let rotation = Rotation3::new(Vector3::y() * degrees.to_radians()).into_inner();
            plan(&spec, &rigid(&rotation, &Vector3::zeros()))
        };
        let by_angles = dialect::form(dialect).turn == Turn::Angles;
        for degrees in [89.99, 90.0, -90.0, 90.05] {
            assert_eq!(
                plan_at(degrees).is_err(),
                by_angles,
                "{dialect:?} {degrees}"
            );
        }
        assert!(plan_at(89.9).is_ok());
    }
}

/// A main program's end resets `G68`: with `M30` only the offset is sent, and what
/// a rotation then leaves at the part is in the uncorrected error.
#[test]
fn a_main_program_sends_the_offset_only() {
    let mut spec = spec();
    spec.ends_with = ProgramEnd::M30;
    let turned = Rotation3::new(Vector3::new(0.0, 0.0, 1e-3)).into_inner();
    let plan = plan(&spec, &rigid(&turned, &Vector3::new(1.0, 2.0, 3.0))).unwrap();
    // 1 mrad at the corner (26, 36) mm.
    let expected = 1e-3 * f64::hypot(26.0, 36.0);
    assert!((plan.uncorrected.0 - expected).abs() < 1e-3, "{plan:?}");
    let figures = Figures {
        job: "J",
        setup: 0,
        rms_mm: 0.0,
        turn_deg: 0.0,
        tilt_deg: 0.0,
        run: None,
    };
    let cleared = Cleared::if_no_reasons(0).unwrap();
    let text = write(&cleared, &spec, &plan, &figures).unwrap();
    assert!(
        !text.contains("G68 X") && text.ends_with("G55\nM30\n%\n"),
        "{text}"
    );
}
