//! Trigger pulses for a scanner: at a time interval, or where an axis crosses lines.
//!
//! # Model
//!
//! Between two positions that the board is told of, the axes move in straight lines at
//! constant speed. Lines lie across an axis one interval apart, one of them where it was
//! when the pulses were asked for. A line is crossed at the same count in both directions.
//! One that is crossed before the pause of the pulse before is over has no pulse: it is told as
//! missed by the next pulse, or by itself when no other comes.
//!
//! # Limitations
//!
//! An axis that trembles on a line gives a pulse for each crossing. A step with more than
//! [`MAX_PULSES`] gives the last ones and says how many were missed.

use umi_core::trigger::{PulseRoom, check};
use umi_core::units::Cycles;
use umi_protocol::latch::{
    LatchCause, LatchReport, Positions, TriggerOut, TriggerPulse, TriggerRefusal,
};

/// Pulses within one step, at most.
const MAX_PULSES: i64 = 1000;

/// The shortest time interval that this board keeps.
const SHORTEST_US: u32 = 20;
/// The longest: an hour.
const LONGEST_US: u32 = 3_600_000_000;
/// The virtual board's clock counts nanoseconds.
const NS_PER_US: u32 = 1000;

/// What has left a board's output.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SentPulses {
    /// Each at its beginning.
    pub latches: Vec<LatchReport>,
    /// How long they are, and how the output rests.
    pub pulse: TriggerPulse,
}

/// The pulses of a board.
#[derive(Debug, Default)]
pub(crate) struct Pulses {
    lines: Option<Lines>,
    room: Option<PulseRoom>,
    pulse: TriggerPulse,
    /// Pulses so far.
    number: u32,
    /// Lines without a pulse that nobody was told of.
    untold: u32,
}

/// Lines across an axis or in time.
#[derive(Clone, Copy, Debug)]
struct Lines {
    /// None: in time, nanoseconds.
    axis: Option<usize>,
    origin: i64,
    interval: i64,
}

impl Lines {
    /// Where along its axis a position is; none if it has no such axis.
    fn place(&self, at: &Positions) -> Option<i64> {
        match self.axis {
            Some(axis) => at.counts.get(axis).copied(),
            None => i64::try_from(at.t_ns).ok(),
        }
    }

    /// How many lines lie at or below a place, from the one at the origin.
    fn cell(&self, place: i64) -> i64 {
        place.saturating_sub(self.origin).div_euclid(self.interval)
    }
}

impl Pulses {
    /// Begins with the axes here, or ends.
    ///
    /// # Errors
    /// What this board cannot do: nothing has changed.
    pub fn ask(&mut self, when: TriggerOut, here: &Positions) -> Result<(), TriggerRefusal> {
        // A board without encoders has nothing to latch.
        if when != TriggerOut::Off && here.counts.is_empty() {
            return Err(TriggerRefusal::NoOutput);
        }
        check(when, here.counts.len(), SHORTEST_US, LONGEST_US)?;
        let (lines, pulse) = match when {
            TriggerOut::Off => {
                self.lines = None;
                return Ok(());
            }
            TriggerOut::Time { interval_us, pulse } => {
                let lines = Lines {
                    axis: None,
                    origin: 0,
                    interval: i64::from(interval_us) * i64::from(NS_PER_US),
                };
                (lines, pulse)
            }
            TriggerOut::Distance {
                axis,
                interval_counts,
                pulse,
            } => {
                let lines = Lines {
                    axis: Some(axis.into()),
                    origin: 0,
                    interval: interval_counts.into(),
                };
                (lines, pulse)
            }
        };
        let origin = lines.place(here).ok_or(TriggerRefusal::NoAxis)?;
        self.lines = Some(Lines { origin, ..lines });
        self.room = Some(PulseRoom::new(pulse, NS_PER_US));
        self.pulse = pulse;
        Ok(())
    }

    /// As [`Self::ask`], of lines of which one lies at a count.
    ///
    /// # Errors
    /// What this board cannot do: nothing has changed.
    pub fn ask_from(
        &mut self,
        when: TriggerOut,
        origin: i64,
        here: &Positions,
    ) -> Result<(), TriggerRefusal> {
        self.ask(when, here)?;
        if let Some(lines) = &mut self.lines {
            lines.origin = origin;
        }
        Ok(())
    }

