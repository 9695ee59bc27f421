//! A distance sensor in the spindle: what it reads of a scene, or why it reads nothing.
//!
//! The beam starts at the zero of the readings, [`offset_mm`](PointSensorSpec::offset_mm)
//! away from the position of the axes. Its reading is the way along the beam to the first
//! surface. What the model adds to the truth:
//!
//! * **Linearity**: a smooth curve over the depth of field, of [`linearity_percent`] of it
//!   at most; the sensor's own, by its seed.
//! * **Gain**: a true length is a reading times 1 + `gain_error_ppm` · 10⁻⁶.
//! * **Noise** of one capture: `noise_um` at the stand-off and at normal incidence. It grows
//!   to twice at the ends of the depth of field (defocus goes with the square of the place),
//!   and with 1/cos of the incidence (less light comes back, from a longer spot).
//! * **Spot**: a reading is the mean over the spot. Across an edge it lies between both
//!   surfaces, as with a real one.
//! * **Light**: Total is proportional to power, exposure (1/rate) and the cosine of the
//!   incidence, and falls by 0.4 to the ends of the depth of field. SNR, in per cent, is
//!   Total over itself and a half light. Below a least Total there is no reading.
//!
//! Figures of conoscopic sensors, to set it by: Zapico and others, "CNC centralized control
//! for digitizing freeform surfaces", table 1.
//!
//! [`linearity_percent`]: PointSensorSpec::linearity_percent

pub mod area;
mod reading;
#[cfg(test)]
mod tests;

use nalgebra::Vector3;

use crate::random::Random;
use crate::scene::{BeamEnd, PointSensorSpec, Scene};

pub use reading::{NoSignal, SensorCaptures, SensorFault, SensorSignal};

/// A sensor and its noise: the same seed, the same sensor.
#[derive(Clone, Debug)]
pub struct PointSensorHead {
    spec: PointSensorSpec,
    direction: Vector3<f64>,
    /// Phases of the linearity curve.
    phases: [f64; HARMONICS],
    random: Random,
}

/// Half waves of the linearity curve over the depth of field: 1 to this.
const HARMONICS: usize = 4;

/// Total of a capture at full power, 1000 Hz, normal incidence, at the stand-off.
const FULL_TOTAL: f64 = 16_000.0;

/// What of the light is missing at the ends of the depth of field.
const FALL_OFF: f64 = 0.4;

/// Below this Total there is no reading.
const LEAST_TOTAL: f64 = 100.0;

/// Total at which the SNR is 50 %.
const HALF_TOTAL: f64 = 400.0;

/// Distance of the outer rays of a spot from its middle, in its full width at half
/// maximum: four rays at this distance and one in the middle, of equal weight, have the
/// variance of a Gaussian beam of that width.
const SPOT_RAY: f64 = 0.671_4;

/// What a sensor at rest sees, without the noise of a capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StillView {
    signal: SensorSignal,
    sigma_mm: f64,
}

/// How a capture is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Captures per second.
    pub rate_hz: f64,
    /// Power of the laser, up to [`PointSensorSpec::power_max`].
    pub power: f64,
}

impl PointSensorHead {
    /// A sensor; its linearity curve and its noise come with the seed.
    #[must_use]
    pub fn new(spec: PointSensorSpec, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let turn = 2.0 * std::f64::consts::PI;
        let phases = std::array::from_fn(|_| random.between(0.0, turn));
        Self {
            direction: Vector3::from(spec.direction).normalize(),
            spec,
            phases,
            random,
        }
    }

    /// What the sensor is.
    #[must_use]
    pub const fn spec(&self) -> &PointSensorSpec {
        &self.spec
    }

    /// What every capture with the axes at rest here sees.
    ///
    /// # Errors
    /// As [`Self::capture`].
    pub fn still(
        &self,
        scene: &Scene,
        axes_mm: &Vector3<f64>,
        exposure: Exposure,
    ) -> Result<StillView, SensorFault> {
        let (signal, sigma_mm) = self.look(scene, axes_mm, exposure)?;
        Ok(StillView { signal, sigma_mm })
    }

    /// One capture of what is seen at rest: each has its own noise.
    pub fn again(&mut self, view: &StillView) -> SensorSignal {
        let mut signal = view.signal;
        signal.gamma_mm += self.random.normal(view.sigma_mm);
        signal
    }

    /// One capture with the axes at rest at `axes_mm`.
    ///
    /// # Errors
    /// No signal, and why; or a rate or power that the sensor does not have.
    pub fn capture(
        &mut self,
        scene: &Scene,
        axes_mm: &Vector3<f64>,
        exposure: Exposure,
    ) -> Result<SensorSignal, SensorFault> {
        let (mut signal, sigma_mm) = self.look(scene, axes_mm, exposure)?;
        signal.gamma_mm += self.random.normal(sigma_mm);
        Ok(signal)
    }

