//! A long shift on a board with an owner, at random: clampings, noise and floods at both ports, hosts that
//! go in the middle of a frame, strangers with and without a key, resets at any moment, updates that
//! confirm themselves and that do not. Somebody pulls the journal from time to time, acknowledges what he
//! has, and counts in the end: no piece of evidence that the board has ever signed for is missing, the file
//! is the board's word from its first start on, no verdict that anybody saw is absent, and nothing was
//! changed but by the owner.
//!
//! The virtual board's shifts are in `tests/tests/keep/soak.rs`, those of the emulated boards in
//! `tests/tests/boards/soak.rs`.
#![allow(
    clippy::missing_panics_doc,
    reason = "the half of tests: it panics where a test would"
)]

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use umi_client::board::link::{Client, LinkError, Patience};
use umi_client::files::image_file;
use umi_client::files::key_file::SigningKey;
use umi_client::journal::verify::verify;
use umi_client::journal::{self, Begun, FileItem, PullRequest, PullStep};
use umi_client::problem::Problem;
use umi_protocol::access::{AccessMode, KeyInfo, KeyName, Role};
use umi_protocol::frame::{MAX_HOST_FRAME, encode};
use umi_protocol::head::Head;
use umi_protocol::message::{Record, Request};
use umi_protocol::program::MAX_PIECE;
use umi_protocol::update::{ImageInfo, UpdateState};

use crate::cases::{DC1, clamping, job, patience};
use crate::rig::{PicoRig, QemuRig, Rig, VirtualRig};

/// Nothing that is waited for takes so long on the wall.
const HANGS: Duration = Duration::from_secs(900);

/// How much of each there is at once: an emulated board's second is many of the wall's.
#[derive(Clone, Copy, Debug)]
pub struct Amounts {
    /// Lines of noise, as a power of two, at most.
    pub noise_log2: usize,
    /// Bytes of garbage at the host's port, as a power of two, at most.
    pub garbage_log2: usize,
    /// Pairs of questions without a pause, at most.
    pub questions: usize,
    /// A time in which nothing happens, at most.
    pub pause: Duration,
    /// How long a verdict is waited for: behind noise there is none, sometimes.
    pub verdict: Duration,
}

/// A board that a shift can be worked on. It has a key, its jumper was closed when it started, and it takes
/// images of [`maker`] or none.
pub trait SoakRig: Rig {
    /// How much of each it is given at once.
    const AMOUNTS: Amounts;
    /// As what it takes images, with a payload of text; none: it takes none.
    const IMAGES: Option<&'static str>;

    /// Closes the owner's jumper, or opens it.
    fn close_jumper(&mut self, is_closed: bool);

    /// How often it has started, where starts by itself must be waited for.
    fn starts(&mut self) -> usize {
        0
    }

    /// Waits until it has started so often.
    fn wait_for_starts(&mut self, starts: usize) {
        let _ = starts;
    }

    /// Memory that it has taken so far, bytes, and what it may take; none where that cannot be seen.
    fn memory(&mut self) -> Option<(u64, u64)> {
        let (stack, most) = self.stack_bytes()?;
        Some((u64::from(stack), u64::from(most)))
    }
}

impl SoakRig for VirtualRig {
    const AMOUNTS: Amounts = Amounts {
        noise_log2: 12,
        garbage_log2: 15,
        questions: 500,
        pause: Duration::from_secs(180),
        verdict: Duration::from_secs(100),
    };
    const IMAGES: Option<&'static str> = Some("virtual");

    fn close_jumper(&mut self, is_closed: bool) {
        self.close_jumper(is_closed);
    }
}

impl SoakRig for QemuRig {
    const AMOUNTS: Amounts = Amounts {
        noise_log2: 7,
        garbage_log2: 13,
        questions: 200,
        pause: Duration::from_secs(2),
        verdict: Duration::from_secs(2),
    };
    const IMAGES: Option<&'static str> = Some("mps2-an500");

    fn close_jumper(&mut self, is_closed: bool) {
        self.close_jumper(is_closed);
    }

    fn starts(&mut self) -> usize {
        QemuRig::starts(self)
    }

    fn wait_for_starts(&mut self, starts: usize) {
        self.wait_for_starts(starts);
    }
}

