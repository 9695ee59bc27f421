//! What the sensor adds to what its camera sees.

use super::{LineProfile, Optics};
use crate::random::Random;
use crate::scene::LineScannerSpec;

/// A step between neighbours of more pitches than this is an edge.
const EDGE_PITCHES: f64 = 5.0;
/// At a flatter incidence the noise does not grow any more.
const LEAST_COSINE: f64 = 0.05;

/// Adds noise, speckle and mixed samples, along each sample's column.
pub fn add(profile: &mut LineProfile, optics: &Optics, random: &mut Random) {
    let spec = optics.spec();
    mix_edges(profile, spec, random);
    let kept = if spec.speckle_samples > 0.0 {
        libm::exp(-1.0 / spec.speckle_samples)
    } else {
        0.0
    };
    let mut speckle = random.normal(spec.speckle_um * 1e-3);
    for (column, sample) in profile.iter_mut().enumerate() {
        // It goes on where there is no range: it is the surface's, and neighbours share it.
        speckle =
            kept * speckle + libm::sqrt(1.0 - kept * kept) * random.normal(spec.speckle_um * 1e-3);
        let noise = random.normal(1.0);
        let Some(sample) = sample else { continue };
        let sigma_mm = LineScannerSpec::between(spec.noise_um, spec.depth(sample.z_mm)) * 1e-3
            / sample.cosine.max(LEAST_COSINE);
        let before = optics.place(column, sample.z_mm);
        sample.z_mm += noise * sigma_mm + speckle;
        sample.x_mm += optics.place(column, sample.z_mm) - before;
    }
}

/// Some samples beside a step lie between both sides of it.
fn mix_edges(profile: &mut LineProfile, spec: &LineScannerSpec, random: &mut Random) {
    if spec.edge_share == 0.0 {
        return;
    }
    let seen = profile.clone();
    for (place, pair) in profile.iter_mut().zip(seen.windows(2)) {
        let (Some(sample), [Some(here), Some(next)]) = (place.as_mut(), pair) else {
            continue;
        };
        let pitch_mm = LineScannerSpec::between(spec.pitch_um, spec.depth(here.z_mm)) * 1e-3;
        let is_edge = (here.z_mm - next.z_mm).abs() > EDGE_PITCHES * pitch_mm;
        if is_edge && random.between(0.0, 1.0) < spec.edge_share {
            let share = random.between(0.0, 1.0);
            sample.x_mm += share * (next.x_mm - here.x_mm);
            sample.z_mm += share * (next.z_mm - here.z_mm);
        }
    }
}
