//! A board's events in order; each loss stands where it happened.
//!
//! Latches of each cause are numbered. A gap is the number that was captured and did not
//! arrive. The board itself counts edges that it could not capture.

pub mod table;

use umi_protocol::latch::{LatchCause, LatchReport, MAX_AXES, Positions};
use umi_protocol::line::{HitReport, LineReport};
use umi_protocol::message::{Event, Record, Status};

/// An event, or a loss in its place.
#[derive(Clone, Debug, PartialEq)]
pub enum TimelineEntry {
    /// A line from the control.
    Line(LineReport),
    /// A hit as the control reported it.
    Hit(HitReport),
    /// Axes captured at an edge; its number in the journal, if it is there.
    Latch(Option<u64>, LatchReport),
    /// Anything else that went into the journal.
    Record {
        /// Its number there.
        seq: u64,
        /// When.
        t_us: u64,
        /// What.
        record: Box<Record>,
    },
    /// Something is missing here.
    Loss(Loss),
}

/// Something that is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Loss {
    /// What.
    pub what: Lost,
    /// How many.
    pub count: u32,
    /// When it was noticed, on the board's clock, where that is known; of motion and transitions:
    /// until when the positions were right.
    pub t_ns: Option<u64>,
}

/// What can be lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lost {
    /// Edges came and their capture was lost in the board.
    Edges(LatchCause),
    /// Latches that were captured and did not arrive: this cause, from this number on.
    Latches(LatchCause, u32),
    /// Edges and latches, by the board's counters and at no known place.
    Counted,
    /// Lines, hits or records that the host did not read in time. The journal has the
    /// records.
    Events,
    /// Bytes from the control.
    Bytes,
    /// Motion that the board could not follow, so many times since it started: its positions
    /// are not valid, before or after.
    Motion,
    /// Transitions of an encoder that it cannot have made: counts are wrong from there on.
    Transitions,
}

impl Lost {
    /// The stable name.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::Edges(_) => "edges",
            Self::Latches(..) => "latches",
            Self::Counted => "counted",
            Self::Events => "events",
            Self::Bytes => "bytes",
            Self::Motion => "motion",
            Self::Transitions => "transitions",
        }
    }
}

/// Follows what happens.
#[derive(Clone, Debug, Default)]
pub struct Follower {
    /// The number of the next latch of each cause.
    expected: [Option<u32>; 4 + MAX_AXES],
    /// What has been missed so far.
    pub tally: LatchTally,
}

/// How much came, and how much was lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LatchTally {
    /// Latches that came.
    pub latches: u64,
    /// Edges and latches that were lost.
    pub latches_lost: u64,
    /// Lines, hits and records that were lost.
    pub events_lost: u64,
    /// Bytes from the control that were lost.
    pub bytes_lost: u64,
    /// Losses of motion and illegal transitions: positions are wrong.
    pub positions_lost: u64,
}

impl LatchTally {
    /// Whether anything was lost.
    #[must_use]
    pub const fn lost(&self) -> bool {
        self.latches_lost + self.events_lost + self.bytes_lost + self.positions_lost > 0
    }

    fn count(&mut self, loss: Loss) -> TimelineEntry {
        let count = u64::from(loss.count);
        match loss.what {
            Lost::Edges(_) | Lost::Latches(..) | Lost::Counted => self.latches_lost += count,
            Lost::Events => self.events_lost += count,
            Lost::Bytes => self.bytes_lost += count,
            Lost::Motion | Lost::Transitions => self.positions_lost += count,
        }
        TimelineEntry::Loss(loss)
    }
}

impl Follower {
    /// What an event of the board tells.
    pub fn event(&mut self, event: Event, mut tell: impl FnMut(TimelineEntry)) {
        match event {
            Event::Line(line) => tell(TimelineEntry::Line(line)),
            Event::Hit(hit) => tell(TimelineEntry::Hit(hit)),
            Event::Latches(batch) => {
                for latch in batch.reports() {
                    self.latch(None, latch, &mut tell);
                }
            }
            Event::Record { seq, t_us, record } => self.record(seq, t_us, record, tell),
            Event::Dropped { count } => tell(self.tally.count(Loss {
                what: Lost::Events,
                count,
                t_ns: None,
            })),
        }
    }

