//! A setup that is complete, or never will be, gets its verdict.

use nalgebra::Vector3;
use umi_protocol::feature::FitReport;
use umi_protocol::job::{Closing, Doubt, FeatureSpec, Job, Lessons, Name, Teach};
use umi_protocol::reason::Reason;
use umi_protocol::verdict::Verdict;

use super::step::{MOST_STEP_MM, Steps};
use super::teach::{Lesson, TeachingAct};
use super::{Decision, Progress, Run, Teaching};
use crate::job::check::{
    closing, datums, fixed, judges_touches, moves_something, not_guarded, place_count,
};
use crate::job::scatter::{Scatter, StatedScatter};
use crate::job::setup;
use crate::job::setup::DatumPoints;
use crate::job::witness::Witness;
use crate::job::witness::skip::{Chatter, Rests};
use crate::units::Point;

impl Run {
    /// Judges the setup under way.
    #[inline(never)]
    pub(super) fn close(&mut self, reason: Option<Reason>, out: &mut impl FnMut(Decision<'_>)) {
        if self.progress != Progress::UnderWay {
            return;
        }
        if self.job.get().is_none() {
            return;
        }
        // Of a setup that is judged again, not what was said when it was OK.
        self.remarks.retain(|remark| {
            !matches!(
                remark,
                Reason::Taught
                    | Reason::TaughtMore { .. }
                    | Reason::TaughtByRun { .. }
                    | Reason::OfRun { .. }
                    | Reason::Witnessed { .. }
                    | Reason::WitnessLearned
                    | Reason::Touched { .. }
                    | Reason::SkipChatter { .. }
            )
        });
        self.against_rest();
        let mut verdict = setup::blank(self.setup);
        let mut measured = DatumPoints::new();
        let taught = self.weigh(reason.as_ref(), &mut verdict, &mut measured);
        if self.older_than.is_none() {
            self.last_run = self.run.or(self.last_run);
        }
        if !verdict.ok {
            // How good the correction is says nothing where there is none.
            verdict.remarks.retain(|remark| {
                !matches!(
                    remark.reason,
                    Reason::Error95 { .. } | Reason::Warmer { .. } | Reason::GrowthLeft { .. }
                )
            });
        }
        if taught {
            let was_asked = self.teaching == TeachingAct::This(Lesson::Reference);
            // Nothing says more of a setup without a run, or is moved by one that moves nothing.
            let matters = self.run.is_some() && self.job.get().is_some_and(moves_something);
            // Who asked elsewhere meant one run, and no line says which: also where what was asked for was NG, and the
            // setup behind it teaches, as a job's first or by a line.
            let elsewhere = core::mem::take(&mut self.asked_elsewhere);
            self.doubt = match self.asked.doubt() {
                _ if elsewhere && matters => Doubt::Unread,
                _ if elsewhere || !was_asked => Doubt::None,
                by => by,
            };
        } else if self.ends_doubt(&verdict) {
            self.no_doubt(out);
        }
        let widens = self.widens(&verdict) | self.has_told_refusal();
        self.add_remarks(taught, &mut verdict);
        if taught {
            self.learned = Lessons::NONE;
            self.learned.smallest = self.shown();
            self.learned.tool_length_mm = self.moved.get().map(|moved| moved.tool_length_mm);
            self.learned.feed_mm_per_min = self.feed_mm_per_min;
            self.learned.doubt = self.doubt;
            self.learned.run = self.run.unwrap_or(0);
            self.learned.asked_in = self.asked_in();
            let learned = &self.learned;
            let places = &measured;
            out(Decision::Taught(Teaching { places, learned }));
            self.reference = Some(measured);
            self.taught_here = true;
        } else if !verdict.ok && core::mem::take(&mut self.taught_here) {
            // What it taught does not hold any more, and who asked elsewhere has not got it.
            out(Decision::Taught(Teaching::NONE));
            self.reference = None;
            self.learned = Lessons::NONE;
            self.asked_elsewhere |= self.doubt == Doubt::Unread;
            self.doubt = Doubt::None;
        } else if widens && let Some(taught) = self.taught() {
            out(Decision::Taught(taught));
        }
        self.order_shown |= verdict.ok && self.run.is_none();
        if !verdict.ok
            && let Some(witness) = self.witness.get_mut()
        {
            witness.unlearn();
        }
        out(Decision::Verdict(&verdict));
        self.verdict.put(verdict);
        self.progress = Progress::Judged;
    }

    /// Whether this setup, which taught nothing, shows that the one that did was meant: it was measured by it; or
    /// that `T2.` is in the program no more, where that was the doubt.
    fn ends_doubt(&self, verdict: &Verdict) -> bool {
        if self.against.contains(&Reason::TaughtTwice) {
            return false;
        }
        let is_whole = self.slots.iter().all(|slot| slot.in_this_setup);
        match self.doubt {
            _ if verdict.ok || self.reference.is_none() => true,
            Doubt::Again => is_whole && self.older_than.is_none(),
            Doubt::None | Doubt::First | Doubt::Unread => false,
        }
    }

    /// Judges what is there of the setup; whether it becomes the reference.
    ///
    /// Not inlined, as [`Self::add_remarks`]: what it needs of the stack is free again when
    /// the verdict is told.
    #[inline(never)]
    fn weigh(
        &self,
        reason: Option<&Reason>,
        verdict: &mut Verdict,
        measured: &mut DatumPoints,
    ) -> bool {
        let Some(job) = self.job.get() else {
            return false;
        };
        for reason in self.against.iter().chain(reason) {
            setup::add(verdict, reason.clone());
        }
        if let Some(began_with) = self.began_with_name() {
            setup::add(verdict, Reason::OrderUnknown { began_with });
        }
        self.against_frame(job, verdict);
        if job.guards.run_variable.is_some() && self.run.is_none() {
            setup::add(verdict, Reason::RunUnknown);
        }
        let all_repeated = self
            .slots
            .iter()
            .all(|slot| slot.in_this_setup && slot.repeated);
        if all_repeated {
            setup::add(verdict, Reason::RepeatedSetup);
        }
        // Of one that was dropped as a whole its reason says all.
        let is_dropped = reason.is_some() && self.slots.iter().all(|slot| !slot.in_this_setup);
        if let (Some(run), Some(last), false) = (self.run, self.older_than, is_dropped) {
            setup::add(verdict, Reason::OldRun { run, last });
        }
        for (place, spec) in job.features.iter().enumerate() {
            match self.in_this_setup(place) {
                None if is_dropped => {}
                None => setup::add(
                    verdict,
                    Reason::MissingFeature {
                        name: spec.name.clone(),
                    },
                ),
                Some(result) => {
                    for reason in &result.reasons {
                        setup::add_about(verdict, Some(&spec.name), reason.clone());
                    }
                }
            }
        }
        if let Some(witness) = self.witness.get() {
            witness.judge(&mut |reason| setup::add(verdict, reason));
        }
        for (place, _) in datums(job).chain(fixed(job)) {
            if let Some(stands_at) = self.stands_at(job, place) {
                // Bounded: the job check limits them together with the datums.
                let _ = measured.push(stands_at);
            }
        }
        self.against_closing(job, verdict);
        self.against_step(job, verdict);
        self.against_unread(verdict);
        self.against_lost_asking(verdict);
        let mut taught = false;
        let complete = measured.len() == place_count(job);
        let may_teach =
            job.teach == Teach::FirstOk || self.teaching == TeachingAct::This(Lesson::Reference);
        match &self.reference {
            // A setup with a reason against it is not judged further: figures
            // from wrong hits would only mislead.
            _ if !verdict.reasons.is_empty() || !complete => {}
            Some(reference) => {
                self.against_fixed(job, reference, verdict);
                let scatter = self.scatter(job);
                setup::judge(
                    verdict,
                    job,
                    reference,
                    measured,
                    scatter.as_ref(),
                    self.run,
                );
            }
            // A job without datum features has nothing to teach.
            None if may_teach || measured.is_empty() => {
                setup::judge_taught(verdict, job, measured);
                taught = verdict.ok && !measured.is_empty();
            }
            None => setup::add(verdict, Reason::NoReference),
        }
        if !verdict.ok && self.reference.is_none() && job.correction.is_some() {
            setup::add(verdict, Reason::NoReference);
        }
        taught
    }

    /// A feature, and those that are this one, probed once more: each with its fit and the points
    /// of it.
    fn times_probed<'a>(
        &'a self,
        job: &'a Job,
        place: usize,
    ) -> impl Iterator<Item = (&'a FeatureSpec, &'a FitReport, &'a [[f64; 3]])> {
        let spec = job.features.get(place);
        let repeats = move |(_, closing): &(usize, &Closing)| {
            spec.is_some_and(|spec| spec.name == closing.repeats)
        };
        let again = closing(job).filter(repeats).map(|(again, _)| again);
        let times = core::iter::once(place).chain(again);
        times.filter_map(|place| {
            let result = self.in_this_setup(place)?;
            let (fit, points) = (result.fit.as_ref()?, &result.points_mm[..]);
            Some((job.features.get(place)?, fit, points))
        })
    }

