//! The control's line at each speed that controls have, on every board: set by the job, and again
//! after the power was gone.

use std::time::Duration;

use umi_protocol::program::Release;
use umi_protocol::serial::{LineSettings, LineSpec};
use umi_tests::cases::*;
use umi_tests::on_every_board;
use umi_tests::rig::Rig;

on_every_board! {
    lines_and_programs_pass_at_the_speed_of_the_job
    two_stop_bits_pass_both_ways
}

/// Speeds that are tried each time; the slowest takes a minute in an emulator.
const QUICK: [u32; 6] = [4800, 9600, 19_200, 38_400, 115_200, 230_400];
/// A program that goes out.
const PROGRAM: &str = "%\nO1234\nG0 X1.5\nM30\n%\n";
/// What the control prints.
const PRINTED: &str = "POINT: 1.0000 2.0000 3.0000\r\nPOINT: -1.5000 2.5000 -3.5000\r\n";

/// The board with a line of this speed.
fn set(rig: &mut dyn Rig, baud: u32) {
    let mut job = job();
    job.correction = None;
    job.line = LineSpec {
        baud: Some(baud),
        ..LineSpec::default()
    };
    connect(rig).set_job(&job).unwrap().unwrap();
    rig.control_line(LineSettings {
        baud,
        ..LineSettings::DEFAULT
    });
    settle(rig);
}

