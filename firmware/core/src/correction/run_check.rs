//! The comparison with which a program begins that is for one run: an alarm in any other.

use core::fmt;

use umi_protocol::job::Dialect;

use super::dialect::{compares_runs, programs_compare_runs};

/// The run that was measured, and where the control counts its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunCheck {
    /// The control's variable that counts the runs.
    variable: u32,
    /// The run that was measured.
    run: u32,
    /// How the control decides.
    form: RunForm,
}

/// How a control decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RunForm {
    /// `IF[…]THEN`: no jump. Fanuc takes no `GOTO` in the main program of a DNC operation
    /// (alarm PS0123), and a rewritten program may be carried out as it comes.
    Then,
    /// `IF[…]GOTO`, over the alarm: Mitsubishi's M700 is not known to have `THEN`.
    Goto,
    /// `O… IF`.
    LinuxCnc,
    /// `IF … GOTOF`, over an alarm that leads back to itself.
    Siemens,
    /// `FN 9`, likewise.
    Heidenhain,
}

/// What begins with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compared {
    /// A correction. It is stored and called, so that all may jump.
    Correction,
    /// A part program that is carried.
    Program,
    /// The alarm that a control gets when the setup was taught: in another run it names the run that taught.
    Taught,
}

impl RunCheck {
    /// For a part program on a control of this dialect; none where it compares nothing
    /// ([`programs_compare_runs`]).
    #[must_use]
    pub const fn of(dialect: Dialect, variable: u32, run: u32) -> Option<Self> {
        match programs_compare_runs(dialect) {
            true => Self::of_correction(dialect, variable, run),
            false => None,
        }
    }

    /// For a correction; none where it compares nothing ([`compares_runs`]).
    #[must_use]
    pub const fn of_correction(dialect: Dialect, variable: u32, run: u32) -> Option<Self> {
        if !compares_runs(dialect) {
            return None;
        }
        let form = match dialect {
            Dialect::LinuxCnc => RunForm::LinuxCnc,
            Dialect::Siemens => RunForm::Siemens,
            Dialect::Heidenhain => RunForm::Heidenhain,
            Dialect::MazakSettingError | Dialect::MitsubishiSettingError => RunForm::Goto,
            Dialect::G10G68
            | Dialect::G68ThreeD
            | Dialect::FanucSettingError
            | Dialect::Variables
            | Dialect::Haas
            | Dialect::HaasVariables => RunForm::Then,
            Dialect::Grbl => return None,
        };
        Some(Self {
            variable,
            run,
            form,
        })
    }

    /// The control's variable that counts the runs.
    #[must_use]
    pub const fn variable(self) -> u32 {
        self.variable
    }

    /// The run that was measured.
    #[must_use]
    pub const fn run(self) -> u32 {
        self.run
    }

    /// Whether it is in LinuxCNC's words: no other control knows them, and it knows no others.
    #[must_use]
    pub const fn is_linuxcnc(self) -> bool {
        matches!(self.form, RunForm::LinuxCnc)
    }

    /// The comparison with which a program of this text begins, whatever its form.
    #[must_use]
    pub fn in_text(text: &str) -> Option<Self> {
        let (before, behind) = text.split_once("UMI PROGRAM OF RUN ")?;
        let number = |text: &str| {
            let digits = text.bytes().take_while(u8::is_ascii_digit).count();
            text.get(..digits)?.parse().ok()
        };
        // `IF[#531NE17]THEN#3000=2(`, or the comparison on the line before.
        let (before, form) = match before.strip_suffix("THEN#3000=2(") {
            Some(before) => (before, RunForm::Then),
            None if before.ends_with("(ABORT, ") => (before, RunForm::LinuxCnc),
            None => (before.strip_suffix("#3000=2(")?, RunForm::Goto),
        };
        let (_, variable) = before.rsplit_once('#')?;
        Some(Self {
            variable: number(variable)?,
            run: number(behind)?,
            form,
        })
    }

    /// Gives its lines, without their ends.
    ///
    /// # Errors
    /// That of `line`.
    pub(crate) fn lines(
        self,
        of: Compared,
        mut line: impl FnMut(fmt::Arguments<'_>) -> fmt::Result,
    ) -> fmt::Result {
        let Self { variable, run, .. } = self;
        // With both numbers at their largest it fits Fanuc's screen: 31 characters.
        let what = match of {
            Compared::Correction => "CORRECTION OF",
            Compared::Program => "PROGRAM OF",
            Compared::Taught => "TAUGHT BY",
        };
        let form = match (self.form, of) {
            (RunForm::Then, Compared::Correction | Compared::Taught) => RunForm::Goto,
            (form, _) => form,
        };
        match form {
            RunForm::Then => line(format_args!(
                "IF[#{variable}NE{run}]THEN#3000=2(UMI {what} RUN {run})"
            )),
            RunForm::Goto => {
                line(format_args!("IF[#{variable}EQ{run}]GOTO7"))?;
                line(format_args!("#3000=2(UMI {what} RUN {run})"))?;
                line(format_args!("N7"))
            }
            RunForm::Siemens => {
                line(format_args!("IF R{variable}=={run} GOTOF UMI_RUN"))?;
                line(format_args!("UMI_STOP:"))?;
                line(format_args!("SETAL(65000,\"UMI {what} RUN {run}\")"))?;
                line(format_args!("M0"))?;
                line(format_args!("GOTOB UMI_STOP"))?;
                line(format_args!("UMI_RUN:"))
            }
            RunForm::Heidenhain => {
                line(format_args!("; UMI {what} RUN {run}"))?;
                line(format_args!("FN 9: IF +QR{variable} EQU +{run} GOTO LBL 2"))?;
                line(format_args!("LBL 1"))?;
                line(format_args!("FN 14: ERROR = 1072"))?;
                line(format_args!("STOP"))?;
                line(format_args!("FN 9: IF +0 EQU +0 GOTO LBL 1"))?;
                line(format_args!("LBL 2"))
            }
            RunForm::LinuxCnc => {
                line(format_args!("o531 if [#{variable} NE {run}]"))?;
                line(format_args!("(ABORT, UMI {what} RUN {run})"))?;
                line(format_args!("o531 endif"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::String;

    /// What is written is found again, whatever the line ends.
    #[test]
    fn it_is_found_in_a_text() {
        for dialect in Dialect::ALL {
            let Some(check) = RunCheck::of(dialect, 4531, 99_999) else {
                continue;
            };
            for eol in ["\n", "\r\n"] {
                let mut text = String::from("%\nO1\n(T 0.5 MM)\n");
                let line = |line: fmt::Arguments<'_>| {
                    use core::fmt::Write as _;
                    assert!(std::format!("{line}").len() < 64);
                    write!(text, "{line}{eol}")
                };
                check.lines(Compared::Program, line).unwrap();
                assert_eq!(RunCheck::in_text(&text), Some(check), "{text}");
            }
        }
        for other in [
            "G0 X1",
            "(UMI PROGRAM OF RUN 3)",
            "#3000=2(UMI PROGRAM OF RUN )",
        ] {
            assert_eq!(RunCheck::in_text(other), None);
        }
    }
}
