//! What a READ gets when there is no correction: a program that raises an alarm.

use core::fmt::{self, Write as _};

use heapless::String;
use umi_protocol::job::{CorrectionSpec, Dialect};
use umi_protocol::pattern::Coding;
use umi_protocol::verdict::MAX_CORRECTION;

/// A program under the correction's number that stops whoever calls it, lines ended by LF.
/// It takes the place of an old correction in the control's memory, which therefore can
/// never run for a plate that has no OK verdict.
///
/// `#3000` raises an alarm in Fanuc's Custom Macro B and in what follows it; a control
/// without macros raises one of its own about that block. EIA has no `#`: there the program
/// stops, says why, and ends. It ends with `M30` in any case: who calls it does not go on,
/// even if an operator does.
///
/// None for controls of other languages: their corrections are no numbered programs.
#[must_use]
pub fn alarm(spec: &CorrectionSpec, coding: Coding) -> Option<String<MAX_CORRECTION>> {
    match spec.dialect {
        Dialect::G10G68
        | Dialect::G68ThreeD
        | Dialect::FanucSettingError
        | Dialect::MazakSettingError
        | Dialect::MitsubishiSettingError
        | Dialect::Variables
        | Dialect::Haas => {}
        Dialect::HaasVariables
        | Dialect::Siemens
        | Dialect::Heidenhain
        | Dialect::LinuxCnc
        | Dialect::Grbl => return None,
    }
    let mut text = String::new();
    // A hundred characters: there is room.
    let _ = macro_b(&mut text, spec.program_number, coding);
    Some(text)
}

fn macro_b(out: &mut String<MAX_CORRECTION>, number: u16, coding: Coding) -> fmt::Result {
    writeln!(out, "%\nO{number:04}(UMI NO CORRECTION)")?;
    writeln!(out, "(THERE IS NO OK VERDICT - PROBE AGAIN)")?;
    out.write_str(match coding {
        Coding::Eia => "M00(UMI NO OK VERDICT)\n",
        _ => "#3000=1(UMI NO OK VERDICT)\n",
    })?;
    out.write_str("M30\n%\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dprnt::encode;
    use umi_protocol::job::{ProgramEnd, SendWhen, WorkOffset};

    /// The stop comes first, the program is whole, can be sent in every code, and nothing in
    /// it moves or sets anything.
    #[test]
    fn it_stops_and_does_nothing_else() {
        let spec = CorrectionSpec {
            dialect: Dialect::G10G68,
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
        };
        for coding in [
            Coding::Auto,
            Coding::Ascii,
            Coding::IsoEven,
            Coding::AsciiOdd,
            Coding::Eia,
        ] {
            let text = alarm(&spec, coding).unwrap();
            let expected = [
                "%",
                "O9010(UMI NO CORRECTION)",
                "(THERE IS NO OK VERDICT - PROBE AGAIN)",
                match coding {
                    Coding::Eia => "M00(UMI NO OK VERDICT)",
                    _ => "#3000=1(UMI NO OK VERDICT)",
                },
                "M30",
                "%",
            ];
            assert!(text.lines().eq(expected), "{text}");
            assert!(text.ends_with("%\n"));
            assert!(text.bytes().all(|byte| encode(coding, byte).is_some()));
        }
    }
}
