//! A long shift on a virtual board with an owner, at random: clampings, noise and floods at both
//! ports, hosts that go in the middle of a frame, strangers with and without a key, resets at any
//! moment, updates that confirm themselves and that do not. The board's clock runs a hundred times
//! as fast as the wall's. Somebody pulls the journal from time to time, acknowledges what he has,
//! and counts in the end: no piece of evidence that the board has ever signed for is missing, the
//! file is the board's word from its first start on, no verdict that anybody saw is absent, and
//! nothing was changed but by the owner.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use umi_client::board::link::Client;
use umi_client::files::image_file;
use umi_client::files::key_file::SigningKey;
use umi_client::journal::verify::verify;
use umi_client::journal::{self, Begun, FileItem, PullRequest, PullStep};
use umi_client::problem::Problem;
use umi_core::journal::Geometry;
use umi_core::units::Micros;
use umi_protocol::access::{AccessMode, KeyInfo, KeyName, Role};
use umi_protocol::frame::{MAX_HOST_FRAME, encode};
use umi_protocol::head::Head;
use umi_protocol::message::{Record, Request};
use umi_protocol::program::MAX_PIECE;
use umi_protocol::update::{ImageInfo, UpdateState};
use umi_tests::cases::{DC1, clamping, job};
use umi_virtual::board::KEY;
use umi_virtual::{Config, VirtualBoard, VirtualFlash};

/// How far the board's clock goes on in a millisecond of the wall's.
const TURN_US: u64 = 100_000;

/// A journal of 256 KB: some noise is a lap of it.
const SMALL: Geometry = Geometry {
    sectors: 16,
    sector_size: 16_384,
    write_size: 1,
    page_size: 256,
};

/// Nothing that is waited for takes so long on the wall.
const HANGS: Duration = Duration::from_secs(120);

fn secret(of: u8) -> SigningKey {
    SigningKey::from_bytes(&[of; 32])
}

const OWNER: u8 = 1;
const STRANGER: u8 = 7;
const MAKER: u8 = 9;

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

/// A board that is switched on, and its clock.
struct Running {
    board: Arc<VirtualBoard>,
    ends: Arc<AtomicBool>,
    clock: Option<JoinHandle<()>>,
}

impl Running {
    fn start(config: &Config) -> Self {
        let board = Arc::new(VirtualBoard::start(config.clone()).unwrap());
        let ends = Arc::new(AtomicBool::new(false));
        let (its_board, its_end) = (Arc::clone(&board), Arc::clone(&ends));
        let clock = std::thread::spawn(move || {
            while !its_end.load(Ordering::Relaxed) {
                its_board.advance(Micros(its_board.now().0 + TURN_US));
                std::thread::sleep(Duration::from_millis(1));
            }
        });
        Self {
            board,
            ends,
            clock: Some(clock),
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(clock) = self.clock.take() {
            clock.join().unwrap();
        }
    }
}

/// What was pulled so far.
#[derive(Default)]
struct Pulled {
    file: Vec<u8>,
    begun: Option<Begun>,
    head: Option<Head>,
    evidence: BTreeSet<u64>,
    verdicts: u64,
    corrections: u64,
    updates: u64,
    starts: u64,
}

/// What was done.
#[derive(Debug, Default)]
struct Tally {
    clampings: u64,
    /// Verdicts that the board told of before the power went.
    verdicts_seen: u64,
    lines_of_noise: u64,
    garbage_bytes: u64,
    requests: u64,
    strangers: u64,
    resets: u64,
    updates_confirmed: u64,
    updates_reverted: u64,
    pulls: u64,
    pulls_that_failed: u64,
}

struct Shift {
    config: Config,
    running: Option<Running>,
    random: Random,
    pulled: Pulled,
    tally: Tally,
    /// Of the board's clock, in the starts that have ended.
    passed_us: u64,
    image: u16,
}

impl Shift {
    fn new(seed: u64) -> Self {
        let config = Config {
            key: Some(VirtualFlash::in_memory(KEY)),
            journal: VirtualFlash::in_memory(SMALL),
            firmware_key: Some(secret(MAKER).verifying_key().to_bytes()),
            jumper: true,
            ..Config::default()
        };
        let mut shift = Self {
            running: Some(Running::start(&config)),
            config,
            random: Random(seed),
            pulled: Pulled::default(),
            tally: Tally::default(),
            passed_us: 0,
            image: 0,
        };
        let owner = KeyInfo {
            public: secret(OWNER).verifying_key().to_bytes(),
            role: Role::Owner,
            name: KeyName::new(),
        };
        let mut client = umi_desk::client(shift.board()).unwrap();
        assert!(client.key_enrol(&owner).unwrap());
        shift.owner().set_job(&job()).unwrap().unwrap();
        // The jumper is opened again.
        shift.config.jumper = false;
        shift.reset();
        shift
    }

