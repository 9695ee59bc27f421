//! Stuffing against the `cobs` crate, which others use, as the referee.

use std::vec::Vec;

use proptest::collection::vec;
use proptest::prelude::*;

use super::*;

fn stuffed(bytes: &[u8]) -> Vec<u8> {
    let mut out = std::vec![0xAA; bytes.len() + max_overhead(bytes.len())];
    let mut stuffer = Stuffer::new(&mut out, 0);
    for byte in bytes {
        stuffer.push(*byte).unwrap();
    }
    let (_, end) = stuffer.finish().unwrap();
    out.truncate(end);
    out
}

fn unstuffed(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut unstuffer = Unstuffer::new();
    let out = bytes
        .iter()
        .filter_map(|byte| unstuffer.push(*byte))
        .collect();
    unstuffer.is_complete().then_some(out)
}

/// The paper's example (an IP header) and the lengths at which a block fills.
#[test]
fn stuffs_as_published() {
    assert_eq!(stuffed(&[]), [1]);
    assert_eq!(stuffed(&[0]), [1, 1]);
    assert_eq!(
        stuffed(&[0x45, 0, 0, 0x2C, 0x4C, 0x79, 0, 0, 0x40, 6, 0x4F, 0x37]),
        [2, 0x45, 1, 4, 0x2C, 0x4C, 0x79, 1, 5, 0x40, 6, 0x4F, 0x37]
    );
    for len in [253, 254, 255, 508, 509] {
        let bytes: Vec<u8> = (0..len).map(|i| (i % 255 + 1) as u8).collect();
        assert_eq!(unstuffed(&stuffed(&bytes)).unwrap(), bytes, "{len} bytes");
    }
}

/// A buffer of one byte less than needed is named, never overrun.
#[test]
fn a_full_buffer_is_named() {
    let bytes = [7; 300];
    let need = stuffed(&bytes).len();
    let mut out = std::vec![0; need - 1];
    let mut stuffer = Stuffer::new(&mut out, 0);
    assert!(
        bytes
            .iter()
            .try_for_each(|byte| stuffer.push(*byte))
            .is_err()
    );
}

/// Mostly zeros, no zeros, and a mixture: blocks of every length.
fn bytes() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        vec(prop_oneof![9 => Just(0_u8), 1 => any::<u8>()], 0..700),
        vec(1_u8..=255, 0..700),
        vec(any::<u8>(), 0..700),
    ]
}

proptest! {
    /// What we stuff holds no zero, keeps the promised overhead, and the referee reads it.
    #[test]
    fn the_referee_reads_what_we_stuff(bytes in bytes()) {
        let out = stuffed(&bytes);
        prop_assert!(!out.contains(&0));
        prop_assert!(out.len() <= bytes.len() + max_overhead(bytes.len()));
        prop_assert_eq!(::cobs::decode_vec(&out).unwrap(), bytes);
    }

    /// We read what the referee stuffs.
    #[test]
    fn we_read_what_the_referee_stuffs(bytes in bytes()) {
        prop_assert_eq!(unstuffed(&::cobs::encode_vec(&bytes)), Some(bytes));
    }
}
