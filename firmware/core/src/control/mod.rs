//! The conversation with a control: what its codes mean, as values in and values out.
//!
//! # Design
//!
//! One state says what the line is doing. Bytes move it as they come ([`Conversation::on_byte`]);
//! what asks for a program moves it in its turn, behind the lines that came before
//! ([`Conversation::on_measured`]); the end of a transmission moves it when it is in the journal
//! ([`Conversation::end`]).
//!
//! | state | what comes | then |
//! | --- | --- | --- |
//! | `Idle` | [`Conversation::begin`] of text | `Sending` |
//! | `Idle` | of XMODEM blocks | `Blocks`, unanswered |
//! | `Idle` | of a program from the control | `Receiving` |
//! | `Sending` | NAK or SYN while XOFF holds | `Sending`, given up |
//! | `Blocks`, unanswered | ACK | `Blocks`, answered: no byte is text any more |
//! | `Blocks`, unanswered | NAK, CAN | `Blocks`, unanswered |
//! | `Blocks`, unanswered | any other byte | `Sending`, given up; the blocks are cancelled |
//! | `Sending`, `Blocks` | a line asks for something else | the same, taken back |
//! | all but `Idle` | [`Conversation::end`] | `Idle` |
//!
//! Beside it stands whether XOFF holds the board: XOFF sets it in every state in which bytes
//! are text, XON clears it, and so do NAK and SYN. A transmission that was asked for begins
//! with it cleared: who asks is ready, so an earlier XOFF is void.
//!
//! DC1 (XON) means two things: "go on" while a program is being sent, and "send me the
//! program" (READ) otherwise. An XON soon after an XOFF may be a "go on" that came when all
//! was sent: [`Exchange::ReadOrResume`]. A NAK asks for the program by XMODEM where nothing
//! is being sent and no XOFF came before it.
//!
//! # Limitations
//!
//! In EIA 0x13 is the digit 3, and only 0x93 is XOFF. Until EIA has been detected, 0x13
//! counts as XOFF: it stops nothing but a correction that is being sent.

pub mod codes;
mod throttle;
pub mod xmodem;

use umi_protocol::pattern::Coding;

use crate::units::Micros;
use codes::{PARITY, SYN, XOFF, XON};
use xmodem::{ACK, CAN, NAK};

pub use throttle::{RxFlowControl, Throttle};

/// A control that does not say XON again for this long has given up: a program of
/// a few hundred bytes fits its buffer. The next DC1 is then a new READ and gets the
/// program from its beginning, never the rest of an old one. A stored program says for
/// itself how much longer it may be held.
pub const XOFF_PATIENCE_US: u64 = 5_000_000;

/// Why a transmission is to begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exchange {
    /// A verdict has armed a correction that goes out by itself.
    Verdict,
    /// The control reads.
    Read,
    /// The control reads, or goes on with what was sent already.
    ReadOrResume,
    /// The control reads by XMODEM.
    Xmodem,
    /// The host wants what the control sends by XMODEM.
    Receive,
}

/// Whether a transmission goes on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
enum Course {
    #[default]
    Open,
    /// A line has asked for something else.
    TakenBack,
    /// The control has said that it will not go on.
    GivenUp,
}

/// What the line is doing. The tag stands alone, so that `Idle` is zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum State {
    Idle,
    Sending {
        course: Course,
    },
    Blocks {
        course: Course,
        is_answered: bool,
        /// Bytes that answered no block and were not read as text.
        unread: u32,
    },
    Receiving {
        unread: u32,
    },
}

/// What a byte of the control is to XMODEM.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockAnswer {
    /// Nothing.
    None,
    /// An answer, or a part of a block.
    Byte,
    /// The end of the blocks: no control that waits for blocks says this byte.
    Cancel,
}

/// What a byte of the control asks for at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reaction {
    /// It is text, to be measured.
    pub is_text: bool,
    /// What it is to XMODEM.
    pub answer: BlockAnswer,
    /// It ends an XOFF.
    pub resumes: bool,
}

/// The conversation with one control.
#[derive(Clone, Debug)]
pub struct Conversation {
    state: State,
    /// The control said XOFF.
    is_stopped: bool,
    /// The control writes EIA, where NAK, SYN and 0x13 are digits.
    is_eia: bool,
    /// Flow control of the receiving direction.
    pub throttle: RxFlowControl,
    /// When the control said XOFF and not XON since, as measured.
    held_since: Option<Micros>,
    /// When the latest transmission ended.
    ended: Micros,
    /// How long the control may hold the line in the latest transmission, us.
    hold_us: u64,
}

