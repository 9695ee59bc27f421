//! The rewriter under programs of all kinds. The first three bytes turn the transform, the
//! fourth chooses the settings and cuts the stream; the rest is the text.
//!
//! No panic; however the stream is cut, the same comes out; a refusal names a line of the
//! text; the identity changes no byte. And of a text that the virtual machine carries out and
//! that the rewriter does not refuse, each motion is the image of the nominal one: the judge
//! is the one of `tests/tests/send/rewrite`, where programs that make sense come from a grammar.

#[allow(dead_code, reason = "the tests use more of it")]
#[path = "../../../tests/send/rewrite/follow.rs"]
mod follow;

use follow::{Judge, V, interpreted};
use nalgebra::{Rotation3, Vector3};
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{
    Integers, MAX_AT_ONCE, RefusedLine, RewriteDialect, RewriteSettings, Rewriter, Summary, Unit,
};
use umi_virtual::nc::ControlFamily;

/// From here on every mode and place is known.
const START: &str = "G21 G90 G17 G94 G98 G0 X0. Y0. Z20.\nG1 F100.\n";
/// How many lines may be added to a program that is still compared: each is looked at along
/// its way.
const MOST_ADDED: u64 = 300;

/// One input.
pub fn one(data: &[u8]) {
    let [a, b, c, how, text @ ..] = data else {
        return;
    };
    let level = how & 2 == 0;
    let [a, b, c] = [*a, *b, *c].map(|byte| f64::from(byte as i8));
    let transform = if level {
        turned([0.0, 0.0, c])
    } else {
        turned([a / 40.0, b / 40.0, c])
    };
    let settings = RewriteSettings {
        integers: Some(Integers::Units),
        unit: (how & 1 == 0).then_some(Unit::Millimetre),
        dialect: Some(RewriteDialect::Fanuc),
        ..RewriteSettings::new(transform)
    };

    let whole = run(&settings, text, text.len());
    let pieces = run(&settings, text, usize::from(how >> 2) % 17 + 1);
    assert!(whole == pieces, "cut otherwise, it comes out otherwise");
    let lines = line_by_line(&settings, text, usize::from(how >> 2) % 17 + 1);
    assert!(whole == lines, "line by line, it comes out otherwise");
    let lines = text
        .iter()
        .filter(|byte| matches!(byte, b'\n' | b'\r'))
        .count() as u64
        + 1;
    if let Err(refusal) = whole.1 {
        assert!(refusal.line <= lines && refusal.column > 0);
        assert!(!refusal.to_string().is_empty());
    }
    let (out, done) = run(&RewriteSettings::new(RigidTransform::identity()), text, 64);
    assert!(
        done.is_err() || out == text,
        "the identity changed something"
    );

    if let Ok(text) = str::from_utf8(text)
        && is_followed(text, level)
    {
        compare(&settings, text, how & 4 == 0);
    }
}

/// What a program becomes, and what was done to it.
fn run(
    settings: &RewriteSettings,
    text: &[u8],
    piece: usize,
) -> (Vec<u8>, Result<Summary, RefusedLine>) {
    let mut out = Vec::new();
    let mut sink = |bytes: &[u8]| out.extend_from_slice(bytes);
    let mut rewriter = Rewriter::new(settings).expect("good settings");
    let done = text
        .chunks(piece.max(1))
        .try_for_each(|bytes| rewriter.push(bytes, &mut sink))
        .and_then(|()| rewriter.finish(&mut sink));
    (out, done)
}

/// The same, one line at a time: never more comes out than there is room for.
fn line_by_line(
    settings: &RewriteSettings,
    text: &[u8],
    piece: usize,
) -> (Vec<u8>, Result<Summary, RefusedLine>) {
    let mut out = Vec::new();
    let mut rewriter = Rewriter::new(settings).expect("good settings");
    for mut bytes in text.chunks(piece) {
        loop {
            let before = out.len();
            let mut sink = |bytes: &[u8]| out.extend_from_slice(bytes);
            let progress = match rewriter.push_line(bytes, &mut sink) {
                Ok(progress) => progress,
                Err(refusal) => return (out, Err(refusal)),
            };
            assert!(out.len() - before <= MAX_AT_ONCE);
            bytes = &bytes[progress.taken..];
            if bytes.is_empty() && !progress.has_more {
                break;
            }
        }
    }
    let done = rewriter.finish(&mut |bytes: &[u8]| out.extend_from_slice(bytes));
    (out, done)
}

/// Each motion of the text against its image.
fn compare(settings: &RewriteSettings, text: &str, is_haas: bool) {
    let dialect = if is_haas {
        ControlFamily::Haas
    } else {
        ControlFamily::Fanuc
    };
    let program = format!("{START}{text}\nM2\n");
    let (made, Ok(summary)) = run(settings, program.as_bytes(), program.len()) else {
        return;
    };
    if summary.chords + 20 * summary.written_out + summary.holes > MOST_ADDED {
        return;
    }
    let Ok(nominal) = interpreted(dialect, &program) else {
        return;
    };
    let made = String::from_utf8(made).expect("the text was UTF-8");
    let is_inch = program.to_ascii_uppercase().contains("G20") || program.contains("20");
    let judge = Judge {
        transform: settings.transform,
        origin: V::zeros(),
        rounding_mm: if is_inch { 0.001_27 } else { 0.000_5 } + 1e-6,
        path_mm: 0.0101,
        // Nothing is allowed that is not asked for.
        loose_mm: 0.0,
    };
    let compared = interpreted(dialect, &made).and_then(|written| judge.moves(&nominal, &written));
    if let Err(why) = compared {
        panic!("{why}\n{program}\n{made}");
    }
}

/// Whether the judge can follow this text: it knows neither subprograms nor lengths of tools,
/// and of machine places only the reference point, where the transform is level.
fn is_followed(text: &str, level: bool) -> bool {
    let mut in_comment = false;
    let mut words: Vec<(char, String)> = Vec::new();
    for character in text.chars() {
        match character {
            '(' => in_comment = true,
            ')' => in_comment = false,
            _ if in_comment => {}
            'A'..='Z' | 'a'..='z' => words.push((character.to_ascii_uppercase(), String::new())),
            '0'..='9' | '.' => {
                if let Some((_, digits)) = words.last_mut() {
                    digits.push(character);
                }
            }
            ' ' | '\n' | '\r' | '-' => {}
            _ => return false,
        }
    }
    words.iter().all(|(letter, digits)| {
        let number = digits.trim_start_matches('0').trim_end_matches('.');
        match letter {
            'G' => match number {
                "28" | "30" => level,
                "22" | "43" | "44" | "49" | "53" => false,
                _ => true,
            },
            'M' => matches!(number, "" | "1" | "3" | "4" | "5" | "8" | "9"),
            'X' | 'Y' | 'Z' | 'I' | 'J' | 'K' | 'R' | 'P' | 'Q' | 'L' | 'F' | 'S' | 'N' => true,
            _ => false,
        }
    })
}

/// Turned about X, Y, Z in this order by angles in degrees, and shifted a little.
fn turned(degrees: [f64; 3]) -> RigidTransform {
    let [a, b, c] = degrees.map(f64::to_radians);
    let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), c)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), b)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), a);
    RigidTransform {
        rotation: rotation.into_inner(),
        translation_mm: Vector3::new(1.25, -0.5, 0.125),
    }
}
