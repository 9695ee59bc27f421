//! A Pico that takes only what its maker has signed: boot loader, key and images in the forms that people use.
//!
//! ```text
//! pico-signed.uf2   for a new board, to its BOOTSEL drive: boot loader with the maker's key, image A, nothing else
//! pico-a.umif       the images for `umi update`, each for the place that it is linked for
//! pico-b.umif
//! ```
//!
//! Where the parts stand is drawn in `firmware/boards/pico/src/storage/chip_flash.rs`.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use imagecheck::load::{self, LoadPart};

use super::toolchain::Toolchain;
use super::{Built, boards, build, folder, read, sums, toolchain, uf2};
use crate::console;
use crate::workspace::{Workspace, execute, output};

const FLASH: u32 = 0x1000_0000;
/// The boot loader's last bytes.
const KEY: u32 = FLASH + 0x1_0000 - 32;
/// Which image counts: erased on a new board.
const STATE: u32 = FLASH + 0x1_0000;
const STATE_BYTES: usize = 0x4000;
/// The images' places.
const PLACES: [u32; 2] = [FLASH + 0x1_4000, FLASH + 0x10_8000];
const SECTOR: usize = 4096;
/// Bytes of a header, and of what comes before the code.
const HEADER: u32 = 192;
const BEFORE_CODE: u32 = 256;

/// Builds, signs and writes them.
pub fn run(
    workspace: &Workspace,
    key: &Path,
    counter: u32,
    asked: Option<Toolchain>,
) -> Result<()> {
    let public = public_key(workspace, key)?;
    let names = ["pico-boot", "pico-a", "pico-b"].map(boards::find);
    let boards = names.into_iter().collect::<Result<Vec<_>>>()?;
    let Built { images, .. } = build(workspace, &boards, asked)?;
    let folder = folder(workspace, toolchain::choose(workspace, asked)?);
    let [loader, images @ ..] = &images[..] else {
        anyhow::bail!("nothing was built");
    };
    let mut signed = Vec::new();
    for (image, place) in images.iter().zip(PLACES) {
        let payload = payload(&read(&image.elf)?, place)?;
        let bare = image.elf.with_extension("payload");
        fs::write(&bare, payload).with_context(|| format!("cannot write {}", bare.display()))?;
        let file = image.elf.with_extension("umif");
        sign(workspace, &bare, image.board.name, key, counter, &file)?;
        fs::remove_file(&bare)?;
        signed.push(file);
    }
    let loader = read(&loader.elf)?;
    let image = read(&signed[0])?;
    let whole = folder.join("pico-signed.uf2");
    let bytes = new_board(&loader, public, &image)?;
    fs::write(&whole, &bytes).with_context(|| format!("cannot write {}", whole.display()))?;
    [&whole, &signed[0], &signed[1]]
        .into_iter()
        .try_for_each(|file| sums(file))?;
    let mut rows = vec![["file", "bytes", "what to do with it"].map(String::from)];
    let for_updates = "for a board that runs the other one: umi update";
    let shown = [
        (&whole, "for a new board: copy it to the BOOTSEL drive"),
        (&signed[0], for_updates),
        (&signed[1], for_updates),
    ];
    for (file, what) in shown {
        let short = file.strip_prefix(&workspace.root).unwrap_or(file);
        let bytes = fs::metadata(file)?.len();
        rows.push([
            short.display().to_string(),
            bytes.to_string(),
            what.to_owned(),
        ]);
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
fn payload(elf: &[u8], place: u32) -> Result<Vec<u8>> {
    let parts = load::parts(elf)?;
    let first = parts.iter().map(|part| part.address).min();
    ensure!(
        first == Some(place + BEFORE_CODE),
        "the image is not linked for its place"
    );
    let mut bytes = vec![0xFF; (BEFORE_CODE - HEADER) as usize];
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

/// The file for a new board: what was there of images before counts no more.
fn new_board(loader: &[u8], public: [u8; 32], image: &[u8]) -> Result<Vec<u8>> {
    let erased = [0xFF; STATE_BYTES];
    let mut parts = load::parts(loader)?;
    ensure!(
        parts
            .iter()
            .all(|part| part.address as usize + part.bytes.len() <= KEY as usize),
        "the boot loader is longer than its place"
    );
    let part = |address, bytes| LoadPart { address, bytes };
    parts.push(part(KEY, &public));
    parts.push(part(STATE, &erased));
    parts.push(part(PLACES[0], image));
    parts.push(part(PLACES[1], &erased[..SECTOR]));
    Ok(uf2::write(&parts, uf2::Family::Rp2040))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const BOARD: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../firmware/boards/pico/");

    pub(in crate::tasks::firmware) fn text(file: &str) -> String {
        fs::read_to_string(Path::new(BOARD).join(file)).unwrap()
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
    pub(in crate::tasks::firmware) fn memory(file: &str, name: &str) -> (u32, u32) {
        let script = text(file);
        let start = format!("{name} : ORIGIN = ");
        let line = script.split_once(&start).unwrap().1.lines().next().unwrap();
        let (origin, length) = line.split_once(", LENGTH = ").unwrap();
        let origin = origin.split('+').map(number).sum();
        let (whole, less) = length.split_once('-').unwrap_or((length, "0"));
        let less = less.split('-').map(number).sum::<u32>();
        (origin, number(whole) - less)
    }

    /// The sectors of the places in the firmware's source, in the order in which it names them.
    pub(in crate::tasks::firmware) fn sectors(file: &str) -> Vec<u32> {
        let source = text(file);
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
        let [loader, state, a, b] = sectors("src/storage/images.rs")[..] else {
            panic!("four places");
        };
        let sector = SECTOR as u32;
        let chip = text("src/storage/chip_flash.rs");
        assert!(chip.contains(&format!("SECTOR_BYTES: u32 = {SECTOR};")));
        assert!(chip.contains("const CHIP_BYTES: usize = 2 * 1024 * 1024;"));
        let [key] = sectors("src/storage/chip_flash.rs")[..] else {
            panic!("one place");
        };
        assert_eq!(FLASH + loader * sector, STATE);
        assert_eq!(KEY, STATE - 32);
        assert_eq!(STATE_BYTES as u32, state * sector);
        assert_eq!(PLACES[0], STATE + state * sector);
        assert_eq!(PLACES[1], PLACES[0] + a * sector);
        let end = PLACES[1] + b * sector;
        assert_eq!(end + key * sector, FLASH + 2048 * kilobyte);

        // For the linker: a boot loader that leaves the key alone, images behind their headers, and nobody in the
        // place of the board's key.
        let boot2 = memory("link/flash-boot.x", "BOOT2");
        let (from, length) = memory("link/flash-boot.x", "FLASH");
        assert_eq!((boot2.0, from + length), (FLASH, KEY));
        for (file, place, sectors) in [
            ("link/flash-slot-a.x", PLACES[0], a),
            ("link/flash-slot-b.x", PLACES[1], b),
        ] {
            let (from, length) = memory(file, "FLASH");
            assert_eq!(from, place + BEFORE_CODE, "{file}");
            assert_eq!(from + length, place + sectors * sector, "{file}");
        }
        let (from, length) = memory("link/flash-rp2040.x", "FLASH");
        assert_eq!(from + length, end);
        assert!(
            text("src/storage/images.rs").contains(&format!("const VECTORS: u32 = {BEFORE_CODE};"))
        );
        let update = text("../../../protocol/src/update.rs");
        assert!(update.contains(&format!("const IMAGE_HEADER: usize = {HEADER};")));
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
