//! Programs whose length is known when they end: those that a control punches.
//!
//! # Design
//!
//! * **The header comes last.** The bytes go into the longest run of free sectors, behind
//!   the place of the header, which stays erased until all of them have been read back.
//!   Without a header there is no program: power may go at any time, and what was there is
//!   there.
//! * **Nothing is replaced.** The operator at the control has not seen what the board keeps.
//!   A program that is there already is there; one of its number with other bytes stays, and
//!   the new one is refused: the control still has it.
//! * **One erase at a time.** A control without flow control goes on meanwhile. One sector
//!   is erased at the beginning, and one whenever the first byte for it is programmed: of
//!   pieces no longer than a sector, at most one costs an erase before the next can come.
//! * **Room for the host's.** Whoever reaches the line can punch. So punched programs that nobody
//!   has released have half of the numbers at most, and an eighth of the flash is not for them.
//! * **Whatever goes wrong ends it**, and its room is free: what is punched cannot be resumed,
//!   only punched again.

use core::fmt;

use crc::Digest;
use umi_protocol::job::Name;
use umi_protocol::program::{MAX_NUMBER, ProgramInfo, ProgramRefusal, Release, Stated};

use super::header::DEFAULT_HOLD_S;
use super::{MAX_PROGRAMS, Program, Store, StoreError, Upload};
use crate::journal::Flash;
use crate::journal::format::chain::CRC32;

/// The CRC-32 so far.
#[derive(Clone)]
pub(super) struct Sum(Digest<'static, u32>);

impl fmt::Debug for Sum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:08X}", self.0.clone().finalize())
    }
}

impl<F: Flash> Store<F> {
    /// Begins a program that a control punches; the most bytes it may have. An upload that
    /// was not finished is given up. Erases one sector.
    ///
    /// # Errors
    /// [`ProgramRefusal::Full`], [`ProgramRefusal::TooMany`], [`ProgramRefusal::PunchedFull`];
    /// [`StoreError::Flash`], [`StoreError::NotKept`].
    pub fn begin_open(&mut self) -> Result<u32, StoreError<F::Error>> {
        if self.programs.is_full() {
            let most = MAX_PROGRAMS as u16;
            return Err(ProgramRefusal::TooMany { most }.into());
        }
        let (sector, bytes) = self.longest_place()?;
        let bytes = bytes.min(self.punched_room()?);
        if let Some(given_up) = self.upload.take_if(|upload| upload.punched.is_none()) {
            self.void(given_up.program.sector)?;
        }
        self.upload = None;
        self.erase(sector)?;
        let room = Program {
            number: 0,
            bytes,
            crc32: 0,
            sector,
            generation: 0,
        };
        self.upload = Some(Upload {
            punched: Some(Sum(CRC32.digest())),
            ..Upload::new(room, 0, true)
        });
        Ok(bytes)
    }

    /// Whether a control punches: it was begun, and neither ended nor given up.
    #[must_use]
    pub fn is_punched(&self) -> bool {
        self.upload
            .as_ref()
            .is_some_and(|upload| upload.punched.is_some())
    }

    /// Takes the next bytes that the control punches; how many it took in all. Erases one
    /// sector at most if they are no more than one holds.
    ///
    /// # Errors
    /// [`ProgramRefusal::NotBegun`]; [`ProgramRefusal::Full`], [`StoreError::Flash`],
    /// [`StoreError::NotKept`]: then it is over, and nothing is left of it.
    pub fn append(&mut self, bytes: &[u8]) -> Result<u32, StoreError<F::Error>> {
        let (mut upload, mut sum) = self.punched()?;
        let room = upload.program.bytes - upload.taken;
        if bytes.len() > room as usize {
            return Err(self.full(upload.taken.saturating_add(bytes.len() as u32)));
        }
        sum.0.update(bytes);
        upload.punched = Some(sum);
        self.take(&mut upload, bytes)?;
        let taken = upload.taken;
        self.upload = Some(upload);
        Ok(taken)
    }

