//! Programs on their way to the control, on every board: what a READ gets and what it does
//! not, rewritten to the bit as on the host, held, broken off, begun anew.

mod blocks;
mod common;
mod held;
mod judged;
mod kept;
mod passed;

use umi_client::programs;
use umi_core::correction::{RunCheck, withheld};
use umi_core::rewrite::{RewriteDialect, RewriteSettings, StartModes};
use umi_protocol::job::{Dialect, SendWhen, WorkOffset};
use umi_protocol::message::Record;
use umi_protocol::pattern::Coding;
use umi_protocol::program::{
    ProgramInfo, ProgramRefusal, Release, Stated, StatedDialect, Withheld,
};
use umi_protocol::reason::Reason;
use umi_protocol::verdict::SetupReason;
use umi_tests::cases::*;
use umi_tests::damage::announced;
use umi_tests::rig::Rig;

use common::*;

umi_tests::on_every_board! {
    reads_programs_by_their_number
    rewrites_a_program_by_the_verdict
    rewrites_by_what_was_said_of_a_program
    rewrites_only_where_the_part_was_probed
    rewrites_for_one_run
    refuses_what_cannot_be_rewritten_before_its_first_byte
    begins_anew_what_the_control_broke_off
    sends_nothing_runnable_after_a_reset
    passes_a_program_through
    keeps_what_the_control_punches
    sends_by_xmodem_to_a_control_that_asks_so
    receives_by_xmodem_when_the_host_says_so
}

/// One that probes whenever it is asked for; one that needs a verdict, once; one that is not
/// there; and none that was not asked for. A request measures nothing, and what is measured
/// takes it back.
fn reads_programs_by_their_number(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    client.set_job(&plain_job()).unwrap().unwrap();
    let probing = POCKET.replace("O1234", "O0009");
    for (number, text, release) in [
        (1234, POCKET, Release::AfterVerdict),
        (9, probing.as_str(), Release::Always),
        (77, POCKET, Release::Never),
    ] {
        let info = info(number, text, release);
        programs::put(&mut client, &info, text.as_bytes(), |_| {}).unwrap();
    }
    read(rig, 9);
    receive_text(rig, &probing);
    read(rig, 1234);
    receive_text(rig, &alarm_of(1234, &Withheld::NoVerdict));
    read(rig, 77);
    receive_text(rig, &alarm_of(77, &Withheld::NotReleased));
    read(rig, 78);
    receive_text(rig, &alarm_of(78, &Withheld::NotThere));

    rig.control_sends(clamping(0).as_bytes());
    judged(rig, &mut client, 1);
    read(rig, 1234);
    receive_text(rig, POCKET);
    read(rig, 1234);
    receive_text(rig, &alarm_of(1234, &Withheld::GoneOut));
    // A READ alone: the job has no correction, and nothing is asked for.
    rig.control_sends(DC1);
    assert_eq!(receive_all(rig), "");
    rig.control_sends(clamping(1).as_bytes());
    judged(rig, &mut client, 2);
    // Asked for, then something is printed.
    rig.control_sends(b"READ O1234\r\nX1. Q7\r\n");
    rig.control_sends(DC1);
    assert_eq!(receive_all(rig), "");
    client.program_offer(1234).unwrap().unwrap();
    rig.control_sends(DC1);
    receive_text(rig, &alarm_of(1234, &Withheld::NoVerdict));

    let (records, findings) = journal(&mut client);
    let sent: Vec<_> = records
        .iter()
        .filter_map(|record| match record {
            // What gets an alarm instead has not begun.
            Record::ProgramBegun {
                number,
                rewritten_for,
                ..
            } => Some((*number, *rewritten_for, false)),
            Record::ProgramSent {
                number,
                rewritten_for,
                complete,
                ..
            } => Some((*number, *rewritten_for, *complete)),
            _ => None,
        })
        .collect();
    let both = |number| [(number, None, false), (number, None, true)];
    assert_eq!(sent, [both(9), both(1234)].concat());
    assert_eq!(findings.differences, []);
}

