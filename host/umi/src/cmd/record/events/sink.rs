//! The output of events: terminal or file, as text, JSON or table.

use std::fs::File;
use std::io::{IsTerminal as _, LineWriter, Write};
use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::show::terminal::{CAUTION, FAINT, paint, print};
use crate::show::{json, text};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use umi_client::axes::Scale;
use umi_client::journal::Unreadable;
use umi_client::journal::guarding::Guarding;
use umi_client::timeline::{TimelineEntry, table};
use umi_core::journal::Gap;
use umi_protocol::access::AccessMode;

use super::{Events, Kind, kind};

/// Where happenings go.
pub(crate) struct Sink {
    form: Form,
    only: Vec<Kind>,
    most: Option<u64>,
    file: Option<(PathBuf, LineWriter<File>)>,
    bar: ProgressBar,
    /// How counts become millimetres.
    pub scale: Scale,
    /// Whether the board has an owner.
    pub guarding: Guarding,
    /// How many were shown, without losses.
    pub shown: u64,
    lost: u64,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Text,
    Json,
    Table,
}

impl Sink {
    /// As the options say.
    ///
    /// # Errors
    /// The file is there already, or cannot be written.
    pub fn open(options: &Events) -> Result<Self, Failure> {
        let form = match (options.format.json, options.csv) {
            (true, _) => Form::Json,
            (false, true) => Form::Table,
            (false, false) => Form::Text,
        };
        let only = if form == Form::Table {
            vec![Kind::Latches]
        } else {
            options.only.clone()
        };
        let mut file = None;
        if let Some(path) = &options.output {
            let inputs: Vec<&Path> = options.file.iter().map(PathBuf::as_path).collect();
            options.force.check(path, &inputs)?;
            let opened =
                File::create(path).map_err(|error| Failure::file("write", path, &error))?;
            file = Some((path.clone(), LineWriter::new(opened)));
        }
        let bar = if file.is_some() && std::io::stderr().is_terminal() {
            let style = ProgressStyle::with_template("{spinner} {elapsed} {msg}");
            ProgressBar::new_spinner()
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
        } else {
            ProgressBar::hidden()
        };
        let mut sink = Self {
            form,
            only,
            most: options.count,
            file,
            bar,
            scale: Scale::default(),
            guarding: Guarding::default(),
            shown: 0,
            lost: 0,
        };
        if form == Form::Table {
            sink.write(table::HEADER)?;
        }
        Ok(sink)
    }

    /// A table of latches in a file that is not there yet.
    ///
    /// # Errors
    /// It is there, or cannot be written.
    pub fn table(path: &Path) -> Result<Self, Failure> {
        // A cut leaves whole lines: nothing waits in the process for more.
        let file = File::create_new(path).map_err(|error| Failure::file("write", path, &error))?;
        let mut sink = Self {
            form: Form::Table,
            only: vec![Kind::Latches],
            most: None,
            file: Some((path.to_owned(), LineWriter::new(file))),
            bar: ProgressBar::hidden(),
            scale: Scale::default(),
            guarding: Guarding::default(),
            shown: 0,
            lost: 0,
        };
        sink.write(table::HEADER)?;
        Ok(sink)
    }

    /// As many as were wanted have been shown.
    pub fn full(&self) -> bool {
        self.most.is_some_and(|most| self.shown >= most)
    }

    /// Shows what `happen` tells.
    ///
    /// # Errors
    /// Nobody takes it any more.
    pub fn take(
        &mut self,
        happen: impl FnOnce(&mut dyn FnMut(TimelineEntry)),
    ) -> Result<(), Failure> {
        let mut text = String::new();
        happen(&mut |happening| self.show(&happening, &mut text));
        self.write(&text)
    }

    fn show(&mut self, happening: &TimelineEntry, text: &mut String) {
        let mode = match happening {
            TimelineEntry::Record { seq, record, .. } => self.guarding.follow(*seq, record),
            _ => None,
        };
        match kind(happening) {
            None => {
                if let TimelineEntry::Loss(loss) = happening {
                    self.lost += u64::from(loss.count);
                }
            }
            Some(kind) => {
                let wanted = self.only.is_empty() || self.only.contains(&kind);
                if !wanted || self.full() {
                    return;
                }
                self.shown += 1;
            }
        }
        let line = match self.form {
            Form::Text => in_words(happening, &self.scale, mode),
            Form::Json => in_json(happening, &self.scale, mode),
            Form::Table => table::row(happening, &self.scale),
        };
        text.push_str(&line);
    }

