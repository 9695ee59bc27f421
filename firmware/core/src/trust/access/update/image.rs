//! An image with its header, as it stands in a `.umif` file and in a slot.
//!
//! ```text
//!   0   8  "oUMIimg\n"
//!   8   2  format, 1                  u16 LE
//!  10   2  zeros
//!  12  16  kind of board, UTF-8, zeros behind it
//!  28   6  version: major, minor, patch   u16 LE each
//!  34   2  zeros
//!  36   4  security counter           u32 LE
//!  40   4  length of the payload      u32 LE
//!  44  64  SHA-512 of the payload
//! 108   8  short name of the maker's key: the start of its SHA-256
//! 116  12  zeros
//! 128  64  Ed25519 signature, R and S, over "openumi image v1\n" and the bytes before
//! 192      payload
//! ```

use ed25519_dalek::{Signature, VerifyingKey};
use umi_protocol::access::KeyId;
use umi_protocol::job::Name;
use umi_protocol::update::{IMAGE_HEADER, ImageVersion};

use crate::trust::board_key::key_id;

const MAGIC: &[u8; 8] = b"oUMIimg\n";
const FORMAT: u16 = 1;
/// Bytes of the header that are signed.
const SIGNED: usize = 128;
const TITLE: &[u8; 17] = b"openumi image v1\n";
const BOARD: usize = 16;

/// What a header says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageHeader {
    /// The kind of board, 16 bytes at most.
    pub board: Name,
    /// The version.
    pub version: ImageVersion,
    /// The security counter.
    pub counter: u32,
    /// Bytes of the payload.
    pub length: u32,
    /// SHA-512 of the payload.
    pub sha512: [u8; 64],
    /// The maker's key.
    pub key_id: KeyId,
}

/// What is signed: a title and the start of the header.
pub type SignedBytes = [u8; TITLE.len() + SIGNED];

/// A header is none, or its signature is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoHeader;

impl ImageHeader {
    /// The start of the header: all but the signature.
    fn start(&self) -> [u8; SIGNED] {
        let mut bytes = [0; SIGNED];
        let mut put = |at: usize, part: &[u8]| {
            for (place, byte) in bytes.iter_mut().skip(at).zip(part) {
                *place = *byte;
            }
        };
        put(0, MAGIC);
        put(8, &FORMAT.to_le_bytes());
        put(
            12,
            self.board
                .as_bytes()
                .get(..BOARD)
                .unwrap_or(self.board.as_bytes()),
        );
        for (at, number) in [28, 30, 32].into_iter().zip(self.version) {
            put(at, &number.to_le_bytes());
        }
        put(36, &self.counter.to_le_bytes());
        put(40, &self.length.to_le_bytes());
        put(44, &self.sha512);
        put(108, &self.key_id);
        bytes
    }

    /// What the maker signs.
    #[must_use]
    pub fn signed(&self) -> SignedBytes {
        let mut bytes = [0; TITLE.len() + SIGNED];
        let (title, start) = bytes.split_at_mut(TITLE.len());
        title.copy_from_slice(TITLE);
        start.copy_from_slice(&self.start());
        bytes
    }

    /// The header with this signature, R and S.
    #[must_use]
    pub fn encode(&self, [r, s]: [[u8; 32]; 2]) -> [u8; IMAGE_HEADER] {
        let mut bytes = [0; IMAGE_HEADER];
        let parts = self.start().into_iter().chain(r).chain(s);
        for (place, byte) in bytes.iter_mut().zip(parts) {
            *place = byte;
        }
        bytes
    }

    /// Reads a header, and its signature, which nobody has looked at.
    ///
    /// # Errors
    /// [`NoHeader`]: another layout, or bytes that are said to be zeros and are not.
    pub fn read(bytes: &[u8; IMAGE_HEADER]) -> Result<(Self, [[u8; 32]; 2]), NoHeader> {
        let header = Self::read_start(bytes).ok_or(NoHeader)?;
        let signature = [part(bytes, SIGNED), part(bytes, SIGNED + 32)];
        // What is not said is zeros, so that one image has one header.
        match header.encode(signature) == *bytes {
            true => Ok((header, signature)),
            false => Err(NoHeader),
        }
    }

    fn read_start(bytes: &[u8; IMAGE_HEADER]) -> Option<Self> {
        let board: [u8; BOARD] = part(bytes, 12);
        let end = board.iter().position(|byte| *byte == 0).unwrap_or(BOARD);
        let board = core::str::from_utf8(board.get(..end)?).ok()?;
        Some(Self {
            board: Name::try_from(board).ok()?,
            version: [28, 30, 32].map(|at| u16::from_le_bytes(part(bytes, at))),
            counter: u32::from_le_bytes(part(bytes, 36)),
            length: u32::from_le_bytes(part(bytes, 40)),
            sha512: part(bytes, 44),
            key_id: part(bytes, 108),
        })
    }

    /// Whether this key has signed the header.
    #[must_use]
    pub fn is_signed(&self, [r, s]: [[u8; 32]; 2], maker: &[u8; 32]) -> bool {
        let signature = Signature::from_components(r, s);
        self.key_id == key_id(maker)
            && VerifyingKey::from_bytes(maker)
                .and_then(|key| key.verify_strict(&self.signed(), &signature))
                .is_ok()
    }
}

fn part<const N: usize>(bytes: &[u8; IMAGE_HEADER], at: usize) -> [u8; N] {
    let mut found = [0; N];
    for (place, byte) in found.iter_mut().zip(bytes.iter().skip(at)) {
        *place = *byte;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use ed25519_dalek::{Signer as _, SigningKey};
    use umi_protocol::job::name;

    /// Every bit of a header is signed: another one, and it is none or not the maker's.
    #[test]
    fn every_bit_of_a_header_is_signed() {
        let maker = SigningKey::from_bytes(&[5; 32]);
        let public = maker.verifying_key().to_bytes();
        let header = ImageHeader {
            board: name("virtual"),
            version: [1, 2, 300],
            counter: 7,
            length: 36,
            sha512: [9; 64],
            key_id: key_id(&public),
        };
        let signature = maker.sign(&header.signed());
        let signature = [*signature.r_bytes(), *signature.s_bytes()];
        let bytes = header.encode(signature);
        assert_eq!(ImageHeader::read(&bytes), Ok((header.clone(), signature)));
        assert!(header.is_signed(signature, &public));
        for bit in 0..IMAGE_HEADER * 8 {
            let mut bytes = bytes;
            bytes[bit / 8] ^= 1 << (bit % 8);
            let read = ImageHeader::read(&bytes);
            assert!(
                read.is_err() || read.is_ok_and(|(of, by)| !of.is_signed(by, &public)),
                "bit {bit}"
            );
        }
        let other = SigningKey::from_bytes(&[6; 32]).verifying_key().to_bytes();
        assert!(!header.is_signed(signature, &other));
    }
}