/// Byte for byte what the host's rewriter makes by the verdict's registration, stopped by
/// XOFF in the middle of a line on the way; once; and not where the job corrects already.
fn rewrites_a_program_by_the_verdict(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let job = plain_job();
    client.set_job(&job).unwrap().unwrap();
    let program = info(1234, POCKET, Release::Rewritten(SPEC));
    programs::put(&mut client, &program, POCKET.as_bytes(), |_| {}).unwrap();
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, &mut client, 2);
    let verdict = client.verdict().unwrap().unwrap();
    let expected = rewritten(POCKET, &job, &verdict);
    assert!(expected.len() > POCKET.len() + 200, "{expected}");

    let stop = expected.find(" F800").unwrap() - 2;
    let mut got = stopped(rig, b"READ O1234\r\n\x11", stop);
    rig.control_sends(DC1);
    got += &receive(rig, expected.len() - got.len());
    assert_eq!(got, expected);
    assert_eq!(receive_all(rig), "");
    read(rig, 1234);
    receive_text(rig, &alarm_of(1234, &Withheld::GoneOut));
    let (records, _) = journal(&mut client);
    assert!(records.contains(&Record::ProgramBegun {
        number: 1234,
        crc32: program.crc32,
        rewritten_for: Some(1),
    }));
    assert!(records.contains(&Record::ProgramSent {
        number: 1234,
        crc32: program.crc32,
        rewritten_for: Some(1),
        bytes: u32::try_from(expected.len()).unwrap(),
        complete: true,
    }));

    client.set_job(&umi_tests::cases::job()).unwrap().unwrap();
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, &mut client, 4);
    read(rig, 1234);
    receive_text(rig, &alarm_of(1234, &Withheld::CorrectedTwice));
}

/// A program that says neither its modes nor whose it is, and calls another: by what was said of
/// it the board writes the same bytes as the host. Without a word of that it is refused.
fn rewrites_by_what_was_said_of_a_program(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let job = plain_job();
    client.set_job(&job).unwrap().unwrap();
    let bare = "%\nO0088\nG0 X0. Y0. Z5.\nG81 X1. Y1. Z-1. R6. F100.\nG80\nM98 P9100\nM30\n%\n";
    let start = [900, 210, 170, 940, 980]
        .into_iter()
        .try_fold(StartModes::default(), StartModes::with)
        .unwrap();
    let mut program = info(88, bare, Release::Rewritten(SPEC));
    program.stated = Stated {
        start_packed: start.packed().unwrap(),
        dialect: StatedDialect::LinuxCnc,
        allow_call: 9100,
    };
    programs::put(&mut client, &program, bare.as_bytes(), |_| {}).unwrap();
    let mute = ProgramInfo {
        number: 89,
        stated: Stated::default(),
        ..program.clone()
    };
    programs::put(&mut client, &mute, bare.as_bytes(), |_| {}).unwrap();
    let kept = client.programs(0).unwrap().unwrap().1;
    assert!(kept.contains(&program) && kept.contains(&mute), "{kept:?}");
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, &mut client, 2);
    let verdict = client.verdict().unwrap().unwrap();
    let expected = rewritten_with(bare, &job, &verdict, |settings| RewriteSettings {
        start,
        dialect: Some(RewriteDialect::LinuxCnc),
        allowed_calls: "9100".parse().unwrap(),
        ..settings
    });
    read(rig, 88);
    assert_eq!(receive(rig, expected.len()), expected);
    assert_eq!(receive_all(rig), "");
    read(rig, 89);
    let why = Withheld::NotRewritable { line: 3, column: 4 };
    receive_text(rig, &alarm_of(89, &why));
}

/// The part was probed in G57, and turned: a program that runs in G54 is not carried, and one that
/// runs there is.
fn rewrites_only_where_the_part_was_probed(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let mut job = umi_tests::cases::job();
    if let Some(correction) = &mut job.correction {
        correction.send = SendWhen::Never;
        correction.probed_in = WorkOffset::G57;
    }
    client.set_job(&job).unwrap().unwrap();
    let there = POCKET.replace("G21 G90", "G57 G21 G90");
    for (number, text) in [(1234, POCKET), (1235, &there)] {
        put(&mut client, number, text, Release::Rewritten(SPEC), 5);
    }
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, &mut client, 2);
    let verdict = client.verdict().unwrap().unwrap();
    read(rig, 1234);
    let why = Withheld::NotRewritable { line: 4, column: 4 };
    receive_text(rig, &alarm_of(1234, &why));
    read(rig, 1235);
    let expected = rewritten(&there, &job, &verdict);
    assert_eq!(receive(rig, expected.len()), expected);
}

