//! Canned cycles: kept where the tool's direction stays, written out where it tilts.

use crate::rewrite::block::{AXES, Given, Letters};
use crate::rewrite::moved::plan::{Holes, More, Phase, Repeat, Wanted, allow};
use crate::rewrite::refusal::RewriteRefusal;
use crate::rewrite::state::{Cycle, Feed, Motion};
use crate::rewrite::text::emit;
use crate::rewrite::text::emit::{Action, Edit, Out};
use crate::rewrite::text::length::{LIMIT_PM, Pm, Step};
use crate::rewrite::text::words::At;
use crate::rewrite::{RewriteDialect, Rewriter, at, pm};

/// Holes of one block, at most, and pecks of all of them: what one block may become.
const MAX_HOLES: u32 = 1000;
const MAX_PECKS: Pm = 10_000;

/// What cycles take beside what every motion does.
const OF_CYCLES: Letters = Letters::of(b"RQPKLIJ");

impl Rewriter {
    /// A block that begins or goes on with a canned cycle.
    pub(in crate::rewrite) fn cycle(
        &mut self,
        given: &Given<'_>,
        wanted: &Wanted,
        edit: &mut Edit,
        incremental: bool,
        column: usize,
    ) -> At<()> {
        allow(given, OF_CYCLES)?;
        let normal = self.modes.plane.normal();
        let letter = at(&AXES, normal);
        // Both count holes, for one control or another.
        let code = wanted.cycle.map(|(_, code)| code);
        let narrows = match code {
            Some(code) => matches!(code, 730 | 830) && given.letters.has_any(Letters::of(b"IJ")),
            None => self.cycle_in_force.is_some_and(|cycle| cycle.narrows),
        };
        let counts = if narrows { b'L' } else { b'K' };
        let count = match given.whole(counts)? {
            Some(count) => count,
            None => given.whole(b'L')?.unwrap_or(1),
        };
        if let (Some(_), Some(l), false) = (given.find(b'K'), given.find(b'L'), narrows) {
            return Err((given.column(l), RewriteRefusal::Meaningless('L')));
        }
        if count > MAX_HOLES {
            return Err((column, RewriteRefusal::OutOfRange));
        }
        let axes = given.axes();
        let moves = (0..3).any(|axis| axis != normal && at(&axes, axis).is_some());
        if count == 0 && moves {
            let (letter, word) = match given.find(counts) {
                Some(word) => (counts as char, Some(word)),
                None => ('L', given.find(b'L')),
            };
            let column = word.map_or(column, |word| given.column(word));
            return Err((column, RewriteRefusal::Meaningless(letter)));
        }
        let before = self.place;
        let mut target = self.over(given, incremental, normal)?;
        let mut cycle = self.heights(given, wanted, incremental, normal, column)?;
        cycle.narrows = narrows;
        // LinuxCNC rises to an R above where it begins. An axis that the machine has placed does not
        // move with the part, so that it may stand above R in one program and below in the other.
        if cycle.initial.is_none()
            && at(&self.translation_pm, normal) != 0.0
            && self.settings.dialect != Some(RewriteDialect::Fanuc)
        {
            return Err((column, RewriteRefusal::UnknownPlace(letter as char)));
        }
        let rises = self.rises(&cycle, normal, column)?;
        if !at(&self.keeps, normal) {
            // Written out, the way up in increments would be lost.
            if incremental && rises {
                return Err((column, RewriteRefusal::TiltedCycle(cycle.code)));
            }
            // LinuxCNC feeds out of G89 as far as it comes out.
            let is_above = cycle.initial > cycle.r && !self.modes.returns_to_r();
            if cycle.code == 890 && is_above && self.settings.dialect.is_none() {
                return Err((column, RewriteRefusal::FeedsOut));
            }
            // A depth in increments counts from R: said alone, R takes the bottom with it.
            if incremental && given.has(b'R') && !given.has(letter) && cycle.bottom.is_some() {
                return Err((column, RewriteRefusal::CycleLacks(letter as char)));
            }
            // LinuxCNC rises before it goes across where G98 comes after G99.
            let rises_again = self.cycle_in_force.is_some_and(|before| before.to_r)
                && !self.modes.returns_to_r()
                && self.settings.dialect != Some(RewriteDialect::Fanuc);
            // And to a higher R it goes on the way across, where it began above.
            let climbs = rises && cycle.initial >= cycle.r;
            if rises_again || climbs {
                return Err((column, RewriteRefusal::TiltedCycle(cycle.code)));
            }
            if !matches!(cycle.code, 730 | 810 | 820 | 830 | 850 | 890) || narrows {
                return Err((column, RewriteRefusal::TiltedCycle(cycle.code)));
            }
            // None of its motions would have one.
            if self.modes.feed == Feed::InverseTime {
                return Err((column, RewriteRefusal::NoFeed));
            }
            return self.write_out(
                given,
                wanted,
                edit,
                incremental,
                column,
                &cycle,
                count,
                &before,
                target,
                rises,
            );
        }
        // What a control makes of a hole without R or bottom (an error, zero, the last cycle's) does not
        // move with the part.
        if count > 0 && axes.iter().any(Option::is_some) && at(&self.translation_pm, normal) != 0.0
        {
            for (known, letter) in [(cycle.r, b'R'), (cycle.bottom, letter)] {
                if known.is_none() {
                    return Err((column, RewriteRefusal::CycleLacks(letter as char)));
                }
            }
        }
        // The heights of the cycle move with the part, alike for all holes.
        let step = self.step();
        if !incremental {
            for (letter, slot) in [(b'R', &mut cycle.r_out), (letter, &mut None)] {
                let Some(index) = given.find(letter) else {
                    continue;
                };
                let out = self.height(given, index, normal, edit, &step)?;
                *slot = Some(out);
            }
        } else if given.has(b'R')
            && let (Some(r), Some(initial), Some(out)) = (cycle.r, cycle.initial, cycle.initial_out)
        {
            cycle.r_out = Some(out + r - initial);
        }
        // Over the hole: the height plays no part.
        if let Some(slot) = target.get_mut(normal) {
            *slot = at(&self.place.nominal, normal);
        }
        let plane_axes: [Option<usize>; 3] = core::array::from_fn(|axis| {
            if axis == normal {
                None
            } else {
                at(&axes, axis)
            }
        });
        let height = (at(&self.place.nominal, normal), at(&self.place.out, normal));
        // A hole is cut where it is: no place of it may be guessed.
        let mut image = self.carry(&target, true, column)?;
        if let Some(slot) = image.get_mut(normal) {
            *slot = None;
        }
        if count > 0 {
            self.write_axes(&plane_axes, &target, &image, incremental, edit, column)?;
        }
        self.stand(normal, height, &cycle, count > 0);
        self.cycle_in_force = Some(cycle);
        self.counts.holes.add(count);
        let by = by(&before.nominal, &target, normal);
        if count < 2 || !incremental || by == [0; 3] {
            return Ok(());
        }
        if let Some(unknown) = (0..3).find(|axis| at(&self.place.nominal, *axis).is_none()) {
            return Err((
                column,
                RewriteRefusal::UnknownPlace(at(&AXES, unknown) as char),
            ));
        }
        if let Some(word) = given.find(counts).or(given.find(b'L')) {
            edit.set(word, Action::Drop);
        }
        self.more = More::Repeat(Repeat {
            count: count - 1,
            by,
        });
        Ok(())
    }

