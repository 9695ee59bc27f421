//! Frames: a message as bytes on a pipe, be it USB CDC, UART, TCP or a pseudo-terminal.
//!
//! ```text
//! 00 | stuffed: kind  sequence  key     payload       crc      | 00
//!    |          u8    u16 LE    u32 LE  0..n bytes    u32 LE   |
//! ```
//!
//! * **Delimiter** `00` on both sides; COBS takes the zeros out of everything
//!   between. The leading one cuts off whatever noise stood on the line, so that
//!   garbage between frames never costs a frame.
//! * **Kind**: [`Kind`].
//! * **Sequence**: of a request, chosen by the host; its answer repeats it. Of an
//!   event, the board's count of events, sent or dropped, so that a lost one leaves a gap;
//!   [`Event::Dropped`] follows directly on the gap of those that it tells of.
//! * **Key**: the low 32 bits of the sender's schema key ([`crate::wire::envelope::KEY`]).
//!   A frame with another key is recognised and never opened.
//! * **Payload**: the message in postcard's wire format 1.0; the whole payload,
//!   not one byte more.
//! * **CRC**: CRC-32 (ISO-HDLC, that of Ethernet and zip) over kind to payload. Up to
//!   11 450 bytes it finds every error of up to three bits in the unstuffed
//!   frame (P. Koopman, 32-bit cyclic redundancy codes for internet
//!   applications, DSN 2002) and all but one in 2^32 of the others.
//!
//! # Seals
//!
//! In a session ([`crate::access`]) a request and its answer are of the kinds
//! [`Kind::SealedRequest`] and [`Kind::SealedResponse`], and a seal stands behind the message:
//!
//! ```text
//! payload:  message      counter   code
//!           0..n bytes   u64 LE    16 bytes
//! ```
//!
//! The code is the first half of HMAC-SHA-256, by a key for each direction, over kind, sequence and
//! key as they stand in the frame, the counter, and the message. A host counts each frame that it
//! sends; a board takes none whose counter is not greater than the last one's. An answer has the
//! counter of its request.
//!
//! # Rules of the link
//!
//! * All of the above and the layout of [`crate::wire::hello::Hello`] are frozen for ever: any
//!   two versions can at least say who they are.
//! * The host begins with a Hello; the board answers with its own, same sequence.
//! * One request at a time: the host waits for the answer or gives up. Asking again, it
//!   repeats the sequence, so a late answer still counts.
//! * What the board cannot open (another key, a kind that it does not know, a
//!   payload that does not fit the types) it answers with a Hello of the same
//!   sequence. So the host never waits in vain for a board of another version.
//! * A damaged frame is discarded up to the next delimiter and counted
//!   ([`crate::wire::decoder::FrameCounters`]). Nobody answers it; the host asks again.
//!
//! # Why not postcard-rpc
//!
//! Its typed endpoints would serve, but (version 0.12) it has no check value on
//! a serial line, after an oversized frame it decodes the tail as if it were a frame,
//! and its error answers for such frames are never sent. Here a damaged job or
//! verdict must not get through and every loss is counted, so its framing would have to be
//! replaced; what then remains of it is a dispatch table, which one `match` on
//! [`crate::message::Request`] does. From its family we use postcard and the schema derive.

use core::ops::Range;

use crc::{CRC_32_ISO_HDLC, Crc};
use postcard::Deserializer;
use postcard::de_flavors::Slice;
use serde::{Serialize, Serializer};

use crate::message::{Event, Request, Response};
use crate::wire::cobs::{Full, Stuffer, max_overhead};
use crate::wire::envelope::KEY;
use crate::wire::hello::Hello;

pub use crate::wire::envelope::{Kind, Message};

/// The byte between frames.
pub const DELIMITER: u8 = 0;

/// Bytes before the payload.
const HEADER: usize = 7;
/// Bytes after the payload.
const TRAILER: usize = 4;

static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Bytes of the longest frame with such a payload, delimiters included. Enough
/// for the buffer given to [`encode`] and for a [`crate::wire::decoder::Decoder`].
#[must_use]
pub const fn frame_len(payload: usize) -> usize {
    let content = HEADER + payload + TRAILER;
    2 + content + max_overhead(content)
}

const fn longest(a: usize, b: usize) -> usize {
    if a > b { a } else { b }
}

/// Bytes of a message authentication code in a frame.
pub const CODE: usize = 16;
/// Bytes of a seal: a counter and a code.
pub const SEAL: usize = 8 + CODE;

