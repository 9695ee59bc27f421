//! What cannot be transformed truly, and what to do about it.

use core::fmt;

/// Why a program is refused, and where.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Line of the original, from 1.
    pub line: u64,
    /// Character of the line, from 1.
    pub column: usize,
    /// What is there.
    pub reason: Reason,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            line,
            column,
            reason,
        } = self;
        write!(f, "line {line}, column {column}: {reason}")
    }
}

impl core::error::Error for Refusal {}

/// What cannot be transformed truly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reason {
    /// A line longer than [`super::MAX_LINE`].
    LineTooLong,
    /// CR alone ends a line, and LF another.
    LineEnds,
    /// A block of more words than are taken.
    TooManyWords,
    /// `(` without `)`.
    UnclosedComment,
    /// Neither a word nor a comment.
    NotAWord,
    /// A number that is too long, or a place too far away.
    OutOfRange,
    /// IF, WHILE, GOTO, O words: which way the program takes is not known.
    Flow,
    /// A system variable is set: offsets or modes may change.
    SystemVariable,
    /// `#` or `[...]` where the value must be known.
    Expression(char),
    /// The same word twice in one block.
    Twice(char),
    /// A word that has no meaning where it stands.
    Meaningless(char),
    /// A G code, in tenths, that is not known.
    UnknownCode(u16),
    /// A G code, in tenths, that is known and cannot be followed.
    Code(u16, Why),
    /// Two codes in one block that each want the axis words.
    TwoMotions,
    /// No G90 or G91 yet.
    NoDistanceMode,
    /// No G20 or G21 yet, and no unit given.
    NoUnit,
    /// Axis words without G0, G1, ... in force.
    NoMotion,
    /// A length without a decimal point, and nobody said what it means.
    NoPoint(char),
    /// The motion depends on where an axis is, and the program has not said it.
    UnknownPlace(char),
    /// A rotary axis away from zero.
    Rotary(char),
    /// U, V, W.
    SecondaryAxis(char),
    /// How this work offset lies to that of the transform is not known.
    WorkOffset,
    /// Cutter compensation, a corner or a cycle in a plane that is tilted.
    Tilted(char),
    /// A canned cycle, in tenths, whose axis is tilted and that cannot be written out.
    TiltedCycle(u16),
    /// A word of a canned cycle is missing.
    CycleLacks(char),
    /// A canned cycle that does not go down, or pecks without end.
    CycleDepth,
    /// An arc that is none: radii differ, R too short, no centre.
    Arc,
    /// More chords than are taken for one arc.
    TooManyChords,
    /// An M code at the end of a motion that becomes several.
    LateCode(char),
    /// An optional block (`/`) that changes what later blocks mean.
    OptionalMode,
    /// An optional block (`/`) that would become several.
    OptionalLines,
    /// Inverse time without an F word.
    NoFeed,
    /// A subprogram that is called in two different modes, or leaves another one.
    SubprogramModes,
    /// More subprograms than are followed.
    TooManySubprograms,
    /// A subprogram that ends elsewhere than it began and is repeated: rounding would
    /// add up.
    SubprogramDrifts,
}

