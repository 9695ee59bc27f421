//! The sentence and the code of everything that a fit, a calibration, a journal or
//! the rewriter refuses.
//!
//! People script against the codes and look the sentences up: `sentences.txt` holds both for
//! every variant, so a change of either is seen by the one who makes it.

use std::fmt::{Display, Write as _};
use std::path::Path;
use std::string::String;

use crate::fit::{Degeneracy, FitError, PointSet, Quantity};
use crate::journal::{GeometryFault, JournalError, JournalFault};
use crate::point::{PointRefusal, Weakness};
use crate::rewrite::{RefusedLine, RewriteRefusal, Why};
use crate::units::Mm;

fn page<T: Display>(text: &mut String, all: &[T], code: impl Fn(&T) -> &'static str) {
    for it in all {
        writeln!(text, "{}: {it}", code(it)).unwrap();
    }
}

#[test]
fn codes_and_sentences_stay() {
    let mut text = String::new();
    page(&mut text, &fits(), FitError::code);
    page(&mut text, &points(), PointRefusal::code);
    page(&mut text, &journals(), JournalError::code);
    page(&mut text, &rewrites(), |_| "");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/sentences/sentences.txt");
    if std::env::var_os("UMI_BLESS").is_some_and(|value| value == "1") {
        std::fs::write(&path, &text).unwrap();
    }
    let pinned = std::fs::read_to_string(&path).unwrap_or_default();
    for (old, new) in pinned.lines().zip(text.lines()) {
        assert_eq!(old, new);
    }
    assert_eq!(pinned.lines().count(), text.lines().count());
}

fn fits() -> std::vec::Vec<FitError> {
    let mut all = std::vec::Vec::new();
    for set in [PointSet::Points, PointSet::Source, PointSet::Target] {
        all.push(FitError::NotFinite { set, row: 1 });
        all.push(FitError::OutOfRange { set, row: 2 });
        for why in [
            Degeneracy::Coincident,
            Degeneracy::Duplicates {
                distinct: 3,
                needed: 4,
            },
            Degeneracy::Collinear,
            Degeneracy::Coplanar,
        ] {
            all.push(FitError::Degenerate { set, why });
        }
    }
    for quantity in [
        Quantity::Center,
        Quantity::Radius,
        Quantity::Direction,
        Quantity::Position,
        Quantity::HalfAngle,
        Quantity::Apex,
        Quantity::Rotation,
    ] {
        all.push(FitError::IllConditioned {
            quantity,
            condition: 12_345.0,
            limit: 100.0,
        });
        all.push(FitError::Uncertain {
            quantity,
            relative_uncertainty: 0.5,
            limit: 0.1,
        });
    }
    for relative_uncertainty in [0.25, f64::INFINITY] {
        all.push(FitError::CapTooSmall {
            relative_uncertainty,
            limit: 0.1,
        });
    }
    all.extend([
        FitError::TooFewPoints {
            given: 3,
            needed: 4,
        },
        FitError::Ambiguous {
            best_rms_mm: 0.001,
            other_rms_mm: 0.0015,
        },
        FitError::NoDirection,
        FitError::NoConvergence { iterations: 60 },
        FitError::LengthMismatch {
            source: 3,
            target: 4,
        },
    ]);
    all
}

fn points() -> [PointRefusal; 17] {
    [
        PointRefusal::TooFewPoints {
            given: 3,
            needed: 7,
        },
        PointRefusal::NotFinite { row: 4 },
        PointRefusal::NoDirection,
        PointRefusal::BadSphere {
            ball: 1,
            why: "its radius is not a length",
        },
        PointRefusal::UnknownSphere { row: 6 },
        PointRefusal::CoincidentPoints {
            distinct: 2,
            needed: 7,
        },
        PointRefusal::OnePlace,
        PointRefusal::RangeNotVaried { spread: Mm(1e-5) },
        PointRefusal::RangeInScatter {
            spread: Mm(0.005),
            rms: Mm(0.001),
        },
        PointRefusal::Misfit {
            spread: Mm(2.0),
            rms: Mm(0.5),
        },
        PointRefusal::GreatCircle {
            off_plane: Mm(2e-5),
        },
        PointRefusal::OneCircle {
            off_plane: Mm(3e-5),
        },
        PointRefusal::Degenerate(Weakness {
            what: "offset",
            factor: 2e4,
        }),
        PointRefusal::Uncertain {
            point: Mm(0.5),
            direction_rad: 0.25,
        },
        PointRefusal::Ambiguous {
            dof: 2,
            best_rms: Mm(0.001),
            other_rms: Mm(0.002),
            apart_deg: 12.5,
            apart: Mm(1.5),
        },
        PointRefusal::OtherWay { rms: Mm(0.003) },
        PointRefusal::NoConvergence,
    ]
}

