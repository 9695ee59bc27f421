//! What a program has said so far: modes, offsets, places.

use heapless::Vec;
use umi_protocol::job::WorkOffset;

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
    /// Whether R and the depth were said in increments: later blocks mean the same only if this
    /// has not changed.
    pub said: [Option<bool>; 2],
    /// Its axis, and from the coordinates of the program to the frame along it, nominal and in
    /// the program that is written: as it began.
    pub normal: usize,
    pub shifts: [Pm; 2],
    /// Whether its last hole ended at R.
    pub to_r: bool,
    /// Its pecks become smaller, by I and J down to K (Haas): K counts no holes.
    pub narrows: bool,
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
    /// None: neither G98 nor G99 has been said, and controls begin with either.
    pub returns_to_r: Option<bool>,
    pub has_length: bool,
    pub work: u16,
    pub shift: Shift,
}

impl Modes {
    /// Whether cycles return to R, as far as it is said.
    pub fn returns_to_r(&self) -> bool {
        self.returns_to_r.unwrap_or_default()
    }
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
    /// Maybe at a place of the machine, by G53 or a call, and not named since: the part's move is
    /// not in it. A bit for each axis.
    pub at_machine: u8,
}

impl Place {
    pub const UNKNOWN: Self = Self {
        nominal: [None; 3],
        out: [None; 3],
        last: [0; 3],
        relative: false,
        at_machine: 0,
    };

    /// The zero of a subprogram.
    pub const CALLED: Self = Self {
        nominal: [Some(0); 3],
        out: [Some(0); 3],
        last: [0; 3],
        relative: true,
        at_machine: 0,
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

/// A work offset's number here: 1 to 6 are G54 to G59, beyond 1000 are `G54.1 P`.
pub(super) const fn work(offset: WorkOffset) -> u16 {
    match offset {
        WorkOffset::Extended(number) => number.saturating_add(1000),
        standard => standard.p_number(),
    }
}

/// A work offset by number: 1 to 6 are G54 to G59, beyond are others.
pub(super) type Origins = [[Origin; 3]; 6];

/// Modes by their groups, a bit for each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Groups(u16);

impl Groups {
    pub const NONE: Self = Self(0);
    pub const DISTANCE: Self = Self(1);
    pub const PLANE: Self = Self(1 << 1);
    pub const UNIT: Self = Self(1 << 2);
    pub const CENTRES: Self = Self(1 << 3);
    pub const FEED: Self = Self(1 << 4);
    pub const COMPENSATION: Self = Self(1 << 5);
    pub const RETURN: Self = Self(1 << 6);
    pub const WORK: Self = Self(1 << 7);
    pub const CYCLE: Self = Self(1 << 8);
    pub const MOTION: Self = Self(1 << 9);
    pub const ALL: Self = Self((1 << 10) - 1);

    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    pub const fn less(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }
}

/// What the first program of the file begins with: M99 at its end begins it again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Beginning {
    /// The text is still that of the first program.
    pub is_here: bool,
    /// It has ended with M99: others may call it.
    pub returned: bool,
    /// Offsets before the program, and at its first motion: until then they are only set, which
    /// is the same each time, unless G10 steps in G91.
    pub before: u64,
    pub offsets: Option<u64>,
    pub steps: bool,
}

/// A subprogram of the same file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Subprogram {
    pub number: u32,
    /// The same as the call said it: a P of five digits and more is a number, or a number with
    /// its count before it.
    pub as_said: u32,
    pub modes: Modes,
    /// Offsets at its first call, in force or not, as one number; and whether another call, or
    /// its text, met others.
    pub offsets: u64,
    pub elsewise: bool,
    /// Whether the frame of the transform was settled at its first call.
    pub framed: bool,
    /// Whether its text chooses or sets an offset.
    pub shifts: bool,
    /// Whether it is called under G98 and under G99; and whether its text says one of them, or
    /// counts on the caller's: it drills, or calls another.
    pub called_under_both: bool,
    pub has_return: bool,
    /// Whether it leaves a canned cycle in force.
    pub leaves_cycle: bool,
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
