//! What a board keeps for its owner: what a job may ask for, what of the journal is kept elsewhere,
//! and the greatest run that was judged.
//!
//! All of it stands in one entry of a small journal of its own, so that it changes together or not
//! at all; the newest entry counts.
//!
//! An entry of a layout before this one is read, and what it does not say is as on a new board.
//! It is written anew where something is to be kept, and not by a start alone. A firmware that is put back after a trial
//! finds what it had kept, where nothing was to be kept meanwhile. Else it finds a layout that it does not know: then the
//! strictest configuration counts, told, until the owner sets another. A power cut on the way leaves the old entry or the new one.
//! A single field that cannot be used is as strict as it can be, and the others are as they were.
//!
//! Each entry is written twice, so that damage at rest in one of them costs nothing. Where the configuration changes, the second
//! stands in another sector. If none can be read where something was, or the ring itself cannot be
//! opened, the board takes the strictest configuration and says so, until its owner has set another.
//! A new board keeps an entry at its first start. So an area that reads as if it had never been written is that
//! of a new board, or was erased: then the evidence tells of a configuration, and the strictest counts.
//!
//! An entry says how often keys and configuration were changed ([`Age`]), in which life of the board, and whether it has an
//! owner; the keys' area says the same. So a copy of one of the two that is older than the other, or from before a wipe, is
//! known, and the board does not become open where the area of the keys is erased ([`crate::access`] compares). An entry with
//! a life and no owner stands only where the power was cut while the first owner's key was enrolled.
//!
//! # Limitations
//!
//! Of two memories of different lives nobody knows which one is right: the board is locked, and its owner out, too.
//! Where what is kept here is gone, nobody knows of which life the keys are: they count, and the strictest configuration.
//! A firmware that knew no lives has kept all as of life 0, until its keys change once.
//! Who puts older copies of both memories back at once has the board that they are of.
//! A run is judged more often than a sector should be erased: the number of the last one stands twice in one sector.
//! Where that is damaged at rest, an older one counts.
//! A damaged ring that was just begun anew is that of a new board to its evidence only, where power is cut before the
//! owner has got the answer.

use serde::{Deserialize, Serialize};
use umi_core::journal::{Flash, Journal, JournalError, JournalFault, NotOpened};
use umi_core::trust::access::register::Age;
use umi_core::units::Micros;
use umi_protocol::config::{
    AccessConfig, BoardConfig, Ceilings, ConfigField, Fallbacks, JournalConfig,
};
use umi_protocol::job_error::JobError;

/// Kind number of the entries: [`Entry`]. A later layout gets another.
const KIND: u8 = 4;

/// Of the layout before, without [`Marks`], of a board that has an owner.
const KIND_OWNED: u8 = 3;

/// The same of a board without.
const KIND_UNOWNED: u8 = 2;

/// Of the layout before that: [`KeptBefore`].
const KIND_BEFORE: u8 = 1;

/// Bytes of an entry, at most: twelve numbers of ten bytes, and some.
const MOST: usize = 160;

/// What is known of the board beside what is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Marks {
    /// How often keys and configuration were changed.
    pub age: Age,
    /// It has an owner.
    pub is_owned: bool,
    /// The configuration is the strictest, for want of another.
    is_fallback: bool,
    /// Evidence before this number tells of no owner.
    pub looked_to: u64,
}

/// An entry.
#[derive(Serialize, Deserialize)]
struct Entry {
    kept: Kept,
    marks: Marks,
}

/// What is kept.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Kept {
    pub config: BoardConfig,
    /// The entries before this one are kept elsewhere.
    pub acked: u64,
    /// The greatest run that was judged, with whatever job: the control counts on.
    pub last_run: Option<u32>,
}

/// What was kept before there was `[access]` (protocol 2.23).
#[derive(Deserialize)]
struct KeptBefore {
    ceilings: Ceilings,
    journal: JournalConfig,
    acked: u64,
    last_run: Option<u32>,
}