/// Without its boot loader, which takes no images of text.
impl SoakRig for PicoRig {
    const AMOUNTS: Amounts = Amounts {
        noise_log2: 6,
        garbage_log2: 12,
        questions: 50,
        pause: Duration::from_millis(500),
        verdict: Duration::from_secs(1),
    };
    const IMAGES: Option<&'static str> = None;

    fn close_jumper(&mut self, is_closed: bool) {
        self.close_jumper(is_closed);
    }
}

const OWNER: u8 = 1;
const STRANGER: u8 = 7;
const MAKER: u8 = 9;

fn secret(of: u8) -> SigningKey {
    SigningKey::from_bytes(&[of; 32])
}

/// The public key of who makes images.
#[must_use]
pub fn maker() -> [u8; 32] {
    secret(MAKER).verifying_key().to_bytes()
}

/// Numbers that look random, the same in each run (Marsaglia, xorshift64*).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        ((self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33) % end as u64) as usize
    }

    fn bytes(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| self.below(256) as u8).collect()
    }
}

/// What was pulled so far.
#[derive(Debug, Default)]
pub struct Pulled {
    /// The journal as a file.
    pub file: Vec<u8>,
    begun: Option<Begun>,
    head: Option<Head>,
    /// Numbers of the entries that are evidence.
    pub evidence: BTreeSet<u64>,
    /// Verdicts in it.
    pub verdicts: u64,
    /// Corrections that went out.
    pub corrections: u64,
    /// What became of updates.
    pub updates: u64,
    /// The board's starts.
    pub starts: u64,
}

/// What was done.
#[derive(Debug, Default)]
#[allow(missing_docs, reason = "names that say it")]
pub struct Tally {
    pub clampings: u64,
    /// Verdicts that the board told of before the power went.
    pub verdicts_seen: u64,
    pub lines_of_noise: u64,
    pub garbage_bytes: u64,
    pub requests: u64,
    pub broken_off: u64,
    pub strangers: u64,
    pub resets: u64,
    pub updates_confirmed: u64,
    pub updates_reverted: u64,
    pub pulls: u64,
    pub pulls_that_failed: u64,
    /// The most memory that the board was seen to take; 0: not seen.
    pub memory_bytes: u64,
}

/// What can happen.
#[derive(Clone, Copy, Debug)]
enum Step {
    Clamps,
    Noise,
    Garbage,
    Flood,
    BreaksOff,
    Stranger,
    Resets,
    Update,
    Pull,
    Pause,
}

use Step::{BreaksOff, Clamps, Flood, Garbage, Noise, Pause, Pull, Resets, Stranger, Update};

/// Each of them, and a few clampings.
const EACH: [Step; 12] = [
    Clamps, Clamps, Clamps, Noise, Garbage, Flood, BreaksOff, Stranger, Resets, Update, Pull, Pause,
];

/// A board at work.
pub struct Shift<R> {
    rig: R,
    random: Random,
    /// What was pulled of its journal.
    pub pulled: Pulled,
    /// What was done to it.
    pub tally: Tally,
    image: u16,
}

impl<R: SoakRig> Shift<R> {
    /// Claims the board; its jumper is closed. What comes follows from the seed.
    pub fn new(rig: R, seed: u64) -> Self {
        let mut shift = Self {
            rig,
            random: Random(seed),
            pulled: Pulled::default(),
            tally: Tally::default(),
            image: 0,
        };
        let owner = KeyInfo {
            public: secret(OWNER).verifying_key().to_bytes(),
            role: Role::Owner,
            name: KeyName::new(),
        };
        let mut client = shift.client().unwrap();
        assert!(client.key_enrol(&owner).unwrap());
        drop(client);
        shift.owner().set_job(&job()).unwrap().unwrap();
        shift.rig.close_jumper(false);
        shift.power_cycle();
        shift
    }

    /// The board.
    pub fn rig(&mut self) -> &mut R {
        &mut self.rig
    }

    fn client(&mut self) -> Result<Client, LinkError> {
        let answer = patience(&self.rig, Duration::from_secs(5));
        Client::with_patience(self.rig.connect(), Patience { answer, tries: 3 })
    }

