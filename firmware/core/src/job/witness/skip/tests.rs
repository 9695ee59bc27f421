extern crate std;
use std::vec::Vec as List;

use proptest::prelude::*;

use super::*;

/// The line's levels in time: each pulse from its begin to its end, ns.
type Pulses = List<(u64, u64)>;

const MS: u64 = 1_000_000;
const US: u64 = 1_000;

fn edge(cause: LatchCause, t_ns: u64) -> LatchReport {
    LatchReport {
        number: 0,
        cause,
        counts: [0; 3].into_iter().collect(),
        t_ns,
        missed: 0,
    }
}

/// A position that says which edge it was captured at.
fn at(t_ns: u64) -> [f64; 3] {
    [t_ns as f64, 0.0, 0.0]
}

fn feed(line: &mut SkipLine, pulses: &[(u64, u64)]) {
    for (begin, end) in pulses {
        line.latched(&edge(LatchCause::Skip, *begin), Some(at(*begin)));
        line.latched(&edge(LatchCause::SkipEnd, *end), Some(at(*end)));
    }
}

/// When the touch began that a line takes.
fn began(touch: Option<Touch>) -> Option<u64> {
    Some(touch?.mm?[0] as u64)
}

/// A train of bounces that ends closed: pulses of 10 us to `longest`, gaps alike, then the contact
/// until `release`, and a train again. The gap before a pulse and its length are of the list.
fn contact(begin: u64, train: &[(u64, u64)], rest: &[(u64, u64)], held: u64) -> Pulses {
    let mut pulses = Pulses::new();
    let mut t = begin;
    for (closed, open) in train {
        pulses.push((t, t + closed));
        t += closed + open;
    }
    pulses.push((t, t + held));
    t += held;
    for (closed, open) in rest {
        t += open;
        pulses.push((t, t + closed));
        t += closed;
    }
    pulses
}

/// Bounces of 10 us to 5 ms.
fn train() -> impl Strategy<Value = List<(u64, u64)>> {
    let length = || prop_oneof![10 * US..100 * US, 100 * US..5 * MS];
    prop::collection::vec((length(), length()), 0..9)
}

proptest! {
    /// Whatever a contact bounces, the touch is its first edge, and the release is none; the width
    /// is that of all of it. All others are counted.
    #[test]
    fn the_first_edge_is_the_touch(
        closing in train(), opening in train(), held in 30 * MS..900 * MS, fast in any::<bool>(),
    ) {
        let mut line = SkipLine::new(&SkipSpec::default());
        let mut t = 50 * MS;
        for _ in 0..if fast { 2 } else { 1 } {
            let pulses = contact(t, &closing, &opening, held);
            feed(&mut line, &pulses);
            let touch = line.take().unwrap();
            prop_assert_eq!(touch.mm, Some(at(t)));
            let end = pulses.last().unwrap().1;
            prop_assert_eq!(touch.width_ns, end - t);
            let bounces = u32::try_from(closing.len() + opening.len()).unwrap();
            prop_assert_eq!(line.chatter(), Chatter { bounces, sparks: 0 });
            // The machine backs off and comes again.
            t = end + 25 * MS;
        }
    }

    /// The slow touch after the fast one takes its place, also where each bounces and neither is
    /// printed in between.
    #[test]
    fn the_last_touch_counts(closing in train(), opening in train()) {
        let mut line = SkipLine::new(&SkipSpec::default());
        let first = contact(MS, &closing, &opening, 40 * MS);
        let second = first.last().unwrap().1 + 60 * MS;
        feed(&mut line, &first);
        feed(&mut line, &contact(second, &closing, &opening, 200 * MS));
        prop_assert_eq!(began(line.take()), Some(second));
        prop_assert_eq!(line.take(), None);
    }

    /// Sparks anywhere, before the touch, within it, after it, change nothing but their count.
    #[test]
    fn sparks_are_counted_and_nothing_else(
        closing in train(), places in prop::collection::vec((0_u64..300 * MS, 16_u64..4_900), 1..6),
    ) {
        let touch = 150 * MS;
        let pulses = contact(touch, &closing, &[], 100 * MS);
        let is_free = |t: u64| pulses.iter().all(|(b, e)| t + 5 * US < *b || t > e + US);
        let mut all = pulses.clone();
        let mut sparks = List::new();
        for (t, width) in places {
            let alone = sparks.iter().all(|of: &(u64, u64)| of.0.abs_diff(t) > 20 * US);
            if is_free(t) && alone {
                sparks.push((t, t + width));
            }
        }
        all.extend(&sparks);
        all.sort_unstable();
        let mut line = SkipLine::new(&SkipSpec::default());
        feed(&mut line, &all);
        prop_assert_eq!(began(line.take()), Some(touch));
        prop_assert_eq!(line.chatter().sparks as usize, sparks.len());
    }

    /// Two state machines stamp the edges: those of a few pulses come out of their order.
    #[test]
    fn edges_may_come_out_of_order(closing in train(), by in 1_usize..6) {
        let pulses = contact(MS, &closing, &[], 50 * MS);
        let rises = pulses.iter().map(|(begin, _)| edge(LatchCause::Skip, *begin));
        let falls = pulses.iter().map(|(_, end)| edge(LatchCause::SkipEnd, *end));
        let mut falls = falls.collect::<List<_>>().into_iter();
        let mut line = SkipLine::new(&SkipSpec::default());
        for (number, rise) in rises.enumerate() {
            line.latched(&rise, Some(at(rise.t_ns)));
            // A fall comes when so many rises after it have come.
            if number >= by {
                let fall = falls.next().unwrap();
                line.latched(&fall, Some(at(fall.t_ns)));
            }
        }
        falls.for_each(|fall| line.latched(&fall, Some(at(fall.t_ns))));
        prop_assert_eq!(began(line.take()), Some(MS));
        let bounces = u32::try_from(closing.len()).unwrap();
        prop_assert_eq!(line.chatter(), Chatter { bounces, sparks: 0 });
    }
}

