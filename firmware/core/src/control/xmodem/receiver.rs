//! A program from a control that punches it.

use heapless::Vec;

use super::{
    ACK, ASK_US, BLOCK, BYTE_US, CAN, CANCEL, Cancels, EOT, FRAME, GUARD_CHARACTERS, GUARD_US,
    HEAD, NAK, PURGE_US, REPEATS, SOH, SUB, after, sum,
};
use crate::units::Micros;

/// What is to be done next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReceiveStep<'a> {
    /// These bytes go out; then [`BlockReceiver::sent`].
    Send(&'a [u8]),
    /// The next bytes of the program; then [`BlockReceiver::taken`] or [`BlockReceiver::refuse`].
    Data {
        /// They may be none, at the end.
        bytes: &'a [u8],
        /// They are the last. The control is told that all is well when they have been taken.
        last: bool,
    },
    /// Nothing before a byte comes or it is this late.
    WaitUntil(Micros),
    /// It is over.
    Done(ReceiveOutcome),
}

/// How it ended. But for the first, what came is no program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReceiveOutcome {
    /// All came and was taken.
    Complete,
    /// The control cancelled.
    Cancelled,
    /// A block came that is neither the next nor the last one again: something is missing.
    OutOfStep {
        /// The number that was due.
        due: u8,
        /// The number that came.
        came: u8,
    },
    /// Something came, but no new block as often as it was asked for.
    GivenUp,
    /// Nothing came.
    Silence,
    /// [`BlockReceiver::refuse`].
    Refused,
    /// [`BlockReceiver::stop`].
    Stopped,
}

#[derive(Clone, Copy, Debug)]
enum Reply {
    Again,
    Good,
    /// The end is acknowledged.
    End,
    Cancel(ReceiveOutcome),
}

#[derive(Clone, Copy, Debug)]
enum State {
    Sending(Reply),
    /// For a block or the end.
    Waiting {
        until: Micros,
    },
    /// A block has begun.
    Inside {
        until: Micros,
    },
    /// A block is whole if nothing follows.
    Whole {
        until: Micros,
    },
    /// This was EOT if nothing follows, or another.
    Ending {
        until: Micros,
    },
    /// Something that cannot be read, until it is over.
    Purging {
        until: Micros,
        latest: Micros,
    },
    /// The caller has the block that was held back.
    Handing {
        last: bool,
    },
    Done(ReceiveOutcome),
}

/// Receives one program.
#[derive(Clone, Debug)]
pub struct BlockReceiver {
    state: State,
    /// The block that comes.
    frame: Vec<u8, FRAME>,
    /// The data of the block before it.
    held: Vec<u8, BLOCK>,
    /// Blocks that came, with the one that is held.
    blocks: u32,
    /// How often a new one was asked for.
    repeats: u8,
    /// Something came since the last new one.
    heard: bool,
    cancels: Cancels,
    /// Behind a whole block the line is quiet for so long.
    guard_us: u64,
}

impl BlockReceiver {
    /// Asks at once, and every [`ASK_US`]. A character takes so long on the line.
    #[must_use]
    pub const fn new(character_us: u64) -> Self {
        Self {
            guard_us: GUARD_US.saturating_add(GUARD_CHARACTERS.saturating_mul(character_us)),
            state: State::Sending(Reply::Again),
            frame: Vec::new(),
            held: Vec::new(),
            blocks: 0,
            repeats: 0,
            heard: false,
            cancels: Cancels(0),
        }
    }

    /// Blocks that came.
    #[must_use]
    pub const fn blocks(&self) -> u32 {
        self.blocks
    }

