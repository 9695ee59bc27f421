use super::*;
use crate::nc::text::cursor::{Cursor, Line};
use crate::nc::text::expression::Parser;

/// #1 = 10, #2 null, #3 = 1, #10 = 3.
struct Four(ControlFamily);

impl Lookup for Four {
    fn dialect(&self) -> ControlFamily {
        self.0
    }
    fn variable(&self, number: u32) -> Checked<Option<f64>> {
        match number {
            1 => Ok(Some(10.0)),
            3 => Ok(Some(1.0)),
            10 => Ok(Some(3.0)),
            0 | 2 => Ok(None),
            _ => Err(Fault::ps(115, "none")),
        }
    }
    fn named(&self, name: &str) -> Checked<Option<f64>> {
        Ok((name == "a").then_some(7.0))
    }
}

fn compute(dialect: ControlFamily, text: &str) -> Checked<Option<f64>> {
    let line = Line::new(text, dialect)?;
    let mut cursor = Cursor::new(&line);
    let expr = Parser::new(&mut cursor, dialect).expression()?;
    if cursor.peek().is_some() {
        return Err(Fault::new("text left"));
    }
    evaluate(&expr, &Four(dialect))
}

fn fanuc(text: &str) -> Option<f64> {
    compute(ControlFamily::Fanuc, text).expect(text)
}

fn number_of(text: &str) -> Option<u32> {
    let fault = compute(ControlFamily::Fanuc, text).expect_err(text);
    fault.in_block(ControlFamily::Fanuc, 1, 1, "").number
}

/// Functions before products before sums; AND as a product, OR as a sum; from the left.
#[test]
fn strength_of_operators() {
    assert_eq!(fanuc("1+2*3"), Some(7.0));
    assert_eq!(fanuc("10-2-3"), Some(5.0));
    assert_eq!(fanuc("2*SIN[30]+1").map(|v| (v * 1e9).round()), Some(2e9));
    assert_eq!(fanuc("1+6AND3"), Some(3.0));
    assert_eq!(fanuc("4OR1*2"), Some(6.0));
    assert_eq!(fanuc("[1+2]*3"), Some(9.0));
    assert_eq!(fanuc("-#1+1"), Some(-9.0));
    assert_eq!(fanuc("7MOD4"), Some(3.0));
    let linuxcnc = |text| compute(ControlFamily::LinuxCnc, text).expect(text);
    assert_eq!(linuxcnc("2*3**2"), Some(18.0));
    assert_eq!(linuxcnc("1 + 1 EQ 2 AND 3 GT 2"), Some(1.0));
    assert_eq!(linuxcnc("-1 MOD 4"), Some(3.0));
    assert_eq!(linuxcnc("#<A>+1"), Some(8.0));
    assert_eq!(linuxcnc("EXISTS[#<b>]"), Some(0.0));
}

/// Both forms of ATAN, the ranges of NAT = 0, exact values at right angles.
#[test]
fn angles() {
    let near = |text: &str, value: f64| {
        let got = fanuc(text).expect(text);
        assert!((got - value).abs() < 1e-9, "{text} {got}");
    };
    near("ATAN[1]/[1]", 45.0);
    near("ATAN[-1]/[-1]", 225.0);
    near("ATAN[-1,1]", 315.0);
    near("ATAN[1]", 45.0);
    near("ATAN[4]/#1", 7.596_375_653_2);
    near("ASIN[-0.5]", 330.0);
    near("ACOS[-1]", 180.0);
    assert_eq!(fanuc("COS[90]"), Some(0.0));
    assert_eq!(fanuc("SIN[-450]"), Some(-1.0));
    assert_eq!(number_of("TAN[90]"), Some(119));
}

/// A null alone stays null, counts as zero in a computation, and is unequal to zero.
#[test]
fn null() {
    assert_eq!(fanuc("#2"), None);
    assert_eq!(fanuc("[#2]"), None);
    assert_eq!(fanuc("#2*5"), Some(0.0));
    assert_eq!(fanuc("#2+#2"), Some(0.0));
    assert_eq!(fanuc("#2EQ#0"), Some(1.0));
    assert_eq!(fanuc("#2EQ0"), Some(0.0));
    assert_eq!(fanuc("#2NE0"), Some(1.0));
    assert_eq!(fanuc("#2GE#0"), Some(1.0));
    assert_eq!(fanuc("#2GT0"), Some(0.0));
    assert_eq!(fanuc("[#2EQ#0]AND[#1GT9]"), Some(1.0));
}

/// Variables by computed numbers.
#[test]
fn indirect() {
    assert_eq!(fanuc("#[#3]"), Some(10.0));
    assert_eq!(fanuc("##3"), Some(10.0));
    assert_eq!(fanuc("#[2*[#3+4]]"), Some(3.0));
    assert_eq!(number_of("#[0-5]"), Some(115));
    assert_eq!(number_of("#[1.5]"), Some(115));
}

/// Rounding functions and codes.
#[test]
fn rounding() {
    assert_eq!(fanuc("ROUND[-2.5]"), Some(-3.0));
    assert_eq!(fanuc("FIX[-1.7]"), Some(-1.0));
    assert_eq!(fanuc("FUP[-1.2]"), Some(-2.0));
    assert_eq!(
        compute(ControlFamily::LinuxCnc, "FIX[-1.2]"),
        Ok(Some(-2.0))
    );
    assert_eq!(fanuc("BCD[12]"), Some(18.0));
    assert_eq!(fanuc("BIN[18]"), Some(12.0));
    assert_eq!(fanuc("POW[2,10]"), Some(1024.0));
}

/// What has no value is an alarm with its number.
#[test]
fn no_value() {
    assert_eq!(number_of("1/0"), Some(112));
    assert_eq!(number_of("1/#2"), Some(112));
    assert_eq!(number_of("SQRT[-1]"), Some(119));
    assert_eq!(number_of("LN[0]"), Some(119));
    assert_eq!(number_of("EXP[1000]"), Some(111));
    assert_eq!(number_of("3000000000AND1"), Some(110));
    assert_eq!(number_of("[[[[[[1]]]]]]"), Some(118));
    assert_eq!(number_of("1+"), Some(114));
    assert_eq!(number_of("SIN30"), Some(114));
    assert_eq!(number_of("1.5.5"), None);
    assert_eq!(number_of("1234567890123456"), Some(3));
    let minuses = "-".repeat(500);
    assert_eq!(number_of(&minuses), Some(114));
}

/// Blanks mean nothing to a control: operators and functions may touch.
#[test]
fn glued_words() {
    for (text, expected) in [
        ("[10MODFIX[3.9]]", 1.0),
        ("[7ANDABS[-3]]", 3.0),
        ("[4ORROUND[1.2]]", 5.0),
        ("[6XORFUP[2.5]]", 5.0),
    ] {
        assert_eq!(fanuc(text), Some(expected), "{text}");
    }
}
