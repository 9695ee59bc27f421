//! What the control's interpreter asks of the machine.

use nalgebra::{Rotation3, Unit, Vector3};
use umi_core::units::Point;

use super::motion::Profile;
use super::probe::pretravel_mm;
use super::{Hit, Machine, Spindle, Wires};
use crate::nc::{Axes, Motion, Path, Rate, Skip, Trip};
use crate::scene::Body;

/// Chord error of an arc where collisions are looked for, mm.
const CHORD_MM: f64 = 0.005;
/// How close to sliding along a surface a touch may be: sine of the angle.
const STEEPEST: f64 = 0.02;

impl<W: Wires> Axes for Machine<W> {
    fn position(&self) -> Point {
        Point { mm: self.position }
    }

    fn reference_point(&self) -> Point {
        Point::from_array_mm(self.scene.machine.reference_mm)
    }

    fn travel(&mut self, motion: &Motion) -> Result<(), Trip> {
        let corners = corners(&self.position, motion);
        let mut from = self.position;
        let mut length = 0.0;
        for to in corners {
            self.within_travel(&to)?;
            self.collides(&from, &to, motion.rate)?;
            length += (to - from).norm();
            from = to;
        }
        let duration_s = self.profile(length, motion.rate).duration_s;
        self.pass(duration_s);
        self.position = motion.to.mm;
        Ok(())
    }

    fn skip(&mut self, motion: &Motion, leaving: bool) -> Result<Skip, Trip> {
        let (from, to) = (self.position, motion.to.mm);
        self.within_travel(&to)?;
        if self.spindle != Spindle::Probe {
            return Err(Trip {
                message: "a motion with skip needs the probe in the spindle".into(),
            });
        }
        if leaving {
            return self.leave(motion);
        }
        if self.touching {
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
        let profile = self.profile(length, motion.rate);
        let Some(touch) = self.touch(&from, &to) else {
            self.pass(profile.duration_s);
            self.position = to;
            return Ok(Skip {
                touched: false,
                stored: motion.to,
            });
        };
        let machine = &self.scene.machine;
        let sigma_mm = self.scene.probe.repeatability_um * 0.5e-3;
        let noise_mm = machine.position_noise_um * 0.5e-3;
        let stray = self.random.normal(sigma_mm) + self.random.normal(noise_mm);
        let trigger_mm = touch.way_mm + touch.pretravel_mm + stray;
        if trigger_mm >= length {
            // The motion ends before the stylus is bent enough.
            self.pass(profile.duration_s);
            self.position = to;
            self.touching = true;
            return Ok(Skip {
                touched: false,
                stored: motion.to,
            });
        }
        let edge_s = profile.time_at_s(trigger_mm) + self.scene.probe.filter_us * 1e-6;
        let latched = from + direction * profile.travelled_mm(edge_s);
        let counts = self.counts(&latched);
        let [shortest, longest] = self.scene.control.skip_delay_ms;
        let delay_ms = self.random.between(shortest, longest);
        let read_s = edge_s + delay_ms * 1e-3;
        let stored = from + direction * profile.travelled_mm(read_s);
        let (sent_mm, speed) = profile.sent(read_s);
        let braking_mm = speed * speed / (2.0 * profile.acceleration_mm_per_s2);
        let rest_mm = (sent_mm + braking_mm).min(length);

        self.pass(edge_s);
        let at = self.now();
        self.wires.skip(at, counts);
        self.pass(read_s - edge_s + speed / profile.acceleration_mm_per_s2);
        self.position = from + direction * rest_mm;
        self.touching = true;
        let hit = Hit {
            body: touch.body,
            contact: Point {
                mm: touch.center_mm,
            },
            normal: touch.normal,
            pretravel_mm: touch.pretravel_mm,
            at,
            counts,
            latched: Point { mm: latched },
            delay_ms,
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
            touched: true,
            stored: Point { mm: stored },
        })
    }

    fn dwell(&mut self, seconds: f64) {
        self.pass(seconds);
    }

    fn change_tool(&mut self, number: u32) -> Result<(), Trip> {
        self.spindle = if number == 0 {
            Spindle::Empty
        } else if number == self.scene.probe.tool {
            Spindle::Probe
        } else {
            match self.scene.tools.iter().find(|(has, _)| *has == number) {
                Some((_, tool)) => Spindle::Tool(*tool),
                None => {
                    return Err(Trip {
                        message: format!("the magazine has no tool {number}; add it to the scene"),
                    });
                }
            }
        };
        self.touching = false;
        self.pass(5.0);
        Ok(())
    }

    fn auxiliary(&mut self, m: u32, s: f64) -> Result<(), Trip> {
        if matches!(m, 3 | 4) && s > 0.0 && self.spindle == Spindle::Probe {
            return Err(Trip {
                message: format!("M{m} would turn the spindle with the probe in it"),
            });
        }
        Ok(())
    }

