//! Parts of one chip, each a region of its own for the journal.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorType, SpiDevice};
use umi_core::journal::{Flash, Geometry};

use super::FlashFault;
use super::chip::{LARGEST, PAGE, SectorSize, SpiNor};

/// The chip, or why there is none.
type Known<Spi, Delay> = Result<SpiNor<Spi, Delay>, FlashFault<<Spi as ErrorType>::Error>>;

/// A chip that several areas use in turn, or why there is none.
#[derive(Debug)]
pub struct Shared<Spi: SpiDevice, Delay> {
    chip: Mutex<CriticalSectionRawMutex, Known<Spi, Delay>>,
    capacity_bytes: u32,
}

/// What is wanted of a chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wanted {
    /// How many sectors.
    pub sectors: u16,
    /// Their size.
    pub size: SectorSize,
}

impl Wanted {
    const fn bytes(self) -> u64 {
        self.sectors as u64 * self.size.bytes() as u64
    }
}

/// A part of a chip.
#[derive(Debug)]
pub struct Area<'a, Spi: SpiDevice, Delay> {
    shared: &'a Shared<Spi, Delay>,
    start: u32,
    wanted: Wanted,
}

impl<Spi: SpiDevice, Delay: DelayNs> Shared<Spi, Delay> {
    /// This chip, for areas.
    pub const fn new(chip: SpiNor<Spi, Delay>) -> Self {
        Self {
            capacity_bytes: chip.capacity_bytes(),
            chip: Mutex::new(Ok(chip)),
        }
    }

    /// No chip: whatever is asked of its areas has this answer. So a board whose
    /// storage is broken can still say so.
    pub const fn missing(fault: FlashFault<Spi::Error>) -> Self {
        Self {
            capacity_bytes: LARGEST,
            chip: Mutex::new(Err(fault)),
        }
    }

    /// How many bytes the chip has.
    pub const fn capacity_bytes(&self) -> u32 {
        self.capacity_bytes
    }

    /// Areas one behind the other, from the start of the chip, each on a boundary
    /// of its sectors. The chip is borrowed for as long as they exist, so there
    /// are no others.
    ///
    /// # Errors
    /// [`FlashFault::TooSmall`].
    pub fn areas<const N: usize>(
        &mut self,
        wanted: [Wanted; N],
    ) -> Result<[Area<'_, Spi, Delay>; N], FlashFault<Spi::Error>> {
        let begin = |end: u64, wanted: Wanted| end.next_multiple_of(wanted.size.bytes().into());
        let needed = wanted
            .iter()
            .fold(0, |end, wanted| begin(end, *wanted) + wanted.bytes());
        if needed > self.capacity_bytes.into() {
            return Err(FlashFault::TooSmall {
                needed_bytes: u32::try_from(needed).unwrap_or(u32::MAX),
                capacity_bytes: self.capacity_bytes,
            });
        }
        let shared = &*self;
        let mut end = 0;
        Ok(wanted.map(|wanted| {
            let start = begin(end, wanted);
            end = start + wanted.bytes();
            Area {
                shared,
                // Within the capacity, which is a `u32`.
                start: start as u32,
                wanted,
            }
        }))
    }
}

impl<Spi: SpiDevice<Error: Clone>, Delay: DelayNs> Area<'_, Spi, Delay> {
    /// The address on the chip of so many bytes, if they are in this area.
    fn place(&self, addr: u32, len: usize) -> Result<u32, FlashFault<Spi::Error>> {
        let end = u64::from(addr) + len as u64;
        if end > self.wanted.bytes() {
            return Err(FlashFault::OutOfArea);
        }
        self.start.checked_add(addr).ok_or(FlashFault::OutOfArea)
    }

    fn with<R>(
        &self,
        work: impl FnOnce(&mut SpiNor<Spi, Delay>) -> Result<R, FlashFault<Spi::Error>>,
    ) -> Result<R, FlashFault<Spi::Error>> {
        let mut chip = self.shared.chip.try_lock().map_err(|_| FlashFault::InUse)?;
        work(chip.as_mut().map_err(|fault| fault.clone())?)
    }
}

impl<Spi: SpiDevice<Error: Clone>, Delay: DelayNs> Flash for Area<'_, Spi, Delay> {
    type Error = FlashFault<Spi::Error>;

    fn geometry(&self) -> Geometry {
        Geometry {
            sectors: self.wanted.sectors,
            sector_size: self.wanted.size.bytes(),
            write_size: 1,
            page_size: PAGE,
        }
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Self::Error> {
        let addr = self.place(addr, into.len())?;
        self.with(|chip| chip.read(addr, into))
    }

    fn program(&mut self, addr: u32, mut bytes: &[u8]) -> Result<(), Self::Error> {
        let mut addr = self.place(addr, bytes.len())?;
        self.with(|chip| {
            // Behind the end of a page, a program goes on at its start.
            while !bytes.is_empty() {
                let room = PAGE - addr % PAGE;
                let (page, rest) = bytes.split_at(bytes.len().min(room as usize));
                chip.program(addr, page)?;
                addr = addr.wrapping_add(room);
                bytes = rest;
            }
            Ok(())
        })
    }

    fn erase(&mut self, sector: u32) -> Result<(), Self::Error> {
        let size = self.wanted.size;
        let addr = sector
            .checked_mul(size.bytes())
            .ok_or(FlashFault::OutOfArea)?;
        let addr = self.place(addr, size.bytes() as usize)?;
        self.with(|chip| chip.erase(addr, size))
    }
}
