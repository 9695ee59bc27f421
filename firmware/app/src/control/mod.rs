//! The control's port: tasks that move bytes between its driver, the conversation
//! ([`umi_core::control`]) and the state.
//!
//! # Design
//!
//! Receiving waits for nothing: bytes are stamped and put into a bounded queue;
//! what finds no room is counted, and the count takes the lost bytes' place in
//! the queue. A control that obeys XON and XOFF is held before that (`throttle`); no other is.
//!
//! Sending goes byte by byte, and before each byte looks whether the control
//! said XOFF. A control takes ten characters after its XOFF at most; here at most
//! the byte at the driver and the one behind it still go out. Behind each byte the other tasks
//! have a turn: where a byte takes longer than the line does, the driver never waits, and neither
//! captures nor an XOFF would be taken in before the program is out.
//!
//! "Go on" is obeyed at once; a READ takes its turn in the queue, behind what the control
//! said before it.
//!
//! A READ always gets a program, if the job sends any and its control knows macros (see
//! [`umi_core::correction::alarm`]): the correction of the latest OK
//! verdict, or one under the same number that raises an alarm. So an old correction that
//! stands in the control's memory is replaced before it can run for another clamping. An
//! XON soon after an XOFF gets the correction if there is one, and no alarm.
//!
//! A NAK where nothing is being sent gets the program that was asked for by its number, or
//! the correction, by XMODEM (`xmodem`), and nothing if there is neither. Noise and alarms of
//! other controls are NAKs, too: until the first block has been acknowledged, what comes is
//! text as ever, and whatever else it says ends the blocks.
//!
//! # Limitations
//!
//! A READ that comes before its verdict gets the alarm; the control reads again.

pub(crate) mod line;
mod throttle;
mod xmodem;

use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use umi_core::journal::Flash;
use umi_protocol::message::MAX_BYTES;

use crate::App;
use crate::board::{Clock, CncInput, CncRx, CncTx};
use crate::control::line::{after, patience};
use crate::control::throttle::{send_pending, while_throttling};
use crate::intake::Input;
use crate::measure::delivery::{Next, Sent};

/// Receives for ever.
pub(crate) async fn receive<F: Flash>(app: &App<F>, rx: &mut impl CncRx, clock: &impl Clock) -> ! {
    loop {
        let mut buffer = [0; MAX_BYTES];
        match rx.read(&mut buffer).await {
            CncInput::Bytes(count) => {
                let bytes = buffer.get(..count).unwrap_or_default();
                if !app.line.with(|talk| talk.is_in_blocks()) {
                    for byte in bytes {
                        // Text all the same: blocks begin at a request, which is measured.
                        let _ = app.line.on_byte(*byte);
                    }
                    app.intake.bytes(clock.now(), bytes);
                    continue;
                }
                for byte in bytes {
                    if app.line.on_byte(*byte) {
                        app.intake.bytes(clock.now(), &[*byte]);
                    }
                }
            }
            CncInput::Lost(count) => app.intake.lost(clock.now(), count),
            // Only a captured file ends, and it can wait.
            CncInput::End => {
                let end = app.intake.put_when_there_is_room(clock.now(), Input::End);
                end.await;
            }
        }
    }
}

/// Sends what the control may have, for ever.
pub(crate) async fn transmit<F: Flash>(app: &App<F>, tx: &mut impl CncTx, clock: &impl Clock) -> ! {
    loop {
        let begins = select(app.line.changed.wait(), app.line.send_started.wait());
        let hold_us = match while_throttling(app, tx, begins).await {
            Either::First(()) => {
                // Nothing is on its way: what would be is in the other speed.
                tx.set_line(app.line.settings()).await;
                continue;
            }
            Either::Second(hold_us) => hold_us,
        };
        let (is_in_blocks, is_receiving) = app
            .line
            .with(|talk| (talk.is_in_blocks(), talk.is_receiving()));
        let sent = match (is_in_blocks, is_receiving) {
            (_, true) => xmodem::receive(app, tx, clock).await,
            (true, false) => xmodem::send(app, tx, clock).await,
            (false, false) => send(app, tx, clock, hold_us).await,
        };
        let unread = app.line.with(|talk| talk.unread());
        if sent.whole == 0 && unread > 0 {
            // They may have been lines: what was measured before does not hold any more.
            app.intake.lost(clock.now(), unread);
        }
        // The journal is written where it takes least from others. A READ that comes
        // meanwhile waits: the correction may be gone.
        app.line.send_done.signal(sent);
    }
}

