//! Answers to the host's requests.
//!
//! An answer can be five kilobytes long, and its parts nearly so. Each kind is made by
//! a function of its own that is not inlined, so that the stack holds one at a time.

use heapless::Vec;
use umi_core::job::Run;
use umi_core::journal::{Error, Flash, Journal};
use umi_core::units::Micros;
use umi_protocol::at_once::AtOnce;
use umi_protocol::message::{JournalInfo, MAX_ENTRY, Request, Response, Status};

use crate::board::{Axes, Scanner, Unsupported};
use crate::measure::{Measure, SetJobError};
use crate::programs;
use crate::scan::Scans;
use crate::settings::positions_mm;

/// What an answer needs besides what the board has measured.
pub(crate) struct Surroundings<'a> {
    pub now: Micros,
    /// Frames from this host that were damaged.
    pub link_damaged: u32,
    pub scans: &'a Scans,
}

/// Does what the host asks and says what came of it.
#[inline(never)]
pub(crate) fn answer<F: Flash>(
    measure: &mut Measure<F>,
    around: Surroundings<'_>,
    request: &Request,
) -> Response {
    match request {
        Request::IdentityGet => Response::Identity(measure.book.identity.clone()),
        Request::StatusGet => Response::Status(status(measure, &around)),
        Request::JobGet => job(measure.brain().run()),
        Request::JobCheck(job) => match umi_core::job::check(job) {
            Ok(()) => Response::Done,
            Err(error) => Response::JobRefused(error),
        },
        Request::JobSet(job) => match measure.set_job(around.now, job) {
            Ok(()) => Response::Done,
            Err(SetJobError::Job(error)) => Response::JobRefused(error),
            Err(SetJobError::Storage) => Response::StorageFailed,
        },
        Request::LiveSet { on } => {
            measure.book.events.switch(*on);
            around.scans.switch(*on);
            Response::Done
        }
        Request::FeatureGet { feature: place } => feature(measure.brain().run(), *place),
        Request::VerdictGet => verdict(measure.brain().run()),
        Request::JournalInfo | Request::JournalRead { .. } | Request::JournalChain { .. } => {
            match measure.book.journal.get_mut() {
                Some(journal) => about_journal(journal, request),
                None => Response::StorageFailed,
            }
        }
        // Answered before, without the state: see `at_once`.
        Request::PositionsGet | Request::TriggerOutSet(_) | Request::LaserSet { .. } => {
            Response::NotOnThisBoard
        }
        Request::ProgramList { .. }
        | Request::ProgramBegin(_)
        | Request::ProgramPiece { .. }
        | Request::ProgramEnd { .. }
        | Request::ProgramRead { .. }
        | Request::ProgramDelete { .. }
        | Request::ProgramOffer { .. }
        | Request::ProgramReceive
        | Request::ProgramPass(_)
        | Request::ProgramPassed { .. } => programs::answer(measure, around.now, request),
    }
}

/// The answer to what needs nothing that was measured.
#[inline(never)]
pub(crate) fn at_once(station: &mut (impl Axes + Scanner), request: AtOnce) -> Response {
    match request {
        AtOnce::Positions => Response::Positions(station.positions()),
        AtOnce::TriggerOut(when) => done(station.trigger_out(when)),
        AtOnce::Laser(on) => done(station.laser(on)),
    }
}

#[inline(never)]
fn job(run: &Run) -> Response {
    Response::Job {
        job: run.job().cloned(),
        taught_mm: run.taught().map(positions_mm),
    }
}

#[inline(never)]
fn feature(run: &Run, place: u8) -> Response {
    Response::Feature(run.feature(usize::from(place)).cloned())
}

#[inline(never)]
fn verdict(run: &Run) -> Response {
    Response::Verdict(run.verdict().cloned())
}

/// What the journal holds.
#[inline(never)]
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

#[inline(never)]
fn status<F: Flash>(measure: &Measure<F>, around: &Surroundings<'_>) -> Status {
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
    let mut raw = Vec::<u8, MAX_ENTRY>::new();
    // There is room for as many.
    let _ = raw.resize_default(MAX_ENTRY);
    match journal.read_encoded(seq, &mut raw).map(<[u8]>::len) {
        Ok(length) => {
            raw.truncate(length);
            Response::JournalEntry { seq, raw }
        }
        Err(Error::OutOfRange { .. }) => Response::JournalNoEntry(info(journal)),
        Err(_) => Response::StorageFailed,
    }
}
