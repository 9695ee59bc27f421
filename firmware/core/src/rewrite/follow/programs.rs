//! Programs: ends, calls, and what a subprogram leaves to its caller.

use crate::rewrite::block::Given;
use crate::rewrite::moved::plan::More;
use crate::rewrite::refusal::RewriteRefusal;
use crate::rewrite::state::{Groups, Place, Subprogram};
use crate::rewrite::text::length::power;
use crate::rewrite::text::words::{At, Value, Words};
use crate::rewrite::{RewriteDialect, Rewriter};

impl Rewriter {
    pub(super) fn m_words(&mut self, words: &Words, given: &Given<'_>) -> At<()> {
        for word in words.iter().filter(|word| word.letter == b'M') {
            let Value::Number(number) = word.value else {
                return Err((word.start, RewriteRefusal::Expression('M')));
            };
            // M codes have no decimals that matter here.
            let m = number.digits / power(number.decimals);
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
                    self.begins_again(word.start)?;
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
    pub(in crate::rewrite) fn call_by_name(&mut self, name: &[u8], column: usize) -> At<()> {
        if self.modes.compensated || self.cycle_in_force.is_some() {
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
    pub(in crate::rewrite) fn lose_motion(&mut self) {
        (self.motion, self.out_motion) = (None, None);
        self.lost_motion = true;
    }

    /// Nothing of place and motion is known behind a call.
    fn leave_for_call(&mut self) {
        self.forget_all();
        self.place.relative = false;
        self.place.at_machine = 0b111;
        self.lose_motion();
    }

    /// M198: a program of another device, whatever stands in this file under its number.
    fn call_elsewhere(&mut self, given: &Given<'_>, column: usize) -> At<()> {
        let number = given
            .whole(b'P')?
            .ok_or((column, RewriteRefusal::CallsNothing))?;
        if self.modes.compensated || self.cycle_in_force.is_some() {
            return Err((column, RewriteRefusal::SubprogramModes));
        }
        if !self.settings.allows_number(number) {
            return Err((column, RewriteRefusal::Elsewhere(number)));
        }
        self.leave_for_call();
        Ok(())
    }

    /// M98, G65: what it does is known when its text comes.
    pub(super) fn call(&mut self, given: &Given<'_>, column: usize) -> At<()> {
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
        if self.modes.compensated || self.cycle_in_force.is_some() {
            return Err((column, RewriteRefusal::SubprogramModes));
        }
        self.counts_on(Groups::ALL);
        self.begins_moving();
        // Below a call that met other offsets they are those of that call.
        let around = self.current.filter(|_| self.elsewise);
        let (offsets, framed) = match around.and_then(|index| self.subprograms.get(index)) {
            Some(sub) => (sub.offsets, sub.framed),
            None => (self.offsets(), self.frame.is_some()),
        };
        let found = self.subprograms.iter_mut().find(|sub| sub.number == number);
        match found {
            Some(sub) => {
                if sub.leaves_cycle || !agree(&sub.modes, &self.modes) {
                    return Err((column, RewriteRefusal::SubprogramModes));
                }
                sub.called_under_both |= sub.modes.returns_to_r() != self.modes.returns_to_r();
                if sub.written && sub.called_under_both && sub.has_return {
                    return Err((column, RewriteRefusal::SubprogramModes));
                }
                sub.elsewise |= sub.offsets != offsets;
                if sub.written && sub.shifts && sub.elsewise {
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
                    offsets,
                    elsewise: false,
                    framed,
                    shifts: false,
                    called_under_both: false,
                    has_return: false,
                    leaves_cycle: false,
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
    pub(super) fn begin_program(&mut self, number: u32, column: usize) -> At<()> {
        if !self.has_begun {
            return Ok(());
        }
        self.end_subprogram(column)?;
        let found = self
            .subprograms
            .iter()
            .position(|sub| sub.number == number || sub.as_said == number);
        self.lose_motion();
        self.cycle_in_force = None;
        self.beginning.is_here = false;
        (self.said, self.unsaid) = (Groups::NONE, Groups::NONE);
        self.elsewise = false;
        let offsets = self.offsets();
        match found {
            Some(index) => {
                if let Some(sub) = self.subprograms.get_mut(index) {
                    sub.written = true;
                    sub.elsewise |= sub.offsets != offsets;
                    self.modes = sub.modes;
                    self.elsewise = sub.elsewise;
                    // The frame has been settled since it was called.
                    if !sub.framed && self.frame.is_some() {
                        let shift = self.modes.shift;
                        self.shift();
                        if self.elsewise || shift != self.modes.shift {
                            return Err((column, RewriteRefusal::SubprogramModes));
                        }
                    }
                }
                self.shifts = false;
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
                self.modes = crate::rewrite::modes(&self.settings);
                if self.beginning.returned {
                    // Nor may the first program have been called before it.
                    if offsets != self.beginning.before {
                        return Err((column, RewriteRefusal::SubprogramModes));
                    }
                    self.shift();
                } else {
                    (self.modes.work, self.modes.shift) = (work, shift);
                }
                self.shifts = false;
                self.place = Place {
                    last: self.place.last,
                    ..Place::CALLED
                };
                let sub = Subprogram {
                    number,
                    as_said: number,
                    modes: self.modes,
                    offsets,
                    elsewise: false,
                    framed: self.frame.is_some(),
                    shifts: false,
                    called_under_both: false,
                    has_return: false,
                    leaves_cycle: false,
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

    /// M99 in the first program of the file: it begins again, with what it leaves. What it had
    /// counted on before it said it has to be there again.
    fn begins_again(&self, column: usize) -> At<()> {
        let beginning = &self.beginning;
        if !beginning.is_here {
            return Ok(());
        }
        let before = crate::rewrite::modes(&self.settings);
        let now = &self.modes;
        let motion = self.settings.start.motion;
        let differs = |group, differs| self.unsaid.has(group) && differs;
        let is_other = beginning.steps
            || beginning
                .offsets
                .is_some_and(|offsets| offsets != self.offsets())
            || differs(
                Groups::DISTANCE,
                before.incremental.is_some() && before.incremental != now.incremental,
            )
            || differs(Groups::PLANE, before.plane != now.plane)
            || differs(
                Groups::UNIT,
                before.unit.is_some() && before.unit != now.unit,
            )
            || differs(
                Groups::CENTRES,
                before.absolute_centres != now.absolute_centres,
            )
            || differs(Groups::FEED, before.feed != now.feed)
            || differs(Groups::COMPENSATION, before.compensated != now.compensated)
            || differs(Groups::RETURN, before.returns_to_r() != now.returns_to_r())
            || differs(Groups::WORK, before.work != now.work)
            || differs(Groups::CYCLE, self.cycle_in_force.is_some())
            || differs(
                Groups::MOTION,
                motion.is_some() && (motion, motion) != (self.motion, self.out_motion),
            );
        if is_other {
            return Err((column, RewriteRefusal::SubprogramModes));
        }
        Ok(())
    }

    /// M99 in the first program of the file: others may call it, too. It named its places
    /// itself, as nobody was known to have called it.
    fn end_first(&mut self, column: usize) -> At<()> {
        let Some(number) = self.first.filter(|_| self.current.is_none()) else {
            return Ok(());
        };
        self.first = None;
        self.beginning.returned = true;
        let sub = Subprogram {
            number,
            as_said: number,
            modes: self.modes,
            offsets: self.offsets(),
            elsewise: false,
            framed: self.frame.is_some(),
            shifts: self.shifts,
            called_under_both: false,
            has_return: self.has_return(),
            leaves_cycle: self.cycle_in_force.is_some(),
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
        let offsets = self.offsets();
        let (shifts, elsewise) = (self.shifts, self.elsewise);
        let has_return = self.has_return();
        // What it says before it counts, and before anybody has called it, its callers must have.
        let says_return = self.said.has(Groups::RETURN) && !self.unsaid.has(Groups::RETURN);
        let leaves_cycle = self.cycle_in_force.is_some();
        if let Some(sub) = self.subprograms.get_mut(index) {
            let is_other = (sub.called_line > 0 || !says_return)
                && sub.modes.returns_to_r() != modes.returns_to_r();
            if is_other
                || leaves_cycle
                || !agree(&sub.modes, &modes)
                || (!elsewise && sub.offsets != offsets)
            {
                return Err((column, RewriteRefusal::SubprogramModes));
            }
            sub.has_return = has_return;
            // What it said itself is what its callers must have.
            sub.modes = modes;
            sub.shifts = shifts;
            sub.drifts = drifts;
            if sub.drifts && sub.repeated {
                return Err((column, RewriteRefusal::SubprogramDrifts));
            }
        }
        Ok(())
    }
}

/// Whether a subprogram's modes are those of its caller; what it never said fits all.
fn agree(sub: &crate::rewrite::Modes, caller: &crate::rewrite::Modes) -> bool {
    let merged = crate::rewrite::Modes {
        incremental: sub.incremental.or(caller.incremental),
        unit: sub.unit.or(caller.unit),
        // What counts is whether it has a part in what the subprogram does.
        returns_to_r: caller.returns_to_r,
        ..*sub
    };
    let caller = crate::rewrite::Modes {
        incremental: caller.incremental.or(sub.incremental),
        unit: caller.unit.or(sub.unit),
        ..*caller
    };
    merged == caller
}
