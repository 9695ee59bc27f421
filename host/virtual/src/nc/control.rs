//! The control: its memory, and the walk through a program block by block.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use nalgebra::Vector3;
use umi_core::units::Point;

use super::alarm::{Alarm, Checked, Fault};
use super::block::{Block, Statement};
use super::evaluate::{evaluate, holds, variable_number, whole};
use super::expression::Expr;
use super::modal::{Modal, g_text};
use super::motion::{Axes, Trip};
use super::offsets::{Offsets, WorkOffset};
use super::program::{Program, split};
use super::settings::Settings;
use super::system::{View, Written};
use super::transform::Frame;
use super::variables::{Level, Variables};

/// Where a program is after a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// The next block follows.
    Running,
    /// M0, M1 or `#3006`: the next step goes on, as cycle start does.
    Stopped,
    /// M2, M30 or the end of the text.
    Ended,
}

/// One block, carried out.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Where the program is now.
    pub state: State,
    /// The block's program.
    pub program: u32,
    /// Its line in the loaded text, from 1.
    pub line: u32,
    /// The block as it was loaded.
    pub text: String,
    /// What a stop says to the operator (the comment of `#3006`).
    pub message: Option<String>,
}

/// What a control's screen shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Status {
    /// The program of the next block.
    pub program: u32,
    /// The line of the next block in the loaded text, from 1; 0 at the end.
    pub line: u32,
    /// The next block.
    pub text: String,
    /// How many calls deep it is.
    pub depth: usize,
    /// Where the tool's tip is in the coordinates of the program, mm.
    pub work_position: Point,
    /// Where the axes are, machine coordinates, mm.
    pub machine_position: Point,
    /// The G codes in force.
    pub g_codes: Vec<String>,
    /// mm/min; none before the first F.
    pub feed_mm_min: Option<f64>,
    /// The S word.
    pub spindle_rpm: f64,
    /// The tool in the spindle.
    pub tool: u32,
    /// The work coordinate system in force.
    pub offset: WorkOffset,
    /// The alarm at which it stands.
    pub alarm: Option<Alarm>,
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
    pub position: Point,
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
    pub(crate) settings: Settings,
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
    /// The stored skip position, as [`super::system`] says, mm.
    pub(crate) skip_mm: Vector3<f64>,
    pub(crate) has_touched: bool,
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
    ended: bool,
    alarm: Option<Alarm>,
    /// What is given where there is no level: empty.
    base: Level,
}

