//! What a program has said so far: modes, offsets, places.

use heapless::Vec;

use super::text::length::{Pm, Unit};
use super::text::words::Number;

/// Group 1 and its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Motion {
    Rapid,
    Line,
    Clockwise,
    Counter,
}

impl Motion {
    pub const fn code(self) -> &'static [u8] {
        match self {
            Self::Rapid => b"G0",
            Self::Line => b"G1",
            Self::Clockwise => b"G2",
            Self::Counter => b"G3",
        }
    }
}

/// The plane of arcs, compensation and cycles, by its normal axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Plane {
    /// 0, 1, 2: the first, the second and the normal axis.
    pub axes: [usize; 3],
}

impl Plane {
    pub const XY: Self = Self { axes: [0, 1, 2] };
    pub const ZX: Self = Self { axes: [2, 0, 1] };
    pub const YZ: Self = Self { axes: [1, 2, 0] };

    pub const fn normal(self) -> usize {
        self.axes[2]
    }

    /// Its code, as it stands in a message.
    pub const fn letter(self) -> char {
        match self.normal() {
            0 => 'X',
            1 => 'Y',
            _ => 'Z',
        }
    }
}

/// What F means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Feed {
    PerMinute,
    PerRevolution,
    InverseTime,
}

/// A canned cycle in force. Heights are those of the transform's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cycle {
    /// In tenths.
    pub code: u16,
    /// Height at which it began, nominal and written.
    pub initial: Option<Pm>,
    pub initial_out: Option<Pm>,
    pub r: Option<Pm>,
    pub r_out: Option<Pm>,
    pub bottom: Option<Pm>,
    pub peck: Option<Pm>,
    pub dwell: Option<Number>,
    /// How R and the depth were said.
    pub said: [Option<SaidHeight>; 2],
    /// Whether its last hole ended at R.
    pub to_r: bool,
}

/// How a height of a cycle was said: later blocks mean the same only if this has not changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SaidHeight {
    pub incremental: bool,
    /// From the coordinates of the program to the frame.
    pub shift: Pm,
}

/// What stays in force and must be the same wherever a subprogram is called.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Modes {
    pub incremental: Option<bool>,
    pub plane: Plane,
    pub unit: Option<Unit>,
    pub absolute_centres: bool,
    pub feed: Feed,
    pub compensated: bool,
    pub returns_to_r: bool,
    pub has_length: bool,
    pub work: u16,
    pub cycle: Option<Cycle>,
    pub shift: Shift,
}

/// From the coordinates of the program to those of the transform's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shift {
    pub nominal: [Pm; 3],
    /// The same in the program that is written: `G92` sets it where that one stands.
    pub out: [Pm; 3],
    /// False under a work offset whose origin is not known.
    pub known: bool,
}

/// Where the tool is, in the transform's frame: nominal, and as it was written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub nominal: [Option<Pm>; 3],
    pub out: [Option<Pm>; 3],
    /// The last height that was known, for what hardly depends on it.
    pub last: [Pm; 3],
    /// From where a subprogram was called, which may be anywhere: no translation.
    pub relative: bool,
}

impl Place {
    pub const UNKNOWN: Self = Self {
        nominal: [None; 3],
        out: [None; 3],
        last: [0; 3],
        relative: false,
    };

    /// The zero of a subprogram.
    pub const CALLED: Self = Self {
        nominal: [Some(0); 3],
        out: [Some(0); 3],
        last: [0; 3],
        relative: true,
    };

    pub fn forget(&mut self, axis: usize) {
        for places in [&mut self.nominal, &mut self.out] {
            if let Some(slot) = places.get_mut(axis) {
                *slot = None;
            }
        }
    }
}

/// The origin of a work offset: from what it was when the program began, or absolute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Origin {
    pub is_absolute: bool,
    pub pm: Pm,
}

/// A work offset by number: 1 to 6 are G54 to G59, beyond are others.
pub(super) type Origins = [[Origin; 3]; 6];

/// A subprogram of the same file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Subprogram {
    pub number: u32,
    /// The same as the call said it: a P of five digits and more is a number, or a number with
    /// its count before it.
    pub as_said: u32,
    pub modes: Modes,
    /// Whether it was called from where it, or another one, had ended.
    pub repeated: bool,
    /// Whether its text has passed, and whether it came back to where it began.
    pub written: bool,
    pub drifts: bool,
    /// Line and character of its first call.
    pub called_line: u64,
    pub called_column: u16,
}

/// Subprograms of one file, at most.
pub(super) const MAX_SUBPROGRAMS: usize = 16;

pub(super) type Subprograms = Vec<Subprogram, MAX_SUBPROGRAMS>;
