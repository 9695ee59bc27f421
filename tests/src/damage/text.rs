//! Hits as a control prints them, and damage to that text.

use umi_core::dprnt::checked::{CheckedLine, check_value};
use umi_protocol::job::Approach;

use super::kind::DamageKind;
use super::world::Dice;

/// The hits of one ball, with its number from 1.
pub type SimulatedBall = (u16, Vec<[f64; 3]>);

/// In turn; a ball of five hits ends before the last.
const APPROACHES: [Approach; 6] = [
    Approach::MinusZ,
    Approach::MinusX,
    Approach::PlusX,
    Approach::MinusY,
    Approach::PlusY,
    Approach::MinusZ,
];

/// As the thesis' routine prints blocks.
pub fn blocks(balls: &[SimulatedBall], names: &[String]) -> Vec<String> {
    let mut lines = Vec::new();
    for (number, points) in balls {
        lines.push(names[usize::from(*number) - 1].clone());
        lines.push("***".into());
        lines.push(points.len().to_string());
        for [x, y, z] in points {
            lines.push(format!("*{x:.4}*{y:.4}*{z:.4}"));
        }
        lines.push("***".into());
    }
    lines
}

/// As openumi's macros print a run: the work offset, what else moves it, by what it is shifted,
/// the wish to teach, the hits of the tip's centre.
pub fn checked(
    balls: &[SimulatedBall],
    run: u32,
    moved_mm: [f64; 3],
    teaches: bool,
    tip_mm: f64,
    feed_um_per_min: u32,
) -> Vec<String> {
    let mut lines = announced(run, moved_mm, teaches);
    let mut sequence = u32::try_from(lines.len()).unwrap_or(u32::MAX);
    let mut next = || {
        sequence += 1;
        sequence
    };
    for (feature, points) in balls {
        for (point, approach) in points.iter().zip(APPROACHES) {
            let (axis, sign) = approach.axis_and_sign();
            let mut center = *point;
            center[axis] -= sign * tip_mm;
            let line = CheckedLine {
                run,
                sequence: next(),
                feature: *feature,
                approach: Some(approach),
                touched: true,
                feed_um_per_min,
                point_um: center.map(|mm| {
                    #[allow(clippy::cast_possible_truncation, reason = "a machine is small")]
                    let um = (mm * 1000.0).round() as i32;
                    um
                }),
            };
            lines.push(line.to_string());
        }
    }
    lines
}

/// What O8811 prints before a run's hits, whatever these look like: the offset's X, by what
/// the coordinates are shifted besides in X, and the tool length in force.
pub fn announced(
    run: u32,
    [origin_x_mm, shift_x_mm, length_mm]: [f64; 3],
    teaches: bool,
) -> Vec<String> {
    let mut lines = vec![
        said(run, 1, [1, 7, 0], [0.0, origin_x_mm]),
        said(run, 2, [0, 9, 0], [length_mm, 0.0]),
        said(run, 3, [1, 7, 1], [0.0, shift_x_mm]),
    ];
    if teaches {
        lines.push(said(run, 4, [0, 8, 0], [0.0; 2]));
    }
    lines
}

/// A checked line that says something about its run.
fn said(
    run: u32,
    sequence: u32,
    [body, code, touched]: [u32; 3],
    [feed_mm, x_mm]: [f64; 2],
) -> String {
    #[allow(clippy::cast_possible_truncation, reason = "a machine is small")]
    let [feed, x] = [feed_mm, x_mm].map(|mm| (mm * 10_000.0).round() as i64);
    let whole = |value: u32| i64::from(value) * 10_000;
    let fields = [
        whole(run),
        whole(sequence),
        whole(body),
        whole(code),
        whole(touched),
        feed,
        x,
        0,
        0,
    ];
    let check = check_value(&fields);
    format!(
        "UMI1 R {run} S {sequence} B {body} A {code} T {touched} F {feed_mm:.3} X {x_mm:.3} Y 0.000 Z 0.000 C {}.{:04}",
        check / 10_000,
        check % 10_000
    )
}

/// Spoils the lines of a clamping.
pub fn spoil(kind: DamageKind, hits: u16, lines: &mut Vec<String>, dice: &mut Dice) {
    let place = dice.below(lines.len());
    match kind {
        DamageKind::LineTwice => lines.insert(place, lines[place].clone()),
        DamageKind::LineLost => drop(lines.remove(place)),
        DamageKind::LinesSwapped => {
            let other = (place + 1) % lines.len();
            lines.swap(place, other);
        }
        DamageKind::BallLost => {
            let blocks = lines.iter().any(|line| line == "***");
            let each = usize::from(hits) + if blocks { 4 } else { 0 };
            let head = lines.len() % each;
            let balls = (lines.len() - head) / each;
            let first = head + each * dice.below(balls);
            lines.drain(first..first + each);
        }
        DamageKind::DigitChanged => {
            let other = char::from(b'0' + u8::try_from(dice.below(10)).unwrap_or(0));
            change(lines, dice, |c| c.is_ascii_digit(), Some(other));
        }
        DamageKind::SignLost => change(lines, dice, |c| c == '-', None),
        DamageKind::CharacterLost => change(lines, dice, |c| c != ' ', None),
        _ => {}
    }
}

/// Replaces one of the characters that are meant, or takes it away.
fn change(lines: &mut [String], dice: &mut Dice, is: impl Fn(char) -> bool, by: Option<char>) {
    let places: Vec<(usize, usize)> = (0..lines.len())
        .flat_map(|line| {
            let found = lines[line].char_indices().filter(|(_, c)| is(*c));
            found.map(move |(at, _)| (line, at)).collect::<Vec<_>>()
        })
        .collect();
    if places.is_empty() {
        return;
    }
    let (line, at) = places[dice.below(places.len())];
    lines[line].remove(at);
    if let Some(by) = by {
        lines[line].insert(at, by);
    }
}