impl From<KeptBefore> for Kept {
    fn from(before: KeptBefore) -> Self {
        Self {
            config: BoardConfig {
                ceilings: before.ceilings,
                journal: before.journal,
                access: AccessConfig::NEW,
            },
            acked: before.acked,
            last_run: before.last_run,
        }
    }
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
    /// Its flash does not answer: nothing is known of what it holds.
    Unreachable,
}

impl<F: Flash> Ring<F> {
    /// To write into: one that is damaged is begun anew, for nothing in it can be read.
    fn open(&mut self) -> Result<&mut Journal<F>, NotInCustody> {
        *self = match core::mem::replace(self, Self::Unreachable) {
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
            Self::Damaged(_) | Self::Unreachable => Err(NotInCustody),
        }
    }
}

/// The ring, and its newest entry.
pub(crate) struct Custody<F: Flash> {
    ring: Ring<F>,
    kept: Kept,
    marks: Marks,
    /// The newest entry is of a layout before this one.
    is_before: bool,
    /// The start has found an entry that says how often keys and configuration were changed.
    has_ages: bool,
}

impl<F: Flash> Custody<F> {
    /// Opens the ring.
    pub fn open(flash: F) -> Self {
        let (ring, found, was_there) = match Journal::open_or_return(flash) {
            Ok((mut ring, recovery)) => {
                let newest = ring.next_seq().checked_sub(1);
                // A board that is new has lost nothing; nor has one whose first entry was cut.
                let was_there = newest.is_some() || recovery.damaged_headers > 0;
                match newest.map(|newest| read(&mut ring, newest)) {
                    Some(Err(JournalError::Flash(_))) => (Ring::Unreachable, None, true),
                    found => (Ring::Open(ring), found.and_then(Result::ok), was_there),
                }
            }
            Err(NotOpened {
                error: JournalError::Flash(_),
                ..
            }) => (Ring::Unreachable, None, true),
            Err(damaged) => (Ring::Damaged(damaged.flash), None, true),
        };
        let is_before = found.as_ref().is_some_and(|found| found.is_before);
        let has_ages = found.as_ref().is_some_and(|found| !found.is_before);
        let Found { kept, marks, .. } = found.unwrap_or(Found {
            kept: Kept {
                config: match was_there {
                    true => BoardConfig::strictest(),
                    false => BoardConfig::NEW,
                },
                ..NOTHING_KEPT
            },
            marks: Marks {
                is_fallback: was_there,
                ..Marks::default()
            },
            is_before,
        });
        Self {
            ring,
            kept,
            marks,
            is_before,
            has_ages,
        }
    }

    /// Whether nothing was ever kept here, as far as can be seen.
    pub fn is_new(&self) -> bool {
        matches!(&self.ring, Ring::Open(ring) if ring.next_seq() == 0) && !self.marks.is_fallback
    }

    /// Whether a wipe of keys of this age goes on here: they are of the same life, or none is known here. So it is where the
    /// power was cut while this was erased: what is left may be of before the life.
    pub fn ends_with(&self, keys: Age) -> bool {
        let is_same = |known: Age| known.life() == 0 || known.life() == keys.life();
        self.is_reachable() && self.known().is_none_or(is_same)
    }

    /// Erases what is kept, at the end of a wipe.
    pub fn erase(&mut self) {
        let mut flash = match core::mem::replace(&mut self.ring, Ring::Unreachable) {
            Ring::Open(ring) => ring.into_flash(),
            Ring::Damaged(flash) => flash,
            Ring::Unreachable => return,
        };
        erase(&mut flash);
        *self = Self::open(flash);
    }

    /// Begins with nothing kept, or as strictly as can be where something was kept and is gone.
    pub fn begin(&mut self, now: Micros, is_lost: bool) {
        if is_lost {
            // The next start finds it so, too.
            let _ = self.distrust(now, self.marks);
        } else {
            // What is not kept is looked for again at the next start.
            let _ = self.keep(now, self.kept, self.marks);
        }
    }

