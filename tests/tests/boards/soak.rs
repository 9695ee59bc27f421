//! A shift ([`umi_tests::soak`]) on the image in QEMU and on the emulated Pico: each thing once, in any order.
//!
//! By hand as long as `UMI_SOAK_MINUTES` says (30) on the wall, from the seed `UMI_SOAK_SEED`:
//! `cargo test --release -p umi-tests --test boards soak -- --ignored --nocapture`.

use std::time::{Duration, Instant};

use umi_tests::rig::{PicoRig, QemuRig, Rig as _};
use umi_tests::soak::{Shift, SoakRig, maker};

fn qemu() -> Option<QemuRig> {
    QemuRig::start_with_a_maker([0x5E; 32], maker())
}

fn pico() -> Option<PicoRig> {
    let mut rig = PicoRig::start_or_skip()?;
    rig.close_jumper(true);
    rig.power_cycle();
    Some(rig)
}

/// Every start of a Pico was one by the power: nothing has stopped it, and no character found no room.
fn holds_out(shift: &mut Shift<PicoRig>) {
    let state = shift.rig().emulator().state();
    assert_eq!((state.resets, state.fault, state.overruns), (0, None, 0));
}

/// Once each; then nothing is missing.
fn short<R: SoakRig>(rig: R) -> Shift<R> {
    let begun = Instant::now();
    let mut shift = Shift::new(rig, 5);
    shift.does_each();
    shift.ends();
    println!("{:?} on the wall", begun.elapsed());
    assert!(shift.pulled.verdicts > 0, "{:?}", shift.tally);
    assert!(shift.tally.strangers > 0 && shift.tally.lines_of_noise > 0);
    shift
}

#[test]
fn qemu_loses_nothing() {
    if let Some(rig) = qemu() {
        let shift = short(rig);
        assert!(shift.tally.updates_confirmed + shift.tally.updates_reverted > 0);
    }
}

#[test]
fn the_pico_loses_nothing() {
    if let Some(rig) = pico() {
        holds_out(&mut short(rig));
    }
}

/// As long as is said.
fn long<R: SoakRig>(rig: R) -> Shift<R> {
    let said = |name: &str| std::env::var(name).ok();
    let minutes = said("UMI_SOAK_MINUTES").map_or(30.0, |minutes| minutes.parse().unwrap());
    let seed = said("UMI_SOAK_SEED").map_or(1, |seed| seed.parse().unwrap());
    let end = Instant::now() + Duration::from_secs_f64(60.0 * minutes);
    let mut shift = Shift::new(rig, seed);
    while Instant::now() < end {
        shift.does_each();
        println!(
            "{:?} of the board's time: {:?}",
            shift.rig().time(),
            shift.tally
        );
    }
    shift.ends();
    shift
}

#[test]
#[ignore = "half an hour"]
fn qemu_loses_nothing_for_long() {
    if let Some(rig) = qemu() {
        let tally = long(rig).tally;
        assert!(
            tally.updates_confirmed > 0 && tally.updates_reverted > 0,
            "{tally:?}"
        );
    }
}

#[test]
#[ignore = "half an hour"]
fn the_pico_loses_nothing_for_long() {
    if let Some(rig) = pico() {
        holds_out(&mut long(rig));
    }
}
