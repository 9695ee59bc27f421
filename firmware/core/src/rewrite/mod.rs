//! A tool path carried by a transform: every motion of a part program becomes its rigid
//! image, every other byte stays.
//!
//! ```text
//! bytes ─► line ─► words ─► modes, offsets ─► motion ─► R p + t ─► rounded ─► text
//!                  (words)  (follow, state)   (motion,             (length,   (emit)
//!                    │                         arc, cycle)          motion)
//!                    └─► nothing but a straight line (plain) ─► ...
//! ```
//!
//! For controls that cannot turn coordinates in space, and for what a rotation about Z
//! leaves at the part: the program itself says where the part stands (Sawula 2013, 3.3 and
//! 4.2; appendices E and F are a path before and after). The same code runs on a board that
//! feeds a control drop by drop and on the host.
//!
//! # Design
//!
//! * **Frame.** `q = R p + t` holds in the coordinates of one work offset: the one in which
//!   the part was probed ([`RewriteSettings::measured_in`]), with its value before the program;
//!   where nobody says which, the one in force at the first motion (G54 if none was named), with
//!   its value at that time. Both without `G52` and `G92`: that is where a probing program prints
//!   its points. The offset of `G52` and `G92` is followed; under another work offset a rotation
//!   needs to know how the two origins lie ([`RewriteSettings::origins_mm`], or `G10 L2` of both
//!   in the program); a translation does not.
//! * **Lengths are whole picometres** (`length`): nominal sums are exact, in mm and in
//!   inches. An image is computed from the nominal place, never from the image before, and
//!   is rounded to the control's step. A word in `G91` is the difference of the rounded
//!   image and of what was written before, so rounding never adds up: after any number of
//!   blocks the tool is within half a step of the image.
//! * **What appears.** A word that was there stays in its place with its new value, or
//!   byte for byte if its value is the same; an axis that was not named appears behind
//!   the others if its image has moved by more than half a step. All else is copied:
//!   comments, blanks, line numbers, F, S, T, M, H, D, letter case, line ends, leader.
//! * **Tool length.** Coordinates are those of the tool's tip. `G43`, `G44`, `G49` stay;
//!   where Z is after them, the program has to say.
//! * **Machine moves stay** (`G28`, `G30` by `G91` and zeros, `G53`): the axes that they
//!   name are then somewhere that the program does not say. A rapid may follow that names
//!   not all axes (`G0 X0 Y0` below the spindle's home): an axis that was not named stands
//!   still, the others take its last known place. Where the transform is level, that is
//!   exact; else it is off by tilt times height until the program names the axis: refused,
//!   unless [`RewriteSettings::loose_rapids`] allows it, and beyond a slope of 1 in 50 always.
//!   A feed motion must know every place that it depends on, and goes nowhere with an axis that
//!   `G53` has sent: there it would cut beside the part that has moved.
//! * **Arcs** stay arcs if what a control makes of the rounded words stays within
//!   [`RewriteSettings::chord`] of the image, and has the same sweep: end and centre are rounded,
//!   and then judged as the control will. R becomes I and J where it would throw the centre
//!   (near half a turn). Others become chords, each within that tolerance, rounding
//!   included, with the same F (`G93`: F times their number).
//! * **Canned cycles** stay where the transform keeps the direction of the tool. Where it
//!   tilts, drilling, pecking, and boring that feeds out (`G73`, `G81`, `G82`, `G83`, `G85`,
//!   `G89`) are written out in G0 and G1; others are refused, as their spindle work cannot
//!   be. A count with `G91` is written out hole by hole, for the rounding.
//! * **Cutter compensation** stays where the transform keeps the plane's normal; in a
//!   tilted plane a plunge would move in the plane, and turn the compensation. Refused.
//! * **Subprograms** in the same file are followed by their text: called with the same
//!   modes from everywhere, left with the modes and the offsets that they found, also those
//!   not in force. A main program that `M99` begins again leaves what it does not say before
//!   it counts on it. In `G91` subprograms may be
//!   called from anywhere: directions turn. One that ends elsewhere than it began is
//!   refused if it is repeated from there, for the rounding. Inside, the tool is within a
//!   whole step: half of the caller's place, half of the way from there. After a call the
//!   caller names its motion and its place anew.
//! * **Optional blocks** (`/`) may be left out or not: what differs then counts as not
//!   known.
//!   One that is called and is not in the file is refused, unless it is allowed by its number
//!   or name ([`RewriteSettings::allowed_calls`]): what it moves is not carried, and one that
//!   corrects in the control would correct twice.
//! * **Where controls differ** ([`RewriteDialect`]), somebody has to say whose meaning counts: P
//!   on an arc, a canned cycle whose R lies above the tool.
//! * **Refusals** ([`RewriteRefusal`]) name line, column and reason. Nothing of a refused line comes
//!   out, nor anything after it: [`Rewriter::safe_stop`] ends what has been sent. A host
//!   reads the program twice, and the first time only looks ([`Rewriter::go_on`] finds
//!   the next reason).
//! * **Identity** leaves the program byte for byte as it was, without a header.
//! * **One run** ([`RewriteSettings::run`]): the comparison of the measured run with the
//!   control's own stands behind the header, and behind the number of every further program
//!   of the file that none before has called. The identity has it, too, and a header with it.
//!
//! # Tradeoffs
//!
//! Appendix F names X, Y and Z in every block with three decimals; here only what moves,
//! without trailing zeros: fewer characters over a serial line. F dropped line numbers,
//! `G10`, `G28`, `G43`, tool changes and coolant, and set its own feed; here they stay: the
//! program would not run as it was meant without. F took a height that the program had left
//! by `G28` for the one before it; here the axis stands still until it is named.
//!
//! One pass with bounded memory cannot look ahead: a subprogram's modes are believed when it
//! is called and verified where it ends, and expansion needs no labels. In return 1 GB takes
//! the memory of one line.
//!
//! # Limitations
//!
//! * Three linear axes. A rotary axis may stand at zero only: the part turns with it, and
//!   no kinematics is known here. U, V, W, polar and cylindrical coordinates, scaling,
//!   mirroring, splines, threads, probing, and coordinates rotated by the program itself are
//!   refused, as are macros: expressions in words that matter, system variables, jumps.
//! * An arc whose plane the transform turns into another one (more than a few degrees)
//!   becomes chords, also where the other plane is one of the machine's.
//! * Cycles that are written out retract by [`RewriteSettings::clearance`]: a parameter of the
//!   control that a program does not say.
//! * `G43` of a control whose length offset follows the named axis (Fanuc 5001#0, type C)
//!   is not for tilted transforms: X and Y may join its block.
//! * Modes before the program says them: `G17`, `G94`, `G40`. Units, distance mode and
//!   motion must be said, by the program or by [`RewriteSettings::start`].

