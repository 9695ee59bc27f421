//! The control: its memory, and the walk through a program block by block.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use nalgebra::Vector3;
use umi_core::units::Point;

use crate::nc::memory::alarm::{Alarm, Checked, Fault};
use crate::nc::memory::modal::Modal;
use crate::nc::memory::motion::{AxisDrives, Trip};
use crate::nc::memory::offsets::Offsets;
use crate::nc::memory::settings::ControlSettings;
use crate::nc::memory::variables::{Level, Variables};
use crate::nc::text::block::Block;
use crate::nc::text::program::{Program, split};

/// Where a program is after a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProgramState {
    /// The next block follows.
    Running,
    /// M0, M1 or `#3006`: the next step goes on, as cycle start does.
    Stopped,
    /// M2, M30 or the end of the text.
    Ended,
}

/// One block, carried out.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockStep {
    /// Where the program is now.
    pub state: ProgramState,
    /// The block's program.
    pub program: u32,
    /// Its line in the loaded text, from 1.
    pub line: u32,
    /// The block as it was loaded.
    pub text: String,
    /// What a stop says to the operator (the comment of `#3006`).
    pub message: Option<String>,
}

/// One level of call.
#[derive(Clone, Debug)]
pub(crate) struct Call {
    pub program: Arc<Program>,
    /// The next block.
    pub next: usize,
    /// Where a repetition begins.
    pub begin: usize,
    /// Repetitions still to come.
    pub repeats: u32,
    /// Whether it has local variables of its own (G65), or its caller's (M98).
    pub has_level: bool,
    /// The local variables with which each repetition begins.
    pub arguments: Level,
    /// Whether `G66` called it.
    pub is_modal: bool,
    /// LinuxCNC: passes of `repeat` still to come, by its block.
    pub passes: HashMap<usize, u64>,
    /// LinuxCNC: the branch that a false condition led to.
    pub branch: Option<usize>,
}

/// A macro to call after each motion (`G66`).
#[derive(Clone, Debug)]
pub(crate) struct ModalCall {
    pub program: u32,
    pub repeats: u32,
    pub arguments: Vec<(usize, f64)>,
}

/// What was last known of the axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    /// Of the machine.
    pub position: Point,
    /// The same; where the control carries the tip through the rotary axes (`G43.4`), where X, Y, Z
    /// would be with these at 0 and the tip at the same place of the table.
    pub carried: Vector3<f64>,
}

/// Where to go after a block.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Go {
    Next,
    /// To a block of this program.
    To(usize),
    Stop(Option<String>),
    /// The stack has changed: a call or a return.
    Called,
    End,
}

/// A control with its memory.
#[derive(Clone, Debug)]
pub struct Control {
    pub(crate) settings: ControlSettings,
    pub(crate) programs: BTreeMap<u32, Arc<Program>>,
    /// LinuxCNC: subroutines by label, and the number of their program.
    pub(crate) subs: HashMap<String, u32>,
    pub(crate) stack: Vec<Call>,
    pub(crate) levels: Vec<Level>,
    pub(crate) variables: Variables,
    pub(crate) offsets: Offsets,
    pub(crate) modal: Modal,
    pub(crate) modal_call: Option<ModalCall>,
    pub(crate) seen: Seen,
    /// The stored skip position, as [`crate::nc::run::system`] says, mm.
    pub(crate) skip_mm: Vector3<f64>,
    pub(crate) has_touched: bool,
    /// What the last `M66` found.
    pub(crate) input_read: f64,
    pub(crate) outputs: BTreeSet<u32>,
    pub(crate) stored: BTreeMap<u32, f64>,
    pub(crate) timer_ms: f64,
    pub(crate) timer_h: f64,
    pub(crate) is_open: bool,
    pub(crate) logs_probes: bool,
    pub(crate) is_logging: bool,
    pub(crate) logged: Option<[f64; 3]>,
    pub(crate) returned: f64,
    blocks: u64,
    backwards: u64,
    /// How often M99 began the main program again.
    pub(crate) main_repeats: u64,
    pub(crate) ended: bool,
    pub(crate) alarm: Option<Alarm>,
    /// What is given where there is no level: empty.
    base: Level,
}

impl Control {
    /// A control just switched on.
    #[must_use]
    pub fn new(settings: ControlSettings) -> Self {
        let modal = Modal::new(&settings);
        Self {
            settings,
            programs: BTreeMap::new(),
            subs: HashMap::new(),
            stack: Vec::new(),
            levels: Vec::new(),
            variables: Variables::default(),
            offsets: Offsets::default(),
            modal,
            modal_call: None,
            seen: Seen {
                position: Point::from_mm(0.0, 0.0, 0.0),
                carried: Vector3::zeros(),
            },
            skip_mm: Vector3::zeros(),
            has_touched: false,
            input_read: 0.0,
            outputs: BTreeSet::new(),
            stored: BTreeMap::new(),
            timer_ms: 0.0,
            timer_h: 0.0,
            is_open: false,
            logs_probes: false,
            is_logging: false,
            logged: None,
            returned: 0.0,
            blocks: 0,
            backwards: 0,
            main_repeats: 0,
            ended: true,
            alarm: None,
            base: Level::default(),
        }
    }

