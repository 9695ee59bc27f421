//! What the board knows and decides, without waiting for anything: the brain,
//! its journal, and what is to be told or sent.
//!
//! # Design
//!
//! Every input is journaled first and then given to the brain; what the brain
//! decides is journaled as it comes. So the journal alone can be replayed
//! ([`crate::replay`]) to the same decisions.
//!
//! A correction is armed by a verdict OK that *is in the journal*, and by
//! nothing else. It is disarmed by whatever may mean that the part is measured
//! again or has changed: any line from the control that is neither a separator nor a repeated
//! checked line nor asks for a program, a loss, another verdict, a new job, the job's setup time-out. It also goes out
//! once only: the next clamping must not get it by a READ without probing. One
//! that broke off may be read again. The same verdict releases the part programs that need
//! one (`delivery`).
//!
//! # Tradeoffs
//!
//! If the journal's storage refuses an input, measuring goes on and says so in
//! its status, but the setup cannot be audited: no correction is armed until a
//! job is set or the board starts anew, and its storage works again.

use heapless::{String, Vec};
use umi_core::archive::{Archive, ArchiveFault, FIELDS, ROOM as RECORD_ROOM};
use umi_core::brain::{Brain, Output};
use umi_core::job::Teaching;
use umi_core::journal::{Flash, JournalError};
use umi_core::programs::{self, Store};
use umi_core::registration::RigidTransform;
use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;
use umi_protocol::config::BoardConfig;
use umi_protocol::fault::{Counters, Fault};
use umi_protocol::feature::FeatureResult;
use umi_protocol::job::{Job, Lessons, Name};
use umi_protocol::job_error::{Field, JobError};
use umi_protocol::latch::{LatchCause, SignalLevel};
use umi_protocol::line::{HitReport, LineReport, LineStatus};
use umi_protocol::message::{
    Event, Identity, JobLoss, LineRefusal, MAX_RECORD, Record, ResetReason, TeachRefusal, TeachWhat,
};
use umi_protocol::pattern::{Coding, Handshake};
use umi_protocol::program::{ProgramInfo, ProgramRefusal, Release};
use umi_protocol::serial::LineSettings;
use umi_protocol::verdict::Verdict;

use crate::board::{Lights, LineAbilities};
use crate::bucket::Bucket;
use crate::custody::Custody;
use crate::delivery::Delivery;
use crate::events::Events;
use crate::faults::RepeatedFaults;
use crate::intake::Input;
use crate::release::{Passed, Released, Wanted, transform};
use crate::settings::{JobStore, PlacesMm, kept, points};
use crate::signer::{HeadSigner, Heads};
use crate::upload::{ProgramUpload, UploadEnd};

/// How the board came up.
#[derive(Clone)]
pub struct Boot {
    /// Who it is.
    pub identity: Identity,
    /// Why it started.
    pub reset: ResetReason,
    /// How its line to the control can be set.
    pub line: LineAbilities,
    /// It captures the skip line's falls, too: polarity and width of its pulses can be told.
    pub skip_ends: bool,
    /// Signs for it; none: this board has no key, and its journal is not signed.
    pub signer: Option<&'static dyn HeadSigner>,
}

/// Room in the journal that a setup may need: its bytes, features and verdict.
const ROOM: u32 = 4 * MAX_RECORD as u32;

