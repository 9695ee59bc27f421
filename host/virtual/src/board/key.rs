//! The key of a virtual board: drawn from the operating system's entropy.

use umi_app::measure::trust::heads::HeadSigner;
use umi_core::trust::board_key::{BoardKey, NoEntropy};

use super::VirtualFlash;

/// A key that signs as long as the process lives.
struct Signing {
    key: BoardKey,
    image: [u8; 32],
}

impl HeadSigner for Signing {
    fn key(&self) -> [u8; 32] {
        self.key.public()
    }

    fn boot(&self) -> u32 {
        self.key.boot()
    }

    fn image(&self) -> [u8; 32] {
        self.image
    }

    fn sign(&self, bytes: &[u8]) -> [[u8; 32]; 2] {
        self.key.sign(bytes)
    }
}

/// Who signs for a board with this flash that runs an image of this SHA-256; none if there is no key in it and none can be drawn.
pub fn signer(flash: VirtualFlash, image: [u8; 32]) -> Option<&'static dyn HeadSigner> {
    let key = BoardKey::open(flash, |seed| getrandom::fill(seed).map_err(|_| NoEntropy));
    // As long as the board: a process starts few of them.
    let key = key.ok()?;
    Some(Box::leak(Box::new(Signing { key, image })))
}
