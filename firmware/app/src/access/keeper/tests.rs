use super::*;

use core::cell::Cell;
use core::sync::atomic::{AtomicUsize, Ordering};
mod ages;
mod migration;

extern crate std;
use std::boxed::Box;
use std::sync::{Arc, Mutex};
use std::vec::Vec;

use ed25519_dalek::SigningKey;
use umi_core::journal::Geometry;
use umi_core::trust::access::session::HostHandshake;
use umi_core::trust::board_key::{BoardKey, NoEntropy};
use umi_protocol::access::{AccessMode, KeyName};
use umi_protocol::config::BoardConfig;
use umi_protocol::job::name;
use umi_protocol::message::{Identity, Record, ResetReason};

use crate::board::LineAbilities;
use crate::measure::trust::custody::{Custody, NOTHING_KEPT};
use crate::measure::{Boot, StorageAreas};

const SECTORS: usize = 4;
const SECTOR: usize = 4096;

/// The cells of a flash; clones share them.
type Cells = Arc<Mutex<Vec<u8>>>;

fn erased() -> Cells {
    Arc::new(Mutex::new(std::vec![0xFF; SECTORS * SECTOR]))
}

/// A flash that loses its power at an operation: of a program a part is written, of an erase a part
/// is erased. The power comes back with [`Cut::whole`].
#[derive(Clone)]
struct Cut {
    cells: Cells,
    left: Arc<AtomicUsize>,
    /// How much of the last operation is done, in quarters.
    quarters: usize,
    /// Bytes of a sector.
    sector: usize,
    /// Bytes that are programmed at once, and once behind an erasure. Where it is more than one, a torn word reads as
    /// zeros, as in an STM32H743's own flash.
    word: usize,
    /// It cannot be read.
    is_mute: bool,
}

impl Cut {
    fn at(cells: &Cells, left: usize, quarters: usize) -> Self {
        Self {
            cells: Arc::clone(cells),
            left: Arc::new(AtomicUsize::new(left)),
            quarters,
            sector: SECTOR,
            word: 1,
            is_mute: false,
        }
    }

    /// The same in words of so many bytes.
    fn in_words(self, word: usize) -> Self {
        Self { word, ..self }
    }

    /// Another area of the same board: it loses its power with this one.
    fn beside(&self, cells: &Cells) -> Self {
        let sector = cells.lock().unwrap().len() / SECTORS;
        Self {
            cells: Arc::clone(cells),
            sector,
            ..self.clone()
        }
    }

    fn whole(cells: &Cells) -> Self {
        Self::at(cells, usize::MAX, 4)
    }

    /// Does as much of an operation as the power lasts for.
    fn change(&self, at: usize, length: usize, change: impl Fn(usize, &mut u8)) -> Result<(), ()> {
        let left = self.left.load(Ordering::Relaxed);
        self.left.store(left.saturating_sub(1), Ordering::Relaxed);
        let done = match left {
            0 => 0,
            1 => length * self.quarters / 4,
            _ => length,
        };
        let mut cells = self.cells.lock().unwrap();
        for (n, cell) in cells[at..at + done].iter_mut().enumerate() {
            change(n, cell);
        }
        if self.word > 1 && left == 1 && (1..4).contains(&self.quarters) {
            let torn = at + done - done % self.word;
            cells[torn..torn + self.word].fill(0);
        }
        match left {
            0 | 1 => Err(()),
            _ => Ok(()),
        }
    }
}

impl Flash for Cut {
    type Error = ();

    fn geometry(&self) -> Geometry {
        Geometry {
            sectors: SECTORS as u16,
            sector_size: self.sector as u32,
            write_size: self.word as u32,
            page_size: if self.word > 1 { self.word as u32 } else { 256 },
        }
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), ()> {
        if self.is_mute {
            return Err(());
        }
        let cells = self.cells.lock().unwrap();
        into.copy_from_slice(&cells[addr as usize..][..into.len()]);
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), ()> {
        self.change(addr as usize, bytes.len(), |n, cell| {
            assert!(
                self.word == 1 || *cell == 0xFF,
                "a word is programmed twice"
            );
            *cell &= bytes[n];
        })
    }

