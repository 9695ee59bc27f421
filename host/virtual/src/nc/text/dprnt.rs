//! `DPRNT` and `BPRNT`: their formats, and the bytes that leave.
//!
//! The rules and their sources:
//!
//! * Brother NC programming manual eCOM3NCPR6 (2019), 6.6: an asterisk is a blank and a
//!   literal blank is not sent; a null counts as zero; digits above the places given are
//!   not sent; decimals are rounded; the sign is that of the value before rounding; a
//!   single digit in the brackets gives the decimals and no place for the whole part.
//!   A blank for each leading zero and for a plus sign, or neither. Fanuc's manual text
//!   says the same of parameter 6001#1 (PRT). The sign stands before the blanks.
//! * Haas manual 96-8000: fewer digits get leading blanks, more digits expand the field,
//!   one place at least for the whole part, one to eight places in all. Where the sign
//!   of a padded number stands is not documented; here it is next to the digits.
//!   Literal blanks are sent.

use umi_core::dprnt::encode;
use umi_protocol::pattern::Coding;

use super::cursor::Cursor;
use super::evaluate::{Lookup, evaluate};
use super::expression::{Expr, Parser};
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::settings::{ControlFamily, ControlSettings};

/// DC2, sent by `POPEN`: punch on.
pub(crate) const DC2: u8 = 0x12;
/// DC4, sent by `PCLOS`: punch off.
pub(crate) const DC4: u8 = 0x14;

/// Text or binary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// `DPRNT`.
    Decimal,
    /// `BPRNT`.
    Binary,
}

/// What a statement prints.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Format {
    kind: Kind,
    items: Vec<Item>,
}

#[derive(Clone, Debug, PartialEq)]
enum Item {
    Character(u8),
    Value {
        variable: Expr,
        whole: u32,
        decimals: u32,
    },
}

/// Variables in one block (Brother).
const MAX_VARIABLES: usize = 10;

impl Format {
    /// The variables that it prints.
    pub fn variables(&self) -> impl Iterator<Item = &Expr> {
        self.items.iter().filter_map(|item| match item {
            Item::Value { variable, .. } => Some(variable),
            Item::Character(_) => None,
        })
    }

    /// Reads what stands behind `DPRNT` or `BPRNT`, with warnings. A bracket that is not
    /// closed ends with the line: the programs of the thesis' appendix C ran so.
    pub fn read(
        cursor: &mut Cursor<'_>,
        kind: Kind,
        dialect: ControlFamily,
    ) -> Checked<(Self, Vec<Fault>)> {
        let start = cursor.at();
        if kind == Kind::Binary && dialect != ControlFamily::Fanuc {
            return Err(Fault::new("this control has no BPRNT: use DPRNT").at(start));
        }
        cursor.expect(b'[', 114, "behind DPRNT or BPRNT")?;
        let mut items = Vec::new();
        let mut warnings = Vec::new();
        let mut variables = 0;
        loop {
            match cursor.peek_raw() {
                None => {
                    warnings.push(
                        Fault::warning(
                            "the bracket is not closed: not every control takes that, write `]`",
                        )
                        .at(start),
                    );
                    break;
                }
                Some(b']') => {
                    cursor.next_raw();
                    break;
                }
                Some(b'#') => {
                    let at = cursor.at();
                    variables += 1;
                    if variables > MAX_VARIABLES {
                        return Err(Fault::new("more than ten variables: split the line").at(at));
                    }
                    cursor.next_raw();
                    items.push(value(cursor, kind, dialect, &mut warnings)?);
                }
                Some(byte) => {
                    // The index is that of a character, blanks included.
                    cursor.next_raw();
                    if let Some(character) = character(byte, dialect)? {
                        items.push(Item::Character(character));
                    }
                }
            }
        }
        Ok((Self { kind, items }, warnings))
    }

    /// The bytes on the wire, the end of line included.
    pub fn bytes(&self, from: &dyn Lookup, settings: &ControlSettings) -> Checked<Vec<u8>> {
        let mut out = Vec::new();
        for item in &self.items {
            match item {
                Item::Character(byte) => send(&mut out, &[*byte], settings.coding)?,
                Item::Value {
                    variable,
                    whole,
                    decimals,
                } => {
                    let value = evaluate(variable, from)?.unwrap_or(0.0);
                    match self.kind {
                        Kind::Decimal => {
                            let text = decimal(value, *whole, *decimals, settings);
                            send(&mut out, text.as_bytes(), settings.coding)?;
                        }
                        Kind::Binary => out.extend(binary(value, *decimals)?),
                    }
                }
            }
        }
        end_line(&mut out, settings)?;
        Ok(out)
    }
}

