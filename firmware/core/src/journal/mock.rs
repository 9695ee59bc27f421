//! A flash that fails in the ways real flash does, for tests only. Also used,
//! by path, from `tests/tests/keep/journal_power_cut`.
//!
//! It panics on what real flash forbids: a program that is not aligned, leaves
//! its sector, or touches a word that was programmed since its last whole erase;
//! an address outside. It counts what it does, and cuts power where it is told.

use std::cell::{Cell, RefCell};
use std::vec::Vec;

use super::{ERASED, Flash, Geometry};

/// Where in an operation power is cut, and what that leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cut {
    /// Program: bytes before this one are done, some bits of this one, no more.
    /// The length of the program: all is done, but nobody was told.
    AtByte(usize),
    /// Program: bytes before this one are done, and the word that starts here
    /// was begun but still reads as erased.
    Unseen(usize),
    /// Program: the pages before the one with this byte are done, and of that
    /// page any of the bits, in no order.
    Page(usize),
    /// Erase: nothing can be seen yet.
    EraseUnseen,
    /// Erase: the first bytes are erased, the rest is as it was.
    EraseFront,
    /// Erase: the last bytes are erased, the rest is as it was.
    EraseBack,
    /// Erase: each bit is as it was, or erased.
    EraseSomeBits,
    /// Erase: anything.
    EraseGarbage,
    /// Erase: all but the first 64 bytes are erased or anything: the header stays.
    EraseNotHeader,
    /// Erase: reads as erased, but was not finished.
    EraseLooksDone,
    /// Erase: finished, but nobody was told.
    EraseDone,
}

/// All that can happen to an erase.
pub const ERASE_CUTS: [Cut; 8] = [
    Cut::EraseUnseen,
    Cut::EraseFront,
    Cut::EraseBack,
    Cut::EraseSomeBits,
    Cut::EraseGarbage,
    Cut::EraseNotHeader,
    Cut::EraseLooksDone,
    Cut::EraseDone,
];

/// What the driver reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MockError {
    /// There is no power: nothing is done any more.
    PowerLost,
    /// Programming was reported as failed.
    ProgramFailed,
}

/// One operation that changes the flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Op {
    /// A program of so many bytes at this address.
    Program { addr: u32, len: usize },
    /// An erase of this sector.
    Erase { sector: u32 },
}

/// What is known of a word, whatever it reads as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Word {
    Erased,
    Programmed,
    /// Power was cut while it was programmed.
    Torn,
    /// Power was cut while it was erased.
    HalfErased,
}

/// The flash. Cloning it keeps a moment.
#[derive(Clone)]
pub struct MockFlash {
    geometry: Geometry,
    /// What the cells read as; tests may change it as radiation or an attacker would.
    pub data: Vec<u8>,
    words: Vec<Word>,
    /// Erases of each sector.
    pub erases: Vec<u32>,
    ops: RefCell<Vec<Op>>,
    /// Words that were begun before a cut, read as erased, and were programmed
    /// again: no journal can exclude that, but it must be rare and survived.
    pub programs_over_unseen: u32,
    /// Reads so far, and bytes read.
    pub reads: u64,
    /// Bytes read so far.
    pub bytes_read: u64,
    /// Words that refuse to keep a program: every bit programmed stays set.
    pub worn: Vec<u32>,
    /// The next program does its work and reports a failure.
    pub fail_next_program: bool,
    /// What a cut has left of a word reads as zeros, unless it looks erased or as it was: as behind an error
    /// correction that gave up.
    pub torn_reads_zero: bool,
    cut: Cell<Option<(usize, Cut, u64)>>,
    powered: bool,
    random: Random,
}

impl MockFlash {
    /// An erased flash.
    pub fn new(geometry: Geometry) -> Self {
        let size = geometry.sector_size as usize * usize::from(geometry.sectors);
        Self {
            geometry,
            data: std::vec![ERASED; size],
            words: std::vec![Word::Erased; size / geometry.write_size as usize],
            erases: std::vec![0; usize::from(geometry.sectors)],
            ops: RefCell::default(),
            programs_over_unseen: 0,
            reads: 0,
            bytes_read: 0,
            worn: Vec::new(),
            fail_next_program: false,
            torn_reads_zero: false,
            cut: Cell::new(None),
            powered: true,
            random: Random(1),
        }
    }

