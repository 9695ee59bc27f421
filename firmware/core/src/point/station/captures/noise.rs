//! The noise of readings beside a surface that moves, and jumps.

/// Smallest difference that is told from none, as a power of two of a millimetre: readings have six decimals.
const LEAST: i32 = -21;

/// Octaves of differences, up to 4 m.
const OCTAVES: usize = 33;

/// Differences beyond these count less and less: the noise of a place is that of the places beside it.
const RECENT: u32 = 96;

/// The median of |second difference| over σ: √6 times that of a standard normal one.
const MEDIAN: f64 = 2.449_489_742_783_178 * 0.674_489_750_196_081_7;

/// The second differences of the latest neighbouring readings, counted by their octave.
///
/// Their median is the noise whatever jumps there are among them, as long as most are none.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noise {
    counts: [u32; OCTAVES],
    total: u32,
}

impl Default for Noise {
    fn default() -> Self {
        Self {
            counts: [0; OCTAVES],
            total: 0,
        }
    }
}

impl Noise {
    /// A second difference, mm.
    pub fn add(&mut self, difference: f64) {
        let octave = libm::ilogb(difference).max(LEAST).saturating_sub(LEAST);
        let octave = usize::try_from(octave).unwrap_or_default();
        if let Some(count) = self.counts.get_mut(octave.min(OCTAVES - 1)) {
            *count = count.saturating_add(1);
            self.total = self.total.saturating_add(1);
        }
    }

    /// A cell is over: where there are many differences, each counts half from now on.
    pub fn fade(&mut self) {
        if self.total > RECENT {
            for count in &mut self.counts {
                *count /= 2;
            }
            let counts = self.counts.iter();
            self.total = counts.fold(0, |total, count| count.saturating_add(total));
        }
    }

    /// The standard deviation of a reading, mm: by the median, at its place within its octave.
    fn sigma(&self) -> f64 {
        let half = f64::from(self.total) / 2.0;
        let (mut below, mut octave_mm) = (0.0, libm::ldexp(1.0, LEAST));
        for count in self.counts.map(f64::from) {
            if count > 0.0 && below + count >= half {
                return octave_mm * (1.0 + (half - below) / count) / MEDIAN;
            }
            below += count;
            octave_mm *= 2.0;
        }
        0.0
    }

    /// How much captures may scatter about their parabola, mm. The median of n differences scatters by about 2 / √n of
    /// itself, and noise may differ between cells by its half: five standard deviations of that.
    pub fn most(&self) -> f64 {
        self.sigma() * (2.0 + 10.0 / libm::sqrt(f64::from(self.total).max(1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::Noise;
    use crate::fit::tests::Random;

    /// The median says σ to a few per cent, with every fifth difference a jump as well to a third.
    #[test]
    fn the_median_is_the_noise() {
        let random = &mut Random(3);
        for sigma in [1e-5, 3e-4, 1e-3, 0.07] {
            let (mut clean, mut jumps) = (Noise::default(), Noise::default());
            for count in 0..5000 {
                let [a, b, c] = [(); 3].map(|()| sigma * random.normal());
                let second = a - 2.0 * b + c;
                clean.add(second);
                jumps.add(if count % 5 == 0 { 20.0 } else { second });
            }
            assert!(
                (clean.sigma() / sigma - 1.0).abs() < 0.12,
                "{sigma} {}",
                clean.sigma()
            );
            assert!(
                (1.0..1.45).contains(&(jumps.sigma() / sigma)),
                "{sigma} {}",
                jumps.sigma()
            );
        }
    }
}
