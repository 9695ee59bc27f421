//! Sessions of one kind through a board's brain, and what became of every clamping.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use umi_core::brain::{Brain, Output};
use umi_core::correction::corners;
use umi_core::registration::RigidTransform;
use umi_core::units::{Micros, Point};
use umi_protocol::job::{Compensation, Teach};
use umi_protocol::line::LineStatus;
use umi_protocol::message::{TeachBy, TeachWhat};
use umi_protocol::verdict::Verdict;

use super::WRONG_MM;
use super::kind::DamageKind;
use super::motion::{PartMotion, is_enclosed};
use super::plan::SimulatedPlan;
use super::text::{self, SimulatedBall};
use super::world::{Dice, Probing, TruePose, error_mm, hits};

/// What became of the clampings of a kind.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DamageTally {
    /// All that were spoilt (or clean, where nothing is).
    pub clampings: u32,
    /// Corrections within [`WRONG_MM`].
    pub right: u32,
    /// Corrections beyond.
    pub wrong: u32,
    /// None left, and it would have been wrong, or the text was damaged.
    pub refused: u32,
    /// None left, and it would have been right.
    pub refused_harmless: u32,
    /// The largest error of a correction, mm.
    pub worst_mm: f64,
    /// By which reasons (the first of each) those were refused that would have been right.
    pub harmless_by: BTreeMap<String, u32>,
}

const CLAMPINGS: usize = 5;

/// Runs sessions of one kind until so many clampings were spoilt.
///
/// # Panics
/// If the job cannot be used.
#[must_use]
pub fn measure(plan: &SimulatedPlan, kind: DamageKind, clampings: u32, seed: u64) -> DamageTally {
    let mut tally = DamageTally::default();
    let mut dice = Dice(seed);
    while tally.clampings < clampings {
        Session::new(plan, kind, Dice(seed ^ dice.below(usize::MAX) as u64)).run(&mut tally);
    }
    tally
}

struct Session<'a> {
    plan: &'a SimulatedPlan,
    kind: DamageKind,
    dice: Dice,
    brain: Brain,
    /// What a READ gets: the latest correction, as long as nothing is printed after it.
    released: Option<Verdict>,
    /// What the latest verdict has against the setup.
    against: String,
    run: u32,
    now: u64,
    /// How far the order of the balls is turned, where it is.
    begins_with: usize,
}

/// What a control prints of one clamping, and where the plate stands then.
struct Clamping {
    lines: Vec<String>,
    pose: TruePose,
    run: u32,
    /// What a correction of it would be wrong by if nobody refused.
    harm_mm: f64,
}

impl<'a> Session<'a> {
    fn new(plan: &'a SimulatedPlan, kind: DamageKind, dice: Dice) -> Self {
        Self {
            plan,
            kind,
            dice,
            brain: Brain::new(plan.job.clone()).expect("the job is good"),
            released: None,
            against: String::new(),
            run: 100,
            now: 0,
            begins_with: 0,
        }
    }

