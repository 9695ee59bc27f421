//! Calls: G65, G66, M97, M98, and returns: M99.

use std::collections::HashMap;
use std::sync::Arc;

use super::control::{Call, Control, Go, ModalCall, read};
use super::words::Words;
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::motion::AxisDrives;
use crate::nc::memory::settings::{ControlFamily, DecimalPoint};
use crate::nc::memory::variables::Level;
use crate::nc::text::block::Word;
use crate::nc::text::evaluate::{evaluate, whole};
use crate::nc::text::program::Program;

/// Repetitions of a call (L).
const MAX_REPEATS: u32 = 9999;

/// The local variable of an address in the first form of arguments.
fn first_form(letter: u8) -> Option<usize> {
    Some(match letter {
        b'A' => 1,
        b'B' => 2,
        b'C' => 3,
        b'I' => 4,
        b'J' => 5,
        b'K' => 6,
        b'D' => 7,
        b'E' => 8,
        b'F' => 9,
        b'H' => 11,
        b'M' => 13,
        b'Q'..=b'Z' => usize::from(letter - b'Q') + 17,
        _ => return None,
    })
}

impl Control {
    /// `G65 P_ L_` with arguments; `G66` the same, after each motion from here on. Each
    /// repetition (L) begins with the arguments again.
    pub(crate) fn macro_call(&mut self, words: &[Word], axes: &mut dyn AxisDrives) -> Checked<Go> {
        let is_modal = match words.first() {
            Some(word) => {
                let code = evaluate(&word.value, &self.view(axes))?;
                code.and_then(|v| whole(v, 999)) == Some(66)
            }
            None => false,
        };
        let mut program = None;
        let mut repeats = 1;
        let mut arguments = Vec::new();
        // Groups of I J K seen so far, and the last of their letters.
        let (mut group, mut last) = (0usize, b'L');
        for word in words.iter().skip(1) {
            let value = evaluate(&word.value, &self.view(axes)).map_err(|f| f.at(word.at))?;
            match word.letter {
                b'P' | b'L' => {
                    let Some(value) = value else { continue };
                    let (largest, what) = match word.letter {
                        b'P' => (99_999_999, "the number of a program"),
                        _ => (MAX_REPEATS, "how often"),
                    };
                    let number = whole(value, largest).ok_or_else(|| {
                        Fault::new(format!(
                            "{}{value}: {what} is a whole number from 0 to {largest}",
                            word.letter as char
                        ))
                        .at(word.at)
                    })?;
                    if word.letter == b'P' {
                        program = Some(number);
                    } else {
                        repeats = number;
                    }
                }
                b'G' | b'N' | b'O' => {
                    return Err(Fault::ps(
                        129,
                        format!("{} cannot be an argument of a macro", word.letter as char),
                    )
                    .at(word.at));
                }
                letter => {
                    let slot = match letter {
                        b'I' | b'J' | b'K' => {
                            // A letter that does not follow the last one begins a new
                            // group (second form: I J K up to ten times).
                            if letter <= last {
                                group += 1;
                            }
                            last = letter;
                            4 + 3 * (group.saturating_sub(1)) + usize::from(letter - b'I')
                        }
                        letter => first_form(letter).ok_or_else(|| {
                            Fault::new(format!("{} is no argument", letter as char)).at(word.at)
                        })?,
                    };
                    if slot > 33 {
                        return Err(Fault::new("I, J, K come at most ten times").at(word.at));
                    }
                    // A null takes its place, too: behind I#0 a second I is #7.
                    if let Some(value) = value {
                        arguments.push((slot, self.argument(word, value)));
                    }
                }
            }
        }
        let program =
            program.ok_or_else(|| Fault::ps(76, "G65 and G66 need P, the number of the macro"))?;
        if is_modal {
            if self.modal_call.is_some() {
                return Err(Fault::new("G66 inside G66 is not interpreted: G67 first"));
            }
            self.find(program)?;
            self.modal_call = Some(ModalCall {
                program,
                repeats,
                arguments,
            });
            return Ok(Go::Next);
        }
        if repeats == 0 {
            return Ok(Go::Next);
        }
        self.enter_macro(program, repeats, &arguments, false)?;
        Ok(Go::Called)
    }

