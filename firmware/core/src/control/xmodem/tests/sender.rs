//! The sender with a control that answers as it likes.

use std::vec;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;
use crate::control::xmodem::sender::{At, BlockSender, SendOutcome, SendStep};
use crate::journal::mock::Random;

/// Sends a program to a control that answers what this says to the n-th transmission; its
/// end, and what went out.
fn send(program: &[u8], answers: impl Fn(usize) -> Vec<u8>) -> (SendOutcome, Vec<Vec<u8>>, u64) {
    let mut sender = BlockSender::new(Micros(0));
    sender.received(NAK, Micros(0));
    let mut rest = program;
    let (mut sent, mut now) = (Vec::new(), 0);
    loop {
        match sender.next(Micros(now)) {
            SendStep::NeedData { room } => {
                let (piece, later) = rest.split_at(room.min(rest.len()));
                sender.data(piece, later.is_empty());
                rest = later;
            }
            SendStep::Send(bytes) => {
                sent.push(bytes.to_vec());
                sender.sent(Micros(now));
                for byte in answers(sent.len()) {
                    sender.received(byte, Micros(now));
                }
            }
            SendStep::WaitUntil(then) => now = then.0,
            SendStep::Done(outcome) => return (outcome, sent, now),
        }
    }
}

fn acknowledge(_: usize) -> Vec<u8> {
    vec![ACK]
}

/// Whole blocks have no block of padding behind them, and nothing is a program, too.
#[test]
fn programs_of_any_length() {
    for (length, blocks) in [(0, 0), (1, 1), (127, 1), (128, 1), (129, 2), (256, 2)] {
        let program = vec![b'X'; length];
        let (outcome, sent, _) = send(&program, acknowledge);
        assert_eq!(outcome, SendOutcome::Complete);
        assert_eq!(sent.len(), blocks + 1);
        for (block, data) in sent.iter().zip(program.chunks(BLOCK)) {
            assert_eq!(block.len(), FRAME);
            assert!(block[3..].starts_with(data));
        }
    }
}

/// That the last byte was the last may be said later.
#[test]
fn a_last_piece_of_nothing() {
    let mut sender = BlockSender::new(Micros(0));
    sender.received(NAK, Micros(0));
    let later = Micros(SETTLE_US);
    assert_eq!(sender.next(later), SendStep::NeedData { room: BLOCK });
    assert_eq!(sender.data(&[b'X'; 200], true), BLOCK);
    assert_eq!(
        sender.next(later),
        SendStep::Send(&frame(1, &[b'X'; BLOCK]))
    );
    sender.sent(later);
    sender.received(ACK, later);
    assert_eq!(sender.next(later), SendStep::NeedData { room: BLOCK });
    assert_eq!(sender.data(&[], true), 0);
    assert_eq!(sender.next(later), SendStep::Send(&[EOT]));
}

/// Numbers go round after 255.
#[test]
fn three_hundred_blocks() {
    let (outcome, sent, _) = send(&[b'X'; 300 * BLOCK], acknowledge);
    assert_eq!(outcome, SendOutcome::Complete);
    assert_eq!(sent[255][..3], [1, 0, 255]);
    assert_eq!(sent[256][..3], [1, 1, 254]);
}

/// Nothing goes out before it is asked for, and nobody waits for ever.
#[test]
fn a_control_that_never_asks() {
    let mut sender = BlockSender::new(Micros(7));
    assert_eq!(
        sender.next(Micros(7)),
        SendStep::WaitUntil(Micros(7 + START_US))
    );
    // CRC is asked for: not spoken.
    sender.received(b'C', Micros(100));
    sender.received(ACK, Micros(100));
    let end = sender.next(Micros(7 + START_US));
    assert_eq!(end, SendStep::Done(SendOutcome::Silence(At::Start)));
}

