//! Arcs of a program: carried as arcs where a control makes of the rounded words what the
//! image is, else as chords.

use libm::{fabs, hypot, sqrt};

use super::arc::{Arc, RADII_MM};
use crate::rewrite::block::{AXES, CENTRES, Given};
use crate::rewrite::moved::plan::{Chords, More, Rounded, Target, Wanted, is_p_of_others};
use crate::rewrite::refusal::RewriteRefusal;
use crate::rewrite::state::{Feed, Motion};
use crate::rewrite::text::emit::{Action, Edit};
use crate::rewrite::text::length::{PM_PER_MM, Pm};
use crate::rewrite::text::words::{At, Number};
use crate::rewrite::{RewriteDialect, Rewriter, at, pm};

/// Turns of one arc, at most.
pub(in crate::rewrite) const MAX_TURNS: u32 = 1000;
/// Chords of one arc, at most.
const MAX_CHORDS: f64 = 100_000.0;

/// Where an arc begins and ends, nominal, and what was written at its start.
struct Ends {
    start: [Pm; 3],
    end: [Pm; 3],
    out: [Pm; 3],
}

/// An arc that stays one.
struct Kept {
    rounded: [Rounded; 3],
    /// None if its R stays.
    centers: Option<[CenterWord; 2]>,
    left: bool,
}

#[derive(Clone, Copy, Debug, Default)]
struct CenterWord {
    axis: usize,
    steps: i64,
}

impl Chords {
    /// Where a chord ends, from 1.
    pub(in crate::rewrite) fn place(&self, number: u32) -> [Pm; 3] {
        if number >= self.count {
            return self.end;
        }
        let part = f64::from(number) / f64::from(self.count);
        let [a, b] = self.arc.at(part);
        let [from, to] = self.heights;
        let height = from as f64 + (to - from) as f64 * part;
        let [first, second, normal] = self.axes;
        let mut place = [0; 3];
        for (axis, value) in [(first, pm(a)), (second, pm(b)), (normal, height as Pm)] {
            if let Some(slot) = place.get_mut(axis) {
                *slot = value;
            }
        }
        place
    }
}

impl Rewriter {
    #[allow(clippy::too_many_arguments, reason = "one call, one block")]
    pub(in crate::rewrite) fn arc(
        &mut self,
        given: &Given<'_>,
        wanted: &Wanted,
        edit: &mut Edit,
        motion: Motion,
        target: Target,
        incremental: bool,
        column: usize,
    ) -> At<()> {
        let all = |places: &Target| -> At<[Pm; 3]> {
            let mut known = [0; 3];
            for (axis, slot) in known.iter_mut().enumerate() {
                *slot = at(places, axis).ok_or((
                    column,
                    RewriteRefusal::UnknownPlace(at(&AXES, axis) as char),
                ))?;
            }
            Ok(known)
        };
        let start = all(&self.place.nominal)?;
        let end = all(&target)?;
        let out = all(&self.place.out)?;
        let plane = self.modes.plane;
        let [first, second, normal] = plane.axes;
        if let Some(index) = given.find(at(&CENTRES, normal)) {
            let letter = at(&CENTRES, normal) as char;
            return Err((given.column(index), RewriteRefusal::Meaningless(letter)));
        }
        let inverse = self.modes.feed == Feed::InverseTime;
        let feed = given.number(b'F')?;
        if inverse && feed.is_none() {
            return Err((column, RewriteRefusal::NoFeed));
        }
        let left = motion == Motion::Counter;
        let mm = |pm: Pm| pm as f64 / PM_PER_MM;
        let flat = |p: &[Pm; 3]| [mm(at(p, first)), mm(at(p, second))];
        let center_words = [first, second].map(|axis| given.find(at(&CENTRES, axis)));
        let has_center = center_words.iter().any(Option::is_some);
        let arc = match self.length_of(given, b'R')? {
            Some(_) if has_center => None,
            Some(radius) => Arc::with_radius(flat(&start), flat(&end), mm(radius), left),
            None if !has_center => None,
            None => {
                let mut center = flat(&start);
                for ((slot, word), axis) in center.iter_mut().zip(center_words).zip([first, second])
                {
                    let value = match word {
                        Some(word) => self.length(given, word)?,
                        None => 0,
                    };
                    *slot = if self.modes.absolute_centres {
                        // The one that is not named is the program's zero: refuse that.
                        if word.is_none() {
                            return Err((column, RewriteRefusal::Arc));
                        }
                        mm(value + at(&self.modes.shift.nominal, axis))
                    } else {
                        *slot + mm(value)
                    };
                }
                Arc::about(flat(&start), flat(&end), center, left)
            }
        };
        let Some(arc) = arc else {
            return Err((column, RewriteRefusal::Arc));
        };
        let arc = match self.turns(given, wanted)? {
            0 => arc,
            turns => arc.with_turns(turns),
        };
        let ends = Ends { start, end, out };
        if let Some(kept) = self.kept(given, &arc, &ends, left, incremental) {
            self.write_kept(given, &kept, &ends, edit);
            let said = if kept.left {
                Motion::Counter
            } else {
                Motion::Clockwise
            };
            self.write_motion(wanted, said, edit);
            self.counts.arcs.add(1);
            return Ok(());
        }
        if self.modes.compensated {
            return Err((column, RewriteRefusal::Tilted(plane.letter())));
        }
        self.chords(given, wanted, edit, &arc, &ends, incremental, column)
    }

