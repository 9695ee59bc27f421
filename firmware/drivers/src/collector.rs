//! What comes on the control's line, between its interrupt and the application: handed on by the
//! line of text.
//!
//! # Design
//!
//! Each piece that is handed on becomes an entry of the journal, so bytes wait for each other: to
//! the end of a line, to a code that the control means at once (XON, XOFF), until there are many
//! ([`umi_app::board::most_at_once`]), or until no more have come for a while
//! ([`umi_app::board::pause_us`]). Both follow the speed of the line.

use core::cell::RefCell;
use core::future::{Future, poll_fn};
use core::task::Poll;

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::waitqueue::AtomicWaker;
use umi_app::board::{CncInput, most_at_once, pause_us};
use umi_protocol::serial::LineSettings;

use crate::received::Received;

/// What has come in.
struct State<const N: usize> {
    received: Received<N>,
    /// What is there is to be handed on now.
    urgent: bool,
    /// Counts bytes: whether one has come meanwhile.
    came: u32,
    /// So many bytes are handed on without an end of the line; 0: as on an unset line.
    most: usize,
    /// Without another byte for so long; 0: as on an unset line.
    pause_us: u64,
}

/// A ring of `N` bytes between an interrupt and the application.
pub struct Collector<const N: usize> {
    state: Mutex<CriticalSectionRawMutex, RefCell<State<N>>>,
    /// There is something to hand on.
    came: AtomicWaker,
}

impl<const N: usize> Default for Collector<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Collector<N> {
    /// Nothing has come. All zeros.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            state: Mutex::new(RefCell::new(State {
                received: Received::new(),
                urgent: false,
                came: 0,
                most: 0,
                pause_us: 0,
            })),
            came: AtomicWaker::new(),
        }
    }

    /// The line's speed.
    pub fn set_line(&self, line: &LineSettings) {
        self.with(|state| {
            state.most = most_at_once(line);
            state.pause_us = pause_us(line);
        });
    }

    /// What an interrupt has taken from the port: a byte, if one was whole, and then so many that
    /// were lost behind it.
    pub fn take(&self, byte: Option<u8>, lost: u32) {
        let wake = self.with(|state| {
            let was_empty = state.received.is_empty();
            if let Some(byte) = byte {
                state.came = state.came.wrapping_add(1);
                state.received.take(byte);
                state.urgent |= is_urgent(byte) || state.is_long();
            }
            if lost > 0 {
                state.received.lose(lost);
                state.urgent = true;
            }
            was_empty || state.urgent
        });
        if wake == Some(true) {
            self.came.wake();
        }
    }

    /// Waits for the next piece, or for a loss in its place. `wait` waits for so long,
    /// microseconds.
    pub async fn read<Wait: Future>(
        &self,
        buffer: &mut [u8],
        wait: impl Fn(u64) -> Wait,
    ) -> CncInput {
        let mut before = None;
        loop {
            let first = poll_fn(|context| {
                self.came.register(context.waker());
                match self.with(|state| state.received.is_empty()) {
                    Some(false) => Poll::Ready(()),
                    _ => Poll::Pending,
                }
            });
            let more = poll_fn(|context| {
                self.came.register(context.waker());
                match self.with(|state| state.urgent) {
                    Some(true) => Poll::Ready(()),
                    _ => Poll::Pending,
                }
            });
            first.await;
            let pause_us = self.with(|state| state.pause_us()).unwrap_or_default();
            let waited = select(more, wait(pause_us)).await;
            let came = self.with(|state| state.came);
            let is_over = matches!(waited, Either::First(())) || before == came;
            before = came;
            if is_over && let Some(input) = self.with(|state| state.give(buffer)).flatten() {
                return input;
            }
        }
    }

    fn with<R>(&self, work: impl FnOnce(&mut State<N>) -> R) -> Option<R> {
        self.state.lock(|state| {
            state
                .try_borrow_mut()
                .ok()
                .map(|mut state| work(&mut state))
        })
    }
}

impl<const N: usize> State<N> {
    fn give(&mut self, buffer: &mut [u8]) -> Option<CncInput> {
        let given = self.received.give(buffer);
        self.urgent = self.is_long();
        given
    }

