//! The frozen greeting and the mismatches that it names.

use std::string::ToString;

use super::*;
use crate::message::Request;
use crate::wire::decoder::Decoder;
use crate::wire::frame::{MAX_BOARD_FRAME, OpenError, encode};

fn hello(major: u8, minor: u8, key: u64) -> Hello {
    Hello::of(Version { major, minor }, key, "virtual 0001 0.1.0")
}

/// Every kind of mismatch says what to do, in words that do not change by accident.
#[test]
fn a_mismatch_says_which_side_to_update() {
    let Version { major, minor } = VERSION;
    assert_eq!(hello(major, minor, KEY).check(), Ok(()));

    let newer = hello(major + 1, 0, KEY).check().unwrap_err();
    assert_eq!(
        newer.to_string(),
        std::format!(
            "board speaks a newer protocol ({}.0, this umi {VERSION}): update umi",
            major + 1
        )
    );
    let older = hello(major - 1, 9, KEY).check().unwrap_err();
    assert_eq!(
        older.to_string(),
        std::format!(
            "board speaks an older protocol ({}.9, this umi {VERSION}): update the board's firmware",
            major - 1
        )
    );
    let other = hello(major, minor, KEY ^ 1).check().unwrap_err();
    assert_eq!(other, Mismatch::OtherSchema { board: KEY ^ 1 });
    assert!(other.to_string().contains("from the same release"));
}

/// Equal keys do not excuse another version, even only another minor number: the
/// meaning may have changed without the bytes.
#[test]
fn a_different_minor_number_is_a_mismatch() {
    let newer = hello(VERSION.major, VERSION.minor + 1, KEY);
    assert!(matches!(newer.check(), Err(Mismatch::BoardNewer { .. })));
}

/// A frame that is no greeting of ours is not taken for one.
#[test]
fn another_magic_is_not_openumi() {
    let mut other = Hello::new("x");
    other.magic = *b"oumi";
    assert_eq!(other.check(), Err(Mismatch::NotOpenumi));
}

/// The greeting of a version from the future, with a key that we do not know and
/// bytes that we do not know at its end, is still understood.
#[test]
fn a_greeting_of_the_future_is_understood() {
    #[derive(Serialize, Deserialize, Schema)]
    #[postcard(crate = crate)]
    struct Later {
        hello: Hello,
        more: [u8; 5],
    }
    impl Message for Later {
        const KIND: Kind = Kind::Hello;
    }
    let sent = hello(9, 9, 0x0123_4567_89AB_CDEF);
    let later = Later {
        hello: sent.clone(),
        more: [1, 0, 2, 0, 3],
    };
    let mut buffer = [0; MAX_BOARD_FRAME];
    let mut bytes = encode(5, &later, &mut buffer).unwrap();
    let mut decoder = Decoder::<MAX_BOARD_FRAME>::new();
    let frame = decoder.next_frame(&mut bytes).unwrap();
    assert_eq!(frame.open::<Hello>(), Ok(sent));
    assert_eq!(
        frame.open::<Request>(),
        Err(OpenError::OtherKind(Kind::Hello))
    );
}

/// A text that is too long is cut between characters.
#[test]
fn a_long_sender_is_cut() {
    let long = "é".repeat(MAX_SENDER);
    assert_eq!(Hello::new(&long).sender.len(), MAX_SENDER);
}
