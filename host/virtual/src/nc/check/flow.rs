//! Findings from the order of blocks and from calls.

use std::collections::{BTreeMap, BTreeSet};

use crate::nc::memory::alarm::Fault;
use crate::nc::memory::settings::{ControlFamily, ControlSettings};
use crate::nc::text::block::{Block, Statement, Word};
use crate::nc::text::evaluate::whole;
use crate::nc::text::program::Program;

/// A fault with its line and the line's text.
pub(super) type Found<'a> = (u32, &'a str, Fault);

/// Who calls whom in a text.
pub(super) struct Calls {
    /// What a program calls: whether as a macro, and which one.
    of: BTreeMap<u32, Vec<(bool, u32)>>,
    called: BTreeSet<u32>,
    /// The depths that are known: of subprograms, of macros.
    depths: [BTreeMap<u32, Option<usize>>; 2],
}

impl Calls {
    pub fn new(programs: &[Program]) -> Self {
        let of: BTreeMap<u32, Vec<(bool, u32)>> = programs
            .iter()
            .map(|program| {
                let calls = program.blocks.iter().filter_map(call);
                let mut calls: Vec<_> = calls.filter_map(|(is, p)| Some((is, p?))).collect();
                calls.sort_unstable();
                calls.dedup();
                (program.number, calls)
            })
            .collect();
        Self {
            called: of.values().flatten().map(|(_, p)| *p).collect(),
            of,
            depths: Default::default(),
        }
    }

    /// The longest chain of calls of one kind from a program on; a call of a program that
    /// is on the chain already is not followed.
    // The depth is bounded by the number of programs in memory.
    fn depth(&mut self, from: u32, of_macros: bool) -> usize {
        let [subprograms, macros] = &mut self.depths;
        let known = if of_macros { macros } else { subprograms };
        match known.get(&from) {
            Some(depth) => return depth.unwrap_or(0),
            None => known.insert(from, None),
        };
        let mut longest = 0;
        for (is_macro, to) in self.of.get(&from).cloned().unwrap_or_default() {
            let below = self.depth(to, of_macros);
            longest = longest.max(below + usize::from(is_macro == of_macros));
        }
        let [subprograms, macros] = &mut self.depths;
        let known = if of_macros { macros } else { subprograms };
        known.insert(from, Some(longest));
        longest
    }
}

/// What is wrong with a program as a whole.
pub(super) fn faults<'a>(
    calls: &mut Calls,
    program: &'a Program,
    settings: &ControlSettings,
) -> Vec<Found<'a>> {
    if !settings.dialect.is_macro_b() {
        return Vec::new();
    }
    let mut found = printing(program, settings.dialect);
    found.extend(nesting(calls, program, settings));
    found
}

/// The value of a word that stands in a block as a number.
fn number(words: &[Word], letter: u8) -> Option<u32> {
    words
        .iter()
        .find(|word| word.letter == letter)
        .and_then(|word| word.value.constant())
        .and_then(|value| whole(value, 99_999_999))
}

fn words(block: &Block) -> &[Word] {
    match &block.statement {
        Ok(Statement::Words(words, _)) => words,
        _ => &[],
    }
}

/// A call: whether of a macro, and of which program.
fn call(block: &Block) -> Option<(bool, Option<u32>)> {
    let words = words(block);
    match (number(words, b'G'), number(words, b'M')) {
        (Some(65 | 66), _) => Some((true, number(words, b'P'))),
        (_, Some(98)) => Some((false, number(words, b'P'))),
        _ => None,
    }
}

/// Warns where a main program (one that ends with M2 or M30) prints before `POPEN`, or
/// opens the line and does not close it, as its blocks stand. What it calls may do both.
fn printing(program: &Program, dialect: ControlFamily) -> Vec<Found<'_>> {
    let mut found = Vec::new();
    let ends_with = |codes: &[u32]| {
        let mut codes_given = program.blocks.iter().filter_map(|b| number(words(b), b'M'));
        codes_given.any(|m| codes.contains(&m))
    };
    let is_main = ends_with(&[2, 30]) && !ends_with(&[99]);
    // Haas: the line is always open.
    if !is_main || dialect == ControlFamily::Haas {
        return found;
    }
    let (mut is_open, mut may_be_open) = (None, false);
    for block in &program.blocks {
        match &block.statement {
            Ok(Statement::Open) => is_open = Some(block),
            // The line stays open for what comes by a jump.
            Ok(Statement::Close) => {
                is_open = None;
                may_be_open = true;
            }
            Ok(Statement::Print(_)) if is_open.is_none() && !may_be_open => {
                found.push((
                    block.line,
                    block.text.as_str(),
                    Fault::warning("no POPEN before it in this program: the line is not open"),
                ));
                may_be_open = true;
            }
            _ if call(block).is_some() => {
                may_be_open = true;
                is_open = None;
            }
            _ => {}
        }
    }
    if let Some(block) = is_open {
        found.push((
            block.line,
            block.text.as_str(),
            Fault::warning("no PCLOS behind it in this program: the line stays open"),
        ));
    }
    found
}

/// Warns where a call leads deeper than the control nests, if every call on the way runs.
/// Calls are followed from programs that nobody in the text calls.
fn nesting<'a>(
    calls: &mut Calls,
    program: &'a Program,
    settings: &ControlSettings,
) -> Vec<Found<'a>> {
    let mut found = Vec::new();
    if calls.called.contains(&program.number) {
        return found;
    }
    for block in &program.blocks {
        let Some((is_macro, Some(to))) = call(block) else {
            continue;
        };
        for of_macros in [true, false] {
            let depth = calls.depth(to, of_macros) + usize::from(is_macro == of_macros);
            let (most, what) = if of_macros {
                (settings.limits.macro_depth, "macros")
            } else {
                (settings.limits.call_depth, "subprograms")
            };
            if depth > most {
                found.push((
                    block.line,
                    block.text.as_str(),
                    Fault::warning(format!(
                        "this call may lead {depth} {what} deep: the control takes {most}"
                    )),
                ));
            }
        }
    }
    found
}