mod block;
mod follow;
mod header;
mod moved;
mod refusal;
mod settings;
mod state;
#[cfg(test)]
mod tests;
mod text;

use core::fmt::Write as _;

use heapless::Vec;
use nalgebra::{Matrix3, Vector3};

pub use header::Check;
pub use refusal::{RefusedLine, RewriteRefusal, Why};
pub use settings::{
    AllowedCalls, BadSettings, Integers, MeasuredIn, ProgramIdentity, RewriteDialect,
    RewriteSettings, Source, StartModes,
};
pub use text::length::Unit;

use block::Given;
use header::Earlier;
use moved::motion::Extent;
use moved::plan::More;
use settings::checked;
use state::{
    Beginning, Cycle, Groups, Modes, Motion, Origin, Origins, Place, Plane, Shift, Subprograms,
};
use text::emit::{Edit, Out};
use text::length::{PM_PER_MM, Step};
use text::line_ends::LineEnds;
use text::words::{At, Kind, Words};

/// Characters of a line, at most, without its end: four times what controls take.
pub const MAX_LINE: usize = 512;

/// Bytes that come out of one call of [`Rewriter::push_line`], at most: a line with all
/// its words replaced, and before it the header and the comparison of the run.
pub const MAX_AT_ONCE: usize = 2 * MAX_LINE + 128;

