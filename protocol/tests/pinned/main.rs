//! The bytes of every message, held against files.
//!
//! A journal outlives the firmware that wrote it, and board and host are updated
//! apart from each other. So a change of any byte must be seen by the one who
//! makes it: each `*.hex` file here holds one sample of every variant, `schema.txt`
//! the layout of every type, and `key.hex` what both sides compare.
//!
//! After a change that is meant:
//!
//! 1. raise `umi_protocol::hello::VERSION` (once per release is enough),
//! 2. `UMI_BLESS=1 cargo test -p umi-protocol --test pinned` writes the files anew,
//! 3. read their difference before it is committed. `hello.hex` may never change, and
//!    `frame.hex` only in its key and its check value.

mod layout;
mod samples;
mod schema_and_serde;
mod sentences;
mod table;

use std::fmt::{Debug, Write as _};
use std::fs;
use std::path::Path;

use serde::{Serialize, de::DeserializeOwned};
use umi_protocol::Schema;
use umi_protocol::decoder::Decoder;
use umi_protocol::frame::{MAX_BOARD_FRAME, Message, encode, encode_dropped};
use umi_protocol::hello::KEY;
use umi_protocol::immediate::{ImmediateRequest, SessionRequest};
use umi_protocol::message::{Event, MAX_RECORD, Record, Request, RequestClass, Response};
use umi_protocol::schema::{DataModelType, key};

/// Compares with a file beside this one, or writes it with `UMI_BLESS=1`.
fn hold(file: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/pinned")
        .join(file);
    if std::env::var_os("UMI_BLESS").is_some_and(|value| value == "1") {
        fs::write(&path, text).unwrap();
    }
    let pinned = fs::read_to_string(&path).unwrap_or_default();
    let differs = pinned
        .lines()
        .zip(text.lines())
        .position(|(a, b)| a != b)
        .unwrap_or_else(|| pinned.lines().count().min(text.lines().count()));
    assert!(
        pinned == text,
        "{} differs from line {} on:\n  pinned {:?}\n  now    {:?}\n\
         If the change is meant, see the head of tests/pinned/main.rs.",
        path.display(),
        differs + 1,
        pinned.lines().nth(differs),
        text.lines().nth(differs),
    );
}

/// Bytes in hexadecimal, 32 to a line.
fn hex(bytes: &[u8]) -> String {
    let mut text = String::new();
    for line in bytes.chunks(32) {
        let words: Vec<String> = line.iter().map(|byte| format!("{byte:02x}")).collect();
        writeln!(text, "{}", words.join(" ")).unwrap();
    }
    text
}

/// Holds the bytes of all samples of a type, each of which must come back as it
/// was, and demands one of every variant in the order of the numbers on the wire.
fn hold_samples<T>(file: &str, after: impl Fn(Option<&T>) -> Option<T>)
where
    T: Schema + Serialize + DeserializeOwned + Debug + PartialEq,
{
    let DataModelType::Enum(variants) = T::SCHEMA.ty else {
        panic!("{} is no enum", T::SCHEMA.name);
    };
    let mut text = String::new();
    let mut sample = after(None);
    for (number, variant) in variants.iter().enumerate() {
        let value = sample.unwrap_or_else(|| panic!("no sample of {}", variant.name));
        let mut buffer = [0; 2 * MAX_RECORD];
        let bytes = postcard::to_slice(&value, &mut buffer).unwrap();
        assert_eq!(usize::from(bytes[0]), number, "{}", variant.name);
        let (back, rest) = postcard::take_from_bytes::<T>(bytes).unwrap();
        assert_eq!(back, value);
        assert!(rest.is_empty(), "{}", variant.name);
        writeln!(text, "# {} {number} {}", T::SCHEMA.name, variant.name).unwrap();
        text.push_str(&hex(bytes));
        sample = after(Some(&value));
    }
    assert!(sample.is_none(), "more samples than variants");
    hold(file, &text);
}

#[test]
fn requests_keep_their_bytes() {
    hold_samples::<Request>("request.hex", samples::request_after);
}

