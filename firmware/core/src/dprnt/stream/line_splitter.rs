//! Line splitter: bytes become lines.

use umi_protocol::fault::{Counters, FaultKind};
use umi_protocol::pattern::{Coding, ReceiverConfig};

use super::line_reader::LineReader;
use super::sink::Sink;
use crate::dprnt::Item;
use crate::dprnt::code::code_table::{
    NAK, PUNCH_OFF, PUNCH_OFF_ODD, PUNCH_ON, PUNCH_ON_ODD, SYN, XOFF, XOFF_EVEN, XON,
};
use crate::dprnt::code::coding;
use crate::dprnt::code::coding::Detector;
use crate::dprnt::line::raw_line::{MAX_LINE, RawLine};
use crate::units::Micros;

/// A control that punches a program does not pause for so long.
const PUNCH_PAUSE: Micros = Micros(10_000_000);

/// The DPRNT receiver.
///
/// The caller's sink takes [`Item`]s in the order of the stream. The same bytes
/// at the same times give the same items, however they are cut into calls.
#[derive(Clone, Debug)]
pub struct LineSplitter {
    detector: Detector,
    partial: Partial,
    reader: LineReader,
    counters: Counters,
    /// When the last byte came.
    last: Micros,
}

/// The line under way.
#[derive(Clone, Debug)]
struct Partial {
    bytes: [u8; MAX_LINE],
    length: usize,
    /// Place of the first byte in the stream, and when it came.
    offset: u64,
    first: Micros,
    /// More bytes came than are kept.
    too_long: bool,
    /// Bytes were lost in it.
    lost: bool,
}

impl Partial {
    const EMPTY: Self = Self {
        bytes: [0; MAX_LINE],
        length: 0,
        offset: 0,
        first: Micros(0),
        too_long: false,
        lost: false,
    };

    const fn has_begun(&self) -> bool {
        self.length > 0 || self.lost
    }

    /// Whether it is a `%` and nothing else, in any code.
    fn is_percent(&self) -> bool {
        self.length == 1 && matches!(self.last_byte(), Some(0x25 | 0xA5 | 0x0B))
    }

    /// Whether it is what a control says to whoever sends to it, and nothing else; in EIA
    /// these are digits.
    fn is_talk(&self) -> bool {
        let bytes = self.bytes.get(..self.length).unwrap_or_default();
        let is_talk = |byte: &u8| matches!(*byte, NAK | SYN | XON | XOFF | XOFF_EVEN);
        !self.lost && !self.too_long && bytes.iter().all(is_talk)
    }

    fn last_byte(&self) -> Option<u8> {
        let last = self.length.checked_sub(1)?;
        self.bytes.get(last).copied()
    }
}

impl LineSplitter {
    /// A receiver for a job's lines. What [`crate::dprnt::check_config`] refuses is
    /// not read as intended, but does no harm.
    #[must_use]
    pub fn new(config: &ReceiverConfig) -> Self {
        Self {
            detector: Detector::new(config.coding),
            partial: Partial::EMPTY,
            reader: LineReader::new(config.clone()),
            counters: Counters::default(),
            last: Micros(0),
        }
    }

