//! The code of the characters: ASCII, ISO with even parity, ASCII with odd
//! parity, EIA RS-244. The port receives eight raw data bits; what bit 7 (or
//! channel 5) means is decided here.
//!
//! # Detection
//!
//! Every byte speaks for some codes and against others: a text in ISO code has
//! no character of odd parity, one in EIA code none of even parity, plain ASCII
//! has bit 7 clear. The [`Detector`] counts for each code how many bytes of the
//! line contradict it. A byte ends the line if it is a line end in the code that
//! is contradicted least. So an ISO or ASCII line is not split at 0x80 (EIA's
//! end of block), nor an ISO line at 0x0D, which is a minus sign with one wrong
//! bit.
//!
//! A code that was once clear is kept. A single line, let alone a single wrong
//! bit, does not change it: that takes [`CHANGE`] contradictions in lines that
//! another code explains without effort.

use umi_protocol::pattern::Coding;

use super::code_table::{
    ASCII, CHARACTERS, CODES, CONTRADICTS, Character, ETX, XOFF, XOFF_EVEN, XON, ends,
};

/// Contradictions that make a known code give way to another.
const CHANGE: u16 = 8;
/// A code explains a line if another is contradicted so many times as often.
const RATIO: u16 = 8;
/// Difference in contradictions that makes a first decision worth keeping.
const CLEAR: u16 = 2;

/// What is wrong with the characters of a line. Positions count from 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::dprnt) struct Damage {
    /// Characters with wrong parity, and the position of the first.
    pub bad_parity: u16,
    pub first_bad_parity: u16,
    /// Characters that the code does not have, position and value of the first.
    pub unknown: u16,
    pub first_unknown: u16,
    pub unknown_byte: u8,
}

impl Damage {
    fn add_bad_parity(&mut self, count: u16, position: u16) {
        if self.bad_parity == 0 {
            self.first_bad_parity = position;
        }
        self.bad_parity += count;
    }

    fn add_unknown(&mut self, byte: u8, position: u16) {
        if self.unknown == 0 {
            self.first_unknown = position;
            self.unknown_byte = byte;
        }
        self.unknown += 1;
    }
}

/// NUL or DEL, with or without a parity bit.
const fn is_fill(byte: u8) -> bool {
    matches!(byte & 0x7F, 0x00 | 0x7F)
}

/// What was made of a raw line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::dprnt) struct Cleaned {
    /// Characters of the cleaned text.
    pub length: usize,
    /// Bytes that were control codes.
    pub dropped: usize,
    /// What is wrong with it.
    pub damage: Damage,
    /// NUL or DEL stood between two characters.
    pub fill_inside: bool,
    /// The other side had ended a transmission before this text.
    pub closed_before: bool,
    /// The other side ended its transmission after this text.
    pub closed_after: bool,
}

/// Turns a raw line into text, in place. Characters that cannot be read become
/// `?`. `ended` says that the line has a line end.
pub(in crate::dprnt) fn clean(line: &mut [u8], coding: Coding, ended: bool) -> Cleaned {
    let code = number_of(coding).unwrap_or(ASCII);
    let Some(characters) = CHARACTERS.get(usize::from(code)) else {
        return Cleaned::default();
    };
    let mut cleaned = Cleaned::default();
    let damage = &mut cleaned.damage;
    let mut length = 0usize;
    let mut fill = false;
    let mut suspects = 0;
    let mut at = 0;
    while let Some(&byte) = line.get(at) {
        at += 1;
        let position = u16::try_from(length.saturating_add(1)).unwrap_or(u16::MAX);
        let character = characters.get(usize::from(byte)).copied();
        let text = match character.unwrap_or(Character::Unknown) {
            Character::Text(text) => text,
            // XOFF and XON together are what they seem, whatever their parity.
            _ if matches!(byte, XOFF | XOFF_EVEN) && line.get(at) == Some(&XON) => {
                at += 1;
                continue;
            }
            // A line end kept here came while another code was believed in.
            _ if length == 0 && ends(byte) & 1 << code != 0 => continue,
            Character::Dropped => {
                fill |= length > 0 && is_fill(byte);
                continue;
            }
            Character::Suspect => {
                fill |= length > 0 && is_fill(byte);
                suspects += 1;
                continue;
            }
            Character::Close => {
                // At either end it is a mark; inside it is damage, which shows
                // when more text follows.
                if length == 0 {
                    cleaned.closed_before = true;
                } else {
                    cleaned.closed_after = true;
                }
                continue;
            }
            Character::BadParity => {
                damage.add_bad_parity(1, position);
                b'?'
            }
            Character::Unknown => {
                damage.add_unknown(byte, position);
                b'?'
            }
        };
        // Text follows what is harmless only where a transmission ends.
        damage.add_bad_parity(core::mem::take(&mut suspects), position);
        if core::mem::take(&mut cleaned.closed_after) {
            damage.add_unknown(ETX, position);
        }
        cleaned.fill_inside |= core::mem::take(&mut fill);
        if let Some(place) = line.get_mut(length) {
            *place = text;
        }
        length += 1;
    }
    if ended && suspects > 0 {
        let position = u16::try_from(length.saturating_add(1)).unwrap_or(u16::MAX);
        damage.add_bad_parity(suspects, position);
    }
    cleaned.length = length;
    cleaned.dropped = line.len() - length;
    cleaned
}

