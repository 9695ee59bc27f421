//! Holds the control when what it sends waits for too long to be measured.
//!
//! # Design
//!
//! XOFF goes out while a quarter of the intake's places is still free, XON when no more than
//! half is taken: 1.5 KB, where a control may send ten characters more after XOFF.
//!
//! Nothing waits for a control that does not take the code, as its CTS is gone: a code counts as
//! said when it has left, and one that has not is tried again.
//!
//! Which code is due says [`RxFlowControl`]. What finds no room is counted as lost, whether or
//! not the control can be held.
//!
//! # Limitations
//!
//! While blocks of XMODEM are on their way nothing is said: they have no code for it, and wait
//! for each other.

use core::future::Future;
use core::pin::pin;

use embassy_futures::select::{Either, select};
use umi_core::journal::Flash;

use crate::App;
use crate::board::CncTx;

/// Does some work; meanwhile holds the control or lets it go.
pub(crate) async fn while_throttling<F: Flash, T>(
    app: &App<F>,
    tx: &mut impl CncTx,
    work: impl Future<Output = T>,
) -> T {
    let mut work = pin!(work);
    loop {
        let code = async {
            app.intake.pressure_changed().await;
            send_pending(app, tx).await;
        };
        if let Either::Second(done) = select(code, &mut work).await {
            // A code that was on its way is tried again.
            app.intake.recheck_pressure();
            return done;
        }
    }
}

/// Sends the code that the control is due.
pub(crate) async fn send_pending<F: Flash>(app: &App<F>, tx: &mut impl CncTx) {
    let is_pressed = app.intake.is_pressed();
    let (want, code) = app.line.with(|talk| talk.throttle.due(is_pressed));
    if let Some(code) = code {
        // On a broken line there is nobody to be told.
        let _ = tx.write(code).await;
    }
    app.line.with(|talk| talk.throttle.told(want));
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::cell::RefCell;
    use std::vec::Vec;

    use embassy_futures::poll_once;
    use proptest::prelude::*;
    use umi_core::control::codes::{XOFF, XON};
    use umi_core::units::Micros;
    use umi_protocol::pattern::Handshake;
    use umi_protocol::serial::LineSettings;

    use super::*;
    use crate::board::Broken;
    use crate::intake::{Input, PIECE, PLACES};
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

        async fn set_line(&mut self, _: LineSettings) {}
    }

    /// A control sends as many bytes as it may, and so many inputs are measured then; several
    /// times. Returns how many it sent, how many were measured and lost, and what it was told.
    fn session(handshake: Handshake, turns: &[(usize, usize)]) -> (usize, usize, u32, Vec<u8>) {
        let (app, clock) = (App::<NoFlash>::new(), Hand::default());
        let said = RefCell::new(Vec::new());
        let mut line = Line(&said);
        let mut transmit = pin!(app.transmit(&mut line, &clock));
        if app
            .line
            .with(|talk| talk.throttle.note_handshake(handshake))
        {
            app.intake.recheck_pressure();
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

            async fn set_line(&mut self, _: LineSettings) {}
        }
        let app = App::<NoFlash>::new();
        let is_stuck = std::cell::Cell::new(true);
        let mut line = Stuck(&is_stuck, Vec::new());
        assert!(
            app.line
                .with(|talk| talk.throttle.note_handshake(Handshake::XonXoff))
        );
        app.intake.recheck_pressure();
        let (calls, done) = (std::cell::Cell::new(0), std::cell::Cell::new(false));
        {
            let work = core::future::poll_fn(|_| {
                calls.set(calls.get() + 1);
                match done.get() {
                    true => core::task::Poll::Ready(()),
                    false => core::task::Poll::Pending,
                }
            });
            let mut both = pin!(while_throttling(&app, &mut line, work));
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
        assert!(poll_once(pin!(while_throttling(&app, &mut line, never))).is_pending());
        assert_eq!(line.1, [XON]);
    }
}
