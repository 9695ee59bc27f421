//! The axis values along a run, by dynamic programming over all branches and over the tilt that is allowed.
//!
//! The angle that points the beam exactly is one candidate at each pose; near a pole, where the axis nearest to the part
//! would whirl, every angle of that axis is one as long as the tilt stays allowed. The cheapest row of candidates over
//! the whole run wins: tilt costs, turning costs, and a turn beyond the limit is no way at all.
//!
//! * `aim`: what the axes can point the beam at.
//! * `candidates`: the angles that are asked at each pose.
//! * `chain`: table and head for very many angles.
//! * `smooth`: the steps of their raster are taken out.
//! * `turned`: vectors about one axis.

mod aim;
mod candidates;
mod chain;
mod smooth;
mod turned;

use chain::Turners;
use nalgebra::Vector3;
use umi_kinematics::Pose;
use umi_kinematics::branches::ChainRotation;

use super::super::course::RunPoint;
use super::super::machine::PlanMachine;
use super::super::spec::ScanSpec;
use super::deadline::Deadline;

/// How a run is held: which way round the line lies, and how the beam leans.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stance {
    /// Turned about the beam by 180 degrees: the receiver on the other side.
    pub turned: bool,
    /// Lean of the beam towards the way, in degrees.
    pub lean_along_deg: f64,
    /// Lean of the beam across the way.
    pub lean_across_deg: f64,
    /// Further off than the reference distance; negative: nearer.
    pub shift_mm: f64,
    /// The line lies askew to the way by this, where the spindle turns it and no axis turns the beam.
    pub line_askew_deg: f64,
}

/// Consecutive poses of a run that the axes can follow.
#[derive(Debug, Clone)]
pub struct DrivenRun {
    /// The first point's place in the run.
    pub from: usize,
    /// Axis values, a set for each point.
    pub axes: Vec<Vec<f64>>,
}

/// A run as a stance follows it.
#[derive(Debug, Clone)]
pub struct Followed {
    /// What the axes can follow.
    pub pieces: Vec<DrivenRun>,
    /// And why not the rest.
    pub unreached: Unreached,
    /// How far X Y Z stayed from the ends of their travel in all that was tried; negative: something was beyond.
    room_mm: f64,
}

/// Why points of a run are not reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Unreached {
    /// Points that no angles within the limits point at.
    pub points: usize,
    /// Breaks where the axes would have to turn too far in a step.
    pub breaks: usize,
}

/// Table, head and spindle have so many rotations together at most: a specification with more is refused.
const MOST_ANGLES: usize = 3;

/// Table, head, S; what there is less of them stays at zero. Without a list of its own for each of very many.
type Angles = [f64; MOST_ANGLES];

#[derive(Debug, Clone, Copy)]
struct State {
    angles: Angles,
    cost: f64,
    best: f64,
    parent: usize,
}

/// Of the square of a turn in degrees, against the square of a tilt.
const TURN_WEIGHT: f64 = 0.3;
/// The spindle turns the line alone, with little mass.
const SPINDLE_WEIGHT: f64 = 0.05;
/// Points between two looks at the time.
pub const LOOK_EVERY: usize = 128;

/// Share of the largest turn that is used, so that rounding cannot exceed it.
const TURN_SHARE: f64 = 0.95;

/// An axis without end is looked for this far to either side of its angle nearest to zero. Three turns are enough for a
/// run to wind; each more is as many candidates again.
const TURNS_SOUGHT_DEG: f64 = 540.0;

/// Limits, cut where an axis turns on and on.
fn sought([low, high]: [f64; 2]) -> [f64; 2] {
    let middle = 0.0_f64.max(low).min(high);
    [
        low.max(middle - TURNS_SOUGHT_DEG),
        high.min(middle + TURNS_SOUGHT_DEG),
    ]
}

