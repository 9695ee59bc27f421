//! The key of a virtual board: drawn from the operating system's entropy.

use umi_app::measure::trust::heads::HeadSigner;
use umi_core::trust::board_key::{BoardKey, NoEntropy};

use super::VirtualFlash;

/// Who signs for a board with this flash that runs an image of this SHA-512 (its first half); none if there is no key in it and none can be drawn.
pub fn signer(flash: VirtualFlash, image: [u8; 32]) -> Option<&'static HeadSigner> {
    let key = BoardKey::open(flash, |seed| getrandom::fill(seed).map_err(|_| NoEntropy));
    // As long as the board: a process starts few of them.
    let key = key.ok()?;
    Some(Box::leak(Box::new(HeadSigner::new(key, image))))
}
