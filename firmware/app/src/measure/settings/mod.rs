//! What must survive a power cut and the journal's ring: the job in force and
//! the reference that was taught.
//!
//! Both stand in one entry of a small journal of their own, so that they change
//! together or not at all; the newest entry counts. A distance sensor has entries of its own between
//! them; each time a job is kept, so is the sensor before it, and the ring drops neither. The key of its own layout stands
//! before each, so that a layout of another version is never misread.
//!
//! A message that has nothing to do with jobs may change, and a job that was kept before is in force all the same. Up to
//! protocol 2.23 the key of all messages stood there. The entries of that one are read: a sensor has the same layout
//! since, a job had it up to 2.24 ([`before`]). Where a layout here changes, its kind gets another number, and the entries of the one before get a
//! reader of their own (`the_layouts_are_those_that_are_kept`). An entry of before is written anew where something is to be
//! kept, and not sooner: a firmware that is put back after a trial finds what it had kept. A power cut on the way leaves
//! the old one or the new one.
//!
//! A board without a job says why: none was ever kept, another firmware kept it, it is damaged
//! ([`JobLoss`]). The reason is in the journal and in the status until a job is set.
//!
//! What is newest stands there twice. An entry at the end that is damaged looks like one that a power cut tore; were it the
//! only one, the settings before it would count again, and with them a reference that was forgotten.

use heapless::Vec;
use umi_core::job::Teaching;
use umi_core::journal::{Flash, Journal, JournalError};
use umi_core::units::{Micros, Point};
use umi_protocol::job::{Job, Lessons, MAX_DATUMS, before};
use umi_protocol::message::JobLoss;
use umi_protocol::point_sensor::{SensorLoss, SensorOnBoard};
use umi_protocol::schema::key;

/// Datum positions in the order of the job's datum features.
pub type PlacesMm = Vec<[f64; 3], MAX_DATUMS>;

/// What one entry holds: the job and the reference that was taught.
type Kept = (Job, Option<(PlacesMm, Lessons)>);

/// Kind number of a job's entry, and the key of its layout.
const JOB: (u8, u64) = (5, key::<(Job, PlacesMm, Lessons)>());
/// Of a distance sensor's.
const SENSOR: (u8, u64) = (4, key::<Option<SensorOnBoard>>());

/// The key of all messages of protocol 2.23.
const MESSAGES_BEFORE: u64 = 0x0f10_eca6_dbb0_0604;
/// A job's entries up to there and in protocol 2.24, with one sigma for the three axes.
const JOBS_BEFORE: [(u8, u64); 2] = [(1, MESSAGES_BEFORE), (3, 0xa0a9_5713_f1ef_8f9c)];
/// A distance sensor's.
const SENSOR_BEFORE: (u8, u64) = (2, MESSAGES_BEFORE);

/// The settings ring.
pub struct JobStore<F: Flash> {
    journal: Journal<F>,
    /// Something that had been kept could not be read when it was opened.
    has_lost: bool,
}

impl<F: Flash> JobStore<F> {
    /// Opens the ring.
    ///
    /// # Errors
    /// The journal's.
    pub fn open(flash: F) -> Result<Self, JournalError<F::Error>> {
        let (journal, recovery) = Journal::open(flash)?;
        let has_lost = !recovery.is_clean();
        Ok(Self { journal, has_lost })
    }

