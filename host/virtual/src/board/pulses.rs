//! Trigger pulses for a scanner: at a time interval, or where an axis crosses lines.
//!
//! # Model
//!
//! Between two positions that the board is told of, the axes move in straight lines at
//! constant speed. Lines lie across an axis one interval apart, one of them where it was
//! when the pulses were asked for. A line is crossed at the same count in both directions.
//!
//! # Limitations
//!
//! An axis that trembles on a line gives a pulse for each crossing. A step with more than
//! [`MAX_PULSES`] gives the last ones and says how many were missed.

use umi_app::board::Unsupported;
use umi_protocol::latch::{LatchCause, LatchReport, Positions, TriggerOut};

/// Pulses within one step, at most.
const MAX_PULSES: i64 = 1000;

/// The shortest time interval that this board keeps.
const SHORTEST_US: u32 = 20;

/// The pulses of a board.
#[derive(Debug, Default)]
pub(crate) struct Pulses {
    lines: Option<Lines>,
    /// Pulses so far.
    number: u32,
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
    /// There is no such axis, or no such interval.
    pub fn ask(&mut self, when: TriggerOut, here: &Positions) -> Result<(), Unsupported> {
        let lines = match when {
            TriggerOut::Off => {
                self.lines = None;
                return Ok(());
            }
            TriggerOut::Time { interval_us } if interval_us >= SHORTEST_US => Lines {
                axis: None,
                origin: 0,
                interval: i64::from(interval_us) * 1000,
            },
            TriggerOut::Distance {
                axis,
                interval_counts,
            } if interval_counts > 0 => Lines {
                axis: Some(axis.into()),
                origin: 0,
                interval: interval_counts.into(),
            },
            TriggerOut::Time { .. } | TriggerOut::Distance { .. } => return Err(Unsupported),
        };
        // A board without encoders has nothing to latch.
        if here.counts.is_empty() {
            return Err(Unsupported);
        }
        let origin = lines.place(here).ok_or(Unsupported)?;
        self.lines = Some(Lines { origin, ..lines });
        Ok(())
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
        let mut missed = u32::try_from(all.saturating_sub(told.unsigned_abs())).unwrap_or(u32::MAX);
        let mut pulses = Vec::new();
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
            pulses.push(LatchReport {
                number: self.number,
                cause: LatchCause::Output,
                counts,
                t_ns: from.t_ns + (passed_ns as f64 * share).round() as u64,
                missed: std::mem::take(&mut missed),
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

    fn places(pulses: &[LatchReport]) -> Vec<(u32, i64, i64, u64)> {
        let place = |p: &LatchReport| (p.number, p.counts[0], p.counts[1], p.t_ns);
        pulses.iter().map(place).collect()
    }

    /// To and fro, the same lines are pulsed; the other axis and the time are those of
    /// the crossing; what is not crossed is not pulsed.
    #[test]
    fn lines_are_the_same_in_both_directions() {
        let mut pulses = Pulses::default();
        let distance = TriggerOut::Distance {
            axis: 0,
            interval_counts: 100,
        };
        pulses.ask(distance, &at(&[5, 0], 0)).unwrap();
        let up = pulses.between(&at(&[5, 0], 0), &at(&[305, 600], 3000));
        assert_eq!(
            places(&up),
            [
                (0, 105, 200, 1000),
                (1, 205, 400, 2000),
                (2, 305, 600, 3000)
            ]
        );
        let none = pulses.between(&at(&[305, 600], 3000), &at(&[404, 600], 4000));
        assert!(none.is_empty());
        let down = pulses.between(&at(&[405, 0], 0), &at(&[-105, 0], 5100));
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
        let time = TriggerOut::Time { interval_us: 50 };
        pulses.ask(time, &at(&[7, 8], 1_000)).unwrap();
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
        let distance = TriggerOut::Distance {
            axis: 0,
            interval_counts: 1,
        };
        pulses.ask(distance, &at(&[0, 0], 0)).unwrap();
        let came = pulses.between(&at(&[0, 0], 0), &at(&[2500, 0], 1));
        let missed: u32 = came.iter().map(|pulse| pulse.missed).sum();
        assert_eq!((came.len(), missed), (1000, 1500));
        assert_eq!(came.last().unwrap().counts[0], 2500);
    }

    /// What the board cannot do is refused.
    #[test]
    fn impossible_is_refused() {
        let mut pulses = Pulses::default();
        let distance = |axis, interval_counts| TriggerOut::Distance {
            axis,
            interval_counts,
        };
        let here = at(&[0, 0], 0);
        for when in [
            distance(2, 10),
            distance(0, 0),
            TriggerOut::Time { interval_us: 19 },
        ] {
            assert_eq!(pulses.ask(when, &here), Err(Unsupported), "{when:?}");
        }
        let nothing = at(&[], 0);
        assert!(
            pulses
                .ask(TriggerOut::Time { interval_us: 100 }, &nothing)
                .is_err()
        );
    }
}
