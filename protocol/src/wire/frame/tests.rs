//! What a frame promises.

use super::*;
use crate::message::JournalInfo;
use crate::wire::decoder::Decoder;

fn frame<'b, M: Message>(sequence: u16, message: &M, out: &'b mut [u8]) -> &'b [u8] {
    encode(sequence, message, out).unwrap()
}

/// A message comes back as it went in, with its sequence number.
#[test]
fn a_message_survives_its_frame() {
    let message = Response::JournalInfo(JournalInfo {
        first_seq: 0,
        next_seq: u64::MAX,
        acked_seq: 0,
        lost: 0,
    });
    let mut buffer = [0; MAX_BOARD_FRAME];
    let mut bytes = frame(0x1234, &message, &mut buffer);
    let mut decoder = Decoder::<MAX_BOARD_FRAME>::new();
    let back = decoder.next_frame(&mut bytes).unwrap();
    assert_eq!(back.sequence, 0x1234);
    assert_eq!(back.key, KEY as u32);
    assert_eq!(back.open::<Response>(), Ok(message));
    assert!(bytes.is_empty());
}
