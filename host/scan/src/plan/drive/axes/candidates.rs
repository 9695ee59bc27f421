//! The angles that are asked at each pose of a run.

use nalgebra::Vector3;
use umi_kinematics::branches::{self, Aim, ChainRotation};

use super::super::super::course::RunPoint;
use super::turned::{best_about, turned, within_or_limit};
use super::{Driver, RasterAngle, Stance, State, Tilt, angle_deg};

/// Of the share of the line that does not lie across the way, against the square of a tilt in degrees: a strip that is
/// narrower by a fiftieth is worth a lean of 9 degrees.
const LINE_WEIGHT: f64 = 4000.0;

impl Driver<'_> {
    /// Candidates at a point: angles that keep the tilt and the limits.
    pub(super) fn states(&self, point: &RunPoint, stance: Stance, room_mm: &mut f64) -> Vec<State> {
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
        for tilt in [self.wished, self.allowed] {
            for angles in &angles_found {
                let mut angles = angles.clone();
                let wanted = [&beam, &line];
                // Whole turns point the same way and cost the same.
                if let Some(cost) = self.complete(&mut angles, point, stance, tilt, wanted, room_mm)
                {
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
            if !states.is_empty() {
                break;
            }
        }
        if let Some((place, _)) = self.aiming.last() {
            states.sort_by(|a, b| a.angles[*place].total_cmp(&b.angles[*place]));
        }
        states
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
    fn whole_turns(&self, mut angles: Vec<f64>, mut each: impl FnMut(Vec<f64>)) {
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
                    let mut other = set.clone();
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

    /// Puts the spindle's angle in; the cost, or none where the tilt or the travel is exceeded.
    fn complete(
        &self,
        angles: &mut [f64],
        point: &RunPoint,
        stance: Stance,
        tilt: Tilt,
        [wanted, line]: [&Vector3<f64>; 2],
        room_mm: &mut f64,
    ) -> Option<f64> {
        let stand = self.machine.stand(angles);
        let (beam, zero_line) = (stand.beam(), stand.line());
        if !tilt.holds(&beam, &point.normal) {
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
    pub(super) fn room_mm(&self, axes: &[f64]) -> f64 {
        let each = axes.iter().zip(&self.machine.travel_mm);
        each.map(|(v, [low, high])| (v - low).min(high - v))
            .fold(f64::INFINITY, f64::min)
    }
}