/// What the board knows.
pub struct Instrument<F: Flash> {
    brain: Brain,
    settings: ZeroOption<JobStore<F>>,
    /// Part programs.
    pub(crate) programs: ZeroOption<Store<F>>,
    /// What is being sent to the control.
    pub(crate) delivery: ZeroOption<Delivery>,
    pub(crate) ledger: Ledger<F>,
}

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
    /// How often a host may change what is in force: each change is a piece of evidence.
    pub changes: Bucket<64, 2_000_000>,
    /// The latest verdict has released nothing because the journal is full.
    pub is_held_back: bool,
    /// Faults that are counted and not told yet.
    repeats: RepeatedFaults,
    /// Entries that the storage refused.
    pub failures: u32,
    /// An input or a decision since the job began is not in the journal.
    unaudited: bool,
    /// What the latest verdict releases, while it holds.
    pub released: ZeroOption<Released>,
    /// The program that the control is to get.
    pub wanted: Wanted,
    /// What the control punches.
    pub upload: ProgramUpload,
    /// What the host passes through.
    pub passed: ZeroOption<Passed>,
    /// Counts armings.
    armings: u32,
    /// How long a correction stays armed.
    patience_us: u64,
    /// A reference was taught and is not in the settings yet.
    taught: bool,
    /// How the line to the control can be set.
    abilities: ZeroOption<LineAbilities>,
    /// Falls of the skip line are captured.
    skip_ends: bool,
    /// How a host wants it, whatever the job says.
    listening: ZeroOption<LineSettings>,
    /// The journal began with this start.
    is_new: bool,
    /// Why no job was restored at start, until one is set.
    pub job_lost: ZeroOption<JobLoss>,
    pub verdicts: u32,
    pub verdicts_ok: u32,
    pub last_ok: ZeroOption<bool>,
}

