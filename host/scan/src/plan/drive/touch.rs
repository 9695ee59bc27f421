//! What the sensor's box would touch.

use nalgebra::Vector3;
use umi_kinematics::Pose;

use super::super::machine::{PlanMachine, SensorPose};
use super::super::spec::ScanSpec;
use super::axes::angle_deg;
use crate::surface::{Mesh, RayHit, StandingBox};

/// Poses keep so much more than the clearance, for the way between two of them.
const SPARE_MM: f64 = 0.05;

/// Ways of a plan keep so much more than the clearance, so that the proof tells no less than that.
const WAY_SPARE_MM: f64 = 0.035;

/// A stretch of a way is not halved any more where no corner of the box goes farther from its middle.
const SHORTEST_MM: f64 = 0.01;

/// A clearance is told too small by this at most, and by [`TOLD_SHARE`] of what it has beyond the wanted one.
const TOLD_MM: f64 = 0.02;
/// See [`TOLD_MM`].
const TOLD_SHARE: f64 = 0.05;

/// How near it is measured at a pose.
const MEASURED_MM: f64 = 0.01;

/// A touch less deep than this is none where a path is driven: words are rounded, and the point may be carried.
const SHALLOW_MM: f64 = 0.05;

/// Turns of a stretch above which its corners' way has no bound here, in radians.
const MOST_TURN_RAD: f64 = 0.5;

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
}

impl<'a> Scenery<'a> {
    /// The box of the specification among these meshes.
    pub fn new(spec: &ScanSpec, meshes: Vec<&'a Mesh>) -> Self {
        Scenery {
            meshes,
            low: spec.sensor.body_mm[0],
            high: spec.sensor.body_mm[1],
            clearance_mm: spec.plan.clearance_mm,
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
            half_mm: ((self.high - self.low) / 2.0).map(|half| (half + grown_mm).max(0.0)),
        };
        self.meshes.iter().any(|m| m.touches(&bx))
    }

    /// Does the box with its clearance touch anything at this pose?
    pub fn touches(&self, pose: &SensorPose) -> bool {
        self.grown_touches(pose, self.clearance_mm + SPARE_MM)
    }

    /// Does it touch anything on the straight way of the axes? Looked at with some spare, for a plan.
    pub fn touches_between(&self, machine: &PlanMachine, a: &[f64], b: &[f64]) -> bool {
        !self.free(machine, a, b, self.clearance_mm + WAY_SPARE_MM)
    }

    /// Does the box keep its clearance on the straight way of the axes?
    pub fn keeps_clear(&self, machine: &PlanMachine, a: &[f64], b: &[f64]) -> bool {
        self.free(machine, a, b, self.clearance_mm)
    }

    /// Does the bare box hit anything on the straight way of the axes?
    pub fn hits_between(&self, machine: &PlanMachine, a: &[f64], b: &[f64]) -> bool {
        !self.free(machine, a, b, -SHALLOW_MM)
    }

    /// Nothing is nearer than so much, anywhere on the way.
    fn free(&self, machine: &PlanMachine, a: &[f64], b: &[f64], grown_mm: f64) -> bool {
        stretches(a, b, |axes, rates| {
            let pose = machine.forward(axes);
            let goes = self.goes_mm(machine, axes, rates, grown_mm);
            if goes.is_some_and(|goes| !self.grown_touches(&pose, grown_mm + goes)) {
                return Stretch::Done;
            }
            if self.grown_touches(&pose, grown_mm) || goes.is_some_and(|g| g <= SHORTEST_MM) {
                return Stretch::Stop;
            }
            Stretch::Halve
        })
    }

    /// How far any corner of the grown box goes from its place at these axes, at most, while each axis goes by its share
    /// of `rates` (mm and degrees) to either side; none where they turn too far for a bound.
    ///
    /// A corner goes by no more than linear axes go, and each rotary axis turns times the corner's distance from it. That
    /// distance grows on the way by no more than what is sought: D = (sum of turn x distance + linear) / (1 - sum of turns).
    fn goes_mm(
        &self,
        machine: &PlanMachine,
        axes: &[f64],
        rates: &[f64],
        grown_mm: f64,
    ) -> Option<f64> {
        let turns: f64 = rates[3..].iter().map(|r| r.to_radians()).sum();
        if turns > MOST_TURN_RAD {
            return None;
        }
        let linear = rates[..3].iter().map(|r| r * r).sum::<f64>().sqrt();
        let chain = &machine.chain;
        let mut lines = Vec::with_capacity(rates.len());
        let mut along = |joints: &[usize]| {
            let mut pose = Pose::identity();
            for &k in joints {
                let joint = &chain.joints[k];
                if k >= 3 {
                    let direction = pose.rotation * joint.direction;
                    lines.push((
                        rates[k].to_radians(),
                        pose.point(&joint.point_mm),
                        direction,
                    ));
                }
                pose = pose.after(&joint.transform(axes[k]));
            }
            pose
        };
        along(&chain.workpiece_chain);
        let sensor = along(&chain.sensor_chain).after(&chain.sensor);
        // The sensor's frame has line, -feed, -beam for x, y, z.
        let (low, high) = (
            self.low - Vector3::repeat(grown_mm),
            self.high + Vector3::repeat(grown_mm),
        );
        let goes = (0..8).map(|corner: usize| {
            let of = |k: usize| [low[k], high[k]][corner >> k & 1];
            let at = sensor.point(&Vector3::new(of(0), -of(1), -of(2)));
            let turned = lines
                .iter()
                .map(|(turn, on, direction)| turn * (at - on).cross(direction).norm());
            turned.sum::<f64>()
        });
        Some((goes.fold(0.0, f64::max) + linear) / (1.0 - turns))
    }

