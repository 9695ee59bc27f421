//! Blocks and tables: points under a header, and the line that is due.

use umi_protocol::fault::{BlockEndCause, NumberIssue};
use umi_protocol::job::Name;
use umi_protocol::pattern::{BlockPattern, LinePattern, RingCsvPattern};

use crate::dprnt::BlockEnd;
use crate::dprnt::line::fields::{Fields, Outcome};
use crate::dprnt::line::number::{Cursor, Issue};
use crate::dprnt::line::pattern;

/// What is due next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Due {
    /// The count line.
    Count,
    /// A point (or row) with this place, from 1.
    Point,
    /// Nothing: all have come. The block is kept to recognise one too many.
    Nothing,
}

/// A block or table that has begun.
#[derive(Clone, Debug)]
pub(in crate::dprnt) struct Block {
    /// The pattern, by its number in the job.
    pattern: u8,
    pub name: Name,
    due: Due,
    expected: Option<u16>,
    /// The place of the next point, from 1.
    place: u16,
    got: u16,
    damaged: u16,
    /// Closing the port does not end it.
    spans_sessions: bool,
    /// Rows carry their own number.
    table: bool,
    /// Its end has been reported.
    reported: bool,
    /// Another line came behind its last point: what follows is not its own.
    left: bool,
}

/// What a line means to the block.
#[derive(Clone, Debug)]
pub(in crate::dprnt) enum Step {
    /// It does not belong to it.
    None,
    /// A count line or table header.
    Counted,
    /// A point at this place.
    Point(Fields, u16),
    /// A row at this place, after missing ones: from, to.
    AfterGap(Fields, u16, u16, u16),
    /// A row that has come already, or that nothing says where it belongs.
    OutOfOrder(u16),
    /// A point where none is due: announced, and its number.
    Extra(u16, u16),
    /// It is a point or row, but with this fault.
    Bad(Issue),
}

impl Block {
    /// A block after its header.
    pub const fn new(pattern: u8, name: Name, block: &BlockPattern) -> Self {
        Self {
            pattern,
            name,
            due: Due::Count,
            expected: None,
            place: 1,
            got: 0,
            damaged: 0,
            spans_sessions: block.spans_sessions,
            table: false,
            reported: false,
            left: false,
        }
    }

    /// A table after its header. The macro of the thesis opens and closes the
    /// port for every row.
    pub const fn table(pattern: u8, name: Name, table: &RingCsvPattern) -> Self {
        Self {
            pattern,
            name,
            due: Due::Point,
            expected: Some(table.rows),
            place: 1,
            got: 0,
            damaged: 0,
            spans_sessions: true,
            table: true,
            reported: false,
            left: false,
        }
    }

    /// Whether its end has not been reported.
    pub const fn is_open(&self) -> bool {
        !self.reported
    }

    /// True once, when its last point has come.
    pub fn take_completion(&mut self) -> bool {
        let completed = self.due == Due::Nothing && !self.reported;
        self.reported |= completed;
        completed
    }

    /// Whether closing or opening the port ends it.
    pub const fn ends_with_session(&self) -> bool {
        !self.spans_sessions
    }

    /// Tries a line, if this is the pattern of the block.
    pub fn line(&mut self, number: u8, pattern: &LinePattern, text: &[u8]) -> Step {
        if number != self.pattern {
            return Step::None;
        }
        match pattern {
            LinePattern::Block(block) => self.block_line(block, text),
            LinePattern::RingCsv(table) => self.row(table, text),
            _ => Step::None,
        }
    }

    fn block_line(&mut self, block: &BlockPattern, text: &[u8]) -> Step {
        if self.due == Due::Count {
            let mut cursor = Cursor::new(text);
            if let Ok(count) = cursor.whole(u32::from(u16::MAX))
                && cursor.at_end()
            {
                let count = u16::try_from(count).unwrap_or(u16::MAX);
                if count == 0 {
                    return Step::Bad((NumberIssue::Missing, 1));
                }
                self.expected = Some(count);
                self.due = Due::Point;
                return Step::Counted;
            }
        }
        let outcome = pattern::three_numbers(block.format, text);
        match (outcome, self.due) {
            // A point directly behind the last one is one too many. Behind another
            // line it belongs to a block whose header was lost.
            (Outcome::Point(_), Due::Nothing) if self.left => Step::None,
            (Outcome::Point(_), Due::Nothing) => self.extra(),
            (_, Due::Nothing) => {
                self.left = true;
                Step::None
            }
            (Outcome::Point(fields), _) => {
                // Without a count line the points are still points, but nobody
                // knows how many there should be.
                self.due = Due::Point;
                Step::Point(fields, self.count_good())
            }
            (Outcome::Bad(issue), Due::Point) if looks_like_numbers(text) => Step::Bad(issue),
            _ => Step::None,
        }
    }