    fn print(&mut self, bytes: &[u8]) -> Result<(), Trip> {
        let control = &self.scene.control;
        let character_s = f64::from(control.bits) / f64::from(control.baud);
        self.pass(character_s * bytes.len() as f64);
        let now = self.now();
        self.wires.serial(now, bytes);
        Ok(())
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

/// A touch on a path.
struct Touch {
    body: String,
    /// Way of the axes up to the contact.
    way_mm: f64,
    center_mm: Vector3<f64>,
    normal: Vector3<f64>,
    /// Way of the axes from contact to trigger.
    pretravel_mm: f64,
}

impl<W: Wires> Machine<W> {
    /// The motion in time.
    fn profile(&mut self, length_mm: f64, rate: Rate) -> Profile {
        let machine = &self.scene.machine;
        let rapid = machine.rapid_mm_per_min;
        let mm_per_min = match rate {
            Rate::Rapid => rapid,
            Rate::Feed(feed) => feed.min(rapid),
        };
        self.feed_mm_per_min = mm_per_min;
        Profile::new(
            length_mm,
            mm_per_min / 60.0,
            machine.acceleration_mm_per_s2,
            machine.position_gain_per_s,
        )
    }

    /// The true ends of the tip's way.
    fn tip(
        &self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        down: &Vector3<f64>,
    ) -> [Vector3<f64>; 2] {
        [from, to].map(|end| end + self.truth(end) + down)
    }

    /// Where the probe's tip first touches on the way, if it does.
    fn touch(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> Option<Touch> {
        let (down, radius) = self.ball()?;
        let [start, end] = self.tip(from, to, &down);
        let contact = self.scene.first_contact(&start, &end, radius, |_| true)?;
        let push = -contact.normal;
        let true_way = end - start;
        let true_length = true_way.norm();
        let towards = (true_way / true_length).dot(&push).max(STEEPEST);
        // The truth's scale against the encoders' along this way.
        let scale = (to - from).norm() / true_length;
        Some(Touch {
            body: contact.body.name.clone(),
            way_mm: contact.way_mm * scale,
            center_mm: contact.center_mm,
            normal: contact.normal,
            pretravel_mm: pretravel_mm(&self.scene.probe, &push) / towards * scale,
        })
    }

    /// Refuses a motion without skip on which the tip or tool touches.
    fn collides(&mut self, from: &Vector3<f64>, to: &Vector3<f64>, rate: Rate) -> Result<(), Trip> {
        let Some((down, radius)) = self.ball() else {
            return Ok(());
        };
        let cutting = matches!(self.spindle, Spindle::Tool(_)) && rate != Rate::Rapid;
        let counts = |body: &Body| !(cutting && body.cuttable);
        let [mut start, end] = self.tip(from, to, &down);
        if self.touching {
            match self.freed(&start, &end, radius) {
                Some(free) => start = free,
                None => {
                    return Err(Trip {
                        message: "the probe touches and the motion bends it further; move away from the body first".into(),
                    });
                }
            }
        }
        if let Some(contact) = self.scene.first_contact(&start, &end, radius, counts) {
            let what = match self.spindle {
                Spindle::Probe => "the probe",
                Spindle::Empty | Spindle::Tool(_) => "the tool",
            };
            let [x, y, z] = (contact.center_mm - down).into();
            return Err(Trip {
                message: format!(
                    "collision: {what} ran into {} at X{x:.3} Y{y:.3} Z{z:.3} (machine coordinates) in a motion without skip",
                    contact.body.name
                ),
            });
        }
        if (end - start).norm() > 0.0 {
            self.touching = false;
        }
        Ok(())
    }

    /// Where a bent stylus comes free on its way; none if it is bent further first.
    fn freed(&self, start: &Vector3<f64>, end: &Vector3<f64>, radius: f64) -> Option<Vector3<f64>> {
        const STEP_MM: f64 = 0.005;
        const FREE_MM: f64 = 1e-6;
        let way = end - start;
        let length = way.norm();
        let mut least = self.scene.clearance(start, radius, |_| true);
        if least > FREE_MM || length == 0.0 {
            return Some(*start);
        }
        let steps = libm::ceil((length / STEP_MM).min(1e6));
        let mut step = 0.0;
        while step < steps {
            step += 1.0;
            let at = start + way * (step / steps);
            let clearance = self.scene.clearance(&at, radius, |_| true);
            if clearance > FREE_MM {
                return Some(at);
            }
            if clearance < least - 1e-6 {
                return None;
            }
            least = clearance;
        }
        None
    }

    /// A motion that ends when the stylus comes free.
    fn leave(&mut self, motion: &Motion) -> Result<Skip, Trip> {
        let (from, to) = (self.position, motion.to.mm);
        let way = to - from;
        let length = way.norm();
        let missed = Skip {
            touched: false,
            stored: motion.to,
        };
        let Some((down, radius)) = self.ball() else {
            return Ok(missed);
        };
        let [start, end] = self.tip(&from, &to, &down);
        if !self.touching {
            return Ok(Skip {
                touched: true,
                stored: self.position(),
            });
        }
        let profile = self.profile(length, motion.rate);
        let freed = self.freed(&start, &end, radius).filter(|_| length > 0.0);
        let Some(free) = freed else {
            return Err(Trip {
                message:
                    "the probe touches and the motion does not free it; move away from the body"
                        .into(),
            });
        };
        let way_mm = (free - start).norm() * length / (end - start).norm();
        let [shortest, longest] = self.scene.control.skip_delay_ms;
        let delay_s = self.random.between(shortest, longest) * 1e-3;
        let read_s = profile.time_at_s(way_mm) + delay_s;
        let stored = from + way / length * profile.travelled_mm(read_s);
        let (sent_mm, speed) = profile.sent(read_s);
        let braking_mm = speed * speed / (2.0 * profile.acceleration_mm_per_s2);
        self.pass(read_s + speed / profile.acceleration_mm_per_s2);
        self.position = from + way / length * (sent_mm + braking_mm).min(length);
        self.touching = false;
        Ok(Skip {
            touched: true,
            stored: Point { mm: stored },
        })
    }
}

/// The corners of a motion's way, the last one its end: arcs as chords.
fn corners(from: &Vector3<f64>, motion: &Motion) -> Vec<Vector3<f64>> {
    let Path::Arc {
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
