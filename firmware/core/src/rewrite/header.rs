//! What stands at the head of a rewritten program.

use core::fmt::{self, Write as _};

use heapless::Vec;

use super::refusal::RewriteRefusal;
use super::text::emit::Out;
use super::text::words::At;
use crate::correction::{Compared, RunCheck};
use crate::decimal::Decimal;
use crate::rewrite::{ProgramIdentity, RewriteSettings};

/// A check value of a program: CRC-32 (ISO-HDLC, as in zip and PNG) over all its bytes.
#[derive(Clone)]
pub struct Check {
    digest: crc::Digest<'static, u32>,
    bytes: u64,
}

static CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

impl Default for Check {
    fn default() -> Self {
        Self {
            digest: CRC.digest(),
            bytes: 0,
        }
    }
}

impl Check {
    /// Takes the next bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        self.digest.update(bytes);
        self.bytes += bytes.len() as u64;
    }

    /// The value and how many bytes it is of.
    #[must_use]
    pub fn finish(self) -> ProgramIdentity {
        ProgramIdentity {
            crc32: self.digest.finalize(),
            bytes: self.bytes,
        }
    }
}

/// How its comment begins: by this a rewritten program is known.
const MARK: &[u8] = b"UMI REWRITTEN";

/// Where the mark of a rewritten program stands in a line: in any case, blanks or not, as
/// editors and transfers leave it; as a comment of either kind.
pub(in crate::rewrite) fn mark(line: &[u8]) -> Option<usize> {
    let begins = |at: &usize| {
        let mut text = line.iter().skip(*at + 1).filter(|byte| **byte != b' ');
        let mut mark = MARK.iter().filter(|byte| **byte != b' ');
        mark.all(|byte| text.next().is_some_and(|of| of.eq_ignore_ascii_case(byte)))
    };
    memchr::memchr2_iter(b'(', b';', line).find(begins)
}

/// The longest line of a comparison, without its blanks.
const MAX_COMPARED: usize = 64;

/// Follows the comparison of the run that an earlier rewriting has written, in each of its forms
/// (`RunCheck::lines`). Whether it stays or another takes its place, it moves nothing.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::rewrite) struct Earlier {
    next: Next,
    /// Of the last one.
    pub run: Option<u32>,
}

/// The line of a comparison that comes next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Next {
    /// The first, or none.
    #[default]
    First,
    Alarm,
    Label,
    Abort,
    EndOfIf,
}

impl Earlier {
    /// Takes a line of a comparison: whether it is the first of it; none if it is no such line.
    ///
    /// # Errors
    /// A comparison has begun, and this line does not belong to it.
    pub fn takes(&mut self, line: &[u8]) -> At<Option<bool>> {
        let mut text = Vec::<u8, MAX_COMPARED>::new();
        let visible = line.iter().filter(|byte| !matches!(byte, b' ' | b'\t'));
        let mut fits = true;
        for byte in visible {
            fits &= text.push(byte.to_ascii_uppercase()).is_ok();
        }
        if fits && text.is_empty() {
            // What is between CR and LF.
            return Ok(None);
        }
        let text = text.as_slice();
        let begins = core::mem::take(&mut self.next);
        let next =
            match begins {
                Next::First => {
                    let Some((run, next)) = fits.then(|| first_of(text)).flatten() else {
                        return Ok(None);
                    };
                    self.run = Some(run);
                    Some(next)
                }
                Next::Alarm => (text.strip_prefix(b"#3000=2(") == self.said().as_deref())
                    .then_some(Next::Label),
                Next::Label => (text == b"N7").then_some(Next::First),
                Next::Abort => (text.strip_prefix(b"(ABORT,") == self.said().as_deref())
                    .then_some(Next::EndOfIf),
                Next::EndOfIf => (text == b"O531ENDIF").then_some(Next::First),
            };
        self.next = next.ok_or((0, RewriteRefusal::Flow))?;
        Ok(Some(begins == Next::First))
    }

