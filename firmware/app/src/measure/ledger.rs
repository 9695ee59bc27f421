//! Where decisions go: into the journal, to the host, and what a verdict releases.

use heapless::{String, Vec};
use umi_core::brain::Output;
use umi_core::job::Teaching;
use umi_core::journal::archive::{Archive, FIELDS, ROOM as RECORD_ROOM};
use umi_core::journal::{Flash, JournalError};
use umi_core::registration::RigidTransform;
use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;
use umi_protocol::access::KeyId;
use umi_protocol::fault::Fault;
use umi_protocol::feature::FeatureResult;
use umi_protocol::job::{Job, Lessons, Name};
use umi_protocol::job_error::Field;
use umi_protocol::latch::SignalLevel;
use umi_protocol::line::{HitReport, LineReport};
use umi_protocol::message::{
    Event, Identity, JobLoss, Record, ResetReason, TeachRefusal, TeachWhat,
};
use umi_protocol::program::{ProgramInfo, ProgramRefusal, Release};
use umi_protocol::reason::Reason;
use umi_protocol::serial::LineSettings;
use umi_protocol::verdict::Verdict;

use crate::board::LineAbilities;
use crate::intake::Input;
use crate::measure::events::Events;
use crate::measure::faults::RepeatedFaults;
use crate::measure::release::{Passed, Released, Wanted, transform};
use crate::measure::settings::{PlacesMm, kept};
use crate::measure::trust::bucket::Bucket;
use crate::measure::trust::custody::Custody;
use crate::measure::trust::refusals::Refusals;
use crate::measure::trust::signer::Heads;
use crate::measure::upload::ProgramUpload;
use crate::sensor::PointStation;

/// Where decisions go: everything but the brain, which is busy meanwhile.
pub(crate) struct Ledger<F: Flash> {
    pub identity: Identity,
    pub reset: ResetReason,
    pub journal: ZeroOption<Archive<F>>,
    pub events: Events,
    /// What the board has signed.
    pub heads: Heads,
    pub scratch: [u8; RECORD_ROOM],
    /// What is kept for the owner.
    pub custody: ZeroOption<Custody<F>>,
    /// Whose key the host that asks has proven.
    pub by: ZeroOption<KeyId>,
    /// When a host's time was journaled last; 0: never.
    pub host_time: Micros,
    /// What somebody was refused, counted and not told yet.
    pub refusals: Refusals,
    /// How often a host may change what is in force: each change is a piece of evidence.
    pub changes: Bucket<64, 2_000_000>,
    /// The same of programs that are deleted: a flood of them takes no turn of what is in force.
    pub deletions: Bucket<64, 2_000_000>,
    /// How often what a host acknowledges is kept at once. What comes on top is kept together, later.
    pub acks: Bucket<8, 60_000_000>,
    /// A host has acknowledged the entries before this one, and it is not kept yet.
    pub acked: ZeroOption<u64>,
    /// The latest verdict has released nothing because the journal is full.
    pub is_held_back: bool,
    /// Faults that are counted and not told yet.
    pub(super) repeats: RepeatedFaults,
    /// Entries that the storage refused.
    pub failures: u32,
    /// An input or a decision since the job began is not in the journal.
    pub(super) unaudited: bool,
    /// The journal had no room for what a start, a host or a teaching has put in force: it is told again when it has.
    pub(super) untold: bool,
    /// It may have now.
    pub(super) tells_again: bool,
    /// What the latest verdict releases, while it holds.
    pub released: ZeroOption<Released>,
    /// The program that the control is to get.
    pub wanted: Wanted,
    /// What the control punches.
    pub upload: ProgramUpload,
    /// What the host passes through.
    pub passed: ZeroOption<Passed>,
    /// Counts armings.
    pub(super) armings: u32,
    /// How long a correction stays armed.
    pub(super) patience_us: u64,
    /// A reference was taught and is not in the settings yet.
    pub(super) taught: bool,
    /// How the line to the control can be set.
    pub(super) abilities: ZeroOption<LineAbilities>,
    /// Falls of the skip line are captured.
    pub(super) skip_ends: bool,
    /// How a host wants it, whatever the job says.
    pub(super) listening: ZeroOption<LineSettings>,
    /// The journal began with this start.
    pub(super) is_new: bool,
    /// Why no job was restored at start, until one is set.
    pub job_lost: ZeroOption<JobLoss>,
    /// The station of a distance sensor, where there is one.
    pub point: Option<&'static PointStation>,
    pub verdicts: u32,
    pub verdicts_ok: u32,
    pub last_ok: ZeroOption<bool>,
}

