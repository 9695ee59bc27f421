//! The key of a virtual board: drawn from the operating system's entropy.

use umi_app::measure::trust::heads::HeadSigner;
use umi_core::trust::board_key::{BoardKey, NoEntropy};

use super::VirtualFlash;

/// Who signs for a board with this flash that runs an image of this SHA-512 (its first half); none if there is no key in it and none can be drawn.
/// Where the board is being wiped (`is_wiping`), one that cannot be read is drawn anew.
pub fn signer(
    flash: VirtualFlash,
    image: [u8; 32],
    is_wiping: bool,
) -> Option<&'static HeadSigner> {
    let draw = |seed: &mut [u8; 32]| getrandom::fill(seed).map_err(|_| NoEntropy);
    let key = match is_wiping {
        true => BoardKey::renew(flash, draw),
        false => BoardKey::open(flash, draw),
    };
    // As long as the board: a process starts few of them.
    let key = key.ok()?;
    Some(Box::leak(Box::new(HeadSigner::new(key, image))))
}
