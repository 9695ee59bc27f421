//! Receiver settings: line code, line patterns and number formats, by which bytes
//! become hits. This is the `receiver` part of a job.
//!
//! ```toml
//! [receiver]
//! coding = "auto"
//! travel_mm = { x = [-600.0, 0.0], y = [-500.0, 0.0], z = [-450.0, 0.0] }
//! patterns = [
//!     { block = { headers = ["SPHERE"] } },
//!     "grbl_probe",
//!     { template = { text = "PT {i} X={x} Y={y} Z={z}" } },
//! ]
//! ```
//!
//! In every pattern `*` and tab count as a blank, blanks between fields may be
//! of any number, and a sign may be separated from its digits by blanks
//! (`- 136.6200`), because that is what controls print.

use core::fmt;

use heapless::{String, Vec};
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

/// Patterns that may be active at once.
pub const MAX_PATTERNS: usize = 4;
/// Header words of a block pattern.
pub const MAX_HEADERS: usize = 8;
/// Characters of a label, a header word or a feature name.
pub const MAX_WORD: usize = 16;
/// Characters of a template.
pub const MAX_TEMPLATE: usize = 64;
/// Integer digits plus decimals of a field, at most. A Fanuc prints 8 (30i: 9).
pub const MAX_DIGITS: u8 = 15;

/// A label, a header word or the name of a feature as printed.
pub type Word = String<MAX_WORD, u8>;

/// How the control's bytes become hits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct ReceiverConfig {
    /// The code of the characters; detected if not given.
    #[serde(default)]
    pub coding: Coding,
    /// The lines that carry points, tried in this order.
    pub patterns: Vec<LinePattern, MAX_PATTERNS, u8>,
    /// Smallest and largest coordinate that can be printed, per axis. Tells
    /// whether a printed value may have lost its high digits.
    #[serde(default)]
    pub travel_mm: Option<Travel>,
    /// Silence after which an unfinished line, block or program is given up,
    /// seconds. Longer than the slowest probing move between two prints.
    #[serde(default = "default_idle_timeout_s")]
    pub idle_timeout_s: u16,
    /// How the control can be held when the board cannot take more.
    #[serde(default)]
    pub handshake: Handshake,
}

const fn default_idle_timeout_s() -> u16 {
    120
}

impl Default for ReceiverConfig {
    /// Code detected, no patterns, travel not known, 120 s, never held.
    fn default() -> Self {
        Self {
            coding: Coding::Auto,
            patterns: Vec::new(),
            travel_mm: None,
            idle_timeout_s: default_idle_timeout_s(),
            handshake: Handshake::None,
        }
    }
}

/// How a control that prints can be held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum Handshake {
    /// Not at all: what the board cannot take is lost, told, and no verdict is OK.
    #[default]
    None,
    /// It stops within ten characters after DC3 (XOFF) and goes on after DC1 (XON). Its
    /// program waits meanwhile.
    XonXoff,
}

/// The code of the characters on the line. The port itself always receives
/// eight data bits without parity; parity is checked and removed in software.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum Coding {
    /// Decided line by line from the parity of the characters, and remembered.
    #[default]
    Auto,
    /// ASCII with bit 7 clear (8N1, 7 data bits with space parity).
    Ascii,
    /// ISO 840: ASCII with even parity in bit 7 (a 7E1 or 7E2 frame).
    IsoEven,
    /// ASCII with odd parity in bit 7 (a 7O1 or 7O2 frame).
    AsciiOdd,
    /// EIA RS-244, odd parity in channel 5.
    Eia,
}

impl fmt::Display for Coding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Auto => "auto",
            Self::Ascii => "ASCII",
            Self::IsoEven => "ISO (even parity)",
            Self::AsciiOdd => "ASCII with odd parity",
            Self::Eia => "EIA",
        })
    }
}

/// The smallest and the largest coordinate that can be printed, per axis, in
/// the coordinate system in which the macro prints.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct Travel {
    /// X: smallest, largest.
    pub x: [f64; 2],
    /// Y: smallest, largest.
    pub y: [f64; 2],
    /// Z: smallest, largest.
    pub z: [f64; 2],
}

