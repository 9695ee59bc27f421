//! The skip line: a reading that crosses its target, a signal that is gone.

/// Captures without a signal, one after the other, that count as its loss.
const GONE: u32 = 3;

/// When the skip line rises.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Trip {
    /// At this reading or a shorter one.
    AtMost(f64),
    /// At this reading or a longer one.
    AtLeast(f64),
}

/// What is watched for.
#[derive(Debug, Default)]
pub(super) struct Watch {
    is_on: bool,
    trip: Option<Trip>,
    had_signal: bool,
    without: u32,
    tripped: bool,
}

impl Watch {
    /// A signal that was there and is gone: no signal where one was is a stop.
    pub fn guard() -> Self {
        Self {
            is_on: true,
            ..Self::default()
        }
    }

    /// The reading crosses its target; no signal at all is a stop, too.
    pub fn trip(trip: Trip) -> Self {
        Self {
            is_on: true,
            trip: Some(trip),
            ..Self::default()
        }
    }

    pub fn is_on(&self) -> bool {
        self.is_on
    }

    pub fn has_tripped(&self) -> bool {
        self.tripped
    }

    /// There are no readings any more.
    pub fn gone(&mut self) {
        self.tripped = true;
    }

    /// The next reading, mm; none without signal.
    pub fn look(&mut self, gamma: Option<f64>) {
        let Some(gamma) = gamma else {
            self.without = self.without.saturating_add(1);
            // Without a signal from the start there is nothing to be brought to its target.
            let is_gone = if self.had_signal {
                self.without >= GONE
            } else {
                self.trip.is_some()
            };
            self.tripped |= is_gone;
            return;
        };
        self.had_signal = true;
        self.without = 0;
        self.tripped |= match self.trip {
            Some(Trip::AtMost(target)) => gamma <= target,
            Some(Trip::AtLeast(target)) => gamma >= target,
            None => false,
        };
    }
}
