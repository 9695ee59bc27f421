//! `fuzz`: runs the fuzz targets of `tests/fuzz` for a bounded time.

use std::path::PathBuf;

use anyhow::{Context as _, Result, bail, ensure};

use crate::console;
use crate::workspace::{Workspace, execute_filtered, find_program, output};

/// Fuzzes the parsers that face foreign machines, for a bounded time.
///
/// Starts from the kept corpus (tests/fuzz/corpus) and leaves it as it is: what is found
/// on the way goes into the target directory. Needs a nightly compiler and cargo-fuzz.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cargo xtask fuzz                          # every target, a minute each\n  cargo xtask fuzz receiver --seconds 3600  # one target, an hour"
)]
pub(crate) struct Arguments {
    /// The target; all of them if none is named.
    target: Option<String>,
    /// How long each target runs.
    #[arg(long, value_name = "N", default_value_t = 60)]
    seconds: u32,
}

/// Fuzzes what the arguments name.
pub fn run(workspace: &Workspace, arguments: &Arguments) -> Result<()> {
    if let Some(reason) = missing(workspace) {
        bail!("{reason}");
    }
    match &arguments.target {
        None => run_all(workspace, arguments.seconds),
        Some(target) => {
            let targets = targets(workspace)?;
            ensure!(
                targets.contains(target),
                "no fuzz target `{target}`; there are: {}",
                targets.join(", ")
            );
            run_one(workspace, target, arguments.seconds)
        }
    }
}

/// Fuzzes each target for this long.
pub fn run_all(workspace: &Workspace, seconds: u32) -> Result<()> {
    let targets = targets(workspace)?;
    ensure!(!targets.is_empty(), "tests/fuzz has no targets");
    targets
        .iter()
        .try_for_each(|target| run_one(workspace, target, seconds))
}

/// Why fuzzing is impossible on this machine, with what to do, or nothing.
pub fn missing(workspace: &Workspace) -> Option<String> {
    if !has_nightly(workspace) {
        Some("no nightly compiler: rustup toolchain install nightly".into())
    } else if find_program("cargo-fuzz").is_none() {
        Some("no cargo-fuzz: cargo xtask set-up".into())
    } else {
        None
    }
}

/// Whether rustup has a nightly compiler.
pub fn has_nightly(workspace: &Workspace) -> bool {
    output(
        workspace
            .command("rustup")
            .args(["run", "nightly", "rustc", "--version"]),
    )
    .is_ok()
}

/// The fuzz targets' workspace.
pub fn manifest(workspace: &Workspace) -> PathBuf {
    folder(workspace).join("Cargo.toml")
}

/// The names of the targets, in order.
fn targets(workspace: &Workspace) -> Result<Vec<String>> {
    let folder = folder(workspace).join("fuzz_targets");
    let entries = std::fs::read_dir(&folder)
        .with_context(|| format!("cannot list the fuzz targets in {}", folder.display()))?;
    let mut names = Vec::new();
    for entry in entries {
        let path = entry?.path();
        if path.extension().is_some_and(|end| end == "rs")
            && let Some(name) = path.file_stem()
        {
            names.push(name.to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
}

fn folder(workspace: &Workspace) -> PathBuf {
    workspace.root.join("tests").join("fuzz")
}

fn run_one(workspace: &Workspace, target: &str, seconds: u32) -> Result<()> {
    console::progress(&format!("{target}: {seconds} s"));
    let found = workspace.target.join("fuzz-corpus").join(target);
    std::fs::create_dir_all(&found)?;
    // libFuzzer writes what it finds into the first folder and only reads the others.
    let kept = folder(workspace).join("corpus").join(target);
    let mut worth = Worth::default();
    execute_filtered(
        workspace
            .command("rustup")
            .args(["run", "nightly", "cargo", "fuzz", "run"])
            .arg("--fuzz-dir")
            .arg(folder(workspace))
            .arg("--target-dir")
            .arg(workspace.target.join("fuzz"))
            // Nothing here is unsafe code, so the sanitizers have nothing to find: what is
            // wrong is a panic or an overflow, and both are checked.
            .arg("--sanitizer=none")
            .arg(target)
            .arg(found)
            .arg(kept)
            .arg("--")
            .arg(format!("-max_total_time={seconds}"))
            .arg("-print_final_stats=1"),
        |line| worth.showing(line),
    )
}

/// Which lines of libFuzzer are worth showing: not each input that it finds, nor the words
/// that it would put into a dictionary.
#[derive(Default)]
struct Worth {
    in_dictionary: bool,
}

impl Worth {
    fn showing(&mut self, line: &str) -> bool {
        if line.contains("Recommended dictionary.") {
            self.in_dictionary = true;
        } else if line.contains("End of recommended dictionary.") {
            self.in_dictionary = false;
            return false;
        }
        let is_find = line.starts_with('#') && line.contains(" cov: ");
        let is_progress = ["INITED", "pulse", "DONE"]
            .iter()
            .any(|word| line.contains(word));
        !self.in_dictionary && (!is_find || is_progress)
    }
}

#[cfg(test)]
mod tests {
    use super::Worth;

    /// Progress, figures and everything about a crash stay; finds and dictionary go.
    #[test]
    fn lines_worth_showing() {
        let said = "INFO: Running\n\
                    #2\tINITED cov: 3 ft: 4\n\
                    #9\tNEW    cov: 5 ft: 7\n\
                    #1024\tpulse  cov: 5 ft: 7\n\
                    ###### Recommended dictionary. ######\n\
                    \"SPHE\" # Uses: 7\n\
                    ###### End of recommended dictionary. ######\n\
                    thread '<unnamed>' panicked at receiver.rs:1:2:\n\
                    stat::new_units_added: 1\n";
        let mut worth = Worth::default();
        let shown: Vec<&str> = said.lines().filter(|line| worth.showing(line)).collect();
        assert_eq!(
            shown,
            [
                "INFO: Running",
                "#2\tINITED cov: 3 ft: 4",
                "#1024\tpulse  cov: 5 ft: 7",
                "thread '<unnamed>' panicked at receiver.rs:1:2:",
                "stat::new_units_added: 1",
            ]
        );
    }
}
