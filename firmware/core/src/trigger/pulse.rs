//! How long a trigger pulse lasts, and what must fit behind it.
//!
//! # Design
//!
//! A pulse and the pause behind it take [`TriggerPulse::least_interval_us`]. At a time interval
//! they fit or are refused before the first pulse. At a distance interval it depends on the speed:
//! a line that is crossed before the pause of the pulse before is over gets no pulse, and is
//! counted as every other pulse that a board could not send ([`PulseRoom`]). A pulse is never cut
//! and never late: it would tell a sensor of another place.

use umi_protocol::latch::{TriggerOut, TriggerPulse, TriggerRefusal};

use crate::units::Cycles;

/// Whether a board of so many axes can send such pulses; it keeps intervals from
/// `least_interval_us` to `most_interval_us`.
///
/// # Errors
/// What it cannot do.
///
/// ```
/// use umi_core::trigger::check;
/// use umi_protocol::latch::{TriggerOut, TriggerPulse, TriggerRefusal};
///
/// let pulse = TriggerPulse { width_us: 81, ..TriggerPulse::default() };
/// let every = |interval_us| TriggerOut::Time { interval_us, pulse };
/// assert_eq!(check(every(101), 3, 100, 1_000_000), Ok(()));
/// let refused = Err(TriggerRefusal::PulseTooLong { most_us: 80 });
/// assert_eq!(check(every(100), 3, 100, 1_000_000), refused);
/// ```
pub fn check(
    when: TriggerOut,
    axes: usize,
    least_interval_us: u32,
    most_interval_us: u32,
) -> Result<(), TriggerRefusal> {
    let pulse = match when {
        TriggerOut::Off => return Ok(()),
        TriggerOut::Time { pulse, .. } | TriggerOut::Distance { pulse, .. } => pulse,
    };
    let (least_us, most_us) = (TriggerPulse::LEAST_US, TriggerPulse::MOST_US);
    if !(least_us..=most_us).contains(&pulse.width_us) {
        return Err(TriggerRefusal::PulseWidth { least_us, most_us });
    }
    match when {
        TriggerOut::Off => Ok(()),
        TriggerOut::Time { interval_us, .. } => {
            if interval_us < least_interval_us {
                let least_us = least_interval_us;
                return Err(TriggerRefusal::IntervalTooShort { least_us });
            }
            if interval_us > most_interval_us {
                let most_us = most_interval_us;
                return Err(TriggerRefusal::IntervalTooLong { most_us });
            }
            if interval_us < pulse.least_interval_us() {
                let most_us = interval_us.saturating_sub(TriggerPulse::GAP_US);
                return Err(TriggerRefusal::PulseTooLong { most_us });
            }
            Ok(())
        }
        TriggerOut::Distance {
            axis,
            interval_counts,
            ..
        } => {
            if usize::from(axis) >= axes {
                return Err(TriggerRefusal::NoAxis);
            }
            if interval_counts == 0 {
                return Err(TriggerRefusal::NoInterval);
            }
            Ok(())
        }
    }
}

/// When the output has room for another pulse.
///
/// ```
/// use umi_core::trigger::PulseRoom;
/// use umi_core::units::Cycles;
/// use umi_protocol::latch::TriggerPulse;
///
/// // 20 us and a pause of 20 us, at 125 MHz.
/// let mut room = PulseRoom::new(TriggerPulse::default(), 125);
/// assert!(room.take(Cycles(1_000)));
/// assert!(!room.take(Cycles(5_999)));
/// assert!(room.take(Cycles(6_000)));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PulseRoom {
    taken_cycles: u64,
    free_at: Option<Cycles>,
}

impl PulseRoom {
    /// For pulses like this one, of a clock of so many cycles a microsecond. No pulse was before.
    #[must_use]
    pub const fn new(pulse: TriggerPulse, cycles_per_us: u32) -> Self {
        Self {
            taken_cycles: pulse.least_interval_us() as u64 * cycles_per_us as u64,
            free_at: None,
        }
    }

    /// A pulse is to begin at a time, not before the one that was asked for last. False: there is
    /// no room, and it is none.
    #[inline(always)] // Where each cycle puts off a pulse.
    pub fn take(&mut self, at: Cycles) -> bool {
        let is_free = self.free_at.is_none_or(|free_at| at >= free_at);
        if is_free {
            self.free_at = Some(at.after(self.taken_cycles));
        }
        is_free
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;
    use umi_protocol::latch::SignalLevel;

    const LEAST_US: u32 = 100;
    const MOST_US: u32 = 1_000_000;

    fn every(interval_us: u32, width_us: u16) -> Result<(), TriggerRefusal> {
        let pulse = TriggerPulse {
            width_us,
            rests: SignalLevel::High,
        };
        let when = TriggerOut::Time { interval_us, pulse };
        check(when, 3, LEAST_US, MOST_US)
    }

    fn along(axis: u8, interval_counts: u32, width_us: u16) -> Result<(), TriggerRefusal> {
        let pulse = TriggerPulse {
            width_us,
            ..TriggerPulse::default()
        };
        let when = TriggerOut::Distance {
            axis,
            interval_counts,
            pulse,
        };
        check(when, 3, LEAST_US, MOST_US)
    }

    /// Each reason by its name, and what lies just inside is taken.
    #[test]
    fn what_does_not_fit_is_refused_by_name() {
        let width = Err(TriggerRefusal::PulseWidth {
            least_us: 1,
            most_us: 1000,
        });
        for width_us in [0, 1001, u16::MAX] {
            assert_eq!(every(5000, width_us), width);
            assert_eq!(along(0, 100, width_us), width);
        }
        assert_eq!(every(100, 1), Ok(()));
        assert_eq!(every(100, 80), Ok(()));
        assert_eq!(
            every(1019, 1000),
            Err(TriggerRefusal::PulseTooLong { most_us: 999 })
        );
        assert_eq!(every(1020, 1000), Ok(()));
        let short = TriggerRefusal::IntervalTooShort { least_us: LEAST_US };
        for interval_us in [0, 99] {
            assert_eq!(every(interval_us, 20), Err(short));
        }
        assert_eq!(every(MOST_US, 1000), Ok(()));
        let long = TriggerRefusal::IntervalTooLong { most_us: MOST_US };
        assert_eq!(every(MOST_US + 1, 20), Err(long));
        assert_eq!(along(2, 1, 1000), Ok(()));
        assert_eq!(along(3, 1, 20), Err(TriggerRefusal::NoAxis));
        assert_eq!(along(0, 0, 20), Err(TriggerRefusal::NoInterval));
        assert_eq!(check(TriggerOut::Off, 0, LEAST_US, MOST_US), Ok(()));
    }

    proptest! {
        /// Pulses that are sent never touch: between any two there is the pause. And none is
        /// dropped that had room.
        #[test]
        fn pulses_keep_their_pause(
            steps in prop::collection::vec(0_u64..300_000, 1..200),
            width_us in 1_u16..=1000,
        ) {
            let pulse = TriggerPulse { width_us, ..TriggerPulse::default() };
            let mut room = PulseRoom::new(pulse, 125);
            let taken = (u64::from(width_us) + 20) * 125;
            let (mut at, mut sent) = (0, Vec::<u64>::new());
            for step in steps {
                at += step;
                let free = sent.last().is_none_or(|last| at - last >= taken);
                prop_assert_eq!(room.take(Cycles(at)), free);
                if free {
                    sent.push(at);
                }
            }
        }
    }
}