impl<F: Flash> Instrument<F> {
    /// Nothing is known yet. All zeros: it can stand in a static without standing in
    /// flash as well.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            brain: Brain::idle(),
            settings: ZeroOption::empty(),
            programs: ZeroOption::empty(),
            delivery: ZeroOption::empty(),
            ledger: Ledger {
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
                changes: Bucket::new(),
                is_held_back: false,
                repeats: RepeatedFaults::new(),
                failures: 0,
                unaudited: false,
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
                verdicts: 0,
                verdicts_ok: 0,
                last_ok: ZeroOption::empty(),
            },
        }
    }

    /// Starts: opens journal and settings and takes up the job and the reference
    /// that were in force.
    ///
    /// A storage area that cannot be opened stops nothing: the board runs and answers,
    /// counts every entry that it cannot keep, shows trouble, sends no correction, and
    /// takes no job. Without the area of the programs, there are none. What was wrong is
    /// returned for a log.
    pub fn start(&mut self, boot: Boot, storage: StorageAreas<F>, now: Micros) -> Opened<F::Error> {
        let StorageAreas {
            journal,
            evidence,
            custody,
            settings,
            programs,
        } = storage;
        self.ledger.identity = boot.identity.clone();
        self.ledger.reset = boot.reset;
        let Boot {
            identity,
            reset,
            line,
            skip_ends,
            signer,
        } = boot;
        self.ledger.abilities.put(line);
        self.ledger.skip_ends = skip_ends;
        self.ledger.heads.start(signer, now);
        let boot = Record::Boot { identity, reset };
        let opened = Opened {
            journal: self.open_journal(now, boot, journal, evidence),
            settings: JobStore::open(settings).map(|settings| self.settings.put(settings)),
            programs: Store::open(programs).map(|programs| self.programs.put(programs)),
        };
        if opened.settings.is_err() {
            self.ledger.refused();
        }
        if let Some(custody) = custody {
            self.open_custody(now, custody);
        }
        self.restore(now);
        opened
    }

    #[inline(never)]
    fn open_journal(
        &mut self,
        now: Micros,
        boot: Record,
        flash: F,
        evidence: Option<F>,
    ) -> Result<(), ArchiveFault<F::Error>> {
        let ledger = &mut self.ledger;
        let opened = Archive::open(flash).and_then(|(archive, recovery)| {
            let max = archive.max_payload();
            if max < MAX_RECORD {
                // Its sectors are too small for the longest record.
                let len = MAX_RECORD;
                return Err(JournalError::PayloadTooLong { len, max });
            }
            ledger.journal.put(archive);
            Ok(recovery)
        });
        // Before the first new entry: what is copied is what was there.
        let archive = ledger.journal.get_mut();
        let kept_apart = match (evidence, archive) {
            (Some(evidence), Some(archive)) => archive.keep_evidence(evidence, &mut ledger.scratch),
            _ => Ok(()),
        };
        self.ledger.record(now, boot);
        let recovery = opened.map_err(ArchiveFault::Journal)?;
        self.ledger.is_new = recovery.fresh;
        self.ledger.heads.opened(recovery.next_seq);
        if !recovery.is_clean() {
            let record = Record::Recovered {
                torn_bytes: recovery.torn_bytes,
                damaged_entries: recovery.damaged_entries,
                damaged_headers: recovery.damaged_headers,
                chain_restarted: recovery.chain_restarted,
            };
            self.ledger.record(now, record);
        }
        if kept_apart.is_err() {
            self.ledger.refused();
        }
        kept_apart
    }

    /// Takes up what is kept for the owner. Where it cannot be opened nothing may go out.
    #[inline(never)]
    fn open_custody(&mut self, now: Micros, flash: F) {
        let Ok(custody) = Custody::open(flash) else {
            return self.ledger.refused();
        };
        let config = custody.kept().config;
        self.ledger.custody.put(custody);
        if config != BoardConfig::default() {
            self.ledger.record(now, Record::ConfigSet(config));
        }
    }

    /// Takes up the job and the reference that were in force, or tells why there are none.
    #[inline(never)]
    fn restore(&mut self, now: Micros) {
        let kept = match self.settings.get_mut() {
            Some(settings) => settings.load(&mut self.ledger.scratch),
            None => Err(JobLoss::Storage),
        };
        let (job, taught) = match kept {
            Ok(kept) => kept,
            Err(why) => return self.ledger.job_lost(now, why),
        };
        // Another board of the same firmware may have kept it.
        let fits = self.ledger.takes(&job);
        let is_narrow = self.ledger.in_custody().config.ceilings.check(&job).is_ok();
        if fits.is_err() || !is_narrow || begin(&mut self.brain, &job).is_err() {
            return self.ledger.job_lost(now, JobLoss::Refused);
        }
        self.ledger.patience_us = patience_us(&job);
        self.ledger.job_set(now, &job);
        if let Some(run) = self.ledger.in_custody().last_run {
            self.brain.restore_last_run(run);
            self.ledger.record(now, Record::LastRun { run });
        }
        if let Some((positions_mm, learned)) = taught {
            self.brain.restore_reference(Teaching {
                places: &points(&positions_mm),
                learned: &learned,
            });
            self.ledger.reference_restored(now, positions_mm, learned);
        }
    }

    /// Something came in. Without a job it is journaled and that is all.
    pub fn input(&mut self, now: Micros, input: &Input) {
        let Self { brain, ledger, .. } = self;
        if let Input::Latch(latch) = input
            && latch.cause == LatchCause::SkipEnd
            && brain.job().is_none_or(|job| job.witness.is_none())
        {
            // Nobody judges touches: the end of one would be one more write of the flash.
            return;
        }
        ledger.heads.came(now);
        if matches!(input, Input::Held) {
            return self.held(now);
        }
        ledger.came(now, input);
        if brain.job().is_none() {
            return;
        }
        if matches!(input, Input::Lost(_)) {
            ledger.forget();
            ledger.upload.breaks();
        }
        match input {
            Input::Bytes(raw) => self.bytes(now, raw),
            Input::Lost(count) => brain.bytes_lost(now, *count, &mut ledger.listen(now)),
            Input::End => brain.input_ended(now, &mut ledger.listen(now)),
            // Into the brain whether or not it found room in the journal: then no
            // correction is armed anyway.
            Input::Latch(latch) => brain.latched(latch),
            Input::Scan(_) | Input::Held => {}
        }
        self.keep_punched(now);
        self.keep_taught(now);
        self.keep_last_run(now);
        self.make_room();
    }

    /// Bytes from the control. What they end of a punched program is kept before the next
    /// can begin.
    fn bytes(&mut self, now: Micros, raw: &[u8]) {
        // Where a line or a program may end, in any code: what the brain makes of them does
        // not depend on how they are cut.
        let ends = |byte: &u8| matches!(byte & 0x7F, 0 | b'\n' | b'\r' | 0x12 | 0x14);
        for piece in raw.split_inclusive(ends) {
            let Self { brain, ledger, .. } = self;
            brain.bytes(now, piece, &mut ledger.listen(now));
            if self.ledger.upload.is_over() {
                self.keep_punched(now);
            }
        }
    }

    /// Erases ahead while nothing is at stake, so that no erase falls into a setup.
    fn make_room(&mut self) {
        let busy = self.brain.run().is_under_way();
        if let Some(journal) = self.ledger.journal.get_mut()
            && !busy
        {
            // A fault of the storage shows at the next entry, and is counted there.
            let _ = journal.prepare(ROOM);
        }
    }

    /// When [`Self::on_time`] is due.
    #[must_use]
    pub fn deadline(&self) -> Option<Micros> {
        let ledger = &self.ledger;
        let times = [
            self.brain.deadline(),
            ledger.too_old(),
            ledger.repeats.due(),
        ];
        times.into_iter().flatten().min()
    }

    /// Time passed.
    pub fn on_time(&mut self, now: Micros) {
        let Self { brain, ledger, .. } = self;
        if ledger.too_old().is_some_and(|until| now >= until) {
            // A program that has begun goes on; none begins any more.
            ledger.disarm();
            ledger.last_ok.clear();
        }
        if ledger.repeats.due().is_some_and(|due| now >= due) {
            ledger.tell_repeats(now);
        }
        if brain.deadline().is_none_or(|deadline| now < deadline) {
            return;
        }
        ledger.time_passed(now);
        brain.on_time(now, &mut ledger.listen(now));
        self.keep_punched(now);
        self.keep_taught(now);
        self.keep_last_run(now);
    }

    /// Replaces the job: it is kept first, so that it survives a power cut from
    /// the moment on in which it is in force.
    ///
    /// # Errors
    /// What is wrong with it, or that it could not be kept: then the job that was
    /// in force still is.
    #[inline(never)]
    pub fn set_job(&mut self, now: Micros, job: &Job) -> Result<(), SetJobError> {
        self.check(job).map_err(SetJobError::Job)?;
        let Self {
            brain,
            settings,
            ledger,
            ..
        } = self;
        if !ledger.journal.is_some() {
            // Nothing of it could be audited.
            return Err(SetJobError::Storage);
        }
        let settings = settings.get_mut().ok_or(SetJobError::Storage)?;
        if is_untouched(brain) && brain.job() == Some(job) && !ledger.unaudited {
            // It is in force as if it had just been set.
            return Ok(());
        }
        if !ledger.changes.take(now) {
            return Err(SetJobError::Job(JobError::TooOften));
        }
        settings
            .save(now, job, None, &mut ledger.scratch)
            .map_err(|_| SetJobError::Storage)?;
        ledger.tell_repeats(now);
        ledger.forget();
        ledger.unaudited = false;
        ledger.patience_us = patience_us(job);
        begin(brain, job)?;
        ledger.job_lost.clear();
        ledger.job_set(now, job);
        // Who reads the lines now knows of no program that has begun.
        ledger.upload.over(false);
        self.keep_punched(now);
        self.keep_last_run(now);
        Ok(())
    }

    /// Whether the board would take a job.
    ///
    /// # Errors
    /// What is wrong with it, or what of it this board does not have.
    pub fn check(&self, job: &Job) -> Result<(), JobError> {
        umi_core::job::check(job)?;
        let fits = self.ledger.takes(job);
        fits.map_err(|field| JobError::NotOnThisBoard { field })?;
        self.ledger.in_custody().config.ceilings.check(job)
    }

    /// How the line to the control is to be set: as a host listens, or by the job.
    #[must_use]
    pub fn line(&self) -> LineSettings {
        let listening = self.ledger.listening.get().copied();
        listening.unwrap_or_else(|| {
            let job = self.brain.job();
            job.map_or(LineSettings::DEFAULT, |job| job.line.settings())
        })
    }

    /// A host wants the line like this as long as it is there; none: as the job says.
    ///
    /// # Errors
    /// Why it stays as it is.
    pub fn listen(&mut self, line: Option<LineSettings>) -> Result<(), LineRefusal> {
        let Some(line) = line else {
            self.ledger.listening.clear();
            return Ok(());
        };
        self.ledger
            .fits(&line)
            .map_err(|field| LineRefusal::NotOnThisBoard { field })?;
        if self.brain.run().is_under_way() || self.delivery.is_some() {
            return Err(LineRefusal::UnderWay);
        }
        self.ledger.listening.put(line);
        Ok(())
    }

    /// The setup that comes next is to teach. What was released before is not any more.
    ///
    /// # Errors
    /// Why there is nothing to teach: nothing has changed.
    pub fn teach(&mut self, now: Micros, what: TeachWhat) -> Result<(), TeachRefusal> {
        let Self { brain, ledger, .. } = self;
        brain.run().may_teach(what)?;
        ledger.forget();
        ledger.teach_asked(now, what == TeachWhat::More);
        brain.teach(what, &mut ledger.listen(now))?;
        self.keep_taught(now);
        Ok(())
    }

    /// The board's button was held: as a host that asks to teach, and as little as it does a
    /// button replace a reference that there is.
    fn held(&mut self, now: Micros) {
        let Self { brain, ledger, .. } = self;
        let refused = brain.run().may_teach(TeachWhat::Reference).err();
        if refused.is_none() {
            ledger.forget();
        }
        ledger.button_held(now, refused);
        if refused.is_none() {
            // It was asked a moment ago: it is taken.
            let _ = brain.teach(TeachWhat::Reference, &mut ledger.listen(now));
            self.keep_taught(now);
        }
    }

    /// The brain; idle without a job.
    #[must_use]
    pub fn brain(&self) -> &Brain {
        &self.brain
    }

    /// The arming that holds, if one does.
    #[must_use]
    pub fn arming(&self) -> Option<u32> {
        self.ledger.armed().map(|released| released.arming)
    }

    /// The code in which the control writes, as far as it is known.
    #[must_use]
    pub fn coding(&self) -> Coding {
        self.brain.coding()
    }

    /// Whether the control may be held.
    #[must_use]
    pub(crate) fn handshake(&self) -> Handshake {
        let job = self.brain.job();
        job.map_or_else(Handshake::default, |job| job.receiver.handshake)
    }

    /// What the outputs show.
    #[must_use]
    pub fn lights(&self) -> Lights {
        let busy = self.brain.run().is_under_way();
        Lights {
            busy,
            ok: !busy && self.ledger.last_ok.get() == Some(&true),
            ng: !busy && self.ledger.last_ok.get() == Some(&false),
            trouble: self.ledger.unaudited,
        }
    }

    /// Keeps what the control punches.
    fn keep_punched(&mut self, now: Micros) {
        let Self {
            programs, ledger, ..
        } = self;
        if !ledger.upload.waits() {
            return;
        }
        match ledger.upload.store(programs.get_mut()) {
            None => {}
            Some(UploadEnd::Kept(info)) => ledger.kept(now, info),
            Some(UploadEnd::Refused(number, why)) => ledger.not_kept(now, number, why),
        }
    }

    /// Keeps a block of what comes by XMODEM.
    pub(crate) fn keep_block(&mut self, now: Micros) {
        let Self {
            programs, ledger, ..
        } = self;
        match ledger.upload.store_block(programs.get_mut()) {
            None => {}
            Some(UploadEnd::Kept(info)) => ledger.kept(now, info),
            Some(UploadEnd::Refused(number, why)) => ledger.not_kept(now, number, why),
        }
    }

    /// XMODEM from the control has ended.
    pub(crate) fn received(&mut self, now: Micros, is_whole: bool) {
        let Self {
            programs, ledger, ..
        } = self;
        if let Some(number) = ledger.upload.end_blocks(programs.get_mut(), is_whole) {
            ledger.not_kept(now, number, ProgramRefusal::BrokeOff);
        }
    }

    /// Keeps a reference that was just taught, with its job.
    fn keep_taught(&mut self, now: Micros) {
        let Self {
            brain,
            settings,
            ledger,
            ..
        } = self;
        if !core::mem::take(&mut ledger.taught) {
            return;
        }
        let taught = brain.run().taught().as_ref().map(kept);
        let kept = settings.get_mut().zip(brain.job()).is_some_and(|(s, job)| {
            s.save(now, job, taught.as_ref(), &mut ledger.scratch)
                .is_ok()
        });
        if !kept {
            // It is in force until the power goes; the status says so, and what
            // rests on it is not sent.
            ledger.refused();
        }
    }
}

