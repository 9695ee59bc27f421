//! `umi program`

use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{FAINT, GOOD, TITLE, one_line, paint, print, print_error, print_json};
use clap::{Args, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use umi_client::files::tool_path;
use umi_client::problem::Problem;
use umi_client::programs;
use umi_core::rewrite::{MeasuredIn, RefusedLine};
use umi_protocol::job::{Job, SendWhen};
use umi_protocol::program::{MAX_NUMBER, ProgramInfo, ProgramRefusal, Release, Withheld};

use super::options::Control;
use super::stated::{Said, option};
use crate::cmd::{Board, Format};

/// List, put, get and delete the part programs in a board's flash
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Program {
    #[command(subcommand)]
    action: Action,
}

const HELP: &str = "\
Examples:
  umi program list
  umi program put pocket.nc --port /dev/ttyACM0
  umi program put pocket.nc --release rewritten --increment-mm 0.001
  umi program offer 1234
  umi program pass long.nc --hold-s 600
  umi program receive
  umi program get 1234 -o pocket.nc
  umi program delete 1234";

#[derive(Subcommand)]
enum Action {
    List(List),
    Put(Put),
    Get(Get),
    Delete(Delete),
    Offer(Offer),
    Pass(Pass),
    Receive(Receive),
}

/// When the program goes out to the control, and how.
#[derive(Args)]
struct Rule {
    /// When it goes out to a control that asks for it
    #[arg(long, value_enum, default_value_t = When::AfterVerdict)]
    release: When,
    /// How long the control may hold the line (XOFF) while it is sent: longer than the
    /// longest motion, where it carries out what comes
    #[arg(long, value_name = "S", default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..))]
    hold_s: u16,
    #[command(flatten)]
    control: Control,
    #[command(flatten)]
    said: Said,
}

#[derive(Clone, Copy, ValueEnum)]
enum When {
    /// As it is, after an OK verdict, once; if the job sends a correction, when that has gone
    /// out
    AfterVerdict,
    /// Every motion carried by the verdict's registration, after an OK verdict, once; not with
    /// a job that sends a correction
    Rewritten,
    /// As it is, whenever it is asked for: a program that probes
    Always,
}

impl Rule {
    fn release(&self) -> Result<Release, Failure> {
        Ok(match self.release {
            When::AfterVerdict => Release::AfterVerdict,
            When::Rewritten => Release::Rewritten(self.control.spec(&self.said)?),
            When::Always => Release::Always,
        })
    }

    /// What a board is told of a program, and its bytes.
    fn read(&self, path: &Path, number: Option<u32>) -> Result<(ProgramInfo, Vec<u8>), Failure> {
        let bytes = std::fs::read(path).map_err(|error| Failure::file("read", path, &error))?;
        let number = numbered(path, number, programs::number_in(&bytes))?;
        let stated = self.said.kept()?;
        self.try_out(path, &bytes)?;
        let program = ProgramInfo {
            number,
            name: name(path),
            bytes: u32::try_from(bytes.len()).unwrap_or(u32::MAX),
            crc32: programs::check_value(&bytes),
            release: self.release()?,
            hold_s: self.hold_s,
            stated,
        };
        Ok((program, bytes))
    }

    /// Refuses what a board would never let out: better here, by line and reason, than by an
    /// alarm at the machine.
    fn try_out(&self, path: &Path, bytes: &[u8]) -> Result<(), Failure> {
        if !programs::is_closed(bytes) {
            let why = Withheld::NoPercent;
            return Err(Failure::refused(
                why.code(),
                format_args!("{}: {why}", path.display()),
            ));
        }
        let When::Rewritten = self.release else {
            return match self.said.first() {
                Some(option) => Err(Failure::trouble(
                    "usage",
                    format_args!("{option} says how to rewrite: it needs --release rewritten"),
                )),
                None => Ok(()),
            };
        };
        let Some((refusal, option)) = self.refused(bytes, None)? else {
            return Ok(());
        };
        let problem = Problem::refused(
            "not_rewritable",
            format_args!(
                "{} {refusal}{option}; no verdict could send it (umi nc check lists every such line)",
                path.display()
            ),
        );
        Err(problem
            .with("line", refusal.line)
            .with("column", refusal.column)
            .into())
    }

    /// The first line that cannot be rewritten for a part that leans, probed there, and what
    /// allows it.
    fn refused(
        &self,
        bytes: &[u8],
        measured_in: Option<MeasuredIn>,
    ) -> Result<Option<(RefusedLine, String)>, Failure> {
        let leaning = tool_path::LEANING.transform();
        let settings = self.control.settings(leaning, &self.said)?;
        let mut settings = self.said.settings(settings)?;
        if let Some(measured_in) = measured_in {
            settings = settings.measured_at(measured_in);
        }
        let refusal = tool_path::refusal(bytes, &settings)?;
        Ok(refusal.map(|refusal| {
            let option = option(refusal.reason);
            let option = option.map_or_else(String::new, |option| format!(" ({option})"));
            (refusal, option)
        }))
    }

    /// Why a program does not go out with the job in force, and that as a code.
    fn withheld(
        &self,
        bytes: &[u8],
        job: Option<&Job>,
    ) -> Result<Option<(&'static str, String)>, Failure> {
        let (When::Rewritten, Some(job)) = (self.release, job) else {
            return Ok(None);
        };
        let correction = job.correction.as_ref();
        if correction.is_some_and(|spec| spec.send != SendWhen::Never) {
            let why = Withheld::CorrectedTwice;
            return Ok(Some((why.code(), why.to_string())));
        }
        let measured_in = MeasuredIn::of(correction);
        let refused = self.refused(bytes, Some(measured_in))?;
        Ok(refused.map(|(refusal, option)| {
            let probed_in = measured_in.offset;
            let why = format!("{refusal}{option}; the job's parts are probed in {probed_in}");
            ("not_rewritable", why)
        }))
    }
}

/// The number of a program: its own, which one that is given must not contradict.
fn numbered(path: &Path, given: Option<u32>, own: Option<u32>) -> Result<u32, Failure> {
    let path = path.display();
    match (given, own) {
        (Some(given), Some(own)) if given != own => Err(Failure::trouble(
            "program_number",
            format_args!(
                "{path} is O{own:04} by its own O line, not O{given:04}: a control that asks for \
                 O{given:04} would get O{own:04}, and may keep it in place of another; leave \
                 --number out, or change the O line"
            ),
        )),
        (Some(number), _) | (None, Some(number)) => Ok(number),
        (None, None) => Err(Failure::trouble(
            "program_number",
            format_args!("{path} does not begin with an O-number: give one with --number"),
        )),
    }
}

/// List the programs of a board, and the room that is left
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi program list
  umi program list --port tcp://localhost:5053 --json | jq '.programs[].number'")]
struct List {
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Put a program into a board's flash, in place of the one with its number
#[derive(Args)]
#[command(after_help = "\
An upload that breaks off leaves the old program; the same command goes on where it was.
While the board measures a setup it takes no program: umi waits for up to a minute.
A control gets it when it prints READ O1234 (DPRNT[READ*O1234]) and then reads, or after
umi program offer. With --release rewritten it is tried here first, with a part that leans:
a line that cannot be rewritten is named, and nothing is put. The board rewrites it as it
was tried: it keeps --start, --dialect and one --allow-call with it. It has the program alone:
--load, --origin and --again are for umi nc rewrite.

Examples:
  umi program put pocket.nc             its number is that of its O line
  umi program put bare.nc --number 1234   it has no O line
  umi program put probing.nc --release always
  umi program put pocket.nc --release rewritten --chord-mm 0.005
  umi program put bare.nc --release rewritten --start G90,G17,G21 --allow-call P9100
  umi program put long.nc --json        one line at its end

Exit status: 0 it is there, whole; 1 file, usage or connection; 2 the board refuses, or
would never let it out.")]
struct Put {
    /// The program
    #[arg(value_name = "PROGRAM.nc")]
    file: PathBuf,
    /// Its number on the board, where it has no O line
    #[arg(long, value_name = "O", value_parser = number)]
    number: Option<u32>,
    #[command(flatten)]
    rule: Rule,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Get a program from a board's flash
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi program get 1234 -o pocket.nc
  umi program get O1234 -o - | less     to standard output")]
struct Get {
    /// Its number
    #[arg(value_name = "O", value_parser = number)]
    number: u32,
    /// Write to this file; `-` is standard output
    #[arg(short, long, value_name = "PROGRAM.nc")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    board: Board,
}

/// Delete a program from a board's flash
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi program delete 1234")]
struct Delete {
    /// Its number
    #[arg(value_name = "O", value_parser = number)]
    number: u32,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Make a program what the control's next READ gets
#[derive(Args)]
#[command(after_help = "\
A control can ask by itself, where it prints: DPRNT[READ*O1234]; that comes first. What it
prints else, and a new job, take this back. What may not go out now is an alarm.

Examples:
  umi program offer 1234")]
struct Offer {
    /// Its number
    #[arg(value_name = "O", value_parser = number)]
    number: u32,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Pass a program of any length through to the control, which reads it
#[derive(Args)]
#[command(after_help = "\
Nothing of it is kept on the board. With --release rewritten it is tried here first, with a
part that leans: a line that cannot be rewritten is named, and nothing begins. If umi ends
or the cable is pulled, the control gets no end. What it prints while it runs takes it back, unless its
release is always.

Examples:
  umi program pass long.nc --release always
  umi program pass long.nc --release rewritten --hold-s 600

Exit status: 0 all of it went out; 1 file, usage or connection; 2 the board refuses, or
something was measured meanwhile.")]
struct Pass {
    /// The program
    #[arg(value_name = "PROGRAM.nc")]
    file: PathBuf,
    /// The number under which the control asks for it, where it has no O line
    #[arg(long, value_name = "O", value_parser = number)]
    number: Option<u32>,
    #[command(flatten)]
    rule: Rule,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Receive a program from the control by XMODEM, into the board's flash
#[derive(Args)]
#[command(after_help = "\
The board asks the control every ten seconds; let it send (Haas: XMODEM, EOB `LF ONLY`, SEND).
It is kept under its O-number, never in place of another, and not released to go out. What a
control punches without XMODEM is kept by itself, where a job is set.

Examples:
  umi program receive

Exit status: 0 it is there, whole; 1 connection; 2 it is not kept.")]
struct Receive {
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// `1234` or `O1234`.
fn number(text: &str) -> Result<u32, String> {
    let digits = text.trim_start_matches(['O', 'o']);
    match digits.parse() {
        Ok(number) if (1..=MAX_NUMBER).contains(&number) => Ok(number),
        _ => Err(format!(
            "`{text}` is no program number: give 1 to {MAX_NUMBER}"
        )),
    }
}

impl Program {
    pub fn run(self) -> Result<(), Failure> {
        match self.action {
            Action::List(action) => action.run(),
            Action::Put(action) => action.run(),
            Action::Get(action) => action.run(),
            Action::Delete(action) => action.run(),
            Action::Offer(action) => action.run(),
            Action::Pass(action) => action.run(),
            Action::Receive(action) => action.run(),
        }
    }
}

impl List {
    fn run(self) -> Result<(), Failure> {
        let (room, programs) = programs::list(&mut self.board.connect()?)?;
        if self.format.json {
            let told = |program: &ProgramInfo| {
                let mut told = json!(program);
                told["begins_in"] = json!(crate::show::text::begins_in(&program.stated));
                told
            };
            let programs: Vec<_> = programs.iter().map(told).collect();
            return print_json(&json!({ "room": room, "programs": programs }));
        }
        let mut text = String::new();
        if !programs.is_empty() {
            let head = format!(
                "{:<9}  {:<16}  {:>9}  {:<8}  {:>6}  goes out",
                "number", "name", "bytes", "check", "hold"
            );
            text += &format!("{}\n", paint(TITLE, head));
        }
        for program in &programs {
            let ProgramInfo {
                number,
                name,
                bytes,
                crc32,
                release,
                hold_s,
                stated,
            } = program;
            let name = one_line(name);
            text += &format!(
                "{:<9}  {name:<16}  {bytes:>9}  {crc32:08X}  {hold_s:>4} s  {}{}\n",
                format!("O{number:04}"),
                crate::show::text::release(release),
                crate::show::text::stated(stated),
            );
        }
        let left = format!(
            "{} of {} programs; {} of {} KB free, a program of {} KB finds room",
            room.programs,
            room.most_programs,
            room.free_bytes / 1024,
            room.total_bytes / 1024,
            room.longest_bytes / 1024,
        );
        print(&format!("{text}{}\n", paint(FAINT, left)))
    }
}

impl Put {
    fn run(self) -> Result<(), Failure> {
        let (program, bytes) = self.rule.read(&self.file, self.number)?;
        let mut board = self.board.connect()?;
        let (_, kept) = programs::list(&mut board)?;
        let there = kept.contains(&program);
        let mut resumed = None;
        if !there {
            let bar = bar(program.bytes);
            let done = programs::put(&mut board, &program, &bytes, |offset| {
                resumed.get_or_insert(offset);
                bar.set_position(offset.into());
            });
            bar.finish_and_clear();
            done?;
        }
        let resumed = resumed.unwrap_or(0);
        // As things stand on this board: another job may come.
        let withheld = match program.release {
            Release::Rewritten(_) => self.rule.withheld(&bytes, board.job()?.job.as_ref())?,
            _ => None,
        };
        if self.format.json {
            return print_json(&json!({
                "status": "ok",
                "program": program,
                "was_there": there,
                "resumed_at": resumed,
                "withheld": withheld.map(|(code, _)| code),
            }));
        }
        let how = match (there, resumed) {
            (true, _) => "was there already".to_owned(),
            (false, 0) => "is there".to_owned(),
            (false, at) => format!("is there (gone on at byte {at})"),
        };
        let done = format!("{} {how}", crate::show::text::program(&program));
        print(&format!("{}\n", paint(GOOD, done)))?;
        match withheld {
            Some((_, why)) => print(&format!("but as things stand it does not go out: {why}\n")),
            None => Ok(()),
        }
    }
}

impl Get {
    fn run(self) -> Result<(), Failure> {
        let path = &self.output;
        let to_output = path == Path::new("-");
        self.force.check(path, &[])?;
        let mut board = self.board.connect()?;
        let (_, kept) = programs::list(&mut board)?;
        let program = kept.into_iter().find(|p| p.number == self.number);
        let program = program.ok_or_else(|| programs::refusal(&ProgramRefusal::NotThere))?;
        let bar = bar(program.bytes);
        let bytes = programs::get(&mut board, &program, |came| bar.set_position(came.into()));
        bar.finish_and_clear();
        let bytes = bytes?;
        if to_output {
            let done = io::stdout().lock().write_all(&bytes);
            return match done {
                Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {
                    Err(Failure::OutputClosed)
                }
                done => done.map_err(|error| Failure::file("write", path, &error)),
            };
        }
        std::fs::write(path, bytes).map_err(|error| Failure::file("write", path, &error))?;
        let done = format!(
            "{} is in {}",
            crate::show::text::program(&program),
            path.display()
        );
        print(&format!("{}\n", paint(GOOD, done)))
    }
}

impl Offer {
    fn run(self) -> Result<(), Failure> {
        programs::offer(&mut self.board.connect()?, self.number)?;
        let number = self.number;
        if self.format.json {
            return print_json(&json!({ "status": "ok", "offered": number }));
        }
        let done = format!("the control's next READ gets O{number:04}");
        print(&format!("{}\n", paint(GOOD, done)))
    }
}

impl Pass {
    fn run(self) -> Result<(), Failure> {
        let (program, bytes) = self.rule.read(&self.file, self.number)?;
        let mut board = self.board.connect()?;
        if !self.format.json {
            print_error("the control's next READ gets it\n");
        }
        let bar = bar(program.bytes);
        let done = programs::pass(&mut board, &program, &bytes, |taken| {
            bar.set_position(taken.into());
        });
        bar.finish_and_clear();
        done?;
        if self.format.json {
            return print_json(&json!({ "status": "ok", "program": program }));
        }
        let done = format!("{} went out", crate::show::text::program(&program));
        print(&format!("{}\n", paint(GOOD, done)))
    }
}

impl Receive {
    fn run(self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        if !self.format.json {
            print_error("let the control send\n");
        }
        let program = programs::receive(&mut board)?;
        if self.format.json {
            return print_json(&json!({ "status": "ok", "program": program }));
        }
        let done = format!("{} is there", crate::show::text::program(&program));
        print(&format!("{}\n", paint(GOOD, done)))
    }
}

impl Delete {
    fn run(self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        let (_, kept) = programs::list(&mut board)?;
        let program = kept.into_iter().find(|p| p.number == self.number);
        let program = program.ok_or_else(|| programs::refusal(&ProgramRefusal::NotThere))?;
        // That it is not there any more is also the answer to a request that came twice.
        match programs::delete(&mut board, self.number) {
            Err(of) if of.code == ProgramRefusal::NotThere.code() => {}
            done => done?,
        }
        if self.format.json {
            return print_json(&json!({ "status": "ok", "deleted": program }));
        }
        let done = format!("{} is deleted", crate::show::text::program(&program));
        print(&format!("{}\n", paint(GOOD, done)))
    }
}

/// A name from a file's: what fits of it.
fn name(path: &Path) -> umi_protocol::job::Name {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    umi_protocol::job::name(&stem)
}

fn bar(bytes: u32) -> ProgressBar {
    let style = ProgressStyle::with_template("{bytes:>10} of {total_bytes} {wide_bar} {eta}");
    ProgressBar::new(bytes.into())
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
