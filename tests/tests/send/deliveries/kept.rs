//! What is kept of what a control punches or sends by XMODEM: whole programs, and whatever
//! is not kept is told. On the virtual board.

use std::thread::sleep;
use std::time::Duration;

use umi_client::board::link::Client;
use umi_client::programs;
use umi_protocol::message::Record;
use umi_protocol::program::{ProgramRefusal, Release};
use umi_tests::cases::*;
use umi_tests::rig::{Rig, VirtualRig};

use super::common::*;

const ACK: &str = "\u{6}";

/// The programs that the board keeps, with their texts.
fn kept(client: &mut Client) -> Vec<(u32, String)> {
    let (_, listed) = programs::list(client).unwrap();
    let mut text = |program| programs::get(client, program, |_| {}).unwrap();
    listed
        .iter()
        .map(|program| (program.number, String::from_utf8(text(program)).unwrap()))
        .collect()
}

/// What the journal says of programs that are not kept, when there are so many.
fn not_kept(rig: &mut VirtualRig, client: &mut Client, count: usize) -> Vec<(u32, ProgramRefusal)> {
    until(rig, "that it is not kept", |_| {
        let (records, _) = journal(client);
        let told = records.iter().filter_map(|record| match record {
            Record::ProgramNotKept { number, why } => Some((*number, *why)),
            _ => None,
        });
        Some(told.collect::<Vec<_>>()).filter(|told| told.len() >= count)
    })
}

fn even(text: &str) -> Vec<u8> {
    text.bytes()
        .map(|byte| byte | u8::from(byte.count_ones() % 2 == 1) << 7)
        .collect()
}

/// The control closes its port (DC4) where the operator stops it, or noise makes an end
/// (ETX) of a byte: half a program is none.
#[test]
fn a_port_that_is_closed_before_the_last_percent() {
    let (rig, client) = &mut start(&plain_job());
    for (count, cut) in (1..).zip(["\x14", "X2\x14", "X2.\x03\r\nM30\r\n%\r\n\x14"]) {
        let text = "\x12%\r\nO0077\r\nG0 X1.\r\nG1 Z-5.\r\n".to_owned() + cut;
        rig.control_sends(text.as_bytes());
        let told = not_kept(rig, client, count);
        assert_eq!(told.last(), Some(&(77, ProgramRefusal::BrokeOff)));
    }
    assert_eq!(kept(client), []);
}

/// Neither what follows a first line that is damaged or has no number: a subprogram of it
/// is not the program. It is told once.
#[test]
fn a_program_whose_number_is_not_known() {
    let (rig, client) = &mut start(&plain_job());
    let rest = "G0 X1.\nM98 P78\nM30\nO0078\nG1 Z-5.\nM99\n%\n";
    let mut bytes = even(&("%\nO0077\n".to_owned() + rest));
    bytes[3] ^= 1;
    for text in [even(&long()), bytes, even(&("%\nG21\n".to_owned() + rest))] {
        // As slowly as a line of 4800 baud, so that each line is taken by itself.
        for line in text.split_inclusive(|byte| *byte == b'\n') {
            rig.control_sends(line);
            sleep(Duration::from_millis(5));
        }
    }
    let unknown = (0, ProgramRefusal::BadNumber);
    assert_eq!(not_kept(rig, client, 2), [unknown, unknown]);
    assert_eq!(kept(client), [(1234, long())]);
}

/// Comments may stand before the number.
#[test]
fn a_number_behind_comments() {
    let (rig, client) = &mut start(&plain_job());
    let text = "%\n(BY CAM)\nO0077(PART)\nM30\n%\n";
    rig.control_sends(text.as_bytes());
    let programs = until(rig, "the program", |_| {
        Some(kept(client)).filter(|kept| !kept.is_empty())
    });
    assert_eq!(programs, [(77, text.to_owned())]);
    assert_eq!(programs::list(client).unwrap().1[0].name, "PART");
}

