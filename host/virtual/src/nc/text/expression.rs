//! Expressions of macro statements: from text to a tree.

use super::cursor::Cursor;
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::settings::ControlFamily;

/// An expression.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Expr {
    /// A number.
    Number(f64),
    /// `#n`, `#[...]`, `##n`: the variable whose number this is.
    Variable(Box<Expr>),
    /// `#<name>` (LinuxCNC).
    Named(String),
    /// A minus sign.
    Negate(Box<Expr>),
    /// Two operands.
    Binary(Op, Box<Expr>, Box<Expr>),
    /// A function of one or two arguments.
    Call(Func, Vec<Expr>),
}

impl Expr {
    /// Whether it is a comparison, or several joined by AND, OR, XOR.
    pub fn is_condition(&self) -> bool {
        match self {
            Self::Binary(op, a, b) => match op {
                Op::Eq | Op::Ne | Op::Gt | Op::Lt | Op::Ge | Op::Le => true,
                Op::And | Op::Or | Op::Xor => a.is_condition() && b.is_condition(),
                _ => false,
            },
            _ => false,
        }
    }

    /// Its operands.
    pub fn operands(&self) -> Vec<&Self> {
        match self {
            Self::Number(_) | Self::Named(_) => Vec::new(),
            Self::Variable(inner) | Self::Negate(inner) => vec![inner.as_ref()],
            Self::Binary(_, a, b) => vec![a.as_ref(), b.as_ref()],
            Self::Call(_, arguments) => arguments.iter().collect(),
        }
    }

    /// Its value if it is a plain number.
    pub fn constant(&self) -> Option<f64> {
        match self {
            Self::Number(value) => Some(*value),
            Self::Negate(inner) => inner.constant().map(|value| -value),
            _ => None,
        }
    }
}

/// An operation on two operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Op {
    Add,
    Sub,
    Mul,
    Div,
    Mod,
    Power,
    And,
    Or,
    Xor,
    Eq,
    Ne,
    Gt,
    Lt,
    Ge,
    Le,
}

/// A function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Func {
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sqrt,
    Abs,
    Bin,
    Bcd,
    Round,
    Fix,
    Fup,
    Ln,
    Exp,
    Pow,
    Exists,
}

/// Operators that are written as words.
const WORDS: [(&str, Op); 10] = [
    ("MOD", Op::Mod),
    ("AND", Op::And),
    ("OR", Op::Or),
    ("XOR", Op::Xor),
    ("EQ", Op::Eq),
    ("NE", Op::Ne),
    ("GT", Op::Gt),
    ("LT", Op::Lt),
    ("GE", Op::Ge),
    ("LE", Op::Le),
];

/// How deep brackets may stand in each other.
const fn max_depth(dialect: ControlFamily) -> u32 {
    // Custom Macro B: five, the brackets of functions counted.
    if dialect.is_macro_b() { 5 } else { 20 }
}

/// Signs and `#` in a row.
const MAX_PREFIXES: u32 = 20;

/// Digits of a constant.
const MAX_DIGITS: usize = 15;

/// Reads expressions of one line.
pub(crate) struct Parser<'c, 'l> {
    pub cursor: &'c mut Cursor<'l>,
    pub dialect: ControlFamily,
    depth: u32,
}

impl<'c, 'l> Parser<'c, 'l> {
    pub fn new(cursor: &'c mut Cursor<'l>, dialect: ControlFamily) -> Self {
        Self {
            cursor,
            dialect,
            depth: 0,
        }
    }

    /// An expression up to what cannot be a part of it.
    pub fn expression(&mut self) -> Checked<Expr> {
        self.binary(1)
    }

    /// `[` expression `]` around a condition or an argument; not counted as nesting.
    pub fn bracketed(&mut self) -> Checked<Expr> {
        self.cursor.expect(b'[', 114, "before the expression")?;
        let inner = self.expression()?;
        self.cursor.expect(b']', 114, "behind the expression")?;
        Ok(inner)
    }