    /// An argument: a number without a point counts in increments where lengths and
    /// angles stand, as it does in a motion.
    fn argument(&self, word: &Word, value: f64) -> f64 {
        let is_length = matches!(
            word.letter,
            b'A'..=b'C' | b'I'..=b'K' | b'Q' | b'R' | b'U'..=b'Z'
        );
        if word.is_without_point
            && is_length
            && self.settings.decimal_point == DecimalPoint::Increments
        {
            let step = self.settings.increment(self.modal.is_inch).unwrap_or(1.0);
            self.settings.rounded(value * step, self.modal.is_inch)
        } else {
            value
        }
    }

    /// Calls the macro of `G66` after a motion.
    pub(crate) fn call_after_motion(&mut self) -> Checked<Go> {
        let Some(call) = self.modal_call.clone() else {
            return Ok(Go::Next);
        };
        if call.repeats == 0 || self.stack.iter().any(|call| call.is_modal) {
            return Ok(Go::Next);
        }
        self.enter_macro(call.program, call.repeats, &call.arguments, true)?;
        Ok(Go::Called)
    }

    fn find(&self, number: u32) -> Checked<Arc<Program>> {
        self.programs
            .get(&number)
            .cloned()
            .ok_or_else(|| Fault::ps(76, format!("O{number:04} is not in memory: load it")))
    }

    fn enter_macro(
        &mut self,
        number: u32,
        repeats: u32,
        arguments: &[(usize, f64)],
        is_modal: bool,
    ) -> Checked<()> {
        let program = self.find(number)?;
        let mut level = Level::default();
        for (slot, value) in arguments {
            level.set(*slot, Some(*value));
        }
        self.push(
            Call {
                program,
                next: 0,
                begin: 0,
                repeats: repeats.saturating_sub(1),
                has_level: true,
                arguments: level.clone(),
                is_modal,
                passes: HashMap::new(),
                branch: None,
            },
            Some(level),
        )
    }

    /// Goes one level deeper; the caller goes on behind its block afterwards.
    pub(crate) fn push(&mut self, call: Call, level: Option<Level>) -> Checked<()> {
        let limits = &self.settings.limits;
        let is_macro = call.has_level && self.settings.dialect.is_macro_b();
        // Below the main program; macros and subprograms are counted apart.
        let depth = self
            .stack
            .iter()
            .skip(1)
            .filter(|other| other.has_level == call.has_level)
            .count();
        let (most, what) = if is_macro {
            (limits.macro_depth, "macros (G65, G66)")
        } else if self.settings.dialect.is_macro_b() {
            (limits.call_depth, "subprograms (M98)")
        } else {
            (limits.call_depth, "subroutines")
        };
        if depth >= most {
            return Err(Fault::ps(
                77,
                format!("more than {most} {what} inside each other"),
            ));
        }
        if let Some(caller) = self.stack.last_mut() {
            caller.next += 1;
        }
        self.levels.extend(level);
        self.stack.push(call);
        Ok(())
    }

    /// `M98 P_ L_`, also `P` with the repetitions before the four digits of the program;
    /// `M97 P_ L_` to a block of this program (Haas).
    pub(crate) fn sub_call(&mut self, m: u32, words: &Words) -> Checked<Go> {
        if !self.settings.dialect.is_macro_b() {
            return Err(Fault::new(format!("M{m} is not a code of this control")));
        }
        let p = words
            .whole(b'P', 99_999_999)?
            .ok_or_else(|| Fault::ps(76, format!("M{m} needs P")))?;
        let l = words.whole(b'L', MAX_REPEATS)?;
        let (program, begin, repeats) = if m == 97 {
            if self.settings.dialect != ControlFamily::Haas {
                return Err(Fault::new("M97 is not a code of this control: M98"));
            }
            let call = self
                .stack
                .last()
                .ok_or_else(|| Fault::new("no program is running"))?;
            let program = Arc::clone(&call.program);
            let begin = program
                .find(p, 0)
                .ok_or_else(|| Fault::ps(78, format!("no block N{p} in this program")))?;
            (program, begin, l.unwrap_or(1))
        } else {
            let (number, repeats) = match l {
                Some(l) => (p, l),
                None if p > 9999 && !self.programs.contains_key(&p) => (p % 10_000, p / 10_000),
                None => (p, 1),
            };
            (self.find(number)?, 0, repeats)
        };
        if repeats == 0 {
            return Ok(Go::Next);
        }
        self.push(
            Call {
                program,
                next: begin,
                begin,
                repeats: repeats - 1,
                has_level: false,
                arguments: Level::default(),
                is_modal: false,
                passes: HashMap::new(),
                branch: None,
            },
            None,
        )?;
        Ok(Go::Called)
    }

