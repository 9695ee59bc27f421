//! Arcs that stay arcs, and arcs that become chords.

use nalgebra::Vector3;

use super::super::RewriteSettings;
use super::super::refusal::RewriteRefusal;
use super::{level, rewritten, settings, text, turned};
use crate::units::{Mm, Point};

/// Centres turn with the path; a centre that was zero appears.
#[test]
fn arcs_turn() {
    assert_eq!(
        text(
            level(90.0, [0.0; 3]),
            "G21 G90 G17 G0 X10. Y0. Z0.\nG3 X0. Y10. I-10. J0. F9\n"
        ),
        "G21 G90 G17 G0 X0. Y10. Z0.\nG3 X-10. Y0. I0. J-10. F9\n"
    );
    assert_eq!(
        text(
            level(90.0, [0.0; 3]),
            "G21 G90 G0 X10. Y0. Z0.\nG3 I-10.\nG2 X0. Y10. R-10.\n"
        ),
        "G21 G90 G0 X0. Y10. Z0.\nG3 I0. J-10.\nG2 X-10. Y0. R-10.\n"
    );
    // Absolute centres, increments.
    assert_eq!(
        text(
            level(90.0, [1.0, 0.0, 0.0]),
            "G21 G90 G90.1 G0 X10. Y0. Z0.\nG3 X0. Y10. I0. J0.\nG91.1 G91 G2 X10. Y-10. I0. J-10.\n"
        ),
        "G21 G90 G90.1 G0 X1. Y10. Z0.\nG3 X-9. Y0. I1. J0.\nG91.1 G91 G2 X10. Y10. I10. J0.\n"
    );
}

/// Upside down, left is right.
#[test]
fn turned_over() {
    let over = turned([180.0, 0.0, 0.0], [0.0; 3]);
    assert_eq!(
        text(
            over,
            "G21 G90 G0 X10. Y0. Z1.\nG3 X0. Y10. I-10. J0. Z2.\nX-10. Y0. J-10.\n"
        ),
        "G21 G90 G0 X10. Y0. Z-1.\nG2 X0. Y-10. I-10. J0. Z-2.\nX-10. Y0. J10.\n"
    );
}

/// Near half a turn R would throw the centre: it becomes I and J.
#[test]
fn half_turns_get_a_centre() {
    let made = text(
        level(3.7, [0.1234, 0.0, 0.0]),
        "G21 G90 G0 X10. Y0. Z0.\nG3 X-10. Y0. R10. F100\n",
    );
    let arc = made.lines().last().unwrap();
    assert!(
        arc.contains('I') && arc.contains('J') && !arc.contains('R'),
        "{made}"
    );
    assert!(arc.contains("F100"), "{made}");
}

/// Rounding makes no whole circle of a speck, and no speck of a whole circle.
#[test]
fn rounding_does_not_change_the_sweep() {
    let words = |line: &str| -> std::vec::Vec<std::string::String> {
        let words = line
            .split_whitespace()
            .filter(|word| word.starts_with(['X', 'Y']));
        words.map(Into::into).collect()
    };
    for degrees in 0..90 {
        let transform = level(f64::from(degrees) * 3.7, [0.01234, 0.05, 0.0]);
        // 0.4 of a step: a speck at 10 mm.
        let speck = "G21 G90 G0 X10. Y0. Z0.\nG3 X10. Y0.0004 I-10. J0. F9\n";
        let made = text(transform, speck);
        let lines: std::vec::Vec<&str> = made.lines().collect();
        // It may be an arc of one step; on one spot it would be a circle.
        assert!(
            lines[1].starts_with("G1") || words(lines[0]) != words(lines[1]),
            "{made}"
        );
    }
    let transform = level(33.3, [0.01234, 0.05, 0.0]);
    // All but a step of a circle.
    let nearly = "G21 G90 G0 X10. Y0. Z0.\nG3 X10. Y-0.0004 I-10. J0. F9\n";
    let (made, summary) = rewritten(&settings(transform), nearly).unwrap();
    if summary.arcs == 1 {
        let of = |line: usize, letter: char| -> f64 {
            let line = made.lines().nth(line).unwrap();
            let word = line
                .split_whitespace()
                .find_map(|word| word.strip_prefix(letter));
            word.unwrap().parse().unwrap()
        };
        let start = [-of(1, 'I'), -of(1, 'J')];
        let moved = [of(1, 'X') - of(0, 'X'), of(1, 'Y') - of(0, 'Y')];
        // The end lies behind the start, seen counterclockwise.
        assert!(start[0] * moved[1] - start[1] * moved[0] <= 0.0, "{made}");
    }
    assert_eq!(summary.arcs + summary.chorded, 1);
}

