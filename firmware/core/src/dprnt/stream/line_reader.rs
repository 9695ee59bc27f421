//! Line reader: lines become hits, by programs, patterns, blocks and sequence numbers.

use umi_protocol::fault::{BlockEndCause, FaultKind};
use umi_protocol::job::Name;
use umi_protocol::line::LineStatus;
use umi_protocol::pattern::{LinePattern, ReceiverConfig};

use super::block::{self, Block};
use super::program::{self, Program};
use super::sequence::{Arrival, Sequence};
use super::sink::Sink;
use crate::dprnt::code::coding::Damage;
use crate::dprnt::line::fields::{Fields, Ids, Outcome};
use crate::dprnt::line::number::{Issue, is_blank};
use crate::dprnt::line::pattern;
use crate::dprnt::line::raw_line::{MAX_LINE, RawLine};
use crate::dprnt::line::request::program_asked_for;
use crate::dprnt::stream::hit;
use crate::dprnt::{Announced, BlockStart, Item};
use crate::units::Micros;

/// What the patterns say about a line.
enum Found {
    /// No pattern fits; perhaps only because of this.
    Nothing(Option<Issue>),
    /// The header of a block or table.
    Header(Block, Name),
    /// A line of the block or table that is open.
    Block(block::Step),
    /// A line that stands for itself.
    Single(Outcome),
    /// It would fit, but broke off, and nothing shows that it is whole.
    BrokenOff,
}

/// Lines to hits.
#[derive(Clone, Debug)]
pub(in crate::dprnt) struct LineReader {
    config: ReceiverConfig,
    program: Program,
    block: Option<Block>,
    sequence: Sequence,
}

impl LineReader {
    pub const fn new(config: ReceiverConfig) -> Self {
        Self {
            config,
            program: Program::None,
            block: None,
            sequence: Sequence::new(),
        }
    }

    pub fn idle_timeout(&self) -> Micros {
        Micros(u64::from(self.config.idle_timeout_s) * 1_000_000)
    }

    /// Whether something waits for more lines.
    pub fn is_unfinished(&self) -> bool {
        self.program != Program::None || self.block.is_some()
    }

    /// Lines of the program that has begun.
    pub const fn punched_lines(&self) -> Option<u32> {
        match self.program {
            Program::Inside(lines) => Some(lines),
            _ => None,
        }
    }

    /// Whether no block and no program has begun that is not at its end.
    pub fn is_at_rest(&self) -> bool {
        let is_open = self.block.as_ref().is_some_and(Block::is_open);
        !is_open && !matches!(self.program, Program::Inside(_))
    }

    /// Takes a line.
    pub fn line<S: FnMut(Item<'_>)>(&mut self, line: &RawLine<'_>, out: &mut Sink<'_, S>) {
        if line.is_damaged() {
            self.damaged(line, out);
            return;
        }
        if matches!(self.program, Program::Inside(_)) && self.is_of_a_setup(line) {
            self.end_program(false, out);
        }
        match self.program.line(line.text) {
            program::Step::Text => {}
            program::Step::Mark => return out.line(line.report(LineStatus::Separator, None)),
            program::Step::Line => return out.line(line.report(LineStatus::Program, None)),
            program::Step::Begin => return self.program_begins(line, out),
            program::Step::End(lines) => {
                out.line(line.report(LineStatus::Program, None));
                return out.fault(FaultKind::ProgramReceived { lines }, b"");
            }
        }
        if line.text.iter().all(|b| is_blank(*b)) {
            return out.line(line.report(LineStatus::Separator, None));
        }
        if line.ended
            && let Some(number) = program_asked_for(line.text)
        {
            out.line(line.report(LineStatus::Request, None));
            return out.item(Item::Request(number));
        }
        let (number, found) = self.find(line);
        let matched = |out: &mut Sink<'_, S>| out.line(line.report(LineStatus::Matched, number));
        match found {
            Found::Nothing(issue) => return self.nothing(issue, line, out),
            Found::BrokenOff => self.bad(FaultKind::LineUnterminated, line, number, out),
            Found::Header(block, name) => {
                matched(out);
                self.end_block(BlockEndCause::NewHeader, out);
                self.block = Some(block);
                out.item(Item::BlockStart(BlockStart {
                    name,
                    line: line.number,
                }));
            }
            Found::Block(step) => self.block_step(step, number, line, out),
            Found::Single(outcome) => self.single(outcome, number, line, out),
        }
        self.program.printed();
    }