    fn run(mut self, tally: &mut DamageTally) {
        self.begins_with = 1 + self.dice.below(self.plan.datums - 1);
        let asked = self.plan.job.teach == Teach::Asked;
        if self.kind == DamageKind::OldBeforeTeaching {
            let pose = TruePose::anywhere(&mut self.dice);
            let old = self.clamping(pose, DamageKind::Clean, false);
            self.print(&old.lines);
        }
        let spoils_teaching = self.kind == DamageKind::TeachingRefused;
        let kind = if self.kind == DamageKind::OtherOrder {
            DamageKind::OtherOrder
        } else {
            DamageKind::Clean
        };
        let mut taught = self.clamping(TruePose::taught(), kind, asked);
        if spoils_teaching {
            let hits = self.plan.job.features[0].hits;
            text::spoil(
                DamageKind::CharacterLost,
                hits,
                &mut taught.lines,
                &mut self.dice,
            );
        }
        if asked && !self.plan.job.guards.frame {
            // There is no line for it: somebody asks at the host.
            let (now, by) = (Micros(self.now), TeachBy::Host);
            let _ = self.brain.teach(now, by, TeachWhat::Again, &mut |_| {});
        }
        self.print(&taught.lines);
        // And says behind it that this was the one: it was the last to be probed.
        let (now, by) = (Micros(self.now), TeachBy::Host);
        let _ = self.brain.teach(now, by, TeachWhat::Keep, &mut |_| {});
        let spoilt = match self.kind {
            // The first one has none before it.
            DamageKind::BallsOfTwo => 2 + self.dice.below(CLAMPINGS - 2),
            _ => 1 + self.dice.below(CLAMPINGS - 1),
        };
        let mut before: Option<Clamping> = None;
        for number in 1..CLAMPINGS {
            let is_spoilt = self.kind.lasts() || number == spoilt || self.kind == DamageKind::Clean;
            let kind = if is_spoilt {
                self.kind
            } else {
                DamageKind::Clean
            };
            let pose = match (kind, &before) {
                (DamageKind::BallsOfTwo, Some(before)) => {
                    let by = self.dice.direction() * self.size([0.01, 0.1]);
                    before.pose.nudged(by)
                }
                _ => TruePose::anywhere(&mut self.dice),
            };
            let clamping = match (kind, &before) {
                (DamageKind::BallsOfTwo, Some(before)) => self.of_two(before.pose, pose),
                _ => self.clamping(pose, kind, false),
            };
            match kind {
                DamageKind::Late => {
                    // What comes is of the clamping before, which stood elsewhere.
                    if let Some(before) = &before {
                        let lines = before.lines.clone();
                        self.print(&lines);
                    }
                }
                DamageKind::NothingCame => {}
                _ => self.print(&clamping.lines),
            }
            let judged = !(kind == DamageKind::Late && before.is_none());
            let unread = self.kind == DamageKind::NothingCame && number + 1 == spoilt;
            let got = if unread {
                None
            } else {
                self.reads(clamping.run)
            };
            if is_spoilt && judged && !(kind == DamageKind::NothingCame && number == 1) {
                self.judge(got, &clamping, tally);
            }
            before = Some(clamping);
        }
    }

    fn size(&mut self, own: [f64; 2]) -> f64 {
        let sizes = self.plan.sizes_mm.unwrap_or(own);
        self.dice.within(sizes)
    }

    /// Where the middle of the datum balls is when taught.
    fn middle(&self) -> Vector3<f64> {
        let datums = &self.plan.places[..self.plan.datums];
        #[allow(clippy::cast_precision_loss, reason = "a handful")]
        let count = datums.len() as f64;
        datums
            .iter()
            .map(|p| Vector3::from(*p))
            .sum::<Vector3<f64>>()
            / count
    }

    fn corners(&self) -> Vec<Point> {
        let spec = self.plan.job.correction.as_ref().expect("it corrects");
        let (min, max) = (spec.part_min_mm.into(), spec.part_max_mm.into());
        corners(&min, &max).map(|mm| Point { mm }).collect()
    }

