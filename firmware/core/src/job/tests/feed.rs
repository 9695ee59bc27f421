//! The feed of the touches: what the probe and the control add depends on it.

use umi_protocol::job::Lessons;

use super::*;

/// The three balls of a clamping with a run number, the hits of each at its feed.
fn send(run: &mut Run, outcome: &mut Outcome, of_run: u32, feeds: [Option<f64>; 3]) {
    let blocks = session_a();
    let at = 3 * (of_run as usize - 1);
    for ((id, feed), (_, points)) in (1..).zip(feeds).zip(&blocks[at..at + 3]) {
        for (number, point) in points.iter().enumerate() {
            let mut hit = hit(*point);
            (hit.feature_id, hit.run) = (Some(id), Some(of_run));
            // Of the last ball one hit alone is at it.
            hit.feed_mm_per_min = if id < 3 || number == 4 {
                feed
            } else {
                feeds[0]
            };
            run.hit(&hit, Micros(1), &mut |d| outcome.take(d));
        }
    }
}

fn numbered() -> Job {
    let mut job = job();
    job.limits.rotation_deg = 6.0;
    job.limits.shift_mm = [120.0, 120.0, 0.2];
    for (id, feature) in (1..).zip(&mut job.features) {
        feature.id = Some(id);
    }
    job
}

/// One hit at another feed than the taught ones refuses its setup, wherever it is. The next setup at the taught feed is corrected again.
#[test]
fn another_feed_than_taught_is_named() {
    let mut run = Run::new(numbered());
    let mut outcome = Outcome::default();
    let feeds = [[50.0; 3], [50.0, 50.0, 100.0], [25.0; 3], [50.0; 3]];
    for (of_run, feeds) in (1..).zip(feeds) {
        send(&mut run, &mut outcome, of_run, feeds.map(Some));
    }
    let third = "SPHERE3:feed_changed";
    let all = "SPHERE1:feed_changed SPHERE2:feed_changed SPHERE3:feed_changed";
    assert_eq!(outcome.summary(), ["OK", third, all, "OK"]);
    let named = Reason::FeedChanged {
        hit: 5,
        feed_mm_per_min: 100.0,
        expected_mm_per_min: 50.0,
    };
    assert_eq!(outcome.verdicts[1].reasons[0].reason, named);
}

/// Nothing is taught by a setup that was probed at two feeds.
#[test]
fn two_feeds_teach_nothing() {
    let mut run = Run::new(numbered());
    let mut outcome = Outcome::default();
    send(
        &mut run,
        &mut outcome,
        1,
        [Some(50.0), Some(51.0), Some(50.0)],
    );
    let named = "SPHERE2:feed_changed no_reference";
    assert_eq!(outcome.summary(), [named]);
    assert!(run.taught().is_none());
    // What came before is not the next setup's.
    send(&mut run, &mut outcome, 2, [Some(51.0); 3]);
    assert_eq!(outcome.summary(), [named, "OK"]);
}

/// It is kept with the reference; one that was kept without it is compared with nothing.
#[test]
fn it_is_kept_with_the_reference() {
    let mut run = Run::new(numbered());
    let mut outcome = Outcome::default();
    send(&mut run, &mut outcome, 1, [Some(50.0); 3]);
    let taught = run.taught().unwrap();
    assert_eq!(taught.learned.feed_mm_per_min, 50.0);
    let all = "SPHERE1:feed_changed SPHERE2:feed_changed SPHERE3:feed_changed";
    let older = Lessons {
        feed_mm_per_min: 0.0,
        ..taught.learned.clone()
    };
    for (learned, feed, named) in [
        (taught.learned, Some(80.0), all),
        (taught.learned, Some(50.0), "OK"),
        (&older, Some(80.0), "OK"),
    ] {
        let mut again = Run::new(numbered());
        let mut outcome = Outcome::default();
        let places = taught.places;
        again.restore_reference(Teaching { places, learned });
        send(&mut again, &mut outcome, 2, [feed; 3]);
        assert_eq!(outcome.summary(), [named]);
    }
}
