//! BlockSender against receiver over a line that damages what it carries.
//!
//! A transmission (a block, an answer) is damaged in one place at most: against two the
//! check sum does not help, and is not meant to.

use std::collections::VecDeque;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;
use crate::control::xmodem::receiver::{self, BlockReceiver};
use crate::control::xmodem::sender::{self, BlockSender};
use crate::journal::mock::Random;

/// Time of a character at 9600 baud.
const CHARACTER_US: u64 = 1_042;
/// Nothing takes longer: ten repeats of each of the blocks below, and of the end.
const LONGEST_US: u64 = 24 * 3_600_000_000;

/// One direction of the line.
struct Wire {
    random: Random,
    /// One of so many transmissions is damaged; none if it is zero.
    one_in: u64,
    /// Bytes that are on their way, and when they come.
    carried: VecDeque<(u64, u8)>,
    /// When the last byte is out, until that was told.
    busy_until: Option<u64>,
}

impl Wire {
    fn new(seed: u64, one_in: u64) -> Self {
        Self {
            random: Random(seed),
            one_in,
            carried: VecDeque::new(),
            busy_until: None,
        }
    }

    fn send(&mut self, now: u64, bytes: &[u8]) {
        let random = &mut self.random;
        let mut carried = bytes.to_vec();
        let place = random.below(bytes.len() as u64) as usize;
        if self.one_in > 0 && random.below(self.one_in) == 0 {
            match random.below(if bytes.len() == FRAME { 7 } else { 3 }) {
                0 => carried[place] ^= 1 << random.below(8),
                1 => drop(carried.remove(place)),
                2 => carried.clear(),
                // Only of a block: what stands behind an answer is another answer.
                3 => carried[place] = random.byte(),
                4 => carried.insert(place, carried[place]),
                5 => carried.insert(place, random.byte()),
                _ => carried.truncate(place),
            }
        }
        let mut at = now;
        for byte in carried {
            at += CHARACTER_US;
            self.carried.push_back((at, byte));
        }
        self.busy_until = Some(now + CHARACTER_US * bytes.len() as u64);
    }

    fn arrived(&mut self, now: u64) -> Option<u8> {
        self.carried
            .pop_front_if(|(at, _)| *at <= now)
            .map(|(_, byte)| byte)
    }

    fn told(&mut self, now: u64) -> bool {
        self.busy_until.take_if(|until| *until <= now).is_some()
    }

    /// When something happens here next.
    fn next(&self) -> impl Iterator<Item = u64> {
        let carried = self.carried.front().map(|(at, _)| *at);
        [carried, self.busy_until].into_iter().flatten()
    }
}

/// What became of a program that was sent.
struct Transfer {
    sender: sender::SendOutcome,
    receiver: receiver::ReceiveOutcome,
    program: Vec<u8>,
    /// That came, the last of which may not have been handed out.
    blocks: usize,
    took_us: u64,
}

/// Sends a program in pieces of these lengths; who takes it refuses more than so many bytes.
fn transfer(program: &[u8], pieces: &[usize], one_in: u64, seed: u64, room: usize) -> Transfer {
    let mut sending = BlockSender::new(Micros(0));
    let mut receiving = BlockReceiver::new(0);
    let mut there = Wire::new(seed, one_in);
    let mut back = Wire::new(!seed, one_in);
    let mut rest = program;
    let mut lengths = pieces.iter().cycle();
    let mut received = Vec::new();
    let (mut sender_end, mut receiver_end) = (None, None);
    let mut now = 0;
    loop {
        while let Some(byte) = back.arrived(now) {
            sending.received(byte, Micros(now));
        }
        while let Some(byte) = there.arrived(now) {
            receiving.received(byte, Micros(now));
        }
        if there.told(now) {
            sending.sent(Micros(now));
        }
        if back.told(now) {
            receiving.sent(Micros(now));
        }
        let mut wake = Vec::new();
        while there.busy_until.is_none() && sender_end.is_none() {
            match sending.next(Micros(now)) {
                sender::SendStep::NeedData { room } => {
                    let length = lengths.next().copied().unwrap_or(room).min(room);
                    let (piece, later) = rest.split_at(length.min(rest.len()));
                    assert_eq!(sending.data(piece, later.is_empty()), piece.len());
                    rest = later;
                }
                sender::SendStep::Send(bytes) => there.send(now, bytes),
                sender::SendStep::WaitUntil(then) => {
                    wake.push(then.0);
                    break;
                }
                sender::SendStep::Done(outcome) => sender_end = Some(outcome),
            }
        }
        while back.busy_until.is_none() && receiver_end.is_none() {
            match receiving.next(Micros(now)) {
                receiver::ReceiveStep::Data { bytes, .. }
                    if received.len() + bytes.len() > room =>
                {
                    receiving.refuse();
                }
                receiver::ReceiveStep::Data { bytes, .. } => {
                    received.extend_from_slice(bytes);
                    receiving.taken();
                }
                receiver::ReceiveStep::Send(bytes) => back.send(now, bytes),
                receiver::ReceiveStep::WaitUntil(then) => {
                    wake.push(then.0);
                    break;
                }
                receiver::ReceiveStep::Done(outcome) => receiver_end = Some(outcome),
            }
        }
        let done = sender_end.zip(receiver_end);
        if let Some((sender, receiver)) = done {
            return Transfer {
                sender,
                receiver,
                program: received,
                blocks: receiving.blocks() as usize,
                took_us: now,
            };
        }
        let next = there.next().chain(back.next()).chain(wake).min();
        now = next.expect("both wait for nothing").max(now);
        assert!(now < LONGEST_US, "no end");
    }
}

