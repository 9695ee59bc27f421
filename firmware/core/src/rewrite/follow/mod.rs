//! Following a program: modes, offsets, subprograms, and where the axes are.

mod offsets;
mod programs;

use crate::rewrite::block::{Code, Given, Letters, Taker, code, tenths};
use crate::rewrite::moved::plan::{More, Wanted};
use crate::rewrite::refusal::{RewriteRefusal, Why};
use crate::rewrite::state::{Feed, Groups, Motion, Plane};
use crate::rewrite::text::emit::Edit;
use crate::rewrite::text::length::{LIMIT_PM, Pm, Unit, length, power};
use crate::rewrite::text::words::{At, Number, Value, Word, Words};
use crate::rewrite::{Integers, RewriteDialect, Rewriter, at};

const SECONDARY: Letters = Letters::of(b"UVW");
const ROTARY: Letters = Letters::of(b"ABC");
/// What stands for a length, or an angle that may be an increment.
const LENGTHS: Letters = Letters::of(b"XYZIJKRQUVWABC");

impl Rewriter {
    /// Carries out a block: its modes, its offsets, its motion.
    pub(in crate::rewrite) fn follow(&mut self, words: &Words, edit: &mut Edit) -> At<()> {
        let given = Given::new(words)?;
        if let Some(o) = given.find(b'O') {
            let number = given.whole(b'O')?.unwrap_or_default();
            self.begin_program(number, given.column(o))?;
        }
        let wanted = self.g_words(words, &given)?;
        let has_axes = given.letters.has_any(Letters::AXES);
        if given.letters.has_any(SECONDARY)
            && !matches!(
                wanted.taker,
                Some((_, Taker::Nothing | Taker::Dwell | Taker::Data | Taker::Call))
            )
        {
            for letter in *b"UVW" {
                if let Some(word) = given.find(letter) {
                    return Err((
                        given.column(word),
                        RewriteRefusal::SecondaryAxis(letter as char),
                    ));
                }
            }
        }
        if let Some((word, code)) = wanted.lookahead
            && (has_axes || given.letters.has_any(Letters::CENTRES))
        {
            return Err((given.column(word), RewriteRefusal::Code(code, Why::Motion)));
        }
        if wanted.length || (given.has(b'H') && self.modes.has_length) {
            self.place.forget(2);
        }
        if let Some((motion, _)) = wanted.motion.map(|(word, motion)| (motion, word)) {
            self.motion = Some(motion);
            self.cycle_in_force = None;
        }
        if let Some((word, taker)) = wanted.taker {
            if wanted.cycle.is_some() {
                return Err((given.column(word), RewriteRefusal::TwoMotions));
            }
            // The control is in the mode that the block says, too.
            if wanted.motion.is_some() {
                self.out_motion = self.motion;
            }
            if taker == Taker::Dwell {
                dwells(&given, &wanted)?;
            }
            self.counts_on(match taker {
                Taker::Nothing | Taker::Dwell | Taker::Machine => Groups::NONE,
                Taker::Reference(_) => Groups::DISTANCE,
                Taker::Data | Taker::Local | Taker::Preset => Groups::DISTANCE.with(Groups::UNIT),
                Taker::Call | Taker::Here => Groups::ALL,
            });
            self.taken(taker, word, &given)?;
        } else {
            self.rotary(&given)?;
            // In a cycle K counts holes, and alone it drills none.
            let is_arc = matches!(self.motion, Some(Motion::Clockwise | Motion::Counter))
                && self.cycle_in_force.is_none()
                && given.letters.has_any(Letters::CENTRES.with(b'R'));
            if let Some((word, _)) = wanted.cycle.filter(|_| !has_axes) {
                // One control drills where it stands, another does not.
                let letter = self.modes.plane.letter();
                return Err((given.column(word), RewriteRefusal::CycleLacks(letter)));
            }
            if has_axes || is_arc {
                let mut groups = Groups::ALL;
                let is_cycle = wanted.cycle.is_some() || self.cycle_in_force.is_some();
                let is_straight = matches!(self.motion, Some(Motion::Rapid | Motion::Line));
                if !is_cycle {
                    groups = groups.less(Groups::RETURN);
                    if is_straight && !self.modes.compensated && given.corner.is_none() {
                        groups = groups.less(Groups::PLANE.with(Groups::CENTRES));
                    }
                }
                self.counts_on(groups);
                self.begins_moving();
                self.move_block(&given, &wanted, edit)?;
                if let Some(corner) = given.corner
                    && self.more != More::Nothing
                {
                    return Err((given.column(corner), RewriteRefusal::LateCode(',')));
                }
            } else {
                if let Some((_, motion)) = wanted.motion {
                    self.out_motion = Some(motion);
                }
                self.stray(&given, &wanted)?;
            }
        }
        if given.has(b'M') {
            self.m_words(words, &given)?;
        }
        // Which offsets it has when it is called is not known any more, or where a hole ends.
        if let Some(index) = self.current {
            let both = self.subprograms.get(index);
            let both = both.is_some_and(|sub| sub.called_under_both);
            if (self.elsewise && self.shifts) || (both && self.has_return()) {
                return Err((0, RewriteRefusal::SubprogramModes));
            }
        }
        Ok(())
    }

