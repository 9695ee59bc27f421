//! Journal, evidence, settings, part programs and the keys of people: areas of a serial NOR flash of
//! their own.
//!
//! # Design
//!
//! The flash that the code runs from is not written while the board works: while it is, nothing can
//! be read from it. Only the board's own key stands there ([`owner`]), which each start counts before
//! anything else runs, and signed images, which come while nothing is measured ([`chip_flash`]). The other one hangs on SPI 0 and may be as busy as it
//! likes: who waits for it is the task of the lowest priority.

#[cfg(feature = "slot-ab")]
mod ab_images;
pub mod chip_flash;
mod flash_line;
#[cfg(all(feature = "update", not(feature = "slot-ab")))]
mod images;
pub mod noise;
pub mod owner;
#[cfg(feature = "update")]
#[path = "../../../common/updates.rs"]
pub mod updates;

use core::convert::Infallible;

use embassy_rp::gpio::{Level, Output};
#[cfg(feature = "update")]
use embassy_rp::peripherals::FLASH;
use embassy_rp::peripherals::{PIN_4, PIN_5, PIN_6, PIN_7, SPI0};
use embassy_rp::spi::{Config, Spi};
use embassy_rp::{Peri, spi};
use embassy_time::Delay;
use embedded_hal_bus::spi::{DeviceError, ExclusiveDevice};
use static_cell::StaticCell;
use umi_core::journal::{Flash, Geometry};
use umi_drivers::spi_nor::{self, FlashFault, SectorSize, SpiNor, Wanted};

use crate::storage::flash_line::FlashLine;
#[cfg(feature = "update")]
use crate::storage::updates::RunningImage;

/// Clock of the line: any W25Q reads so fast with its slow command.
const SPI_HZ: u32 = 32_000_000;

/// 2 MB: some seventeen thousand lines of the control, with what follows from them. The
/// journal looks through all of it before it begins on a new chip: a second.
const JOURNAL: Wanted = Wanted {
    sectors: 32,
    size: SectorSize::KiB64,
};
/// Job and taught reference. The longest settings must find room in a sector.
const SETTINGS: Wanted = Wanted {
    sectors: 4,
    size: SectorSize::KiB32,
};

/// 4 MB of part programs. Small sectors: one of them is erased in the time in which a host
/// waits for an answer.
const PROGRAMS: Wanted = Wanted {
    sectors: 1024,
    size: SectorSize::KiB4,
};

/// 1 MB of evidence: some 740 setups with their corrections and heads, apart from the noise.
const EVIDENCE: Wanted = Wanted {
    sectors: 16,
    size: SectorSize::KiB64,
};

/// What is kept for the owner, and the keys of people.
const SMALL: Wanted = Wanted {
    sectors: 4,
    size: SectorSize::KiB4,
};

type Device = ExclusiveDevice<FlashLine, Output<'static>, Delay>;
/// What can be wrong with the flash.
pub type Failure = FlashFault<DeviceError<spi::Error, Infallible>>;

type Shared = spi_nor::Shared<Device, Delay>;