/// An optocoupler's slow edge crosses the threshold for 20 us in pulses of 1 to 3 us: sparks, and
/// the touch is where the level stays.
#[test]
fn a_slow_edge_is_taken_where_it_stays() {
    let mut pulses = Pulses::new();
    for n in 0..5 {
        let t = 10 * MS + n * 4 * US;
        pulses.push((t, t + 1_000 + n * 500));
    }
    pulses.push((10 * MS + 20 * US, 90 * MS));
    let mut line = SkipLine::new(&SkipSpec::default());
    feed(&mut line, &pulses);
    assert_eq!(began(line.take()), Some(10 * MS + 20 * US));
    assert_eq!(
        line.chatter(),
        Chatter {
            bounces: 0,
            sparks: 5
        }
    );
}

/// A line that rests high: the touch is where it falls.
#[test]
fn either_polarity() {
    let spec = SkipSpec {
        active: SignalLevel::Low,
        ..SkipSpec::default()
    };
    let mut line = SkipLine::new(&spec);
    let low = [(10 * MS, 10 * MS + 30 * US), (10 * MS + 80 * US, 60 * MS)];
    for (begin, end) in low {
        line.latched(&edge(LatchCause::SkipEnd, begin), Some(at(begin)));
        line.latched(&edge(LatchCause::Skip, end), Some(at(end)));
    }
    assert_eq!(began(line.take()), Some(10 * MS));
    assert_eq!(
        line.chatter(),
        Chatter {
            bounces: 1,
            sparks: 0
        }
    );
}

/// The limits to the nanosecond: a pulse as wide as the minimum counts, one narrower does not; a
/// line that has rested as long as the hold-off begins a touch.
#[test]
fn the_limits_are_exact() {
    let spec = SkipSpec {
        min_width_us: Some(10),
        hold_off_ms: Some(7),
        ..SkipSpec::default()
    };
    for (width, is_touch) in [(9_999, false), (10_000, true)] {
        let mut line = SkipLine::new(&spec);
        feed(&mut line, &[(MS, MS + width)]);
        assert_eq!(line.take().is_some(), is_touch, "{width}");
    }
    for (rest, second) in [(7 * MS - 1, false), (7 * MS, true)] {
        let mut line = SkipLine::new(&spec);
        let end = MS + 20 * US;
        feed(&mut line, &[(MS, end), (end + rest, end + rest + MS)]);
        let expected = if second { end + rest } else { MS };
        assert_eq!(began(line.take()), Some(expected), "{rest}");
    }
}

