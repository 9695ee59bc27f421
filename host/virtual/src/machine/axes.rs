//! What the control's interpreter asks of the machine.

use nalgebra::{Rotation3, Unit, Vector3};
use umi_core::units::Point;

use super::collide::between;
use super::motion::Profile;
use super::{SkippedTouch, Spindle, VirtualMachine, Wires};
use crate::nc::{AxisDrives, AxisMotion, MotionPath, MotionRate, Skip, Trip};

/// Chord error of an arc where collisions are looked for, mm.
const CHORD_MM: f64 = 0.005;

impl<W: Wires> AxisDrives for VirtualMachine<W> {
    fn position(&self) -> Point {
        Point { mm: self.position }
    }

    fn true_position(&self) -> Point {
        Point {
            mm: self.position + self.truth(&self.position),
        }
    }

    fn reference_point(&self) -> Point {
        Point::from_array_mm(self.scene.machine.reference_mm)
    }

    fn travel(&mut self, motion: &AxisMotion) -> Result<(), Trip> {
        let mut chain = vec![self.position];
        chain.append(&mut corners(&self.position, motion));
        for at in &chain {
            self.within_travel(at)?;
        }
        let ways: Vec<f64> = chain
            .iter()
            .zip(chain.iter().skip(1))
            .map(|(from, to)| (to - from).norm())
            .collect();
        let profile = self.profile(ways.iter().sum(), motion.rate)?;
        let turned = if self.is_turned() {
            vec![self.turned.clone(); chain.len()]
        } else {
            Vec::new()
        };
        if let Some(stop) = self.collision(&chain, &turned) {
            let before: f64 = ways.iter().take(stop.line).sum();
            let within = ways.get(stop.line).copied().unwrap_or(0.0) * stop.share;
            let rest = between(&chain, stop.line, stop.share);
            self.go(&chain, &profile, profile.time_at_s(before + within), rest);
            return Err(stop.trip);
        }
        let falls_s = self.falls_s(&chain, &profile);
        self.go_falling(&chain, &profile, profile.duration_s, motion.to.mm, falls_s);
        self.signal &= falls_s.is_none();
        Ok(())
    }

    fn turned_deg(&self) -> Vec<f64> {
        self.turned.clone()
    }

    fn turn(
        &mut self,
        motion: &AxisMotion,
        to_deg: &[f64],
        block_s: Option<f64>,
    ) -> Result<(), Trip> {
        self.turn_to(motion, to_deg, None, block_s)
    }

    fn unturned(&self, length_mm: f64) -> Vector3<f64> {
        self.carriage(length_mm)
            .unturned(&self.position, &self.turned)
    }

    fn carry(
        &mut self,
        motion: &AxisMotion,
        to_deg: &[f64],
        length_mm: f64,
        block_s: Option<f64>,
    ) -> Result<(), Trip> {
        self.turn_to(motion, to_deg, Some(length_mm), block_s)
    }

