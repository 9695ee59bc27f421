//! The motions of a program, as the virtual machine's control drives them with tools of
//! length zero.

mod words;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use umi_client::files::points::{name, text};
use umi_client::files::tool_path::diff::{BesideMotions, Depends, Move, Way};
use umi_client::problem::Problem;
use umi_core::correction::RunCheck;
use umi_core::units::Point;
use umi_protocol::job::WorkOffset;
use umi_virtual::nc::{
    self, Control, ControlSettings, ExecutionLimits, MotionRate, OffsetSystem, ProgramState,
    Recorder,
};

use words::{BlockWords, JumpTargets, ModesSaid, decides_the_way, is_of_run};

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
    /// What it says beside them.
    pub beside: BesideMotions,
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
    let mut beside = BesideMotions::default();
    let texts: Vec<(u32, u32, BlockWords)> = main
        .iter()
        .flat_map(|program| control.blocks(*program).map(|block| (*program, block)))
        .map(|(program, (line, text))| (program, line, BlockWords::of(text)))
        .collect();
    let labels = JumpTargets::in_blocks(texts.iter().map(|(_, _, words)| words), check);
    let mut said = ModesSaid::new(control.settings().dialect);
    // The motions behind each block that was run.
    let mut ran = BTreeMap::new();
    let mut lines = Vec::new();
    // Nobody knows where they stand before the program says it.
    let mut away = [true; 3];
    let last_line = loop {
        let before = axes.motions.len();
        let step = control.step(&mut axes).map_err(fail)?;
        let words = BlockWords::of(&step.text);
        let by_machine = words.follow(&mut away);
        let made = axes.motions.get(before..).unwrap_or_default();
        let depends = words
            .depends(&labels)
            .filter(|what| !is_of_run(what, check));
        let mut depends: Vec<Depends> = depends
            .map(|what| Depends {
                behind: if words.stops() {
                    before + made.len()
                } else {
                    before
                },
                line: step.line,
                what,
            })
            .collect();
        depends.sort_unstable();
        beside.depends.extend(depends);
        said.count(
            &words,
            (before, step.line),
            made,
            by_machine,
            &mut beside.modes,
        );
        ran.insert((step.program, step.line), axes.motions.len());
        lines.resize(axes.motions.len(), (step.line, away, by_machine));
        if origin.is_none() && !axes.motions.is_empty() {
            // That of the first motion: the frame of the transform.
            origin = Some(control.offset(control.status().offset));
        }
        // Begun again it has moved once more from where it ended; a control goes on for ever.
        if step.state == ProgramState::Ended || control.begun_again() > 1 {
            break step.line;
        }
    };
    // What runs next begins with these.
    let codes = control.status().g_codes;
    let left = codes.iter().filter(|code| words::outlasts(code));
    beside.depends.extend(left.map(|code| Depends {
        behind: axes.motions.len(),
        what: format!("{code} in force at its end"),
        line: last_line,
    }));
    // What was not run belongs behind the block above it that was.
    if beside.depends.iter().any(|of| decides_the_way(&of.what)) {
        for (program, line, words) in texts {
            let what = words.labelled(&labels);
            if ran.contains_key(&(program, line)) || what.is_empty() || is_of_run(&what, check) {
                continue;
            }
            let above = ran.range((program, 0)..(program, line)).next_back();
            beside.not_run.push(Depends {
                behind: above.map_or(0, |(_, motions)| *motions),
                what,
                line,
            });
        }
        beside.not_run.sort_by_key(|block| block.behind);
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
        beside,
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
