//! What must not happen, whatever control and host do: on the virtual board, in its real
//! time.

use std::thread::sleep;
use std::time::Duration;

use umi_protocol::message::Record;
use umi_protocol::pattern::Coding;
use umi_protocol::program::{Piece, ProgramInfo, ProgramRefusal, Release, Withheld};
use umi_tests::cases::*;
use umi_tests::rig::Rig;

use super::common::*;

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
        umi_core::correction::withheld(9, &Withheld::NotInCode { byte: b'#' }, Coding::Eia)
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
    assert!(!verdict.ok && verdict.setup == 1);
    read(rig, 1234);
    let got = receive_all(rig);
    assert_eq!(got, alarm_of(1234, &Withheld::NoVerdict));
}

/// Beyond the setup time-out nothing begins, and the output says so.
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
    asks_for_blocks(rig, client);
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

/// A control that says XOFF behind the last `%` has all of it, whatever line ends were to
/// follow: neither a program nor a correction goes out again by the same verdict, and the
/// line is free at once.
#[test]
fn xoff_behind_the_last_percent_is_an_end() {
    let (rig, client) = &mut start(&plain_job());
    let text = POCKET.to_owned() + &"\n".repeat(60);
    put(client, 1234, &text, Release::AfterVerdict, 600);
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, client, 1);
    let got = stopped(rig, b"READ O1234\r\n\x11", POCKET.len());
    assert!(got.starts_with(POCKET) && got.len() < text.len());
    read(rig, 1234);
    receive_text(rig, &alarm_of(1234, &Withheld::GoneOut));

    let (rig, client) = &mut start(&umi_tests::cases::job());
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, client, 2);
    let correction = client.verdict().unwrap().unwrap().correction.unwrap().text;
    let got = stopped(rig, DC1, correction.len() - 1);
    assert!(correction.starts_with(&got));
    let (records, _) = journal(client);
    let is_whole =
        |record: &Record| matches!(record, Record::CorrectionSent { complete: true, .. });
    assert!(records.iter().any(is_whole));
    // A "go on" of what has ended is none for an alarm; a READ is.
    rig.control_sends(DC1);
    assert_eq!(receive_all(rig), "");
    rig.control_sends(DC1);
    receive_text(rig, &alarm_for(&Withheld::CorrectionGone));
}

/// Nobody knows whether it is all of a program: not its first byte goes out.
#[test]
fn what_does_not_end_with_percent_is_no_program() {
    let (rig, client) = &mut start(&plain_job());
    for text in [POCKET.trim_end_matches("%\n"), &long()[..1000]] {
        put(client, 1234, text, Release::Always, 5);
        read(rig, 1234);
        receive_text(rig, &alarm_of(1234, &Withheld::NoPercent));
    }
    put(
        client,
        1234,
        &(POCKET.to_owned() + "\0\r\n"),
        Release::Always,
        5,
    );
    read(rig, 1234);
    assert!(receive_all(rig).starts_with(POCKET));
}

/// What was passed through and has ended keeps no offer from being taken back.
#[test]
fn what_is_printed_takes_an_offer_back() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, POCKET, Release::Always, 5);
    let program = info(9, NINE, Release::Always);
    assert_eq!(client.program_pass(&program).unwrap(), Ok(0));
    rig.control_sends(DC1);
    let mut got = String::new();
    until(rig, "its end", |rig| {
        let next = client.program_passed(0, piece(NINE, 0)).unwrap().unwrap();
        got += &receive_all(rig);
        next.is_none().then_some(())
    });
    assert_eq!(got, NINE);
    client.program_offer(1234).unwrap().unwrap();
    rig.control_sends(b"X1. Q7\r\n\x11");
    assert_eq!(receive_all(rig), "");
}

