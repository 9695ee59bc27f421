//! What every board does, whichever it is: the same cases against the virtual board, the
//! image in QEMU and the emulated Pico.
//!
//! A case takes a board with empty flash that was just switched on. What is beyond a rig
//! (waveforms at rate, resets, steered time) has tests of its own for each board.

use std::time::Duration;

use umi_client::board::link::Client;
use umi_client::programs;
use umi_protocol::frame::{MAX_HOST_FRAME, encode};
use umi_protocol::hello::Hello;
use umi_protocol::job::SkipSpec;
use umi_protocol::latch::{LatchCause, LatchReport, TriggerOut, TriggerPulse, TriggerRefusal};
use umi_protocol::message::{Event, Record, Request, ResetReason};
use umi_protocol::pattern::Handshake;
use umi_protocol::program::{ProgramInfo, ProgramRefusal, Release, Stated, Withheld};
use umi_tests::cases::*;
use umi_tests::rig::Rig;

/// How far from its line a trigger pulse may begin, at the speed of a rig's moves.
const LAG_COUNTS: i64 = 20;

umi_tests::on_every_board! {
    tells_who_it_is
    takes_checks_and_refuses_jobs
    judges_the_golden_session_bit_for_bit
    stops_within_ten_characters
    refuses_a_damaged_setup
    a_touch_takes_an_unread_correction_back
    refuses_text_that_was_not_probed
    latches_skips_and_triggers_with_their_positions
    sums_up_a_scan_after_a_quiet_second
    sends_pulses_along_an_axis
    switches_the_laser_off_with_its_host
    keeps_job_reference_and_journal_without_power
    serves_whoever_comes_after_a_broken_frame
    understands_what_follows_garbage
    loses_no_byte_whatever_the_host_does
    keeps_programs_whole_whatever_happens_to_an_upload
    lets_the_control_go_after_a_reset
    closes_the_ways_to_a_wrong_correction
}

/// It says which board it is, and begins with nothing but the fact that it was switched on.
fn tells_who_it_is(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let identity = client.identity().unwrap();
    assert_eq!(identity.board, rig.name());
    assert!(!identity.serial.is_empty() && !identity.firmware.is_empty());
    assert!(client.board().starts_with(identity.board.as_str()));
    let status = client.status().unwrap();
    assert_eq!((status.job, status.journal_failures), (None, 0));
    assert_eq!(status.reset, ResetReason::PowerOn);
    assert_eq!(status.latches, Default::default());
    let (mut records, _) = journal(&mut client);
    // A board with a key signs behind its start; one that was on before says that it has no job.
    records.retain(|record| !matches!(record, Record::Head(_) | Record::JobLost { .. }));
    let reset = status.reset;
    let boot = Record::Boot { identity, reset };
    assert!(records.iter().all(|record| *record == boot), "{records:?}");
    assert_eq!(records.last(), Some(&boot));
}

/// A job that cannot be used is named and changes nothing; one that can is in force as it
/// was sent.
fn takes_checks_and_refuses_jobs(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let mut bad = job();
    bad.limits.rms_mm = -1.0;
    assert_eq!(client.check_job(&job()).unwrap(), Ok(()));
    assert_eq!(client.job().unwrap().job, None);
    client.set_job(&job()).unwrap().unwrap();
    for refused in [client.check_job(&bad), client.set_job(&bad)] {
        assert_eq!(refused.unwrap().unwrap_err().code(), "bad_value");
    }
    assert_eq!(client.job().unwrap().job, Some(job()));
}

