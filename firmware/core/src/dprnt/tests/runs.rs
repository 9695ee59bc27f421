//! Runs of checked lines.

use std::format;
use std::string::String;
use std::vec;
use std::vec::Vec;

use umi_protocol::fault::{FaultCode, FaultKind};
use umi_protocol::job::Approach;
use umi_protocol::line::LineStatus::{Damaged, Matched};

use super::support::*;
use crate::dprnt::line::checked::CheckedLine;

fn line(run: u32, sequence: u32) -> CheckedLine {
    CheckedLine {
        run,
        sequence,
        feature: 2,
        approach: Some(Approach::MinusZ),
        touched: true,
        feed_um_per_min: 20_000,
        point_um: [-135_019, -136_620, 148_609],
    }
}

fn with_lines(lines: &[CheckedLine]) -> Seen {
    let text: String = lines.iter().map(|line| format!("{line}\r\n")).collect();
    run(&config(&[checked()]), text.as_bytes())
}

/// A checked line gives a hit with everything it says.
#[test]
fn checked_line() {
    let seen = with_lines(&[line(17, 1)]);
    let hit = &seen.hits[0];
    assert_eq!(seen.points(), [[-135.019, -136.62, 148.609]]);
    assert_eq!(
        (hit.run, hit.sequence, hit.feature_id),
        (Some(17), Some(1), Some(2))
    );
    assert_eq!(
        (hit.approach, hit.touched),
        (Some(Approach::MinusZ), Some(true))
    );
    assert_eq!((hit.feed_mm_per_min, seen.codes()), (Some(20.0), vec![]));
}

/// Rule 10: lines come again after a restart. Each counts once; what
/// is missing is named, and what contradicts.
#[test]
fn gaps_and_repeats() {
    let seen = with_lines(&[line(1, 1), line(1, 2), line(1, 1), line(1, 2), line(1, 3)]);
    assert_eq!(
        (seen.hits.len(), seen.codes()),
        (3, vec![FaultCode::Repeat; 2])
    );

    let seen = with_lines(&[line(1, 1), line(1, 4), line(2, 1)]);
    assert_eq!(
        seen.faults[0].kind,
        FaultKind::Gap {
            run: 1,
            from: 2,
            to: 3
        }
    );
    assert_eq!((seen.hits.len(), seen.faults.len()), (3, 1));

    let other = CheckedLine {
        point_um: [1, 2, 3],
        ..line(1, 1)
    };
    let seen = with_lines(&[line(1, 1), other]);
    let kind = FaultKind::ConflictingRepeat {
        run: 1,
        sequence: 1,
        compared: true,
    };
    assert_eq!((seen.hits.len(), seen.faults[0].kind), (1, kind));
}

/// No touch: no hit, but the line counts.
#[test]
fn not_touched() {
    let seen = with_lines(&[
        CheckedLine {
            touched: false,
            ..line(1, 1)
        },
        line(1, 2),
    ]);
    assert_eq!(
        (seen.hits.len(), seen.codes()),
        (1, vec![FaultCode::NotTouched])
    );
    assert_eq!(seen.statuses(), [Matched; 2]);
}

/// A wrong check value: the line is not used, its number is missing afterwards.
#[test]
fn wrong_check_value() {
    let text = format!("{}\n{}\n{}\n", line(1, 1), line(1, 2), line(1, 3));
    let text = text
        .replacen("148.609", "149.609", 2)
        .replacen("149.609", "148.609", 1);
    let seen = run(&config(&[checked()]), text.as_bytes());
    assert_eq!(seen.codes(), [FaultCode::BadCheckValue, FaultCode::Gap]);
    assert_eq!((seen.hits.len(), seen.statuses()[1]), (2, Damaged));
    let sequences: Vec<_> = seen.hits.iter().map(|hit| hit.sequence.unwrap()).collect();
    assert_eq!(sequences, [1, 3]);
}
