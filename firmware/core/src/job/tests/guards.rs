//! What one setup alone cannot show, and the guards against it.

use umi_protocol::job::{AgainSpec, Lessons, ProbingSpec};
use umi_protocol::message::{TeachBy, TeachPending, TeachRefusal, TeachSetup, TeachWhat};

use super::*;
use crate::dprnt::{Announced, Moved, Said};

/// As `job`, with room for all of a session's clampings against any of them.
fn job() -> Job {
    let mut job = super::job();
    job.limits.rotation_deg = 6.0;
    job.limits.shift_mm = [120.0, 120.0, 0.2];
    job.limits.expected_error_mm = Some(0.02);
    job
}

/// Features 1, 2 and 3 of a session's clamping, in another order.
fn clamping(number: usize, order: [usize; 3]) -> Vec<Block> {
    let blocks = session_a();
    order
        .map(|sphere| blocks[3 * number + sphere - 1].clone())
        .to_vec()
}

fn whole_session(order: [usize; 3]) -> Vec<Block> {
    (0..5).flat_map(|number| clamping(number, order)).collect()
}

/// Lines with a run number: hits of features by their id.
fn send(run: &mut Run, outcome: &mut Outcome, blocks: &[Block], of_run: u32) {
    for (name, points) in blocks {
        let id = name.strip_prefix("SPHERE").unwrap().parse().unwrap();
        for point in points {
            let mut hit = hit(*point);
            (hit.feature_id, hit.run) = (Some(id), Some(of_run));
            run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
        }
    }
}

/// Probed in another order than the job's, without run numbers: every setup would be made of
/// two clampings, and the first of them would be taught. None is OK.
#[test]
fn another_order_pairs_no_two_clampings() {
    for order in [[2, 3, 1], [3, 1, 2], [3, 2, 1], [2, 1, 3], [1, 3, 2]] {
        let outcome = run_blocks(job(), &whole_session(order));
        assert_eq!(outcome.taught, 0, "{order:?}");
        assert!(outcome.verdicts.iter().all(|v| !v.ok), "{order:?}");
    }
    let outcome = run_blocks(job(), &whole_session([2, 3, 1]));
    assert!(outcome.summary()[1].contains("order_unknown"));
}

/// With run numbers the features come in any order.
#[test]
fn runs_say_what_belongs_together() {
    for order in [[1, 2, 3], [2, 3, 1], [3, 1, 2], [3, 2, 1]] {
        let mut run = Run::new(with_ids(job()));
        let mut outcome = Outcome::default();
        for (number, of_run) in (0..5).zip(7..) {
            send(&mut run, &mut outcome, &clamping(number, order), of_run);
        }
        assert_eq!(outcome.summary(), ["OK"; 5], "{order:?}");
    }
}

