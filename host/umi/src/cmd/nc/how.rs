//! Options that rewriting and checking have in common.

use std::path::{Path, PathBuf};

use crate::failure::Failure;
use clap::{Args, ValueEnum};
use umi_client::files::points::name;
use umi_client::files::tool_path::PartProgram;
use umi_client::problem::Problem;
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{
    AllowedCalls, RefusedLine, RewriteDialect, RewriteRefusal, RewriteSettings, StartModes,
};

use crate::cmd::control::Control;

/// What the control takes, and what is known of its work offsets.
#[derive(Args)]
pub(crate) struct How {
    #[command(flatten)]
    control: Control,
    /// The origin of a work offset in machine coordinates, as G55=250,0,-40 (repeatable):
    /// a program with two of them and a rotation needs both
    #[arg(long, value_name = "G54=X,Y,Z", value_parser = origin)]
    origin: Vec<(usize, [f64; 3])>,
    /// Modes that the program takes for granted, as G90,G17,G21
    #[arg(long, value_name = "G90,G17,…", value_parser = start)]
    start: Option<StartModes>,
    /// Whose program this is, where controls differ: P on an arc, a cycle that begins below R
    #[arg(long, value_enum)]
    dialect: Option<Family>,
    /// A program that is called, to be rewritten with this one as if it stood in its file
    /// (repeatable)
    #[arg(long, value_name = "FILE")]
    load: Vec<PathBuf>,
    /// A program that may be called although its text is not there: a number as P9010, or a name
    /// (repeatable): it moves nothing that must be carried, and corrects nothing
    #[arg(long, value_name = "P9010", value_parser = call)]
    allow_call: Vec<String>,
    /// Rewrite a program that was rewritten before
    #[arg(long)]
    again: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Family {
    /// Fanuc, Haas, Mitsubishi: a cycle that begins below R moves across, then to R
    Fanuc,
    /// LinuxCNC: such a cycle rises to R first; P on an arc counts turns
    Linuxcnc,
}

fn start(text: &str) -> Result<StartModes, String> {
    let mut modes = StartModes::default();
    for word in text.split([',', ' ']).filter(|word| !word.is_empty()) {
        let tenths = word
            .strip_prefix(['G', 'g'])
            .and_then(|number| number.parse::<f64>().ok())
            .map(|number| (number * 10.0).round())
            .filter(|tenths| (0.0..=9999.0).contains(tenths));
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "just bounded"
        )]
        let with = tenths.and_then(|tenths| modes.with(tenths as u16));
        modes = with.ok_or_else(|| {
            format!(
                "{word} is no mode to begin with, or contradicts another: give some of G0 to G3, \
                 G17 G18 G19, G20 G21, G54 to G59, G90 G91, G90.1 G91.1, G93 G94 G95, G98 G99"
            )
        })?;
    }
    Ok(modes)
}

fn call(text: &str) -> Result<String, String> {
    let number = text.trim_start_matches(['P', 'O', 'p', 'o']);
    let is_number = number.parse::<u32>().is_ok();
    let is_name = text.starts_with('<') && text.ends_with('>') && !text.contains(',');
    match (is_number, is_name) {
        (true, _) => Ok(number.to_owned()),
        (_, true) => Ok(text.to_owned()),
        _ => Err("give it as P9010, O9010 or '<name>'".into()),
    }
}

fn origin(text: &str) -> Result<(usize, [f64; 3]), String> {
    let parsed = || {
        let (name, place) = text.split_once('=')?;
        let number: usize = name.trim_start_matches(['G', 'g']).parse().ok()?;
        let index = number.checked_sub(54).filter(|index| *index < 6)?;
        let numbers: Result<Vec<f64>, _> = place.split(',').map(|x| x.trim().parse()).collect();
        Some((index, numbers.ok()?.try_into().ok()?))
    };
    parsed().ok_or_else(|| "give it as G54=100,-250,-40.5 (G54 to G59, mm)".into())
}

impl How {
    /// The settings for a transform.
    pub fn settings(&self, transform: RigidTransform) -> Result<RewriteSettings, Failure> {
        let mut origins_mm = [None; 6];
        for (index, place) in &self.origin {
            if let Some(slot) = origins_mm.get_mut(*index) {
                *slot = Some(*place);
            }
        }
        let allowed_calls = AllowedCalls::try_from(self.allow_call.join(",").as_str())
            .map_err(|_| Failure::trouble("usage", "--allow-call: 96 characters at most"))?;
        Ok(RewriteSettings {
            origins_mm,
            start: self.start.unwrap_or_default(),
            dialect: self.dialect.map(|family| match family {
                Family::Fanuc => RewriteDialect::Fanuc,
                Family::Linuxcnc => RewriteDialect::LinuxCnc,
            }),
            allowed_calls,
            again: self.again,
            ..self.control.settings(transform)?
        })
    }

    /// The program, with those that are loaded.
    pub fn program(&self, path: &Path) -> Result<PartProgram, Problem> {
        PartProgram::new(path, &self.load)
    }

    /// The files that are read with it.
    pub fn inputs(&self) -> impl Iterator<Item = &Path> {
        self.load.iter().map(PathBuf::as_path)
    }
}

/// A refused line with its file, and the option that allows it.
pub fn told(program: &PartProgram, refused: &RefusedLine) -> String {
    let (path, refused) = program.place(refused);
    let option = match refused.reason {
        RewriteRefusal::NotHere(number) => format!(" (--load FILE, --allow-call P{number})"),
        RewriteRefusal::NamedCall => " (--allow-call '<name>')".to_owned(),
        RewriteRefusal::Rewritten => " (--again)".to_owned(),
        RewriteRefusal::Turns => " (--dialect linuxcnc)".to_owned(),
        RewriteRefusal::BelowR => " (--dialect fanuc or linuxcnc)".to_owned(),
        RewriteRefusal::NoDistanceMode => " (--start G90)".to_owned(),
        RewriteRefusal::NoUnit => " (--start G21)".to_owned(),
        RewriteRefusal::NoMotion => " (--start G1)".to_owned(),
        RewriteRefusal::NoPoint(_) => " (--integers units)".to_owned(),
        RewriteRefusal::WorkOffset => " (--origin G55=X,Y,Z)".to_owned(),
        _ => String::new(),
    };
    format!("{}, {refused}{option}", name(path))
}
