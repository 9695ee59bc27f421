//! System variables.
//!
//! Positions (#5001 to #5083) are in the units of the program:
//!
//! | from | what | tool length |
//! |---|---|---|
//! | #5001 | end of the last block, in the active work coordinate system | not in it |
//! | #5021 | machine coordinates | |
//! | #5041 | where the axes are, in the active work coordinate system | in it |
//! | #5061 | where the skip signal came (G31), likewise | in it |
//! | #5081 | tool length in force (#5083; X and Y have none) | |
//!
//! "In it" is the rule of Fanuc's table of these variables: with G43 they are the position
//! of the gauge line. They are not turned by `G68` and not compensated by `G54.4`. In
//! LinuxCNC #5061 and #5420 are in the coordinates of the program, the tool's tip.

use nalgebra::Vector3;

use super::control::Control;
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::motion::AxisDrives;
use crate::nc::memory::offsets::{MAX_EXTENDED, OffsetSystem};
use crate::nc::memory::settings::ControlFamily;
use crate::nc::memory::variables::Variables;
use crate::nc::text::evaluate::Lookup;

/// What a write asks of the control.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Written {
    /// Nothing more.
    Done,
    /// `#3000 = n`: an alarm of the program.
    Alarm(f64),
    /// `#3006 = n`: a stop with the block's comment.
    Stop,
}

/// The control's variables while the axes can be asked.
pub(crate) struct View<'a> {
    pub control: &'a Control,
    pub axes: &'a dyn AxisDrives,
}

impl Lookup for View<'_> {
    fn dialect(&self) -> ControlFamily {
        self.control.settings.dialect
    }

    fn variable(&self, number: u32) -> Checked<Option<f64>> {
        self.control.read(number, Some(self.axes))
    }

    fn named(&self, name: &str) -> Checked<Option<f64>> {
        Ok(self.control.read_named(name))
    }
}

fn no_variable(number: u32) -> Fault {
    Fault::ps(115, format!("#{number} is no variable of this control"))
}

/// Which of three axes a variable is for, counted from the first one's number.
fn axis(number: u32, first: u32) -> Option<usize> {
    usize::try_from(number.checked_sub(first)?)
        .ok()
        .filter(|axis| *axis < 3)
}

/// The work coordinate system and the axis of an offset's variable.
fn offset_of(number: u32, dialect: ControlFamily) -> Option<(OffsetSystem, usize)> {
    let in_table = |first: u32, count: u32| {
        let place = number.checked_sub(first).filter(|n| *n < count * 20)?;
        Some((place / 20, axis(place % 20, 0)?))
    };
    if dialect == ControlFamily::LinuxCnc {
        let (n, axis) = in_table(5221, 9)?;
        return Some((OffsetSystem::Standard(u8::try_from(n).ok()? + 1), axis));
    }
    if let Some(axis) = axis(number, 5201) {
        return Some((OffsetSystem::External, axis));
    }
    if let Some((n, axis)) = in_table(5221, 6) {
        return Some((OffsetSystem::Standard(u8::try_from(n).ok()? + 1), axis));
    }
    let (n, axis) = in_table(7001, 48).or_else(|| in_table(14_001, u32::from(MAX_EXTENDED)))?;
    Some((OffsetSystem::Extended(u16::try_from(n).ok()? + 1), axis))
}

/// The set of `G54.4` and the place in it (dx, dy, dz, da, db, dc) of a variable: #26010
/// is dx of set 1, the sets are ten apart. Public post processors for Fanuc write them so.
/// Set 0, which a control adds to all others, stays zero here.
fn setting_error_of(number: u32, dialect: ControlFamily) -> Option<(u8, usize)> {
    let place = number.checked_sub(26_000).filter(|place| *place < 80)?;
    let value = usize::try_from(place % 10).ok().filter(|v| *v < 6)?;
    (dialect == ControlFamily::Fanuc).then_some((u8::try_from(place / 10).ok()?, value))
}

/// The tool length offset of a variable.
fn length_of(number: u32, dialect: ControlFamily) -> Option<u32> {
    match (dialect, number) {
        (ControlFamily::LinuxCnc | ControlFamily::Grbl, _) => None,
        (_, 2001..=2200) => Some(number - 2000),
        (ControlFamily::Fanuc | ControlFamily::Mitsubishi, 10_001..=10_400) => {
            Some(number - 10_000)
        }
        _ => None,
    }
}