/// The control began before the board: what it began with is known to be incomplete. After
/// it has read, what follows begins anew.
#[test]
fn orphans_teach_nothing_until_the_control_reads() {
    let blocks = session_a();
    let mut run = Run::new(job());
    let mut outcome = Outcome::default();
    for (name, points) in &blocks[1..6] {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    assert_eq!(outcome.taught, 0);
    run.control_asks(&mut |d| outcome.take(d));
    for (name, points) in &blocks[6..] {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    let summary = outcome.summary();
    assert!(summary[0].contains("order_unknown") && summary[1].contains("order_unknown"));
    assert_eq!(summary[2..], ["OK"; 3]);
}

/// A READ by one character (DC1) ends it as well. Where the text is late by a whole setup the
/// character still falls between two, so another order is never OK; in a feature's midst
/// it says that the text is late by less, and ends nothing.
#[test]
fn a_plain_read_ends_an_unknown_order() {
    let reads = |run: &mut Run, outcome: &mut Outcome| {
        run.control_reads(&mut |d| outcome.take(d));
    };
    let session = session_a();
    let mut run = Run::new(job());
    let mut outcome = Outcome::default();
    for (name, points) in &session[1..3] {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    run.block_start("SPHERE1", Micros(1), &mut |d| outcome.take(d));
    reads(&mut run, &mut outcome);
    for (name, points) in &session[3..6] {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    assert!(outcome.verdicts.iter().all(|verdict| !verdict.ok));
    reads(&mut run, &mut outcome);
    for (name, points) in &session[6..] {
        feed(&mut run, &mut outcome, name, points, 5);
        reads(&mut run, &mut outcome);
    }
    assert_eq!(outcome.summary()[outcome.verdicts.len() - 3..], ["OK"; 3]);

    // Late by a setup: the character is of a clamping, the text behind it of the one before.
    for (order, is_known) in [([1, 2, 3], true), ([2, 3, 1], false), ([3, 1, 2], false)] {
        let mut run = Run::new(job());
        let mut outcome = Outcome::default();
        for number in 0..5 {
            reads(&mut run, &mut outcome);
            for (name, points) in &clamping(number, order) {
                feed(&mut run, &mut outcome, name, points, 5);
            }
        }
        reads(&mut run, &mut outcome);
        assert_eq!(outcome.verdicts.iter().any(|v| v.ok), is_known, "{order:?}");
        assert!(
            outcome.verdicts.iter().all(|v| v.ok == is_known),
            "{order:?}"
        );
    }
}

/// Nothing is taught by being first: NG until somebody asks, and a setup that was asked for
/// and is refused does not leave its place to the next one.
#[test]
fn teaching_is_an_act() {
    let mut asked = job();
    asked.teach = Teach::Asked;
    let blocks = session_a();
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    let clamp = |run: &mut Run, outcome: &mut Outcome, number: usize, off_mm: f64| {
        for (name, points) in &blocks[3 * number..3 * number + 3] {
            let mut points = points.clone();
            points[0][2] += off_mm;
            feed(run, outcome, name, &points, 5);
        }
    };
    clamp(&mut run, &mut outcome, 0, 0.0);
    assert_eq!(
        run.teach(Micros(1), HOST, TeachWhat::Reference, &mut |d| outcome
            .take(d)),
        Ok(())
    );
    clamp(&mut run, &mut outcome, 1, 0.2);
    clamp(&mut run, &mut outcome, 2, 0.0);
    assert_eq!(outcome.taught, 0);
    assert_eq!(
        run.teach(Micros(1), HOST, TeachWhat::Reference, &mut |d| outcome
            .take(d)),
        Ok(())
    );
    clamp(&mut run, &mut outcome, 3, 0.0);
    clamp(&mut run, &mut outcome, 4, 0.0);
    let summary = outcome.summary();
    assert_eq!(summary[0], "no_reference");
    assert!(summary[1].contains("lone_hit_offset"));
    assert_eq!(summary[2..], ["no_reference", "OK", "OK"]);
    assert_eq!(outcome.taught, 1);
    // Again only if somebody says so; then the old one is none any more.
    let again = run.teach(Micros(1), HOST, TeachWhat::Reference, &mut |d| {
        outcome.take(d)
    });
    assert_eq!(again, Err(TeachRefusal::AlreadyTaught));
    assert_eq!(
        run.teach(Micros(1), HOST, TeachWhat::Again, &mut |d| outcome.take(d)),
        Ok(())
    );
    assert_eq!(run.taught(), None);
    assert_eq!(outcome.taught, 2);
}

const HOST: TeachBy = TeachBy::Host;

/// What was asked for is told until it has happened or lapsed: who asked, when, by which setup.
#[test]
fn what_is_to_be_taught_is_told() {
    let mut asked = with_ids(job());
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    let mut pending = TeachPending {
        by: HOST,
        what: TeachWhat::Reference,
        t_us: 7,
        setup: TeachSetup::Next,
    };
    assert_eq!(run.teach_pending(), None);
    let again = TeachWhat::Again;
    run.teach(Micros(7), HOST, again, &mut |d| outcome.take(d))
        .unwrap();
    assert_eq!(run.teach_pending(), Some(pending));
    // Another run does not take it back: nobody said which one it is for.
    let teaches = clamping(0, [1, 2, 3]);
    send(&mut run, &mut outcome, &teaches[..2], 1);
    pending.setup = TeachSetup::UnderWay { setup: 0 };
    assert_eq!(run.teach_pending(), Some(pending));
    send(&mut run, &mut outcome, &teaches[2..], 1);
    assert_eq!((outcome.taught, run.teach_pending()), (1, None));
    // A setup that is refused: only what was refused may come again.
    run.teach(Micros(9), HOST, again, &mut |d| outcome.take(d))
        .unwrap();
    let mut spoilt = clamping(1, [1, 2, 3]);
    let last = spoilt.last_mut().unwrap();
    last.1[0][2] += 0.2;
    send(&mut run, &mut outcome, &spoilt, 2);
    pending.t_us = 9;
    pending.setup = TeachSetup::Refused { setup: 1 };
    assert_eq!(run.teach_pending(), Some(pending));
    send(&mut run, &mut outcome, &clamping(2, [1, 2, 3]), 3);
    assert_eq!(run.teach_pending(), None);
    assert_eq!(run.taught(), None);
}

/// A line asks for its own run: if nothing else of that comes, the next run teaches nothing.
#[test]
fn a_line_asks_for_its_own_run() {
    let mut asked = with_ids(job());
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    let announced = Announced {
        run: 1,
        said: Said::Teach { again: false },
    };
    run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
    assert_eq!(run.teach_pending().map(|of| of.by), Some(TeachBy::Line));
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 2);
    assert_eq!((outcome.taught, run.teach_pending()), (0, None));
    assert_eq!(outcome.summary(), ["no_reference"]);
}

/// A program in which `T2.` was left would teach each setup, wherever it stands: the second one in
/// a row is refused, and so are those behind it, until a setup is measured without it or a host
/// asks.
#[test]
fn a_line_that_was_left_in_a_program_teaches_once() {
    let mut asked = with_ids(job());
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    let again = |run: &mut Run, outcome: &mut Outcome, of_run: u32| {
        let said = Said::Teach { again: true };
        let announced = Announced { run: of_run, said };
        run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
    };
    for number in 0..3 {
        again(&mut run, &mut outcome, number + 1);
        let blocks = clamping(number as usize, [1, 2, 3]);
        send(&mut run, &mut outcome, &blocks, number + 1);
    }
    assert_eq!(outcome.summary(), ["OK", "taught_twice", "taught_twice"]);
    assert_eq!(outcome.taught, 1);
    send(&mut run, &mut outcome, &clamping(3, [1, 2, 3]), 4);
    again(&mut run, &mut outcome, 5);
    send(&mut run, &mut outcome, &clamping(4, [1, 2, 3]), 5);
    assert_eq!(outcome.summary()[3..], ["OK", "OK"]);
    // What was there is none any more, and then the new one is it.
    assert_eq!(outcome.taught, 3);
    let what = TeachWhat::Again;
    let taken = run.teach(Micros(9), HOST, what, &mut |d| outcome.take(d));
    assert_eq!(taken, Ok(()));
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 6);
    assert_eq!(outcome.summary()[5], "OK");
}

/// A line asks to teach; without "again" it does not replace what there is.
#[test]
fn a_line_teaches() {
    let mut asked = with_ids(job());
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    let asks = |run: &mut Run, outcome: &mut Outcome, of_run: u32, again: bool| {
        let said = Said::Teach { again };
        let announced = Announced { run: of_run, said };
        run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
    };
    asks(&mut run, &mut outcome, 1, false);
    send(&mut run, &mut outcome, &clamping(0, [3, 1, 2]), 1);
    send(&mut run, &mut outcome, &clamping(1, [3, 1, 2]), 2);
    asks(&mut run, &mut outcome, 3, false);
    send(&mut run, &mut outcome, &clamping(2, [3, 1, 2]), 3);
    asks(&mut run, &mut outcome, 4, true);
    send(&mut run, &mut outcome, &clamping(3, [3, 1, 2]), 4);
    send(&mut run, &mut outcome, &clamping(4, [3, 1, 2]), 5);
    assert_eq!(
        outcome.summary(),
        ["OK", "OK", "already_taught", "OK", "OK"]
    );
    assert!(outcome.verdicts[3].registration.is_none());
}

/// What was said of a run is not said of the next one.
#[test]
fn each_run_says_its_own_offset() {
    let mut guarded = with_ids(job());
    guarded.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
        .into_iter()
        .collect();
    guarded.guards.frame = true;
    let mut run = Run::new(guarded);
    let mut outcome = Outcome::default();
    let still = Moved {
        is_rotated: false,
        tool_length_mm: 0.0,
        external: Point::from_mm(0.0, 0.0, 0.0),
    };
    let origin = Point::from_mm(0.0, 0.0, 0.0);
    let unshifted = Said::Shifted {
        offset: 1,
        by: origin,
    };
    for said in [
        Said::Frame { offset: 1, origin },
        Said::Moved(still),
        unshifted,
    ] {
        let announced = Announced { run: 1, said };
        run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
    }
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 1);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 2);
    assert_eq!(outcome.summary(), ["OK", "frame_unknown"]);
}

/// The control reads in the midst of a run: what is missing is told then, and nothing of that run waits for more.
#[test]
fn a_read_ends_an_unfinished_run() {
    let mut run = Run::new(with_ids(job()));
    let mut outcome = Outcome::default();
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 1);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3])[..2], 2);
    assert_eq!(outcome.summary(), ["OK"]);
    run.control_asks(&mut |d| outcome.take(d));
    let summary = outcome.summary();
    assert_eq!(summary.len(), 2, "{summary:?}");
    assert!(!outcome.verdicts[1].ok, "{summary:?}");
}

