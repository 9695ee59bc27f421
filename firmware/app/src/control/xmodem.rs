//! Programs to and from a control by XMODEM, as Haas controls can.
//!
//! # Design
//!
//! The same bytes as without it, in blocks with a check sum ([`umi_core::control::xmodem`]): who may
//! have a program, and how it is rewritten, does not depend on how it goes out. What the
//! control says meanwhile answers blocks, and is no text. A program that is taken back in
//! the middle is cancelled.
//!
//! # Limitations
//!
//! The line is 8N: parity that the control uses in its text is not for blocks. What it says
//! while blocks go out or come in is not in the journal: where that does not come to its
//! end, it is journaled as lost, and no verdict holds any more.

use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use umi_core::control::XOFF_PATIENCE_US;
use umi_core::control::xmodem::receiver::{BlockReceiver, ReceiveOutcome, ReceiveStep};
use umi_core::control::xmodem::sender::{BlockSender, SendOutcome, SendStep};
use umi_core::control::xmodem::{BLOCK, FRAME, NAK};
use umi_core::journal::Flash;

use crate::App;
use crate::board::{Clock, CncTx};
use crate::control::line::patience;
use crate::measure::delivery::{Next, Sent};

/// Sends what has begun; the control has asked by a NAK.
pub(crate) async fn send<F: Flash>(app: &App<F>, tx: &mut impl CncTx, clock: &impl Clock) -> Sent {
    let mut sender = BlockSender::new(clock.now());
    sender.received(NAK, clock.now());
    let mut bytes = 0;
    let outcome = loop {
        match sender.next(clock.now()) {
            SendStep::Done(outcome) => break outcome,
            SendStep::WaitUntil(until) => {
                let came = select(app.line.answers.receive(), clock.wait_until(until)).await;
                if let Either::First(byte) = came {
                    sender.received(byte, clock.now());
                }
            }
            SendStep::NeedData { .. } => {
                let (next, is_hungry) = {
                    let mut measure = app.measure.lock().await;
                    (measure.next_byte(), measure.is_hungry())
                };
                if is_hungry {
                    app.line.refill_needed.signal(());
                }
                yield_now().await;
                match next {
                    Next::Byte(byte) => bytes += sender.data(&[byte], false) as u32,
                    Next::End { whole: true } => drop(sender.data(&[], true)),
                    Next::End { whole: false } => sender.stop(),
                    Next::Wait | Next::WaitForHost => {
                        let patience = patience(clock, XOFF_PATIENCE_US);
                        let waited = select(app.line.refilled.wait(), patience).await;
                        if matches!(waited, Either::Second(())) {
                            sender.stop();
                        }
                    }
                }
            }
            SendStep::Send(frame) => {
                let mut block = heapless::Vec::<u8, FRAME>::new();
                // A frame has as many.
                let _ = block.extend_from_slice(frame);
                let is_broken = !write(tx, clock, &block).await;
                // What came before its last byte does not answer it.
                while let Ok(byte) = app.line.answers.try_receive() {
                    sender.received(byte, clock.now());
                }
                sender.sent(clock.now());
                if is_broken {
                    sender.stop();
                }
            }
        }
    };
    let whole = matches!(
        outcome,
        SendOutcome::Complete | SendOutcome::CompleteByCancel
    );
    Sent {
        bytes,
        whole: whole.into(),
        is_held: 0,
    }
}

/// Asks the control for a program, and keeps what comes.
pub(crate) async fn receive<F: Flash>(
    app: &App<F>,
    tx: &mut impl CncTx,
    clock: &impl Clock,
) -> Sent {
    let mut receiver = BlockReceiver::new(app.line.settings().character_us());
    let mut bytes = 0;
    let outcome = loop {
        match receiver.next(clock.now()) {
            ReceiveStep::Done(outcome) => break outcome,
            ReceiveStep::WaitUntil(until) => {
                let came = select(app.line.answers.receive(), clock.wait_until(until)).await;
                if let Either::First(byte) = came {
                    receiver.received(byte, clock.now());
                }
            }
            ReceiveStep::Send(answer) => {
                let mut block = heapless::Vec::<u8, FRAME>::new();
                // An answer is shorter than a frame.
                let _ = block.extend_from_slice(answer);
                let is_broken = !write(tx, clock, &block).await;
                receiver.sent(clock.now());
                if is_broken {
                    receiver.stop();
                }
            }
            ReceiveStep::Data { bytes: came, last } => {
                let mut block = heapless::Vec::<u8, BLOCK>::new();
                // A block has no more.
                let _ = block.extend_from_slice(came);
                let is_first = bytes == 0;
                bytes += block.len() as u32;
                let mut measure = app.measure.lock().await;
                measure.ledger.upload.block(&block, is_first, last);
                drop(measure);
                // Flash is written where it takes least from others.
                app.line.refill_needed.signal(());
                let is_stored = loop {
                    app.line.refilled.wait().await;
                    if let Some(stored) = app.measure.lock().await.ledger.upload.stored() {
                        break stored;
                    }
                };
                if is_stored {
                    receiver.taken();
                } else {
                    receiver.refuse();
                }
            }
        }
    };
    if outcome == ReceiveOutcome::Refused {
        // It was a program, only not one to be kept.
        app.line.with(|talk| talk.was_a_program());
    }
    let whole = outcome == ReceiveOutcome::Complete;
    Sent {
        bytes,
        whole: whole.into(),
        is_held: 0,
    }
}

/// Writes bytes. False: the line is broken.
async fn write(tx: &mut impl CncTx, clock: &impl Clock, bytes: &[u8]) -> bool {
    for byte in bytes {
        let patience = patience(clock, XOFF_PATIENCE_US);
        let written = select(tx.write(*byte), patience).await;
        if !matches!(written, Either::First(Ok(()))) {
            return false;
        }
        yield_now().await;
    }
    true
}
