//! The values of expressions.
//!
//! A value may be null (`None`): that of a variable which nobody has set. A null counts
//! as zero in a computation; a comparison with EQ and NE tells it from zero. A variable
//! alone, also in brackets, stays null, so that `#2 = #1` and `X#1` hand it on.

use super::expression::{Expr, Func, Op};
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::settings::ControlFamily;

/// Where the values of variables come from.
pub(crate) trait Lookup {
    /// The dialect in which to compute.
    fn dialect(&self) -> ControlFamily;
    /// The value of `#number`.
    fn variable(&self, number: u32) -> Checked<Option<f64>>;
    /// The value of `#<name>`; none if there is no such parameter.
    fn named(&self, name: &str) -> Checked<Option<f64>>;
}

/// The value of an expression.
pub(crate) fn evaluate(expr: &Expr, from: &dyn Lookup) -> Checked<Option<f64>> {
    Evaluator {
        from,
        round_to: None,
    }
    .value(expr)
}

/// The value of an expression behind an address: ROUND there rounds to the smallest
/// increment of the address, not to a whole number.
pub(crate) fn evaluate_word(
    expr: &Expr,
    from: &dyn Lookup,
    increment: Option<f64>,
) -> Checked<Option<f64>> {
    Evaluator {
        from,
        round_to: increment,
    }
    .value(expr)
}

/// A whole number of this range from a value.
pub(crate) fn whole(value: f64, largest: u32) -> Option<u32> {
    let rounded = value.round();
    ((value - rounded).abs() < 1e-6 && rounded >= 0.0 && rounded <= f64::from(largest))
        .then_some(rounded as u32)
}

/// Whether a condition holds.
pub(crate) fn holds(expr: &Expr, from: &dyn Lookup) -> Checked<bool> {
    Ok(evaluate(expr, from)?.unwrap_or(0.0) != 0.0)
}

/// The number of the variable that `#...` names.
pub(crate) fn variable_number(expr: &Expr, from: &dyn Lookup) -> Checked<u32> {
    let value = evaluate(expr, from)?.unwrap_or(0.0);
    whole(value, 9_999_999)
        .ok_or_else(|| Fault::ps(115, format!("#{value} is no variable of this control")))
}

struct Evaluator<'a> {
    from: &'a dyn Lookup,
    round_to: Option<f64>,
}

