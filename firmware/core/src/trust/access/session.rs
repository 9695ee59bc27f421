//! How a host proves its key to a board, and how frames are sealed after that. Both ends.
//!
//! # Design
//!
//! ```text
//! transcript = SHA-256( "openumi session v1\n" | schema key u64 LE | version u8 u8
//!                     | board's key | board's X25519 share | challenge
//!                     | host's key  | host's X25519 share )
//! host signs   "openumi session v1 host\n"  | transcript     (Ed25519)
//! board signs  "openumi session v1 board\n" | transcript
//! keys = HKDF-SHA-256( salt transcript, X25519 of the shares,
//!                      info "openumi session v1 keys\n", 64 bytes )
//!        the first half seals what the host sends, the second what the board sends
//! ```
//!
//! Shares and challenge are made anew for each session and used once; so nothing of one session is
//! good in another, on another board, or after a restart. The purpose and both keys are signed: a
//! proof for one board is none for another, and no head or image can be taken for one.
//!
//! The crates are `ed25519-dalek`, `x25519-dalek`, `hkdf`, `hmac` and `sha2`.
//!
//! # Limitations
//!
//! Frames are sealed, not encrypted: who listens reads. What a board reports unasked has no seal.

use ed25519_dalek::{Signature, Signer as _, SigningKey, VerifyingKey};
use hkdf::Hkdf;
use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::{Digest as _, Sha256};
use umi_protocol::access::{SessionAsk, SessionChallenge};
use umi_protocol::frame::{Authenticated, CODE};
use umi_protocol::hello::{KEY, VERSION};
use x25519_dalek::{PublicKey, StaticSecret};

/// A signature, R and S.
pub type SignatureParts = [[u8; 32]; 2];

/// What both ends have said before anything is proven.
fn transcript(ask: &SessionAsk, challenge: &SessionChallenge) -> [u8; 32] {
    let mut hash = Sha256::new();
    hash.update(b"openumi session v1\n");
    hash.update(KEY.to_le_bytes());
    hash.update([VERSION.major, VERSION.minor]);
    for part in [
        &challenge.board_key,
        &challenge.share,
        &challenge.challenge,
        &ask.key,
        &ask.share,
    ] {
        hash.update(part);
    }
    hash.finalize().into()
}

/// Whose signature it is.
#[derive(Clone, Copy)]
enum Side {
    Host,
    Board,
}

const TITLE: usize = 25;

/// What a side signs.
pub type ToSign = [u8; TITLE + 32];

/// What is signed. The shorter title ends with a zero.
fn signed(side: Side, transcript: &[u8; 32]) -> ToSign {
    let title: &[u8; TITLE] = match side {
        Side::Host => b"openumi session v1 host\n\0",
        Side::Board => b"openumi session v1 board\n",
    };
    let mut bytes = [0; TITLE + 32];
    let (first, last) = bytes.split_at_mut(TITLE);
    first.copy_from_slice(title);
    last.copy_from_slice(transcript);
    bytes
}

// The sums take kilobytes of the stack each: none stands on that of another.

#[inline(never)]
fn is_right(key: &[u8; 32], bytes: &[u8], [r, s]: SignatureParts) -> bool {
    let signature = Signature::from_components(r, s);
    VerifyingKey::from_bytes(key)
        .and_then(|key| key.verify_strict(bytes, &signature))
        .is_ok()
}

/// The keys of a session.
struct SessionKeys {
    from_host: [u8; 32],
    from_board: [u8; 32],
}

impl SessionKeys {
    /// None: the other side's share gives no secret.
    #[inline(never)]
    fn new(secret: &StaticSecret, share: &[u8; 32], transcript: &[u8; 32]) -> Option<Self> {
        let shared = secret.diffie_hellman(&PublicKey::from(*share));
        if !shared.was_contributory() {
            return None;
        }
        let mut bytes = [0; 64];
        let derived = Hkdf::<Sha256>::new(Some(transcript), shared.as_bytes());
        derived
            .expand(b"openumi session v1 keys\n", &mut bytes)
            .ok()?;
        let (mut from_host, mut from_board) = ([0; 32], [0; 32]);
        let (first, last) = bytes.split_at(32);
        from_host.copy_from_slice(first);
        from_board.copy_from_slice(last);
        Some(Self {
            from_host,
            from_board,
        })
    }
}

fn mac(key: &[u8; 32], of: &Authenticated<'_>) -> Option<Hmac<Sha256>> {
    // Every length of key is one.
    let mut mac = Hmac::<Sha256>::new_from_slice(key).ok()?;
    mac.update(&of.header);
    mac.update(&of.counter.to_le_bytes());
    mac.update(of.message);
    Some(mac)
}

fn code(key: &[u8; 32], of: &Authenticated<'_>) -> [u8; CODE] {
    let whole = mac(key, of).map(|mac| mac.finalize().into_bytes());
    let first = whole.and_then(|whole| whole.first_chunk().copied());
    first.unwrap_or_default()
}

/// Compares in constant time.
fn is_code(key: &[u8; 32], of: &Authenticated<'_>, given: &[u8; CODE]) -> bool {
    mac(key, of).is_some_and(|mac| mac.verify_truncated_left(given).is_ok())
}

/// What a board draws for one session.
pub struct BoardShare {
    challenge: [u8; 32],
    secret: StaticSecret,
    public: [u8; 32],
}

impl BoardShare {
    /// Of what was drawn. Takes as long as a signature.
    #[must_use]
    pub fn new(challenge: [u8; 32], secret: [u8; 32]) -> Self {
        let secret = StaticSecret::from(secret);
        Self {
            challenge,
            public: PublicKey::from(&secret).to_bytes(),
            secret,
        }
    }
}

