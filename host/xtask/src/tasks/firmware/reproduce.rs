//! `reproduce`: whether an image is the same bytes wherever it is built.
//!
//! What is committed is put into two folders of different names and depths and built in each from
//! nothing. Every file of an image (ELF with its debug information, .bin, .uf2) must have the same
//! bytes in both.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use sha2::{Digest as _, Sha256};

use super::{boards, build};
use crate::console;
use crate::workspace::{Workspace, output};

/// Builds images twice, in two folders, and compares them byte for byte.
///
/// Takes the sources of the newest commit. Both folders are in target/reproduce and are removed
/// where the images are the same.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  cargo xtask reproduce\n  cargo xtask reproduce pico")]
pub(crate) struct Arguments {
    /// The boards; all of them if none is named.
    boards: Vec<String>,
}

/// Builds and compares.
pub fn run(workspace: &Workspace, arguments: &Arguments) -> Result<()> {
    let boards = boards::select(&arguments.boards)?;
    let folder = workspace.target.join("reproduce");
    if folder.exists() {
        fs::remove_dir_all(&folder)?;
    }
    let mut sums = Vec::new();
    for root in [folder.join("a"), folder.join("another/folder/deeper")] {
        let copy = copied(workspace, &root)?;
        build(&copy, &boards, None)?;
        sums.push(summed(&copy.firmware())?);
    }
    let [first, second] = &sums[..] else {
        unreachable!("two folders")
    };
    ensure!(!first.is_empty(), "no image was built");
    let differ: Vec<&str> = first
        .iter()
        .zip(second)
        .filter(|(one, other)| one != other)
        .map(|((name, _), _)| name.as_str())
        .collect();
    ensure!(
        differ.is_empty() && first.len() == second.len(),
        "not the same in both folders, which stay in {}: {}",
        folder.display(),
        differ.join(", ")
    );
    let mut rows = vec![["image", "SHA-256 in both folders"].map(String::from)];
    rows.extend(first.iter().map(|(name, sum)| [name.clone(), sum.clone()]));
    console::rows(&rows);
    fs::remove_dir_all(&folder)?;
    Ok(())
}

/// The newest commit in a folder of its own, with its own target folder.
fn copied(workspace: &Workspace, root: &Path) -> Result<Workspace> {
    fs::create_dir_all(root)?;
    let archive = root.join("sources.tar");
    let git = ["archive", "--format=tar", "HEAD", "--output"];
    output(workspace.command("git").args(git).arg(&archive))?;
    let tar = workspace
        .command("tar")
        .arg("-xf")
        .arg(&archive)
        .arg("-C")
        .arg(root)
        .output()
        .context("cannot run tar")?;
    ensure!(
        tar.status.success(),
        "tar cannot unpack {}",
        archive.display()
    );
    fs::remove_file(&archive)?;
    Ok(Workspace {
        root: root.to_owned(),
        target: root.join("target"),
    })
}

/// The images' files of a folder, by name.
fn summed(folder: &Path) -> Result<Vec<(String, String)>> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder)?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<_, _>>()?;
    files.retain(|file| file.is_file());
    files.sort();
    files
        .iter()
        .map(|file| Ok((name(file), sum(&super::read(file)?))))
        .collect()
}

fn name(file: &Path) -> String {
    let name = file.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// SHA-256 in hexadecimal digits.
pub(super) fn sum(bytes: &[u8]) -> String {
    let sum = Sha256::digest(bytes);
    sum.iter().map(|byte| format!("{byte:02x}")).collect()
}
