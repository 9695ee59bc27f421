//! Labelled words, templates, and what a job may not ask for.

use std::vec;
use std::vec::Vec;

use umi_protocol::fault::{FaultCode, FaultKind, NumberIssue};
use umi_protocol::pattern::{
    BlockPattern, CheckedPattern, FieldFormat, LabelledWordsPattern, LinePattern, Overflow,
    PointLinePattern, ReceiverConfig, RingCsvPattern, Travel,
};

use super::support::*;
use crate::dprnt::{ConfigError, Doubts, LineSplitter, TemplateIssue, check_config};

fn points(pattern: &LinePattern, text: &str) -> Vec<[f64; 3]> {
    run(
        &config(core::slice::from_ref(pattern)),
        format_line(text).as_bytes(),
    )
    .points()
}

fn format_line(text: &str) -> std::string::String {
    std::format!("{text}\n")
}

/// Rule 6: words in any order, glued or apart, with `=` nowhere and nothing else.
#[test]
fn labelled_words() {
    let pattern = words("", "XYZ", "RT");
    for text in [
        "X1.5Y-2.5Z3.",
        "Z 3. Y- 2.5 X+1.50",
        "N10 X1.5 Y-2.5 Z3.0 F100. R.5 T2",
        "*X*1.5*Y-*2.5*Z*3.0*",
        "P7X1.5Y-2.5Z3.0",
    ] {
        assert_eq!(points(&pattern, text), [[1.5, -2.5, 3.0]], "{text}");
    }
    for text in [
        "X1.5Y-2.5",
        "X1.5Y-2.5Z",
        "X1.5Y-2.5Z3.0X1.5",
        "X1.5Y-2.5Z3.0Q1",
        "X1.5Y-2.5Z3.0 4",
        "X1 .5Y-2.5Z3.0",
        "X1.5Y-2.5Z3.0 OK",
        "N1P2X1.5Y-2.5Z3.0",
        "N1.5X1.5Y-2.5Z3.0",
        "x1.5y-2.5z3.0",
        "1.5 X1.5Y-2.5Z3.0",
        "N10 T5",
    ] {
        assert_eq!(points(&pattern, text), Vec::<[f64; 3]>::new(), "{text}");
    }
    let seen = run(&config(&[pattern]), b"N10X1.5Y-2.5Z3.0F100.\n");
    assert_eq!(
        (seen.hits[0].index, seen.hits[0].feed_mm_per_min),
        (Some(10), Some(100.0))
    );
}

/// A prefix must be there, and be the whole word.
#[test]
fn prefix() {
    let pattern = words("G801", "XY", "");
    assert_eq!(points(&pattern, "G801X1.Y2."), [[1.0, 2.0, 0.0]]);
    for text in ["G8011 X1.Y2.", "G800 X1.Y2.", "X1.Y2.", "G801.5X1.Y2."] {
        assert_eq!(points(&pattern, text), Vec::<[f64; 3]>::new(), "{text}");
    }
}

/// A hole in a number is named as such where it is clear what the line was.
#[test]
fn a_hole_in_a_number_is_named() {
    for pattern in [words("", "XYZ", ""), template("X{x} Y{y} Z{z}", None)] {
        let seen = run(&config(&[pattern]), b"X1.5Y-2.5Z3 .25\nX1 5.5Y-2.5Z3.2\n");
        assert_eq!(seen.hits.len(), 0);
        for (fault, position) in seen.faults.iter().zip([13, 4]) {
            let issue = NumberIssue::Surplus;
            assert_eq!(fault.kind, FaultKind::NumberFormat { issue, position });
        }
    }
}

/// Every field of a template.
#[test]
fn template_fields() {
    let pattern = template(
        "PT {i} {name}: X={x} Y={y} Z={z} T{touched} F{feed} ID/{skip}/E",
        None,
    );
    let config = config(&[pattern]);
    let seen = run(
        &config,
        b"PT   3 BORE-2:X=- 12.500 Y= 7.250 Z=.5 T1 F 250.5 ID/NC-1 2 3.4/E\n",
    );
    let hit = &seen.hits[0];
    assert_eq!(hit.position.to_array_mm(), [-12.5, 7.25, 0.5]);
    assert_eq!(
        (hit.index, hit.feature.as_deref()),
        (Some(3), Some("BORE-2"))
    );
    assert_eq!(
        (hit.touched, hit.feed_mm_per_min),
        (Some(true), Some(250.5))
    );
    let seen = run(
        &config,
        b"PT   3 BORE-2:X=- 12.500 Y= 7.250 Z=.5 T0 F 250.5 ID//E\n",
    );
    assert_eq!(
        (seen.hits.len(), seen.codes()),
        (0, vec![FaultCode::NotTouched])
    );
}

