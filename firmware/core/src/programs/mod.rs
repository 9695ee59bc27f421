//! Part programs in NOR flash: kept whole or not at all.
//!
//! ```text
//! sector  0        1        2        3        4        5        6        7
//!        ┌────────┬────────┬────────┬────────┬────────┬────────┬────────┬┄┄┄
//!        │ O1 head│ … O1   │ O7 head│  free  │ O3 head│ … O3   │ … O3   │ free
//!        └────────┴────────┴────────┴────────┴────────┴────────┴────────┴┄┄┄
//! ```
//!
//! A program lies in sectors one behind the other, behind a header (`header.rs`) with its
//! number, length and CRC-32. It counts when its mark "complete" has been programmed, which
//! happens when all its bytes have been read back with the right CRC, and until its mark
//! "void" is.
//!
//! # Design
//!
//! * **Replaced as a whole.** A new program of the same number is written beside the old
//!   one, which is read until the new one is complete. Of two that are complete the later
//!   counts, and the other is marked void.
//! * **Resumed.** An upload that broke off goes on at a sector's start if number, length
//!   and check value are the same. Which sector that is can be seen from the flash alone:
//!   before the first byte goes into a sector, the next one is erased.
//! * **Opening reads** the first bytes of every sector; nothing is kept beside the programs.
//! * **Punched** by a control, a program has no length before its end, and goes on coming
//!   while a sector is erased: see `punched.rs`.
//! * **First fit**; nothing is moved to make room. A store without room in one piece
//!   refuses with figures.
//! * **A word is programmed once between erases**, as in the journal; only marks may be
//!   programmed over a word that a power cut left begun, with zeros.
//! * Not synchronised with the journal: what a control got is recorded there.
//!
//! # Limitations
//!
//! [`MAX_PROGRAMS`] programs; one upload at a time, a new one gives up what was not
//! finished. Sectors do not wear evenly: programs are uploaded by people, a flash takes
//! 100 000 erases.

mod header;
mod punched;
#[cfg(test)]
mod tests;

use heapless::Vec;
use umi_protocol::program::{MAX_NUMBER, ProgramInfo, ProgramRefusal, ProgramRoom};

use crate::journal::flash::LARGEST_WRITE;
use crate::journal::format::chain::CRC32;
use crate::journal::write::{Buffer, program_kept};
use crate::journal::{self, ERASED, Flash, GeometryFault};
use crate::rewrite::StartModes;
use header::{Header, Layout, PAGE};
use punched::Sum;

/// Programs that are kept, at most.
pub const MAX_PROGRAMS: usize = 32;

/// Why a call was refused or failed. `E` is the flash driver's error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreError<E> {
    /// The flash driver reported an error.
    Flash(E),
    /// The flash did not keep what was programmed.
    NotKept {
        /// The first address that reads back differently.
        addr: u32,
    },
    /// The region cannot hold programs.
    Geometry(GeometryFault),
    /// It cannot be done.
    Refused(ProgramRefusal),
}

impl<E> From<journal::JournalError<E>> for StoreError<E> {
    /// Of what programming can report.
    fn from(error: journal::JournalError<E>) -> Self {
        match error {
            journal::JournalError::Flash(error) => Self::Flash(error),
            journal::JournalError::NotKept { addr } => Self::NotKept { addr },
            journal::JournalError::Geometry(fault) => Self::Geometry(fault),
            // Programming reports nothing else.
            _ => Self::NotKept { addr: 0 },
        }
    }
}

impl<E> From<ProgramRefusal> for StoreError<E> {
    fn from(refusal: ProgramRefusal) -> Self {
        Self::Refused(refusal)
    }
}

/// A program that is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Program {
    /// Its O-number.
    pub number: u32,
    /// How many bytes it has.
    pub bytes: u32,
    /// Their CRC-32.
    pub crc32: u32,
    /// Where it begins.
    sector: u32,
    /// Later ones are larger: one that replaces this is another.
    generation: u32,
}