    fn skip(&mut self, motion: &AxisMotion, leaving: bool) -> Result<Skip, Trip> {
        if self.is_turned() {
            return Err(Trip {
                message: "the bodies of a scene do not turn for a probe: bring the rotary axes to 0 before a motion with skip".into(),
            });
        }
        let (from, to) = (self.position, motion.to.mm);
        self.within_travel(&to)?;
        if self.spindle == Spindle::Sensor && !leaving {
            return self.sensor_skip(motion);
        }
        if self.spindle != Spindle::Probe {
            return Err(Trip {
                message: "a motion with skip needs the probe in the spindle".into(),
            });
        }
        if leaving {
            return self.leave(motion);
        }
        if self.signal {
            // The signal is on: the block ends where it begins.
            return Ok(Skip {
                touched: true,
                stored: self.position(),
            });
        }
        let way = to - from;
        let length = way.norm();
        if length == 0.0 {
            return Ok(Skip {
                touched: false,
                stored: motion.to,
            });
        }
        let direction = way / length;
        let profile = self.profile(length, motion.rate)?;
        let Some(touch) = self.touch(&from, &to) else {
            return self.unseen(&to, &profile);
        };
        let machine = &self.scene.machine;
        let sigma_mm = self.scene.probe.repeatability_um * 0.5e-3;
        let noise_mm = machine.position_noise_um * 0.5e-3;
        let stray = self.random.normal(sigma_mm) + self.random.normal(noise_mm);
        let trigger_mm = touch.way_mm + touch.pretravel_mm + stray;
        if trigger_mm >= length {
            // The motion ends before the stylus is bent enough.
            return self.unseen(&to, &profile);
        }
        let edge_s = profile.time_at_s(trigger_mm) + self.scene.probe.filter_us * 1e-6;
        let latched = from + direction * profile.travelled_mm(edge_s);
        let counts = self.counts(&latched);
        let read_s = self.notices_s(edge_s);
        // What the control has not noticed when the motion is over, it never notices.
        let seen = read_s < profile.duration_s;
        let (sent_mm, speed) = profile.sent(read_s);
        let braking_mm = speed * speed / (2.0 * profile.acceleration_mm_per_s2);
        let rest_mm = (sent_mm + braking_mm).min(length);
        let rest = from + direction * rest_mm;
        let stored = if seen {
            from + direction * self.stored_mm(&profile, read_s)
        } else {
            to
        };
        if let Some((share, trip)) = self.stem_collision(&from, &rest) {
            let (until_s, stop) = (
                profile.time_at_s(share * rest_mm),
                from + (rest - from) * share,
            );
            self.go(&[from, to], &profile, until_s, stop);
            return Err(trip);
        }

        self.go(&[from, to], &profile, edge_s, latched);
        let at = self.now();
        self.wires.skip(at, counts);
        self.pass(read_s - edge_s + speed / profile.acceleration_mm_per_s2);
        self.arrive(rest);
        self.signal = true;
        let hit = SkippedTouch {
            body: touch.body,
            contact: Point {
                mm: touch.center_mm,
            },
            normal: touch.normal,
            pretravel_mm: touch.pretravel_mm,
            at,
            counts,
            latched: Point { mm: latched },
            delay_ms: (read_s - edge_s) * 1e3,
            stored: Point { mm: stored },
            feed_mm_per_min: profile.sent(edge_s).1 * 60.0,
        };
        let bent_mm = rest_mm - touch.way_mm;
        let limit_mm = self.scene.probe.overtravel_mm;
        if bent_mm > limit_mm {
            return Err(Trip {
                message: format!(
                    "the stylus broke: it touched {} at {:.0} mm/min and was bent by {bent_mm:.2} mm, {limit_mm} at most; probe slower",
                    hit.body, hit.feed_mm_per_min
                ),
            });
        }
        self.hits.push(hit);
        Ok(Skip {
            touched: seen,
            stored: Point { mm: stored },
        })
    }

    fn dwell(&mut self, seconds: f64) {
        self.pass(seconds);
    }

    fn change_tool(&mut self, number: u32) -> Result<(), Trip> {
        let sensor = self.scene.point_sensor.as_ref();
        self.spindle = if number == self.scene.probe.tool {
            Spindle::Probe
        } else if sensor.is_some_and(|sensor| sensor.tool == number) {
            Spindle::Sensor
        } else {
            match self.scene.tools.iter().find(|(has, _)| *has == number) {
                Some((_, tool)) => Spindle::Tool(*tool),
                None if number == 0 => Spindle::Empty,
                None => {
                    return Err(Trip {
                        message: format!("the magazine has no tool {number}; add it to the scene"),
                    });
                }
            }
        };
        self.turns = false;
        if std::mem::take(&mut self.signal) {
            let (now, counts) = (self.now(), self.counts(&self.position));
            self.wires.skip_falls(now, counts);
        }
        self.pass(5.0);
        Ok(())
    }

    /// M3 and M4 turn the spindle when S is above 0; an S that comes later turns it with
    /// the next M3 only. With the probe in the spindle they are refused whatever S is:
    /// what S 0 keeps still, the next S would turn. M5, M19 and the end of the program
    /// stop it.
    fn auxiliary(&mut self, m: u32, s: f64) -> Result<(), Trip> {
        match m {
            3 | 4 if matches!(self.spindle, Spindle::Probe | Spindle::Sensor) => {
                let what = if self.spindle == Spindle::Probe {
                    "probe"
                } else {
                    "distance sensor"
                };
                return Err(Trip {
                    message: format!("M{m} would turn the spindle with the {what} in it"),
                });
            }
            3 | 4 => self.turns = s > 0.0,
            2 | 5 | 19 | 30 => self.turns = false,
            8 | 9 => {
                let (now, counts) = (self.now(), self.counts(&self.position));
                self.wires.gate(now, m == 8, counts);
            }
            _ => {}
        }
        Ok(())
    }

