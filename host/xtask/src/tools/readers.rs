//! Other implementations of the formats that clouds are written in: what a crate writes, it must not be the only one to
//! read.
//!
//! They come from Python's packages, into the target directory.

use std::path::PathBuf;

use anyhow::{Result, bail};

use crate::workspace::{Workspace, find_program, output};

/// LAS and LAZ, E57, Parquet: the releases that the tests were tried with.
const PACKAGES: [&str; 4] = [
    "laspy==2.7.0",
    "lazrs==0.8.2",
    "pye57==0.4.19",
    "pyarrow==26.0.1",
];
const TRY: &str = "import laspy, lazrs, pye57, pyarrow.parquet";

/// Where the tests look for them: a virtual environment beside their own binaries.
fn folder(workspace: &Workspace) -> PathBuf {
    workspace.target.join("xtask").join("readers")
}

/// Whether they are there and can be loaded.
pub fn are_there(workspace: &Workspace) -> bool {
    let python = folder(workspace).join("bin").join("python");
    python.is_file() && output(workspace.command(python).args(["-c", TRY])).is_ok()
}

/// Installs them, if they are not there already.
pub fn bring(workspace: &Workspace) -> Result<String> {
    let folder = folder(workspace);
    if !are_there(workspace) {
        if find_program("python3").is_none() {
            bail!("no python3");
        }
        output(
            workspace
                .command("python3")
                .args(["-m", "venv"])
                .arg(&folder),
        )?;
        output(
            workspace
                .command(folder.join("bin").join("python"))
                // What has no wheel for this Python is not compiled.
                .args(["-m", "pip", "install", "--quiet", "--only-binary", ":all:"])
                .args(PACKAGES),
        )?;
        if !are_there(workspace) {
            bail!("installed, but `{TRY}` fails");
        }
    }
    Ok(PACKAGES.join(" "))
}
