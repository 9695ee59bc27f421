//! The frame decoder under bytes of all kinds. The first byte chooses the view:
//!
//! * any bytes as a stream: no panic, everything that is not a frame is counted, and
//!   another split into chunks sees the same;
//! * any bytes as a payload in an intact frame, made by other libraries (`crc`, `cobs`): it
//!   comes out as it went in; opened as a message it is refused, or written anew it
//!   stays the same and within its computed length;
//! * any bytes as garbage around frames of ours: all of these come out, in their order.

use crc::{CRC_32_ISO_HDLC, Crc};
use umi_protocol::decoder::{Decoder, FrameCounters};
use umi_protocol::frame::{Kind, MAX_BOARD_FRAME, Message, encode, frame_len};
use umi_protocol::hello::{Hello, KEY};
use umi_protocol::message::{Event, Request, Response};

/// One input.
pub fn one(data: &[u8]) {
    match data.split_first() {
        Some((view, data)) if view % 3 == 0 => as_stream(data),
        Some((view, data)) if view % 3 == 1 => as_payload(data),
        Some((_, data)) => as_garbage(data),
        None => {}
    }
}

/// Small, so that overflows are common.
const SMALL: usize = 48;

type Seen = (Kind, u16, u32, Vec<u8>);

/// All that a decoder finds when the bytes come in chunks.
fn decoded<const N: usize>(bytes: &[u8], chunk: usize) -> (Vec<Seen>, FrameCounters) {
    let mut decoder = Decoder::<N>::new();
    let mut seen = Vec::new();
    for mut chunk in bytes.chunks(chunk) {
        while let Some(frame) = decoder.next_frame(&mut chunk) {
            seen.push((
                frame.kind,
                frame.sequence,
                frame.key,
                frame.payload.to_vec(),
            ));
        }
    }
    (seen, decoder.counters())
}

fn as_stream(data: &[u8]) {
    let chunk = 1 + data.len() % 7;
    let whole = decoded::<SMALL>(data, data.len().max(1));
    assert_eq!(whole, decoded::<SMALL>(data, chunk));
    let (seen, counters) = whole;
    assert_eq!(seen.len(), counters.frames as usize);
    assert!(counters.bytes_discarded as usize <= data.len());
    let stretches = data.split(|byte| *byte == 0).count() as u32;
    assert!(counters.frames + counters.damaged() <= stretches);
}

/// A frame as another program would write it.
fn foreign(kind: u8, sequence: u16, key: u32, payload: &[u8]) -> Vec<u8> {
    let mut content = vec![kind];
    content.extend(sequence.to_le_bytes());
    content.extend(key.to_le_bytes());
    content.extend(payload);
    let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&content);
    content.extend(crc.to_le_bytes());
    let mut frame = vec![0];
    frame.extend(cobs::encode_vec(&content));
    frame.push(0);
    frame
}

fn as_payload(data: &[u8]) {
    let Some((kind, payload)) = data.split_first() else {
        return;
    };
    let kind = kind % 8;
    if frame_len(payload.len()) > MAX_BOARD_FRAME {
        return;
    }
    let mut bytes = &foreign(kind, 0x0100, KEY as u32, payload)[..];
    let mut decoder = Decoder::<MAX_BOARD_FRAME>::new();
    let frame = decoder.next_frame(&mut bytes).expect("the frame is intact");
    assert_eq!(frame.sequence, 0x0100);
    assert_eq!(frame.payload, payload);
    match kind {
        1 => rewritten(frame.open::<Hello>().ok()),
        2 => rewritten(frame.open::<Request>().ok()),
        3 => rewritten(frame.open::<Response>().ok()),
        4 => rewritten(frame.open::<Event>().ok()),
        5 | 6 => {
            // With its seal or too short for one; without it, a message as any other.
            if let Some((inner, authenticated, _)) = frame.unsealed() {
                assert_eq!(inner.payload, authenticated.message);
                rewritten(inner.open::<Request>().ok());
                rewritten(inner.open::<Response>().ok());
            }
        }
        _ => assert_eq!(frame.kind, Kind::Other(kind)),
    }
}

/// A message that could be read is written, read and written again: the same bytes,
/// and not too many.
fn rewritten<M: Message>(message: Option<M>) {
    let Some(message) = message else { return };
    let mut first = vec![0; MAX_BOARD_FRAME];
    let first = encode(7, &message, &mut first).expect("a message fits");
    assert!(first.len() <= frame_len(M::MAX_LEN));
    let mut bytes = first;
    let mut decoder = Decoder::<MAX_BOARD_FRAME>::new();
    let frame = decoder.next_frame(&mut bytes).expect("the frame is intact");
    let again: M = frame.open().expect("what was written can be read");
    let mut second = vec![0; MAX_BOARD_FRAME];
    assert_eq!(
        first,
        encode(7, &again, &mut second).expect("it fits again")
    );
}

fn as_garbage(data: &[u8]) {
    let mut stream = Vec::new();
    let mut sent = Vec::new();
    for (number, garbage) in data.chunks(1 + data.len() / 3).enumerate() {
        stream.extend(garbage);
        let feature = garbage.first().copied().unwrap_or(0);
        let mut buffer = [0; SMALL];
        let frame = encode(number as u16, &Request::FeatureGet { feature }, &mut buffer);
        let frame = frame.expect("a short request fits");
        stream.extend(frame);
        sent.extend(decoded::<SMALL>(frame, frame.len()).0);
    }
    assert_eq!(sent.len(), data.chunks(1 + data.len() / 3).count());
    let (seen, _) = decoded::<SMALL>(&stream, 1 + data.len() % 11);
    // All in their order; between them, garbage may happen to be a frame of its own.
    let mut due = sent.iter().peekable();
    for frame in &seen {
        due.next_if_eq(&frame);
    }
    assert_eq!(due.next(), None);
}
