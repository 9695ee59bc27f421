//! The job as a state machine: hits and time in, features and verdicts out.
//!
//! # How hits find their setup
//!
//! Lines that carry a run number say themselves what belongs together: the features
//! of a run come in any order, a setup (one clamping) is judged when all are there,
//! and another run begins another setup.
//!
//! Elsewhere the program probes the features in the job's order, so a setup begins
//! with the job's first feature and is judged when the last one arrives. A feature that comes earlier in the order than the one before
//! it begins the next setup, and the unfinished one is NG. So a lost block
//! never shifts the blocks that follow into the wrong clamping.
//!
//! Where a control begins in the middle of that order and nothing has shown yet that it
//! keeps it, it may as well probe in another one, and every setup would be made of two
//! clampings. So all are NG until the control reads (by DC1, or by a line that asks for a program),
//! nothing comes for the time-out, or somebody asks to teach.
//!
//! The feature that came last may come again: unchanged it is dropped, and a
//! refused one is replaced (its setup is judged again, under the same number).
//! Sent again with other coordinates, it is not known which is right: NG. A
//! whole setup that is printed again to the last digit was not measured again
//! (a control that restarts a program repeats its output): NG too.

use heapless::Vec;
use umi_protocol::fault::FaultKind;
use umi_protocol::feature::FeatureResult;
use umi_protocol::job::{FeatureSpec, Job, Learned, Lessons, MAX_FEATURES, Name, Reference, Teach};
use umi_protocol::latch::LatchReport;
use umi_protocol::message::{TeachBy, TeachPending, TeachRefusal, TeachSetup, TeachWhat};
use umi_protocol::reason::Reason;
use umi_protocol::verdict::Verdict;

use super::check::{datums, fixed, not_guarded, place_count, touches_again};
use super::collecting::Collecting;
use super::feature;
use super::reasons::{Reasons, add};
use super::scatter::Scatter;
use super::setup::{self, DatumPoints};
use super::witness::Witness;
use crate::dprnt::{Announced, BlockEnd, Moved, ReportedHit, Said};
use crate::units::{Micros, Point};
use crate::zero_option::ZeroOption;

/// What the job decides.
#[derive(Clone, Copy, Debug)]
pub enum Decision<'a> {
    /// A feature was fitted or refused.
    Feature(&'a FeatureResult),
    /// A setup was judged.
    Verdict(&'a Verdict),
    /// A setup became the reference; without places: nothing is the reference any more.
    Taught(Teaching<'a>),
}

/// What a setup teaches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Teaching<'a> {
    /// Places of the datum features, then of those on the table.
    pub places: &'a [Point],
    /// How each feature of the job was.
    pub learned: &'a Lessons,
}

impl Teaching<'_> {
    /// Nothing is the reference.
    pub const NONE: Self = Self {
        places: &[],
        learned: &Lessons::NONE,
    };
}

