//! What came in and waits to be measured, in the order in which it came.
//!
//! # Design
//!
//! A queue of a fixed number of places. Bytes that follow bytes go into the same place
//! until it is full, so that the room for them does not depend on how a driver hands
//! them on: one by one at a high rate is the usual way. A latch takes a place of its
//! own, and the bytes after it the next: a probe's capture stays before the line that
//! the control prints about it.
//!
//! What finds no room is counted, and the count takes the lost bytes' place: nothing
//! goes in behind a loss before it.
//!
//! When three quarters of the places are taken the intake is pressed, and until no more than
//! half is, which is what latches may take: a control that can be held is held so long
//! (`throttle`).

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use heapless::{Deque, Vec};
use umi_core::units::Micros;

use umi_protocol::latch::{LatchReport, Scan};

/// Bytes of one input, at most: small, so that many short lines can wait.
pub const PIECE: usize = 64;

/// Raw bytes of one input.
pub type Bytes = Vec<u8, PIECE>;

/// What comes in on the control's port, with the time of its last byte.
#[derive(Clone, Debug)]
pub enum Input {
    /// Bytes.
    Bytes(Bytes),
    /// Bytes were lost before they could be handed on.
    Lost(u32),
    /// The input ended.
    End,
    /// The axes were captured at an edge of the probe or an index mark.
    Latch(LatchReport),
    /// A scan is over.
    Scan(Scan),
    /// The board's button was held.
    Held,
}

/// Places: 6 KB of bytes, which is 0.5 s at 115200 baud without a pause. Fits take a fraction
/// of that, but for cylinders and cones on a processor without a floating-point unit.
pub const PLACES: usize = 96;

/// Places that only bytes may take: 0.27 s. A line of the probe's that is nothing but noise
/// must not cost what the control says.
const FOR_BYTES: usize = PLACES / 2;
/// Places that anything else may take.
pub const OTHER_PLACES: usize = PLACES - FOR_BYTES;

/// Places taken from which on the intake is pressed, and down to which it stays so.
const PRESSED: usize = PLACES / 4 * 3;
const RELIEVED: usize = OTHER_PLACES;

/// Inputs that wait to be measured.
pub(crate) struct Intake {
    state: Mutex<CriticalSectionRawMutex, RefCell<State>>,
    not_empty: Signal<CriticalSectionRawMutex, ()>,
    not_full: Signal<CriticalSectionRawMutex, ()>,
    /// It is pressed, or is no more.
    pressure_changed: Signal<CriticalSectionRawMutex, ()>,
}

struct State {
    waiting: Deque<(Micros, Input), PLACES>,
    /// Bytes that found no room, and since when.
    lost: u32,
    lost_at: Micros,
    is_pressed: bool,
}

/// There is no room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Full;

impl Intake {
    /// Nothing waits.
    pub const fn new() -> Self {
        Self {
            state: Mutex::new(RefCell::new(State {
                waiting: Deque::new(),
                lost: 0,
                lost_at: Micros(0),
                is_pressed: false,
            })),
            not_empty: Signal::new(),
            not_full: Signal::new(),
            pressure_changed: Signal::new(),
        }
    }

    fn with<T>(&self, work: impl FnOnce(&mut State) -> T) -> T {
        let (done, has_turned) = self.state.lock(|state| {
            let state = &mut *state.borrow_mut();
            (work(state), state.press())
        });
        if has_turned {
            self.pressure_changed.signal(());
        }
        done
    }

    /// More has come than is measured.
    pub fn is_pressed(&self) -> bool {
        self.with(|state| state.is_pressed)
    }

    /// Waits until it may have become pressed, or may be no more.
    pub async fn pressure_changed(&self) {
        self.pressure_changed.wait().await;
    }

    /// Re-checks the throttle.
    pub fn recheck_pressure(&self) {
        self.pressure_changed.signal(());
    }

    /// Bytes from the control, the last of them now.
    pub fn bytes(&self, now: Micros, bytes: &[u8]) {
        self.with(|state| state.bytes(now, bytes));
        self.not_empty.signal(());
    }

    /// Bytes from the control were lost before they came here.
    pub fn lost(&self, now: Micros, count: u32) {
        self.with(|state| {
            state.lose(now, count);
            state.tell_lost();
        });
        self.not_empty.signal(());
    }

    /// Anything but bytes, for which some room is kept.
    ///
    /// # Errors
    /// [`Full`]: it did not go in.
    pub fn put(&self, now: Micros, input: Input) -> Result<(), Full> {
        let put = self.with(|state| {
            if state.lost > 0 || state.waiting.len() >= OTHER_PLACES {
                return Err(Full);
            }
            state.waiting.push_back((now, input)).map_err(|_| Full)
        });
        self.not_empty.signal(());
        put
    }

    /// As [`Self::put`], but waits for room.
    pub async fn put_when_there_is_room(&self, now: Micros, input: Input) {
        while self.put(now, input.clone()).is_err() {
            self.not_full.wait().await;
        }
    }

    /// Waits for the oldest input.
    pub async fn next(&self) -> (Micros, Input) {
        loop {
            let next = self.with(|state| {
                let next = state.waiting.pop_front();
                state.tell_lost();
                next
            });
            if let Some(next) = next {
                self.not_full.signal(());
                return next;
            }
            self.not_empty.wait().await;
        }
    }
}

