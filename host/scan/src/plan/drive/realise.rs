//! Runs become passes: poses that meet the part at their stand-off, lean no more than allowed, and touch nothing.

use nalgebra::Vector3;

use super::super::course::{LaserRun, RunPoint};
use super::super::machine::SensorPose;
use super::super::spec::ScanSpec;
use super::axes::{DrivenRun, Driver, Followed, LOOK_EVERY, Stance, angle_deg, rounded};
use super::touch::Scenery;

/// A pass: axis values in the order driven, laser on.
#[derive(Debug, Clone)]
pub struct Pass {
    /// A set of axis values for each pose.
    pub axes: Vec<Vec<f64>>,
    /// The pose of each, on the part.
    pub poses: Vec<SensorPose>,
}

/// Points that are not scanned, by what stands in the way.
#[derive(Debug, Clone, Default)]
pub struct Obstructed {
    /// No angles or no travel.
    pub axis_limit: Vec<Vector3<f64>>,
    /// The box would touch.
    pub collision: Vec<Vector3<f64>>,
    /// Breaks of courses, where the axes would have to turn too far in a step.
    pub breaks: usize,
    /// Passes that touch nothing where they lie, and that no way leads to.
    pub unlinked: usize,
}

impl Obstructed {
    /// Adds what stands in another's way.
    pub fn add(&mut self, other: Obstructed) {
        self.axis_limit.extend(other.axis_limit);
        self.collision.extend(other.collision);
        self.breaks += other.breaks;
        self.unlinked += other.unlinked;
    }
}

/// What is needed at every run.
pub struct Realiser<'a> {
    /// The specification.
    pub spec: &'a ScanSpec,
    /// The machine's ways.
    pub driver: Driver<'a>,
    /// What is touched and what shadows; the part first.
    pub scenery: Scenery<'a>,
    /// Passes shorter than this are left out.
    pub shortest_mm: f64,
}

/// Passes shorter than this are left out, on a part that is not small itself.
const SHORTEST_MM: f64 = 0.5;

/// Share of the stand-off's tolerance that a shift takes.
const SHIFT_SHARE: f64 = 0.9;

/// Between two poses the axes' way is looked at in so many places at least.
const LOOKS: f64 = 3.0;

/// And as close as this.
const LOOK_MM: f64 = 0.5;

/// So many looks at the most: no pass has steps for which they are too few.
const MOST_LOOKS: f64 = 1000.0;

/// Where the axes' way is looked at between two poses whose points lie so far apart, as shares of it.
fn looks(way_mm: f64) -> impl Iterator<Item = f64> {
    let parts = (way_mm / LOOK_MM).ceil().clamp(LOOKS + 1.0, MOST_LOOKS);
    (1..parts as usize).map(move |k| k as f64 / parts)
}

/// All axes move linearly between poses, so that a turn carries the point off its chord: by this share of the stand-off's
/// tolerance at most.
const CHORD_SHARE: f64 = 0.1;

/// Less than this is no matter, whatever the tolerance.
const CHORD_MM: f64 = 0.005;

/// A way between two poses is halved so often at most; the point comes four times as near to its chord by each.
const HALVINGS: u32 = 6;

/// Less is no way out of anything.
const LEAST_SHIFT_MM: f64 = 0.05;

/// The shortest pass of a part: it is small beside the part, too.
pub fn shortest_mm(part: &crate::surface::Mesh) -> f64 {
    let corners = || part.triangles().iter().flat_map(|t| t.corners);
    let across = (0..3).map(|k| {
        let values = || corners().map(|c| c[k]);
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    });
    SHORTEST_MM.min(0.2 * across.fold(0.0, f64::max))
}