    /// How they are.
    pub const fn pulse(&self) -> TriggerPulse {
        self.pulse
    }

    /// The pulses on the way from one position to the next, as latches.
    pub fn between(&mut self, from: &Positions, to: &Positions) -> Vec<LatchReport> {
        let Some((lines, start, end)) = self
            .lines
            .and_then(|lines| Some((lines, lines.place(from)?, lines.place(to)?)))
        else {
            return Vec::new();
        };
        let (first, last) = (lines.cell(start), lines.cell(end));
        let all = last.abs_diff(first);
        let told = i64::try_from(all).unwrap_or(i64::MAX).min(MAX_PULSES);
        let missed = u32::try_from(all.saturating_sub(told.unsigned_abs())).unwrap_or(u32::MAX);
        self.untold = self.untold.saturating_add(missed);
        let mut pulses = Vec::new();
        if all == 0 && self.untold > 0 {
            // No other came that could tell it.
            pulses.push(LatchReport {
                number: self.number,
                cause: LatchCause::Output,
                counts: Default::default(),
                t_ns: to.t_ns,
                missed: std::mem::take(&mut self.untold),
            });
        }
        for left in (0..told).rev() {
            // Upwards the line above a cell is crossed, downwards the one below it.
            let line = if last > first {
                last - left
            } else {
                last + left + 1
            };
            let place = lines.origin + line * lines.interval;
            let share = (place - start) as f64 / (end - start) as f64;
            let along = |from: i64, to: i64| from + ((to - from) as f64 * share).round() as i64;
            let mut counts = from.counts.clone();
            for (count, to) in counts.iter_mut().zip(&to.counts) {
                *count = along(*count, *to);
            }
            if let Some(count) = lines.axis.and_then(|axis| counts.get_mut(axis)) {
                *count = place;
            }
            let passed_ns = to.t_ns.saturating_sub(from.t_ns);
            let t_ns = from.t_ns + (passed_ns as f64 * share).round() as u64;
            if !self
                .room
                .as_mut()
                .is_none_or(|room| room.take(Cycles(t_ns)))
            {
                self.untold = self.untold.saturating_add(1);
                continue;
            }
            pulses.push(LatchReport {
                number: self.number,
                cause: LatchCause::Output,
                counts,
                t_ns,
                missed: std::mem::take(&mut self.untold),
            });
            self.number = self.number.wrapping_add(1);
        }
        pulses
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(counts: &[i64], t_ns: u64) -> Positions {
        Positions {
            counts: counts.iter().copied().collect(),
            t_ns,
            ..Positions::default()
        }
    }

    fn every(interval_us: u32, width_us: u16) -> TriggerOut {
        let pulse = TriggerPulse {
            width_us,
            ..TriggerPulse::default()
        };
        TriggerOut::Time { interval_us, pulse }
    }

    fn along(axis: u8, interval_counts: u32, width_us: u16) -> TriggerOut {
        let pulse = TriggerPulse {
            width_us,
            ..TriggerPulse::default()
        };
        TriggerOut::Distance {
            axis,
            interval_counts,
            pulse,
        }
    }

    fn places(pulses: &[LatchReport]) -> Vec<(u32, i64, i64, u64)> {
        let place = |p: &LatchReport| (p.number, p.counts[0], p.counts[1], p.t_ns);
        pulses.iter().map(place).collect()
    }

    /// To and fro, the same lines are pulsed; the other axis and the time are those of
    /// the crossing; what is not crossed is not pulsed.
    #[test]
    fn lines_are_the_same_in_both_directions() {
        let mut pulses = Pulses::default();
        pulses.ask(along(0, 100, 20), &at(&[5, 0], 0)).unwrap();
        let up = pulses.between(&at(&[5, 0], 0), &at(&[305, 600], 3_000_000));
        assert_eq!(
            places(&up),
            [
                (0, 105, 200, 1_000_000),
                (1, 205, 400, 2_000_000),
                (2, 305, 600, 3_000_000)
            ]
        );
        let none = pulses.between(&at(&[305, 600], 3_000_000), &at(&[404, 600], 4_000_000));
        assert!(none.is_empty());
        let down = pulses.between(&at(&[405, 0], 5_000_000), &at(&[-105, 0], 9_000_000));
        let lines: Vec<i64> = down.iter().map(|p| p.counts[0]).collect();
        assert_eq!(lines, [405, 305, 205, 105, 5, -95]);
        pulses.ask(TriggerOut::Off, &at(&[0, 0], 0)).unwrap();
        assert!(
            pulses
                .between(&at(&[0, 0], 0), &at(&[900, 0], 1))
                .is_empty()
        );
    }

    /// In time they come whether the axes move or not.
    #[test]
    fn time_goes_on_at_rest() {
        let mut pulses = Pulses::default();
        pulses.ask(every(50, 30), &at(&[7, 8], 1_000)).unwrap();
        let came = pulses.between(&at(&[7, 8], 1_000), &at(&[7, 8], 151_999));
        assert_eq!(
            places(&came),
            [(0, 7, 8, 51_000), (1, 7, 8, 101_000), (2, 7, 8, 151_000)]
        );
    }

    /// What is too many for one step is counted as missed, not forgotten.
    #[test]
    fn too_many_are_counted() {
        let mut pulses = Pulses::default();
        pulses.ask(along(0, 1, 20), &at(&[0, 0], 0)).unwrap();
        let came = pulses.between(&at(&[0, 0], 0), &at(&[2500, 0], 1_000_000_000));
        let missed: u32 = came.iter().map(|pulse| pulse.missed).sum();
        assert_eq!((came.len(), missed), (1000, 1500));
        assert_eq!(came.last().unwrap().counts[0], 2500);
    }

    /// A pulse and its pause are never cut short: lines that are crossed meanwhile are told as
    /// missed, by the next pulse or, where none comes, by themselves.
    #[test]
    fn an_axis_too_fast_for_its_pulses() {
        let mut pulses = Pulses::default();
        pulses.ask(along(0, 10, 100), &at(&[0], 0)).unwrap();
        // A line each 50 us: of three, one has 120 us.
        let came = pulses.between(&at(&[0], 0), &at(&[100], 500_000));
        let told: Vec<(u64, u32)> = came.iter().map(|p| (p.t_ns / 1000, p.missed)).collect();
        assert_eq!(told, [(50, 0), (200, 2), (350, 2), (500, 2)]);
        // 120 us after the last one there is room again, and not before.
        let came = pulses.between(&at(&[100], 500_000), &at(&[120], 619_000));
        assert!(came.is_empty());
        let rest = pulses.between(&at(&[120], 619_000), &at(&[125], 700_000));
        assert_eq!(rest.len(), 1);
        assert_eq!((rest[0].missed, rest[0].counts.len()), (2, 0));
        let after = pulses.between(&at(&[125], 700_000), &at(&[130], 800_000));
        assert_eq!((after[0].number, after[0].missed), (4, 0));
    }

    /// What the board cannot do is refused.
    #[test]
    fn impossible_is_refused() {
        let mut pulses = Pulses::default();
        let here = at(&[0, 0], 0);
        let width = TriggerRefusal::PulseWidth {
            least_us: 1,
            most_us: 1000,
        };
        for (when, why) in [
            (along(2, 10, 20), TriggerRefusal::NoAxis),
            (along(0, 0, 20), TriggerRefusal::NoInterval),
            (along(0, 10, 1001), width),
            (every(100, 0), width),
            (
                every(19, 1),
                TriggerRefusal::IntervalTooShort { least_us: 20 },
            ),
            (every(39, 20), TriggerRefusal::PulseTooLong { most_us: 19 }),
        ] {
            assert_eq!(pulses.ask(when, &here), Err(why), "{when:?}");
        }
        let nothing = at(&[], 0);
        let refused = pulses.ask(every(100, 20), &nothing);
        assert_eq!(refused, Err(TriggerRefusal::NoOutput));
        assert_eq!(pulses.ask(TriggerOut::Off, &nothing), Ok(()));
    }
}
