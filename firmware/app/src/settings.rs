//! What must survive a power cut and the journal's ring: the job in force and
//! the reference that was taught.
//!
//! Both stand in one entry of a small journal of their own, so that they change
//! together or not at all; the newest entry counts. The schema key stands before
//! them, so that a layout of another version is never misread.

use heapless::Vec;
use umi_core::journal::{Error, Flash, Journal};
use umi_core::units::{Micros, Point};
use umi_protocol::hello::KEY;
use umi_protocol::job::{Job, MAX_DATUMS};
use umi_protocol::message::MAX_RECORD;

/// Datum positions in the order of the job's datum features.
pub type Positions = Vec<[f64; 3], MAX_DATUMS>;

/// Kind number of the only entry there is. A later layout gets another.
const KIND: u8 = 1;

/// The settings ring.
pub struct Settings<F: Flash> {
    journal: Journal<F>,
}

impl<F: Flash> Settings<F> {
    /// Opens the ring.
    ///
    /// # Errors
    /// The journal's.
    pub fn open(flash: F) -> Result<Self, Error<F::Error>> {
        let (journal, _) = Journal::open(flash)?;
        Ok(Self { journal })
    }

    /// The newest settings; none if there are none, or none that this firmware
    /// can read: then there is no job until one is set.
    pub fn load(&mut self, scratch: &mut [u8; MAX_RECORD]) -> Option<(Job, Option<Positions>)> {
        let newest = self.journal.next_seq().checked_sub(1)?;
        let found = self.journal.read(newest, scratch).ok()?;
        if found.entry.kind != KIND {
            return None;
        }
        match postcard::take_from_bytes(found.entry.payload) {
            Ok(((KEY, job, taught), [])) => Some((job, taught)),
            _ => None,
        }
    }

    /// Keeps these settings. After `Ok` they survive a power cut.
    ///
    /// # Errors
    /// Nothing was kept; what was there before still counts.
    pub fn save(
        &mut self,
        now: Micros,
        job: &Job,
        taught: Option<&Positions>,
        scratch: &mut [u8; MAX_RECORD],
    ) -> Result<(), NotKept> {
        let payload = postcard::to_slice(&(KEY, job, taught), scratch).map_err(|_| NotKept)?;
        self.journal
            .append(KIND, now, payload)
            .map_err(|_| NotKept)?;
        Ok(())
    }
}

/// The settings could not be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotKept;

/// Points as they stand in records.
pub fn positions_mm(points: &[Point]) -> Positions {
    points.iter().map(|p| p.to_array_mm()).collect()
}

/// Positions from a record as points.
pub fn points(positions: &[[f64; 3]]) -> Vec<Point, MAX_DATUMS> {
    positions.iter().map(|p| Point::from_array_mm(*p)).collect()
}
