//! How a program comes out, byte by byte: looked through, rewritten, in the control's code.
//!
//! # Design
//!
//! **In two passes.** A stored program is read once before its first byte goes out: its
//! check value, whether it ends with `%`, whether the control's code has all its characters,
//! and whether it can be rewritten truly. The alarm names the line that cannot. One that the host passes through
//! is seen once: what cannot be rewritten stops the machine at that line.
//!
//! **A line at a time.** Rewriting takes longest: [`Delivery::fill`] does one line into a
//! queue, and sending takes bytes out of it. So memory does not depend on the program, and
//! nothing waits for more than a line.

use heapless::{Deque, Vec};
use umi_core::correction::{broken_off, withheld};
use umi_core::dprnt::encode;
use umi_core::journal::Flash;
use umi_core::programs::{Program, Store};
use umi_core::rewrite::{Check, MAX_AT_ONCE, RewriteSettings, Rewriter};
use umi_core::zero_option::ZeroOption;
use umi_protocol::pattern::Coding;
use umi_protocol::program::Withheld;

/// Bytes of a program that wait to be rewritten: some lines.
const HELD: usize = 256;
/// Bytes that wait to be sent: the most that one line gives, and what covers the time until
/// the next is there, at 115200 baud 40 ms.
const QUEUE: usize = MAX_AT_ONCE + 512;

/// What there is to send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Next {
    /// This byte, in the control's code.
    Byte(u8),
    /// Nothing yet: [`Delivery::fill`].
    Wait,
    /// Nothing yet: the host has not passed it on.
    WaitForHost,
    /// Nothing any more, and whether that is all of it.
    End {
        /// Everything went out.
        whole: bool,
    },
}

/// A program on its way.
pub(super) struct Part {
    pub number: u32,
    pub bytes: u32,
    pub crc32: u32,
    /// Where it is; none: the host passes it through.
    pub stored: Option<Program>,
    /// How it is rewritten.
    pub how: Option<RewriteSettings>,
    /// The setup that released it; none: any.
    pub setup: Option<u32>,
    /// How long the control may hold the line.
    pub hold_us: u64,
}

impl Part {
    /// The setup by whose registration it is rewritten.
    pub fn rewritten_for(&self) -> Option<u32> {
        self.setup.filter(|_| self.how.is_some())
    }
}

#[allow(clippy::large_enum_variant, reason = "no heap; one exists at a time")]
pub(super) enum What {
    Correction {
        setup: u32,
    },
    Alarm {
        number: u32,
        why: Withheld,
        /// The run that taught, where the program compares it with the control's.
        run: Option<u32>,
    },
    /// Of the station of a distance sensor.
    Answer,
    Program(Part),
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    /// Read for the first time.
    Looking,
    Sending,
    /// All that will go out is in the queue.
    Ended,
}

/// What is being sent.
pub(crate) struct Delivery {
    pub(super) what: What,
    pub(super) coding: Coding,
    /// The arming that it needs; 0: none.
    pub(super) arming: u32,
    /// What was asked for when it began: what is asked for later takes it back.
    pub(super) request: u32,
    stage: Stage,
    /// That it begins to go out has been said.
    has_begun: bool,
    /// At the end of the queue is the end of the program.
    whole: bool,
    rewriter: ZeroOption<Rewriter>,
    /// More comes out of what the rewriter has.
    has_more: bool,
    check: Check,
    /// Bytes of the program read.
    offset: u32,
    held: Vec<u8, HELD>,
    queue: Deque<u8, QUEUE>,
    /// The byte that was read last, the line end before, and what went into the queue last.
    last_read: u8,
    line_end: u8,
    last_put: u8,
    /// The byte that was read last and is no blank.
    last_text: u8,
    /// In a comment of the program as it is.
    in_comment: bool,
    /// The byte that went out last and is no line end.
    last_sent: u8,
    /// Why what the host passes through does not go on.
    pub(super) refused: Option<Withheld>,
}

impl Delivery {
    pub(super) fn new(what: What, coding: Coding, arming: u32, request: u32) -> Self {
        Self {
            what,
            coding,
            arming,
            request,
            stage: Stage::Ended,
            has_begun: false,
            whole: false,
            rewriter: ZeroOption::empty(),
            has_more: false,
            check: Check::default(),
            offset: 0,
            held: Vec::new(),
            queue: Deque::new(),
            last_read: b'\n',
            line_end: b'\n',
            last_put: b'\n',
            last_text: 0,
            in_comment: false,
            last_sent: 0,
            refused: None,
        }
    }

    /// A text that is there: all of it or, if the code lacks a character, nothing. EIA has
    /// no # and no brackets.
    pub(super) fn set(&mut self, text: &str) {
        let coding = self.coding;
        self.whole = text.bytes().all(|ascii| encode(coding, ascii).is_some());
        if self.whole {
            self.put(text);
        }
    }

    fn put(&mut self, text: &str) {
        for byte in text.bytes() {
            // A text finds room in an empty queue, a stop in what a line leaves.
            let _ = self.queue.push_back(byte);
        }
    }

