//! The board's own key, and how often it has started.
//!
//! # Design
//!
//! Both stand in a small [`Journal`] of their own, in flash that no request reads: an entry for
//! each start, with the key's seed and the count of starts up to it. So a start that is cut
//! leaves the one before, and a key is there whole or not at all. The first start of a new board
//! draws the seed, and keeps it in two sectors: damage of one, or of its header, costs no key. The count of starts, and what
//! stands behind the key, may fall to what the other sector has. Where none can be read the
//! board has no key, and makes no other in its place, until a wipe has it drawn anew ([`BoardKey::renew`]).
//!
//! Behind the key an entry may have what somebody else keeps
//! (`access::update`): a start writes it as it was. Where that was kept first, zeros stand for the key.
//!
//! The signatures are Ed25519 (RFC 8032), by the crate `ed25519-dalek`.
//!
//! # Limitations
//!
//! Who can read the flash has the key. Who can erase it makes a board with another key, which
//! nobody can take for the old one.

use core::fmt;

use ed25519_dalek::{Signature, Signer as _, SigningKey, VerifyingKey};
use sha2::{Digest as _, Sha256};
use umi_protocol::head::Head;

use crate::journal::{Flash, Journal, JournalError};
use crate::units::Micros;

/// Bytes of a seed.
pub const SEED: usize = 32;

/// Kind number of an entry. A later layout gets another.
const KIND: u8 = 1;

/// The seed and the starts.
pub(crate) const KEY_BYTES: usize = SEED + 4;

/// What may stand behind them, at most.
pub(crate) const BEHIND_KEY: usize = 56;

/// What stands there where there is no key yet.
const NO_KEY: [u8; KEY_BYTES] = [0; KEY_BYTES];

/// A board's key, opened.
pub struct BoardKey {
    signing: SigningKey,
    boot: u32,
}

impl BoardKey {
    /// Takes up the key, or draws one on a board that is new, and counts the start.
    ///
    /// `draw` fills a seed from the board's source of entropy.
    ///
    /// # Errors
    /// [`KeyError`]: the board has no key, and signs nothing.
    pub fn open<F: Flash>(
        flash: F,
        draw: impl FnOnce(&mut [u8; SEED]) -> Result<(), NoEntropy>,
    ) -> Result<Self, KeyError<F::Error>> {
        let (mut journal, recovery) = Journal::open(flash).map_err(KeyError::Flash)?;
        let mut payload = [0; KEY_BYTES + BEHIND_KEY];
        let mut length = KEY_BYTES;
        match journal.next_seq().checked_sub(1) {
            Some(newest) => {
                let found = journal
                    .read(newest, &mut payload)
                    .map_err(KeyError::Flash)?;
                length = found.entry.payload.len();
                if found.entry.kind != KIND || length < KEY_BYTES {
                    return Err(KeyError::OtherLayout);
                }
            }
            // Something was there: another key in its place would hide that.
            None if recovery.damaged_headers > 0 => return Err(KeyError::Damaged),
            None => {}
        }
        let (payload, _) = payload.split_at_mut(length);
        let Some((key, _)) = payload.split_first_chunk_mut() else {
            return Err(KeyError::OtherLayout);
        };
        let (mut seed, boot) = split(key);
        if *key == NO_KEY {
            draw(&mut seed).map_err(|NoEntropy| KeyError::NoEntropy)?;
        }
        // What a source that does not work gives.
        if seed.iter().all(|byte| Some(byte) == seed.first()) {
            return Err(KeyError::NoEntropy);
        }
        let is_first = boot == 0;
        let boot = boot.saturating_add(1);
        *key = joined(&seed, boot);
        for _ in 0..if is_first { 2 } else { 1 } {
            journal
                .append(KIND, Micros(0), payload)
                .map_err(KeyError::Flash)?;
            if is_first {
                journal.turn();
            }
        }
        let signing = SigningKey::from_bytes(&seed);
        Ok(Self { signing, boot })
    }

