//! Who teaches, what, and by which setup.

use super::*;

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

/// A line that teaches behind a setup that a line has taught: the one before may be an old text that
/// came late, or the line was left in the program. Neither is the reference, nor is what comes behind
/// with such a line, until a setup is measured without one or a host asks.
#[test]
fn of_two_setups_that_lines_teach_neither_is_the_reference() {
    for (first, then) in [(false, false), (true, false), (true, true)] {
        let mut asked = with_ids(job());
        asked.teach = Teach::Asked;
        let mut run = Run::new(asked);
        let mut outcome = Outcome::default();
        let teaches = |run: &mut Run, outcome: &mut Outcome, of_run: u32, again: bool| {
            says(run, outcome, of_run, again);
            let blocks = clamping(of_run as usize - 1, [1, 2, 3]);
            send(run, outcome, &blocks, of_run);
        };
        teaches(&mut run, &mut outcome, 1, first);
        teaches(&mut run, &mut outcome, 2, then);
        assert_eq!(run.taught(), None);
        teaches(&mut run, &mut outcome, 3, then);
        let refused = "taught_twice no_reference";
        assert_eq!(outcome.summary(), ["OK", refused, refused]);
        // Taught, and forgotten.
        assert_eq!(outcome.taught, 2);
        send(&mut run, &mut outcome, &clamping(3, [1, 2, 3]), 4);
        says(&mut run, &mut outcome, 5, then);
        send(&mut run, &mut outcome, &clamping(4, [1, 2, 3]), 5);
        assert_eq!(outcome.summary()[3..], ["no_reference", "OK"]);
        let what = TeachWhat::Again;
        let taken = run.teach(Micros(9), HOST, what, &mut |d| outcome.take(d));
        assert_eq!(taken, Ok(()));
        send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 6);
        send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 7);
        assert_eq!(outcome.summary()[5..], ["OK", "OK"]);
        assert!(outcome.verdicts[6].registration.is_some());
    }
}

/// An old text, then a setup that is broken off, or the power that goes: what was taught by the old text
/// was not measured by since, so the doubt stays. Once it was, it is gone, over a restart too.
#[test]
fn the_doubt_stays_until_something_was_measured() {
    let mut asked = with_ids(job());
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked.clone());
    let mut outcome = Outcome::default();
    says(&mut run, &mut outcome, 1, false);
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 1);
    let taught = run.taught().unwrap();
    let (places, learned) = (taught.places.to_vec(), taught.learned.clone());
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3])[..1], 2);
    says(&mut run, &mut outcome, 3, false);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 3);
    let summary = outcome.summary();
    assert_eq!(summary[2], "taught_twice no_reference", "{summary:?}");
    for (last_run, code) in [(1, "taught_twice no_reference"), (2, "already_taught")] {
        let mut after = Run::new(asked.clone());
        let mut outcome = Outcome::default();
        after.restore_last_run(last_run);
        let (places, learned) = (&places, &learned);
        after.restore_reference(Teaching { places, learned });
        says(&mut after, &mut outcome, 3, false);
        send(&mut after, &mut outcome, &clamping(1, [1, 2, 3]), 3);
        assert_eq!(outcome.summary(), [code]);
    }
}

/// A job that the first setup teaches would be taught by the next one, wherever it stands, if a reference were
/// forgotten: `T1.` forgets nothing there, and neither does a `T2.` that was left in the program. A line that
/// taught nothing is not held against what another setup has taught.
#[test]
fn a_job_that_the_first_setup_teaches_forgets_nothing_by_lines() {
    let mut run = Run::new(with_ids(job()));
    let mut outcome = Outcome::default();
    says(&mut run, &mut outcome, 1, false);
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3])[..1], 1);
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 2);
    let places = |run: &Run| run.taught().map(|of| of.places.to_vec());
    let first = places(&run).unwrap();
    says(&mut run, &mut outcome, 3, false);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 3);
    assert_eq!(places(&run), Some(first));
    for (again, case) in [(4, 2), (5, 3)] {
        says(&mut run, &mut outcome, again, true);
        send(&mut run, &mut outcome, &clamping(case, [1, 2, 3]), again);
    }
    let second = places(&run).unwrap();
    send(&mut run, &mut outcome, &clamping(4, [1, 2, 3]), 6);
    assert_eq!(places(&run), Some(second));
    let summary = outcome.summary();
    assert_eq!(
        summary[1..],
        ["OK", "already_taught", "OK", "taught_twice", "OK"],
        "{summary:?}"
    );
    assert!(outcome.verdicts.last().unwrap().registration.is_some());
}

/// `T2.` right behind `T1.` says which of the two is meant: the new one.
#[test]
fn a_line_replaces_what_the_setup_before_has_taught() {
    let mut asked = with_ids(job());
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    says(&mut run, &mut outcome, 1, false);
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 1);
    let before = run.taught().unwrap().places.to_vec();
    says(&mut run, &mut outcome, 2, true);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 2);
    assert_eq!(outcome.summary(), ["OK", "OK"]);
    assert_ne!(run.taught().unwrap().places, before);
}

/// The control says that this run teaches.
fn says(run: &mut Run, outcome: &mut Outcome, of_run: u32, again: bool) {
    let said = Said::Teach { again };
    let announced = Announced { run: of_run, said };
    run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
}

/// A line asks to teach; without "again" it does not replace what there is.
#[test]
fn a_line_teaches() {
    let mut asked = with_ids(job());
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    says(&mut run, &mut outcome, 1, false);
    send(&mut run, &mut outcome, &clamping(0, [3, 1, 2]), 1);
    send(&mut run, &mut outcome, &clamping(1, [3, 1, 2]), 2);
    says(&mut run, &mut outcome, 3, false);
    send(&mut run, &mut outcome, &clamping(2, [3, 1, 2]), 3);
    says(&mut run, &mut outcome, 4, true);
    send(&mut run, &mut outcome, &clamping(3, [3, 1, 2]), 4);
    send(&mut run, &mut outcome, &clamping(4, [3, 1, 2]), 5);
    assert_eq!(
        outcome.summary(),
        ["OK", "OK", "already_taught", "OK", "OK"]
    );
    assert!(outcome.verdicts[3].registration.is_none());
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

/// A line that asks to teach and comes late, of a run that was judged before, forgets nothing.
#[test]
fn a_late_line_does_not_forget_the_reference() {
    let mut asked = with_ids(job());
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    says(&mut run, &mut outcome, 5, true);
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 5);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 6);
    let before: Vec<Point> = run.taught().unwrap().places.to_vec();
    for old in [5, 4, 6] {
        says(&mut run, &mut outcome, old, true);
        assert_eq!(
            run.taught().map(|of| of.places.to_vec()),
            Some(before.clone()),
            "{old}"
        );
        assert_eq!(run.teach_pending(), None);
    }
    says(&mut run, &mut outcome, 5, true);
    send(&mut run, &mut outcome, &clamping(2, [1, 2, 3]), 5);
    send(&mut run, &mut outcome, &clamping(3, [1, 2, 3]), 7);
    assert_eq!(outcome.summary(), ["OK", "OK", "old_run", "OK"]);
    // One that is new does, as it says.
    says(&mut run, &mut outcome, 8, true);
    assert_eq!(run.taught(), None);
}
