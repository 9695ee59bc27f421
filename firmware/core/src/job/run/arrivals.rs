//! Hits become features, and features find their place in the setup.

use umi_protocol::feature::FeatureResult;
use umi_protocol::latch::LatchReport;
use umi_protocol::reason::Reason;

use super::step::Steps;
use super::teach::TeachingAct;
use super::{Decision, Progress, Run, spec_of};
use crate::dprnt::{BlockEnd, ReportedHit};
use crate::job::check::touches_again;
use crate::job::collecting::Collecting;
use crate::job::feature;
use crate::job::reasons::{Reasons, add};
use crate::job::witness::skip::SkipLine;
use crate::units::Micros;

#[derive(Debug, Default)]
pub(super) struct Slot {
    pub(super) result: Option<FeatureResult>,
    pub(super) in_this_setup: bool,
    /// Its points are those of the setup before, to the last digit.
    pub(super) repeated: bool,
    /// The steps that its coordinates have in common.
    pub(super) steps: Steps,
    /// How far beside the centre its hits were approached.
    pub(super) centring_mm: f64,
}

/// Where a finished feature belongs.
pub(super) enum Belongs {
    /// It is the next of this setup.
    Here,
    /// It repeats what is known.
    Dropped,
    /// It takes the place of a refused one.
    Replaces,
    /// It contradicts a good one.
    Contradicts,
    /// It begins another setup.
    NextSetup,
}

impl Run {
    /// The probe's skip line changed and the axes were latched. A later touch before the line
    /// takes its place: the slow touch after the fast one.
    pub fn latched(&mut self, latch: &LatchReport) {
        if let Some(skip) = self.skip.get_mut() {
            // Without encoders it only matters that there was a touch.
            let nowhere = Some([0.0; 3]);
            let mm = (self.witness.get()).map_or(nowhere, |witness| witness.mm(latch));
            skip.latched(latch, mm);
        }
    }

    /// What the skip line has shown of its rest belongs to no setup that is under way now.
    fn skip_begins(&mut self) {
        if let Some(skip) = self.skip.get_mut() {
            skip.begin();
        }
    }

