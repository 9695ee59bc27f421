//! `umi access`: whose board it is.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde_json::{Value, json};
use umi_client::board::link::LinkError;
use umi_client::files::key_file;
use umi_client::journal::{self, PATIENCE, hex, key_id};
use umi_protocol::access::{
    AccessInfo, AccessMode, AccessRefusal, KeyId, KeyInfo, KeyName, MAX_KEY_NAME, Role,
};

use crate::cmd::record::log::unsigned;
use crate::cmd::{Board, Format};
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{CAUTION, GOOD, Table, paint, print, print_json};

use super::wipe::not_on_this_board;

/// Who may do what with a board, and the key with which it signs its journal
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi key new anna
  umi access enrol anna.pub --role owner --name Anna      the first: with the board's jumper closed
  umi access enrol ben.pub --role engineer --key anna
  umi access show --key anna
  umi access revoke 6a1c2f0e5b7d9384 --key anna
  umi access lock --key anna
  umi access board-key -o board.pub

operator  reads: journal, job, verdicts, programs
engineer  changes what is measured and what moves: job, programs, trigger pulses, laser
owner     keys, lock, ceilings, wiping")]
pub(crate) struct Access {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    Show(Show),
    BoardKey(BoardKey),
    Enrol(Enrol),
    Revoke(Revoke),
    Lock(Lock),
    Unlock(Unlock),
}

/// Show who may do what with a board
#[derive(Args)]
#[command(after_help = "\
open     the board has no owner: whoever reaches its port may do everything
claimed  it asks for keys
locked   it changes nothing, and reads to keys only, until an owner unlocks it

The keys are shown to operators and above (--key), and on an open board to everybody. A board that
reads no jumper says null there: it cannot be claimed.

Examples:
  umi access show
  umi access show --json --port /dev/ttyACM0")]
