//! What the owner asks of a board, and what the board does about it: [`crate::measure::trust::custody`].

use umi_core::journal::Flash;
use umi_core::journal::archive::Archive;
use umi_core::trust::access::register::Age;
use umi_core::units::Micros;
use umi_protocol::access::{AccessRefusal, KeyId};
use umi_protocol::config::{BoardConfig, WhenFull};
use umi_protocol::job_error::JobError;
use umi_protocol::message::{MAX_RECORD, Record};
use umi_protocol::program::Withheld;

use crate::measure::trust::custody::{AckError, ConfigError, Custody, Kept, NOTHING_KEPT};
use crate::measure::{Instrument, Ledger};

/// Room for evidence below which nothing goes out any more where the owner wants it kept: more
/// than is erased ahead, and enough for what an OK verdict still causes.
const MARGIN: u32 = 6 * MAX_RECORD as u32;

/// Bytes of a record of a few numbers.
pub(crate) const SMALL: usize = 64;

impl<F: Flash> Instrument<F> {
    /// A host keeps elsewhere what stands before entry `seq`.
    ///
    /// Of many within a short time the latest is kept within a minute. Without power until then it is
    /// forgotten: those entries are not acknowledged, and a host says so again.
    ///
    /// # Errors
    /// [`AckError`]: nothing has changed.
    pub(crate) fn acknowledge(&mut self, now: Micros, seq: u64) -> Result<(), AckError> {
        let ledger = &mut self.ledger;
        let journal = ledger.journal.get().ok_or(AckError::Storage)?;
        if !ledger.custody.is_some() {
            return Err(AckError::NotOnThisBoard);
        }
        if seq > journal.next_seq() {
            return Err(AckError::NoEntry);
        }
        if seq <= ledger.acked() {
            return Ok(());
        }
        let next_seq = journal.next_seq();
        if ledger.acks.take(now) {
            let kept = ledger.keep_ack(now, seq);
            let journal = ledger.journal.get();
            if kept.is_err() && journal.is_some_and(|journal| journal.next_seq() == next_seq) {
                // It has cost nothing: who acknowledges more finds his turn.
                ledger.acks.give_back();
            }
            return kept;
        }
        // Each costs room for evidence, and cells: many are kept as one.
        ledger.acked.put(seq);
        Ok(())
    }

    /// Replaces what the owner allows.
    ///
    /// # Errors
    /// [`ConfigError`]: nothing has changed.
    pub(crate) fn set_config(
        &mut self,
        now: Micros,
        config: &BoardConfig,
    ) -> Result<(), ConfigError> {
        config.check().map_err(ConfigError::Field)?;
        if let Some(job) = self.brain().job() {
            config.ceilings.check(job).map_err(ConfigError::Job)?;
        }
        let ledger = &mut self.ledger;
        let custody = ledger.custody.get_mut();
        let custody = custody.ok_or(ConfigError::NotOnThisBoard)?;
        if !ledger.changes.take(now) {
            return Err(ConfigError::Job(JobError::TooOften));
        }
        let kept = Kept {
            config: *config,
            ..*custody.kept()
        };
        let before = custody.kept().config;
        // A record without its deed is taken back; never a deed without its record.
        if !ledger.record(now, Record::ConfigSet(*config)) {
            return Err(ConfigError::Storage);
        }
        let custody = ledger.custody.get_mut();
        if custody.is_some_and(|custody| custody.save(now, kept).is_ok()) {
            ledger.hold_evidence();
            return Ok(());
        }
        ledger.record(now, Record::ConfigSet(before));
        Err(ConfigError::Storage)
    }

    /// The board has an owner, and its keys are of this age: known here, too, should their area be erased or an older copy
    /// of it be put back.
    pub(crate) fn note_owner(&mut self, now: Micros, age: Age) {
        if let Some(custody) = self.ledger.custody.get_mut() {
            let mut marks = custody.marks();
            (marks.is_owned, marks.age.keys) = (true, age.keys);
            if custody.note(now, marks, false).is_err() {
                self.ledger.refused();
            }
        }
    }

    /// A job begins, and the runs that were judged before it are old: in the memory of this start, else as
    /// they were kept.
    pub(crate) fn count_on(&mut self, now: Micros, last_run: Option<u32>) {
        if let Some(run) = last_run.or(self.ledger.in_custody().last_run) {
            self.brain.restore_last_run(run);
            self.ledger.record(now, Record::LastRun { run });
        }
    }

    /// Keeps the greatest run that was judged, if it is another. Without a job there is none, and what
    /// was kept stays.
    pub(crate) fn keep_last_run(&mut self, now: Micros) {
        let last_run = self.brain().run().last_run();
        if last_run.is_none() {
            return;
        }
        let ledger = &mut self.ledger;
        let Some(custody) = ledger.custody.get_mut() else {
            return;
        };
        let kept = *custody.kept();
        if kept.last_run != last_run && custody.save(now, Kept { last_run, ..kept }).is_err() {
            // After a restart it would be judged again.
            ledger.refused();
        }
    }
}