    /// Whether no program can hold this line: a checked line whose check value is right, or the
    /// header of a block, unless that is a letter and a number as in any program. What seemed
    /// to be punched was not, or broke off.
    fn is_of_a_setup(&self, line: &RawLine<'_>) -> bool {
        self.config.patterns.iter().any(|format| match format {
            LinePattern::Checked(_) => {
                matches!(pattern::read(format, line.text), Outcome::Point(_))
            }
            LinePattern::Block(block) => pattern::header(block, line.text)
                .is_some_and(|name| name.bytes().take(2).all(|b| b.is_ascii_alphabetic())),
            _ => false,
        })
    }

    /// The first pattern that fits.
    fn find(&mut self, line: &RawLine<'_>) -> (Option<u8>, Found) {
        let Self { config, block, .. } = self;
        let mut remark = None;
        for (number, pattern) in (0u8..).zip(&config.patterns) {
            let found = match pattern {
                LinePattern::Block(format) => pattern::header(format, line.text)
                    .map(|name| Found::Header(Block::new(number, name.clone(), format), name)),
                LinePattern::RingCsv(table) if block::is_table_header(line.text) => {
                    let name = table.name.clone();
                    Some(Found::Header(
                        Block::table(number, name.clone(), table),
                        name,
                    ))
                }
                LinePattern::RingCsv(_) => None,
                _ => match pattern::read(pattern, line.text) {
                    Outcome::None => None,
                    Outcome::Almost(issue) => {
                        remark = remark.or(Some(issue));
                        None
                    }
                    Outcome::Point(_) if !line.ended && !pattern::shows_its_end(pattern) => {
                        Some(Found::BrokenOff)
                    }
                    outcome => Some(Found::Single(outcome)),
                },
            };
            if let Some(found) = found {
                return (Some(number), found);
            }
            if let Some(block) = block {
                match block.line(number, pattern, line.text) {
                    block::Step::None => {}
                    step => return (Some(number), Found::Block(step)),
                }
            }
        }
        (None, Found::Nothing(remark))
    }

    /// A line that no pattern fits.
    fn nothing<S: FnMut(Item<'_>)>(
        &mut self,
        issue: Option<Issue>,
        line: &RawLine<'_>,
        out: &mut Sink<'_, S>,
    ) {
        let kind = if line.fill_inside {
            FaultKind::BinaryData
        } else if self.program.no_pattern(line.text) == program::Step::Begin {
            return self.program_begins(line, out);
        } else if !line.ended {
            FaultKind::LineUnterminated
        } else if let Some(issue) = issue {
            number_kind(issue, line)
        } else {
            out.line(line.report(LineStatus::NotUnderstood, None));
            out.fault(FaultKind::NotUnderstood, line.text);
            self.program.printed();
            return self.note_damage(out);
        };
        self.program.printed();
        self.bad(kind, line, None, out);
        self.note_damage(out);
    }

    /// A line with wrong or lost characters.
    fn damaged<S: FnMut(Item<'_>)>(&mut self, line: &RawLine<'_>, out: &mut Sink<'_, S>) {
        out.line(line.report(LineStatus::Damaged, None));
        let Damage {
            bad_parity,
            first_bad_parity,
            unknown,
            first_unknown,
            unknown_byte,
        } = line.damage;
        if line.too_long {
            let kept = u16::try_from(MAX_LINE).unwrap_or(u16::MAX);
            out.fault(FaultKind::LineTooLong { kept }, line.text);
        }
        if line.fill_inside && (bad_parity > 0 || unknown > 0) {
            out.fault(FaultKind::BinaryData, line.text);
        } else {
            if bad_parity > 0 {
                let kind = FaultKind::BadParity {
                    count: bad_parity,
                    first: first_bad_parity,
                };
                out.fault(kind, line.text);
            }
            if unknown > 0 {
                let kind = FaultKind::UnknownCharacter {
                    count: unknown,
                    first: first_unknown,
                    byte: unknown_byte,
                };
                out.fault(kind, line.text);
            }
        }
        self.program.damaged();
        self.note_damage(out);
    }

