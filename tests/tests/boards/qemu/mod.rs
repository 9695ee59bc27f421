//! The board in QEMU, beyond what all boards have in common: resets of every kind, edges on
//! moving axes, and more edges than it can take.

mod figures;
mod update;

use std::time::{Duration, Instant};

use umi_client::board::link::Client;
use umi_client::problem::Problem;
use umi_protocol::latch::{LatchBatch, LatchCause};
use umi_protocol::message::{Event, Record, ResetReason};
use umi_stimuli::Stimulus;
use umi_tests::rig::{QemuRig, Rig};

fn client(rig: &mut QemuRig) -> Client {
    Client::new(rig.connect()).unwrap()
}

/// The reasons of all starts that the journal knows of.
fn starts(client: &mut Client) -> Vec<ResetReason> {
    let mut starts = Vec::new();
    umi_client::journal::pull(
        client,
        umi_client::journal::PullRequest::default(),
        |step| {
            if let umi_client::journal::PullStep::Entry(entry, _) = step
                && let Record::Boot { reset, .. } = umi_client::journal::record(&entry).unwrap()
            {
                starts.push(reset);
            }
            Ok::<_, Problem>(())
        },
    )
    .unwrap();
    starts
}

/// Each way in which a board can start is told as what it was, in the journal too, which
/// survives them all; a panic tells its place, a stack that overflows is a fault that finds a stack of
/// its own, and a firmware that hangs is reset.
#[test]
fn every_reset_is_told() {
    let Some(mut rig) = QemuRig::start_or_skip() else {
        return;
    };
    assert_eq!(rig.reset(), ResetReason::Pin);
    assert_eq!(rig.restart_by(&Stimulus::Panic), ResetReason::Panic);
    let console = rig.console();
    let told = console.lines().last().unwrap();
    assert!(
        told.contains("after a panic at") && told.contains("bench.rs:"),
        "{console}"
    );
    assert_eq!(rig.restart_by(&Stimulus::Overflow), ResetReason::Panic);
    let console = rig.console();
    let told = console.lines().last().unwrap();
    assert!(told.contains("the stack has overflowed"), "{console}");
    assert_eq!(rig.restart_by(&Stimulus::Hang), ResetReason::Watchdog);
    rig.power_cycle();

    let mut client = client(&mut rig);
    assert_eq!(client.status().unwrap().reset, ResetReason::PowerOn);
    let reasons = [
        ResetReason::PowerOn,
        ResetReason::Pin,
        ResetReason::Panic,
        ResetReason::Panic,
        ResetReason::Watchdog,
        ResetReason::PowerOn,
    ];
    assert_eq!(starts(&mut client), reasons);
}

