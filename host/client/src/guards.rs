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
//! - three standard deviations of what the hits scatter are added, by the job's probing sigma
//!   (1 µm without one).
//!
//! A taught job without `position_mm` has no places: its datum features are then taken evenly
//! on a circle of [`ASSUMED_RADIUS_MM`].

mod scatter;

use std::ops::Range;

use nalgebra::{Rotation3, Unit, Vector3};
use umi_core::job::{
    against_places, closing, datums, fixed, moves_something, touch_begins_anew, touches_again,
};
use umi_core::registration::register;
use umi_core::units::Point;
use umi_protocol::job::{FeatureKind, FeatureSpec, Job, Reference, Teach};
use umi_protocol::pattern::LinePattern;

/// Where features are taken that say no place: on a circle around the origin.
pub const ASSUMED_RADIUS_MM: f64 = 100.0;

/// From when on a job sees an error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SeenFrom {
    /// Whatever its size.
    Always,
    /// From this size on, µm.
    Size(f64),
    /// Not before so many seconds have passed.
    After(u32),
    /// Never, up to a metre.
    Never,
}

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
        let holds_length =
            guards.frame && (guards.tool_length_mm.is_some() || job.reference == Reference::Taught);
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
                if job.reference == Reference::Taught {
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
                "chips on two tops, as if it were tilted",
                setup.two(),
                "tilt_deg",
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
                "probe trips later: other feed, or worn",
                setup.trips_later(),
                "learned",
            ),
            row(
                "coarse_step",
                "a control's step of 20, 50, 100 µm",
                when(moves_something(job)),
                "the board",
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

/// Along an edge, a face's diagonal and a space's: of each two that are opposite, one.
const DIRECTIONS: [[i8; 3]; 13] = {
    let mut all = [[0; 3]; 13];
    let mut code = 0;
    while code < 13 {
        let place = code as i8 + 14;
        all[code] = [place % 3 - 1, place / 3 % 3 - 1, place / 9 - 1];
        code += 1;
    }
    all
};
/// A probe that touches early is told too high.
const UP: [[i8; 3]; 1] = [[0, 0, 1]];

fn unit(direction: &[i8; 3]) -> Vector3<f64> {
    Vector3::from(direction.map(f64::from)).normalize()
}

/// So many datum features have middles that are tried as well.
const FEW: usize = 4;

/// Sizes that are tried.
const STEPS: u32 = 35;

/// A job's features at their places.
struct Setup {
    job: Job,
    places: Vec<Vector3<f64>>,
    has_places: bool,
}

impl Setup {
    fn new(job: &Job) -> Self {
        let due: Vec<usize> = datums(job).map(|(index, _)| index).collect();
        let has_places = datums(job).all(|(_, feature)| feature.position_mm.is_some());
        let assumed = |number: usize| {
            let angle = std::f64::consts::TAU * number as f64 / due.len() as f64;
            Vector3::new(angle.cos(), angle.sin(), 0.0) * ASSUMED_RADIUS_MM
        };
        let mut places: Vec<Vector3<f64>> = job
            .features
            .iter()
            .enumerate()
            .map(|(index, feature)| match feature.position_mm {
                Some(mm) if has_places => Vector3::from(mm),
                _ => assumed(due.iter().position(|of| *of == index).unwrap_or_default()),
            })
            .collect();
        for (again, closing) in closing(job) {
            let first = job.features.iter().position(|f| f.name == closing.repeats);
            if let Some(place) = first.and_then(|first| places.get(first).copied()) {
                places[again] = place;
            }
        }
        Self {
            // What it writes plays no part.
            job: Job {
                correction: None,
                ..job.clone()
            },
            places,
            has_places,
        }
    }

    /// Whether the job refuses a setup whose features are off by these, wherever the part stands
    /// within its limits.
    fn refuses(&self, off: &dyn Fn(usize) -> Vector3<f64>) -> bool {
        let job = &self.job;
        let is_open = closing(job).any(|(again, closing)| {
            let first = job.features.iter().position(|f| f.name == closing.repeats);
            first.is_some_and(|first| (off(again) - off(first)).norm() > closing.within_mm)
        });
        is_open || {
            let reference: Vec<Vector3<f64>> = self.due().map(|index| self.at(index)).collect();
            let errors: Vec<Vector3<f64>> = self.due().map(off).collect();
            self.is_against(&reference, &errors, None)
                && self.is_against(&reference, &errors, self.hides(&reference, &errors))
        }
    }

    /// The features that a reference has: datums, then those on the table.
    fn due(&self) -> impl Iterator<Item = usize> {
        datums(&self.job)
            .chain(fixed(&self.job))
            .map(|(index, _)| index)
    }

    fn at(&self, index: usize) -> Vector3<f64> {
        self.places.get(index).copied().unwrap_or_default()
    }

    fn is_against(
        &self,
        reference: &[Vector3<f64>],
        errors: &[Vector3<f64>],
        stands: Option<Stands>,
    ) -> bool {
        let moving = datums(&self.job).count();
        let middle = middle(&reference[..moving]);
        let measured: Vec<Point> = (0..)
            .zip(reference.iter().zip(errors))
            .map(|(number, (place, error))| {
                let stands = stands.filter(|_| number < moving);
                let at = stands.map_or(*place, |stands| stands.carries(*place, middle));
                Point { mm: at + error }
            })
            .collect();
        let reference: Vec<Point> = reference.iter().map(|mm| Point { mm: *mm }).collect();
        against_places(&self.job, &reference, &measured)
    }

    /// Where the part must stand within the job's limits so that as little as possible is seen
    /// of these errors.
    fn hides(&self, reference: &[Vector3<f64>], errors: &[Vector3<f64>]) -> Option<Stands> {
        let (job, moving) = (&self.job, datums(&self.job).count());
        let (reference, errors) = (reference.get(..moving)?, errors.get(..moving)?);
        let to: Vec<Point> = (reference.iter().zip(errors))
            .map(|(place, error)| Point { mm: place + error })
            .collect();
        let from: Vec<Point> = reference.iter().map(|mm| Point { mm: *mm }).collect();
        let seen = register(&from, &to).ok()?.transform.rotation;
        let turned = Rotation3::from_matrix_unchecked(seen).scaled_axis();
        let within = |length: f64, limit: f64| (limit * WITHIN / length).min(1.0);
        let tilt = Vector3::new(turned.x, turned.y, 0.0);
        let tilt = tilt * within(tilt.norm(), job.limits.tilt_deg.to_radians());
        let turn = turned.z * within(turned.z.abs(), job.limits.rotation_deg.to_radians());
        let shift = middle(errors).zip_map(&job.limits.shift_mm.into(), |off: f64, limit: f64| {
            off.clamp(-limit * WITHIN, limit * WITHIN)
        });
        let scale = job.guards.warmth.map_or(0.0, |warmth| {
            let at = middle(reference);
            let (mut along, mut square) = (0.0, 0.0);
            for (place, error) in reference.iter().zip(errors) {
                along += (place - at).dot(error);
                square += (place - at).norm_squared();
            }
            let most = warmth.at_most_k * warmth.expansion_ppm_per_k * 1e-6 * WITHIN;
            (along / square).clamp(-most, most)
        });
        Some(Stands {
            turned: Rotation3::new(-tilt - Vector3::z() * turn),
            shift: -shift,
            scale: 1.0 - scale,
        })
    }

    /// The size from which on an error is refused, with what hits scatter: `balls` positions of
    /// balls, taught and measured, stand against each other in it.
    fn from(&self, balls: usize, off: &dyn Fn(usize, f64) -> Vector3<f64>) -> SeenFrom {
        let refuses = |um: f64| self.refuses(&|index| off(index, um * 1e-3));
        // From 0.1 µm to 1 m, five to a decade.
        let size = |step: u32| 10_f64.powf(f64::from(step) / 5.0 - 1.0);
        let Some(last) = (0..=STEPS).rev().find(|step| !refuses(size(*step))) else {
            return self.scattered(balls, size(0));
        };
        if last == STEPS {
            return SeenFrom::Never;
        }
        let (mut low, mut high) = (size(last), size(last + 1));
        for _ in 0..16 {
            let middle = f64::midpoint(low, high);
            if refuses(middle) {
                high = middle;
            } else {
                low = middle;
            }
        }
        self.scattered(balls, high)
    }

    /// The size, and three standard deviations of what it is measured with.
    fn scattered(&self, balls: usize, um: f64) -> SeenFrom {
        SeenFrom::Size(um + self.scatter_um(balls))
    }

    fn scatter_um(&self, balls: usize) -> f64 {
        let probing = self.job.guards.probing;
        let hit_um = probing.map_or(ASSUMED_SIGMA_UM, |probing| probing.sigma_mm * 1e3);
        // A ball's centre scatters as one hit does, at most: the lone hit of its top.
        3.0 * (2.0 * balls as f64).sqrt() * hit_um
    }

    /// One feature is off: the worst of all that the part is corrected by.
    fn one(&self, directions: &[[i8; 3]]) -> SeenFrom {
        let balls = datums(&self.job).count();
        worst(datums(&self.job).map(|(of, _)| {
            let off = |along: Vector3<f64>, index: usize, mm: f64| {
                along * if index == of { mm } else { 0.0 }
            };
            match directions {
                [alone] => self.from(balls, &|index, mm| off(unit(alone), index, mm)),
                _ => self.worst_direction(balls, &off),
            }
        }))
    }

    /// Which feature is probed as this one: what lies on a ball is there again when it is probed
    /// again.
    fn repeated(&self, index: usize) -> usize {
        let again = closing(&self.job).find(|(again, _)| *again == index);
        again
            .and_then(|(_, closing)| {
                let features = &self.job.features;
                features.iter().position(|f| f.name == closing.repeats)
            })
            .unwrap_or(index)
    }

    /// Something lies on one feature, and is there when it is probed again.
    fn chip(&self) -> SeenFrom {
        let balls = datums(&self.job).count();
        worst(datums(&self.job).map(|(of, _)| {
            self.from(balls, &|index, mm| {
                Vector3::z() * if self.repeated(index) == of { mm } else { 0.0 }
            })
        }))
    }

    /// Two features are too high alike: where they lie on one side, a tilt does so as well.
    fn two(&self) -> SeenFrom {
        let balls = datums(&self.job).count();
        let due: Vec<usize> = datums(&self.job).map(|(index, _)| index).collect();
        worst(due.iter().enumerate().flat_map(|(number, one)| {
            let behind = due.iter().skip(number + 1);
            behind.map(move |other| {
                self.from(balls, &|index, mm| {
                    let of = self.repeated(index);
                    Vector3::z() * if of == *one || of == *other { mm } else { 0.0 }
                })
            })
        }))
    }

    /// The worst of [`DIRECTIONS`], and from there on as long as a step aside is worse.
    fn worst_direction(
        &self,
        balls: usize,
        off: &dyn Fn(Vector3<f64>, usize, f64) -> Vector3<f64>,
    ) -> SeenFrom {
        let is_worse = |along: Vector3<f64>, than: SeenFrom| {
            self.is_later(than, balls, &|index, mm| off(along, index, mm))
        };
        let from = |along: Vector3<f64>| self.from(balls, &|index, mm| off(along, index, mm));
        let mut most = (unit(&DIRECTIONS[0]), from(unit(&DIRECTIONS[0])));
        for along in DIRECTIONS.iter().map(unit) {
            if is_worse(along, most.1) {
                most = worse(most, (along, from(along)));
            }
        }
        for halvings in 0..5 {
            let step = 0.4 * 0.5_f64.powi(halvings);
            let along = most.0;
            let side = along.cross(&Vector3::new(along.y, along.z, -along.x));
            let side = side.try_normalize(1e-9).unwrap_or_else(Vector3::x);
            let other = along.cross(&side);
            for aside in [side, -side, other, -other] {
                let tried = (along + aside * step).normalize();
                if is_worse(tried, most.1) {
                    most = worse(most, (tried, from(tried)));
                }
            }
        }
        most.1
    }

    /// The first touch of a ball is early and the others are driven by it: where the top is
    /// touched twice the two differ by all of it.
    fn early_top(&self) -> SeenFrom {
        let is_again = datums(&self.job).all(|(_, feature)| touches_again(feature));
        match self.job.again {
            // Two hits stand against each other, no balls.
            Some(again) if is_again => self.scattered(1, again.within_mm * 1e3),
            _ => self.one(&UP),
        }
    }

    /// All are off alike.
    fn together(&self) -> SeenFrom {
        self.worst_direction(1, &|along, _, mm| along * mm)
    }

    /// Those that move with the part, in their order.
    fn moving(&self) -> Vec<usize> {
        let fixed: Vec<usize> = fixed(&self.job).map(|(index, _)| index).collect();
        // One that repeats a feature on the table is on it as well.
        let again = closing(&self.job)
            .filter(|(_, closing)| self.job.guards.fixed.contains(&closing.repeats));
        let again: Vec<usize> = again.map(|(index, _)| index).collect();
        (0..self.places.len())
            .filter(|index| !fixed.contains(index) && !again.contains(index))
            .collect()
    }

    /// They move evenly from the first to the last.
    fn drift(&self) -> SeenFrom {
        let moving = self.moving();
        let last = moving.len().saturating_sub(1).max(1) as f64;
        self.worst_direction(self.against(), &|along, index, mm| {
            let turn = moving.iter().position(|of| *of == index);
            along * turn.map_or(0.0, |turn| mm * turn as f64 / last)
        })
    }

    /// From one of them on they have moved.
    fn slip(&self) -> SeenFrom {
        let moving = self.moving();
        worst((1..moving.len()).map(|first| {
            let moved = &moving[first..];
            self.worst_direction(self.against(), &|along, index, mm| {
                along * if moved.contains(&index) { mm } else { 0.0 }
            })
        }))
    }

    /// From one of them on, up to the first closing one, it has turned on the table: about a ball,
    /// or between two. The size is what the datum feature does that moves most, of those that were
    /// probed before: if none of them has moved, what was measured is right.
    fn turned(&self) -> SeenFrom {
        self.worst_turn(self.upright(), 1..self.first_closing())
    }

    /// It has rocked there: over two of its balls, or a line between them.
    fn rocked(&self) -> SeenFrom {
        self.worst_turn(self.lying(), 1..self.first_closing())
    }

    /// It has turned or rocked between the first closing one and the last: each is seen by those
    /// alone that come behind it.
    fn moved_while_closing(&self) -> SeenFrom {
        let behind = self.first_closing()..self.moving().len();
        let axes = self.upright().into_iter().chain(self.lying());
        self.worst_turn(axes.collect(), behind)
    }

    /// So many of those that move come before the part has moved, at most, where the first closing
    /// one has seen it.
    fn first_closing(&self) -> usize {
        let moving = self.moving();
        let is_closing = |index: &usize| closing(&self.job).any(|(again, _)| again == *index);
        let upto = moving.iter().position(is_closing);
        upto.map_or(moving.len(), |first| first + 1)
    }

    /// Upright axes of a turn.
    fn upright(&self) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let pivots = self.pivots();
        pivots.into_iter().map(|at| (at, Vector3::z())).collect()
    }

    /// Axes of a turn through two pivots.
    fn lying(&self) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let pivots = self.pivots();
        let pairs = pivots.iter().enumerate().flat_map(|(number, from)| {
            let behind = pivots.iter().skip(number + 1);
            behind.map(move |to| (*from, to - from))
        });
        pairs.collect()
    }

    /// The datum places, and where they are few the middles of each two: what closing features
    /// show least of passes through some of these.
    fn pivots(&self) -> Vec<Vector3<f64>> {
        let places: Vec<Vector3<f64>> = (datums(&self.job))
            .map(|(index, _)| self.at(index))
            .collect();
        let mut pivots = places.clone();
        if places.len() <= FEW {
            for (number, a) in places.iter().enumerate() {
                pivots.extend(places.iter().skip(number + 1).map(|b| (a + b) / 2.0));
            }
        }
        pivots
    }

    /// The worst turn about one of these axes, before one of these of all that move.
    fn worst_turn(
        &self,
        axes: Vec<(Vector3<f64>, Vector3<f64>)>,
        before: Range<usize>,
    ) -> SeenFrom {
        let (moving, balls) = (self.moving(), self.against());
        // None is tried where there is nothing to turn about, or no second feature that shows it.
        let mut most = None;
        for first in before {
            let moved = &moving[first..];
            for (about, along) in &axes {
                let Some(along) = Unit::try_new(*along, 1e-9) else {
                    continue;
                };
                let arm = moving[..first]
                    .iter()
                    .map(|index| along.cross(&(self.at(*index) - about)).norm())
                    .fold(0.0, f64::max);
                if arm < 1.0 {
                    continue;
                }
                let off = |index: usize, mm: f64| {
                    let by = Rotation3::from_axis_angle(&along, mm / arm);
                    let arm = self.at(index) - about;
                    if moved.contains(&index) {
                        by * arm - arm
                    } else {
                        Vector3::zeros()
                    }
                };
                most = Some(match most {
                    None => self.from(balls, &off),
                    Some(most) if self.is_later(most, balls, &off) => {
                        worst([most, self.from(balls, &off)].into_iter())
                    }
                    Some(most) => most,
                });
            }
        }
        most.unwrap_or(SeenFrom::Never)
    }

    /// Whether an error is seen later than from this size on: tried there, before its own size is
    /// looked for.
    fn is_later(
        &self,
        than: SeenFrom,
        balls: usize,
        off: &dyn Fn(usize, f64) -> Vector3<f64>,
    ) -> bool {
        let SeenFrom::Size(um) = than else {
            return false;
        };
        [1.0, 1.6, 4.0].iter().any(|times| {
            let mm = (um - self.scatter_um(balls)).max(0.1) * times * 1e-3;
            !self.refuses(&|index| off(index, mm))
        })
    }

    /// How many balls stand against each other where the part has moved: the closing one
    /// against the first, or all of them.
    fn against(&self) -> usize {
        match self.job.guards.closing.first() {
            Some(_) => 1,
            None => datums(&self.job).count(),
        }
    }

    /// Each hit is so much later than when taught, as at another feed: a ball's radius shows it.
    fn trips_later(&self) -> SeenFrom {
        let limits = &self.job.limits;
        let learned = self.job.guards.learned;
        let mm = match learned {
            Some(learned) => learned.radius_mm.min(limits.radius_error_mm),
            // Twice: the taught one may be off the other way.
            None => 2.0 * limits.radius_error_mm,
        };
        let has_radius = |feature: &FeatureSpec| {
            matches!(feature.kind, FeatureKind::Sphere | FeatureKind::Circle)
        };
        if datums(&self.job).any(|(_, feature)| has_radius(feature)) {
            self.scattered(1, mm * 1e3)
        } else {
            SeenFrom::Never
        }
    }

    /// Z counts other millimetres than when the reference was taught.
    fn z_scale(&self) -> SeenFrom {
        let by_places = self.from(1, &|_, mm| Vector3::new(0.0, 0.0, mm));
        match &self.job.witness {
            Some(witness) => least(by_places, self.scattered(1, witness.tolerance_mm * 1e3)),
            None => by_places,
        }
    }
}

