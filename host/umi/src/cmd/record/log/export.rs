//! `umi log export`: a journal for other programs.

use std::io::Write as _;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use umi_client::journal::guarding::Guarding;
use umi_client::journal::{self, FileItem};
use umi_core::journal::Entry;

use super::Format;
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{CAUTION, paint, print_error, print_json};

/// Write a pulled journal as a table or as lines of JSON
#[derive(Args)]
#[command(after_help = "\
csv: one row for each entry, as RFC 4180: seq, t_us, type, and the record as JSON. jsonl: one
object on a line, as `umi log --json` prints them. parquet: the columns of csv; needs a umi that was
built with cloud-formats, as releases are. The file is checked first, heads and all; whether all of it is
signed stands in the JSON (`signed`), and where it is not, a warning on standard error.

Examples:
  umi log export monday.umij --format csv -o monday.csv
  umi log export monday.umij --format jsonl -o monday.jsonl
  umi log export monday.umij --format parquet -o monday.parquet")]
pub(super) struct Export {
    /// The journal
    #[arg(value_name = "FILE.umij")]
    file: PathBuf,
    /// What to write
    #[arg(long, value_enum)]
    format: Form,
    /// Where
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    told: Format,
}

#[derive(Clone, Copy, ValueEnum)]
enum Form {
    /// A table
    Csv,
    /// Lines of JSON
    Jsonl,
    /// A table in columns
    #[cfg(feature = "cloud-formats")]
    Parquet,
}

impl Export {
    pub fn run(self) -> Result<(), Failure> {
        let bytes = journal::load(&self.file)?;
        let signed = journal::verify::verify(&bytes, None, None)?.signed;
        let mut out = Vec::new();
        #[cfg(feature = "cloud-formats")]
        let mut columns = super::parquet::Columns::default();
        if let Form::Csv = self.format {
            out.extend_from_slice(b"seq,t_us,type,record\r\n");
        }
        let (mut guarding, mut rows) = (Guarding::default(), 0_u64);
        journal::read(&bytes, |item| {
            let (seq, t_us, value) = match item {
                FileItem::Entry(entry) => {
                    (entry.seq, Some(entry.t.0), value(&entry, &mut guarding))
                }
                FileItem::Gap(gap) => {
                    let value = json!({
                        "type": "overwritten",
                        "first_seq": gap.first,
                        "next_seq": gap.next,
                    });
                    (gap.first, None, value)
                }
            };
            rows += 1;
            let written = match self.format {
                #[cfg(feature = "cloud-formats")]
                Form::Parquet => {
                    columns.push(seq, t_us, &value);
                    Ok(())
                }
                Form::Jsonl => writeln!(out, "{value}"),
                Form::Csv => {
                    let time = t_us.map_or(String::new(), |t_us| t_us.to_string());
                    let name = value["type"].as_str().unwrap_or_default();
                    let record = value.to_string().replace('"', "\"\"");
                    write!(out, "{seq},{time},{name},\"{record}\"\r\n")
                }
            };
            written.map_err(|error| Failure::file("write", &self.output, &error))
        })?;
        #[cfg(feature = "cloud-formats")]
        if let Form::Parquet = self.format {
            out = columns.file().map_err(|error| {
                Failure::trouble(
                    "parquet",
                    format_args!("{}: {error}", self.output.display()),
                )
            })?;
        }
        self.force.write(&self.output, &[&self.file], out)?;
        if !signed {
            let told = format!(
                "{} is not signed to its end: anybody can have made what no head vouches for (umi log verify says how far it is)\n",
                self.file.display()
            );
            print_error(&paint(CAUTION, told));
        }
        if self.told.json {
            let file = self.output.display().to_string();
            return print_json(
                &json!({"type": "exported", "rows": rows, "file": file, "signed": signed}),
            );
        }
        Ok(())
    }
}

fn value(entry: &Entry<'_>, guarding: &mut Guarding) -> Value {
    match journal::record(entry) {
        Ok(record) => {
            let mode = guarding.follow(entry.seq, &record);
            crate::show::json::guarded_entry(entry.seq, entry.t.0, &record, mode)
        }
        Err(unreadable) => json!({
            "seq": entry.seq,
            "t_us": entry.t.0,
            "type": "unreadable",
            "kind": unreadable.kind,
            "message": unreadable.to_string(),
        }),
    }
}
