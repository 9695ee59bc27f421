//! Reading n belongs to latch n.

use heapless::Deque;

use crate::units::Micros;

/// Latches that wait for their readings at most: a sensor that is this far behind is lost.
const WAITING: usize = 64;

/// Where the axes were at a trigger pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::point::station) struct Latched {
    pub number: u32,
    pub counts: [i64; 3],
    /// Nothing is made of it: a pulse that came after the last one that was asked for.
    pub is_surplus: bool,
    at: Micros,
}

/// Latches without a reading yet, and the numbers of both.
#[derive(Debug, Default)]
pub(in crate::point::station) struct Pairing {
    waiting: Deque<Latched, WAITING>,
    next: u32,
    /// Number of a reading less that of its latch.
    ahead: u32,
}

impl Pairing {
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    #[cfg(test)]
    pub fn next(&self) -> u32 {
        self.next
    }

    /// The axes are latched; the oldest latch, if it had to go for this one.
    pub fn latched(&mut self, counts: [i64; 3], at: Micros, is_surplus: bool) -> Option<Latched> {
        let gone = if self.waiting.is_full() {
            self.waiting.pop_front()
        } else {
            None
        };
        let number = self.next;
        self.next = self.next.wrapping_add(1);
        // There is room now.
        let _ = self.waiting.push_back(Latched {
            number,
            counts,
            is_surplus,
            at,
        });
        gone
    }

    /// So many edges were captured by the sensor and not by the board.
    pub fn missed(&mut self, count: u32) {
        self.next = self.next.wrapping_add(count);
    }

    /// How many latches are to come until that of a reading; none if it is there, or was.
    pub fn is_ahead(&self, reading: u32) -> Option<u32> {
        let number = reading.wrapping_sub(self.ahead);
        let ahead = number.wrapping_sub(self.next);
        (ahead < WAITING as u32).then_some(ahead)
    }

    /// What has come is not waited for any more.
    pub fn give_up(&mut self) {
        for latch in &mut self.waiting {
            latch.is_surplus = true;
        }
    }

    /// This reading belongs to the latch that waits.
    pub fn join(&mut self, reading: u32) {
        if let Some(latch) = self.waiting.front() {
            self.ahead = reading.wrapping_sub(latch.number);
        }
    }

    /// The latch of a reading.
    pub fn take(&mut self, reading: u32) -> Option<Latched> {
        let number = reading.wrapping_sub(self.ahead);
        let is_next = self.waiting.front().is_some_and(|l| l.number == number);
        if is_next {
            self.waiting.pop_front()
        } else {
            None
        }
    }

    /// A latch that a later one's reading has passed.
    pub fn before(&mut self, reading: u32) -> Option<Latched> {
        let number = reading.wrapping_sub(self.ahead);
        let newest = self.waiting.back()?.number;
        // Only where its own latch is there: a number from nowhere loses nothing.
        let is_here = newest.wrapping_sub(number) < WAITING as u32;
        let first = self.waiting.front()?.number;
        let is_passed = number.wrapping_sub(first).wrapping_sub(1) < WAITING as u32;
        if is_here && is_passed {
            self.waiting.pop_front()
        } else {
            None
        }
    }

    /// A latch that has waited since before this.
    pub fn older_than(&mut self, since: Micros) -> Option<Latched> {
        let is_late = self.waiting.front()?.at < since;
        if is_late {
            self.waiting.pop_front()
        } else {
            None
        }
    }

    /// The oldest latch that waits.
    pub fn oldest(&mut self) -> Option<Latched> {
        self.waiting.pop_front()
    }
}
