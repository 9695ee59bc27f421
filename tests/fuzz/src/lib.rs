//! What the targets share: a flash in memory, and a board's own key.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use ed25519_dalek::{Signer as _, SigningKey};
use umi_app::measure::trust::heads::HeadSigner;
use umi_core::journal::{ERASED, Flash, Geometry};

/// Signs for the board.
pub struct Board(SigningKey);

impl Board {
    /// The one that there is.
    pub fn signer() -> Option<&'static dyn HeadSigner> {
        static BOARD: OnceLock<Board> = OnceLock::new();
        Some(BOARD.get_or_init(|| Self(SigningKey::from_bytes(&[0xB0; 32]))))
    }
}

impl HeadSigner for Board {
    fn key(&self) -> [u8; 32] {
        self.0.verifying_key().to_bytes()
    }

    fn boot(&self) -> u32 {
        1
    }

    fn sign(&self, bytes: &[u8]) -> [[u8; 32]; 2] {
        let signature = self.0.sign(bytes);
        [*signature.r_bytes(), *signature.s_bytes()]
    }
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
