//! The host's requests about part programs.
//!
//! # Design
//!
//! Flash that is written keeps the whole state locked, for up to half a second where a
//! sector is erased. So nothing is written while a plate is being measured: the host is
//! told to ask again. Reading a piece takes a fraction of a millisecond; the end of an upload
//! reads the whole program back, by the speed of the flash.
//!
//! Each answer is made by a function of its own that is not inlined: see `answer`.

use umi_core::journal::Flash;
use umi_core::programs::{Error, Store};
use umi_core::units::Micros;
use umi_protocol::message::{Record, Request, Response};
use umi_protocol::program::{MAX_PIECE, Piece, ProgramInfo, ProgramRefusal};

use crate::measure::Measure;

/// The answer to a request about programs.
#[inline(never)]
pub(crate) fn answer<F: Flash>(
    measure: &mut Measure<F>,
    now: Micros,
    request: &Request,
) -> Response {
    let writes = matches!(
        request,
        Request::ProgramBegin(_)
            | Request::ProgramPiece { .. }
            | Request::ProgramEnd { .. }
            | Request::ProgramDelete { .. }
            | Request::ProgramReceive
    );
    // Flash that is erased would be felt in what is being cut.
    let is_busy = measure.brain().run().is_under_way() || measure.delivery.is_some();
    if writes && is_busy {
        return Response::ProgramRefused(ProgramRefusal::Busy);
    }
    match request {
        Request::ProgramPass(_) | Request::ProgramPassed { .. } => {
            return passed(measure, request);
        }
        _ => {}
    }
    let Some(store) = measure.programs.get_mut() else {
        return Response::ProgramRefused(ProgramRefusal::NoRoomAtAll);
    };
    let answer = match request {
        Request::ProgramBegin(program) => store.begin(program).map(at),
        Request::ProgramPiece { offset, bytes } => store.piece(*offset, bytes).map(at),
        Request::ProgramRead { number, offset } => read(store, *number, *offset),
        Request::ProgramEnd { number, crc32 } => end(measure, now, *number, *crc32),
        Request::ProgramDelete { number } => delete(measure, now, *number),
        Request::ProgramOffer { number } => offer(measure, *number),
        Request::ProgramReceive if measure.book.punch.is_busy() => Err(ProgramRefusal::Busy.into()),
        Request::ProgramReceive => {
            measure.book.punch.ask();
            Ok(Response::Done)
        }
        Request::ProgramList { skip } => list(store, *skip),
        // Nothing else comes here.
        _ => Err(ProgramRefusal::NotThere.into()),
    };
    answer.unwrap_or_else(|error| match error {
        Error::Refused(refusal) => Response::ProgramRefused(refusal),
        Error::Flash(_) | Error::NotKept { .. } | Error::Geometry(_) => Response::StorageFailed,
    })
}

/// What the host passes through.
#[inline(never)]
fn passed<F: Flash>(measure: &mut Measure<F>, request: &Request) -> Response {
    let next = match request {
        Request::ProgramPass(info) => measure.pass(info).map(|()| Some(0)),
        Request::ProgramPassed { offset, bytes } => measure.passed(*offset, bytes),
        // Nothing else comes here.
        _ => Err(ProgramRefusal::NotBegun),
    };
    match next {
        Ok(Some(offset)) => at(offset),
        Ok(None) => Response::Done,
        Err(refusal) => Response::ProgramRefused(refusal),
    }
}

/// The control's next READ gets this one.
#[inline(never)]
fn offer<F: Flash>(measure: &mut Measure<F>, number: u32) -> Result<Response, Error<F::Error>> {
    let store = measure.programs.get().ok_or(ProgramRefusal::NoRoomAtAll)?;
    store.find(number).ok_or(ProgramRefusal::NotThere)?;
    measure.offer(number)?;
    Ok(Response::Done)
}

const fn at(offset: u32) -> Response {
    Response::ProgramAt { offset }
}

#[inline(never)]
fn list<F: Flash>(store: &mut Store<F>, skip: u16) -> Result<Response, Error<F::Error>> {
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
fn read<F: Flash>(
    store: &mut Store<F>,
    number: u32,
    offset: u32,
) -> Result<Response, Error<F::Error>> {
    let program = store.find(number).ok_or(ProgramRefusal::NotThere)?;
    let mut bytes = Piece::new();
    // There is room for as many.
    let _ = bytes.resize_default(MAX_PIECE);
    let length = store.read(&program, offset, &mut bytes)?.len();
    bytes.truncate(length);
    Ok(Response::ProgramBytes { offset, bytes })
}

#[inline(never)]
fn end<F: Flash>(
    measure: &mut Measure<F>,
    now: Micros,
    number: u32,
    crc32: u32,
) -> Result<Response, Error<F::Error>> {
    let store = measure.programs.get_mut();
    let store = store.ok_or(ProgramRefusal::NoRoomAtAll)?;
    if let Some(program) = store.end(number, crc32)? {
        let info = store.info(&program)?;
        kept(measure, now, info);
    }
    Ok(Response::Done)
}

/// A record has kilobytes: off the stack while the flash is at work.
#[inline(never)]
fn kept<F: Flash>(measure: &mut Measure<F>, now: Micros, info: ProgramInfo) {
    measure.book.record(now, Record::ProgramKept(info));
}

#[inline(never)]
fn delete<F: Flash>(
    measure: &mut Measure<F>,
    now: Micros,
    number: u32,
) -> Result<Response, Error<F::Error>> {
    let store = measure.programs.get_mut();
    let store = store.ok_or(ProgramRefusal::NoRoomAtAll)?;
    let program = store.find(number).ok_or(ProgramRefusal::NotThere)?;
    store.delete(number)?;
    let crc32 = program.crc32;
    deleted(measure, now, number, crc32);
    Ok(Response::Done)
}

#[inline(never)]
fn deleted<F: Flash>(measure: &mut Measure<F>, now: Micros, number: u32, crc32: u32) {
    let record = Record::ProgramDeleted { number, crc32 };
    measure.book.record(now, record);
}
