//! What a READ gets when there is no correction: a program that raises an alarm.

use core::fmt::{self, Write as _};

use heapless::String;
use umi_protocol::job::{CorrectionSpec, Dialect, ProgramEnd};
use umi_protocol::pattern::Coding;
use umi_protocol::program::Withheld;
use umi_protocol::verdict::MAX_CORRECTION;

use super::dialect::programs_compare_runs;
use super::run_check::{Compared, RunCheck};
use crate::dprnt::encode;

/// A program under the correction's number or name that stops whoever calls it, lines ended
/// by LF. It takes the place of an old correction in the control's memory, which therefore
/// can never run for a setup that has no OK verdict.
///
/// | control | how | from |
/// | --- | --- | --- |
/// | Fanuc's Custom Macro B and what follows it, Haas | `#3000` | their manuals; one without macros raises an alarm of its own about that block |
/// | the same in EIA, which has no `#` | `M00` | |
/// | Haas with `E` variables | zeros and a check value that is none: the macro O8830 raises its alarm, and says why | `hw/control/haas` |
/// | Siemens | `SETAL(65000, …)`, then `M0` for ever | public programs, which take 65000 and on for alarms of their own |
/// | Heidenhain | `FN 14: ERROR = 1072`, then a stop for ever | Autodesk's public post processor, which raises 1072 where a measured position is out of tolerance |
/// | LinuxCNC | `(ABORT, …)` | tried with its interpreter |
///
/// Those that call a program go on when it ends, and an operator can start again behind a
/// stop. Therefore it ends with `M30` where that ends the callers too, and does not end where
/// it may not.
///
/// Where the board knows which `run` taught the reference, a control in another run raises an alarm that names
/// it: late text of an older run may have taught. Haas with `E` variables compares by O8830; Siemens and
/// Heidenhain name the run and compare nothing, and so does EIA, which has no `#`, without the name.
///
/// None for GRBL: it keeps no programs, so no old correction waits in it, and it has no word
/// that raises an alarm (`M0` goes on with the next start; sleep lets go of the axes). None
/// where the line's code does not have the characters.
#[must_use]
pub fn alarm(
    spec: &CorrectionSpec,
    why: &Withheld,
    run: Option<RunCheck>,
    coding: Coding,
) -> Option<String<MAX_CORRECTION>> {
    let mut text = String::new();
    // Three hundred characters: there is room.
    let run = run.filter(|_| *why == Withheld::OnlyTaught);
    let _ = write(&mut text, spec, why, run, coding);
    let can_be_sent = text.bytes().all(|byte| encode(coding, byte).is_some());
    (can_be_sent && !text.is_empty()).then_some(text)
}

/// Whether the program by which a control learns that this setup was taught compares its run with the one that taught.
#[must_use]
pub fn alarm_compares(dialect: Dialect, coding: Coding) -> bool {
    programs_compare_runs(dialect) && coding != Coding::Eia
}

/// What the comment in such a program says: what to do.
const fn what_to_do(why: &Withheld) -> &'static str {
    match why {
        Withheld::OnlyTaught => "STANDS WHERE IT WAS TAUGHT - UMI TEACH KEEP OR AGAIN",
        Withheld::CorrectionGone => "EACH GOES OUT ONCE - PROBE THE PART",
        Withheld::JournalFull => "UMI LOG ACK - THEN PROBE THE PART",
        _ => "PROBE THE PART - READ WHAT THE BOARD SAYS OF IT",
    }
}

/// By what the macro O8830 tells apart why there is no correction.
const fn haas_code(why: &Withheld) -> u8 {
    match why {
        Withheld::OnlyTaught => 2,
        Withheld::CorrectionGone => 3,
        Withheld::JournalFull => 4,
        _ => 1,
    }
}

