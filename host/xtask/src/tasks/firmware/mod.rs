//! `firmware`: the images of the boards.
//!
//! The boards are a workspace of their own, `firmware/boards`, because they build for bare
//! metal only. Their images are put where a person finds them, `target/firmware`; what cargo
//! makes on the way stays in `target/firmware/build`.

pub mod boards;
pub mod crate_names;
mod dependencies;
pub mod pin;
pub mod reproduce;
pub mod sbom;
mod sealed;
mod signed;
pub mod toolchain;
pub mod uf2;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use imagecheck::load;

use self::boards::{Board, Flashing, Wanted};
use self::toolchain::{Compiler, Toolchain, Verb};
use crate::console;
use crate::workspace::{Workspace, execute};

/// Builds the firmware images.
///
/// Takes the compiler that firmware/boards/rust-toolchain.toml pins if rustup has it, else the
/// active one with its targets, else Debian's with the core library from its sources. Leaves an
/// ELF file for each image in target/firmware, for boards that show a drive a .uf2 file too, and
/// for boards with a boot loader in ROM a .bin file, with the digests of all of them beside; what --toolchain debian makes is in
/// target/firmware/debian.
#[derive(clap::Args, Default)]
#[command(
    after_help = "Examples:\n  cargo xtask firmware                # every board\n  cargo xtask firmware pico nucleo-h743   # these\n  cargo xtask firmware --sign fw          # a Pico that takes only what the key `fw` has signed\n  cargo xtask firmware nucleo-h743 --sign fw   # a Nucleo\n  cargo xtask firmware pico2 --sign fw    # a Pico 2, whose boot ROM does the rest\n  cargo xtask firmware selftest-pico      # the image that tests a Pico, and how it gets there"
)]
pub(crate) struct Arguments {
    /// The boards, or `selftest-` and a board for its self-test alone; all boards if none is
    /// named.
    boards: Vec<String>,
    /// The compiler to use, rather than the first that is installed.
    #[arg(long)]
    toolchain: Option<Toolchain>,
    /// Builds the Pico, or nucleo-h743, with its boot loader, and signs its images by this secret key (`umi
    /// key new`): pico-signed.uf2 or nucleo-h743-signed.bin for a new board, BOARD-a.umif and BOARD-b.umif
    /// for `umi update`. The key beside it, KEY.pub, goes into the boot loader. The Pico 2, where it is named:
    /// pico2-signed.uf2 and pico2.umif, sealed for its boot ROM by KEY.boot.pem, which is made where there is none;
    /// pico2-otp.json for the fuses, which nothing burns.
    #[arg(long, value_name = "KEY")]
    sign: Option<PathBuf>,
    /// The security counter of signed images: raise it where what came before must never run again.
    #[arg(long, value_name = "N", default_value_t = 1, requires = "sign")]
    counter: u32,
}

/// A linked image of a board.
#[derive(Debug, Clone)]
pub(crate) struct Image {
    /// What it is called: as its board, and if it is not the board's application,
    /// as its binary too.
    pub name: String,
    /// Its board.
    pub board: &'static Board,
    /// The ELF file.
    pub elf: PathBuf,
}

/// Builds what the arguments name.
pub fn run(workspace: &Workspace, arguments: &Arguments) -> Result<()> {
    if let Some(key) = &arguments.sign {
        if arguments.boards == ["pico2"] {
            return sealed::run(workspace, key, arguments.counter, arguments.toolchain);
        }
        let board = signed::find(&arguments.boards)?;
        return signed::run(
            workspace,
            board,
            key,
            arguments.counter,
            arguments.toolchain,
        );
    }
    let wanted = boards::select_images(&arguments.boards)?;
    let images = build_images(workspace, &wanted, arguments.toolchain)?.images;
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
            forms(workspace, image),
        ]);
    }
    console::rows(&rows);
    for (board, _) in wanted
        .iter()
        .filter(|(_, wanted)| *wanted == Wanted::SelfTest)
    {
        println!("{}", how_to_test(workspace, board, &images));
    }
    Ok(())
}

/// The end of the name of a file of digests.
const SUMS: &str = "sha256";

/// Writes the digests of an image's files beside them, as `sha256sum --check` reads them.
fn sums(image: &Path) -> Result<()> {
    let mut text = String::new();
    for end in ["elf", "bin", "uf2", "umif"] {
        let file = image.with_extension(end);
        if file.is_file() {
            let sum = reproduce::sum(&read(&file)?);
            let name = file.file_name().unwrap_or_default();
            text += &format!("{sum}  {}\n", name.display());
        }
    }
    let file = image.with_extension(SUMS);
    fs::write(&file, text).with_context(|| format!("cannot write {}", file.display()))
}

