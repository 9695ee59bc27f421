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
//! checked line nor asks for a program, a loss, another verdict, a new job, the job's setup time-out,
//! and, where blocks have no run number, a touch of the probe. It also goes out
//! once only: the next clamping must not get it by a READ without probing. One
//! that broke off may be read again. The same verdict releases the part programs that need
//! one (`delivery`).
//!
//! # Tradeoffs
//!
//! If the journal's storage refuses an input, measuring goes on and says so in
//! its status, but the setup cannot be audited: no correction is armed until a
//! job is set or the board starts anew, and its storage works again.

pub(crate) mod delivery;
mod events;
mod faults;
mod ledger;
pub(crate) mod opening;
pub(crate) mod owner;
pub(crate) mod release;
mod sensed;
pub(crate) mod settings;
pub mod trust;
mod upload;

pub(crate) use ledger::Ledger;
pub use opening::{Boot, Opened, StorageAreas};

use heapless::Vec;
use umi_core::brain::Brain;
use umi_core::job::{begins_anew, looks_at_falls};
use umi_core::journal::Flash;
use umi_core::programs::Store;
use umi_core::trust::access::update::slots::Slots;
use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;
use umi_protocol::fault::Counters;
use umi_protocol::job::Job;
use umi_protocol::job_error::JobError;
use umi_protocol::latch::LatchCause;
use umi_protocol::message::{LineRefusal, MAX_RECORD, TeachBy, TeachRefusal, TeachWhat};
use umi_protocol::pattern::{Coding, Handshake};
use umi_protocol::program::ProgramRefusal;
use umi_protocol::serial::LineSettings;

use crate::board::Lights;
use crate::intake::Input;
use crate::measure::delivery::Delivery;
use crate::measure::settings::{JobStore, NotKept, kept};
use crate::measure::upload::UploadEnd;

/// Room in the journal that a setup may need: its bytes, features and verdict.
const ROOM: u32 = 4 * MAX_RECORD as u32;

/// Room for the images of a board that takes some, if this application does.
const IMAGES: usize = cfg!(feature = "update") as usize;

/// What the board knows.
pub struct Instrument<F: Flash> {
    brain: Brain,
    pub(crate) settings: ZeroOption<JobStore<F>>,
    /// Part programs.
    pub(crate) programs: ZeroOption<Store<F>>,
    /// What is being sent to the control.
    pub(crate) delivery: ZeroOption<Delivery>,
    pub(crate) ledger: Ledger<F>,
    /// Signed images, if this board takes them.
    pub(crate) images: Vec<Slots<F>, IMAGES>,
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
            ledger: Ledger::new(),
            images: Vec::new(),
        }
    }

    /// Something came in. Without a job it is journaled and that is all.
    pub fn input(&mut self, now: Micros, input: &Input) {
        let Self { brain, ledger, .. } = self;
        if let Input::Latch(latch) = input
            && latch.cause == LatchCause::SkipEnd
            && brain.job().is_none_or(|job| !looks_at_falls(job))
        {
            // Nobody looks at it: the end of a touch would be one more write of the flash.
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
            Input::Latch(latch) => {
                brain.latched(latch);
                if brain.job().is_some_and(|job| begins_anew(job, latch)) {
                    ledger.forget();
                }
            }
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
            ledger.refusals.due(),
            ledger.ack_due(),
            ledger.tells_again.then_some(Micros(0)),
        ];
        times.into_iter().flatten().min()
    }

    /// Before whatever comes: a start, or what is in force, that found no room in the journal is told now that there is some.
    pub fn tell_what_waits(&mut self, now: Micros) {
        if core::mem::take(&mut self.ledger.tells_again) {
            self.tell_again(now);
        }
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
        if ledger.refusals.due().is_some_and(|due| now >= due) {
            ledger.tell_refusals(now);
        }
        if ledger.ack_due().is_some_and(|due| now >= due) {
            ledger.keep_late_ack(now);
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
        let last_run = brain.run().last_run();
        if is_untouched(brain) && brain.job() == Some(job) && !ledger.is_unaudited() {
            // It is in force as if it had just been set.
            return Ok(());
        }
        if !ledger.changes.take(now) {
            return Err(SetJobError::Job(JobError::TooOften));
        }
        // A job whose record finds no room could not be audited.
        let journal = ledger.journal.get_mut();
        if !journal.is_some_and(|journal| journal.takes(MAX_RECORD, true)) {
            return Err(SetJobError::Storage);
        }
        // Neither is dropped for the other.
        ledger
            .keep_sensor_in(settings, now)
            .and_then(|()| settings.save(now, job, None, &mut ledger.scratch))
            .map_err(|_| SetJobError::Storage)?;
        ledger.tell_repeats(now);
        ledger.forget();
        // What found no room in the journal before is told again with this job, when there is room.
        ledger.unaudited = false;
        ledger.patience_us = patience_us(job);
        brain.begin(job).map_err(SetJobError::Job)?;
        ledger.job_lost.clear();
        ledger.job_set(now, job);
        // The control counts on, whatever the job.
        self.count_on(now, last_run);
        let ledger = &mut self.ledger;
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
        if what != TeachWhat::Keep {
            ledger.forget();
        }
        ledger.teach_asked(now, what);
        brain.teach(now, TeachBy::Host, what, &mut ledger.listen(now))?;
        self.keep_taught(now);
        Ok(())
    }

    /// The board's button was held: as a host that asks to teach, and as little as it does a
    /// button replace a reference that there is; nothing where the owner has switched it off.
    fn held(&mut self, now: Micros) {
        let Self { brain, ledger, .. } = self;
        let refused = match ledger.in_custody().config.access.button_off {
            true => Some(TeachRefusal::ButtonOff),
            false => brain.run().may_teach(TeachWhat::Reference).err(),
        };
        if refused.is_none() {
            ledger.forget();
        }
        ledger.button_held(now, refused);
        if refused.is_none() {
            // It was asked a moment ago: it is taken.
            let what = TeachWhat::Reference;
            let _ = brain.teach(now, TeachBy::Button, what, &mut ledger.listen(now));
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
            trouble: self.ledger.is_unaudited(),
        }
    }

    /// Keeps what the control punches.
    pub(crate) fn keep_punched(&mut self, now: Micros) {
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

    /// Keeps the job that is in force once more, with its reference; nothing where there is none.
    pub(crate) fn keep_job(&mut self, now: Micros) -> Result<(), NotKept> {
        let Self {
            brain,
            settings,
            ledger,
            ..
        } = self;
        let taught = brain.run().taught().as_ref().map(kept);
        match settings.get_mut().zip(brain.job()) {
            Some((settings, job)) => settings.save(now, job, taught.as_ref(), &mut ledger.scratch),
            None => Ok(()),
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
            ledger
                .keep_sensor_in(s, now)
                .and_then(|()| s.save(now, job, taught.as_ref(), &mut ledger.scratch))
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

/// Nothing was measured or taught since the job began.
fn is_untouched(brain: &Brain) -> bool {
    let run = brain.run();
    !run.is_under_way()
        && run.verdict().is_none()
        && run.taught().is_none()
        && brain.counters() == Counters::default()
}

/// How long a correction stays armed, and a setup open.
pub(crate) fn patience_us(job: &Job) -> u64 {
    u64::from(job.plate_timeout_s).saturating_mul(1_000_000)
}

/// Why a job was not set.
#[derive(Clone, Debug, PartialEq)]
pub enum SetJobError {
    /// It cannot be used.
    Job(JobError),
    /// It could not be kept.
    Storage,
}