/// Everything that does not change along a run.
pub struct Driver<'a> {
    spec: &'a ScanSpec,
    machine: &'a PlanMachine,
    /// From the sensor inwards, without a spindle that turns the line alone.
    aiming: Vec<(usize, ChainRotation)>,
    /// Angles of the last of them that are candidates at every pose, where it is the second.
    raster: Vec<RasterAngle>,
    turners: Turners,
    limits: Vec<[f64; 2]>,
    spindle: bool,
    /// Leans that are sought first: they leave room for facets that differ from the smoothed normal.
    wished: Tilt,
    /// Leans that are allowed: what is not reached otherwise takes the whole of it.
    allowed: Tilt,
    turn_deg: f64,
    deadline: Option<Deadline>,
}

/// A largest angle of the beam against the normal.
#[derive(Debug, Clone, Copy)]
struct Tilt {
    deg: f64,
    cos: f64,
}

impl Tilt {
    fn of(deg: f64) -> Self {
        let cos = deg.to_radians().cos();
        Tilt { deg, cos }
    }

    fn holds(self, beam: &Vector3<f64>, normal: &Vector3<f64>) -> bool {
        // An arc tangent only where the cosine is too near to tell.
        let over = -beam.dot(normal) - self.cos;
        over > 1e-9 || (over > -1e-9 && angle_deg(beam, &-normal) <= self.deg + ROUNDING_DEG)
    }
}

/// A surface that leans by just what is allowed is within it: normals are rounded.
const ROUNDING_DEG: f64 = 1e-9;

/// Facets differ from the smoothed normal by about this much.
const FACET_DEG: f64 = 0.6;

/// Share of the tilt that is sought first at least, where it is small.
const WISHED_SHARE: f64 = 0.8;

/// An angle with its sine and cosine, and the axis' pose there.
#[derive(Debug, Clone, Copy)]
struct RasterAngle {
    deg: f64,
    sin: f64,
    cos: f64,
    pose: Pose,
}

impl RasterAngle {
    fn of(turners: &Turners, place: usize, deg: f64) -> Self {
        let (sin, cos) = deg.to_radians().sin_cos();
        let pose = turners.one(place, deg);
        RasterAngle {
            deg,
            sin,
            cos,
            pose,
        }
    }
}

impl<'a> Driver<'a> {
    /// Looks the machine through once.
    pub fn new(spec: &'a ScanSpec) -> Self {
        let machine = &spec.machine;
        let allowed = spec.plan.max_tilt_deg;
        let mut driver = Driver {
            spec,
            machine,
            aiming: machine
                .aiming_joints()
                .into_iter()
                .map(|(place, mut joint)| {
                    joint.limits_deg = sought(joint.limits_deg);
                    (place, joint)
                })
                .collect(),
            raster: Vec::new(),
            turners: Turners::new(machine),
            limits: machine.limits()[3..].to_vec(),
            spindle: machine.line_by_spindle(),
            wished: Tilt::of((allowed - FACET_DEG).max(allowed * WISHED_SHARE)),
            allowed: Tilt::of(allowed),
            turn_deg: spec.plan.max_turn_deg * TURN_SHARE,
            deadline: None,
        };
        if let [_, (place, inner)] = driver.aiming.as_slice() {
            let mut raster = Vec::new();
            driver.each_angle(inner, |b| {
                raster.push(RasterAngle::of(&driver.turners, *place, b));
            });
            driver.raster = raster;
        }
        driver
    }

    /// Runs are followed no longer than this: a late answer is short, and whoever asks looks at the time.
    pub fn until(mut self, deadline: Deadline) -> Self {
        self.deadline = Some(deadline);
        self
    }

    /// Is there time? Asked at every some hundred points.
    pub fn more(&self) -> bool {
        self.deadline.is_none_or(Deadline::more)
    }

    /// Can the line be turned freely about the beam?
    pub fn free_line(&self) -> bool {
        self.spindle
    }

    /// Is a run held otherwise with the line the other way round? Not where it follows from the beam.
    pub fn line_has_sense(&self) -> bool {
        self.spindle || self.aiming.len() > 2
    }

