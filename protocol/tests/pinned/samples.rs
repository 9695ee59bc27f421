//! One sample of every message: each function names the sample after the given
//! one. The matches have no wildcard, so a new variant does not compile until it
//! has its place here.

use heapless::{String, Vec};
use umi_protocol::access::{
    AccessChange, AccessInfo, AccessMode, AccessRefusal, KeyId, KeyInfo, KeyName, Role, SessionAsk,
    SessionChallenge,
};
use umi_protocol::config::{
    AccessConfig, BoardConfig, Ceilings, ConfigField, JournalConfig, LockedReading, WhenFull,
};
use umi_protocol::fault::{Counters, Fault, FaultCode, FaultKind};
use umi_protocol::feature::{FeatureResult, FitReport, Shape};
use umi_protocol::head::{EvidenceMark, Head, HeadAnswer};
use umi_protocol::hello::{Hello, Version};
use umi_protocol::job::name;
use umi_protocol::job::{
    AgainSpec, Approach, Closing, Compensation, CorrectionSpec, Dialect, Doubt, FeatureKind,
    FeatureSpec, Guards, Job, Learned, LearnedLimits, Lessons, Limits, ProbingSpec, ProgramEnd,
    Reference, SendWhen, SkipSpec, Teach, WarmthSpec, WitnessSpec, WorkOffset,
};
use umi_protocol::job_error::{Field, JobError};
use umi_protocol::latch::{
    LatchBatch, LatchCause, LatchCounters, LatchReport, LatchStep, Positions, Scan, SignalLevel,
    TriggerOut, TriggerPulse, TriggerRefusal,
};
use umi_protocol::line::{HitReport, LineReport, LineStatus};
use umi_protocol::message::{
    Event, Identity, JobLoss, JournalInfo, LineRefusal, Record, Request, ResetReason, Response,
    Status, TeachBy, TeachPending, TeachRefusal, TeachSetup, TeachWhat,
};
use umi_protocol::pattern::{
    BlockPattern, CheckedPattern, Coding, FieldFormat, Handshake, LinePattern, ReceiverConfig,
    Travel,
};
use umi_protocol::point_sensor::{
    CaptureLoss, CapturedAt, PlaceReport, PlaceState, SensorLoss, SensorOnBoard, SensorRefusal,
    SensorStatus, SensorText, SignalLoss, StationAnswer,
};
use umi_protocol::program::{
    IntegerRule, ProgramInfo, ProgramRefusal, ProgramRoom, Release, RewriteSpec, Stated,
    StatedDialect, UnitRule, Withheld,
};
use umi_protocol::reason::Reason;
use umi_protocol::serial::{Cts, LineFamily, LineSettings, LineSpec};
use umi_protocol::update::{ImageInfo, ImagePlace, UpdateRefusal, UpdateState};
use umi_protocol::verdict::{
    CorrectionReport, DistanceReport, RegistrationReport, SetupReason, Verdict,
};

