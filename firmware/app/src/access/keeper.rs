//! Keys on a flash area of their own, and the session of the host that is there.
//!
//! # Design
//!
//! All that is kept ([`KeyRegister`]) stands in one entry of a small journal, so that it changes whole
//! or not at all; the newest entry counts. It is written twice: a newest entry that is damaged at
//! rest looks like one that a power cut tore, and the one before it must not be an older state. Where keys
//! or the lock change, the second stands in another sector, so that no damage of one sector brings a revoked key back.
//! Where something was kept and cannot be read, the board is locked and nobody has a key: never open.
//! So it is where nothing is there any more, or only what is older than [`crate::measure::trust::custody`] knows, of another
//! life of the board ([`Age::life`]), or two changes later: custody is written before a change where it is not as late as
//! the keys, so that a power cut leaves it one behind at most. A damaged area is begun anew then, so that the starts with
//! the jumper closed are counted. Where a sector's header is damaged and custody knows that what is left is the newest,
//! nothing is lost.

use umi_core::journal::{Flash, Journal, JournalError, NotOpened};
use umi_core::trust::access::register::{Age, KeyRegister, Wiping};
use umi_core::trust::access::session::{BoardHandshake, BoardSession, SignatureParts};
use umi_core::trust::access::tries::Tries;
use umi_core::trust::board_key::key_id;
use umi_core::units::Micros;
use umi_protocol::access::{
    AccessChange, AccessMode, AccessRefusal, KeyInfo, MAX_KEYS, Role, SessionAsk, SessionChallenge,
};
use umi_protocol::config::AccessConfig;
use umi_protocol::frame::{Authenticated, CODE};
use umi_protocol::immediate::SessionRequest;
use umi_protocol::message::Request;
use umi_protocol::schema::max_len;

use super::proof::{Draw, Work, Worked};
use super::{Caller, KeysNotKept, Slowed, Told};
use crate::measure::trust::signer::HeadSigner;

/// Kind number of the only entry there is. A later layout that the firmware before cannot read gets another.
const KIND: u8 = 1;

/// Bytes of an entry, at most: the keys and some numbers.
const MOST: usize = 128 + MAX_KEYS * max_len::<KeyInfo>();

/// The area of the keys.
enum Area<F: Flash> {
    Open(Journal<F>),
    /// It holds something else than a journal.
    Damaged(F),
    /// Its flash does not answer: nothing is known of what it holds.
    Unreachable,
}

impl<F: Flash> Area<F> {
    fn ring(&mut self) -> Option<&mut Journal<F>> {
        match self {
            Self::Open(ring) => Some(ring),
            Self::Damaged(_) | Self::Unreachable => None,
        }
    }

    /// Erases one that is damaged. A power cut on the way leaves one that is damaged, or looks new.
    fn begin_anew(&mut self) {
        *self = match core::mem::replace(self, Self::Unreachable) {
            Self::Damaged(mut flash) => match Journal::format(&mut flash) {
                Ok(()) => Self::opened(flash).0,
                Err(_) => Self::Damaged(flash),
            },
            as_it_is => as_it_is,
        };
    }

    /// Opens it, and says whether what counts may stand where it cannot be read.
    fn opened(flash: F) -> (Self, bool) {
        match Journal::open_or_return(flash) {
            Ok((ring, recovery)) => (Self::Open(ring), recovery.damaged_headers > 0),
            Err(NotOpened {
                error: JournalError::Flash(_),
                ..
            }) => (Self::Unreachable, true),
            Err(damaged) => (Self::Damaged(damaged.flash), true),
        }
    }

    /// What was kept last; none: it cannot be read.
    fn newest(&mut self) -> Option<KeyRegister> {
        let ring = self.ring()?;
        let Some(newest) = ring.next_seq().checked_sub(1) else {
            return Some(KeyRegister::default());
        };
        let mut room = [0; MOST];
        match ring.read(newest, &mut room) {
            Ok(found) if found.entry.kind == KIND => KeyRegister::read(found.entry.payload),
            Err(JournalError::Flash(_)) => {
                *self = Self::Unreachable;
                None
            }
            _ => None,
        }
    }
}