/// Of each limit the part's own pose takes so much: the rest is rounding.
const WITHIN: f64 = 0.999;

/// What a hit scatters where the job does not say it, µm.
const ASSUMED_SIGMA_UM: f64 = 1.0;

/// Where a part stands, against where it was taught.
#[derive(Clone, Copy)]
struct Stands {
    turned: Rotation3<f64>,
    shift: Vector3<f64>,
    scale: f64,
}

impl Stands {
    fn carries(&self, place: Vector3<f64>, middle: Vector3<f64>) -> Vector3<f64> {
        self.turned * ((place - middle) * self.scale) + middle + self.shift
    }
}

fn middle(of: &[Vector3<f64>]) -> Vector3<f64> {
    of.iter().sum::<Vector3<f64>>() / of.len().max(1) as f64
}

/// The one that is seen last.
fn worst(all: impl Iterator<Item = SeenFrom>) -> SeenFrom {
    all.reduce(|a, b| if is_later(a, b) { a } else { b })
        .unwrap_or(SeenFrom::Never)
}

fn worse(a: (Vector3<f64>, SeenFrom), b: (Vector3<f64>, SeenFrom)) -> (Vector3<f64>, SeenFrom) {
    if is_later(b.1, a.1) { b } else { a }
}

fn is_later(a: SeenFrom, than: SeenFrom) -> bool {
    a != than && least(a, than) == than
}

