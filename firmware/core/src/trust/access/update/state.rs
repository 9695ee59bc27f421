//! Which image counts, in a small journal: of its own, or that of the board's key.
//!
//! # Design
//!
//! All of it stands in one entry, so that it changes whole or not at all, and the newest entry counts. It is written
//! twice: a newest entry that is damaged at rest looks like one that was torn.
//!
//! A flash of few large sectors has no room for two journals. There it stands in each entry of the key's journal, behind
//! the key: who writes one of them writes the other as it was ([`crate::trust::board_key`]). A start opens the key first,
//! and nobody writes that again before the next.

use serde::{Deserialize, Serialize};
use umi_protocol::update::{ImageVersion, UpdateState};

use crate::journal::{Flash, Journal};
use crate::trust::board_key::{BEHIND_KEY, KEY_BYTES};
use crate::units::Micros;

/// Kind number of the only entry there is. A later layout gets another.
const KIND: u8 = 1;

/// Bytes of an entry, at most.
const MOST: usize = KEY_BYTES + BEHIND_KEY;

/// What is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Kept {
    /// The slot that runs; none: what is built in.
    pub active: Option<bool>,
    pub version: ImageVersion,
    pub counter: u32,
    /// The slot on trial, and whether it has started.
    pub trial: Option<(bool, bool)>,
    pub latest: UpdateState,
    /// The maker's key.
    pub maker: Option<[u8; 32]>,
}

impl Kept {
    /// Before any image came.
    pub fn new(built_in: Option<ImageVersion>) -> Self {
        Self {
            active: None,
            version: built_in.unwrap_or_default(),
            counter: 0,
            trial: None,
            latest: UpdateState::None,
            maker: None,
        }
    }
}

/// It cannot be read, or not be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct StateNotKept;

/// The journal that it stands in.
pub(super) struct StateRing<F: Flash> {
    ring: Journal<F>,
    /// The board's key, in front of it; none: the journal is its own.
    key: Option<[u8; KEY_BYTES]>,
}

impl<F: Flash> StateRing<F> {
    /// Opens it: what was kept, or this if nothing was.
    pub fn open(flash: F, behind_key: bool, new: Kept) -> Result<(Self, Kept), StateNotKept> {
        let (ring, recovery) = Journal::open(flash).map_err(|_| StateNotKept)?;
        // No key yet: zeros.
        let key = behind_key.then_some([0; KEY_BYTES]);
        let mut state = Self { ring, key };
        let Some(newest) = state.ring.next_seq().checked_sub(1) else {
            let is_new = recovery.damaged_headers == 0;
            return is_new.then_some((state, new)).ok_or(StateNotKept);
        };
        let mut room = [0; MOST];
        let found = state.ring.read(newest, &mut room).ok();
        let found = found.filter(|found| found.entry.kind == KIND);
        let mut payload = found.ok_or(StateNotKept)?.entry.payload;
        if let Some(key) = &mut state.key {
            let (front, behind) = payload.split_first_chunk().ok_or(StateNotKept)?;
            (*key, payload) = (*front, behind);
            if payload.is_empty() {
                // A board that had no boot loader before.
                return Ok((state, new));
            }
        }
        let kept = postcard::from_bytes(payload).map_err(|_| StateNotKept)?;
        Ok((state, kept))
    }

    /// Keeps it. After `Ok` it survives a power cut.
    pub fn keep(&mut self, kept: &Kept) -> Result<(), StateNotKept> {
        let mut room = [0; MOST];
        let key = self.key.as_ref().map_or(&[][..], |key| key);
        let (front, behind) = room.split_at_mut(key.len());
        front.copy_from_slice(key);
        let state = postcard::to_slice(kept, behind).map_err(|_| StateNotKept)?;
        let length = key.len() + state.len();
        let (payload, _) = room.split_at(length);
        for _ in 0..2 {
            let appended = self.ring.append(KIND, Micros(0), payload);
            appended.map_err(|_| StateNotKept)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The longest state there can be finds room behind the key.
    #[test]
    fn the_longest_state_has_room() {
        let longest = Kept {
            active: Some(true),
            version: [u16::MAX; 3],
            counter: u32::MAX,
            trial: Some((true, true)),
            latest: UpdateState::Reverted,
            maker: Some([0xFF; 32]),
        };
        let mut room = [0; BEHIND_KEY];
        assert!(postcard::to_slice(&longest, &mut room).is_ok());
    }
}
