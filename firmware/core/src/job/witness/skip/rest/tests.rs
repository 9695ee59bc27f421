extern crate std;
use std::vec::Vec as List;

use proptest::prelude::*;

use super::*;
use crate::job::witness::skip::SkipLine;
use umi_protocol::job::SkipSpec;
use umi_protocol::latch::{LatchCause, LatchReport, SignalLevel};

const MS: u64 = 1_000_000;

/// A touch: how long the axes were on their way to it, how long they stood, how far away they were when the release was
/// told, and what bounced.
#[derive(Clone, Debug)]
struct Press {
    way_ms: u64,
    stands_ms: u64,
    late_mm: f64,
    bounces: u64,
    /// A second, slow one at the same place follows.
    twice: bool,
}

fn press(
    ways: core::ops::Range<u64>,
    stands: core::ops::Range<u64>,
) -> impl Strategy<Value = Press> {
    let late = prop_oneof![Just(0.0), 0.001..0.05, 0.05..0.5];
    (ways, stands, late, 0_u64..4, any::<bool>()).prop_map(
        |(way_ms, stands_ms, late_mm, bounces, twice)| Press {
            way_ms,
            stands_ms,
            late_mm,
            bounces,
            twice,
        },
    )
}

/// Edges of the line: whether the probe touches, when, and where.
type Edges = List<(bool, u64, [f64; 3])>;

/// Hits on three balls of 25 mm, 150 mm apart, as the axes make them; `moves` is false without encoders.
fn probed(presses: &[Press], moves: bool) -> Edges {
    let mut edges = Edges::new();
    let mut t = 1_000 * MS;
    let mut add = |is_touch, t, mm: [f64; 3]| {
        edges.push((is_touch, t, if moves { mm } else { [0.0; 3] }));
    };
    for (hit, press) in presses.iter().enumerate() {
        let (ball, turn) = ((hit / 5) as f64, (hit % 5) as f64);
        let (sin, cos) = (1.2566 * turn).sin_cos();
        let out = [cos, sin, 0.0];
        let at = |mm: f64| [150.0 * ball + mm * out[0], mm * out[1], -20.0];
        // Between balls it is farther.
        t += press.way_ms * MS * if hit % 5 == 0 { 3 } else { 1 };
        for slow in 0..=u64::from(press.twice) {
            let stands = if slow == 0 && press.twice {
                press.stands_ms.min(100)
            } else {
                press.stands_ms
            };
            for bounce in 0..press.bounces {
                add(true, t + bounce * 40_000, at(14.0));
                add(false, t + bounce * 40_000 + 20_000, at(14.0));
            }
            t += press.bounces * 40_000;
            add(true, t, at(14.0));
            t += stands * MS;
            add(false, t, at(14.0 + press.late_mm));
            t += if press.twice && slow == 0 {
                200 * MS
            } else {
                0
            };
        }
    }
    edges
}

/// Places of hits, in the plane of X and Y.
type Places = List<[f64; 2]>;

/// A bore of so many hits, where the tip's centre is so far from its own; opposite ones follow each other where they are four.
fn bore(hits: usize, radius: f64) -> Places {
    let turn = |hit: usize| match (hits, hit) {
        (4, 1) => 2.0,
        (4, 2) => 1.0,
        _ => hit as f64,
    };
    let turns = (0..hits).map(|hit| core::f64::consts::TAU * turn(hit) / hits as f64);
    turns
        .map(|turn| [radius * turn.cos(), radius * turn.sin()])
        .collect()
}

/// Four hits on a plane, a square of this side.
fn square(side: f64) -> Places {
    [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]].into()
}

/// As [`probed`], of hits at these places, whose line is printed while the probe touches for the last time.
fn probed_at(places: &[[f64; 2]], presses: &[Press], mut to: impl FnMut(bool, u64, [f64; 3])) {
    let mut t = 1_000 * MS;
    for ([x, y], press) in places.iter().zip(presses.iter().cycle()) {
        t += press.way_ms * MS;
        for slow in 0..=u64::from(press.twice) {
            for bounce in 0..press.bounces {
                to(true, t + bounce * 40_000, [*x, *y, 0.0]);
                to(false, t + bounce * 40_000 + 20_000, [*x, *y, 0.0]);
            }
            t += press.bounces * 40_000;
            to(true, t, [*x, *y, 0.0]);
            t += press.stands_ms * MS;
            to(false, t, [*x, *y, press.late_mm]);
            t += if slow == 0 { 200 * MS } else { 0 };
        }
    }
}