pub fn request_after(sample: Option<&Request>) -> Option<Request> {
    Some(match sample {
        None => Request::IdentityGet,
        Some(Request::IdentityGet) => Request::StatusGet,
        Some(Request::StatusGet) => Request::JobGet,
        Some(Request::JobGet) => Request::JobCheck(job()),
        Some(Request::JobCheck(_)) => Request::JobSet(job()),
        Some(Request::JobSet(_)) => Request::LiveSet { on: true },
        Some(Request::LiveSet { .. }) => Request::FeatureGet { feature: 2 },
        Some(Request::FeatureGet { .. }) => Request::VerdictGet,
        Some(Request::VerdictGet) => Request::JournalInfo,
        Some(Request::JournalInfo) => Request::JournalRead { seq: 70_000 },
        Some(Request::JournalRead { .. }) => Request::JournalChain { seq: 70_000 },
        Some(Request::JournalChain { .. }) => Request::PositionsGet,
        Some(Request::PositionsGet) => Request::TriggerOutSet(TriggerOut::Distance {
            axis: 2,
            interval_counts: 1000,
            pulse: TriggerPulse {
                width_us: 300,
                rests: SignalLevel::High,
            },
        }),
        Some(Request::TriggerOutSet(_)) => Request::LaserSet { on: true },
        Some(Request::LaserSet { .. }) => Request::ProgramList { skip: 8 },
        Some(Request::ProgramList { .. }) => Request::ProgramBegin(program()),
        Some(Request::ProgramBegin(_)) => Request::ProgramPiece {
            offset: 70_000,
            bytes: list(*b"G1 X0\n"),
        },
        Some(Request::ProgramPiece { .. }) => Request::ProgramEnd {
            number: 1234,
            crc32: 0xCBF4_3926,
        },
        Some(Request::ProgramEnd { .. }) => Request::ProgramRead {
            number: 1234,
            offset: 70_000,
        },
        Some(Request::ProgramRead { .. }) => Request::ProgramDelete { number: 1234 },
        Some(Request::ProgramDelete { .. }) => Request::ProgramReceive,
        Some(Request::ProgramReceive) => Request::ProgramPass(program()),
        Some(Request::ProgramPass(_)) => Request::ProgramPassed {
            offset: 70_000,
            bytes: b"G1 X1.\n".iter().copied().collect(),
        },
        Some(Request::ProgramPassed { .. }) => Request::ProgramOffer { number: 1234 },
        Some(Request::ProgramOffer { .. }) => Request::Teach {
            what: TeachWhat::Again,
        },
        Some(Request::Teach { .. }) => Request::LineListen(Some(LineSettings {
            baud: 4800,
            data_bits: 7,
            stop_bits: 2,
            cts: Cts::Ignored,
        })),
        Some(Request::LineListen(_)) => Request::HeadGet {
            nonce: Some([0x5A; 32]),
        },
        Some(Request::HeadGet { .. }) => Request::JournalAck { seq: 70_000 },
        Some(Request::JournalAck { .. }) => Request::ConfigGet,
        Some(Request::ConfigGet) => Request::ConfigSet(config()),
        Some(Request::ConfigSet(_)) => Request::AccessGet,
        Some(Request::AccessGet) => Request::KeyList,
        Some(Request::KeyList) => Request::KeyEnrol(key_info()),
        Some(Request::KeyEnrol(_)) => Request::KeyRevoke { key_id: KEY_ID },
        Some(Request::KeyRevoke { .. }) => Request::LockSet { locked: true },
        Some(Request::LockSet { .. }) => Request::Wipe,
        Some(Request::Wipe) => Request::SessionBegin(SessionAsk {
            key: [0x21; 32],
            share: [0x22; 32],
        }),
        Some(Request::SessionBegin(_)) => Request::SessionProve {
            signature: [[0x23; 32], [0x24; 32]],
        },
        Some(Request::SessionProve { .. }) => Request::ImageGet,
        Some(Request::ImageGet) => Request::UpdateBegin {
            header: [[0x41; 32]; 6],
        },
        Some(Request::UpdateBegin { .. }) => Request::UpdatePiece {
            offset: 70_000,
            bytes: list(*b"umi"),
        },
        Some(Request::UpdatePiece { .. }) => Request::UpdateEnd,
        Some(Request::UpdateEnd) => Request::HostTime {
            utc_s: 1_795_000_000,
        },
        Some(Request::HostTime { .. }) => Request::SensorSet(Some(point_sensor())),
        Some(Request::SensorSet(_)) => Request::SensorGet,
        Some(Request::SensorGet) => Request::SensorCommand {
            line: b"UMIP S13 K2 C4711".iter().copied().collect(),
        },
        Some(Request::SensorCommand { .. }) => return None,
    })
}