/// What the board keeps and what the host passes through: both begin with the comparison of the
/// run that was measured. A program that cannot have it does not go out.
fn rewrites_for_one_run(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let job = job_of_runs();
    client.set_job(&job).unwrap().unwrap();
    let kept = info(1234, POCKET, Release::Rewritten(SPEC));
    let shares = POCKET.replace("O1234(POCKET)\n", "O1235 ");
    let shared = info(1235, &shares, Release::Rewritten(SPEC));
    for (program, text) in [(&kept, POCKET), (&shared, &shares)] {
        programs::put(&mut client, program, text.as_bytes(), |_| {}).unwrap();
    }
    let of_run =
        |case: usize, run: u32| announced(run, [0.0; 3], false).join("\n") + "\n" + &clamping(case);
    rig.control_sends((of_run(0, 41) + &of_run(1, 42)).as_bytes());
    judged(rig, &mut client, 2);
    let verdict = client.verdict().unwrap().unwrap();
    assert!(verdict.ok, "{:?}", verdict.reasons);
    let is_open = |r: &SetupReason| {
        matches!(
            r.reason,
            Reason::NotGuarded {
                late_text: true,
                ..
            }
        )
    };
    assert!(
        !verdict.remarks.iter().any(is_open),
        "{:?}",
        verdict.remarks
    );
    let expected = |text: &str| {
        rewritten_with(text, &job, &verdict, |settings| RewriteSettings {
            source: (settings.source.as_str().to_owned() + " - RUN 42")
                .parse()
                .unwrap(),
            run: RunCheck::of(Dialect::G10G68, 531, 42),
            ..settings
        })
    };
    let text = expected(POCKET);
    let first = text.lines().find(|line| !line.starts_with(['%', 'O', '(']));
    assert_eq!(
        first,
        Some("IF[#531NE42]THEN#3000=2(UMI PROGRAM OF RUN 42)")
    );
    read(rig, 1234);
    receive_text(rig, &text);
    read(rig, 1235);
    let why = Withheld::NotRewritable { line: 2, column: 1 };
    receive_text(rig, &alarm_of(1235, &why));

    let passed = POCKET.replace("1234", "0055");
    let program = info(55, &passed, Release::Rewritten(SPEC));
    assert_eq!(client.program_pass(&program).unwrap(), Ok(0));
    rig.control_sends(DC1);
    let mut offset = 0;
    let mut got = String::new();
    until(rig, "all of it", |rig| {
        let piece = piece(&passed, offset);
        let next = client.program_passed(offset, piece).unwrap().unwrap();
        got += &receive_all(rig);
        offset = next.unwrap_or(offset);
        next.is_none().then_some(())
    });
    got += &receive_all(rig);
    assert_eq!(got, expected(&passed));
}

/// The alarm names the line, and not a byte of the program goes out.
fn refuses_what_cannot_be_rewritten_before_its_first_byte(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    client.set_job(&plain_job()).unwrap().unwrap();
    let text = POCKET.replace("M30", "G1 X#500\nM30");
    let program = info(1234, &text, Release::Rewritten(SPEC));
    programs::put(&mut client, &program, text.as_bytes(), |_| {}).unwrap();
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, &mut client, 2);
    read(rig, 1234);
    let line = text.lines().position(|line| line.contains('#')).unwrap() + 1;
    let why = Withheld::NotRewritable {
        line: u32::try_from(line).unwrap(),
        column: 4,
    };
    receive_text(rig, &alarm_of(1234, &why));
}

