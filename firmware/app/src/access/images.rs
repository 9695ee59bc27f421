//! Signed images: from a host's requests to the slots ([`umi_core::trust::access::update::slots`]).

use umi_core::journal::Flash;
use umi_core::trust::access::update::slots::UpdateError;
use umi_core::units::Micros;
use umi_protocol::latch::Positions;
use umi_protocol::message::{Record, Request, Response};
use umi_protocol::update::{IMAGE_HEADER, UpdateRefusal, UpdateState};

use super::Guarded;
use crate::board::Axes;
use crate::measure::Instrument;

/// Where the axes stand, in short.
fn stand(positions: &Positions) -> u32 {
    let counts = positions.counts.iter().flat_map(|of| of.to_le_bytes());
    // FNV-1a, as published by Fowler, Noll and Vo: not against forgers, who do not move axes.
    counts.fold(0x811C_9DC5, |hash, byte| {
        (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193)
    })
}

/// The answer to a request about images.
#[inline(never)]
pub(crate) fn update<F: Flash>(
    measure: &mut Instrument<F>,
    guarded: &mut Guarded<F>,
    axes: &mut impl Axes,
    now: Micros,
    request: &Request,
) -> Response {
    // The compiler does not see that there is no room for any.
    if !cfg!(feature = "update") {
        return Response::NotOnThisBoard;
    }
    let is_measuring = measure.brain().run().is_under_way() || measure.delivery.is_some();
    let Instrument { images, ledger, .. } = measure;
    let Some(images) = images.first_mut() else {
        return Response::NotOnThisBoard;
    };
    if let Request::ImageGet = request {
        return Response::Image(images.info());
    }
    let stand = stand(&axes.positions());
    if let Request::UpdateBegin { .. } = request {
        guarded.stood = stand;
    }
    // Flash that is written, and a start, would be felt in what is measured, sent or moved.
    let is_busy = is_measuring || guarded.stood != 0 && stand != guarded.stood;
    if is_busy {
        return Response::UpdateRefused(UpdateRefusal::Busy);
    }
    let done = match request {
        Request::UpdateBegin { header } => {
            let mut bytes = [0; IMAGE_HEADER];
            for (place, part) in bytes.chunks_exact_mut(32).zip(header) {
                place.copy_from_slice(part);
            }
            images
                .begin(&bytes)
                .map(|offset| Response::UpdateAt { offset })
        }
        Request::UpdatePiece { offset, bytes } => images
            .piece(*offset, bytes)
            .map(|offset| Response::UpdateAt { offset }),
        Request::UpdateEnd => {
            let from = images.info().version;
            images.whole().and_then(|to| {
                let what = UpdateState::Trial;
                let record = Record::Update { what, from, to };
                // Never a deed without a record.
                if !ledger.record(now, record) {
                    return Err(UpdateError::Flash);
                }
                images.mark()?;
                guarded.restarts = true;
                Ok(Response::Done)
            })
        }
        _ => return Response::NotOnThisBoard,
    };
    done.unwrap_or_else(|error| match error {
        UpdateError::Refused(refusal) => Response::UpdateRefused(refusal),
        UpdateError::Flash => Response::StorageFailed,
    })
}
