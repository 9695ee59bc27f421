//! `umi job`

mod probing;

use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::output::Force;
use crate::show::job as job_text;
use crate::show::json;
use crate::show::terminal::{GOOD, one_line, paint, print, print_json};
use clap::{Args, Subcommand};
use serde_json::json;
use umi_client::files::{job_file, points};
use umi_client::job::guards::GuardTable;
use umi_client::problem::Problem;
use umi_core::registration::register;
use umi_core::units::Point;

use crate::cmd::{Board, Format};

use self::probing::Probing;

/// Begin or check a job file, or read and replace the job of a board
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Job {
    #[command(subcommand)]
    action: Action,
}

const HELP: &str = "\
Examples:
  umi job new -o job.toml
  umi job probing --x x.csv --y y.csv --z z.csv
  umi job check job.toml
  umi job set job.toml --port /dev/ttyACM0
  umi job show --port tcp://localhost:7001
  umi job get --port /dev/ttyACM0 -o backup.toml";

#[derive(Subcommand)]
enum Action {
    New(New),
    Probing(Probing),
    Check(Check),
    Show(Show),
    Set(Set),
    Get(Get),
}

/// Write the job to begin with: four balls, three of them again, every guard
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi job new > job.toml
  umi job new -o job.toml
  umi job new --sheet balls.csv -o job.toml     x,y,z of the four balls, SPHERE1 first, or name,x,y,z

