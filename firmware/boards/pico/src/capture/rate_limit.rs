//! Rate limit of captures: a noisy line must not starve the processor.
//!
//! # Design
//!
//! A few at once, and then so many on average. What comes faster waits in the queue of its
//! machine, which counts what finds no room.

use crate::resources::EXTEND_US;

/// Captures that may still be made, `AT_ONCE` at once and `PER_S` a second on average.
pub struct RateLimit<const AT_ONCE: u32, const PER_S: u32> {
    /// In units of which a capture takes [`Self::EACH`].
    left: u32,
}

impl<const AT_ONCE: u32, const PER_S: u32> RateLimit<AT_ONCE, PER_S> {
    const EACH: u32 = 1_000_000;
    const MOST: u32 = AT_ONCE * Self::EACH;
    const PER_LOOK: u32 = PER_S * EXTEND_US;

    /// As many as may come at once.
    pub const fn new() -> Self {
        Self { left: Self::MOST }
    }

    /// Whether one more may be made.
    pub const fn is_left(&self) -> bool {
        self.left >= Self::EACH
    }

    /// One was made.
    pub const fn spend(&mut self) {
        self.left = self.left.saturating_sub(Self::EACH);
    }

    /// To be called each [`EXTEND_US`].
    pub const fn refill(&mut self) {
        let more = self.left.saturating_add(Self::PER_LOOK);
        self.left = if more < Self::MOST { more } else { Self::MOST };
    }
}
