//! Calls that mean nothing: what is not known is an alarm by name before anything moves or is
//! printed, and never something else that was not asked for.

use umi_core::brain::{Brain, Output};
use umi_core::dprnt::checked::check_value;
use umi_core::units::Micros;
use umi_protocol::fault::FaultCode;
use umi_protocol::job::Job;

use crate::macros::bench::*;

const BALL: &str = "[[body]]\nname = \"BALL\"\nshape = { sphere = { radius_mm = 10.0 } }\n\
                    position_mm = [0.0, 0.0, 60.0]\n";
const BEGIN: &str = "G21 G17 G40 G49 G80 G90 G94 G54\nG0 X1. Y2.\nG0 Z100.\n";

const LETTERS: &str = "ABCDEFHIJKMQRSTUVWXYZ";

/// The programs that a part program calls, with the letters that the head of each names.
fn called(family: Family) -> Vec<(u32, String)> {
    let programs = family.programs().into_iter().filter_map(|(name, text)| {
        let number: u32 = name.get(1..5)?.parse().ok()?;
        let letters = match number {
            8811 => "T W".to_owned(),
            8820..=8829 => {
                let call = format!("(G65 P{number} ");
                let head = text.lines().find_map(|line| line.strip_prefix(&call))?;
                head.trim_end_matches(')').to_owned()
            }
            _ => return None,
        };
        Some((number, letters))
    });
    programs.collect()
}

/// A letter that a program does not have is no other one: nothing is printed, nothing moves.
#[test]
fn a_letter_that_is_not_known_is_an_alarm() {
    for family in [Family::Fanuc, Family::Haas, Family::MitsubishiMazak] {
        let programs = called(family);
        assert_eq!(programs.len(), 11, "{family:?}");
        for (number, known) in programs {
            let begin = match number {
                8811 => BEGIN.to_owned(),
                _ => format!("{BEGIN}G65 P8811\n"),
            };
            let without = run_text(family, BALL, &begin);
            for letter in LETTERS.chars() {
                let text = format!("{begin}G65 P{number} {letter}1.\n");
                let ran = run_text(family, BALL, &text);
                let said = ran.alarm.as_ref().map(|alarm| alarm.message.clone());
                let named = said.is_some_and(|said| said.contains("LETTER"));
                let is_known = known.contains(letter);
                assert_eq!(named, !is_known, "{family:?} {number} {letter}");
                if !is_known {
                    assert_eq!(ran.bytes(), without.bytes(), "{number} {letter}");
                }
            }
        }
    }
}

/// T1. and T2. teach. Any other value is none of them: it is an alarm, and nothing is printed.
#[test]
fn other_values_do_not_teach() {
    for family in FAMILIES {
        for value in ["3.", "0.", "1.5", "-1.", "-2.", "11."] {
            let (call, says) = match family {
                Family::LinuxCnc if value == "0." => continue,
                Family::LinuxCnc => (format!("O<UMI_START> CALL [{value}]"), "NOT 0, 1 OR 2"),
                _ => (format!("G65 P8811 T{value}"), "T NOT 1. OR 2."),
            };
            let ran = run_text(family, BALL, &format!("{BEGIN}{call}\n"));
            ran.refused(says);
            assert_eq!(ran.bytes(), b"", "{family:?} {value}");
        }
    }
    for (values, says) in [
        ("[1] [54] [1]", "MORE THAN TWO VALUES"),
        ("[1] [54] [0] [0] [2]", "MORE THAN TWO VALUES"),
        ("[1] [-54]", "OTHER WORK OFFSET"),
        ("[1] [1]", "OTHER WORK OFFSET"),
    ] {
        let call = format!("{BEGIN}O<UMI_START> CALL {values}\n");
        let ran = run_text(Family::LinuxCnc, BALL, &call);
        ran.refused(says);
        assert_eq!(ran.bytes(), b"", "{values}");
    }
}

/// A line that asks for a teaching that there is none of teaches nothing: it is a fault by its
/// name, and the run is refused for the line that is missing.
#[test]
fn a_line_that_asks_for_something_else_teaches_nothing() {
    let job = job(Tip::OnBoard, &[(1, "sphere", 5, Some(10.0))]);
    let job: Job = toml::from_str(&format!("teach = \"asked\"\n{job}")).unwrap();
    let begin = format!("{BEGIN}G65 P8811 T1.\nG65 P8820 D20. B1. Q60.\n");
    let ran = run_text(Family::Fanuc, BALL, &begin);
    assert_eq!(ran.alarm, None);
    let text = String::from_utf8_lossy(ran.bytes()).into_owned();
    let asks = text
        .lines()
        .find(|line| line.replace(' ', "").contains("A8T0"))
        .unwrap();
    for (asked, taught) in [(0, true), (2, false), (9, false)] {
        let ten_thousand = |value: i64| value * 10_000;
        let fields = [1, 4, 0, 8, asked, 0, 0, 0, 0].map(ten_thousand);
        let check = check_value(&fields);
        let other = format!(
            "UMI1 R 1 S 4 B 0 A 8 T {asked} F 0.000 X 0.000 Y 0.000 Z 0.000 C {}.{:04}",
            check / 10_000,
            check % 10_000
        );
        let mut brain = Brain::new(job.clone()).unwrap();
        let (mut codes, mut faults, mut is_taught) = (Vec::new(), Vec::new(), false);
        let text = text.replace(asks, &other);
        let mut take = |output: Output<'_>| match output {
            Output::Fault(fault) => faults.push(fault.code()),
            Output::Taught(_) => is_taught = true,
            Output::Verdict(verdict) => {
                codes.extend(verdict.reasons.iter().map(|of| of.reason.code()));
            }
            _ => {}
        };
        brain.bytes(Micros(1), text.as_bytes(), &mut take);
        assert_eq!(is_taught, taught, "{asked}: {codes:?} {faults:?}");
        if !taught {
            assert!(faults.contains(&FaultCode::NumberFormat), "{faults:?}");
            assert!(codes.contains(&"sequence_gap"), "{codes:?}");
        }
    }
}
