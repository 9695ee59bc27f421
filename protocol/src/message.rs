//! The link between board and host: what the host may ask, what the board
//! answers, and what it reports unasked. This page is the protocol;
//! [`crate::wire::frame`] says how a message becomes bytes.
//!
//! | request | answer | needs | what it does |
//! | --- | --- | --- | --- |
//! | `IdentityGet` | `Identity` | nobody | who the board is |
//! | `StatusGet` | `Status` | nobody | what it does, what it has counted |
//! | `JobGet` | `Job` | operator | the job in force |
//! | `JobCheck` | `Done` or `JobRefused` | operator | checks a job, changes nothing |
//! | `JobSet` | `Done` or `JobRefused` | engineer | replaces the job; forgets the taught reference |
//! | `LiveSet` | `Done` | operator | switches the unasked reports on or off |
//! | `FeatureGet` | `Feature` | operator | latest result of one feature of the job |
//! | `VerdictGet` | `Verdict` | operator | latest verdict, with its correction |
//! | `JournalInfo` | `JournalInfo` | operator | first and next sequence number |
//! | `JournalRead` | `JournalEntry` | operator | one entry by sequence number |
//! | `JournalChain` | `JournalChain` | operator | chain value before an entry: what its reader verifies against |
//! | `PositionsGet` | `Positions` | nobody | where the axes are now, and what they counted wrong |
//! | `TriggerOutSet` | `Done` or `TriggerRefused` | engineer | begins or ends trigger pulses for a scanner |
//! | `LaserSet` | `Done` or `NotOnThisBoard` | engineer | enables a scanner's laser |
//! | `ProgramList` | `Programs` | operator | the part programs in the board's flash |
//! | `ProgramBegin` | `ProgramAt` | engineer | begins an upload, or goes on with one that broke off |
//! | `ProgramPiece` | `ProgramAt` | engineer | bytes of it; those that stand elsewhere are not taken |
//! | `ProgramEnd` | `Done` | engineer | it counts from now on, in place of the old one, if its check value is right |
//! | `ProgramRead` | `ProgramBytes` | operator | bytes of a program |
//! | `ProgramDelete` | `Done` | engineer | deletes one |
//! | `ProgramOffer` | `Done` | engineer | the control's next READ gets this one, as if it had asked for it |
//! | `ProgramReceive` | `Done` | engineer | asks the control for a program by XMODEM; `ProgramKept` or `ProgramNotKept` is journaled |
//! | `ProgramPass` | `ProgramAt` | engineer | the control's next READ gets what this host passes through |
//! | `Teach` | `Done` or `TeachRefused` | engineer | the setup that comes next is to teach |
//! | `ProgramPassed` | `ProgramAt` or `Done` | engineer | bytes of that; those that find no room are not taken; `Done` when all has gone out |
//! | `LineListen` | `Done` or `LineRefused` | engineer | sets the control's line for as long as this host is there, to find out how the control's is set |
//! | `JournalAck` | `Done`, `JournalNoEntry` or `NotOnThisBoard` | operator | everything before an entry is kept elsewhere |
//! | `ConfigGet` | `Config` or `NotOnThisBoard` | operator | what the owner allows |
//! | `ConfigSet` | `Done`, `ConfigRefused` or `JobRefused` | owner | replaces that; `JobRefused`: the job in force asks for more |
//! | `HeadGet` | `Head` | nobody | the newest signed head; with a nonce: one over it, as soon as nothing is under way |
//! | `AccessGet` | `Access` | nobody | whether the board has an owner, and its own key |
//! | `KeyList` | `Keys` | operator | the keys that it knows |
//! | `KeyEnrol` | `Done` | owner | it knows a key from now on; the first owner's needs the jumper instead |
//! | `KeyRevoke` | `Done` | owner | it does not know it any more |
//! | `LockSet` | `Done` | owner | it changes nothing any more, or again |
//! | `Wipe` | `Done` | owner and jumper | it forgets everything and starts anew |
//! | `SessionBegin` | `SessionChallenge` | nobody | a host wants to prove its key |
//! | `SessionProve` | `SessionOpen` | nobody | it proves it: [`crate::access`] |
//! | `ImageGet` | `Image` | nobody | the image that runs |
//! | `UpdateBegin` | `UpdateAt` | owner | a signed image comes: [`crate::update`] |
//! | `UpdatePiece` | `UpdateAt` | owner | bytes of it |
//! | `UpdateEnd` | `Done` | owner | it is verified, and runs on trial from the start that follows at once |
//! | `HostTime` | `Done` | operator | what the host's clock says: noted once a minute at most, trusted never |
//! | `SensorSet` | `Done`, `SensorRefused` or `NotOnThisBoard` | engineer | sets a distance sensor up on the second port, or takes it away; it outlives a restart |
//! | `SensorGet` | `Sensor` or `NotOnThisBoard` | operator | the sensor in force, and the answer to the latest line |
//! | `SensorCommand` | `Done`, `SensorRefused` or `NotOnThisBoard` | engineer | a line to the station, as the control's macro prints it; its answer comes by `SensorGet` |
//!
//! Every request about programs may be answered by `ProgramRefused`, too, and each by
//! `AccessRefused`. Asked twice, each does what it does once.
//!
//! Trigger pulses and laser belong to the host that switched them on: the board
//! switches them off when that host is gone, and when nothing was heard of it for five
//! seconds: ask `PositionsGet` meanwhile. A program that it passes through ends there,
//! without an end that a control would take.

