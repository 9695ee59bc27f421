//! Following a program: modes, offsets, subprograms, and where the axes are.

use super::block::{AXES, Code, Given, Letters, Taker, code, tenths};
use super::moved::plan::{More, Wanted};
use super::refusal::{RewriteRefusal, Why};
use super::state::{Feed, Motion, Place, Plane, Shift, Subprogram};
use super::text::emit::Edit;
use super::text::length::{LIMIT_PM, Pm, Unit, length};
use super::text::words::{At, Number, Value, Words};
use super::{Integers, RewriteDialect, Rewriter, at};

const SECONDARY: Letters = Letters::of(b"UVW");
const ROTARY: Letters = Letters::of(b"ABC");

impl Rewriter {
    /// Carries out a block: its modes, its offsets, its motion.
    pub(super) fn follow(&mut self, words: &Words, edit: &mut Edit) -> At<()> {
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
        if let Some(word) = wanted.lookahead
            && (has_axes || given.letters.has_any(Letters::CENTRES))
        {
            return Err((given.column(word), RewriteRefusal::Code(51, Why::Motion)));
        }
        if wanted.length || (given.has(b'H') && self.modes.has_length) {
            self.place.forget(2);
        }
        if let Some((motion, _)) = wanted.motion.map(|(word, motion)| (motion, word)) {
            self.motion = Some(motion);
            self.modes.cycle = None;
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
            self.taken(taker, word, &given)?;
        } else {
            self.rotary(&given)?;
            let is_arc = matches!(self.motion, Some(Motion::Clockwise | Motion::Counter))
                && given.letters.has_any(Letters::CENTRES.with(b'R'));
            if has_axes || is_arc || wanted.cycle.is_some() {
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
        Ok(())
    }

    /// Letters that a block without a motion must not have: behind a motion code, and where
    /// one control takes them into the cycle in force, another drills, another gives an alarm.
    fn stray(&self, given: &Given<'_>, wanted: &Wanted) -> At<()> {
        let letters: &[u8] = match (self.modes.cycle, wanted.motion) {
            (Some(_), _) => b"IJKLPQR",
            (None, Some(_)) => b"IJKR",
            // Alone it calls a subprogram (Sinumerik).
            (None, None) if !given.has(b'G') && !given.has(b'M') => b"LP",
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
        for (index, word) in words.iter().enumerate() {
            if word.letter != b'G' {
                continue;
            }
            let Value::Number(number) = word.value else {
                return Err((word.start, RewriteRefusal::Expression('G')));
            };
            let Some(tenths) = tenths(number) else {
                return Err((word.start, RewriteRefusal::NoCode));
            };
            let refuse = |reason| Err((word.start, reason));
            match code(tenths) {
                Code::Nothing => {
                    match tenths {
                        50 | 51 => wanted.lookahead = Some(index),
                        // Of a lathe: sets coordinates.
                        500 if given.letters.has_any(Letters::AXES) => {
                            return refuse(RewriteRefusal::Code(500, Why::Offsets));
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
                    wanted.cycle = Some((index, tenths));
                }
                Code::EndOfCycle => self.modes.cycle = None,
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
                Code::ExtendedWork => wanted.extended = true,
                Code::EndOfShift if given.letters.has_any(Letters::AXES) => {
                    if wanted.taker.is_some() {
                        return refuse(RewriteRefusal::TwoMotions);
                    }
                    wanted.taker = Some((index, Taker::Preset));
                }
                Code::EndOfShift => {
                    (self.here, self.here_out) = ([0; 3], [0; 3]);
                    // Without axes it is LinuxCNC's, whose G52 is the same shift.
                    self.local = [0; 3];
                    self.shift();
                }
                Code::ToR => self.modes.returns_to_r = true,
                Code::ToInitial => self.modes.returns_to_r = false,
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
            let p = given.whole(b'P')?;
            wanted.extended = true;
            work = p.map(|p| 1000 + u16::try_from(p).unwrap_or(u16::MAX - 1000));
        }
        if let Some(work) = work {
            self.modes.work = work;
            self.shift();
        }
        self.compensation(words, given)?;
        Ok(wanted)
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
    pub(super) fn length(&self, given: &Given<'_>, index: usize) -> At<Pm> {
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
    pub(super) fn length_of_number(
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
    pub(super) fn length_of(&self, given: &Given<'_>, letter: u8) -> At<Option<Pm>> {
        given
            .find(letter)
            .map(|index| self.length(given, index))
            .transpose()
    }

    fn taken(&mut self, taker: Taker, word: usize, given: &Given<'_>) -> At<()> {
        match taker {
            Taker::Nothing | Taker::Dwell => Ok(()),
            Taker::Call => self.call(given, given.column(word)),
            Taker::Data => self.data(word, given),
            Taker::Reference => {
                let is_incremental = self.modes.incremental == Some(true);
                let mut named = false;
                for (axis, letter) in AXES.iter().enumerate() {
                    let Some(index) = given.find(*letter) else {
                        continue;
                    };
                    named = true;
                    let is_zero = matches!(
                        given.word(index).map(|word| word.value),
                        Some(Value::Number(Number { digits: 0, .. }))
                    );
                    if !(is_incremental && is_zero) {
                        return Err((given.column(index), RewriteRefusal::Code(280, Why::Through)));
                    }
                    self.place.forget(axis);
                }
                if !named {
                    self.forget_all();
                }
                Ok(())
            }
            Taker::Machine => {
                for (axis, letter) in AXES.iter().enumerate() {
                    if given.has(*letter) {
                        self.place.forget(axis);
                    }
                }
                Ok(())
            }
            Taker::Local => {
                for (axis, letter) in AXES.iter().enumerate() {
                    let Some(pm) = self.length_of(given, *letter)? else {
                        continue;
                    };
                    if at(&self.here, axis) != 0 || at(&self.here_out, axis) != 0 {
                        match self.settings.dialect {
                            Some(RewriteDialect::Fanuc) => {}
                            Some(RewriteDialect::LinuxCnc) => self.end_shift(axis),
                            None => return Err((given.column(word), RewriteRefusal::TwoShifts)),
                        }
                    }
                    if let Some(slot) = self.local.get_mut(axis) {
                        *slot = pm;
                    }
                }
                self.shift();
                Ok(())
            }
            Taker::Preset => {
                if self.settings.dialect == Some(RewriteDialect::LinuxCnc) {
                    return Err((given.column(word), RewriteRefusal::TwoMotions));
                }
                for (axis, letter) in AXES.iter().enumerate() {
                    match self.length_of(given, *letter)? {
                        None => {}
                        Some(0) => self.end_shift(axis),
                        Some(_) => {
                            let reason = RewriteRefusal::Code(921, Why::Offsets);
                            return Err((given.column(word), reason));
                        }
                    }
                }
                self.shift();
                Ok(())
            }
            Taker::Here => {
                for (axis, letter) in AXES.iter().enumerate() {
                    let Some(index) = given.find(*letter) else {
                        continue;
                    };
                    let value = self.length(given, index)?;
                    let unknown = (
                        given.column(index),
                        RewriteRefusal::UnknownPlace(*letter as char),
                    );
                    let (Some(nominal), Some(out)) =
                        (at(&self.place.nominal, axis), at(&self.place.out, axis))
                    else {
                        return Err(unknown);
                    };
                    if self.place.relative || !self.modes.shift.known {
                        return Err(unknown);
                    }
                    let shift = self.modes.shift;
                    let add = |slots: &mut [Pm; 3], more: Pm| {
                        if let Some(slot) = slots.get_mut(axis) {
                            *slot += more;
                        }
                    };
                    // G52 of this axis goes into it: for LinuxCNC both are one, for Fanuc it ends.
                    let local = at(&self.local, axis);
                    add(
                        &mut self.here,
                        nominal - value - at(&shift.nominal, axis) + local,
                    );
                    add(
                        &mut self.here_out,
                        out - value - at(&shift.out, axis) + local,
                    );
                    add(&mut self.local, -local);
                }
                self.shift();
                Ok(())
            }
        }
    }

    /// G10: a work offset may move; a tool's does not concern the tip.
    fn data(&mut self, word: usize, given: &Given<'_>) -> At<()> {
        let column = given.column(word);
        let offsets = Err((column, RewriteRefusal::Code(100, Why::Offsets)));
        match given.whole(b'L')? {
            Some(2) => {}
            None | Some(1 | 10..=13) => {
                if self.modes.has_length {
                    self.place.forget(2);
                }
                return Ok(());
            }
            Some(_) => return offsets,
        }
        if given.number(b'R')?.is_some_and(|number| number.digits != 0) {
            return Err((column, RewriteRefusal::Code(100, Why::Coordinates)));
        }
        let number = match given.whole(b'P')? {
            Some(p @ 1..=6) => p as usize,
            // P0 is all of them here, the active one there.
            _ => return offsets,
        };
        let Some(incremental) = self.modes.incremental else {
            return Err((column, RewriteRefusal::NoDistanceMode));
        };
        // Whether G91 counts here, controls see differently: LinuxCNC sets the place all the same.
        let incremental = match self.settings.dialect {
            _ if !incremental => false,
            Some(RewriteDialect::LinuxCnc) => false,
            Some(RewriteDialect::Fanuc) => true,
            None => return offsets,
        };
        for (axis, letter) in AXES.iter().enumerate() {
            let Some(pm) = self.length_of(given, *letter)? else {
                continue;
            };
            let slot = self
                .origins
                .get_mut(number - 1)
                .and_then(|origin| origin.get_mut(axis));
            if let Some(slot) = slot {
                if incremental {
                    slot.pm += pm;
                    if slot.pm.abs() > LIMIT_PM {
                        return Err((column, RewriteRefusal::OutOfRange));
                    }
                } else {
                    slot.pm = pm;
                    slot.is_absolute = true;
                }
            }
        }
        self.shift();
        Ok(())
    }

    /// Settles what the transform's frame is: the work offset of the first motion.
    pub(super) fn settle(&mut self) {
        if self.frame.is_none() {
            let work = self.modes.work;
            self.frame = Some((work, self.origin(work).unwrap_or_default()));
        }
    }

    fn origin(&self, work: u16) -> Option<[super::Origin; 3]> {
        self.origins.get(usize::from(work).checked_sub(1)?).copied()
    }

    /// From the coordinates of the program to the frame, as things stand.
    fn shift(&mut self) {
        let mut offset = [0; 3];
        let mut known = true;
        if let Some((work, origin)) = self.frame {
            let now = self.origin(self.modes.work).unwrap_or_default();
            let same = work == self.modes.work;
            for (axis, slot) in offset.iter_mut().enumerate() {
                let (from, to) = (at(&origin, axis), at(&now, axis));
                known &= (same && from.is_absolute == to.is_absolute)
                    || (from.is_absolute && to.is_absolute);
                *slot = to.pm - from.pm;
            }
        }
        if !known && self.is_translation {
            // Wherever it lies, a translation is the same; but not where the axes are.
            offset = [0; 3];
            known = true;
            self.forget_all();
        }
        let sum = |here: &[Pm; 3]| {
            core::array::from_fn(|axis| at(&offset, axis) + at(&self.local, axis) + at(here, axis))
        };
        self.modes.shift = Shift {
            nominal: sum(&self.here),
            out: sum(&self.here_out),
            known,
        };
    }

    /// The shifts of an axis end.
    fn end_shift(&mut self, axis: usize) {
        for slots in [&mut self.here, &mut self.here_out, &mut self.local] {
            if let Some(slot) = slots.get_mut(axis) {
                *slot = 0;
            }
        }
    }

    pub(super) fn forget_all(&mut self) {
        for axis in 0..3 {
            self.place.forget(axis);
        }
    }

    fn m_words(&mut self, words: &Words, given: &Given<'_>) -> At<()> {
        for word in words.iter().filter(|word| word.letter == b'M') {
            let Value::Number(number) = word.value else {
                return Err((word.start, RewriteRefusal::Expression('M')));
            };
            // M codes have no decimals that matter here.
            let m = number.digits / super::text::length::power(number.decimals);
            let is_late = matches!(m, 0 | 1 | 2 | 5 | 9 | 30 | 60 | 97 | 98 | 99 | 198);
            if is_late && self.more != More::Nothing {
                return Err((word.start, RewriteRefusal::LateCode('M')));
            }
            match m {
                // Changers move axes on their way.
                6 | 60 => self.forget_all(),
                98 => {
                    for letter in *b"QH" {
                        if let Some(index) = given.find(letter) {
                            let reason = RewriteRefusal::CallsFrom(letter as char);
                            return Err((given.column(index), reason));
                        }
                    }
                    self.call(given, word.start)?;
                }
                198 => self.call_elsewhere(given, word.start)?,
                72 | 73 if self.settings.dialect != Some(RewriteDialect::Fanuc) => {
                    return Err((word.start, RewriteRefusal::Restores(m as u8)));
                }
                // Of a Haas: a block number of this program.
                97 if given.has(b'P') => {
                    return Err((word.start, RewriteRefusal::CallsFrom('P')));
                }
                96 | 97 => return Err((word.start, RewriteRefusal::Flow)),
                99 => {
                    // To another block, or another number of times.
                    if given.has(b'P') || given.has(b'L') {
                        return Err((word.start, RewriteRefusal::Flow));
                    }
                    self.end_first(word.start)?;
                    self.end_subprogram(word.start)?;
                    self.forget_all();
                }
                2 | 30 => {
                    self.end_subprogram(word.start)?;
                    self.forget_all();
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// A call by an O word: what it does is known to the control only.
    pub(super) fn call_by_name(&mut self, name: &[u8], column: usize) -> At<()> {
        if self.modes.compensated || self.modes.cycle.is_some() {
            return Err((column, RewriteRefusal::SubprogramModes));
        }
        let name = core::str::from_utf8(name).unwrap_or_default();
        let number = name.parse().ok();
        let allowed = match number {
            Some(number) => self.settings.allows_number(number),
            None => self.settings.allows_call(name),
        };
        if !allowed {
            return Err((
                column,
                number.map_or(RewriteRefusal::NamedCall, RewriteRefusal::NumberedCall),
            ));
        }
        self.leave_for_call();
        Ok(())
    }

    /// What is in force is not known any more, and nothing said before the program helps.
    pub(super) fn lose_motion(&mut self) {
        (self.motion, self.out_motion) = (None, None);
        self.lost_motion = true;
    }

    /// Nothing of place and motion is known behind a call.
    fn leave_for_call(&mut self) {
        self.forget_all();
        self.place.relative = false;
        self.lose_motion();
    }

    /// M198: a program of another device, whatever stands in this file under its number.
    fn call_elsewhere(&mut self, given: &Given<'_>, column: usize) -> At<()> {
        let number = given
            .whole(b'P')?
            .ok_or((column, RewriteRefusal::CallsNothing))?;
        if self.modes.compensated || self.modes.cycle.is_some() {
            return Err((column, RewriteRefusal::SubprogramModes));
        }
        if !self.settings.allows_number(number) {
            return Err((column, RewriteRefusal::Elsewhere(number)));
        }
        self.leave_for_call();
        Ok(())
    }

    /// M98, G65: what it does is known when its text comes.
    fn call(&mut self, given: &Given<'_>, column: usize) -> At<()> {
        let Some(p) = given.whole(b'P')? else {
            return Err((column, RewriteRefusal::CallsNothing));
        };
        // Older controls: four digits of the number behind the count.
        let (number, times) = match given.whole(b'L')? {
            Some(times) => (p, times),
            // Newer ones: a number of five digits and more.
            None if p > 9999 && !self.subprograms.iter().any(|sub| sub.number == p) => {
                (p % 10_000, p / 10_000)
            }
            None => (p, 1),
        };
        let is_known = self.place.nominal.iter().all(Option::is_some) && !self.place.relative;
        let repeated = times > 1 || !is_known;
        // A compensated path cannot leave the block; a cycle would go on in there.
        if self.modes.compensated || self.modes.cycle.is_some() {
            return Err((column, RewriteRefusal::SubprogramModes));
        }
        let found = self.subprograms.iter_mut().find(|sub| sub.number == number);
        match found {
            Some(sub) => {
                if !agree(&sub.modes, &self.modes) {
                    return Err((column, RewriteRefusal::SubprogramModes));
                }
                sub.repeated |= repeated;
                if sub.written && sub.drifts && sub.repeated {
                    return Err((column, RewriteRefusal::SubprogramDrifts));
                }
            }
            None => {
                let sub = Subprogram {
                    number,
                    as_said: p,
                    modes: self.modes,
                    repeated,
                    written: false,
                    drifts: false,
                    called_line: self.line,
                    // A line has 512 characters.
                    called_column: column as u16,
                };
                self.subprograms
                    .push(sub)
                    .map_err(|_| (column, RewriteRefusal::TooManySubprograms))?;
            }
        }
        self.leave_for_call();
        Ok(())
    }

    /// An O word: the next program of the file.
    fn begin_program(&mut self, number: u32, column: usize) -> At<()> {
        if !self.has_begun {
            return Ok(());
        }
        self.end_subprogram(column)?;
        let found = self
            .subprograms
            .iter()
            .position(|sub| sub.number == number || sub.as_said == number);
        self.lose_motion();
        match found {
            Some(index) => {
                if let Some(sub) = self.subprograms.get_mut(index) {
                    sub.written = true;
                    self.modes = sub.modes;
                }
                self.place = Place {
                    last: self.place.last,
                    ..Place::CALLED
                };
                self.current = Some(index);
            }
            None => {
                // Nobody has called it yet: it says its modes itself.
                let work = self.modes.work;
                let shift = self.modes.shift;
                self.modes = super::modes(&self.settings);
                (self.modes.work, self.modes.shift) = (work, shift);
                self.place = Place {
                    last: self.place.last,
                    ..Place::CALLED
                };
                let sub = Subprogram {
                    number,
                    as_said: number,
                    modes: self.modes,
                    repeated: false,
                    written: true,
                    drifts: false,
                    called_line: 0,
                    called_column: 0,
                };
                self.current = Some(self.subprograms.len());
                self.subprograms
                    .push(sub)
                    .map_err(|_| (column, RewriteRefusal::TooManySubprograms))?;
            }
        }
        Ok(())
    }

    /// Whether the way from where a subprogram was called needed no rounding, as a step down
    /// along an axis that keeps its direction: from there it can be called any number of times.
    fn is_exact(&self) -> bool {
        let ([Some(x), Some(y), Some(z)], [Some(a), Some(b), Some(c)]) =
            (self.place.nominal, self.place.out)
        else {
            return false;
        };
        #[allow(clippy::cast_precision_loss, reason = "places are below 2^53 pm")]
        let (image, out) = (
            self.image([x, y, z].map(|pm| pm as f64)),
            [a, b, c].map(|pm| pm as f64),
        );
        // Compared as numbers: less than a picometre is none.
        image
            .iter()
            .zip(out)
            .all(|(image, out)| (image - out).abs() < 1.0)
    }

    /// M99 in the first program of the file: others may call it, too. It named its places
    /// itself, as nobody was known to have called it.
    fn end_first(&mut self, column: usize) -> At<()> {
        let Some(number) = self.first.filter(|_| self.current.is_none()) else {
            return Ok(());
        };
        self.first = None;
        let sub = Subprogram {
            number,
            as_said: number,
            modes: self.modes,
            repeated: false,
            written: true,
            drifts: false,
            called_line: 0,
            called_column: 0,
        };
        self.subprograms
            .push(sub)
            .map_err(|_| (column, RewriteRefusal::TooManySubprograms))
    }

    /// The end of a subprogram's text: it has to leave what it found.
    fn end_subprogram(&mut self, column: usize) -> At<()> {
        let Some(index) = self.current.take() else {
            return Ok(());
        };
        let modes = self.modes;
        let place = self.place;
        let drifts = place.relative && place.nominal != [Some(0); 3] && !self.is_exact();
        if let Some(sub) = self.subprograms.get_mut(index) {
            if !agree(&sub.modes, &modes) {
                return Err((column, RewriteRefusal::SubprogramModes));
            }
            // What it said itself is what its callers must have.
            sub.modes = modes;
            sub.drifts = drifts;
            if sub.drifts && sub.repeated {
                return Err((column, RewriteRefusal::SubprogramDrifts));
            }
        }
        Ok(())
    }
}

/// Whether a subprogram's modes are those of its caller; what it never said fits all.
fn agree(sub: &super::Modes, caller: &super::Modes) -> bool {
    let merged = super::Modes {
        incremental: sub.incremental.or(caller.incremental),
        unit: sub.unit.or(caller.unit),
        // Settled while the text went by.
        returns_to_r: caller.returns_to_r,
        ..*sub
    };
    let caller = super::Modes {
        incremental: caller.incremental.or(sub.incremental),
        unit: caller.unit.or(sub.unit),
        ..*caller
    };
    merged == caller
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