/// Part program text that does not end in padding.
fn programs() -> impl Strategy<Value = Vec<u8>> {
    let any = prop::collection::vec(any::<u8>(), 0..900);
    any.prop_map(|mut program| {
        while program.last() == Some(&SUB) {
            program.pop();
        }
        program
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Over a good line every program comes whole, of any length and in any pieces, and it
    /// takes no longer than its bytes, their guards and the end do.
    #[test]
    fn a_good_line(program in programs(), pieces in prop::collection::vec(1usize..200, 1..5)) {
        let done = transfer(&program, &pieces, 0, 1, usize::MAX);
        prop_assert_eq!(done.sender, sender::SendOutcome::Complete);
        prop_assert_eq!(done.receiver, receiver::ReceiveOutcome::Complete);
        let blocks = program.len().div_ceil(BLOCK) as u64;
        let block_us = (FRAME as u64 + 1) * CHARACTER_US + GUARD_US;
        let longest = SETTLE_US + blocks * block_us + BYTE_US + 4 * CHARACTER_US;
        prop_assert!(done.took_us <= longest, "{} > {longest}", done.took_us);
        prop_assert_eq!(done.program, program);
    }

    /// Over a bad one it comes whole or is said not to, by the receiver; and the sender never
    /// takes for complete what the receiver does not. If the end was answered by a cancel,
    /// every block is there.
    #[test]
    fn a_bad_line(program in programs(), one_in in 2u64..20, seed in any::<u64>()) {
        let done = transfer(&program, &[BLOCK], one_in, seed, usize::MAX);
        let complete = done.receiver == receiver::ReceiveOutcome::Complete;
        if complete {
            prop_assert_eq!(&done.program, &program);
        } else {
            prop_assert!(program.starts_with(&done.program));
        }
        match done.sender {
            sender::SendOutcome::Complete => prop_assert!(complete, "{:?}", done.receiver),
            sender::SendOutcome::CompleteByCancel => {
                prop_assert_eq!(done.blocks, program.len().div_ceil(BLOCK));
            }
            _ => {}
        }
    }

    /// A program that is too long for who takes it is refused, and the sender knows.
    #[test]
    fn a_refusal(program in programs(), room in 0usize..900) {
        let done = transfer(&program, &[BLOCK], 0, 1, room);
        let fits = program.len() <= room;
        prop_assert_eq!(done.receiver == receiver::ReceiveOutcome::Complete, fits);
        prop_assert_eq!(done.sender == sender::SendOutcome::Complete, fits);
        if !fits {
            prop_assert_eq!(done.receiver, receiver::ReceiveOutcome::Refused);
            prop_assert!(program.starts_with(&done.program) && done.program.len() <= room);
        }
    }
}

/// One transmission in five damaged: programs of eight blocks still come, nearly all of them.
#[test]
fn one_transmission_in_five_is_no_hindrance() {
    let program: Vec<u8> = (0..1000).map(|n| b"G01X0.\n"[n % 7]).collect();
    let came = (0..200)
        .filter(|seed| {
            let done = transfer(&program, &[BLOCK], 5, *seed, usize::MAX);
            done.receiver == receiver::ReceiveOutcome::Complete
        })
        .count();
    assert!(came >= 190, "{came} of 200");
}

/// A line that is cut is told at both ends, and both end.
#[test]
fn a_line_that_carries_nothing() {
    // Every transmission is damaged: now and then one gets through, flipped to another.
    for seed in 0..20 {
        let done = transfer(&[b'X'; 500], &[BLOCK], 1, seed, usize::MAX);
        assert_ne!(done.receiver, receiver::ReceiveOutcome::Complete);
        assert_ne!(done.sender, sender::SendOutcome::Complete);
        assert_eq!(done.program, b"");
    }
}
