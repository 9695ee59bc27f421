//! Checks of the receiver's part of a job.

use core::fmt;

use umi_protocol::pattern::{
    FieldFormat, LabelledWordsPattern, LinePattern, MAX_DIGITS, ReceiverConfig, TemplatePattern,
    Travel,
};

use super::line::template::{Field, Part, Parts, is_name_byte};

/// Why the receiver's part of a job cannot be used. Patterns count from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfigError {
    /// There is no pattern, so no line could ever carry a point.
    NoPatterns,
    /// The idle time-out is zero.
    NoTimeout,
    /// The travel's smallest value is not below its largest, or not a number.
    Travel {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
    },
    /// A format without digits, or with more than can be held.
    Format {
        /// The pattern.
        pattern: u8,
    },
    /// A block pattern without a header word, or with one that is empty, does
    /// not begin with a letter or has blanks in it.
    Header {
        /// The pattern.
        pattern: u8,
    },
    /// A table without rows, or with a height that is not a number.
    Table {
        /// The pattern.
        pattern: u8,
    },
    /// Axes other than X, Y and Z, none, or one twice.
    Axes {
        /// The pattern.
        pattern: u8,
    },
    /// An ignored letter that is not a capital letter, or has a meaning.
    Ignored {
        /// The pattern.
        pattern: u8,
    },
    /// A label or prefix with characters that a control cannot print.
    Label {
        /// The pattern.
        pattern: u8,
    },
    /// A template that cannot be read.
    Template {
        /// The pattern.
        pattern: u8,
        /// What is wrong with it.
        issue: TemplateIssue,
    },
}

/// What is wrong with a template.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TemplateIssue {
    /// A brace without its partner.
    Brace,
    /// A field with a name that does not exist.
    UnknownField,
    /// A field that occurs twice.
    FieldTwice,
    /// Fewer than two coordinates.
    Coordinates,
    /// A field without an end: `{skip}` next to another field, or `{name}` next
    /// to a field or a letter.
    NoEnd,
    /// A character that a control cannot print.
    Character,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoPatterns => {
                f.write_str("no line patterns: say in `patterns` how the control's lines look")
            }
            Self::NoTimeout => {
                f.write_str("idle_timeout_s is 0: give the longest silence between two prints")
            }
            Self::Travel { axis } => write!(
                f,
                "travel_mm of {}: the first value must be below the second",
                ["x", "y", "z"].get(usize::from(*axis)).unwrap_or(&"z")
            ),
            Self::Format { pattern } => write!(
                f,
                "pattern {pattern}: format needs 1 to {MAX_DIGITS} digits in all, and a checked line 4 decimals at most"
            ),
            Self::Header { pattern } => write!(
                f,
                "pattern {pattern}: headers must be words of letters, digits, `_`, `-`, `.` that begin with a letter, at least one"
            ),
            Self::Table { pattern } => write!(
                f,
                "pattern {pattern}: rows must be at least 1, z_mm a number, name a word"
            ),
            Self::Axes { pattern } => write!(
                f,
                "pattern {pattern}: axes must be some of the letters XYZ, each once"
            ),
            Self::Ignored { pattern } => write!(
                f,
                "pattern {pattern}: ignored letters must be capitals other than X, Y, Z, N, P and F"
            ),
            Self::Label { pattern } => write!(
                f,
                "pattern {pattern}: label or prefix has characters that a control cannot print, or is missing"
            ),
            Self::Template { pattern, issue } => write!(f, "pattern {pattern}: {issue}"),
        }
    }
}

impl fmt::Display for TemplateIssue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Brace => "a brace without its partner; fields are written as {x}",
            Self::UnknownField => {
                "an unknown field; there are {x} {y} {z} {i} {name} {feed} {touched} {skip}"
            }
            Self::FieldTwice => "a field occurs twice; use {skip} for what is not needed",
            Self::Coordinates => "at least two of {x} {y} {z} are needed",
            Self::NoEnd => "{skip} and {name} need a text after them, or the end of the line",
            Self::Character => "a character that a control cannot print",
        })
    }
}

impl core::error::Error for ConfigError {}

/// Checks the receiver's part of a job.
///
/// # Errors
/// The first fault found, in the order of the file.
pub fn check_config(config: &ReceiverConfig) -> Result<(), ConfigError> {
    if config.patterns.is_empty() {
        return Err(ConfigError::NoPatterns);
    }
    for (pattern, one) in (1u8..).zip(&config.patterns) {
        check_pattern(pattern, one)?;
    }
    config.travel_mm.map_or(Ok(()), check_travel)?;
    if config.idle_timeout_s == 0 {
        return Err(ConfigError::NoTimeout);
    }
    Ok(())
}

