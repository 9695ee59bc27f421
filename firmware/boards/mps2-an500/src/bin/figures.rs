//! The reference fits and the measured work on the Cortex-M7 of QEMU.
//!
//! Prints every number of every fit bit for bit, and how many instructions work takes, over
//! semihosting:
//!
//! ```text
//! fit sphere_five_1um radius 402966660b0a3c27
//! work 20 48640 sphere of 5 points with covariance
//! ```
//!
//! Work is followed by how many units of it were done, and the instructions of all. With
//! `-icount shift=0` an instruction of QEMU's takes a nanosecond of its time, whatever the
//! host does: a timer of 25 MHz counts them in steps of forty.
#![no_std]
#![no_main]

use core::fmt::{self, Write};
use core::panic::PanicInfo;

use cortex_m_semihosting::debug::{self, EXIT_FAILURE, EXIT_SUCCESS};
use cortex_m_semihosting::hio::{self, HostStream};
use heapless::String;
use umi_figures::work::{self, Meter};

#[allow(dead_code, reason = "one timer is all that is used here")]
#[path = "../chip.rs"]
mod chip;

use chip::{CLOCK_HZ, Interrupt, Register, peripheral};

unsafe extern "C" {
    /// Of cortex-m-rt: panics, with the interrupt's number.
    fn DefaultHandler();
}

/// No interrupt is enabled.
// SAFETY: the section is for this table, and no other symbol of this name is linked.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [unsafe extern "C" fn(); Interrupt::LINES] =
    [DefaultHandler; Interrupt::LINES];

#[cortex_m_rt::entry]
fn main() -> ! {
    let printed = hio::hstdout().map_err(|()| fmt::Error).and_then(print);
    end(printed.is_ok())
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    let _ = hio::hstdout().map(|mut out| writeln!(out, "{info}"));
    end(false)
}

/// Ends QEMU.
fn end(well: bool) -> ! {
    loop {
        debug::exit(if well { EXIT_SUCCESS } else { EXIT_FAILURE });
    }
}

fn print(out: HostStream) -> fmt::Result {
    let mut lines = Lines {
        out,
        line: String::new(),
    };
    umi_figures::fits::print(&mut lines)?;
    let mut counter = Counter::start(lines.out);
    work::all(&mut counter).map_err(|_| fmt::Error)?;
    counter.printed
}

/// Longest line of a fit: the covariance of six parameters.
const LINE: usize = 1024;

/// Lines of fits, one at a time: the host is slow to be spoken to.
struct Lines {
    out: HostStream,
    line: String<LINE>,
}

impl Write for Lines {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for character in text.chars() {
            if character == '\n' {
                writeln!(self.out, "fit {}", self.line)?;
                self.line.clear();
            } else {
                self.line.push(character).map_err(|_| fmt::Error)?;
            }
        }
        Ok(())
    }
}

/// Instructions of one step of the timer.
const STEP: u32 = 1_000_000_000 / CLOCK_HZ;
const CONTROL: Register = Register::new(peripheral::TIMER_0, 0x0);
const VALUE: Register = Register::new(peripheral::TIMER_0, 0x4);
const RELOAD: Register = Register::new(peripheral::TIMER_0, 0x8);

/// Counts instructions.
struct Counter {
    out: HostStream,
    printed: fmt::Result,
}

impl Counter {
    fn start(out: HostStream) -> Self {
        // Down from the top, once every 171 s of QEMU's time.
        RELOAD.write(u32::MAX);
        VALUE.write(u32::MAX);
        CONTROL.write(1);
        Self {
            out,
            printed: Ok(()),
        }
    }
}

impl Meter for Counter {
    fn measure(&mut self, work: &'static str, units: u32, run: &mut dyn FnMut()) {
        let before = VALUE.read();
        run();
        let steps = before.wrapping_sub(VALUE.read());
        let instructions = u64::from(steps) * u64::from(STEP);
        let line = writeln!(self.out, "work {units} {instructions} {work}");
        self.printed = self.printed.and(line);
    }
}
