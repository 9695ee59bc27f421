//! Random scans with random faults: a pairing is right or refused, never wrong.

use std::collections::BTreeMap;

use super::{PairOptions, ScanPairing, pair};
use crate::format::triggers::{LatchSignal, TriggerLatch, Triggers};
use crate::profile::Stamp;
use crate::profile::frames::FrameCounter;

/// A small generator of its own (SplitMix64), so that the scans stay the same for ever.
pub(super) struct Random(pub u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// In 0..1.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn below(&mut self, n: u64) -> u64 {
        self.next() % n
    }

    pub fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }
}

struct Scan {
    stamps: Vec<Stamp>,
    triggers: Triggers,
    options: PairOptions,
    /// (profile, number) that belong together.
    truth: Vec<(u64, u64)>,
    rhythm: Rhythm,
    /// The clocks drift by more than the options allow.
    beyond: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Rhythm {
    Even,
    /// An even train behind uneven pulses, as `umi scan record` begins.
    Signature,
    Uneven,
}

/// Intervals of a signature, as parts of the train's.
pub(super) const SIGNATURE: [f64; 24] = [
    1.7, 1.7, 1.7, 1.437, 1.1, 1.1, 1.1, 2.36, 2.3, 2.3, 2.3, 1.466, 1.3, 1.3, 1.3, 1.96, 1.9, 1.9,
    1.9, 1.74, 1.4, 1.4, 1.4, 2.91,
];

fn scan(random: &mut Random) -> Scan {
    let long = random.chance(0.02);
    let n = 20 + random.below(if long { 3000 } else { 120 });
    let interval_us = [250.0, 1000.0, 5000.0][random.below(3) as usize];
    let rhythm = [Rhythm::Even, Rhythm::Signature, Rhythm::Uneven][random.below(3) as usize];
    let with_encoder = random.chance(0.3);
    let frame_bits = random.chance(0.3).then_some(8);
    // The counter of a third of the others starts anew half-way.
    let restarts = frame_bits.is_none() && n.is_multiple_of(3);
    let fault = random.unit() * 0.08;
    let cause = if random.chance(0.5) {
        LatchSignal::Output
    } else {
        LatchSignal::Trigger
    };
    // Some drift by more than the limit, a little or by far.
    let limit_ppm = if random.chance(0.3) { 20.0 } else { 200.0 };
    let excess = if random.chance(0.3) {
        [1.3, 10.0][random.below(2) as usize]
    } else {
        1.0
    };
    let drift_ppm = (random.unit() * 2.0 - 1.0) * limit_ppm * excess;
    let drift = drift_ppm * 1e-6;
    let offset_us = random.unit() * 1e7;
    let origin = random.below(1_000_000) as i64;
    let mut frame = random.below(300);
    let mut t_us = 1e6 + random.unit() * 1e6;
    let mut counts = 20_000.0;
    let mut speed = 5.0;
    let mut latches = Vec::new();
    let mut stamps: Vec<Stamp> = Vec::new();
    let mut truth = Vec::new();
    let (mut number, mut missed) = (0, 0);
    let (mut lost_runs, mut run) = (Vec::new(), 0);
    for place in 0..n {
        if restarts && place == n / 2 {
            frame = 0;
        }
        t_us += interval_us
            * match rhythm {
                Rhythm::Even => 1.0,
                Rhythm::Signature => SIGNATURE.get(place as usize).copied().unwrap_or(1.0),
                Rhythm::Uneven => 0.6 + 0.8 * random.unit(),
            };
        speed *= 0.97 + 0.08 * random.unit();
        counts += speed;
        // A noise edge, farther than twice the jitter from what it could be taken for.
        if cause == LatchSignal::Trigger && random.chance(fault) {
            latches.push(latch(number, t_us - 0.4 * interval_us, counts));
            number += 1;
        }
        let told = !random.chance(fault);
        let taken = !random.chance(fault);
        if told {
            latches.push(latch(number, t_us, counts));
            lost_runs.push(std::mem::take(&mut run));
        } else {
            missed += 1;
            run += 1;
        }
        if taken {
            frame += 1;
            if random.chance(fault) {
                // The message is lost, the frame was counted.
                number += 1;
                continue;
            }
            let jitter = (random.unit() - 0.5) * 8.0;
            let sensor_us = (t_us + jitter - offset_us) / (1.0 + drift);
            let stamp = Stamp {
                profile: stamps.len() as u64,
                frame: frame_bits.map_or(frame, |bits: u32| frame % (1 << bits)),
                t_us: (sensor_us * 1e3).round() / 1e3,
                encoder: with_encoder.then(|| counts as i64 + origin + random.below(5) as i64 - 2),
            };
            if told {
                truth.push((stamp.profile, number));
            }
            stamps.push(stamp);
            if random.chance(fault) {
                stamps.push(Stamp {
                    profile: stamps.len() as u64,
                    ..stamp
                });
            }
        }
        number += 1;
    }
    lost_runs.push(run);
    lost_runs.retain(|&run| run > 0);
    Scan {
        stamps,
        triggers: Triggers {
            cause,
            latches,
            missed,
            lost_runs,
            right_until_ns: None,
        },
        options: PairOptions {
            counter: match frame_bits {
                Some(bits) => FrameCounter::Bits(bits),
                None if restarts => FrameCounter::Restarts,
                None => FrameCounter::Rises,
            },
            encoder: with_encoder.then_some(0),
            drift_ppm: limit_ppm,
            ..PairOptions::default()
        },
        truth,
        rhythm,
        beyond: drift_ppm.abs() > limit_ppm,
    }
}

pub(super) fn latch(number: u64, t_us: f64, counts: f64) -> TriggerLatch {
    TriggerLatch {
        number,
        t_ns: (t_us * 1e3).round() as i64,
        counts: [Some(counts as i64), None, None, None, None, None],
    }
}

/// 1500 scans, or as many as UMI_SCANS says: 0 wrong pairs, and within the limit of the drift none left out. A
/// third is even: these often must be refused, because they fit in two ways. Of the uneven ones less than 1 % are, but
/// where the clocks drift by more than is allowed.
#[test]
fn random_scans_are_paired_rightly_or_refused() {
    let scans = std::env::var("UMI_SCANS")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(700);
    let mut random = Random(0x5CA7);
    let mut all = BTreeMap::<_, u32>::new();
    let mut refused = BTreeMap::<_, u32>::new();
    for number in 0..scans {
        let scan = scan(&mut random);
        let kind = (scan.rhythm, scan.beyond);
        *all.entry(kind).or_default() += 1;
        let paired = pair(&scan.stamps, &scan.triggers, &scan.options);
        let unit = paired
            .as_ref()
            .err()
            .and_then(|error| error.details.get("factor"));
        assert_eq!(unit, None, "scan {number}: its times are microseconds");
        match paired {
            Ok(pairing) => {
                let told = |what: &str| pairing.warnings.iter().any(|told| told.starts_with(what));
                assert!(
                    !told("clock_jump") && !told("misplaced"),
                    "scan {number}: {:?}",
                    pairing.warnings
                );
                let got = numbers(&pairing);
                if scan.beyond {
                    let wrong = got.iter().find(|pair| !scan.truth.contains(pair));
                    assert_eq!(wrong, None, "scan {number}");
                } else {
                    assert_eq!(got, scan.truth, "scan {number}");
                }
                assert!(
                    pairing.clock.drift_ppm.abs() <= scan.options.drift_ppm * (1.0 + 1e-9),
                    "scan {number}: {:?}",
                    pairing.clock
                );
                assert_eq!(pairing.missed_latches, scan.triggers.missed);
            }
            Err(error) => {
                assert!(
                    matches!(error.code, "ambiguous_pairing" | "no_match" | "no_profiles"),
                    "scan {number}: {error}"
                );
                *refused.entry((kind, error.code)).or_default() += 1;
            }
        }
    }
    println!("{scans} scans by (rhythm, drift beyond the limit): {all:?}");
    println!("refused, by code: {refused:?}");
    let share = |kind| {
        let of_kind = refused.iter().filter(|((of, _), _)| *of == kind);
        let n: u32 = of_kind.map(|(_, n)| n).sum();
        f64::from(n) / f64::from(all[&kind])
    };
    // The 24 pulses of a signature are few where every twelfth of them is lost, and at 250 µs some of its
    // intervals are a jitter from even.
    assert!(share((Rhythm::Signature, false)) <= 0.04);
    assert!(share((Rhythm::Uneven, false)) <= 0.01);
    assert!(share((Rhythm::Even, false)) < 1.0);
}

/// Stamps and latches with wild times, days to thousands of years off, on one side or both: the rest is paired as it
/// would be without them.
#[test]
fn wild_times_leave_the_rest_as_it_is() {
    let mut random = Random(0x111D);
    let (mut paired, mut refused, mut repeated) = (0, 0, 0);
    while paired < 150 {
        let mut scan = scan(&mut random);
        // Beyond the limit of the drift a pairing may leave some out.
        if scan.beyond || pair(&scan.stamps, &scan.triggers, &scan.options).is_err() {
            continue;
        }
        let mut wild = Vec::new();
        let n = scan.stamps.len() as u64;
        for place in [0, n - 1, random.below(n)]
            .into_iter()
            .take(1 + random.below(3) as usize)
        {
            let days = [9e12, 9e15, 1.8e19, 1e300][random.below(4) as usize];
            let sign = if random.chance(0.5) { 1.0 } else { -1.0 };
            let place = place as usize;
            let profile = &mut scan.stamps[place];
            profile.t_us = sign * days * (1.0 + random.unit());
            wild.push(profile.profile);
        }
        // A repetition with the right time stands for a first that is wild.
        for place in 1..scan.stamps.len() {
            let [first, again] = [place - 1, place].map(|place| &scan.stamps[place]);
            let is_wild = |of: &Stamp| wild.contains(&of.profile);
            if first.frame == again.frame && is_wild(first) && !is_wild(again) {
                let pair = scan.truth.iter_mut().find(|pair| pair.0 == first.profile);
                repeated += u32::from(pair.is_some());
                pair.into_iter().for_each(|pair| pair.0 = again.profile);
            }
        }
        if wild.is_empty() {
            continue;
        }
        let of_board = random.chance(0.3);
        if of_board {
            let ends = [i64::MIN, i64::MAX];
            let first = scan.triggers.latches.first_mut().unwrap();
            first.t_ns = ends[0];
            let first = first.number;
            let last = scan.triggers.latches.last_mut().unwrap();
            last.t_ns = ends[1];
            let last = last.number;
            scan.truth
                .retain(|(_, number)| ![first, last].contains(number));
        }
        scan.truth.retain(|(profile, _)| !wild.contains(profile));
        match pair(&scan.stamps, &scan.triggers, &scan.options) {
            Ok(pairing) => {
                assert_eq!(numbers(&pairing), scan.truth, "{wild:?} {of_board}");
                let told = pairing
                    .warnings
                    .iter()
                    .find(|told| told.starts_with("misplaced: "));
                assert!(told.is_some(), "{wild:?}: {:?}", pairing.warnings);
                paired += 1;
            }
            Err(error) => {
                assert_eq!(error.code, "ambiguous_pairing", "{error}");
                // Without its first or its last pair an even train is open.
                refused += u32::from(scan.rhythm != Rhythm::Even);
            }
        }
    }
    let (mut stamps, triggers, mut truth) = signed(40_000, 40e-6, |_| false, |n| n % 89 != 7);
    stamps[17].t_us = 9e12;
    stamps[29_000].t_us = -9e15;
    truth.retain(|(profile, _)| ![17, 29_000].contains(profile));
    let pairing = pair(&stamps, &triggers, &PairOptions::default()).unwrap();
    assert_eq!(numbers(&pairing), truth);
    println!(
        "{paired} with wild times paired, {repeated} of them came again, {refused} not even ones refused"
    );
    assert!(repeated > 0);
    assert!(refused <= 3);
}

/// The sensor's clock jumps within the scan: the longer part is paired or nothing, and the jump is told with its place. A
/// pause that both clocks saw is none.
#[test]
fn a_jump_of_the_sensors_clock_is_told_with_its_place() {
    let rhythm = |seed: u64| {
        let mut random = Random(0x1A + seed);
        loop {
            let scan = scan(&mut random);
            let is_asked = scan.rhythm == Rhythm::Uneven && !scan.beyond;
            if is_asked && scan.truth.len() > 80 && scan.options.encoder.is_none() {
                return scan;
            }
        }
    };
    // Six seeds have run (2026-11-27); a search that ends in no answer takes seconds.
    for seed in 0..1 {
        for jump_us in [7e3, 2e6, 3.6e9, -2e4, -1e9, 9e12] {
            for share in [0.2, 0.5, 0.7] {
                if share == 0.5 && jump_us == 7e3 {
                    // Neither half is paired, and many intervals are as long.
                    continue;
                }
                let mut scan = rhythm(seed);
                let place = (scan.stamps.len() as f64 * share) as usize;
                scan.stamps[place..]
                    .iter_mut()
                    .for_each(|stamp| stamp.t_us += jump_us);
                let (said, right) = match pair(&scan.stamps, &scan.triggers, &scan.options) {
                    Ok(pairing) => {
                        let right = numbers(&pairing)
                            .iter()
                            .all(|pair| scan.truth.contains(pair));
                        // Nothing of the other part meets a latch by chance, and the longer part is kept.
                        let kept = pairing.pairs.len() as f64 > 0.4 * scan.truth.len() as f64;
                        (pairing.warnings.join("; "), right && kept)
                    }
                    Err(error) => {
                        let right = ["no_match", "ambiguous_pairing"].contains(&error.code);
                        (error.message, right)
                    }
                };
                let told = said
                    .split_once("clock_jump: with profile ")
                    .map(|(_, at)| at);
                let at: usize = told
                    .and_then(|at| at.split(' ').next()?.parse().ok())
                    .unwrap_or(0);
                // Profiles that came twice or lie at the jump are not told apart. Where it goes back by a few intervals, a
                // shift with another drift may explain more, and is told instead.
                let is_told = at.abs_diff(place) <= 3
                    || jump_us == -2e4 && said.contains("drifts by more than")
                    // Two halves of one length: a tie or no decision.
                    || share == 0.5 && jump_us > -1e9;
                assert!(
                    right && is_told,
                    "{seed} {jump_us} {share} at {place}: {said}"
                );
            }
        }
        let mut scan = rhythm(seed);
        let (profile, number) = scan.truth[scan.truth.len() / 3];
        let latch = scan
            .triggers
            .latches
            .iter()
            .position(|latch| latch.number == number)
            .unwrap();
        scan.stamps[profile as usize..]
            .iter_mut()
            .for_each(|stamp| stamp.t_us += 1e7);
        scan.triggers.latches[latch..]
            .iter_mut()
            .for_each(|latch| latch.t_ns += 10_000_000_000);
        let pairing = pair(&scan.stamps, &scan.triggers, &scan.options).unwrap();
        assert!(
            !pairing
                .warnings
                .iter()
                .any(|told| told.contains("clock_jump")),
            "{:?}",
            pairing.warnings
        );
    }
}

/// In an even train a jump of the sensor's clock by whole intervals looks like triggers that the sensor missed. It is said
/// of either; not where the rhythm or an encoder tells.
#[test]
fn a_skip_that_may_be_a_jump_by_whole_intervals_is_told() {
    let skipped = |pairing: &ScanPairing| {
        let told = pairing
            .warnings
            .iter()
            .find(|told| told.starts_with("skipped: "));
        told.cloned()
    };
    let sure = PairOptions::default();
    // The clock jumps: all behind is three triggers off, and nothing shows it but that.
    let (mut stamps, triggers, truth) = signed(400, 40e-6, |_| false, |n| n % 37 != 5 && n < 390);
    stamps[150..]
        .iter_mut()
        .for_each(|stamp| stamp.t_us += 15_000.0 / (1.0 + 40e-6));
    let pairing = pair(&stamps, &triggers, &sure).unwrap();
    let off = numbers(&pairing)
        .iter()
        .zip(&truth)
        .filter(|(got, due)| got != due)
        .count();
    assert!(off > 200, "{off}");
    let told = skipped(&pairing).unwrap();
    assert!(
        told.contains("between profiles 149 and 150") && told.contains("3 more"),
        "{told}"
    );
    // Three triggers are missed there: the same words, and all pairs are right. With losses on both sides, too.
    for losses in [0.0, 0.02] {
        let mut latches = Random(8);
        let (mut stamps, triggers, mut truth) = signed(
            400,
            40e-6,
            |_| latches.chance(losses),
            |n| n % 37 != 5 && n < 390,
        );
        let missed = |profile: usize| (150..153).contains(&profile);
        let frame = |stamp: &Stamp| stamp.frame - if stamp.profile > 152 { 3 } else { 0 };
        stamps
            .iter_mut()
            .for_each(|stamp| stamp.frame = frame(stamp));
        stamps.retain(|stamp| !missed(stamp.profile as usize));
        truth.retain(|(profile, _)| !missed(*profile as usize));
        let pairing = pair(&stamps, &triggers, &sure).unwrap();
        assert_eq!(numbers(&pairing), truth);
        assert!(skipped(&pairing).is_some(), "{:?}", pairing.warnings);
        // An encoder tells, where the axis moves.
        let mut triggers = triggers.clone();
        let counts = |number: u64| 20 * number as i64;
        triggers
            .latches
            .iter_mut()
            .for_each(|latch| latch.counts[0] = Some(counts(latch.number)));
        for (stamp, (_, number)) in stamps.iter_mut().zip(numbers(&pairing)) {
            stamp.encoder = Some(counts(number) + 1234);
        }
        stamps.truncate(pairing.pairs.len());
        if losses == 0.0 {
            let options = PairOptions {
                encoder: Some(0),
                ..sure
            };
            assert_eq!(skipped(&pair(&stamps, &triggers, &options).unwrap()), None);
        }
    }
    // Nothing is missed, or the rhythm tells.
    let (stamps, triggers, _) = signed(400, 40e-6, |n| n % 41 == 7, |n| n % 37 != 5);
    assert_eq!(skipped(&pair(&stamps, &triggers, &sure).unwrap()), None);
    let (mut stamps, triggers, _) = signed(24, 0.0, |_| false, |n| n != 9);
    stamps
        .iter_mut()
        .for_each(|stamp| stamp.frame -= u64::from(stamp.profile > 8));
    assert_eq!(skipped(&pair(&stamps, &triggers, &sure).unwrap()), None);
}

/// Frame numbers beyond the width that is given are refused, not wrapped.
#[test]
fn a_counter_of_too_few_bits_is_named() {
    let (stamps, triggers, truth) = signed(300, 40e-6, |_| false, |_| true);
    let with = |bits| PairOptions {
        counter: FrameCounter::Bits(bits),
        ..PairOptions::default()
    };
    let error = pair(&stamps, &triggers, &with(8)).unwrap_err();
    assert_eq!(error.code, "frame_bits");
    assert!(error.message.contains("--frame-bits 9 or more"), "{error}");
    assert_eq!(numbers(&pair(&stamps, &triggers, &with(9)).unwrap()), truth);
}

/// A sensor that does not count its frames: all profiles but one are left out, and a refusal says why.
#[test]
fn a_counter_that_stands_is_named_where_nothing_is_paired() {
    let (mut stamps, triggers, truth) = signed(60, 0.0, |_| false, |_| true);
    stamps.iter_mut().for_each(|stamp| stamp.frame = 0);
    let refused = pair(&stamps, &triggers, &PairOptions::default()).unwrap_err();
    assert_eq!(refused.code, "ambiguous_pairing");
    assert!(
        refused.message.contains("59 profiles were left out"),
        "{refused}"
    );
    let counter = FrameCounter::Restarts;
    let options = PairOptions {
        counter,
        ..PairOptions::default()
    };
    assert_eq!(numbers(&pair(&stamps, &triggers, &options).unwrap()), truth);
}

/// Times of either file in another unit are told, with the factor, and by no search over hours.
#[test]
fn times_in_another_unit_are_named_with_their_factor() {
    let clean = |rhythm: u64| {
        let mut random = Random(0x0117 + rhythm);
        loop {
            let scan = scan(&mut random);
            let is_asked =
                scan.rhythm as u64 == rhythm && !scan.beyond && scan.options.encoder.is_none();
            if is_asked && scan.truth.len() > 60 {
                return scan;
            }
        }
    };
    for rhythm in 0..3 {
        for factor in [1.024, 1.0 / 1.024, 1e-3, 1e-6, 1e3] {
            let mut scan = clean(rhythm);
            scan.stamps
                .iter_mut()
                .for_each(|stamp| stamp.t_us *= factor);
            let error = pair(&scan.stamps, &scan.triggers, &scan.options).unwrap_err();
            let told = error
                .details
                .get("factor")
                .and_then(serde_json::Value::as_f64);
            assert_eq!(error.code, "no_match");
            assert!(
                told.is_some_and(|told| (told * factor - 1.0).abs() < 1e-9),
                "{rhythm} {factor}: {error}"
            );
        }
        // The board's in µs, ms and s.
        for factor in [1e3, 1e6] {
            let mut scan = clean(rhythm);
            for latch in &mut scan.triggers.latches {
                latch.t_ns = (latch.t_ns as f64 / factor).round() as i64;
            }
            // Whole ms are no times of latches that are nearer.
            let latches = &mut scan.triggers.latches;
            latches.dedup_by_key(|latch| latch.t_ns);
            let error = pair(&scan.stamps, &scan.triggers, &scan.options).unwrap_err();
            assert_eq!(error.code, "no_match");
            assert!(
                error.message.contains("t_ns") && error.message.contains("unit"),
                "{rhythm} {factor}: {error}"
            );
        }
    }
    // A long scan, and whole milliseconds.
    for factor in [1.024, 1e-3, 1e3] {
        let (mut stamps, triggers, _) = signed(20_000, 40e-6, |n| n % 97 == 5, |n| n % 89 != 7);
        for stamp in &mut stamps {
            stamp.t_us *= factor;
            if factor == 1e-3 {
                stamp.t_us = stamp.t_us.round();
            }
        }
        let error = pair(&stamps, &triggers, &PairOptions::default()).unwrap_err();
        // Whole milliseconds match nothing within the jitter; the rates say it.
        let named = match factor {
            1e-3 => error.message.contains("look at the unit of each"),
            _ => error.details.contains_key("factor"),
        };
        assert!(named, "{factor}: {error}");
    }
}

/// The profiles and the numbers of their latches.
fn numbers(pairing: &ScanPairing) -> Vec<(u64, u64)> {
    let pairs = pairing.pairs.iter();
    pairs.map(|pair| (pair.profile, pair.number)).collect()
}

/// A scan with a signature at 5 ms, whose board has `latches`, of which it lost those for which `untold` says
/// so; the sensor sent the frames for which `sent` says so.
fn signed(
    latches: u64,
    drift: f64,
    mut untold: impl FnMut(u64) -> bool,
    mut sent: impl FnMut(u64) -> bool,
) -> (Vec<Stamp>, Triggers, Vec<(u64, u64)>) {
    let mut random = Random(0x516);
    let (mut stamps, mut truth) = (Vec::new(), Vec::new());
    let mut triggers = Triggers {
        cause: LatchSignal::Output,
        latches: Vec::new(),
        missed: 0,
        lost_runs: Vec::new(),
        right_until_ns: None,
    };
    let mut t_us = 2e6;
    for number in 0..latches {
        let told = !untold(number);
        if told {
            triggers.latches.push(latch(number, t_us, 0.0));
        } else {
            triggers.missed += 1;
            triggers.lost_runs.push(1);
        }
        if sent(number) {
            if told {
                truth.push((stamps.len() as u64, number));
            }
            stamps.push(Stamp {
                profile: stamps.len() as u64,
                frame: number + 1,
                t_us: (t_us - 5e5 + 6.0 * (random.unit() - 0.5)) / (1.0 + drift),
                encoder: None,
            });
        }
        t_us += 5000.0 * SIGNATURE.get(number as usize).copied().unwrap_or(1.0);
    }
    (stamps, triggers, truth)
}

/// A short uneven scan with losses on both sides and edges that were noise: lines about the right one, which leave out a
/// few pairs at one end, are no other pairing. They were looked at down to a hundredth of a microsecond, and the scan was
/// refused.
#[test]
fn lines_about_the_best_that_give_no_other_pair_are_no_rivals() {
    const PROFILES: [u32; 47] = [
        6242, 6084, 5610, 4849, 6383, 5719, 5518, 5364, 4685, 6323, 6167, 3794, 4767, 5235, 4797,
        5675, 5586, 3722, 6042, 6349, 5287, 4675, 4843, 5826, 6360, 4534, 3989, 3735, 4840, 4694,
        4394, 3784, 5032, 4018, 6243, 15015, 4645, 13356, 5700, 11042, 10983, 9408, 6384, 30975,
        4020, 3771, 4123,
    ];
    const LATCHES: [u32; 52] = [
        5712, 4282, 6234, 6088, 5612, 4846, 6381, 5716, 5517, 5368, 4684, 6322, 6166, 1700, 2097,
        1700, 3064, 5235, 4797, 5674, 5581, 3720, 6049, 6340, 5288, 4676, 4840, 5830, 6358, 4530,
        3992, 3735, 4839, 4693, 4395, 3778, 5035, 4016, 11090, 4518, 15138, 3526, 16947, 10605,
        1700, 8585, 23290, 12496, 5847, 4020, 3765, 4125,
    ];
    let times = |intervals: &[u32]| -> Vec<f64> {
        let after = intervals.iter().scan(0.0, |t, us| {
            *t += f64::from(*us);
            Some(*t)
        });
        std::iter::once(0.0).chain(after).collect()
    };
    let stamps: Vec<Stamp> = (0..)
        .zip(times(&PROFILES))
        .map(|(profile, t_us)| Stamp {
            profile,
            frame: profile,
            t_us,
            encoder: None,
        })
        .collect();
    let latches = (0..).zip(times(&LATCHES));
    let triggers = Triggers {
        cause: LatchSignal::Trigger,
        latches: latches
            .map(|(number, t_us)| latch(number, t_us, 0.0))
            .collect(),
        missed: 12,
        lost_runs: vec![1, 2, 2, 1, 1, 4, 1],
        right_until_ns: None,
    };
    let pairing = pair(&stamps, &triggers, &PairOptions::default()).unwrap();
    // The first two latches have no profile; from there on until the first noise both count alike.
    assert!((0..12).all(|k| numbers(&pairing)[k] == (k as u64, k as u64 + 2)));
    assert_eq!(pairing.pairs.len(), 39);
}

/// Times that scatter over nearly the whole jitter, with a profile or two beyond it: as many are paired as any line of
/// offset and drift reaches. The line of least squares leaves some out, and so did the search.
#[test]
fn the_line_that_reaches_most_profiles_is_found() {
    const JITTER_US: f64 = 20.0;
    let mut random = Random(0x1811);
    let mut more = 0;
    for scan in 0..60 {
        let n = 30 + random.below(40);
        let drift = 80e-6 * (random.unit() - 0.5);
        let width = 2.0 * JITTER_US * (0.85 + 0.25 * random.unit());
        let (mut stamps, mut latches, mut t_us) = (Vec::new(), Vec::new(), 1e6);
        for number in 0..n {
            t_us += 3000.0 * (0.6 + 0.8 * random.unit());
            latches.push(latch(number, t_us, 0.0));
            stamps.push(Stamp {
                profile: number,
                frame: number,
                t_us: (t_us + width * (random.unit() - 0.5)) / (1.0 + drift),
                encoder: None,
            });
        }
        let s: Vec<f64> = stamps
            .iter()
            .map(|stamp| stamp.t_us - stamps[0].t_us)
            .collect();
        let b: Vec<f64> = latches
            .iter()
            .map(|at| (at.t_ns - latches[0].t_ns) as f64 * 1e-3)
            .collect();
        let reached = |line: (f64, f64)| {
            let within = |(s, b): (&f64, &f64)| (line.0 + line.1 * s - b).abs() <= JITTER_US + 1e-6;
            s.iter().zip(&b).filter(|pair| within(*pair)).count()
        };
        // A line that reaches most can be moved until it passes the ends of two bars, and reaches as many.
        let ends = |i: usize| [b[i] - JITTER_US, b[i] + JITTER_US];
        let most = (0..s.len())
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .flat_map(|(i, j)| {
                ends(i)
                    .into_iter()
                    .flat_map(move |y| ends(j).map(|z| (i, j, y, z)))
            })
            .map(|(i, j, y, z)| {
                let slope = (y - z) / (s[i] - s[j]);
                reached((y - slope * s[i], slope))
            })
            .max()
            .unwrap();
        let triggers = Triggers {
            cause: LatchSignal::Output,
            latches,
            missed: 0,
            lost_runs: Vec::new(),
            right_until_ns: None,
        };
        let options = PairOptions {
            jitter_us: JITTER_US,
            ..PairOptions::default()
        };
        let pairing = pair(&stamps, &triggers, &options).unwrap();
        assert_eq!(pairing.pairs.len(), most, "scan {scan} of {n}");
        let slope = 1.0 + pairing.clock.drift_ppm * 1e-6;
        let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
        more += usize::from(reached((mean(&b) - slope * mean(&s), slope)) < most);
    }
    assert!(more > 10, "{more}: least squares alone would do");
}

/// Clocks that drift by more than allowed: twelve pulses off, a line just within the limit meets most latches of an
/// even train.
#[test]
fn a_drift_beyond_the_limit_is_told_and_never_an_alias_within_it() {
    for (drift_ppm, limit_ppm) in [
        (250.0, 200.0),
        (-300.0, 200.0),
        (40.0, 20.0),
        (1000.0, 200.0),
    ] {
        let (stamps, triggers, truth) = signed(1000, drift_ppm * 1e-6, |_| false, |_| true);
        let options = |drift_ppm| PairOptions {
            drift_ppm,
            ..PairOptions::default()
        };
        let error = pair(&stamps, &triggers, &options(limit_ppm)).unwrap_err();
        assert_eq!(error.code, "no_match");
        let seen = format!(
            "{:+.0}.",
            drift_ppm.signum() * (drift_ppm.abs() - 0.5).floor()
        );
        assert!(
            error.message.contains("--drift-ppm")
                && (error.message.contains(&format!("{drift_ppm:+.0}."))
                    || error.message.contains(&seen)),
            "{error}"
        );
        let pairing = pair(&stamps, &triggers, &options(drift_ppm.abs() * 1.1)).unwrap();
        assert_eq!(numbers(&pairing), truth);
    }
}

/// 40 000 pulses behind a signature, one frame in a hundred and one latch in a thousand lost: the shift by one pulse is
/// thirty profiles behind, more than chance brings about.
#[test]
fn a_long_scan_with_a_signature_and_losses_on_both_sides_is_decided() {
    let (mut latches, mut frames) = (Random(1), Random(2));
    let (stamps, triggers, truth) = signed(
        40_000,
        40e-6,
        |_| latches.chance(1e-3),
        |_| !frames.chance(1e-2),
    );
    let pairing = pair(&stamps, &triggers, &PairOptions::default()).unwrap();
    assert_eq!(numbers(&pairing), truth);
}

/// The sensor stopped half-way; with and without losses.
#[test]
fn a_stream_that_ends_early_is_decided_by_the_signature() {
    for faults in [0.0, 1e-3] {
        let (mut latches, mut frames) = (Random(3), Random(4));
        let (stamps, triggers, truth) = signed(
            20_000,
            40e-6,
            |_| latches.chance(faults),
            |number| number < 10_000 && !frames.chance(10.0 * faults),
        );
        let pairing = pair(&stamps, &triggers, &PairOptions::default()).unwrap();
        assert_eq!(numbers(&pairing), truth);
    }
}

/// The board's stream ends in an even train, or begins in it: the profiles without a latch fit many shifts, and none of them
/// is a jump of the clock. What is paired is all that can be.
#[test]
fn a_board_that_ends_early_is_no_jump_of_the_clock() {
    let (stamps, triggers, truth) = signed(2000, 40e-6, |_| false, |_| true);
    let mut early = triggers.clone();
    early.latches.truncate(1200);
    let pairing = pair(&stamps, &early, &PairOptions::default()).unwrap();
    assert_eq!(numbers(&pairing), truth[..1200]);
    assert_eq!(pairing.warnings, Vec::<String>::new());
}

/// An even train that two shifts explain is told to be one, with a pause in it, too.
#[test]
fn a_tie_is_no_jump_of_the_clock() {
    let (mut stamps, mut triggers, _) = signed(200, 0.0, |_| false, |_| true);
    let pulse = |number: u64| 2e6 + 5000.0 * number as f64;
    for latch in &mut triggers.latches {
        latch.t_ns = (pulse(latch.number) * 1e3) as i64;
    }
    for stamp in &mut stamps {
        stamp.t_us = pulse(stamp.frame);
    }
    stamps.truncate(150);
    let refused = pair(&stamps, &triggers, &PairOptions::default()).unwrap_err();
    assert_eq!(refused.code, "ambiguous_pairing");
    assert!(!refused.message.contains("clock_jump"), "{refused}");
}

/// An even train that lost a run of thirty latches and, five pulses later, thirty frames: the shift by five meets both
/// runs at once and explains 25 profiles more than the true one. Runs are no chance, so it is refused.
#[test]
fn two_runs_of_losses_that_fit_each_other_are_refused() {
    let (mut stamps, mut triggers, _) = signed(
        2000,
        0.0,
        |n| (1000..1030).contains(&n),
        |n| n >= 40 && !(1005..1035).contains(&n),
    );
    triggers.lost_runs = vec![30];
    triggers.latches.retain(|latch| latch.number >= 30);
    let pulse = |number: u64| 2e6 + 5000.0 * number as f64;
    for latch in &mut triggers.latches {
        latch.t_ns = (pulse(latch.number) * 1e3) as i64;
    }
    for stamp in &mut stamps {
        stamp.t_us = pulse(stamp.frame);
    }
    let refused = pair(&stamps, &triggers, &PairOptions::default()).unwrap_err();
    assert_eq!(refused.code, "ambiguous_pairing");
}

/// A scan of some minutes at 1 kHz, as even as a clock: lost profiles shift nothing, and it is
/// decided. (A search that looked at every profile in each step did not come to an end.)
#[test]
fn a_long_even_scan_is_decided() {
    const LATCHES: u64 = 300_000;
    let mut random = Random(0x10_06);
    let first = [0; 6].map(Some);
    let triggers = Triggers {
        cause: LatchSignal::Output,
        latches: (0..LATCHES)
            .map(|number| TriggerLatch {
                number,
                t_ns: 5_000_000_000 + i64::try_from(number).unwrap() * 1_000_000,
                counts: first,
            })
            .collect(),
        missed: 0,
        lost_runs: Vec::new(),
        right_until_ns: None,
    };
    let kept: Vec<u64> = (0..LATCHES).filter(|_| !random.chance(1e-4)).collect();
    assert!(kept.len() < LATCHES as usize);
    let stamps: Vec<Stamp> = kept
        .iter()
        .zip(0..)
        .map(|(number, profile)| Stamp {
            profile,
            frame: number + 7,
            t_us: (5e6 + *number as f64 * 1e3 - 123_456.7) / (1.0 + 37e-6) + 3.0 * random.unit(),
            encoder: None,
        })
        .collect();
    let pairing = pair(&stamps, &triggers, &PairOptions::default()).unwrap();
    let got: Vec<u64> = pairing.pairs.iter().map(|pair| pair.number).collect();
    assert_eq!(got, kept);
}

/// One edge too many on either side costs the pairs that it may have, and no other.
#[test]
fn an_edge_too_many_leaves_its_neighbour_unpaired() {
    let (mut stamps, mut triggers, mut truth) = signed(60, 20e-6, |_| false, |_| true);
    stamps.insert(
        11,
        Stamp {
            t_us: stamps[10].t_us + 15.0,
            ..stamps[10]
        },
    );
    for (profile, stamp) in stamps.iter_mut().enumerate() {
        (stamp.profile, stamp.frame) = (profile as u64, profile as u64);
    }
    for (profile, _) in &mut truth[11..] {
        *profile += 1;
    }
    let at_us = triggers.latches[30].t_ns as f64 / 1e3 - 12.0;
    triggers.latches.insert(30, latch(0, at_us, 0.0));
    for (number, latch) in triggers.latches.iter_mut().enumerate() {
        latch.number = number as u64;
    }
    for (_, number) in &mut truth[30..] {
        *number += 1;
    }
    truth.retain(|(profile, _)| ![10, 31].contains(profile));
    let pairing = pair(&stamps, &triggers, &PairOptions::default()).unwrap();
    let pairs = pairing.pairs.iter().map(|pair| (pair.profile, pair.number));
    assert_eq!(pairs.collect::<Vec<_>>(), truth);
    assert_eq!(pairing.doubtful, [10, 11, 31]);
    assert_eq!(pairing.unpaired_profiles, [10, 11, 31]);
    assert_eq!(pairing.unpaired_triggers, [10, 30, 31]);
    let told = pairing
        .warnings
        .iter()
        .find(|told| told.starts_with("doubtful: "));
    let told = told.expect("a warning");
    assert!(
        told.contains("profiles 10 and 11 are within 20 µs of latch 10"),
        "{told}"
    );
    let strict = PairOptions {
        strict: true,
        ..PairOptions::default()
    };
    let error = pair(&stamps, &triggers, &strict).unwrap_err();
    assert!(error.message.contains("3 doubtful profiles"), "{error}");
    let narrow = PairOptions {
        jitter_us: 8.0,
        ..PairOptions::default()
    };
    let pairing = pair(&stamps, &triggers, &narrow).unwrap();
    assert_eq!((pairing.pairs.len(), pairing.doubtful.len()), (60, 0));
}

/// Where every edge bounces nothing is left to pair.
#[test]
fn a_scan_that_is_all_doubt_is_refused_by_name() {
    let (stamps, mut triggers, _) = signed(60, 0.0, |_| false, |_| true);
    let both = triggers.latches.iter().flat_map(|once| {
        let at_us = once.t_ns as f64 / 1e3;
        [at_us, at_us + 9.0].map(|at_us| latch(0, at_us, 0.0))
    });
    triggers.latches = both.collect();
    for (number, latch) in triggers.latches.iter_mut().enumerate() {
        latch.number = number as u64;
    }
    let error = pair(&stamps, &triggers, &PairOptions::default()).unwrap_err();
    assert_eq!(error.code, "ambiguous_pairing");
    assert!(
        error.message.contains("of latch 0 and of latch 1"),
        "{error}"
    );
    assert!(error.message.contains("narrower --jitter-us"), "{error}");
}
