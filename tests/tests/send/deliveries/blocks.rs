//! Programs in blocks, on the virtual board: what answers none, what is too late, what begins in the midst of one.

use std::thread::sleep;
use std::time::Duration;

use umi_protocol::message::Record;
use umi_protocol::pattern::Coding;
use umi_protocol::program::{Release, Withheld};
use umi_tests::cases::*;
use umi_tests::rig::Rig;

use super::common::*;

/// Lines ended by CR alone stay lines where the code has one end of block.
#[test]
fn eia_gets_every_end_of_block() {
    let mut job = plain_job();
    job.receiver.coding = Coding::Eia;
    let (rig, client) = &mut start(&job);
    put(
        client,
        9,
        "%\rO0009\rG1X10.\rY20.\rM30\r%\r",
        Release::Always,
        5,
    );
    client.program_offer(9).unwrap().unwrap();
    rig.control_sends(DC1);
    let mut bytes = Vec::new();
    while let Some(byte) = rig.control_receives(Duration::from_millis(100)) {
        bytes.push(byte)
    }
    let blocks = bytes.iter().filter(|b| **b == 0x80).count();
    assert!(
        blocks >= 5,
        "{blocks} ends of block in {} bytes {bytes:02X?}",
        bytes.len()
    );
}

/// What a control prints while the board waits for blocks of XMODEM is no block: it is
/// lost, that is journaled, and the verdict before it does not hold any more.
#[test]
fn lines_that_come_for_blocks_are_a_loss() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, POCKET, Release::AfterVerdict, 5);
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, client, 1);
    asks_for_blocks(rig, client);
    rig.control_sends(clamping(1).as_bytes());
    rig.control_sends(&[0x18, 0x18]);
    let lost = until(rig, "the loss", |_| {
        let (records, _) = journal(client);
        records.iter().find_map(|record| match record {
            Record::BytesLost { count } => Some(*count),
            _ => None,
        })
    });
    assert_eq!(lost as usize, clamping(1).len() + 2);
    // Behind a loss a line counts from where one begins for sure.
    rig.control_sends(b"\r\n");
    read(rig, 1234);
    let got = receive_all(rig);
    assert!(
        got.ends_with(&alarm_of(1234, &Withheld::NoVerdict)),
        "{got}"
    );
}

/// A NAK is also an alarm of controls that know no blocks, or noise. Until a block is
/// acknowledged, what the control says is heard: it reads and prints as ever.
#[test]
fn blocks_end_where_the_control_says_something_else() {
    let mut job = umi_tests::cases::job();
    job.receiver.idle_timeout_s = 1;
    let (rig, client) = &mut start(&job);
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, client, 2);
    let correction = client.verdict().unwrap().unwrap().correction.unwrap().text;
    rig.control_sends(&[0x15]);
    assert_eq!(receive(rig, 1), "\u{1}");
    assert_eq!(receive_all(rig).chars().count(), 131);
    rig.control_sends(DC1);
    receive_text(rig, &correction);
    // Until then a NAK is part of the line behind it.
    let line = Duration::from_millis(1500);
    sleep(line);
    rig.control_sends(clamping(2).as_bytes());
    assert_eq!(judged(rig, client, 3).verdicts_ok, 3);
    rig.control_sends(&[0x15]);
    assert_eq!(receive(rig, 1), "\u{1}");
    sleep(line);
    rig.control_sends(clamping(3).as_bytes());
    assert_eq!(judged(rig, client, 4).verdicts_ok, 4);
}

/// What began on a plain line and broke off there: a NAK is an alarm of that control.
#[test]
fn what_began_on_a_plain_line_does_not_go_on_in_blocks() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, &long(), Release::Always, 5);
    let _ = stopped(rig, b"READ O1234\r\n\x11", 200);
    for _ in 0..2 {
        rig.control_sends(&[0x15]);
        sleep(Duration::from_millis(700));
        assert_eq!(receive_all(rig), "");
    }
    rig.control_sends(DC1);
    receive_text(rig, &long());
}

/// What a control says while a block goes out answers nothing: neither is the block sent
/// twice nor the next one begun before it is acknowledged.
#[test]
fn what_comes_in_the_middle_of_a_block_is_no_answer_to_it() {
    for answer in [0x15, 0x06] {
        let (rig, client) = &mut start(&plain_job());
        put(client, 1234, POCKET, Release::Always, 5);
        client.program_offer(1234).unwrap().unwrap();
        rig.control_sends(&[0x15]);
        let first = receive(rig, 60);
        rig.control_sends(&[answer]);
        let rest = receive(rig, 72);
        assert_eq!(receive_all(rig), "", "{answer}");
        let sent: Vec<u8> = (first + &rest).chars().map(|c| c as u8).collect();
        assert_eq!(sent, block(1, &POCKET.as_bytes()[..128]));
        rig.control_sends(&[0x06]);
        assert_eq!(receive(rig, 2), "\u{1}\u{2}");
    }
}

/// The NAK that asked for it is no line that was printed: a program that needs a verdict
/// may take longer than a line may.
#[test]
fn blocks_may_take_longer_than_a_line() {
    let mut job = plain_job();
    job.receiver.idle_timeout_s = 1;
    let (rig, client) = &mut start(&job);
    put(client, 1234, POCKET, Release::AfterVerdict, 5);
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, client, 1);
    rig.control_sends(b"READ O1234\r\n\x15");
    receive(rig, 132);
    sleep(Duration::from_millis(1500));
    rig.control_sends(&[0x06]);
    assert_eq!(receive(rig, 2), "\u{1}\u{2}");
}

/// Without a verdict a control that reads by XMODEM gets nothing, and no alarm: NAK is what
/// it says in many states.
#[test]
fn a_nak_gets_no_alarm() {
    let (rig, _client) = &mut start(&umi_tests::cases::job());
    rig.control_sends(&[0x15]);
    sleep(Duration::from_millis(700));
    assert_eq!(receive_all(rig), "");
}

/// Blocks have eight bits, whatever parity the control prints with.
#[test]
fn blocks_have_no_parity() {
    let mut job = plain_job();
    job.receiver.coding = Coding::IsoEven;
    let (rig, client) = &mut start(&job);
    put(client, 9, NINE, Release::Always, 5);
    client.program_offer(9).unwrap().unwrap();
    rig.control_sends(&[0x15]);
    let sent: Vec<u8> = receive(rig, 132).chars().map(|c| c as u8).collect();
    assert_eq!(sent, block(1, NINE.as_bytes()));
}

/// What is taken back is cancelled, and what the control cancels has not gone out: it may
/// have it once more.
#[test]
fn blocks_that_break_off() {
    let mut job = plain_job();
    job.receiver.idle_timeout_s = 1;
    let (rig, client) = &mut start(&job);
    put(client, 1234, POCKET, Release::AfterVerdict, 5);
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, client, 1);
    rig.control_sends(b"READ O1234\r\n\x15");
    receive(rig, 132);
    rig.control_sends(&[0x18, 0x18]);
    // The NAK is part of a line for so long.
    sleep(Duration::from_millis(1500));
    assert_eq!(receive_all(rig), "");
    rig.control_sends(b"READ O1234\r\n\x15");
    receive(rig, 132);
    client.set_job(&plain_job()).unwrap().unwrap();
    rig.control_sends(&[0x06]);
    assert_eq!(receive_all(rig), "\u{18}\u{18}\u{18}");
    let (records, _) = journal(client);
    let is_whole = |record: &Record| match record {
        Record::ProgramSent { complete, .. } => Some(*complete),
        _ => None,
    };
    assert!(records.iter().filter_map(is_whole).eq([false, false]));
}
