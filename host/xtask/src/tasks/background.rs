//! The firmware's checks, and other commands, in the background.
//!
//! Each runs as a child process. Its output is buffered, so it never mixes with ours.

use std::fs::File;
use std::io::{Read as _, Seek as _};
use std::process::{Child, Command, Stdio};

use anyhow::{Context as _, Result, ensure};
use clap::ValueEnum as _;

use crate::tasks::firmware;
use crate::tasks::firmware::reproduce;
use crate::tasks::firmware::toolchain::Toolchain;
use crate::tasks::size;
use crate::workspace::Workspace;

/// The name of the task that runs them.
pub const TASK: &str = "firmware-checks";

/// Runs the firmware's checks.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// The compiler to use, rather than the first that is installed.
    #[arg(long)]
    toolchain: Option<Toolchain>,
}

/// The checks: every image is built and within its budget, and with the first compiler its
/// code has no lints, and one image is the same bytes in another folder.
pub fn run(workspace: &Workspace, arguments: &Arguments) -> Result<()> {
    let toolchain = arguments.toolchain;
    size::run(workspace, &size::Arguments::with(toolchain))?;
    match toolchain {
        None => firmware::lint(workspace).and_then(|()| reproduce::again(workspace)),
        Some(_) => Ok(()),
    }
}

/// A command as it runs.
pub(crate) struct Background {
    process: Child,
    log: File,
    /// What its failure means.
    failure: &'static str,
}

impl Background {
    /// Begins the firmware's checks, with this compiler or the first that is there.
    pub fn firmware(workspace: &Workspace, toolchain: Option<Toolchain>) -> Result<Self> {
        let mut command = workspace.command(std::env::current_exe()?);
        command.arg(TASK);
        if let Some(name) = toolchain.and_then(|it| it.to_possible_value()) {
            command.args(["--toolchain", name.get_name()]);
        }
        let failure = "the firmware does not hold what it promises";
        Self::begin(workspace, &mut command, TASK, failure)
    }

    /// Begins a command, whose output is kept under this name.
    pub fn begin(
        workspace: &Workspace,
        command: &mut Command,
        name: &str,
        failure: &'static str,
    ) -> Result<Self> {
        let folder = workspace.target.join("xtask");
        std::fs::create_dir_all(&folder)?;
        let file = folder.join(name).with_extension("log");
        let log = || {
            let mut options = File::options();
            let log = options.create(true).read(true).append(true).open(&file);
            log.with_context(|| format!("cannot write {}", file.display()))
        };
        log()?.set_len(0)?;
        let process = command
            .stdin(Stdio::null())
            .stdout(log()?)
            .stderr(log()?)
            .spawn()
            .with_context(|| format!("{name} does not start"))?;
        Ok(Self {
            process,
            log: log()?,
            failure,
        })
    }

    /// Waits for its end, and shows what it said.
    pub fn end(mut self) -> Result<()> {
        let status = self.process.wait()?;
        let mut said = Vec::new();
        self.log.rewind()?;
        self.log.read_to_end(&mut said)?;
        eprint!("{}", String::from_utf8_lossy(&said));
        ensure!(status.success(), "{}", self.failure);
        Ok(())
    }
}

/// Nobody waits for it any more: it is ended.
impl Drop for Background {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// A failure in the background is one at the end, and success is one.
    #[test]
    fn outcome() {
        let root =
            std::env::temp_dir().join(format!("umi-xtask-background-{}", std::process::id()));
        let workspace = Workspace {
            target: root.join("target"),
            root,
        };
        std::fs::create_dir_all(&workspace.root).unwrap();
        let end = |script: &str| {
            let mut command = workspace.command("sh");
            Background::begin(&workspace, command.args(["-c", script]), "script", "why")
                .unwrap()
                .end()
        };
        assert!(end("exit 0").is_ok());
        assert!(end("exit 1").is_err());
        std::fs::remove_dir_all(&workspace.root).unwrap();
    }
}