/// A NAK is also an alarm of controls that know no blocks, or noise. Until a block is
/// acknowledged, what the control says is heard: it reads and prints as ever.
#[test]
fn blocks_end_where_the_control_says_something_else() {
    let mut job = umi_tests::cases::job();
    job.receiver.idle_timeout_s = 1;
    let (rig, client) = &mut start(&job);
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, client, 2);
    let correction = client.verdict().unwrap().unwrap().correction.unwrap().text;
    rig.control_sends(&[0x15]);
    assert_eq!(receive(rig, 1), "\u{1}");
    assert_eq!(receive_all(rig).chars().count(), 131);
    rig.control_sends(DC1);
    receive_text(rig, &correction);
    // Until then a NAK is part of the line behind it.
    let line = Duration::from_millis(1500);
    sleep(line);
    rig.control_sends(clamping(2).as_bytes());
    assert_eq!(judged(rig, client, 3).verdicts_ok, 3);
    rig.control_sends(&[0x15]);
    assert_eq!(receive(rig, 1), "\u{1}");
    sleep(line);
    rig.control_sends(clamping(3).as_bytes());
    assert_eq!(judged(rig, client, 4).verdicts_ok, 4);
}

/// What began on a plain line and broke off there: a NAK is an alarm of that control.
#[test]
fn what_began_on_a_plain_line_does_not_go_on_in_blocks() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, &long(), Release::Always, 5);
    let _ = stopped(rig, b"READ O1234\r\n\x11", 200);
    for _ in 0..2 {
        rig.control_sends(&[0x15]);
        sleep(Duration::from_millis(700));
        assert_eq!(receive_all(rig), "");
    }
    rig.control_sends(DC1);
    receive_text(rig, &long());
}

/// What a control says while a block goes out answers nothing: neither is the block sent
/// twice nor the next one begun before it is acknowledged.
#[test]
fn what_comes_in_the_middle_of_a_block_is_no_answer_to_it() {
    for answer in [0x15, 0x06] {
        let (rig, client) = &mut start(&plain_job());
        put(client, 1234, POCKET, Release::Always, 5);
        client.program_offer(1234).unwrap().unwrap();
        rig.control_sends(&[0x15]);
        let first = receive(rig, 60);
        rig.control_sends(&[answer]);
        let rest = receive(rig, 72);
        assert_eq!(receive_all(rig), "", "{answer}");
        let sent: Vec<u8> = (first + &rest).chars().map(|c| c as u8).collect();
        assert_eq!(sent, block(1, &POCKET.as_bytes()[..128]));
        rig.control_sends(&[0x06]);
        assert_eq!(receive(rig, 2), "\u{1}\u{2}");
    }
}

/// The NAK that asked for it is no line that was printed: a program that needs a verdict
/// may take longer than a line may.
#[test]
fn blocks_may_take_longer_than_a_line() {
    let mut job = plain_job();
    job.receiver.idle_timeout_s = 1;
    let (rig, client) = &mut start(&job);
    put(client, 1234, POCKET, Release::AfterVerdict, 5);
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, client, 1);
    rig.control_sends(b"READ O1234\r\n\x15");
    receive(rig, 132);
    sleep(Duration::from_millis(1500));
    rig.control_sends(&[0x06]);
    assert_eq!(receive(rig, 2), "\u{1}\u{2}");
}

/// Without a verdict a control that reads by XMODEM gets nothing, and no alarm: NAK is what
/// it says in many states.
#[test]
fn a_nak_gets_no_alarm() {
    let (rig, _client) = &mut start(&umi_tests::cases::job());
    rig.control_sends(&[0x15]);
    sleep(Duration::from_millis(700));
    assert_eq!(receive_all(rig), "");
}

/// Blocks have eight bits, whatever parity the control prints with.
#[test]
fn blocks_have_no_parity() {
    let mut job = plain_job();
    job.receiver.coding = Coding::IsoEven;
    let (rig, client) = &mut start(&job);
    put(client, 9, NINE, Release::Always, 5);
    client.program_offer(9).unwrap().unwrap();
    rig.control_sends(&[0x15]);
    let sent: Vec<u8> = receive(rig, 132).chars().map(|c| c as u8).collect();
    assert_eq!(sent, block(1, NINE.as_bytes()));
}

/// A correction is taken back in the middle by what is printed, and does not go on.
#[test]
fn what_is_measured_again_takes_a_correction_back() {
    let (rig, client) = &mut start(&umi_tests::cases::job());
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, client, 2);
    let _ = stopped(rig, DC1, 100);
    rig.control_sends(b"X1. Q7\r\n");
    sleep(Duration::from_millis(200));
    rig.control_sends(DC1);
    assert_eq!(receive_all(rig), "");
    rig.control_sends(DC1);
    receive_text(rig, &alarm());
}

