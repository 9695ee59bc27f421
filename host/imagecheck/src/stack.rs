//! How much stack an image can need at worst.
//!
//! # Design
//!
//! The longest chain of calls from the start of the program, and on top of it that of each
//! level of interrupts, since one can come at the worst moment of the one below. A chain is
//! as long as the frames of its functions together.
//!
//! Where a pointer is called, the code does not say what is: then it is whichever function of
//! its kind needs most, of all to which there are pointers. There are three kinds:
//!
//! - tasks of the executor (`TaskStorage::poll`): called from outside of tasks only, from the
//!   level that [`Level`] says, and there by the executor only: by its functions, or by the
//!   handler or `main` itself, into which they may have been inlined;
//! - formatting (`core::fmt` and what implements its traits): called by formatting only;
//! - all others: called from anywhere but formatting, in the levels whose code knows the
//!   pointer: it or the data it points to has it, or start-up has, or a variable. Besides these
//!   there are the executor's wakers. A level without tasks is one of drivers, and calls no
//!   others than wakers through pointers.
//!
//! A level of tasks that begins only when a part of the thread has returned ([`Level::after`]) is
//! never on top of that part: its stack and theirs exclude each other.
//!
//! Calls that go round through pointers count each of their functions once. A panic can come
//! at the worst moment too, so it is a level of its own; that it panics itself is left out. So
//! is a ring of calls of which every function is the core library's and none ever returns: who
//! enters it panics, and goes round only by a panic within that panic. Any other ring in the
//! code itself is an error, unless `RECURSIONS` says how often it goes round.
//!
//! # Limitations
//!
//! What it cannot see: a pointer that one task hands to another of another level, unless it is
//! a waker; a number that looks like the middle of a table of pointers; a function that enters itself again through pointers is counted once;
//! assembly that moves the stack pointer by a register (it is named); a handler of an interrupt
//! at a level that its board does not give it. Functions that end in a jump are counted as if
//! they called, and what excludes itself is added, so the true need is lower as a rule.

use std::collections::BTreeSet;

use anyhow::{Result, ensure};
use petgraph::algo::tarjan_scc;
use petgraph::graph::DiGraph;

use crate::program::{Function, LinkedProgram};

/// Recursions in the code itself, by how the names begin, and how often each can be on the
/// stack at once.
const RECURSIONS: [(&str, u32); 1] = [
    // Once more where the number is subnormal: then it has been scaled up.
    ("libm::math::frexp::frexp", 2),
];

/// What runs at one level of priority: its handlers never interrupt each other.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Level {
    /// The handlers, as the last parts of the names of their functions; `main` is what runs
    /// outside of interrupts.
    pub handlers: Vec<String>,
    /// The tasks that the executor of this level runs.
    #[serde(default)]
    pub tasks: Vec<String>,
    /// Functions of the thread that have returned before this level begins, by their whole names.
    #[serde(default)]
    pub after: Vec<String>,
}

/// The stack that a level needs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StackNeed {
    /// The bytes, with what the processor saves at an interrupt.
    pub bytes: u64,
    /// The longest chain, from its first function on, with the bytes of each.
    pub chain: Vec<(String, u64)>,
}

/// What an exception saves: eight words, with a floating-point unit 26, and a word more where
/// the stack was not aligned (Armv7-M, B1.5.7).
fn saved_bytes(has_fpu: bool) -> u64 {
    if has_fpu { 27 * 4 } else { 9 * 4 }
}

