//! What a linked firmware image holds: its size, and where it could still panic.

use std::collections::{BTreeMap, HashMap};

use anyhow::{Context as _, Result};
use object::elf::{SHF_ALLOC, SHF_EXECINSTR, SHF_WRITE};
use object::{Object as _, ObjectSection as _, ObjectSymbol as _, SectionFlags, SectionKind};
use object::{SymbolKind, read};

/// The figures of an image.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Image {
    /// Code, in bytes.
    pub text: u64,
    /// Constants, and the initial values of variables, in bytes: flash beside the code.
    pub constants: u64,
    /// Static variables, in bytes: RAM without the stack.
    pub variables: u64,
    /// Calls of the core library's panics, counted by the function that makes them.
    pub panics: BTreeMap<String, u32>,
}

impl Image {
    /// Reads an ELF file for Arm.
    pub fn read(file: &[u8]) -> Result<Self> {
        let file = read::File::parse(file).context("the image is no object file")?;
        let functions = functions(&file);
        let mut image = Self::default();
        for section in file.sections() {
            let SectionFlags::Elf { sh_flags, .. } = section.flags() else {
                continue;
            };
            if !sh_flags.contains(SHF_ALLOC) {
                continue;
            }
            if sh_flags.contains(SHF_EXECINSTR) {
                image.text += section.size();
                let code = section.data().context("the image's code cannot be read")?;
                image.count_panics(code, section.address(), &functions);
            } else if sh_flags.contains(SHF_WRITE) {
                image.variables += section.size();
                if section.kind() != SectionKind::UninitializedData {
                    image.constants += section.size();
                }
            } else {
                image.constants += section.size();
            }
        }
        Ok(image)
    }

    /// All calls of panics.
    pub fn panic_calls(&self) -> u32 {
        self.panics.values().sum()
    }

    /// Calls of panics in functions of this project, as opposed to libraries.
    pub fn own_panic_calls(&self) -> u32 {
        let ours = |name: &str| name.trim_start_matches(['<', '&']).starts_with("umi_");
        let own = self.panics.iter().filter(|(name, _)| ours(name));
        own.map(|(_, calls)| calls).sum()
    }

    /// Counts the branches in `code`, which lies at `address`, that lead into a panic.
    ///
    /// Every halfword is tried as the start of an instruction. That is safe: the second
    /// half of another instruction, or a constant between functions, would have to name the
    /// very address of a panic to be miscounted.
    fn count_panics(&mut self, code: &[u8], address: u64, functions: &Functions) {
        for (index, halfwords) in code.windows(4).enumerate().step_by(2) {
            let at = address + index as u64;
            let [a, b, c, d] = *halfwords else { continue };
            let first = u16::from_le_bytes([a, b]);
            let second = u16::from_le_bytes([c, d]);
            let Some(offset) = long_branch(first, second) else {
                continue;
            };
            let target = at.wrapping_add(4).wrapping_add_signed(offset);
            let leads_to_panic = functions
                .starts
                .get(&target)
                .is_some_and(|name| is_panic(name));
            // A panic that calls the next one is part of the same panic.
            let caller = functions.containing(at);
            if leads_to_panic && !is_panic(caller) {
                *self.panics.entry(caller.to_owned()).or_default() += 1;
            }
        }
    }
}

/// The functions of an image, by where they lie.
struct Functions {
    starts: HashMap<u64, String>,
    ranges: BTreeMap<u64, (u64, String)>,
}

impl Functions {
    fn containing(&self, address: u64) -> &str {
        match self.ranges.range(..=address).next_back() {
            Some((_, (end, name))) if address < *end => name,
            _ => "(no function)",
        }
    }
}

fn functions(file: &read::File<'_>) -> Functions {
    let mut functions = Functions {
        starts: HashMap::new(),
        ranges: BTreeMap::new(),
    };
    for symbol in file.symbols() {
        if symbol.kind() != SymbolKind::Text {
            continue;
        }
        let Ok(name) = symbol.name() else { continue };
        // `#` leaves the hash out, which changes from build to build.
        let name = format!("{:#}", rustc_demangle::demangle(name));
        // The lowest bit of an address says "Thumb code".
        let start = symbol.address() & !1;
        functions
            .ranges
            .insert(start, (start + symbol.size(), name.clone()));
        functions.starts.insert(start, name);
    }
    functions
}