    /// A line that is not used.
    fn bad<S: FnMut(Item<'_>)>(
        &self,
        kind: FaultKind,
        line: &RawLine<'_>,
        pattern: Option<u8>,
        out: &mut Sink<'_, S>,
    ) {
        out.line(line.report(LineStatus::Damaged, pattern));
        out.fault(kind, line.text);
    }

    fn block_step<S: FnMut(Item<'_>)>(
        &mut self,
        step: block::Step,
        number: Option<u8>,
        line: &RawLine<'_>,
        out: &mut Sink<'_, S>,
    ) {
        let point = |fields: &Fields| !is_binary(fields, line);
        match step {
            block::Step::None => {}
            block::Step::Counted => out.line(line.report(LineStatus::Matched, number)),
            block::Step::Point(fields, place) if point(&fields) => {
                out.line(line.report(LineStatus::Matched, number));
                self.block_hit(fields, place, number, line, out);
            }
            block::Step::AfterGap(fields, place, from, to) if point(&fields) => {
                out.line(line.report(LineStatus::Matched, number));
                out.fault(FaultKind::RowGap { from, to }, line.text);
                self.block_hit(fields, place, number, line, out);
            }
            block::Step::Point(..) | block::Step::AfterGap(..) => {
                self.bad(FaultKind::BinaryData, line, number, out);
                self.note_disorder();
            }
            block::Step::OutOfOrder(row) => {
                self.bad(FaultKind::RowRepeated { row }, line, number, out);
                self.note_disorder();
            }
            block::Step::Extra(expected, got) => {
                self.bad(
                    FaultKind::BlockCountMismatch { expected, got },
                    line,
                    number,
                    out,
                );
            }
            block::Step::Bad(issue) => {
                self.bad(number_kind(issue, line), line, number, out);
                self.note_damage(out);
            }
        }
        self.end_counted_block(out);
    }

    /// A point of the block or table.
    fn block_hit<S: FnMut(Item<'_>)>(
        &self,
        fields: Fields,
        place: u16,
        number: Option<u8>,
        line: &RawLine<'_>,
        out: &mut Sink<'_, S>,
    ) {
        let fields = Fields {
            index: Some(u32::from(place)),
            name: self.block.as_ref().map(|block| block.name.clone()),
            ..fields
        };
        let pattern = number.and_then(|number| self.config.patterns.get(usize::from(number)));
        let z_mm = match pattern {
            Some(LinePattern::RingCsv(table)) => table.z_mm,
            _ => 0.0,
        };
        hit::emit(&fields, z_mm, self.config.travel_mm, line, out);
    }

    /// A line that stands for itself.
    fn single<S: FnMut(Item<'_>)>(
        &mut self,
        outcome: Outcome,
        number: Option<u8>,
        line: &RawLine<'_>,
        out: &mut Sink<'_, S>,
    ) {
        let fields = match outcome {
            Outcome::None | Outcome::Almost(_) => return,
            Outcome::Bad(_) if line.fill_inside => {
                return self.bad(FaultKind::BinaryData, line, number, out);
            }
            Outcome::Bad(issue) => return self.bad(number_kind(issue, line), line, number, out),
            Outcome::BadCheck(printed, computed) => {
                let kind = FaultKind::BadCheckValue { printed, computed };
                return self.bad(kind, line, number, out);
            }
            Outcome::Point(fields) if is_binary(&fields, line) => {
                return self.bad(FaultKind::BinaryData, line, number, out);
            }
            Outcome::Point(fields) => fields,
        };
        let arrival = fields.ids.as_ref().map(|ids| {
            let (run, sequence) = (ids.run, ids.sequence);
            (run, sequence, self.sequence.note(run, sequence, ids.check))
        });
        let status = match arrival {
            Some((.., Arrival::Repeat)) => LineStatus::Repeated,
            _ => LineStatus::Matched,
        };
        out.line(line.report(status, number));
        if let Some((run, sequence, arrival)) = arrival {
            match arrival {
                Arrival::New => {}
                Arrival::AfterGap { from, to } => {
                    out.fault(FaultKind::Gap { run, from, to }, line.text);
                }
                Arrival::Repeat => {
                    return out.fault(FaultKind::Repeat { run, sequence }, line.text);
                }
                Arrival::Conflict { compared } => {
                    let kind = FaultKind::ConflictingRepeat {
                        run,
                        sequence,
                        compared,
                    };
                    return out.fault(kind, line.text);
                }
            }
        }
        if let Some(Ids {
            run,
            said: Some(said),
            ..
        }) = fields.ids
        {
            return out.item(Item::Announced(Announced { run, said }));
        }
        if fields.touched == Some(false) {
            return out.fault(FaultKind::NotTouched, line.text);
        }
        hit::emit(&fields, 0.0, self.config.travel_mm, line, out);
    }

