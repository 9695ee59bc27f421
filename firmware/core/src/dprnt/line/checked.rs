//! Checked lines: openumi's own format, with sequence number and check value.
//!
//! ```text
//! UMI1 R    17 S     3 B   2 A 2 T 1 F    20.000 X-  135.019 Y-  136.620 Z   148.609 C 4113.0474
//! ```
//!
//! | letter | field | range |
//! |---|---|---|
//! | R | run: a number that the macro takes anew at each start | 0 to 99999 |
//! | S | sequence: counts the lines of a run from 1 | 1 to 99999 |
//! | B | feature ("body") of the job | 0 to 999 |
//! | A | direction of motion: 1 +X, 2 -X, 3 +Y, 4 -Y, 5 +Z, 6 -Z; 0 not along an axis; or 7, 8, 9 | 0 to 9 |
//! | T | 1 if the probe touched before the target, 0 if not | 0, 1 |
//! | F | feed, mm/min | up to 4 decimals |
//! | X Y Z | the point | as the format says, up to 4 decimals |
//! | C | check value | 4 decimals |
//!
//! A7, A8 and A9 carry no hit. A7 begins a run: B is the active work offset (1 G54 to 6 G59, from
//! 101 on a further one), X Y Z are its values, F the run in which the control was last asked to teach (T1. or T2.
//! of O8811; 0 where it never was, or does not say). A9 says what else moves the coordinates: B1 an
//! active rotation, F the tool length in force, X Y Z the external offset. A7 with T1 says by what
//! the coordinates lie elsewhere than all these say: B is the active work offset once more, X Y Z
//! the machine position less the work position less offset, external offset and tool length, as
//! the control itself has them. There `G52` and `G92` show, which no variable of a Fanuc holds.
//! A8 asks that what the run measures becomes the reference; with T1 also in place of one that
//! there is.
//!
//! # Check value
//!
//! It is computed from the printed values, in units of 0.0001, so it does not
//! depend on how many decimals or blanks are printed. With N₁…N₉ the values of
//! R S B A T F X Y Z in these units, with their signs,
//!
//! ```text
//! c₀ = 1,  cᵢ = (337 cᵢ₋₁ + Nᵢ) mod 9973        d₀ = 1,  dᵢ = (331 dᵢ₋₁ + Nᵢ) mod 9967
//! C = c₉ + d₉ / 10000
//! ```
//!
//! Both moduli are prime and do not divide 10, so:
//!
//! * any error in one field only, whatever its kind (a wrong digit, a lost
//!   digit, a lost sign, digits exchanged), is detected if it changes the value
//!   by less than 9973 · 9967 units, that is 9940 mm in steps of 0.0001 mm and
//!   ten times as much in steps of 0.001 mm (Chinese remainder theorem);
//! * any exchange of two different fields, under the same condition, because
//!   no two fields have the same weight;
//! * any two wrong digits, wherever they are: 337 and 331 were chosen for that
//!   (a test counts all of them); a wrong digit in C touches c or d only, and
//!   nothing else on the line leaves the other one as it was;
//! * anything else with a probability of 1 - 10⁻⁸;
//! * a line of zeros, because c₀ and d₀ are not zero. Zero has no sign.
//!
//! # Macro
//!
//! Old controls calculate with about eight decimal digits. Here no intermediate
//! value reaches 10⁷: a value is split into its integer part I and its decimals
//! D (10000 I + D ≡ 27 I + D mod 9973, ≡ 33 I + D mod 9967), and 334 times the
//! modulus keeps the sums positive. The half in the division keeps a rounded
//! quotient on the right side of an integer. The value that is printed is put
//! together again from I and D, so that rounding in `DPRNT` cannot differ.
//!
//! ```text
//! O8810(UMI1: ONE CHECKED LINE)
//! (G65 P8810 R S B A T F X Y Z, BETWEEN POPEN AND PCLOS)
//! (USES #140 TO #148)
//! #140=#18
//! #141=#19
//! #142=#2
//! #143=#1
//! #144=#20
//! #145=#9
//! #146=#24
//! #147=#25
//! #148=#26
//! #27=1
//! #28=1
//! #30=140
//! WHILE[#30LE148]DO1
//! #31=ABS[#[#30]]
//! #32=FIX[#31]
//! #33=ROUND[[#31-#32]*1000]
//! IF[#33LT1000]GOTO10
//! #33=0
//! #32=#32+1
//! N10#29=1
//! IF[#[#30]GE0]GOTO20
//! #29=-1
//! N20#[#30]=#29*[#32+#33/1000]
//! #33=#33*10
//! #27=#27*337+#29*[#32*27+#33]+3330982
//! #27=#27-FIX[[#27+0.5]/9973]*9973
//! #28=#28*331+#29*[#32*33+#33]+3328978
//! #28=#28-FIX[[#28+0.5]/9967]*9967
//! #30=#30+1
//! END1
//! #27=#27+#28/10000
//! DPRNT[UMI1*R#140[50]*S#141[50]*B#142[30]*A#143[10]*T#144[10]*F#145[53]*X#146[53]*Y#147[53]*Z#148[53]*C#27[44]]
//! M99
//! ```
//!
//! For coordinates of four decimals, print `[44]`, write 10000 for 1000 in the
//! three blocks that have it, and leave out `#33=#33*10`.

