//! Holds the control when what it sends waits for too long to be measured.
//!
//! # Design
//!
//! XOFF goes out while a quarter of the intake's places is still free, XON when no more than
//! half is taken: 1.5 KB, where a control may send ten characters more after XOFF. XON is also
//! said when the job is taken up: the board may have been reset after it had said XOFF.
//!
//! Nothing waits for a control that does not take the code, as its CTS is gone: a code counts as
//! said when it has left, and one that has not is tried again.
//!
//! Only for a job whose control obeys ([`Handshake::XonXoff`]): for the others the codes would
//! be text. What finds no room is told as lost, with and without.
//!
//! # Limitations
//!
//! While blocks of XMODEM are on their way nothing is said: they have no code for it, and wait
//! for each other.
//!
//! XON is said once: a control to which it does not come stays held until its operator resets
//! it. One that was held when the board was reset, with odd parity that the job does not name,
//! gets it without.

use core::future::Future;
use core::pin::pin;
use core::sync::atomic::{AtomicU8, Ordering};

use embassy_futures::select::{Either, select};
use umi_core::journal::Flash;
use umi_protocol::pattern::{Coding, Handshake};

use crate::App;
use crate::board::CncTx;
use crate::cnc::{PARITY, XOFF, XON};

/// Nothing is said, or was.
const SILENT: u8 = 0;
/// The control may send.
const FREE: u8 = 1;
/// It may not.
const HELD: u8 = 2;

/// What the control has been told.
pub(crate) struct Hold {
    /// What it is told while there is room.
    idle: AtomicU8,
    said: AtomicU8,
    /// What parity adds to the codes. Zeros at first, as all of the application.
    in_xon: AtomicU8,
    in_xoff: AtomicU8,
}

impl Hold {
    pub const fn new() -> Self {
        Self {
            idle: AtomicU8::new(SILENT),
            said: AtomicU8::new(SILENT),
            in_xon: AtomicU8::new(0),
            in_xoff: AtomicU8::new(0),
        }
    }

    /// Notes what the job says of the control. Whether that is something new.
    pub fn note(&self, handshake: Handshake) -> bool {
        let idle = match handshake {
            Handshake::None => SILENT,
            Handshake::XonXoff => FREE,
        };
        let before = self.idle.load(Ordering::Relaxed);
        self.idle.store(idle, Ordering::Relaxed);
        idle != before
    }

    /// Notes the code in which the control writes. In EIA both are as in ISO.
    pub fn note_coding(&self, coding: Coding) {
        let (in_xon, in_xoff) = match coding {
            Coding::Auto | Coding::Ascii => (0, 0),
            Coding::IsoEven | Coding::Eia => (0, PARITY),
            Coding::AsciiOdd => (PARITY, 0),
        };
        self.in_xon.store(in_xon, Ordering::Relaxed);
        self.in_xoff.store(in_xoff, Ordering::Relaxed);
    }

    /// What the control should have been told.
    fn wanted(&self, is_pressed: bool) -> u8 {
        match self.idle.load(Ordering::Relaxed) {
            FREE if is_pressed => HELD,
            idle => idle,
        }
    }

    /// The code that says so, if it has not been said.
    fn word(&self, want: u8) -> Option<u8> {
        match (self.said.load(Ordering::Relaxed), want) {
            (SILENT | FREE, HELD) => Some(XOFF | self.in_xoff.load(Ordering::Relaxed)),
            (SILENT | HELD, FREE) | (HELD, SILENT) => {
                Some(XON | self.in_xon.load(Ordering::Relaxed))
            }
            _ => None,
        }
    }
}

/// Does some work, and meanwhile holds the control or lets it go.
pub(crate) async fn meanwhile<F: Flash, T>(
    app: &App<F>,
    tx: &mut impl CncTx,
    work: impl Future<Output = T>,
) -> T {
    let mut work = pin!(work);
    loop {
        let word = async {
            app.intake.turned().await;
            say(app, tx).await;
        };
        if let Either::Second(done) = select(word, &mut work).await {
            // A word that was on its way is tried again.
            app.intake.turn();
            return done;
        }
    }
}

