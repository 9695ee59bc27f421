//! Scatter of positioning: the true place of axes at a programmed one.

use nalgebra::Vector3;

/// The scatter of a machine's positioning: every time the axes come to an end of a
/// motion, each is off by a normally distributed amount, independent of the last
/// (repeatability of positioning, ISO 230-2). The same seed gives the same errors.
#[derive(Clone, Debug)]
pub struct Wander {
    sigma_mm: f64,
    state: u64,
}

impl Wander {
    /// Errors with this standard deviation on each axis, mm.
    #[must_use]
    pub fn new(sigma_mm: f64, seed: u64) -> Self {
        Self {
            sigma_mm,
            state: seed,
        }
    }

    /// The errors of the next position, mm.
    pub(super) fn next(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.sigma_mm * self.normal())
    }

    /// A normally distributed number (G. E. P. Box, M. E. Muller, Ann. Math. Stat. 29,
    /// 1958).
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// A number above 0 and up to 1 (SplitMix64: G. L. Steele and others, OOPSLA 2014).
    #[allow(clippy::cast_precision_loss, reason = "53 bits fit")]
    fn uniform(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        ((z >> 11) + 1) as f64 / (1_u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean, standard deviation and tails are those of the normal distribution, and
    /// a seed repeats.
    #[test]
    fn errors_are_normal_and_repeat() {
        let mut wander = Wander::new(0.5, 7);
        let errors: Vec<f64> = (0..20_000).map(|_| wander.next().x / 0.5).collect();
        let n = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / n;
        let variance = errors.iter().map(|e| e * e).sum::<f64>() / n;
        let beyond = errors.iter().filter(|e| e.abs() > 2.0).count() as f64 / n;
        assert!(mean.abs() < 0.03, "{mean}");
        assert!((variance - 1.0).abs() < 0.04, "{variance}");
        assert!((beyond - 0.0455).abs() < 0.006, "{beyond}");
        let (mut one, mut same) = (Wander::new(1.0, 3), Wander::new(1.0, 3));
        assert_eq!(one.next(), same.next());
        assert_ne!(one.next(), Wander::new(1.0, 4).next());
    }
}
