//! The application on a virtual board, beyond what all boards are asked in
//! `conformance.rs`: steered time, flow control at every place, slow hosts, the audit, and
//! the ports that `umi virtual` opens.

use std::time::{Duration, Instant};

use umi_client::board::link::{Client, JournalEntry};
use umi_client::journal::audit::Audit;
use umi_client::journal::{self, PullStep};
use umi_client::problem::Problem;
use umi_client::session::DecisionRecord;
use umi_core::units::Micros;
use umi_desk::capture::{Desk, nobody};
use umi_protocol::job::Job;
use umi_protocol::latch::{LatchCause, LatchReport};
use umi_protocol::message::{Event, Record};
use umi_protocol::pattern::Coding;
use umi_protocol::program::Withheld;
use umi_protocol::serial::LineSpec;
use umi_protocol::verdict::Verdict;
use umi_tests::cases::{SESSION, clamping, job, journal, raw_bytes, until_quiet};
use umi_virtual::{Config, VirtualBoard};

const DC1: &[u8] = &[0x11];
const XOFF: &[u8] = &[0x13];
/// Long enough for a board in this process to do what it will do.
const SOON: Duration = Duration::from_millis(40);

fn verdicts_of(bench: &mut Desk, text: &str) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    let keep = |decision| {
        if let DecisionRecord::Verdict(verdict) = decision {
            verdicts.push(*verdict);
        }
        Ok::<_, Problem>(())
    };
    bench.play(text.as_bytes(), keep).unwrap();
    verdicts
}

/// What READ gets without an OK verdict.
fn alarm(job: &Job, why: &Withheld) -> String {
    umi_core::correction::alarm(&job.correction.unwrap(), why, None, Coding::Ascii)
        .unwrap()
        .as_str()
        .to_owned()
}

fn receive_all(board: &VirtualBoard) -> String {
    until_quiet(1, |patience| board.control_receives(patience))
}

