//! A linked image as functions that call each other.
//!
//! # Design
//!
//! Calls are read from the code itself, because that is what runs: what was inlined is
//! gone, and what the linker added is there. The compiler marks what is code and what is
//! data in between (`$t` and `$d`, *ELF for the Arm Architecture*, 5.5.5), so that every
//! instruction is decoded where it begins. A word of data, or a pair of moves, that is the
//! address of a function is taken for a pointer to it.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context as _, Result};
use object::{Object as _, ObjectSection as _, ObjectSymbol as _};
use object::{SectionFlags, SymbolKind, elf, read};

use crate::memory::{DataWord, Memory};
use crate::thumb::{self, Does};

/// A function.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub struct Function {
    /// What it is called, without the hash; several names if it has them.
    pub names: Vec<String>,
    /// What it takes of the stack, in bytes.
    pub frame: u32,
    /// Whether `frame` is all it takes: what it takes by a register is not known.
    pub bounded: bool,
    /// The functions that it calls, or ends in a jump to, each as often as it does.
    pub calls: Vec<usize>,
    /// How often it calls what a pointer says.
    pub indirect: u32,
    /// Whether it never goes back to its caller: its code has no return, and jumps to none.
    pub diverges: bool,
    /// The functions to which it knows pointers: in its code, and in what its code points to.
    pub pointers: BTreeSet<usize>,
}

impl Function {
    /// What it is called.
    pub fn name(&self) -> &str {
        self.names.first().map_or("(no name)", String::as_str)
    }
}

impl Function {
    /// Whether it is the core library's.
    pub fn is_core(&self) -> bool {
        let name = self.name();
        name.starts_with("core::") || name.starts_with("<core::")
    }

    /// Whether the linker has put it between a call and its function.
    pub fn is_veneer(&self) -> bool {
        behind_veneer(self.name()).is_some()
    }

    /// How many panics it calls. One that calls the next is part of the same panic, and a veneer
    /// is part of its callers: they have none.
    pub fn panic_calls(&self, program: &LinkedProgram) -> u32 {
        if self.is_panic() || self.is_veneer() {
            return 0;
        }
        let callees = self.calls.iter().map(|index| &program.functions[*index]);
        callees.filter(|callee| callee.is_panic()).count() as u32
    }

    /// Whether it is one of the core library's, in which a panic begins.
    pub fn is_panic(&self) -> bool {
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
        .any(|start| self.name().starts_with(start))
    }
}

/// The functions of an image.
#[derive(Debug, Default)]
pub struct LinkedProgram {
    /// All functions.
    pub functions: Vec<Function>,
    /// Those to which there are pointers in variables, or where it is not known who knows them.
    pub loose: BTreeSet<usize>,
    /// Where the processor starts.
    pub reset: usize,
    /// What the vector table names, but for `reset` and the faults.
    pub handlers: BTreeSet<usize>,
    /// What the processor runs when nothing else helps: faults and the default handler.
    pub faults: BTreeSet<usize>,
}

impl LinkedProgram {
    /// The functions to which there are pointers.
    pub fn pointed(&self) -> BTreeSet<usize> {
        let known = self
            .functions
            .iter()
            .flat_map(|function| &function.pointers);
        known.chain(&self.loose).copied().collect()
    }
}

/// What of an image tells about its functions.
struct Source<'file> {
    pieces: Vec<Piece<'file>>,
    symbols: Vec<Symbol<'file>>,
    /// The section `.stack_sizes`.
    stack_sizes: &'file [u8],
}

struct Symbol<'file> {
    name: &'file str,
    address: u64,
    size: u64,
    is_function: bool,
}

/// A piece of an image and where it lies.
struct Piece<'file> {
    address: u64,
    bytes: &'file [u8],
    is_vectors: bool,
    is_variable: bool,
}

