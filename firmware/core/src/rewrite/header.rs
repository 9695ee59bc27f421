//! What stands at the head of a rewritten program.

use core::fmt::{self, Write as _};

use super::text::emit::Out;
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

/// How it begins: by this a rewritten program is known.
const MARK: &[u8] = b"(UMI REWRITTEN";

/// Where the mark of a rewritten program stands in a line: in any case, blanks or not, as
/// editors and transfers leave it.
pub(in crate::rewrite) fn mark(line: &[u8]) -> Option<usize> {
    let begins = |at: &usize| {
        let mut text = line.iter().skip(*at).filter(|byte| **byte != b' ');
        let mut mark = MARK.iter().filter(|byte| **byte != b' ');
        mark.all(|byte| text.next().is_some_and(|of| of.eq_ignore_ascii_case(byte)))
    };
    memchr::memchr_iter(b'(', line).find(begins)
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