/// The tool radius offset of a variable.
fn radius_of(number: u32, dialect: ControlFamily) -> Option<u32> {
    match (dialect, number) {
        (ControlFamily::Haas, 2401..=2600) => Some(number - 2400),
        (ControlFamily::Fanuc, 13_001..=13_400) => Some(number - 13_000),
        _ => None,
    }
}

fn on(is_on: bool) -> f64 {
    if is_on { 1.0 } else { 0.0 }
}

impl Control {
    /// The value of `#number`. Without axes the inputs and timers are null.
    pub(crate) fn read(&self, number: u32, axes: Option<&dyn AxisDrives>) -> Checked<Option<f64>> {
        let dialect = self.settings.dialect;
        if number == 0 && dialect.is_macro_b() {
            return Ok(None);
        }
        if let Some(value) = self.variables.get(self.level(), number, dialect) {
            return Ok(value);
        }
        let unit = self.modal.unit_mm();
        if let Some((offset, axis)) = offset_of(number, dialect) {
            return Ok(component(&self.offsets.work(offset), axis, unit));
        }
        if let Some((set, value)) = setting_error_of(number, dialect) {
            let error = self.offsets.setting_error(set);
            let unit = if value < 3 { unit } else { 1.0 };
            return Ok(error.get(value).map(|value| value / unit));
        }
        if dialect == ControlFamily::LinuxCnc {
            return self
                .read_linuxcnc(number)
                .ok_or_else(|| no_variable(number));
        }
        if let Some(h) = length_of(number, dialect) {
            return Ok(Some(self.offsets.length(h) / unit));
        }
        if let Some(d) = radius_of(number, dialect) {
            return Ok(Some(self.offsets.radius(d) / unit));
        }
        let inputs = |first: u16| {
            let word: u32 = (0..32)
                .filter(|bit| axes.is_some_and(|a| a.input(first + bit)))
                .map(|bit| 1 << bit)
                .sum();
            Some(f64::from(word as i32))
        };
        Ok(match number {
            1032 => inputs(1000),
            1000..=1035 => axes.map(|axes| on(axes.input(u16::try_from(number).unwrap_or(0)))),
            1132 => {
                let word: u32 = (0..32)
                    .filter(|bit| self.outputs.contains(&(1100 + bit)))
                    .map(|bit| 1 << bit)
                    .sum();
                Some(f64::from(word as i32))
            }
            1100..=1135 => Some(on(self.outputs.contains(&number))),
            3001 => axes.map(|axes| (axes.seconds() * 1000.0 - self.timer_ms).floor()),
            3002 => axes.map(|axes| axes.seconds() / 3600.0 - self.timer_h),
            3003 | 3004 | 3901 | 3902 => Some(self.stored.get(&number).copied().unwrap_or(0.0)),
            3007 => Some(0.0),
            3011 => Some(f64::from(self.settings.date)),
            3012 => Some(f64::from(self.settings.time)),
            4001..=4130 => self.read_modal(number - 4000)?,
            4201..=4330 if dialect == ControlFamily::Fanuc => {
                self.read_modal(number - if number > 4300 { 4300 } else { 4200 })?
            }
            5001..=5083 => {
                let (place, first) = match number {
                    5001..=5020 => (self.work_position(false), 5001),
                    5021..=5040 => (self.seen.position.mm, 5021),
                    5041..=5060 => (self.work_position(true), 5041),
                    5061..=5080 => (self.skip_mm, 5061),
                    _ => (Vector3::new(0.0, 0.0, self.modal.length_mm), 5081),
                };
                let axis = axis(number, first).ok_or_else(|| no_variable(number))?;
                component(&place.into(), axis, unit)
                    .map(|value| self.settings.rounded(value, self.modal.is_inch))
            }
            _ => return Err(no_variable(number)),
        })
    }

