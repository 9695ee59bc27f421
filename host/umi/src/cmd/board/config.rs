//! `umi config`: what the owner of a board allows.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::{Value, json};
use umi_client::board::link::{Client, ConfigRefusal};
use umi_client::files::{config_file, job_file};
use umi_protocol::config::{BoardConfig, Fallbacks};
use umi_protocol::job_error::JobError;

use crate::cmd::{Board, Format};
use crate::failure::Failure;
use crate::show::terminal::{CAUTION, GOOD, paint, print, print_json};

/// Read and set what the owner of a board allows, whatever a job asks for
#[derive(Args)]
#[command(after_help = "\
Ceilings bound the limits of every job that anybody sets: a job with a wider limit is refused
(beyond_ceiling). `journal.full = refuse` has the board send nothing before evidence would be
overwritten that nobody has acknowledged (umi log ack). [access]: `locked_reading = nobody` keeps a
locked board's jobs, programs and journal from every key until an owner unlocks it;
`session_idle_s` ends a session whose host asks nothing for so long; `button_off` has the board's
button teach nothing. Keys are no configuration: umi access.

Examples:
  umi config get > board.toml
  umi config set ceilings.rms_mm 0.01
  umi config set ceilings.always false
  umi config set journal.full refuse
  umi config set access.session_idle_s 600
  umi config apply board.toml")]
pub(crate) struct Config {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    Get(Get),
    Set(Set),
    Check(Check),
    Diff(Diff),
    Apply(Apply),
}

/// Show the configuration of a board, as a file
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi config get > board.toml
  umi config get --json")]