    /// As [`open`](Self::open), for a board that forgets everything: where a key was there and cannot be read, another is
    /// drawn. What stands behind the key goes with it. If power is cut before it returns, call it again.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn renew<F: Flash>(
        mut flash: F,
        draw: impl FnOnce(&mut [u8; SEED]) -> Result<(), NoEntropy>,
    ) -> Result<Self, KeyError<F::Error>> {
        match Self::open(&mut flash, |_| Err(NoEntropy)) {
            // A flash that does not answer may hold a good one.
            Err(error @ KeyError::Flash(JournalError::Flash(_))) => return Err(error),
            Err(_) => Journal::format(&mut flash).map_err(KeyError::Flash)?,
            Ok(key) => return Ok(key),
        }
        Self::open(flash, draw)
    }

    /// The public key.
    #[must_use]
    pub fn public(&self) -> [u8; 32] {
        self.signing.verifying_key().to_bytes()
    }

    /// Starts of the board so far, this one included.
    #[must_use]
    pub fn boot(&self) -> u32 {
        self.boot
    }

    /// The signature of these bytes, R and S.
    #[must_use]
    pub fn sign(&self, bytes: &[u8]) -> [[u8; 32]; 2] {
        let signature = self.signing.sign(bytes);
        [*signature.r_bytes(), *signature.s_bytes()]
    }
}

impl fmt::Debug for BoardKey {
    /// Without the secret.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("BoardKey")
            .field("boot", &self.boot)
            .finish_non_exhaustive()
    }
}

fn split(payload: &[u8; KEY_BYTES]) -> ([u8; SEED], u32) {
    let (mut seed, mut boot) = ([0; SEED], [0; 4]);
    let (first, last) = payload.split_at(SEED);
    seed.copy_from_slice(first);
    boot.copy_from_slice(last);
    (seed, u32::from_le_bytes(boot))
}

fn joined(seed: &[u8; SEED], boot: u32) -> [u8; KEY_BYTES] {
    let mut payload = NO_KEY;
    let (first, last) = payload.split_at_mut(SEED);
    first.copy_from_slice(seed);
    last.copy_from_slice(&boot.to_le_bytes());
    payload
}

/// A short name of a public key: the first bytes of its SHA-256.
#[must_use]
pub fn key_id(public: &[u8; 32]) -> [u8; 8] {
    let digest: [u8; 32] = Sha256::digest(public).into();
    digest.first_chunk().copied().unwrap_or_default()
}

/// Whether this is a public key by which something can be proven: a point of the curve, of a large
/// order.
#[must_use]
pub fn may_prove(public: &[u8; 32]) -> bool {
    VerifyingKey::from_bytes(public).is_ok_and(|key| !key.is_weak())
}

/// Whether a head was signed by the key that it names. Signatures that are not in the one form of
/// RFC 8032, and keys of a small order, are refused.
#[must_use]
pub fn is_signed(head: &Head) -> bool {
    let [r, s] = head.signature;
    let signature = Signature::from_components(r, s);
    VerifyingKey::from_bytes(&head.key)
        .and_then(|key| key.verify_strict(&head.signed(), &signature))
        .is_ok()
}

/// The source of entropy does not work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoEntropy;

