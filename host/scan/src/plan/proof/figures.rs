//! Figures of a path as it stands in its file.

use std::collections::HashMap;

use serde::Serialize;

use super::super::drive::axes::angle_deg;
use super::super::drive::realise::Pass;
use super::super::drive::touch::Scenery;
use super::super::spec::ScanSpec;
use super::see::SampleSights;

/// Overlap of neighbouring passes as a share of the line's length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Overlap {
    /// A tenth of the stretches have less.
    pub min: f64,
    /// The middle of all stretches.
    pub median: f64,
}

/// The overlap in stretches of 10 mm at each end of the line; none where no two passes see a point in common.
///
/// Where another pass sees the strip's edge too, the strip that both see is as wide as the points there lie apart.
pub fn overlap(spec: &ScanSpec, passes: &[&Pass], seen: &SampleSights) -> Option<Overlap> {
    let mut ways: Vec<Vec<f64>> = Vec::new();
    let mut way = 0.0;
    for pass in passes {
        let mut at = Vec::with_capacity(pass.poses.len());
        for (k, p) in pass.poses.iter().enumerate() {
            if k > 0 {
                let tip = |p: &super::super::machine::SensorPose| {
                    p.origin_mm + p.beam * spec.sensor.reference_mm
                };
                way += (tip(p) - tip(&pass.poses[k - 1])).norm();
            }
            at.push(way);
        }
        ways.push(at);
    }
    let mut bins: HashMap<(u32, u32, u64, bool), Vec<f64>> = HashMap::new();
    for sights in &seen.sights {
        for a in sights {
            for b in sights {
                if a.pass != b.pass {
                    let stretch = (ways[a.pass as usize][a.step as usize] / 10.0) as u64;
                    bins.entry((a.pass, b.pass, stretch, a.lateral > 0.0))
                        .or_default()
                        .push(a.lateral.abs());
                }
            }
        }
    }
    let mut widths: HashMap<(u32, u64, bool), f64> = HashMap::new();
    for ((pass, _, stretch, side), laterals) in bins {
        let edge = laterals.iter().copied().fold(0.0, f64::max);
        let inner = laterals.iter().copied().fold(f64::INFINITY, f64::min);
        if edge > 0.7 && laterals.len() >= 3 {
            let width = widths.entry((pass, stretch, side)).or_insert(0.0);
            *width = width.max((edge - inner) / 2.0);
        }
    }
    let mut sorted: Vec<f64> = widths.into_values().collect();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let place = share * (sorted.len() - 1) as f64;
        let (low, high) = (
            sorted[place.floor() as usize],
            sorted[place.ceil() as usize],
        );
        low + (high - low) * place.fract()
    };
    (!sorted.is_empty()).then(|| Overlap {
        min: at(0.1),
        median: at(0.5),
    })
}

/// How the poses stand to the part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stand {
    /// Largest difference of the middle ray from the reference distance.
    pub stand_off_max_mm: f64,
    /// Largest angle of the middle ray against the facet that it meets.
    pub tilt_max_deg: f64,
    /// Poses whose middle ray meets no part.
    pub off_part: usize,
}

/// Follows the middle ray of every pose.
pub fn stand(spec: &ScanSpec, scenery: &Scenery<'_>, passes: &[&Pass]) -> Stand {
    let mut stand = Stand {
        stand_off_max_mm: 0.0,
        tilt_max_deg: 0.0,
        off_part: 0,
    };
    let part = scenery.meshes[0];
    for pose in passes.iter().flat_map(|p| &p.poses) {
        match part.first_hit(&pose.origin_mm, &pose.beam, spec.sensor.range_mm[1] * 1.5) {
            Some(hit) => {
                let off = (hit.at - spec.sensor.reference_mm).abs();
                let tilt = angle_deg(&-pose.beam, &part.triangles()[hit.face].normal);
                stand.stand_off_max_mm = stand.stand_off_max_mm.max(off);
                stand.tilt_max_deg = stand.tilt_max_deg.max(tilt);
            }
            None => stand.off_part += 1,
        }
    }
    stand
}
