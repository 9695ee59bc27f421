//! Why samples are not seen, by reason and area.

use nalgebra::Vector3;
use serde::Serialize;

use super::super::drive::realise::Obstructed;
use super::super::proof::cells::Cells;
use super::super::proof::see::SampleSights;
use super::Workshop;

/// An area that no pass sees, and the reason.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Uncovered {
    /// `occluded`, `incidence`, `range`, `collision`, `axis_limit` or `unreached`.
    pub reason: &'static str,
    /// How much of the surface.
    pub area_mm2: f64,
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
        "axis_limit",
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
        } else if near(&limited, &obstructed.axis_limit, &sample.at) {
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
