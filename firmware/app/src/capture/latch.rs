//! Captures of the axes: those of a scan to the host, the others into the queue, in
//! which each stays before the line that the control prints about it.
//!
//! # Design
//!
//! A capture waits for nothing. One that finds no room in the queue is a missed edge
//! from then on, told by the next one, or by a report without counts if there is room
//! before there is a next.

use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use heapless::Vec;
use umi_core::journal::Flash;
use umi_core::units::Micros;
use umi_protocol::latch::{LatchCause, LatchReport, MAX_AXES};

use crate::App;
use crate::board::{Clock, LatchSource};
use crate::capture::scan;
use crate::intake::Input;

/// How soon it is tried again to tell what was missed.
const TELL_AGAIN_US: u64 = 10_000;
/// Captures taken in before others of the same priority have a turn: the control's bytes.
const AT_ONCE: usize = 8;

/// What found no room, of skips, of each axis' index marks, and of the ends of skips.
type Missed = [Option<LatchReport>; 2 + MAX_AXES];

/// Takes in captures for ever.
pub(crate) async fn take<F: Flash>(
    app: &App<F>,
    latches: &mut impl LatchSource,
    clock: &impl Clock,
) -> ! {
    const NEVER: Micros = Micros(u64::MAX);
    let mut missed: Missed = [const { None }; _];
    // The next look at what waits: too many captures come for one at each.
    let mut look = NEVER;
    let mut taken = 0;
    loop {
        match select(latches.next(), clock.wait_until(look)).await {
            Either::First(latch) => {
                if let Some(point) = app.point()
                    && point.takes(latch.cause)
                {
                    app.scans.count(&latch);
                    point.latched(&latch);
                } else if is_of_a_scan(latch.cause) {
                    if app.scans.take(latch) {
                        look = look.min(after(clock, scan::PATIENCE_US));
                    }
                } else {
                    queue(app, clock.now(), latch, &mut missed);
                    if missed.iter().any(Option::is_some) {
                        look = look.min(after(clock, TELL_AGAIN_US));
                    }
                }
                taken += 1;
                if taken == AT_ONCE {
                    taken = 0;
                    yield_now().await;
                }
            }
            Either::Second(()) => look = tell_what_waits(app, clock, &mut missed),
        }
    }
}

/// Tells what has waited for long enough. Returns when the next look is due.
fn tell_what_waits<F: Flash>(app: &App<F>, clock: &impl Clock, missed: &mut Missed) -> Micros {
    let now = clock.now();
    for missed in missed.iter_mut() {
        if let Some(latch) = missed
            && app.intake.put(now, Input::Latch(latch.clone())).is_ok()
        {
            *missed = None;
        }
    }
    if let Some(scan) = app.scans.over(now) {
        // Behind a long fit its record is lost, its counters are not.
        let _ = app.intake.put(now, Input::Scan(scan));
    }
    let mut look = app.scans.deadline().unwrap_or(Micros(u64::MAX));
    if app.scans.due() {
        look = look.min(after(clock, scan::PATIENCE_US));
    }
    if missed.iter().any(Option::is_some) {
        look = look.min(after(clock, TELL_AGAIN_US));
    }
    look
}

fn after(clock: &impl Clock, us: u64) -> Micros {
    Micros(clock.now().0.saturating_add(us))
}

/// Puts a capture into the queue, with what was missed before it; or it is missed, too.
fn queue<F: Flash>(app: &App<F>, now: Micros, mut latch: LatchReport, missed: &mut Missed) {
    let place = match latch.cause {
        LatchCause::Index { axis } => 1 + usize::from(axis),
        LatchCause::Skip | LatchCause::Trigger | LatchCause::Output => 0,
        LatchCause::SkipEnd => 1 + MAX_AXES,
    };
    // A board has no axis beyond.
    let Some(missed) = missed.get_mut(place) else {
        return;
    };
    let before = missed.as_ref().map_or(0, |missed| missed.missed);
    let mut told = latch.clone();
    told.missed = told.missed.saturating_add(before);
    if app.intake.put(now, Input::Latch(told)).is_ok() {
        app.scans.count(&latch);
        *missed = None;
        return;
    }
    if !latch.counts.is_empty() {
        latch.counts = Vec::new();
        latch.number = latch.number.wrapping_add(1);
        latch.missed = latch.missed.saturating_add(1);
    }
    app.scans.count(&latch);
    latch.missed = latch.missed.saturating_add(before);
    *missed = Some(latch);
}

