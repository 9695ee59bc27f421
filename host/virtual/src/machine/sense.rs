//! The distance sensor in the spindle: captures at rest and on the way, and the skip input that
//! the board raises for it.
//!
//! A capture is an instant. Between the edge of the skip input and the axes' rest no captures
//! are taken.

use nalgebra::Vector3;
use umi_core::units::Point;

use super::collide::Along;
use super::motion::Profile;
use super::wires::{SensorOrder, SensorPulses};
use super::{Spindle, VirtualMachine, Wires, micros};
use crate::nc::{AxisMotion, Skip, Trip};
use crate::random::Random;
use crate::scene::PointSensorSpec;
use crate::sensor::{Exposure, PointSensorHead, SensorFault, StillView};

/// Radius of the sensor's barrel about its beam: that of a lens of 25 mm in its mount.
const BARREL_MM: f64 = 15.0;

/// Balls around the edge of its front, and their radius.
const RIM_BALLS: u32 = 12;
const RIM_MM: f64 = 3.0;

/// A board that has not answered after this long never does.
const NO_ANSWER_S: f64 = 10.0;

/// The sensor at work.
#[derive(Debug)]
pub(super) struct Sensing {
    head: PointSensorHead,
    random: Random,
    /// When the last capture was.
    last_s: f64,
    /// What is seen where the axes rest.
    view: Option<(Exposure, Result<StillView, SensorFault>)>,
    /// How far the axes rest from where they say.
    off: Vector3<f64>,
    housing: Vec<(Vector3<f64>, f64)>,
}

impl Sensing {
    pub fn new(spec: PointSensorSpec, seed: u64) -> Self {
        Self {
            housing: housing(&spec),
            head: PointSensorHead::new(spec, seed),
            random: Random::new(seed ^ 0x5EED),
            last_s: f64::NEG_INFINITY,
            view: None,
            off: Vector3::zeros(),
        }
    }

    /// The housing as balls, from the gauge line to their centres, and their radii.
    pub fn housing(&self) -> &[(Vector3<f64>, f64)] {
        &self.housing
    }

    fn next_s(&self, exposure: Exposure, from_s: f64) -> f64 {
        (self.last_s + 1.0 / exposure.rate_hz).max(from_s)
    }
}

/// A barrel about the beam, from the zero of the readings up to the height of the gauge line.
fn housing(spec: &PointSensorSpec) -> Vec<(Vector3<f64>, f64)> {
    let zero = Vector3::from(spec.offset_mm);
    let back = -Vector3::from(spec.direction).normalize();
    let helper = if back.x.abs() < 0.5 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let e1 = back.cross(&helper).normalize();
    let e2 = back.cross(&e1);
    let mut balls: Vec<_> = (0..RIM_BALLS)
        .map(|k| {
            let turn = 2.0 * std::f64::consts::PI * f64::from(k) / f64::from(RIM_BALLS);
            let out = e1 * libm::cos(turn) + e2 * libm::sin(turn);
            (zero + back * RIM_MM + out * (BARREL_MM - RIM_MM), RIM_MM)
        })
        .collect();
    let length = zero.norm().max(2.0 * BARREL_MM);
    let mut up = BARREL_MM;
    while up < length {
        balls.push((zero + back * up, BARREL_MM));
        up += BARREL_MM / 2.0;
    }
    balls
}

impl<W: Wires> VirtualMachine<W> {
    fn sensor_order(&self) -> Option<SensorOrder> {
        (self.spindle == Spindle::Sensor)
            .then(|| self.wires.sensor_order())
            .flatten()
    }

    /// The axes stand: not quite where they say.
    pub(super) fn sense_arrived(&mut self) {
        let sigma_mm = self.scene.machine.position_noise_um * 0.5e-3;
        if let Some(sensing) = &mut self.sensing {
            sensing.view = None;
            if sigma_mm > 0.0 {
                sensing.off = Vector3::from_fn(|_, _| sensing.random.normal(sigma_mm));
            }
        }
    }

    /// Captures by time while the axes stand.
    pub(super) fn sense_at_rest(&mut self, until_s: f64) {
        while let Some(SensorOrder {
            exposure,
            pulses: SensorPulses::Time,
        }) = self.sensor_order()
        {
            let at = self.position;
            let truly = at + self.truth(&at);
            let (counts, seconds) = (self.counts(&at), self.seconds);
            let Some(sensing) = &mut self.sensing else {
                return;
            };
            let next_s = sensing.next_s(exposure, seconds);
            if next_s > until_s {
                return;
            }
            sensing.last_s = next_s;
            let view = match sensing.view {
                Some((with, view)) if with == exposure => view,
                _ => {
                    let truly = truly + sensing.off;
                    let view = sensing.head.still(&self.scene, &truly, exposure);
                    sensing.view = Some((exposure, view));
                    view
                }
            };
            let read = view.map(|view| sensing.head.again(&view));
            self.wires.captured(micros(next_s), counts, read);
        }
    }

    /// Captures on the way, up to a time of it.
    pub(super) fn sense_along(&mut self, chain: &[Vector3<f64>], profile: &Profile, until_s: f64) {
        self.sense_until(chain, profile, until_s, false);
    }

