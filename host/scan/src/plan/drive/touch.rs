//! What the sensor's box would touch.

use nalgebra::Vector3;

use super::super::machine::{PlanMachine, SensorPose};
use super::super::spec::ScanSpec;
use super::axes::angle_deg;
use crate::surface::{Mesh, RayHit, StandingBox};

/// Between poses, the box is looked at this often: mm and degrees.
const LOOK: f64 = 2.0;

/// Added to the clearance, for what lies between two looks.
const SPARE_MM: f64 = 0.05;

/// A ray so near to an edge may meet either side of it, by the last digits of the axes; far less than courses keep off a
/// sharp edge.
const ON_EDGE_MM: f64 = 2e-7;

/// Part and obstacles, with the sensor's box.
pub struct Scenery<'a> {
    /// The part first.
    pub meshes: Vec<&'a Mesh>,
    low: Vector3<f64>,
    high: Vector3<f64>,
    clearance_mm: f64,
    reference_mm: f64,
}

impl<'a> Scenery<'a> {
    /// The box of the specification among these meshes.
    pub fn new(spec: &ScanSpec, meshes: Vec<&'a Mesh>) -> Self {
        Scenery {
            meshes,
            low: spec.sensor.body_mm[0],
            high: spec.sensor.body_mm[1],
            clearance_mm: spec.plan.clearance_mm,
            reference_mm: spec.sensor.reference_mm,
        }
    }

    /// The angle between the beam and the triangle that its middle ray meets; on an edge the larger one of those beside it.
    pub fn tilt_deg(&self, pose: &SensorPose, hit: &RayHit) -> f64 {
        let part = self.meshes[0];
        let tilt = |face: usize| angle_deg(&-pose.beam, &part.triangles()[face].normal);
        let corners = part.triangles()[hit.face].corners;
        let at = pose.origin_mm + pose.beam * hit.at;
        let on_edge = (0..3).any(|k| {
            let edge = corners[(k + 1) % 3] - corners[k];
            (at - corners[k]).cross(&edge).norm() < ON_EDGE_MM * edge.norm()
        });
        if !on_edge {
            return tilt(hit.face);
        }
        [pose.line, -pose.line, pose.feed(), -pose.feed()]
            .into_iter()
            .filter_map(|aside| {
                let from = pose.origin_mm + aside * (3.0 * ON_EDGE_MM);
                part.first_hit(&from, &pose.beam, hit.at + 1.0)
            })
            .map(|beside| tilt(beside.face))
            .fold(tilt(hit.face), f64::max)
    }

    fn grown_touches(&self, pose: &SensorPose, grown_mm: f64) -> bool {
        let axes = [pose.line, pose.feed(), pose.beam];
        let centre = (self.low + self.high) / 2.0;
        let bx = StandingBox {
            centre: pose.origin_mm + axes[0] * centre.x + axes[1] * centre.y + axes[2] * centre.z,
            axes,
            half_mm: (self.high - self.low) / 2.0 + Vector3::repeat(grown_mm),
        };
        self.meshes.iter().any(|m| m.touches(&bx))
    }

    /// Does the box with its clearance touch anything at this pose?
    pub fn touches(&self, pose: &SensorPose) -> bool {
        self.grown_touches(pose, self.clearance_mm + SPARE_MM)
    }

    /// Does it touch anything on the straight way of the axes? Both ends are looked at.
    pub fn touches_between(&self, machine: &PlanMachine, a: &[f64], b: &[f64]) -> bool {
        self.ways(machine, a, b, |pose| self.touches(pose))
    }

    /// Calls for poses along the way until one says true.
    fn ways(
        &self,
        machine: &PlanMachine,
        a: &[f64],
        b: &[f64],
        mut at: impl FnMut(&SensorPose) -> bool,
    ) -> bool {
        let (pa, pb) = (machine.forward(a), machine.forward(b));
        let tip = |p: &SensorPose| p.origin_mm + p.beam * self.reference_mm;
        let turn = a[3..]
            .iter()
            .zip(&b[3..])
            .map(|(x, y)| (x - y).abs())
            .fold(0.0, f64::max);
        let carriage = (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
        let way = (tip(&pa) - tip(&pb)).norm().max(carriage);
        let count = (way.max(turn) / LOOK).ceil().clamp(1.0, 4000.0) as usize;
        for k in 0..=count {
            let w = k as f64 / count as f64;
            let pose = if k == 0 {
                pa
            } else if k == count {
                pb
            } else {
                let axes: Vec<f64> = a.iter().zip(b).map(|(x, y)| x + (y - x) * w).collect();
                machine.forward(&axes)
            };
            if at(&pose) {
                return true;
            }
        }
        false
    }

    /// By how much the box could grow on every side before it touches anything on the way; up to `most_mm`.
    pub fn clearance(&self, machine: &PlanMachine, a: &[f64], b: &[f64], most_mm: f64) -> f64 {
        let mut free = most_mm;
        self.ways(machine, a, b, |pose| {
            if free > 0.0 && self.grown_touches(pose, free) {
                let (mut low, mut high) = (0.0, free);
                while high - low > 0.01 {
                    let middle = (low + high) / 2.0;
                    if self.grown_touches(pose, middle) {
                        high = middle;
                    } else {
                        low = middle;
                    }
                }
                free = low;
            }
            false
        });
        free
    }
}
