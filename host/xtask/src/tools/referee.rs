//! LinuxCNC's stand-alone interpreter, `rs274`: an independent judge of the programs
//! that the board sends and of the project's own interpreter.
//!
//! Debian's packages are unpacked beside the build, not installed: nothing else of
//! LinuxCNC is needed, and no root.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};

use crate::console;
use crate::workspace::{Workspace, execute, find_program, output};

/// The package with the interpreter.
const PACKAGE: &str = "linuxcnc-uspace";
/// How the names of those of its dependencies begin that `rs274` loads; the others are
/// for LinuxCNC's screens and hardware.
const LIBRARIES: [&str; 4] = ["libboost-python", "libedit", "libpython", "libtirpc"];

/// Where the tests look for it, beside their own binaries: see `umi_tests::referee`.
fn folder(workspace: &Workspace) -> PathBuf {
    workspace.target.join("xtask").join("referee")
}

/// Whether it is there and works.
pub fn is_there(workspace: &Workspace) -> bool {
    try_out(workspace, &folder(workspace)).is_ok()
}

/// Brings the referee, if it is not there and working already.
pub fn bring(workspace: &Workspace) -> Result<String> {
    let folder = folder(workspace);
    if try_out(workspace, &folder).is_err() {
        unpack(workspace, &folder)?;
        try_out(workspace, &folder)?;
    }
    Ok(format!("rs274 in {}", folder.display()))
}

/// A program of one motion must come out as one motion.
fn try_out(workspace: &Workspace, folder: &Path) -> Result<()> {
    let start = folder.join("rs274");
    ensure!(start.is_file(), "{} is not there", start.display());
    fs::write(folder.join("try.ngc"), "G21 G90\nG0 X1.5\nM2\n")?;
    for empty in ["try.var", "try.tbl"] {
        fs::write(folder.join(empty), "")?;
    }
    let said = output(
        workspace
            .command(&start)
            .args(["-g", "-v", "try.var", "-t", "try.tbl", "try.ngc"])
            .current_dir(folder)
            // Where it keeps its tool table while it runs.
            .env("HOME", folder),
    )?;
    ensure!(
        said.contains("STRAIGHT_TRAVERSE(1.5000, 0.0000"),
        "`{}` does not interpret a program; it said: {}",
        start.display(),
        said.trim()
    );
    Ok(())
}

fn unpack(workspace: &Workspace, folder: &Path) -> Result<()> {
    for program in ["apt-get", "apt-cache", "dpkg"] {
        if find_program(program).is_none() {
            bail!(
                "not a Debian system ({program} is missing): LinuxCNC's interpreter is unpacked from Debian's packages"
            );
        }
    }
    if folder.exists() {
        fs::remove_dir_all(folder)?;
    }
    let (packages, root) = (folder.join("packages"), folder.join("root"));
    fs::create_dir_all(&packages)?;
    fs::create_dir_all(&root)?;

    let needed = needed(workspace).context("no list of packages; type: sudo apt-get update")?;
    execute(
        workspace
            .command("apt-get")
            .args(["download", "--quiet=2"])
            .args(&needed)
            .current_dir(&packages),
    )?;
    for entry in fs::read_dir(&packages)? {
        execute(
            workspace
                .command("dpkg")
                .arg("-x")
                .arg(entry?.path())
                .arg(&root),
        )?;
    }
    fs::remove_dir_all(&packages)?;
    write_start(folder, &root)
}

/// The interpreter's package, and its libraries that this system does not have.
fn needed(workspace: &Workspace) -> Result<Vec<String>> {
    let depends = output(workspace.command("apt-cache").args(["depends", PACKAGE]))?;
    let libraries = depends
        .lines()
        .filter_map(|line| line.trim().strip_prefix("Depends: "))
        .filter(|name| LIBRARIES.iter().any(|start| name.starts_with(start)));
    let plan = output(
        workspace
            .command("apt-get")
            .args(["install", "--simulate", "--no-install-recommends"])
            .args(libraries),
    )?;
    let mut needed = vec![PACKAGE.to_owned()];
    needed.extend(to_install(&plan));
    console::progress(&format!("packages to unpack: {}", needed.join(" ")));
    Ok(needed)
}

/// The packages that a simulated installation would add; of one that is only renewed
/// (its present version stands in brackets) this system has what is needed.
fn to_install(plan: &str) -> impl Iterator<Item = String> + '_ {
    plan.lines().filter_map(|line| {
        let mut words = line.strip_prefix("Inst ")?.split_whitespace();
        let name = words.next()?;
        words
            .next()
            .is_none_or(|word| !word.starts_with('['))
            .then(|| name.to_owned())
    })
}

/// A script that starts the interpreter with its libraries.
fn write_start(folder: &Path, root: &Path) -> Result<()> {
    let mut libraries = vec![root.join("usr").join("lib")];
    // Debian's folders of one architecture, as /usr/lib/x86_64-linux-gnu.
    for top in ["lib", "usr/lib"] {
        let Ok(entries) = fs::read_dir(root.join(top)) else {
            continue;
        };
        for entry in entries {
            let path = entry?.path();
            if path.is_dir() && path.to_string_lossy().ends_with("-linux-gnu") {
                libraries.push(path);
            }
        }
    }
    let libraries: Vec<_> = libraries
        .iter()
        .map(|path| path.to_string_lossy())
        .collect();
    let script = format!(
        "#!/bin/sh\nLD_LIBRARY_PATH='{}' exec '{}' \"$@\"\n",
        libraries.join(":"),
        root.join("usr/bin/rs274").display()
    );
    let start = folder.join("rs274");
    fs::write(&start, script)?;
    make_executable(&start)
}

#[cfg(unix)]
fn make_executable(path: &Path) -> Result<()> {
    use std::os::unix::fs::PermissionsExt as _;
    fs::set_permissions(path, fs::Permissions::from_mode(0o755))?;
    Ok(())
}

#[cfg(not(unix))]
fn make_executable(_: &Path) -> Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    /// Only what is new is unpacked, by its name.
    #[test]
    fn packages_of_a_plan() {
        let plan = "Reading package lists...\n\
                    Inst libboost-python1.74.0 (1.74.0+ds1-21 Debian:12.11/oldstable [amd64])\n\
                    Inst libtirpc3 [1.3.3] (1.3.4 Debian [amd64])\n\
                    Conf libtirpc3 (1.3.4 Debian [amd64])\n";
        let names: Vec<String> = super::to_install(plan).collect();
        assert_eq!(names, ["libboost-python1.74.0"]);
    }
}
