//! A program to a control that asks for it.

use heapless::Vec;

use super::{
    ACK, ANSWER_US, BLOCK, CAN, CANCEL, Cancels, EOT, FRAME, HEAD, NAK, REPEATS, SETTLE_US, SOH,
    START_US, SUB, after, sum,
};
use crate::units::Micros;

/// What is to be done next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SendStep<'a> {
    /// These bytes go out; then [`BlockSender::sent`].
    Send(&'a [u8]),
    /// More of the program is wanted: [`BlockSender::data`], up to `room` bytes.
    NeedData {
        /// As many fit into the block.
        room: usize,
    },
    /// Nothing before a byte comes or it is this late.
    WaitUntil(Micros),
    /// It is over.
    Done(SendOutcome),
}

/// How it ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SendOutcome {
    /// The control has acknowledged every block and the end.
    Complete,
    /// It has acknowledged every block, and cancelled as soon as it was told that this was
    /// all, as a Haas was seen to do: it has the whole program. A control that refuses the
    /// program at its end says the same; its display says more.
    CompleteByCancel,
    /// It cancelled.
    Cancelled(At),
    /// It answered, but did not acknowledge this as often as it was sent.
    GivenUp(At),
    /// Nothing at all came from it.
    Silence(At),
    /// [`BlockSender::stop`].
    Stopped(At),
}

/// Where it ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At {
    /// Before the first block.
    Start,
    /// At this block, from 1: those before it were acknowledged.
    Block(u32),
    /// At the end: every block was acknowledged.
    End,
}

#[derive(Clone, Copy, Debug)]
enum State {
    /// The control has not asked.
    Unasked {
        until: Micros,
    },
    /// What comes now answers nothing.
    Settling {
        until: Micros,
    },
    /// The block is not full.
    Filling,
    /// The block or the end goes out.
    Sending,
    /// It is out.
    Unanswered {
        until: Micros,
    },
    /// The control is told that it is over.
    Cancelling(SendOutcome),
    Done(SendOutcome),
}

/// Sends one program.
///
/// ```
/// use umi_core::units::Micros;
/// use umi_core::control::xmodem::sender::{SendStep, SendOutcome, BlockSender};
///
/// let mut program = b"%\nO1\nM30\n%\n".as_slice();
/// let mut sender = BlockSender::new(Micros(0));
/// let (mut now, mut line) = (0, 0);
/// sender.received(0x15, Micros(now)); // The control asks.
/// let outcome = loop {
///     match sender.next(Micros(now)) {
///         SendStep::NeedData { room } => {
///             let (piece, rest) = program.split_at(room.min(program.len()));
///             sender.data(piece, rest.is_empty());
///             program = rest;
///         }
///         SendStep::Send(bytes) => {
///             line += bytes.len();
///             sender.sent(Micros(now));
///             sender.received(0x06, Micros(now)); // The control acknowledges.
///         }
///         SendStep::WaitUntil(then) => now = then.0,
///         SendStep::Done(outcome) => break outcome,
///     }
/// };
/// assert_eq!((outcome, line), (SendOutcome::Complete, 132 + 1));
/// ```
#[derive(Clone, Debug)]
pub struct BlockSender {
    state: State,
    at: At,
    /// The block: so far, or whole.
    frame: Vec<u8, FRAME>,
    /// The program ends with it.
    last: bool,
    /// How often what is at work was repeated.
    repeats: u8,
    /// Something came since it was sent first.
    heard: bool,
    cancels: Cancels,
}

impl BlockSender {
    /// Ready for a control that asks within [`START_US`].
    #[must_use]
    pub const fn new(now: Micros) -> Self {
        Self {
            state: State::Unasked {
                until: after(now, START_US),
            },
            at: At::Start,
            frame: Vec::new(),
            last: false,
            repeats: 0,
            heard: false,
            cancels: Cancels(0),
        }
    }

    /// Where it is.
    #[must_use]
    pub const fn at(&self) -> At {
        self.at
    }

