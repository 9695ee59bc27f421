//! What runs firmware images without a board: QEMU, and the emulated Pico of `tests/rp2040`.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};

use crate::workspace::{Workspace, execute, find_program, output};

const QEMU: &str = "qemu-system-arm";

/// What Debian's packages of them are called.
pub const DEBIAN_PACKAGES: [&str; 3] = [QEMU, "nodejs", "npm"];

/// Which of their packages are missing.
pub fn missing_packages() -> Vec<&'static str> {
    let programs = [QEMU, "node", "npm"].into_iter().zip(DEBIAN_PACKAGES);
    let missing = programs.filter(|(program, _)| find_program(program).is_none());
    missing.map(|(_, package)| package).collect()
}

/// Brings the packages of npm that the emulated Pico is made of, if they are not there.
pub fn bring(workspace: &Workspace) -> Result<String> {
    let node = node(workspace)?;
    if !is_installed(&folder(workspace)) {
        execute(
            workspace
                .command("npm")
                .current_dir(folder(workspace))
                .args(["ci", "--no-audit", "--no-fund"]),
        )?;
    }
    Ok(format!("{QEMU}; rp2040js in node {node}"))
}

/// Why an image cannot be run here, with what to do.
pub fn missing(workspace: &Workspace) -> Option<String> {
    let missing = missing_packages();
    if !missing.is_empty() {
        return Some(format!("no {}: cargo xtask set-up", missing.join(", ")));
    }
    if let Err(error) = node(workspace) {
        return Some(format!("{error:#}"));
    }
    (!is_installed(&folder(workspace))).then(|| "no rp2040js: cargo xtask set-up".to_owned())
}

/// The folder of the emulated Pico.
pub fn folder(workspace: &Workspace) -> PathBuf {
    workspace.root.join("tests").join("rp2040")
}

/// The version of node, if it is new enough for the emulated Pico.
fn node(workspace: &Workspace) -> Result<String> {
    let package = std::fs::read_to_string(folder(workspace).join("package.json"))?;
    let package: serde_json::Value = serde_json::from_str(&package)?;
    let wanted = package["engines"]["node"]
        .as_str()
        .and_then(|engine| major(engine.strip_prefix(">=")?))
        .context("tests/rp2040/package.json names no oldest node, as `>=18`")?;
    let version = output(workspace.command("node").arg("--version"))?;
    let version = version.trim().trim_start_matches('v');
    let found = major(version).with_context(|| format!("node calls itself `{version}`"))?;
    if found < wanted {
        bail!("node {version} is too old; {wanted} or newer is on https://nodejs.org");
    }
    ensure!(find_program("npm").is_some(), "node has come without npm");
    Ok(version.to_owned())
}

fn major(version: &str) -> Option<u32> {
    version.split('.').next()?.trim().parse().ok()
}

/// Whether npm has installed what the lock file says: it leaves a copy of it, last of all.
fn is_installed(folder: &Path) -> bool {
    let changed = |file: &str| std::fs::metadata(folder.join(file))?.modified();
    match (
        changed("package-lock.json"),
        changed("node_modules/.package-lock.json"),
    ) {
        (Ok(wanted), Ok(installed)) => installed >= wanted,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first number counts, with or without the others.
    #[test]
    fn versions() {
        assert_eq!(major("18"), Some(18));
        assert_eq!(major("20.20.2"), Some(20));
        assert_eq!(major("next"), None);
    }

    /// A lock file that has changed since is not installed, nor is one that never was.
    #[test]
    fn installed_once_and_changed() {
        use std::fs;
        use std::time::{Duration, SystemTime};
        let folder = std::env::temp_dir().join(format!("umi-xtask-npm-{}", std::process::id()));
        fs::create_dir_all(folder.join("node_modules")).unwrap();
        let lock = folder.join("package-lock.json");
        fs::write(&lock, "{}").unwrap();
        assert!(!is_installed(&folder));
        fs::write(folder.join("node_modules/.package-lock.json"), "{}").unwrap();
        let set = |to| {
            fs::File::options()
                .write(true)
                .open(&lock)
                .unwrap()
                .set_modified(to)
        };
        set(SystemTime::now() - Duration::from_secs(60)).unwrap();
        assert!(is_installed(&folder));
        set(SystemTime::now() + Duration::from_secs(60)).unwrap();
        assert!(!is_installed(&folder));
        fs::remove_dir_all(&folder).unwrap();
    }
}
