//! A pulse at a line scanner's trigger input, and where the axes are then.
//!
//! The sensor's input takes rises. A board's output that rests high falls when a pulse begins and
//! rises when it ends: such a sensor takes its profile at the end of the pulse, and where the axes
//! are then.

use umi_protocol::latch::{LatchReport, SignalLevel, TriggerPulse};
use umi_virtual::scene::MachineSpec;

use crate::{AxisCounts, ENCODERS};

/// A pulse at the sensor.
#[derive(Clone, Copy, Debug)]
pub struct Shot {
    /// When, on the board's clock.
    pub at_us: f64,
    pub(crate) counts: AxisCounts,
    /// Counts per microsecond.
    pub(crate) speed: [f64; ENCODERS],
    /// How long the line is high.
    pub high_us: f64,
}

impl Shot {
    /// Where the axes are in truth so many microseconds later, mm and degrees, X Y Z first: homing
    /// and scale are errors that nobody at the machine sees.
    #[must_use]
    pub fn places(&self, machine: &MachineSpec, us: f64) -> Vec<f64> {
        let counts = |axis: usize| self.counts.all[axis] as f64 + self.speed[axis] * us;
        let linear = (0..3).map(|axis| {
            let shown =
                (counts(axis) - machine.origin_counts[axis] as f64) / machine.counts_per_mm[axis];
            shown * (1.0 + machine.scale_error_ppm[axis] * 1e-6) + machine.homing_error_mm[axis]
        });
        let rotary =
            machine.rotary.iter().zip(3..ENCODERS).map(|(axis, place)| {
                (counts(place) - axis.origin_counts as f64) / axis.counts_per_deg
            });
        linear.chain(rotary).collect()
    }
}

/// Counts per microsecond from one place to the next.
pub(crate) fn speed(from: (u64, AxisCounts), to: (u64, AxisCounts)) -> [f64; ENCODERS] {
    let passed_us = to.0.saturating_sub(from.0) as f64;
    std::array::from_fn(|axis| {
        if passed_us > 0.0 {
            (to.1.all[axis] - from.1.all[axis]) as f64 / passed_us
        } else {
            0.0
        }
    })
}

/// When the line rises by a pulse, and for how long.
pub(crate) fn rise(
    latch: &LatchReport,
    pulse: TriggerPulse,
    axes: usize,
    speed: [f64; ENCODERS],
) -> Shot {
    let width_us = f64::from(pulse.width_us);
    let (after_us, high_us) = match pulse.rests {
        SignalLevel::Low => (0.0, width_us),
        SignalLevel::High => (width_us, f64::from(TriggerPulse::GAP_US)),
    };
    let counts = |axis: usize| {
        let began = latch.counts.get(axis).copied().unwrap_or(0);
        began + (speed[axis] * after_us).round() as i64
    };
    Shot {
        at_us: latch.t_ns as f64 * 1e-3 + after_us,
        counts: AxisCounts {
            all: std::array::from_fn(counts),
            axes,
        },
        speed,
        high_us,
    }
}
