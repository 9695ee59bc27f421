//! Trigger pulses to a scanner, at a time or a distance interval.
//!
//! # Design
//!
//! At a time interval the queue of the machine that sends pulses is kept full: it counts
//! the cycles, whatever interrupts do. At a distance interval a tick foresees the
//! crossing of the next line from the speed over the last few ticks, and the machine
//! sends the pulse in the cycle where the line should be. The pulse itself is captured
//! like any edge: the host is told where the axes really were.
//!
//! # Tradeoffs
//!
//! A position is known to half a count, and what the axis has moved to one. So a pulse
//! that is foreseen by h is off by up to 1/2 + h/s counts, where s is the time over which
//! the speed is taken: 1.2 with 0.1 ms and [`TRAIL_TICKS`]. Half a count more comes from the
//! samples' own grid at the highest speed. A longer s would follow accelerations later.

use core::num::NonZeroU32;

use umi_app::board::Unsupported;
use umi_core::trigger::{Lines, Motion, PulsePlan, pulse_period};
use umi_protocol::latch::TriggerOut;

use crate::pio;
use crate::pio::programs::{PULSE_LEAD_CYCLES, PULSE_OVERHEAD_CYCLES, hold_of};
use crate::quadrature::{AxisCounts, AxisSeen, Quadrature};
use crate::resources::{CLOCK_HZ, CYCLES_PER_US, PULSE_WIDTH_CYCLES, TICK_US};

/// The shortest interval: 10 kHz, what captures can be told of.
const LEAST_CYCLES: u32 = 100 * CYCLES_PER_US;
/// From pulse to pulse, beside the number in the queue.
const OVERHEAD_CYCLES: u32 = PULSE_OVERHEAD_CYCLES + hold_of(PULSE_WIDTH_CYCLES);
/// What is foreseen: until the next tick, however late it comes. No line is foreseen while
/// the pulse of the one before still waits, as they are a tick apart at least.
const HORIZON_CYCLES: u32 = 2 * TICK_US * CYCLES_PER_US;
/// From the look at the ring to the write into the queue: instructions, in the emulator.
const QUEUE_CYCLES: u32 = 18;

const _: () = assert!(LEAST_CYCLES > OVERHEAD_CYCLES && LEAST_CYCLES >= TICK_US * CYCLES_PER_US);

/// When pulses are sent.
pub enum Pulses {
    /// Never.
    Off,
    /// Each so many cycles, less what the program takes itself.
    Time {
        /// For the machine's queue.
        wait_cycles: u32,
    },
    /// Where an axis crosses a line.
    Distance {
        /// Which axis.
        axis: usize,
        /// The lines.
        lines: Lines,
        /// Where the axis was lately.
        trail: Trail,
    },
}

impl Pulses {
    /// As asked for by the host, with the axes where they are now.
    pub fn new(spec: TriggerOut, counts: &AxisCounts) -> Result<Self, Unsupported> {
        match spec {
            TriggerOut::Off => Ok(Self::Off),
            TriggerOut::Time { interval_us } => {
                let period =
                    pulse_period::<CLOCK_HZ>(interval_us, LEAST_CYCLES).map_err(|_| Unsupported)?;
                Ok(Self::Time {
                    wait_cycles: period.get() - OVERHEAD_CYCLES,
                })
            }
            TriggerOut::Distance {
                axis,
                interval_counts,
            } => {
                let axis = usize::from(axis);
                let origin = *counts.get(axis).ok_or(Unsupported)?;
                let lines =
                    Lines::new(origin, interval_counts, HORIZON_CYCLES).map_err(|_| Unsupported)?;
                let trail = Trail::default();
                Ok(Self::Distance { axis, lines, trail })
            }
        }
    }

    /// Whether ticks must come often.
    pub const fn is_on(&self) -> bool {
        !matches!(self, Self::Off)
    }

    /// Does what is to be done until the next tick. Returns how many lines were crossed
    /// without a pulse.
    pub fn tick(&mut self, axes: &Quadrature) -> u32 {
        match self {
            Self::Off => 0,
            Self::Time { wait_cycles } => {
                // The queue holds eight.
                for _ in 0..8 {
                    if !pio::queue_pulse(*wait_cycles) {
                        break;
                    }
                }
                0
            }
            Self::Distance { axis, lines, trail } => match axes.seen(*axis) {
                Some(seen) => fire(lines, seen, trail.motion(seen)),
                None => {
                    *trail = Trail::default();
                    0
                }
            },
        }
    }
}

fn fire(lines: &mut Lines, seen: AxisSeen, motion: Motion) -> u32 {
    match lines.plan(motion) {
        PulsePlan::Wait => 0,
        PulsePlan::Fire {
            in_cycles, skipped, ..
        } => {
            let passed = seen.age_cycles() + QUEUE_CYCLES + PULSE_LEAD_CYCLES;
            if pio::queue_pulse(in_cycles.saturating_sub(passed)) {
                skipped
            } else {
                skipped.saturating_add(1)
            }
        }
    }
}

/// Ticks over which a speed is taken.
const TRAIL_TICKS: usize = 3;

/// Where an axis was at the last ticks, the latest first.
#[derive(Default)]
pub struct Trail([Option<AxisSeen>; TRAIL_TICKS]);

impl Trail {
    /// What the axis does, seen from as far back as is known.
    fn motion(&mut self, seen: AxisSeen) -> Motion {
        let first = self.0.iter().rev().find_map(|before| *before);
        self.0.rotate_right(1);
        if let Some(latest) = self.0.first_mut() {
            *latest = Some(seen);
        }
        let still = Motion {
            position: seen.position,
            moved: 0,
            in_cycles: NonZeroU32::MIN,
        };
        first.map_or(still, |first| {
            let cycles = seen.at.0.wrapping_sub(first.at.0) as u32;
            NonZeroU32::new(cycles).map_or(still, |in_cycles| Motion {
                moved: seen.position.0.wrapping_sub(first.position.0) as i32,
                in_cycles,
                ..still
            })
        })
    }
}
