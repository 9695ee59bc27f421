//! The receiver with a control that sends as it likes.

use std::vec;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;
use crate::control::xmodem::receiver::{BlockReceiver, ReceiveOutcome, ReceiveStep};
use crate::journal::mock::Random;

/// A receiver and what it said and was given.
struct Bench {
    receiver: BlockReceiver,
    now: u64,
    answers: Vec<u8>,
    program: Vec<u8>,
    outcome: Option<ReceiveOutcome>,
}

impl Bench {
    fn new() -> Self {
        let mut bench = Self {
            receiver: BlockReceiver::new(0),
            now: 0,
            answers: Vec::new(),
            program: Vec::new(),
            outcome: None,
        };
        bench.wait(0);
        bench
    }

    /// Lets this time pass, with all that is to be done in it.
    fn wait(&mut self, us: u64) {
        let end = self.now + us;
        loop {
            match self.receiver.next(Micros(self.now)) {
                ReceiveStep::Send(bytes) => {
                    self.answers.extend_from_slice(bytes);
                    self.receiver.sent(Micros(self.now));
                }
                ReceiveStep::Data { bytes, .. } => {
                    self.program.extend_from_slice(bytes);
                    self.receiver.taken();
                }
                ReceiveStep::WaitUntil(then) if then.0 <= end => self.now = then.0,
                ReceiveStep::WaitUntil(_) => break,
                ReceiveStep::Done(outcome) => {
                    self.outcome = Some(outcome);
                    break;
                }
            }
        }
        self.now = end;
    }

    /// Bytes come, 1 ms each, and the line is quiet for 20 ms; what is answered.
    fn hear(&mut self, bytes: &[u8]) -> Vec<u8> {
        for byte in bytes {
            self.wait(1_000);
            self.receiver.received(*byte, Micros(self.now));
        }
        self.wait(20_000);
        self.answers()
    }

    fn answers(&mut self) -> Vec<u8> {
        core::mem::take(&mut self.answers)
    }
}

fn bench() -> Bench {
    let mut bench = Bench::new();
    assert_eq!(bench.answers(), [NAK]);
    bench
}

/// SUBs are padding in the last block only, and one of nothing else comes as nothing.
#[test]
fn padding_of_the_last_block() {
    let mut first = [b'X'; BLOCK];
    first[BLOCK - 2..].fill(SUB);
    for (last, kept) in [
        (&b"M30\n%\n"[..], &b"M30\n%\n"[..]),
        (b"", b""),
        (b"\x1A%", b"\x1A%"),
    ] {
        let mut bench = bench();
        assert_eq!(bench.hear(&frame(1, &first)), [ACK]);
        assert_eq!(bench.program, b"", "it may be the last");
        assert_eq!(bench.hear(&frame(2, last)), [ACK]);
        assert_eq!(bench.program, first);
        assert_eq!(bench.hear(&[EOT, EOT]), [ACK]);
        assert_eq!(bench.outcome, Some(ReceiveOutcome::Complete));
        assert_eq!(bench.program, [&first[..], kept].concat());
    }
}

/// A block that comes again is acknowledged and dropped; any other is not.
#[test]
fn numbers_of_blocks() {
    let mut first = bench();
    for _ in 0..3 {
        assert_eq!(first.hear(&frame(1, b"A")), [ACK]);
    }
    assert_eq!(first.receiver.blocks(), 1);
    for (number, due) in [(0, 2), (3, 2), (255, 2)] {
        let mut bench = Bench {
            receiver: first.receiver.clone(),
            answers: Vec::new(),
            program: Vec::new(),
            ..first
        };
        assert_eq!(bench.hear(&frame(number, b"B")), CANCEL);
        let came = number;
        assert_eq!(bench.outcome, Some(ReceiveOutcome::OutOfStep { due, came }));
        assert_eq!(bench.program, b"");
    }
    // Before the first there is none that could come again.
    let mut bench = bench();
    assert_eq!(bench.hear(&frame(0, b"A")), CANCEL);
}