/// The board gets there, however busy the machine is with other things.
fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let deadline = Instant::now() + Duration::from_secs(60);
    while !holds() {
        assert!(Instant::now() < deadline, "{what} never comes");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The latches that the journal has.
fn latches(client: &mut Client) -> Vec<umi_protocol::latch::LatchReport> {
    let mut latches = Vec::new();
    umi_client::journal::pull(
        client,
        umi_client::journal::PullRequest::default(),
        |step| {
            if let umi_client::journal::PullStep::Entry(entry, _) = step
                && let Record::Latch(latch) = umi_client::journal::record(&entry).unwrap()
            {
                latches.push(latch);
            }
            Ok::<_, Problem>(())
        },
    )
    .unwrap();
    latches
}

/// A path that begins soon: far enough ahead that the board has not come to it.
fn soon(rig: &mut QemuRig) -> u64 {
    rig.stimulate(&Stimulus::Look).t_ns + 20_000_000
}

/// Edges on moving axes have the positions of their own instants, whenever they are told.
#[test]
fn edges_on_moving_axes_have_their_own_positions() {
    let Some(mut rig) = QemuRig::start_or_skip() else {
        return;
    };
    let from_ns = soon(&mut rig);
    let to_ns = from_ns + 10_000_000;
    let edge = |cause, t_ns| Stimulus::Edge { cause, t_ns };
    let index = LatchCause::Index { axis: 2 };
    rig.stimulate_all(&[
        Stimulus::Path {
            from_ns,
            to_ns,
            counts: [1_000_000, -500_000, 7].into_iter().collect(),
        },
        edge(LatchCause::Skip, from_ns),
        edge(LatchCause::Skip, from_ns + 1_234_560),
        edge(index, from_ns + 5_000_000),
        edge(LatchCause::Skip, to_ns + 1),
    ]);
    let mut client = client(&mut rig);
    // Measuring has the lowest priority: it journals them when it comes to them.
    wait_until("five entries", || {
        client.journal_info().unwrap().next_seq == 5
    });
    let latches: Vec<_> = latches(&mut client)
        .into_iter()
        .map(|latch| {
            (
                latch.cause,
                latch.number,
                latch.t_ns - from_ns,
                latch.counts.to_vec(),
                latch.missed,
            )
        })
        .collect();
    let expected = [
        (LatchCause::Skip, 0, 0, vec![0, 0, 0, 0], 0),
        (
            LatchCause::Skip,
            1,
            1_234_560,
            vec![123_456, -61_728, 0, 0],
            0,
        ),
        (index, 0, 5_000_000, vec![500_000, -250_000, 3, 0], 0),
        (
            LatchCause::Skip,
            2,
            10_000_001,
            vec![1_000_000, -500_000, 7, 0],
            0,
        ),
    ];
    assert_eq!(latches, expected);
}

/// More edges than the journal can take are counted to the last one, and so is an edge of
/// which nobody knows any more where the axes were.
#[test]
fn no_edge_is_lost_uncounted() {
    let Some(mut rig) = QemuRig::start_or_skip() else {
        return;
    };
    let begun = soon(&mut rig);
    let path = |k: u64| Stimulus::Path {
        from_ns: begun + 1000 * k,
        to_ns: begun + 1000 * k + 500,
        counts: [k as i64].into_iter().collect(),
    };
    rig.stimulate_all(&(0..100).map(path).collect::<Vec<_>>());
    let skip = |t_ns| Stimulus::Edge {
        cause: LatchCause::Skip,
        t_ns,
    };
    rig.stimulate(&skip(begun));
    let mut client = client(&mut rig);
    wait_until("the loss", || !latches(&mut client).is_empty());
    let counted = client.status().unwrap().latches;
    assert_eq!((counted.skips, counted.missed), (0, 1));
    let told = latches(&mut client);
    assert_eq!(told.len(), 1);
    assert!(told[0].counts.is_empty() && told[0].missed == 1, "{told:?}");

    let now = begun + 1_000_000;
    rig.stimulate_all(&(0..2000).map(|k| skip(now + k)).collect::<Vec<_>>());
    wait_until("every edge", || {
        let told = latches(&mut client);
        let captured = told.iter().filter(|latch| !latch.counts.is_empty()).count();
        let missed: u32 = told.iter().map(|latch| latch.missed).sum();
        assert!(captured as u32 + missed <= 2001, "{captured} and {missed}");
        captured as u32 + missed == 2001
    });
}

/// A scan of 5000 triggers on a moving axis: each comes to the host, in order, with the
/// position of its instant.
#[test]
fn a_scan_comes_to_the_host_paired() {
    const TRIGGERS: u64 = 5000;
    const EVERY_NS: u64 = 100_000;
    // The bench's line takes no time in QEMU, so that edges may come before any is taken:
    // no more at once than wait (`umi_drivers::latches::WAITING`).
    const AT_ONCE: u64 = 50;
    let Some(mut rig) = QemuRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    client.live(true).unwrap();
    let from_ns = soon(&mut rig);
    // Ten counts from trigger to trigger.
    let end = 10 * TRIGGERS as i64;
    rig.stimulate(&Stimulus::Path {
        from_ns,
        to_ns: from_ns + TRIGGERS * EVERY_NS,
        counts: [end, -end].into_iter().collect(),
    });
    let mut next = 0_i64;
    let check = |next: &mut i64, batch: &LatchBatch| {
        let first = &batch.first;
        assert_eq!((first.cause, first.missed), (LatchCause::Trigger, 0));
        let mut at = (first.t_ns, first.counts[0], first.counts[1]);
        let mut one = |at: (u64, i64, i64)| {
            let t_ns = from_ns + *next as u64 * EVERY_NS;
            assert_eq!(at, (t_ns, 10 * *next, -10 * *next));
            *next += 1;
        };
        one(at);
        for step in &batch.steps {
            at.0 += u64::from(step.dt_ns);
            at.1 += i64::from(step.dcounts[0]);
            at.2 += i64::from(step.dcounts[1]);
            one(at);
        }
    };
    for piece in 0..TRIGGERS / AT_ONCE {
        let edges = (AT_ONCE * piece..AT_ONCE * (piece + 1)).map(|k| Stimulus::Edge {
            cause: LatchCause::Trigger,
            t_ns: from_ns + k * EVERY_NS,
        });
        rig.stimulate_all(&edges.collect::<Vec<_>>());
        // QEMU's time is not that of the host: no more than the board keeps for a while.
        while next < (AT_ONCE * (piece + 1)) as i64 {
            match client.next_event(Duration::from_secs(60)).unwrap() {
                Some(Event::Latches(batch)) => check(&mut next, &batch),
                Some(_) => {}
                None => panic!("no more than {next} triggers come"),
            }
        }
    }
    assert_eq!(next as u64, TRIGGERS);
    assert_eq!(client.status().unwrap().latches.untold, 0);
}
