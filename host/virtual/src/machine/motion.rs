//! One motion in time: where the axes are sent and where they are.
//!
//! The way along a path is sent with constant acceleration up to the feed and down to
//! rest. The axes follow with a first-order lag of the same gain K in all axes (Kv of
//! the position loop), so a straight path stays straight and the way travelled `y`
//! follows the way sent `x` as `y' = K (x - y)`. On a stretch of constant acceleration
//! a, with speed v₀ and lag e₀ at its start, the lag is
//!
//! ```text
//! e(τ) = v/K - a/K² + (e₀ - v₀/K + a/K²) exp(-K τ),    v = v₀ + a τ
//! ```

/// Lag at which a motion counts as finished, mm.
const IN_POSITION_MM: f64 = 1e-6;

/// A motion along a way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Profile {
    stretches: [Stretch; 3],
    gain_per_s: f64,
    length_mm: f64,
    /// When it is in position.
    pub duration_s: f64,
    pub acceleration_mm_per_s2: f64,
}

/// A time of constant acceleration.
#[derive(Clone, Copy, Debug, Default)]
struct Stretch {
    start_s: f64,
    duration_s: f64,
    way_mm: f64,
    speed: f64,
    acceleration: f64,
    lag_mm: f64,
}

impl Stretch {
    fn sent(&self, tau: f64) -> (f64, f64) {
        (
            self.way_mm + tau * (self.speed + 0.5 * self.acceleration * tau),
            self.speed + self.acceleration * tau,
        )
    }

    fn lag(&self, tau: f64, gain: f64) -> f64 {
        if gain == 0.0 {
            return 0.0;
        }
        let (_, speed) = self.sent(tau);
        let steady = self.acceleration / (gain * gain);
        speed / gain - steady + (self.lag_mm - self.speed / gain + steady) * libm::exp(-gain * tau)
    }
}

impl Profile {
    /// A motion over this way at this speed.
    pub fn new(length_mm: f64, speed: f64, acceleration: f64, gain_per_s: f64) -> Self {
        // A short way ends before the speed is reached.
        let speed = speed.min(libm::sqrt(length_mm * acceleration));
        let ramp_s = speed / acceleration;
        let ramp_mm = 0.5 * speed * ramp_s;
        let level_mm = (length_mm - 2.0 * ramp_mm).max(0.0);
        let level_s = if speed > 0.0 { level_mm / speed } else { 0.0 };
        let mut profile = Self {
            stretches: [Stretch::default(); 3],
            gain_per_s,
            length_mm,
            duration_s: 2.0 * ramp_s + level_s,
            acceleration_mm_per_s2: acceleration,
        };
        let (mut start_s, mut way_mm, mut lag_mm) = (0.0, 0.0, 0.0);
        let plan = [
            (ramp_s, 0.0, acceleration),
            (level_s, speed, 0.0),
            (ramp_s, speed, -acceleration),
        ];
        for (stretch, (duration_s, speed, acceleration)) in profile.stretches.iter_mut().zip(plan) {
            *stretch = Stretch {
                start_s,
                duration_s,
                way_mm,
                speed,
                acceleration,
                lag_mm,
            };
            start_s += duration_s;
            (way_mm, _) = stretch.sent(duration_s);
            lag_mm = stretch.lag(duration_s, gain_per_s);
        }
        if gain_per_s > 0.0 && lag_mm > IN_POSITION_MM {
            profile.duration_s += libm::log(lag_mm / IN_POSITION_MM) / gain_per_s;
        }
        profile
    }

    /// Way sent and its speed after this time.
    pub fn sent(&self, time_s: f64) -> (f64, f64) {
        let (stretch, tau) = self.at(time_s);
        if tau > stretch.duration_s {
            return (self.length_mm, 0.0);
        }
        stretch.sent(tau)
    }

    /// Way travelled after this time.
    pub fn travelled_mm(&self, time_s: f64) -> f64 {
        let (stretch, tau) = self.at(time_s);
        let within = tau.min(stretch.duration_s);
        let lag =
            stretch.lag(within, self.gain_per_s) * libm::exp(-self.gain_per_s * (tau - within));
        let (sent, _) = self.sent(time_s);
        (sent - lag).clamp(0.0, self.length_mm)
    }

    /// When the axes have travelled this far; the end at the latest.
    pub fn time_at_s(&self, way_mm: f64) -> f64 {
        let (mut early, mut late) = (0.0, self.duration_s);
        // The way travelled never goes back: halving finds it to the last bits.
        for _ in 0..100 {
            let middle = 0.5 * (early + late);
            if self.travelled_mm(middle) < way_mm {
                early = middle;
            } else {
                late = middle;
            }
        }
        late
    }

    fn at(&self, time_s: f64) -> (&Stretch, f64) {
        let [first, second, third] = &self.stretches;
        let stretch = if time_s < second.start_s {
            first
        } else if time_s < third.start_s {
            second
        } else {
            third
        };
        (stretch, (time_s - stretch.start_s).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without lag, way and time agree with the formulas of constant acceleration.
    #[test]
    fn trapezoid() {
        // 100 mm at 10 mm/s, 20 mm/s²: 0.5 s and 2.5 mm per ramp, 9.5 s level.
        let profile = Profile::new(100.0, 10.0, 20.0, 0.0);
        assert!((profile.duration_s - 10.5).abs() < 1e-12);
        assert!((profile.travelled_mm(0.5) - 2.5).abs() < 1e-12);
        assert!((profile.travelled_mm(5.25) - 50.0).abs() < 1e-12);
        assert!((profile.time_at_s(50.0) - 5.25).abs() < 1e-12);
        assert!((profile.travelled_mm(99.0) - 100.0).abs() < 1e-12);
        // 1 mm is too short for 10 mm/s.
        let short = Profile::new(1.0, 10.0, 20.0, 0.0);
        assert!((short.duration_s - 2.0 * libm::sqrt(1.0 / 20.0)).abs() < 1e-12);
    }

    /// The lag is the solution of y' = K (x - y): held against small steps.
    #[test]
    fn lag_follows_its_equation() {
        let (gain, step) = (30.0, 1e-6);
        let profile = Profile::new(5.0, 16.0, 500.0, gain);
        let (mut time, mut y) = (0.0, 0.0);
        while time < profile.duration_s {
            // Midpoint rule.
            let half = y + 0.5 * step * gain * (profile.sent(time).0 - y);
            y += step * gain * (profile.sent(time + 0.5 * step).0 - half);
            time += step;
            assert!((profile.travelled_mm(time) - y).abs() < 1e-7, "{time}");
        }
        // At speed the lag is v / K.
        let (sent, speed) = profile.sent(0.2);
        assert!((sent - profile.travelled_mm(0.2) - speed / gain).abs() < 0.01);
    }

    /// Time and way are inverse to each other all along.
    #[test]
    fn time_and_way_are_inverse() {
        for gain in [0.0, 30.0] {
            let profile = Profile::new(12.0, 1.5, 300.0, gain);
            for percent in 1..100 {
                let way = 0.12 * f64::from(percent);
                let time = profile.time_at_s(way);
                assert!((profile.travelled_mm(time) - way).abs() < 1e-9);
            }
        }
    }
}
