//! Who may do what: between the frames of a host and what is done about them.
//!
//! # Design
//!
//! A board that can have an owner gives a [`Keeper`], which knows the keys and the session and stands
//! on a flash area of its own. A board without one is open for ever, and carries none of its code (the
//! feature `owner`). There are no traits in between:
//! a call through a pointer would count for the stack as the worst of all such calls.
//!
//! Every frame has a [`Caller`]: who has sealed it, or nobody. A session does not end with a
//! greeting, because whoever reaches the port can say one; it ends with the connection, with another
//! session, with its key, and with the board.
//!
//! What an owner changes is journaled before it is kept: a power cut between the two leaves a record
//! of what was not done, never a deed without a record.

mod images;
mod keeper;
pub(crate) mod proof;

pub(crate) use images::update;
pub use keeper::{Jumper, Keeper};
use proof::Prover;
pub use proof::{Draw, Work, Worked};

use umi_core::journal::Flash;
use umi_core::journal::archive::Archive;
use umi_core::trust::access::permit::{permit, permit_role};
use umi_core::trust::access::register::{Age, Wiping};
use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;
use umi_protocol::access::{
    AccessChange, AccessInfo, AccessMode, AccessRefusal, KeyId, Keys, Role, SessionAsk,
};
use umi_protocol::config::{AccessConfig, LockedReading};
use umi_protocol::frame::{Authenticated, CODE, Frame};
use umi_protocol::immediate::{ImmediateRequest, SessionRequest};
use umi_protocol::message::{Record, Request, Response};

use crate::measure::opening::ACCESS;
use crate::measure::{Instrument, Ledger};

/// Who has sent a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Caller {
    /// What for.
    pub role: Role,
    /// By which key; none: nobody's.
    pub key_id: Option<KeyId>,
    /// The counter of the frame, which its answer has, too; none: it has no seal.
    pub counter: Option<u64>,
}

impl Caller {
    /// Nobody has proven anything.
    pub const NOBODY: Self = Self {
        role: Role::None,
        key_id: None,
        counter: None,
    };
}

/// It is not kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeysNotKept;

/// A key is not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slowed {
    /// Why; none: the board cannot have sessions.
    pub why: Option<AccessRefusal>,
    /// What the host is told where too many were wrong.
    pub told: AccessRefusal,
    /// Which key.
    pub key_id: Option<KeyId>,
}

/// The board's keys, if it can have an owner.
pub(crate) struct Guarded<F: Flash> {
    keeper: ZeroOption<Keeper<F>>,
    /// Where the axes stood when an image began to come; 0: none has.
    pub(crate) stood: u32,
    /// The board is to start anew.
    pub restarts: bool,
}

impl<F: Flash> Guarded<F> {
    pub const fn new() -> Self {
        Self {
            keeper: ZeroOption::empty(),
            stood: 0,
            restarts: false,
        }
    }

    pub fn put(&mut self, keeper: Keeper<F>) {
        self.keeper.put(keeper);
    }

    fn keeper(&mut self) -> Option<&mut Keeper<F>> {
        self.keeper.get_mut().filter(|_| cfg!(feature = "owner"))
    }

    fn look(&self) -> Option<&Keeper<F>> {
        self.keeper.get().filter(|_| cfg!(feature = "owner"))
    }

    /// Who may do what.
    pub fn mode(&self) -> AccessMode {
        let keeper = self.look();
        keeper.map_or(AccessMode::Open, |keeper| keeper.register().mode())
    }

    /// Does from now on as the owner has set.
    pub fn follow(&mut self, config: &AccessConfig) {
        if let Some(keeper) = self.keeper() {
            keeper.follow(config);
        }
    }

    /// A wipe that has begun and not ended.
    fn wiping(&self) -> Option<Wiping> {
        self.look()?.register().wiping
    }

    /// Whether one goes on: not one that was begun in another life of the board, for that is an older copy.
    pub fn wipes(&self, measure: &Instrument<F>) -> bool {
        let custody = measure.ledger.custody.get();
        self.look().is_some_and(|keeper| {
            let register = keeper.register();
            let is_here = custody.is_none_or(|custody| custody.ends_with(register.age()));
            register.wiping.is_some() && is_here
        })
    }