impl<F: Flash> Default for Instrument<F> {
    fn default() -> Self {
        Self::new()
    }
}

/// A job has kilobytes: this copy is off the stack when the job is recorded.
#[inline(never)]
fn begin(brain: &mut Brain, job: &Job) -> Result<(), SetJobError> {
    brain.begin(job.clone()).map_err(SetJobError::Job)
}

/// Nothing was measured or taught since the job began.
fn is_untouched(brain: &Brain) -> bool {
    let run = brain.run();
    !run.is_under_way()
        && run.verdict().is_none()
        && run.taught().is_none()
        && run.last_run().is_none()
        && brain.counters() == Counters::default()
}

/// How long a correction stays armed, and a setup open.
fn patience_us(job: &Job) -> u64 {
    u64::from(job.plate_timeout_s).saturating_mul(1_000_000)
}

/// The storage areas of a board.
#[derive(Clone, Debug)]
pub struct StorageAreas<F> {
    /// The journal.
    pub journal: F,
    /// The ring of evidence; none: this board keeps none apart, and noise can overwrite verdicts.
    pub evidence: Option<F>,
    /// What is kept for the owner; none: this board has no configuration, and forgets at each start
    /// which run was the last.
    pub custody: Option<F>,
    /// Job and taught reference.
    pub settings: F,
    /// Part programs.
    pub programs: F,
}

