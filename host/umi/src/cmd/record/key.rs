//! `umi key`: keys of people.

use std::io::IsTerminal as _;
use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde_json::json;
use umi_client::files::key_file;
use umi_client::journal::{hex, key_id};

use crate::cmd::Format;
use crate::failure::Failure;
use crate::show::terminal::{GOOD, paint, print, print_json};

/// Make a key pair, or show a public key
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi key new anna
  umi key show anna.pub")]
pub(crate) struct Key {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    New(New),
    Show(Show),
}

/// Make a key pair: FILE, which only its owner can read, and FILE.pub
#[derive(Args)]
#[command(after_help = "\
The passphrase is asked for twice at the terminal; the file is PKCS #8 as PEM, encrypted by it.
Nothing that is there is replaced.

Examples:
  umi key new anna
  umi key new station-4 --no-passphrase")]
struct New {
    /// The secret key's file
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Who can read the file has the key: for machines that nobody sits at
    #[arg(long)]
    no_passphrase: bool,
    #[command(flatten)]
    format: Format,
}

/// Show a public key and its short name
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi key show anna.pub
  umi key show board.pub --json")]
struct Show {
    /// The public key
    #[arg(value_name = "FILE.pub")]
    file: PathBuf,
    #[command(flatten)]
    format: Format,
}

impl Key {
    pub fn run(self) -> Result<(), Failure> {
        match self.action {
            Action::New(command) => command.run(),
            Action::Show(command) => command.run(),
        }
    }
}

impl New {
    fn run(self) -> Result<(), Failure> {
        let passphrase = if self.no_passphrase {
            None
        } else {
            Some(ask()?)
        };
        let made = key_file::new(&self.file, passphrase.as_deref())?;
        if self.format.json {
            return print_json(&json!({
                "key_id": key_id(&made.public),
                "public": hex(&made.public),
                "file": self.file.display().to_string(),
                "public_file": made.public_file.display().to_string(),
            }));
        }
        print(&format!(
            "{} in {}; give {} to others\n",
            paint(GOOD, format_args!("key {}", key_id(&made.public))),
            self.file.display(),
            made.public_file.display(),
        ))
    }
}

impl Show {
    fn run(self) -> Result<(), Failure> {
        let public = key_file::read_public(&self.file)?;
        if self.format.json {
            return print_json(&json!({
                "key_id": key_id(&public),
                "public": hex(&public),
            }));
        }
        print(&format!("key {}\n{}\n", key_id(&public), hex(&public)))
    }
}

/// A passphrase, twice the same.
fn ask() -> Result<String, Failure> {
    if !std::io::stdin().is_terminal() {
        return Err(Failure::trouble(
            "usage",
            "there is no terminal to ask for a passphrase: --no-passphrase makes a key without one",
        ));
    }
    let trouble = |error| Failure::trouble("terminal", format_args!("the terminal: {error}"));
    let first = rpassword::prompt_password("passphrase: ").map_err(trouble)?;
    let again = rpassword::prompt_password("once more: ").map_err(trouble)?;
    if first.is_empty() || first != again {
        return Err(Failure::trouble(
            "usage",
            "the passphrase is empty, or was not the same twice: nothing was made",
        ));
    }
    Ok(first)
}