impl Program {
    fn new(header: &Header, sector: u32) -> Self {
        Self {
            number: header.program.number,
            bytes: header.program.bytes,
            crc32: header.program.crc32,
            sector,
            generation: header.generation,
        }
    }
}

/// A program that is being written.
#[derive(Clone, Debug)]
struct Upload {
    program: Program,
    /// Bytes taken, those in `page` too.
    taken: u32,
    /// What was taken and not programmed yet.
    page: Vec<u8, { PAGE as usize }>,
    /// Bytes may come: it was begun since the start, and the flash has done all it was told.
    open: bool,
    /// Of what was taken, if the length is not known: then `program` is the room that it has.
    punched: Option<Sum>,
}

impl Upload {
    const fn new(program: Program, taken: u32, open: bool) -> Self {
        let page = Vec::new();
        Self {
            program,
            taken,
            page,
            open,
            punched: None,
        }
    }
}

/// The programs in a flash region.
#[derive(Clone, Debug)]
pub struct Store<F: Flash> {
    flash: F,
    layout: Layout,
    programs: Vec<Program, MAX_PROGRAMS>,
    upload: Option<Upload>,
    /// The generation of the next upload.
    generation: u32,
}

impl<F: Flash> Store<F> {
    /// Finds the programs that are there.
    ///
    /// # Errors
    /// [`StoreError::Flash`], [`StoreError::NotKept`], [`StoreError::Geometry`].
    pub fn open(flash: F) -> Result<Self, StoreError<F::Error>> {
        let layout = Layout::new(flash.geometry()).map_err(StoreError::Geometry)?;
        let mut store = Self {
            flash,
            layout,
            programs: Vec::new(),
            upload: None,
            generation: 1,
        };
        let mut sector = 0;
        while sector < layout.sectors {
            sector += match store.header(sector)? {
                Some(header) if !store.is_void(sector)? => {
                    store.found(Program::new(&header, sector))?;
                    layout.sectors_for(header.program.bytes)
                }
                _ => 1,
            };
        }
        Ok(store)
    }

    /// Takes up a program that was found at opening.
    fn found(&mut self, program: Program) -> Result<(), StoreError<F::Error>> {
        self.generation = self.generation.max(program.generation.saturating_add(1));
        if !self.is_marked(program.sector, self.layout.complete())? {
            // There is one, unless power went before another was void.
            let (kept, void) = match self.upload.take() {
                Some(other) if other.program.generation > program.generation => {
                    (other.program, Some(program))
                }
                other => (program, other.map(|upload| upload.program)),
            };
            self.upload = Some(Upload::new(kept, 0, false));
            return void.map_or(Ok(()), |void| self.void(void.sector));
        }
        let same = self
            .programs
            .iter_mut()
            .find(|p| p.number == program.number);
        let void = match same {
            None => {
                // As many were kept as there is room for.
                let _ = self.programs.push(program);
                return Ok(());
            }
            Some(kept) if kept.generation < program.generation => core::mem::replace(kept, program),
            Some(_) => program,
        };
        // Power went between the marks of the two.
        self.void(void.sector)
    }

    /// The programs, in the order of their place.
    #[must_use]
    pub fn programs(&self) -> &[Program] {
        &self.programs
    }

    /// The program of this number.
    #[must_use]
    pub fn find(&self, number: u32) -> Option<Program> {
        self.programs.iter().find(|p| p.number == number).copied()
    }

    /// Whether this program is still there: neither deleted nor replaced.
    #[must_use]
    pub fn has(&self, program: &Program) -> bool {
        self.programs.contains(program)
    }

    /// What is known of a program, with its name.
    ///
    /// # Errors
    /// [`StoreError::Flash`]; [`ProgramRefusal::NotThere`] if its header cannot be read any more.
    pub fn info(&mut self, program: &Program) -> Result<ProgramInfo, StoreError<F::Error>> {
        let header = self.header(program.sector)?;
        Ok(header.ok_or(ProgramRefusal::NotThere)?.program)
    }

