//! The host's requests about part programs.
//!
//! # Design
//!
//! Flash that is written keeps the whole state locked, for up to half a second where a
//! sector is erased. So nothing is written while a setup is being measured: the host is
//! told to ask again. Reading a piece takes a fraction of a millisecond; the end of an upload
//! reads the whole program back, by the speed of the flash.
//!
//! Each answer is made by a function of its own that is not inlined: see `answer`.

use umi_core::journal::Flash;
use umi_core::programs::{Store, StoreError};
use umi_core::units::Micros;
use umi_protocol::message::{Record, Response};
use umi_protocol::program::{MAX_PIECE, Piece, ProgramInfo, ProgramRefusal, Release};

use crate::measure::Instrument;
use crate::measure::owner::SMALL;

/// What came of a request about programs.
pub(crate) type Answer<F> = Result<Response, StoreError<<F as Flash>::Error>>;

/// The answer that a host gets. What comes of the work is on the stack only here, and not while
/// a request of another kind is answered.
#[inline(never)]
pub(crate) fn response<E>(work: impl FnOnce() -> Result<Response, StoreError<E>>) -> Response {
    work().unwrap_or_else(|error| refused(&error))
}

/// The same of what is journaled: no answer is on the stack while it is.
#[inline(never)]
pub(crate) fn done<E>(work: impl FnOnce() -> Result<(), StoreError<E>>) -> Response {
    match work() {
        Ok(()) => Response::Done,
        Err(error) => refused(&error),
    }
}

fn refused<E>(error: &StoreError<E>) -> Response {
    match error {
        StoreError::Refused(refusal) => Response::ProgramRefused(*refusal),
        StoreError::Flash(_) | StoreError::NotKept { .. } | StoreError::Geometry(_) => {
            Response::StorageFailed
        }
    }
}

/// The programs, to be read.
fn readable<F: Flash>(measure: &mut Instrument<F>) -> Result<&mut Store<F>, StoreError<F::Error>> {
    let store = measure.programs.get_mut();
    store.ok_or(ProgramRefusal::NoRoomAtAll.into())
}

/// The programs, to be written: not while flash that is erased would be felt in what is being
/// measured or cut.
fn writable<F: Flash>(measure: &mut Instrument<F>) -> Result<&mut Store<F>, StoreError<F::Error>> {
    if measure.brain().run().is_under_way() || measure.delivery.is_some() {
        return Err(ProgramRefusal::Busy.into());
    }
    readable(measure)
}

/// Whether the owner allows such a program.
fn allowed<F: Flash>(measure: &Instrument<F>, program: &ProgramInfo) -> Result<(), ProgramRefusal> {
    let always = measure.ledger.in_custody().config.ceilings.always;
    match program.release == Release::Always && !always {
        true => Err(ProgramRefusal::AlwaysForbidden),
        false => Ok(()),
    }
}

#[inline(never)]
pub(crate) fn begin<F: Flash>(measure: &mut Instrument<F>, program: &ProgramInfo) -> Answer<F> {
    allowed(measure, program)?;
    writable(measure)?.begin(program).map(at)
}

#[inline(never)]
pub(crate) fn piece<F: Flash>(
    measure: &mut Instrument<F>,
    offset: u32,
    bytes: &Piece,
) -> Answer<F> {
    writable(measure)?.piece(offset, bytes).map(at)
}

/// Asks the control for a program by XMODEM.
#[inline(never)]
pub(crate) fn receive<F: Flash>(measure: &mut Instrument<F>) -> Answer<F> {
    writable(measure)?;
    if measure.ledger.upload.is_busy() {
        return Err(ProgramRefusal::Busy.into());
    }
    measure.ledger.upload.ask();
    Ok(Response::Done)
}

/// What the host will pass through.
#[inline(never)]
pub(crate) fn pass<F: Flash>(measure: &mut Instrument<F>, info: &ProgramInfo) -> Answer<F> {
    allowed(measure, info)?;
    measure.pass(info)?;
    Ok(at(0))
}