/// Once by a verdict, and not when that has grown too old.
#[test]
fn a_correction_goes_out_once() {
    let mut job = umi_tests::cases::job();
    let (rig, client) = &mut start(&job);
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, client, 2);
    let correction = client.verdict().unwrap().unwrap().correction.unwrap().text;
    rig.control_sends(DC1);
    receive_text(rig, &correction);
    rig.control_sends(DC1);
    receive_text(rig, &alarm_for(&Withheld::CorrectionGone));
    job.plate_timeout_s = 2;
    job.receiver.idle_timeout_s = 1;
    client.set_job(&job).unwrap().unwrap();
    rig.control_sends((clamping(0) + &clamping(2)).as_bytes());
    judged(rig, client, 4);
    sleep(Duration::from_millis(2500));
    rig.control_sends(DC1);
    receive_text(rig, &alarm());
}

/// XON of a control that was held, whatever was taken back before, is no READ when all is
/// out.
#[test]
fn a_go_on_is_no_read() {
    let (rig, client) = &mut start(&umi_tests::cases::job());
    put(client, 1234, &long(), Release::Always, 5);
    put(client, 9, NINE, Release::Always, 5);
    let _ = stopped(rig, b"READ O1234\r\n\x11", 200);
    read(rig, 9);
    receive_text(rig, NINE);
    let got = stopped(rig, b"READ O1234\r\n\x11", 200);
    rig.control_sends(b"\x11\x11");
    receive_text(rig, &long()[got.len()..]);
}

/// A "go on" that comes when all was over begins nothing: the program broke off by a NAK,
/// then XOFF and XON.
#[test]
fn a_go_on_begins_nothing_anew() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, &long(), Release::Always, 5);
    let _ = stopped(rig, b"READ O1234\r\n\x11", 200);
    rig.control_sends(&[0x15]);
    assert_eq!(receive_all(rig), "");
    rig.control_sends(b"\x13\x11");
    assert_eq!(receive_all(rig), "");
    rig.control_sends(DC1);
    receive_text(rig, &long());
}

/// Blank tape in a program is not sent, nor a `%` in a comment: controls end a program at
/// any. Other control codes are named beforehand: a
/// control would take them for flow control.
#[test]
fn control_codes_of_a_program() {
    let (rig, client) = &mut start(&plain_job());
    let text = NINE.replace("M30", "\0\0\x7FM30(AT 50% FEED)");
    put(client, 9, &text, Release::Always, 5);
    read(rig, 9);
    receive_text(rig, &NINE.replace("M30", "M30(AT 50 FEED)"));
    put(
        client,
        9,
        &NINE.replace("M30", "\x13M30"),
        Release::Always,
        5,
    );
    read(rig, 9);
    receive_text(rig, &alarm_of(9, &Withheld::NotInCode { byte: 0x13 }));
}

/// Behind half a line no stop goes out: it would be a part of that line.
#[test]
fn no_stop_behind_half_a_line() {
    let (rig, client) = &mut start(&plain_job());
    let text = long();
    let program = info(55, &text, Release::Always);
    assert_eq!(client.program_pass(&program).unwrap(), Ok(0));
    rig.control_sends(DC1);
    let half = text.find("X3.5").unwrap();
    let mut offset = 0;
    until(rig, "a part of it", |_| {
        let rest = text.as_bytes()[offset as usize..half].iter().copied();
        let next = client.program_passed(offset, rest.take(200).collect());
        offset = next.unwrap().unwrap().unwrap();
        (offset as usize == half).then_some(())
    });
    let mut got = receive_all(rig);
    rig.unplug();
    got += &receive_all(rig);
    assert_eq!(got, text[..half]);
}

/// Bytes of the host that stand elsewhere are not taken: what comes twice goes out once.
#[test]
fn what_is_passed_twice_goes_out_once() {
    let (rig, client) = &mut start(&plain_job());
    let text = long();
    let program = info(55, &text, Release::Always);
    assert_eq!(client.program_pass(&program).unwrap(), Ok(0));
    rig.control_sends(DC1);
    until(rig, "the first bytes", |_| {
        let next = client.program_passed(0, piece(&text, 0)).unwrap().unwrap();
        (next > Some(0)).then_some(())
    });
    let mut got = receive_all(rig);
    for _ in 0..3 {
        let next = client.program_passed(0, piece(&text, 0)).unwrap();
        assert_eq!(next, Ok(Some(200)));
        got += &receive_all(rig);
    }
    assert_eq!(got, text[..200]);
}

