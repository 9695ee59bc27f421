//! When a board shows itself at its USB plug: while the host's 5 V are there, and anew where the host
//! is there and nothing moves.
//!
//! # Design
//!
//! A board in a cabinet has its supply from 24 V, so it is on when the host is not. It must not feed
//! the line of a port that is off (USB 2.0, 7.1.5.1).
//!
//! A disturbance can leave the host's port disabled, or its enumeration half done. Only a plug that is
//! pulled and put in again helps then, and nobody is at the cabinet to do it. So the board lets go and
//! comes back where for two seconds
//!
//! - the host sends frames and has not configured the board, or
//! - a program had the port open and no frames come any more.
//!
//! A host that sleeps without an open port is left alone, and so is a program that does not read: it
//! may be stopped in a debugger. Where coming back does not help, the next try waits twice as long.

/// What a board sees and does of its plug, beside the controller's driver.
pub trait Plug {
    /// Whether the host's 5 V are there.
    fn has_power(&mut self) -> bool;

    /// The number of the frame that the host has sent last.
    fn frame(&mut self) -> u16;

    /// Shows the board to the host, or not.
    fn show(&mut self, shown: bool);
}

/// How often the plug is looked at, milliseconds.
pub const LOOK_MS: u32 = 20;
/// For so long nothing moves, until the board lets go.
const PATIENCE_MS: u32 = 2_000;
const LONGEST_PATIENCE_MS: u32 = 64_000;
/// A host has noticed by then that the board is gone.
const AWAY_MS: u32 = 200;

/// What there is at one look.
#[derive(Clone, Copy, Debug)]
pub struct PlugSeen {
    /// The host's 5 V are there.
    pub has_power: bool,
    /// The number of the host's latest frame.
    pub frame: u16,
    /// The host has configured the board, and the bus is awake.
    pub is_configured: bool,
    /// A program has opened the port, and has not closed it.
    pub is_open: bool,
}

/// Whether the board is to be seen by the host.
#[derive(Clone, Copy, Debug)]
pub struct Attachment {
    is_shown: bool,
    frame: u16,
    still_ms: u32,
    patience_ms: u32,
    away_ms: u32,
}

impl Attachment {
    /// The driver has shown the board.
    pub const fn new() -> Self {
        Self {
            is_shown: true,
            frame: 0,
            still_ms: 0,
            patience_ms: PATIENCE_MS,
            away_ms: 0,
        }
    }

    /// Whether the board is shown.
    pub const fn is_shown(&self) -> bool {
        self.is_shown
    }

    /// To be called each [`LOOK_MS`]. Returns whether the board is shown from now on.
    pub fn look(&mut self, seen: PlugSeen) -> bool {
        let frames_come = seen.frame != self.frame;
        self.frame = seen.frame;
        if !seen.has_power {
            *self = Self {
                is_shown: false,
                frame: seen.frame,
                ..Self::new()
            };
            return false;
        }
        self.away_ms = self.away_ms.saturating_sub(LOOK_MS);
        if self.away_ms > 0 {
            return false;
        }
        let was_shown = self.is_shown;
        self.is_shown = true;
        let is_stuck = if frames_come {
            !seen.is_configured
        } else {
            seen.is_open
        };
        if !was_shown || !is_stuck {
            self.still_ms = 0;
            if frames_come && seen.is_configured {
                self.patience_ms = PATIENCE_MS;
            }
            return true;
        }
        self.still_ms = self.still_ms.saturating_add(LOOK_MS);
        if self.still_ms >= self.patience_ms {
            self.still_ms = 0;
            self.patience_ms = (2 * self.patience_ms).min(LONGEST_PATIENCE_MS);
            self.away_ms = AWAY_MS;
            self.is_shown = false;
        }
        self.is_shown
    }
}

impl Default for Attachment {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    const WELL: PlugSeen = PlugSeen {
        has_power: true,
        frame: 0,
        is_configured: true,
        is_open: true,
    };

