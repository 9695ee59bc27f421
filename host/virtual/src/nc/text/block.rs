//! One block of a program: from text to a statement.

use super::cursor::{Cursor, Line};
use super::dprnt::{Format, Kind};
use super::expression::{Expr, Parser};
use super::oword::{self, OWord};
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::settings::ControlFamily;

/// A block, read.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    /// The line in the loaded text, from 1.
    pub line: u32,
    /// The line as it was loaded.
    pub text: String,
    /// Its N number.
    pub n: Option<u32>,
    /// Whether it begins with `/`.
    pub is_optional: bool,
    /// What it says, or why a control cannot read it.
    pub statement: Checked<Statement>,
    /// Its comments, without brackets.
    pub comments: Vec<String>,
    /// What not every control takes.
    pub warnings: Vec<Fault>,
}

/// What a block says.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Statement {
    /// Words, and in LinuxCNC assignments beside them.
    Words(Vec<Word>, Vec<Assign>),
    /// `IF [condition] GOTO n`.
    IfGoto(Expr, Expr),
    /// `IF [condition] THEN #i = ...`.
    IfThen(Expr, Assign),
    /// `GOTO n`.
    Goto(Expr),
    /// `WHILE [condition] DO m`, or `DO m` alone.
    Do(Option<Expr>, u8),
    /// `END m`.
    End(u8),
    /// `POPEN`.
    Open,
    /// `PCLOS`.
    Close,
    /// `DPRNT[...]`, `BPRNT[...]`.
    Print(Format),
    /// An O word of LinuxCNC.
    OWord(OWord),
}

/// An address with its value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Word {
    /// The address, a capital letter.
    pub letter: u8,
    /// The value.
    pub value: Expr,
    /// Whether the value is a plain number without a decimal point.
    pub is_without_point: bool,
    /// Index of the address in the line.
    pub at: usize,
}

/// `target = value`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Assign {
    /// `#...`.
    pub target: Expr,
    /// What it becomes.
    pub value: Expr,
}

/// What begins a comment that acts in LinuxCNC.
const ACTING: [&str; 10] = [
    "MSG",
    "DEBUG",
    "PRINT",
    "LOG",
    "LOGOPEN",
    "LOGAPPEND",
    "LOGCLOSE",
    "PROBEOPEN",
    "PROBECLOSE",
    "ABORT",
];

/// Words in one block.
const MAX_WORDS: usize = 100;

/// Digits of a word's number.
const MAX_DIGITS: usize = 9;

impl Block {
    /// Reads a line. A line that a control cannot read becomes a block that is an alarm
    /// when it is reached, as on a control.
    pub fn read(line: u32, text: &str, dialect: ControlFamily) -> Self {
        let mut block = Self {
            line,
            text: text
                .chars()
                .take(200)
                .collect::<String>()
                .trim()
                .to_string(),
            n: None,
            is_optional: false,
            statement: Ok(Statement::Words(Vec::new(), Vec::new())),
            comments: Vec::new(),
            warnings: Vec::new(),
        };
        match Line::new(text, dialect) {
            Ok(mut read) => {
                block.comments = std::mem::take(&mut read.comments);
                if read.has_small_letters && dialect.is_macro_b() {
                    block.warnings.push(Fault::warning(
                        "small letters: some controls skip them as they load, write capitals",
                    ));
                }
                block.statement = block.read_statement(&read, dialect);
            }
            Err(fault) => block.statement = Err(fault),
        }
        block
    }

    /// Whether one of its comments begins with a word that acts in LinuxCNC.
    pub fn comment_acts(&self) -> bool {
        self.comments.iter().any(|comment| {
            let word = comment
                .trim_start()
                .split(|c: char| !c.is_ascii_alphabetic())
                .next()
                .unwrap_or_default();
            ACTING
                .iter()
                .any(|acting| word.eq_ignore_ascii_case(acting))
        })
    }

    fn read_statement(&mut self, line: &Line, dialect: ControlFamily) -> Checked<Statement> {
        let mut cursor = Cursor::new(line);
        if cursor.take(b'/') {
            self.is_optional = true;
            cursor.digits();
        }
        let start = cursor.clone();
        if cursor.take(b'N') {
            match cursor.digits() {
                Some(digits) if !digits.has_point && digits.value <= 99_999_999.0 => {
                    self.n = Some(digits.value as u32);
                }
                _ => cursor = start,
            }
        }
        if cursor.take(b'/') {
            self.is_optional = true;
            cursor.digits();
        }
        let statement = if dialect.is_macro_b() {
            self.macro_statement(&mut cursor, dialect)?
        } else if dialect == ControlFamily::LinuxCnc && cursor.take(b'O') {
            Statement::OWord(oword::read(&mut cursor)?)
        } else {
            words(&mut cursor, dialect)?
        };
        let at = cursor.at();
        if cursor.peek().is_some() {
            return Err(Fault::ps(114, "what stands here cannot follow").at(at));
        }
        Ok(statement)
    }