/// While one goes out the host can neither offer nor pass another; and what it had offered
/// to pass is gone with it.
#[test]
fn a_host_waits_for_what_goes_out() {
    let (rig, client) = &mut start(&plain_job());
    put(client, 1234, &long(), Release::Always, 600);
    put(client, 9, NINE, Release::Always, 5);
    client.program_offer(1234).unwrap().unwrap();
    let got = stopped(rig, DC1, 200);
    let busy = Err(ProgramRefusal::Busy);
    assert_eq!(client.program_offer(9).unwrap(), busy);
    let not_there = Err(ProgramRefusal::NotThere);
    let program = info(55, POCKET, Release::Always);
    assert_eq!(client.program_pass(&program).unwrap().map(drop), busy);
    rig.control_sends(DC1);
    receive_text(rig, &long()[got.len()..]);
    assert_eq!(client.program_offer(77).unwrap(), not_there);
    assert_eq!(client.program_pass(&program).unwrap(), Ok(0));
    rig.unplug();
    // The board sees it when it looks.
    sleep(Duration::from_millis(200));
    rig.control_sends(DC1);
    assert_eq!(receive_all(rig), "");
}

/// The flash is not written while a setup is measured, nor is the control asked for blocks.
#[test]
fn a_host_waits_for_a_setup() {
    let (rig, client) = &mut start(&plain_job());
    let half = clamping(0).len() / 2;
    rig.control_sends(&clamping(0).as_bytes()[..half]);
    until(rig, "half a setup", |_| {
        (client.status().unwrap().counters.bytes >= half as u64).then_some(())
    });
    let busy = Err(ProgramRefusal::Busy);
    let program = info(9, NINE, Release::Always);
    assert_eq!(client.program_begin(&program).unwrap(), busy);
    assert_eq!(client.program_receive().unwrap().map(|()| 0), busy);
    rig.control_sends(&clamping(0).as_bytes()[half..]);
    judged(rig, client, 1);
    assert_eq!(client.program_begin(&program).unwrap(), Ok(0));
}

/// The host is told what the control got in place of what it wanted to pass, and when it is
/// taken back.
#[test]
fn a_host_is_told_why_nothing_is_passed() {
    let (rig, client) = &mut start(&plain_job());
    let program = info(55, POCKET, Release::Rewritten(SPEC));
    assert_eq!(client.program_pass(&program).unwrap(), Ok(0));
    rig.control_sends(DC1);
    receive_text(rig, &alarm_of(55, &Withheld::NoVerdict));
    let why = ProgramRefusal::Withheld(Withheld::NoVerdict);
    assert_eq!(
        client.program_passed(0, piece(POCKET, 0)).unwrap(),
        Err(why)
    );
    assert_eq!(client.program_pass(&program).unwrap(), Ok(0));
    rig.control_sends(b"X1. Q7\r\n");
    let taken_back = until(rig, "the line", |_| {
        client.program_passed(0, piece(POCKET, 0)).unwrap().err()
    });
    assert_eq!(taken_back, ProgramRefusal::NotBegun);
}

/// What is taken back is cancelled, and what the control cancels has not gone out: it may
/// have it once more.
#[test]
fn blocks_that_break_off() {
    let mut job = plain_job();
    job.receiver.idle_timeout_s = 1;
    let (rig, client) = &mut start(&job);
    put(client, 1234, POCKET, Release::AfterVerdict, 5);
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, client, 1);
    rig.control_sends(b"READ O1234\r\n\x15");
    receive(rig, 132);
    rig.control_sends(&[0x18, 0x18]);
    // The NAK is part of a line for so long.
    sleep(Duration::from_millis(1500));
    assert_eq!(receive_all(rig), "");
    rig.control_sends(b"READ O1234\r\n\x15");
    receive(rig, 132);
    client.set_job(&plain_job()).unwrap().unwrap();
    rig.control_sends(&[0x06]);
    assert_eq!(receive_all(rig), "\u{18}\u{18}\u{18}");
    let (records, _) = journal(client);
    let is_whole = |record: &Record| match record {
        Record::ProgramSent { complete, .. } => Some(*complete),
        _ => None,
    };
    assert!(records.iter().filter_map(is_whole).eq([false, false]));
}
