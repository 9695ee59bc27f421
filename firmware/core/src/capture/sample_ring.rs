//! Sample rings: the sample that belongs to an instant.
//!
//! Hardware writes the positions of all axes into rings, one sample each so many
//! cycles, all from the same start. So the instant of an edge says in which slot
//! the positions of that moment stand, as long as the ring has not come round:
//! whoever asks may be late by almost a whole ring.
//!
//! # Design
//!
//! Nothing is counted when a sample is written. All that can go wrong is that the
//! writer falls out of step with the clock, which [`SampleRing::check`] finds by
//! comparing where it writes with where it should. From then on no position is
//! given out until [`SampleRing::restart`]: a wrong position would be silent.

use core::num::NonZeroU32;

use crate::units::Cycles;

/// How samples are taken and stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cadence {
    /// Cycles from one sample to the next.
    pub period_cycles: NonZeroU32,
    /// Slots of the ring.
    pub slots: NonZeroU32,
    /// At most so many cycles after it was taken, a sample is in the ring.
    pub delay_cycles: u32,
}

impl Cadence {
    /// Cycles until a slot is used again.
    #[must_use]
    pub const fn lap_cycles(&self) -> u64 {
        // Both are 32 bits: no overflow.
        self.period_cycles.get() as u64 * self.slots.get() as u64
    }
}

/// Where the sample of an instant stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// Its slot.
    pub slot: u32,
    /// When it was taken: the instant that was asked for, or less than a period before.
    pub taken: Cycles,
    /// From then on the slot may hold the next sample. Read the slot, then the
    /// clock: if it is still before this instant, what was read is this sample.
    pub good_until: Cycles,
}

/// Why there is no sample for an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotThere {
    /// The ring has come round, or the instant is before its start.
    TooOld,
    /// It is not written yet: ask again at this instant.
    NotYet {
        /// When it will be there.
        ready: Cycles,
    },
    /// Samples were lost: which instant a slot belongs to is not known.
    OutOfStep,
}

/// The writer and the clock disagree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutOfStep {
    /// So many samples were not written, or a multiple of the ring more.
    Behind {
        /// Samples lost.
        samples: u32,
    },
    /// More samples were written than time has passed for: the start or the
    /// period is not what it should be.
    Ahead {
        /// Samples too many.
        samples: u32,
    },
}

/// A ring of samples that hardware writes at a fixed cadence.
///
/// ```
/// use core::num::NonZeroU32;
/// use umi_core::capture::sample_ring::{Cadence, NotThere, SampleRing};
/// use umi_core::units::Cycles;
///
/// let cadence = Cadence {
///     period_cycles: NonZeroU32::new(10).unwrap(),
///     slots: NonZeroU32::new(1024).unwrap(),
///     delay_cycles: 30,
/// };
/// let ring = SampleRing::new(cadence, Cycles(5_000));
/// // Asked 9000 cycles after an edge: its positions are still there.
/// let edge = Cycles(5_123);
/// assert_eq!(ring.sample_at(edge, Cycles(14_123)).unwrap().slot, 12);
/// assert_eq!(ring.sample_at(edge, Cycles(20_000)), Err(NotThere::TooOld));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct SampleRing {
    cadence: Cadence,
    period: Divisor,
    slots: Divisor,
    /// When the first sample was taken.
    first_cycles: u64,
    /// When the sample of some slot 0 was taken or would have been: at the start
    /// of the ring, later advanced so that differences to it stay small, which a
    /// processor without a divider feels. May be "before zero", wrapped.
    lap_cycles: u64,
    in_step: bool,
    lost: u32,
}

impl SampleRing {
    /// The first sample, which goes to slot 0, is taken at the start.
    #[must_use]
    pub const fn new(cadence: Cadence, Cycles(start_cycles): Cycles) -> Self {
        Self {
            cadence,
            period: Divisor::new(cadence.period_cycles),
            slots: Divisor::new(cadence.slots),
            first_cycles: start_cycles,
            lap_cycles: start_cycles,
            in_step: true,
            lost: 0,
        }
    }

    /// After a loss: the sample taken at the start goes to `slot`, and all
    /// that was written before is not used any more.
    pub fn restart(&mut self, Cycles(start_cycles): Cycles, slot: u32) {
        let before = u64::from(slot % self.cadence.slots)
            .wrapping_mul(u64::from(self.cadence.period_cycles.get()));
        self.first_cycles = start_cycles;
        self.lap_cycles = start_cycles.wrapping_sub(before);
        self.in_step = true;
    }

    /// Samples that were found lost.
    #[must_use]
    pub const fn lost(&self) -> u32 {
        self.lost
    }