    /// An entry of the journal that this version cannot read.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn unreadable(&mut self, seq: u64, t_us: u64, what: Unreadable) -> Result<(), Failure> {
        match self.form {
            Form::Text => self.write(&line(Some(t_us), &paint(CAUTION, what))),
            Form::Json => {
                let value = json!({
                    "seq": seq,
                    "t_us": t_us,
                    "type": "unreadable",
                    "kind": what.kind,
                    "message": what.to_string(),
                });
                self.write(&format!("{value}\n"))
            }
            Form::Table => Ok(()),
        }
    }

    /// Entries that the board had overwritten before they were read.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn overwritten(&mut self, gap: Gap) -> Result<(), Failure> {
        let Gap { first, next, .. } = gap;
        match self.form {
            Form::Text => {
                let text = format!(
                    "entries {first} to {} were overwritten on the board",
                    next - 1
                );
                self.write(&line(None, &paint(CAUTION, text)))
            }
            Form::Json => {
                let value = json!({"type": "overwritten", "first_seq": first, "next_seq": next});
                self.write(&format!("{value}\n"))
            }
            Form::Table => Ok(()),
        }
    }

    fn write(&mut self, text: &str) -> Result<(), Failure> {
        let Some((path, file)) = &mut self.file else {
            return if text.is_empty() { Ok(()) } else { print(text) };
        };
        // Colours are for terminals only.
        let plain = umi_report::terminal::ink::plain(text);
        file.write_all(plain.as_bytes())
            .map_err(|error| Failure::file("write", path, &error))?;
        let lost = match self.lost {
            0 => "nothing lost".to_owned(),
            n => format!("{n} LOST"),
        };
        self.bar
            .set_message(format!("{} recorded, {lost}", self.shown));
        Ok(())
    }

    /// What was written is in the file.
    ///
    /// # Errors
    /// The file's.
    pub fn flush(&mut self) -> Result<(), Failure> {
        self.bar.tick();
        match &mut self.file {
            Some((path, file)) => file
                .flush()
                .map_err(|error| Failure::file("write", path, &error)),
            None => Ok(()),
        }
    }

    /// Ends it.
    ///
    /// # Errors
    /// The file's.
    pub fn close(&mut self) -> Result<(), Failure> {
        let flushed = self.flush();
        self.bar.finish_and_clear();
        flushed
    }

    /// Where it went, as an addition to a sentence.
    pub fn where_to(&self) -> String {
        let path = self.file.as_ref().map(|(path, _)| path.display());
        path.map_or(String::new(), |path| format!(", in {path}"))
    }

    /// A failure that says where that is which came before it.
    pub fn kept(&self, failure: Failure) -> Failure {
        let Some((path, _)) = &self.file else {
            return failure;
        };
        failure.noted(&format!("\nwhat came before is in {}", path.display()))
    }
}

fn line(t_us: Option<u64>, text: &str) -> String {
    let time = t_us.map_or_else(|| " ".repeat(14), text::clock);
    format!("{}  {text}\n", paint(FAINT, format_args!("{time:>14}")))
}

fn in_words(happening: &TimelineEntry, scale: &Scale, mode: Option<AccessMode>) -> String {
    match happening {
        TimelineEntry::Line(of) => line(Some(of.t_us), &text::line(of)),
        TimelineEntry::Hit(of) => line(Some(of.t_us), &text::hit(of)),
        TimelineEntry::Latch(_, of) => line(Some(of.t_ns / 1000), &text::latch(of, scale)),
        TimelineEntry::Record { t_us, record, .. } => {
            line(Some(*t_us), &text::guarded_record(record, mode))
        }
        TimelineEntry::Loss(of) => line(of.t_ns.map(|t_ns| t_ns / 1000), &text::loss(of)),
    }
}

fn in_json(happening: &TimelineEntry, scale: &Scale, mode: Option<AccessMode>) -> String {
    let value = match happening {
        TimelineEntry::Line(of) => json::line(of),
        TimelineEntry::Hit(of) => json::hit(of),
        TimelineEntry::Latch(seq, of) => {
            let mut value = json::latch(of, scale);
            if let (Some(seq), Some(object)) = (seq, value.as_object_mut()) {
                object.insert("seq".into(), (*seq).into());
            }
            value
        }
        TimelineEntry::Record { seq, t_us, record } => {
            json::guarded_entry(*seq, *t_us, record, mode)
        }
        TimelineEntry::Loss(of) => json::loss(of),
    };
    format!("{value}\n")
}
