//! `umi machine check`

use std::path::PathBuf;

use crate::failure::Failure;
use crate::show::terminal::{BAD, CAUTION, GOOD, count, paint, print, print_json};
use clap::{Args, ValueEnum};
use serde_json::json;
use umi_client::files::points::{name, text};
use umi_virtual::nc::{self, Alarm, ControlFamily, ControlSettings, Severity};

use crate::cmd::Format;

/// What a control would complain about, without running
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Check {
    /// NC programs
    #[arg(value_name = "PROGRAM", required = true)]
    programs: Vec<PathBuf>,
    /// The control whose language it is; its usual parameters
    #[arg(long, value_enum, default_value_t = Language::Fanuc, conflicts_with = "scene")]
    control: Language,
    /// Take the control and its parameters from a scene
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Programs that call each other are checked together: give all of them.
Words of further axes (A B C U V W) are taken without a scene; with one, those of its
[[machine.rotary]] only.

Examples:
  umi machine check hw/control/fanuc/O8820-sphere.nc
  umi machine check --control linuxcnc probe.ngc
  umi machine check --scene examples/scenes/three-spheres.toml probe.nc --json";

/// What a control reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Language {
    /// Fanuc Custom Macro B
    Fanuc,
    /// Haas
    Haas,
    /// Mitsubishi, Mazak EIA
    Mitsubishi,
    /// LinuxCNC
    Linuxcnc,
    /// GRBL
    Grbl,
}

impl Check {
    pub fn run(self) -> Result<(), Failure> {
        let settings = match &self.scene {
            Some(path) => super::run::scene(path)?.control.nc,
            None => ControlSettings {
                // Which of them the machine has, only a scene says.
                rotary_words: "ABCUVW".into(),
                ..ControlSettings::of(match self.control {
                    Language::Fanuc => ControlFamily::Fanuc,
                    Language::Haas => ControlFamily::Haas,
                    Language::Mitsubishi => ControlFamily::Mitsubishi,
                    Language::Linuxcnc => ControlFamily::LinuxCnc,
                    Language::Grbl => ControlFamily::Grbl,
                })
            },
        };
        let mut source = String::new();
        let mut files = Vec::new();
        let mut lines = 0;
        for path in &self.programs {
            let text = text(path)?;
            files.push((name(path), lines));
            lines += text.lines().count();
            source.push_str(&text);
            if !source.ends_with('\n') {
                source.push('\n');
            }
        }
        let found = nc::check(&source, &settings);
        let mut alarms = 0_u64;
        for alarm in &found {
            alarms += u64::from(alarm.severity == Severity::Alarm);
            self.show(alarm, &files)?;
        }
        let warnings = found.len() as u64 - alarms;
        if self.format.json {
            print_json(&json!({ "type": "check", "alarms": alarms, "warnings": warnings }))?;
        } else {
            let style = if alarms > 0 { BAD } else { GOOD };
            print(&format!(
                "{}, {}\n",
                paint(style, count(alarms, "alarm")),
                count(warnings, "warning")
            ))?;
        }
        if alarms == 0 {
            Ok(())
        } else {
            Err(Failure::Negative)
        }
    }

    /// An alarm at its place in its file.
    fn show(&self, alarm: &Alarm, files: &[(String, usize)]) -> Result<(), Failure> {
        let line = alarm.line as usize;
        let (file, before) = match files.iter().rev().find(|(_, before)| line > *before) {
            Some((file, before)) => (file.clone(), *before),
            // It is no line's: of all that was given.
            None => {
                let names: Vec<_> = files.iter().map(|(file, _)| file.as_str()).collect();
                (names.join(", "), 0)
            }
        };
        let mut alarm = alarm.clone();
        alarm.line = u32::try_from(line.saturating_sub(before)).unwrap_or(u32::MAX);
        if self.format.json {
            return print_json(&super::show::alarm(&alarm, Some(&file)));
        }
        let style = match alarm.severity {
            Severity::Alarm => BAD,
            Severity::Warning => CAUTION,
        };
        print(&format!("{} {alarm}\n", paint(style, &file)))
    }
}
