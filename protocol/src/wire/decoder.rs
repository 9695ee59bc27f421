//! Decoder: frames out of a stream of bytes, whatever else is in it.

use crate::wire::cobs::Unstuffer;
use crate::wire::frame::{DELIMITER, Frame};

/// Finds frames in a stream of bytes with a buffer of `N` bytes
/// ([`crate::wire::frame::MAX_HOST_FRAME`] on a board, [`crate::wire::frame::MAX_BOARD_FRAME`] on a host).
///
/// After any damage it discards up to the next delimiter and counts what it
/// discarded; a tail is never taken for a frame.
#[derive(Clone, Debug)]
pub struct Decoder<const N: usize> {
    content: [u8; N],
    /// Bytes of `content` in use.
    len: usize,
    unstuffer: Unstuffer,
    /// Bytes since the last delimiter.
    taken: u32,
    counters: FrameCounters,
}

/// What a decoder has seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounters {
    /// Intact frames.
    pub frames: u32,
    /// Stretches between delimiters that are no stuffed bytes or too short for a
    /// frame: noise, text of another program, the rest of a torn frame.
    pub garbage: u32,
    /// Stretches with the shape of a frame and a wrong check value.
    pub crc_errors: u32,
    /// Stretches longer than any frame.
    pub overflows: u32,
    /// Bytes in all that was discarded.
    pub bytes_discarded: u32,
}

impl FrameCounters {
    /// Stretches that were discarded.
    #[must_use]
    pub const fn damaged(&self) -> u32 {
        self.garbage
            .saturating_add(self.crc_errors)
            .saturating_add(self.overflows)
    }

    /// What was seen since an earlier state.
    #[must_use]
    pub const fn since(&self, earlier: &Self) -> Self {
        Self {
            frames: self.frames.saturating_sub(earlier.frames),
            garbage: self.garbage.saturating_sub(earlier.garbage),
            crc_errors: self.crc_errors.saturating_sub(earlier.crc_errors),
            overflows: self.overflows.saturating_sub(earlier.overflows),
            bytes_discarded: self.bytes_discarded.saturating_sub(earlier.bytes_discarded),
        }
    }
}

impl<const N: usize> Decoder<N> {
    /// A decoder that has seen nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            content: [0; N],
            len: 0,
            unstuffer: Unstuffer::new(),
            taken: 0,
            counters: FrameCounters {
                frames: 0,
                garbage: 0,
                crc_errors: 0,
                overflows: 0,
                bytes_discarded: 0,
            },
        }
    }

    /// What it has seen.
    #[must_use]
    pub const fn counters(&self) -> FrameCounters {
        self.counters
    }

    /// Takes bytes from the front of `bytes` until a frame is complete or no byte
    /// is left. Call it until it returns `None`, then receive more.
    pub fn next_frame(&mut self, bytes: &mut &[u8]) -> Option<Frame<'_>> {
        let mut complete = None;
        while let Some((byte, rest)) = bytes.split_first() {
            *bytes = rest;
            if let Some(len) = self.take(*byte) {
                complete = Some(len);
                break;
            }
        }
        // Its check value was found right in the loop.
        Frame::split(self.content.get(..complete?)?)
    }

    /// Takes one byte; the length of the content if it completes an intact frame.
    fn take(&mut self, byte: u8) -> Option<usize> {
        if byte != DELIMITER {
            self.taken = self.taken.saturating_add(1);
            if let Some(byte) = self.unstuffer.push(byte) {
                // `len` grows beyond the buffer: that is how an overflow is known.
                if let Some(place) = self.content.get_mut(self.len) {
                    *place = byte;
                }
                self.len = self.len.saturating_add(1);
            }
            return None;
        }
        let (len, taken, complete) = (self.len, self.taken, self.unstuffer.is_complete());
        self.len = 0;
        self.taken = 0;
        self.unstuffer = Unstuffer::new();
        if taken == 0 {
            return None;
        }
        let counter = match self.content.get(..len) {
            None => &mut self.counters.overflows,
            Some(content) if !complete || Frame::split(content).is_none() => {
                &mut self.counters.garbage
            }
            Some(content) if !Frame::is_intact(content) => &mut self.counters.crc_errors,
            Some(_) => {
                self.counters.frames = self.counters.frames.saturating_add(1);
                return Some(len);
            }
        };
        *counter = counter.saturating_add(1);
        self.counters.bytes_discarded = self.counters.bytes_discarded.saturating_add(taken);
        None
    }
}

impl<const N: usize> Default for Decoder<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests;