/// What each level needs, the thread's first; their sum is what the image needs.
///
/// Without `levels`, every handler can interrupt every other, and every level may run all
/// tasks.
pub fn needs(program: &LinkedProgram, levels: &[Level], has_fpu: bool) -> Result<Vec<StackNeed>> {
    let functions = &program.functions;
    let pointed = program.pointed();
    let all_tasks: Vec<usize> = pointed
        .iter()
        .copied()
        .filter(|index| is_task(&functions[*index]))
        .collect();
    let groups = group(program, levels, &all_tasks)?;
    let is_waker = |index: &usize| is_waker(&functions[*index]);
    let wakers: BTreeSet<usize> = pointed.iter().copied().filter(is_waker).collect();
    let start_up = known(program, &[program.reset], &program.loose);
    let always = &start_up | &wakers;
    let mut needs = Vec::new();
    // What the thread needs with what has returned before some level begins.
    let mut starts = Vec::new();
    for (
        level,
        Group {
            handlers,
            tasks,
            after,
        },
    ) in groups.iter().enumerate()
    {
        let start: Vec<usize> = handlers.iter().chain(tasks).copied().collect();
        let known = if tasks.is_empty() {
            wakers.clone()
        } else {
            known(program, &start, &always)
        };
        let mut graph = Graph::new(program, handlers, tasks, &known)?;
        if level == 0 {
            for index in groups.iter().flat_map(|group| &group.after) {
                starts.push(graph.worst(program, graph.start(handlers[0])));
                graph.cut(*index);
            }
        }
        let worst = handlers
            .iter()
            .map(|handler| graph.worst(program, graph.start(*handler)));
        let Some(mut need) = worst.max_by_key(|need| need.bytes) else {
            continue;
        };
        if level > 0 {
            let saved = saved_bytes(has_fpu);
            need.bytes += saved;
            need.chain.insert(0, ("(interrupt)".to_owned(), saved));
        }
        if let [_, ..] = after[..] {
            // On top of the thread alone: what comes before it must not need more than both.
            let both = needs.first().map_or(0, |thread: &StackNeed| thread.bytes) + need.bytes;
            let start = starts.iter().max_by_key(|start| start.bytes);
            ensure!(
                level == 1 && start.is_none_or(|start| start.bytes <= both),
                "the thread needs more before `{}` than with it: {both} bytes",
                functions[handlers[0]].name()
            );
        }
        needs.push(need);
    }
    Ok(needs)
}

/// Handlers and tasks of a level, and what of the thread has returned before it begins.
#[derive(Default)]
struct Group {
    handlers: Vec<usize>,
    tasks: Vec<usize>,
    after: Vec<usize>,
}

fn group(program: &LinkedProgram, levels: &[Level], all_tasks: &[usize]) -> Result<Vec<Group>> {
    let functions = &program.functions;
    let mut groups = Vec::new();
    if levels.is_empty() {
        let alone = [program.reset];
        groups.extend(alone.iter().chain(&program.handlers).map(|index| Group {
            handlers: vec![*index],
            tasks: all_tasks.to_vec(),
            after: Vec::new(),
        }));
    } else {
        let mut missing: Vec<&str> = Vec::new();
        let handles = |level: &Level, index| {
            level.handlers.iter().any(|name| {
                if index == program.reset {
                    name == "main"
                } else {
                    is_called(&functions[index], name)
                }
            })
        };
        let runs = |level: &Level, index: usize| {
            let names = &level.tasks;
            names.iter().any(|name| {
                functions[index]
                    .name()
                    .contains(&format!("::__{name}_task::"))
            })
        };
        let handlers = || program.handlers.iter().copied().chain([program.reset]);
        for level in levels {
            let handlers: Vec<usize> = handlers().filter(|index| handles(level, *index)).collect();
            let tasks = all_tasks.iter().copied();
            let mut group = Group {
                tasks: tasks.filter(|index| runs(level, *index)).collect(),
                ..Group::default()
            };
            for name in level.after.iter().filter(|_| !handlers.is_empty()) {
                let found = functions.iter().position(|of| of.names.contains(name));
                match found {
                    Some(index) => group.after.push(index),
                    None => missing.push(name),
                }
            }
            group.handlers = handlers;
            groups.push(group);
        }
        // The thread's level comes first: it is no interrupt.
        groups.sort_by_key(|group| !group.handlers.contains(&program.reset));
        for index in handlers() {
            if !groups.iter().any(|group| group.handlers.contains(&index)) {
                missing.push(functions[index].name());
            }
        }
        for index in all_tasks {
            if !groups.iter().any(|group| group.tasks.contains(index)) {
                missing.push(functions[*index].name());
            }
        }
        ensure!(
            missing.is_empty(),
            "no level in package.metadata.stack has: {}",
            missing.join(", ")
        );
    }
    let panics = (0..functions.len()).filter(|index| functions[*index].is_panic());
    groups.push(Group {
        handlers: panics.collect(),
        ..Group::default()
    });
    // Nothing comes after a fault.
    groups.push(Group {
        handlers: program.faults.iter().copied().collect(),
        ..Group::default()
    });
    Ok(groups)
}

