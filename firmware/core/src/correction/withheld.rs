//! What a control gets instead of a program that it may not have, or that cannot go on.

use core::fmt::Write as _;

use heapless::String;
use umi_protocol::pattern::Coding;
use umi_protocol::program::Withheld;
use umi_protocol::verdict::MAX_CORRECTION;

/// A program under the number that was asked for which raises an alarm and says why: it
/// stops whoever calls it, and takes the place of an older one in the control's memory.
///
/// Only a control with O-numbers asks for one: `#3000` is Fanuc's Custom Macro B and what
/// follows it. EIA has no `#`: there the program stops, says why, and ends.
#[must_use]
pub fn withheld(number: u32, why: &Withheld, coding: Coding) -> String<MAX_CORRECTION> {
    let mut text = String::new();
    let words = why.alarm();
    let stop = match coding {
        Coding::Eia => "M00",
        _ => "#3000=2",
    };
    // Two hundred characters: there is room.
    let _ = write!(text, "%\nO{number:04}(UMI {words})\n");
    if let Withheld::NotRewritable { line, column } = why {
        let _ = writeln!(text, "(LINE {line} COLUMN {column})");
    }
    let _ = write!(text, "{stop}(UMI {words})\nM30\n%\n");
    text
}

/// Blocks that stop a program which cannot be sent to its end; they follow a whole line.
/// There is no closing `%`: what a control stores of it is not complete.
#[must_use]
pub const fn broken_off(coding: Coding) -> &'static str {
    match coding {
        Coding::Eia => "M00(UMI STOPPED)\nM30\n",
        _ => "#3000=3(UMI STOPPED)\nM30\n",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dprnt::encode;

    /// The stop comes first, can be sent in every code, fits Fanuc's screen (31 characters,
    /// of which four are ours), and nothing in it moves or sets anything.
    #[test]
    fn it_stops_and_does_nothing_else() {
        let all = [
            Withheld::NoVerdict,
            Withheld::NotThere,
            Withheld::GoneOut,
            Withheld::NotCorrected,
            Withheld::HeldTooLong,
            Withheld::NoPercent,
            Withheld::NotReleased,
            Withheld::CorrectedTwice,
            Withheld::NoRegistration,
            Withheld::BadSettings,
            Withheld::NotRewritable {
                line: u32::MAX,
                column: u16::MAX,
            },
            Withheld::Damaged,
            Withheld::NotInCode { byte: b'#' },
            Withheld::NotJournaled,
        ];
        for coding in [
            Coding::Auto,
            Coding::Ascii,
            Coding::IsoEven,
            Coding::AsciiOdd,
            Coding::Eia,
        ] {
            for why in &all {
                assert!(why.alarm().len() <= 28, "{}", why.alarm());
                let text = withheld(77, why, coding);
                assert!(text.starts_with("%\nO0077(UMI ") && text.ends_with(")\nM30\n%\n"));
                assert_eq!(text.matches('%').count(), 2, "% ends it wherever it stands");
                let stop = text.lines().find(|line| !line.starts_with(['%', 'O', '(']));
                let expected = if coding == Coding::Eia {
                    "M00(UMI "
                } else {
                    "#3000=2(UMI "
                };
                assert!(stop.unwrap().starts_with(expected), "{text}");
                for text in [text.as_str(), broken_off(coding)] {
                    assert!(text.bytes().all(|byte| encode(coding, byte).is_some()));
                }
            }
        }
    }
}
