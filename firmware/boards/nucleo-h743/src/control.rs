//! The control's RS-232: a USART with its FIFOs off.
//!
//! # Design
//!
//! The driver of the HAL always switches the FIFOs on, and sixteen characters in one are
//! more than the ten that may come after an XOFF. Without, one byte waits behind the one
//! on the line. The price is an interrupt for each byte that comes: it has 87 µs at
//! 115200 baud until the next one is lost. What is lost anyway is told in its place.

use core::cell::RefCell;
use core::future::poll_fn;
use core::task::Poll;

use critical_section::Mutex;
use embassy_stm32::gpio::{AfType, OutputType, Pull, Speed};
use embassy_stm32::interrupt;
use embassy_stm32::pac::USART2;
use embassy_stm32::{peripherals, rcc};
use embassy_sync::waitqueue::AtomicWaker;
use umi_app::board::{Broken, CncInput, CncRx, CncTx};
use umi_drivers::received::Received;

use crate::resources;
use crate::timers;

/// Bytes that can wait: 90 ms.
const RING: usize = 1_024;

static RECEIVED: Mutex<RefCell<Received<RING>>> = Mutex::new(RefCell::new(Received::new()));
static CAME: AtomicWaker = AtomicWaker::new();
static WENT: AtomicWaker = AtomicWaker::new();

/// Starts the line: 8 data bits, no parity, 1 stop bit.
pub fn start() {
    rcc::enable_and_reset::<peripherals::USART2>();
    let [transmit, receive] = &resources::CONTROL;
    let output = AfType::output(OutputType::PushPull, Speed::Low);
    core::mem::forget(timers::flex(transmit, output));
    // A line that is not connected rests.
    timers::connect(receive, Pull::Up);
    USART2
        .brr()
        .write(|w| w.set_brr(resources::BAUD_DIVIDER as u16));
    USART2.cr1().write(|w| {
        w.set_fifoen(false);
        w.set_te(true);
        w.set_re(true);
        w.set_rxneie(true);
        w.set_ue(true);
    });
}

#[interrupt]
fn USART2() {
    let status = USART2.isr().read();
    // An overrun interrupts without a byte too, if it came after the status was read for it.
    if status.rxne() || status.ore() {
        let byte = status.rxne().then(|| USART2.rdr().read().dr() as u8);
        let broken = status.fe() || status.ne();
        // Only what has been seen: what comes in between is there at the next interrupt.
        USART2.icr().write(|w| {
            w.set_fe(status.fe());
            w.set_ne(status.ne());
            w.set_ore(status.ore());
        });
        critical_section::with(|section| {
            let mut received = RECEIVED.borrow(section).borrow_mut();
            match byte {
                Some(_) if broken => received.lose(1),
                Some(byte) => received.take(byte),
                None => {}
            }
            // It has lost the byte behind this one.
            if status.ore() {
                received.lose(1);
            }
        });
        CAME.wake();
    }
    if status.txe() && USART2.cr1().read().txeie() {
        // Asked for again by who waits.
        asked_for(false);
        WENT.wake();
    }
}

/// Whether there is an interrupt when a byte has begun to leave.
fn asked_for(on: bool) {
    critical_section::with(|_| USART2.cr1().modify(|w| w.set_txeie(on)));
}

/// From the control.
pub struct Receiver;

impl CncRx for Receiver {
    async fn read(&mut self, buffer: &mut [u8]) -> CncInput {
        poll_fn(|context| {
            CAME.register(context.waker());
            let given = critical_section::with(|section| {
                RECEIVED.borrow(section).borrow_mut().give(buffer)
            });
            given.map_or(Poll::Pending, Poll::Ready)
        })
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
}
