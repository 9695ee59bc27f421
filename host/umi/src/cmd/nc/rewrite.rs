//! `umi nc rewrite`

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};
use umi::failure::{Explained, Failure};
use umi::points::name;
use umi::style::{GOOD, Table, count, paint, print, print_error, print_json};
use umi::toolpath;
use umi_core::nc::rewrite::{Identity, Settings, Summary};

use super::how::{How, Which};
use crate::cmd::Format;

/// Rewrite a tool path: every motion carried by a transform, all else as it was
#[derive(Args)]
#[command(after_help = HELP)]
pub struct Rewrite {
    /// The part program
    #[arg(value_name = "PROGRAM")]
    program: PathBuf,
    /// Where the rewritten program goes; `-` is standard output
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    which: Which,
    #[command(flatten)]
    how: How,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
The transform q = R p + t holds in the coordinates of the work offset that is in
force at the program's first motion. The program is read twice: what cannot be
transformed truly is refused by line and reason before anything is written.
A header says check value, source and transform. The identity changes no byte.

Examples:
  umi nc rewrite part.nc -o here.nc --verdict today.jsonl
  umi nc rewrite part.nc -o here.nc --transform moved.json --increment-mm 0.0001
  umi nc rewrite part.ngc -o - --transform moved.json --integers units --json

Exit status: 0 written, 1 file or usage, 2 refused: nothing is written.";

impl Rewrite {
    pub fn run(self) -> Result<(), Failure> {
        let Some(source) = self.which.read()? else {
            return Err(Failure::trouble(
                "usage",
                "which transform? give --verdict FILE or --transform FILE",
            ));
        };
        let settings = self.how.settings(source.transform)?;
        let examined = toolpath::examine(&self.program, &settings)?;
        if let Some(first) = examined.refusals.first() {
            let all = examined.refusals.len() as u64 + examined.more;
            let others = match all - 1 {
                0 => String::new(),
                n => format!(" ({} more: umi nc check lists them)", n),
            };
            return Err(Failure::Refused(
                Explained::new(
                    "cannot_rewrite",
                    format_args!(
                        "{}, {first}{others}; nothing is written",
                        name(&self.program)
                    ),
                )
                .with("line", first.line)
                .with("column", first.column)
                .with("refusals", all),
            ));
        }
        let settings = Settings {
            original: Some(examined.identity),
            source: source.name.chars().take(96).collect(),
            ..settings
        };
        let summary = toolpath::rewrite(&self.program, &self.output, &settings)?;
        let is_stdout = self.output.as_os_str() == "-";
        if self.format.json {
            let value = machine(&examined.identity, &summary);
            if is_stdout {
                print_error(&format!("{value}\n"));
                Ok(())
            } else {
                print_json(&value)
            }
        } else if is_stdout {
            Ok(())
        } else {
            print(&format!(
                "{} {}\n\n{}",
                paint(GOOD, "rewritten"),
                name(&self.output),
                table(&examined.identity, &summary)
            ))
        }
    }
}

/// What was done, for machines.
pub fn machine(identity: &Identity, summary: &Summary) -> Value {
    json!({
        "crc32": format!("{:08X}", identity.crc32),
        "bytes": identity.bytes,
        "lines": summary.lines,
        "blocks": summary.blocks,
        "rapids": summary.rapids,
        "feeds": summary.feeds,
        "arcs_kept": summary.arcs,
        "arcs_as_chords": summary.chorded,
        "chords": summary.chords,
        "holes": summary.holes,
        "holes_written_out": summary.written_out,
        "nominal_min_mm": summary.nominal_mm.map(|[low, _]| low),
        "nominal_max_mm": summary.nominal_mm.map(|[_, high]| high),
        "written_min_mm": summary.written_mm.map(|[low, _]| low),
        "written_max_mm": summary.written_mm.map(|[_, high]| high),
    })
}

/// What was done, for people.
pub fn table(identity: &Identity, summary: &Summary) -> Table {
    let mut table = Table::new("<<");
    table.row([
        "original".to_owned(),
        format!(
            "{}, CRC-32 {:08X}",
            count(identity.bytes, "byte"),
            identity.crc32
        ),
    ]);
    table.row([
        "motions".to_owned(),
        format!(
            "{}, {}, {}, {}",
            count(summary.rapids, "rapid"),
            count(summary.feeds, "line"),
            count(summary.arcs, "arc"),
            count(summary.holes, "hole"),
        ),
    ]);
    if summary.chorded + summary.written_out > 0 {
        table.row([
            "written out".to_owned(),
            format!(
                "{} as {}, {}",
                count(summary.chorded, "arc"),
                count(summary.chords, "chord"),
                count(summary.written_out, "hole"),
            ),
        ]);
    }
    for (title, extent) in [
        ("nominal (mm)", summary.nominal_mm),
        ("written (mm)", summary.written_mm),
    ] {
        let Some([low, high]) = extent else { continue };
        let axis = |letter: char, axis: usize| match (low.get(axis), high.get(axis)) {
            (Some(low), Some(high)) if low <= high => format!("{letter} {low:.3} to {high:.3}"),
            _ => format!("{letter} -"),
        };
        table.row([
            title.to_owned(),
            [axis('X', 0), axis('Y', 1), axis('Z', 2)].join(", "),
        ]);
    }
    table
}
