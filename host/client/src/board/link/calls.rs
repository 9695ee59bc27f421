//! What a host can ask a board: one table of calls, each with its request and its answers.

use umi_protocol::access::{AccessInfo, KeyId, KeyInfo, Role, SessionAsk, SessionChallenge};
use umi_protocol::config::{BoardConfig, ConfigField, Fallbacks};
use umi_protocol::feature::FeatureResult;
use umi_protocol::head::HeadAnswer;
use umi_protocol::job::{Job, Lessons};
use umi_protocol::job_error::JobError;
use umi_protocol::latch::{Positions, TriggerOut, TriggerRefusal};
use umi_protocol::message::{
    Identity, JournalInfo, LineRefusal, Request, Response, Status, TeachRefusal, TeachWhat,
};
use umi_protocol::point_sensor::{CommandText, SensorOnBoard, SensorRefusal, SensorStatus};
use umi_protocol::program::{Piece, ProgramInfo, ProgramRefusal, ProgramRoom};
use umi_protocol::serial::LineSettings;
use umi_protocol::update::{IMAGE_HEADER, ImageInfo, UpdateRefusal};
use umi_protocol::verdict::Verdict;

use super::LinkError;
use super::client::Client;

/// The job that a board works on.
#[derive(Clone, Debug, PartialEq)]
pub struct JobInForce {
    /// None: no job has been set.
    pub job: Option<Job>,
    /// The taught reference positions in the order of the job's datum features, if a
    /// setup has been taught.
    pub taught_mm: Option<Vec<[f64; 3]>>,
    /// How each feature of the job was when it was taught.
    pub learned: Lessons,
}

/// What a journal holds under a sequence number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum JournalEntry {
    /// The entry as stored, with its check and chain values.
    Stored(Vec<u8>),
    /// It is not there any more, or not yet.
    None(JournalInfo),
}

/// What is known of the chain before an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JournalChain {
    /// The value.
    Before([u8; 32]),
    /// Damage before the entry hides it.
    Hidden,
    /// The entry is not there any more, or not yet.
    None(JournalInfo),
}

/// What came of an acknowledgement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Acknowledged {
    /// It is kept.
    Done,
    /// There is no such entry yet.
    NoEntry(JournalInfo),
    /// The board cannot keep it.
    NotOnThisBoard,
}

/// Why a configuration is not taken.
#[derive(Clone, Debug, PartialEq)]
pub enum ConfigRefusal {
    /// This field cannot be used.
    Field(ConfigField),
    /// The job in force asks for more.
    Job(JobError),
    /// The board cannot be configured.
    NotOnThisBoard,
}

/// What came of a sensor, or of a line to its station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorTaken {
    /// It is in force; the line is carried out.
    Done,
    /// It is not taken.
    Refused(SensorRefusal),
    /// The board has no second port.
    NotOnThisBoard,
}

/// What came of a proof that was not refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionAnswer {
    /// What the key is for, and the board's signature, R and S.
    Open(Role, [[u8; 32]; 2]),
    /// The board cannot have sessions.
    NotOnThisBoard,
}

/// How much room there is for programs and some of them; or why there are none.
pub type StoredPrograms = Result<(ProgramRoom, Vec<ProgramInfo>), ProgramRefusal>;

