//! `test`: everything that must hold, in one command, the quick and telling things first.

use std::cell::RefCell;
use std::time::Instant;

use anyhow::{Result, bail, ensure};

use crate::aside::Aside;

use crate::console::{self, Line, Outcome};
use crate::emulators;
use crate::firmware::toolchain;
use crate::fuzz;
use crate::house::{House, execute, in_ci};
use crate::licences;
use crate::set_up::{self, Need};

/// Sets up what is missing, then runs every check and prints a summary.
///
/// Stops at the first step that fails. This is what CI runs. The firmware's images are built
/// on the side while the host's code is linted, and then run in the emulators.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cargo xtask test            # everything, as in CI\n  cargo xtask test --quick    # before each commit: format, lints and tests, no emulators"
)]
pub struct Arguments {
    /// Leaves out everything but format, lints and tests on the host.
    #[arg(long)]
    quick: bool,
    /// How long each fuzz target runs.
    #[arg(long, value_name = "N", default_value_t = 20)]
    fuzz_seconds: u32,
}

/// What the checks share.
struct Run<'a> {
    house: &'a House,
    arguments: &'a Arguments,
    /// The firmware's checks on the side, once they are begun.
    firmware: RefCell<Option<Aside>>,
}

/// A check: `Err` if something does not hold.
type Action = fn(&Run<'_>) -> Result<Outcome>;

/// The steps in order, each with whether `--quick` runs it too.
const STEPS: [(&str, bool, Action); 9] = [
    ("format", true, format),
    ("set-up", false, set_up),
    ("licences", false, licences),
    ("lints", true, lints),
    ("documentation", false, documentation),
    ("firmware", false, firmware),
    ("tests", true, tests),
    ("fuzzing", false, fuzzing),
    ("demo", false, demo),
];

/// Runs the steps.
pub fn run(house: &House, arguments: &Arguments) -> Result<()> {
    let run = Run {
        house,
        arguments,
        firmware: RefCell::new(None),
    };
    let steps = STEPS
        .iter()
        .filter(|(_, quick, _)| *quick || !arguments.quick)
        .map(|(name, _, action)| (*name, || action(&run)));
    let (lines, failure) = run_in_order(steps);
    console::summary(&lines);
    failure.map_or(Ok(()), Err)
}

/// Runs steps up to the first that fails; returns a line for each, and the failure.
fn run_in_order<F: FnOnce() -> Result<Outcome>>(
    steps: impl Iterator<Item = (&'static str, F)>,
) -> (Vec<Line>, Option<anyhow::Error>) {
    let mut lines = Vec::new();
    let mut failure = None;
    for (step, action) in steps {
        let start = Instant::now();
        let outcome = if failure.is_some() {
            Outcome::NotRun
        } else {
            console::headline(step);
            action().unwrap_or_else(|error| {
                failure = Some(error.context(format!("step `{step}`")));
                Outcome::Failed
            })
        };
        if let Outcome::Skipped(reason) = &outcome {
            console::skipped(reason);
        }
        let took = start.elapsed();
        lines.push(Line {
            step,
            outcome,
            took,
        });
    }
    (lines, failure)
}

fn format(run: &Run<'_>) -> Result<Outcome> {
    // The fuzz targets and the boards are workspaces of their own.
    for workspace in [
        "Cargo.toml",
        "tests/fuzz/Cargo.toml",
        "firmware/boards/Cargo.toml",
    ] {
        let mut command = run.house.cargo();
        command.args(["fmt", "--all", "--check", "--manifest-path", workspace]);
        if !console::has_colour() {
            // rustfmt does not find out by itself.
            command.args(["--", "--color=never"]);
        }
        execute(&mut command)?;
    }
    Ok(Outcome::Passed)
}

fn set_up(run: &Run<'_>) -> Result<Outcome> {
    let needs = [
        Need::Firmware,
        Need::Emulators,
        Need::Fuzzing,
        Need::Referee,
    ];
    set_up::meet(run.house, &needs);
    // To link an image keeps one processor busy for long: meanwhile the other goes on.
    if toolchain::installed(run.house).is_some() {
        *run.firmware.borrow_mut() = Some(Aside::begin(run.house)?);
    }
    Ok(Outcome::Passed)
}

fn licences(run: &Run<'_>) -> Result<Outcome> {
    licences::check(run.house)?;
    Ok(Outcome::Passed)
}

fn lints(run: &Run<'_>) -> Result<Outcome> {
    execute(run.house.cargo().args([
        "clippy",
        "--workspace",
        "--all-targets",
        "--",
        "-D",
        "warnings",
    ]))?;
    Ok(Outcome::Passed)
}

fn documentation(run: &Run<'_>) -> Result<Outcome> {
    execute(
        run.house
            .cargo()
            .args(["doc", "--workspace", "--no-deps"])
            .env("RUSTDOCFLAGS", "-D warnings"),
    )?;
    Ok(Outcome::Passed)
}

/// CI must have a compiler for firmware; a desk without one may still run the rest.
fn firmware(run: &Run<'_>) -> Result<Outcome> {
    match run.firmware.take() {
        Some(aside) => aside.end().map(|()| Outcome::Passed),
        None => match toolchain::choose(run.house, None) {
            Err(error) if !in_ci() => Ok(Outcome::Skipped(format!("{error:#}"))),
            Err(error) => Err(error),
            Ok(_) => bail!("the images were not begun"),
        },
    }
}

fn tests(run: &Run<'_>) -> Result<Outcome> {
    // All failures in one run: CI is slow to ask again.
    let mut command = run.house.cargo();
    command.args(["test", "--workspace", "--no-fail-fast"]);
    let without = if run.arguments.quick {
        Some("--quick".to_owned())
    } else if toolchain::installed(run.house).is_none() {
        Some("no images".to_owned())
    } else {
        emulators::missing(run.house)
    };
    if let Some(why) = &without {
        ensure!(
            run.arguments.quick || !in_ci(),
            "the emulators cannot run: {why}"
        );
        console::skipped(&format!("emulated boards: {why}"));
        command.env("UMI_EMULATORS", "0");
    } else {
        let image = |board| run.house.firmware().join(format!("{board}.elf"));
        command
            .env("UMI_EMULATORS", "1")
            .env("UMI_MPS2_IMAGE", image("mps2-an500"))
            .env("UMI_MPS2_FIGURES", image("mps2-an500-figures"))
            .env("UMI_PICO_IMAGE", image("pico"))
            .env("UMI_PICO_FIGURES", image("pico-figures"));
        let mut npm = run.house.command("npm");
        npm.env("UMI_PICO_IMAGE", image("pico"))
            .arg("test")
            .current_dir(emulators::folder(run.house));
        execute(&mut npm)?;
    }
    execute(&mut command)?;
    Ok(Outcome::Passed)
}

fn fuzzing(run: &Run<'_>) -> Result<Outcome> {
    if let Some(reason) = fuzz::missing(run.house) {
        return Ok(Outcome::Skipped(reason));
    }
    fuzz::run_all(run.house, run.arguments.fuzz_seconds)?;
    Ok(Outcome::Passed)
}

/// The first command of the README.
fn demo(run: &Run<'_>) -> Result<Outcome> {
    let house = run.house;
    let out = house.target.join("xtask").join("demo");
    if out.exists() {
        std::fs::remove_dir_all(&out)?;
    }
    execute(
        house
            .cargo()
            .args(["run", "--release", "--", "demo", "--out"])
            .arg(&out),
    )?;
    let report = std::fs::read_dir(&out)?
        .filter_map(|entry| entry.ok())
        .any(|entry| entry.path().extension().is_some_and(|end| end == "html"));
    ensure!(
        report,
        "the demo wrote no HTML report into {}",
        out.display()
    );
    Ok(Outcome::Passed)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first failure ends the run, is the one reported, and the rest is "not run".
    #[test]
    fn first_failure_ends_the_run() {
        type Boxed = Box<dyn FnOnce() -> Result<Outcome>>;
        let steps: [(&str, Boxed); 4] = [
            ("one", Box::new(|| Ok(Outcome::Passed))),
            ("two", Box::new(|| Ok(Outcome::Skipped("why".into())))),
            ("three", Box::new(|| anyhow::bail!("broken"))),
            ("four", Box::new(|| panic!("must not run"))),
        ];
        let (lines, failure) = run_in_order(steps.into_iter());
        let outcomes: Vec<&Outcome> = lines.iter().map(|line| &line.outcome).collect();
        assert_eq!(
            outcomes,
            [
                &Outcome::Passed,
                &Outcome::Skipped("why".into()),
                &Outcome::Failed,
                &Outcome::NotRun
            ]
        );
        assert_eq!(format!("{:#}", failure.unwrap()), "step `three`: broken");
    }
}
