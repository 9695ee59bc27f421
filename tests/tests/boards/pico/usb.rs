//! The board's USB plug on the emulated Pico: it shows itself while there are 5 V, and comes back by
//! itself where a host is there and nothing moves.

use serde_json::{Value, json};
use umi_tests::rig::Rig as _;
use umi_tests::rig::pico::{CYCLES_PER_US, PicoRig};

const MS: u64 = 1000 * CYCLES_PER_US;
/// A plug is looked at each 20 ms.
const LOOK: u64 = 25 * MS;

fn usb(rig: &mut PicoRig, name: &str) -> Value {
    rig.emulator().state().json["usb"][name].clone()
}

fn enumerations(rig: &mut PicoRig) -> u64 {
    usb(rig, "enumerations").as_u64().unwrap()
}

fn fault(rig: &mut PicoRig, fault: &str) {
    rig.emulator()
        .ask(&json!({ "do": "usb_fault", "fault": fault }));
}

fn after(rig: &mut PicoRig, cycles: u64) {
    let until = rig.emulator().state().cycle + cycles;
    rig.wait_for_cycle(until);
}

/// No port that is off is fed by a line of the board, and the host is told that the board has its own
/// supply.
#[test]
fn shows_itself_while_the_plug_has_power() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    drop(rig.client());
    let descriptors = rig.emulator().ask(&json!({ "do": "descriptors" }));
    let configuration = descriptors["configuration"].as_str().unwrap();
    // bmAttributes (USB 2.0, 9.6.3): the bit that is always set, and that of its own supply.
    assert_eq!(&configuration[14..16], "c0");
    rig.unplug();
    after(&mut rig, LOOK);
    assert_eq!(usb(&mut rig, "pulled_up"), false);
    after(&mut rig, 200 * MS);
    assert_eq!(usb(&mut rig, "pulled_up"), false);
    // The rig plugs it in.
    let mut client = rig.client();
    assert_eq!(usb(&mut rig, "pulled_up"), true);
    client.status().unwrap();
}

/// An enumeration that comes to nothing: two seconds later the board is there.
#[test]
fn comes_back_where_the_host_does_not_configure_it() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    drop(rig.client());
    rig.unplug();
    fault(&mut rig, "unheard");
    let before = enumerations(&mut rig);
    rig.emulator().ask(&json!({ "do": "usb", "plugged": true }));
    after(&mut rig, 1_900 * MS);
    assert_eq!(enumerations(&mut rig), before + 1);
    assert_eq!(usb(&mut rig, "configured"), false);
    after(&mut rig, 500 * MS);
    assert_eq!(enumerations(&mut rig), before + 2);
    rig.client().status().unwrap();
}

/// A port that the hub has switched off under a program: two seconds later the board is there again.
/// Without a program it may be a host that sleeps, and is left alone.
#[test]
fn comes_back_where_frames_end_under_a_program() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = rig.client();
    client.status().unwrap();
    let before = enumerations(&mut rig);
    fault(&mut rig, "disabled");
    after(&mut rig, 1_900 * MS);
    assert_eq!(enumerations(&mut rig), before);
    after(&mut rig, 500 * MS);
    assert_eq!(enumerations(&mut rig), before + 1);
    drop(client);
    rig.client().status().unwrap();

    // The client is closed.
    after(&mut rig, 100 * MS);
    assert_eq!(usb(&mut rig, "open"), false);
    let before = enumerations(&mut rig);
    fault(&mut rig, "disabled");
    after(&mut rig, 5_000 * MS);
    assert_eq!(enumerations(&mut rig), before);
    assert_eq!(usb(&mut rig, "pulled_up"), true);
}
