//! What can go wrong, each with a code for machines and a sentence for people.

use core::fmt;

/// Why the flash did not do what was asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault<E> {
    /// The bus failed.
    Bus(E),
    /// Nothing answers: the data line is always high or always low.
    NoChip,
    /// A chip that is not in the table.
    UnknownChip {
        /// Its JEDEC id: maker, type, capacity.
        id: [u8; 3],
    },
    /// The chip has no unique id.
    NoUniqueId,
    /// Part of the chip is protected against writing.
    Protected {
        /// Its status register.
        status: u8,
    },
    /// The chip does not accept that it is written to.
    NotEnabled {
        /// Its status register.
        status: u8,
    },
    /// The chip was not ready in time.
    Busy {
        /// How long it was waited for, at least.
        waited_ms: u32,
    },
    /// The areas do not fit on the chip.
    TooSmall {
        /// What they need.
        needed_bytes: u32,
        /// What the chip has.
        capacity_bytes: u32,
    },
    /// An address outside of the area.
    OutOfArea,
    /// Another area is being used at the same time.
    InUse,
}

impl<E> Fault<E> {
    /// A stable name for machines.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Bus(_) => "flash_bus",
            Self::NoChip => "flash_no_chip",
            Self::UnknownChip { .. } => "flash_unknown_chip",
            Self::NoUniqueId => "flash_no_unique_id",
            Self::Protected { .. } => "flash_protected",
            Self::NotEnabled { .. } => "flash_not_enabled",
            Self::Busy { .. } => "flash_busy",
            Self::TooSmall { .. } => "flash_too_small",
            Self::OutOfArea => "flash_out_of_area",
            Self::InUse => "flash_in_use",
        }
    }
}

impl<E: fmt::Debug> fmt::Display for Fault<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => write!(f, "the bus to the flash failed: {error:?}"),
            Self::NoChip => write!(
                f,
                "no flash answers: check its power, its select line and its data lines"
            ),
            Self::UnknownChip { id: [a, b, c] } => write!(
                f,
                "the flash says it is {a:02X} {b:02X} {c:02X}, which is not in the table of \
                 known ones: fit a W25Q or its like, or add the family"
            ),
            Self::NoUniqueId => write!(f, "the flash has no unique id: fit one that has"),
            Self::Protected { status } => write!(
                f,
                "the flash is protected against writing (status {status:02X}h): \
                 clear its block protection"
            ),
            Self::NotEnabled { status } => write!(
                f,
                "the flash does not let itself be written (status {status:02X}h): \
                 check its WP line and its power"
            ),
            Self::Busy { waited_ms } => write!(
                f,
                "the flash was not ready after {waited_ms} ms: it is worn out or torn off"
            ),
            Self::TooSmall {
                needed_bytes,
                capacity_bytes,
            } => write!(
                f,
                "the flash has {capacity_bytes} bytes, {needed_bytes} are needed: fit a larger one"
            ),
            Self::OutOfArea => write!(f, "an address behind the end of the area"),
            Self::InUse => write!(f, "two areas of the flash were used at the same time"),
        }
    }
}

impl<E: fmt::Debug> core::error::Error for Fault<E> {}
