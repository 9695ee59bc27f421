//! Which panics an interrupt or a task can reach, and which interrupts can log.
//!
//! # Design
//!
//! From each handler of the vector table, along the calls of [`crate::stack`]: what the code calls,
//! and through a pointer every waker, as handlers of drivers call no others. An executor's handler
//! is taken without the tasks that it runs; each of these is an entry of its own, with the pointers
//! that its code knows. A panic's own calls are part of it.
//!
//! A log waits, with interrupts held off, until whoever else logs is done, and under a debug probe
//! for the probe: so no handler may call the log's code, but through a panic, whose outputs are off
//! before it logs.
//!
//! # Limitations
//!
//! Those of the stack's calls. A call that the compiler has proven never to happen is not in the
//! code; one that never happens for a reason that only a person knows is, and counts.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::Result;

use crate::program::{Function, LinkedProgram};
use crate::stack::{Graph, is_task, is_waker, known};

/// What begins outside of the thread, or is run by an executor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EntryKind {
    /// A handler of the vector table.
    Interrupt,
    /// A task of an executor.
    Task,
}

/// The panics that an entry can reach.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EntryPanics {
    /// Which kind.
    pub kind: EntryKind,
    /// The handler's name, or the task's.
    pub name: String,
    /// Calls of panics, by the function that makes them.
    pub calls: BTreeMap<String, u32>,
}

impl EntryPanics {
    /// All calls of panics.
    pub fn count(&self) -> u32 {
        self.calls.values().sum()
    }
}

/// The panics of all handlers and tasks, each for itself: one may count for several.
pub fn panics(program: &LinkedProgram) -> Result<Vec<EntryPanics>> {
    let functions = &program.functions;
    let pointed = program.pointed();
    let wakers = wakers(program);
    let always = &known(program, &[program.reset], &program.loose) | &wakers;
    let mut entries = Vec::new();
    for handler in &program.handlers {
        entries.push(EntryPanics {
            kind: EntryKind::Interrupt,
            name: functions[*handler].name().to_owned(),
            calls: reached(program, *handler, &wakers)?,
        });
    }
    for task in pointed.iter().filter(|index| is_task(&functions[**index])) {
        entries.push(EntryPanics {
            kind: EntryKind::Task,
            name: task_name(&functions[*task]),
            calls: reached(program, *task, &known(program, &[*task], &always))?,
        });
    }
    entries.sort_by(|a, b| (a.kind, &a.name).cmp(&(b.kind, &b.name)));
    Ok(entries)
}

/// The handlers that can log, and the first function of the log that each reaches, without what a
/// panic says.
pub fn logging(program: &LinkedProgram) -> Result<BTreeMap<String, String>> {
    let functions = &program.functions;
    let wakers = wakers(program);
    let mut found = BTreeMap::new();
    for handler in &program.handlers {
        let graph = Graph::new(program, &[*handler], &[], &wakers)?;
        let behind = graph.functions_until(*handler, |index| functions[index].is_panic());
        let log = behind.into_iter().find(|index| is_log(&functions[*index]));
        if let Some(log) = log {
            let handler = functions[*handler].name().to_owned();
            found.insert(handler, functions[log].name().to_owned());
        }
    }
    Ok(found)
}

/// Whether it is code of defmt or of what carries its bytes away.
fn is_log(function: &Function) -> bool {
    function.names.iter().any(|name| name.contains("defmt"))
}

/// What drivers' handlers call through pointers.
fn wakers(program: &LinkedProgram) -> BTreeSet<usize> {
    let is_waker = |index: &usize| is_waker(&program.functions[*index]);
    program.pointed().into_iter().filter(is_waker).collect()
}

/// The calls of panics behind a function.
fn reached(
    program: &LinkedProgram,
    start: usize,
    known: &BTreeSet<usize>,
) -> Result<BTreeMap<String, u32>> {
    let graph = Graph::new(program, &[start], &[], known)?;
    let mut calls = BTreeMap::new();
    for index in graph.functions_behind(start) {
        let function = &program.functions[index];
        let panics = function.panic_calls(program);
        if panics > 0 {
            *calls.entry(function.name().to_owned()).or_default() += panics;
        }
    }
    Ok(calls)
}

