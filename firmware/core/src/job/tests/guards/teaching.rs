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

/// A probing that was aborted does not end by itself for long: whoever asks to teach anew gives it up, and the next setup
/// teaches.
#[test]
fn asking_anew_gives_up_what_is_under_way() {
    let mut asked = with_ids(job());
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    says(&mut run, &mut outcome, 1, false);
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 1);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3])[..2], 2);
    let mut asks = |what| run.teach(Micros(3), HOST, what, &mut |d| outcome.take(d));
    let refused = Err(TeachRefusal::UnderWay);
    assert_eq!(asks(TeachWhat::Reference), refused);
    assert_eq!(asks(TeachWhat::Keep), refused);
    assert_eq!(asks(TeachWhat::Again), Ok(()));
    assert_eq!(run.taught(), None);
    send(&mut run, &mut outcome, &clamping(2, [1, 2, 3]), 3);
    let summary = outcome.summary();
    assert!(summary[1].contains("given_up"), "{summary:?}");
    assert_eq!((summary[0].as_str(), summary[2].as_str()), ("OK", "OK"));
    assert!(run.taught().is_some());
}

/// Blocks without runs: a probing that ended on a bad feature is given up, and the next one, which begins with that feature,
/// is none of it.
#[test]
fn what_is_given_up_takes_nothing_of_the_next_setup() {
    let mut asked = job();
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    let mut spoilt = clamping(0, [1, 2, 3]);
    spoilt[0].1[0][2] += 0.2;
    let (name, points) = &spoilt[0];
    feed(&mut run, &mut outcome, name, points, 5);
    run.teach(Micros(2), HOST, TeachWhat::Again, &mut |d| outcome.take(d))
        .unwrap();
    for (name, points) in clamping(1, [1, 2, 3]) {
        feed(&mut run, &mut outcome, &name, &points, 5);
    }
    let summary = outcome.summary();
    assert_eq!(summary.len(), 2, "{summary:?}");
    assert!(summary[0].contains("given_up"), "{summary:?}");
    assert_eq!(summary[1], "OK");
    assert!(run.taught().is_some());
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
        run.compares(6, &mut |d| outcome.take(d));
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
    let kept = |run: &Run| {
        let taught = run.taught().unwrap();
        (taught.places.to_vec(), taught.learned.clone())
    };
    let doubted = kept(&run);
    let after_restart = |kept: &(Vec<Point>, Lessons), last_run: u32| {
        let mut after = Run::new(asked.clone());
        let mut outcome = Outcome::default();
        after.restore_last_run(last_run);
        let (places, learned) = (&kept.0, &kept.1);
        after.restore_reference(Teaching { places, learned });
        says(&mut after, &mut outcome, last_run + 1, false);
        send(
            &mut after,
            &mut outcome,
            &clamping(1, [1, 2, 3]),
            last_run + 1,
        );
        outcome.summary()
    };
    // Directly behind, or behind a setup that was broken off.
    for last_run in [1, 2] {
        assert_eq!(
            after_restart(&doubted, last_run),
            ["taught_twice no_reference"]
        );
    }
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3])[..1], 2);
    send(&mut run, &mut outcome, &clamping(2, [1, 2, 3]), 3);
    let measured = kept(&run);
    assert_eq!(outcome.summary()[2], "OK");
    assert_eq!(after_restart(&measured, 3), ["already_taught"]);
    let mut run = Run::new(asked.clone());
    let mut outcome = Outcome::default();
    says(&mut run, &mut outcome, 1, false);
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 1);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3])[..1], 2);
    says(&mut run, &mut outcome, 3, false);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 3);
    let summary = outcome.summary();
    assert_eq!(summary[2], "taught_twice no_reference", "{summary:?}");
}

/// A host or the button asks to teach, and an old text comes before the one that was meant: what has taught shows by the
/// control, which reads in the run that was meant and not in the old one. Until it has, no setup is measured; nor over a
/// restart. A line in the old text that asks to teach, too, makes no difference.
#[test]
fn what_a_host_has_taught_holds_once_the_control_has_read_in_it() {
    let all = [1, 2, 3];
    for (by, line) in [
        (HOST, None),
        (TeachBy::Button, None),
        (HOST, Some(false)),
        (HOST, Some(true)),
    ] {
        for reads in [false, true] {
            let mut run = Run::new(with_ids(job()));
            let mut outcome = Outcome::default();
            send(&mut run, &mut outcome, &clamping(1, all), 1);
            let again = run.teach(Micros(9), by, TeachWhat::Again, &mut |d| outcome.take(d));
            assert_eq!(again, Ok(()));
            if let Some(again) = line {
                says(&mut run, &mut outcome, 2, again);
            }
            send(&mut run, &mut outcome, &clamping(0, all), 2);
            if reads {
                run.compares(2, &mut |d| outcome.take(d));
            }
            let taught = run.taught().unwrap();
            let (places, learned) = (taught.places.to_vec(), taught.learned.clone());
            for of_run in [3, 4] {
                send(
                    &mut run,
                    &mut outcome,
                    &clamping(of_run as usize - 2, all),
                    of_run,
                );
                // Too late: it is another run's.
                run.compares(of_run, &mut |d| outcome.take(d));
            }
            let expected = if reads { "OK" } else { "taught_unread" };
            assert_eq!(outcome.summary()[2..], [expected; 2], "{by:?} {line:?}");
            let mut after = Run::new(with_ids(job()));
            let mut outcome = Outcome::default();
            after.restore_last_run(2);
            let (places, learned) = (&places, &learned);
            after.restore_reference(Teaching { places, learned });
            send(&mut after, &mut outcome, &clamping(3, all), 5);
            assert_eq!(outcome.summary(), [expected]);
            // Teaching once more, with the control reading, heals it.
            let again = after.teach(Micros(9), by, TeachWhat::Again, &mut |d| outcome.take(d));
            assert_eq!(again, Ok(()));
            send(&mut after, &mut outcome, &clamping(0, all), 6);
            // What still went out of the one before says nothing of this one.
            after.compares(2, &mut |d| outcome.take(d));
            assert_eq!(after.taught().unwrap().learned.doubt, Doubt::Unread);
            after.compares(6, &mut |d| outcome.take(d));
            send(&mut after, &mut outcome, &clamping(1, all), 7);
            assert_eq!(outcome.summary()[1..], ["OK", "OK"]);
            assert!(outcome.verdicts[2].registration.is_some());
        }
    }
}