pub fn response_after(sample: Option<&Response>) -> Option<Response> {
    let info = JournalInfo {
        first_seq: 3,
        next_seq: 300,
        acked_seq: 2,
        lost: 1,
    };
    Some(match sample {
        None => Response::Done,
        Some(Response::Done) => Response::Identity(identity()),
        Some(Response::Identity(_)) => Response::Status(status()),
        Some(Response::Status(_)) => Response::Job {
            job: Some(job()),
            taught_mm: Some(list([[1.0, 2.0, 3.0]])),
            learned: lessons(),
        },
        Some(Response::Job { .. }) => Response::JobRefused(JobError::BadValue {
            field: Field::RmsMm,
            feature: Some(text("SPHERE1")),
            value: -0.01,
        }),
        Some(Response::JobRefused(_)) => Response::Feature(Some(feature())),
        Some(Response::Feature(_)) => Response::Verdict(Some(verdict())),
        Some(Response::Verdict(_)) => Response::JournalInfo(info),
        Some(Response::JournalInfo(_)) => Response::JournalEntry {
            seq: 299,
            raw: list([0, 1, 255]),
        },
        Some(Response::JournalEntry { .. }) => Response::JournalNoEntry(info),
        Some(Response::JournalNoEntry(_)) => Response::StorageFailed,
        Some(Response::StorageFailed) => Response::JournalChain {
            seq: 300,
            before: Some(std::array::from_fn(|n| n as u8)),
        },
        Some(Response::JournalChain { .. }) => Response::Positions(Positions {
            counts: list([5, -6, 7]),
            t_ns: 12_000_000_008,
            illegal: list([0, 3, 0]),
            lost_samples: 1,
        }),
        Some(Response::Positions(_)) => Response::NotOnThisBoard,
        Some(Response::NotOnThisBoard) => Response::Programs {
            room: ProgramRoom {
                programs: 2,
                most_programs: 32,
                longest_bytes: 70_000,
                free_bytes: 140_000,
                total_bytes: 4_194_304,
            },
            programs: list([program()]),
        },
        Some(Response::Programs { .. }) => Response::ProgramAt { offset: 70_000 },
        Some(Response::ProgramAt { .. }) => Response::ProgramBytes {
            offset: 70_000,
            bytes: list(*b"M30\n%"),
        },
        Some(Response::ProgramBytes { .. }) => Response::ProgramRefused(ProgramRefusal::Full {
            needed_bytes: 80_000,
            longest_bytes: 70_000,
            free_bytes: 140_000,
        }),
        Some(Response::ProgramRefused(_)) => Response::TeachRefused(TeachRefusal::AlreadyTaught),
        Some(Response::TeachRefused(_)) => Response::LineRefused(LineRefusal::NotOnThisBoard {
            field: Field::LineRtsCts,
        }),
        Some(Response::LineRefused(_)) => Response::Head(HeadAnswer::Signed(head())),
        Some(Response::Head(_)) => {
            Response::TriggerRefused(TriggerRefusal::PulseTooLong { most_us: 380 })
        }
        Some(Response::TriggerRefused(_)) => Response::Config {
            config: config(),
            fallbacks: list([ConfigField::RmsMm]),
        },
        Some(Response::Config { .. }) => Response::ConfigRefused(ConfigField::Full),
        Some(Response::ConfigRefused(_)) => Response::AccessRefused(AccessRefusal::RoleTooLow {
            needs: Role::Owner,
            has: Role::Engineer,
        }),
        Some(Response::AccessRefused(_)) => Response::Access(AccessInfo {
            mode: AccessMode::Locked,
            jumper: Some(true),
            retry_in_s: 60,
            board_key: Some([0x31; 32]),
        }),
        Some(Response::Access(_)) => Response::Keys(list([key_info()])),
        Some(Response::Keys(_)) => Response::SessionChallenge(SessionChallenge {
            challenge: [0x32; 32],
            share: [0x33; 32],
            board_key: [0x31; 32],
        }),
        Some(Response::SessionChallenge(_)) => Response::SessionOpen {
            role: Role::Engineer,
            signature: [[0x34; 32], [0x35; 32]],
        },
        Some(Response::SessionOpen { .. }) => Response::Image(ImageInfo {
            version: [1, 2, 300],
            counter: 7,
            place: ImagePlace::B,
            confirmed: false,
            sha512: Some([[0x42; 32], [0x43; 32]]),
            latest: UpdateState::Trial,
            most_bytes: 65_344,
        }),
        Some(Response::Image(_)) => Response::UpdateAt { offset: 70_000 },
        Some(Response::UpdateAt { .. }) => {
            Response::UpdateRefused(UpdateRefusal::TooLong { most_bytes: 65_344 })
        }
        Some(Response::UpdateRefused(_)) => Response::Sensor(SensorStatus {
            sensor: Some(point_sensor()),
            setup_lost: Some(SensorLoss::Damaged),
            waits: false,
            answer: Some(StationAnswer {
                sequence: 13,
                state: PlaceState::NoSignal(SignalLoss::TooSteep),
                gamma_mm: 44.25,
            }),
            skip: true,
            paired: 400,
            lost: 1,
            unpaired: 2,
            unreadable: 3,
        }),
        Some(Response::Sensor(_)) => Response::SensorRefused(SensorRefusal::Direction),
        Some(Response::SensorRefused(_)) => return None,
    })
}

