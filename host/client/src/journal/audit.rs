//! The audit of a journal: its inputs once more through the brain, and every
//! decision compared with the one that it holds, bit for bit.

use umi_app::replay::{Difference, Replay};
use umi_core::journal::Entry;
use umi_core::units::Micros;
use umi_protocol::message::{MAX_RECORD, Record};

/// An audit under way.
pub struct Audit {
    replay: Box<Replay>,
    scratch: Box<[u8; MAX_RECORD]>,
    /// A start or a job has been seen: from there on everything is known.
    begun: bool,
    /// What was found so far.
    pub findings: Findings,
}

/// What an audit finds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Findings {
    /// Decisions that are the same, bit for bit.
    pub identical: u64,
    /// Entries whose replay differs, and how.
    pub differences: Vec<(u64, Difference)>,
    /// Entries before the first start or job that the journal still holds: what
    /// went before them is not known, so they cannot be replayed.
    pub skipped: u64,
}

impl Default for Audit {
    fn default() -> Self {
        Self {
            replay: Box::new(Replay::new()),
            scratch: Box::new([0; MAX_RECORD]),
            begun: false,
            findings: Findings::default(),
        }
    }
}

impl Audit {
    /// Takes the next entry of the journal.
    pub fn take(&mut self, entry: &Entry<'_>, record: &Record) {
        self.begun |= matches!(record, Record::Boot { .. } | Record::JobSet { .. });
        if !self.begun {
            self.findings.skipped += 1;
            return;
        }
        let before = self.replay.decisions();
        let time: Micros = entry.t;
        match self.replay.next(time, record, &mut self.scratch) {
            Ok(()) => self.findings.identical += self.replay.decisions() - before,
            Err(difference) => self.findings.differences.push((entry.seq, difference)),
        }
    }

    /// Entries are not there: what goes on behind them is not known before the next start or
    /// job.
    pub fn gap(&mut self) {
        *self.replay = Replay::new();
        self.begun = false;
    }

    /// The control printed, the probe touched or teaching was asked for behind the last verdict, or
    /// it became too old: the board stands by it no more.
    #[must_use]
    pub const fn taken_back(&self) -> bool {
        self.replay.taken_back()
    }

    /// The journal has ended before entry `next_seq`.
    #[must_use]
    pub fn finish(mut self, next_seq: u64) -> Findings {
        if let Err(difference) = self.replay.finish() {
            self.findings.differences.push((next_seq, difference));
        }
        self.findings
    }
}
