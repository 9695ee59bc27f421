//! Blocks and tables.

use std::string::{String, ToString as _};
use std::vec;
use std::vec::Vec;
use std::{format, fs};

use umi_protocol::fault::{BlockEndCause, FaultCode, FaultKind, NumberIssue};
use umi_protocol::line::LineStatus::{Damaged, NotUnderstood};
use umi_protocol::pattern::{BlockPattern, LinePattern, RingCsvPattern};

use super::support::*;

const POINTS: [&str; 3] = [
    " -135.0190 -136.6200 148.6090",
    "*-122.3130*-136.6200*135.9090",
    " - 147.7270 - 136.6190   135.9090",
];

fn sphere(name: &str, count: &str, points: &[&str]) -> String {
    let mut text = format!("{name}\n***\n{count}\n");
    for point in points {
        text.push_str(point);
        text.push('\n');
    }
    text.push_str("***\n");
    text
}

fn with_block(text: &str) -> Seen {
    run(&config(&[block()]), text.as_bytes())
}

/// The sessions of the reference data: every block, every point as computed
/// there, no fault.
#[test]
fn reference_sessions() {
    for session in ["session_a", "session_b"] {
        let path = format!(
            "{}/../../tests/reference/sessions/{session}",
            env!("CARGO_MANIFEST_DIR")
        );
        let answers: serde_json::Value =
            serde_json::from_str(&fs::read_to_string(format!("{path}.json")).unwrap()).unwrap();
        let blocks = answers["blocks"].as_array().unwrap();
        let seen = run(
            &config(&[block()]),
            &fs::read(format!("{path}.txt")).unwrap(),
        );
        assert_eq!(seen.ends.len(), blocks.len());
        let mut points = seen.points().into_iter();
        for (end, answer) in seen.ends.iter().zip(blocks) {
            assert!(end.complete);
            assert_eq!(end.name.as_str(), answer["name"].as_str().unwrap());
            for expected in answer["points"].as_array().unwrap() {
                let expected: Vec<f64> = expected
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(|c| c.as_f64().unwrap())
                    .collect();
                assert_eq!(points.next().unwrap().as_slice(), expected);
            }
        }
        assert_eq!((points.next(), seen.codes()), (None, vec![]));
    }
}

/// Points carry the block's name and their place; the block ends with its last
/// point, complete.
#[test]
fn block_with_its_points() {
    let seen = with_block(&sphere("SPHERE1", "3", &POINTS));
    assert_eq!(seen.starts, ["SPHERE1"]);
    let places: Vec<_> = seen.hits.iter().map(|hit| hit.index.unwrap()).collect();
    assert_eq!(places, [1, 2, 3]);
    assert!(
        seen.hits
            .iter()
            .all(|hit| hit.feature.as_deref() == Some("SPHERE1"))
    );
    assert_eq!(seen.points()[2], [-147.727, -136.619, 135.909]);
    let end = &seen.ends[0];
    assert_eq!(
        (end.expected, end.got, end.damaged, end.complete),
        (Some(3), 3, 0, true)
    );
    assert_eq!(end.ended_by, BlockEndCause::Count);
    assert_eq!(seen.codes(), []);
}

/// Separators are not needed, and do not matter where they are.
#[test]
fn separators_do_not_matter() {
    let plain = format!("SPHERE1\n3\n{}\n", POINTS.join("\n"));
    let many = format!(
        "***\n\nSPHERE1\n\n ***\n  3\n***\n{}\n\n***\n***\n",
        POINTS.join("\n * \n")
    );
    for text in [plain, many] {
        let seen = with_block(&text);
        assert!(seen.ends[0].complete, "{text}");
        assert_eq!((seen.hits.len(), seen.codes()), (3, vec![]));
    }
}