/// The setup that a host asked for is NG, and the one behind it teaches, as a job's first or because an old text says
/// `T1.` or `T2.`: which one was meant is as open as if it had been the first.
#[test]
fn what_teaches_behind_an_asked_setup_that_is_ng_is_in_doubt_as_well() {
    let all = [1, 2, 3];
    for (teach, line) in [
        (Teach::FirstOk, None),
        (Teach::FirstOk, Some(false)),
        (Teach::FirstOk, Some(true)),
        (Teach::Asked, Some(false)),
        (Teach::Asked, Some(true)),
    ] {
        // The end of an older run, or one of which a line was lost.
        for fragment in [1, 2] {
            let mut job = with_ids(job());
            job.teach = teach;
            let mut run = Run::new(job);
            let mut outcome = Outcome::default();
            let again = run.teach(Micros(9), HOST, TeachWhat::Again, &mut |d| outcome.take(d));
            assert_eq!(again, Ok(()));
            send(&mut run, &mut outcome, &clamping(0, all), 1);
            run.compares(1, &mut |d| outcome.take(d));
            let again = run.teach(Micros(9), HOST, TeachWhat::Again, &mut |d| outcome.take(d));
            assert_eq!(again, Ok(()));
            send(&mut run, &mut outcome, &clamping(2, all)[..1], fragment);
            if let Some(again) = line {
                says(&mut run, &mut outcome, 3, again);
            }
            send(&mut run, &mut outcome, &clamping(0, all), 3);
            send(&mut run, &mut outcome, &clamping(1, all), 4);
            let summary = outcome.summary();
            assert_eq!(
                summary[2..],
                ["OK", "taught_unread"],
                "{teach:?} {line:?} {summary:?}"
            );
        }
    }
}

/// A setup that taught for a host is revoked, and the next one teaches: that is in doubt as well.
#[test]
fn what_teaches_behind_a_revoked_teaching_is_in_doubt_as_well() {
    let all = [1, 2, 3];
    let mut run = Run::new(with_ids(job()));
    let mut outcome = Outcome::default();
    let what = TeachWhat::Reference;
    let asked = run.teach(Micros(9), HOST, what, &mut |d| outcome.take(d));
    assert_eq!(asked, Ok(()));
    send(&mut run, &mut outcome, &clamping(0, all), 1);
    // Its last ball comes again, with one hit that is off.
    let mut last = clamping(0, all)[2..].to_vec();
    last[0].1[0][2] += 0.2;
    send(&mut run, &mut outcome, &last, 1);
    assert!(run.taught().is_none());
    send(&mut run, &mut outcome, &clamping(0, all), 2);
    send(&mut run, &mut outcome, &clamping(1, all), 3);
    let summary = outcome.summary();
    assert!(
        summary.ends_with(&["OK".into(), "taught_unread".into()]),
        "{summary:?}"
    );
}