pub fn event_after(sample: Option<&Event>) -> Option<Event> {
    Some(match sample {
        None => Event::Line(LineReport {
            number: 1,
            byte_offset: 2,
            t_us: 3_000_000,
            status: LineStatus::NotUnderstood,
            text: text("X12.3456"),
        }),
        Some(Event::Line(_)) => Event::Hit(HitReport {
            line: 4,
            t_us: 5_000_000,
            feature: Some(text("SPHERE1")),
            position_mm: [-136.7105, 136.412, 136.1212],
            approach: Some(Approach::MinusZ),
            feed_mm_per_min: Some(50.0),
        }),
        Some(Event::Hit(_)) => Event::Record {
            seq: 6,
            t_us: 7_000_000,
            record: Record::Time,
        },
        Some(Event::Record { .. }) => Event::Latches(LatchBatch {
            first: latch(LatchCause::Trigger),
            steps: list([LatchStep {
                dt_ns: 100_008,
                dcounts: list([5, -5, 0]),
            }]),
        }),
        Some(Event::Latches(_)) => Event::Dropped { count: 8 },
        Some(Event::Dropped { .. }) => return None,
    })
}

pub fn record_after(sample: Option<&Record>) -> Option<Record> {
    Some(match sample {
        None => Record::Boot {
            identity: identity(),
            reset: ResetReason::Watchdog,
        },
        Some(Record::Boot { .. }) => Record::Recovered {
            torn_bytes: 17,
            damaged_entries: 2,
            damaged_headers: 1,
            chain_restarted: true,
        },
        Some(Record::Recovered { .. }) => Record::JobSet {
            job: job(),
            key_id: Some(KEY_ID),
        },
        Some(Record::JobSet { .. }) => Record::ReferenceRestored {
            positions_mm: list([[1.0, 2.0, 3.0], [-4.0, 5.5, 0.0]]),
            learned: Lessons::NONE,
        },
        Some(Record::ReferenceRestored { .. }) => Record::Bytes {
            raw: list([0x12, 0x0D, 0x8A, 0x00]),
        },
        Some(Record::Bytes { .. }) => Record::BytesLost { count: 128 },
        Some(Record::BytesLost { .. }) => Record::Time,
        Some(Record::Time) => Record::InputEnd,
        Some(Record::InputEnd) => Record::Fault(fault()),
        Some(Record::Fault(_)) => Record::Feature(feature()),
        Some(Record::Feature(_)) => Record::Verdict(verdict()),
        Some(Record::Verdict(_)) => Record::Taught {
            positions_mm: list([[0.25, -0.5, 1e3]]),
            learned: lessons(),
        },
        Some(Record::Taught { .. }) => Record::CorrectionSent {
            setup: 1,
            bytes: 345,
            complete: true,
        },
        Some(Record::CorrectionSent { .. }) => Record::Latch(latch(LatchCause::Skip)),
        Some(Record::Latch(_)) => Record::Scan(Scan {
            cause: LatchCause::Output,
            captured: 100_000,
            missed: 1,
            untold: 2,
            first: 7,
            from_ns: 1_000_000_000,
            to_ns: 11_000_000_000,
        }),
        Some(Record::Scan(_)) => Record::ProgramKept {
            program: program(),
            key_id: None,
        },
        Some(Record::ProgramKept { .. }) => Record::ProgramDeleted {
            number: 1234,
            crc32: 0xCBF4_3926,
            key_id: Some(KEY_ID),
        },
        Some(Record::ProgramDeleted { .. }) => Record::AlarmSent {
            run: Some(7),
            number: 9010,
            why: Withheld::NotRewritable {
                line: 12,
                column: 5,
            },
            bytes: 119,
            complete: true,
        },
        Some(Record::AlarmSent { .. }) => Record::ProgramSent {
            number: 1234,
            crc32: 0xCBF4_3926,
            rewritten_for: Some(3),
            bytes: 123_456,
            complete: true,
        },
        Some(Record::ProgramSent { .. }) => Record::ProgramNotKept {
            number: 1234,
            why: ProgramRefusal::OtherThere { crc32: 0xCBF4_3926 },
        },
        Some(Record::ProgramNotKept { .. }) => Record::CorrectionBegun { setup: 1 },
        Some(Record::CorrectionBegun { .. }) => Record::ProgramBegun {
            number: 1234,
            crc32: 0xCBF4_3926,
            rewritten_for: Some(3),
        },
        Some(Record::ProgramBegun { .. }) => Record::TeachAsked {
            more: true,
            keep: false,
        },
        Some(Record::TeachAsked { .. }) => Record::JobLost {
            why: JobLoss::OtherSchema,
        },
        Some(Record::JobLost { .. }) => Record::Head(head()),
        Some(Record::Head(_)) => Record::ButtonHeld {
            refused: Some(TeachRefusal::UnderWay),
        },
        Some(Record::ButtonHeld { .. }) => Record::FaultsAgain {
            latest: fault(),
            count: 57,
        },
        Some(Record::FaultsAgain { .. }) => Record::Acknowledged {
            seq: 70_000,
            lost: 12,
        },
        Some(Record::Acknowledged { .. }) => Record::ConfigSet(config()),
        Some(Record::ConfigSet(_)) => Record::LastRun { run: 1234 },
        Some(Record::LastRun { .. }) => Record::Access {
            what: AccessChange::Enrolled,
            key_id: KEY_ID,
            role: Role::Owner,
            by: None,
        },
        Some(Record::Access { .. }) => Record::AccessRefused {
            why: AccessRefusal::TooManyTries { retry_in_s: 60 },
            count: 12,
            key_id: Some(KEY_ID),
        },
        Some(Record::AccessRefused { .. }) => Record::Wiped {
            first_seq: 3,
            next_seq: 300,
            chain: [0x5B; 32],
            key_id: Some(KEY_ID),
        },
        Some(Record::Wiped { .. }) => Record::Update {
            what: UpdateState::Reverted,
            from: [1, 2, 300],
            to: [1, 3, 0],
        },
        Some(Record::Update { .. }) => Record::HostTime {
            utc_s: 1_795_000_000,
            key_id: Some(KEY_ID),
        },
        Some(Record::HostTime { .. }) => Record::SensorSet {
            sensor: Some(point_sensor()),
            key_id: Some(KEY_ID),
        },
        Some(Record::SensorSet { .. }) => Record::Place(PlaceReport {
            number: 6560,
            state: PlaceState::Ok,
            axes_mm: [1.5, -2.5, 164.0],
            gamma_mm: 44.25,
            spread_mm: 0.001,
            captures: 400,
            outliers: 2,
            lost: 0,
            snr: 87.5,
            total: 3391.0,
            point_mm: Some([1.25, -2.75, 0.5]),
        }),
        Some(Record::Place(_)) => Record::CaptureLost(CaptureLoss::Latch { latch: 17 }),
        Some(Record::CaptureLost(_)) => return None,
    })
}