    fn is_long(&self) -> bool {
        let most = match self.most {
            0 => most_at_once(&LineSettings::DEFAULT),
            most => most,
        };
        self.received.has_lost() || self.received.len() >= most
    }

    fn pause_us(&self) -> u64 {
        match self.pause_us {
            0 => pause_us(&LineSettings::DEFAULT),
            pause_us => pause_us,
        }
    }
}

/// Whether a byte is not to wait for others: the end of a line or a code for the flow, in ISO
/// with any parity or in EIA.
const fn is_urgent(byte: u8) -> bool {
    matches!(byte & 0x7F, b'\n' | b'\r' | 0x11..=0x14) || byte == 0x80
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::pin::pin;
    use std::vec::Vec;

    use embassy_futures::poll_once;

    use super::*;

    /// Reads whatever is handed on while nothing else comes: `pauses` pauses go by.
    fn read(collector: &Collector<64>, pauses: u32) -> Option<Result<Vec<u8>, u32>> {
        let left = Cell::new(pauses);
        let waited = Cell::new(0);
        let mut buffer = [0; 64];
        let count = {
            let wait = |us| {
                waited.set(us);
                poll_fn(|_| match left.get() {
                    0 => Poll::Pending,
                    more => {
                        left.set(more - 1);
                        Poll::Ready(())
                    }
                })
            };
            let mut reading = pin!(collector.read(&mut buffer, wait));
            match poll_once(reading.as_mut()) {
                Poll::Ready(CncInput::Bytes(count)) => count,
                Poll::Ready(CncInput::Lost(lost)) => return Some(Err(lost)),
                Poll::Ready(CncInput::End) => panic!("a line has no end"),
                Poll::Pending => return None,
            }
        };
        Some(Ok(buffer[..count].to_vec()))
    }

    /// Bytes wait for the end of their line, for a code, or for a pause without another.
    #[test]
    fn bytes_are_handed_on_by_the_line() {
        let collector = Collector::<64>::new();
        for byte in *b"X1.5" {
            collector.take(Some(byte), 0);
        }
        assert_eq!(read(&collector, 0), None);
        collector.take(Some(b'\n'), 0);
        assert_eq!(read(&collector, 0), Some(Ok(b"X1.5\n".to_vec())));
        collector.take(Some(b'X'), 0);
        collector.take(Some(0x93), 0);
        assert_eq!(read(&collector, 0), Some(Ok([b'X', 0x93].to_vec())));
        collector.take(Some(b'Y'), 0);
        assert_eq!(read(&collector, 1), None, "one may have come meanwhile");
        assert_eq!(read(&collector, 2), Some(Ok(b"Y".to_vec())));
    }

    /// An overrun stands behind the byte that came before it, and before the one after.
    #[test]
    fn a_loss_stands_behind_the_byte_that_came_with_it() {
        let collector = Collector::<64>::new();
        collector.take(Some(b'a'), 1);
        collector.take(Some(b'b'), 0);
        assert_eq!(read(&collector, 0), Some(Ok(b"a".to_vec())));
        assert_eq!(read(&collector, 0), Some(Err(1)));
        assert_eq!(read(&collector, 2), Some(Ok(b"b".to_vec())));
        // A broken byte is a loss by itself.
        collector.take(None, 1);
        assert_eq!(read(&collector, 0), Some(Err(1)));
    }

    /// At 300 baud no byte waits for 64 others: that would be two seconds.
    #[test]
    fn pieces_follow_the_speed() {
        let collector = Collector::<64>::new();
        let at = |baud| LineSettings {
            baud,
            ..LineSettings::DEFAULT
        };
        for (baud, pieces) in [(300, 6), (115_200, 64)] {
            collector.set_line(&at(baud));
            for n in 1..=pieces {
                assert_eq!(read(&collector, 0), None, "{baud}: {n}");
                collector.take(Some(b'7'), 0);
            }
            let handed = read(&collector, 0).unwrap().unwrap();
            assert_eq!(handed.len(), pieces, "{baud}");
        }
    }
}