/// Where no control compares the runs, a host says that the run that taught is the one that was meant; until then no setup is
/// measured by it, whatever else comes.
#[test]
fn a_host_says_that_the_run_that_taught_was_meant() {
    let all = [1, 2, 3];
    for send_when in [Some(SendWhen::OnVerdict), Some(SendWhen::Never), None] {
        let mut job = with_ids(job());
        job.teach = Teach::Asked;
        match send_when {
            Some(when) => job.correction.as_mut().unwrap().send = when,
            // By whose registration programs are rewritten.
            None => job.correction = None,
        }
        let mut run = Run::new(job);
        let mut outcome = Outcome::default();
        let keep = |run: &mut Run, outcome: &mut Outcome| {
            run.teach(Micros(9), HOST, TeachWhat::Keep, &mut |d| outcome.take(d))
        };
        assert_eq!(keep(&mut run, &mut outcome), Err(TeachRefusal::NotTaught));
        let what = TeachWhat::Reference;
        let taken = run.teach(Micros(9), HOST, what, &mut |d| outcome.take(d));
        assert_eq!(taken, Ok(()));
        send(&mut run, &mut outcome, &clamping(0, all), 1);
        let told =
            |of: &umi_protocol::verdict::SetupReason| of.reason == Reason::TaughtByRun { run: 1 };
        assert!(outcome.verdicts[0].remarks.iter().any(told));
        send(&mut run, &mut outcome, &clamping(1, all), 2);
        send(&mut run, &mut outcome, &clamping(2, all)[..2], 3);
        send(&mut run, &mut outcome, &clamping(3, all), 2);
        send(&mut run, &mut outcome, &clamping(1, all), 4);
        let summary = outcome.summary();
        assert!(
            summary[1..].iter().all(|of| of.contains("taught_unread")),
            "{summary:?}"
        );
        assert_eq!(keep(&mut run, &mut outcome), Ok(()));
        send(&mut run, &mut outcome, &clamping(2, all), 5);
        assert_eq!(outcome.summary().last().unwrap(), "OK");
        assert!(outcome.verdicts.last().unwrap().registration.is_some());
        // Nothing more to say.
        assert_eq!(keep(&mut run, &mut outcome), Ok(()));
    }
}

/// What a line said of a run of which nothing else has come is not held against the next one, which a host asks for.
#[test]
fn a_run_that_was_broken_off_leaves_nothing_behind() {
    for again in [false, true] {
        let mut asked = with_ids(job());
        asked.teach = Teach::Asked;
        let mut run = Run::new(asked);
        let mut outcome = Outcome::default();
        says(&mut run, &mut outcome, 1, again);
        send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 1);
        send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 2);
        says(&mut run, &mut outcome, 3, false);
        send(&mut run, &mut outcome, &clamping(2, [1, 2, 3]), 4);
        assert_eq!(outcome.summary(), ["OK", "OK", "OK"]);
    }
}

/// `T2.` teaches what is wrong, in a job that its first setup teaches: a probing without it, OK or NG, shows that it was
/// not left in the program, and then it teaches again.
#[test]
fn a_wrong_teaching_by_lines_is_mended_by_lines() {
    let all = [1, 2, 3];
    let mut run = Run::new(with_ids(job()));
    let mut outcome = Outcome::default();
    send(&mut run, &mut outcome, &clamping(0, all), 1);
    let mut wrong = clamping(1, all);
    for point in &mut wrong[1].1 {
        point[0] += 0.5;
    }
    says(&mut run, &mut outcome, 2, true);
    send(&mut run, &mut outcome, &wrong, 2);
    says(&mut run, &mut outcome, 3, true);
    send(&mut run, &mut outcome, &clamping(2, all), 3);
    send(&mut run, &mut outcome, &clamping(3, all), 4);
    says(&mut run, &mut outcome, 5, true);
    send(&mut run, &mut outcome, &clamping(4, all), 5);
    send(&mut run, &mut outcome, &clamping(0, all), 6);
    let summary = outcome.summary();
    assert_eq!(
        (summary[1].as_str(), summary[2].as_str()),
        ("OK", "taught_twice")
    );
    assert!(summary[3].contains("distance_error"), "{summary:?}");
    assert_eq!(summary[4..], ["OK", "OK"]);
}

/// A teaching that was taken back leaves no doubt: nothing was taught.
#[test]
fn a_teaching_that_is_taken_back_leaves_no_doubt() {
    let mut asked = with_ids(job());
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    says(&mut run, &mut outcome, 1, false);
    send(&mut run, &mut outcome, &clamping(0, [1, 2, 3]), 1);
    let kind = FaultKind::BlockCountMismatch {
        expected: 6,
        got: 5,
    };
    run.fault(&kind, &mut |d| outcome.take(d));
    assert_eq!(run.taught(), None);
    says(&mut run, &mut outcome, 2, false);
    send(&mut run, &mut outcome, &clamping(1, [1, 2, 3]), 2);
    assert_eq!(outcome.summary().last().unwrap(), "OK");
    assert!(run.taught().is_some());
}

/// A host asks in place of two lines that were in doubt, and the line is still in the program: it asks for the same.
#[test]
fn a_host_may_ask_while_the_line_is_still_in_the_program() {
    let mut asked = with_ids(job());
    asked.teach = Teach::Asked;
    let mut run = Run::new(asked);
    let mut outcome = Outcome::default();
    for of_run in [1, 2] {
        says(&mut run, &mut outcome, of_run, false);
        send(
            &mut run,
            &mut outcome,
            &clamping(of_run as usize - 1, [1, 2, 3]),
            of_run,
        );
    }
    let what = TeachWhat::Reference;
    let taken = run.teach(Micros(9), HOST, what, &mut |d| outcome.take(d));
    assert_eq!(taken, Ok(()));
    says(&mut run, &mut outcome, 3, false);
    send(&mut run, &mut outcome, &clamping(2, [1, 2, 3]), 3);
    assert_eq!(outcome.summary()[2], "OK");
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
