//! What each disagreement is called, from simulated setups whose fault is known.

use std::vec::Vec;

use umi_protocol::job::Approach::{MinusX, MinusY, MinusZ, PlusX, PlusY};

use umi_protocol::latch::{LatchCause, MAX_AXES};

use super::*;
use crate::dprnt::Doubts;
use crate::units::{Micros, Point};

const FEED: f64 = 60.0;
const SCALES: [f64; 3] = [10_000.0, -10_000.0, 1000.0];

fn spec() -> WitnessSpec {
    WitnessSpec {
        counts_per_mm: SCALES,
        origin_counts: None,
        feed_mm_per_min: None,
        delay_ms: 4.0,
        tolerance_mm: 0.003,
    }
}

/// A second after the one before: the line has rested.
fn later() -> u64 {
    use std::sync::atomic::{AtomicU64, Ordering};
    static NOW_NS: AtomicU64 = AtomicU64::new(0);
    NOW_NS.fetch_add(1_000_000_000, Ordering::Relaxed)
}

/// A machine whose control and encoders are wrong as wanted.
#[derive(Clone, Copy)]
struct Machine {
    /// Encoder counts at the control's origin.
    origin: [f64; 3],
    /// Counts per millimetre that the encoders really give.
    scales: [f64; 3],
    /// Added to what the control prints.
    offset_mm: [f64; 3],
    /// Counts that X loses from the hit with this number on.
    lost: (usize, f64),
    /// The control's delay, per hit: shortest and longest.
    delay_ms: [f64; 2],
}

impl Machine {
    fn new() -> Self {
        Self {
            origin: [123_456.0, -777.0, 50.0],
            scales: SCALES,
            offset_mm: [0.0; 3],
            lost: (usize::MAX, 0.0),
            delay_ms: [0.0, 4.0],
        }
    }

    /// Probes three spheres, five hits each, and gives the reasons.
    fn probe(&self, witness: &mut Witness) -> Vec<Reason> {
        witness.next_setup();
        let mut number = 0_usize;
        for center in [
            [-135.0, -136.6, 135.9],
            [138.0, -134.7, 110.3],
            [-136.7, 136.4, 136.1],
        ] {
            for approach in [MinusZ, MinusX, PlusX, MinusY, PlusY] {
                let (axis, sign) = approach.axis_and_sign();
                let mut tip = Vec::from(center);
                tip[axis] -= sign * 15.2;
                let mut counts = heapless::Vec::new();
                for (at, tip_mm) in tip.iter().enumerate() {
                    let gone = at == 0 && number >= self.lost.0;
                    let lost = if gone { self.lost.1 } else { 0.0 };
                    let count = self.origin[at] + tip_mm * self.scales[at] + lost;
                    counts.push(libm::round(count) as i64).unwrap();
                }
                // Evenly through the range, in a fixed disorder.
                let part = (number * 7 % 15) as f64 / 14.0;
                let [least, most] = self.delay_ms;
                let delay_ms = least + part * (most - least);
                tip[axis] += sign * FEED / 60_000.0 * delay_ms;
                let printed: Vec<f64> = (tip.iter().zip(self.offset_mm))
                    .map(|(tip_mm, offset_mm)| libm::round((tip_mm + offset_mm) * 1000.0) / 1000.0)
                    .collect();
                let touch = touch(witness, counts);
                let position = Point::from_mm(printed[0], printed[1], printed[2]);
                let seen = witness.pair(touch, &line(position));
                assert!(seen.is_some());
                let hit = Hit {
                    position,
                    approach: Some(approach),
                    seen,
                };
                witness.take(&[hit], false);
                number += 1;
            }
        }
        let mut reasons = Vec::new();
        witness.judge(&mut |reason| reasons.push(reason));
        reasons
    }

    /// The same on a witness that has learned its origin from a sound machine.
    fn probe_after_a_sound_setup(&self) -> Vec<Reason> {
        let mut witness = Witness::new(spec(), &SkipSpec::default());
        assert_eq!(Self::new().probe(&mut witness), []);
        assert!(witness.conclude().contains(&Some(Reason::WitnessLearned)));
        self.probe(&mut witness)
    }
}

