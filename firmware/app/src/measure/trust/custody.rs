//! What a board keeps for its owner: what a job may ask for, what of the journal is kept elsewhere,
//! and the greatest run that was judged.
//!
//! All of it stands in one entry of a small journal of its own, so that it changes together or not
//! at all; the newest entry counts.
//!
//! # Limitations
//!
//! Each entry is written twice, so that damage at rest in one of them costs nothing. If none can be read where something was, or the ring itself cannot be
//! opened, the board takes the strictest configuration and says so, until its owner has set another.
//! A sector that reads as if it had never been begun is that of a new board; so is one in which a
//! damaged ring was just begun anew, where power is cut before the owner has got the answer.

use serde::{Deserialize, Serialize};
use umi_core::journal::{Flash, Journal};
use umi_core::units::Micros;
use umi_protocol::config::{BoardConfig, ConfigField, Fallbacks};
use umi_protocol::job_error::JobError;

/// Kind number of the only entry there is. A later layout gets another.
const KIND: u8 = 1;

/// Bytes of an entry, at most: eight numbers of nine bytes, and some.
const MOST: usize = 128;

/// What is kept.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Kept {
    pub config: BoardConfig,
    /// The entries before this one are kept elsewhere.
    pub acked: u64,
    /// The greatest run that was judged with the job in force.
    pub last_run: Option<u32>,
}

/// On a new board, and on one without the ring.
pub(crate) static NOTHING_KEPT: Kept = Kept {
    config: BoardConfig::NEW,
    acked: 0,
    last_run: None,
};

/// The ring, or what cannot be opened as one.
enum Ring<F: Flash> {
    Open(Journal<F>),
    Damaged(F),
    /// While it is begun anew.
    None,
}

impl<F: Flash> Ring<F> {
    /// To write into: one that is damaged is begun anew, for nothing in it can be read.
    fn open(&mut self) -> Result<&mut Journal<F>, NotInCustody> {
        *self = match core::mem::replace(self, Self::None) {
            Self::Damaged(mut flash) => match Journal::format(&mut flash) {
                Ok(()) => match Journal::open_or_return(flash) {
                    Ok((ring, _)) => Self::Open(ring),
                    Err(damaged) => Self::Damaged(damaged.flash),
                },
                Err(_) => Self::Damaged(flash),
            },
            as_it_is => as_it_is,
        };
        match self {
            Self::Open(ring) => Ok(ring),
            Self::Damaged(_) | Self::None => Err(NotInCustody),
        }
    }
}

/// The ring, and its newest entry.
pub(crate) struct Custody<F: Flash> {
    ring: Ring<F>,
    kept: Kept,
    is_fallback: bool,
}

impl<F: Flash> Custody<F> {
    /// Opens the ring.
    pub fn open(flash: F) -> Self {
        let (ring, found, was_there) = match Journal::open_or_return(flash) {
            Ok((mut ring, recovery)) => {
                let newest = ring.next_seq().checked_sub(1);
                // A board that is new has lost nothing; nor has one whose first entry was cut.
                let was_there = newest.is_some() || recovery.damaged_headers > 0;
                let found = newest.and_then(|newest| read(&mut ring, newest));
                (Ring::Open(ring), found, was_there)
            }
            Err(damaged) => (Ring::Damaged(damaged.flash), None, true),
        };
        let is_fallback = found.is_none() && was_there;
        let mut kept = found.unwrap_or(NOTHING_KEPT);
        if is_fallback {
            kept.config = BoardConfig::strictest();
        }
        Self {
            ring,
            kept,
            is_fallback,
        }
    }

    /// What is kept.
    pub fn kept(&self) -> &Kept {
        &self.kept
    }

    /// Fields that could not be read.
    pub fn fallbacks(&self) -> Fallbacks {
        match self.is_fallback {
            true => ConfigField::ALL.iter().copied().collect(),
            false => Fallbacks::new(),
        }
    }

    /// Keeps this. After `Ok` it survives a power cut.
    ///
    /// # Errors
    /// It is not kept; what was before still counts.
    pub fn save(&mut self, now: Micros, kept: Kept) -> Result<(), NotInCustody> {
        // The strictest configuration stays until the owner has set another.
        if self.is_fallback && kept.config == self.kept.config {
            self.kept = kept;
            return Ok(());
        }
        let mut room = [0; MOST];
        let payload = postcard::to_slice(&kept, &mut room).map_err(|_| NotInCustody)?;
        let ring = self.ring.open()?;
        ring.append(KIND, now, payload).map_err(|_| NotInCustody)?;
        // Damage at rest in one of the two costs no ceiling, and no run. Without the second it is kept none the less.
        let _ = ring.append(KIND, now, payload);
        self.kept = kept;
        self.is_fallback = false;
        Ok(())
    }
}

