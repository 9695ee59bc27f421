//! Why samples are not seen, by reason and area.

use nalgebra::Vector3;
use serde::Serialize;

use super::super::drive::axes::Driver;
use super::super::drive::realise::Obstructed;
use super::super::machine::SensorPose;
use super::super::proof::cells::Cells;
use super::super::proof::samples::SamplePoint;
use super::super::proof::see::SampleSights;
use super::Workshop;

/// An area that no pass sees, and the reason.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Uncovered {
    /// `occluded`, `incidence`, `range`, `collision`, `axis_limit` (no pose within the limits would see it) or `unreached`.
    pub reason: &'static str,
    /// How much of the surface.
    pub area_mm2: f64,
}

/// The reason of what no pose within the limits would see.
pub(super) const AXIS_LIMIT: &str = "axis_limit";

/// Points that the middle ray may meet: one of so many samples, besides the one that is asked for.
const MET: usize = 4;

/// What a pose within tilt, limits and travel sees, whether a course leads there or not.
struct WithinLimits<'a> {
    shop: &'a Workshop<'a>,
    /// The machine as it is given: a spindle that is planned as one that stands could turn.
    driver: Driver<'a>,
    met: Vec<SamplePoint>,
    cells: Cells,
    /// The poses that meet each, once they are asked for.
    stands: Vec<Option<Vec<SensorPose>>>,
    /// As far as samples that the laser's plane meets lie from it.
    apart_mm: f64,
}

impl<'a> WithinLimits<'a> {
    fn new(shop: &'a Workshop<'a>) -> Self {
        let met: Vec<SamplePoint> = shop.samples.iter().step_by(MET).copied().collect();
        let places: Vec<Vector3<f64>> = met.iter().map(|s| s.at).collect();
        let apart_mm = (shop.part.surface.area_mm2() / met.len().max(1) as f64).sqrt();
        WithinLimits {
            shop,
            driver: Driver::new(shop.given),
            cells: Cells::new(&places, shop.spec.sensor.line_mm / 4.0),
            stands: vec![None; met.len()],
            met,
            apart_mm,
        }
    }

    /// Would a pose see the point, if nothing stood in the way?
    fn sees(&mut self, sample: &SamplePoint) -> bool {
        let driver = &self.driver;
        let sensor = &self.shop.spec.sensor;
        let (free, apart_mm) = (driver.free_line(), self.apart_mm);
        let least = sensor.max_incidence_deg.to_radians().cos();
        let in_line = |pose: &SensorPose| {
            let d = sample.at - pose.origin_mm;
            let along = d.dot(&pose.beam);
            let half = sensor.line_mm / 2.0 * along / sensor.reference_mm;
            let aside = (d - pose.beam * along).norm();
            let lies = free || d.dot(&pose.feed()).abs() <= apart_mm;
            (sensor.range_mm[0]..=sensor.range_mm[1]).contains(&along)
                && aside <= half
                && lies
                && -d.normalize().dot(&sample.normal) >= least
        };
        if driver
            .stands(&sample.at, &sample.normal)
            .iter()
            .any(in_line)
        {
            return true;
        }
        let (met, stands) = (&self.met, &mut self.stands);
        self.cells.any_near(&sample.at, sensor.line_mm * 0.6, |k| {
            let poses = stands[k].get_or_insert_with(|| driver.stands(&met[k].at, &met[k].normal));
            poses.iter().any(in_line)
        })
    }
}

/// Sorts what is not seen by its reason; reasons without area are left out.
pub fn reasons(
    shop: &Workshop<'_>,
    seen: &SampleSights,
    obstructed: &Obstructed,
) -> Vec<Uncovered> {
    const REASONS: [&str; 6] = [
        "occluded",
        "incidence",
        "range",
        "collision",
        AXIS_LIMIT,
        "unreached",
    ];
    let per_sample = shop.part.surface.area_mm2() / shop.samples.len() as f64;
    let reach = shop.spec.sensor.line_mm * 0.6;
    let (touched, limited) = (
        Cells::new(&obstructed.collision, reach / 2.0),
        Cells::new(&obstructed.axis_limit, reach / 2.0),
    );
    let near = |cells: &Cells, points: &[Vector3<f64>], at: &Vector3<f64>| {
        cells.any_near(at, reach, |k| {
            (points[k] - at).norm_squared() < reach * reach
        })
    };
    let mut within = WithinLimits::new(shop);
    let mut counts = [0_usize; 6];
    for ((sights, missed), sample) in seen.sights.iter().zip(&seen.missed).zip(&shop.samples) {
        if !sights.is_empty() {
            continue;
        }
        let reason = if missed.occluded {
            0
        } else if missed.incidence {
            1
        } else if missed.range {
            2
        } else if near(&touched, &obstructed.collision, &sample.at) {
            3
        } else if near(&limited, &obstructed.axis_limit, &sample.at) && !within.sees(sample) {
            4
        } else {
            5
        };
        counts[reason] += 1;
    }
    REASONS
        .iter()
        .zip(counts)
        .filter(|(_, n)| *n > 0)
        .map(|(reason, n)| Uncovered {
            reason,
            area_mm2: n as f64 * per_sample,
        })
        .collect()
}
