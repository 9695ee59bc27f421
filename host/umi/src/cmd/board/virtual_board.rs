//! `umi virtual`

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use crate::failure::Failure;
use crate::show::terminal::{TITLE, paint, print, print_json};
use clap::Args;
use serde_json::json;
use umi_client::files::key_file;
use umi_virtual::serve::{Port, PortPlace};
use umi_virtual::{
    ACCESS, BoardTime, CUSTODY, Config, EVIDENCE, ImageAreas, JOURNAL, KEY, PROGRAMS, SETTINGS,
    VirtualBoard, VirtualFlash,
};

use crate::cmd::Format;

/// A virtual board on ports of this machine, until Ctrl-C
#[derive(Args)]
#[command(name = "virtual", after_help = HELP)]
pub(crate) struct Virtual {
    /// The control's port: `pty`, or `tcp:PORT` (0: any free one)
    #[arg(long, value_name = "PLACE", default_value = "pty", value_parser = place)]
    cnc: PortPlace,
    /// The host's port: `pty`, or `tcp:PORT` (0: any free one)
    #[arg(long, value_name = "PLACE", default_value = "pty", value_parser = place)]
    usb: PortPlace,
    /// The teaching button: a TCP port of this machine, `tcp:PORT` (0: any free one); the button is
    /// pressed as long as somebody is connected. Held for a second it asks to teach
    #[arg(long, value_name = "PLACE", value_parser = tcp_place)]
    button: Option<PortPlace>,
    /// Another pace of the control's line than that of the job's [line] (115200 baud without a job), which bytes keep
    /// at most: one to the control takes a millisecond or more. Pauses and patience stay those of the job's [line].
    /// The control is set as the board is, always: any [line] is right, and `umi line find` fits at each speed
    #[arg(long, value_name = "BAUD",
          value_parser = clap::value_parser!(u32).range(50..=10_000_000))]
    baud: Option<u32>,
    /// The board's jumper: closed, the first owner's key can be enrolled and the board be wiped
    #[arg(long, value_name = "STATE", default_value = "open", value_parser = ["closed", "open"])]
    jumper: String,
    /// The public key of who makes the board's firmware: it takes images that are signed by it. Taken
    /// at the first start of a --state, and kept there
    #[arg(long, value_name = "FW.pub")]
    firmware_key: Option<PathBuf>,
    /// Keep the board's flash (job, reference, journal, programs, keys, images) in this folder; without it
    /// every start is a new board
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
It is the application of the firmware images in a process. Any terminal program can
be the control, and umi connects to it as to hardware.

Examples:
  umi virtual
  umi virtual --cnc tcp:5052 --usb tcp:5053 --state board
then, in other terminals, with the addresses that it prints:
  umi job set examples/three-spheres.toml --port /dev/pts/4
  cat session.txt > /dev/pts/3
  umi log --port /dev/pts/4

Its first owner, with the jumper closed:
  umi virtual --jumper closed --state board
  umi key new anna && umi access enrol anna.pub --role owner --port /dev/pts/4

Signed updates, as on a board whose maker's key is built in (umi update):
  umi key new fw --no-passphrase
  umi virtual --firmware-key fw.pub --state board

A job that teaches when asked: hold the board's button for a second instead of `umi teach`
  umi virtual --button tcp:5054
  (sleep 1.5) | nc 127.0.0.1 5054

The control asks for the correction program with DC1 (READ), as in
  printf '\\021' > /dev/pts/3; cat /dev/pts/3";

/// Where a port is to be.
pub fn place(text: &str) -> Result<PortPlace, String> {
    match text.split_once(':') {
        None if text == "pty" => Ok(PortPlace::Pty),
        Some(("tcp", port)) => match port.parse() {
            Ok(port) => Ok(PortPlace::Tcp(port)),
            Err(_) => Err(format!("`{port}` is no TCP port: give 0 to 65535")),
        },
        _ => Err("give `pty` or `tcp:PORT`".into()),
    }
}

/// Where the button is to be: a pseudo-terminal does not say whether somebody holds it.
fn tcp_place(text: &str) -> Result<PortPlace, String> {
    match place(text) {
        Ok(PortPlace::Pty) => Err("give `tcp:PORT`".into()),
        other => other,
    }
}

impl Virtual {
    pub fn run(self) -> Result<(), Failure> {
        let trouble = |error| Failure::trouble("virtual_board", error);
        let mut config = Config {
            time: BoardTime::Real,
            // A start bit, eight data bits and a stop bit.
            character: self
                .baud
                .map_or(Duration::ZERO, |baud| Duration::from_secs(10) / baud),
            paced_by_job: self.baud.is_none(),
            key: Some(VirtualFlash::in_memory(KEY)),
            jumper: self.jumper == "closed",
            firmware_key: self
                .firmware_key
                .as_deref()
                .map(key_file::read_public)
                .transpose()?,
            ..Config::default()
        };
        if let Some(state) = &self.state {
            let failed = |error| Failure::file("use", state, &error);
            std::fs::create_dir_all(state).map_err(failed)?;
            config.journal =
                VirtualFlash::in_file(JOURNAL, &state.join("journal.flash")).map_err(failed)?;
            config.evidence = Some(
                VirtualFlash::in_file(EVIDENCE, &state.join("evidence.flash")).map_err(failed)?,
            );
            config.custody =
                Some(VirtualFlash::in_file(CUSTODY, &state.join("custody.flash")).map_err(failed)?);
            config.settings =
                VirtualFlash::in_file(SETTINGS, &state.join("settings.flash")).map_err(failed)?;
            config.programs =
                VirtualFlash::in_file(PROGRAMS, &state.join("programs.flash")).map_err(failed)?;
            config.key =
                Some(VirtualFlash::in_file(KEY, &state.join("key.flash")).map_err(failed)?);
            config.access =
                Some(VirtualFlash::in_file(ACCESS, &state.join("access.flash")).map_err(failed)?);
            config.images = Some(ImageAreas::in_folder(state).map_err(failed)?);
        }
        let board = Arc::new(VirtualBoard::start(config).map_err(trouble)?);
        let cnc = Port::open(&self.cnc).map_err(trouble)?;
        let usb = Port::open(&self.usb).map_err(trouble)?;
        let button = self.button.as_ref().map(Port::open);
        let button = button.transpose().map_err(trouble)?;
        let button_at = button.as_ref().map(|button| button.address.clone());
        if self.format.json {
            print_json(&json!({
                "type": "virtual",
                "cnc": cnc.address,
                "usb": usb.address,
                "baud": self.baud,
                "button": button_at,
            }))?;
        } else {
            let button_at = button_at.map_or_else(String::new, |at| {
                format!("  button   {at}   (pressed as long as somebody is connected)\n")
            });
            let pace = match self.baud {
                Some(baud) => format!("{baud} baud"),
                None => "as fast as the job's line".into(),
            };
            print(&format!(
                "{}\n  control  {}   (any terminal program, {pace})\n  host     {}   (umi info --port {})\n{button_at}Ctrl-C ends it.\n",
                paint(TITLE, "virtual board"),
                cnc.address,
                usb.address,
                usb.address,
            ))?;
        }
        cnc.serve_control(&board);
        usb.serve_host(&board);
        if let Some(button) = button {
            button.serve_button(&board);
        }
        loop {
            std::thread::park();
        }
    }
}