    /// What a control prints of a plate that stands there.
    fn clamping(&mut self, pose: TruePose, kind: DamageKind, teaches: bool) -> Clamping {
        self.run += 1;
        let sizes = |own: [f64; 2]| self.plan.sizes_mm.unwrap_or(own);
        let lowest = self.plan.places.iter().map(|place| place[2]);
        let lowest_mm = lowest.fold(f64::INFINITY, f64::min);
        let middle = self.middle();
        let dice = &mut self.dice;
        let mut pose = pose;
        if kind == DamageKind::Warm {
            pose.scale = 1.0 + 11.5e-6 * dice.either(0.0, 5.0);
        }
        let mut probing = Probing::default();
        match kind {
            DamageKind::BentStylus => {
                probing.bent_mm = (dice.direction() * dice.within(sizes([0.01, 0.06]))).into();
            }
            DamageKind::OtherFeed => probing.late_mm = dice.within(sizes([0.001, 0.02])),
            DamageKind::FastScatter => probing.fast_mm = 0.006,
            DamageKind::WornStylus => probing.scatter_mm = dice.within(sizes([0.005, 0.02])),
            DamageKind::CoarseStep => {
                let steps_mm = [0.02, 0.025, 0.05, 0.1];
                probing.step_mm = steps_mm[dice.below(steps_mm.len())];
            }
            DamageKind::ZScale => {
                let own = [10e-6 * lowest_mm, 100e-6 * lowest_mm];
                let [least, most] = sizes(own).map(|mm| mm / lowest_mm);
                probing.z_scale = dice.either(least, most);
            }
            _ => {}
        }
        let motion = PartMotion::of(kind, self.plan, &pose, middle, dice);
        // Which ball is probed as which.
        let mut turns: Vec<usize> = (0..self.plan.places.len()).collect();
        if kind == DamageKind::SlipOutside {
            loop {
                for at in (1..self.plan.moving).rev() {
                    turns.swap(at, dice.below(at + 1));
                }
                if !is_enclosed(&self.plan.job, &turns) {
                    break;
                }
            }
        }
        // From which turn on the stylus is bent.
        let mut bent_from = None;
        if matches!(kind, DamageKind::BentInRun | DamageKind::BentBehindTable) {
            let way: [f64; 3] = (dice.direction() * dice.within(sizes([0.01, 0.06]))).into();
            let turn = match kind {
                DamageKind::BentInRun => 1 + dice.below(self.plan.moving - 1),
                _ => {
                    // In front of this one stands what else would be the last.
                    let turn = dice.below(self.plan.datums);
                    if self.plan.moving < turns.len() {
                        turns[turn..].rotate_right(1);
                        turn + 1
                    } else {
                        turn
                    }
                }
            };
            bent_from = Some((turn, way));
        }
        // Where the balls are on their plate, against where they were taught.
        let mut on_plate = vec![Vector3::zeros(); self.plan.places.len()];
        match kind {
            DamageKind::BallMoved => {
                on_plate[dice.below(self.plan.datums)] =
                    dice.direction() * dice.within(sizes([0.01, 0.05]));
            }
            DamageKind::OtherPlate => {
                for ball in &mut on_plate[..self.plan.datums] {
                    *ball = dice.direction() * dice.within(sizes([0.005, 0.06]));
                }
            }
            DamageKind::Bowed => {
                let [least, most] = sizes([0.01, 0.05]);
                let high = dice.either(least, most);
                let out = |ball: &[f64; 3]| (Vector3::from(*ball) - middle).xy().norm_squared();
                let balls = &self.plan.places[..self.plan.datums];
                let most = balls.iter().map(out).fold(0.0, f64::max);
                for (ball, place) in on_plate.iter_mut().zip(balls) {
                    ball.z = high * out(place) / most;
                }
            }
            _ => {}
        }
        let one = dice.below(self.plan.datums);
        let other = (one + 1 + dice.below(self.plan.datums - 1)) % self.plan.datums;
        let other_chip = dice.within(sizes([0.01, 0.05]));
        let early = dice.within(sizes([0.01, 0.05]));
        let axis = dice.below(3);
        let [least, most] = sizes([0.01, 0.09]);
        let digit = dice.either(least, most);
        let digit = (digit * 1000.0).round() / 1000.0;
        let mut by = |is: bool| {
            let drawn = if is { dice.either(0.05, 50.0) } else { 0.0 };
            (drawn * 1000.0).round() / 1000.0
        };
        let origin = by(kind == DamageKind::OffsetMoved);
        let shift = by(kind == DamageKind::ShiftActive);
        let jump = by(kind == DamageKind::ShiftWhileProbed);
        let length = match kind {
            DamageKind::OtherLength => (dice.either(0.005, 50.0) * 1000.0).round() / 1000.0,
            _ => 0.0,
        };
        let jumps_at = match kind {
            DamageKind::ShiftWhileProbed => dice.below(self.plan.moving),
            _ => self.plan.places.len(),
        };
        let mut balls: Vec<SimulatedBall> = Vec::new();
        for (place, at) in self.plan.places.iter().enumerate() {
            let again = self.plan.places.iter().position(|first| first == at);
            let nominal = Vector3::from(*at) + on_plate[again.unwrap_or(place)];
            let turn = turns.iter().position(|of| *of == place).unwrap_or(place);
            let count = usize::from(self.plan.job.features[place].hits);
            let centers: Vec<Vector3<f64>> = (0..count)
                .map(|hit| {
                    let at = [turn, self.plan.moving, hit];
                    if place < self.plan.moving {
                        motion.at(&pose, middle, at).carries(nominal, middle)
                    } else {
                        nominal
                    }
                })
                .collect();
            let is_again = |ball: usize| self.plan.places[ball] == *at;
            let mut probing = probing;
            match kind {
                DamageKind::EarlyTop if place == one => probing.early_top_mm = early,
                // It is probed again, and the chip is still there.
                DamageKind::ChipOnTop | DamageKind::TwoChips if is_again(one) => {
                    probing.chip_mm = early;
                }
                DamageKind::TwoChips if is_again(other) => probing.chip_mm = other_chip,
                DamageKind::EqualChips if place < self.plan.moving && !is_again(one) => {
                    probing.chip_mm = early;
                }
                DamageKind::DustOnAll if place < self.plan.moving => probing.chip_mm = early,
                _ => {}
            }
            if let Some((from, way)) = bent_from
                && turn >= from
            {
                probing.bent_mm = way;
            }
            let mut points = hits(&centers, &probing, &mut self.dice);
            for point in &mut points {
                point[0] -= origin + shift;
                point[2] -= length;
                if place >= jumps_at {
                    point[0] -= jump;
                }
                if kind == DamageKind::SameDigit && place == one {
                    point[axis] += digit;
                }
            }
            balls.push((u16::try_from(place + 1).unwrap_or(u16::MAX), points));
        }
        // What metal will meet.
        let pose = motion.end(&pose, middle);
        let harm_mm = self.harm(&balls, &pose);
        if kind == DamageKind::OtherOrder {
            // Where one closes, the one that it repeats stays the first.
            let first = usize::from(self.plan.moving > self.plan.datums);
            let of = self.begins_with % (self.plan.datums - first);
            balls[first..self.plan.datums].rotate_left(of.max(1));
        }
        balls = turns.iter().map(|place| balls[*place].clone()).collect();
        if self.is_checked() {
            // O8812 looks before each hit and ends in an alarm: what it prints is tried on the
            // virtual machine (`tests/tests/truth/macros/shifts.rs`).
            balls.truncate(jumps_at);
        }
        let feed_um_per_min = match kind {
            // What `trips_later` of `umi job check` says is without it: by an override.
            DamageKind::OtherFeed if self.plan.sizes_mm.is_none() => 100_000,
            _ => 50_000,
        };
        let moved_mm = [origin, shift, length];
        let lines = self.lines(&balls, moved_mm, teaches, feed_um_per_min);
        let run = self.run;
        let mut clamping = Clamping {
            lines,
            pose,
            run,
            harm_mm,
        };
        if kind.is_of_text() {
            let hits = self.plan.job.features[0].hits;
            text::spoil(kind, hits, &mut clamping.lines, &mut self.dice);
        }
        clamping
    }