fn journals() -> std::vec::Vec<JournalError<u8>> {
    let mut all = std::vec![
        JournalError::Flash(7),
        JournalError::NotKept { addr: 0x1000 },
        JournalError::Full,
        JournalError::NotAJournal,
        JournalError::Version { found: 3 },
        JournalError::OtherGeometry {
            sectors: 4,
            sector_size: 4096,
            align: 8,
        },
        JournalError::PayloadTooLong { len: 9, max: 8 },
        JournalError::BufferTooSmall { need: 5 },
    ];
    for (seq, first, next) in [(1, 2, 9), (9, 2, 9)] {
        all.push(JournalError::OutOfRange { seq, first, next });
    }
    all.extend(
        [
            GeometryFault::TooFewSectors,
            GeometryFault::WriteSize,
            GeometryFault::PageSize,
            GeometryFault::SectorNotWholePages,
            GeometryFault::SectorTooSmall,
            GeometryFault::TooLarge,
        ]
        .map(JournalError::Geometry),
    );
    all.extend(
        [
            JournalFault::Damaged { seq: 1 },
            JournalFault::Missing { first: 2, next: 5 },
            JournalFault::ChainBroken { seq: 3 },
            JournalFault::CutShort { seq: 4 },
        ]
        .map(JournalError::Record),
    );
    all
}

fn rewrites() -> [RefusedLine; 68] {
    [
        RewriteRefusal::LineTooLong,
        RewriteRefusal::LineEnds,
        RewriteRefusal::TooManyWords,
        RewriteRefusal::UnclosedComment,
        RewriteRefusal::NotAWord,
        RewriteRefusal::OutOfRange,
        RewriteRefusal::Flow,
        RewriteRefusal::SystemVariable,
        RewriteRefusal::Expression('X'),
        RewriteRefusal::Twice('Y'),
        RewriteRefusal::Meaningless('Z'),
        RewriteRefusal::NoCode,
        RewriteRefusal::UnknownCode(543),
        RewriteRefusal::Code(280, Why::Coordinates),
        RewriteRefusal::Code(281, Why::Motion),
        RewriteRefusal::Code(650, Why::Macro),
        RewriteRefusal::Code(280, Why::Through),
        RewriteRefusal::Code(920, Why::Offsets),
        RewriteRefusal::TwoMotions,
        RewriteRefusal::TwoOfGroup(910),
        RewriteRefusal::ModeBehind(910, 'X'),
        RewriteRefusal::NoDistanceMode,
        RewriteRefusal::NoReturn,
        RewriteRefusal::NoUnit,
        RewriteRefusal::NoMotion,
        RewriteRefusal::NoMotionHere,
        RewriteRefusal::NoPoint('X'),
        RewriteRefusal::UnknownPlace('Y'),
        RewriteRefusal::RapidOver('Z'),
        RewriteRefusal::OffsetStep,
        RewriteRefusal::OffsetNumber,
        RewriteRefusal::TwoTakeP,
        RewriteRefusal::FeedsOut,
        RewriteRefusal::ShiftTaken,
        RewriteRefusal::Rotary('A'),
        RewriteRefusal::SecondaryAxis('U'),
        RewriteRefusal::WorkOffset,
        RewriteRefusal::Tilted('G'),
        RewriteRefusal::TiltedCycle(830),
        RewriteRefusal::CycleLacks('R'),
        RewriteRefusal::CycleDepth,
        RewriteRefusal::Arc,
        RewriteRefusal::TooManyChords,
        RewriteRefusal::LateCode('M'),
        RewriteRefusal::OptionalMode,
        RewriteRefusal::OptionalLines,
        RewriteRefusal::NoFeed,
        RewriteRefusal::SubprogramModes,
        RewriteRefusal::NotHere(7),
        RewriteRefusal::CallsNothing,
        RewriteRefusal::CallsFrom('Q'),
        RewriteRefusal::Elsewhere(7),
        RewriteRefusal::NamedCall,
        RewriteRefusal::NumberedCall(7),
        RewriteRefusal::Comma('A'),
        RewriteRefusal::Semicolon,
        RewriteRefusal::BehindEnd,
        RewriteRefusal::Restores(72),
        RewriteRefusal::TwoShifts,
        RewriteRefusal::Rewritten,
        RewriteRefusal::NumberShares,
        RewriteRefusal::Turns,
        RewriteRefusal::TurnsOutOfRange,
        RewriteRefusal::BelowR,
        RewriteRefusal::HeightsMoved,
        RewriteRefusal::HeightsSaidElsewise,
        RewriteRefusal::TooManySubprograms,
        RewriteRefusal::SubprogramDrifts,
    ]
    .map(|reason| RefusedLine {
        line: 3,
        column: 4,
        reason,
    })
}
