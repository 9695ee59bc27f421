//! Requests that need nothing of what a board has measured, read without the others.
//!
//! A session's requests are among them: what takes long about them is done while measuring goes on.

use serde::Deserialize;

use crate::access::{Role, SessionAsk};
use crate::latch::TriggerOut;
use crate::message::Request;
use crate::wire::frame::{Frame, Kind};
use crate::wire::hello::KEY;

/// A request of [`RequestClass::Immediate`](crate::message::RequestClass::Immediate). Small: a
/// [`Request`] has kilobytes, because a job may be in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImmediateRequest {
    /// [`Request::PositionsGet`].
    Positions,
    /// [`Request::TriggerOutSet`].
    TriggerOut(TriggerOut),
    /// [`Request::LaserSet`].
    Laser(bool),
}

/// Places among the requests: held by the tests of the protocol's bytes.
const POSITIONS: u8 = 11;
const TRIGGER_OUT: u8 = 12;
const LASER: u8 = 13;
const SESSION_BEGIN: u8 = 36;
const SESSION_PROVE: u8 = 37;

/// A request that begins a session, or proves its key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionRequest {
    /// [`Request::SessionBegin`].
    Begin(SessionAsk),
    /// [`Request::SessionProve`].
    Prove {
        /// R and S.
        signature: [[u8; 32]; 2],
    },
}

impl SessionRequest {
    /// What this frame asks, if it is one of these.
    #[must_use]
    pub fn of(frame: &Frame<'_>) -> Option<Self> {
        let (request, rest) = parts(frame)?;
        match request {
            SESSION_BEGIN => whole(rest).map(Self::Begin),
            SESSION_PROVE => whole(rest).map(|signature| Self::Prove { signature }),
            _ => None,
        }
    }
}

impl ImmediateRequest {
    /// Whose key it needs: as the table says of the request that it is.
    #[must_use]
    pub const fn needs(&self) -> Role {
        match self {
            Self::Positions => Request::PositionsGet.needs(),
            Self::TriggerOut(when) => Request::TriggerOutSet(*when).needs(),
            Self::Laser(on) => Request::LaserSet { on: *on }.needs(),
        }
    }

    /// What this frame asks, if it is one of these.
    #[must_use]
    pub fn of(frame: &Frame<'_>) -> Option<Self> {
        let (request, rest) = parts(frame)?;
        match request {
            POSITIONS if rest.is_empty() => Some(Self::Positions),
            TRIGGER_OUT => whole(rest).map(Self::TriggerOut),
            LASER => whole(rest).map(Self::Laser),
            _ => None,
        }
    }
}

/// The number of a request of our schema, and what stands behind it.
fn parts<'f>(frame: &Frame<'f>) -> Option<(u8, &'f [u8])> {
    if frame.kind != Kind::Request || frame.key != KEY as u32 {
        return None;
    }
    let (request, rest) = frame.payload.split_first()?;
    Some((*request, rest))
}

/// What these bytes are, and no more.
fn whole<'de, T: Deserialize<'de>>(bytes: &'de [u8]) -> Option<T> {
    match postcard::take_from_bytes(bytes) {
        Ok((value, [])) => Some(value),
        _ => None,
    }
}