/// What a template does not say is not accepted.
#[test]
fn template_refuses() {
    let pattern = template("PT {i} X={x} Y={y}", None);
    assert_eq!(points(&pattern, "  PT 3 X=1.5 Y=2.5  "), [[1.5, 2.5, 0.0]]);
    for text in [
        "PT 3 X=1.5 Y=2.5 Z=3.5",
        "PT 3 X=1.5 Y=",
        "PT X=1.5 Y=2.5",
        "PT 3 X=1.5",
        "PT 3.5 X=1.5 Y=2.5",
        "A PT 3 X=1.5 Y=2.5",
        "PT 3 X=1.5 Y=2.5.5",
    ] {
        assert_eq!(points(&pattern, text), Vec::<[f64; 3]>::new(), "{text}");
    }
    let named = template("{name} {x} {y}", None);
    assert_eq!(points(&named, "A1 1.5 2.5"), [[1.5, 2.5, 0.0]]);
    assert_eq!(
        points(&named, "ABCDEFGHIJKLMNOPQ 1.5 2.5"),
        Vec::<[f64; 3]>::new()
    );
}

/// A declared format is held in templates and words too.
#[test]
fn declared_formats_are_held() {
    for pattern in [
        template("X{x} Y{y}", Some(FieldFormat::F53)),
        LinePattern::LabelledWords(LabelledWordsPattern {
            axes: "XY".try_into().unwrap(),
            format: Some(FieldFormat::F53),
            ..LabelledWordsPattern::default()
        }),
    ] {
        assert_eq!(points(&pattern, "X1.500 Y2.500").len(), 1);
        let seen = run(&config(&[pattern]), b"X1.500 Y2.50\n");
        let issue = NumberIssue::Decimals {
            expected: 3,
            got: 2,
        };
        assert_eq!(
            seen.faults[0].kind,
            FaultKind::NumberFormat { issue, position: 9 }
        );
    }
}

/// A line of the thesis' `POINT:` form, glued and padded; anything else after
/// the label is named.
#[test]
fn point_lines() {
    let pattern = point_line();
    for text in [
        "POINT: -135.5105 -136.3415 72.0620",
        "POINT:-135.5105-136.3415 72.0620",
        "POINT:*-*135.5105*-*136.3415***72.0620*",
    ] {
        assert_eq!(
            points(&pattern, text),
            [[-135.5105, -136.3415, 72.062]],
            "{text}"
        );
    }
    let config = config(&[pattern]);
    for text in [
        "POINT: -135.5105 -136.3415",
        "POINT: OK",
        "POINT: 1.0000 2.0000 3.0000 4.0000",
    ] {
        let seen = run(&config, format_line(text).as_bytes());
        assert_eq!(seen.codes(), [FaultCode::NumberFormat], "{text}");
    }
}

/// GRBL with more axes, in inches, and damaged.
#[test]
fn grbl_lines() {
    let pattern = LinePattern::GrblProbe;
    assert_eq!(
        points(&pattern, "[PRB:1.000,2.000,3.000,4.000:1]"),
        [[1.0, 2.0, 3.0]]
    );
    assert_eq!(
        points(&pattern, "[PRB:1.0000,2.0000,-3.0000:1]"),
        [[1.0, 2.0, -3.0]]
    );
    let config = config(&[pattern]);
    for text in [
        "[PRB:1.000,2.000:1]",
        "[PRB:1.000,2.00,3.000:1]",
        "[PRB:1.000,2.000,3.000:2]",
        "[PRB:1.000,2.000,3.000:1",
        "[PRB:1.000,2.000,3.000]",
        "[PRB:1.000,2.000,3.000:1]]",
        "[PRB:1,2,3:1]",
    ] {
        let seen = run(&config, format_line(text).as_bytes());
        assert_eq!(
            (seen.hits.len(), seen.codes()),
            (0, vec![FaultCode::NumberFormat]),
            "{text}"
        );
    }
}