/// The reference session: every figure and verdict the same to the last bit as on the
/// host, the correction once for each OK verdict, the outputs, and a journal that has
/// every byte and replays to itself; within the board's budget of stack.
fn judges_the_golden_session_bit_for_bit(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    client.set_job(&job()).unwrap().unwrap();
    let mut bytes = 0;
    for case in 0..5 {
        let text = clamping(case);
        let (begin, end) = text.split_at(200);
        rig.control_sends(begin.as_bytes());
        until(rig, "busy", |rig| rig.lights().busy.then_some(()));
        rig.control_sends(end.as_bytes());
        let verdicts = u32::try_from(case + 1).unwrap();
        let status = judged(rig, &mut client, verdicts);
        assert_eq!(status.verdicts_ok, verdicts, "{status:?}");
        until(rig, "OK", |rig| {
            let lights = rig.lights();
            (lights.ok && !lights.busy && !lights.ng && !lights.trouble).then_some(())
        });
        let verdict = client.verdict().unwrap().unwrap();
        rig.control_sends(DC1);
        let program = verdict.correction.map(|c| c.text.as_str().to_owned());
        let program = program.unwrap_or_else(|| alarm_for(&Withheld::OnlyTaught));
        assert_eq!(receive(rig, program.len()), program);
        bytes += text.len() + 1;
    }
    until(rig, "the end of the program", |_| {
        let status = client.status().unwrap();
        (!status.correction_waiting).then_some(())
    });
    rig.control_sends(DC1);
    // A correction goes out once.
    receive_text(rig, &alarm_for(&Withheld::CorrectionGone));
    let (records, findings) = journal_with(rig, &mut client, bytes + 1);
    let decided = records
        .iter()
        .filter(|r| matches!(r, Record::Feature(_) | Record::Verdict(_)));
    assert!(decided.eq(decisions(SESSION).iter()));
    let sent = records.iter().filter_map(|record| match record {
        Record::CorrectionSent {
            setup, complete, ..
        } => Some((*setup, *complete)),
        _ => None,
    });
    assert!(sent.eq((1..5).map(|setup| (setup, true))));
    let heard = raw_bytes(&records);
    let heard = heard.iter().filter(|byte| **byte != DC1[0]);
    assert!(heard.eq(SESSION.as_bytes()), "every byte");
    assert_eq!(findings.differences, []);
    if let Some((needed, budget)) = rig.stack_bytes() {
        println!("{}: {needed} bytes of stack", rig.name());
        assert!(needed <= budget, "{needed} bytes of stack, not {budget}");
        let least = budget / 4 * 3;
        assert!(needed >= least, "{needed} bytes of stack: lower the budget");
    }
}

/// XOFF stops the program within ten characters, wherever it is said; after XON the rest
/// comes, and nothing twice.
fn stops_within_ten_characters(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let mut text = measure_two(rig, &mut client).correction.unwrap().text;
    let stops: &[usize] = if rig.slowness() > 1 {
        &[100]
    } else {
        &[1, 57, 100, 201]
    };
    for (round, stop) in (3..).zip(stops) {
        let mut got = stopped(rig, DC1, *stop);
        rig.control_sends(DC1);
        got += &receive(rig, text.len() - got.len());
        assert_eq!(got, text.as_str(), "stopped at {stop}");
        // Each program goes out once: measure again for the next.
        if stops.len() > 1 {
            rig.control_sends(clamping(1 + round % 2).as_bytes());
            judged(rig, &mut client, u32::try_from(round).unwrap());
            text = client.verdict().unwrap().unwrap().correction.unwrap().text;
        }
    }
    assert_eq!(receive_all(rig), "");
}

/// Blocks without run numbers: a correction that nobody has read does not wait for the setup that
/// is being probed next, of which nothing may come.
fn a_touch_takes_an_unread_correction_back(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    measure_two(rig, &mut client);
    assert!(client.status().unwrap().correction_waiting);
    rig.skip();
    until(rig, "the touch", |_| {
        let status = client.status().unwrap();
        (!status.correction_waiting).then_some(())
    });
    rig.control_sends(DC1);
    receive_text(rig, &alarm());
}

