//! `umi nc check`

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use umi::failure::Failure;
use umi::points::name;
use umi::style::{BAD, CAUTION, GOOD, count, paint, print, print_json};
use umi::toolpath::{self, Examined};
use umi_core::nc::rewrite::Refusal;

use super::how::{How, Which};
use super::rewrite::{machine, table};
use crate::cmd::Format;

/// Can this tool path be rewritten? Every reason against it, without writing
#[derive(Args)]
#[command(after_help = HELP)]
pub struct Check {
    /// The part program
    #[arg(value_name = "PROGRAM")]
    program: PathBuf,
    #[command(flatten)]
    which: Which,
    #[command(flatten)]
    how: How,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Without a transform it is tried with a part that is turned about Z, and with one
that leans: cutter compensation and some canned cycles only stand the first.
What a control itself would complain about says `umi machine check`.

Examples:
  umi nc check part.nc
  umi nc check part.nc --transform moved.json --json

Exit status: 0 it can, 1 file or usage, 2 there are reasons against it.";

impl Check {
    pub fn run(self) -> Result<(), Failure> {
        let examine = |transform| {
            let settings = self.how.settings(transform)?;
            toolpath::examine(&self.program, &settings)
        };
        let Some(source) = self.which.read()? else {
            let level = examine(toolpath::LEVEL.transform())?;
            let leaning = examine(toolpath::LEANING.transform())?;
            return self.tell(&level, Some(&leaning));
        };
        self.tell(&examine(source.transform)?, None)
    }

    fn tell(&self, found: &Examined, leaning: Option<&Examined>) -> Result<(), Failure> {
        let no_others = Vec::new();
        let others: &Vec<Refusal> = leaning.map_or(&no_others, |examined| &examined.refusals);
        let only_leaning = || {
            others
                .iter()
                .filter(|refusal| !found.refusals.contains(refusal))
        };
        for refusal in &found.refusals {
            self.reason(refusal, false)?;
        }
        for refusal in only_leaning() {
            self.reason(refusal, true)?;
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
                table(&found.identity, &found.summary)
            ))?;
        }
        if reasons == 0 {
            Ok(())
        } else {
            Err(Failure::Negative)
        }
    }

    fn reason(&self, refusal: &Refusal, only_leaning: bool) -> Result<(), Failure> {
        if self.format.json {
            return print_json(&json!({
                "type": "refusal",
                "line": refusal.line,
                "column": refusal.column,
                "message": refusal.reason.to_string(),
                "only_leaning": only_leaning,
            }));
        }
        let style = if only_leaning { CAUTION } else { BAD };
        print(&format!(
            "{} {refusal}\n",
            paint(style, name(&self.program))
        ))
    }
}