    /// Cuts power in the operation with this index, counted from the last
    /// [`take_ops`](Self::take_ops), and seeds what that leaves.
    pub fn cut_power_at(&self, op: usize, cut: Cut, seed: u64) {
        self.cut.set(Some((op, cut, seed)));
    }

    /// The operations since this was last called.
    pub fn take_ops(&self) -> Vec<Op> {
        self.ops.take()
    }

    /// Gives power again and starts a new list of operations.
    pub fn power_up(&mut self) {
        self.powered = true;
        self.cut.set(None);
        self.take_ops();
    }

    /// Notes the operation; returns how power is cut in it, if it is.
    fn begin(&mut self, op: Op) -> Result<Option<Cut>, MockError> {
        if !self.powered {
            return Err(MockError::PowerLost);
        }
        let mut ops = self.ops.borrow_mut();
        let index = ops.len();
        ops.push(op);
        let Some((_, cut, seed)) = self.cut.get().filter(|(at, _, _)| *at == index) else {
            return Ok(None);
        };
        self.random = Random(seed);
        self.powered = false;
        Ok(Some(cut))
    }

    /// Clears the bits of one byte that are zero in `value` and in `mask`.
    fn clear_bits(&mut self, at: usize, value: u8, mask: u8) {
        self.data[at] &= value | !mask;
    }

    fn word_of(&self, at: usize) -> usize {
        at / self.geometry.write_size as usize
    }

    fn tear(&mut self, word: usize) {
        self.words[word] = Word::Torn;
        let size = self.geometry.write_size as usize;
        let bytes = &mut self.data[word * size..(word + 1) * size];
        if self.torn_reads_zero && bytes.iter().any(|byte| *byte != ERASED) {
            bytes.fill(0);
        }
    }

    /// Programs one whole word.
    fn program_word(&mut self, at: usize, bytes: &[u8]) {
        let word = self.word_of(at);
        let erased = self.data[at..at + bytes.len()]
            .iter()
            .all(|byte| *byte == ERASED);
        let weak = match self.words[word] {
            Word::Erased => false,
            Word::Torn if erased => true,
            state => panic!("program at {at:#x} of a word that is {state:?} (erased: {erased})"),
        };
        assert!(erased, "program at {at:#x} over bytes that are not erased");
        self.programs_over_unseen += u32::from(weak);
        for (i, byte) in bytes.iter().enumerate() {
            // Cells that were begun with other bits come out as either.
            let other = if weak && self.random.below(4) == 0 {
                self.random.byte()
            } else {
                0xFF
            };
            self.clear_bits(at + i, *byte & other, 0xFF);
        }
        if self.worn.contains(&(at as u32)) {
            self.data[at] = ERASED;
        }
        self.words[word] = Word::Programmed;
    }

    fn program_cut(&mut self, addr: usize, bytes: &[u8], cut: Cut) {
        let word = self.geometry.write_size as usize;
        let page = self.geometry.page_size as usize;
        let (done, torn_end) = match cut {
            Cut::AtByte(at) | Cut::Unseen(at) => (at - at % word, at - at % word + word),
            Cut::Page(at) => {
                let start = (addr + at) - (addr + at) % page;
                (start.saturating_sub(addr), start + page - addr)
            }
            other => panic!("{other:?} in a program"),
        };
        let torn_end = torn_end.min(bytes.len());
        for at in (0..done.min(bytes.len())).step_by(word) {
            self.program_word(addr + at, &bytes[at..at + word]);
        }
        for at in (done..torn_end).step_by(word) {
            let erased = self.data[addr + at..addr + at + word]
                .iter()
                .all(|b| *b == ERASED);
            assert!(
                erased,
                "program at {:#x} over bytes that are not erased",
                addr + at
            );
            for (i, byte) in bytes.iter().enumerate().skip(at).take(word) {
                let mask = match cut {
                    Cut::AtByte(cut) if i < cut => 0xFF,
                    Cut::AtByte(cut) if i == cut => self.random.byte(),
                    Cut::Page(_) => self.random.byte(),
                    _ => 0,
                };
                self.clear_bits(addr + i, *byte, mask);
            }
            let word = self.word_of(addr + at);
            self.tear(word);
        }
    }