    /// The latest sample that was taken at or before an instant, asked now.
    ///
    /// # Errors
    /// [`NotThere`].
    pub fn sample_at(&self, instant: Cycles, now: Cycles) -> Result<Sample, NotThere> {
        if !self.in_step {
            return Err(NotThere::OutOfStep);
        }
        let since = instant.0.wrapping_sub(self.lap_cycles);
        if instant.0 < self.first_cycles || since.cast_signed() < 0 {
            return Err(NotThere::TooOld);
        }
        let (number, over) = self.period.divide(since);
        let taken = instant.before(over.into());
        let ready = taken.after(self.cadence.delay_cycles.into());
        if now < ready {
            return Err(NotThere::NotYet { ready });
        }
        let good_until = taken.after(self.cadence.lap_cycles());
        if now >= good_until {
            return Err(NotThere::TooOld);
        }
        Ok(Sample {
            slot: self.slot(number),
            taken,
            good_until,
        })
    }

    /// Holds where the writer is against the clock: `write_slot` is the slot that
    /// it writes next, read between the instants `before` and `after`.
    ///
    /// The condition: fewer than half a ring of samples can have been lost since
    /// the check before. As many as may be under way (`delay_cycles`) cannot be
    /// told from lost ones: hardware that can stall must tell it by itself. If reading took as long as a whole ring, nothing can be
    /// said and nothing is: a loss stays, and the next check finds it. To be
    /// called now and then, at least each 2³¹ cycles.
    ///
    /// # Errors
    /// [`OutOfStep`]: counted, and no sample is given out until
    /// [`restart`](Self::restart).
    pub fn check(
        &mut self,
        before: Cycles,
        write_slot: u32,
        after: Cycles,
    ) -> Result<(), OutOfStep> {
        let Cadence {
            slots,
            delay_cycles,
            ..
        } = self.cadence;
        let surely = before.before(delay_cycles.into()).0;
        if surely < self.first_cycles {
            return Ok(());
        }
        // One more than the number of the latest sample is how many there are.
        let written_at = |instant: u64| {
            let (number, _) = self.period.divide(instant.wrapping_sub(self.lap_cycles));
            number.wrapping_add(1)
        };
        let (least, most) = (written_at(surely), written_at(after.0));
        let may_be_ahead = u32::try_from(most.saturating_sub(least)).unwrap_or(u32::MAX);
        let ring = slots.get();
        let is = write_slot % slots;
        let should_be = self.slot(least);
        let ahead = if is >= should_be {
            is.wrapping_sub(should_be)
        } else {
            // `should_be` is below `ring`.
            ring.wrapping_sub(should_be).saturating_add(is)
        };
        if ahead <= may_be_ahead {
            self.advance(surely);
            return Ok(());
        }
        let behind = ring.saturating_sub(ahead);
        let ahead = ahead - may_be_ahead;
        let fault = if behind <= ahead {
            OutOfStep::Behind { samples: behind }
        } else {
            OutOfStep::Ahead { samples: ahead }
        };
        if self.in_step
            && let OutOfStep::Behind { samples } = fault
        {
            self.lost = self.lost.saturating_add(samples);
        }
        self.in_step = false;
        Err(fault)
    }

    /// Moves the lap up to the one before that of `instant_cycles`, which leaves
    /// every sample that the ring still holds behind it.
    fn advance(&mut self, instant_cycles: u64) {
        let (samples, _) = self
            .period
            .divide(instant_cycles.wrapping_sub(self.lap_cycles));
        let laps = self.slots.divide(samples).0.saturating_sub(1);
        let cycles = laps.wrapping_mul(self.cadence.lap_cycles());
        self.lap_cycles = self.lap_cycles.wrapping_add(cycles);
    }

    fn slot(&self, number: u64) -> u32 {
        self.slots.divide(number).1
    }
}

/// A divisor. Short quotients are a multiplication, or a shift: a Cortex-M0+ has no
/// instruction to divide, and takes a hundred cycles for 32 bits and a thousand for 64.
#[derive(Clone, Copy, Debug)]
struct Divisor {
    by: NonZeroU32,
    /// 2³² / `by`, rounded up: by less than 1, so that quotients of what is below 2³² /
    /// `by` are right.
    reciprocal: u32,
    /// Of a power of two.
    shift: Option<u32>,
}

impl Divisor {
    const fn new(by: NonZeroU32) -> Self {
        // 2³² for a divisor of 1, which is a power of two.
        let reciprocal = (1_u64 << 32).div_ceil(by.get() as u64);
        Self {
            by,
            reciprocal: reciprocal as u32,
            shift: if by.is_power_of_two() {
                Some(by.trailing_zeros())
            } else {
                None
            },
        }
    }

