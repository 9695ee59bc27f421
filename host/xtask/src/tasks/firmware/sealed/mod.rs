//! A Pico 2 that takes only what its maker has signed: its boot ROM chooses between two places by itself.
//!
//! ```text
//! pico2-signed.uf2   for a new board, to its BOOTSEL drive: partition table, image A, nothing else
//! pico2.umif         the image for `umi update`, for either place
//! pico2-otp.json     the fuses that make the ROM ask for the seal, and pico2-otp.txt, what each of them does
//! ```
//!
//! An image has two signatures: the maker's (Ed25519), which the firmware verifies, is around the ROM's seal (secp256k1).
//! Where the parts stand is drawn in `firmware/boards/pico/src/storage/ab_images.rs`:
//!
//! ```text
//!   0   192  header of the `.umif`
//! 192   236  the ROM's seal; the mark of a trial is in it
//! 428    52  erased
//! 480    32  the maker's key
//! 512        vectors and code, from 0x1000_0200 on wherever it stands
//! ```
//!
//! # Limitations
//!
//! No chip has read any of it.

mod block;
mod boot_key;
mod fuses;

use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result, ensure};
use imagecheck::load::{self, LoadPart};
use k256::ecdsa::SigningKey;

use super::toolchain::{self, Toolchain};
use super::{Built, boards, build, folder, read, signed, uf2};
use crate::console;
use crate::workspace::Workspace;

const FLASH: u32 = 0x1000_0000;
const SECTOR: u32 = 4096;
/// The partition table, and where the ROM looks for a second one.
const TABLES: Place = Place {
    from: 0,
    sectors: 2,
};
/// Which image counts: erased on a new board.
const STATE: Place = Place {
    from: TABLES.end(),
    sectors: 4,
};
/// The images.
const PLACES: [Place; 2] = [
    Place {
        from: STATE.end(),
        sectors: 507,
    },
    Place {
        from: STATE.end() + 507 * SECTOR,
        sectors: 507,
    },
];

/// Bytes of a header.
const HEADER: usize = 192;
/// Where the seal ends: what follows is covered by it.
const COVERED: usize = HEADER + block::IMAGE_BLOCK;
/// Where the maker's key stands, and where the code begins.
const MAKER: usize = CODE - 32;
const CODE: usize = 512;
/// The byte with the mark of a trial.
const TRIAL_MARK: (usize, u8) = (HEADER + 7, 0x80);

/// Whom images are for, as their header says it.
const BOARD: &str = "pico2";

/// A part of the flash.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// From the start of the flash.
    from: u32,
    sectors: u32,
}

impl Place {
    const fn end(self) -> u32 {
        self.from + self.sectors * SECTOR
    }

    fn first_sector(self) -> u32 {
        self.from / SECTOR
    }

    fn last_sector(self) -> u32 {
        self.first_sector() + self.sectors - 1
    }
}

/// Of an image.
#[derive(Debug, Clone, Copy)]
struct Version([u16; 3]);

impl Version {
    fn read(text: &str) -> Result<Self> {
        let mut parts = text.split('.').map(str::parse);
        let mut next = || parts.next()?.ok();
        let version = (|| Some([next()?, next()?, next()?]))();
        let version = version.with_context(|| format!("no version of three numbers: {text}"))?;
        ensure!(
            version[1] < 256 && version[2] < 256,
            "the boot ROM compares two numbers of 16 bits: in {text} the second and the third may be 255 at most"
        );
        Ok(Self(version))
    }

    /// The ROM has two numbers of 16 bits: the second one is here two of eight.
    fn for_the_rom(self) -> u32 {
        let [major, minor, patch] = self.0.map(u32::from);
        major << 16 | minor << 8 | patch
    }
}

