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
    /// How often a host may ask for one over a new nonce: each is a piece of evidence.
    turns: Bucket<32, 10_000_000>,
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

    /// Entries before this one were there at the start.
    pub fn opened(&mut self, next_seq: u64) {
        self.since = next_seq;
    }

    /// Something came in.
    pub fn came(&mut self, now: Micros) {
        self.latest = now;
    }

    /// A host asks for one over this nonce.
    pub fn ask(&mut self, nonce: [u8; 32], now: Micros) {
        if !self.has_asked(&nonce) && self.turns.take(now) {
            self.asked.put((nonce, now));
        }
    }

    /// Whether a host has asked for this one already.
    fn has_asked(&self, nonce: &[u8; 32]) -> bool {
        self.asked.get().is_some_and(|(of, _)| of == nonce)
    }
}
