//! The job as a state machine: hits and time in, features and verdicts out.
//!
//! # How hits find their plate
//!
//! The program probes the features in the job's order, so a plate (one
//! clamping) begins with the job's first feature and is judged when the last
//! one arrives. A feature that comes earlier in the order than the one before
//! it begins the next plate, and the unfinished one is NG. So a lost block
//! never shifts the blocks that follow into the wrong clamping.
//!
//! On checked lines another run of the program begins another plate as well.
//!
//! The feature that came last may come again: unchanged it is dropped, and a
//! refused one is replaced (its plate is judged again, under the same number).
//! Sent again with other coordinates, it is not known which is right: NG. A
//! whole plate that is printed again to the last digit was not measured again
//! (a control that restarts a program repeats its output): NG too.

use heapless::Vec;
use umi_protocol::fault::FaultKind;
use umi_protocol::feature::FeatureResult;
use umi_protocol::job::{FeatureSpec, Job, MAX_FEATURES, Name, Reference};
use umi_protocol::latch::LatchReport;
use umi_protocol::reason::Reason;
use umi_protocol::verdict::{PlateReason, Verdict};

use super::check::datums;
use super::collecting::Collecting;
use super::feature::{self, Reasons};
use super::plate::{self, Positions};
use super::witness::Witness;
use crate::dprnt::{BlockEnd, ReportedHit};
use crate::place::Place;
use crate::units::{Micros, Point};

