//! What can be computed from the text alone, and cannot: `1/0`, `SQRT[-1]`, `#0=1`.

use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::settings::ControlFamily;
use crate::nc::run::control::Control;
use crate::nc::text::block::{Assign, Statement};
use crate::nc::text::evaluate::{Lookup, evaluate, variable_number};
use crate::nc::text::expression::Expr;
use crate::nc::text::oword::Flow;

/// Adds what is wrong with the values of a statement.
pub(super) fn check(statement: &Statement, control: &mut Control, faults: &mut Vec<Fault>) {
    for expr in values_of(statement) {
        check_value(expr, control, faults);
    }
    for assign in assigns_of(statement) {
        check_target(&assign.target, control, faults);
    }
}

/// The expressions of a statement, targets of assignments apart.
fn values_of(statement: &Statement) -> Vec<&Expr> {
    match statement {
        Statement::Words(words, assigns) => words
            .iter()
            .map(|word| &word.value)
            .chain(assigns.iter().map(|assign| &assign.value))
            .collect(),
        Statement::IfGoto(condition, target) => vec![condition, target],
        Statement::IfThen(condition, assign) => vec![condition, &assign.value],
        Statement::Goto(target) => vec![target],
        Statement::Do(condition, _) => condition.iter().collect(),
        Statement::End(_) | Statement::Open | Statement::Close => Vec::new(),
        Statement::Print(format) => format.variables().collect(),
        Statement::OWord(word) => match &word.flow {
            Flow::If(value) | Flow::ElseIf(value) | Flow::While(value) | Flow::Repeat(value) => {
                vec![value]
            }
            Flow::EndSub(value) | Flow::Return(value) => value.iter().collect(),
            Flow::Call(arguments) => arguments.iter().collect(),
            _ => Vec::new(),
        },
    }
}

fn assigns_of(statement: &Statement) -> &[Assign] {
    match statement {
        Statement::Words(_, assigns) => assigns,
        Statement::IfThen(_, assign) => std::slice::from_ref(assign),
        _ => &[],
    }
}

/// Values without variables.
struct Constants(ControlFamily);

impl Lookup for Constants {
    fn dialect(&self) -> ControlFamily {
        self.0
    }

    fn variable(&self, number: u32) -> Checked<Option<f64>> {
        Err(Fault::new(format!("#{number} is not constant")))
    }

    fn named(&self, _: &str) -> Checked<Option<f64>> {
        Ok(None)
    }
}

/// Whether nothing in it depends on a variable.
fn is_constant(expr: &Expr) -> bool {
    !matches!(expr, Expr::Variable(_) | Expr::Named(_))
        && expr.operands().into_iter().all(is_constant)
}

// The depth is bounded by the length of a line.
fn check_value(expr: &Expr, control: &Control, faults: &mut Vec<Fault>) {
    let constants = Constants(control.settings().dialect);
    if is_constant(expr) {
        faults.extend(evaluate(expr, &constants).err());
        return;
    }
    if let Expr::Variable(number) = expr
        && is_constant(number)
    {
        let read = variable_number(number, &constants).and_then(|n| control.read(n, None));
        faults.extend(read.err());
        return;
    }
    for operand in expr.operands() {
        check_value(operand, control, faults);
    }
}

fn check_target(target: &Expr, control: &mut Control, faults: &mut Vec<Fault>) {
    match target {
        Expr::Variable(number) if is_constant(number) => {
            let constants = Constants(control.settings().dialect);
            let written =
                variable_number(number, &constants).and_then(|n| control.write(n, Some(0.0), None));
            faults.extend(written.err());
        }
        Expr::Variable(number) => check_value(number, control, faults),
        _ => {}
    }
}