/// A distance sensor.
fn point_sensor() -> SensorOnBoard {
    SensorOnBoard {
        offset_mm: [0.25, -0.5, -164.0],
        direction: [0.0, 0.0, -1.0],
        gain: 1.0,
        counts_per_mm: [1000.0, 1000.0, -2000.0],
        origin_counts: [10, -20, 30],
        max_rate_hz: 9000.0,
        power_max: 5000.0,
        baud: 921_600,
        text: SensorText::default(),
        captured_at: CapturedAt::Sync,
        pulse: TriggerPulse::default(),
    }
}

const KEY_ID: KeyId = [1, 2, 3, 4, 5, 6, 7, 8];

fn key_info() -> KeyInfo {
    KeyInfo {
        public: [0x21; 32],
        role: Role::Engineer,
        name: KeyName::try_from("Anna").unwrap(),
    }
}

fn lessons() -> Lessons {
    let learned = |more: f64| Learned {
        radius_mm: 12.7 + more,
        rms_mm: 0.001 + more,
        centring_mm: 0.002 + more,
    };
    Lessons {
        smallest: list([learned(0.0)]),
        largest: list([learned(0.0005)]),
        further: 2,
        tool_length_mm: Some(81.5),
        feed_mm_per_min: 50.0,
        doubt: Doubt::Again,
        run: 7,
        asked_in: 6,
    }
}

