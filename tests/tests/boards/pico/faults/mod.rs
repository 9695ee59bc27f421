//! A fault of the processor on the emulated Pico: laser and lamps go off first, then the board starts
//! anew and says where it was.

mod stack;
mod watchdog;

use serde_json::json;
use umi_protocol::message::ResetReason;
use umi_tests::cases::until;
use umi_tests::rig::pico::PicoRig;

const LASER_PIN: u8 = 21;
/// From a fault to laser and lamps off, cycles: 8 us.
const DARK_CYCLES: u64 = 1_000;

#[test]
fn a_fault_puts_the_laser_out_before_anything_else() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = rig.client();
    assert!(client.laser(true).unwrap());
    until(&mut rig, "the laser", |rig| rig.laser_is_on().then_some(()));
    rig.emulator().outputs();
    let crash = rig.emulator().ask(&json!({ "do": "crash" }));
    let crash = crash["cycle"].as_u64().expect("a cycle");
    until(&mut rig, "the laser off", |rig| {
        (!rig.laser_is_on()).then_some(())
    });
    let outputs = rig.emulator().outputs();
    let off = outputs.iter().find(|of| of.pin == LASER_PIN && !of.level);
    let off = off.expect("it has been switched off").cycle;
    println!("laser off {} cycles after the fault", off - crash);
    assert!(off - crash <= DARK_CYCLES, "{}", off - crash);
    // It starts anew, and says why.
    drop(client);
    let mut client = rig.client();
    let status = client.status().unwrap();
    assert_eq!(status.reset, ResetReason::Panic);
    assert!(!rig.emulator().state().laser_is_on);
}