/// Says what is to be said.
pub(crate) async fn say<F: Flash>(app: &App<F>, tx: &mut impl CncTx) {
    let hold = &app.flow.hold;
    let want = hold.wanted(app.intake.is_pressed());
    if let Some(word) = hold.word(want) {
        // On a broken line there is nobody to be told.
        let _ = tx.write(word).await;
    }
    hold.said.store(want, Ordering::Relaxed);
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::cell::RefCell;
    use std::vec::Vec;

    use embassy_futures::poll_once;
    use proptest::prelude::*;
    use umi_core::units::Micros;

    use super::*;
    use crate::board::Broken;
    use crate::intake::PLACES;
    use crate::measure::{Input, PIECE};
    use crate::test_board::{Hand, NoFlash};

    /// Characters that a control sends behind an XOFF, at most.
    const TEN: usize = 10;

    /// What the board says, not yet heard.
    struct Line<'a>(&'a RefCell<Vec<u8>>);

    impl CncTx for Line<'_> {
        async fn write(&mut self, byte: u8) -> Result<(), Broken> {
            self.0.borrow_mut().push(byte);
            Ok(())
        }
    }

    /// A control sends as many bytes as it may, and so many inputs are measured then; several
    /// times. Returns how many it sent, how many were measured and lost, and what it was told.
    fn session(handshake: Handshake, turns: &[(usize, usize)]) -> (usize, usize, u32, Vec<u8>) {
        let (app, clock) = (App::<NoFlash>::new(), Hand::default());
        let said = RefCell::new(Vec::new());
        let mut line = Line(&said);
        let mut transmit = pin!(app.transmit(&mut line, &clock));
        if app.flow.hold.note(handshake) {
            app.intake.turn();
        }
        let (mut sent, mut measured, mut lost) = (0, 0, 0);
        let mut told = Vec::new();
        let mut left = usize::MAX;
        let rest = (0, PLACES + 1);
        for (sends, measures) in turns.iter().chain([&rest]) {
            for _ in 0..*sends {
                assert!(poll_once(transmit.as_mut()).is_pending());
                for word in said.borrow_mut().drain(..) {
                    left = if word == XOFF { TEN } else { usize::MAX };
                    told.push(word);
                }
                if left > 0 {
                    left -= 1;
                    sent += 1;
                    app.intake.bytes(Micros(0), b"7");
                }
            }
            for _ in 0..*measures {
                match poll_once(app.intake.next()) {
                    core::task::Poll::Ready((_, Input::Bytes(bytes))) => measured += bytes.len(),
                    core::task::Poll::Ready((_, Input::Lost(count))) => lost += count,
                    _ => {}
                }
            }
        }
        assert!(poll_once(transmit.as_mut()).is_pending());
        told.extend(said.borrow_mut().drain(..));
        (sent, measured, lost, told)
    }

    proptest! {
        /// A control that sends ten characters behind each XOFF loses nothing, however slowly
        /// it is measured; it is let go at the end.
        #[test]
        fn nothing_is_lost(turns in prop::collection::vec((0_usize..9_000, 0_usize..40), 1..12)) {
            let (sent, measured, lost, told) = session(Handshake::XonXoff, &turns);
            prop_assert_eq!((measured, lost), (sent, 0));
            prop_assert!(told.iter().enumerate().all(|(n, word)| *word == [XON, XOFF][n % 2]));
            prop_assert_eq!(told.last(), Some(&XON));
        }
    }

    /// A control that is not said to obey is told nothing, and what finds no room is lost.
    #[test]
    fn others_are_told_nothing() {
        let many = PLACES * PIECE + 100;
        assert_eq!(
            session(Handshake::None, &[(many, 0)]),
            (many, PLACES * PIECE, 100, Vec::new())
        );
        let (sent, _, _, told) = session(Handshake::XonXoff, &[(many, 0)]);
        assert!(sent < many);
        assert_eq!(told, [XON, XOFF, XON]);
    }

    /// The codes carry the parity of the control's own characters.
    #[test]
    fn parity() {
        let told = [
            Coding::Ascii,
            Coding::IsoEven,
            Coding::AsciiOdd,
            Coding::Eia,
        ]
        .map(|coding| {
            let hold = Hold::new();
            hold.note(Handshake::XonXoff);
            hold.note_coding(coding);
            [false, true, false].map(|is_pressed| told(&hold, is_pressed).unwrap())
        });
        let even = [0x11, 0x93, 0x11];
        assert_eq!(told, [[0x11, 0x13, 0x11], even, [0x91, 0x13, 0x91], even]);
    }

    /// A job for another control lets go the one that is held.
    #[test]
    fn another_job_lets_go() {
        let hold = Hold::new();
        assert!(hold.note(Handshake::XonXoff));
        assert_eq!(told(&hold, true), Some(XOFF));
        assert_eq!(told(&hold, true), None);
        assert!(hold.note(Handshake::None));
        assert_eq!(told(&hold, true), Some(XON));
        assert_eq!(told(&hold, true), None);
    }

    /// What it is told, when that leaves at once.
    fn told(hold: &Hold, is_pressed: bool) -> Option<u8> {
        let want = hold.wanted(is_pressed);
        let word = hold.word(want);
        hold.said.store(want, Ordering::Relaxed);
        word
    }

    /// A control whose CTS is gone keeps nothing else waiting, and is told when it is back.
    #[test]
    fn a_word_that_cannot_leave_is_tried_again() {
        struct Stuck<'a>(&'a std::cell::Cell<bool>, Vec<u8>);
        impl CncTx for Stuck<'_> {
            async fn write(&mut self, byte: u8) -> Result<(), Broken> {
                core::future::poll_fn(|_| match self.0.get() {
                    true => core::task::Poll::Pending,
                    false => core::task::Poll::Ready(()),
                })
                .await;
                self.1.push(byte);
                Ok(())
            }
        }
        let app = App::<NoFlash>::new();
        let is_stuck = std::cell::Cell::new(true);
        let mut line = Stuck(&is_stuck, Vec::new());
        assert!(app.flow.hold.note(Handshake::XonXoff));
        app.intake.turn();
        let (calls, done) = (std::cell::Cell::new(0), std::cell::Cell::new(false));
        {
            let work = core::future::poll_fn(|_| {
                calls.set(calls.get() + 1);
                match done.get() {
                    true => core::task::Poll::Ready(()),
                    false => core::task::Poll::Pending,
                }
            });
            let mut both = pin!(meanwhile(&app, &mut line, work));
            for _ in 0..3 {
                assert!(poll_once(both.as_mut()).is_pending());
            }
            assert_eq!(calls.get(), 3, "the work goes on");
            done.set(true);
            assert!(poll_once(both.as_mut()).is_ready());
        }
        assert!(line.1.is_empty());
        is_stuck.set(false);
        let never = core::future::pending::<()>();
        assert!(poll_once(pin!(meanwhile(&app, &mut line, never))).is_pending());
        assert_eq!(line.1, [XON]);
    }
}