/// Says whether the jumper is closed now.
pub type Jumper = fn() -> bool;

/// What a board with an owner knows: the keys, and the session. Every error of its flash is
/// [`KeysNotKept`]: nothing has changed.
pub struct Keeper<F: Flash> {
    area: Area<F>,
    register: KeyRegister,
    /// What was kept cannot be read, or may be older than what cannot be read: until [`Self::settle`] nobody has a key.
    is_doubtful: bool,
    tries: Tries,
    jumper: Jumper,
    /// Whether it was closed at the start.
    at_start: bool,
    signer: Option<&'static HeadSigner>,
    draw: Draw,
    /// For the request that is answered next.
    worked: Option<Worked>,
    handshake: Option<BoardHandshake>,
    /// The session, and its host's key.
    session: Option<(BoardSession, [u8; 32])>,
    /// When it was heard of last.
    heard: Micros,
    /// For so long it lives without a request.
    idle_us: u64,
}

impl<F: Flash> Keeper<F> {
    /// Opens the area and looks at the jumper. A board whose area cannot be opened is locked.
    pub fn open(
        flash: F,
        jumper: Jumper,
        signer: Option<&'static HeadSigner>,
        draw: Draw,
        now: Micros,
    ) -> Self {
        let (mut area, mut is_doubtful) = Area::opened(flash);
        let found = area.newest();
        is_doubtful |= found.is_none();
        let register = match found {
            Some(found) if !is_doubtful => found,
            // Who had begun a wipe has no key to lose.
            found => {
                let mut lost = KeyRegister::lost();
                if let Some(found) = found {
                    let keys = found.age().keys;
                    lost = lost.aged(Age { keys, config: 0 });
                    lost.wiping = found.wiping;
                }
                lost
            }
        };
        let at_start = jumper();
        let tries = Tries::new(register.wrong_keys, now);
        let mut keeper = Self {
            area,
            register,
            is_doubtful,
            tries,
            jumper,
            at_start,
            signer,
            draw,
            worked: None,
            handshake: None,
            session: None,
            heard: Micros(0),
            idle_us: AccessConfig::NEW.session_idle_us(),
        };
        if !is_doubtful {
            keeper.count_start(now);
        }
        keeper
    }

    /// Whether a wipe has begun in this area and not ended, for who opens what else the board keeps.
    pub fn is_wiping(flash: &mut F) -> bool {
        let register = Area::opened(flash).0.newest();
        register.is_some_and(|register| register.wiping.is_some())
    }

    fn count_start(&mut self, now: Micros) {
        if let Some(started) = self.register.started(self.at_start) {
            // What is not kept is counted by the next start.
            let _ = self.save(now, started);
        }
    }

    #[inline(never)]
    fn save(&mut self, now: Micros, register: KeyRegister) -> Result<(), KeysNotKept> {
        let mut room = [0; MOST];
        let payload = postcard::to_slice(&register, &mut room).map_err(|_| KeysNotKept)?;
        let ring = self.area.ring().ok_or(KeysNotKept)?;
        let is_apart = register.age() != self.register.age()
            || !register.grants_as(&self.register)
            || self.is_doubtful;
        for copy in 0..2 {
            if is_apart && copy > 0 {
                ring.turn();
            }
            let appended = ring.append(KIND, now, payload);
            appended.map_err(|_| KeysNotKept)?;
        }
        self.register = register;
        Ok(())
    }

    /// A key was wrong.
    fn wrong(&mut self, now: Micros, why: AccessRefusal, key: Option<&[u8; 32]>) -> Slowed {
        let key_id = key.map(key_id);
        let told = match self.tries.wrong(now) {
            Ok(()) => why,
            Err(retry_in_s) => AccessRefusal::TooManyTries { retry_in_s },
        };
        self.keep_tries(now);
        Slowed {
            why: Some(why),
            told,
            key_id,
        }
    }

