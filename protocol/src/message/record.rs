//! What goes into the journal, and what the board reports unasked.

use heapless::Vec;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::access::{AccessChange, AccessRefusal, KeyId, Role};
use crate::config::BoardConfig;
use crate::job::{Job, Lessons, MAX_DATUMS};
use crate::latch::{LatchBatch, LatchReport, Scan};
use crate::point_sensor::{CaptureLoss, PlaceReport, SensorOnBoard};
use crate::records::fault::Fault;
use crate::records::feature::FeatureResult;
use crate::records::head::Head;
use crate::records::line::{HitReport, LineReport};
use crate::records::program::{ProgramInfo, ProgramRefusal, Withheld};
use crate::records::verdict::Verdict;
use crate::schema::max_len;
use crate::update::{ImageVersion, UpdateState};

use super::{Identity, JobLoss, ResetReason, TeachRefusal};

/// Raw bytes in one [`Record::Bytes`], at most.
pub const MAX_BYTES: usize = 256;

/// Bytes of one encoded [`Record`], at most.
pub const MAX_RECORD: usize = max_len::<Record>();

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
        /// The run that taught, where the program compares it with the control's. Older records have none of it.
        run: Option<u32>,
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
        /// True: nothing, and the setup that taught the reference is the one that was meant.
        keep: bool,
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
    /// The greatest run that had been judged was restored, at start or behind another job. An input too.
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