    fn erase(&mut self, sector: u32) -> Result<(), ()> {
        self.change(sector as usize * self.sector, self.sector, |_, cell| {
            *cell = 0xFF
        })
    }
}

fn signer() -> Option<&'static HeadSigner> {
    let drawn = |seed: &mut [u8; 32]| {
        seed.fill(0xB0);
        seed[0] = 1;
        Ok(())
    };
    let key = BoardKey::open(Cut::whole(&erased()), drawn).unwrap();
    Some(Box::leak(Box::new(HeadSigner::new(key, [0; 32]))))
}

fn draw(bytes: &mut [u8; 32]) -> Result<(), NoEntropy> {
    std::thread_local!(static NEXT: Cell<u8> = const { Cell::new(1) });
    let next = NEXT.with(|next| next.replace(next.get().wrapping_add(1)));
    bytes.fill(next);
    Ok(())
}

fn open(flash: Cut, is_closed: bool) -> Keeper<Cut> {
    let jumper: Jumper = if is_closed { || true } else { || false };
    Keeper::open(flash, jumper, signer(), draw, Micros(0))
}

fn prepare(keeper: &mut Keeper<Cut>, request: &SessionRequest) {
    let work = keeper.prepare(request);
    keeper.prepared(work.map(Work::done));
}

fn begin(keeper: &mut Keeper<Cut>, ask: SessionAsk) -> SessionChallenge {
    prepare(keeper, &SessionRequest::Begin(ask));
    keeper.begin(Micros(0), &ask).unwrap()
}

fn prove(
    keeper: &mut Keeper<Cut>,
    signature: SignatureParts,
) -> Result<(Role, SignatureParts), Slowed> {
    prepare(keeper, &SessionRequest::Prove { signature });
    keeper.prove(Micros(0))
}

fn key(of: u8, role: Role) -> KeyInfo {
    KeyInfo {
        public: SigningKey::from_bytes(&[of; 32]).verifying_key().to_bytes(),
        role,
        name: KeyName::try_from("somebody").unwrap(),
    }
}

/// What an owner does, one after the other.
fn deeds() -> Vec<fn(&KeyRegister) -> KeyRegister> {
    fn or_same(next: Option<KeyRegister>, register: &KeyRegister) -> KeyRegister {
        next.unwrap_or_else(|| register.clone())
    }
    std::vec![
        |of| or_same(of.enrolled(&key(1, Role::Owner)).unwrap(), of),
        |of| or_same(of.enrolled(&key(2, Role::Engineer)).unwrap(), of),
        |of| or_same(of.enrolled(&key(3, Role::Owner)).unwrap(), of),
        |of| {
            let revoked = of.revoked(key_id(&key(1, Role::Owner).public)).unwrap();
            or_same(revoked.map(|(next, _)| next), of)
        },
        |of| or_same(of.with_lock(true).unwrap(), of),
        |of| or_same(of.with_lock(false).unwrap(), of),
        |of| or_same(of.enrolled(&key(2, Role::Operator)).unwrap(), of),
    ]
}