    fn keep_tries(&mut self, now: Micros) {
        let wrong_keys = self.tries.kept();
        if self.register.wrong_keys != wrong_keys {
            let mut register = self.register.clone();
            register.wrong_keys = wrong_keys;
            // Until the next start it is known all the same.
            let _ = self.save(now, register);
        }
    }
}

/// What becomes of the register, and what is told; none: it is so already.
#[inline(never)]
fn changed(
    register: &KeyRegister,
    request: &Request,
    caller: &Caller,
) -> Result<Option<(KeyRegister, Told)>, AccessRefusal> {
    let told = |what, key_id, role| Told { what, key_id, role };
    Ok(match request {
        Request::KeyEnrol(key) => {
            let told = told(AccessChange::Enrolled, key_id(&key.public), key.role);
            register.enrolled(key)?.map(|next| (next, told))
        }
        Request::KeyRevoke { key_id } => register
            .revoked(*key_id)?
            .map(|(next, role)| (next, told(AccessChange::Revoked, *key_id, role))),
        Request::LockSet { locked } => {
            let what = match locked {
                true => AccessChange::Locked,
                false => AccessChange::Unlocked,
            };
            let told = told(what, caller.key_id.unwrap_or_default(), caller.role);
            register.with_lock(*locked)?.map(|next| (next, told))
        }
        // All that an owner changes here is above.
        _ => None,
    })
}

/// The board cannot have sessions.
const NO_SESSIONS: Slowed = Slowed {
    why: None,
    told: AccessRefusal::NoSession,
    key_id: None,
};

impl<F: Flash> Keeper<F> {
    /// What is kept.
    #[must_use]
    pub fn register(&self) -> &KeyRegister {
        &self.register
    }

    /// Does from now on as the owner has set, also with the session that there is.
    pub fn follow(&mut self, config: &AccessConfig) {
        self.idle_us = config.session_idle_us();
    }

    /// Does what an owner asks, and has it noted and journaled before it is kept; false: one of them failed. To be noted is
    /// how often the keys were changed before ([`Age::keys`]), of a first owner in the life that begins.
    ///
    /// # Errors
    /// [`AccessRefusal`]: nothing has changed.
    pub fn change(
        &mut self,
        now: Micros,
        request: &Request,
        caller: &Caller,
        tell: impl FnOnce(u64, Told) -> bool,
    ) -> Result<bool, AccessRefusal> {
        match changed(&self.register, request, caller)? {
            // It is so already.
            None => Ok(true),
            Some((mut register, told)) => {
                let mut before = self.register.age().keys;
                if register.age().life() == 0 {
                    let mut drawn = [0; 32];
                    if (self.draw)(&mut drawn).is_err() {
                        return Ok(false);
                    }
                    let [a, b, c, d, ..] = drawn;
                    register = register.in_life(u32::from_le_bytes([a, b, c, d]).max(1));
                }
                if self.register.mode() == AccessMode::Open {
                    before = Age::begun(register.age().life());
                    // A record of an owner whose key was not kept would lock the board at the next start.
                    let claiming = self.register.with_claim(true);
                    if self.save(now, claiming).is_err() {
                        return Ok(false);
                    }
                }
                // The record first.
                Ok(tell(before, told) && self.save(now, register).is_ok())
            }
        }
    }

    /// Where what counts cannot be read, or may be older: takes what is left, if custody knows that it is the newest, or that
    /// there never was a key. False: nobody knows, and nobody has a key.
    #[inline(never)]
    pub fn settle(&mut self, now: Micros, known: Option<Age>) -> bool {
        if !self.is_doubtful {
            return true;
        }
        let found = self.area.newest();
        let known = known.filter(|_| self.is_reachable());
        let register = match (found, known) {
            (Some(found), Some(known)) if found.age().keys == known.keys => found,
            (None, Some(Age { keys: 0, .. })) => KeyRegister::default(),
            _ => return false,
        };
        self.area.begin_anew();
        self.tries = Tries::new(register.wrong_keys, now);
        // Twice again, and further round the ring: in time over what is damaged.
        if self.save(now, register.clone()).is_err() {
            self.register = register;
        }
        self.is_doubtful = false;
        self.count_start(now);
        true
    }

