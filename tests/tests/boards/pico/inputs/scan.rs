//! A line scan with the board's image on an emulated Pico: pulses with their signature up to 10 kHz, while all
//! axes move; what a real line loses is lost, and every profile finds its latch.

use std::time::{Duration, Instant};

use serde_json::json;
use umi_client::board::link::Client;
use umi_desk::pulsed::{SIGNATURE_TENTHS, STRETCH_PULSES};
use umi_protocol::latch::{LatchCause, LatchReport, TriggerOut, TriggerPulse};
use umi_protocol::message::Event;
use umi_scan::format::triggers::{LatchSignal, TriggerLatch, Triggers};
use umi_scan::pair::{PairOptions, pair};
use umi_scan::profile::Stamp;
use umi_tests::rig::pico::{AXES, CYCLES_PER_US, PicoRig, Segment};
use umi_virtual::random::Random;

const PULSE_PIN: u8 = 22;
/// 10 kHz.
const INTERVAL_US: u32 = 100;
/// Pulses of the even train.
const PULSES: u64 = 1500;
/// A million counts a second.
const FAST: f64 = 125.0;
/// How long the wall may take.
const PATIENCE: Duration = Duration::from_secs(900);

/// Lets so much of the board's time pass, and takes what the board tells meanwhile.
fn pass(rig: &mut PicoRig, client: &mut Client, us: u64, latches: &mut Vec<LatchReport>) {
    let end = rig.emulator().state().cycle + us * CYCLES_PER_US;
    let begun = Instant::now();
    while rig.emulator().state().cycle < end {
        assert!(begun.elapsed() < PATIENCE, "the board's time stands still");
        match client.next_event(Duration::from_millis(20)).unwrap() {
            Some(Event::Latches(batch)) => latches.extend(batch.reports()),
            Some(Event::Dropped { count }) => panic!("{count} events dropped"),
            _ => {}
        }
    }
}

#[test]
fn a_scan_of_which_frames_and_latches_are_lost_is_paired_rightly() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = rig.client();
    client.live(true).unwrap();
    let origins = rig.emulator().axes();
    let origins: Vec<i64> = origins.iter().map(|axis| axis.position).collect();
    let paces: Vec<f64> = (0..AXES)
        .map(|axis| FAST * (1.0 + 0.0037 * axis as f64))
        .collect();
    // Longer than the scan, also where the link is slow.
    let begins: Vec<f64> = (0..AXES)
        .map(|axis| {
            let way = if axis % 2 == 0 { 1 } else { -1 } * 4_000_000;
            let motion = [Segment::steady(way, paces[axis])];
            rig.emulator().start_axis(axis, &motion, &json!({})) as f64
        })
        .collect();

    let mut latches = Vec::new();
    let intervals = SIGNATURE_TENTHS.map(|tenths| INTERVAL_US * tenths / 10);
    rig.emulator().outputs();
    for interval_us in intervals.into_iter().chain([INTERVAL_US]) {
        let pulse = TriggerPulse::default();
        let every = TriggerOut::Time { interval_us, pulse };
        assert_eq!(client.trigger_out(every).unwrap(), Ok(()));
        let stretch_us = u64::from(interval_us * STRETCH_PULSES);
        pass(&mut rig, &mut client, stretch_us, &mut latches);
    }
    let train_us = PULSES * u64::from(INTERVAL_US);
    pass(&mut rig, &mut client, train_us, &mut latches);
    assert_eq!(client.trigger_out(TriggerOut::Off).unwrap(), Ok(()));
    pass(&mut rig, &mut client, 200_000, &mut latches);
    let outputs = rig.emulator().outputs();
    let rises = outputs.iter().filter(|output| output.pin == PULSE_PIN);
    let rises: Vec<u64> = rises.filter(|of| of.level).map(|of| of.cycle).collect();

    // Every pulse is told, with the position of every axis at its edge.
    assert!(rises.len() as u64 > PULSES);
    let counters = client.status().unwrap().latches;
    assert_eq!((counters.missed, counters.untold), (0, 0));
    assert_eq!(latches.len(), rises.len());
    for (number, (latch, rise)) in (0..).zip(latches.iter().zip(&rises)) {
        assert_eq!(
            (latch.cause, latch.number, latch.missed),
            (LatchCause::Output, number, 0)
        );
        for axis in 0..AXES {
            let way = ((*rise as f64 - begins[axis]) / paces[axis]).floor();
            let way = if axis % 2 == 0 { way } else { -way } as i64;
            let off = latch.counts[axis] - origins[axis] - way;
            assert!(off.abs() <= 2, "axis {axis} at pulse {number}: {off}");
        }
    }

    // The sensor misses pulses, the network frames and the link latches; the first ones above all.
    let mut random = Random::new(14);
    let mut one_in = |count: f64| random.between(0.0, count) < 1.0;
    let (mut stamps, mut pulse_of, mut frame) = (Vec::new(), Vec::new(), 7);
    for (pulse, rise) in rises.iter().enumerate() {
        if one_in(40.0) {
            continue;
        }
        frame += 1;
        if pulse < 5 || one_in(30.0) {
            continue;
        }
        let board_us = *rise as f64 / CYCLES_PER_US as f64;
        stamps.push(Stamp {
            profile: stamps.len() as u64,
            frame,
            t_us: 5_000_000.25 + board_us * (1.0 - 60e-6) + (pulse % 7) as f64 * 0.3,
            encoder: None,
        });
        pulse_of.push(pulse as u64);
    }
    let mut kept = latches.clone();
    kept.retain(|_| !one_in(25.0));
    let triggers = Triggers {
        cause: LatchSignal::Output,
        latches: kept
            .iter()
            .map(|latch| TriggerLatch {
                number: latch.number.into(),
                t_ns: latch.t_ns as i64,
                counts: std::array::from_fn(|axis| latch.counts.get(axis).copied()),
            })
            .collect(),
        missed: (latches.len() - kept.len()) as u64,
        lost_runs: Vec::new(),
        right_until_ns: None,
    };
    let paired = pair(&stamps, &triggers, &PairOptions::default()).unwrap();
    for of in &paired.pairs {
        assert_eq!(of.number, pulse_of[of.profile as usize], "{of:?}");
    }
    let due = pulse_of
        .iter()
        .filter(|pulse| kept.iter().any(|latch| u64::from(latch.number) == **pulse));
    let due = due.count();
    println!(
        "{} pulses, {} profiles, {due} of them with a latch",
        rises.len(),
        stamps.len()
    );
    assert_eq!(paired.pairs.len(), due);
}
