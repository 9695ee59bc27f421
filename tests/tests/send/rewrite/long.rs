//! A long program as CAM software writes it, made from a seed.

use std::fmt::Write as _;

use umi_virtual::nc::ControlFamily;

use crate::rewrite::follow::{Judge, LOOSE_MM, interpreted};
use crate::rewrite::{rewritten, settings, table_4_2};

/// Laces over a wavy surface, with arcs at their ends.
fn laces(seed: u64, count: usize) -> String {
    let mut state = seed;
    let mut random = move || {
        // Knuth's MMIX generator; its highest 53 bits, 0 to 1.
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut text = String::from("%\nO0100 (LACES)\nG21 G90 G17 G94\nG0 X0. Y0. Z50.\nS9000 M3\n");
    let (mut x, mut y) = (0.0_f64, 0.0_f64);
    let mut direction = 1.0;
    for lace in 0..count {
        let _ = writeln!(text, "(LACE {lace})\nG1 Z{:.3} F300.", -random());
        for _ in 0..40 {
            x += direction * (0.2 + random());
            let z = (x / 9.0).sin() * (y / 7.0).cos() - 2.0 * random() * 0.01;
            let _ = writeln!(text, "X{x:.3} Z{z:.4}");
        }
        // Half a turn to the next lace.
        let code = if direction > 0.0 { 3 } else { 2 };
        y += 0.5;
        let x_rounded = (x * 1000.0).round() / 1000.0;
        x = x_rounded;
        let _ = writeln!(text, "G{code} X{x:.3} Y{y:.3} I0. J0.25 F1200.\nG1");
        direction = -direction;
    }
    text += "G0 Z50.\nM30\n%\n";
    text
}

/// Forty thousand motions under the thesis' transforms: each end within half a step.
#[test]
fn a_long_program_stays_on_its_image() {
    let program = laces(5, 1000);
    let nominal = interpreted(ControlFamily::Fanuc, &program).unwrap();
    assert!(nominal.len() > 40_000);
    for case in [1, 4] {
        let transform = table_4_2(case);
        let (made, summary) = rewritten(&settings(transform, 1.0), &program).unwrap();
        // A hair of tilt leaves the arcs what they are.
        assert_eq!((summary.arcs, summary.chorded), (1000, 0));
        let judge = Judge {
            transform,
            origin: nalgebra::Vector3::zeros(),
            rounding_mm: 0.0005 + 1e-6,
            path_mm: 0.01,
            loose_mm: LOOSE_MM,
        };
        let written = interpreted(ControlFamily::Fanuc, &made).unwrap();
        let compared = judge.moves(&nominal, &written).unwrap();
        assert!(compared.ends > 40_000, "{compared:?}");
    }
}