    /// So many captures at rest, and their mean and spread.
    ///
    /// # Errors
    /// As [`Self::capture`]; no captures at all are refused, too.
    pub fn captures(
        &mut self,
        scene: &Scene,
        axes_mm: &Vector3<f64>,
        exposure: Exposure,
        number: u32,
    ) -> Result<SensorCaptures, SensorFault> {
        if number == 0 {
            return Err(SensorFault::NoCaptures);
        }
        // At rest every capture sees the same; each has its own noise.
        let (signal, sigma_mm) = self.look(scene, axes_mm, exposure)?;
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..number {
            let noise = self.random.normal(sigma_mm);
            sum += noise;
            squares += noise * noise;
        }
        let count = f64::from(number);
        let mean = sum / count;
        Ok(SensorCaptures {
            signal: SensorSignal {
                gamma_mm: signal.gamma_mm + mean,
                ..signal
            },
            spread_mm: (squares / count - mean * mean).max(0.0).sqrt(),
            count: number,
        })
    }

    /// The signal without noise, and the noise of one capture.
    fn look(
        &self,
        scene: &Scene,
        axes_mm: &Vector3<f64>,
        exposure: Exposure,
    ) -> Result<(SensorSignal, f64), SensorFault> {
        let spec = &self.spec;
        let (rate, power) = (exposure.rate_hz, exposure.power);
        if !(rate > 0.0 && rate <= spec.max_rate_hz) {
            return Err(SensorFault::RateTooHigh {
                rate_hz: rate,
                max_rate_hz: spec.max_rate_hz,
            });
        }
        if !(power >= 0.0 && power <= spec.power_max) {
            return Err(SensorFault::PowerTooHigh {
                power,
                power_max: spec.power_max,
            });
        }
        let zero = axes_mm + Vector3::from(spec.offset_mm);
        let seen = self.way(scene, &zero).map_err(SensorFault::NoSignal)?;
        let cos = -seen.normal.dot(&self.direction);
        let steepest = spec.angle_deg.to_radians().cos();
        // On a surface that the beam only grazes nothing comes back either.
        if cos < steepest || cos <= 0.0 {
            return Err(SensorFault::NoSignal(NoSignal::TooSteep));
        }
        // Place in the depth of field, -1 to 1.
        let place = (seen.way_mm - spec.stand_off_mm) / (spec.range_mm / 2.0);
        let total = FULL_TOTAL
            * (power / spec.power_max)
            * (1000.0 / rate)
            * cos
            * (1.0 - FALL_OFF * place * place);
        if total < LEAST_TOTAL {
            return Err(SensorFault::NoSignal(NoSignal::Underexposed));
        }
        let mean = self.spot(scene, &zero, seen.way_mm);
        let gain = 1.0 + spec.gain_error_ppm * 1e-6;
        let signal = SensorSignal {
            gamma_mm: (mean + self.linearity_mm(place)) / gain,
            snr: 100.0 * total / (total + HALF_TOTAL),
            total,
        };
        let sigma_mm = spec.noise_um * 1e-3 * (1.0 + place * place) / cos;
        Ok((signal, sigma_mm))
    }

    /// The way to the first surface, within the depth of field.
    fn way(&self, scene: &Scene, zero: &Vector3<f64>) -> Result<BeamEnd, NoSignal> {
        let spec = &self.spec;
        let near = spec.stand_off_mm - spec.range_mm / 2.0;
        let far = spec.stand_off_mm + spec.range_mm / 2.0;
        // The beam leaves the sensor at its zero, or at the lens where that lies behind.
        let Some((body, first)) = scene.beam(zero, &self.direction, far, |_| true) else {
            return Err(NoSignal::OutOfRange);
        };
        if first.way_mm < near {
            // Something stands in the way of a surface that would be in range.
            let from = zero + self.direction * near;
            let behind = scene.beam(&from, &self.direction, far - near, |other| other != body);
            return Err(if behind.is_some_and(|(_, end)| end.way_mm > 0.0) {
                NoSignal::Occluded
            } else {
                NoSignal::OutOfRange
            });
        }
        Ok(first)
    }

    /// The mean way over the spot, of the rays that come back from the depth of field.
    fn spot(&self, scene: &Scene, zero: &Vector3<f64>, middle_mm: f64) -> f64 {
        let radius_mm = SPOT_RAY * self.spec.spot_um * 1e-3;
        if radius_mm == 0.0 {
            return middle_mm;
        }
        let helper = if self.direction.x.abs() < 0.5 {
            Vector3::x()
        } else {
            Vector3::y()
        };
        let e1 = self.direction.cross(&helper).normalize();
        let e2 = self.direction.cross(&e1);
        let (mut sum, mut count) = (middle_mm, 1.0);
        for aside in [e1, -e1, e2, -e2] {
            if let Ok(seen) = self.way(scene, &(zero + aside * radius_mm)) {
                sum += seen.way_mm;
                count += 1.0;
            }
        }
        sum / count
    }

    /// Error of the reading at a place in the depth of field (-1 to 1).
    fn linearity_mm(&self, place: f64) -> f64 {
        let most = self.spec.linearity_percent / 100.0 * self.spec.range_mm;
        let mut number = 0.0;
        let mut sum = 0.0;
        for phase in self.phases {
            number += 1.0;
            sum += libm::sin(number * std::f64::consts::FRAC_PI_2 * place + phase) / number;
        }
        // 1 + 1/2 + 1/3 + 1/4: the sum is never more.
        most * sum / (25.0 / 12.0)
    }
}
