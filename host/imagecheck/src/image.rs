//! The figures of a linked firmware image.

use std::collections::BTreeMap;

use anyhow::{Context as _, Result, ensure};
use object::elf::{SHF_ALLOC, SHF_WRITE};
use object::{Object as _, ObjectSection as _, ObjectSymbol as _, SectionFlags, read};

use crate::load;
use crate::program::{LinkedProgram, readable};
use crate::reach::{self, EntryKind, EntryPanics};
use crate::stack::{self, Level, StackNeed};

/// What must be in one memory, because the rest of the image counts on it.
#[derive(Debug, Clone, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlacedVariables {
    /// The image that it is said of.
    pub image: String,
    /// The memory's name.
    pub memory: String,
    /// Its first address, and the one behind its last.
    pub addresses: [u64; 2],
    /// What must be there: names as they end (`axes::STATE`).
    pub names: Vec<String>,
}

/// What of it is elsewhere, or is not in the image at all.
pub fn misplaced(bytes: &[u8], placed: &[PlacedVariables]) -> Result<Vec<String>> {
    let file = read::File::parse(bytes).context("the image is no object file")?;
    let symbols: Vec<_> = file
        .symbols()
        .filter_map(|symbol| {
            Some((
                readable(symbol.name().ok()?),
                symbol.address(),
                symbol.size(),
            ))
        })
        .collect();
    Ok(misplaced_of(&symbols, placed))
}

fn misplaced_of(symbols: &[(String, u64, u64)], placed: &[PlacedVariables]) -> Vec<String> {
    let mut wrong = Vec::new();
    for PlacedVariables {
        memory,
        addresses: [from, to],
        names,
        ..
    } in placed
    {
        for name in names {
            let is = |(symbol, ..): &&(String, u64, u64)| {
                // Of a variable that the compiler has cut up, each piece has a number.
                let whole = symbol.trim_end_matches(|c: char| c == '.' || c.is_ascii_digit());
                [symbol.as_str(), whole].iter().any(|symbol| {
                    let head = symbol.strip_suffix(name.as_str());
                    head.is_some_and(|head| head.is_empty() || head.ends_with("::"))
                })
            };
            let found: Vec<_> = symbols.iter().filter(is).collect();
            if found.is_empty() {
                wrong.push(format!("`{name}`, which must be in {memory}, is not in it"));
            }
            for (symbol, address, size) in found {
                if *address < *from || address + size > *to {
                    wrong.push(format!(
                        "`{symbol}` must be in {memory}, and is at {address:#010x}"
                    ));
                }
            }
        }
    }
    wrong
}

/// The figures of an image.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct ImageFigures {
    /// What it puts into flash: code, constants, and the initial values of variables.
    pub flash_bytes: u64,
    /// Static variables, and code that runs from RAM: RAM without the stack.
    pub static_bytes: u64,
    /// The stack that each level of priority needs at worst; together, what it needs.
    pub stack: Vec<StackNeed>,
    /// What the variables leave for the stack.
    pub room_bytes: u64,
    /// Functions whose stack is not known to be all they take.
    pub unbounded: Vec<String>,
    /// Calls of the core library's panics, counted by the function that makes them.
    pub panics: BTreeMap<String, u32>,
    /// Those that each interrupt and each task can reach.
    pub reachable: Vec<EntryPanics>,
    /// The interrupts that can log other than by a panic, and the log's function: there may be none.
    pub logging: BTreeMap<String, String>,
}

impl ImageFigures {
    /// Reads an ELF file for Arm, whose levels of priority are these.
    pub fn read(bytes: &[u8], levels: &[Level], has_fpu: bool) -> Result<Self> {
        let file = read::File::parse(bytes).context("the image is no object file")?;
        let program = LinkedProgram::read(&file)?;
        hold_no_heap(&program)?;
        let unbounded = program
            .functions
            .iter()
            .filter(|function| !function.bounded);
        let flash = load::parts(bytes)?
            .iter()
            .map(|part| part.bytes.len() as u64)
            .sum();
        Ok(Self {
            flash_bytes: flash,
            static_bytes: static_bytes(&file),
            stack: stack::needs(&program, levels, has_fpu)?,
            room_bytes: room(&file)?,
            unbounded: unbounded
                .map(|function| function.name().to_owned())
                .collect(),
            panics: panics(&program),
            reachable: reach::panics(&program)?,
            logging: reach::logging(&program)?,
        })
    }

    /// The stack that it needs at worst.
    pub fn stack_bytes(&self) -> u64 {
        self.stack.iter().map(|need| need.bytes).sum()
    }

    /// All calls of panics.
    pub fn panic_calls(&self) -> u32 {
        self.panics.values().sum()
    }

    /// Calls of panics that an interrupt can reach, one by one for each interrupt.
    pub fn interrupt_panic_calls(&self) -> u32 {
        let is_interrupt = |entry: &&EntryPanics| entry.kind == EntryKind::Interrupt;
        let entries = self.reachable.iter().filter(is_interrupt);
        entries.map(EntryPanics::count).sum()
    }

    /// Calls of panics in functions of this project, as opposed to libraries.
    pub fn own_panic_calls(&self) -> u32 {
        let ours = |name: &str| name.trim_start_matches(['<', '&', '[']).starts_with("umi_");
        let own = self.panics.iter().filter(|(name, _)| ours(name));
        own.map(|(_, calls)| calls).sum()
    }
}

/// Where an Arm processor has its RAM (Armv6-M and Armv7-M, B3.1).
const RAM: std::ops::Range<u64> = 0x2000_0000..0x4000_0000;

