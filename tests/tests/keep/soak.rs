//! A long shift ([`umi_tests::soak`]) on a virtual board. Its clock runs a hundred times as fast as the wall's.

use std::time::{Duration, Instant};

use umi_core::journal::Geometry;
use umi_tests::rig::{Rig as _, VirtualRig};
use umi_tests::soak::{Shift, maker};
use umi_virtual::board::KEY;
use umi_virtual::{Config, VirtualFlash};

/// A journal of 256 KB: some noise is a lap of it.
const SMALL: Geometry = Geometry {
    sectors: 16,
    sector_size: 16_384,
    write_size: 1,
    page_size: 256,
};

/// So many hours of the board's time, from this seed.
fn soak(hours: f64, seed: u64) -> Shift<VirtualRig> {
    let config = Config {
        key: Some(VirtualFlash::in_memory(KEY)),
        journal: VirtualFlash::in_memory(SMALL),
        firmware_key: Some(maker()),
        jumper: true,
        ..Config::default()
    };
    let mut shift = Shift::new(VirtualRig::of(config).unwrap(), seed);
    let begun = Instant::now();
    let mut told = 0;
    shift.works_until(Duration::from_secs_f64(hours * 3600.0), |shift| {
        let hour = shift.rig().time().as_secs() / 3600;
        if hour > told {
            told = hour;
            println!(
                "hour {hour}: {} MB, {:?} on the wall, {:?}",
                resident_mb().unwrap_or(0),
                begun.elapsed(),
                shift.tally
            );
        }
    });
    shift.ends();
    println!(
        "seed {seed}: {} MB, {:?} on the wall",
        resident_mb().unwrap_or(0),
        begun.elapsed()
    );
    shift
}

/// Resident memory of this process, MB; none: another system than Linux.
fn resident_mb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    let kilobytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes / 1024)
}

/// A quarter of an hour.
#[test]
fn nothing_is_lost_in_a_quarter_of_an_hour() {
    let shift = soak(0.25, 5);
    assert!(shift.pulled.verdicts > 3, "{:?}", shift.tally);
    assert!(shift.tally.lines_of_noise > 1000, "{:?}", shift.tally);
}

/// What the process may grow by beyond the file that is pulled into it.
const GROWS_MB: u64 = 16;

/// As above, 24 hours, or as many as `UMI_SOAK_HOURS` says; from the seed `UMI_SOAK_SEED`. By hand:
/// `cargo test --release -p umi-tests --test keep soak -- --ignored --nocapture`.
#[test]
#[ignore = "half an hour"]
fn long_shift() {
    let said = |name: &str| std::env::var(name).ok();
    let hours = said("UMI_SOAK_HOURS").map_or(24.0, |hours| hours.parse().unwrap());
    let seed = said("UMI_SOAK_SEED").map_or(1, |seed| seed.parse().unwrap());
    let before = resident_mb();
    let shift = soak(hours, seed);
    let tally = &shift.tally;
    assert!(tally.resets > 0 && tally.updates_confirmed > 0 && tally.updates_reverted > 0);
    assert!(shift.pulled.corrections > 0);
    if let Some((before, after)) = before.zip(resident_mb()) {
        let file = shift.pulled.file.len() as u64 >> 20;
        assert!(after <= before + file + GROWS_MB, "{before} to {after} MB");
    }
}