    /// What may stand behind a letter or behind `GOTO`: signs, a number, a variable,
    /// brackets; functions without brackets in LinuxCNC only.
    pub fn value(&mut self) -> Checked<Expr> {
        if self.dialect.is_macro_b() && self.cursor.peek().is_some_and(|b| b.is_ascii_alphabetic())
        {
            let at = self.cursor.at();
            return Err(Fault::ps(5, "no number behind the address: give one").at(at));
        }
        self.prefixed(0)
    }

    /// The variable behind a `#` that has been taken.
    pub fn variable(&mut self, prefixes: u32) -> Checked<Expr> {
        let at = self.cursor.at();
        if prefixes > MAX_PREFIXES {
            return Err(Fault::ps(114, "too many signs in a row").at(at));
        }
        if self.dialect == ControlFamily::LinuxCnc && self.cursor.take(b'<') {
            return Ok(Expr::Named(name(self.cursor)?));
        }
        let number = match self.cursor.peek() {
            Some(b'[') => self.group()?,
            Some(b'#') => {
                self.cursor.take(b'#');
                self.variable(prefixes + 1)?
            }
            _ => match self.cursor.digits() {
                Some(digits) if !digits.has_point => Expr::Number(digits.value),
                _ => {
                    return Err(
                        Fault::ps(114, "`#` needs the number of a variable, or `#[...]`").at(at),
                    );
                }
            },
        };
        Ok(Expr::Variable(Box::new(number)))
    }

    fn binary(&mut self, lowest: u8) -> Checked<Expr> {
        let mut left = self.prefixed(0)?;
        loop {
            let start = self.cursor.clone();
            let Some(op) = self.operator() else {
                return Ok(left);
            };
            let strength = strength(op, self.dialect);
            if strength < lowest {
                *self.cursor = start;
                return Ok(left);
            }
            let right = self.binary(strength + 1)?;
            left = Expr::Binary(op, Box::new(left), Box::new(right));
        }
    }

    /// Takes an operator; leaves the cursor alone if there is none.
    fn operator(&mut self) -> Option<Op> {
        let start = self.cursor.clone();
        let op = match self.cursor.next()? {
            b'+' => Some(Op::Add),
            b'-' => Some(Op::Sub),
            b'*' if self.dialect == ControlFamily::LinuxCnc && self.cursor.take(b'*') => {
                Some(Op::Power)
            }
            b'*' => Some(Op::Mul),
            b'/' => Some(Op::Div),
            byte if byte.is_ascii_alphabetic() => {
                *self.cursor = start.clone();
                // Blanks mean nothing: an operator ends with its letters, as in `NEFIX[`.
                WORDS
                    .iter()
                    .find_map(|(word, op)| self.cursor.take_word(word).then_some(*op))
            }
            _ => None,
        };
        if op.is_none() {
            *self.cursor = start;
        }
        op
    }

    fn prefixed(&mut self, prefixes: u32) -> Checked<Expr> {
        let at = self.cursor.at();
        if prefixes > MAX_PREFIXES {
            return Err(Fault::ps(114, "too many signs in a row").at(at));
        }
        match self.cursor.peek() {
            Some(b'-') => {
                self.cursor.take(b'-');
                Ok(Expr::Negate(Box::new(self.prefixed(prefixes + 1)?)))
            }
            Some(b'+') => {
                self.cursor.take(b'+');
                self.prefixed(prefixes + 1)
            }
            Some(b'#') => {
                self.cursor.take(b'#');
                self.variable(prefixes)
            }
            Some(b'[') => self.group(),
            Some(b'0'..=b'9' | b'.') => self.number(),
            Some(byte) if byte.is_ascii_alphabetic() => self.function(),
            _ => Err(Fault::ps(114, "number, variable, function or `[` expected").at(at)),
        }
    }

    fn number(&mut self) -> Checked<Expr> {
        let at = self.cursor.at();
        let digits = self
            .cursor
            .digits()
            .ok_or_else(|| Fault::ps(114, "a point without digits").at(at))?;
        if digits.significant > MAX_DIGITS {
            return Err(Fault::ps(3, "number with too many digits: shorten it").at(at));
        }
        Ok(Expr::Number(digits.value))
    }