    /// Whether its flash answers.
    pub fn is_reachable(&self) -> bool {
        !matches!(self.ring, Ring::Unreachable)
    }

    /// What is known of the board.
    pub fn marks(&self) -> Marks {
        self.marks
    }

    /// Of which age the keys are, if an entry that the start has found says so.
    pub fn known(&self) -> Option<Age> {
        let Marks { age, is_owned, .. } = self.marks;
        // An owner of whom only a firmware knew that does not count; and what is the strictest for want of another, nothing yet.
        let is_counted = age.keys > 0 || !is_owned && !self.marks.is_fallback;
        (self.has_ages && is_counted).then_some(age)
    }

    /// Whether keys of this age can be of the life that is known here, as late as this or one change later; not whether they
    /// are older.
    pub fn takes_keys(&self, keys: Age) -> bool {
        let Marks { is_owned, .. } = self.marks;
        self.known().is_none_or(|known| {
            let next = known.changes().saturating_add(1);
            if keys.life() == known.life() {
                // Who has no owner and no life under way takes nobody's.
                keys.changes() <= next && (is_owned || known.life() > 0)
            } else {
                // What a firmware that knew no lives has kept gets one with a change.
                is_owned && known.life() == 0 && keys.changes() == next
            }
        })
    }

    /// Notes what is known of the board. What a firmware before has kept is not written anew for that, if it `may_wait`: then
    /// it is kept with what comes next. So is how far the evidence was looked at, but for an entry now and then.
    ///
    /// # Errors
    /// It is not kept.
    pub fn note(&mut self, now: Micros, marks: Marks, may_wait: bool) -> Result<(), NotInCustody> {
        let looked_to = self.marks.looked_to;
        let is_same = Marks { looked_to, ..marks } == self.marks
            && marks.looked_to < looked_to.saturating_add(LOOKED_AT);
        if (is_same && !self.is_before) || (may_wait && self.is_before) {
            self.marks = marks;
            return Ok(());
        }
        self.keep_marks(now, marks)
    }

    /// Keeps what is known of the board.
    ///
    /// # Errors
    /// It is not kept.
    pub fn keep_marks(&mut self, now: Micros, marks: Marks) -> Result<(), NotInCustody> {
        self.keep(now, self.kept, marks)
    }

    /// What is kept here is older than what is known elsewhere: the strictest configuration counts from now on.
    ///
    /// # Errors
    /// It counts, and is not kept.
    pub fn distrust(&mut self, now: Micros, marks: Marks) -> Result<(), NotInCustody> {
        let kept = Kept {
            config: BoardConfig::strictest(),
            ..self.kept
        };
        let is_fallback = true;
        let marks = Marks {
            is_fallback,
            ..marks
        };
        let is_kept = self.keep(now, kept, marks);
        (self.kept, self.marks) = (kept, marks);
        is_kept
    }

    /// What is kept.
    pub fn kept(&self) -> &Kept {
        &self.kept
    }

    /// Fields that could not be read, or not be used as they were.
    pub fn fallbacks(&self) -> Fallbacks {
        match self.marks.is_fallback {
            true => ConfigField::ALL.iter().copied().collect(),
            // What is as strict as it can be is no more to be used than what it stands for.
            false => {
                let mut copy = self.kept.config;
                copy.strict_where_bad()
            }
        }
    }

    /// Keeps this. After `Ok` it survives a power cut. The strictest configuration stays until the owner has set another.
    ///
    /// # Errors
    /// It is not kept; what was before still counts.
    pub fn save(&mut self, now: Micros, kept: Kept) -> Result<(), NotInCustody> {
        let mut marks = self.marks;
        if kept.config != self.kept.config {
            marks.age.config = marks.age.config.saturating_add(1);
            marks.is_fallback = false;
        }
        self.keep(now, kept, marks)
    }

