//! A Haas mill with classic control, recorded by a sniffer on 2017-10-30: appendix of the
//! README of the OpenDNC project (A. Pal, Purdue University). 8N1, XMODEM, EOB `LF ONLY`.
//!
//! R1 is the program from the control, R2 the same program to it. Who says what when, and the
//! first and the last block, are as recorded; what stands in the blocks between is not.

use std::string::String;
use std::vec;
use std::vec::Vec;

use super::*;
use crate::control::xmodem::receiver::{self, BlockReceiver};
use crate::control::xmodem::sender::{self, BlockSender};

/// The first block of both, as recorded, and its check sum.
const FIRST: &str = "\n%\nO05555(CS390_Test_NC)\n(Using G0 which travels along dogleg path.)\n\
    (T1 D=2. CR=0. - ZMIN=-0.125 - face mill)\n(T3 D=0.5 CR=0. -";
const FIRST_SUM: u8 = 0x98;
/// What the last block has before its 48 SUBs, as recorded, and its check sum.
const LAST: &str = "0.\n\nN66435M05\nN66440M09\nN66445G53G00Z0.\nN66455X2.1875\nN66460G53Y0.\nN66465M30\n\n\
    %\n";
const LAST_SUM: u8 = 0xE4;

/// The program of both: the blocks between are filled with motions of our own.
fn program() -> String {
    let mut text = String::from(FIRST);
    for line in 0.. {
        text += &std::format!("N{} G01 X{line}.5 Y-{line}.25\n", 10 * line + 100);
        if text.len() > 7 * BLOCK {
            break;
        }
    }
    text.truncate(7 * BLOCK);
    text + LAST
}

/// The eight blocks, the first and the last with the check sums of the control.
fn blocks() -> Vec<Vec<u8>> {
    let text = program();
    let mut blocks: Vec<_> = (1..)
        .zip(text.as_bytes().chunks(BLOCK))
        .map(|(number, piece)| frame(number, piece))
        .collect();
    assert_eq!(blocks.len(), 8);
    blocks[0][FRAME - 1] = FIRST_SUM;
    blocks[7][FRAME - 1] = LAST_SUM;
    blocks
}

/// R1: the answers are byte for byte those of the recorded computer, and the program is
/// what it received, without the 48 SUBs of the last block.
#[test]
fn r1_a_program_from_the_control() {
    let wanted = program();
    let mut receiver = BlockReceiver::new(0);
    let mut now = 0;
    let mut answers = Vec::new();
    let mut program = Vec::new();
    // The control says nothing to the first NAK, and begins at the second.
    let mut control = blocks();
    control.push(vec![EOT]);
    control.reverse();
    let outcome = loop {
        match receiver.next(Micros(now)) {
            receiver::ReceiveStep::Send(bytes) => {
                answers.extend(bytes.iter().map(|byte| (now / 1_000_000, *byte)));
                receiver.sent(Micros(now));
                if answers.len() > 1 {
                    for byte in control.pop().unwrap_or_default() {
                        now += 87;
                        receiver.received(byte, Micros(now));
                    }
                }
            }
            receiver::ReceiveStep::Data { bytes, last } => {
                program.extend_from_slice(bytes);
                assert_eq!(last, program.len() == wanted.len());
                receiver.taken();
            }
            receiver::ReceiveStep::WaitUntil(then) => now = then.0,
            receiver::ReceiveStep::Done(outcome) => break outcome,
        }
    };
    assert_eq!(outcome, receiver::ReceiveOutcome::Complete);
    assert_eq!(core::str::from_utf8(&program), Ok(wanted.as_str()));
    // 10:27:11, 10:27:21, and all the rest within a second or two.
    let mut recorded = vec![(0, NAK), (10, NAK)];
    recorded.extend([(10, ACK); 8]);
    recorded.push((11, ACK));
    assert_eq!(answers, recorded);
}

/// R2: three NAKs are one. Block 1 goes out once (the recorded computer sent it twice, and had
/// block 2 refused), block 2 twice because the control wants it again, and three CANs behind
/// the EOT are an end.
#[test]
fn r2_a_program_to_the_control() {
    // What the control says after what it was sent.
    let mut control = vec![
        vec![ACK],
        vec![NAK],
        vec![ACK],
        vec![ACK],
        vec![ACK],
        vec![ACK],
        vec![ACK],
        vec![ACK],
        vec![ACK],
        vec![CAN; 3],
    ]
    .into_iter();
    let mut sender = BlockSender::new(Micros(0));
    let mut now = 0;
    // 10:32:35, and two more 10:32:37, before anybody looked.
    for (at, byte) in [(0, NAK), (2_000_000, NAK), (2_000_000, NAK)] {
        now = at;
        sender.received(byte, Micros(now));
    }
    let mut sent = Vec::new();
    let text = program();
    let mut rest = text.as_bytes();
    let outcome = loop {
        match sender.next(Micros(now)) {
            sender::SendStep::NeedData { room } => {
                let (piece, later) = rest.split_at(room.min(rest.len()).min(50));
                assert_eq!(sender.data(piece, later.is_empty()), piece.len());
                rest = later;
            }
            sender::SendStep::Send(bytes) => {
                sent.push(bytes.to_vec());
                now += 87 * bytes.len() as u64;
                sender.sent(Micros(now));
                for byte in control.next().unwrap() {
                    now += 87;
                    sender.received(byte, Micros(now));
                }
            }
            sender::SendStep::WaitUntil(then) => now = then.0,
            sender::SendStep::Done(outcome) => break outcome,
        }
    };
    assert_eq!(outcome, sender::SendOutcome::CompleteByCancel);
    let mut recorded = blocks();
    recorded.insert(1, recorded[1].clone());
    recorded.push(vec![EOT]);
    assert_eq!(sent, recorded);
    // It never waited for an answer that had come.
    assert!(now < 2_000_000 + 2 * SETTLE_US + 200_000, "{now}");
}