    /// What a record of the journal tells.
    pub fn record(
        &mut self,
        seq: u64,
        t_us: u64,
        record: Record,
        mut tell: impl FnMut(TimelineEntry),
    ) {
        match record {
            Record::Latch(latch) => return self.latch(Some(seq), latch, &mut tell),
            Record::BytesLost { count } => tell(self.tally.count(Loss {
                what: Lost::Bytes,
                count,
                t_ns: Some(t_us.saturating_mul(1000)),
            })),
            // Numbers begin anew.
            Record::Boot { .. } => self.expected = Default::default(),
            _ => {}
        }
        tell(TimelineEntry::Record {
            seq,
            t_us,
            record: Box::new(record),
        });
    }

    /// The scans that a journal sums up, whose latches it does not have.
    pub fn scan(&mut self, record: &Record, mut tell: impl FnMut(TimelineEntry)) {
        let Record::Scan(scan) = record else { return };
        for (what, count) in [
            (Lost::Edges(scan.cause), scan.missed),
            (Lost::Latches(scan.cause, scan.first), scan.untold),
        ] {
            if count > 0 {
                tell(self.tally.count(Loss {
                    what,
                    count,
                    t_ns: Some(scan.to_ns),
                }));
            }
        }
    }

    /// What the board's counters say was lost between two looks, and nothing told.
    pub fn settle(&mut self, before: &Status, after: &Status, mut tell: impl FnMut(TimelineEntry)) {
        if after.uptime_us < before.uptime_us {
            return; // It has started again.
        }
        let lost =
            |status: &Status| u64::from(status.latches.missed) + u64::from(status.latches.untold);
        let dropped = |status: &Status| u64::from(status.events_dropped);
        let LatchTally {
            latches_lost,
            events_lost,
            ..
        } = self.tally;
        for (what, counted, told) in [
            (
                Lost::Counted,
                lost(after).saturating_sub(lost(before)),
                latches_lost,
            ),
            (
                Lost::Events,
                dropped(after).saturating_sub(dropped(before)),
                events_lost,
            ),
        ] {
            let untold = u32::try_from(counted.saturating_sub(told)).unwrap_or(u32::MAX);
            if untold > 0 {
                tell(self.tally.count(Loss {
                    what,
                    count: untold,
                    t_ns: None,
                }));
            }
        }
    }

    /// What the encoders say between two looks: positions that are not valid, and
    /// transitions that came in between; `good_ns` is when the last look was that found none.
    pub fn moved(
        &mut self,
        before: &Positions,
        after: &Positions,
        good_ns: u64,
        mut tell: impl FnMut(TimelineEntry),
    ) {
        let illegal = |positions: &Positions| {
            let all = positions.illegal.iter();
            all.fold(0_u32, |sum, n| sum.saturating_add(*n))
        };
        // What was counted before a new start does not count any more.
        let new = illegal(after).checked_sub(illegal(before));
        for (what, count) in [
            (Lost::Motion, after.lost_samples),
            (Lost::Transitions, new.unwrap_or_else(|| illegal(after))),
        ] {
            if count > 0 {
                tell(self.tally.count(Loss {
                    what,
                    count,
                    t_ns: Some(good_ns),
                }));
            }
        }
    }

    fn latch(
        &mut self,
        seq: Option<u64>,
        latch: LatchReport,
        tell: &mut impl FnMut(TimelineEntry),
    ) {
        let LatchReport {
            number,
            cause,
            t_ns,
            missed,
            ..
        } = latch;
        // What came without counts was not captured and has no number of its own.
        let empty = latch.counts.is_empty();
        let mut gap = 0;
        if let Some(place) = self.expected.get_mut(place(cause)) {
            gap = place.map_or(0, |expected| number.wrapping_sub(expected));
            *place = Some(number.wrapping_add(u32::from(!empty)));
        }
        // A number that goes back is that of a board that has started again.
        let untold = if gap > u32::MAX / 2 { 0 } else { gap };
        let losses = [
            (Lost::Latches(cause, number.wrapping_sub(gap)), untold),
            (Lost::Edges(cause), missed),
        ];
        for (what, count) in losses.into_iter().filter(|(_, count)| *count > 0) {
            tell(self.tally.count(Loss {
                what,
                count,
                t_ns: Some(t_ns),
            }));
        }
        if !empty {
            self.tally.latches += 1;
            tell(TimelineEntry::Latch(seq, latch));
        }
    }
}

