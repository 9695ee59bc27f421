//! LinuxCNC: the flow of O words, and comments that act.

use std::collections::HashMap;
use std::sync::Arc;

use super::control::{Call, Control, Go};
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::motion::AxisDrives;
use crate::nc::memory::settings::ControlFamily;
use crate::nc::memory::variables::Level;
use crate::nc::text::block::Block;
use crate::nc::text::cursor::{Cursor, Line};
use crate::nc::text::expression::{Expr, Parser};
use crate::nc::text::oword::{Flow, OWord};
use crate::nc::text::program::{Link, Program};

impl Control {
    /// Carries out an O word.
    pub(crate) fn o_word(
        &mut self,
        program: &Arc<Program>,
        index: usize,
        word: &OWord,
        axes: &mut dyn AxisDrives,
    ) -> Checked<Go> {
        let link = || {
            program
                .links
                .get(&index)
                .copied()
                .ok_or_else(|| Fault::new(format!("o{} is not closed", word.label)))
        };
        match &word.flow {
            // A subroutine in the way is passed by.
            Flow::Sub => Ok(Go::To(link()?.end + 1)),
            Flow::EndSub(value) | Flow::Return(value) => self.leave_sub(value.as_ref(), axes),
            Flow::Call(arguments) => self.call_sub(&word.label, arguments, axes),
            Flow::If(condition) => {
                let goes_on = self.holds(condition, axes)?;
                self.branch(goes_on, link()?)
            }
            Flow::ElseIf(condition) => {
                if !self.came_to(index) {
                    return Ok(Go::To(link()?.end));
                }
                let goes_on = self.holds(condition, axes)?;
                self.branch(goes_on, link()?)
            }
            Flow::Else => {
                if self.came_to(index) {
                    Ok(Go::Next)
                } else {
                    Ok(Go::To(link()?.end))
                }
            }
            Flow::EndIf => {
                self.came_to(index);
                Ok(Go::Next)
            }
            Flow::While(condition) => {
                let goes_on = self.holds(condition, axes)?;
                let link = link()?;
                // At the end of a `do` it leads back, at the head of a loop forward.
                match (goes_on, link.end == index) {
                    (true, true) => Ok(Go::To(link.begin + 1)),
                    (false, false) => Ok(Go::To(link.end + 1)),
                    _ => Ok(Go::Next),
                }
            }
            Flow::EndWhile => Ok(Go::To(link()?.begin)),
            Flow::Do => Ok(Go::Next),
            Flow::Repeat(count) => {
                let count = self.value(count, axes)?.unwrap_or(0.0);
                let passes = if count >= 1.0 {
                    count.min(1e15) as u64
                } else {
                    0
                };
                self.pass(index, link()?, passes)
            }
            Flow::EndRepeat => {
                let link = link()?;
                let left = self
                    .stack
                    .last()
                    .and_then(|call| call.passes.get(&link.begin).copied())
                    .unwrap_or(0);
                match self.pass(link.begin, link, left)? {
                    Go::Next => Ok(Go::To(link.begin + 1)),
                    _ => Ok(Go::Next),
                }
            }
            Flow::Break | Flow::Continue => {
                let loop_at = link()?.begin;
                let link = program
                    .links
                    .get(&loop_at)
                    .copied()
                    .ok_or_else(|| Fault::new(format!("o{} is not closed", word.label)))?;
                Ok(Go::To(if word.flow == Flow::Break {
                    link.end + 1
                } else {
                    // The end of the loop decides what comes next.
                    link.end
                }))
            }
        }
    }

    /// One pass fewer to go: on with the block behind, or behind the end.
    fn pass(&mut self, begin: usize, link: Link, passes: u64) -> Checked<Go> {
        let Some(call) = self.stack.last_mut() else {
            return Ok(Go::Next);
        };
        match passes.checked_sub(1) {
            Some(left) => {
                call.passes.insert(begin, left);
                Ok(Go::Next)
            }
            None => {
                call.passes.remove(&begin);
                Ok(Go::To(link.end + 1))
            }
        }
    }

    /// Into a branch, or on to the next one.
    fn branch(&mut self, goes_in: bool, link: Link) -> Checked<Go> {
        if goes_in {
            return Ok(Go::Next);
        }
        if let Some(call) = self.stack.last_mut() {
            call.branch = Some(link.next);
        }
        Ok(Go::To(link.next))
    }

    /// Whether a false condition led to this block; forgets it.
    fn came_to(&mut self, index: usize) -> bool {
        self.stack
            .last_mut()
            .is_some_and(|call| call.branch.take() == Some(index))
    }