/// The power goes at every operation of what an owner does, at four places of each: what is found
/// is what was kept before or what was being kept, whole; what was said to be kept is; and the board
/// is never open once it was claimed.
#[test]
fn a_power_cut_leaves_one_whole_state() {
    // Rings with little room left, so that sectors are erased on the way.
    for (word, filled) in [(1, 0), (1, 40), (32, 0), (32, 40)] {
        let mut cuts = 0;
        'cuts: for cut_at in 1.. {
            for quarters in 0..4 {
                let cells = erased();
                let whole = Cut::whole(&cells).in_words(word);
                let mut keeper = open(whole.clone(), false);
                let mut states = std::vec![keeper.register().clone()];
                for _ in 0..filled {
                    keeper.save(Micros(0), KeyRegister::default()).unwrap();
                }
                let power = Cut::at(&cells, cut_at, quarters).in_words(word);
                let mut keeper = open(power, false);
                let mut kept = 0;
                let mut is_cut = false;
                for deed in deeds() {
                    let next = deed(states.last().unwrap());
                    states.push(next.clone());
                    if keeper.save(Micros(0), next).is_err() {
                        is_cut = true;
                        break;
                    }
                    kept += 1;
                }
                if !is_cut {
                    assert!(cut_at > 12, "{cut_at}");
                    break 'cuts;
                }
                cuts += 1;
                let found = open(whole, false).register().clone();
                // The state that was being kept is the last.
                let may_be = [states.get(kept), states.get(kept + 1)];
                assert!(
                    may_be.contains(&Some(&found)),
                    "words of {word}, cut {cut_at}, {quarters} quarters, {kept} kept: {found:?}"
                );
                assert!(kept == 0 || found.mode() != AccessMode::Open);
            }
        }
        assert!(cuts > 48, "{cuts}");
    }
}

/// Whatever single byte of the flash is damaged at rest: never open after claimed, never a key that
/// was not enrolled, and the state before only as damage that locks the board.
#[test]
fn damage_at_rest_never_opens_a_board() {
    let cells = erased();
    let mut keeper = open(Cut::whole(&cells), true);
    let mut register = keeper.register().clone();
    for deed in deeds() {
        register = deed(&register);
        keeper.save(Micros(0), register.clone()).unwrap();
    }
    let image = cells.lock().unwrap().clone();
    let used = image.iter().rposition(|byte| *byte != 0xFF).unwrap();
    for at in 0..=used {
        let mut damaged = image.clone();
        damaged[at] ^= 0x40;
        let damaged = Arc::new(Mutex::new(damaged));
        let found = open(Cut::whole(&damaged), true).register().clone();
        let is_same = found.keys() == register.keys() && found.mode() == register.mode();
        let is_locked = found.mode() == AccessMode::Locked && found.keys().is_empty();
        assert!(is_same || is_locked, "byte {at}: {found:?}");
    }
}

/// A stranger is slowed, over restarts; the owner is not, however often the stranger tries.
#[test]
fn a_stranger_slows_nobody_else() {
    let cells = erased();
    let mut keeper = open(Cut::whole(&cells), false);
    let claimed = keeper.register().enrolled(&key(1, Role::Owner));
    keeper.save(Micros(0), claimed.unwrap().unwrap()).unwrap();
    let (owner, stranger) = ([1; 32], [9; 32]);
    let [owner, stranger] = [owner, stranger].map(|seed| SigningKey::from_bytes(&seed));
    let mut now = 0;
    for _ in 0..9 {
        let ask = HostHandshake::new(&stranger, [3; 32]).ask();
        assert_eq!(
            keeper.begin(Micros(now), &ask).unwrap_err().told,
            AccessRefusal::KeyUnknown
        );
        now += u64::from(keeper.retry_in_s(Micros(now))) * 1_000_000;
    }
    let mut keeper = open(Cut::whole(&cells), false);
    assert_eq!(keeper.retry_in_s(Micros(0)), 60);
    let ask = HostHandshake::new(&stranger, [3; 32]).ask();
    let slowed = keeper.begin(Micros(0), &ask).unwrap_err();
    assert_eq!(slowed.told, AccessRefusal::TooManyTries { retry_in_s: 60 });
    assert_eq!(slowed.why, Some(AccessRefusal::KeyUnknown));

    let handshake = HostHandshake::new(&owner, [4; 32]);
    let challenge = begin(&mut keeper, handshake.ask());
    let (signature, proof) = handshake.prove(&owner, &challenge).unwrap();
    let (role, signature) = prove(&mut keeper, signature).unwrap();
    assert_eq!(role, Role::Owner);
    assert!(proof.open(signature).is_some());
    assert_eq!(keeper.retry_in_s(Micros(0)), 0);
}

