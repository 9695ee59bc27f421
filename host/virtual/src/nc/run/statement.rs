//! Statements: assignments, jumps, loops, printing.

use std::sync::Arc;

use super::control::{Control, Go};
use super::system::{View, Written};
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::motion::AxisDrives;
use crate::nc::memory::settings::ControlFamily;
use crate::nc::text::block::{Block, Statement};
use crate::nc::text::dprnt::{DC2, DC4};
use crate::nc::text::evaluate::{evaluate, holds, variable_number, whole};
use crate::nc::text::expression::Expr;
use crate::nc::text::program::Program;

impl Control {
    /// Carries out a statement.
    pub(crate) fn execute(
        &mut self,
        program: &Arc<Program>,
        index: usize,
        block: &Block,
        statement: &Statement,
        axes: &mut dyn AxisDrives,
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
                    axes.print(&[DC2])?;
                }
                self.is_open = true;
                Ok(Go::Next)
            }
            Statement::Close => {
                if self.is_open && self.settings.dc_codes {
                    axes.print(&[DC4])?;
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
        self.settings.dialect == ControlFamily::Haas
    }

    pub(crate) fn view<'a>(&'a self, axes: &'a dyn AxisDrives) -> View<'a> {
        View {
            control: self,
            axes,
        }
    }

    pub(crate) fn value(&self, expr: &Expr, axes: &dyn AxisDrives) -> Checked<Option<f64>> {
        evaluate(expr, &self.view(axes))
    }

    pub(crate) fn holds(&self, condition: &Expr, axes: &dyn AxisDrives) -> Checked<bool> {
        holds(condition, &self.view(axes))
    }

    /// Puts a value into what stands left of `=`.
    fn assign(
        &mut self,
        target: &Expr,
        value: Option<f64>,
        block: &Block,
        axes: &mut dyn AxisDrives,
    ) -> Checked<Option<Go>> {
        let number = match target {
            Expr::Named(name) => {
                if self.read_predefined(name).is_some() {
                    return Err(Fault::new(format!("#<{name}> can only be read")));
                }
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
                    ControlFamily::Fanuc => Some(3000),
                    ControlFamily::Haas => Some(1000),
                    _ => None,
                };
                Err(match (base, whole(n, 999)) {
                    (Some(base), Some(n)) => Fault::own(base + n, message),
                    _ => Fault::new(format!("#3000={n}: {message}")),
                })
            }
        }
    }

    fn jump(
        &self,
        program: &Program,
        index: usize,
        target: &Expr,
        axes: &dyn AxisDrives,
    ) -> Checked<Go> {
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
}