impl State {
    fn bytes(&mut self, now: Micros, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() && self.lost == 0 {
            if let Some((time, Input::Bytes(last))) = self.waiting.back_mut()
                && !last.is_full()
            {
                let room = last.capacity() - last.len();
                let (now_in, later) = rest.split_at(room.min(rest.len()));
                // There is room: just looked.
                let _ = last.extend_from_slice(now_in);
                *time = now;
                rest = later;
            } else if self
                .waiting
                .push_back((now, Input::Bytes(Bytes::new())))
                .is_err()
            {
                break;
            }
        }
        self.lose(now, u32::try_from(rest.len()).unwrap_or(u32::MAX));
    }

    /// Whether it is pressed now and was not, or the reverse.
    fn press(&mut self) -> bool {
        let before = self.is_pressed;
        let least = if before { RELIEVED + 1 } else { PRESSED };
        self.is_pressed = self.waiting.len() >= least;
        self.is_pressed != before
    }

    fn lose(&mut self, now: Micros, count: u32) {
        if count > 0 {
            self.lost = self.lost.saturating_add(count);
            self.lost_at = now;
        }
    }

    /// The count of what was lost takes its place as soon as there is one.
    fn tell_lost(&mut self) {
        let lost = (self.lost_at, Input::Lost(self.lost));
        if self.lost > 0 && self.waiting.push_back(lost).is_ok() {
            self.lost = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec::Vec;

    use embassy_futures::block_on;
    use umi_protocol::latch::{LatchCause, LatchReport};

    use super::*;

    const LATCH: LatchReport = LatchReport {
        number: 0,
        cause: LatchCause::Skip,
        counts: heapless::Vec::new(),
        t_ns: 0,
        missed: 0,
    };

    fn next(intake: &Intake) -> (u64, Input) {
        let (time, input) = block_on(intake.next());
        (time.0, input)
    }

    fn is_empty(intake: &Intake) -> bool {
        intake.with(|state| state.waiting.is_empty() && state.lost == 0)
    }

    /// Room for bytes does not depend on the pieces in which they come, and their time is
    /// that of the last one.
    #[test]
    fn single_bytes_fill_whole_places() {
        let intake = Intake::new();
        let count = PLACES * PIECE;
        for n in 0..count {
            intake.bytes(Micros(n as u64), &[n as u8]);
        }
        for place in 0..PLACES {
            let (time, Input::Bytes(bytes)) = next(&intake) else {
                panic!("only bytes came");
            };
            assert_eq!(time as usize, (place + 1) * PIECE - 1);
            let expected: Vec<u8> = (place * PIECE..(place + 1) * PIECE)
                .map(|n| n as u8)
                .collect();
            assert_eq!(bytes, *expected);
        }
        assert!(is_empty(&intake));
    }

    /// A latch stays where it came: after the bytes before it, before those after it.
    #[test]
    fn latches_keep_their_place_among_bytes() {
        let intake = Intake::new();
        intake.bytes(Micros(1), b"ab");
        intake.put(Micros(2), Input::Latch(LATCH)).unwrap();
        intake.bytes(Micros(3), b"c");
        intake.bytes(Micros(4), b"d");
        assert!(matches!(next(&intake), (1, Input::Bytes(b)) if b == *b"ab"));
        assert!(matches!(next(&intake), (2, Input::Latch(_))));
        assert!(matches!(next(&intake), (4, Input::Bytes(b)) if b == *b"cd"));
        assert!(is_empty(&intake));
    }

    /// However many latches come, bytes find the room that is kept for them.
    #[test]
    fn latches_leave_room_for_bytes() {
        let intake = Intake::new();
        let put = (0..PLACES).filter(|_| intake.put(Micros(1), Input::Latch(LATCH)).is_ok());
        assert_eq!(put.count(), OTHER_PLACES);
        for n in 0..FOR_BYTES * PIECE {
            intake.bytes(Micros(2), &[n as u8]);
        }
        for _ in 0..OTHER_PLACES {
            assert!(matches!(next(&intake), (1, Input::Latch(_))));
        }
        for _ in 0..FOR_BYTES {
            assert!(matches!(next(&intake), (2, Input::Bytes(b)) if b.is_full()));
        }
        assert!(is_empty(&intake));
    }

    /// Every byte is either handed on or counted, and the count stands where they are
    /// missing: before what came after them.
    #[test]
    fn a_loss_takes_the_place_of_what_is_lost() {
        let intake = Intake::new();
        let long = [b'x'; PIECE];
        for n in 0..PLACES as u64 {
            intake.bytes(Micros(n), &long);
        }
        intake.bytes(Micros(100), b"lost");
        assert_eq!(intake.put(Micros(101), Input::Latch(LATCH)), Err(Full));
        intake.lost(Micros(102), 3);
        for n in 0..PLACES as u64 {
            assert!(matches!(next(&intake), (t, Input::Bytes(_)) if t == n));
            // The first place that is free is the count's.
            if n == 0 {
                intake.bytes(Micros(103), b"behind");
            }
        }
        assert!(matches!(next(&intake), (102, Input::Lost(7))));
        // No place was free for what came behind it at once: it is lost, too, and told.
        assert!(matches!(next(&intake), (103, Input::Lost(6))));
        intake.bytes(Micros(104), b"again");
        assert!(matches!(next(&intake), (104, Input::Bytes(b)) if b == *b"again"));
        assert!(is_empty(&intake));
    }
}
