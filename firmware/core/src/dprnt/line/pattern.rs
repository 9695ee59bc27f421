//! The built-in line patterns: whether a line fits, and what it carries.

use umi_protocol::fault::NumberIssue;
use umi_protocol::job::Name;
use umi_protocol::pattern::{
    BlockPattern, FieldFormat, LabelledWordsPattern, LinePattern, PointLinePattern, Word,
};

use super::fields::{Fields, Outcome};
use super::number::{Cursor, Issue};
use super::{checked, template};

/// Tries a line on a pattern that needs nothing but this line. Blocks and
/// tables are in [`crate::dprnt::stream::block`].
pub(in crate::dprnt) fn read(pattern: &LinePattern, text: &[u8]) -> Outcome {
    match pattern {
        LinePattern::Block(_) | LinePattern::RingCsv(_) => Outcome::None,
        LinePattern::PointLine(line) => point_line(line, text),
        LinePattern::LabelledWords(words) => labelled_words(words, text),
        LinePattern::GrblProbe => grbl_probe(text),
        LinePattern::LinuxCncProbe => linuxcnc_probe(text),
        LinePattern::Checked(line) => checked::read(line.format, text),
        LinePattern::Template(line) => template::read(line, text),
    }
}

/// Whether a line that fits this pattern is known to be whole without a line
/// end: its last number has a fixed number of decimals, or it has an end mark.
pub(in crate::dprnt) const fn shows_its_end(pattern: &LinePattern) -> bool {
    match pattern {
        LinePattern::LabelledWords(words) => words.format.is_some(),
        LinePattern::Template(line) => line.format.is_some(),
        LinePattern::Block(_)
        | LinePattern::PointLine(_)
        | LinePattern::RingCsv(_)
        | LinePattern::GrblProbe
        | LinePattern::LinuxCncProbe
        | LinePattern::Checked(_) => true,
    }
}

/// Three numbers of this format and nothing else.
pub(in crate::dprnt) fn three_numbers(format: FieldFormat, text: &[u8]) -> Outcome {
    match Fields::three(&mut Cursor::new(text)) {
        Ok(fields) => fields.into_point(Some(format)),
        Err(issue) => Outcome::Bad(issue),
    }
}

/// The name in a block's header line: one of the words, or one of them and a
/// number.
pub(in crate::dprnt) fn header(block: &BlockPattern, text: &[u8]) -> Option<Name> {
    let mut cursor = Cursor::new(text);
    cursor.blanks();
    let word = cursor.take_while(template::is_name_byte);
    if !cursor.at_end() {
        return None;
    }
    let fits = |header: &Word| {
        let number = word.strip_prefix(header.as_bytes());
        number.is_some_and(|number| number.iter().all(u8::is_ascii_digit))
    };
    if !block.headers.iter().any(fits) {
        return None;
    }
    let name = core::str::from_utf8(word).ok()?;
    Name::try_from(name).ok()
}

/// `POINT: x y z`
fn point_line(line: &PointLinePattern, text: &[u8]) -> Outcome {
    let mut cursor = Cursor::new(text);
    cursor.blanks();
    if !cursor.take_text(line.label.trim().as_bytes()) {
        return Outcome::None;
    }
    match Fields::three(&mut cursor) {
        Ok(fields) => fields.into_point(Some(line.format)),
        Err(issue) => Outcome::Bad(issue),
    }
}

