//! A board's start: its storage is opened, and what was in force is taken up.

use umi_core::job::Teaching;
use umi_core::journal::archive::{Archive, ArchiveFault};
use umi_core::journal::{Flash, JournalError};
use umi_core::programs::{self, Store};
use umi_core::units::Micros;
use umi_protocol::message::{Identity, JobLoss, MAX_RECORD, Record, ResetReason};

use crate::board::LineAbilities;
use crate::measure::settings::{JobStore, points};
use crate::measure::trust::custody::{Custody, erase};
use crate::measure::trust::signer::HeadSigner;
use crate::measure::{Instrument, Ledger, patience_us};

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
    pub signer: Option<&'static HeadSigner>,
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

impl<F: Flash> StorageAreas<F> {
    /// Erases all of them. A power cut on the way leaves the rest for the next start.
    pub(crate) fn erase(&mut self) {
        let areas = [&mut self.journal, &mut self.settings, &mut self.programs];
        let optional = [&mut self.evidence, &mut self.custody];
        let optional = optional.into_iter().filter_map(Option::as_mut);
        for area in areas.into_iter().chain(optional) {
            erase(area);
        }
    }
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

/// Kind of records that say that keys were kept.
pub(crate) const ACCESS: u8 = 30;
/// The same of a configuration.
const CONFIG_SET: u8 = 28;

impl<F: Flash> Instrument<F> {
    /// Starts: opens journal and settings. The job and the reference come next, under the ceilings that are in force then.
    ///
    /// A storage area that cannot be opened stops nothing: the board runs and answers,
    /// counts every entry that it cannot keep, shows trouble, sends no correction, and
    /// takes no job. Without the area of the programs, there are none. What was wrong is
    /// returned for a log.
    pub fn start(&mut self, boot: Boot, storage: StorageAreas<F>, now: Micros) -> Opened<F::Error> {
        // Before the journal: what is acknowledged says what it may overwrite.
        self.open_custody(storage.custody);
        let StorageAreas {
            journal,
            evidence,
            settings,
            programs,
            ..
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
        let is_new = self.ledger.custody.get().is_some_and(Custody::is_new);
        let opened = Opened {
            journal: self.open_journal(now, boot, journal, evidence),
            settings: JobStore::open(settings).map(|settings| self.settings.put(settings)),
            programs: Store::open(programs).map(|programs| self.programs.put(programs)),
        };
        if opened.settings.is_err() {
            self.ledger.refused();
        }
        self.take_custody(now, is_new);
        opened
    }

    /// Opens what is kept for the owner, if it is not open.
    #[inline(never)]
    pub(crate) fn open_custody(&mut self, flash: Option<F>) {
        if let Some(flash) = flash {
            self.ledger.custody.put(Custody::open(flash));
        }
    }

    /// Takes up the job and the reference that were in force, under the ceilings that are in force now.
    pub(crate) fn take_up(&mut self, now: Micros) {
        self.restore(now);
        self.restore_sensor(now);
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
            (Some(evidence), Some(archive)) => archive
                .keep_evidence(evidence, &mut ledger.scratch)
                .map(Some),
            _ => Ok(None),
        };
        self.ledger.hold_evidence();
        self.ledger.record(now, boot);
        let mut recovery = opened.map_err(ArchiveFault::Journal)?;
        self.ledger.is_new = recovery.fresh;
        self.ledger.heads.opened(recovery.next_seq);
        match &kept_apart {
            // What a power cut has left of a piece was no loss: the journal had it.
            Ok(Some(of_ring)) => recovery.add(of_ring),
            Ok(None) => {}
            // No evidence is kept apart: its chain has ended.
            Err(_) => recovery.chain_restarted = true,
        }
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
        kept_apart.map(|_| ())
    }

    /// Takes up what is kept for the owner.
    #[inline(never)]
    fn take_custody(&mut self, now: Micros, is_new: bool) {
        let Ledger {
            custody, journal, ..
        } = &mut self.ledger;
        // Only where nothing was ever kept, or everything of it is gone: the evidence says which.
        if let (true, Some(custody), Some(journal)) = (is_new, custody.get_mut(), journal.get_mut())
        {
            let (is_lost, _) = journal.tells(CONFIG_SET, 0);
            custody.begin(now, is_lost);
        }
        self.ledger.hold_evidence();
        self.ledger.tell_kept_config(now);
    }

    /// Tells a start once more, and with it what is in force, where a record of that found no room, now that there is some: nobody
    /// could audit what follows without it. What was under way begins anew, as at a start. Not where a host's request is
    /// answered: the stack has no room for a start there.
    #[inline(never)]
    pub(crate) fn tell_again(&mut self, now: Micros) {
        let ledger = &mut self.ledger;
        let journal = ledger.journal.get_mut();
        if !ledger.untold || !journal.is_some_and(|journal| journal.takes(MAX_RECORD, true)) {
            return;
        }
        ledger.untold = false;
        ledger.tell_repeats(now);
        ledger.forget();
        let (identity, reset) = (ledger.identity.clone(), ledger.reset);
        ledger.record(now, Record::Boot { identity, reset });
        ledger.tell_kept_config(now);
        self.take_up(now);
        self.ledger.upload.over(false);
        self.keep_punched(now);
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
        if fits.is_err() || !is_narrow || self.brain.begin(&job).is_err() {
            return self.ledger.job_lost(now, JobLoss::Refused);
        }
        self.ledger.patience_us = patience_us(&job);
        self.ledger.job_set(now, &job);
        self.count_on(now, None);
        if let Some((positions_mm, learned)) = taught {
            self.brain.restore_reference(Teaching {
                places: &points(&positions_mm),
                learned: &learned,
            });
            self.ledger.reference_restored(now, positions_mm, learned);
        }
    }
}