    /// The newest settings.
    ///
    /// # Errors
    /// Why there is no job: [`JobLoss`]. A power cut while settings were kept leaves the ones
    /// before.
    pub fn load(&mut self, scratch: &mut [u8]) -> Result<Kept, JobLoss> {
        for seq in (self.journal.first_seq()..self.journal.next_seq()).rev() {
            let found = self.journal.read(seq, scratch);
            let found = found.map_err(|error| match error {
                JournalError::Flash(_) => JobLoss::Storage,
                _ => JobLoss::Damaged,
            })?;
            let kind = found.entry.kind;
            if [SENSOR.0, SENSOR_BEFORE.0].contains(&kind) {
                continue;
            }
            // The check value of the entry is right: what does not fit was written by another.
            let payload = found.entry.payload;
            let Ok((layout, rest)) = postcard::take_from_bytes::<u64>(payload) else {
                return Err(JobLoss::OtherSchema);
            };
            let (begin, len) = (payload.len().saturating_sub(rest.len()), rest.len());
            let Some(settings) = scratch.get_mut(begin..) else {
                return Err(JobLoss::Damaged);
            };
            let len = match (kind, layout) {
                JOB => Some(len),
                of if JOBS_BEFORE.contains(&of) => before::widen(settings, len),
                _ => return Err(JobLoss::OtherSchema),
            };
            let settings = len.and_then(|len| settings.get(..len));
            return match settings.map(postcard::take_from_bytes) {
                Some(Ok((settings, []))) => Ok(settings),
                _ => Err(JobLoss::Damaged),
            };
        }
        Err(match self.has_lost {
            true => JobLoss::Damaged,
            false => JobLoss::Absent,
        })
    }

    /// The newest sensor; none: none was set up, or it was taken away.
    ///
    /// # Errors
    /// Why there is none any more.
    pub fn load_sensor(&mut self, scratch: &mut [u8]) -> Result<Option<SensorOnBoard>, SensorLoss> {
        for seq in (self.journal.first_seq()..self.journal.next_seq()).rev() {
            let found = self.journal.read(seq, scratch);
            let entry = found.map_err(|_| SensorLoss::Damaged)?.entry;
            let kind = entry.kind;
            if ![SENSOR.0, SENSOR_BEFORE.0].contains(&kind) {
                continue;
            }
            return match postcard::take_from_bytes::<u64>(entry.payload) {
                Ok((layout, kept)) if [SENSOR, SENSOR_BEFORE].contains(&(kind, layout)) => {
                    match postcard::take_from_bytes(kept) {
                        Ok((sensor, [])) => Ok(sensor),
                        _ => Err(SensorLoss::Damaged),
                    }
                }
                Ok(_) => Err(SensorLoss::OtherSchema),
                Err(_) => Err(SensorLoss::Damaged),
            };
        }
        Ok(None)
    }

    /// Keeps a sensor, or that there is none.
    ///
    /// # Errors
    /// Nothing was kept; what was there before still counts.
    pub fn save_sensor(
        &mut self,
        now: Micros,
        sensor: Option<&SensorOnBoard>,
        scratch: &mut [u8],
    ) -> Result<(), NotKept> {
        let payload = postcard::to_slice(&(SENSOR.1, sensor), scratch).map_err(|_| NotKept)?;
        self.append(SENSOR.0, now, payload)
    }

    /// Keeps these settings. After `Ok` they survive a power cut.
    ///
    /// # Errors
    /// Nothing was kept; what was there before still counts.
    pub fn save(
        &mut self,
        now: Micros,
        job: &Job,
        taught: Option<&(PlacesMm, Lessons)>,
        scratch: &mut [u8],
    ) -> Result<(), NotKept> {
        let payload = postcard::to_slice(&(JOB.1, job, taught), scratch).map_err(|_| NotKept)?;
        self.append(JOB.0, now, payload)
    }

    /// An entry, and the same once more. With the first one it is kept; a flash that fails in the second is told where
    /// something is kept next.
    fn append(&mut self, kind: u8, now: Micros, payload: &[u8]) -> Result<(), NotKept> {
        let first = self.journal.append(kind, now, payload);
        first.map_err(|_| NotKept)?;
        let _ = self.journal.append(kind, now, payload);
        Ok(())
    }
}

/// The settings could not be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotKept;

/// What was taught as it is kept.
pub fn kept(taught: &Teaching<'_>) -> (PlacesMm, Lessons) {
    (positions_mm(taught.places), taught.learned.clone())
}

/// Points as they stand in records.
pub fn positions_mm(points: &[Point]) -> PlacesMm {
    points.iter().map(|p| p.to_array_mm()).collect()
}

/// Positions from a record as points.
pub fn points(positions: &[[f64; 3]]) -> Vec<Point, MAX_DATUMS> {
    positions.iter().map(|p| Point::from_array_mm(*p)).collect()
}

#[cfg(test)]
mod tests;
