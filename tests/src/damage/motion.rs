//! How a part moves while it is probed.

use nalgebra::{Rotation3, Unit, Vector3};
use umi_core::job::{closing, datums};
use umi_protocol::job::Job;

use super::kind::DamageKind;
use super::plan::SimulatedPlan;
use super::world::{Dice, TruePose};

/// What a part does between its first hit and its last.
#[derive(Clone, Debug)]
pub enum PartMotion {
    /// It stands.
    Stands,
    /// It moves evenly, by so much from the first ball to the last.
    Drifts(Vector3<f64>),
    /// Once, before a hit: where it moves to.
    Slips {
        /// Number of the ball in the order of probing, from 0.
        turn: usize,
        /// Number of the hit on it, from 0.
        hit: usize,
        /// Pivot of the turn.
        about: Vector3<f64>,
        /// By how much it turns.
        turned: Rotation3<f64>,
        /// By how much it is shifted.
        shift: Vector3<f64>,
    },
    /// It is away by so much for these balls, in the order of probing.
    CameBack(std::ops::Range<usize>, Vector3<f64>),
}

impl PartMotion {
    /// Of a kind, with a size in mm of what the ball does that moves most, of those that were
    /// probed before.
    pub fn of(
        kind: DamageKind,
        plan: &SimulatedPlan,
        pose: &TruePose,
        middle: Vector3<f64>,
        dice: &mut Dice,
    ) -> Self {
        let own = match kind {
            // From what the limits leave to what is seen with bare eyes.
            DamageKind::TurnedAboutFirst | DamageKind::TurnedAnywhere | DamageKind::Rocked => {
                let size = dice.between(0.005_f64.ln(), 5_f64.ln()).exp();
                [size, size]
            }
            _ => [0.005, 0.05],
        };
        let size = dice.within(plan.sizes_mm.unwrap_or(own));
        let way = dice.direction() * size;
        let turn = 1 + dice.below(plan.moving - 1);
        let slips = |turn, hit| Self::Slips {
            turn,
            hit,
            about: Vector3::zeros(),
            turned: Rotation3::identity(),
            shift: way,
        };
        // Up to the first one that closes: behind it the part may turn about what is left.
        let upto = (plan.datums + 1).min(plan.moving);
        let hits = usize::from(plan.job.features[0].hits);
        match kind {
            DamageKind::Drift => Self::Drifts(way),
            DamageKind::Slip | DamageKind::SlipOutside => slips(turn, 0),
            DamageKind::SlipInBall => slips(dice.below(upto - 1), 1 + dice.below(hits - 1)),
            DamageKind::TurnedAboutFirst | DamageKind::TurnedAnywhere | DamageKind::Rocked => {
                let balls: Vec<Vector3<f64>> = plan.places[..plan.datums]
                    .iter()
                    .map(|place| pose.carries(Vector3::from(*place), middle))
                    .collect();
                let level = |dice: &mut Dice| {
                    let angle = dice.between(0.0, std::f64::consts::TAU);
                    Vector3::new(angle.cos(), angle.sin(), 0.0)
                };
                let arm =
                    |axis: &Unit<Vector3<f64>>, about: Vector3<f64>, balls: &[Vector3<f64>]| {
                        let arms = balls.iter().map(|ball| axis.cross(&(ball - about)).norm());
                        arms.fold(0.0, f64::max)
                    };
                // Unless it has moved away from what was probed, it is measured rightly.
                let (turn, about, axis, arm) = loop {
                    let turn = 1 + dice.below(upto - 1);
                    let (about, axis) = match kind {
                        DamageKind::TurnedAboutFirst if dice.below(2) == 0 => {
                            (balls[0], Vector3::z())
                        }
                        DamageKind::TurnedAboutFirst => (balls[0], dice.direction()),
                        DamageKind::Rocked => {
                            // Over two of its balls, or over any line.
                            let from = dice.below(balls.len());
                            let to = (from + 1 + dice.below(balls.len() - 1)) % balls.len();
                            let over = match dice.below(2) {
                                0 => balls[to] - balls[from],
                                _ => level(dice),
                            };
                            (balls[from], over)
                        }
                        _ => {
                            let any = |dice: &mut Dice| dice.between(-200.0, 200.0);
                            let on_table =
                                Vector3::new(any(dice), any(dice), dice.between(0.0, 130.0));
                            (pose.shift + on_table, Vector3::z())
                        }
                    };
                    let axis = Unit::new_normalize(axis);
                    let before = arm(&axis, about, &balls[..turn.min(balls.len())]);
                    if before > 10.0 {
                        break (turn, about, axis, before);
                    }
                };
                let angle = dice.either(size / arm, size / arm);
                Self::Slips {
                    turn,
                    hit: 0,
                    about,
                    turned: Rotation3::from_axis_angle(&axis, angle),
                    shift: Vector3::zeros(),
                }
            }
            DamageKind::MovedBehind => {
                // Behind the first closing ball, or behind all where none closes.
                let turn = upto + dice.below(plan.moving + 1 - upto);
                if dice.below(2) == 0 {
                    return slips(turn, 0);
                }
                let about = plan.places[dice.below(plan.datums)];
                let about = pose.carries(Vector3::from(about), middle);
                Self::Slips {
                    turn,
                    hit: 0,
                    about,
                    turned: Rotation3::new(Vector3::z() * dice.either(size, size) / 300.0),
                    shift: Vector3::zeros(),
                }
            }
            DamageKind::CameBack => {
                let from = dice.below(plan.datums);
                let upto = from + 1 + dice.below(plan.datums - from);
                Self::CameBack(from..upto, way)
            }
            _ => Self::Stands,
        }
    }

    /// Where the part stands at a hit: its ball's number in the order of probing, of so many that
    /// move with it, and its own on the ball.
    pub fn at(
        &self,
        pose: &TruePose,
        middle: Vector3<f64>,
        [turn, of, hit]: [usize; 3],
    ) -> TruePose {
        match self {
            Self::Stands => *pose,
            Self::Drifts(way) => {
                #[allow(clippy::cast_precision_loss, reason = "a handful")]
                let share = turn as f64 / (of - 1) as f64;
                pose.nudged(way * share)
            }
            Self::Slips {
                turn: at,
                hit: first,
                about,
                turned,
                shift,
            } => {
                if (turn, hit) < (*at, *first) {
                    *pose
                } else {
                    pose.turned(*about, *turned, middle).nudged(*shift)
                }
            }
            Self::CameBack(while_probed, way) if while_probed.contains(&turn) => pose.nudged(*way),
            Self::CameBack(..) => *pose,
        }
    }

    /// Where it ends up.
    pub fn end(&self, pose: &TruePose, middle: Vector3<f64>) -> TruePose {
        match self {
            Self::Drifts(way) => pose.nudged(*way),
            _ => self.at(pose, middle, [usize::MAX, 2, usize::MAX]),
        }
    }
}

/// Whether balls in this order are what a job with closing ones asks for: the first is one that
/// is probed again, and all that close come behind all others.
pub fn is_enclosed(job: &Job, turns: &[usize]) -> bool {
    let turn = |place: usize| turns.iter().position(|of| *of == place);
    let last_datum = datums(job).filter_map(|(place, _)| turn(place)).max();
    let behind = closing(job).all(|(place, _)| turn(place) > last_datum);
    let repeats_first = closing(job).any(|(_, closing)| {
        let first = job.features.iter().position(|f| f.name == closing.repeats);
        first.and_then(turn) == Some(0)
    });
    behind && repeats_first
}