    /// Whole turns that P adds, where it counts them.
    fn turns(&self, given: &Given<'_>, wanted: &Wanted) -> At<u32> {
        let Some(word) = given.find(b'P') else {
            return Ok(0);
        };
        if is_p_of_others(given, wanted) {
            return Ok(0);
        }
        if self.settings.dialect != Some(RewriteDialect::LinuxCnc) {
            return Err((given.column(word), RewriteRefusal::Turns));
        }
        match given.whole(b'P')? {
            Some(turns @ 1..=MAX_TURNS) => Ok(turns - 1),
            _ => Err((given.column(word), RewriteRefusal::TurnsOutOfRange)),
        }
    }

    /// The arc that a control will make of rounded words, if it is the image within the
    /// tolerance.
    fn kept(
        &self,
        given: &Given<'_>,
        arc: &Arc,
        ends: &Ends,
        left: bool,
        incremental: bool,
    ) -> Option<Kept> {
        let [first, second, normal] = self.modes.plane.axes;
        let step = self.step();
        let tolerance = self.settings.chord.0;
        let step_mm = step.pm as f64 / PM_PER_MM;
        // The normal's image, and how far it leans.
        let lean = |axis: usize| at(&at(&self.rotation, axis), normal);
        let tilt = hypot(lean(first), lean(second));
        let up = lean(normal) > 0.0;
        let rise = fabs((at(&ends.end, normal) - at(&ends.start, normal)) as f64) / PM_PER_MM;
        let drift = rise * tilt;
        let off = arc.bow() * tilt + drift + arc.radii[0] * tilt * tilt;
        // Written out, so that what is no number is not kept.
        let fits = off + 1.5 * step_mm <= tolerance && drift <= RADII_MM / 3.0;
        if !fits || arc.radii[0] < 3.0 * step_mm {
            return None;
        }
        // A whole turn that ends beside its start is none.
        if arc.is_full() && drift > 1e-6 {
            return None;
        }
        if self.modes.compensated && !up {
            return None;
        }
        let left = left == up;
        let axes = given.axes();
        let float = |p: &[Pm; 3]| p.map(|pm| pm as f64);
        let image = self.image(float(&ends.end));
        let mut rounded = [Rounded::default(); 3];
        let full = arc.is_full();
        for (axis, slot) in rounded.iter_mut().enumerate() {
            let word = at(&axes, axis);
            *slot = if full && axis != normal && at(&ends.end, axis) == at(&ends.start, axis) {
                // Back to the same place: not one rounding step beside it.
                let out = at(&ends.out, axis);
                let base = if incremental {
                    out
                } else {
                    at(&self.modes.shift.out, axis)
                };
                let steps = (out - base) / step.pm;
                // A place written in the other unit may have no word in this one.
                if word.is_some() && steps * step.pm != out - base {
                    return None;
                }
                Rounded {
                    out,
                    steps: word.map(|_| steps),
                }
            } else {
                self.round(
                    axis,
                    at(&image, axis),
                    at(&ends.end, axis),
                    word.is_some(),
                    incremental,
                    &step,
                )?
            };
        }
        // The centre at the height of the start, seen from what was written there.
        let mut center = [0.0; 3];
        for (slot, value) in [
            (first, arc.center[0] * PM_PER_MM),
            (second, arc.center[1] * PM_PER_MM),
            (normal, at(&ends.start, normal) as f64),
        ] {
            if let Some(c) = center.get_mut(slot) {
                *c = value;
            }
        }
        let center = self.image(center);
        let flat = |p: &[f64; 3]| [at(p, first) / PM_PER_MM, at(p, second) / PM_PER_MM];
        let written_start = flat(&float(&ends.out));
        let written_end = flat(&float(&rounded.map(|r| r.out)));
        let judge = |made: Option<Arc>| {
            made.filter(|made| {
                let apart = hypot(
                    made.center[0] - at(&center, first) / PM_PER_MM,
                    made.center[1] - at(&center, second) / PM_PER_MM,
                );
                let sweep = if left == (arc.sweep > 0.0) {
                    arc.sweep
                } else {
                    -arc.sweep
                };
                fabs(made.radii[0] - made.radii[1]) <= RADII_MM / 2.0
                    && apart <= (2.0 * step_mm + drift).min(tolerance / 2.0)
                    && fabs(made.with_turns(arc.turns).sweep - sweep) * arc.radii[0]
                        <= 6.0 * step_mm + 2.0 * drift
            })
            .is_some()
        };
        if let Some(index) = given.find(b'R') {
            let radius = self.length(given, index).ok()? as f64 / PM_PER_MM;
            let chord = hypot(
                written_end[0] - written_start[0],
                written_end[1] - written_start[1],
            );
            // Too short by rounding is an alarm on many controls.
            if chord <= 2.0 * fabs(radius)
                && judge(Arc::with_radius(written_start, written_end, radius, left))
            {
                return Some(Kept {
                    rounded,
                    centers: None,
                    left,
                });
            }
        }
        let mut centers = [CenterWord::default(); 2];
        let mut written_center = [0.0; 2];
        for ((slot, axis), written) in centers
            .iter_mut()
            .zip([first, second])
            .zip(written_center.iter_mut())
        {
            let base = if self.modes.absolute_centres {
                at(&self.modes.shift.out, axis)
            } else {
                at(&ends.out, axis)
            };
            let steps = step.count(at(&center, axis) - base as f64);
            *slot = CenterWord { axis, steps };
            *written = (base + steps * step.pm) as f64 / PM_PER_MM;
        }
        let made = Arc::about(written_start, written_end, written_center, left);
        judge(made).then_some(Kept {
            rounded,
            centers: Some(centers),
            left,
        })
    }

