//! Motions, carried and rounded.

use crate::rewrite::block::{AXES, Given, Letters};
use crate::rewrite::moved::plan::{More, Rounded, Target, Wanted, allow, allow_arc};
use crate::rewrite::refusal::RewriteRefusal;
use crate::rewrite::state::{Feed, Motion};
use crate::rewrite::text::emit::{Action, Edit, Out};
use crate::rewrite::text::length::{LIMIT_PM, PM_PER_MM, Pm, Step};
use crate::rewrite::text::words::{At, Number};
use crate::rewrite::{Coupling, Rewriter, at};

/// An image nearer than this to what was written is what was written, pm.
const SAME_PM: f64 = 500.0;

impl Rewriter {
    /// A block that moves.
    pub(in crate::rewrite) fn move_block(
        &mut self,
        given: &Given<'_>,
        wanted: &Wanted,
        edit: &mut Edit,
    ) -> At<()> {
        let axes = given.axes();
        let column = axes
            .iter()
            .flatten()
            .next()
            .copied()
            .or(wanted.motion.map(|(word, _)| word))
            .map_or(0, |index| given.column(index));
        let Some(incremental) = self.modes.incremental else {
            return Err((column, RewriteRefusal::NoDistanceMode));
        };
        self.settle();
        if !self.modes.shift.known {
            return Err((column, RewriteRefusal::WorkOffset));
        }
        if wanted.cycle.is_some() || self.cycle_in_force.is_some() {
            return self.cycle(given, wanted, edit, incremental, column);
        }
        let Some(motion) = self.motion else {
            let reason = if self.lost_motion {
                RewriteRefusal::NoMotionHere
            } else {
                RewriteRefusal::NoMotion
            };
            return Err((column, reason));
        };
        let is_arc = matches!(motion, Motion::Clockwise | Motion::Counter);
        if is_arc {
            allow_arc(given, wanted)?;
        } else {
            allow(given, Letters::default())?;
        }
        let target = self.target(given, incremental)?;
        if is_arc {
            return self.arc(given, wanted, edit, motion, target, incremental, column);
        }
        let is_feed = motion == Motion::Line;
        if is_feed && self.modes.feed == Feed::InverseTime && !given.has(b'F') {
            return Err((column, RewriteRefusal::NoFeed));
        }
        let image = self.carry(&target, is_feed, column)?;
        self.write_axes(&axes, &target, &image, incremental, edit, column)?;
        self.write_motion(wanted, motion, edit);
        self.count_straight(motion);
        Ok(())
    }

    /// A motion that is no arc has been carried out.
    pub(in crate::rewrite) fn count_straight(&mut self, motion: Motion) {
        if motion == Motion::Line {
            self.counts.feeds.add(1);
        } else {
            self.counts.rapids.add(1);
        }
    }