impl Piece<'_> {
    /// The words from `start` to `end` that lie as words do.
    fn words(&self, start: u64, end: u64) -> impl Iterator<Item = DataWord> {
        let start = start.next_multiple_of(4);
        let (words, _) = self.part(start, end).unwrap_or_default().as_chunks::<4>();
        (start..)
            .step_by(4)
            .zip(words)
            .map(|(address, word)| DataWord {
                address,
                value: u64::from(u32::from_le_bytes(*word)),
                is_variable: self.is_variable,
            })
    }

    /// The part from `start` to `end`.
    fn part(&self, start: u64, end: u64) -> Option<&[u8]> {
        let from = start.checked_sub(self.address)?;
        let to = end.checked_sub(self.address)?;
        self.bytes.get(from as usize..to as usize)
    }
}

/// Where functions lie: by their first address, the end and the place in `functions`.
type Places = BTreeMap<u64, (u64, usize)>;

impl LinkedProgram {
    /// Reads an ELF file for Arm.
    pub fn read(file: &read::File<'_>) -> Result<Self> {
        Self::of(&Source::read(file)?)
    }

    fn of(source: &Source<'_>) -> Result<Self> {
        let pieces = &source.pieces;
        let mut program = Self::default();
        let places = program.name_functions(source);
        let sizes = stack_sizes(source.stack_sizes)?;
        let ranges = ranges(source);
        let mut values = vec![Vec::new(); program.functions.len()];
        let mut ends = vec![Ends::default(); program.functions.len()];
        for (start, (end, index)) in &places {
            let Some(piece) = pieces
                .iter()
                .find(|piece| piece.part(*start, *end).is_some())
            else {
                continue;
            };
            let function = &mut program.functions[*index];
            for (from, to) in code_within(&ranges, *start, *end) {
                let code = piece.part(from, to).unwrap_or_default();
                function.read_code(code, from, (*start, *end), &places, &mut values[*index]);
                ends[*index].read(code, from, (*start, *end), &places);
            }
            if let Some(size) = sizes.get(start) {
                (function.frame, function.bounded) = (*size, true);
            }
        }
        let mut outside = Vec::new();
        for word in data(pieces, &ranges) {
            match around(&places, word.address) {
                Some(index) => values[index].push(word.value),
                None => outside.push(word),
            }
        }
        let mut memory = Memory::new(&outside, values.iter().flatten().copied());
        let functions = |values: BTreeSet<u64>| -> BTreeSet<usize> {
            values
                .iter()
                .filter_map(|value| at(&places, *value))
                .collect()
        };
        for (function, values) in program.functions.iter_mut().zip(&values) {
            let known = functions(memory.from(values));
            // A table of digits holds no pointers, though four of them can be the address of a function.
            let is_number = function
                .name()
                .trim_start_matches('<')
                .starts_with("core::num::");
            function.pointers = if is_number { BTreeSet::new() } else { known };
        }
        program.loose = functions(memory.rest().into_iter().collect());
        for (function, returns) in program.functions.iter_mut().zip(returning(&ends)) {
            function.diverges = !returns;
        }
        program.pass_veneers();
        program.read_vectors(pieces, &places)?;
        Ok(program)
    }

    fn name_functions(&mut self, source: &Source<'_>) -> Places {
        let mut sizes: BTreeMap<u64, (u64, Vec<String>)> = BTreeMap::new();
        for symbol in source.symbols.iter().filter(|symbol| symbol.is_function) {
            let (size, names) = sizes.entry(symbol.address).or_default();
            *size = symbol.size.max(*size);
            names.push(readable(symbol.name));
        }
        let starts: Vec<u64> = sizes.keys().copied().collect();
        let mut places = Places::new();
        for (index, (start, (size, names))) in sizes.into_iter().enumerate() {
            // Assembly does not always say how long it is: up to the next function, then.
            let next = starts.get(index + 1).copied().unwrap_or(u64::MAX);
            let mut pieces = source.pieces.iter();
            let piece = pieces.find(|piece| piece.part(start, start + 1).is_some());
            let limit = piece.map_or(start, |piece| piece.address + piece.bytes.len() as u64);
            let end = if size == 0 {
                next.min(limit)
            } else {
                start + size
            };
            places.insert(start, (end, index));
            self.functions.push(Function {
                names,
                bounded: true,
                ..Function::default()
            });
        }
        places
    }

