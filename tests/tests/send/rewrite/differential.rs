//! What is rewritten and run, against the image of what is run: by the virtual machine, and by
//! LinuxCNC's interpreter, over random programs ([`super::grammar`]).
//!
//! What is right has to be right for `umi nc diff`, too. A few thousand programs are judged here;
//! a million by hand, in release (by LinuxCNC's interpreter 250 of seed 20261123, on 2026-11-23):
//!
//! ```text
//! UMI_FUZZ_CASES=1000000 UMI_FUZZ_SEED=7 UMI_FUZZ_DIALECT=haas cargo test --release -p umi-tests --test send differential -- --nocapture
//! ```

use std::collections::BTreeMap;
use std::path::PathBuf;

use umi_client::files::tool_path::diff;
use umi_core::rewrite::{Integers, RewriteDialect, RewriteSettings};
use umi_core::units::{Mm, Point};
use umi_desk::tool_path::{self, PathFrame};
use umi_tests::referee::{Before, Referee};
use umi_virtual::nc::{
    Control, ControlFamily, ControlSettings, DecimalPoint, MotionPath, MotionRate, Recorder,
};

use crate::rewrite::follow::{HOME_MM, Judge, Move, V, by_machine};
use crate::rewrite::grammar::{Case, Random, Scope, case};
use crate::rewrite::{moves, rewritten};

/// How far arcs may lie from their images.
const CHORD_MM: f64 = 0.01;

/// What became of programs.
#[derive(Debug, Default)]
struct Seen {
    /// The control itself refuses the nominal one.
    no_program: usize,
    refused: BTreeMap<String, usize>,
    moved: usize,
    ends: usize,
    /// Programs that `umi nc diff` compared as files.
    files: usize,
    largest_end_mm: f64,
    wrong: Vec<String>,
}

fn of_environment(name: &str, default: u64) -> u64 {
    let text = std::env::var(name).ok();
    text.map_or(default, |text| text.parse().expect("a whole number"))
}

fn settings(case: &Case) -> RewriteSettings {
    let is_linuxcnc = matches!(case.family, ControlFamily::LinuxCnc | ControlFamily::Grbl);
    RewriteSettings {
        dialect: Some(if is_linuxcnc {
            RewriteDialect::LinuxCnc
        } else {
            RewriteDialect::Fanuc
        }),
        integers: Some(Integers::Units),
        clearance: Mm(if is_linuxcnc { 0.254 } else { 1.0 }),
        start: case.start,
        origins_mm: case.origins_mm,
        chord: Mm(CHORD_MM),
        ..RewriteSettings::new(case.transform)
    }
}

fn control_settings(case: &Case) -> ControlSettings {
    ControlSettings {
        decimal_point: DecimalPoint::Calculator,
        increment_mm: 1e-7,
        feed_mm_min: Some(100.0),
        ..ControlSettings::of(case.family)
    }
}

/// The motions of a program by the virtual machine, from home, behind what was carried out before.
fn by_virtual_machine(case: &Case, program: &str, skips: bool) -> Result<Vec<Move>, String> {
    let mut control = Control::new(control_settings(case));
    control.set_block_skip(skips);
    let text = |alarm: umi_virtual::nc::Alarm| alarm.to_string();
    let home = Point::from_array_mm(HOME_MM);
    let mut axes = Recorder::new(home, home);
    for program in [case.before.as_str(), program] {
        let numbers = control.load(program).map_err(text)?;
        let main = numbers.iter().copied().find(|number| *number == 1);
        control
            .select(main.or(numbers.first().copied()).unwrap_or_default())
            .map_err(text)?;
        axes.motions.clear();
        if let Err(alarm) = control.run(&mut axes) {
            let why = alarm.to_string();
            // It would go on for ever.
            if !why.contains("M99 in the main program") {
                return Err(why);
            }
        }
    }
    let moves = axes.motions.iter().map(|(from, motion)| Move {
        from: from.mm,
        to: motion.to.mm,
        path: motion.path,
        feed_mm_min: match motion.rate {
            MotionRate::Rapid => None,
            MotionRate::Feed(feed) => Some(feed),
        },
        by_machine: by_machine(&motion.to.mm),
    });
    Ok(moves.collect())
}

