//! Ways that end alike and lead elsewhere.

use std::f64::consts::{PI, TAU};
use std::slice::from_ref as one;

use nalgebra::{Rotation3, Vector3};
use umi_core::registration::RigidTransform;

use super::way::V;
use super::{DiffLimits, Move, PathDifference, Way, compare};

const LIMITS: DiffLimits = DiffLimits {
    near_mm: 0.05,
    within_mm: 0.015,
};

fn line(from: [f64; 3], to: [f64; 3]) -> Move {
    Move {
        ends: [from.into(), to.into()],
        path: Way::Line,
        is_feed: true,
        line: 1,
        away: [false; 3],
        by_machine: false,
    }
}

/// About Z, from a place, with a rise.
fn arc(from: [f64; 3], center: [f64; 2], sweep_rad: f64, rise: f64) -> Move {
    let [x, y] = center;
    let center = V::new(x, y, from[2]);
    let arm = V::from(from) - center;
    let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), sweep_rad) * arm;
    Move {
        ends: [from.into(), center + turned + V::new(0.0, 0.0, rise)],
        path: Way::Arc {
            center,
            axis: Vector3::z(),
            sweep_rad,
        },
        ..line(from, from)
    }
}

/// So many chords of it.
fn chords(of: &Move, count: u32) -> Vec<Move> {
    let at = |n: u32| of.at(f64::from(n) / f64::from(count)).into();
    (0..count).map(|n| line(at(n), at(n + 1))).collect()
}

/// From the origin, so that the way of what follows is measured.
fn compared(first: &[Move], second: &[Move]) -> PathDifference {
    let moves = |moves: &[Move]| {
        let begin = moves[0].ends[0];
        let mut all = vec![line([0.0; 3], begin.into())];
        all.extend_from_slice(moves);
        all
    };
    compare(
        &moves(first),
        &moves(second),
        &RigidTransform::identity(),
        LIMITS,
    )
}

fn way_mm(found: &PathDifference) -> f64 {
    found.largest_way.expect("cuts").mm
}

/// The other way round, about another centre, by its chord: each ends where it should.
#[test]
fn what_ends_alike_is_followed() {
    let half = arc([10.0, 0.0, 0.0], [0.0, 0.0], PI, 0.0);
    assert!(compared(one(&half), one(&half)).is_complete());
    let other_way = arc([10.0, 0.0, 0.0], [0.0, 0.0], -PI, 0.0);
    let found = compared(one(&half), &[other_way]);
    assert!(!found.is_complete() && way_mm(&found) > 19.9, "{found:?}");
    assert!(found.in_words().starts_with("different: by 2"));
    let chord = line([10.0, 0.0, 0.0], [-10.0, 0.0, 0.0]);
    let found = compared(one(&half), &[chord]);
    assert!(!found.is_complete() && way_mm(&found) > 9.9, "{found:?}");
    // About a centre 0.2 mm lower the same two ends are 0.2 mm flatter.
    let radius = 10.0_f64.hypot(0.2);
    let sweep = 2.0 * (10.0 / radius).asin();
    let flatter = arc([10.0, 0.0, 0.0], [0.0, -0.2], sweep, 0.0);
    let found = compared(&[half], &[flatter]);
    let off = 10.2 - radius;
    assert!(!found.is_complete());
    assert!((way_mm(&found) - off).abs() < 0.01 * off, "{found:?}");
}

/// A circle is gone round: by chords, the right way, and once.
#[test]
fn circles_are_gone_round() {
    for rise in [0.0, -0.4] {
        let circle = arc([5.0, 0.0, 0.0], [0.0, 0.0], TAU, rise);
        let many = chords(&circle, 120);
        let sagitta = 5.0 * (1.0 - (PI / 120.0).cos());
        let found = compared(one(&circle), &many);
        assert!(found.is_complete(), "{}", found.in_words());
        assert!((way_mm(&found) - sagitta).abs() < 1e-4, "{found:?}");
        assert!(!compared(one(&circle), &chords(&circle, 40)).is_complete());
        let back = arc([5.0, 0.0, 0.0], [0.0, 0.0], -TAU, rise);
        assert!(!compared(one(&circle), &chords(&back, 120)).is_complete());
        assert!(!compared(one(&circle), &[back]).is_complete());
        let twice = arc([5.0, 0.0, 0.0], [0.0, 0.0], 2.0 * TAU, rise);
        assert!(!compared(one(&circle), one(&twice)).is_complete());
        assert!(!compared(&[circle], &chords(&twice, 240)).is_complete());
    }
}