    /// The quotient of `number` and the remainder.
    fn divide(self, number: u64) -> (u64, u32) {
        let by = self.by.get();
        match u32::try_from(number) {
            Ok(short) => {
                let quotient = match self.shift {
                    Some(shift) => short.wrapping_shr(shift),
                    None if short < self.reciprocal => {
                        (u64::from(short).wrapping_mul(self.reciprocal.into()) >> 32) as u32
                    }
                    None => short / by,
                };
                let over = short.wrapping_sub(quotient.wrapping_mul(by));
                (quotient.into(), over)
            }
            // The remainder is below 32 bits.
            Err(_) => (number / u64::from(by), (number % u64::from(by)) as u32),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The hardware: sample `k` is taken at `start + k * period` and written up to
    /// `delay` cycles later, into slot `(first_slot + k) mod slots`.
    #[derive(Clone, Copy, Debug)]
    struct Writer {
        cadence: Cadence,
        start: u64,
        first_slot: u32,
    }

    impl Writer {
        fn taken(&self, k: u64) -> u64 {
            self.start + k * u64::from(self.cadence.period_cycles.get())
        }

        /// Any delay, and never one sample before the one that was taken earlier.
        fn written(&self, k: u64) -> u64 {
            let any = |k: u64| {
                let spread = u64::from(self.cadence.delay_cycles) + 1;
                self.taken(k) + k.wrapping_mul(0x9E37_79B9_7F4A_7C15) % spread
            };
            (k.saturating_sub(20)..=k).map(any).max().unwrap()
        }

        /// How many samples have been written at `now`.
        fn count(&self, now: u64) -> u64 {
            if now < self.start {
                return 0;
            }
            let mut k = (now - self.start) / u64::from(self.cadence.period_cycles.get()) + 1;
            while k > 0 && self.written(k - 1) > now {
                k -= 1;
            }
            k
        }

        fn slot(&self, k: u64) -> u32 {
            ((u64::from(self.first_slot) + k) % u64::from(self.cadence.slots.get())) as u32
        }

        /// The number of the sample that stands in a slot at `now`.
        fn read(&self, slot: u32, now: u64) -> Option<u64> {
            (0..self.count(now))
                .rev()
                .take(self.cadence.slots.get() as usize)
                .find(|k| self.slot(*k) == slot)
        }

        fn ring(&self) -> SampleRing {
            let mut ring = SampleRing::new(self.cadence, Cycles(0));
            ring.restart(Cycles(self.start), self.first_slot);
            ring
        }
    }

    fn writer() -> impl Strategy<Value = Writer> {
        (1_u32..40, 2_u32..70, 0_u32..90, 0_u64..3_000, 0_u32..70).prop_map(
            |(period, slots, delay, start, first_slot)| Writer {
                cadence: Cadence {
                    period_cycles: NonZeroU32::new(period).unwrap(),
                    slots: NonZeroU32::new(slots).unwrap(),
                    delay_cycles: delay,
                },
                start,
                first_slot: first_slot % slots,
            },
        )
    }

    proptest! {
        /// Quotient and remainder are those of a division, at every size of both.
        #[test]
        fn divisions_are_exact(
            number in prop_oneof![any::<u64>(), any::<u32>().prop_map(u64::from), 0..5000_u64],
            by in prop_oneof![1..2000_u32, 1..=u32::MAX],
            near in 0..4_u64,
        ) {
            let divisor = Divisor::new(NonZeroU32::new(by).unwrap());
            let limit = u64::from(divisor.reciprocal);
            for number in [number, (limit + near).saturating_sub(2)] {
                let exact = (number / u64::from(by), (number % u64::from(by)) as u32);
                prop_assert_eq!(divisor.divide(number), exact);
            }
        }

        /// For any instant, asked at any time: what is given out is the sample of
        /// that instant for as long as is said, and what is refused was rightly
        /// refused. Checks in between change nothing.
        #[test]
        fn finds_the_sample_of_an_instant(
            writer in writer(),
            instant in 0_u64..20_000,
            late in 0_u64..3_000,
            later in 0_u64..3_000,
            checks in prop::collection::vec(0_u64..20_000, 0..4),
        ) {
            let mut ring = writer.ring();
            let now = instant + late;
            let mut checks = checks;
            checks.sort_unstable();
            for at in checks.into_iter().filter(|at| *at <= now) {
                let slot = writer.slot(writer.count(at));
                prop_assert_eq!(ring.check(Cycles(at), slot, Cycles(at)), Ok(()));
            }
            let period = u64::from(writer.cadence.period_cycles.get());
            let number = (instant >= writer.start).then(|| (instant - writer.start) / period);
            match ring.sample_at(Cycles(instant), Cycles(now)) {
                Ok(sample) => {
                    let number = number.expect("an instant after the start");
                    prop_assert_eq!(sample.taken.0, writer.taken(number));
                    prop_assert!(sample.taken.0 <= instant);
                    prop_assert!(now < sample.good_until.0);
                    let read_at = (now + later).min(sample.good_until.0 - 1);
                    prop_assert_eq!(writer.read(sample.slot, read_at), Some(number));
                }
                Err(NotThere::TooOld) => {
                    let gone = number.is_none_or(|k| {
                        now >= writer.taken(k + u64::from(writer.cadence.slots.get()))
                    });
                    prop_assert!(gone, "sample {number:?} was still there");
                }
                Err(NotThere::NotYet { ready: Cycles(ready_cycles) }) => {
                    let number = number.expect("an instant after the start");
                    prop_assert!(now < ready_cycles);
                    prop_assert!(writer.written(number) <= ready_cycles);
                    prop_assert!(ready_cycles - writer.taken(number)
                        <= u64::from(writer.cadence.delay_cycles));
                }
                Err(NotThere::OutOfStep) => prop_assert!(false, "in step all the time"),
            }
        }

        /// A writer in step passes every check, however long it takes to read it;
        /// one that lost more than its delay covers never passes a quick one, and
        /// without a delay the number is exact.
        #[test]
        fn checks_tell_what_was_lost(
            writer in writer(),
            at in 4_000_u64..20_000,
            takes in 0_u64..2_000,
            lost in 1_u64..35,
        ) {
            let mut ring = writer.ring();
            let reads = at + takes / 2;
            let slot = writer.slot(writer.count(reads));
            prop_assert_eq!(ring.check(Cycles(at), slot, Cycles(at + takes)), Ok(()));
            let at = Cycles(at);
            prop_assert_eq!(ring.lost(), 0);

            let slots = u64::from(writer.cadence.slots.get());
            let delay = writer
                .cadence
                .delay_cycles
                .div_ceil(writer.cadence.period_cycles.get());
            let (least, most) = (u64::from(delay) + 1, slots / 2);
            let spread = most.saturating_sub(least + u64::from(delay) + 2);
            if spread == 0 {
                return Ok(());
            }
            let lost = least + lost % spread;
            let behind = writer.count(at.0) - lost;
            let checked = ring.check(at, writer.slot(behind), at);
            let Err(OutOfStep::Behind { samples }) = checked else {
                return Err(TestCaseError::fail(std::format!("{lost} lost: {checked:?}")));
            };
            prop_assert!(u64::from(samples) <= lost);
            prop_assert!(u64::from(samples) + u64::from(delay) + 1 >= lost);
            if writer.cadence.delay_cycles == 0 {
                prop_assert_eq!(u64::from(samples), lost);
            }
            prop_assert_eq!(ring.lost(), samples);
            prop_assert_eq!(ring.sample_at(at, at), Err(NotThere::OutOfStep));
            prop_assert!(ring.check(at, writer.slot(behind), at).is_err());
            prop_assert_eq!(ring.lost(), samples, "counted once");
        }

        /// Hours and years later, after a check, the arithmetic is the same.
        #[test]
        fn nothing_drifts(years in 0_u64..100, ticks in 0_u64..100_000) {
            let cadence = Cadence {
                period_cycles: NonZeroU32::new(10).unwrap(),
                slots: NonZeroU32::new(1024).unwrap(),
                delay_cycles: 0,
            };
            let mut ring = SampleRing::new(cadence, Cycles(7));
            let now = years * 3_944_700_000_000_000 + ticks * 125_000;
            let slot = |now: u64| if now < 7 { 0 } else { ((now - 7) / 10 % 1024) as u32 };
            let at = Cycles(now);
            prop_assert_eq!(ring.check(at, (slot(now) + u32::from(now >= 7)) % 1024, at), Ok(()));
            if now >= 7 {
                prop_assert_eq!(ring.sample_at(at, at).map(|sample| sample.slot), Ok(slot(now)));
            }
        }
    }

    /// A writer that is too fast is named too, and is no lost sample.
    #[test]
    fn ahead_of_the_clock() {
        let cadence = Cadence {
            period_cycles: NonZeroU32::new(10).unwrap(),
            slots: NonZeroU32::new(1024).unwrap(),
            delay_cycles: 5,
        };
        let mut ring = SampleRing::new(cadence, Cycles(0));
        let now = Cycles(1_006);
        assert_eq!(ring.check(now, 101, now), Ok(()));
        assert_eq!(
            ring.check(now, 105, now),
            Err(OutOfStep::Ahead { samples: 4 })
        );
        assert_eq!(ring.lost(), 0);
        assert_eq!(ring.sample_at(Cycles(1_000), now), Err(NotThere::OutOfStep));
        ring.restart(Cycles(2_000), 3);
        let slot = |at| ring.sample_at(Cycles(at), Cycles(2_100)).map(|s| s.slot);
        assert_eq!(slot(1_999), Err(NotThere::TooOld));
        assert_eq!(slot(2_000), Ok(3));
    }
}