impl<F: Flash> Instrument<F> {
    /// Journals what a host's clock says; within a minute of the last time, nothing. False: it is
    /// not in the journal.
    #[inline(never)]
    pub(crate) fn note_host_time(&mut self, now: Micros, utc_s: u64) -> bool {
        const LEAST_US: u64 = 60_000_000;
        let ledger = &mut self.ledger;
        let latest = ledger.host_time;
        if latest != Micros(0) && now.0.saturating_sub(latest.0) < LEAST_US {
            return true;
        }
        let journal = ledger.journal.get_mut();
        if journal.is_some_and(|journal| !journal.takes(SMALL, false)) {
            // Who comes to pull a full journal must not fail by it, and nothing rests on it.
            return true;
        }
        let key_id = ledger.by.get().copied();
        let kept = ledger.record(now, Record::HostTime { utc_s, key_id });
        if kept {
            ledger.host_time = Micros(now.0.max(1));
        }
        kept
    }

    /// Somebody was refused something.
    #[inline(never)]
    pub(crate) fn refuse_access(&mut self, now: Micros, why: AccessRefusal, key_id: Option<KeyId>) {
        self.ledger.refusals.count(why, key_id);
        self.ledger.tell_refusals(now);
    }
}

impl<F: Flash> Ledger<F> {
    /// Tells what was refused and is due.
    #[inline(never)]
    pub(crate) fn tell_refusals(&mut self, now: Micros) {
        while let Some(record) = self.refusals.take(now) {
            self.record(now, record);
        }
    }

    /// Journals the configuration that is in force.
    pub(crate) fn tell_config(&mut self, now: Micros) {
        let config = self.in_custody().config;
        self.record(now, Record::ConfigSet(config));
    }

    /// The same, where it is another than that of a new board.
    pub(crate) fn tell_kept_config(&mut self, now: Micros) {
        if self.in_custody().config != BoardConfig::default() {
            self.tell_config(now);
        }
    }

    /// What is kept for the owner; on a board without the ring, nothing.
    pub(crate) fn in_custody(&self) -> &Kept {
        self.custody.get().map_or(&NOTHING_KEPT, Custody::kept)
    }

    /// The entries before this one are kept elsewhere.
    pub(crate) fn acked(&self) -> u64 {
        let later = self.acked.get().copied();
        self.in_custody().acked.max(later.unwrap_or(0))
    }

    /// Keeps an acknowledgement, and tells what was lost since the one that was kept before.
    #[inline(never)]
    pub(crate) fn keep_ack(&mut self, now: Micros, seq: u64) -> Result<(), AckError> {
        let journal = self.journal.get_mut().ok_or(AckError::Storage)?;
        let custody = self.custody.get().ok_or(AckError::NotOnThisBoard)?;
        let kept = *custody.kept();
        // What is damaged blocks nothing: it counts as lost.
        let lost = journal.lost_of(kept.acked..seq);
        // It makes the room for its own record. That comes first, for behind the deed nobody could
        // count the loss again.
        if kept.config.journal.full == WhenFull::Refuse {
            journal.hold(Some(seq));
        }
        let is_told = self.record(now, Record::Acknowledged { seq, lost });
        let kept = Kept { acked: seq, ..kept };
        let custody = self.custody.get_mut();
        let is_kept = is_told && custody.is_some_and(|of| of.save(now, kept).is_ok());
        self.hold_evidence();
        if !is_kept {
            return Err(AckError::Storage);
        }
        self.acked.clear();
        Ok(())
    }

    /// When an acknowledgement that waits is to be kept.
    pub(crate) fn ack_due(&self) -> Option<Micros> {
        self.acked.get().map(|_| self.acks.next())
    }

    /// Keeps an acknowledgement that waits, if it is time.
    pub(crate) fn keep_late_ack(&mut self, now: Micros) {
        if let Some(seq) = self.acked.get().copied()
            && self.acks.take(now)
        {
            // What is not kept waits for its next turn.
            let _ = self.keep_ack(now, seq);
        }
    }

    /// The journal overwrites no evidence that nobody has acknowledged, if the owner wants that.
    pub(crate) fn hold_evidence(&mut self) {
        let Kept { config, acked, .. } = *self.in_custody();
        let is_wanted = config.journal.full == WhenFull::Refuse;
        if let Some(journal) = self.journal.get_mut() {
            journal.hold(is_wanted.then_some(acked));
        }
        self.heads.has_room();
        self.tells_again = self.untold;
    }

    /// Why nothing is released.
    pub(crate) fn no_verdict(&self, now: Micros) -> Withheld {
        if self.is_held_back {
            return Withheld::JournalFull;
        }
        match self.released.get().filter(|of| now < of.until) {
            Some(released) if released.is_taught => Withheld::OnlyTaught,
            Some(released) if released.is_gone => Withheld::CorrectionGone,
            _ => Withheld::NoVerdict,
        }
    }

    /// Whether nothing may go out before somebody has acknowledged evidence.
    pub(crate) fn is_full(&mut self) -> bool {
        let Kept { config, acked, .. } = *self.in_custody();
        let is_full = |journal: &mut Archive<F>| journal.is_full(acked, MARGIN);
        config.journal.full == WhenFull::Refuse && self.journal.get_mut().is_some_and(is_full)
    }
}
