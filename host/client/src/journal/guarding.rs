//! Whether the board of a journal had an owner, entry by entry: what its records say.

use umi_protocol::access::{AccessChange, AccessMode, Role};
use umi_protocol::message::Record;

/// Follows the records of a journal, or of a board that reports.
#[derive(Clone, Copy, Debug, Default)]
pub struct Guarding {
    mode: Option<AccessMode>,
}

impl Guarding {
    /// Of a board that says what it is now.
    #[must_use]
    pub const fn of(mode: AccessMode) -> Self {
        Self { mode: Some(mode) }
    }

    /// Takes a record in: who may do what from then on; none: an entry that is not there any more
    /// may have changed it.
    pub fn follow(&mut self, seq: u64, record: &Record) -> Option<AccessMode> {
        match record {
            // A board is new, or was wiped.
            _ if seq == 0 => self.mode = Some(AccessMode::Open),
            Record::Wiped { .. } => self.mode = Some(AccessMode::Open),
            Record::Access { what, role, .. } => match what {
                AccessChange::Locked => self.mode = Some(AccessMode::Locked),
                AccessChange::Unlocked => self.mode = Some(AccessMode::Claimed),
                // A locked board takes no keys.
                AccessChange::Revoked => self.mode = Some(AccessMode::Claimed),
                AccessChange::Enrolled if *role == Role::Owner || self.mode.is_none() => {
                    self.mode = Some(AccessMode::Claimed);
                }
                AccessChange::Enrolled => {}
            },
            _ => {}
        }
        self.mode
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A board is open until its first owner comes; a journal without its beginning says nothing
    /// before a record of its keys.
    #[test]
    fn records_say_whose_board_it_is() {
        let access = |what, role| Record::Access {
            what,
            key_id: [1; 8],
            role,
            by: None,
        };
        let enrolled = access(AccessChange::Enrolled, Role::Owner);
        let mut guarding = Guarding::default();
        assert_eq!(guarding.follow(0, &Record::Time), Some(AccessMode::Open));
        assert_eq!(guarding.follow(1, &enrolled), Some(AccessMode::Claimed));
        let locked = access(AccessChange::Locked, Role::Owner);
        assert_eq!(guarding.follow(2, &locked), Some(AccessMode::Locked));
        assert_eq!(guarding.follow(3, &Record::Time), Some(AccessMode::Locked));
        let mut late = Guarding::default();
        assert_eq!(late.follow(700, &Record::Time), None);
        let engineer = access(AccessChange::Enrolled, Role::Engineer);
        assert_eq!(late.follow(701, &engineer), Some(AccessMode::Claimed));
    }
}