    /// Modal information by group (1 to 30) or by address (102 B to 130 P).
    fn read_modal(&self, number: u32) -> Checked<Option<f64>> {
        let modal = &self.modal;
        let codes = modal.codes();
        let code = |place: usize| codes.get(place).map(|tenths| f64::from(*tenths) / 10.0);
        let unit = modal.unit_mm();
        let mirror = if modal.is_mirrored { 51.1 } else { 50.1 };
        Ok(match number {
            1 => code(0),
            2 => code(1),
            3 => code(2),
            5 => code(3),
            6 => code(4),
            7 => code(5),
            8 => code(6),
            9 => code(11),
            10 => code(7),
            11 => Some(if modal.is_scaled { 51.0 } else { 50.0 }),
            19 if self.settings.dialect == ControlFamily::Mitsubishi => Some(mirror),
            22 if self.settings.dialect == ControlFamily::Fanuc => Some(mirror),
            // Haas has its work offsets in group 12, and calls the further ones by G154.
            12 if self.settings.dialect == ControlFamily::Haas => match modal.work {
                OffsetSystem::Extended(_) => Some(154.0),
                _ => code(8),
            },
            12 => Some(if self.modal_call.is_some() {
                66.0
            } else {
                67.0
            }),
            13 => code(9),
            14 => code(8),
            16 => code(10),
            107 => Some(f64::from(modal.d)),
            109 => Some(modal.feed.unwrap_or(0.0) / unit),
            111 => Some(f64::from(modal.h)),
            113 => Some(f64::from(modal.m)),
            114 => Some(f64::from(modal.n)),
            115 => Some(f64::from(self.program_number())),
            119 => Some(modal.s),
            120 => Some(f64::from(modal.t)),
            130 => Some(f64::from(modal.work_code().1)),
            _ => return Err(no_variable(4000 + number)),
        })
    }

    fn read_linuxcnc(&self, number: u32) -> Option<Option<f64>> {
        let unit = self.modal.unit_mm();
        let value = match number {
            5061..=5069 => match axis(number, 5061) {
                Some(axis) => component(&self.skip_mm.into(), axis, unit),
                None => Some(0.0),
            },
            5070 => Some(on(self.has_touched)),
            5210 => Some(on(self.modal.shift != Vector3::zeros())),
            5211..=5213 => component(&self.modal.shift.into(), axis(number, 5211)?, unit),
            5220 => Some(match self.modal.work {
                OffsetSystem::Standard(n) => f64::from(n),
                _ => 1.0,
            }),
            5399 => Some(self.input_read),
            5400 => Some(f64::from(self.modal.tool)),
            // The loaded tool's in the table, whatever is in force; it has none in X and Y here.
            5401 | 5402 => Some(0.0),
            5403 => Some(self.offsets.length(self.modal.tool) / unit),
            5420..=5422 => {
                let at = self.frame().undo(self.seen.carried);
                component(&at.into(), axis(number, 5420)?, unit)
            }
            5230..=5400 => {
                let place = number.checked_sub(5230)?;
                let n = u8::try_from(place / 20).ok().filter(|n| *n < 9)? + 1;
                (place % 20 == 0).then(|| self.offsets.turn(OffsetSystem::Standard(n)))
            }
            _ => return None,
        };
        value.map(Some)
    }