impl Control {
    /// A control just switched on.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
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
            },
            skip_mm: Vector3::zeros(),
            has_touched: false,
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
            ended: true,
            alarm: None,
            base: Level::default(),
        }
    }

    /// Its parameters.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Switches "block skip": blocks that begin with `/` are left out.
    pub fn set_block_skip(&mut self, is_on: bool) {
        self.settings.block_skip = is_on;
    }

    /// Switches "optional stop": M1 stops.
    pub fn set_optional_stop(&mut self, is_on: bool) {
        self.settings.optional_stop = is_on;
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
        let limits = &self.settings.limits;
        if text.len() > limits.text {
            return Err(Fault::new(format!(
                "a text of {} bytes: the control holds {}",
                text.len(),
                limits.text
            )));
        }
        let programs = split(text, self.settings.dialect);
        if programs.is_empty() {
            return Err(Fault::new("there is no program in this text"));
        }
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

    /// The O numbers in memory.
    pub fn programs(&self) -> impl Iterator<Item = u32> {
        self.programs.keys().copied()
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
    pub fn step(&mut self, axes: &mut dyn Axes) -> Result<Step, Alarm> {
        if let Some(alarm) = &self.alarm {
            return Err(alarm.clone());
        }
        self.seen.position = axes.position();
        let (program, index) = match self.stack.last() {
            Some(call) if !self.ended => (Arc::clone(&call.program), call.next),
            _ => {
                return Ok(Step {
                    state: State::Ended,
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
        self.seen.position = axes.position();
        match result {
            Ok((state, message)) => Ok(Step {
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
    pub fn run(&mut self, axes: &mut dyn Axes) -> Result<Step, Alarm> {
        loop {
            let step = self.step(axes)?;
            if step.state != State::Running {
                return Ok(step);
            }
        }
    }

    fn carry_out(
        &mut self,
        program: &Arc<Program>,
        index: usize,
        block: Option<&Block>,
        axes: &mut dyn Axes,
    ) -> Checked<(State, Option<String>)> {
        self.blocks += 1;
        if self.blocks > self.settings.limits.blocks {
            return Err(Fault::new(format!(
                "more than {} blocks: the program does not end, or raise limits.blocks",
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
                Ok((State::Running, None))
            }
            Go::To(target) => {
                if target <= index {
                    self.count_backwards()?;
                }
                self.go_to(target);
                Ok((State::Running, None))
            }
            Go::Called => Ok((State::Running, None)),
            Go::Stop(message) => {
                self.go_to(index + 1);
                Ok((State::Stopped, message))
            }
            Go::End => {
                self.ended = true;
                self.modal_call = None;
                Ok((State::Ended, None))
            }
        }
    }

    /// Counts a jump backwards, so that every loop ends.
    pub(crate) fn count_backwards(&mut self) -> Checked<()> {
        self.backwards += 1;
        if self.backwards > self.settings.limits.loops {
            return Err(Fault::new(format!(
                "more than {} passes of loops: the program does not end, or raise limits.loops",
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

    fn execute(
        &mut self,
        program: &Arc<Program>,
        index: usize,
        block: &Block,
        statement: &Statement,
        axes: &mut dyn Axes,
    ) -> Checked<Go> {
        match statement {
            Statement::Words(words, assigns) if words.is_empty() && assigns.is_empty() => {
                self.comments(block, axes)?;
                Ok(Go::Next)
            }
            Statement::Words(words, assigns) => {
                self.comments(block, axes)?;
                // All values are those before the block (LinuxCNC).
                let mut values = Vec::with_capacity(assigns.len());
                for assign in assigns {
                    values.push(self.value(&assign.value, axes)?);
                }
                let mut go = if words.is_empty() {
                    Go::Next
                } else {
                    self.words(words, axes)?
                };
                for (assign, value) in assigns.iter().zip(values) {
                    if let Some(stop) = self.assign(&assign.target, value, block, axes)? {
                        go = stop;
                    }
                }
                Ok(go)
            }
            Statement::IfGoto(condition, target) => {
                if self.holds(condition, axes)? {
                    self.jump(program, index, target, axes)
                } else {
                    Ok(Go::Next)
                }
            }
            Statement::IfThen(condition, assign) => {
                if self.holds(condition, axes)? {
                    let value = self.value(&assign.value, axes)?;
                    let stop = self.assign(&assign.target, value, block, axes)?;
                    Ok(stop.unwrap_or(Go::Next))
                } else {
                    Ok(Go::Next)
                }
            }
            Statement::Goto(target) => self.jump(program, index, target, axes),
            Statement::Do(condition, label) => {
                let goes_on = match condition {
                    Some(condition) => self.holds(condition, axes)?,
                    None => true,
                };
                match program.links.get(&index) {
                    _ if goes_on => Ok(Go::Next),
                    Some(link) => Ok(Go::To(link.end + 1)),
                    None => Err(Fault::ps(124, format!("DO{label} has no END{label}"))),
                }
            }
            Statement::End(label) => match program.links.get(&index) {
                Some(link) => Ok(Go::To(link.begin)),
                None => Err(Fault::ps(124, format!("END{label} has no DO{label}"))),
            },
            Statement::Open => {
                if !self.is_open && self.settings.dc_codes {
                    axes.print(&[super::dprnt::DC2])?;
                }
                self.is_open = true;
                Ok(Go::Next)
            }
            Statement::Close => {
                if self.is_open && self.settings.dc_codes {
                    axes.print(&[super::dprnt::DC4])?;
                }
                self.is_open = false;
                Ok(Go::Next)
            }
            Statement::Print(format) => {
                if !self.is_open && !self.prints_unopened() {
                    return Err(Fault::new(
                        "the line is not open: POPEN must stand before DPRNT and BPRNT",
                    ));
                }
                let bytes = format.bytes(&self.view(axes), &self.settings)?;
                axes.print(&bytes)?;
                Ok(Go::Next)
            }
            Statement::OWord(word) => self.o_word(program, index, word, axes),
        }
    }

    /// Whether `DPRNT` needs no `POPEN` (Haas: the serial port is always on).
    fn prints_unopened(&self) -> bool {
        self.settings.dialect == super::settings::Dialect::Haas
    }

    pub(crate) fn view<'a>(&'a self, axes: &'a dyn Axes) -> View<'a> {
        View {
            control: self,
            axes,
        }
    }

    pub(crate) fn value(&self, expr: &Expr, axes: &dyn Axes) -> Checked<Option<f64>> {
        evaluate(expr, &self.view(axes))
    }

    pub(crate) fn holds(&self, condition: &Expr, axes: &dyn Axes) -> Checked<bool> {
        holds(condition, &self.view(axes))
    }

    /// Puts a value into what stands left of `=`.
    fn assign(
        &mut self,
        target: &Expr,
        value: Option<f64>,
        block: &Block,
        axes: &mut dyn Axes,
    ) -> Checked<Option<Go>> {
        let number = match target {
            Expr::Named(name) => {
                let limit = self.settings.limits.names;
                let mut level = std::mem::take(self.level_mut());
                let set = self
                    .variables
                    .set_named(&mut level, name, value.unwrap_or(0.0), limit);
                *self.level_mut() = level;
                return set.map(|()| None);
            }
            Expr::Variable(number) => variable_number(number, &self.view(axes))?,
            _ => return Err(Fault::ps(114, "a value goes into a variable")),
        };
        match self.write(number, value, Some(axes))? {
            Written::Done => Ok(None),
            Written::Stop => Ok(Some(Go::Stop(block.comments.first().cloned()))),
            Written::Alarm(n) => {
                let text = block.comments.first().map_or("", String::as_str);
                let message = format!("the program says: {text}");
                let base = match self.settings.dialect {
                    super::settings::Dialect::Fanuc => Some(3000),
                    super::settings::Dialect::Haas => Some(1000),
                    _ => None,
                };
                Err(match (base, whole(n, 999)) {
                    (Some(base), Some(n)) => Fault::own(base + n, message),
                    _ => Fault::new(format!("#3000={n}: {message}")),
                })
            }
        }
    }

    fn jump(&self, program: &Program, index: usize, target: &Expr, axes: &dyn Axes) -> Checked<Go> {
        let value = self.value(target, axes)?.unwrap_or(-1.0);
        let n = whole(value, 99_999_999)
            .ok_or_else(|| Fault::ps(128, format!("GOTO {value}: no sequence number")))?;
        let to = program
            .find(n, index + 1)
            .ok_or_else(|| Fault::ps(128, format!("no block N{n} in this program")))?;
        if !program.may_jump(index, to) {
            return Err(Fault::new(format!(
                "N{n} stands inside a loop: GOTO cannot lead into one"
            )));
        }
        Ok(Go::To(to))
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

    /// From the coordinates of the program to the machine's, without the tool's length.
    pub(crate) fn work_frame(&self) -> Frame {
        let modal = &self.modal;
        let origin = self.offsets.origin(modal.work) + modal.local;
        let mut frame = Frame::shift(modal.shift);
        let turn = self.offsets.turn(modal.work);
        if turn != 0.0 {
            frame = frame.inside(&Frame::about(Vector3::zeros(), Vector3::z_axis(), turn));
        }
        frame.inside(&Frame::shift(origin))
    }

    /// From the coordinates of the program to the machine's, all together.
    pub(crate) fn frame(&self) -> Frame {
        let mut frame = Frame::shift(Vector3::zeros());
        for rotation in self.modal.rotations.iter().rev() {
            frame = frame.inside(rotation);
        }
        if let Some(p) = self.modal.setting_error {
            frame = frame.inside(&Frame::setting_error(self.offsets.setting_error(p)));
        }
        frame
            .inside(&self.work_frame())
            .inside(&Frame::shift(self.length()))
    }

    /// The tool's length in force.
    pub(crate) fn length(&self) -> Vector3<f64> {
        Vector3::new(0.0, 0.0, self.modal.length_mm)
    }

    /// Where the axes are in the active work coordinate system, mm; with the tool's
    /// length in it (the gauge line) or not (the tip).
    pub(crate) fn work_position(&self, with_length: bool) -> Vector3<f64> {
        let mut at = self.seen.position.mm;
        if !with_length {
            at -= self.length();
        }
        self.work_frame().undo(at)
    }

    /// What a screen shows, as of the last step.
    #[must_use]
    pub fn status(&self) -> Status {
        let block = self
            .stack
            .last()
            .filter(|_| !self.ended)
            .and_then(|call| call.program.blocks.get(call.next));
        Status {
            program: self.program_number(),
            line: block.map_or(0, |b| b.line),
            text: block.map_or_else(String::new, |b| b.text.clone()),
            depth: self.stack.len().saturating_sub(1),
            work_position: Point {
                mm: self.frame().undo(self.seen.position.mm),
            },
            machine_position: self.seen.position,
            g_codes: self.modal.codes().into_iter().map(g_text).collect(),
            feed_mm_min: self.modal.feed,
            spindle_rpm: self.modal.s,
            tool: self.modal.tool,
            offset: self.modal.work,
            alarm: self.alarm.clone(),
        }
    }

    /// The value of `#n`; none if it is null or no variable of this control. Positions
    /// are as of the last step; inputs and timers are null here.
    #[must_use]
    pub fn variable(&self, n: u32) -> Option<f64> {
        self.read(n, None).ok().flatten()
    }

    /// Sets `#n`.
    ///
    /// # Errors
    /// No variable of this control, or one that can only be read.
    pub fn set_variable(&mut self, n: u32, value: Option<f64>) -> Result<(), Alarm> {
        if value.is_some_and(|value| !value.is_finite()) {
            return Err(Fault::new(format!("#{n} takes finite numbers")).in_block(
                self.settings.dialect,
                0,
                0,
                "",
            ));
        }
        match self.write(n, value, None) {
            Ok(Written::Done) => Ok(()),
            Ok(Written::Alarm(_) | Written::Stop) => Err(Fault::new(format!(
                "#{n} is an action of a program: it cannot be set from outside"
            ))
            .in_block(self.settings.dialect, 0, 0, "")),
            Err(fault) => Err(fault.in_block(self.settings.dialect, 0, 0, "")),
        }
    }

    /// A named parameter of LinuxCNC, without `#<` and `>`.
    #[must_use]
    pub fn named(&self, name: &str) -> Option<f64> {
        self.read_named(name)
    }

    /// The tables of offsets.
    #[must_use]
    pub fn offsets(&self) -> &Offsets {
        &self.offsets
    }

    /// The tables of offsets, to set them.
    pub fn offsets_mut(&mut self) -> &mut Offsets {
        &mut self.offsets
    }

    /// The origin of a work coordinate system, mm.
    #[must_use]
    pub fn offset(&self, offset: WorkOffset) -> [f64; 3] {
        self.offsets.work(offset)
    }

    /// Sets the origin of a work coordinate system, mm.
    pub fn set_offset(&mut self, offset: WorkOffset, origin_mm: [f64; 3]) {
        self.offsets.set_work(offset, origin_mm);
    }
}

impl From<Trip> for Fault {
    fn from(trip: Trip) -> Self {
        Self::new(trip.message)
    }
}