pub(crate) fn is_task(function: &Function) -> bool {
    let name = function.name();
    name.starts_with("<embassy_executor::raw::TaskStorage<") && name.ends_with(">>::poll")
}

/// Whether it is the executor's, or the board's `main`, which may hold it.
fn runs_tasks(function: &Function) -> bool {
    let name = function.name();
    name.starts_with("embassy_executor::")
        || name.starts_with("<embassy_executor::")
        || name.ends_with("::__cortex_m_rt_main")
}

/// The functions to which code knows pointers that begins with these functions, or with what
/// it calls through them.
pub(crate) fn known(
    program: &LinkedProgram,
    start: &[usize],
    always: &BTreeSet<usize>,
) -> BTreeSet<usize> {
    let always = always
        .iter()
        .copied()
        .filter(|index| is_other(program, *index));
    let mut known: BTreeSet<usize> = always.collect();
    let mut reached = vec![false; program.functions.len()];
    let mut open: Vec<usize> = start.iter().chain(&known).copied().collect();
    while let Some(index) = open.pop() {
        if std::mem::replace(&mut reached[index], true) {
            continue;
        }
        let function = &program.functions[index];
        open.extend(&function.calls);
        for pointer in &function.pointers {
            if is_other(program, *pointer) {
                known.insert(*pointer);
                open.push(*pointer);
            }
        }
    }
    known
}

/// Whether it is neither formatting, nor called by the executor or the processor.
fn is_other(program: &LinkedProgram, index: usize) -> bool {
    let function = &program.functions[index];
    !is_formatting(function) && !is_task(function) && !program.handlers.contains(&index)
}

pub(crate) fn is_waker(function: &Function) -> bool {
    function
        .name()
        .starts_with("embassy_executor::raw::waker::")
}

fn is_formatting(function: &Function) -> bool {
    let name = function.name();
    name.starts_with("core::fmt::")
        || name.starts_with("<core::fmt::")
        || name.contains(" as core::fmt::")
}

/// Whether the last part of one of the function's names is `name`.
fn is_called(function: &Function, name: &str) -> bool {
    function.names.iter().any(|full| {
        full.strip_suffix(name)
            .is_some_and(|start| start.is_empty() || start.ends_with("::"))
    })
}

/// Who can call whom: every function once as called outside of tasks, once as called within,
/// and a node for each kind of pointer.
pub(crate) struct Graph {
    next: Vec<Vec<usize>>,
    weights: Vec<u64>,
    functions: usize,
}