    /// `i, x, y`
    fn row(&mut self, table: &RingCsvPattern, text: &[u8]) -> Step {
        let mut cursor = Cursor::new(text);
        let Ok(index) = cursor.whole(u32::from(u16::MAX)) else {
            return Step::None;
        };
        cursor.blanks();
        if !cursor.take(b',') {
            return Step::None;
        }
        let fields = match two_values(&mut cursor) {
            Ok(fields) => fields,
            Err(issue) => return Step::Bad(issue),
        };
        let index = u16::try_from(index).unwrap_or(u16::MAX);
        let rows = self.expected.unwrap_or(u16::MAX);
        if index > rows {
            return Step::Extra(rows, index);
        }
        if index < self.place {
            return Step::OutOfOrder(index);
        }
        match fields.into_point(Some(table.format)) {
            Outcome::Point(fields) => {
                let (from, missing) = (self.place, index - self.place);
                self.damaged = self.damaged.saturating_add(missing);
                self.place = index;
                let place = self.count_good();
                if missing == 0 {
                    Step::Point(fields, place)
                } else {
                    Step::AfterGap(fields, place, from, index - 1)
                }
            }
            Outcome::Bad(issue) => Step::Bad(issue),
            _ => Step::None,
        }
    }

    fn extra(&mut self) -> Step {
        self.got = self.got.saturating_add(1);
        Step::Extra(self.expected.unwrap_or(0), self.got)
    }

    /// A good point: its place.
    fn count_good(&mut self) -> u16 {
        let place = self.place;
        self.got = self.got.saturating_add(1);
        self.advance();
        place
    }

    /// A line was damaged or not understood. Where a point is due it stands for
    /// that point, so that the others keep their places. A table's rows say
    /// themselves which is missing.
    pub fn note_damage(&mut self) {
        if self.due == Due::Point && !self.table {
            self.damaged = self.damaged.saturating_add(1);
            self.advance();
        }
    }

    /// A row came twice: the table cannot be trusted.
    pub fn note_disorder(&mut self) {
        self.damaged = self.damaged.saturating_add(1);
    }

    fn advance(&mut self) {
        if Some(self.place) == self.expected {
            self.due = Due::Nothing;
        }
        self.place = self.place.saturating_add(1);
    }

    /// What is reported at its end.
    pub fn end(&self, ended_by: BlockEndCause) -> BlockEnd {
        BlockEnd {
            name: self.name.clone(),
            expected: self.expected,
            got: self.got,
            damaged: self.damaged,
            complete: self.damaged == 0 && self.expected == Some(self.got),
            ended_by,
        }
    }
}

/// `Index,X,Y`, with blanks anywhere.
pub(in crate::dprnt) fn is_table_header(text: &[u8]) -> bool {
    let letters = text
        .iter()
        .filter(|b| !crate::dprnt::line::number::is_blank(**b));
    letters
        .map(u8::to_ascii_uppercase)
        .eq(b"INDEX,X,Y".iter().copied())
}

fn two_values(cursor: &mut Cursor<'_>) -> Result<Fields, Issue> {
    let x = cursor.number()?;
    cursor.blanks();
    if !cursor.take(b',') {
        let issue = if cursor.at_number() {
            NumberIssue::Surplus
        } else {
            NumberIssue::Missing
        };
        return Err((issue, cursor.position()));
    }
    let y = cursor.number()?;
    if !cursor.at_end() {
        return Err((NumberIssue::Surplus, cursor.position()));
    }
    Ok(Fields {
        axes: [Some(x), Some(y), None],
        ..Fields::default()
    })
}

/// Only digits, signs, points and blanks: a point line gone wrong, and not some
/// other text.
fn looks_like_numbers(text: &[u8]) -> bool {
    text.iter()
        .all(|b| b.is_ascii_digit() || b" *+-.".contains(b))
}