impl<F: Flash> Ledger<F> {
    /// Nothing is known yet; all zeros.
    pub(super) const fn new() -> Self {
        Self {
            identity: Identity {
                board: Name::new(),
                serial: Name::new(),
                firmware: Name::new(),
            },
            reset: ResetReason::Unknown,
            journal: ZeroOption::empty(),
            events: Events::new(),
            heads: Heads::new(),
            scratch: [0; RECORD_ROOM],
            custody: ZeroOption::empty(),
            by: ZeroOption::empty(),
            host_time: Micros(0),
            refusals: Refusals::new(),
            changes: Bucket::new(),
            deletions: Bucket::new(),
            acks: Bucket::new(),
            acked: ZeroOption::empty(),
            is_held_back: false,
            repeats: RepeatedFaults::new(),
            failures: 0,
            unaudited: false,
            untold: false,
            tells_again: false,
            released: ZeroOption::empty(),
            wanted: Wanted::NONE,
            upload: ProgramUpload::new(),
            passed: ZeroOption::empty(),
            armings: 0,
            patience_us: 0,
            taught: false,
            abilities: ZeroOption::empty(),
            skip_ends: false,
            listening: ZeroOption::empty(),
            is_new: false,
            job_lost: ZeroOption::empty(),
            point: None,
            verdicts: 0,
            verdicts_ok: 0,
            last_ok: ZeroOption::empty(),
        }
    }

    /// Whether this board has what a job asks for.
    pub(super) fn takes(&self, job: &Job) -> Result<(), Field> {
        self.fits(&job.line.settings())?;
        if self.skip_ends {
            return Ok(());
        }
        if job.skip.active != SignalLevel::High {
            return Err(Field::SkipActive);
        }
        match job.skip.min_width_us {
            Some(_) => Err(Field::SkipMinWidthUs),
            None => Ok(()),
        }
    }

    /// Whether the line to the control can be set like this on this board.
    pub(super) fn fits(&self, line: &LineSettings) -> Result<(), Field> {
        match self.abilities.get() {
            Some(abilities) => abilities.check(line),
            // Before the start there is no line.
            None => Err(Field::LineBaud),
        }
    }

    /// Journals a record and tells the host. True if it is in the journal.
    ///
    /// A record has kilobytes. It is made as the event that it will be, so that the stack
    /// never holds it twice.
    #[inline(always)]
    pub fn record(&mut self, now: Micros, record: Record) -> bool {
        let (seq, t_us) = (0, now.0);
        self.enter(&mut Event::Record { seq, t_us, record })
    }

    /// Journals the record of an event, numbers it, and tells the host. True if it is in
    /// the journal.
    #[inline(never)]
    pub(super) fn enter(&mut self, event: &mut Event) -> bool {
        let Event::Record { seq, t_us, record } = &mut *event else {
            return false;
        };
        let now = Micros(*t_us);
        let (_, place) = self.scratch.split_at_mut(FIELDS);
        let encoded = postcard::to_slice(record, place).map(|payload| payload.len());
        let appended = encoded
            .ok()
            .zip(self.journal.get_mut())
            .map(|(len, journal)| {
                let room = &mut self.scratch;
                journal.append(record.kind(), now, room, len)
            });
        match appended {
            Some(Ok(number)) => {
                *seq = number;
                self.events.push(event);
                true
            }
            // Counted, and the inputs are all there: only without what a start, a host or a teaching has put
            // in force could nobody audit what follows.
            Some(Err(JournalError::Full)) => {
                self.failures = self.failures.saturating_add(1);
                self.untold |= matches!(
                    record,
                    Record::Boot { .. }
                        | Record::JobSet { .. }
                        | Record::Taught { .. }
                        | Record::ReferenceRestored { .. }
                        | Record::SensorSet { .. }
                );
                false
            }
            _ => {
                self.refused();
                false
            }
        }
    }

    #[inline(never)]
    pub(super) fn came(&mut self, now: Micros, input: &Input) {
        self.record(
            now,
            match input {
                Input::Bytes(raw) => Record::Bytes {
                    raw: raw.iter().copied().collect(),
                },
                Input::Lost(count) => Record::BytesLost { count: *count },
                Input::End => Record::InputEnd,
                Input::Latch(latch) => Record::Latch(latch.clone()),
                Input::Scan(scan) => Record::Scan(scan.clone()),
                // Journaled with what becomes of it.
                Input::Held => return,
            },
        );
    }

