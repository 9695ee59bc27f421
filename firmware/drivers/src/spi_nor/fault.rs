//! Flash faults, each with a code for machines and a sentence for people.

use strum::IntoStaticStr;
use thiserror::Error;

/// Why the flash did not do what was asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error, IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum FlashFault<E> {
    /// The bus failed.
    #[strum(serialize = "flash_bus")]
    #[error("the bus to the flash failed: {0:?}")]
    Bus(E),
    /// Nothing answers: the data line is always high or always low.
    #[strum(serialize = "flash_no_chip")]
    #[error("no flash answers: check its power, its select line and its data lines")]
    NoChip,
    /// A chip that is not in the table.
    #[strum(serialize = "flash_unknown_chip")]
    #[error("the flash says it is {:02X} {:02X} {:02X}, which is not in the table of known ones: fit a W25Q or its like, or add the family", .id[0], .id[1], .id[2])]
    UnknownChip {
        /// Its JEDEC id: maker, type, capacity.
        id: [u8; 3],
    },
    /// The chip has no unique id.
    #[strum(serialize = "flash_no_unique_id")]
    #[error("the flash has no unique id: fit one that has")]
    NoUniqueId,
    /// Part of the chip is protected against writing.
    #[strum(serialize = "flash_protected")]
    #[error(
        "the flash is protected against writing (status {status:02X}h): clear its block protection"
    )]
    Protected {
        /// Its status register.
        status: u8,
    },
    /// The chip does not accept that it is written to.
    #[strum(serialize = "flash_not_enabled")]
    #[error(
        "the flash does not let itself be written (status {status:02X}h): check its WP line and its power"
    )]
    NotEnabled {
        /// Its status register.
        status: u8,
    },
    /// The chip was not ready in time.
    #[strum(serialize = "flash_busy")]
    #[error("the flash was not ready after {waited_ms} ms: it is worn out or torn off")]
    Busy {
        /// How long it was waited for, at least.
        waited_ms: u32,
    },
    /// The areas do not fit on the chip.
    #[strum(serialize = "flash_too_small")]
    #[error("the flash has {capacity_bytes} bytes, {needed_bytes} are needed: fit a larger one")]
    TooSmall {
        /// What they need.
        needed_bytes: u32,
        /// What the chip has.
        capacity_bytes: u32,
    },
    /// An address outside of the area.
    #[strum(serialize = "flash_out_of_area")]
    #[error("an address behind the end of the area")]
    OutOfArea,
    /// Another area is being used at the same time.
    #[strum(serialize = "flash_in_use")]
    #[error("two areas of the flash were used at the same time")]
    InUse,
}

impl<E> FlashFault<E> {
    /// A stable name for machines.
    #[must_use]
    pub fn code(&self) -> &'static str {
        self.into()
    }
}
