//! The commands: one file each, with options, help and what is done; grouped by what they act on.

mod board;
mod control;
mod demo;
mod machine;
mod record;
mod scan;
mod solve;

use crate::failure::Failure;
use clap::{Args, Subcommand};
use umi_client::link::Client;
use umi_client::problem::Problem;

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
    Info(board::info::Info),
    Log(record::log::Log),
    Key(record::key::Key),
    Access(board::access::Access),
    Config(board::config::Config),
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
            Self::Config(command) => command.run(),
            Self::Events(command) => command.run(),
            Self::Watch(command) => command.run(),
            Self::Machine(command) => command.run(),
            Self::Nc(command) => command.run(),
            Self::Correction(command) => command.run(),
            Self::Dialects(command) => command.run(),
            Self::Program(command) => command.run(),
            Self::Virtual(command) => command.run(),
        }
    }
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
pub(crate) struct Board {
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

impl Board {
    /// Its address, if one was given.
    pub fn address(&self) -> Option<&str> {
        self.port.as_deref().filter(|address| !address.is_empty())
    }

    /// Connects to it.
    pub fn connect(&self) -> Result<Client, Problem> {
        umi_client::port::connect(self.address())
    }
}
