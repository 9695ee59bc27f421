//! Storage that cannot be opened: the board runs and answers, keeps nothing, says so,
//! and sends no correction.

use std::time::{Duration, Instant};

use umi_client::board::link::{Client, LinkError};
use umi_client::programs;
use umi_core::journal::{Flash as _, Journal, MAX_PAYLOAD};
use umi_core::units::Micros;
use umi_protocol::job::{Job, LearnedLimits};
use umi_protocol::latch::TriggerPulse;
use umi_protocol::message::{JobLoss, Record, Status, TeachRefusal, TeachWhat};
use umi_protocol::pattern::Coding;
use umi_protocol::point_sensor::{CaptureLoss, CapturedAt, SensorLoss, SensorOnBoard, SensorText};
use umi_protocol::program::{ProgramInfo, Release, Stated, Withheld};
use umi_tests::cases::{SESSION, clamping, job, journal};
use umi_virtual::board::{JOURNAL, SETTINGS};
use umi_virtual::{Config, VirtualBoard, VirtualFlash};

/// The key of all messages of protocol 2.23, and the kinds of its entries: they are read.
const KEY: u64 = 0x0f10_eca6_dbb0_0604;
/// Of a job's.
const KIND: u8 = 1;
/// Of a sensor's.
const SENSOR: u8 = 2;

/// Flash that holds something which is not a journal.
fn foreign(geometry: umi_core::journal::Geometry) -> VirtualFlash {
    let mut flash = VirtualFlash::in_memory(geometry);
    for sector in 0..u32::from(geometry.sectors) {
        let at = sector * geometry.sector_size;
        flash.program(at, &[b'?'; 256]).unwrap();
    }
    flash
}

fn start(config: &Config) -> (VirtualBoard, Client) {
    let board = VirtualBoard::start(config.clone()).unwrap();
    let client = umi_desk::client(&board).unwrap();
    (board, client)
}