/// Skip line and text, no encoders: a setup whose blocks had their touches is OK; one that is only
/// printed, as a recording, is NG.
fn refuses_text_that_was_not_probed(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let mut job = job();
    job.skip = SkipSpec {
        // A rig's pulses are as short as its board can see.
        min_width_us: Some(0),
        hold_off_ms: Some(1),
        each_hit: true,
        ..SkipSpec::default()
    };
    client.set_job(&job).unwrap().unwrap();
    let text = clamping(0);
    let starts: Vec<usize> = text.match_indices("SPHERE").map(|(at, _)| at).collect();
    assert_eq!(starts.len(), 3);
    let ends = starts.iter().skip(1).copied().chain([text.len()]);
    for (block, (start, end)) in (1..).zip(starts.iter().zip(ends)) {
        for hit in 0..5 {
            let skips = (block - 1) * 5 + hit + 1;
            // From hit to hit: longer than the hold-off.
            rig.move_to(&[i64::from(skips); 3]);
            rig.skip();
            until(rig, "the touch", |_| {
                let status = client.status().unwrap();
                (status.latches.skips == skips).then_some(())
            });
        }
        rig.control_sends(&text.as_bytes()[*start..end]);
        until(rig, "the block", |_| {
            let (records, _) = journal(&mut client);
            let features = records.iter().filter(|r| matches!(r, Record::Feature(_)));
            (features.count() == block as usize).then_some(())
        });
    }
    let status = judged(rig, &mut client, 1);
    assert_eq!(status.verdicts_ok, 1, "{:?}", client.verdict());
    rig.control_sends(clamping(1).as_bytes());
    let status = judged(rig, &mut client, 2);
    assert_eq!(status.verdicts_ok, 1);
    let verdict = client.verdict().unwrap().unwrap();
    let codes: Vec<_> = verdict.reasons.iter().map(|r| r.reason.code()).collect();
    assert_eq!(codes, ["untouched"; 3]);
    rig.control_sends(DC1);
    receive_text(rig, &alarm());
}

/// A line of a setup is damaged: NG with its reason, and READ gets an alarm.
fn refuses_a_damaged_setup(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    client.set_job(&job()).unwrap().unwrap();
    let damaged = clamping(1).replacen("*-", "*Q", 1);
    rig.control_sends((clamping(0) + &damaged).as_bytes());
    let status = judged(rig, &mut client, 2);
    assert_eq!((status.verdicts, status.verdicts_ok), (2, 1));
    let verdict = client.verdict().unwrap().unwrap();
    let codes: Vec<_> = verdict.reasons.iter().map(|r| r.reason.code()).collect();
    assert!(codes.contains(&"damaged_line"), "{codes:?}");
    assert_eq!(verdict.correction, None);
    until(rig, "NG", |rig| {
        let lights = rig.lights();
        (lights.ng && !lights.ok && !lights.busy).then_some(())
    });
    rig.control_sends(DC1);
    receive_text(rig, &alarm());
}

/// The next latches that the host is told of, one by one.
fn told(rig: &mut dyn Rig, client: &mut Client, count: usize) -> Vec<LatchReport> {
    let mut latches = Vec::new();
    let turn = Duration::from_millis(20);
    until(rig, "the last latch", |_| {
        if let Some(Event::Latches(batch)) = client.next_event(turn).unwrap() {
            latches.extend(batch.reports());
        }
        (latches.len() >= count).then_some(())
    });
    latches
}

/// Each edge is captured with the axes' positions: the probe's in the journal, a
/// scanner's told as they come; numbered, in order, none missed.
fn latches_skips_and_triggers_with_their_positions(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    client.live(true).unwrap();
    let places = [[1000, -2000, 300], [1500, -1990, 300], [-5, 7, 0]];
    let mut t_ns = 0;
    for (number, place) in (0..).zip(&places) {
        rig.move_to(place);
        rig.skip();
        rig.trigger();
        let latch = told(rig, &mut client, 1).remove(0);
        assert_eq!((latch.number, latch.missed), (number, 0));
        assert_eq!(latch.cause, LatchCause::Trigger);
        assert_eq!(latch.counts[..3], *place);
        let positions = client.positions().unwrap();
        assert_eq!(positions.counts[..3], *place);
        assert!(t_ns < latch.t_ns && latch.t_ns <= positions.t_ns);
        assert!(positions.illegal.iter().all(|count| *count == 0));
        assert_eq!(positions.lost_samples, 0);
        t_ns = positions.t_ns;
    }
    let status = until(rig, "three skips", |_| {
        Some(client.status().unwrap()).filter(|status| status.latches.skips == 3)
    });
    assert_eq!((status.latches.triggers, status.latches.missed), (3, 0));
    let latches = until(rig, "the last skip", |_| {
        let (records, _) = journal(&mut client);
        let latches = records.into_iter().filter_map(|record| match record {
            Record::Latch(latch) => Some(latch),
            _ => None,
        });
        let latches: Vec<_> = latches.collect();
        (latches.len() == 3).then_some(latches)
    });
    for ((number, place), latch) in (0..).zip(places).zip(latches) {
        assert_eq!((latch.number, latch.missed), (number, 0));
        assert_eq!(latch.cause, LatchCause::Skip);
        assert_eq!(latch.counts[..3], place);
    }
}

