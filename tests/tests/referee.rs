//! What we send and what we interpret, judged by LinuxCNC's interpreter.
//!
//! `rs274` does not know `G68`; there the rotation is given to the work offset
//! (`G10 L2 P R`), which turns about the offset's origin, and a `G52` puts the centre
//! right. The offset goes through as it was sent.

use std::path::PathBuf;

use umi_core::brain::{Brain, Output};
use umi_core::units::Micros;
use umi_protocol::job::Job;
use umi_tests::referee::{Before, Referee};

const TMP: &str = env!("CARGO_TARGET_TMPDIR");
/// Both interpreters must agree within this; the referee prints steps of 0.0001.
const TOLERANCE_MM: f64 = 1e-4;

fn folder(test: &str) -> PathBuf {
    PathBuf::from(TMP).join("referee").join(test)
}

/// The correction programs of the reference session: four clampings of the plate,
/// -2 to +1 degrees and up to 48 mm (the thesis' table 4.2).
fn corrections() -> Vec<String> {
    let mut job: Job = toml::from_str(include_str!("../../examples/three-spheres.toml"))
        .expect("the example job is good");
    // The part beside the offset's origin, so that the rotation's centre matters.
    if let Some(correction) = &mut job.correction {
        correction.part_min_mm = [10.0, -80.0, 18.4];
        correction.part_max_mm = [60.8, -9.8, 25.4];
    }
    let mut brain = Brain::new(job).expect("the example job is good");
    let mut programs = Vec::new();
    let mut take = |output: Output<'_>| {
        if let Output::Verdict(verdict) = output
            && let Some(correction) = &verdict.correction
        {
            programs.push(correction.text.to_string());
        }
    };
    let session = include_bytes!("../reference/sessions/session_a.txt");
    brain.bytes(Micros(1), session, &mut take);
    brain.input_ended(Micros(2), &mut take);
    programs
}

/// The value of a word, as `X` in `G68 X1.5 Y2.`.
fn word(block: &str, letter: char) -> f64 {
    block
        .split_whitespace()
        .find_map(|word| word.strip_prefix(letter))
        .and_then(|value| value.parse().ok())
        .unwrap_or_else(|| panic!("no {letter} in {block}"))
}

/// The beginning of the finishing path of the cylinder-arc workpiece (Sawula 2013,
/// appendix E), as a part program writes it after its header: an arc of 109 mm radius
/// in lines along X, 0.53 mm apart.
fn finishing_path() -> String {
    let mut text = String::new();
    for line in 0..134 {
        let y = 35.004 - 0.525 * f64::from(line);
        let z = (109.0f64.powi(2) - y * y).sqrt() - 109.0 + 24.265;
        text.push_str(&format!(
            "G0 X-25.399 Y{y:.3} Z50.0\nG0 Z{:.3}\nG1 Z{z:.3} F1000.0\nG1 X25.391\nG0 Z50.0\n",
            z + 5.0
        ));
    }
    text
}

/// A correction in the words that `rs274` knows.
fn translated(correction: &str) -> String {
    let mut text = String::new();
    for line in correction.lines() {
        if line.starts_with("G68 ") {
            let (x, y, angle) = (word(line, 'X'), word(line, 'Y'), word(line, 'R'));
            let (sin, cos) = angle.to_radians().sin_cos();
            // Turned by R, (c + g) must come to c.
            text.push_str(&format!(
                "G10 L2 P2 R{angle:.3}\nG52 X{:.6} Y{:.6}\n",
                x * cos + y * sin - x,
                -x * sin + y * cos - y
            ));
        } else if !["%", "O", "G69", "M99"]
            .iter()
            .any(|word| line.starts_with(word))
        {
            text.push_str(line);
            text.push('\n');
        }
    }
    text
}

/// Compares two lists of end points; a motion of no length does not count.
fn assert_same(ours: &[[f64; 3]], theirs: &[[f64; 3]], tolerance_mm: f64, what: &str) {
    let distance = |a: &[f64; 3], b: &[f64; 3]| {
        a.iter()
            .zip(b)
            .map(|(a, b)| (a - b).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    let moved = |points: &[[f64; 3]]| {
        let mut kept: Vec<[f64; 3]> = Vec::new();
        for point in points {
            if kept
                .last()
                .is_none_or(|last| distance(last, point) > 2.0 * tolerance_mm)
            {
                kept.push(*point);
            }
        }
        kept
    };
    let (ours, theirs) = (moved(ours), moved(theirs));
    for (number, (a, b)) in ours.iter().zip(&theirs).enumerate() {
        assert!(
            distance(a, b) <= tolerance_mm,
            "{what}: motion {number}: {a:?}, the referee {b:?}"
        );
    }
    assert_eq!(
        ours.len(),
        theirs.len(),
        "{what}: {ours:?}\nthe referee {theirs:?}"
    );
}

/// The referee carries the finishing path to where the plan of the correction says:
/// `machine(p) = O' + c + Rz (p - c)`.
#[test]
fn corrections_do_what_they_say() {
    let Some(referee) = Referee::find(TMP) else {
        return;
    };
    let corrections = corrections();
    assert_eq!(corrections.len(), 4);
    let path = finishing_path();
    let folder = folder("corrections");
    let plain = referee
        .end_points(&folder, &Before::default(), &format!("G21 G90\n{path}M2\n"))
        .unwrap();
    for correction in corrections {
        let block = |start: &str| {
            let found = correction.lines().find(|line| line.starts_with(start));
            found.unwrap_or_else(|| panic!("no {start} in {correction}"))
        };
        let (offset, turn) = (block("G10 L2 P2 "), block("G68 "));
        let (sin, cos) = word(turn, 'R').to_radians().sin_cos();
        let (cx, cy) = (word(turn, 'X'), word(turn, 'Y'));
        let wanted: Vec<[f64; 3]> = plain
            .iter()
            .map(|[x, y, z]| {
                [
                    word(offset, 'X') + cx + cos * (x - cx) - sin * (y - cy),
                    word(offset, 'Y') + cy + sin * (x - cx) + cos * (y - cy),
                    word(offset, 'Z') + z,
                ]
            })
            .collect();
        let program = format!("{}{path}M2\n", translated(&correction));
        let judged = referee
            .end_points(&folder, &Before::default(), &program)
            .unwrap();
        // The first motion starts where no machine stands: its Z is not programmed.
        assert_same(&wanted[1..], &judged[1..], TOLERANCE_MM, &correction);
    }
}
