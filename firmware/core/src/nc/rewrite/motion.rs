//! Motions: lines, arcs and chords, carried and rounded.

use libm::{fabs, hypot, sqrt};

use super::arc::{Arc, RADII_MM};
use super::block::{AXES, CENTRES, Given};
use super::cycle::{Holes, Repeat};
use super::emit::{Action, Edit, Out};
use super::follow::Wanted;
use super::length::{LIMIT_PM, PM_PER_MM, Pm, Step};
use super::refusal::Reason;
use super::state::{Feed, Motion};
use super::words::{At, Number, Words};
use super::{Coupling, Rewriter, at, pm};

/// Chords of one arc, at most.
const MAX_CHORDS: f64 = 100_000.0;

/// An image nearer than this to what was written is what was written, pm.
const SAME_PM: f64 = 500.0;

/// Lines that follow a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum More {
    Nothing,
    Chords(Chords),
    Repeat(Repeat),
    Holes(Holes),
}

/// The chords of an arc after the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Chords {
    arc: Arc,
    /// First, second and normal axis.
    axes: [usize; 3],
    /// Height at the start and at the end.
    heights: [Pm; 2],
    end: [Pm; 3],
    count: u32,
    /// F of each, where it is inverse time.
    feed: Option<Number>,
}

/// Where a motion goes to.
pub(super) type Target = [Option<Pm>; 3];

