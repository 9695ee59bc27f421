//! Collisions of the axes with bodies.

use nalgebra::Vector3;

use super::{Spindle, VirtualMachine, Wires};
use crate::nc::Trip;
use crate::scene::Body;

/// The balls of a stem are this share of their radius apart: the row is then less than
/// 1 % thinner between them than the stem is.
const STEM_PITCH: f64 = 0.25;
/// Most balls of a stem.
const STEM_BALLS: f64 = 2000.0;

/// Where the axes are stopped.
pub(super) struct Stop {
    /// Number of the line on the chain.
    pub line: usize,
    /// Share of this line.
    pub share: f64,
    pub trip: Trip,
}

impl<W: Wires> VirtualMachine<W> {
    /// The first collision on the way through these encoder positions.
    ///
    /// A tool that turns passes through `cuttable` bodies, at feed and at rapid: what is
    /// left of the material is known to the [`Cutter`](crate::cutting::Cutter), which
    /// judges rapid motions through it. A tool that stands still collides with them.
    ///
    /// `turned`: the rotary axes at each of them; nothing where all are at 0. A ball is the same from
    /// all sides, so bodies that turn with the table are met in the table's own frame.
    pub(super) fn collision(&self, chain: &[Vector3<f64>], turned: &[Vec<f64>]) -> Option<Stop> {
        let tool = matches!(self.spindle, Spindle::Tool(_));
        let cutting = tool && self.turns;
        let counts = |body: &Body| !(cutting && body.cuttable);
        let what = match self.spindle {
            Spindle::Probe => "the probe",
            Spindle::Sensor => "the sensor",
            Spindle::Empty | Spindle::Tool(_) => "the tool",
        };
        let mut first: Option<Stop> = None;
        let stem = self.stem().into_iter().map(|ball| (ball, self.stem_name()));
        for ((down, radius), what) in self.ball().map(|ball| (ball, what)).into_iter().chain(stem) {
            let carriage = (!turned.is_empty()).then(|| self.carriage_of(down));
            let place = |(number, at): (usize, &Vector3<f64>)| {
                let at = at + self.truth(at);
                match (&carriage, turned.get(number)) {
                    (Some(carriage), Some(deg)) => carriage.on_table(&at, deg),
                    _ => at + down,
                }
            };
            let way: Vec<Vector3<f64>> = chain.iter().enumerate().map(place).collect();
            for body in self.scene.bodies().iter().filter(|body| counts(body)) {
                let Some(hit) = body.first_collision(&way, radius) else {
                    continue;
                };
                let share = share(&way, hit.line, hit.way_mm);
                let later = |s: &Stop| (s.line, s.share) <= (hit.line, share);
                if first.as_ref().is_some_and(later) {
                    continue;
                }
                let message = if hit.further {
                    format!(
                        "{what} touches {} and the motion bends it further; move away from the body first",
                        body.name
                    )
                } else {
                    let [x, y, z] = between(chain, hit.line, share).into();
                    let why = if tool && body.cuttable {
                        "; the spindle stands still: M3 or M4 with an S above 0 comes first"
                    } else {
                        " in a motion without skip"
                    };
                    format!(
                        "collision: {what} ran into {} at X{x:.3} Y{y:.3} Z{z:.3} (machine coordinates){why}",
                        body.name
                    )
                };
                first = Some(Stop {
                    line: hit.line,
                    share,
                    trip: Trip { message },
                });
            }
        }
        first
    }

    /// Where the stem of the probe touches on a straight way with skip: share of it.
    pub(super) fn stem_collision(
        &self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
    ) -> Option<(f64, Trip)> {
        let mut first: Option<(f64, Trip)> = None;
        for (down, radius) in self.stem() {
            let way = [from, to].map(|at| at + self.truth(at) + down);
            for body in self.scene.bodies() {
                let Some(hit) = body.first_collision(&way, radius) else {
                    continue;
                };
                let share = share(&way, hit.line, hit.way_mm);
                if first.as_ref().is_none_or(|(before, _)| share < *before) {
                    let message = format!(
                        "collision: {} ran into {}; come from where it is clear of the body",
                        self.stem_name(),
                        body.name
                    );
                    first = Some((share, Trip { message }));
                }
            }
        }
        first
    }

    fn stem_name(&self) -> &'static str {
        if self.spindle == Spindle::Sensor {
            "the housing of the sensor"
        } else {
            "the stem of the probe"
        }
    }

    /// The stem as a row of balls, from the gauge line to their centres and their radius.
    pub(super) fn stem(&self) -> Vec<(Vector3<f64>, f64)> {
        if let (Spindle::Sensor, Some(sensing)) = (self.spindle, &self.sensing) {
            return sensing.housing().to_vec();
        }
        let probe = &self.scene.probe;
        let radius = probe.stem_radius_mm;
        if self.spindle != Spindle::Probe || radius <= 0.0 {
            return Vec::new();
        }
        let count = libm::ceil(probe.stem_length_mm / (STEM_PITCH * radius)).min(STEM_BALLS);
        let pitch = probe.stem_length_mm / count;
        let mut balls = Vec::new();
        let mut up = 0.0;
        while up <= count {
            let z = up * pitch - probe.length_mm;
            balls.push((Vector3::new(0.0, 0.0, z), radius));
            up += 1.0;
        }
        balls
    }
}

/// A place on a chain.
pub(super) fn between(chain: &[Vector3<f64>], line: usize, share: f64) -> Vector3<f64> {
    match (chain.get(line), chain.get(line + 1)) {
        (Some(from), Some(to)) => from + (to - from) * share,
        (from, _) => from.copied().unwrap_or_default(),
    }
}

/// Places on a chain, one after the other.
pub(super) struct Along<'a> {
    chain: &'a [Vector3<f64>],
    line: usize,
    /// Way up to the line.
    before_mm: f64,
}

impl<'a> Along<'a> {
    pub fn new(chain: &'a [Vector3<f64>]) -> Self {
        Self {
            chain,
            line: 0,
            before_mm: 0.0,
        }
    }

    /// The place after this way, which is not less than the one asked for before.
    pub fn at(&mut self, way_mm: f64) -> Vector3<f64> {
        while let (Some(from), Some(to)) =
            (self.chain.get(self.line), self.chain.get(self.line + 1))
        {
            let length = (to - from).norm();
            if self.before_mm + length >= way_mm {
                break;
            }
            self.before_mm += length;
            self.line += 1;
        }
        let share = share(self.chain, self.line, way_mm - self.before_mm);
        between(self.chain, self.line, share)
    }
}

fn share(way: &[Vector3<f64>], line: usize, way_mm: f64) -> f64 {
    let length = match (way.get(line), way.get(line + 1)) {
        (Some(from), Some(to)) => (to - from).norm(),
        _ => 0.0,
    };
    if length > 0.0 { way_mm / length } else { 0.0 }
}