/// What came before the last byte was out answers nothing: neither NAK nor ACK.
#[test]
fn answers_that_come_too_early() {
    let mut sender = BlockSender::new(Micros(0));
    for _ in 0..5 {
        sender.received(NAK, Micros(0));
    }
    let now = Micros(SETTLE_US);
    assert_eq!(sender.next(now), SendStep::NeedData { room: BLOCK });
    sender.received(NAK, now);
    sender.data(b"%\n", true);
    sender.received(NAK, now);
    sender.received(ACK, now);
    assert_eq!(sender.next(now), SendStep::Send(&frame(1, b"%\n")));
    sender.sent(now);
    assert_eq!(
        sender.next(now),
        SendStep::WaitUntil(Micros(now.0 + ANSWER_US))
    );
}

/// A block that was repeated may be acknowledged twice: the second does not count for the
/// next, which goes out when the line has had time.
#[test]
fn an_answer_that_comes_twice() {
    let mut sender = BlockSender::new(Micros(0));
    let start = Micros(SETTLE_US);
    sender.received(NAK, Micros(0));
    sender.next(start);
    sender.data(&[b'X'; BLOCK], false);
    sender.sent(start);
    sender.received(NAK, start);
    assert_eq!(
        sender.next(start),
        SendStep::Send(&frame(1, &[b'X'; BLOCK]))
    );
    sender.sent(start);
    sender.received(ACK, start);
    let settled = Micros(start.0 + SETTLE_US);
    assert_eq!(sender.next(start), SendStep::WaitUntil(settled));
    sender.received(ACK, Micros(settled.0 - 1));
    assert_eq!(sender.next(settled), SendStep::NeedData { room: BLOCK });
    assert_eq!(sender.at(), At::Block(2));
}

/// Ten repeats, then the control is told.
#[test]
fn a_block_that_is_never_good() {
    for (answer, outcome, took_us) in [
        (&[NAK][..], SendOutcome::GivenUp(At::Block(2)), 0),
        (b"?", SendOutcome::GivenUp(At::Block(2)), 11 * ANSWER_US),
        (&[], SendOutcome::Silence(At::Block(2)), 11 * ANSWER_US),
        // One CAN is noise.
        (
            &[b'?', CAN, b'?'],
            SendOutcome::GivenUp(At::Block(2)),
            11 * ANSWER_US,
        ),
    ] {
        let (end, sent, took) = send(&[b'X'; 200], |sent| match sent {
            // What was wrong with the block before does not count.
            1 => vec![NAK],
            2 => vec![ACK],
            _ => answer.to_vec(),
        });
        let took = took - 2 * SETTLE_US;
        assert_eq!((end, took), (outcome, took_us), "{answer:?}");
        let repeats = usize::from(REPEATS);
        assert_eq!(sent.len(), 2 + 1 + repeats + 1);
        assert_eq!(sent.last().unwrap(), &CANCEL);
    }
}

/// No EOT before all was acknowledged, and none that is not repeated.
#[test]
fn the_end_is_repeated() {
    let (outcome, sent, _) = send(b"%\n", |sent| match sent {
        1 => vec![ACK],
        2..5 => vec![NAK],
        _ => vec![ACK],
    });
    assert_eq!(outcome, SendOutcome::Complete);
    assert_eq!(sent[1..], [[EOT]; 4]);
    let (outcome, sent, _) = send(b"%\n", |sent| match sent {
        1 => vec![ACK],
        _ => vec![],
    });
    assert_eq!(outcome, SendOutcome::Silence(At::End));
    assert_eq!(sent[1..12], [[EOT]; 11]);
}

