//! Noise costs no evidence: on the line and at the host's port, whatever it overwrites.

use std::time::{Duration, Instant};

use umi_client::board::link::{Acknowledged, Client, LinkError};
use umi_client::journal::verify::verify;
use umi_client::journal::{self, FileItem, PullRequest, PullStep, Pulled};
use umi_client::problem::Problem;
use umi_client::programs;
use umi_core::journal::{Flash as _, Geometry};
use umi_protocol::config::{BoardConfig, JournalConfig, WhenFull};
use umi_protocol::message::{Record, TeachWhat};
use umi_protocol::program::{ProgramInfo, ProgramRefusal, Release, Stated};
use umi_tests::cases::{DC1, clamping, job};
use umi_virtual::board::KEY;
use umi_virtual::{BoardTime, Config, VirtualBoard, VirtualFlash};

/// A journal of 64 KB, so that a lap is short.
const SMALL: Geometry = Geometry {
    sectors: 4,
    sector_size: 16_384,
    write_size: 1,
    page_size: 256,
};

/// Entries that are more than a lap of it, however short they are.
const LAP: u64 = 4 * 16_384 / 40;

fn config() -> Config {
    Config {
        time: BoardTime::Real,
        key: Some(VirtualFlash::in_memory(KEY)),
        journal: VirtualFlash::in_memory(SMALL),
        ..Config::default()
    }
}

fn start(config: &Config) -> (VirtualBoard, Client) {
    let board = VirtualBoard::start(config.clone()).unwrap();
    let client = umi_desk::client(&board).unwrap();
    (board, client)
}