    /// Sets `#number`.
    pub(crate) fn write(
        &mut self,
        number: u32,
        value: Option<f64>,
        axes: Option<&mut dyn AxisDrives>,
    ) -> Checked<Written> {
        let dialect = self.settings.dialect;
        if number == 0 && dialect.is_macro_b() {
            return Err(Fault::ps(
                116,
                "#0 is always null: nothing can be put into it",
            ));
        }
        if Variables::is_local(number, dialect) || Variables::is_common(number, dialect) {
            let mut level = std::mem::take(self.level_mut());
            self.variables.set(&mut level, number, value, dialect);
            *self.level_mut() = level;
            return Ok(Written::Done);
        }
        let unit = self.modal.unit_mm();
        let number_set = value.unwrap_or(0.0);
        let length = self.settings.rounded(number_set, self.modal.is_inch) * unit;
        let is_offset = offset_of(number, dialect).is_some()
            || length_of(number, dialect).is_some()
            || radius_of(number, dialect).is_some();
        if is_offset && !(-1e6..=1e6).contains(&length) {
            return Err(Fault::ps(32, "the offset is too large"));
        }
        if let Some((offset, axis)) = offset_of(number, dialect) {
            let mut origin = self.offsets.work(offset);
            if let Some(slot) = origin.get_mut(axis) {
                *slot = length;
            }
            self.offsets.set_work(offset, origin);
            return Ok(Written::Done);
        }
        if let Some((set @ 1.., value)) = setting_error_of(number, dialect) {
            let mut error = self.offsets.setting_error(set);
            let rounded = self.settings.rounded(number_set, false);
            if let Some(slot) = error.get_mut(value) {
                *slot = if value < 3 { length } else { rounded };
            }
            if !(-1e6..=1e6).contains(&number_set) {
                return Err(Fault::ps(32, "the setting error is too large"));
            }
            self.offsets.set_setting_error(set, error);
            return Ok(Written::Done);
        }
        if let Some(h) = length_of(number, dialect) {
            self.offsets.set_length(h, length);
            return Ok(Written::Done);
        }
        if let Some(d) = radius_of(number, dialect) {
            self.offsets.set_radius(d, length);
            return Ok(Written::Done);
        }
        if !dialect.is_macro_b() {
            return Err(Fault::new(format!("#{number} cannot be set")));
        }
        match number {
            1100..=1135 => {
                if number == 1132 {
                    self.switch_all(number_set.round() as i64, axes);
                } else {
                    let output = u16::try_from(number).unwrap_or(1100);
                    self.switch(output, number_set != 0.0, axes);
                }
                Ok(Written::Done)
            }
            3000 => Ok(Written::Alarm(number_set)),
            3006 => Ok(Written::Stop),
            3001 => {
                self.timer_ms = axes.map_or(0.0, |a| a.seconds() * 1000.0) - number_set;
                Ok(Written::Done)
            }
            3002 => {
                self.timer_h = axes.map_or(0.0, |a| a.seconds() / 3600.0) - number_set;
                Ok(Written::Done)
            }
            3003 | 3004 | 3901 | 3902 => {
                self.stored.insert(number, number_set);
                Ok(Written::Done)
            }
            _ if self.read(number, None).is_ok() => Err(Fault::ps(
                116,
                format!("#{number} can only be read: nothing can be put into it"),
            )),
            _ => Err(no_variable(number)),
        }
    }

    /// The 32 outputs as one number, two's complement.
    fn switch_all(&mut self, word: i64, axes: Option<&mut dyn AxisDrives>) {
        let outputs = (0..32u16).map(|bit| (1100 + bit, (word >> bit) & 1 == 1));
        match axes {
            Some(axes) => outputs.for_each(|(n, is_on)| self.switch(n, is_on, Some(&mut *axes))),
            None => outputs.for_each(|(n, is_on)| self.switch(n, is_on, None)),
        }
    }

    fn switch(&mut self, output: u16, is_on: bool, axes: Option<&mut dyn AxisDrives>) {
        if is_on {
            self.outputs.insert(u32::from(output));
        } else {
            self.outputs.remove(&u32::from(output));
        }
        if let Some(axes) = axes {
            axes.output(output, is_on);
        }
    }

    /// A named parameter, or one of LinuxCNC's own.
    pub(crate) fn read_named(&self, name: &str) -> Option<f64> {
        self.read_predefined(name)
            .or_else(|| self.variables.named(self.level(), name))
    }

    /// A named parameter of LinuxCNC's own: it can only be read.
    pub(crate) fn read_predefined(&self, name: &str) -> Option<f64> {
        let unit = self.modal.unit_mm();
        let at = || self.frame().undo(self.seen.carried);
        match name {
            "_x" => Some(at().x / unit),
            "_y" => Some(at().y / unit),
            "_z" => Some(at().z / unit),
            "_abs_x" => Some(self.seen.position.mm.x / unit),
            "_abs_y" => Some(self.seen.position.mm.y / unit),
            "_abs_z" => Some(self.seen.position.mm.z / unit),
            "_feed" => Some(self.modal.feed.unwrap_or(0.0) / unit),
            "_feed_override" => Some(on(!self.modal.has_no_override)),
            "_rpm" => Some(self.modal.s),
            "_metric" => Some(on(!self.modal.is_inch)),
            "_imperial" => Some(on(self.modal.is_inch)),
            "_absolute" => Some(on(!self.modal.is_incremental)),
            "_incremental" => Some(on(self.modal.is_incremental)),
            // Cutter compensation is refused, so it is G40 always.
            "_ccomp" => Some(400.0),
            "_value" => Some(self.returned),
            "_current_tool" => Some(f64::from(self.modal.tool)),
            "_call_level" => Some(f64::from(u32::try_from(self.stack.len()).unwrap_or(0)) - 1.0),
            _ => None,
        }
    }
}

/// A coordinate in units of the program.
fn component(mm: &[f64; 3], axis: usize, unit_mm: f64) -> Option<f64> {
    mm.get(axis).map(|value| value / unit_mm)
}
