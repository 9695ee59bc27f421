//! Trigger pulses: the cycle in which the next one is due, along an axis or in time.
//!
//! # Design
//!
//! Lines lie across the axis, one each `interval_counts`. The crossing of a line
//! is foreseen from a position and what the axis has moved lately, so that
//! hardware can emit the pulse in the right cycle, whatever interrupts do. A tick
//! asks each time what is to be done until the next one ([`Lines::plan`]); if the
//! axis turned out to be faster than foreseen, the pulse comes at once.
//!
//! A count is the space between two edges of the encoder, and a line is an edge:
//! the same one in both directions. Between two edges the axis is taken to be in
//! the middle.
//!
//! # Tradeoffs
//!
//! * At most one pulse a tick: an axis that crosses more lines than that is too
//!   fast, the rest is counted ([`PulsePlan::Fire::skipped`]) and the pulse that comes
//!   says so.
//! * A foreseen pulse cannot be called back. If the axis stops or turns within the
//!   tick, there is a pulse without a crossing, as far before the line as it came.
//!   The position that is latched with each pulse tells the truth.
//! * A line is not pulsed again before the axis has been half an interval away
//!   from it, and farther than where the pulse was planned. So an axis that
//!   trembles on a line gives one pulse, and so does a crossing that was foreseen
//!   too early; and a scan to and fro gives the same lines in both directions, but
//!   for the last one if it turns within half an interval of it.

use core::num::{NonZeroU32, NonZeroU64};

use crate::capture::stamp::Rate;
use crate::units::Counts;

mod pulse;

pub use pulse::{PulseRoom, check};

/// What an axis does, as it is known at a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Motion {
    /// The position now.
    pub position: Counts,
    /// What it has moved lately, in counts with their sign...
    pub moved: i32,
    /// ...and in how many cycles.
    pub in_cycles: NonZeroU32,
}

/// Why there can be no pulses like that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unplannable {
    /// The interval is zero.
    NoInterval,
    /// The interval is shorter than a pulse and the pause that must follow it.
    TooShort,
    /// The interval is longer than what can be counted.
    TooLong,
}

/// What to do until the next tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PulsePlan {
    /// No line will be crossed.
    Wait,
    /// Emit one pulse.
    Fire {
        /// In so many cycles from now; 0 is at once.
        in_cycles: u32,
        /// The line, counted from the origin.
        line: i64,
        /// Lines that were crossed without a pulse of their own before this one:
        /// the axis is too fast.
        skipped: u32,
    },
}

/// A pulse whose line has not been crossed yet.
#[derive(Clone, Copy, Debug)]
struct Foreseen {
    line: i64,
    /// The axis has turned when it is so far away from the line.
    away_half_counts: u64,
}

/// Pulses at a distance interval along an axis.
///
/// ```
/// use core::num::NonZeroU32;
/// use umi_core::trigger::{Lines, Motion, PulsePlan};
/// use umi_core::units::Counts;
///
/// // A line each 100 counts from position 0 on; ticks of 6250 cycles at most.
/// let mut lines = Lines::new(Counts(0), 100, 6_250).unwrap();
/// let motion = |counts| Motion {
///     position: Counts(counts),
///     moved: 10,
///     in_cycles: NonZeroU32::new(6_250).unwrap(),
/// };
/// assert_eq!(lines.plan(motion(80)), PulsePlan::Wait);
/// let PulsePlan::Fire { in_cycles, line: 1, skipped: 0 } = lines.plan(motion(90)) else {
///     panic!("9.5 of 10 counts: before the next tick");
/// };
/// assert_eq!(in_cycles, 5_937);
/// assert_eq!(lines.plan(motion(100)), PulsePlan::Wait, "that crossing had its pulse");
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Lines {
    origin: Counts,
    interval: NonZeroU32,
    horizon_cycles: u32,
    /// The axis was between this line and the next one up at the tick before.
    /// None at the first.
    cell: Option<i64>,
    /// The line that was crossed last, until the axis is half an interval away.
    near: Option<i64>,
    foreseen: Option<Foreseen>,
    skipped: u32,
}

