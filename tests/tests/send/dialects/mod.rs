//! Corrections in every dialect: the program as a control would read it puts the part where
//! it stands, within the error that the program states, and not much better than that.
//!
//! Fanuc, Haas, LinuxCNC and GRBL are read by the virtual machine's interpreter, with the
//! rounding of its control; Mazak's and Mitsubishi's values are keyed in from the comments, as
//! their operators would. Siemens and Heidenhain have no interpreter here: [`by_hand`] turns
//! points axis by axis as their manuals say it, without a matrix.

mod alarms;
mod board;
mod by_hand;
mod control;
mod digits;
mod refused;

use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use umi_core::correction::{corners, dialect, plan, write_given};
use umi_core::registration::RigidTransform;
use umi_protocol::job::{CorrectionSpec, Dialect, ProgramEnd, SendWhen, WorkOffset};

/// A point or a direction, mm.
pub type V = Vector3<f64>;

/// A correction wanted, in the dialect.
pub fn spec(dialect: Dialect) -> CorrectionSpec {
    CorrectionSpec {
        dialect,
        probed_in: WorkOffset::G54,
        probed_origin_mm: [-400.0, -250.5, -310.123_4],
        write_to: WorkOffset::G55,
        set: None,
        program_number: 9010,
        ends_with: ProgramEnd::M99,
        part_min_mm: [-26.0, -36.0, 0.0],
        part_max_mm: [126.0, 46.0, 26.0],
        leftover_mm: 0.05,
        send: SendWhen::OnRequest,
    }
}

/// The program.
pub fn made(spec: &CorrectionSpec, transform: &RigidTransform) -> String {
    let plan = plan(spec, transform).unwrap();
    write_given(spec, &plan, "test").unwrap().as_str().into()
}

/// What the program says that it leaves, mm.
pub fn stated(text: &str) -> f64 {
    let line = text.lines().find(|l| l.contains("LEFT AT PART")).unwrap();
    let words: Vec<&str> = line.split_whitespace().collect();
    let at = words.iter().position(|word| *word == "PART").unwrap();
    words[at + 1].parse().unwrap()
}

/// Points of the part in the control's increments: its corners and some between them.
pub fn points(spec: &CorrectionSpec) -> Vec<V> {
    let (min, max) = (V::from(spec.part_min_mm), V::from(spec.part_max_mm));
    let inner = [[0.5, 0.5, 0.5], [0.125, 0.75, 0.25]].map(|part| {
        let p = min + (max - min).component_mul(&V::from(part));
        p.map(|x| (x * 1000.0).round() / 1000.0)
    });
    corners(&min, &max).chain(inner).collect()
}

/// Where a control puts the points; none if it cannot be asked.
pub fn read(spec: &CorrectionSpec, text: &str, points: &[V]) -> Vec<V> {
    match spec.dialect {
        Dialect::Siemens => by_hand::siemens(text, points),
        Dialect::Heidenhain => by_hand::heidenhain(text, points),
        _ => control::read(spec, text, points),
    }
}

/// Holds a correction to what it states.
fn hold(spec: &CorrectionSpec, transform: &RigidTransform) -> Result<(), TestCaseError> {
    let text = made(spec, transform);
    let uncorrected = plan(spec, transform).unwrap().uncorrected.0;
    let points = points(spec);
    let origin = V::from(spec.probed_origin_mm);
    let reached = read(spec, &text, &points);
    prop_assert_eq!(reached.len(), points.len());
    let error = |(p, q): (&V, &V)| {
        (q - (origin + transform.rotation * p + transform.translation_mm)).norm()
    };
    let errors: Vec<f64> = points.iter().zip(&reached).map(error).collect();
    let worst = errors.iter().copied().fold(0.0, f64::max);
    // A control's own arithmetic is double here.
    let slack = 1e-9;
    prop_assert!(
        worst <= uncorrected + slack,
        "{} {worst} {uncorrected}\n{text}",
        spec.dialect.name()
    );
    // The worst is at a corner, and it is what the plan says.
    prop_assert!(
        worst >= uncorrected - slack,
        "{} {worst} {uncorrected}\n{text}",
        spec.dialect.name()
    );
    if spec.dialect != Dialect::HaasVariables {
        let stated = stated(&text);
        prop_assert!(
            worst <= stated + slack && stated <= worst + 1e-4 + slack,
            "{worst} {stated}"
        );
    }
    Ok(())
}

