//! Resource plan: clock, state machines, DMA channels and priorities, with the cycles that
//! follow. The compiler checks it.
//!
//! # Design
//!
//! Everything that latches counts cycles of the system clock. The microsecond timer
//! runs from the same crystal, so that a microsecond is always the same whole number
//! of cycles and nothing drifts.
//!
//! | priority | who |
//! | --- | --- |
//! | 0 | captures and the tick that extends positions |
//! | 1 | the control's UART, the timer of the tasks; captures go on |
//! | 2 | tasks: receive, transmit, latch; captures to their queue |
//! | 3 | USB, the task that serves the host |
//! | below it ([`measuring_level`](crate::measuring_level)) | measure, supervise |
//! | thread | prove |
//!
//! # Limitations
//!
//! The plan is the same for both chips; the RP2350 merely counts at its own clock.

use core::num::NonZeroU32;

use embassy_rp::interrupt::Priority;
use umi_core::capture::sample_ring::Cadence;
use umi_core::capture::stamp::Rate;
use umi_core::capture::unwrap::Extender;
use umi_protocol::latch::TriggerPulse;

/// Cycles of the system clock in a microsecond.
pub const CYCLES_PER_US: u32 = if cfg!(feature = "rp2350") { 150 } else { 125 };
/// The system clock.
pub const CLOCK_HZ: u32 = CYCLES_PER_US * 1_000_000;

/// The system clock, to nanoseconds and back.
pub type SystemClock = Rate<CLOCK_HZ>;

/// Cycles from one sample of the axes to the next. A count more than one between two
/// samples is an illegal transition, so this is also the highest count rate.
pub const PERIOD_CYCLES: NonZeroU32 = nonzero(10);
/// Samples that a ring holds.
pub const SLOTS: usize = 1024;
/// Counts per second and axis that are decoded: one each sample.
pub const MAX_COUNTS_PER_S: u32 = CLOCK_HZ / PERIOD_CYCLES.get();

/// A sample is pushed in the loop after the one that took it, and then the DMA brings
/// it to the ring, together with those of four other machines.
pub const CADENCE: Cadence = Cadence {
    period_cycles: PERIOD_CYCLES,
    slots: nonzero(SLOTS as u32),
    delay_cycles: 40,
};

/// Bits of a position in a sample.
pub const POSITION_BITS: u32 = 18;
/// Bits of the count of illegal transitions in a sample.
pub const ILLEGAL_BITS: u32 = 14;

/// How often positions are extended to 64 bits and the rings are held against the clock.
pub const EXTEND_US: u32 = 500;
/// How often a crossing is looked for while triggers go out.
pub const TICK_US: u32 = 50;

/// State machines of PIO 1, by what they run. Those of PIO 0 are the axes'.
pub const SKIP_MACHINE: usize = 0;
/// Stamps a scanner's triggers.
pub const TRIGGER_MACHINE: usize = 1;
/// Stamps changes of index marks and of the trigger output.
pub const EVENTS_MACHINE: usize = 2;
/// Sends trigger pulses.
pub const PULSE_MACHINE: usize = 3;

/// Rings: one for each axis.
pub const RINGS: usize = crate::pins::AXES;
/// The DMA channels that take what the control's line brings; the rings have those before them.
pub const LINE_CHANNELS: [u8; 2] = [2 * RINGS as u8, 2 * RINGS as u8 + 1];
/// Transfers until a DMA channel hands over to its partner.
pub const TRANSFERS: u32 = 1 << 20;

/// Captures a second at triggers, trigger pulses and index marks, together and on average.
/// With more, nothing else would get a turn.
pub const SCANS_PER_S: u32 = 12_000;
/// The same at skip edges, rises and falls: no probe is that quick, and each takes room in the
/// journal.
pub const SKIPS_PER_S: u32 = 500;
/// Captures of triggers, pulses and index marks that may come at once.
pub const SCANS_AT_ONCE: u32 = 16;
/// Captures of the skip line that may: both edges of a contact that bounces.
pub const SKIPS_AT_ONCE: u32 = 32;

/// The shortest interval of trigger pulses in time, microseconds: 10 kHz, what captures can be
/// told of.
pub const LEAST_INTERVAL_US: u32 = 100;
/// The longest: its cycles have 32 bits.
pub const MOST_INTERVAL_US: u32 = u32::MAX / CYCLES_PER_US;
/// The longest trigger pulse.
pub const MOST_PULSE_CYCLES: u32 = TriggerPulse::MOST_US as u32 * CYCLES_PER_US;

/// The fastest that the control's line can be.
pub const MOST_BAUD: u32 = 230_400;
/// Bytes that wait while the receiving task is busy: 45 ms of the fastest line.
pub const CNC_RING: usize = 1024;

/// Of captures.
pub const CAPTURE: Priority = Priority::P0;
/// Of the control's UART and of the tasks' timer.
pub const SERIAL: Priority = Priority::P1;
/// Of the tasks for the control and the captures.
pub const CONTROL_TASKS: Priority = Priority::P2;
/// Of the host's port.
pub const HOST_TASKS: Priority = Priority::P3;
/// Of measuring, as the register has it. The RP2350 has two bits more than the HAL gives names to. The RP2040 has
/// nothing below the host's: there measuring is below by what its handler does.
pub const MEASURING: u8 = HOST_TASKS as u8 + if cfg!(feature = "rp2350") { 0x10 } else { 0 };

/// The watchdog's patience with the highest interrupt, which nothing but erasing a sector of the
/// flash that the code runs from holds off, 0.4 s at most. A core that has stopped leaves laser and
/// lamps as they are for so long.
pub const WATCHDOG_MS: u64 = 1_000;
/// Patience with the host's tasks and all above, seconds, before the counter runs: what writes
/// to the memory there may take a good part of it.
pub const HOST_S: u32 = 8;
/// Patience with the measuring, seconds: a sector of the memory may take 0.4 s to be erased,
/// and a cylinder of many points tens of seconds without a floating-point unit.
pub const MEASURING_S: u32 = 120;

const _: () = {
    assert!(SLOTS.is_power_of_two() && (TRANSFERS as usize).is_multiple_of(SLOTS));
    assert!(RINGS * 2 + 2 <= 12, "the RP2040 has twelve DMA channels");
    assert!(
        TRANSFERS < 1 << 28,
        "the RP2350 counts transfers in 28 bits"
    );
    assert!(POSITION_BITS + ILLEGAL_BITS == 32);
    // A tick that comes two late still extends every position rightly, ...
    assert!(3 * (EXTEND_US as u64) < Extender::<POSITION_BITS>::longest_gap_us(MAX_COUNTS_PER_S));
    // ...and a line that is nothing but noise does not overrun the count of its errors.
    assert!((EXTEND_US as u64) * (MAX_COUNTS_PER_S as u64) / 1_000_000 < 1 << ILLEGAL_BITS);
    // A check sees whether the ring is where it should be, as the losses cannot be
    // more than half a ring without a machine having stalled, which shows by itself.
    assert!(TICK_US < EXTEND_US && EXTEND_US.is_multiple_of(TICK_US));
};

#[allow(clippy::panic, reason = "by the compiler: a zero does not compile")]
/// By the compiler.
pub const fn nonzero(number: u32) -> NonZeroU32 {
    match NonZeroU32::new(number) {
        Some(number) => number,
        None => panic!("zero"),
    }
}