use heapless::Vec;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;
use thiserror::Error;

use crate::access::{
    AccessChange, AccessInfo, AccessRefusal, KeyId, KeyInfo, Keys, SessionAsk, SessionChallenge,
};
use crate::config::{BoardConfig, ConfigField, Fallbacks};
use crate::job::job_error::{Field, JobError};
use crate::job::serial::LineSettings;
use crate::job::{Job, Lessons, MAX_DATUMS, Name};
use crate::latch::{
    LatchBatch, LatchCounters, LatchReport, Positions, Scan, TriggerOut, TriggerRefusal,
};
use crate::point_sensor::{
    CaptureLoss, CommandText, PlaceReport, SensorOnBoard, SensorRefusal, SensorStatus,
};
use crate::records::fault::{Counters, Fault};
use crate::records::feature::FeatureResult;
use crate::records::head::{Head, HeadAnswer};
use crate::records::line::{HitReport, LineReport};
use crate::records::program::{
    MAX_LISTED, Piece, ProgramInfo, ProgramRefusal, ProgramRoom, Withheld,
};
use crate::records::verdict::Verdict;
use crate::schema::max_len;
use crate::update::{IMAGE_HEADER, ImageInfo, ImageVersion, UpdateRefusal, UpdateState};

pub use crate::access::{AccessMode, Role};

/// Raw bytes in one [`Record::Bytes`], at most.
pub const MAX_BYTES: usize = 256;
/// Bytes of one encoded [`Record`], at most.
pub const MAX_RECORD: usize = max_len::<Record>();

/// What a request needs to be answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestClass {
    /// Nothing that was measured: it is answered also while a fit holds all of that.
    Immediate,
    /// What the board knows.
    State,
}

