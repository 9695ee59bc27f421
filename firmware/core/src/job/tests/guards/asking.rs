//! A run says in which one the control was last asked to teach: so a request that never came is seen.

use super::*;
use crate::dprnt::{Announced, Said};

/// What O8811 prints at a run's start: its offset, with the run in which it was last asked to teach, then what it asks.
fn begins(run: &mut Run, outcome: &mut Outcome, of_run: u32, asked_in: u32, asks: Option<bool>) {
    let origin = Point::from_mm(0.0, 0.0, 0.0);
    let frame = Said::Frame {
        offset: 1,
        origin,
        asked_in,
    };
    let asks = asks.map(|again| Said::Teach { again });
    for said in core::iter::once(frame).chain(asks) {
        let announced = Announced { run: of_run, said };
        run.announced(&announced, Micros(1), &mut |d| outcome.take(d));
    }
}

fn probes(run: &mut Run, outcome: &mut Outcome, of_run: u32, asked_in: u32, asks: Option<bool>) {
    begins(run, outcome, of_run, asked_in, asks);
    let blocks = clamping((of_run as usize - 1) % 5, [1, 2, 3]);
    send(run, outcome, &blocks, of_run);
}

fn asked(teach: Teach) -> (Run, Outcome) {
    let mut job = with_ids(job());
    job.teach = teach;
    job.limits.tilt_deg = 6.0;
    (Run::new(job), Outcome::default())
}

/// The line that asks is lost, or its whole run: what was taught before holds for no run behind it, until one teaches. A
/// restart changes nothing.
#[test]
fn what_was_taught_before_a_lost_request_holds_no_more() {
    for (teach, run_comes) in [
        (Teach::Asked, true),
        (Teach::Asked, false),
        (Teach::FirstOk, true),
    ] {
        let (mut run, mut outcome) = asked(teach);
        probes(&mut run, &mut outcome, 1, 1, Some(false));
        probes(&mut run, &mut outcome, 2, 1, None);
        if run_comes {
            probes(&mut run, &mut outcome, 3, 3, None);
        }
        probes(&mut run, &mut outcome, 4, 3, None);
        let lost = usize::from(run_comes) + 1;
        assert_eq!(outcome.summary()[..2], ["OK", "OK"]);
        assert_eq!(outcome.summary()[2..], vec!["asked_in_run"; lost][..]);

        let taught = run.taught().unwrap();
        let (places, learned) = (taught.places.to_vec(), taught.learned.clone());
        let (mut restarted, mut after) = asked(teach);
        let (places, learned) = (&places[..], &learned);
        restarted.restore_reference(Teaching { places, learned });
        probes(&mut restarted, &mut after, 5, 3, None);
        probes(&mut restarted, &mut after, 6, 6, Some(true));
        probes(&mut restarted, &mut after, 7, 6, None);
        assert_eq!(after.summary(), ["asked_in_run", "OK", "OK"], "{teach:?}");
    }
}

/// A request that is refused counts as known once a verdict has said so: where nothing else of its run comes, nobody was told.
#[test]
fn a_request_of_which_nothing_was_judged_is_lost() {
    for (teach, first, then) in [
        (Teach::Asked, false, false),
        (Teach::FirstOk, false, false),
        (Teach::FirstOk, true, true),
    ] {
        let (mut run, mut outcome) = asked(teach);
        probes(&mut run, &mut outcome, 1, 1, Some(first));
        if teach == Teach::Asked {
            probes(&mut run, &mut outcome, 2, 1, None);
        }
        begins(&mut run, &mut outcome, 3, 3, Some(then));
        probes(&mut run, &mut outcome, 4, 3, None);
        let summary = outcome.summary();
        assert_eq!(
            summary.last().unwrap(),
            "asked_in_run",
            "{teach:?} {summary:?}"
        );
    }
}

/// Its first line may come damaged: the line that asks says its run as well.
#[test]
fn a_refused_request_says_its_run_itself() {
    let (mut run, mut outcome) = asked(Teach::Asked);
    probes(&mut run, &mut outcome, 1, 1, Some(false));
    probes(&mut run, &mut outcome, 2, 1, None);
    says(&mut run, &mut outcome, 3, false);
    send(&mut run, &mut outcome, &clamping(2, [1, 2, 3]), 3);
    probes(&mut run, &mut outcome, 4, 3, None);
    assert_eq!(outcome.summary(), ["OK", "OK", "already_taught", "OK"]);
}

/// One that was read and refused is not lost: what is taught stays, as the verdict has said. Nor is one that a host has
/// answered, or one of which older macros say nothing.
#[test]
fn a_request_that_was_read_is_not_lost() {
    let (mut run, mut outcome) = asked(Teach::Asked);
    probes(&mut run, &mut outcome, 1, 1, Some(false));
    probes(&mut run, &mut outcome, 2, 1, None);
    probes(&mut run, &mut outcome, 3, 3, Some(false));
    assert_eq!(run.taught().unwrap().learned.asked_in, 3);
    probes(&mut run, &mut outcome, 4, 3, None);
    probes(&mut run, &mut outcome, 5, 0, None);
    assert_eq!(
        outcome.summary(),
        ["OK", "OK", "already_taught", "OK", "OK"]
    );
    // Run 6 asked and was lost; then a host asks.
    run.teach(Micros(1), TeachBy::Host, TeachWhat::Again, &mut |d| {
        outcome.take(d)
    })
    .unwrap();
    probes(&mut run, &mut outcome, 7, 6, None);
    assert_eq!(run.taught().unwrap().learned.asked_in, 6);
    run.teach(Micros(1), TeachBy::Host, TeachWhat::Keep, &mut |d| {
        outcome.take(d)
    })
    .unwrap();
    probes(&mut run, &mut outcome, 8, 6, None);
    assert_eq!(outcome.summary()[5..], ["OK", "OK"]);
}

/// A request in an old text changes nothing.
#[test]
fn an_old_request_is_none() {
    let (mut run, mut outcome) = asked(Teach::Asked);
    probes(&mut run, &mut outcome, 5, 5, Some(false));
    probes(&mut run, &mut outcome, 6, 5, None);
    probes(&mut run, &mut outcome, 4, 4, Some(true));
    probes(&mut run, &mut outcome, 7, 5, None);
    let summary = outcome.summary();
    assert_eq!((summary[1].as_str(), summary[3].as_str()), ("OK", "OK"));
    assert_eq!(summary[2], "old_run", "{summary:?}");
}