fn least(a: SeenFrom, b: SeenFrom) -> SeenFrom {
    match (a, b) {
        (SeenFrom::Always, _) | (_, SeenFrom::Always) => SeenFrom::Always,
        (SeenFrom::Size(a), SeenFrom::Size(b)) => SeenFrom::Size(a.min(b)),
        (SeenFrom::Size(a), SeenFrom::Never) | (SeenFrom::Never, SeenFrom::Size(a)) => {
            SeenFrom::Size(a)
        }
        (SeenFrom::After(_), other) | (other, SeenFrom::After(_)) => other,
        (SeenFrom::Never, SeenFrom::Never) => SeenFrom::Never,
    }
}

#[cfg(test)]
mod tests {
    use super::{GuardTable, SeenFrom};
    use umi_protocol::job::Job;

    fn job(text: &str) -> Job {
        toml::from_str(text).unwrap()
    }

    fn seen(job: &Job, code: &str) -> SeenFrom {
        let table = GuardTable::of(job);
        let row = table.rows.iter().find(|row| row.code == code);
        row.unwrap_or_else(|| panic!("no {code}")).seen
    }

    fn um(of: SeenFrom) -> f64 {
        match of {
            SeenFrom::Size(um) => um,
            other => panic!("{other:?}"),
        }
    }

