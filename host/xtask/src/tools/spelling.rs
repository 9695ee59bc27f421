//! Spelling, by typos: its rules stand in `typos.toml`.

use std::path::PathBuf;

use anyhow::{Context as _, Result, bail};

use crate::tools::python;
use crate::workspace::{Workspace, execute, find_program};

const PROGRAM: &str = "typos";
/// The release that is installed: a newer one may know more words.
const VERSION: &str = "1.52.0";

/// Where it is: the user's own, or the one that set-up brought.
pub fn find(workspace: &Workspace) -> Option<PathBuf> {
    let ours = folder(workspace).join("bin").join(PROGRAM);
    find_program(PROGRAM).or_else(|| ours.is_file().then_some(ours))
}

/// Installs it, from Python's packages, into the target directory: compiled it is there in
/// seconds.
pub fn bring(workspace: &Workspace) -> Result<String> {
    if find(workspace).is_none() {
        let package = format!("{PROGRAM}=={VERSION}");
        python::install(workspace, &folder(workspace), &[&package])
            .with_context(|| format!("or type: cargo install typos-cli --version {VERSION}"))?;
    }
    Ok(PROGRAM.to_owned())
}

/// Holds the spelling of everything that is written by hand.
pub fn check(workspace: &Workspace) -> Result<()> {
    match find(workspace) {
        Some(program) => execute(&mut workspace.command(program)),
        None => bail!("no {PROGRAM}: cargo xtask set-up"),
    }
}

fn folder(workspace: &Workspace) -> PathBuf {
    workspace.target.join("xtask").join("spelling")
}