    /// A block of hits begins.
    #[inline(never)]
    pub fn block_start(&mut self, name: &str, now: Micros, out: &mut impl FnMut(Decision<'_>)) {
        self.finish_unfinished(out);
        self.last_hit = now;
        // Its touches are over: what comes while it is printed belongs to the next.
        let touches = self.skip.get_mut().map_or(0, SkipLine::count);
        if !self.is_under_way() {
            self.skip_begins();
        }
        match self.place_of(|feature| feature.name == name) {
            Some(feature) => {
                let mut block = Collecting::new(feature, true);
                block.touches = touches;
                self.collecting.put(block);
            }
            None => self.unknown(name),
        }
    }

    /// A hit arrived.
    #[inline(never)]
    pub fn hit(&mut self, hit: &ReportedHit, now: Micros, out: &mut impl FnMut(Decision<'_>)) {
        self.last_hit = now;
        if let Some(run) = hit.run {
            self.enter_run(run, out);
        }
        let begins = !self.is_under_way();
        let in_block = self.collecting.get().is_some_and(|c| c.in_block);
        if !in_block {
            let place = match (&hit.feature, hit.feature_id) {
                (Some(name), _) => {
                    let place = self.place_of(|feature| feature.name == *name);
                    if place.is_none() {
                        self.unknown(name);
                    }
                    place
                }
                (None, Some(id)) => self.place_of(|feature| feature.id == Some(id)),
                (None, None) => Some(self.next_in_order()),
            };
            let Some(place) = place else {
                return;
            };
            if self.collecting.get().is_none_or(|c| c.feature != place) {
                self.finish_unfinished(out);
                self.collecting.put(Collecting::new(place, false));
            }
        }
        let Some(collecting) = self.collecting.get_mut() else {
            return;
        };
        let Some(spec) = spec_of(&self.job, collecting.feature) else {
            return;
        };
        // Of the taught setup, else of this one's first hit. One reason is enough.
        let feed_mm_per_min = hit.feed_mm_per_min.unwrap_or_default();
        if self.feed_mm_per_min == 0.0 {
            self.feed_mm_per_min = feed_mm_per_min;
        }
        let expected_mm_per_min = self.feed_mm_per_min;
        if feed_mm_per_min != expected_mm_per_min && collecting.reasons.is_empty() {
            let reason = Reason::FeedChanged {
                hit: collecting.next_number(),
                feed_mm_per_min,
                expected_mm_per_min,
            };
            add(&mut collecting.reasons, reason);
        }
        let touch = match (collecting.in_block, self.skip.get_mut()) {
            (false, Some(skip)) => skip.take(),
            _ => None,
        };
        collecting.touches = collecting.touches.saturating_add(touch.is_some().into());
        let seen = self.witness.get().map(|w| w.pair(touch, hit));
        collecting.take(spec, hit, seen);
        if begins && let Some(skip) = self.skip.get_mut() {
            skip.begin();
        }
        if !collecting.in_block && collecting.hits.len() >= usize::from(spec.hits) {
            self.finish(out);
        }
    }

    /// A block of hits ended.
    #[inline(never)]
    pub fn block_end(&mut self, end: &BlockEnd, now: Micros, out: &mut impl FnMut(Decision<'_>)) {
        self.last_hit = now;
        let Some(collecting) = self.collecting.get_mut() else {
            return;
        };
        let Some(spec) = spec_of(&self.job, collecting.feature) else {
            return;
        };
        if let Some(reason) = collecting.block_reason(spec, end) {
            add(&mut collecting.reasons, reason);
        }
        self.finish(out);
    }

    /// A feature that is still being collected when something else begins.
    pub(super) fn finish_unfinished(&mut self, out: &mut impl FnMut(Decision<'_>)) {
        if self.collecting.is_some() {
            self.finish(out);
        }
    }

    /// Fits what was collected, puts it into its setup and reports it; judges the setup
    /// if that was its last feature.
    fn finish(&mut self, out: &mut impl FnMut(Decision<'_>)) {
        let place = self.finish_feature(out);
        let ends = |place: usize| match self.run {
            // In any order: a feature that came again may complete nothing.
            Some(_) => self.slots.iter().all(|slot| slot.in_this_setup),
            None => place + 1 == self.features().len(),
        };
        if place.is_some_and(ends) {
            self.close(None, out);
        }
    }

    /// Fits what was collected, puts it into its setup and reports it. Returns its
    /// place, unless it was dropped as a repeat. On its own, so that its stack is free
    /// again when the setup is judged.
    #[inline(never)]
    fn finish_feature(&mut self, out: &mut impl FnMut(Decision<'_>)) -> Option<usize> {
        let collecting = self.collecting.take()?;
        let place = collecting.feature;
        let (mut result, centring_mm) = self.fitted(&collecting)?;
        let hits = collecting.hits.iter();
        let steps = Steps::of(hits.map(|hit| (hit.approach, hit.position)));
        let belongs = self.belongs(place, &result);
        let replaces = matches!(belongs, Belongs::Replaces);
        match belongs {
            Belongs::Here => {}
            Belongs::Dropped => {
                self.remark(Reason::RepeatDropped { name: result.name });
                return None;
            }
            Belongs::Replaces => self.remark(Reason::Replaced {
                name: result.name.clone(),
            }),
            Belongs::Contradicts => {
                self.hold_against(Reason::ConflictingRepeat);
                add(&mut result.reasons, Reason::ConflictingRepeat);
            }
            Belongs::NextSetup => {
                let was_unfinished = self.progress == Progress::UnderWay;
                self.close(None, out);
                self.next_setup();
                if was_unfinished {
                    // Else it began with the first line of this one.
                    self.skip_begins();
                }
                if collecting.in_block {
                    // Blocks do not say it themselves: what was said of the setup before is
                    // not said of this one.
                    self.run = None;
                    self.frame = None;
                    self.moved.clear();
                    self.shifted = None;
                }
            }
        }
        if let Some(witness) = self.witness.get_mut() {
            witness.take(&collecting.hits, replaces);
        }
        result.index = self.features_seen;
        result.setup = self.setup;
        self.features_seen = self.features_seen.saturating_add(1);
        out(Decision::Feature(&result));
        if let Some(slot) = self.slots.get_mut(place) {
            let before = slot.result.as_ref().filter(|_| !slot.in_this_setup);
            slot.repeated = before.is_some_and(|before| before.points_mm == result.points_mm);
            slot.result = Some(result);
            slot.in_this_setup = true;
            slot.centring_mm = centring_mm;
            slot.steps = steps;
        }
        if self.progress == Progress::Empty {
            if let TeachingAct::Next(lesson) = self.teaching {
                self.teaching = TeachingAct::This(lesson);
            }
            if place > 0 && self.run.is_none() && !self.order_shown && self.began_with.is_none() {
                self.began_with = Some(place);
            }
        }
        self.last = Some(place);
        self.progress = Progress::UnderWay;
        for reason in core::mem::take(&mut self.pending) {
            self.hold_against(reason);
        }
        Some(place)
    }

    /// The feature from its hits, fitted if nothing is against it.
    ///
    /// Not inlined: what it needs of the stack is free again when a setup is judged.
    #[inline(never)]
    fn fitted(&self, collecting: &Collecting) -> Option<(FeatureResult, f64)> {
        let (job, spec) = (self.job.get()?, spec_of(&self.job, collecting.feature)?);
        let Collecting { hits, excess, .. } = collecting;
        let mut reasons = collecting.reasons.clone();
        let got = u16::try_from(hits.len()).unwrap_or(u16::MAX);
        let expected = spec.hits;
        if got < expected && reasons.is_empty() {
            add(&mut reasons, Reason::MissingPoints { got, expected });
        } else if got > expected || *excess > 0 {
            let got = got.saturating_add(*excess);
            add(&mut reasons, Reason::WrongCount { got, expected });
        }
        let touches = collecting.touches;
        if job.skip.each_hit && touches < got {
            add(&mut reasons, Reason::Untouched { hits: got, touches });
        }
        let again = job.again.filter(|_| touches_again(spec));
        feature::find_duplicates(hits, again.is_some(), &mut reasons);
        if let Some(again) = again
            && reasons.is_empty()
        {
            feature::against_again(again.within_mm, hits, &mut reasons);
        }
        let points = feature::contact_points(job.compensation, hits, &mut reasons);
        // What is known to be wrong is not fitted: its figures would only mislead.
        let fit = if reasons.is_empty() {
            feature::judge(
                spec,
                &job.limits,
                &points,
                hits,
                again.is_some(),
                &mut reasons,
            )
        } else {
            None
        };
        let centring_mm = fit
            .as_ref()
            .map_or(0.0, |fit| feature::centring_mm(&fit.shape, &points, hits));
        if let (Some(limits), Some(fit)) = (job.guards.learned, &fit)
            && self.teaching == TeachingAct::None
            && let Some(taught) = self.learned.of(collecting.feature)
        {
            let now = feature::learned(fit, centring_mm);
            feature::against_learned(&limits, taught, &now, &mut reasons);
        }
        let result = FeatureResult {
            index: 0,
            setup: 0,
            name: spec.name.clone(),
            kind: spec.kind,
            reasons,
            points_mm: points.iter().map(|p| p.to_array_mm()).collect(),
            fit,
        };
        Some((result, centring_mm))
    }

    /// Where a finished feature belongs.
    fn belongs(&self, place: usize, result: &FeatureResult) -> Belongs {
        let Some(last) = self.last else {
            return Belongs::Here;
        };
        if place > last && self.progress == Progress::UnderWay {
            return Belongs::Here;
        }
        if self.run.is_some()
            && self.progress == Progress::UnderWay
            && self.in_this_setup(place).is_none()
        {
            return Belongs::Here;
        }
        // What was given up ends where another setup may have begun.
        if self.against.contains(&Reason::GivenUp) {
            return Belongs::NextSetup;
        }
        let judged = self.progress == Progress::Judged;
        // A job of one feature, or a program run again from its start.
        if judged && place == 0 && self.slot_is_ok(place) {
            return Belongs::NextSetup;
        }
        let Some(earlier) = self.in_this_setup(place) else {
            return Belongs::NextSetup;
        };
        // Printed again and not touched again, it has no latches.
        let same =
            |one: &&Reason| !matches!(one, Reason::NotLatched { .. } | Reason::Untouched { .. });
        let reasons =
            |of: &'_ FeatureResult| of.reasons.iter().filter(same).cloned().collect::<Reasons>();
        if earlier.points_mm == result.points_mm && reasons(earlier) == reasons(result) {
            return Belongs::Dropped;
        }
        // A job of one feature: the next part, not the same one again.
        let alone = self.features().len() == 1;
        match (place == last, earlier.is_ok()) {
            (true, false) if !(alone && judged) => Belongs::Replaces,
            (true, true) if place != 0 && !judged => Belongs::Contradicts,
            (true, true) if place != 0 && !result.is_ok() => Belongs::Contradicts,
            _ => Belongs::NextSetup,
        }
    }

    pub(super) fn in_this_setup(&self, place: usize) -> Option<&FeatureResult> {
        let slot = self.slots.get(place)?;
        slot.result.as_ref().filter(|_| slot.in_this_setup)
    }

    fn slot_is_ok(&self, place: usize) -> bool {
        self.in_this_setup(place).is_some_and(FeatureResult::is_ok)
    }
}