    const FOUR: &str = include_str!("../../../examples/four-spheres.toml");
    const THREE: &str = include_str!("../../../examples/three-spheres.toml");

    /// One closing ball less.
    fn without_last(job: &mut Job) {
        let last = job.guards.closing.pop().unwrap();
        job.features.retain(|feature| feature.name != last.feature);
    }

    /// Three standard deviations of so many balls against as many, of 1 µm a hit.
    fn scatter_um(balls: f64) -> f64 {
        3.0 * (2.0 * balls).sqrt()
    }

    /// Four balls on a square: one that is off by d out of their plane leaves residuals of
    /// d/4 each, so the registration's rms is d/4, and the limit 4.5 µm is met at 18 µm.
    #[test]
    fn a_fourth_ball_sees_a_chip() {
        let mut four = job(FOUR);
        for feature in &mut four.features {
            // On a circle.
            feature.position_mm = None;
        }
        four.guards.warmth = None;
        four.limits.tilt_deg = 1.0;
        four.limits.expected_error_mm = None;
        four.limits.registration_rms_mm = 0.0045;
        // The first ball is seen by the closing one, the others by their residuals.
        let from = um(seen(&four, "chip_on_top")) - scatter_um(4.0);
        assert!((from - 18.0).abs() < 0.1, "{from}");
        // With four balls the rms is that of the limit, with three there is none.
        four.limits.registration_rms_mm *= 2.0;
        let wider = um(seen(&four, "chip_on_top")) - scatter_um(4.0);
        assert!((wider - 36.0).abs() < 0.2, "{wider}");
        // Touched twice, a top that was early once is seen at the limit of the two.
        let once = um(seen(&four, "early_top")) - scatter_um(1.0);
        assert!((once - 9.0).abs() < 1e-9, "{once}");
        four.again = None;
        assert_eq!(seen(&four, "early_top"), seen(&four, "chip_on_top"));
        let mut three = job(THREE);
        for feature in &mut three.features {
            feature.position_mm = None;
        }
        three.limits.tilt_deg = 1.0;
        three.limits.rotation_deg = 360.0;
        let blind = seen(&three, "early_top");
        // Their distances see it, nine times as late.
        assert!(um(blind) > 9.0 * from, "{blind:?}");
    }