    /// Holds what stays on the table against where it was taught, each time by itself: a mean
    /// would halve what has happened between them.
    fn against_fixed(&self, job: &Job, reference: &[Point], verdict: &mut Verdict) {
        let Some(limit_mm) = job.guards.fixed_mm else {
            return;
        };
        let taught = reference.iter().skip(datums(job).count());
        for ((place, _), taught) in fixed(job).zip(taught) {
            for (feature, fit, _) in self.times_probed(job, place) {
                if let Some(now) = fit.shape.position_mm() {
                    let now = Point::from_array_mm(now);
                    setup::against_fixed(verdict, limit_mm, &feature.name, *taught, now);
                }
            }
        }
    }

    /// Where a feature stands: the mean of all times that it was probed.
    ///
    /// The same touches at the same place scatter alike, so each counts as much. What moved
    /// between them, within the limit of closing, is halved so.
    fn stands_at(&self, job: &Job, place: usize) -> Option<Point> {
        let (mut sum, mut times) = (Vector3::zeros(), 0.0);
        for (_, fit, _) in self.times_probed(job, place) {
            sum += Vector3::from(fit.shape.position_mm()?);
            times += 1.0;
        }
        (times > 0.0).then(|| Point { mm: sum / times })
    }

    /// Holds what the run says of its work offset against the job.
    fn against_frame(&self, job: &Job, verdict: &mut Verdict) {
        if let Some(moved) = self.moved.get() {
            // What is to be taught is held against nothing that was.
            let is_taught = self.reference.is_some() && self.reference_is_taught();
            let taught_mm = self.learned.tool_length_mm.filter(|_| is_taught);
            setup::against_length(verdict, &job.guards, taught_mm, moved.tool_length_mm);
        }
        let spec = job.correction.as_ref();
        // Where the job says no offset, a program is carried as one of G54, where nothing else
        // moves it. What only measures is moved by what it likes.
        if spec.is_none() && !moves_something(job) {
            return;
        }
        if let Some(frame) = &self.frame {
            setup::against_frame(verdict, spec, frame.offset, frame.origin);
        }
        if let Some(moved) = self.moved.get() {
            setup::against_moved(verdict, spec.map(|_| &job.guards), moved);
        }
        if let Some(by) = self.shifted {
            setup::against_shift(verdict, by);
        }
        if job.guards.frame {
            if self.frame.is_none() || !self.moved.is_some() {
                setup::add(verdict, Reason::FrameUnknown);
            } else if self.shifted.is_none() {
                setup::add(verdict, Reason::ShiftUnknown);
            }
        }
    }