struct Show {
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Ask a board for its public key, and have it show that it has the secret one
#[derive(Args)]
#[command(after_help = "\
Ask at the board, over its own cable, and keep the file where nobody else can change it: it is
what `umi log verify --key` rests on.

Examples:
  umi access board-key -o board.pub
  umi access board-key --json")]
struct BoardKey {
    /// Write it to this file
    #[arg(short, long, value_name = "BOARD.pub")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

impl Access {
    pub fn run(self) -> Result<(), Failure> {
        match self.action {
            Action::Show(command) => command.run(),
            Action::BoardKey(command) => command.run(),
            Action::Enrol(command) => command.run(),
            Action::Revoke(command) => command.run(),
            Action::Lock(command) => set_lock(&command.board, &command.format, true),
            Action::Unlock(command) => set_lock(&command.board, &command.format, false),
        }
    }
}

/// What a board lets read; none: its owner lets nobody read while it is locked.
pub(super) fn unless_locked<T>(asked: Result<T, LinkError>) -> Result<Option<T>, LinkError> {
    match asked {
        Err(LinkError::Refused(AccessRefusal::Locked)) => Ok(None),
        other => other.map(Some),
    }
}

/// What a mode means to somebody at the board.
pub(super) const fn about(mode: AccessMode) -> &'static str {
    match mode {
        AccessMode::Open => "open: whoever reaches the port may do everything",
        AccessMode::Claimed => "claimed: who asks needs a key",
        AccessMode::Locked => "locked: nothing is changed until an owner unlocks it",
    }
}

impl Show {
    fn run(self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        let AccessInfo {
            mode,
            jumper,
            retry_in_s,
            board_key,
        } = board.access()?;
        // Who asks without a key is not refused: that would be a record.
        let reads = mode == AccessMode::Open || board.has_session();
        let keys = reads.then(|| unless_locked(board.keys())).transpose()?;
        let keys = keys.flatten();
        if self.format.json {
            let board_key =
                board_key.map(|key| json!({"key_id": key_id(&key), "public": hex(&key)}));
            let mut shown = json!({
                "mode": mode,
                "jumper": jumper,
                "board_key": board_key,
                "retry_in_s": retry_in_s,
            });
            if let Some(keys) = keys {
                shown["keys"] = keys.iter().map(key_json).collect();
            }
            return print_json(&shown);
        }
        let style = match mode {
            AccessMode::Claimed => GOOD,
            AccessMode::Open | AccessMode::Locked => CAUTION,
        };
        let signs = match board_key {
            Some(key) => format!("signs with key {}", key_id(&key)),
            None => "signs nothing".to_owned(),
        };
        let jumper = match jumper {
            Some(true) => "jumper closed\n",
            Some(false) => "jumper open\n",
            None => "",
        };
        let mut text = format!("{}\n{signs}\n{jumper}", paint(style, about(mode)));
        if retry_in_s > 0 {
            text += &format!("a wrong key is looked at again in {retry_in_s} s\n");
        }
        let mut table = Table::new("<<<").titles(&["key", "role", "name"]);
        for key in keys.iter().flatten() {
            table.row([
                key_id(&key.public),
                key.role.name().to_owned(),
                key.name.to_string(),
            ]);
        }
        match keys.as_deref() {
            None => text += "the keys are shown to operators and above: --key FILE\n",
            Some([]) => {}
            Some(_) => text += &format!("\n{table}"),
        }
        print(&text)
    }
}

/// A key for machines.
fn key_json(key: &KeyInfo) -> Value {
    json!({
        "key_id": key_id(&key.public),
        "role": key.role,
        "name": key.name.as_str(),
        "public": hex(&key.public),
    })
}

/// Have a board know a key from now on, or give a key that it knows another role
#[derive(Args)]
#[command(after_help = "\
The first key is an owner's. It needs the board's jumper instead of a key: closed when the board
starts, and still closed now. Every other needs an owner's key.

Examples:
  umi access enrol anna.pub --role owner --name Anna
  umi access enrol ben.pub --role engineer --name Ben --key anna")]
struct Enrol {
    /// The public key
    #[arg(value_name = "FILE.pub")]
    file: PathBuf,
    /// What it is for
    #[arg(long, value_name = "ROLE", value_parser = ["operator", "engineer", "owner"])]
    role: String,
    /// Whose it is, for people
    #[arg(long, value_name = "N", default_value = "")]
    name: String,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

impl Enrol {
    fn run(self) -> Result<(), Failure> {
        let Ok(name) = KeyName::try_from(self.name.as_str()) else {
            let message = format!("a name has {MAX_KEY_NAME} bytes at most");
            return Err(Failure::trouble("usage", message));
        };
        let role = Role::ALL.into_iter().find(|role| role.name() == self.role);
        let key = KeyInfo {
            public: key_file::read_public(&self.file)?,
            role: role.unwrap_or_default(),
            name,
        };
        let mut board = self.board.connect()?;
        if !board.key_enrol(&key)? {
            return Err(not_on_this_board(&mut board));
        }
        if self.format.json {
            return print_json(&key_json(&key));
        }
        let done = format!(
            "key {} is known as {}",
            key_id(&key.public),
            key.role.name()
        );
        print(&format!("{}\n", paint(GOOD, done)))
    }
}

/// Have a board not know a key any more
#[derive(Args)]
#[command(after_help = "\
The key of the last owner stays: enrol another owner first, or wipe the board.

Examples:
  umi access revoke 6a1c2f0e5b7d9384 --key anna")]
struct Revoke {
    /// The key's short name, as `umi access show` lists it
    #[arg(value_name = "KEY_ID", value_parser = parse_key_id)]
    key_id: KeyId,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Sixteen hexadecimal digits.
fn parse_key_id(text: &str) -> Result<KeyId, String> {
    let wrong = || "give the sixteen hexadecimal digits of a key".to_owned();
    let is_hex = text.len() == 16 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    let number = u64::from_str_radix(text, 16).ok().filter(|_| is_hex);
    number.map(u64::to_be_bytes).ok_or_else(wrong)
}

impl Revoke {
    fn run(self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        // For a board, what is revoked already is done: the answer may have been lost. Who has
        // mistyped is told. Who may not even look is told by the request itself.
        let is_it = |key: &KeyInfo| key_id(&key.public) == hex(&self.key_id);
        if board.keys().is_ok_and(|keys| !keys.iter().any(is_it)) {
            return Err(LinkError::Refused(AccessRefusal::KeyUnknown).into());
        }
        if !board.key_revoke(self.key_id)? {
            return Err(not_on_this_board(&mut board));
        }
        let key_id = hex(&self.key_id);
        if self.format.json {
            return print_json(&json!({"key_id": key_id, "revoked": true}));
        }
        print(&format!(
            "{}\n",
            paint(GOOD, format_args!("key {key_id} is not known any more"))
        ))
    }
}

/// Have a board change nothing any more, until an owner unlocks it
#[derive(Args)]
#[command(after_help = "\
It measures and sends what it has. Hosts read with an operator's key.

Examples:
  umi access lock --key anna")]
struct Lock {
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Have a locked board do again what engineers and owners ask for
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi access unlock --key anna")]
struct Unlock {
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

fn set_lock(board: &Board, format: &Format, locked: bool) -> Result<(), Failure> {
    let mut board = board.connect()?;
    if !board.lock(locked)? {
        return Err(not_on_this_board(&mut board));
    }
    let mode = board.access()?.mode;
    if format.json {
        return print_json(&json!({ "mode": mode }));
    }
    print(&format!("{}\n", paint(GOOD, about(mode))))
}

impl BoardKey {
    fn run(self) -> Result<(), Failure> {
        if let Some(path) = &self.output {
            self.force.check(path, &[])?;
        }
        let mut board = self.board.connect()?;
        // A head over our nonce: who signs it has the key.
        let head = match journal::head(&mut board, journal::nonce()?, PATIENCE)? {
            Ok(head) => head,
            Err(why) => return Err(unsigned(why)),
        };
        if let Some(path) = &self.output {
            let text = key_file::public_text(&head.key)?;
            self.force.write(path, &[], text)?;
        }
        if self.format.json {
            return print_json(&json!({
                "key_id": key_id(&head.key),
                "public": hex(&head.key),
                "serial": head.serial.as_str(),
                "file": self.output.map(|path| path.display().to_string()),
            }));
        }
        let to = self
            .output
            .map_or(String::new(), |path| format!(", in {}", path.display()));
        print(&format!(
            "{}{to}\n{}\n",
            paint(
                GOOD,
                format_args!("key {} of board {}", key_id(&head.key), head.serial)
            ),
            hex(&head.key),
        ))
    }
}
