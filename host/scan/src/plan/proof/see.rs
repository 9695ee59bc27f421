//! What a path sees: the laser's plane is carried from pose to pose and over each point.

use nalgebra::Vector3;

use super::super::drive::realise::{Pass, receiver};
use super::super::drive::touch::Scenery;
use super::super::machine::SensorPose;
use super::super::spec::SensorSpec;
use super::samples::SamplePoint;

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

/// Scans passes in simulation.
pub fn see(
    sensor: &SensorSpec,
    scenery: &Scenery<'_>,
    samples: &[SamplePoint],
    passes: &[&Pass],
) -> SampleSights {
    let mut seen = SampleSights {
        sights: vec![Vec::new(); samples.len()],
        missed: vec![Missed::default(); samples.len()],
    };
    if passes.is_empty() {
        return seen;
    }
    // Two halves of the samples on two threads; each sample is on its own, so the answer does not depend on it.
    let half = samples.len() / 2;
    let (sights_a, sights_b) = seen.sights.split_at_mut(half);
    let (missed_a, missed_b) = seen.missed.split_at_mut(half);
    let (samples_a, samples_b) = samples.split_at(half);
    std::thread::scope(|scope| {
        scope.spawn(|| part_of(sensor, scenery, samples_a, passes, sights_a, missed_a));
        part_of(sensor, scenery, samples_b, passes, sights_b, missed_b);
    });
    seen
}

fn part_of(
    sensor: &SensorSpec,
    scenery: &Scenery<'_>,
    samples: &[SamplePoint],
    passes: &[&Pass],
    sights: &mut [Vec<Sight>],
    missed: &mut [Missed],
) {
    let far = sensor.range_mm[1] * (1.0 + sensor.line_mm / sensor.reference_mm);
    let cell = Cells::new(samples, far.max(1.0));
    for (number, pass) in passes.iter().enumerate() {
        for (step, pair) in pass.poses.windows(2).enumerate() {
            let [a, b] = [&pair[0], &pair[1]];
            let (fa, fb) = (a.feed(), b.feed());
            cell.near(
                &a.origin_mm,
                far + (b.origin_mm - a.origin_mm).norm(),
                |i| {
                    let point = &samples[i];
                    let (f0, f1) = (
                        (point.at - a.origin_mm).dot(&fa),
                        (point.at - b.origin_mm).dot(&fb),
                    );
                    if f0 * f1 > 0.0 || f0 == f1 {
                        return;
                    }
                    if sights[i].last().is_some_and(|s| s.pass == number as u32) {
                        return;
                    }
                    match at_crossing(sensor, scenery, point, a, b, f0 / (f0 - f1)) {
                        Ok(lateral) => sights[i].push(Sight {
                            pass: number as u32,
                            step: step as u32,
                            lateral,
                        }),
                        Err(Some(why)) => {
                            let m = &mut missed[i];
                            m.occluded |= why.occluded;
                            m.incidence |= why.incidence;
                            m.range |= why.range;
                        }
                        Err(None) => {}
                    }
                },
            );
        }
    }
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
    let occluded = hidden(&pose.origin_mm)
        || (sensor.receiver_mm != Vector3::zeros()
            && hidden(&receiver(&pose, &sensor.receiver_mm)));
    if occluded {
        return Err(Some(Missed {
            occluded: true,
            ..Missed::default()
        }));
    }
    Ok(lateral / half)
}

/// Samples in cells, so that a pose looks at those within its reach alone.
struct Cells {
    size: f64,
    low: Vector3<f64>,
    counts: [usize; 3],
    starts: Vec<u32>,
    order: Vec<u32>,
}

impl Cells {
    fn new(samples: &[SamplePoint], reach: f64) -> Self {
        let (low, high) = samples.iter().fold(
            (
                Vector3::repeat(f64::INFINITY),
                Vector3::repeat(f64::NEG_INFINITY),
            ),
            |(l, h), s| (l.inf(&s.at), h.sup(&s.at)),
        );
        let widest = if samples.is_empty() {
            1.0
        } else {
            (high - low).amax()
        };
        let size = (reach / 2.0).max(widest / 64.0).max(1e-6);
        let counts: [usize; 3] = std::array::from_fn(|k| {
            let n = (high[k] - low[k]) / size;
            if n.is_finite() { n as usize + 1 } else { 1 }
        });
        let mut cells = Cells {
            size,
            low,
            counts,
            starts: vec![0; counts.iter().product::<usize>() + 1],
            order: vec![0; samples.len()],
        };
        let homes: Vec<usize> = samples.iter().map(|s| cells.home(&s.at)).collect();
        for &h in &homes {
            cells.starts[h + 1] += 1;
        }
        for k in 1..cells.starts.len() {
            cells.starts[k] += cells.starts[k - 1];
        }
        let mut next = cells.starts.clone();
        for (i, &h) in homes.iter().enumerate() {
            cells.order[next[h] as usize] = i as u32;
            next[h] += 1;
        }
        cells
    }

    fn place(&self, at: &Vector3<f64>, k: usize) -> usize {
        (((at[k] - self.low[k]) / self.size).max(0.0) as usize).min(self.counts[k] - 1)
    }

    fn home(&self, at: &Vector3<f64>) -> usize {
        (self.place(at, 0) * self.counts[1] + self.place(at, 1)) * self.counts[2]
            + self.place(at, 2)
    }

    fn near(&self, at: &Vector3<f64>, reach: f64, mut each: impl FnMut(usize)) {
        let r = Vector3::repeat(reach);
        let (low, high) = (at - r, at + r);
        for x in self.place(&low, 0)..=self.place(&high, 0) {
            for y in self.place(&low, 1)..=self.place(&high, 1) {
                let row = (x * self.counts[1] + y) * self.counts[2];
                let (from, to) = (row + self.place(&low, 2), row + self.place(&high, 2));
                for &i in &self.order[self.starts[from] as usize..self.starts[to + 1] as usize] {
                    each(i as usize);
                }
            }
        }
    }
}