impl Graph {
    pub(crate) fn new(
        program: &LinkedProgram,
        handlers: &[usize],
        tasks: &[usize],
        known: &BTreeSet<usize>,
    ) -> Result<Self> {
        let functions = &program.functions;
        let count = functions.len();
        let calls = calls(functions);
        let depths = depths(functions, &calls)?;
        let (formatting, others, polls) = (2 * count, 2 * count + 1, 2 * count + 2);
        let mut next = vec![Vec::new(); 2 * count + 3];
        let mut weights = vec![0; 2 * count + 3];
        for (index, function) in functions.iter().enumerate() {
            let weight = u64::from(function.frame) * u64::from(depths[index]);
            weights[index] = weight;
            weights[count + index] = weight;
            let (outside, within): (Vec<usize>, Vec<usize>) = calls[index]
                .iter()
                .map(|call| (count + call, *call))
                .unzip();
            next[count + index] = outside;
            next[index] = within;
            if function.indirect > 0 && is_formatting(function) {
                next[index].push(formatting);
                next[count + index].push(formatting);
            } else if function.indirect > 0 {
                next[index].push(others);
                next[count + index].push(others);
                if handlers.contains(&index) || runs_tasks(function) {
                    next[count + index].push(polls);
                }
            }
        }
        let pointed = program.pointed();
        next[formatting].extend(
            pointed
                .iter()
                .filter(|index| is_formatting(&functions[**index])),
        );
        next[others].extend(known.iter().filter(|index| is_other(program, **index)));
        next[polls].extend(tasks);
        let graph = Self {
            next,
            weights,
            functions: count,
        };
        let mut starts = handlers.iter().map(|handler| graph.start(*handler));
        ensure!(
            tasks.is_empty() || starts.any(|start| graph.leads(start, polls)),
            "nothing that runs tasks is called by `{}`, whose level has some",
            handlers
                .first()
                .map_or("no handler", |handler| functions[*handler].name())
        );
        Ok(graph)
    }

    /// Whether there is a way from one node to another.
    fn leads(&self, from: usize, to: usize) -> bool {
        self.reached(from, |_| false)[to]
    }

    /// To which nodes there is a way from one, itself with them, that ends at each of these.
    fn reached(&self, from: usize, is_end: impl Fn(usize) -> bool) -> Vec<bool> {
        let mut reached = vec![false; self.next.len()];
        let mut open = vec![from];
        while let Some(node) = open.pop() {
            if !std::mem::replace(&mut reached[node], true) && !is_end(node) {
                open.extend(&self.next[node]);
            }
        }
        reached
    }

    /// The functions that a function can call, by whatever way, and itself.
    pub(crate) fn functions_behind(&self, function: usize) -> BTreeSet<usize> {
        self.functions_until(function, |_| false)
    }

    /// The same, without what is only behind these.
    pub(crate) fn functions_until(
        &self,
        function: usize,
        is_end: impl Fn(usize) -> bool,
    ) -> BTreeSet<usize> {
        let is_end = |node| node < 2 * self.functions && is_end(node % self.functions);
        let reached = self.reached(self.start(function), is_end);
        let nodes = (0..2 * self.functions).filter(|node| reached[*node]);
        nodes.map(|node| node % self.functions).collect()
    }

    /// The node of a function with which a level starts: outside of tasks, if it has any.
    fn start(&self, function: usize) -> usize {
        if self.next[2 * self.functions + 2].is_empty() {
            function
        } else {
            self.functions + function
        }
    }

    /// Counts a function no more, nor what it calls.
    fn cut(&mut self, function: usize) {
        for node in [function, self.functions + function] {
            self.weights[node] = 0;
            self.next[node].clear();
        }
    }

    /// The longest chain from a node.
    fn worst(&self, program: &LinkedProgram, start: usize) -> StackNeed {
        let rings = rings(&self.next);
        // Of each ring: the most that its callees need, and from which node to which.
        let mut done: Vec<(u64, Option<usize>)> = Vec::with_capacity(rings.members.len());
        // A ring comes after all that it calls.
        for members in &rings.members {
            let own: u64 = members.iter().map(|node| self.weights[*node]).sum();
            let below = members
                .iter()
                .flat_map(|node| &self.next[*node])
                .map(|node| rings.of[*node])
                .filter(|ring| *ring != rings.of[members[0]])
                .max_by_key(|ring| done[*ring].0);
            done.push((own + below.map_or(0, |ring| done[ring].0), below));
        }
        let mut chain = Vec::new();
        let mut at = Some(rings.of[start]);
        while let Some(ring) = at {
            for node in &rings.members[ring] {
                let function = program.functions.get(node % self.functions.max(1));
                if *node < 2 * self.functions && self.weights[*node] > 0 {
                    let name = function.map_or("", Function::name).to_owned();
                    chain.push((name, self.weights[*node]));
                }
            }
            at = done[ring].1;
        }
        StackNeed {
            bytes: done[rings.of[start]].0,
            chain,
        }
    }
}

