//! Random scans with random faults: a pairing is right or refused, never wrong.

use super::{PairOptions, pair};
use crate::format::triggers::{LatchSignal, TriggerLatch, Triggers};
use crate::profile::Stamp;
use crate::profile::frames::FrameCounter;

/// A small generator of its own (SplitMix64), so that the scans stay the same for ever.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// In 0..1.
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn below(&mut self, n: u64) -> u64 {
        self.next() % n
    }

    fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }
}

struct Scan {
    stamps: Vec<Stamp>,
    triggers: Triggers,
    options: PairOptions,
    /// (profile, number) that belong together.
    truth: Vec<(u64, u64)>,
    even: bool,
}

fn scan(random: &mut Random) -> Scan {
    let n = 20 + random.below(120);
    let interval_us = [250.0, 1000.0, 5000.0][random.below(3) as usize];
    let even = random.chance(0.3);
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
    let drift = (random.unit() * 2.0 - 1.0) * 200e-6;
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
    for place in 0..n {
        if restarts && place == n / 2 {
            frame = 0;
        }
        t_us += interval_us * if even { 1.0 } else { 0.6 + 0.8 * random.unit() };
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
        } else {
            missed += 1;
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
    Scan {
        stamps,
        triggers: Triggers {
            cause,
            latches,
            missed,
            right_until_ns: None,
        },
        options: PairOptions {
            counter: match frame_bits {
                Some(bits) => FrameCounter::Bits(bits),
                None if restarts => FrameCounter::Restarts,
                None => FrameCounter::Rises,
            },
            encoder: with_encoder.then_some(0),
            ..PairOptions::default()
        },
        truth,
        even,
    }
}

fn latch(number: u64, t_us: f64, counts: f64) -> TriggerLatch {
    TriggerLatch {
        number,
        t_ns: (t_us * 1e3).round() as i64,
        counts: [Some(counts as i64), None, None, None, None, None],
    }
}

/// 1500 scans, or as many as UMI_SCANS says: 0 wrong pairs. Uneven rhythms are refused in
/// less than 1 %; even ones often must be, because they fit in two ways.
#[test]
fn random_scans_are_paired_rightly_or_refused() {
    let scans = std::env::var("UMI_SCANS")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(1500);
    let mut random = Random(0x5CA7);
    let (mut even, mut uneven, mut refused_even, mut refused_uneven) = (0, 0, 0, 0);
    let mut causes = std::collections::BTreeMap::<_, u32>::new();
    for number in 0..scans {
        let scan = scan(&mut random);
        let (all, refused) = if scan.even {
            (&mut even, &mut refused_even)
        } else {
            (&mut uneven, &mut refused_uneven)
        };
        *all += 1;
        match pair(&scan.stamps, &scan.triggers, &scan.options) {
            Ok(pairing) => {
                let got: Vec<_> = pairing
                    .pairs
                    .iter()
                    .map(|p| (p.profile, p.number))
                    .collect();
                assert_eq!(got, scan.truth, "scan {number}");
                assert_eq!(pairing.missed_latches, scan.triggers.missed);
            }
            Err(error) => {
                assert!(
                    matches!(error.code, "ambiguous_pairing" | "no_match" | "no_profiles"),
                    "scan {number}: {error}"
                );
                *refused += 1;
                *causes.entry((scan.even, error.code)).or_default() += 1;
            }
        }
    }
    println!(
        "{scans} scans: refused {refused_even} of {even} even, {refused_uneven} of {uneven} uneven"
    );
    println!("by cause (even, code): {causes:?}");
    assert!(
        refused_uneven * 100 <= uneven,
        "{refused_uneven} of {uneven}"
    );
    assert!(refused_even < even);
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