/// Numbers go round after 255.
#[test]
fn three_hundred_blocks() {
    let mut bench = bench();
    for number in 1..=300_u32 {
        assert_eq!(bench.hear(&frame(number as u8, &[b'X'; BLOCK])), [ACK]);
    }
    assert_eq!(bench.receiver.blocks(), 300);
    bench.hear(&[EOT, EOT]);
    assert_eq!(bench.program.len(), 300 * BLOCK);
}

/// A block is refused when the line has been quiet for a second, and not before.
#[test]
fn damaged_blocks() {
    let good = frame(1, b"G01X0.\n");
    let mut damaged: Vec<Vec<u8>> = (0..FRAME)
        .map(|at| {
            let mut block = good.clone();
            block[at] ^= 0x40;
            block
        })
        .collect();
    // Too few, too many, and one that would be right without its last byte.
    damaged.push(good[..131].to_vec());
    damaged.push([&good[..], b"?"].concat());
    damaged.push([&good[..], &good[..]].concat());
    for block in damaged {
        let mut bench = bench();
        assert_eq!(bench.hear(&block), b"", "{block:?}");
        bench.wait(BYTE_US - 100_000);
        assert_eq!(bench.answers(), b"");
        bench.wait(200_000);
        assert_eq!(bench.answers(), [NAK]);
        assert_eq!(bench.hear(&good), [ACK]);
    }
}

/// A block whose SOH became EOT does not end the program; EOT and quiet, or two, do.
#[test]
fn what_is_an_end() {
    let mut bench = bench();
    bench.hear(&frame(1, b"%\n"));
    let mut block = frame(2, b"M30\n");
    block[0] = EOT;
    assert_eq!(bench.hear(&block), b"");
    bench.wait(2 * BYTE_US);
    assert_eq!(bench.answers(), [NAK]);
    let rest = (bench.receiver.clone(), bench.now);
    assert_eq!(bench.hear(&[EOT, EOT]), [ACK]);
    (bench.receiver, bench.now, bench.outcome) = (rest.0, rest.1, None);
    assert_eq!(bench.hear(&[EOT]), b"");
    bench.wait(BYTE_US);
    assert_eq!(bench.answers(), [ACK]);
    assert_eq!(bench.outcome, Some(ReceiveOutcome::Complete));
}

/// It asks eleven times, ten seconds apart, and says that it does not wait any more.
#[test]
fn a_control_that_is_silent() {
    let mut silent = bench();
    silent.wait(11 * ASK_US);
    assert_eq!(silent.answers(), [[NAK; 10].as_slice(), &CANCEL].concat());
    assert_eq!(silent.outcome, Some(ReceiveOutcome::Silence));
    // As long for every block, and noise is not silence.
    let mut noisy = bench();
    for number in 1..3 {
        noisy.wait(9 * ASK_US);
        noisy.answers();
        assert_eq!(noisy.hear(&frame(number, b"X")), [ACK]);
    }
    let quiet = (noisy.receiver.clone(), noisy.now);
    noisy.wait(11 * ASK_US);
    assert_eq!(noisy.outcome, Some(ReceiveOutcome::Silence));
    (noisy.receiver, noisy.now, noisy.outcome) = (quiet.0, quiet.1, None);
    noisy.hear(b"?");
    noisy.wait(11 * ASK_US);
    assert_eq!(noisy.outcome, Some(ReceiveOutcome::GivenUp));
}

/// Two CANs cancel, between blocks and in the middle of one that goes no further; one does not.
#[test]
fn a_control_that_cancels() {
    let mut one = bench();
    assert_eq!(one.hear(&[CAN]), b"");
    assert_eq!(one.hear(&frame(1, b"X")), [ACK]);
    let between = (one.receiver.clone(), one.now);
    one.hear(&[CAN, CAN]);
    assert_eq!(one.outcome, Some(ReceiveOutcome::Cancelled));
    (one.receiver, one.now, one.outcome) = (between.0, between.1, None);
    one.hear(&[&frame(2, b"X")[..50], &CANCEL].concat());
    one.wait(BYTE_US);
    assert_eq!(one.outcome, Some(ReceiveOutcome::Cancelled));
    // In a block that is whole they are data, and its check sum.
    let mut data = bench();
    let mut ends_so = [0; BLOCK];
    ends_so[BLOCK - 1] = CAN;
    assert_eq!(frame(1, &ends_so)[BLOCK + 2..], [CAN, CAN]);
    assert_eq!(data.hear(&frame(1, &ends_so)), [ACK]);
    assert_eq!(data.hear(&[CAN]), b"");
    assert_eq!(data.outcome, None);
    let mut data = bench();
    assert_eq!(data.hear(&frame(1, &[CAN; BLOCK])), [ACK]);
    assert_eq!(data.hear(&frame(2, b"X")), [ACK]);
}