/// What was done to a program.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Summary {
    /// Lines read.
    pub lines: u64,
    /// Blocks with words.
    pub blocks: u64,
    /// Rapid motions.
    pub rapids: u64,
    /// Straight feed motions.
    pub feeds: u64,
    /// Arcs that stayed arcs.
    pub arcs: u64,
    /// Arcs that became chords.
    pub chorded: u64,
    /// Their chords.
    pub chords: u64,
    /// Holes of canned cycles that stayed.
    pub holes: u64,
    /// Holes that were written out.
    pub written_out: u64,
    /// Smallest and largest coordinates that the program reaches, nominal, in the frame of
    /// the transform, mm; of arcs the ends.
    pub nominal_mm: Option<[[f64; 3]; 2]>,
    /// The same as it is written.
    pub written_mm: Option<[[f64; 3]; 2]>,
    /// The run that an earlier rewriting has the control compare: it stays, unless
    /// [`RewriteSettings::run`] brings another.
    pub earlier_run: Option<u32>,
}

/// What of it is counted on the way.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    blocks: Count,
    rapids: Count,
    feeds: Count,
    arcs: Count,
    chorded: Count,
    chords: Count,
    holes: Count,
    written_out: Count,
}

/// A counter of what no program has 2⁶⁴ of.
#[derive(Clone, Copy, Debug, Default)]
struct Count(u64);

impl Count {
    fn add(&mut self, count: u32) {
        self.0 = self.0.wrapping_add(u64::from(count));
    }
}

/// What [`Rewriter::push_line`] did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Bytes of the program that it took.
    pub taken: usize,
    /// More comes out of what was taken already: call it again before there is more of
    /// the program, or with what is left.
    pub has_more: bool,
}

/// How an axis depends on another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coupling {
    None,
    Small,
    Large,
}

/// Where it is on the tape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tape {
    /// Nothing yet but what leads in.
    Leader,
    Program,
    /// Behind the closing `%`.
    End,
}

/// Rewrites a program byte by byte.
#[derive(Clone, Debug)]
pub struct Rewriter {
    settings: RewriteSettings,
    rotation: [[f64; 3]; 3],
    translation_pm: [f64; 3],
    coupling: [[Coupling; 3]; 3],
    /// Whether the transform keeps each axis' direction.
    keeps: [bool; 3],
    is_identity: bool,
    is_translation: bool,
    steps: [Step; 2],

    held: Vec<u8, MAX_LINE>,
    too_long: bool,
    line: u64,
    line_ends: LineEnds,
    tape: Tape,
    has_header: bool,
    /// The next block is the first of a program that nobody before it has called.
    begins_anew: bool,
    spaced: bool,
    refusal: Option<RefusedLine>,
    /// Lines that follow the block before, and how that one ended.
    more: More,
    terminator: Option<u8>,

    modes: Modes,
    cycle_in_force: Option<Cycle>,
    motion: Option<Motion>,
    out_motion: Option<Motion>,
    /// What was in force has been forgotten: a call, a subprogram, an optional block.
    lost_motion: bool,
    place: Place,
    origins: Origins,
    frame: Option<(u16, [Origin; 3])>,
    local: [i64; 3],
    here: [i64; 3],
    here_out: [i64; 3],
    /// G92 has taken over a shift of G52.
    took_local: [bool; 3],
    has_begun: bool,
    subprograms: Subprograms,
    current: Option<usize>,
    /// Modes that the text of this program has said, and those that counted before it did.
    said: Groups,
    unsaid: Groups,
    /// The number of the file's first program, until it has ended.
    first: Option<u32>,
    beginning: Beginning,
    /// An offset was chosen or set in this program, and the offsets that the text has met are
    /// not those of its call.
    shifts: bool,
    elsewise: bool,
    /// Lines of an earlier comparison of the run.
    earlier: Earlier,
    counts: Counts,
    nominal_extent: Extent,
    written_extent: Extent,
}