use core::fmt;

use umi_protocol::fault::NumberIssue;
use umi_protocol::job::Approach;
use umi_protocol::pattern::FieldFormat;

use super::fields::{Fields, Ids, Outcome};
use super::number::{Cursor, Issue, Number};
use crate::dprnt::{Moved, Said};
use crate::units::Point;

/// What a checked line begins with.
pub const TAG: &str = "UMI1";

/// Decimals of the unit in which the check value is computed.
const UNIT_DECIMALS: u8 = 4;
/// Values must stay below this (in units) for the macro's arithmetic.
const LIMIT: u64 = 1_000_000_000;

/// Modulus and factor of both parts of the check value.
const PARTS: [(i64, i64); 2] = [(9973, 337), (9967, 331)];

/// The check value of R S B A T F X Y Z, all in units of 0.0001; the result too.
///
/// The formula is this project's own; see the module.
#[must_use]
pub fn check_value(fields: &[i64; 9]) -> u32 {
    let [high, low] = PARTS.map(|(modulus, factor)| {
        fields.iter().fold(1, |sum, field| {
            (sum * factor + field.rem_euclid(modulus)) % modulus
        })
    });
    u32::try_from(high * 10_000 + low).unwrap_or(0)
}

/// A checked line as a macro prints it: for a virtual machine, and for tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CheckedLine {
    /// Run.
    pub run: u32,
    /// Sequence number.
    pub sequence: u32,
    /// Feature.
    pub feature: u16,
    /// Direction of motion.
    pub approach: Option<Approach>,
    /// Whether the probe touched.
    pub touched: bool,
    /// Feed in steps of 0.001 mm/min.
    pub feed_um_per_min: u32,
    /// The point in steps of 0.001 mm.
    pub point_um: [i32; 3],
}

impl CheckedLine {
    /// The fields in the order of the check value, in units of 0.0001.
    #[must_use]
    pub fn fields(&self) -> [i64; 9] {
        let whole = |value: u32| i64::from(value) * 10_000;
        let [x, y, z] = self.point_um.map(|um| i64::from(um) * 10);
        [
            whole(self.run),
            whole(self.sequence),
            whole(u32::from(self.feature)),
            whole(u32::from(code_of(self.approach))),
            whole(u32::from(self.touched)),
            i64::from(self.feed_um_per_min) * 10,
            x,
            y,
            z,
        ]
    }

    /// The check value in units of 0.0001.
    #[must_use]
    pub fn check_value(&self) -> u32 {
        check_value(&self.fields())
    }
}

/// As a Fanuc prints it with leading zeros replaced by blanks (PRT = 0).
impl fmt::Display for CheckedLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let approach = code_of(self.approach);
        let touched = u8::from(self.touched);
        write!(
            f,
            "{TAG} R {:5} S {:5} B {:3}",
            self.run, self.sequence, self.feature
        )?;
        write!(f, " A {approach} T {touched}")?;
        let feed = self.feed_um_per_min;
        write!(f, " F {:5}.{:03}", feed / 1000, feed % 1000)?;
        for (letter, um) in ['X', 'Y', 'Z'].into_iter().zip(self.point_um) {
            let sign = if um < 0 { '-' } else { ' ' };
            let size = um.unsigned_abs();
            write!(f, " {letter}{sign}{:5}.{:03}", size / 1000, size % 1000)?;
        }
        let check = self.check_value();
        write!(f, " C {:4}.{:04}", check / 10_000, check % 10_000)
    }
}

const APPROACHES: [Approach; 6] = [
    Approach::PlusX,
    Approach::MinusX,
    Approach::PlusY,
    Approach::MinusY,
    Approach::PlusZ,
    Approach::MinusZ,
];

/// The code of a direction of motion on a checked line.
#[must_use]
pub fn code_of(approach: Option<Approach>) -> u8 {
    (1u8..)
        .zip(APPROACHES)
        .find_map(|(code, one)| (approach == Some(one)).then_some(code))
        .unwrap_or(0)
}