/// A control that says that it will not go on has a part without an end; its next READ gets
/// the program from its beginning. Meanwhile it is not deleted, and the host's cable matters
/// to none of this.
fn begins_anew_what_the_control_broke_off(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    let text = long();
    let program = info(1234, &text, Release::Always);
    programs::put(&mut client, &program, text.as_bytes(), |_| {}).unwrap();
    client.set_job(&plain_job()).unwrap().unwrap();
    let got = stopped(rig, b"READ O1234\r\n\x11", 60);
    let refused = client.program_delete(1234).unwrap();
    assert_eq!(refused, Err(ProgramRefusal::Busy));
    // NAK: it has an alarm.
    rig.control_sends(&[0x15]);
    assert_eq!(receive_all(rig), "", "no tail");
    assert!(text.starts_with(&got) && got.len() < text.len());
    drop(client);
    rig.unplug();
    rig.control_sends(DC1);
    receive_text(rig, &text);
    let mut client = connect(rig);
    let (records, _) = journal(&mut client);
    let sent = records.iter().filter_map(|record| match record {
        Record::ProgramSent {
            bytes, complete, ..
        } => Some((*bytes as usize, *complete)),
        _ => None,
    });
    assert!(sent.eq([(got.len(), false), (text.len(), true)]));
    client.program_delete(1234).unwrap().unwrap();
}

/// The power fails in the middle: what went out has no end, nothing comes by itself, and
/// without its verdict the board has none for it any more. The journal says that it had begun,
/// and no more of it.
fn sends_nothing_runnable_after_a_reset(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    client.set_job(&plain_job()).unwrap().unwrap();
    let text = long();
    let program = info(1234, &text, Release::AfterVerdict);
    programs::put(&mut client, &program, text.as_bytes(), |_| {}).unwrap();
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, &mut client, 1);
    read(rig, 1234);
    let got = receive(rig, 100);
    drop(client);
    rig.power_cycle();
    let rest = receive_all(rig);
    assert!(!(got + &rest).ends_with("%\n"));
    let mut client = connect(rig);
    rig.control_sends(DC1);
    assert_eq!(receive_all(rig), "");
    read(rig, 1234);
    receive_text(rig, &alarm_of(1234, &Withheld::NoVerdict));
    let (room, _) = programs::list(&mut client).unwrap();
    assert_eq!(room.programs, 1);
    let (records, findings) = journal(&mut client);
    assert_eq!(findings.differences, []);
    let begun = Record::ProgramBegun {
        number: 1234,
        crc32: program.crc32,
        rewritten_for: None,
    };
    let programs = records
        .iter()
        .filter(|of| matches!(of, Record::ProgramBegun { .. } | Record::ProgramSent { .. }));
    assert!(programs.eq([&begun]));
}

/// What the host passes through comes as it is, at the speed of the line. When the host is
/// gone before its end, the control gets a stop behind a whole line, and no end.
fn passes_a_program_through(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    client.set_job(&plain_job()).unwrap().unwrap();
    let mut text = POCKET.replace("M30\n%\n", "");
    for line in 0..40 {
        text += &format!("G1 X{line}.5 Y-{line}.25\n");
    }
    text += "M30\n%\n";
    let program = info(55, &text, Release::Always);
    assert_eq!(client.program_pass(&program).unwrap(), Ok(0));
    rig.control_sends(DC1);
    let mut got = String::new();
    let mut offset = 0;
    let ends = until(rig, "all of it", |rig| {
        let rest = &text.as_bytes()[offset as usize..];
        let piece = rest.iter().copied().take(200).collect();
        let next = client.program_passed(offset, piece).unwrap().unwrap();
        got += &receive_all(rig);
        offset = next.unwrap_or(offset);
        next.is_none().then_some(true)
    });
    assert!(ends);
    got += &receive_all(rig);
    assert_eq!(got, text);
    let done = client.program_passed(0, [0x20].into_iter().collect());
    assert_eq!(done.unwrap(), Ok(None));

    assert_eq!(client.program_pass(&program).unwrap(), Ok(0));
    rig.control_sends(DC1);
    let lines = text.find("G1 X3.5").unwrap();
    let mut offset = 0;
    let mut got = until(rig, "a part of it", |rig| {
        let rest = &text.as_bytes()[offset as usize..lines];
        let piece = rest.iter().copied().take(200).collect();
        let next = client.program_passed(offset, piece).unwrap().unwrap();
        offset = next.unwrap();
        (offset as usize == lines).then(|| receive_all(rig))
    });
    drop(client);
    rig.unplug();
    got += &receive_all(rig);
    assert!(got.ends_with("#3000=3(UMI STOPPED)\nM30\n"), "{got}");
    assert!(text.starts_with(got.strip_suffix("#3000=3(UMI STOPPED)\nM30\n").unwrap()));
}