impl Rewriter {
    /// Ready for the first byte.
    ///
    /// # Errors
    /// [`BadSettings`], each with its bounds.
    pub fn new(settings: &RewriteSettings) -> Result<Self, BadSettings> {
        let transform = checked(&settings.transform).ok_or(BadSettings::Transform)?;
        if !(1..=6).contains(&settings.decimals_mm) {
            return Err(BadSettings::Decimals);
        }
        let steps =
            [Unit::Millimetre, Unit::Inch].map(|unit| Step::new(settings.decimals_mm, unit));
        let [millimetres, _] = steps;
        let within = |low: f64, high: f64, value: f64| (low..=high).contains(&value);
        if !within(
            3.0 * millimetres.pm as f64 / PM_PER_MM,
            10.0,
            settings.chord.0,
        ) {
            return Err(BadSettings::Chord);
        }
        if !within(0.0, 100.0, settings.clearance.0) {
            return Err(BadSettings::Clearance);
        }
        let mut origins: Origins = [[Origin::default(); 3]; 6];
        for (origin, given) in origins.iter_mut().zip(settings.origins_mm) {
            for (slot, mm) in origin.iter_mut().zip(given.iter().flatten()) {
                if !within(-10_000.0, 10_000.0, *mm) {
                    return Err(BadSettings::Origin);
                }
                *slot = Origin {
                    is_absolute: true,
                    pm: pm(*mm),
                };
            }
        }
        let r = transform.rotation;
        let rotation = [
            [r.m11, r.m12, r.m13],
            [r.m21, r.m22, r.m23],
            [r.m31, r.m32, r.m33],
        ];
        let is_translation = r == Matrix3::identity();
        let before = offsets(is_translation, &origins, &[[0; 3]; 4]);
        let mut rewriter = Self {
            settings: settings.clone(),
            rotation,
            translation_pm: (transform.translation_mm * PM_PER_MM).into(),
            coupling: rotation.map(|row| {
                row.map(|value| match value.abs() {
                    // A nanometre in a metre.
                    value if value < 1e-9 => Coupling::None,
                    value if value < 0.02 => Coupling::Small,
                    _ => Coupling::Large,
                })
            }),
            keeps: core::array::from_fn(|axis| {
                (0..3).all(|row| {
                    let value = at(&at(&rotation, row), axis);
                    let whole = if row == axis { 1.0 } else { 0.0 };
                    // A tenth of a micrometre in a metre.
                    (value - whole).abs() < 1e-7
                })
            }),
            // The comparison of the run has to stand in one that does not move, too.
            is_identity: is_translation
                && transform.translation_mm == Vector3::zeros()
                && settings.run.is_none(),
            is_translation,
            steps,
            held: Vec::new(),
            too_long: false,
            line: 0,
            line_ends: LineEnds::default(),
            tape: Tape::Leader,
            has_header: false,
            begins_anew: false,
            spaced: true,
            refusal: None,
            more: More::Nothing,
            terminator: None,
            modes: modes(settings),
            cycle_in_force: None,
            motion: settings.start.motion,
            out_motion: settings.start.motion,
            lost_motion: false,
            place: Place::UNKNOWN,
            origins,
            frame: None,
            local: [0; 3],
            here: [0; 3],
            here_out: [0; 3],
            took_local: [false; 3],
            has_begun: false,
            subprograms: Vec::new(),
            current: None,
            said: Groups::default(),
            unsaid: Groups::default(),
            first: None,
            beginning: Beginning {
                is_here: true,
                returned: false,
                before,
                offsets: None,
                steps: false,
            },
            shifts: false,
            elsewise: false,
            earlier: Earlier::default(),
            counts: Counts::default(),
            nominal_extent: Extent::NOTHING,
            written_extent: Extent::NOTHING,
        };
        if let Some(offset) = settings.measured_in {
            rewriter.measured_in(state::work(offset));
        }
        Ok(rewriter)
    }