    fn call_sub(
        &mut self,
        label: &str,
        arguments: &[Expr],
        axes: &mut dyn AxisDrives,
    ) -> Checked<Go> {
        let program = self
            .subs
            .get(label)
            .and_then(|number| self.programs.get(number))
            .cloned()
            .ok_or_else(|| Fault::new(format!("o{label} is no subroutine in memory")))?;
        let begin = program
            .subs
            .get(label)
            .map(|sub| sub + 1)
            .ok_or_else(|| Fault::new(format!("o{label} is no subroutine in memory")))?;
        let mut level = Level::default();
        for (index, argument) in arguments.iter().enumerate() {
            level.set(index + 1, self.value(argument, axes)?);
        }
        self.push(
            Call {
                program,
                next: begin,
                begin,
                repeats: 0,
                has_level: true,
                arguments: Level::default(),
                is_modal: false,
                passes: HashMap::new(),
                branch: None,
            },
            Some(level),
        )?;
        Ok(Go::Called)
    }

    fn leave_sub(&mut self, value: Option<&Expr>, axes: &mut dyn AxisDrives) -> Checked<Go> {
        if let Some(value) = value {
            self.returned = self.value(value, axes)?.unwrap_or(0.0);
        }
        if self.stack.len() < 2 {
            return Err(Fault::new("a return outside a subroutine"));
        }
        self.count_backwards()?;
        self.pop();
        Ok(Go::Called)
    }

    /// Carries out the comments that act: MSG, DEBUG, PRINT, LOG, LOGOPEN, LOGCLOSE,
    /// LOGAPPEND, PROBEOPEN, PROBECLOSE, ABORT. What they say goes out as lines.
    pub(crate) fn comments(&mut self, block: &Block, axes: &mut dyn AxisDrives) -> Checked<()> {
        if self.settings.dialect != ControlFamily::LinuxCnc {
            return Ok(());
        }
        for comment in &block.comments {
            let comment = comment.trim_start();
            let end = comment
                .find(|c: char| !c.is_ascii_alphabetic())
                .unwrap_or(comment.len());
            let (word, rest) = comment.split_at_checked(end).unwrap_or((comment, ""));
            let text = rest.strip_prefix(',');
            match (word.to_ascii_uppercase().as_str(), text) {
                ("MSG", Some(text)) => axes.print(format!("{text}\n").as_bytes())?,
                ("DEBUG" | "PRINT", Some(text)) => self.say(text, axes)?,
                ("LOG", Some(text)) if self.is_logging => self.say(text, axes)?,
                ("LOGOPEN" | "LOGAPPEND", Some(_)) => self.is_logging = true,
                ("LOGCLOSE", None) => self.is_logging = false,
                ("PROBEOPEN", None) => {
                    self.logs_probes = true;
                    self.logged = None;
                }
                ("PROBECLOSE", None) => self.logs_probes = false,
                ("ABORT", Some(text)) => {
                    let text = self.filled(text, axes)?;
                    return Err(Fault::new(format!("the program says: {}", text.trim())));
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn say(&self, text: &str, axes: &mut dyn AxisDrives) -> Checked<()> {
        let line = self.filled(text, axes)?;
        axes.print(format!("{line}\n").as_bytes())?;
        Ok(())
    }

    /// A text with the values of its parameters: six decimals, `%d` whole numbers, `%f`
    /// four decimals, `%.nf` n decimals from there on, `%lf` six again.
    fn filled(&self, text: &str, axes: &dyn AxisDrives) -> Checked<String> {
        let mut out = String::new();
        let mut decimals = 6;
        let mut rest = text;
        while let Some(at) = rest.find(['#', '%']) {
            let (before, from) = rest.split_at_checked(at).unwrap_or((rest, ""));
            out.push_str(before);
            if let Some((places, after)) = format_of(from) {
                decimals = places;
                rest = after;
            } else if let Some(after) = from.strip_prefix('#') {
                let line = Line::new(after, ControlFamily::LinuxCnc)?;
                let mut cursor = Cursor::new(&line);
                let variable = Parser::new(&mut cursor, ControlFamily::LinuxCnc).variable(0)?;
                let used = cursor.used();
                let value = self.value(&variable, axes)?.unwrap_or(0.0);
                out.push_str(&format!("{value:.decimals$}"));
                rest = after.get(used..).unwrap_or("");
            } else {
                out.push('%');
                rest = from.get(1..).unwrap_or("");
            }
        }
        out.push_str(rest);
        Ok(out)
    }
}

/// A format at the beginning of a text: its decimals, and what follows.
fn format_of(text: &str) -> Option<(usize, &str)> {
    let rest = text.strip_prefix('%')?;
    if let Some(rest) = rest.strip_prefix('d') {
        return Some((0, rest));
    }
    if let Some(rest) = rest.strip_prefix("lf") {
        return Some((6, rest));
    }
    if let Some(rest) = rest.strip_prefix('f') {
        return Some((4, rest));
    }
    let rest = rest.strip_prefix('.')?;
    let digit = rest.chars().next()?.to_digit(10)?;
    let rest = rest.get(1..)?.strip_prefix('f')?;
    Some((usize::try_from(digit).ok()?, rest))
}