    fn erase_cut(&mut self, sector: usize, cut: Cut) {
        let size = self.geometry.sector_size as usize;
        let start = sector * size;
        let before = self.data[start..start + size].to_vec();
        let part = self.random.below(size as u64) as usize;
        for i in 0..size {
            let mask = match cut {
                Cut::EraseFront if i < part => 0xFF,
                Cut::EraseBack if i >= part => 0xFF,
                Cut::EraseSomeBits => self.random.byte(),
                Cut::EraseLooksDone | Cut::EraseDone => 0xFF,
                Cut::EraseNotHeader if i >= 64 => self.random.byte() | self.random.byte(),
                Cut::EraseGarbage => {
                    self.data[start + i] = self.random.byte();
                    0
                }
                _ => 0,
            };
            self.data[start + i] |= mask;
        }
        if self.torn_reads_zero {
            let word = self.geometry.write_size as usize;
            let now = self.data[start..start + size].chunks_mut(word);
            for (now, before) in now.zip(before.chunks(word)) {
                if now != before && now.iter().any(|byte| *byte != ERASED) {
                    now.fill(0);
                }
            }
        }
        let state = if cut == Cut::EraseDone {
            Word::Erased
        } else {
            Word::HalfErased
        };
        let (first, last) = (self.word_of(start), self.word_of(start + size - 1));
        self.words[first..=last].fill(state);
    }
}

impl core::fmt::Debug for MockFlash {
    /// Not its thousands of cells.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("MockFlash")
            .field("geometry", &self.geometry)
            .finish_non_exhaustive()
    }
}

impl Flash for MockFlash {
    type Error = MockError;

    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), MockError> {
        if !self.powered {
            return Err(MockError::PowerLost);
        }
        self.reads += 1;
        self.bytes_read += into.len() as u64;
        into.copy_from_slice(&self.data[addr as usize..addr as usize + into.len()]);
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), MockError> {
        let word = self.geometry.write_size as usize;
        assert!(
            (addr as usize).is_multiple_of(word) && bytes.len().is_multiple_of(word),
            "alignment"
        );
        assert!(
            (bytes.as_ptr() as usize).is_multiple_of(4),
            "buffer alignment"
        );
        let last = addr + bytes.len() as u32 - 1;
        let sector_size = self.geometry.sector_size;
        assert!(
            addr / sector_size == last / sector_size,
            "crosses a sector end"
        );
        let addr = addr as usize;
        if let Some(cut) = self.begin(Op::Program {
            addr: addr as u32,
            len: bytes.len(),
        })? {
            self.program_cut(addr, bytes, cut);
            return Err(MockError::PowerLost);
        }
        for (i, piece) in bytes.chunks(word).enumerate() {
            self.program_word(addr + i * word, piece);
        }
        if core::mem::take(&mut self.fail_next_program) {
            return Err(MockError::ProgramFailed);
        }
        Ok(())
    }

    fn erase(&mut self, sector: u32) -> Result<(), MockError> {
        let cut = self.begin(Op::Erase { sector })?;
        self.erases[sector as usize] += 1;
        self.erase_cut(sector as usize, cut.unwrap_or(Cut::EraseDone));
        if cut.is_some() {
            Err(MockError::PowerLost)
        } else {
            Ok(())
        }
    }
}

/// SplitMix64 (Steele, Lea, Flood 2014): small, seeded, the same everywhere.
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A random byte.
    pub fn byte(&mut self) -> u8 {
        (self.bits() >> 56) as u8
    }

    /// A random number below `n`, which is not zero.
    pub fn below(&mut self, n: u64) -> u64 {
        self.bits() % n
    }
}
