//! The touch probe: when it triggers.

use nalgebra::Vector3;

use crate::scene::ProbeSpec;

/// How far the stylus is bent when the probe triggers, for the direction in which its
/// tip is pushed off the path (a unit vector into the body).
///
/// In the XY plane it has three lobes (A. Sawula, thesis 2013, figure 3.5: three
/// supports and a spring); along Z the stylus does not bend.
pub(super) fn pretravel_mm(probe: &ProbeSpec, push: &Vector3<f64>) -> f64 {
    let angle = libm::atan2(push.y, push.x) - probe.lobing_phase_deg.to_radians();
    let lateral = probe.pretravel_mm + probe.lobing_mm * libm::cos(3.0 * angle);
    let steep = push.z * push.z;
    // sin² of the elevation is in cos 2θ = (x² - y²) / (x² + y²) already.
    let oval = probe.ovality_mm * (push.x * push.x - push.y * push.y);
    (lateral * (1.0 - steep) + oval + probe.axial_pretravel_mm * steep).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and lobes over the directions of the plane, and the value along Z.
    #[test]
    fn lobes() {
        let probe = ProbeSpec {
            pretravel_mm: 0.062,
            lobing_mm: 0.005,
            lobing_phase_deg: 90.0,
            axial_pretravel_mm: 0.002,
            ..ProbeSpec::default()
        };
        let at = |degrees: f64| {
            let (s, c) = degrees.to_radians().sin_cos();
            pretravel_mm(&probe, &Vector3::new(c, s, 0.0))
        };
        for lobe in [90.0, 210.0, 330.0] {
            assert!((at(lobe) - 0.067).abs() < 1e-12);
            assert!((at(lobe + 60.0) - 0.057).abs() < 1e-12);
        }
        let oval = ProbeSpec {
            lobing_mm: 0.0,
            ovality_mm: 0.007,
            ..probe.clone()
        };
        assert!((pretravel_mm(&oval, &-Vector3::x()) - 0.069).abs() < 1e-12);
        assert!((pretravel_mm(&oval, &Vector3::y()) - 0.055).abs() < 1e-12);
        let mean = (0..36).map(|k| at(10.0 * f64::from(k))).sum::<f64>() / 36.0;
        assert!((mean - 0.062).abs() < 1e-12);
        assert!((pretravel_mm(&probe, &-Vector3::z()) - 0.002).abs() < 1e-15);
    }
}
