//! The control's port: receiving, and sending the correction.
//!
//! # Design
//!
//! Receiving waits for nothing: bytes are stamped and put into a bounded queue;
//! what finds no room is counted, and the count takes the lost bytes' place in
//! the queue. A control is never held (no XOFF is ever sent): a receiver that
//! does not drain stops a machine.
//!
//! Sending goes byte by byte, and before each byte looks whether the control
//! said XOFF. A control takes ten characters after its XOFF at most; here at most
//! the byte at the driver and the one behind it still go out.
//!
//! DC1 (XON) means two things: "go on" while a correction is being sent, and
//! "send me the program" (READ) otherwise.
//!
//! # Limitations
//!
//! In EIA and odd-parity codes 0x13 is a character (EIA's `3`), and only 0x93 is
//! XOFF. Until the code has been detected, 0x13 counts as XOFF too.

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use umi_core::dprnt::encode;
use umi_core::journal::Flash;
use umi_core::units::Micros;
use umi_protocol::job::SendWhen;
use umi_protocol::pattern::Coding;

use crate::App;
use crate::board::{Clock, CncInput, CncRx, CncTx};
use crate::measure::{Bytes, Correction, Input};

const XON: u8 = 0x11;
const XOFF: u8 = 0x13;
/// XOFF with even parity.
const XOFF_EVEN: u8 = 0x93;

/// A control that does not say XON again for this long has given up.
pub const XOFF_PATIENCE_US: u64 = 60_000_000;

/// The state of the line between receiving and sending.
pub(crate) struct Flow {
    /// The control said XOFF.
    stopped: AtomicBool,
    /// A correction is being sent.
    sending: AtomicBool,
    /// Characters have odd parity, so 0x13 is one of them.
    odd: AtomicBool,
    /// The control said XON while it was stopped.
    resumed: Signal<CriticalSectionRawMutex, ()>,
    /// A correction is to go out now.
    pub go: Signal<CriticalSectionRawMutex, SendWhen>,
}

impl Flow {
    pub const fn new() -> Self {
        Self {
            stopped: AtomicBool::new(false),
            sending: AtomicBool::new(false),
            odd: AtomicBool::new(false),
            resumed: Signal::new(),
            go: Signal::new(),
        }
    }

    /// Notes the code in which the control writes.
    pub fn note_coding(&self, coding: Coding) {
        let odd = matches!(coding, Coding::Eia | Coding::AsciiOdd);
        self.odd.store(odd, Ordering::Relaxed);
    }

    /// Looks at a byte from the control.
    fn see(&self, byte: u8) {
        let odd = self.odd.load(Ordering::Relaxed);
        if byte == XOFF_EVEN || (byte == XOFF && !odd) {
            self.stopped.store(true, Ordering::Relaxed);
        } else if byte == XON {
            self.stopped.store(false, Ordering::Relaxed);
            if self.sending.load(Ordering::Relaxed) {
                self.resumed.signal(());
            } else {
                self.go.signal(SendWhen::OnRequest);
            }
        }
    }
}

/// Receives for ever.
pub(crate) async fn receive<F: Flash>(
    app: &App<F>,
    rx: &mut impl CncRx,
    clock: &impl Clock,
) -> ! {
    let mut buffer = Bytes::new();
    let mut lost: u32 = 0;
    loop {
        buffer.resize_default(buffer.capacity()).unwrap_or(());
        let got = rx.read(&mut buffer).await;
        let now = clock.now();
        let (input, bytes) = match got {
            CncInput::Bytes(count) => {
                buffer.truncate(count);
                buffer.iter().for_each(|byte| app.flow.see(*byte));
                (Input::Bytes(buffer.clone()), buffer.len())
            }
            CncInput::Lost(count) => (Input::Lost(count), 0),
            CncInput::End => (Input::End, 0),
        };
        if matches!(input, Input::End) {
            // Only a captured file ends, and it can wait.
            app.inputs.send((now, input)).await;
            continue;
        }
        // A loss stands where the bytes would have stood, so that what follows
        // is not taken for their continuation.
        if lost > 0 && app.inputs.try_send((now, Input::Lost(lost))).is_ok() {
            lost = 0;
        }
        let queued = lost == 0 && app.inputs.try_send((now, input.clone())).is_ok();
        if !queued {
            let more = match input {
                Input::Lost(count) => count,
                _ => u32::try_from(bytes).unwrap_or(u32::MAX),
            };
            lost = lost.saturating_add(more);
        }
    }
}

/// Sends corrections for ever.
pub(crate) async fn transmit<F: Flash>(
    app: &App<F>,
    tx: &mut impl CncTx,
    clock: &impl Clock,
) -> ! {
    loop {
        let asked = app.flow.go.wait().await;
        let correction = {
            let measure = app.measure.lock().await;
            // What goes out by itself may also be asked for; not the reverse.
            let allowed = asked == SendWhen::OnRequest || measure.waiting() == Some(asked);
            measure.correction().filter(|_| allowed)
        };
        let Some(correction) = correction else {
            continue;
        };
        app.flow.sending.store(true, Ordering::Relaxed);
        // An XOFF from before READ was meant for nobody.
        app.flow.stopped.store(false, Ordering::Relaxed);
        app.flow.resumed.reset();
        let (bytes, complete) = send(app, tx, clock, &correction).await;
        app.flow.sending.store(false, Ordering::Relaxed);
        let mut measure = app.measure.lock().await;
        measure.sent(clock.now(), correction.plate, bytes, complete);
    }
}

/// Sends one program; how many bytes went out, and whether that was all.
async fn send<F: Flash>(
    app: &App<F>,
    tx: &mut impl CncTx,
    clock: &impl Clock,
    correction: &Correction,
) -> (u32, bool) {
    let mut sent = 0;
    for ascii in correction.text.bytes() {
        let Some(byte) = encode(correction.coding, ascii) else {
            return (sent, false);
        };
        while app.flow.stopped.load(Ordering::Relaxed) {
            let give_up = Micros(clock.now().0.saturating_add(XOFF_PATIENCE_US));
            let waited = select(app.flow.resumed.wait(), clock.wait_until(give_up)).await;
            if matches!(waited, Either::Second(())) {
                return (sent, false);
            }
        }
        // A new measurement, job or verdict takes the program back, even now:
        // without its closing `%` the control does not take it.
        if !app.measure.lock().await.is_armed(correction.plate) {
            return (sent, false);
        }
        if tx.write(byte).await.is_err() {
            return (sent, false);
        }
        sent += 1;
    }
    (sent, true)
}