/// A job under way, or none.
#[derive(Debug)]
pub struct Run {
    job: ZeroOption<Job>,
    /// Nominal positions of the datum features, then of those on the table.
    reference: Option<DatumPoints>,
    /// How each feature was in the taught setups.
    learned: Lessons,
    /// What that was before this setup has widened it.
    unwidened: ZeroOption<Lessons>,
    teaching: TeachingAct,
    /// Who asked to teach, and when: means nothing where nobody has.
    asked: Asked,
    /// The reference was taught by a line that says "also in place of what there is", and no
    /// setup has been measured since without one.
    taught_by_again: bool,
    /// The latest result of each feature, and whether it belongs to this setup.
    slots: Vec<Slot, MAX_FEATURES>,
    /// Number of the setup under way, from 0.
    setup: u32,
    progress: Progress,
    /// Place of the feature that came last in this setup.
    last: Option<usize>,
    /// Reasons that belong to the setup and not to one feature.
    against: Vec<Reason, 4>,
    /// Reasons that came before the setup's first feature was complete.
    pending: Vec<Reason, 4>,
    /// The program's run, where the lines say it.
    run: Option<u32>,
    /// The greatest run that was judged, since the job was set: also before a restart.
    last_run: Option<u32>,
    /// That run, if the one under way is not after it.
    older_than: Option<u32>,
    /// In which work offset that run is probed, where it said so.
    frame: Option<Frame>,
    /// What else moves its coordinates, where it said so.
    moved: ZeroOption<Moved>,
    /// By what they lie elsewhere than its offsets say, where it said so: the most that it said.
    shifted: Option<Point>,
    /// The features of a setup have come in the job's order.
    order_shown: bool,
    /// The control began in the middle of the job's order, with this feature.
    began_with: Option<usize>,
    remarks: Vec<Reason, 4>,
    features_seen: u32,
    collecting: ZeroOption<Collecting>,
    last_hit: Micros,
    verdict: ZeroOption<Verdict>,
    /// This setup became the reference.
    taught_here: bool,
    /// The encoders' side of the hits.
    witness: ZeroOption<Witness>,
}

/// How far the setup is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    /// Nothing of it has come.
    Empty,
    /// Some features have come.
    UnderWay,
    /// The verdict is out; only a repeat of the last feature still belongs here.
    Judged,
}

/// Whether somebody asked to teach, and what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TeachingAct {
    /// No.
    None,
    /// The setup that comes next.
    Next(Lesson),
    /// The setup under way.
    This(Lesson),
}

/// Who asked to teach, and when.
#[derive(Clone, Copy, Debug)]
struct Asked {
    by: TeachBy,
    at: Micros,
    /// Also in place of what there is.
    again: bool,
}

impl Asked {
    const NOBODY: Self = Self {
        by: TeachBy::Host,
        at: Micros(0),
        again: false,
    };
}

/// What a setup is to teach.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lesson {
    /// The reference, and how its features are.
    Reference,
    /// How features may be, besides.
    More,
}

/// A work offset as a run states it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Frame {
    offset: u16,
    origin: Point,
}

#[derive(Debug, Default)]
struct Slot {
    result: Option<FeatureResult>,
    in_this_setup: bool,
    /// Its points are those of the setup before, to the last digit.
    repeated: bool,
    /// How far beside the centre its hits were approached.
    centring_mm: f64,
}

impl Run {
    /// No job: nothing that comes leads to anything.
    #[must_use]
    pub const fn idle() -> Self {
        Self {
            job: ZeroOption::empty(),
            reference: None,
            learned: Lessons::NONE,
            unwidened: ZeroOption::empty(),
            teaching: TeachingAct::None,
            asked: Asked::NOBODY,
            taught_by_again: false,
            slots: Vec::new(),
            setup: 0,
            progress: Progress::Empty,
            last: None,
            against: Vec::new(),
            pending: Vec::new(),
            run: None,
            last_run: None,
            older_than: None,
            frame: None,
            moved: ZeroOption::empty(),
            shifted: None,
            order_shown: false,
            began_with: None,
            remarks: Vec::new(),
            features_seen: 0,
            collecting: ZeroOption::empty(),
            last_hit: Micros(0),
            verdict: ZeroOption::empty(),
            taught_here: false,
            witness: ZeroOption::empty(),
        }
    }

    /// Begins a checked job.
    #[must_use]
    pub fn new(job: Job) -> Self {
        let mut run = Self::idle();
        run.begin(job);
        run
    }

