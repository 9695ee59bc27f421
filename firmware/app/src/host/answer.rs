//! Answers to the host's requests.
//!
//! An answer can be five kilobytes long, and its parts nearly so. Each kind is made by
//! a function of its own that is not inlined, so that the stack holds one at a time.

use heapless::Vec;
use umi_core::job::Run;
use umi_core::journal::archive::Archive;
use umi_core::journal::{Flash, JournalError};
use umi_core::units::Micros;
use umi_protocol::access::AccessMode;
use umi_protocol::config::BoardConfig;
use umi_protocol::immediate::ImmediateRequest;
use umi_protocol::job::Lessons;
use umi_protocol::message::{JournalInfo, MAX_ENTRY, Request, Response, Status};

use crate::access::{self, Caller, Guarded};
use crate::board::{Axes, Scanner, Unsupported};
use crate::capture::scan::Scans;
use crate::host::programs;
use crate::host::programs::response;
use crate::measure::settings::positions_mm;
use crate::measure::trust::custody::{AckError, ConfigError};
use crate::measure::{Instrument, SetJobError};

/// What an answer needs besides what the board has measured.
pub(crate) struct RequestContext<'a, F: Flash> {
    pub now: Micros,
    /// Frames from this host that were damaged.
    pub link_damaged: u32,
    pub scans: &'a Scans,
    /// Who may do what.
    pub guarded: &'a mut Guarded<F>,
    /// Who asks.
    pub caller: Caller,
}

/// Does what the host asks and says what came of it.
#[inline(never)]
pub(crate) fn answer<F: Flash>(
    measure: &mut Instrument<F>,
    station: &mut (impl Axes + Scanner),
    around: RequestContext<'_, F>,
    request: &Request,
) -> Response {
    match request {
        Request::IdentityGet => Response::Identity(measure.ledger.identity.clone()),
        Request::StatusGet => Response::Status(status(measure, &around)),
        Request::JobGet => job(measure.brain().run()),
        Request::JobCheck(job) => match measure.check(job) {
            Ok(()) => Response::Done,
            Err(error) => Response::JobRefused(error),
        },
        Request::JobSet(job) => match measure.set_job(around.now, job) {
            Ok(()) => Response::Done,
            Err(SetJobError::Job(error)) => Response::JobRefused(error),
            Err(SetJobError::Storage) => Response::StorageFailed,
        },
        Request::Teach { what } => match measure.teach(around.now, *what) {
            Ok(()) => Response::Done,
            Err(refusal) => Response::TeachRefused(refusal),
        },
        Request::LineListen(line) => match measure.listen(*line) {
            Ok(()) => Response::Done,
            Err(refusal) => Response::LineRefused(refusal),
        },
        Request::LiveSet { on } => {
            measure.ledger.events.switch(*on);
            around.scans.switch(*on);
            Response::Done
        }
        Request::HeadGet { nonce } => {
            // Nobody is a stranger to a board without an owner.
            let is_open = around.guarded.mode() == AccessMode::Open;
            let is_known = is_open || around.caller.key_id.is_some();
            Response::Head(measure.head_answer(around.now, *nonce, is_known))
        }
        Request::FeatureGet { feature: place } => feature(measure.brain().run(), *place),
        Request::VerdictGet => verdict(measure.brain().run()),
        Request::JournalInfo => journal(measure, |of, acked| {
            Response::JournalInfo(info(of, 0, acked))
        }),
        Request::JournalRead { seq } => journal(measure, |of, acked| read(of, *seq, acked)),
        Request::JournalChain { seq } => journal(measure, |of, acked| chain(of, *seq, acked)),
        Request::JournalAck { seq } => acknowledge(measure, around.now, *seq),
        Request::ConfigGet => config(measure),
        Request::ConfigSet(config) => set_config(measure, around.guarded, around.now, config),
        Request::PositionsGet => immediate(station, ImmediateRequest::Positions),
        Request::TriggerOutSet(when) => immediate(station, ImmediateRequest::TriggerOut(*when)),
        Request::LaserSet { on } => immediate(station, ImmediateRequest::Laser(*on)),
        Request::ProgramList { skip } => response(|| programs::list(measure, *skip)),
        Request::ProgramBegin(program) => response(|| programs::begin(measure, program)),
        Request::ProgramPiece { offset, bytes } => {
            response(|| programs::piece(measure, *offset, bytes))
        }
        Request::ProgramEnd { number, crc32 } => {
            programs::done(|| programs::end(measure, around.now, *number, *crc32))
        }
        Request::ProgramRead { number, offset } => {
            response(|| programs::read(measure, *number, *offset))
        }
        Request::ProgramDelete { number } => {
            programs::done(|| programs::delete(measure, around.now, *number))
        }
        Request::ProgramOffer { number } => response(|| programs::offer(measure, *number)),
        Request::ProgramReceive => response(|| programs::receive(measure)),
        Request::ProgramPass(info) => response(|| programs::pass(measure, info)),
        Request::ProgramPassed { offset, bytes } => {
            response(|| programs::passed(measure, *offset, bytes))
        }
        Request::ImageGet
        | Request::UpdateBegin { .. }
        | Request::UpdatePiece { .. }
        | Request::UpdateEnd => {
            let RequestContext { now, guarded, .. } = around;
            access::update(measure, guarded, station, now, request)
        }
        Request::HostTime { utc_s } => match measure.note_host_time(around.now, *utc_s) {
            true => Response::Done,
            false => Response::StorageFailed,
        },
        Request::SensorSet(sensor) => measure.set_sensor(around.now, sensor.as_ref()),
        Request::SensorGet => match measure.ledger.point {
            Some(point) => {
                // Its places are in the journal before its answer is known.
                measure.sensed(around.now, point);
                Response::Sensor(point.status())
            }
            None => Response::NotOnThisBoard,
        },
        Request::SensorCommand { line } => match measure.ledger.point {
            Some(point) => match point.host_line(line) {
                Ok(()) => Response::Done,
                Err(refusal) => Response::SensorRefused(refusal),
            },
            None => Response::NotOnThisBoard,
        },
        Request::AccessGet
        | Request::KeyList
        | Request::KeyEnrol(_)
        | Request::KeyRevoke { .. }
        | Request::LockSet { .. }
        | Request::Wipe
        | Request::SessionBegin(_)
        | Request::SessionProve { .. } => {
            let RequestContext {
                now,
                guarded,
                caller,
                ..
            } = around;
            access::answer(measure, guarded, now, &caller, request)
        }
    }
}