/// Bytes of the longest frame that a host sends: the board's receive buffer.
pub const MAX_HOST_FRAME: usize = frame_len(longest(Hello::MAX_LEN, Request::MAX_LEN + SEAL));
/// Bytes of the longest frame that a board sends: the host's receive buffer.
pub const MAX_BOARD_FRAME: usize = frame_len(longest(
    Hello::MAX_LEN,
    longest(Response::MAX_LEN + SEAL, Event::MAX_LEN),
));

/// The caller's buffer is too small for the frame; [`frame_len`] says how long
/// it can be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferTooSmall;

impl core::fmt::Display for BufferTooSmall {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("the frame does not fit into its buffer")
    }
}

impl core::error::Error for BufferTooSmall {}

/// Writes a message as a frame, delimiters included, into `out` and returns the
/// part that was written.
///
/// # Errors
/// [`BufferTooSmall`]; never with [`MAX_HOST_FRAME`] or [`MAX_BOARD_FRAME`] bytes.
pub fn encode<'b, M: Message>(
    sequence: u16,
    message: &M,
    out: &'b mut [u8],
) -> Result<&'b [u8], BufferTooSmall> {
    encode_as(M::KIND, sequence, message, out)
}

/// [`Event::Dropped`] as a frame, without the room of the longest event.
///
/// # Errors
/// As [`encode`].
pub fn encode_dropped(sequence: u16, count: u32, out: &mut [u8]) -> Result<&[u8], BufferTooSmall> {
    encode_as(Kind::Event, sequence, &Dropped(count), out)
}

/// Its number among the events is held by the tests of the protocol's bytes.
struct Dropped(u32);

impl Serialize for Dropped {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_newtype_variant("Event", 4, "Dropped", &self.0)
    }
}

fn encode_as<'b>(
    kind: Kind,
    sequence: u16,
    message: &impl Serialize,
    out: &'b mut [u8],
) -> Result<&'b [u8], BufferTooSmall> {
    // All in one buffer, and all messages by one serialiser, that of the journal too: each kind
    // of it costs a board 20 KB. Stuffing goes from the front and never overtakes what it reads.
    let start = 2 + HEADER + max_overhead(out.len());
    let free = out.get_mut(start..).ok_or(BufferTooSmall)?;
    // A message has no reason to fail but a full buffer: all its lengths are known.
    let payload = postcard::to_slice(message, free).map_err(|_| BufferTooSmall)?;
    let end = start + payload.len();
    frame(kind, sequence, out, start..end).map_err(|Full| BufferTooSmall)
}

/// As [`encode`], with a seal.
///
/// # Errors
/// As [`encode`].
pub fn encode_sealed<'b, M: Message>(
    sequence: u16,
    message: &M,
    counter: u64,
    code: &impl Fn(&Authenticated<'_>) -> [u8; CODE],
    out: &'b mut [u8],
) -> Result<&'b [u8], BufferTooSmall> {
    let start = 2 + HEADER + max_overhead(out.len());
    let free = out.get_mut(start..).ok_or(BufferTooSmall)?;
    let (message, rest) = {
        let len = postcard::to_slice(message, free)
            .map_err(|_| BufferTooSmall)?
            .len();
        free.split_at_mut(len)
    };
    let kind = M::KIND.sealed();
    let code = code(&Authenticated {
        header: header(kind, sequence, KEY as u32),
        counter,
        message,
    });
    let seal = rest.get_mut(..SEAL).ok_or(BufferTooSmall)?;
    let (place, code_place) = seal.split_at_mut(8);
    place.copy_from_slice(&counter.to_le_bytes());
    code_place.copy_from_slice(&code);
    let end = start + message.len() + SEAL;
    frame(kind, sequence, out, start..end).map_err(|Full| BufferTooSmall)
}

/// What the code of a seal is made over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Authenticated<'a> {
    /// Kind, sequence and key as they stand in the frame.
    pub header: [u8; HEADER],
    /// The frame's counter.
    pub counter: u64,
    /// The message.
    pub message: &'a [u8],
}

const fn header(kind: Kind, sequence: u16, key: u32) -> [u8; HEADER] {
    let [s0, s1] = sequence.to_le_bytes();
    let [k0, k1, k2, k3] = key.to_le_bytes();
    [kind.number(), s0, s1, k0, k1, k2, k3]
}