/// A board that has been asked for a session and waits for the proof.
pub struct BoardHandshake {
    ask: SessionAsk,
    challenge: SessionChallenge,
    secret: StaticSecret,
}

impl BoardHandshake {
    /// Answers a host that asks.
    #[must_use]
    pub fn new(ask: &SessionAsk, board_key: [u8; 32], drawn: BoardShare) -> Self {
        let challenge = SessionChallenge {
            challenge: drawn.challenge,
            share: drawn.public,
            board_key,
        };
        Self {
            ask: *ask,
            challenge,
            secret: drawn.secret,
        }
    }

    /// What the host is to sign.
    #[must_use]
    pub const fn challenge(&self) -> &SessionChallenge {
        &self.challenge
    }

    /// The key that is to be proven.
    #[must_use]
    pub const fn key(&self) -> &[u8; 32] {
        &self.ask.key
    }

    /// Whether it is the answer to this, which has come again.
    #[must_use]
    pub fn answers(&self, ask: &SessionAsk) -> bool {
        self.ask == *ask
    }

    /// Looks at the proof: the session, and what the board is to sign; none: it is wrong. Either way
    /// the challenge is used up.
    #[must_use]
    pub fn prove(self, signature: SignatureParts) -> Option<(BoardSession, ToSign)> {
        let transcript = transcript(&self.ask, &self.challenge);
        if !is_right(&self.ask.key, &signed(Side::Host, &transcript), signature) {
            return None;
        }
        let keys = SessionKeys::new(&self.secret, &self.ask.share, &transcript)?;
        let session = BoardSession { keys, counter: 0 };
        Some((session, signed(Side::Board, &transcript)))
    }
}

/// The board's end of a session.
pub struct BoardSession {
    keys: SessionKeys,
    /// Of the newest frame.
    counter: u64,
}

impl BoardSession {
    /// Whether a frame is the host's, unchanged, and newer than every one before.
    pub fn takes(&mut self, of: &Authenticated<'_>, given: &[u8; CODE]) -> bool {
        let takes = of.counter > self.counter && is_code(&self.keys.from_host, of, given);
        if takes {
            self.counter = of.counter;
        }
        takes
    }

    /// The counter of the answer to the newest frame.
    #[must_use]
    pub const fn counter(&self) -> u64 {
        self.counter
    }

    /// The code of an answer.
    #[must_use]
    pub fn code(&self, of: &Authenticated<'_>) -> [u8; CODE] {
        code(&self.keys.from_board, of)
    }
}

/// A host that has asked for a session.
pub struct HostHandshake {
    ask: SessionAsk,
    secret: StaticSecret,
}

impl HostHandshake {
    /// Asks with this key; `secret` is drawn for it.
    #[must_use]
    pub fn new(key: &SigningKey, secret: [u8; 32]) -> Self {
        let secret = StaticSecret::from(secret);
        let ask = SessionAsk {
            key: key.verifying_key().to_bytes(),
            share: PublicKey::from(&secret).to_bytes(),
        };
        Self { ask, secret }
    }

    /// What the board is asked.
    #[must_use]
    pub const fn ask(&self) -> SessionAsk {
        self.ask
    }

    /// The proof, and the session that it opens if the board takes it.
    #[must_use]
    pub fn prove(
        self,
        key: &SigningKey,
        challenge: &SessionChallenge,
    ) -> Option<(SignatureParts, HostProof)> {
        let transcript = transcript(&self.ask, challenge);
        let signature = key.sign(&signed(Side::Host, &transcript));
        let keys = SessionKeys::new(&self.secret, &challenge.share, &transcript)?;
        let proof = HostProof {
            keys,
            board_key: challenge.board_key,
            signed: signed(Side::Board, &transcript),
        };
        Some(([*signature.r_bytes(), *signature.s_bytes()], proof))
    }
}

/// A host that has sent its proof.
pub struct HostProof {
    keys: SessionKeys,
    board_key: [u8; 32],
    signed: ToSign,
}

impl HostProof {
    /// The session, if the board has proven its key, too.
    #[must_use]
    pub fn open(self, signature: SignatureParts) -> Option<HostSession> {
        is_right(&self.board_key, &self.signed, signature).then_some(HostSession {
            keys: self.keys,
            board_key: self.board_key,
            counter: 0,
        })
    }
}

/// The host's end of a session.
pub struct HostSession {
    keys: SessionKeys,
    board_key: [u8; 32],
    counter: u64,
}

impl HostSession {
    /// The key that the board has proven.
    #[must_use]
    pub const fn board_key(&self) -> &[u8; 32] {
        &self.board_key
    }

    /// The counter of the next frame.
    pub fn count(&mut self) -> u64 {
        self.counter += 1;
        self.counter
    }

    /// The counter of the newest frame.
    #[must_use]
    pub const fn counter(&self) -> u64 {
        self.counter
    }

    /// The code of a request.
    #[must_use]
    pub fn code(&self, of: &Authenticated<'_>) -> [u8; CODE] {
        code(&self.keys.from_host, of)
    }

    /// Whether an answer is the board's, unchanged. Sequence numbers come again after 65 536
    /// requests: an answer that old would pass for the one to the newest request, and is none.
    #[must_use]
    pub fn is_answer(&self, of: &Authenticated<'_>, given: &[u8; CODE]) -> bool {
        let age = self.counter.checked_sub(of.counter);
        age.is_some_and(|age| age <= u64::from(u16::MAX))
            && is_code(&self.keys.from_board, of, given)
    }
}

#[cfg(test)]
mod tests;
