//! `umi image`: images of a board's firmware, signed by who makes it.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde_json::{Value, json};
use umi_client::files::{image_file, key_file};
use umi_client::journal::hex;
use umi_client::problem::Problem;
use umi_core::trust::access::update::image::ImageHeader;
use umi_protocol::update::ImageVersion;

use crate::cmd::{Format, passphrase};
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{CAUTION, GOOD, Table, paint, print, print_json};

/// Sign an image of a board's firmware, or show one
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi key new fw
  umi image sign firmware.bin --board virtual --version 1.2.0 --counter 3 --key fw -o virtual.umif
  umi image show virtual.umif")]
pub(crate) struct Image {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    Sign(Sign),
    Show(Show),
}

/// Write an image with its board, version, security counter and signature
#[derive(Args)]
// `--version` is the image's here.
#[command(
    disable_version_flag = true,
    after_help = "\
A board takes an image if it has the public key of this one, is of this kind, and runs neither a
higher version nor a higher counter. Raise the counter where what came before must never run again.
The image of a virtual board is a text of two lines: `umi-virtual-image` and `confirms = true`.

Examples:
  umi image sign payload.txt --board virtual --version 1.2.0 --counter 3 --key fw -o virtual.umif"
)]
struct Sign {
    /// The image
    #[arg(value_name = "PAYLOAD")]
    payload: PathBuf,
    /// The kind of board that it is for, as `umi info` says it
    #[arg(long, value_name = "B")]
    board: String,
    /// Its version
    #[arg(long = "version", value_name = "X.Y.Z", value_parser = image_file::parse_version)]
    of_version: ImageVersion,
    /// Its security counter
    #[arg(long, value_name = "N")]
    counter: u32,
    /// The secret key of who makes the firmware (umi key new). Its passphrase, if it has one, is
    /// asked for at the terminal
    #[arg(id = "maker_key", long = "key", value_name = "FW")]
    key: PathBuf,
    /// The signed image
    #[arg(short, long, value_name = "OUT.umif")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    format: Format,
}

/// Show what a signed image says of itself
#[derive(Args)]
#[command(after_help = "\
Its bytes are held against its header. Whose signature it is only --key says: without it, anybody
can have made the file.

Examples:
  umi image show virtual.umif
  umi image show virtual.umif --key fw.pub --json")]
struct Show {
    /// The image
    #[arg(value_name = "FILE.umif")]
    file: PathBuf,
    /// The public key that it is to be signed by
    #[arg(id = "maker_key", long = "key", value_name = "FW.pub")]
    key: Option<PathBuf>,
    #[command(flatten)]
    format: Format,
}

impl Image {
    pub fn run(self) -> Result<(), Failure> {
        match self.action {
            Action::Sign(command) => command.run(),
            Action::Show(command) => command.run(),
        }
    }
}

impl Sign {
    fn run(self) -> Result<(), Failure> {
        let inputs = [self.payload.as_path(), self.key.as_path()];
        self.force.check(&self.output, &inputs)?;
        let payload = std::fs::read(&self.payload)
            .map_err(|error| Failure::file("read", &self.payload, &error))?;
        let maker = key_file::read_secret(&self.key, || passphrase(&self.key))?;
        let (header, bytes) =
            image_file::sign(&payload, &self.board, self.of_version, self.counter, &maker)?;
        self.force.write(&self.output, &inputs, bytes)?;
        if self.format.json {
            let mut shown = header_json(&header);
            shown["file"] = self.output.display().to_string().into();
            return print_json(&shown);
        }
        let done = format!("signed by key {}", hex(&header.key_id));
        print(&format!(
            "{}, in {}\n{}",
            paint(GOOD, done),
            self.output.display(),
            table(&header)
        ))
    }
}

impl Show {
    fn run(self) -> Result<(), Failure> {
        let image = image_file::read(&self.file)?;
        let signed = match &self.key {
            None => None,
            Some(path) => {
                let maker = key_file::read_public(path)?;
                if !image.header.is_signed(image.signature, &maker) {
                    let message = format_args!(
                        "{} is not signed by the key in {}",
                        self.file.display(),
                        path.display()
                    );
                    return Err(Problem::refused("image_signature", message).into());
                }
                Some(true)
            }
        };
        if self.format.json {
            let mut shown = header_json(&image.header);
            shown["signed"] = signed.into();
            return print_json(&shown);
        }
        let told = match signed {
            Some(_) => paint(GOOD, "signed by this key\n"),
            None => paint(
                CAUTION,
                "not held against a key: anybody can have made it (--key FW.pub)\n",
            ),
        };
        print(&format!("{told}{}", table(&image.header)))
    }
}

/// A header for machines.
fn header_json(header: &ImageHeader) -> Value {
    json!({
        "board": header.board.as_str(),
        "version": image_file::version_text(header.version),
        "counter": header.counter,
        "length": header.length,
        "sha512": hex(&header.sha512),
        "key_id": hex(&header.key_id),
    })
}

/// A header for people.
fn table(header: &ImageHeader) -> Table {
    let mut table = Table::new("<<");
    for (name, value) in [
        ("board", header.board.to_string()),
        ("version", image_file::version_text(header.version)),
        ("security counter", header.counter.to_string()),
        ("bytes", header.length.to_string()),
        ("SHA-512", hex(&header.sha512)),
        ("key", hex(&header.key_id)),
    ] {
        table.row([name.to_owned(), value]);
    }
    table
}