    /// The beam's direction on the part, where no axis turns it.
    pub fn fixed_beam(&self) -> Option<Vector3<f64>> {
        let angles = vec![0.0; self.limits.len()];
        self.aiming
            .is_empty()
            .then(|| self.machine.pointing(&angles).0)
    }

    /// Does a beam lean no more than allowed?
    pub fn within_tilt(&self, beam: &Vector3<f64>, normal: &Vector3<f64>) -> bool {
        self.allowed.holds(beam, normal)
    }

    /// Axis values along a run.
    pub fn follow(&self, points: &[RunPoint], stance: Stance) -> Followed {
        let mut followed = Followed {
            pieces: Vec::new(),
            unreached: Unreached::default(),
            room_mm: f64::INFINITY,
        };
        let mut open: Vec<Vec<State>> = Vec::new();
        let mut from = 0;
        for (k, point) in points.iter().enumerate() {
            if k % LOOK_EVERY == 0 && !self.more() {
                break;
            }
            let mut states = self.states(point, stance, &mut followed.room_mm);
            if states.is_empty() {
                followed.unreached.points += 1;
                self.close(&mut followed, from, &mut open, points, stance);
                continue;
            }
            if let Some(before) = open.last()
                && !self.join(before, &mut states)
            {
                followed.unreached.breaks += 1;
                self.close(&mut followed, from, &mut open, points, stance);
            }
            if open.is_empty() {
                from = k;
                for s in &mut states {
                    s.best = s.cost;
                }
            } else {
                states.retain(|s| s.best.is_finite());
            }
            open.push(states);
        }
        self.close(&mut followed, from, &mut open, points, stance);
        followed
    }

    /// What [`Self::follow`] says of a stance that is another in its distance alone: the same angles, as long as no axis
    /// was or comes near to the end of its travel.
    pub fn shifted(
        &self,
        followed: &Followed,
        points: &[RunPoint],
        from: Stance,
        to: Stance,
    ) -> Option<Followed> {
        let by_mm = (to.shift_mm - from.shift_mm).abs();
        if followed.room_mm <= by_mm + 1e-6 {
            return None;
        }
        let turns = 3..3 + self.limits.len();
        let pieces = followed.pieces.iter().map(|piece| DrivenRun {
            from: piece.from,
            axes: (piece.axes.iter().zip(&points[piece.from..]))
                .map(|(axes, point)| self.with_carriage(&axes[turns.clone()], point, to))
                .collect(),
        });
        Some(Followed {
            pieces: pieces.collect(),
            unreached: followed.unreached,
            room_mm: followed.room_mm - by_mm,
        })
    }

    /// From the surface to the sensor's origin.
    fn off(&self, stance: Stance) -> f64 {
        self.spec.sensor.reference_mm + stance.shift_mm
    }

    /// What a step from one set of angles to another costs; none beyond the largest turn.
    fn step_cost(&self, a: &[f64], b: &[f64]) -> Option<f64> {
        let mut cost = 0.0;
        for (k, (x, y)) in a.iter().zip(b).enumerate() {
            let spindle = self.spindle && k == self.machine.turns();
            let mut d = (y - x).abs();
            // Half a turn and less is the shorter way already.
            if spindle && d > 180.0 {
                d = (d - 360.0 * (d / 360.0).round()).abs();
            }
            if d > self.turn_deg {
                return None;
            }
            cost += d * d * if spindle { SPINDLE_WEIGHT } else { TURN_WEIGHT };
        }
        Some(cost)
    }

    /// Best ways to each state from those before; whether there is any.
    fn join(&self, before: &[State], states: &mut [State]) -> bool {
        let place = self.aiming.last().map(|(place, _)| *place);
        let mut any = false;
        for s in states.iter_mut() {
            let (from, to) = match place {
                Some(p) => (
                    before.partition_point(|b| b.angles[p] < s.angles[p] - self.turn_deg),
                    before.partition_point(|b| b.angles[p] <= s.angles[p] + self.turn_deg),
                ),
                None => (0, before.len()),
            };
            for (k, b) in before.iter().enumerate().take(to).skip(from) {
                // No step is cheaper than none: where that is no better, the step need not be known.
                if b.best + s.cost >= s.best {
                    continue;
                }
                if let Some(step) = self.step_cost(&b.angles, &s.angles) {
                    let cost = b.best + step + s.cost;
                    if cost < s.best {
                        s.best = cost;
                        s.parent = k;
                        any = true;
                    }
                }
            }
        }
        any
    }

