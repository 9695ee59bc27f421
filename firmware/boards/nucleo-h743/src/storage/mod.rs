//! Journal, evidence, settings, part programs, configuration and the keys of people: areas of a serial NOR flash
//! of their own. The board's own key stands in the chip's own flash, and so do signed images ([`chip_flash`]).

pub mod chip_flash;
#[cfg(feature = "update")]
pub mod images;
pub mod noise;
pub mod owner;
mod part;
#[cfg(feature = "update")]
#[path = "../../../common/updates.rs"]
pub mod updates;

use embassy_stm32::gpio::Output;
use embassy_stm32::mode::Blocking;
use embassy_stm32::spi::Spi;
use embassy_stm32::spi::mode::Master;
use embassy_time::Delay;
use embedded_hal_bus::spi::ExclusiveDevice;
use static_cell::StaticCell;
use umi_drivers::spi_nor::{SectorSize, Shared, SpiNor, Wanted};
use umi_protocol::message::MAX_RECORD;

pub use part::Part;

/// The chip on its line.
pub type Device = ExclusiveDevice<Spi<'static, Blocking, Master>, Output<'static>, Delay>;

/// Job and taught reference.
const SETTINGS: Wanted = Wanted {
    sectors: 8,
    size: SectorSize::KiB32,
};
/// 4 MB. Small sectors: one of them is erased in the time in which a host waits for an answer.
const PROGRAMS: Wanted = Wanted {
    sectors: 1024,
    size: SectorSize::KiB4,
};
/// What is kept for the owner, and the keys of people.
const SMALL: Wanted = Wanted {
    sectors: 4,
    size: SectorSize::KiB4,
};
/// 1 MB of evidence: some 740 setups with their corrections and heads, apart from the noise.
const EVIDENCE: Wanted = Wanted {
    sectors: 16,
    size: SectorSize::KiB64,
};
const JOURNAL_SECTOR: SectorSize = SectorSize::KiB64;
// The longest record finds room in a sector of either.
const _: () = assert!(MAX_RECORD + 256 < SETTINGS.size.bytes() as usize);

/// What is there after the start.
pub struct Storage {
    /// For the journal.
    pub journal: Part,
    /// For evidence.
    pub evidence: Part,
    /// For the settings.
    pub settings: Part,
    /// For part programs.
    pub programs: Part,
    /// For the owner's configuration.
    pub custody: Part,
    /// For the keys of people.
    pub access: Part,
}

/// Opens the flash. To be called once. A board without it runs all the same: it says so, and sends no correction.
///
/// # Errors
/// The chip is too small: a text that says so.
pub fn open(device: Device) -> Result<Storage, &'static str> {
    static FLASH: StaticCell<Shared<Device, Delay>> = StaticCell::new();

    let flash = FLASH.init(match SpiNor::open(device, Delay) {
        Ok(chip) => Shared::new(chip),
        Err(fault) => {
            defmt::error!("{}: nothing is kept", fault.code());
            Shared::missing(fault)
        }
    });
    let others = [SETTINGS, PROGRAMS, SMALL, SMALL, EVIDENCE];
    let [settings, programs, custody, access, evidence] = others;
    let wanted = [
        settings,
        programs,
        custody,
        access,
        evidence,
        journal_of(flash.capacity_bytes(), &others),
    ];
    let areas = flash.areas(wanted).map_err(|fault| fault.code())?;
    let [settings, programs, custody, access, evidence, journal] = areas.map(Part::Serial);
    Ok(Storage {
        journal,
        evidence,
        settings,
        programs,
        custody,
        access,
    })
}

/// What the others leave of the flash.
fn journal_of(capacity_bytes: u32, others: &[Wanted]) -> Wanted {
    let bytes = |wanted: &Wanted| u32::from(wanted.sectors) * wanted.size.bytes();
    // Evidence, the last of them, ends at a boundary of such sectors.
    let others = others.iter().map(bytes).sum::<u32>();
    let others = others.next_multiple_of(JOURNAL_SECTOR.bytes());
    let sectors = capacity_bytes.saturating_sub(others) / JOURNAL_SECTOR.bytes();
    Wanted {
        sectors: u16::try_from(sectors).unwrap_or(u16::MAX),
        size: JOURNAL_SECTOR,
    }
}