    /// Three balls show a chip by the tilt alone, and the part's own one makes up for as much
    /// as the limit: twice its arm, of the ball that is farthest from the other two.
    #[test]
    fn the_parts_own_tilt_hides_a_chip() {
        let mut three = job(THREE);
        // At right angles and level, so that nothing else shows it.
        for (feature, at) in
            three
                .features
                .iter_mut()
                .zip([[0.0; 3], [200.0, 0.0, 0.0], [0.0, 300.0, 0.0]])
        {
            feature.position_mm = Some(at);
        }
        three.limits.shift_mm[2] = 1.0;
        let from = um(seen(&three, "chip_on_top")) - scatter_um(3.0);
        let both_ways = 2.0 * 300_000.0 * three.limits.tilt_deg.to_radians().tan();
        assert!((from - both_ways).abs() < 0.5, "{from} {both_ways}");
    }

    /// Each guard is what sees its row: without it the row is seen later or never.
    #[test]
    fn each_guard_sees_its_row() {
        let four = job(FOUR);
        type Without = fn(&mut Job);
        let guards: [(&str, Without); 10] = [
            ("late_text", |job| job.guards.run_variable = None),
            ("stale_read", |job| job.guards.run_variable = None),
            ("mixed_setups", |job| job.guards.run_variable = None),
            ("offset_changed", |job| job.guards.frame = false),
            ("shift_active", |job| job.guards.frame = false),
            ("shift_while_probed", |job| job.guards.frame = false),
            ("silent_teaching", |job| job.teach = Default::default()),
            ("tool_length", |job| job.guards.frame = false),
            ("not_enclosed", |job| job.guards.closing.clear()),
            ("order", |_| ()),
        ];
        for (code, without) in guards {
            assert_eq!(seen(&four, code), SeenFrom::Always, "{code}");
            let mut less = four.clone();
            without(&mut less);
            let expected = code == "order";
            assert_eq!(seen(&less, code) == SeenFrom::Always, expected, "{code}");
        }
        // Nothing was taught whose length could be compared.
        let mut given = four.clone();
        given.reference = umi_protocol::job::Reference::Given;
        assert_ne!(seen(&given, "tool_length"), SeenFrom::Always);
        given.guards.tool_length_mm = Some(81.5);
        assert_eq!(seen(&given, "tool_length"), SeenFrom::Always);
        // What is probed twice on the table says nothing of the part.
        let mut table = four.clone();
        without_last(&mut table);
        without_last(&mut table);
        table
            .guards
            .fixed
            .push("SPHERE1".try_into().unwrap())
            .unwrap();
        assert_ne!(seen(&table, "not_enclosed"), SeenFrom::Always);
        assert!(
            um(seen(&table, "slip")) > 20.0,
            "{:?}",
            seen(&table, "slip")
        );
        // Without runs a correction that nobody has read waits for as long as it may.
        let mut three = job(THREE);
        assert_eq!(seen(&three, "stale_read"), SeenFrom::After(1800));
        three.plate_timeout_s = 90;
        assert_eq!(seen(&three, "stale_read"), SeenFrom::After(90));
        // Macros that print blocks do not look again.
        let announced = job(include_str!("../../../examples/three-spheres-run.toml"));
        assert_eq!(seen(&announced, "shift_active"), SeenFrom::Always);
        assert_ne!(seen(&announced, "shift_while_probed"), SeenFrom::Always);
        // The closing ball sees what moves: at its limit, whatever the direction.
        for code in ["drift", "slip"] {
            let from = um(seen(&four, code));
            let mut within_um = four.guards.closing[0].within_mm * 1e3;
            if code == "drift" {
                // The last one stands against the second of seven.
                within_um *= 6.0 / 5.0;
            }
            let from = from - scatter_um(1.0);
            assert!((from - within_um).abs() < 0.01, "{code}: {from}");
            let mut open = four.clone();
            open.guards.closing.clear();
            assert!(um(seen(&open, code)) > 1.5 * from, "{code}");
        }
        // A ball on the table sees a longer probe; without it only the limit of the shift does.
        let longer = um(seen(&four, "longer_probe"));
        assert!(
            (longer - 2.0 * 60_000.0 * 2_f64.sqrt()).abs() < 1_000.0,
            "{longer}"
        );
        let mut table = four.clone();
        let mut ball = table.features[3].clone();
        ball.name = "TABLE".try_into().unwrap();
        ball.id = Some(8);
        table.features.push(ball).unwrap();
        table
            .guards
            .fixed
            .push("TABLE".try_into().unwrap())
            .unwrap();
        table.guards.fixed_mm = Some(0.006);
        umi_core::job::check(&table).unwrap();
        let from = um(seen(&table, "longer_probe")) - scatter_um(1.0);
        assert!((from - 6.0).abs() < 0.01, "{from}");
    }

