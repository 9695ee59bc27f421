//! The commands: one file each, with options, help and what is done; grouped by what they act on.

mod board;
mod control;
mod demo;
mod machine;
mod record;
mod scan;
mod solve;

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::show::terminal::{CAUTION, paint, print_error};
use clap::builder::{OsStringValueParser, TypedValueParser as _};
use clap::{Args, Subcommand};
use umi_client::board::link::Client;
use umi_client::files::job_file::{self, SessionJob};
use umi_client::files::key_file::{self, SigningKey};
use umi_client::problem::Problem;
use umi_protocol::job::Job;

/// A command with its options.
#[derive(Subcommand)]
pub(crate) enum Command {
    Demo(demo::Demo),
    Fit(solve::fit::Fit),
    Register(solve::register::Register),
    Replay(record::replay::Replay),
    Scan(scan::Scan),
    Job(board::job::Job),
    Line(board::line::Line),
    Teach(board::teach::Teach),
    Selftest(board::selftest::Selftest),
    Info(board::info::Info),
    Log(record::log::Log),
    Key(record::key::Key),
    Access(board::access::Access),
    Wipe(board::wipe::Wipe),
    Config(board::config::Config),
    Image(board::update::image::Image),
    Update(board::update::Update),
    Events(record::events::Events),
    Watch(board::watch::Watch),
    Machine(machine::Machine),
    Nc(control::nc::Nc),
    Correction(control::correction::Correction),
    Dialects(control::dialects::Dialects),
    Program(control::program::Program),
    #[command(name = "virtual")]
    Virtual(board::virtual_board::Virtual),
}

impl Command {
    /// Does it.
    pub fn run(self) -> Result<(), Failure> {
        match self {
            Self::Demo(command) => command.run(),
            Self::Fit(command) => command.run(),
            Self::Register(command) => command.run(),
            Self::Replay(command) => command.run(),
            Self::Scan(command) => command.run(),
            Self::Job(command) => command.run(),
            Self::Line(command) => command.run(),
            Self::Teach(command) => command.run(),
            Self::Info(command) => command.run(),
            Self::Log(command) => command.run(),
            Self::Key(command) => command.run(),
            Self::Access(command) => command.run(),
            Self::Wipe(command) => command.run(),
            Self::Config(command) => command.run(),
            Self::Image(command) => command.run(),
            Self::Update(command) => command.run(),
            Self::Events(command) => command.run(),
            Self::Watch(command) => command.run(),
            Self::Machine(command) => command.run(),
            Self::Nc(command) => command.run(),
            Self::Correction(command) => command.run(),
            Self::Dialects(command) => command.run(),
            Self::Program(command) => command.run(),
            Self::Virtual(command) => command.run(),
            Self::Selftest(command) => command.run(),
        }
    }
}

/// The job of a session that is replayed or simulated; says what was taken for it that its file
/// does not say.
pub(crate) fn session_job(path: &Path) -> Result<Job, Failure> {
    let SessionJob {
        job,
        teach_is_missing,
    } = job_file::load_for_session(path)?;
    if teach_is_missing {
        print_error(&format!(
            "{} {} does not say `teach`: here the first OK setup is the reference, whichever it \
             is; a board with this job teaches nothing before `umi teach`. Say teach = \
             \"first_ok\" or \"asked\"\n",
            paint(CAUTION, "note"),
            path.display()
        ));
    }
    Ok(job)
}

/// How results are printed.
#[derive(Args)]
pub(crate) struct Format {
    /// Print JSON for machines instead of text for people
    #[arg(long, global = true)]
    pub json: bool,
}

/// Which board is meant.
#[derive(Args)]
pub(crate) struct Port {
    /// The board: a serial port as /dev/ttyACM0 or COM3, or tcp://host:port.
    /// Without it, the only openumi board that is plugged in
    #[arg(
        long,
        value_name = "ADDRESS",
        env = "UMI_PORT",
        hide_env_values = true,
        global = true
    )]
    pub port: Option<String>,
}

/// Which board is meant, and who asks.
#[derive(Args)]
pub(crate) struct Board {
    #[command(flatten)]
    port: Port,
    /// The secret key to prove to a board that has an owner (umi key new). Its passphrase, if it has
    /// one, is asked for at the terminal
    // An empty variable is none, which a parser of paths would refuse.
    #[arg(id = "user_key", long = "key", value_name = "FILE", env = "UMI_KEY",
          value_parser = OsStringValueParser::new().map(PathBuf::from))]
    key: Option<PathBuf>,
}

impl Board {
    /// Its address, if one was given.
    pub fn address(&self) -> Option<&str> {
        let port = self.port.port.as_deref();
        port.filter(|address| !address.is_empty())
    }

    /// The key, if one was given.
    pub fn key(&self) -> Result<Option<SigningKey>, Problem> {
        let path = self.key.as_deref();
        let path = path.filter(|path| !path.as_os_str().is_empty());
        path.map(|path| key_file::read_secret(path, || passphrase(path)))
            .transpose()
    }

    /// Connects to it, and proves the key if it has an owner.
    pub fn connect(&self) -> Result<Client, Problem> {
        umi_client::board::port::connect_with(self.address(), self.key()?.as_ref())
    }
}

/// Asks for the passphrase of a key.
fn passphrase(path: &Path) -> Result<String, Problem> {
    if !std::io::stdin().is_terminal() {
        let message = format_args!(
            "{} has a passphrase, and there is no terminal to ask for it: use a key that was made with --no-passphrase",
            path.display()
        );
        return Err(Problem::trouble("usage", message));
    }
    let prompt = format!("passphrase of {}: ", path.display());
    rpassword::prompt_password(prompt)
        .map_err(|error| Problem::trouble("terminal", format_args!("the terminal: {error}")))
}