/// A scan whose triggers stay away for a second is one record in the journal, which has
/// counted them all.
fn sums_up_a_scan_after_a_quiet_second(rig: &mut dyn Rig) {
    const TRIGGERS: u32 = 5;
    let mut client = connect(rig);
    for _ in 0..TRIGGERS {
        rig.trigger();
    }
    let told = client.positions().unwrap().t_ns;
    let scans = until(rig, "the scan's record", |_| {
        // Nothing else is journaled but the start. One scan, unless this machine was so
        // busy that a second passed between two triggers.
        let _ = Some(client.journal_info().unwrap()).filter(|info| info.next_seq > 1)?;
        let (records, _) = journal(&mut client);
        let scans = records.into_iter().filter_map(|record| match record {
            Record::Scan(scan) => Some(scan),
            _ => None,
        });
        let scans: Vec<_> = scans.collect();
        let captured: u32 = scans.iter().map(|scan| scan.captured).sum();
        (captured >= TRIGGERS).then_some(scans)
    });
    let (mut next, mut t_ns) = (0, 0);
    for scan in scans {
        assert_eq!((scan.cause, scan.first), (LatchCause::Trigger, next));
        assert_eq!((scan.missed, scan.untold), (0, 0), "nobody listened");
        assert!(t_ns < scan.from_ns && scan.from_ns <= scan.to_ns);
        (next, t_ns) = (next + scan.captured, scan.to_ns);
    }
    assert!(next == TRIGGERS && t_ns <= told);
    assert!(client.positions().unwrap().t_ns >= t_ns + 1_000_000_000);
}

/// Pulses along an axis are latched where the axis crosses the lines, up and down; none
/// come after their end. A board without that output says so, and sends none.
fn sends_pulses_along_an_axis(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    client.live(true).unwrap();
    let along_x = TriggerOut::Distance {
        axis: 0,
        interval_counts: 2000,
        pulse: TriggerPulse::default(),
    };
    let set = client.trigger_out(along_x).unwrap();
    let can = set.is_ok();
    if rig.name() == "mps2-an500" {
        assert_eq!(set, Err(TriggerRefusal::NoOutput));
        // What it is not doing it can end.
        assert_eq!(client.trigger_out(TriggerOut::Off).unwrap(), Ok(()));
    } else {
        assert_eq!(set, Ok(()));
    }
    rig.move_to(&[11_000, 0, 0]);
    if can {
        let latches = told(rig, &mut client, 5);
        for (line, latch) in (1..).zip(&latches) {
            assert_eq!((latch.cause, latch.missed), (LatchCause::Output, 0));
            let off = latch.counts[0] - 2000 * line;
            // It takes its time to begin the pulse, and the axis is fast.
            assert!(off.abs() <= LAG_COUNTS, "{off} counts from line {line}");
        }
        assert_eq!(client.trigger_out(TriggerOut::Off).unwrap(), Ok(()));
    }
    let before = client.status().unwrap().latches.outputs;
    rig.move_to(&[0, 0, 0]);
    assert_eq!(client.status().unwrap().latches.outputs, before);
    assert_eq!(before, if can { 5 } else { 0 });
    if can {
        for (when, why) in impossible_pulses() {
            assert_eq!(client.trigger_out(when).unwrap(), Err(why), "{when:?}");
        }
    }
}

/// What no board sends, and why.
fn impossible_pulses() -> [(TriggerOut, TriggerRefusal); 4] {
    let pulse = |width_us| TriggerPulse {
        width_us,
        ..TriggerPulse::default()
    };
    let along = |axis, width_us| TriggerOut::Distance {
        axis,
        interval_counts: 2000,
        pulse: pulse(width_us),
    };
    let every = |interval_us, width_us| TriggerOut::Time {
        interval_us,
        pulse: pulse(width_us),
    };
    let width = TriggerRefusal::PulseWidth {
        least_us: 1,
        most_us: 1000,
    };
    [
        (along(77, 20), TriggerRefusal::NoAxis),
        (along(0, 0), width),
        (every(5000, 1001), width),
        (
            every(1000, 990),
            TriggerRefusal::PulseTooLong { most_us: 980 },
        ),
    ]
}

