//! The chip: addresses of registers, interrupts and their priorities.
//!
//! From ARM's "Application Note AN500" and the "Cortex-M System Design Kit" (CMSDK)
//! manual, as far as QEMU has it.

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;

/// Clock of core and peripherals.
pub const CLOCK_HZ: u32 = 25_000_000;

/// A 32-bit register of a peripheral.
#[derive(Clone, Copy)]
pub struct Register(usize);

impl Register {
    /// The register at this offset from its peripheral.
    pub const fn new(peripheral: usize, offset: usize) -> Self {
        Self(peripheral + offset)
    }

    /// Reads it.
    pub fn read(self) -> u32 {
        // SAFETY: made in this crate from the addresses of peripherals that are always
        // there, are aligned, and of which every value may be read at any time.
        unsafe { (self.0 as *const u32).read_volatile() }
    }

    /// Writes it.
    pub fn write(self, value: u32) {
        // SAFETY: as for reading; no peripheral of this chip reaches into memory.
        unsafe { (self.0 as *mut u32).write_volatile(value) }
    }
}

/// Addresses of peripherals.
pub mod peripheral {
    /// A timer that counts down.
    pub const TIMER_0: usize = 0x4000_0000;
    /// A timer that counts down.
    pub const TIMER_1: usize = 0x4000_1000;
    /// To the control.
    pub const UART_0: usize = 0x4000_4000;
    /// To the host.
    pub const UART_1: usize = 0x4000_5000;
    /// To the test bench.
    pub const UART_2: usize = 0x4000_6000;
    /// To whoever looks on.
    pub const UART_3: usize = 0x4000_7000;
    /// To a distance sensor.
    pub const UART_4: usize = 0x4000_9000;
    /// Raises the NMI when it has not been fed, and resets the chip the next time.
    pub const WATCHDOG: usize = 0x4000_8000;
}

/// Interrupts in use.
#[derive(Clone, Copy)]
#[repr(u16)]
pub enum Interrupt {
    /// A byte from the control.
    Uart0Rx = 0,
    /// Room for a byte to the control.
    Uart0Tx = 1,
    /// A byte from the host.
    Uart1Rx = 2,
    /// Room for a byte to the host.
    Uart1Tx = 3,
    /// A byte from the test bench.
    Uart2Rx = 4,
    /// Room for a byte to the test bench.
    Uart2Tx = 5,
    /// The clock's counter has wrapped.
    Timer0 = 8,
    /// The alarm.
    Timer1 = 9,
    /// A byte from the distance sensor.
    Uart4Rx = 20,
    /// No line of the machine: plays what the bench sends.
    BenchTask = 29,
    /// No line of the machine: runs the serial tasks.
    SerialTasks = 30,
    /// No line of the machine: runs the link's task.
    LinkTasks = 31,
}

// SAFETY: the numbers are those of the lines.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

/// Priorities, highest first. Of a priority's 8 bits the upper three are used, as real
/// Cortex-M7s have no more than four.
#[derive(Clone, Copy)]
#[repr(u8)]
pub enum Priority {
    /// What happens at the axes and the inputs.
    Capture = 0x00,
    /// Bytes, and the clock.
    Drivers = 0x20,
    /// The tasks of the control's port and of the latches.
    SerialTasks = 0x40,
    /// The task of the host's link.
    LinkTasks = 0x60,
    // Below all: measuring, in no interrupt at all.
}

impl Interrupt {
    /// How many lines the machine has.
    pub const LINES: usize = 32;

    /// Sets the priority and lets the interrupt come.
    pub fn enable(self, nvic: &mut NVIC, priority: Priority) {
        self.set_priority(nvic, priority);
        // SAFETY: the vector table has a function for every interrupt that is named here.
        unsafe { NVIC::unmask(self) };
    }

    /// Sets the priority only: an executor enables its interrupt itself.
    pub fn set_priority(self, nvic: &mut NVIC, priority: Priority) {
        // SAFETY: no critical section here rests on priorities: all mask every interrupt.
        unsafe { nvic.set_priority(self, priority as u8) };
    }
}
