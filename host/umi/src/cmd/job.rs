//! `umi job`

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::json;
use umi::failure::Failure;
use umi::style::{GOOD, paint, print, print_json};
use umi::{jobfile, jobtext};

use super::{Board, Format};

/// Check a job file, or read and replace the job of a board
#[derive(Args)]
#[command(after_help = HELP)]
pub struct Job {
    #[command(subcommand)]
    action: Action,
}

const HELP: &str = "\
Examples:
  umi job check plate.toml
  umi job set plate.toml --port /dev/ttyACM0
  umi job show --port tcp://localhost:7001
  umi job get --port /dev/ttyACM0 -o backup.toml";

#[derive(Subcommand)]
enum Action {
    Check(Check),
    Show(Show),
    Set(Set),
    Get(Get),
}

/// Check a job file and show what it says
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi job check examples/three-spheres.toml
  umi job check plate.toml --json       the job as JSON, or {\"error\":{...}}

Exit status: 0 good, 1 file or usage, 2 the job is refused.")]
struct Check {
    /// The job; `-` is standard input
    #[arg(value_name = "JOB.toml")]
    file: PathBuf,
    #[command(flatten)]
    format: Format,
}

/// Show the job that a board works on
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi job show                          the only board that is plugged in
  umi job show --port tcp://localhost:7001 --json")]
struct Show {
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Give a board a job; it forgets the reference that it was taught
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi job set plate.toml --port /dev/ttyACM0

The file is checked first, here and on the board. The job is then read back.
Exit status: 0 set, 1 file, usage or connection, 2 the job is refused.")]
struct Set {
    /// The job; `-` is standard input
    #[arg(value_name = "JOB.toml")]
    file: PathBuf,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Write the job of a board as a job file
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi job get > backup.toml
  umi job get --port /dev/ttyACM0 -o backup.toml")]
struct Get {
    #[command(flatten)]
    board: Board,
    /// Write to this file instead of standard output
    #[arg(short, long, value_name = "JOB.toml")]
    output: Option<PathBuf>,
}

impl Job {
    pub fn run(self) -> Result<(), Failure> {
        match self.action {
            Action::Check(action) => action.run(),
            Action::Show(action) => action.run(),
            Action::Set(action) => action.run(),
            Action::Get(action) => action.run(),
        }
    }

    pub const fn json(&self) -> bool {
        match &self.action {
            Action::Check(action) => action.format.json,
            Action::Show(action) => action.format.json,
            Action::Set(action) => action.format.json,
            Action::Get(_) => false,
        }
    }
}

impl Check {
    fn run(self) -> Result<(), Failure> {
        let job = jobfile::load(&self.file)?;
        if self.format.json {
            return print_json(&json!({ "status": "ok", "job": job }));
        }
        let good = format!("{} can be used", umi::points::name(&self.file));
        print(&format!("{}\n{}\n", jobtext::text(&job), paint(GOOD, good)))
    }
}

impl Show {
    fn run(self) -> Result<(), Failure> {
        let in_force = self.board.connect()?.job()?;
        if self.format.json {
            return print_json(&json!({
                "job": in_force.job,
                "taught_mm": in_force.taught_mm,
            }));
        }
        let Some(job) = in_force.job else {
            return Err(no_job());
        };
        let mut text = jobtext::text(&job);
        if let Some(taught) = in_force.taught_mm {
            text += &format!("\n{}", jobtext::taught(&taught, &job));
        }
        print(&text)
    }
}

impl Set {
    fn run(self) -> Result<(), Failure> {
        let job = jobfile::load(&self.file)?;
        let mut board = self.board.connect()?;
        if let Err(refused) = board.set_job(&job)? {
            return Err(jobfile::refusal(&refused));
        }
        // What counts is what the board has, not what was sent.
        if board.job()?.job.as_ref() != Some(&job) {
            return Err(Failure::trouble(
                "job_not_kept",
                "the board took the job but has another one now: is another program connected to it? set the job again",
            ));
        }
        if self.format.json {
            return print_json(&json!({ "status": "ok", "job": job }));
        }
        let done = format!("{} now works on job {}", board.board(), job.name);
        print(&format!("{}\n", paint(GOOD, done)))
    }
}

impl Get {
    fn run(self) -> Result<(), Failure> {
        let job = self.board.connect()?.job()?.job.ok_or_else(no_job)?;
        let text = jobfile::write(&job)?;
        match self.output.as_deref() {
            None => print(&text),
            Some(path) if path == Path::new("-") => print(&text),
            Some(path) => {
                std::fs::write(path, text).map_err(|error| Failure::file("write", path, &error))
            }
        }
    }
}

fn no_job() -> Failure {
    Failure::refused(
        "no_job",
        "the board has no job; give it one with `umi job set JOB.toml`",
    )
}
