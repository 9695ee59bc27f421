//! A board with an owner, and whoever else reaches its port. The bytes say what happens next:
//! garbage; intact frames, with a seal or without; frames of the owner's, recorded and played again,
//! as they were or changed; one that was held back and comes behind a later one; the plug pulled;
//! the power gone; and the owner, who changes something. Held against what an owner relies on:
//!
//! * keys and lock are what his own requests made of them, each done once;
//! * his requests are taken at once, whatever was said between them, and his next session opens,
//!   whatever became of the last one.
//!
//! Frames and gate are the board's own; between them stands what the application does with the two
//! (`firmware/app/src/host/link.rs`).

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::board::{Memory, signer};
use crc::{CRC_32_ISO_HDLC, Crc};
use ed25519_dalek::SigningKey;
use umi_app::access::{Caller, Keeper, Work};
use umi_core::trust::access::permit::permit;
use umi_core::trust::access::session::{HostHandshake, HostSession, SignatureParts};
use umi_core::trust::board_key::{NoEntropy, key_id};
use umi_core::units::Micros;
use umi_protocol::access::{AccessMode, KeyInfo, KeyName, Role, SessionChallenge};
use umi_protocol::config::LockedReading;
use umi_protocol::decoder::Decoder;
use umi_protocol::frame::{Authenticated, CODE, MAX_HOST_FRAME, encode, encode_sealed};
use umi_protocol::immediate::SessionRequest;
use umi_protocol::message::Request;

/// One input.
pub fn one(data: &[u8]) {
    let mut scene = Scene::new(data);
    let mut rest = data;
    for _ in 0..STEPS {
        let Some((step, behind)) = rest.split_first() else {
            break;
        };
        rest = scene.step(*step, behind);
        scene.holds();
    }
    scene.owner_does(2);
    scene.holds();
}

/// Of one input: a session costs a millisecond.
const STEPS: usize = 24;
const SESSIONS: usize = 4;

fn secret(of: u8) -> &'static SigningKey {
    static KEYS: OnceLock<Vec<SigningKey>> = OnceLock::new();
    let keys = KEYS.get_or_init(|| (0..4).map(|of| SigningKey::from_bytes(&[of; 32])).collect());
    &keys[usize::from(of)]
}

/// Whose keys there are: the owner's, and one that he enrols and revokes.
const OWNER: u8 = 1;
const OTHER: u8 = 2;

fn key(of: u8, role: Role) -> KeyInfo {
    KeyInfo {
        public: secret(of).verifying_key().to_bytes(),
        role,
        name: KeyName::new(),
    }
}

/// Where the source begins for an input: with the same keys for all of them, a frame that the owner has sealed in one would be a
/// forged one in another.
fn seed(data: &[u8]) -> u64 {
    u64::from(Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(data)) << 16
}

/// A source that never gives the same twice; for an input always the same.
static DRAWN: AtomicU64 = AtomicU64::new(0);

fn draw(bytes: &mut [u8; 32]) -> Result<(), NoEntropy> {
    let drawn = DRAWN.fetch_add(1, Ordering::Relaxed) + 1;
    for (place, byte) in bytes.iter_mut().zip(drawn.to_le_bytes().iter().cycle()) {
        *place = byte ^ 0x5A;
    }
    Ok(())
}

type Gate = Keeper<Memory>;

fn open(memory: &Memory, jumper: fn() -> bool) -> Gate {
    Keeper::open(memory.clone(), jumper, signer(), draw, Micros(0))
}

/// The cells of a board that was claimed.
fn claimed() -> Vec<u8> {
    static CELLS: OnceLock<Vec<u8>> = OnceLock::new();
    let claim = || {
        let memory = Memory::erased(4, 4096);
        let mut gate = open(&memory, || true);
        let claims = Request::KeyEnrol(key(OWNER, Role::Owner));
        let kept = gate.change(Micros(0), &claims, &Caller::NOBODY, |_, _| true);
        assert_eq!(kept, Ok(true));
        memory.cells()
    };
    CELLS.get_or_init(claim).clone()
}

/// What a board has answered that its host needs.
#[derive(Default)]
struct Answers {
    challenge: Option<SessionChallenge>,
    open: Option<SignatureParts>,
    done: bool,
}