/// `measure_on` of `<embassy_executor::raw::TaskStorage<umi_pico::__measure_on_task::...>>::poll`.
fn task_name(function: &Function) -> String {
    let name = function.name();
    let inner = name
        .split_once("::__")
        .and_then(|(_, rest)| rest.split_once("_task::"));
    inner.map_or(name, |(task, _)| task).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: usize = 0;
    const DRIVER: usize = 1;
    const EXECUTOR: usize = 2;
    const TASK: usize = 3;
    const WAKE: usize = 4;
    const PUSH: usize = 5;
    const PANIC: usize = 6;
    const HELPER: usize = 7;
    const DEEPER: usize = 8;

    /// A driver's handler that wakes a task, and an executor's that runs it.
    fn program() -> LinkedProgram {
        let function = |name: &str, calls: &[usize], indirect, pointers: &[usize]| Function {
            names: vec![name.to_owned()],
            frame: 8,
            bounded: true,
            calls: calls.to_vec(),
            indirect,
            diverges: false,
            pointers: pointers.iter().copied().collect(),
        };
        LinkedProgram {
            functions: vec![
                function("main", &[], 0, &[TASK, HELPER]),
                function("UART_IRQ", &[PUSH], 1, &[]),
                function("embassy_executor::raw::Executor::poll", &[], 1, &[WAKE]),
                function(
                    "<embassy_executor::raw::TaskStorage<umi_x::__measure_task::F>>::poll",
                    &[PUSH, PANIC],
                    1,
                    &[HELPER],
                ),
                function(
                    "embassy_executor::raw::waker::wake",
                    &[PANIC, PANIC],
                    0,
                    &[],
                ),
                function("umi_x::push", &[PANIC], 0, &[]),
                function("core::panicking::panic", &[DEEPER], 0, &[]),
                function("umi_x::helper", &[PANIC, DEEPER], 0, &[]),
                function("core::panicking::panic_fmt", &[], 0, &[]),
            ],
            reset: START,
            handlers: [DRIVER, EXECUTOR].into(),
            ..LinkedProgram::default()
        }
    }

    fn counts() -> Vec<(EntryKind, String, u32)> {
        let entries = panics(&program()).unwrap().into_iter();
        entries
            .map(|e| (e.kind, e.name.clone(), e.count()))
            .collect()
    }

    /// A driver reaches what it calls and the wakers, and no task; an executor's handler does not
    /// count its tasks; a task has what its pointers lead to.
    #[test]
    fn each_entry_has_its_own() {
        let of = |kind, name: &str, count| (kind, name.to_owned(), count);
        assert_eq!(
            counts(),
            [
                of(EntryKind::Interrupt, "UART_IRQ", 3),
                of(
                    EntryKind::Interrupt,
                    "embassy_executor::raw::Executor::poll",
                    2
                ),
                of(EntryKind::Task, "measure", 6),
            ]
        );
    }

    /// A handler that comes to the log by its own calls or by a waker is named, with the log's
    /// function; one that comes there only by a panic, or an executor's by its tasks, is not.
    #[test]
    fn handlers_that_log_are_named() {
        let mut program = program();
        let log = program.functions.len();
        program.functions.push(Function {
            names: vec!["_defmt_acquire".to_owned()],
            bounded: true,
            ..Function::default()
        });
        program.functions[PANIC].calls.push(log);
        program.functions[TASK].calls.push(log);
        assert!(logging(&program).unwrap().is_empty());
        program.functions[PUSH].calls.push(log);
        let named = |handler: &str| (handler.to_owned(), "_defmt_acquire".to_owned());
        assert_eq!(logging(&program).unwrap(), [named("UART_IRQ")].into());
        program.functions[PUSH].calls.pop();
        program.functions[WAKE].calls.push(log);
        let both = [
            named("UART_IRQ"),
            named("embassy_executor::raw::Executor::poll"),
        ];
        assert_eq!(logging(&program).unwrap(), both.into());
    }

    /// It says in whose code they are.
    #[test]
    fn they_are_named() {
        let entries = panics(&program()).unwrap();
        let driver = &entries[0].calls;
        assert_eq!(driver["umi_x::push"], 1);
        assert_eq!(driver["embassy_executor::raw::waker::wake"], 2);
    }
}
