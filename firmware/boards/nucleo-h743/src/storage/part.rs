//! An area of either flash.

use umi_core::journal::{Flash, Geometry};
use umi_drivers::spi_nor;
#[cfg(feature = "update")]
use umi_drivers::spi_nor::FlashFault;

use super::Device;
#[cfg(feature = "update")]
use super::chip_flash::ChipFlash;

/// An area of the serial flash.
type SerialPart = spi_nor::Area<'static, Device, embassy_time::Delay>;

/// An area.
pub enum Part {
    /// Of the serial flash, or what answers in its place where there is no chip.
    Serial(SerialPart),
    /// Of the chip's own flash.
    #[cfg(feature = "update")]
    Chip(ChipFlash),
}

impl Flash for Part {
    type Error = <SerialPart as Flash>::Error;

    fn geometry(&self) -> Geometry {
        match self {
            Self::Serial(area) => area.geometry(),
            #[cfg(feature = "update")]
            Self::Chip(area) => area.geometry(),
        }
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Self::Error> {
        match self {
            Self::Serial(area) => area.read(addr, into),
            #[cfg(feature = "update")]
            Self::Chip(area) => area.read(addr, into).map_err(|_| FlashFault::OutOfArea),
        }
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        match self {
            Self::Serial(area) => area.program(addr, bytes),
            #[cfg(feature = "update")]
            Self::Chip(area) => area.program(addr, bytes).map_err(|_| FlashFault::OutOfArea),
        }
    }

    fn erase(&mut self, sector: u32) -> Result<(), Self::Error> {
        match self {
            Self::Serial(area) => area.erase(sector),
            #[cfg(feature = "update")]
            Self::Chip(area) => area.erase(sector).map_err(|_| FlashFault::OutOfArea),
        }
    }
}
