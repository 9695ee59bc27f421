//! The O words of LinuxCNC.

use super::cursor::Cursor;
use super::expression::{Expr, Parser, name};
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::settings::ControlFamily;

/// `o<label> keyword ...`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OWord {
    /// The label: a number or a name.
    pub label: String,
    /// What it says.
    pub flow: Flow,
}

/// The keyword of an O word, with its arguments.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Flow {
    Sub,
    EndSub(Option<Expr>),
    Return(Option<Expr>),
    Call(Vec<Expr>),
    If(Expr),
    ElseIf(Expr),
    Else,
    EndIf,
    /// Also the end of a `do`.
    While(Expr),
    EndWhile,
    Do,
    Repeat(Expr),
    EndRepeat,
    Break,
    Continue,
}

/// Arguments of a call.
const MAX_ARGUMENTS: usize = 30;

/// Reads what stands behind the `O`.
pub(crate) fn read(cursor: &mut Cursor<'_>) -> Checked<OWord> {
    let at = cursor.at();
    let label = if cursor.take(b'<') {
        format!("<{}>", name(cursor)?)
    } else {
        match cursor.digits() {
            Some(digits) if !digits.has_point && digits.value < 1e9 => {
                format!("{}", digits.value)
            }
            _ => return Err(Fault::new("O needs a number or a <name>").at(at)),
        }
    };
    let at = cursor.at();
    let flow = match cursor.letters().as_str() {
        "SUB" => Flow::Sub,
        "ENDSUB" => Flow::EndSub(optional(cursor)?),
        "RETURN" => Flow::Return(optional(cursor)?),
        "CALL" => Flow::Call(arguments(cursor)?),
        "IF" => Flow::If(bracketed(cursor)?),
        "ELSEIF" => Flow::ElseIf(bracketed(cursor)?),
        "ELSE" => Flow::Else,
        "ENDIF" => Flow::EndIf,
        "WHILE" => Flow::While(bracketed(cursor)?),
        "ENDWHILE" => Flow::EndWhile,
        "DO" => Flow::Do,
        "REPEAT" => Flow::Repeat(bracketed(cursor)?),
        "ENDREPEAT" => Flow::EndRepeat,
        "BREAK" => Flow::Break,
        "CONTINUE" => Flow::Continue,
        "" => {
            return Err(Fault::new(format!(
                "O{label} has no keyword (sub, call, if, while ...): O numbers as program names \
                 are Fanuc's"
            ))
            .at(at));
        }
        other => {
            return Err(Fault::new(format!("`{other}` is no keyword of an O word")).at(at));
        }
    };
    Ok(OWord { label, flow })
}

fn bracketed(cursor: &mut Cursor<'_>) -> Checked<Expr> {
    Parser::new(cursor, ControlFamily::LinuxCnc).bracketed()
}

fn optional(cursor: &mut Cursor<'_>) -> Checked<Option<Expr>> {
    if cursor.peek() == Some(b'[') {
        bracketed(cursor).map(Some)
    } else {
        Ok(None)
    }
}

fn arguments(cursor: &mut Cursor<'_>) -> Checked<Vec<Expr>> {
    let mut arguments = Vec::new();
    while cursor.peek() == Some(b'[') {
        if arguments.len() == MAX_ARGUMENTS {
            let at = cursor.at();
            return Err(Fault::new("a call has at most 30 arguments").at(at));
        }
        arguments.push(bracketed(cursor)?);
    }
    Ok(arguments)
}
