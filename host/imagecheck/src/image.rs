//! The figures of a linked firmware image.

use std::collections::BTreeMap;

use anyhow::{Context as _, Result, ensure};
use object::elf::{SHF_ALLOC, SHF_WRITE};
use object::{Object as _, ObjectSection as _, ObjectSymbol as _, SectionFlags, read};

use crate::load;
use crate::program::LinkedProgram;
use crate::reach::{self, EntryKind, EntryPanics};
use crate::stack::{self, Level, StackNeed};

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