/// Headers are the job's words, alone or with a number; other lines are not.
#[test]
fn headers() {
    let pattern = BlockPattern {
        headers: ["SPHERE", "BORE-A"]
            .into_iter()
            .map(|h| h.try_into().unwrap())
            .collect(),
        ..BlockPattern::default()
    };
    let config = config(&[LinePattern::Block(pattern)]);
    let headers = |text: &str| run(&config, text.as_bytes()).starts;
    assert_eq!(
        headers("SPHERE\nSPHERE12\nBORE-A\n  BORE-A7  \n"),
        ["SPHERE", "SPHERE12", "BORE-A", "BORE-A7"]
    );
    assert_eq!(
        headers("SPHERES\nSPHERE 1\nBORE\nsphere1\nSPHERE-1\nASPHERE1\n"),
        [""; 0]
    );
    assert_eq!(
        headers("SPHERE12345678901\n"),
        [""; 0],
        "longer than a name can be"
    );
}

/// A damaged point keeps its place: the others are not shifted, the block is
/// incomplete and says why.
#[test]
fn damaged_point_keeps_its_place() {
    let mut bytes = iso(sphere("SPHERE1", "3", &POINTS).as_bytes());
    let second = bytes.iter().position(|b| *b == 0xAA).unwrap() + 40;
    bytes[second + 14] ^= 0x02;
    let seen = run(&config(&[block()]), &bytes);
    assert_eq!(seen.statuses().iter().filter(|s| **s == Damaged).count(), 1);
    let places: Vec<_> = seen.hits.iter().map(|hit| hit.index.unwrap()).collect();
    assert_eq!(places.len(), 2);
    assert!(places.contains(&3));
    let end = &seen.ends[0];
    assert_eq!((end.got, end.damaged, end.complete), (2, 1, false));
    assert_eq!(end.ended_by, BlockEndCause::Count);
    assert_eq!(
        seen.codes(),
        [FaultCode::BadParity, FaultCode::BlockIncomplete]
    );
    assert_eq!(seen.faults[1].text.as_str(), "SPHERE1");
}

/// A number with a lost digit, a hole where a digit was, or too few numbers is
/// a bad line at its place.
#[test]
fn wrong_numbers_in_a_block() {
    let surplus = NumberIssue::Surplus;
    let decimals = |got| NumberIssue::Decimals { expected: 4, got };
    for (line, issue) in [
        (" -135.019 -136.6200 148.6090", decimals(3)),
        (" -135.0190 -136.6200 148.60900", decimals(5)),
        (" -1 5.0190 -136.6200 148.6090", surplus),
        (" -135. 190 -136.6200 148.6090", surplus),
        (" -135.0190 -136.6200148.6090", surplus),
        (" -135.0190 -136.6200", NumberIssue::Missing),
        (" -135.0190 -136.6200 - ", NumberIssue::Missing),
        (
            " -135.0190 -13666.6200 148.6090",
            NumberIssue::IntegerDigits {
                expected: 4,
                got: 5,
            },
        ),
    ] {
        let seen = with_block(&sphere("SPHERE1", "2", &[line, POINTS[1]]));
        let FaultKind::NumberFormat { issue: found, .. } = seen.faults[0].kind else {
            panic!("{line}: {:?}", seen.faults);
        };
        assert_eq!(found, issue, "{line}");
        assert_eq!(seen.hits.len(), 1);
        assert_eq!(
            (seen.hits[0].index, seen.ends[0].complete),
            (Some(2), false)
        );
    }
}

/// Other text inside a block stands where a point was due.
#[test]
fn other_text_inside_a_block() {
    let seen = with_block(&sphere(
        "SPHERE1",
        "3",
        &[POINTS[0], "TOOL CHECK", POINTS[2]],
    ));
    assert!(seen.statuses().contains(&NotUnderstood));
    assert_eq!(seen.hits[1].index, Some(3));
    assert!(!seen.ends[0].complete);
}

