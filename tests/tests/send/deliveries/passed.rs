//! What a host passes through and what a program is made of, on the virtual board: no end behind what is damaged, and each side is told.

use std::thread::sleep;
use std::time::Duration;

use umi_protocol::pattern::Coding;
use umi_protocol::program::{Piece, ProgramInfo, ProgramRefusal, Release, Withheld};
use umi_tests::cases::*;
use umi_tests::rig::Rig;

use super::common::*;

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
