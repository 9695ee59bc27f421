//! Answers to the host's requests.

use umi_core::journal::{Error, Flash, Journal};
use umi_core::units::Micros;
use umi_protocol::message::{JournalInfo, MAX_ENTRY, Request, Response, Status};

use crate::board::{Axes, Scanner, Unsupported};
use crate::measure::{Measure, SetJobError};
use crate::scan::Scans;
use crate::settings::positions_mm;

/// What an answer needs besides what the board has measured.
pub(crate) struct Surroundings<'a, Station> {
    pub now: Micros,
    /// Frames from this host that were damaged.
    pub link_damaged: u32,
    pub scans: &'a Scans,
    pub station: &'a mut Station,
}

/// Does what the host asks and says what came of it.
pub(crate) fn answer<F: Flash>(
    measure: &mut Measure<F>,
    around: Surroundings<'_, impl Axes + Scanner>,
    request: Request,
) -> Response {
    match request {
        Request::IdentityGet => Response::Identity(measure.book.identity.clone()),
        Request::StatusGet => Response::Status(status(measure, &around)),
        Request::JobGet => {
            let run = measure.brain().run();
            Response::Job {
                job: run.job().cloned(),
                taught_mm: run.taught().map(positions_mm),
            }
        }
        Request::JobCheck(job) => match umi_core::job::check(&job) {
            Ok(()) => Response::Done,
            Err(error) => Response::JobRefused(error),
        },
        Request::JobSet(job) => match measure.set_job(around.now, job) {
            Ok(()) => Response::Done,
            Err(SetJobError::Job(error)) => Response::JobRefused(error),
            Err(SetJobError::Storage) => Response::StorageFailed,
        },
        Request::LiveSet { on } => {
            measure.book.events.switch(on);
            around.scans.switch(on);
            Response::Done
        }
        Request::FeatureGet { feature } => {
            let run = measure.brain().run();
            Response::Feature(run.feature(usize::from(feature)).cloned())
        }
        Request::VerdictGet => Response::Verdict(measure.brain().run().verdict().cloned()),
        Request::JournalInfo | Request::JournalRead { .. } | Request::JournalChain { .. } => {
            match measure.book.journal.get_mut() {
                Some(journal) => about_journal(journal, &request),
                None => Response::StorageFailed,
            }
        }
        Request::PositionsGet => Response::Positions(around.station.positions()),
        Request::TriggerOutSet(when) => done(around.station.trigger_out(when)),
        Request::LaserSet { on } => done(around.station.laser(on)),
    }
}

/// What the journal holds.
fn about_journal<F: Flash>(journal: &mut Journal<F>, request: &Request) -> Response {
    match *request {
        Request::JournalRead { seq } => read(journal, seq),
        Request::JournalChain { seq } => match journal.chain_before(seq) {
            Ok(chain) => Response::JournalChain {
                seq,
                before: Some(chain.0),
            },
            Err(Error::Record(_)) => Response::JournalChain { seq, before: None },
            Err(Error::OutOfRange { .. }) => Response::JournalNoEntry(info(journal)),
            Err(_) => Response::StorageFailed,
        },
        _ => Response::JournalInfo(info(journal)),
    }
}

fn done(result: Result<(), Unsupported>) -> Response {
    match result {
        Ok(()) => Response::Done,
        Err(Unsupported) => Response::NotOnThisBoard,
    }
}

fn status<F: Flash, Station>(measure: &Measure<F>, around: &Surroundings<'_, Station>) -> Status {
    let brain = measure.brain();
    let book = &measure.book;
    Status {
        uptime_us: around.now.0,
        reset: book.reset,
        job: brain.job().map(|job| job.name.clone()),
        has_reference: brain.run().reference().is_some(),
        verdicts: book.verdicts,
        verdicts_ok: book.verdicts_ok,
        last_verdict_ok: book.last_ok.get().copied(),
        correction_waiting: measure.waiting().is_some(),
        counters: brain.counters(),
        events_dropped: book.events.dropped(),
        journal_failures: book.failures,
        link_damaged: around.link_damaged,
        latches: around.scans.counters(),
    }
}

fn info<F: Flash>(journal: &Journal<F>) -> JournalInfo {
    JournalInfo {
        first_seq: journal.first_seq(),
        next_seq: journal.next_seq(),
    }
}

/// One entry as it is stored: also a damaged one is for the host to judge.
fn read<F: Flash>(journal: &mut Journal<F>, seq: u64) -> Response {
    let mut entry = [0; MAX_ENTRY];
    match journal.read_encoded(seq, &mut entry) {
        Ok(bytes) => match heapless::Vec::from_slice(bytes) {
            Ok(raw) => Response::JournalEntry { seq, raw },
            Err(_) => Response::StorageFailed,
        },
        Err(Error::OutOfRange { .. }) => Response::JournalNoEntry(info(journal)),
        Err(_) => Response::StorageFailed,
    }
}