/// The probe is still pressed when its line is printed: the touch is there; its release bounces
/// later and is none.
#[test]
fn the_line_is_printed_while_the_probe_is_pressed() {
    let mut line = SkipLine::new(&SkipSpec::default());
    line.latched(&edge(LatchCause::Skip, MS), Some(at(MS)));
    assert_eq!(began(line.take()), Some(MS));
    line.latched(&edge(LatchCause::SkipEnd, 500 * MS), Some(at(0)));
    feed(&mut line, &[(501 * MS, 502 * MS)]);
    assert_eq!(line.take(), None);
    assert_eq!(
        line.chatter(),
        Chatter {
            bounces: 1,
            sparks: 0
        }
    );
}

/// An edge that was not captured takes the touch with it if it may have been its first; as a
/// bounce it is counted.
#[test]
fn a_lost_edge_has_no_position() {
    let spec = SkipSpec::default();
    let lost = |missed, t_ns| LatchReport {
        counts: heapless::Vec::new(),
        missed,
        ..edge(LatchCause::Skip, t_ns)
    };
    // Before the first: the touch has no position.
    let mut line = SkipLine::new(&spec);
    line.latched(&lost(2, MS), None);
    feed(&mut line, &[(MS + 100 * US, 50 * MS)]);
    assert_eq!(line.take().map(|touch| touch.mm), Some(None));
    assert_eq!(
        line.chatter(),
        Chatter {
            bounces: 2,
            sparks: 0
        }
    );
    // With the first capture: so, too.
    let mut line = SkipLine::new(&spec);
    let mut first = edge(LatchCause::Skip, MS);
    first.missed = 1;
    line.latched(&first, Some(at(MS)));
    assert_eq!(line.take().map(|touch| touch.mm), Some(None));
    // Behind it: a bounce.
    let mut line = SkipLine::new(&spec);
    feed(&mut line, &[(MS, 2 * MS)]);
    line.latched(&lost(7, 3 * MS), None);
    assert_eq!(began(line.take()), Some(MS));
    assert_eq!(
        line.chatter(),
        Chatter {
            bounces: 7,
            sparks: 0
        }
    );
}

/// A pulse whose end was not captured may have been a spark: where a touch begins by it, that has no
/// position. As a bounce it is counted.
#[test]
fn a_lost_end_has_no_position() {
    let spec = SkipSpec::default();
    for (first, touch) in [(MS, None), (MS - 40 * US, Some(MS - 40 * US))] {
        let mut line = SkipLine::new(&spec);
        if touch.is_some() {
            feed(&mut line, &[(first, first + 20 * US)]);
        }
        line.latched(&edge(LatchCause::Skip, MS), Some(at(MS)));
        let mut end = edge(LatchCause::SkipEnd, 2 * MS);
        end.missed = 1;
        line.latched(
            &edge(LatchCause::Skip, MS + 50 * US),
            Some(at(MS + 50 * US)),
        );
        line.latched(&end, Some(at(2 * MS)));
        let taken = line.take().unwrap();
        assert_eq!(taken.mm, touch.map(at));
    }
}

/// A board that tells no ends: the first edge of a train is the touch all the same.
#[test]
fn without_ends_the_first_edge_counts() {
    let mut line = SkipLine::new(&SkipSpec::default());
    for t in [MS, MS + 60 * US, MS + 3 * MS, MS + 9 * MS] {
        line.latched(&edge(LatchCause::Skip, t), Some(at(t)));
    }
    assert_eq!(began(line.take()), Some(MS));
    line.latched(&edge(LatchCause::Skip, 400 * MS), Some(at(400 * MS)));
    assert_eq!(began(line.take()), Some(400 * MS));
}

/// More edges than there is room for: the oldest are judged in time, none is forgotten.
#[test]
fn a_thousand_bounces() {
    let mut line = SkipLine::new(&SkipSpec::default());
    let pulses: Pulses = (0..1000_u64)
        .map(|n| (MS + n * 40 * US, MS + n * 40 * US + 20 * US))
        .collect();
    feed(&mut line, &pulses);
    assert_eq!(began(line.take()), Some(MS));
    assert_eq!(
        line.chatter(),
        Chatter {
            bounces: 999,
            sparks: 0
        }
    );
}