    /// Whether it prints checked lines, by openumi's own macros.
    fn is_checked(&self) -> bool {
        matches!(self.plan.job.compensation, Compensation::OnBoard { .. })
    }

    fn lines(
        &self,
        balls: &[SimulatedBall],
        moved_mm: [f64; 3],
        teaches: bool,
        feed_um_per_min: u32,
    ) -> Vec<String> {
        if let Compensation::OnBoard { tip_radius_mm, .. } = self.plan.job.compensation {
            let run = self.run;
            text::checked(
                balls,
                run,
                moved_mm,
                teaches,
                tip_radius_mm,
                feed_um_per_min,
            )
        } else {
            let names = self.plan.job.features.iter();
            let names: Vec<String> = names.map(|f| f.name.to_string()).collect();
            let mut lines = Vec::new();
            if self.plan.job.guards.frame {
                lines = text::announced(self.run, moved_mm, teaches);
            }
            lines.extend(text::blocks(balls, &names));
            lines
        }
    }

    /// The first balls where the plate stood before, the others where it stands.
    fn of_two(&mut self, before: TruePose, pose: TruePose) -> Clamping {
        let stale = 1 + self.dice.below(self.plan.datums - 1);
        let mut now = self.clamping(pose, DamageKind::Clean, false);
        self.run -= 1;
        let old = self.clamping(before, DamageKind::Clean, false);
        let blocks = now.lines.iter().any(|line| line == "***");
        let lines = if blocks {
            let said = if self.plan.job.guards.frame { 3 } else { 0 };
            said + 9 * stale
        } else {
            3 + usize::from(self.plan.job.features[0].hits) * stale
        };
        let mixed = old.lines[..lines].iter().chain(&now.lines[lines..]);
        let lines = mixed.cloned().collect();
        // By how much the stale balls are wrong is not more than what it moved.
        let harm_mm = (pose.shift - before.shift).norm();
        now = Clamping {
            lines,
            harm_mm,
            ..now
        };
        now
    }