/// A block is broken by another header, by closing and opening the port, by
/// silence and by the end of the input. Each says so.
#[test]
fn broken_blocks() {
    let open = format!("SPHERE1\n3\n{}\n{}\n", POINTS[0], POINTS[1]);
    for (rest, cause) in [
        (&b"SPHERE2\n"[..], BlockEndCause::NewHeader),
        (b"\x14", BlockEndCause::PortClosed),
        (b"\x12", BlockEndCause::PortOpened),
        (b"\x03\n", BlockEndCause::PortClosed),
        (b"", BlockEndCause::EndOfInput),
    ] {
        let seen = run(&config(&[block()]), &joined(&[open.as_bytes(), rest]));
        let end = &seen.ends[0];
        assert_eq!((end.ended_by, end.got, end.complete), (cause, 2, false));
        assert_eq!(seen.codes()[0], FaultCode::BlockIncomplete);
    }
    let seen = run_pieces(
        &config(&[block()]),
        &[(0, open.as_bytes()), (120_000, b"\n")],
    );
    assert_eq!(seen.ends[0].ended_by, BlockEndCause::Timeout);
    // The marks have the parity of the code.
    for (mark, cause) in [
        (b"\x14", BlockEndCause::PortClosed),
        (b"\x12", BlockEndCause::PortOpened),
    ] {
        for encode in [iso, odd] {
            let bytes = [
                encode(open.as_bytes()),
                encode(mark),
                encode(POINTS[2].as_bytes()),
            ];
            let seen = run(&config(&[block()]), &bytes.concat());
            assert_eq!((seen.ends[0].ended_by, seen.hits.len()), (cause, 2));
        }
    }
}

/// A macro that opens and closes the port for every line, where the job says so.
#[test]
fn block_across_sessions() {
    let text = sphere("SPHERE1", "3", &POINTS);
    let wrapped = format!("\x12{}\x14", text.replace('\n', "\n\x14\x12"));
    let pattern = BlockPattern {
        spans_sessions: true,
        ..BlockPattern::default()
    };
    let seen = run(&config(&[LinePattern::Block(pattern)]), wrapped.as_bytes());
    assert_eq!((seen.hits.len(), seen.codes()), (3, vec![]));
    let seen = run(&config(&[block()]), wrapped.as_bytes());
    assert_eq!(seen.hits.len(), 0);
}

/// More points than announced are named, and are no hits.
#[test]
fn too_many_points() {
    let seen = with_block(&sphere("SPHERE1", "2", &POINTS));
    assert_eq!((seen.hits.len(), seen.ends.len()), (2, 1));
    assert_eq!(
        seen.faults[0].kind,
        FaultKind::BlockCountMismatch {
            expected: 2,
            got: 3
        }
    );
}

/// Points behind a header that was lost or misspelt belong to nothing: they are
/// not held against the good block before it.
#[test]
fn points_behind_a_lost_header() {
    let text = sphere("SPHERE1", "2", &POINTS[..2]) + &sphere("SPHRE2", "2", &POINTS[..2]);
    let seen = with_block(&text);
    assert!(seen.ends[0].complete);
    assert_eq!((seen.hits.len(), seen.ends.len()), (2, 1));
    // Header, count and both points.
    assert_eq!(seen.codes(), [FaultCode::NotUnderstood; 4]);
}

/// Without a good count line the points are reported, but nothing is complete.
#[test]
fn count_line_missing_or_damaged() {
    let missing = format!("SPHERE1\n***\n{}\nSPHERE2\n", POINTS.join("\n"));
    let seen = with_block(&missing);
    assert_eq!(
        (
            seen.hits.len(),
            seen.ends[0].expected,
            seen.ends[0].complete
        ),
        (3, None, false)
    );

    let mut bytes = iso(sphere("SPHERE1", "3", &POINTS).as_bytes());
    bytes[12] ^= 0x01;
    let seen = run(&config(&[block()]), &bytes);
    assert_eq!(
        (
            seen.hits.len(),
            seen.ends[0].expected,
            seen.ends[0].complete
        ),
        (3, None, false)
    );

    // A damaged separator is no harm: all points are there.
    let mut bytes = iso(sphere("SPHERE1", "3", &POINTS).as_bytes());
    bytes[9] ^= 0x01;
    let seen = run(&config(&[block()]), &bytes);
    assert!(seen.ends[0].complete);
    assert_eq!(seen.codes(), [FaultCode::BadParity]);

    let seen = with_block("SPHERE1\n0\n");
    assert_eq!(
        seen.codes(),
        [FaultCode::NumberFormat, FaultCode::BlockIncomplete]
    );
}

