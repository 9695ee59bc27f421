//! Blocks that the boot ROM of an RP2350 reads: what an image is, and where images stand.
//!
//! A block is words, little-endian (RP2350 data sheet, 5.9): a marker, items, one item that tells their length, the way to
//! the next block, a marker. One that is alone in its loop points to itself: 0. Each item begins with its kind and its
//! length in words.
//!
//! Both blocks here are sealed: behind what they say stand the key, the signature (ECDSA on secp256k1, SHA-256), and the
//! hash by itself, for chips whose fuses ask for no signature.

use k256::ecdsa::signature::hazmat::PrehashSigner as _;
use k256::ecdsa::{Signature, SigningKey};
use sha2::{Digest as _, Sha256};

use super::{Place, Version};

const START: u32 = 0xFFFF_DED3;
const END: u32 = 0xAB12_3579;

const IMAGE_TYPE: u32 = 0x42;
const VECTOR_TABLE: u32 = 0x03;
const LOAD_MAP: u32 = 0x06;
const HASH_DEF: u32 = 0x47;
const VERSION: u32 = 0x48;
const SIGNATURE: u32 = 0x09;
const PARTITION_TABLE: u32 = 0x0A;
const HASH_VALUE: u32 = 0x4B;
/// Its length has two bytes.
const LAST: u32 = 0xFF;

/// Code for the secure state of an RP2350's Arm cores, on trial (data sheet, 5.9.3.1).
const ON_TRIAL: u32 = 0x9021;
/// The mark of a trial, which the ROM leaves out of the hash: in the word behind the first marker.
const TRIAL: u32 = 0x8000_0000;
/// Addresses of the load map are whole ones, no distances.
const ABSOLUTE: u32 = 0x80;

/// The fuses that count how far back an image may go: two rows of 24 (data sheet, 13.10, DEFAULT_BOOT_VERSION0 and 1).
const COUNTER_ROWS: [u32; 2] = [0x4E, 0x51];
/// The highest counter that they hold.
pub const MOST_COUNTER: u32 = 47;

/// Everybody may read and write: what keeps others out is the seal.
const OPEN: u32 = 0xFC00_0000;
/// A file for the drive may have the addresses of its parts in it.
const TAKES_ABSOLUTE: u32 = 0x8000;
/// RISC-V cores do not look for an image here.
const NOT_FOR_RISCV: u32 = 0x400;
/// The other half of the pair whose first is partition 0.
const B_OF_THE_FIRST: u32 = 1 << 1;
/// There is one table: the ROM does not look for a second one.
const ALONE: u32 = 0x80;

/// Bytes of an image's block, sealed.
pub const IMAGE_BLOCK: usize = 236;

const fn item(kind: u32, words: u32, more: u32) -> u32 {
    kind | words << 8 | more << 24
}

/// The block of an image: what is covered stands from `from` on, as the ROM shows it, and its vectors at `vectors`.
pub fn image(
    covered: &[u8],
    from: u32,
    vectors: u32,
    version: Version,
    counter: u32,
    key: &SigningKey,
) -> Vec<u8> {
    let [row, next_row] = COUNTER_ROWS;
    let items = [
        IMAGE_TYPE | 1 << 8 | ON_TRIAL << 16,
        item(VECTOR_TABLE, 2, 0),
        vectors,
        item(LOAD_MAP, 4, ABSOLUTE | 1),
        from,
        from,
        from + covered.len() as u32,
        item(VERSION, 4, COUNTER_ROWS.len() as u32),
        version.for_the_rom(),
        counter | row << 16,
        next_row,
    ];
    sealed(&items, covered, key)
}

/// The table of two places for images, A and B of a pair.
pub fn partition_table(places: [Place; 2], key: &SigningKey) -> Vec<u8> {
    let [a, b] = places.map(|place| OPEN | place.last_sector() << 13 | place.first_sector());
    let items = [
        item(PARTITION_TABLE, 6, ALONE | 2),
        OPEN | TAKES_ABSOLUTE,
        a,
        OPEN | NOT_FOR_RISCV,
        b,
        OPEN | NOT_FOR_RISCV | B_OF_THE_FIRST,
    ];
    sealed(&items, &[], key)
}

/// A block of these items, which is the only one: sealed together with what it is about.
fn sealed(items: &[u32], covered: &[u8], key: &SigningKey) -> Vec<u8> {
    let mut words = [&[START], items, &[item(HASH_DEF, 2, 1)]].concat();
    words.push(words.len() as u32 + 1);
    let mut hashed = words.clone();
    if items[0] & 0xFF == IMAGE_TYPE {
        hashed[1] &= !TRIAL;
    }
    let hash = Sha256::new().chain_update(covered);
    let hash = hash.chain_update(bytes(&hashed)).finalize();
    // A hash of 32 bytes is what it signs: it cannot fail.
    #[expect(clippy::expect_used, reason = "the length is right")]
    let signature: Signature = key.sign_prehash(&hash).expect("a hash of the right length");

    let mut block = bytes(&words);
    block.extend(item(SIGNATURE, 33, 1).to_le_bytes());
    block.extend(public(key));
    block.extend(signature.to_bytes());
    block.extend(item(HASH_VALUE, 9, 0).to_le_bytes());
    block.extend(hash);
    let words = block.len() as u32 / 4 - 1;
    block.extend(bytes(&[LAST | words << 8, 0, END]));
    block
}

fn bytes(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// The public key as the ROM has it: both coordinates.
pub fn public(key: &SigningKey) -> [u8; 64] {
    let point = key.verifying_key().to_sec1_point(false);
    let mut both = [0; 64];
    // Behind one byte that says that there are two.
    both.copy_from_slice(&point.as_bytes()[1..]);
    both
}
