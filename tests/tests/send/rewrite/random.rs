//! Programs that nobody would write: what is not refused moves as its image does.

use proptest::prelude::*;
use umi_virtual::nc::ControlFamily;

use crate::rewrite::follow::{Judge, LOOSE_MM, interpreted};
use crate::rewrite::{rewritten, settings, turned};

fn number() -> impl Strategy<Value = String> {
    prop_oneof![
        (-30_000i32..30_000).prop_map(|n| format!("{:.3}", f64::from(n) / 1000.0)),
        (-30i32..30).prop_map(|n| format!("{n}.")),
        Just("0.".to_owned()),
    ]
}

fn words(letters: &'static str) -> impl Strategy<Value = String> {
    let letters: Vec<char> = letters.chars().collect();
    let most = letters.len();
    prop::sample::subsequence(letters, 0..=most).prop_flat_map(|letters| {
        let numbers = prop::collection::vec(number(), letters.len());
        numbers.prop_map(move |numbers| {
            let words = letters.iter().zip(numbers);
            words
                .map(|(letter, number)| format!("{letter}{number} "))
                .collect()
        })
    })
}

fn line() -> impl Strategy<Value = String> {
    let modes = vec![
        "", "", "", "", "G90 ", "G91 ", "G17 ", "G18 ", "G19 ", "G20 ", "G21 ", "G98 ", "G99 ",
        "G80 ",
    ];
    prop_oneof![
        4 => (prop::sample::select(modes), prop::sample::select(vec!["", "G0 ", "G1 "]), words("XYZ"))
            .prop_map(|(mode, motion, words)| format!("{mode}{motion}{words}")),
        // Arcs that exist: half turns and quarters in a plane.
        2 => (0usize..3, 1i32..20_000, any::<bool>(), any::<bool>(), number()).prop_map(
            |(plane, radius, left, half, rise)| {
                let r = f64::from(radius) / 1000.0;
                let [a, b, c, i] = [["X", "Y", "Z", "I"], ["Z", "X", "Y", "K"], ["Y", "Z", "X", "J"]][plane];
                let code = if left { 3 } else { 2 };
                let to = if half { (2.0 * r, 0.0) } else { (r, if left { -r } else { r }) };
                format!(
                    "G91 G{} G{code} {a}{:.3} {b}{:.3} {c}{rise} {i}{r:.3} G90",
                    17 + plane, to.0, to.1
                )
            }
        ),
        1 => (prop::sample::select(vec!["G81", "G82", "G83", "G73", "G85"]), words("XY"), 1i32..9)
            .prop_map(|(code, words, q)| format!("{code} {words}Z-5.5 R12.25 Q{q}. P10")),
        // Where an axis is not known behind them, a rapid may be off by what the rewriter states.
        1 => prop::sample::select(vec![
            "G91 G28 Z0.\nG90", "G53 G0 Z666.666", "G52 X1. Y2.", "G52 X0 Y0 Z0", "M6 T1\nG90 G0 X1. Y0. Z20.", "G94 F100.",
            "M8", "(NOTHING)", "G4 P10", "G43 H1\nG90 G0 X1. Y0. Z20.", "G49\nG90 G0 X1. Y0. Z20.", "/G0 X3.\nG90 G0 X1. Y0. Z20.", "G54", "G80 G0 X0. Y0. Z20.", "G17 G0 Z30.",
        ]).prop_map(str::to_owned),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    /// A program that is carried out and not refused has the image of every motion.
    #[test]
    fn no_unrefused_program_moves_otherwise(
        lines in prop::collection::vec(line(), 1..14),
        degrees in prop_oneof![
            (-180.0f64..180.0).prop_map(|c| [0.0, 0.0, c]),
            prop::array::uniform3(-0.01f64..0.01),
            prop::array::uniform3(-50.0f64..50.0),
        ],
        shift in prop::array::uniform3(-10.0f64..10.0),
    ) {
        let program = format!("G21 G90 G17 G98 G0 X0. Y0. Z20.\nG1 F100.\n{}\nM2\n", lines.join("\n"));
        let Ok(nominal) = interpreted(ControlFamily::Haas, &program) else { return Ok(()) };
        let transform = turned(degrees, shift);
        let Ok((made, _)) = rewritten(&settings(transform, 1.0), &program) else { return Ok(()) };
        let judge = Judge {
            transform,
            origin: nalgebra::Vector3::zeros(),
            rounding_mm: if program.contains("G20") { 0.00127 + 1e-6 } else { 0.0005 + 1e-6 },
            path_mm: 0.0101,
            loose_mm: LOOSE_MM,
        };
        let compared = interpreted(ControlFamily::Haas, &made).and_then(|written| judge.moves(&nominal, &written));
        prop_assert!(compared.is_ok(), "{}\n{program}\n{made}", compared.unwrap_err());
    }
}
