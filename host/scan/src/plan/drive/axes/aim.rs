//! What the axes can point the beam at.

use nalgebra::Vector3;
use umi_kinematics::branches::{self, Aim, ChainRotation};

use super::super::super::machine::SensorPose;
use super::super::super::map::flatten::across;
use super::turned::{best_about, turned, within_or_limit};
use super::{Driver, Tilt};

/// Angles at which one of three rotations is held, where it cannot stand near zero.
const HELD_STEPS: u32 = 24;

impl Driver<'_> {
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
                let sets: Vec<Vec<f64>> = found.iter().filter_map(near).collect();
                let [(_, first), _, _, ..] = aiming else {
                    return sets;
                };
                if !sets.is_empty() {
                    return sets;
                }
                // Of three rotations one is held, as near to zero as its limits are. It may have to stand elsewhere: a head
                // below the part at half a turn, not at the end of its limits.
                let [low, high] = first.limits_deg;
                let held = |k: u32| low + (high - low) * f64::from(k) / f64::from(HELD_STEPS);
                let steps = (0..=HELD_STEPS).map(held);
                let held = steps.flat_map(|held| branches::with_held(&turns, &aim, 0, held));
                held.filter_map(|set| within(&set)).collect()
            }
        }
    }

    /// The line's direction where the beam is against this normal as well as the axes can, one for each branch; none where
    /// two axes do not reach it. For machines whose line follows from the beam.
    pub fn lines_for(&self, normal: &Vector3<f64>) -> Vec<Vector3<f64>> {
        self.lines_near(normal, normal, self.wished)
    }

    /// The line's direction where the beam is against `aimed_at`, within the tilt of a normal where two axes turn it.
    fn lines_near(
        &self,
        aimed_at: &Vector3<f64>,
        normal: &Vector3<f64>,
        tilt: Tilt,
    ) -> Vec<Vector3<f64>> {
        let pointed = self.aimed(aimed_at).into_iter();
        let pointed = pointed.map(|angles| self.machine.pointing(&angles));
        pointed
            .filter(|(beam, _)| self.aiming.len() < 2 || tilt.holds(beam, normal))
            .map(|(_, line)| line)
            .collect()
    }

    /// The same for every beam that leans no more than allowed: a ring of leans stands for all.
    pub fn lines_within_tilt(&self, normal: &Vector3<f64>) -> Vec<Vector3<f64>> {
        for tilt in [self.wished, self.allowed] {
            let mut lines = self.lines_near(normal, normal, tilt);
            if self.aiming.len() == 2 {
                for leant in self.leans(normal, tilt) {
                    lines.extend(self.lines_near(&leant, normal, tilt));
                }
            }
            if !lines.is_empty() {
                return lines;
            }
        }
        Vec::new()
    }

    /// Normals around one, leant by nearly as much as is allowed: the way along a course must have room, too.
    fn leans(
        &self,
        normal: &Vector3<f64>,
        tilt: Tilt,
    ) -> impl Iterator<Item = Vector3<f64>> + use<> {
        const AROUND: usize = 12;
        let (x, y) = across(normal);
        let (normal, lean) = (*normal, (0.9 * tilt.deg).to_radians().tan());
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
        near(normal)
            || (self.aiming.len() > 1 && self.leans(normal, self.allowed).any(|n| near(&n)))
    }

    /// Poses that meet a point of the surface within tilt, limits and travel: against its normal and leant around it.
    pub fn stands(&self, at: &Vector3<f64>, normal: &Vector3<f64>) -> Vec<SensorPose> {
        let leant = self.leans(normal, self.allowed);
        let leant = leant.filter(|_| !self.aiming.is_empty());
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
}