/// Who takes the data may need long, and may refuse: then the control knows.
#[test]
fn a_slow_taker_and_one_that_refuses() {
    let mut bench = bench();
    bench.hear(&frame(1, b"A"));
    for byte in frame(2, b"B") {
        bench.receiver.received(byte, Micros(bench.now));
    }
    bench.now += GUARD_US;
    let data = frame(1, b"A");
    let handed = ReceiveStep::Data {
        bytes: &data[3..3 + BLOCK],
        last: false,
    };
    assert_eq!(bench.receiver.next(Micros(bench.now)), handed);
    // The control sends it again meanwhile: that answers nothing.
    bench.now += 60 * ASK_US;
    for byte in frame(2, b"B") {
        bench.receiver.received(byte, Micros(bench.now));
    }
    assert_eq!(bench.receiver.next(Micros(bench.now)), handed);
    let mut refused = bench.receiver.clone();
    bench.receiver.taken();
    assert_eq!(
        bench.receiver.next(Micros(bench.now)),
        ReceiveStep::Send(&[ACK])
    );
    refused.refuse();
    assert_eq!(refused.next(Micros(bench.now)), ReceiveStep::Send(&CANCEL));
    refused.sent(Micros(bench.now));
    let done = ReceiveStep::Done(ReceiveOutcome::Refused);
    assert_eq!(refused.next(Micros(bench.now)), done);
}

/// A program that comes whole and is refused at its last byte is cancelled, not acknowledged.
#[test]
fn a_refusal_at_the_end() {
    let mut bench = bench();
    bench.hear(&frame(1, b"%\n"));
    for _ in 0..2 {
        bench.receiver.received(EOT, Micros(bench.now));
    }
    let last = ReceiveStep::Data {
        bytes: b"%\n",
        last: true,
    };
    assert_eq!(bench.receiver.next(Micros(bench.now)), last);
    bench.receiver.refuse();
    bench.wait(0);
    assert_eq!(bench.answers(), CANCEL);
    assert_eq!(bench.outcome, Some(ReceiveOutcome::Refused));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Whatever comes, and however fast, it ends: a new block comes in time and after so many
    /// answers, or none does.
    #[test]
    fn anything(seed in any::<u64>(), gap_us in prop::sample::select(vec![20_000u64, 500_000, 3_000_000])) {
        let mut random = Random(seed);
        let mut bench = Bench::new();
        let (mut blocks, mut since) = (0, 0);
        while bench.outcome.is_none() && blocks < 50 {
            let number = blocks as u8 + random.below(2) as u8;
            let piece = match random.below(6) {
                0 => vec![random.byte()],
                1 => vec![[SOH, EOT, CAN, NAK][random.below(4) as usize]],
                2 => (0..random.below(200)).map(|_| random.byte()).collect(),
                _ => frame(number, &[random.byte(); 100]),
            };
            for byte in piece {
                bench.receiver.received(byte, Micros(bench.now));
            }
            bench.wait(random.below(gap_us));
            if bench.receiver.blocks() > blocks {
                blocks = bench.receiver.blocks();
                since = bench.now;
            }
            let longest = (u64::from(REPEATS) + 1) * (ASK_US + PURGE_US + FRAME as u64 * BYTE_US);
            prop_assert!(bench.now <= since + longest);
        }
        let most = (blocks as usize + 1) * (usize::from(REPEATS) + 1) + CANCEL.len();
        prop_assert!(bench.answers.len() <= most);
        prop_assert!(bench.program.len() <= blocks as usize * BLOCK);
    }
}