fn fault() -> Fault {
    Fault {
        kind: FaultKind::BadCheckValue {
            printed: 1234,
            computed: 1243,
        },
        line: 9,
        byte_offset: 1000,
        t_us: 10_000_000,
        text: text("1 2 3"),
    }
}

fn config() -> BoardConfig {
    BoardConfig {
        ceilings: Ceilings {
            rms_mm: Some(0.01),
            always: false,
            ..Ceilings::default()
        },
        journal: JournalConfig {
            full: WhenFull::Refuse,
        },
        access: AccessConfig {
            locked_reading: LockedReading::Nobody,
            session_idle_s: Some(600),
            button_off: true,
        },
    }
}

fn head() -> Head {
    Head {
        seq: 4096,
        t_us: 1_234_567,
        first_seq: 17,
        chain: [0xC1; 32],
        boot: 3,
        key: [0xA1; 32],
        image: [0; 32],
        serial: name("0042"),
        firmware: name("0.1.0"),
        nonce: Some([0x5A; 32]),
        signature: [[0x51; 32], [0x52; 32]],
        evidence: Some(EvidenceMark {
            first: 3,
            first_seq: 17,
            first_chain: [0xE1; 32],
            next: 40,
            chain: [0xE2; 32],
        }),
    }
}

fn program() -> ProgramInfo {
    ProgramInfo {
        number: 1234,
        name: text("POCKET"),
        bytes: 123_456,
        crc32: 0xCBF4_3926,
        release: Release::Rewritten(RewriteSpec {
            decimals_mm: 3,
            chord_um: 10,
            clearance_um: 1000,
            integers: IntegerRule::Units,
            unit: UnitRule::Said,
        }),
        hold_s: 600,
        stated: Stated {
            start_packed: 16_380,
            dialect: StatedDialect::Fanuc,
            allow_call: 9010,
        },
    }
}

/// The greetings of a host and of a board of some versions. The layout is
/// frozen, so their bytes may never change.
pub fn hellos() -> [Hello; 2] {
    [
        Hello::of(Version { major: 1, minor: 2 }, u64::MAX, "umi 0.1.0"),
        Hello::of(
            Version { major: 3, minor: 4 },
            0x0123_4567_89AB_CDEF,
            "virtual 0001 0.1.0",
        ),
    ]
}