/// Rule 2 against a search over all values that print the same.
#[test]
fn overflow_rule_is_that_of_the_search() {
    let format = |integer_digits| FieldFormat {
        integer_digits,
        decimals: 1,
        overflow: Overflow::DropsDigits,
    };
    for (least, most) in [
        (-250.0, 250.0),
        (0.0, 99.9),
        (-450.0, -5.0),
        (120.0, 340.0),
        (-99.9, 1000.0),
    ] {
        for digits in 1..=3u8 {
            let axis = [least, most];
            let travel = Travel {
                x: axis,
                y: axis,
                z: axis,
            };
            let pattern = template("{x} {y}", Some(format(digits)));
            let config = ReceiverConfig {
                travel_mm: Some(travel),
                ..config(&[pattern])
            };
            let step = 10f64.powi(digits.into());
            for tenths in (0..10u32.pow(u32::from(digits) + 1)).step_by(37) {
                for sign in ["-", ""] {
                    let text = std::format!("{sign}{}.{}", tenths / 10, tenths % 10);
                    let value: f64 = text.parse().unwrap();
                    let side = if sign == "-" { -1.0 } else { 1.0 };
                    let expected = (1..2000)
                        .map(|k| side * (value.abs() + f64::from(k) * step))
                        .any(|other| (least..=most).contains(&other));
                    let line = std::format!("{text} {text}\n");
                    let seen = run(&config, line.as_bytes());
                    let doubts = seen.hits[0].doubts;
                    let case = std::format!("{text} in [{digits}1], {least}..{most}");
                    assert_eq!(
                        doubts.contains(Doubts::OVERFLOW_SUSPECT),
                        expected,
                        "{case}"
                    );
                    let outside = !(least..=most).contains(&value);
                    assert_eq!(doubts.contains(Doubts::OUTSIDE_TRAVEL), outside, "{case}");
                }
            }
        }
    }
}

/// A control that widens its fields drops no digits (Haas): nothing is suspect,
/// and more digits than declared are in order.
#[test]
fn expanding_fields_are_not_suspect() {
    let format = FieldFormat {
        overflow: Overflow::Expands,
        ..FieldFormat::F44
    };
    let config = config(&[template("X{x} Y{y}", Some(format))]);
    let seen = run(&config, b"X-12345.6789 Y1234.5678\n");
    assert_eq!(
        (seen.points(), seen.codes()),
        (vec![[-12_345.678_9, 1234.5678, 0.0]], vec![])
    );
}

fn refused(pattern: LinePattern) -> ConfigError {
    let config = ReceiverConfig {
        patterns: core::iter::once(pattern).collect(),
        ..ReceiverConfig::default()
    };
    let error = check_config(&config).unwrap_err();
    // Refused or not, it must do no harm.
    let _ = run_unchecked(
        &config,
        b"X1.Y2.Z3.\nSPHERE1\n1\n1. 2. 3.\nIndex,X,Y\n1,1.,2.\n",
    );
    error
}

fn run_unchecked(config: &ReceiverConfig, bytes: &[u8]) -> usize {
    let mut receiver = LineSplitter::new(config);
    let mut items = 0;
    receiver.receive(bytes, crate::units::Micros(0), &mut |_| items += 1);
    items
}