    fn write_kept(&mut self, given: &Given<'_>, kept: &Kept, ends: &Ends, edit: &mut Edit) {
        let step = self.step();
        let axes = given.axes();
        for axis in 0..3 {
            let rounded = at(&kept.rounded, axis);
            match (rounded.steps, at(&axes, axis)) {
                (None, _) => {}
                (Some(steps), Some(word)) => edit.set(word, Action::Length(steps, step.decimals)),
                (Some(steps), None) => edit.add(at(&AXES, axis), steps, step.decimals),
            }
            self.arrive(axis, at(&ends.end, axis), rounded.out);
        }
        let Some(centers) = kept.centers else { return };
        if let Some(word) = given.find(b'R') {
            edit.set(word, Action::Drop);
        }
        for CenterWord { axis, steps } in centers {
            let letter = at(&CENTRES, axis);
            match given.find(letter) {
                Some(word) => {
                    let same = self.length(given, word) == Ok(steps * step.pm);
                    if !same {
                        edit.set(word, Action::Length(steps, step.decimals));
                    }
                }
                None if steps != 0 || self.modes.absolute_centres => {
                    edit.add(letter, steps, step.decimals);
                }
                // An arc needs one of them.
                None => {}
            }
        }
    }

    #[allow(clippy::too_many_arguments, reason = "one call, one block")]
    fn chords(
        &mut self,
        given: &Given<'_>,
        wanted: &Wanted,
        edit: &mut Edit,
        arc: &Arc,
        ends: &Ends,
        incremental: bool,
        column: usize,
    ) -> At<()> {
        let step = self.step();
        // Rounding takes its part: half the diagonal of a step.
        let rounding = step.pm as f64 / PM_PER_MM * sqrt(3.0) / 2.0;
        let count = arc.chords(self.settings.chord.0 - rounding);
        if count > MAX_CHORDS {
            return Err((column, RewriteRefusal::TooManyChords));
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "bounded"
        )]
        let count = count as u32;
        let normal = self.modes.plane.normal();
        let feed = given
            .number(b'F')?
            .filter(|_| self.modes.feed == Feed::InverseTime);
        let feed = match feed {
            Some(number) => Some(Number {
                digits: number
                    .digits
                    .checked_mul(i64::from(count))
                    .ok_or((column, RewriteRefusal::OutOfRange))?,
                has_point: true,
                ..number
            }),
            None => None,
        };
        let chords = Chords {
            arc: *arc,
            axes: self.modes.plane.axes,
            heights: [at(&ends.start, normal), at(&ends.end, normal)],
            end: ends.end,
            count,
            next: 2,
            feed,
        };
        // A P that counts turns means nothing on a line.
        let letters: &[u8] = if is_p_of_others(given, wanted) {
            b"IJKR"
        } else {
            b"IJKRP"
        };
        for &letter in letters {
            if let Some(word) = given.find(letter) {
                edit.set(word, Action::Drop);
            }
        }
        if let (Some(number), Some(word)) = (feed, given.find(b'F'))
            && count > 1
        {
            edit.set(word, Action::Length(number.digits, number.decimals));
        }
        let axes = given.axes();
        let target = chords.place(1).map(Some);
        let image = self.carry(&target, true, column)?;
        // The words of the end are not those of the first chord.
        for word in axes.iter().flatten() {
            edit.set(*word, Action::Keep);
        }
        self.write_chord(&axes, &target, &image, incremental, edit, count > 1);
        self.write_motion(wanted, Motion::Line, edit);
        self.counts.chorded.add(1);
        self.counts.chords.add(count);
        if count > 1 {
            self.more = More::Chords(chords);
        }
        Ok(())
    }

    /// The first chord in the words of the arc: a word never stays as it was by chance.
    fn write_chord(
        &mut self,
        axes: &[Option<usize>; 3],
        target: &Target,
        image: &[Option<f64>; 3],
        incremental: bool,
        edit: &mut Edit,
        is_part: bool,
    ) {
        let step = self.step();
        for axis in 0..3 {
            let (Some(image), Some(nominal)) = (at(image, axis), at(target, axis)) else {
                continue;
            };
            let word = at(axes, axis);
            if !is_part || word.is_none() {
                if let Some(rounded) =
                    self.round(axis, image, nominal, word.is_some(), incremental, &step)
                {
                    match (rounded.steps, word) {
                        (None, _) => {}
                        (Some(steps), Some(word)) => {
                            edit.set(word, Action::Length(steps, step.decimals));
                        }
                        (Some(steps), None) => edit.add(at(&AXES, axis), steps, step.decimals),
                    }
                    self.arrive(axis, nominal, rounded.out);
                }
                continue;
            }
            let base = if incremental {
                at(&self.place.out, axis).unwrap_or_default()
            } else {
                at(&self.modes.shift.out, axis)
            };
            let steps = step.count(image - base as f64);
            if let Some(word) = word {
                edit.set(word, Action::Length(steps, step.decimals));
            }
            self.arrive(axis, nominal, base + steps * step.pm);
        }
    }
}