/// Declares the requests: each one's class, role and possible answers stand beside it.
macro_rules! requests {
    (
        $(#[$meta:meta])*
        pub enum $name:ident {
            $(
                $(#[$doc:meta])*
                $variant:ident $( ( $inner:ty ) )? $( {
                    $( $(#[$field_doc:meta])* $field:ident : $type:ty, )*
                } )?
                => $class:ident, $role:ident, $($answer:ident)|+;
            )*
        }
    ) => {
        $(#[$meta])*
        pub enum $name {
            $(
                $(#[$doc])*
                $variant $( ( $inner ) )? $( { $( $(#[$field_doc])* $field : $type, )* } )?,
            )*
        }

        impl $name {
            /// What it needs to be answered.
            #[must_use]
            pub const fn class(&self) -> RequestClass {
                match self {
                    $( Self::$variant { .. } => RequestClass::$class, )*
                }
            }

            /// Whose key it needs. A request without a role does not compile.
            #[must_use]
            pub const fn needs(&self) -> Role {
                match self {
                    $( Self::$variant { .. } => Role::$role, )*
                }
            }

            /// Whether this can be an answer to it. Every request can be refused for want of a key
            /// or of a session.
            #[must_use]
            pub const fn is_answered_by(&self, response: &Response) -> bool {
                if matches!(response, Response::AccessRefused(_)) {
                    return true;
                }
                match self {
                    $( Self::$variant { .. } => matches!(
                        response,
                        $( Response::$answer { .. } )|+
                    ), )*
                }
            }
        }
    };
}

requests! {
    /// What the host may ask.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
    #[postcard(crate = crate)]
    #[allow(clippy::large_enum_variant, reason = "no heap; one exists at a time")]
    pub enum Request {
        /// Who are you?
        IdentityGet => State, None, Identity;
        /// What are you doing?
        StatusGet => State, None, Status;
        /// Which job is in force?
        JobGet => State, Operator, Job;
        /// Would you take this job?
        JobCheck(Job) => State, Operator, Done | JobRefused;
        /// Take this job.
        JobSet(Job) => State, Engineer, Done | JobRefused | StorageFailed;
        /// Report events unasked, or stop.
        LiveSet {
            /// True: report.
            on: bool,
        } => State, Operator, Done;
        /// The latest result of a feature.
        FeatureGet {
            /// Its place in the job, from 0.
            feature: u8,
        } => State, Operator, Feature;
        /// The latest verdict.
        VerdictGet => State, Operator, Verdict;
        /// What the journal holds.
        JournalInfo => State, Operator, JournalInfo | StorageFailed;
        /// One entry of the journal.
        JournalRead {
            /// Its sequence number.
            seq: u64,
        } => State, Operator, JournalEntry | JournalNoEntry | StorageFailed;
        /// The chain value before an entry; before the next one to come: that of the
        /// whole journal.
        JournalChain {
            /// The entry's sequence number.
            seq: u64,
        } => State, Operator, JournalChain | JournalNoEntry | StorageFailed;
        /// Where are the axes?
        PositionsGet => Immediate, None, Positions;
        /// Send trigger pulses to a scanner, or stop.
        TriggerOutSet(TriggerOut) => Immediate, Engineer, Done | TriggerRefused;
        /// Enable a scanner's laser, or not.
        LaserSet {
            /// True: enable.
            on: bool,
        } => Immediate, Engineer, Done | NotOnThisBoard;
        /// Which part programs are there?
        ProgramList {
            /// Programs to pass over: those that were listed already.
            skip: u16,
        } => State, Operator, Programs | ProgramRefused | StorageFailed;
        /// An upload begins.
        ProgramBegin(ProgramInfo) => State, Engineer, ProgramAt | ProgramRefused | StorageFailed;
        /// Bytes of the upload.
        ProgramPiece {
            /// Where they stand in the program.
            offset: u32,
            /// The bytes.
            bytes: Piece,
        } => State, Engineer, ProgramAt | ProgramRefused | StorageFailed;
        /// The upload is complete.
        ProgramEnd {
            /// The program's number.
            number: u32,
            /// The CRC-32 of its bytes.
            crc32: u32,
        } => State, Engineer, Done | ProgramRefused | StorageFailed;
        /// Bytes of a program.
        ProgramRead {
            /// Its number.
            number: u32,
            /// Where they stand.
            offset: u32,
        } => State, Operator, ProgramBytes | ProgramRefused | StorageFailed;
        /// Delete a program.
        ProgramDelete {
            /// Its number.
            number: u32,
        } => State, Engineer, Done | ProgramRefused | StorageFailed;
        /// Ask the control for a program by XMODEM, for a minute and a half: somebody lets it
        /// send. What becomes of it is journaled.
        ProgramReceive => State, Engineer, Done | ProgramRefused | StorageFailed;
        /// The control's next READ gets what this host will pass through, as if it had asked for
        /// it by its number.
        ProgramPass(ProgramInfo) => State, Engineer, ProgramAt | ProgramRefused;
        /// Bytes of what is passed through.
        ProgramPassed {
            /// Where they stand.
            offset: u32,
            /// The bytes.
            bytes: Piece,
        } => State, Engineer, ProgramAt | Done | ProgramRefused;
        /// The control's next READ gets this program, as if it had asked for it by its number.
        ProgramOffer {
            /// Its number.
            number: u32,
        } => State, Engineer, Done | ProgramRefused | StorageFailed;
        /// The setup that comes next is to teach.
        Teach {
            /// What.
            what: TeachWhat,
        } => State, Engineer, Done | TeachRefused;
        /// Set the control's line like this while this host is there, whatever the job says; none:
        /// as the job says again.
        LineListen(Option<LineSettings>) => State, Engineer, Done | LineRefused;
        /// The newest signed head of the journal.
        HeadGet {
            /// One over this nonce, which nobody can have signed before.
            nonce: Option<[u8; 32]>,
        } => State, None, Head;
        /// Everything before this entry is kept elsewhere.
        JournalAck {
            /// The entry's sequence number.
            seq: u64,
        } => State, Operator, Done | JournalNoEntry | NotOnThisBoard | StorageFailed;
        /// What does the owner allow?
        ConfigGet => State, Operator, Config | NotOnThisBoard;
        /// Allow this from now on.
        ConfigSet(BoardConfig)
            => State, Owner, Done | ConfigRefused | JobRefused | NotOnThisBoard | StorageFailed;
        /// How are you guarded?
        AccessGet => State, None, Access;
        /// Which keys do you know?
        KeyList => State, Operator, Keys;
        /// Know this key from now on, or give it this role. The first is an owner's, and needs the
        /// jumper instead of a key.
        KeyEnrol(KeyInfo) => State, Owner, Done | NotOnThisBoard | StorageFailed;
        /// Do not know this key any more.
        KeyRevoke {
            /// The key.
            key_id: KeyId,
        } => State, Owner, Done | NotOnThisBoard | StorageFailed;
        /// Change nothing any more, or again.
        LockSet {
            /// True: nothing.
            locked: bool,
        } => State, Owner, Done | NotOnThisBoard | StorageFailed;
        /// Forget everything: keys, configuration, job, programs, journal. It needs the jumper, too;
        /// the jumper alone is enough where it was closed over two starts. The board starts anew.
        Wipe => State, Owner, Done | NotOnThisBoard | StorageFailed;
        /// I have a key, and want a session.
        SessionBegin(SessionAsk) => State, None, SessionChallenge | NotOnThisBoard;
        /// This is the proof.
        SessionProve {
            /// The signature, R and S.
            signature: [[u8; 32]; 2],
        } => State, None, SessionOpen | NotOnThisBoard;
        /// Which image do you run?
        ImageGet => State, None, Image | NotOnThisBoard;
        /// An image comes, with this header.
        UpdateBegin {
            /// The header, in parts of 32 bytes.
            header: [[u8; 32]; IMAGE_HEADER / 32],
        } => State, Owner, UpdateAt | UpdateRefused | NotOnThisBoard | StorageFailed;
        /// Bytes of it.
        UpdatePiece {
            /// Where they stand behind the header.
            offset: u32,
            /// The bytes.
            bytes: Piece,
        } => State, Owner, UpdateAt | UpdateRefused | NotOnThisBoard | StorageFailed;
        /// It is whole: start it on trial.
        UpdateEnd => State, Owner, Done | UpdateRefused | NotOnThisBoard | StorageFailed;
        /// This is the time, as I have it.
        HostTime {
            /// Seconds since the start of 1970, UTC.
            utc_s: u64,
        } => State, Operator, Done | StorageFailed;
        /// Set this distance sensor up; none: take it away.
        SensorSet(Option<SensorOnBoard>)
            => State, Engineer, Done | SensorRefused | NotOnThisBoard | StorageFailed;
        /// What does the sensor's station do?
        SensorGet => State, Operator, Sensor | NotOnThisBoard;
        /// A line to the station, as the control's macro prints it.
        SensorCommand {
            /// The line.
            line: CommandText,
        } => State, Engineer, Done | SensorRefused | NotOnThisBoard;
    }
}

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

/// Why nothing is to be taught.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error, IntoStaticStr,
)]
#[strum(serialize_all = "snake_case")]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum TeachRefusal {
    /// There is no job.
    #[error("the board has no job: `umi job set` gives it one")]
    NoJob,
    /// The job gives its positions.
    #[strum(serialize = "reference_given")]
    #[error("the job gives its positions (`reference = \"given\"`): there is nothing to teach")]
    Given,
    /// There is a reference, and nobody said that it is to be replaced.
    #[error("there is a reference already: ask again with --again to replace it")]
    AlreadyTaught,
    /// A setup is being measured: ask before it begins.
    #[error("a clamping is being measured: ask before it begins")]
    UnderWay,
    /// Nothing is taught that one more setup could add to.
    #[error("nothing is taught yet: ask without --more")]
    NotTaught,
    /// The job holds nothing against what was learned.
    #[error(
        "the job has no [guards.learned]: there are no limits that one more clamping could widen"
    )]
    NoLearned,
}

/// What the setup that comes next is to teach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum TeachWhat {
    /// The reference, where there is none.
    Reference,
    /// The reference, also in place of the one that there is.
    Again,
    /// How features may be, besides what was learned before. The reference stays.
    More,
}

/// A teaching that somebody has asked for and that has not happened yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct TeachPending {
    /// Who asked.
    pub by: TeachBy,
    /// What is to be taught.
    pub what: TeachWhat,
    /// When it was asked for, since the board started.
    pub t_us: u64,
    /// By which setup.
    pub setup: TeachSetup,
}

/// Who asks to teach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum TeachBy {
    /// A host.
    Host,
    /// The board's button.
    Button,
    /// A checked line of the control. It asks for its own run alone.
    Line,
}

/// Which setup is to teach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum TeachSetup {
    /// The one that comes next.
    Next,
    /// The one under way.
    UnderWay {
        /// Its number.
        setup: u32,
    },
    /// One that was refused: it teaches only if what was refused is probed again now.
    Refused {
        /// Its number.
        setup: u32,
    },
}

impl TeachRefusal {
    /// The stable code.
    #[must_use]
    pub fn code(self) -> &'static str {
        self.into()
    }
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

/// Bytes of one stored journal entry, at most: a record and its frame.
pub const MAX_ENTRY: usize = MAX_RECORD + 64;

/// What the board reports unasked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[allow(clippy::large_enum_variant, reason = "no heap; one exists at a time")]
pub enum Event {
    /// A line from the control.
    Line(LineReport),
    /// A hit as the control reported it.
    Hit(HitReport),
    /// An entry that went into the journal.
    Record {
        /// Its sequence number.
        seq: u64,
        /// When.
        t_us: u64,
        /// What.
        record: Record,
    },
    /// Triggers and trigger pulses, as they come. They are not journaled one by one.
    Latches(LatchBatch),
    /// Events were dropped because the host did not read; the journal has the records.
    Dropped {
        /// How many.
        count: u32,
    },
}

/// One entry of the journal: everything that goes into the brain and
/// everything that it decides. Feeding the inputs to the brain again gives the
/// same decisions, bit for bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[allow(clippy::large_enum_variant, reason = "no heap; one exists at a time")]
pub enum Record {
    // --- inputs
    /// The board started; the brain is empty.
    Boot {
        /// The firmware that runs.
        identity: Identity,
        /// Why it started.
        reset: ResetReason,
    },
    /// The journal was opened and something of it was lost: an entry torn by a power
    /// cut, or damage.
    Recovered {
        /// Bytes of the torn entry, given up.
        torn_bytes: u32,
        /// Entries that had been kept and cannot be read any more.
        damaged_entries: u64,
        /// Sectors whose header cannot be read any more.
        damaged_headers: u32,
        /// The chain could not be followed to its end and goes on from the last
        /// entry that could be proven.
        chain_restarted: bool,
    },
    /// A job was set, or restored at start.
    JobSet {
        /// The job.
        job: Job,
        /// By whose key; none: nobody's, or restored. Older records have none of it.
        key_id: Option<KeyId>,
    },
    /// A reference was restored at start.
    ReferenceRestored {
        /// Places of the job's datum features, in its order, then of those on the table.
        positions_mm: Vec<[f64; 3], MAX_DATUMS>,
        /// How each feature of the job was when it was taught. Older records have none.
        learned: Lessons,
    },
    /// Bytes from the control.
    Bytes {
        /// As received, parity bit included.
        raw: Vec<u8, MAX_BYTES>,
    },
    /// Bytes from the control were lost before the receiver.
    BytesLost {
        /// How many.
        count: u32,
    },
    /// Time was told to the brain (a time-out became due).
    Time,
    /// The input ended (a captured file; never on a machine).
    InputEnd,

    // --- decisions
    /// Something was lost, damaged or not understood.
    Fault(Fault),
    /// A feature was fitted or refused.
    Feature(FeatureResult),
    /// A setup was judged.
    Verdict(Verdict),
    /// A setup became the reference, or is none any more because it is NG after all.
    Taught {
        /// Places of the job's datum features, in its order, then of those on the table;
        /// empty: there is no reference any more.
        positions_mm: Vec<[f64; 3], MAX_DATUMS>,
        /// How each feature of the job was when it was taught. Older records have none.
        learned: Lessons,
    },

    // --- deeds
    /// A correction program went out to the control.
    CorrectionSent {
        /// Of this setup.
        setup: u32,
        /// Bytes sent.
        bytes: u32,
        /// False: the control stopped it or the line broke before its end.
        complete: bool,
    },
    /// A latch captured the axes. An input too: the second witness of a hit.
    Latch(LatchReport),
    /// Triggers or trigger pulses came, and then none for a second.
    Scan(Scan),
    /// A part program was uploaded.
    ProgramKept {
        /// Which.
        program: ProgramInfo,
        /// By whose key; none: nobody's, or the control punched it. Older records have none of it.
        key_id: Option<KeyId>,
    },
    /// A part program was deleted.
    ProgramDeleted {
        /// Its number.
        number: u32,
        /// The CRC-32 of its bytes.
        crc32: u32,
        /// By whose key; none: nobody's. Older records have none of it.
        key_id: Option<KeyId>,
    },
    /// A READ for which there is no program: one went out that raises an alarm.
    AlarmSent {
        /// The number that the control asked for, or the correction's.
        number: u32,
        /// Why there is none.
        why: Withheld,
        /// Bytes sent.
        bytes: u32,
        /// False: the control stopped it or the line broke before its end.
        complete: bool,
    },
    /// A part program went out to the control that asked for it.
    ProgramSent {
        /// Its number.
        number: u32,
        /// The CRC-32 of its bytes.
        crc32: u32,
        /// By the registration of which setup it was rewritten; none: it went out as it is.
        rewritten_for: Option<u32>,
        /// Bytes sent.
        bytes: u32,
        /// False: the control stopped it or the line broke before its end.
        complete: bool,
    },
    /// A program that the control punched is not kept.
    ProgramNotKept {
        /// Its number.
        number: u32,
        /// Why.
        why: ProgramRefusal,
    },
    /// A correction program is about to go out: this is in the journal before its first
    /// byte, or that does not go out. Without a [`Self::CorrectionSent`] behind it the power
    /// went while it was on its way, and the control has as much of it as it has.
    CorrectionBegun {
        /// Of this setup.
        setup: u32,
    },
    /// A part program is about to go out, as [`Self::CorrectionBegun`]; a
    /// [`Self::ProgramSent`] of the same number follows.
    ProgramBegun {
        /// Its number.
        number: u32,
        /// The CRC-32 of its bytes.
        crc32: u32,
        /// By the registration of which setup it is rewritten; none: it goes out as it is.
        rewritten_for: Option<u32>,
    },
    /// The setup that comes next is to teach, as a host asked. An input too.
    TeachAsked {
        /// True: limits that were learned, and no reference. Older records have none of it.
        more: bool,
    },
    /// No job could be restored at start, and why: the board measures nothing before one is
    /// set. Not on a board whose journal is new.
    JobLost {
        /// Why.
        why: JobLoss,
    },
    /// The board vouches for everything before this entry.
    Head(Head),
    /// Somebody held the board's button for a second: the setup that comes next is to teach.
    /// An input too.
    ButtonHeld {
        /// Why it does not; none: it does.
        refused: Option<TeachRefusal>,
    },
    /// As the fault before this entry, of the same kind and within a second of it: so many more,
    /// which have no entries of their own.
    FaultsAgain {
        /// The latest of them.
        latest: Fault,
        /// How many.
        count: u32,
    },
    /// A host says that everything before this entry is kept elsewhere.
    Acknowledged {
        /// The entry.
        seq: u64,
        /// Entries that were overwritten before anybody had said so of them.
        lost: u64,
    },
    /// What the owner allows was replaced, or restored at start.
    ConfigSet(BoardConfig),
    /// The greatest run that had been judged was restored at start. An input too.
    LastRun {
        /// The run.
        run: u32,
    },
    /// Who may do what was changed.
    Access {
        /// What.
        what: AccessChange,
        /// Of this key; of a lock: the owner's who did it.
        key_id: KeyId,
        /// Its role.
        role: Role,
        /// By whose key; none: the jumper was closed.
        by: Option<KeyId>,
    },
    /// Somebody was refused something, so often since the last such entry. At most one a minute for
    /// each reason.
    AccessRefused {
        /// Why, the latest time.
        why: AccessRefusal,
        /// How often.
        count: u32,
        /// Which key was tried, the latest time, if one was.
        key_id: Option<KeyId>,
    },
    /// The board was wiped: this journal is a new one.
    Wiped {
        /// The oldest entry that the old one held.
        first_seq: u64,
        /// The number that its next entry would have got.
        next_seq: u64,
        /// Its chain value, over everything that was ever in it.
        chain: [u8; 32],
        /// By whose key; none: by the jumper alone.
        key_id: Option<KeyId>,
    },
    /// The image that runs was changed, or is to be.
    Update {
        /// What became of it.
        what: UpdateState,
        /// The version before.
        from: ImageVersion,
        /// The version that came.
        to: ImageVersion,
    },
    /// What a host's clock said. The board does not trust it, and no decision rests on it.
    HostTime {
        /// Seconds since the start of 1970, UTC.
        utc_s: u64,
        /// By whose key; none: nobody's.
        key_id: Option<KeyId>,
    },
    /// A distance sensor was set up, taken away, or restored at start.
    SensorSet {
        /// The sensor; none: it was taken away.
        sensor: Option<SensorOnBoard>,
        /// By whose key; none: nobody's, or restored.
        key_id: Option<KeyId>,
    },
    /// A place was measured by the distance sensor, or was not, and why.
    Place(PlaceReport),
    /// A capture of the distance sensor, or what belongs to it, was lost.
    CaptureLost(CaptureLoss),
}

/// Kind numbers of the records that are evidence: what was decided, what went out to the machine,
/// what was in force, and who changed it. Never changed for a kind that there is: the chain of
/// evidence rests on it.
const EVIDENCE: [u8; 21] = [
    0, 1, 2, 3, 10, 11, 12, 16, 18, 20, 21, 23, 24, 27, 28, 30, 31, 32, 33, 34, 35,
];

impl Record {
    /// The kind number stored with a journal entry. Never reused, never renumbered.
    #[must_use]
    pub const fn kind(&self) -> u8 {
        match self {
            Self::Boot { .. } => 0,
            Self::Recovered { .. } => 1,
            Self::JobSet { .. } => 2,
            Self::ReferenceRestored { .. } => 3,
            Self::Bytes { .. } => 4,
            Self::BytesLost { .. } => 5,
            Self::Time => 6,
            Self::InputEnd => 7,
            Self::Fault(_) => 8,
            Self::Feature(_) => 9,
            Self::Verdict(_) => 10,
            Self::Taught { .. } => 11,
            Self::CorrectionSent { .. } => 12,
            Self::Latch(_) => 13,
            Self::Scan(_) => 14,
            Self::ProgramKept { .. } => 15,
            Self::ProgramDeleted { .. } => 16,
            Self::AlarmSent { .. } => 17,
            Self::ProgramSent { .. } => 18,
            Self::ProgramNotKept { .. } => 19,
            Self::CorrectionBegun { .. } => 20,
            Self::ProgramBegun { .. } => 21,
            Self::TeachAsked { .. } => 22,
            Self::JobLost { .. } => 23,
            Self::Head(_) => 24,
            Self::ButtonHeld { .. } => 25,
            Self::FaultsAgain { .. } => 26,
            Self::Acknowledged { .. } => 27,
            Self::ConfigSet(_) => 28,
            Self::LastRun { .. } => 29,
            Self::Access { .. } => 30,
            Self::AccessRefused { .. } => 31,
            Self::Wiped { .. } => 32,
            Self::Update { .. } => 33,
            Self::HostTime { .. } => 34,
            Self::SensorSet { .. } => 35,
            Self::Place(_) => 36,
            Self::CaptureLost(_) => 37,
        }
    }

    /// Whether a record of this kind is evidence, which a board keeps where noise cannot push it
    /// out.
    #[must_use]
    pub fn is_evidence(kind: u8) -> bool {
        EVIDENCE.contains(&kind)
    }
}

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