/// Why a board has no key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyError<E> {
    /// The flash of the key.
    Flash(JournalError<E>),
    /// It holds what another firmware wrote.
    OtherLayout,
    /// A key was there and cannot be read any more.
    Damaged,
    /// There is no key yet, and the source of entropy does not work.
    NoEntropy,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::journal::Geometry;
    use crate::journal::mock::{Cut, ERASE_CUTS, MockFlash, Op};
    use std::vec::Vec;
    use umi_protocol::job::name;

    const GEOMETRY: Geometry = Geometry {
        sectors: 2,
        sector_size: 4096,
        write_size: 1,
        page_size: 256,
    };

    /// As in an STM32H743's own flash: words of 32 bytes, of which a torn one reads as zeros.
    const WITH_ECC: Geometry = Geometry {
        sectors: 2,
        sector_size: 1024,
        write_size: 32,
        page_size: 32,
    };

    fn seed(of: u8) -> impl FnOnce(&mut [u8; SEED]) -> Result<(), NoEntropy> {
        move |seed| {
            for (place, n) in seed.iter_mut().zip(0..) {
                *place = of ^ n;
            }
            Ok(())
        }
    }

    fn head(key: &BoardKey) -> Head {
        let mut head = Head {
            seq: 7,
            t_us: 8,
            first_seq: 0,
            chain: [3; 32],
            boot: key.boot(),
            key: key.public(),
            image: [0; 32],
            serial: name("0042"),
            firmware: name("0.1.0"),
            nonce: None,
            signature: [[0; 32]; 2],
            evidence: None,
        };
        head.signature = key.sign(&head.signed());
        head
    }

    /// The key of the first start stays, whatever is drawn later; starts are counted, over more of
    /// them than the flash holds at once.
    #[test]
    fn a_key_stays_and_starts_are_counted() {
        let mut flash = MockFlash::new(GEOMETRY);
        let mut public = None;
        for start in 1..=300 {
            let key = BoardKey::open(&mut flash, seed(start as u8)).unwrap();
            assert_eq!(key.boot(), start);
            assert_eq!(*public.get_or_insert(key.public()), key.public());
        }
    }

    /// Another bit of what is signed, of the signature or of the key: not signed.
    #[test]
    fn every_field_of_a_head_is_signed() {
        let key = BoardKey::open(MockFlash::new(GEOMETRY), seed(1)).unwrap();
        let good = head(&key);
        assert!(is_signed(&good));
        let changes: [fn(&mut Head); 12] = [
            |head| head.seq ^= 1,
            |head| head.t_us ^= 1,
            |head| head.first_seq ^= 1,
            |head| head.chain[31] ^= 1,
            |head| head.boot ^= 1,
            |head| head.key[0] ^= 1,
            |head| head.image[0] ^= 1,
            |head| head.serial = name("0043"),
            |head| head.firmware = name("0.1.1"),
            |head| head.nonce = Some([0; 32]),
            |head| head.signature[0][0] ^= 1,
            |head| head.signature[1][31] ^= 0x80,
        ];
        for change in changes {
            let mut head = good.clone();
            change(&mut head);
            assert!(!is_signed(&head), "{head:?}");
        }
    }

    /// The signature is that of RFC 8032, section 7.1, test 2: others can check it.
    #[test]
    fn signatures_are_those_of_the_standard() {
        let hex = |text: &str| -> std::vec::Vec<u8> {
            (0..text.len() / 2)
                .map(|n| u8::from_str_radix(&text[2 * n..2 * n + 2], 16).unwrap())
                .collect()
        };
        let seed = hex("4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb");
        let key = BoardKey::open(MockFlash::new(GEOMETRY), |place| {
            place.copy_from_slice(&seed);
            Ok(())
        })
        .unwrap();
        let public = "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c";
        assert_eq!(key.public().to_vec(), hex(public));
        let expected = "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da\
                        085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00";
        assert_eq!(key.sign(&[0x72]).concat(), hex(expected));
    }

    /// A source that does not work makes no key.
    #[test]
    fn no_key_is_better_than_a_bad_one() {
        for constant in [0, 0xFF] {
            let opened = BoardKey::open(MockFlash::new(GEOMETRY), |seed| {
                seed.fill(constant);
                Ok(())
            });
            assert_eq!(opened.unwrap_err(), KeyError::NoEntropy);
        }
        let broken = BoardKey::open(MockFlash::new(GEOMETRY), |_| Err(NoEntropy));
        assert_eq!(broken.unwrap_err(), KeyError::NoEntropy);
    }

    /// What can happen to an operation.
    fn ways(op: &Op, word: usize) -> Vec<Cut> {
        match op {
            Op::Erase { .. } => ERASE_CUTS.to_vec(),
            Op::Program { len, .. } => (0..*len)
                .step_by(word)
                .flat_map(|at| [Cut::AtByte(at + word / 2), Cut::Unseen(at), Cut::Page(at)])
                .chain([Cut::AtByte(*len)])
                .collect(),
        }
    }

    /// The power goes at every operation of a start, and again in the next, of each start from the first to one in the second lap of the
    /// flash: the next start has a key, the one of before if there was one, and never counts fewer starts.
    #[test]
    fn a_power_cut_costs_no_key() {
        for (geometry, torn_reads_zero) in [(GEOMETRY, false), (WITH_ECC, false), (WITH_ECC, true)]
        {
            let mut flash = MockFlash::new(geometry);
            flash.torn_reads_zero = torn_reads_zero;
            let mut kept: Option<(u32, [u8; 32])> = None;
            let mut cuts = 0;
            while flash.erases.iter().sum::<u32>() < 4 {
                let mut dry = flash.clone();
                dry.power_up();
                BoardKey::open(&mut dry, seed(1)).unwrap();
                for (at, op) in dry.take_ops().iter().enumerate() {
                    for way in ways(op, geometry.write_size.max(16) as usize) {
                        let mut flash = flash.clone();
                        flash.power_up();
                        flash.cut_power_at(at, way, at as u64 + 1);
                        assert!(BoardKey::open(&mut flash, seed(2)).is_err());
                        flash.power_up();
                        // And in the next, at an operation that this number chooses.
                        let mut again = flash.clone();
                        BoardKey::open(&mut again, seed(5)).unwrap();
                        let again = again.take_ops();
                        let op = &again[cuts % again.len()];
                        let of = ways(op, geometry.write_size.max(16) as usize);
                        flash.cut_power_at(cuts % again.len(), of[cuts % of.len()], 7);
                        assert!(BoardKey::open(&mut flash, seed(6)).is_err());
                        flash.power_up();
                        let key = BoardKey::open(&mut flash, seed(3)).unwrap();
                        if let Some((boot, public)) = kept {
                            assert_eq!(key.public(), public, "{op:?}, {way:?}");
                            assert!((boot + 1..=boot + 3).contains(&key.boot()));
                        }
                        let again = BoardKey::open(&mut flash, seed(4)).unwrap();
                        assert_eq!(again.public(), key.public());
                        assert_eq!(again.boot(), key.boot() + 1);
                        cuts += 1;
                    }
                }
                let key = BoardKey::open(&mut flash, seed(1)).unwrap();
                kept = Some((key.boot(), key.public()));
            }
            assert!(cuts > 100, "{cuts}");
        }
    }

    /// Of a board that has started once, a bit of one of the two entries of its key, of the header in front of it, or the whole
    /// sector is damaged at rest: the key is there. Both are: there is none, and none is made in its place until a wipe.
    #[test]
    fn damage_makes_no_other_key() {
        for geometry in [GEOMETRY, WITH_ECC] {
            let mut flash = MockFlash::new(geometry);
            let public = BoardKey::open(&mut flash, seed(1)).unwrap().public();
            let size = geometry.sector_size as usize;
            for sector in [0, size] {
                for bit in (0..1600).step_by(7) {
                    let mut flash = flash.clone();
                    flash.data[sector + bit / 8] ^= 1 << (bit % 8);
                    let opened = BoardKey::open(&mut flash, seed(2));
                    assert_eq!(opened.unwrap().public(), public, "{sector} {bit}");
                    let again = BoardKey::open(&mut flash, seed(3));
                    assert_eq!(again.unwrap().public(), public, "{sector} {bit}");
                }
                for fill in [0, 0xFF] {
                    let mut flash = flash.clone();
                    flash.data[sector..sector + size].fill(fill);
                    let opened = BoardKey::open(&mut flash, seed(2));
                    assert_eq!(opened.unwrap().public(), public, "{sector} {fill}");
                }
            }
            for sector in [0, size] {
                flash.data[sector + 8] ^= 1;
            }
            assert!(BoardKey::open(&mut flash, seed(2)).is_err());
            let renewed = BoardKey::renew(&mut flash, seed(2)).unwrap().public();
            assert_ne!(renewed, public);
            // What can be read stays.
            let again = BoardKey::renew(&mut flash, seed(3)).unwrap().public();
            assert_eq!(again, renewed);
        }
    }
}