/// Waits until the board has taken everything in.
fn settled(client: &mut Client, records: u64) {
    for _ in 0..1000 {
        if client.journal_info().unwrap().next_seq >= records {
            return;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("the board does not come to {records} records");
}

/// A session through both ports: verdicts come over the link, the program of each
/// OK verdict is what READ gets, and the journal replays to the last bit.
#[test]
fn a_session_through_both_ports() {
    let mut bench = Desk::new(&job()).unwrap();
    for case in 0..5 {
        let verdicts = verdicts_of(&mut bench, &clamping(case));
        assert_eq!(verdicts.len(), 1);
        assert!(verdicts[0].ok, "{verdicts:?}");
        let program = bench.read_program().unwrap();
        match &verdicts[0].correction {
            None => {
                let taught = alarm(&job(), &Withheld::OnlyTaught);
                assert_eq!((case, program), (0, Some(taught)));
            }
            Some(correction) => {
                assert_eq!(program.as_deref(), Some(correction.text.as_str()));
                // Once: the next clamping must not get it without probing.
                let gone = alarm(&job(), &Withheld::CorrectionGone);
                assert_eq!(bench.read_program().unwrap(), Some(gone));
            }
        }
    }
    let (records, findings) = journal(bench.client());
    let sent = |r: &&Record| matches!(r, Record::CorrectionSent { complete: true, .. });
    assert_eq!(records.iter().filter(sent).count(), 4);
    assert_eq!((findings.differences.len(), findings.skipped), (0, 0));
    // 15 features, 5 verdicts, 1 reference.
    assert_eq!(findings.identical, 21);
    let control: Vec<u8> = raw_bytes(&records)
        .into_iter()
        .filter(|b| *b != DC1[0])
        .collect();
    assert_eq!(control, SESSION.as_bytes());
}

/// Two runs of the same capture give the same journal, byte for byte.
#[test]
fn two_runs_give_the_same_journal() {
    let run = || {
        let mut bench = Desk::new(&job()).unwrap();
        bench.play(SESSION.as_bytes(), nobody).unwrap();
        bench.end(nobody).unwrap();
        let client = bench.client();
        let info = client.journal_info().unwrap();
        let entries = (info.first_seq..info.next_seq).map(|seq| client.journal_read(seq).unwrap());
        entries.collect::<Vec<JournalEntry>>()
    };
    assert_eq!(run(), run());
}

/// Without an OK verdict READ gets an alarm: before one, after an NG, once a new
/// measurement has begun, after a new job.
#[test]
fn no_program_without_an_ok_verdict() {
    let mut bench = Desk::new(&job()).unwrap();
    let taught = Some(alarm(&job(), &Withheld::OnlyTaught));
    let alarm = Some(alarm(&job(), &Withheld::NoVerdict));
    assert_eq!(bench.read_program().unwrap(), alarm);
    verdicts_of(&mut bench, &clamping(0));
    assert_eq!(
        bench.read_program().unwrap(),
        taught,
        "the taught setup has no correction"
    );
    assert!(verdicts_of(&mut bench, &clamping(1))[0].ok);
    assert!(bench.client().status().unwrap().correction_waiting);
    // Any line that says something, also one that cannot be used.
    let next = clamping(2);
    let lines: Vec<&str> = next.split_inclusive('\n').collect();
    verdicts_of(&mut bench, " *** \n");
    assert!(bench.client().status().unwrap().correction_waiting);
    verdicts_of(&mut bench, "X1 Q7\n");
    assert_eq!(
        bench.read_program().unwrap(),
        alarm,
        "the control printed again"
    );
    assert_eq!(bench.board().lights(), umi_app::board::Lights::default());
    verdicts_of(&mut bench, &lines[..4].concat());
    assert_eq!(
        bench.read_program().unwrap(),
        alarm,
        "a new measurement has begun"
    );
    let spoilt = lines[4..].concat().replacen("*", "*1", 1);

    assert!(!verdicts_of(&mut bench, &spoilt)[0].ok);
    assert_eq!(bench.read_program().unwrap(), alarm, "the verdict is NG");
    assert!(verdicts_of(&mut bench, &clamping(3))[0].ok);
    assert!(bench.client().status().unwrap().correction_waiting);
    bench.client().set_job(&job()).unwrap().unwrap();
    assert_eq!(bench.read_program().unwrap(), alarm, "the job is a new one");
}

/// A job that sends nothing answers no READ. An XON that comes after all was sent, soon
/// after an XOFF, is no READ either; later it is one.
#[test]
fn what_is_no_read_gets_no_alarm() {
    let mut silent = job();
    silent.correction.as_mut().unwrap().send = umi_protocol::job::SendWhen::Never;
    let mut bench = Desk::new(&silent).unwrap();
    assert_eq!(bench.read_program().unwrap(), None);

    let mut bench = Desk::new(&job()).unwrap();
    assert_eq!(
        bench.read_program().unwrap(),
        Some(alarm(&job(), &Withheld::NoVerdict))
    );
    bench.board().control_sends(XOFF);
    bench.board().control_sends(DC1);
    assert_eq!(receive_all(bench.board()), "");
    bench.play(XOFF, nobody).unwrap();
    bench.advance(Micros(6_000_000));
    bench.board().control_sends(DC1);
    assert_eq!(
        receive_all(bench.board()),
        alarm(&job(), &Withheld::NoVerdict)
    );
}

/// After XOFF at most ten characters still come (two, with a UART that holds one),
/// wherever in the program it is said; after XON the rest comes, and nothing twice.
#[test]
fn flow_control_at_every_place() {
    // Characters take their time, as on a line: else it is chance how many the
    // test takes before the board has seen the XOFF.
    let config = Config {
        character: Duration::from_micros(87),
        ..Config::default()
    };
    let mut bench = Desk::with(config, &job()).unwrap();
    verdicts_of(&mut bench, &clamping(0));
    for stop in (0..280).step_by(7) {
        // Each program goes out once: measure again for the next.
        let verdict = verdicts_of(&mut bench, &clamping(1 + stop / 7 % 2)).remove(0);
        let text = verdict.correction.unwrap().text;
        let board = bench.board();
        board.control_sends(DC1);
        let mut got: String = (0..stop)
            .map(|_| char::from(board.control_receives(Duration::from_secs(5)).unwrap()))
            .collect();
        board.control_sends(XOFF);
        let after = receive_all(board);
        assert!(
            after.len() <= 10 || stop == 0,
            "{} after XOFF at {stop}",
            after.len()
        );
        got.push_str(&after);
        board.control_sends(DC1);
        while got.len() < text.len() {
            got.push(char::from(
                board.control_receives(Duration::from_secs(5)).unwrap(),
            ));
        }
        assert_eq!(got, text.as_str(), "stopped at {stop}");
        assert_eq!(board.control_receives(Duration::from_millis(1)), None);
        bench.settle().unwrap();
    }
}

/// As `umi virtual` has it: characters take the time that the job's line gives them, both ways, eleven bits each with
/// two stop bits; never less.
#[test]
fn the_pace_is_that_of_the_jobs_line() {
    for (baud, stop_bits) in [(9600, 2), (38_400, 1)] {
        let mut job = job();
        job.line = LineSpec {
            baud: Some(baud),
            stop_bits: Some(stop_bits),
            ..LineSpec::default()
        };
        let line = |characters: usize| {
            Duration::from_secs(9 + u64::from(stop_bits)) * characters as u32 / baud
        };
        let config = Config {
            paced_by_job: true,
            ..Config::default()
        };
        let mut bench = Desk::with(config, &job).unwrap();
        // The first one passes while the port follows the job.
        verdicts_of(&mut bench, &clamping(0));
        let (begun, text) = (Instant::now(), clamping(1));
        verdicts_of(&mut bench, &text);
        let took = begun.elapsed();
        assert!(
            took >= line(text.len()),
            "{baud}: {took:?} from the control"
        );
        let verdict = verdicts_of(&mut bench, &clamping(2)).remove(0);
        let text = verdict.correction.unwrap().text;
        let board = bench.board();
        board.control_sends(DC1);
        let begun = Instant::now();
        for _ in 0..text.len() {
            board.control_receives(Duration::from_secs(5)).unwrap();
        }
        let took = begun.elapsed();
        assert!(took >= line(text.len()), "{baud}: {took:?} to the control");
    }
}

/// A control that never says XON again: the board gives up and says so.
#[test]
fn a_control_that_stays_stopped() {
    let mut bench = Desk::new(&job()).unwrap();
    verdicts_of(&mut bench, &clamping(0));
    verdicts_of(&mut bench, &clamping(1));
    let board = bench.board();
    board.control_sends(DC1);
    assert!(board.control_receives(SOON).is_some());
    board.control_sends(XOFF);
    let _ = receive_all(board);
    board.advance(Micros(1_000_000_000));
    std::thread::sleep(SOON);
    let (records, _) = journal(bench.client());
    assert!(
        records.iter().any(|r| matches!(
            r,
            Record::CorrectionSent {
                complete: false,
                ..
            }
        )),
        "{:?}",
        records.last()
    );
}

/// The program goes out in the control's code: an ISO control gets ISO.
#[test]
fn the_program_is_sent_in_the_controls_code() {
    let even = |b: u8| if b.count_ones() % 2 == 1 { b | 0x80 } else { b };
    let iso = |text: &str| text.bytes().map(even).collect::<Vec<u8>>();
    let mut bench = Desk::new(&job()).unwrap();
    for case in 0..2 {
        bench.play(&iso(&clamping(case)), nobody).unwrap();
    }
    let text = bench
        .client()
        .verdict()
        .unwrap()
        .unwrap()
        .correction
        .unwrap()
        .text;
    let board = bench.board();
    board.control_sends(DC1);
    let mut got = Vec::new();
    while let Some(byte) = board.control_receives(SOON) {
        got.push(byte);
    }
    assert_eq!(got, iso(&text));
}

/// A host that asks for events and does not read them is told how many it missed;
/// the journal has the records.
#[test]
fn a_slow_host_is_told_what_it_missed() {
    let board = VirtualBoard::start(Config::default()).unwrap();
    let mut client = umi_desk::client(&board).unwrap();
    client.set_job(&job()).unwrap().unwrap();
    client.live(true).unwrap();
    let records = client.journal_info().unwrap().next_seq;
    for chunk in SESSION.repeat(3).as_bytes().chunks(16) {
        board.control_sends(chunk);
        std::thread::sleep(Duration::from_micros(100));
    }
    let mut seen = 0;
    let mut dropped = 0;
    while let Some(event) = client.next_event(Duration::from_millis(500)).unwrap() {
        match event {
            Event::Dropped { count } => dropped += count,
            _ => seen += 1,
        }
    }
    // One more event tells of the last ones dropped.
    board.control_sends(b"\n");
    while let Some(event) = client.next_event(Duration::from_millis(200)).unwrap() {
        if let Event::Dropped { count } = event {
            dropped += count;
        }
    }
    assert!(seen > 0 && dropped > 0, "{seen} seen, {dropped} dropped");
    assert_eq!(client.status().unwrap().events_dropped, dropped);
    let (all, findings) = journal(&mut client);
    assert!(all.len() as u64 > records);
    assert_eq!(findings.differences, []);
    let verdicts = all
        .iter()
        .filter(|r| matches!(r, Record::Verdict(v) if v.ok));
    assert_eq!(verdicts.count(), 15);
}

/// A refused job changes nothing; a changed decision in a journal is found.
#[test]
fn a_refused_job_changes_nothing_and_the_audit_finds_changes() {
    let mut bench = Desk::new(&job()).unwrap();
    let mut bad = job();
    bad.limits.rms_mm = -1.0;
    let refused = bench.client().set_job(&bad).unwrap();
    assert_eq!(refused.unwrap_err().code(), "bad_value");
    assert_eq!(bench.client().job().unwrap().job, Some(job()));
    bench.play(SESSION.as_bytes(), nobody).unwrap();

    let mut audit = Audit::default();
    let mut changed = 0;
    let stretch = journal::pull(bench.client(), journal::PullRequest::default(), |step| {
        if let PullStep::Entry(entry, _) = step {
            let mut record = journal::record(&entry).unwrap();
            if let Record::Feature(feature) = &mut record
                && feature.index == 7
            {
                // One bit of one residual.
                let residual = &mut feature.fit.as_mut().unwrap().residuals_mm[0];
                *residual = f64::from_bits(residual.to_bits() ^ 1);
                changed = entry.seq;
            }
            audit.take(&entry, &record);
        }
        Ok::<_, Problem>(())
    })
    .unwrap();
    let findings = audit.finish(stretch.stretch.next);
    let places: Vec<u64> = findings.differences.iter().map(|(seq, _)| *seq).collect();
    assert_eq!(places, [changed]);
}

/// Latches are journaled with their loss.
#[test]
fn latches_are_journaled() {
    let board = VirtualBoard::start(Config::default()).unwrap();
    let mut client = umi_desk::client(&board).unwrap();
    let latch = LatchReport {
        number: 0,
        cause: LatchCause::Skip,
        counts: [1, -2, 3].into_iter().collect(),
        t_ns: 17_000,
        missed: 2,
    };
    board.latch(latch.clone());
    settled(&mut client, 2);
    let (records, _) = journal(&mut client);
    assert_eq!(records.last(), Some(&Record::Latch(latch)));
}

/// The outputs: busy while a setup is under way, then OK or NG.
#[test]
fn outputs_follow_the_verdict() {
    let mut bench = Desk::new(&job()).unwrap();
    let lights = |bench: &mut Desk| {
        let lights = bench.board().lights();
        (lights.busy, lights.ok, lights.ng)
    };
    assert_eq!(lights(&mut bench), (false, false, false));
    let text = clamping(0);
    let (first, rest) = text.split_at(200);
    verdicts_of(&mut bench, first);
    assert_eq!(lights(&mut bench), (true, false, false));
    verdicts_of(&mut bench, rest);
    assert_eq!(lights(&mut bench), (false, true, false));
    verdicts_of(&mut bench, &clamping(1).replacen("*-", "*", 1));
    assert_eq!(lights(&mut bench), (false, false, true));
}

/// The ports that `umi virtual` opens, used as a terminal program and `umi --port`
/// use them: a device file for the control, a serial port for the host.
#[cfg(unix)]
#[test]
fn pseudo_terminals_are_ports() {
    use std::io::Write as _;
    use std::sync::Arc;
    use umi_virtual::serve::{Port, PortPlace};

    let board = Arc::new(VirtualBoard::start(Config::default()).unwrap());
    let cnc = Port::open(&PortPlace::Pty).unwrap();
    let usb = Port::open(&PortPlace::Pty).unwrap();
    let (cnc_path, usb_path) = (cnc.address.clone(), usb.address.clone());
    cnc.serve_control(&board);
    usb.serve_host(&board);
    for case in 0..2 {
        let mut client = Client::open(&usb_path).unwrap();
        if case == 0 {
            client.set_job(&job()).unwrap().unwrap();
        }
        let mut control = std::fs::OpenOptions::new()
            .write(true)
            .open(&cnc_path)
            .unwrap();
        control.write_all(clamping(case).as_bytes()).unwrap();
        drop(control);
        // Both ports are closed and opened again for the next clamping.
        for _ in 0..1000 {
            if client.status().unwrap().verdicts as usize > case {
                break;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        assert!(client.verdict().unwrap().unwrap().ok);
    }
}

/// The same over TCP, one client after the other.
#[test]
fn tcp_ports_serve_one_client_after_the_other() {
    use std::io::Write as _;
    use std::sync::Arc;
    use umi_virtual::serve::{Port, PortPlace};

    let board = Arc::new(VirtualBoard::start(Config::default()).unwrap());
    let cnc = Port::open(&PortPlace::Tcp(0)).unwrap();
    let usb = Port::open(&PortPlace::Tcp(0)).unwrap();
    let (cnc_address, usb_address) = (cnc.address.clone(), usb.address.clone());
    cnc.serve_control(&board);
    usb.serve_host(&board);
    Client::open(&usb_address)
        .unwrap()
        .set_job(&job())
        .unwrap()
        .unwrap();
    let mut control = std::net::TcpStream::connect(&cnc_address["tcp://".len()..]).unwrap();
    control.write_all(clamping(0).as_bytes()).unwrap();
    let mut client = Client::open(&usb_address).unwrap();
    let verdict = loop {
        if let Some(verdict) = client.verdict().unwrap() {
            break verdict;
        }
    };
    assert!(verdict.ok);
}

/// A correction that nobody reads grows too old, and the board says so at its
/// outputs.
#[test]
fn a_correction_grows_too_old() {
    let mut bench = Desk::new(&job()).unwrap();
    for case in 0..2 {
        assert!(verdicts_of(&mut bench, &clamping(case))[0].ok);
    }
    assert!(bench.client().status().unwrap().correction_waiting);
    bench.board().advance(Micros(
        u64::from(job().plate_timeout_s) * 1_000_000 + 10_000_000,
    ));
    std::thread::sleep(SOON);
    bench.settle().unwrap();
    assert!(!bench.client().status().unwrap().correction_waiting);
    assert!(!bench.board().lights().ok);
}

/// With `on_verdict` the program goes out by itself, also when a refused feature
/// was probed again and its setup judged again; and once.
#[test]
fn programs_that_go_out_by_themselves() {
    let mut job = job();
    job.correction.as_mut().unwrap().send = umi_protocol::job::SendWhen::OnVerdict;
    let mut bench = Desk::new(&job).unwrap();
    assert!(verdicts_of(&mut bench, &clamping(0))[0].ok);
    assert_eq!(receive_all(bench.board()), "");
    let text = clamping(1);
    let lines: Vec<&str> = text.split_inclusive('\n').collect();
    let spoilt = lines[..22].concat() + "*0.0000*0.0000*0.0000\n" + &lines[23..].concat();
    assert!(!verdicts_of(&mut bench, &spoilt)[0].ok);
    assert_eq!(receive_all(bench.board()), "");
    let verdict = verdicts_of(&mut bench, &lines[18..].concat()).remove(0);
    assert!(verdict.ok, "{verdict:?}");
    let program = receive_all(bench.board());
    assert_eq!(program, verdict.correction.unwrap().text.as_str());
    bench.settle().unwrap();
}
