//! Boards that take only what their maker has signed: boot loader, key and images in the forms that people use.
//!
//! ```text
//! pico-signed.uf2          for a new board, to its BOOTSEL drive: boot loader with the maker's key, image A, nothing else
//! nucleo-h743-signed.bin   the same through a debug probe
//! BOARD-a.umif             the images for `umi update`, each for the place that it is linked for
//! BOARD-b.umif
//! ```
//!
//! Where the parts stand is drawn in `firmware/boards/BOARD/src/storage/chip_flash.rs`.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use imagecheck::load::{self, LoadPart};

use super::toolchain::Toolchain;
use super::{Built, boards, build, folder, read, sums, toolchain, uf2};
use crate::console;
use crate::workspace::{Workspace, execute, output};

/// A board with a boot loader of this project.
#[derive(Debug)]
pub(super) struct SignedBoard {
    /// What it is called here.
    name: &'static str,
    /// Its boot loader, and its images at the two places.
    images: [&'static str; 3],
    /// Where its flash begins.
    flash: u32,
    /// The boot loader's last bytes, for the maker's key.
    key: u32,
    /// What is erased of a new board but for its second place: where and how many bytes.
    erased: Option<(u32, usize)>,
    /// The images' places.
    places: [u32; 2],
    /// What is erased at once.
    sector: u32,
    /// Bytes of a place before the code.
    before_code: u32,
    /// How the whole gets into it.
    form: Form,
}

/// How the whole gets into a board.
#[derive(Debug)]
enum Form {
    /// To a drive.
    Uf2(uf2::Family),
    /// Through a debug probe.
    Probe,
}

pub(super) const PICO: SignedBoard = SignedBoard {
    name: "pico",
    images: ["pico-boot", "pico-a", "pico-b"],
    flash: 0x1000_0000,
    key: 0x1001_0000 - 32,
    // Which image counts.
    erased: Some((0x1001_0000, 0x4000)),
    places: [0x1001_4000, 0x1010_8000],
    sector: 4096,
    before_code: 256,
    form: Form::Uf2(uf2::Family::Rp2040),
};

const NUCLEO: SignedBoard = SignedBoard {
    name: "nucleo-h743",
    images: ["nucleo-h743-boot", "nucleo-h743-a", "nucleo-h743-b"],
    flash: 0x0800_0000,
    key: 0x0802_0000 - 32,
    // Which image counts stands beside the board's own key, which stays.
    erased: None,
    places: [0x0802_0000, 0x0810_0000],
    sector: 0x2_0000,
    before_code: 1024,
    form: Form::Probe,
};

/// Bytes of a header.
const HEADER: u32 = 192;

/// The board of this name; the Pico, where none is named.
pub(super) fn find(names: &[String]) -> Result<&'static SignedBoard> {
    let boards = [&PICO, &NUCLEO];
    let found = match names {
        [] => Some(&PICO),
        [name] => boards.into_iter().find(|board| board.name == name),
        _ => None,
    };
    found.context("one of pico and nucleo-h743: these have a boot loader that takes signed images")
}

