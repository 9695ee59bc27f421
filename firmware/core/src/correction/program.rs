//! The correction program as text: a dialect's program with its keys filled in.

use core::fmt::{self, Write};

use heapless::String;
use umi_protocol::job::{CorrectionSpec, Dialect, ProgramEnd, WorkOffset};
use umi_protocol::verdict::{MAX_CORRECTION, Verdict};

use super::dialect::{self, Form};
use super::run_check::{Compared, RunCheck};
use super::{NotExpressible, Plan};
use crate::decimal::Decimal;

/// Leave to correct: exists only for a setup with no reason against it.
///
/// Nothing else in the crate can make one, and [`write()`] asks for it, so no
/// program that calls itself cleared comes into being without an OK verdict.
#[derive(Debug)]
pub struct Cleared(());

impl Cleared {
    /// Leave to correct, if there is no reason against it.
    pub(crate) fn if_no_reasons(reasons: usize) -> Option<Self> {
        (reasons == 0).then_some(Self(()))
    }

    /// Leave to correct once more by a verdict that was OK.
    #[must_use]
    pub fn by(verdict: &Verdict) -> Option<Self> {
        let reasons = verdict.reasons.len() + usize::from(verdict.reasons_dropped);
        Self::if_no_reasons(reasons).filter(|_| verdict.ok)
    }
}

/// The figures of the verdict that stand in the program's comments.
#[derive(Clone, Copy, Debug)]
pub struct Figures<'a> {
    /// The job's name.
    pub job: &'a str,
    /// The setup's number, from 0.
    pub setup: u32,
    /// Rms of the registration's residuals, mm.
    pub rms_mm: f64,
    /// Rotation about Z, degrees.
    pub turn_deg: f64,
    /// Tilt, degrees.
    pub tilt_deg: f64,
    /// The control's variable that counts the runs, and the run that was measured: where
    /// both are known, the program raises an alarm in any other run.
    pub run: Option<(u32, u32)>,
}

/// The complete program, lines ended by LF.
///
/// In the manner of Fanuc `G69` comes first, so that a rotation that is still
/// active does not turn the offset. `G17 G21 G90` stay active, as do the offset and,
/// with `M99`, the rotation: the caller sets its own modes after the call, and a
/// comment says so. No word in any of them moves an axis.
///
/// # Errors
/// [`NotExpressible`] if the text outgrows its buffer (a job name and figures
/// within their limits never do).
pub fn write(
    _cleared: &Cleared,
    spec: &CorrectionSpec,
    plan: &Plan,
    figures: &Figures<'_>,
) -> Result<String<MAX_CORRECTION>, NotExpressible> {
    fill(spec, plan, &Origin::Verdict(figures))
}

/// The same from what somebody gives, which it says in its comments. A board never does this.
///
/// # Errors
/// As [`write()`].
pub fn write_given(
    spec: &CorrectionSpec,
    plan: &Plan,
    source: &str,
) -> Result<String<MAX_CORRECTION>, NotExpressible> {
    fill(spec, plan, &Origin::Given(source))
}

/// What a program rests on.
enum Origin<'a> {
    Verdict(&'a Figures<'a>),
    Given(&'a str),
}

#[inline(never)]
fn fill(
    spec: &CorrectionSpec,
    plan: &Plan,
    origin: &Origin<'_>,
) -> Result<String<MAX_CORRECTION>, NotExpressible> {
    let mut writer = Writer {
        out: String::new(),
        form: dialect::form(spec.dialect),
        spec,
        plan,
        origin,
    };
    writer.program().map_err(|fmt::Error| NotExpressible)?;
    Ok(writer.out)
}

struct Writer<'a> {
    out: String<MAX_CORRECTION>,
    form: Form,
    spec: &'a CorrectionSpec,
    plan: &'a Plan,
    origin: &'a Origin<'a>,
}

