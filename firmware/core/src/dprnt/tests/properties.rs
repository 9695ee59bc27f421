//! What holds for any bytes.

use std::vec;
use std::vec::Vec;

use proptest::prelude::*;
use umi_protocol::pattern::{Coding, LinePattern, ReceiverConfig, RingCsvPattern};

use super::support::*;
use crate::dprnt::{Counters, Item, LineSplitter};
use crate::units::Micros;

fn configs() -> [ReceiverConfig; 3] {
    let ring = RingCsvPattern {
        rows: 3,
        ..RingCsvPattern::default()
    };
    [
        config(&[block(), point_line(), checked(), words("", "XYZ", "R")]),
        config(&[
            LinePattern::GrblProbe,
            LinePattern::LinuxCncProbe,
            LinePattern::RingCsv(ring),
            template("PT {i} {name} X={x} Y={y} R{skip}/{feed} T{touched}", None),
        ]),
        ReceiverConfig {
            coding: Coding::IsoEven,
            ..config(&[block()])
        },
    ]
}

/// Pieces that occur on real lines, in any order, and noise.
fn stream() -> impl Strategy<Value = Vec<u8>> {
    const PIECES: &[&str] = &[
        "SPHERE1\n",
        "***\r\n",
        "2\n",
        " -135.0190 -136.6200 148.6090\r\n",
        "POINT: 1.0000 2.0000 3.0000\n",
        "\x12",
        "\x14",
        "\x11",
        "\x13",
        "\0",
        "%\n",
        "O1234(A)\n",
        "Index,X,Y\n",
        "1,1.5000,2.5000\n",
        "X1.5Y2.5Z-3.5R1\r",
        "[PRB:1.000,2.000,3.000:1]\n",
        "PT 1 A X=1 Y=2 R9/20 T1\n",
        "\n\r\r",
        "- 1",
        ".5",
        "*",
        "UMI1 R    17 S     3 B   2 A 2 T 1 F    20.000 X-  135.019 Y-  136.620 Z   148.609 C 4113.0474\n",
    ];
    let piece = prop_oneof![
        8 => prop::sample::select(PIECES).prop_map(|text| text.as_bytes().to_vec()),
        2 => prop::collection::vec(any::<u8>(), 0..30),
        1 => prop::collection::vec(0x20u8..0x7F, 0..200),
    ];
    let pieces = prop::collection::vec((piece, 0usize..3), 0..30);
    pieces.prop_map(|pieces| {
        let encode = |(piece, code): (Vec<u8>, usize)| match code {
            0 => iso(&piece),
            _ => piece,
        };
        pieces.into_iter().flat_map(encode).collect()
    })
}

fn assert_balanced(counters: &Counters, received: usize) -> Result<(), TestCaseError> {
    prop_assert_eq!(counters.bytes, received as u64);
    let parts = counters.bytes_text
        + counters.bytes_line_end
        + counters.bytes_control
        + counters.bytes_discarded;
    prop_assert_eq!(parts, counters.bytes);
    let lines = counters.lines_matched
        + counters.lines_separator
        + counters.lines_program
        + counters.lines_not_understood
        + counters.lines_damaged;
    prop_assert_eq!(lines, counters.lines);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    /// However the stream is cut into pieces, the output is the same.
    #[test]
    fn any_split_gives_the_same(bytes in stream(), cuts in prop::collection::vec(any::<prop::sample::Index>(), 0..8)) {
        for config in configs() {
            let whole = run(&config, &bytes);
            let mut cuts: Vec<usize> = cuts.iter().map(|cut| cut.index(bytes.len() + 1)).collect();
            cuts.sort_unstable();
            let mut pieces = vec![];
            let mut from = 0;
            for cut in cuts {
                pieces.push((0, &bytes[from..cut]));
                from = cut;
            }
            pieces.push((0, &bytes[from..]));
            prop_assert_eq!(&whole, &run_pieces(&config, &pieces));
            let single: Vec<_> = bytes.chunks(1).map(|byte| (0, byte)).collect();
            prop_assert_eq!(&whole, &run_pieces(&config, &single));
        }
    }

    /// Asking for time-outs or not makes no difference to what comes out.
    #[test]
    fn polling_makes_no_difference(bytes in stream(), waits in prop::collection::vec(0u64..200, 40)) {
        for config in configs() {
            let mut polled = LineSplitter::new(&config);
            let mut plain = LineSplitter::new(&config);
            let (mut a, mut b) = (Seen::default(), Seen::default());
            let mut now = 0;
            for (piece, wait) in bytes.chunks(7).zip(waits.iter().cycle()) {
                for second in now..now + wait {
                    polled.on_time(Micros(second * 1_000_000), &mut |item| a.take(item));
                }
                now += wait;
                polled.receive(piece, Micros(now * 1_000_000), &mut |item| a.take(item));
                plain.receive(piece, Micros(now * 1_000_000), &mut |item| b.take(item));
            }
            // Faults of a time-out carry the time of asking; all else is the same.
            prop_assert_eq!((a.lines, a.hits, a.ends), (b.lines, b.hits, b.ends));
            prop_assert_eq!(polled.counters(), plain.counters());
        }
    }

    /// Any bytes: no panic, every byte and line in exactly one counter, at any
    /// moment; every item counted; line numbers without a hole.
    #[test]
    fn everything_is_accounted_for(
        bytes in prop_oneof![stream(), prop::collection::vec(any::<u8>(), 0..600)],
        lost_at in any::<prop::sample::Index>()
    ) {
        for config in configs() {
            let mut receiver = LineSplitter::new(&config);
            let mut seen = Seen::default();
            let mut numbers = vec![];
            let lost_at = lost_at.index(bytes.len() + 1);
            for (at, byte) in bytes.iter().enumerate() {
                let mut sink = |item: Item<'_>| {
                    if let Item::Line(line) = &item {
                        numbers.push(line.number);
                    }
                    seen.take(item);
                };
                if at == lost_at {
                    receiver.lost(1, Micros(at as u64), &mut sink);
                }
                receiver.push(*byte, Micros(at as u64), &mut sink);
                assert_balanced(receiver.counters(), at + 1)?;
            }
            receiver.finish(Micros(bytes.len() as u64), &mut |item| {
                if let Item::Line(line) = &item {
                    numbers.push(line.number);
                }
                seen.take(item);
            });
            let counters = receiver.counters();
            assert_balanced(counters, bytes.len())?;
            prop_assert_eq!(numbers, (1..=counters.lines).collect::<Vec<_>>());
            prop_assert_eq!(counters.hits as usize, seen.hits.len());
            let faults: u32 = counters.faults.iter().sum();
            prop_assert_eq!(faults as usize, seen.faults.len());
            prop_assert_eq!(seen.starts.len(), seen.ends.len());
            prop_assert!(seen.hits.iter().all(|hit| hit.position.is_finite()));
            prop_assert_eq!(receiver.deadline(), None);
        }
    }
}