/// Builds, signs and writes them.
pub fn run(
    workspace: &Workspace,
    board: &SignedBoard,
    key: &Path,
    counter: u32,
    asked: Option<Toolchain>,
) -> Result<()> {
    let public = public_key(workspace, key)?;
    let boards = board.images.into_iter().map(boards::find);
    let boards = boards.collect::<Result<Vec<_>>>()?;
    let Built { images, .. } = build(workspace, &boards, asked)?;
    let folder = folder(workspace, toolchain::choose(workspace, asked)?);
    let [loader, images @ ..] = &images[..] else {
        anyhow::bail!("nothing was built");
    };
    let mut signed = Vec::new();
    for (image, place) in images.iter().zip(board.places) {
        let payload = payload(&read(&image.elf)?, place, board.before_code)?;
        let bare = image.elf.with_extension("payload");
        fs::write(&bare, payload).with_context(|| format!("cannot write {}", bare.display()))?;
        let file = image.elf.with_extension("umif");
        sign(workspace, &bare, image.board.name, key, counter, &file)?;
        fs::remove_file(&bare)?;
        signed.push(file);
    }
    let loader = read(&loader.elf)?;
    let image = read(&signed[0])?;
    let (end, how) = match board.form {
        Form::Uf2(_) => ("uf2", "copy it to the BOOTSEL drive"),
        Form::Probe => (
            "bin",
            "probe-rs download --chip STM32H743ZITx --binary-format bin --base-address 0x08000000",
        ),
    };
    let whole = folder.join(format!("{}-signed.{end}", board.name));
    let bytes = new_board(board, &loader, public, &image)?;
    fs::write(&whole, &bytes).with_context(|| format!("cannot write {}", whole.display()))?;
    [&whole, &signed[0], &signed[1]]
        .into_iter()
        .try_for_each(|file| sums(file))?;
    let mut rows = vec![["file", "bytes", "what to do with it"].map(String::from)];
    let for_updates = "for a board that runs the other one: umi update";
    let shown = [
        (&whole, format!("for a new board: {how}")),
        (&signed[0], for_updates.to_owned()),
        (&signed[1], for_updates.to_owned()),
    ];
    for (file, what) in shown {
        let short = file.strip_prefix(&workspace.root).unwrap_or(file);
        let bytes = fs::metadata(file)?.len();
        rows.push([short.display().to_string(), bytes.to_string(), what]);
    }
    console::rows(&rows);
    Ok(())
}

/// The public key beside a secret one: `umi key new` writes both.
pub(super) fn public_key(workspace: &Workspace, secret: &Path) -> Result<[u8; 32]> {
    let mut name = std::path::absolute(secret)?.into_os_string();
    name.push(".pub");
    let shown = output(umi(workspace).args(["key", "show", "--json"]).arg(&name))?;
    let shown: serde_json::Value = serde_json::from_str(&shown)?;
    let digits = shown["public"].as_str().unwrap_or_default();
    public(digits).with_context(|| format!("{} holds no public key", name.display()))
}

/// The tool that everybody uses: it knows keys and signs.
fn umi(workspace: &Workspace) -> Command {
    let mut command = workspace.cargo();
    command.args(["run", "--quiet", "--release", "--package", "umi", "--"]);
    command
}

/// A key of 64 hexadecimal digits.
fn public(digits: &str) -> Option<[u8; 32]> {
    let mut key = [0; 32];
    let pairs = digits.as_bytes().chunks_exact(2);
    if digits.len() != 2 * key.len() {
        return None;
    }
    for (byte, pair) in key.iter_mut().zip(pairs) {
        *byte = u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok()?;
    }
    Some(key)
}

/// What stands behind the header: to the vectors, and the code.
fn payload(elf: &[u8], place: u32, before_code: u32) -> Result<Vec<u8>> {
    let parts = load::parts(elf)?;
    let first = parts.iter().map(|part| part.address).min();
    ensure!(
        first == Some(place + before_code),
        "the image is not linked for its place"
    );
    let mut bytes = vec![0xFF; (before_code - HEADER) as usize];
    bytes.extend(load::flat(&parts));
    Ok(bytes)
}

/// Writes a payload as a signed image.
pub(super) fn sign(
    workspace: &Workspace,
    payload: &Path,
    board: &str,
    key: &Path,
    counter: u32,
    file: &Path,
) -> Result<()> {
    let mut command = umi(workspace);
    command
        .args(["image", "sign", "--force", "--board", board])
        .args(["--version", env!("CARGO_PKG_VERSION")])
        .args(["--counter", &counter.to_string(), "--key"])
        .arg(std::path::absolute(key)?)
        .arg("-o")
        .args([file, payload]);
    execute(&mut command)
}

/// The file for a new board: an image that was at its second place counts no more.
fn new_board(
    board: &SignedBoard,
    loader: &[u8],
    public: [u8; 32],
    image: &[u8],
) -> Result<Vec<u8>> {
    let mut parts = load::parts(loader)?;
    ensure!(
        parts
            .iter()
            .all(|part| part.address as usize + part.bytes.len() <= board.key as usize),
        "the boot loader is longer than its place"
    );
    let [a, b] = board.places;
    let part = |address, bytes| LoadPart { address, bytes };
    let no_image = vec![0xFF; board.sector as usize];
    let erased = board.erased.map(|(at, count)| (at, vec![0xFF; count]));
    parts.push(part(board.key, &public));
    if let Some((at, bytes)) = &erased {
        parts.push(part(*at, bytes));
    }
    parts.push(part(a, image));
    parts.push(part(b, &no_image));
    Ok(match board.form {
        Form::Uf2(family) => uf2::write(&parts, family),
        Form::Probe => flat(board.flash, &parts),
    })
}

