//! The key of a virtual board: drawn from the operating system's entropy.

use umi_app::measure::trust::heads::HeadSigner;
use umi_core::board_key::{BoardKey, NoEntropy};

use super::VirtualFlash;

/// A key that signs as long as the process lives.
struct Signing(BoardKey);

impl HeadSigner for Signing {
    fn key(&self) -> [u8; 32] {
        self.0.public()
    }

    fn boot(&self) -> u32 {
        self.0.boot()
    }

    fn sign(&self, bytes: &[u8]) -> [[u8; 32]; 2] {
        self.0.sign(bytes)
    }
}

/// Who signs for a board with this flash; none if there is no key in it and none can be drawn.
pub fn signer(flash: VirtualFlash) -> Option<&'static dyn HeadSigner> {
    let key = BoardKey::open(flash, |seed| getrandom::fill(seed).map_err(|_| NoEntropy));
    // As long as the board: a process starts few of them.
    Some(Box::leak(Box::new(Signing(key.ok()?))))
}
