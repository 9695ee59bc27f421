//! What somebody was refused: told at once, and then at most once a minute, with a count for each
//! reason. Each record is a piece of evidence. Of several reasons the one comes next that was told
//! longest ago: none is lost.

use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;
use umi_protocol::access::{AccessRefusal, KeyId};
use umi_protocol::message::Record;

/// Between two entries.
pub(crate) const INTERVAL_US: u64 = 60_000_000;

/// Reasons that are told.
const REASONS: usize = 7;

/// Counts for each reason. All zeros at the start.
pub(crate) struct Refusals {
    reasons: [Refused; REASONS],
    /// None is told before this.
    until: Micros,
}

struct Refused {
    /// When it was told last.
    told: Micros,
    /// Since then.
    count: u32,
    latest: ZeroOption<(AccessRefusal, Option<KeyId>)>,
}

impl Refusals {
    pub const fn new() -> Self {
        const NONE: Refused = Refused {
            told: Micros(0),
            count: 0,
            latest: ZeroOption::empty(),
        };
        Self {
            reasons: [NONE; REASONS],
            until: Micros(0),
        }
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
        if let Some(of) = self.reasons.get_mut(place) {
            of.count = of.count.saturating_add(1);
            of.latest.put((why, key_id));
        }
    }

    /// When the next is to be told.
    pub fn due(&self) -> Option<Micros> {
        let waits = self.reasons.iter().any(|of| of.count > 0);
        waits.then_some(self.until)
    }

    /// One that is to be told now.
    pub fn take(&mut self, now: Micros) -> Option<Record> {
        if now < self.until {
            return None;
        }
        let waiting = self.reasons.iter_mut().filter(|of| of.count > 0);
        let of = waiting.min_by_key(|of| of.told)?;
        let (why, key_id) = of.latest.take()?;
        let count = core::mem::take(&mut of.count);
        of.told = now;
        self.until = Micros(now.0.saturating_add(INTERVAL_US));
        Some(Record::AccessRefused { why, count, key_id })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    extern crate std;

    /// The first at once, then one a minute in all, whatever the reasons; each with its count, and none
    /// lost.
    #[test]
    fn one_entry_a_minute_in_all() {
        use AccessRefusal::{KeyUnknown, KeyWrong, Locked};
        let mut refusals = Refusals::new();
        refusals.count(KeyUnknown, None);
        let mut told = std::vec::Vec::new();
        for second in 1..=600_u64 {
            for why in [KeyUnknown, KeyWrong, Locked] {
                refusals.count(why, None);
            }
            while let Some(record) = refusals.take(Micros(second * 1_000_000)) {
                let Record::AccessRefused { why, count, .. } = record else {
                    panic!("{record:?}");
                };
                told.push((second, why, count));
            }
        }
        let minutes: std::vec::Vec<_> = told.iter().map(|(second, ..)| *second).collect();
        assert_eq!(minutes, [1, 61, 121, 181, 241, 301, 361, 421, 481, 541]);
        let counted = |of| -> std::vec::Vec<u32> {
            let told = told.iter().filter(|(_, why, _)| *why == of);
            told.map(|(.., count)| *count).collect()
        };
        assert_eq!(counted(KeyUnknown), [2, 180, 180, 180]);
        assert_eq!(counted(KeyWrong), [61, 180, 180]);
        assert_eq!(counted(Locked), [121, 180, 180]);
        assert_eq!(refusals.due(), Some(Micros(601_000_000)));
    }
}
