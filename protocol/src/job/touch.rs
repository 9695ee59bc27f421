//! The probe's skip line: the second witness, and which of its edges is the touch.

use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::latch::{LatchCause, SignalLevel};

/// The second witness: the axes latched by the probe's skip line, held against what
/// the control prints.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct WitnessSpec {
    /// Encoder counts per millimetre of X, Y and Z; negative where they count down
    /// when the control's coordinate grows.
    pub counts_per_mm: [f64; 3],
    /// Counts at the origin of the coordinates that the control prints. Absent: the
    /// first setup that is OK after a start or a new job says where it is, and every
    /// later setup must agree.
    #[serde(default)]
    pub origin_counts: Option<[f64; 3]>,
    /// Gauging feed, where the lines do not carry it.
    #[serde(default)]
    pub feed_mm_per_min: Option<f64>,
    /// The control's longest delay between the skip signal and the position that it
    /// stores.
    pub delay_ms: f64,
    /// What the two witnesses may differ by beyond that delay: rounding, jitter.
    pub tolerance_mm: f64,
}

/// How the probe's skip line is conditioned: which of its edges is the touch. How, is with the
/// board's brain (`umi_core::job::skip`).
///
/// ```toml
/// [skip]
/// active = "low"         # the line rests high and falls when the probe touches
/// min_width_us = 5       # what is narrower is a spark
/// hold_off_ms = 20       # the line rests so long before a touch
/// delay_us = 12.5        # from the probe to the board's input: isolator, interface
/// each_hit = true        # a hit that is printed without a touch is refused
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields, default)]
pub struct SkipSpec {
    /// The level at the board's input while the probe touches.
    pub active: SignalLevel,
    /// A pulse that is narrower is a spark, microseconds: 5 where absent.
    pub min_width_us: Option<u16>,
    /// The line rests for so long before a touch, milliseconds: 20 where absent.
    pub hold_off_ms: Option<u16>,
    /// The constant delay of the signal until the board's input, microseconds: the way at the
    /// gauging feed in it is taken off each touch.
    pub delay_us: f64,
    /// Each hit needs its touch on this line: before its own line, or, of a block, before the
    /// block's first line. It needs no encoders.
    pub each_hit: bool,
}

impl SkipSpec {
    /// The narrowest pulse that counts, microseconds.
    #[must_use]
    pub const fn min_width_us(&self) -> u16 {
        match self.min_width_us {
            Some(us) => us,
            None => 5,
        }
    }

    /// The edge by which a touch begins.
    #[must_use]
    pub const fn touches_by(&self) -> LatchCause {
        match self.active {
            SignalLevel::High => LatchCause::Skip,
            SignalLevel::Low => LatchCause::SkipEnd,
        }
    }

    /// How long the line rests before a touch, milliseconds.
    #[must_use]
    pub const fn hold_off_ms(&self) -> u16 {
        match self.hold_off_ms {
            Some(ms) => ms,
            None => 20,
        }
    }
}
