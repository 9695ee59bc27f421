//! Frames come out of any stream; damaged ones never do.

use std::string::ToString;
use std::vec::Vec;

use proptest::collection::vec;
use proptest::prelude::*;

use super::*;
use crate::message::Request;
use crate::wire::frame::{MAX_HOST_FRAME, encode};
use crate::wire::hello::Hello;

const N: usize = MAX_HOST_FRAME;

fn request(sequence: u16, feature: u8) -> Vec<u8> {
    let mut buffer = [0; N];
    encode(sequence, &Request::FeatureGet { feature }, &mut buffer)
        .unwrap()
        .to_vec()
}

fn hello(sequence: u16, sender: &str) -> Vec<u8> {
    let mut buffer = [0; N];
    encode(sequence, &Hello::new(sender), &mut buffer)
        .unwrap()
        .to_vec()
}

/// Everything that a decoder finds in some chunks, each as sequence and payload.
fn found<const N: usize>(
    decoder: &mut Decoder<N>,
    chunks: &[impl AsRef<[u8]>],
) -> Vec<(u16, Vec<u8>)> {
    let mut frames = Vec::new();
    for chunk in chunks {
        let mut bytes = chunk.as_ref();
        while let Some(frame) = decoder.next_frame(&mut bytes) {
            frames.push((frame.sequence, frame.payload.to_vec()));
        }
        assert!(bytes.is_empty());
    }
    frames
}

/// No single flipped bit, in the frame or its delimiters, gets a damaged frame
/// through, and the frame after it is found.
#[test]
fn no_single_bit_flip_is_undetected() {
    let samples = [
        request(1, 0),
        request(0, 255),
        hello(7, ""),
        hello(0x100, &"x".repeat(48)),
    ];
    let next = request(99, 9);
    let expected = found(&mut Decoder::<N>::new(), &[&next]);
    for sample in &samples {
        let sent = found(&mut Decoder::<N>::new(), &[sample]);
        for bit in 0..sample.len() * 8 {
            let mut damaged = sample.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            let mut decoder = Decoder::<N>::new();
            let frames = found(&mut decoder, &[&damaged, &next]);
            // A flipped delimiter damages no frame: the neighbour's serves.
            let in_delimiter = bit / 8 == 0 || bit / 8 == sample.len() - 1;
            if in_delimiter && frames.len() == 2 {
                assert_eq!(frames[0], sent[0]);
            } else {
                assert_eq!(frames, expected, "bit {bit} of {sample:02x?}");
                assert!(decoder.counters().damaged() > 0);
            }
        }
    }
}

/// Nor do any two flipped bits: what the check value promises of the content, the
/// stuffing around it does not take away.
#[test]
fn no_two_bit_flips_are_undetected() {
    for sample in [request(1, 0), hello(0x100, "pico 7")] {
        let sent = found(&mut Decoder::<N>::new(), &[&sample]);
        let bits = sample.len() * 8;
        for (first, second) in (0..bits).flat_map(|a| (0..a).map(move |b| (a, b))) {
            let mut damaged = sample.clone();
            damaged[first / 8] ^= 1 << (first % 8);
            damaged[second / 8] ^= 1 << (second % 8);
            // The first delimiter may go: then the frame is still whole.
            let frames = found(&mut Decoder::<N>::new(), &[&damaged]);
            assert!(frames.is_empty() || frames == sent, "{first} {second}");
        }
    }
}

/// Each kind of damage has its own counter, and bytes are counted.
#[test]
fn damage_is_counted_by_kind() {
    let mut decoder = Decoder::<64>::new();
    // Changed in its content. Elsewhere the stuffing is damaged as well, and that is garbage: which
    // bytes those are goes with the protocol's key.
    let good = request(1, 2);
    let changed = (0..good.len()).map(|at| {
        let mut changed = good.clone();
        changed[at] ^= 0x10;
        changed
    });
    let is_of_content = |changed: &Vec<u8>| {
        let mut decoder = Decoder::<64>::new();
        found(&mut decoder, &[changed]).is_empty() && decoder.counters().crc_errors == 1
    };
    let wrong = changed.into_iter().find(is_of_content).unwrap();
    let long = [b'x'; 200];
    let stream: [&[u8]; 6] = [
        b"login: \0",  // no stuffed bytes
        &[3, 1, 2, 0], // stuffed, too short for a frame
        &wrong,
        &long,
        &long,
        &request(5, 6),
    ];
    assert_eq!(found(&mut decoder, &stream).len(), 1);
    assert_eq!(
        decoder.counters(),
        FrameCounters {
            frames: 1,
            garbage: 2,
            crc_errors: 1,
            overflows: 1,
            bytes_discarded: 7 + 3 + (wrong.len() as u32 - 2) + 400,
        }
    );
}

