//! A signed head: the board's word for everything that its journal held up to an entry.
//!
//! The signature is Ed25519 (RFC 8032) by the board's key over these bytes:
//!
//! ```text
//! offset  size  field (little endian)
//!      0    16  tag "openumi head v1\n"
//!     16    32  the board's public key
//!     48    32  first half of the SHA-512 of the firmware image; zeros: the board does not know it
//!     80     4  starts of the board so far, this one included
//!     84     8  t_us: the board's clock when it signed
//!     92     8  seq: entries 0..seq are what it vouches for
//!    100     8  the oldest entry that it still held then
//!    108    32  chain value before entry seq
//!    140     1  1 with a nonce, 0 without one
//!    141    32  the nonce that the host gave; zeros without one
//!    173   1+n  length of the serial number, and its bytes
//!          1+m  length of the firmware's version, and its bytes
//! ```
//!
//! A board that keeps evidence apart from raw bytes (see [`EvidenceMark`]) signs for that, too. The
//! tag is "openumi head v2\n" then, and behind the above stand
//!
//! ```text
//!   size  field (little endian)
//!      8  number of the oldest piece of evidence that it held
//!      8  entry of that
//!     32  chain value of the evidence before it
//!      8  number that the next piece will get
//!     32  chain value of all evidence
//! ```
//!
//! In a journal the head stands as entry `seq`, right behind what it vouches for. It says all of
//! that entry's content, its time too: so nothing of the entry can be changed either.

use heapless::Vec;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::job::{MAX_NAME, Name};

/// First bytes of what is signed. No other message of this project begins like this.
pub const TAG: [u8; 16] = *b"openumi head v1\n";

/// The tag of a head that vouches for evidence, too.
pub const TAG_2: [u8; 16] = *b"openumi head v2\n";

/// Bytes of what is signed, at most.
pub const MAX_SIGNED: usize = 173 + 2 * (1 + MAX_NAME) + 88;

/// What a board holds of its evidence: entries that noise cannot push out of it
/// ([`Record::is_evidence`](crate::message::Record::is_evidence)).
///
/// Evidence has a chain of its own, so that a reader can tell that none of it is missing where the
/// entries between are no longer on the board. It is chained as a journal of these entries alone
/// is: each under its number among the evidence, with time and kind of the entry, and as payload
/// the entry's number (8 bytes, little endian), the chain value before it (32), and its payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct EvidenceMark {
    /// Number among the evidence of the oldest piece that it held.
    pub first: u64,
    /// The entry that this is; the head's own, if it held none.
    pub first_seq: u64,
    /// Chain value of the evidence before it.
    pub first_chain: [u8; 32],
    /// Number that the next piece will get: the head itself.
    pub next: u64,
    /// Chain value of all evidence before the head.
    pub chain: [u8; 32],
}

/// What a board signs, and its signature.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Head {
    /// It vouches for the entries before this one.
    pub seq: u64,
    /// The board's clock when it signed.
    pub t_us: u64,
    /// The oldest entry that it still held then: older ones had been overwritten.
    pub first_seq: u64,
    /// The chain value before entry `seq`.
    pub chain: [u8; 32],
    /// Starts of the board so far, this one included.
    pub boot: u32,
    /// The board's public key.
    pub key: [u8; 32],
    /// First half of the SHA-512 of the firmware image, as a signed image's header has it; zeros: the
    /// board does not know it.
    pub image: [u8; 32],
    /// The board's serial number.
    pub serial: Name,
    /// Firmware version, as "0.1.0".
    pub firmware: Name,
    /// What the host gave so that nobody can have signed before; none without a host.
    pub nonce: Option<[u8; 32]>,
    /// The signature's two halves, R and S.
    pub signature: [[u8; 32]; 2],
    /// What the board held of its evidence; none: it keeps none apart.
    pub evidence: Option<EvidenceMark>,
}