/// Tries a line.
pub(in crate::dprnt) fn read(format: FieldFormat, text: &[u8]) -> Outcome {
    let mut cursor = Cursor::new(text);
    cursor.blanks();
    if !cursor.take_text(TAG.as_bytes()) || cursor.peek().is_some_and(|b| b.is_ascii_digit()) {
        return Outcome::None;
    }
    read_fields(format, &mut cursor).unwrap_or_else(Outcome::Bad)
}

fn read_fields(format: FieldFormat, cursor: &mut Cursor<'_>) -> Result<Outcome, Issue> {
    let run = labelled_whole(cursor, b'R', 99_999)?;
    let sequence = labelled_whole(cursor, b'S', 99_999)?;
    let feature = labelled_whole(cursor, b'B', 999)?;
    let approach = labelled_whole(cursor, b'A', 9)?;
    let touched = labelled_whole(cursor, b'T', 1)?;
    let feed = labelled(cursor, b'F')?;
    let axes = [
        labelled(cursor, b'X')?,
        labelled(cursor, b'Y')?,
        labelled(cursor, b'Z')?,
    ];
    let check = labelled(cursor, b'C')?;
    if !cursor.at_end() {
        return Err((NumberIssue::Surplus, cursor.position()));
    }
    for axis in &axes {
        axis.check(format)?;
    }
    let c44 = FieldFormat::F44;
    check.check(c44)?;
    let whole = |value: u32| i64::from(value) * 10_000;
    let [x, y, z] = axes;
    let fields = [
        whole(run),
        whole(sequence),
        whole(feature),
        whole(approach),
        whole(touched),
        units(&feed)?,
        units(&x)?,
        units(&y)?,
        units(&z)?,
    ];
    let printed =
        u32::try_from(units(&check)?).map_err(|_| (NumberIssue::TooLarge, check.position))?;
    let computed = check_value(&fields);
    if printed != computed {
        return Ok(Outcome::BadCheck(printed, computed));
    }
    let place = usize::try_from(approach).unwrap_or(0).wrapping_sub(1);
    let said = match approach {
        7 => {
            let offset = u16::try_from(feature).unwrap_or(u16::MAX);
            let point = Point::from_mm(x.value, y.value, z.value);
            Some(match touched {
                0 => Said::Frame {
                    offset,
                    origin: point,
                    asked_in: whole_of(&feed),
                },
                _ => Said::Shifted { offset, by: point },
            })
        }
        8 => Some(Said::Teach {
            again: touched == 1,
        }),
        9 => Some(Said::Moved(Moved {
            is_rotated: feature != 0,
            tool_length_mm: feed.value,
            external: Point::from_mm(x.value, y.value, z.value),
        })),
        _ => None,
    };
    let ids = Ids {
        run,
        sequence,
        said,
        feature: u16::try_from(feature).unwrap_or(u16::MAX),
        approach: APPROACHES.get(place).copied(),
        check: computed,
    };
    let fields = Fields {
        axes: axes.map(Some),
        feed_mm_per_min: Some(feed.value),
        touched: Some(touched == 1),
        ids: Some(ids),
        ..Fields::default()
    };
    Ok(fields.into_point(Some(format)))
}

/// A run as it stands in F; 0 where that is none.
fn whole_of(number: &Number) -> u32 {
    match number.value {
        value if (1.0..=99_999.0).contains(&value) && libm::trunc(value) == value => value as u32,
        _ => 0,
    }
}

fn label(cursor: &mut Cursor<'_>, letter: u8) -> Result<(), Issue> {
    cursor.blanks();
    if cursor.take(letter) {
        Ok(())
    } else if cursor.at_number() {
        Err((NumberIssue::Surplus, cursor.position()))
    } else {
        Err((NumberIssue::Missing, cursor.position()))
    }
}

fn labelled(cursor: &mut Cursor<'_>, letter: u8) -> Result<Number, Issue> {
    label(cursor, letter)?;
    cursor.number()
}

fn labelled_whole(cursor: &mut Cursor<'_>, letter: u8, most: u32) -> Result<u32, Issue> {
    label(cursor, letter)?;
    cursor.whole(most)
}

/// A printed value in units of 0.0001, with its sign.
fn units(number: &Number) -> Result<i64, Issue> {
    let decimals = number.digits.decimals;
    let Some(missing) = UNIT_DECIMALS.checked_sub(decimals) else {
        let issue = NumberIssue::Decimals {
            expected: UNIT_DECIMALS,
            got: decimals,
        };
        return Err((issue, number.position));
    };
    let size = number
        .mantissa
        .saturating_mul(10u64.pow(u32::from(missing)));
    match i64::try_from(size) {
        Ok(size) if size.unsigned_abs() < LIMIT => Ok(if number.negative { -size } else { size }),
        _ => Err((NumberIssue::TooLarge, number.position)),
    }
}

#[cfg(test)]
mod tests;
