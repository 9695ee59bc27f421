//! What a board finds in its flash at a start: keys, the board's own key, slots of images, the
//! journal and the store of programs, in cells of any content. The first byte says which; those
//! behind it are the cells, or changes to cells that a board has written. Held against what its
//! owner relies on:
//!
//! * no panic, and what was opened can be written and read again;
//! * one byte that was changed never opens a board that has an owner;
//! * no image runs but the one that the maker has signed;
//! * an entry or a program that is read is as its check value says.

use std::sync::OnceLock;

use crate::board::{Memory, signer};
use crc::{CRC_32_ISO_HDLC, Crc};
use ed25519_dalek::SigningKey;
use umi_app::access::{Caller, Jumper, Keeper};
use umi_client::files::image_file;
use umi_core::journal::{Journal, MAX_PAYLOAD};
use umi_core::programs::Store;
use umi_core::trust::access::update::image::ImageHeader;
use umi_core::trust::access::update::slots::{ImageKind, Maker, Slots};
use umi_core::trust::board_key::{BoardKey, NoEntropy};
use umi_core::units::Micros;
use umi_protocol::access::{AccessMode, KeyInfo, KeyName, Role};
use umi_protocol::job::name;
use umi_protocol::message::Request;
use umi_protocol::program::{ProgramInfo, Release, Stated};
use umi_protocol::update::{IMAGE_HEADER, ImagePlace};

/// One input.
pub fn one(data: &[u8]) {
    let Some((view, data)) = data.split_first() else {
        return;
    };
    match view % 8 {
        0 => keys(&Memory::of(filled(data), SECTOR)),
        1 => keys_changed(data),
        2 => own_key(data),
        3 => header(data),
        4 => slots(data),
        5 => journal(data),
        _ => programs(data),
    }
}

const SECTOR: u32 = 4096;
const SECTORS: u16 = 4;

/// Cells of a whole area that begin so. What is not said is erased.
fn filled(data: &[u8]) -> Vec<u8> {
    let mut cells = data.to_vec();
    cells.resize(usize::from(SECTORS) * SECTOR as usize, 0xFF);
    cells
}

/// Cells with changes: where, u16, and what is exchanged in them.
fn changed(mut cells: Vec<u8>, changes: &[u8], most: usize) -> Vec<u8> {
    for change in changes.chunks_exact(3).take(most) {
        let at = usize::from(u16::from_le_bytes([change[0], change[1]])) % cells.len();
        cells[at] ^= change[2];
    }
    cells
}

fn secret() -> &'static SigningKey {
    static KEY: OnceLock<SigningKey> = OnceLock::new();
    KEY.get_or_init(|| SigningKey::from_bytes(&[5; 32]))
}

fn public() -> [u8; 32] {
    secret().verifying_key().to_bytes()
}

fn no_draw(_: &mut [u8; 32]) -> Result<(), NoEntropy> {
    Err(NoEntropy)
}

/// Of keepers: the number of a board's life.
fn draw(into: &mut [u8; 32]) -> Result<(), NoEntropy> {
    into.fill(7);
    Ok(())
}

fn keeper(memory: &Memory, is_closed: bool) -> Keeper<Memory> {
    let jumper: Jumper = if is_closed { || true } else { || false };
    Keeper::open(memory.clone(), jumper, signer(), draw, Micros(0))
}

fn owner() -> KeyInfo {
    KeyInfo {
        public: public(),
        role: Role::Owner,
        name: KeyName::new(),
    }
}

/// Whatever it is: it opens, and the next start finds the same.
fn keys(memory: &Memory) {
    let found = keeper(memory, false).register().clone();
    assert_eq!(keeper(memory, false).register().mode(), found.mode());
}

/// One byte of a claimed board.
fn keys_changed(changes: &[u8]) {
    static CLAIMED: OnceLock<Vec<u8>> = OnceLock::new();
    let claim = || {
        let memory = Memory::erased(SECTORS, SECTOR);
        let claims = Request::KeyEnrol(owner());
        let mut keeper = keeper(&memory, true);
        let done = keeper.change(Micros(0), &claims, &Caller::NOBODY, |_, _| true);
        assert_eq!(done, Ok(true));
        memory.cells()
    };
    let cells = changed(CLAIMED.get_or_init(claim).clone(), changes, 1);
    let memory = Memory::of(cells, SECTOR);
    let keeper = keeper(&memory, true);
    let keys = keeper.register().keys();
    assert_ne!(keeper.register().mode(), AccessMode::Open);
    assert!(keys.is_empty() || keys[..] == [owner()]);
}

/// A key of any content signs nothing that is not its own; an erased area without entropy has none.
fn own_key(data: &[u8]) {
    let memory = Memory::of(filled(data), SECTOR);
    if let Ok(key) = BoardKey::open(memory.clone(), no_draw) {
        let again = BoardKey::open(memory, no_draw).expect("it was kept");
        assert_eq!(again.public(), key.public());
        assert_eq!(again.boot(), key.boot().saturating_add(1));
    }
}

/// A header is read, or it is none; what is read is written again as it was.
fn header(data: &[u8]) {
    let mut bytes = image()[..IMAGE_HEADER].try_into().expect("a header");
    let is_changed = match data.first_chunk::<IMAGE_HEADER>() {
        Some(whole) => {
            bytes = *whole;
            true
        }
        None => {
            let made = changed(bytes.to_vec(), data, 4);
            let is_changed = made[..] != bytes[..];
            bytes.copy_from_slice(&made);
            is_changed
        }
    };
    if let Ok((header, signature)) = ImageHeader::read(&bytes) {
        assert_eq!(header.encode(signature), bytes);
        assert_eq!(
            header.is_signed(signature, &public()),
            !is_changed || bytes[..] == image()[..IMAGE_HEADER]
        );
    }
}