impl Writer<'_> {
    fn program(&mut self) -> fmt::Result {
        let returns = self.spec.ends_with == ProgramEnd::M99;
        let mut characters = self.form.program.chars();
        // Within `^…|…^`: whether this half is for the program's end.
        let mut half = None;
        while let Some(c) = characters.next() {
            match (c, half) {
                ('^', None) => half = Some(returns),
                ('^', Some(_)) => half = None,
                ('|', Some(shown)) => half = Some(!shown),
                ('{', _) => {
                    let key = characters.next().unwrap_or_default();
                    characters.next();
                    if half != Some(false) {
                        self.key(key)?;
                    }
                }
                (_, Some(false)) => {}
                _ => self.out.write_char(c)?,
            }
        }
        Ok(())
    }

    fn key(&mut self, key: char) -> fmt::Result {
        let plan = self.plan;
        let ([x, y, z], [o, p, q]) = (plan.shift, plan.probed);
        let ([u, v], [i, j, k], [a, b, c]) = (plan.point, plan.axis, plan.angles);
        let (mm, deg) = (self.form.decimals_mm, self.form.decimals_deg);
        let (steps, decimals) = match key {
            'x' => (x, mm),
            'y' => (y, mm),
            'z' => (z, mm),
            'o' => (o, mm),
            'p' => (p, mm),
            'q' => (q, mm),
            'u' => (u, mm),
            'v' => (v, mm),
            'i' => (i, mm),
            'j' => (j, mm),
            'k' => (k, mm),
            'a' => (a, deg),
            'b' => (b, deg),
            'c' => (c, deg),
            'h' => (self.check_value(), mm),
            'H' => {
                let unit = i64::from(10u32.pow(mm.into()));
                let (number, run) = (i64::from(self.number()), i64::from(self.run()));
                // A tenth of the run: the sum keeps to the eight digits of a control.
                (self.check_value() + 7 * number * unit + run * unit / 10, mm)
            }
            _ => return self.word(key),
        };
        write!(self.out, "{}", Decimal::of_steps(steps, decimals))
    }

    /// The keys that are not measured.
    fn word(&mut self, key: char) -> fmt::Result {
        let spec = self.spec;
        let offset = spec.write_to;
        let number = offset.p_number();
        let is_haas = self.spec.dialect == Dialect::Haas;
        let (l, first) = match offset {
            WorkOffset::Extended(n) if n <= if is_haas { 20 } else { 48 } => (20, 7001),
            WorkOffset::Extended(_) => (20, 14_001),
            _ => (2, 5221),
        };
        let variable = |axis| first + number.saturating_sub(1).saturating_mul(20) + axis;
        let set = self.form.set(spec);
        let (with_further, run) = (self.number(), self.run());
        let out = &mut self.out;
        match key {
            'w' => self.offset(offset),
            'f' => self.offset(spec.probed_in),
            'g' => write!(out, "G10 L{l} P{number}"),
            'n' => write!(out, "{number}"),
            'N' => write!(out, "{with_further}"),
            'r' => write!(out, "{run}"),
            'X' => write!(out, "{}", variable(0)),
            'Y' => write!(out, "{}", variable(1)),
            'Z' => write!(out, "{}", variable(2)),
            'R' => write!(out, "{}", variable(9)),
            't' => {
                let group = if is_haas { 12 } else { 14 };
                write!(out, "ABS[#40{group}")?;
                match offset {
                    WorkOffset::Extended(n) => {
                        let code = if is_haas { "154" } else { "54.1" };
                        write!(out, "-{code}]+ABS[#4130-{n}]")
                    }
                    _ => write!(out, "-{}]", 53 + number),
                }?;
                out.write_str(
                    "+ABS[#4002-17]+ABS[#4003-90]+ABS[#4006-21]+ABS[#4008-#9]+ABS[#4009-80]",
                )
            }
            's' => write!(out, "{set}"),
            'm' => write!(out, "{:04}", spec.program_number),
            'e' => out.write_str(match spec.ends_with {
                ProgramEnd::M99 => "M99",
                ProgramEnd::M30 => "M30",
            }),
            '#' => self.comments(),
            '?' => self.run_check(),
            _ => match key.to_digit(10) {
                Some(digit) => write!(out, "{}", u32::from(set) + digit),
                None => Err(fmt::Error),
            },
        }
    }

    /// Stops, before anything is set, where the control has begun another run since.
    fn run_check(&mut self) -> fmt::Result {
        let Origin::Verdict(Figures {
            run: Some((variable, run)),
            ..
        }) = self.origin
        else {
            return Ok(());
        };
        let out = &mut self.out;
        match RunCheck::of_correction(self.spec.dialect, *variable, *run) {
            Some(check) => check.lines(Compared::Correction, |line| writeln!(out, "{line}")),
            None => Ok(()),
        }
    }

    /// What the macro on a Haas compares; 0: nothing.
    fn run(&self) -> u32 {
        match self.origin {
            Origin::Verdict(figures) => figures.run.map_or(0, |(_, run)| run),
            Origin::Given(_) => 0,
        }
    }

    /// What the macro on a Haas takes for the work offset: 100 more beyond G59.
    fn number(&self) -> u16 {
        let number = self.spec.write_to.p_number();
        match self.spec.write_to {
            WorkOffset::Extended(_) => number.saturating_add(100),
            _ => number,
        }
    }

    fn check_value(&self) -> i64 {
        (1..)
            .zip(self.plan.checked(&self.form))
            .map(|(weight, steps)| weight * steps)
            .sum()
    }

    fn offset(&mut self, offset: WorkOffset) -> fmt::Result {
        match (offset, self.form.further) {
            (WorkOffset::Extended(number), Some((name, digits, ..))) => {
                write!(self.out, "{name}{number:00$}", usize::from(digits))
            }
            _ => write!(self.out, "{offset}"),
        }
    }

    fn comments(&mut self) -> fmt::Result {
        let (begin, end) = self.form.comment;
        let out = &mut self.out;
        match self.origin {
            Origin::Given(source) => {
                write!(
                    out,
                    "{begin}MADE BY UMI AND NOT BY A BOARD{end}{begin}FROM "
                )?;
                comment(out, source)?;
                out.write_str(end)?;
            }
            Origin::Verdict(figures) => {
                write!(
                    out,
                    "{begin}VERDICT OK - SETUP {}{end}{begin}JOB ",
                    figures.setup
                )?;
                comment(out, figures.job)?;
                write!(
                    out,
                    "{end}{begin}REGISTRATION RMS {} MM{end}{begin}TURN {} DEG - TILT {} DEG{end}",
                    Decimal::nearest(figures.rms_mm, 4)?,
                    Decimal::nearest(figures.turn_deg, 4)?,
                    Decimal::nearest(figures.tilt_deg, 4)?
                )?;
            }
        }
        // Rounded up: what is stated is never less than what is left.
        let tenths_um = libm::fabs(libm::ceil(self.plan.uncorrected.0 * 1e4 - 1e-6));
        write!(
            out,
            "{begin}LEFT AT PART {} MM - LIMIT {} MM{end}",
            Decimal::nearest(tenths_um * 1e-4, 4)?,
            Decimal::nearest(self.spec.leftover_mm, 4)?
        )
    }
}

/// Upper case and only what every control takes inside a comment.
fn comment(out: &mut String<MAX_CORRECTION>, text: &str) -> fmt::Result {
    for c in text.chars() {
        out.write_char(match c.to_ascii_uppercase() {
            c @ ('A'..='Z' | '0'..='9' | ' ' | '.') => c,
            _ => '-',
        })?;
    }
    Ok(())
}