/// A touch with the axes at these counts.
fn touch(witness: &Witness, counts: heapless::Vec<i64, MAX_AXES>) -> Option<Touch> {
    let latch = LatchReport {
        number: 0,
        cause: LatchCause::Skip,
        counts,
        t_ns: later(),
        missed: 0,
    };
    let mut skip = skip::SkipLine::new(&SkipSpec::default());
    skip.latched(&latch, witness.mm(&latch));
    skip.take()
}

fn line(position: Point) -> ReportedHit {
    ReportedHit {
        line: 1,
        first: Micros(0),
        last: Micros(0),
        position,
        digits: [None; 3],
        feature: None,
        feature_id: Some(1),
        index: None,
        run: None,
        sequence: None,
        approach: None,
        touched: Some(true),
        feed_mm_per_min: Some(FEED),
        doubts: Doubts::NONE,
    }
}

/// Two witnesses that agree measure the control's delay, to what its increment of
/// 1 µm leaves at 1 mm/s: 1 ms.
#[test]
fn agreement_measures_the_delay() {
    let mut witness = Witness::new(spec(), &SkipSpec::default());
    assert_eq!(Machine::new().probe(&mut witness), []);
    let [
        Some(Reason::Witnessed {
            hits,
            least_ms,
            mean_ms,
            most_ms,
            resolution_ms,
        }),
        learned,
    ] = witness.conclude()
    else {
        panic!("nothing was witnessed");
    };
    assert_eq!((hits, learned), (15, Some(Reason::WitnessLearned)));
    // 3 µm at 1 mm/s.
    assert!((resolution_ms - 3.0).abs() < 1e-9);
    assert!((least_ms - 0.0).abs() < 1.0, "{least_ms}");
    assert!((mean_ms - 2.0).abs() < 0.4, "{mean_ms}");
    assert!((most_ms - 4.0).abs() < 1.0, "{most_ms}");
}

/// An override that no line says makes each touch later in proportion. The encoders see it from the
/// tolerance on: what passes is no more than that beside what the delay allows.
#[test]
fn an_override_is_named_from_the_tolerance_on() {
    for (percent, is_named) in [(20.0, false), (150.0, false), (200.0, true), (300.0, true)] {
        let mut machine = Machine::new();
        machine.delay_ms = machine.delay_ms.map(|ms| ms * percent / 100.0);
        let reasons = machine.probe_after_a_sound_setup();
        let named = reasons.iter().any(
            |reason| matches!(reason, Reason::ControlDelay { limit_ms, .. } if *limit_ms == 4.0),
        );
        assert_eq!(named, is_named, "{percent} %: {reasons:?}");
        assert_eq!(reasons.is_empty(), !is_named, "{percent} %: {reasons:?}");
        let spec = spec();
        let beside_mm = FEED / 60_000.0 * spec.delay_ms * (percent / 100.0 - 1.0);
        assert_eq!(beside_mm > spec.tolerance_mm, is_named, "{percent} %");
    }
}

/// A wrong work offset, or datum, is named with its axis and size.
#[test]
fn moved_offset_is_named() {
    let mut machine = Machine::new();
    machine.offset_mm[2] = 0.180;
    let reasons = machine.probe_after_a_sound_setup();
    let [
        Reason::WitnessShift {
            axis: 2, shift_mm, ..
        },
    ] = reasons.as_slice()
    else {
        panic!("{reasons:?}");
    };
    assert!((shift_mm - 0.180).abs() < 0.001);
}

/// With a given origin even the first setup is held against it.
#[test]
fn given_origin_holds_from_the_first_setup() {
    let machine = Machine::new();
    let given = WitnessSpec {
        origin_counts: Some(machine.origin),
        ..spec()
    };
    assert_eq!(
        machine.probe(&mut Witness::new(given, &SkipSpec::default())),
        []
    );
    let mut moved = machine;
    moved.offset_mm[0] = -0.02;
    let reasons = moved.probe(&mut Witness::new(given, &SkipSpec::default()));
    assert!(
        matches!(reasons.as_slice(), [Reason::WitnessShift { axis: 0, shift_mm, .. }] if (shift_mm + 0.02).abs() < 0.001),
        "{reasons:?}"
    );
}