/// What each function calls, but for panics, which count apart.
fn calls(functions: &[Function]) -> Vec<Vec<usize>> {
    let of = |function: &Function| {
        let counts = |callee: &&usize| function.is_panic() || !functions[**callee].is_panic();
        function.calls.iter().filter(counts).copied().collect()
    };
    functions.iter().map(of).collect()
}

/// How often each function can be on the stack at once, by what the code itself calls.
fn depths(functions: &[Function], calls: &[Vec<usize>]) -> Result<Vec<u32>> {
    let rings = rings(calls);
    let mut depths = vec![1; functions.len()];
    let mut endless = Vec::new();
    for members in &rings.members {
        let calls_itself = members.iter().any(|index| calls[*index].contains(index));
        if members.len() == 1 && !calls_itself {
            continue;
        }
        let names: Vec<&str> = members
            .iter()
            .map(|index| functions[*index].name())
            .collect();
        let panics = |index: &usize| functions[*index].is_core() && functions[*index].diverges;
        if members.iter().all(panics) {
            continue;
        }
        let is_known = |(name, _): &&(&str, u32)| names.iter().any(|ring| ring.starts_with(name));
        let Some((_, depth)) = RECURSIONS.iter().find(is_known) else {
            endless.push(names.join(" -> "));
            continue;
        };
        for index in members {
            depths[*index] = *depth;
        }
    }
    ensure!(
        endless.is_empty(),
        "calls go round, and RECURSIONS in host/imagecheck/src/stack.rs does not say how often: {}",
        endless.join("; ")
    );
    Ok(depths)
}

/// The strongly connected parts of a graph.
struct Rings {
    /// The nodes of each; those that one leads to come before it.
    members: Vec<Vec<usize>>,
    /// In which each node is.
    of: Vec<usize>,
}

