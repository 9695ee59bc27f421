//! The encoders as the second witness of each touch.

use super::*;

/// With a second witness asked for, a setup is OK where the encoders agree, NG where
/// they do not, and NG where a skip edge was not latched.
#[test]
fn second_witness_decides() {
    let approaches = job().features[0].approach.clone();
    // What is wrong with the latches of the second setup.
    let second_plate = |fault: Option<f64>, bounces: u64| {
        let mut job = checked_job();
        // The signal comes 40 us late: at 30 mm/min the axes move 20 nm meanwhile.
        job.skip.delay_us = 40.0;
        let mut run = Run::new(job);
        let mut outcome = Outcome::default();
        let mut t_ns = 0;
        for (at, (_, points)) in session_a()[..6].iter().enumerate() {
            for (point, approach) in points.iter().zip(&approaches) {
                let (axis, sign) = approach.axis_and_sign();
                let mut tip = *point;
                tip[axis] -= sign * (2.5 - if axis == 2 { 0.0 } else { 0.062 });
                let moved = if at >= 3 { fault } else { Some(0.0) };
                if let Some(moved) = moved {
                    let counts = tip.map(|mm| libm::round((mm + moved) * 1000.0) as i64);
                    t_ns += 1_000_000_000;
                    // Each bounce is latched further on the machine's way: 0.05 mm beside.
                    for bounce in 0..=bounces {
                        let beside = if bounce == 0 { 0 } else { 50 };
                        let counts = counts.map(|count| count + beside);
                        let begin_ns = t_ns + bounce * 900_000;
                        let ends =
                            (bounces > 0).then_some((LatchCause::SkipEnd, begin_ns + 10_000));
                        for (cause, t_ns) in [(LatchCause::Skip, begin_ns)].into_iter().chain(ends)
                        {
                            run.latched(&LatchReport {
                                number: 0,
                                cause,
                                counts: counts.into_iter().collect(),
                                t_ns,
                                missed: 0,
                            });
                        }
                    }
                }
                let mut hit = hit(tip);
                hit.feature_id = Some(u16::try_from(at % 3 + 1).unwrap());
                hit.approach = Some(*approach);
                hit.feed_mm_per_min = Some(30.0);
                run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
            }
        }
        outcome
    };
    let agreeing = second_plate(Some(0.0), 0);
    assert_eq!(agreeing.summary(), ["OK", "OK"]);
    let remarks =
        |v: &Verdict| -> Vec<&str> { v.remarks.iter().map(|r| r.reason.code()).collect() };
    assert_eq!(
        remarks(&agreeing.verdicts[0]),
        ["taught", "witnessed", "witness_learned", "not_guarded"]
    );
    assert_eq!(remarks(&agreeing.verdicts[1]), ["witnessed", "not_guarded"]);
    // A probe that bounces: each touch is its first edge, and the rest is counted.
    let bouncing = second_plate(Some(0.0), 5);
    assert_eq!(bouncing.summary(), ["OK", "OK"]);
    assert_eq!(
        remarks(&bouncing.verdicts[1]),
        ["witnessed", "skip_chatter", "not_guarded"]
    );
    let told = bouncing.verdicts[1].remarks.iter().map(|r| &r.reason);
    let chatter = Reason::SkipChatter {
        bounces: 15 * 5,
        sparks: 0,
    };
    assert!(told.into_iter().any(|reason| *reason == chatter));
    let moved = second_plate(Some(0.05), 0);
    assert_eq!(
        moved.summary(),
        ["OK", "witness_shift witness_shift witness_shift"]
    );
    let blind = second_plate(None, 0).summary();
    assert!(blind[1].contains("SPHERE1:not_latched"), "{blind:?}");
}

/// Lines printed again without a touch have no latches: a repeat of what is known, not
/// a contradiction of it.
#[test]
fn a_repeat_without_latches_is_dropped() {
    let mut job = checked_job();
    job.correction = None;
    let mut run = Run::new(job);
    let mut outcome = Outcome::default();
    let mut t_ns = 0;
    let approaches = super::job().features[0].approach.clone();
    let blocks = session_a();
    for (at, (_, points)) in blocks[..3].iter().chain(&blocks[2..3]).enumerate() {
        for (point, approach) in points.iter().zip(&approaches) {
            let (axis, sign) = approach.axis_and_sign();
            let mut tip = *point;
            tip[axis] -= sign * (2.5 - if axis == 2 { 0.0 } else { 0.062 });
            if at < 3 {
                let counts = tip.map(|mm| libm::round(mm * 1000.0) as i64);
                t_ns += 1_000_000_000;
                run.latched(&LatchReport {
                    number: 0,
                    cause: LatchCause::Skip,
                    counts: counts.into_iter().collect(),
                    t_ns,
                    missed: 0,
                });
            }
            let mut hit = hit(tip);
            hit.feature_id = Some(u16::try_from(at.min(2) + 1).unwrap());
            hit.approach = Some(*approach);
            hit.feed_mm_per_min = Some(30.0);
            run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
        }
    }
    assert_eq!(outcome.summary(), ["OK"]);
}