/// A leaning plane: chords, each end on the image, none farther from it than allowed.
#[test]
fn chords_stay_within_the_tolerance() {
    let transform = turned([3.0, -2.0, 30.0], [5.0, 6.0, 7.0]);
    for (chord_mm, program, radius, rise) in [
        (
            0.01,
            "G21 G90 G17 G0 X20. Y0. Z0.\nG3 I-20. J0. F100\n",
            20.0,
            0.0,
        ),
        (
            0.004,
            "G21 G90 G17 G0 X20. Y0. Z0.\nG3 X20. Y0. I-20. J0. Z8. F100\n",
            20.0,
            8.0,
        ),
        (
            0.1,
            "G21 G90 G17 G0 X5. Y0. Z0.\nG2 X0. Y5. I-5. J0. Z-1. F100\n",
            5.0,
            -1.0,
        ),
    ] {
        let settings = RewriteSettings {
            chord: Mm(chord_mm),
            ..settings(transform)
        };
        let (made, summary) = rewritten(&settings, program).unwrap();
        assert_eq!((summary.arcs, summary.chorded), (0, 1));
        let clockwise = program.contains("G2 ");
        let sweep = if clockwise { -1.5 } else { 2.0 } * core::f64::consts::PI;
        let on_arc = |part: f64| {
            let (sin, cos) = (sweep * part).sin_cos();
            transform
                .apply(Point::from_mm(radius * cos, radius * sin, rise * part))
                .mm
        };
        let mut at = Vector3::zeros();
        let mut points = std::vec::Vec::new();
        for line in made.lines() {
            for word in line.split_whitespace() {
                let Ok(value) = word[1..].parse::<f64>() else {
                    continue;
                };
                match word.as_bytes()[0] {
                    b'X' => at.x = value,
                    b'Y' => at.y = value,
                    b'Z' => at.z = value,
                    _ => {}
                }
            }
            points.push(at);
        }
        let chords = &points[points.len() - 1 - summary.chords as usize..];
        let mut worst: f64 = 0.0;
        for step in 0..=20_000 {
            let here = on_arc(f64::from(step) / 20_000.0);
            let distance = chords
                .windows(2)
                .map(|ends| {
                    let (a, b) = (ends[0], ends[1]);
                    let along = b - a;
                    let t = ((here - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
                    (a + along * t - here).norm()
                })
                .fold(f64::INFINITY, f64::min);
            worst = worst.max(distance);
        }
        assert!(worst <= chord_mm, "{worst} of {chord_mm}: {made}");
        // And not with many more chords than it takes.
        assert!(worst > chord_mm * 0.4, "{worst} of {chord_mm}");
    }
}

/// A hair of tilt, as a measured setup has it, keeps arcs.
#[test]
fn a_hair_of_tilt_keeps_arcs() {
    let transform = turned([0.01, 0.005, 1.0], [1.0, 2.0, 3.0]);
    let (_, summary) = rewritten(
        &settings(transform),
        "G21 G90 G0 X20. Y0. Z0.\nG3 X0. Y20. I-20. J0. F100\n",
    )
    .unwrap();
    assert_eq!((summary.arcs, summary.chorded), (1, 0));
}

/// Every chord of an inverse-time arc has its own F: the arc takes the same time.
#[test]
fn inverse_time_is_shared() {
    let transform = turned([0.0, 10.0, 0.0], [0.0; 3]);
    let (made, summary) = rewritten(
        &settings(transform),
        "G21 G90 G93 G0 X5. Y0. Z0.\nG3 X0. Y5. I-5. J0. F2.5\n",
    )
    .unwrap();
    let each = std::format!(" F{}", 2.5 * summary.chords as f64);
    let lines: std::vec::Vec<&str> = made.lines().skip(1).collect();
    assert_eq!(lines.len() as u64, summary.chords);
    for line in lines {
        assert!(
            line.trim_end_matches('.').ends_with(&each),
            "{line}: {each}"
        );
    }
}

/// Compensation stays in its plane, and is refused in a leaning one.
#[test]
fn compensation() {
    let program = "G21 G90 G0 X0. Y0. Z0.\nG41 D1 G1 X10. Y0. F100\nG40 X0. Y0.\n";
    assert_eq!(
        text(level(90.0, [0.0; 3]), program),
        "G21 G90 G0 X0. Y0. Z0.\nG41 D1 G1 X0. Y10. F100\nG40 X0. Y0.\n"
    );
    let refused = rewritten(&settings(turned([0.01, 0.0, 0.0], [0.0; 3])), program).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (2, RewriteRefusal::Tilted('Z'))
    );
}

/// Back to a place that was written in millimetres and has no word in inches: the circle is
/// cut in chords, not begun at one place and ended at the nominal one.
#[test]
fn a_circle_in_inches_about_a_place_in_millimetres() {
    let shift = level(0.0, [1.25, -0.5, 0.125]);
    let program = |end: &str| std::format!("G21 G90 G0 X10. Y0. Z0.\nG20 G3 {end}I-1. J0. F4.\n");
    let (made, summary) = rewritten(&settings(shift), &program("Y0. ")).unwrap();
    assert_eq!((summary.arcs, summary.chorded), (0, 1), "{made}");
    assert!(made.ends_with("X0.4429 Y-0.0197\n"), "{made}");
    // Without the word the circle closes by itself.
    assert_eq!(
        text(shift, &program("")),
        "G21 G90 G0 X11.25 Y-0.5 Z0.125\nG20 G3 I-1. J0. F4.\n"
    );
}

/// A quarter to the left is one in every plane, from its first axis to its second: Z to X in
/// G18. Three quarters would have three times the chords.
#[test]
fn left_is_left_in_every_plane() {
    let lean = settings(turned([3.0, 3.0, 3.0], [0.0; 3]));
    for (plane, start, arc) in [
        (17, "X10. Y0. Z0.", "X0. Y10. I-10. J0."),
        (18, "X0. Y0. Z10.", "X10. Z0. I0. K-10."),
        (19, "X0. Y10. Z0.", "Y0. Z10. J-10. K0."),
    ] {
        let program = std::format!("G21 G90 G{plane} G0 {start}\nG3 {arc} F9\n");
        let (made, summary) = rewritten(&lean, &program).unwrap();
        // 10 mm of radius within 0.0091 mm: 0.0855 radians each.
        assert_eq!((summary.chorded, summary.chords), (1, 19), "{made}");
    }
}
