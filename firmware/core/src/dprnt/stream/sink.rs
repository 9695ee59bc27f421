//! The way out of the receiver: the caller's sink and the counters, with the
//! line that is being dealt with.

use umi_protocol::fault::{Counters, Excerpt, Fault, FaultKind};
use umi_protocol::line::LineStatus;

use crate::dprnt::{Item, Line, ReportedHit};
use crate::units::Micros;

/// Hands items to the sink and counts them.
pub(in crate::dprnt) struct Sink<'o, S> {
    pub sink: &'o mut S,
    pub counters: &'o mut Counters,
    /// The line to which faults belong.
    pub line: u32,
    pub byte_offset: u64,
    pub now: Micros,
}

impl<S: FnMut(Item<'_>)> Sink<'_, S> {
    /// Something is wrong; `text` is quoted.
    pub fn fault(&mut self, kind: FaultKind, text: &[u8]) {
        self.counters.count(kind.code());
        (self.sink)(Item::Fault(Fault {
            kind,
            line: self.line,
            byte_offset: self.byte_offset,
            t_us: self.now.0,
            text: excerpt(text),
        }));
    }

    /// A line came to its end.
    pub fn line(&mut self, line: Line<'_>) {
        let counters = &mut *self.counters;
        let count = match line.status {
            LineStatus::Matched | LineStatus::Repeated => &mut counters.lines_matched,
            LineStatus::Separator | LineStatus::Request => &mut counters.lines_separator,
            LineStatus::Program => &mut counters.lines_program,
            LineStatus::NotUnderstood => &mut counters.lines_not_understood,
            LineStatus::Damaged => &mut counters.lines_damaged,
        };
        *count = count.saturating_add(1);
        counters.lines = counters.lines.saturating_add(1);
        (self.sink)(Item::Line(line));
    }

    /// A point.
    pub fn hit(&mut self, hit: ReportedHit) {
        self.counters.hits = self.counters.hits.saturating_add(1);
        (self.sink)(Item::Hit(hit));
    }

    /// Anything that is not counted.
    pub fn item(&mut self, item: Item<'_>) {
        (self.sink)(item);
    }
}

/// The beginning of a text.
fn excerpt(text: &[u8]) -> Excerpt {
    let mut excerpt = Excerpt::new();
    for byte in text {
        // All text here is ASCII; what does not fit is not quoted.
        if excerpt.push(char::from(*byte)).is_err() {
            break;
        }
    }
    excerpt
}