    /// Whether G98 or G99 counts in this program: it says one, drills, or calls another.
    fn has_return(&self) -> bool {
        self.said.has(Groups::RETURN) || self.unsaid.has(Groups::RETURN)
    }

    /// Modes count that this program may not have said.
    const fn counts_on(&mut self, groups: Groups) {
        self.unsaid = self.unsaid.with(groups.less(self.said));
    }

    /// The offsets of the first program count from now on.
    fn begins_moving(&mut self) {
        if self.beginning.is_here && self.beginning.offsets.is_none() {
            self.beginning.offsets = Some(self.offsets());
        }
    }

    /// Letters that a block without a motion must not have: behind a motion code, and where
    /// one control takes them into the cycle in force, another drills, another gives an alarm.
    fn stray(&self, given: &Given<'_>, wanted: &Wanted) -> At<()> {
        let letters: &[u8] = match (self.cycle_in_force, wanted.motion) {
            (Some(_), _) => b"IJKLPQR",
            (None, Some(_)) => b"IJKR",
            // Alone it calls a subprogram (Sinumerik).
            // I, J, K say a pole (Heidenhain).
            (None, None) if !given.has(b'G') && !given.has(b'M') => b"IJKLPR",
            (None, None) => b"",
        };
        let is_of_others =
            |letter: u8| matches!(letter, b'L' | b'P') && (wanted.extended || given.has(b'M'));
        for letter in letters.iter().filter(|letter| !is_of_others(**letter)) {
            if let Some(index) = given.find(*letter) {
                return Err((
                    given.column(index),
                    RewriteRefusal::Meaningless(*letter as char),
                ));
            }
        }
        Ok(())
    }