/// The offset in which a run is probed is held against the job.
#[test]
fn a_moved_offset_is_named() {
    let moved = |is_rotated: bool, x: f64, tool_length_mm: f64| Moved {
        is_rotated,
        tool_length_mm,
        external: Point::from_mm(x, 0.0, 0.0),
    };
    let still = moved(false, 0.5, 81.5);
    let shifted = |offset: u16, x: f64| Said::Shifted {
        offset,
        by: Point::from_mm(x, 0.0, 0.0),
    };
    let frame = |offset: u16, x: f64, moved: Option<Moved>| {
        let mut guarded = with_ids(job());
        guarded.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
            .into_iter()
            .collect();
        guarded.guards.frame = true;
        guarded.guards.external_mm = [0.5, 0.0, 0.0];
        guarded.guards.tool_length_mm = Some(81.5);
        check(&guarded).unwrap();
        let mut run = Run::new(guarded);
        let mut outcome = Outcome::default();
        if offset > 0 {
            let origin = Point::from_mm(x, 0.0, 0.0);
            let said = Said::Frame { offset, origin };
            let announced = Announced { run: 1, said };
            run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
        }
        if let Some(moved) = moved {
            for said in [Said::Moved(moved), shifted(offset, 0.0)] {
                let announced = Announced { run: 1, said };
                run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
            }
        }
        send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 1);
        outcome.summary().remove(0)
    };
    let also = Some(still);
    assert_eq!(frame(1, 0.0, also), "OK");
    assert_eq!(frame(1, 0.0005, also), "OK");
    assert_eq!(frame(1, -0.001, also), "offset_changed no_reference");
    assert_eq!(frame(2, 0.0, also), "other_offset no_reference");
    assert_eq!(frame(0, 0.0, also), "frame_unknown no_reference");
    assert_eq!(frame(1, 0.0, None), "frame_unknown no_reference");
    for (other, named) in [
        (moved(true, 0.5, 81.5), "rotation_active no_reference"),
        (moved(false, 0.502, 81.5), "external_offset no_reference"),
        (moved(false, 0.5, 81.6), "tool_length no_reference"),
    ] {
        assert_eq!(frame(1, 0.0, Some(other)), named);
    }
}

/// A worn stylus scatters within the job's limits, and not within those that were learned.
#[test]
fn a_worn_stylus_is_named() {
    let mut learning = job();
    learning.guards.learned = Some(LearnedLimits {
        radius_mm: 0.003,
        rms_mm: 0.002,
        centring_mm: 0.004,
    });
    let worn = |job: Job, hit: usize, axis: usize, off_mm: f64| {
        let mut blocks = session_a();
        blocks[7].1[hit][axis] += off_mm;
        run_blocks(job, &blocks).summary().remove(2)
    };
    assert_eq!(worn(job(), 1, 0, 0.018), "OK");
    assert_eq!(
        run_blocks(learning.clone(), &session_a()).summary(),
        ["OK"; 5]
    );
    let named = worn(learning.clone(), 1, 0, 0.018);
    assert!(named.contains("SPHERE2:radius_since_taught"), "{named}");
    let named = worn(learning, 3, 0, 0.012);
    assert!(named.contains("SPHERE2:centring_since_taught"), "{named}");
}

/// What one clamping showed is one sample: further ones that are taught widen the limits to the
/// smallest and the largest, and no more. The reference stays; NG widens nothing, and neither
/// does one that is revoked.
#[test]
fn several_teachings_widen_the_limits() {
    let mut learning = job();
    learning.guards.learned = Some(LearnedLimits {
        radius_mm: 0.003,
        rms_mm: 0.002,
        centring_mm: 0.004,
    });
    // What is learned is all that is at stake.
    (
        learning.limits.distance_error_mm,
        learning.limits.registration_rms_mm,
    ) = (0.05, 0.05);
    let blocks = session_a();
    // The first side hit of the second ball is off: its radius is larger by about a third.
    let clamp = |run: &mut Run, outcome: &mut Outcome, number: usize, off_mm: f64, ng: bool| {
        for (name, points) in &blocks[3 * number..3 * number + 3] {
            let mut points = points.clone();
            if name == "SPHERE2" {
                points[1][0] += off_mm;
            }
            if ng {
                points[0][2] += 0.2;
            }
            feed(run, outcome, name, &points, 5);
        }
    };
    let more = |run: &mut Run, outcome: &mut Outcome| {
        run.teach(Micros(1), HOST, TeachWhat::More, &mut |d| outcome.take(d))
    };
    let start = || (Run::new(learning.clone()), Outcome::default());
    let (mut run, mut outcome) = start();
    assert_eq!(more(&mut run, &mut outcome), Err(TeachRefusal::NotTaught));
    clamp(&mut run, &mut outcome, 0, 0.0, false);
    let first = run.taught().unwrap().learned.clone();
    let places = run.taught().unwrap().places.to_vec();
    assert_eq!((first.further, first.largest.len()), (0, 0));
    clamp(&mut run, &mut outcome, 1, 0.018, false);
    // Taught more: it is OK, corrects by the same reference, and says so.
    assert_eq!(more(&mut run, &mut outcome), Ok(()));
    clamp(&mut run, &mut outcome, 2, 0.018, false);
    let taught = run.taught().unwrap().learned.clone();
    assert_eq!(run.taught().unwrap().places, places);
    let verdict = outcome.verdicts.last().unwrap();
    assert!(verdict.registration.is_some());
    assert!(
        verdict
            .remarks
            .iter()
            .any(|r| r.reason == Reason::TaughtMore { further: 1 })
    );
    // Of each ball the smallest and the largest of the two.
    for (place, one) in first.smallest.iter().enumerate() {
        let (low, high) = taught.of(place).unwrap();
        assert!(low.radius_mm <= one.radius_mm && one.radius_mm <= high.radius_mm);
        assert!(low.rms_mm <= one.rms_mm && one.rms_mm <= high.rms_mm);
        assert!(low.centring_mm <= one.centring_mm && one.centring_mm <= high.centring_mm);
    }
    let (low, high) = taught.of(1).unwrap();
    let span_mm = high.radius_mm - low.radius_mm;
    assert!((0.003..0.012).contains(&span_mm), "{span_mm}");
    // What is as large is OK now; what is larger still by more than the limit is not.
    clamp(&mut run, &mut outcome, 3, 0.018, false);
    clamp(&mut run, &mut outcome, 4, 0.036, false);
    let summary = outcome.summary();
    assert_eq!(summary[0], "OK");
    assert!(
        summary[1].contains("SPHERE2:radius_since_taught"),
        "{summary:?}"
    );
    assert_eq!(summary[2..4], ["OK", "OK"]);
    assert!(
        summary[4].contains("SPHERE2:radius_since_taught"),
        "{summary:?}"
    );
    // An NG clamping widens nothing, and asks no further.
    assert_eq!(more(&mut run, &mut outcome), Ok(()));
    clamp(&mut run, &mut outcome, 3, 0.0, true);
    assert_eq!(*run.taught().unwrap().learned, taught);
    clamp(&mut run, &mut outcome, 1, 0.036, false);
    assert_eq!(*run.taught().unwrap().learned, taught);
    // One that is NG after all has widened nothing.
    assert_eq!(more(&mut run, &mut outcome), Ok(()));
    clamp(&mut run, &mut outcome, 2, 0.020, false);
    assert_eq!(run.taught().unwrap().learned.further, 2);
    let count = FaultKind::BlockCountMismatch {
        expected: 6,
        got: 5,
    };
    run.fault(&count, &mut |d| outcome.take(d));
    assert!(!outcome.verdicts.last().unwrap().ok);
    assert_eq!(*run.taught().unwrap().learned, taught);
    // What was kept over a restart is what holds.
    let (mut restarted, mut after) = start();
    restarted.restore_reference(Teaching {
        places: &places,
        learned: &taught,
    });
    clamp(&mut restarted, &mut after, 2, 0.018, false);
    clamp(&mut restarted, &mut after, 3, 0.036, false);
    assert_eq!(after.summary()[0], "OK");
    assert!(after.summary()[1].contains("radius_since_taught"));
    // A job that holds nothing against what was learned has nothing to widen.
    let mut run = Run::new(job());
    assert_eq!(more(&mut run, &mut outcome), Err(TeachRefusal::NoLearned));
}