/// `name(arguments) -> answer = request => { response => value, }`: any other response is a
/// wrong answer.
macro_rules! calls {
    ($(
        $(#[$doc:meta])*
        $name:ident($($argument:ident: $type:ty),*) -> $answer:ty = $request:expr => {
            $( $response:pat $(if $guard:expr)? => $value:expr, )+
        }
    )*) => {
        impl Client { $(
            $(#[$doc])*
            ///
            /// # Errors
            /// [`LinkError`], as all calls.
            pub fn $name(&mut self, $($argument: $type),*) -> Result<$answer, LinkError> {
                let request = $request;
                match self.call(&request, name(&request))? {
                    $( $response $(if $guard)? => Ok($value), )+
                    _ => Err(LinkError::WrongAnswer { request: name(&request) }),
                }
            }
        )* }
    };
}

calls! {
    /// Who the board is.
    identity() -> Identity = Request::IdentityGet => {
        Response::Identity(identity) => identity,
    }

    /// What the board does and what it has counted.
    status() -> Status = Request::StatusGet => { Response::Status(status) => status, }

    /// The job in force and the taught reference.
    job() -> JobInForce = Request::JobGet => {
        Response::Job { job, taught_mm, learned } => JobInForce {
            job,
            taught_mm: taught_mm.map(|positions| positions.to_vec()),
            learned,
        },
    }

    /// Whether the board would take a job; changes nothing.
    check_job(job: &Job) -> Result<(), JobError> = Request::JobCheck(job.clone()) => {
        Response::Done => Ok(()),
        Response::JobRefused(error) => Err(error),
    }

    /// Gives the board a job; it forgets the taught reference. The request is not repeated,
    /// as a setup may be taught in between: without an answer
    /// [`LinkError::JobOutcomeUnknown`].
    set_job(job: &Job) -> Result<(), JobError> = Request::JobSet(job.clone()) => {
        Response::Done => Ok(()),
        Response::JobRefused(error) => Err(error),
    }

    /// Lets the setup that comes next teach.
    teach(what: TeachWhat) -> Result<(), TeachRefusal> = Request::Teach { what } => {
        Response::Done => Ok(()),
        Response::TeachRefused(refusal) => Err(refusal),
    }

    /// Sets the control's line as long as this program is connected, whatever the job says; none:
    /// as the job says again.
    listen(line: Option<LineSettings>) -> Result<(), LineRefusal> = Request::LineListen(line) => {
        Response::Done => Ok(()),
        Response::LineRefused(refusal) => Err(refusal),
    }

    /// Switches the unasked reports on or off.
    live(on: bool) -> () = Request::LiveSet { on } => { Response::Done => (), }

    /// Where the axes are now, and what they counted wrong.
    positions() -> Positions = Request::PositionsGet => {
        Response::Positions(positions) => positions,
    }

    /// Trigger pulses for a scanner from now on, or none; or why not, and nothing has changed.
    trigger_out(when: TriggerOut) -> Result<(), TriggerRefusal> = Request::TriggerOutSet(when) => {
        Response::Done => Ok(()),
        Response::TriggerRefused(refusal) => Err(refusal),
    }

    /// Enables a scanner's laser, or not. False: the board has no such output.
    laser(on: bool) -> bool = Request::LaserSet { on } => {
        Response::Done => true,
        Response::NotOnThisBoard => false,
    }

    /// The latest result of a feature by its place in the job, from 0.
    feature(feature: u8) -> Option<FeatureResult> = Request::FeatureGet { feature } => {
        Response::Feature(result) => result,
    }

    /// The latest verdict.
    verdict() -> Option<Verdict> = Request::VerdictGet => {
        Response::Verdict(verdict) => verdict,
    }

    /// What the journal holds.
    journal_info() -> JournalInfo = Request::JournalInfo => {
        Response::JournalInfo(info) => info,
    }

    /// One entry of the journal by its sequence number.
    journal_read(seq: u64) -> JournalEntry = Request::JournalRead { seq } => {
        Response::JournalEntry { seq: of, raw } if of == seq => {
            JournalEntry::Stored(raw.to_vec())
        },
        Response::JournalNoEntry(info) => JournalEntry::None(info),
    }

    /// The newest signed head; over this nonce, if one is given.
    head(nonce: Option<[u8; 32]>) -> HeadAnswer = Request::HeadGet { nonce } => {
        Response::Head(answer) => answer,
    }

    /// Says that everything before an entry is kept elsewhere.
    journal_ack(seq: u64) -> Acknowledged = Request::JournalAck { seq } => {
        Response::Done => Acknowledged::Done,
        Response::JournalNoEntry(info) => Acknowledged::NoEntry(info),
        Response::NotOnThisBoard => Acknowledged::NotOnThisBoard,
    }

    /// What the owner allows, and the fields that could not be read where they are kept; none: the
    /// board cannot be configured.
    config() -> Option<(BoardConfig, Fallbacks)> = Request::ConfigGet => {
        Response::Config { config, fallbacks } => Some((config, fallbacks)),
        Response::NotOnThisBoard => None,
    }

    /// Replaces what the owner allows.
    set_config(config: &BoardConfig) -> Result<(), ConfigRefusal> =
        Request::ConfigSet(*config) =>
    {
        Response::Done => Ok(()),
        Response::ConfigRefused(field) => Err(ConfigRefusal::Field(field)),
        Response::JobRefused(error) => Err(ConfigRefusal::Job(error)),
        Response::NotOnThisBoard => Err(ConfigRefusal::NotOnThisBoard),
    }

    /// How the board is guarded.
    access() -> AccessInfo = Request::AccessGet => { Response::Access(info) => info, }

    /// The keys that the board knows.
    keys() -> Vec<KeyInfo> = Request::KeyList => { Response::Keys(keys) => keys.to_vec(), }

    /// The board is to know a key from now on. False: it cannot.
    key_enrol(key: &KeyInfo) -> bool = Request::KeyEnrol(key.clone()) => {
        Response::Done => true,
        Response::NotOnThisBoard => false,
    }

    /// The board is not to know a key any more. False: it cannot.
    key_revoke(key_id: KeyId) -> bool = Request::KeyRevoke { key_id } => {
        Response::Done => true,
        Response::NotOnThisBoard => false,
    }

    /// The board is to change nothing any more, or again. False: it cannot.
    lock(locked: bool) -> bool = Request::LockSet { locked } => {
        Response::Done => true,
        Response::NotOnThisBoard => false,
    }

    /// The board is to forget everything and start anew. False: it cannot.
    wipe() -> bool = Request::Wipe => {
        Response::Done => true,
        Response::NotOnThisBoard => false,
    }

    /// The image that the board runs; none: it takes none over the line.
    image() -> Option<ImageInfo> = Request::ImageGet => {
        Response::Image(info) => Some(info),
        Response::NotOnThisBoard => None,
    }

    /// An image comes: where its next byte is wanted; none: the board takes none.
    update_begin(header: &[u8; IMAGE_HEADER]) -> Result<Option<u32>, UpdateRefusal> =
        Request::UpdateBegin { header: parts(header) } =>
    {
        Response::UpdateAt { offset } => Ok(Some(offset)),
        Response::UpdateRefused(refusal) => Err(refusal),
        Response::NotOnThisBoard => Ok(None),
    }

    /// Bytes of an image: where the next is wanted.
    update_piece(offset: u32, bytes: Piece) -> Result<u32, UpdateRefusal> =
        Request::UpdatePiece { offset, bytes } =>
    {
        Response::UpdateAt { offset } => Ok(offset),
        Response::UpdateRefused(refusal) => Err(refusal),
    }

    /// The image is whole: the board verifies it and starts it on trial.
    update_end() -> Result<(), UpdateRefusal> = Request::UpdateEnd => {
        Response::Done => Ok(()),
        Response::UpdateRefused(refusal) => Err(refusal),
    }

    /// Says what this machine's clock says, in seconds since the start of 1970, UTC.
    host_time(utc_s: u64) -> () = Request::HostTime { utc_s } => { Response::Done => (), }

    /// Sets a distance sensor up on the board's second port, or takes it away; or says why not.
    set_sensor(sensor: Option<SensorOnBoard>) -> SensorTaken = Request::SensorSet(sensor) => {
        Response::Done => SensorTaken::Done,
        Response::SensorRefused(refusal) => SensorTaken::Refused(refusal),
        Response::NotOnThisBoard => SensorTaken::NotOnThisBoard,
    }

    /// What the station of a distance sensor does; none: the board has no second port.
    sensor() -> Option<SensorStatus> = Request::SensorGet => {
        Response::Sensor(status) => Some(status),
        Response::NotOnThisBoard => None,
    }

    /// Passes a line on to the station, as the control's macro prints it.
    sensor_command(line: CommandText) -> SensorTaken = Request::SensorCommand { line } => {
        Response::Done => SensorTaken::Done,
        Response::SensorRefused(refusal) => SensorTaken::Refused(refusal),
        Response::NotOnThisBoard => SensorTaken::NotOnThisBoard,
    }

    /// Asks for a session; none: the board has none.
    session_begin(ask: SessionAsk) -> Option<SessionChallenge> = Request::SessionBegin(ask) => {
        Response::SessionChallenge(challenge) => Some(challenge),
        Response::NotOnThisBoard => None,
    }

    /// Proves a key.
    session_prove(signature: [[u8; 32]; 2]) -> SessionAnswer =
        Request::SessionProve { signature } =>
    {
        Response::SessionOpen { role, signature } => SessionAnswer::Open(role, signature),
        Response::NotOnThisBoard => SessionAnswer::NotOnThisBoard,
    }

    /// The chain value before an entry; before the next one to come: that of the
    /// whole journal.
    journal_chain(seq: u64) -> JournalChain = Request::JournalChain { seq } => {
        Response::JournalChain { seq: of, before } if of == seq => {
            before.map_or(JournalChain::Hidden, JournalChain::Before)
        },
        Response::JournalNoEntry(info) => JournalChain::None(info),
    }

    /// How much room there is for programs, and the programs behind the first `skip`: as
    /// many as an answer holds, none at the end.
    programs(skip: u16) -> StoredPrograms = Request::ProgramList { skip } => {
        Response::Programs { room, programs } => Ok((room, programs.to_vec())),
        Response::ProgramRefused(refusal) => Err(refusal),
    }

    /// Begins an upload, or goes on with one that broke off: where the byte stands that is
    /// wanted next.
    program_begin(program: &ProgramInfo) -> Result<u32, ProgramRefusal> =
        Request::ProgramBegin(program.clone()) =>
    {
        Response::ProgramAt { offset } => Ok(offset),
        Response::ProgramRefused(refusal) => Err(refusal),
    }

    /// Sends bytes of an upload: where the byte stands that is wanted next.
    program_piece(offset: u32, bytes: Piece) -> Result<u32, ProgramRefusal> =
        Request::ProgramPiece { offset, bytes } =>
    {
        Response::ProgramAt { offset } => Ok(offset),
        Response::ProgramRefused(refusal) => Err(refusal),
    }

    /// Ends an upload: after this the program is on the board, whole.
    program_end(number: u32, crc32: u32) -> Result<(), ProgramRefusal> =
        Request::ProgramEnd { number, crc32 } =>
    {
        Response::Done => Ok(()),
        Response::ProgramRefused(refusal) => Err(refusal),
    }

    /// Bytes of a program; none behind its end.
    program_read(number: u32, offset: u32) -> Result<Vec<u8>, ProgramRefusal> =
        Request::ProgramRead { number, offset } =>
    {
        Response::ProgramBytes { offset: at, bytes } if at == offset => Ok(bytes.to_vec()),
        Response::ProgramRefused(refusal) => Err(refusal),
    }

    /// Deletes a program.
    program_delete(number: u32) -> Result<(), ProgramRefusal> =
        Request::ProgramDelete { number } =>
    {
        Response::Done => Ok(()),
        Response::ProgramRefused(refusal) => Err(refusal),
    }

    /// Makes a program what the control's next READ gets.
    program_offer(number: u32) -> Result<(), ProgramRefusal> = Request::ProgramOffer { number } => {
        Response::Done => Ok(()),
        Response::ProgramRefused(refusal) => Err(refusal),
    }

    /// Lets the board ask the control for a program by XMODEM.
    program_receive() -> Result<(), ProgramRefusal> = Request::ProgramReceive => {
        Response::Done => Ok(()),
        Response::ProgramRefused(refusal) => Err(refusal),
    }

    /// Makes what will be passed through what the control's next READ gets.
    program_pass(program: &ProgramInfo) -> Result<u32, ProgramRefusal> =
        Request::ProgramPass(program.clone()) =>
    {
        Response::ProgramAt { offset } => Ok(offset),
        Response::ProgramRefused(refusal) => Err(refusal),
    }

    /// Passes bytes through: where the byte stands that is wanted next; none when all has
    /// gone out.
    program_passed(offset: u32, bytes: Piece) -> Result<Option<u32>, ProgramRefusal> =
        Request::ProgramPassed { offset, bytes } =>
    {
        Response::ProgramAt { offset } => Ok(Some(offset)),
        Response::Done => Ok(None),
        Response::ProgramRefused(refusal) => Err(refusal),
    }
}

/// A header as it goes over the line.
fn parts(header: &[u8; IMAGE_HEADER]) -> [[u8; 32]; IMAGE_HEADER / 32] {
    let mut parts = [[0; 32]; IMAGE_HEADER / 32];
    for (part, bytes) in parts.iter_mut().zip(header.chunks_exact(32)) {
        part.copy_from_slice(bytes);
    }
    parts
}

/// The name of a request in messages.
pub(super) const fn name(request: &Request) -> &'static str {
    match request {
        Request::IdentityGet => "identity",
        Request::StatusGet => "status",
        Request::JobGet => "job",
        Request::JobCheck(_) => "check job",
        Request::JobSet(_) => "set job",
        Request::LiveSet { .. } => "live",
        Request::FeatureGet { .. } => "feature",
        Request::VerdictGet => "verdict",
        Request::JournalInfo => "journal info",
        Request::JournalRead { .. } => "journal read",
        Request::JournalChain { .. } => "journal chain",
        Request::PositionsGet => "positions",
        Request::TriggerOutSet(_) => "trigger out",
        Request::LaserSet { .. } => "laser",
        Request::ProgramList { .. } => "program list",
        Request::ProgramBegin(_) => "program upload",
        Request::ProgramPiece { .. } => "program piece",
        Request::ProgramEnd { .. } => "program end",
        Request::ProgramRead { .. } => "program read",
        Request::ProgramDelete { .. } => "program delete",
        Request::ProgramOffer { .. } => "program offer",
        Request::ProgramReceive => "program receive",
        Request::ProgramPass(_) => "program pass",
        Request::ProgramPassed { .. } => "passed bytes",
        Request::Teach { .. } => "teach",
        Request::LineListen(_) => "line listen",
        Request::HeadGet { .. } => "head",
        Request::JournalAck { .. } => "journal acknowledgement",
        Request::ConfigGet => "configuration",
        Request::ConfigSet(_) => "set configuration",
        Request::AccessGet => "access",
        Request::KeyList => "keys",
        Request::KeyEnrol(_) => "enrol key",
        Request::KeyRevoke { .. } => "revoke key",
        Request::LockSet { .. } => "lock",
        Request::Wipe => "wipe",
        Request::SessionBegin(_) => "session",
        Request::SessionProve { .. } => "session proof",
        Request::ImageGet => "image",
        Request::UpdateBegin { .. } => "update",
        Request::UpdatePiece { .. } => "update piece",
        Request::UpdateEnd => "update end",
        Request::HostTime { .. } => "host time",
        Request::SensorSet(_) => "set sensor",
        Request::SensorGet => "sensor",
        Request::SensorCommand { .. } => "sensor command",
    }
}