/// A challenge is good for one proof, right or wrong.
#[test]
fn a_challenge_is_used_once() {
    let mut keeper = open(Cut::whole(&erased()), false);
    let claimed = keeper.register().enrolled(&key(1, Role::Owner));
    keeper.save(Micros(0), claimed.unwrap().unwrap()).unwrap();
    let owner = SigningKey::from_bytes(&[1; 32]);
    let handshake = HostHandshake::new(&owner, [4; 32]);
    let challenge = begin(&mut keeper, handshake.ask());
    let (signature, _) = handshake.prove(&owner, &challenge).unwrap();
    assert!(prove(&mut keeper, signature).is_ok());
    let again = prove(&mut keeper, signature).unwrap_err();
    assert_eq!(again.told, AccessRefusal::KeyWrong);
}

/// A session that was idle for longer than the owner allows is over, and what its host has sealed
/// counts no more; one whose host asks in time goes on, and without a limit it ends with the
/// connection only. What the owner sets holds at once, also for the session that there is.
#[test]
fn an_idle_session_is_over() {
    let owner = SigningKey::from_bytes(&[1; 32]);
    let config = |session_idle_s| AccessConfig {
        session_idle_s,
        ..AccessConfig::NEW
    };
    let year = 31_536_000_000_000;
    for (set, gap_us, lives) in [
        (Some(60), 60_000_000, true),
        (Some(60), 60_000_001, false),
        (None, year, true),
        // What could not be read is the shortest that can be worked with.
        (Some(0), 10_000_000, true),
        (Some(0), 10_000_001, false),
    ] {
        let mut keeper = open(Cut::whole(&erased()), false);
        let claimed = keeper.register().enrolled(&key(1, Role::Owner));
        keeper.save(Micros(0), claimed.unwrap().unwrap()).unwrap();
        let handshake = HostHandshake::new(&owner, [4; 32]);
        let challenge = begin(&mut keeper, handshake.ask());
        let (signature, proof) = handshake.prove(&owner, &challenge).unwrap();
        let (_, signature) = prove(&mut keeper, signature).unwrap();
        let mut session = proof.open(signature).unwrap();
        keeper.follow(&config(set));
        let mut ask = |keeper: &mut Keeper<Cut>, at: u64| {
            let of = Authenticated {
                header: Default::default(),
                counter: session.count(),
                message: b"a request",
            };
            keeper.takes(Micros(at), &of, &session.code(&of)).is_some()
        };
        let mut now = 0;
        for _ in 0..3 {
            now += 9_000_000;
            assert!(ask(&mut keeper, now), "{set:?}: a host that asks");
        }
        now += gap_us;
        assert_eq!(ask(&mut keeper, now), lives, "{set:?} {gap_us}");
        assert_eq!(ask(&mut keeper, now + 1), lives, "it does not come again");
    }
}

/// A wipe leaves no key in the flash.
#[test]
fn a_wipe_leaves_no_key_behind() {
    let cells = erased();
    let mut keeper = open(Cut::whole(&cells), true);
    let claimed = keeper.register().enrolled(&key(1, Role::Owner));
    keeper.save(Micros(0), claimed.unwrap().unwrap()).unwrap();
    let has_key = || {
        let image = cells.lock().unwrap().clone();
        let public = key(1, Role::Owner).public;
        image.windows(32).any(|window| window == public)
    };
    assert!(has_key());
    keeper.forget(Micros(0)).unwrap();
    assert!(!has_key());
    assert_eq!(keeper.register().mode(), AccessMode::Open);
}

/// The areas of a board.
struct Areas {
    access: Cells,
    custody: Cells,
    journal: Cells,
    settings: Cells,
    programs: Cells,
}

impl Areas {
    fn copied(&self) -> Self {
        let copy = |of: &Cells| Arc::new(Mutex::new(of.lock().unwrap().clone()));
        Self {
            access: copy(&self.access),
            custody: copy(&self.custody),
            journal: copy(&self.journal),
            settings: copy(&self.settings),
            programs: copy(&self.programs),
        }
    }

