//! The control's RS-232: a PL011 with its FIFOs off.
//!
//! # Design
//!
//! Without FIFOs a byte waits behind the one on the line and no more, as the rule of ten
//! characters wants it: a control that says XOFF gets two characters after it. The price
//! is an interrupt for each byte that comes: it has 87 us at 115200 baud until the next
//! one is lost, and only captures stand above it. What is lost anyway is counted, in its
//! place between the bytes before and after.
//!
//! Bytes are handed on by the line, because each piece that is handed on becomes an
//! entry of the journal: at the end of a line, at a code that the control means at once
//! (XON, XOFF), when there are many, or when no more have come for a while.
//!
//! CTS holds the transmitter between two characters; the one that waits behind the line
//! waits on. RTS says that the board is there, from now until it is reset: it takes
//! every byte at any time and never holds the control. What is not wired says "ready".
//!
//! # Limitations
//!
//! A control that takes CTS away and does not give it back before the correction is given up
//! gets the character behind the line when it does.
//!
//! The line's speed is fixed: [`CNC_BAUD`], 8 data bits, no parity, one stop bit, which
//! takes 7 data bits with parity too. A byte with a framing error is a lost one.

use core::cell::RefCell;
use core::future::poll_fn;
use core::task::{Context, Poll};

use critical_section::Mutex;
use embassy_futures::select::{Either, select};
use embassy_rp::interrupt;
use embassy_rp::interrupt::InterruptExt;
use embassy_rp::pac;
use embassy_rp::pac::uart::Uart;
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, Timer};
use umi_app::board::{Broken, CncInput, CncRx, CncTx};
use umi_drivers::received::Received;

use crate::resources::{CNC_BAUD, CNC_RING, SERIAL};

const UART: Uart = pac::UART0;

/// As many bytes are handed on without an end of the line.
const PIECE: usize = umi_app::intake::PIECE;
/// No byte for so long: two characters at 4800 baud.
const PAUSE: Duration = Duration::from_millis(5);

/// What has come in.
struct Line {
    received: Received<CNC_RING>,
    /// What is there is to be handed on now.
    urgent: bool,
    /// Counts bytes: whether one has come meanwhile.
    came: u32,
}

static LINE: Mutex<RefCell<Line>> = Mutex::new(RefCell::new(Line {
    received: Received::new(),
    urgent: false,
    came: 0,
}));
static CAME: AtomicWaker = AtomicWaker::new();
static WENT: AtomicWaker = AtomicWaker::new();

/// The divisor of the clock in 64ths, rounded: sixteen clocks make a bit.
const DIVISOR_64THS: u32 = (crate::resources::CLOCK_HZ * 4 + CNC_BAUD / 2) / CNC_BAUD;

const _: () = {
    let made = crate::resources::CLOCK_HZ as u64 * 4 / DIVISOR_64THS as u64;
    let off = made.abs_diff(CNC_BAUD as u64);
    assert!(
        off * 200 < CNC_BAUD as u64,
        "the line is off by half a percent"
    );
};

/// Starts the line. Its pins have been given to it.
pub fn start() {
    UART.uartibrd()
        .write(|w| w.set_baud_divint((DIVISOR_64THS >> 6) as u16));
    UART.uartfbrd()
        .write(|w| w.set_baud_divfrac((DIVISOR_64THS & 63) as u8));
    // Eight bits; the FIFOs stay off. This write takes over the divisor too.
    UART.uartlcr_h().write(|w| w.set_wlen(0b11));
    UART.uartcr().write(|w| {
        w.set_uarten(true);
        w.set_txe(true);
        w.set_rxe(true);
        w.set_ctsen(true);
        w.set_rts(true);
    });
    UART.uartimsc().write(|w| w.set_rxim(true));
    interrupt::UART0_IRQ.set_priority(SERIAL);
    // SAFETY: its handler is below; no critical section depends on it being off.
    unsafe { interrupt::UART0_IRQ.enable() };
}

#[interrupt]
fn UART0_IRQ() {
    let status = UART.uartmis().read();
    if status.rxmis() {
        receive();
    }
    if status.txmis() {
        // Asked for again by who waits.
        critical_section::with(|_| UART.uartimsc().modify(|w| w.set_txim(false)));
        WENT.wake();
    }
}

/// Takes what has come: one byte, or another that came meanwhile.
fn receive() {
    let mut wake = false;
    for _ in 0..2 {
        if UART.uartfr().read().rxfe() {
            break;
        }
        let word = UART.uartdr().read();
        with(|line| {
            wake |= line.received.is_empty();
            if word.oe() {
                line.lose();
            }
            if word.fe() || word.be() {
                line.lose();
            } else {
                line.take(word.data());
            }
            wake |= line.urgent;
        });
    }
    if wake {
        CAME.wake();
    }
}

/// Whether a byte is not to wait for others: the end of a line or a code for the flow,
/// in ISO with any parity or in EIA.
const fn is_urgent(byte: u8) -> bool {
    matches!(byte & 0x7F, b'\n' | b'\r' | 0x11..=0x14) || byte == 0x80
}

impl Line {
    fn take(&mut self, byte: u8) {
        self.came = self.came.wrapping_add(1);
        self.received.take(byte);
        self.urgent |= is_urgent(byte) || self.is_long();
    }

    fn lose(&mut self) {
        self.received.lose(1);
        self.urgent = true;
    }

    fn give(&mut self, buffer: &mut [u8]) -> Option<CncInput> {
        let given = self.received.give(buffer);
        self.urgent = self.is_long();
        given
    }

    fn is_long(&self) -> bool {
        self.received.has_lost() || self.received.len() >= PIECE
    }
}

/// From the control.
pub struct Receiver;

impl CncRx for Receiver {
    async fn read(&mut self, buffer: &mut [u8]) -> CncInput {
        let mut before = None;
        loop {
            let more = poll_fn(|context| {
                CAME.register(context.waker());
                match with(|line| line.urgent) {
                    Some(true) => Poll::Ready(()),
                    _ => Poll::Pending,
                }
            });
            let first = poll_fn(|context| {
                CAME.register(context.waker());
                match with(|line| line.received.is_empty()) {
                    Some(false) => Poll::Ready(()),
                    _ => Poll::Pending,
                }
            });
            first.await;
            let waited = select(more, Timer::after(PAUSE)).await;
            let came = with(|line| line.came);
            let is_over = matches!(waited, Either::First(())) || before == came;
            before = came;
            if is_over && let Some(input) = with(|line| line.give(buffer)).flatten() {
                return input;
            }
        }
    }
}

fn with<R>(work: impl FnOnce(&mut Line) -> R) -> Option<R> {
    critical_section::with(|section| {
        let mut line = LINE.borrow(section).try_borrow_mut().ok()?;
        Some(work(&mut line))
    })
}

/// To the control.
pub struct Transmitter;

impl CncTx for Transmitter {
    async fn write(&mut self, byte: u8) -> Result<(), Broken> {
        poll_fn(room).await;
        UART.uartdr().write(|w| w.set_data(byte));
        // Not before it has left the place behind the line: what may yet be stopped
        // must not be there.
        poll_fn(room).await;
        Ok(())
    }
}

/// Whether the place behind the byte on the line is free.
fn room(context: &mut Context<'_>) -> Poll<()> {
    WENT.register(context.waker());
    if !UART.uartfr().read().txff() {
        return Poll::Ready(());
    }
    critical_section::with(|_| UART.uartimsc().modify(|w| w.set_txim(true)));
    // It may have left before the interrupt was asked for.
    if UART.uartfr().read().txff() {
        Poll::Pending
    } else {
        Poll::Ready(())
    }
}
