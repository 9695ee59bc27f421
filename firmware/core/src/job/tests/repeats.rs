//! What is printed again, what comes late, and what belongs to another setup.

use super::*;

/// Whichever block is lost, its clamping is NG and no other: blocks never
/// move into the wrong clamping.
#[test]
fn a_lost_block_spoils_its_clamping_only() {
    for lost in 3..15 {
        let mut blocks = session_a();
        let (name, _) = blocks.remove(lost);
        let outcome = run_blocks(job(), &blocks);
        let summary = outcome.summary();
        assert_eq!(summary.len(), 5, "{summary:?}");
        for (clamping, verdict) in summary.iter().enumerate() {
            if clamping == lost / 3 {
                assert!(verdict.contains("missing_feature"), "{name}: {verdict}");
            } else {
                assert_eq!(verdict, "OK");
            }
        }
    }
}

/// A block that is printed twice is counted once.
#[test]
fn an_unchanged_repeat_is_dropped() {
    for repeated in 0..15 {
        let mut blocks = session_a();
        let again = blocks[repeated].clone();
        blocks.insert(repeated + 1, again);
        let outcome = run_blocks(job(), &blocks);
        assert_eq!(outcome.summary(), ["OK"; 5], "{repeated}");
        assert_eq!(outcome.features.len(), 15);
    }
}

/// A refused block that is probed again is replaced, and the verdict says so;
/// the last block's setup is judged again under its number.
#[test]
fn a_refused_block_may_be_probed_again() {
    for bad in 0..15 {
        let mut blocks = session_a();
        let mut spoilt = blocks[bad].clone();
        spoilt.1[1] = [0.0; 3];
        blocks.insert(bad, spoilt);
        let outcome = run_blocks(job(), &blocks);
        let last: Vec<_> = (0..5)
            .map(|setup| outcome.verdicts.iter().rfind(|v| v.setup == setup).unwrap())
            .collect();
        assert!(last.iter().all(|v| v.ok), "{bad}: {:?}", outcome.summary());
        let remark = &last[bad / 3].remarks;
        assert!(
            remark.iter().any(|r| r.reason.code() == "replaced"),
            "{remark:?}"
        );
        assert_eq!(outcome.features.len(), 16);
    }
}

/// The same feature twice with different coordinates: nobody knows which.
#[test]
fn a_contradicting_repeat_is_ng() {
    let mut blocks = session_a();
    let mut again = blocks[4].clone();
    again.1[1][0] += 0.002;
    blocks.insert(5, again);
    let summary = run_blocks(job(), &blocks).summary();
    assert!(summary[1].contains("conflicting_repeat"), "{summary:?}");
    assert_eq!(summary[2], "OK");
}

/// A setup that is printed again to the last digit was not measured again.
#[test]
fn a_setup_printed_again_is_ng() {
    let mut blocks = session_a()[..6].to_vec();
    blocks.extend_from_within(3..6);
    let summary = run_blocks(job(), &blocks).summary();
    assert_eq!(summary, ["OK", "OK", "repeated_plate"]);
}

/// Bytes that are lost before a setup's first feature are held against that
/// setup, and against no other.
#[test]
fn a_loss_between_setups_concerns_the_next_one() {
    let mut run = Run::new(job());
    let mut outcome = Outcome::default();
    for (at, (name, points)) in session_a().iter().enumerate() {
        if at == 6 {
            let lost = FaultKind::BufferOverrun { lost: 20 };
            run.fault(&lost, &mut |d| outcome.take(d));
        }
        feed(&mut run, &mut outcome, name, points, 5);
    }
    assert_eq!(outcome.summary(), ["OK", "OK", "bytes_lost", "OK", "OK"]);
}

/// A point too many behind a block takes its verdict back.
#[test]
fn a_surplus_point_revokes_the_verdict() {
    let mut run = Run::new(job());
    let mut outcome = Outcome::default();
    for (name, points) in &session_a()[..6] {
        feed(&mut run, &mut outcome, name, points, 5);
    }
    let surplus = FaultKind::BlockCountMismatch {
        expected: 5,
        got: 6,
    };
    run.fault(&surplus, &mut |d| outcome.take(d));
    assert_eq!(outcome.summary(), ["OK", "OK", "wrong_count"]);
    assert_eq!(outcome.verdicts[1].setup, outcome.verdicts[2].setup);
}

/// Checked lines of another run never complete the setup of the run before.
#[test]
fn another_run_is_another_setup() {
    let mut job = job();
    for (id, feature) in (1..).zip(&mut job.features) {
        feature.id = Some(id);
    }
    let mut run = Run::new(job);
    let mut outcome = Outcome::default();
    let mut send = |blocks: &[Block], first_id: u16, of_run: u32| {
        for (id, (_, points)) in (first_id..).zip(blocks) {
            for point in points {
                let mut hit = hit(*point);
                (hit.feature_id, hit.run) = (Some(id), Some(of_run));
                run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
            }
        }
    };
    let blocks = session_a();
    send(&blocks[..3], 1, 1);
    // Two spheres in run 2, the third of another clamping in run 3.
    send(&blocks[3..5], 1, 2);
    send(&blocks[8..9], 3, 3);
    send(&blocks[9..12], 1, 4);
    assert_eq!(
        outcome.summary(),
        [
            "OK",
            "run_changed missing_feature",
            "run_changed missing_feature missing_feature",
            "OK"
        ]
    );
}
