//! Vector table: the function and the priority of each interrupt.

use core::fmt::Write as _;

use cortex_m::peripheral::{NVIC, SCB};
use cortex_m_rt::exception;

use crate::chip::{Interrupt, Priority};
use crate::{
    BENCH, BENCH_TASK, CONTROL, HOST, LINK_TASKS, SENSOR, SERIAL_TASKS, clock, crash_note,
};

type Vector = unsafe extern "C" fn();

unsafe extern "C" {
    /// Of cortex-m-rt: panics, with the interrupt's number.
    fn DefaultHandler();
}

/// The part of the vector table behind the core's own exceptions.
#[allow(
    clippy::indexing_slicing,
    reason = "it is made by the compiler, which refuses what would panic"
)]
// SAFETY: the section is for this table, and no other symbol of this name is linked.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [Vector; Interrupt::LINES] = {
    let mut table: [Vector; Interrupt::LINES] = [DefaultHandler; Interrupt::LINES];
    let mut index = 0;
    while index < LINES.len() {
        let (line, _, vector) = LINES[index];
        table[line as usize] = vector;
        index += 1;
    }
    table
};

const LINES: [(Interrupt, Priority, Vector); 12] = [
    (Interrupt::Uart0Rx, Priority::Drivers, control_receives),
    (Interrupt::Uart0Tx, Priority::Drivers, control_writable),
    (Interrupt::Uart1Rx, Priority::Drivers, host_receives),
    (Interrupt::Uart1Tx, Priority::Drivers, host_writable),
    (Interrupt::Uart2Rx, Priority::Capture, bench_receives),
    (Interrupt::Uart2Tx, Priority::Drivers, bench_writable),
    (Interrupt::Uart4Rx, Priority::Drivers, sensor_receives),
    (Interrupt::Timer0, Priority::Drivers, clock::on_wrap),
    (Interrupt::Timer1, Priority::Drivers, clock::on_alarm),
    (Interrupt::BenchTask, Priority::Capture, bench_task),
    (Interrupt::SerialTasks, Priority::SerialTasks, serial_tasks),
    (Interrupt::LinkTasks, Priority::LinkTasks, link_tasks),
];

/// Lets the interrupts come; those of the executors when these are started.
pub fn enable(mut nvic: NVIC) {
    for (line, priority, _) in LINES {
        match line {
            Interrupt::BenchTask | Interrupt::SerialTasks | Interrupt::LinkTasks => {
                line.set_priority(&mut nvic, priority)
            }
            _ => line.enable(&mut nvic, priority),
        }
    }
}

extern "C" fn control_receives() {
    CONTROL.on_receive();
}

extern "C" fn control_writable() {
    CONTROL.on_writable();
}

extern "C" fn host_receives() {
    HOST.on_receive();
}

extern "C" fn host_writable() {
    HOST.on_writable();
}

extern "C" fn bench_receives() {
    BENCH.on_receive();
}

extern "C" fn bench_writable() {
    BENCH.on_writable();
}

extern "C" fn sensor_receives() {
    SENSOR.on_receive();
}

extern "C" fn bench_task() {
    // SAFETY: this is the executor's interrupt, which it enables when it is started.
    unsafe { BENCH_TASK.on_interrupt() };
}

extern "C" fn serial_tasks() {
    // SAFETY: this is the executor's interrupt, which it enables when it is started.
    unsafe { SERIAL_TASKS.on_interrupt() };
}

extern "C" fn link_tasks() {
    // SAFETY: this is the executor's interrupt, which it enables when it is started.
    unsafe { LINK_TASKS.on_interrupt() };
}

/// The watchdog has not been fed.
#[exception]
unsafe fn NonMaskableInt() -> ! {
    crash_note::note_watchdog();
    SCB::sys_reset()
}

/// The core cannot go on: from `fault_entry`.
#[unsafe(no_mangle)]
extern "C" fn on_fault(address: u32) -> ! {
    let mut place = heapless::String::<32>::new();
    let _ = match address {
        0 => write!(place, "the stack has overflowed"),
        _ => write!(place, "hard fault at {address:#010x}"),
    };
    crash_note::note_fault(&place);
    SCB::sys_reset()
}

/// An exception or an interrupt that nothing here has asked for.
#[exception]
unsafe fn DefaultHandler(number: i16) -> ! {
    let mut what = heapless::String::<32>::new();
    let _ = write!(what, "exception {number}");
    crash_note::note_fault(&what);
    SCB::sys_reset()
}
