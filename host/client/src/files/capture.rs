//! What a capture looks like, told where a job finds nothing in it.

use std::fmt;

use umi_protocol::pattern::{LinePattern, ReceiverConfig};

/// What the lines of a capture look like, whatever a job reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CaptureLook {
    /// Lines that are not blank.
    pub lines: usize,
    /// Those that begin as openumi's checked lines do.
    pub checked: usize,
    /// Those of three numbers alone, as blocks of points have them.
    pub points: usize,
    /// Bytes that are no text in seven bits.
    pub strange: usize,
}

impl CaptureLook {
    /// Looks at bytes; a parity bit is left out.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        let mut look = Self::default();
        let text: Vec<u8> = bytes.iter().map(|byte| byte & 0x7F).collect();
        look.strange = text
            .iter()
            // Line ends, tabs, and what a port sends when it is opened and closed.
            .filter(|byte| !matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n' | 0 | 0x11..=0x14 | 0x7F))
            .count();
        for line in text.split(|byte| matches!(byte, b'\r' | b'\n')) {
            let line = String::from_utf8_lossy(line);
            let line = line.trim_matches(|c: char| c.is_whitespace() || c.is_control());
            if line.is_empty() {
                continue;
            }
            look.lines += 1;
            look.checked += usize::from(line.starts_with("UMI1 "));
            look.points += usize::from(is_point(line));
        }
        look
    }

    /// What is there, what the job reads, and what to do.
    #[must_use]
    pub fn nothing_measured(self, receiver: &ReceiverConfig) -> NothingMeasured {
        let has = |of: fn(&LinePattern) -> bool| receiver.patterns.iter().any(of);
        let advice = match self {
            Self { strange, lines, .. } if strange > 4 * lines => Advice::Code,
            Self { lines: 0, .. } => Advice::Empty,
            Self {
                points, checked: 0, ..
            } if points > 0 && !has(|p| !matches!(p, LinePattern::Checked(_))) => Advice::Blocks,
            Self { checked, .. }
                if checked > 0 && !has(|p| matches!(p, LinePattern::Checked(_))) =>
            {
                Advice::Checked
            }
            _ => Advice::Patterns,
        };
        NothingMeasured { look: self, advice }
    }
}

/// Three numbers and what stands between them: `*-135.0190*-136.6200*148.6090`, blanks too.
fn is_point(line: &str) -> bool {
    let is_number = |c: char| c.is_ascii_digit() || matches!(c, '.' | '+' | '-' | ' ' | '*' | ',');
    line.chars().all(is_number) && line.matches('.').count() == 3
}

/// A capture of which nothing became a feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NothingMeasured {
    look: CaptureLook,
    advice: Advice,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Advice {
    Empty,
    Blocks,
    Checked,
    Code,
    Patterns,
}

impl fmt::Display for NothingMeasured {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let CaptureLook {
            lines,
            checked,
            points,
            ..
        } = self.look;
        match self.advice {
            Advice::Empty => f.write_str("nothing measured: there is no line in the file"),
            Advice::Blocks => write!(
                f,
                "nothing measured: {lines} lines, {points} of them points of blocks, and the job reads \
                 checked lines (UMI1 ...) only; take a job with a block pattern, as \
                 examples/three-spheres.toml, or probe with the macros of hw/control"
            ),
            Advice::Checked => write!(
                f,
                "nothing measured: {lines} lines, {checked} of them checked (UMI1 ...), and the job \
                 does not read those; take a job with patterns = [{{ checked = {{}} }}], as \
                 examples/four-spheres.toml"
            ),
            Advice::Code => write!(
                f,
                "nothing measured: there is hardly any text in ISO or ASCII ({lines} lines); say the \
                 control's code (`coding` of [receiver], as \"eia\"), or capture with its settings of \
                 the line"
            ),
            Advice::Patterns => write!(
                f,
                "nothing measured: no feature is complete in {lines} lines; hold them against the \
                 job's patterns and features (umi job check)"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::job_file;

    fn receiver(file: &str) -> ReceiverConfig {
        let path = format!("{}/../../examples/{file}", env!("CARGO_MANIFEST_DIR"));
        job_file::parse(&std::fs::read_to_string(path).unwrap())
            .unwrap()
            .receiver
    }

    /// Each kind of capture in front of each kind of job.
    #[test]
    fn what_is_there_and_what_to_do() {
        let blocks =
            b"SPHERE1\r\n***\r\n5\r\n*-135.0190*-136.6200*148.6090\r\n- 1.0000 2.0000 3.0000\r\n";
        // With even parity, as ISO has it.
        let even: Vec<u8> = blocks
            .iter()
            .map(|byte| byte | u8::from(byte.count_ones() % 2 == 1) << 7)
            .collect();
        for bytes in [&blocks[..], &even] {
            let look = CaptureLook::of(bytes);
            assert_eq!(
                (look.lines, look.points, look.checked, look.strange),
                (5, 2, 0, 0)
            );
            let said = look
                .nothing_measured(&receiver("four-spheres.toml"))
                .to_string();
            assert!(
                said.contains("5 lines, 2 of them points of blocks"),
                "{said}"
            );
            let said = look
                .nothing_measured(&receiver("three-spheres.toml"))
                .to_string();
            assert!(said.contains("no feature is complete"), "{said}");
        }
        let checked = CaptureLook::of(b"UMI1 R 1 S 1 B 1 A 7 T 0 F 0. X 0. Y 0. Z 0. C 1.0\n");
        let said = checked
            .nothing_measured(&receiver("three-spheres.toml"))
            .to_string();
        assert!(said.contains("1 of them checked"), "{said}");
        let said = CaptureLook::of(b"\r\n\n").nothing_measured(&receiver("four-spheres.toml"));
        assert!(said.to_string().contains("no line"), "{said}");
        let said = CaptureLook::of(&[1, 2, 3, 4, 5, 6, 7, 8, 10])
            .nothing_measured(&receiver("four-spheres.toml"));
        assert!(said.to_string().contains("coding"), "{said}");
    }
}