/// Sends what has begun, to its end or as far as it may and can.
async fn send<F: Flash>(
    app: &App<F>,
    tx: &mut impl CncTx,
    clock: &impl Clock,
    hold_us: u64,
) -> Sent {
    let mut sent = Sent {
        bytes: 0,
        whole: 0,
        is_held: 0,
    };
    let mut give_up = after(clock, hold_us);
    loop {
        if app.line.is_stopped() {
            let resumed = select(app.line.resumed.wait(), patience(clock, hold_us));
            // Controls say XOFF behind the last %.
            let is_over = while_throttling(app, tx, app.measure.lock())
                .await
                .is_all_out()
                || matches!(while_throttling(app, tx, resumed).await, Either::Second(()));
            if is_over {
                let is_all_out = while_throttling(app, tx, app.measure.lock())
                    .await
                    .is_all_out();
                sent.whole = is_all_out.into();
                sent.is_held = (!is_all_out).into();
                break;
            }
            continue;
        }
        if app.line.with(|talk| talk.is_given_up()) {
            break;
        }
        let (next, is_hungry) = {
            let mut measure = while_throttling(app, tx, app.measure.lock()).await;
            if app.line.is_stopped() {
                continue;
            }
            (measure.next_byte(), measure.is_hungry())
        };
        if is_hungry {
            app.line.refill_needed.signal(());
        }
        match next {
            Next::End { whole } => {
                sent.whole = whole.into();
                break;
            }
            Next::Wait | Next::WaitForHost => {
                if next == Next::Wait {
                    // The board is at work itself.
                    give_up = after(clock, hold_us);
                }
                let filled = select(app.line.refilled.wait(), clock.wait_until(give_up));
                let waited = while_throttling(app, tx, filled).await;
                if matches!(waited, Either::Second(())) {
                    // The host hangs; the machine stands somewhere in what it has got.
                    sent.is_held = 1;
                    break;
                }
            }
            Next::Byte(byte) => {
                // CTS may hold the driver as XOFF holds us.
                let write = async {
                    send_pending(app, tx).await;
                    tx.write(byte).await
                };
                let written = select(write, patience(clock, hold_us)).await;
                if !matches!(written, Either::First(Ok(()))) {
                    sent.is_held = 1;
                    break;
                }
                sent.bytes += 1;
                give_up = after(clock, hold_us);
                yield_now().await;
            }
        }
    }
    sent
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::cell::RefCell;
    use std::vec::Vec;

    use core::pin::pin;
    use embassy_futures::{block_on, poll_once};
    use umi_core::control::Exchange;
    use umi_core::units::Micros;
    use umi_protocol::serial::LineSettings;

    use super::*;
    use crate::board::Broken;
    use crate::test_board::{Hand, NoFlash};

    /// A driver that is always ready: each byte takes longer than the line does.
    struct Fast<'a>(&'a RefCell<Vec<u8>>);

    impl CncTx for Fast<'_> {
        async fn write(&mut self, byte: u8) -> Result<(), Broken> {
            self.0.borrow_mut().push(byte);
            Ok(())
        }

        async fn set_line(&mut self, _: LineSettings) {}
    }

    /// A program that comes out of a slow processor lets the others have their turn between any two bytes: captures are
    /// taken in, and an XOFF stops it at the next byte.
    #[test]
    fn others_have_a_turn_between_two_bytes() {
        for asked in [Exchange::Read, Exchange::Xmodem] {
            let (app, clock) = (App::<NoFlash>::new(), Hand::default());
            let said = RefCell::new(Vec::new());
            let mut tx = Fast(&said);
            let mut transmit = pin!(transmit(&app, &mut tx, &clock));
            // There is no such program: an alarm goes out in its place.
            let mut measure = block_on(app.measure.lock());
            measure.ledger.wanted.set(7, true);
            let hold_us = measure.begin(Micros(0), asked).unwrap();
            drop(measure);
            app.line.begin(hold_us, asked);
            for turn in 0..1_000 {
                // A sender of blocks waits a moment before the first.
                clock.set(turn * 1_000);
                let before = said.borrow().len();
                assert!(poll_once(transmit.as_mut()).is_pending());
                let more = said.borrow().len() - before;
                assert!(more <= 1, "{more} bytes without a turn");
            }
            assert!(said.borrow().len() > 20, "{asked:?}");
        }
    }
}