/// Why a known G code is not followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Why {
    /// Coordinates are no longer those of the machine's axes.
    Coordinates,
    /// The motion is not one that is followed.
    Motion,
    /// A macro decides.
    Macro,
    /// It would move through a point of the program.
    Through,
    /// It sets offsets from what only the control knows.
    Offsets,
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LineTooLong => write!(
                f,
                "more than {} characters in a line: break it up",
                super::MAX_LINE
            ),
            Self::LineEnds => f.write_str(
                "one line ends with CR alone and another with LF: a control may read both as one; \
                 end all alike",
            ),
            Self::TooManyWords => f.write_str("too many words in one block: make it two"),
            Self::UnclosedComment => f.write_str("a comment that does not end: close it with `)`"),
            Self::NotAWord => f.write_str("this is neither a word nor a comment"),
            Self::OutOfRange => f.write_str("this number is beyond 100 m or 18 digits"),
            Self::Flow => f.write_str(
                "the program decides here where to go on: write out the way that it takes",
            ),
            Self::SystemVariable => f.write_str(
                "a system variable may change offsets or modes: write it as G10, or leave it out",
            ),
            Self::Expression(letter) => write!(
                f,
                "{letter} has a value that only the control knows: write it as a number"
            ),
            Self::Twice(letter) => write!(f, "{letter} stands twice in this block"),
            Self::Meaningless(letter) => write!(f, "{letter} has no meaning here that is known"),
            Self::UnknownCode(code) => {
                write!(f, "{} is not known: what it moves cannot be told", G(*code))
            }
            Self::Code(code, why) => {
                let why = match why {
                    Why::Coordinates => {
                        "changes the coordinates: write the path without it, or transform there"
                    }
                    Why::Motion => "is a motion that cannot be carried over: write it as G0 to G3",
                    Why::Macro => "calls a macro: what it moves cannot be told",
                    Why::Through => {
                        "goes through a point of the program: move there first, then G91 and zeros"
                    }
                    Why::Offsets => "sets offsets from where the axes are: give them as numbers",
                };
                write!(f, "{} {why}", G(*code))
            }
            Self::TwoMotions => f.write_str("two codes want the axis words: make two blocks"),
            Self::NoDistanceMode => f.write_str("neither G90 nor G91 is in force: say which"),
            Self::NoUnit => f.write_str("neither G20 nor G21 is in force: say which"),
            Self::NoMotion => f.write_str("no G0, G1, G2 or G3 is in force: say which"),
            Self::NoPoint(letter) => write!(
                f,
                "{letter} has no decimal point: whether it counts units or increments must be said"
            ),
            Self::UnknownPlace(axis) => write!(
                f,
                "where {axis} is, the program has not said: name it in a G90 block with G0 first"
            ),
            Self::Rotary(letter) => write!(
                f,
                "{letter} turns the part: the transform holds where it was probed, at {letter}0"
            ),
            Self::SecondaryAxis(letter) => {
                write!(f, "{letter} is a second linear axis: write it as X, Y or Z")
            }
            Self::WorkOffset => f.write_str(
                "how this work offset lies to that of the transform is not known: give both origins",
            ),
            Self::Tilted(what) => write!(
                f,
                "the transform tilts the plane of {what}: no three-axis control does that truly"
            ),
            Self::TiltedCycle(code) => write!(
                f,
                "the transform tilts the axis of {}: write the cycle out",
                G(*code)
            ),
            Self::CycleLacks(letter) => write!(f, "the canned cycle needs {letter}"),
            Self::CycleDepth => f.write_str("the canned cycle does not go down, or pecks for ever"),
            Self::Arc => f.write_str(
                "no arc goes from here to there: its radii differ, or R is too short, or no centre",
            ),
            Self::TooManyChords => {
                f.write_str("too many chords for this arc: allow a larger tolerance")
            }
            Self::LateCode(letter) => write!(
                f,
                "{letter} acts when the motion has ended, and this one becomes several: give it a \
                 block of its own"
            ),
            Self::OptionalMode => f.write_str(
                "an optional block changes what later blocks mean: leave the `/` out, or the block",
            ),
            Self::OptionalLines => f.write_str(
                "an optional block would become several: leave the `/` out, or the block",
            ),
            Self::NoFeed => f.write_str("G93 needs F in every block"),
            Self::SubprogramModes => f.write_str(
                "a subprogram that is called in different modes, or leaves others than it found",
            ),
            Self::TooManySubprograms => f.write_str("too many subprograms in one file"),
            Self::SubprogramDrifts => f.write_str(
                "this subprogram is repeated from where it ended: rounding would add up; give the \
                 place before each call",
            ),
        }
    }
}

/// A G code in tenths, as it is written.
struct G(u16);

impl fmt::Display for G {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "G{}", self.0 / 10)?;
        match self.0 % 10 {
            0 => Ok(()),
            tenth => write!(f, ".{tenth}"),
        }
    }
}
