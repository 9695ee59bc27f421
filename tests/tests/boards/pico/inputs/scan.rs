//! A line scan with the board's image on an emulated Pico: pulses with their signature up to 10 kHz, while all axes
//! move; the virtual sensor's stream and the board's table become points. What a real line loses is lost: pulses,
//! profiles and messages.

use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::time::{Duration, Instant};

use serde_json::json;
use umi_client::axes::Scale;
use umi_client::board::link::Client;
use umi_client::timeline::{Follower, table};
use umi_desk::pulsed::{SIGNATURE_TENTHS, STRETCH_PULSES};
use umi_kinematics::AxisChain;
use umi_protocol::latch::{LatchBatch, LatchCause, LatchReport, TriggerOut, TriggerPulse};
use umi_protocol::message::Event;
use umi_scan::ScanError;
use umi_scan::format::points::PointSink;
use umi_scan::format::triggers;
use umi_scan::merge::{MergeOptions, merge};
use umi_tests::rig::pico::{AXES, CYCLES_PER_US, PicoRig, Segment};
use umi_virtual::random::Random;
use umi_virtual::scanner::{LineProfile, LineSample, LineScanner, PulseFate};
use umi_virtual::scene::LineScannerSpec;

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
fn pass(rig: &mut PicoRig, client: &mut Client, us: u64, messages: &mut Vec<LatchBatch>) {
    let end = rig.emulator().state().cycle + us * CYCLES_PER_US;
    let begun = Instant::now();
    while rig.emulator().state().cycle < end {
        assert!(begun.elapsed() < PATIENCE, "the board's time stands still");
        match client.next_event(Duration::from_millis(20)).unwrap() {
            Some(Event::Latches(batch)) => messages.push(batch),
            Some(Event::Dropped { count }) => panic!("{count} events dropped"),
            _ => {}
        }
    }
}

