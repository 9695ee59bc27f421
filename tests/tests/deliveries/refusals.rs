//! What must not happen, whatever control and host do: on the virtual board, in its real
//! time.

use std::thread::sleep;
use std::time::Duration;

use umi::link::Client;
use umi::programs;
use umi_protocol::job::Job;
use umi_protocol::message::Record;
use umi_protocol::pattern::Coding;
use umi_protocol::program::{Piece, ProgramInfo, Release, Withheld};
use umi_tests::cases::*;
use umi_tests::rig::{Rig, VirtualRig};

use super::common::*;

const NINE: &str = "%\nO0009\nM30\n%\n";

fn start(job: &Job) -> (VirtualRig, Client) {
    let mut rig = VirtualRig::start().unwrap();
    let mut client = connect(&mut rig);
    client.set_job(job).unwrap().unwrap();
    (rig, client)
}

fn put(client: &mut Client, number: u32, text: &str, release: Release, hold_s: u16) {
    let program = ProgramInfo {
        hold_s,
        ..info(number, text, release)
    };
    programs::put(client, &program, text.as_bytes(), |_| {}).unwrap();
}

/// Bytes of a text, as one message takes them.
fn piece(text: &str, offset: u32) -> Piece {
    text.bytes().skip(offset as usize).take(200).collect()
}

/// Held for longer than it may be: an alarm behind the `%` that ends what the control has,
/// and the program only when it is asked for anew. One that does not begin with `%` never
/// goes out.
#[test]
fn what_was_held_for_too_long_does_not_begin_by_itself() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, &long(), Release::Always, 1);
    let bare = long().replace("%\nO1234(POCKET)\n", "");
    put(client, 77, &bare, Release::Always, 1);
    let _ = stopped(rig, b"READ O1234\r\n\x11", 200);
    sleep(Duration::from_millis(1500));
    rig.control_sends(DC1);
    receive_text(rig, &alarm_of(1234, &Withheld::HeldTooLong));
    read(rig, 1234);
    receive_text(rig, &long());
    read(rig, 77);
    receive_text(rig, &alarm_of(77, &Withheld::NoPercent));
}

/// A character that the control's code lacks is named before anything goes out; what stands
/// in comments is left out.
#[test]
fn characters_that_the_code_lacks() {
    let mut job = plain_job();
    job.receiver.coding = Coding::Eia;
    let (rig, client) = &mut start(&job);
    put(
        client,
        9,
        &NINE.replace("M30", "#500=1\nM30"),
        Release::Always,
        5,
    );
    let alarm: Vec<u8> =
        umi_core::nc::withheld(9, &Withheld::NotInCode { byte: b'#' }, Coding::Eia)
            .bytes()
            .map(|ascii| umi_core::dprnt::encode(Coding::Eia, ascii).unwrap())
            .collect();
    client.program_offer(9).unwrap().unwrap();
    rig.control_sends(DC1);
    let got: Vec<u8> = receive_all(rig).chars().map(|c| c as u8).collect();
    assert_eq!(got, alarm);

    let (rig, client) = &mut start(&plain_job());
    put(
        client,
        9,
        &NINE.replace("M30", "(\u{d8} 10)\nM30"),
        Release::Always,
        5,
    );
    read(rig, 9);
    receive_text(rig, &NINE.replace("M30", "( 10)\nM30"));
}

/// A control that was reset and asks anew never gets the tail of what it had.
#[test]
fn a_new_request_ends_what_is_held() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, &long(), Release::Always, 600);
    let _ = stopped(rig, b"READ O1234\r\n\x11", 200);
    // RESET at the control; its program asks anew.
    rig.control_sends(b"READ O1234\r\n");
    rig.control_sends(DC1);
    let again = receive_all(rig);
    assert!(
        again.starts_with("%\n"),
        "TAIL {:?}",
        &again[..60.min(again.len())]
    );
}

/// Nor does one that was reset while it read a correction; which may be read again.
#[test]
fn a_request_ends_a_correction_that_is_held() {
    let (rig, client) = &mut start(&umi_tests::cases::job());
    put(client, 9, NINE, Release::Always, 5);
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, client, 2);
    let correction = client.verdict().unwrap().unwrap().correction.unwrap().text;
    let _ = stopped(rig, DC1, 100);
    read(rig, 9);
    receive_text(rig, NINE);
    rig.control_sends(DC1);
    receive_text(rig, &correction);
}