    /// Whether the flash of the area answers.
    #[must_use]
    pub fn is_reachable(&self) -> bool {
        !matches!(self.area, Area::Unreachable)
    }

    /// Nobody has a key until the next start.
    pub fn lock(&mut self) {
        self.register = KeyRegister::lost();
    }

    /// Keys were kept, and there are none any more, or only older ones: nobody has a key. A damaged area is begun anew, if
    /// custody knows already that the board has an owner.
    #[inline(never)]
    pub fn lose(&mut self, now: Micros, age: Age, is_known: bool) {
        if is_known {
            self.area.begin_anew();
        }
        // What is not kept is found so by the next start, too.
        if self.save(now, KeyRegister::lost().aged(age)).is_err() {
            self.register = KeyRegister::lost();
        }
        self.is_doubtful = false;
        self.count_start(now);
    }

    /// Keeps how often the configuration was changed, if that is not known yet.
    ///
    /// # Errors
    /// [`KeysNotKept`].
    pub fn note_config(&mut self, now: Micros, config: u32) -> Result<(), KeysNotKept> {
        let age = self.register.age();
        if age.config == config {
            return Ok(());
        }
        let register = self.register.clone();
        self.save(now, register.aged(Age { config, ..age }))
    }

    /// What the journal tells of an owner from before now was a claim that a power cut has ended.
    pub fn claim_has_ended(&mut self, now: Micros) {
        let register = self.register.with_claim(false);
        // The next start tries again.
        let _ = self.save(now, register);
    }

    /// Keeps that a wipe has begun, of the life that custody knows (`age`). After `Ok` it survives a power cut.
    ///
    /// # Errors
    /// [`KeysNotKept`].
    pub fn begin_wipe(&mut self, now: Micros, wiping: Wiping, age: Age) -> Result<(), KeysNotKept> {
        let mut register = self.register.clone().aged(age);
        register.wiping = Some(wiping);
        self.area.begin_anew();
        self.save(now, register)
    }

    /// Keeps this as on a new board, and so that nothing before it can be read any more.
    ///
    /// # Errors
    /// [`KeysNotKept`].
    pub fn forget(&mut self, now: Micros) -> Result<(), KeysNotKept> {
        self.disconnected();
        self.tries = Tries::default();
        let oldest = |keeper: &mut Self| keeper.area.ring().map_or(0, |ring| ring.first_seq());
        let last = self.area.ring().map_or(0, |ring| ring.next_seq());
        // Once round: what stood before is erased. This start is one with the jumper as it was.
        let fresh = KeyRegister::default();
        let fresh = fresh.started(self.at_start).unwrap_or(fresh);
        while oldest(self) < last {
            self.save(now, fresh.clone())?;
        }
        self.is_doubtful = false;
        Ok(())
    }

    /// The board's public key; none: it has none, and cannot be claimed.
    #[must_use]
    pub fn board_key(&self) -> Option<[u8; 32]> {
        self.signer.map(|signer| signer.key())
    }

    /// Whether the jumper is closed now.
    #[must_use]
    pub fn jumper(&self) -> bool {
        (self.jumper)()
    }

    /// Whether it was closed at the start and is now.
    #[must_use]
    pub fn jumper_holds(&self) -> bool {
        self.at_start && (self.jumper)()
    }

    /// Seconds until a wrong key is looked at.
    #[must_use]
    pub fn retry_in_s(&self, now: Micros) -> u32 {
        self.tries.retry_in_s(now)
    }