/// A signed image.
fn image() -> &'static [u8] {
    static IMAGE: OnceLock<Vec<u8>> = OnceLock::new();
    IMAGE.get_or_init(|| {
        let signed = image_file::sign(&[7; 300], "fuzz", [1, 2, 3], 4, secret());
        signed.unwrap_or_else(|_| panic!("it is short")).1
    })
}

/// Two slots and their state after an update, changed: what runs is the image, or what is built in.
fn slots(data: &[u8]) {
    const KIND: ImageKind = ImageKind {
        boards: ["fuzz"; 2],
        built_in: Some([1, 0, 0]),
    };
    static UPDATED: OnceLock<[Vec<u8>; 3]> = OnceLock::new();
    let open = |areas: &[Memory; 3]| {
        let [state, a, b] = areas.clone();
        Slots::open(state, [a, b], KIND, Maker::First(Some(public())))
    };
    let updated = || {
        let areas = [0; 3].map(|_| Memory::erased(2, SECTOR));
        let mut slots = open(&areas).expect("it is new");
        slots.start().expect("nothing is there");
        let (header, payload) = image().split_first_chunk().expect("an image");
        slots.begin(header).expect("it is right");
        slots.piece(0, payload).expect("it fits");
        slots.whole().expect("it is whole");
        slots.mark().expect("it is kept");
        let mut slots = open(&areas).expect("it was kept");
        slots.start().expect("it is on trial");
        slots.confirm().expect("it works");
        areas.map(|area| area.cells())
    };
    let (which, changes) = data.split_first().unwrap_or((&0, data));
    let mut areas = UPDATED.get_or_init(updated).clone();
    let area = &mut areas[usize::from(which % 3)];
    *area = match which & 0x80 {
        0 => changed(std::mem::take(area), changes, 8),
        _ => {
            let mut cells = changes.to_vec();
            cells.resize(area.len(), 0xFF);
            cells
        }
    };
    let areas = areas.map(|cells| Memory::of(cells, SECTOR));
    let Ok(mut slots) = open(&areas) else {
        return;
    };
    if let Ok(started) = slots.start() {
        let mut room = [0; 400];
        let runs = slots.payload(&mut room).map(<[u8]>::to_vec);
        match started.place {
            ImagePlace::BuiltIn => assert_eq!(runs, None),
            _ => assert_eq!(runs.as_deref(), Some(&image()[IMAGE_HEADER..])),
        }
        let _ = slots.confirm();
    }
}

/// What is opened has its entries, takes another, and has that at the next start.
fn journal(data: &[u8]) {
    let memory = Memory::of(filled(data), SECTOR);
    let Ok((mut journal, _)) = Journal::open(memory.clone()) else {
        return;
    };
    let mut room = [0; MAX_PAYLOAD];
    for seq in (journal.first_seq()..journal.next_seq()).take(64) {
        let _ = journal.read(seq, &mut room);
    }
    let Ok(seq) = journal.append(1, Micros(9), b"more") else {
        return;
    };
    let (mut again, _) = Journal::open(memory).expect("it was one before");
    let read = again.read(seq, &mut room).expect("it was kept");
    assert_eq!(
        (read.entry.payload, again.next_seq()),
        (&b"more"[..], seq + 1)
    );
}

/// Programs that are there can be read to their end; one that is put is there at the next start.
fn programs(data: &[u8]) {
    static KEPT: OnceLock<Vec<u8>> = OnceLock::new();
    let kept = || {
        let memory = Memory::erased(SECTORS, SECTOR);
        let mut store = Store::open(memory.clone()).expect("it is new");
        put(&mut store, 7, &[b'G'; 5000]);
        memory.cells()
    };
    let (how, data) = data.split_first().unwrap_or((&0, data));
    let cells = match how % 2 {
        0 => filled(data),
        _ => changed(KEPT.get_or_init(kept).clone(), data, 8),
    };
    let memory = Memory::of(cells, SECTOR);
    let Ok(mut store) = Store::open(memory.clone()) else {
        return;
    };
    let found: Vec<_> = store.programs().to_vec();
    let area = u32::from(SECTORS) * SECTOR;
    for program in &found {
        assert!(program.bytes < area);
        let _ = store.check_value(program).expect("it lies in the area");
        let _ = store.info(program);
    }
    let room = store.room();
    if room.longest_bytes >= 100 && usize::from(room.programs) < usize::from(room.most_programs) {
        put(&mut store, 9, &[b'X'; 100]);
        let again = Store::open(memory).expect("it was one before");
        assert!(again.find(9).is_some());
    }
}

fn put(store: &mut Store<Memory>, number: u32, text: &[u8]) {
    let crc32 = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(text);
    let program = ProgramInfo {
        number,
        name: name("fuzz"),
        bytes: u32::try_from(text.len()).expect("it is short"),
        crc32,
        release: Release::Always,
        hold_s: 5,
        stated: Stated::default(),
    };
    let mut at = store.begin(&program).expect("there is room");
    while at < program.bytes {
        let from = at as usize;
        let end = text.len().min(from + 200);
        at = store.piece(at, &text[from..end]).expect("it is kept");
    }
    assert!(store.end(number, crc32).is_ok());
}