    /// A session of the owner's: it opens at once, whatever was before.
    fn owner(&mut self) -> Client {
        let begun = Instant::now();
        loop {
            let opened = self.client().and_then(|mut client| {
                client.authenticate(&secret(OWNER))?;
                Ok(client)
            });
            match opened {
                Ok(client) => return client,
                // It starts anew with an image.
                Err(error) => assert!(begun.elapsed() < HANGS, "no session: {error}"),
            }
        }
    }

    /// The power goes and comes back, now.
    fn power_cycle(&mut self) {
        self.tally.verdicts_seen += self.verdicts();
        self.looks_at_memory();
        self.rig.power_cycle();
    }

    /// How many the board tells of since its start.
    fn verdicts(&mut self) -> u64 {
        let status = self.client().and_then(|mut client| client.status());
        status.map_or(0, |status| u64::from(status.verdicts))
    }

    fn looks_at_memory(&mut self) {
        if let Some((bytes, most)) = self.rig.memory() {
            assert!(bytes <= most, "{bytes} of {most} bytes: {:?}", self.tally);
            self.tally.memory_bytes = self.tally.memory_bytes.max(bytes);
        }
    }

    /// Works until it is so late for the board. `told` is called behind each step.
    pub fn works_until(&mut self, end: Duration, mut told: impl FnMut(&mut Self)) {
        while self.rig.time() < end {
            let step = match self.random.below(20) {
                0..6 => Clamps,
                6..10 => Noise,
                10 | 11 => Garbage,
                12 => Flood,
                13 => BreaksOff,
                14 => Stranger,
                15 if self.random.below(3) == 0 => Resets,
                16 if self.random.below(4) == 0 => Update,
                17 | 18 => Pull,
                _ => Pause,
            };
            self.step(step);
            told(self);
        }
    }

    /// Does each thing once, and a few clampings, in any order.
    pub fn does_each(&mut self) {
        let mut due = EACH.to_vec();
        while !due.is_empty() {
            let next = self.random.below(due.len());
            let step = due.swap_remove(next);
            self.step(step);
        }
    }

    fn step(&mut self, step: Step) {
        match step {
            Clamps => self.clamps(),
            Noise => self.noise(),
            Garbage => self.garbage(),
            Flood => self.flood(),
            BreaksOff => self.breaks_off(),
            Stranger => self.stranger(),
            Resets => self.resets(),
            Update => self.update(),
            Pull => _ = self.pull(),
            Pause => {
                let most = R::AMOUNTS.pause.as_millis() as usize;
                let pause = Duration::from_millis(self.random.below(most) as u64);
                self.waits(pause, |_| false);
            }
        }
    }

