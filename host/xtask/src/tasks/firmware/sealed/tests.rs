//! What is written is read by another reader, which was written from the data sheet, with arithmetic of its own.

use super::*;
use num_bigint::BigUint;
use sha2::{Digest as _, Sha256};

use crate::tasks::firmware::signed::PICO;
use crate::tasks::firmware::signed::tests::{memory, number, sectors, text};

/// A key, the same for all tests.
fn key() -> SigningKey {
    SigningKey::from_slice(&[7; 32]).unwrap()
}

const VERSION: Version = Version([1, 2, 3]);
const CODE_BYTES: usize = 701;

/// A place with an image in it: header, seal, and code that is not a whole number of words.
fn place() -> Vec<u8> {
    let code: Vec<u8> = (0..CODE_BYTES).map(|at| (at * 5) as u8).collect();
    let parts = [LoadPart {
        address: FLASH + CODE as u32,
        bytes: &code,
    }];
    let mut place = vec![0x55; HEADER];
    place.extend(payload(&parts, VERSION, 9, [0xA5; 32], &key()).unwrap());
    place
}

/// What a reader finds in a block.
#[derive(Debug, PartialEq, Eq)]
struct Found {
    at: usize,
    /// Kind and content of each item.
    items: Vec<(u8, Vec<u32>)>,
}

impl Found {
    fn item(&self, kind: u8) -> &[u32] {
        let found: Vec<_> = self.items.iter().filter(|(of, _)| *of == kind).collect();
        let [(_, words)] = found[..] else {
            panic!("one item {kind:#x}: {found:x?}")
        };
        words
    }
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

/// The only block in the first 4 KB: its loop goes back to itself at once.
fn only_block(bytes: &[u8]) -> Option<Found> {
    let at = (0..4096)
        .step_by(4)
        .find(|at| word(bytes, *at) == Some(0xFFFF_DED3))?;
    let mut items = Vec::new();
    let mut next = at + 4;
    loop {
        let head = word(bytes, next)?;
        let [kind, low, high, _] = head.to_le_bytes();
        // A kind with the highest bit has a length of two bytes.
        let count = match kind >> 7 {
            0 => usize::from(low),
            _ => usize::from(low) | usize::from(high) << 8,
        };
        if kind == 0xFF {
            let is_whole = count * 4 == next - at - 4 && head >> 24 == 0;
            let ends = word(bytes, next + 4)? == 0 && word(bytes, next + 8)? == 0xAB12_3579;
            return (is_whole && ends).then_some(Found { at, items });
        }
        let words: Option<Vec<u32>> = (0..count).map(|n| word(bytes, next + 4 * n)).collect();
        items.push((kind, words.filter(|words| !words.is_empty())?));
        next += 4 * count;
    }
}

/// Whether the ROM would start the image in this place with these fuses; the way it asks for a signature, and without.
fn verified(place: &[u8], key_hash: &[u8]) -> Option<()> {
    let block = only_block(place)?;
    let hashed = hash(place, &block)?;
    let (digest, public, signature) = seal_of(&block)?;
    (digest == hashed && Sha256::digest(&public).as_slice() == key_hash).then_some(())?;
    let key = k256::ecdsa::VerifyingKey::from_sec1_bytes(&[&[4], &public[..]].concat()).ok()?;
    let signature = k256::ecdsa::Signature::from_slice(&signature).ok()?;
    let verified =
        k256::ecdsa::signature::hazmat::PrehashVerifier::verify_prehash(&key, &hashed, &signature);
    verified.ok()
}

/// The hash over what the load map names, if there is one, and the block up to the end of the item that says so.
fn hash(place: &[u8], block: &Found) -> Option<Vec<u8>> {
    let mut hash = Sha256::new();
    let has = |kind| block.items.iter().filter(|(of, _)| *of == kind).count();
    if has(0x06) == 1 {
        let [head, storage, runtime, end] = *block.item(0x06) else {
            return None;
        };
        // One entry, by whole addresses, where it stands.
        (head == 0x8100_0406 && storage == runtime).then_some(())?;
        let at = |address: u32| address.checked_sub(FLASH).map(|at| at as usize);
        hash.update(place.get(at(storage)?..at(end)?)?);
    }
    (has(0x47) == 1).then_some(())?;
    let [0x0100_0247, count] = *block.item(0x47) else {
        return None;
    };
    let until = block.at + 4 * count as usize;
    let mut words = place.get(block.at..until)?.to_vec();
    if words[4] == 0x42 {
        words[7] &= 0x7F;
    }
    // All but the seal is in it.
    let said = block.items.iter().take_while(|(kind, _)| *kind != 0x09);
    let said: usize = said.map(|(_, words)| words.len()).sum();
    (1 + said == count as usize).then_some(())?;
    Some(hash.chain_update(words).finalize().to_vec())
}

/// Hash, public key and signature.
fn seal_of(block: &Found) -> Option<(Vec<u8>, Vec<u8>, Vec<u8>)> {
    let bytes =
        |words: &[u32]| -> Vec<u8> { words.iter().flat_map(|of| of.to_le_bytes()).collect() };
    let [.., (0x09, signature), (0x4B, digest)] = &block.items[..] else {
        return None;
    };
    let is_right = (signature[0], digest[0]) == (0x0100_2109, 0x0000_094B);
    is_right.then(|| {
        (
            bytes(&digest[1..]),
            bytes(&signature[1..17]),
            bytes(&signature[17..]),
        )
    })
}

/// secp256k1 as SEC 2 has it (2.4.1), and verification as SEC 1 has it (4.1.4).
mod curve {
    use num_bigint::BigUint;