    /// Whether a cycle never comes back below its R.
    fn stays_above_r(&self) -> bool {
        self.settings.dialect == Some(RewriteDialect::LinuxCnc)
    }

    /// Whether the tool rises to R before it moves across. Where it begins below R and nobody
    /// said whose program it is, that is not known.
    fn rises(&self, cycle: &Cycle, normal: usize, column: usize) -> At<bool> {
        let (Some(r), Some(height)) = (cycle.r, at(&self.place.nominal, normal)) else {
            return Ok(false);
        };
        let is_below = height < r || cycle.initial.is_some_and(|initial| initial < r);
        match self.settings.dialect {
            _ if !is_below => Ok(false),
            Some(RewriteDialect::Fanuc) => Ok(false),
            // In increments, too, R is counted from where the first of the cycles began.
            Some(RewriteDialect::LinuxCnc) => {
                let began_below = cycle.initial.is_some_and(|initial| initial < r);
                Ok(height < r || (began_below && height != r))
            }
            None => Err((column, RewriteRefusal::BelowR)),
        }
    }

    /// Where the tool stands after a hole.
    fn stand(
        &mut self,
        normal: usize,
        height: (Option<Pm>, Option<Pm>),
        cycle: &Cycle,
        moved: bool,
    ) {
        let begins_below = cycle.initial.is_some() && cycle.initial < cycle.r;
        let to_r = self.modes.returns_to_r() || (self.stays_above_r() && begins_below);
        let (nominal, out) = match (moved, to_r) {
            (false, _) => height,
            (true, true) => (cycle.r, cycle.r_out),
            (true, false) => (cycle.initial, cycle.initial_out),
        };
        match (nominal, out) {
            (Some(nominal), Some(out)) => self.arrive(normal, nominal, out),
            _ => self.place.forget(normal),
        }
    }