    /// Its parameters.
    #[must_use]
    pub fn settings(&self) -> &ControlSettings {
        &self.settings
    }

    /// Switches "block skip": blocks that begin with `/` are left out.
    pub fn set_block_skip(&mut self, is_on: bool) {
        self.settings.block_skip = is_on;
    }

    /// Puts the programs of a text into memory and says their O numbers. A program with a
    /// number that is already there replaces it; one that is running stays as it is until
    /// it is called again. A program without a number is O0 (LinuxCNC: the main program
    /// is O0, a text of subroutines gets the next free number).
    ///
    /// # Errors
    /// An alarm if the text holds no program, two of one number, or more than the limits
    /// allow. What a control cannot read in a block is an alarm when the block is reached.
    pub fn load(&mut self, text: &str) -> Result<Vec<u32>, Alarm> {
        self.load_checked(text)
            .map_err(|fault| fault.in_block(self.settings.dialect, 0, 0, ""))
    }

    fn load_checked(&mut self, text: &str) -> Checked<Vec<u32>> {
        let programs = read(text, &self.settings)?;
        let mut numbers = Vec::new();
        for mut program in programs {
            if program.is_library() {
                let mut number = 1;
                while self.programs.contains_key(&number) {
                    number += 1;
                }
                program.number = number;
            }
            if numbers.contains(&program.number) {
                return Err(Fault::new(format!(
                    "O{:04} comes twice in this text: number one of them anew",
                    program.number
                )));
            }
            if self.programs.len() >= self.settings.limits.programs
                && !self.programs.contains_key(&program.number)
            {
                return Err(Fault::new("too many programs in memory"));
            }
            for label in program.subs.keys() {
                self.subs.insert(label.clone(), program.number);
            }
            numbers.push(program.number);
            self.programs.insert(program.number, Arc::new(program));
        }
        Ok(numbers)
    }

    /// How often M99 has begun the main program again since it was selected.
    #[must_use]
    pub const fn begun_again(&self) -> u64 {
        self.main_repeats
    }

    /// The O numbers in memory.
    pub fn programs(&self) -> impl Iterator<Item = u32> {
        self.programs.keys().copied()
    }

    /// The blocks of a program in memory, each with its line in the loaded text.
    pub fn blocks(&self, o: u32) -> impl Iterator<Item = (u32, &str)> {
        let blocks = self.programs.get(&o).into_iter();
        blocks
            .flat_map(|program| &program.blocks)
            .map(|block| (block.line, block.text.as_str()))
    }

    /// Puts the beginning of a program under the cursor; ends whatever ran, clears its
    /// alarm and its local variables. Modal codes and the other variables stay.
    ///
    /// # Errors
    /// No such program in memory.
    pub fn select(&mut self, o: u32) -> Result<(), Alarm> {
        let Some(program) = self.programs.get(&o).cloned() else {
            return Err(
                Fault::ps(76, format!("O{o:04} is not in memory: load it first")).in_block(
                    self.settings.dialect,
                    o,
                    0,
                    "",
                ),
            );
        };
        self.variables = {
            let mut variables = std::mem::take(&mut self.variables);
            for level in &self.levels {
                variables.forget(level);
            }
            variables
        };
        self.levels = vec![Level::default()];
        self.stack = vec![Call {
            program,
            next: 0,
            begin: 0,
            repeats: 0,
            has_level: true,
            arguments: Level::default(),
            is_modal: false,
            passes: HashMap::new(),
            branch: None,
        }];
        self.modal_call = None;
        self.modal.cycle = None;
        self.blocks = 0;
        self.backwards = 0;
        self.main_repeats = 0;
        self.ended = false;
        self.alarm = None;
        Ok(())
    }

    /// Sets the modal codes as they are when the control is switched on. Offsets and
    /// variables stay.
    pub fn reset(&mut self) {
        self.modal = Modal {
            tool: self.modal.tool,
            ..Modal::new(&self.settings)
        };
        self.modal_call = None;
        self.is_open = false;
        self.ended = true;
        self.alarm = None;
    }