struct Scene {
    memory: Memory,
    gate: Gate,
    decoder: Decoder<MAX_HOST_FRAME>,
    now: u64,
    /// All that the owner has written.
    recorded: Vec<Vec<u8>>,
    session: Option<HostSession>,
    sessions: usize,
    sequence: u16,
    /// What the owner made of it.
    is_locked: bool,
    has_other: bool,
}

impl Scene {
    fn new(data: &[u8]) -> Self {
        let memory = Memory::of(claimed(), 4096);
        DRAWN.store(seed(data), Ordering::Relaxed);
        Self {
            gate: open(&memory, || false),
            memory,
            decoder: Decoder::new(),
            now: 0,
            recorded: Vec::new(),
            session: None,
            sessions: 0,
            sequence: 0,
            is_locked: false,
            has_other: false,
        }
    }

    /// Does what a byte says with those behind it; returns what it did not need.
    fn step<'a>(&mut self, step: u8, behind: &'a [u8]) -> &'a [u8] {
        self.now += 1 << (step >> 3);
        let (length, behind) = behind
            .split_first()
            .map_or((0, behind), |(n, rest)| (*n, rest));
        let (some, rest) = behind.split_at(behind.len().min(usize::from(length) % 96));
        match step % 8 {
            0 => _ = self.hears(some),
            1 => {
                // Each kind there is, in an intact frame of this schema.
                let frame = intact(some.first().map_or(0, |kind| kind % 8), some);
                self.hears(&frame);
                return rest;
            }
            2 => self.plays_again(length, None),
            3 => self.plays_again(length, Some(some)),
            4 => {
                self.owner_does(length);
                return behind;
            }
            5 => {
                // Held back: it comes behind a later one.
                self.seal(&Request::LockSet {
                    locked: !self.is_locked,
                });
                self.owner_does(length);
                return behind;
            }
            6 => {
                self.gate.disconnected();
                (self.session, self.decoder) = (None, Decoder::new());
                return behind;
            }
            _ => {
                self.gate = open(&self.memory, || false);
                (self.session, self.decoder) = (None, Decoder::new());
                return behind;
            }
        }
        rest
    }

    /// What the board does with bytes, as the application does it.
    fn hears(&mut self, mut bytes: &[u8]) -> Answers {
        let mut answers = Answers::default();
        let now = Micros(self.now);
        while let Some(frame) = self.decoder.next_frame(&mut bytes) {
            let (inner, caller) = match frame.unsealed() {
                None => (frame, Caller::NOBODY),
                Some((inner, authenticated, code)) => {
                    match self.gate.takes(now, &authenticated, code) {
                        Some(caller) => (inner, caller),
                        None => continue,
                    }
                }
            };
            let Ok(request) = inner.open::<Request>() else {
                continue;
            };
            let mode = self.gate.register().mode();
            assert_ne!(mode, AccessMode::Open);
            if permit(mode, caller.role, &request, LockedReading::Operators).is_err() {
                continue;
            }
            let asked = SessionRequest::of(&inner);
            let work = asked.and_then(|asked| self.gate.prepare(&asked));
            self.gate.prepared(work.map(Work::done));
            match &request {
                Request::SessionBegin(ask) => answers.challenge = self.gate.begin(now, ask).ok(),
                Request::SessionProve { .. } => {
                    let proven = self.gate.prove(now);
                    answers.open = proven.ok().map(|(_, signature)| signature);
                }
                _ => {
                    let changed = self.gate.change(now, &request, &caller, |_, _| true);
                    answers.done |= changed == Ok(true);
                }
            }
        }
        answers
    }

    /// Nobody but the owner has changed anything.
    fn holds(&self) {
        let register = self.gate.register();
        assert_eq!(register.mode() == AccessMode::Locked, self.is_locked);
        let mut expected = vec![key(OWNER, Role::Owner)];
        expected.extend(self.has_other.then(|| key(OTHER, Role::Engineer)));
        assert_eq!(register.keys()[..], expected);
    }

    /// A frame of the owner's again; with a change, made intact again.
    fn plays_again(&mut self, which: u8, change: Option<&[u8]>) {
        let Some(count) = self.recorded.len().checked_sub(1) else {
            return;
        };
        let frame = self.recorded[usize::from(which) % (count + 1)].clone();
        let frame = match change {
            None => frame,
            Some(change) => {
                let mut content = cobs::decode_vec(&frame[1..frame.len() - 1]).expect("a frame");
                content.truncate(content.len() - 4);
                for pair in change.chunks_exact(2) {
                    let at = usize::from(pair[0]) % content.len();
                    content[at] ^= pair[1];
                }
                sealed_off(content)
            }
        };
        let is_again = self.recorded.contains(&frame);
        // A session that the owner has not used since, begun again by his own frames, is his: he
        // is the only one who can go on with it. Nothing else comes of it.
        let answers = self.hears(&frame);
        assert!(answers.open.is_none() && !answers.done, "{is_again}");
    }

    /// The owner's next frame.
    fn seal(&mut self, request: &Request) -> Vec<u8> {
        self.in_session();
        let session = self.session.as_mut().expect("a session");
        let counter = session.count();
        let code = |of: &Authenticated<'_>| -> [u8; CODE] { session.code(of) };
        self.sequence = self.sequence.wrapping_add(1);
        let mut out = [0; MAX_HOST_FRAME];
        let frame = encode_sealed(self.sequence, request, counter, &code, &mut out);
        let frame = frame.expect("a short request").to_vec();
        self.recorded.push(frame.clone());
        frame
    }

    fn says(&mut self, request: &Request) -> Answers {
        self.sequence = self.sequence.wrapping_add(1);
        let mut out = [0; MAX_HOST_FRAME];
        let frame = encode(self.sequence, request, &mut out).expect("a short request");
        self.recorded.push(frame.to_vec());
        self.hears(frame)
    }

    /// The owner proves his key, if he has no session.
    fn in_session(&mut self) {
        if self.session.is_some() {
            return;
        }
        self.sessions += 1;
        let mut drawn = [0; 32];
        draw(&mut drawn).expect("it always gives some");
        let host = HostHandshake::new(secret(OWNER), drawn);
        let asked = self.says(&Request::SessionBegin(host.ask()));
        let challenge = asked
            .challenge
            .expect("a known key is asked to prove itself");
        let (signature, proof) = host
            .prove(secret(OWNER), &challenge)
            .expect("shares differ");
        let proven = self.says(&Request::SessionProve { signature });
        let signature = proven.open.expect("a right proof opens a session");
        self.session = Some(
            proof
                .open(signature)
                .expect("the board proves its key, too"),
        );
    }

    /// The owner does one of his deeds, and it is done.
    fn owner_does(&mut self, which: u8) {
        if self.session.is_none() && self.sessions >= SESSIONS {
            return;
        }
        let request = match which % 4 {
            0 | 1 => Request::LockSet {
                locked: !self.is_locked,
            },
            2 if self.has_other => Request::KeyRevoke {
                key_id: key_id(&key(OTHER, Role::Engineer).public),
            },
            _ => Request::KeyEnrol(key(OTHER, Role::Engineer)),
        };
        let frame = self.seal(&request);
        let is_for_the_locked = matches!(request, Request::LockSet { .. });
        let answers = self.hears(&frame);
        assert_eq!(answers.done, is_for_the_locked || !self.is_locked);
        if !answers.done {
            return;
        }
        match request {
            Request::LockSet { locked } => self.is_locked = locked,
            Request::KeyEnrol(_) => self.has_other = true,
            _ => self.has_other = false,
        }
    }
}

/// A frame of this schema around a kind and a payload.
fn intact(kind: u8, payload: &[u8]) -> Vec<u8> {
    let mut content = vec![kind, 7, 0];
    content.extend((umi_protocol::hello::KEY as u32).to_le_bytes());
    content.extend(payload.iter().skip(1));
    sealed_off(content)
}

/// With check value and delimiters.
fn sealed_off(mut content: Vec<u8>) -> Vec<u8> {
    let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&content);
    content.extend(crc.to_le_bytes());
    let mut frame = vec![0];
    frame.extend(cobs::encode_vec(&content));
    frame.push(0);
    frame
}