/// Stuffs header, payload and check value into a frame; the payload stands in `out` already.
fn frame(kind: Kind, sequence: u16, out: &mut [u8], payload: Range<usize>) -> Result<&[u8], Full> {
    let header = header(kind, sequence, KEY as u32);
    let mut digest = CRC.digest();
    digest.update(&header);
    digest.update(out.get(payload.clone()).ok_or(Full)?);
    let crc = digest.finalize().to_le_bytes();

    *out.first_mut().ok_or(Full)? = DELIMITER;
    let mut stuffer = Stuffer::new(out, 1);
    header.iter().try_for_each(|byte| stuffer.push(*byte))?;
    for at in payload {
        stuffer.push_from(at)?;
    }
    crc.iter().try_for_each(|byte| stuffer.push(*byte))?;
    let (out, end) = stuffer.finish()?;
    *out.get_mut(end).ok_or(Full)? = DELIMITER;
    out.get(..=end).ok_or(Full)
}

/// An intact frame, still unopened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// What it carries.
    pub kind: Kind,
    /// Of a request: the host's choice, repeated by its answer. Of an event: the
    /// board's count of events, sent or dropped.
    pub sequence: u16,
    /// The low 32 bits of the sender's schema key.
    pub key: u32,
    /// The message, unopened.
    pub payload: &'a [u8],
}

/// Why an intact frame cannot be opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OpenError {
    /// The sender's messages are of another schema.
    OtherSchema,
    /// It carries another kind of message.
    OtherKind(Kind),
    /// The payload is not such a message although check value and schema are right: a
    /// fault of the sender's program.
    Malformed,
}

impl<'a> Frame<'a> {
    /// Takes the unstuffed bytes between two delimiters apart, without a look at the
    /// check value; none if they are too short.
    pub(crate) fn split(content: &'a [u8]) -> Option<Self> {
        let (checked, _) = content.split_last_chunk::<TRAILER>()?;
        let ([kind, s0, s1, k0, k1, k2, k3], payload) = checked.split_first_chunk::<HEADER>()?;
        Some(Self {
            kind: Kind::from_number(*kind),
            sequence: u16::from_le_bytes([*s0, *s1]),
            key: u32::from_le_bytes([*k0, *k1, *k2, *k3]),
            payload,
        })
    }

    /// Whether the check value of such bytes is right.
    pub(crate) fn is_intact(content: &[u8]) -> bool {
        content
            .split_last_chunk::<TRAILER>()
            .is_some_and(|(checked, crc)| CRC.checksum(checked) == u32::from_le_bytes(*crc))
    }

    /// The frame without its seal, what the seal's code is to be made over, and the code that it
    /// has; none if it has no seal. Who compares the codes knows whether it was changed.
    #[must_use]
    pub fn unsealed(&self) -> Option<(Self, Authenticated<'a>, &'a [u8; CODE])> {
        let kind = self.kind.unsealed()?;
        let (rest, code) = self.payload.split_last_chunk::<CODE>()?;
        let (message, counter) = rest.split_last_chunk::<8>()?;
        let inner = Self {
            kind,
            payload: message,
            ..*self
        };
        let authenticated = Authenticated {
            header: header(self.kind, self.sequence, self.key),
            counter: u64::from_le_bytes(*counter),
            message,
        };
        Some((inner, authenticated, code))
    }

    /// Whether its sender's messages are ours.
    #[must_use]
    pub const fn is_of_this_schema(&self) -> bool {
        self.key == KEY as u32
    }

    /// Opens the frame.
    ///
    /// # Errors
    /// [`OpenError`]; a message of another schema or kind is never misread.
    pub fn open<M: Message>(&self) -> Result<M, OpenError> {
        self.fits::<M>()?;
        match postcard::take_from_bytes(self.payload) {
            Ok((message, rest)) if M::FROZEN || rest.is_empty() => Ok(message),
            _ => Err(OpenError::Malformed),
        }
    }

    /// What reads the message, for one of kilobytes on a small stack: it is read where it stays. What
    /// is left behind it must be nothing.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn reader<M: Message>(&self) -> Result<Deserializer<'a, Slice<'a>>, OpenError> {
        self.fits::<M>()?;
        Ok(Deserializer::from_bytes(self.payload))
    }

    fn fits<M: Message>(&self) -> Result<(), OpenError> {
        if self.kind != M::KIND {
            return Err(OpenError::OtherKind(self.kind));
        }
        if !M::FROZEN && self.key != KEY as u32 {
            return Err(OpenError::OtherSchema);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