/// What the line shows of hits at these places.
fn shown_at(places: &[[f64; 2]], presses: &[Press], active: SignalLevel) -> Rests {
    let mut edges = Edges::new();
    probed_at(places, presses, |is_touch, t, mm| {
        edges.push((is_touch, t, mm))
    });
    shown(&edges, active)
}

/// What the line shows of them to a job that takes this level for a touch; the probe's is high.
fn shown(edges: &[(bool, u64, [f64; 3])], active: SignalLevel) -> Rests {
    let mut line = SkipLine::new(&SkipSpec {
        active,
        ..SkipSpec::default()
    });
    for (number, (is_touch, t_ns, mm)) in edges.iter().enumerate() {
        let cause = match is_touch {
            true => LatchCause::Skip,
            false => LatchCause::SkipEnd,
        };
        let latch = LatchReport {
            number: 0,
            cause,
            counts: [0; 3].into_iter().collect(),
            t_ns: *t_ns,
            missed: 0,
        };
        line.latched(&latch, Some(*mm));
        if number % 7 == 6 {
            line.take();
        }
    }
    line.take();
    line.rests()
}

proptest! {
    /// With encoders: whatever a probe does, also resting on the stylus for up to a minute at each hit, nothing is said against a
    /// right job, and the other level is named every time. So it is where the first edge that the board sees is a release.
    #[test]
    fn the_axes_tell_the_levels_apart(
        presses in prop::collection::vec(press(300..4000, 5..60_000), 8..16), begins_pressed: bool,
    ) {
        let edges = probed(&presses, true);
        let edges = &edges[usize::from(begins_pressed)..];
        prop_assert_eq!(shown(edges, SignalLevel::High), Rests::Unknown);
        prop_assert_eq!(shown(edges, SignalLevel::Low), Rests::AtTouch);
    }

    /// Small features and few hits: bores of 3 to 8 hits, from 3 mm beside the centre on, and squares from 8 mm on.
    #[test]
    fn small_features_tell_the_levels_apart(
        hits in 3_usize..9, radius in 3.0..25.0, side in 8.0..40.0, is_bore: bool,
        presses in prop::collection::vec(press(300..4000, 5..60_000), 3..9),
    ) {
        let places = if is_bore { bore(hits, radius) } else { square(side) };
        prop_assert_eq!(shown_at(&places, &presses, SignalLevel::High), Rests::Unknown);
        prop_assert_eq!(shown_at(&places, &presses, SignalLevel::Low), Rests::AtTouch);
    }

    /// A right job of them: neither a late release of any kind nor hits beside each other make a wrong level of it, where they are
    /// more than half a millimetre apart and the release comes before half the way to the next.
    #[test]
    fn small_features_are_no_wrong_level(
        hits in 2_usize..17, radius in 1.5..25.0, late in 0.0..0.5,
        presses in prop::collection::vec(press(300..4000, 5..60_000), 3..9),
    ) {
        let places = bore(hits, radius);
        let [a, b] = [places[0], places[1]];
        let way = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
        prop_assume!(way > 0.5);
        let late_mm = late * way;
        let late: List<_> = presses.into_iter().map(|press| Press { late_mm, ..press }).collect();
        prop_assert_ne!(shown_at(&places, &late, SignalLevel::High), Rests::AtTouch);
    }

    /// A probe without a wire tells its release late, when a fast retraction has gone on for millimetres: nothing is said.
    #[test]
    fn a_late_release_is_no_wrong_level(
        presses in prop::collection::vec(press(300..4000, 5..60_000), 8..16), late_mm in 0.0..8.0,
    ) {
        let late = presses.into_iter().map(|press| Press { late_mm, ..press });
        let edges = probed(&late.collect::<List<_>>(), true);
        prop_assert_ne!(shown(&edges, SignalLevel::High), Rests::AtTouch);
    }

    /// A probe that is switched off, at the tool changer and back, up to three times in a setup: that is no touch, and nothing is
    /// said against it.
    #[test]
    fn a_probe_that_is_off_is_no_wrong_level(
        presses in prop::collection::vec(press(300..4000, 5..60_000), 8..16),
        off in prop::collection::vec(0_usize..8, 0..4),
    ) {
        let mut edges = probed(&presses, true);
        for place in off {
            let release = edges.iter().enumerate().filter(|(_, edge)| !edge.0).nth(place * 2);
            let (at, (_, t, _)) = release.map(|(at, edge)| (at, *edge)).unwrap_or((0, edges[0]));
            if edges.get(at + 1).is_none_or(|next| next.1 > t + 20 * MS) {
                let changer = [-400.0, 300.0, 200.0];
                let ready = [-150.0, 50.0, 50.0];
                edges.splice(at + 1..at + 1, [(true, t + 5 * MS, changer), (false, t + 15 * MS, ready)]);
            }
        }
        prop_assert_ne!(shown(&edges, SignalLevel::High), Rests::AtTouch);
    }

    /// Without encoders nothing is refused. The other level is told where the probe stands for a tenth of its ways or less; the
    /// right one is not, where it stands for no longer than its longest way takes.
    #[test]
    fn durations_are_a_hint(
        quick in prop::collection::vec(press(1000..4000, 5..100), 8..16),
        slow in prop::collection::vec(press(1000..4000, 5..2900), 8..16),
    ) {
        // A fast touch and the slow one behind it are 0.2 s apart.
        prop_assert_eq!(shown(&probed(&quick, false), SignalLevel::Low), Rests::LongerAtTouch);
        for presses in [quick, slow] {
            prop_assert_eq!(shown(&probed(&presses, false), SignalLevel::High), Rests::Unknown);
        }
    }
}

