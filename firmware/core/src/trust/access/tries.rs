//! How wrong keys are slowed: after each wrong one the next is not looked at for a second, then for
//! two, four and so on up to a minute.
//!
//! A right proof is never slowed: that is for the caller, who asks [`Tries::wrong`] only about a
//! wrong one. How often it was wrong is kept over restarts, and the time is counted anew from there.

use serde::{Deserialize, Serialize};

use crate::units::Micros;

/// Wrong keys in a row that still make a difference: 1, 2, 4, 8, 16, 32, 60 s.
const MOST: u8 = 7;

/// Longest wait in seconds.
const LONGEST_S: u64 = 60;

/// How often a key was wrong in a row, as it is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct WrongKeys(u8);

impl WrongKeys {
    /// Whether any was.
    #[must_use]
    pub const fn is_none(self) -> bool {
        self.0 == 0
    }

    fn wait_us(self) -> u64 {
        let seconds = match self.0 {
            0 => 0,
            n => (1 << u32::from(n.min(MOST) - 1)).min(LONGEST_S),
        };
        seconds * 1_000_000
    }
}

/// Wrong keys since the board started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tries {
    wrong: WrongKeys,
    /// The next wrong one is looked at from here on.
    until: Micros,
}

impl Tries {
    /// The board starts; so often a key was wrong before.
    #[must_use]
    pub fn new(wrong: WrongKeys, now: Micros) -> Self {
        let until = Micros(now.0.saturating_add(wrong.wait_us()));
        Self { wrong, until }
    }

    /// What is to be kept.
    #[must_use]
    pub const fn kept(&self) -> WrongKeys {
        self.wrong
    }

    /// Whole seconds until the next wrong key is looked at.
    #[must_use]
    pub fn retry_in_s(&self, now: Micros) -> u32 {
        let left = self.until.0.saturating_sub(now.0).div_ceil(1_000_000);
        u32::try_from(left).unwrap_or(u32::MAX)
    }

    /// A key was wrong; or so many seconds must pass before it is looked at whether it is.
    ///
    /// # Errors
    /// The seconds.
    pub fn wrong(&mut self, now: Micros) -> Result<(), u32> {
        match self.retry_in_s(now) {
            0 => {
                self.wrong = WrongKeys((self.wrong.0 + 1).min(MOST));
                self.until = Micros(now.0.saturating_add(self.wrong.wait_us()));
                Ok(())
            }
            left => Err(left),
        }
    }

    /// A key was right.
    pub fn right(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One second after the first, a minute from the seventh on, also over a restart; what comes
    /// meanwhile does not lengthen the wait; a right one ends it.
    #[test]
    fn wrong_keys_are_slowed_up_to_a_minute() {
        let mut tries = Tries::new(WrongKeys::default(), Micros(0));
        let mut now = 5_000_000;
        for expected in [1, 2, 4, 8, 16, 32, 60, 60] {
            assert_eq!(tries.wrong(Micros(now)), Ok(()));
            assert_eq!(tries.wrong(Micros(now)), Err(expected));
            assert_eq!(tries.retry_in_s(Micros(now + 1)), expected);
            now += u64::from(expected) * 1_000_000;
            assert_eq!(tries.retry_in_s(Micros(now - 1)), 1);
        }
        let mut again = Tries::new(tries.kept(), Micros(0));
        assert_eq!(again.wrong(Micros(0)), Err(60));
        again.right();
        assert!(again.kept().is_none());
        assert_eq!(again.wrong(Micros(1)), Ok(()));
    }
}
