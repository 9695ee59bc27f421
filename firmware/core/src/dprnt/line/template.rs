//! A job's own line format: its text with fields in braces.

use umi_protocol::job::Name;
use umi_protocol::pattern::TemplatePattern;

use super::fields::{Fields, Outcome};
use super::number::{Cursor, Issue, is_blank};

/// A field of a template.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::dprnt) enum Field {
    /// A coordinate: 0 X, 1 Y, 2 Z.
    Axis(u8),
    Index,
    Name,
    Feed,
    Touched,
    Skip,
}

impl Field {
    /// How many there are.
    pub const COUNT: usize = 8;

    fn named(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"x" => Self::Axis(0),
            b"y" => Self::Axis(1),
            b"z" => Self::Axis(2),
            b"i" => Self::Index,
            b"name" => Self::Name,
            b"feed" => Self::Feed,
            b"touched" => Self::Touched,
            b"skip" => Self::Skip,
            _ => return None,
        })
    }

    /// A number of its own for each field.
    pub fn place(self) -> usize {
        match self {
            Self::Axis(axis) => usize::from(axis),
            Self::Index => 3,
            Self::Name => 4,
            Self::Feed => 5,
            Self::Touched => 6,
            Self::Skip => 7,
        }
    }
}

/// A piece of a template.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::dprnt) enum Part {
    Literal(u8),
    Blank,
    Field(Field),
    /// A field with an unknown name.
    Unknown,
    /// An opening brace without a closing one.
    Malformed,
}

/// The pieces of a template, in order.
#[derive(Clone, Copy, Debug)]
pub(in crate::dprnt) struct Parts<'a> {
    rest: &'a [u8],
}

impl<'a> Parts<'a> {
    pub const fn new(text: &'a [u8]) -> Self {
        Self { rest: text }
    }
}

impl Iterator for Parts<'_> {
    type Item = Part;

    fn next(&mut self) -> Option<Part> {
        let (first, rest) = self.rest.split_first()?;
        self.rest = rest;
        Some(match first {
            b'{' => {
                let Some(end) = rest.iter().position(|b| *b == b'}') else {
                    self.rest = &[];
                    return Some(Part::Malformed);
                };
                let name = rest.get(..end).unwrap_or_default();
                self.rest = rest.get(end + 1..).unwrap_or_default();
                Field::named(name).map_or(Part::Unknown, Part::Field)
            }
            byte if is_blank(*byte) => Part::Blank,
            byte => Part::Literal(*byte),
        })
    }
}

/// True for the characters of a name.
pub(in crate::dprnt) const fn is_name_byte(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-' | b'.')
}

/// Tries a line. Every part must fit, and nothing may be left over.
pub(in crate::dprnt) fn read(template: &TemplatePattern, text: &[u8]) -> Outcome {
    let mut cursor = Cursor::new(text);
    cursor.blanks();
    let mut fields = Fields::default();
    let mut parts = Parts::new(template.text.as_bytes());
    while let Some(part) = parts.next() {
        let fits = match part {
            Part::Blank => {
                cursor.blanks();
                true
            }
            Part::Literal(byte) => cursor.take(byte),
            Part::Field(Field::Skip) => {
                let end = parts.clone().find_map(|part| match part {
                    Part::Literal(byte) => Some(byte),
                    _ => None,
                });
                cursor.take_while(|b| Some(b) != end);
                true
            }
            Part::Field(field) => match read_field(field, &mut cursor, &mut fields) {
                Ok(fits) => fits,
                Err(issue) => return fields.almost(issue),
            },
            Part::Unknown | Part::Malformed => false,
        };
        if !fits {
            return fields.surplus(cursor);
        }
    }
    if cursor.at_end() {
        fields.into_point(template.format)
    } else {
        fields.surplus(cursor)
    }
}

/// Reads one field; false if the line does not fit.
fn read_field(field: Field, cursor: &mut Cursor<'_>, fields: &mut Fields) -> Result<bool, Issue> {
    match field {
        Field::Axis(axis) => {
            let number = cursor.number()?;
            if let Some(place) = fields.axes.get_mut(usize::from(axis)) {
                *place = Some(number);
            }
        }
        Field::Index => fields.index = Some(cursor.whole(u32::MAX)?),
        Field::Feed => fields.feed_mm_per_min = Some(cursor.number()?.value),
        Field::Touched => fields.touched = Some(cursor.whole(1)? == 1),
        Field::Name => {
            cursor.blanks();
            let name = cursor.take_while(is_name_byte);
            fields.name = core::str::from_utf8(name)
                .ok()
                .and_then(|n| Name::try_from(n).ok());
            return Ok(!name.is_empty() && fields.name.is_some());
        }
        Field::Skip => {}
    }
    Ok(true)
}
