//! `umi nc check`

use std::path::PathBuf;

use crate::failure::Failure;
use crate::show::terminal::{BAD, CAUTION, GOOD, count, paint, print, print_json};
use clap::Args;
use serde_json::json;
use umi_client::files::points::name;
use umi_client::files::tool_path::{self, Examined, PartProgram};
use umi_client::job::correction::Basis;
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{RefusedLine, RewriteSettings};

use super::how::{How, allowed_by, told};
use super::rewrite::{machine, table};
use crate::cmd::Format;
use crate::cmd::control::basis::MovedBy;

/// Can this tool path be rewritten? Every reason against it, without writing
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Check {
    /// The part program
    #[arg(value_name = "PROGRAM")]
    program: PathBuf,
    #[command(flatten)]
    moved_by: MovedBy,
    #[command(flatten)]
    how: How,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Without a transform, or with one that moves nothing, it is tried with a part that is
turned about Z, and with one that leans: cutter compensation and some canned cycles only
stand the first.
What a control itself would complain about says `umi machine check`.

Examples:
  umi nc check part.nc
  umi nc check part.ngc --start G90,G17,G21 --dialect linuxcnc --integers units
  umi nc check part.nc --load pocket.nc --allow-call P9001
  umi nc check part.nc --transform moved.json --json

Exit status: 0 it can, 1 file or usage, 2 there are reasons against it.";

impl Check {
    pub fn run(self) -> Result<(), Failure> {
        let program = self.how.program(&self.program)?;
        let basis = self.moved_by.read_in(self.how.stated())?;
        let holds = |reach| {
            basis
                .as_ref()
                .map_or(Ok(()), |it| self.how.holds(it, reach))
        };
        holds(None)?;
        let measured_in = basis.as_ref().and_then(Basis::measured_in);
        let settings = |transform| self.how.settings(transform, measured_in);
        let examine = |transform| {
            let examined = tool_path::examine(&program, &settings(transform)?)?;
            Ok::<_, Failure>(examined)
        };
        let transform = match &basis {
            Some(basis) => Some(basis.transform()?),
            None => None,
        };
        // The identity changes no byte, and so refuses none: what another would, is asked.
        let Some(transform) = transform.filter(|it| *it != RigidTransform::identity()) else {
            let level = examine(tool_path::LEVEL.transform())?;
            let leaning = examine(tool_path::LEANING.transform())?;
            let tried = tool_path::LEANING.transform();
            return self.tell(&program, &level, Some(&leaning), &settings(tried)?);
        };
        let examined = examine(transform)?;
        holds(examined.summary.nominal_mm)?;
        self.tell(&program, &examined, None, &settings(transform)?)
    }

    fn tell(
        &self,
        program: &PartProgram,
        found: &Examined,
        leaning: Option<&Examined>,
        settings: &RewriteSettings,
    ) -> Result<(), Failure> {
        let no_others = Vec::new();
        let others: &Vec<RefusedLine> = leaning.map_or(&no_others, |examined| &examined.refusals);
        let only_leaning = || {
            others
                .iter()
                .filter(|refusal| !found.refusals.contains(refusal))
        };
        for refusal in &found.refusals {
            self.reason(program, refusal, settings, false)?;
        }
        for refusal in only_leaning() {
            self.reason(program, refusal, settings, true)?;
        }
        let reasons = found.refusals.len() as u64 + found.more;
        let leans = only_leaning().count() as u64;
        if self.format.json {
            let mut value = machine(&found.identity, &found.summary);
            value["type"] = json!("check");
            value["refusals"] = json!(reasons);
            value["refusals_only_leaning"] = json!(leaning.map(|_| leans));
            print_json(&value)?;
        } else {
            let style = if reasons > 0 { BAD } else { GOOD };
            let mut summary = found.summary;
            if leaning.is_some() {
                // Nobody has said where the part lies.
                summary.written_mm = None;
            }
            let lean = match leaning {
                None => String::new(),
                Some(_) if leans == 0 => ", also where the part leans".into(),
                Some(_) => format!(", {} only where the part leans", leans),
            };
            print(&format!(
                "{}{lean}\n\n{}",
                paint(
                    style,
                    format_args!("{} against rewriting it", count(reasons, "reason"))
                ),
                table(&found.identity, &summary)
            ))?;
        }
        if reasons == 0 {
            Ok(())
        } else {
            Err(Failure::Negative)
        }
    }

    fn reason(
        &self,
        program: &PartProgram,
        refused: &RefusedLine,
        settings: &RewriteSettings,
        only_leaning: bool,
    ) -> Result<(), Failure> {
        let option = allowed_by(program, refused, settings);
        if self.format.json {
            let (file, refused) = program.place(refused);
            return print_json(&json!({
                "type": "refusal",
                "file": file.display().to_string(),
                "line": refused.line,
                "column": refused.column,
                "message": refused.reason.to_string(),
                "only_leaning": only_leaning,
                "option": option,
            }));
        }
        if !only_leaning {
            let said = told(program, refused, settings);
            let (file, rest) = said.split_once(", ").unwrap_or((said.as_str(), ""));
            return print(&format!("{} {rest}\n", paint(BAD, file)));
        }
        // A level part needs neither another program nor an option for it.
        let (file, refused) = program.place(refused);
        let option = option.map_or_else(String::new, |option| {
            format!(" ({option}, where it does lean)")
        });
        print(&format!(
            "{} only where the part leans: {refused}{option}\n",
            paint(CAUTION, name(file))
        ))
    }
}
