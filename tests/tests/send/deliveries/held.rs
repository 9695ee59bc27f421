//! What a control asks for and does not take, on the virtual board, in its real time: what is held ends, is replaced, and never begins by itself.

use std::thread::sleep;
use std::time::Duration;

use umi_protocol::message::Record;
use umi_protocol::program::{Release, Withheld};
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