fn text<const N: usize, L: heapless::LenType>(text: &str) -> String<N, L> {
    let mut out = String::new();
    out.push_str(text).expect("a sample fits");
    out
}

fn list<T, const N: usize, L: heapless::LenType>(
    items: impl IntoIterator<Item = T>,
) -> Vec<T, N, L> {
    items.into_iter().collect()
}

fn identity() -> Identity {
    Identity {
        board: text("virtual"),
        serial: text("0001"),
        firmware: text("0.1.0"),
    }
}

fn job() -> Job {
    Job {
        name: text("PLATE"),
        reference: Reference::Taught,
        plate_timeout_s: 600,
        receiver: ReceiverConfig {
            coding: Coding::IsoEven,
            patterns: list([
                LinePattern::Block(BlockPattern::default()),
                LinePattern::GrblProbe,
                LinePattern::Checked(CheckedPattern {
                    format: FieldFormat::F53,
                }),
            ]),
            travel_mm: Some(Travel {
                x: [-400.0, 0.0],
                y: [0.0, 300.0],
                z: [-1.5, 1.5],
            }),
            idle_timeout_s: 120,
            handshake: Handshake::XonXoff,
        },
        features: list([FeatureSpec {
            name: text("SPHERE1"),
            id: Some(1),
            kind: FeatureKind::Sphere,
            hits: 5,
            position_mm: Some([10.0, 20.0, 30.0]),
            radius_mm: Some(12.7),
            approach: list([
                Approach::PlusX,
                Approach::MinusX,
                Approach::PlusY,
                Approach::MinusY,
                Approach::MinusZ,
            ]),
            datum: true,
        }]),
        compensation: Compensation::OnBoard {
            tip_radius_mm: 2.0,
            pretravel_mm: [0.01, 0.02, 0.03],
        },
        limits: Limits {
            radius_error_mm: 0.05,
            rms_mm: 0.02,
            approach_deg: Some(15.0),
            lone_hit_mm: Some(0.02),
            distance_error_mm: 0.03,
            registration_rms_mm: 0.04,
            rotation_deg: 5.0,
            tilt_deg: 0.1,
            shift_mm: [10.0, 11.0, 12.0],
            expected_error_mm: None,
        },
        correction: Some(CorrectionSpec {
            dialect: Dialect::G10G68,
            probed_in: WorkOffset::G54,
            probed_origin_mm: [-300.0, -200.0, -100.0],
            write_to: WorkOffset::G59,
            set: None,
            program_number: 9001,
            ends_with: ProgramEnd::M99,
            part_min_mm: [0.0, 0.0, -20.0],
            part_max_mm: [100.0, 80.0, 0.0],
            leftover_mm: 0.01,
            send: SendWhen::OnRequest,
        }),
        witness: Some(WitnessSpec {
            counts_per_mm: [10_000.0, -10_000.0, 1000.0],
            origin_counts: None,
            feed_mm_per_min: Some(30.0),
            delay_ms: 4.0,
            tolerance_mm: 0.002,
        }),
        teach: Teach::Asked,
        guards: Guards {
            closing: list([Closing {
                feature: text("CLOSING"),
                repeats: text("SPHERE1"),
                within_mm: 0.004,
            }]),
            fixed: list([text("TABLE")]),
            fixed_mm: Some(0.005),
            nominal_distance_mm: Some(0.02),
            learned: Some(LearnedLimits {
                radius_mm: 0.001,
                rms_mm: 0.002,
                centring_mm: 0.003,
            }),
            probing: Some(ProbingSpec {
                sigma_mm: [0.001, 0.002, 0.003],
                dof: 19,
            }),
            warmth: Some(WarmthSpec {
                expansion_ppm_per_k: 11.5,
                at_most_k: 5.0,
            }),
            run_variable: Some(531),
            frame: true,
            external_mm: [0.5, 0.0, -0.25],
            tool_length_mm: Some(81.5),
        },
        line: LineSpec {
            control: LineFamily::Fanuc,
            baud: Some(9600),
            data_bits: None,
            stop_bits: Some(1),
            rts_cts: Some(true),
        },
        skip: SkipSpec {
            active: SignalLevel::Low,
            min_width_us: Some(8),
            hold_off_ms: None,
            delay_us: 12.5,
            each_hit: true,
        },
        again: Some(AgainSpec { within_mm: 0.008 }),
    }
}