    /// Holds the features that were probed twice against each other.
    fn against_closing(&self, job: &Job, verdict: &mut Verdict) {
        let position = |name: &Name| {
            let place = self.place_of(|feature| feature.name == *name)?;
            let fit = self.in_this_setup(place)?.fit.as_ref()?;
            fit.shape.position_mm().map(Point::from_array_mm)
        };
        for closing in &job.guards.closing {
            // What is missing or refused is told as such.
            if let (Some(first), Some(again)) =
                (position(&closing.repeats), position(&closing.feature))
            {
                setup::against_closing(verdict, closing, first, again);
            }
        }
        self.against_order(job, verdict);
        self.against_fixed_order(job, verdict);
    }

    /// Whether a feature on the table was probed when all datum features had been: one that
    /// stands before them all shows no stylus that was bent behind it.
    fn against_fixed_order(&self, job: &Job, verdict: &mut Verdict) {
        let probed = |place: usize| self.in_this_setup(place).map(|result| result.index);
        let again = closing(job).filter(|(_, of)| job.guards.fixed.contains(&of.repeats));
        let on_table = fixed(job).map(|(place, _)| place);
        let on_table = on_table.chain(again.map(|(place, _)| place));
        let last = on_table.max_by_key(|place| probed(*place));
        let Some((place, index)) = last.and_then(|place| Some((place, probed(place)?))) else {
            return;
        };
        // What is missing is told as such.
        let behind = datums(job).filter(|(datum, _)| probed(*datum) > Some(index));
        if let Some((_, datum)) = behind.max_by_key(|(datum, _)| probed(*datum))
            && let Some(spec) = job.features.get(place)
        {
            let name = datum.name.clone();
            setup::add_about(verdict, Some(&spec.name), Reason::FixedBefore { name });
        }
    }