/// The first ball probed again at the end, and a ball that stays on the table.
fn redundant() -> Job {
    let mut job = with_ids(job());
    for (id, name) in [(4, "CLOSING"), (5, "TABLE")] {
        let mut feature = job.features[0].clone();
        (feature.id, feature.name) = (Some(id), name.try_into().unwrap());
        let _ = job.features.push(feature);
    }
    job.guards.closing = [Closing {
        feature: "CLOSING".try_into().unwrap(),
        repeats: "SPHERE1".try_into().unwrap(),
        within_mm: 0.004,
    }]
    .into_iter()
    .collect();
    job.guards.fixed = ["TABLE".try_into().unwrap()].into_iter().collect();
    job.guards.fixed_mm = Some(0.005);
    job
}

/// A first touch of a top that came early, with the sides driven by it, shows where the top is
/// touched once more; a second one beside the first is refused, and the two may be the same to
/// the last digit.
#[test]
fn the_top_once_more() {
    let session = |early_mm: f64, beside_mm: f64| {
        let mut job = job();
        job.again = Some(AgainSpec { within_mm: 0.006 });
        for feature in &mut job.features {
            feature.hits = 6;
            let _ = feature.approach.push(Approach::MinusZ);
        }
        check(&job).unwrap();
        let mut run = Run::new(job);
        let mut outcome = Outcome::default();
        for number in 0..2 {
            for (name, points) in &mut clamping(number, [1, 2, 3]) {
                let [x, y, z] = points[0];
                points.push([x + beside_mm, y, z]);
                if number == 1 && name == "SPHERE2" {
                    points.iter_mut().take(5).for_each(|p| p[2] += early_mm);
                }
                feed(&mut run, &mut outcome, name, points, 6);
            }
        }
        let reasons = outcome.verdicts.last().map(|v| v.reasons.clone());
        (outcome.summary(), reasons.unwrap())
    };
    assert_eq!(session(0.0, 0.0).0, ["OK"; 2]);
    assert_eq!(session(0.005, 0.0).0, ["OK"; 2]);
    let (summary, reasons) = session(0.010, 0.0);
    assert_eq!(summary, ["OK", "SPHERE2:not_repeated"]);
    let Reason::NotRepeated {
        hit, first, off_mm, ..
    } = reasons[0].reason
    else {
        panic!("{reasons:?}");
    };
    assert_eq!((hit, first), (6, 1));
    assert!((off_mm + 0.010).abs() < 1e-9, "{off_mm}");
    let (summary, _) = session(0.0, 0.2);
    assert!(summary[0].contains("SPHERE1:not_same_place"), "{summary:?}");
}

/// Blocks behind lines that announce their run: each clamping belongs to its own, and one that
/// nobody announced belongs to none, whatever was announced before it.
#[test]
fn blocks_belong_to_the_run_before_them() {
    let mut job = job();
    let checked = LinePattern::Checked(CheckedPattern::default());
    let _ = job.receiver.patterns.push(checked);
    (job.guards.run_variable, job.guards.frame) = (Some(531), true);
    check(&job).unwrap();
    let mut without = job.clone();
    without.receiver.patterns.remove(1);
    assert!(check(&without).is_err(), "nothing says a run");
    let mut run = Run::new(job);
    let mut outcome = Outcome::default();
    let blocks = |run: &mut Run, outcome: &mut Outcome, number: usize, order: [usize; 3]| {
        for (name, points) in clamping(number, order) {
            feed(run, outcome, &name, &points, 5);
        }
    };
    let announce = |run: &mut Run, outcome: &mut Outcome, of_run: u32| {
        let moved = Moved {
            is_rotated: false,
            tool_length_mm: 0.0,
            external: Point::from_mm(0.0, 0.0, 0.0),
        };
        let frame = Said::Frame {
            offset: 1,
            origin: Point::from_mm(0.0, 0.0, 0.0),
        };
        let unshifted = Said::Shifted {
            offset: 1,
            by: Point::from_mm(0.0, 0.0, 0.0),
        };
        for said in [frame, Said::Moved(moved), unshifted] {
            let announced = Announced { run: of_run, said };
            run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
        }
    };
    announce(&mut run, &mut outcome, 7);
    blocks(&mut run, &mut outcome, 0, [1, 2, 3]);
    announce(&mut run, &mut outcome, 8);
    // In any order: the run says what belongs together.
    blocks(&mut run, &mut outcome, 1, [2, 3, 1]);
    blocks(&mut run, &mut outcome, 2, [1, 2, 3]);
    // The last ball of one run is lost, the lines of the next with it.
    announce(&mut run, &mut outcome, 9);
    blocks(&mut run, &mut outcome, 3, [1, 2, 2]);
    blocks(&mut run, &mut outcome, 4, [1, 2, 3]);
    let summary = outcome.summary();
    assert_eq!(summary[..2], ["OK", "OK"], "{summary:?}");
    assert_eq!(summary[2], "frame_unknown run_unknown", "{summary:?}");
    assert!(summary[3..].iter().all(|of| of != "OK"), "{summary:?}");
    let text = |at: usize| {
        outcome.verdicts[at]
            .correction
            .as_ref()
            .unwrap()
            .text
            .clone()
    };
    assert!(text(1).contains("531EQ8"), "{}", text(1));
}

