//! A folder of public programs, rewritten and run by LinuxCNC's interpreter: by hand, as the
//! programs are not ours to copy. Those of LinuxCNC's own tree (github.com/LinuxCNC/linuxcnc)
//! are meant.
//!
//! Its judge does not know places that a program reaches by G53, and takes what is printed in
//! inches, with four decimals, for exact: what it calls wrong must be read.
//!
//! ```text
//! UMI_NC_FOLDER=linuxcnc cargo test -p umi-tests --test send public_programs -- --ignored --nocapture
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use umi_core::registration::RigidTransform;
use umi_core::rewrite::{RewriteDialect, RewriteSettings, StartModes};
use umi_tests::referee::{Before, Referee};

use crate::rewrite::follow::{HOME_MM, Judge, V};
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
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    let mut wrong = Vec::new();
    for path in &found {
        // Comments may be in any code.
        let bytes = std::fs::read(path).unwrap();
        let text: String = bytes.iter().map(|byte| char::from(*byte)).collect();
        let text = if text.is_ascii() {
            text
        } else {
            text.replace(|c: char| !c.is_ascii(), "?")
        };
        let Ok(nominal) = referee.run(&place, &before, &from_home(&text)) else {
            continue;
        };
        // The first is ours.
        if nominal.moves.len() < 2 {
            continue;
        }
        alone += 1;
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
                            *reasons.entry(why).or_default() += 1;
                        }
                        continue;
                    }
                };
                let printed = if nominal.has_inches { 0.00254 } else { 1e-4 };
                let judge = Judge {
                    transform,
                    origin: V::from(nominal.origins_mm[1]),
                    rounding_mm: 2.0 * printed + 1e-6,
                    path_mm: CHORD_MM + 4.0 * printed,
                };
                let judged = referee
                    .run(&place, &before, &from_home(&made))
                    .and_then(|written| judge.moves(&moves(&nominal), &moves(&written)));
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
    reasons.sort_by_key(|(_, count)| core::cmp::Reverse(*count));
    for (why, count) in reasons {
        println!("{count:5} {why}");
    }
    assert!(alone > 0, "no program of {folder} runs alone");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
