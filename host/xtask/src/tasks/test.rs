//! `test`: everything that must hold, in one command, the quick and telling things first.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::process::Command;
use std::time::Instant;

use anyhow::{Result, bail, ensure};

use crate::console::{self, Line, Outcome};
use crate::tasks::background::Background;
use crate::tasks::firmware::toolchain;
use crate::tasks::set_up::{self, OF_TESTS};
use crate::tasks::{bench, dependencies as trust, release};
use crate::tools::{browser, emulators, readers, referee, spelling};
use crate::workspace::{Workspace, execute, in_ci};

/// Sets up what is missing, then runs every check and prints a table of what was run.
///
/// Stops at the first step that fails. This is what CI runs. The firmware's images are built
/// in the background while the host's code is linted, and then run in the emulators. Where
/// Debian's compiler is there beside rustup's, the images are built with both.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cargo xtask test            # everything, as in CI\n  cargo xtask test --quick    # before each commit: format, lints and tests, no emulators\n  cargo xtask test --only dependencies --only spelling"
)]
pub(crate) struct Arguments {
    /// Leaves out everything but format, lints and tests on the host.
    #[arg(long)]
    quick: bool,
    /// Runs these steps only; the table names no others.
    #[arg(long, value_name = "STEP", conflicts_with = "quick")]
    only: Vec<String>,
}

/// What the checks share.
struct Run<'a> {
    workspace: &'a Workspace,
    arguments: &'a Arguments,
    /// The firmware's checks in the background, once they are begun.
    firmware: RefCell<Option<Background>>,
    /// The same with the second compiler.
    second: RefCell<Option<Background>>,
}