/// Two CANs cancel wherever they come; only behind the EOT is the program there.
#[test]
fn a_control_that_cancels() {
    for at in 1..4 {
        let (outcome, sent, _) = send(&[b'X'; 200], |sent| {
            vec![if sent == at { CAN } else { ACK }; 2]
        });
        let expected = match at {
            3 => SendOutcome::CompleteByCancel,
            block => SendOutcome::Cancelled(At::Block(block as u32)),
        };
        assert_eq!((outcome, sent.len()), (expected, at));
    }
    // A control that did not answer the first EOT has given up.
    let (outcome, ..) = send(b"%\n", |sent| match sent {
        1 => vec![ACK],
        2 => vec![],
        _ => vec![CAN; 3],
    });
    assert_eq!(outcome, SendOutcome::Cancelled(At::End));
    // Before the first block, and between two.
    for (at, place) in [(0, At::Start), (1, At::Block(1)), (2, At::End)] {
        let mut sender = BlockSender::new(Micros(0));
        let now = Micros(SETTLE_US);
        if at > 0 {
            sender.received(NAK, Micros(0));
            assert_eq!(sender.next(now), SendStep::NeedData { room: BLOCK });
        }
        if at > 1 {
            sender.data(b"%", true);
            sender.sent(now);
            sender.received(ACK, now);
        }
        sender.received(CAN, now);
        sender.received(CAN, now);
        assert_eq!(
            sender.next(now),
            SendStep::Done(SendOutcome::Cancelled(place))
        );
    }
}

/// A program whose source fails is cancelled, unless its end is already out.
#[test]
fn a_source_that_fails() {
    let mut sender = BlockSender::new(Micros(0));
    sender.received(NAK, Micros(0));
    let now = Micros(SETTLE_US);
    assert_eq!(sender.next(now), SendStep::NeedData { room: BLOCK });
    let mut ended = sender.clone();
    sender.data(b"G01", false);
    sender.stop();
    assert_eq!(sender.next(now), SendStep::Send(&CANCEL));
    sender.sent(now);
    let stopped = SendStep::Done(SendOutcome::Stopped(At::Block(1)));
    assert_eq!(sender.next(now), stopped);
    ended.data(b"", true);
    ended.stop();
    assert_eq!(ended.next(now), SendStep::Send(&[EOT]));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Whatever the control says, and whenever: the blocks go out in their order, each as
    /// often as it may, the end only behind the last one; and it ends.
    #[test]
    fn anything(length in 0usize..600, seed in any::<u64>(), acks in 0u64..5) {
        let mut random = Random(seed);
        let program: Vec<u8> = (0..length).map(|_| random.byte()).collect();
        let mut blocks: Vec<Vec<u8>> = (1..).zip(program.chunks(BLOCK)).map(|(n, data)| frame(n, data)).collect();
        blocks.push(vec![EOT]);
        let mut rest = program.as_slice();
        let mut sender = BlockSender::new(Micros(0));
        let (mut now, mut at, mut times) = (0, 0, 0);
        loop {
            match sender.next(Micros(now)) {
                SendStep::NeedData { room } => {
                    let length = (random.below(room as u64) as usize + 1).min(rest.len());
                    let (piece, later) = rest.split_at(length);
                    prop_assert_eq!(sender.data(piece, later.is_empty()), length);
                    rest = later;
                }
                SendStep::Send(bytes) if bytes == CANCEL => sender.sent(Micros(now)),
                SendStep::Send(bytes) => {
                    if bytes != blocks[at] {
                        (at, times) = (at + 1, 0);
                    }
                    prop_assert_eq!(Some(bytes), blocks.get(at).map(Vec::as_slice));
                    times += 1;
                    prop_assert!(times <= REPEATS + 1);
                    sender.sent(Micros(now));
                }
                SendStep::WaitUntil(then) if random.below(3) == 0 => now = then.0,
                SendStep::WaitUntil(_) => now += random.below(1_000_000),
                SendStep::Done(outcome) => {
                    let whole = matches!(outcome, SendOutcome::Complete | SendOutcome::CompleteByCancel);
                    prop_assert!(!whole || at + 1 == blocks.len());
                    break;
                }
            }
            match random.below(8) {
                n if n < acks => sender.received(ACK, Micros(now)),
                3 | 4 => sender.received(NAK, Micros(now)),
                5 => sender.received(random.byte(), Micros(now)),
                6 => sender.received(CAN, Micros(now)),
                _ => {}
            }
            let longest = (blocks.len() as u64) * (u64::from(REPEATS) + 1) * (ANSWER_US + SETTLE_US);
            prop_assert!(now <= START_US + longest);
        }
    }
}