    /// Whether the order in which they were probed shows what moved: a closing feature comes
    /// behind all datum features, and one of them repeats the first of these. What moved else
    /// moves neither against the other.
    ///
    /// One that does not enclose all with the one that it repeats is told only where none does.
    fn against_order(&self, job: &Job, verdict: &mut Verdict) {
        let probed = |place: usize| self.in_this_setup(place).map(|result| result.index);
        // One on the table says nothing of the part.
        let on_part = |closing: &&Closing| !job.guards.fixed.contains(&closing.repeats);
        // Behind it, then in front of the one that it repeats: which of the two is told.
        for is_behind in [true, false] {
            let mut told = None;
            for closing in job.guards.closing.iter().filter(on_part) {
                let by_name = |name: &Name| self.place_of(|feature| feature.name == *name);
                let (first, again) = (by_name(&closing.repeats), by_name(&closing.feature));
                let (Some(first), Some(again)) = (first.and_then(probed), again.and_then(probed))
                else {
                    continue;
                };
                let outside = datums(job).find(|(place, _)| {
                    // What is missing is told as such.
                    probed(*place).is_some_and(|index| {
                        if is_behind {
                            index > again
                        } else {
                            index < first
                        }
                    })
                });
                match outside {
                    Some((_, outside)) => _ = told.get_or_insert((closing, outside)),
                    None if is_behind => {}
                    None => return,
                }
            }
            if let Some((closing, outside)) = told {
                let (name, first) = (outside.name.clone(), closing.repeats.clone());
                let reason = Reason::NotEnclosed { name, first };
                setup::add_about(verdict, Some(&closing.feature), reason);
                return;
            }
        }
    }

    /// Whether the control rounds to steps that are too coarse for what is moved by its verdicts.
    ///
    /// A ball whose radius is whole steps fits without residuals, rounded or not. So what is
    /// corrected is refused whatever its fits say; what is only taught, as from paper, where they
    /// show it.
    #[inline(never)]
    fn against_step(&self, job: &Job, verdict: &mut Verdict) {
        let step_mm = self.step_mm(job);
        let is_rounded = |place: usize| {
            let fit = self
                .in_this_setup(place)
                .and_then(|result| result.fit.as_ref());
            fit.is_some_and(|fit| fit.rms_mm > 0.05 * step_mm)
        };
        if step_mm > MOST_STEP_MM
            && moves_something(job)
            && (self.reference.is_some() || datums(job).any(|(place, _)| is_rounded(place)))
        {
            setup::add(verdict, Reason::CoarseStep { step_mm });
        }
    }

    /// The coarsest step that the touches of all datum features have in common.
    fn step_mm(&self, job: &Job) -> f64 {
        let mut steps = Steps::default();
        for slot in datums(job).filter_map(|(place, _)| self.slots.get(place)) {
            steps.and(&slot.steps);
        }
        steps.coarsest_mm()
    }

