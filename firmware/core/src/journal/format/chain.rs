//! The two check values: CRC-32 against accident, SHA-256 chain against editing.

use core::fmt;
use sha2::{Digest, Sha256};

/// CRC-32 as in IEEE 802.3 (zlib's `crc32`), with a 1 KiB table.
pub(crate) static CRC32: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// How many bytes of the chain value each entry carries.
pub const TAG_SIZE: usize = 8;

/// The chain value: SHA-256 over everything the journal ever held, in order.
///
/// `chain(k) = SHA-256(chain(k-1) ‖ first 20 + n bytes of entry k)`, starting
/// from [`Chain::GENESIS`]. Whoever wrote down one value can later prove that
/// nothing before it was changed, removed or put in another order.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Chain(pub [u8; 32]);

impl Chain {
    /// The value before entry 0: 32 zero bytes.
    pub const GENESIS: Self = Self([0; 32]);

    /// The part that an entry carries: the first [`TAG_SIZE`] bytes.
    pub(in crate::journal) fn tag(&self) -> [u8; TAG_SIZE] {
        let Some(tag) = self.0.first_chunk() else {
            return [0; TAG_SIZE];
        };
        *tag
    }
}

impl fmt::Display for Chain {
    /// 64 hexadecimal digits.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for byte in self.0 {
            write!(f, "{byte:02x}")?;
        }
        Ok(())
    }
}

impl fmt::Debug for Chain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Chain({self})")
    }
}

/// One link of the chain, fed in pieces.
pub(in crate::journal) struct Link(Sha256);

impl Link {
    pub fn after(previous: &Chain) -> Self {
        Self(Sha256::new_with_prefix(previous.0))
    }

    pub fn feed(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    pub fn finish(self) -> Chain {
        Chain(self.0.finalize().into())
    }
}
