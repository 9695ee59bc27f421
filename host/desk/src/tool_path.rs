//! The motions of a program, as the virtual machine's control drives them with tools of
//! length zero.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use umi_client::files::points::{name, text};
use umi_client::files::tool_path::diff::{Move, Way};
use umi_client::problem::Problem;
use umi_core::correction::RunCheck;
use umi_core::units::Point;
use umi_virtual::nc::{
    self, Control, ControlSettings, ExecutionLimits, MotionRate, ProgramState, Recorder,
};

/// The motions of a program, with others loaded that it calls. One that is for one run is
/// driven in that run.
///
/// # Errors
/// A file cannot be read; the control stops with an alarm.
pub fn moves(
    path: &Path,
    loaded: &[PathBuf],
    settings: &ControlSettings,
) -> Result<Vec<Move>, Problem> {
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
    for path in loaded {
        control.load(&text(path)?).map_err(|alarm: nc::Alarm| {
            Problem::refused("alarm", format_args!("{}: {alarm}", name(path)))
        })?;
    }
    if let Some(check) = RunCheck::in_text(&program) {
        let run = Some(f64::from(check.run()));
        control.set_variable(check.variable(), run).map_err(fail)?;
    }
    let main = control.load(&program).map_err(fail)?;
    control
        .select(main.first().copied().unwrap_or_default())
        .map_err(fail)?;
    let home = Point::from_mm(0.0, 0.0, 0.0);
    let mut axes = Recorder::new(home, home);
    let mut origin = None;
    let mut lines = Vec::new();
    // Nobody knows where they stand before the program says it.
    let mut away = [true; 3];
    loop {
        let step = control.step(&mut axes).map_err(fail)?;
        let by_machine = follow(&step.text, &mut away);
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
    let origin = Vector3::from(origin.unwrap_or_default());
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
    Ok(moves.collect())
}

/// Which axes a block sends to machine coordinates, and which it brings back.
fn follow(block: &str, away: &mut [bool; 3]) -> bool {
    let mut in_comment = false;
    let words: String = block
        .split(';')
        .next()
        .unwrap_or_default()
        .chars()
        .filter(|character| {
            in_comment = (in_comment || *character == '(') && *character != ')';
            !in_comment && !matches!(character, ')' | ' ' | '\t')
        })
        .map(|character| character.to_ascii_uppercase())
        .collect();
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