    /// What the features' fits and the job say of the scatter of hits.
    #[inline(never)]
    fn scatter(&self, job: &Job) -> Option<Scatter> {
        let step_mm = self.step_mm(job).min(MOST_STEP_MM);
        let mut stated = StatedScatter::of(job.guards.probing?, step_mm);
        let mut scatter = Scatter::of(&stated, self.reference_is_taught());
        for (place, _) in datums(job) {
            let times = self.times_probed(job, place);
            scatter.add(&mut stated, times.map(|(_, fit, points)| (fit, points)));
        }
        scatter.settle(&stated);
        Some(scatter)
    }

    /// What was noticed and does not change the verdict.
    #[inline(never)]
    fn add_remarks(&mut self, taught: bool, verdict: &mut Verdict) {
        if taught {
            self.remark(Reason::Taught);
            if let (Some(run), Doubt::Unread) = (self.run, self.doubt) {
                self.remark(Reason::TaughtByRun { run });
            }
        }
        if let Some(run) = self.run {
            // Never dropped: what goes out is compared with it.
            if self.remarks.is_full() {
                self.remarks.pop();
            }
            self.remark(Reason::OfRun { run });
        }
        if verdict.ok {
            let witness = self.witness.get_mut().map(Witness::conclude);
            for remark in witness.into_iter().flatten().flatten() {
                let _ = self.remarks.push(remark);
            }
            self.remark_touches();
        }
        for reason in self.remarks.iter().cloned() {
            setup::add_remark(verdict, reason);
        }
        if let Some(skip) = self.skip.get()
            && skip.rests() == Rests::LongerAtTouch
        {
            let rests = skip.active();
            setup::add_remark(verdict, Reason::SkipMayRestAtTouch { rests });
        }
        if let Some(job) = self.job.get() {
            if let Some(open) = not_guarded(job) {
                setup::add_remark(verdict, open);
            }
            // Without `frame` the remark above says it.
            let is_known =
                job.guards.tool_length_mm.is_some() || self.learned.tool_length_mm.is_some();
            if job.guards.frame && self.reference.is_some() && !is_known {
                setup::add_remark(verdict, Reason::LengthNotGuarded);
            }
        }
    }

    /// Whether the skip line rests at the level of a touch. It stays against the setup, whose last feature may come again.
    ///
    /// Not inlined, as [`Self::add_remarks`].
    #[inline(never)]
    fn against_rest(&mut self) {
        if let Some(skip) = self.skip.get()
            && skip.rests() == Rests::AtTouch
        {
            let rests = skip.active();
            self.hold_against(Reason::SkipRestsAtTouch { rests });
        }
    }

    /// What the skip line shows of a setup that is OK: that each hit was touched, and what was
    /// no touch of its own.
    fn remark_touches(&mut self) {
        let Some(job) = self.job.get().filter(|job| judges_touches(job)) else {
            return;
        };
        let Some(skip) = self.skip.get_mut() else {
            return;
        };
        let Chatter { bounces, sparks } = skip.chatter();
        if bounces > 0 || sparks > 0 {
            let _ = self.remarks.push(Reason::SkipChatter { bounces, sparks });
        }
        if job.skip.each_hit {
            let hits = self.features().iter().map(|feature| feature.hits).sum();
            let _ = self.remarks.push(Reason::Touched { hits });
        }
    }

    pub(super) fn next_setup(&mut self) {
        if self.progress == Progress::Judged {
            self.setup = self.setup.saturating_add(1);
            // Its number says nothing of what comes in it now: it may be another clamping. What moves
            // nothing may be measured as often as somebody likes.
            if self.job.get().is_some_and(moves_something) {
                self.older_than = self.older_than.or(self.run);
            }
        }
        for slot in &mut self.slots {
            slot.in_this_setup = false;
        }
        if matches!(self.teaching, TeachingAct::This(_)) && self.progress != Progress::Empty {
            self.teaching = TeachingAct::None;
        }
        self.unwidened.clear();
        self.feed_mm_per_min = self.learned.feed_mm_per_min;
        self.progress = Progress::Empty;
        self.taught_here = false;
        if let Some(witness) = self.witness.get_mut() {
            witness.next_setup();
        }
        self.last = None;
        self.against.clear();
        self.remarks.clear();
    }
}