    /// What is to be done now. What has come from the line by now is to be told before.
    pub fn next(&mut self, now: Micros) -> ReceiveStep<'_> {
        match self.state {
            State::Waiting { until } if now >= until => self.ask_again(),
            State::Inside { until } if now >= until => self.purged(),
            State::Purging { until, latest } if now >= until.min(latest) => self.purged(),
            State::Whole { until } if now >= until => self.judge(now),
            State::Ending { until } if now >= until => self.state = State::Handing { last: true },
            _ => {}
        }
        match self.state {
            State::Sending(Reply::Again) => ReceiveStep::Send(&[NAK]),
            State::Sending(Reply::Good | Reply::End) => ReceiveStep::Send(&[ACK]),
            State::Sending(Reply::Cancel(_)) => ReceiveStep::Send(&CANCEL),
            State::Waiting { until }
            | State::Inside { until }
            | State::Whole { until }
            | State::Ending { until } => ReceiveStep::WaitUntil(until),
            State::Purging { until, latest } => ReceiveStep::WaitUntil(until.min(latest)),
            State::Handing { last } => ReceiveStep::Data {
                bytes: if last {
                    trimmed(&self.held)
                } else {
                    &self.held
                },
                last,
            },
            State::Done(outcome) => ReceiveStep::Done(outcome),
        }
    }

    /// The bytes of [`ReceiveStep::Send`] have been handed to the line, the last one too. What
    /// has come since is told after this.
    pub fn sent(&mut self, now: Micros) {
        let State::Sending(reply) = self.state else {
            return;
        };
        self.cancels = Cancels(0);
        self.state = match reply {
            Reply::Again | Reply::Good => State::Waiting {
                until: after(now, ASK_US),
            },
            Reply::End => State::Done(ReceiveOutcome::Complete),
            Reply::Cancel(outcome) => State::Done(outcome),
        };
    }

    /// The data of [`ReceiveStep::Data`] is kept.
    pub fn taken(&mut self) {
        match self.state {
            State::Handing { last: true } => self.state = State::Sending(Reply::End),
            State::Handing { last: false } => self.hold(),
            _ => {}
        }
    }

    /// The data of [`ReceiveStep::Data`] cannot be kept: the control is told.
    pub fn refuse(&mut self) {
        if matches!(self.state, State::Handing { .. }) {
            self.cancel(ReceiveOutcome::Refused);
        }
    }

    /// No more is wanted: the control is told.
    pub fn stop(&mut self) {
        if !matches!(
            self.state,
            State::Done(_) | State::Sending(Reply::End | Reply::Cancel(_))
        ) {
            self.cancel(ReceiveOutcome::Stopped);
        }
    }

    /// A byte from the line.
    pub fn received(&mut self, byte: u8, now: Micros) {
        let within = after(now, BYTE_US);
        self.cancels.note(byte);
        match self.state {
            State::Waiting { .. } => {
                match byte {
                    SOH => {
                        self.frame.clear();
                        self.inside(byte, now);
                    }
                    EOT => self.state = State::Ending { until: within },
                    CAN if self.cancels.enough() => {
                        self.state = State::Done(ReceiveOutcome::Cancelled)
                    }
                    CAN => return,
                    _ => self.purge(now),
                }
                self.heard = true;
            }
            State::Inside { .. } => self.inside(byte, now),
            State::Ending { .. } if byte == EOT => self.state = State::Handing { last: true },
            State::Whole { .. } | State::Ending { .. } => self.purge(now),
            State::Purging { latest, .. } => {
                self.state = State::Purging {
                    until: within,
                    latest,
                };
            }
            // Who waits for an answer of ours may give up, and says nothing else.
            State::Sending(Reply::Again | Reply::Good) | State::Handing { .. }
                if self.cancels.enough() =>
            {
                self.state = State::Done(ReceiveOutcome::Cancelled);
            }
            State::Sending(_) | State::Handing { .. } | State::Done(_) => {}
        }
    }

    /// A byte of a block.
    fn inside(&mut self, byte: u8, now: Micros) {
        // There is room: it is whole as soon as there is none.
        let _ = self.frame.push(byte);
        self.state = if self.frame.is_full() {
            State::Whole {
                until: after(now, self.guard_us),
            }
        } else {
            State::Inside {
                until: after(now, BYTE_US),
            }
        };
    }

    fn purge(&mut self, now: Micros) {
        self.state = State::Purging {
            until: after(now, BYTE_US),
            latest: after(now, PURGE_US),
        };
    }

    /// What could not be read is over.
    fn purged(&mut self) {
        if self.cancels.enough() {
            self.state = State::Done(ReceiveOutcome::Cancelled);
        } else {
            self.ask_again();
        }
    }

    /// A block is whole: is it good, and which is it?
    fn judge(&mut self, now: Micros) {
        let Some(([_, number, complement], [data @ .., check])) =
            self.frame.split_first_chunk::<HEAD>()
        else {
            return self.purge(now);
        };
        if *complement != !*number || sum(data) != *check {
            return self.purge(now);
        }
        let due = self.blocks.wrapping_add(1) as u8;
        let came = *number;
        if came == due && self.blocks == 0 {
            self.hold();
        } else if came == due {
            self.state = State::Handing { last: false };
        } else if came == due.wrapping_sub(1) && self.blocks > 0 {
            // The control did not hear that this one is here.
            self.repeat(Reply::Good);
        } else {
            self.cancel(ReceiveOutcome::OutOfStep { due, came });
        }
    }

    /// A new block is here: it is held back until more is known.
    fn hold(&mut self) {
        self.held.clear();
        let data = self.frame.get(HEAD..HEAD + BLOCK).unwrap_or_default();
        // As long as there is room.
        let _ = self.held.extend_from_slice(data);
        self.blocks = self.blocks.wrapping_add(1);
        self.repeats = 0;
        self.heard = false;
        self.state = State::Sending(Reply::Good);
    }

    fn ask_again(&mut self) {
        self.repeat(Reply::Again);
    }

    fn repeat(&mut self, reply: Reply) {
        if self.repeats >= REPEATS {
            self.cancel(if self.heard {
                ReceiveOutcome::GivenUp
            } else {
                ReceiveOutcome::Silence
            });
            return;
        }
        self.repeats += 1;
        self.state = State::Sending(reply);
    }

    const fn cancel(&mut self, outcome: ReceiveOutcome) {
        self.state = State::Sending(Reply::Cancel(outcome));
    }
}

impl Default for BlockReceiver {
    fn default() -> Self {
        Self::new(0)
    }
}

/// Without the padding of a last block.
fn trimmed(mut data: &[u8]) -> &[u8] {
    while let [rest @ .., SUB] = data {
        data = rest;
    }
    data
}