/// The status once this many verdicts are out.
fn after_verdicts(client: &mut Client, verdicts: u32) -> Status {
    let begun = Instant::now();
    loop {
        let status = client.status().unwrap();
        if status.verdicts >= verdicts {
            return status;
        }
        assert!(begun.elapsed() < Duration::from_secs(20), "{status:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Without a journal: measured and judged by the job that was kept before, but every
/// entry is counted as refused, no job is taken, and READ gets an alarm; a program that needs
/// no verdict does not go out, either.
#[test]
fn without_a_journal_nothing_is_sent() {
    let config = Config::default();
    let (board, mut client) = start(&config);
    client.set_job(&job()).unwrap().unwrap();
    let text = "%\nO0009\nM30\n%\n";
    let program = ProgramInfo {
        number: 9,
        name: "PROBE".parse().unwrap(),
        bytes: u32::try_from(text.len()).unwrap(),
        crc32: programs::check_value(text.as_bytes()),
        release: Release::Always,
        hold_s: 5,
        stated: Stated::default(),
    };
    programs::put(&mut client, &program, text.as_bytes(), |_| {}).unwrap();
    drop((board, client));

    let config = Config {
        journal: foreign(JOURNAL),
        ..config
    };
    let (board, mut client) = start(&config);
    let before = client.status().unwrap();
    assert_eq!(before.job, Some(job().name));
    assert!(before.journal_failures > 0, "{before:?}");
    board.control_sends(SESSION.as_bytes());
    let after = after_verdicts(&mut client, 5);
    assert_eq!(after.verdicts_ok, 5);
    assert!(after.journal_failures > before.journal_failures);
    assert!(!after.correction_waiting);
    assert!(board.lights().trouble);
    board.control_sends(&[0x11]);
    let alarm = umi_core::correction::alarm(
        &job().correction.unwrap(),
        &Withheld::NoVerdict,
        None,
        Coding::Ascii,
    )
    .unwrap();
    let patience = Duration::from_secs(5);
    let program = alarm.bytes().map(|_| board.control_receives(patience));
    assert!(program.eq(alarm.bytes().map(Some)));
    assert_eq!(board.control_receives(Duration::from_millis(100)), None);
    board.control_sends(b"READ O9\r\n\x11");
    let alarm = umi_core::correction::withheld(9, &Withheld::NotJournaled, Coding::Ascii);
    let came = alarm.bytes().map(|_| board.control_receives(patience));
    assert!(came.eq(alarm.bytes().map(Some)));
    assert_eq!(board.control_receives(Duration::from_millis(100)), None);

    for refused in [
        client.set_job(&job()).map(|_| ()),
        client.journal_info().map(|_| ()),
        client.journal_read(0).map(|_| ()),
        client.journal_chain(0).map(|_| ()),
    ] {
        let error = refused.unwrap_err();
        assert!(matches!(error, LinkError::StorageFailed), "{error}");
    }
    assert_eq!(client.job().unwrap().job, Some(job()));
}

/// Without settings: the journal takes everything in, but no job can be set, for it
/// would not survive a power cut.
#[test]
fn without_settings_no_job_is_taken() {
    let config = Config {
        settings: foreign(SETTINGS),
        ..Config::default()
    };
    let (board, mut client) = start(&config);
    let status = client.status().unwrap();
    assert_eq!((status.job, status.journal_failures), (None, 1));
    assert_eq!(status.job_lost, Some(JobLoss::Storage));
    let begun = client.journal_info().unwrap().next_seq;
    let error = client.set_job(&job()).unwrap_err();
    assert!(matches!(error, LinkError::StorageFailed), "{error}");
    assert_eq!(client.job().unwrap().job, None);
    board.control_sends(b"POINT: 1.0000\r\n");
    while client.journal_info().unwrap().next_seq == begun {
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(board.lights().trouble);
}

/// What a board's journal says about the job since its latest start.
fn settings_since_start(journal: &VirtualFlash) -> Vec<Record> {
    let (mut journal, _) = Journal::open(journal.clone()).unwrap();
    let mut records = Vec::new();
    for seq in journal.first_seq()..journal.next_seq() {
        let mut payload = [0; MAX_PAYLOAD];
        let entry = journal.read(seq, &mut payload).unwrap().entry;
        match postcard::from_bytes(entry.payload).unwrap() {
            Record::Boot { .. } => records.clear(),
            record @ (Record::JobSet { .. }
            | Record::JobLost { .. }
            | Record::SensorSet { .. }
            | Record::CaptureLost(_)) => records.push(record),
            _ => {}
        }
    }
    records
}

/// Settings whose only entry is this.
fn settings_of(kind: u8, payload: &[u8]) -> VirtualFlash {
    let flash = VirtualFlash::in_memory(SETTINGS);
    let (mut journal, _) = Journal::open(flash.clone()).unwrap();
    journal.append(kind, Micros(0), payload).unwrap();
    flash
}

/// Flash after a power cut: of what was programmed between two states, so many bytes are there.
fn cut(before: &VirtualFlash, after: &VirtualFlash, bytes: usize) -> VirtualFlash {
    let size = usize::from(SETTINGS.sectors) * SETTINGS.sector_size as usize;
    let read = |flash: &VirtualFlash| {
        let mut cells = vec![0; size];
        flash.clone().read(0, &mut cells).unwrap();
        cells
    };
    let (before, after) = (read(before), read(after));
    let mut flash = VirtualFlash::in_memory(SETTINGS);
    let mut left = bytes;
    for (at, (old, new)) in before.iter().zip(&after).enumerate() {
        let is_there = old == new || left > 0;
        left -= usize::from(old != new && left > 0);
        let byte = if is_there { *new } else { *old };
        flash.program(u32::try_from(at).unwrap(), &[byte]).unwrap();
    }
    flash
}

/// A board that comes up without a job says why, in its status and in its journal: none was
/// ever kept, another firmware kept it, it is damaged, it would not be taken any more. The next
/// job ends that.
#[test]
fn a_lost_job_is_told_by_its_reason() {
    let config = Config::default();
    let (board, mut client) = start(&config);
    assert_eq!(client.status().unwrap().job_lost, Some(JobLoss::Absent));
    drop((board, client));
    assert_eq!(
        settings_since_start(&config.journal),
        [],
        "a new board has lost none"
    );

    let payload = |key: u64, job: &Job| {
        let taught = None::<()>;
        let mut bytes = [0; MAX_PAYLOAD];
        postcard::to_slice(&(key, job, taught), &mut bytes)
            .unwrap()
            .to_vec()
    };
    let refused = Job {
        features: heapless::Vec::new(),
        ..job()
    };
    let mut cases = vec![
        (VirtualFlash::in_memory(SETTINGS), JobLoss::Absent),
        (
            settings_of(KIND, &payload(KEY ^ 1, &job())),
            JobLoss::OtherSchema,
        ),
        (settings_of(3, &payload(KEY, &job())), JobLoss::OtherSchema),
        (
            settings_of(KIND, &payload(KEY, &job())[..40]),
            JobLoss::Damaged,
        ),
        (settings_of(KIND, &payload(KEY, &refused)), JobLoss::Refused),
        (foreign(SETTINGS), JobLoss::Storage),
    ];
    let whole = settings_of(KIND, &payload(KEY, &job()));
    let torn = cut(&VirtualFlash::in_memory(SETTINGS), &whole, 200);
    cases.push((torn, JobLoss::Damaged));
    for (settings, why) in cases {
        let config = Config {
            settings,
            ..config.clone()
        };
        let (board, mut client) = start(&config);
        let status = client.status().unwrap();
        assert_eq!((status.job, status.job_lost), (None, Some(why)));
        assert_eq!(client.job().unwrap().job, None);
        if why != JobLoss::Storage {
            client.set_job(&job()).unwrap().unwrap();
            assert_eq!(client.status().unwrap().job_lost, None);
        }
        drop((board, client));
        let told = settings_since_start(&config.journal);
        assert_eq!(told.first(), Some(&Record::JobLost { why }), "{why:?}");
    }
}

fn sensor() -> SensorOnBoard {
    SensorOnBoard {
        offset_mm: [1.0, -1.0, -100.0],
        direction: [0.0, 0.0, -1.0],
        gain: 1.0,
        counts_per_mm: [1000.0; 3],
        origin_counts: [0; 3],
        max_rate_hz: 9000.0,
        power_max: 5000.0,
        baud: 921_600,
        text: SensorText::default(),
        captured_at: CapturedAt::Sync,
        pulse: TriggerPulse::default(),
    }
}

/// A distance sensor that was set up and is not in force after the start is told by its reason, to
/// the host and in the journal: another firmware kept it, it is damaged, it would not be taken any
/// more. Setting one up ends that; where none was, or it was taken away, nothing is told.
#[test]
fn a_lost_sensor_is_told_by_its_reason() {
    let payload = |key: u64, sensor: Option<SensorOnBoard>| {
        let mut bytes = [0; MAX_PAYLOAD];
        postcard::to_slice(&(key, sensor), &mut bytes)
            .unwrap()
            .to_vec()
    };
    let refused = SensorOnBoard {
        gain: 3.0,
        ..sensor()
    };
    let whole = payload(KEY, Some(sensor()));
    let other = payload(KEY ^ 1, Some(sensor()));
    let cases = [
        (Some(&whole[..]), Ok(Some(sensor()))),
        (Some(&payload(KEY, None)[..]), Ok(None)),
        (None, Ok(None)),
        (Some(&other[..]), Err(SensorLoss::OtherSchema)),
        (Some(&whole[..30]), Err(SensorLoss::Damaged)),
        (Some(&whole[..3]), Err(SensorLoss::Damaged)),
        (
            Some(&payload(KEY, Some(refused))[..]),
            Err(SensorLoss::Refused),
        ),
    ];
    for (kept, expected) in cases {
        let config = Config {
            settings: match kept {
                Some(kept) => settings_of(SENSOR, kept),
                None => VirtualFlash::in_memory(SETTINGS),
            },
            ..Config::default()
        };
        let (board, mut client) = start(&config);
        let status = client.sensor().unwrap().unwrap();
        assert_eq!(status.sensor, expected.unwrap_or(None));
        assert_eq!(status.setup_lost, expected.err());
        client.set_sensor(Some(sensor())).unwrap();
        let status = client.sensor().unwrap().unwrap();
        assert_eq!((status.sensor, status.setup_lost), (Some(sensor()), None));
        drop((board, client));
        let told = settings_since_start(&config.journal);
        let first = told
            .iter()
            .find(|record| !matches!(record, Record::JobLost { .. }));
        let set = Record::SensorSet {
            sensor: Some(sensor()),
            key_id: None,
        };
        let lost = expected.err().map(CaptureLoss::Setup);
        assert_eq!(first, Some(&lost.map_or(set, Record::CaptureLost)));
    }
}

/// A power cut at any byte of a new job leaves the job before it in force, or the new one, and
/// nothing is told as lost.
#[test]
fn a_power_cut_in_the_settings_leaves_one_of_both_jobs() {
    let config = Config::default();
    let (board, mut client) = start(&config);
    client.set_job(&job()).unwrap().unwrap();
    drop((board, client));
    let whole = |flash: &VirtualFlash| cut(&VirtualFlash::in_memory(SETTINGS), flash, usize::MAX);
    let before = whole(&config.settings);
    let other = Job {
        name: "OTHER".parse().unwrap(),
        ..job()
    };
    let (board, mut client) = start(&config);
    client.set_job(&other).unwrap().unwrap();
    drop((board, client));
    let after = whole(&config.settings);

    let mut seen = [0; 2];
    for bytes in (0..2000).step_by(37) {
        let config = Config {
            settings: cut(&before, &after, bytes),
            ..Config::default()
        };
        let (board, mut client) = start(&config);
        let status = client.status().unwrap();
        assert_eq!(status.job_lost, None, "{bytes} bytes");
        seen[usize::from(status.job == Some(other.name.clone()))] += 1;
        assert!([job().name, other.name.clone()].contains(&status.job.unwrap()));
        drop((board, client));
        let told = settings_since_start(&config.journal);
        assert!(matches!(told[..], [Record::JobSet { .. }]), "{bytes} bytes");
    }
    assert!(seen[0] > 3 && seen[1] > 3, "{seen:?}");
}

/// What further clampings have taught is in the settings and in the journal: it holds after a
/// restart, and a replay comes to the same.
#[test]
fn what_was_taught_more_is_kept() {
    let mut learning = job();
    learning.guards.learned = Some(LearnedLimits {
        radius_mm: 0.003,
        rms_mm: 0.002,
        centring_mm: 0.004,
    });
    let config = Config::default();
    let (board, mut client) = start(&config);
    client.set_job(&learning).unwrap().unwrap();
    let refused = client.teach(TeachWhat::More).unwrap();
    assert_eq!(refused, Err(TeachRefusal::NotTaught));
    board.control_sends(clamping(0).as_bytes());
    assert_eq!(after_verdicts(&mut client, 1).verdicts_ok, 1);
    let first = client.job().unwrap();
    for (number, further) in [(1, 1), (2, 2)] {
        client.teach(TeachWhat::More).unwrap().unwrap();
        board.control_sends(clamping(number).as_bytes());
        after_verdicts(&mut client, 1 + further);
        let learned = client.job().unwrap().learned;
        assert_eq!(u32::from(learned.further), further);
    }
    let taught = client.job().unwrap();
    assert_eq!(taught.taught_mm, first.taught_mm);
    assert_ne!(taught.learned.largest, taught.learned.smallest);
    drop((board, client));

    let (board, mut client) = start(&config);
    assert_eq!(client.job().unwrap(), taught);
    board.control_sends(clamping(3).as_bytes());
    assert_eq!(after_verdicts(&mut client, 1).verdicts_ok, 1);
    let (records, findings) = journal(&mut client);
    assert!(records.contains(&Record::TeachAsked {
        more: true,
        keep: false
    }));
    assert_eq!(findings.differences, []);
}