/// Turns of one arc, as LinuxCNC's P counts them: each of them, and none more.
#[test]
fn turns_are_counted() {
    for (radius, each, rise) in [(5.0, 130, 0.0), (5.0, 130, -3.0), (0.1, 12, 0.0)] {
        for turns in [2, 3, 7, 30] {
            let sweep = TAU * f64::from(turns) - 1.0;
            let wanted = arc([radius, 0.0, 0.0], [0.0, 0.0], sweep, rise);
            let made = chords(&wanted, each * turns);
            // What comes behind is not taken for a turn.
            let [begin, end] = wanted.ends.map(Into::into);
            let behind = [line(end, begin), arc(begin, [0.0, 0.0], TAU, 0.0)];
            let program = |of: &[Move]| [of, &behind[..]].concat();
            let nominal = program(one(&wanted));
            for same in [&nominal, &program(&made)] {
                let found = compared(&nominal, same);
                assert!(found.is_complete(), "{turns}: {}", found.in_words());
            }
            for other in [turns - 1, turns + 1] {
                let sweep = TAU * f64::from(other) - 1.0;
                let other = arc([radius, 0.0, 0.0], [0.0, 0.0], sweep, rise);
                for made in [vec![other.clone()], chords(&other, each * turns)] {
                    let found = compared(&nominal, &program(&made));
                    assert!(!found.is_complete(), "{turns} turns");
                }
            }
        }
    }
}

/// Rapids are followed, too; a way that turns back is not the same; ends have the limit.
#[test]
fn lines_are_followed() {
    let rapid = |from, to| Move {
        is_feed: false,
        ..line(from, to)
    };
    let (a, b, c) = ([1.0, 0.0, 0.0], [9.0, 0.0, 0.0], [5.0, 0.0, 3.0]);
    for make in [line as fn([f64; 3], [f64; 3]) -> Move, rapid] {
        let found = compared(&[make(a, b)], &[make(a, c), make(c, b)]);
        assert!(!found.is_complete(), "{}", found.in_words());
        let (on, back) = ([6.0, 0.0, 0.0], [3.0, 0.0, 0.0]);
        let found = compared(&[make(a, b)], &[make(a, on), make(on, b)]);
        assert!(found.is_complete());
        let found = compared(&[make(a, b)], &[make(a, on), make(on, back), make(back, b)]);
        assert!(!found.is_complete());
        let beside = [9.0, 0.02, 0.0];
        let found = compared(&[make(a, b)], &[make(a, beside)]);
        assert!(!found.is_complete() && found.missing.is_empty());
        assert!(found.in_words().contains("0.02"), "{}", found.in_words());
    }
}

/// What the machine places has to be placed alike, and what stands before it is seen.
#[test]
fn what_the_machine_places_is_compared() {
    let home = |z: f64| Move {
        is_feed: false,
        away: [false, false, true],
        by_machine: true,
        line: 7,
        ..line([9.0, 0.0, 0.0], [9.0, 0.0, z])
    };
    let cut = line([1.0, 0.0, 0.0], [9.0, 0.0, 0.0]);
    let behind = |from| line(from, [2.0, 2.0, 2.0]);
    let with = |z| vec![cut.clone(), home(z), behind([9.0, 0.0, z])];
    assert!(compared(&with(50.0), &with(50.0)).is_complete());
    let found = compared(&with(50.0), &with(60.0));
    assert_eq!(found.sent_elsewhere, [Some(7); 2]);
    assert!(!found.is_complete());
    let without = [cut.clone(), behind([9.0, 0.0, 0.0])];
    let found = compared(&with(50.0), &without);
    assert_eq!(found.sent_elsewhere, [Some(7), None]);
    let found = compared(&without, &with(50.0));
    assert_eq!(found.sent_elsewhere, [None, Some(7)]);
    // The first motion behind it leads somewhere else first.
    let mut other = with(50.0);
    let aside = [40.0, 40.0, 2.0];
    other.pop();
    other.extend([line([9.0, 0.0, 50.0], aside), behind(aside)]);
    let found = compared(&with(50.0), &other);
    assert_eq!(found.inserted, [1]);
    assert!(!found.is_complete());
}

/// What goes nowhere, exactly or by rounding, takes nothing that comes to the same place later.
#[test]
fn what_stands_is_no_motion() {
    let (a, b) = ([1.0, 0.0, 0.0], [9.0, 0.0, 0.0]);
    let almost = [9.0, 1e-13, 0.0];
    let hardly = [9.0, 3e-4, 0.0];
    let round = [line(b, [4.0, 4.0, 4.0]), line([4.0, 4.0, 4.0], b)];
    let path = |between: &[Move]| [&[line(a, b)], between, &round[..], &round[..]].concat();
    for nominal in [
        vec![],
        vec![line(b, b)],
        vec![line(b, almost)],
        vec![line(b, hardly)],
    ] {
        for written in [vec![], vec![line(b, b)], vec![line(b, hardly)]] {
            let found = compared(&path(&nominal), &path(&written));
            let is_same = nominal.len() == written.len() || written.is_empty();
            if is_same || written[0].stands() {
                assert!(
                    found.is_complete(),
                    "{nominal:?} {written:?}: {}",
                    found.in_words()
                );
            }
        }
    }
}

/// A circle that closes a little nearer to a place than the motion before it is not part of that.
#[test]
fn a_circle_is_a_motion_of_its_own() {
    let begin = [5.0, 0.0, 0.0];
    let circle = arc(begin, [0.0, 0.0], TAU, 0.0);
    let before = |to| line([1.0, 1.0, 1.0], to);
    let behind = line(begin, [7.0, 0.0, 0.0]);
    let nominal = [before(begin), circle.clone(), behind.clone()];
    let written = [before([5.0005, 0.0, 0.0]), circle, behind];
    let found = compared(&nominal, &written);
    assert!(found.is_complete(), "{}", found.in_words());
}