    #[inline(never)]
    pub(super) fn time_passed(&mut self, now: Micros) {
        self.record(now, Record::Time);
    }

    /// No job was restored. A board that has never been used has lost none.
    #[inline(never)]
    pub(super) fn job_lost(&mut self, now: Micros, why: JobLoss) {
        self.job_lost.put(why);
        if why != JobLoss::Absent || !self.is_new {
            self.record(now, Record::JobLost { why });
        }
    }

    #[inline(never)]
    pub(super) fn job_set(&mut self, now: Micros, job: &Job) {
        let key_id = self.by.get().copied();
        let job = job.clone();
        self.record(now, Record::JobSet { job, key_id });
    }

    #[inline(never)]
    pub fn kept(&mut self, now: Micros, info: ProgramInfo) {
        let record = Record::ProgramKept {
            program: info,
            key_id: None,
        };
        self.record(now, record);
    }

    #[inline(never)]
    pub fn not_kept(&mut self, now: Micros, number: u32, why: ProgramRefusal) {
        self.record(now, Record::ProgramNotKept { number, why });
    }

    #[inline(never)]
    pub(super) fn faulty(&mut self, now: Micros, fault: &Fault) {
        self.record(now, Record::Fault(fault.clone()));
    }

    /// Tells how many equal faults there were since the one that was told.
    #[inline(never)]
    pub(super) fn tell_repeats(&mut self, now: Micros) {
        if let Some((latest, count)) = self.repeats.take() {
            self.record(now, Record::FaultsAgain { latest, count });
        }
    }

    #[inline(never)]
    pub(super) fn fitted(&mut self, now: Micros, feature: &FeatureResult) {
        self.record(now, Record::Feature(feature.clone()));
    }

    #[inline(never)]
    pub(super) fn reference_taught(&mut self, now: Micros, taught: &Teaching<'_>) {
        let (positions_mm, learned) = kept(taught);
        let record = Record::Taught {
            positions_mm,
            learned,
        };
        self.record(now, record);
    }

    #[inline(never)]
    pub(super) fn teach_asked(&mut self, now: Micros, what: TeachWhat) {
        let (more, keep) = (what == TeachWhat::More, what == TeachWhat::Keep);
        self.record(now, Record::TeachAsked { more, keep });
    }

    #[inline(never)]
    pub(super) fn button_held(&mut self, now: Micros, refused: Option<TeachRefusal>) {
        self.record(now, Record::ButtonHeld { refused });
    }

    #[inline(never)]
    pub(super) fn reference_restored(
        &mut self,
        now: Micros,
        positions_mm: PlacesMm,
        learned: Lessons,
    ) {
        let record = Record::ReferenceRestored {
            positions_mm,
            learned,
        };
        self.record(now, record);
    }

    #[inline(never)]
    pub(super) fn judged(&mut self, now: Micros, verdict: &Verdict) -> bool {
        self.record(now, Record::Verdict(verdict.clone()))
    }

    #[inline(never)]
    pub(super) fn tell_line(&mut self, line: &LineReport) {
        self.events.push(&Event::Line(line.clone()));
    }

    #[inline(never)]
    pub(super) fn tell_hit(&mut self, hit: &HitReport) {
        self.events.push(&Event::Hit(hit.clone()));
    }

    /// The storage has refused something: no correction rests on what follows.
    pub fn refused(&mut self) {
        self.failures = self.failures.saturating_add(1);
        self.unaudited = true;
        self.released.clear();
    }

    /// What is in force could not be audited.
    pub(super) const fn is_unaudited(&self) -> bool {
        self.unaudited || self.untold
    }

    /// Takes what the brain says: one closure, so that the brain is compiled once for it.
    pub(super) fn listen(&mut self, now: Micros) -> impl FnMut(Output<'_>) {
        move |output| self.take(now, output)
    }

