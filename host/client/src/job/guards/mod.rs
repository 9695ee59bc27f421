//! What a job sees of what can go wrong between the part and the correction, and from how many
//! micrometres on.
//!
//! # Rule
//!
//! Each row is an error that leaves no trace in the text of one setup. It is put onto the job's
//! nominal places, larger and larger, and judged by the code that judges on the board
//! ([`umi_core::job::against_places`]), closing features and features on the table with it. The
//! row's figure is the size from which on every such error is refused:
//!
//! - of the worst feature, in the worst direction (13 of them, and a search from the worst);
//! - wherever the part stands: its own tilt, turn, shift and warmth, each anywhere within the
//!   job's limits, make up for as much of the error's as they can;
//! - three standard deviations of what the hits scatter are added, by the job's probing sigma of the
//!   axis that scatters most (1 µm without one).
//!
//! A taught job without `position_mm` has no places: its datum features are then taken evenly
//! on a circle of [`ASSUMED_RADIUS_MM`].

mod motion;
mod scatter;
mod seen;
mod setup;
mod single;
mod size;
mod step;
#[cfg(test)]
mod tests;

use umi_core::correction::dialect::is_read_back;
use umi_core::job::{closing, datums, judges_touches, moves_something, touch_begins_anew};
use umi_protocol::job::{Job, Reference, Teach};
use umi_protocol::pattern::LinePattern;

pub use seen::SeenFrom;
use seen::worst;
use setup::Setup;
use size::DIRECTIONS;

/// Where features are taken that say no place: on a circle around the origin.
pub const ASSUMED_RADIUS_MM: f64 = 100.0;

/// A row of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guarded {
    /// Its stable name.
    pub code: &'static str,
    /// What happened.
    pub what: &'static str,
    /// Whether the job sees it.
    pub seen: SeenFrom,
    /// What would see it, or more of it.
    pub by: &'static str,
}

/// The table, and whether the job says the places of its features.
#[derive(Clone, Debug, PartialEq)]
pub struct GuardTable {
    /// Its rows.
    pub rows: Vec<Guarded>,
    /// False: they are taken on a circle.
    pub has_places: bool,
    /// The datum features that say no place.
    pub without_place: Vec<String>,
}

