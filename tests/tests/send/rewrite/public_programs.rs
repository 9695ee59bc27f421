//! A folder of public programs, rewritten and run by LinuxCNC's interpreter: by hand, as the
//! programs are not ours to copy. Those of LinuxCNC's own tree (github.com/LinuxCNC/linuxcnc)
//! are meant.
//!
//! Each block of the nominal program gets a number of its own, which the interpreter prints with
//! each motion: so it is known which axes the machine has placed (G53, G28, G30) and not the
//! program, and until when. What is printed has four decimals, of an inch where the program has
//! inches: ends and ways are compared to that.
//!
//! ```text
//! UMI_NC_FOLDER=linuxcnc cargo test -p umi-tests --test send public_programs -- --ignored --nocapture
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use umi_core::registration::RigidTransform;
use umi_core::rewrite::{RewriteDialect, RewriteSettings, StartModes};
use umi_tests::referee::{Before, Referee, RefereeRun};

use crate::rewrite::follow::{HOME_MM, Judge, LOOSE_MM, Move, V};
use crate::rewrite::{moves, rewritten, settings, turned};

/// How far arcs may lie from their images.
const CHORD_MM: f64 = 0.01;

/// What became of a program under a transform.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Became {
    /// Every end is the image of the nominal one, every way within its tolerance.
    Right,
    /// Refused by name.
    Refused,
    /// It moves otherwise than it should.
    Wrong,
}

/// All programs below a folder.
fn programs(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            programs(&path, found);
        } else if path.extension().is_some_and(|end| {
            ["ngc", "nc", "tap", "gcode"]
                .iter()
                .any(|known| end.eq_ignore_ascii_case(known))
        }) {
            found.push(path);
        }
    }
}

/// The program with the axes at home before its first block: where they are before the program
/// says it, is then known.
fn from_home(text: &str) -> String {
    let [x, y, z] = HOME_MM;
    let home = format!("G21 G90 G53 G0 X{x} Y{y} Z{z}\nG80\n");
    match text.split_once('\n') {
        Some((first, rest)) if first.trim_start().starts_with('%') => {
            format!("{first}\n{home}{rest}")
        }
        _ => format!("{home}{text}"),
    }
}

/// The program with a number of its own for each block, from 1, in place of those that it has.
fn numbered(text: &str) -> String {
    let number = |(number, line): (usize, &str)| {
        let (skip, rest) = match line.trim_start().strip_prefix('/') {
            Some(rest) => ("/", rest),
            None => ("", line),
        };
        let rest = rest.trim_start();
        if rest.is_empty() || rest.starts_with(['%', ';', '(']) {
            return format!("{line}\n");
        }
        let rest = match rest.strip_prefix(['N', 'n']) {
            Some(own) => own.trim_start_matches(|c: char| c.is_ascii_digit() || " .".contains(c)),
            None => rest,
        };
        format!("{skip}N{number} {rest}\n")
    };
    (1..).zip(text.lines()).map(number).collect()
}

/// Words of a block: letters, and the numbers behind them where they are plain. Comments,
/// expressions and names are left out.
fn words(line: &str) -> Vec<(char, Option<f64>)> {
    let mut plain = String::new();
    let mut depth = [0_u32; 3];
    for c in line.chars() {
        match c {
            ';' if depth == [0; 3] => break,
            '(' => depth[0] += 1,
            '[' => depth[1] += 1,
            '<' => depth[2] += 1,
            ')' => depth[0] = depth[0].saturating_sub(1),
            ']' => depth[1] = depth[1].saturating_sub(1),
            '>' => depth[2] = depth[2].saturating_sub(1),
            _ if depth == [0; 3] => plain.extend(c.to_uppercase()),
            _ => {}
        }
    }
    let plain: String = plain.chars().filter(|c| !c.is_whitespace()).collect();
    let mut words = Vec::new();
    let mut rest = plain.as_str();
    while let Some(at) = rest.find(|c: char| c.is_ascii_alphabetic()) {
        let letter = rest[at..].chars().next().unwrap_or(' ');
        rest = &rest[at + 1..];
        let end = rest
            .find(|c: char| !(c.is_ascii_digit() || "+-.".contains(c)))
            .unwrap_or(rest.len());
        words.push((letter, rest[..end].parse().ok()));
        rest = &rest[end..];
    }
    words
}

/// The last digit that is printed of a place.
fn printed_mm(run: &RefereeRun) -> f64 {
    if run.has_inches { 0.00254 } else { 1e-4 }
}