/// `G801 N 1 X 128.474Y- 91.200Z 12.346`
fn labelled_words(pattern: &LabelledWordsPattern, text: &[u8]) -> Outcome {
    let mut cursor = Cursor::new(text);
    cursor.blanks();
    let prefix = pattern.prefix.trim().as_bytes();
    if !cursor.take_text(prefix) {
        return Outcome::None;
    }
    // `G801` is not the beginning of `G8011`.
    if !prefix.is_empty()
        && cursor
            .peek()
            .is_some_and(|b| b.is_ascii_digit() || b == b'.')
    {
        return Outcome::None;
    }
    let mut fields = Fields::default();
    let mut seen = 0u32;
    while !cursor.at_end() {
        let Some(letter) = cursor.peek().filter(u8::is_ascii_uppercase) else {
            return fields.surplus(cursor);
        };
        cursor.take(letter);
        let bit = 1u32 << (letter - b'A');
        if seen & bit != 0 {
            return Outcome::None;
        }
        seen |= bit;
        match word(letter, pattern, &mut cursor, &mut fields) {
            Ok(true) => {}
            Ok(false) => return Outcome::None,
            Err(issue) => return fields.almost(issue),
        }
    }
    let required = |letter: u8| pattern.axes.as_bytes().contains(&letter);
    let complete = (b'X'..)
        .zip(&fields.axes)
        .all(|(letter, axis)| axis.is_some() || !required(letter));
    if complete && fields.axes.iter().any(Option::is_some) {
        fields.into_point(pattern.format)
    } else {
        Outcome::None
    }
}

/// The number after a letter; false if there is no such word in the pattern.
fn word(
    letter: u8,
    pattern: &LabelledWordsPattern,
    cursor: &mut Cursor<'_>,
    fields: &mut Fields,
) -> Result<bool, Issue> {
    match letter {
        b'X'..=b'Z' => {
            let number = cursor.number()?;
            if let Some(place) = fields.axes.get_mut(usize::from(letter - b'X')) {
                *place = Some(number);
            }
        }
        b'N' | b'P' if fields.index.is_none() => fields.index = Some(cursor.whole(u32::MAX)?),
        b'F' => fields.feed_mm_per_min = Some(cursor.number()?.value),
        _ if pattern.ignored.as_bytes().contains(&letter) => {
            cursor.number()?;
        }
        _ => return Ok(false),
    }
    Ok(true)
}

/// `[PRB:x,y,z:s]`, machine position in mm (3 decimals) or inch (4 decimals);
/// s = 1 if the probe touched (GRBL 1.1, `report_probe_parameters`). Machines
/// with more axes print more numbers.
fn grbl_probe(text: &[u8]) -> Outcome {
    let mut cursor = Cursor::new(text);
    cursor.blanks();
    if !cursor.take_text(b"[PRB:") {
        return Outcome::None;
    }
    match grbl_values(&mut cursor) {
        Ok(fields) => Outcome::Point(fields),
        Err(issue) => Outcome::Bad(issue),
    }
}

fn grbl_values(cursor: &mut Cursor<'_>) -> Result<Fields, Issue> {
    let mut fields = Fields::default();
    let mut decimals = None;
    for axis in 0.. {
        let number = cursor.number()?;
        let got = number.digits.decimals;
        let expected = *decimals.get_or_insert(got);
        if got != expected || got == 0 {
            return Err((NumberIssue::Decimals { expected, got }, number.position));
        }
        if let Some(place) = fields.axes.get_mut(axis) {
            *place = Some(number);
        }
        if !cursor.take(b',') {
            break;
        }
    }
    if fields.axes.iter().any(Option::is_none) || !cursor.take(b':') {
        return Err((NumberIssue::Missing, cursor.position()));
    }
    fields.touched = Some(cursor.whole(1)? == 1);
    if cursor.take(b']') && cursor.at_end() {
        Ok(fields)
    } else {
        Err((NumberIssue::Surplus, cursor.position()))
    }
}

/// Nine numbers of six decimals: X Y Z A B C U V W in program units and work
/// coordinates (LinuxCNC, `PROBEOPEN`).
fn linuxcnc_probe(text: &[u8]) -> Outcome {
    let mut cursor = Cursor::new(text);
    let mut fields = Fields::default();
    for axis in 0..9 {
        match cursor.number() {
            Ok(number) if number.digits.decimals == 6 => {
                if let Some(place) = fields.axes.get_mut(axis) {
                    *place = Some(number);
                }
            }
            _ => return Outcome::None,
        }
    }
    if cursor.at_end() {
        Outcome::Point(fields)
    } else {
        Outcome::None
    }
}