/// As a control punches all that it has, without a pause, however its port is opened and
/// closed between them.
#[test]
fn programs_without_a_pause_between_them() {
    let (rig, client) = &mut start(&plain_job());
    let text = |number: u32| format!("%\nO{number:04}\nG0 X{number}.\nM30\n%\n");
    let ends = ["", "\r\n", "\0\0\0", "\x14\x12", "\r\r\0\x14\0\x12"];
    let all: String = (1..)
        .zip(ends)
        .map(|(number, end)| text(number) + end)
        .collect();
    rig.control_sends(all.as_bytes());
    let programs = until(rig, "the programs", |_| {
        Some(kept(client)).filter(|kept| kept.len() == ends.len())
    });
    let expected: Vec<_> = (1..).take(ends.len()).map(|n| (n, text(n))).collect();
    assert_eq!(programs, expected);
}

/// One wrong character anywhere, or bytes that were lost: nothing of it is kept, that is
/// told, and the next one is.
#[test]
fn a_damaged_line_of_a_program() {
    let (rig, client) = &mut start(&plain_job());
    let mut bytes = even(&long());
    bytes[1500] ^= 1;
    rig.control_sends(&bytes);
    let told = (1234, ProgramRefusal::BrokeOff);
    assert_eq!(not_kept(rig, client, 1), [told]);
    assert_eq!(kept(client), []);
    rig.control_sends(&even(&long()));
    until(rig, "the program", |_| {
        (kept(client) == [(1234, long())]).then_some(())
    });
}

/// One that stops in the middle, and one behind it: never a program of both.
#[test]
fn a_program_without_its_end() {
    let mut job = plain_job();
    job.receiver.idle_timeout_s = 1;
    let (rig, client) = &mut start(&job);
    let half = &long()[..1000];
    rig.control_sends(half.as_bytes());
    let told = (1234, ProgramRefusal::BrokeOff);
    assert_eq!(not_kept(rig, client, 1), [told]);
    rig.control_sends(NINE.as_bytes());
    until(rig, "the program", |_| {
        (kept(client) == [(9, NINE.to_owned())]).then_some(())
    });
    // A new job: who reads the lines has seen no program begin.
    rig.control_sends(half.as_bytes());
    until(rig, "the first half", |_| {
        (client.status().unwrap().counters.bytes >= 2000 + NINE.len() as u64).then_some(())
    });
    client.set_job(&plain_job()).unwrap().unwrap();
    rig.control_sends(&long().as_bytes()[1000..]);
    rig.control_sends(NINE.replace('9', "8").as_bytes());
    assert_eq!(not_kept(rig, client, 2), [told, told]);
    let programs = until(rig, "the program", |_| {
        Some(kept(client)).filter(|kept| kept.len() == 2)
    });
    let eight = (8, NINE.replace('9', "8"));
    assert!(programs.contains(&eight), "{programs:?}");
    assert_eq!(client.program_receive().unwrap(), Ok(()));
}

/// Longer than all the room there is: told, and what was there is there.
#[test]
fn a_program_that_finds_no_room() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 9, NINE, Release::Always, 5);
    let (room, _) = programs::list(client).unwrap();
    // All but two sectors.
    let filler = "(X)\n".repeat(room.longest_bytes as usize / 4 - 8192);
    put(client, 5, &filler, Release::Always, 5);
    let (room, _) = programs::list(client).unwrap();
    let text = long().replace("M30", &"G1 X1.\n".repeat(room.longest_bytes as usize / 7));
    for piece in text.as_bytes().chunks(1000) {
        rig.control_sends(piece);
        sleep(Duration::from_millis(90));
    }
    let told = not_kept(rig, client, 1);
    assert!(
        matches!(told[..], [(1234, ProgramRefusal::Full { .. })]),
        "{told:?}"
    );
    assert_eq!(kept(client).len(), 2);
    // It has left its room.
    rig.control_sends(NINE.replace('9', "8").as_bytes());
    until(rig, "the program", |_| {
        (kept(client).len() == 3).then_some(())
    });
}

/// Sends these pieces as blocks, and the end; what the board answered last.
fn sends_blocks(rig: &mut VirtualRig, client: &mut Client, text: &[u8]) -> String {
    asks_for_blocks(rig, client);
    for (number, piece) in (1..).zip(text.chunks(128)) {
        rig.control_sends(&block(number, piece));
        assert_eq!(receive(rig, 1), ACK);
    }
    rig.control_sends(&[4, 4]);
    let answer = receive(rig, 1);
    receive_all(rig);
    answer
}