    /// Who has sent a frame, and the frame without its seal; none: its seal is not the session's.
    pub fn opened<'f>(&mut self, frame: &Frame<'f>, now: Micros) -> Option<(Frame<'f>, Caller)> {
        match frame.unsealed() {
            None => Some((*frame, Caller::NOBODY)),
            Some((inner, authenticated, code)) => {
                let caller = self.keeper()?.takes(now, &authenticated, code)?;
                Some((inner, caller))
            }
        }
    }

    /// Hands over what is to be done before a frame is answered; false: nothing that takes long.
    #[inline(never)]
    pub fn prepare(&mut self, frame: &Frame<'_>, prover: &Prover) -> bool {
        let Some(keeper) = self.keeper() else {
            return false;
        };
        keeper.prepared(None);
        let request = SessionRequest::of(frame);
        let Some(work) = request.and_then(|request| keeper.prepare(&request)) else {
            return false;
        };
        prover.hand_over(work);
        true
    }

    /// Takes what came of it.
    #[inline(never)]
    pub fn prepared(&mut self, prover: &Prover) {
        if let Some(keeper) = self.keeper() {
            keeper.prepared(prover.take());
        }
    }

    /// Whether somebody may ask for this at once.
    pub fn permits(
        &self,
        caller: &Caller,
        request: &ImmediateRequest,
    ) -> Result<(), AccessRefusal> {
        let needs = request.needs();
        permit_role(self.mode(), caller.role, needs, needs <= Role::Operator)
    }

    /// Whether somebody may ask for this.
    fn admits(
        &mut self,
        caller: &Caller,
        request: &Request,
        locked_reading: LockedReading,
    ) -> Result<(), AccessRefusal> {
        let mode = self.mode();
        let permitted = permit(mode, caller.role, request, locked_reading);
        let Some(keeper) = self.keeper() else {
            return permitted;
        };
        match request {
            Request::Wipe => {
                let holds = keeper.jumper_holds();
                if holds && keeper.register().jumper_is_held() {
                    return Ok(());
                }
                permitted?;
                holds.then_some(()).ok_or(AccessRefusal::JumperOpen)
            }
            Request::KeyEnrol(_) if mode == AccessMode::Open => {
                let holds = keeper.jumper_holds();
                holds.then_some(()).ok_or(AccessRefusal::JumperOpen)
            }
            _ => permitted,
        }
    }

    /// The code of an answer.
    pub fn code(&self, of: &Authenticated<'_>) -> [u8; CODE] {
        let keeper = self.look();
        keeper.map_or([0; CODE], |keeper| keeper.code(of))
    }

    /// The host is gone.
    pub fn disconnected(&mut self) {
        if let Some(keeper) = self.keeper() {
            keeper.disconnected();
        }
    }

    /// Compares the keys, what is kept for the owner, and the evidence. Where one of them knows of an owner the board is not
    /// open, for the last one stays; where keys or configuration are older than another knows they do not count, and the
    /// strictest does. Keys or a wipe of another life of the board do not count, nor does the configuration then. What is
    /// known is kept where it was not. Told at each start as long as the keys are lost.
    pub fn compare(&mut self, now: Micros, measure: &mut Instrument<F>) {
        let Some(keeper) = self.keeper() else {
            return;
        };
        compare(now, keeper, &mut measure.ledger);
        if keeper.register().is_lost() {
            let told = Told {
                what: AccessChange::Locked,
                key_id: KeyId::default(),
                role: Role::None,
            };
            measure.tell_access(now, told, None);
        }
    }

    /// The owner has set the configuration so often: known to the keys' area, too.
    pub fn note_config(&mut self, now: Micros, measure: &mut Instrument<F>) {
        let custody = measure.ledger.custody.get();
        if let (Some(keeper), Some(custody)) = (self.keeper(), custody)
            && keeper.note_config(now, custody.marks().age.config).is_err()
        {
            measure.ledger.refused();
        }
    }

    /// Ends a wipe: everything else was erased, and the new journal has its first entries.
    pub fn end_wipe(&mut self, now: Micros, measure: &mut Instrument<F>) {
        let Some(wiping) = self.wiping() else {
            return;
        };
        let record = Record::Wiped {
            first_seq: wiping.first_seq,
            next_seq: wiping.next_seq,
            chain: wiping.chain,
            key_id: wiping.key_id,
        };
        // Without the record the wipe has not ended: the next start tries again.
        if measure.ledger.record(now, record)
            && let Some(keeper) = self.keeper()
            && keeper.forget(now).is_err()
        {
            measure.ledger.refused();
        }
    }
}

