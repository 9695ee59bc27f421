//! UF2, the files that a Pico's boot loader takes from its USB drive.
//!
//! Blocks of 512 bytes, each with its address and 256 bytes of content: Microsoft, *USB
//! Flashing Format (UF2)*, <https://github.com/microsoft/uf2>. The Pico's boot loader
//! wants 256-byte pages of flash (RP2040 datasheet, 2.8.4.2), and whole sectors of 4 KB
//! (erratum RP2040-E14), so what an image leaves out of a sector is filled with zeros.

use std::collections::BTreeMap;

use imagecheck::load::LoadPart;

/// Who a file is for: others ignore it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Family {
    /// The RP2040.
    Rp2040,
    /// The RP2350's Arm cores.
    Rp2350,
    /// An RP2350, whatever partitions it has: each part goes to its address.
    Absolute,
}

impl Family {
    /// The number in each block.
    fn id(self) -> u32 {
        match self {
            Self::Rp2040 => 0xE48B_FF56,
            Self::Rp2350 => 0xE48B_FF59,
            Self::Absolute => 0xE48B_FF57,
        }
    }

    /// What `INFO_UF2.TXT` on the boot loader's drive says after `Board-ID:`.
    pub fn board_id(self) -> &'static str {
        match self {
            Self::Rp2040 => "RPI-RP2",
            Self::Rp2350 | Self::Absolute => "RP2350",
        }
    }
}

const MAGIC_START: [u32; 2] = [0x0A32_4655, 0x9E5D_5157];
const MAGIC_END: u32 = 0x0AB1_6F30;
/// The last word of the head is a family's number, not a file's size.
const FLAG_FAMILY: u32 = 0x2000;

const BLOCK: usize = 512;
const PAGE: usize = 256;
const SECTOR: usize = 4096;

/// The file of what an image puts into flash.
pub fn write(parts: &[LoadPart<'_>], family: Family) -> Vec<u8> {
    let mut sectors: BTreeMap<u32, [u8; SECTOR]> = BTreeMap::new();
    for part in parts {
        for (address, byte) in (part.address..).zip(part.bytes) {
            let offset = address % SECTOR as u32;
            let sector = sectors.entry(address - offset).or_insert([0; SECTOR]);
            sector[offset as usize] = *byte;
        }
    }
    let count = (sectors.len() * SECTOR / PAGE) as u32;
    let pages = sectors
        .iter()
        .flat_map(|(address, sector)| (*address..).step_by(PAGE).zip(sector.as_chunks::<PAGE>().0));
    let mut file = Vec::with_capacity(count as usize * BLOCK);
    for (index, (address, page)) in (0..).zip(pages) {
        for word in [
            MAGIC_START[0],
            MAGIC_START[1],
            FLAG_FAMILY,
            address,
            PAGE as u32,
            index,
            count,
            family.id(),
        ] {
            file.extend_from_slice(&word.to_le_bytes());
        }
        file.extend_from_slice(page);
        file.resize(file.len().next_multiple_of(BLOCK) - 4, 0);
        file.extend_from_slice(&MAGIC_END.to_le_bytes());
    }
    file
}

#[cfg(test)]
mod tests {
    use super::*;

    fn word(block: &[u8], at: usize) -> u32 {
        u32::from_le_bytes(block[at..at + 4].try_into().unwrap())
    }

    /// Every field stands where the format has it, and only whole sectors are written.
    #[test]
    fn blocks_follow_the_format() {
        let boot = [1; 256];
        let code = [2; 300];
        let parts = [
            LoadPart {
                address: 0x1000_0000,
                bytes: &boot,
            },
            LoadPart {
                address: 0x1000_0100,
                bytes: &code,
            },
            LoadPart {
                address: 0x1000_2FFF,
                bytes: &[7],
            },
        ];
        let file = write(&parts, Family::Rp2040);
        let (blocks, rest) = file.as_chunks::<512>();
        assert!(rest.is_empty());
        // Two sectors of sixteen pages: 0x1000_0000 and 0x1000_2000.
        assert_eq!(blocks.len(), 32);
        for (index, block) in blocks.iter().enumerate() {
            assert_eq!(&block[..4], b"UF2\n");
            assert_eq!(word(block, 4), 0x9E5D_5157);
            assert_eq!(word(block, 8), 0x2000);
            let sector = if index < 16 { 0x1000_0000 } else { 0x1000_2000 };
            assert_eq!(word(block, 12), sector + 256 * (index as u32 % 16));
            assert_eq!(word(block, 16), 256);
            assert_eq!(word(block, 20), index as u32);
            assert_eq!(word(block, 24), 32);
            assert_eq!(word(block, 28), 0xE48B_FF56);
            assert!(block[288..508].iter().all(|byte| *byte == 0));
            assert_eq!(word(block, 508), 0x0AB1_6F30);
        }
        assert_eq!(blocks[0][32..288], [1; 256]);
        assert_eq!(blocks[1][32..288], [2; 256]);
        assert_eq!(blocks[2][32..76], [2; 44]);
        assert!(blocks[2][76..288].iter().all(|byte| *byte == 0));
        assert_eq!(blocks[31][287], 7);
        assert_eq!(word(&write(&parts, Family::Rp2350), 28), 0xE48B_FF59);
    }
}