    fn macro_statement(
        &mut self,
        cursor: &mut Cursor<'_>,
        dialect: ControlFamily,
    ) -> Checked<Statement> {
        let at = cursor.at();
        if cursor.take_word("IF") {
            let condition = condition(cursor, dialect)?;
            if cursor.take_word("GOTO") {
                let target = Parser::new(cursor, dialect).value()?;
                return Ok(Statement::IfGoto(condition, target));
            }
            let at = cursor.at();
            if !cursor.take_word("THEN") {
                return Err(Fault::ps(125, "IF[...] needs GOTO or THEN").at(at));
            }
            return Ok(Statement::IfThen(condition, assign(cursor, dialect)?));
        }
        if cursor.take_word("WHILE") {
            let condition = condition(cursor, dialect)?;
            let at = cursor.at();
            if !cursor.take_word("DO") {
                return Err(Fault::ps(125, "WHILE[...] needs DO1, DO2 or DO3").at(at));
            }
            return Ok(Statement::Do(Some(condition), loop_number(cursor)?));
        }
        if cursor.take_word("DO") {
            return Ok(Statement::Do(None, loop_number(cursor)?));
        }
        if cursor.take_word("END") {
            return Ok(Statement::End(loop_number(cursor)?));
        }
        if cursor.take_word("GOTO") {
            return Ok(Statement::Goto(Parser::new(cursor, dialect).value()?));
        }
        if cursor.take_word("POPEN") {
            return Ok(Statement::Open);
        }
        if cursor.take_word("PCLOS") {
            return Ok(Statement::Close);
        }
        for (word, kind) in [("DPRNT", Kind::Decimal), ("BPRNT", Kind::Binary)] {
            if cursor.take_word(word) {
                let (format, warnings) = Format::read(cursor, kind, dialect)?;
                self.warnings.extend(warnings);
                return Ok(Statement::Print(format));
            }
        }
        if cursor.take_word("SETVN") {
            return Err(Fault::new("names of variables (SETVN) are not interpreted").at(at));
        }
        if cursor.peek() == Some(b'#') {
            let assign = assign(cursor, dialect)?;
            let at = cursor.at();
            if cursor.peek().is_some() {
                return Err(Fault::ps(
                    127,
                    "an assignment stands alone in its block: move the rest to the next line",
                )
                .at(at));
            }
            return Ok(Statement::Words(Vec::new(), vec![assign]));
        }
        words(cursor, dialect)
    }
}

fn condition(cursor: &mut Cursor<'_>, dialect: ControlFamily) -> Checked<Expr> {
    let at = cursor.at();
    let condition = Parser::new(cursor, dialect).bracketed()?;
    if condition.is_condition() {
        Ok(condition)
    } else {
        Err(Fault::ps(114, "a condition compares: EQ, NE, GT, LT, GE, LE").at(at))
    }
}

fn loop_number(cursor: &mut Cursor<'_>) -> Checked<u8> {
    let at = cursor.at();
    match cursor.digits() {
        Some(digits) if !digits.has_point && (1.0..=3.0).contains(&digits.value) => {
            Ok(digits.value as u8)
        }
        _ => Err(Fault::ps(126, "loops are numbered 1, 2 and 3").at(at)),
    }
}

fn assign(cursor: &mut Cursor<'_>, dialect: ControlFamily) -> Checked<Assign> {
    cursor.expect(b'#', 114, "before the variable to set")?;
    let target = Parser::new(cursor, dialect).variable(0)?;
    cursor.expect(b'=', 114, "behind the variable")?;
    let value = Parser::new(cursor, dialect).expression()?;
    Ok(Assign { target, value })
}

fn words(cursor: &mut Cursor<'_>, dialect: ControlFamily) -> Checked<Statement> {
    let mut words = Vec::new();
    let mut assigns = Vec::new();
    while let Some(byte) = cursor.peek() {
        let at = cursor.at();
        if words.len() + assigns.len() >= MAX_WORDS {
            return Err(Fault::new("too many words in one block: split it").at(at));
        }
        if byte == b'#' && dialect == ControlFamily::LinuxCnc {
            assigns.push(assign(cursor, dialect)?);
            continue;
        }
        if byte == b'#' {
            return Err(Fault::ps(127, "a variable is set in a block of its own").at(at));
        }
        if !byte.is_ascii_uppercase() {
            return Err(Fault::ps(9, "an address (a letter) is expected here").at(at));
        }
        cursor.take(byte);
        words.push(word(cursor, byte, at, dialect)?);
    }
    Ok(Statement::Words(words, assigns))
}

fn word(cursor: &mut Cursor<'_>, letter: u8, at: usize, dialect: ControlFamily) -> Checked<Word> {
    let name = letter as char;
    // A sign, then a number as it is written: the decimal point counts.
    let start = cursor.clone();
    let is_negative = cursor.peek() == Some(b'-');
    if is_negative || cursor.peek() == Some(b'+') {
        cursor.next();
    }
    if let Some(digits) = cursor.digits() {
        if digits.significant > MAX_DIGITS && dialect.is_macro_b() {
            return Err(Fault::ps(
                3,
                format!("{name} has too many digits: at most {MAX_DIGITS}"),
            )
            .at(digits.at));
        }
        let number = Expr::Number(digits.value);
        return Ok(Word {
            letter,
            value: if is_negative {
                Expr::Negate(Box::new(number))
            } else {
                number
            },
            is_without_point: !digits.has_point,
            at,
        });
    }
    *cursor = start;
    if dialect == ControlFamily::Grbl || cursor.peek().is_none() {
        return Err(Fault::ps(5, format!("no number behind {name}: give one")).at(at));
    }
    let value = Parser::new(cursor, dialect).value().map_err(|f| f.at(at))?;
    Ok(Word {
        letter,
        value,
        is_without_point: false,
        at,
    })
}
