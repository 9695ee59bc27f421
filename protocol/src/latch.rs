//! Latches: axes and clock captured at an edge, and what a scanner needs of them.

use heapless::Vec;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;
use thiserror::Error;

/// Axes of a board, at most.
pub const MAX_AXES: usize = 6;

/// Where the axes are, and what they counted wrong since the board started.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Positions {
    /// Encoder counts of the axes, at one instant.
    pub counts: Vec<i64, MAX_AXES>,
    /// The board's clock at that instant.
    pub t_ns: u64,
    /// Transitions of each axis in which both signals changed at once: each may be a
    /// wrong count.
    pub illegal: Vec<u32, MAX_AXES>,
    /// Times at which the board itself could not keep up with its encoders. What moved
    /// meanwhile is in none of the counts.
    pub lost_samples: u32,
}

impl Positions {
    /// No motion has been lost since the board started. If some has, the counts are valid
    /// again when the board has been started anew, with the axes at their reference.
    #[must_use]
    pub const fn are_valid(&self) -> bool {
        self.lost_samples == 0
    }
}

/// Axes and clock captured at one edge.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct LatchReport {
    /// Counts latches of this cause, from 0.
    pub number: u32,
    /// What caused it.
    pub cause: LatchCause,
    /// Encoder counts of the axes at the edge. Empty: edges were missed, and this tells
    /// it because no other came.
    pub counts: Vec<i64, MAX_AXES>,
    /// The board's clock at the edge.
    pub t_ns: u64,
    /// Edges that came before this one could be read, and are lost.
    pub missed: u32,
}

/// What caused a latch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum LatchCause {
    /// The probe's skip signal.
    Skip,
    /// A scanner's trigger.
    Trigger,
    /// A trigger pulse that the board sent.
    Output,
    /// An encoder's index mark.
    Index {
        /// Of this axis, from 0.
        axis: u8,
    },
    /// The probe's skip signal fell again. Only from boards that capture both of its edges.
    SkipEnd,
}

/// The level of a signal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum SignalLevel {
    /// As it is wired to the board's input.
    #[default]
    High,
    /// The other one.
    Low,
}

/// Latches of one cause that came one after the other: the first in full, the others as
/// differences, so that ten thousand in a second find room on the link.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct LatchBatch {
    /// The first one.
    pub first: LatchReport,
    /// Those after it. None of them missed anything.
    pub steps: Vec<LatchStep, MAX_STEPS>,
}

impl LatchBatch {
    /// The latches one by one, each in full.
    pub fn reports(&self) -> impl Iterator<Item = LatchReport> + '_ {
        let mut next = self.first.clone();
        next.missed = 0;
        let later = self.steps.iter().map(move |step| {
            next.number = next.number.wrapping_add(1);
            next.t_ns = next.t_ns.wrapping_add(step.dt_ns.into());
            for (count, moved) in next.counts.iter_mut().zip(&step.dcounts) {
                *count = count.wrapping_add((*moved).into());
            }
            next.clone()
        });
        core::iter::once(self.first.clone()).chain(later)
    }
}

/// Steps in a [`LatchBatch`], at most.
pub const MAX_STEPS: usize = 15;

/// A latch by its difference from the one before.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct LatchStep {
    /// Time since the one before.
    pub dt_ns: u32,
    /// Encoder counts since the one before.
    pub dcounts: Vec<i32, MAX_AXES>,
}

/// Triggers or trigger pulses of one scan.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Scan {
    /// What caused them.
    pub cause: LatchCause,
    /// How many were captured.
    pub captured: u32,
    /// Edges that were missed between them.
    pub missed: u32,
    /// Captured but not told to the host.
    pub untold: u32,
    /// The first one's number.
    pub first: u32,
    /// The board's clock at the first.
    pub from_ns: u64,
    /// The board's clock at the last.
    pub to_ns: u64,
}

/// Latches since the board started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct LatchCounters {
    /// Captures by the probe's skip signal.
    pub skips: u32,
    /// Captures by a scanner's trigger.
    pub triggers: u32,
    /// Captures at trigger pulses of the board's own.
    pub outputs: u32,
    /// Captures at index marks.
    pub indices: u32,
    /// Edges whose capture was lost in the board, of any cause.
    pub missed: u32,
    /// Triggers and pulses that were captured but not told to the host, because it did
    /// not read them in time.
    pub untold: u32,
}