/// From `%` to `%`, whatever code and line ends it comes in; not in place of another, not
/// without its end, and nothing of it goes out before somebody has released it.
fn keeps_what_the_control_punches(rig: &mut dyn Rig) {
    let mut client = connect(rig);
    client.set_job(&plain_job()).unwrap().unwrap();
    let text = long().replace("O1234(POCKET)", "O4321(BRACKET)");
    let punched = |text: &str| {
        let even = |byte: u8| byte | u8::from(byte.count_ones() % 2 == 1) << 7;
        let mut bytes = vec![0x12, 0, 0];
        bytes.extend(text.replace('\n', "\n\r\r").bytes().map(even));
        bytes.extend([0, 0, 0x14]);
        bytes
    };
    // The power goes in the middle of the first.
    let bytes = punched(&text);
    rig.control_sends(&bytes[..1000]);
    until(rig, "the first bytes", |_| {
        (client.status().unwrap().counters.bytes >= 1000).then_some(())
    });
    drop(client);
    rig.power_cycle();
    let mut client = connect(rig);
    assert_eq!(programs::list(&mut client).unwrap().1, []);

    rig.control_sends(&bytes);
    let listed = until(rig, "the program", |_| {
        let (_, listed) = programs::list(&mut client).unwrap();
        (!listed.is_empty()).then_some(listed)
    });
    let info = ProgramInfo {
        name: "BRACKET".parse().unwrap(),
        ..self::info(4321, &text, Release::Never)
    };
    assert_eq!(listed, std::slice::from_ref(&info));
    let got = programs::get(&mut client, &info, |_| {}).unwrap();
    assert_eq!(String::from_utf8(got).unwrap(), text);
    rig.control_sends(&punched(&text.replace("X3.5", "X3.6")));
    let records = until(rig, "the refusal", |_| {
        let (records, _) = journal(&mut client);
        let is = |record: &Record| matches!(record, Record::ProgramNotKept { .. });
        records.iter().any(is).then_some(records)
    });
    assert!(records.contains(&Record::ProgramNotKept {
        number: 4321,
        why: ProgramRefusal::OtherThere { crc32: info.crc32 },
    }));
    assert_eq!(programs::list(&mut client).unwrap().1, [info]);
    // It asks in the code in which it punches.
    let even = |byte: u8| byte | u8::from(byte.count_ones() % 2 == 1) << 7;
    let asks: Vec<u8> = b"READ O4321\r\n".iter().map(|byte| even(*byte)).collect();
    rig.control_sends(&asks);
    rig.control_sends(DC1);
    let alarm = withheld(4321, &Withheld::NotReleased, Coding::IsoEven);
    let got = receive_all(rig);
    let plain: String = got.chars().map(|c| char::from(c as u8 & 0x7F)).collect();
    assert_eq!(plain, alarm.as_str());
}

