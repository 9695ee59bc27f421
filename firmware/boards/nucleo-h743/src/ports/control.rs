//! The control's RS-232: a USART with its FIFOs off.
//!
//! # Design
//!
//! The driver of the HAL always switches the FIFOs on, and sixteen characters in one are
//! more than the ten that may come after an XOFF. Without, one byte waits behind the one
//! on the line. The price is an interrupt for each byte that comes: it has 87 µs at
//! 115200 baud until the next one is lost. What is lost anyway is told in its place.
//!
//! CTS holds the transmitter between two characters (RM0433, 48.5.20: CTSE); the one that waits behind the
//! line waits on. RTS is low from the start on: every byte is taken at any time. A CTS that is not wired is
//! pulled down inside, which says "ready".

use core::future::poll_fn;
use core::task::Poll;

use embassy_stm32::gpio::{AfType, Output, OutputType, Pull, Speed};
use embassy_stm32::interrupt;
use embassy_stm32::pac::USART2;
use embassy_stm32::pac::usart::Usart;
use embassy_stm32::pac::usart::vals::{Presc, Stop};
use embassy_stm32::{peripherals, rcc};
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, Timer};
use umi_app::board::{Broken, CncInput, CncRx, CncTx, LineAbilities};
use umi_drivers::collector::Collector;
use umi_protocol::serial::{Cts, LEAST_BAUD, LineSettings, MOST_BAUD};

use crate::resources::{self, SLOW_PRESCALER, baud_divider, is_slow};
use crate::timers;

/// Bytes that can wait: 45 ms of the fastest line.
const RING: usize = 1_024;

/// What has come in.
#[unsafe(link_section = ".dtcm")]
static LINE: Collector<RING> = Collector::new();
#[unsafe(link_section = ".dtcm")]
static WENT: AtomicWaker = AtomicWaker::new();

/// How the line can be set.
pub const ABILITIES: LineAbilities = LineAbilities {
    least_baud: LEAST_BAUD,
    most_baud: MOST_BAUD,
    two_stop_bits: true,
    cts: true,
};

/// Starts the line, and says by RTS that the board is there.
pub fn start(rts: Output<'static>) {
    // It stays as it is.
    core::mem::forget(rts);
    rcc::enable_and_reset::<peripherals::USART2>();
    let [transmit, receive, cts] = &resources::CONTROL;
    let output = AfType::output(OutputType::PushPull, Speed::Low);
    core::mem::forget(timers::flex(transmit, output));
    // A line that is not connected rests.
    timers::connect(receive, Pull::Up);
    timers::connect(cts, Pull::Down);
    set(LineSettings::DEFAULT);
}

/// Sets the line while nothing goes out: eight data bits, no parity. What comes in at this moment
/// may be damaged.
pub fn set(line: LineSettings) {
    set_port(USART2, &line, false, line.cts != Cts::Ignored);
    LINE.set_line(&line);
}

/// Sets a port, with its FIFO or without, held by its CTS or not.
pub fn set_port(port: Usart, line: &LineSettings, fifo: bool, cts: bool) {
    // The settings can be written while the port is off.
    port.cr1().modify(|w| w.set_ue(false));
    port.presc().write(|w| {
        w.set_prescaler(match is_slow(line.baud) {
            true => const { slow() },
            false => Presc::DIV1,
        });
    });
    port.brr()
        .write(|w| w.set_brr(baud_divider(line.baud) as u16));
    port.cr2().write(|w| {
        w.set_stop(match line.stop_bits {
            2 => Stop::STOP2,
            _ => Stop::STOP1,
        });
    });
    port.cr3().modify(|w| w.set_ctse(cts));
    port.cr1().write(|w| {
        w.set_fifoen(fifo);
        w.set_te(true);
        w.set_re(true);
        w.set_rxneie(true);
        w.set_ue(true);
    });
}

/// As the plan has it.
const fn slow() -> Presc {
    const { assert!(SLOW_PRESCALER == 16) };
    Presc::DIV16
}

#[interrupt]
fn USART2() {
    if let Some((byte, lost)) = taken(USART2) {
        LINE.take(byte, lost);
    }
    if USART2.isr().read().txe() && USART2.cr1().read().txeie() {
        // Asked for again by who waits.
        asked_for(false);
        WENT.wake();
    }
}

/// The next that a port has received: a byte, if one was whole, and then so many that were lost
/// behind it. None: nothing.
pub fn taken(port: Usart) -> Option<(Option<u8>, u32)> {
    let status = port.isr().read();
    // An overrun interrupts without a byte too, if it came after the status was read for it.
    if !(status.rxne() || status.ore()) {
        return None;
    }
    let byte = status.rxne().then(|| port.rdr().read().dr() as u8);
    let broken = status.fe() || status.ne();
    // Only what has been seen: what comes in between is there at the next interrupt.
    port.icr().write(|w| {
        w.set_fe(status.fe());
        w.set_ne(status.ne());
        w.set_ore(status.ore());
    });
    // What was overrun came behind the byte that was there.
    let is_broken = byte.is_some() && broken;
    let lost = u32::from(is_broken) + u32::from(status.ore());
    Some((byte.filter(|_| !broken), lost))
}

/// Whether there is an interrupt when a byte has begun to leave.
fn asked_for(on: bool) {
    critical_section::with(|_| USART2.cr1().modify(|w| w.set_txeie(on)));
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
        poll_fn(|context| {
            WENT.register(context.waker());
            if USART2.isr().read().txe() {
                USART2.tdr().write(|w| w.set_dr(u16::from(byte)));
                return Poll::Ready(());
            }
            asked_for(true);
            Poll::Pending
        })
        .await;
        Ok(())
    }
    async fn set_line(&mut self, line: LineSettings) {
        // The last character may still be on the line.
        for _ in 0..LONGEST_CHARACTER_MS {
            if USART2.isr().read().tc() {
                break;
            }
            Timer::after(Duration::from_millis(1)).await;
        }
        set(line);
    }
}

/// Of the slowest line: eleven bits.
const LONGEST_CHARACTER_MS: u32 = 11 * 1000 / LEAST_BAUD + 1;