    type Point = Option<(BigUint, BigUint)>;

    fn number(digits: &str) -> BigUint {
        BigUint::parse_bytes(digits.as_bytes(), 16).unwrap()
    }

    fn p() -> BigUint {
        number("FFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFEFFFFFC2F")
    }

    fn n() -> BigUint {
        number("FFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFEBAAEDCE6AF48A03BBFD25E8CD0364141")
    }

    fn inverse(of: &BigUint, modulus: &BigUint) -> BigUint {
        of.modpow(&(modulus - 2_u32), modulus)
    }

    fn add(a: &Point, b: &Point) -> Point {
        let p = p();
        let (Some((ax, ay)), Some((bx, by))) = (a, b) else {
            return a.clone().or_else(|| b.clone());
        };
        let slope = if ax != bx {
            (by + &p - ay) * inverse(&((bx + &p - ax) % &p), &p)
        } else if ay == by {
            ax * ax * 3_u32 * inverse(&(ay * 2_u32 % &p), &p)
        } else {
            return None;
        };
        let slope = slope % &p;
        let x = (&slope * &slope + &p + &p - ax - bx) % &p;
        let y = (slope * (ax + &p - &x) + &p - ay) % &p;
        Some((x, y))
    }

    fn times(point: &Point, by: &BigUint) -> Point {
        let bits = (0..by.bits()).rev();
        bits.fold(None, |sum, bit| {
            let sum = add(&sum, &sum);
            if by.bit(bit) { add(&sum, point) } else { sum }
        })
    }