    /// Where the hole is, without its height.
    fn over(&mut self, given: &Given<'_>, incremental: bool, normal: usize) -> At<[Option<Pm>; 3]> {
        let mut target = self.place.nominal;
        if !incremental && self.place.relative {
            self.forget_all();
            self.place.relative = false;
            target = self.place.nominal;
        }
        for (axis, letter) in AXES.iter().enumerate() {
            if axis == normal {
                continue;
            }
            let Some(index) = given.find(*letter) else {
                continue;
            };
            let value = self.length(given, index)?;
            let base = if incremental {
                at(&self.place.nominal, axis).ok_or((
                    given.column(index),
                    RewriteRefusal::UnknownPlace(*letter as char),
                ))?
            } else {
                at(&self.modes.shift.nominal, axis)
            };
            if (base + value).abs() > LIMIT_PM {
                return Err((given.column(index), RewriteRefusal::OutOfRange));
            }
            if let Some(slot) = target.get_mut(axis) {
                *slot = Some(base + value);
            }
        }
        Ok(target)
    }

    /// The cycle with the heights that this block says, nominal.
    fn heights(
        &self,
        given: &Given<'_>,
        wanted: &Wanted,
        incremental: bool,
        normal: usize,
        column: usize,
    ) -> At<Cycle> {
        let shift = at(&self.modes.shift.nominal, normal);
        let shifts = [shift, at(&self.modes.shift.out, normal)];
        let mut cycle = self.cycle_in_force.unwrap_or(Cycle {
            code: 0,
            initial: at(&self.place.nominal, normal),
            initial_out: at(&self.place.out, normal),
            r: None,
            r_out: None,
            bottom: None,
            peck: None,
            dwell: None,
            said: [None; 2],
            normal,
            shifts,
            to_r: false,
            narrows: false,
        });
        if (cycle.normal, cycle.shifts) != (normal, shifts) {
            return Err((column, RewriteRefusal::HeightsMoved));
        }
        cycle.to_r = self.modes.returns_to_r();
        if let Some((_, code)) = wanted.cycle {
            cycle.code = code;
        }
        for (letter, said) in [b'R', at(&AXES, normal)].into_iter().zip(&mut cycle.said) {
            if given.has(letter) {
                *said = Some(incremental);
            }
            let Some(said) = *said else { continue };
            let is_same_mode =
                said == incremental || self.settings.dialect == Some(RewriteDialect::Fanuc);
            if !is_same_mode {
                return Err((column, RewriteRefusal::HeightsSaidElsewise));
            }
        }
        let has_r = self.length_of(given, b'R')?;
        if let Some(r) = has_r {
            let from = if incremental {
                let letter = at(&AXES, normal) as char;
                cycle
                    .initial
                    .ok_or((column, RewriteRefusal::UnknownPlace(letter)))?
            } else {
                shift
            };
            cycle.r = Some(from + r);
        }
        if let Some(z) = self.length_of(given, at(&AXES, normal))? {
            cycle.bottom = if incremental {
                cycle.r.map(|r| r + z)
            } else {
                Some(shift + z)
            };
        }
        if let Some(q) = self.length_of(given, b'Q')? {
            cycle.peck = Some(q.abs());
        }
        if let Some(p) = given.number(b'P')? {
            cycle.dwell = Some(p);
        }
        Ok(cycle)
    }

