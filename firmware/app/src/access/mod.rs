//! Who may do what: between the frames of a host and what is done about them.
//!
//! # Design
//!
//! A board that can have an owner gives a [`Gate`], which knows the keys and the session; the one
//! there is, [`Keeper`], stands on a flash area of its own. A board without a gate is open for ever,
//! and carries none of its code (the feature `owner`).
//!
//! Every frame has a [`Caller`]: who has sealed it, or nobody. A session does not end with a
//! greeting, because whoever reaches the port can say one; it ends with the connection, with another
//! session, with its key, and with the board.
//!
//! What an owner changes is journaled before it is kept: a power cut between the two leaves a record
//! of what was not done, never a deed without a record.

mod images;
mod keeper;

pub use images::Images;
pub(crate) use images::update;
pub use keeper::Keeper;

use umi_core::journal::Flash;
use umi_core::trust::access::permit::{permit, permit_role};
use umi_core::trust::access::register::{KeyRegister, Wiping};
use umi_core::trust::access::session::SignatureParts;
use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;
use umi_protocol::access::{
    AccessChange, AccessInfo, AccessMode, AccessRefusal, KeyId, Keys, Role, SessionAsk,
    SessionChallenge,
};
use umi_protocol::frame::{Authenticated, CODE, Frame};
use umi_protocol::immediate::ImmediateRequest;
use umi_protocol::message::{Record, Request, Response};

use crate::measure::Instrument;

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

/// What a board with an owner knows. Every error of its flash is [`KeysNotKept`]: nothing has changed.
pub trait Gate: Send {
    /// What is kept.
    fn register(&self) -> &KeyRegister;

    /// Does what an owner asks, and has it journaled before it is kept; false: one of the two failed.
    ///
    /// # Errors
    /// [`AccessRefusal`]: nothing has changed.
    fn change(
        &mut self,
        now: Micros,
        request: &Request,
        caller: &Caller,
        tell: &mut dyn FnMut(Told) -> bool,
    ) -> Result<bool, AccessRefusal>;

    /// Keeps that a wipe has begun. After `Ok` it survives a power cut.
    ///
    /// # Errors
    /// [`KeysNotKept`].
    fn begin_wipe(&mut self, now: Micros, wiping: Wiping) -> Result<(), KeysNotKept>;

    /// Keeps this as on a new board, and so that nothing before it can be read any more.
    ///
    /// # Errors
    /// [`KeysNotKept`].
    fn forget(&mut self, now: Micros) -> Result<(), KeysNotKept>;

    /// The board's public key; none: it has none, and cannot be claimed.
    fn board_key(&self) -> Option<[u8; 32]>;

    /// Whether the jumper is closed now.
    fn jumper(&mut self) -> bool;

    /// Whether it was closed at the start and is now.
    fn jumper_holds(&mut self) -> bool;

    /// Seconds until a wrong key is looked at.
    fn retry_in_s(&self, now: Micros) -> u32;

    /// A host asks for a session.
    ///
    /// # Errors
    /// [`Slowed`].
    fn begin(&mut self, now: Micros, ask: &SessionAsk) -> Result<SessionChallenge, Slowed>;

    /// A host proves its key: its role, and the board's signature.
    ///
    /// # Errors
    /// [`Slowed`].
    fn prove(
        &mut self,
        now: Micros,
        signature: SignatureParts,
    ) -> Result<(Role, SignatureParts), Slowed>;