/// What [`Guarded::compare`] does.
#[inline(never)]
fn compare<F: Flash>(now: Micros, keeper: &mut Keeper<F>, ledger: &mut Ledger<F>) {
    let Some(custody) = ledger.custody.get_mut() else {
        // Nothing knows better.
        return;
    };
    let known = custody.marks();
    let is_settled = keeper.settle(now, custody.known());
    let register = keeper.register();
    let found = register.age();
    let (is_open, is_claiming) = (register.mode() == AccessMode::Open, register.is_claiming());
    // Custody or keys are from before a wipe, and nobody knows which; or custody is of another time.
    let is_foreign = is_settled
        && (!is_open && !custody.takes_keys(found)
            || register.wiping.is_some() && !custody.ends_with(found));
    let mut marks = known;
    let mut is_told = false;
    if is_open && let Some(evidence) = ledger.journal.get_mut() {
        (is_told, marks.looked_to) = evidence.tells(ACCESS, known.looked_to);
        // What that very claim may have written: custody knows that it was under way.
        is_told &= !is_claiming || known.age.keys == 0;
    }
    let is_lost = !is_settled
        || is_foreign
        || known.is_owned && found.keys < known.age.keys
        || is_open && (known.is_owned || is_told);
    if !keeper.is_reachable() || !custody.is_reachable() {
        // What does not answer now may be whole at the next start: nothing is kept of what cannot be known.
        if is_lost {
            keeper.lock();
        }
        return;
    }
    // The keys know of a later configuration; the evidence, of an owner. Where custody is one change of the keys behind, the
    // power was cut between the two; where it is more, it is of another time.
    let is_old = match is_lost {
        true => is_foreign || is_told && !known.is_owned,
        false => {
            let next = known.age.changes().saturating_add(1);
            found.config > known.age.config || found.changes() > next
        }
    };
    marks.is_owned = is_lost || !is_open;
    marks.age = Age {
        keys: match is_lost {
            true => known.age.keys | Age::LOST,
            false => found.keys,
        },
        config: found.config.max(known.age.config),
    };
    let is_kept = if is_old {
        custody.distrust(now, marks)
    } else if is_claiming {
        custody.keep_marks(now, marks)
    } else {
        // A start alone writes nothing anew that a firmware before has kept.
        custody.note(now, marks, !is_lost && found.keys == 0)
    };
    if is_old {
        ledger.tell_config(now);
    }
    if is_lost {
        // What is begun anew looks new where the power is cut: custody knows of the owner before.
        keeper.lose(now, marks.age, is_kept.is_ok());
    } else if is_claiming && is_kept.is_ok() {
        keeper.claim_has_ended(now);
    }
    if keeper.note_config(now, marks.age.config).is_err() || is_kept.is_err() {
        ledger.refused();
    }
}

/// Looks whether somebody may ask for this; what is refused is journaled.
///
/// # Errors
/// Why not.
#[inline(never)]
pub(crate) fn admit<F: Flash>(
    measure: &mut Instrument<F>,
    guarded: &mut Guarded<F>,
    now: Micros,
    caller: &Caller,
    request: &Request,
) -> Result<(), AccessRefusal> {
    let locked_reading = measure.ledger.in_custody().config.access.locked_reading;
    let admitted = guarded.admits(caller, request, locked_reading);
    if let Err(why) = admitted {
        measure.refuse_access(now, why, caller.key_id);
    }
    admitted
}

/// The answer to a request about access.
#[inline(never)]
pub(crate) fn answer<F: Flash>(
    measure: &mut Instrument<F>,
    guarded: &mut Guarded<F>,
    now: Micros,
    caller: &Caller,
    request: &Request,
) -> Response {
    let mode = guarded.mode();
    let Some(keeper) = guarded.keeper() else {
        return match request {
            Request::AccessGet => Response::Access(AccessInfo::default()),
            Request::KeyList => Response::Keys(Keys::new()),
            _ => Response::NotOnThisBoard,
        };
    };
    match request {
        Request::AccessGet => Response::Access(AccessInfo {
            mode,
            jumper: Some(keeper.jumper()),
            retry_in_s: keeper.retry_in_s(now),
            board_key: keeper.board_key(),
        }),
        Request::KeyList => Response::Keys(keeper.register().keys().clone()),
        Request::SessionBegin(ask) => begin(measure, keeper, now, ask),
        Request::SessionProve { .. } => prove(measure, keeper, now),
        // Also where the board's own key is damaged: the wipe draws another.
        Request::Wipe => {
            let begun = begin_wipe(measure, keeper, now, caller);
            guarded.restarts |= begun;
            done(begun)
        }
        _ if keeper.board_key().is_none() => Response::NotOnThisBoard,
        _ => match change(measure, keeper, now, caller, request) {
            Ok(kept) => done(kept),
            Err(why) => refused(measure, now, why, caller.key_id, why),
        },
    }
}