/// Whether the function of this name is one in which a panic begins.
fn is_panic(name: &str) -> bool {
    [
        "core::panicking::",
        "core::option::unwrap_failed",
        "core::option::expect_failed",
        "core::result::unwrap_failed",
        "core::cell::panic_",
        "core::slice::index::slice_",
        "core::str::slice_error_fail",
    ]
    .iter()
    .any(|start| name.starts_with(start))
}

/// Where a Thumb `BL` or wide `B` leads, relative to its own address plus 4
/// (Armv7-M Architecture Reference Manual, A7.7.12 `B` T4 and A7.7.18 `BL` T1).
fn long_branch(first: u16, second: u16) -> Option<i64> {
    let is_bl = second & 0xD000 == 0xD000;
    let is_b = second & 0xD000 == 0x9000;
    if first & 0xF800 != 0xF000 || !(is_bl || is_b) {
        return None;
    }
    let bit = |half: u16, index: u32| u32::from(half >> index) & 1;
    let sign = bit(first, 10);
    let i1 = 1 ^ bit(second, 13) ^ sign;
    let i2 = 1 ^ bit(second, 11) ^ sign;
    let (imm10, imm11) = (u32::from(first & 0x3FF), u32::from(second & 0x7FF));
    let offset = sign << 24 | i1 << 23 | i2 << 22 | imm10 << 12 | imm11 << 1;
    // 25 bits, the highest of which is the sign.
    Some(i64::from((offset << 7) as i32 >> 7))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Encodings as an assembler gives them, near, far and backwards.
    #[test]
    fn branches() {
        // bl .+4
        assert_eq!(long_branch(0xF000, 0xF800), Some(0));
        // bl .+0x104
        assert_eq!(long_branch(0xF000, 0xF880), Some(0x100));
        // bl . (to itself)
        assert_eq!(long_branch(0xF7FF, 0xFFFE), Some(-4));
        // b.w .+0x1004
        assert_eq!(long_branch(0xF001, 0xB800), Some(0x1000));
        // the farthest: -16 MiB and +16 MiB - 2
        assert_eq!(long_branch(0xF400, 0xD000), Some(-(1 << 24)));
        assert_eq!(long_branch(0xF3FF, 0xD7FF), Some((1 << 24) - 2));
        // blx, a conditional branch, and data
        assert_eq!(long_branch(0xF000, 0xE800), None);
        assert_eq!(long_branch(0xF000, 0x8000), None);
        assert_eq!(long_branch(0x4770, 0xF800), None);
    }

    /// A call of a panic counts for its caller; a panic's own calls do not.
    #[test]
    fn panics_count_for_their_callers() {
        let mut functions = Functions {
            starts: HashMap::new(),
            ranges: BTreeMap::new(),
        };
        for (start, name) in [
            (0x100, "umi_core::fit"),
            (0x108, "core::panicking::panic_fmt"),
        ] {
            functions.ranges.insert(start, (start + 8, name.to_owned()));
            functions.starts.insert(start, name.to_owned());
        }
        // At 0x100: bl 0x108, nop, nop. At 0x108: bl 0x108, nop, nop.
        let code = [
            0x00, 0xF0, 0x02, 0xF8, 0x00, 0xBF, 0x00, 0xBF, //
            0xFF, 0xF7, 0xFE, 0xFF, 0x00, 0xBF, 0x00, 0xBF,
        ];
        let mut image = Image::default();
        image.count_panics(&code, 0x100, &functions);
        assert_eq!(
            image.panics,
            BTreeMap::from([("umi_core::fit".to_owned(), 1)])
        );
        assert_eq!((image.panic_calls(), image.own_panic_calls()), (1, 1));
        image.panics = BTreeMap::from([
            ("<umi_core::fit::Ball as core::ops::Add>::add".to_owned(), 2),
            ("<[umi_core::fit::Ball]>::sort".to_owned(), 4),
        ]);
        assert_eq!((image.panic_calls(), image.own_panic_calls()), (6, 2));
    }
}
