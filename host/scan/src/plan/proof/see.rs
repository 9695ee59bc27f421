//! What a path sees: the laser's plane is carried from pose to pose and over each point.

use std::ops::Range;

use nalgebra::Vector3;

use super::super::drive::realise::{Pass, receiver};
use super::super::drive::touch::Scenery;
use super::super::machine::SensorPose;
use super::super::spec::SensorSpec;
use super::cells::Cells;
use super::samples::SamplePoint;
use crate::parallel::Threads;

/// How a pass saw a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// The pass, by its place in the list.
    pub pass: u32,
    /// The step in it.
    pub step: u32,
    /// Place along the line, from -1 to 1.
    pub lateral: f64,
}

/// Why a point that lay under the line was not measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Missed {
    /// Something stood before it.
    pub occluded: bool,
    /// The ray met it too flat.
    pub incidence: bool,
    /// It was too near or too far.
    pub range: bool,
}

/// All sights of each point.
#[derive(Debug, Clone)]
pub struct SampleSights {
    /// By sample; the first sight of each pass.
    pub sights: Vec<Vec<Sight>>,
    /// By sample.
    pub missed: Vec<Missed>,
}

impl SampleSights {
    /// Share of the samples that were seen.
    pub fn share(&self) -> f64 {
        self.sights.iter().filter(|s| !s.is_empty()).count() as f64
            / self.sights.len().max(1) as f64
    }
}

/// How far along the beam points are looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SightDepth {
    /// Within the range: what is measured, and what stands before it.
    Range,
    /// From the sensor to well beyond the range: what is too near or too far is named, too.
    All,
}

/// Scans passes in simulation, with every reason for what is not measured.
pub fn see(
    sensor: &SensorSpec,
    scenery: &Scenery<'_>,
    samples: &[SamplePoint],
    passes: &[&Pass],
) -> SampleSights {
    Eye::new(sensor, scenery, samples).see(passes, SightDepth::All, Threads::all())
}

/// A sensor among points, made ready for many scans.
pub struct Eye<'a> {
    sensor: &'a SensorSpec,
    scenery: &'a Scenery<'a>,
    samples: &'a [SamplePoint],
    cells: Cells,
}

/// What one chunk of passes adds.
type Found = (Vec<(u32, Sight)>, Vec<(u32, Missed)>);

impl<'a> Eye<'a> {
    /// Sorts the points into cells.
    pub fn new(
        sensor: &'a SensorSpec,
        scenery: &'a Scenery<'a>,
        samples: &'a [SamplePoint],
    ) -> Self {
        let places: Vec<Vector3<f64>> = samples.iter().map(|s| s.at).collect();
        Eye {
            sensor,
            scenery,
            samples,
            cells: Cells::new(&places, sensor.line_mm / 4.0),
        }
    }

    /// Scans passes. The answer does not depend on the threads: passes are put together in their order.
    pub fn see(&self, passes: &[&Pass], depth: SightDepth, threads: Threads) -> SampleSights {
        let mut seen = SampleSights {
            sights: vec![Vec::new(); self.samples.len()],
            missed: vec![Missed::default(); self.samples.len()],
        };
        let chunk = passes.len().div_ceil(32);
        let found = threads.chunks(passes.len(), chunk, |range| self.some(passes, range, depth));
        for (sights, missed) in found {
            for (i, sight) in sights {
                seen.sights[i as usize].push(sight);
            }
            for (i, why) in missed {
                let m = &mut seen.missed[i as usize];
                m.occluded |= why.occluded;
                m.incidence |= why.incidence;
                m.range |= why.range;
            }
        }
        seen
    }

    /// Which points a single pass sees, by number.
    pub fn seen_by(&self, pass: &Pass) -> Vec<u32> {
        let (sights, _) = self.some(&[pass], 0..1, SightDepth::Range);
        let mut seen: Vec<u32> = sights.into_iter().map(|(i, _)| i).collect();
        seen.sort_unstable();
        seen
    }

