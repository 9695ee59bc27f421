//! The correction program as text.

use core::fmt::{self, Write};

use heapless::String;
use umi_protocol::job::{CorrectionSpec, Dialect, ProgramEnd};
use umi_protocol::verdict::MAX_CORRECTION;

use super::{DECIMALS, NotExpressible, Plan};

/// Leave to correct: exists only for a plate with no reason against it.
///
/// Nothing else in the crate can make one, and [`write()`] asks for it, so no
/// program text comes into being without an OK verdict.
#[derive(Debug)]
pub struct Cleared(());

impl Cleared {
    /// Leave to correct, if there is no reason against it.
    pub(crate) fn if_no_reasons(reasons: usize) -> Option<Self> {
        (reasons == 0).then_some(Self(()))
    }
}

/// The figures of the verdict that stand in the program's comments.
#[derive(Clone, Copy, Debug)]
pub struct Figures<'a> {
    /// The job's name.
    pub job: &'a str,
    /// The plate's number, from 0.
    pub plate: u32,
    /// Rms of the registration's residuals, mm.
    pub rms_mm: f64,
    /// Rotation about Z, degrees.
    pub turn_deg: f64,
    /// Tilt, degrees.
    pub tilt_deg: f64,
}

/// The complete program, lines ended by LF.
///
/// `G69` comes first, so that a rotation that is still active does not turn
/// the offset. `G17 G21 G90` stay active, as do the offset and, with `M99`, the
/// rotation: the caller sets its own modes after the call, and a comment says so.
/// No word in it moves an axis.
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
    let mut text = String::new();
    match spec.dialect {
        Dialect::G10G68 => g10_g68(&mut text, spec, plan, figures),
    }
    .map_err(|fmt::Error| NotExpressible)?;
    Ok(text)
}

fn g10_g68(
    out: &mut String<MAX_CORRECTION>,
    spec: &CorrectionSpec,
    plan: &Plan,
    figures: &Figures<'_>,
) -> fmt::Result {
    let [x, y, z] = plan.origin_um;
    let [center_x, center_y] = plan.center_um;
    let offset = spec.write_to;
    let end = match spec.ends_with {
        ProgramEnd::M99 => "M99",
        ProgramEnd::M30 => "M30",
    };

    out.write_str("%\n")?;
    writeln!(
        out,
        "O{:04}(UMI CORRECTION {offset:?})",
        spec.program_number
    )?;
    writeln!(out, "(VERDICT OK - PLATE {})", figures.plate)?;
    out.write_str("(JOB ")?;
    comment(out, figures.job)?;
    out.write_str(")\n")?;
    writeln!(out, "(REGISTRATION RMS {:.4} MM)", figures.rms_mm)?;
    writeln!(
        out,
        "(TURN {:.4} DEG - TILT {:.4} DEG)",
        figures.turn_deg, figures.tilt_deg
    )?;
    writeln!(
        out,
        "(LEFT AT PART {:.4} MM - LIMIT {:.4} MM)",
        plan.leftover.0, spec.leftover_mm
    )?;
    let [from_x, from_y, from_z] = spec.probed_origin_mm;
    writeln!(
        out,
        "({:?} WAS X{from_x:.3} Y{from_y:.3} Z{from_z:.3} - RUN WITH {offset:?})",
        spec.probed_in
    )?;
    out.write_str(match spec.ends_with {
        ProgramEnd::M99 => "(LEAVES G17 G21 G90 G68 ACTIVE - CALLER MUST NOT G69)\n",
        ProgramEnd::M30 => "(OFFSET ONLY)\n",
    })?;
    out.write_str("G17 G21 G90\nG69\n")?;
    writeln!(
        out,
        "G10 L2 P{} X{} Y{} Z{}",
        offset.p_number(),
        Decimal(x),
        Decimal(y),
        Decimal(z)
    )?;
    writeln!(out, "{offset:?}")?;
    if spec.ends_with == ProgramEnd::M99 {
        writeln!(
            out,
            "G68 X{} Y{} R{}",
            Decimal(center_x),
            Decimal(center_y),
            Decimal(plan.angle_mdeg)
        )?;
    }
    writeln!(out, "{end}\n%")
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

/// Thousandths with a decimal point, always: `X100` would be 0.1 mm.
struct Decimal(i64);

impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = 10u64.pow(DECIMALS);
        let magnitude = self.0.unsigned_abs();
        let sign = if self.0 < 0 { "-" } else { "" };
        let (whole, thousandths) = (magnitude / unit, magnitude % unit);
        if thousandths == 0 {
            write!(f, "{sign}{whole}.")
        } else {
            write!(f, "{sign}{whole}.{thousandths:03}")
        }
    }
}
