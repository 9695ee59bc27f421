//! What somebody was refused: told at once, and then at most once a minute for each reason, with a
//! count.

use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;
use umi_protocol::access::{AccessRefusal, KeyId};
use umi_protocol::message::Record;

/// Between two entries of the same reason.
pub(crate) const INTERVAL_US: u64 = 60_000_000;

/// Reasons that are told.
const REASONS: usize = 7;

/// Counts for each reason. All zeros at the start.
pub(crate) struct Refusals([Refused; REASONS]);

struct Refused {
    /// None is told before this.
    until: Micros,
    /// Since the latest that was told.
    count: u32,
    latest: ZeroOption<(AccessRefusal, Option<KeyId>)>,
}

impl Refusals {
    pub const fn new() -> Self {
        const NONE: Refused = Refused {
            until: Micros(0),
            count: 0,
            latest: ZeroOption::empty(),
        };
        Self([NONE; REASONS])
    }

    /// One more.
    pub fn count(&mut self, why: AccessRefusal, key_id: Option<KeyId>) {
        let place = match why {
            AccessRefusal::KeyNeeded { .. } => 0,
            AccessRefusal::KeyUnknown => 1,
            AccessRefusal::KeyWrong => 2,
            AccessRefusal::RoleTooLow { .. } => 3,
            AccessRefusal::Locked => 4,
            AccessRefusal::JumperOpen => 5,
            AccessRefusal::NoSession => 6,
            // An owner was told so, or it was told as what it is.
            AccessRefusal::TooManyTries { .. }
            | AccessRefusal::LastOwner
            | AccessRefusal::KeysFull
            | AccessRefusal::NotAKey => return,
        };
        if let Some(of) = self.0.get_mut(place) {
            of.count = of.count.saturating_add(1);
            of.latest.put((why, key_id));
        }
    }

    /// When the next is to be told.
    pub fn due(&self) -> Option<Micros> {
        let waiting = self.0.iter().filter(|of| of.count > 0);
        waiting.map(|of| of.until).min()
    }

    /// One that is to be told now.
    pub fn take(&mut self, now: Micros) -> Option<Record> {
        let is_due = |of: &&mut Refused| of.count > 0 && now >= of.until;
        let of = self.0.iter_mut().find(is_due)?;
        let (why, key_id) = of.latest.take()?;
        let count = core::mem::take(&mut of.count);
        of.until = Micros(now.0.saturating_add(INTERVAL_US));
        Some(Record::AccessRefused { why, count, key_id })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first at once, then one a minute with its count; another reason has its own minute.
    #[test]
    fn one_entry_a_minute_for_each_reason() {
        let mut refusals = Refusals::new();
        let mut told = |now: u64, why| {
            refusals.count(why, None);
            match refusals.take(Micros(now)) {
                Some(Record::AccessRefused { count, .. }) => count,
                _ => 0,
            }
        };
        assert_eq!(told(5, AccessRefusal::KeyUnknown), 1);
        for now in 6..50 {
            assert_eq!(told(now, AccessRefusal::KeyUnknown), 0);
        }
        assert_eq!(told(50, AccessRefusal::KeyWrong), 1);
        assert_eq!(told(5 + INTERVAL_US, AccessRefusal::KeyUnknown), 45);
        assert_eq!(refusals.due(), None);
        refusals.count(AccessRefusal::KeyUnknown, None);
        assert_eq!(refusals.due(), Some(Micros(5 + 2 * INTERVAL_US)));
    }
}