/// Nor does one that asks for another.
#[test]
fn another_request_ends_what_is_held() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, &long(), Release::Always, 600);
    put(client, 9, NINE, Release::Always, 5);
    let _ = stopped(rig, b"READ O1234\r\n\x11", 200);
    rig.control_sends(b"READ O9\r\n");
    rig.control_sends(DC1);
    let again = receive_all(rig);
    assert!(
        again.starts_with("%\nO0009"),
        "TAIL of 1234 {:?}",
        &again[..60.min(again.len())]
    );
}

/// A program that goes out whenever it is asked for may print while it runs.
#[test]
fn what_prints_while_it_is_passed_goes_on() {
    let (rig, client) = &mut start(&plain_job());
    let text = long();
    let program = ProgramInfo {
        hold_s: 2,
        ..info(55, &text, Release::Always)
    };
    assert_eq!(client.program_pass(&program).unwrap(), Ok(0));
    rig.control_sends(DC1);
    let first: Piece = text.bytes().take(200).collect();
    let mut offset = 0;
    for _ in 0..50 {
        offset = client
            .program_passed(0, first.clone())
            .unwrap()
            .unwrap()
            .unwrap();
        if offset > 0 {
            break;
        }
        sleep(Duration::from_millis(10));
    }
    let mut got = receive_all(rig);
    rig.control_sends(b"X1. Q7\r\n");
    sleep(Duration::from_millis(100));
    let next = client.program_passed(offset, piece(&text, offset)).unwrap();
    sleep(Duration::from_millis(2500));
    got += &receive_all(rig);
    assert!(next.is_ok() || got.ends_with("M30\n"), "{next:?} {got:?}");
}

/// A line that cannot be rewritten stops the machine, and its next start brings nothing.
#[test]
fn a_refused_line_ends_what_is_passed() {
    let (rig, client) = &mut start(&plain_job());
    let text = POCKET.replace("M30", "G1 X#500\nM30");
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, client, 2);
    let program = info(55, &text, Release::Rewritten(SPEC));
    assert_eq!(client.program_pass(&program).unwrap(), Ok(0));
    rig.control_sends(DC1);
    let mut offset = 0u32;
    let mut got = String::new();
    let mut answers = Vec::new();
    for _ in 0..60 {
        let next = client.program_passed(offset, piece(&text, offset)).unwrap();
        answers.push(format!("{next:?}"));
        got += &receive_all(rig);
        if let Ok(Some(n)) = next {
            offset = n
        } else {
            break;
        }
        if got.contains("STOPPED") {
            break;
        }
    }
    assert!(got.contains("UMI STOPPED"), "{got:?}");
    // Cycle start: the control wants more.
    rig.control_sends(DC1);
    sleep(Duration::from_millis(50));
    for _ in 0..30 {
        let next = client.program_passed(offset, piece(&text, offset)).unwrap();
        answers.push(format!("{next:?}"));
        if let Ok(Some(n)) = next {
            offset = n
        } else {
            break;
        }
    }
    let again = receive_all(rig);
    assert_eq!(again, "", "RUNS AGAIN; answers {answers:?}");
}

/// Asked for another while the end of one goes out.
#[test]
fn a_request_at_the_end_is_kept() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, &long(), Release::Always, 5);
    put(client, 9, NINE, Release::Always, 5);
    let _ = stopped(rig, b"READ O1234\r\n\x11", 1000);
    rig.control_sends(b"READ O9\r\n\x11");
    let rest = receive_all(rig);
    assert_eq!(rest, NINE);
}

/// As it is, but the correction that it needs has not been read.
#[test]
fn nothing_goes_out_before_its_correction() {
    let (rig, client) = &mut start(&umi_tests::cases::job());
    put(client, 1234, POCKET, Release::AfterVerdict, 5);
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, client, 2);
    read(rig, 1234);
    let got = receive_all(rig);
    assert_eq!(got, alarm_of(1234, &Withheld::NotCorrected));
}

/// A READ long after a program that could be held for long is a READ.
#[test]
fn a_long_hold_ends_with_its_program() {
    let (rig, client) = &mut start(&umi_tests::cases::job());
    put(client, 9, POCKET, Release::Always, 600);
    read(rig, 9);
    receive_text(rig, POCKET);
    rig.control_sends(XOFF);
    sleep(Duration::from_secs(6));
    rig.control_sends(DC1);
    assert_eq!(receive_all(rig), alarm());
}

/// What the control has asked for it gets, whatever a host offers meanwhile.
#[test]
fn an_offer_does_not_replace_a_request() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, POCKET, Release::Always, 5);
    put(client, 9, NINE, Release::Always, 5);
    rig.control_sends(b"READ O1234\r\n");
    sleep(Duration::from_millis(100));
    let offered = client.program_offer(9).unwrap();
    rig.control_sends(DC1);
    let got = receive_all(rig);
    assert!(got.starts_with("%\nO1234"), "{offered:?} {got:?}");
}