/// The port follows when what the job has changed has been looked at: milliseconds.
fn settle(rig: &mut dyn Rig) {
    let begun = rig.time();
    while rig.time() - begun < Duration::from_millis(50) {
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The board's port has this speed, where that can be seen.
fn holds(rig: &mut dyn Rig, baud: u32) {
    if let Some(set) = rig.board_baud() {
        let off = set / f64::from(baud) - 1.0;
        assert!(off.abs() < 0.005, "{}: {set}, not {baud}", rig.name());
    }
}

/// A READ by number gets the program, as it is, no faster than the line; what the control prints
/// is in the journal, every byte of it.
fn exchange(rig: &mut dyn Rig, baud: u32) {
    let mut client = connect(rig);
    let bytes = |client: &mut umi_client::board::link::Client| raw_bytes(&journal(client).0);
    let before = bytes(&mut client).len();
    // At the slowest it takes as long.
    let character = Duration::from_secs(11) / baud;
    rig.control_sends(PRINTED.as_bytes());
    rig.control_sends(b"READ O1234\r\n");
    rig.control_sends(DC1);
    let begun = rig.time();
    let mut got = String::new();
    while got.len() < PROGRAM.len() {
        let patience = Duration::from_secs(3) + 120 * character;
        let byte = rig.control_receives(patience);
        let byte = byte.unwrap_or_else(|| panic!("{} {baud}: {got:?}", rig.name()));
        got.push(char::from(byte));
    }
    assert_eq!(got, PROGRAM, "{} {baud}", rig.name());
    if rig.line_takes_time() {
        let least = Duration::from_secs(9) / baud * PROGRAM.len() as u32;
        let took = rig.time() - begun;
        assert!(took >= least, "{} {baud}: {took:?}", rig.name());
    }
    let expected = [PRINTED.as_bytes(), b"READ O1234\r\n", DC1].concat();
    let came = until(rig, "what was printed", |_| {
        let all = bytes(&mut client);
        (all.len() >= before + expected.len()).then_some(all)
    });
    assert!(came[before..] == expected, "{} {baud}", rig.name());
    assert_eq!(client.status().unwrap().counters.bytes_lost, 0, "{baud}");
}

/// Keeps the program that goes out.
fn keep_program(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let program = umi_protocol::program::ProgramInfo {
        number: 1234,
        name: "PART".parse().unwrap(),
        bytes: PROGRAM.len() as u32,
        crc32: umi_client::programs::check_value(PROGRAM.as_bytes()),
        release: Release::Always,
        hold_s: 5,
        stated: umi_protocol::program::Stated::default(),
    };
    umi_client::programs::put(&mut client, &program, PROGRAM.as_bytes(), |_| {}).unwrap();
}

fn at_speeds(rig: &mut dyn Rig, speeds: &[u32]) {
    set(rig, 115_200);
    keep_program(rig);
    for baud in speeds {
        set(rig, *baud);
        exchange(rig, *baud);
        holds(rig, *baud);
    }
    // The job says it again when the power comes back.
    let last = speeds.last().copied().unwrap();
    rig.power_cycle();
    exchange(rig, last);
    holds(rig, last);
}

fn lines_and_programs_pass_at_the_speed_of_the_job(rig: &mut dyn Rig) {
    // The last one is not what a board begins with.
    let mut speeds = QUICK;
    speeds.reverse();
    at_speeds(rig, &speeds);
}

/// What a board is set to, and what its control is: both two as Fanuc's frame is, and one against two.
const STOP_BITS: [[u8; 2]; 3] = [[2, 2], [2, 1], [1, 2]];
/// As Fanuc's fastest line.
const FANUC_BAUD: u32 = 19_200;

/// A board that is set to two stop bits sends them, and takes characters with one or with two behind
/// them. One that cannot refuses the job, and says why.
fn two_stop_bits_pass_both_ways(rig: &mut dyn Rig) {
    keep_program(rig);
    for [board, control] in STOP_BITS {
        let mut job = job();
        job.correction = None;
        job.line = LineSpec {
            baud: Some(FANUC_BAUD),
            stop_bits: Some(board),
            ..LineSpec::default()
        };
        match connect(rig).set_job(&job).unwrap() {
            Ok(_) => {}
            Err(error) => {
                // The UART of this machine in QEMU has no second one.
                assert_eq!((rig.name(), board), ("mps2-an500", 2), "{error:?}");
                assert!(format!("{error}").contains("line.stop_bits"), "{error}");
                continue;
            }
        }
        rig.control_line(LineSettings {
            baud: FANUC_BAUD,
            stop_bits: control,
            ..LineSettings::DEFAULT
        });
        settle(rig);
        rig.frame_bits();
        exchange(rig, FANUC_BAUD);
        if let Some(bits) = rig.frame_bits() {
            for (bits, stop_bits) in bits.into_iter().zip([board, control]) {
                let off = bits - f64::from(9 + stop_bits);
                assert!(off.abs() < 0.05, "{stop_bits} stop bits: {bits} bits");
            }
        }
    }
}

mod long {
    use umi_tests::rig::{PicoRig, QemuRig, VirtualRig};

    use super::*;

    /// A clamping and the correction of it, read back, at each speed.
    fn sessions(rig: &mut dyn Rig) {
        const SPEEDS: [u32; 7] = [230_400, 115_200, 38_400, 19_200, 9600, 4800, 300];
        at_speeds(rig, &SPEEDS);
        for (number, baud) in (1..).zip(SPEEDS) {
            let mut job = job();
            job.line.baud = Some(baud);
            let mut client = connect(rig);
            client.set_job(&job).unwrap().unwrap();
            rig.control_line(LineSettings {
                baud,
                ..LineSettings::DEFAULT
            });
            let before = client.status().unwrap().verdicts;
            let text = clamping(0) + &clamping(1);
            rig.control_sends(text.as_bytes());
            let line = Duration::from_secs(11) / baud * text.len() as u32;
            let begun = rig.time();
            while client.status().unwrap().verdicts < before + 2 {
                let waited = rig.time() - begun;
                assert!(waited < line + Duration::from_secs(10), "{baud}");
                std::thread::sleep(Duration::from_millis(20));
            }
            rig.control_sends(DC1);
            let patience = Duration::from_secs(3) + Duration::from_secs(1200) / baud;
            let mut got = Vec::new();
            while let Some(byte) = rig.control_receives(patience) {
                got.push(byte);
            }
            let got = String::from_utf8(got).unwrap();
            let lines = got.lines().collect::<Vec<_>>();
            assert!(got.contains("G10 L2 P"), "{number} {baud}: {got}");
            assert_eq!((lines.first(), lines.last()), (Some(&"%"), Some(&"%")));
            assert_eq!(client.status().unwrap().counters.bytes_lost, 0, "{baud}");
        }
    }

    #[test]
    #[ignore = "four minutes: the line of 300 baud takes its time"]
    fn on_the_virtual_board() {
        sessions(&mut VirtualRig::start().unwrap());
    }

    #[test]
    #[ignore = "minutes: the line of 300 baud takes its time"]
    fn on_qemu() {
        if let Some(mut rig) = QemuRig::start_or_skip() {
            sessions(&mut rig);
        }
    }

    #[test]
    #[ignore = "a minute and more: the line of 300 baud takes its time"]
    fn on_the_emulated_pico() {
        if let Some(mut rig) = PicoRig::start_or_skip() {
            sessions(&mut rig);
        }
    }
}