    /// A height word of a cycle that stays: moved along the axis, rounded.
    #[allow(
        clippy::cast_precision_loss,
        reason = "places are below 2^53 pm times a few"
    )]
    fn height(
        &self,
        given: &Given<'_>,
        index: usize,
        normal: usize,
        edit: &mut Edit,
        step: &Step,
    ) -> At<Pm> {
        let value = self.length(given, index)?;
        let shift = self.modes.shift;
        let nominal = value + at(&shift.nominal, normal);
        let image = nominal as f64 + at(&self.translation_pm, normal);
        let base = at(&shift.out, normal);
        let steps = step.count(image - base as f64);
        if (image - (base + value) as f64).abs() < 500.0 || steps * step.pm == value {
            return Ok(base + value);
        }
        edit.set(index, Action::Length(steps, step.decimals));
        Ok(base + steps * step.pm)
    }

    #[allow(clippy::too_many_arguments, reason = "one call, one block")]
    fn write_out(
        &mut self,
        given: &Given<'_>,
        wanted: &Wanted,
        edit: &mut Edit,
        incremental: bool,
        column: usize,
        cycle: &Cycle,
        count: u32,
        before: &crate::rewrite::Place,
        target: [Option<Pm>; 3],
        rises: bool,
    ) -> At<()> {
        let normal = self.modes.plane.normal();
        let letter = at(&AXES, normal) as char;
        for axis in 0..3 {
            if at(&target, axis).is_none() || at(&self.place.out, axis).is_none() {
                return Err((
                    column,
                    RewriteRefusal::UnknownPlace(at(&AXES, axis) as char),
                ));
            }
        }
        let (Some(_), Some(r)) = (cycle.initial, cycle.r) else {
            return Err((column, RewriteRefusal::CycleLacks('R')));
        };
        let Some(bottom) = cycle.bottom else {
            return Err((column, RewriteRefusal::CycleLacks(letter)));
        };
        let pecks = matches!(cycle.code, 730 | 830);
        if bottom > r {
            return Err((column, RewriteRefusal::CycleDepth));
        }
        if pecks {
            match cycle.peck {
                None | Some(0) => return Err((column, RewriteRefusal::CycleLacks('Q'))),
                Some(q) if (r - bottom) / q > MAX_PECKS / Pm::from(count.max(1)) => {
                    return Err((column, RewriteRefusal::CycleDepth));
                }
                Some(_) => {}
            }
        }
        // Below R LinuxCNC comes back to it in any case. Fanuc's kind begins with G98.
        let comes_back = match self.settings.dialect {
            Some(RewriteDialect::Fanuc) => false,
            Some(RewriteDialect::LinuxCnc) => cycle.initial > cycle.r,
            None => cycle.initial != cycle.r,
        };
        if self.modes.returns_to_r.is_none() && comes_back {
            return Err((column, RewriteRefusal::NoReturn));
        }
        for letter in [b'R', b'Q', b'P', b'K', b'L', b'I', b'J', at(&AXES, normal)] {
            if let Some(word) = given.find(letter) {
                edit.set(word, Action::Drop);
            }
        }
        if let Some((word, _)) = wanted.cycle {
            edit.set(word, Action::Text(b"G0"));
        } else if self.out_motion != Some(Motion::Rapid) {
            edit.code(Motion::Rapid.code());
        }
        self.out_motion = Some(Motion::Rapid);
        self.cycle_in_force = Some(*cycle);
        if count == 0 {
            return Ok(());
        }
        // The first block goes over the hole, at the height where the tool is.
        let axes = given.axes();
        let mut plane_axes: [Option<usize>; 3] = core::array::from_fn(|axis| {
            if axis == normal {
                None
            } else {
                at(&axes, axis)
            }
        });
        let mut begin = target;
        let mut first = [0; 3];
        if rises {
            // The words lead over the hole, and none may stay as it was by chance.
            for word in plane_axes.iter_mut().filter_map(Option::take) {
                edit.set(word, Action::Drop);
            }
            first = by(&before.nominal, &target, normal);
            begin = before.nominal;
            if let Some(slot) = begin.get_mut(normal) {
                *slot = Some(r);
            }
        }
        let image = self.carry(&begin, true, column)?;
        self.write_axes(&plane_axes, &begin, &image, incremental, edit, column)?;
        self.counts.written_out.add(count);
        self.more = More::Holes(Holes {
            count,
            by: if incremental {
                by(&before.nominal, &target, normal)
            } else {
                [0; 3]
            },
            cycle: *cycle,
            normal,
            to_r: self.modes.returns_to_r(),
            hole: 0,
            phase: Phase::Over,
            over: [0; 3],
            depth: 0,
            first,
        });
        Ok(())
    }

    /// Writes the next hole of a cycle that stays; whether there are others.
    pub(in crate::rewrite) fn repeat<S: FnMut(&[u8])>(
        &mut self,
        repeat: &mut Repeat,
        out: &mut Out<'_, S>,
    ) -> bool {
        let Some(next) = moved(&self.place.nominal, &repeat.by) else {
            return false;
        };
        // The cycle is in force: a code would end it, even where none was said before it.
        let said = self.out_motion;
        let motion = said.unwrap_or(Motion::Rapid);
        self.out_motion = Some(motion);
        self.point(motion, next, None, out);
        self.out_motion = said;
        repeat.count -= 1;
        repeat.count > 0
    }

    /// Writes the next motion of holes in G0 and G1; whether there are others.
    pub(in crate::rewrite) fn hole<S: FnMut(&[u8])>(
        &mut self,
        holes: &mut Holes,
        out: &mut Out<'_, S>,
    ) -> bool {
        let Cycle {
            code,
            initial: Some(initial),
            r: Some(r),
            bottom: Some(bottom),
            peck,
            dwell,
            ..
        } = holes.cycle
        else {
            return false;
        };
        // Not zero: see `write_out`.
        let peck = peck.filter(|_| matches!(code, 730 | 830));
        let clearance = pm(self.settings.clearance.0);
        let to_r = holes.to_r || (self.stays_above_r() && initial < r);
        let top = if to_r { r } else { initial };
        let mut to = |rewriter: &mut Self, motion: Motion, height: Pm| {
            let mut place = holes.over;
            if let Some(slot) = place.get_mut(holes.normal) {
                *slot = height;
            }
            rewriter.point(motion, place, None, out);
        };
        holes.phase = match holes.phase {
            Phase::Over => {
                let by = if holes.hole == 0 {
                    holes.first
                } else {
                    holes.by
                };
                let Some(over) = moved(&self.place.nominal, &by) else {
                    return false;
                };
                if holes.hole > 0 || holes.first != [0; 3] {
                    self.point(Motion::Rapid, over, None, out);
                }
                holes.over = over;
                holes.depth = r;
                Phase::Approach
            }
            Phase::Approach => {
                to(self, Motion::Rapid, r);
                Phase::Near
            }
            Phase::Near => {
                if code == 830 && holes.depth < r {
                    to(self, Motion::Rapid, (holes.depth + clearance).min(r));
                }
                Phase::Feed
            }
            Phase::Feed => {
                let depth = peck.map_or(bottom, |peck| (holes.depth - peck).max(bottom));
                to(self, Motion::Line, depth);
                holes.depth = depth;
                if depth > bottom {
                    Phase::Back
                } else {
                    Phase::Dwell
                }
            }
            Phase::Back => {
                let back = if code == 830 {
                    r
                } else {
                    (holes.depth + clearance).min(r)
                };
                to(self, Motion::Rapid, back);
                Phase::Near
            }
            Phase::Dwell => {
                if let (820 | 890, Some(dwell)) = (code, dwell) {
                    out.put(&self.line_ends.added());
                    out.put(if self.spaced { b"G4 P" } else { b"G4P" });
                    emit::number(dwell, out);
                }
                Phase::Out
            }
            Phase::Out => {
                match code {
                    890 if self.stays_above_r() => to(self, Motion::Line, top),
                    850 | 890 => to(self, Motion::Line, r),
                    _ => {}
                }
                Phase::Top
            }
            Phase::Top => {
                to(self, Motion::Rapid, top);
                holes.hole += 1;
                Phase::Over
            }
        };
        holes.phase != Phase::Over || holes.hole < holes.count
    }
}

/// The way in the plane from one place to another.
fn by(from: &[Option<Pm>; 3], to: &[Option<Pm>; 3], normal: usize) -> [Pm; 3] {
    core::array::from_fn(|axis| match (at(from, axis), at(to, axis)) {
        (Some(from), Some(to)) if axis != normal => to - from,
        _ => 0,
    })
}

fn moved(place: &[Option<Pm>; 3], by: &[Pm; 3]) -> Option<[Pm; 3]> {
    let mut moved = *by;
    for (axis, slot) in moved.iter_mut().enumerate() {
        *slot += at(place, axis)?;
    }
    Some(moved)
}