/// What became of the storage areas at start.
#[derive(Debug)]
pub struct Opened<E> {
    /// The journal's, and that of its evidence.
    pub journal: Result<(), ArchiveFault<E>>,
    /// The settings'.
    pub settings: Result<(), JournalError<E>>,
    /// The programs'.
    pub programs: Result<(), programs::StoreError<E>>,
}

/// Why a job was not set.
#[derive(Clone, Debug, PartialEq)]
pub enum SetJobError {
    /// It cannot be used.
    Job(JobError),
    /// It could not be kept.
    Storage,
}

impl<F: Flash> Ledger<F> {
    /// Whether this board has what a job asks for.
    fn takes(&self, job: &Job) -> Result<(), Field> {
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
    fn fits(&self, line: &LineSettings) -> Result<(), Field> {
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
    fn enter(&mut self, event: &mut Event) -> bool {
        let Event::Record { seq, t_us, record } = &mut *event else {
            return false;
        };
        let now = Micros(*t_us);
        let (_, place) = self.scratch.split_at_mut(FIELDS);
        let encoded = postcard::to_slice(record, place).map(|payload| payload.len());
        let appended = encoded
            .ok()
            .zip(self.journal.get_mut())
            .and_then(|(len, journal)| {
                let room = &mut self.scratch;
                journal.append(record.kind(), now, room, len).ok()
            });
        match appended {
            Some(number) => {
                *seq = number;
                self.events.push(event);
                true
            }
            None => {
                self.refused();
                false
            }
        }
    }

    #[inline(never)]
    fn came(&mut self, now: Micros, input: &Input) {
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
    fn time_passed(&mut self, now: Micros) {
        self.record(now, Record::Time);
    }

    /// No job was restored. A board that has never been used has lost none.
    #[inline(never)]
    fn job_lost(&mut self, now: Micros, why: JobLoss) {
        self.job_lost.put(why);
        if why != JobLoss::Absent || !self.is_new {
            self.record(now, Record::JobLost { why });
        }
    }

    #[inline(never)]
    fn job_set(&mut self, now: Micros, job: &Job) {
        self.record(now, Record::JobSet(job.clone()));
    }

    #[inline(never)]
    pub fn kept(&mut self, now: Micros, info: ProgramInfo) {
        self.record(now, Record::ProgramKept(info));
    }

    #[inline(never)]
    pub fn not_kept(&mut self, now: Micros, number: u32, why: ProgramRefusal) {
        self.record(now, Record::ProgramNotKept { number, why });
    }

    #[inline(never)]
    fn faulty(&mut self, now: Micros, fault: &Fault) {
        self.record(now, Record::Fault(fault.clone()));
    }

    /// Tells how many equal faults there were since the one that was told.
    #[inline(never)]
    fn tell_repeats(&mut self, now: Micros) {
        if let Some((latest, count)) = self.repeats.take() {
            self.record(now, Record::FaultsAgain { latest, count });
        }
    }

    #[inline(never)]
    fn fitted(&mut self, now: Micros, feature: &FeatureResult) {
        self.record(now, Record::Feature(feature.clone()));
    }

    #[inline(never)]
    fn reference_taught(&mut self, now: Micros, taught: &Teaching<'_>) {
        let (positions_mm, learned) = kept(taught);
        let record = Record::Taught {
            positions_mm,
            learned,
        };
        self.record(now, record);
    }

    #[inline(never)]
    fn teach_asked(&mut self, now: Micros, more: bool) {
        self.record(now, Record::TeachAsked { more });
    }

    #[inline(never)]
    fn button_held(&mut self, now: Micros, refused: Option<TeachRefusal>) {
        self.record(now, Record::ButtonHeld { refused });
    }

    #[inline(never)]
    fn reference_restored(&mut self, now: Micros, positions_mm: PlacesMm, learned: Lessons) {
        let record = Record::ReferenceRestored {
            positions_mm,
            learned,
        };
        self.record(now, record);
    }

    #[inline(never)]
    fn judged(&mut self, now: Micros, verdict: &Verdict) -> bool {
        self.record(now, Record::Verdict(verdict.clone()))
    }

    #[inline(never)]
    fn tell_line(&mut self, line: &LineReport) {
        self.events.push(&Event::Line(line.clone()));
    }

    #[inline(never)]
    fn tell_hit(&mut self, hit: &HitReport) {
        self.events.push(&Event::Hit(hit.clone()));
    }

    /// The storage has refused something: no correction rests on what follows.
    pub fn refused(&mut self) {
        self.failures = self.failures.saturating_add(1);
        self.unaudited = true;
        self.released.clear();
    }

    /// Takes what the brain says: one closure, so that the brain is compiled once for it.
    fn listen(&mut self, now: Micros) -> impl FnMut(Output<'_>) {
        move |output| self.take(now, output)
    }

    /// Something that the brain says. Each kind of it has a function of its own, so that
    /// the stack holds one record at a time.
    fn take(&mut self, now: Micros, output: Output<'_>) {
        match output {
            Output::Line(line) => {
                let is_silent = matches!(
                    line.status,
                    LineStatus::Request | LineStatus::Separator | LineStatus::Repeated
                );
                if !is_silent {
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
                self.heads.judged();
                let is_kept = self.judged(now, verdict);
                self.is_held_back = false;
                if is_kept && verdict.ok && !self.unaudited {
                    self.is_held_back = self.is_full();
                    if !self.is_held_back {
                        self.release(now, verdict);
                    }
                }
            }
        }
    }

    /// A verdict is OK and in the journal.
    #[inline(never)]
    fn release(&mut self, now: Micros, verdict: &Verdict) {
        self.armings = self.armings.wrapping_add(1).max(1);
        let (setup, arming) = (verdict.setup, self.armings);
        let until = Micros(now.0.saturating_add(self.patience_us));
        // The clamping that is the reference is where the program wants it.
        let taught = self.taught.then(RigidTransform::identity);
        self.released.put(Released {
            setup,
            arming,
            until,
            transform: verdict.registration.as_ref().map(transform).or(taught),
            gone: Vec::new(),
            correction: match &verdict.correction {
                Some(correction) => correction.text.clone(),
                None => String::new(),
            },
        });
    }

    /// When an OK verdict is too old for what it has not released yet.
    fn too_old(&self) -> Option<Micros> {
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
    fn forget(&mut self) {
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
