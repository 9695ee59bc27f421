//! `umi machine run`

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{
    BAD, CAUTION, FAINT, GOOD, Plain, TITLE, count, paint, print, print_json,
};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use umi_client::files::points::{name, text};
use umi_client::problem::Problem;
use umi_client::session::DecisionRecord;
use umi_client::session::SessionBuilder;
use umi_desk::capture::Desk;
use umi_desk::line_scan::LineScan;
use umi_desk::live::Live;
use umi_desk::wiring::{Peer, WireEvent, Wiring};
use umi_report::terminal;
use umi_virtual::cell::{self, Cell};
use umi_virtual::cutting::{BallNose, CrashCause, Cutter, CylinderArc, SurfaceDeviations};
use umi_virtual::machine::VirtualMachine;
use umi_virtual::nc::{Alarm, BlockStep, ProgramState};
use umi_virtual::scene::{Scene, ToolSpec};
use umi_virtual::serve::PortPlace;

use super::floor::Floor;
use super::show;
use crate::cmd::board::virtual_board::place;
use crate::cmd::{Format, session_job};

/// Runs NC programs on a virtual machine tool
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Run {
    /// NC programs, run one after the other; subprograms may be in any of them
    #[arg(value_name = "PROGRAM", required = true)]
    programs: Vec<PathBuf>,
    /// The machine, its control, probe, and what stands on its table
    #[arg(long, value_name = "FILE")]
    scene: PathBuf,
    /// Programs that are loaded before, as macros that are called
    #[arg(long, value_name = "FILE", num_args = 1..)]
    load: Vec<PathBuf>,
    /// Set a variable of the control before the first program, as an operator does
    #[arg(long, value_name = "#N=VALUE", value_parser = variable)]
    set: Vec<(u32, f64)>,
    /// Where the control's serial port leads: `virtual` (a virtual board, with skip line
    /// and encoders too), a serial port as /dev/ttyUSB0, or tcp://host:port
    #[arg(long, value_name = "WHERE")]
    board: Option<String>,
    /// The job of the virtual board
    #[arg(long, value_name = "FILE", required_if_eq("board", "virtual"))]
    job: Option<PathBuf>,
    /// Open the virtual board's host port, `pty` or `tcp:PORT` (0: any free one), for
    /// `umi watch` and `umi events`; it runs as slow as the machine would be
    #[arg(long, value_name = "PLACE", requires_all = ["board", "job"], value_parser = place)]
    usb: Option<PortPlace>,
    /// Open the data channel of the scene's `[line_scanner]` on this TCP port (0: any free one),
    /// for `umi scan record`
    #[arg(long, value_name = "PORT", requires = "usb")]
    scanner: Option<u16>,
    /// READ after each program: the board's program is loaded, the correction or an alarm
    #[arg(long, requires = "board")]
    read: bool,
    /// Seed of the machine's noise
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// As slow as the machine would be; without it as fast as possible
    #[arg(long)]
    real_time: bool,
    /// Write what the control sends, byte for byte, into this file
    #[arg(long, value_name = "FILE")]
    serial: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Hits, serial traffic and the board's decisions are printed as they come; on a terminal
the last line shows the block, position and feed. Programs that call macros need --load.
A body of the scene with `cuttable = true` is cut by ball-nose tools and measured at the end.
With --read, what the control gets after each program is the board's correction, or, without
an OK verdict, a program under the same number that raises an alarm. Exit status 2: an alarm, a
verdict NG, or none for what was probed; verdicts of a board on a port, and of one that others
watch (--usb), are not seen (ask it with umi info).
The control begins with run 1 each time. A board that stays on refuses runs that it has judged
(old_run): say where the count stands by --set 531=N (4531 on LinuxCNC); the verdict names it.

Examples:
  umi machine run probe.nc --scene scene.toml --load hw/control/fanuc/*.nc
  umi machine run probe.nc --scene scene.toml --board virtual --job examples/three-spheres.toml
  umi machine run probe.nc cut.nc --scene scene.toml --board virtual --job job.toml --read
  umi machine run probe.nc --scene scene.toml --board virtual --job job.toml --usb tcp:5053
  umi machine run scan.nc --scene scene.toml --board virtual --job job.toml \\
    --usb tcp:5053 --scanner 5054
  umi machine run probe.nc --scene scene.toml --board /dev/ttyUSB0 --real-time
  umi machine run probe.nc --scene scene.toml --set 101=-135 --set 102=-137 --load sub.nc
  umi machine run probe.nc --scene scene.toml --serial session.txt --json";

fn variable(text: &str) -> Result<(u32, f64), String> {
    let wrong = || format!("`{text}` sets no variable: write 101=-135.5");
    let (number, value) = text.split_once('=').ok_or_else(wrong)?;
    let number = number.trim().trim_start_matches('#');
    match (number.parse(), value.trim().parse()) {
        (Ok(number), Ok(value)) => Ok((number, value)),
        _ => Err(wrong()),
    }
}

/// Reads a scene.
pub fn scene(path: &Path) -> Result<Scene, Failure> {
    // The files that it names stand beside it.
    let folder = path.parent().unwrap_or(Path::new(""));
    Scene::parse_in(&text(path)?, folder).map_err(|error| {
        let file = name(path);
        let problem = Problem::refused("scene", format!("{file}: {error}"));
        problem.with("file", file).into()
    })
}

/// An alarm ends the run.
enum Stop {
    Alarm(Alarm),
    Failure(Failure),
}

impl From<Alarm> for Stop {
    fn from(alarm: Alarm) -> Self {
        Self::Alarm(alarm)
    }
}

impl From<Failure> for Stop {
    fn from(failure: Failure) -> Self {
        Self::Failure(failure)
    }
}

impl Run {
    pub fn run(self) -> Result<(), Failure> {
        let scene = scene(&self.scene)?;
        if let Some(path) = &self.serial {
            // Before anything runs: a capture is not lost to a wrong name.
            let mut inputs = vec![self.scene.as_path()];
            inputs.extend(self.programs.iter().chain(&self.load).map(PathBuf::as_path));
            self.force.write(path, &inputs, [])?;
        }
        let (wiring, gather) = self.wiring(&scene)?;
        let workpiece = cell::workpiece(&scene).map_err(|error| {
            Failure::refused("scene", format_args!("{}: {error}", name(&self.scene)))
        })?;
        let tools = scene.tools.clone();
        let Cell { control, machine } = Cell::new(scene, self.seed, wiring);
        let Some((workpiece, nominal)) = workpiece else {
            return self.run_on(Cell { control, machine }, None, gather);
        };
        let machine = tools.into_iter().fold(
            Cutter::new(machine, workpiece),
            |cutter,
             (
                number,
                ToolSpec {
                    length_mm,
                    radius_mm,
                },
            )| {
                cutter.with_tool(
                    number,
                    BallNose {
                        length_mm,
                        radius_mm,
                    },
                )
            },
        );
        self.run_on(Cell { control, machine }, Some(nominal), gather)
    }

    fn run_on<M: Floor>(
        &self,
        mut cell: Cell<M>,
        nominal: Option<CylinderArc>,
        gather: Option<SessionBuilder>,
    ) -> Result<(), Failure> {
        for path in &self.load {
            cell.control.load(&text(path)?).map_err(|alarm| {
                Failure::refused("program", format_args!("{}: {alarm}", name(path)))
            })?;
        }
        for (number, value) in &self.set {
            cell.control
                .set_variable(*number, Some(*value))
                .map_err(|alarm| Failure::refused("variable", alarm))?;
        }
        let mut view = View::new(self, gather);
        for (number, path) in self.programs.iter().enumerate() {
            let program = text(path)?;
            view.begin(path)?;
            let ended = cell.run(&program, |cell, step| view.follow(cell, step));
            let ended = match ended {
                Err(Stop::Failure(failure)) => return Err(view.give_up(failure)),
                Err(Stop::Alarm(alarm)) => Some(alarm),
                Ok(()) => None,
            };
            view.drain(cell.machine.machine())?;
            if let Some(alarm) = ended {
                return view.alarm(&alarm);
            }
            let last = number + 1 == self.programs.len();
            if self.read && !view.read(&mut cell, last)? {
                break;
            }
        }
        view.finish(&mut cell, nominal.as_ref())
    }

    fn wiring(&self, scene: &Scene) -> Result<(Wiring, Option<SessionBuilder>), Failure> {
        match self.board.as_deref() {
            board if self.usb.is_some() && board != Some("virtual") => Err(Failure::trouble(
                "usage",
                "--usb opens a port of the virtual board: it needs --board virtual",
            )),
            None => Ok((Wiring::new(Peer::Nowhere), None)),
            Some("virtual") => {
                let Some(path) = &self.job else {
                    return Err(Failure::trouble("usage", "--board virtual needs --job"));
                };
                let job = session_job(path)?;
                if let Some(usb) = &self.usb {
                    let control = &scene.control;
                    let character = Duration::from_secs(1) * control.bits / control.baud;
                    let mut live = Live::new(&job, character, usb)?;
                    self.say_where(&live.address)?;
                    if let Some(port) = self.scanner {
                        let scan = LineScan::new(scene, self.seed, port)?;
                        self.say_scanner(&scan.address)?;
                        live = live.with_scanner(scan);
                    }
                    return Ok((Wiring::new(Peer::Live(Box::new(live))), None));
                }
                let gather = SessionBuilder::new("Virtual machine", "", &job, None);
                let bench = Desk::new(&job)?;
                Ok((Wiring::new(Peer::Board(Box::new(bench))), Some(gather)))
            }
            Some(address) => Ok((Wiring::to_port(address, scene.control.baud)?, None)),
        }
    }
}

impl Run {
    fn say_where(&self, address: &str) -> Result<(), Failure> {
        if self.format.json {
            return print_json(&json!({ "type": "board", "usb": address }));
        }
        print(&format!(
            "{}  host {address}   (umi watch --port {address})\n",
            paint(TITLE, "virtual board"),
        ))
    }
}

impl Run {
    fn say_scanner(&self, address: &str) -> Result<(), Failure> {
        if self.format.json {
            return print_json(&json!({ "type": "scanner", "tcp": address }));
        }
        print(&format!(
            "{}  data {address}   (umi scan record --sensor tcp:{address} -o FOLDER)\n",
            paint(TITLE, "virtual scanner"),
        ))
    }
}

/// What is shown while it runs.
struct View<'a> {
    options: &'a Run,
    gather: Option<SessionBuilder>,
    bar: ProgressBar,
    began: Instant,
    hits: usize,
    serial: Vec<u8>,
    ng: bool,
    verdicts: u64,
    /// Hits and bytes at the last verdict.
    judged: (usize, usize),
}

impl<'a> View<'a> {
    fn new(options: &'a Run, gather: Option<SessionBuilder>) -> Self {
        let live = !options.format.json && std::io::stderr().is_terminal();
        let bar = if live {
            ProgressBar::new_spinner().with_style(
                ProgressStyle::with_template("{spinner} {msg}")
                    .unwrap_or_else(|_| ProgressStyle::default_spinner()),
            )
        } else {
            ProgressBar::hidden()
        };
        Self {
            options,
            gather,
            bar,
            began: Instant::now(),
            hits: 0,
            serial: Vec::new(),
            ng: false,
            verdicts: 0,
            judged: (0, 0),
        }
    }

    fn begin(&self, path: &Path) -> Result<(), Failure> {
        if self.options.format.json {
            return print_json(&json!({ "type": "program", "file": name(path) }));
        }
        self.say(&format!("{} {}", paint(TITLE, "program"), name(path)))
    }

    fn say(&self, line: &str) -> Result<(), Failure> {
        if self.options.format.json {
            return Ok(());
        }
        self.bar.suspend(|| print(&format!("{line}\n")))
    }

    /// A block has been carried out.
    fn follow<M: Floor>(&mut self, cell: &mut Cell<M>, step: &BlockStep) -> Result<(), Stop> {
        self.drain(cell.machine.machine())?;
        self.crash(cell, step)?;
        if let Some(message) = &step.message {
            self.say(&format!("{} {message}", paint(CAUTION, "stop")))?;
        } else if step.state == ProgramState::Stopped {
            self.say(&format!(
                "{} O{:04} line {}",
                paint(FAINT, "stop"),
                step.program,
                step.line
            ))?;
        }
        let status = cell.machine.machine().status();
        if self.options.real_time {
            let due = Duration::from_secs_f64(status.seconds);
            std::thread::sleep(due.saturating_sub(self.began.elapsed()));
        }
        let [x, y, z] = cell.control.status().work_position.to_array_mm().map(Plain);
        self.bar.set_message(format!(
            "O{:04} {:<24} X {x:10.3} Y {y:10.3} Z {z:10.3}  F {:6.0}  {:8.1} s  {}",
            step.program,
            step.text.trim().chars().take(24).collect::<String>(),
            status.feed_mm_per_min,
            status.seconds,
            count(status.hits as u64, "hit"),
        ));
        Ok(())
    }

    /// Shows what happened on machine and wires.
    fn drain(&mut self, machine: &mut VirtualMachine<Wiring>) -> Result<(), Failure> {
        for event in machine.wires_mut().take()? {
            match event {
                WireEvent::Serial(at, bytes) => self.serial(at.0, &bytes)?,
                WireEvent::Skip(..) => {
                    // The machine's own log says more.
                }
                WireEvent::Decision(decision) => self.decision(*decision)?,
            }
        }
        for (number, hit) in machine.hits().iter().enumerate().skip(self.hits) {
            self.hits = number + 1;
            if self.options.format.json {
                print_json(&show::hit(number + 1, hit))?;
            } else {
                self.say(&format!(
                    "{} {}",
                    paint(FAINT, "hit"),
                    show::hit_line(number + 1, hit)
                ))?;
            }
        }
        Ok(())
    }

    fn serial(&mut self, t_us: u64, bytes: &[u8]) -> Result<(), Failure> {
        self.serial.extend_from_slice(bytes);
        if self.options.format.json {
            return print_json(&json!({
                "type": "serial",
                "t_us": t_us,
                "text": show::serial(bytes),
                "bytes": bytes,
            }));
        }
        self.say(&format!(
            "{} {}",
            paint(FAINT, "serial"),
            show::serial(bytes)
        ))
    }

    fn decision(&mut self, decision: DecisionRecord) -> Result<(), Failure> {
        if self.options.format.json {
            print_json(&crate::show::json::decision(&decision))?;
        } else if let DecisionRecord::Fault(fault) = &decision {
            self.say(&format!("{} {fault}", paint(CAUTION, "fault")))?;
        }
        if let DecisionRecord::Verdict(verdict) = &decision {
            self.ng |= !verdict.ok;
            self.verdicts += 1;
            self.judged = (self.hits, self.serial.len());
        }
        let Some(gather) = &mut self.gather else {
            return Ok(());
        };
        let judged = gather.take(decision);
        match judged {
            Some(place) if !self.options.format.json => {
                let table = terminal::setup(&gather.session, place, true);
                self.say(&table)
            }
            _ => Ok(()),
        }
    }

    /// A tool that took material away without cutting is an alarm.
    fn crash<M: Floor>(&self, cell: &Cell<M>, step: &BlockStep) -> Result<(), Stop> {
        let Some(crash) = cell.machine.crash() else {
            return Ok(());
        };
        let [x, y, z] = crash.to.to_array_mm();
        Err(Stop::Failure(Failure::refused(
            "crash",
            format_args!(
                "O{:04} line {} `{}`: the tool ran {:.3} mm deep into the workpiece {} on its way to X{x:.3} Y{y:.3} Z{z:.3} (machine coordinates)",
                step.program,
                step.line,
                step.text.trim(),
                crash.removed.deepest_mm,
                match crash.cause {
                    CrashCause::Rapid => "at rapid",
                    CrashCause::SpindleStill => "with the spindle standing still",
                },
            ),
        )))
    }

    /// The control's READ: what comes is loaded, the correction or what raises an alarm.
    /// False: nothing came, so that an old correction may still be there.
    fn read<M: Floor>(&mut self, cell: &mut Cell<M>, last: bool) -> Result<bool, Failure> {
        let Some(program) = cell.machine.machine().wires_mut().read_program()? else {
            if self.options.format.json {
                print_json(&json!({ "type": "read", "programs": [], "text": null }))?;
            }
            self.say(&format!("{} nothing came", paint(CAUTION, "READ")))?;
            if !last {
                self.say(&format!(
                    "{} the control waits for a program: the next one does not run",
                    paint(BAD, "stop")
                ))?;
                self.ng = true;
            }
            return Ok(last);
        };
        let loaded = cell.control.load(&program).map_err(|alarm| {
            Failure::refused("program", format_args!("the board's program: {alarm}"))
        })?;
        if self.options.format.json {
            print_json(&json!({ "type": "read", "programs": loaded, "text": program }))?;
        } else {
            let names: Vec<String> = loaded.iter().map(|o| format!("O{o:04}")).collect();
            self.say(&format!(
                "{} {}\n{program}",
                paint(GOOD, "READ"),
                names.join(" ")
            ))?;
        }
        Ok(true)
    }

    fn keep_serial(&self) -> Result<(), Failure> {
        match &self.options.serial {
            None => Ok(()),
            Some(path) => std::fs::write(path, &self.serial)
                .map_err(|error| Failure::file("write", path, &error)),
        }
    }

    /// Ends with a failure. What was captured up to there is kept.
    fn give_up(self, failure: Failure) -> Failure {
        self.bar.finish_and_clear();
        self.keep_serial().err().unwrap_or(failure)
    }

    fn alarm(self, alarm: &Alarm) -> Result<(), Failure> {
        self.bar.finish_and_clear();
        self.keep_serial()?;
        if self.options.format.json {
            print_json(&show::alarm(alarm, None))?;
        } else {
            print(&format!("{} {alarm}\n", paint(BAD, "alarm")))?;
        }
        Err(Failure::Negative)
    }

    fn finish<M: Floor>(
        self,
        cell: &mut Cell<M>,
        nominal: Option<&CylinderArc>,
    ) -> Result<(), Failure> {
        self.bar.finish_and_clear();
        self.keep_serial()?;
        let status = cell.machine.machine().status();
        // A board with a job was to judge something.
        let (hits, bytes) = self.judged;
        let goes_on = self.hits > hits && self.serial.len() > bytes;
        let unjudged = self.gather.is_some() && (self.verdicts == 0 || goes_on);
        let surface = cell
            .machine
            .workpiece()
            .zip(nominal)
            .and_then(|(piece, nominal)| {
                SurfaceDeviations::of(piece, nominal).statistics(|_, _| true)
            })
            .filter(|surface| surface.uncut < surface.nodes);
        if self.options.format.json {
            if let Some(surface) = surface {
                print_json(&show::surface(&surface))?;
            }
            print_json(&json!({
                "type": "end",
                "seconds": status.seconds,
                "hits": status.hits,
                "serial_bytes": self.serial.len(),
                "verdicts": self.verdicts,
                "unjudged": unjudged,
            }))?;
        } else {
            if let Some(surface) = surface {
                print(&format!(
                    "{} {}\n",
                    paint(TITLE, "surface"),
                    show::surface_line(&surface)
                ))?;
            }
            print(&format!(
                "{} after {:.1} s of machine time: {}, {} printed\n",
                paint(GOOD, "end"),
                status.seconds,
                count(status.hits as u64, "hit"),
                count(self.serial.len() as u64, "byte"),
            ))?;
            if unjudged {
                let what = match self.verdicts {
                    0 => "the board reached no verdict",
                    _ => "what was probed behind the last verdict has none",
                };
                print(&format!(
                    "{} {what}: do program and job fit?\n",
                    paint(BAD, "NG")
                ))?;
            }
        }
        if self.ng || unjudged {
            Err(Failure::Negative)
        } else {
            Ok(())
        }
    }
}