    /// One closing ball shows no turn about it, two no rocking over both, three show each from a
    /// few times their limit on.
    #[test]
    fn three_closing_balls_show_each_turn() {
        let mut job = job(FOUR);
        let [turned, rocked] = ["turned", "rocked"].map(|code| um(seen(&job, code)));
        let within_um = job.guards.closing[0].within_mm * 1e3;
        assert!((within_um..2.0 * within_um).contains(&turned), "{turned}");
        // By the plane of three limits a fourth ball moves by three of them.
        assert!((within_um..4.0 * within_um).contains(&rocked), "{rocked}");
        // Between the closing ones it is seen by the last alone: not about that one.
        assert_eq!(seen(&job, "moved_while_closing"), SeenFrom::Never);
        without_last(&mut job);
        assert!(um(seen(&job, "turned")) < 3.0 * within_um);
        assert_eq!(seen(&job, "rocked"), SeenFrom::Never);
        without_last(&mut job);
        assert_eq!(seen(&job, "turned"), SeenFrom::Never);
        assert_eq!(seen(&job, "rocked"), SeenFrom::Never);
    }

    /// One ring has nothing that it turns against.
    #[test]
    fn a_feature_alone_shows_no_turn() {
        let ring = job(include_str!("../../../examples/ring-gauge.toml"));
        for code in ["turned", "rocked"] {
            assert_eq!(seen(&ring, code), SeenFrom::Never, "{code}");
        }
    }

