//! What the targets share: a flash in memory, and a board's own key.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use umi_app::measure::trust::heads::HeadSigner;
use umi_core::journal::{ERASED, Flash, Geometry};
use umi_core::trust::board_key::BoardKey;

/// Who signs for the board that there is.
pub fn signer() -> Option<&'static HeadSigner> {
    static BOARD: OnceLock<HeadSigner> = OnceLock::new();
    let open = || {
        let drawn = |seed: &mut [u8; 32]| {
            seed.fill(0xB0);
            seed[0] = 1;
            Ok(())
        };
        let key = BoardKey::open(Memory::erased(2, 4096), drawn).expect("a new board draws a key");
        HeadSigner::new(key, [0; 32])
    };
    Some(BOARD.get_or_init(open))
}

/// The cells of a flash; clones share them, as a board's next start does.
#[derive(Clone)]
pub struct Memory {
    cells: Arc<Mutex<Vec<u8>>>,
    geometry: Geometry,
}

impl Memory {
    /// A new one: so many sectors of so many bytes.
    pub fn erased(sectors: u16, sector_bytes: u32) -> Self {
        Self::of(
            vec![ERASED; usize::from(sectors) * sector_bytes as usize],
            sector_bytes,
        )
    }

    /// One with these bytes, in whole sectors.
    pub fn of(cells: Vec<u8>, sector_bytes: u32) -> Self {
        let sectors = cells.len() / sector_bytes as usize;
        Self {
            cells: Arc::new(Mutex::new(cells)),
            geometry: Geometry {
                sectors: u16::try_from(sectors).expect("few sectors"),
                sector_size: sector_bytes,
                write_size: 1,
                page_size: 256,
            },
        }
    }

    /// What is in it.
    pub fn cells(&self) -> Vec<u8> {
        self.with(|cells| cells.clone())
    }

    fn with<R>(&self, look: impl FnOnce(&mut Vec<u8>) -> R) -> R {
        look(&mut self.cells.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Flash for Memory {
    type Error = ();

    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), ()> {
        self.with(|cells| into.copy_from_slice(&cells[addr as usize..][..into.len()]));
        Ok(())
    }

    /// As flash does it: bits are cleared, none is set.
    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), ()> {
        self.with(|cells| {
            for (cell, byte) in cells[addr as usize..].iter_mut().zip(bytes) {
                *cell &= byte;
            }
        });
        Ok(())
    }

    fn erase(&mut self, sector: u32) -> Result<(), ()> {
        let size = self.geometry.sector_size as usize;
        self.with(|cells| cells[sector as usize * size..][..size].fill(ERASED));
        Ok(())
    }
}