    /// `M198 P_`: a subprogram that is read from an external device and carried out, once.
    /// It is not kept in memory: each call reads it anew.
    pub(crate) fn external_call(
        &mut self,
        words: &Words,
        axes: &mut dyn AxisDrives,
    ) -> Checked<Go> {
        if !self.settings.dialect.is_macro_b() {
            return Err(Fault::new("M198 is not a code of this control"));
        }
        let number = words
            .whole(b'P', 99_999_999)?
            .ok_or_else(|| Fault::ps(76, "M198 needs P"))?;
        let Some(bytes) = axes.external_program(number)? else {
            return Err(Fault::new(
                "M198: there is no external device, load the program and call it with M98",
            ));
        };
        let text = String::from_utf8_lossy(&bytes);
        let mut programs = read(&text, &self.settings)?;
        let wanted = programs.iter().position(|program| program.number == number);
        let Some(place) = wanted else {
            return Err(Fault::ps(
                79,
                format!("M198: the device has sent a program, but not O{number:04}"),
            ));
        };
        let program = Arc::new(programs.swap_remove(place));
        self.push(
            Call {
                program,
                next: 0,
                begin: 0,
                repeats: 0,
                has_level: false,
                arguments: Level::default(),
                is_modal: false,
                passes: HashMap::new(),
                branch: None,
            },
            None,
        )?;
        Ok(Go::Called)
    }

    /// `M99`: back to the caller, or to its block `P`; in the main program to its
    /// beginning, or to block `P`.
    pub(crate) fn return_from(&mut self, words: &Words) -> Checked<Go> {
        if !self.settings.dialect.is_macro_b() {
            return Err(Fault::new("M99 is not a code of this control"));
        }
        let p = words.whole(b'P', 99_999_999)?;
        self.count_backwards()?;
        if let Some(call) = self.stack.last_mut()
            && call.repeats > 0
            && p.is_none()
        {
            call.repeats -= 1;
            call.next = call.begin;
            if call.has_level {
                let arguments = call.arguments.clone();
                *self.level_mut() = arguments;
            }
            return Ok(Go::Called);
        }
        if self.stack.len() > 1 {
            self.pop();
        } else if p.is_none() {
            self.main_repeats += 1;
            if self.main_repeats > self.settings.limits.main_repeats {
                return Err(Fault::new(
                    "M99 in the main program begins it again without end: end it with M30, call \
                     it with M98 or G65, or raise `main_repeats` in the scene's \
                     [control.nc.limits]",
                ));
            }
            return Ok(Go::To(0));
        }
        if let (Some(n), Some(call)) = (p, self.stack.last_mut()) {
            call.next = call
                .program
                .find(n, 0)
                .ok_or_else(|| Fault::ps(78, format!("no block N{n} to return to")))?;
        }
        Ok(Go::Called)
    }

    /// Ends the innermost call.
    pub(crate) fn pop(&mut self) {
        if let Some(call) = self.stack.pop()
            && call.has_level
            && let Some(level) = self.levels.pop()
        {
            self.variables.forget(&level);
        }
    }

    /// Behind the last block.
    pub(crate) fn end_of_text(&mut self) -> Checked<Go> {
        match self.settings.dialect {
            ControlFamily::LinuxCnc | ControlFamily::Grbl => Ok(Go::End),
            _ => Err(Fault::ps(
                5010,
                "the program has no end: write M30, or M99 in a subprogram",
            )),
        }
    }
}