/// The short way of five requests reads the same as the long one, and none but them.
#[test]
fn requests_that_are_answered_at_once_are_read_the_same() {
    let mut sample = samples::request_after(None);
    let mut decoder = Decoder::<MAX_BOARD_FRAME>::new();
    let mut count = 0;
    while let Some(request) = sample {
        let expected = match &request {
            Request::PositionsGet => Some(ImmediateRequest::Positions),
            Request::TriggerOutSet(when) => Some(ImmediateRequest::TriggerOut(*when)),
            Request::LaserSet { on } => Some(ImmediateRequest::Laser(*on)),
            _ => None,
        };
        let mut buffer = [0; MAX_BOARD_FRAME];
        let mut bytes = encode(1, &request, &mut buffer).unwrap();
        let mut frame = decoder.next_frame(&mut bytes).unwrap();
        assert_eq!(ImmediateRequest::of(&frame), expected, "{request:?}");
        let is_immediate = request.class() == RequestClass::Immediate;
        assert_eq!(expected.is_some(), is_immediate, "{request:?}");
        let of_a_session = match &request {
            Request::SessionBegin(ask) => Some(SessionRequest::Begin(*ask)),
            Request::SessionProve { signature } => Some(SessionRequest::Prove {
                signature: *signature,
            }),
            _ => None,
        };
        assert_eq!(SessionRequest::of(&frame), of_a_session, "{request:?}");
        count += u32::from(expected.is_some() || of_a_session.is_some());
        // Neither with a byte more, nor of another schema.
        let longer = [frame.payload, &[0]].concat();
        frame.payload = &longer;
        assert_eq!(ImmediateRequest::of(&frame), None);
        assert_eq!(SessionRequest::of(&frame), None);
        frame.payload = &longer[..longer.len() - 1];
        frame.key ^= 1;
        assert_eq!(ImmediateRequest::of(&frame), None);
        assert_eq!(SessionRequest::of(&frame), None);
        sample = samples::request_after(Some(&request));
    }
    assert_eq!(count, 5);
}

#[test]
fn responses_keep_their_bytes() {
    hold_samples::<Response>("response.hex", samples::response_after);
}

#[test]
fn events_keep_their_bytes() {
    hold_samples::<Event>("event.hex", samples::event_after);
}

/// The short way to write that events were dropped gives the same bytes as the long one.
#[test]
fn dropped_events_are_written_the_same() {
    for count in [0, 1, 127, 128, u32::MAX] {
        let (mut short, mut long) = ([0; MAX_BOARD_FRAME], [0; MAX_BOARD_FRAME]);
        assert_eq!(
            encode_dropped(7, count, &mut short).unwrap(),
            encode(7, &Event::Dropped { count }, &mut long).unwrap()
        );
    }
}

/// Also what a journal holds.
#[test]
fn records_keep_their_bytes() {
    hold_samples::<Record>("record.hex", samples::record_after);
}

/// The kind number stored with a journal entry is the number on the wire.
#[test]
fn the_kind_of_a_record_is_its_number() {
    let mut sample = samples::record_after(None);
    let mut count = 0;
    while let Some(record) = sample {
        assert_eq!(record.kind(), count);
        count += 1;
        sample = samples::record_after(Some(&record));
    }
}

/// The greeting that every version understands.
#[test]
fn the_hello_is_frozen() {
    let mut text = String::new();
    for hello in samples::hellos() {
        let mut buffer = [0; 100];
        let bytes = postcard::to_slice(&hello, &mut buffer).unwrap();
        writeln!(
            text,
            "# {} {:016x} {}",
            hello.version,
            hello.key(),
            hello.sender
        )
        .unwrap();
        text.push_str(&hex(bytes));
    }
    hold("hello.hex", &text);
}

/// Whole frames, delimiters and check value included.
#[test]
fn frames_keep_their_bytes() {
    let mut text = String::new();
    let mut buffer = [0; MAX_BOARD_FRAME];
    writeln!(text, "# Hello, sequence 258").unwrap();
    let hello = &samples::hellos()[1];
    text.push_str(&hex(encode(258, hello, &mut buffer).unwrap()));
    writeln!(text, "# Request::StatusGet, sequence 0").unwrap();
    text.push_str(&hex(encode(0, &Request::StatusGet, &mut buffer).unwrap()));
    hold("frame.hex", &text);
}

/// Of every message, whatever its length: no flipped bit gets it through changed.
#[test]
fn no_flipped_bit_is_undetected() {
    fn hold<M: Message>(after: impl Fn(Option<&M>) -> Option<M>) -> u32 {
        let mut flips = 0;
        let mut sample = after(None);
        let mut decoder = Decoder::<MAX_BOARD_FRAME>::new();
        while let Some(message) = sample {
            let mut buffer = [0; MAX_BOARD_FRAME];
            let len = encode(1, &message, &mut buffer).unwrap().len();
            // Between the delimiters: a flipped delimiter damages nothing in between.
            for bit in 8..(len - 1) * 8 {
                buffer[bit / 8] ^= 1 << (bit % 8);
                let mut bytes = &buffer[..len];
                assert!(decoder.next_frame(&mut bytes).is_none(), "bit {bit}");
                buffer[bit / 8] ^= 1 << (bit % 8);
                flips += 1;
            }
            sample = after(Some(&message));
        }
        flips
    }
    let flips =
        hold(samples::request_after) + hold(samples::response_after) + hold(samples::event_after);
    assert!(flips > 15_000, "{flips} flips are few");
}

/// What both sides compare; `schema.txt` says what has changed when it changes.
#[test]
fn the_schema_key_is_pinned() {
    hold(
        "key.hex",
        &format!("# link\n{KEY:016x}\n# record\n{:016x}\n", key::<Record>()),
    );
}

/// The layout of every type, for the eye.
#[test]
fn the_layout_is_pinned() {
    hold(
        "schema.txt",
        &layout::text(&[Request::SCHEMA, Response::SCHEMA, Event::SCHEMA]),
    );
}
