//! What cannot be transformed truly, and what to do about it.

use core::fmt;

use thiserror::Error;

/// Why a program is refused, and where.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("line {line}, column {column}: {reason}")]
pub struct RefusedLine {
    /// Line of the original, from 1.
    pub line: u64,
    /// Character of the line, from 1.
    pub column: usize,
    /// What is there.
    pub reason: RewriteRefusal,
}

/// What cannot be transformed truly.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RewriteRefusal {
    /// A line longer than [`super::MAX_LINE`].
    #[error("more than {} characters in a line: break it up", super::MAX_LINE)]
    LineTooLong,
    /// CR alone ends a line, and LF another.
    #[error(
        "one line ends with CR alone and another with LF: a control may read both as one; end all alike"
    )]
    LineEnds,
    /// A block of more words than are taken.
    #[error("too many words in one block: make it two")]
    TooManyWords,
    /// `(` without `)`.
    #[error("a comment that does not end: close it with `)`")]
    UnclosedComment,
    /// Neither a word nor a comment.
    #[error("this is neither a word nor a comment")]
    NotAWord,
    /// A number that is too long, or a place too far away.
    #[error("this number is beyond 100 m or 18 digits")]
    OutOfRange,
    /// IF, WHILE, GOTO, O words: which way the program takes is not known.
    #[error("the program decides here where to go on: write out the way that it takes")]
    Flow,
    /// A system variable is set: offsets or modes may change.
    #[error("a system variable may change offsets or modes: write it as G10, or leave it out")]
    SystemVariable,
    /// `#` or `[...]` where the value must be known.
    #[error("{0} has a value that only the control knows: write it as a number")]
    Expression(char),
    /// The same word twice in one block.
    #[error("{0} stands twice in this block")]
    Twice(char),
    /// A word that has no meaning where it stands.
    #[error("{0} has no meaning here that is known")]
    Meaningless(char),
    /// A G word whose number is no code.
    #[error("this is no G code: is a letter missing between two numbers, or a blank in one?")]
    NoCode,
    /// A G code, in tenths, that is not known.
    #[error("{} is not known: what it moves cannot be told", G(*.0))]
    UnknownCode(u16),
    /// A G code, in tenths, that is known and cannot be followed.
    #[error("{code} {why}", code = G(*.0), why = .1)]
    Code(u16, Why),
    /// Two codes in one block that each want the axis words.
    #[error("two codes want the axis words: make two blocks")]
    TwoMotions,
    /// Two codes of one modal group, of which only one can be in force.
    #[error(
        "{code} and another code of its group in one block: controls differ in which of them counts for which word; make two blocks",
        code = G(*.0)
    )]
    TwoOfGroup(u16),
    /// G90, G91, G20 or G21 behind a word that they may count for.
    #[error(
        "{code} behind {letter}: controls differ in whether it counts for that; write it in front",
        code = G(*.0), letter = .1
    )]
    ModeBehind(u16, char),
    /// No G90 or G91 yet.
    #[error("neither G90 nor G91 is in force: say which")]
    NoDistanceMode,
    /// A cycle is written out, and neither G98 nor G99 has been said.
    #[error(
        "neither G98 nor G99 is in force: Fanuc begins with G98, LinuxCNC with what was left or G99, and the hole ends elsewhere; say which, or that this is no program of LinuxCNC's"
    )]
    NoReturn,
    /// No G20 or G21 yet, and no unit given.
    #[error("neither G20 nor G21 is in force: say which")]
    NoUnit,
    /// Axis words without G0, G1, ... in force.
    #[error("no G0, G1, G2 or G3 is in force: say which")]
    NoMotion,
    /// The same behind a call, in a subprogram, or behind an optional block.
    #[error(
        "which of G0 to G3 is in force is not known behind a call, in a subprogram or behind an optional block: write it into this block"
    )]
    NoMotionHere,
    /// A length without a decimal point, and nobody said what it means.
    #[error("{0} has no decimal point: whether it counts units or increments must be said")]
    NoPoint(char),
    /// The motion depends on where an axis is, and the program has not said it.
    #[error(
        "where {0} is, the program has not said here: behind what has moved it (its begin, M6, G28, G53, G43, a call, `/`), name X, Y and Z in one G90 block with G0"
    )]
    UnknownPlace(char),
    /// A rapid in a part that leans, and where one axis is, the program has not said.
    #[error(
        "where {0} is, the program has not said here, and the part leans: this rapid would end beside its place by the lean times the height; name X, Y and Z in one G90 block with G0, or allow it"
    )]
    RapidOver(char),
    /// A rotary axis away from zero.
    #[error("{0} turns the part: the transform holds where it was probed, at {0}0")]
    Rotary(char),
    /// U, V, W.
    #[error("{0} is a second linear axis: write it as X, Y or Z")]
    SecondaryAxis(char),
    /// G10 in G91 adds, or does not.
    #[error(
        "G10 in G91 adds to an offset for Fanuc and sets it for LinuxCNC: write it in G90, or say whose program this is"
    )]
    OffsetStep,
    /// G10 sets something else than G54 to G59; G54.1 or G154 does not say which.
    #[error(
        "which offset this is, is not followed: of G54.1 and G154 say P; of G10, L2 with P1 to P6 (G54 to G59), or set the offset by hand and leave the block out"
    )]
    OffsetNumber,
    /// P may be the number of a work offset, or of the word beside it.
    #[error(
        "P may say which additional work offset G54 is, or belong to the word beside it: write them in two blocks"
    )]
    TwoTakeP,
    /// How this work offset lies to that of the transform is not known.
    #[error(
        "how this work offset lies to the one that was probed (of a transform: to that of the first motion) is not known: let the program run in that one, or give the origins of both, of G54 to G59"
    )]
    WorkOffset,
    /// Cutter compensation, a corner or a cycle in a plane that is tilted.
    #[error("the transform tilts the plane of {0}: no three-axis control does that truly")]
    Tilted(char),
    /// A canned cycle, in tenths, whose axis is tilted and that cannot be written out.
    #[error("the transform tilts the axis of {}: write the cycle out", G(*.0))]
    TiltedCycle(u16),
    /// A word of a canned cycle is missing.
    #[error("the canned cycle needs {0}")]
    CycleLacks(char),
    /// A canned cycle that does not go down, or pecks without end.
    #[error("the canned cycle does not go down, or pecks for ever")]
    CycleDepth,
    /// An arc that is none: radii differ, R too short, no centre.
    #[error("no arc goes from here to there: its radii differ, or R is too short, or no centre")]
    Arc,
    /// More chords than are taken for one arc.
    #[error("too many chords for this arc: allow a larger tolerance")]
    TooManyChords,
    /// An M code at the end of a motion that becomes several.
    #[error(
        "{0} acts when the motion has ended, and this one becomes several: give it a block of its own"
    )]
    LateCode(char),
    /// An optional block (`/`) that changes what later blocks mean.
    #[error("an optional block changes what later blocks mean: leave the `/` out, or the block")]
    OptionalMode,
    /// An optional block (`/`) that would become several.
    #[error("an optional block would become several: leave the `/` out, or the block")]
    OptionalLines,
    /// Inverse time without an F word.
    #[error("G93 needs F in every block")]
    NoFeed,
    /// A subprogram that is called in two different modes or offsets, or leaves others; or a main
    /// program that M99 begins again in others than the first time.
    #[error(
        "a program that is called or begun again in different modes or offsets, or leaves others than it found: say them at its begin, and leave them as they were"
    )]
    SubprogramModes,
    /// A program is called whose text is not in the file.
    #[error(
        "calls O{0}, which is not in the file: what it moves would not be carried, and if it corrects, the part is corrected twice; leave the call out, or bring O{0}"
    )]
    NotHere(u32),
    /// M98 or G65 without the number of a program.
    #[error(
        "calls no program: the number of one is missing, as P9010; add it, or leave the call out"
    )]
    CallsNothing,
    /// A call that begins at a block number, or calls a part of the program that it stands in.
    #[error(
        "{0} here calls from a block number on: which blocks run cannot be told; give what is called a program of its own, called by P alone"
    )]
    CallsFrom(char),
    /// A program is called on another device.
    #[error(
        "calls O{0} of another device: what it moves would not be carried, and if it corrects, the part is corrected twice; leave the call out"
    )]
    Elsewhere(u32),
    /// A subprogram is called by an O word and a name.
    #[error(
        "calls a subprogram by an O word, which is not followed: what it moves would not be carried, and if it corrects, the part is corrected twice; write its motions here, or leave the call out"
    )]
    NamedCall,
    /// The same by a number.
    #[error(
        "calls O{0} by an O word, which is not followed: what it moves would not be carried, and if it corrects, the part is corrected twice; write it as M98 P{0}, with O{0} and M99 behind the main program, or leave the call out"
    )]
    NumberedCall(u32),
    /// `,A` and its like.
    #[error(
        ",{0} is not known: of words behind a comma only ,R and ,C turn with the part; write out where the motion ends"
    )]
    Comma(char),
    /// Words behind a semicolon.
    #[error(
        "words behind `;` are a comment for LinuxCNC and GRBL, and a further block for others: put them into ( ), or into a line of their own, or say that this is LinuxCNC's"
    )]
    Semicolon,
    /// Words behind the closing `%`.
    #[error(
        "words behind the closing `%`: some controls go on there, and these would not be carried; make it a file of its own, or leave out the `%` between"
    )]
    BehindEnd,
    /// M72, M73 of LinuxCNC.
    #[error(
        "M{0} gives back the modes that LinuxCNC has kept: which they are cannot be told; write them as G codes, or say that this is no program of LinuxCNC's"
    )]
    Restores(u8),
    /// G52 while G92 is in force, or the other way round.
    #[error(
        "G52 and G92 are one shift for LinuxCNC and two for others: say whose program this is, or use one of them"
    )]
    TwoShifts,
    /// G52 behind a G92 that has taken over its shift.
    #[error(
        "G52 of an axis whose shift a G92 has taken over: it has ended for Fanuc, and a Haas still has it; write G52 with zero before that G92"
    )]
    ShiftTaken,
    /// The program has been rewritten before.
    #[error("this program has been rewritten before and would be moved twice: take the original")]
    Rewritten,
    /// The program's number stands with other words in a block.
    #[error(
        "the program's number shares its block: the comparison of the run has to stand behind it, so give the number a block of its own"
    )]
    NumberShares,
    /// P on an arc: turns for one control, nothing for another.
    #[error(
        "P on an arc counts turns for LinuxCNC and pitches for Mitsubishi, and has no meaning for Fanuc and Haas: write each turn as an arc of its own, or say that this is LinuxCNC's"
    )]
    Turns,
    /// P on an arc of LinuxCNC that counts no turns, or too many.
    #[error(
        "P on an arc counts its turns, 1 to {}: leave P out for less than a turn more, write more turns as arcs behind each other",
        super::moved::curve::MAX_TURNS
    )]
    TurnsOutOfRange,
    /// A canned cycle begins below its R.
    #[error(
        "the canned cycle begins below its R: LinuxCNC rises before it moves across, others after; say whose program this is, or go to R first"
    )]
    BelowR,
    /// G89 under G98, to be written out.
    #[error(
        "LinuxCNC feeds out of G89 under G98 up to where it began, others to R: say whose program this is, or drill under G99"
    )]
    FeedsOut,
    /// A canned cycle goes on under another offset, or in another plane, than it began.
    #[error(
        "this cycle began under another offset or in another plane: whether its heights go with it, controls see differently; end it with G80 before that, and begin it anew"
    )]
    HeightsMoved,
    /// A canned cycle goes on, and its R or depth was said in the other distance mode.
    #[error(
        "R and depth of this cycle were said in the other of G90 and G91: LinuxCNC counts them anew, others keep the places; say both in this block, or say that this is no program of LinuxCNC's"
    )]
    HeightsSaidElsewise,
    /// More subprograms than are followed.
    #[error("too many subprograms in one file")]
    TooManySubprograms,
    /// A subprogram that ends elsewhere than it began and is repeated: rounding would
    /// add up.
    #[error(
        "this subprogram is repeated from where it ended: rounding would add up; call it once at a time, with X, Y and Z named before each call"
    )]
    SubprogramDrifts,
}

/// Why a known G code is not followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum Why {
    /// Coordinates are no longer those of the machine's axes.
    #[error("changes the coordinates: write the path without it, or transform there")]
    Coordinates,
    /// The motion is not one that is followed.
    #[error("is a motion that cannot be carried over: write it as G0 to G3")]
    Motion,
    /// A macro decides.
    #[error(
        "calls a macro behind every motion: what it moves cannot be told; call it by G65 where it is wanted"
    )]
    Macro,
    /// It would move through a point of the program.
    #[error("goes through a point of the program: move there first, then G91 and zeros")]
    Through,
    /// It sets offsets from what only the control knows.
    #[error("sets offsets from where the axes are: give them as numbers")]
    Offsets,
    /// It moves on one control and shifts the datum on another.
    #[error(
        "with axes shifts the datum of a Sinumerik: add G0 or G1, or say whose program this is"
    )]
    Datum,
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