    fn g_words(&mut self, words: &Words, given: &Given<'_>) -> At<Wanted> {
        let mut wanted = Wanted::default();
        let mut work = None;
        let (mut said_here, mut length) = (Groups::NONE, None);
        for (index, word) in words.iter().enumerate() {
            if word.letter != b'G' {
                length = length.or(Some(word.letter).filter(|letter| LENGTHS.has(*letter)));
                continue;
            }
            let Value::Number(number) = word.value else {
                return Err((word.start, RewriteRefusal::Expression('G')));
            };
            let Some(tenths) = tenths(number) else {
                return Err((word.start, RewriteRefusal::NoCode));
            };
            let refuse = |reason| Err((word.start, reason));
            let code = code(tenths);
            let groups = says(code);
            self.said = self.said.with(groups);
            // Of two motions more is said below; `G0 G80` ends a cycle and moves.
            let alone = match code {
                Code::Motion(_) => Groups::NONE,
                _ => groups,
            };
            if said_here.has(alone) {
                return refuse(RewriteRefusal::TwoOfGroup(tenths));
            }
            said_here = said_here.with(alone);
            if let Some(letter) = length
                && groups.has(Groups::DISTANCE.with(Groups::UNIT))
            {
                return refuse(RewriteRefusal::ModeBehind(tenths, letter as char));
            }
            match code {
                Code::Nothing => {
                    match tenths {
                        50 | 51 => wanted.lookahead = Some((index, tenths)),
                        // Of a lathe: sets coordinates.
                        500 if given.letters.has_any(Letters::AXES) => {
                            return refuse(RewriteRefusal::Code(500, Why::Offsets));
                        }
                        // Of a Heidenhain: a motion, by R and H.
                        110 if given.letters.has_any(Letters::of(b"RH")) => {
                            return refuse(RewriteRefusal::Code(110, Why::Motion));
                        }
                        // Of an Okuma: a work offset.
                        150 if given.has(b'H') => {
                            return refuse(RewriteRefusal::Code(150, Why::Coordinates));
                        }
                        _ => {}
                    }
                }
                Code::Motion(motion) => {
                    if wanted.motion.is_some() || wanted.cycle.is_some() {
                        return refuse(RewriteRefusal::TwoMotions);
                    }
                    wanted.motion = Some((index, motion));
                }
                Code::Cycle => {
                    // `G0 G81` is understood by controls as the later one.
                    if wanted.motion.is_some() || wanted.cycle.is_some() {
                        return refuse(RewriteRefusal::TwoMotions);
                    }
                    // LinuxCNC cuts a thread by it, whose R is no height.
                    let is_thread = match self.settings.dialect {
                        Some(dialect) => dialect == RewriteDialect::LinuxCnc,
                        None => b"IJK".iter().all(|letter| given.has(*letter)),
                    };
                    if tenths == 760 && is_thread {
                        return refuse(RewriteRefusal::Code(760, Why::Motion));
                    }
                    wanted.cycle = Some((index, tenths));
                }
                Code::EndOfCycle => self.cycle_in_force = None,
                Code::Takes(taker) => {
                    if wanted.taker.is_some() {
                        return refuse(RewriteRefusal::TwoMotions);
                    }
                    wanted.taker = Some((index, taker));
                }
                Code::Plane(normal) => {
                    self.modes.plane = match normal {
                        0 => Plane::YZ,
                        1 => Plane::ZX,
                        _ => Plane::XY,
                    };
                }
                Code::Inch => self.modes.unit = Some(Unit::Inch),
                Code::Millimetre => self.modes.unit = Some(Unit::Millimetre),
                Code::Absolute => self.modes.incremental = Some(false),
                Code::Incremental => self.modes.incremental = Some(true),
                Code::AbsoluteCentres => self.modes.absolute_centres = true,
                Code::IncrementalCentres => self.modes.absolute_centres = false,
                Code::InverseTime => self.modes.feed = Feed::InverseTime,
                Code::PerMinute => self.modes.feed = Feed::PerMinute,
                Code::PerRevolution => self.modes.feed = Feed::PerRevolution,
                Code::Compensated => self.modes.compensated = true,
                Code::NotCompensated => self.modes.compensated = false,
                Code::Length => {
                    self.modes.has_length = true;
                    wanted.length = true;
                }
                Code::NoLength => {
                    wanted.length |= self.modes.has_length;
                    self.modes.has_length = false;
                }
                Code::Work(number) => work = Some(number),
                // A control alarms, or takes a number that only it knows.
                Code::ExtendedWork if !given.has(b'P') => {
                    return refuse(RewriteRefusal::OffsetNumber);
                }
                Code::ExtendedWork => wanted.extended = true,
                Code::EndOfShift if given.letters.has_any(Letters::AXES) => {
                    if wanted.taker.is_some() {
                        return refuse(RewriteRefusal::TwoMotions);
                    }
                    wanted.taker = Some((index, Taker::Preset));
                }
                Code::EndOfShift => {
                    (self.here, self.here_out) = ([0; 3], [0; 3]);
                    self.took_local = [false; 3];
                    // Without axes it is LinuxCNC's, whose G52 is the same shift.
                    self.local = [0; 3];
                    self.shift();
                }
                Code::ToR => self.modes.returns_to_r = Some(true),
                Code::ToInitial => self.modes.returns_to_r = Some(false),
                Code::MacroCall => {
                    if wanted.taker.is_some() {
                        return refuse(RewriteRefusal::TwoMotions);
                    }
                    // Its words are what the macro is given.
                    wanted.taker = Some((index, Taker::Call));
                }
                Code::Refused(why) => return refuse(RewriteRefusal::Code(tenths, why)),
                Code::Unknown => return refuse(RewriteRefusal::UnknownCode(tenths)),
            }
        }
        // `G54 P1` is the first of the additional ones where there are any.
        if wanted.extended || (work == Some(1) && given.has(b'P')) {
            let is_taken = self.others_take_p(words, &wanted);
            let has_more = self.settings.dialect != Some(RewriteDialect::LinuxCnc);
            let is_offset =
                wanted.extended || !is_taken || (has_more && may_be_offset(given.number(b'P')?));
            if is_offset && is_taken {
                let column = given.find(b'P').map_or(0, |index| given.column(index));
                return Err((column, RewriteRefusal::TwoTakeP));
            }
            if is_offset {
                let p = given.whole(b'P')?;
                wanted.extended = true;
                work = p.map(|p| 1000 + u16::try_from(p).unwrap_or(u16::MAX - 1000));
            }
        }
        // For a Sinumerik these shift the datum by their axis words, and move nothing.
        if let Some(number @ (5 | 6)) = work
            && self.settings.dialect.is_none()
            && wanted.motion.is_none()
            && given.letters.has_any(Letters::AXES)
        {
            let code = 530 + 10 * number;
            let column = words
                .iter()
                .find(|word| word.letter == b'G')
                .map_or(0, |word| word.start);
            return Err((column, RewriteRefusal::Code(code, Why::Datum)));
        }
        if let Some(work) = work {
            self.modes.work = work;
            self.shift();
        }
        self.compensation(words, given)?;
        Ok(wanted)
    }