    fn board(&self) -> &VirtualBoard {
        &self.running.as_ref().unwrap().board
    }

    fn now_us(&self) -> u64 {
        self.passed_us + self.board().now().0
    }

    /// A session of the owner's: it opens at once, whatever was before.
    fn owner(&self) -> Client {
        let begun = Instant::now();
        loop {
            let client = umi_desk::client(self.board());
            let opened = client.and_then(|mut client| {
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
    fn reset(&mut self) {
        if let Ok(mut client) = umi_desk::client(self.board())
            && let Ok(status) = client.status()
        {
            self.tally.verdicts_seen += u64::from(status.verdicts);
        }
        self.passed_us += self.board().now().0;
        drop(self.running.take());
        self.running = Some(Running::start(&self.config));
    }

    fn step(&mut self) {
        match self.random.below(20) {
            0..6 => self.clamps(),
            6..10 => self.noise(),
            10 | 11 => self.garbage(),
            12 => self.flood(),
            13 => self.breaks_off(),
            14 => self.stranger(),
            15 if self.random.below(3) == 0 => self.resets(),
            16 if self.random.below(4) == 0 => self.update(),
            17 | 18 => _ = self.pull(),
            // Nothing, for up to three minutes.
            _ => {
                let until = self.board().now().0 + 1_000_000 * self.random.below(180) as u64;
                while self.board().now().0 < until {
                    std::thread::sleep(Duration::from_millis(5));
                }
            }
        }
    }

    /// A clamping, and what the control reads of it.
    fn clamps(&mut self) {
        self.tally.clampings += 1;
        let Ok(mut client) = umi_desk::client(self.board()) else {
            return;
        };
        let Ok(before) = client.status() else { return };
        let text = "\r\nREAD O9010\r\n".to_owned() + &clamping(self.random.below(5));
        self.board().control_sends(text.as_bytes());
        let begun = Instant::now();
        // Behind noise there is none, sometimes.
        while begun.elapsed() < Duration::from_secs(1)
            && client
                .status()
                .is_ok_and(|now| now.verdicts == before.verdicts)
        {
            self.tally.requests += 1;
            self.drain();
        }
        self.board().control_sends(DC1);
        self.drain();
    }

    fn drain(&self) {
        while self
            .board()
            .control_receives(Duration::from_millis(5))
            .is_some()
        {}
    }

    /// What no control prints, up to some laps of the journal.
    fn noise(&mut self) {
        let count = 1 << self.random.below(13);
        for _ in 0..count {
            let line = match self.random.below(3) {
                0 => b"x\r\n".to_vec(),
                1 => {
                    let length = 1 + self.random.below(60);
                    [self.random.bytes(length), b"\r\n".to_vec()].concat()
                }
                _ => b"POINT: 1.0 2.0\r\n".to_vec(),
            };
            self.board().control_sends(&line);
        }
        self.tally.lines_of_noise += count;
        self.drain();
    }

    fn garbage(&mut self) {
        let count = 1 << self.random.below(16);
        let bytes = self.random.bytes(count);
        let mut host = self.board().connect();
        let _ = host.write(&bytes);
        self.tally.garbage_bytes += count as u64;
    }

    /// Questions without a pause.
    fn flood(&mut self) {
        let Ok(mut client) = umi_desk::client(self.board()) else {
            return;
        };
        for _ in 0..self.random.below(500) {
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
        let _ = self.board().connect().write(&frame[..end]);
    }

    /// Somebody without a key, and with a wrong one.
    fn stranger(&mut self) {
        self.tally.strangers += 1;
        if let Ok(mut client) = umi_desk::client(self.board()) {
            let mut other = job();
            other.features.truncate(1);
            assert!(client.set_job(&other).is_err());
            assert!(client.lock(true).is_err());
        }
        if let Ok(mut client) = umi_desk::client(self.board()) {
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
                self.board().control_sends(&text.as_bytes()[..end]);
            }
            1 => self.noise(),
            _ => {}
        }
        self.tally.resets += 1;
        self.reset();
    }

    /// An image that confirms itself, or not; one of a stranger is refused.
    fn update(&mut self) {
        let confirms = self.random.below(3) > 0;
        let payload = format!("umi-virtual-image\nconfirms = {confirms}\n");
        let version = [1, self.image + 1, 0];
        let counter = u32::from(self.image) + 1;
        let image = |by| {
            let signed =
                image_file::sign(payload.as_bytes(), "virtual", version, counter, &secret(by));
            signed.unwrap().1
        };
        if self.send(&image(STRANGER)) || !self.send(&image(MAKER)) {
            // Never the stranger's; the maker's not while something is under way.
            let runs = self.image_info().version;
            assert!(runs <= [1, self.image, 0], "{runs:?}");
            return;
        }
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

    fn image_info(&self) -> ImageInfo {
        let begun = Instant::now();
        loop {
            if let Ok(Some(info)) = self.owner().image() {
                return info;
            }
            assert!(begun.elapsed() < HANGS, "the board does not come back");
        }
    }

    /// Whether the board has taken it to its end.
    fn send(&self, image: &[u8]) -> bool {
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
}

/// Resident memory of this process, MB; none: another system than Linux.
fn resident_mb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    let kilobytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes / 1024)
}

/// So many hours of the board's time, from this seed.
fn soak(hours: f64, seed: u64) -> Shift {
    let mut shift = Shift::new(seed);
    let until = (hours * 3.6e9) as u64;
    let begun = Instant::now();
    let mut told = 0;
    while shift.now_us() < until {
        shift.step();
        let hour = shift.now_us() / 3_600_000_000;
        if hour > told {
            told = hour;
            println!(
                "hour {hour}: {} MB, {:?} on the wall, {:?}",
                resident_mb().unwrap_or(0),
                begun.elapsed(),
                shift.tally
            );
        }
    }
    // Whatever happened: what the owner has set is as he has set it, and he can still work.
    let mut owner = shift.owner();
    assert_eq!(owner.access().unwrap().mode, AccessMode::Claimed);
    assert_eq!(owner.keys().unwrap().len(), 1);
    assert_eq!(owner.job().unwrap().job, Some(job()));
    drop(owner);
    shift.drain();
    let ended = Instant::now();
    while !shift.pull() {
        assert!(
            ended.elapsed() < HANGS,
            "no pull succeeds: {:?}",
            shift.tally
        );
        shift.drain();
    }
    shift.counts();
    let (pulled, tally) = (&shift.pulled, &shift.tally);
    println!(
        "{hours} h, seed {seed}: {} MB, {:?} on the wall; {tally:?}; pulled: {} bytes, {} pieces of evidence, {} verdicts, {} corrections, {} starts, {} of updates",
        resident_mb().unwrap_or(0),
        begun.elapsed(),
        pulled.file.len(),
        pulled.evidence.len(),
        pulled.verdicts,
        pulled.corrections,
        pulled.starts,
        pulled.updates,
    );
    assert!(pulled.verdicts >= tally.verdicts_seen, "a verdict was lost");
    assert!(pulled.starts > tally.resets);
    shift
}

/// A quarter of an hour.
#[test]
fn nothing_is_lost_in_a_quarter_of_an_hour() {
    let shift = soak(0.25, 5);
    assert!(shift.pulled.verdicts > 3, "{:?}", shift.tally);
    assert!(shift.tally.lines_of_noise > 1000, "{:?}", shift.tally);
}

/// As above, 24 hours, or as many as `UMI_SOAK_HOURS` says; from the seed `UMI_SOAK_SEED`. By hand:
/// `cargo test --release -p umi-tests --test keep soak -- --ignored --nocapture`.
#[test]
#[ignore = "half an hour"]
fn long_shift() {
    let said = |name: &str| std::env::var(name).ok();
    let hours = said("UMI_SOAK_HOURS").map_or(24.0, |hours| hours.parse().unwrap());
    let seed = said("UMI_SOAK_SEED").map_or(1, |seed| seed.parse().unwrap());
    let shift = soak(hours, seed);
    let tally = &shift.tally;
    assert!(tally.resets > 0 && tally.updates_confirmed > 0 && tally.updates_reverted > 0);
    assert!(shift.pulled.corrections > 0);
}
