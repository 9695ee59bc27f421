//! How often somebody may do what costs room for evidence.

use umi_core::units::Micros;

/// Turns that come back with time. All zeros before the first: then all are there.
pub(crate) struct Bucket<const MOST: u32, const EACH_US: u64> {
    used: u32,
    /// Up to here, turns have come back.
    since: Micros,
}

impl<const MOST: u32, const EACH_US: u64> Bucket<MOST, EACH_US> {
    pub const fn new() -> Self {
        Self {
            used: 0,
            since: Micros(0),
        }
    }

    /// Takes a turn; false if there is none.
    pub fn take(&mut self, now: Micros) -> bool {
        let back = now.0.saturating_sub(self.since.0) / EACH_US;
        self.used = self
            .used
            .saturating_sub(u32::try_from(back).unwrap_or(u32::MAX));
        self.since = match self.used {
            0 => now,
            _ => Micros(self.since.0.saturating_add(back * EACH_US)),
        };
        let is_left = self.used < MOST;
        self.used += u32::from(is_left);
        is_left
    }

    /// What was taken for has not happened.
    pub fn give_back(&mut self) {
        self.used = self.used.saturating_sub(1);
    }

    /// When there is one at the latest.
    pub fn next(&self) -> Micros {
        match self.used < MOST {
            true => self.since,
            false => Micros(self.since.0.saturating_add(EACH_US)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// So many at once, then one for each interval, and never more than that.
    #[test]
    fn turns_come_back_with_time() {
        let mut bucket = Bucket::<3, 10>::new();
        let mut taken = |now| bucket.take(Micros(now));
        assert_eq!([(); 4].map(|()| taken(100)), [true, true, true, false]);
        assert_eq!([taken(109), taken(110), taken(110)], [false, true, false]);
        assert_eq!([taken(119), taken(120), taken(120)], [false, true, false]);
        assert_eq!([(); 4].map(|()| taken(1000)), [true, true, true, false]);
        assert!(!taken(1));
        assert!(taken(u64::MAX));
        let mut bucket = Bucket::<1, 10>::new();
        assert!(bucket.take(Micros(7)));
        assert_eq!(bucket.next(), Micros(17));
        assert!(!bucket.take(Micros(16)) && bucket.take(Micros(17)));
        bucket.give_back();
        assert!(bucket.take(Micros(18)) && !bucket.take(Micros(19)));
    }
}