    /// Whether P belongs to a word of the block beside its work offset: a dwell, a call, a hole.
    fn others_take_p(&self, words: &Words, wanted: &Wanted) -> bool {
        let calls = |word: &Word| {
            let is_call = |m: Number| matches!(m.digits / power(m.decimals), 97 | 98 | 99 | 198);
            word.letter == b'M' && matches!(word.value, Value::Number(m) if is_call(m))
        };
        let takes = |taker| {
            matches!(
                taker,
                Taker::Dwell | Taker::Call | Taker::Data | Taker::Reference(_)
            )
        };
        wanted.taker.is_some_and(|(_, taker)| takes(taker))
            || wanted.cycle.is_some()
            || self.cycle_in_force.is_some()
            || words.iter().any(calls)
    }

    /// Cutter compensation and corners need their plane as it was.
    fn compensation(&self, words: &Words, given: &Given<'_>) -> At<()> {
        if at(&self.keeps, self.modes.plane.normal()) {
            return Ok(());
        }
        let letter = self.modes.plane.letter();
        if self.modes.compensated {
            let column = words
                .iter()
                .find(|word| word.letter == b'G')
                .map_or(0, |word| word.start);
            return Err((column, RewriteRefusal::Tilted(letter)));
        }
        match given.corner {
            Some(corner) => Err((given.column(corner), RewriteRefusal::Tilted(letter))),
            None => Ok(()),
        }
    }

