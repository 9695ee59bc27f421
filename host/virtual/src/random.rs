//! Noise, the same for the same seed.

/// A seeded source of noise.
#[derive(Clone, Debug)]
pub struct Random(fastrand::Rng);

impl Random {
    /// From this seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(fastrand::Rng::with_seed(seed))
    }

    /// Evenly between two values.
    pub fn between(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * self.0.f64()
    }

    /// Normally distributed about 0, of this standard deviation (Box and Muller,
    /// Annals of Mathematical Statistics 29, 1958).
    pub fn normal(&mut self, sigma: f64) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.0.f64()));
        sigma * radius * libm::cos(2.0 * std::f64::consts::PI * self.0.f64())
    }
}
