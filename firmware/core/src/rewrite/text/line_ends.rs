//! How the lines of a program end: LF, CR LF, CR, LF CR, LF CR CR.
//!
//! Learned from the first line, for the lines that are added. A program in which CR alone
//! ends one line and LF another is refused: a control for which LF is the end of block passes
//! over CR, and would read two of our lines as one.

use heapless::Vec;

/// What is known of the line ends.
#[derive(Clone, Debug, Default)]
pub(in crate::rewrite) struct LineEnds {
    first: Vec<u8, 3>,
    learns: bool,
    previous: u8,
    /// CR has ended a line, and no LF has come behind it yet.
    cr_waits: bool,
    has_lone_cr: bool,
    has_lf: bool,
}

impl LineEnds {
    /// Takes a CR or LF and whether text of its line stands before it. Returns whether it
    /// belongs to the end of the line before.
    pub fn terminator(&mut self, terminator: u8, has_text: bool) -> bool {
        if has_text {
            self.text();
        }
        if self.first.is_empty() {
            let _ = self.first.push(terminator);
            self.learns = true;
        } else if self.learns {
            let goes_on = !has_text
                && match (self.first.first(), self.first.len()) {
                    (Some(b'\r'), 1) => terminator == b'\n',
                    (Some(b'\n'), 1 | 2) => terminator == b'\r',
                    _ => false,
                };
            if goes_on {
                let _ = self.first.push(terminator);
            } else {
                self.learns = false;
            }
        }
        let continues = !has_text && self.continues(terminator);
        if terminator == b'\n' {
            self.has_lf = true;
            self.cr_waits = false;
        } else if has_text {
            self.cr_waits = true;
        }
        self.previous = terminator;
        continues
    }

    /// Takes text without its end.
    pub fn text(&mut self) {
        self.has_lone_cr |= core::mem::take(&mut self.cr_waits);
    }

    /// Takes the last byte of a piece that is text.
    pub fn rest(&mut self, last: u8) {
        self.text();
        self.previous = last;
        self.learns = false;
    }

    /// Whether CR alone and LF both end lines.
    pub const fn are_mixed(&self) -> bool {
        self.has_lone_cr && self.has_lf
    }

    /// Whether a byte is part of the line end before it.
    fn continues(&self, terminator: u8) -> bool {
        let first = self.first.first().copied();
        match terminator {
            b'\n' => self.previous == b'\r' && first == Some(b'\r'),
            _ if first != Some(b'\n') => false,
            _ => {
                (self.previous == b'\n' && self.first.len() > 1)
                    || (self.previous == b'\r' && self.first.len() > 2)
            }
        }
    }

    /// How a line that is added ends.
    pub fn added(&self) -> Vec<u8, 3> {
        if self.first.is_empty() {
            return Vec::from_slice(b"\n").unwrap_or_default();
        }
        let mut added = self.first.clone();
        if self.learns && added.as_slice() == b"\r" {
            // The first line ends just now: who writes CR writes LF too.
            let _ = added.push(b'\n');
        }
        added
    }
}