/// What `umi nc diff` says of the same motions: it may not take right ones for wrong.
fn by_diff(case: &Case, judge: &Judge, nominal: &[Move], written: &[Move]) -> Result<(), String> {
    let moves = |moves: &[Move]| -> Vec<diff::Move> {
        let of = |(line, made): (u32, &Move)| diff::Move {
            ends: [made.from, made.to].map(|place| place - judge.origin),
            path: match made.path {
                MotionPath::Line => diff::Way::Line,
                MotionPath::Arc {
                    center,
                    axis,
                    sweep,
                } => diff::Way::Arc {
                    center: center.mm - judge.origin,
                    axis,
                    sweep_rad: sweep.0,
                },
            },
            is_feed: made.feed_mm_min.is_some(),
            line,
            away: made.by_machine,
            // What ends there and began elsewhere was sent.
            by_machine: (0..3).any(|axis| made.by_machine[axis] && !by_machine(&made.from)[axis]),
        };
        (1..).zip(moves).map(of).collect()
    };
    let limits = diff::DiffLimits {
        near_mm: 0.05,
        within_mm: judge.path_mm + 2.0 * judge.rounding_mm,
    };
    let found = diff::compare(&moves(nominal), &moves(written), &case.transform, limits);
    if found.is_complete() {
        Ok(())
    } else {
        Err(format!("umi nc diff: {}, {found:?}", found.in_words()))
    }
}

/// What stands between the motions of both files is the same for `umi nc diff`: whether it was
/// compared. Without what was carried out before, some move otherwise, or not at all.
fn by_files(case: &Case, made: &str, within_mm: f64) -> Result<bool, String> {
    let driven = |text: &str| {
        let name = format!("differential{}.nc", std::process::id());
        let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
        std::fs::write(&path, text).expect("a folder for tests");
        let frame = PathFrame::At(case.frame_mm);
        tool_path::drive(&path, &[], &control_settings(case), &case.origins_mm, frame)
    };
    let (Ok(first), Ok(second)) = (driven(&case.program), driven(made)) else {
        return Ok(false);
    };
    let limits = diff::DiffLimits {
        near_mm: 0.05,
        within_mm,
    };
    let mut found = diff::compare(&first.moves, &second.moves, &case.transform, limits);
    if !found.is_complete() {
        return Ok(false);
    }
    found.compare_beside(&first.beside, &second.beside, &case.transform);
    match found.is_complete() {
        true => Ok(true),
        false => Err(format!("umi nc diff: {}", found.in_words())),
    }
}

/// A program under its transform, with optional blocks and without.
fn judged(
    case: &Case,
    run: impl Fn(&str, bool) -> Result<Vec<Move>, String>,
    printed_mm: f64,
    seen: &mut Seen,
) {
    let nominal = [false, true].map(|skips| run(&case.program, skips));
    if nominal
        .iter()
        .any(|run| run.as_ref().is_ok_and(Vec::is_empty))
        || nominal.iter().all(Result::is_err)
    {
        seen.no_program += 1;
        return;
    }
    let made = match rewritten(&settings(case), &case.program) {
        Ok((made, _)) => made,
        Err(refused) => {
            *seen.refused.entry(refused.reason.to_string()).or_default() += 1;
            return;
        }
    };
    let judge = Judge {
        transform: case.transform,
        origin: V::from(case.frame_mm),
        rounding_mm: case.rounding_mm() + 2.0 * printed_mm,
        path_mm: CHORD_MM + 4.0 * printed_mm + 2.0 * (case.rounding_mm() - 5e-4),
        // Nothing is allowed that is not asked for.
        loose_mm: 0.0,
    };
    for (skips, nominal) in [false, true].into_iter().zip(nominal) {
        let Ok(nominal) = nominal else { continue };
        let compared = run(&made, skips).and_then(|written| {
            let compared = judge.moves(&nominal, &written)?;
            // A GRBL makes no motion of what rounds to none: there one is missing.
            if case.family != ControlFamily::Grbl {
                by_diff(case, &judge, &nominal, &written)?;
            }
            Ok(compared)
        });
        let compared = compared.and_then(|compared| {
            // Files are compared with all their blocks.
            if !skips && case.family != ControlFamily::Grbl {
                seen.files += usize::from(by_files(case, &made, judge.path_mm)?);
            }
            Ok(compared)
        });
        match compared {
            Ok(compared) => {
                seen.ends += compared.ends;
                seen.largest_end_mm = seen.largest_end_mm.max(compared.largest_end_mm);
            }
            Err(why) => {
                seen.wrong.push(format!(
                    "{why}, optional blocks left out: {skips}\n{}\n{:?} {:?}\n{}\n{}\nmade:\n{made}",
                    case.transform.rotation, case.origins_mm, case.start, case.before, case.program
                ));
                return;
            }
        }
    }
    seen.moved += 1;
}