/// A number that goes on in the next block is not known; comments in any code, and blank
/// tape for padding, are no damage.
#[test]
fn first_and_last_blocks() {
    let (rig, client) = &mut start(&plain_job());
    let split = format!("%\n({})\nO1234\nM30\n%\n", "X".repeat(120));
    assert_eq!(split.find("34\nM30"), Some(128));
    let refused = sends_blocks(rig, client, split.as_bytes());
    assert_eq!(refused, "\u{18}");
    let told = (0, ProgramRefusal::BadNumber);
    assert_eq!(not_kept(rig, client, 1), [told]);
    let text = b"%\n(\xD8 10)\nO0077(\xD8 10)\nM30\n%\n".to_vec();
    assert_eq!(sends_blocks(rig, client, &text), ACK);
    let mut padded = NINE.as_bytes().to_vec();
    padded.resize(128, 0);
    assert_eq!(sends_blocks(rig, client, &padded), ACK);
    let (_, listed) = programs::list(client).unwrap();
    let got = |number: u32| listed.iter().find(|program| program.number == number);
    assert_eq!(got(77).unwrap().crc32, programs::check_value(&text));
    assert_eq!(got(9).unwrap().crc32, programs::check_value(&padded));
}

/// A host that asks twice gets one program; when that has ended, or the host has gone before
/// it began, what the control prints is measured as ever.
#[test]
fn nothing_asks_for_blocks_that_nobody_wants() {
    let (rig, client) = &mut start(&plain_job());
    asks_for_blocks(rig, client);
    let again = client.program_receive().unwrap();
    assert_eq!(again, Err(ProgramRefusal::Busy));
    rig.control_sends(&[0x18, 0x18]);
    assert_eq!(not_kept(rig, client, 1), [(0, ProgramRefusal::BrokeOff)]);
    client.status().unwrap();
    sleep(Duration::from_millis(200));
    client.status().unwrap();
    assert_eq!(receive_all(rig), "");

    // In the middle: its room is free again.
    asks_for_blocks(rig, client);
    for (number, piece) in (1..4).zip(long().as_bytes().chunks(128)) {
        rig.control_sends(&block(number, piece));
        assert_eq!(receive(rig, 1), ACK);
    }
    rig.control_sends(&[0x18, 0x18]);
    assert_eq!(
        not_kept(rig, client, 2)[1],
        (1234, ProgramRefusal::BrokeOff)
    );
    put(client, 9, NINE, Release::Always, 5);

    asks_for_blocks(rig, client);
    rig.unplug();
    sleep(Duration::from_millis(200));
    rig.control_sends(("\r\n".to_owned() + &clamping(0)).as_bytes());
    let client = &mut connect(rig);
    judged(rig, client, 1);
}

/// A host that is unplugged in the middle costs nothing, a power cut what has come.
#[test]
fn a_host_or_the_power_goes_in_the_middle() {
    let (rig, mut client) = start(&plain_job());
    let rig = &mut { rig };
    let text = long();
    let blocks: Vec<_> = (1..)
        .zip(text.as_bytes().chunks(128))
        .map(|(number, piece)| block(number, piece))
        .collect();
    for is_power in [true, false] {
        asks_for_blocks(rig, &mut client);
        let (first, rest) = blocks.split_at(5);
        for block in first {
            rig.control_sends(block);
            assert_eq!(receive(rig, 1), ACK);
        }
        if is_power {
            drop(client);
            rig.power_cycle();
            client = connect(rig);
            assert_eq!(kept(&mut client), []);
            continue;
        }
        drop(client);
        rig.unplug();
        for block in rest {
            rig.control_sends(block);
            assert_eq!(receive(rig, 1), ACK);
        }
        rig.control_sends(&[4, 4]);
        assert_eq!(receive(rig, 1), ACK);
        client = connect(rig);
        assert_eq!(kept(&mut client), [(1234, long())]);
    }
}
