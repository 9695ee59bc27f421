//! `umi line`, against a virtual board whose control is set otherwise.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use serde_json::json;
use umi_core::dprnt::{Coding, encode};
use umi_protocol::serial::LineSettings;
use umi_virtual::serve::{Port, PortPlace};
use umi_virtual::{BoardTime, Config, VirtualBoard};

use crate::rig::run::umi;

const LINE: &[u8] = b"UMI1 R 17 S 3 X- 135.019 Y- 136.620 C 4113.0474\n";

/// A control of this speed and code that prints lines for ever, unless it is silent: what `umi
/// line find` with these arguments says of it.
fn find(baud: u32, coding: Option<Coding>, arguments: &[&str]) -> crate::rig::run::Ran {
    find_text(baud, coding.map(|coding| (coding, LINE)), arguments)
}

/// The same of another text.
fn find_text(
    baud: u32,
    prints: Option<(Coding, &'static [u8])>,
    arguments: &[&str],
) -> crate::rig::run::Ran {
    let control = LineSettings {
        baud,
        data_bits: 7,
        stop_bits: 2,
        ..LineSettings::DEFAULT
    };
    let config = Config {
        time: BoardTime::Real,
        control: Some(control),
        ..Config::default()
    };
    let board = Arc::new(VirtualBoard::start(config).unwrap());
    let port = Port::open(&PortPlace::Tcp(0)).unwrap();
    let address = port.address.clone();
    port.serve_host(&board);
    let is_over = Arc::new(AtomicBool::new(false));
    let prints = prints.map(|(coding, text)| {
        let (board, is_over) = (Arc::clone(&board), Arc::clone(&is_over));
        let bytes: Vec<u8> = text.iter().filter_map(|b| encode(coding, *b)).collect();
        thread::spawn(move || {
            while !is_over.load(Ordering::Relaxed) {
                board.control_sends(&bytes);
                let takes = control.character_us() * bytes.len() as u64;
                thread::sleep(Duration::from_micros(takes));
            }
        })
    });
    let mut all = vec!["line", "find", "--port", &address, "--seconds", "2"];
    all.extend(arguments);
    let ran = umi(&all);
    is_over.store(true, Ordering::Relaxed);
    if let Some(prints) = prints {
        prints.join().unwrap();
    }
    ran
}

/// The speed and the code of a control are found among others.
#[test]
fn the_speed_of_a_control_is_found() {
    for (baud, coding, name) in [
        (19_200, Coding::IsoEven, "iso_even"),
        (38_400, Coding::Ascii, "ascii"),
        (9600, Coding::Eia, "eia"),
    ] {
        let others = ["--baud", "4800,9600,38400,19200,115200", "--json"];
        let found = find(baud, Some(coding), &others).exits(0).json();
        assert_eq!(found["found"], json!({ "baud": baud, "coding": name }));
        let tried = found["tried"].as_array().unwrap();
        assert_eq!(tried.last().unwrap()["fits"], true);
        let fits = tried.iter().filter(|of| of["fits"] == true).count();
        assert_eq!(fits, 1, "{found}");
    }
    let text = find(9600, Some(Coding::IsoEven), &["--baud", "9600"]).exits(0);
    assert!(text.out.contains("fits 9600 baud"), "{}", text.out);
    assert!(text.out.contains("data_bits = 7"), "{}", text.out);
    // What is printed is a job's, and holds no board up that has no CTS.
    let block = text.out.split_once("In the job:\n").unwrap().1;
    assert!(
        block.contains("[line]   # the same: control = \"mitsubishi\", or control = \"mazak\"")
    );
    let block: toml::Table = toml::from_str(block).unwrap();
    let line: umi_protocol::serial::LineSpec = block["line"].clone().try_into().unwrap();
    assert_eq!((line.baud, line.rts_cts), (Some(9600), Some(false)));
}

/// What does not fit is said, and what does not come.
#[test]
fn what_does_not_fit_is_said() {
    let wrong = ["--baud", "4800,115200"];
    find(19_200, Some(Coding::IsoEven), &wrong)
        .exits(2)
        .says("no speed fits");
    find(19_200, None, &["--baud", "19200"])
        .exits(2)
        .says("nothing came");
    let open = Some((Coding::IsoEven, &b"X1.234 Y5.678 "[..]));
    find_text(19_200, open, &["--baud", "19200"])
        .exits(2)
        .says("no line has ended");
    // Right at its speed, whatever is said of others.
    let few = Some((Coding::Ascii, &b"N10\n"[..]));
    find_text(9600, few, &["--baud", "9600"])
        .exits(2)
        .says("at 9600 baud every character is right, but only 4 different ones came")
        .says("print more different characters");
    umi(&["line", "find", "--baud", "200"]).exits(1);
}
