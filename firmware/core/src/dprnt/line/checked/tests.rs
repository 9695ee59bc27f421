//! What the check value detects, and that the macro computes it.

use std::string::{String, ToString as _};
use std::vec::Vec;

use proptest::prelude::*;
use umi_protocol::pattern::FieldFormat;

use super::*;

const F53: FieldFormat = FieldFormat::F53;

fn sample() -> CheckedLine {
    CheckedLine {
        run: 317,
        sequence: 24,
        feature: 12,
        approach: Some(Approach::MinusX),
        touched: true,
        feed_um_per_min: 20_500,
        point_um: [-135_019, 42_618, -7_305],
    }
}

fn is_accepted(text: &str) -> bool {
    matches!(read(F53, text.as_bytes()), Outcome::Point(_))
}

/// The line in the documentation is a line.
#[test]
fn documented_line() {
    let documented = "UMI1 R    17 S     3 B   2 A 2 T 1 F    20.000 X-  135.019 Y-  136.620 Z   148.609 C 4113.0474";
    let line = CheckedLine {
        run: 17,
        sequence: 3,
        feature: 2,
        approach: Some(Approach::MinusX),
        touched: true,
        feed_um_per_min: 20_000,
        point_um: [-135_019, -136_620, 148_609],
    };
    assert_eq!(line.check_value(), 41_130_474);
    assert!(is_accepted(documented));
}

/// A line that asks to teach says whether it is in place of a reference that there is.
#[test]
fn a_line_that_teaches_says_whether_again() {
    for (touched, again) in [(0, false), (1, true)] {
        let check =
            check_value(&[1, 1, 0, 8, touched, 0, 0, 0, 0].map(|value: i64| value * 10_000));
        let (whole, part) = (check / 10_000, check % 10_000);
        let text = std::format!(
            "UMI1 R1 S1 B0 A8 T{touched} F0.000 X0.000 Y0.000 Z0.000 C{whole}.{part:04}"
        );
        let Outcome::Point(fields) = read(F53, text.as_bytes()) else {
            panic!("{text}");
        };
        let said = fields.ids.and_then(|ids| ids.said);
        assert_eq!(said, Some(Said::Teach { again }), "{text}");
    }
}

/// A7 begins a run, and says in which one the control was last asked to teach; with T1 it says by what the coordinates lie elsewhere than offsets say.
#[test]
fn a_run_says_where_its_coordinates_lie() {
    for (touched, asked_in) in [(0, 0), (0, 99_999), (1, 0)] {
        let mut values = [1, 1, 3, 7, touched, asked_in, 0, 0, 0].map(|value: i64| value * 10_000);
        values[6..].copy_from_slice(&[1_230, 0, -45_000]);
        let check = check_value(&values);
        let (whole, part) = (check / 10_000, check % 10_000);
        let text = std::format!(
            "UMI1 R1 S1 B3 A7 T{touched} F{asked_in}.000 X0.123 Y0.000 Z-4.500 C{whole}.{part:04}"
        );
        let Outcome::Point(fields) = read(F53, text.as_bytes()) else {
            panic!("{text}");
        };
        let (offset, at) = (3, crate::units::Point::from_mm(0.123, 0.0, -4.5));
        let wanted = if touched == 0 {
            let asked_in = u32::try_from(asked_in).unwrap();
            Said::Frame {
                offset,
                origin: at,
                asked_in,
            }
        } else {
            Said::Shifted { offset, by: at }
        };
        assert_eq!(fields.ids.and_then(|ids| ids.said), Some(wanted), "{text}");
    }
}

/// Blanks, padding and the sign of zero do not matter.
#[test]
fn printing_does_not_matter() {
    let text = CheckedLine {
        point_um: [0, 0, -1],
        ..sample()
    }
    .to_string();
    assert!(is_accepted(&text));
    assert!(is_accepted(&text.replace(' ', "")));
    assert!(is_accepted(&text.replace(' ', "*")));
    assert!(is_accepted(&text.replace("X     0.000", "X-    0.000")));
    assert!(is_accepted(&text.replace("0.000", ".000")));
}

/// Point, identification, feed, touched.
type Meaning = ([f64; 3], Ids, Option<f64>, Option<bool>);