// Answers are long: each of these has its own, so that none of them stands on the stack of another.

/// A host asks for a session.
#[inline(never)]
fn begin<F: Flash>(
    measure: &mut Instrument<F>,
    keeper: &mut Keeper<F>,
    now: Micros,
    ask: &SessionAsk,
) -> Response {
    match keeper.begin(now, ask) {
        Ok(challenge) => Response::SessionChallenge(challenge),
        Err(slowed) => slow(measure, now, slowed),
    }
}

/// A host proves its key.
#[inline(never)]
fn prove<F: Flash>(measure: &mut Instrument<F>, keeper: &mut Keeper<F>, now: Micros) -> Response {
    match keeper.prove(now) {
        Ok((role, signature)) => Response::SessionOpen { role, signature },
        Err(slowed) => slow(measure, now, slowed),
    }
}

/// Whether a wipe has begun: it is kept that it has.
#[inline(never)]
fn begin_wipe<F: Flash>(
    measure: &Instrument<F>,
    keeper: &mut Keeper<F>,
    now: Micros,
    caller: &Caller,
) -> bool {
    let custody = measure.ledger.custody.get();
    let age = custody.map_or(keeper.register().age(), |custody| custody.marks().age);
    let wiping = measure.to_be_wiped(caller);
    keeper.begin_wipe(now, wiping, age).is_ok()
}

/// Does what an owner asks; false: it is not kept.
#[inline(never)]
fn change<F: Flash>(
    measure: &mut Instrument<F>,
    keeper: &mut Keeper<F>,
    now: Micros,
    caller: &Caller,
    request: &Request,
) -> Result<bool, AccessRefusal> {
    let by = caller.key_id;
    let is_owned = keeper.register().mode() != AccessMode::Open;
    let kept = keeper.change(now, request, caller, |before, told| {
        measure.note_keys(now, before, is_owned) && measure.tell_access(now, told, by)
    })?;
    if kept && keeper.register().mode() != AccessMode::Open {
        measure.note_owner(now, keeper.register().age());
    }
    Ok(kept)
}

fn done(kept: bool) -> Response {
    match kept {
        true => Response::Done,
        false => Response::StorageFailed,
    }
}

/// A key was not taken.
#[inline(never)]
fn slow<F: Flash>(measure: &mut Instrument<F>, now: Micros, slowed: Slowed) -> Response {
    match slowed.why {
        None => Response::NotOnThisBoard,
        Some(why) => refused(measure, now, why, slowed.key_id, slowed.told),
    }
}

/// Journals why, and tells the host what it is to know.
#[inline(never)]
fn refused<F: Flash>(
    measure: &mut Instrument<F>,
    now: Micros,
    why: AccessRefusal,
    by: Option<KeyId>,
    told: AccessRefusal,
) -> Response {
    measure.refuse_access(now, why, by);
    Response::AccessRefused(told)
}

/// What an owner has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Told {
    /// What.
    pub what: AccessChange,
    /// Of which key.
    pub key_id: KeyId,
    /// What it is for.
    pub role: Role,
}

impl<F: Flash> Instrument<F> {
    /// Has custody know how often the keys were changed, and in which life, before they are again; false: it does not.
    #[inline(never)]
    fn note_keys(&mut self, now: Micros, keys: u64, is_owned: bool) -> bool {
        let Some(custody) = self.ledger.custody.get_mut() else {
            return true;
        };
        let mut marks = custody.marks();
        (marks.age.keys, marks.is_owned) = (keys, is_owned);
        custody.note(now, marks, false).is_ok()
    }

    /// Erases what is kept for the owner, for a wipe.
    pub(crate) fn erase_custody(&mut self) {
        if let Some(custody) = self.ledger.custody.get_mut() {
            custody.erase();
        }
    }

    /// Journals what an owner has changed.
    #[inline(never)]
    fn tell_access(&mut self, now: Micros, told: Told, by: Option<KeyId>) -> bool {
        let Told { what, key_id, role } = told;
        let record = Record::Access {
            what,
            key_id,
            role,
            by,
        };
        self.ledger.record(now, record)
    }
}

impl<F: Flash> Instrument<F> {
    /// What a wipe takes away; of a journal that cannot be read, nothing is known.
    fn to_be_wiped(&self, caller: &Caller) -> Wiping {
        let journal = self.ledger.journal.get();
        Wiping {
            first_seq: journal.map_or(0, Archive::first_seq),
            next_seq: journal.map_or(0, Archive::next_seq),
            chain: journal.map_or([0; 32], |journal| journal.chain_head().0),
            key_id: caller.key_id,
        }
    }
}
