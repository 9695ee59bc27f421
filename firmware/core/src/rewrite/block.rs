//! The words of one block by their meaning, and the G codes that are known.

use super::refusal::{RewriteRefusal, Why};
use super::state::Motion;
use super::text::words::{At, Number, Value, Word, Words};

/// Axis letters in order.
pub(super) const AXES: [u8; 3] = *b"XYZ";
/// Letters of centres in order.
pub(super) const CENTRES: [u8; 3] = *b"IJK";

/// A set of letters, a bit for each: a block is asked for many letters that it does not have,
/// and this way for all of them at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Letters(u32);

impl Letters {
    /// What axis words and centres are.
    pub const AXES: Self = Self::of(&AXES);
    pub const CENTRES: Self = Self::of(&CENTRES);

    /// Upper case letters.
    pub const fn of(mut letters: &[u8]) -> Self {
        let mut set = Self(0);
        while let [letter, rest @ ..] = letters {
            set = set.with(*letter);
            letters = rest;
        }
        set
    }

    /// With another letter; what is none changes nothing.
    pub const fn with(self, letter: u8) -> Self {
        Self(self.0 | Self::bit(letter))
    }

    pub const fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    pub const fn less(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    pub const fn has(self, letter: u8) -> bool {
        self.0 & Self::bit(letter) != 0
    }

    pub const fn has_any(self, others: Self) -> bool {
        self.0 & others.0 != 0
    }

    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    const fn bit(letter: u8) -> u32 {
        if letter.is_ascii_uppercase() {
            1 << (letter - b'A')
        } else {
            0
        }
    }
}

/// What uses the axis words of a block for itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Taker {
    /// G4: X is a time.
    Dwell,
    /// G22: they are machine coordinates. G50.1: they say which mirrors end.
    Nothing,
    /// G65: they are what the macro is given.
    Call,
    /// G10.
    Data,
    /// G28, G30.
    Reference(u16),
    /// G52.
    Local,
    /// G53.
    Machine,
    /// G92.
    Here,
    /// G92.1 with axes: Fanuc's way to end G52 and G92.
    Preset,
}

/// What a G code is to a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Code {
    /// Nothing to it.
    Nothing,
    Motion(Motion),
    Cycle,
    EndOfCycle,
    Takes(Taker),
    /// Index of the plane's normal axis.
    Plane(usize),
    Inch,
    Millimetre,
    Absolute,
    Incremental,
    AbsoluteCentres,
    IncrementalCentres,
    InverseTime,
    PerMinute,
    PerRevolution,
    Compensated,
    NotCompensated,
    Length,
    NoLength,
    /// A work offset by number, 1 to 9.
    Work(u16),
    /// A work offset by P, G54.1 and G154.
    ExtendedWork,
    EndOfShift,
    ToR,
    ToInitial,
    /// G65.
    MacroCall,
    Refused(Why),
    Unknown,
}

/// What a G code, in tenths, is to a path.
pub(super) const fn code(tenths: u16) -> Code {
    match tenths {
        0 => Code::Motion(Motion::Rapid),
        10 => Code::Motion(Motion::Line),
        20 => Code::Motion(Motion::Clockwise),
        30 => Code::Motion(Motion::Counter),
        40 => Code::Takes(Taker::Dwell),
        220 | 501 => Code::Takes(Taker::Nothing),
        100 => Code::Takes(Taker::Data),
        280 | 300 => Code::Takes(Taker::Reference(tenths)),
        520 => Code::Takes(Taker::Local),
        530 => Code::Takes(Taker::Machine),
        920 => Code::Takes(Taker::Here),
        // Look-ahead, exact stop, cancelled functions, limits, blending, spindle speed.
        50 | 51 | 80 | 90 | 110 | 131 | 150 | 230 | 500 | 610 | 611 | 620 | 630 | 640 | 670
        | 690 | 691 | 970 | 1030 | 1870 => Code::Nothing,
        170 => Code::Plane(2),
        180 => Code::Plane(1),
        190 => Code::Plane(0),
        200 => Code::Inch,
        210 => Code::Millimetre,
        400 => Code::NotCompensated,
        410 | 420 | 411 | 421 => Code::Compensated,
        430 | 440 => Code::Length,
        490 => Code::NoLength,
        540 | 550 | 560 | 570 | 580 | 590 => Code::Work((tenths - 530) / 10),
        591..=593 => Code::Work(tenths - 584),
        541 | 1540 => Code::ExtendedWork,
        1120 | 1130 => Code::Refused(Why::Coordinates),
        // Haas: G110 to G129, less those two.
        1100..=1290 if tenths.is_multiple_of(10) => Code::Work(tenths / 10),
        730 | 740 | 760 | 810 | 820 | 830 | 840 | 850 | 860 | 870 | 880 | 890 => Code::Cycle,
        800 => Code::EndOfCycle,
        900 => Code::Absolute,
        910 => Code::Incremental,
        901 => Code::AbsoluteCentres,
        911 => Code::IncrementalCentres,
        921 => Code::EndOfShift,
        930 => Code::InverseTime,
        940 => Code::PerMinute,
        950 => Code::PerRevolution,
        980 => Code::ToInitial,
        990 => Code::ToR,
        70 | 71 | 121 | 160 | 171 | 431 | 432 | 434 | 435 | 510 | 511 | 531 | 542 | 544 | 680
        | 681 | 682 | 683 | 684 | 1070 => Code::Refused(Why::Coordinates),
        52
        | 53
        | 120
        | 130
        | 310
        | 311
        | 320
        | 330
        | 331
        | 340
        | 382..=385
        | 450
        | 460
        | 470
        | 480
        | 600 => Code::Refused(Why::Motion),
        650 => Code::MacroCall,
        660 | 661 => Code::Refused(Why::Macro),
        270 | 290 => Code::Refused(Why::Through),
        922 | 923 => Code::Refused(Why::Offsets),
        _ => Code::Unknown,
    }
}

