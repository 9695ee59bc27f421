//! The text of a STEP file (ISO 10303-21): numbered entities with their values. What they mean is not known here.

use std::collections::HashMap;

use super::super::unreadable::unreadable;
use crate::ScanError;

/// Lists within lists at most: no entity of a shape needs more, and a damaged file cannot use up the stack.
const DEEPEST: usize = 24;

/// A value of an entity.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    /// `#12`
    Entity(u64),
    /// `3`, `1.5E-2`
    Number(f64),
    /// `.T.`, without its dots
    Word(String),
    /// `(…)`
    List(Vec<Value>),
    /// `$`, `*`, a text, a typed value: says nothing about a shape, but keeps its place.
    Other,
}

/// An entity: its kinds with the values of each. A plain one has one kind, a complex one several.
#[derive(Debug, Clone, Default)]
pub(super) struct Entity {
    kinds: Vec<(String, Vec<Value>)>,
}

impl Entity {
    /// The values under a kind.
    pub fn get(&self, kind: &str) -> Option<&[Value]> {
        self.kinds
            .iter()
            .find(|(name, _)| name == kind)
            .map(|(_, values)| values.as_slice())
    }

    /// The name of a plain entity, or of the last kind of a complex one: for messages.
    pub fn name(&self) -> &str {
        self.kinds.last().map_or("nothing", |(name, _)| name)
    }

    /// Is it a plain entity of one kind?
    pub fn is_plain(&self) -> bool {
        self.kinds.len() == 1
    }
}

/// All entities of a file by their numbers.
#[derive(Debug, Default)]
pub(super) struct Entities(HashMap<u64, Entity>);

impl Entities {
    /// An entity; a number without one is damage.
    pub fn at(&self, number: u64) -> Result<&Entity, ScanError> {
        self.0
            .get(&number)
            .ok_or_else(|| unreadable(format_args!("entity #{number} is named and not there")))
    }

    /// Numbers of all entities that have a kind, in their order.
    pub fn having(&self, kind: &str) -> Vec<u64> {
        let has = |(_, e): &(&u64, &Entity)| e.get(kind).is_some();
        let mut numbers: Vec<u64> = self.0.iter().filter(has).map(|(n, _)| *n).collect();
        numbers.sort_unstable();
        numbers
    }
}

