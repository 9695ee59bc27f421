//! The control's RS-232: a PL011 with its FIFOs off.
//!
//! # Design
//!
//! Without FIFOs a byte waits behind the one on the line and no more, as the rule of ten
//! characters wants it: a control that says XOFF gets two characters after it. What comes
//! is taken by DMA ([`words`]), so that no interrupt that is late loses a byte. What is
//! lost anyway is counted, in its place between the bytes before and after.
//!
//! Bytes are handed on by the line of text ([`umi_drivers::collector`]).
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
//! The port always moves 8 bits without parity, which takes 7 bits and parity, too. A byte with a
//! framing error is a lost one.

mod words;

use core::future::poll_fn;
use core::task::{Context, Poll};

use cortex_m_rt::interrupt;
use embassy_rp::interrupt;
use embassy_rp::interrupt::InterruptExt;
use embassy_rp::pac;
use embassy_rp::pac::uart::Uart;
use embassy_rp::pac::uart::regs::Uartdr;
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, Timer};
use umi_app::board::{Broken, CncInput, CncRx, CncTx, LineAbilities};
use umi_drivers::collector::Collector;
use umi_protocol::serial::{Cts, LEAST_BAUD, LineSettings};

use crate::resources::{CLOCK_HZ, CNC_RING, MOST_BAUD, SERIAL};

const UART: Uart = pac::UART0;

/// What has come in.
static LINE: Collector<CNC_RING> = Collector::new();
static WENT: AtomicWaker = AtomicWaker::new();

/// How the line can be set.
pub const ABILITIES: LineAbilities = LineAbilities {
    least_baud: LEAST_BAUD,
    most_baud: MOST_BAUD,
    two_stop_bits: true,
    cts: true,
};

/// The divisor of the clock in 64ths, rounded: sixteen clocks make a bit.
const fn divisor_64ths(baud: u32) -> u32 {
    let baud = if baud == 0 { 1 } else { baud };
    (CLOCK_HZ * 4).wrapping_add(baud / 2) / baud
}

const _: () = {
    let mut baud = LEAST_BAUD;
    while baud <= MOST_BAUD {
        let divisor = divisor_64ths(baud);
        assert!(divisor >> 6 <= 0xFFFF, "the divisor has 16 bits and 6");
        let made = CLOCK_HZ as u64 * 4 / divisor as u64;
        let off = made.abs_diff(baud as u64);
        assert!(
            off * 200 <= baud as u64,
            "the line is off by half a percent"
        );
        baud *= 2;
    }
};

/// Starts the line. Its pins have been given to it.
pub fn start(line: LineSettings) {
    words::start(UART);
    set(line);
    for interrupt in [interrupt::UART0_IRQ, interrupt::DMA_IRQ_0] {
        interrupt.set_priority(SERIAL);
        // SAFETY: its handler is below; no critical section depends on it being off.
        unsafe { interrupt.enable() };
    }
}

/// Sets the line while nothing goes out. What comes in at this moment may be damaged.
fn set(line: LineSettings) {
    UART.uartcr().write(|_| {});
    let divisor = divisor_64ths(line.baud);
    UART.uartibrd()
        .write(|w| w.set_baud_divint((divisor >> 6) as u16));
    UART.uartfbrd()
        .write(|w| w.set_baud_divfrac((divisor & 63) as u8));
    // Eight bits; the FIFOs stay off. This write takes over the divisor too.
    UART.uartlcr_h().write(|w| {
        w.set_wlen(0b11);
        w.set_stp2(line.stop_bits == 2);
    });
    UART.uartcr().write(|w| {
        w.set_uarten(true);
        w.set_txe(true);
        w.set_rxe(true);
        w.set_ctsen(line.cts != Cts::Ignored);
        w.set_rts(true);
    });
    LINE.set_line(&line);
}

#[interrupt]
fn UART0_IRQ() {
    // Asked for again by who waits.
    critical_section::with(|_| UART.uartimsc().modify(|w| w.set_txim(false)));
    WENT.wake();
}

#[interrupt]
fn DMA_IRQ_0() {
    let is_overrun = words::take(|word| {
        let word = Uartdr(word.into());
        let is_whole = !(word.fe() || word.be());
        // What was overrun came behind the byte that was there.
        let lost = u32::from(!is_whole) + u32::from(word.oe());
        LINE.take(is_whole.then(|| word.data()), lost);
    });
    if is_overrun {
        LINE.take(None, 1);
    }
}

/// From the control.
pub struct Receiver;

impl CncRx for Receiver {
    async fn read(&mut self, buffer: &mut [u8]) -> CncInput {
        LINE.read(buffer, |us| Timer::after(Duration::from_micros(us)))
            .await
    }
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

    async fn set_line(&mut self, line: LineSettings) {
        // The last character may still be on the line.
        for _ in 0..LONGEST_CHARACTER_MS {
            if !UART.uartfr().read().busy() {
                break;
            }
            Timer::after(Duration::from_millis(1)).await;
        }
        set(line);
    }
}

/// Of the slowest line: eleven bits. One that CTS holds goes out at the new speed, or never.
const LONGEST_CHARACTER_MS: u32 = 11 * 1000 / LEAST_BAUD + 1;

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