/// A check: `Err` if something does not hold.
type Action = fn(&Run<'_>) -> Result<Outcome>;

/// The steps in order, each with whether `--quick` runs it too.
const STEPS: [(&str, bool, Action); 12] = [
    ("format", true, format),
    ("set-up", false, set_up),
    ("dependencies", false, dependencies),
    ("lints", true, lints),
    ("spelling", false, spelling),
    ("documentation", false, documentation),
    ("build", true, build),
    ("firmware", false, firmware),
    ("tests", true, tests),
    ("second compiler", false, second_compiler),
    ("demo", false, demo),
    ("release", false, release),
];

/// Runs the steps.
pub fn run(workspace: &Workspace, arguments: &Arguments) -> Result<()> {
    let run = Run {
        workspace,
        arguments,
        firmware: RefCell::new(None),
        second: RefCell::new(None),
    };
    for name in &arguments.only {
        let names = STEPS.map(|(name, _, _)| name);
        ensure!(
            names.contains(&name.as_str()),
            "no step `{name}`; there are: {}",
            names.join(", ")
        );
    }
    let steps: Vec<_> = STEPS
        .iter()
        .filter(|(_, quick, _)| *quick || !arguments.quick)
        .filter(|(name, _, _)| {
            arguments.only.is_empty() || arguments.only.iter().any(|only| only == name)
        })
        .collect();
    let names: Vec<&str> = steps.iter().map(|(name, _, _)| *name).collect();
    console::headline("what will be done");
    if names.contains(&"set-up") {
        set_up::announce(workspace, &OF_TESTS);
    }
    console::progress(&format!("runs: {}", names.join(", ")));
    if arguments.only.is_empty() {
        console::progress(if arguments.quick {
            "takes about 20 min on two cores if nothing is compiled yet"
        } else {
            "takes about 30 min on two cores if nothing is compiled yet"
        });
    }
    let steps = steps
        .into_iter()
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

/// A step that cannot run here: at a desk it is skipped, CI must have what it needs.
fn skipped(why: String) -> Result<Outcome> {
    ensure!(!in_ci(), "CI must have what this needs: {why}");
    Ok(Outcome::Skipped(why))
}

/// Passed, but for what could not run.
fn passed_without(missing: &[String]) -> Outcome {
    if missing.is_empty() {
        Outcome::Passed
    } else {
        Outcome::Partly(missing.join("; "))
    }
}

fn format(run: &Run<'_>) -> Result<Outcome> {
    // Benchmarks and boards are workspaces of their own.
    for workspace in [
        "Cargo.toml",
        "tests/bench/Cargo.toml",
        "firmware/boards/Cargo.toml",
    ] {
        let mut command = run.workspace.cargo();
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
    let unmet = set_up::meet(run.workspace, &OF_TESTS);
    let mut compilers = Vec::new();
    for toolchain in toolchain::all_installed(run.workspace) {
        compilers.push(toolchain.compiler(run.workspace)?.to_string());
    }
    console::progress(&format!(
        "compilers for firmware here: {}",
        if compilers.is_empty() {
            "none".to_owned()
        } else {
            compilers.join("; and ")
        }
    ));
    // To link an image keeps one processor busy for long: meanwhile the other goes on.
    if toolchain::installed(run.workspace).is_some() {
        *run.firmware.borrow_mut() = Some(Background::firmware(run.workspace, None)?);
    }
    Ok(passed_without(&unmet))
}

fn dependencies(run: &Run<'_>) -> Result<Outcome> {
    trust::check_use(run.workspace)?;
    match trust::missing() {
        Some(why) if in_ci() => bail!("CI must check licences and advisories: {why}"),
        Some(why) => Ok(Outcome::Partly(why)),
        None => trust::check_trust(run.workspace).map(|()| Outcome::Passed),
    }
}

fn lints(run: &Run<'_>) -> Result<Outcome> {
    let bench = bench::manifest(run.workspace);
    // What only `cargo xtask bench` builds must not rot. As the tests are built: what runs while others are compiled is
    // built once.
    for manifest in [run.workspace.root.join("Cargo.toml"), bench] {
        execute(
            run.workspace
                .cargo()
                .args(["clippy", "--release", "--workspace", "--all-targets"])
                .arg("--manifest-path")
                .arg(manifest)
                .args(["--", "-D", "warnings"])
                .env("CARGO_TARGET_DIR", &run.workspace.target),
        )?;
    }
    Ok(Outcome::Passed)
}

fn spelling(run: &Run<'_>) -> Result<Outcome> {
    if spelling::find(run.workspace).is_none() {
        return skipped("no typos: cargo xtask set-up".to_owned());
    }
    spelling::check(run.workspace).map(|()| Outcome::Passed)
}

fn documentation(run: &Run<'_>) -> Result<Outcome> {
    execute(
        run.workspace
            .cargo()
            .args(["doc", "--release", "--workspace", "--no-deps"])
            .env("RUSTDOCFLAGS", "-D warnings"),
    )?;
    Ok(Outcome::Passed)
}

/// For release, as users build it: the demo needs no other build. Before the images are waited for, as each has one
/// processor idle at its end.
const TESTS: [&str; 3] = ["test", "--release", "--workspace"];

fn build(run: &Run<'_>) -> Result<Outcome> {
    execute(run.workspace.cargo().args(TESTS).arg("--no-run"))?;
    Ok(Outcome::Passed)
}

/// CI must have a compiler for firmware; a desk without one may still run the rest.
fn firmware(run: &Run<'_>) -> Result<Outcome> {
    let Some(background) = run.firmware.take() else {
        return match toolchain::choose(run.workspace, None) {
            Err(error) => skipped(format!("{error:#}")),
            Ok(_) => bail!("the images were not begun"),
        };
    };
    background.end()?;
    let compiler = toolchain::choose(run.workspace, None)?.compiler(run.workspace)?;
    Ok(if compiler.is_pinned {
        Outcome::Passed
    } else {
        Outcome::Partly(format!("budgets are not held: {compiler}"))
    })
}

fn tests(run: &Run<'_>) -> Result<Outcome> {
    let mut missing = Vec::new();
    let mut background = None;
    // All failures in one run: CI is slow to ask again.
    let mut command = run.workspace.cargo();
    command.args(TESTS).arg("--no-fail-fast");
    let without = if run.arguments.quick {
        Some("--quick".to_owned())
    } else if toolchain::installed(run.workspace).is_none() {
        Some("no images".to_owned())
    } else {
        emulators::missing(run.workspace)
    };
    if let Some(why) = without {
        ensure!(
            run.arguments.quick || !in_ci(),
            "the emulators cannot run: {why}"
        );
        console::skipped(&format!("emulated boards: {why}"));
        command.env("UMI_EMULATORS", "0");
        missing.push(format!("no emulated boards: {why}"));
    } else {
        let image = |board| run.workspace.firmware().join(format!("{board}.elf"));
        command
            .env("UMI_EMULATORS", "1")
            .env("UMI_MPS2_IMAGE", image("mps2-an500"))
            .env("UMI_MPS2_FIGURES", image("mps2-an500-figures"))
            .env("UMI_PICO_IMAGE", image("pico"))
            .env("UMI_PICO_FIGURES", image("pico-figures"));
        let mut npm = run.workspace.command("npm");
        npm.env("UMI_PICO_IMAGE", image("pico"))
            .arg("test")
            .current_dir(emulators::folder(run.workspace));
        execute(&mut npm)?;
        let mut boards = run.workspace.cargo();
        boards.args(TESTS).args(["--test", BOARDS]);
        boards.envs(
            command
                .get_envs()
                .filter_map(|(name, value)| Some((name, value?))),
        );
        // An emulator computes all the time.
        threads(&mut boards, processors());
        background = Some(Background::begin(
            run.workspace,
            &mut boards,
            BOARDS,
            "a board does not hold what it promises",
        )?);
        command.args(["--lib", "--bins"]);
        for name in targets_but_boards(run.workspace)? {
            command.args(["--test", &name]);
        }
    }
    // Many tests wait for a board or a tool rather than compute.
    threads(&mut command, 2 * processors());
    match browser::find() {
        Some(browser) => {
            command.env("UMI_BROWSER", browser);
        }
        None => {
            let why = "no browser has drawn a scan's page: cargo xtask set-up brings chromium";
            console::skipped(why);
            missing.push(why.to_owned());
        }
    }
    let others = execute(&mut command);
    if let Some(boards) = background {
        boards.end()?;
        execute(run.workspace.cargo().args(TESTS).arg("--doc"))?;
    }
    others?;
    if !referee::is_there(run.workspace) {
        missing.push("LinuxCNC's interpreter has judged nothing".to_owned());
    }
    if !readers::are_there(run.workspace) {
        missing.push("nobody else has read the clouds that are written".to_owned());
    }
    if !run.arguments.quick {
        let second = toolchain::second(run.workspace);
        if let Some(toolchain) = second {
            let background = Background::firmware(run.workspace, Some(toolchain))?;
            *run.second.borrow_mut() = Some(background);
        }
    }
    Ok(passed_without(&missing))
}

/// The tests of emulated boards. They run beside all others, as at the end of either one processor has nothing to do.
const BOARDS: &str = "boards";

fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// So many tests at a time, unless the user says how many.
fn threads(command: &mut Command, count: usize) {
    if std::env::var_os("RUST_TEST_THREADS").is_none() {
        command.env("RUST_TEST_THREADS", count.to_string());
    }
}

/// The workspace's files of tests, but for the boards'.
fn targets_but_boards(workspace: &Workspace) -> Result<BTreeSet<String>> {
    let members = workspace.members(&workspace.root.join("Cargo.toml"))?;
    let packages = members["packages"].as_array();
    let targets = packages
        .into_iter()
        .flatten()
        .filter_map(|of| of["targets"].as_array());
    let tests = targets.flatten().filter(|of| of["kind"][0] == "test");
    let names: BTreeSet<String> = tests
        .filter_map(|of| Some(of["name"].as_str()?.to_owned()))
        .collect();
    ensure!(
        names.contains(BOARDS),
        "cargo metadata names no tests `{BOARDS}`"
    );
    Ok(names.into_iter().filter(|name| name != BOARDS).collect())
}

/// The images as the other compiler builds them. Nobody must have two.
fn second_compiler(run: &Run<'_>) -> Result<Outcome> {
    let Some(toolchain) = toolchain::second(run.workspace) else {
        return Ok(Outcome::Skipped(
            "one compiler for firmware is here, not both".to_owned(),
        ));
    };
    // The step that tests has begun it; where this one runs alone nobody has.
    let begun = match run.second.take() {
        Some(background) => background,
        None => Background::firmware(run.workspace, Some(toolchain))?,
    };
    begun.end()?;
    Ok(Outcome::Partly(
        "built; the budgets are not about it".to_owned(),
    ))
}

/// The first command of the README.
fn demo(run: &Run<'_>) -> Result<Outcome> {
    let workspace = run.workspace;
    let out = workspace.target.join("xtask").join("demo");
    if out.exists() {
        std::fs::remove_dir_all(&out)?;
    }
    execute(
        workspace
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

/// The tool as it is given away: its list of dependencies can be read.
fn release(run: &Run<'_>) -> Result<Outcome> {
    if !cfg!(target_os = "linux") && !in_ci() {
        return Ok(Outcome::Skipped(
            "objcopy knows programs of Linux".to_owned(),
        ));
    }
    release::run(run.workspace, &release::Arguments {}).map(|()| Outcome::Passed)
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