impl Realiser<'_> {
    /// Passes along a run; none where nothing of it can be driven.
    ///
    /// Each stance says which stretches it can drive and how much they see; the best stretch of all is taken, then the best
    /// of what is left. A later stance is asked only while the earlier ones leave something.
    ///
    /// `plain`: what [`Driver::follow`] says of the run in the plain stance, with the line askew by as much.
    pub fn passes(
        &self,
        run: &LaserRun,
        line_askew_deg: f64,
        plain: Followed,
        obstructed: &mut Obstructed,
    ) -> Vec<Pass> {
        let mut plain = Some(plain);
        let points = &run.points;
        let mut stretches: Vec<Stretch> = Vec::new();
        let mut collided = false;
        let senses = if self.driver.line_has_sense() { 2 } else { 1 };
        let leant = 5 * senses;
        let stances = self.stances(senses, line_askew_deg);
        // What each lean says at the reference distance.
        let mut unshifted: Vec<Followed> = Vec::new();
        for (number, stance) in stances.iter().copied().enumerate() {
            if !self.driver.more() {
                return Vec::new();
            }
            let nearby = number % leant;
            let shifted = unshifted
                .get(nearby)
                .and_then(|f| self.driver.shifted(f, points, stances[nearby], stance));
            // The plain stance comes first.
            let followed = plain
                .take()
                .or(shifted)
                .unwrap_or_else(|| self.driver.follow(points, stance));
            if number < leant {
                unshifted.push(followed.clone());
            }
            let Followed {
                pieces, unreached, ..
            } = followed;
            if pieces.is_empty() && number == 0 {
                // Leaning widens nothing: the allowed tilt is the same for all stances.
                obstructed.axis_limit.extend(points.iter().map(|p| p.at));
                return Vec::new();
            }
            let before = stretches.len();
            for piece in &pieces {
                collided |= self.stretches(points, piece, number, obstructed, &mut stretches);
            }
            if number == 0 && unreached.points > 0 {
                let driven = |k: usize| {
                    pieces
                        .iter()
                        .any(|p| k >= p.from && k < p.from + p.axes.len())
                };
                let lost = (0..points.len())
                    .filter(|k| !driven(*k))
                    .map(|k| points[k].at);
                obstructed.axis_limit.extend(lost);
            }
            let most = 0.97 * (points.len() - 1) as f64;
            if stretches[before..].iter().any(|s| s.score >= most) {
                break;
            }
            // Where nothing is touched, a lean mends only shadows; a line that follows from the beam is not mended by it.
            let best = stretches.iter().map(|s| s.score).fold(0.0, f64::max);
            let beyond_axes = unreached.points > 0 || (senses == 1 && unreached.breaks > 0);
            if number + 1 == senses && !collided && (beyond_axes || best > 0.85 * most) {
                break;
            }
            // Another distance is for what touches.
            if number + 1 == leant && !collided {
                break;
            }
        }
        let mut free = vec![true; points.len()];
        let mut found = Vec::new();
        // Each turn takes a stretch; a few are enough, what is left then is crumbs.
        for _ in 0..12 {
            let mut best: Option<(f64, usize, usize, usize)> = None;
            for (k, s) in stretches.iter().enumerate() {
                for (from, to) in open_parts(&free, s.from, s.from + s.axes.len()) {
                    let share = (to - from - 1) as f64 / (s.axes.len() - 1) as f64;
                    // A later stance must be clearly better: it leans or turns for it.
                    let score = s.score * share * (1.0 - 0.01 * s.stance.min(30) as f64);
                    if best.is_none_or(|b| score > b.0) {
                        best = Some((score, k, from, to));
                    }
                }
            }
            let Some((score, k, from, to)) = best else {
                break;
            };
            if score < 1e-6 {
                break;
            }
            free[from..to].fill(false);
            let s = &stretches[k];
            let axes = s.axes[from - s.from..to - s.from].to_vec();
            let poses = axes.iter().map(|a| self.spec.machine.forward(a)).collect();
            let mut pass = Pass { axes, poses };
            if pass.length_mm(self.spec) < self.shortest_mm {
                continue;
            }
            if from == 0 {
                self.pivot(&mut pass, &run.borders[0], true);
            }
            if to == points.len() {
                self.pivot(&mut pass, &run.borders[1], false);
            }
            found.push((from, pass));
        }
        found.sort_by_key(|(at, _)| *at);
        let passes = found.into_iter().flat_map(|(_, pass)| self.closer(pass));
        passes
            .filter(|pass| pass.length_mm(self.spec) >= self.shortest_mm)
            .collect()
    }

    /// The pass with poses between its own, until the axes' ways from pose to pose keep to the part; parted where they
    /// cannot.
    fn closer(&self, pass: Pass) -> Vec<Pass> {
        let machine = &self.spec.machine;
        let mut parts: Vec<Vec<Vec<f64>>> = Vec::new();
        for axes in pass.axes {
            match parts.last_mut() {
                Some(part) => match self.between(&part[part.len() - 1], &axes, HALVINGS) {
                    Some(between) => {
                        part.extend(between);
                        part.push(axes);
                    }
                    None => parts.push(vec![axes]),
                },
                None => parts.push(vec![axes]),
            }
        }
        parts.retain(|part| part.len() > 1);
        let pass = |axes: Vec<Vec<f64>>| Pass {
            poses: axes.iter().map(|a| machine.forward(a)).collect(),
            axes,
        };
        parts.into_iter().map(pass).collect()
    }

    /// Axis values between two poses of a pass, with which the way keeps to the part; none where none do.
    fn between(&self, a: &[f64], b: &[f64], halvings: u32) -> Option<Vec<Vec<f64>>> {
        let machine = &self.spec.machine;
        if self.way_keeps(a, b) {
            return Some(Vec::new());
        }
        let middle = self.middle(a, b)?;
        if halvings == 0
            || self.usable(&middle) != Usable::Yes
            || self.scenery.touches_between(machine, a, &middle)
            || self.scenery.touches_between(machine, &middle, b)
        {
            return None;
        }
        let mut all = self.between(a, &middle, halvings - 1)?;
        let rest = self.between(&middle, b, halvings - 1)?;
        all.push(middle);
        all.extend(rest);
        Some(all)
    }

    /// Half way between two poses of a pass in the angles, and in the stand-off.
    fn middle(&self, a: &[f64], b: &[f64]) -> Option<Vec<f64>> {
        let (spec, machine) = (self.spec, &self.spec.machine);
        let part = self.scenery.meshes[0];
        let ends = [machine.forward(a), machine.forward(b)];
        let tips = ends.map(|p| p.origin_mm + p.beam * spec.sensor.reference_mm);
        let mut axes = mixed(a, b, 0.5);
        let beam = machine.pointing(&axes[3..]).0;
        let mut origin = (tips[0] + tips[1]) / 2.0 - beam * spec.sensor.reference_mm;
        let far = spec.sensor.range_mm[1] * 1.5;
        let stands = |origin: &Vector3<f64>, beam: &Vector3<f64>| {
            part.first_hit(origin, beam, far).map(|hit| hit.at)
        };
        let [from, to] = ends.map(|p| stands(&p.origin_mm, &p.beam));
        origin += beam * (stands(&origin, &beam)? - (from? + to?) / 2.0);
        let carriage = machine.carriage(&origin, &axes[3..]);
        axes[..3].copy_from_slice(carriage.as_slice());
        Some(axes.into_iter().map(rounded).collect())
    }

    /// Does the axes' way between two poses of a pass keep the stand-off and the tilt, and the point near its chord? It may be no
    /// longer than a step either: from another distance the points of a curved course lie farther apart than on the part.
    fn way_keeps(&self, a: &[f64], b: &[f64]) -> bool {
        let (plan, reference_mm) = (&self.spec.plan, self.spec.sensor.reference_mm);
        let tip = |p: &SensorPose| p.origin_mm + p.beam * reference_mm;
        let machine = &self.spec.machine;
        let (from, to) = (tip(&machine.forward(a)), tip(&machine.forward(b)));
        let near = (CHORD_SHARE * plan.stand_off_tolerance_mm).max(CHORD_MM);
        let way_mm = (to - from).norm();
        let keeps = |share: f64| {
            let pose = machine.forward(&mixed(a, b, share));
            let far = self.spec.sensor.range_mm[1] * 1.5;
            let hit = self.scenery.meshes[0].first_hit(&pose.origin_mm, &pose.beam, far);
            (tip(&pose) - from.lerp(&to, share)).norm() <= near
                && hit.is_none_or(|hit| {
                    (hit.at - reference_mm).abs() <= plan.stand_off_tolerance_mm * 0.99
                        && self.scenery.tilt_deg(&pose, &hit) <= plan.max_tilt_deg + 1.4
                })
        };
        way_mm <= plan.max_step_mm && looks(way_mm).all(keeps)
    }

    /// Every lean, with the line in one or both senses; then the other distances that are allowed, plain and leant.
    fn stances(&self, senses: usize, line_askew_deg: f64) -> Vec<Stance> {
        let allowed = self.spec.plan.max_tilt_deg;
        let lean = (allowed - 1.5).max(allowed * 0.5);
        let sensor = &self.spec.sensor;
        let shift = SHIFT_SHARE * self.spec.plan.stand_off_tolerance_mm;
        // The middle ray stays within what is measured.
        let away = shift.min(sensor.range_mm[1] - sensor.reference_mm);
        let near = shift.min(sensor.reference_mm - sensor.range_mm[0]);
        let mut stances = Vec::new();
        let leans = [
            (0.0, 0.0),
            (0.0, lean),
            (0.0, -lean),
            (lean, 0.0),
            (-lean, 0.0),
        ];
        let shifted = [away, -near]
            .into_iter()
            .filter(|by| by.abs() > LEAST_SHIFT_MM);
        for (along, across, shift_mm) in std::iter::once(0.0)
            .chain(shifted)
            .flat_map(|by| leans.map(|(along, across)| (along, across, by)))
        {
            for turned in [false, true].into_iter().take(senses) {
                stances.push(Stance {
                    turned,
                    lean_along_deg: along,
                    lean_across_deg: across,
                    shift_mm,
                    line_askew_deg,
                });
            }
        }
        stances
    }

    /// The stretches of a piece that keep everything; whether something is touched.
    fn stretches(
        &self,
        points: &[RunPoint],
        piece: &DrivenRun,
        stance: usize,
        obstructed: &mut Obstructed,
        into: &mut Vec<Stretch>,
    ) -> bool {
        let usable = |(k, axes): (usize, &Vec<f64>)| {
            (k % LOOK_EVERY > 0 || self.driver.more()).then(|| self.usable(axes))
        };
        let states: Vec<Usable> = piece.axes.iter().enumerate().map_while(usable).collect();
        let mut collided = false;
        for (state, point) in states.iter().zip(&points[piece.from..]) {
            collided |= *state == Usable::Touches;
            match state {
                Usable::Touches if stance == 0 => obstructed.collision.push(point.at),
                Usable::Beyond if stance == 0 => obstructed.axis_limit.push(point.at),
                _ => {}
            }
        }
        let mut start = None;
        for k in 0..=states.len() {
            let usable = states.get(k) == Some(&Usable::Yes);
            let goes_on = usable
                && start.is_some()
                && !self.scenery.touches_between(
                    &self.spec.machine,
                    &piece.axes[k - 1],
                    &piece.axes[k],
                );
            if let (Some(s), false) = (start, goes_on) {
                if k - s >= 2 {
                    let axes = piece.axes[s..k].to_vec();
                    into.push(Stretch {
                        stance,
                        from: piece.from + s,
                        score: (k - s - 1) as f64 * self.sees(&axes),
                        axes,
                    });
                }
                start = None;
            }
            if usable && start.is_none() {
                start = Some(k);
            }
        }
        collided
    }

    /// Does a pass meet the part as it should, and touch nothing, on its ways too?
    pub fn drivable(&self, pass: &Pass) -> bool {
        let machine = &self.spec.machine;
        pass.axes
            .iter()
            .all(|axes| self.usable(axes) == Usable::Yes)
            && pass.axes.windows(2).all(|w| {
                self.way_keeps(&w[0], &w[1]) && !self.scenery.touches_between(machine, &w[0], &w[1])
            })
    }

    fn usable(&self, axes: &[f64]) -> Usable {
        if !self.spec.machine.within_limits(axes) {
            return Usable::Beyond;
        }
        let pose = self.spec.machine.forward(axes);
        let sensor = &self.spec.sensor;
        let far = sensor.range_mm[1] * 1.5;
        let part = self.scenery.meshes[0];
        let Some(hit) = part.first_hit(&pose.origin_mm, &pose.beam, far) else {
            return Usable::No;
        };
        let obstacle = self.scenery.meshes[1..]
            .iter()
            .any(|m| m.first_hit(&pose.origin_mm, &pose.beam, hit.at).is_some());
        let tilt = self.scenery.tilt_deg(&pose, &hit);
        if obstacle
            || (hit.at - sensor.reference_mm).abs() > self.spec.plan.stand_off_tolerance_mm * 0.98
            || tilt > self.spec.plan.max_tilt_deg + 1.0
        {
            return Usable::No;
        }
        if self.scenery.touches(&pose) {
            return Usable::Touches;
        }
        Usable::Yes
    }

    /// The share of a few rays of the line that meet the part and are seen by the receiver.
    fn sees(&self, axes: &[Vec<f64>]) -> f64 {
        let sensor = &self.spec.sensor;
        let (mut all, mut seen) = (1e-9, 1e-9);
        let stride = (axes.len() / 12).max(1);
        for set in axes.iter().step_by(stride) {
            let pose = self.spec.machine.forward(set);
            let receiver = receiver(&pose, &sensor.receiver_mm);
            for share in [-0.9, -0.45, 0.0, 0.45, 0.9] {
                let way =
                    pose.beam * sensor.reference_mm + pose.line * (share * sensor.line_mm / 2.0);
                let scale = sensor.range_mm[1] / sensor.reference_mm;
                let Some(hit) = self.scenery.meshes[0].first_hit(&pose.origin_mm, &way, scale)
                else {
                    continue;
                };
                all += 1.0;
                let at = pose.origin_mm + way * hit.at;
                let shadow = self.scenery.meshes[1..]
                    .iter()
                    .any(|m| m.stands_between(&pose.origin_mm, &at, 0.05))
                    || (sensor.receiver_mm != Vector3::zeros()
                        && self
                            .scenery
                            .meshes
                            .iter()
                            .any(|m| m.stands_between(&receiver, &at, 0.05)));
                if !shadow {
                    seen += 1.0;
                }
            }
        }
        seen / all
    }

    /// At a border that runs askew, the line turns about its middle until it lies along the border, so that no corner
    /// is left. The way of the middle ray grows by nothing.
    fn pivot(&self, pass: &mut Pass, border: &Vector3<f64>, at_start: bool) {
        if !self.driver.free_line() {
            return;
        }
        let machine = &self.spec.machine;
        let s = 3 + machine.turns();
        let end = if at_start { 0 } else { pass.axes.len() - 1 };
        let pose = pass.poses[end];
        let Some(e) = (border - pose.beam * pose.beam.dot(border)).try_normalize(1e-6) else {
            return;
        };
        let e = e * if e.dot(&pose.line) < 0.0 { -1.0 } else { 1.0 };
        // Which way the spindle brings the line nearer to the border, the machine says itself.
        let mut nudged = pass.axes[end].clone();
        nudged[s] += 1.0;
        let nearer = machine.pointing(&nudged[3..]).1.dot(&e) > pose.line.dot(&e);
        let angle = angle_deg(&pose.line, &e) * if nearer { 1.0 } else { -1.0 };
        if angle.abs() < 6.0 || angle.abs() > 75.0 {
            return;
        }
        let count = (angle.abs() / (self.spec.plan.max_turn_deg * 0.9)).ceil();
        let base = pass.axes[end].clone();
        let mut before = base.clone();
        let mut added = Vec::new();
        for k in 1..=count as usize {
            let mut axes = base.clone();
            axes[s] += angle * k as f64 / count;
            let beam = machine.pointing(&axes[3..]).0;
            let tip = pose.origin_mm + pose.beam * self.spec.sensor.reference_mm;
            let x = machine.carriage(&(tip - beam * self.spec.sensor.reference_mm), &axes[3..]);
            axes[..3].copy_from_slice(x.as_slice());
            for v in &mut axes {
                *v = rounded(*v);
            }
            if self.usable(&axes) != Usable::Yes
                || self.scenery.touches_between(machine, &before, &axes)
            {
                break;
            }
            before.clone_from(&axes);
            added.push(axes);
        }
        let poses = added.iter().map(|a| machine.forward(a));
        if at_start {
            let mut poses: Vec<_> = poses.collect();
            poses.reverse();
            added.reverse();
            pass.axes.splice(0..0, added);
            pass.poses.splice(0..0, poses);
        } else {
            pass.poses.extend(poses);
            pass.axes.extend(added);
        }
    }
}