/// Lines ended by CR alone stay lines where the code has one end of block.
#[test]
fn eia_gets_every_end_of_block() {
    let mut job = plain_job();
    job.receiver.coding = Coding::Eia;
    let (rig, client) = &mut start(&job);
    put(
        client,
        9,
        "%\rO0009\rG1X10.\rY20.\rM30\r%\r",
        Release::Always,
        5,
    );
    client.program_offer(9).unwrap().unwrap();
    rig.control_sends(DC1);
    let mut bytes = Vec::new();
    while let Some(byte) = rig.control_receives(Duration::from_millis(100)) {
        bytes.push(byte)
    }
    let blocks = bytes.iter().filter(|b| **b == 0x80).count();
    assert!(
        blocks >= 5,
        "{blocks} ends of block in {} bytes {bytes:02X?}",
        bytes.len()
    );
}

/// NAK and READ in one go: the program from its beginning.
#[test]
fn given_up_and_asked_again_at_once() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, &long(), Release::Always, 5);
    let _ = stopped(rig, b"READ O1234\r\n\x11", 200);
    rig.control_sends(&[0x15, 0x11]);
    let again = receive_all(rig);
    assert!(
        again.starts_with("%\n"),
        "{:?}",
        &again[..60.min(again.len())]
    );
}

/// No number, no bytes.
#[test]
fn what_cannot_be_passed_is_refused() {
    let (_rig, client) = &mut start(&plain_job());
    let mut bad = Vec::new();
    for number in [0, 100_000_000] {
        let p = info(number, POCKET, Release::Always);
        bad.push(client.program_pass(&p).unwrap());
    }
    bad.push(client.program_pass(&info(5, "", Release::Always)).unwrap());
    assert!(bad.iter().all(Result::is_err), "{bad:?}");
}

/// What is passed and has another check value loses its last bytes.
#[test]
fn what_is_damaged_gets_no_end() {
    let (rig, client) = &mut start(&plain_job());
    let mut p = info(55, POCKET, Release::Always);
    p.crc32 ^= 1;
    assert_eq!(client.program_pass(&p).unwrap(), Ok(0));
    rig.control_sends(DC1);
    sleep(Duration::from_millis(50));
    let mut offset = 0;
    let mut got = String::new();
    for _ in 0..10 {
        if let Ok(Some(n)) = client
            .program_passed(offset, piece(POCKET, offset))
            .unwrap()
        {
            offset = n
        }
        got += &receive_all(rig);
        if got.len() >= POCKET.len() {
            break;
        }
    }
    assert!(!got.contains("M30\n%\n"), "{got:?}");
}

/// Asked for a program in the same breath in which the verdict comes.
#[test]
fn a_correction_that_goes_out_by_itself_comes_first() {
    let mut job = umi_tests::cases::job();
    job.correction.as_mut().unwrap().send = umi_protocol::job::SendWhen::OnVerdict;
    let (rig, client) = &mut start(&job);
    put(client, 1234, POCKET, Release::AfterVerdict, 5);
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, client, 1);
    let _ = receive_all(rig);
    rig.control_sends((clamping(1) + "READ O1234\r\n\x11").as_bytes());
    let mut got = String::new();
    for _ in 0..10 {
        got += &receive_all(rig);
    }
    assert!(got.starts_with("%\nO9010"), "{got:?}");
}

/// OK, then NG.
#[test]
fn an_ng_verdict_releases_nothing() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, POCKET, Release::AfterVerdict, 5);
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, client, 1);
    rig.control_sends(clamping(1).replacen("148.7960", "149.7960", 1).as_bytes());
    sleep(Duration::from_millis(800));
    let verdict = client.verdict().unwrap().unwrap();
    assert!(!verdict.ok && verdict.plate == 1);
    read(rig, 1234);
    let got = receive_all(rig);
    assert_eq!(got, alarm_of(1234, &Withheld::NoVerdict));
}

/// Beyond the plate time-out nothing begins, and the output says so.
#[test]
fn a_verdict_grows_too_old() {
    let mut job = plain_job();
    job.plate_timeout_s = 2;
    job.receiver.idle_timeout_s = 1;
    let (rig, client) = &mut start(&job);
    put(client, 1234, POCKET, Release::AfterVerdict, 5);
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, client, 1);
    sleep(Duration::from_millis(2500));
    let lights = rig.lights();
    read(rig, 1234);
    let got = receive_all(rig);
    assert_eq!(got, alarm_of(1234, &Withheld::NoVerdict));
    assert!(!lights.ok, "the OK output is still on after the time-out");
}