/// Builds, seals, signs and writes them.
pub fn run(
    workspace: &Workspace,
    maker: &Path,
    counter: u32,
    asked: Option<Toolchain>,
) -> Result<()> {
    ensure!(
        (1..=block::MOST_COUNTER).contains(&counter),
        "the fuses of a Pico 2 hold a counter from 1 to {}",
        block::MOST_COUNTER
    );
    let public = signed::public_key(workspace, maker)?;
    let key = boot_key::read_or_make(maker)?;
    let version = Version::read(env!("CARGO_PKG_VERSION"))?;
    let Built { images, .. } = build(workspace, &[boards::find("pico2-ab")?], asked)?;
    let folder = folder(workspace, toolchain::choose(workspace, asked)?);
    let image = images.first().context("nothing was built")?;

    let bare = folder.join("pico2.payload");
    let umif = folder.join("pico2.umif");
    let payload = payload(
        &load::parts(&read(&image.elf)?)?,
        version,
        counter,
        public,
        &key,
    )?;
    fs::write(&bare, payload).with_context(|| format!("cannot write {}", bare.display()))?;
    signed::sign(workspace, &bare, BOARD, maker, counter, &umif)?;
    fs::remove_file(&bare)?;

    let settings = serde_json::to_string_pretty(&fuses::settings(&key))? + "\n";
    let files = [
        (
            "pico2-signed.uf2",
            new_board(&read(&umif)?, &key)?,
            "for a new board: copy it to the BOOTSEL drive",
        ),
        (
            "pico2-otp.json",
            settings.into_bytes(),
            "fuses: read the next file before",
        ),
        (
            "pico2-otp.txt",
            fuses::IN_WORDS.into(),
            "what each fuse does; nothing here burns one",
        ),
    ];
    let mut rows = vec![["file", "bytes", "what to do with it"].map(String::from)];
    let mut show = |file: &Path, bytes: u64, what: &str| {
        let short = file.strip_prefix(&workspace.root).unwrap_or(file);
        rows.push([
            short.display().to_string(),
            bytes.to_string(),
            what.to_owned(),
        ]);
    };
    show(
        &umif,
        fs::metadata(&umif)?.len(),
        "for a board that runs one: umi update",
    );
    for (name, bytes, what) in files {
        let file = folder.join(name);
        fs::write(&file, &bytes).with_context(|| format!("cannot write {}", file.display()))?;
        show(&file, bytes.len() as u64, what);
    }
    console::rows(&rows);
    Ok(())
}

/// What stands behind the header: the seal, the maker's key, and the code.
fn payload(
    parts: &[LoadPart<'_>],
    version: Version,
    counter: u32,
    maker: [u8; 32],
    key: &SigningKey,
) -> Result<Vec<u8>> {
    let first = parts.iter().map(|part| part.address).min();
    ensure!(
        first == Some(FLASH + CODE as u32),
        "the image is not linked for its place"
    );
    let mut covered = vec![0xFF; MAKER - COVERED];
    covered.extend(maker);
    covered.extend(load::flat(parts));
    // The ROM hashes words.
    covered.resize(covered.len().next_multiple_of(4), 0xFF);
    ensure!(
        COVERED + covered.len() < (PLACES[0].sectors * SECTOR) as usize,
        "the image is longer than its place"
    );
    let from = FLASH + COVERED as u32;
    let vectors = FLASH + CODE as u32;
    let mut payload = block::image(&covered, from, vectors, version, counter, key);
    payload.extend(covered);
    Ok(payload)
}

/// The file for a new board: what was there of images before counts no more.
fn new_board(image: &[u8], key: &SigningKey) -> Result<Vec<u8>> {
    let mut table = block::partition_table(PLACES, key);
    table.resize((TABLES.sectors * SECTOR) as usize, 0xFF);
    let erased = vec![0xFF; (STATE.sectors * SECTOR) as usize];
    // The first image is nobody's trial.
    let mut image = image.to_vec();
    let (at, mark) = TRIAL_MARK;
    *image.get_mut(at).context("no image")? &= !mark;
    let part = |place: Place, bytes| LoadPart {
        address: FLASH + place.from,
        bytes,
    };
    let [a, b] = PLACES;
    let parts = [
        part(TABLES, &table),
        part(STATE, &erased),
        part(a, &image),
        part(b, &erased[..SECTOR as usize]),
    ];
    Ok(uf2::write(&parts, uf2::Family::Absolute))
}

#[cfg(test)]
mod tests;
