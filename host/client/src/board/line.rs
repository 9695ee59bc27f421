//! How a control's line is set, found by listening at each speed.
//!
//! # How it is judged
//!
//! At the right speed every character has its stop bit, all of them have one code's parity, nearly
//! all stand in what controls print, and lines end. At a wrong one a UART hears broken characters,
//! or others. So a speed *fits* where nothing is broken, one code takes every character that came,
//! they are not the same few again and again, and at least one line has ended. A code is one of [`CODES`]; a character is known where the code
//! has it and a control prints it, or where it is a control's code (DC1 to DC4, NUL, line ends).

use std::time::{Duration, Instant};

use umi_core::dprnt::{Coding, encode};
use umi_protocol::message::{Event, LineRefusal, Record};
use umi_protocol::serial::{ALIGNING_CHARACTERS, Cts, LineFamily, LineSettings};

use crate::board::link::{Client, LinkError};

/// The codes in which controls print.
pub const CODES: [Coding; 4] = [
    Coding::Ascii,
    Coding::IsoEven,
    Coding::AsciiOdd,
    Coding::Eia,
];

/// With fewer characters nothing is said: they may be right by chance.
pub const LEAST_CHARACTERS: usize = 24;

/// Fewer different characters may be others at half the speed: `1` and a line end are.
pub const LEAST_DIFFERENT: usize = 6;

/// What controls print besides letters and digits.
const SIGNS: &[u8] = b" +-.,*/()[]=:#%?_&@!\"';<>";

/// What came at one speed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Listened {
    /// Characters, as they came.
    pub bytes: Vec<u8>,
    /// Characters without a stop bit, or lost otherwise, at least.
    pub broken: u32,
}

/// What can be said of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// The code that takes most of the characters.
    pub coding: Coding,
    /// Of all characters, those that are not in that code, parity wrong or never printed.
    pub strange: usize,
    /// Line ends, a run of them taken as one.
    pub lines: usize,
    /// Whether all is right but that no line has ended.
    pub endless: bool,
    /// How many different characters came where all is right but that these are too few to tell this speed from others.
    pub few: Option<usize>,
    /// Whether the control's line is set like this.
    pub fits: bool,
}

impl Listened {
    /// Judges what came.
    #[must_use]
    pub fn judge(&self) -> Judged {
        let strange = |coding| {
            let bytes = self.bytes.iter();
            bytes.filter(move |byte| !is_known(coding, **byte))
        };
        let least = CODES
            .into_iter()
            .map(|coding| (strange(coding).count(), coding))
            .min_by_key(|(count, _)| *count);
        let (strange, coding) = least.unwrap_or((0, Coding::Auto));
        let ends = |byte: &u8| is_line_end(coding, *byte);
        let mut before = false;
        let mut lines = 0;
        for byte in &self.bytes {
            let is_end = ends(byte);
            lines += usize::from(is_end && !before);
            before = is_end;
        }
        let mut different = self.bytes.clone();
        different.sort_unstable();
        different.dedup();
        let clean = self.bytes.len() >= LEAST_CHARACTERS && self.broken == 0 && strange == 0;
        let few = different.len() < LEAST_DIFFERENT;
        let right = clean && !few;
        Judged {
            coding,
            strange,
            lines,
            endless: right && lines == 0,
            few: (clean && few).then_some(different.len()),
            fits: right && lines > 0,
        }
    }

    /// Whether so much has come that it can be judged, one way or the other.
    #[must_use]
    pub fn is_enough(&self) -> bool {
        let judged = self.judge();
        judged.fits
            || self.broken >= 8
            || judged.strange >= 8
            || self.bytes.len() >= 40 * LEAST_CHARACTERS
    }
}

fn is_known(coding: Coding, byte: u8) -> bool {
    if byte == 0 || byte == 0x7F || is_line_end(coding, byte) {
        return true;
    }
    // DC1 to DC4, SI and SO, with any parity: in EIA they have even parity.
    if matches!(byte, 0x11 | 0x12 | 0x93 | 0x14) {
        return true;
    }
    let printed = (0x20..0x7F_u8).filter(|c| c.is_ascii_alphanumeric() || SIGNS.contains(c));
    let mut own = printed.chain([0x09, 0x0E, 0x0F, 0x13]);
    own.any(|ascii| encode(coding, ascii) == Some(byte))
}

fn is_line_end(coding: Coding, byte: u8) -> bool {
    let ends = match coding {
        Coding::Eia => return byte == 0x80,
        _ => [b'\n', b'\r'],
    };
    ends.iter().any(|end| encode(coding, *end) == Some(byte))
}

/// How long what comes is not listened to: what was on its way at the other speed, and what is not aligned yet.
fn settling(line: LineSettings) -> Duration {
    let aligned = Duration::from_micros(ALIGNING_CHARACTERS * line.character_us());
    aligned.max(Duration::from_millis(300))
}

