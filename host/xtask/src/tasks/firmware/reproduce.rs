//! `reproduce`: whether an image is the same bytes wherever it is built.
//!
//! What is committed is put into two folders of different names and depths and built in each from
//! nothing. Every file of an image (ELF with its debug information, .bin, .uf2) must have the same
//! bytes in both. The tests build one image once more ([`again`]) and compare it with the one that is
//! there: what makes one image another in another folder, as the names of our crates did, makes all so.
//!
//! Cargo would name our crates by their paths, and so order code by them:
//! [`super::crate_names`] gives them names without.
//!
//! # Limitations
//!
//! Both folders are on one computer, with one compiler and one copy of the registry's crates.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use sha2::{Digest as _, Sha256};

use super::boards::{self, Board, Wanted};
use super::{SUMS, build_images, toolchain};
use crate::console;
use crate::workspace::{Workspace, output};

/// Builds images twice, in two folders, and compares them byte for byte.
///
/// Takes the sources of the newest commit. Both folders are in target/reproduce and are removed
/// where the images are the same.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cargo xtask reproduce\n  cargo xtask reproduce pico\n  cargo xtask reproduce selftest-pico   # the smallest image"
)]
pub(crate) struct Arguments {
    /// The boards, or `selftest-` and a board for its self-test alone; all boards if none is
    /// named.
    boards: Vec<String>,
    /// Builds the smallest image only, once, from the sources as they stand, and compares it with the one in
    /// target/firmware: what the tests do.
    #[arg(long, conflicts_with = "boards")]
    again: bool,
}

/// Builds and compares.
pub fn run(workspace: &Workspace, arguments: &Arguments) -> Result<()> {
    if arguments.again {
        return again(workspace);
    }
    let wanted = boards::select_images(&arguments.boards)?;
    let folder = emptied(workspace)?;
    let commit = commit(workspace)?;
    let mut sums = Vec::new();
    for root in [folder.join("a"), folder.join("another/folder/deeper")] {
        sums.push(built(workspace, &commit, &root, &wanted)?);
    }
    let [first, second] = &sums[..] else {
        unreachable!("two folders")
    };
    same(first, second, &folder)
}

/// The image that is built once more: of all it takes the least time.
const LEAST: &str = "selftest-pico";

/// Builds one image once more, in another folder, from the sources as they stand here: it must be the one that
/// was built here, byte for byte.
pub fn again(workspace: &Workspace) -> Result<()> {
    let toolchain = toolchain::choose(workspace, None)?;
    let compiler = toolchain.compiler(workspace)?;
    if !compiler.is_pinned {
        console::warning(&format!(
            "not tried whether images are the same in another folder: {compiler}"
        ));
        return Ok(());
    }
    let wanted = boards::select_images(&[LEAST.to_owned()])?;
    let folder = emptied(workspace)?;
    let sources = as_they_stand(workspace, &folder)?;
    let copy = copied(workspace, &sources, &folder.join("another/folder/deeper"))?;
    // Macros and build scripts of others' crates run on this computer and are in no image: they are taken as they
    // are. Where they cannot be, it takes longer.
    let made = toolchain.build(&copy);
    fs::create_dir_all(&made)?;
    let mut take = workspace.command("cp");
    let _ = output(
        take.arg("-a")
            .arg(toolchain.build(workspace).join("firmware"))
            .arg(&made),
    );
    build_images(&copy, &wanted, None)?;
    let there = summed(&copy.firmware())?;
    same(&of_the_same_names(workspace, &there)?, &there, &folder)
}

/// The digests of the images that were built here, of those that were built there.
fn of_the_same_names(
    workspace: &Workspace,
    there: &[(String, String)],
) -> Result<Vec<(String, String)>> {
    let mut here = summed(&workspace.firmware())?;
    here.retain(|(name, _)| there.iter().any(|(other, _)| name == other));
    Ok(here)
}

/// The sources of the checkout as git's name of a tree, with what is not committed.
fn as_they_stand(workspace: &Workspace, folder: &Path) -> Result<String> {
    fs::create_dir_all(folder)?;
    let git = |arguments: &[&str]| {
        let mut command = workspace.command("git");
        // Not the user's own index.
        command.env("GIT_INDEX_FILE", folder.join("index"));
        output(command.args(arguments))
    };
    git(&["add", "--all"])?;
    Ok(git(&["write-tree"])?.trim().to_owned())
}

/// The folder for copies, without any.
fn emptied(workspace: &Workspace) -> Result<PathBuf> {
    let folder = workspace.target.join("reproduce");
    if folder.exists() {
        fs::remove_dir_all(&folder)?;
    }
    Ok(folder)
}

