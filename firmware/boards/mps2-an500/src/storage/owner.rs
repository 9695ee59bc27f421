//! The board's own key, and the keys of people.
//!
//! # Limitations
//!
//! QEMU's machine has no source of entropy. The bench gives one, in the file that stands for the
//! flash ([`super`]): who can read that file has the key. Without it the board
//! has no key and signs nothing, and nobody can own it.

use core::sync::atomic::{AtomicU32, Ordering};

use core::cell::Cell;
use critical_section::Mutex;
use sha2::{Digest as _, Sha256};
use static_cell::StaticCell;
use umi_app::access::Keeper;
use umi_app::measure::trust::heads::HeadSigner;
use umi_core::trust::board_key::{BoardKey, NoEntropy};
use umi_core::units::Micros;

use super::{Region, jumper_is_closed};

/// What the bench gave, and the number of this start: nothing is drawn twice.
static SEED: Mutex<Cell<[u8; 32]>> = Mutex::new(Cell::new([0; 32]));
static DRAWN: AtomicU32 = AtomicU32::new(0);

/// Takes up the board's key, or draws one; none: there is no entropy. Heads name the image of this digest. A wipe that has
/// begun in the area of the keys (`access`) draws another where the board's own cannot be read.
pub fn signer(
    key: Region,
    access: &mut Region,
    entropy: [u8; 32],
    digest: [u8; 32],
) -> Option<&'static HeadSigner> {
    static SIGNING: StaticCell<HeadSigner> = StaticCell::new();
    critical_section::with(|cs| SEED.borrow(cs).set(entropy));
    let key = match Keeper::is_wiping(access) {
        true => BoardKey::renew(key, draw),
        false => BoardKey::open(key, draw),
    };
    let key = key.ok()?;
    // What is drawn from here on is of this start alone.
    let mut hash = Sha256::new();
    hash.update(entropy);
    hash.update(key.boot().to_le_bytes());
    critical_section::with(|cs| SEED.borrow(cs).set(hash.finalize().into()));
    Some(SIGNING.init(HeadSigner::new(key, digest)))
}

/// The keys of people.
pub fn keeper(access: Region, signer: Option<&'static HeadSigner>) -> Keeper<Region> {
    Keeper::open(access, jumper_is_closed, signer, draw, Micros(0))
}

fn draw(bytes: &mut [u8; 32]) -> Result<(), NoEntropy> {
    let seed = critical_section::with(|cs| SEED.borrow(cs).get());
    if seed == [0; 32] {
        return Err(NoEntropy);
    }
    let drawn = DRAWN.fetch_add(1, Ordering::Relaxed);
    let mut hash = Sha256::new();
    hash.update(seed);
    hash.update(drawn.to_le_bytes());
    *bytes = hash.finalize().into();
    Ok(())
}