    /// How much room there is.
    #[must_use]
    pub fn room(&self) -> ProgramRoom {
        let layout = &self.layout;
        let used: u32 = self.taken_up(true).map(|(_, sectors)| sectors).sum();
        ProgramRoom {
            programs: self.programs.len() as u16,
            most_programs: MAX_PROGRAMS as u16,
            longest_bytes: layout.capacity(self.longest_run()),
            free_bytes: (layout.sectors - used) * layout.sector_size,
            total_bytes: layout.sectors * layout.sector_size,
        }
    }

    /// Begins an upload, or goes on with the one that broke off; the offset of the byte
    /// that is wanted first. Another upload that was not finished is given up.
    ///
    /// # Errors
    /// [`StoreError::Refused`] with the reason, [`ProgramRefusal::Busy`] while a control punches;
    /// [`StoreError::Flash`], [`StoreError::NotKept`].
    pub fn begin(&mut self, program: &ProgramInfo) -> Result<u32, StoreError<F::Error>> {
        if !(1..=MAX_NUMBER).contains(&program.number) {
            return Err(ProgramRefusal::BadNumber.into());
        }
        if program.bytes == 0 {
            return Err(ProgramRefusal::Empty.into());
        }
        if StartModes::unpacked(program.stated.start_packed).is_none() {
            return Err(ProgramRefusal::BadStart.into());
        }
        if self.is_punched() {
            return Err(ProgramRefusal::Busy.into());
        }
        if let Some(upload) = self.upload.take() {
            let begun = upload.program;
            let same = self.info(&begun).is_ok_and(|info| info == *program);
            if same {
                return self.resume(begun);
            }
            self.void(begun.sector)?;
        }
        if self.programs.is_full() && self.find(program.number).is_none() {
            let most = MAX_PROGRAMS as u16;
            return Err(ProgramRefusal::TooMany { most }.into());
        }
        let sector = self.place(program.bytes)?;
        self.write_header(program, sector)
    }

    /// Writes the header of an upload; what was in its sector is gone.
    fn write_header(
        &mut self,
        program: &ProgramInfo,
        sector: u32,
    ) -> Result<u32, StoreError<F::Error>> {
        self.erase(sector)?;
        // The place of a resumption is found by this: see `begun`.
        if self.layout.sectors_for(program.bytes) > 1 {
            self.erase(sector + 1)?;
        }
        let program = self.program_header(program, sector)?;
        self.upload = Some(Upload::new(program, 0, true));
        Ok(0)
    }

    /// Programs a header into a sector whose beginning is erased.
    fn program_header(
        &mut self,
        program: &ProgramInfo,
        sector: u32,
    ) -> Result<Program, StoreError<F::Error>> {
        let layout = self.layout;
        let header = Header {
            program: program.clone(),
            generation: self.generation,
        };
        let mut words = Buffer([ERASED; LARGEST_WRITE]);
        let len = (layout.complete() - layout.header()) as usize;
        let encoded = header.encode(&layout, sector);
        for (word, byte) in words.0.iter_mut().zip(encoded) {
            *word = byte;
        }
        let at = layout.start(sector) + layout.header();
        program_kept(&mut self.flash, at, words.0.get(..len).unwrap_or(&words.0))?;
        self.generation = self.generation.saturating_add(1);
        Ok(Program::new(&header, sector))
    }

    /// Goes on with an upload at the start of the sector that was written last.
    fn resume(&mut self, program: Program) -> Result<u32, StoreError<F::Error>> {
        let last = self.begun(&program)?;
        if last == 0 {
            let info = self.info(&program)?;
            return self.write_header(&info, program.sector);
        }
        self.erase(program.sector + last)?;
        let taken = self.layout.capacity(last);
        self.upload = Some(Upload::new(program, taken, true));
        Ok(taken)
    }

