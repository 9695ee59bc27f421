//! What the host may ask, who may, and what each may be answered by.

use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::access::{KeyId, KeyInfo, Role, SessionAsk};
use crate::config::BoardConfig;
use crate::job::Job;
use crate::job::serial::LineSettings;
use crate::latch::TriggerOut;
use crate::point_sensor::{CommandText, SensorOnBoard};
use crate::records::program::{Piece, ProgramInfo};
use crate::update::IMAGE_HEADER;

use super::{Response, TeachWhat};

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
