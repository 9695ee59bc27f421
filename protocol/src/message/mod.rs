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

mod record;
mod request;
mod response;
mod status;
mod teach;

pub use crate::access::{AccessMode, Role};
pub use record::{Event, MAX_BYTES, MAX_ENTRY, MAX_RECORD, Record};
pub use request::{Request, RequestClass};
pub use response::{LineRefusal, Response};
pub use status::{Identity, JobLoss, JournalInfo, ResetReason, Status};
pub use teach::{TeachBy, TeachPending, TeachRefusal, TeachSetup, TeachWhat};