struct Get {
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Set one field
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi config set ceilings.rms_mm 0.01
  umi config set ceilings.rms_mm none        any
  umi config set ceilings.require_witness true")]
struct Set {
    /// The field, as `ceilings.rms_mm`
    #[arg(value_name = "FIELD")]
    field: String,
    /// Its value; `none` takes a number away
    #[arg(value_name = "VALUE", allow_negative_numbers = true)]
    value: String,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Check a file, without a board
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi config check board.toml")]
struct Check {
    /// The configuration
    #[arg(value_name = "FILE.toml")]
    file: PathBuf,
    #[command(flatten)]
    format: Format,
}

/// Show where a file and a board differ
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi config diff board.toml --port /dev/ttyACM0")]
struct Diff {
    /// The configuration
    #[arg(value_name = "FILE.toml")]
    file: PathBuf,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Set all fields as a file says; what it does not say is as on a new board
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi config apply board.toml --port /dev/ttyACM0")]
struct Apply {
    /// The configuration
    #[arg(value_name = "FILE.toml")]
    file: PathBuf,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

impl Config {
    pub fn run(self) -> Result<(), Failure> {
        match self.action {
            Action::Get(command) => command.run(),
            Action::Set(command) => command.run(),
            Action::Check(command) => command.run(),
            Action::Diff(command) => command.run(),
            Action::Apply(command) => command.run(),
        }
    }
}

impl Get {
    fn run(self) -> Result<(), Failure> {
        let (config, fallbacks) = read_board(&mut self.board.connect()?)?;
        if self.format.json {
            return show(&config, &fallbacks);
        }
        let mut text = config_file::text(&config);
        for field in &fallbacks {
            text += &format!(
                "# {} could not be read on the board: it is as strict as can be until it is set\n",
                field.name()
            );
        }
        print(&text)
    }
}

impl Set {
    fn run(self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        let (before, fallbacks) = read_board(&mut board)?;
        let config = config_file::set(&before, &self.field, &self.value);
        let config = match config {
            // Another field than the one that was set.
            Err(problem) if fallbacks.iter().any(|of| of.name() != self.field) => {
                let note = "\nthe board could not read what was set before (umi config get): set all fields at once, by `umi config apply`";
                return Err(Failure::from(problem).noted(note));
            }
            config => config?,
        };
        replace(&mut board, &config, self.format.json)
    }
}

impl Check {
    fn run(self) -> Result<(), Failure> {
        let config = read_file(&self.file)?;
        if self.format.json {
            return show(&config, &Fallbacks::new());
        }
        print(&format!(
            "{}\n",
            paint(GOOD, "the configuration can be used")
        ))
    }
}

impl Diff {
    fn run(self) -> Result<(), Failure> {
        let ours = read_file(&self.file)?;
        let (theirs, _) = read_board(&mut self.board.connect()?)?;
        let of_board = config_file::fields(&theirs);
        let differences: Vec<_> = config_file::fields(&ours)
            .into_iter()
            .zip(of_board)
            .filter(|((_, ours), (_, theirs))| ours != theirs)
            .map(|((field, ours), (_, theirs))| (field, ours, theirs))
            .collect();
        if self.format.json {
            let list: Vec<_> = differences
                .iter()
                .map(|(field, ours, theirs)| json!({"field": field, "file": ours, "board": theirs}))
                .collect();
            return print_json(&json!({"same": list.is_empty(), "differences": list}));
        }
        if differences.is_empty() {
            return print(&format!("{}\n", paint(GOOD, "no difference")));
        }
        let word = |field: &str, value: &Value| match value {
            Value::Null => config_file::unset(field).to_owned(),
            value => value.to_string(),
        };
        let lines = differences.iter().map(|(field, ours, theirs)| {
            let (ours, theirs) = (word(field, ours), word(field, theirs));
            let text = format!("{field}: {theirs} on the board, {ours} in the file");
            format!("{}\n", paint(CAUTION, text))
        });
        print(&lines.collect::<String>())
    }
}

impl Apply {
    fn run(self) -> Result<(), Failure> {
        let config = read_file(&self.file)?;
        // As a copy that broke off leaves one.
        if std::fs::metadata(&self.file).is_ok_and(|found| found.len() == 0) {
            return Err(Failure::refused(
                "config_syntax",
                "the file is empty, and would take every ceiling away: to do that, write [ceilings] alone",
            ));
        }
        replace(&mut self.board.connect()?, &config, self.format.json)
    }
}

fn read_file(path: &Path) -> Result<BoardConfig, Failure> {
    let source =
        std::fs::read_to_string(path).map_err(|error| Failure::file("read", path, &error))?;
    Ok(config_file::parse(&source)?)
}

fn read_board(board: &mut Client) -> Result<(BoardConfig, Fallbacks), Failure> {
    board.config()?.ok_or_else(not_on_this_board)
}

fn replace(board: &mut Client, config: &BoardConfig, json: bool) -> Result<(), Failure> {
    match board.set_config(config)? {
        Ok(()) => {}
        Err(ConfigRefusal::Field(field)) => return Err(config_file::bad_field(field).into()),
        Err(ConfigRefusal::NotOnThisBoard) => return Err(not_on_this_board()),
        Err(ConfigRefusal::Job(error)) => {
            let problem = job_file::refusal(&error);
            if error == JobError::TooOften {
                return Err(problem.into());
            }
            let note = "\nthe job in force asks for more: set another job first";
            return Err(Failure::from(problem).noted(note));
        }
    }
    // What counts is what the board has, not what was sent.
    let (config, fallbacks) = read_board(board)?;
    if json {
        return show(&config, &fallbacks);
    }
    print(&config_file::text(&config))
}

fn show(config: &BoardConfig, fallbacks: &Fallbacks) -> Result<(), Failure> {
    let fallbacks: Vec<_> = fallbacks.iter().map(|field| field.name()).collect();
    print_json(&json!({
        "config": config_file::json(config),
        "version": config_file::VERSION,
        "fallbacks": fallbacks,
    }))
}

fn not_on_this_board() -> Failure {
    Failure::refused(
        "not_on_this_board",
        "this board keeps no configuration: its ceilings are those of the job alone",
    )
}