/// What to do with the image of a self-test.
fn how_to_test(workspace: &Workspace, board: &Board, images: &[Image]) -> String {
    let name = image_name(board, SELF_TEST_BINARY);
    let elf = images.iter().find(|image| image.name == name);
    let file = |end: &str| {
        let file = elf.map_or_else(PathBuf::new, |image| image.elf.with_extension(end));
        let short = file.strip_prefix(&workspace.root).unwrap_or(&file);
        short.display().to_string()
    };
    let wiring = format!("firmware/boards/{}/README.md", board.folder());
    let probe = |chip| {
        format!(
            "  by a debug probe    probe-rs download --chip {chip} {elf}\n                      probe-rs reset --chip {chip}",
            elf = file("elf")
        )
    };
    let ways = match board.flashing {
        Flashing::Emulator | Flashing::Signed => String::new(),
        Flashing::Probe { chip } => probe(chip),
        Flashing::ProbeOrDrive { chip, family } => format!(
            "  without a probe     hold BOOTSEL while the board is plugged in, and copy {}\n                      onto the drive {} that appears\n{}",
            file("uf2"),
            family.board_id(),
            probe(chip)
        ),
    };
    format!(
        "\n{name}: the board drives its own inputs. Read \"Self-test\" in {wiring} first:\nwhat may be connected, and what must be.\n{ways}\n  then                wait three seconds, and: umi selftest -o {}-1.json",
        board.name
    )
}

/// What was built.
#[derive(Debug)]
pub(crate) struct Built {
    /// The images.
    pub images: Vec<Image>,
    /// What built them.
    pub compiler: Compiler,
}