    /// The last sector of an upload into which bytes went, counted from its first: the one
    /// before the first that is erased.
    fn begun(&mut self, program: &Program) -> Result<u32, StoreError<F::Error>> {
        let sectors = self.layout.sectors_for(program.bytes);
        for sector in 1..sectors {
            let mut first = [0; 64];
            let at = self.layout.start(program.sector + sector);
            self.flash.read(at, &mut first).map_err(StoreError::Flash)?;
            if first.iter().all(|byte| *byte == ERASED) {
                return Ok(sector - 1);
            }
        }
        Ok(sectors.saturating_sub(1))
    }

    /// Takes the bytes at this offset; the offset of the byte that is wanted next. Bytes
    /// that stand elsewhere are not taken, nor are those behind the end.
    ///
    /// # Errors
    /// [`ProgramRefusal::NotBegun`]; [`StoreError::Flash`], [`StoreError::NotKept`]: then the upload
    /// is to be begun again, and goes on at a sector's start.
    pub fn piece(&mut self, offset: u32, bytes: &[u8]) -> Result<u32, StoreError<F::Error>> {
        self.writing(|store, upload| {
            if offset == upload.taken {
                let left = (upload.program.bytes - upload.taken) as usize;
                let bytes = bytes.get(..left.min(bytes.len())).unwrap_or_default();
                store.take(upload, bytes)?;
            }
            Ok(upload.taken)
        })
    }

    /// Works on the upload that is open. If the flash fails, it is not any more: what the
    /// flash holds is known again when it is begun again.
    fn writing<T>(
        &mut self,
        work: impl FnOnce(&mut Self, &mut Upload) -> Result<T, StoreError<F::Error>>,
    ) -> Result<T, StoreError<F::Error>> {
        let open = self
            .upload
            .take_if(|upload| upload.open && upload.punched.is_none());
        let mut upload = open.ok_or(ProgramRefusal::NotBegun)?;
        let done = work(self, &mut upload);
        upload.open = done.is_ok();
        self.upload = Some(upload);
        done
    }

    fn take(&mut self, upload: &mut Upload, mut bytes: &[u8]) -> Result<(), StoreError<F::Error>> {
        while !bytes.is_empty() {
            let free = upload.page.capacity() - upload.page.len();
            let (now, later) = bytes.split_at(free.min(bytes.len()));
            // There is room: just looked.
            let _ = upload.page.extend_from_slice(now);
            upload.taken += now.len() as u32;
            bytes = later;
            if upload.page.is_full() {
                self.flush(upload)?;
            }
        }
        Ok(())
    }

    /// Programs what was taken. The first byte of a page is aligned to it.
    fn flush(&mut self, upload: &mut Upload) -> Result<(), StoreError<F::Error>> {
        let Upload {
            program,
            taken,
            page,
            open: _,
            punched,
        } = upload;
        if page.is_empty() {
            return Ok(());
        }
        let layout = self.layout;
        let from = *taken - page.len() as u32;
        let at = layout.start(program.sector) + layout.data() + from;
        let sector = at / layout.sector_size;
        let end = program.sector + layout.sectors_for(program.bytes);
        // Not before the first page of the first sector: the header came with it.
        if at.is_multiple_of(layout.sector_size) {
            // The next one, by which a resumption is found: see `begun`. What is punched
            // cannot be resumed.
            let erased = sector + u32::from(punched.is_none());
            if erased < end {
                self.erase(erased)?;
            }
        }
        let mut words = Buffer([ERASED; LARGEST_WRITE]);
        for (word, byte) in words.0.iter_mut().zip(page.iter()) {
            *word = *byte;
        }
        let len = page.len().next_multiple_of(layout.align as usize);
        program_kept(&mut self.flash, at, words.0.get(..len).unwrap_or(&words.0))?;
        page.clear();
        Ok(())
    }