/// What the host passes through.
#[inline(never)]
pub(crate) fn passed<F: Flash>(
    measure: &mut Instrument<F>,
    offset: u32,
    bytes: &Piece,
) -> Answer<F> {
    let next = measure.passed(offset, bytes)?;
    Ok(next.map_or(Response::Done, at))
}

/// The control's next READ gets this one.
#[inline(never)]
pub(crate) fn offer<F: Flash>(measure: &mut Instrument<F>, number: u32) -> Answer<F> {
    let store = readable(measure)?;
    store.find(number).ok_or(ProgramRefusal::NotThere)?;
    measure.offer(number)?;
    Ok(Response::Done)
}

const fn at(offset: u32) -> Response {
    Response::ProgramAt { offset }
}

#[inline(never)]
pub(crate) fn list<F: Flash>(measure: &mut Instrument<F>, skip: u16) -> Answer<F> {
    let store = readable(measure)?;
    let mut programs = heapless::Vec::new();
    let mut place = usize::from(skip);
    while !programs.is_full()
        && let Some(program) = store.programs().get(place).copied()
    {
        // There is room: just looked.
        let _ = programs.push(store.info(&program)?);
        place += 1;
    }
    let room = store.room();
    Ok(Response::Programs { room, programs })
}

#[inline(never)]
pub(crate) fn read<F: Flash>(measure: &mut Instrument<F>, number: u32, offset: u32) -> Answer<F> {
    let store = readable(measure)?;
    let program = store.find(number).ok_or(ProgramRefusal::NotThere)?;
    let mut bytes = Piece::new();
    // There is room for as many.
    let _ = bytes.resize_default(MAX_PIECE);
    let length = store.read(&program, offset, &mut bytes)?.len();
    bytes.truncate(length);
    Ok(Response::ProgramBytes { offset, bytes })
}

#[inline(never)]
pub(crate) fn end<F: Flash>(
    measure: &mut Instrument<F>,
    now: Micros,
    number: u32,
    crc32: u32,
) -> Result<(), StoreError<F::Error>> {
    let store = writable(measure)?;
    if let Some(program) = store.end(number, crc32)? {
        let info = store.info(&program)?;
        kept(measure, now, info);
    }
    Ok(())
}

/// A record has kilobytes: off the stack while the flash is at work.
#[inline(never)]
fn kept<F: Flash>(measure: &mut Instrument<F>, now: Micros, info: ProgramInfo) {
    let key_id = measure.ledger.by.get().copied();
    let record = Record::ProgramKept {
        program: info,
        key_id,
    };
    measure.ledger.record(now, record);
}

#[inline(never)]
pub(crate) fn delete<F: Flash>(
    measure: &mut Instrument<F>,
    now: Micros,
    number: u32,
) -> Result<(), StoreError<F::Error>> {
    let store = writable(measure)?;
    let program = store.find(number).ok_or(ProgramRefusal::NotThere)?;
    // Never a deed without its record.
    let journal = measure.ledger.journal.get_mut();
    if journal.is_some_and(|journal| !journal.takes(SMALL, false)) {
        return Err(StoreError::NotKept { addr: 0 });
    }
    // Each is a piece of evidence. A host asks again.
    if !measure.ledger.deletions.take(now) {
        return Err(ProgramRefusal::Busy.into());
    }
    writable(measure)?.delete(number)?;
    let crc32 = program.crc32;
    deleted(measure, now, number, crc32);
    Ok(())
}

#[inline(never)]
fn deleted<F: Flash>(measure: &mut Instrument<F>, now: Micros, number: u32, crc32: u32) {
    let record = Record::ProgramDeleted {
        number,
        crc32,
        key_id: measure.ledger.by.get().copied(),
    };
    measure.ledger.record(now, record);
}