    /// Takes the next bytes of the program and gives what becomes of them to `sink`, in
    /// pieces. However the program is cut, the same comes out.
    ///
    /// # Errors
    /// What cannot be transformed truly. Nothing of that line comes out; from then on
    /// every call says the same.
    pub fn push(&mut self, bytes: &[u8], sink: &mut impl FnMut(&[u8])) -> Result<(), RefusedLine> {
        if let Some(refusal) = self.refusal {
            return Err(refusal);
        }
        let mut out = Out::new(sink);
        let done = self.take(bytes, false, &mut out);
        out.flush();
        done.map(|_| ())
    }

    /// As [`Self::push`], for a sink with little room: stops when a line has come out, with
    /// [`MAX_AT_ONCE`] bytes at most, and says how far it came. An arc may become thousands
    /// of lines.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn push_line(
        &mut self,
        bytes: &[u8],
        sink: &mut impl FnMut(&[u8]),
    ) -> Result<Progress, RefusedLine> {
        if let Some(refusal) = self.refusal {
            return Err(refusal);
        }
        let mut out = Out::new(sink);
        let done = self.take(bytes, true, &mut out);
        out.flush();
        let left = done?;
        Ok(Progress {
            taken: bytes.len() - left,
            has_more: self.more != More::Nothing,
        })
    }

    /// Ends the program: what was left without an end of line comes out.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn finish(&mut self, sink: &mut impl FnMut(&[u8])) -> Result<Summary, RefusedLine> {
        if let Some(refusal) = self.refusal {
            return Err(refusal);
        }
        let mut out = Out::new(sink);
        let held = core::mem::take(&mut self.held);
        let done = if held.is_empty() && !self.too_long {
            Ok(())
        } else {
            self.line += 1;
            self.one_line(&held, &mut out)
        };
        while self.go_further(&mut out) {}
        out.flush();
        done?;
        match self.missing() {
            None => Ok(self.summary()),
            Some(refusal) => {
                self.refusal = Some(refusal);
                Err(refusal)
            }
        }
    }

    /// The next program that is called and whose text has not come; it is told once.
    fn missing(&mut self) -> Option<RefusedLine> {
        let settings = &self.settings;
        let sub = self.subprograms.iter_mut().find(|sub| {
            !sub.written
                && !settings.allows_number(sub.number)
                && !settings.allows_number(sub.as_said)
        })?;
        sub.written = true;
        Some(RefusedLine {
            line: sub.called_line,
            column: usize::from(sub.called_column) + 1,
            reason: RewriteRefusal::NotHere(sub.number),
        })
    }

    /// What was done so far.
    #[must_use]
    pub fn summary(&self) -> Summary {
        let counts = &self.counts;
        Summary {
            lines: self.line,
            blocks: counts.blocks.0,
            rapids: counts.rapids.0,
            feeds: counts.feeds.0,
            arcs: counts.arcs.0,
            chorded: counts.chorded.0,
            chords: counts.chords.0,
            holes: counts.holes.0,
            written_out: counts.written_out.0,
            nominal_mm: self.nominal_extent.mm(),
            written_mm: self.written_extent.mm(),
            earlier_run: self.earlier.run,
        }
    }

    /// Goes on behind a refused line as if it had been understood, to find the next reason.
    /// What comes out from then on is not a program.
    pub fn go_on(&mut self) {
        self.refusal = None;
        self.held.clear();
        self.too_long = false;
        // Known places and modes, so that one reason does not make a hundred.
        for places in [&mut self.place.nominal, &mut self.place.out] {
            for (slot, last) in places.iter_mut().zip(self.place.last) {
                *slot = slot.or(Some(last));
            }
        }
        self.motion = self.motion.or(Some(Motion::Line));
        self.modes.incremental = self.modes.incremental.or(Some(false));
        self.modes.unit = self.modes.unit.or(Some(Unit::Millimetre));
    }

    /// What ends a program that was refused while it was being sent, so that the machine
    /// stands still: a comment with line and reason, and M0. No closing `%`: what a control
    /// stores is not complete.
    pub fn safe_stop(&self, sink: &mut impl FnMut(&[u8])) {
        let Some(refusal) = self.refusal else { return };
        let mut out = Out::new(sink);
        let eol = self.line_ends.added();
        // `Out` takes everything.
        let _ = write!(out, "(UMI STOPPED AT LINE {})", refusal.line);
        out.put(&eol);
        out.put(b"M0");
        out.put(&eol);
        out.flush();
    }

    /// Takes bytes, of one line only if that is asked for; how many are left.
    fn take<S: FnMut(&[u8])>(
        &mut self,
        mut bytes: &[u8],
        one: bool,
        out: &mut Out<'_, S>,
    ) -> Result<usize, RefusedLine> {
        loop {
            if self.go_further(out) {
                if one {
                    return Ok(bytes.len());
                }
                continue;
            }
            let Some(end) = memchr::memchr2(b'\n', b'\r', bytes) else {
                break;
            };
            let (text, rest) = bytes.split_at_checked(end).unwrap_or_default();
            let Some((&terminator, rest)) = rest.split_first() else {
                break;
            };
            bytes = rest;
            let is_held = !self.held.is_empty() || self.too_long;
            let continues = self
                .line_ends
                .terminator(terminator, is_held || !text.is_empty());
            if !is_held {
                if !continues {
                    self.line += 1;
                }
                if text.len() > MAX_LINE {
                    self.too_long = true;
                }
                self.one_line(text, out)?;
            } else {
                self.hold(text);
                self.line += 1;
                let held = core::mem::take(&mut self.held);
                self.one_line(&held, out)?;
            }
            if self.more == More::Nothing {
                out.put(&[terminator]);
            } else {
                self.terminator = Some(terminator);
            }
            if one {
                return Ok(bytes.len());
            }
        }
        self.hold(bytes);
        if let Some(last) = bytes.last() {
            self.line_ends.rest(*last);
        }
        Ok(0)
    }

    /// Writes the next of the lines that follow a block, or its end; false if there is
    /// nothing.
    fn go_further<S: FnMut(&[u8])>(&mut self, out: &mut Out<'_, S>) -> bool {
        if self.more == More::Nothing {
            return false;
        }
        let mut more = core::mem::replace(&mut self.more, More::Nothing);
        if self.next_line(&mut more, out) {
            self.more = more;
        } else if let Some(terminator) = self.terminator.take() {
            out.put(&[terminator]);
        }
        true
    }

    fn hold(&mut self, bytes: &[u8]) {
        if self.held.extend_from_slice(bytes).is_err() {
            self.too_long = true;
        }
    }

    fn one_line<S: FnMut(&[u8])>(
        &mut self,
        line: &[u8],
        out: &mut Out<'_, S>,
    ) -> Result<(), RefusedLine> {
        let done = if core::mem::take(&mut self.too_long) {
            Err((MAX_LINE, RewriteRefusal::LineTooLong))
        } else if self.is_identity {
            out.put(line);
            Ok(())
        } else if self.tape == Tape::End {
            match text::words::is_block(line) {
                Some(column) => Err((column, RewriteRefusal::BehindEnd)),
                None => {
                    out.put(line);
                    Ok(())
                }
            }
        } else if self.line_ends.are_mixed() {
            Err((0, RewriteRefusal::LineEnds))
        } else if !self.begins_anew && self.plain(line, out) {
            Ok(())
        } else {
            self.understand(line, out)
        };
        done.map_err(|(column, reason)| {
            let refusal = RefusedLine {
                line: self.line,
                column: column + 1,
                reason,
            };
            self.more = More::Nothing;
            self.refusal = Some(refusal);
            refusal
        })
    }

    fn understand<S: FnMut(&[u8])>(&mut self, line: &[u8], out: &mut Out<'_, S>) -> At<()> {
        // It stands before everything, the header too.
        let behind_mark = line.strip_prefix(text::words::BYTE_ORDER_MARK);
        let line = match behind_mark.filter(|_| self.line == 1) {
            Some(rest) => {
                out.put(text::words::BYTE_ORDER_MARK);
                rest
            }
            None => line,
        };
        if !self.has_begun && text::words::is_name(line) {
            self.tape = Tape::Program;
            out.put(line);
            return Ok(());
        }
        if let Some(is_first) = self.earlier.takes(line)? {
            self.begin(out);
            // Measured anew, it belongs to the new run alone.
            match (self.settings.run, is_first) {
                (Some(_), true) => out.put(b"(RUN COMPARED ANEW)"),
                (Some(_), false) => {}
                (None, _) => out.put(line),
            }
            return Ok(());
        }
        let mut words = Words::new();
        let kind = text::words::read(line, &mut words)?;
        if self.settings.dialect != Some(RewriteDialect::LinuxCnc)
            && let Some(at) = text::words::semicolon(line)
            && let Some(first) = text::words::goes_on(
                line.get(at..).unwrap_or_default(),
                self.settings.dialect == Some(RewriteDialect::Fanuc),
            )
        {
            return Err((at + first, RewriteRefusal::Semicolon));
        }
        if let Some(column) = header::mark(line)
            && !self.settings.again
        {
            return Err((column, RewriteRefusal::Rewritten));
        }
        if let Some(spaced) = text::emit::is_spaced(&words) {
            self.spaced = spaced;
        }
        match kind {
            Kind::Nothing => {
                out.put(line);
            }
            Kind::Percent => {
                // A title may follow the first; nothing is read behind the second.
                self.tape = match self.tape {
                    Tape::Leader => Tape::Program,
                    Tape::Program | Tape::End => Tape::End,
                };
                out.put(line);
            }
            Kind::Macro => {
                self.begin(out);
                out.put(line);
            }
            Kind::Call { start, end } => {
                let name = line.get(start..end).unwrap_or_default();
                self.call_by_name(name, start.saturating_sub(1))?;
                self.begin(out);
                out.put(line);
            }
            Kind::Words { optional } => {
                let o_word = words.iter().find(|word| word.letter == b'O');
                let is_name =
                    o_word.is_some() && words.iter().all(|word| matches!(word.letter, b'O' | b'N'));
                if let Some(o_word) = o_word
                    && !is_name
                    && self.settings.run.is_some()
                {
                    return Err((o_word.start, RewriteRefusal::NumberShares));
                }
                if !is_name || self.has_begun {
                    self.counts.blocks.add(1);
                    let mut edit = Edit::default();
                    self.block(&words, optional, &mut edit)?;
                    self.begin(out);
                    text::emit::block(line, &words, &edit, self.spaced, out);
                    self.begins_anew = is_name && self.is_uncalled();
                } else {
                    self.tape = Tape::Program;
                    self.first = Given::new(&words)?.whole(b'O')?;
                    out.put(line);
                }
            }
        }
        Ok(())
    }

    /// Puts the header before the first block that says more than a name, and the comparison
    /// of the run before the first one of each program that nobody before it has called.
    fn begin<S: FnMut(&[u8])>(&mut self, out: &mut Out<'_, S>) {
        self.tape = Tape::Program;
        self.has_begun = true;
        let begins_anew = core::mem::take(&mut self.begins_anew) || !self.has_header;
        if !self.has_header {
            self.has_header = true;
            header::write(&self.settings, &self.line_ends.added(), out);
        }
        if let Some(check) = self.settings.run.filter(|_| begins_anew) {
            header::compare(check, &self.line_ends.added(), out);
        }
    }

    /// Whether the text is that of a program that nobody before it has called: it may be the
    /// one that the control begins with.
    fn is_uncalled(&self) -> bool {
        let current = self.current.and_then(|index| self.subprograms.get(index));
        current.is_some_and(|sub| sub.called_line == 0)
    }

    /// What becomes of a block.
    fn block(&mut self, words: &Words, optional: bool, edit: &mut Edit) -> At<()> {
        if !optional {
            return self.follow(words, edit);
        }
        let (modes, motion, out_motion, place) =
            (self.modes, self.motion, self.out_motion, self.place);
        let current = self.current;
        let (offsets, said, cycle) = (self.offsets(), self.said, self.cycle_in_force);
        // It may go on behind `/M99`: how it leaves the modes, the last M99 says.
        let first = self.first.take();
        self.follow(words, edit)?;
        self.first = first;
        self.said = said;
        let is_other = modes != self.modes || cycle != self.cycle_in_force;
        if is_other || current != self.current || offsets != self.offsets() {
            return Err((0, RewriteRefusal::OptionalMode));
        }
        if self.more != More::Nothing {
            return Err((0, RewriteRefusal::OptionalLines));
        }
        if (motion, out_motion) != (self.motion, self.out_motion) {
            self.lose_motion();
        }
        for axis in 0..3 {
            if at(&place.nominal, axis) != at(&self.place.nominal, axis)
                || at(&place.out, axis) != at(&self.place.out, axis)
            {
                self.place.forget(axis);
            }
        }
        self.place.at_machine |= place.at_machine;
        Ok(())
    }

    /// Offsets as they stand, in force or not.
    fn offsets(&self) -> u64 {
        let taken = self.took_local.map(i64::from);
        let shifts = [self.local, self.here, self.here_out, taken];
        offsets(self.is_translation, &self.origins, &shifts)
    }

    /// The step of the unit in force.
    fn step(&self) -> Step {
        let [millimetres, inches] = self.steps;
        match self.modes.unit {
            Some(Unit::Inch) => inches,
            _ => millimetres,
        }
    }
}

