//! Receive buffer of a line: unread bytes, and each loss in its place.

use heapless::Deque;
use umi_app::board::CncInput;

/// A ring of `N` bytes between an interrupt and the application.
///
/// Loss is told where it happened: behind the bytes that came before it, and before
/// those that came after. A second loss that comes before the first is told is told
/// with it: between the two there are bytes that nothing can rest on.
///
/// ```
/// use umi_app::board::CncInput;
/// use umi_drivers::received::Received;
///
/// let mut received = Received::<8>::new();
/// received.take(b'X');
/// received.lose(1);
/// received.take(b'5');
/// let mut buffer = [0; 4];
/// assert_eq!(received.give(&mut buffer), Some(CncInput::Bytes(1)));
/// assert_eq!(received.give(&mut buffer), Some(CncInput::Lost(1)));
/// assert_eq!(received.give(&mut buffer), Some(CncInput::Bytes(1)));
/// assert_eq!(received.give(&mut buffer), None);
/// ```
#[derive(Debug, Default)]
pub struct Received<const N: usize> {
    bytes: Deque<u8, N>,
    /// Bytes in the ring that came before the loss.
    before_loss: usize,
    lost: u32,
}

impl<const N: usize> Received<N> {
    /// Nothing has come.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            bytes: Deque::new(),
            before_loss: 0,
            lost: 0,
        }
    }

    /// A byte has come. Without room for it, it is lost.
    pub fn take(&mut self, byte: u8) {
        if self.bytes.push_back(byte).is_err() {
            self.lose(1);
        }
    }

    /// So many bytes were lost.
    pub fn lose(&mut self, count: u32) {
        if self.lost == 0 {
            self.before_loss = self.bytes.len();
        }
        self.lost = self.lost.saturating_add(count);
    }

    /// Bytes that wait.
    #[must_use]
    pub fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Nothing waits: neither a byte nor a loss.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty() && self.lost == 0
    }

    /// A loss waits to be told.
    #[must_use]
    pub const fn has_lost(&self) -> bool {
        self.lost > 0
    }

    /// What comes next: bytes, copied into `buffer`, or a loss. `None`: nothing.
    pub fn give(&mut self, buffer: &mut [u8]) -> Option<CncInput> {
        let ready = match self.lost {
            0 => self.bytes.len(),
            _ if self.before_loss == 0 => {
                return Some(CncInput::Lost(core::mem::take(&mut self.lost)));
            }
            _ => self.before_loss,
        };
        let mut count = 0;
        for place in buffer.iter_mut().take(ready) {
            *place = self.bytes.pop_front()?;
            count += 1;
        }
        self.before_loss = self.before_loss.saturating_sub(count);
        (count > 0).then_some(CncInput::Bytes(count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    #[derive(Clone, Copy, Debug)]
    enum Step {
        Take(u8),
        Lose(u32),
        Read(usize),
    }

    fn step() -> impl Strategy<Value = Step> {
        prop_oneof![
            8 => any::<u8>().prop_map(Step::Take),
            1 => (1_u32..4).prop_map(Step::Lose),
            2 => (1_usize..9).prop_map(Step::Read),
        ]
    }

    proptest! {
        /// What is read is what came, in order, less what is told as lost; and every
        /// byte that was lost is told.
        #[test]
        fn nothing_vanishes(steps in prop::collection::vec(step(), 0..300)) {
            let mut received = Received::<16>::new();
            let (mut sent, mut lost) = (Vec::new(), 0);
            let (mut read, mut told) = (Vec::new(), 0);
            let drain = [Step::Read(8); 12];
            for step in steps.into_iter().chain(drain) {
                match step {
                    Step::Take(byte) => sent.push(byte),
                    Step::Lose(count) => lost += count,
                    Step::Read(_) => {}
                }
                match step {
                    Step::Take(byte) => received.take(byte),
                    Step::Lose(count) => received.lose(count),
                    Step::Read(most) => {
                        let mut buffer = [0; 8];
                        match received.give(&mut buffer[..most]) {
                            Some(CncInput::Bytes(count)) => {
                                read.extend_from_slice(&buffer[..count]);
                            }
                            Some(CncInput::Lost(count)) => told += count,
                            Some(CncInput::End) => prop_assert!(false, "a line has no end"),
                            None => {}
                        }
                    }
                }
            }
            let missing = sent.len() - read.len();
            prop_assert_eq!(told as usize, missing + lost as usize);
            let mut rest = sent.iter();
            prop_assert!(read.iter().all(|byte| rest.any(|sent| sent == byte)), "in order");
        }
    }

    /// A full ring keeps what came first and tells the rest behind it.
    #[test]
    fn a_full_ring() {
        let mut received = Received::<4>::new();
        for byte in 0..10 {
            received.take(byte);
        }
        let mut buffer = [0; 8];
        assert_eq!(received.give(&mut buffer), Some(CncInput::Bytes(4)));
        assert_eq!(buffer[..4], [0, 1, 2, 3]);
        assert_eq!(received.give(&mut buffer), Some(CncInput::Lost(6)));
        assert_eq!(received.give(&mut buffer), None);
        assert_eq!(received.give(&mut []), None);
    }
}