/// When the board sends a trigger pulse to a scanner, and how the pulse is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum TriggerOut {
    /// Never. The output rests as it did before.
    Off,
    /// At a time interval.
    Time {
        /// From pulse to pulse.
        interval_us: u32,
        /// Each of them.
        pulse: TriggerPulse,
    },
    /// At a distance interval along an axis, in both directions.
    Distance {
        /// Which axis, from 0.
        axis: u8,
        /// Encoder counts from pulse to pulse.
        interval_counts: u32,
        /// Each of them.
        pulse: TriggerPulse,
    },
}

/// A trigger pulse. A latch is at its beginning, whichever edge that is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct TriggerPulse {
    /// How long it is: [`TriggerPulse::LEAST_US`] to [`TriggerPulse::MOST_US`].
    pub width_us: u16,
    /// The output's level between pulses. It stays when there are no more of them, until the
    /// next request says otherwise; from its start on a board's output rests low.
    pub rests: SignalLevel,
}

impl TriggerPulse {
    /// The shortest, microseconds.
    pub const LEAST_US: u16 = 1;
    /// The longest, microseconds.
    pub const MOST_US: u16 = 1000;
    /// The pause that a pulse needs behind it, microseconds: a slow optocoupler takes that long
    /// to let go.
    pub const GAP_US: u32 = 20;

    /// From the beginning of a pulse to that of the next, at least, microseconds.
    #[must_use]
    pub const fn least_interval_us(self) -> u32 {
        self.width_us as u32 + Self::GAP_US
    }
}

impl Default for TriggerPulse {
    /// What a Gocator needs at its trigger input: 20 us, and the line rests low.
    fn default() -> Self {
        Self {
            width_us: 20,
            rests: SignalLevel::Low,
        }
    }
}

/// Why a board does not send such trigger pulses. Nothing has changed.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error, IntoStaticStr,
)]
#[strum(serialize_all = "snake_case")]
#[postcard(crate = crate)]
pub enum TriggerRefusal {
    /// The board has no output for them, or cannot latch what it would send.
    #[error("this board sends no trigger pulses: let the sensor trigger the board")]
    NoOutput,
    /// It has no such axis.
    #[error("this board has no such axis")]
    NoAxis,
    /// The interval is shorter than the board keeps.
    #[error("this board keeps no interval below {least_us} us")]
    IntervalTooShort {
        /// The shortest, microseconds.
        least_us: u32,
    },
    /// The interval is longer than the board can count.
    #[error("this board keeps no interval beyond {most_us} us")]
    IntervalTooLong {
        /// The longest, microseconds.
        most_us: u32,
    },
    /// An interval of no counts.
    #[error("an interval of no counts is none")]
    NoInterval,
    /// No pulse is as short or as long as that.
    #[error("a pulse is {least_us} to {most_us} us wide")]
    PulseWidth {
        /// The shortest, microseconds.
        least_us: u16,
        /// The longest, microseconds.
        most_us: u16,
    },
    /// Pulse and pause do not fit in the interval.
    #[error(
        "pulse and pause do not fit in the interval: it leaves {most_us} us for a pulse, beside \
         the {} us behind it",
        TriggerPulse::GAP_US
    )]
    PulseTooLong {
        /// What the interval leaves for a pulse, microseconds.
        most_us: u32,
    },
    /// The pulses are those of the distance sensor that is set up on the board.
    #[error(
        "the board's trigger pulses are those of its distance sensor: take that away first (umi scan serve --off)"
    )]
    OfTheSensor,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A batch unfolds into what went into it; only the first tells of missed edges, and
    /// number and counts may pass their ends.
    #[test]
    fn a_batch_unfolds() {
        let report = |number, t_ns, counts: [i64; 2], missed| LatchReport {
            number,
            cause: LatchCause::Output,
            counts: counts.into_iter().collect(),
            t_ns,
            missed,
        };
        let step = |dt_ns, dcounts: [i32; 2]| LatchStep {
            dt_ns,
            dcounts: dcounts.into_iter().collect(),
        };
        let batch = LatchBatch {
            first: report(u32::MAX, 5_000_000_000, [-3, 1 << 40], 7),
            steps: [step(100_000, [5, -1]), step(u32::MAX, [i32::MIN, 0])]
                .into_iter()
                .collect(),
        };
        let expected = [
            report(u32::MAX, 5_000_000_000, [-3, 1 << 40], 7),
            report(0, 5_000_100_000, [2, (1 << 40) - 1], 0),
            report(1, 9_295_067_295, [-2_147_483_646, (1 << 40) - 1], 0),
        ];
        assert!(batch.reports().eq(expected));
    }
}