/// The tail of a frame that is too long is not decoded, even where it ends like a frame.
#[test]
fn the_tail_of_an_overflow_is_not_a_frame() {
    let good = request(5, 6);
    let inner = &good[1..];
    // The stuffed bytes of a whole frame, glued to a stretch that overflows.
    let mut stream = std::vec![255; 300];
    stream.extend_from_slice(inner);
    let mut decoder = Decoder::<64>::new();
    assert_eq!(found(&mut decoder, &[&stream]), []);
    assert_eq!(decoder.counters().overflows, 1);
    assert_eq!(found(&mut decoder, &[&good]).len(), 1);
}

/// Idle delimiters are no damage.
#[test]
fn delimiters_alone_are_nothing() {
    let mut decoder = Decoder::<64>::new();
    assert_eq!(found(&mut decoder, &[[0; 100]]), []);
    assert_eq!(decoder.counters(), FrameCounters::default());
}

/// The counters stop at their end instead of starting again at zero.
#[test]
fn counters_saturate() {
    let mut decoder = Decoder::<64>::new();
    decoder.counters.garbage = u32::MAX;
    found(&mut decoder, &[b"noise\0"]);
    assert_eq!(decoder.counters().garbage, u32::MAX);
    assert_eq!(decoder.counters().damaged(), u32::MAX);
}

#[derive(Clone, Debug)]
enum Piece {
    Frame { sequence: u16, feature: u8 },
    Hello { sequence: u16, letters: usize },
    Garbage(Vec<u8>),
}

fn pieces() -> impl Strategy<Value = Vec<Piece>> {
    vec(
        prop_oneof![
            any::<(u16, u8)>().prop_map(|(sequence, feature)| Piece::Frame { sequence, feature }),
            (any::<u16>(), 0..48_usize)
                .prop_map(|(sequence, letters)| Piece::Hello { sequence, letters }),
            vec(any::<u8>(), 0..40).prop_map(Piece::Garbage),
            vec(any::<u8>(), 0..(N + 100)).prop_map(Piece::Garbage),
        ],
        0..12,
    )
}

proptest! {
    /// Any garbage between frames, any split into chunks: exactly the sent frames
    /// come out, and every byte is either in a frame or counted.
    #[test]
    fn frames_come_out_of_garbage(pieces in pieces(), cuts in vec(1..300_usize, 1..20)) {
        let mut stream = Vec::new();
        let mut sent = Vec::new();
        for piece in &pieces {
            let bytes = match piece {
                Piece::Frame { sequence, feature } => request(*sequence, *feature),
                Piece::Hello { sequence, letters } => hello(*sequence, &"é".repeat(*letters).to_string()),
                Piece::Garbage(bytes) => { stream.extend_from_slice(bytes); continue; }
            };
            sent.extend(found(&mut Decoder::<N>::new(), &[&bytes]));
            stream.extend_from_slice(&bytes);
        }
        stream.push(0);
        let mut chunks = Vec::new();
        let mut rest = &stream[..];
        for cut in cuts.iter().cycle() {
            if rest.is_empty() { break; }
            let (chunk, others) = rest.split_at((*cut).min(rest.len()));
            chunks.push(chunk);
            rest = others;
        }
        let mut decoder = Decoder::<N>::new();
        prop_assert_eq!(found(&mut decoder, &chunks), sent.clone());
        prop_assert_eq!(decoder.counters().frames as usize, sent.len());

        // The same in one piece: a split changes nothing, counters included.
        let mut whole = Decoder::<N>::new();
        found(&mut whole, &[&stream]);
        prop_assert_eq!(whole.counters(), decoder.counters());
    }

    /// Up to three flipped bits, a lost byte or a doubled byte: the frame never
    /// comes out changed.
    #[test]
    fn damaged_frames_never_come_out(
        sequence: u16, feature: u8, letters in 0..48_usize,
        flips in vec(any::<prop::sample::Index>(), 0..4),
        lost in any::<Option<prop::sample::Index>>(),
        doubled in any::<Option<prop::sample::Index>>(),
    ) {
        for clean in [request(sequence, feature), hello(sequence, &"x".repeat(letters))] {
            let sent = found(&mut Decoder::<N>::new(), &[&clean]);
            let mut bytes = clean.clone();
            for flip in &flips {
                let bit = flip.index(bytes.len() * 8);
                bytes[bit / 8] ^= 1 << (bit % 8);
            }
            if let Some(doubled) = &doubled {
                let at = doubled.index(bytes.len());
                bytes.insert(at, bytes[at]);
            }
            if let Some(lost) = &lost {
                bytes.remove(lost.index(bytes.len()));
            }
            let frames = found(&mut Decoder::<N>::new(), &[&bytes]);
            // Nothing, or (flips that cancel, a doubled delimiter) what was sent.
            prop_assert!(frames.is_empty() || frames == sent, "{:?}", frames);
        }
    }
}