fn write(
    out: &mut String<MAX_CORRECTION>,
    spec: &CorrectionSpec,
    why: &Withheld,
    run: Option<RunCheck>,
    coding: Coding,
) -> fmt::Result {
    let number = spec.program_number;
    let (alarm, what_to_do) = (why.alarm(), what_to_do(why));
    match spec.dialect {
        Dialect::G10G68
        | Dialect::G68ThreeD
        | Dialect::FanucSettingError
        | Dialect::MazakSettingError
        | Dialect::MitsubishiSettingError
        | Dialect::Variables
        | Dialect::Haas => {
            let stop = match coding {
                Coding::Eia => "M00",
                _ => "#3000=1",
            };
            write!(out, "%\nO{number:04}(UMI NO CORRECTION)\n({what_to_do})\n")?;
            compare(out, run.filter(|_| coding != Coding::Eia))?;
            write!(out, "{stop}(UMI {alarm})\nM30\n%\n")
        }
        Dialect::HaasVariables => {
            // Nothing, and a check value that is not nothing's: it says why.
            for variable in 150..157 {
                writeln!(out, "E{variable} 0.")?;
            }
            if let Some(run) = run {
                writeln!(out, "E158 {}.", run.run())?;
            }
            writeln!(out, "E157 {}.", haas_code(why))
        }
        Dialect::Siemens => {
            write!(
                out,
                "%_N_UMI{number}_SPF\n;$PATH=/_N_SPF_DIR\n; UMI NO CORRECTION\n; UMI {alarm}\n; {what_to_do}\n\
                 UMI_STOP:\nSETAL(65000,\"UMI "
            )?;
            match run {
                Some(run) => write!(out, "TAUGHT BY RUN {}", run.run())?,
                None => out.write_str(alarm)?,
            }
            out.write_str("\")\nM0\nGOTOB UMI_STOP\nM30\n")
        }
        Dialect::Heidenhain => {
            write!(
                out,
                "BEGIN PGM UMI{number} MM\n; UMI NO CORRECTION\n; UMI {alarm}\n; {what_to_do}\n"
            )?;
            if let Some(run) = run {
                writeln!(out, "; UMI TAUGHT BY RUN {}", run.run())?;
            }
            write!(
                out,
                "LBL 1\nFN 14: ERROR = 1072\nSTOP\nFN 9: IF +0 EQU +0 GOTO LBL 1\nEND PGM UMI{number} MM\n"
            )
        }
        Dialect::LinuxCnc => {
            let (begin, end) = match spec.ends_with {
                ProgramEnd::M99 => ("o<umi_correction> sub\n", "o<umi_correction> endsub\n"),
                ProgramEnd::M30 => ("", ""),
            };
            write!(out, "{begin}(UMI NO CORRECTION)\n({what_to_do})\n")?;
            compare(out, run)?;
            write!(out, "(ABORT, UMI {alarm})\n{end}M2\n")
        }
        Dialect::Grbl => Ok(()),
    }
}