/// Points without a header belong to nothing.
#[test]
fn points_without_header() {
    let seen = with_block(&format!("3\n{}\n", POINTS.join("\n")));
    assert_eq!(seen.hits.len(), 0);
    assert_eq!(seen.statuses(), [NotUnderstood; 4]);
}

fn ring(rows: u16) -> LinePattern {
    LinePattern::RingCsv(RingCsvPattern {
        rows,
        z_mm: -12.5,
        ..RingCsvPattern::default()
    })
}

fn row(i: u16) -> String {
    format!(
        "{i},{}{i}.5000, -{i}.2500",
        if i.is_multiple_of(2) { "- " } else { "" }
    )
}

/// The ring gauge table of the thesis, appendix C: the port is opened and closed
/// for every row.
#[test]
fn ring_gauge_table() {
    let mut text = String::from("\x12Index,X,Y\n\x14");
    for i in 1..=36 {
        text += &format!("\x12{}\n\x14", row(i));
    }
    let seen = run(&config(&[ring(36)]), text.as_bytes());
    assert_eq!(
        (seen.starts.as_slice(), seen.hits.len()),
        (&["RING".to_string()][..], 36)
    );
    assert_eq!(seen.points()[35], [-36.5, -36.25, -12.5]);
    assert_eq!(
        (seen.hits[35].index, seen.hits[35].digits[2]),
        (Some(36), None)
    );
    assert!(seen.ends[0].complete);
    assert_eq!(seen.codes(), []);
}

/// Rows that are missing, come twice, are too many or come without the header.
#[test]
fn ring_gauge_faults() {
    let table = |rows: &[u16]| {
        let rows: Vec<_> = rows.iter().map(|i| row(*i)).collect();
        run(
            &config(&[ring(3)]),
            format!("INDEX, X, Y\n{}\n", rows.join("\n")).as_bytes(),
        )
    };
    let seen = table(&[1, 3]);
    assert_eq!(seen.faults[0].kind, FaultKind::RowGap { from: 2, to: 2 });
    assert_eq!(
        (seen.hits[1].index, seen.ends[0].complete),
        (Some(3), false)
    );

    let seen = table(&[1, 2, 2, 3]);
    assert_eq!(seen.faults[0].kind, FaultKind::RowRepeated { row: 2 });
    assert_eq!((seen.hits.len(), seen.ends[0].complete), (3, false));

    let seen = table(&[1, 2, 3, 4]);
    assert!(seen.ends[0].complete);
    assert_eq!(
        seen.faults[0].kind,
        FaultKind::BlockCountMismatch {
            expected: 3,
            got: 4
        }
    );

    let seen = run(&config(&[ring(3)]), row(1).as_bytes());
    assert_eq!(
        (seen.hits.len(), seen.codes()),
        (0, vec![FaultCode::LineUnterminated])
    );

    let wrong = "Index,X,Y\n1,1.5000\n2,1.5000,2.5000,3.5000\n3,1.50 0,2.5000\n";
    let seen = run(&config(&[ring(3)]), wrong.as_bytes());
    assert_eq!(seen.codes()[..3], [FaultCode::NumberFormat; 3]);
    assert_eq!(seen.hits.len(), 0);
}

/// Patterns are tried in the order of the job; lines of one may stand between
/// those of another.
#[test]
fn several_patterns() {
    let config = config(&[block(), point_line(), words("", "XYZ", "")]);
    let text = format!(
        "SPHERE1\n2\n{}\nPOINT: 1.0000 2.0000 3.0000\nX1.Y2.Z3.\n{}\n",
        POINTS[0], POINTS[1]
    );
    let seen = run(&config, text.as_bytes());
    assert_eq!((seen.hits.len(), seen.codes()), (4, vec![]));
    assert!(seen.ends[0].complete);
    let features: Vec<_> = seen.hits.iter().map(|hit| hit.feature.is_some()).collect();
    assert_eq!(features, [true, false, false, true]);
}