fn rings(next: &[Vec<usize>]) -> Rings {
    let edges = (0..)
        .zip(next)
        .flat_map(|(from, next)| next.iter().map(move |to| (from, *to as u32)));
    let mut graph = DiGraph::<(), ()>::from_edges(edges);
    while graph.node_count() < next.len() {
        graph.add_node(());
    }
    let members: Vec<Vec<usize>> = tarjan_scc(&graph)
        .iter()
        .map(|ring| ring.iter().map(|node| node.index()).collect())
        .collect();
    let mut of = vec![0; next.len()];
    for (ring, nodes) in members.iter().enumerate() {
        for node in nodes {
            of[*node] = ring;
        }
    }
    Rings { members, of }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: usize = 0;
    const EXECUTOR: usize = 1;
    const FIT: usize = 2;
    const LINK: usize = 3;
    const LEAF: usize = 4;
    const WAKE: usize = 5;
    const DRIVER: usize = 6;
    const FAULT: usize = 7;
    const PANIC: usize = 8;
    const SHOW: usize = 9;
    const FORMAT: usize = 10;

    /// A thread whose executor polls two tasks, and a driver that wakes them.
    fn program() -> LinkedProgram {
        let function = |name: &str, frame, calls: &[usize], indirect| Function {
            names: vec![name.to_owned()],
            frame,
            bounded: true,
            calls: calls.to_vec(),
            indirect,
            diverges: false,
            pointers: BTreeSet::new(),
        };
        let task = |name: &str, frame, calls: &[usize], indirect| {
            let name = format!("<embassy_executor::raw::TaskStorage<umi::__{name}_task::f>>::poll");
            function(&name, frame, calls, indirect)
        };
        LinkedProgram {
            functions: vec![
                function("Reset", 8, &[EXECUTOR, LEAF], 0),
                function("embassy_executor::run", 16, &[], 1),
                task("fit", 1000, &[LEAF, PANIC], 0),
                task("link", 200, &[LEAF], 1),
                function("umi::leaf", 40, &[], 0),
                function("embassy_executor::raw::waker::wake", 4, &[], 0),
                function("umi::driver", 64, &[], 1),
                function("HardFault", 8, &[], 0),
                function("core::panicking::panic", 16, &[FORMAT], 0),
                function("<f64 as core::fmt::Display>::fmt", 500, &[FORMAT], 0),
                function("core::fmt::write", 32, &[], 1),
            ],
            loose: [FIT, LINK, WAKE, SHOW].into(),
            reset: START,
            handlers: [DRIVER].into(),
            faults: [FAULT].into(),
        }
    }

    fn level(handler: &str, tasks: &[&str]) -> Level {
        Level {
            handlers: vec![handler.to_owned()],
            tasks: tasks.iter().map(|task| (*task).to_owned()).collect(),
            after: Vec::new(),
        }
    }

    fn bytes(program: &LinkedProgram, levels: &[Level]) -> Vec<u64> {
        let needs = needs(program, levels, false).unwrap();
        needs.iter().map(|need| need.bytes).collect()
    }

    /// What each level adds: the worst task of its executor and no other, a driver's wakers but
    /// no tasks, a panic with all formatting once, a fault; and 36 bytes for each interrupt.
    #[test]
    fn levels_add_up() {
        let levels = [level("driver", &[]), level("main", &["fit", "link"])];
        // The order in which they are written does not matter: the thread comes first.
        assert_eq!(
            bytes(&program(), &levels),
            [8 + 16 + 1000 + 40, 36 + 64 + 4, 36 + 16 + 532, 36 + 8]
        );
        let needs = needs(&program(), &levels, true).unwrap();
        assert_eq!(needs[1].bytes, 108 + 64 + 4);
        let chain: Vec<&str> = needs[0]
            .chain
            .iter()
            .map(|(name, _)| name.as_str())
            .collect();
        assert_eq!(chain[..2], ["Reset", "embassy_executor::run"]);
        assert_eq!(chain[3], "umi::leaf");
    }

    /// A function whose address only one level knows counts in that one only.
    #[test]
    fn pointers_of_a_level() {
        let mut program = program();
        let mut callback = program.functions[LEAF].clone();
        callback.frame = 7000;
        program.functions.push(callback);
        program.functions[FIT].pointers.insert(FORMAT + 1);
        let other = program.functions[LINK].clone();
        let levels = [level("main", &["fit"]), level("driver", &["link"])];
        let needs = bytes(&program, &levels);
        // It is known where `fit` is, but only the executor and the other task call pointers.
        assert_eq!(needs[..2], [8 + 16 + 7000, 36 + 64 + 200 + 40]);
        program.functions[LINK] = Function {
            pointers: [FORMAT + 1].into(),
            ..other
        };
        assert_eq!(bytes(&program, &levels)[1], 36 + 64 + 200 + 7000);
    }

    /// What start-up calls through pointers runs no tasks: its stack and theirs exclude each
    /// other. A level whose tasks nobody runs is an error, so that none is left out unseen.
    #[test]
    fn only_the_executor_runs_tasks() {
        let mut program = program();
        let boot = Function {
            names: vec!["umi::boot".to_owned()],
            frame: 600,
            indirect: 1,
            ..program.functions[LEAF].clone()
        };
        program.functions.push(boot);
        program.functions[START].calls.push(FORMAT + 1);
        let levels = [level("main", &["fit"]), level("driver", &["link"])];
        assert_eq!(bytes(&program, &levels)[0], 8 + 16 + 1000 + 40);
        program.functions[FORMAT + 1].frame = 2000;
        assert_eq!(bytes(&program, &levels)[0], 8 + 2000 + 4);
        program.functions[START].calls = vec![FORMAT + 1];
        let said = needs(&program, &levels, false).unwrap_err().to_string();
        assert!(said.contains("`Reset`"), "{said}");
    }

    /// A level that begins when the start-up has returned is not on top of it. What start-up needs may
    /// not be more than the two that exclude it, and it must be there.
    #[test]
    fn what_has_returned_before_a_level_begins() {
        let mut program = program();
        let boot = Function {
            names: vec!["umi::boot".to_owned()],
            frame: 1300,
            ..program.functions[LEAF].clone()
        };
        program.functions.push(boot);
        program.functions[START].calls.push(FORMAT + 1);
        program.functions[DRIVER].calls.push(EXECUTOR);
        let mut levels = [level("main", &["link"]), level("driver", &["fit"])];
        let fit = 36 + 64 + 16 + 1000 + 40;
        assert_eq!(bytes(&program, &levels)[..2], [8 + 1300, fit]);
        levels[1].after = vec!["umi::boot".to_owned()];
        assert_eq!(bytes(&program, &levels)[..2], [8 + 16 + 200 + 40, fit]);
        let said = |program: &LinkedProgram, levels: &[Level]| {
            needs(program, levels, false).unwrap_err().to_string()
        };
        program.functions[FORMAT + 1].frame = 264 + fit as u32 - 8 + 1;
        let more = said(&program, &levels);
        assert!(more.contains("more before `umi::driver`"), "{more}");
        levels[1].after = vec!["umi::boots".to_owned()];
        assert!(said(&program, &levels).ends_with("boots"));
    }

    /// A board that says nothing gets the worst of all: any task at any level.
    #[test]
    fn without_levels() {
        assert_eq!(bytes(&program(), &[])[1], 36 + 64 + 1000 + 40);
    }

    /// A handler or a task that a board has forgotten is named.
    #[test]
    fn forgotten_ones() {
        let said = |levels: &[Level]| needs(&program(), levels, false).unwrap_err().to_string();
        assert!(said(&[level("main", &["fit", "link"])]).ends_with("umi::driver"));
        let said = said(&[level("main", &["fit"]), level("driver", &[])]);
        assert!(said.contains("__link_task"), "{said}");
    }

    /// A recursion of known depth counts that often; any other is an error that names it.
    #[test]
    fn recursions() {
        let mut program = program();
        program.functions[LEAF].calls.push(LEAF);
        let said = needs(&program, &[], false).unwrap_err().to_string();
        assert!(said.contains("umi::leaf"), "{said}");
        program.functions[LEAF].names = vec!["libm::math::frexp::frexp".into()];
        assert_eq!(bytes(&program, &[])[0], 8 + 16 + 1000 + 2 * 40);
    }

    /// A ring of the core library's functions that never return is a panic within a panic: each
    /// of them counts once. A ring of ours is an error though it never returns, and so is one
    /// of the core library's that does, and one that leads through both.
    #[test]
    fn rings_of_panics() {
        let mut program = program();
        let failing = |name: &str, call: usize| Function {
            names: vec![name.to_owned()],
            frame: 100,
            bounded: true,
            calls: vec![call],
            diverges: true,
            ..Function::default()
        };
        let (one, other) = (FORMAT + 1, FORMAT + 2);
        program.functions.push(failing("core::str::fail", other));
        program.functions.push(failing("core::str::fail_rt", one));
        program.functions[PANIC].calls.push(one);
        // A panic enters the ring, or formats its message, which takes more: 532 against 200.
        assert_eq!(bytes(&program, &[])[2], 36 + 16 + 532);
        program.functions[one].frame = 450;
        assert_eq!(bytes(&program, &[])[2], 36 + 16 + 450 + 100);

        let mut returns = program.functions[one].clone();
        returns.diverges = false;
        let ours = failing("umi_core::fail", one);
        for member in [returns, ours] {
            let mut program = LinkedProgram {
                functions: program.functions.clone(),
                loose: program.loose.clone(),
                ..LinkedProgram::default()
            };
            program.functions[other] = failing("core::str::fail_rt", one);
            program.functions[one] = Function {
                calls: vec![other],
                ..member
            };
            let said = needs(&program, &[], false).unwrap_err().to_string();
            assert!(said.contains("calls go round"), "{said}");
            assert!(said.contains("core::str::fail_rt"), "{said}");
        }
    }
}