    /// Something that the brain says. Each kind of it has a function of its own, so that
    /// the stack holds one record at a time.
    pub(super) fn take(&mut self, now: Micros, output: Output<'_>) {
        match output {
            Output::Line(line) => {
                if !line.status.is_silent() {
                    // The control prints again: what was measured before is history.
                    self.forget();
                }
                self.upload.line(line);
                if self.events.is_on() {
                    self.tell_line(line);
                }
            }
            Output::Request(number) => self.wanted.set(number, true),
            Output::Hit(hit) => {
                if self.events.is_on() {
                    self.tell_hit(hit);
                }
            }
            Output::Fault(fault) => {
                self.upload.fault(&fault.kind);
                if !self.repeats.counts(now, fault) {
                    self.tell_repeats(now);
                    self.repeats.begin(now, fault);
                    self.faulty(now, fault);
                }
            }
            Output::Feature(feature) => {
                self.tell_repeats(now);
                self.fitted(now, feature);
            }
            Output::Taught(taught) => {
                self.tell_repeats(now);
                self.taught = true;
                self.reference_taught(now, &taught);
            }
            Output::Verdict(verdict) => {
                self.tell_repeats(now);
                self.verdicts = self.verdicts.saturating_add(1);
                self.verdicts_ok = self.verdicts_ok.saturating_add(u32::from(verdict.ok));
                self.last_ok.put(verdict.ok);
                self.released.clear();
                let is_kept = self.judged(now, verdict);
                if is_kept {
                    self.heads.judged();
                }
                let is_full = self.untold || self.is_full();
                self.is_held_back = verdict.ok && !self.unaudited && is_full;
                if is_kept && verdict.ok && !self.unaudited && !self.is_held_back {
                    self.release(now, verdict);
                }
            }
        }
    }

    /// A verdict is OK and in the journal.
    #[inline(never)]
    pub(super) fn release(&mut self, now: Micros, verdict: &Verdict) {
        self.armings = self.armings.wrapping_add(1).max(1);
        let (setup, arming) = (verdict.setup, self.armings);
        let until = Micros(now.0.saturating_add(self.patience_us));
        // The clamping that is the reference is where the program wants it.
        let taught = self.taught.then(RigidTransform::identity);
        self.released.put(Released {
            setup,
            arming,
            until,
            run: verdict.of_run(),
            transform: verdict.registration.as_ref().map(transform).or(taught),
            gone: Vec::new(),
            correction: match &verdict.correction {
                Some(correction) => correction.text.clone(),
                None => String::new(),
            },
            is_gone: false,
            is_taught: verdict.remarks.iter().any(|of| of.reason == Reason::Taught),
        });
    }

    /// When an OK verdict is too old for what it has not released yet.
    pub(super) fn too_old(&self) -> Option<Micros> {
        let is_ok = self.last_ok.get() == Some(&true);
        let released = self.released.get().filter(|_| is_ok);
        released.map(|released| released.until)
    }

    /// What the latest verdict releases, if its correction is armed.
    pub fn armed(&self) -> Option<&Released> {
        self.released.get().filter(|of| !of.correction.is_empty())
    }

    /// What the host passes through under this number.
    pub fn passed(&self, number: u32) -> Option<&ProgramInfo> {
        let passed = self.passed.get()?;
        (passed.info.number == number && passed.end.is_none()).then_some(&passed.info)
    }

    /// Whether the correction of this arming still holds.
    pub fn armed_as(&self, arming: u32) -> bool {
        self.armed().is_some_and(|of| of.arming == arming)
    }

    /// Whether what this arming has released still holds.
    pub fn released_as(&self, arming: u32) -> bool {
        self.released.get().is_some_and(|of| of.arming == arming)
    }

    pub fn disarm(&mut self) {
        if let Some(released) = self.released.get_mut() {
            released.correction.clear();
        }
    }

    /// What was measured does not hold any more: no correction, no OK at the output.
    pub(super) fn forget(&mut self) {
        self.released.clear();
        // A program that goes out whenever it is asked for goes on: it may be what prints.
        let passed = self.passed.get().filter(|of| of.end.is_none());
        if passed.is_none_or(|of| of.info.release != Release::Always) {
            self.wanted.number = 0;
            if passed.is_some() {
                self.passed.clear();
            }
        }
        self.last_ok.clear();
    }

    /// Who the board is, for a Hello.
    pub fn sender(&self) -> String<48> {
        let mut text = String::new();
        let Identity {
            board,
            serial,
            firmware,
        } = &self.identity;
        for part in [board, " ", serial, " firmware ", firmware] as [&str; 5] {
            // What finds no room is cut; names are short.
            let _ = text.push_str(part);
        }
        text
    }
}
