//! `test`: everything that must hold, in one command, the quick and telling things first.

use std::time::{Duration, Instant};

use anyhow::{Result, ensure};

use crate::console::{self, Line, Outcome};
use crate::firmware_check::{self, toolchain};
use crate::fuzz;
use crate::house::{House, execute, in_ci};
use crate::set_up::{self, Need};

/// Sets up what is missing, then runs every check and prints a summary.
///
/// Stops at the first step that fails. This is what CI runs.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cargo xtask test            # everything, as in CI\n  cargo xtask test --quick    # before each commit: format, lints and tests"
)]
pub struct Arguments {
    /// Leaves out set-up, documentation, firmware, fuzzing and the demo.
    #[arg(long)]
    quick: bool,
    /// How long each fuzz target runs.
    #[arg(long, value_name = "N", default_value_t = 20)]
    fuzz_seconds: u32,
}

struct Step {
    name: &'static str,
    quick: bool,
    action: fn(&House, &Arguments) -> Result<Outcome>,
}

const STEPS: [Step; 8] = [
    Step {
        name: "format",
        quick: true,
        action: format,
    },
    Step {
        name: "set-up",
        quick: false,
        action: set_up,
    },
    Step {
        name: "lints",
        quick: true,
        action: lints,
    },
    Step {
        name: "documentation",
        quick: false,
        action: documentation,
    },
    Step {
        name: "tests",
        quick: true,
        action: tests,
    },
    Step {
        name: "firmware",
        quick: false,
        action: firmware,
    },
    Step {
        name: "fuzzing",
        quick: false,
        action: fuzzing,
    },
    Step {
        name: "demo",
        quick: false,
        action: demo,
    },
];

/// Runs the steps.
pub fn run(house: &House, arguments: &Arguments) -> Result<()> {
    let steps = STEPS.iter().filter(|step| step.quick || !arguments.quick);
    let mut lines = Vec::new();
    let mut failure = None;
    for step in steps {
        if failure.is_some() {
            let (outcome, took) = (Outcome::NotRun, Duration::ZERO);
            lines.push(Line {
                step: step.name,
                outcome,
                took,
            });
            continue;
        }
        console::headline(step.name);
        let start = Instant::now();
        let outcome = (step.action)(house, arguments).unwrap_or_else(|error| {
            failure = Some(error.context(format!("step `{}`", step.name)));
            Outcome::Failed
        });
        if let Outcome::Skipped(reason) = &outcome {
            console::skipped(reason);
        }
        lines.push(Line {
            step: step.name,
            outcome,
            took: start.elapsed(),
        });
    }
    console::summary(&lines);
    failure.map_or(Ok(()), Err)
}

fn format(house: &House, _: &Arguments) -> Result<Outcome> {
    execute(house.cargo().args(["fmt", "--all", "--check"]))?;
    Ok(Outcome::Passed)
}

fn set_up(house: &House, _: &Arguments) -> Result<Outcome> {
    set_up::meet(house, &[Need::Firmware, Need::Fuzzing]);
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
    execute(house.cargo().args(["test", "--workspace"]))?;
    Ok(Outcome::Passed)
}

fn firmware(house: &House, _: &Arguments) -> Result<Outcome> {
    // The dependency rules and the images hold on every machine that CI calls a pass;
    // a desk without a cross compiler may still run the rest.
    match toolchain::choose(house) {
        Ok(toolchain) => {
            firmware_check::check(house, toolchain)?;
            Ok(Outcome::Passed)
        }
        Err(error) if in_ci() => Err(error),
        Err(error) => Ok(Outcome::Skipped(format!("{error:#}"))),
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
