//! A program to a control that reads by XMODEM, as Haas controls can.
//!
//! # Design
//!
//! The same bytes as without it, in blocks with a check sum ([`umi_core::xmodem`]): who may
//! have a program, and how it is rewritten, does not depend on how it goes out. What the
//! control says meanwhile answers blocks, and is no text. A program that is taken back in
//! the middle is cancelled.
//!
//! # Limitations
//!
//! The line is 8N: parity that the control uses in its text is not for blocks. What it says
//! while blocks go out is not in the journal.

use embassy_futures::select::{Either, select};
use umi_core::journal::Flash;
use umi_core::xmodem::sender::{Action, Outcome, Sender};
use umi_core::xmodem::{FRAME, NAK};

use crate::App;
use crate::board::{Clock, CncTx};
use crate::cnc::{XOFF_PATIENCE_US, patience};
use crate::delivery::{Next, Sent};

/// Sends what has begun; the control has asked by a NAK.
pub(crate) async fn send<F: Flash>(app: &App<F>, tx: &mut impl CncTx, clock: &impl Clock) -> Sent {
    let mut sender = Sender::new(clock.now());
    sender.received(NAK, clock.now());
    let mut bytes = 0;
    let outcome = loop {
        match sender.next(clock.now()) {
            Action::Done(outcome) => break outcome,
            Action::WaitUntil(until) => {
                let came = select(app.flow.answers.receive(), clock.wait_until(until)).await;
                if let Either::First(byte) = came {
                    sender.received(byte, clock.now());
                }
            }
            Action::NeedData { .. } => {
                let (next, is_hungry) = {
                    let mut measure = app.measure.lock().await;
                    (measure.next_byte(), measure.is_hungry())
                };
                if is_hungry {
                    app.flow.hungry.signal(());
                }
                match next {
                    Next::Byte(byte) => bytes += sender.data(&[byte], false) as u32,
                    Next::End { whole: true } => drop(sender.data(&[], true)),
                    Next::End { whole: false } => sender.stop(),
                    Next::Wait | Next::WaitForHost => {
                        let patience = patience(clock, XOFF_PATIENCE_US);
                        let waited = select(app.flow.filled.wait(), patience).await;
                        if matches!(waited, Either::Second(())) {
                            sender.stop();
                        }
                    }
                }
            }
            Action::Send(frame) => {
                let mut block = heapless::Vec::<u8, FRAME>::new();
                // A frame has as many.
                let _ = block.extend_from_slice(frame);
                let mut is_broken = false;
                for byte in block {
                    let patience = patience(clock, XOFF_PATIENCE_US);
                    let written = select(tx.write(byte), patience).await;
                    is_broken |= !matches!(written, Either::First(Ok(())));
                    if is_broken {
                        break;
                    }
                }
                sender.sent(clock.now());
                if is_broken {
                    sender.stop();
                }
            }
        }
    };
    let whole = matches!(outcome, Outcome::Complete | Outcome::CompleteByCancel);
    Sent {
        bytes,
        whole: whole.into(),
        is_held: 0,
    }
}