    /// A host over time: when the board is gone and comes back, milliseconds from the start.
    fn changes(of: impl Fn(u32) -> PlugSeen, ms: u32) -> Vec<(u32, bool)> {
        let mut attachment = Attachment::new();
        let mut shown = true;
        let mut changes = Vec::new();
        for now in (0..ms).step_by(LOOK_MS as usize) {
            let is = attachment.look(of(now));
            assert_eq!(is, attachment.is_shown());
            if is != shown {
                changes.push((now, is));
                shown = is;
            }
        }
        changes
    }

    /// Eleven bits, one frame each millisecond.
    fn frame(ms: u32) -> u16 {
        (ms % 2048) as u16
    }

    #[test]
    fn stays_while_a_host_is_well_asleep_or_no_host_at_all() {
        let moving = |ms| PlugSeen {
            frame: frame(ms),
            ..WELL
        };
        assert_eq!(changes(moving, 600_000), []);
        // The program is gone or there was none, then the host sleeps.
        let asleep = |ms: u32| PlugSeen {
            frame: frame(ms.min(1_000)),
            is_open: false,
            is_configured: ms < 1_000,
            ..WELL
        };
        assert_eq!(changes(asleep, 600_000), []);
        // A charger.
        let charger = |_| PlugSeen {
            is_open: false,
            is_configured: false,
            ..WELL
        };
        assert_eq!(changes(charger, 600_000), []);
    }

    #[test]
    fn follows_the_power_at_once() {
        let plugged = |ms: u32| PlugSeen {
            has_power: !(1_000..5_000).contains(&ms),
            frame: frame(ms.min(1_000).max(ms.saturating_sub(4_000))),
            ..WELL
        };
        assert_eq!(changes(plugged, 60_000), [(1_000, false), (5_000, true)]);
    }

    #[test]
    fn comes_back_where_a_host_does_not_configure_it_each_time_later() {
        let half_done = |ms| PlugSeen {
            frame: frame(ms),
            is_configured: false,
            is_open: false,
            ..WELL
        };
        let all = changes(half_done, 300_000);
        let gone: Vec<u32> = all.iter().filter(|c| !c.1).map(|c| c.0).collect();
        assert!((1_980..=2_020).contains(&gone[0]), "{gone:?}");
        let waits: Vec<u32> = gone.windows(2).map(|two| two[1] - two[0]).collect();
        let promised = [4_000, 8_000, 16_000, 32_000, 64_000, 64_000, 64_000];
        for (wait, promised) in waits.iter().zip(promised) {
            assert!(
                wait.abs_diff(promised + AWAY_MS) <= 2 * LOOK_MS,
                "{waits:?}"
            );
        }
        for two in all.chunks_exact(2) {
            assert_eq!(two[1].0 - two[0].0, AWAY_MS);
        }
    }

    /// A frame that comes with a number that was there before is no silence: the next look sees
    /// another one.
    #[test]
    fn comes_back_where_frames_end_under_a_program_and_only_once() {
        let disabled = |ms: u32| PlugSeen {
            frame: frame(ms.min(1_000)),
            is_configured: ms < 1_003,
            // Letting go takes the program along.
            is_open: ms < 3_020,
            ..WELL
        };
        let all = changes(disabled, 300_000);
        assert_eq!(all.len(), 2, "{all:?}");
        assert!((2_980..=3_040).contains(&all[0].0), "{all:?}");
    }

    /// What helped counts: patience begins anew.
    #[test]
    fn patience_is_short_again_behind_a_host_that_was_well() {
        let twice = |ms: u32| PlugSeen {
            frame: frame(ms),
            is_configured: (2_300..60_000).contains(&ms) || ms >= 62_300,
            ..WELL
        };
        let all = changes(twice, 100_000);
        let gone: Vec<u32> = all.iter().filter(|c| !c.1).map(|c| c.0).collect();
        assert_eq!(gone.len(), 2, "{gone:?}");
        assert!(gone[1].abs_diff(62_000) <= 2 * LOOK_MS, "{gone:?}");
    }
}