    /// Where the axis words lead, in the frame of the transform.
    pub(in crate::rewrite) fn target(
        &mut self,
        given: &Given<'_>,
        incremental: bool,
    ) -> At<Target> {
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
                    (given.column(index), RewriteRefusal::UnknownPlace(letter))
                })?
            } else {
                at(&self.modes.shift.nominal, axis)
            };
            let place = base + value;
            if place.abs() > LIMIT_PM {
                return Err((given.column(index), RewriteRefusal::OutOfRange));
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
    pub(in crate::rewrite) fn carry(
        &self,
        target: &Target,
        is_feed: bool,
        column: usize,
    ) -> At<[Option<f64>; 3]> {
        if let [Some(x), Some(y), Some(z)] = *target {
            return Ok(self.image([x as f64, y as f64, z as f64]).map(Some));
        }
        let mut image = [None; 3];
        for (axis, slot) in image.iter_mut().enumerate() {
            let row = at(&self.rotation, axis);
            let coupling = at(&self.coupling, axis);
            if at(target, axis).is_none() {
                // It would cut where the part is not any more.
                if is_feed
                    && self.place.at_machine & (1 << axis) != 0
                    && self.translation(axis) != 0.0
                {
                    let letter = at(&AXES, axis) as char;
                    return Err((column, RewriteRefusal::UnknownPlace(letter)));
                }
                // It stands still; its image would move with the others.
                for other in 0..3 {
                    let moves = at(target, other).is_some()
                        && at(target, other) != at(&self.place.nominal, other);
                    let leans = at(&coupling, other);
                    if other != axis && moves && leans != Coupling::None {
                        self.loose(leans, is_feed, axis, column)?;
                    }
                }
                continue;
            }
            let mut sum = self.translation(axis);
            for other in 0..3 {
                let place = match (at(target, other), at(&coupling, other)) {
                    (Some(place), _) => place,
                    (None, Coupling::None) => 0,
                    (None, leans) => {
                        self.loose(leans, is_feed, other, column)?;
                        at(&self.place.last, other)
                    }
                };
                sum += at(&row, other) * place as f64;
            }
            *slot = Some(sum);
        }
        Ok(image)
    }

    /// Whether a motion may go where it depends on an axis whose place is not known.
    fn loose(&self, leans: Coupling, is_feed: bool, axis: usize, column: usize) -> At<()> {
        let letter = at(&AXES, axis) as char;
        if is_feed || leans == Coupling::Large {
            Err((column, RewriteRefusal::UnknownPlace(letter)))
        } else if self.settings.loose_rapids {
            Ok(())
        } else {
            Err((column, RewriteRefusal::RapidOver(letter)))
        }
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
    pub(in crate::rewrite) fn image(&self, p: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = p;
        let row = |axis: usize| {
            let [a, b, c] = at(&self.rotation, axis);
            a * x + b * y + c * z + self.translation(axis)
        };
        [row(0), row(1), row(2)]
    }

    /// Rounds an image and writes it where the words were; the axes are there then.
    pub(in crate::rewrite) fn write_axes(
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
            let is_named = at(axes, axis).is_some();
            let rounded = self.round(axis, image, nominal, is_named, incremental, &step);
            let Some(rounded) = rounded else {
                return Err((
                    column,
                    RewriteRefusal::UnknownPlace(at(&AXES, axis) as char),
                ));
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
    pub(in crate::rewrite) fn arrive(&mut self, axis: usize, nominal: Pm, out: Pm) {
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
        self.place.at_machine &= !(1 << axis);
        if !self.place.relative {
            self.nominal_extent.reach(axis, nominal);
            self.written_extent.reach(axis, out);
        }
    }

    /// The place that will be written for an image, and its word if it needs one. None if
    /// a difference is wanted from a place that is not known.
    #[allow(
        clippy::cast_precision_loss,
        reason = "places are below 2^53 pm times a few"
    )]
    pub(in crate::rewrite) fn round(
        &self,
        axis: usize,
        image: f64,
        nominal: Pm,
        is_named: bool,
        incremental: bool,
        step: &Step,
    ) -> Option<Rounded> {
        let before = at(&self.place.out, axis);
        if !is_named
            && let Some(before) = before
            && (image - before as f64).abs() <= step.half_pm
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
        if is_named {
            let written = nominal - base_nominal;
            if (value - written as f64).abs() < SAME_PM || steps * step.pm == written {
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
    pub(in crate::rewrite) fn write_motion(
        &mut self,
        wanted: &Wanted,
        motion: Motion,
        edit: &mut Edit,
    ) {
        match wanted.motion {
            Some((_, said)) if said == motion => {}
            Some((word, _)) => edit.set(word, Action::Text(motion.code())),
            None if self.out_motion == Some(motion) => {}
            None => edit.code(motion.code()),
        }
        self.out_motion = Some(motion);
    }

    /// Writes the next of the lines that follow a block; whether there are others.
    pub(in crate::rewrite) fn next_line<S: FnMut(&[u8])>(
        &mut self,
        more: &mut More,
        out: &mut Out<'_, S>,
    ) -> bool {
        match more {
            More::Nothing => false,
            More::Chords(chords) => {
                self.point(Motion::Line, chords.place(chords.next), chords.feed, out);
                chords.next += 1;
                chords.next <= chords.count
            }
            More::Repeat(repeat) => self.repeat(repeat, out),
            More::Holes(holes) => self.hole(holes, out),
        }
    }

    /// A line of its own to a nominal place; nothing if the axes are there.
    pub(in crate::rewrite) fn point<S: FnMut(&[u8])>(
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
                false,
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
                    out.put(&self.line_ends.added());
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
            crate::rewrite::text::emit::number(feed, out);
        }
    }
}

/// What a program reaches. In whole picometres: two comparisons of integers for each word,
/// and no division before somebody asks.
#[derive(Clone, Copy, Debug)]
pub(in crate::rewrite) struct Extent {
    low: [Pm; 3],
    high: [Pm; 3],
}

impl Extent {
    pub const NOTHING: Self = Self {
        low: [Pm::MAX; 3],
        high: [Pm::MIN; 3],
    };

    fn reach(&mut self, axis: usize, pm: Pm) {
        if let (Some(low), Some(high)) = (self.low.get_mut(axis), self.high.get_mut(axis)) {
            *low = pm.min(*low);
            *high = pm.max(*high);
        }
    }

    /// The box in mm, from the first motion on; infinite along axes that no word has named.
    pub fn mm(&self) -> Option<[[f64; 3]; 2]> {
        let mm = |pm: Pm| match pm {
            Pm::MAX => f64::INFINITY,
            Pm::MIN => f64::NEG_INFINITY,
            pm => pm as f64 / PM_PER_MM,
        };
        (self.low != Self::NOTHING.low).then(|| [self.low.map(mm), self.high.map(mm)])
    }
}
