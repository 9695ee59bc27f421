//! The angles that are asked at each pose of a run.

use nalgebra::Vector3;
use umi_kinematics::Pose;
use umi_kinematics::branches::{self, Aim, ChainRotation};

use super::super::super::course::RunPoint;
use super::chain::Standing;
use super::turned::{Onto, best_about, turned, within_or_limit};
use super::{Angles, Driver, MOST_ANGLES, RasterAngle, Stance, State, angle_deg};

/// Of the share of the line that does not lie across the way, against the square of a tilt in degrees: a strip that is
/// narrower by a fiftieth is worth a lean of 9 degrees.
const LINE_WEIGHT: f64 = 4000.0;

/// Angles that are asked at a point, and the pose of an axis there that is known already.
type Asked = (Angles, Option<(usize, Pose)>);

impl Driver<'_> {
    /// Candidates at a point: angles that keep the tilt and the limits.
    pub(super) fn states(&self, point: &RunPoint, stance: Stance, room_mm: &mut f64) -> Vec<State> {
        let across = point.along.cross(&point.normal);
        let lean = point.along * stance.lean_along_deg.to_radians().tan()
            + across * stance.lean_across_deg.to_radians().tan();
        let beam = -(point.normal + lean).normalize();
        let line = (point.along.cross(&beam)).normalize() * if stance.turned { -1.0 } else { 1.0 };
        let line = turned(&beam, stance.line_askew_deg, &line);
        let mut asked: Vec<Asked> = Vec::new();
        let none: Angles = [0.0; MOST_ANGLES];
        if !self.spindle && self.aiming.len() > 2 {
            // Three rotations hold beam and line exactly. What is beyond the travel is not among them.
            *room_mm = 0.0;
            if let Ok(reached) =
                self.machine
                    .inverse(&(point.at - beam * self.off(stance)), &beam, Some(&line))
            {
                asked.extend(reached.solutions.iter().map(|axes| {
                    let mut angles = none;
                    angles.iter_mut().zip(&axes[3..]).for_each(|(a, v)| *a = *v);
                    (angles, None)
                }));
            }
        } else {
            let u = self.machine.part_direction(&beam);
            let w = self.machine.mounted().0;
            match self.aiming.as_slice() {
                [] => asked.push((none, None)),
                [(place, turn)] => {
                    let mut angles = none;
                    match best_about(&turn.direction, &u, &w) {
                        Some(a) => {
                            angles[*place] = within_or_limit(a, turn.limits_deg);
                            asked.push((angles, None));
                        }
                        None => self.each_angle(turn, |a| {
                            angles[*place] = a;
                            asked.push((angles, None));
                        }),
                    }
                }
                [(first, outer), (second, inner), ..] => {
                    let at_sensor = outer.direction.dot(&w).clamp(-1.0, 1.0).acos();
                    let room = self.allowed.deg
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
                    let onto = Onto::new(&outer.direction, &w);
                    let mut add = |b: &RasterAngle| {
                        let along_outer = still + by_cos * b.cos + by_sin * b.sin;
                        if along_outer < least - 1e-12 || along_outer > most + 1e-12 {
                            return;
                        }
                        let v = on_axis + off_axis * b.cos + aside * b.sin;
                        let a = onto.degrees(&v).unwrap_or(0.0);
                        let mut angles = none;
                        // At its limit the beam may still be within the tilt.
                        angles[*first] = within_or_limit(a, outer.limits_deg);
                        angles[*second] = b.deg;
                        asked.push((angles, Some((*second, b.pose))));
                    };
                    self.raster.iter().for_each(&mut add);
                    let exact = branches::aim(
                        &[outer.clone(), inner.clone()],
                        &Aim {
                            beam: (u, w),
                            line: None,
                        },
                    );
                    for set in exact.branches {
                        add(&RasterAngle::of(&self.turners, *second, set[1]));
                    }
                }
            }
        }
        let mut states = Vec::new();
        let wanted = [&beam, &line];
        let mut add_at = |each: &Asked, standing: &_, states: &mut _| {
            self.add_states(each.0, standing, point, stance, wanted, room_mm, states);
        };
        // Those that lean beyond what is wished, and not beyond what is allowed.
        let mut leant: Vec<&Asked> = Vec::new();
        for each in &asked {
            let standing = self.standing(each);
            let beam = standing.axes().beam();
            if self.wished.holds(&beam, &point.normal) {
                add_at(each, &standing, &mut states);
            } else if self.allowed.holds(&beam, &point.normal) {
                leant.push(each);
            }
        }
        if states.is_empty() {
            for each in leant {
                add_at(each, &self.standing(each), &mut states);
            }
        }
        if let Some((place, _)) = self.aiming.last() {
            states.sort_by(|a, b| a.angles[*place].total_cmp(&b.angles[*place]));
        }
        states
    }

    fn standing(&self, (angles, known): &Asked) -> Standing {
        let known = known.as_ref().map(|(place, pose)| (*place, pose));
        self.turners.stand(angles, known)
    }

    /// Adds the states of some angles: one for each whole turn, since these point the same way and cost the same.
    #[allow(clippy::too_many_arguments)]
    fn add_states(
        &self,
        mut angles: Angles,
        standing: &Standing,
        point: &RunPoint,
        stance: Stance,
        wanted: [&Vector3<f64>; 2],
        room_mm: &mut f64,
        states: &mut Vec<State>,
    ) {
        let Some(cost) = self.complete(&mut angles, standing, point, stance, wanted, room_mm)
        else {
            return;
        };
        self.whole_turns(angles, |angles| {
            states.push(State {
                angles,
                cost,
                best: f64::INFINITY,
                parent: 0,
            });
        });
    }

    /// Angles of a joint in steps well below the largest turn.
    pub(super) fn each_angle(&self, joint: &ChainRotation, mut each: impl FnMut(f64)) {
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
    fn whole_turns(&self, mut angles: Angles, mut each: impl FnMut(Angles)) {
        let turns = |angle: f64, [low, high]: [f64; 2]| {
            let first = ((low - 1e-9 - angle) / 360.0).ceil();
            let last = ((high + 1e-9 - angle) / 360.0).floor();
            (first, last)
        };
        let within = |angle: f64, [low, high]: [f64; 2]| angle.clamp(low, high);
        // Nearly always each angle stands alone, within its limits.
        let alone = |(place, turn): &(usize, ChainRotation)| {
            turns(angles[*place], turn.limits_deg) == (0.0, 0.0)
        };
        if self.aiming.iter().all(alone) {
            for (place, turn) in &self.aiming {
                angles[*place] = within(angles[*place], turn.limits_deg);
            }
            return each(angles);
        }
        let mut sets = vec![angles];
        for (place, turn) in &self.aiming {
            let mut more = Vec::new();
            for set in &sets {
                let (mut k, last) = turns(set[*place], turn.limits_deg);
                while k <= last && more.len() < 64 {
                    let mut other = *set;
                    other[*place] = within(set[*place] + 360.0 * k, turn.limits_deg);
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

    /// Puts the spindle's angle in; the cost, or none where its limits or the travel are exceeded.
    fn complete(
        &self,
        angles: &mut Angles,
        standing: &Standing,
        point: &RunPoint,
        stance: Stance,
        [wanted, line]: [&Vector3<f64>; 2],
        room_mm: &mut f64,
    ) -> Option<f64> {
        let stand = standing.axes();
        let (beam, zero_line) = (stand.beam(), stand.line());
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
            self.turners
                .with_spindle(standing, angles[self.machine.turns()])
                .carriage(&(point.at - beam * self.off(stance)))
        } else {
            stand.carriage(&(point.at - beam * self.off(stance)))
        };
        let room = self.room_mm(x.as_slice());
        *room_mm = room_mm.min(room);
        (room >= 0.0).then_some(cost)
    }

    /// How far X Y Z are from the ends of their travel; negative: beyond.
    pub(super) fn room_mm(&self, axes: &[f64]) -> f64 {
        let each = axes.iter().zip(&self.machine.travel_mm);
        each.map(|(v, [low, high])| (v - low).min(high - v))
            .fold(f64::INFINITY, f64::min)
    }
}