/// Where each letter stands in a block.
pub(super) struct Given<'a> {
    words: &'a Words,
    /// Index of the word and one; 0 is none. Those of G, M and T are not told.
    indices: [u8; 26],
    /// All that there are.
    pub letters: Letters,
    /// `,R` or `,C`.
    pub corner: Option<usize>,
}

impl<'a> Given<'a> {
    /// Finds the words; each letter but G, M and T once.
    pub fn new(words: &'a Words) -> At<Self> {
        let mut given = Self {
            words,
            indices: [0; 26],
            letters: Letters::default(),
            corner: None,
        };
        for (index, word) in words.iter().enumerate() {
            given.letters = given.letters.with(word.letter);
            match word.letter {
                b',' => given.corner = Some(index),
                // Of two tools a changer puts one in and brings the next (Mazak: `T1 T2 M6`).
                b'G' | b'M' | b'T' => {}
                letter => {
                    let slot = given
                        .indices
                        .get_mut(usize::from(letter.wrapping_sub(b'A')));
                    if let Some(slot) = slot {
                        if *slot != 0 {
                            return Err((word.start, RewriteRefusal::Twice(letter as char)));
                        }
                        // At most MAX_WORDS.
                        *slot = index as u8 + 1;
                    }
                }
            }
        }
        Ok(given)
    }

    /// The word with this letter.
    pub fn find(&self, letter: u8) -> Option<usize> {
        let slot = self.indices.get(usize::from(letter.wrapping_sub(b'A')))?;
        usize::from(*slot).checked_sub(1)
    }

    /// Whether there is a word with this letter.
    pub const fn has(&self, letter: u8) -> bool {
        self.letters.has(letter)
    }

    pub fn words(&self) -> impl Iterator<Item = &'a Word> {
        self.words.iter()
    }

    pub fn word(&self, index: usize) -> Option<&'a Word> {
        self.words.get(index)
    }

    /// Where a word stands, to name the place.
    pub fn column(&self, index: usize) -> usize {
        self.word(index).map_or(0, |word| word.start)
    }

    /// The number behind a letter, if there is one.
    pub fn number(&self, letter: u8) -> At<Option<Number>> {
        let Some(word) = self.find(letter).and_then(|index| self.word(index)) else {
            return Ok(None);
        };
        match word.value {
            Value::Number(number) => Ok(Some(number)),
            Value::Expression => Err((word.start, RewriteRefusal::Expression(letter as char))),
        }
    }

    /// The whole number behind a letter, not negative.
    pub fn whole(&self, letter: u8) -> At<Option<u32>> {
        let Some(number) = self.number(letter)? else {
            return Ok(None);
        };
        let unit = super::text::length::power(number.decimals);
        let value = u32::try_from(number.digits / unit)
            .ok()
            .filter(|_| number.digits % unit == 0);
        let column = self.find(letter).map_or(0, |index| self.column(index));
        value
            .map(Some)
            .ok_or((column, RewriteRefusal::Meaningless(letter as char)))
    }

    /// Indices of X, Y, Z.
    pub fn axes(&self) -> [Option<usize>; 3] {
        AXES.map(|letter| self.find(letter))
    }
}

/// A code such as `G54.1` in tenths.
pub(super) fn tenths(number: Number) -> Option<u16> {
    if number.decimals == 0 {
        // Nearly all: two long divisions less.
        return u16::try_from(number.digits.checked_mul(10)?).ok();
    }
    let scale = super::text::length::power(number.decimals);
    let tenths = number.digits.checked_mul(10)?;
    if tenths % scale != 0 {
        return None;
    }
    u16::try_from(tenths / scale).ok()
}