    fn program_begins<S: FnMut(Item<'_>)>(&mut self, line: &RawLine<'_>, out: &mut Sink<'_, S>) {
        out.line(line.report(LineStatus::Program, None));
        self.end_block(BlockEndCause::Program, out);
    }

    /// The control opened the port (DC2).
    pub fn session_opened<S: FnMut(Item<'_>)>(&mut self, out: &mut Sink<'_, S>) {
        self.end_program(false, out);
        if self.block.as_ref().is_some_and(Block::ends_with_session) {
            self.end_block(BlockEndCause::PortOpened, out);
        }
    }

    /// The control closed the port (DC4, ETX, EOT).
    pub fn session_closed<S: FnMut(Item<'_>)>(&mut self, out: &mut Sink<'_, S>) {
        self.end_program(true, out);
        if self.block.as_ref().is_some_and(Block::ends_with_session) {
            self.end_block(BlockEndCause::PortClosed, out);
        }
    }

    /// Nothing came for the idle time-out.
    pub fn idle<S: FnMut(Item<'_>)>(&mut self, out: &mut Sink<'_, S>) {
        self.end_program(false, out);
        self.end_block(BlockEndCause::Timeout, out);
    }

    /// The input ended.
    pub fn end_of_input<S: FnMut(Item<'_>)>(&mut self, out: &mut Sink<'_, S>) {
        self.end_program(false, out);
        self.end_block(BlockEndCause::EndOfInput, out);
    }

    fn end_program<S: FnMut(Item<'_>)>(&mut self, properly: bool, out: &mut Sink<'_, S>) {
        if let Some(lines) = self.program.close() {
            let kind = if properly {
                FaultKind::ProgramReceived { lines }
            } else {
                FaultKind::ProgramUnterminated { lines }
            };
            out.fault(kind, b"");
        }
    }

    fn note_damage<S: FnMut(Item<'_>)>(&mut self, out: &mut Sink<'_, S>) {
        if let Some(block) = &mut self.block
            && block.is_open()
        {
            block.note_damage();
            self.end_counted_block(out);
        }
    }

    fn note_disorder(&mut self) {
        if let Some(block) = &mut self.block {
            block.note_disorder();
        }
    }

    /// Reports a block whose last point has just come.
    fn end_counted_block<S: FnMut(Item<'_>)>(&mut self, out: &mut Sink<'_, S>) {
        if let Some(block) = &mut self.block
            && block.take_completion()
        {
            report(block, BlockEndCause::Count, out);
        }
    }

    /// Whatever block there is ends here.
    fn end_block<S: FnMut(Item<'_>)>(&mut self, cause: BlockEndCause, out: &mut Sink<'_, S>) {
        if let Some(block) = self.block.take()
            && block.is_open()
        {
            report(&block, cause, out);
        }
    }
}

fn report<S: FnMut(Item<'_>)>(block: &Block, cause: BlockEndCause, out: &mut Sink<'_, S>) {
    let end = block.end(cause);
    let kind = (!end.complete).then_some(FaultKind::BlockIncomplete {
        expected: end.expected,
        got: end.got,
        damaged: end.damaged,
        ended_by: cause,
    });
    out.item(Item::BlockEnd(end));
    if let Some(kind) = kind {
        out.fault(kind, block.name.as_bytes());
    }
}

/// A number is wrong: because the line broke off, or in itself.
const fn number_kind((issue, position): Issue, line: &RawLine<'_>) -> FaultKind {
    if line.ended {
        FaultKind::NumberFormat { issue, position }
    } else {
        FaultKind::LineUnterminated
    }
}

/// Fill between the characters and no decimal point: bytes of binary values may
/// happen to be digits.
fn is_binary(fields: &Fields, line: &RawLine<'_>) -> bool {
    let whole = |number: &crate::dprnt::line::number::Number| number.digits.decimals == 0;
    line.fill_inside && fields.axes.iter().flatten().any(whole)
}
