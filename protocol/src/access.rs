//! Who may do what with a board: roles, keys, and how a host proves that it has one.
//!
//! ```text
//! host                                             board
//!   SessionBegin: its key, an X25519 share    ─►
//!                                             ◄─   a challenge, the board's key, its share
//!   SessionProve: signature over all of that  ─►
//!                                             ◄─   SessionOpen: its role, the board's signature
//!   sealed requests                           ─►
//!                                             ◄─   sealed answers
//! ```
//!
//! What is signed and how frames are sealed: `umi_core::trust::access::session`.

use heapless::{String, Vec};
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;
use thiserror::Error;

/// Keys that a board knows, at most.
pub const MAX_KEYS: usize = 16;

/// Bytes of [`KeyName`], at most.
pub const MAX_KEY_NAME: usize = 32;

/// Whose a key is, for people.
pub type KeyName = String<MAX_KEY_NAME, u8>;

/// A short name of a public key: the first bytes of its SHA-256.
pub type KeyId = [u8; 8];

/// The keys that a board knows.
pub type Keys = Vec<KeyInfo, MAX_KEYS>;

/// Whose key a request needs on a board that has an owner; who may do more may do less, too.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    Schema,
    IntoStaticStr,
)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Role {
    /// Nobody's: who the board is, whether it works, where it stands.
    #[default]
    None,
    /// It reads: journal, job, verdicts, programs; it says what is kept elsewhere.
    Operator,
    /// It changes what is measured or what moves: job, programs, trigger pulses, laser.
    Engineer,
    /// It says what engineers may do: keys, lock, ceilings, wiping.
    Owner,
}

impl Role {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::None, Self::Operator, Self::Engineer, Self::Owner];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Who may do what with a board.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema, IntoStaticStr,
)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum AccessMode {
    /// It has no owner: whoever reaches its port may do everything.
    #[default]
    Open,
    /// It has an owner: a request needs a key of the role that the table names.
    Claimed,
    /// Its owner has locked it: nothing is changed, and read by an operator's key only.
    Locked,
}

impl AccessMode {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Open, Self::Claimed, Self::Locked];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// A key that a board knows, or is to know.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct KeyInfo {
    /// The Ed25519 public key.
    pub public: [u8; 32],
    /// What it is for.
    pub role: Role,
    /// Whose it is, for people; may be empty.
    pub name: KeyName,
}

/// How a board is guarded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct AccessInfo {
    /// Who may do what.
    pub mode: AccessMode,
    /// Whether the jumper is closed; none: the board reads none.
    pub jumper: Option<bool>,
    /// A wrong key is not looked at before so many seconds have passed.
    pub retry_in_s: u32,
    /// The board's own public key; none: it has none, and cannot be claimed.
    pub board_key: Option<[u8; 32]>,
}

/// Why a request is not done.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error, IntoStaticStr,
)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum AccessRefusal {
    /// The board has an owner, and nobody has proven a key.
    #[error("this needs a key ({}): give it with --key FILE or UMI_KEY", .needs.name())]
    KeyNeeded {
        /// Of which role.
        needs: Role,
    },
    /// The board does not know this key.
    #[error("the board does not know this key: its owner can enrol it (umi access enrol)")]
    KeyUnknown,
    /// The proof is not by this key.
    #[error(
        "the proof of the key is wrong: the file holds another key, or somebody changes what goes over the line"
    )]
    KeyWrong,
    /// The key is of a lower role.
    #[error("this needs the key of an {}, and the key given is of an {}", .needs.name(), .has.name())]
    RoleTooLow {
        /// Which role.
        needs: Role,
        /// Which it has.
        has: Role,
    },
    /// The owner has locked the board.
    #[error("the board is locked: its owner unlocks it (umi access unlock)")]
    Locked,
    /// The jumper has to be closed for this: at the start and now.
    #[error("this needs the board's jumper: close it, start the board anew, and ask again")]
    JumperOpen,
    /// Wrong keys have been tried too often.
    #[error(
        "too many wrong keys: the next is looked at in {retry_in_s} s; a right one is taken at once"
    )]
    TooManyTries {
        /// Seconds until the next wrong one is looked at.
        retry_in_s: u32,
    },
    /// It is the only owner's key.
    #[error("it is the key of the last owner: enrol another owner first, or wipe the board")]
    LastOwner,
    /// The board knows as many keys as it can.
    #[error("the board knows as many keys as it can ({MAX_KEYS}): revoke one first")]
    KeysFull,
    /// It is no Ed25519 public key.
    #[error("it is no Ed25519 public key that can be proven")]
    NotAKey,
    /// The frame is not of the session that the board has: it ended, or the frame was changed or
    /// came twice.
    #[error(
        "the board knows of no such session (it may have started anew, or the session was idle for longer than its owner allows): ask again"
    )]
    NoSession,
}

impl AccessRefusal {
    /// The stable code.
    #[must_use]
    pub fn code(self) -> &'static str {
        self.into()
    }
}

/// What an owner changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, IntoStaticStr)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum AccessChange {
    /// A key is known from now on, or has another role.
    Enrolled,
    /// A key is not known any more.
    Revoked,
    /// Nothing is changed any more.
    Locked,
    /// It is as before.
    Unlocked,
}

impl AccessChange {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// A host wants a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct SessionAsk {
    /// Its Ed25519 public key.
    pub key: [u8; 32],
    /// Its X25519 share, made for one session.
    pub share: [u8; 32],
}

/// What the host is to sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct SessionChallenge {
    /// Drawn for one session, and good for one proof.
    pub challenge: [u8; 32],
    /// The board's X25519 share, made for one session.
    pub share: [u8; 32],
    /// The board's Ed25519 public key.
    pub board_key: [u8; 32],
}
