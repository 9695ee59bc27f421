//! A line of the control, before anybody knows what it says.

use umi_protocol::line::LineStatus;
use umi_protocol::pattern::Coding;

use crate::dprnt::Line;
use crate::dprnt::code::coding::Damage;
use crate::units::Micros;

/// Bytes of a line that are kept. Okuma's `WRITE` ends at 160 too.
pub const MAX_LINE: usize = 160;

/// A line with its parity and control codes removed.
#[derive(Clone, Copy, Debug)]
pub(in crate::dprnt) struct RawLine<'a> {
    /// Printable ASCII.
    pub text: &'a [u8],
    pub number: u32,
    pub byte_offset: u64,
    pub first: Micros,
    pub last: Micros,
    pub coding: Coding,
    pub damage: Damage,
    pub too_long: bool,
    pub lost: bool,
    /// NUL or DEL stood between characters.
    pub fill_inside: bool,
    /// It has a line end.
    pub ended: bool,
}

impl<'a> RawLine<'a> {
    pub fn is_damaged(&self) -> bool {
        self.too_long || self.lost || self.damage.bad_parity > 0 || self.damage.unknown > 0
    }

    pub fn report(&self, status: LineStatus, pattern: Option<u8>) -> Line<'a> {
        Line {
            number: self.number,
            byte_offset: self.byte_offset,
            first: self.first,
            last: self.last,
            status,
            pattern,
            coding: self.coding,
            text: core::str::from_utf8(self.text).unwrap_or_default(),
        }
    }
}
