//! Who the board is, why it started, and what it has counted.

use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;
use thiserror::Error;

use crate::access::AccessMode;
use crate::job::Name;
use crate::latch::LatchCounters;
use crate::records::fault::Counters;

use super::TeachPending;

/// Who the board is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Identity {
    /// The kind of board, as "virtual" or "pico".
    pub board: Name,
    /// Serial number.
    pub serial: Name,
    /// Firmware version, as "0.1.0".
    pub firmware: Name,
}

/// What the board does and what it has counted since it started.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Status {
    /// Time since start.
    pub uptime_us: u64,
    /// Why the board started.
    pub reset: ResetReason,
    /// The job in force.
    pub job: Option<Name>,
    /// Why there was none to restore at start, until one is set.
    pub job_lost: Option<JobLoss>,
    /// Whether a reference has been taught or given.
    pub has_reference: bool,
    /// A teaching that was asked for and has not happened yet. A board that starts anew has
    /// not been asked.
    pub teaching: Option<TeachPending>,
    /// Verdicts reached.
    pub verdicts: u32,
    /// Of these, OK.
    pub verdicts_ok: u32,
    /// The latest verdict's setup and result.
    pub last_verdict_ok: Option<bool>,
    /// A correction waits for the control to ask for it.
    pub correction_waiting: bool,
    /// Lines of a program that the control seems to punch, where its end has not come for
    /// ten seconds: nothing is measured before it.
    pub punched_lines: Option<u32>,
    /// The receiver's counters.
    pub counters: Counters,
    /// Events dropped because the host did not read them.
    pub events_dropped: u32,
    /// Entries that the journal's storage refused.
    pub journal_failures: u32,
    /// Frames from the host that were damaged or too long, since it connected.
    pub link_damaged: u32,
    /// What the latches captured and lost.
    pub latches: LatchCounters,
    /// Who may do what.
    pub access: AccessMode,
}

/// Why the board started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum ResetReason {
    /// The board cannot tell.
    #[default]
    Unknown,
    /// Power came on.
    PowerOn,
    /// The supply was too low.
    BrownOut,
    /// The reset pin.
    Pin,
    /// The firmware did not answer its watchdog.
    Watchdog,
    /// The firmware reset itself, as after an update.
    Software,
    /// The firmware met what it cannot go on from.
    Panic,
}

/// Why no job could be restored at start.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error, IntoStaticStr,
)]
#[strum(serialize_all = "snake_case")]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum JobLoss {
    /// None has ever been kept.
    #[error("no job has been kept on this board: set one")]
    Absent,
    /// The settings are those of a firmware with other messages.
    #[error(
        "the job was kept by a firmware with other messages, which this one does not read: set it again"
    )]
    OtherSchema,
    /// The settings were kept and cannot be read.
    #[error("the job was kept and cannot be read any more: set it again")]
    Damaged,
    /// This firmware does not take the job that was kept.
    #[error(
        "this firmware does not take the job that was kept: check it with `umi job check`, and set it again"
    )]
    Refused,
    /// The settings' storage does not answer or has another shape.
    #[error(
        "the storage of the settings does not answer or has another shape: the board takes no job before it is mended"
    )]
    Storage,
}

impl JobLoss {
    /// Its name for programs.
    #[must_use]
    pub fn code(self) -> &'static str {
        self.into()
    }
}

/// What the journal holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct JournalInfo {
    /// The oldest entry that is still there.
    pub first_seq: u64,
    /// The number that the next entry will get.
    pub next_seq: u64,
    /// The entries before this one are kept elsewhere, as a host has said.
    pub acked_seq: u64,
    /// Entries from there on that were overwritten: nobody has said that they are kept elsewhere.
    pub lost: u64,
}
