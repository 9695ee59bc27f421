//! What the board answers.

use heapless::Vec;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;
use thiserror::Error;

use crate::access::{AccessInfo, AccessRefusal, Keys, Role, SessionChallenge};
use crate::config::{BoardConfig, ConfigField, Fallbacks};
use crate::job::job_error::{Field, JobError};
use crate::job::{Job, Lessons, MAX_DATUMS};
use crate::latch::{Positions, TriggerRefusal};
use crate::point_sensor::{SensorRefusal, SensorStatus};
use crate::records::feature::FeatureResult;
use crate::records::head::HeadAnswer;
use crate::records::program::{MAX_LISTED, Piece, ProgramInfo, ProgramRefusal, ProgramRoom};
use crate::records::verdict::Verdict;
use crate::update::{ImageInfo, UpdateRefusal};

use super::{Identity, JournalInfo, MAX_ENTRY, Status, TeachRefusal};

/// What the board answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[allow(clippy::large_enum_variant, reason = "no heap; one exists at a time")]
pub enum Response {
    /// Done.
    Done,
    /// To `IdentityGet`.
    Identity(Identity),
    /// To `StatusGet`.
    Status(Status),
    /// To `JobGet`.
    Job {
        /// None: no job has been set.
        job: Option<Job>,
        /// The taught reference positions, in the order of the job's datum features.
        taught_mm: Option<Vec<[f64; 3], MAX_DATUMS>>,
        /// How each feature of the job was when it was taught; empty without a taught reference.
        learned: Lessons,
    },
    /// The job cannot be used.
    JobRefused(JobError),
    /// To `FeatureGet`.
    Feature(Option<FeatureResult>),
    /// To `VerdictGet`.
    Verdict(Option<Verdict>),
    /// To `JournalInfo`.
    JournalInfo(JournalInfo),
    /// To `JournalRead`: the entry as stored, with its check and chain values.
    JournalEntry {
        /// Its sequence number.
        seq: u64,
        /// The stored bytes.
        raw: Vec<u8, MAX_ENTRY>,
    },
    /// That entry is not there any more, or not yet.
    JournalNoEntry(JournalInfo),
    /// The journal's storage failed.
    StorageFailed,
    /// To `JournalChain`.
    JournalChain {
        /// The entry's sequence number.
        seq: u64,
        /// SHA-256 over everything before it; none if damage before it in the
        /// journal hides the value.
        before: Option<[u8; 32]>,
    },
    /// To `PositionsGet`.
    Positions(Positions),
    /// The board has no output for that.
    NotOnThisBoard,
    /// To `ProgramList`.
    Programs {
        /// How much room there is.
        room: ProgramRoom,
        /// The next programs; none: that was all.
        programs: Vec<ProgramInfo, MAX_LISTED>,
    },
    /// To `ProgramBegin` and `ProgramPiece`.
    ProgramAt {
        /// Where the byte stands that is wanted next.
        offset: u32,
    },
    /// To `ProgramRead`.
    ProgramBytes {
        /// Where they stand.
        offset: u32,
        /// The bytes; none: the program ends before.
        bytes: Piece,
    },
    /// That cannot be done with a program.
    ProgramRefused(ProgramRefusal),
    /// To `Teach`: nothing is to be taught.
    TeachRefused(TeachRefusal),
    /// To `LineListen`: the line is as it was.
    LineRefused(LineRefusal),
    /// To `HeadGet`.
    Head(HeadAnswer),
    /// To `TriggerOutSet`: pulses are as they were.
    TriggerRefused(TriggerRefusal),
    /// To `ConfigGet`.
    Config {
        /// What is in force.
        config: BoardConfig,
        /// Fields that could not be read where they are kept, and are as strict as can be.
        fallbacks: Fallbacks,
    },
    /// To `ConfigSet`: this field cannot be used.
    ConfigRefused(ConfigField),
    /// To any request: its host may not ask for that. Nothing has changed.
    AccessRefused(AccessRefusal),
    /// To `AccessGet`.
    Access(AccessInfo),
    /// To `KeyList`.
    Keys(Keys),
    /// To `SessionBegin`.
    SessionChallenge(SessionChallenge),
    /// To `SessionProve`: from now on this host's frames are sealed.
    SessionOpen {
        /// What the key is for.
        role: Role,
        /// The board's signature, R and S.
        signature: [[u8; 32]; 2],
    },
    /// To `ImageGet`.
    Image(ImageInfo),
    /// To `UpdateBegin` and `UpdatePiece`.
    UpdateAt {
        /// Where the byte stands that is wanted next.
        offset: u32,
    },
    /// The image is not taken; what runs is as before.
    UpdateRefused(UpdateRefusal),
    /// To `SensorGet`.
    Sensor(SensorStatus),
    /// To `SensorSet` and `SensorCommand`: nothing has changed.
    SensorRefused(SensorRefusal),
}

/// Why a line is not set.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error, IntoStaticStr,
)]
#[strum(serialize_all = "snake_case")]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum LineRefusal {
    /// A setup is being measured, or something is on its way to the control.
    #[error("a clamping is being measured or a program is on its way: ask when the line is idle")]
    UnderWay,
    /// The board cannot set its line like that.
    #[error("`{}` is not to be had on this board: see its README", .field.name())]
    NotOnThisBoard {
        /// What of it.
        field: Field,
    },
}

impl LineRefusal {
    /// The stable code.
    #[must_use]
    pub fn code(self) -> &'static str {
        self.into()
    }
}