    /// What a registration of these hits would be wrong by, whatever the limits say.
    fn harm(&self, balls: &[SimulatedBall], pose: &TruePose) -> f64 {
        let datums = &self.plan.places[..self.plan.datums];
        let from: Vec<Point> = datums.iter().map(|p| Point::from_array_mm(*p)).collect();
        let to: Vec<Point> = balls[..self.plan.datums]
            .iter()
            .map(|(_, hits)| {
                let points: Vec<Point> = hits.iter().copied().map(Point::from_array_mm).collect();
                umi_core::fit::sphere::fit(&points).map_or(points[0], |fit| fit.center)
            })
            .collect();
        umi_core::registration::register(&from, &to).map_or(f64::INFINITY, |fit| {
            error_mm(&fit.transform, pose, self.middle(), &self.corners())
        })
    }

    /// The control prints; the board decides as it would.
    fn print(&mut self, lines: &[String]) {
        let Self {
            brain,
            released,
            against,
            now,
            ..
        } = self;
        for line in lines {
            *now += 1_000_000;
            let bytes = format!("{line}\r\n");
            brain.bytes(Micros(*now), bytes.as_bytes(), &mut |output| match output {
                Output::Line(line)
                    if matches!(
                        line.status,
                        LineStatus::Separator | LineStatus::Request | LineStatus::Repeated
                    ) => {}
                Output::Line(_) => *released = None,
                Output::Verdict(verdict) => {
                    let first = verdict.reasons.first();
                    *against = first.map_or("", |of| of.reason.code()).to_owned();
                    *released = verdict.ok.then(|| verdict.clone());
                }
                _ => {}
            });
        }
    }

    /// The control reads, and is in this run: the transform that it gets, unless the program
    /// stops because it is of another run.
    fn reads(&mut self, control_run: u32) -> Option<RigidTransform> {
        let released = self.released.take();
        self.now += 1_000_000;
        let asks = "READ O9010\r\n";
        self.brain
            .bytes(Micros(self.now), asks.as_bytes(), &mut |_| {});
        let verdict = released?;
        let program = &verdict.correction.as_ref()?.text;
        let of_run = program.split("IF[#531EQ").nth(1);
        let of_run = of_run.and_then(|rest| rest.split(']').next());
        if of_run.is_some_and(|run| run.parse() != Ok(control_run)) {
            return None;
        }
        let registration = verdict.registration.as_ref()?;
        let [a, b, c] = registration.rotation;
        Some(RigidTransform {
            rotation: nalgebra::Matrix3::from_rows(&[a.into(), b.into(), c.into()]),
            translation_mm: registration.translation_mm.into(),
        })
    }

    fn judge(&self, got: Option<RigidTransform>, clamping: &Clamping, tally: &mut DamageTally) {
        tally.clampings += 1;
        let Some(transform) = got else {
            let text_was_whole = !self.kind.is_of_text() || self.kind == DamageKind::LineTwice;
            let arrived = !matches!(
                self.kind,
                DamageKind::Late
                    | DamageKind::NothingCame
                    | DamageKind::OldBeforeTeaching
                    | DamageKind::TeachingRefused
            );
            if text_was_whole && arrived && clamping.harm_mm <= WRONG_MM {
                tally.refused_harmless += 1;
                *tally.harmless_by.entry(self.against.clone()).or_default() += 1;
            } else {
                tally.refused += 1;
            }
            return;
        };
        let error = error_mm(&transform, &clamping.pose, self.middle(), &self.corners());
        tally.worst_mm = tally.worst_mm.max(error);
        if error <= WRONG_MM {
            tally.right += 1;
        } else {
            tally.wrong += 1;
        }
    }
}