/// A touch of the probe on a board without encoders.
fn touches(run: &mut Run, t_ns: u64, active: SignalLevel) {
    let both = match active {
        SignalLevel::High => [LatchCause::Skip, LatchCause::SkipEnd],
        SignalLevel::Low => [LatchCause::SkipEnd, LatchCause::Skip],
    };
    for (cause, after_ns) in both.into_iter().zip([0, 30_000_000]) {
        run.latched(&LatchReport {
            number: 0,
            cause,
            counts: heapless::Vec::from_slice(&[0; 3]).unwrap(),
            t_ns: t_ns + after_ns,
            missed: 0,
        });
    }
}

fn without_encoders(active: SignalLevel) -> Job {
    let mut job = job();
    job.skip.active = active;
    job.skip.each_hit = true;
    job
}

/// Without encoders: what is printed without being touched is refused, be it a block that is played
/// again, a block that lacks one touch, or a skip line that is not seen. Twice the touches (fast,
/// then slow) are as good as once.
#[test]
fn each_block_needs_its_touches() {
    for active in [SignalLevel::High, SignalLevel::Low] {
        let mut run = Run::new(without_encoders(active));
        let mut outcome = Outcome::default();
        let mut t_ns = 0;
        // Touches of each setup's blocks.
        for (setup, touched) in [[5, 10, 5], [5, 4, 5], [0, 0, 0]].iter().enumerate() {
            let blocks = session_a();
            for ((name, points), touched) in blocks[3 * setup..3 * setup + 3].iter().zip(touched) {
                for _ in 0..*touched {
                    t_ns += 1_000_000_000;
                    touches(&mut run, t_ns, active);
                }
                feed(&mut run, &mut outcome, name, points, 5);
            }
        }
        let all_missing = "SPHERE1:untouched SPHERE2:untouched SPHERE3:untouched";
        assert_eq!(outcome.summary(), ["OK", "SPHERE2:untouched", all_missing]);
        let remarks = outcome.verdicts[0].remarks.iter().map(|r| &r.reason);
        let touched = Reason::Touched { hits: 15 };
        assert!(remarks.into_iter().any(|reason| *reason == touched));
        let reasons = outcome.verdicts[1].reasons.iter().map(|r| &r.reason);
        let untouched = Reason::Untouched {
            hits: 5,
            touches: 4,
        };
        assert!(reasons.into_iter().any(|reason| *reason == untouched));
    }
}

/// What the probe touches while a block is still printed belongs to the next block.
#[test]
fn touches_while_a_block_is_printed_are_the_next_ones() {
    let mut run = Run::new(without_encoders(SignalLevel::High));
    let mut outcome = Outcome::default();
    let mut t_ns = 0;
    let mut touch = |run: &mut Run| {
        t_ns += 1_000_000_000;
        touches(run, t_ns, SignalLevel::High);
    };
    (0..5).for_each(|_| touch(&mut run));
    for (name, points) in &session_a()[..3] {
        run.block_start(name, Micros(1), &mut |d| outcome.take(d));
        for point in points {
            // Each line is so slow that the probe is at its next hit meanwhile.
            touch(&mut run);
            run.hit(&hit(*point), Micros(1), &mut |d| outcome.take(d));
        }
        let end = block_end(name, points.len(), 5);
        run.block_end(&end, Micros(1), &mut |d| outcome.take(d));
    }
    assert_eq!(outcome.summary(), ["OK"]);
}

/// Lines right behind each hit: one that came without a touch is refused, and a touch counts once.
#[test]
fn each_line_needs_its_touch() {
    let approaches = job().features[0].approach.clone();
    let with_touches = |untouched: Option<usize>| {
        let mut job = checked_job();
        (job.witness, job.skip.each_hit) = (None, true);
        let mut run = Run::new(job);
        let mut outcome = Outcome::default();
        let mut number = 0;
        for (at, (_, points)) in session_a()[..3].iter().enumerate() {
            for (point, approach) in points.iter().zip(&approaches) {
                number += 1;
                // A line without a touch has two before the hit in front of it.
                let times = match untouched.map(|of| number.cmp(&of)) {
                    Some(std::cmp::Ordering::Equal) => 0,
                    _ => 2,
                };
                for time in 0..times {
                    let t_ns = number as u64 * 2_000_000_000 + time * 500_000_000;
                    touches(&mut run, t_ns, SignalLevel::High);
                }
                let (axis, sign) = approach.axis_and_sign();
                let mut tip = *point;
                tip[axis] -= sign * (2.5 - if axis == 2 { 0.0 } else { 0.062 });
                let mut hit = hit(tip);
                hit.feature_id = Some(u16::try_from(at + 1).unwrap());
                hit.approach = Some(*approach);
                hit.feed_mm_per_min = Some(30.0);
                run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
            }
        }
        outcome.summary()
    };
    assert_eq!(with_touches(None), ["OK"]);
    assert_eq!(with_touches(Some(8)), ["SPHERE2:untouched no_reference"]);
}