impl Lines {
    /// Lines at `origin` and each `interval_counts` from there, in both directions.
    /// What is crossed within `horizon_cycles` is foreseen: the longest time from
    /// one tick to the next.
    ///
    /// The axis is taken to stand on the origin's line: it has to leave it first.
    ///
    /// # Errors
    /// [`Unplannable::NoInterval`].
    pub fn new(
        origin: Counts,
        interval_counts: u32,
        horizon_cycles: u32,
    ) -> Result<Self, Unplannable> {
        let interval = NonZeroU32::new(interval_counts).ok_or(Unplannable::NoInterval)?;
        Ok(Self {
            origin,
            interval,
            horizon_cycles,
            cell: None,
            near: Some(0),
            foreseen: None,
            skipped: 0,
        })
    }

    /// Lines that were crossed without a pulse, in all.
    #[must_use]
    pub const fn skipped(&self) -> u32 {
        self.skipped
    }

    /// What to do from now until the next tick.
    ///
    /// The condition: since the tick before, the axis has not turned round a line
    /// and back (it would have to be faster than a tick).
    pub fn plan(&mut self, motion: Motion) -> PulsePlan {
        let cell = self.cell_of(motion.position);
        let before = self.cell.replace(cell).unwrap_or(cell);
        if let Some((line, skipped)) = self.crossed(before, cell) {
            self.skipped = self.skipped.saturating_add(skipped);
            return PulsePlan::Fire {
                in_cycles: 0,
                line,
                skipped,
            };
        }
        let near = self.near;
        self.near =
            near.filter(|line| self.half_counts(*line, motion.position) < self.half_interval());
        self.foreseen = self.foreseen.filter(|foreseen| {
            self.half_counts(foreseen.line, motion.position) < foreseen.away_half_counts
        });
        self.foresee(cell, motion)
    }

    /// Notes which lines lie between two cells. Returns the latest of them whose
    /// pulse is still due, and how many more there are.
    fn crossed(&mut self, before: i64, cell: i64) -> Option<(i64, u32)> {
        let mut number = cell.abs_diff(before);
        if number == 0 {
            return None;
        }
        let (first, mut last, onward) = if cell > before {
            (before.saturating_add(1), cell, 1)
        } else {
            (before, cell.saturating_add(1), -1)
        };
        let near = self.near.replace(last);
        // The one that is near is the first, one that was foreseen comes behind it.
        if near == Some(first) {
            number -= 1;
        }
        if let Some(Foreseen { line, .. }) = self.foreseen
            && (line == first || line == last)
        {
            self.foreseen = None;
            number = number.saturating_sub(1);
            if line == last {
                last = last.saturating_sub(onward);
            }
        }
        let skipped = u32::try_from(number.checked_sub(1)?).unwrap_or(u32::MAX);
        Some((last, skipped))
    }

    /// The next line in the direction of motion, if it comes soon enough.
    fn foresee(&mut self, cell: i64, motion: Motion) -> PulsePlan {
        let line = match motion.moved {
            0 => return PulsePlan::Wait,
            1.. => cell.saturating_add(1),
            _ => cell,
        };
        // One at a time: what is behind a foreseen line waits until that is crossed.
        if self.near == Some(line) || self.foreseen.is_some() {
            return PulsePlan::Wait;
        }
        let half_counts = self.half_counts(line, motion.position);
        let speed = u64::from(motion.moved.unsigned_abs()) * 2;
        let time = half_counts.saturating_mul(motion.in_cycles.get().into());
        // Compare before dividing: most ticks have nothing to do.
        if time >= u64::from(self.horizon_cycles).saturating_mul(speed) {
            return PulsePlan::Wait;
        }
        let Some(speed) = NonZeroU64::new(speed) else {
            return PulsePlan::Wait;
        };
        let in_cycles = u32::try_from(time / speed).unwrap_or(self.horizon_cycles);
        self.foreseen = Some(Foreseen {
            line,
            away_half_counts: half_counts.saturating_add(1).max(self.half_interval()),
        });
        PulsePlan::Fire {
            in_cycles,
            line,
            skipped: 0,
        }
    }

