//! Offsets, shifts and the words that are taken for them.

use crate::rewrite::block::{AXES, Given, Letters, Taker};
use crate::rewrite::refusal::{RewriteRefusal, Why};
use crate::rewrite::state::Shift;
use crate::rewrite::text::length::{LIMIT_PM, Pm};
use crate::rewrite::text::words::{At, Number, Value};
use crate::rewrite::{RewriteDialect, Rewriter, at};

impl Rewriter {
    pub(super) fn taken(&mut self, taker: Taker, word: usize, given: &Given<'_>) -> At<()> {
        match taker {
            Taker::Nothing | Taker::Dwell => Ok(()),
            Taker::Call => self.call(given, given.column(word)),
            Taker::Data => self.data(word, given),
            Taker::Reference(code) => {
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
                        return Err((
                            given.column(index),
                            RewriteRefusal::Code(code, Why::Through),
                        ));
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
                        self.place.at_machine |= 1 << axis;
                    }
                }
                Ok(())
            }
            Taker::Local => {
                for (axis, letter) in AXES.iter().enumerate() {
                    let Some(pm) = self.length_of(given, *letter)? else {
                        continue;
                    };
                    let is_linuxcnc = self.settings.dialect == Some(RewriteDialect::LinuxCnc);
                    if at(&self.took_local, axis) && !is_linuxcnc {
                        return Err((given.column(word), RewriteRefusal::ShiftTaken));
                    }
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
                    // G52 of this axis goes into it: for LinuxCNC both are one, for Fanuc it ends,
                    // a Haas keeps both.
                    let local = at(&self.local, axis);
                    if let Some(slot) = self.took_local.get_mut(axis) {
                        *slot |= local != 0;
                    }
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
        match given.whole(b'L')? {
            Some(2) => {}
            // LinuxCNC's: so that the axes are at these places, and they are elsewhere now.
            Some(10 | 11) if given.letters.has_any(Letters::AXES) => {
                return Err((column, RewriteRefusal::Code(100, Why::Offsets)));
            }
            // Of a Heidenhain it is a motion, by R and H.
            None if !given.has(b'P') => return Err((column, RewriteRefusal::OffsetNumber)),
            None | Some(1 | 10..=13) => {
                if self.modes.has_length {
                    self.place.forget(2);
                }
                return Ok(());
            }
            // Where the axes are, only the control knows.
            Some(20) => {
                return Err((column, RewriteRefusal::Code(100, Why::Offsets)));
            }
            Some(_) => return Err((column, RewriteRefusal::OffsetNumber)),
        }
        if given.number(b'R')?.is_some_and(|number| number.digits != 0) {
            return Err((column, RewriteRefusal::Code(100, Why::Coordinates)));
        }
        let number = match given.whole(b'P')? {
            Some(p @ 1..=6) => p as usize,
            // P0 is all of them here, the active one there.
            _ => return Err((column, RewriteRefusal::OffsetNumber)),
        };
        let Some(incremental) = self.modes.incremental else {
            return Err((column, RewriteRefusal::NoDistanceMode));
        };
        // Whether G91 counts here, controls see differently: LinuxCNC sets the place all the same.
        let incremental = match self.settings.dialect {
            _ if !incremental => false,
            Some(RewriteDialect::LinuxCnc) => false,
            Some(RewriteDialect::Fanuc) => true,
            None => return Err((column, RewriteRefusal::OffsetStep)),
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
                    self.beginning.steps |= pm != 0;
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

    /// Settles what the transform's frame is, where nobody has said it: the work offset of the
    /// first motion.
    pub(in crate::rewrite) fn settle(&mut self) {
        if self.frame.is_none() {
            let work = self.modes.work;
            self.frame = Some((work, self.origin(work).unwrap_or_default()));
        }
    }

    /// Settles it before the program begins: this work offset, as it is now. A translation is the
    /// same in all of them.
    pub(in crate::rewrite) fn measured_in(&mut self, work: u16) {
        if !self.is_translation {
            self.frame = Some((work, self.origin(work).unwrap_or_default()));
            self.shift();
            self.shifts = false;
        }
    }

    fn origin(&self, work: u16) -> Option<[crate::rewrite::Origin; 3]> {
        self.origins.get(usize::from(work).checked_sub(1)?).copied()
    }

    /// From the coordinates of the program to the frame, as things stand.
    pub(super) fn shift(&mut self) {
        self.shifts = true;
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
        if let Some(slot) = self.took_local.get_mut(axis) {
            *slot = false;
        }
    }

    pub(in crate::rewrite) fn forget_all(&mut self) {
        for axis in 0..3 {
            self.place.forget(axis);
        }
    }
}
