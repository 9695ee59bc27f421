//! Runs, their numbers and their order: what belongs together.

use super::*;

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
            asked_in: 0,
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

/// Blocks that belong to no run are refused, and the run behind them is judged as ever: also
/// where theirs were not complete, and nothing of them is taken for it.
#[test]
fn a_run_begins_behind_blocks_of_none() {
    let mut job = job();
    let checked = LinePattern::Checked(CheckedPattern::default());
    let _ = job.receiver.patterns.push(checked);
    job.guards.run_variable = Some(531);
    check(&job).unwrap();
    for of_none in [3, 2, 1] {
        let mut run = Run::new(job.clone());
        let mut outcome = Outcome::default();
        for number in 0..4 {
            if number != 1 {
                let of_run = 7 + u32::try_from(number).unwrap();
                // Nothing else begins a run than a number: the line with the offset is lost.
                let said = Said::Moved(Moved {
                    is_rotated: false,
                    tool_length_mm: 0.0,
                    external: Point::from_mm(0.0, 0.0, 0.0),
                });
                let announced = Announced { run: of_run, said };
                run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
            }
            let due = if number == 1 { of_none } else { 3 };
            for (name, points) in &clamping(number, [1, 2, 3])[..due] {
                feed(&mut run, &mut outcome, name, points, 5);
            }
        }
        let summary = outcome.summary();
        assert_eq!(summary.len(), 4, "{summary:?}");
        assert!(summary[1].contains("run_unknown"), "{summary:?}");
        assert_eq!([&summary[0], &summary[2], &summary[3]], ["OK"; 3]);
    }
    // What is left of blocks is no ball of the run behind them.
    let mut run = Run::new(job);
    let mut outcome = Outcome::default();
    for (number, part) in [(0, 0..3), (1, 0..2), (2, 2..3)] {
        if number != 1 {
            let said = Said::Moved(Moved {
                is_rotated: false,
                tool_length_mm: 0.0,
                external: Point::from_mm(0.0, 0.0, 0.0),
            });
            let announced = Announced {
                run: 7 + number,
                said,
            };
            run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
        }
        let clamping = clamping(usize::try_from(number).unwrap(), [1, 2, 3]);
        for (name, points) in &clamping[part] {
            feed(&mut run, &mut outcome, name, points, 5);
        }
    }
    run.control_asks(&mut |d| outcome.take(d));
    let third = outcome.summary().pop().unwrap();
    assert!(third.contains("missing_feature"), "{third}");
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
/// its lines say. With another job a board puts back what it knows, and the count goes on.
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
    // Also a second clamping in one run: on the control nothing tells their corrections apart.
    assert_eq!(
        outcome.summary(),
        ["OK", "OK", "old_run", "old_run", "old_run", "OK"]
    );
    assert_eq!(run.last_run(), Some(18));
    // What moves nothing may be measured again.
    let mut measures = numbered.clone();
    measures.correction = None;
    measures.features.pop();
    let mut run = Run::new(measures);
    let mut outcome = Outcome::default();
    for case in 0..3 {
        send(&mut run, &mut outcome, &clamping(case, [1, 2, 3])[..2], 16);
    }
    assert_eq!(outcome.summary().len(), 3);
    let is_old = |said: &String| said.contains("old_run");
    assert!(!outcome.summary().iter().any(is_old));

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
    again.restore_last_run(20);
    let mut outcome = Outcome::default();
    for (case, number) in [(0, 20), (1, 1), (2, 21)] {
        send(&mut again, &mut outcome, &clamping(case, [1, 2, 3]), number);
    }
    assert_eq!(
        outcome.summary(),
        ["old_run no_reference", "old_run no_reference", "OK"]
    );
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