/// Whether latches of this cause come by the thousand.
const fn is_of_a_scan(cause: LatchCause) -> bool {
    matches!(cause, LatchCause::Trigger | LatchCause::Output)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::collections::VecDeque;
    use std::vec::Vec;

    use core::pin::pin;
    use embassy_futures::{block_on, poll_once};

    use super::*;
    use crate::intake::OTHER_PLACES;
    use crate::test_board::{Hand, NoFlash, skip, trigger};

    /// Captures one after the other, then none.
    struct Given(VecDeque<LatchReport>);

    impl LatchSource for Given {
        async fn next(&mut self) -> LatchReport {
            match self.0.pop_front() {
                Some(latch) => latch,
                None => core::future::pending().await,
            }
        }
    }

    fn skips(numbers: core::ops::Range<u32>) -> Given {
        Given(numbers.map(skip).collect())
    }

    /// Runs until nothing is left to do: others have had their turns in between.
    fn settle(mut run: core::pin::Pin<&mut impl Future>) {
        for _ in 0..1000 {
            assert!(poll_once(run.as_mut()).is_pending());
        }
    }

    /// What is in the queue.
    fn queued(app: &App<NoFlash>, count: usize) -> Vec<Input> {
        (0..count).map(|_| block_on(app.intake.next()).1).collect()
    }

    fn latches(inputs: &[Input]) -> Vec<(u32, bool, u32)> {
        let latches = inputs.iter().map(|input| match input {
            Input::Latch(latch) => (latch.number, latch.counts.is_empty(), latch.missed),
            other => panic!("{other:?}"),
        });
        latches.collect()
    }

    /// Captures behind a full queue are missed edges: counted as such and not as
    /// captures, together with what each had missed itself, and told by the next one.
    #[test]
    fn the_next_one_tells_what_found_no_room() {
        let app = App::<NoFlash>::new();
        let full = OTHER_PLACES as u32;
        let mut missed: Missed = Default::default();
        for number in 0..full + 3 {
            let mut latch = skip(number);
            latch.missed = if number == full + 1 { 5 } else { 0 };
            queue(&app, Micros(1), latch, &mut missed);
        }
        let counters = app.scans.counters();
        assert_eq!((counters.skips, counters.missed), (full, 3 + 5));
        let first = latches(&queued(&app, OTHER_PLACES));
        assert!(first.into_iter().eq((0..full).map(|n| (n, false, 0))));
        for number in [full + 3, full + 4] {
            queue(&app, Micros(2), skip(number), &mut missed);
        }
        let next = [(full + 3, false, 3 + 5), (full + 4, false, 0)];
        assert_eq!(latches(&queued(&app, 2)), next);
        let counters = app.scans.counters();
        assert_eq!((counters.skips, counters.missed), (full + 2, 3 + 5));
    }

    /// What was missed of one cause is not told by another.
    #[test]
    fn each_cause_tells_its_own() {
        let (app, clock) = (App::<NoFlash>::new(), Hand::default());
        let full = OTHER_PLACES as u32;
        let mark = |number| LatchReport {
            cause: LatchCause::Index { axis: 2 },
            ..skip(number)
        };
        let mut missed: Missed = Default::default();
        for number in 0..full + 2 {
            queue(&app, Micros(1), skip(number), &mut missed);
        }
        queue(&app, Micros(1), mark(0), &mut missed);
        queued(&app, OTHER_PLACES);
        queue(&app, Micros(2), mark(1), &mut missed);
        tell_what_waits(&app, &clock, &mut missed);
        let told = queued(&app, 2).into_iter().map(|input| match input {
            Input::Latch(latch) => (latch.cause, latch.number, latch.missed),
            other => panic!("{other:?}"),
        });
        let index = LatchCause::Index { axis: 2 };
        let expected = [(index, 1, 1), (LatchCause::Skip, full + 2, 2)];
        assert!(told.eq(expected));
    }

    /// If no other comes, what was missed is told as soon as there is room.
    #[test]
    fn what_found_no_room_is_told_without_a_next_one() {
        let (app, clock) = (App::<NoFlash>::new(), Hand::default());
        let full = OTHER_PLACES as u32;
        let mut given = skips(0..full + 3);
        let mut run = pin!(take(&app, &mut given, &clock));
        for now in [0, TELL_AGAIN_US, 2 * TELL_AGAIN_US] {
            clock.set(now);
            settle(run.as_mut());
        }
        queued(&app, OTHER_PLACES);
        clock.set(3 * TELL_AGAIN_US);
        settle(run.as_mut());
        assert_eq!(latches(&queued(&app, 1)), [(full + 3, true, 3)]);
        // Once.
        clock.set(9 * TELL_AGAIN_US);
        settle(run.as_mut());
        assert!(poll_once(app.intake.next()).is_pending());
        assert_eq!(app.scans.counters().missed, 3);
    }

    /// Triggers take no room in the queue but for one record, when they have been over
    /// for a second.
    #[test]
    fn a_scan_is_summed_up_after_a_quiet_second() {
        let (app, clock) = (App::<NoFlash>::new(), Hand::default());
        let mut given = Given((0..1000).map(trigger).collect());
        let mut run = pin!(take(&app, &mut given, &clock));
        let last_us = trigger(999).t_ns / 1000;
        for now in [0, last_us, last_us + 999_999] {
            clock.set(now);
            settle(run.as_mut());
            assert!(poll_once(app.intake.next()).is_pending());
        }
        clock.set(last_us + 1_000_001);
        settle(run.as_mut());
        let Input::Scan(scan) = block_on(app.intake.next()).1 else {
            panic!("only a scan was");
        };
        assert_eq!((scan.captured, scan.missed, scan.first), (1000, 0, 0));
        assert_eq!((scan.from_ns, scan.to_ns), (0, last_us * 1000));
    }
}
