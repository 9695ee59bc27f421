//! Trigger pulses to a scanner, at a time or a distance interval.
//!
//! # Design
//!
//! At a time interval the queue of the machine that sends pulses is kept full: it counts
//! the cycles, whatever interrupts do. At a distance interval a tick foresees the
//! crossing of the next line from the speed over the last few ticks, and the machine
//! sends the pulse in the cycle where the line should be. The pulse itself is captured
//! like any edge: the host is told where the axes really were. A line that is crossed before
//! the pause of the pulse before is over has none, and is told as missed.
//!
//! # Tradeoffs
//!
//! A position is known to half a count, and what the axis has moved to one. So a pulse
//! that is foreseen by h is off by up to 1/2 + h/s counts, where s is the time over which
//! the speed is taken: 1.2 with 0.1 ms and [`TRAIL_TICKS`]. Half a count more comes from the
//! samples' own grid at the highest speed. A longer s would follow accelerations later.

use core::num::NonZeroU32;

use umi_core::trigger::{self, Lines, Motion, PulsePlan, PulseRoom, pulse_period};
use umi_protocol::latch::{TriggerOut, TriggerPulse, TriggerRefusal};

use crate::capture::pio;
use crate::capture::pio::programs::{PULSE_LEAD_CYCLES, PULSE_OVERHEAD_CYCLES, hold_of};
use crate::capture::quadrature::{AxisCounts, AxisSeen, Quadrature};
use crate::resources::{CLOCK_HZ, CYCLES_PER_US, LEAST_INTERVAL_US, MOST_INTERVAL_US, TICK_US};

/// What is foreseen: until the next tick, however late it comes. No line is foreseen while
/// the pulse of the one before still waits, as they are a tick apart at least.
const HORIZON_CYCLES: u32 = 2 * TICK_US * CYCLES_PER_US;
/// From the look at the ring to the write into the queue: instructions, in the emulator.
const QUEUE_CYCLES: u32 = 18;

// The pause has room for what the program takes, and the queue of eight for two ticks.
const _: () = assert!(
    TriggerPulse::GAP_US * CYCLES_PER_US > PULSE_OVERHEAD_CYCLES && LEAST_INTERVAL_US >= TICK_US
);

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
        /// When the output is free again.
        room: PulseRoom,
    },
}

/// Whether such pulses can be sent, with so many axes.
pub fn check(spec: TriggerOut, axes: usize) -> Result<(), TriggerRefusal> {
    trigger::check(spec, axes, LEAST_INTERVAL_US, MOST_INTERVAL_US)
}

impl Pulses {
    /// As asked for by the host, with the axes where they are now.
    pub fn new(spec: TriggerOut, counts: &AxisCounts) -> Result<Self, TriggerRefusal> {
        check(spec, counts.len())?;
        match spec {
            TriggerOut::Off => Ok(Self::Off),
            TriggerOut::Time { interval_us, pulse } => {
                let least_us = LEAST_INTERVAL_US;
                let period = pulse_period::<CLOCK_HZ>(interval_us, least_us * CYCLES_PER_US)
                    .map_err(|_| TriggerRefusal::IntervalTooShort { least_us })?;
                let overhead = PULSE_OVERHEAD_CYCLES + hold_of(width_cycles(pulse));
                Ok(Self::Time {
                    wait_cycles: period.get().saturating_sub(overhead),
                })
            }
            TriggerOut::Distance {
                axis,
                interval_counts,
                pulse,
            } => {
                let axis = usize::from(axis);
                let origin = *counts.get(axis).ok_or(TriggerRefusal::NoAxis)?;
                let lines = Lines::new(origin, interval_counts, HORIZON_CYCLES)
                    .map_err(|_| TriggerRefusal::NoInterval)?;
                Ok(Self::Distance {
                    axis,
                    lines,
                    trail: Trail::default(),
                    room: PulseRoom::new(pulse, CYCLES_PER_US),
                })
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
            Self::Distance {
                axis,
                lines,
                trail,
                room,
            } => match axes.seen(*axis) {
                Some(seen) => fire(lines, room, seen, trail.motion(seen)),
                None => {
                    *trail = Trail::default();
                    0
                }
            },
        }
    }
}

/// How long a pulse is; [`check`] has let it pass.
pub fn width_cycles(pulse: TriggerPulse) -> u32 {
    u32::from(pulse.width_us) * CYCLES_PER_US
}

fn fire(lines: &mut Lines, room: &mut PulseRoom, seen: AxisSeen, motion: Motion) -> u32 {
    match lines.plan(motion) {
        PulsePlan::Wait => 0,
        PulsePlan::Fire {
            in_cycles, skipped, ..
        } => {
            // One that should have begun already begins by then.
            let soonest = seen.age_cycles() + CYCLES_PER_US;
            if !room.take(seen.at.after(in_cycles.max(soonest).into())) {
                return skipped.saturating_add(1);
            }
            // Looked at last: from here on each cycle is counted.
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