    /// The program that raises an alarm, in place of this one.
    #[inline(never)]
    pub(super) fn withhold(&mut self, why: Withheld) {
        let What::Program(Part { number, .. }) = &self.what else {
            return;
        };
        let number = *number;
        let text = withheld(number, &why, self.coding);
        self.what = What::Alarm {
            number,
            why,
            run: None,
        };
        self.arming = 0;
        self.stage = Stage::Ended;
        self.rewriter.clear();
        self.has_more = false;
        self.held.clear();
        self.queue.clear();
        self.set(&text);
    }

    /// Nothing goes out behind what is in the queue but a stop, if a line ends there.
    pub(super) fn break_off(&mut self) {
        self.held.clear();
        self.has_more = false;
        if self.last_put == b'\n' {
            self.put(broken_off(self.coding));
        }
        self.stage = Stage::Ended;
        self.rewriter.clear();
    }

    /// Begins to read, from the first byte.
    #[inline(never)]
    pub(super) fn rewind(&mut self, stage: Stage) {
        self.stage = stage;
        self.offset = 0;
        self.check = Check::default();
        self.held.clear();
        self.has_more = false;
        self.rewriter.clear();
        let What::Program(part) = &self.what else {
            return;
        };
        let Some(how) = &part.how else { return };
        match Rewriter::new(how) {
            Ok(rewriter) => self.rewriter.put(rewriter),
            Err(_) => self.withhold(Withheld::BadSettings),
        }
    }

    /// Whether a program is about to go out now, nothing of it in the queue yet. Says so once.
    pub(super) fn begins(&mut self) -> bool {
        let begins = self.stage == Stage::Sending && !self.has_begun;
        self.has_begun |= begins;
        begins
    }

    /// All that will go out is in the queue.
    pub(super) fn has_ended(&self) -> bool {
        self.stage == Stage::Ended
    }

    /// Whether [`Self::fill`] has room to work.
    pub(super) fn is_hungry(&self) -> bool {
        let room = self.queue.capacity() - self.queue.len();
        !self.has_ended() && room >= MAX_AT_ONCE
    }

    /// Takes more of what the host passes through, if that is where it goes on and there is
    /// room.
    pub(super) fn pass(&mut self, offset: u32, bytes: &[u8]) {
        if offset == self.offset && self.held.is_empty() && !self.has_more {
            let room = self.held.capacity().min(self.left());
            self.held.extend(bytes.iter().take(room).copied());
            if !self.held.is_empty() {
                self.came();
            }
        }
    }

    /// Bytes of the program that were read.
    pub(super) fn offset(&self) -> u32 {
        self.offset
    }

    /// Does one line; whether there may be more to do at once.
    pub(super) fn fill<F: Flash>(&mut self, store: Option<&mut Store<F>>) -> bool {
        if !self.is_hungry() {
            return false;
        }
        if self.held.is_empty() && !self.has_more {
            return self.read(store);
        }
        if self.rewriter.is_some() {
            self.rewrite();
        } else {
            self.copy();
        }
        true
    }

    /// Reads on in the flash; from the host come bytes by themselves. At the end of the
    /// program: goes to the next stage.
    #[inline(never)]
    fn read<F: Flash>(&mut self, store: Option<&mut Store<F>>) -> bool {
        let What::Program(part) = &self.what else {
            return false;
        };
        if self.offset < part.bytes {
            let Some(program) = part.stored else {
                return false;
            };
            let _ = self.held.resize_default(HELD);
            let read = store.and_then(|store| {
                let read = store.read(&program, self.offset, &mut self.held);
                read.ok().map(<[u8]>::len)
            });
            let length = read.unwrap_or(0);
            self.held.truncate(length);
            if length > 0 {
                self.came();
            } else {
                self.fails();
            }
            return true;
        }
        if self.rewriter.is_some() && !matches!(self.last_read, b'\n' | b'\r') {
            // It holds the last line until it ends.
            let _ = self.held.push(self.line_end);
            self.last_read = self.line_end;
            return true;
        }
        if self.stage == Stage::Looking {
            self.rewind(Stage::Sending);
        } else {
            self.whole = true;
            self.stage = Stage::Ended;
        }
        true
    }

    /// Bytes have come into an empty `held`. The last ones go nowhere if the check value is
    /// not right.
    fn came(&mut self) {
        let What::Program(part) = &self.what else {
            return;
        };
        let is_first = self.offset == 0;
        self.check.update(&self.held);
        self.offset += self.held.len() as u32;
        if let Some(last) = self.held.last() {
            self.last_read = *last;
        }
        let ends = |byte: &&u8| matches!(**byte, b'\n' | b'\r');
        if let Some(end) = self.held.iter().rfind(ends) {
            self.line_end = *end;
        }
        let is_wrong = self.offset == part.bytes && self.check.clone().finish().crc32 != part.crc32;
        let blank = |byte: &&u8| !matches!(**byte, 0 | b' ' | b'\t' | b'\r' | b'\n');
        if let Some(last) = self.held.iter().rfind(blank) {
            self.last_text = *last;
        }
        let begins = self.held.iter().find(blank);
        // The host looks itself at the end of what it passes through.
        let is_cut = part.stored.is_some() && self.offset == part.bytes && self.last_text != b'%';
        if is_wrong {
            self.fails();
        } else if is_first && begins.is_none_or(|byte| *byte != b'%') {
            self.withhold(Withheld::NoPercent);
        } else if is_cut {
            self.refuse(Withheld::NoPercent);
        }
    }