impl Conversation {
    /// Nothing has been said. All zeros.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            state: State::Idle,
            is_stopped: false,
            is_eia: false,
            throttle: RxFlowControl::new(),
            held_since: None,
            ended: Micros(0),
            hold_us: 0,
        }
    }

    /// Notes the code in which the control writes.
    pub fn note_coding(&mut self, coding: Coding) {
        self.is_eia = coding == Coding::Eia;
        self.throttle.note_coding(coding);
    }

    /// Begins a transmission in which the control may hold the line for so long, us.
    pub fn begin(&mut self, hold_us: u64, exchange: Exchange) {
        self.hold_us = hold_us;
        self.is_stopped &= exchange == Exchange::Verdict;
        let course = Course::Open;
        self.state = match exchange {
            Exchange::Receive => State::Receiving { unread: 0 },
            Exchange::Xmodem => State::Blocks {
                course,
                is_answered: false,
                unread: 0,
            },
            _ => State::Sending { course },
        };
    }

    /// Ends the transmission: what became of it is in the journal.
    pub fn end(&mut self, now: Micros, is_whole: bool) {
        if is_whole {
            // What was held to its end is not held any more.
            self.hold_us = 0;
        }
        self.ended = now;
        self.state = State::Idle;
    }

    /// Takes back what is on its way: a DC1 behind that is a READ.
    pub fn take_back(&mut self) {
        self.held_since = None;
        self.end_course(Course::TakenBack);
    }

    fn end_course(&mut self, end: Course) {
        if let State::Sending { course } | State::Blocks { course, .. } = &mut self.state {
            *course = end.max(*course);
        }
    }

    /// Handles a byte of the control as it comes.
    pub fn on_byte(&mut self, byte: u8) -> Reaction {
        let (is_text, answer) = match &mut self.state {
            State::Idle | State::Sending { .. } => (true, BlockAnswer::None),
            State::Receiving { unread } => {
                *unread = unread.saturating_add(1);
                (false, BlockAnswer::Byte)
            }
            State::Blocks {
                is_answered,
                unread,
                ..
            } => {
                *is_answered |= byte == ACK;
                match (matches!(byte, ACK | NAK | CAN), *is_answered) {
                    (true, true) => (false, BlockAnswer::Byte),
                    // CAN is a character in no code.
                    (true, false) => (byte != CAN, BlockAnswer::Byte),
                    (false, true) => {
                        *unread = unread.saturating_add(1);
                        (false, BlockAnswer::Byte)
                    }
                    (false, false) => {
                        let course = Course::GivenUp;
                        self.state = State::Sending { course };
                        (true, BlockAnswer::Cancel)
                    }
                }
            }
        };
        Reaction {
            is_text,
            answer,
            resumes: is_text && self.flow_code(byte),
        }
    }

    /// Handles the codes of flow control. Returns whether the byte ends an XOFF.
    fn flow_code(&mut self, byte: u8) -> bool {
        if self.is_stopped && self.is_refusal(byte) {
            self.end_course(Course::GivenUp);
        } else if self.is_xoff(byte) {
            self.is_stopped = true;
            return false;
        } else if byte & !PARITY != XON {
            return false;
        }
        self.is_stopped = false;
        true
    }

    /// Looks for a request in bytes that have been measured, the last of which came at this
    /// time: what they say comes before it. The latest one counts.
    pub fn on_measured(&mut self, time: Micros, bytes: &[u8]) -> Option<Exchange> {
        let mut asked = None;
        for byte in bytes {
            if self.is_refusal(*byte) {
                // Behind XOFF, and until what it was said of has ended, it gives up.
                let gives_up = self.held_since.take().is_some() || self.ended >= time;
                if *byte == NAK && !gives_up && !self.is_busy() {
                    asked = Some(Exchange::Xmodem);
                }
            } else if self.is_xoff(*byte) {
                self.held_since = Some(time);
            } else if byte & !PARITY == XON {
                let hold_us = self.hold_us.max(XOFF_PATIENCE_US);
                let since = self.held_since.take();
                let is_soon = since.is_some_and(|since| time.0.saturating_sub(since.0) < hold_us);
                if !self.is_busy() {
                    asked = Some(match is_soon {
                        true => Exchange::ReadOrResume,
                        false => Exchange::Read,
                    });
                }
            }
        }
        asked
    }

    /// The control has an alarm or was reset, if it is held.
    fn is_refusal(&self, byte: u8) -> bool {
        !self.is_eia && matches!(byte & !PARITY, NAK | SYN)
    }

    fn is_xoff(&self, byte: u8) -> bool {
        let is_digit = byte == XOFF && self.is_eia;
        byte & !PARITY == XOFF && !is_digit
    }

    /// Whether what comes is for something that is on its way.
    fn is_busy(&self) -> bool {
        match self.state {
            State::Idle => false,
            State::Receiving { .. } => true,
            State::Sending { course } | State::Blocks { course, .. } => course == Course::Open,
        }
    }

    /// Whether nothing is on its way.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.state == State::Idle
    }

    /// Whether the control said XOFF: nothing more goes out.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.is_stopped
    }

    /// Whether the control will not go on.
    #[must_use]
    pub fn is_given_up(&self) -> bool {
        let (State::Sending { course } | State::Blocks { course, .. }) = self.state else {
            return false;
        };
        course == Course::GivenUp
    }

    /// Whether a program comes from the control by XMODEM.
    #[must_use]
    pub fn is_receiving(&self) -> bool {
        matches!(self.state, State::Receiving { .. })
    }

    /// Whether bytes may be something else than text: blocks go out or come in.
    #[must_use]
    pub fn is_in_blocks(&self) -> bool {
        matches!(self.state, State::Blocks { .. } | State::Receiving { .. })
    }

    /// Bytes that may have been lines and were not read as such.
    #[must_use]
    pub fn unread(&self) -> u32 {
        match self.state {
            State::Blocks { unread, .. } | State::Receiving { unread } => unread,
            State::Idle | State::Sending { .. } => 0,
        }
    }

    /// What came was a program: nothing of it was a line.
    pub fn was_a_program(&mut self) {
        if let State::Receiving { unread } = &mut self.state {
            *unread = 0;
        }
    }
}

impl Default for Conversation {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests;
