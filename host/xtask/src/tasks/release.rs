//! `release`: `umi` as it is given away, with the list of what it is built on in it.
//!
//! The list is that of cargo-auditable: JSON, compressed by zlib, in the section `.dep-v0`. `cargo audit bin`,
//! `rust-audit-info` and others that look for advisories read it from the program alone. cargo-auditable itself
//! would compile all of our crates once more; here the section is put into the program that is built anyway.
//!
//! # Limitations
//!
//! objcopy knows programs of Linux and of Windows. Elsewhere `cargo auditable install --path host/umi` makes one
//! with its list, as it does anywhere.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use auditable_info::{Limits, audit_info_from_file};
use auditable_serde::VersionInfo;
use miniz_oxide::deflate::compress_to_vec_zlib;

use crate::console;
use crate::tasks::firmware::reproduce;
use crate::tasks::firmware::sbom::{self, PackageName};
use crate::workspace::{Workspace, execute, find_program, output};

const OBJCOPY: &str = "objcopy";
/// Its name, by which readers find it.
const SECTION: &str = ".dep-v0";

/// Builds `umi` for release, with the list of its dependencies in it.
///
/// Leaves it in target/release-umi, with its digest beside it. `cargo audit bin` says which advisories are
/// about what is in it.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  cargo xtask release")]
pub(crate) struct Arguments {}

/// Builds it, and reads the list back.
pub fn run(workspace: &Workspace, _: &Arguments) -> Result<()> {
    ensure!(
        find_program(OBJCOPY).is_some(),
        "no {OBJCOPY}: apt-get install binutils"
    );
    let mut build = workspace.cargo();
    execute(build.args(["build", "--release", "--locked", "--package", "umi"]))?;
    let name = format!("umi{}", std::env::consts::EXE_SUFFIX);
    let folder = workspace.target.join("release-umi");
    fs::create_dir_all(&folder)?;
    let program = folder.join(&name);
    let list = serde_json::to_vec(&sbom::of_umi(workspace)?)?;
    let built = workspace.target.join("release").join(&name);
    with_list(workspace, &built, &list, &program)?;
    let packages = held(&read(&program)?, &sbom::locked(workspace)?)?;
    let bytes = fs::read(&program)?;
    let sum = reproduce::sum(&bytes);
    let sums = folder.join("umi.sha256");
    fs::write(&sums, format!("{sum}  {name}\n"))?;
    console::rows(&[
        ["program", "bytes", "packages in its list", "SHA-256"].map(String::from),
        [
            program.display().to_string(),
            bytes.len().to_string(),
            packages.to_string(),
            sum,
        ],
    ]);
    Ok(())
}

/// A copy of a program with this list in it.
fn with_list(workspace: &Workspace, program: &Path, list: &[u8], copy: &Path) -> Result<()> {
    let packed: PathBuf = copy.with_extension("dep-v0");
    fs::write(&packed, compress_to_vec_zlib(list, 7))?;
    let mut section = std::ffi::OsString::from(format!("{SECTION}="));
    section.push(&packed);
    let mut command = workspace.command(OBJCOPY);
    output(
        command
            .arg("--add-section")
            .arg(section)
            .args([program, copy]),
    )?;
    Ok(fs::remove_file(&packed)?)
}

/// The list that is in a program.
fn read(program: &Path) -> Result<VersionInfo> {
    audit_info_from_file(program, Limits::default())
        .with_context(|| format!("{} has no list that can be read", program.display()))
}

/// How many packages the list of `umi` has: each as the lock file names it.
fn held(list: &VersionInfo, locked: &BTreeSet<PackageName>) -> Result<usize> {
    let root = list.packages.iter().find(|of| of.root);
    ensure!(
        root.is_some_and(|of| of.name == "umi" && of.dependencies.len() > 1),
        "the list is not that of umi"
    );
    for of in &list.packages {
        let name = (of.name.clone(), of.version.to_string());
        ensure!(
            locked.contains(&name),
            "{} {} is in the list, and not in Cargo.lock",
            name.0,
            name.1
        );
    }
    Ok(list.packages.len())
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use serde_json::json;

    use super::*;

    /// The list comes out of the program as it went in, the program still runs, and one without a list is told.
    #[test]
    fn a_list_is_read_back() {
        let folder = std::env::temp_dir().join(format!("umi-release-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let workspace = Workspace {
            root: folder.clone(),
            target: folder.join("target"),
        };
        let package = |name: &str, root: bool, needs: &[usize]| {
            let version = "1.2.3";
            json!({"name": name, "version": version, "source": "local", "root": root, "dependencies": needs})
        };
        let list = json!({"packages": [
            package("clap", false, &[]), package("serde", false, &[]), package("umi", true, &[0, 1]),
        ]});
        let this = std::env::current_exe().unwrap();
        assert!(read(&this).is_err());
        let copy = folder.join("copy");
        with_list(
            &workspace,
            &this,
            &serde_json::to_vec(&list).unwrap(),
            &copy,
        )
        .unwrap();
        let said = output(workspace.command(&copy).arg("--list")).unwrap();
        assert!(said.contains("a_list_is_read_back"));
        let found = read(&copy).unwrap();
        let name = |name: &str| (name.to_owned(), "1.2.3".to_owned());
        let mut locked = BTreeSet::from(["clap", "serde", "umi"].map(name));
        assert_eq!(held(&found, &locked).unwrap(), 3);
        locked.remove(&name("serde"));
        assert!(held(&found, &locked).is_err());
        fs::remove_dir_all(&folder).unwrap();
    }
}