    fn group(&mut self) -> Checked<Expr> {
        let at = self.cursor.at();
        self.cursor.expect(b'[', 114, "")?;
        self.depth += 1;
        if self.depth > max_depth(self.dialect) {
            return Err(Fault::ps(
                118,
                "brackets nested too deeply: compute a part in a variable first",
            )
            .at(at));
        }
        let inner = self.expression()?;
        // The second argument of a function is taken by the caller.
        if self.cursor.peek() != Some(b',') {
            self.cursor.expect(b']', 114, "behind the expression")?;
            self.depth -= 1;
        }
        Ok(inner)
    }

    fn function(&mut self) -> Checked<Expr> {
        let at = self.cursor.at();
        let word = self.cursor.letters();
        let func = match word.as_str() {
            "SIN" => Func::Sin,
            "COS" => Func::Cos,
            "TAN" => Func::Tan,
            "ASIN" => Func::Asin,
            "ACOS" => Func::Acos,
            "ATAN" => Func::Atan,
            "SQRT" | "SQR" => Func::Sqrt,
            "ABS" => Func::Abs,
            "BIN" if self.dialect.is_macro_b() => Func::Bin,
            "BCD" if self.dialect.is_macro_b() => Func::Bcd,
            "ROUND" | "RND" => Func::Round,
            "FIX" => Func::Fix,
            "FUP" => Func::Fup,
            "LN" => Func::Ln,
            "EXP" => Func::Exp,
            "POW" if self.dialect.is_macro_b() => Func::Pow,
            "EXISTS" if self.dialect == ControlFamily::LinuxCnc => Func::Exists,
            _ => {
                return Err(
                    Fault::ps(114, format!("`{word}` is no function of this control")).at(at),
                );
            }
        };
        let mut arguments = vec![self.group()?];
        if matches!(func, Func::Atan | Func::Pow) && self.cursor.take(b',') {
            arguments.push(self.expression()?);
            self.cursor
                .expect(b']', 114, "behind the second argument")?;
            self.depth = self.depth.saturating_sub(1);
        } else if self.cursor.peek() == Some(b',') {
            let at = self.cursor.at();
            return Err(Fault::ps(114, format!("{word} has one argument")).at(at));
        } else if func == Func::Atan && self.cursor.peek() == Some(b'/') {
            let start = self.cursor.clone();
            self.cursor.take(b'/');
            // `ATAN[a]/#2` divides; `ATAN[a]/[b]` has two arguments.
            if self.cursor.peek() == Some(b'[') {
                arguments.push(self.group()?);
            } else {
                *self.cursor = start;
            }
        }
        if func == Func::Pow && arguments.len() != 2 {
            return Err(Fault::ps(114, "POW has two arguments: POW[a,b]").at(at));
        }
        Ok(Expr::Call(func, arguments))
    }
}

/// A name behind `<`: small letters, no blanks.
pub(crate) fn name(cursor: &mut Cursor<'_>) -> Checked<String> {
    let at = cursor.at();
    let text = cursor
        .up_to(b'>')
        .ok_or_else(|| Fault::new("name not closed: write `>`").at(at))?;
    let name: String = text
        .iter()
        .filter(|b| **b != b' ')
        .map(|b| b.to_ascii_lowercase() as char)
        .collect();
    if name.is_empty() {
        return Err(Fault::new("a name is empty").at(at));
    }
    Ok(name)
}

/// How strongly an operator binds.
const fn strength(op: Op, dialect: ControlFamily) -> u8 {
    let is_linuxcnc = matches!(dialect, ControlFamily::LinuxCnc);
    match op {
        Op::Power => 6,
        Op::Mul | Op::Div | Op::Mod => 5,
        // Custom Macro B: AND binds as multiplication, OR and XOR as addition do.
        Op::And if !is_linuxcnc => 5,
        Op::Add | Op::Sub => 4,
        Op::Or | Op::Xor if !is_linuxcnc => 4,
        Op::Eq | Op::Ne | Op::Gt | Op::Lt | Op::Ge | Op::Le => 3,
        Op::And | Op::Or | Op::Xor => 2,
    }
}