/// The nominal motions, with the axes that the machine has placed: by G53, or at the reference
/// points. An axis is the program's again with its next word, or when it moves.
fn nominal_moves(text: &str, run: &RefereeRun) -> Vec<Move> {
    let lines: Vec<&str> = text.lines().collect();
    let mut all = moves(run);
    let mut by_machine = [true; 3];
    let printed_mm = printed_mm(run);
    for (moved, made) in all.iter_mut().zip(&run.moves).skip(1) {
        let line = made.block.and_then(|number| lines.get(number as usize - 1));
        let words = line.map_or_else(Vec::new, |line| words(line));
        let says = |code: f64| words.contains(&('G', Some(code)));
        let named = ['X', 'Y', 'Z'].map(|axis| words.iter().any(|(letter, _)| *letter == axis));
        let (from, to) = (moved.from, moved.to);
        let refers = says(28.0) || says(30.0);
        for axis in 0..3 {
            let goes = (to[axis] - from[axis]).abs() > printed_mm;
            let at_home = (to[axis] - HOME_MM[axis]).abs() <= printed_mm;
            by_machine[axis] = if says(53.0) {
                named[axis] || by_machine[axis]
            } else if refers {
                at_home || (by_machine[axis] && !goes)
            } else {
                by_machine[axis] && !goes && !named[axis]
            };
        }
        moved.by_machine = by_machine;
    }
    all[0].by_machine = [true; 3];
    all
}

/// What the interpreter has in force when a program begins.
fn stated() -> StartModes {
    [170, 210, 540, 900, 911, 940, 980]
        .into_iter()
        .try_fold(StartModes::default(), StartModes::with)
        .unwrap()
}

fn transforms() -> [(&'static str, RigidTransform); 2] {
    [
        ("level", turned([0.0, 0.0, 37.21], [5.0, -7.5, 0.25])),
        ("leaning", turned([0.03, -0.02, 12.0], [5.0, -7.5, 0.25])),
    ]
}

/// Programs that the interpreter runs alone, each under two transforms: moved as it says,
/// refused by name, or wrong. None is wrong.
#[test]
#[ignore = "by hand: needs a folder of programs in UMI_NC_FOLDER"]
fn public_programs_move_as_they_say() {
    let folder = std::env::var("UMI_NC_FOLDER").expect("UMI_NC_FOLDER names the folder");
    let tmp = env!("CARGO_TARGET_TMPDIR");
    let referee = Referee::find(tmp).expect("`cargo xtask set-up` brings the referee");
    let place = PathBuf::from(tmp).join("referee").join("public");
    let before = Before {
        reference_point_mm: HOME_MM,
        ..Before::default()
    };
    let mut found = Vec::new();
    programs(Path::new(&folder), &mut found);
    let mut alone = 0;
    let mut counts: BTreeMap<(&str, bool, Became), usize> = BTreeMap::new();
    let mut reasons: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut wrong = Vec::new();
    for path in &found {
        // Comments may be in any code.
        let Ok(bytes) = std::fs::read(path) else {
            println!("cannot be read: {}", path.display());
            continue;
        };
        let text: String = bytes.iter().map(|byte| char::from(*byte)).collect();
        let text = if text.is_ascii() {
            text
        } else {
            text.replace(|c: char| !c.is_ascii(), "?")
        };
        let Ok(nominal) = referee.run(&place, &before, &from_home(&numbered(&text))) else {
            continue;
        };
        // The first is ours.
        if nominal.moves.len() < 2 {
            continue;
        }
        alone += 1;
        let wanted = nominal_moves(&text, &nominal);
        for (name, transform) in transforms() {
            for with_start in [false, true] {
                let how = RewriteSettings {
                    decimals_mm: 4,
                    dialect: Some(RewriteDialect::LinuxCnc),
                    again: false,
                    start: if with_start {
                        stated()
                    } else {
                        StartModes::default()
                    },
                    ..settings(transform, 0.254)
                };
                let mut count = |became| {
                    *counts.entry((name, with_start, became)).or_default() += 1;
                };
                let made = match rewritten(&how, &text) {
                    Ok((made, _)) => made,
                    Err(refused) => {
                        count(Became::Refused);
                        if with_start {
                            let why = refused.reason.to_string();
                            let at = format!("{}:{}, {name}", path.display(), refused.line);
                            reasons.entry(why).or_default().push(at);
                        }
                        continue;
                    }
                };
                let printed = printed_mm(&nominal);
                let judge = Judge {
                    transform,
                    origin: V::from(nominal.origins_mm[1]),
                    rounding_mm: 2.0 * printed + 1e-6,
                    path_mm: CHORD_MM + 4.0 * printed,
                    loose_mm: LOOSE_MM,
                };
                let judged = referee
                    .run(&place, &before, &from_home(&made))
                    .and_then(|written| judge.moves(&wanted, &moves(&written)));
                match judged {
                    Ok(_) => count(Became::Right),
                    Err(why) => {
                        count(Became::Wrong);
                        wrong.push(format!("{}, {name}, {with_start}: {why}", path.display()));
                    }
                }
            }
        }
    }
    println!("{} programs, {alone} run alone", found.len());
    for ((name, with_start, became), count) in counts {
        let start = if with_start { "stated" } else { "not stated" };
        println!("{name}, modes {start}: {became:?} {count}");
    }
    let mut reasons: Vec<_> = reasons.into_iter().collect();
    reasons.sort_by_key(|(_, places)| core::cmp::Reverse(places.len()));
    for (why, places) in reasons {
        println!(
            "{:5} {why}\n      {}",
            places.len(),
            places.join("\n      ")
        );
    }
    assert!(alone > 0, "no program of {folder} runs alone");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
