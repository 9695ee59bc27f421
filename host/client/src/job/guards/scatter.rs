//! From which scatter on a worn stylus is refused.

use umi_core::job::datums;
use umi_protocol::job::{FeatureKind, FeatureSpec, Job};

use super::SeenFrom;

/// So many of a thousand setups may pass at the size that is told.
const PASSES: f64 = 0.001;

/// The scatter of a hit at which of a thousand setups one is not refused, by the rms and by
/// what was learned of rms and radius. The others' limits see it besides.
pub fn worn_stylus(job: &Job) -> SeenFrom {
    let passes = |um: f64| -> f64 {
        // One that closes or stays on the table is held to the same limits: not counted, there
        // may be none.
        datums(job)
            .map(|(_, feature)| passes(job, feature, um * 1e-3))
            .product()
    };
    // From 0.1 µm to 10 mm.
    let (mut low, mut high) = (0.1, 10_000.0);
    if passes(high) > PASSES {
        return SeenFrom::Never;
    }
    for _ in 0..60 {
        let middle = f64::midpoint(low, high);
        if passes(middle) > PASSES {
            low = middle;
        } else {
            high = middle;
        }
    }
    SeenFrom::Size(high)
}

/// Share of the features that pass when their hits scatter by `sigma_mm`.
fn passes(job: &Job, feature: &FeatureSpec, sigma_mm: f64) -> f64 {
    let parameters = match feature.kind {
        FeatureKind::Plane | FeatureKind::Circle => 3.0,
        FeatureKind::Sphere | FeatureKind::Line => 4.0,
        FeatureKind::Cylinder => 5.0,
        FeatureKind::Cone => 6.0,
    };
    let hits = f64::from(feature.hits);
    let free = hits - parameters;
    if free < 1.0 {
        return 1.0;
    }
    let taught = job.guards.probing.map_or(0.0, |probing| probing.worst_mm());
    let (rms_mm, radius) = match job.guards.learned {
        None => (job.limits.rms_mm, 1.0),
        Some(learned) => {
            // A radius rests on all hits: their mean scatters least.
            let scatter = (sigma_mm.powi(2) + taught.powi(2)).sqrt() / hits.sqrt();
            let radius = (learned.radius_mm / scatter).powi(2);
            let taught_mm = taught * (free / hits).sqrt();
            let rms_mm = job.limits.rms_mm.min(learned.rms_mm + taught_mm);
            let has_radius = matches!(feature.kind, FeatureKind::Sphere | FeatureKind::Circle);
            (rms_mm, if has_radius { chi2(radius, 1.0) } else { 1.0 })
        }
    };
    chi2(hits * (rms_mm / sigma_mm).powi(2), free) * radius
}

/// Share of a chi-square distribution below `x` (NIST DLMF 8.11.4: a series whose terms are all
/// positive).
fn chi2(x: f64, free: f64) -> f64 {
    let (a, x) = (free / 2.0, x / 2.0);
    if x > 700.0 {
        return 1.0;
    }
    // Gamma(a + 1), of whole and half numbers.
    let mut gamma = if free % 2.0 == 0.0 {
        1.0
    } else {
        std::f64::consts::PI.sqrt()
    };
    let mut factor = if free % 2.0 == 0.0 { 1.0 } else { 0.5 };
    while factor <= a {
        gamma *= factor;
        factor += 1.0;
    }
    let mut term = x.powf(a) * (-x).exp() / gamma;
    let mut sum = term;
    let mut divisor = a;
    while term > sum * 1e-16 && divisor < 10_000.0 {
        divisor += 1.0;
        term *= x / divisor;
        sum += term;
    }
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::chi2;

    /// Tables of the distribution: 68.27 % within one sigma, 95 % points of 1, 2, 5 and 32
    /// degrees of freedom.
    #[test]
    fn shares_are_those_of_the_tables() {
        for (x, free, share) in [
            (1.0, 1.0, 0.682_689_5),
            (3.841_459, 1.0, 0.95),
            (5.991_465, 2.0, 0.95),
            (11.070_498, 5.0, 0.95),
            (46.194_26, 32.0, 0.95),
            (0.0, 3.0, 0.0),
        ] {
            let got = chi2(x, free);
            assert!((got - share).abs() < 1e-6, "{x} {free}: {got}");
        }
    }
}