    /// The program is not what it should be.
    fn fails(&mut self) {
        self.refuse(Withheld::Damaged);
    }

    /// It does not go out, or not on.
    fn refuse(&mut self, why: Withheld) {
        match self.stage {
            Stage::Looking => self.withhold(why),
            _ => {
                self.refused = Some(why);
                self.break_off();
            }
        }
    }

    /// What is held goes on as it is.
    fn copy(&mut self) {
        let held = core::mem::take(&mut self.held);
        if let Some(byte) = self.put_on(&held) {
            self.refuse(Withheld::NotInCode { byte });
        }
    }

    /// One line of what is held goes on, rewritten.
    #[inline(never)]
    fn rewrite(&mut self) {
        let Some(mut rewriter) = self.rewriter.take() else {
            return;
        };
        let held = core::mem::take(&mut self.held);
        let mut lacks = None;
        let mut sink = |bytes: &[u8]| {
            if lacks.is_none() {
                lacks = self.put_on(bytes);
            }
        };
        match rewriter.push_line(&held, &mut sink) {
            Ok(progress) => {
                self.held.extend(held.iter().skip(progress.taken).copied());
                self.has_more = progress.has_more;
                self.rewriter.put(rewriter);
                if let Some(byte) = lacks {
                    self.refuse(Withheld::NotInCode { byte });
                }
            }
            Err(refusal) => self.refuse(Withheld::NotRewritable {
                line: u32::try_from(refusal.line).unwrap_or(u32::MAX),
                column: u16::try_from(refusal.column).unwrap_or(u16::MAX),
            }),
        }
    }

    /// Bytes go into the queue, or are only looked at; one that the code lacks, if there is.
    fn put_on(&mut self, bytes: &[u8]) -> Option<u8> {
        for byte in bytes {
            let before = core::mem::replace(&mut self.last_put, *byte);
            let byte = match (byte, before) {
                // The blank tape of a program that was punched once.
                (0 | 0x7F, _) => {
                    self.last_put = before;
                    continue;
                }
                // EIA has one end of block.
                (b'\r', b'\n') | (b'\n', b'\r') if self.coding == Coding::Eia => continue,
                (b'\r', _) if self.coding == Coding::Eia => b'\n',
                (byte, _) => *byte,
            };
            match byte {
                b'(' => self.in_comment = true,
                b')' | b'\n' | b'\r' => self.in_comment = false,
                _ => {}
            }
            if self.in_comment && (!is_text(byte) || byte == b'%') {
                // What is no text would be taken for flow control, and % for the end.
                continue;
            }
            if !is_text(byte) || encode(self.coding, byte).is_none() {
                return Some(byte);
            }
            if self.stage == Stage::Sending {
                // A line found room before it was begun.
                let _ = self.queue.push_back(byte);
            }
        }
        None
    }

    pub(super) fn next_byte(&mut self) -> Next {
        match self.queue.pop_front() {
            // Looked at when it was put there.
            Some(ascii) => {
                if !is_line_end(ascii) {
                    self.last_sent = ascii;
                }
                encode(self.coding, ascii).map_or(Next::End { whole: false }, Next::Byte)
            }
            None if self.stage == Stage::Ended => Next::End { whole: self.whole },
            None if self.is_passed() => Next::WaitForHost,
            None => Next::Wait,
        }
    }

    /// Bytes of the program that have not been read.
    fn left(&self) -> usize {
        match &self.what {
            What::Program(part) => (part.bytes - self.offset) as usize,
            What::Correction { .. } | What::Alarm { .. } | What::Answer => 0,
        }
    }

    /// Whether what is left carries nothing.
    pub(super) fn is_all_out(&self) -> bool {
        let is_closed = self.queue.is_empty() || self.last_sent == b'%';
        let is_ended = self.stage == Stage::Ended && self.whole;
        is_ended && is_closed && self.queue.iter().all(|byte| is_line_end(*byte))
    }

    /// Whether the host passes it through.
    pub(super) fn is_passed(&self) -> bool {
        matches!(&self.what, What::Program(part) if part.stored.is_none())
    }
}

const fn is_line_end(byte: u8) -> bool {
    matches!(byte, b'\n' | b'\r')
}

/// Whether a byte of a program is one.
const fn is_text(byte: u8) -> bool {
    matches!(byte, b' '..=b'~' | b'\n' | b'\r' | b'\t')
}