    fn keep(&mut self, now: Micros, kept: Kept, marks: Marks) -> Result<(), NotInCustody> {
        let mut room = [0; MOST];
        let entry = Entry { kept, marks };
        let payload = postcard::to_slice(&entry, &mut room).map_err(|_| NotInCustody)?;
        let ring = self.ring.open()?;
        ring.append(KIND, now, payload).map_err(|_| NotInCustody)?;
        let rights = |kept: &Kept, of: &Marks| (kept.config, of.age, of.is_owned);
        if rights(&kept, &marks) != rights(&self.kept, &self.marks) {
            ring.turn();
        }
        // Damage at rest in one of the two costs no ceiling, and no run. Without the second it is kept none the less.
        let _ = ring.append(KIND, now, payload);
        (self.kept, self.marks, self.is_before) = (kept, marks, false);
        Ok(())
    }
}

/// Erases an area.
pub(crate) fn erase(area: &mut impl Flash) {
    for sector in 0..area.geometry().sectors {
        // A sector that cannot be erased shows when the area is opened.
        let _ = area.erase(sector.into());
    }
}

/// Pieces of evidence that a start may look at again.
const LOOKED_AT: u64 = 256;

/// An entry that was read.
struct Found {
    kept: Kept,
    marks: Marks,
    is_before: bool,
}

/// An entry, if it is one that this firmware knows; what of its configuration cannot be used is as strict as it can be.
fn read<F: Flash>(ring: &mut Journal<F>, seq: u64) -> Result<Found, JournalError<F::Error>> {
    let mut room = [0; MOST];
    let found = ring.read(seq, &mut room)?.entry;
    let marks = Marks {
        is_owned: found.kind == KIND_OWNED,
        ..Marks::default()
    };
    let entry = match found.kind {
        KIND => whole::<Entry>(found.payload),
        KIND_UNOWNED | KIND_OWNED => whole(found.payload).map(|kept| Entry { kept, marks }),
        KIND_BEFORE => whole::<KeptBefore>(found.payload).map(|before| Entry {
            kept: before.into(),
            marks,
        }),
        _ => None,
    };
    let unknown = JournalError::Record(JournalFault::Damaged { seq });
    let Entry { mut kept, marks } = entry.ok_or(unknown)?;
    kept.config.strict_where_bad();
    Ok(Found {
        kept,
        marks,
        is_before: found.kind != KIND,
    })
}