/// Everything that a line says, if it is accepted.
fn meaning(text: &[u8]) -> Option<Meaning> {
    let Outcome::Point(fields) = read(F53, text) else {
        return None;
    };
    let point = fields.axes.map(|axis| axis.unwrap().value);
    Some((
        point,
        fields.ids.unwrap(),
        fields.feed_mm_per_min,
        fields.touched,
    ))
}

/// Every character of a line replaced by every other digit, sign, point, blank
/// or letter: never accepted with another meaning.
#[test]
fn no_single_wrong_character() {
    let lines = [
        sample(),
        CheckedLine {
            run: 99_999,
            sequence: 99_999,
            feature: 999,
            feed_um_per_min: 99_999_999,
            ..sample()
        },
        CheckedLine {
            point_um: [99_999_999, -99_999_999, 0],
            ..sample()
        },
        CheckedLine {
            run: 0,
            sequence: 0,
            feature: 0,
            feed_um_per_min: 0,
            point_um: [0; 3],
            ..sample()
        },
    ];
    let mut tried = 0;
    for line in lines {
        let text = line.to_string();
        let true_meaning = meaning(text.as_bytes());
        assert!(true_meaning.is_some());
        for at in 0..text.len() {
            for other in b"0123456789 *+-.,XYZRSBATFCU" {
                let mut bytes = text.clone().into_bytes();
                if bytes[at] == *other {
                    continue;
                }
                bytes[at] = *other;
                tried += 1;
                // A blank for a blank, a sign at a zero: the meaning is the same.
                let got = meaning(&bytes);
                assert!(
                    got.is_none() || got == true_meaning,
                    "{}",
                    String::from_utf8_lossy(&bytes)
                );
            }
        }
    }
    assert!(tried > 8000, "{tried}");
}

/// Every character lost, and every pair of neighbours exchanged.
#[test]
fn no_lost_and_no_exchanged_characters() {
    let text = sample().to_string();
    let true_meaning = meaning(text.as_bytes());
    for at in 0..text.len() {
        let mut lost = text.clone();
        lost.remove(at);
        let got = meaning(lost.as_bytes());
        assert!(got.is_none() || got == true_meaning, "{lost}");
        if at + 1 < text.len() {
            let mut bytes = text.clone().into_bytes();
            bytes.swap(at, at + 1);
            let got = meaning(&bytes);
            assert!(
                got.is_none() || got == true_meaning,
                "{}",
                String::from_utf8_lossy(&bytes)
            );
        }
    }
}

/// Digits that can be wrong in each field, as powers of ten in units: five, five,
/// three, one, one digits; eight of the feed and of each coordinate, in `[53]`
/// and in `[44]`.
const DIGITS: [core::ops::Range<u32>; 9] = [4..9, 4..9, 4..7, 4..5, 4..5, 0..9, 0..9, 0..9, 0..9];

/// The change of both parts of the check value by one wrong digit, for every
/// digit and every error: field, change of c, change of d.
fn single_errors(base: &[i64; 9]) -> Vec<(usize, i64, i64)> {
    let parts = |fields: &[i64; 9]| {
        let check = i64::from(check_value(fields));
        (check / 10_000, check % 10_000)
    };
    let before = parts(base);
    let mut errors = Vec::new();
    for (field, powers) in DIGITS.into_iter().enumerate() {
        for power in powers {
            for change in (-9..=9).filter(|change| *change != 0) {
                let mut wrong = *base;
                wrong[field] += change * 10_i64.pow(power);
                let after = parts(&wrong);
                let c = (after.0 - before.0).rem_euclid(PARTS[0].0);
                let d = (after.1 - before.1).rem_euclid(PARTS[1].0);
                errors.push((field, c, d));
            }
        }
    }
    errors
}

/// What an error changes does not depend on the other values, so that trying all
/// errors on one line tries them on all lines.
#[test]
fn errors_do_not_depend_on_the_values() {
    let errors = single_errors(&[0; 9]);
    assert_eq!(errors, single_errors(&sample().fields()));
    assert_eq!(errors, single_errors(&[-99_999_999; 9]));
}