/// Features that were measured with the levels exchanged and said nothing, or a remark, before the axes' standing counted.
#[test]
fn features_of_a_shop_are_told() {
    let press = |twice| Press {
        way_ms: 3000,
        stands_ms: 150,
        late_mm: 0.02,
        bounces: 0,
        twice,
    };
    for places in [
        bore(4, 5.5),
        bore(4, 7.5),
        bore(3, 22.5),
        bore(3, 3.0),
        square(8.0),
    ] {
        for twice in [true, false] {
            let presses = [press(twice)];
            assert_eq!(
                shown_at(&places, &presses, SignalLevel::High),
                Rests::Unknown
            );
            assert_eq!(
                shown_at(&places, &presses, SignalLevel::Low),
                Rests::AtTouch,
                "{places:?} {twice}"
            );
        }
    }
}

/// Too little is seen: one touch, edges that were lost, a board that tells no ends, a line that does not move.
#[test]
fn what_was_hardly_seen_says_nothing() {
    let mut levels = Levels::default();
    for t in 0..100 {
        levels.edge(true, t * 1_000 * MS, &[15.0 * t as f64, 0.0, 0.0]);
    }
    assert_eq!(levels.rests(), Rests::Unknown);
    let mut levels = Levels::default();
    for t in 0..100 {
        let mm = [15.0 * t as f64, 0.0, 0.0];
        levels.edge(true, t * 1_000 * MS, &mm);
        levels.lost();
        levels.edge(false, t * 1_000 * MS + 900 * MS, &[mm[0] + 12.0, 0.0, 0.0]);
    }
    assert_eq!(levels.rests(), Rests::Unknown);
    let mut levels = Levels::default();
    let exchanged = |levels: &mut Levels, touches: core::ops::Range<u64>| {
        for t in touches {
            let mm = 15.0 * t as f64;
            levels.edge(true, t * 1_000 * MS, &[mm, 0.0, 0.0]);
            levels.edge(false, t * 1_000 * MS + 900 * MS, &[mm + 15.0, 0.0, 0.0]);
        }
    };
    exchanged(&mut levels, 0..1);
    assert_eq!(levels.rests(), Rests::Unknown);
    levels.begin();
    exchanged(&mut levels, 1..5);
    assert_eq!(levels.rests(), Rests::AtTouch);
    levels.begin();
    assert_eq!(levels.rests(), Rests::Unknown);
}

/// Places that are no number, or beyond any machine, are no way at all, or the longest that counts.
#[test]
fn wild_places_do_no_harm() {
    let mut levels = Levels::default();
    for (t, mm) in [f64::NAN, 1e300, f64::NEG_INFINITY, 0.0, -1e300, 1.0]
        .into_iter()
        .enumerate()
    {
        levels.edge(t % 2 == 0, 0, &[mm; 3]);
    }
    assert_eq!(levels.rests(), Rests::Unknown);
}