    fn some(&self, passes: &[&Pass], range: Range<usize>, depth: SightDepth) -> Found {
        const NEVER: u32 = u32::MAX;
        let mut last = vec![NEVER; self.samples.len()];
        let (mut sights, mut missed) = (Vec::new(), Vec::new());
        for number in range {
            for (step, pair) in passes[number].poses.windows(2).enumerate() {
                let [a, b] = [&pair[0], &pair[1]];
                let (fa, fb) = (a.feed(), b.feed());
                let (low, high) = swept(self.sensor, a, b, depth);
                self.cells.within(&low, &high, |i| {
                    let point = &self.samples[i];
                    let (f0, f1) = (
                        (point.at - a.origin_mm).dot(&fa),
                        (point.at - b.origin_mm).dot(&fb),
                    );
                    if f0 * f1 > 0.0 || f0 == f1 || last[i] == number as u32 {
                        return;
                    }
                    match at_crossing(self.sensor, self.scenery, point, a, b, f0 / (f0 - f1)) {
                        Ok(lateral) => {
                            last[i] = number as u32;
                            let sight = Sight {
                                pass: number as u32,
                                step: step as u32,
                                lateral,
                            };
                            sights.push((i as u32, sight));
                        }
                        Err(Some(why)) => missed.push((i as u32, why)),
                        Err(None) => {}
                    }
                });
            }
        }
        (sights, missed)
    }
}

/// An upright box around everything that the laser's plane sweeps between two poses.
fn swept(
    sensor: &SensorSpec,
    a: &SensorPose,
    b: &SensorPose,
    depth: SightDepth,
) -> (Vector3<f64>, Vector3<f64>) {
    let [near, far] = match depth {
        SightDepth::Range => sensor.range_mm,
        SightDepth::All => [
            0.0,
            sensor.range_mm[1] * (1.0 + sensor.line_mm / sensor.reference_mm),
        ],
    };
    let half = |along: f64| sensor.line_mm / 2.0 * along / sensor.reference_mm;
    let mut low = Vector3::repeat(f64::INFINITY);
    let mut high = Vector3::repeat(f64::NEG_INFINITY);
    for pose in [a, b] {
        for along in [near, far] {
            for side in [-1.0, 1.0] {
                let corner = pose.origin_mm + pose.beam * along + pose.line * (side * half(along));
                low = low.inf(&corner);
                high = high.sup(&corner);
            }
        }
    }
    // Between the poses beam and line are made unit vectors again: they reach a little further than the corners' mean.
    let longer = |x: &Vector3<f64>, y: &Vector3<f64>| 2.0 / (x + y).norm().max(0.02) - 1.0;
    let spare = far * longer(&a.beam, &b.beam) + half(far) * longer(&a.line, &b.line) + 1e-6;
    (low - Vector3::repeat(spare), high + Vector3::repeat(spare))
}

/// The place along the line at which a point is measured as the plane passes it; or why it is not.
fn at_crossing(
    sensor: &SensorSpec,
    scenery: &Scenery<'_>,
    point: &SamplePoint,
    a: &SensorPose,
    b: &SensorPose,
    w: f64,
) -> Result<f64, Option<Missed>> {
    let mix = |x: &Vector3<f64>, y: &Vector3<f64>| x + (y - x) * w;
    let pose = SensorPose {
        origin_mm: mix(&a.origin_mm, &b.origin_mm),
        beam: mix(&a.beam, &b.beam).normalize(),
        line: mix(&a.line, &b.line).normalize(),
    };
    let d = point.at - pose.origin_mm;
    let (along, lateral) = (d.dot(&pose.beam), d.dot(&pose.line));
    let half = sensor.line_mm / 2.0 * along / sensor.reference_mm;
    if along <= 0.0 || lateral.abs() > half {
        return Err(None);
    }
    let incidence = -d.normalize().dot(&point.normal) < sensor.max_incidence_deg.to_radians().cos();
    let range = along < sensor.range_mm[0] || along > sensor.range_mm[1];
    if incidence || range {
        return Err(Some(Missed {
            occluded: false,
            incidence,
            range,
        }));
    }
    let hidden = |from: &Vector3<f64>| {
        scenery
            .meshes
            .iter()
            .any(|m| m.stands_between(from, &point.at, 0.05))
    };
    // Nothing stands between a point and what is behind an open surface; it is not seen from there.
    let unreceived = || {
        let receiver = receiver(&pose, &sensor.receiver_mm);
        (receiver - point.at).dot(&point.normal) <= 0.0 || hidden(&receiver)
    };
    let occluded =
        hidden(&pose.origin_mm) || (sensor.receiver_mm != Vector3::zeros() && unreceived());
    if occluded {
        return Err(Some(Missed {
            occluded: true,
            ..Missed::default()
        }));
    }
    Ok(lateral / half)
}
