//! Who signs for the board, and what is known of what was signed.

use crate::measure::trust::bucket::Bucket;
use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;

/// Signs for the board.
pub trait HeadSigner: Sync {
    /// The board's public key.
    fn key(&self) -> [u8; 32];

    /// Starts of the board so far, this one included.
    fn boot(&self) -> u32;

    /// SHA-256 of the image that runs; zeros: nobody has said.
    fn image(&self) -> [u8; 32] {
        [0; 32]
    }

    /// The Ed25519 signature of these bytes, R and S.
    fn sign(&self, bytes: &[u8]) -> [[u8; 32]; 2];
}

/// What is known of heads. All zeros before the start.
pub(crate) struct Heads {
    pub signer: ZeroOption<&'static dyn HeadSigner>,
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
    pub fn start(&mut self, signer: Option<&'static dyn HeadSigner>, now: Micros) {
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