/// The flash from its start to the last part, erased between the parts.
fn flat(from: u32, parts: &[LoadPart<'_>]) -> Vec<u8> {
    let mut flat = Vec::new();
    for part in parts {
        flat.resize((part.address - from) as usize, 0xFF);
        flat.extend_from_slice(part.bytes);
    }
    flat
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const BOARDS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../firmware/boards/");

    pub(in crate::tasks::firmware) fn text(board: &SignedBoard, file: &str) -> String {
        fs::read_to_string(Path::new(BOARDS).join(board.name).join(file)).unwrap()
    }

    /// A number as linker scripts and these sources write it: `0x100`, `976K`, `2_048`.
    pub(in crate::tasks::firmware) fn number(text: &str) -> u32 {
        let digits = text.trim().replace('_', "");
        let (digits, unit) = match digits.strip_suffix('K') {
            Some(digits) => (digits, 1024),
            None => (&digits[..], 1),
        };
        let value = match digits.strip_prefix("0x") {
            Some(digits) => u32::from_str_radix(digits, 16),
            None => digits.parse(),
        };
        value.unwrap_or_else(|_| panic!("a number: {text}")) * unit
    }

    /// Where a linker script puts a memory: from, length.
    pub(in crate::tasks::firmware) fn memory(
        board: &SignedBoard,
        file: &str,
        name: &str,
    ) -> (u32, u32) {
        let script = text(board, file);
        let start = format!("{name} : ORIGIN = ");
        let line = script.split_once(&start).unwrap().1.lines().next().unwrap();
        let (origin, length) = line.split_once(", LENGTH = ").unwrap();
        let origin = origin.split('+').map(number).sum();
        let (whole, less) = length.split_once('-').unwrap_or((length, "0"));
        let less = less.split('-').map(number).sum::<u32>();
        (origin, number(whole) - less)
    }

    /// The sectors of the places in the firmware's source, in the order in which it names them.
    pub(in crate::tasks::firmware) fn sectors(board: &SignedBoard, file: &str) -> Vec<u32> {
        let source = text(board, file);
        let lines = source.lines().map(str::trim);
        let sectors = lines.filter_map(|line| line.strip_prefix("sectors: ")?.strip_suffix(','));
        // A declaration names a type, no number.
        let numbers = sectors.filter(|of| of.starts_with(|first: char| first.is_ascii_digit()));
        numbers.map(number).collect()
    }

    /// The same places stand here, in the firmware and in its linker scripts: who moves one moves all.
    #[test]
    fn the_places_are_those_of_the_firmware_and_of_the_linker() {
        let kilobyte = 1024;
        // In the firmware: the loader, what counts, two images, one behind the other; then the board's key.
        let [loader, state, a, b] = sectors(&PICO, "src/storage/images.rs")[..] else {
            panic!("four places");
        };
        let sector = PICO.sector;
        let chip = text(&PICO, "src/storage/chip_flash.rs");
        assert!(chip.contains(&format!("SECTOR_BYTES: u32 = {sector};")));
        assert!(chip.contains("const CHIP_BYTES: usize = 2 * 1024 * 1024;"));
        let [key] = sectors(&PICO, "src/storage/chip_flash.rs")[..] else {
            panic!("one place");
        };
        let state_at = PICO.flash + loader * sector;
        assert_eq!(PICO.erased, Some((state_at, (state * sector) as usize)));
        assert_eq!(PICO.places[0], state_at + state * sector);
        let end = images_stand(&PICO, state_at, [a, b]);
        assert_eq!(end + key * sector, PICO.flash + 2048 * kilobyte);
        let boot2 = memory(&PICO, "link/flash-boot.x", "BOOT2");
        assert_eq!(boot2.0, PICO.flash);
        let (from, length) = memory(&PICO, "link/flash-rp2040.x", "FLASH");
        assert_eq!(from + length, end);
    }

    /// The same of the Nucleo, where the images stand behind the loader, and what counts beside the board's key.
    #[test]
    fn the_places_of_the_nucleo_are_those_of_the_firmware_and_of_the_linker() {
        let [loader, a, b] = sectors(&NUCLEO, "src/storage/images.rs")[..] else {
            panic!("three places");
        };
        let [kept] = sectors(&NUCLEO, "src/storage/chip_flash.rs")[..] else {
            panic!("one place");
        };
        let sector = NUCLEO.sector;
        let chip = text(&NUCLEO, "src/storage/chip_flash.rs");
        assert!(chip.contains(&format!("SECTOR_BYTES: u32 = {} * 1024;", sector / 1024)));
        assert_eq!(NUCLEO.places[0], NUCLEO.flash + loader * sector);
        let end = images_stand(&NUCLEO, NUCLEO.places[0], [a, b]);
        assert_eq!(end + kept * sector, NUCLEO.flash + 2 * 1024 * 1024);
        let (from, length) = memory(&NUCLEO, "flash-whole.x", "FLASH");
        assert_eq!((from, from + length), (NUCLEO.flash, end));
        // A table of vectors begins at a multiple of its length.
        assert!(
            NUCLEO
                .places
                .iter()
                .all(|at| (at + NUCLEO.before_code).is_multiple_of(1024))
        );
    }

    /// The images stand one behind the other, each behind its header, and the boot loader before them leaves the maker's
    /// key alone: where they end.
    fn images_stand(board: &SignedBoard, behind_loader: u32, sectors: [u32; 2]) -> u32 {
        let scripts = if board.name == PICO.name { "link/" } else { "" };
        let (from, length) = memory(board, &format!("{scripts}flash-boot.x"), "FLASH");
        assert_eq!(from + length, board.key);
        assert_eq!(board.key, behind_loader - 32);
        let [a, b] = sectors.map(|of| of * board.sector);
        assert_eq!(board.places[1], board.places[0] + a);
        let files = ["flash-slot-a.x", "flash-slot-b.x"];
        for ((file, place), bytes) in files.into_iter().zip(board.places).zip([a, b]) {
            let (from, length) = memory(board, &format!("{scripts}{file}"), "FLASH");
            assert_eq!(from, place + board.before_code, "{file}");
            assert_eq!(from + length, place + bytes, "{file}");
        }
        let images = text(board, "src/storage/images.rs");
        assert!(images.contains(&format!("const VECTORS: u32 = {};", board.before_code)));
        let update = text(board, "../../../protocol/src/update.rs");
        assert!(update.contains(&format!("const IMAGE_HEADER: usize = {HEADER};")));
        for (name, place) in board.images[1..].iter().zip(["a", "b"]) {
            assert_eq!(*name, format!("{}-{place}", board.name));
            assert!(images.contains(&format!("\"{name}\"")));
        }
        board.places[1] + b
    }

    /// Between the parts of a flat file the flash is erased.
    #[test]
    fn a_flat_file_is_erased_between_its_parts() {
        let part = |address, bytes| LoadPart { address, bytes };
        let parts = [part(0x101, &[1, 2][..]), part(0x106, &[3])];
        let flat = flat(0x100, &parts);
        assert_eq!(flat, [0xFF, 1, 2, 0xFF, 0xFF, 0xFF, 3]);
    }

    /// Without a name it is the Pico; of the others only those with a boot loader are found.
    #[test]
    fn boards_with_a_boot_loader() {
        let named = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
            find(&names).map(|board| board.name).ok()
        };
        assert_eq!(named(&[]), Some("pico"));
        assert_eq!(named(&["nucleo-h743"]), Some("nucleo-h743"));
        assert_eq!(named(&["pico2"]), None);
        assert_eq!(named(&["pico", "nucleo-h743"]), None);
    }

    /// A key is 32 bytes, and nothing else.
    #[test]
    fn a_public_key_is_64_digits() {
        let digits = "0f".repeat(32);
        assert_eq!(public(&digits), Some([0x0F; 32]));
        assert_eq!(public(&digits[1..]), None);
        assert_eq!(public(""), None);
    }
}