impl Evaluator<'_> {
    // The depth of the tree is bounded by the length of a line.
    fn value(&self, expr: &Expr) -> Checked<Option<f64>> {
        match expr {
            Expr::Number(value) => finite(*value).map(Some),
            Expr::Variable(number) => self.from.variable(variable_number(number, self.from)?),
            Expr::Named(name) => self.from.named(name)?.map(Some).ok_or_else(|| {
                Fault::new(format!("#<{name}> has no value yet: assign one before"))
            }),
            Expr::Negate(inner) => Ok(Some(-self.number(inner)?)),
            Expr::Binary(op, a, b) => self.binary(*op, self.value(a)?, self.value(b)?),
            Expr::Call(Func::Exists, arguments) => self.exists(arguments),
            Expr::Call(func, arguments) => self.call(*func, arguments),
        }
    }

    /// The value of an operand: a null is zero.
    fn number(&self, expr: &Expr) -> Checked<f64> {
        Ok(self.value(expr)?.unwrap_or(0.0))
    }

    fn exists(&self, arguments: &[Expr]) -> Checked<Option<f64>> {
        match arguments {
            [Expr::Named(name)] => Ok(Some(truth(self.from.named(name)?.is_some()))),
            _ => Err(Fault::new(
                "EXISTS asks for a named parameter: EXISTS[#<name>]",
            )),
        }
    }

    fn binary(&self, op: Op, a: Option<f64>, b: Option<f64>) -> Checked<Option<f64>> {
        let is_linuxcnc = self.from.dialect() == ControlFamily::LinuxCnc;
        let (x, y) = (a.unwrap_or(0.0), b.unwrap_or(0.0));
        let value = match op {
            Op::Add => x + y,
            Op::Sub => x - y,
            Op::Mul => x * y,
            Op::Div if y == 0.0 => return Err(Fault::ps(112, "division by zero")),
            Op::Div => x / y,
            Op::Mod if is_linuxcnc => {
                if y == 0.0 {
                    return Err(Fault::new("MOD by zero"));
                }
                let rest = libm::fmod(x, y);
                if rest < 0.0 { rest + y.abs() } else { rest }
            }
            Op::Mod => {
                let divisor = y.round();
                if divisor == 0.0 {
                    return Err(Fault::ps(112, "MOD by zero"));
                }
                libm::fmod(x.round(), divisor)
            }
            Op::Power => libm::pow(x, y),
            Op::And if is_linuxcnc => truth(x != 0.0 && y != 0.0),
            Op::Or if is_linuxcnc => truth(x != 0.0 || y != 0.0),
            Op::Xor if is_linuxcnc => truth((x != 0.0) != (y != 0.0)),
            Op::And => f64::from(bits(x)? & bits(y)?),
            Op::Or => f64::from(bits(x)? | bits(y)?),
            Op::Xor => f64::from(bits(x)? ^ bits(y)?),
            // Null equals null only; in an order it counts as zero.
            Op::Eq => truth(a == b),
            Op::Ne => truth(a != b),
            Op::Gt => truth(x > y),
            Op::Lt => truth(x < y),
            Op::Ge => truth(x >= y),
            Op::Le => truth(x <= y),
        };
        finite(value).map(Some)
    }

    fn call(&self, func: Func, arguments: &[Expr]) -> Checked<Option<f64>> {
        let is_macro_b = self.from.dialect().is_macro_b();
        let (first, second) = match arguments {
            [first] => (first, None),
            [first, second] => (first, Some(self.number(second)?)),
            _ => return Err(Fault::ps(114, "a function has one or two arguments")),
        };
        let x = self.number(first)?;
        let value = match func {
            Func::Sin => sine(x),
            Func::Cos => sine(90.0 - x),
            Func::Tan => {
                let cosine = sine(90.0 - x);
                if cosine == 0.0 {
                    return Err(Fault::ps(119, format!("TAN[{x}] has no value")));
                }
                sine(x) / cosine
            }
            Func::Asin | Func::Acos if x.abs() > 1.0 => {
                return Err(Fault::ps(
                    119,
                    format!("ASIN and ACOS take -1 to 1, not {x}"),
                ));
            }
            // Custom Macro B: 270 to 90 degrees (Fanuc 6004#0 NAT = 0).
            Func::Asin => {
                let angle = libm::asin(x).to_degrees();
                if is_macro_b && angle < 0.0 {
                    angle + 360.0
                } else {
                    angle
                }
            }
            Func::Acos => libm::acos(x).to_degrees(),
            Func::Atan => match second {
                None => libm::atan(x).to_degrees(),
                Some(y) => {
                    let angle = libm::atan2(x, y).to_degrees();
                    // 0 to 360 degrees with NAT = 0; Haas and LinuxCNC -180 to 180.
                    let is_turn = matches!(
                        self.from.dialect(),
                        ControlFamily::Fanuc | ControlFamily::Mitsubishi
                    );
                    if is_turn && angle < 0.0 {
                        angle + 360.0
                    } else {
                        angle
                    }
                }
            },
            Func::Sqrt if x < 0.0 => {
                return Err(Fault::ps(119, format!("SQRT of a negative number: {x}")));
            }
            Func::Sqrt => libm::sqrt(x),
            Func::Abs => x.abs(),
            Func::Bin => from_bcd(x)?,
            Func::Bcd => to_bcd(x)?,
            Func::Round => match self.round_to.filter(|_| is_macro_b) {
                Some(step) => {
                    let per_unit = (1.0 / step).round();
                    (x * per_unit).round() / per_unit
                }
                None => x.round(),
            },
            Func::Fix if is_macro_b => x.trunc(),
            Func::Fup if is_macro_b => {
                if x < 0.0 {
                    x.floor()
                } else {
                    x.ceil()
                }
            }
            Func::Fix => x.floor(),
            Func::Fup => x.ceil(),
            Func::Ln if x <= 0.0 => {
                return Err(Fault::ps(
                    119,
                    format!("LN takes numbers above zero, not {x}"),
                ));
            }
            Func::Ln => libm::log(x),
            Func::Exp => libm::exp(x),
            Func::Pow => libm::pow(x, second.unwrap_or(0.0)),
            Func::Exists => return self.exists(arguments),
        };
        finite(value).map(Some)
    }
}

fn truth(holds: bool) -> f64 {
    if holds { 1.0 } else { 0.0 }
}

fn finite(value: f64) -> Checked<f64> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Fault::ps(
            111,
            "result too large, or none: check the operands",
        ))
    }
}

/// The sine of an angle in degrees, exact at multiples of 90.
fn sine(degrees: f64) -> f64 {
    let turned = libm::fmod(degrees, 360.0);
    let (angle, sign) = if turned < 0.0 {
        (-turned, -1.0)
    } else {
        (turned, 1.0)
    };
    let value = if angle == 0.0 || angle == 180.0 {
        0.0
    } else if angle == 90.0 {
        1.0
    } else if angle == 270.0 {
        -1.0
    } else {
        libm::sin(angle.to_radians())
    };
    sign * value
}

/// 32 bits of an operand of AND, OR, XOR.
fn bits(value: f64) -> Checked<i32> {
    let whole = value.round();
    if whole >= f64::from(i32::MIN) && whole <= f64::from(i32::MAX) {
        Ok(whole as i32)
    } else {
        Err(Fault::ps(110, format!("{value} has more than 32 bits")))
    }
}

/// Eight decimal digits, four bits each.
fn from_bcd(value: f64) -> Checked<f64> {
    let mut code = bits(value)?.unsigned_abs();
    let mut result = 0.0;
    let mut place = 1.0;
    while code > 0 {
        let digit = code & 0xF;
        if digit > 9 {
            return Err(Fault::ps(119, format!("BIN[{value}] is no decimal code")));
        }
        result += f64::from(digit) * place;
        place *= 10.0;
        code >>= 4;
    }
    Ok(result)
}

fn to_bcd(value: f64) -> Checked<f64> {
    let mut number = u32::try_from(bits(value)?)
        .ok()
        .filter(|n| *n <= 99_999_999)
        .ok_or_else(|| Fault::ps(119, format!("BCD takes 0 to 99999999, not {value}")))?;
    let mut code = 0u32;
    let mut shift = 0;
    while number > 0 {
        code |= (number % 10) << shift;
        number /= 10;
        shift += 4;
    }
    Ok(f64::from(code))
}

#[cfg(test)]
#[path = "evaluate_tests.rs"]
mod tests;