#[test]
fn a_scan_of_which_frames_and_latches_are_lost_becomes_the_right_points() {
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

    let mut messages = Vec::new();
    let intervals = SIGNATURE_TENTHS.map(|tenths| INTERVAL_US * tenths / 10);
    rig.emulator().outputs();
    for interval_us in intervals.into_iter().chain([INTERVAL_US]) {
        let pulse = TriggerPulse::default();
        let every = TriggerOut::Time { interval_us, pulse };
        assert_eq!(client.trigger_out(every).unwrap(), Ok(()));
        let stretch_us = u64::from(interval_us * STRETCH_PULSES);
        pass(&mut rig, &mut client, stretch_us, &mut messages);
    }
    let train_us = PULSES * u64::from(INTERVAL_US);
    pass(&mut rig, &mut client, train_us, &mut messages);
    assert_eq!(client.trigger_out(TriggerOut::Off).unwrap(), Ok(()));
    pass(&mut rig, &mut client, 200_000, &mut messages);
    let outputs = rig.emulator().outputs();
    let rises = outputs.iter().filter(|output| output.pin == PULSE_PIN);
    let rises: Vec<u64> = rises.filter(|of| of.level).map(|of| of.cycle).collect();

    let latches: Vec<LatchReport> = messages.iter().flat_map(LatchBatch::reports).collect();
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

    // The sensor misses pulses that are too short, the network loses its profiles and the link the board's messages; the
    // first profiles above all.
    let mut random = Random::new(14);
    let mut one_in = |count: f64| random.between(0.0, count) < 1.0;
    let mut sensor = LineScanner::new(
        LineScannerSpec {
            samples: COLUMNS as u32,
            busy_us: 0.0,
            clock_offset_us: 5_000_000.25,
            clock_drift_ppm: -60.0,
            lost_share: 0.03,
            repeated_share: 0.02,
            ..LineScannerSpec::preset("gocator").unwrap()
        },
        14,
    );
    // The pulse of each profile that was taken, of each of the capture, and which of these came again.
    let mut taken = Vec::new();
    let (mut capture, mut pulse_of, mut again) = (Vec::new(), Vec::new(), Vec::new());
    for (pulse, rise) in (0_u64..).zip(&rises) {
        let width_us = if one_in(40.0) { 5.0 } else { 50.0 };
        let board_us = *rise as f64 / CYCLES_PER_US as f64;
        if sensor.pulse(board_us, width_us) != PulseFate::Taken {
            continue;
        }
        taken.push(pulse);
        let at_mm: [f64; 3] = std::array::from_fn(|axis| {
            let way = (*rise as f64 - begins[axis]) / paces[axis];
            (if axis % 2 == 0 { way } else { -way }) / COUNTS_PER_MM
        });
        let repeated = sensor.tally().repeated;
        let bytes = sensor.send(board_us + (pulse % 7) as f64 * 0.3, 0, &profile(at_mm));
        if pulse < 5 || bytes.is_empty() {
            continue;
        }
        capture.extend(bytes);
        pulse_of.push(pulse);
        if sensor.tally().repeated > repeated {
            again.push(pulse_of.len() as u64);
            pulse_of.push(pulse);
        }
    }
    // A message has many latches: were more of them lost, two pairings would be as good, and the scan refused.
    let sent = messages.len();
    let mut place = 0..sent;
    messages.retain(|_| place.next().is_some_and(|place| place % 50 != 17));
    let told: Vec<LatchReport> = messages.iter().flat_map(LatchBatch::reports).collect();
    let told_of: BTreeSet<u64> = told.iter().map(|of| of.number.into()).collect();

    let machine = AxisChain::parse(&machine(&origins)).unwrap();
    let folder = std::env::temp_dir().join(format!("umi-pico-scan-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (profiles, table) = (folder.join("profiles.gocator"), folder.join("triggers.csv"));
    std::fs::write(&profiles, capture).unwrap();
    let merged = |latches: &[LatchReport]| {
        std::fs::write(&table, rows(latches)).unwrap();
        let triggers = triggers::read(&table, None).unwrap();
        let mut surface = Surface::default();
        let options = MergeOptions::default();
        let merged = merge(&profiles, &triggers, &machine, &options, &mut surface).unwrap();
        (merged, surface.off_mm)
    };
    let (found, off_mm) = merged(&told);
    // The same with each latch's position one pulse late, as a pairing that is off by one has it.
    let late = |of: &LatchReport| latches.get(of.number as usize + 1).cloned();
    let late = told.iter().map(|of| LatchReport {
        counts: late(of).map_or_else(|| of.counts.clone(), |next| next.counts),
        ..of.clone()
    });
    let (_, late_off_mm) = merged(&late.collect::<Vec<_>>());
    std::fs::remove_dir_all(&folder).unwrap();

    let paired = &found.pairing;
    let first_of =
        |(profile, pulse): (u64, u64)| (!again.contains(&profile)).then_some((profile, pulse));
    let once: Vec<(u64, u64)> = (0..).zip(pulse_of).filter_map(first_of).collect();
    let has_latch = |(_, pulse): &(u64, u64)| told_of.contains(pulse);
    let due: Vec<(u64, u64)> = once.iter().copied().filter(has_latch).collect();
    let without = once.iter().filter(|of| !has_latch(of));
    let without: Vec<u64> = without.map(|(profile, _)| *profile).collect();
    println!(
        "{} pulses, {} profiles, {} of them with a latch; {} of {} messages; {} points, off by {off_mm:.4} mm at most, a \
         pulse late by {late_off_mm:.2}; {:?}",
        rises.len(),
        once.len(),
        due.len(),
        messages.len(),
        sent,
        found.points,
        sensor.tally()
    );
    let pairs: Vec<(u64, u64)> = paired
        .pairs
        .iter()
        .map(|of| (of.profile, of.number))
        .collect();
    assert_eq!(pairs, due);
    // What was lost is named.
    let tally = sensor.tally();
    assert!(tally.lost > 0 && tally.short > 0 && tally.repeated > 0 && !without.is_empty());
    assert_eq!(
        (&paired.duplicates, &paired.unpaired_profiles),
        (&again, &without)
    );
    assert_eq!(paired.missed_latches, (latches.len() - told.len()) as u64);
    let seen: BTreeSet<u64> = once.iter().map(|(_, pulse)| *pulse).collect();
    let unseen = told_of.iter().filter(|number| !seen.contains(number));
    assert_eq!(
        paired.unpaired_triggers,
        unseen.copied().collect::<Vec<_>>()
    );
    let between = taken
        .iter()
        .filter(|pulse| (seen.first()..=seen.last()).contains(&Some(*pulse)));
    assert_eq!(paired.lost_frames, (between.count() - seen.len()) as u64);
    assert_eq!(found.points, (due.len() * COLUMNS) as u64);
    assert!(off_mm < 0.03 && late_off_mm > 0.3, "{off_mm} {late_off_mm}");
}

/// Of a profile.
const COLUMNS: usize = 40;
const COUNTS_PER_MM: f64 = 1000.0;
/// A wave of the surface, and half its height.
const WAVE_MM: [f64; 2] = [4.0, 5.0];

/// The height of the surface: waves on a slope, so that X and Z, which move alike, keep it in the sensor's range.
fn height_mm(x_mm: f64) -> f64 {
    x_mm + WAVE_MM[1] * (TAU * x_mm / WAVE_MM[0]).sin()
}

/// What the sensor sees of it from a place, exactly.
fn profile(at_mm: [f64; 3]) -> LineProfile {
    let sample = |column| {
        let x_mm = column as f64 - 0.5 * COLUMNS as f64;
        LineSample {
            x_mm,
            z_mm: height_mm(at_mm[0] + x_mm) - at_mm[2],
            cosine: 1.0,
            is_false: false,
        }
    };
    (0..COLUMNS).map(|column| Some(sample(column))).collect()
}

/// Three axes that carry the sensor, at 0 where they began.
fn machine(origins: &[i64]) -> String {
    let joint = |axis: usize| {
        let mut direction = [0; 3];
        direction[axis] = 1;
        let name = ["x", "y", "z"][axis];
        format!(
            "[[joint]]\nname = \"{name}\"\nkind = \"linear\"\ndirection = {direction:?}\ncolumn = \"{name}\"\n\
             counts_per_mm = {COUNTS_PER_MM:?}\norigin_counts = {}\n",
            origins[axis]
        )
    };
    let joints: String = (0..3).map(joint).collect();
    joints + "[chain]\nsensor = [\"x\", \"y\", \"z\"]\nworkpiece = []\n"
}

/// The table that `umi events --csv` writes of these latches: gaps in their numbers are losses.
fn rows(latches: &[LatchReport]) -> String {
    let mut follower = Follower::default();
    let mut text = String::from(table::HEADER);
    for latch in latches {
        let batch = LatchBatch {
            first: latch.clone(),
            steps: Default::default(),
        };
        follower.event(Event::Latches(batch), |entry| {
            text += &table::row(&entry, &Scale::default())
        });
    }
    text
}

/// How far points are off the surface at most.
#[derive(Default)]
struct Surface {
    off_mm: f64,
}

impl PointSink for Surface {
    fn profile(&mut self, _profile: u64, points: &[(u32, [f64; 3])]) -> Result<(), ScanError> {
        for (_, [x, _, z]) in points {
            self.off_mm = self.off_mm.max((z - height_mm(*x)).abs());
        }
        Ok(())
    }

    fn finish(&mut self, _points: u64) -> Result<(), ScanError> {
        Ok(())
    }
}