/// A part that slips between the first ball and the last shows in the closing one; a stylus
/// that was bent since teaching shows in the ball on the table.
#[test]
fn closing_and_fixed_balls() {
    let session = |slip_mm: f64, bent_mm: f64| {
        check(&redundant()).unwrap();
        let mut run = Run::new(redundant());
        let mut outcome = Outcome::default();
        for number in 0..3 {
            let mut blocks = clamping(number, [1, 2, 3]);
            let mut again = blocks[0].clone();
            again.0 = "CLOSING".to_string();
            again
                .1
                .iter_mut()
                .for_each(|p| p[0] += if number == 2 { slip_mm } else { 0.0 });
            blocks.push(again);
            let first = session_a().remove(0).1;
            let table = first.iter().map(|p| [p[0] + 300.0, p[1], p[2]]).collect();
            blocks.push(("TABLE".to_string(), table));
            for (id, (name, points)) in (1u16..).zip(&mut blocks) {
                let bent = if number == 2 { bent_mm } else { 0.0 };
                points.iter_mut().for_each(|p| p[1] += bent);
                let _ = name;
                for point in points {
                    let mut hit = hit(*point);
                    (hit.feature_id, hit.run) = (Some(id), Some(number as u32));
                    run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
                }
            }
        }
        outcome.summary()
    };
    assert_eq!(session(0.0, 0.0), ["OK"; 3]);
    assert_eq!(session(0.006, 0.0), ["OK", "OK", "CLOSING:not_closed"]);
    assert_eq!(session(0.0, -0.007), ["OK", "OK", "TABLE:fixed_moved"]);
}

/// A plate at 5 K more is registered as if it were not; at 8 K it is refused by name.
#[test]
fn warmth_is_told() {
    let mut warm = job();
    warm.guards.warmth = Some(WarmthSpec {
        expansion_ppm_per_k: 11.5,
        at_most_k: 6.0,
    });
    warm.guards.probing = Some(ProbingSpec {
        sigma_mm: 0.001,
        dof: 19,
    });
    let clamped = |job: Job, kelvin: f64| {
        let mut blocks = session_a();
        let scale = 1.0 + 11.5e-6 * kelvin;
        // Each ball moves as a whole: about the plate's middle.
        let middle = [-45.0, -45.0, 127.0];
        for (_, points) in &mut blocks[3..6] {
            let mut center = [0.0; 3];
            for axis in 0..3 {
                let mean = points[1..].iter().map(|p| p[axis]).sum::<f64>() / 4.0;
                center[axis] = (mean - middle[axis]) * (scale - 1.0);
            }
            points.iter_mut().for_each(|p| {
                (0..3).for_each(|axis| p[axis] += center[axis]);
            });
        }
        run_blocks(job, &blocks[..6])
    };
    let cold = clamped(warm.clone(), 0.0).verdicts.remove(1);
    let at_5 = clamped(warm.clone(), 5.0).verdicts.remove(1);
    assert!(clamped(job(), 5.0).summary()[1].contains("distance_error"));
    assert!(cold.ok && at_5.ok, "{:?}", at_5.reasons);
    let kelvin = |verdict: &Verdict| {
        let of = |r: &umi_protocol::verdict::SetupReason| match r.reason {
            Reason::Warmer { kelvin, sigma_k } => Some((kelvin, sigma_k)),
            _ => None,
        };
        verdict.remarks.iter().find_map(of).unwrap()
    };
    assert!((kelvin(&at_5).0 - kelvin(&cold).0 - 5.0).abs() < 0.01);
    assert!((0.2..6.0).contains(&kelvin(&at_5).1), "{:?}", kelvin(&at_5));
    let angle = |v: &Verdict| v.registration.as_ref().unwrap().angle_deg;
    assert!((angle(&at_5) - angle(&cold)).abs() < 1e-6);
    // The part's middle lies 5 K farther from the balls' one, where the plate has grown to.
    let part = job().correction.unwrap();
    let middle_z_mm = (part.part_min_mm[2] + part.part_max_mm[2]) / 2.0;
    let image = |verdict: &Verdict| {
        let fit = verdict.registration.as_ref().unwrap();
        let part = [0.0, 0.0, middle_z_mm];
        [0, 1, 2].map(|row: usize| {
            let turned: f64 = (0..3).map(|i| fit.rotation[row][i] * part[i]).sum();
            turned + fit.translation_mm[row]
        })
    };
    let (at_5_mm, cold_mm) = (image(&at_5), image(&cold));
    for (axis, arm) in [45.0, 45.0, middle_z_mm - 127.0].into_iter().enumerate() {
        let grown = at_5_mm[axis] - cold_mm[axis];
        // The plate is turned by 1 degree.
        assert!(
            (grown - arm * 5.0 * 11.5e-6).abs() < 1e-4,
            "{axis}: {grown}"
        );
    }
    let stated = |verdict: &Verdict| {
        let of = |r: &umi_protocol::verdict::SetupReason| match r.reason {
            Reason::Error95 { error_mm } => Some(error_mm),
            _ => None,
        };
        verdict.remarks.iter().find_map(of).unwrap()
    };
    assert!((0.001..0.05).contains(&stated(&cold)), "{}", stated(&cold));
    assert!(clamped(warm.clone(), 8.0).summary()[1].contains("too_warm"));
    // What a rigid correction leaves of the part's growth is told, and stands in what is stated.
    let left = |verdict: &Verdict| {
        let of = |r: &umi_protocol::verdict::SetupReason| match r.reason {
            Reason::GrowthLeft { grown_mm } => Some(grown_mm),
            _ => None,
        };
        verdict.remarks.iter().find_map(of).unwrap()
    };
    let half = libm::sqrt(26.0 * 26.0 + 36.0 * 36.0 + 13.0 * 13.0);
    let expected = half * (kelvin(&at_5).0 * 11.5e-6);
    assert!((left(&at_5) - expected).abs() < 1e-9, "{}", left(&at_5));
    assert!(stated(&at_5) > stated(&cold));
    // A part of 300 mm grows by more than may be left.
    let mut large = warm;
    let spec = large.correction.as_mut().unwrap();
    (spec.part_min_mm, spec.part_max_mm) = ([-150.0; 3], [150.0, 150.0, 0.0]);
    spec.leftover_mm = 0.010;
    large.limits.expected_error_mm = None;
    let summary = clamped(large.clone(), 5.0).summary();
    assert!(summary[1].contains("part_grown"), "{summary:?}");
    assert!(!clamped(large, 0.0).summary()[1].contains("part_grown"));
}