    /// Ends a piece: goes back along the cheapest way, smooths it, and brings the spindle within its limits.
    fn close(
        &self,
        followed: &mut Followed,
        from: usize,
        open: &mut Vec<Vec<State>>,
        points: &[RunPoint],
        stance: Stance,
    ) {
        let states = std::mem::take(open);
        let Some(last) = states.last() else { return };
        let Some(mut at) = (0..last.len()).min_by(|a, b| last[*a].best.total_cmp(&last[*b].best))
        else {
            return;
        };
        let mut rows = Vec::with_capacity(states.len());
        for layer in states.iter().rev() {
            rows.push(layer[at].angles[..self.limits.len().min(MOST_ANGLES)].to_vec());
            at = layer[at].parent;
        }
        rows.reverse();
        self.unwind(&mut rows);
        let room = self.smooth_within_limits(&mut rows, &points[from..], stance);
        followed.room_mm = followed.room_mm.min(room);
        let mut start = 0;
        while start < rows.len() {
            let length = self.within_spindle(&mut rows[start..]);
            let axes = rows[start..start + length]
                .iter()
                .zip(&points[from + start..])
                .map(|(angles, point)| self.with_carriage(angles, point, stance))
                .collect();
            followed.pieces.push(DrivenRun {
                from: from + start,
                axes,
            });
            start += length;
        }
    }

    fn with_carriage(&self, angles: &[f64], point: &RunPoint, stance: Stance) -> Vec<f64> {
        // Rounded as the path's file is, so that pose and axes agree to its last digit.
        let angles: Vec<f64> = angles.iter().map(|a| rounded(*a)).collect();
        let beam = self.machine.pointing(&angles).0;
        let x = self
            .machine
            .carriage(&(point.at - beam * self.off(stance)), &angles);
        x.iter()
            .map(|v| rounded(*v))
            .chain(angles.iter().copied())
            .collect()
    }

    /// The spindle runs on without jumps of a whole turn.
    fn unwind(&self, rows: &mut [Vec<f64>]) {
        if !self.spindle {
            return;
        }
        let s = self.machine.turns();
        for k in 1..rows.len() {
            let before = rows[k - 1][s];
            let d = rows[k][s] - before;
            rows[k][s] = before + d - 360.0 * (d / 360.0).round();
        }
    }

    /// Moves the spindle by whole turns so that as many rows as can be lie within its limits; how many.
    fn within_spindle(&self, rows: &mut [Vec<f64>]) -> usize {
        if !self.spindle {
            return rows.len();
        }
        let s = self.machine.turns();
        let [low, high] = self.limits[s];
        let mut best = (0_usize, 0.0_f64);
        for k in -4..=4 {
            let shift = 360.0 * f64::from(k);
            let fits = rows
                .iter()
                .take_while(|r| r[s] + shift >= low && r[s] + shift <= high)
                .count();
            let nearer = (rows[0][s] + shift).abs() < (rows[0][s] + best.1).abs();
            if fits > best.0 || (fits == best.0 && nearer) {
                best = (fits, shift);
            }
        }
        // The first row was within its limits when it was made, so that one row at least fits.
        for r in rows.iter_mut() {
            r[s] += best.1;
        }
        best.0.max(1)
    }
}

/// Nine decimals, as the path's file has them.
pub fn rounded(v: f64) -> f64 {
    let r = (v * 1e9).round() / 1e9;
    // No negative zero in a file.
    r + 0.0
}

/// The angle between two unit vectors.
pub fn angle_deg(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b)).to_degrees()
}