/// Builds every image of these boards, with this compiler or the first that is there.
pub fn build(
    workspace: &Workspace,
    boards: &[&'static Board],
    asked: Option<Toolchain>,
) -> Result<Built> {
    let all: Vec<_> = boards.iter().map(|board| (*board, Wanted::All)).collect();
    build_images(workspace, &all, asked)
}

/// The binary of a board's self-test.
const SELF_TEST_BINARY: &str = "selftest";

/// Builds what is wanted of these boards, with this compiler or the first that is there.
fn build_images(
    workspace: &Workspace,
    wanted: &[(&'static Board, Wanted)],
    asked: Option<Toolchain>,
) -> Result<Built> {
    let toolchain = toolchain::choose(workspace, asked)?;
    let compiler = toolchain.compiler(workspace)?;
    dependencies::check(workspace)?;
    console::progress("dependencies: no executor, no hardware, no std, no heap in the brain");
    console::progress(&format!("building with {compiler}"));
    let packages = workspace.members(&manifest(workspace))?;
    let folder = folder(workspace, toolchain);
    fs::create_dir_all(&folder)?;
    let mut images = Vec::new();
    for (board, wanted) in wanted {
        let mut binaries = binaries(&packages, board)?;
        if *wanted == Wanted::SelfTest {
            binaries.retain(|binary| binary == SELF_TEST_BINARY);
            ensure!(
                !binaries.is_empty(),
                "there is no self-test of the board `{}`",
                board.name
            );
        }
        build_board(workspace, toolchain, board, *wanted)?;
        for binary in binaries {
            let built = toolchain
                .build(workspace)
                .join(board.target)
                .join("firmware")
                .join(&binary);
            let name = image_name(board, &binary);
            images.push(put(&folder, board, name, &built)?);
        }
    }
    images.iter().try_for_each(|image| sums(&image.elf))?;
    Ok(Built { images, compiler })
}

/// Where images go: `target/firmware`, but for those of a compiler that is not the first here,
/// which must not take the place of what the emulators run.
fn folder(workspace: &Workspace, toolchain: Toolchain) -> PathBuf {
    let folder = workspace.firmware();
    match toolchain {
        _ if toolchain::installed(workspace) == Some(toolchain) => folder,
        Toolchain::Pinned | Toolchain::Rustup => folder.join("rustup"),
        Toolchain::Debian => folder.join("debian"),
    }
}

/// The boards' workspace.
pub fn manifest(workspace: &Workspace) -> PathBuf {
    workspace
        .root
        .join("firmware")
        .join("boards")
        .join("Cargo.toml")
}

/// The files of an image, as `target/firmware/pico.{elf,uf2}`.
fn forms(workspace: &Workspace, image: &Image) -> String {
    let folder = image.elf.parent().unwrap_or(&workspace.root);
    let name = &image.name;
    let ends: Vec<&str> = ["elf", "bin", "uf2"]
        .into_iter()
        .filter(|end| folder.join(format!("{name}.{end}")).is_file())
        .collect();
    let folder = folder.strip_prefix(&workspace.root).unwrap_or(folder);
    match ends[..] {
        [end] => format!("{}/{name}.{end}", folder.display()),
        _ => format!("{}/{name}.{{{}}}", folder.display(), ends.join(",")),
    }
}

/// Holds clippy's lints in the package of every board.
pub fn lint(workspace: &Workspace) -> Result<()> {
    let toolchain = toolchain::choose(workspace, None)?;
    // At place B is the same code as at place A.
    let boards = boards::BOARDS
        .iter()
        .filter(|board| !board.name.ends_with("-b"));
    for board in boards {
        let mut command = cargo(workspace, toolchain, Verb::Clippy, board)?;
        if let Some(binary) = board.only {
            command.args(["--bin", binary]);
        }
        execute(command.args(["--", "-D", "warnings"]))?;
    }
    Ok(())
}

fn build_board(
    workspace: &Workspace,
    toolchain: Toolchain,
    board: &Board,
    wanted: Wanted,
) -> Result<()> {
    let mut command = cargo(workspace, toolchain, Verb::Build, board)?;
    match wanted {
        Wanted::All => match board.only {
            Some(binary) => command.args(["--bin", binary]),
            None => command.arg("--bins"),
        },
        Wanted::SelfTest => command.args(["--bin", SELF_TEST_BINARY]),
    };
    execute(&mut command)
        .with_context(|| format!("the firmware of board `{}` does not build", board.name))
}

fn cargo(
    workspace: &Workspace,
    toolchain: Toolchain,
    verb: Verb,
    board: &Board,
) -> Result<Command> {
    let mut command = toolchain.cargo(workspace, verb, board.target, board.cpu)?;
    command
        .current_dir(workspace.root.join("firmware").join("boards"))
        .args(["--package", board.package]);
    if let Some(features) = board.features {
        command.args(["--no-default-features", "--features", features]);
    }
    Ok(command)
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
            let features = board.features.unwrap_or_default();
            let needs = list(target, "required-features");
            needs
                .iter()
                .all(|need| features.split(',').any(|of| need == of))
        })
        .filter_map(|target| target["name"].as_str().map(String::from))
        .filter(|name| board.only.is_none_or(|only| only == name))
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
    if board.only.is_some() {
        return board.name.to_owned();
    }
    let other = binary.strip_prefix(board.package).unwrap_or(binary);
    match other.trim_start_matches('-') {
        "" => board.name.to_owned(),
        other => format!("{}-{other}", board.name),
    }
}

/// Puts an image into a folder, in all forms that its board can take.
fn put(folder: &Path, board: &'static Board, name: String, built: &Path) -> Result<Image> {
    let bytes = read(built)?;
    let parts = load::parts(&bytes).with_context(|| format!("image `{name}`"))?;
    let write = |end: &str, bytes: &[u8]| {
        let file = folder.join(format!("{name}.{end}"));
        fs::write(&file, bytes).with_context(|| format!("cannot write {}", file.display()))?;
        anyhow::Ok(file)
    };
    let elf = write("elf", &bytes)?;
    match board.flashing {
        Flashing::Emulator => {}
        Flashing::Signed | Flashing::Probe { .. } => drop(write("bin", &load::flat(&parts))?),
        Flashing::ProbeOrDrive { family, .. } => drop(write("uf2", &uf2::write(&parts, family))?),
    }
    Ok(Image { name, board, elf })
}

/// The bytes of a file.
pub fn read(file: &Path) -> Result<Vec<u8>> {
    fs::read(file).with_context(|| format!("cannot read {}", file.display()))
}

#[cfg(test)]
mod tests {
    use super::{fs, sums};

    /// Each file of an image is in its digests, by its name; another image's is not (FIPS 180-2, B.1).
    #[test]
    fn digests_stand_beside_an_image() {
        const ABC: &str = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let folder = std::env::temp_dir().join(format!("umi-sums-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        for name in ["pico.elf", "pico.uf2", "pico2.elf"] {
            fs::write(folder.join(name), "abc").unwrap();
        }
        sums(&folder.join("pico.elf")).unwrap();
        let told = fs::read_to_string(folder.join("pico.sha256")).unwrap();
        assert_eq!(told, format!("{ABC}  pico.elf\n{ABC}  pico.uf2\n"));
        fs::remove_dir_all(&folder).unwrap();
    }
}
