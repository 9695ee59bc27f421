//! The flash trait: all that the journal needs of a NOR flash.

/// The value of a byte that was erased and not programmed since.
pub const ERASED: u8 = 0xFF;

/// A NOR flash region: erasing sets a sector to 0xFF, programming clears bits.
///
/// Addresses count from the start of the region. The journal keeps these
/// promises, which flash with error correction needs (STM32H7, L4, G4):
/// programs are aligned to `write_size` in address and length, their buffer is
/// aligned to four bytes, they never cross a sector end, and a word that was
/// programmed is not programmed again before its sector is erased.
///
/// In return a driver returns from `program` and `erase` only when the flash
/// has finished, and `read` must deliver *some* bytes for a word that its error
/// correction refuses (zeros will do): such a word is what a power cut leaves,
/// and the journal recognises it by its own check. `Err` is for a device that
/// does not answer.
///
/// # Example
///
/// A region in RAM, and a journal on it over a power cycle:
///
/// ```
/// use umi_core::journal::{ERASED, Flash, Geometry, Journal, MAX_PAYLOAD};
/// use umi_core::units::Micros;
///
/// struct Ram([u8; 4 * 4096]);
///
/// impl Flash for Ram {
///     type Error = core::convert::Infallible;
///
///     fn geometry(&self) -> Geometry {
///         Geometry { sectors: 4, sector_size: 4096, write_size: 1, page_size: 1 }
///     }
///     fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Self::Error> {
///         into.copy_from_slice(&self.0[addr as usize..][..into.len()]);
///         Ok(())
///     }
///     fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Self::Error> {
///         self.0[addr as usize..][..bytes.len()].copy_from_slice(bytes);
///         Ok(())
///     }
///     fn erase(&mut self, sector: u32) -> Result<(), Self::Error> {
///         self.0[sector as usize * 4096..][..4096].fill(ERASED);
///         Ok(())
///     }
/// }
///
/// let (mut journal, recovery) = Journal::open(Ram([ERASED; 4 * 4096]))?;
/// assert!(recovery.fresh);
/// assert_eq!(journal.append(1, Micros(20), b"X-12.3450")?, 0);
///
/// let (mut journal, recovery) = Journal::open(journal.into_flash())?;
/// assert!(recovery.is_clean());
/// let mut payload = [0; MAX_PAYLOAD];
/// assert_eq!(journal.read(0, &mut payload)?.entry.payload, b"X-12.3450");
/// journal.verify(journal.first_seq(), journal.next_seq())?;
/// # Ok::<(), umi_core::journal::JournalError<core::convert::Infallible>>(())
/// ```
pub trait Flash {
    /// What the driver reports when the device does not answer.
    type Error: core::fmt::Debug;

    /// The shape of the region. It must not change while a journal is open.
    fn geometry(&self) -> Geometry;

    /// Reads `into.len()` bytes from `addr`, at any alignment.
    ///
    /// # Errors
    /// The device does not answer.
    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Self::Error>;

    /// Programs `bytes` at `addr`, from low addresses to high.
    ///
    /// # Errors
    /// The device does not answer or reports that programming failed.
    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Self::Error>;

    /// Erases the sector with this index (0 is the first of the region).
    ///
    /// # Errors
    /// The device does not answer or reports that erasing failed.
    fn erase(&mut self, sector: u32) -> Result<(), Self::Error>;
}

impl<F: Flash> Flash for &mut F {
    type Error = F::Error;

    fn geometry(&self) -> Geometry {
        (**self).geometry()
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Self::Error> {
        (**self).read(addr, into)
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        (**self).program(addr, bytes)
    }

    fn erase(&mut self, sector: u32) -> Result<(), Self::Error> {
        (**self).erase(sector)
    }
}

/// The shape of a flash region. All sizes are bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Geometry {
    /// How many erase sectors the region has; at least two.
    pub sectors: u16,
    /// Size of one erase sector in bytes.
    pub sector_size: u32,
    /// Smallest unit that can be programmed, in bytes: 1 (serial NOR) to 32
    /// (STM32H7); a power of two up to 256.
    pub write_size: u32,
    /// How many bytes the device programs at the same moment: 256 for the page
    /// of a serial NOR, `write_size` for most on-chip flash. A power cut can
    /// leave any part of such a page half programmed.
    pub page_size: u32,
}

/// The largest `write_size`, and the most that one program writes.
pub(crate) const LARGEST_WRITE: usize = 256;