impl GuardTable {
    /// The table of a job that can be used.
    #[must_use]
    pub fn of(job: &Job) -> Self {
        let setup = Setup::new(job);
        let when = |sees: bool| {
            if sees {
                SeenFrom::Always
            } else {
                SeenFrom::Never
            }
        };
        let is_checked = job
            .receiver
            .patterns
            .iter()
            .all(|pattern| matches!(pattern, LinePattern::Checked(_)));
        let has_run = job.guards.run_variable.is_some();
        let guards = &job.guards;
        let is_taught = job.reference == Reference::Taught;
        let holds_length = guards.frame && (guards.tool_length_mm.is_some() || is_taught);
        let closes = closing(job).any(|(_, closing)| !guards.fixed.contains(&closing.repeats));
        let or_from =
            |sees: bool, from: &dyn Fn() -> SeenFrom| if sees { SeenFrom::Always } else { from() };
        let row = |code, what, seen, by| Guarded {
            code,
            what,
            seen,
            by,
        };
        let rows = vec![
            row(
                "late_text",
                "text late by a whole setup",
                when(has_run),
                "run_variable",
            ),
            row(
                "stale_read",
                "READ gets an older, unread correction",
                if has_run {
                    SeenFrom::Always
                } else {
                    SeenFrom::After(job.plate_timeout_s)
                },
                if touch_begins_anew(job) {
                    "run_variable, skip"
                } else {
                    "run_variable"
                },
            ),
            row(
                "untouched",
                "lines that nobody probed: a recording",
                when(judges_touches(job)),
                "skip: each_hit",
            ),
            row(
                "offset_changed",
                "work offset changed after teaching",
                or_from(job.guards.frame, &|| setup.together()),
                "frame",
            ),
            row(
                "shift_active",
                "G52 or G92 active while it is probed",
                or_from(job.guards.frame, &|| setup.together()),
                "frame",
            ),
            row(
                "shift_while_probed",
                "offset, G52, G92 changed in a run",
                or_from(job.guards.frame && is_checked, &|| {
                    worst([setup.together(), setup.slip()].into_iter())
                }),
                if is_checked { "frame" } else { "checked lines" },
            ),
            row(
                "tool_length",
                "another tool length than when taught",
                or_from(holds_length, &|| setup.together()),
                if is_taught {
                    "frame"
                } else {
                    "frame, tool_length_mm"
                },
            ),
            row(
                "silent_teaching",
                "taught by a setup nobody meant",
                when(job.teach == Teach::Asked || job.reference == Reference::Given),
                "teach = \"asked\"",
            ),
            row(
                "order",
                "features probed in another order",
                SeenFrom::Always,
                "their names",
            ),
            row(
                "mixed_setups",
                if has_run {
                    "features of two runs"
                } else {
                    "features of two setups"
                },
                or_from(has_run, &|| setup.one(&DIRECTIONS)),
                "run_variable",
            ),
            row(
                "early_top",
                "top touched early once, sides follow",
                setup.early_top(),
                "again, a 4th ball",
            ),
            row(
                "chip_on_top",
                "chip on a top, each touch early",
                setup.chip(),
                "a 4th ball",
            ),
            row(
                "chips_on_two",
                "chips on two tops or more, like a tilt",
                setup.chips(),
                "tilt_deg",
            ),
            row(
                "dust_on_tops",
                "dust alike on all tops of the part",
                setup.dust(),
                "shift_mm",
            ),
            row(
                "ball_moved",
                "a ball moved on its plate since taught",
                setup.ball_moved(),
                "a 4th ball",
            ),
            row(
                "wrong_digit",
                if is_checked {
                    "a digit wrong on the line"
                } else {
                    "the same digit wrong in a block"
                },
                or_from(is_checked, &|| setup.one(&DIRECTIONS)),
                "checked lines",
            ),
            row(
                "digit_to_control",
                "a digit wrong on its way to the control",
                // Parity sees only what changes an odd number of bits: a note says so.
                when((job.correction.as_ref()).is_none_or(|spec| is_read_back(spec.dialect))),
                "`variables`",
            ),
            row(
                "longer_probe",
                "longer probe, bent stylus",
                setup.together(),
                "fixed",
            ),
            row(
                "worn_stylus",
                "worn stylus, scattering",
                scatter::worn_stylus(job),
                "rms_mm, learned",
            ),
            row(
                "drift",
                "drift while it is probed",
                setup.drift(),
                "closing",
            ),
            row(
                "slip",
                "slip while probed, or moved and resumed",
                setup.slip(),
                "closing",
            ),
            row(
                "turned",
                "turned on the table while probed",
                setup.turned(),
                "a 2nd closing",
            ),
            row(
                "rocked",
                "rocked over two balls while probed",
                setup.rocked(),
                "a 3rd closing",
            ),
            row(
                "not_enclosed",
                "a ball probed outside the closing pair",
                or_from(closes, &|| setup.slip()),
                "closing",
            ),
            row(
                "z_scale",
                "Z scale, error at the part",
                setup.z_scale(),
                "fixed, witness",
            ),
            row(
                "feed",
                "probed at another feed than when taught",
                or_from(is_checked && is_taught, &|| setup.trips_later()),
                "checked lines",
            ),
            row(
                "trips_later",
                "probe trips later: worn, feed override",
                setup.trips_later(),
                "learned",
            ),
            row(
                "coarse_step",
                "a control's step of 20, 50, 100 µm",
                when(moves_something(job) && setup.sees_steps()),
                "more touches",
            ),
            row(
                "coarse_taught",
                "taught at such a step, finer since",
                // Where the fits show no step, the figures of paper look the same.
                when(!is_taught),
                "the finest step",
            ),
            row(
                "bowed",
                "bowed by its clamps between its balls",
                // What is rigid has nothing between them.
                SeenFrom::Never,
                "a ball at the part",
            ),
            row(
                "moved_while_closing",
                "moved behind the first closing ball",
                setup.moved_while_closing(),
                "firm clamps",
            ),
            row(
                "moved_after",
                "moved after the last hit",
                SeenFrom::Never,
                "firm clamps",
            ),
        ];
        Self {
            rows,
            has_places: setup.has_places,
            without_place: datums(job)
                .filter(|(_, feature)| feature.position_mm.is_none())
                .map(|(_, feature)| feature.name.to_string())
                .collect(),
        }
    }
}