/// Where the numbers of a cause are kept.
fn place(cause: LatchCause) -> usize {
    match cause {
        LatchCause::Skip => 0,
        LatchCause::Trigger => 1,
        LatchCause::Output => 2,
        LatchCause::SkipEnd => 3,
        LatchCause::Index { axis } => 4 + usize::from(axis),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use umi_protocol::latch::{LatchBatch, LatchStep};

    fn latch(number: u32, missed: u32, counts: &[i64]) -> LatchReport {
        LatchReport {
            number,
            cause: LatchCause::Trigger,
            counts: counts.iter().copied().collect(),
            t_ns: u64::from(number) * 1000,
            missed,
        }
    }

    fn batch(first: LatchReport, steps: usize) -> Event {
        let step = LatchStep {
            dt_ns: 1000,
            dcounts: [1].into_iter().collect(),
        };
        Event::Latches(LatchBatch {
            first,
            steps: std::iter::repeat_n(step, steps).collect(),
        })
    }

    fn follow(events: impl IntoIterator<Item = Event>) -> (Vec<u32>, Vec<(Lost, u32)>, LatchTally) {
        let mut follower = Follower::default();
        let (mut numbers, mut losses) = (Vec::new(), Vec::new());
        for event in events {
            follower.event(event, |happening| match happening {
                TimelineEntry::Latch(_, latch) => numbers.push(latch.number),
                TimelineEntry::Loss(loss) => losses.push((loss.what, loss.count)),
                _ => {}
            });
        }
        (numbers, losses, follower.tally)
    }

    /// Batches that follow each other lose nothing, whatever number comes first.
    #[test]
    fn whole_batches_are_whole() {
        let (numbers, losses, tally) = follow([
            batch(latch(70, 0, &[5]), 15),
            batch(latch(86, 0, &[21]), 3),
            batch(latch(90, 0, &[25]), 0),
        ]);
        assert_eq!(numbers, (70..=90).collect::<Vec<_>>());
        assert!(losses.is_empty() && !tally.lost());
        assert_eq!(tally.latches, 21);
    }

    /// A gap in the numbers is a loss of that many; edges that were not captured have no
    /// numbers and are another one.
    #[test]
    fn gaps_are_counted() {
        let trigger = LatchCause::Trigger;
        let (_, losses, tally) = follow([
            batch(latch(0, 0, &[5]), 3),
            batch(latch(9, 0, &[5]), 0),
            batch(latch(10, 2, &[5]), 0),
            batch(latch(14, 3, &[5]), 0),
        ]);
        assert_eq!(
            losses,
            [
                (Lost::Latches(trigger, 4), 5),
                (Lost::Edges(trigger), 2),
                (Lost::Latches(trigger, 11), 3),
                (Lost::Edges(trigger), 3)
            ]
        );
        assert_eq!((tally.latches, tally.latches_lost), (7, 13));
    }

    /// Edges without a position are a loss and no latch.
    #[test]
    fn edges_without_positions_are_lost() {
        let (numbers, losses, _) = follow([
            batch(latch(7, 0, &[1]), 0),
            batch(latch(8, 4, &[]), 0),
            batch(latch(8, 0, &[2]), 0),
        ]);
        assert_eq!(numbers, [7, 8]);
        assert_eq!(losses, [(Lost::Edges(LatchCause::Trigger), 4)]);
    }

    /// Positions that are not valid are a loss, whenever it was; illegal transitions are one
    /// if they came meanwhile.
    #[test]
    fn wrong_positions_are_a_loss() {
        let positions = |lost_samples, illegal: [u32; 2]| Positions {
            counts: [1, 2].into_iter().collect(),
            t_ns: 7,
            illegal: illegal.into_iter().collect(),
            lost_samples,
        };
        let follow = |before, after| {
            let (mut follower, mut losses) = (Follower::default(), Vec::new());
            follower.moved(&before, &after, 5, |happening| match happening {
                TimelineEntry::Loss(loss) => {
                    assert_eq!(loss.t_ns, Some(5));
                    losses.push((loss.what, loss.count));
                }
                other => panic!("{other:?}"),
            });
            assert_eq!(follower.tally.lost(), !losses.is_empty());
            losses
        };
        assert!(follow(positions(0, [3, 4]), positions(0, [3, 4])).is_empty());
        let both = [(Lost::Motion, 2), (Lost::Transitions, 5)];
        assert_eq!(follow(positions(2, [3, 4]), positions(2, [3, 9])), both);
        assert_eq!(
            follow(positions(0, [3, 4]), positions(0, [0, 1])),
            [(Lost::Transitions, 1)]
        );
    }

    /// A board that starts again begins with 0: no loss of four thousand million.
    #[test]
    fn a_new_start_is_no_loss() {
        let (_, losses, _) = follow([batch(latch(7, 0, &[1]), 0), batch(latch(0, 0, &[1]), 0)]);
        assert!(losses.is_empty());
    }
}