/// No single wrong digit leaves either part of the check value as it was: so
/// neither does one together with a wrong digit of C, which changes one part.
#[test]
fn every_wrong_digit_changes_both_parts() {
    assert!(
        single_errors(&[0; 9])
            .iter()
            .all(|(_, c, d)| *c != 0 && *d != 0)
    );
}

/// No two wrong digits in different fields cancel. In the same field they are an
/// error in one field, which is always detected.
#[test]
fn no_two_wrong_digits_cancel() {
    let mut errors = single_errors(&[0; 9]);
    let pairs = errors.len() * (errors.len() - 1) / 2;
    assert!(pairs > 300_000, "{pairs}");
    // Two cancel if one is the negative of the other. All signs are listed, so
    // they cancel if and only if equal entries stand in different fields.
    errors.sort_by_key(|(field, c, d)| (*c, *d, *field));
    for pair in errors.windows(2) {
        let [(f, c, d), (g, e, h)] = [pair[0], pair[1]];
        assert!((c, d) != (e, h) || f == g, "fields {f} and {g}");
    }
}

/// The weights of all fields differ in both parts, so that an exchange of two
/// values shows.
#[test]
fn all_weights_differ() {
    for (modulus, factor) in PARTS {
        let mut weights: Vec<i64> = (0..9)
            .scan(1, |weight, _| {
                let w = *weight;
                *weight = w * factor % modulus;
                Some(w)
            })
            .collect();
        weights.sort_unstable();
        weights.dedup();
        assert_eq!(weights.len(), 9);
        assert!(weights.iter().all(|weight| *weight != 0));
    }
}

/// An arithmetic that keeps eight significant decimal digits after every
/// operation, as old controls have it, rounding half away from zero.
#[derive(Clone, Copy)]
struct Eight(f64);

fn eight(value: f64) -> Eight {
    if value == 0.0 {
        return Eight(0.0);
    }
    let text = std::format!("{value:.7e}");
    Eight(text.parse().unwrap())
}

impl Eight {
    fn add(self, other: Self) -> Self {
        eight(self.0 + other.0)
    }
    fn sub(self, other: Self) -> Self {
        eight(self.0 - other.0)
    }
    fn mul(self, other: Self) -> Self {
        eight(self.0 * other.0)
    }
    fn div(self, other: Self) -> Self {
        eight(self.0 / other.0)
    }
    fn fix(self) -> Self {
        Self(self.0.trunc())
    }
    fn round(self) -> Self {
        Self(self.0.round())
    }
}

/// The macro of the module's documentation, statement by statement, in
/// eight-digit arithmetic. Returns the printed fields and C, in units, and the
/// largest intermediate value.
fn macro_o8810(values: [f64; 9], steps: f64) -> ([i64; 9], i64, f64) {
    let n = eight;
    let mut printed = [0; 9];
    let (mut s27, mut s28) = (n(1.0), n(1.0));
    let largest = core::cell::Cell::new(0.0_f64);
    let keep = |value: Eight| {
        largest.set(largest.get().max(value.0.abs()));
        value
    };
    for (place, value) in printed.iter_mut().zip(values) {
        let value = n(value);
        let s31 = n(value.0.abs());
        let mut s32 = s31.fix();
        let mut s33 = s31.sub(s32).mul(n(steps)).round();
        if s33.0 >= steps {
            s33 = n(0.0);
            s32 = s32.add(n(1.0));
        }
        let s29 = n(if value.0 < 0.0 { -1.0 } else { 1.0 });
        let again = s29.mul(s32.add(s33.div(n(steps))));
        s33 = s33.mul(n(10_000.0 / steps));
        for (sum, factor, part, positive, modulus) in [
            (&mut s27, 337.0, 27.0, 3_330_982.0, 9973.0),
            (&mut s28, 331.0, 33.0, 3_328_978.0, 9967.0),
        ] {
            let value = keep(keep(s32.mul(n(part))).add(s33));
            let value = keep(keep(sum.mul(n(factor))).add(s29.mul(value)));
            let value = keep(value.add(n(positive)));
            let quotient = value.add(n(0.5)).div(n(modulus)).fix();
            *sum = value.sub(keep(quotient.mul(n(modulus))));
        }
        // What DPRNT makes of it: rounded to the decimals of the format.
        *place = (again.0 * steps).round() as i64 * (10_000.0 / steps) as i64;
    }
    let c = s27.add(s28.div(n(10_000.0)));
    (printed, (c.0 * 10_000.0).round() as i64, largest.get())
}

