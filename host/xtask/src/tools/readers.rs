//! Other implementations of the formats that clouds are written in: what a crate writes, it must not be the only one to
//! read.
//!
//! They come from Python's packages, into the target directory.

use std::path::PathBuf;

use anyhow::{Result, bail};

use crate::tools::python;
use crate::workspace::{Workspace, output};

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
    let python = python::interpreter(&folder(workspace));
    python.is_file() && output(workspace.command(python).args(["-c", TRY])).is_ok()
}

/// Installs them, if they are not there already.
pub fn bring(workspace: &Workspace) -> Result<String> {
    if !are_there(workspace) {
        // What has no wheel for this Python is not compiled.
        let packages = [&["--only-binary", ":all:"], &PACKAGES[..]].concat();
        python::install(workspace, &folder(workspace), &packages)?;
        if !are_there(workspace) {
            bail!("installed, but `{TRY}` fails");
        }
    }
    Ok(PACKAGES.join(" "))
}
