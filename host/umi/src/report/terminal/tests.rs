//! The terminal table: plain where it must be, narrow, and complete.

use super::*;
use crate::report::sample;

/// Colour only where it was asked for, and no line of a good plate wider
/// than the terminal.
#[test]
fn plain_text_is_plain_and_narrow() {
    let good = sample::good();
    let text = session(&good, false) + &summary(&good, false);
    assert!(!text.contains('\x1b'));
    for line in text.lines() {
        assert!(
            line.chars().count() <= WIDTH,
            "{}: {line}",
            line.chars().count()
        );
    }
    assert!(session(&good, true).contains("\x1b[1;32mOK\x1b[0m"));
}

/// The figures of a case: radius error, s, s/2, turn, verdict; and every
/// reason of an NG one.
#[test]
fn a_case_says_what_it_must() {
    let good = sample::good();
    let text = plate(&good, 1, false);
    for part in [
        "+13.8",
        "13.5",
        "turn +0.99991\u{b0}",
        "rms 0.6 \u{b5}m",
        "path 1.7",
        "OK",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let spoilt = sample::spoilt();
    for (place, p) in spoilt.plates.iter().enumerate() {
        let text = plate(&spoilt, place, false);
        for reason in &p.verdict.reasons {
            assert!(text.contains(&reason.to_string()), "{text}");
        }
        assert!(text.contains(if p.verdict.ok { "OK" } else { "NG" }));
    }
    assert_eq!(plate(&good, 99, false), "");
}
