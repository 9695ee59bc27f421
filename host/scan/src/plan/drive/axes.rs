//! The axis values along a run, by dynamic programming over all branches and over the tilt that is allowed.
//!
//! The angle that points the beam exactly is one candidate at each pose; near a pole, where the axis nearest to the part
//! would whirl, every angle of that axis is one as long as the tilt stays allowed. The cheapest row of candidates over
//! the whole run wins: tilt costs, turning costs, and a turn beyond the limit is no way at all.

use nalgebra::Vector3;
use umi_kinematics::branches::{self, Aim, ChainRotation};

use super::super::course::RunPoint;
use super::super::machine::{PlanMachine, SensorPose};
use super::super::map::flatten::across;
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

#[derive(Debug, Clone)]
struct State {
    /// Table, head, S.
    angles: Vec<f64>,
    cost: f64,
    best: f64,
    parent: usize,
}

/// Of the square of a turn in degrees, against the square of a tilt.
const TURN_WEIGHT: f64 = 0.3;
/// The spindle turns the line alone, with little mass.
const SPINDLE_WEIGHT: f64 = 0.05;
/// Of the share of the line that does not lie across the way, against the square of a tilt in degrees: a strip that is
/// narrower by a fiftieth is worth a lean of 9 degrees.
const LINE_WEIGHT: f64 = 4000.0;
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
    limits: Vec<[f64; 2]>,
    spindle: bool,
    tilt_deg: f64,
    turn_deg: f64,
    deadline: Option<Deadline>,
}

/// An angle with its sine and cosine.
#[derive(Debug, Clone, Copy)]
struct RasterAngle {
    deg: f64,
    sin: f64,
    cos: f64,
}

impl RasterAngle {
    fn of(deg: f64) -> Self {
        let (sin, cos) = deg.to_radians().sin_cos();
        RasterAngle { deg, sin, cos }
    }
}