/// The newest commit. Both folders are of one, also where another is made meanwhile.
fn commit(workspace: &Workspace) -> Result<String> {
    let said = output(workspace.command("git").args(["rev-parse", "HEAD"]))?;
    Ok(said.trim().to_owned())
}

/// The digests of images that are built in a folder of their own.
fn built(
    workspace: &Workspace,
    sources: &str,
    root: &Path,
    wanted: &[(&'static Board, Wanted)],
) -> Result<Vec<(String, String)>> {
    let copy = copied(workspace, sources, root)?;
    build_images(&copy, wanted, None)?;
    summed(&copy.firmware())
}

/// Says that images are the same, or which are not.
fn same(first: &[(String, String)], second: &[(String, String)], folder: &Path) -> Result<()> {
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
    fs::remove_dir_all(folder)?;
    Ok(())
}

/// A commit, or a tree, in a folder of its own, with its own target folder.
fn copied(workspace: &Workspace, sources: &str, root: &Path) -> Result<Workspace> {
    fs::create_dir_all(root)?;
    let archive = root.join("sources.tar");
    let git = ["archive", "--format=tar", sources, "--output"];
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
    files.retain(|file| file.is_file() && file.extension().is_none_or(|end| end != SUMS));
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
pub fn sum(bytes: &[u8]) -> String {
    let sum = Sha256::digest(bytes);
    sum.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Images with the same digests are the same; another digest, or one that is missing, is told.
    #[test]
    fn what_differs_is_told() {
        let folder = std::env::temp_dir().join(format!("umi-reproduce-{}", std::process::id()));
        let image = |name: &str, sum: &str| (name.to_owned(), sum.to_owned());
        let first = [image("pico.elf", "01"), image("pico.uf2", "02")];
        let other = [image("pico.elf", "01"), image("pico.uf2", "03")];
        for wrong in [&other[..], &first[..1], &[]] {
            fs::create_dir_all(&folder).unwrap();
            let refused = same(&first, wrong, &folder);
            assert!(refused.is_err(), "{wrong:?}");
            assert!(folder.exists(), "what differs stays");
        }
        assert!(same(&[], &[], &folder).is_err());
        same(&first, &first, &folder).unwrap();
        assert!(!folder.exists());
    }

    /// One byte of an image here, or an image that is not here, and it is not the one that was built there; what
    /// was built here besides is not asked for.
    #[test]
    fn one_byte_is_told() {
        let folder = std::env::temp_dir().join(format!("umi-again-{}", std::process::id()));
        let workspace = |name: &str| {
            let root = folder.join(name);
            let target = root.join("target");
            fs::create_dir_all(target.join("firmware")).unwrap();
            Workspace { root, target }
        };
        let (here, there) = (workspace("a"), workspace("b"));
        let write = |to: &Workspace, name: &str, bytes| {
            fs::write(to.firmware().join(name), bytes).unwrap();
        };
        let compared = || {
            let there = summed(&there.firmware()).unwrap();
            same(
                &of_the_same_names(&here, &there).unwrap(),
                &there,
                &folder.join("copies"),
            )
        };
        fs::create_dir_all(folder.join("copies")).unwrap();
        write(&there, "small.elf", b"image");
        write(&there, "small.uf2", b"drive");
        write(&here, "other.elf", b"other");
        write(&here, "small.elf", b"image");
        assert!(compared().is_err());
        write(&here, "small.uf2", b"drivf");
        assert!(compared().is_err());
        write(&here, "small.uf2", b"drive");
        compared().unwrap();
        fs::remove_dir_all(&folder).unwrap();
    }

    /// What is not committed is copied as well, and the user's index stays as it is.
    #[test]
    fn sources_as_they_stand() {
        let folder = std::env::temp_dir().join(format!("umi-stand-{}", std::process::id()));
        let workspace = Workspace {
            root: folder.join("checkout"),
            target: folder.join("target"),
        };
        fs::create_dir_all(&workspace.root).unwrap();
        let git = |arguments: &[&str]| output(workspace.command("git").args(arguments)).unwrap();
        git(&["init", "--quiet"]);
        fs::write(workspace.root.join("new"), "sources").unwrap();
        let tree = as_they_stand(&workspace, &folder.join("index")).unwrap();
        let copy = copied(&workspace, &tree, &folder.join("copy")).unwrap();
        assert_eq!(fs::read(copy.root.join("new")).unwrap(), b"sources");
        assert_eq!(git(&["ls-files"]), "");
        fs::remove_dir_all(&folder).unwrap();
    }
}