/// A wrong scale is named, on the first setup already.
#[test]
fn wrong_scale_is_named() {
    for ppm in [60.0, -250.0, 5000.0] {
        let mut machine = Machine::new();
        machine.scales[1] = SCALES[1] / (1.0 + ppm * 1e-6);
        let reasons = machine.probe(&mut Witness::new(spec(), &SkipSpec::default()));
        let [
            Reason::WitnessScale {
                axis: 1,
                ppm: found,
            },
        ] = reasons.as_slice()
        else {
            panic!("{ppm}: {reasons:?}");
        };
        assert!((found - ppm).abs() < 5.0, "{found} for {ppm}");
    }
}

/// Inch against millimetre is a wrong scale too.
#[test]
fn inch_is_a_wrong_scale() {
    let mut machine = Machine::new();
    machine.scales = SCALES.map(|scale| scale * 25.4);
    let reasons = machine.probe(&mut Witness::new(spec(), &SkipSpec::default()));
    assert_eq!(reasons.len(), 3, "{reasons:?}");
    assert!(
        reasons
            .iter()
            .all(|r| matches!(r, Reason::WitnessScale { .. })),
        "{reasons:?}"
    );
}

/// Lost counts are named with their number, wherever they are lost.
#[test]
fn lost_counts_are_named() {
    for (from, counts) in [(3, 40.0), (5, -40.0), (8, 1000.0), (13, -72.0)] {
        let mut machine = Machine::new();
        machine.lost = (from, counts);
        let reasons = machine.probe(&mut Witness::new(spec(), &SkipSpec::default()));
        let [
            Reason::LostCounts {
                axis: 0,
                counts: found,
            },
        ] = reasons.as_slice()
        else {
            panic!("{counts} at {from}: {reasons:?}");
        };
        assert!((found - counts).abs() <= 6.0, "{found} for {counts}");
    }
}

/// What the tolerance hides is not named, what it does not hide is: 3 µm are 30 counts
/// of 0.1 µm, and the control's increment of 1 µm blurs the border.
#[test]
fn lost_counts_are_named_from_the_tolerance_on() {
    for (counts, named) in [(10.0, false), (20.0, false), (40.0, true), (60.0, true)] {
        let mut machine = Machine::new();
        machine.lost = (7, counts);
        let reasons = machine.probe(&mut Witness::new(spec(), &SkipSpec::default()));
        assert_eq!(!reasons.is_empty(), named, "{counts}: {reasons:?}");
    }
}

/// An axis that is only ever probed along, as Z of a plane from above: its origin is
/// learned too, and a shift beyond what the control's delay explains is named.
#[test]
fn axis_seen_only_along_is_witnessed() {
    let hit = |at: [f64; 3], encoder_off_mm: f64, delay_ms: f64| {
        let late = FEED / 60_000.0 * delay_ms;
        let difference_mm = [0.0, 0.0, encoder_off_mm - late];
        Hit {
            position: Point::from_array_mm(at),
            approach: Some(MinusZ),
            seen: Some(Seen {
                difference_mm,
                feed_mm_per_min: FEED,
            }),
        }
    };
    let setup = |witness: &mut Witness, off_mm: f64| {
        witness.next_setup();
        let places = [[0.0, 0.0, 5.0], [50.0, 0.0, 5.0], [0.0, 50.0, 5.0]];
        let hits: Vec<Hit> = (places.iter().zip([0.0, 2.0, 4.0]))
            .map(|(at, delay_ms)| hit(*at, off_mm, delay_ms))
            .collect();
        witness.take(&hits, false);
        let mut reasons = Vec::new();
        witness.judge(&mut |reason| reasons.push(reason));
        reasons
    };
    let mut witness = Witness::new(spec(), &SkipSpec::default());
    assert_eq!(setup(&mut witness, 25.0), []);
    // Nothing tells the delay from the origin, so no delay is claimed.
    assert_eq!(witness.conclude(), [None, Some(Reason::WitnessLearned)]);
    assert_eq!(setup(&mut witness, 25.0), []);
    for off_mm in [25.18, 24.82, 25.02, 0.0] {
        let reasons = setup(&mut witness, off_mm);
        assert!(
            matches!(reasons.first(), Some(Reason::ControlDelay { axis: 2, .. })),
            "{off_mm}: {reasons:?}"
        );
    }
}

