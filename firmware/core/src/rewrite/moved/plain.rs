//! Blocks that do nothing but lead along a straight line, in the modes that are in force: of a
//! long program nearly all. They are read, carried and written in one go.
//!
//! # Design
//!
//! * **No second meaning.** A block is plain if no mode, offset, cycle or arc has a part in
//!   it, if every place is known, and if its text is nothing but numbers behind `N`, `G0` or
//!   `G1`, `X`, `Y`, `Z`, `F`: each once at most, in this order. Whatever else there is, a
//!   number that is out of range among it, goes the way of all blocks (`follow`): nothing is
//!   refused here, and nothing is done before it is known that the block is plain. Numbers,
//!   lengths, images, rounding and places are the same functions.
//! * **The same comes out** is a property test (`tests/plain.rs`): a block with an empty comment
//!   behind it is not plain.
//!
//! # Tradeoffs
//!
//! What a block could ask for takes time also where it does not: `laces` of `tests/bench` take
//! 100 instructions of a PC a byte without this file and 68 with it. It is the larger part of
//! the 2.6 KB of flash that the rewriter has grown by for its speed.

use crate::rewrite::block::AXES;
use crate::rewrite::moved::plan::Rounded;
use crate::rewrite::state::{Feed, Motion};
use crate::rewrite::text::emit::Out;
use crate::rewrite::text::length::{LIMIT_PM, Pm};
use crate::rewrite::text::words::number;
use crate::rewrite::{Rewriter, Tape, at};

/// What a plain block says.
struct Plain {
    /// Said by its G0 or G1, or in force.
    motion: Motion,
    /// Where it leads, in the frame of the transform.
    nominal: [Pm; 3],
    /// Where the axis words begin and end; both zero where there is none.
    spans: [(usize, usize); 3],
    /// Whether blanks stand between its words; none if it has only one.
    spaced: Option<bool>,
}

impl Rewriter {
    /// Carries out a block if it is plain, and writes it; false if it is not, and nothing is
    /// done.
    pub(in crate::rewrite) fn plain<S: FnMut(&[u8])>(
        &mut self,
        line: &[u8],
        out: &mut Out<'_, S>,
    ) -> bool {
        if !self.is_straight() {
            return false;
        }
        let Some(plain) = self.read_plain(line) else {
            return false;
        };
        let image = self.image(plain.nominal.map(|pm| pm as f64));
        let step = self.step();
        let mut rounded = [Rounded::default(); 3];
        for (axis, slot) in rounded.iter_mut().enumerate() {
            let (image, nominal) = (at(&image, axis), at(&plain.nominal, axis));
            let is_named = plain.span(axis).is_some();
            match self.round(axis, image, nominal, is_named, false, &step) {
                Some(rounded) => *slot = rounded,
                None => return false,
            }
        }
        for axis in 0..3 {
            self.arrive(axis, at(&plain.nominal, axis), at(&rounded, axis).out);
        }
        (self.motion, self.out_motion) = (Some(plain.motion), Some(plain.motion));
        self.spaced = plain.spaced.unwrap_or(self.spaced);
        self.count_straight(plain.motion);
        self.counts.blocks.add(1);
        plain.write(line, &rounded, step.decimals, self.spaced, out);
        true
    }

    /// Whether nothing but a straight line may come of axis words, as things stand.
    fn is_straight(&self) -> bool {
        let modes = &self.modes;
        self.tape == Tape::Program
            && self.has_header
            && self.frame.is_some()
            && modes.incremental == Some(false)
            && modes.shift.known
            && self.cycle_in_force.is_none()
            && modes.feed != Feed::InverseTime
            && (!modes.compensated || at(&self.keeps, modes.plane.normal()))
            && !self.place.relative
            && self.place.out.iter().all(Option::is_some)
    }

    /// Reads a line; none if it is not plain.
    #[inline]
    fn read_plain(&self, line: &[u8]) -> Option<Plain> {
        let [Some(x), Some(y), Some(z)] = self.place.nominal else {
            return None;
        };
        let mut nominal = [x, y, z];
        let mut spans = [(0, 0); 3];
        let mut motion = self.motion.filter(|_| self.motion == self.out_motion);
        let mut spaced = None;
        let mut first_end = 0;
        let mut previous = 0;
        let mut start = 0;
        while let Some(&byte) = line.get(start) {
            if byte == b' ' {
                start += 1;
                continue;
            }
            let is_negative = line.get(start + 1) == Some(&b'-');
            let begin = start + 1 + usize::from(is_negative);
            let (number, end) = number(line, begin, is_negative).ok()?;
            let order = match byte {
                b'N' => 1,
                b'G' => {
                    motion = match (number.digits, number.decimals) {
                        (0, 0) => Some(Motion::Rapid),
                        (1, 0) => Some(Motion::Line),
                        _ => return None,
                    };
                    2
                }
                b'X' | b'Y' | b'Z' => {
                    let axis = usize::from(byte - b'X');
                    let value = self.length_of_number(number, byte).ok()?;
                    let place = at(&self.modes.shift.nominal, axis).checked_add(value)?;
                    if place.unsigned_abs() > LIMIT_PM.unsigned_abs() {
                        return None;
                    }
                    *nominal.get_mut(axis)? = place;
                    *spans.get_mut(axis)? = (start, end);
                    3 + axis
                }
                b'F' => 6,
                _ => return None,
            };
            if order <= previous {
                return None;
            }
            previous = order;
            if first_end == 0 {
                first_end = end;
            } else if spaced.is_none() {
                spaced = Some(start > first_end);
            }
            start = end;
        }
        let motion = motion.filter(|motion| matches!(motion, Motion::Rapid | Motion::Line))?;
        spans.iter().any(|(_, end)| *end > 0).then_some(Plain {
            motion,
            nominal,
            spans,
            spaced,
        })
    }
}

impl Plain {
    /// Where an axis word stands.
    #[inline]
    fn span(&self, axis: usize) -> Option<(usize, usize)> {
        Some(at(&self.spans, axis)).filter(|(_, end)| *end > 0)
    }

    /// Writes the block: what changes in its place, an axis that was not named before the
    /// next one that is, or behind the last.
    fn write<S: FnMut(&[u8])>(
        &self,
        line: &[u8],
        rounded: &[Rounded; 3],
        decimals: u8,
        spaced: bool,
        out: &mut Out<'_, S>,
    ) {
        let separator: &[u8] = if spaced { b" " } else { b"" };
        // What stands before has been written.
        let mut copied = 0;
        for axis in 0..3 {
            let Some(steps) = at(rounded, axis).steps else {
                continue;
            };
            if let Some((start, end)) = self.span(axis) {
                out.put(line.get(copied..start).unwrap_or_default());
                let letter = line.get(start).copied().unwrap_or_default();
                out.length(letter, steps, decimals);
                copied = end;
                continue;
            }
            let letter = at(&AXES, axis);
            if let Some((start, _)) = (axis..3).find_map(|next| self.span(next)) {
                out.put(line.get(copied..start).unwrap_or_default());
                out.length(letter, steps, decimals);
                out.put(separator);
                copied = start;
            } else {
                let last = self.spans.iter().map(|(_, end)| *end).max();
                let end = last.unwrap_or_default();
                out.put(line.get(copied..end).unwrap_or_default());
                out.put(separator);
                out.length(letter, steps, decimals);
                copied = end;
            }
        }
        out.put(line.get(copied..).unwrap_or_default());
    }
}