    /// Who has sealed this; none: not the session's host, or not now.
    fn takes(&mut self, of: &Authenticated<'_>, code: &[u8; CODE]) -> Option<Caller>;

    /// The code of an answer of the session.
    fn code(&self, of: &Authenticated<'_>) -> [u8; CODE];

    /// The host is gone.
    fn disconnected(&mut self);
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

/// The board's gate, if it has one.
pub(crate) struct Guarded {
    gate: ZeroOption<&'static mut dyn Gate>,
    /// What takes images, if this board does.
    pub(crate) images: ZeroOption<&'static mut dyn Images>,
    /// Where the axes stood when an image began to come; 0: none has.
    pub(crate) stood: u32,
    /// The board is to start anew.
    pub restarts: bool,
}

impl Guarded {
    pub const fn new() -> Self {
        Self {
            gate: ZeroOption::empty(),
            images: ZeroOption::empty(),
            stood: 0,
            restarts: false,
        }
    }

    pub fn put(&mut self, gate: &'static mut dyn Gate) {
        self.gate.put(gate);
    }

    fn gate(&mut self) -> Option<&mut (dyn Gate + 'static)> {
        if !cfg!(feature = "owner") {
            return None;
        }
        self.gate.get_mut().map(|gate| &mut **gate)
    }

    fn look(&self) -> Option<&(dyn Gate + 'static)> {
        if !cfg!(feature = "owner") {
            return None;
        }
        self.gate.get().map(|gate| &**gate)
    }

    /// Who may do what.
    pub fn mode(&self) -> AccessMode {
        let gate = self.look();
        gate.map_or(AccessMode::Open, |gate| gate.register().mode())
    }

    /// A wipe that has begun and not ended.
    pub fn wiping(&self) -> Option<Wiping> {
        self.look()?.register().wiping
    }

    /// Who has sent a frame, and the frame without its seal; none: its seal is not the session's.
    pub fn opened<'f>(&mut self, frame: &Frame<'f>) -> Option<(Frame<'f>, Caller)> {
        match frame.unsealed() {
            None => Some((*frame, Caller::NOBODY)),
            Some((inner, authenticated, code)) => {
                let caller = self.gate()?.takes(&authenticated, code)?;
                Some((inner, caller))
            }
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
    fn admits(&mut self, caller: &Caller, request: &Request) -> Result<(), AccessRefusal> {
        let mode = self.mode();
        let permitted = permit(mode, caller.role, request);
        let Some(gate) = self.gate() else {
            return permitted;
        };
        match request {
            Request::Wipe => {
                let holds = gate.jumper_holds();
                if holds && gate.register().jumper_is_held() {
                    return Ok(());
                }
                permitted?;
                holds.then_some(()).ok_or(AccessRefusal::JumperOpen)
            }
            Request::KeyEnrol(_) if mode == AccessMode::Open => {
                let holds = gate.jumper_holds();
                holds.then_some(()).ok_or(AccessRefusal::JumperOpen)
            }
            _ => permitted,
        }
    }

    /// The code of an answer.
    pub fn code(&self, of: &Authenticated<'_>) -> [u8; CODE] {
        let gate = self.look();
        gate.map_or([0; CODE], |gate| gate.code(of))
    }

    /// The host is gone.
    pub fn disconnected(&mut self) {
        if let Some(gate) = self.gate() {
            gate.disconnected();
        }
    }

    /// Ends a wipe: everything else was erased, and the new journal has its first entries.
    pub fn end_wipe<F: Flash>(&mut self, now: Micros, measure: &mut Instrument<F>) {
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
            && let Some(gate) = self.gate()
            && gate.forget(now).is_err()
        {
            measure.ledger.refused();
        }
    }
}

/// Looks whether somebody may ask for this; what is refused is journaled.
///
/// # Errors
/// Why not.
#[inline(never)]
pub(crate) fn admit<F: Flash>(
    measure: &mut Instrument<F>,
    guarded: &mut Guarded,
    now: Micros,
    caller: &Caller,
    request: &Request,
) -> Result<(), AccessRefusal> {
    let admitted = guarded.admits(caller, request);
    if let Err(why) = admitted {
        measure.refuse_access(now, why, caller.key_id);
    }
    admitted
}

/// The answer to a request about access.
#[inline(never)]
pub(crate) fn answer<F: Flash>(
    measure: &mut Instrument<F>,
    guarded: &mut Guarded,
    now: Micros,
    caller: &Caller,
    request: &Request,
) -> Response {
    let mode = guarded.mode();
    let Some(gate) = guarded.gate() else {
        return match request {
            Request::AccessGet => Response::Access(AccessInfo::default()),
            Request::KeyList => Response::Keys(Keys::new()),
            _ => Response::NotOnThisBoard,
        };
    };
    match request {
        Request::AccessGet => Response::Access(AccessInfo {
            mode,
            jumper: Some(gate.jumper()),
            retry_in_s: gate.retry_in_s(now),
            board_key: gate.board_key(),
        }),
        Request::KeyList => Response::Keys(gate.register().keys().clone()),
        Request::SessionBegin(ask) => {
            let begun = gate.begin(now, ask).map(Response::SessionChallenge);
            begun.unwrap_or_else(|slowed| slow(measure, now, slowed))
        }
        Request::SessionProve { signature } => {
            let proven = gate.prove(now, *signature);
            let proven = proven.map(|(role, signature)| Response::SessionOpen { role, signature });
            proven.unwrap_or_else(|slowed| slow(measure, now, slowed))
        }
        _ if gate.board_key().is_none() => Response::NotOnThisBoard,
        Request::Wipe => {
            let begun = measure
                .to_be_wiped(caller)
                .map(|wiping| gate.begin_wipe(now, wiping));
            match begun {
                Some(Ok(())) => {
                    guarded.restarts = true;
                    Response::Done
                }
                _ => Response::StorageFailed,
            }
        }
        _ => {
            let by = caller.key_id;
            let mut tell = |told: Told| measure.tell_access(now, told, by);
            match gate.change(now, request, caller, &mut tell) {
                Ok(true) => Response::Done,
                Ok(false) => Response::StorageFailed,
                Err(why) => {
                    measure.refuse_access(now, why, by);
                    Response::AccessRefused(why)
                }
            }
        }
    }
}

/// A key was not taken.
fn slow<F: Flash>(measure: &mut Instrument<F>, now: Micros, slowed: Slowed) -> Response {
    match slowed.why {
        None => Response::NotOnThisBoard,
        Some(why) => {
            measure.refuse_access(now, why, slowed.key_id);
            Response::AccessRefused(slowed.told)
        }
    }
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
    /// What a wipe takes away; none: the journal cannot be read, and nothing could be told.
    fn to_be_wiped(&self, caller: &Caller) -> Option<Wiping> {
        let journal = self.ledger.journal.get()?;
        Some(Wiping {
            first_seq: journal.first_seq(),
            next_seq: journal.next_seq(),
            chain: journal.chain_head().0,
            key_id: caller.key_id,
        })
    }
}
