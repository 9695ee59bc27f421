//! Profiles as a table of three lines each: a time in milliseconds, what the sensor saw along its
//! line (mm), and the distances (mm).
//!
//! * Cells are separated by tabs, or semicolons or commas where there are none. A line may begin
//!   with its name: `Timestamp(ms)`, `Lateral data`, `Distance data`.
//! * `-` or nothing is no value: a sample without a distance has no range. Programs that keep such
//!   tables as matrices fill short lines with zeros; samples at (0, 0) behind the last one are taken
//!   for that where there are several, or where the line would turn back for it.
//! * There is no frame counter: a profile's frame is its place.
//!
//! The form is that of a published scanner on a machining centre, whose own program loses every
//! line that begins with 0, and with it the order of all later ones. Here each line must be what its
//! place says.

use std::io::BufRead;

use crate::ScanError;
use crate::profile::{Profile, ProfilePoint, Stamp};

/// The longest line that is read, in bytes.
const LONGEST_LINE: u64 = 1 << 20;
/// What the lines of a profile are called.
const NAMES: [&str; 3] = ["timestamp", "lateral", "distance"];

/// Whether a file's first line that holds something begins such a table.
#[must_use]
pub fn begins(line: &str) -> bool {
    let cells = cells(line);
    let first = cells.first().map_or("", |cell| cell);
    first.to_lowercase().starts_with(NAMES[0]) || first.parse::<f64>().is_ok()
}

/// Hands out every profile of the table.
///
/// # Errors
/// `truncated` where it ends within a profile, `corrupt` where a line is not what its place says,
/// `not_finite`, or what `take` refuses.
pub fn visit<R: BufRead>(
    mut input: R,
    name: &str,
    mut take: impl FnMut(&Profile<'_>) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let mut lines = Lines {
        input: &mut input,
        name,
        line: 0,
        text: Vec::new(),
    };
    let mut samples = Vec::new();
    for profile in 0.. {
        let Some(time) = lines.next(0)? else {
            return Ok(());
        };
        let t_ms = match time.split_first() {
            // A matrix has zeros behind the time.
            Some((Some(t_ms), rest)) if rest.iter().all(|v| v.is_none_or(|v| v == 0.0)) => *t_ms,
            _ => return Err(lines.error("corrupt", "a time in ms is wanted here, and no more")),
        };
        let within = "the table ends within a profile: it was cut";
        let Some(along) = lines.next(1)? else {
            return Err(lines.error("truncated", within));
        };
        let Some(away) = lines.next(2)? else {
            return Err(lines.error("truncated", within));
        };
        if along.len() != away.len() {
            return Err(lines.error(
                "corrupt",
                &format!(
                    "{} distances for {} places along the line",
                    away.len(),
                    along.len()
                ),
            ));
        }
        let real = along.len() - filled(&along, &away);
        samples.clear();
        for (index, (x_mm, z_mm)) in along.iter().zip(&away).enumerate().take(real) {
            match (x_mm, z_mm) {
                (Some(x_mm), Some(z_mm)) => samples.push(ProfilePoint {
                    index: index as u32,
                    x_mm: *x_mm,
                    z_mm: *z_mm,
                }),
                (None, Some(_)) => {
                    return Err(lines.error("corrupt", "a distance without its place"));
                }
                (_, None) => {}
            }
        }
        let stamp = Stamp {
            profile,
            frame: profile,
            t_us: t_ms * 1e3,
            encoder: None,
        };
        take(&Profile {
            stamp,
            samples: &samples,
            intensities: None,
            invalid: (along.len() - samples.len()) as u64,
        })?;
    }
    Ok(())
}

/// How many samples at the end only fill a matrix.
fn filled(along: &[Option<f64>], away: &[Option<f64>]) -> usize {
    let pairs = || along.iter().zip(away).rev();
    let zeros = pairs()
        .take_while(|(x, z)| **x == Some(0.0) && **z == Some(0.0))
        .count();
    if zeros == 1 {
        let mut before = pairs().skip(1).filter_map(|(x, _)| *x);
        if let (Some(last), Some(other)) = (before.next(), before.next()) {
            // One at (0, 0) may be a sample, where the line goes on to it.
            return usize::from((0.0 - last) * (last - other) <= 0.0);
        }
        return 0;
    }
    zeros
}

/// The cells of a line, without blanks around them, and without empty ones at its end.
fn cells(line: &str) -> Vec<&str> {
    let separator = ['\t', ';', ',']
        .into_iter()
        .find(|&separator| line.contains(separator))
        .unwrap_or('\t');
    let mut cells: Vec<&str> = line.split(separator).map(str::trim).collect();
    while cells.last().is_some_and(|cell| cell.is_empty()) {
        cells.pop();
    }
    cells
}

struct Lines<'a, R> {
    input: &'a mut R,
    name: &'a str,
    /// The line that was read last, from 1.
    line: u64,
    text: Vec<u8>,
}