/// What nothing in a job guards against stands in each of its verdicts, also where only programs
/// are rewritten by them; a job without a registration has nothing to guard.
#[test]
fn what_is_not_guarded_is_told() {
    let open = |job: Job| {
        let verdicts = run_blocks(job, &session_a()[..6]).verdicts;
        let told = verdicts.iter().map(|verdict| {
            let of = |r: &umi_protocol::verdict::SetupReason| match r.reason {
                Reason::NotGuarded {
                    late_text,
                    moved_offset,
                    while_probed,
                    first_ok,
                } => Some([late_text, moved_offset, while_probed, first_ok]),
                _ => None,
            };
            verdict.remarks.iter().find_map(of)
        });
        told.collect::<Vec<_>>()
    };
    assert_eq!(open(job()), [Some([true, true, true, true]); 2]);
    let mut given = with_ids(job());
    given.teach = Teach::Asked;
    given.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
        .into_iter()
        .collect();
    given.guards.run_variable = Some(531);
    assert_eq!(open(given.clone()), [Some([false, true, false, false]); 2]);
    given.guards.frame = true;
    assert_eq!(open(given.clone()), [None; 2]);
    // Blocks behind the lines of O8811: nothing says that their macros look again.
    let block = job().receiver.patterns[0].clone();
    let _ = given.receiver.patterns.push(block);
    assert_eq!(open(given), [Some([false, false, true, false]); 2]);
    let mut only = job();
    only.correction = None;
    assert_eq!(open(only.clone()), [Some([true, true, true, true]); 2]);
    for feature in only.features.iter_mut().skip(2) {
        feature.datum = false;
    }
    assert_eq!(open(only), [None; 2]);
}

/// A program that belongs to a run stops in any other, before it sets anything.
#[test]
fn a_correction_belongs_to_one_run() {
    let mut guarded = with_ids(job());
    guarded.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
        .into_iter()
        .collect();
    guarded.guards.run_variable = Some(531);
    check(&guarded).unwrap();
    let mut run = Run::new(guarded.clone());
    let mut outcome = Outcome::default();
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 16);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 17);
    let text = &outcome.verdicts[1].correction.as_ref().unwrap().text;
    let alarm = text.find("IF[#531EQ17]GOTO7\n#3000=2(UMI CORRECTION OF RUN 17)\nN7\n");
    assert!(alarm.unwrap() < text.find("G10").unwrap(), "{text}");
    let spec = guarded.correction.as_mut().unwrap();
    spec.dialect = Dialect::Grbl;
    assert!(matches!(check(&guarded), Err(JobError::BadValue { .. })));
}

/// Coordinates that no offset explains are refused by name, whenever the run says so, and a run
/// that says nothing of it too.
#[test]
fn coordinates_that_no_offset_explains_are_named() {
    let mut guarded = with_ids(job());
    guarded.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
        .into_iter()
        .collect();
    guarded.guards.frame = true;
    let at = |x: f64, z: f64| Point::from_mm(x, 0.0, z);
    let looks = |before: &[(u16, Point)], between: &[(u16, Point)]| {
        let mut run = Run::new(guarded.clone());
        let mut outcome = Outcome::default();
        let say = |run: &mut Run, outcome: &mut Outcome, said: Said| {
            let announced = Announced { run: 1, said };
            run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
        };
        let origin = at(0.0, 0.0);
        say(&mut run, &mut outcome, Said::Frame { offset: 1, origin });
        let moved = Moved {
            is_rotated: false,
            tool_length_mm: 0.0,
            external: origin,
        };
        say(&mut run, &mut outcome, Said::Moved(moved));
        for &(offset, by) in before {
            say(&mut run, &mut outcome, Said::Shifted { offset, by });
        }
        let setup = clamping(0, [1, 2, 3]);
        send(&mut run, &mut outcome, &setup[..1], 1);
        for &(offset, by) in between {
            say(&mut run, &mut outcome, Said::Shifted { offset, by });
        }
        send(&mut run, &mut outcome, &setup[1..], 1);
        outcome.summary().remove(0)
    };
    let still = (1, at(0.0, 0.0));
    assert_eq!(looks(&[still], &[]), "OK");
    assert_eq!(looks(&[still], &[still]), "OK");
    // What four rounded numbers can make of nothing.
    assert_eq!(looks(&[(1, at(0.002, -0.002))], &[]), "OK");
    assert_eq!(looks(&[], &[]), "shift_unknown no_reference");
    for by in [at(0.003, 0.0), at(0.0, -0.003), at(40.0, 0.0)] {
        assert_eq!(looks(&[(1, by)], &[]), "shifted no_reference");
        assert_eq!(looks(&[still], &[(1, by)]), "shifted no_reference");
        // What was shifted once was, whatever it is now.
        assert_eq!(looks(&[(1, by), still], &[]), "shifted no_reference");
    }
    let other = (2, at(0.0, 0.0));
    assert_eq!(looks(&[still], &[other]), "other_offset no_reference");
}

/// The macros' count goes on with 1 behind 99 999: the runs after it are new, those from before
/// it old, and a count that was lost says what to do.
#[test]
fn the_count_of_runs_goes_on_behind_its_end() {
    let mut numbered = with_ids(job());
    numbered.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
        .into_iter()
        .collect();
    let mut run = Run::new(numbered.clone());
    let mut outcome = Outcome::default();
    let numbers = [99_998, 99_999, 1, 99_999, 2, 1, 50_002, 49_999, 99_999];
    for (case, number) in (0..).zip(numbers) {
        let setup = clamping(case % 5, [1, 2, 3]);
        send(&mut run, &mut outcome, &setup, number);
    }
    let summary = outcome.summary();
    let wanted = [
        "OK", "OK", "OK", "old_run", "OK", "old_run", "old_run", "OK", "old_run",
    ];
    assert_eq!(summary, wanted);
    let mut lost = Run::new(numbered);
    lost.restore_last_run(500);
    let mut outcome = Outcome::default();
    for (case, number) in [(0, 1), (1, 501)] {
        send(&mut lost, &mut outcome, &clamping(case, [1, 2, 3]), number);
    }
    assert_eq!(outcome.summary(), ["old_run no_reference", "OK"]);
    let said = outcome.verdicts[0].reasons[0].to_string();
    assert!(said.contains("set its run variable to 500"), "{said}");
}

