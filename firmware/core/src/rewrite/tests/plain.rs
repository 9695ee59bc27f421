//! Blocks that are plain come out as they would if they were not.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use proptest::prelude::*;

use super::super::{Integers, RewriteSettings, Rewriter, Unit};
use super::{level, rewritten, settings, turned};
use crate::rewrite::text::emit::Out;

/// A program that is behind its first motion, every mode said and every place known.
const BEGUN: &str = "G21 G90 G17 G94\nG0 X0. Y0. Z0.\nG1 F100.\nX1.\n";

/// Whether a block is taken for plain behind some others.
fn is_plain(before: &str, block: &str) -> bool {
    let mut rewriter = Rewriter::new(&settings(turned([0.1, 0.2, 30.0], [1.0; 3]))).unwrap();
    rewriter.push(before.as_bytes(), &mut |_| {}).unwrap();
    let mut sink = |_: &[u8]| {};
    rewriter.plain(block.as_bytes(), &mut Out::new(&mut sink))
}

/// What long programs are made of is plain; what any mode or other word has a part in is not.
#[test]
fn plain_is_what_nothing_else_has_a_part_in() {
    for block in [
        "X1.",
        "N10 G1 X-25.399 Y35.004 Z-1.5 F1000.0",
        "N7G00X.5Y-3.Z2",
        "Y2 F5",
        "  G01   Z-0.  ",
    ] {
        assert!(is_plain(BEGUN, block), "{block}");
    }
    for block in [
        "",
        "N10",
        "G1",
        "G1 F100.",
        "G2 X1. I1.",
        "X1. ()",
        "x1.",
        "X1. Y",
        "X 1.",
        "X+1.",
        "Y1. X1.",
        "X1. X2.",
        "F1. X1.",
        "G1.0 X1.",
        "G-1 X1.",
        "G1 G1 X1.",
        "X1..",
        "X1. A0.",
        "X#1",
        "/X1.",
        "X1. M8",
        "X200000.",
        "X1;",
        "%",
        "X1.2345678901234567890",
    ] {
        assert!(!is_plain(BEGUN, block), "{block}");
    }
    for more in [
        "G91\n",
        "G93\n",
        "G2\n",
        "G28\n",
        "G55\n",
        "G98 G81 X5. Y5. Z-5. R-2.\n",
        "G91 G28 X0.\nG90\n",
    ] {
        assert!(!is_plain(&format!("{BEGUN}{more}"), "X1."), "{more}");
    }
    // Nothing is known, nor has the header been written.
    assert!(!is_plain("", "X1."));
    assert!(!is_plain("G21 G90\nG0 X0. Y0.\n", "X1."));
}

/// Numbers as programs have them: few digits, many, none before or behind the point.
fn number() -> impl Strategy<Value = String> {
    prop_oneof![
        (-999_999_i64..999_999, 0_usize..5).prop_map(|(n, d)| format!("{:.d$}", n as f64 / 1e3)),
        (-999_i64..999).prop_map(|n| format!("{n}.")),
        (0_u32..9999).prop_map(|n| format!(".{n}")),
        "-?0{0,20}[0-9]{1,3}\\.[0-9]{0,12}",
    ]
}

/// A block of some of N, G0 or G1, X, Y, Z, F, in this order or nearly.
fn block() -> impl Strategy<Value = String> {
    let word = |letter: &'static str| {
        prop::option::of(number().prop_map(move |n| letter.to_string() + &n))
    };
    let g = prop::option::of("G0?[01]");
    let n = prop::option::of("N[0-9]{1,5}");
    let words = (
        n,
        g,
        word("X"),
        word("Y"),
        word("Z"),
        prop::option::of("F[1-9]0{0,3}\\.?"),
    );
    (words, any::<bool>(), 0_usize..12).prop_map(|((n, g, x, y, z, f), spaced, swapped)| {
        let mut words: Vec<String> = [n, g, x, y, z, f].into_iter().flatten().collect();
        if swapped + 1 < words.len() {
            words.swap(swapped, swapped + 1);
        }
        words.join(if spaced { " " } else { "" })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    /// A block with an empty comment behind it is not plain: it goes the other way, and comes
    /// out the same, comment aside; or is refused for the same reason.
    #[test]
    fn plain_or_not_the_same_comes_out(
        blocks in prop::collection::vec(block(), 1..12),
        tilted: bool,
        is_inch: bool,
        decimals_mm in 1_u8..=6,
    ) {
        let transform = if tilted {
            turned([0.3, -0.2, 30.0], [5.0, -7.5, 0.25])
        } else {
            level(90.0, [0.0, 0.5, 0.0])
        };
        let settings = RewriteSettings {
            decimals_mm,
            chord: crate::units::Mm(1.0),
            unit: Some(if is_inch { Unit::Inch } else { Unit::Millimetre }),
            integers: Some(Integers::Steps),
            ..settings(transform)
        };
        let begin = "G90\nG0 X0. Y0. Z0.\n";
        let plain = rewritten(&settings, &format!("{begin}{}\n", blocks.join("\n")));
        let other = rewritten(&settings, &format!("{begin}{}()\n", blocks.join("()\n")));
        let other = other.map(|(text, summary)| (text.replace("()", ""), summary));
        prop_assert_eq!(plain, other);
    }
}