/// What a job may not ask for, by name.
#[test]
fn bad_configurations() {
    assert_eq!(
        check_config(&ReceiverConfig::default()),
        Err(ConfigError::NoPatterns)
    );
    let base = config(&[block()]);
    let no_timeout = ReceiverConfig {
        idle_timeout_s: 0,
        ..base.clone()
    };
    assert_eq!(check_config(&no_timeout), Err(ConfigError::NoTimeout));
    for bad in [
        [1.0, 1.0],
        [2.0, 1.0],
        [f64::NAN, 1.0],
        [0.0, f64::INFINITY],
    ] {
        let travel = Travel {
            x: [0.0, 1.0],
            y: bad,
            z: [0.0, 1.0],
        };
        let config = ReceiverConfig {
            travel_mm: Some(travel),
            ..base.clone()
        };
        assert_eq!(check_config(&config), Err(ConfigError::Travel { axis: 1 }));
    }
    let format = |integer_digits, decimals| FieldFormat {
        integer_digits,
        decimals,
        overflow: Overflow::DropsDigits,
    };
    let pattern = 1;
    for bad in [format(0, 0), format(9, 7)] {
        let block = BlockPattern {
            format: bad,
            ..BlockPattern::default()
        };
        assert_eq!(
            refused(LinePattern::Block(block)),
            ConfigError::Format { pattern }
        );
    }
    let five = CheckedPattern {
        format: format(3, 5),
    };
    assert_eq!(
        refused(LinePattern::Checked(five)),
        ConfigError::Format { pattern }
    );
    for bad in [&[][..], &[""], &["1A"], &["A B"]] {
        let headers = bad.iter().map(|h| (*h).try_into().unwrap()).collect();
        let block = BlockPattern {
            headers,
            ..BlockPattern::default()
        };
        assert_eq!(
            refused(LinePattern::Block(block)),
            ConfigError::Header { pattern }
        );
    }
    let table = RingCsvPattern {
        rows: 0,
        ..RingCsvPattern::default()
    };
    assert_eq!(
        refused(LinePattern::RingCsv(table)),
        ConfigError::Table { pattern }
    );
    let line = PointLinePattern {
        label: " ".try_into().unwrap(),
        ..PointLinePattern::default()
    };
    assert_eq!(
        refused(LinePattern::PointLine(line)),
        ConfigError::Label { pattern }
    );
    for bad in ["", "XX", "AB", "x"] {
        assert_eq!(refused(words("", bad, "")), ConfigError::Axes { pattern });
    }
    for bad in ["X", "F", "a", "1"] {
        assert_eq!(
            refused(words("", "XYZ", bad)),
            ConfigError::Ignored { pattern }
        );
    }
}

/// Templates that nothing could be read with, or too much.
#[test]
fn bad_templates() {
    for (text, issue) in [
        ("{x} {y", TemplateIssue::Brace),
        ("{x} {y} }", TemplateIssue::Brace),
        ("{x} {y} {w}", TemplateIssue::UnknownField),
        ("{x} {y} {x}", TemplateIssue::FieldTwice),
        ("{x} OK", TemplateIssue::Coordinates),
        ("X{x} {skip} Y{y}", TemplateIssue::NoEnd),
        ("X{x} Y{y} R{skip}{z}", TemplateIssue::NoEnd),
        ("{name}{x} {y}", TemplateIssue::NoEnd),
        ("{name}X{x} {y}", TemplateIssue::NoEnd),
        ("X{x} Y{y} \u{e9}", TemplateIssue::Character),
    ] {
        assert_eq!(
            refused(template(text, None)),
            ConfigError::Template { pattern: 1, issue },
            "{text}"
        );
    }
    for good in [
        "{name} X{x}{y}{z}",
        "{skip}X{x}Y{y}R{skip}S{skip}",
        "{i}{x}{y}",
        "{name}:{x} {y}",
    ] {
        config(&[template(good, None)]);
    }
}

/// A job file needs to say only what differs from the usual.
#[test]
fn defaults_of_a_job_file() {
    let json = r#"{"patterns": [
        {"block": {}}, {"point_line": {}}, "grbl_probe",
        {"labelled_words": {"prefix": "G801", "format": {"integer_digits": 5, "decimals": 3}}}
    ]}"#;
    let read: ReceiverConfig = serde_json::from_str(json).unwrap();
    let words = LabelledWordsPattern {
        prefix: "G801".try_into().unwrap(),
        format: Some(FieldFormat::F53),
        ..LabelledWordsPattern::default()
    };
    let patterns = [
        block(),
        point_line(),
        LinePattern::GrblProbe,
        LinePattern::LabelledWords(words),
    ];
    assert_eq!(read, config(&patterns));
    let unknown = r#"{"patterns": ["grbl_probe"], "baud": 9600}"#;
    assert!(serde_json::from_str::<ReceiverConfig>(unknown).is_err());
}

/// The receiver is small enough for a board with 16 KB of memory.
#[test]
fn size() {
    let size = size_of::<LineSplitter>();
    assert!(size < 2048, "{size}");
}