/// A run that is not after the last one that was judged is old: also after a restart, and whatever
/// its lines say. The count begins anew with the job.
#[test]
fn a_run_that_is_not_after_the_last_is_old() {
    let mut numbered = with_ids(job());
    numbered.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
        .into_iter()
        .collect();
    let mut run = Run::new(numbered.clone());
    let mut outcome = Outcome::default();
    for (case, number) in [(0, 16), (1, 17), (2, 17), (3, 16), (4, 17), (2, 18)] {
        send(&mut run, &mut outcome, &clamping(case, [1, 2, 3]), number);
    }
    let summary = outcome.summary();
    assert_eq!(summary, ["OK", "OK", "OK", "old_run", "old_run", "OK"]);
    assert_eq!(run.last_run(), Some(18));

    let mut again = Run::new(numbered.clone());
    again.restore_last_run(18);
    let mut outcome = Outcome::default();
    for (case, number) in [(0, 18), (1, 3), (2, 19), (3, 20)] {
        send(&mut again, &mut outcome, &clamping(case, [1, 2, 3]), number);
    }
    // An old run teaches nothing.
    assert_eq!(
        outcome.summary(),
        ["old_run no_reference", "old_run no_reference", "OK", "OK"]
    );
    again.begin(numbered);
    let mut outcome = Outcome::default();
    send(&mut again, &mut outcome, &clamping(0, [1, 2, 3]), 1);
    assert_eq!(outcome.summary(), ["OK"]);
}

/// The closing ball and the one that it repeats enclose all others in the order in which they
/// were probed, whatever that is: a slip elsewhere moves neither against the other. Without runs
/// the order is the job's, and a job that encloses nothing is refused.
#[test]
fn a_ball_outside_the_closing_pair_is_named() {
    const PAIR: [usize; 2] = [1, 4];
    let session = |order: [usize; 5], slips_at: usize| {
        let mut run = Run::new(redundant());
        let mut outcome = Outcome::default();
        for number in 0..2 {
            let mut blocks = clamping(number, [1, 2, 3]);
            blocks.push(blocks[0].clone());
            let first = session_a().remove(0).1;
            let table = first.iter().map(|p| [p[0] + 300.0, p[1], p[2]]).collect();
            blocks.push(("TABLE".to_string(), table));
            for (turn, id) in order.into_iter().enumerate() {
                let slip = if number == 1 && turn >= slips_at {
                    0.05
                } else {
                    0.0
                };
                for point in &blocks[id - 1].1 {
                    let on_table = id == 5;
                    let mut hit = hit([
                        point[0] + if on_table { 0.0 } else { slip },
                        point[1],
                        point[2],
                    ]);
                    (hit.feature_id, hit.run) =
                        (Some(u16::try_from(id).unwrap()), Some(number as u32));
                    run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
                }
            }
        }
        outcome.summary()
    };
    let mut orders = vec![vec![]];
    for id in 1..=5 {
        orders = orders
            .into_iter()
            .flat_map(|order: Vec<usize>| {
                (0..=order.len()).map(move |at| {
                    let mut longer = order.clone();
                    longer.insert(at, id);
                    longer
                })
            })
            .collect();
    }
    assert_eq!(orders.len(), 120);
    for order in orders {
        let turn = |id: usize| order.iter().position(|of| *of == id).unwrap();
        let encloses = [2, 3]
            .iter()
            .all(|id| (turn(PAIR[0])..turn(PAIR[1])).contains(&turn(*id)));
        let array: [usize; 5] = order.clone().try_into().unwrap();
        let summary = session(array, 5);
        if encloses {
            assert_eq!(summary, ["OK"; 2], "{order:?}");
        } else {
            assert!(
                summary.iter().all(|of| of.contains("CLOSING:not_enclosed")),
                "{order:?}"
            );
        }
        for slips_at in 1..5 {
            // Behind the closing ball nothing is left to move.
            let ends = [1, 2, 3, 4].map(turn).into_iter().max().unwrap();
            let begins = [1, 2, 3, 4].map(turn).into_iter().min().unwrap();
            if slips_at <= ends && slips_at > begins {
                assert_ne!(session(array, slips_at)[1], "OK", "{order:?} {slips_at}");
            }
        }
    }
    let mut blocks = redundant();
    blocks.receiver.patterns = job().receiver.patterns;
    check(&blocks).unwrap();
    blocks.features.swap(2, 3);
    assert!(
        matches!(check(&blocks), Err(JobError::BadValue { field, .. }) if field == umi_protocol::job_error::Field::Closing)
    );
}

/// The tool length in force is that of the taught run, unless the job says which; where neither
/// is known each verdict says so.
#[test]
fn another_tool_length_than_taught_is_named() {
    let mut guarded = with_ids(job());
    guarded.receiver.patterns = [LinePattern::Checked(CheckedPattern::default())]
        .into_iter()
        .collect();
    guarded.guards.frame = true;
    let say = |run: &mut Run, outcome: &mut Outcome, of_run: u32, tool_length_mm: f64| {
        let origin = Point::from_mm(0.0, 0.0, 0.0);
        let moved = Moved {
            is_rotated: false,
            tool_length_mm,
            external: origin,
        };
        let by = origin;
        for said in [
            Said::Frame { offset: 1, origin },
            Said::Moved(moved),
            Said::Shifted { offset: 1, by },
        ] {
            let announced = Announced { run: of_run, said };
            run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
        }
    };
    let mut run = Run::new(guarded.clone());
    let mut outcome = Outcome::default();
    for (number, length_mm) in (0..).zip([81.5, 81.501, 81.503, 0.0]) {
        say(&mut run, &mut outcome, number + 1, length_mm);
        let setup = clamping(number as usize, [1, 2, 3]);
        send(&mut run, &mut outcome, &setup, number + 1);
    }
    let since = "tool_length_since_taught";
    assert_eq!(outcome.summary(), ["OK", "OK", since, since]);
    let open = |verdict: &Verdict| {
        let is = |of: &umi_protocol::verdict::SetupReason| of.reason == Reason::LengthNotGuarded;
        verdict.remarks.iter().any(is)
    };
    assert!(!outcome.verdicts.iter().any(open));
    // Put back after a restart; also as an earlier firmware kept it.
    let taught = run.taught().unwrap();
    assert_eq!(taught.learned.tool_length_mm, Some(81.5));
    for (learned, named, is_open) in [
        (taught.learned.clone(), since, false),
        (
            Lessons {
                tool_length_mm: None,
                ..taught.learned.clone()
            },
            "OK",
            true,
        ),
    ] {
        let mut again = Run::new(guarded.clone());
        let mut outcome = Outcome::default();
        let places = taught.places;
        again.restore_reference(Teaching {
            places,
            learned: &learned,
        });
        say(&mut again, &mut outcome, 9, 80.0);
        send(&mut again, &mut outcome, &clamping(1, [1, 2, 3]), 9);
        assert_eq!(outcome.summary(), [named]);
        assert_eq!(open(&outcome.verdicts[0]), is_open);
    }
}

