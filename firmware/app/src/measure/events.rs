//! What waits to be told to the host.
//!
//! A ring of complete frames. Measuring puts them in and never waits; the link
//! takes them out when the host reads. A frame that finds no room is dropped
//! and counted, and the host is told so as soon as there is room again: the
//! journal has the records.

use heapless::Deque;
use umi_protocol::frame::{self, MAX_BOARD_FRAME};
use umi_protocol::message::Event;

/// Bytes of frames that can wait: more than two of the longest, or some two hundred lines. So many that
/// the rings of the Pico, which stand at a round address behind all of this, lose no page.
const CAPACITY: usize = 3 * MAX_BOARD_FRAME - 3072;
/// A frame's length stands before it.
const PREFIX: usize = 2;

/// Frames that wait for the host.
pub struct Events {
    bytes: Deque<u8, CAPACITY>,
    /// Where a frame is made.
    scratch: [u8; MAX_BOARD_FRAME],
    /// Counts events, sent or dropped, so that a lost one leaves a gap.
    sequence: u16,
    /// Dropped since the host was last told.
    untold: u32,
    dropped: u32,
    on: bool,
}

impl Events {
    /// Nothing waits, and nothing will until [`Self::switch`].
    pub const fn new() -> Self {
        Self {
            bytes: Deque::new(),
            scratch: [0; MAX_BOARD_FRAME],
            sequence: 0,
            untold: 0,
            dropped: 0,
            on: false,
        }
    }

    /// Begins or stops to collect events.
    pub fn switch(&mut self, on: bool) {
        if !on {
            self.bytes.clear();
        }
        self.on = on;
    }

    /// Whether anybody wants events.
    pub const fn is_on(&self) -> bool {
        self.on
    }

    /// Events dropped since the start.
    pub const fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Puts an event in, or counts it as dropped.
    pub fn push(&mut self, event: &Event) {
        if !self.on {
            return;
        }
        if self.untold > 0 {
            self.tell_dropped();
        }
        if self.untold > 0 || !self.try_push(event) {
            self.untold = self.untold.saturating_add(1);
            self.dropped = self.dropped.saturating_add(1);
            self.sequence = self.sequence.wrapping_add(1);
        }
    }

    /// Without an event of its own, which would be five kilobytes of the stack.
    fn tell_dropped(&mut self) {
        let made = frame::encode_dropped(self.sequence, self.untold, &mut self.scratch);
        if made.is_ok_and(|frame| put(&mut self.bytes, frame)) {
            self.sequence = self.sequence.wrapping_add(1);
            self.untold = 0;
        }
    }

    #[inline(never)]
    fn try_push(&mut self, event: &Event) -> bool {
        let made = frame::encode(self.sequence, event, &mut self.scratch);
        if !made.is_ok_and(|frame| put(&mut self.bytes, frame)) {
            return false;
        }
        self.sequence = self.sequence.wrapping_add(1);
        true
    }

    /// Takes the oldest frame out; none if nothing waits.
    pub fn pop<'b>(&mut self, into: &'b mut [u8; MAX_BOARD_FRAME]) -> Option<&'b [u8]> {
        let length = u16::from_le_bytes([self.bytes.pop_front()?, self.bytes.pop_front()?]);
        let frame = into.get_mut(..usize::from(length))?;
        for place in frame.iter_mut() {
            *place = self.bytes.pop_front()?;
        }
        Some(frame)
    }
}

/// Puts a frame in, if there is room.
#[inline(never)]
fn put(bytes: &mut Deque<u8, CAPACITY>, frame: &[u8]) -> bool {
    let Ok(length) = u16::try_from(frame.len()) else {
        return false;
    };
    if CAPACITY - bytes.len() < PREFIX + frame.len() {
        return false;
    }
    for byte in length.to_le_bytes().iter().chain(frame) {
        // There is room: just looked.
        let _ = bytes.push_back(*byte);
    }
    true
}