    /// Captures on the way; when the skip input rises, if that is looked for.
    fn sense_until(
        &mut self,
        chain: &[Vector3<f64>],
        profile: &Profile,
        until_s: f64,
        looks: bool,
    ) -> Option<f64> {
        let mut along = Along::new(chain);
        let mut lines: Option<std::vec::IntoIter<(f64, i64)>> = None;
        loop {
            let order = self.sensor_order()?;
            let (after_s, line) = match order.pulses {
                SensorPulses::Time => {
                    let next_s = self.sensing.as_ref()?.next_s(order.exposure, self.seconds);
                    (next_s - self.seconds, None)
                }
                SensorPulses::Distance {
                    origin_counts,
                    interval_counts,
                } => {
                    if lines.is_none() {
                        let all = self.crossings(chain, origin_counts, interval_counts);
                        lines = Some(all.into_iter());
                    }
                    let (way_mm, count) = lines.as_mut()?.next()?;
                    (profile.time_at_s(way_mm), Some(count))
                }
            };
            if after_s >= until_s {
                return None;
            }
            let at = along.at(profile.travelled_mm(after_s));
            let mut counts = self.counts(&at);
            if let (Some(line), Some(count)) = (line, counts.first_mut()) {
                // It is there by definition; rounding must not put it one beside.
                *count = line;
            }
            let truly = at + self.truth(&at);
            let now_s = self.seconds + after_s;
            let sensing = self.sensing.as_mut()?;
            sensing.last_s = now_s;
            let truly = truly + sensing.off;
            let read = sensing.head.capture(&self.scene, &truly, order.exposure);
            self.wires.captured(micros(now_s), counts, read);
            if looks && self.wires.skip_input() {
                return Some(after_s);
            }
        }
    }

    /// Where a straight way crosses lines across X: way and count, in its order.
    fn crossings(
        &self,
        chain: &[Vector3<f64>],
        origin_counts: i64,
        interval_counts: i64,
    ) -> Vec<(f64, i64)> {
        let (Some(from), Some(to)) = (chain.first(), chain.last()) else {
            return Vec::new();
        };
        let [encoder, _, _] = self.encoders();
        let length = (to - from).norm();
        let cell = |x: f64| (encoder.counts(x) - origin_counts).div_euclid(interval_counts);
        let (first, last) = (cell(from.x), cell(to.x));
        let range: Vec<i64> = if last > first {
            (first + 1..=last).collect()
        } else {
            (last + 1..=first).rev().collect()
        };
        range
            .into_iter()
            .map(|k| {
                let count = origin_counts + k * interval_counts;
                let x = (count - encoder.origin_counts) as f64 / encoder.counts_per_mm;
                ((x - from.x) / (to.x - from.x) * length, count)
            })
            .collect()
    }

    /// A motion with skip: the board raises the input.
    pub(super) fn sensor_skip(&mut self, motion: &AxisMotion) -> Result<Skip, Trip> {
        let (from, to) = (self.position, motion.to.mm);
        let length = (to - from).norm();
        if self.wires.skip_input() || length == 0.0 {
            return Ok(Skip {
                touched: self.wires.skip_input(),
                stored: Point { mm: self.position },
            });
        }
        let profile = self.profile(length, motion.rate)?;
        let chain = [from, to];
        // The housing is looked at over the whole way: what stands there stops the axes first.
        let (until_s, stop) = match self.stem_collision(&from, &to) {
            Some((share, trip)) => (profile.time_at_s(share * length), Some((share, trip))),
            None => (profile.duration_s, None),
        };
        let Some(edge_s) = self.sense_until(&chain, &profile, until_s, true) else {
            self.wait(until_s);
            let share = stop.as_ref().map_or(1.0, |(share, _)| *share);
            self.arrive(from + (to - from) * share);
            return match stop {
                Some((_, trip)) => Err(trip),
                None => Ok(Skip {
                    touched: false,
                    stored: motion.to,
                }),
            };
        };
        let direction = (to - from) / length;
        let read_s = self.notices_s(edge_s);
        let (sent_mm, speed) = profile.sent(read_s);
        let braking_s = speed / profile.acceleration_mm_per_s2;
        let rest_mm = (sent_mm + 0.5 * speed * braking_s).min(length);
        let stored = from + direction * self.stored_mm(&profile, read_s);
        self.wait(read_s + braking_s);
        self.arrive(from + direction * rest_mm);
        if let Some((share, trip)) = stop
            && rest_mm > share * length
        {
            return Err(trip);
        }
        Ok(Skip {
            touched: true,
            stored: Point { mm: stored },
        })
    }

    /// A program over the serial line: the control asks with DC1 and waits.
    pub(super) fn read_program(&mut self, number: u32) -> Result<Option<Vec<u8>>, Trip> {
        let control = &self.scene.control;
        let character_s = f64::from(control.bits) / f64::from(control.baud);
        self.pass(character_s);
        let asked_s = self.seconds;
        loop {
            let now = self.now();
            if let Some(served) = self.wires.program(now, number) {
                self.pass(character_s * served.bytes.len() as f64);
                return Ok(Some(served.bytes));
            }
            if self.wires.sensor_order().is_none() && self.wires.is_silent() {
                return Ok(None);
            }
            if self.seconds - asked_s > NO_ANSWER_S {
                return Err(Trip {
                    message: format!(
                        "nothing came over the serial line within {NO_ANSWER_S} s: O{number:04}"
                    ),
                });
            }
            self.pass(1e-4);
        }
    }
}
