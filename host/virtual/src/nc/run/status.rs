//! The operator's view of a control: screen, variables, offsets.

use umi_core::units::Point;

use super::control::Control;
use super::system::Written;
use crate::nc::memory::alarm::{Alarm, Fault};
use crate::nc::memory::modal::g_text;
use crate::nc::memory::offsets::{OffsetSystem, Offsets};

/// What a control's screen shows.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlStatus {
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
    pub offset: OffsetSystem,
    /// The alarm at which it stands.
    pub alarm: Option<Alarm>,
}

impl Control {
    /// What a screen shows, as of the last step.
    #[must_use]
    pub fn status(&self) -> ControlStatus {
        let block = self
            .stack
            .last()
            .filter(|_| !self.ended)
            .and_then(|call| call.program.blocks.get(call.next));
        ControlStatus {
            program: self.program_number(),
            line: block.map_or(0, |b| b.line),
            text: block.map_or_else(String::new, |b| b.text.clone()),
            depth: self.stack.len().saturating_sub(1),
            work_position: Point {
                mm: self.frame().undo(self.seen.carried),
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
    pub fn offset(&self, offset: OffsetSystem) -> [f64; 3] {
        self.offsets.work(offset)
    }

    /// Sets the origin of a work coordinate system, mm.
    pub fn set_offset(&mut self, offset: OffsetSystem, origin_mm: [f64; 3]) {
        self.offsets.set_work(offset, origin_mm);
    }
}