    /// Whether this key has signed this hash; all big-endian.
    pub fn is_signed(public: &[u8], hash: &[u8], signature: &[u8]) -> bool {
        let (p, n) = (p(), n());
        let number_of = BigUint::from_bytes_be;
        let (x, y) = (number_of(&public[..32]), number_of(&public[32..]));
        let (r, s) = (number_of(&signature[..32]), number_of(&signature[32..]));
        let zero = BigUint::default();
        let is_on_it = &y * &y % &p == (&x * &x * &x + 7_u32) % &p;
        if !is_on_it || r == zero || s == zero || r >= n || s >= n {
            return false;
        }
        let base = Some((
            number("79BE667EF9DCBBAC55A06295CE870B07029BFCDB2DCE28D959F2815B16F81798"),
            number("483ADA7726A3C4655DA4FBFC0E1108A8FD17B448A68554199C47D08FFB10D4B8"),
        ));
        let w = inverse(&s, &n);
        let hash = number_of(hash);
        let sum = add(
            &times(&base, &(hash * &w % &n)),
            &times(&Some((x, y)), &(&r * w % &n)),
        );
        sum.is_some_and(|(x, _)| x % n == r)
    }
}

/// The other reader's arithmetic is right: a vector that others publish (Bitcoin's of RFC 6979: key 1, "Satoshi Nakamoto").
#[test]
fn the_reader_knows_a_published_signature() {
    let hex = |digits: &str| {
        BigUint::parse_bytes(digits.as_bytes(), 16)
            .unwrap()
            .to_bytes_be()
    };
    let public = hex(
        "79BE667EF9DCBBAC55A06295CE870B07029BFCDB2DCE28D959F2815B16F81798\
         483ADA7726A3C4655DA4FBFC0E1108A8FD17B448A68554199C47D08FFB10D4B8",
    );
    let signature = hex(
        "934B1EA10A4B3C1757E2B0C017D0B6143CE3C9A7E6A4A49860D7A6AB210EE3D8\
         2442CE9D2B916064108014783E923EC36B49743E2FFA1C4496F01A512AAFD9E5",
    );
    let hash = Sha256::digest("Satoshi Nakamoto");
    assert!(curve::is_signed(&public, &hash, &signature));
    assert!(!curve::is_signed(
        &public,
        &Sha256::digest("Satoshi"),
        &signature
    ));
}

/// The image's block says what the ROM has to know, and its seal is right by both readers.
#[test]
fn the_seal_of_an_image_is_right() {
    let place = place();
    let block = only_block(&place).unwrap();
    assert_eq!(block.at, HEADER);
    // Code for the secure state of the Arm cores of an RP2350, on trial.
    assert_eq!(block.item(0x42), [0x9021_0142]);
    assert_eq!(block.item(0x03)[1], 0x1000_0200);
    let [_, storage, runtime, end] = *block.item(0x06) else {
        panic!("one entry")
    };
    assert_eq!((storage, runtime), (FLASH + COVERED as u32, storage));
    assert_eq!((end - FLASH) as usize, place.len());
    assert_eq!(place.len(), (CODE + CODE_BYTES).next_multiple_of(4));
    // Major and minor version, the counter, and the rows of the fuses that hold it.
    assert_eq!(
        block.item(0x48),
        [0x0200_0448, 0x0001_0203, 9 | 0x4E << 16, 0x51]
    );
    assert_eq!(place[MAKER..CODE], [0xA5; 32]);
    assert_eq!(only_block(&place[HEADER..]).unwrap().at, 0);
    // Its length, and the mark's place, are where the firmware and this task expect them.
    assert_eq!(word(&place, COVERED - 4), Some(0xAB12_3579));
    assert_eq!(place[TRIAL_MARK.0] & TRIAL_MARK.1, TRIAL_MARK.1);

    let (digest, public, signature) = seal_of(&block).unwrap();
    assert_eq!(hash(&place, &block).unwrap(), digest);
    assert!(curve::is_signed(&public, &digest, &signature));
    assert_eq!(verified(&place, &Sha256::digest(&public)), Some(()));
    // The same bytes each time: images can be built again.
    assert_eq!(place, self::place());
}

/// Every bit of a place behind the header is held by the seal, but the mark of a trial, which is for the ROM to take off.
#[test]
fn every_bit_of_a_sealed_image_is_found() {
    let mut place = place();
    let key_hash = Sha256::digest(block::public(&key()));
    for bit in HEADER * 8..place.len() * 8 {
        place[bit / 8] ^= 1 << (bit % 8);
        let is_mark = bit == TRIAL_MARK.0 * 8 + 7;
        assert_eq!(verified(&place, &key_hash).is_some(), is_mark, "bit {bit}");
        place[bit / 8] ^= 1 << (bit % 8);
    }
    let other = SigningKey::from_slice(&[8; 32]).unwrap();
    assert_eq!(
        verified(&place, &Sha256::digest(block::public(&other))),
        None
    );
}

/// The ROM's two numbers are in the order of the three; what has no room is refused.
#[test]
fn versions_keep_their_order() {
    let of = |text: &str| Version::read(text).map(Version::for_the_rom);
    let rising = [
        "0.1.0",
        "0.1.1",
        "0.1.255",
        "0.2.0",
        "0.255.255",
        "1.0.0",
        "65535.0.0",
    ];
    let rising = rising.map(|text| of(text).unwrap());
    assert!(rising.is_sorted_by(|a, b| a < b), "{rising:x?}");
    for bad in ["1.256.0", "1.0.256", "65536.0.0", "1.2", "1.2.x"] {
        assert!(of(bad).is_err(), "{bad}");
    }
}

/// The table's places are those of the firmware: one behind the other, with what counts before them and the board's own
/// key behind, and none in another; the linker keeps an image within one.
#[test]
fn the_places_are_those_of_the_firmware_and_of_the_linker() {
    let [tables, state, a, b] = sectors(&PICO, "src/storage/ab_images.rs")[..] else {
        panic!("four places");
    };
    assert_eq!([tables, state], [TABLES.sectors, STATE.sectors]);
    assert_eq!([a, b], PLACES.map(|of| of.sectors));
    let chip = text(&PICO, "src/storage/chip_flash.rs");
    assert!(chip.contains("const CHIP_BYTES: usize = 4 * 1024 * 1024;"));
    let [key_sectors] = sectors(&PICO, "src/storage/chip_flash.rs")[..] else {
        panic!("one place");
    };
    assert_eq!(PLACES[1].end() + key_sectors * SECTOR, 4 * 1024 * 1024);
    let all = [TABLES, STATE, PLACES[0], PLACES[1]];
    for pair in all.windows(2) {
        assert_eq!(pair[0].end(), pair[1].from);
    }
    let (from, length) = memory(&PICO, "link/flash-rp2350-ab.x", "FLASH");
    assert_eq!(from, FLASH + CODE as u32);
    assert_eq!(
        length as usize,
        (PLACES[0].sectors * SECTOR) as usize - CODE
    );
    let source = text(&PICO, "src/storage/ab_images.rs");
    let maker = source.split_once("const MAKER: u32 = ").unwrap().1;
    let (at, less) = maker.split_once(';').unwrap().0.split_once(" - ").unwrap();
    assert_eq!((number(at) - number(less)) as usize, MAKER);
    assert!(source.contains(&format!("boards: [\"{BOARD}\"; 2]")));

    let block = block::partition_table(PLACES, &key());
    let found = only_block(&block).unwrap();
    let [head, around, a, a_flags, b, b_flags] = *found.item(0x0A) else {
        panic!("two places")
    };
    // Two places, no second table; around them, files for the drive name addresses.
    assert_eq!((head, around), (0x8200_060A, 0xFC00_8000));
    for (words, flags, place) in [(a, a_flags, PLACES[0]), (b, b_flags, PLACES[1])] {
        // First and last sector of 13 bits, and what is allowed, twice.
        let (first, last) = (words & 0x1FFF, words >> 13 & 0x1FFF);
        assert_eq!((first * 4096, (last + 1) * 4096), (place.from, place.end()));
        assert_eq!((words >> 26, flags >> 26), (0x3F, 0x3F));
        // Arm looks here, RISC-V does not.
        assert_eq!(flags & 0x600, 0x400);
    }
    // B is linked to the pair's first, 0.
    assert_eq!((a_flags & 0x7E, b_flags & 0x7E), (0, 2));
    let (digest, public, signature) = seal_of(&found).unwrap();
    assert_eq!(hash(&block, &found).unwrap(), digest);
    assert!(curve::is_signed(&public, &digest, &signature));
}

/// A new board gets a table, an image that is nobody's trial, and nothing of what was there before.
#[test]
fn a_new_board_starts_its_first_image() {
    let place = place();
    let file = new_board(&place, &key()).unwrap();
    let mut flash = vec![0xAA; 4 * 1024 * 1024];
    for block in file.as_chunks::<512>().0 {
        assert_eq!(
            word(block, 28),
            Some(0xE48B_FF57),
            "each part to its address"
        );
        let at = (word(block, 12).unwrap() - FLASH) as usize;
        flash[at..at + 256].copy_from_slice(&block[32..288]);
    }
    assert_eq!(only_block(&flash).unwrap().items[0].0, 0x0A);
    let is_erased = |from: u32, to: u32| {
        flash[from as usize..to as usize]
            .iter()
            .all(|of| *of == 0xFF)
    };
    assert!(is_erased(SECTOR, TABLES.end()) && is_erased(STATE.from, STATE.end()));
    let [a, b] = PLACES;
    assert!(is_erased(b.from, b.from + SECTOR));
    let mut first = flash[a.from as usize..][..place.len()].to_vec();
    assert_eq!(first[TRIAL_MARK.0] & TRIAL_MARK.1, 0);
    let key_hash = Sha256::digest(block::public(&key()));
    assert_eq!(verified(&first, &key_hash), Some(()));
    first[TRIAL_MARK.0] |= TRIAL_MARK.1;
    assert_eq!(first, place);
    // The board's own key stays.
    assert!(flash[b.end() as usize..].iter().all(|of| *of == 0xAA));
}

/// The fuses hold the hash of the very key that signs, that key alone, and are told in words, each of them.
#[test]
fn the_fuses_are_those_of_the_key() {
    let settings = fuses::settings(&key());
    let hash = Sha256::digest(block::public(&key()));
    assert_eq!(settings["bootkey0"], serde_json::json!(hash.as_slice()));
    assert_eq!(settings["boot_flags1"]["key_valid"], 1);
    assert_eq!(settings["boot_flags1"]["key_invalid"], 14);
    assert_eq!(settings["crit1"]["secure_boot_enable"], 1);
    for (row, fields) in settings.as_object().unwrap() {
        assert!(fuses::IN_WORDS.contains(row.as_str()), "{row}");
        for field in fields.as_object().into_iter().flat_map(|of| of.keys()) {
            assert!(fuses::IN_WORDS.contains(field.as_str()), "{field}");
        }
    }
}