    fn print(&mut self, bytes: &[u8]) -> Result<(), Trip> {
        let control = &self.scene.control;
        let character_s = f64::from(control.bits) / f64::from(control.baud);
        self.pass(character_s * bytes.len() as f64);
        let (now, counts) = (self.now(), self.counts(&self.position));
        self.wires.stands(counts);
        self.wires.serial(now, bytes);
        Ok(())
    }

    fn skip_is_on(&self) -> bool {
        match self.spindle {
            Spindle::Sensor => self.wires.skip_input(),
            Spindle::Probe => self.signal,
            _ => false,
        }
    }

    fn await_input(
        &mut self,
        number: u16,
        wanted: Option<bool>,
        timeout_s: f64,
    ) -> Result<Option<bool>, Trip> {
        let began_s = self.seconds;
        loop {
            let is_on = self.wires.digital_input(number);
            if wanted.is_none_or(|wanted| wanted == is_on) {
                return Ok(Some(is_on));
            }
            if self.seconds - began_s >= timeout_s {
                return Ok(None);
            }
            // A servo period of LinuxCNC.
            self.pass(1e-3);
        }
    }

    fn external_program(&mut self, number: u32) -> Result<Option<Vec<u8>>, Trip> {
        self.read_program(number)
    }

    fn input(&self, number: u16) -> bool {
        // What is put out comes back: as a test plug would wire it.
        let number = usize::from(number.wrapping_sub(1000));
        self.outputs.get(number).copied().unwrap_or(false)
    }

    fn output(&mut self, number: u16, on: bool) {
        let number = usize::from(number.wrapping_sub(1100));
        if let Some(output) = self.outputs.get_mut(number) {
            *output = on;
        }
    }

    fn seconds(&self) -> f64 {
        self.seconds
    }
}

impl<W: Wires> VirtualMachine<W> {
    /// A motion with skip that ends where it was to.
    fn unseen(&mut self, to: &Vector3<f64>, profile: &Profile) -> Result<Skip, Trip> {
        let from = self.position;
        if let Some((share, trip)) = self.stem_collision(&from, to) {
            let until_s = profile.time_at_s(share * (to - from).norm());
            self.go(&[from, *to], profile, until_s, from + (to - from) * share);
            return Err(trip);
        }
        self.go(&[from, *to], profile, profile.duration_s, *to);
        Ok(Skip {
            touched: false,
            stored: Point { mm: *to },
        })
    }

    /// The motion in time.
    pub(super) fn profile(&mut self, length_mm: f64, rate: MotionRate) -> Result<Profile, Trip> {
        let machine = &self.scene.machine;
        let rapid = machine.rapid_mm_per_min;
        let mm_per_min = match rate {
            MotionRate::Rapid => rapid,
            MotionRate::Feed(feed) if feed > 0.0 => feed.min(rapid),
            MotionRate::Feed(feed) => {
                return Err(Trip {
                    message: format!("the feed is {feed} mm/min; program an F above 0"),
                });
            }
        };
        self.feed_mm_per_min = mm_per_min;
        Ok(Profile::new(
            length_mm,
            mm_per_min / 60.0,
            machine.acceleration_mm_per_s2,
            machine.position_gain_per_s,
        ))
    }
}

/// The corners of a motion's way, the last one its end: arcs as chords.
fn corners(from: &Vector3<f64>, motion: &AxisMotion) -> Vec<Vector3<f64>> {
    let MotionPath::Arc {
        center,
        axis,
        sweep,
    } = motion.path
    else {
        return vec![motion.to.mm];
    };
    let arm = from - center.mm;
    let arm = arm - axis * arm.dot(&axis);
    let rise = (motion.to.mm - from).dot(&axis);
    let radius = arm.norm().max(CHORD_MM);
    // Sagitta r (1 - cos(step / 2)) below the chord error.
    let step = 2.0 * libm::acos((1.0 - CHORD_MM / radius).clamp(-1.0, 1.0));
    let pieces = libm::ceil((sweep.0.abs() / step.max(1e-4)).clamp(1.0, 1e6));
    let mut corners = Vec::new();
    let mut piece = 1.0;
    while piece < pieces {
        let part = piece / pieces;
        let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(axis), sweep.0 * part);
        corners.push(center.mm + turn * arm + axis * (rise * part));
        piece += 1.0;
    }
    corners.push(motion.to.mm);
    corners
}
