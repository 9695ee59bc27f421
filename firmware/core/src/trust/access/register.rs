//! The keys that a board knows, its lock, and what a wipe leaves: one value that is kept whole or
//! not at all.
//!
//! How old it is stands behind the rest ([`Age`]). A firmware that knows nothing of that reads what stands before it:
//! one that is put back after a trial locks nobody out. One that knew no lives ([`Age::life`]) has kept what reads as life 0.

use serde::{Deserialize, Serialize};
use umi_protocol::access::{AccessMode, AccessRefusal, KeyId, KeyInfo, Keys, Role};

use super::tries::WrongKeys;
use crate::trust::board_key::{key_id, may_prove};

/// Starts in a row with the jumper closed that count.
pub const JUMPER_STARTS: u8 = 2;

/// What is kept. A new board has no keys, and is open.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeyRegister {
    keys: Keys,
    locked: bool,
    /// It could not be read: the board is locked, and nobody has a key.
    lost: bool,
    jumper_starts: u8,
    /// Wrong keys in a row.
    pub wrong_keys: WrongKeys,
    /// A wipe that has begun.
    pub wiping: Option<Wiping>,
    age: Age,
    /// The first owner's key is being enrolled: the journal may tell of it before it is here.
    claiming: bool,
}

/// How often an owner has changed something. Each of two memories keeps both numbers, so that a copy of one of them that is
/// older than the other is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Age {
    /// Keys or the lock, in the lower half; 0: not by a firmware that counts. The life of the board, in the upper one.
    pub keys: u64,
    /// The configuration.
    pub config: u32,
}

impl Age {
    /// Behind every change that an owner makes: the keys are lost, and none from before counts any more.
    pub const LOST: u64 = 1 << 31;

    /// The keys at the beginning of the life with this number.
    #[must_use]
    pub const fn begun(life: u32) -> u64 {
        (life as u64) << 32
    }

    /// From the first owner's claim to the wipe a board has one life. Its number is drawn; 0: none has begun, or by a firmware
    /// that knew none.
    #[must_use]
    pub const fn life(self) -> u32 {
        (self.keys >> 32) as u32
    }

    /// How often keys or the lock were changed in it.
    #[must_use]
    pub const fn changes(self) -> u32 {
        self.keys as u32
    }
}

/// What was kept before there was an age.
#[derive(Deserialize)]
struct RegisterBefore {
    keys: Keys,
    locked: bool,
    lost: bool,
    jumper_starts: u8,
    wrong_keys: WrongKeys,
    wiping: Option<Wiping>,
}

impl From<RegisterBefore> for KeyRegister {
    fn from(before: RegisterBefore) -> Self {
        Self {
            keys: before.keys,
            locked: before.locked,
            lost: before.lost,
            jumper_starts: before.jumper_starts,
            wrong_keys: before.wrong_keys,
            wiping: before.wiping,
            age: Age::default(),
            claiming: false,
        }
    }
}

/// What is told when the wipe has ended; zeros: the journal could not be opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wiping {
    /// The oldest entry of the journal that goes.
    pub first_seq: u64,
    /// The number that its next would have got.
    pub next_seq: u64,
    /// Its chain value.
    pub chain: [u8; 32],
    /// By whose key; none: by the jumper alone.
    pub key_id: Option<KeyId>,
}

impl KeyRegister {
    /// What was kept, by this firmware or by one before it.
    #[must_use]
    pub fn read(kept: &[u8]) -> Option<Self> {
        let before = || postcard::from_bytes::<RegisterBefore>(kept).map(Self::from);
        postcard::from_bytes(kept).or_else(|_| before()).ok()
    }

    /// How old it is.
    #[must_use]
    pub fn age(&self) -> Age {
        self.age
    }

    /// Of this age.
    #[must_use]
    pub fn aged(self, age: Age) -> Self {
        Self { age, ..self }
    }

    /// In the life with this number, if it is in none yet.
    #[must_use]
    pub fn in_life(mut self, life: u32) -> Self {
        if self.age.life() == 0 {
            self.age.keys |= Age::begun(life);
        }
        self
    }

    /// With the first owner's key under way, or not.
    #[must_use]
    pub fn with_claim(&self, claiming: bool) -> Self {
        Self {
            claiming,
            ..self.clone()
        }
    }

    /// Whether the journal may tell of an owner whose key was not kept.
    #[must_use]
    pub fn is_claiming(&self) -> bool {
        self.claiming
    }