/// What the job decides.
#[derive(Clone, Copy, Debug)]
pub enum Decision<'a> {
    /// A feature was fitted or refused.
    Feature(&'a FeatureResult),
    /// A plate was judged.
    Verdict(&'a Verdict),
    /// A plate became the reference; empty: that plate is NG after all and nothing is.
    Taught(&'a [Point]),
}

/// A job under way, or none.
#[derive(Debug)]
pub struct Run {
    job: Place<Job>,
    /// Nominal positions of the datum features.
    reference: Option<Positions>,
    /// The latest result of each feature, and whether it belongs to this plate.
    slots: Vec<Slot, MAX_FEATURES>,
    /// Number of the plate under way, from 0.
    plate: u32,
    progress: Progress,
    /// Place of the feature that came last in this plate.
    last: Option<usize>,
    /// Reasons that belong to the plate and not to one feature.
    against: Vec<Reason, 4>,
    /// Reasons that came before the plate's first feature was complete.
    pending: Vec<Reason, 4>,
    /// The program's run, where the lines say it.
    run: Option<u32>,
    remarks: Vec<Reason, 4>,
    features_seen: u32,
    collecting: Place<Collecting>,
    last_hit: Micros,
    verdict: Place<Verdict>,
    /// This plate became the reference.
    taught_here: bool,
    /// The encoders' side of the hits.
    witness: Place<Witness>,
}

/// How far the plate is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    /// Nothing of it has come.
    Empty,
    /// Some features have come.
    UnderWay,
    /// The verdict is out; only a repeat of the last feature still belongs here.
    Judged,
}

#[derive(Debug, Default)]
struct Slot {
    result: Option<FeatureResult>,
    in_this_plate: bool,
    /// Its points are those of the plate before, to the last digit.
    repeated: bool,
}

impl Run {
    /// No job: nothing that comes leads to anything.
    #[must_use]
    pub const fn idle() -> Self {
        Self {
            job: Place::empty(),
            reference: None,
            slots: Vec::new(),
            plate: 0,
            progress: Progress::Empty,
            last: None,
            against: Vec::new(),
            pending: Vec::new(),
            run: None,
            remarks: Vec::new(),
            features_seen: 0,
            collecting: Place::empty(),
            last_hit: Micros(0),
            verdict: Place::empty(),
            taught_here: false,
            witness: Place::empty(),
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
            slots,
            plate,
            progress,
            last,
            against,
            pending,
            run,
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
        slots.clear();
        for _ in &job.features {
            // Bounded: there are as many slots as a job can have features.
            let _ = slots.push(Slot::default());
        }
        (*plate, *progress, *last) = (0, Progress::Empty, None);
        against.clear();
        pending.clear();
        *run = None;
        remarks.clear();
        *features_seen = 0;
        collecting.clear();
        *last_hit = Micros(0);
        verdict.clear();
        *taught_here = false;
        witness.clear();
        if let Some(spec) = job.witness {
            witness.put(Witness::new(spec));
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
    pub fn taught(&self) -> Option<&[Point]> {
        self.reference().filter(|_| self.reference_is_taught())
    }

    /// Puts back a reference that was taught before a restart. Ignored where
    /// the job gives its positions or the count does not fit.
    pub fn restore_reference(&mut self, positions: &[Point]) {
        let due = self.job.get().map(|job| datums(job).count());
        if self.reference_is_taught() && due == Some(positions.len()) {
            self.reference = Vec::from_slice(positions).ok();
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

    /// Whether a plate has begun and is not judged.
    #[must_use]
    pub fn is_under_way(&self) -> bool {
        self.progress == Progress::UnderWay || self.collecting.is_some()
    }

    /// When the plate under way is given up, or a judged one closed to repeats of
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
                self.next_plate();
            }
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
                    feature::add(&mut collecting.reasons, Reason::NotTouched { hit });
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
            feature::add(
                &mut collecting.reasons,
                Reason::DamagedLine { got, expected },
            );
        }
    }

    /// Something contradicts a plate that may have been judged: then its verdict
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
        if hit.run.is_some() && hit.run != self.run {
            if self.run.is_some() {
                self.give_up(Reason::RunChanged, out);
                self.next_plate();
            }
            self.run = hit.run;
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
            feature::add(&mut collecting.reasons, reason);
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

    /// Fits what was collected, puts it into its plate and reports it; judges the plate
    /// if that was its last feature.
    fn finish(&mut self, out: &mut impl FnMut(Decision<'_>)) {
        let place = self.finish_feature(out);
        if place.is_some_and(|place| place + 1 == self.features().len()) {
            self.close(None, out);
        }
    }

    /// Fits what was collected, puts it into its plate and reports it. Returns its
    /// place, unless it was dropped as a repeat. On its own, so that its stack is free
    /// again when the plate is judged.
    #[inline(never)]
    fn finish_feature(&mut self, out: &mut impl FnMut(Decision<'_>)) -> Option<usize> {
        let collecting = self.collecting.take()?;
        let place = collecting.feature;
        let mut result = self.fitted(&collecting)?;
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
                feature::add(&mut result.reasons, Reason::ConflictingRepeat);
            }
            Belongs::NextPlate => {
                self.close(None, out);
                self.next_plate();
            }
        }
        if let Some(witness) = self.witness.get_mut() {
            witness.take(&collecting.hits, replaces);
        }
        result.index = self.features_seen;
        result.plate = self.plate;
        self.features_seen = self.features_seen.saturating_add(1);
        out(Decision::Feature(&result));
        if let Some(slot) = self.slots.get_mut(place) {
            let before = slot.result.as_ref().filter(|_| !slot.in_this_plate);
            slot.repeated = before.is_some_and(|before| before.points_mm == result.points_mm);
            slot.result = Some(result);
            slot.in_this_plate = true;
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
    /// Not inlined: what it needs of the stack is free again when a plate is judged.
    #[inline(never)]
    fn fitted(&self, collecting: &Collecting) -> Option<FeatureResult> {
        let (job, spec) = (self.job.get()?, spec_of(&self.job, collecting.feature)?);
        let Collecting { hits, excess, .. } = collecting;
        let mut reasons = collecting.reasons.clone();
        let got = u16::try_from(hits.len()).unwrap_or(u16::MAX);
        let expected = spec.hits;
        if got < expected && reasons.is_empty() {
            feature::add(&mut reasons, Reason::MissingPoints { got, expected });
        } else if got > expected || *excess > 0 {
            let got = got.saturating_add(*excess);
            feature::add(&mut reasons, Reason::WrongCount { got, expected });
        }
        feature::find_duplicates(hits, &mut reasons);
        let points = feature::contact_points(job.compensation, hits, &mut reasons);
        // What is known to be wrong is not fitted: its figures would only mislead.
        let fit = if reasons.is_empty() {
            feature::judge(spec, &job.limits, &points, hits, &mut reasons)
        } else {
            None
        };
        Some(FeatureResult {
            index: 0,
            plate: 0,
            name: spec.name.clone(),
            kind: spec.kind,
            reasons,
            points_mm: points.iter().map(|p| p.to_array_mm()).collect(),
            fit,
        })
    }

    /// Where a finished feature belongs.
    fn belongs(&self, place: usize, result: &FeatureResult) -> Belongs {
        let Some(last) = self.last else {
            return Belongs::Here;
        };
        if place > last && self.progress == Progress::UnderWay {
            return Belongs::Here;
        }
        let judged = self.progress == Progress::Judged;
        // A job of one feature, or a program run again from its start.
        if judged && place == 0 && self.slot_is_ok(place) {
            return Belongs::NextPlate;
        }
        let Some(earlier) = self.in_this_plate(place) else {
            return Belongs::NextPlate;
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
            _ => Belongs::NextPlate,
        }
    }

    fn in_this_plate(&self, place: usize) -> Option<&FeatureResult> {
        let slot = self.slots.get(place)?;
        slot.result.as_ref().filter(|_| slot.in_this_plate)
    }

    fn slot_is_ok(&self, place: usize) -> bool {
        self.in_this_plate(place).is_some_and(FeatureResult::is_ok)
    }

    // --- plates

    /// Judges what is there; without anything there is nothing to judge.
    fn give_up(&mut self, reason: Reason, out: &mut impl FnMut(Decision<'_>)) {
        let at_stake = self.is_under_way();
        self.finish_unfinished(out);
        if at_stake {
            // Finishing may have judged the plate already.
            let open = self.progress == Progress::UnderWay;
            self.close(open.then_some(reason), out);
            self.next_plate();
        }
    }

    /// Judges the plate under way.
    #[inline(never)]
    fn close(&mut self, reason: Option<Reason>, out: &mut impl FnMut(Decision<'_>)) {
        if self.progress != Progress::UnderWay {
            return;
        }
        if self.job.get().is_none() {
            return;
        }
        // Of a plate that is judged again, not what was said when it was OK.
        self.remarks.retain(|remark| {
            !matches!(
                remark,
                Reason::Taught | Reason::Witnessed { .. } | Reason::WitnessLearned
            )
        });
        let mut verdict = plate::blank(self.plate);
        let mut measured = Positions::new();
        let taught = self.weigh(reason.as_ref(), &mut verdict, &mut measured);
        self.add_remarks(taught, &mut verdict);
        if taught {
            out(Decision::Taught(&measured));
            self.reference = Some(measured);
            self.taught_here = true;
        } else if !verdict.ok && core::mem::take(&mut self.taught_here) {
            // What it taught does not hold any more.
            out(Decision::Taught(&[]));
            self.reference = None;
        }
        if !verdict.ok
            && let Some(witness) = self.witness.get_mut()
        {
            witness.unlearn();
        }
        out(Decision::Verdict(&verdict));
        self.verdict.put(verdict);
        self.progress = Progress::Judged;
    }

    /// Judges what is there of the plate; whether it becomes the reference.
    ///
    /// Not inlined, as [`Self::add_remarks`]: what it needs of the stack is free again when
    /// the verdict is told.
    #[inline(never)]
    fn weigh(
        &self,
        reason: Option<&Reason>,
        verdict: &mut Verdict,
        measured: &mut Positions,
    ) -> bool {
        let Some(job) = self.job.get() else {
            return false;
        };
        for reason in self.against.iter().chain(reason) {
            plate::add(verdict, reason.clone());
        }
        let all_repeated = self
            .slots
            .iter()
            .all(|slot| slot.in_this_plate && slot.repeated);
        if all_repeated {
            plate::add(verdict, Reason::RepeatedPlate);
        }
        for (place, spec) in job.features.iter().enumerate() {
            match self.in_this_plate(place) {
                None => plate::add(
                    verdict,
                    Reason::MissingFeature {
                        name: spec.name.clone(),
                    },
                ),
                Some(result) => {
                    for reason in &result.reasons {
                        plate::add_about(verdict, Some(&spec.name), reason.clone());
                    }
                    let position = result.fit.as_ref().and_then(|f| f.shape.position_mm());
                    if let Some(position) = position.filter(|_| spec.datum) {
                        // Bounded: the job check limits the datums.
                        let _ = measured.push(Point::from_array_mm(position));
                    }
                }
            }
        }
        if let Some(witness) = self.witness.get() {
            witness.judge(&mut |reason| plate::add(verdict, reason));
        }
        let mut taught = false;
        let complete = measured.len() == datums(job).count();
        match &self.reference {
            // A plate with a reason against it is not judged further: figures
            // from wrong hits would only mislead.
            _ if !verdict.reasons.is_empty() || !complete => {}
            Some(reference) => plate::judge(verdict, job, reference, measured),
            None => {
                plate::judge_taught(verdict, job, measured);
                // A job without datum features has nothing to teach.
                taught = verdict.ok && !measured.is_empty();
            }
        }
        if !verdict.ok && self.reference.is_none() && job.correction.is_some() {
            plate::add(verdict, Reason::NoReference);
        }
        taught
    }

    /// What was noticed and does not change the verdict.
    #[inline(never)]
    fn add_remarks(&mut self, taught: bool, verdict: &mut Verdict) {
        if taught {
            self.remark(Reason::Taught);
        }
        if verdict.ok
            && let Some(witness) = self.witness.get_mut()
        {
            for remark in witness.conclude().into_iter().flatten() {
                let _ = self.remarks.push(remark);
            }
        }
        for reason in self.remarks.iter().cloned() {
            // Remarks beyond the room are dropped: they change nothing.
            let _ = verdict.remarks.push(PlateReason {
                feature: None,
                reason,
            });
        }
    }

    fn next_plate(&mut self) {
        if self.progress == Progress::Judged {
            self.plate = self.plate.saturating_add(1);
        }
        for slot in &mut self.slots {
            slot.in_this_plate = false;
        }
        self.progress = Progress::Empty;
        self.taught_here = false;
        if let Some(witness) = self.witness.get_mut() {
            witness.next_plate();
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
            // With the list full the plate is NG already.
            let _ = list.push(reason);
        }
    }
}

/// A feature of the job, by its place. Borrows the job alone.
fn spec_of(job: &Place<Job>, place: usize) -> Option<&FeatureSpec> {
    job.get()?.features.get(place)
}

/// Where a finished feature belongs.
enum Belongs {
    /// It is the next of this plate.
    Here,
    /// It repeats what is known.
    Dropped,
    /// It takes the place of a refused one.
    Replaces,
    /// It contradicts a good one.
    Contradicts,
    /// It begins another plate.
    NextPlate,
}