/// A line that asks to teach and comes late, of a run that was judged before, forgets nothing.
#[test]
fn a_late_line_does_not_forget_the_reference() {
    let mut asked = with_ids(job());
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    let asks = |run: &mut Run, outcome: &mut Outcome, of_run: u32, again: bool| {
        let said = Said::Teach { again };
        let announced = Announced { run: of_run, said };
        run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
    };
    asks(&mut run, &mut outcome, 5, true);
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 5);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 6);
    let before: Vec<Point> = run.taught().unwrap().places.to_vec();
    for old in [5, 4, 6] {
        asks(&mut run, &mut outcome, old, true);
        assert_eq!(
            run.taught().map(|of| of.places.to_vec()),
            Some(before.clone()),
            "{old}"
        );
        assert_eq!(run.teach_pending(), None);
    }
    asks(&mut run, &mut outcome, 5, true);
    send(&mut run, &mut outcome, &clamping(2, [1, 2, 3]), 5);
    send(&mut run, &mut outcome, &clamping(3, [1, 2, 3]), 7);
    assert_eq!(outcome.summary(), ["OK", "OK", "old_run", "OK"]);
    // One that is new does, as it says.
    asks(&mut run, &mut outcome, 8, true);
    assert_eq!(run.taught(), None);
}

/// A run's number that is used again behind its verdict: its lines are dropped, and one verdict
/// says so; the run behind it is judged as ever, and the reference stays.
#[test]
fn a_number_that_is_used_again_is_told() {
    let mut run = Run::new(with_ids(job()));
    let mut outcome = Outcome::default();
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 1);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 2);
    for sequence in 1..20 {
        let again = FaultKind::ConflictingRepeat {
            run: 2,
            sequence,
            compared: true,
        };
        run.fault(&again, &mut |d| outcome.take(d));
    }
    assert_eq!(outcome.summary(), ["OK", "OK", "conflicting_repeat"]);
    send(&mut run, &mut outcome, &clamping(2, [1, 2, 3]), 3);
    assert_eq!(outcome.summary()[3], "OK");
    assert_eq!(outcome.taught, 1);
    // Of another run than the one judged it concerns what comes next.
    let old = FaultKind::ConflictingRepeat {
        run: 2,
        sequence: 1,
        compared: true,
    };
    run.fault(&old, &mut |d| outcome.take(d));
    assert_eq!(outcome.verdicts.len(), 4);
}

/// What a control rounds to steps of 20 or 50 µm is refused, also what is to be taught; 10 µm
/// are not, nor is what is whole by chance.
#[test]
fn coarse_steps_are_refused() {
    let session = |step_mm: f64, beside_mm: f64| {
        let mut job = with_ids(job());
        job.limits.rms_mm = 1.0;
        let mut run = Run::new(job);
        let mut outcome = Outcome::default();
        for number in 0..2 {
            let mut blocks = clamping(number, [1, 2, 3]);
            for point in blocks.iter_mut().flat_map(|(_, points)| points) {
                *point = point.map(|mm| (mm / step_mm).round() * step_mm + beside_mm);
            }
            send(&mut run, &mut outcome, &blocks, number as u32 + 1);
        }
        outcome.summary()
    };
    for step_mm in [0.02, 0.05] {
        for of in session(step_mm, 0.0) {
            assert!(of.contains("coarse_step"), "{step_mm}: {of}");
        }
    }
    for (step_mm, beside_mm) in [(0.01, 0.0), (0.005, 0.0), (0.02, 0.001)] {
        for of in session(step_mm, beside_mm) {
            assert!(!of.contains("coarse_step"), "{step_mm}: {of}");
        }
    }
    // A ball of whole millimetres.
    let mut run = Run::new(with_ids(job()));
    let mut outcome = Outcome::default();
    let mut blocks = clamping(0, [1, 2, 3]);
    for (place, (_, points)) in (0..).zip(&mut blocks) {
        let (x, y) = (100.0 * f64::from(place % 2), 100.0 * f64::from(place / 2));
        let sides = [
            [0.0, 0.0, 1.0],
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
        ];
        *points = sides
            .map(|[a, b, c]| [x + 12.7 * a, y + 12.7 * b, 100.0 + 12.7 * c])
            .to_vec();
    }
    send(&mut run, &mut outcome, &blocks, 1);
    assert!(
        !outcome.summary()[0].contains("coarse"),
        "{:?}",
        outcome.summary()
    );
}

/// Of several closing balls each comes behind all others: one that a ball follows shows nothing
/// of what moves then.
#[test]
fn each_closing_ball_comes_last() {
    let mut job = redundant();
    let mut second = job.features[3].clone();
    (second.id, second.name) = (Some(6), "CLOSING3".try_into().unwrap());
    let _ = job.features.push(second);
    let _ = job.guards.closing.push(Closing {
        feature: "CLOSING3".try_into().unwrap(),
        repeats: "SPHERE3".try_into().unwrap(),
        within_mm: 0.004,
    });
    check(&job).unwrap();
    let session = |order: [usize; 6], turned: bool| {
        let mut run = Run::new(job.clone());
        let mut outcome = Outcome::default();
        for number in 0..2 {
            let mut blocks = clamping(number, [1, 2, 3]);
            blocks.push(blocks[0].clone());
            let first = session_a().remove(0).1;
            let table = first.iter().map(|p| [p[0] + 300.0, p[1], p[2]]).collect();
            blocks.push(("TABLE".to_string(), table));
            let mut again = blocks[2].clone();
            // About ball 1, when all have been probed once.
            let by_mm = if turned && number == 1 { 0.05 } else { 0.0 };
            again.1.iter_mut().for_each(|point| point[0] += by_mm);
            blocks.push(again);
            for id in order {
                for point in &blocks[id - 1].1 {
                    let mut hit = hit(*point);
                    (hit.feature_id, hit.run) =
                        (Some(u16::try_from(id).unwrap()), Some(number as u32));
                    run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
                }
            }
        }
        outcome.summary()
    };
    assert_eq!(session([1, 2, 3, 4, 6, 5], false), ["OK"; 2]);
    assert_eq!(session([1, 3, 2, 6, 5, 4], false), ["OK"; 2]);
    // The first one that is probed twice need not be the first in the job.
    assert_eq!(session([3, 1, 2, 4, 6, 5], false), ["OK"; 2]);
    let turned = session([1, 2, 3, 4, 6, 5], true);
    assert_eq!(turned, ["OK", "CLOSING3:not_closed"]);
    for order in [[1, 3, 6, 2, 4, 5], [1, 2, 4, 3, 6, 5], [2, 1, 3, 4, 6, 5]] {
        let summary = session(order, false);
        assert!(
            summary.iter().all(|of| of.contains("not_enclosed")),
            "{order:?} {summary:?}"
        );
    }
    // Blocks come in the job's order, which must be one of these.
    let mut blocks = job.clone();
    blocks.receiver.patterns = super::job().receiver.patterns;
    check(&blocks).unwrap();
    blocks.features.swap(1, 5);
    assert!(check(&blocks).is_err());
}