    /// One change later.
    fn changed(mut self) -> Self {
        self.age.keys = self.age.keys.saturating_add(1);
        self.claiming = false;
        self
    }

    /// Something was kept and cannot be read: nobody may do anything but with the jumper.
    #[must_use]
    pub fn lost() -> Self {
        Self {
            lost: true,
            ..Self::default()
        }
    }

    /// Whether it could not be read.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        self.lost
    }

    /// Whether the same keys may do the same.
    #[must_use]
    pub fn grants_as(&self, other: &Self) -> bool {
        let rights = |of: &Self| (of.locked, of.lost);
        self.keys == other.keys && rights(self) == rights(other)
    }

    /// Who may do what.
    #[must_use]
    pub fn mode(&self) -> AccessMode {
        if self.lost || self.locked {
            AccessMode::Locked
        } else if self.keys.is_empty() {
            AccessMode::Open
        } else {
            AccessMode::Claimed
        }
    }

    /// The keys.
    #[must_use]
    pub fn keys(&self) -> &Keys {
        &self.keys
    }

    /// What this key is for; none: it is not known.
    #[must_use]
    pub fn role_of(&self, public: &[u8; 32]) -> Option<Role> {
        let known = self.keys.iter().find(|known| known.public == *public);
        known.map(|known| known.role)
    }

    /// The key of this name.
    #[must_use]
    pub fn find(&self, id: KeyId) -> Option<&KeyInfo> {
        self.keys.iter().find(|known| key_id(&known.public) == id)
    }

    /// With a key, or with another role of it. The first is an owner's. None: it is so already.
    ///
    /// # Errors
    /// [`AccessRefusal`].
    pub fn enrolled(&self, key: &KeyInfo) -> Result<Option<Self>, AccessRefusal> {
        if self.lost {
            return Err(AccessRefusal::Locked);
        }
        if key.role == Role::None || !may_prove(&key.public) {
            return Err(AccessRefusal::NotAKey);
        }
        if self.keys.is_empty() && key.role != Role::Owner {
            let needs = Role::Owner;
            return Err(AccessRefusal::KeyNeeded { needs });
        }
        let mut register = self.clone();
        match register.keys.iter_mut().find(|of| of.public == key.public) {
            Some(known) if known == key => return Ok(None),
            Some(known) => *known = key.clone(),
            None => register
                .keys
                .push(key.clone())
                .map_err(|_| AccessRefusal::KeysFull)?,
        }
        register.changed().with_an_owner().map(Some)
    }

    /// Without this key, and what it was for. None: it is not known already.
    ///
    /// # Errors
    /// [`AccessRefusal::LastOwner`].
    pub fn revoked(&self, id: KeyId) -> Result<Option<(Self, Role)>, AccessRefusal> {
        let Some(role) = self.find(id).map(|known| known.role) else {
            return Ok(None);
        };
        let mut register = self.clone();
        register.keys.retain(|known| key_id(&known.public) != id);
        Ok(Some((register.changed().with_an_owner()?, role)))
    }

    /// Locked or not; none: it is so already.
    ///
    /// # Errors
    /// [`AccessRefusal::KeyNeeded`]: nobody could unlock it.
    pub fn with_lock(&self, locked: bool) -> Result<Option<Self>, AccessRefusal> {
        if self.keys.is_empty() {
            let needs = Role::Owner;
            return Err(AccessRefusal::KeyNeeded { needs });
        }
        let changed = || Self {
            locked,
            ..self.clone().changed()
        };
        Ok((self.locked != locked).then(changed))
    }

    /// The board starts with the jumper closed or open; none: that changes nothing.
    #[must_use]
    pub fn started(&self, is_closed: bool) -> Option<Self> {
        let jumper_starts = match is_closed {
            true => (self.jumper_starts + 1).min(JUMPER_STARTS),
            false => 0,
        };
        (self.jumper_starts != jumper_starts).then(|| Self {
            jumper_starts,
            ..self.clone()
        })
    }

    /// The jumper was closed at this start and the one before: it may stand for an owner's key.
    #[must_use]
    pub fn jumper_is_held(&self) -> bool {
        self.jumper_starts >= JUMPER_STARTS
    }

    /// An owned board keeps an owner.
    fn with_an_owner(self) -> Result<Self, AccessRefusal> {
        let has_owner = self.keys.iter().any(|known| known.role == Role::Owner);
        has_owner.then_some(self).ok_or(AccessRefusal::LastOwner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use umi_protocol::access::{KeyName, MAX_KEYS};

    fn key(of: u8, role: Role) -> KeyInfo {
        let public = ed25519_dalek::SigningKey::from_bytes(&[of; 32]).verifying_key();
        KeyInfo {
            public: public.to_bytes(),
            role,
            name: KeyName::try_from("somebody").unwrap(),
        }
    }

    fn claimed() -> KeyRegister {
        let open = KeyRegister::default();
        open.enrolled(&key(1, Role::Owner)).unwrap().unwrap()
    }

    /// The first key is an owner's, and the last owner's stays; nothing else claims a board.
    #[test]
    fn an_owned_board_keeps_an_owner() {
        let open = KeyRegister::default();
        assert_eq!(open.mode(), AccessMode::Open);
        for role in [Role::Operator, Role::Engineer] {
            let needs = Role::Owner;
            let refused = Err(AccessRefusal::KeyNeeded { needs });
            assert_eq!(open.enrolled(&key(1, role)), refused);
        }
        let owned = claimed();
        let id = key_id(&key(1, Role::Owner).public);
        assert_eq!(owned.mode(), AccessMode::Claimed);
        assert_eq!(owned.enrolled(&key(1, Role::Owner)), Ok(None));
        assert_eq!(owned.revoked(id), Err(AccessRefusal::LastOwner));
        let lower = owned.enrolled(&key(1, Role::Engineer));
        assert_eq!(lower, Err(AccessRefusal::LastOwner));
        let two = owned.enrolled(&key(2, Role::Owner)).unwrap().unwrap();
        let (one, role) = two.revoked(id).unwrap().unwrap();
        assert_eq!((one.keys().len(), role), (1, Role::Owner));
        assert_eq!(one.revoked(id), Ok(None));
    }

    /// Points of a small order and what is no point prove nothing; a register that is full says so.
    #[test]
    fn what_cannot_prove_is_no_key() {
        let mut owned = claimed();
        let no_point = (2..50).map(|y| {
            let mut point = [0; 32];
            point[0] = y;
            point
        });
        let is_none = |point: &[u8; 32]| ed25519_dalek::VerifyingKey::from_bytes(point).is_err();
        let no_point = no_point.into_iter().find(is_none).unwrap();
        for public in [[0; 32], no_point] {
            let none = KeyInfo {
                public,
                role: Role::Operator,
                name: KeyName::new(),
            };
            assert_eq!(owned.enrolled(&none), Err(AccessRefusal::NotAKey));
        }
        for of in 2..=MAX_KEYS as u8 {
            owned = owned.enrolled(&key(of, Role::Operator)).unwrap().unwrap();
        }
        let one_more = owned.enrolled(&key(99, Role::Operator));
        assert_eq!(one_more, Err(AccessRefusal::KeysFull));
    }

    /// The jumper stands for a key only where it was closed at two starts in a row.
    #[test]
    fn the_jumper_is_held_over_two_starts() {
        let register = claimed();
        assert_eq!(register.started(false), None);
        let once = register.started(true).unwrap();
        assert!(!once.jumper_is_held());
        assert!(!once.started(false).unwrap().jumper_is_held());
        let twice = once.started(true).unwrap();
        assert!(twice.jumper_is_held());
        assert_eq!(twice.started(true), None);
    }

    /// What cannot be read is locked, and nobody enrols a key there.
    #[test]
    fn what_is_lost_is_locked() {
        let lost = KeyRegister::lost();
        assert_eq!(lost.mode(), AccessMode::Locked);
        assert_eq!(
            lost.enrolled(&key(1, Role::Owner)),
            Err(AccessRefusal::Locked)
        );
        assert!(lost.with_lock(false).is_err());
    }

    proptest! {
        /// Whatever is done: a board that was claimed never has no owner.
        #[test]
        fn never_open_after_claimed(deeds in prop::collection::vec((0_u8..4, 1_u8..6, 1_usize..4), 0..40)) {
            let mut register = claimed();
            for (deed, of, role) in deeds {
                let role = Role::ALL[role];
                let key = key(of, role);
                let next = match deed {
                    0 => register.enrolled(&key).ok().flatten(),
                    1 => register.revoked(key_id(&key.public)).ok().flatten().map(|(next, _)| next),
                    deed => register.with_lock(deed == 2).ok().flatten(),
                };
                register = next.unwrap_or(register);
                prop_assert_ne!(register.mode(), AccessMode::Open);
                prop_assert!(register.keys().iter().any(|of| of.role == Role::Owner));
            }
        }
    }
}
