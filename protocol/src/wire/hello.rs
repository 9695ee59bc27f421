//! Hello: the speaker and its version, the one message that any two versions of
//! board and host understand.

use core::fmt;

use heapless::String;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::wire::envelope::{Kind, Message};

pub use crate::wire::envelope::KEY;

/// The version of the protocol: raised by hand with every change of a message
/// or of its meaning, so that two sides that differ know which one is older.
///
/// The major number is raised when a host must be rebuilt for more than new
/// data, the minor one otherwise. To the link both are the same: only equal
/// versions with equal keys talk, so that no message is ever half understood.
pub const VERSION: Version = Version {
    major: 2,
    minor: 25,
};

/// First bytes of every Hello.
pub const MAGIC: [u8; 4] = *b"oUMI";

/// Bytes of the text in a Hello, at most.
pub const MAX_SENDER: usize = 48;

/// A version of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Version {
    /// First number.
    pub major: u8,
    /// Second number.
    pub minor: u8,
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}

/// Who speaks, and in which version.
///
/// The layout is frozen for ever; a later version may only add bytes at the
/// end, which an earlier one ignores:
///
/// | bytes | what |
/// | --- | --- |
/// | 4 | [`MAGIC`] |
/// | 1, 1 | protocol version, major and minor |
/// | 8 | schema key, little-endian |
/// | 1 | length of the text, at most [`MAX_SENDER`] |
/// | 0 to 48 | text in UTF-8: who sends this |
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Hello {
    magic: [u8; 4],
    /// The sender's protocol version.
    pub version: Version,
    key: [u8; 8],
    /// Who sends this, for people: a board's kind, serial number and firmware, or the
    /// host tool and its version.
    pub sender: String<MAX_SENDER, u8>,
}

impl Message for Hello {
    const KIND: Kind = Kind::Hello;
    const FROZEN: bool = true;
}

impl Hello {
    /// This build's Hello. A longer text is cut.
    #[must_use]
    pub fn new(sender: &str) -> Self {
        Self::of(VERSION, KEY, sender)
    }

    /// The Hello of any build. A longer text is cut.
    #[must_use]
    pub fn of(version: Version, key: u64, sender: &str) -> Self {
        let mut text = String::new();
        for char in sender.chars() {
            if text.push(char).is_err() {
                break;
            }
        }
        Self {
            magic: MAGIC,
            version,
            key: key.to_le_bytes(),
            sender: text,
        }
    }

    /// The sender's schema key.
    #[must_use]
    pub const fn key(&self) -> u64 {
        u64::from_le_bytes(self.key)
    }

    /// Whether this side and the board that sent this Hello may talk.
    ///
    /// # Errors
    /// [`Mismatch`] says which side to update.
    pub fn check(&self) -> Result<(), Mismatch> {
        if self.magic != MAGIC {
            Err(Mismatch::NotOpenumi)
        } else if self.version > VERSION {
            Err(Mismatch::BoardNewer {
                board: self.version,
            })
        } else if self.version < VERSION {
            Err(Mismatch::BoardOlder {
                board: self.version,
            })
        } else if self.key() != KEY {
            Err(Mismatch::OtherSchema { board: self.key() })
        } else {
            Ok(())
        }
    }
}

/// Why a host and a board cannot talk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mismatch {
    /// The Hello does not begin with [`MAGIC`].
    NotOpenumi,
    /// The board is newer than this host.
    BoardNewer {
        /// Its version.
        board: Version,
    },
    /// The board is older than this host.
    BoardOlder {
        /// Its version.
        board: Version,
    },
    /// Equal versions of different builds, whose messages differ.
    OtherSchema {
        /// The board's schema key.
        board: u64,
    },
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotOpenumi => f.write_str("what answers there is not an openumi board"),
            Self::BoardNewer { board } => write!(
                f,
                "board speaks a newer protocol ({board}, this umi {VERSION}): update umi"
            ),
            Self::BoardOlder { board } => write!(
                f,
                "board speaks an older protocol ({board}, this umi {VERSION}): update the board's firmware"
            ),
            Self::OtherSchema { board } => write!(
                f,
                "board and umi both speak protocol {VERSION} but are builds with different messages (schema {board:016x}, this umi {KEY:016x}): build firmware and umi from the same source, or install both from the same release"
            ),
        }
    }
}

impl core::error::Error for Mismatch {}

#[cfg(test)]
mod tests;