fn told(seen: &Seen, name: &str) {
    let refused: usize = seen.refused.values().sum();
    println!(
        "{name}: {} moved as they say ({} ends, {:.6} mm at most; {} as files), {refused} refused, {} no programs, {} wrong",
        seen.moved,
        seen.ends,
        seen.largest_end_mm,
        seen.files,
        seen.no_program,
        seen.wrong.len()
    );
    let mut reasons: Vec<_> = seen.refused.iter().collect();
    reasons.sort_by_key(|(_, count)| core::cmp::Reverse(**count));
    for (why, count) in reasons {
        println!("{count:8} {why}");
    }
    assert!(
        seen.wrong.is_empty(),
        "{} of {} wrong\n{}",
        seen.wrong.len(),
        seen.moved,
        seen.wrong[..seen
            .wrong
            .len()
            .min(of_environment("UMI_FUZZ_SHOW", 1) as usize)]
            .join("\n\n")
    );
}

/// No program of the grammar that is not refused moves otherwise.
#[test]
fn differential_by_the_virtual_machine() {
    let cases = of_environment("UMI_FUZZ_CASES", 1_500);
    let seed = of_environment("UMI_FUZZ_SEED", 20_261_123);
    let only = std::env::var("UMI_FUZZ_DIALECT").ok();
    for (family, name) in [
        (ControlFamily::Fanuc, "fanuc"),
        (ControlFamily::Haas, "haas"),
        (ControlFamily::Mitsubishi, "mitsubishi-mazak"),
        (ControlFamily::LinuxCnc, "linuxcnc"),
        (ControlFamily::Grbl, "grbl"),
    ] {
        if only.as_ref().is_some_and(|only| only != name) {
            continue;
        }
        let mut random = Random::new(seed);
        let mut seen = Seen::default();
        for _ in 0..cases {
            let case = case(&mut random, family, Scope::Machine);
            judged(
                &case,
                |program, skips| by_virtual_machine(&case, program, skips),
                0.0,
                &mut seen,
            );
            if seen.wrong.len() >= 200 {
                break;
            }
        }
        told(&seen, name);
        assert!(
            seen.moved as u64 * 20 > cases,
            "{name}: {} moved",
            seen.moved
        );
    }
}

/// The same by LinuxCNC's interpreter, which has more cycles, and turns of an arc.
#[test]
#[ignore = "by hand: the interpreter takes 10 ms for a program"]
fn differential_by_the_referee() {
    let cases = of_environment("UMI_FUZZ_CASES", 500);
    let seed = of_environment("UMI_FUZZ_SEED", 20_261_123);
    let tmp = env!("CARGO_TARGET_TMPDIR");
    let referee = Referee::find(tmp).expect("`cargo xtask set-up` brings the referee");
    let folder = PathBuf::from(tmp)
        .join("referee")
        .join(format!("differential{seed}"));
    let before = Before {
        reference_point_mm: HOME_MM,
        ..Before::default()
    };
    let mut random = Random::new(seed);
    let mut seen = Seen::default();
    for _ in 0..cases {
        let case = case(&mut random, ControlFamily::LinuxCnc, Scope::Referee);
        let [x, y, z] = HOME_MM;
        let run = |program: &str, skips: bool| {
            let program: String = program
                .lines()
                .filter(|line| !(skips && line.starts_with('/')))
                .flat_map(|line| [line.trim_start_matches('/'), "\n"])
                .collect();
            let text = format!(
                "{}G53 G0 X{x} Y{y} Z{z}\nG80 F100.\n{program}",
                case.before.replace("\nM2\n", "\n")
            );
            let run = referee.run(&folder, &before, &text)?;
            // Where axes are at home or sent by G53, the machine has placed them.
            Ok(moves(&run).split_off(1))
        };
        let printed = if case.program.contains("G20") {
            0.00254
        } else {
            1e-4
        };
        judged(&case, run, printed, &mut seen);
        if seen.wrong.len() >= 100 {
            break;
        }
    }
    told(&seen, "linuxcnc");
}
