//! The self-test: the board drives its own inputs, and measures what the application promises.
//!
//! ```text
//! first start   a panic on purpose ──► note, reset
//! second        a hard fault on purpose ──► note, reset
//! third         the stack overflows on purpose ──► note, reset
//! fourth        USB: "run 10000 40" ──► rows of the table, each as soon as it is measured
//! ```
//!
//! # Design
//!
//! Captures, decoders, rings, pulses and the control's line are the application's own files. What is
//! driven are the pins' own outputs, which the state machines read back: **nothing may be connected
//! to the encoders', skip, trigger and index pins**. The line's output is led back inside the chip.
//! It needs no wire.
//!
//! The table is that of [`umi_drivers::selftest`].
//!
//! # Limitations
//!
//! Receivers, isolators, the pins of the control's line and the journal's flash are not tested. A crystal that is off
//! shifts everything alike, and shows in nothing here.
#![no_std]
#![no_main]
#![allow(dead_code, reason = "the application uses the rest of its files")]

#[path = "../../capture/mod.rs"]
mod capture;
mod drive;
mod flash_cache;
#[path = "../../lights.rs"]
mod lights;
mod measure;
mod past;
#[path = "../../pins/mod.rs"]
mod pins;
#[path = "../../resources.rs"]
mod resources;
#[path = "../../safety/mod.rs"]
mod safety;
#[path = "../../time/mod.rs"]
mod time;
#[path = "../../uart/mod.rs"]
mod uart;

use core::panic::PanicInfo;

use cortex_m_rt::exception;
use defmt_rtt as _;
use embassy_executor::Executor;
use embassy_futures::join::join3;
use embassy_rp::gpio::{Level, Output};
use embassy_rp::interrupt::InterruptExt;
use embassy_rp::peripherals::USB;
use embassy_rp::usb::{Driver, InterruptHandler};
use embassy_rp::{Peri, bind_interrupts, interrupt};
use portable_atomic as _;
use static_cell::StaticCell;
use umi_app::board::LinkRx as _;
use umi_drivers::selftest::loopback;
use umi_drivers::selftest::table::{Request, Table};
use umi_drivers::usb_serial;
use umi_protocol::serial::LineSettings;

use capture::latch;
use capture::latch::Station;
use past::Past;
use safety::{crash_note, guard};
use time::alarms;

bind_interrupts!(struct Interrupts {
    USBCTRL_IRQ => InterruptHandler<USB>;
});

#[cortex_m_rt::entry]
fn main() -> ! {
    static TASKS: StaticCell<Executor> = StaticCell::new();

    let chip = embassy_rp::init(Default::default());
    alarms::start(resources::SERIAL);
    let past = past::go_through(chip.WATCHDOG);
    // As in the application.
    embassy_rp::pac::BUSCTRL.bus_priority().write(|w| {
        w.set_dma_r(true);
        w.set_dma_w(true);
    });
    let station = Station::new(Output::new(chip.PIN_21, Level::Low));
    pins::mux::connect();
    drive::start();
    latch::start();
    uart::start(loopback::line(LineSettings::DEFAULT.baud));
    interrupt::USBCTRL_IRQ.set_priority(resources::HOST_TASKS);
    TASKS
        .init(Executor::new())
        .run(|here| match test_itself(chip.USB, station, past) {
            Ok(task) => here.spawn(task),
            Err(_) => guard::reset_now(),
        })
}

/// Tests whenever the host asks for it, for ever.
#[embassy_executor::task]
async fn test_itself(usb: Peri<'static, USB>, mut station: Station, past: Past) {
    let driver = Driver::new(usb, Interrupts);
    let Some(mut link) = usb_serial::start(driver, "openumi Pico self-test", "selftest") else {
        return;
    };
    let answer = async {
        let mut request = Request::new();
        let mut buffer = [0; 16];
        loop {
            link.receiver.connected().await;
            while let Ok(count) = link.receiver.read(&mut buffer).await {
                for byte in buffer.iter().take(count) {
                    if let Some(asked) = request.take(*byte) {
                        let table = Table::new(&mut link.transmitter);
                        // A host that goes is no reason to stop: it may ask again.
                        let _ = measure::all(&mut station, &past, asked, table).await;
                    }
                }
            }
        }
    };
    join3(link.device.run(), usb_serial::follow(link.line), answer).await;
}

/// The core cannot go on: from `safety::fault_entry`.
#[unsafe(no_mangle)]
extern "C" fn on_fault(address: u32) -> ! {
    guard::dark();
    past::note_dark();
    crash_note::note_fault(address);
    guard::reset_now()
}

#[exception]
unsafe fn DefaultHandler(_: i16) -> ! {
    guard::reset_now()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    guard::dark();
    past::note_dark();
    crash_note::note_panic(info);
    guard::reset_now()
}

#[defmt::panic_handler]
fn defmt_panic() -> ! {
    guard::reset_now()
}