    /// What is to be done now. What has come from the line by now is to be told before.
    pub fn next(&mut self, now: Micros) -> SendStep<'_> {
        match self.state {
            State::Unasked { until } if now >= until => {
                // Nobody waits: nobody is told.
                self.state = State::Done(SendOutcome::Silence(At::Start));
            }
            State::Settling { until } if now >= until => self.go_on(),
            State::Unanswered { until } if now >= until => self.again(),
            _ => {}
        }
        match self.state {
            State::Unasked { until } | State::Settling { until } | State::Unanswered { until } => {
                SendStep::WaitUntil(until)
            }
            State::Filling => SendStep::NeedData { room: self.room() },
            State::Sending if self.at == At::End => SendStep::Send(&[EOT]),
            State::Sending => SendStep::Send(&self.frame),
            State::Cancelling(_) => SendStep::Send(&CANCEL),
            State::Done(outcome) => SendStep::Done(outcome),
        }
    }

    /// Takes the next bytes of the program; how many of them. With `last` these are all,
    /// if all were taken; they may be none.
    pub fn data(&mut self, bytes: &[u8], last: bool) -> usize {
        if !matches!(self.state, State::Filling) {
            return 0;
        }
        let (now, later) = bytes.split_at(self.room().min(bytes.len()));
        // There is room: just looked.
        let _ = self.frame.extend_from_slice(now);
        self.last = last && later.is_empty();
        if self.last && self.room() == BLOCK {
            self.at = At::End;
            self.state = State::Sending;
        } else if self.last || self.room() == 0 {
            while self.room() > 0 && self.frame.push(SUB).is_ok() {}
            let sum = sum(self.frame.get(HEAD..).unwrap_or_default());
            // The last place is the sum's.
            let _ = self.frame.push(sum);
            self.state = State::Sending;
        }
        now.len()
    }

    /// The bytes of [`SendStep::Send`] have been handed to the line, the last one too. What
    /// has come since is told after this: it is the answer.
    pub fn sent(&mut self, now: Micros) {
        match self.state {
            State::Sending => {
                let until = after(now, ANSWER_US);
                self.state = State::Unanswered { until };
            }
            State::Cancelling(outcome) => self.state = State::Done(outcome),
            _ => {}
        }
    }

    /// A byte from the line.
    pub fn received(&mut self, byte: u8, now: Micros) {
        if matches!(self.state, State::Cancelling(_) | State::Done(_)) {
            return;
        }
        self.cancels.note(byte);
        if self.cancels.enough() {
            let answered = matches!(self.state, State::Unanswered { .. });
            let whole = answered && self.at == At::End && self.repeats == 0;
            self.state = State::Done(if whole {
                SendOutcome::CompleteByCancel
            } else {
                SendOutcome::Cancelled(self.at)
            });
            return;
        }
        match (self.state, byte) {
            (State::Unasked { .. }, NAK) => self.settle(now),
            (State::Unanswered { .. }, ACK) => self.acknowledged(now),
            (State::Unanswered { .. }, NAK) => {
                self.heard = true;
                self.again();
            }
            (State::Unanswered { .. }, CAN) => {}
            (State::Unanswered { .. }, _) => self.heard = true,
            // It answers nothing that is out.
            _ => {}
        }
    }

    /// The program cannot go on: the control is told. Too late when the end is out.
    pub fn stop(&mut self) {
        let outcome = SendOutcome::Stopped(self.at);
        match self.state {
            State::Unasked { .. } => self.state = State::Done(outcome),
            State::Settling { .. } | State::Filling => self.state = State::Cancelling(outcome),
            State::Sending | State::Unanswered { .. } if self.at != At::End => {
                self.state = State::Cancelling(outcome);
            }
            _ => {}
        }
    }

    /// How many bytes the block still takes.
    fn room(&self) -> usize {
        (FRAME - 1).saturating_sub(self.frame.len())
    }

    fn settle(&mut self, now: Micros) {
        let until = after(now, SETTLE_US);
        self.state = State::Settling { until };
    }

    fn acknowledged(&mut self, now: Micros) {
        let repeated = core::mem::take(&mut self.repeats) > 0;
        self.heard = false;
        match self.at {
            At::End => {
                self.state = State::Done(SendOutcome::Complete);
                return;
            }
            At::Block(_) if self.last => self.at = At::End,
            At::Block(block) => self.begin(block.wrapping_add(1)),
            At::Start => {}
        }
        if repeated {
            self.settle(now);
        } else {
            self.go_on();
        }
    }

    /// Goes on with what is next.
    fn go_on(&mut self) {
        if self.at == At::Start {
            self.begin(1);
        }
        self.state = match self.at {
            At::End => State::Sending,
            _ => State::Filling,
        };
    }

    fn begin(&mut self, block: u32) {
        self.at = At::Block(block);
        let number = block as u8;
        self.frame.clear();
        // There is room: it is empty.
        let _ = self.frame.extend_from_slice(&[SOH, number, !number]);
    }

    fn again(&mut self) {
        if self.repeats >= REPEATS {
            self.state = State::Cancelling(if self.heard {
                SendOutcome::GivenUp(self.at)
            } else {
                SendOutcome::Silence(self.at)
            });
            return;
        }
        self.repeats += 1;
        self.state = State::Sending;
    }
}