    /// What is to be done before this request is answered; none: nothing of it takes long. What came
    /// of it goes to [`Self::prepared`].
    #[must_use]
    pub fn prepare(&mut self, request: &SessionRequest) -> Option<Work> {
        let signer = self.signer?;
        match request {
            // A key that is refused costs nothing, and what has come again has its answer.
            SessionRequest::Begin(ask) => {
                if self.begun(ask).is_some() {
                    return None;
                }
                let role = self.register.role_of(&ask.key);
                role.map(|_| Work::Draw(self.draw))
            }
            SessionRequest::Prove { signature } => {
                let handshake = self.handshake.take();
                handshake.map(|handshake| Work::Prove {
                    handshake,
                    signature: *signature,
                    signer,
                })
            }
        }
    }

    /// For the request that is answered next; none: nothing was done, and nothing from before counts.
    pub fn prepared(&mut self, worked: Option<Worked>) {
        self.worked = worked;
    }

    /// The challenge that this host has got and not answered: a line may double what it asked.
    fn begun(&self, ask: &SessionAsk) -> Option<&SessionChallenge> {
        let handshake = self.handshake.as_ref();
        let handshake = handshake.filter(|handshake| handshake.answers(ask))?;
        Some(handshake.challenge())
    }

    /// A host asks for a session, and its share is drawn.
    ///
    /// # Errors
    /// [`Slowed`].
    pub fn begin(&mut self, now: Micros, ask: &SessionAsk) -> Result<SessionChallenge, Slowed> {
        let board_key = self.board_key().ok_or(NO_SESSIONS)?;
        if self.register.role_of(&ask.key).is_none() {
            return Err(self.wrong(now, AccessRefusal::KeyUnknown, Some(&ask.key)));
        }
        if let Some(challenge) = self.begun(ask) {
            return Ok(*challenge);
        }
        let Some(Worked::Drawn(Some(drawn))) = self.worked.take() else {
            return Err(NO_SESSIONS);
        };
        let handshake = BoardHandshake::new(ask, board_key, drawn);
        let challenge = *handshake.challenge();
        self.handshake = Some(handshake);
        Ok(challenge)
    }

    /// A host has proven its key, or not: its role, and the board's signature.
    ///
    /// # Errors
    /// [`Slowed`].
    pub fn prove(&mut self, now: Micros) -> Result<(Role, SignatureParts), Slowed> {
        if self.signer.is_none() {
            return Err(NO_SESSIONS);
        }
        let Some(Worked::Proven { key, opens }) = self.worked.take() else {
            return Err(self.wrong(now, AccessRefusal::KeyWrong, None));
        };
        // It may have been revoked meanwhile.
        let role = self.register.role_of(&key);
        match (opens, role) {
            (Some((session, signature)), Some(role)) => {
                self.tries.right();
                self.keep_tries(now);
                (self.session, self.heard) = (Some((session, key)), now);
                Ok((role, signature))
            }
            _ => Err(self.wrong(now, AccessRefusal::KeyWrong, Some(&key))),
        }
    }

    /// Who has sealed this; none: not the session's host, or not now. A session that was idle for
    /// longer than the owner allows is gone with the first frame behind that.
    pub fn takes(
        &mut self,
        now: Micros,
        of: &Authenticated<'_>,
        code: &[u8; CODE],
    ) -> Option<Caller> {
        if now.0.saturating_sub(self.heard.0) > self.idle_us {
            self.session = None;
        }
        let (session, key) = self.session.as_mut()?;
        // A key that was revoked meanwhile has no session any more.
        let role = self.register.role_of(key)?;
        if !session.takes(of, code) {
            return None;
        }
        self.heard = now;
        Some(Caller {
            role,
            key_id: Some(key_id(key)),
            counter: Some(session.counter()),
        })
    }

    /// The code of an answer of the session.
    #[must_use]
    pub fn code(&self, of: &Authenticated<'_>) -> [u8; CODE] {
        let session = self.session.as_ref();
        session.map_or([0; CODE], |(session, _)| session.code(of))
    }

    /// The host is gone.
    pub fn disconnected(&mut self) {
        (self.session, self.handshake, self.worked) = (None, None, None);
    }
}

#[cfg(test)]
mod tests;