    /// The least of `free_mm` and what the box could grow by on every side at the poses looked at, such that on the whole way
    /// it could grow by [`Self::told`] of it.
    pub fn nearest(&self, machine: &PlanMachine, a: &[f64], b: &[f64], free_mm: f64) -> f64 {
        let mut free = free_mm;
        stretches(a, b, |axes, rates| {
            let pose = machine.forward(axes);
            if free > 0.0 && self.grown_touches(&pose, free) {
                let (mut low, mut high) = (0.0, free);
                while high - low > MEASURED_MM {
                    let middle = (low + high) / 2.0;
                    if self.grown_touches(&pose, middle) {
                        high = middle;
                    } else {
                        low = middle;
                    }
                }
                free = low;
            }
            let told = self.told(free);
            let goes = self.goes_mm(machine, axes, rates, told.max(0.0));
            if told <= 0.0 {
                return Stretch::Stop;
            }
            match goes {
                Some(goes) if goes <= TOLD_MM || !self.grown_touches(&pose, told + goes) => {
                    Stretch::Done
                }
                _ => Stretch::Halve,
            }
        });
        free
    }

    /// The clearance that is proved, of the least that was measured: less by 0.02 mm and a twentieth of what it has
    /// beyond the wanted one.
    pub fn told(&self, nearest_mm: f64) -> f64 {
        let beyond = (nearest_mm - self.clearance_mm).max(0.0);
        nearest_mm - TOLD_MM - TOLD_SHARE * beyond
    }
}

/// What is known of a stretch of a way.
enum Stretch {
    /// All that is asked.
    Done,
    /// More is known of its halves.
    Halve,
    /// Enough to end.
    Stop,
}

/// Goes through a way of the axes in stretches that are halved where asked: `look` gets the axes in a stretch's middle,
/// and how far each goes from there to either end. False where it stops.
fn stretches(a: &[f64], b: &[f64], mut look: impl FnMut(&[f64], &[f64]) -> Stretch) -> bool {
    let mut ahead = vec![(0.5, 0.5)];
    while let Some((middle, half)) = ahead.pop() {
        let pairs = || a.iter().zip(b);
        let axes: Vec<f64> = pairs().map(|(x, y)| x + (y - x) * middle).collect();
        let rates: Vec<f64> = pairs().map(|(x, y)| (y - x).abs() * half).collect();
        match look(&axes, &rates) {
            Stretch::Done => {}
            Stretch::Halve => {
                let half = half / 2.0;
                ahead.extend([(middle + half, half), (middle - half, half)]);
            }
            Stretch::Stop => return false,
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::super::super::tests::spec;
    use super::Scenery;
    use crate::surface::Mesh;

    const LONG: &str = r#"
[sensor]
line_mm = 16.0
reference_mm = 60.0
range_mm = [52.0, 68.0]
max_incidence_deg = 60.0
receiver_mm = [0, 0, 0]
body_mm = [[-380, -0.5, -90], [40, 0.5, -5]]
[plan]
overlap = 0.15
stand_off_tolerance_mm = 1.0
max_tilt_deg = 10.0
min_coverage = 0.9
clearance_mm = 1.0
max_step_mm = 2.0
max_turn_deg = 6.0
[machine]
travel_mm = { X = [-900, 900], Y = [-900, 900], Z = [-900, 900] }
mount = { origin_mm = [0, 0, -150], beam = [0, 0, -1], line = [0, 1, 0] }
[[machine.table]]
name = "C"
axis = [0, 0, 1]
point_mm = [0, 0, 0]
limits_deg = [-360, 360]
"#;

    #[test]
    fn a_pin_does_not_slip_through_the_way_of_a_far_corner() {
        let spec = spec(LONG).unwrap();
        let machine = &spec.machine;
        let (a, b) = ([0.0, 0.0, 200.0, -0.95], [0.0, 0.0, 200.0, 0.95]);
        let middle = machine.forward(&[0.0, 0.0, 200.0, 0.0]);
        let at = middle.origin_mm - middle.line * 370.0 - middle.beam * 50.0;
        let pin = [
            at - middle.beam * 20.0,
            at + middle.beam * 20.0,
            at + middle.line * 0.1,
        ];
        let pin = Mesh::new(&[pin]).unwrap();
        let scenery = Scenery::new(&spec, vec![&pin]);
        assert!(!scenery.touches(&machine.forward(&a)) && !scenery.touches(&machine.forward(&b)));
        assert!(scenery.touches_between(machine, &a, &b));
        assert!(!scenery.keeps_clear(machine, &a, &b));
        assert!(scenery.hits_between(machine, &a, &b));
        assert!(scenery.told(scenery.nearest(machine, &a, &b, 50.0)) < 0.0);
        // Lifted off it, the way is free by what is told.
        let lifted = |axes: &[f64; 4]| [axes[0], axes[1], 330.0, axes[3]];
        let (a, b) = (lifted(&a), lifted(&b));
        assert!(scenery.keeps_clear(machine, &a, &b));
        // From the pin's top to the housing's lower face.
        let free = scenery.told(scenery.nearest(machine, &a, &b, 100.0));
        assert!((55.0 * 0.95 - 1.0..=65.0).contains(&free), "{free}");
    }
}