    /// What the linker puts in between where a call does not reach far enough calls the
    /// function that it is named after, and nothing else. Who calls it calls that function.
    fn pass_veneers(&mut self) {
        let mut behind = BTreeMap::new();
        for index in 0..self.functions.len() {
            let name = self.functions[index].name();
            let Some(name) = behind_veneer(name) else {
                continue;
            };
            let name = readable(name);
            let target = self
                .functions
                .iter()
                .position(|function| function.names.contains(&name));
            let diverges = target.is_some_and(|target| self.functions[target].diverges);
            self.functions[index].diverges = diverges;
            self.functions[index].calls = target.into_iter().collect();
            self.functions[index].indirect = 0;
            behind.extend(target.map(|target| (index, target)));
        }
        let calls = self.functions.iter_mut().flat_map(|of| &mut of.calls);
        for call in calls {
            *call = *behind.get(call).unwrap_or(call);
        }
    }

    /// The vector table: the stack, the start, then exceptions and interrupts
    /// (Armv7-M, B1.5.2).
    fn read_vectors(&mut self, pieces: &[Piece<'_>], places: &Places) -> Result<()> {
        let vectors = pieces.iter().find(|piece| piece.is_vectors);
        let vectors = vectors.context("the image has no section `.vector_table`")?;
        let end = vectors.address + vectors.bytes.len() as u64;
        let entries: Vec<Option<usize>> = vectors
            .words(vectors.address, end)
            .map(|word| at(places, word.value))
            .collect();
        self.reset = entries
            .get(1)
            .copied()
            .flatten()
            .context("the vector table names no function to start with")?;
        for (number, entry) in entries.iter().enumerate().skip(2) {
            let Some(index) = *entry else { continue };
            let is_default = self.functions[index]
                .names
                .iter()
                .any(|name| name == "DefaultHandler");
            if number <= 6 || is_default {
                self.faults.insert(index);
            } else {
                self.handlers.insert(index);
            }
        }
        Ok(())
    }
}

impl Function {
    /// Reads `code`, which lies at `address` in this function, which goes from one address
    /// to another.
    fn read_code(
        &mut self,
        mut code: &[u8],
        mut address: u64,
        (start, end): (u64, u64),
        places: &Places,
        values: &mut Vec<u64>,
    ) {
        // The upper half of an address is set after the lower one, in the same register.
        let mut low = [0; 16];
        while let Some((does, length)) = thumb::decode(code, address) {
            match does {
                Does::Jumps(to) if (start..end).contains(&to) => {}
                // The Cortex-M0+ has no other jump that reaches as far.
                Does::Calls(to) if start < to && to < end => {}
                Does::Calls(to) | Does::Jumps(to) => self.calls.extend(around(places, to)),
                Does::CallsSomewhere | Does::JumpsSomewhere => self.indirect += 1,
                Does::Pushes(bytes) => self.frame += bytes,
                Does::PushesSome => self.bounded = false,
                Does::SetsLow(register, value) => low[usize::from(register)] = value,
                Does::SetsHigh(register, value) => {
                    values.push(u64::from(value) << 16 | u64::from(low[usize::from(register)]));
                }
                Does::Returns | Does::Else => {}
            }
            code = &code[length..];
            address += length as u64;
        }
    }
}

/// How a function can end.
#[derive(Debug, Default, Clone)]
struct Ends {
    /// Its code was read.
    is_known: bool,
    /// It returns, or jumps where nothing says what is.
    returns: bool,
    /// It jumps to these functions, whose return is its own.
    jumps: Vec<usize>,
}

impl Ends {
    /// Reads `code`, as [`Function::read_code`] does.
    fn read(
        &mut self,
        mut code: &[u8],
        mut address: u64,
        (start, end): (u64, u64),
        places: &Places,
    ) {
        self.is_known = true;
        while let Some((does, length)) = thumb::decode(code, address) {
            match does {
                Does::Returns | Does::JumpsSomewhere => self.returns = true,
                Does::Jumps(to) if !(start..end).contains(&to) => match around(places, to) {
                    Some(index) => self.jumps.push(index),
                    None => self.returns = true,
                },
                _ => {}
            }
            code = &code[length..];
            address += length as u64;
        }
    }
}

/// Which functions return: by their own code, or by that of a function that they end in.
/// One of whose code nothing is known is taken to return.
fn returning(ends: &[Ends]) -> Vec<bool> {
    let returns = |function: &Ends| function.returns || !function.is_known;
    let mut returning: Vec<bool> = ends.iter().map(returns).collect();
    loop {
        let more: Vec<usize> = (0..ends.len())
            .filter(|index| !returning[*index])
            .filter(|index| ends[*index].jumps.iter().any(|to| returning[*to]))
            .collect();
        if more.is_empty() {
            return returning;
        }
        for index in more {
            returning[index] = true;
        }
    }
}

/// The function in which this address lies.
fn around(places: &Places, address: u64) -> Option<usize> {
    let (_, (end, index)) = places.range(..=address).next_back()?;
    (address < *end).then_some(*index)
}

/// The function that a veneer is named after: GNU's linker's, or LLVM's.
fn behind_veneer(name: &str) -> Option<&str> {
    let name = name.strip_prefix("__")?;
    let gnu = name.strip_suffix("_veneer");
    gnu.or_else(|| Some(name.split_once("LongThunk_")?.1))
}

/// The function that a pointer of this value points to.
fn at(places: &Places, value: u64) -> Option<usize> {
    let (_, index) = places.get(&value.checked_sub(1)?)?;
    (value & 1 == 1).then_some(*index)
}

impl<'file> Source<'file> {
    fn read(file: &read::File<'file>) -> Result<Self> {
        let mut pieces = Vec::new();
        for section in file.sections() {
            let SectionFlags::Elf { sh_flags, .. } = section.flags() else {
                continue;
            };
            let bytes = section.data().context("the image's code cannot be read")?;
            if sh_flags.contains(elf::SHF_ALLOC) && !bytes.is_empty() {
                pieces.push(Piece {
                    address: section.address(),
                    bytes,
                    is_vectors: section.name() == Ok(".vector_table"),
                    is_variable: sh_flags.contains(elf::SHF_WRITE),
                });
            }
        }
        let symbols = file.symbols().filter(|symbol| !symbol.is_undefined());
        let symbols = symbols.filter_map(|symbol| {
            Some(Symbol {
                name: symbol.name().ok()?,
                // The lowest bit of a function's address says "Thumb code".
                address: symbol.address() & !1,
                size: symbol.size(),
                is_function: symbol.kind() == SymbolKind::Text,
            })
        });
        let stack_sizes = file.section_by_name(".stack_sizes").context(
            "the image has no section `.stack_sizes`: `cargo xtask firmware` makes one that has",
        )?;
        Ok(Self {
            pieces,
            symbols: symbols.collect(),
            stack_sizes: stack_sizes.data()?,
        })
    }
}

/// A symbol as one writes it, without the hash, which changes from build to build.
pub(crate) fn readable(symbol: &str) -> String {
    format!("{:#}", rustc_demangle::demangle(symbol))
}

/// Where code begins (`true`) and where data does.
type Ranges = BTreeMap<u64, bool>;

fn ranges(source: &Source<'_>) -> Ranges {
    // What no symbol marks is data.
    let starts = source.pieces.iter().map(|piece| (piece.address, false));
    let marks = source
        .symbols
        .iter()
        .filter_map(|symbol| match symbol.name.split('.').next()? {
            "$t" => Some((symbol.address, true)),
            "$d" => Some((symbol.address, false)),
            _ => None,
        });
    starts.chain(marks).collect()
}

/// The ranges of code from `start` to `end`.
fn code_within(ranges: &Ranges, start: u64, end: u64) -> Vec<(u64, u64)> {
    let before = ranges
        .range(..=start)
        .next_back()
        .map(|(_, is_code)| *is_code);
    let mut found = Vec::new();
    let (mut from, mut is_code) = (start, before.unwrap_or(false));
    for (at, next_is_code) in ranges.range(start + 1..end.max(start + 1)) {
        if is_code {
            found.push((from, *at));
        }
        (from, is_code) = (*at, *next_is_code);
    }
    if is_code {
        found.push((from, end));
    }
    found
}

/// Every word of data, but for the vector table: its functions are the processor's to call.
fn data(pieces: &[Piece<'_>], ranges: &Ranges) -> Vec<DataWord> {
    let mut found = Vec::new();
    for piece in pieces.iter().filter(|piece| !piece.is_vectors) {
        let end = piece.address + piece.bytes.len() as u64;
        let mut from = piece.address;
        for (code_start, code_end) in code_within(ranges, piece.address, end) {
            found.extend(piece.words(from, code_start));
            from = code_end;
        }
        found.extend(piece.words(from, end));
    }
    found
}

/// What the compiler says that each function takes of the stack: pairs of an address and a
/// LEB128 number (LLVM, *Extensions*, "Emitting function stack size information").
fn stack_sizes(mut bytes: &[u8]) -> Result<BTreeMap<u64, u32>> {
    let mut sizes = BTreeMap::new();
    while let Some((address, rest)) = bytes.split_first_chunk::<4>() {
        let length = rest.iter().position(|byte| byte & 0x80 == 0);
        let length = length.context("section `.stack_sizes` ends in the middle of a number")? + 1;
        let size = rest[..length]
            .iter()
            .rfold(0_u32, |size, byte| size << 7 | u32::from(byte & 0x7F));
        sizes.insert(u64::from(u32::from_le_bytes(*address)) & !1, size);
        bytes = &rest[length..];
    }
    Ok(sizes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(halfwords: &[u16]) -> Vec<u8> {
        halfwords
            .iter()
            .flat_map(|half| half.to_le_bytes())
            .collect()
    }

    fn symbol(name: &str, address: u64, size: u64) -> Symbol<'_> {
        let is_function = !name.starts_with('$');
        Symbol {
            name,
            address,
            size,
            is_function,
        }
    }

    /// Calls, jumps that leave a function and those that stay, pointers in data and in pairs of
    /// moves, prologues where the compiler is silent, and the vector table.
    #[test]
    fn image_by_hand() {
        let code = bytes(&[
            0xB510, 0xF000, 0xF80D, 0xE7FC, // 100 start: push; bl 120; b 102
            0x4718, 0xBF00, 0x0131, 0x0000, // 108 bx r3; nop; the address of 130
            0xF240, 0x1041, 0xF2C0, 0x0000, // 110 movw r0, 0x141; movt r0, 0
            0x4770, 0xBF00, 0xBF00, 0xBF00, // 118 bx lr
            0xB082, 0xF000, 0xB806, 0xBF00, // 120 leaf: sub sp, 8; b.w 132
            0x4770, 0xBF00, 0xBF00, 0xBF00, 0xBF00, 0x44BD, 0x4770,
            0xBF00, // 130 other: nop; add sp, r7; bx lr
            0xBF00, 0xBF00, 0xBF00, 0xBF00, 0xBF00, 0x4770, 0xBF00, 0xBF00, // 140 handler
        ]);
        let vectors: Vec<u8> = [
            0x2000_0000,
            0x101,
            0x121,
            0,
            0,
            0,
            0,
            0,
            0x131,
            0x121,
            0x141,
        ]
        .iter()
        .flat_map(|word: &u32| word.to_le_bytes())
        .collect();
        let source = Source {
            pieces: vec![
                Piece {
                    address: 0,
                    bytes: &vectors,
                    is_vectors: true,
                    is_variable: false,
                },
                Piece {
                    address: 0x100,
                    bytes: &code,
                    is_vectors: false,
                    is_variable: false,
                },
            ],
            symbols: vec![
                symbol("$t", 0x100, 0),
                symbol("$d.1", 0x10C, 0),
                symbol("$t.2", 0x110, 0),
                symbol("start", 0x100, 0x20),
                symbol("leaf", 0x120, 0x10),
                symbol("other", 0x130, 0),
                symbol("DefaultHandler", 0x130, 0),
                symbol("handler", 0x140, 8),
            ],
            // start takes 0x88 bytes: two bytes of LEB128.
            stack_sizes: &[0, 1, 0, 0, 0x88, 0x01],
        };
        let program = LinkedProgram::of(&source).unwrap();
        let function =
            |names: &[&str], frame, bounded, calls: &[usize], pointers: &[usize]| Function {
                names: names.iter().map(|name| (*name).to_owned()).collect(),
                frame,
                bounded,
                calls: calls.to_vec(),
                indirect: u32::from(!pointers.is_empty()),
                diverges: false,
                pointers: pointers.iter().copied().collect(),
            };
        assert_eq!(
            program.functions,
            [
                function(&["start"], 0x88, true, &[1], &[2, 3]),
                function(&["leaf"], 8, true, &[2], &[]),
                function(&["other", "DefaultHandler"], 0, false, &[], &[]),
                function(&["handler"], 0, true, &[], &[]),
            ]
        );
        assert_eq!(program.loose, BTreeSet::new());
        assert_eq!(program.reset, 0);
        // Vector 2 is the processor's own; the default handler is no one's.
        assert_eq!(program.faults, BTreeSet::from([1, 2]));
        assert_eq!(program.handlers, BTreeSet::from([1, 3]));
    }

    /// A function diverges whose code has no way back, nor that of what it ends in.
    #[test]
    fn no_way_back() {
        let code = bytes(&[
            0xB510, 0xF000, 0xF806, 0xDEFE, // 100 fails: push; bl 114; udf
            0xE7FA, 0xBF00, 0xBF00, 0xBF00, // 108 passes_on: b 100
            0xE000, 0xBF00, 0xBD10, 0xBF00, // 110 ends_well: b 114; nop; pop {r4, pc}
            0xE7FA, 0xBF00, // 118 passes_back: b 110
        ]);
        let vectors: Vec<u8> = [0x2000_0000_u32, 0x101]
            .iter()
            .flat_map(|word| word.to_le_bytes())
            .collect();
        let piece = |address, bytes, is_vectors| Piece {
            address,
            bytes,
            is_vectors,
            is_variable: false,
        };
        let source = Source {
            pieces: vec![piece(0, &vectors, true), piece(0x100, &code, false)],
            symbols: vec![
                symbol("$t", 0x100, 0),
                symbol("fails", 0x100, 8),
                symbol("passes_on", 0x108, 8),
                symbol("ends_well", 0x110, 8),
                symbol("passes_back", 0x118, 4),
            ],
            stack_sizes: &[],
        };
        let program = LinkedProgram::of(&source).unwrap();
        let diverges: Vec<bool> = program.functions.iter().map(|it| it.diverges).collect();
        assert_eq!(diverges, [true, true, false, false]);
    }

    /// A size cut off in the middle is not read as a smaller one.
    #[test]
    fn torn_stack_sizes() {
        assert!(stack_sizes(&[0, 1, 0, 0, 0x88]).is_err());
        assert_eq!(
            stack_sizes(&[1, 1, 0, 0, 8]).unwrap(),
            BTreeMap::from([(0x100, 8)])
        );
    }

    /// The linker's go-between leads to the function of its name, not to any function.
    #[test]
    fn veneer() {
        let named = |name: &str| Function {
            names: vec![name.to_owned()],
            indirect: 1,
            ..Function::default()
        };
        let mut program = LinkedProgram {
            functions: vec![
                named("__far_veneer"),
                named("far"),
                named("__Thumbv6MABSLongThunk_far"),
                Function {
                    calls: vec![2, 0, 1],
                    ..named("caller")
                },
            ],
            ..LinkedProgram::default()
        };
        program.pass_veneers();
        assert_eq!(program.functions[0].calls, [1]);
        assert_eq!(program.functions[2].calls, [1]);
        assert_eq!(program.functions[3].calls, [1, 1, 1]);
        assert_eq!(
            (program.functions[0].indirect, program.functions[1].indirect),
            (0, 1)
        );
    }
}