/// Reads the data sections of a file.
///
/// # Errors
/// `mesh_unreadable` for a text that is no STEP, or breaks off.
pub(super) fn parse(bytes: &[u8]) -> Result<Entities, ScanError> {
    let mut text = Reader { bytes, at: 0 };
    text.blanks();
    if !text.rest().starts_with(b"ISO-10303-21") {
        return Err(unreadable("a STEP file begins with ISO-10303-21"));
    }
    text.past(b"DATA")?;
    let mut entities = Entities::default();
    loop {
        // `DATA;`, or `DATA(…);` of the third edition.
        text.past(b";")?;
        text.entities(&mut entities)?;
        text.blanks();
        if text.rest().starts_with(b"END-ISO-10303-21") {
            return Ok(entities);
        }
        if text.rest().starts_with(b"SIGNATURE") || text.rest().starts_with(b"ANCHOR") {
            return Ok(entities);
        }
        if !text.rest().starts_with(b"DATA") {
            return Err(unreadable("END-ISO-10303-21 is missing"));
        }
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn rest(&self) -> &'a [u8] {
        &self.bytes[self.at.min(self.bytes.len())..]
    }

    fn peek(&self) -> Option<u8> {
        self.bytes.get(self.at).copied()
    }

    fn wrong<T>(&self, what: &str) -> Result<T, ScanError> {
        let line = 1 + self.bytes[..self.at.min(self.bytes.len())]
            .iter()
            .filter(|b| **b == b'\n')
            .count();
        Err(unreadable(format_args!("line {line}: {what}")))
    }

    /// Skips blanks and comments.
    fn blanks(&mut self) {
        loop {
            while self.peek().is_some_and(|b| b.is_ascii_whitespace()) {
                self.at += 1;
            }
            if !self.rest().starts_with(b"/*") {
                return;
            }
            self.at = match self.rest().windows(2).position(|w| w == b"*/") {
                Some(end) => self.at + end + 2,
                None => self.bytes.len(),
            };
        }
    }

    /// Behind the next place of a word outside of texts and comments.
    fn past(&mut self, word: &[u8]) -> Result<(), ScanError> {
        while self.at < self.bytes.len() {
            self.blanks();
            if self.rest().starts_with(word) {
                self.at += word.len();
                return Ok(());
            }
            if self.peek() == Some(b'\'') {
                self.text()?;
            } else {
                self.at += 1;
            }
        }
        self.wrong("the file ends before its data do")
    }

    fn expect(&mut self, byte: u8) -> Result<(), ScanError> {
        self.blanks();
        if self.peek() == Some(byte) {
            self.at += 1;
            return Ok(());
        }
        self.wrong(&format!("`{}` is missing", char::from(byte)))
    }

    fn entities(&mut self, into: &mut Entities) -> Result<(), ScanError> {
        loop {
            self.blanks();
            if self.rest().starts_with(b"ENDSEC") {
                self.at += 6;
                return self.expect(b';');
            }
            self.expect(b'#')?;
            let number = self.number_of_entity()?;
            self.expect(b'=')?;
            self.blanks();
            let mut entity = Entity::default();
            if self.peek() == Some(b'(') {
                self.at += 1;
                loop {
                    self.blanks();
                    if self.peek() == Some(b')') {
                        self.at += 1;
                        break;
                    }
                    entity.kinds.push(self.kind()?);
                }
            } else {
                entity.kinds.push(self.kind()?);
            }
            self.expect(b';')?;
            if into.0.insert(number, entity).is_some() {
                return self.wrong(&format!("#{number} is there twice"));
            }
        }
    }

    fn number_of_entity(&mut self) -> Result<u64, ScanError> {
        let digits = self
            .rest()
            .iter()
            .take_while(|b| b.is_ascii_digit())
            .count();
        let number = std::str::from_utf8(&self.rest()[..digits])
            .ok()
            .and_then(|d| d.parse().ok());
        self.at += digits;
        match number {
            Some(number) => Ok(number),
            None => self.wrong("an entity's number is missing"),
        }
    }

    fn word(&mut self) -> String {
        let length = self
            .rest()
            .iter()
            .take_while(|b| b.is_ascii_alphanumeric() || **b == b'_')
            .count();
        let word = String::from_utf8_lossy(&self.rest()[..length]).to_ascii_uppercase();
        self.at += length;
        word
    }

    fn kind(&mut self) -> Result<(String, Vec<Value>), ScanError> {
        let name = self.word();
        if name.is_empty() {
            return self.wrong("an entity's kind is missing");
        }
        self.expect(b'(')?;
        Ok((name, self.list(0)?))
    }

    /// Values up to the closing bracket; the opening one is taken already.
    fn list(&mut self, depth: usize) -> Result<Vec<Value>, ScanError> {
        if depth > DEEPEST {
            return self.wrong("lists lie within lists without end");
        }
        let mut values = Vec::new();
        self.blanks();
        if self.peek() == Some(b')') {
            self.at += 1;
            return Ok(values);
        }
        loop {
            values.push(self.value(depth)?);
            self.blanks();
            match self.peek() {
                Some(b',') => self.at += 1,
                Some(b')') => {
                    self.at += 1;
                    return Ok(values);
                }
                _ => return self.wrong("a list does not end"),
            }
        }
    }

    fn value(&mut self, depth: usize) -> Result<Value, ScanError> {
        self.blanks();
        let Some(byte) = self.peek() else {
            return self.wrong("the file ends before its data do");
        };
        match byte {
            b'#' => {
                self.at += 1;
                Ok(Value::Entity(self.number_of_entity()?))
            }
            b'(' => {
                self.at += 1;
                Ok(Value::List(self.list(depth + 1)?))
            }
            b'.' => {
                self.at += 1;
                let word = self.word();
                self.expect(b'.')?;
                Ok(Value::Word(word))
            }
            b'\'' => {
                self.text()?;
                Ok(Value::Other)
            }
            b'$' | b'*' => {
                self.at += 1;
                Ok(Value::Other)
            }
            b'"' => {
                self.at += 1;
                match self.rest().iter().position(|b| *b == b'"') {
                    Some(end) => self.at += end + 1,
                    None => return self.wrong("a binary value does not end"),
                }
                Ok(Value::Other)
            }
            b'+' | b'-' | b'0'..=b'9' => self.number(),
            _ => {
                let (_, values) = self.kind()?;
                // `LENGTH_MEASURE(25.4)`: the number within is what counts.
                Ok(match values.as_slice() {
                    [Value::Number(n)] => Value::Number(*n),
                    _ => Value::Other,
                })
            }
        }
    }

    fn number(&mut self) -> Result<Value, ScanError> {
        let length = self
            .rest()
            .iter()
            .take_while(|b| b.is_ascii_digit() || matches!(b, b'+' | b'-' | b'.' | b'E' | b'e'))
            .count();
        let number = std::str::from_utf8(&self.rest()[..length])
            .ok()
            .and_then(|d| d.parse::<f64>().ok());
        self.at += length;
        match number {
            Some(n) => Ok(Value::Number(n)),
            None => self.wrong("a number is none"),
        }
    }

    /// Skips a text; two apostrophes in it are one of its own.
    fn text(&mut self) -> Result<(), ScanError> {
        self.at += 1;
        while let Some(byte) = self.peek() {
            self.at += 1;
            if byte == b'\'' {
                if self.peek() != Some(b'\'') {
                    return Ok(());
                }
                self.at += 1;
            }
        }
        self.wrong("a text does not end")
    }
}

/// What an entity's value must be; `what` is for the message.
pub(super) trait Values {
    fn value(&self, place: usize) -> Option<&Value>;

    fn entity(&self, place: usize) -> Result<u64, ScanError> {
        match self.value(place) {
            Some(Value::Entity(n)) => Ok(*n),
            _ => Err(unreadable("an entity does not name what it needs")),
        }
    }

    fn number(&self, place: usize) -> Result<f64, ScanError> {
        match self.value(place) {
            Some(Value::Number(n)) if n.is_finite() => Ok(*n),
            _ => Err(unreadable("a number of an entity is missing")),
        }
    }

    fn list(&self, place: usize) -> Result<&[Value], ScanError> {
        match self.value(place) {
            Some(Value::List(list)) => Ok(list),
            _ => Err(unreadable("a list of an entity is missing")),
        }
    }

    /// `.T.` or `.F.`
    fn flag(&self, place: usize) -> Result<bool, ScanError> {
        match self.value(place) {
            Some(Value::Word(w)) if w == "T" => Ok(true),
            Some(Value::Word(w)) if w == "F" => Ok(false),
            _ => Err(unreadable("a .T. or .F. of an entity is missing")),
        }
    }

    fn numbers(&self, place: usize) -> Result<Vec<f64>, ScanError> {
        let list = self.list(place)?;
        (0..list.len()).map(|k| list.number(k)).collect()
    }

    fn entities(&self, place: usize) -> Result<Vec<u64>, ScanError> {
        let list = self.list(place)?;
        (0..list.len()).map(|k| list.entity(k)).collect()
    }
}

impl Values for [Value] {
    fn value(&self, place: usize) -> Option<&Value> {
        self.get(place)
    }
}