    /// A, B, C at zero only: the part turns with them.
    fn rotary(&self, given: &Given<'_>) -> At<()> {
        if !given.letters.has_any(ROTARY) {
            return Ok(());
        }
        for letter in *b"ABC" {
            if let Some(number) = given.number(letter)?
                && number.digits != 0
            {
                let column = given.find(letter).map_or(0, |index| given.column(index));
                return Err((column, RewriteRefusal::Rotary(letter as char)));
            }
        }
        Ok(())
    }

    /// A length word in picometres.
    pub(in crate::rewrite) fn length(&self, given: &Given<'_>, index: usize) -> At<Pm> {
        let Some(word) = given.word(index) else {
            return Ok(0);
        };
        let done = match word.value {
            Value::Number(number) => self.length_of_number(number, word.letter),
            Value::Expression => Err(RewriteRefusal::Expression(word.letter as char)),
        };
        done.map_err(|reason| (word.start, reason))
    }

    /// What a number is behind a letter that stands for a length.
    #[inline]
    pub(in crate::rewrite) fn length_of_number(
        &self,
        number: Number,
        letter: u8,
    ) -> Result<Pm, RewriteRefusal> {
        let Some(unit) = self.modes.unit else {
            return Err(RewriteRefusal::NoUnit);
        };
        if !number.has_point && number.digits != 0 {
            match self.settings.integers {
                Some(Integers::Units) => {}
                Some(Integers::Steps) => {
                    let pm = number.digits.checked_mul(self.step().pm);
                    return pm
                        .filter(|pm| pm.unsigned_abs() <= LIMIT_PM.unsigned_abs())
                        .ok_or(RewriteRefusal::OutOfRange);
                }
                None => return Err(RewriteRefusal::NoPoint(letter as char)),
            }
        }
        length(number, unit)
    }

    /// A length word by its letter.
    pub(in crate::rewrite) fn length_of(&self, given: &Given<'_>, letter: u8) -> At<Option<Pm>> {
        given
            .find(letter)
            .map(|index| self.length(given, index))
            .transpose()
    }
}

/// A dwell has one word: P, U, or X, which is a time for Fanuc. With another one beside it, or
/// with a motion's code, X moves on a control that takes the time from P alone (LinuxCNC).
fn dwells(given: &Given<'_>, wanted: &Wanted) -> At<()> {
    let x_is_time = !given.has(b'P') && wanted.motion.is_none();
    for (letter, is_time) in [(b'X', x_is_time), (b'Y', false), (b'Z', false)] {
        if let Some(index) = given.find(letter).filter(|_| !is_time) {
            return Err((given.column(index), RewriteRefusal::TwoMotions));
        }
    }
    Ok(())
}

/// Whether a control may have an additional work offset of this number: the largest have 300.
fn may_be_offset(p: Option<Number>) -> bool {
    p.is_none_or(|p| {
        let unit = power(p.decimals);
        p.digits % unit == 0 && (1..=300).contains(&(p.digits / unit))
    })
}

/// The groups of modes that a code says.
const fn says(code: Code) -> Groups {
    match code {
        Code::Motion(_) => Groups::MOTION.with(Groups::CYCLE),
        Code::Cycle | Code::EndOfCycle => Groups::CYCLE,
        Code::Plane(_) => Groups::PLANE,
        Code::Inch | Code::Millimetre => Groups::UNIT,
        Code::Absolute | Code::Incremental => Groups::DISTANCE,
        Code::AbsoluteCentres | Code::IncrementalCentres => Groups::CENTRES,
        Code::InverseTime | Code::PerMinute | Code::PerRevolution => Groups::FEED,
        Code::Compensated | Code::NotCompensated => Groups::COMPENSATION,
        Code::ToR | Code::ToInitial => Groups::RETURN,
        Code::Work(_) | Code::ExtendedWork => Groups::WORK,
        _ => Groups::NONE,
    }
}