It teaches when asked (`umi teach`), compares runs and work offsets, and says at each line what
to enter. With the sheet of a measuring machine it holds the distances between the balls against
it, also when it is taught: a list of another plate, or in inches, shows. For blocks of points, as
the thesis prints them, begin with examples/three-spheres.toml.")]
struct New {
    /// The balls' centres as a measuring machine has them, mm: four, in any coordinates
    #[arg(long, value_name = "BALLS.csv")]
    sheet: Option<PathBuf>,
    /// Write to this file instead of standard output
    #[arg(short, long, value_name = "JOB.toml")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

/// Check a job file and show what it says
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi job check examples/three-spheres.toml
  umi job check job.toml --json       the job as JSON, or {\"error\":{...}}

The table says which errors between part and correction this job sees, from which size on:
each is put onto the job's places (`position_mm`) in the worst direction, on a part that stands
as the job's limits allow it, and judged as on the board. What hits scatter is in the figure.

Exit status: 0 good, 1 file or usage, 2 the job is refused.")]
struct Check {
    /// The job; `-` is standard input
    #[arg(value_name = "JOB.toml")]
    file: PathBuf,
    #[command(flatten)]
    format: Format,
}

/// Show the job that a board works on
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi job show                          the only board that is plugged in
  umi job show --port tcp://localhost:7001 --json")]
struct Show {
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Give a board a job; it forgets the reference that it was taught
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi job set job.toml --port /dev/ttyACM0

The file is checked first, here and on the board. The job is then read back.
Exit status: 0 set, 1 file, usage or connection, 2 the job is refused.")]
struct Set {
    /// The job; `-` is standard input
    #[arg(value_name = "JOB.toml")]
    file: PathBuf,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

/// Write the job of a board as a job file
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi job get > backup.toml
  umi job get --port /dev/ttyACM0 -o backup.toml")]
struct Get {
    #[command(flatten)]
    board: Board,
    /// Write to this file instead of standard output
    #[arg(short, long, value_name = "JOB.toml")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    format: Format,
}

impl Job {
    pub fn run(self) -> Result<(), Failure> {
        match self.action {
            Action::New(action) => action.run(),
            Action::Probing(action) => action.run(),
            Action::Check(action) => action.run(),
            Action::Show(action) => action.run(),
            Action::Set(action) => action.run(),
            Action::Get(action) => action.run(),
        }
    }
}

impl New {
    fn run(self) -> Result<(), Failure> {
        let mut text = include_str!("../../../../../../examples/four-spheres.toml").to_owned();
        if let Some(sheet) = &self.sheet {
            text = with_sheet(&text, sheet)?;
        }
        match self.output.filter(|path| path != Path::new("-")) {
            None => print(&text),
            Some(path) => self.force.write(&path, &[], &text),
        }
    }
}

/// The job to begin with for the balls of a sheet, whose distances it holds.
fn with_sheet(example: &str, sheet: &Path) -> Result<String, Failure> {
    const PLACE: &str = "position_mm = [";
    const DISTANCES: &str = "# nominal_distance_mm";
    /// Centres that are nearer are one ball's.
    const LEAST_APART_MM: f64 = 1.0;
    let refused = |code, said: &str| {
        let name = points::name(sheet);
        Problem::refused(code, format_args!("{name}: {said}"))
    };
    let (mut all, names) = points::read_named(sheet)?;
    if all.len() != example.matches(PLACE).count() {
        let said = format!(
            "{} balls, the job to begin with has four: write these into a copy of it, \
             `position_mm` at each",
            all.len()
        );
        return Err(refused("ball_count", &said).into());
    }
    if let Some(names) = names {
        let due = (1..=all.len()).map(|number| format!("SPHERE{number}"));
        let sorted: Option<Vec<Point>> = due
            .map(|due| {
                Some(
                    all[names
                        .iter()
                        .position(|name| name.eq_ignore_ascii_case(&due))?],
                )
            })
            .collect();
        let said = format!(
            "its balls have the names {}: the control prints SPHERE1 to SPHERE{}; name them so, as they are \
             probed, or take the column out and write them in this order",
            names.join(", "),
            all.len()
        );
        all = sorted.ok_or_else(|| refused("ball_names", &said))?;
    }
    for (number, ball) in (1..).zip(&all) {
        let near = |other: &Point| (other.mm - ball.mm).norm() < LEAST_APART_MM;
        if let Some(other) = all.iter().take(number - 1).position(near) {
            let said = format!("balls {} and {number} are at one place", other + 1);
            return Err(refused("balls_together", &said).into());
        }
    }
    let mut balls = all.iter().map(|ball| ball.to_array_mm());
    let lines = example.lines().map(|line| {
        if line.starts_with(PLACE)
            && let Some([x, y, z]) = balls.next()
        {
            return format!("{PLACE}{x:?}, {y:?}, {z:?}]    # of its sheet\n");
        }
        format!(
            "{}\n",
            line.strip_prefix("# ")
                .filter(|_| line.starts_with(DISTANCES))
                .unwrap_or(line)
        )
    });
    let text: String = lines.collect();
    register(&all, &all).map_err(|error| refused(error.code(), &error.to_string()))?;
    job_file::parse(&text).map_err(|fault| fault.in_file(sheet))?;
    Ok(text)
}

impl Check {
    fn run(self) -> Result<(), Failure> {
        let job = job_file::load(&self.file)?;
        if self.format.json {
            let open = umi_core::job::not_guarded(&job);
            let table = GuardTable::of(&job);
            return print_json(&json!({
                "status": "ok",
                "job": job,
                "guards": job_text::guards_json(&table),
                "notes": job_text::notes_json(&job, Some(&table)),
                "read_raises_alarm": job_text::has_alarm(&job),
                "not_guarded": open.as_ref().map(json::reason),
            }));
        }
        let good = format!("{} can be used", points::name(&self.file));
        print(&format!(
            "{}\n{}\n{}\n",
            job_text::text(&job),
            job_text::guards(&GuardTable::of(&job), job.guards.frame),
            paint(GOOD, good)
        ))
    }
}

impl Show {
    fn run(self) -> Result<(), Failure> {
        let in_force = self.board.connect()?.job()?;
        if self.format.json {
            return print_json(&json!({
                "job": in_force.job,
                "taught_mm": in_force.taught_mm,
                "learned": in_force.learned,
                "notes": in_force.job.as_ref().map(|job| job_text::notes_json(job, None)),
            }));
        }
        let Some(job) = in_force.job else {
            return Err(no_job());
        };
        let mut text = job_text::text(&job);
        if let Some(taught) = in_force.taught_mm {
            text += &format!("\n{}", job_text::taught(&taught, &job));
            text += &job_text::learned(&in_force.learned, &job);
        }
        print(&text)
    }
}

impl Set {
    fn run(self) -> Result<(), Failure> {
        let job = job_file::load(&self.file)?;
        let mut board = self.board.connect()?;
        if let Err(refused) = board.set_job(&job)? {
            return Err(job_file::refusal(&refused).into());
        }
        // What counts is what the board has, not what was sent.
        if board.job()?.job.as_ref() != Some(&job) {
            return Err(Failure::trouble(
                "job_not_kept",
                "the board took the job but has another one now: is another program connected to it? set the job again",
            ));
        }
        if self.format.json {
            return print_json(&json!({ "status": "ok", "job": job }));
        }
        let done = format!("{} now works on job {}", board.board(), one_line(&job.name));
        print(&format!("{}\n", paint(GOOD, done)))
    }
}

impl Get {
    fn run(self) -> Result<(), Failure> {
        if let Some(path) = &self.output {
            self.force.check(path, &[])?;
        }
        let job = self.board.connect()?.job()?.job.ok_or_else(no_job)?;
        let text = job_file::write(&job)?;
        match self
            .output
            .as_deref()
            .filter(|path| *path != Path::new("-"))
        {
            Some(path) => self.force.write(path, &[], text)?,
            None if self.format.json => {}
            None => print(&text)?,
        }
        if self.format.json {
            let file = self.output.as_ref().map(|path| path.display().to_string());
            return print_json(&json!({ "job": job, "file": file }));
        }
        Ok(())
    }
}

fn no_job() -> Failure {
    Failure::refused(
        "no_job",
        "the board has no job; give it one with `umi job set JOB.toml`",
    )
}
