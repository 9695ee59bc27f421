//! Short scans with many faults, whose triggers come close beside the jitter: what narrower times decide is decided, and
//! nothing is paired wrongly without a word.

use crate::format::triggers::{LatchSignal, Triggers};
use crate::pair::simulated::{Random, SIGNATURE, latch};
use crate::pair::{Pair, PairOptions, pair};
use crate::profile::Stamp;

struct Short {
    stamps: Vec<Stamp>,
    triggers: Triggers,
    truth: Vec<(u64, u64)>,
}

/// 5 to 20 triggers, up to 30 % of them lost on either side, heads and tails too; three rhythms.
fn short(random: &mut Random, rhythm: u64) -> Short {
    let n = 5 + random.below(16);
    let base_us = [100.0, 250.0, 1000.0, 5000.0][random.below(4) as usize];
    let noise_us = [0.1, 1.0, 5.0, 9.0][random.below(4) as usize];
    let shares = [0.0, 0.0, 0.02, 0.1, 0.3];
    let mut share = || shares[random.below(5) as usize];
    let (frames_lost, latches_lost) = (share(), share());
    let (head, tail) = (random.below(3), random.below(3));
    let drift = (random.unit() - 0.5) * 360e-6;
    let offset_us = random.unit() * 1e8;
    let (mut t_us, mut missed, mut run) = (1e6, 0, 0);
    let (mut stamps, mut latches, mut lost_runs, mut truth) = (vec![], vec![], vec![], vec![]);
    for number in 0..n {
        t_us += base_us
            * match rhythm {
                0 => 1.0,
                1 => SIGNATURE.get(number as usize).copied().unwrap_or(1.0),
                _ => 0.6 + random.unit(),
            };
        let told = !random.chance(latches_lost);
        if told {
            latches.push(latch(number, t_us, 0.0));
            lost_runs.push(std::mem::take(&mut run));
        } else {
            missed += 1;
            run += 1;
        }
        if number < head || number + tail >= n || random.chance(frames_lost) {
            continue;
        }
        let noise = (2.0 * random.unit() - 1.0) * noise_us;
        let profile = stamps.len() as u64;
        if told {
            truth.push((profile, number));
        }
        stamps.push(Stamp {
            profile,
            frame: number,
            t_us: (t_us + noise - offset_us) / (1.0 + drift),
            encoder: None,
        });
    }
    lost_runs.push(run);
    lost_runs.retain(|&run| run > 0);
    Short {
        stamps,
        triggers: Triggers {
            cause: LatchSignal::Output,
            latches,
            missed,
            lost_runs,
            right_until_ns: None,
        },
        truth,
    }
}

/// Of so many scans of each rhythm: wrong ones without a word, those that a narrower jitter decided, refused as ambiguous.
fn count(scans: u64) -> [[u32; 3]; 3] {
    let mut random = Random(0x5401);
    let mut all = [[0; 3]; 3];
    for (rhythm, [silent, decided, refused]) in (0..).zip(&mut all) {
        for _ in 0..scans {
            let scan = short(&mut random, rhythm);
            let found = match pair(&scan.stamps, &scan.triggers, &PairOptions::default()) {
                Ok(found) => found,
                Err(error) => {
                    *refused += u32::from(error.code == "ambiguous_pairing");
                    continue;
                }
            };
            let told = |what: &str| found.warnings.iter().any(|told| told.starts_with(what));
            let by_jitter = told("jitter: ");
            *decided += u32::from(by_jitter);
            let is_wrong = |pair: &Pair| !scan.truth.contains(&(pair.profile, pair.number));
            let wrong = found.pairs.iter().any(is_wrong);
            // What a narrower jitter decides is right, whatever else is told.
            assert!(!(wrong && by_jitter), "{:?} {:?}", found.pairs, scan.truth);
            *silent += u32::from(wrong && !told("even_train"));
        }
    }
    all
}

#[test]
fn short_scans_are_never_wrong_without_a_word() {
    let all = count(400);
    println!(
        "even, signature, uneven; silently wrong, decided by a narrower jitter, ambiguous: {all:?}"
    );
    assert_eq!(all.map(|[silent, _, _]| silent), [0; 3], "{all:?}");
    let decided: u32 = all.iter().map(|[_, decided, _]| decided).sum();
    assert!(decided > 0, "{all:?}");
}

/// By hand: more of them, for docs/promises.md.
#[test]
#[ignore = "some seconds, by hand"]
fn of_many_short_scans_none_is_wrong_without_a_word() {
    let all = count(10_000);
    println!(
        "even, signature, uneven; silently wrong, decided by a narrower jitter, ambiguous: {all:?}"
    );
    assert_eq!(all.map(|[silent, _, _]| silent), [0; 3], "{all:?}");
}