impl<'a> Driver<'a> {
    /// Looks the machine through once.
    pub fn new(spec: &'a ScanSpec) -> Self {
        let machine = &spec.machine;
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
            limits: machine.limits()[3..].to_vec(),
            spindle: machine.line_by_spindle(),
            // Facets differ from the smoothed normal by about this much.
            tilt_deg: (spec.plan.max_tilt_deg - 0.6).max(spec.plan.max_tilt_deg * 0.8),
            turn_deg: spec.plan.max_turn_deg * TURN_SHARE,
            deadline: None,
        };
        if let [_, (_, inner)] = driver.aiming.as_slice() {
            let mut raster = Vec::new();
            driver.each_angle(inner, |b| raster.push(RasterAngle::of(b)));
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

    /// Is a beam near enough to the normal?
    pub fn within_tilt(&self, beam: &Vector3<f64>, normal: &Vector3<f64>) -> bool {
        angle_deg(beam, &-normal) <= self.tilt_deg
    }

    /// Angles within their limits that bring the beam against a normal, as near as the axes can; the spindle at zero.
    fn aimed(&self, normal: &Vector3<f64>) -> Vec<Vec<f64>> {
        let zero = vec![0.0; self.limits.len()];
        let beam = self.machine.part_direction(&-normal);
        let mounted = self.machine.mounted().0;
        match self.aiming.as_slice() {
            [] => vec![zero],
            [(place, turn)] => {
                let mut angles = zero;
                let best = best_about(&turn.direction, &beam, &mounted).unwrap_or(0.0);
                angles[*place] = within_or_limit(best, turn.limits_deg);
                vec![angles]
            }
            aiming => {
                let turns: Vec<ChainRotation> = aiming.iter().map(|(_, t)| t.clone()).collect();
                let aim = Aim {
                    beam: (beam, mounted),
                    line: None,
                };
                let within = |set: &Vec<f64>| {
                    let mut angles = zero.clone();
                    for ((place, turn), angle) in aiming.iter().zip(set) {
                        angles[*place] = branches::nearest_turn(*angle, turn.limits_deg, 0.0)?;
                    }
                    Some(angles)
                };
                // Beyond a limit the axis stands at it, and the other one does what it can.
                let at_limits = |set: &Vec<f64>| match aiming {
                    [(first, outer), (second, inner)] => {
                        let mut angles = zero.clone();
                        let b = within_or_limit(set[1], inner.limits_deg);
                        let v = turned(&inner.direction, b, &beam);
                        let a = best_about(&outer.direction, &v, &mounted).unwrap_or(0.0);
                        angles[*first] = within_or_limit(a, outer.limits_deg);
                        angles[*second] = b;
                        Some(angles)
                    }
                    _ => None,
                };
                let found = branches::aim(&turns, &aim).branches;
                let near = |set| within(set).or_else(|| at_limits(set));
                found.iter().filter_map(near).collect()
            }
        }
    }

    /// The line's direction where the beam is against this normal as well as the axes can, one for each branch; none where
    /// two axes do not reach it. For machines whose line follows from the beam.
    pub fn lines_for(&self, normal: &Vector3<f64>) -> Vec<Vector3<f64>> {
        self.lines_near(normal, normal)
    }

    /// The line's direction where the beam is against `aimed_at`, within the tilt of a normal where two axes turn it.
    fn lines_near(&self, aimed_at: &Vector3<f64>, normal: &Vector3<f64>) -> Vec<Vector3<f64>> {
        let pointed = self.aimed(aimed_at).into_iter();
        let pointed = pointed.map(|angles| self.machine.pointing(&angles));
        pointed
            .filter(|(beam, _)| self.aiming.len() < 2 || self.within_tilt(beam, normal))
            .map(|(_, line)| line)
            .collect()
    }

    /// The same for every beam that leans no more than allowed: a ring of leans stands for all.
    pub fn lines_within_tilt(&self, normal: &Vector3<f64>) -> Vec<Vector3<f64>> {
        let mut lines = self.lines_for(normal);
        if self.aiming.len() == 2 {
            for leant in self.leans(normal) {
                lines.extend(self.lines_near(&leant, normal));
            }
        }
        lines
    }

    /// Normals around one, leant by nearly as much as is allowed: the way along a course must have room, too.
    fn leans(&self, normal: &Vector3<f64>) -> impl Iterator<Item = Vector3<f64>> {
        const AROUND: usize = 12;
        let (x, y) = across(normal);
        let (normal, lean) = (*normal, (0.9 * self.tilt_deg).to_radians().tan());
        (0..AROUND).map(move |k| {
            let (s, c) = (std::f64::consts::TAU * k as f64 / AROUND as f64).sin_cos();
            (normal + (x * c + y * s) * lean).normalize()
        })
    }

    /// Can the axes point the beam at a surface with this normal within the tilt? X, Y, Z are not asked.
    pub fn reaches(&self, normal: &Vector3<f64>) -> bool {
        let near = |aimed_at: &Vector3<f64>| {
            let beams = self.aimed(aimed_at);
            beams
                .iter()
                .any(|a| self.within_tilt(&self.machine.pointing(a).0, normal))
        };
        near(normal) || (self.aiming.len() > 1 && self.leans(normal).any(|n| near(&n)))
    }

    /// Poses that meet a point of the surface within tilt, limits and travel: against its normal and leant around it.
    pub fn stands(&self, at: &Vector3<f64>, normal: &Vector3<f64>) -> Vec<SensorPose> {
        let leant = self.leans(normal).filter(|_| !self.aiming.is_empty());
        let aimed = std::iter::once(*normal).chain(leant);
        let sets = aimed.flat_map(|n| self.aimed(&n));
        let pose = |mut angles: Vec<f64>| {
            if let (Some(s), Some([low, high])) = (
                angles.get_mut(self.machine.turns()),
                self.machine.orient_deg,
            ) {
                *s = 0.0_f64.max(low).min(high);
            }
            let (beam, line) = self.machine.pointing(&angles);
            let origin_mm = at - beam * self.spec.sensor.reference_mm;
            let mut axes = self
                .machine
                .carriage(&origin_mm, &angles)
                .as_slice()
                .to_vec();
            axes.extend(angles);
            let stands = self.within_tilt(&beam, normal) && self.machine.within_limits(&axes);
            stands.then_some(SensorPose {
                origin_mm,
                beam,
                line,
            })
        };
        sets.filter_map(pose).collect()
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

    /// Candidates at a point: angles that keep the tilt and the limits.
    fn states(&self, point: &RunPoint, stance: Stance, room_mm: &mut f64) -> Vec<State> {
        let across = point.along.cross(&point.normal);
        let lean = point.along * stance.lean_along_deg.to_radians().tan()
            + across * stance.lean_across_deg.to_radians().tan();
        let beam = -(point.normal + lean).normalize();
        let line = (point.along.cross(&beam)).normalize() * if stance.turned { -1.0 } else { 1.0 };
        let line = turned(&beam, stance.line_askew_deg, &line);
        let mut angles_found: Vec<Vec<f64>> = Vec::new();
        let count = self.limits.len();
        if !self.spindle && self.aiming.len() > 2 {
            // Three rotations hold beam and line exactly. What is beyond the travel is not among them.
            *room_mm = 0.0;
            if let Ok(reached) =
                self.machine
                    .inverse(&(point.at - beam * self.off(stance)), &beam, Some(&line))
            {
                angles_found.extend(reached.solutions.iter().map(|axes| axes[3..].to_vec()));
            }
        } else {
            let u = self.machine.part_direction(&beam);
            let w = self.machine.mounted().0;
            match self.aiming.as_slice() {
                [] => angles_found.push(vec![0.0; count]),
                [(place, turn)] => {
                    let mut angles = vec![0.0; count];
                    match best_about(&turn.direction, &u, &w) {
                        Some(a) => {
                            angles[*place] = within_or_limit(a, turn.limits_deg);
                            angles_found.push(angles);
                        }
                        None => self.each_angle(turn, |a| {
                            angles[*place] = a;
                            angles_found.push(angles.clone());
                        }),
                    }
                }
                [(first, outer), (second, inner), ..] => {
                    let at_sensor = outer.direction.dot(&w).clamp(-1.0, 1.0).acos();
                    let room = self.tilt_deg
                        + stance.lean_along_deg.abs()
                        + stance.lean_across_deg.abs()
                        + 0.01;
                    // However the outer axis turns, the beam stays off by what its angle to that axis is off by.
                    let within = |deg: f64| deg.to_radians().clamp(0.0, std::f64::consts::PI).cos();
                    let least = within(at_sensor.to_degrees() + room);
                    let most = within(at_sensor.to_degrees() - room);
                    let (on_axis, off_axis) = {
                        let on = inner.direction * inner.direction.dot(&u);
                        (on, u - on)
                    };
                    let aside = inner.direction.cross(&u);
                    let [still, by_cos, by_sin] =
                        [on_axis, off_axis, aside].map(|part| outer.direction.dot(&part));
                    let mut add = |b: RasterAngle| {
                        let along_outer = still + by_cos * b.cos + by_sin * b.sin;
                        if along_outer < least - 1e-12 || along_outer > most + 1e-12 {
                            return;
                        }
                        let v = on_axis + off_axis * b.cos + aside * b.sin;
                        let a = best_about(&outer.direction, &v, &w).unwrap_or(0.0);
                        let mut angles = vec![0.0; count];
                        // At its limit the beam may still be within the tilt.
                        angles[*first] = within_or_limit(a, outer.limits_deg);
                        angles[*second] = b.deg;
                        angles_found.push(angles);
                    };
                    self.raster.iter().copied().for_each(&mut add);
                    let exact = branches::aim(
                        &[outer.clone(), inner.clone()],
                        &Aim {
                            beam: (u, w),
                            line: None,
                        },
                    );
                    for set in exact.branches {
                        add(RasterAngle::of(set[1]));
                    }
                }
            }
        }
        let mut states = Vec::new();
        for mut angles in angles_found {
            // Whole turns point the same way and cost the same.
            if let Some(cost) = self.complete(&mut angles, point, stance, [&beam, &line], room_mm) {
                self.whole_turns(angles, |angles| {
                    states.push(State {
                        angles,
                        cost,
                        best: f64::INFINITY,
                        parent: 0,
                    });
                });
            }
        }
        if let Some((place, _)) = self.aiming.last() {
            states.sort_by(|a, b| a.angles[*place].total_cmp(&b.angles[*place]));
        }
        states
    }

    /// Angles of a joint in steps well below the largest turn.
    fn each_angle(&self, joint: &ChainRotation, mut each: impl FnMut(f64)) {
        let [low, high] = joint.limits_deg;
        // Whole turns repeat the same pointing; they are added behind.
        let high = high.min(low + 360.0);
        let step = (self.turn_deg / 2.5).clamp(0.25, 2.0);
        let count = ((high - low) / step).ceil().max(1.0) as usize;
        for k in 0..=count {
            each(low + (high - low) * k as f64 / count as f64);
        }
    }

    /// The same pointing by whole turns of each aiming joint, within the limits.
    fn whole_turns(&self, angles: Vec<f64>, mut each: impl FnMut(Vec<f64>)) {
        let turns = |angle: f64, [low, high]: [f64; 2]| {
            let first = ((low - 1e-9 - angle) / 360.0).ceil();
            let last = ((high + 1e-9 - angle) / 360.0).floor();
            (first, last)
        };
        let mut sets = vec![angles];
        for (place, turn) in &self.aiming {
            // Nearly always the angle stands alone, within its limits.
            if sets
                .iter()
                .all(|set| turns(set[*place], turn.limits_deg) == (0.0, 0.0))
            {
                for set in &mut sets {
                    set[*place] = set[*place].clamp(turn.limits_deg[0], turn.limits_deg[1]);
                }
                continue;
            }
            let mut more = Vec::new();
            for set in &sets {
                let (mut k, last) = turns(set[*place], turn.limits_deg);
                while k <= last && more.len() < 64 {
                    let mut other = set.clone();
                    other[*place] =
                        (set[*place] + 360.0 * k).clamp(turn.limits_deg[0], turn.limits_deg[1]);
                    more.push(other);
                    k += 1.0;
                }
            }
            sets = more;
        }
        for set in sets {
            each(set);
        }
    }

    /// Puts the spindle's angle in; the cost, or none where the tilt or the travel is exceeded.
    fn complete(
        &self,
        angles: &mut [f64],
        point: &RunPoint,
        stance: Stance,
        [wanted, line]: [&Vector3<f64>; 2],
        room_mm: &mut f64,
    ) -> Option<f64> {
        let stand = self.machine.stand(angles);
        let (beam, zero_line) = (stand.beam(), stand.line());
        let tilt = angle_deg(&beam, &-point.normal);
        if tilt > self.tilt_deg {
            return None;
        }
        let off = angle_deg(&beam, wanted);
        let mut cost = off * off;
        let line_here = (line - beam * beam.dot(line)).try_normalize(1e-9)?;
        if self.spindle {
            let sense = self.machine.mounted().0.z.signum();
            let about = beam * sense;
            let s = line_here
                .dot(&about.cross(&zero_line))
                .atan2(line_here.dot(&zero_line))
                .to_degrees();
            let limits = self.limits[self.machine.turns()];
            let s = umi_kinematics::branches::nearest_turn(s, limits, 0.0)?;
            angles[self.machine.turns()] = s;
        } else {
            let share = zero_line.dot(&line_here).abs();
            if share < 0.5 {
                return None;
            }
            cost += LINE_WEIGHT * (1.0 - share);
        }
        let x = if self.spindle {
            // The spindle carries the sensor's origin about.
            self.machine
                .carriage(&(point.at - beam * self.off(stance)), angles)
        } else {
            stand.carriage(&(point.at - beam * self.off(stance)))
        };
        let room = self.room_mm(x.as_slice());
        *room_mm = room_mm.min(room);
        (room >= 0.0).then_some(cost)
    }

    /// How far X Y Z are from the ends of their travel; negative: beyond.
    fn room_mm(&self, axes: &[f64]) -> f64 {
        let each = axes.iter().zip(&self.machine.travel_mm);
        each.map(|(v, [low, high])| (v - low).min(high - v))
            .fold(f64::INFINITY, f64::min)
    }

    /// What a step from one set of angles to another costs; none beyond the largest turn.
    fn step_cost(&self, a: &[f64], b: &[f64]) -> Option<f64> {
        let mut cost = 0.0;
        for (k, (x, y)) in a.iter().zip(b).enumerate() {
            let spindle = self.spindle && k == self.machine.turns();
            let mut d = (y - x).abs();
            if spindle {
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
            rows.push(layer[at].angles.clone());
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

    /// Smooths as much as the largest turn and the travel allow.
    ///
    /// Smoothing moves the beam, and the line is laid across the way again behind it: where that turns fast, as on a
    /// fillet that is gone along askew, the spindle's steps can grow beyond those that the search has kept. And where the
    /// beam leans otherwise, X Y Z stand elsewhere. How far they stayed from the ends of their travel.
    pub(super) fn smooth_within_limits(
        &self,
        rows: &mut Vec<Vec<f64>>,
        points: &[RunPoint],
        stance: Stance,
    ) -> f64 {
        let room_mm = |rows: &[Vec<f64>]| {
            let each = rows.iter().zip(points);
            each.map(|(angles, point)| {
                self.room_mm(&self.with_carriage(angles, point, stance)[..3])
            })
            .fold(f64::INFINITY, f64::min)
        };
        let mut least = f64::INFINITY;
        for rounds in [30, 10, 3] {
            let mut tried = rows.clone();
            self.smooth(&mut tried, points, rounds);
            let kept = tried.windows(2).all(|w| {
                w[0].iter()
                    .zip(&w[1])
                    .all(|(a, b)| (b - a).abs() <= self.turn_deg + 1e-9)
            });
            if kept {
                let room = room_mm(&tried);
                least = least.min(room);
                // By a billionth, as the machine's limits are kept.
                if room >= -1e-9 {
                    *rows = tried;
                    break;
                }
            }
        }
        least
    }

    /// Takes the steps of the candidates' raster out: each angle moves towards its neighbours' mean where that costs less.
    fn smooth(&self, rows: &mut [Vec<f64>], points: &[RunPoint], rounds: usize) {
        if self.aiming.is_empty() || (!self.spindle && self.aiming.len() > 2) || rows.len() < 3 {
            return;
        }
        let tilt = |angles: &[f64], k: usize| {
            angle_deg(&self.machine.pointing(angles).0, &-points[k].normal)
        };
        let rough = rows.windows(3).any(|w| {
            self.aiming
                .iter()
                .any(|(p, _)| (w[0][*p] - 2.0 * w[1][*p] + w[2][*p]).abs() > 0.8)
        });
        if !rough {
            return;
        }
        for _ in 0..rounds {
            for k in 0..rows.len() {
                for (p, turn) in &self.aiming {
                    let mean = match (k.checked_sub(1), k + 1 < rows.len()) {
                        (Some(b), true) => (rows[b][*p] + rows[k + 1][*p]) / 2.0,
                        _ => continue,
                    };
                    let mut tried = rows[k].clone();
                    tried[*p] = (rows[k][*p] + 0.5 * (mean - rows[k][*p]))
                        .clamp(turn.limits_deg[0], turn.limits_deg[1]);
                    if tilt(&tried, k) <= self.tilt_deg {
                        rows[k] = tried;
                    }
                }
            }
        }
        if !self.spindle {
            return;
        }
        // The line again, which follows from the beam's angles.
        let s = self.machine.turns();
        for (row, point) in rows.iter_mut().zip(points) {
            let held = row[s];
            let (beam, line_held) = self.machine.pointing(row);
            let square = point.along.cross(&beam);
            if let Some(square) = square.try_normalize(1e-9) {
                let square = square * square.dot(&line_held).signum();
                let about = beam * self.machine.mounted().0.z.signum();
                row[s] = held
                    + square
                        .dot(&about.cross(&line_held))
                        .atan2(square.dot(&line_held))
                        .to_degrees();
            }
        }
        self.unwind(rows);
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

/// An angle by whole turns within its limits, the one nearest to zero; else the limit that it is nearer to.
fn within_or_limit(angle: f64, limits: [f64; 2]) -> f64 {
    branches::nearest_turn(angle, limits, 0.0).unwrap_or_else(|| {
        let off = |limit: f64| {
            let by = angle - limit;
            (by - 360.0 * (by / 360.0).round()).abs()
        };
        let [low, high] = limits;
        if off(low) <= off(high) { low } else { high }
    })
}

/// Degrees about `axis` that bring v as near to w as can be; none where v lies on the axis.
fn best_about(axis: &Vector3<f64>, v: &Vector3<f64>, w: &Vector3<f64>) -> Option<f64> {
    let a = v - axis * axis.dot(v);
    let b = w - axis * axis.dot(w);
    if a.norm() < 1e-9 || b.norm() < 1e-9 {
        return None;
    }
    Some(axis.dot(&a.cross(&b)).atan2(a.dot(&b)).to_degrees())
}

/// A vector turned about an axis (Rodrigues).
fn turned(axis: &Vector3<f64>, degrees: f64, v: &Vector3<f64>) -> Vector3<f64> {
    let (s, c) = degrees.to_radians().sin_cos();
    v * c + axis.cross(v) * s + axis * (axis.dot(v) * (1.0 - c))
}