/// Consecutive poses that a stance can drive.
struct Stretch {
    stance: usize,
    from: usize,
    axes: Vec<Vec<f64>>,
    score: f64,
}

/// Parts of from..to with nothing taken, of two points at least.
fn open_parts(free: &[bool], from: usize, to: usize) -> Vec<(usize, usize)> {
    let mut parts = Vec::new();
    let mut start = None;
    let closed = std::iter::once(&false);
    for (k, open) in (from..).zip(free[from..to].iter().chain(closed)) {
        match (start, open) {
            (None, true) => start = Some(k),
            (Some(s), false) => {
                if k - s >= 2 {
                    parts.push((s, k));
                }
                start = None;
            }
            _ => {}
        }
    }
    parts
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Usable {
    Yes,
    No,
    /// An axis would leave its limits.
    Beyond,
    Touches,
}

/// On the way of the axes from one set to another.
fn mixed(a: &[f64], b: &[f64], share: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(x, y)| x + (y - x) * share).collect()
}

/// Where the receiver stands.
pub fn receiver(pose: &SensorPose, place: &Vector3<f64>) -> Vector3<f64> {
    pose.origin_mm + pose.line * place.x + pose.feed() * place.y + pose.beam * place.z
}

impl Pass {
    /// Poses on the axes' way from one of its poses to the next.
    pub fn between(&self, spec: &ScanSpec, pose: usize) -> Vec<SensorPose> {
        let [Some(a), Some(b)] = [pose, pose + 1].map(|k| self.axes.get(k)) else {
            return Vec::new();
        };
        let tip = |p: &SensorPose| p.origin_mm + p.beam * spec.sensor.reference_mm;
        let way_mm = (tip(&self.poses[pose + 1]) - tip(&self.poses[pose])).norm();
        looks(way_mm)
            .map(|share| spec.machine.forward(&mixed(a, b, share)))
            .collect()
    }

    /// Way of the point at the reference distance.
    pub fn length_mm(&self, spec: &ScanSpec) -> f64 {
        let tip = |p: &SensorPose| p.origin_mm + p.beam * spec.sensor.reference_mm;
        self.poses
            .windows(2)
            .map(|w| (tip(&w[1]) - tip(&w[0])).norm())
            .sum()
    }

    /// The other way round.
    pub fn reverse(&mut self) {
        self.axes.reverse();
        self.poses.reverse();
    }
}

#[cfg(test)]
mod tests {
    use super::{LOOK_MM, looks};

    #[test]
    fn a_long_way_is_looked_at_as_closely_as_a_short_one() {
        assert_eq!(looks(0.3).collect::<Vec<_>>(), [0.25, 0.5, 0.75]);
        assert_eq!(looks(2.0).count(), 3);
        assert_eq!(looks(7.66).count(), 15);
        let between = looks(7.66).collect::<Vec<_>>();
        assert!(between.windows(2).all(|w| (w[1] - w[0]) * 7.66 <= LOOK_MM));
    }
}
