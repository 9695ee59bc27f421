//! One chip and its commands.

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{Operation, SpiDevice};

use super::FlashFault;

const PAGE_PROGRAM: u8 = 0x02;
const READ: u8 = 0x03;
const READ_STATUS: u8 = 0x05;
const WRITE_ENABLE: u8 = 0x06;
const ERASE_4K: u8 = 0x20;
const READ_UNIQUE_ID: u8 = 0x4B;
const ERASE_32K: u8 = 0x52;
const READ_JEDEC_ID: u8 = 0x9F;
const WAKE_UP: u8 = 0xAB;
const ERASE_64K: u8 = 0xD8;

const STATUS_BUSY: u8 = 1 << 0;
const STATUS_ENABLED: u8 = 1 << 1;
/// BP0 to BP3. Where the highest has another meaning (TB of W25Q), its factory
/// setting is 0 as well.
const STATUS_PROTECTED: u8 = 0b0011_1100;

/// Bytes that are programmed at once.
pub(super) const PAGE: u32 = 256;

/// What three address bytes reach.
pub(super) const LARGEST: u32 = 1 << 24;

/// Chips that understand the commands used here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Family {
    /// Whose, and which.
    pub name: &'static str,
    /// The first byte of the JEDEC id.
    pub maker: u8,
    /// The second byte of the JEDEC id.
    pub kind: u8,
}

/// Families that are known to understand the commands used here.
pub const FAMILIES: [Family; 5] = [
    family("Winbond W25Q", 0xEF, 0x40),
    family("Winbond W25Q-M", 0xEF, 0x70),
    family("GigaDevice GD25Q", 0xC8, 0x40),
    family("ISSI IS25LP", 0x9D, 0x60),
    family("Macronix MX25L", 0xC2, 0x20),
];

const fn family(name: &'static str, maker: u8, kind: u8) -> Family {
    Family { name, maker, kind }
}

/// How long to wait for something, and how often to look.
#[derive(Clone, Copy)]
struct Patience {
    limit_ms: u32,
    look_us: u32,
}

/// tPP is at most 3 ms (W25Q128JV, 9.6; 5 ms with others).
const FOR_PROGRAM: Patience = Patience {
    limit_ms: 10,
    look_us: 50,
};
/// tSE is at most 0.4 s.
const FOR_4K: Patience = Patience {
    limit_ms: 1_000,
    look_us: 500,
};
/// tBE1 and tBE2 are at most 1.6 s and 2 s.
const FOR_BLOCK: Patience = Patience {
    limit_ms: 4_000,
    look_us: 2_000,
};

/// What is erased at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SectorSize {
    /// 4096 bytes, at most 0.4 s.
    KiB4,
    /// 32768 bytes, at most 1.6 s.
    KiB32,
    /// 65536 bytes, at most 2 s.
    KiB64,
}

impl SectorSize {
    /// The size in bytes.
    #[must_use]
    pub const fn bytes(self) -> u32 {
        match self {
            Self::KiB4 => 4 << 10,
            Self::KiB32 => 32 << 10,
            Self::KiB64 => 64 << 10,
        }
    }

    const fn erase(self) -> (u8, Patience) {
        match self {
            Self::KiB4 => (ERASE_4K, FOR_4K),
            Self::KiB32 => (ERASE_32K, FOR_BLOCK),
            Self::KiB64 => (ERASE_64K, FOR_BLOCK),
        }
    }
}

/// A serial NOR flash on an SPI bus, mode 0 or 3, most significant bit first.
#[derive(Debug)]
pub struct SpiNor<Spi, Delay> {
    spi: Spi,
    delay: Delay,
    family: Family,
    capacity_bytes: u32,
}

impl<Spi: SpiDevice, Delay: DelayNs> SpiNor<Spi, Delay> {
    /// Wakes the chip, waits until it has finished what a reset may have caught it
    /// in, and looks who it is.
    ///
    /// # Errors
    /// [`FlashFault::NoChip`], [`FlashFault::UnknownChip`], [`FlashFault::Protected`],
    /// [`FlashFault::Busy`], [`FlashFault::Bus`].
    pub fn open(spi: Spi, delay: Delay) -> Result<Self, FlashFault<Spi::Error>> {
        let mut chip = Self {
            spi,
            delay,
            family: family("", 0, 0),
            capacity_bytes: 0,
        };
        chip.command(&[WAKE_UP])?;
        // tRES1 is 3 to 30 µs.
        chip.delay.delay_us(50);
        let mut id = chip.identify()?;
        if is_nobody(&id) {
            // Busy chips do not tell who they are.
            chip.wait(FOR_BLOCK).map_err(nobody_is_not_busy)?;
            id = chip.identify()?;
        }
        if is_nobody(&id) {
            return Err(FlashFault::NoChip);
        }
        let [maker, kind, capacity] = id;
        chip.family = FAMILIES
            .into_iter()
            .find(|family| (family.maker, family.kind) == (maker, kind))
            .ok_or(FlashFault::UnknownChip { id })?;
        chip.capacity_bytes = capacity_bytes(capacity).ok_or(FlashFault::UnknownChip { id })?;
        let status = chip.wait(FOR_BLOCK)?;
        writable(status)?;
        Ok(chip)
    }

