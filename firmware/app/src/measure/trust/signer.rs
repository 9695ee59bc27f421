//! Who signs for the board, and what is known of what was signed.

use crate::measure::trust::bucket::Bucket;
use umi_core::trust::board_key::BoardKey;
use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;

/// Signs for the board.
#[derive(Debug)]
pub struct HeadSigner {
    key: BoardKey,
    image: [u8; 32],
}

impl HeadSigner {
    /// By this key. `image` is the first half of the SHA-512 of the image that runs; zeros: nobody has said.
    #[must_use]
    pub fn new(key: BoardKey, image: [u8; 32]) -> Self {
        Self { key, image }
    }

    /// The board's public key.
    #[must_use]
    pub fn key(&self) -> [u8; 32] {
        self.key.public()
    }

    /// Starts of the board so far, this one included.
    #[must_use]
    pub fn boot(&self) -> u32 {
        self.key.boot()
    }

    /// First half of the SHA-512 of the image that runs; zeros: nobody has said.
    #[must_use]
    pub fn image(&self) -> [u8; 32] {
        self.image
    }

    /// The Ed25519 signature of these bytes, R and S.
    #[must_use]
    pub fn sign(&self, bytes: &[u8]) -> [[u8; 32]; 2] {
        self.key.sign(bytes)
    }
}

/// What is known of heads. All zeros before the start.
pub(crate) struct Heads {
    pub signer: ZeroOption<&'static HeadSigner>,
    /// The nonce of a host that waits, and since when.
    pub asked: ZeroOption<([u8; 32], Micros)>,
    /// Entries before this one stand before a head, or were there at the start.
    pub since: u64,
    /// Entry `since` is a head.
    pub has_signed: bool,
    /// A start or a verdict has no head behind it.
    pub is_due: bool,
    /// When the latest input came.
    pub latest: Micros,
    /// How often strangers may ask for one over a new nonce: each is a piece of evidence, and they fill
    /// no megabyte of it within a week.
    turns: Bucket<8, 600_000_000>,
    /// How often those with a key may, and everybody while the board has no owner. Nobody else takes
    /// a turn of theirs.
    known_turns: Bucket<32, 10_000_000>,
    /// Who waits is no stranger.
    pub is_known: bool,
    /// The journal had no room for the one that was due, or could not be read.
    pub is_full: bool,
}

impl Heads {
    pub const fn new() -> Self {
        Self {
            signer: ZeroOption::empty(),
            asked: ZeroOption::empty(),
            since: 0,
            has_signed: false,
            is_due: false,
            latest: Micros(0),
            turns: Bucket::new(),
            known_turns: Bucket::new(),
            is_known: false,
            is_full: false,
        }
    }

    /// The board has started, with a key or without.
    pub fn start(&mut self, signer: Option<&'static HeadSigner>, now: Micros) {
        if let Some(signer) = signer {
            self.signer.put(signer);
            self.is_due = true;
            self.latest = now;
        }
    }

    /// A verdict is in the journal.
    pub fn judged(&mut self) {
        self.is_due = true;
    }

    /// The journal may have room for one again.
    pub fn has_room(&mut self) {
        self.is_full = false;
    }

    /// Entries before this one were there at the start.
    pub fn opened(&mut self, next_seq: u64) {
        self.since = next_seq;
    }

    /// Something came in.
    pub fn came(&mut self, now: Micros) {
        self.latest = now;
    }

    /// A host asks for one over this nonce: in its session or of an open board, or a stranger.
    pub fn ask(&mut self, nonce: [u8; 32], now: Micros, is_known: bool) {
        let is_taken = self.is_known && !is_known && self.asked.is_some();
        let mut may = || match is_known {
            true => self.known_turns.take(now),
            false => self.turns.take(now),
        };
        if !is_taken && !has_asked(&self.asked, &nonce) && may() {
            self.asked.put((nonce, now));
            self.is_full = false;
            self.is_known = is_known;
        }
    }
}

/// Whether a host has asked for this one already.
fn has_asked(asked: &ZeroOption<([u8; 32], Micros)>, nonce: &[u8; 32]) -> bool {
    asked.get().is_some_and(|(of, _)| of == nonce)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whoever asks without a key for one head after the other takes no turn of those who have one, and puts no nonce in
    /// the place of theirs. In eight hours there are few.
    #[test]
    fn a_stranger_takes_no_turn_of_a_key() {
        let mut heads = Heads::new();
        let mut taken = 0;
        for second in 0..8 * 3600_u64 {
            let mut nonce = [0; 32];
            nonce[..8].copy_from_slice(&second.to_le_bytes());
            heads.ask(nonce, Micros(second * 1_000_000), false);
            taken += u32::from(heads.asked.take().is_some());
        }
        assert_eq!(taken, 8 + 8 * 6 - 1);
        let now = Micros(8 * 3_600_000_000);
        heads.ask([201; 32], now, true);
        assert!(has_asked(&heads.asked, &[201; 32]));
        let later = Micros(now.0 + 600_000_000);
        heads.ask([202; 32], later, false);
        assert!(has_asked(&heads.asked, &[201; 32]));
        heads.asked.take();
        heads.ask([203; 32], later, false);
        assert!(has_asked(&heads.asked, &[203; 32]));
        heads.ask([204; 32], later, true);
        assert!(has_asked(&heads.asked, &[204; 32]));
    }
}
