//! Python's packages, each kind in a virtual environment of its own in the target directory.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

use crate::workspace::{Workspace, find_program, output};

/// The interpreter of such an environment.
pub fn interpreter(folder: &Path) -> PathBuf {
    folder.join("bin").join("python")
}

/// Makes the environment and installs packages into it.
///
/// # Errors
/// There is no Python, or it cannot bring them.
pub fn install(workspace: &Workspace, folder: &Path, packages: &[&str]) -> Result<()> {
    if find_program("python3").is_none() {
        bail!("no python3");
    }
    output(
        workspace
            .command("python3")
            .args(["-m", "venv"])
            .arg(folder),
    )?;
    output(
        workspace
            .command(interpreter(folder))
            .args(["-m", "pip", "install", "--quiet"])
            .args(packages),
    )?;
    Ok(())
}
