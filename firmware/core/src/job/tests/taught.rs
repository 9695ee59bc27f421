//! What becomes the reference, and what does not.

use super::*;

/// A damaged first setup is not taught, and says that there is no reference.
#[test]
fn a_bad_setup_is_never_taught() {
    let mut blocks = session_a();
    blocks[1].1[2] = [0.0; 3];
    let outcome = run_blocks(job(), &blocks);
    let summary = outcome.summary();
    assert_eq!(summary[0], "SPHERE2:null_point no_reference");
    assert_eq!(summary[1], "OK");
    assert_eq!(outcome.taught, 1);
    assert_eq!(outcome.verdicts[1].correction, None);
}

/// An unfinished setup is given up after the job's time-out, once.
#[test]
fn an_unfinished_setup_times_out() {
    let mut run = Run::new(job());
    let mut outcome = Outcome::default();
    for (name, points) in &session_a()[..2] {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    let due = run.deadline().unwrap();
    run.on_time(Micros(due.0 - 1), &mut |d| outcome.take(d));
    assert!(outcome.verdicts.is_empty());
    run.on_time(due, &mut |d| outcome.take(d));
    assert_eq!(
        outcome.summary(),
        ["timed_out missing_feature no_reference"]
    );
    assert_eq!(run.deadline(), None);
}

/// Given nominals: the setup is registered at once.
#[test]
fn given_nominals_register_the_first_setup() {
    let mut job = job();
    job.reference = Reference::Given;
    let positions = [
        [-135.018, -136.624, 135.91],
        [137.989, -134.678, 110.253],
        [-136.711, 136.412, 136.121],
    ];
    for (feature, position) in job.features.iter_mut().zip(positions) {
        feature.position_mm = Some(position);
    }
    let outcome = run_blocks(job, &session_a()[3..6]);
    assert_eq!(outcome.summary(), ["OK"]);
    let registration = outcome.verdicts[0].registration.as_ref().unwrap();
    assert!((registration.angle_deg - 1.0).abs() < 0.001);
}

/// A setup that taught the reference and is contradicted afterwards takes it back: the
/// next good setup is the reference.
#[test]
fn a_revoked_setup_is_no_reference() {
    let mut run = Run::new(job());
    let mut outcome = Outcome::default();
    let blocks = session_a();
    for (name, points) in &blocks[..3] {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    assert!(run.taught().is_some());
    let surplus = FaultKind::BlockCountMismatch {
        expected: 5,
        got: 6,
    };
    run.fault(&surplus, &mut |d| outcome.take(d));
    assert_eq!(run.taught(), None);
    assert_eq!(outcome.taught, 2, "taught, and taken back");
    let revoked = &outcome.verdicts[1];
    assert!(revoked.remarks.iter().all(|r| r.reason != Reason::Taught));
    for (name, points) in &blocks[3..6] {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    assert_eq!(outcome.summary(), ["OK", "wrong_count", "OK"]);
    // It is the reference now, so there is nothing to correct.
    assert_eq!(outcome.verdicts[2].correction, None);
    assert_eq!(outcome.taught, 3);
}
