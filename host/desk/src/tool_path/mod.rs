//! The motions of a program, as the virtual machine's control drives them with tools of
//! length zero.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use umi_client::files::points::{name, text};
use umi_client::files::tool_path::diff::{Depends, Move, Way};
use umi_client::problem::Problem;
use umi_core::correction::RunCheck;
use umi_core::units::Point;
use umi_protocol::job::WorkOffset;
use umi_virtual::nc::{
    self, Control, ControlSettings, ExecutionLimits, MotionRate, OffsetSystem, ProgramState,
    Recorder,
};

/// Whose coordinates motions are told in.
#[derive(Clone, Copy, Debug)]
pub enum PathFrame {
    /// Those of the work offset of the first motion.
    FirstMotion,
    /// Those of a work offset as it is before the program begins.
    Of(WorkOffset),
    /// Those about this place of the machine, mm.
    At([f64; 3]),
}

/// A program that was driven.
#[derive(Clone, Debug)]
pub struct DrivenPath {
    /// Its motions.
    pub moves: Vec<Move>,
    /// Where the frame of their coordinates lies, machine coordinates, mm.
    pub frame_mm: [f64; 3],
    /// What it made depend on variables.
    pub depends: Vec<Depends>,
}

/// The motions of a program, with others loaded that it calls. One that is for one run is
/// driven in that run. Work offsets whose origins are not given lie far from each other: under
/// another one a motion is somewhere else.
///
/// # Errors
/// A file cannot be read; the control stops with an alarm.
pub fn drive(
    path: &Path,
    loaded: &[PathBuf],
    settings: &ControlSettings,
    origins_mm: &[Option<[f64; 3]>; 6],
    frame: PathFrame,
) -> Result<DrivenPath, Problem> {
    let program = text(path)?;
    let fail =
        |alarm: nc::Alarm| Problem::refused("alarm", format_args!("{}: {alarm}", name(path)));
    let settings = ControlSettings {
        limits: ExecutionLimits {
            text: usize::MAX,
            blocks: u64::MAX,
            ..settings.limits
        },
        ..settings.clone()
    };
    let mut control = Control::new(settings);
    for (system, known) in systems(origins_mm) {
        control.set_offset(system, known);
    }
    for path in loaded {
        control.load(&text(path)?).map_err(|alarm: nc::Alarm| {
            Problem::refused("alarm", format_args!("{}: {alarm}", name(path)))
        })?;
    }
    let check = RunCheck::in_text(&program);
    if let Some(check) = check {
        let run = Some(f64::from(check.run()));
        control.set_variable(check.variable(), run).map_err(fail)?;
    }
    let main = control.load(&program).map_err(fail)?;
    control
        .select(main.first().copied().unwrap_or_default())
        .map_err(fail)?;
    let home = Point::from_mm(0.0, 0.0, 0.0);
    let mut axes = Recorder::new(home, home);
    let mut origin = match frame {
        PathFrame::FirstMotion => None,
        PathFrame::Of(offset) => Some(control.offset(system(offset))),
        PathFrame::At(place) => Some(place),
    };
    let mut depends = Vec::new();
    let mut lines = Vec::new();
    // Nobody knows where they stand before the program says it.
    let mut away = [true; 3];
    loop {
        let step = control.step(&mut axes).map_err(fail)?;
        let block = bare(&step.text);
        let by_machine = follow(&block, &mut away);
        let of_block = decide(&block).filter(|what| !is_of_run(what, check));
        depends.extend(of_block.map(|what| Depends {
            line: step.line,
            what,
        }));
        lines.resize(axes.motions.len(), (step.line, away, by_machine));
        if origin.is_none() && !axes.motions.is_empty() {
            // That of the first motion: the frame of the transform.
            origin = Some(control.offset(control.status().offset));
        }
        // Begun again it has moved once more from where it ended; a control goes on for ever.
        if step.state == ProgramState::Ended || control.begun_again() > 1 {
            break;
        }
    }
    let frame_mm = origin.unwrap_or_default();
    let origin = Vector3::from(frame_mm);
    let moves = axes
        .motions
        .iter()
        .zip(lines)
        .map(|((from, motion), (line, away, by_machine))| {
            let path = match motion.path {
                nc::MotionPath::Line => Way::Line,
                nc::MotionPath::Arc {
                    center,
                    axis,
                    sweep,
                } => Way::Arc {
                    center: center.mm - origin,
                    axis,
                    sweep_rad: sweep.0,
                },
            };
            Move {
                ends: [from.mm - origin, motion.to.mm - origin],
                path,
                is_feed: matches!(motion.rate, MotionRate::Feed(_)),
                line,
                away,
                by_machine,
            }
        });
    Ok(DrivenPath {
        moves: moves.collect(),
        frame_mm,
        depends,
    })
}

/// Every work offset with its origin: one that nobody has given lies a quarter of a kilometre from
/// the next, in numbers that leave no rounding.
fn systems(origins_mm: &[Option<[f64; 3]>; 6]) -> impl Iterator<Item = (OffsetSystem, [f64; 3])> {
    let standard = (1..=9).map(OffsetSystem::Standard);
    let further = (1..=300).map(OffsetSystem::Extended);
    (1_i32..)
        .zip(standard.chain(further))
        .map(|(number, system)| {
            let known = usize::try_from(number - 1).ok();
            let known = known.and_then(|index| *origins_mm.get(index)?);
            let far = f64::from(number) * 262_144.0;
            (system, known.unwrap_or([far, -far, far]))
        })
}