    /// Begins a checked job in place of what was. A run is too large to be moved about
    /// on a small board's stack, so its parts are emptied one by one.
    pub fn begin(&mut self, job: Job) {
        let Self {
            job: place,
            reference,
            learned,
            unwidened,
            teaching,
            asked,
            taught_by_again,
            slots,
            setup,
            progress,
            last,
            against,
            pending,
            run,
            last_run,
            older_than,
            frame,
            moved,
            shifted,
            order_shown,
            began_with,
            remarks,
            features_seen,
            collecting,
            last_hit,
            verdict,
            taught_here,
            witness,
        } = self;
        *reference = (job.reference == Reference::Given).then(|| {
            datums(&job)
                .filter_map(|(_, f)| f.position_mm.map(Point::from_array_mm))
                .collect()
        });
        *learned = Lessons::NONE;
        unwidened.clear();
        (*teaching, *asked) = (TeachingAct::None, Asked::NOBODY);
        *taught_by_again = false;
        slots.clear();
        for _ in &job.features {
            // Bounded: there are as many slots as a job can have features.
            let _ = slots.push(Slot::default());
        }
        (*setup, *progress, *last) = (0, Progress::Empty, None);
        against.clear();
        pending.clear();
        (*run, *last_run, *older_than) = (None, None, None);
        *frame = None;
        moved.clear();
        *shifted = None;
        (*order_shown, *began_with) = (false, None);
        remarks.clear();
        *features_seen = 0;
        collecting.clear();
        *last_hit = Micros(0);
        verdict.clear();
        *taught_here = false;
        witness.clear();
        if let Some(spec) = job.witness {
            witness.put(Witness::new(spec, &job.skip));
        }
        place.put(job);
    }

    /// The job, if there is one.
    #[must_use]
    pub fn job(&self) -> Option<&Job> {
        self.job.get()
    }

    /// Its features in their order.
    fn features(&self) -> &[FeatureSpec] {
        self.job.get().map_or(&[], |job| &job.features)
    }

    fn reference_is_taught(&self) -> bool {
        let job = self.job.get();
        job.is_some_and(|job| job.reference == Reference::Taught)
    }

    /// Nominal positions of the datum features: given, or taught.
    #[must_use]
    pub fn reference(&self) -> Option<&[Point]> {
        self.reference.as_deref()
    }

