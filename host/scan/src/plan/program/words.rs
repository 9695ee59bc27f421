//! Which names of rotary axes a control's language has words for.

use super::super::machine::PlanMachine;
use super::PathDialect;
use crate::ScanError;

/// Letters that turn something in every language here.
const TURNING: &str = "ABCUVW";

/// Refuses axes whose names the language would read as something else.
///
/// # Errors
/// `machine_spec`, with the name and the language.
pub(super) fn check(machine: &PlanMachine, dialect: PathDialect) -> Result<(), ScanError> {
    let axes = machine.table.iter().chain(&machine.head);
    let orient = machine.orient_deg.map(|_| machine.orient_word.as_str());
    let names: Vec<&str> = axes.map(|a| a.name.as_str()).chain(orient).collect();
    for (k, name) in names.iter().enumerate() {
        if names[..k].contains(name) {
            return Err(ScanError::refused(
                "machine_spec",
                format_args!(
                    "Two rotary axes have the word {name}: give the spindle's orientation another one ([machine.spindle] word)."
                ),
            ));
        }
        if !known(name, dialect) {
            let (language, words) = match dialect {
                PathDialect::Fanuc => ("Fanuc's", "A, B, C, U, V or W"),
                PathDialect::LinuxCnc => ("LinuxCNC's", "A, B, C, U, V or W"),
                PathDialect::Heidenhain => ("Heidenhain's", "A, B, C, U, V or W"),
                PathDialect::Siemens => (
                    "Sinumerik's",
                    "A, B, C, Q, U, V or W, with up to two digits",
                ),
            };
            return Err(ScanError::refused(
                "machine_spec",
                format_args!(
                    "{language} language has no word {name} for a rotary axis: take {words}, or leave --nc out."
                ),
            ));
        }
    }
    Ok(())
}

/// LinuxCNC reads U, V and W as linear axes, and converts their numbers as lengths: what is said of a rotary one.
pub(super) fn linear(machine: &PlanMachine) -> Option<String> {
    let axes = machine.table.iter().chain(&machine.head);
    let orient = machine.orient_deg.map(|_| machine.orient_word.as_str());
    let names: Vec<&str> = axes.map(|a| a.name.as_str()).chain(orient).collect();
    let word = names.iter().find(|name| "UVW".contains(**name))?;
    let free: Vec<&str> = ["A", "B", "C"]
        .into_iter()
        .filter(|name| !names.contains(name))
        .collect();
    Some(format!(
        "LinuxCNC reads {word} as a linear axis: its number is one of degrees only on a machine configured in mm. Name a rotary axis A, B or C{}.",
        free.first().map_or(String::new(), |free| format!(
            " (the spindle: word = \"{free}\" in [machine.spindle]; {free} is free)"
        ))
    ))
}

fn known(name: &str, dialect: PathDialect) -> bool {
    let Some(letter) = name.chars().next() else {
        return false;
    };
    let digits = &name[letter.len_utf8()..];
    match dialect {
        PathDialect::Siemens => {
            (TURNING.contains(letter) || letter == 'Q')
                && digits.len() <= 2
                && digits.bytes().all(|b| b.is_ascii_digit())
        }
        _ => TURNING.contains(letter) && digits.is_empty(),
    }
}

#[cfg(test)]
mod tests {
    use super::{PathDialect, known};

    #[test]
    fn a_word_that_means_something_else_is_no_axis() {
        use PathDialect::{Fanuc, Heidenhain, LinuxCnc, Siemens};
        for dialect in [Fanuc, Siemens, Heidenhain, LinuxCnc] {
            for name in ["A", "B", "C", "W"] {
                assert!(known(name, dialect), "{name}");
            }
            for name in [
                "X", "F", "G", "N", "M", "T", "S", "SPOS", "BETA", "b", "1", "B_1", "",
            ] {
                assert!(!known(name, dialect), "{name} {dialect:?}");
            }
        }
        assert!(known("B1", Siemens) && known("C12", Siemens) && !known("C123", Siemens));
        for dialect in [Fanuc, Heidenhain, LinuxCnc] {
            assert!(!known("B1", dialect));
        }
    }
}
