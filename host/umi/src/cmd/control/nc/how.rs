//! Options that rewriting and checking have in common.

use std::path::{Path, PathBuf};

use crate::failure::Failure;
use clap::Args;
use umi_client::files::points::name;
use umi_client::files::tool_path::{self, PartProgram};
use umi_client::job::correction::Basis;
use umi_client::problem::Problem;
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{MeasuredIn, RefusedLine, RewriteRefusal, RewriteSettings};

use crate::cmd::control::offsets::Offsets;
use crate::cmd::control::options::Control;
use crate::cmd::control::stated::{Said, option};

/// What the control takes, and what is known of its work offsets.
#[derive(Args)]
pub(crate) struct How {
    #[command(flatten)]
    control: Control,
    #[command(flatten)]
    offsets: Offsets,
    #[command(flatten)]
    said: Said,
    /// A program that is called, to be rewritten with this one as if it stood in its file
    /// (repeatable)
    #[arg(long, value_name = "FILE")]
    load: Vec<PathBuf>,
    /// Rewrite a program that was rewritten before
    #[arg(long)]
    again: bool,
    /// Most that a --transform may be off, one standard deviation: at the worst of its points, and as far
    /// out as the program reaches
    #[arg(long, value_name = "MM", default_value_t = 0.02)]
    limit: f64,
}

impl How {
    /// Where the part was probed, as the options say it.
    pub fn stated(&self) -> Option<MeasuredIn> {
        self.offsets.stated()
    }

    /// The settings for a transform that holds there.
    pub fn settings(
        &self,
        transform: RigidTransform,
        measured_in: Option<MeasuredIn>,
    ) -> Result<RewriteSettings, Failure> {
        let (measured_in, origins_mm) = self.offsets.of(measured_in)?;
        Ok(RewriteSettings {
            measured_in: measured_in.map(|it| it.offset),
            origins_mm,
            again: self.again,
            ..self
                .said
                .settings(self.control.settings(transform, &self.said)?)?
        })
    }

    /// Whether a motion is known well enough, also where a program reaches, nominal.
    ///
    /// # Errors
    /// As [`Basis::known_to`].
    pub fn holds(&self, basis: &Basis, reach_mm: Option<[[f64; 3]; 2]>) -> Result<(), Problem> {
        basis.known_to(self.limit, reach_mm)
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
pub fn told(program: &PartProgram, refused: &RefusedLine, settings: &RewriteSettings) -> String {
    let option = allowed_by(program, refused, settings);
    let option = option.map_or_else(String::new, |option| format!(" ({option})"));
    let (path, refused) = program.place(refused);
    format!("{}, {refused}{option}", name(path))
}

/// The option with which a refused line is taken.
pub fn allowed_by(
    program: &PartProgram,
    refused: &RefusedLine,
    settings: &RewriteSettings,
) -> Option<String> {
    match refused.reason {
        RewriteRefusal::NotHere(number) => Some(format!("--load FILE, --allow-call P{number}")),
        RewriteRefusal::NamedCall => Some("--allow-call '<name>'".to_owned()),
        RewriteRefusal::Rewritten => Some("--again".to_owned()),
        RewriteRefusal::WorkOffset => Some(match settings.measured_in {
            None => "--origin G54=X,Y,Z --origin G55=X,Y,Z, in machine coordinates".to_owned(),
            Some(offset) => format!(
                "probed in {offset}; --origin G54=X,Y,Z in machine coordinates for this one and for \
                 that, or --start if the program says none"
            ),
        }),
        RewriteRefusal::RapidOver(_) if !helps_to_allow(program, refused, settings) => None,
        other => option(other),
    }
}

/// Whether a line is taken where rapids over an unknown axis are allowed: another axis may lean too
/// much for it.
fn helps_to_allow(
    program: &PartProgram,
    refused: &RefusedLine,
    settings: &RewriteSettings,
) -> bool {
    let loose = RewriteSettings {
        loose_rapids: true,
        ..settings.clone()
    };
    tool_path::examine(program, &loose).is_ok_and(|examined| {
        let mut left = examined.refusals.iter();
        !left.any(|left| left.line == refused.line)
    })
}