    /// A start, with power for so long.
    fn started(&self, power: &Cut) -> Box<crate::App<Cut>> {
        let app = Box::new(crate::App::new());
        let keeper = open(power.beside(&self.access), true);
        app.guard(keeper).unwrap();
        let boot = Boot {
            identity: Identity {
                board: name("virtual"),
                serial: name("1"),
                firmware: name("0"),
            },
            reset: ResetReason::PowerOn,
            line: LineAbilities {
                least_baud: 50,
                most_baud: 115_200,
                two_stop_bits: true,
                cts: false,
            },
            skip_ends: true,
            signer: None,
        };
        let storage = StorageAreas {
            journal: power.beside(&self.journal),
            evidence: None,
            custody: Some(power.beside(&self.custody)),
            settings: power.beside(&self.settings),
            programs: power.beside(&self.programs),
        };
        let _ = app.start(boot, storage, Micros(0)).unwrap();
        app
    }

    /// A start: the mode, the configuration, and whether the journal tells of a wipe.
    fn start(&self, power: &Cut) -> (AccessMode, BoardConfig, bool) {
        let app = self.started(power);
        let mode = app.guarded.try_lock().unwrap().mode();
        let mut measure = app.measure.try_lock().unwrap();
        let config = measure.ledger.in_custody().config;
        let mut room = std::vec![0; umi_protocol::message::MAX_RECORD];
        let told = measure.ledger.journal.get_mut().is_some_and(|journal| {
            (journal.first_seq()..journal.next_seq()).any(|seq| {
                let found = journal.read(seq, &mut room);
                found.is_ok_and(|found| found.kind == WIPED)
            })
        });
        (mode, config, told)
    }
}

/// Kind number of [`umi_protocol::message::Record::Wiped`].
const WIPED: u8 = 32;

/// A board with its areas erased.
fn new_areas() -> Areas {
    let cells = |sector: usize| Arc::new(Mutex::new(std::vec![0xFF; SECTORS * sector]));
    Areas {
        access: cells(SECTOR),
        custody: cells(SECTOR),
        journal: cells(16_384),
        settings: cells(16_384),
        programs: cells(SECTOR),
    }
}

/// The board has an owner and a ceiling, set as a host sets them.
fn owned_areas() -> (Areas, BoardConfig) {
    let areas = new_areas();
    let app = areas.started(&Cut::whole(&areas.access));
    let mut measure = app.measure.try_lock().unwrap();
    let mut guarded = app.guarded.try_lock().unwrap();
    let keeper = guarded.keeper().unwrap();
    for owner in [1, 2] {
        let request = Request::KeyEnrol(key(owner, Role::Owner));
        let caller = Caller::NOBODY;
        let done = super::super::change(&mut measure, keeper, Micros(0), &caller, &request);
        assert_eq!(done, Ok(true));
    }
    let mut config = BoardConfig::NEW;
    config.ceilings.rms_mm = Some(0.01);
    measure.set_config(Micros(0), &config).unwrap();
    drop(measure);
    (areas, config)
}

/// Whether the newest record of a board's access says that it locked itself.
fn tells_of_lost_keys(areas: &Areas) -> bool {
    let app = areas.started(&Cut::whole(&areas.access));
    let mut measure = app.measure.try_lock().unwrap();
    let journal = measure.ledger.journal.get_mut().unwrap();
    let mut room = std::vec![0; umi_protocol::message::MAX_RECORD];
    let mut told = false;
    for seq in journal.first_seq()..journal.next_seq() {
        let found = journal.read(seq, &mut room).unwrap();
        if let Ok(Record::Access { what, role, by, .. }) = postcard::from_bytes(found.payload) {
            told = (what, role, by) == (AccessChange::Locked, Role::None, None);
        }
    }
    told
}

