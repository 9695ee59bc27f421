//! The programs of `tests/nc` under many transforms, by two interpreters.

use std::path::PathBuf;

use nalgebra::Vector3;
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{RewriteDialect, RewriteSettings};
use umi_tests::referee::{Before, Referee};
use umi_virtual::nc::ControlFamily;

use crate::rewrite::follow::{Compared, HOME_MM, Judge, LOOSE_MM, V, interpreted};
use crate::rewrite::{moves, rewritten, settings, table_4_2, turned};

/// How far arcs may lie from their images.
const CHORD_MM: f64 = 0.01;

struct Program {
    name: String,
    text: String,
}

impl Program {
    fn has(&self, mark: &str) -> bool {
        self.text.lines().any(|line| line == format!("({mark})"))
    }

    fn origin(&self) -> V {
        let mark = self
            .text
            .lines()
            .find_map(|line| line.strip_prefix("(ORIGIN "));
        let numbers = mark.map(|mark| {
            let numbers = mark.trim_end_matches(')').split(' ');
            Vector3::from_iterator(numbers.map(|number| number.parse().unwrap()))
        });
        numbers.unwrap_or_default()
    }

    fn is_inch(&self) -> bool {
        self.text.to_ascii_uppercase().contains("G20")
    }

    fn dialects(&self) -> Vec<ControlFamily> {
        let mut dialects = Vec::new();
        if !self.has("LINUXCNC") {
            dialects.push(ControlFamily::Fanuc);
        }
        if !self.has("FANUC") {
            dialects.push(ControlFamily::LinuxCnc);
        }
        dialects
    }
}

fn programs() -> Vec<Program> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("nc");
    let mut programs: Vec<Program> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|end| end == "nc"))
        .map(|path| Program {
            name: path.file_stem().unwrap().to_string_lossy().into_owned(),
            text: std::fs::read_to_string(&path).unwrap(),
        })
        .collect();
    programs.sort_by(|a, b| a.name.cmp(&b.name));
    assert!(programs.len() >= 40, "{}", programs.len());
    programs
}

/// Name, transform, whether it leans at all, whether it leans much.
fn transforms() -> Vec<(String, RigidTransform, bool, bool)> {
    let mut all = vec![
        (
            "shift".into(),
            turned([0.0; 3], [0.1234, -20.0, 3.0]),
            false,
            false,
        ),
        (
            "turn".into(),
            turned([0.0, 0.0, 37.21], [5.0, -7.5, 0.25]),
            false,
            false,
        ),
        (
            "half turn".into(),
            turned([0.0, 0.0, 180.0], [0.0, 1.0, 0.0]),
            false,
            false,
        ),
        (
            "hair".into(),
            turned([0.003, -0.004, -1.3], [5.0, -7.5, 0.25]),
            true,
            false,
        ),
        (
            "lean".into(),
            turned([3.0, -2.0, 30.0], [5.0, -7.5, 0.25]),
            true,
            true,
        ),
        (
            "over".into(),
            turned([180.0, 0.0, 20.0], [5.0, -7.5, 0.25]),
            true,
            false,
        ),
        (
            "side".into(),
            turned([90.0, 0.0, 10.0], [1.0, 2.0, 3.0]),
            true,
            true,
        ),
    ];
    for case in 1..=4 {
        all.push((
            format!("table 4.2, case {case}"),
            table_4_2(case),
            true,
            false,
        ));
    }
    all
}

/// The same for a control's meaning.
fn of(dialect: ControlFamily, settings: RewriteSettings) -> RewriteSettings {
    let family = match dialect {
        ControlFamily::LinuxCnc => RewriteDialect::LinuxCnc,
        _ => RewriteDialect::Fanuc,
    };
    RewriteSettings {
        dialect: Some(family),
        ..settings
    }
}

/// Half a step on each axis, and what an interpreter adds.
fn rounding(program: &Program, printed_mm: f64) -> f64 {
    let step = if program.is_inch() { 0.00254 } else { 0.001 };
    // Of the caller's place, and of the way from there.
    let times = if program.has("CALLED") { 2.0 } else { 1.0 };
    times * step / 2.0 + printed_mm + 1e-6
}

