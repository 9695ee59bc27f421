//! NOR flash in memory, and in a file if it is to outlive the process.
//!
//! As the real thing it can only clear bits by programming and set them by
//! erasing. Memory is shared by clones: that is the power cycle of a test.

use std::fs::{File, OpenOptions};
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use umi_core::journal::{ERASED, Flash, Geometry};

/// NOR flash in memory or in a file.
#[derive(Clone, Debug)]
pub struct VirtualFlash {
    geometry: Geometry,
    cells: Arc<Mutex<Cells>>,
}

#[derive(Debug)]
struct Cells {
    bytes: Vec<u8>,
    file: Option<File>,
    wear: Wear,
}

/// What was done to a flash since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wear {
    /// Calls that programmed.
    pub programs: u64,
    /// Bytes that they programmed.
    pub bytes: u64,
    /// Sectors that were erased.
    pub erases: u64,
}

impl VirtualFlash {
    /// Erased flash in memory.
    #[must_use]
    pub fn in_memory(geometry: Geometry) -> Self {
        Self::new(geometry, vec![ERASED; size(geometry)], None)
    }

    /// Flash that stands in a file; an absent file is erased flash.
    ///
    /// # Errors
    /// The file cannot be read or written, has another size, or is in use.
    pub fn in_file(geometry: Geometry, path: &Path) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        // A board's key and part programs are nobody else's.
        #[cfg(unix)]
        {
            use std::os::unix::fs::OpenOptionsExt as _;
            options.mode(0o600);
        }
        let mut file = options.open(path)?;
        if file.try_lock().is_err() {
            let message = format!("{} is in use by another virtual board", path.display());
            return Err(io::Error::new(io::ErrorKind::ResourceBusy, message));
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        if bytes.is_empty() {
            bytes = vec![ERASED; size(geometry)];
            file.write_all(&bytes)?;
        }
        if bytes.len() != size(geometry) {
            let message = format!(
                "{} has {} bytes, the virtual flash {}: it is not one of ours, or of another version",
                path.display(),
                bytes.len(),
                size(geometry)
            );
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        Ok(Self::new(geometry, bytes, Some(file)))
    }

    fn new(geometry: Geometry, bytes: Vec<u8>, file: Option<File>) -> Self {
        let wear = Wear::default();
        let cells = Arc::new(Mutex::new(Cells { bytes, file, wear }));
        Self { geometry, cells }
    }

    /// What was done to it.
    #[must_use]
    pub fn wear(&self) -> Wear {
        let cells = self.cells.lock();
        cells.unwrap_or_else(PoisonError::into_inner).wear
    }

    /// Changes cells, and the file behind them, and counts it.
    fn change(
        &self,
        at: usize,
        change: impl FnOnce(&mut [u8]),
        length: usize,
        count: impl FnOnce(&mut Wear),
    ) -> io::Result<()> {
        // A panic elsewhere leaves cells as flash would be after a power cut.
        let mut cells = self.cells.lock().unwrap_or_else(PoisonError::into_inner);
        let Cells { bytes, file, wear } = &mut *cells;
        count(wear);
        let range = bytes
            .get_mut(at..at + length)
            .ok_or(io::ErrorKind::InvalidInput)?;
        change(range);
        if let Some(file) = file {
            file.seek(SeekFrom::Start(at as u64))?;
            file.write_all(range)?;
        }
        Ok(())
    }
}

fn size(geometry: Geometry) -> usize {
    geometry.sectors as usize * geometry.sector_size as usize
}

impl Flash for VirtualFlash {
    type Error = io::Error;

    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> io::Result<()> {
        let cells = self.cells.lock().unwrap_or_else(PoisonError::into_inner);
        let at = addr as usize;
        let found = cells
            .bytes
            .get(at..at + into.len())
            .ok_or(io::ErrorKind::InvalidInput)?;
        into.copy_from_slice(found);
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> io::Result<()> {
        let mut erased = true;
        let clear = |cells: &mut [u8]| {
            erased = cells.iter().all(|cell| *cell == ERASED);
            for (cell, byte) in cells.iter_mut().zip(bytes) {
                *cell &= byte;
            }
        };
        self.change(addr as usize, clear, bytes.len(), |wear| {
            wear.programs += 1;
            wear.bytes += bytes.len() as u64;
        })?;
        if erased {
            Ok(())
        } else {
            // Flash with error correction refuses that; so it must not happen.
            Err(io::Error::other("cells programmed that were not erased"))
        }
    }

    fn erase(&mut self, sector: u32) -> io::Result<()> {
        let size = self.geometry.sector_size as usize;
        let fill = |cells: &mut [u8]| cells.fill(ERASED);
        self.change(sector as usize * size, fill, size, |wear| wear.erases += 1)
    }
}
