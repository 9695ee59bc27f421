//! What goes out by a verdict, on the virtual board: never before it, never behind another measurement, and once.

use std::thread::sleep;
use std::time::Duration;

use umi_protocol::program::{Release, Withheld};
use umi_tests::cases::*;
use umi_tests::rig::Rig;

use super::common::*;

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