/// The character to send, none for a blank that this control leaves out.
fn character(byte: u8, dialect: ControlFamily) -> Checked<Option<u8>> {
    match byte {
        b'*' => Ok(Some(b' ')),
        b' ' => Ok((dialect == ControlFamily::Haas).then_some(b' ')),
        b'\t' | b'\r' => Ok(None),
        b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' => Ok(Some(byte)),
        b'+' | b'-' | b'/' | b'.' | b',' | b'(' | b')' | b'=' | b'?' | b':' => Ok(Some(byte)),
        b'@' | b'&' | b'_' if dialect == ControlFamily::Fanuc => Ok(Some(byte)),
        b'{' | b'}' | b'_' if dialect == ControlFamily::Haas => Ok(Some(byte)),
        _ => Err(Fault::new(format!(
            "`{}` cannot be printed by this control",
            byte.escape_ascii()
        ))),
    }
}

/// A field behind its `#`.
fn value(
    cursor: &mut Cursor<'_>,
    kind: Kind,
    dialect: ControlFamily,
    warnings: &mut Vec<Fault>,
) -> Checked<Item> {
    let variable = Parser::new(cursor, dialect).variable(0)?;
    let at = cursor.at();
    cursor.expect(b'[', 114, "and the places of the number, as [53]")?;
    let mut places = Vec::new();
    while let Some(byte) = cursor.peek().filter(u8::is_ascii_digit) {
        cursor.take(byte);
        places.push(u32::from(byte - b'0'));
    }
    cursor.expect(b']', 114, "behind the places")?;
    let (whole, decimals) = match (kind, places.as_slice()) {
        (_, [decimals]) => (0, *decimals),
        (Kind::Decimal, [whole, decimals]) => (*whole, *decimals),
        (Kind::Decimal, _) => {
            return Err(Fault::ps(
                114,
                "two digits give the places before and behind the point, as [53]",
            )
            .at(at));
        }
        (Kind::Binary, _) => {
            return Err(Fault::ps(114, "BPRNT takes the number of decimals, as [3]").at(at));
        }
    };
    match whole + decimals {
        0 if kind == Kind::Decimal => {
            return Err(Fault::new("a number needs at least one place").at(at));
        }
        0..=8 => {}
        9 => {
            warnings.push(Fault::warning("nine places: older controls print at most eight").at(at))
        }
        _ => return Err(Fault::new("a number has at most eight places").at(at)),
    }
    Ok(Item::Value {
        variable,
        whole,
        decimals,
    })
}

/// The digits of a number, as [`Format`] says.
fn decimal(value: f64, whole: u32, decimals: u32, settings: &ControlSettings) -> String {
    // The places are at most nine: exact.
    let unit = 10u64.pow(decimals.min(9));
    // A number beyond what 128 bits hold keeps no true digit in a double either.
    let rounded = (value.abs() * unit as f64).round() as u128;
    let unit = u128::from(unit);
    let expands = settings.dialect == ControlFamily::Haas;
    let places = if expands { whole.max(1) } else { whole } as usize;
    let mut front = rounded / unit;
    if !expands {
        front %= 10u128.pow(whole.min(9));
    }
    let mut digits = if places == 0 {
        String::new()
    } else {
        front.to_string()
    };
    let padding = if settings.leading_blanks {
        " ".repeat(places.saturating_sub(digits.len()))
    } else {
        String::new()
    };
    if decimals > 0 {
        let width = decimals as usize;
        digits.push_str(&format!(".{:0width$}", rounded % unit));
    }
    let sign = if value < 0.0 {
        "-"
    } else if settings.leading_blanks && !expands {
        " "
    } else {
        ""
    };
    if expands {
        format!("{padding}{sign}{digits}")
    } else {
        format!("{sign}{padding}{digits}")
    }
}

/// 32 bits, two's complement, the high byte first.
fn binary(value: f64, decimals: u32) -> Checked<[u8; 4]> {
    let scaled = (value * 10u64.pow(decimals.min(9)) as f64).round();
    if scaled.abs() > f64::from(i32::MAX) {
        return Err(Fault::new(format!(
            "{value} with {decimals} decimals has more than 32 bits: print fewer decimals"
        )));
    }
    Ok((scaled as i32).to_be_bytes())
}

/// Appends characters in the code of the line.
pub(crate) fn send(out: &mut Vec<u8>, characters: &[u8], coding: Coding) -> Checked<()> {
    for character in characters {
        out.push(encode(coding, *character).ok_or_else(|| {
            Fault::new(format!(
                "`{}` does not exist in the code {coding}: leave it out",
                character.escape_ascii()
            ))
        })?);
    }
    Ok(())
}

/// Appends the end of line.
pub(crate) fn end_line(out: &mut Vec<u8>, settings: &ControlSettings) -> Checked<()> {
    if settings.coding == Coding::Eia {
        send(out, b"\n", settings.coding)
    } else {
        send(out, settings.line_end.characters(), settings.coding)
    }
}

#[cfg(test)]
#[path = "dprnt_tests.rs"]
mod tests;