/// Waits until it is so.
fn until(mut is_so: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !is_so() {
        assert!(begun.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The control prints a clamping and reads what comes of it.
fn cut(board: &VirtualBoard, client: &mut Client, case: usize) -> Vec<u8> {
    let verdicts = client.status().unwrap().verdicts;
    board.control_sends(clamping(case).as_bytes());
    until(|| client.status().unwrap().verdicts > verdicts);
    board.control_sends(DC1);
    let mut read = Vec::new();
    // A program stands between two of these; a busy machine may pause within it.
    let mut ends = 0;
    let mut patience = Duration::from_secs(5);
    while let Some(byte) = board.control_receives(patience) {
        read.push(byte);
        ends += u32::from(byte == b'%');
        patience = match ends {
            0 | 1 => Duration::from_secs(5),
            _ => Duration::from_millis(50),
        };
    }
    read
}

fn pulled(client: &mut Client) -> (Vec<u8>, Pulled) {
    pulled_as(
        client,
        PullRequest {
            head: true,
            ..PullRequest::default()
        },
    )
}

fn pulled_as(client: &mut Client, wanted: PullRequest) -> (Vec<u8>, Pulled) {
    let mut items = Vec::new();
    let pulled = journal::pull(client, wanted, |step| {
        match step {
            PullStep::Header(..) => {}
            PullStep::Gap(gap) => items.extend(gap.encode()),
            PullStep::Entry(_, raw) => items.extend(raw),
        }
        Ok::<_, Problem>(())
    })
    .unwrap();
    ([&pulled.header.encode()[..], &items].concat(), pulled)
}

/// The evidence in a file: number and record.
fn evidence(file: &[u8]) -> Vec<(u64, Record)> {
    let mut found = Vec::new();
    journal::read::<Problem>(file, |item| {
        if let FileItem::Entry(entry) = item
            && Record::is_evidence(entry.kind)
        {
            found.push((entry.seq, journal::record(&entry).unwrap()));
        }
        Ok(())
    })
    .unwrap();
    found
}

/// Ten laps of noise on the line, garbage and the same job again and again at the host's port:
/// every verdict, correction, job, start and head is still there, and the file is the board's
/// word, also over a restart in the middle.
#[test]
fn ten_laps_of_noise_cost_no_evidence() {
    let config = config();
    let (board, mut client) = start(&config);
    client.set_job(&job()).unwrap().unwrap();
    cut(&board, &mut client, 0);
    assert!(!cut(&board, &mut client, 1).is_empty());
    let (file, _) = pulled(&mut client);
    let before = evidence(&file);
    let count = |of: fn(&Record) -> bool| before.iter().filter(|(_, record)| of(record)).count();
    assert_eq!(count(|of| matches!(of, Record::Verdict(_))), 2);
    assert_eq!(count(|of| matches!(of, Record::CorrectionSent { .. })), 1);
    assert!(count(|of| matches!(of, Record::Head(_))) >= 1);
    drop((board, client));

    let (mut board, mut client) = start(&config);
    let begun = client.journal_info().unwrap().next_seq;
    let mut turn = 0_u64;
    while client.journal_info().unwrap().next_seq < begun + 10 * LAP {
        // One-letter lines and bytes of no text; not more than the board takes in.
        for _ in 0..40 {
            turn += 1;
            let noise: &[u8] = if turn.is_multiple_of(3) {
                b"\xFF\x81\xA5"
            } else {
                b"x\r\n"
            };
            board.control_sends(&noise.repeat(16));
        }
        if turn.is_multiple_of(400) {
            let mut host = board.connect();
            host.write(&[0xA5; 4096]).unwrap();
            drop((host, client));
            client = umi_desk::client(&board).unwrap();
            client.set_job(&job()).unwrap().ok();
        }
        if turn == 4000 {
            drop((board, client));
            (board, client) = start(&config);
        }
    }
    // A lap is a tenth of a second here: a pull is overtaken until the board has taken all in.
    let mut behind = 0;
    until(|| {
        std::thread::sleep(Duration::from_millis(100));
        let before = std::mem::replace(&mut behind, client.journal_info().unwrap().next_seq);
        before == behind
    });
    let (file, pulled) = pulled(&mut client);
    let key = pulled.head.as_ref().map(|head| head.key);
    assert!(key.is_some(), "{:?}", pulled.unsigned);
    let verified = verify(&file, key, None).unwrap();
    assert!(verified.signed && !verified.stretch.overwritten.is_empty());
    let after = evidence(&file);
    for piece in &before {
        assert!(after.contains(piece), "{piece:?}");
    }
    // A piece of it that is taken out of a gap, changed or put in is found: see the client's tests.
    let lost = client.journal_info().unwrap().lost;
    assert!(lost > 9 * LAP);
}

/// Where the owner wants evidence kept, nothing goes out before some would be lost; a host that
/// has pulled it says so, and the next correction goes out.
#[test]
fn a_full_journal_holds_corrections_back() {
    let config = Config {
        evidence: Some(VirtualFlash::in_memory(RING)),
        ..config()
    };
    let (board, mut client) = start(&config);
    client.set_job(&job()).unwrap().unwrap();
    let refuse = BoardConfig {
        journal: JournalConfig {
            full: WhenFull::Refuse,
        },
        ..BoardConfig::default()
    };
    client.set_config(&refuse).unwrap().unwrap();
    cut(&board, &mut client, 0);
    let mut went_out = 0;
    loop {
        let sent = cut(&board, &mut client, 1 + went_out % 4);
        assert!(!sent.is_empty());
        if !is_correction(&sent) {
            break;
        }
        went_out += 1;
        assert!(went_out < 400, "nothing was held back");
    }
    assert!(went_out > 10, "{went_out}");
    // Nothing is lost yet, and what was held back is told by its reason.
    let (file, _) = pulled(&mut client);
    let said = evidence(&file);
    let verdicts = |of: &[(u64, Record)]| {
        let verdicts = of.iter().filter(|(_, of)| matches!(of, Record::Verdict(_)));
        verdicts.count()
    };
    assert_eq!(verdicts(&said), went_out + 2);
    let (records, _) = umi_tests::cases::journal(&mut client);
    assert!(
        records
            .iter()
            .any(|of| matches!(of, Record::AlarmSent { .. }))
    );
    // It stays so, whatever is measured, and over a restart; all of the evidence is still there.
    let (mut board, mut client) = (board, client);
    for turn in 0..60 {
        assert!(
            !is_correction(&cut(&board, &mut client, turn % 5)),
            "{turn}"
        );
        if turn == 30 {
            drop((board, client));
            (board, client) = start(&config);
        }
    }
    let (file, pulled) = pulled(&mut client);
    let still = evidence(&file);
    assert_eq!(still[..said.len()], said);
    assert!(verdicts(&still) < went_out + 62, "not all can be kept");
    assert!(client.status().unwrap().journal_failures > 0);
    let key = pulled.head.as_ref().map(|head| head.key);
    assert!(verify(&file, key, None).unwrap().signed);
    // Somebody keeps it elsewhere.
    let info = client.journal_info().unwrap();
    assert_eq!(
        client.journal_ack(info.next_seq).unwrap(),
        Acknowledged::Done
    );
    assert!(matches!(
        client.journal_ack(u64::MAX).unwrap(),
        Acknowledged::NoEntry(_)
    ));
    for turn in 1..5 {
        assert!(is_correction(&cut(&board, &mut client, turn)), "{turn}");
    }
}

/// Whether a correction stands in what the control has read.
fn is_correction(text: &[u8]) -> bool {
    String::from_utf8_lossy(text).contains("G10")
}

/// A ring of evidence of three sectors.
const RING: Geometry = Geometry {
    sectors: 3,
    sector_size: 32_768,
    write_size: 1,
    page_size: 256,
};

/// A board whose journal takes no more verdicts until somebody acknowledges.
fn full(config: &Config) -> (VirtualBoard, Client) {
    let (board, mut client) = start(config);
    client.set_job(&job()).unwrap().unwrap();
    let mut refuse = BoardConfig::default();
    refuse.journal.full = WhenFull::Refuse;
    client.set_config(&refuse).unwrap().unwrap();
    cut(&board, &mut client, 0);
    for turn in 0..400 {
        if !is_correction(&cut(&board, &mut client, 1 + turn % 4)) {
            return (board, client);
        }
    }
    panic!("nothing was held back");
}

/// A sector of the ring is erased or all zeros, behind the board's back, where the journal is full: who acknowledges it
/// is heard, the next corrections go out, and none of what is gone is told as there.
#[test]
fn damage_blocks_no_acknowledgement() {
    for (sector, is_erased) in [(0, false), (1, true), (2, false)] {
        let mut ring = VirtualFlash::in_memory(RING);
        let config = Config {
            evidence: Some(ring.clone()),
            ..config()
        };
        drop(full(&config));
        let (board, mut client) = start(&config);
        let gone = client.journal_info().unwrap().lost;
        drop((board, client));
        ring.erase(sector).unwrap();
        if !is_erased {
            let zeros = [0; 32_768];
            ring.program(sector * RING.sector_size, &zeros).unwrap();
        }
        let (board, mut client) = start(&config);
        let info = client.journal_info().unwrap();
        assert!(info.lost >= gone, "{sector}: {} {gone}", info.lost);
        let acked = client.journal_ack(info.next_seq).unwrap();
        assert_eq!(acked, Acknowledged::Done, "{sector}");
        for turn in 1..5 {
            let text = cut(&board, &mut client, turn);
            assert!(is_correction(&text), "{sector} {turn}");
        }
    }
}

/// Where not even starts find room any more, what a host asks for is refused by that reason. Acknowledgements that
/// free nothing take no turn; one that does lets the board go on, and the journal has its start.
#[test]
fn a_start_without_room_is_told_when_there_is_some() {
    let config = Config {
        evidence: Some(VirtualFlash::in_memory(RING)),
        ..config()
    };
    let (mut board, mut client) = full(&config);
    let lacks = |client: &mut Client| client.status().unwrap().journal_failures;
    for _ in 0..400 {
        drop((board, client));
        (board, client) = start(&config);
        if lacks(&mut client) >= 3 {
            break;
        }
    }
    assert!(lacks(&mut client) >= 3, "every start found room");
    let text = cut(&board, &mut client, 1);
    assert!(String::from_utf8_lossy(&text).contains("JOURNAL FULL"));
    let refused = client.set_config(&BoardConfig::default()).unwrap_err();
    assert!(matches!(refused, LinkError::JournalFull), "{refused}");
    let unsigned = journal::head(&mut client, [7; 32], Duration::from_millis(1500)).unwrap();
    assert_eq!(unsigned.unwrap_err(), journal::Unsigned::Full);
    for seq in 1..=20 {
        let refused = client.journal_ack(seq).unwrap_err();
        assert!(matches!(refused, LinkError::JournalFull), "{refused}");
    }
    let before = client.journal_info().unwrap().next_seq;
    assert_eq!(client.journal_ack(before).unwrap(), Acknowledged::Done);
    // The first clamping teaches nothing anew: the reference is as it was.
    for turn in 1..5 {
        let text = cut(&board, &mut client, turn);
        assert!(is_correction(&text), "{turn}");
    }
    let (file, _) = pulled(&mut client);
    let after = evidence(&file)
        .into_iter()
        .filter(|(seq, _)| *seq >= before);
    let after: Vec<_> = after.map(|(_, record)| record).collect();
    assert!(
        matches!(
            after[..],
            [
                Record::Acknowledged { .. },
                Record::Boot { .. },
                Record::ConfigSet(_),
                Record::JobSet { .. },
                ..
            ]
        ),
        "{after:?}"
    );
    // From that start on the inputs lead to the decisions again.
    let (_, findings) = umi_tests::cases::journal(&mut client);
    let differences = findings.differences.iter();
    let behind: Vec<_> = differences.filter(|(seq, _)| *seq > before + 1).collect();
    assert!(
        behind.is_empty() && findings.identical >= 16,
        "{findings:?}"
    );
}

/// A reference that is taught while the journal has no room: nothing goes out that rests on it before the journal has it, and
/// the inputs behind that lead to the decisions.
#[test]
fn a_reference_without_room_is_told_before_anything_rests_on_it() {
    let config = Config {
        evidence: Some(VirtualFlash::in_memory(RING)),
        ..config()
    };
    let (board, mut client) = full(&config);
    // Until the verdicts find no room, either.
    let failures = client.status().unwrap().journal_failures;
    while client.status().unwrap().journal_failures < failures + 4 {
        assert!(!is_correction(&cut(&board, &mut client, 0)));
    }
    client.teach(TeachWhat::Again).unwrap().unwrap();
    assert!(!is_correction(&cut(&board, &mut client, 3)));
    let taught = client.status().unwrap();
    assert!(taught.has_reference && taught.teaching.is_none());
    let next = client.journal_info().unwrap().next_seq;
    assert_eq!(client.journal_ack(next).unwrap(), Acknowledged::Done);
    for turn in [1, 3, 1] {
        let text = cut(&board, &mut client, turn);
        assert!(is_correction(&text), "{turn}");
    }
    let (file, _) = pulled(&mut client);
    let after = evidence(&file).into_iter().filter(|(seq, _)| *seq >= next);
    let after: Vec<_> = after.collect();
    let first = |is: fn(&Record) -> bool| after.iter().find(|(_, of)| is(of)).map(|of| of.0);
    let told = first(|of| matches!(of, Record::ReferenceRestored { .. })).unwrap();
    let sent = first(|of| matches!(of, Record::CorrectionSent { .. })).unwrap();
    assert!(told < sent, "{after:?}");
    let (_, findings) = umi_tests::cases::journal(&mut client);
    let differs = |(seq, _): &&(u64, _)| *seq > told;
    let behind: Vec<_> = findings.differences.iter().filter(differs).collect();
    assert!(behind.is_empty(), "{behind:?}");
}

/// One bit of one piece of evidence has changed at rest, and noise has overwritten all that stood around it: all other
/// pieces are pulled, and the file is not taken for whole.
#[test]
fn a_damaged_piece_of_evidence_is_told_and_hides_no_other() {
    let mut ring = VirtualFlash::in_memory(RING);
    let config = Config {
        evidence: Some(ring.clone()),
        ..config()
    };
    let (board, mut client) = start(&config);
    client.set_job(&job()).unwrap().unwrap();
    for turn in 0..5 {
        cut(&board, &mut client, turn);
    }
    let (file, _) = pulled(&mut client);
    let before = evidence(&file);
    let begun = client.journal_info().unwrap().next_seq;
    while client.journal_info().unwrap().next_seq < begun + 2 * LAP {
        board.control_sends(&b"x\r\ny\r\n".repeat(64));
    }
    until(|| {
        std::thread::sleep(Duration::from_millis(100));
        let before = client.journal_info().unwrap().next_seq;
        std::thread::sleep(Duration::from_millis(100));
        client.journal_info().unwrap().next_seq == before
    });
    drop((board, client));
    let mut bytes = vec![0; RING.sector_size as usize];
    ring.read(0, &mut bytes).unwrap();
    // The oldest piece, and one between others: each a bit of what stands behind its number and its chain value.
    let pieces: Vec<usize> = (0..bytes.len())
        .filter(|at| bytes[*at..].starts_with(&[0xA5]))
        .collect();
    for at in [pieces[0], pieces[pieces.len() / 2]] {
        let whole = bytes.clone();
        bytes[at + 70] ^= 1;
        ring.erase(0).unwrap();
        ring.program(0, &bytes).unwrap();
        let (board, mut client) = start(&config);
        let (file, pulled) = pulled(&mut client);
        let key = pulled.head.as_ref().map(|head| head.key);
        let refused = verify(&file, key, None).unwrap_err();
        assert_eq!(refused.code, "head_signature", "{refused}");
        let after = evidence(&file);
        let missing: Vec<_> = before.iter().filter(|of| !after.contains(of)).collect();
        assert_eq!(missing.len(), 1, "{missing:?}");
        drop((board, client));
        bytes = whole;
    }
}

/// Acknowledgements without end, of a key that may do nothing else, push no evidence out: the first few are
/// kept at once, then one a minute, which tells all that was lost since the one before. They take no turn of
/// those who change what is in force.
#[test]
fn acknowledgements_push_no_evidence_out() {
    let config = Config {
        time: BoardTime::Steered,
        ..config()
    };
    let (board, mut client) = start(&config);
    client.set_job(&job()).unwrap().unwrap();
    // Noise laps the journal, so that each tells a loss.
    while client.journal_info().unwrap().lost < LAP {
        board.control_sends(&b"x\r\n".repeat(64));
    }
    until(|| {
        let before = client.journal_info().unwrap().next_seq;
        std::thread::sleep(Duration::from_millis(100));
        client.journal_info().unwrap().next_seq == before
    });
    let lost = client.journal_info().unwrap().lost;
    let told = |client: &mut Client| -> Vec<(u64, u64)> {
        let (file, _) = pulled_as(client, PullRequest::default());
        let found = evidence(&file).into_iter();
        found
            .filter_map(|(_, of)| match of {
                Record::Acknowledged { seq, lost } => Some((seq, lost)),
                _ => None,
            })
            .collect()
    };
    for seq in 1..=400 {
        assert_eq!(client.journal_ack(seq).unwrap(), Acknowledged::Done);
    }
    assert_eq!(client.journal_info().unwrap().acked_seq, 400);
    assert_eq!(told(&mut client).len(), 8);
    let mut refuse = BoardConfig::default();
    refuse.journal.full = WhenFull::Refuse;
    for n in 0..20 {
        let of = if n % 2 == 0 {
            refuse
        } else {
            BoardConfig::default()
        };
        client.set_config(&of).unwrap().unwrap();
    }
    // A minute later all of them are kept, as one.
    board.advance(umi_core::units::Micros(70_000_000));
    until(|| told(&mut client).len() == 9);
    let kept = told(&mut client);
    assert_eq!(kept.last().unwrap().0, 400);
    let still = client.journal_info().unwrap().lost;
    let sum: u64 = kept.iter().map(|(_, lost)| lost).sum();
    assert!(sum + still >= lost && sum > 380, "{sum} {still} {lost}");
    drop((board, client));
    let (_board, mut client) = start(&config);
    assert_eq!(client.journal_info().unwrap().acked_seq, 400);
}

/// One-letter lines for some seconds: an entry a second, with the count of the others; the replay
/// comes to the same faults.
#[test]
fn equal_faults_are_one_record_a_second() {
    let config = Config {
        time: BoardTime::Steered,
        ..config()
    };
    let (board, mut client) = start(&config);
    client.set_job(&job()).unwrap().unwrap();
    let mut sent = 0_u32;
    for turn in 0..30_u64 {
        board.advance(umi_core::units::Micros(turn * 100_000));
        board.control_sends(b"x\r\ny\r\n");
        sent += 2;
        until(|| client.status().unwrap().counters.faults.iter().sum::<u32>() >= sent);
    }
    board.advance(umi_core::units::Micros(5_000_000));
    std::thread::sleep(Duration::from_millis(100));
    let (records, findings) = umi_tests::cases::journal(&mut client);
    let told = records
        .iter()
        .filter(|of| matches!(of, Record::Fault(_)))
        .count();
    let counted: u32 = records
        .iter()
        .map(|of| match of {
            Record::FaultsAgain { count, .. } => *count,
            _ => 0,
        })
        .sum();
    assert_eq!(u32::try_from(told).unwrap() + counted, sent);
    assert!((3..=4).contains(&told), "{told}");
    assert_eq!(findings.differences, []);
}

/// A program that is put and deleted again and again pushes no evidence out: behind 64 at once, one in two seconds is
/// deleted. Forty programs are put at once all the same.
#[test]
fn deleted_programs_push_no_evidence_out() {
    let (_board, mut client) = start(&config());
    let text = b"%\nO0009\nM30\n%\n";
    let program = |number| ProgramInfo {
        number,
        name: "PART".parse().unwrap(),
        bytes: text.len() as u32,
        crc32: programs::check_value(text),
        release: Release::Always,
        hold_s: 5,
        stated: Stated::default(),
    };
    let begun = Instant::now();
    for number in 1..=30 {
        programs::put(&mut client, &program(number), text, |_| {}).unwrap();
    }
    let (mut deleted, mut refused) = (0, 0);
    for _ in 0..300 {
        programs::put(&mut client, &program(9), text, |_| {}).unwrap();
        match client.program_delete(9).unwrap() {
            Ok(()) => deleted += 1,
            Err(ProgramRefusal::Busy) => refused += 1,
            Err(other) => panic!("{other}"),
        }
    }
    let most = 65 + begun.elapsed().as_secs() / 2;
    assert!(
        (64..=most).contains(&deleted) && refused > 0,
        "{deleted} {refused}"
    );
    // Who waits has it done.
    programs::delete(&mut client, 9).unwrap();
    let (file, _) = pulled(&mut client);
    let told = evidence(&file)
        .iter()
        .filter(|(_, of)| matches!(of, Record::ProgramDeleted { .. }))
        .count();
    assert_eq!(told as u64, deleted + 1);
}
