//! `firmware`: the images of the boards.
//!
//! The boards are a workspace of their own, `firmware/boards`, because they build for bare
//! metal only. Their images are put where a person finds them, `target/firmware`; what cargo
//! makes on the way stays in `target/firmware/build`.

pub mod boards;
mod dependencies;
pub mod load;
pub mod toolchain;
pub mod uf2;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, ensure};

use self::boards::{Board, Flashing};
use self::toolchain::{Toolchain, Verb};
use crate::console;
use crate::house::{House, execute};

/// Builds the firmware images.
///
/// Takes rustup's targets if they are installed, else Debian's compiler with the core library
/// from its sources. Leaves an ELF file for each image in target/firmware, for boards that
/// show a drive a .uf2 file too, and for boards with a boot loader in ROM a .bin file.
#[derive(clap::Args, Default)]
#[command(
    after_help = "Examples:\n  cargo xtask firmware                # every board but the pico2\n  cargo xtask firmware pico nucleo-h743   # these"
)]
pub struct Arguments {
    /// The boards; all of them but the pico2 if none is named.
    boards: Vec<String>,
    /// The compiler to use, rather than the first that is installed.
    #[arg(long)]
    toolchain: Option<Toolchain>,
}

/// A linked image of a board.
#[derive(Debug, Clone)]
pub struct Image {
    /// What it is called: as its board, and if it is not the board's application,
    /// as its binary too.
    pub name: String,
    /// Its board.
    pub board: &'static Board,
    /// The ELF file.
    pub elf: PathBuf,
}

/// Builds what the arguments name.
pub fn run(house: &House, arguments: &Arguments) -> Result<()> {
    let boards = boards::select(&arguments.boards)?;
    let images = build(house, &boards, arguments.toolchain)?;
    let mut rows = vec![["image", "target", "flash bytes", "files"].map(String::from)];
    for image in &images {
        let bytes = read(&image.elf)?;
        let flash: usize = load::parts(&bytes)?
            .iter()
            .map(|part| part.bytes.len())
            .sum();
        rows.push([
            image.name.clone(),
            image.board.target.to_owned(),
            flash.to_string(),
            forms(house, &image.name),
        ]);
    }
    console::rows(&rows);
    Ok(())
}

/// Builds every image of these boards, with this compiler or the first that is there.
pub fn build(
    house: &House,
    boards: &[&'static Board],
    asked: Option<Toolchain>,
) -> Result<Vec<Image>> {
    let toolchain = toolchain::choose(house, asked)?;
    dependencies::check(house)?;
    console::progress("dependencies: no executor, no hardware, no std, no heap in the brain");
    console::progress(&format!("building with {toolchain}"));
    let packages = house.members(&manifest(house))?;
    let mut images = Vec::new();
    for board in boards {
        let binaries = binaries(&packages, board)?;
        build_board(house, toolchain, board)?;
        for binary in binaries {
            let built = house
                .firmware()
                .join("build")
                .join(board.target)
                .join("firmware")
                .join(&binary);
            let name = image_name(board, &binary);
            images.push(put(house, board, name, &built)?);
        }
    }
    Ok(images)
}

/// The boards' workspace.
pub fn manifest(house: &House) -> PathBuf {
    house
        .root
        .join("firmware")
        .join("boards")
        .join("Cargo.toml")
}

/// The files of an image, as `target/firmware/pico.{elf,uf2}`.
fn forms(house: &House, name: &str) -> String {
    let folder = house.firmware();
    let ends: Vec<&str> = ["elf", "bin", "uf2"]
        .into_iter()
        .filter(|end| folder.join(format!("{name}.{end}")).is_file())
        .collect();
    let folder = folder.strip_prefix(&house.root).unwrap_or(&folder);
    match ends[..] {
        [end] => format!("{}/{name}.{end}", folder.display()),
        _ => format!("{}/{name}.{{{}}}", folder.display(), ends.join(",")),
    }
}

/// Holds clippy's lints in the package of every usual board.
pub fn lint(house: &House) -> Result<()> {
    let toolchain = toolchain::choose(house, None)?;
    for board in boards::usual() {
        let mut command = cargo(house, toolchain, Verb::Clippy, board);
        execute(command.args(["--", "-D", "warnings"]))?;
    }
    Ok(())
}

fn build_board(house: &House, toolchain: Toolchain, board: &Board) -> Result<()> {
    execute(cargo(house, toolchain, Verb::Build, board).arg("--bins"))
        .with_context(|| format!("the firmware of board `{}` does not build", board.name))
}

fn cargo(house: &House, toolchain: Toolchain, verb: Verb, board: &Board) -> Command {
    let mut command = toolchain.cargo(house, verb, board.target, board.cpu);
    command
        .current_dir(house.root.join("firmware").join("boards"))
        .args(["--package", board.package]);
    if let Some(features) = board.features {
        command.args(["--no-default-features", "--features", features]);
    }
    command
}

/// What cargo knows about the package of a board.
pub fn package<'list>(
    packages: &'list serde_json::Value,
    board: &Board,
) -> Result<&'list serde_json::Value> {
    let list = packages["packages"].as_array();
    list.into_iter()
        .flatten()
        .find(|package| package["name"] == board.package)
        .with_context(|| format!("firmware/boards has no package `{}`", board.package))
}

/// The names of the board's binaries: those whose features the board has.
fn binaries(packages: &serde_json::Value, board: &Board) -> Result<Vec<String>> {
    let list = |value: &serde_json::Value, key| {
        let list = value.get(key).and_then(|list| list.as_array());
        list.cloned().unwrap_or_default()
    };
    let binaries: Vec<String> = list(package(packages, board)?, "targets")
        .iter()
        .filter(|target| list(target, "kind").iter().any(|kind| kind == "bin"))
        .filter(|target| {
            let needs = list(target, "required-features");
            needs
                .iter()
                .all(|need| board.features.is_some_and(|features| need == features))
        })
        .filter_map(|target| target["name"].as_str().map(String::from))
        .collect();
    ensure!(
        !binaries.is_empty(),
        "package `{}` has no binary",
        board.package
    );
    Ok(binaries)
}

/// What the image of a binary is called: `pico` for `umi-pico`, and `pico-figures` for
/// `figures` and for `umi-pico-figures`.
fn image_name(board: &Board, binary: &str) -> String {
    let other = binary.strip_prefix(board.package).unwrap_or(binary);
    match other.trim_start_matches('-') {
        "" => board.name.to_owned(),
        other => format!("{}-{other}", board.name),
    }
}

/// Puts an image into `target/firmware`, in all forms that its board can take.
fn put(house: &House, board: &'static Board, name: String, built: &Path) -> Result<Image> {
    let bytes = read(built)?;
    let parts = load::parts(&bytes).with_context(|| format!("image `{name}`"))?;
    let write = |end: &str, bytes: &[u8]| {
        let file = house.firmware().join(format!("{name}.{end}"));
        fs::write(&file, bytes).with_context(|| format!("cannot write {}", file.display()))?;
        anyhow::Ok(file)
    };
    let elf = write("elf", &bytes)?;
    match board.flashing {
        Flashing::Emulator => {}
        Flashing::Probe { .. } => drop(write("bin", &load::flat(&parts))?),
        Flashing::ProbeOrDrive { family, .. } => drop(write("uf2", &uf2::write(&parts, family))?),
    }
    Ok(Image { name, board, elf })
}

/// The bytes of a file.
pub fn read(file: &Path) -> Result<Vec<u8>> {
    fs::read(file).with_context(|| format!("cannot read {}", file.display()))
}