/// What was kept, to the last byte: more of them would be of another layout.
fn whole<'a, T: Deserialize<'a>>(payload: &'a [u8]) -> Option<T> {
    match postcard::take_from_bytes(payload) {
        Ok((kept, [])) => Some(kept),
        _ => None,
    }
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

    /// What was kept before there was `[access]` is read, to the last byte, and is as on a new board
    /// in what it does not say; it is written anew by what is kept next.
    #[test]
    fn the_layout_before_is_read() {
        let payload = |kept: &Kept| {
            let BoardConfig {
                ceilings, journal, ..
            } = kept.config;
            let mut room = [0; MOST];
            let before = (ceilings, journal, kept.acked, kept.last_run);
            postcard::to_slice(&before, &mut room).unwrap().to_vec()
        };
        let whole = payload(&configured());
        for (bytes, is_read) in [
            (&whole[..], true),
            (&whole[..whole.len() - 1], false),
            (&[&whole[..], &[0]].concat(), false),
        ] {
            let flash = RamFlash::new();
            let (mut ring, _) = Journal::open(flash.clone()).unwrap();
            ring.append(KIND_BEFORE, Micros(0), bytes).unwrap();
            let mut opened = Custody::open(flash.clone());
            if !is_read {
                assert_eq!(opened.kept().config, BoardConfig::strictest());
                continue;
            }
            assert_eq!(opened.kept(), &configured());
            assert_eq!(opened.fallbacks().len(), 0);
            let mut next = configured();
            next.config.access.button_off = true;
            opened.save(Micros(1), next).unwrap();
            assert_eq!(Custody::open(flash).kept(), &next);
        }
    }

    /// One field that cannot be used is as strict as it can be and told, also behind a restart and
    /// what is judged meanwhile; the others are as they were. The owner's next ends it.
    #[test]
    fn a_bad_field_alone_is_strict() {
        use ConfigField::{RmsMm, SessionIdleS, TiltDeg};
        type Spoil = fn(&mut BoardConfig);
        let cases: [(Spoil, &[ConfigField]); 5] = [
            (|of| of.ceilings.rms_mm = Some(-0.5), &[RmsMm]),
            (|of| of.ceilings.tilt_deg = Some(f64::NAN), &[TiltDeg]),
            (|of| of.access.session_idle_s = Some(9), &[SessionIdleS]),
            (
                |of| of.access.session_idle_s = Some(u32::MAX),
                &[SessionIdleS],
            ),
            (
                |of| {
                    of.ceilings.rms_mm = Some(f64::INFINITY);
                    of.ceilings.tilt_deg = Some(0.0);
                },
                &[RmsMm, TiltDeg],
            ),
        ];
        for (spoil, told) in cases {
            let flash = RamFlash::new();
            let mut bad = configured();
            bad.config.ceilings.shift_mm = Some(3.0);
            spoil(&mut bad.config);
            let (mut ring, _) = Journal::open(flash.clone()).unwrap();
            let mut room = [0; MOST];
            let payload = postcard::to_slice(&bad, &mut room).unwrap();
            ring.append(KIND_UNOWNED, Micros(0), payload).unwrap();
            for run in 0..3 {
                let mut opened = Custody::open(flash.clone());
                assert_eq!(opened.fallbacks()[..], *told);
                let found = *opened.kept();
                let ceilings = found.config.ceilings;
                assert_eq!(ceilings.shift_mm, Some(3.0), "as it was");
                for (field, value, as_it_was) in [
                    (RmsMm, ceilings.rms_mm, Some(0.01)),
                    (TiltDeg, ceilings.tilt_deg, None),
                ] {
                    let is_bad = told.contains(&field);
                    assert_eq!(value, if is_bad { Some(0.0) } else { as_it_was });
                }
                let idle = found.config.access.session_idle_us();
                let is_bad = told.contains(&SessionIdleS);
                assert_eq!(idle, if is_bad { 10_000_000 } else { u64::MAX });
                let last_run = Some(run);
                opened.save(Micros(1), Kept { last_run, ..found }).unwrap();
                assert_eq!(Custody::open(flash.clone()).kept().last_run, last_run);
            }
            let mut opened = Custody::open(flash.clone());
            opened.save(Micros(1), configured()).unwrap();
            assert_eq!(Custody::open(flash).fallbacks().len(), 0);
        }
    }

    /// A bit that has changed anywhere costs nothing, nor does a sector: the configuration stands in two of them.
    #[test]
    fn damage_costs_no_ceiling() {
        let flash = RamFlash::new();
        let mut opened = Custody::open(flash.clone());
        opened.save(Micros(1), NOTHING_KEPT).unwrap();
        opened.save(Micros(2), configured()).unwrap();
        let whole = flash.bytes();
        let used = whole.iter().rposition(|byte| *byte != 0xFF).unwrap();
        assert!(used > 4096, "{used}");
        let is_as_it_was = |damaged: &[u8]| {
            let opened = Custody::open(RamFlash::of(damaged));
            opened.kept() == &configured() && opened.fallbacks().is_empty()
        };
        for bit in 0..8 * (used + 1) {
            let mut damaged = whole.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(is_as_it_was(&damaged), "bit {bit}");
        }
        for sector in 0..2 {
            for fill in [0x00, 0xFF] {
                let mut damaged = whole.clone();
                damaged[sector * 4096..][..4096].fill(fill);
                assert!(is_as_it_was(&damaged), "sector {sector}, {fill:02x}");
            }
        }
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
        let age = Age {
            keys: u64::MAX,
            config: u32::MAX,
        };
        let longest_marks = Marks {
            age,
            is_owned: true,
            is_fallback: true,
            looked_to: u64::MAX,
        };
        let kept = custody.keep(Micros(u64::MAX), longest, longest_marks);
        assert_eq!(kept, Ok(()));
    }
}