    /// Two chips on one side look like a tilt: the limit both ways, where the part leans against
    /// them, over the distance of the two sides.
    #[test]
    fn chips_on_one_side_are_a_tilt() {
        let mut job = job(FOUR);
        let from = um(seen(&job, "chips_on_two")) - scatter_um(4.0);
        let both_ways = 2.0 * 273_000.0 * job.limits.tilt_deg.to_radians().tan();
        assert!((from - both_ways).abs() < 2.0, "{from} {both_ways}");
        job.limits.tilt_deg *= 2.0;
        let wider = um(seen(&job, "chips_on_two")) - scatter_um(4.0);
        assert!((wider / from - 2.0).abs() < 0.1, "{wider} {from}");
    }

    /// A worn stylus: the rms of 6 hits is that of two degrees of freedom, so a ball passes a
    /// limit L with `1 - exp(-3 L²/s²)`, and of four balls one in a thousand passes where that is
    /// the fourth root of it.
    #[test]
    fn scatter_is_seen_by_the_rms() {
        let mut four = job(FOUR);
        four.guards.learned = None;
        let from = um(seen(&four, "worn_stylus"));
        let ball = 0.001_f64.powf(0.25);
        let expected = 10.0 * (3.0 / -(1.0 - ball).ln()).sqrt();
        assert!((from - expected).abs() < 0.01, "{from} {expected}");
        for feature in &mut four.features {
            feature.hits = 4;
        }
        assert_eq!(seen(&four, "worn_stylus"), SeenFrom::Never);
    }
}