impl Travel {
    /// The ranges of x, y, z.
    #[must_use]
    pub const fn to_array(self) -> [[f64; 2]; 3] {
        [self.x, self.y, self.z]
    }
}

/// The format of the coordinates as the macro's `[cd]` declares it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct FieldFormat {
    /// Digits before the point, at most (`c`).
    pub integer_digits: u8,
    /// Digits after the point, exactly (`d`).
    pub decimals: u8,
    /// What the control does with a value that has more integer digits.
    #[serde(default)]
    pub overflow: Overflow,
}

impl FieldFormat {
    /// `[44]`: up to 9999.9999.
    pub const F44: Self = Self {
        integer_digits: 4,
        decimals: 4,
        overflow: Overflow::DropsDigits,
    };
    /// `[53]`: up to 99999.999.
    pub const F53: Self = Self {
        integer_digits: 5,
        decimals: 3,
        overflow: Overflow::DropsDigits,
    };
}

impl Default for FieldFormat {
    /// `[44]`, as the thesis' macros have it.
    fn default() -> Self {
        Self::F44
    }
}

/// What a control does with a value that has more integer digits than declared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum Overflow {
    /// It prints the low digits only, without a word (Fanuc, Brother).
    #[default]
    DropsDigits,
    /// It makes the field wider (Haas).
    Expands,
}

/// One kind of line (or group of lines) that carries points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum LinePattern {
    /// A block of points under a header, as the sphere routine of the thesis
    /// prints it (Sawula 2013, appendix D).
    Block(BlockPattern),
    /// A label and three numbers (Sawula 2013, section 3.4.2).
    PointLine(PointLinePattern),
    /// A table `Index,X,Y` as the ring gauge routine of the thesis prints it
    /// (Sawula 2013, appendix C).
    RingCsv(RingCsvPattern),
    /// Words of a letter and a number, as in NC blocks.
    LabelledWords(LabelledWordsPattern),
    /// GRBL's answer to `G38.x`: `[PRB:x,y,z:s]`, s = 1 if the probe touched.
    ///
    /// ```text
    /// [PRB:-0.000,12.346,-5.000:1]
    /// ```
    GrblProbe,
    /// A line of LinuxCNC's `(PROBEOPEN file)`: nine numbers X Y Z A B C U V W.
    ///
    /// ```text
    /// 1.000000 2.000000 -3.123456 0.000000 0.000000 0.000000 0.000000 0.000000 0.000000
    /// ```
    LinuxCncProbe,
    /// openumi's own line with sequence number and check value.
    Checked(CheckedPattern),
    /// Any other line, described by an example with named fields.
    Template(TemplatePattern),
}

/// A block of points under a header.
///
/// ```text
/// SPHERE1
/// ***
/// 5
///  -135.0190 -136.6200 148.6090
///  (four more)
/// ***
/// ```
///
/// The separators may be blank or missing: header and count decide.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields, default)]
pub struct BlockPattern {
    /// A header is a line of one of these words, or one of them followed by a
    /// number: `SPHERE` stands for `SPHERE`, `SPHERE1`, `SPHERE2`…
    pub headers: Vec<Word, MAX_HEADERS, u8>,
    /// Format of the three coordinates.
    pub format: FieldFormat,
    /// Whether the port may be closed and opened (DC4, DC2) inside a block, as
    /// a macro does that has `POPEN` and `PCLOS` around every line.
    pub spans_sessions: bool,
}

impl Default for BlockPattern {
    /// `SPHERE` with a number, `[44]`, one session.
    fn default() -> Self {
        let mut headers = Vec::new();
        if let Some(word) = word("SPHERE") {
            // A new vector has room for one word.
            let _ = headers.push(word);
        }
        Self {
            headers,
            format: FieldFormat::F44,
            spans_sessions: false,
        }
    }
}

/// A label and three numbers.
///
/// ```text
/// POINT: -135.5105 -136.3415 72.0620
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields, default)]
pub struct PointLinePattern {
    /// The label at the start of the line.
    pub label: Word,
    /// Format of the three coordinates.
    pub format: FieldFormat,
}