    /// Waits so long by the board's clock, or until it is so.
    fn waits(&mut self, most: Duration, mut is_so: impl FnMut(&mut Self) -> bool) {
        let end = self.rig.time() + most;
        while self.rig.time() < end && !is_so(self) {
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// A clamping, and what the control reads of it.
    fn clamps(&mut self) {
        self.tally.clampings += 1;
        let Ok(mut client) = self.client() else {
            return;
        };
        let Ok(before) = client.status() else { return };
        let text = "\r\nREAD O9010\r\n".to_owned() + &clamping(self.random.below(5));
        self.rig.control_sends(text.as_bytes());
        self.waits(R::AMOUNTS.verdict, |shift| {
            shift.tally.requests += 1;
            shift.drain();
            !client
                .status()
                .is_ok_and(|now| now.verdicts == before.verdicts)
        });
        self.rig.control_sends(DC1);
        self.drain();
    }

    fn drain(&mut self) {
        while self
            .rig
            .control_receives(Duration::from_millis(5))
            .is_some()
        {}
    }

    /// What no control prints.
    fn noise(&mut self) {
        let count = 1 << self.random.below(R::AMOUNTS.noise_log2 + 1);
        for _ in 0..count {
            let line = match self.random.below(3) {
                0 => b"x\r\n".to_vec(),
                1 => {
                    let length = 1 + self.random.below(60);
                    [self.random.bytes(length), b"\r\n".to_vec()].concat()
                }
                _ => b"POINT: 1.0 2.0\r\n".to_vec(),
            };
            self.rig.control_sends(&line);
        }
        self.tally.lines_of_noise += count;
        self.drain();
    }

    fn garbage(&mut self) {
        let count = 1 << self.random.below(R::AMOUNTS.garbage_log2 + 1);
        let bytes = self.random.bytes(count);
        let _ = self.rig.connect().write(&bytes);
        self.tally.garbage_bytes += count as u64;
    }

    /// Questions without a pause.
    fn flood(&mut self) {
        let Ok(mut client) = self.client() else {
            return;
        };
        for _ in 0..self.random.below(R::AMOUNTS.questions) {
            if client.status().is_err() || client.positions().is_err() {
                return;
            }
            self.tally.requests += 2;
        }
    }

    /// A host that goes in the middle of a frame.
    fn breaks_off(&mut self) {
        let mut out = [0; MAX_HOST_FRAME];
        let frame = encode(1, &Request::JobSet(job()), &mut out).unwrap();
        let end = self.random.below(frame.len());
        let _ = self.rig.connect().write(&frame[..end]);
        self.rig.unplug();
        self.tally.broken_off += 1;
    }

    /// Somebody without a key, and with a wrong one.
    fn stranger(&mut self) {
        self.tally.strangers += 1;
        if let Ok(mut client) = self.client() {
            let mut other = job();
            other.features.truncate(1);
            assert!(client.set_job(&other).is_err());
            assert!(client.lock(true).is_err());
        }
        if let Ok(mut client) = self.client() {
            assert!(client.authenticate(&secret(STRANGER)).is_err());
            assert!(client.journal_ack(1).is_err());
        }
    }

    /// At any moment: in the middle of a clamping, of noise, of nothing.
    fn resets(&mut self) {
        match self.random.below(3) {
            0 => {
                let text = clamping(0);
                let end = self.random.below(text.len());
                self.rig.control_sends(&text.as_bytes()[..end]);
            }
            1 => self.noise(),
            _ => {}
        }
        self.tally.resets += 1;
        self.power_cycle();
    }

    /// An image that confirms itself, or not; one of a stranger is refused.
    fn update(&mut self) {
        let Some(board) = R::IMAGES else {
            return;
        };
        let confirms = self.random.below(3) > 0;
        let payload = format!("umi-virtual-image\nconfirms = {confirms}\n");
        let version = [1, self.image + 1, 0];
        let counter = u32::from(self.image) + 1;
        let image = |by| {
            let signed = image_file::sign(payload.as_bytes(), board, version, counter, &secret(by));
            signed.unwrap().1
        };
        let (starts, verdicts) = (self.rig.starts(), self.verdicts());
        if self.send(&image(STRANGER)) || !self.send(&image(MAKER)) {
            // Never the stranger's; the maker's not while something is under way.
            let runs = self.image_info().version;
            assert!(runs <= [1, self.image, 0], "{runs:?}");
            return;
        }
        self.tally.verdicts_seen += verdicts;
        // To try it, and to go back.
        self.rig
            .wait_for_starts(starts + if confirms { 1 } else { 2 });
        let begun = Instant::now();
        let latest = loop {
            std::thread::sleep(Duration::from_millis(50));
            let latest = self.image_info().latest;
            if latest != UpdateState::Trial {
                break latest;
            }
            assert!(begun.elapsed() < HANGS, "the trial does not end");
        };
        assert_eq!(latest == UpdateState::Confirmed, confirms);
        if confirms {
            self.image += 1;
            self.tally.updates_confirmed += 1;
        } else {
            self.tally.updates_reverted += 1;
        }
    }

    fn image_info(&mut self) -> ImageInfo {
        let begun = Instant::now();
        loop {
            if let Ok(Some(info)) = self.owner().image() {
                return info;
            }
            assert!(begun.elapsed() < HANGS, "the board does not come back");
        }
    }

    /// Whether the board has taken it to its end.
    fn send(&mut self, image: &[u8]) -> bool {
        let mut client = self.owner();
        let (header, payload) = image.split_first_chunk().unwrap();
        let Ok(Ok(_)) = client.update_begin(header) else {
            return false;
        };
        let mut at = 0;
        while at < payload.len() {
            let piece = payload[at..].iter().take(MAX_PIECE).copied().collect();
            match client.update_piece(at as u32, piece) {
                Ok(Ok(next)) => at = next as usize,
                _ => return false,
            }
        }
        matches!(client.update_end(), Ok(Ok(())))
    }

    /// All that is new, and that it is kept now; false: not this time.
    fn pull(&mut self) -> bool {
        self.tally.pulls += 1;
        let mut client = self.owner();
        let wanted = PullRequest {
            begun: self.pulled.begun,
            head: true,
            ..PullRequest::default()
        };
        let mut items = Vec::new();
        let pulled = journal::pull(&mut client, wanted, |step| {
            match step {
                PullStep::Header(..) => {}
                PullStep::Gap(gap) => items.extend(gap.encode()),
                PullStep::Entry(_, raw) => items.extend(raw),
            }
            Ok::<_, Problem>(())
        });
        let pulled = match pulled {
            Ok(pulled) if pulled.head.is_some() && pulled.unsigned.is_none() => pulled,
            Ok(_) => {
                self.tally.pulls_that_failed += 1;
                return false;
            }
            Err(problem) => {
                // A link that is gone is; a journal that contradicts itself is a defect.
                let defects = [
                    "entry_damaged",
                    "entries_missing",
                    "chain_broken",
                    "head_signature",
                    "other_journal",
                ];
                assert!(!defects.contains(&problem.code), "{problem:?}");
                self.tally.pulls_that_failed += 1;
                return false;
            }
        };
        let begins = pulled.header.encode();
        match self.pulled.file.is_empty() {
            true => self.pulled.file.extend(begins),
            // With the nonce of the newest head.
            false => self.pulled.file[..begins.len()].copy_from_slice(&begins),
        }
        self.pulled.file.extend(&items);
        self.pulled.begun = Some(Begun {
            header: pulled.header,
            next: pulled.stretch.next,
            chain: pulled.stretch.chain,
        });
        let next = pulled.stretch.next;
        self.pulled.head = pulled.head;
        let _ = client.journal_ack(next);
        true
    }

    /// What must hold of all that was pulled.
    fn counts(&mut self) {
        let head = self.pulled.head.clone().unwrap();
        let verified = verify(&self.pulled.file, Some(head.key), None).unwrap();
        assert!(verified.signed);
        assert_eq!(verified.stretch.first, 0);
        let found = &mut self.pulled;
        journal::read::<Problem>(&found.file, |item| {
            if let FileItem::Entry(entry) = item {
                match journal::record(&entry).unwrap() {
                    Record::Verdict(_) => found.verdicts += 1,
                    Record::CorrectionSent { .. } => found.corrections += 1,
                    Record::Update { .. } => found.updates += 1,
                    Record::Boot { .. } => found.starts += 1,
                    _ => {}
                }
                if Record::is_evidence(entry.kind) && entry.seq < head.seq {
                    found.evidence.insert(entry.seq);
                }
            }
            Ok(())
        })
        .unwrap();
        // Pieces of evidence are numbered without a gap from the first start on.
        let signed_for = head.evidence.as_ref().unwrap().next;
        assert_eq!(found.evidence.len() as u64, signed_for, "evidence was lost");
    }

    /// Whatever happened: what the owner has set is as he has set it, he can still work, and nothing that the
    /// board has signed for is missing.
    pub fn ends(&mut self) {
        let mut owner = self.owner();
        assert_eq!(owner.access().unwrap().mode, AccessMode::Claimed);
        assert_eq!(owner.keys().unwrap().len(), 1);
        assert_eq!(owner.job().unwrap().job, Some(job()));
        self.tally.verdicts_seen += u64::from(owner.status().unwrap().verdicts);
        drop(owner);
        self.drain();
        let ended = Instant::now();
        while !self.pull() {
            assert!(
                ended.elapsed() < HANGS,
                "no pull succeeds: {:?}",
                self.tally
            );
            self.drain();
        }
        self.looks_at_memory();
        self.counts();
        let (pulled, tally) = (&self.pulled, &self.tally);
        println!(
            "{}: {:?}{}; {tally:?}; pulled: {} bytes, {} pieces of evidence, {} verdicts, {} corrections, {} starts, {} of updates",
            self.rig.name(),
            self.rig.time(),
            if self.rig.has_own_time() {
                " of the board's time"
            } else {
                " by the rig"
            },
            pulled.file.len(),
            pulled.evidence.len(),
            pulled.verdicts,
            pulled.corrections,
            pulled.starts,
            pulled.updates,
        );
        assert!(pulled.verdicts >= tally.verdicts_seen, "a verdict was lost");
        assert!(pulled.starts > tally.resets, "a start was lost");
    }
}