/// The laser is on as long as the host that wants it is there.
fn switches_the_laser_off_with_its_host(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    assert!(!rig.laser_is_on());
    assert!(client.laser(true).unwrap());
    until(rig, "the laser", |rig| rig.laser_is_on().then_some(()));
    rig.unplug();
    until(rig, "darkness", |rig| (!rig.laser_is_on()).then_some(()));
    drop(client);
    let mut client = connect(rig);
    assert!(client.laser(true).unwrap());
    until(rig, "the laser", |rig| rig.laser_is_on().then_some(()));
    assert!(client.laser(false).unwrap());
    until(rig, "darkness", |rig| (!rig.laser_is_on()).then_some(()));
}

/// Power off and on: job, taught reference and journal are there, and the next clamping
/// is registered as if nothing had been. The audit spans the power cut. Another one, while the
/// correction is on its way: the journal says that it had begun, and no more of it.
fn keeps_job_reference_and_journal_without_power(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let is_boot = |record: &&Record| matches!(record, Record::Boot { .. });
    let boots = journal(&mut client).0.iter().filter(is_boot).count();
    client.set_job(&job()).unwrap().unwrap();
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, &mut client, 1);
    let taught = client.job().unwrap().taught_mm;
    assert!(taught.is_some());
    drop(client);
    rig.power_cycle();

    let mut client = connect(rig);
    let in_force = client.job().unwrap();
    assert_eq!(in_force.job, Some(job()));
    assert_eq!(in_force.taught_mm, taught);
    rig.control_sends(clamping(1).as_bytes());
    judged(rig, &mut client, 1);
    let verdict = client.verdict().unwrap().unwrap();
    assert!(verdict.ok && verdict.correction.is_some(), "{verdict:?}");
    let (records, findings) = journal(&mut client);
    assert_eq!(findings.differences, []);
    // Two times three features and a verdict, and the reference.
    assert_eq!(findings.identical, 2 * 4 + 1);
    assert_eq!(records.iter().filter(is_boot).count(), boots + 1);

    let _ = stopped(rig, DC1, 100);
    drop(client);
    rig.power_cycle();
    let (records, findings) = journal(&mut connect(rig));
    assert_eq!(findings.differences, []);
    let sent = records.iter().filter(|of| {
        matches!(
            of,
            Record::CorrectionBegun { .. } | Record::CorrectionSent { .. }
        )
    });
    let begun = Record::CorrectionBegun {
        setup: verdict.setup,
    };
    assert!(sent.eq([&begun]));
}

/// A host that goes in the middle of a frame leaves nothing behind: the next one is
/// served, and without events that it has not asked for.
fn serves_whoever_comes_after_a_broken_frame(rig: &mut dyn Rig) {
    let mut frame = [0; MAX_HOST_FRAME];
    let frame = encode(1, &Request::JobSet(job()), &mut frame).unwrap();
    for cut in [1, frame.len() / 2, frame.len() - 1] {
        let mut client = connect(rig);
        client.live(true).unwrap();
        drop(client);
        let mut host = rig.connect();
        host.write(&frame[..cut]).unwrap();
        // It takes its time over the cable.
        let there = rig.time() + Duration::from_millis(5);
        until(rig, "the frame's start", |rig| {
            (rig.time() > there).then_some(())
        });
        rig.unplug();
        drop(host);
        let mut client = connect(rig);
        assert_eq!(client.job().unwrap().job, None);
        rig.control_sends(b"\r\n");
        let turn = patience(rig, Duration::from_millis(20));
        let event = client.next_event(turn).unwrap();
        assert_eq!(event, None);
    }
}

/// Garbage at either port is named or counted, and what follows is understood.
fn understands_what_follows_garbage(rig: &mut dyn Rig) {
    let noise: Vec<u8> = (0..600_u32)
        .map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8)
        .collect();
    let mut host = rig.connect();
    host.write(&noise).unwrap();
    // A greeting of another version is answered by who the board is, not obeyed.
    let mut frame = [0; MAX_HOST_FRAME];
    let hello = encode(0, &Hello::new("somebody"), &mut frame).unwrap();
    host.write(&hello[..hello.len() - 3]).unwrap();
    drop(host);
    let mut client = connect(rig);
    client.set_job(&job()).unwrap().unwrap();
    rig.control_sends(&noise);
    // Noise may look like XOFF, a port that opens, or the start of a program.
    rig.control_sends(b"\r\n%\r\n\x14\r\n");
    // The first setup has to outvote the noise about the code, and is lost. What came of it
    // began in the middle of the order: the control's READ says where the next one begins.
    let setups = clamping(2) + "READ O9010\r\n" + &clamping(0) + &clamping(1);
    rig.control_sends(setups.as_bytes());
    let verdict = until(rig, "two verdicts OK", |_| {
        let ok = client.status().unwrap().verdicts_ok;
        (ok >= 2).then(|| client.verdict().unwrap().unwrap())
    });
    assert!(verdict.ok && verdict.correction.is_some(), "{verdict:?}");
    let (records, findings) = journal(&mut client);
    assert!(raw_bytes(&records).starts_with(&noise));
    assert_eq!(findings.differences, []);
}

