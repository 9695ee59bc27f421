//! `umi teach`, against a virtual board.

use std::sync::Arc;
use std::time::{Duration, Instant};

use umi_virtual::serve::{Port, PortPlace};
use umi_virtual::{BoardTime, Config, VirtualBoard};

use crate::rig::run::{Folder, umi};

const JOB: &str = include_str!("../../../../../examples/three-spheres.toml");
const SESSION: &str = include_str!("../../../../../examples/session.txt");
const LEARNED: &str =
    "\n[guards.learned]\nradius_mm = 0.003\nrms_mm = 0.002\ncentring_mm = 0.004\n";

/// A clamping of the session.
fn clamping(number: usize) -> String {
    let lines = SESSION.split_inclusive('\n');
    lines.skip(27 * number).take(27).collect()
}

/// Further clampings widen what was learned, and it is said how far; where there is nothing to
/// widen, that is said too.
#[test]
fn further_clampings_teach_and_are_told() {
    let board = Arc::new(VirtualBoard::start(Config::default()).unwrap());
    let port = Port::open(&PortPlace::Tcp(0)).unwrap();
    let address = port.address.clone();
    port.serve_host(&board);
    let folder = Folder::new();
    let at = ["--port", address.as_str()];
    let umi = |arguments: &[&str]| umi(&[arguments, &at].concat());
    let taught_by = |clampings: u32| {
        let begun = Instant::now();
        while umi(&["info", "--json"]).exits(0).json()["teachings"] != clampings {
            assert!(begun.elapsed() < Duration::from_secs(20), "{clampings}");
        }
    };

    let plain = folder.file("plain.toml", JOB);
    umi(&["job", "set", &plain]).exits(0);
    umi(&["teach", "--more"]).exits(2).says("[guards.learned]");
    let job = folder.file("learning.toml", JOB.to_owned() + LEARNED);
    umi(&["job", "set", &job]).exits(0);
    let info = umi(&["info"]).exits(0).out;
    assert!(info.contains("none yet"), "{info}");
    umi(&["teach", "--more"])
        .exits(2)
        .says("nothing is taught yet");
    umi(&["teach", "--more", "--again"]).exits(1);

    board.control_sends(clamping(0).as_bytes());
    taught_by(1);
    let one = umi(&["job", "show"]).exits(0).out;
    assert!(one.contains("taught by 1 clamping\n"), "{one}");
    let asked = umi(&["teach", "--more"]).exits(0).out;
    assert!(asked.contains("widen what 1 clamping taught"), "{asked}");
    board.control_sends(clamping(1).as_bytes());
    taught_by(2);
    let info = umi(&["info"]).exits(0).out;
    assert!(info.contains("taught by 2 clampings"), "{info}");
    let two = umi(&["job", "show"]).exits(0).out;
    assert!(two.contains("taught by 2 clampings"), "{two}");
    assert!(two.contains("±0.0030"), "{two}");
    let learned = umi(&["job", "show", "--json"]).exits(0).json()["learned"].clone();
    let radius = |end: &str| learned[end][0]["radius_mm"].as_f64().unwrap();
    assert!(radius("smallest") < radius("largest"), "{learned}");
    let span = format!("{:.4} to {:.4}", radius("smallest"), radius("largest"));
    assert!(two.contains(&span), "{span} in {two}");
}

/// The board's button, held for a second, asks to teach as `umi teach` does; a knock does not,
/// and no press replaces a reference. The journal says who asked, and replays to the same.
#[test]
fn the_button_teaches_when_it_is_held() {
    let config = Config {
        time: BoardTime::Real,
        ..Config::default()
    };
    let board = Arc::new(VirtualBoard::start(config).unwrap());
    let port = Port::open(&PortPlace::Tcp(0)).unwrap();
    let address = port.address.clone();
    port.serve_host(&board);
    let button = Port::open(&PortPlace::Tcp(0)).unwrap();
    let finger = button.address.strip_prefix("tcp://").unwrap().to_owned();
    button.serve_button(&board);
    let press = |ms: u64| {
        let held = std::net::TcpStream::connect(&finger).unwrap();
        std::thread::sleep(Duration::from_millis(ms));
        drop(held);
        std::thread::sleep(Duration::from_millis(150));
    };
    let folder = Folder::new();
    let at = ["--port", address.as_str()];
    let umi = |arguments: &[&str]| umi(&[arguments, &at].concat());
    let judged = |clampings: u32| {
        let begun = Instant::now();
        loop {
            let info = umi(&["info", "--json"]).exits(0).json();
            if info["status"]["verdicts"] == clampings || info["verdicts"] == clampings {
                return info["teachings"].as_u64().unwrap_or(0);
            }
            assert!(begun.elapsed() < Duration::from_secs(20), "{info}");
        }
    };
    let job = JOB.replace("teach = \"first_ok\"", "teach = \"asked\"");
    let job = folder.file("asked.toml", job);
    umi(&["job", "set", &job]).exits(0);
    press(300);
    board.control_sends(clamping(0).as_bytes());
    assert_eq!(judged(1), 0, "a knock teaches nothing");
    assert!(!umi(&["info"]).exits(0).out.contains("asked"));
    press(1300);
    let told = umi(&["info"]).exits(0).out;
    let said = "the setup that comes next is to be the reference: the board's button asked 0:00:0";
    assert!(told.contains(said), "{told}");
    let told = umi(&["watch", "--once", "--json"]).exits(0).json();
    assert_eq!(told["status"]["teaching"]["by"], "button", "{told}");
    assert_eq!(told["status"]["teaching"]["setup"], "next", "{told}");
    board.control_sends(clamping(1).as_bytes());
    assert_eq!(judged(2), 1);
    let told = umi(&["info", "--json"]).exits(0).json();
    assert!(told["status"]["teaching"].is_null(), "{told}");
    press(1300);
    board.control_sends(clamping(2).as_bytes());
    assert_eq!(judged(3), 1, "the reference stays");
    let log = folder.path("held.umij");
    umi(&["log", "-o", &log]).exits(0);
    let listed = umi(&["log"]).exits(0).out;
    let held = "the board's button was held";
    assert_eq!(listed.matches(held).count(), 2, "{listed}");
    assert!(listed.contains("there is a reference already"), "{listed}");
    crate::rig::run::umi(&["replay", &log]).exits(0);

    // The owner lets it ask for nothing, also where there is something to teach.
    umi(&["config", "set", "access.button_off", "true"]).exits(0);
    let next = JOB.replace("teach = \"first_ok\"", "teach = \"asked\"");
    let next = next.replace("\"THREE SPHERES\"", "\"NEXT\"");
    umi(&["job", "set", &folder.file("next.toml", next)]).exits(0);
    press(1300);
    let told = umi(&["info", "--json"]).exits(0).json();
    assert!(told["status"]["teaching"].is_null(), "{told}");
    board.control_sends(clamping(3).as_bytes());
    assert_eq!(judged(4), 0, "the button is off");
    let listed = umi(&["log"]).exits(0).out;
    assert!(listed.contains("lets its button teach nothing"), "{listed}");
    umi(&["teach"]).exits(0);
    board.control_sends(clamping(4).as_bytes());
    assert_eq!(judged(5), 1, "who has a key may");
    let log = folder.path("off.umij");
    umi(&["log", "-o", &log]).exits(0);
    crate::rig::run::umi(&["replay", &log]).exits(0);
}
