//! A Haas mill with classic control, recorded by a sniffer on 2017-10-30: appendix of the
//! README of the OpenDNC project (A. Pal, Purdue University). 8N1, XMODEM, EOB `LF ONLY`.
//!
//! R1 is the program from the control, R2 the same program to it.

use std::vec;
use std::vec::Vec;

use super::*;
use crate::xmodem::receiver::{self, Receiver};
use crate::xmodem::sender::{self, Sender};

/// The program of both.
const PROGRAM: &str = "\n%\nO05555(CS390_Test_NC)\n(Using G0 which travels along dogleg path.)\n\
    (T1 D=2. CR=0. - ZMIN=-0.125 - face mill)\n\
    (T3 D=0.5 CR=0. - ZMIN=-1.125 - flat end mill)\nN10G90G94G17\nN15G20\nN20G53G00Z0.\n\n\
    (Face3)\nN30T1M06\nN35S6500M03\nN40G54\nN45M08\nN60G00X5.675Y0.3147\nN65G43Z1.H1\nN70T3\n\
    N75G00Z0.5\nN80G01Z0.175F65.\nN85G18G03X5.475Z-0.025I-0.2K0.\nN90G01X4.375\nN95X0.\n\
    N100G17G02Y1.6103I0.J0.6478\nN105G01X4.375\nN110G03Y2.906I0.J0.6478\nN115G01X0.\n\
    N120G18G03X-0.2Z0.175I0.K0.2\nN125G00Z0.5\nN130X-1.3Y0.3147\nN135G01Z0.125F65.\n\
    N140G02X-1.1Z-0.075I0.2K0.\nN145G01X0.\nN150X4.375\nN155G17G03Y1.6103I0.J0.6478\n\
    N160G01X0.\nN165G02Y2.906I0.J0.6478\nN170G01X4.375\nN175G18G02X4.575Z0.125I0.K0.2\n\
    N180G00Z0.5\nN185X5.675Y0.3147\nN190G01Z0.075F65.\nN195G03X5.475Z-0.125I-0.2K0.\n\
    N200G01X4.375\nN205X0.\nN210G17G02Y1.6103I0.J0.6478\nN215G01X4.375\n\
    N220G03Y2.906I0.J0.6478\nN225G01X0.\nN230G18G03X-0.2Z0.075I0.K0.2\nN235G00Z1.\nN240M05\n\
    N245G53G00Z0.\n\nN66435M05\nN66440M09\nN66445G53G00Z0.\nN66455X2.1875\nN66460G53Y0.\n\
    N66465M30\n\n%\n";

/// The check sums of its eight blocks.
const SUMS: [u8; 8] = [0x98, 0x26, 0x41, 0xFE, 0x1C, 0x23, 0x29, 0xE4];

/// The eight blocks, with the check sums of the control.
fn blocks() -> [Vec<u8>; 8] {
    let mut pieces = PROGRAM.as_bytes().chunks(BLOCK);
    let mut number = 0;
    let blocks = SUMS.map(|check| {
        number += 1;
        let mut block = frame(number, pieces.next().unwrap());
        block[FRAME - 1] = check;
        block
    });
    assert_eq!(pieces.next(), None);
    blocks
}

/// R1: the answers are byte for byte those of the recorded computer, and the program is
/// what it received, without the 48 SUBs of the last block.
#[test]
fn r1_a_program_from_the_control() {
    let mut receiver = Receiver::new();
    let mut now = 0;
    let mut answers = Vec::new();
    let mut program = Vec::new();
    // The control says nothing to the first NAK, and begins at the second.
    let mut control = blocks().to_vec();
    control.push(vec![EOT]);
    control.reverse();
    let outcome = loop {
        match receiver.next(Micros(now)) {
            receiver::Action::Send(bytes) => {
                answers.extend(bytes.iter().map(|byte| (now / 1_000_000, *byte)));
                receiver.sent(Micros(now));
                if answers.len() > 1 {
                    for byte in control.pop().unwrap_or_default() {
                        now += 87;
                        receiver.received(byte, Micros(now));
                    }
                }
            }
            receiver::Action::Data { bytes, last } => {
                program.extend_from_slice(bytes);
                assert_eq!(last, program.len() == PROGRAM.len());
                receiver.taken();
            }
            receiver::Action::WaitUntil(then) => now = then.0,
            receiver::Action::Done(outcome) => break outcome,
        }
    };
    assert_eq!(outcome, receiver::Outcome::Complete);
    assert_eq!(core::str::from_utf8(&program), Ok(PROGRAM));
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
    let mut sender = Sender::new(Micros(0));
    let mut now = 0;
    // 10:32:35, and two more 10:32:37, before anybody looked.
    for (at, byte) in [(0, NAK), (2_000_000, NAK), (2_000_000, NAK)] {
        now = at;
        sender.received(byte, Micros(now));
    }
    let mut sent = Vec::new();
    let mut rest = PROGRAM.as_bytes();
    let outcome = loop {
        match sender.next(Micros(now)) {
            sender::Action::NeedData { room } => {
                let (piece, later) = rest.split_at(room.min(rest.len()).min(50));
                assert_eq!(sender.data(piece, later.is_empty()), piece.len());
                rest = later;
            }
            sender::Action::Send(bytes) => {
                sent.push(bytes.to_vec());
                now += 87 * bytes.len() as u64;
                sender.sent(Micros(now));
                for byte in control.next().unwrap() {
                    now += 87;
                    sender.received(byte, Micros(now));
                }
            }
            sender::Action::WaitUntil(then) => now = then.0,
            sender::Action::Done(outcome) => break outcome,
        }
    };
    assert_eq!(outcome, sender::Outcome::CompleteByCancel);
    let mut recorded = blocks().to_vec();
    recorded.insert(1, recorded[1].clone());
    recorded.push(vec![EOT]);
    assert_eq!(sent, recorded);
    // It never waited for an answer that had come.
    assert!(now < 2_000_000 + 2 * SETTLE_US + 200_000, "{now}");
}