/// No host, one that asks without a pause, and one that floods, wants events, never reads
/// and loses its cable in the middle, with triggers running: the journal has every byte of
/// the control all the same, no trigger is lost and the verdicts are right.
fn loses_no_byte_whatever_the_host_does(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    client.set_job(&job()).unwrap().unwrap();
    drop(client);
    rig.unplug();
    rig.control_sends(clamping(0).as_bytes());

    let mut asking = connect(rig);
    for piece in clamping(1).as_bytes().chunks(64) {
        rig.control_sends(piece);
        asking.status().unwrap();
        asking.positions().unwrap();
    }
    asking.live(true).unwrap();
    drop(asking);

    let text = clamping(2);
    let (before, after) = text.split_at(text.len() / 2);
    let mut flood = rig.connect();
    let (mut flooded, mut triggers) = (0, 0);
    for piece in before.as_bytes().chunks(64) {
        // A board that cannot get rid of its events may stop to listen.
        flooded += flood.write(&[0x55; 100]).map_or(0, |()| 100);
        rig.control_sends(piece);
        rig.trigger();
        triggers += 1;
    }
    assert!(flooded > 0, "nothing of the flood came through");
    rig.unplug();
    drop(flood);
    for piece in after.as_bytes().chunks(64) {
        rig.control_sends(piece);
        rig.trigger();
        triggers += 1;
    }

    let mut client = connect(rig);
    let text: String = (0..3).map(clamping).collect();
    let (records, findings) = journal_with(rig, &mut client, text.len());
    assert_eq!(raw_bytes(&records), text.as_bytes());
    let status = judged(rig, &mut client, 3);
    assert_eq!((status.verdicts, status.verdicts_ok), (3, 3));
    assert_eq!(status.counters.bytes_lost, 0);
    assert_eq!(
        (status.latches.triggers, status.latches.missed),
        (triggers, 0)
    );
    assert_eq!(findings.differences, []);
}

/// A program of so many bytes for the board's flash.
fn program(number: u32, bytes: usize) -> (ProgramInfo, Vec<u8>) {
    let mut text = format!("%\nO{number:04}(PART)\nG21 G90\n");
    for line in 0_u32.. {
        text += &format!("N{line} G1 X{}. Y-{}.5 F500\n", line % 97, line % 89);
        if text.len() >= bytes {
            break;
        }
    }
    text += "M30\n%\n";
    let info = ProgramInfo {
        number,
        name: "PART".parse().unwrap(),
        bytes: u32::try_from(text.len()).unwrap(),
        crc32: programs::check_value(text.as_bytes()),
        release: Release::Always,
        hold_s: 5,
        stated: Stated::default(),
    };
    (info, text.into_bytes())
}