    /// Ends what a control punches: its bytes are read back, and it counts from now on.
    /// None: a program of this number and with these bytes was there already. Erases one
    /// sector at most.
    ///
    /// # Errors
    /// [`ProgramRefusal::NotBegun`]; [`ProgramRefusal::BadNumber`], [`ProgramRefusal::Empty`],
    /// [`ProgramRefusal::OtherThere`], [`ProgramRefusal::Damaged`], [`StoreError::Flash`],
    /// [`StoreError::NotKept`]: then it is over, and nothing is left of it.
    pub fn end_open(
        &mut self,
        number: u32,
        name: Name,
    ) -> Result<Option<Program>, StoreError<F::Error>> {
        let (mut upload, sum) = self.punched()?;
        if !(1..=MAX_NUMBER).contains(&number) {
            return Err(ProgramRefusal::BadNumber.into());
        }
        if upload.taken == 0 {
            return Err(ProgramRefusal::Empty.into());
        }
        let crc32 = sum.0.finalize();
        let bytes = upload.taken;
        if let Some(there) = self.find(number) {
            let same = (there.bytes, there.crc32) == (bytes, crc32);
            let crc32 = there.crc32;
            let other = ProgramRefusal::OtherThere { crc32 };
            return if same { Ok(None) } else { Err(other.into()) };
        }
        self.flush(&mut upload)?;
        let sector = upload.program.sector;
        let found = self.check_value(&Program {
            bytes,
            ..upload.program
        })?;
        if found != crc32 {
            return Err(ProgramRefusal::Damaged { crc32: found }.into());
        }
        let info = ProgramInfo {
            number,
            name,
            bytes,
            crc32,
            // Nobody has looked at it yet.
            release: Release::Never,
            hold_s: DEFAULT_HOLD_S,
            stated: Stated::default(),
        };
        let program = self.program_header(&info, sector)?;
        if let Err(failed) = self.mark(sector, self.layout.complete()) {
            // It may read as marked after a restart.
            self.void(sector)?;
            return Err(failed);
        }
        // There was room when it was begun, and nothing else was written since.
        let _ = self.programs.push(program);
        Ok(Some(program))
    }

    /// Gives up what a control punches: nothing is left of it.
    pub fn give_up_open(&mut self) {
        self.upload.take_if(|upload| upload.punched.is_some());
    }

    /// What is punched, with its sum: who does not put it back has given it up.
    fn punched(&mut self) -> Result<(Upload, Sum), ProgramRefusal> {
        let upload = self.upload.take_if(|upload| upload.punched.is_some());
        let sum = upload.as_ref().and_then(|upload| upload.punched.clone());
        upload.zip(sum).ok_or(ProgramRefusal::NotBegun)
    }

    /// The longest run of free sectors: the first one, and the bytes that all of them take.
    fn longest_place(&self) -> Result<(u32, u32), StoreError<F::Error>> {
        let longest = self.free_runs().max_by_key(|(_, sectors)| *sectors);
        let (sector, sectors) = longest.ok_or_else(|| self.full(1))?;
        Ok((sector, self.layout.capacity(sectors)))
    }

    /// The most bytes that one more punched program may have.
    fn punched_room(&mut self) -> Result<u32, StoreError<F::Error>> {
        let (mut count, mut sectors) = (0, 0);
        for place in 0..self.programs.len() {
            let Some(program) = self.programs.get(place).copied() else {
                break;
            };
            // One that cannot be read is the host's or a punched one: it counts.
            let info = self.info(&program);
            if info.is_ok_and(|info| info.release != Release::Never) {
                continue;
            }
            count += 1;
            sectors += self.layout.sectors_for(program.bytes);
        }
        let all = self.layout.sectors;
        let left = (all - all / 8).saturating_sub(sectors);
        if count >= MAX_PROGRAMS / 2 || left == 0 {
            return Err(ProgramRefusal::PunchedFull.into());
        }
        Ok(self.layout.capacity(left))
    }

    fn full(&self, needed_bytes: u32) -> StoreError<F::Error> {
        let room = self.room();
        let full = ProgramRefusal::Full {
            needed_bytes,
            longest_bytes: room.longest_bytes,
            free_bytes: room.free_bytes,
        };
        full.into()
    }
}