    /// The taught reference; none where the job gives its positions.
    #[must_use]
    pub fn taught(&self) -> Option<Teaching<'_>> {
        let places = self.reference().filter(|_| self.reference_is_taught())?;
        let learned = &self.learned;
        Some(Teaching { places, learned })
    }

    /// The setup that comes next is to teach. With [`TeachWhat::Again`] the reference that there
    /// is, is none any more, whatever becomes of the new one.
    ///
    /// # Errors
    /// Why there is nothing to teach: nothing has changed.
    pub fn teach(
        &mut self,
        now: Micros,
        by: TeachBy,
        what: TeachWhat,
        out: &mut impl FnMut(Decision<'_>),
    ) -> Result<(), TeachRefusal> {
        self.may_teach(what)?;
        let again = what == TeachWhat::Again;
        self.asked = Asked { by, at: now, again };
        self.next_setup();
        self.began_with = None;
        if what == TeachWhat::More {
            self.teaching = TeachingAct::Next(Lesson::More);
            return Ok(());
        }
        self.teaching = TeachingAct::Next(Lesson::Reference);
        if self.reference.take().is_some() {
            self.learned = Lessons::NONE;
            out(Decision::Taught(Teaching::NONE));
        }
        Ok(())
    }

    /// Whether [`Self::teach`] would be taken.
    ///
    /// # Errors
    /// As there.
    pub fn may_teach(&self, what: TeachWhat) -> Result<(), TeachRefusal> {
        let job = self.job.get().ok_or(TeachRefusal::NoJob)?;
        let is_taught = self.reference.is_some();
        match what {
            _ if !self.reference_is_taught() => Err(TeachRefusal::Given),
            _ if self.is_under_way() => Err(TeachRefusal::UnderWay),
            TeachWhat::Reference if is_taught => Err(TeachRefusal::AlreadyTaught),
            TeachWhat::More if job.guards.learned.is_none() => Err(TeachRefusal::NoLearned),
            TeachWhat::More if !is_taught => Err(TeachRefusal::NotTaught),
            _ => Ok(()),
        }
    }

    /// A teaching that was asked for and has not happened yet.
    #[must_use]
    pub fn teach_pending(&self) -> Option<TeachPending> {
        let setup = self.setup;
        let (lesson, setup) = match self.teaching {
            TeachingAct::None => return None,
            TeachingAct::Next(lesson) => (lesson, TeachSetup::Next),
            TeachingAct::This(lesson) => match (self.progress, self.verdict.get()) {
                (Progress::Judged, Some(verdict)) if verdict.ok => return None,
                (Progress::Judged, _) => (lesson, TeachSetup::Refused { setup }),
                _ => (lesson, TeachSetup::UnderWay { setup }),
            },
        };
        Some(TeachPending {
            by: self.asked.by,
            what: match lesson {
                Lesson::Reference => TeachWhat::Reference,
                Lesson::More => TeachWhat::More,
            },
            t_us: self.asked.at.0,
            setup,
        })
    }

    /// Puts back a reference that was taught before a restart. Ignored where
    /// the job gives its positions or the count does not fit.
    pub fn restore_reference(&mut self, taught: Teaching<'_>) {
        let due = self.job.get().map(place_count);
        if self.reference_is_taught() && due == Some(taught.places.len()) {
            self.reference = Vec::from_slice(taught.places).ok();
            self.learned = taught.learned.clone();
        }
    }

    /// The latest result of a feature, by its place in the job.
    #[must_use]
    pub fn feature(&self, place: usize) -> Option<&FeatureResult> {
        self.slots.get(place)?.result.as_ref()
    }

    /// The latest verdict.
    #[must_use]
    pub fn verdict(&self) -> Option<&Verdict> {
        self.verdict.get()
    }

    /// Whether a setup has begun and is not judged.
    #[must_use]
    pub fn is_under_way(&self) -> bool {
        self.progress == Progress::UnderWay || self.collecting.is_some()
    }

    /// When the setup under way is given up, or a judged one closed to repeats of
    /// its last feature, if nothing comes.
    #[must_use]
    pub fn deadline(&self) -> Option<Micros> {
        let timeout_s = self.job.get()?.plate_timeout_s;
        let timeout_us = u64::from(timeout_s).saturating_mul(1_000_000);
        (self.is_under_way() || self.progress == Progress::Judged)
            .then(|| Micros(self.last_hit.0.saturating_add(timeout_us)))
    }

    /// Time passed.
    pub fn on_time(&mut self, now: Micros, out: &mut impl FnMut(Decision<'_>)) {
        if self.deadline().is_some_and(|deadline| now >= deadline) {
            if self.is_under_way() {
                let timeout_s = self.job.get().map_or(0, |job| job.plate_timeout_s);
                self.give_up(Reason::TimedOut { timeout_s }, out);
            } else {
                self.next_setup();
            }
            self.began_with = None;
        }
    }

    /// The input ended (a captured file).
    pub fn input_ended(&mut self, out: &mut impl FnMut(Decision<'_>)) {
        self.give_up(Reason::InputEnded, out);
    }

    /// The receiver found a fault that concerns more than a line of a block.
    pub fn fault(&mut self, kind: &FaultKind, out: &mut impl FnMut(Decision<'_>)) {
        match kind {
            FaultKind::Gap { .. } => self.hold_against(Reason::SequenceGap),
            FaultKind::ConflictingRepeat { .. } => self.hold_against(Reason::ConflictingRepeat),
            FaultKind::BufferOverrun { lost } => {
                self.hold_against(Reason::BytesLost { count: *lost });
            }
            FaultKind::NotTouched => match self.collecting.get_mut() {
                Some(collecting) => {
                    let hit = collecting.next_number();
                    add(&mut collecting.reasons, Reason::NotTouched { hit });
                }
                None => self.hold_against(Reason::NotTouched { hit: 1 }),
            },
            FaultKind::BlockCountMismatch { expected, got } => {
                let (got, expected) = (*got, *expected);
                self.revoke(Reason::WrongCount { got, expected }, out);
            }
            FaultKind::BadParity { .. }
            | FaultKind::UnknownCharacter { .. }
            | FaultKind::LineTooLong { .. }
            | FaultKind::LineUnterminated
            | FaultKind::NumberFormat { .. }
            | FaultKind::BadCheckValue { .. }
            | FaultKind::NotUnderstood => self.damaged_line(),
            // The others have done their harm to a block, which says so, or to a
            // hit, which carries the doubt; or they did none.
            _ => {}
        }
    }

    /// A line could not be used. In a block the block says so; elsewhere a hit may
    /// be missing, and the next one must not take its place.
    fn damaged_line(&mut self) {
        if let Some(collecting) = self.collecting.get_mut()
            && !collecting.in_block
            && let Some(spec) = spec_of(&self.job, collecting.feature)
        {
            let got = u16::try_from(collecting.hits.len()).unwrap_or(u16::MAX);
            let expected = spec.hits;
            add(
                &mut collecting.reasons,
                Reason::DamagedLine { got, expected },
            );
        }
    }

    /// Something contradicts a setup that may have been judged: then its verdict
    /// is NG, under the same number.
    fn revoke(&mut self, reason: Reason, out: &mut impl FnMut(Decision<'_>)) {
        if self.progress == Progress::Judged && !self.collecting.is_some() {
            self.progress = Progress::UnderWay;
            self.hold_against(reason);
            self.close(None, out);
        } else {
            self.hold_against(reason);
        }
    }

    /// The control reads (DC1): what it has printed so far is of clampings before this moment.
    ///
    /// The one character passes by whatever text the control still holds back. A text that is
    /// late by whole setups is cut between two of them all the same; one that is cut within
    /// a feature is late by less, and then this says nothing.
    pub fn control_reads(&mut self, out: &mut impl FnMut(Decision<'_>)) {
        if let Some(began_with) = self.began_with_name()
            && !self.collecting.is_some()
        {
            self.give_up(Reason::OrderUnknown { began_with }, out);
            self.began_with = None;
        }
    }

    /// The control asks for a program on a line of its own, which comes in its turn: what it
    /// has printed so far is of clampings before this moment.
    pub fn control_asks(&mut self, out: &mut impl FnMut(Decision<'_>)) {
        if let Some(began_with) = self.began_with_name() {
            self.give_up(Reason::OrderUnknown { began_with }, out);
            self.began_with = None;
        } else if self.run.is_some() && self.is_under_way() {
            // Its features come in any order: without this, nothing says that some are lost.
            self.finish_unfinished(out);
            self.close(None, out);
        }
    }

    /// The greatest run that was judged.
    #[must_use]
    pub fn last_run(&self) -> Option<u32> {
        self.last_run
    }

    /// Puts back what it was before a restart.
    pub fn restore_last_run(&mut self, run: u32) {
        self.last_run = Some(run);
    }

    /// The control says something about the run that it begins.
    #[inline(never)]
    pub fn announced(
        &mut self,
        announced: &Announced,
        now: Micros,
        out: &mut impl FnMut(Decision<'_>),
    ) {
        self.last_hit = now;
        self.enter_run(announced.run, out);
        match announced.said {
            Said::Frame { offset, origin } => {
                self.give_up(Reason::RunChanged, out);
                self.frame = Some(Frame { offset, origin });
                self.moved.clear();
                self.shifted = None;
            }
            Said::Moved(moved) => self.moved.put(moved),
            Said::Shifted { offset, by } => self.looked_at(offset, by),
            Said::Teach { again } => {
                self.give_up(Reason::RunChanged, out);
                if again && self.taught_by_again {
                    self.next_setup();
                    self.hold_against(Reason::TaughtTwice);
                    return;
                }
                let what = if again {
                    TeachWhat::Again
                } else {
                    TeachWhat::Reference
                };
                let taken = self.teach(now, TeachBy::Line, what, out);
                if let Err(TeachRefusal::AlreadyTaught) = taken {
                    self.next_setup();
                    self.hold_against(Reason::AlreadyTaught);
                }
            }
        }
    }

    /// The control has looked where its coordinates lie. It may look again: a shift that went
    /// away is none the less one, and so is another offset.
    fn looked_at(&mut self, offset: u16, by: Point) {
        if let Some(frame) = &self.frame
            && frame.offset != offset
        {
            let (got, expected) = (offset, frame.offset);
            self.hold_against(Reason::OtherOffset { got, expected });
        }
        let before = self.shifted.unwrap_or(by).mm;
        let most = before.zip_map(&by.mm, |a, b| if b.abs() > a.abs() { b } else { a });
        self.shifted = Some(Point { mm: most });
    }

    /// The lines are of this run. Another one ends the setup before.
    fn enter_run(&mut self, run: u32, out: &mut impl FnMut(Decision<'_>)) {
        if self.run == Some(run) {
            return;
        }
        if self.run.is_some() {
            self.give_up(Reason::RunChanged, out);
            self.next_setup();
        }
        if self.asked.by == TeachBy::Line && matches!(self.teaching, TeachingAct::Next(_)) {
            // It was said of a run of which nothing else has come: this one is another.
            self.teaching = TeachingAct::None;
        }
        self.run = Some(run);
        self.older_than = self.last_run.filter(|last| !is_after(run, *last));
        self.frame = None;
        self.moved.clear();
        self.shifted = None;
        self.began_with = None;
    }

    fn began_with_name(&self) -> Option<Name> {
        let spec = spec_of(&self.job, self.began_with?)?;
        Some(spec.name.clone())
    }

    /// The probe's skip line rose and the axes were latched.
    pub fn latched(&mut self, latch: &LatchReport) {
        if let Some(witness) = self.witness.get_mut() {
            witness.latched(latch);
        }
    }

    /// A block of hits begins.
    #[inline(never)]
    pub fn block_start(&mut self, name: &str, now: Micros, out: &mut impl FnMut(Decision<'_>)) {
        self.finish_unfinished(out);
        self.last_hit = now;
        match self.place_of(|feature| feature.name == name) {
            Some(feature) => self.collecting.put(Collecting::new(feature, true)),
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
        let seen = self.witness.get_mut().map(|w| w.pair(hit));
        collecting.take(spec, hit, seen);
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

    // --- features

    /// A feature that is still being collected when something else begins.
    fn finish_unfinished(&mut self, out: &mut impl FnMut(Decision<'_>)) {
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
                self.close(None, out);
                self.next_setup();
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
        let judged = self.progress == Progress::Judged;
        // A job of one feature, or a program run again from its start.
        if judged && place == 0 && self.slot_is_ok(place) {
            return Belongs::NextSetup;
        }
        let Some(earlier) = self.in_this_setup(place) else {
            return Belongs::NextSetup;
        };
        // Printed again and not touched again, it has no latches.
        let same = |one: &&Reason| !matches!(one, Reason::NotLatched { .. });
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

    fn in_this_setup(&self, place: usize) -> Option<&FeatureResult> {
        let slot = self.slots.get(place)?;
        slot.result.as_ref().filter(|_| slot.in_this_setup)
    }

    fn slot_is_ok(&self, place: usize) -> bool {
        self.in_this_setup(place).is_some_and(FeatureResult::is_ok)
    }

    // --- setups

    /// Judges what is there; without anything there is nothing to judge.
    fn give_up(&mut self, reason: Reason, out: &mut impl FnMut(Decision<'_>)) {
        let at_stake = self.is_under_way();
        self.finish_unfinished(out);
        if at_stake {
            // Finishing may have judged the setup already.
            let open = self.progress == Progress::UnderWay;
            self.close(open.then_some(reason), out);
            self.next_setup();
        }
    }

    /// Judges the setup under way.
    #[inline(never)]
    fn close(&mut self, reason: Option<Reason>, out: &mut impl FnMut(Decision<'_>)) {
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
                    | Reason::OfRun { .. }
                    | Reason::Witnessed { .. }
                    | Reason::WitnessLearned
                    | Reason::SkipChatter { .. }
            )
        });
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
                    Reason::Error95 { .. } | Reason::Warmer { .. }
                )
            });
        }
        if taught {
            self.taught_by_again = self.asked.by == TeachBy::Line && self.asked.again;
        } else if !self.against.contains(&Reason::TaughtTwice) {
            self.taught_by_again = false;
        }
        let widens = self.widens(&verdict);
        self.add_remarks(taught, &mut verdict);
        if taught {
            self.learned = Lessons::NONE;
            self.learned.smallest = self.shown();
            let learned = &self.learned;
            let places = &measured;
            out(Decision::Taught(Teaching { places, learned }));
            self.reference = Some(measured);
            self.taught_here = true;
        } else if !verdict.ok && core::mem::take(&mut self.taught_here) {
            // What it taught does not hold any more.
            out(Decision::Taught(Teaching::NONE));
            self.reference = None;
            self.learned = Lessons::NONE;
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

    /// How each feature of this setup is.
    fn shown(&self) -> Vec<Learned, MAX_FEATURES> {
        let mut shown = Vec::new();
        for slot in &self.slots {
            let fit = slot.result.as_ref().and_then(|result| result.fit.as_ref());
            let learned = fit.map(|fit| feature::learned(fit, slot.centring_mm));
            // There are no more slots than that.
            let _ = shown.push(learned.unwrap_or_default());
        }
        shown
    }

    /// Widens what was learned by this setup, if it is to and is OK; whether what was learned
    /// has changed: also where a setup that has widened it is NG after all.
    #[inline(never)]
    fn widens(&mut self, verdict: &Verdict) -> bool {
        let before = self.unwidened.take();
        let was_wider = before.is_some();
        if let Some(before) = before {
            self.learned = before;
        }
        if self.teaching != TeachingAct::This(Lesson::More) || !verdict.ok {
            return was_wider;
        }
        self.unwidened.put(self.learned.clone());
        let shown = self.shown();
        self.learned.widen(&shown);
        let further = self.learned.further;
        self.remark(Reason::TaughtMore { further });
        true
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
        if let (Some(run), Some(last)) = (self.run, self.older_than) {
            setup::add(verdict, Reason::OldRun { run, last });
        }
        for (place, spec) in job.features.iter().enumerate() {
            match self.in_this_setup(place) {
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
            let result = self.in_this_setup(place);
            let fit = result.and_then(|result| result.fit.as_ref());
            if let Some(position) = fit.and_then(|fit| fit.shape.position_mm()) {
                // Bounded: the job check limits them together with the datums.
                let _ = measured.push(Point::from_array_mm(position));
            }
        }
        self.against_closing(job, verdict);
        let mut taught = false;
        let complete = measured.len() == place_count(job);
        let may_teach =
            job.teach == Teach::FirstOk || self.teaching == TeachingAct::This(Lesson::Reference);
        match &self.reference {
            // A setup with a reason against it is not judged further: figures
            // from wrong hits would only mislead.
            _ if !verdict.reasons.is_empty() || !complete => {}
            Some(reference) => {
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

    /// Holds what the run says of its work offset against the job.
    fn against_frame(&self, job: &Job, verdict: &mut Verdict) {
        let Some(spec) = &job.correction else {
            return;
        };
        if let Some(frame) = &self.frame {
            setup::against_frame(verdict, spec, frame.offset, frame.origin);
        }
        if let Some(moved) = self.moved.get() {
            setup::against_moved(verdict, &job.guards, moved);
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
    }

    /// What the features' fits and the job say of the scatter of hits.
    fn scatter(&self, job: &Job) -> Option<Scatter> {
        let mut scatter = Scatter::of(job.guards.probing?, self.reference_is_taught());
        for (place, _) in datums(job) {
            scatter.add(self.in_this_setup(place)?.fit.as_ref()?);
        }
        Some(scatter)
    }

    /// What was noticed and does not change the verdict.
    #[inline(never)]
    fn add_remarks(&mut self, taught: bool, verdict: &mut Verdict) {
        if taught {
            self.remark(Reason::Taught);
        }
        if let Some(run) = self.run {
            // Never dropped: what goes out is compared with it.
            if self.remarks.is_full() {
                self.remarks.pop();
            }
            self.remark(Reason::OfRun { run });
        }
        if verdict.ok
            && let Some(witness) = self.witness.get_mut()
        {
            for remark in witness.conclude().into_iter().flatten() {
                let _ = self.remarks.push(remark);
            }
        }
        for reason in self.remarks.iter().cloned() {
            setup::add_remark(verdict, reason);
        }
        if let Some(open) = self.job.get().and_then(not_guarded) {
            setup::add_remark(verdict, open);
        }
    }

    fn next_setup(&mut self) {
        if self.progress == Progress::Judged {
            self.setup = self.setup.saturating_add(1);
        }
        for slot in &mut self.slots {
            slot.in_this_setup = false;
        }
        if matches!(self.teaching, TeachingAct::This(_)) && self.progress != Progress::Empty {
            self.teaching = TeachingAct::None;
        }
        self.unwidened.clear();
        self.progress = Progress::Empty;
        self.taught_here = false;
        if let Some(witness) = self.witness.get_mut() {
            witness.next_setup();
        }
        self.last = None;
        self.against.clear();
        self.remarks.clear();
    }

    // --- small things

    fn place_of(&self, is: impl Fn(&FeatureSpec) -> bool) -> Option<usize> {
        self.features().iter().position(is)
    }

    /// The feature to which an unlabelled hit belongs.
    fn next_in_order(&self) -> usize {
        match (self.collecting.get(), self.last) {
            (Some(collecting), _) => collecting.feature,
            (None, Some(last)) if self.progress == Progress::UnderWay => last + 1,
            (None, _) => 0,
        }
    }

    fn unknown(&mut self, name: &str) {
        let name = name
            .chars()
            .take(umi_protocol::job::MAX_NAME)
            .collect::<Name>();
        self.remark(Reason::UnknownFeature { name });
    }

    fn remark(&mut self, reason: Reason) {
        if !self.remarks.contains(&reason) {
            // Remarks beyond the room are dropped: they change nothing.
            let _ = self.remarks.push(reason);
        }
    }

    fn hold_against(&mut self, reason: Reason) {
        let list = if self.is_under_way() {
            &mut self.against
        } else {
            // It concerns what comes next.
            &mut self.pending
        };
        if !list.contains(&reason) {
            // With the list full the setup is NG already.
            let _ = list.push(reason);
        }
    }
}

/// Whether a run comes after another one. Macros count from 1 to [`MOST_RUN`] and go on with 1:
/// of the two ways around, the shorter one counts (as RFC 1982 compares serial numbers), so that
/// what is up to 49 999 runs old is old, also across the end of the count.
const fn is_after(run: u32, last: u32) -> bool {
    let further = (run % MOST_RUN + MOST_RUN - last % MOST_RUN) % MOST_RUN;
    further != 0 && further < MOST_RUN / 2 + 1
}

/// The last number before a macro's count goes on with 1.
const MOST_RUN: u32 = 99_999;

/// A feature of the job, by its place. Borrows the job alone.
fn spec_of(job: &ZeroOption<Job>, place: usize) -> Option<&FeatureSpec> {
    job.get()?.features.get(place)
}

/// Where a finished feature belongs.
enum Belongs {
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