fn rigid(axis: [f64; 3], shift: [f64; 3]) -> RigidTransform {
    RigidTransform {
        rotation: Rotation3::new(V::from(axis)).into_inner(),
        translation_mm: V::from(shift),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// In every dialect, for any clamping: turned, leaning, shifted, in any offset and set,
    /// as a subprogram and as a main program.
    #[test]
    fn every_program_does_what_it_states(
        tilt in prop::array::uniform2(prop_oneof![Just(0.0), -0.002..0.002f64, -0.3..0.3f64]),
        turn in prop_oneof![Just(0.0), -0.05..0.05f64, -3.1..3.1f64],
        shift in prop::array::uniform3(prop_oneof![-0.1..0.1f64, -60.0..60.0f64]),
        offset in 0..6u16,
        further in 1..=99u16,
        set in 1..=7u16,
        main in any::<bool>(),
    ) {
        for dialect in Dialect::ALL {
            let mut spec = spec(dialect);
            let form = dialect::form(dialect);
            spec.write_to = match (offset, form.further) {
                (0, Some((_, _, first, _))) => WorkOffset::Extended(further.max(first)),
                (1, _) | (_, _) if form.standard == 4 => WorkOffset::G57,
                (1, _) => WorkOffset::G56,
                (2, _) => WorkOffset::G57,
                (3, _) => WorkOffset::G58,
                (4, _) => WorkOffset::G59,
                _ => WorkOffset::G55,
            };
            spec.set = match dialect {
                Dialect::HaasVariables => None,
                _ => form.set.map(|_| set),
            };
            spec.ends_with = if main { ProgramEnd::M30 } else { ProgramEnd::M99 };
            prop_assert_eq!(dialect::check(&spec), Ok(()));
            hold(&spec, &rigid([tilt[0], tilt[1], turn], shift))?;
        }
    }
}

/// The rounding of each dialect alone: a clamping that it can express leaves no more than
/// half a step of its numbers makes at the part.
#[test]
fn what_is_left_of_a_turn_is_rounding() {
    for dialect in Dialect::ALL {
        let form = dialect::form(dialect);
        if form.turn == dialect::Turn::No {
            continue;
        }
        let spec = spec(dialect);
        for turn in [0.017_123_4, -0.034_567, 1.234_567] {
            let transform = rigid([0.0, 0.0, turn], [-47.640_5, -0.326_6, -0.004_1]);
            let half_mm = 0.5 * 0.1f64.powi(form.decimals_mm.into());
            let half_rad = (0.5 * 0.1f64.powi(form.decimals_deg.into())).to_radians();
            // In each axis: of the shift, of the set's work offset; the lever is half the part.
            let lengths = if form.in_set { 2.0 } else { 1.0 } * half_mm * 3f64.sqrt();
            let bound = lengths + half_rad * f64::hypot(76.0, 41.0) * 1.001;
            let left = plan(&spec, &transform).unwrap().uncorrected.0;
            assert!(left <= bound, "{dialect:?} {left} {bound}");
        }
    }
}

/// The clampings of the thesis, table 4.2 (by their angles and shifts): what each kind of
/// control leaves at its part.
#[test]
fn what_the_thesis_clampings_leave() {
    let part = ([-26.0, -36.0, 60.0], [26.0, 36.0, 86.0]);
    let mut rows = Vec::new();
    for case in 1..=4 {
        let path = format!(
            "{}/reference/fits/registration_thesis_table_4_2_case{case}.json",
            env!("CARGO_MANIFEST_DIR")
        );
        let fit: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let (r, t) = (&fit["result"]["R"], &fit["result"]["t"]);
        let transform = RigidTransform {
            rotation: nalgebra::Matrix3::from_fn(|i, j| r[i][j].as_f64().unwrap()),
            translation_mm: V::from_fn(|i, _| t[i].as_f64().unwrap()),
        };
        let tilt = UnitQuaternion::from_matrix(&transform.rotation)
            .transform_vector(&V::z())
            .angle(&V::z());
        for dialect in Dialect::ALL {
            let mut spec = spec(dialect);
            (spec.part_min_mm, spec.part_max_mm) = part;
            let left = plan(&spec, &transform).unwrap().uncorrected.0;
            rows.push(format!("case {case} {:18} {:8.4} mm", dialect.name(), left));
            let kind = dialect::form(dialect).turn;
            match kind {
                dialect::Turn::Axis | dialect::Turn::Angles => assert!(left < 0.003, "{rows:?}"),
                dialect::Turn::No => assert!(left > 0.2, "{rows:?}"),
                // The tilt at half the part's diagonal, and rounding.
                _ => assert!((left - tilt * f64::hypot(44.4, 13.0)).abs() < tilt * 20.0 + 0.002),
            }
        }
    }
    println!("{}", rows.join("\n"));
}