fn number_of(coding: Coding) -> Option<u8> {
    let place = CODES.iter().position(|code| *code == coding)?;
    u8::try_from(place).ok()
}

/// Decides in which code a line is written.
#[derive(Clone, Debug)]
pub(in crate::dprnt) struct Detector {
    /// The code that the job states.
    configured: Option<u8>,
    /// The code that was clear.
    known: Option<u8>,
    /// Another code, and contradictions of the known one that it explains.
    rival: u8,
    against: u16,
    /// Contradictions in the line so far.
    counts: [u16; 4],
}

impl Detector {
    pub fn new(coding: Coding) -> Self {
        Self {
            configured: number_of(coding),
            known: None,
            rival: ASCII,
            against: 0,
            counts: [0; 4],
        }
    }

    /// The code that is believed in.
    pub fn coding(&self) -> Coding {
        let code = self.configured.or(self.known);
        code.and_then(|code| CODES.get(usize::from(code)).copied())
            .unwrap_or(Coding::Auto)
    }

    /// Whether control codes, which have even parity, are one wrong bit away
    /// from characters.
    pub fn has_odd_parity(&self) -> bool {
        matches!(self.coding(), Coding::AsciiOdd | Coding::Eia)
    }

    /// Notes a byte of the line.
    pub fn note(&mut self, byte: u8) {
        if self.configured.is_none() {
            self.counts = self.with(byte);
        }
    }

    /// Whether this byte ends the line. It has not been noted.
    pub fn is_end(&self, byte: u8) -> bool {
        let ends = ends(byte);
        if ends == 0 {
            return false;
        }
        let code = self
            .configured
            .unwrap_or_else(|| self.choose(self.with(byte), ends));
        ends & 1 << code != 0
    }

    /// The line is at its end: its code, and the code before if it changed.
    pub fn conclude(&mut self, end: Option<u8>) -> (Coding, Option<Coding>) {
        if self.configured.is_some() {
            return (self.coding(), None);
        }
        let counts = end.map_or(self.counts, |byte| self.with(byte));
        self.counts = [0; 4];
        let before = self.coding();
        let code = self.choose(counts, end.map_or(0, ends));
        self.learn(code, counts);
        let coding = CODES.get(usize::from(code)).copied();
        let coding = coding.unwrap_or(Coding::Ascii);
        let changed = before != Coding::Auto && before != coding;
        (coding, changed.then_some(before))
    }

    fn with(&self, byte: u8) -> [u16; 4] {
        let mut counts = self.counts;
        let weights = CONTRADICTS.get(usize::from(byte)).unwrap_or(&[0; 4]);
        for (count, weight) in counts.iter_mut().zip(weights) {
            *count = count.saturating_add(u16::from(*weight));
        }
        counts
    }

    /// The code that is contradicted least. Equal ones: the known one, then one
    /// in which the line ends here.
    fn least(&self, counts: [u16; 4], ends: u8) -> (u8, u16) {
        let mut best = (ASCII, u16::MAX);
        let mut best_rank = 0;
        for (code, count) in (0u8..).zip(counts) {
            let rank = 2 * u8::from(self.known == Some(code)) + u8::from(ends & 1 << code != 0);
            if count < best.1 || (count == best.1 && rank > best_rank) {
                best = (code, count);
                best_rank = rank;
            }
        }
        best
    }

    fn choose(&self, counts: [u16; 4], ends: u8) -> u8 {
        let (best, least) = self.least(counts, ends);
        match self.known {
            Some(known) if known != best => {
                let count = counts.get(usize::from(known)).copied().unwrap_or(0);
                let before = if self.rival == best { self.against } else { 0 };
                let change = explains(least, count) && before.saturating_add(count) >= CHANGE;
                if change { best } else { known }
            }
            _ => best,
        }
    }

    fn learn(&mut self, chosen: u8, counts: [u16; 4]) {
        let (best, least) = self.least(counts, 0);
        let Some(known) = self.known else {
            let others = (0u8..).zip(counts).filter(|(code, _)| *code != chosen);
            let next = others.map(|(_, count)| count).min().unwrap_or(0);
            if chosen == best && next >= least.saturating_add(CLEAR) && explains(least, next) {
                self.known = Some(chosen);
            }
            return;
        };
        let count = counts.get(usize::from(known)).copied().unwrap_or(0);
        if chosen != known {
            self.known = Some(chosen);
            self.against = 0;
        } else if best != known && explains(least, count) {
            if self.rival != best {
                self.rival = best;
                self.against = 0;
            }
            self.against = self.against.saturating_add(count);
        } else if (0u8..)
            .zip(counts)
            .all(|(code, other)| code == known || other > count)
        {
            // Only the known code explains this line best.
            self.against = 0;
        }
    }
}

/// Whether a code contradicted `least` times explains a line that contradicts
/// another one `count` times.
const fn explains(least: u16, count: u16) -> bool {
    count > 0 && least.saturating_mul(RATIO) <= count
}