const fn system(offset: WorkOffset) -> OffsetSystem {
    match offset {
        WorkOffset::Extended(number) => OffsetSystem::Extended(number),
        WorkOffset::G54 => OffsetSystem::Standard(1),
        WorkOffset::G55 => OffsetSystem::Standard(2),
        WorkOffset::G56 => OffsetSystem::Standard(3),
        WorkOffset::G57 => OffsetSystem::Standard(4),
        WorkOffset::G58 => OffsetSystem::Standard(5),
        WorkOffset::G59 => OffsetSystem::Standard(6),
    }
}

/// A block without comments and blanks, in capitals.
fn bare(block: &str) -> String {
    let mut in_comment = false;
    block
        .split(';')
        .next()
        .unwrap_or_default()
        .chars()
        .filter(|character| {
            in_comment = (in_comment || *character == '(') && *character != ')';
            !in_comment && !matches!(character, ')' | ' ' | '\t')
        })
        .map(|character| character.to_ascii_uppercase())
        .collect()
}

/// Which axes a block sends to machine coordinates, and which it brings back.
fn follow(words: &str, away: &mut [bool; 3]) -> bool {
    let leaves = ["G28", "G30", "G53"].iter().any(|code| {
        words.match_indices(code).any(|(at, code)| {
            let next = words[at + code.len()..].chars().next();
            !next.is_some_and(|next| next.is_ascii_digit() || next == '.')
        })
    });
    for (axis, away) in ['X', 'Y', 'Z'].into_iter().zip(away) {
        if words.contains(axis) {
            *away = leaves;
        }
    }
    leaves
}

/// What of a block depends on what stands in the control: all of one that decides or computes, the
/// words of one that moves, as `X#500`, of a tool's length, and the `/` of one that may be left out.
fn decide(block: &str) -> impl Iterator<Item = String> {
    let numbered = block.strip_prefix('N').unwrap_or(block);
    let block = match numbered.len() == block.len() {
        true => block,
        false => numbered.trim_start_matches(|c: char| c.is_ascii_digit()),
    };
    if let Some(rest) = block.strip_prefix('/') {
        // The words of a motion are elsewhere where it is carried. It never becomes several.
        let moves = rest.contains(['X', 'Y', 'Z']) && !rest.contains(['#', '[']);
        let mut found: Vec<String> = decide(rest).collect();
        found.push(if moves {
            "/".to_owned()
        } else {
            block.to_owned()
        });
        return found.into_iter();
    }
    let prints = ["DPRNT", "BPRNT", "POPEN", "PCLOS"];
    let decides = ["IF", "WHILE", "GOTO", "DO", "END", "#", "O"];
    let mut found = Vec::new();
    if prints.iter().any(|word| block.starts_with(word)) {
        return found.into_iter();
    }
    if decides.iter().any(|word| block.starts_with(word)) {
        found.push(block.to_owned());
    } else {
        let mut depth = 0_u32;
        let mut word = String::new();
        for character in block.chars() {
            // Letters within brackets name functions.
            if depth == 0 && character.is_ascii_alphabetic() {
                found.push(std::mem::take(&mut word));
            }
            match character {
                '[' => depth += 1,
                ']' => depth = depth.saturating_sub(1),
                _ => {}
            }
            word.push(character);
        }
        found.push(word);
        let is_length = |word: &str| {
            let length = matches!(word, "G43" | "G44" | "G49");
            length || (word.starts_with('H') && word.len() > 1)
        };
        found.retain(|word| word.contains(['#', '[']) || is_length(word));
    }
    found.into_iter()
}

/// Whether this is the comparison of the run, with which a rewritten program begins.
fn is_of_run(what: &str, check: Option<RunCheck>) -> bool {
    let Some(check) = check else { return false };
    let compared = ["NE", "EQ"].map(|how| format!("#{}{how}{}]", check.variable(), check.run()));
    what == "O531ENDIF"
        || what == "#3000=2"
        || compared
            .iter()
            .any(|compared| what.contains(compared.as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What depends on variables is found, in words and in whole blocks, and what is printed is not.
    #[test]
    fn what_depends_is_found() {
        let decided = |block: &str| decide(&bare(block)).collect::<Vec<_>>();
        for (block, wanted) in [
            ("G1 X1. Y-2. (X#5)", &[][..]),
            ("N10 G0 X#500 Y[#1+COS[3]] Z1.", &["X#500", "Y[#1+COS[3]]"]),
            ("IF [#500 EQ 1] GOTO 99", &["IF[#500EQ1]GOTO99"]),
            ("N7 #3 = 5", &["#3=5"]),
            ("N8 G43 H2 Z50.", &["G43", "H2"]),
            ("/G1 X5.", &["/"]),
            ("N9 /2 M30", &["/2M30"]),
            ("o100 if [#1 GT 2]", &["O100IF[#1GT2]"]),
            ("DPRNT[X#5041[53]]", &[]),
        ] {
            assert_eq!(decided(block), wanted, "{block}");
        }
    }
}
