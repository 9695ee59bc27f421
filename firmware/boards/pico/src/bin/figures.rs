//! The reference fits on the Pico's arithmetic: on the RP2040 that is the compiler's
//! software.
//!
//! Prints at the control's port, 921600 baud, how many readings of a point sensor were paired with their
//! captures, and in how many microseconds of the chip's clock; then every number of every fit bit for bit, in
//! parts, and where one ends:
//!
//! ```text
//! readings 400 41200
//! fit sphere_five_1um radius 402966660b0a3c27
//! part 0
//! ```
#![no_std]
#![no_main]

// The HAL looks at the clock.
#[path = "../time/alarms.rs"]
mod alarms;
#[path = "../safety/before_main.rs"]
mod before_main;

use core::fmt::{self, Write};
use core::panic::PanicInfo;

use embassy_rp::interrupt::Priority;
use embassy_rp::peripherals::{PIN_0, UART0};
use embassy_rp::uart::{Blocking, Config, UartTx};
use umi_figures::fits;
use umi_figures::readings::{CAPTURES, Capturing};

const BAUD: u32 = 921_600;

#[cortex_m_rt::entry]
fn main() -> ! {
    let chip = embassy_rp::init(Default::default());
    alarms::start(Priority::P1);
    let mut line = Line {
        port: UartTx::new_blocking(chip.UART0, chip.PIN_0, config()),
        is_new: false,
    };
    if let Some(taken_us) = place_us() {
        let _ = writeln!(line, "readings {CAPTURES} {taken_us}");
    }
    print_fits(&mut line);
    loop {
        cortex_m::asm::wfi();
    }
}

// Neither it nor the other needs room on the stack while the other runs.
#[inline(never)]
fn print_fits(line: &mut Line) {
    for part in 0..fits::PARTS {
        line.is_new = true;
        // The port takes everything.
        let _ = fits::print_part(part, line);
        line.is_new = false;
        let _ = writeln!(line, "part {part}");
    }
}

/// How long the captures of a place take, from their text to its record.
#[inline(never)]
fn place_us() -> Option<u32> {
    let mut capturing = Capturing::begun()?;
    let began = alarms::TIMER.timerawl().read();
    capturing.place()?;
    Some(alarms::TIMER.timerawl().read().wrapping_sub(began))
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    // SAFETY: who had them does not go on.
    let (port, pin) = unsafe { (UART0::steal(), PIN_0::steal()) };
    let mut line = Line {
        port: UartTx::new_blocking(port, pin, config()),
        is_new: false,
    };
    let _ = writeln!(line, "\n{info}");
    loop {
        cortex_m::asm::wfi();
    }
}

fn config() -> Config {
    let mut config = Config::default();
    config.baudrate = BAUD;
    config
}

/// Lines of fits.
struct Line {
    port: UartTx<'static, Blocking>,
    is_new: bool,
}

impl Write for Line {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            if core::mem::take(&mut self.is_new) {
                self.port.blocking_write(b"fit ").map_err(|_| fmt::Error)?;
            }
            self.port.blocking_write(&[byte]).map_err(|_| fmt::Error)?;
            self.is_new = byte == b'\n';
        }
        Ok(())
    }
}
