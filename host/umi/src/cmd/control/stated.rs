//! What can be said of a program because its text does not: for all commands that rewrite one,
//! here or on a board.

use clap::{Args, ValueEnum};
use umi_core::rewrite::{
    AllowedCalls, RewriteDialect, RewriteRefusal, RewriteSettings, StartModes,
};
use umi_protocol::program::{Stated, StatedDialect};

use crate::failure::Failure;

/// What is said of a program.
#[derive(Args)]
pub(crate) struct Said {
    /// Modes that the program takes for granted, as G90,G17,G21
    #[arg(long, value_name = "G90,G17,…", value_parser = start)]
    start: Option<StartModes>,
    /// Whose program this is, where controls differ: P on an arc, a cycle that begins below R
    #[arg(long, value_enum)]
    dialect: Option<Family>,
    /// A program that may be called although its text is not there: a number as P9010, or a name
    /// (repeatable): it moves nothing that must be carried, and corrects nothing
    #[arg(long, value_name = "P9010", value_parser = call)]
    allow_call: Vec<String>,
    /// Take a rapid of a part that leans although the program has not said where an axis is, as
    /// `G0 X0 Y0` behind `G91 G28 Z0`: it ends beside its place by the lean times the height,
    /// until the program names the axis
    #[arg(long)]
    allow_rapids: bool,
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

impl Said {
    /// Settings with what is said.
    pub fn settings(&self, settings: RewriteSettings) -> Result<RewriteSettings, Failure> {
        if let (Some(stated), Some(unit)) =
            (self.start.and_then(|modes| modes.unit()), settings.unit)
            && stated != unit
        {
            return Err(Failure::trouble(
                "usage",
                "--start says one unit (G20, G21) and --unit the other: leave one of them out",
            ));
        }
        let allowed_calls = AllowedCalls::try_from(self.allow_call.join(",").as_str())
            .map_err(|_| Failure::trouble("usage", "--allow-call: 96 characters at most"))?;
        Ok(RewriteSettings {
            start: self.start.unwrap_or_default(),
            dialect: self.dialect.map(|family| match family {
                Family::Fanuc => RewriteDialect::Fanuc,
                Family::Linuxcnc => RewriteDialect::LinuxCnc,
            }),
            allowed_calls,
            loose_rapids: self.allow_rapids,
            ..settings
        })
    }

    /// How far pecks retract on this control, where nobody has said it, mm.
    pub const fn clearance_mm(&self) -> f64 {
        match self.dialect {
            // `G83_RAPID_DELTA` of its interpreter, which no parameter changes: 0.010 inch.
            Some(Family::Linuxcnc) => 0.254,
            Some(Family::Fanuc) | None => 1.0,
        }
    }

    /// The first option that is given.
    pub fn first(&self) -> Option<&'static str> {
        match self {
            Self { start: Some(_), .. } => Some("--start"),
            Self {
                dialect: Some(_), ..
            } => Some("--dialect"),
            Self { allow_call, .. } if !allow_call.is_empty() => Some("--allow-call"),
            Self { allow_rapids, .. } => allow_rapids.then_some("--allow-rapids"),
        }
    }

    /// What a board keeps of it with a program: work offsets to G59, and one number that may
    /// be called. It takes all rapids: here they were asked for.
    pub fn kept(&self) -> Result<Stated, Failure> {
        let start_packed = self.start.unwrap_or_default().packed().ok_or_else(|| {
            Failure::trouble(
                "usage",
                "--start: a board keeps G54 to G59 and none beyond: state the work offset in the \
                 program",
            )
        })?;
        let allow_call = match self.allow_call.as_slice() {
            [] => Some(0),
            [one] => one.parse().ok().filter(|number| *number > 0),
            _ => None,
        };
        let allow_call = allow_call.ok_or_else(|| {
            Failure::trouble(
                "usage",
                "--allow-call: a board keeps one number, P1 to P65535, and no name; rewrite the \
                 program here (umi nc rewrite), or put the others into its file",
            )
        })?;
        Ok(Stated {
            start_packed,
            dialect: match self.dialect {
                None => StatedDialect::NotSaid,
                Some(Family::Fanuc) => StatedDialect::Fanuc,
                Some(Family::Linuxcnc) => StatedDialect::LinuxCnc,
            },
            allow_call,
        })
    }
}

/// The option that allows what was refused, where there is one: of these, or of the control's.
pub(crate) fn option(refused: RewriteRefusal) -> Option<String> {
    let option = match refused {
        RewriteRefusal::NotHere(number)
        | RewriteRefusal::Elsewhere(number)
        | RewriteRefusal::NumberedCall(number) => {
            return Some(format!("--allow-call P{number}"));
        }
        RewriteRefusal::Turns | RewriteRefusal::Semicolon => "--dialect linuxcnc",
        RewriteRefusal::Restores(_) | RewriteRefusal::HeightsSaidElsewise => "--dialect fanuc",
        RewriteRefusal::BelowR
        | RewriteRefusal::TwoShifts
        | RewriteRefusal::OffsetStep
        | RewriteRefusal::FeedsOut => "--dialect fanuc or linuxcnc",
        RewriteRefusal::RapidOver(_) => "--allow-rapids",
        RewriteRefusal::NoDistanceMode => "--start G90",
        RewriteRefusal::NoReturn => "--start G98 or G99, --dialect fanuc",
        RewriteRefusal::NoUnit => "--start G21",
        RewriteRefusal::NoMotion => "--start G1",
        RewriteRefusal::NoPoint(_) => "--integers units",
        _ => return None,
    };
    Some(option.to_owned())
}