    /// Ends an upload: its bytes are read back, and if their check value is right, it counts
    /// from now on. None: it did so before, and this is asked again.
    ///
    /// # Errors
    /// [`ProgramRefusal::NotBegun`], [`ProgramRefusal::Incomplete`];
    /// [`ProgramRefusal::Damaged`]: nothing of it is left; [`StoreError::Flash`],
    /// [`StoreError::NotKept`].
    pub fn end(
        &mut self,
        number: u32,
        crc32: u32,
    ) -> Result<Option<Program>, StoreError<F::Error>> {
        let known = self.find(number).filter(|known| known.crc32 == crc32);
        let open = self.upload.as_ref().filter(|upload| {
            let Program {
                number: of,
                crc32: value,
                ..
            } = upload.program;
            upload.open && upload.punched.is_none() && (of, value) == (number, crc32)
        });
        let Some(upload) = open else {
            let again = known.map(|_| None);
            return Ok(again.ok_or(ProgramRefusal::NotBegun)?);
        };
        let program = upload.program;
        if upload.taken != program.bytes {
            let offset = upload.taken;
            return Err(ProgramRefusal::Incomplete { offset }.into());
        }
        self.writing(|store, upload| store.flush(upload))?;
        let found = self.check_value(&program)?;
        if found != program.crc32 {
            self.upload = None;
            self.void(program.sector)?;
            return Err(ProgramRefusal::Damaged { crc32: found }.into());
        }
        self.mark(program.sector, self.layout.complete())?;
        self.upload = None;
        let mut old = None;
        match self.programs.iter_mut().find(|p| p.number == number) {
            Some(place) => old = Some(core::mem::replace(place, program)),
            // There was room when it was begun.
            None => drop(self.programs.push(program)),
        }
        if let Some(old) = old {
            self.void(old.sector)?;
        }
        Ok(Some(program))
    }

    /// The CRC-32 of a program's bytes as they are in the flash.
    ///
    /// # Errors
    /// [`StoreError::Flash`].
    pub fn check_value(&mut self, program: &Program) -> Result<u32, StoreError<F::Error>> {
        let mut digest = CRC32.digest();
        let mut offset = 0;
        let mut buffer = [0; 128];
        while offset < program.bytes {
            let read = self.read_at(program, offset, &mut buffer)?;
            digest.update(read);
            offset += read.len() as u32;
        }
        Ok(digest.finalize())
    }