    /// Which chip it is.
    pub const fn family(&self) -> Family {
        self.family
    }

    /// How many bytes can be used.
    pub const fn capacity_bytes(&self) -> u32 {
        self.capacity_bytes
    }

    /// The number that no other chip of its maker has.
    ///
    /// # Errors
    /// [`FlashFault::NoUniqueId`]: there is none (Macronix). [`FlashFault::Bus`].
    pub fn unique_id(&mut self) -> Result<[u8; 8], FlashFault<Spi::Error>> {
        let mut id = [0; 8];
        self.receive(&[READ_UNIQUE_ID, 0, 0, 0, 0], &mut id)?;
        if is_nobody(&id) {
            return Err(FlashFault::NoUniqueId);
        }
        Ok(id)
    }

    pub(super) fn read(
        &mut self,
        addr: u32,
        into: &mut [u8],
    ) -> Result<(), FlashFault<Spi::Error>> {
        self.receive(&addressed(READ, addr), into)
    }

    /// Programs bytes within one page.
    pub(super) fn program(
        &mut self,
        addr: u32,
        bytes: &[u8],
    ) -> Result<(), FlashFault<Spi::Error>> {
        self.enable()?;
        self.spi
            .transaction(&mut [
                Operation::Write(&addressed(PAGE_PROGRAM, addr)),
                Operation::Write(bytes),
            ])
            .map_err(FlashFault::Bus)?;
        writable(self.wait(FOR_PROGRAM)?)
    }

    /// Erases the sector that begins at this address.
    pub(super) fn erase(
        &mut self,
        addr: u32,
        size: SectorSize,
    ) -> Result<(), FlashFault<Spi::Error>> {
        let (command, patience) = size.erase();
        self.enable()?;
        self.command(&addressed(command, addr))?;
        writable(self.wait(patience)?)
    }

    fn identify(&mut self) -> Result<[u8; 3], FlashFault<Spi::Error>> {
        let mut id = [0; 3];
        self.receive(&[READ_JEDEC_ID], &mut id)?;
        Ok(id)
    }

    /// Sets the write enable latch, and makes sure that it is set.
    fn enable(&mut self) -> Result<(), FlashFault<Spi::Error>> {
        self.command(&[WRITE_ENABLE])?;
        let status = self.status()?;
        if status & (STATUS_ENABLED | STATUS_BUSY) == STATUS_ENABLED {
            Ok(())
        } else {
            Err(FlashFault::NotEnabled { status })
        }
    }

    /// Waits until the chip has finished. Returns its status.
    fn wait(&mut self, patience: Patience) -> Result<u8, FlashFault<Spi::Error>> {
        let looks = patience.limit_ms * 1_000 / patience.look_us.max(1);
        for _ in 0..looks {
            let status = self.status()?;
            if status & STATUS_BUSY == 0 {
                return Ok(status);
            }
            self.delay.delay_us(patience.look_us);
        }
        Err(FlashFault::Busy {
            waited_ms: patience.limit_ms,
        })
    }

    fn status(&mut self) -> Result<u8, FlashFault<Spi::Error>> {
        let mut status = [0];
        self.receive(&[READ_STATUS], &mut status)?;
        let [status] = status;
        Ok(status)
    }

    fn command(&mut self, bytes: &[u8]) -> Result<(), FlashFault<Spi::Error>> {
        self.spi.write(bytes).map_err(FlashFault::Bus)
    }

    fn receive(&mut self, command: &[u8], into: &mut [u8]) -> Result<(), FlashFault<Spi::Error>> {
        self.spi
            .transaction(&mut [Operation::Write(command), Operation::Read(into)])
            .map_err(FlashFault::Bus)
    }
}

/// What the third byte of the JEDEC id says, in all of [`FAMILIES`]: the logarithm
/// of the capacity up to 32 MiB. Behind that makers differ, but all have more.
fn capacity_bytes(code: u8) -> Option<u32> {
    match code {
        0x10..=0x18 => Some(1 << code),
        0x19..=0x22 => Some(LARGEST),
        _ => None,
    }
}

fn addressed(command: u8, addr: u32) -> [u8; 4] {
    let [_, high, middle, low] = addr.to_be_bytes();
    [command, high, middle, low]
}

/// Nothing drives the line, or it is stuck.
fn is_nobody(id: &[u8]) -> bool {
    id.iter().all(|byte| *byte == 0xFF) || id.iter().all(|byte| *byte == 0)
}

/// A line that is always high reads as a chip that is always busy.
fn nobody_is_not_busy<E>(fault: FlashFault<E>) -> FlashFault<E> {
    match fault {
        FlashFault::Busy { .. } => FlashFault::NoChip,
        other => other,
    }
}

fn writable<E>(status: u8) -> Result<(), FlashFault<E>> {
    if status & STATUS_PROTECTED == 0 {
        Ok(())
    } else {
        Err(FlashFault::Protected { status })
    }
}