fn static_bytes(file: &read::File<'_>) -> u64 {
    let is_variables = |flags| match flags {
        SectionFlags::Elf { sh_flags, .. } => sh_flags.contains(SHF_ALLOC | SHF_WRITE),
        _ => false,
    };
    let is_code = |flags| match flags {
        SectionFlags::Elf { sh_flags, .. } => sh_flags.contains(SHF_ALLOC),
        _ => false,
    };
    let sections = file.sections().filter(|section| {
        is_variables(section.flags())
            || is_code(section.flags()) && RAM.contains(&section.address())
    });
    sections.map(|section| section.size()).sum()
}

/// From where the stack starts down to where the linker's script lets it end.
fn room(file: &read::File<'_>) -> Result<u64> {
    let address = |name: &str| {
        let symbol = file.symbols().find(|symbol| symbol.name() == Ok(name));
        let symbol = symbol.with_context(|| format!("the image has no symbol `{name}`"))?;
        anyhow::Ok(symbol.address())
    };
    Ok(address("_stack_start")?.saturating_sub(address("_stack_end")?))
}

/// Without an allocator nothing can ask for a heap: it does not link.
fn hold_no_heap(program: &LinkedProgram) -> Result<()> {
    let allocates = |name: &&str| name.contains("__rust_alloc") || name.contains("__rg_alloc");
    let found = program
        .functions
        .iter()
        .map(|function| function.name())
        .find(allocates);
    ensure!(
        found.is_none(),
        "the image has a heap: it links `{}`",
        found.unwrap_or_default()
    );
    Ok(())
}

fn panics(program: &LinkedProgram) -> BTreeMap<String, u32> {
    let mut panics = BTreeMap::new();
    for caller in &program.functions {
        let calls = caller.panic_calls(program);
        if calls > 0 {
            *panics.entry(caller.name().to_owned()).or_default() += calls;
        }
    }
    panics
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::program::Function;

    /// A call of a panic counts for its caller; a panic's own calls do not.
    #[test]
    fn panics_count_for_their_callers() {
        let function = |name: &str, calls: &[usize]| Function {
            names: vec![name.to_owned()],
            calls: calls.to_vec(),
            ..Function::default()
        };
        let program = LinkedProgram {
            functions: vec![
                function("umi_core::fit", &[1, 1, 2]),
                function("core::panicking::panic_fmt", &[2]),
                function("core::panicking::panic", &[]),
                function("heapless::push", &[2, 0]),
                function("__Thumbv6MABSLongThunk_panic", &[2]),
            ],
            ..LinkedProgram::default()
        };
        let figures = ImageFigures {
            panics: panics(&program),
            ..ImageFigures::default()
        };
        assert_eq!((figures.panic_calls(), figures.own_panic_calls()), (4, 3));
    }

    /// Ours is what our crates define, for whatever type.
    #[test]
    fn own_panics() {
        let figures = ImageFigures {
            panics: BTreeMap::from([
                ("<umi_core::fit::Ball as core::ops::Add>::add".to_owned(), 2),
                ("<[umi_core::fit::Ball]>::sort".to_owned(), 4),
                ("core::slice::sort::<umi_core::fit::Ball>".to_owned(), 8),
            ]),
            ..ImageFigures::default()
        };
        assert_eq!((figures.panic_calls(), figures.own_panic_calls()), (14, 6));
    }

    /// What is elsewhere is named with where it is, and so is what is not there; a name that only
    /// ends alike is another's.
    #[test]
    fn misplaced_ones_are_named() {
        let symbol = |name: &str, address| (name.to_owned(), address, 8);
        let symbols = [
            symbol("umi_x::axes::STATE", 0x2000_0000),
            symbol("_stack_end", 0x2001_FFF8),
            symbol("umi_x::OTHER_STATE", 0x2400_0000),
            symbol("umi_x::axes::LINE.0", 0x2000_0008),
            symbol("umi_x::axes::LINE.12", 0x2400_0008),
        ];
        let placed = |names: &[&str]| PlacedVariables {
            image: "board".to_owned(),
            memory: "the DTCM".to_owned(),
            addresses: [0x2000_0000, 0x2002_0000],
            names: names.iter().map(|name| (*name).to_owned()).collect(),
        };
        let of = |names: &[&str]| misplaced_of(&symbols, &[placed(names)]);
        assert!(of(&["STATE", "_stack_end"]).is_empty());
        let [elsewhere] = &of(&["OTHER_STATE"])[..] else {
            panic!("one is elsewhere")
        };
        assert!(elsewhere.ends_with("is at 0x24000000"), "{elsewhere}");
        assert_eq!(of(&["axes::CLOCK"]).len(), 1);
        let [piece] = &of(&["axes::LINE"])[..] else {
            panic!("one piece is elsewhere")
        };
        assert!(piece.contains("LINE.12"), "{piece}");
        let mut short = placed(&["_stack_end"]);
        short.addresses = [0x2000_0000, 0x2001_FFFC];
        assert_eq!(misplaced_of(&symbols, &[short]).len(), 1, "it sticks out");
    }

    /// An image that links an allocator is refused.
    #[test]
    fn heap_is_refused() {
        let mut program = LinkedProgram::default();
        assert!(hold_no_heap(&program).is_ok());
        program.functions.push(Function {
            names: vec!["__rustc::__rust_alloc".into()],
            ..Function::default()
        });
        let error = hold_no_heap(&program).unwrap_err().to_string();
        assert!(error.contains("__rust_alloc"), "{error}");
    }
}