    /// Carries out one block. After the end it says so again; after an alarm, the alarm,
    /// until a program is selected.
    ///
    /// # Errors
    /// What a control would show as an alarm, the machine's included.
    pub fn step(&mut self, axes: &mut dyn AxisDrives) -> Result<BlockStep, Alarm> {
        if let Some(alarm) = &self.alarm {
            return Err(alarm.clone());
        }
        self.look(axes);
        let (program, index) = match self.stack.last() {
            Some(call) if !self.ended => (Arc::clone(&call.program), call.next),
            _ => {
                return Ok(BlockStep {
                    state: ProgramState::Ended,
                    program: self.program_number(),
                    line: 0,
                    text: String::new(),
                    message: None,
                });
            }
        };
        let block = program.blocks.get(index);
        let (line, text) = block.map_or((0, ""), |b| (b.line, b.text.as_str()));
        let result = self.carry_out(&program, index, block, axes);
        self.look(axes);
        match result {
            Ok((state, message)) => Ok(BlockStep {
                state,
                program: program.number,
                line,
                text: text.to_string(),
                message,
            }),
            Err(fault) => {
                let alarm = fault.in_block(self.settings.dialect, program.number, line, text);
                self.alarm = Some(alarm.clone());
                Err(alarm)
            }
        }
    }

    /// Carries out blocks until the program stops (M0, M1, `#3006`) or ends.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn run(&mut self, axes: &mut dyn AxisDrives) -> Result<BlockStep, Alarm> {
        loop {
            let step = self.step(axes)?;
            if step.state != ProgramState::Running {
                return Ok(step);
            }
        }
    }

    fn carry_out(
        &mut self,
        program: &Arc<Program>,
        index: usize,
        block: Option<&Block>,
        axes: &mut dyn AxisDrives,
    ) -> Checked<(ProgramState, Option<String>)> {
        self.blocks += 1;
        if self.blocks > self.settings.limits.blocks {
            return Err(Fault::new(format!(
                "more than {} blocks: the program does not end, or raise `blocks` in the scene's \
                 [control.nc.limits]",
                self.settings.limits.blocks
            )));
        }
        let go = match block {
            None => self.end_of_text()?,
            Some(block) if block.is_optional && self.settings.block_skip => Go::Next,
            Some(block) => {
                if let Some(n) = block.n {
                    self.modal.n = n;
                }
                let statement = block.statement.as_ref().map_err(Clone::clone)?;
                self.execute(program, index, block, statement, axes)?
            }
        };
        match go {
            Go::Next => {
                self.go_to(index + 1);
                Ok((ProgramState::Running, None))
            }
            Go::To(target) => {
                if target <= index {
                    self.count_backwards()?;
                }
                self.go_to(target);
                Ok((ProgramState::Running, None))
            }
            Go::Called => Ok((ProgramState::Running, None)),
            Go::Stop(message) => {
                self.go_to(index + 1);
                Ok((ProgramState::Stopped, message))
            }
            Go::End => {
                self.ended = true;
                self.modal_call = None;
                Ok((ProgramState::Ended, None))
            }
        }
    }

    /// Counts a jump backwards, so that every loop ends.
    pub(crate) fn count_backwards(&mut self) -> Checked<()> {
        self.backwards += 1;
        if self.backwards > self.settings.limits.loops {
            return Err(Fault::new(format!(
                "more than {} passes of loops: the program does not end, or raise `loops` in the \
                 scene's [control.nc.limits]",
                self.settings.limits.loops
            )));
        }
        Ok(())
    }

    pub(crate) fn go_to(&mut self, index: usize) {
        if let Some(call) = self.stack.last_mut() {
            call.next = index;
        }
    }

    /// The number of the program under the cursor.
    pub(crate) fn program_number(&self) -> u32 {
        self.stack.last().map_or(0, |call| call.program.number)
    }

    pub(crate) fn level(&self) -> &Level {
        self.levels.last().unwrap_or(&self.base)
    }

    pub(crate) fn level_mut(&mut self) -> &mut Level {
        match self.levels.last_mut() {
            Some(level) => level,
            None => &mut self.base,
        }
    }
}

/// The programs of a text, at least one.
pub(crate) fn read(text: &str, settings: &ControlSettings) -> Checked<Vec<Program>> {
    let most = settings.limits.text;
    if text.len() > most {
        return Err(Fault::new(format!(
            "a text of {} bytes: the control holds {most} (`text` in the scene's \
             [control.nc.limits])",
            text.len(),
        )));
    }
    let programs = split(text, settings.dialect)?;
    if programs.is_empty() {
        return Err(Fault::new("there is no program in this text"));
    }
    Ok(programs)
}

/// What a number is that two programs of a text have.
pub(crate) fn comes_twice(number: u32) -> Fault {
    Fault::new(format!(
        "O{number:04} comes twice in this text: number one of them anew"
    ))
}

impl From<Trip> for Fault {
    fn from(trip: Trip) -> Self {
        Self::new(trip.message)
    }
}