impl Default for PointLinePattern {
    /// `POINT:`, `[44]`.
    fn default() -> Self {
        Self {
            label: word("POINT:").unwrap_or_default(),
            format: FieldFormat::F44,
        }
    }
}

/// A table of X and Y under the header `Index,X,Y`.
///
/// ```text
/// Index,X,Y
/// 1,-113.4560, -101.2340
/// 2,-112.8760, -103.1160
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields, default)]
pub struct RingCsvPattern {
    /// Name of the feature that the table describes.
    pub name: Word,
    /// Rows that make the table complete.
    pub rows: u16,
    /// Format of the two coordinates.
    pub format: FieldFormat,
    /// The height at which the ring was probed, which is not printed.
    pub z_mm: f64,
}

impl Default for RingCsvPattern {
    /// `RING`, 36 rows, `[44]`, at Z 0.
    fn default() -> Self {
        Self {
            name: word("RING").unwrap_or_default(),
            rows: 36,
            format: FieldFormat::F44,
            z_mm: 0.0,
        }
    }
}

/// Words of a letter and a number in any order, glued or not. `N` or `P` is the
/// index of the point, `F` the feed in mm/min.
///
/// ```text
/// G801 N     1 X   128.474Y-   91.200Z    12.346 R 3.000
/// ```
///
/// is read with `prefix = "G801"`, `ignored = "R"`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields, default)]
pub struct LabelledWordsPattern {
    /// What the line begins with, before the words; may be empty.
    pub prefix: Word,
    /// Letters of X, Y, Z that must be there. An axis that is not printed is 0.
    pub axes: String<3, u8>,
    /// Other letters that may be there and are not used.
    pub ignored: Word,
    /// Format of the coordinates; any if not given.
    pub format: Option<FieldFormat>,
}

impl Default for LabelledWordsPattern {
    /// No prefix, X Y Z needed, nothing else, any format.
    fn default() -> Self {
        Self {
            prefix: Word::new(),
            axes: String::try_from("XYZ").unwrap_or_default(),
            ignored: Word::new(),
            format: None,
        }
    }
}

/// openumi's own line: run, sequence, feature, approach, touched, feed, point
/// and a check value computed in the macro.
///
/// ```text
/// UMI1 R    17 S     3 B   2 A 2 T 1 F    20.000 X-  135.019 Y-  136.620 Z   148.609 C 4113.0474
/// ```
///
/// The formula and the macro are with the receiver (`umi_core::dprnt::checked`).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields, default)]
pub struct CheckedPattern {
    /// Format of the coordinates.
    pub format: FieldFormat,
}

impl Default for CheckedPattern {
    /// `[53]`.
    fn default() -> Self {
        Self {
            format: FieldFormat::F53,
        }
    }
}

/// A line described by its text with fields in braces.
///
/// | field | reads |
/// |---|---|
/// | `{x}` `{y}` `{z}` | a coordinate in mm |
/// | `{i}` | the index of the point, a whole number |
/// | `{name}` | the feature's name: letters, digits, `_`, `-`, `.` |
/// | `{feed}` | the feed in mm/min |
/// | `{touched}` | 1 if the probe touched, 0 if not |
/// | `{skip}` | anything up to the next character of the template |
///
/// A blank stands for any number of blanks, also none. `{skip}` may not stand next
/// to another field: a digit lost inside a number would be skipped unseen.
///
/// ```text
/// PT {i} X={x} Y={y} Z={z}
/// ```
///
/// reads `PT 3 X=- 12.500 Y= 7.250 Z=0.000`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct TemplatePattern {
    /// The text with its fields.
    pub text: String<MAX_TEMPLATE, u8>,
    /// Format of the coordinates; any if not given.
    #[serde(default)]
    pub format: Option<FieldFormat>,
}

/// A [`Word`], if the text is short enough.
fn word(text: &str) -> Option<Word> {
    Word::try_from(text).ok()
}