/// An upload that the power ends leaves the old program, and goes on where it was; while a
/// setup is measured there is none. What is there comes back byte for byte.
fn keeps_programs_whole_whatever_happens_to_an_upload(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let (old, old_bytes) = program(1234, 700);
    programs::put(&mut client, &old, &old_bytes, |_| {}).unwrap();
    let (new, new_bytes) = program(1234, 10_000);
    let mut at = client.program_begin(&new).unwrap().unwrap();
    while at < 9000 {
        let piece = &new_bytes[at as usize..][..500];
        let piece = piece.iter().copied().collect();
        at = client.program_piece(at, piece).unwrap().unwrap();
    }
    drop(client);
    rig.power_cycle();

    let mut client = connect(rig);
    let (room, kept) = programs::list(&mut client).unwrap();
    assert_eq!((room.programs, kept.as_slice()), (1, &[old.clone()][..]));
    let got = programs::get(&mut client, &old, |_| {}).unwrap();
    assert_eq!(got, old_bytes);
    client.set_job(&job()).unwrap().unwrap();
    rig.control_sends(&clamping(0).as_bytes()[..200]);
    until(rig, "busy", |rig| rig.lights().busy.then_some(()));
    let busy = client.program_begin(&new).unwrap();
    assert_eq!(busy, Err(ProgramRefusal::Busy));
    rig.control_sends(&clamping(0).as_bytes()[200..]);
    judged(rig, &mut client, 1);

    let mut went_on_at = None;
    programs::put(&mut client, &new, &new_bytes, |at| {
        went_on_at.get_or_insert(at);
    })
    .unwrap();
    assert!(went_on_at.is_some_and(|at| at > 4000), "{went_on_at:?}");
    let got = programs::get(&mut client, &new, |_| {}).unwrap();
    assert_eq!(got, new_bytes);
    programs::delete(&mut client, 1234).unwrap();
    let (room, kept) = programs::list(&mut client).unwrap();
    assert_eq!((room.programs, kept), (0, vec![]));
    let gone = client.program_read(1234, 0).unwrap();
    assert_eq!(gone, Err(ProgramRefusal::NotThere));
    let (records, findings) = journal(&mut client);
    let kept = records.iter().filter_map(|record| match record {
        Record::ProgramKept { program, .. } => Some(program),
        _ => None,
    });
    assert!(kept.eq([&old, &new]));
    let (number, crc32) = (new.number, new.crc32);
    assert!(records.contains(&Record::ProgramDeleted {
        number,
        crc32,
        key_id: None
    }));
    assert_eq!(findings.differences, []);
}

/// A control may stand held when the board is reset. It is let go by the board alone: no host
/// is there, and the control cannot say anything.
fn lets_the_control_go_after_a_reset(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let mut job = job();
    job.receiver.handshake = Handshake::XonXoff;
    client.set_job(&job).unwrap().unwrap();
    assert_eq!(receive(rig, 1), "\x11");
    drop(client);
    rig.power_cycle();
    let soon = Duration::from_millis(100);
    let said = until(rig, "XON", |rig| rig.control_receives(soon));
    assert_eq!(said, 0x11);
    assert_eq!(receive_all(rig), "");
}

/// Late text, lost text, a moved offset, another order, teaching again, an early top, a bent
/// stylus, each through the shipped macros: every board says what the page in the
/// documentation has, word for word, and no correction goes where it is not right.
fn closes_the_ways_to_a_wrong_correction(rig: &mut dyn Rig) {
    // The emulated boards take a minute and a half for all of them: they have the first, and those without run numbers.
    let chosen = match rig.name() {
        "virtual" => ALL,
        _ => |number| number <= 5 || number >= 40,
    };
    closes_ways(rig, chosen);
}

const ALL: fn(usize) -> bool = |_| true;

#[test]
#[ignore = "minutes of emulation"]
fn every_way_is_closed_on_the_emulated_pico() {
    if let Some(mut rig) = umi_tests::rig::PicoRig::start_or_skip() {
        closes_ways(&mut rig, ALL);
    }
}

#[test]
#[ignore = "minutes of emulation"]
fn every_way_is_closed_in_qemu() {
    if let Some(mut rig) = umi_tests::rig::QemuRig::start_or_skip() {
        closes_ways(&mut rig, ALL);
    }
}

fn closes_ways(rig: &mut dyn Rig, chosen: fn(usize) -> bool) {
    let page = umi_tests::ways::page(rig, chosen);
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/closed-ways.md");
    let kept = std::fs::read_to_string(path).unwrap_or_default();
    let (head, listed) = kept.split_once("\n1. ").unwrap_or((&kept, ""));
    if std::env::var_os("UMI_BLESS").is_some_and(|value| value == "1") && rig.name() == "virtual" {
        std::fs::write(path, format!("{}\n{page}", head.trim_end())).unwrap();
        return;
    }
    let listed = format!("1. {listed}");
    let is_head = |line: &str| line.starts_with(|first: char| first.is_ascii_digit());
    let mut number = 0;
    let of_these: String = listed
        .split_inclusive('\n')
        .filter(|line| {
            number += usize::from(is_head(line));
            chosen(number)
        })
        .collect();
    assert_eq!(page.trim(), of_these.trim());
}