    /// The number of the line at or below a position.
    fn cell_of(&self, position: Counts) -> i64 {
        let interval = i64::from(self.interval.get());
        position.0.wrapping_sub(self.origin.0).div_euclid(interval)
    }

    fn at(&self, line: i64) -> i64 {
        let counts = line.wrapping_mul(self.interval.get().into());
        self.origin.0.wrapping_add(counts)
    }

    /// From the middle of a count to a line. In half counts, which are whole numbers.
    fn half_counts(&self, line: i64, position: Counts) -> u64 {
        let edges = self.at(line).wrapping_sub(position.0);
        edges.saturating_mul(2).saturating_sub(1).unsigned_abs()
    }

    /// Half an interval, in half counts.
    fn half_interval(&self) -> u64 {
        self.interval.get().into()
    }
}

/// The cycles from pulse to pulse at a time interval, exactly.
///
/// `least_cycles` is what the board takes for a pulse and the pause behind it.
///
/// # Errors
/// [`Unplannable`].
///
/// ```
/// use umi_core::trigger::{Unplannable, pulse_period};
///
/// assert_eq!(pulse_period::<125_000_000>(100, 2_000).map(|n| n.get()), Ok(12_500));
/// assert_eq!(pulse_period::<125_000_000>(1, 2_000), Err(Unplannable::TooShort));
/// ```
pub fn pulse_period<const HZ: u32>(
    interval_us: u32,
    least_cycles: u32,
) -> Result<NonZeroU32, Unplannable> {
    const {
        assert!(
            HZ.is_multiple_of(1_000_000),
            "a microsecond is not a whole number of cycles"
        )
    };
    if interval_us == 0 {
        return Err(Unplannable::NoInterval);
    }
    let cycles = Rate::<HZ>::cycles(interval_us.into());
    let cycles = u32::try_from(cycles.0).map_err(|_| Unplannable::TooLong)?;
    NonZeroU32::new(cycles)
        .filter(|cycles| cycles.get() >= least_cycles)
        .ok_or(Unplannable::TooShort)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;
    use std::vec::Vec;

    const TICK: u32 = 6_250;
    /// Places on the path at which it is known, per tick.
    const FINE: usize = 50;

    /// A pulse: the line it was for, and where the axis truly was.
    #[derive(Clone, Copy, Debug)]
    struct Pulse {
        line: i64,
        position: f64,
    }

    struct Ride {
        pulses: Vec<Pulse>,
        /// Lines as a switch with half an interval of play would see them.
        crossings: Vec<i64>,
        skipped: u32,
        /// For each pulse, how far the axis was from its line since the line's last one.
        away: Vec<f64>,
    }

    /// Drives along a path, given `FINE` times a tick in counts, and asks at each tick.
    fn ride(path: &[f64], interval: u32) -> Ride {
        let width = f64::from(interval);
        let mut lines = Lines::new(Counts(0), interval, TICK).unwrap();
        let (mut pulses, mut away) = (Vec::new(), Vec::new());
        let mut pulsed_at = BTreeMap::<i64, usize>::new();
        let count = |at: usize| path[at].floor() as i64;
        for tick in 0..path.len() / FINE - 1 {
            let at = tick * FINE;
            let plan = lines.plan(Motion {
                position: Counts(count(at)),
                moved: (count(at) - count(at.saturating_sub(FINE))) as i32,
                in_cycles: NonZeroU32::new(TICK).unwrap(),
            });
            let PulsePlan::Fire {
                in_cycles, line, ..
            } = plan
            else {
                continue;
            };
            assert!(in_cycles < TICK, "within the tick");
            let exact = in_cycles as f64 / f64::from(TICK) * FINE as f64;
            let fires = (at + exact.floor() as usize).min(path.len() - 2);
            let position = path[fires] + (path[fires + 1] - path[fires]) * exact.fract();
            let centre = line as f64 * width;
            let since = pulsed_at.insert(line, fires).unwrap_or(0);
            let farthest = path[since..=fires]
                .iter()
                .fold(0.0_f64, |far, x| far.max((x - centre).abs()));
            away.push(farthest);
            pulses.push(Pulse { line, position });
        }
        Ride {
            pulses,
            crossings: crossings(path, width),
            skipped: lines.skipped(),
            away,
        }
    }

    /// The referee: each line is a switch that must be left by half an interval.
    fn crossings(path: &[f64], width: f64) -> Vec<i64> {
        let mut list = Vec::new();
        let mut off = Some(0_i64);
        for pair in path.windows(2) {
            let (a, b) = (
                (pair[0] / width).floor() as i64,
                (pair[1] / width).floor() as i64,
            );
            if off.is_some_and(|line| (pair[1] - line as f64 * width).abs() >= width / 2.0) {
                off = None;
            }
            let line = a.max(b);
            if a != b && off != Some(line) {
                list.push(line);
                off = Some(line);
            }
        }
        list
    }

    fn line_numbers(ride: &Ride) -> Vec<i64> {
        ride.pulses.iter().map(|pulse| pulse.line).collect()
    }

    fn worst_counts(ride: &Ride, interval: u32) -> f64 {
        ride.pulses
            .iter()
            .map(|pulse| (pulse.position - pulse.line as f64 * f64::from(interval)).abs())
            .fold(0.0, f64::max)
    }

    /// Both directions, any speed below a line a tick: each line once, in order,
    /// within 1.5 counts of where it is: half a count of position, one of velocity.
    #[test]
    fn steady_motion() {
        for interval in [5_u32, 100, 977] {
            for per_tick in [0.01, 0.1, 0.5, 0.9, 0.99_f64] {
                for direction in [1.0, -1.0] {
                    let speed = per_tick * f64::from(interval) * direction / FINE as f64;
                    let ticks = (20.0 / per_tick) as usize;
                    let path: Vec<f64> =
                        (0..ticks * FINE).map(|n| 0.25 + speed * n as f64).collect();
                    let ride = ride(&path, interval);
                    let note = std::format!("{interval} {per_tick} {direction}");
                    assert!(ride.crossings.len() >= 18, "{note}");
                    // The pulse of the last line may come before or after the end.
                    let (seen, true_ones) = (line_numbers(&ride), &ride.crossings);
                    let both = seen.len().min(true_ones.len());
                    assert_eq!(seen[..both], true_ones[..both], "{note}");
                    assert!(seen.len().abs_diff(true_ones.len()) <= 1, "{note}");
                    assert_eq!(ride.skipped, 0, "{note}");
                    let worst = worst_counts(&ride, interval);
                    assert!(worst <= 1.5, "{worst} {note}");
                }
            }
        }
    }

    /// To and fro over many lines, turning between two: the same lines as a switch
    /// at each would give, none twice, none left out.
    #[test]
    fn to_and_fro() {
        for turns_at in [3.2_f64, 7.6, 12.8] {
            let amplitude = turns_at * 1_000.0;
            let path: Vec<f64> = (0..4_000 * FINE)
                .map(|n| amplitude * (n as f64 / FINE as f64 / 30.0 / turns_at).sin() + 0.5)
                .collect();
            let ride = ride(&path, 1_000);
            assert!(ride.crossings.len() > 50);
            assert_eq!(line_numbers(&ride), ride.crossings, "{turns_at}");
            assert_eq!(ride.skipped, 0);
            let worst = worst_counts(&ride, 1_000);
            assert!(worst <= 2.5, "{worst}");
        }
    }

    /// An axis that stands and trembles on a line gives the one pulse of its arrival.
    #[test]
    fn standing_on_a_line() {
        let arrive = (0..100 * FINE).map(|n| n as f64 / FINE as f64);
        let tremble = (0..500 * FINE).map(|n| 100.0 + 3.0 * (n as f64 * 0.7).sin());
        let path: Vec<f64> = arrive.chain(tremble).collect();
        assert_eq!(line_numbers(&ride(&path, 100)), [1]);
    }

    /// Faster than a line a tick: one pulse a tick, the rest is counted, and the sum
    /// is what there was.
    #[test]
    fn too_fast() {
        for per_tick in [1.5_f64, 3.0, 17.3] {
            let speed = per_tick * 100.0 / FINE as f64;
            let path: Vec<f64> = (0..100 * FINE).map(|n| 0.5 + speed * n as f64).collect();
            let ride = ride(&path, 100);
            assert!(ride.skipped > 0, "{per_tick}");
            let told = ride.pulses.len() + ride.skipped as usize;
            let seen = path[98 * FINE] / 100.0;
            assert!((told as f64 - seen).abs() <= 1.0, "{told} of {seen}");
            let lines = line_numbers(&ride);
            assert!(lines.is_sorted_by(|a, b| a < b), "each once, in order");
        }
    }

    proptest! {
        /// Any motion, with jerks and turns anywhere: no line gets a second pulse
        /// before the axis has been half an interval away from it; and as long as no
        /// line was skipped, every line that was crossed has had one.
        #[test]
        fn any_motion(
            legs in prop::collection::vec((1_usize..30, -1.0_f64..1.0), 1..40),
            interval in 4_u32..300,
        ) {
            let mut path = std::vec![0.5_f64];
            for (ticks, lines_per_tick) in &legs {
                let speed = lines_per_tick * f64::from(interval) / FINE as f64;
                for _ in 0..ticks * FINE {
                    path.push(path.last().unwrap() + speed);
                }
            }
            // Stands still at the end, so that a late pulse can come.
            path.extend(std::vec![*path.last().unwrap(); 3 * FINE]);
            let ride = ride(&path, interval);
            for (pulse, away) in ride.pulses.iter().zip(&ride.away) {
                prop_assert!(*away + 1.0 >= f64::from(interval) / 2.0, "{pulse:?}: {away}");
            }
            let mut lines = line_numbers(&ride);
            lines.push(0);
            if ride.skipped == 0 {
                for line in &ride.crossings {
                    prop_assert!(lines.contains(line), "line {line} of {lines:?}");
                }
            }
        }
    }

    /// What cannot be planned is refused by name.
    #[test]
    fn refusals() {
        assert_eq!(
            Lines::new(Counts(0), 0, TICK).unwrap_err(),
            Unplannable::NoInterval
        );
        let period = pulse_period::<240_000_000>;
        assert_eq!(period(0, 0), Err(Unplannable::NoInterval));
        assert_eq!(period(9, 2_400), Err(Unplannable::TooShort));
        assert_eq!(period(10, 2_400).map(NonZeroU32::get), Ok(2_400));
        assert_eq!(
            period(17_895_697, 1).map(NonZeroU32::get),
            Ok(4_294_967_280)
        );
        assert_eq!(period(17_895_698, 1), Err(Unplannable::TooLong));
    }

    /// At the ends of what 64 bits hold there is no pulse out of nothing and no panic.
    #[test]
    fn extremes() {
        for position in [i64::MIN, i64::MIN + 1, -1, 0, i64::MAX] {
            for moved in [i32::MIN, -1, 0, 1, i32::MAX] {
                for origin in [i64::MIN, 0, i64::MAX] {
                    let mut lines = Lines::new(Counts(origin), u32::MAX, u32::MAX).unwrap();
                    for position in [0, position] {
                        lines.plan(Motion {
                            position: Counts(position),
                            moved,
                            in_cycles: NonZeroU32::MAX,
                        });
                    }
                }
            }
        }
    }
}
