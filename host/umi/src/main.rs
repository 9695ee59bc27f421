//! The openumi host tool.

mod cmd;
mod failure;
mod interrupt;
mod output;
mod show;
mod watch;

use std::process::ExitCode;

use crate::show::terminal::{BAD, paint, print_error, print_json};
use clap::Parser;
use umi_client::problem::Problem;

/// The host tool of openumi, the board between a machine tool's control and its probe.
#[derive(Parser)]
#[command(name = "umi", version, propagate_version = true, after_help = EXIT_STATUS)]
struct Cli {
    // Both stand before a command or behind it; each command has its own copy.
    #[command(flatten)]
    format: cmd::Format,
    #[command(flatten)]
    _port: cmd::Port,
    #[command(subcommand)]
    command: cmd::Command,
}

const EXIT_STATUS: &str = "\
Exit status:
  0  done; a verdict is OK
  1  it could not be done: usage, a file, a port, the connection to the board
  2  it was done and the answer is no: refused, NG, a faulty record

With --json a command prints JSON to standard output, also where it fails:
{\"error\":{\"code\":\"...\",\"message\":\"...\"}}. Colours are for terminals only;
NO_COLOR=1 turns them off.";

/// Whether JSON is asked for, where the command line as a whole cannot be understood.
fn wants_json() -> bool {
    let words = std::env::args_os().skip(1);
    words
        .take_while(|word| word != "--")
        .any(|word| word == "--json")
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Nobody to tell if even this cannot be printed.
            let _ = if error.use_stderr() && wants_json() {
                let text = error.render().to_string();
                let said = text.strip_prefix("error: ").unwrap_or(&text).trim();
                print_json(&Problem::trouble("usage", said).json()).is_ok()
            } else {
                error.print().is_ok()
            };
            // Asking for help is no error; anything else is a wrong use.
            return ExitCode::from(u8::from(error.use_stderr()));
        }
    };
    let json = cli.format.json;
    interrupt::end_on_hang_up();
    let Err(failure) = cli.command.run() else {
        return ExitCode::SUCCESS;
    };
    if let Some(problem) = failure.problem() {
        if json {
            // If standard output is closed, the status still says it.
            let _ = print_json(&problem.json());
        } else {
            print_error(&format!("{} {}\n", paint(BAD, "error:"), problem.message));
        }
    }
    ExitCode::from(failure.status())
}