    /// What the alarm says.
    fn said(&self) -> Option<Vec<u8, MAX_COMPARED>> {
        let mut text = Vec::new();
        write!(text, "UMIPROGRAMOFRUN{})", self.run?).ok()?;
        Some(text)
    }
}

/// The run of the first line of a comparison, and the line that follows it.
fn first_of(text: &[u8]) -> Option<(u32, Next)> {
    let (rest, is_linuxcnc) = match text.strip_prefix(b"O531") {
        Some(rest) => (rest, true),
        None => (text, false),
    };
    let (_, rest) = whole(rest.strip_prefix(b"IF[#")?)?;
    let (run, behind) = whole(rest.get(2..)?)?;
    let mut alarm = Vec::<u8, MAX_COMPARED>::new();
    write!(alarm, "]THEN#3000=2(UMIPROGRAMOFRUN{run})").ok()?;
    let next = match (rest.get(..2)?, is_linuxcnc) {
        (b"NE", true) if behind == b"]" => Next::Abort,
        (b"NE", false) if behind == alarm.as_slice() => Next::First,
        (b"EQ", false) if behind == b"]GOTO7" => Next::Alarm,
        _ => return None,
    };
    Some((run, next))
}

/// A whole number, and what stands behind it.
fn whole(text: &[u8]) -> Option<(u32, &[u8])> {
    let digits = text.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let (number, rest) = text.split_at_checked(digits)?;
    Some((core::str::from_utf8(number).ok()?.parse().ok()?, rest))
}

/// Writes the comparison of the run, each line ended as the program's are.
pub(in crate::rewrite) fn compare<S: FnMut(&[u8])>(
    check: RunCheck,
    eol: &[u8],
    out: &mut Out<'_, S>,
) {
    // `Out` takes everything.
    let _ = check.lines(Compared::Program, |line| {
        out.write_fmt(line)?;
        out.put(eol);
        Ok(())
    });
}

/// Writes the header, each line ended as the program's are.
pub(in crate::rewrite) fn write<S: FnMut(&[u8])>(
    settings: &RewriteSettings,
    eol: &[u8],
    out: &mut Out<'_, S>,
) {
    // `Out` takes everything.
    let _ = lines(settings, eol, out);
}

fn lines<S: FnMut(&[u8])>(
    settings: &RewriteSettings,
    eol: &[u8],
    out: &mut Out<'_, S>,
) -> fmt::Result {
    let end = |out: &mut Out<'_, S>| {
        out.put(b")");
        out.put(eol);
    };
    out.put(b"(");
    out.put(MARK);
    if let Some(ProgramIdentity { crc32, bytes }) = settings.original {
        write!(out, " FROM CRC32 {crc32:08X} OF {bytes} BYTES")?;
    }
    end(out);
    if !settings.source.is_empty() {
        out.write_str("(")?;
        for c in settings.source.chars() {
            out.write_char(match c.to_ascii_uppercase() {
                c @ ('A'..='Z' | '0'..='9' | ' ' | '.' | '-' | ',') => c,
                _ => '-',
            })?;
        }
        end(out);
    }
    let r = &settings.transform.rotation;
    for row in r.row_iter() {
        out.write_str("(R")?;
        for value in row.iter() {
            write!(out, " {}", Decimal::nearest(*value, 9)?)?;
        }
        end(out);
    }
    out.write_str("(T ")?;
    for value in settings.transform.translation_mm.iter() {
        write!(out, "{} ", Decimal::nearest(*value, 6)?)?;
    }
    out.write_str("MM")?;
    end(out);
    write!(
        out,
        "(STEP {} MM - ARCS WITHIN {} MM",
        Decimal::of_steps(1, settings.decimals_mm),
        Decimal::nearest(settings.chord.0, 4)?
    )?;
    end(out);
    Ok(())
}
