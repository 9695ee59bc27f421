//! Fields that a pattern finds in a line.

use umi_protocol::fault::NumberIssue;
use umi_protocol::job::{Approach, Name};
use umi_protocol::pattern::FieldFormat;

use super::number::{Cursor, Issue, Number};
use crate::dprnt::Said;

/// What a checked line says beside the point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::dprnt) struct Ids {
    pub run: u32,
    pub sequence: u32,
    pub feature: u16,
    pub approach: Option<Approach>,
    pub said: Option<Said>,
    pub check: u32,
}

/// What a line carries, as far as it says.
#[derive(Clone, Debug, Default)]
pub(in crate::dprnt) struct Fields {
    pub axes: [Option<Number>; 3],
    pub index: Option<u32>,
    pub name: Option<Name>,
    pub feed_mm_per_min: Option<f64>,
    pub touched: Option<bool>,
    pub ids: Option<Ids>,
    /// The format of the axes, where it is known.
    pub format: Option<FieldFormat>,
}

/// How a line fits a pattern.
#[derive(Clone, Debug)]
pub(in crate::dprnt) enum Outcome {
    /// Not at all.
    None,
    /// Not, but for this: another pattern may still fit.
    Almost(Issue),
    /// It is such a line, but with this fault: it is not used.
    Bad(Issue),
    /// It is a checked line, but its check value is wrong: printed, computed.
    BadCheck(u32, u32),
    /// It carries a point (or says that there was no touch).
    Point(Fields),
}

impl Fields {
    /// Exactly these three numbers, and nothing else, are left in the line.
    pub fn three(cursor: &mut Cursor<'_>) -> Result<Self, Issue> {
        let mut fields = Self::default();
        for axis in &mut fields.axes {
            *axis = Some(cursor.number()?);
        }
        if cursor.at_end() {
            Ok(fields)
        } else {
            Err((NumberIssue::Surplus, cursor.position()))
        }
    }

    /// The point, if its numbers are as the format says.
    pub fn into_point(mut self, format: Option<FieldFormat>) -> Outcome {
        self.format = format;
        if let Some(format) = format {
            for number in self.axes.iter().flatten() {
                if let Err(issue) = number.check(format) {
                    return Outcome::Bad(issue);
                }
            }
        }
        Outcome::Point(self)
    }

    /// The line goes wrong here. Worth a remark only if a coordinate was read.
    pub fn almost(&self, issue: Issue) -> Outcome {
        if self.axes.iter().any(Option::is_some) {
            Outcome::Almost(issue)
        } else {
            Outcome::None
        }
    }

    /// The line does not go on as it should: because of a number too many?
    pub fn surplus(&self, mut cursor: Cursor<'_>) -> Outcome {
        if cursor.at_number() {
            self.almost((NumberIssue::Surplus, cursor.position()))
        } else {
            Outcome::None
        }
    }
}
