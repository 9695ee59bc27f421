//! Envelope of a message: its kind, and the key of the schema.

use serde::{Serialize, de::DeserializeOwned};

use crate::message::{Event, Request, Response};
use crate::schema::{Schema, key as schema_key, max_len};

/// The schema key of all messages of the link.
pub const KEY: u64 = schema_key::<(Request, Response, Event)>();

/// What a frame carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Who speaks, and in which version: [`crate::wire::hello::Hello`].
    Hello,
    /// From the host: [`Request`].
    Request,
    /// The answer: [`Response`].
    Response,
    /// Unasked: [`Event`].
    Event,
    /// [`Request`] of a session, with its seal.
    SealedRequest,
    /// The answer to that, with its seal.
    SealedResponse,
    /// Something of a later version.
    Other(u8),
}

impl Kind {
    pub(crate) const fn number(self) -> u8 {
        match self {
            Self::Hello => 1,
            Self::Request => 2,
            Self::Response => 3,
            Self::Event => 4,
            Self::SealedRequest => 5,
            Self::SealedResponse => 6,
            Self::Other(number) => number,
        }
    }

    /// The kind of such a frame with a seal; of what has none, the same.
    pub(crate) const fn sealed(self) -> Self {
        match self {
            Self::Request => Self::SealedRequest,
            Self::Response => Self::SealedResponse,
            other => other,
        }
    }

    /// The kind of such a frame without its seal; none if it has none.
    pub(crate) const fn unsealed(self) -> Option<Self> {
        match self {
            Self::SealedRequest => Some(Self::Request),
            Self::SealedResponse => Some(Self::Response),
            _ => None,
        }
    }

    pub(crate) const fn from_number(number: u8) -> Self {
        match number {
            1 => Self::Hello,
            2 => Self::Request,
            3 => Self::Response,
            4 => Self::Event,
            5 => Self::SealedRequest,
            6 => Self::SealedResponse,
            other => Self::Other(other),
        }
    }
}

/// A message that travels in frames.
pub trait Message: Serialize + DeserializeOwned + Schema {
    /// The kind of its frames.
    const KIND: Kind;
    /// Bytes of the longest payload.
    const MAX_LEN: usize = max_len::<Self>();
    /// Whether it can be opened whatever the key, and with bytes after it that a later
    /// version added. Only for the frozen [`crate::wire::hello::Hello`].
    const FROZEN: bool = false;
}

impl Message for Request {
    const KIND: Kind = Kind::Request;
}

impl Message for Response {
    const KIND: Kind = Kind::Response;
}

impl Message for Event {
    const KIND: Kind = Kind::Event;
}