fn coordinate(steps: i64) -> impl Strategy<Value = i64> {
    prop_oneof![
        -99_999_999..=99_999_999i64,
        (-99_999i64..=99_999).prop_map(move |whole| (whole * steps).clamp(-99_999_999, 99_999_999)),
        (-99_999i64..=99_999)
            .prop_map(move |whole| (whole * steps + steps - 1).clamp(-99_999_999, 99_999_999)),
        Just(0),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// The macro in eight-digit arithmetic prints the check value that the
    /// receiver computes from what the macro prints, and stays below 10^7.
    #[test]
    fn macro_agrees_with_the_receiver(
        run in 0u32..=99_999, sequence in 0u32..=99_999, feature in 0u32..=999, approach in 0u32..=6,
        touched in 0u32..=1, feed_um in 0u32..=99_999_999, four: bool,
        um in prop::array::uniform3(coordinate(1000)), tenths in prop::array::uniform3(coordinate(10_000)),
    ) {
        let (steps, raw) = if four { (10_000.0, tenths) } else { (1000.0, um) };
        let feed = if four { f64::from(feed_um / 10 * 10) / 1e5 } else { f64::from(feed_um) / 1e3 };
        let [x, y, z] = raw.map(|units| units as f64 / steps);
        let values = [
            f64::from(run), f64::from(sequence), f64::from(feature), f64::from(approach),
            f64::from(touched), feed, x, y, z,
        ];
        let (printed, c, largest) = macro_o8810(values, steps);
        prop_assert_eq!(c, i64::from(check_value(&printed)));
        prop_assert!(largest < 1e7, "{}", largest);
        for (printed, value) in printed.iter().zip(values) {
            prop_assert!((*printed as f64 / 1e4 - value).abs() < 1e-9 + 1e-8 * value.abs());
        }
    }

    /// Any one field changed in any way, within the stated range, shows; so do
    /// a lost sign and an exchange of two fields.
    #[test]
    fn one_field_or_an_exchange(
        fields in prop::array::uniform9(-99_000_000i64..=99_000_000), at in 0usize..9, to in 0usize..9,
        other in -400_000i64..=400_000,
    ) {
        let check = check_value(&fields);
        let mut changed = fields;
        changed[at] = other;
        let small = (fields[at] - other).unsigned_abs() < 9973 * 9967;
        prop_assert!(changed == fields || !small || check_value(&changed) != check);
        let mut changed = fields;
        changed[at] = -fields[at];
        let small = (2 * fields[at]).unsigned_abs() < 9973 * 9967;
        prop_assert!(fields[at] == 0 || !small || check_value(&changed) != check);
        let mut changed = fields;
        changed.swap(at, to);
        let small = (fields[at] - fields[to]).unsigned_abs() < 9973 * 9967;
        prop_assert!(changed == fields || !small || check_value(&changed) != check);
    }

    /// What a control prints is read back.
    #[test]
    fn printed_lines_are_accepted(
        run in 0u32..=99_999, sequence in 0u32..=99_999, feature in 0u16..=999, place in 0usize..7,
        touched: bool, feed_um_per_min in 0u32..=99_999_999,
        point_um in prop::array::uniform3(-99_999_999i32..=99_999_999),
    ) {
        let approach = APPROACHES.get(place).copied();
        let line = CheckedLine { run, sequence, feature, approach, touched, feed_um_per_min, point_um };
        let Outcome::Point(fields) = read(F53, line.to_string().as_bytes()) else {
            return Err(TestCaseError::fail(line.to_string()));
        };
        let ids = fields.ids.unwrap();
        prop_assert_eq!((ids.run, ids.sequence, ids.feature), (run, sequence, feature));
        prop_assert_eq!((ids.approach, fields.touched), (approach, Some(touched)));
        let values = fields.axes.map(|axis| axis.unwrap().value);
        prop_assert_eq!(values, point_um.map(|um| f64::from(um) / 1000.0));
    }
}
