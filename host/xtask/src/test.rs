//! `test`: everything that must hold, in one command, the quick and telling things first.

use std::time::Instant;

use anyhow::{Result, ensure};

use crate::console::{self, Line, Outcome};
use crate::firmware::toolchain;
use crate::fuzz;
use crate::house::{House, execute, in_ci};
use crate::licences;
use crate::set_up::{self, Need};
use crate::size;

/// Sets up what is missing, then runs every check and prints a summary.
///
/// Stops at the first step that fails. This is what CI runs.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cargo xtask test            # everything, as in CI\n  cargo xtask test --quick    # before each commit: format, lints and tests"
)]
pub struct Arguments {
    /// Leaves out everything but format, lints and tests.
    #[arg(long)]
    quick: bool,
    /// How long each fuzz target runs.
    #[arg(long, value_name = "N", default_value_t = 20)]
    fuzz_seconds: u32,
}

/// A check: `Err` if something does not hold.
type Action = fn(&House, &Arguments) -> Result<Outcome>;

/// The steps in order, each with whether `--quick` runs it too.
const STEPS: [(&str, bool, Action); 9] = [
    ("format", true, format),
    ("set-up", false, set_up),
    ("licences", false, licences),
    ("lints", true, lints),
    ("documentation", false, documentation),
    ("tests", true, tests),
    ("firmware", false, firmware),
    ("fuzzing", false, fuzzing),
    ("demo", false, demo),
];

/// Runs the steps.
pub fn run(house: &House, arguments: &Arguments) -> Result<()> {
    let steps = STEPS
        .iter()
        .filter(|(_, quick, _)| *quick || !arguments.quick)
        .map(|(name, _, action)| (*name, || action(house, arguments)));
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

fn format(house: &House, _: &Arguments) -> Result<Outcome> {
    // The fuzz targets are a workspace of their own.
    for workspace in ["Cargo.toml", "tests/fuzz/Cargo.toml"] {
        let mut command = house.cargo();
        command.args(["fmt", "--all", "--check", "--manifest-path", workspace]);
        if !console::has_colour() {
            // rustfmt does not find out by itself.
            command.args(["--", "--color=never"]);
        }
        execute(&mut command)?;
    }
    Ok(Outcome::Passed)
}

fn set_up(house: &House, _: &Arguments) -> Result<Outcome> {
    set_up::meet(house, &[Need::Firmware, Need::Fuzzing, Need::Referee]);
    Ok(Outcome::Passed)
}

fn licences(house: &House, _: &Arguments) -> Result<Outcome> {
    licences::check(house)?;
    Ok(Outcome::Passed)
}

fn lints(house: &House, _: &Arguments) -> Result<Outcome> {
    execute(house.cargo().args([
        "clippy",
        "--workspace",
        "--all-targets",
        "--",
        "-D",
        "warnings",
    ]))?;
    Ok(Outcome::Passed)
}

fn documentation(house: &House, _: &Arguments) -> Result<Outcome> {
    execute(
        house
            .cargo()
            .args(["doc", "--workspace", "--no-deps"])
            .env("RUSTDOCFLAGS", "-D warnings"),
    )?;
    Ok(Outcome::Passed)
}

fn tests(house: &House, _: &Arguments) -> Result<Outcome> {
    // All failures in one run: CI is slow to ask again.
    execute(
        house
            .cargo()
            .args(["test", "--workspace", "--no-fail-fast"]),
    )?;
    Ok(Outcome::Passed)
}

fn firmware(house: &House, _: &Arguments) -> Result<Outcome> {
    // CI must have a compiler for firmware; a desk without one may still run the rest.
    match toolchain::choose(house, None) {
        Err(error) if !in_ci() => Ok(Outcome::Skipped(format!("{error:#}"))),
        Err(error) => Err(error),
        Ok(_) => {
            size::run(house, &size::Arguments::default())?;
            Ok(Outcome::Passed)
        }
    }
}

fn fuzzing(house: &House, arguments: &Arguments) -> Result<Outcome> {
    if let Some(reason) = fuzz::missing(house) {
        return Ok(Outcome::Skipped(reason));
    }
    fuzz::run_all(house, arguments.fuzz_seconds)?;
    Ok(Outcome::Passed)
}

/// The first command of the README.
fn demo(house: &House, _: &Arguments) -> Result<Outcome> {
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
