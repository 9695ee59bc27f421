//! What a block asks for, and the lines that follow it.

use super::arc::Arc;
use crate::rewrite::block::{Given, Letters, Taker};
use crate::rewrite::refusal::RewriteRefusal;
use crate::rewrite::state::{Cycle, Motion};
use crate::rewrite::text::length::Pm;
use crate::rewrite::text::words::{At, Number, Value, Word};

/// What the G words of a block ask for.
#[derive(Default)]
pub(in crate::rewrite) struct Wanted {
    /// The word and its motion.
    pub motion: Option<(usize, Motion)>,
    /// The word and the cycle in tenths.
    pub cycle: Option<(usize, u16)>,
    pub taker: Option<(usize, Taker)>,
    /// Whether a tool length was put in force or taken away.
    pub length: bool,
    pub extended: bool,
    /// G5, G5.1 in tenths, with its word: look-ahead, or a spline.
    pub lookahead: Option<(usize, u16)>,
}

/// Lines that follow a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::rewrite) enum More {
    Nothing,
    Chords(Chords),
    Repeat(Repeat),
    Holes(Holes),
}

/// Where a motion goes to.
pub(in crate::rewrite) type Target = [Option<Pm>; 3];

/// The chords of an arc after the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::rewrite) struct Chords {
    pub arc: Arc,
    /// First, second and normal axis.
    pub axes: [usize; 3],
    /// Height at the start and at the end.
    pub heights: [Pm; 2],
    pub end: [Pm; 3],
    pub count: u32,
    /// The one that is written next.
    pub next: u32,
    /// F of each, where it is inverse time.
    pub feed: Option<Number>,
}

/// Further holes of a cycle that stays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::rewrite) struct Repeat {
    /// So many are left.
    pub count: u32,
    /// From hole to hole.
    pub by: [Pm; 3],
}

/// Holes of a cycle that is written out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::rewrite) struct Holes {
    pub count: u32,
    pub by: [Pm; 3],
    pub cycle: Cycle,
    pub normal: usize,
    pub to_r: bool,
    /// The one that is written, from 0, and what of it comes next.
    pub hole: u32,
    pub phase: Phase,
    /// Where it is.
    pub over: [Pm; 3],
    /// How deep the tool has been.
    pub depth: Pm,
    /// The way to the first hole, where the tool rises to R before.
    pub first: [Pm; 3],
}

/// What is written of a hole, in this order; of pecks, from `Near` to `Back` again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::rewrite) enum Phase {
    Over,
    Approach,
    Near,
    Feed,
    Back,
    Dwell,
    Out,
    Top,
}

/// A rounded place, and its word if it needs one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::rewrite) struct Rounded {
    pub out: Pm,
    pub steps: Option<i64>,
}

/// What every motion takes, and what arcs take beside.
const OF_MOTIONS: Letters = Letters::of(b"XYZABCNOGMFSTHD");
pub(in crate::rewrite) const OF_ARCS: Letters = Letters::of(b"IJKR");

/// Whether P belongs to the block's work offset or call, not to its motion.
pub(in crate::rewrite) fn is_p_of_others(given: &Given<'_>, wanted: &Wanted) -> bool {
    let calls = |word: &Word| {
        word.letter == b'M'
            && matches!(
                word.value,
                Value::Number(Number {
                    digits: 98,
                    decimals: 0,
                    ..
                })
            )
    };
    wanted.extended || given.words().any(calls)
}

/// Refuses words that an arc does not take.
pub(in crate::rewrite) fn allow_arc(given: &Given<'_>, wanted: &Wanted) -> At<()> {
    let mut known = OF_MOTIONS.or(OF_ARCS).with(b'P');
    if is_p_of_others(given, wanted) {
        known = known.with(b'L');
    }
    refuse_others(given, known)
}

/// Refuses words that a motion does not take, less the letters that this one does.
pub(in crate::rewrite) fn allow(given: &Given<'_>, letters: Letters) -> At<()> {
    let mut known = OF_MOTIONS.or(letters);
    // Of M98, or of G54.1.
    if given.has(b'M') {
        known = known.with(b'P').with(b'L');
    } else if given.has(b'G') {
        known = known.with(b'P');
    }
    refuse_others(given, known)
}

fn refuse_others(given: &Given<'_>, known: Letters) -> At<()> {
    let unknown = given.letters.less(known);
    if unknown.is_empty() {
        return Ok(());
    }
    match given.words().find(|word| unknown.has(word.letter)) {
        Some(word) => Err((word.start, RewriteRefusal::Meaningless(word.letter as char))),
        None => Ok(()),
    }
}