/// A control that reads by XMODEM and answers each block, one of them with NAK: the program,
/// padded, each block of it once but for that one. A NAK without anything to send is
/// nothing.
fn sends_by_xmodem_to_a_control_that_asks_so(rig: &mut dyn Rig) {
    const NAK: &[u8] = &[0x15];
    let mut client = connect(rig);
    client.set_job(&plain_job()).unwrap().unwrap();
    let program = info(1234, POCKET, Release::Always);
    programs::put(&mut client, &program, POCKET.as_bytes(), |_| {}).unwrap();
    rig.control_sends(NAK);
    assert_eq!(receive_all(rig), "");
    client.program_offer(1234).unwrap().unwrap();
    rig.control_sends(NAK);
    // Haas controls ask more than once.
    rig.control_sends(NAK);
    let mut came = Vec::new();
    let mut is_refused = false;
    loop {
        let first = receive(rig, 1);
        if first == "\u{4}" {
            break;
        }
        assert_eq!(first, "\u{1}");
        let frame: Vec<u8> = receive(rig, 131).chars().map(|c| c as u8).collect();
        let number = frame[0];
        assert_eq!(usize::from(number), came.len() / 128 + 1);
        assert_eq!(frame[1], !number);
        let sum = frame[2..130]
            .iter()
            .fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        assert_eq!(frame[130], sum);
        if number == 2 && !is_refused {
            is_refused = true;
            rig.control_sends(NAK);
            continue;
        }
        came.extend(&frame[2..130]);
        rig.control_sends(&[0x06]);
    }
    rig.control_sends(&[0x06]);
    let (text, padding) = came.split_at(POCKET.len());
    assert_eq!(String::from_utf8_lossy(text), POCKET);
    assert!(padding.len() < 128 && padding.iter().all(|byte| *byte == 0x1A));
    assert!(is_refused);
    let sent = until(rig, "its record", |_| {
        let (records, _) = journal(&mut client);
        records.into_iter().find_map(|record| match record {
            Record::ProgramSent {
                bytes, complete, ..
            } => Some((bytes as usize, complete)),
            _ => None,
        })
    });
    assert_eq!(sent, (POCKET.len(), true));
    rig.control_sends(NAK);
    assert_eq!(receive_all(rig), "");
}

/// A control that sends by XMODEM, one block of it damaged and one twice: it is kept byte for
/// byte, under its number. One without its end is not, nor is one that never comes to an end;
/// and afterwards the control prints as before.
fn receives_by_xmodem_when_the_host_says_so(rig: &mut dyn Rig) {
    const NAK: &str = "\u{15}";
    const ACK: &str = "\u{6}";
    let mut client = connect(rig);
    client.set_job(&plain_job()).unwrap().unwrap();
    let text = format!("\n{}", POCKET.replace("O1234", "O5555"));
    let blocks: Vec<_> = (1..)
        .zip(text.as_bytes().chunks(128))
        .map(|(number, piece)| block(number, piece))
        .collect();
    assert!(blocks.len() > 1);

    asks_for_blocks(rig, &mut client);
    let mut damaged = blocks[0].clone();
    damaged[50] ^= 1;
    rig.control_sends(&damaged);
    assert_eq!(receive(rig, 1), NAK);
    for block in blocks.iter().chain(blocks.last()) {
        rig.control_sends(block);
        assert_eq!(receive(rig, 1), ACK);
    }
    rig.control_sends(&[4]);
    assert_eq!(receive(rig, 1), ACK);
    let listed = until(rig, "the program", |_| {
        let (_, listed) = programs::list(&mut client).unwrap();
        (!listed.is_empty()).then_some(listed)
    });
    let program = ProgramInfo {
        name: "POCKET".parse().unwrap(),
        ..info(5555, &text, Release::Never)
    };
    assert_eq!(listed, std::slice::from_ref(&program));
    let got = programs::get(&mut client, &program, |_| {}).unwrap();
    assert_eq!(String::from_utf8(got).unwrap(), text);

    // Without its last block.
    asks_for_blocks(rig, &mut client);
    rig.control_sends(&blocks[0]);
    assert_eq!(receive(rig, 1), ACK);
    rig.control_sends(&[4]);
    // An end counts when nothing follows it.
    assert_eq!(receive(rig, 1), "\u{18}");
    receive_all(rig);
    let records = until(rig, "the refusal", |_| {
        let (records, _) = journal(&mut client);
        let is = |record: &Record| matches!(record, Record::ProgramNotKept { .. });
        records.iter().any(is).then_some(records)
    });
    assert!(records.contains(&Record::ProgramNotKept {
        number: 5555,
        why: ProgramRefusal::BrokeOff,
    }));
    assert_eq!(programs::list(&mut client).unwrap().1, [program]);
    rig.control_sends(clamping(0).as_bytes());
    assert_eq!(judged(rig, &mut client, 1).verdicts_ok, 1);
}