fn check_travel(travel: Travel) -> Result<(), ConfigError> {
    for (axis, [least, most]) in (0u8..).zip(travel.to_array()) {
        if !(least.is_finite() && most.is_finite() && least < most) {
            return Err(ConfigError::Travel { axis });
        }
    }
    Ok(())
}

fn check_pattern(pattern: u8, one: &LinePattern) -> Result<(), ConfigError> {
    let format_error = ConfigError::Format { pattern };
    match one {
        LinePattern::Block(block) => {
            let ok = !block.headers.is_empty() && block.headers.iter().all(|word| is_name(word));
            require(ok, ConfigError::Header { pattern })?;
            require(is_format(block.format), format_error)
        }
        LinePattern::PointLine(line) => {
            let ok = !line.label.trim().is_empty() && is_printable(&line.label);
            require(ok, ConfigError::Label { pattern })?;
            require(is_format(line.format), format_error)
        }
        LinePattern::RingCsv(table) => {
            let ok = table.rows > 0 && table.z_mm.is_finite() && is_name(&table.name);
            require(ok, ConfigError::Table { pattern })?;
            require(is_format(table.format), format_error)
        }
        LinePattern::LabelledWords(words) => check_words(pattern, words),
        LinePattern::GrblProbe | LinePattern::LinuxCncProbe => Ok(()),
        // The check value is computed in units of 0.0001.
        LinePattern::Checked(line) => require(
            is_format(line.format) && line.format.decimals <= 4,
            format_error,
        ),
        LinePattern::Template(text) => {
            check_template(text).map_err(|issue| ConfigError::Template { pattern, issue })?;
            require(text.format.is_none_or(is_format), format_error)
        }
    }
}

fn check_words(pattern: u8, words: &LabelledWordsPattern) -> Result<(), ConfigError> {
    require(is_printable(&words.prefix), ConfigError::Label { pattern })?;
    let axes = words.axes.as_bytes();
    let once = |letter: u8| axes.iter().filter(|a| **a == letter).count() == 1;
    let ok = !axes.is_empty() && axes.iter().all(|a| b"XYZ".contains(a) && once(*a));
    require(ok, ConfigError::Axes { pattern })?;
    let ok = words
        .ignored
        .bytes()
        .all(|b| b.is_ascii_uppercase() && !b"XYZNPF".contains(&b));
    require(ok, ConfigError::Ignored { pattern })?;
    require(
        words.format.is_none_or(is_format),
        ConfigError::Format { pattern },
    )
}

fn check_template(template: &TemplatePattern) -> Result<(), TemplateIssue> {
    let mut seen = [false; Field::COUNT];
    let mut coordinates = 0;
    // The field before, if no text stands between, and whether a blank does.
    let mut before = None;
    let mut blank = false;
    for part in Parts::new(template.text.as_bytes()) {
        match part {
            Part::Malformed | Part::Literal(b'}') => return Err(TemplateIssue::Brace),
            Part::Unknown => return Err(TemplateIssue::UnknownField),
            Part::Literal(byte) => {
                require(byte.is_ascii_graphic(), TemplateIssue::Character)?;
                let swallowed = before == Some(Field::Name) && !blank && is_name_byte(byte);
                require(!swallowed, TemplateIssue::NoEnd)?;
                before = None;
            }
            Part::Blank => blank = true,
            Part::Field(field) => {
                let ends = match before {
                    None => true,
                    Some(Field::Skip) => false,
                    Some(Field::Name) => blank && field != Field::Skip,
                    // `12.3 4` with a lost digit would be `12.3` and a skipped 4.
                    Some(_) => field != Field::Skip,
                };
                require(ends, TemplateIssue::NoEnd)?;
                before = Some(field);
                blank = false;
                coordinates += usize::from(matches!(field, Field::Axis(_)));
                let seen = seen.get_mut(field.place());
                let twice = seen.is_some_and(|seen| core::mem::replace(seen, field != Field::Skip));
                require(!twice, TemplateIssue::FieldTwice)?;
            }
        }
    }
    require(coordinates >= 2, TemplateIssue::Coordinates)
}

const fn require<E: Copy>(ok: bool, error: E) -> Result<(), E> {
    if ok { Ok(()) } else { Err(error) }
}

fn is_format(format: FieldFormat) -> bool {
    let digits = format.integer_digits.saturating_add(format.decimals);
    (1..=MAX_DIGITS).contains(&digits)
}

fn is_printable(text: &str) -> bool {
    text.bytes().all(|b| b == b' ' || b.is_ascii_graphic())
}

/// A word as a header or a name: it begins with a letter.
fn is_name(text: &str) -> bool {
    text.bytes().next().is_some_and(|b| b.is_ascii_alphabetic()) && text.bytes().all(is_name_byte)
}
