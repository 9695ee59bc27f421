//! The words of a block with their values.

use nalgebra::Vector3;

use super::control::Control;
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::motion::AxisDrives;
use crate::nc::memory::settings::DecimalPoint;
use crate::nc::text::block::Word;
use crate::nc::text::evaluate::{evaluate_word, whole};

/// A word with its value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Given {
    pub letter: u8,
    /// As it is written.
    pub value: f64,
    pub is_without_point: bool,
    pub at: usize,
}

/// The words of a block, G and M apart.
#[derive(Clone, Debug, Default)]
pub(crate) struct Words {
    /// G codes in tenths, with their places.
    pub g: Vec<(u16, usize)>,
    /// M codes, with their places.
    pub m: Vec<(u32, usize)>,
    pub others: Vec<Given>,
}

/// The largest value of a word: no length, feed, speed or number of a program is above it.
const LARGEST_WORD: f64 = 1e12;

/// The addresses of the axes.
pub(crate) const AXES: [u8; 3] = *b"XYZ";

impl Words {
    pub fn get(&self, letter: u8) -> Option<&Given> {
        self.others.iter().find(|given| given.letter == letter)
    }

    pub fn has(&self, letter: u8) -> bool {
        self.get(letter).is_some()
    }

    pub fn has_g(&self, tenths: u16) -> bool {
        self.g.iter().any(|(code, _)| *code == tenths)
    }

    pub fn has_axes(&self) -> bool {
        AXES.iter().any(|axis| self.has(*axis))
    }

    /// A number that stays as it is written.
    pub fn number(&self, letter: u8) -> Option<f64> {
        self.get(letter).map(|given| given.value)
    }

    /// A whole number from 0 on.
    pub fn whole(&self, letter: u8, largest: u32) -> Checked<Option<u32>> {
        let Some(given) = self.get(letter) else {
            return Ok(None);
        };
        whole(given.value, largest).map(Some).ok_or_else(|| {
            Fault::new(format!(
                "{} takes whole numbers from 0 to {largest}, not {}",
                letter as char, given.value
            ))
            .at(given.at)
        })
    }
}

impl Control {
    /// The values of the words of a block. A word whose value is null is left out, its
    /// address included.
    pub(crate) fn given(&self, words: &[Word], axes: &dyn AxisDrives) -> Checked<Words> {
        let mut result = Words::default();
        let increment = self.settings.increment(self.modal.is_inch);
        for word in words {
            let rounds = matches!(word.letter, b'X' | b'Y' | b'Z' | b'I' | b'J' | b'K' | b'R');
            let value = evaluate_word(&word.value, &self.view(axes), increment.filter(|_| rounds))
                .map_err(|fault| fault.at(word.at))?;
            let Some(value) = value else { continue };
            // So that neither a unit nor a sum makes it infinite.
            if value.abs() > LARGEST_WORD {
                return Err(Fault::ps(
                    3,
                    format!("{} is too large: {value:e}", word.letter as char),
                )
                .at(word.at));
            }
            match word.letter {
                b'G' => {
                    let tenths = whole(value * 10.0, 9999)
                        .and_then(|code| u16::try_from(code).ok())
                        .ok_or_else(|| {
                            Fault::ps(10, format!("G{value} is no G code")).at(word.at)
                        })?;
                    result.g.push((tenths, word.at));
                }
                b'M' => {
                    let code = whole(value, 9999)
                        .ok_or_else(|| Fault::new(format!("M{value} is no M code")).at(word.at))?;
                    result.m.push((code, word.at));
                }
                letter => {
                    if result.has(letter) {
                        return Err(Fault::new(format!(
                            "{} comes twice in this block",
                            letter as char
                        ))
                        .at(word.at));
                    }
                    result.others.push(Given {
                        letter,
                        value,
                        is_without_point: word.is_without_point,
                        at: word.at,
                    });
                }
            }
        }
        Ok(result)
    }

    /// A length in mm, rounded to the smallest increment.
    pub(crate) fn length_of(&self, given: &Given) -> f64 {
        self.scaled(given, self.settings.increment_mm) * self.modal.unit_mm()
    }

    /// A length in mm by its address.
    pub(crate) fn length_word(&self, words: &Words, letter: u8) -> Option<f64> {
        words.get(letter).map(|given| self.length_of(given))
    }

    /// An angle in degrees by its address.
    pub(crate) fn angle_word(&self, words: &Words, letter: u8) -> Option<f64> {
        let given = words.get(letter)?;
        let step = self.settings.increment_mm;
        Some(if given.is_without_point && self.counts_increments() {
            given.value * step
        } else {
            given.value
        })
    }

    fn counts_increments(&self) -> bool {
        self.settings.decimal_point == DecimalPoint::Increments
            && self.settings.dialect.is_macro_b()
    }

    fn scaled(&self, given: &Given, step_mm: f64) -> f64 {
        let inch = self.modal.is_inch;
        let value = if given.is_without_point && self.counts_increments() {
            given.value * if inch { step_mm / 10.0 } else { step_mm }
        } else {
            given.value
        };
        self.settings.rounded(value, inch)
    }

    /// Where the axis words lead from here, in the coordinates of the program, mm.
    pub(crate) fn target(&self, words: &Words, from: Vector3<f64>) -> Vector3<f64> {
        let mut to = from;
        for (axis, letter) in AXES.iter().enumerate() {
            if let (Some(value), Some(slot)) = (self.length_word(words, *letter), to.get_mut(axis))
            {
                *slot = if self.modal.is_incremental {
                    *slot + value
                } else {
                    value
                };
            }
        }
        to
    }
}