/// Listens at one speed until enough has come to judge, or for so long.
///
/// # Errors
/// The link's; the board's refusal.
pub fn listen(
    board: &mut Client,
    line: LineSettings,
    longest: Duration,
) -> Result<Result<Listened, LineRefusal>, LinkError> {
    board.live(true)?;
    if let Err(refusal) = board.listen(Some(line))? {
        return Ok(Err(refusal));
    }
    let settled = Instant::now() + settling(line);
    while board
        .next_event(settled.saturating_duration_since(Instant::now()))?
        .is_some()
    {}
    let mut came = Listened::default();
    let mut is_first = true;
    let end = Instant::now() + longest;
    while Instant::now() < end && !came.is_enough() {
        let left = end.saturating_duration_since(Instant::now());
        let record = match board.next_event(left)? {
            Some(Event::Record { record, .. }) => record,
            Some(_) => continue,
            None => break,
        };
        match record {
            Record::Bytes { raw } => came.bytes.extend_from_slice(&raw),
            // The speed changed in the middle of a character.
            Record::BytesLost { count } if is_first => came.broken += count.saturating_sub(1),
            Record::BytesLost { count } => came.broken = came.broken.saturating_add(count),
            _ => continue,
        }
        is_first = false;
    }
    Ok(Ok(came))
}

/// The `[line]` of a job for what was found, with the families that mean the same. A board whose CTS nobody drives
/// would wait for ever, so it is not followed unless somebody says that it is wired.
#[must_use]
pub fn in_a_job(baud: u32, coding: Coding) -> String {
    let data_bits = match coding {
        Coding::IsoEven | Coding::AsciiOdd => 7,
        _ => 8,
    };
    let alike = LineFamily::ALL.iter().filter(|family| {
        let of = family.defaults();
        of.baud == baud && of.data_bits == data_bits && of.cts == Cts::Ignored
    });
    let alike: Vec<_> = alike
        .map(|family| format!("control = \"{}\"", family.name()))
        .collect();
    let or = match alike.is_empty() {
        true => String::new(),
        false => format!("   # the same: {}", alike.join(", or ")),
    };
    format!(
        "[line]{or}\nbaud = {baud}\ndata_bits = {data_bits}\n\
         stop_bits = 2     # what the board sends: a control takes 2 always\n\
         rts_cts = false   # true if the control's RTS and CTS are wired to the board"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &[u8] = b"UMI1 R 17 S 3 X- 135.019 Y- 136.620 C 4113.0474\n";

    fn listened(coding: Coding, broken: u32) -> Listened {
        let bytes = TEXT.iter().map(|byte| encode(coding, *byte).unwrap());
        Listened {
            bytes: bytes.collect(),
            broken,
        }
    }

    /// Each code is recognised; a broken character, a wrong parity or no line end does not fit.
    #[test]
    fn codes_are_told_apart() {
        for coding in CODES {
            let of = listened(coding, 0);
            let judged = of.judge();
            assert_eq!((judged.coding, judged.strange), (coding, 0));
            assert_eq!((judged.lines, judged.fits), (1, true), "{coding}");
            assert!(!listened(coding, 1).judge().fits);
            for place in 0..TEXT.len() {
                let mut wrong = of.clone();
                wrong.bytes[place] ^= 0x80;
                if wrong.bytes[place] == 0x93 {
                    // EIA's digit 3 with another parity is XOFF.
                    continue;
                }
                assert!(!wrong.judge().fits, "{coding} {place}");
            }
            let mut open = of.clone();
            open.bytes.pop();
            let judged = open.judge();
            assert!(judged.endless && !judged.fits, "no line has ended");
            let few = Listened {
                bytes: of.bytes[TEXT.len() - LEAST_CHARACTERS + 1..].to_vec(),
                broken: 0,
            };
            assert!(!few.judge().fits, "too few to say so");
        }
        assert!(!Listened::default().judge().fits);
    }

    /// `1` and a line end at 4800 baud are two other characters at 9600, each right: a few characters say nothing.
    #[test]
    fn the_same_few_characters_say_nothing() {
        let same = Listened {
            bytes: b"ab\n".repeat(40),
            broken: 0,
        };
        let judged = same.judge();
        assert_eq!((judged.strange, judged.lines, judged.fits), (0, 40, false));
        assert!(!judged.endless);
    }

    /// What Fanuc, Brother and Haas put around the text is known.
    #[test]
    fn what_stands_around_the_text() {
        let mut iso = listened(Coding::IsoEven, 0);
        iso.bytes.splice(0..0, [0x12, 0, 0]);
        iso.bytes.extend([0x8D, 0x8D, 0x14, 0x93]);
        let judged = iso.judge();
        assert!(judged.fits && judged.lines == 1, "{judged:?}");
    }
}
