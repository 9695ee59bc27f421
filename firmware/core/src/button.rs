//! The teaching button: when it has been held for a second.
//!
//! # Design
//!
//! The button is looked at again and again. Openings shorter than [`BOUNCE_US`] are bounces of
//! its contact and do not end a press. A press counts once, when it has lasted for [`HELD_US`]:
//! a knock, or a hand that leans on it for a moment, teaches nothing. What is pressed since the
//! start (a jammed button, a wire to ground) counts only after it was released once. After a
//! pause longer than [`PAUSE_US`] nobody knows what was between two looks: the press begins
//! anew.

use crate::units::Micros;

/// How often the button is to be looked at, microseconds.
pub const LOOK_US: u64 = 10_000;
/// An opening that is shorter does not end a press, microseconds.
pub const BOUNCE_US: u64 = 30_000;
/// A press counts after so long, microseconds.
pub const HELD_US: u64 = 1_000_000;
/// Two looks that are further apart say nothing about the time between them, microseconds.
pub const PAUSE_US: u64 = 200_000;

/// What is known of a button.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HeldButton {
    looked: Option<Micros>,
    down: Option<Micros>,
    up: Option<Micros>,
    /// It was released since the start.
    is_free: bool,
    /// This press has counted.
    has_counted: bool,
}

impl HeldButton {
    /// Never looked at.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            looked: None,
            down: None,
            up: None,
            is_free: false,
            has_counted: false,
        }
    }

    /// It is looked at. True once for each press, when it has lasted for a second.
    pub fn look(&mut self, now: Micros, is_down: bool) -> bool {
        let since = |then: Micros| now.0.saturating_sub(then.0);
        let paused = self.looked.is_some_and(|looked| since(looked) > PAUSE_US);
        self.looked = Some(now);
        if paused {
            (self.down, self.up) = (None, None);
        }
        if !is_down {
            if since(*self.up.get_or_insert(now)) >= BOUNCE_US {
                self.down = None;
                self.is_free = true;
                self.has_counted = false;
            }
            return false;
        }
        self.up = None;
        let down = *self.down.get_or_insert(now);
        if !self.is_free || self.has_counted || since(down) < HELD_US {
            return false;
        }
        self.has_counted = true;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// When a button counts that is down in these spans, milliseconds, looked at every `step`.
    fn counts(down_ms: &[(u64, u64)], step: u64, until: u64) -> Vec<u64> {
        let mut button = HeldButton::new();
        let at = (0..until).step_by(usize::try_from(step).unwrap());
        at.filter(|ms| {
            let is_down = down_ms.iter().any(|(from, to)| (*from..*to).contains(ms));
            button.look(Micros(ms * 1000), is_down)
        })
        .collect()
    }

    /// A second, to the next look; once for each press.
    #[test]
    fn a_press_of_a_second_counts_once() {
        assert_eq!(counts(&[(500, 5000)], 10, 9000), [1500]);
        assert_eq!(counts(&[(500, 1490)], 10, 9000), [0_u64; 0]);
        assert_eq!(counts(&[(500, 2000), (2100, 3200)], 10, 9000), [1500, 3100]);
        // Knocks, however many.
        let knocks: Vec<(u64, u64)> = (1..50).map(|n| (n * 100, n * 100 + 60)).collect();
        assert_eq!(counts(&knocks, 10, 9000), [0_u64; 0]);
    }

    /// A contact that bounces at its beginning, in the middle and at its end is one press, and
    /// counts from its first closure.
    #[test]
    fn bounces_are_of_the_press() {
        let bouncing = [
            (500, 510),
            (520, 530),
            (540, 1200),
            (1220, 1800),
            (1810, 1820),
        ];
        assert_eq!(counts(&bouncing, 10, 9000), [1500]);
        assert_eq!(counts(&bouncing, 1, 9000), [1500]);
    }

    /// Pressed since the start it is no press.
    #[test]
    fn a_jammed_button_teaches_nothing() {
        assert_eq!(counts(&[(0, 60_000)], 10, 60_000), [0_u64; 0]);
        assert_eq!(counts(&[(0, 3000), (3100, 5000)], 10, 9000), [4100]);
    }

    /// Two looks with a pause between them may belong to two presses.
    #[test]
    fn a_pause_begins_anew() {
        let mut button = HeldButton::new();
        let mut look = |ms: u64, is_down: bool| button.look(Micros(ms * 1000), is_down);
        for ms in [0, 50, 100] {
            assert!(!look(ms, false));
        }
        assert!(!look(150, true));
        assert!(!look(2000, true), "nobody knows what was in between");
        let looks: Vec<u64> = (1..=12).map(|n| 2000 + n * 100).collect();
        let counted: Vec<u64> = looks.into_iter().filter(|ms| look(*ms, true)).collect();
        assert_eq!(counted, [3000]);
    }
}