/// Offsets as one number, to see whether they have changed. Where a work offset lies does not
/// matter to a translation.
fn offsets(is_translation: bool, origins: &Origins, shifts: &[[i64; 3]; 4]) -> u64 {
    let origins = origins.iter().flatten().filter(|_| !is_translation);
    let words = origins.flat_map(|origin| [i64::from(origin.is_absolute), origin.pm]);
    words
        .chain(shifts.iter().flatten().copied())
        .fold(0, |sum: u64, word| {
            (sum.rotate_left(5) ^ word as u64).wrapping_mul(0x517c_c1b7_2722_0a95)
        })
}

/// Modes before the program says any.
fn modes(settings: &RewriteSettings) -> Modes {
    let start = &settings.start;
    Modes {
        incremental: start.incremental,
        plane: match start.normal {
            Some(0) => Plane::YZ,
            Some(1) => Plane::ZX,
            _ => Plane::XY,
        },
        unit: start.unit.or(settings.unit),
        absolute_centres: start.absolute_centres.unwrap_or_default(),
        feed: start.feed.unwrap_or(state::Feed::PerMinute),
        compensated: false,
        returns_to_r: start.returns_to_r,
        has_length: false,
        work: start.work.unwrap_or(1),
        shift: Shift {
            nominal: [0; 3],
            out: [0; 3],
            known: true,
        },
    }
}

/// An item of three.
#[inline]
fn at<T: Copy>(of: &[T; 3], axis: usize) -> T {
    // By reference: not all three are copied for one.
    let [x, y, z] = of;
    *match axis {
        0 => x,
        1 => y,
        _ => z,
    }
}

/// Millimetres, bounded, as picometres.
#[allow(clippy::cast_possible_truncation, reason = "callers bound it")]
fn pm(mm: f64) -> i64 {
    libm::round(mm * PM_PER_MM) as i64
}
