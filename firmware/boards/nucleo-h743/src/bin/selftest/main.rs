//! The self-test: the board drives its own inputs, and measures what the application promises. **It has
//! never been run.**
//!
//! ```text
//! first start   a panic on purpose ──► note, reset
//! second        a hard fault on purpose ──► note, reset
//! third         the stack overflows on purpose ──► note, reset
//! fourth        USB: "run 1 40" ──► rows of the table, each as soon as it is measured
//! ```
//!
//! # Design
//!
//! Captures, positions, the control's line and the sensor's pulses are the application's own files. Eight
//! jumpers lead outputs of port E to inputs ([`wires`], drawn in the README); the inputs that have none
//! are moved by their own pull-ups and pull-downs. The line's output is led back inside the chip.
//!
//! The table is that of [`umi_drivers::selftest`].
//!
//! # Limitations
//!
//! Receivers, isolators, the line's pins, the sensor's receiver and the journal's flash are not tested. A
//! crystal that is off shifts everything alike, and shows in nothing here. There are no rings of samples
//! on this board: how often a host wants them restarted is not heard.
#![no_std]
#![no_main]
#![allow(dead_code, reason = "the application uses the rest of its files")]

#[path = "../../axes.rs"]
mod axes;
mod drive;
#[path = "../../../../common/fault_entry.rs"]
mod fault_entry;
mod measure;
#[path = "../../memory.rs"]
mod memory;
mod past;
#[path = "../../ports/mod.rs"]
mod ports;
#[path = "../../ram_note.rs"]
mod ram_note;
#[path = "../../reset.rs"]
mod reset;
#[path = "../../resources.rs"]
#[allow(
    clippy::indexing_slicing,
    reason = "in a constant the compiler finds what is outside"
)]
mod resources;
#[path = "../../../../common/stack_guard.rs"]
mod stack_guard;
#[path = "../../start.rs"]
mod start;
#[path = "../../time/mod.rs"]
mod time;
#[path = "../../timers.rs"]
mod timers;
#[allow(
    clippy::indexing_slicing,
    reason = "in a constant the compiler finds what is outside"
)]
mod wires;

use defmt_rtt as _;
use embassy_executor::Executor;
use embassy_futures::join::join4;
use embassy_stm32::Peri;
use embassy_stm32::gpio::{AnyPin, Level, Output, Speed};
use embassy_stm32::peripherals::{PA11, PA12, USB_OTG_FS};
use static_cell::StaticCell;
use umi_app::board::LinkRx as _;
use umi_drivers::selftest::table::{Request, Table};
use umi_drivers::usb_serial;

use measure::Bench;
use ports::{control, sensor, usb};
use time::alarms;

#[cortex_m_rt::entry]
fn main() -> ! {
    static TASKS: StaticCell<Executor> = StaticCell::new();

    let reason = reset::reason();
    let p = embassy_stm32::init(start::configuration());
    if let Some(mut core) = cortex_m::Peripherals::take() {
        memory::cache(&core.MPU, &mut core.SCB, &mut core.CPUID);
    }
    let past = past::go_through(reason, p.IWDG1);
    let output = |pin: Peri<'static, AnyPin>| Output::new(pin, Level::Low, Speed::Low);
    let bench = Bench {
        past,
        station: axes::Station {
            laser: output(p.PG0.into()),
        },
        sensor: sensor::SensorEnd {
            skip: output(p.PF12.into()),
            parity: output(p.PG1.into()),
            is_ok: output(p.PG2.into()),
            has_no_signal: output(p.PG3.into()),
        },
    };
    start::set_priorities();
    timers::start();
    timers::start_looking();
    alarms::start();
    control::start(output(p.PD4.into()));
    sensor::start();
    drive::start();
    TASKS.init(Executor::new()).run(
        |here| match test_itself(p.USB_OTG_FS, p.PA12, p.PA11, bench) {
            Ok(task) => here.spawn(task),
            Err(_) => reset::reset_now(),
        },
    )
}

/// Tests whenever the host asks for it, for ever.
#[embassy_executor::task]
async fn test_itself(
    controller: Peri<'static, USB_OTG_FS>,
    dp: Peri<'static, PA12>,
    dm: Peri<'static, PA11>,
    mut bench: Bench,
) {
    static BUFFER: StaticCell<[u8; 256]> = StaticCell::new();
    let mut options = embassy_stm32::usb::Config::default();
    options.vbus_detection = true;
    let buffer = BUFFER.init([0; 256]);
    let driver =
        embassy_stm32::usb::Driver::new_fs(controller, usb::Served, dp, dm, buffer, options);
    let Some(mut link) = usb_serial::start(driver, "openumi Nucleo self-test", "selftest") else {
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
                        let _ = measure::all(&mut bench, asked, table).await;
                    }
                }
            }
        }
    };
    join4(
        link.device.run(),
        usb::serve(),
        usb_serial::follow(link.line),
        answer,
    )
    .await;
}
