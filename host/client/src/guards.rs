//! What a job sees of what can go wrong between the part and the correction, and from how many
//! micrometres on.
//!
//! # Rule
//!
//! Each row is an error that leaves no trace in the text of one setup. It is put onto the job's
//! nominal places, larger and larger, and judged by the code that judges on the board
//! ([`umi_core::job::against_places`]), closing features and features on the table with it. The
//! row's figure is the size from which on every such error is refused: of the worst feature, in
//! the worst of 13 directions. Hits are taken as exact, so within a few standard deviations of
//! the figure it may go either way.
//!
//! A taught job without `position_mm` has no places: its datum features are then taken evenly
//! on a circle of [`ASSUMED_RADIUS_MM`].

use nalgebra::Vector3;
use umi_core::job::{against_places, closing, datums, fixed, touches_again};
use umi_core::units::Point;
use umi_protocol::job::{FeatureKind, Job, Reference, Teach};
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
    /// Never, up to a decimetre.
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
                when(has_run),
                "run_variable",
            ),
            row(
                "offset_changed",
                "work offset changed after teaching",
                or_from(job.guards.frame, &|| setup.together()),
                "frame",
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
                setup.one(&UP),
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
                "longer_probe",
                "longer probe, bent stylus",
                setup.together(),
                "fixed",
            ),
            row(
                "worn_stylus",
                "worn stylus, scattering",
                worn_stylus(job),
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
                "z_scale",
                "Z scale, error at the part",
                setup.z_scale(),
                "fixed, witness",
            ),
        ];
        Self {
            rows,
            has_places: setup.has_places,
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

/// Sizes that are tried.
const STEPS: u32 = 30;

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

    /// Whether the job refuses a setup whose features are off by these.
    fn refuses(&self, off: &dyn Fn(usize) -> Vector3<f64>) -> bool {
        let job = &self.job;
        let due = || datums(job).chain(fixed(job)).map(|(index, _)| index);
        let at = |index: usize| self.places.get(index).copied().unwrap_or_default();
        let point = |mm| Point { mm };
        let reference: Vec<Point> = due().map(|index| point(at(index))).collect();
        let measured: Vec<Point> = due().map(|index| point(at(index) + off(index))).collect();
        let is_open = closing(job).any(|(again, closing)| {
            let first = job.features.iter().position(|f| f.name == closing.repeats);
            first.is_some_and(|first| (off(again) - off(first)).norm() > closing.within_mm)
        });
        is_open || against_places(job, &reference, &measured)
    }

    /// The size from which on an error is refused.
    fn from(&self, off: &dyn Fn(usize, f64) -> Vector3<f64>) -> SeenFrom {
        let refuses = |um: f64| self.refuses(&|index| off(index, um * 1e-3));
        // From 0.1 µm to 100 mm, five to a decade.
        let size = |step: u32| 10_f64.powf(f64::from(step) / 5.0 - 1.0);
        let Some(last) = (0..=STEPS).rev().find(|step| !refuses(size(*step))) else {
            return SeenFrom::Size(size(0));
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
        SeenFrom::Size(high)
    }

    /// One feature is off: the worst of all that the part is corrected by.
    fn one(&self, directions: &[[i8; 3]]) -> SeenFrom {
        let due = datums(&self.job).map(|(index, _)| index);
        worst(due.flat_map(|of| {
            directions.iter().map(move |direction| {
                let along = unit(direction);
                self.from(&|index, mm| along * if index == of { mm } else { 0.0 })
            })
        }))
    }

    /// The first touch of a ball is early and the others are driven by it: where the top is
    /// touched twice the two differ by all of it.
    fn early_top(&self) -> SeenFrom {
        let is_again = datums(&self.job).all(|(_, feature)| touches_again(feature));
        match self.job.again {
            Some(again) if is_again => SeenFrom::Size(again.within_mm * 1e3),
            _ => self.one(&UP),
        }
    }

    /// All are off alike.
    fn together(&self) -> SeenFrom {
        worst(DIRECTIONS.iter().map(|direction| {
            let along = unit(direction);
            self.from(&|_, mm| along * mm)
        }))
    }

    /// They move evenly from the first to the last.
    fn drift(&self) -> SeenFrom {
        let last = self.places.len().saturating_sub(1).max(1) as f64;
        worst(DIRECTIONS.iter().map(|direction| {
            let along = unit(direction);
            self.from(&|index, mm| along * (mm * index as f64 / last))
        }))
    }

    /// From one of them on they have moved.
    fn slip(&self) -> SeenFrom {
        worst((1..self.places.len()).flat_map(|from| {
            DIRECTIONS.iter().map(move |direction| {
                let along = unit(direction);
                self.from(&|index, mm| along * if index >= from { mm } else { 0.0 })
            })
        }))
    }

    /// Z counts other millimetres than when the reference was taught.
    fn z_scale(&self) -> SeenFrom {
        let by_places = self.from(&|_, mm| Vector3::new(0.0, 0.0, mm));
        match &self.job.witness {
            Some(witness) => least(by_places, SeenFrom::Size(witness.tolerance_mm * 1e3)),
            None => by_places,
        }
    }
}

/// Scatter at which a feature's rms is expected at its limit.
fn worn_stylus(job: &Job) -> SeenFrom {
    worst(datums(job).map(|(_, feature)| {
        let parameters = match feature.kind {
            FeatureKind::Plane => 3.0,
            FeatureKind::Circle => 3.0,
            FeatureKind::Sphere | FeatureKind::Line => 4.0,
            FeatureKind::Cylinder => 5.0,
            FeatureKind::Cone => 6.0,
        };
        let hits = f64::from(feature.hits);
        let free = hits - parameters;
        if free < 1.0 {
            return SeenFrom::Never;
        }
        let share = (free / hits).sqrt();
        let learned = job.guards.learned.map_or(f64::INFINITY, |learned| {
            let taught = job.guards.probing.map_or(0.0, |probing| probing.sigma_mm);
            learned.rms_mm + taught * share
        });
        SeenFrom::Size(job.limits.rms_mm.min(learned) / share * 1e3)
    }))
}

/// The one that is seen last.
fn worst(all: impl Iterator<Item = SeenFrom>) -> SeenFrom {
    all.reduce(|a, b| if least(a, b) == a { b } else { a })
        .unwrap_or(SeenFrom::Never)
}

fn least(a: SeenFrom, b: SeenFrom) -> SeenFrom {
    match (a, b) {
        (SeenFrom::Always, _) | (_, SeenFrom::Always) => SeenFrom::Always,
        (SeenFrom::Size(a), SeenFrom::Size(b)) => SeenFrom::Size(a.min(b)),
        (SeenFrom::Size(a), SeenFrom::Never) | (SeenFrom::Never, SeenFrom::Size(a)) => {
            SeenFrom::Size(a)
        }
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

    /// Four balls on a square: one that is off by d out of their plane leaves residuals of
    /// d/4 each, so the registration's rms is d/4, and the limit 4.5 µm is met at 18 µm;
    /// the tilt's limit of 0.010 degrees comes later or earlier by the arm.
    #[test]
    fn a_fourth_ball_sees_a_chip() {
        let mut four = job(FOUR);
        four.guards.warmth = None;
        four.limits.tilt_deg = 1.0;
        four.limits.expected_error_mm = None;
        four.limits.registration_rms_mm = 0.0045;
        // The first ball is seen by the closing one, the others by their residuals.
        let from = um(seen(&four, "chip_on_top"));
        assert!((from - 18.0).abs() < 0.1, "{from}");
        // With four balls the rms is that of the limit, with three there is none.
        four.limits.registration_rms_mm *= 2.0;
        let wider = um(seen(&four, "chip_on_top"));
        assert!((wider - 36.0).abs() < 0.2, "{wider}");
        // Touched twice, a top that was early once is seen at the limit of the two.
        assert_eq!(um(seen(&four, "early_top")), 9.0);
        four.again = None;
        assert_eq!(seen(&four, "early_top"), seen(&four, "chip_on_top"));
        let mut three = job(THREE);
        three.limits.tilt_deg = 1.0;
        three.limits.rotation_deg = 360.0;
        let blind = seen(&three, "early_top");
        // Their distances see it, nine times as late.
        assert!(um(blind) > 9.0 * from, "{blind:?}");
    }

    /// Each guard is what sees its row: without it the row is seen later or never.
    #[test]
    fn each_guard_sees_its_row() {
        let four = job(FOUR);
        type Without = fn(&mut Job);
        let guards: [(&str, Without); 6] = [
            ("late_text", |job| job.guards.run_variable = None),
            ("stale_read", |job| job.guards.run_variable = None),
            ("mixed_setups", |job| job.guards.run_variable = None),
            ("offset_changed", |job| job.guards.frame = false),
            ("silent_teaching", |job| job.teach = Default::default()),
            ("order", |_| ()),
        ];
        for (code, without) in guards {
            assert_eq!(seen(&four, code), SeenFrom::Always, "{code}");
            let mut less = four.clone();
            without(&mut less);
            let expected = code == "order";
            assert_eq!(seen(&less, code) == SeenFrom::Always, expected, "{code}");
        }
        // The closing ball sees what moves: at its limit, whatever the direction.
        for code in ["drift", "slip"] {
            let from = um(seen(&four, code));
            let within_um = four.guards.closing[0].within_mm * 1e3;
            assert!((from - within_um).abs() < 0.01, "{code}: {from}");
            let mut open = four.clone();
            open.guards.closing.clear();
            assert!(um(seen(&open, code)) > 1.5 * from, "{code}");
        }
        // A ball on the table sees a longer probe; without it only the limit of the shift does.
        let longer = um(seen(&four, "longer_probe"));
        assert!(
            (longer - 60_000.0 * 2_f64.sqrt()).abs() < 25_000.0,
            "{longer}"
        );
        let mut table = four.clone();
        let mut ball = table.features[3].clone();
        ball.name = "TABLE".try_into().unwrap();
        ball.id = Some(6);
        table.features.push(ball).unwrap();
        table
            .guards
            .fixed
            .push("TABLE".try_into().unwrap())
            .unwrap();
        table.guards.fixed_mm = Some(0.006);
        umi_core::job::check(&table).unwrap();
        let from = um(seen(&table, "longer_probe"));
        assert!((from - 6.0).abs() < 0.01, "{from}");
    }

    /// A worn stylus is seen where the expected rms is at the limit.
    #[test]
    fn scatter_is_seen_by_the_rms() {
        let mut four = job(FOUR);
        four.guards.learned = None;
        // Six hits and four parameters: 10 µm of rms are 17.3 µm of scatter.
        let from = um(seen(&four, "worn_stylus"));
        assert!((from - 17.32).abs() < 0.01, "{from}");
        for feature in &mut four.features {
            feature.hits = 4;
        }
        assert_eq!(seen(&four, "worn_stylus"), SeenFrom::Never);
    }
}