/// An area that was erased is not that of a new board, as long as another one knows better: a board
/// that had an owner is locked, one that had a configuration takes the strictest, and both are told.
/// A board that is new, or was wiped, is open and has none.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn what_was_erased_is_not_new() {
    let (areas, config) = owned_areas();
    let erase = |cells: &Cells| cells.lock().unwrap().fill(0xFF);
    let start = |areas: &Areas| areas.start(&Cut::whole(&areas.access));
    for starts in 0..3 {
        let same = areas.copied();
        for _ in 0..=starts {
            assert_eq!(start(&same), (AccessMode::Claimed, config, false));
            assert!(!tells_of_lost_keys(&same));
        }
        erase(&same.access);
        for _ in 0..2 {
            assert_eq!(start(&same), (AccessMode::Locked, config, false));
            assert!(tells_of_lost_keys(&same));
        }
    }
    let strictest = BoardConfig::strictest();
    let same = areas.copied();
    erase(&same.custody);
    for _ in 0..2 {
        assert_eq!(start(&same), (AccessMode::Claimed, strictest, false));
    }
    erase(&same.access);
    for _ in 0..2 {
        assert_eq!(start(&same), (AccessMode::Locked, strictest, false));
        assert!(tells_of_lost_keys(&same));
    }
    // The journal is not what the board of an owner is known by alone.
    let same = areas.copied();
    erase(&same.access);
    erase(&same.journal);
    assert_eq!(start(&same), (AccessMode::Locked, config, false));
    let new = new_areas();
    for _ in 0..3 {
        assert_eq!(start(&new), (AccessMode::Open, BoardConfig::NEW, false));
    }
}

/// What is asked for again, because the answer was lost, is done and told once: enrol, revoke, lock.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn what_is_asked_for_again_is_done_once() {
    let mut keeper = open(Cut::whole(&erased()), false);
    let engineer = key(2, Role::Engineer);
    let key_id = key_id(&engineer.public);
    let mut told = Vec::new();
    for request in [
        Request::KeyEnrol(key(1, Role::Owner)),
        Request::KeyEnrol(engineer),
        Request::KeyRevoke { key_id },
        Request::LockSet { locked: true },
    ] {
        for _ in 0..3 {
            let done = keeper.change(Micros(0), &request, &Caller::NOBODY, |_, what| {
                told.push(what.what);
                true
            });
            assert_eq!(done, Ok(true), "{request:?}");
        }
    }
    use AccessChange::{Enrolled, Locked, Revoked};
    assert_eq!(told, [Enrolled, Enrolled, Revoked, Locked]);
}

/// Whichever sector is erased, and wherever its end reads as zeros: a key that was revoked is not
/// back, and a board that was locked stays so.
#[test]
fn damage_of_a_sector_brings_no_key_back() {
    let cells = erased();
    let mut keeper = open(Cut::whole(&cells), false);
    let mut register = keeper.register().clone();
    for of in [1, 2, 3] {
        register = register.enrolled(&key(of, Role::Owner)).unwrap().unwrap();
        keeper.save(Micros(0), register.clone()).unwrap();
    }
    register = register.with_lock(true).unwrap().unwrap();
    keeper.save(Micros(0), register.clone()).unwrap();
    let revoked = key(2, Role::Owner).public;
    register = register.revoked(key_id(&revoked)).unwrap().unwrap().0;
    keeper.save(Micros(0), register.clone()).unwrap();
    let whole = cells.lock().unwrap().clone();
    let (mut as_it_was, mut locked) = (0, 0);
    for sector in 0..SECTORS {
        for (fill, from) in [(0xFF, 0)]
            .into_iter()
            .chain((0..SECTOR).step_by(16).map(|from| (0, from)))
        {
            let mut damaged = whole.clone();
            damaged[sector * SECTOR..][from..SECTOR].fill(fill);
            let found = open(Cut::whole(&Arc::new(Mutex::new(damaged))), false);
            let found = found.register();
            assert_eq!(found.mode(), AccessMode::Locked, "{sector} {fill} {from}");
            assert_eq!(found.role_of(&revoked), None, "{sector} {fill} {from}");
            let is_same = found.grants_as(&register);
            as_it_was += usize::from(is_same);
            locked += usize::from(!is_same);
        }
    }
    // Only where a header went, nobody knows what stood behind it.
    assert!(
        as_it_was > 3 * (as_it_was + locked) / 4,
        "{as_it_was} {locked}"
    );
}

