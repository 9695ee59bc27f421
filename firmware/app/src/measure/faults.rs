//! Equal faults: one entry of the journal a second, and how many more there were.
//!
//! Noise on the line makes a fault of each of its lines. They say the same, so the first of them
//! is journaled as it is, and those that follow it within [`APART_US`] are counted, and told by one
//! record with the latest of them ([`umi_protocol::message::Record::FaultsAgain`]): when that time
//! is over, or before anything else that is decided.

use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;
use umi_protocol::fault::{Fault, FaultCode};

/// From one entry about equal faults to the next.
pub const APART_US: u64 = 1_000_000;

/// Whether faults of this name are told one by one at most once a second: those that noise makes.
/// What says which point or row is missing is always told.
const fn is_noise(code: FaultCode) -> bool {
    matches!(
        code,
        FaultCode::BadParity
            | FaultCode::UnknownCharacter
            | FaultCode::LineTooLong
            | FaultCode::LineUnterminated
            | FaultCode::NotUnderstood
            | FaultCode::BinaryData
    )
}

/// Faults that are counted.
pub(crate) struct RepeatedFaults {
    /// The latest, of those that are not told yet, or the one that was.
    latest: ZeroOption<Fault>,
    /// When the one was told from which on they are counted.
    since: Micros,
    count: u32,
}

impl RepeatedFaults {
    pub const fn new() -> Self {
        Self {
            latest: ZeroOption::empty(),
            since: Micros(0),
            count: 0,
        }
    }

    /// Whether this one is counted only. If it is not, what was counted is to be told before it,
    /// and it after that.
    pub fn counts(&mut self, now: Micros, fault: &Fault) -> bool {
        let is_equal = self
            .latest
            .get()
            .is_some_and(|latest| latest.code() == fault.code());
        let is_near = now.0 < self.since.0.saturating_add(APART_US);
        if !(is_equal && is_near && is_noise(fault.code())) {
            return false;
        }
        self.count = self.count.saturating_add(1);
        self.latest.put(fault.clone());
        true
    }

    /// This one is told now.
    pub fn begin(&mut self, now: Micros, fault: &Fault) {
        self.latest.put(fault.clone());
        self.since = now;
        self.count = 0;
    }

    /// What was counted and is to be told, once.
    pub fn take(&mut self) -> Option<(Fault, u32)> {
        let count = core::mem::take(&mut self.count);
        let latest = self.latest.get().filter(|_| count > 0)?;
        Some((latest.clone(), count))
    }

    /// When what was counted is to be told at the latest.
    pub fn due(&self) -> Option<Micros> {
        (self.count > 0).then(|| Micros(self.since.0.saturating_add(APART_US)))
    }
}

#[cfg(test)]
mod tests {
    use umi_protocol::fault::FaultKind;

    use super::*;

    fn fault(kind: FaultKind, line: u32) -> Fault {
        Fault {
            kind,
            line,
            byte_offset: 0,
            t_us: 0,
            text: "X".parse().unwrap(),
        }
    }

    /// The first is told, those within a second are counted, with the latest; another name ends
    /// that, and so does the second.
    #[test]
    fn equal_faults_are_counted_for_a_second() {
        let mut faults = RepeatedFaults::new();
        let noise = |line| fault(FaultKind::NotUnderstood, line);
        assert!(!faults.counts(Micros(5), &noise(1)));
        faults.begin(Micros(5), &noise(1));
        assert_eq!((faults.take(), faults.due()), (None, None));
        for line in 2..9 {
            assert!(faults.counts(Micros(6), &noise(line)));
        }
        assert_eq!(faults.due(), Some(Micros(APART_US + 5)));
        assert!(!faults.counts(Micros(7), &fault(FaultKind::NullPoint, 9)));
        assert_eq!(faults.take(), Some((noise(8), 7)));
        assert_eq!(faults.take(), None);
        faults.begin(Micros(7), &fault(FaultKind::NullPoint, 9));
        assert!(!faults.counts(Micros(7), &fault(FaultKind::NullPoint, 10)));
        faults.begin(Micros(8), &noise(11));
        assert!(faults.counts(Micros(APART_US + 7), &noise(12)));
        assert!(!faults.counts(Micros(APART_US + 8), &noise(13)));
    }
}