/// In the middle, for good.
#[test]
fn what_is_measured_again_takes_it_back() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, &long(), Release::AfterVerdict, 5);
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, client, 1);
    let _ = stopped(rig, b"READ O1234\r\n\x11", 200);
    rig.control_sends(b"X1. Q7\r\n");
    sleep(Duration::from_millis(200));
    rig.control_sends(DC1);
    assert_eq!(receive_all(rig), "");
    rig.control_sends(DC1);
    assert_eq!(receive_all(rig), "");
    read(rig, 1234);
    assert_eq!(receive_all(rig), alarm_of(1234, &Withheld::NoVerdict));
}

/// The last one without its end, too.
#[test]
fn lines_ended_by_cr_are_rewritten() {
    let (rig, client) = &mut start(&plain_job());
    let text = POCKET.trim_end().replace('\n', "\r");
    put(client, 1234, &text, Release::Rewritten(SPEC), 5);
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, client, 2);
    let verdict = client.verdict().unwrap().unwrap();
    let expected = rewritten(&text, &plain_job(), &verdict);
    read(rig, 1234);
    let got = receive_all(rig);
    assert_eq!(got.trim_end(), expected.trim_end());
}

/// What a host sends behind the length that it said.
#[test]
fn nothing_goes_out_beyond_the_end() {
    let (rig, client) = &mut start(&plain_job());
    let text = "%\nO55\nG0 X1.\nM30\n%\n";
    assert_eq!(
        client
            .program_pass(&info(55, text, Release::Always))
            .unwrap(),
        Ok(0)
    );
    rig.control_sends(DC1);
    sleep(Duration::from_millis(50));
    let more = text.to_owned() + "O66\nG0 Z-99.\nM30\n%\n";
    let next = client.program_passed(0, more.bytes().collect()).unwrap();
    let got = receive_all(rig);
    assert!(!got.contains("Z-99"), "{next:?} {got:?}");
}

/// However often it asks for something else.
#[test]
fn a_host_that_hangs_does_not_hold_the_line() {
    let (rig, client) = &mut start(&plain_job());
    let text = long();
    let p = ProgramInfo {
        hold_s: 1,
        ..info(55, &text, Release::Always)
    };
    assert_eq!(client.program_pass(&p).unwrap(), Ok(0));
    rig.control_sends(DC1);
    for _ in 0..20 {
        sleep(Duration::from_millis(200));
        client.status().unwrap();
    }
    // Where the machine stands in it nobody knows.
    rig.control_sends(DC1);
    receive_text(rig, &alarm_of(55, &Withheld::HeldTooLong));
    let busy = client.program_pass(&p).unwrap();
    assert!(
        busy.is_ok(),
        "four seconds without a byte, hold 1 s: {busy:?}"
    );
}

/// Although something was printed before the host asked.
#[test]
fn what_has_gone_out_is_said_to_have() {
    let (rig, client) = &mut start(&plain_job());
    let text = "%\nO55\nG0 X1.\nM30\n%\n";
    assert_eq!(
        client
            .program_pass(&info(55, text, Release::Always))
            .unwrap(),
        Ok(0)
    );
    rig.control_sends(DC1);
    sleep(Duration::from_millis(50));
    let _ = client.program_passed(0, text.bytes().collect()).unwrap();
    assert_eq!(receive_all(rig), text);
    rig.control_sends(b"X1. Q7\r\n");
    sleep(Duration::from_millis(100));
    let done = client
        .program_passed(text.len() as u32, [].into_iter().collect())
        .unwrap();
    assert_eq!(done, Ok(None));
}

/// What a control prints while the board waits for blocks of XMODEM is no block: it is
/// lost, that is journaled, and the verdict before it does not hold any more.
#[test]
fn lines_that_come_for_blocks_are_a_loss() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, POCKET, Release::AfterVerdict, 5);
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, client, 1);
    client.program_receive().unwrap().unwrap();
    assert_eq!(receive(rig, 1), "\u{15}");
    rig.control_sends(clamping(1).as_bytes());
    rig.control_sends(&[0x18, 0x18]);
    let lost = until(rig, "the loss", |_| {
        let (records, _) = journal(client);
        records.iter().find_map(|record| match record {
            Record::BytesLost { count } => Some(*count),
            _ => None,
        })
    });
    assert_eq!(lost as usize, clamping(1).len() + 2);
    // Behind a loss a line counts from where one begins for sure.
    rig.control_sends(b"\r\n");
    read(rig, 1234);
    let got = receive_all(rig);
    assert!(
        got.ends_with(&alarm_of(1234, &Withheld::NoVerdict)),
        "{got}"
    );
}