/// The lines that stop any other run than the one that taught.
#[inline(never)]
fn compare(out: &mut String<MAX_CORRECTION>, run: Option<RunCheck>) -> fmt::Result {
    run.map_or(Ok(()), |run| {
        run.lines(Compared::Taught, |line| writeln!(out, "{line}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use umi_protocol::job::{SendWhen, WorkOffset};

    fn spec(dialect: Dialect) -> CorrectionSpec {
        CorrectionSpec {
            dialect,
            probed_in: WorkOffset::G54,
            probed_origin_mm: [0.0; 3],
            write_to: WorkOffset::G55,
            set: None,
            program_number: 9010,
            ends_with: ProgramEnd::M99,
            part_min_mm: [0.0; 3],
            part_max_mm: [1.0; 3],
            leftover_mm: 0.01,
            send: SendWhen::OnRequest,
        }
    }

    const CODINGS: [Coding; 5] = [
        Coding::Auto,
        Coding::Ascii,
        Coding::IsoEven,
        Coding::AsciiOdd,
        Coding::Eia,
    ];

    /// The stop comes first, the program is whole, can be sent in every code, and nothing in
    /// it moves or sets anything.
    #[test]
    fn it_stops_and_does_nothing_else() {
        for coding in CODINGS {
            let text = alarm(&spec(Dialect::G10G68), &Withheld::NoVerdict, None, coding).unwrap();
            let expected = [
                "%",
                "O9010(UMI NO CORRECTION)",
                "(PROBE THE PART - READ WHAT THE BOARD SAYS OF IT)",
                match coding {
                    Coding::Eia => "M00(UMI NO OK VERDICT)",
                    _ => "#3000=1(UMI NO OK VERDICT)",
                },
                "M30",
                "%",
            ];
            assert!(text.lines().eq(expected), "{text}");
            assert!(text.ends_with("%\n"));
        }
    }

    /// Every control but GRBL gets one, under the name of its correction, that the line can
    /// carry; in EIA only those that have the characters.
    #[test]
    fn every_control_that_has_an_alarm_gets_it() {
        let whys = [
            Withheld::NoVerdict,
            Withheld::OnlyTaught,
            Withheld::CorrectionGone,
            Withheld::JournalFull,
        ];
        let each = whys
            .iter()
            .flat_map(|why| CODINGS.map(|coding| (why, coding)));
        for dialect in Dialect::ALL {
            for (why, coding) in each.clone() {
                let text = alarm(&spec(dialect), why, None, coding);
                let is_macro_b = matches!(
                    dialect,
                    Dialect::G10G68
                        | Dialect::G68ThreeD
                        | Dialect::FanucSettingError
                        | Dialect::MazakSettingError
                        | Dialect::MitsubishiSettingError
                        | Dialect::Variables
                        | Dialect::Haas
                        // Letters, digits, points.
                        | Dialect::HaasVariables
                );
                let has_one = dialect != Dialect::Grbl && (coding != Coding::Eia || is_macro_b);
                assert_eq!(text.is_some(), has_one, "{dialect:?} {coding:?}");
                let Some(text) = text else { continue };
                assert!(text.bytes().all(|byte| encode(coding, byte).is_some()));
                let head = match dialect {
                    Dialect::Siemens => "%_N_UMI9010_SPF\n",
                    Dialect::Heidenhain => "BEGIN PGM UMI9010 MM\n",
                    Dialect::LinuxCnc => "o<umi_correction> sub\n",
                    Dialect::HaasVariables => "E150 0.\n",
                    _ => "%\nO9010(",
                };
                assert!(text.starts_with(head), "{text}");
                assert!(text.lines().all(|line| line.len() < 64), "{text}");
                // It says what is so, within the 31 characters of Fanuc's screen; a Haas with
                // E variables says it by the macro that takes them.
                let says = std::format!("UMI {}", why.alarm());
                assert!(says.len() <= 31, "{says}");
                let is_said = text.contains(&says);
                assert_eq!(is_said, dialect != Dialect::HaasVariables, "{text}");
            }
        }
    }

    /// Siemens and Heidenhain have no interpreter here. What stands behind the alarm leads
    /// back to it, so that no start can leave the program.
    #[test]
    fn no_start_leaves_an_endless_stop() {
        for (dialect, label, stop, back) in [
            (
                Dialect::Siemens,
                "UMI_STOP:",
                &["SETAL(65000,\"UMI NO OK VERDICT\")", "M0"][..],
                "GOTOB UMI_STOP",
            ),
            (
                Dialect::Heidenhain,
                "LBL 1",
                &["FN 14: ERROR = 1072", "STOP"][..],
                "FN 9: IF +0 EQU +0 GOTO LBL 1",
            ),
        ] {
            let text = alarm(&spec(dialect), &Withheld::NoVerdict, None, Coding::Ascii).unwrap();
            let mut lines = text.lines().skip(1).filter(|line| !line.starts_with(';'));
            assert_eq!(lines.next(), Some(label));
            assert!(lines.by_ref().take(stop.len()).eq(stop.iter().copied()));
            assert_eq!(lines.next(), Some(back));
        }
    }
}
