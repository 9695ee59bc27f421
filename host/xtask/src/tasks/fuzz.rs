//! `fuzz`: runs the fuzz targets of `tests/fuzz` for a bounded time.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};

use crate::console;
use crate::workspace::{Workspace, execute, execute_filtered, find_program, output};

/// What libFuzzer is linked from.
pub const COMPILER: &str = "c++";

/// What LLVM puts into the code so that libFuzzer sees where an input leads: as cargo-fuzz has it, whose
/// nightly compiler is for sanitizers. Nothing here is unsafe code, so they have nothing to find: what
/// is wrong is a panic or an overflow, and both are checked.
const FLAGS: &str = "--cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares";

/// Fuzzes the parsers that face foreign machines, for a bounded time.
///
/// Starts from the kept corpus (tests/fuzz/corpus) and leaves it as it is: what is found
/// on the way goes into the target directory. Needs a C++ compiler.
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
    if let Some(reason) = missing() {
        anyhow::bail!("{reason}");
    }
    let mut targets = targets(workspace)?;
    if let Some(target) = &arguments.target {
        ensure!(
            targets.contains(target),
            "no fuzz target `{target}`; there are: {}",
            targets.join(", ")
        );
        targets.retain(|name| name == target);
    }
    let program = build(workspace)?;
    targets
        .iter()
        .try_for_each(|target| run_one(workspace, &program, target, arguments.seconds))
}

/// Why fuzzing is impossible on this machine, with what to do, or nothing.
pub fn missing() -> Option<String> {
    find_program(COMPILER)
        .is_none()
        .then(|| format!("no {COMPILER}: cargo xtask set-up"))
}

/// The names of the targets, in order: each has a corpus.
fn targets(workspace: &Workspace) -> Result<Vec<String>> {
    let folder = folder(workspace).join("corpus");
    let entries = std::fs::read_dir(&folder)
        .with_context(|| format!("cannot list the fuzz targets in {}", folder.display()))?;
    let mut names = Vec::new();
    for entry in entries {
        names.push(entry?.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}

fn folder(workspace: &Workspace) -> PathBuf {
    workspace.root.join("tests").join("fuzz")
}

/// Builds the targets; returns the program that they are in.
fn build(workspace: &Workspace) -> Result<PathBuf> {
    let about = output(workspace.command("rustc").arg("-vV"))?;
    let host = about.lines().find_map(|line| line.strip_prefix("host: "));
    let host = host.context("rustc does not name its host")?;
    execute(
        workspace
            .cargo()
            .args(["build", "--profile", "fuzz", "--package", "umi-fuzz"])
            .args(["--features", "coverage"])
            // Named, so that build scripts and macros are built without the flags.
            .args(["--target", host])
            .env("RUSTFLAGS", FLAGS),
    )?;
    Ok(workspace.target.join(host).join("fuzz").join("umi-fuzz"))
}

fn run_one(workspace: &Workspace, program: &Path, target: &str, seconds: u32) -> Result<()> {
    console::progress(&format!("{target}: {seconds} s"));
    let found = workspace.target.join("fuzz-corpus").join(target);
    let artifacts = folder(workspace).join("artifacts").join(target);
    std::fs::create_dir_all(&found)?;
    std::fs::create_dir_all(&artifacts)?;
    // libFuzzer writes what it finds into the first folder and only reads the others.
    let kept = folder(workspace).join("corpus").join(target);
    let mut worth = Worth::default();
    execute_filtered(
        workspace
            .command(program)
            .env("UMI_FUZZ_TARGET", target)
            .arg(found)
            .arg(kept)
            .arg(format!("-artifact_prefix={}/", artifacts.display()))
            .arg(format!("-max_total_time={seconds}"))
            .args(["-print_final_stats=1", "-print_funcs=0"]),
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
