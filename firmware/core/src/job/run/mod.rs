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

mod arrivals;
mod faults;
mod judge;
mod step;
mod teach;
mod told;

use heapless::Vec;
use umi_protocol::feature::FeatureResult;
use umi_protocol::job::{Doubt, FeatureSpec, Job, Lessons, MAX_FEATURES, Name, Reference};
use umi_protocol::reason::Reason;
use umi_protocol::verdict::Verdict;

use super::check::datums;
use super::collecting::Collecting;
use super::setup::DatumPoints;
use super::witness::Witness;
use super::witness::skip::SkipLine;
use crate::dprnt::Moved;
use crate::units::{Micros, Point};
use crate::zero_option::ZeroOption;
use arrivals::Slot;
pub use step::is_coarse;
use teach::{Asked, TeachingAct};
use told::Frame;

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
    /// A host or the button has asked for the reference, and nothing has taught one since.
    asked_elsewhere: bool,
    /// Who has taught the reference, as long as that leaves it in doubt; or the setup before was refused
    /// for saying so again.
    doubt: Doubt,
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
    /// The greatest run that was judged since the job began, or was put back behind that
    /// ([`Self::restore_last_run`]): a board does that with what it knows, also from before a restart.
    last_run: Option<u32>,
    /// That run, if the one under way is not after it.
    older_than: Option<u32>,
    /// In which work offset that run is probed, where it said so.
    frame: Option<Frame>,
    /// What else moves its coordinates, where it said so.
    moved: ZeroOption<Moved>,
    /// By what they lie elsewhere than its offsets say, where it said so: the most that it said.
    shifted: Option<Point>,
    /// The feed of the taught setup, else of this one's first hit; 0 where no line has said it.
    feed_mm_per_min: f64,
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
    /// The probe's skip line.
    skip: ZeroOption<SkipLine>,
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
            asked_elsewhere: false,
            doubt: Doubt::None,
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
            feed_mm_per_min: 0.0,
            order_shown: false,
            began_with: None,
            remarks: Vec::new(),
            features_seen: 0,
            collecting: ZeroOption::empty(),
            last_hit: Micros(0),
            verdict: ZeroOption::empty(),
            taught_here: false,
            skip: ZeroOption::empty(),
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
            asked_elsewhere,
            doubt,
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
            feed_mm_per_min,
            order_shown,
            began_with,
            remarks,
            features_seen,
            collecting,
            last_hit,
            verdict,
            taught_here,
            skip,
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
        (*asked_elsewhere, *doubt) = (false, Doubt::None);
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
        (*shifted, *feed_mm_per_min) = (None, 0.0);
        (*order_shown, *began_with) = (false, None);
        remarks.clear();
        *features_seen = 0;
        collecting.clear();
        *last_hit = Micros(0);
        verdict.clear();
        *taught_here = false;
        // Where touches are not judged, too: it may rest at the wrong level there.
        skip.put(SkipLine::new(&job.skip));
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

    // --- features

    // --- setups

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

/// A feature of the job, by its place. Borrows the job alone.
fn spec_of(job: &ZeroOption<Job>, place: usize) -> Option<&FeatureSpec> {
    job.get()?.features.get(place)
}