fn latch(cause: LatchCause) -> LatchReport {
    LatchReport {
        number: 5,
        cause,
        counts: list([-1, 0, 1_000_000]),
        t_ns: 11_000_000_008,
        missed: 2,
    }
}

fn status() -> Status {
    let mut counters = Counters {
        bytes: 1_000_000,
        lines: 2000,
        hits: 15,
        ..Counters::default()
    };
    counters.count(FaultCode::BadParity);
    Status {
        uptime_us: 86_400_000_000,
        reset: ResetReason::PowerOn,
        job: Some(text("PLATE")),
        job_lost: Some(JobLoss::Damaged),
        has_reference: true,
        teaching: Some(TeachPending {
            by: TeachBy::Line,
            what: TeachWhat::Again,
            t_us: 3_000_000,
            setup: TeachSetup::Refused { setup: 2 },
        }),
        verdicts: 3,
        verdicts_ok: 2,
        last_verdict_ok: Some(false),
        correction_waiting: true,
        punched_lines: Some(40),
        counters,
        events_dropped: 4,
        journal_failures: 0,
        link_damaged: 9,
        latches: LatchCounters {
            skips: 1,
            triggers: 2,
            outputs: 3,
            indices: 4,
            missed: 5,
            untold: 6,
        },
        access: AccessMode::Open,
    }
}

fn feature() -> FeatureResult {
    FeatureResult {
        index: 7,
        setup: 2,
        name: text("SPHERE1"),
        kind: FeatureKind::Sphere,
        reasons: list([Reason::RadiusError {
            error_mm: 0.06,
            limit_mm: 0.05,
        }]),
        points_mm: list([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
        fit: Some(FitReport {
            shape: Shape::Sphere {
                center_mm: [-136.7105, 136.412, 136.1212],
                radius_mm: 12.7118,
                cov_unit: [[0.5, 0.0, 0.0, 0.25]; 4],
            },
            dof: 1,
            rms_mm: 0.0065,
            sigma_mm: Some(0.0145),
            residuals_mm: list([0.001, -0.001]),
        }),
    }
}

fn verdict() -> Verdict {
    Verdict {
        setup: 2,
        ok: false,
        reasons: list([SetupReason {
            feature: None,
            reason: Reason::DistanceError {
                a: text("SPHERE1"),
                b: text("SPHERE2"),
                error_mm: 0.18,
                limit_mm: 0.03,
            },
        }]),
        reasons_dropped: 1,
        remarks: list([SetupReason {
            feature: Some(text("SPHERE3")),
            reason: Reason::Taught,
        }]),
        distances: list([DistanceReport {
            a: text("SPHERE1"),
            b: text("SPHERE2"),
            measured_mm: 254.18,
            reference_mm: Some(254.0),
        }]),
        registration: Some(RegistrationReport {
            rotation: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            translation_mm: [10.0, -20.0, 0.5],
            angle_deg: 90.0,
            axis: [0.0, 0.0, 1.0],
            dof: 3,
            rms_mm: 0.004,
            sigma_mm: Some(0.007),
            residuals_mm: list([[0.001, 0.002, -0.003]]),
            cov_unit_rotvec: [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]],
            cov_unit_t: [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9]],
            expected_error_mm: Some(0.009),
        }),
        correction: Some(CorrectionReport {
            dialect: Dialect::G10G68,
            text: text("%\nO9001\nG10 L2 P6 X-310. Y-180. Z-100.5\nM99\n%\n"),
            leftover_mm: 0.0,
        }),
    }
}