impl Rewriter<'_> {
    /// A block that moves.
    pub(super) fn move_block(
        &mut self,
        words: &Words,
        given: &Given<'_>,
        wanted: &Wanted,
        edit: &mut Edit,
    ) -> At<More> {
        let axes = given.axes();
        let column = axes
            .iter()
            .flatten()
            .next()
            .copied()
            .or(wanted.motion.map(|(word, _)| word))
            .map_or(0, |index| given.column(index));
        let Some(incremental) = self.modes.incremental else {
            return Err((column, Reason::NoDistanceMode));
        };
        self.settle();
        if !self.modes.shift.known {
            return Err((column, Reason::WorkOffset));
        }
        if wanted.cycle.is_some() || self.modes.cycle.is_some() {
            return self.cycle(words, given, wanted, edit, incremental, column);
        }
        let Some(motion) = self.motion else {
            return Err((column, Reason::NoMotion));
        };
        let is_arc = matches!(motion, Motion::Clockwise | Motion::Counter);
        allow(words, if is_arc { b"IJKR" } else { b"" })?;
        let target = self.target(given, incremental)?;
        if is_arc {
            return self.arc(given, wanted, edit, motion, target, incremental, column);
        }
        let is_feed = motion == Motion::Line;
        if is_feed && self.modes.feed == Feed::InverseTime && !given.has(b'F') {
            return Err((column, Reason::NoFeed));
        }
        let image = self.carry(&target, is_feed, column)?;
        self.write_axes(&axes, &target, &image, incremental, edit, column)?;
        self.write_motion(wanted, motion, edit);
        if is_feed {
            self.summary.feeds += 1;
        } else {
            self.summary.rapids += 1;
        }
        Ok(More::Nothing)
    }

    /// Where the axis words lead, in the frame of the transform.
    pub(super) fn target(&mut self, given: &Given<'_>, incremental: bool) -> At<Target> {
        let axes = given.axes();
        let mut target = self.place.nominal;
        if !incremental && self.place.relative {
            // Now it is absolute; what is not named could be anywhere.
            self.forget_all();
            self.place.relative = false;
            target = self.place.nominal;
        }
        for (axis, index) in axes.iter().enumerate() {
            let Some(index) = *index else { continue };
            let value = self.length(given, index)?;
            let base = if incremental {
                at(&self.place.nominal, axis).ok_or_else(|| {
                    let letter = at(&AXES, axis) as char;
                    (given.column(index), Reason::UnknownPlace(letter))
                })?
            } else {
                at(&self.modes.shift.nominal, axis)
            };
            let place = base + value;
            if place.abs() > LIMIT_PM {
                return Err((given.column(index), Reason::OutOfRange));
            }
            if let Some(slot) = target.get_mut(axis) {
                *slot = Some(place);
            }
        }
        Ok(target)
    }

    /// The image of a place, pm. An axis that is not known stands still.
    #[allow(
        clippy::cast_precision_loss,
        reason = "places are below 2^53 pm times a few"
    )]
    pub(super) fn carry(
        &self,
        target: &Target,
        is_feed: bool,
        column: usize,
    ) -> At<[Option<f64>; 3]> {
        if let [Some(x), Some(y), Some(z)] = *target {
            return Ok(self.image([x as f64, y as f64, z as f64]).map(Some));
        }
        let unknown = |axis: usize| {
            let letter = at(&AXES, axis) as char;
            Err((column, Reason::UnknownPlace(letter)))
        };
        let mut image = [None; 3];
        for (axis, slot) in image.iter_mut().enumerate() {
            let row = at(&self.rotation, axis);
            let coupling = at(&self.coupling, axis);
            if at(target, axis).is_none() {
                // It stands still; its image would move with the others.
                for other in 0..3 {
                    let moves = at(target, other).is_some()
                        && at(target, other) != at(&self.place.nominal, other);
                    let allowed = match at(&coupling, other) {
                        Coupling::None => true,
                        Coupling::Small => !is_feed,
                        Coupling::Large => false,
                    };
                    if other != axis && moves && !allowed {
                        return unknown(axis);
                    }
                }
                continue;
            }
            let mut sum = self.translation(axis);
            for other in 0..3 {
                let place = match (at(target, other), at(&coupling, other)) {
                    (Some(place), _) => place,
                    (None, Coupling::None) => 0,
                    (None, Coupling::Small) if !is_feed => at(&self.place.last, other),
                    _ => return unknown(other),
                };
                sum += at(&row, other) * place as f64;
            }
            *slot = Some(sum);
        }
        Ok(image)
    }

    fn translation(&self, axis: usize) -> f64 {
        if self.place.relative {
            0.0
        } else {
            at(&self.translation_pm, axis)
        }
    }

    /// `R p + t`, pm.
    #[inline]
    pub(super) fn image(&self, p: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = p;
        let row = |axis: usize| {
            let [a, b, c] = at(&self.rotation, axis);
            a * x + b * y + c * z + self.translation(axis)
        };
        [row(0), row(1), row(2)]
    }

    /// Rounds an image and writes it where the words were; the axes are there then.
    pub(super) fn write_axes(
        &mut self,
        axes: &[Option<usize>; 3],
        target: &Target,
        image: &[Option<f64>; 3],
        incremental: bool,
        edit: &mut Edit,
        column: usize,
    ) -> At<()> {
        let step = self.step();
        for axis in 0..3 {
            let (Some(image), Some(nominal)) = (at(image, axis), at(target, axis)) else {
                continue;
            };
            let rounded = self.round(axis, image, nominal, at(axes, axis), incremental, &step);
            let Some(rounded) = rounded else {
                return Err((column, Reason::UnknownPlace(at(&AXES, axis) as char)));
            };
            match (rounded.steps, at(axes, axis)) {
                (None, _) => {}
                (Some(steps), Some(word)) => edit.set(word, Action::Length(steps, step.decimals)),
                (Some(steps), None) => edit.add(at(&AXES, axis), steps, step.decimals),
            }
            self.arrive(axis, nominal, rounded.out);
        }
        Ok(())
    }

    /// An axis is where the program and the words say.
    pub(super) fn arrive(&mut self, axis: usize, nominal: Pm, out: Pm) {
        for (slots, pm) in [
            (&mut self.place.nominal, nominal),
            (&mut self.place.out, out),
        ] {
            if let Some(slot) = slots.get_mut(axis) {
                *slot = Some(pm);
            }
        }
        if let Some(slot) = self.place.last.get_mut(axis) {
            *slot = nominal;
        }
        if !self.place.relative {
            reach(&mut self.summary.nominal_mm, axis, nominal);
            reach(&mut self.summary.written_mm, axis, out);
        }
    }

    /// The place that will be written for an image, and its word if it needs one. None if
    /// a difference is wanted from a place that is not known.
    #[allow(
        clippy::cast_precision_loss,
        reason = "places are below 2^53 pm times a few"
    )]
    pub(super) fn round(
        &self,
        axis: usize,
        image: f64,
        nominal: Pm,
        word: Option<usize>,
        incremental: bool,
        step: &Step,
    ) -> Option<Rounded> {
        let before = at(&self.place.out, axis);
        if word.is_none()
            && let Some(before) = before
            && fabs(image - before as f64) <= step.pm as f64 / 2.0
        {
            return Some(Rounded {
                out: before,
                steps: None,
            });
        }
        let (base, base_nominal) = if incremental {
            (before?, at(&self.place.nominal, axis)?)
        } else {
            (
                at(&self.modes.shift.out, axis),
                at(&self.modes.shift.nominal, axis),
            )
        };
        let value = image - base as f64;
        let steps = step.count(value);
        if word.is_some() {
            let written = nominal - base_nominal;
            if fabs(value - written as f64) < SAME_PM || steps * step.pm == written {
                return Some(Rounded {
                    out: base + written,
                    steps: None,
                });
            }
        }
        Some(Rounded {
            out: base + steps * step.pm,
            steps: Some(steps),
        })
    }

    /// Sees to it that the control is in this motion.
    pub(super) fn write_motion(&mut self, wanted: &Wanted, motion: Motion, edit: &mut Edit) {
        match wanted.motion {
            Some((_, said)) if said == motion => {}
            Some((word, _)) => edit.set(word, Action::Text(motion.code())),
            None if self.out_motion == Some(motion) => {}
            None => edit.code(motion.code()),
        }
        self.out_motion = Some(motion);
    }

    #[allow(clippy::too_many_arguments, reason = "one call, one block")]
    fn arc(
        &mut self,
        given: &Given<'_>,
        wanted: &Wanted,
        edit: &mut Edit,
        motion: Motion,
        target: Target,
        incremental: bool,
        column: usize,
    ) -> At<More> {
        let all = |places: &Target| -> At<[Pm; 3]> {
            let mut known = [0; 3];
            for (axis, slot) in known.iter_mut().enumerate() {
                *slot = at(places, axis)
                    .ok_or((column, Reason::UnknownPlace(at(&AXES, axis) as char)))?;
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
            return Err((given.column(index), Reason::Meaningless(letter)));
        }
        let inverse = self.modes.feed == Feed::InverseTime;
        let feed = given.number(b'F')?;
        if inverse && feed.is_none() {
            return Err((column, Reason::NoFeed));
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
                            return Err((column, Reason::Arc));
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
            return Err((column, Reason::Arc));
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
            self.summary.arcs += 1;
            return Ok(More::Nothing);
        }
        if self.modes.compensated {
            return Err((column, Reason::Tilted(plane.letter())));
        }
        self.chords(given, wanted, edit, &arc, &ends, incremental, column)
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
                Rounded {
                    out,
                    steps: (word.is_some() && steps * step.pm == out - base).then_some(steps),
                }
            } else {
                self.round(
                    axis,
                    at(&image, axis),
                    at(&ends.end, axis),
                    word,
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
                    && fabs(made.sweep - sweep) * arc.radii[0] <= 6.0 * step_mm + 2.0 * drift
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
    ) -> At<More> {
        let step = self.step();
        // Rounding takes its part: half the diagonal of a step.
        let rounding = step.pm as f64 / PM_PER_MM * sqrt(3.0) / 2.0;
        let count = arc.chords(self.settings.chord.0 - rounding);
        if count > MAX_CHORDS {
            return Err((column, Reason::TooManyChords));
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
                    .ok_or((column, Reason::OutOfRange))?,
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
            feed,
        };
        for letter in *b"IJKR" {
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
        self.summary.chorded += 1;
        self.summary.chords += u64::from(count);
        Ok(if count > 1 {
            More::Chords(chords)
        } else {
            More::Nothing
        })
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
                if let Some(rounded) = self.round(axis, image, nominal, word, incremental, &step) {
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

    /// Writes the lines that follow a block.
    pub(super) fn more<S: FnMut(&[u8])>(&mut self, more: &More, out: &mut Out<'_, S>) {
        match more {
            More::Nothing => {}
            More::Chords(chords) => {
                for number in 2..=chords.count {
                    self.point(Motion::Line, chords.place(number), chords.feed, out);
                }
            }
            More::Repeat(repeat) => self.repeat(repeat, out),
            More::Holes(holes) => self.holes(holes, out),
        }
    }

    /// A line of its own to a nominal place; nothing if the axes are there.
    pub(super) fn point<S: FnMut(&[u8])>(
        &mut self,
        motion: Motion,
        nominal: [Pm; 3],
        feed: Option<Number>,
        out: &mut Out<'_, S>,
    ) {
        let step = self.step();
        let incremental = self.modes.incremental == Some(true);
        let image = self.image(nominal.map(|pm| pm as f64));
        let spaced = self.spaced;
        let mut begun = false;
        for axis in 0..3 {
            // All places are known where this is called.
            let Some(rounded) = self.round(
                axis,
                at(&image, axis),
                at(&nominal, axis),
                None,
                incremental,
                &step,
            ) else {
                continue;
            };
            if let Some(steps) = rounded.steps {
                if begun {
                    if spaced {
                        out.put(b" ");
                    }
                } else {
                    begun = true;
                    out.put(&self.line_end());
                    if self.out_motion != Some(motion) {
                        self.out_motion = Some(motion);
                        out.put(motion.code());
                        if spaced {
                            out.put(b" ");
                        }
                    }
                }
                out.length(at(&AXES, axis), steps, step.decimals);
            }
            self.arrive(axis, at(&nominal, axis), rounded.out);
        }
        if begun && let Some(feed) = feed {
            if spaced {
                out.put(b" ");
            }
            out.put(b"F");
            super::emit::number(feed, out);
        }
    }
}

impl Chords {
    /// Where a chord ends, from 1.
    fn place(&self, number: u32) -> [Pm; 3] {
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

/// A rounded place, and its word if it needs one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Rounded {
    pub out: Pm,
    pub steps: Option<i64>,
}

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

/// Refuses words that a motion does not take.
pub(super) fn allow(words: &Words, letters: &[u8]) -> At<()> {
    let calls = words.iter().any(|word| word.letter == b'M');
    let has_work = words.iter().any(|word| word.letter == b'G');
    for word in words {
        let letter = word.letter;
        let is_known = b"XYZABCNOGMFSTHD,".contains(&letter)
            || letters.contains(&letter)
            // Of M98, or of G54.1.
            || (calls && matches!(letter, b'P' | b'L'))
            || (has_work && letter == b'P');
        if !is_known {
            return Err((word.start, Reason::Meaningless(letter as char)));
        }
    }
    Ok(())
}

/// Extends what a program reaches; the box is there once all axes are known.
fn reach(extent: &mut Option<[[f64; 3]; 2]>, axis: usize, pm: Pm) {
    let mm = pm as f64 / PM_PER_MM;
    let [low, high] = extent.get_or_insert([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]]);
    if let Some(slot) = low.get_mut(axis) {
        *slot = slot.min(mm);
    }
    if let Some(slot) = high.get_mut(axis) {
        *slot = slot.max(mm);
    }
}
