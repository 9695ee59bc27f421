//! What of an image goes into flash.

use anyhow::{Context as _, Result, ensure};
use object::elf::PT_LOAD;
use object::read::elf::{ElfFile32, ProgramHeader as _};

/// Bytes and where in flash they go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LoadPart<'file> {
    /// The address of the first byte: where it is loaded, not where it is copied at start.
    pub address: u32,
    /// The bytes.
    pub bytes: &'file [u8],
}

/// The parts of an ELF file that are loaded, in the order of their addresses.
pub fn parts(file: &[u8]) -> Result<Vec<LoadPart<'_>>> {
    let file: ElfFile32<'_> = ElfFile32::parse(file).context("the image is no 32-bit ELF file")?;
    let endian = file.endian();
    let mut parts = Vec::new();
    for header in file.elf_program_headers() {
        if header.p_type(endian) != PT_LOAD || header.p_filesz(endian) == 0 {
            continue;
        }
        let bytes = header
            .data(endian, file.data())
            .ok()
            .context("a segment of the image lies outside of its file")?;
        parts.push(LoadPart {
            address: header.p_paddr(endian),
            bytes,
        });
    }
    parts.sort_by_key(|part| part.address);
    for pair in parts.windows(2) {
        let [one, next] = *pair else { continue };
        let end = u64::from(one.address) + one.bytes.len() as u64;
        ensure!(
            end <= u64::from(next.address),
            "the image has two contents for address {:#010x}",
            next.address
        );
    }
    Ok(parts)
}

/// The flash from the first byte to the last, with zeros between the parts.
pub fn flat(parts: &[LoadPart<'_>]) -> Vec<u8> {
    let mut flat = Vec::new();
    let start = parts.first().map_or(0, |part| part.address);
    for part in parts {
        flat.resize((part.address - start) as usize, 0);
        flat.extend_from_slice(part.bytes);
    }
    flat
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gap becomes zeros, and nothing stands before the first part.
    #[test]
    fn flat_file() {
        let parts = [
            LoadPart {
                address: 0x0800_0000,
                bytes: &[1, 2],
            },
            LoadPart {
                address: 0x0800_0004,
                bytes: &[3],
            },
        ];
        assert_eq!(flat(&parts), [1, 2, 0, 0, 3]);
        assert!(flat(&[]).is_empty());
    }
}