impl<R: BufRead> Lines<'_, R> {
    /// The values of the next line that holds something, which is the `role`-th of its profile; none
    /// at the end.
    fn next(&mut self, role: usize) -> Result<Option<Vec<Option<f64>>>, ScanError> {
        loop {
            self.text.clear();
            let mut limited = std::io::Read::take(&mut *self.input, LONGEST_LINE);
            let read = limited.read_until(b'\n', &mut self.text).map_err(|error| {
                ScanError::unreadable("file", format_args!("cannot read {}: {error}", self.name))
            })?;
            if read == 0 {
                return Ok(None);
            }
            self.line += 1;
            if !self.text.trim_ascii().is_empty() {
                break;
            }
        }
        if self.text.last() != Some(&b'\n') {
            if self.text.len() as u64 == LONGEST_LINE {
                return Err(self.error("corrupt", "a line of more than 1 MiB: this is no table"));
            }
            return Err(self.error(
                "truncated",
                "the last line has no line end, so its last number may be cut: if it is whole, end it",
            ));
        }
        let Ok(text) = std::str::from_utf8(&self.text) else {
            return Err(self.error("corrupt", "this is no text: bytes that are not UTF-8"));
        };
        let mut cells = cells(text.trim_start_matches('\u{FEFF}'));
        let label = cells.first().map_or("", |cell| cell).to_lowercase();
        if label.starts_with(NAMES[role]) {
            cells.remove(0);
        }
        let mut values = Vec::with_capacity(cells.len());
        for cell in cells {
            values.push(match cell {
                "" | "-" => None,
                cell => Some(self.number(cell, role)?),
            });
        }
        Ok(Some(values))
    }

    fn number(&self, cell: &str, role: usize) -> Result<f64, ScanError> {
        let value: f64 = cell.parse().map_err(|_| {
            self.error(
                "corrupt",
                &format!("{cell:?} is no number of the line {:?}", NAMES[role]),
            )
        })?;
        if value.is_finite() {
            return Ok(value);
        }
        Err(ScanError::refused(
            "not_finite",
            format_args!(
                "{}, line {}: {cell}: a finite number is needed",
                self.name, self.line
            ),
        )
        .with("line", self.line))
    }

    fn error(&self, code: &'static str, what: &str) -> ScanError {
        ScanError::unreadable(
            code,
            format_args!("{}, line {}: {what}", self.name, self.line),
        )
        .with("line", self.line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Taken = (Stamp, Vec<(u32, f64, f64)>, u64);

    fn read(text: &str) -> Result<Vec<Taken>, ScanError> {
        let mut all = Vec::new();
        visit(text.as_bytes(), "table", |profile| {
            let samples = profile.samples.iter();
            let samples = samples.map(|s| (s.index, s.x_mm, s.z_mm)).collect();
            all.push((profile.stamp, samples, profile.invalid));
            Ok(())
        })?;
        Ok(all)
    }

    /// The published table, and the one that its program loses lines of.
    #[test]
    fn each_line_is_what_its_place_says() {
        let named = "Timestamp(ms)\t0.000\t-\t-\r\nLateral data\t0.000\t0.046\t33.274\r\n\
                     Distance data\t0.230\t-\t-0.470\r\n\r\n\
                     Timestamp(ms)\t100.000\t-\nLateral data\t-30.344\nDistance data\t-22.303\n";
        let bare = "0.000\t\t\n0.000\t0.046\t33.274\n0.230\t\t-0.470\n\
                    100.000\n-30.344\n-22.303\n";
        let all = read(named).unwrap();
        assert_eq!(all, read(bare).unwrap());
        assert_eq!(all.len(), 2);
        assert_eq!(all[0].1, [(0, 0.0, 0.23), (2, 33.274, -0.47)]);
        assert_eq!((all[0].2, all[1].2), (1, 0));
        assert_eq!((all[1].0.profile, all[1].0.frame), (1, 1));
        assert_eq!(all[1].0.t_us, 100_000.0);
        assert!(begins(named) && begins(bare) && !begins("profile,frame,t_us"));
    }

    #[test]
    fn zeros_that_fill_a_matrix_are_no_samples() {
        let of = |along: &str, away: &str| {
            let all = read(&format!("5,0,0,0\n{along}\n{away}\n")).unwrap();
            (all[0].1.len(), all[0].2)
        };
        assert_eq!(of("-1,1,0,0", "7,8,0,0"), (2, 2));
        assert_eq!(of("-2,-1,1,0", "7,7,8,0"), (3, 1));
        // The line goes on to its own zero, and a sample on the way through it stays.
        assert_eq!(of("-3,-2,-1,0", "7,7,8,0"), (4, 0));
        assert_eq!(of("-1,0,1,2", "7,0,8,9"), (4, 0));
    }

    #[test]
    fn lines_that_do_not_fit_are_told() {
        for (text, code) in [
            ("5\n1,2\n3\n", "corrupt"),
            ("5,6\n1,2\n3,4\n", "corrupt"),
            ("5\n1,x\n3,4\n", "corrupt"),
            ("-\n1\n3\n", "corrupt"),
            ("5\n-,1\n3,4\n", "corrupt"),
            (
                "Timestamp(ms),5\nDistance data,1\nLateral data,3\n",
                "corrupt",
            ),
            ("5\n1,2\n3,nan\n", "not_finite"),
            ("5\n1,2\n3,1e999\n", "not_finite"),
            ("5\n1,2\n", "truncated"),
            ("5\n", "truncated"),
            ("5\n1,2\n3,4.5", "truncated"),
        ] {
            assert_eq!(read(text).unwrap_err().code, code, "{text:?}");
        }
        assert!(read("").unwrap().is_empty());
    }
}