/// The answer to what needs nothing that was measured.
#[inline(never)]
pub(crate) fn immediate(
    station: &mut (impl Axes + Scanner),
    request: ImmediateRequest,
) -> Response {
    match request {
        ImmediateRequest::Positions => Response::Positions(station.positions()),
        ImmediateRequest::TriggerOut(when) => match station.trigger_out(when) {
            Ok(()) => Response::Done,
            Err(refusal) => Response::TriggerRefused(refusal),
        },
        ImmediateRequest::Laser(on) => done(station.laser(on)),
    }
}

#[inline(never)]
fn job(run: &Run) -> Response {
    Response::Job {
        job: run.job().cloned(),
        taught_mm: run.taught().map(|taught| positions_mm(taught.places)),
        learned: run
            .taught()
            .map_or(Lessons::NONE, |taught| taught.learned.clone()),
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

/// Answers from the journal, if its storage could be opened.
fn journal<F: Flash>(
    measure: &mut Instrument<F>,
    answer: impl FnOnce(&mut Archive<F>, u64) -> Response,
) -> Response {
    let acked = measure.ledger.acked();
    match measure.ledger.journal.get_mut() {
        Some(journal) => answer(journal, acked),
        None => Response::StorageFailed,
    }
}

#[inline(never)]
fn chain<F: Flash>(journal: &mut Archive<F>, seq: u64, acked: u64) -> Response {
    match journal.chain_before(seq) {
        Ok(chain) => Response::JournalChain {
            seq,
            before: Some(chain.0),
        },
        Err(JournalError::Record(_)) => Response::JournalChain { seq, before: None },
        Err(JournalError::OutOfRange { .. }) => Response::JournalNoEntry(info(journal, seq, acked)),
        Err(_) => Response::StorageFailed,
    }
}

fn done(result: Result<(), Unsupported>) -> Response {
    match result {
        Ok(()) => Response::Done,
        Err(Unsupported) => Response::NotOnThisBoard,
    }
}

#[inline(never)]
fn status<F: Flash>(measure: &Instrument<F>, around: &RequestContext<'_, F>) -> Status {
    let brain = measure.brain();
    let ledger = &measure.ledger;
    Status {
        uptime_us: around.now.0,
        reset: ledger.reset,
        job: brain.job().map(|job| job.name.clone()),
        job_lost: ledger.job_lost.get().copied(),
        has_reference: brain.run().reference().is_some(),
        teaching: brain.run().teach_pending(),
        verdicts: ledger.verdicts,
        verdicts_ok: ledger.verdicts_ok,
        last_verdict_ok: ledger.last_ok.get().copied(),
        correction_waiting: measure.waiting().is_some(),
        punched_lines: brain.punched_lines(around.now),
        counters: brain.counters(),
        events_dropped: ledger.events.dropped(),
        journal_failures: ledger.failures,
        link_damaged: around.link_damaged,
        latches: around.scans.counters(),
        access: around.guarded.mode(),
    }
}

/// What there is from entry `from` on; of an entry that is not there yet: all.
fn info<F: Flash>(journal: &mut Archive<F>, from: u64, acked: u64) -> JournalInfo {
    let next_seq = journal.next_seq();
    let from = if from < next_seq { from } else { 0 };
    let oldest = journal.first_seq();
    JournalInfo {
        // Where the flash says nothing, what the journal has.
        first_seq: journal.next_there(from).unwrap_or(oldest),
        next_seq,
        acked_seq: acked,
        lost: journal.lost_of(acked..u64::MAX),
    }
}

/// A host keeps elsewhere what stands before this entry.
#[inline(never)]
fn acknowledge<F: Flash>(measure: &mut Instrument<F>, now: Micros, seq: u64) -> Response {
    match measure.acknowledge(now, seq) {
        Ok(()) => Response::Done,
        Err(AckError::NoEntry) => journal(measure, |of, acked| {
            Response::JournalNoEntry(info(of, 0, acked))
        }),
        Err(AckError::NotOnThisBoard) => Response::NotOnThisBoard,
        Err(AckError::Storage) => Response::StorageFailed,
    }
}

#[inline(never)]
fn config<F: Flash>(measure: &Instrument<F>) -> Response {
    match measure.ledger.custody.get() {
        Some(custody) => Response::Config {
            config: custody.kept().config,
            fallbacks: custody.fallbacks(),
        },
        None => Response::NotOnThisBoard,
    }
}

#[inline(never)]
fn set_config<F: Flash>(
    measure: &mut Instrument<F>,
    guarded: &mut Guarded<F>,
    now: Micros,
    config: &BoardConfig,
) -> Response {
    match measure.set_config(now, config) {
        Ok(()) => {
            guarded.follow(&config.access);
            guarded.note_config(now, measure);
            Response::Done
        }
        Err(ConfigError::Field(field)) => Response::ConfigRefused(field),
        Err(ConfigError::Job(error)) => Response::JobRefused(error),
        Err(ConfigError::NotOnThisBoard) => Response::NotOnThisBoard,
        Err(ConfigError::Storage) => Response::StorageFailed,
    }
}

/// One entry as it is stored: also a damaged one is for the host to judge. It is five kilobytes:
/// on the stack only here.
#[inline(never)]
fn read<F: Flash>(journal: &mut Archive<F>, seq: u64, acked: u64) -> Response {
    let mut raw = Vec::<u8, MAX_ENTRY>::new();
    // There is room for as many.
    let _ = raw.resize_default(MAX_ENTRY);
    match journal.read_encoded(seq, &mut raw) {
        Ok(length) => {
            raw.truncate(length);
            Response::JournalEntry { seq, raw }
        }
        Err(JournalError::OutOfRange { .. }) => Response::JournalNoEntry(info(journal, seq, acked)),
        Err(JournalError::Record(_)) => {
            // Where it begins is not known: nothing of it can be shown, and it is none the less there.
            raw.clear();
            Response::JournalEntry { seq, raw }
        }
        Err(_) => Response::StorageFailed,
    }
}

#[cfg(test)]
mod tests {
    use umi_protocol::latch::{Positions, TriggerOut, TriggerRefusal};
    use umi_protocol::message::RequestClass;

    use super::*;
    use crate::test_board::NoFlash;

    /// No axes, no outputs.
    struct Bare;

    impl Axes for Bare {
        fn positions(&mut self) -> Positions {
            Positions::default()
        }
    }

    impl Scanner for Bare {
        fn trigger_out(&mut self, _: TriggerOut) -> Result<(), TriggerRefusal> {
            Err(TriggerRefusal::NoOutput)
        }

        fn laser(&mut self, _: bool) -> Result<(), Unsupported> {
            Err(Unsupported)
        }
    }

    /// Every request gets one of the answers that its row in the table names.
    #[test]
    fn every_answer_is_in_the_table() {
        let mut measure = Instrument::<NoFlash>::new();
        let mut guarded = Guarded::new();
        let scans = Scans::new();
        let mut immediate = 0;
        let mut requests = 0;
        // One byte names a request; from 0x80 on it would go on in the next.
        for tag in 0..0x80_u8 {
            // Numbers, lists and texts of nothing: every request can be read from zeros.
            let mut bytes = [0; 512];
            bytes[0] = tag;
            let Ok((request, _)) = postcard::take_from_bytes::<Request>(&bytes) else {
                continue;
            };
            let around = RequestContext {
                now: Micros(0),
                link_damaged: 0,
                scans: &scans,
                guarded: &mut guarded,
                caller: Caller::NOBODY,
            };
            let response = answer(&mut measure, &mut Bare, around, &request);
            assert!(
                request.is_answered_by(&response),
                "{request:?}: {response:?}"
            );
            immediate += u32::from(request.class() == RequestClass::Immediate);
            requests += 1;
        }
        assert!(requests >= 24, "read {requests} requests only");
        assert_eq!(immediate, 3);
    }
}