/// The power goes at every operation of a wipe, on any area: a board that has an owner still is as
/// it was, or forgets everything, and tells so; the next start ends what has begun.
#[test]
#[cfg_attr(
    not(feature = "owner"),
    ignore = "without the feature `owner` a board has none"
)]
fn a_power_cut_leaves_no_half_wiped_board() {
    let new = new_areas();
    let whole = Cut::whole(&new.access);
    let mut keeper = open(whole.clone(), true);
    let owner = keeper.register().enrolled(&key(1, Role::Owner)).unwrap();
    keeper.save(Micros(0), owner.unwrap()).unwrap();
    let mut configured = NOTHING_KEPT;
    configured.config.ceilings.rms_mm = Some(0.01);
    let mut custody = Custody::open(whole.beside(&new.custody));
    custody.save(Micros(0), configured).unwrap();
    let mut marks = custody.marks();
    (marks.age.keys, marks.is_owned) = (1, true);
    custody.keep_marks(Micros(0), marks).unwrap();
    let age = marks.age;
    let claimed = (AccessMode::Claimed, configured.config, false);
    assert_eq!(new.start(&whole), claimed);
    let wiped = (AccessMode::Open, BoardConfig::NEW, true);
    let mut ends = [0, 0];
    'cuts: for cut_at in 1.. {
        for quarters in 0..4 {
            let board = new.copied();
            let power = Cut::at(&board.access, cut_at, quarters);
            let mut keeper = open(power.clone(), true);
            let wiping = Wiping {
                first_seq: 0,
                next_seq: 9,
                chain: [7; 32],
                key_id: None,
            };
            let has_begun = keeper.begin_wipe(Micros(0), wiping, age).is_ok();
            if has_begun {
                board.start(&power);
            }
            let is_cut = power.left.load(Ordering::Relaxed) == 0;
            let found = board.start(&Cut::whole(&board.access));
            let again = board.start(&Cut::whole(&board.access));
            assert_eq!(found, again, "cut {cut_at}, {quarters} quarters");
            assert!(
                found == wiped || found == claimed && !has_begun,
                "cut {cut_at}, {quarters} quarters: {found:?}"
            );
            ends[usize::from(found == wiped)] += 1;
            if !is_cut {
                break 'cuts;
            }
        }
    }
    assert!(ends[0] > 2 && ends[1] > 80, "{ends:?}");
}

/// The power goes at every operation while the owner's configuration is kept, again and again: the
/// one before or the new one, whole, and never the strictest for want of either.
#[test]
fn a_power_cut_leaves_one_whole_configuration() {
    let mut cuts = 0;
    'cuts: for cut_at in 1.. {
        for quarters in 0..4 {
            let cells = erased();
            let power = Cut::at(&cells, cut_at, quarters);
            let mut kept = NOTHING_KEPT;
            let mut saved = Ok(());
            let mut custody = Custody::open(power);
            for n in 1..=150 {
                let before = kept;
                kept.config.ceilings.rms_mm = Some(f64::from(n) * 0.001);
                saved = custody.save(Micros(0), kept);
                if saved.is_err() {
                    let opened = Custody::open(Cut::whole(&cells));
                    let found = *opened.kept();
                    assert!(found == before || found == kept, "cut {cut_at}: {found:?}");
                    assert_eq!(opened.fallbacks().len(), 0, "cut {cut_at}");
                    break;
                }
            }
            if saved.is_ok() {
                break 'cuts;
            }
            cuts += 1;
        }
    }
    // Over the end of a sector, where one is erased.
    assert!(cuts > 600, "{cuts}");
}