/// An entry, if it is one that this firmware knows.
fn read<F: Flash>(ring: &mut Journal<F>, seq: u64) -> Option<Kept> {
    let mut room = [0; MOST];
    let found = ring.read(seq, &mut room).ok()?;
    let found = (found.entry.kind == KIND).then_some(found.entry.payload)?;
    let kept = postcard::from_bytes::<Kept>(found).ok()?;
    kept.config.check().is_ok().then_some(kept)
}

/// It could not be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NotInCustody;

/// Why nothing was acknowledged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AckError {
    /// There is no such entry yet.
    NoEntry,
    /// The board has no ring for it.
    NotOnThisBoard,
    /// It could not be kept.
    Storage,
}

/// Why the configuration stays as it is.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum ConfigError {
    /// A field cannot be used.
    Field(ConfigField),
    /// The job in force asks for more.
    Job(JobError),
    /// The board has no ring for it.
    NotOnThisBoard,
    /// It could not be kept.
    Storage,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_board::RamFlash;

    fn configured() -> Kept {
        let mut kept = NOTHING_KEPT;
        kept.config.ceilings.rms_mm = Some(0.01);
        (kept.acked, kept.last_run) = (7, Some(99_999));
        kept
    }

    /// What was kept is there after a restart, over more changes than the ring holds at once; a
    /// new board has no ceilings.
    #[test]
    fn what_was_kept_is_there_after_a_restart() {
        let flash = RamFlash::new();
        let opened = Custody::open(flash.clone());
        assert_eq!(
            (opened.kept(), opened.fallbacks().len()),
            (&NOTHING_KEPT, 0)
        );
        let mut kept = configured();
        for acked in 0..500 {
            kept.acked = acked;
            let mut opened = Custody::open(flash.clone());
            opened.save(Micros(1), kept).unwrap();
            let opened = Custody::open(flash.clone());
            assert_eq!(opened.kept(), &kept);
        }
    }

    /// What cannot be read is as strict as it can be, says so, and stays so until the owner sets
    /// it; a run that is judged meanwhile does not change that.
    #[test]
    fn what_cannot_be_read_is_strict() {
        let flash = RamFlash::new();
        let (mut ring, _) = Journal::open(flash.clone()).unwrap();
        ring.append(9, Micros(0), b"of another firmware").unwrap();
        let mut opened = Custody::open(flash.clone());
        assert_eq!(opened.kept().config, BoardConfig::strictest());
        assert_eq!(opened.fallbacks().len(), ConfigField::ALL.len());
        let run = Kept {
            last_run: Some(3),
            ..*opened.kept()
        };
        opened.save(Micros(1), run).unwrap();
        let mut opened = Custody::open(flash.clone());
        assert_eq!(opened.kept().config, BoardConfig::strictest());
        opened.save(Micros(1), configured()).unwrap();
        assert_eq!(opened.fallbacks().len(), 0);
        assert_eq!(Custody::open(flash).kept(), &configured());
    }

    /// A bit that has changed anywhere costs no ceiling: the configuration is as it was, or the strictest.
    #[test]
    fn damage_costs_no_ceiling() {
        let flash = RamFlash::new();
        let mut opened = Custody::open(flash.clone());
        opened.save(Micros(1), NOTHING_KEPT).unwrap();
        opened.save(Micros(2), configured()).unwrap();
        let whole = flash.bytes();
        let used = whole.iter().rposition(|byte| *byte != 0xFF).unwrap();
        let (mut as_it_was, mut strict) = (0, 0);
        for bit in 0..8 * (used + 1) {
            let mut damaged = whole.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            let flash = RamFlash::of(&damaged);
            let mut opened = Custody::open(flash.clone());
            let strictest = BoardConfig::strictest();
            let told = opened.fallbacks().len() == ConfigField::ALL.len();
            match opened.kept().config {
                config if config == configured().config => as_it_was += 1,
                config => {
                    assert!(config == strictest && told, "bit {bit}: {config:?}");
                    strict += 1;
                    // A run that is judged leaves it so; what the owner sets is kept.
                    let run = Kept {
                        last_run: Some(3),
                        ..*opened.kept()
                    };
                    opened.save(Micros(3), run).unwrap();
                    let mut opened = Custody::open(flash.clone());
                    assert_eq!(opened.kept().config, strictest, "bit {bit}");
                    opened.save(Micros(4), configured()).unwrap();
                    let opened = Custody::open(flash);
                    assert_eq!(opened.kept(), &configured(), "bit {bit}");
                }
            }
        }
        // Its header is there once.
        assert!(as_it_was > 4 * used && strict > 0, "{as_it_was} {strict}");
    }

    /// Every entry fits.
    #[test]
    fn the_longest_entry_fits() {
        let longest = Kept {
            config: BoardConfig::strictest(),
            acked: u64::MAX,
            last_run: Some(u32::MAX),
        };
        let mut custody = Custody::open(RamFlash::new());
        custody.save(Micros(u64::MAX), longest).unwrap();
    }
}