/// An area of the flash, or what stands for it where there is no flash.
pub enum Part {
    /// The area.
    There(spi_nor::Area<'static, Device, Delay>),
    /// Why there is none, and what it would have been.
    Missing(Failure, Wanted),
    /// An area of the other flash.
    #[cfg(feature = "update")]
    Chip(chip_flash::ChipFlash),
}

/// The image that runs, as a boot loader has started it: before anything that cannot wait.
#[cfg(all(feature = "update", not(feature = "slot-ab")))]
pub fn running_image(flash: &Peri<'static, FLASH>) -> Option<RunningImage> {
    let reverted = images::take_reverted();
    let slots = images::open(flash, Part::Chip).and_then(updates::found);
    Some(updates::running(slots, reverted))
}

/// The same, as the boot ROM has started it. None: this image may not run.
#[cfg(feature = "slot-ab")]
pub fn running_image(flash: &Peri<'static, FLASH>) -> Option<RunningImage> {
    let (slots, reverted) = ab_images::take_over(flash)?;
    Some(updates::running(slots, reverted))
}

/// What is there after the start.
pub struct Storage {
    /// For the journal.
    pub journal: Part,
    /// For the settings.
    pub settings: Part,
    /// For part programs.
    pub programs: Part,
    /// For evidence.
    pub evidence: Part,
    /// For the owner's configuration.
    pub custody: Part,
    /// For the keys of people.
    pub access: Part,
    /// The chip's own number; zeros if it has none.
    pub unique_id: [u8; 8],
}

/// The chip's pins and the line that they belong to.
pub struct StorageParts {
    /// The line.
    pub spi: Peri<'static, SPI0>,
    /// From the chip.
    pub miso: Peri<'static, PIN_4>,
    /// Selects the chip.
    pub select: Peri<'static, PIN_5>,
    /// Clock.
    pub clock: Peri<'static, PIN_6>,
    /// To the chip.
    pub mosi: Peri<'static, PIN_7>,
}

/// Opens the flash. To be called once. A board without it runs all the same: it says so,
/// and sends no correction.
pub fn open(parts: StorageParts) -> Storage {
    let mut unique_id = [0; 8];
    match areas(parts, &mut unique_id) {
        Ok([journal, settings, programs, evidence, custody, access]) => Storage {
            journal: Part::There(journal),
            settings: Part::There(settings),
            programs: Part::There(programs),
            evidence: Part::There(evidence),
            custody: Part::There(custody),
            access: Part::There(access),
            unique_id,
        },
        Err(fault) => {
            defmt::error!("journal's memory: {=str}", fault.code());
            Storage {
                journal: Part::Missing(fault, JOURNAL),
                settings: Part::Missing(fault, SETTINGS),
                programs: Part::Missing(fault, PROGRAMS),
                evidence: Part::Missing(fault, EVIDENCE),
                custody: Part::Missing(fault, SMALL),
                access: Part::Missing(fault, SMALL),
                unique_id,
            }
        }
    }
}

fn areas(
    parts: StorageParts,
    unique_id: &mut [u8; 8],
) -> Result<[spi_nor::Area<'static, Device, Delay>; 6], Failure> {
    static SHARED: StaticCell<Shared> = StaticCell::new();

    let mut config = Config::default();
    config.frequency = SPI_HZ;
    let line = Spi::new_blocking(parts.spi, parts.clock, parts.mosi, parts.miso, config);
    let line = FlashLine(line);
    let select = Output::new(parts.select, Level::High);
    owner::pull_up_jumper();
    let device = match ExclusiveDevice::new(line, select, Delay) {
        Ok(device) => device,
        Err(never) => match never {},
    };
    let mut chip = SpiNor::open(device, Delay)?;
    match chip.unique_id() {
        Ok(id) => *unique_id = id,
        Err(fault) => defmt::warn!("no serial number: {=str}", fault.code()),
    }
    SHARED
        .init_with(|| Shared::new(chip))
        .areas([JOURNAL, SETTINGS, PROGRAMS, EVIDENCE, SMALL, SMALL])
}

impl Flash for Part {
    type Error = Failure;

    fn geometry(&self) -> Geometry {
        match self {
            Self::There(area) => area.geometry(),
            #[cfg(feature = "update")]
            Self::Chip(area) => area.geometry(),
            Self::Missing(_, wanted) => Geometry {
                sectors: wanted.sectors,
                sector_size: wanted.size.bytes(),
                write_size: 1,
                page_size: 256,
            },
        }
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Failure> {
        match self {
            Self::There(area) => area.read(addr, into),
            #[cfg(feature = "update")]
            Self::Chip(area) => area.read(addr, into).map_err(|_| FlashFault::OutOfArea),
            Self::Missing(fault, _) => Err(*fault),
        }
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Failure> {
        match self {
            Self::There(area) => area.program(addr, bytes),
            #[cfg(feature = "update")]
            Self::Chip(area) => area.program(addr, bytes).map_err(|_| FlashFault::OutOfArea),
            Self::Missing(fault, _) => Err(*fault),
        }
    }

    fn erase(&mut self, sector: u32) -> Result<(), Failure> {
        match self {
            Self::There(area) => area.erase(sector),
            #[cfg(feature = "update")]
            Self::Chip(area) => area.erase(sector).map_err(|_| FlashFault::OutOfArea),
            Self::Missing(fault, _) => Err(*fault),
        }
    }
}