/// Every end point of the rewritten program is the image of the nominal one's, every arc
/// within its tolerance, by the virtual machine.
#[test]
fn rewritten_programs_end_where_they_should() {
    let mut failures = Vec::new();
    let (mut all, mut ran) = (Compared::default(), 0);
    for program in programs() {
        if program.has("REFEREE") {
            continue;
        }
        for dialect in program.dialects() {
            let clearance = if dialect == ControlFamily::LinuxCnc {
                0.254
            } else {
                1.0
            };
            let nominal = match interpreted(dialect, &program.text) {
                Ok(moves) => moves,
                Err(why) => {
                    failures.push(format!("{}, {dialect:?}: {why}", program.name));
                    continue;
                }
            };
            assert!(nominal.len() > 2, "{}", program.name);
            for (name, transform, leans, leans_much) in transforms() {
                let how = settings(transform, clearance);
                let made = rewritten(&of(dialect, how), &program.text);
                let refused =
                    (program.has("LEVEL") && leans) || (program.has("HOME") && leans_much);
                let made = match (made, refused) {
                    (Ok((made, _)), false) => made,
                    (Err(_), true) => continue,
                    (Ok(_), true) => {
                        failures.push(format!("{}, {name}: not refused", program.name));
                        continue;
                    }
                    (Err(refusal), false) => {
                        failures.push(format!("{}, {name}: {refusal}", program.name));
                        continue;
                    }
                };
                let judge = Judge {
                    transform,
                    origin: program.origin(),
                    rounding_mm: rounding(&program, 0.0),
                    path_mm: CHORD_MM,
                    loose_mm: LOOSE_MM,
                };
                let compared =
                    interpreted(dialect, &made).and_then(|written| judge.moves(&nominal, &written));
                match compared {
                    Ok(compared) => {
                        ran += 1;
                        all.ends += compared.ends;
                        all.largest_end_mm = all.largest_end_mm.max(compared.largest_end_mm);
                        all.largest_path_mm = all.largest_path_mm.max(compared.largest_path_mm);
                    }
                    Err(why) => failures.push(format!(
                        "{}, {dialect:?}, {name}: {why}\n{made}",
                        program.name
                    )),
                }
            }
        }
    }
    assert!(
        failures.is_empty(),
        "{} failures\n{}",
        failures.len(),
        failures[..failures.len().min(20)].join("\n")
    );
    println!("{ran} pairs of programs: {all:?}");
    assert!(ran > 700, "{ran}");
    assert!(all.ends > 5_000, "{all:?}");
}

/// The same by LinuxCNC's interpreter.
#[test]
fn the_referee_agrees() {
    let tmp = env!("CARGO_TARGET_TMPDIR");
    let Some(referee) = Referee::find(tmp) else {
        return;
    };
    let folder = PathBuf::from(tmp).join("referee").join("rewrite");
    let before = Before {
        reference_point_mm: HOME_MM,
        ..Before::default()
    };
    let ways = |program: &str| Ok::<_, String>(moves(&referee.run(&folder, &before, program)?));
    let mut failures = Vec::new();
    let mut ran = 0;
    for program in programs() {
        if program.has("FANUC") {
            continue;
        }
        // Its tool table is empty here.
        let text = program.text.replace("H1", "H0");
        let nominal = match ways(&text) {
            Ok(ways) => ways,
            Err(why) => {
                failures.push(format!("{}: {why}", program.name));
                continue;
            }
        };
        for (name, transform, ..) in transforms() {
            let how = of(ControlFamily::LinuxCnc, settings(transform, 0.254));
            let Ok((made, _)) = rewritten(&how, &text) else {
                // Whether it should be refused, the virtual machine's test says.
                continue;
            };
            let printed = if program.is_inch() { 0.00254 } else { 1e-4 };
            let judge = Judge {
                transform,
                origin: program.origin(),
                rounding_mm: rounding(&program, 2.0 * printed),
                path_mm: CHORD_MM + 4.0 * printed,
                loose_mm: LOOSE_MM,
            };
            match ways(&made).and_then(|written| judge.moves(&nominal, &written)) {
                Ok(_) => ran += 1,
                Err(why) => failures.push(format!("{}, {name}: {why}\n{made}", program.name)),
            }
        }
    }
    assert!(
        failures.is_empty(),
        "{} failures\n{}",
        failures.len(),
        failures[..failures.len().min(20)].join("\n")
    );
    assert!(ran > 350, "{ran}");
}