/// What a setup taught is forgotten when it is NG after all, and nothing else is.
#[test]
fn revoked_setup_teaches_nothing() {
    let mut witness = Witness::new(spec(), &SkipSpec::default());
    let mut machine = Machine::new();
    machine.offset_mm[0] = 0.05;
    assert_eq!(machine.probe(&mut witness), []);
    let _ = witness.conclude();
    witness.unlearn();
    assert_eq!(Machine::new().probe(&mut witness), []);
    let _ = witness.conclude();
    witness.next_setup();
    witness.unlearn();
    assert!(!machine.probe(&mut witness).is_empty());
}

/// A feature that is probed again replaces its first try.
#[test]
fn replaced_feature_is_judged_alone() {
    let mut witness = Witness::new(spec(), &SkipSpec::default());
    assert_eq!(Machine::new().probe(&mut witness), []);
    let hit = |off_mm: f64| Hit {
        position: Point::from_mm(1.0, 2.0, 3.0),
        approach: Some(MinusX),
        seen: Some(Seen {
            difference_mm: [-12.3456, -0.0777 + off_mm, -0.05],
            feed_mm_per_min: FEED,
        }),
    };
    let contradicts = |witness: &Witness| {
        let mut reasons = Vec::new();
        witness.judge(&mut |reason| reasons.push(reason));
        !reasons.is_empty()
    };
    witness.take(&[hit(0.5)], false);
    assert!(contradicts(&witness));
    witness.take(&[hit(0.0)], true);
    assert!(!contradicts(&witness));
}

/// A control that is later than it may be is named with its delay.
#[test]
fn late_control_is_named() {
    let mut machine = Machine::new();
    machine.delay_ms = [0.0, 12.0];
    let reasons = machine.probe_after_a_sound_setup();
    assert!(!reasons.is_empty());
    for reason in reasons {
        assert!(
            matches!(reason, Reason::ControlDelay { delay_ms, .. } if delay_ms > 7.0),
            "{reason:?}"
        );
    }
}

/// A line without a touch, and one with a touch whose edge was not captured, have no second
/// witness.
#[test]
fn line_without_latch_is_not_paired() {
    let witness = Witness::new(spec(), &SkipSpec::default());
    let line = line(Point::from_mm(1.0, 2.0, 3.0));
    let counts = |counts: &[i64]| heapless::Vec::from_slice(counts).unwrap();
    assert_eq!(witness.pair(None, &line), None);
    let two_axes = touch(&witness, counts(&[1, 2]));
    assert!(two_axes.is_some());
    assert_eq!(witness.pair(two_axes, &line), None);
    let three = touch(&witness, counts(&[1, 2, 3]));
    assert!(witness.pair(three, &line).is_some());
}

/// At a feed of zero every delay would be plausible: such a line has no second witness.
#[test]
fn line_without_feed_is_not_paired() {
    let witness = Witness::new(spec(), &SkipSpec::default());
    let touch = touch(&witness, heapless::Vec::from_slice(&[1, 2, 3]).unwrap());
    for feed in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let mut line = line(Point::from_mm(1.0, 2.0, 3.0));
        line.feed_mm_per_min = Some(feed);
        assert_eq!(witness.pair(touch, &line), None, "{feed}");
    }
}

/// Mixed feeds are refused: the delay would not cancel.
#[test]
fn mixed_feeds_are_refused() {
    let mut feed = Feed::default();
    for mm_per_min in [20.0, 20.0, 100.0, 20.0] {
        feed.take(mm_per_min);
    }
    assert_eq!(feed.changed, Some((3, 100.0)));
}

/// The constant delay of the skip signal is taken off each touch: the control's delay counts from
/// the touch, not from where the signal came.
#[test]
fn the_delay_of_the_skip_signal_is_taken_off() {
    let mean_ms = |delay_us| {
        let skip = SkipSpec {
            delay_us,
            ..SkipSpec::default()
        };
        let mut witness = Witness::new(spec(), &skip);
        assert_eq!(Machine::new().probe(&mut witness), []);
        match witness.conclude()[0] {
            Some(Reason::Witnessed { mean_ms, .. }) => mean_ms,
            ref other => panic!("{other:?}"),
        }
    };
    let longer_ms = mean_ms(500.0) - mean_ms(0.0);
    assert!((longer_ms - 0.5).abs() < 1e-9, "{longer_ms}");
}