impl Head {
    /// The bytes that are signed.
    #[must_use]
    pub fn signed(&self) -> Vec<u8, MAX_SIGNED> {
        let mut bytes = Vec::new();
        let is_asked = [u8::from(self.nonce.is_some())];
        let nonce = self.nonce.unwrap_or_default();
        let length = |text: &Name| [u8::try_from(text.len()).unwrap_or(u8::MAX)];
        let tag = match self.evidence {
            None => TAG,
            Some(_) => TAG_2,
        };
        for piece in [
            &tag[..],
            &self.key,
            &self.image,
            &self.boot.to_le_bytes(),
            &self.t_us.to_le_bytes(),
            &self.seq.to_le_bytes(),
            &self.first_seq.to_le_bytes(),
            &self.chain,
            &is_asked,
            &nonce,
            &length(&self.serial),
            self.serial.as_bytes(),
            &length(&self.firmware),
            self.firmware.as_bytes(),
        ] {
            // There is room for the longest.
            let _ = bytes.extend_from_slice(piece);
        }
        if let Some(mark) = &self.evidence {
            for piece in [
                &mark.first.to_le_bytes()[..],
                &mark.first_seq.to_le_bytes(),
                &mark.first_chain,
                &mark.next.to_le_bytes(),
                &mark.chain,
            ] {
                // As above.
                let _ = bytes.extend_from_slice(piece);
            }
        }
        bytes
    }
}

/// The answer to a question for a head.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[allow(clippy::large_enum_variant, reason = "no heap; one exists at a time")]
pub enum HeadAnswer {
    /// The newest head; over the nonce, if one was given.
    Signed(Head),
    /// The board signs when nothing is under way that a signature could delay: ask again.
    Pending,
    /// This board has no key: it signs nothing.
    NoKey,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::name;

    /// What is signed, byte by byte. If this changes, heads that boards have signed cannot be
    /// checked any more: another tag instead.
    #[test]
    fn the_signed_bytes_stand_where_the_drawing_says() {
        let head = Head {
            seq: 0x0102_0304_0506_0708,
            t_us: 0x1112_1314_1516_1718,
            first_seq: 0x2122_2324_2526_2728,
            chain: [0xC4; 32],
            boot: 0x3132_3334,
            key: [0xAA; 32],
            image: [0xBB; 32],
            serial: name("0042"),
            firmware: name("0.1.0"),
            nonce: Some([0xDD; 32]),
            signature: [[0; 32]; 2],
            evidence: None,
        };
        let bytes = head.signed();
        assert_eq!(bytes.len(), 173 + 5 + 6);
        assert_eq!(bytes[..16], *b"openumi head v1\n");
        assert_eq!(bytes[16..48], [0xAA; 32]);
        assert_eq!(bytes[48..80], [0xBB; 32]);
        assert_eq!(bytes[80..84], [0x34, 0x33, 0x32, 0x31]);
        assert_eq!(bytes[84..92], 0x1112_1314_1516_1718_u64.to_le_bytes());
        assert_eq!(bytes[92..100], 0x0102_0304_0506_0708_u64.to_le_bytes());
        assert_eq!(bytes[100..108], 0x2122_2324_2526_2728_u64.to_le_bytes());
        assert_eq!(bytes[108..140], [0xC4; 32]);
        assert_eq!(bytes[140], 1);
        assert_eq!(bytes[141..173], [0xDD; 32]);
        assert_eq!(bytes[173..], *b"\x040042\x050.1.0");
        let marked = Head {
            evidence: Some(EvidenceMark {
                first: 0x41,
                first_seq: 0x42,
                first_chain: [0xE1; 32],
                next: 0x43,
                chain: [0xE2; 32],
            }),
            ..head.clone()
        };
        let all = marked.signed();
        assert_eq!(all[..16], *b"openumi head v2\n");
        assert_eq!(all[16..bytes.len()], bytes[16..]);
        let behind = &all[bytes.len()..];
        assert_eq!(behind.len(), 88);
        assert_eq!((behind[0], behind[8], behind[48]), (0x41, 0x42, 0x43));
        assert_eq!((behind[16], behind[56]), (0xE1, 0xE2));
        let alone = Head {
            nonce: None,
            ..head
        };
        assert_eq!(alone.signed()[140..173], [0; 33]);
    }
}