/// The probe's line at a job of checked lines: it is high while the probe touches, and each hit stands for 60 ms before it is
/// printed.
struct AtTheLine {
    run: Run,
    outcome: Outcome,
    t_ns: u64,
    has_encoders: bool,
    /// The board's input is turned round from here on.
    is_turned: bool,
}

impl AtTheLine {
    fn new(active: SignalLevel, has_encoders: bool) -> Self {
        Self::with(active, has_encoders, !has_encoders)
    }

    fn with(active: SignalLevel, has_encoders: bool, each_hit: bool) -> Self {
        let mut job = checked_job();
        job.skip.active = active;
        job.skip.each_hit = each_hit;
        if !has_encoders {
            job.witness = None;
        }
        Self {
            run: Run::new(job),
            outcome: Outcome::default(),
            t_ns: 0,
            has_encoders,
            is_turned: false,
        }
    }

    /// A feature of the session, `beside` where it is.
    fn probes(&mut self, block: usize, beside: f64) {
        let approaches = job().features[0].approach.clone();
        let (_, points) = &session_a()[block];
        for (number, (point, approach)) in points.iter().zip(&approaches).enumerate() {
            let (axis, sign) = approach.axis_and_sign();
            let mut tip = *point;
            tip[axis] -= sign * (2.5 - if axis == 2 { 0.0 } else { 0.062 });
            let counts = tip.map(|mm| libm::round(mm * 1000.0) as i64);
            self.t_ns += 2_000_000_000;
            let mut edges = [LatchCause::Skip, LatchCause::SkipEnd];
            if self.is_turned {
                edges.reverse();
            }
            for (cause, after_ns) in edges.into_iter().zip([0, 60_000_000]) {
                let counts = match self.has_encoders {
                    true => counts,
                    false => [0; 3],
                };
                self.run.latched(&LatchReport {
                    number: 0,
                    cause,
                    counts: counts.into_iter().collect(),
                    t_ns: self.t_ns + after_ns,
                    missed: 0,
                });
            }
            if number == 0 {
                tip[axis] += beside;
            }
            let mut hit = hit(tip);
            hit.feature_id = Some(u16::try_from(block % 3 + 1).unwrap());
            hit.approach = Some(*approach);
            hit.feed_mm_per_min = Some(30.0);
            let outcome = &mut self.outcome;
            self.run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
        }
    }
}

/// A job whose `skip.active` is the level at which the line rests: with encoders each setup is NG by that, though all positions
/// agree; without, it is OK and a remark says that it may be, also in a job that does not judge touches. At the right level
/// nothing is said.
#[test]
fn a_line_that_rests_at_the_level_of_a_touch_is_named_in_the_verdict() {
    for (has_encoders, each_hit) in [(true, false), (false, true), (false, false)] {
        for active in [SignalLevel::High, SignalLevel::Low] {
            let mut line = AtTheLine::with(active, has_encoders, each_hit);
            (0..6).for_each(|block| line.probes(block, 0.0));
            let is_right = active == SignalLevel::High;
            let said = match has_encoders {
                true => Reason::SkipRestsAtTouch { rests: active },
                false => Reason::SkipMayRestAtTouch { rests: active },
            };
            for verdict in &line.outcome.verdicts {
                let in_reasons = verdict.reasons.iter().any(|of| of.reason == said);
                let in_remarks = verdict.remarks.iter().any(|of| of.reason == said);
                assert_eq!(in_reasons, !is_right && has_encoders, "{verdict:?}");
                assert_eq!(in_remarks, !is_right && !has_encoders, "{verdict:?}");
                assert_eq!(verdict.ok, is_right || !has_encoders, "{verdict:?}");
            }
            assert_eq!(line.outcome.verdicts.len(), 2);
        }
    }
}

/// A refused feature that comes again makes no such setup good, also where the wire was mended in between; the next setup is.
#[test]
fn a_wrong_level_stays_against_its_setup() {
    let mut line = AtTheLine::new(SignalLevel::Low, true);
    line.probes(0, 0.0);
    line.probes(1, 0.0);
    line.probes(2, 1.0);
    line.is_turned = true;
    line.probes(2, 0.0);
    (3..6).for_each(|block| line.probes(block, 0.0));
    let says = |verdict: &Verdict| {
        let codes = verdict.reasons.iter().map(|of| of.reason.code());
        codes.filter(|code| *code == "skip_rests_at_touch").count()
    };
    let verdicts = &line.outcome.verdicts;
    let [first, again, next] = &verdicts[..] else {
        panic!("{:?}", line.outcome.summary());
    };
    assert_eq!([says(first), says(again), says(next)], [1, 1, 0]);
    assert_eq!([first.ok, again.ok, next.ok], [false, false, true]);
}