    /// Reads bytes of a program into `buffer`; fewer at its end, none behind it.
    ///
    /// # Errors
    /// [`ProgramRefusal::NotThere`] if it was deleted or replaced; [`StoreError::Flash`].
    pub fn read<'b>(
        &mut self,
        program: &Program,
        offset: u32,
        buffer: &'b mut [u8],
    ) -> Result<&'b [u8], StoreError<F::Error>> {
        if !self.has(program) {
            return Err(ProgramRefusal::NotThere.into());
        }
        self.read_at(program, offset, buffer)
    }

    fn read_at<'b>(
        &mut self,
        program: &Program,
        offset: u32,
        buffer: &'b mut [u8],
    ) -> Result<&'b [u8], StoreError<F::Error>> {
        let left = program.bytes.saturating_sub(offset) as usize;
        let len = left.min(buffer.len());
        let (into, _) = buffer.split_at_mut(len);
        if len > 0 {
            let at = self.layout.start(program.sector) + self.layout.data() + offset;
            self.flash.read(at, into).map_err(StoreError::Flash)?;
        }
        Ok(into)
    }

    /// Deletes a program.
    ///
    /// # Errors
    /// [`ProgramRefusal::NotThere`]; [`StoreError::Flash`], [`StoreError::NotKept`]: it is still there.
    pub fn delete(&mut self, number: u32) -> Result<(), StoreError<F::Error>> {
        let place = self.programs.iter().position(|p| p.number == number);
        let place = place.ok_or(ProgramRefusal::NotThere)?;
        let program = self.find(number).ok_or(ProgramRefusal::NotThere)?;
        self.void(program.sector)?;
        self.programs.remove(place);
        Ok(())
    }

    /// The first sector of a place for so many bytes.
    fn place(&self, bytes: u32) -> Result<u32, ProgramRefusal> {
        let wanted = self.layout.sectors_for(bytes);
        self.free_runs()
            .find(|(_, sectors)| *sectors >= wanted)
            .map(|(sector, _)| sector)
            .ok_or_else(|| {
                let room = self.room();
                ProgramRefusal::Full {
                    needed_bytes: bytes,
                    longest_bytes: room.longest_bytes,
                    free_bytes: room.free_bytes,
                }
            })
    }

    /// First sectors and lengths of what is used; of an upload, too, if that is asked for.
    fn taken_up(&self, with_upload: bool) -> impl Iterator<Item = (u32, u32)> {
        let upload = self.upload.as_ref().filter(|_| with_upload);
        let programs = self.programs.iter();
        programs
            .chain(upload.map(|upload| &upload.program))
            .map(|program| (program.sector, self.layout.sectors_for(program.bytes)))
    }

    /// First sectors and lengths of what is free, in their order. An upload that is under
    /// way leaves its room to the next.
    fn free_runs(&self) -> impl Iterator<Item = (u32, u32)> {
        let mut at = 0;
        core::iter::from_fn(move || {
            while at < self.layout.sectors {
                let from = at;
                let inside =
                    |(sector, sectors): &(u32, u32)| (*sector..sector + sectors).contains(&from);
                if let Some((sector, sectors)) = self.taken_up(false).find(inside) {
                    at = sector + sectors;
                    continue;
                }
                let next = self.taken_up(false).map(|(sector, _)| sector);
                at = next
                    .filter(|sector| *sector > from)
                    .min()
                    .unwrap_or(self.layout.sectors);
                return Some((from, at - from));
            }
            None
        })
    }

    fn longest_run(&self) -> u32 {
        let runs = self.free_runs().map(|(_, sectors)| sectors);
        runs.max().unwrap_or(0)
    }

    fn header(&mut self, sector: u32) -> Result<Option<Header>, StoreError<F::Error>> {
        let mut bytes = [0; header::SIZE];
        let at = self.layout.start(sector) + self.layout.header();
        self.flash.read(at, &mut bytes).map_err(StoreError::Flash)?;
        Ok(Header::decode(&bytes, &self.layout, sector))
    }

    fn is_void(&mut self, sector: u32) -> Result<bool, StoreError<F::Error>> {
        let [before, behind] = self.layout.void();
        Ok(self.is_marked(sector, before)? || self.is_marked(sector, behind)?)
    }

    /// Marks a program as none any more.
    fn void(&mut self, sector: u32) -> Result<(), StoreError<F::Error>> {
        for offset in self.layout.void() {
            if !self.is_marked(sector, offset)? {
                self.mark(sector, offset)?;
            }
        }
        Ok(())
    }

    /// Whether a mark is set: anything but erased.
    fn is_marked(&mut self, sector: u32, offset: u32) -> Result<bool, StoreError<F::Error>> {
        let mut word = [0; LARGEST_WRITE];
        let (word, _) = word.split_at_mut(self.layout.align as usize);
        let at = self.layout.start(sector) + offset;
        self.flash.read(at, word).map_err(StoreError::Flash)?;
        Ok(word.iter().any(|byte| *byte != ERASED))
    }

    /// Sets a mark.
    fn mark(&mut self, sector: u32, offset: u32) -> Result<(), StoreError<F::Error>> {
        let zeros = Buffer([0; LARGEST_WRITE]);
        let (word, _) = zeros.0.split_at(self.layout.align as usize);
        let at = self.layout.start(sector) + offset;
        Ok(program_kept(&mut self.flash, at, word)?)
    }

    fn erase(&mut self, sector: u32) -> Result<(), StoreError<F::Error>> {
        self.flash.erase(sector).map_err(StoreError::Flash)
    }

    /// Gives the flash back.
    #[must_use]
    pub fn into_flash(self) -> F {
        self.flash
    }
}