    /// Takes one byte that came at `now`.
    pub fn push(&mut self, byte: u8, now: Micros, sink: &mut impl FnMut(Item<'_>)) {
        // The same whether or not `on_time` was called in between.
        if now > self.last {
            self.on_time(now, sink);
        }
        self.last = now;
        let counters = &mut self.counters;
        let offset = counters.bytes;
        counters.bytes += 1;
        let partial = &mut self.partial;
        match byte {
            // Feed after the `%` that ends a tape, which often has no line end.
            0x00 if partial.is_percent() => {
                counters.bytes_control += 1;
                self.end_line(None, sink);
            }
            // Feed before a line, and more than one of it.
            0x7F | 0xFF if partial.length == 0 => counters.bytes_control += 1,
            0x00 if matches!(partial.last_byte(), None | Some(0x00)) => counters.bytes_control += 1,
            // In a code with odd parity XON is one wrong bit away from a digit.
            XON if partial.last_byte().is_none() && !self.detector.has_odd_parity() => {
                counters.bytes_control += 1;
                if self.reader.is_at_rest() && !self.partial.lost {
                    sink(Item::Reads);
                }
            }
            XON if partial.last_byte() == Some(XON) => counters.bytes_control += 1,
            PUNCH_ON | PUNCH_OFF => self.session_mark(byte, offset, sink),
            PUNCH_ON_ODD | PUNCH_OFF_ODD if self.detector.coding() == Coding::AsciiOdd => {
                self.session_mark(byte, offset, sink);
            }
            _ if self.detector.is_end(byte) => {
                counters.bytes_line_end += 1;
                self.end_line(Some(byte), sink);
            }
            _ => {
                self.detector.note(byte);
                self.keep(byte, offset, now);
            }
        }
    }

    /// Takes bytes; `now` is when the last of them came.
    pub fn receive(&mut self, bytes: &[u8], now: Micros, sink: &mut impl FnMut(Item<'_>)) {
        for byte in bytes {
            self.push(*byte, now, sink);
        }
    }

    /// Bytes were lost before they could be given to [`Self::push`], or came
    /// with a framing error: the line under way (or the next) is damaged.
    pub fn lost(&mut self, count: u32, now: Micros, sink: &mut impl FnMut(Item<'_>)) {
        if now > self.last {
            self.on_time(now, sink);
        }
        self.last = now;
        self.counters.bytes_lost = self.counters.bytes_lost.saturating_add(u64::from(count));
        if !self.partial.has_begun() {
            self.partial.offset = self.counters.bytes;
            self.partial.first = now;
        }
        self.partial.lost = true;
        let line = self.counters.lines.saturating_add(1);
        let (offset, counters) = (self.partial.offset, &mut self.counters);
        out(sink, counters, line, offset, now).fault(FaultKind::BufferOverrun { lost: count }, b"");
    }

    /// When [`Self::on_time`] is due: the job's idle time-out after the last
    /// byte, if anything is unfinished.
    #[must_use]
    pub fn deadline(&self) -> Option<Micros> {
        let unfinished = self.partial.has_begun() || self.reader.is_unfinished();
        unfinished.then(|| Micros(self.last.0.saturating_add(self.reader.idle_timeout().0)))
    }

    /// Time passed: gives up what has waited too long. Does nothing before
    /// [`Self::deadline`].
    pub fn on_time(&mut self, now: Micros, sink: &mut impl FnMut(Item<'_>)) {
        if self.deadline().is_none_or(|deadline| now < deadline) {
            return;
        }
        self.end_line(None, sink);
        let (reader, mut out) = self.split(now, sink);
        reader.idle(&mut out);
    }

    /// The input ended.
    pub fn finish(&mut self, now: Micros, sink: &mut impl FnMut(Item<'_>)) {
        self.on_time(now, sink);
        self.end_line(None, sink);
        let (reader, mut out) = self.split(now, sink);
        reader.end_of_input(&mut out);
    }

    /// Lines of a program that has begun, where nothing of it has come for
    /// a pause of ten seconds.
    #[must_use]
    pub fn punched_lines(&self, now: Micros) -> Option<u32> {
        let is_quiet = now.0.saturating_sub(self.last.0) >= PUNCH_PAUSE.0;
        self.reader.punched_lines().filter(|_| is_quiet)
    }

    /// What was counted so far.
    #[must_use]
    pub const fn counters(&self) -> &Counters {
        &self.counters
    }

    /// The code in which lines are read: as configured, or as detected;
    /// [`Coding::Auto`] as long as nothing shows it.
    #[must_use]
    pub fn coding(&self) -> Coding {
        self.detector.coding()
    }

    fn keep(&mut self, byte: u8, offset: u64, now: Micros) {
        let Self {
            partial, counters, ..
        } = self;
        if !partial.has_begun() {
            partial.offset = offset;
            partial.first = now;
        }
        if let Some(place) = partial.bytes.get_mut(partial.length) {
            *place = byte;
            partial.length += 1;
            counters.bytes_text += 1;
        } else {
            partial.too_long = true;
            counters.bytes_discarded += 1;
        }
    }

    /// The line is at its end, by this byte or (without one) broken off. Returns
    /// whether there was any text.
    fn end_line(&mut self, end: Option<u8>, sink: &mut impl FnMut(Item<'_>)) -> bool {
        if !self.partial.has_begun() {
            return false;
        }
        let Self {
            detector,
            partial,
            reader,
            counters,
            last,
        } = self;
        if end.is_none() && partial.is_talk() && detector.coding() != Coding::Eia {
            // It asks for a program, or has an alarm; no line.
            let count = partial.length as u64;
            counters.bytes_text = counters.bytes_text.saturating_sub(count);
            counters.bytes_control += count;
            *partial = Partial {
                bytes: partial.bytes,
                ..Partial::EMPTY
            };
            return false;
        }
        let (coding, before) = detector.conclude(end);
        let bytes = partial.bytes.get_mut(..partial.length).unwrap_or_default();
        let cleaned = coding::clean(bytes, coding, end.is_some());
        let dropped = u64::try_from(cleaned.dropped).unwrap_or(0);
        counters.bytes_text = counters.bytes_text.saturating_sub(dropped);
        counters.bytes_control += dropped;

        let number = counters.lines.saturating_add(1);
        let mut out = out(sink, counters, number, partial.offset, *last);
        let text = bytes.get(..cleaned.length).unwrap_or_default();
        if let Some(from) = before {
            out.fault(FaultKind::CodingChanged { from, to: coding }, text);
        }
        if cleaned.closed_before {
            reader.session_closed(&mut out);
        }
        let is_damaged = cleaned.damage != coding::Damage::default();
        if cleaned.length > 0 || is_damaged || partial.lost || partial.too_long {
            let line = RawLine {
                text,
                number,
                byte_offset: partial.offset,
                first: partial.first,
                last: *last,
                coding,
                damage: cleaned.damage,
                too_long: partial.too_long,
                lost: partial.lost,
                fill_inside: cleaned.fill_inside,
                ended: end.is_some(),
            };
            reader.line(&line, &mut out);
        }
        if cleaned.closed_after {
            reader.session_closed(&mut out);
        }
        let had_text = cleaned.length > 0;
        *partial = Partial {
            bytes: partial.bytes,
            ..Partial::EMPTY
        };
        had_text
    }

    /// The control opened or closed the port.
    fn session_mark(&mut self, byte: u8, offset: u64, sink: &mut impl FnMut(Item<'_>)) {
        let had_text = self.end_line(None, sink);
        let now = self.last;
        let (reader, mut out) = self.split(now, sink);
        if matches!(byte, PUNCH_ON | PUNCH_ON_ODD) {
            reader.session_opened(&mut out);
        } else {
            reader.session_closed(&mut out);
        }
        let is_plain = matches!(byte, PUNCH_ON | PUNCH_OFF);
        if had_text && is_plain && self.detector.has_odd_parity() {
            // One wrong bit may have made it of a digit inside a line. What
            // follows before a line end is the rest of that line, not a line.
            self.keep(byte, offset, now);
        } else {
            self.counters.bytes_control += 1;
        }
    }

    /// The reader, and the way out for what belongs to no line of its own.
    fn split<'s, S: FnMut(Item<'_>)>(
        &'s mut self,
        now: Micros,
        sink: &'s mut S,
    ) -> (&'s mut LineReader, Sink<'s, S>) {
        let (line, offset) = (self.counters.lines, self.counters.bytes);
        (
            &mut self.reader,
            out(sink, &mut self.counters, line, offset, now),
        )
    }
}

fn out<'o, S: FnMut(Item<'_>)>(
    sink: &'o mut S,
    counters: &'o mut Counters,
    line: u32,
    byte_offset: u64,
    now: Micros,
) -> Sink<'o, S> {
    Sink {
        sink,
        counters,
        line,
        byte_offset,
        now,
    }
}
