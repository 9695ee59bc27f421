//! Storage that cannot be opened: the board runs and answers, keeps nothing, says so,
//! and sends no correction.

use std::time::{Duration, Instant};

use umi::link::{Client, LinkError};
use umi::programs;
use umi_core::journal::Flash as _;
use umi_protocol::message::Status;
use umi_protocol::pattern::Coding;
use umi_protocol::program::{ProgramInfo, Release, Withheld};
use umi_tests::cases::{SESSION, job};
use umi_virtual::board::{JOURNAL, SETTINGS};
use umi_virtual::{Config, VirtualBoard, VirtualFlash};

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
    let client = Client::new(Box::new(board.connect())).unwrap();
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
    let alarm = umi_core::nc::alarm(&job().correction.unwrap(), Coding::Ascii).unwrap();
    let patience = Duration::from_secs(5);
    let program = alarm.bytes().map(|_| board.control_receives(patience));
    assert!(program.eq(alarm.bytes().map(Some)));
    assert_eq!(board.control_receives(Duration::from_millis(100)), None);
    board.control_sends(b"READ O9\r\n\x11");
    let alarm = umi_core::nc::withheld(9, &Withheld::NotJournaled, Coding::Ascii);
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
