//! The terminal table: plain where it must be, narrow, and complete.

use super::*;
use crate::sample;

/// Colour only where it was asked for, and no line of a good setup wider
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
    let coloured = crate::terminal::ink::shown(&session(&good, true));
    assert!(coloured.contains("\x1b[1;32mOK\x1b[0m"));
}

/// A column of which nothing is known is left out: without true poses nobody knows the errors
/// of the path.
#[test]
fn a_summary_has_no_empty_column() {
    let mut session = sample::good();
    assert!(summary(&session, false).contains("path error"));
    for setup in &mut session.setups {
        setup.truth = None;
    }
    let text = summary(&session, false);
    assert!(
        !text.contains("path error") && !text.contains("corrected"),
        "{text}"
    );
    assert!(text.contains("reg. rms"), "{text}");
    for row in text.lines().skip(2) {
        assert!(!row.contains(" - "), "{text}");
    }
    session.setups.clear();
    assert_eq!(summary(&session, false), "");
}

/// The figures of a case: radius error, s, s/2, turn, verdict; and every
/// reason of an NG one.
#[test]
fn a_case_says_what_it_must() {
    let good = sample::good();
    let text = setup(&good, 1, false);
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
    for (place, p) in spoilt.setups.iter().enumerate() {
        let text = setup(&spoilt, place, false);
        for reason in &p.verdict.reasons {
            assert!(text.contains(&reason.to_string()), "{text}");
        }
        assert!(text.contains(if p.verdict.ok { "OK" } else { "NG" }));
    }
    assert_eq!(setup(&good, 99, false), "");
}
