//! A virtual machine tool: axes, encoders, a touch probe and a control's slow eye.
//!
//! # Model
//!
//! Time is continuous: a motion is a closed form (`motion.rs`), nothing is stepped. Three
//! positions are kept apart, as on a machine:
//!
//! * *sent*: what the control commands;
//! * *encoder*: where the axes are by their encoders, a lag behind. The board counts
//!   these, the control stores these at a skip;
//! * *true*: where the tip is against the bodies of the scene, `encoder (1 + scale) +
//!   homing + drift + noise`. No one at the machine can see the difference.
//!
//! In a motion with skip the tip meets a body, the stylus bends, and the probe triggers
//! when it is bent by the pretravel of that direction. At this instant the skip line
//! rises and the encoders' counts go out on the wire ([`Wires::skip`]). The control
//! notices later, by a delay that nobody can predict, stores the encoders' position of
//! *that* moment, and brakes. How far the stylus is bent at rest decides whether it
//! lives.
//!
//! A signal that is on already when a motion with skip begins ends it at once, without
//! an edge (Fanuc; A. Sawula's thesis, 2.1.2.4: back off with something else than G31).
//! A control that has not noticed the edge when the motion is over, never does.
//!
//! A tool whose spindle turns passes through bodies that are `cuttable`, at feed and at
//! rapid: the machine knows their finished shapes, what material is left on them knows
//! the [`Cutter`](crate::cutting::Cutter) around it, which tells of rapid motions through
//! it. A tool that stands still collides with them as with any other body.
//!
//! What the model leaves out: jerk, and corners cut by looking ahead (every motion ends
//! with an exact stop).
//!
//! # What the two witnesses say
//!
//! One wall, 50 hits at each feed, a control that answers after 0 to 4 ms, 0.1 µm per
//! count (test `control_wanders_latch_stays`):
//!
//! | feed, mm/min | feed times 4 ms, µm | range of what the control stored, µm | range of the counts |
//! |-------------:|--------------------:|-----------------------------------:|--------------------:|
//! |           50 |                 3.3 |                                3.1 |         at most one |
//! |          300 |                20.0 |                               19.2 |         at most one |
//! |         1000 |                66.7 |                               64.8 |         at most one |
//! |         3000 |               200.0 |                              197.3 |         at most one |

mod axes;
mod collide;
mod encoder;
mod motion;
mod probe;
mod sense;
mod touch;
mod turn;
mod wires;

#[cfg(test)]
mod tests;

use nalgebra::Vector3;
use umi_core::units::{Micros, Point};

use crate::nc::Trip;
use crate::scene::{Scene, ToolSpec};

use crate::random::Random;
use collide::Along;
pub use encoder::{Encoder, EncoderEdge, Signals};
use motion::Profile;
use sense::Sensing;
pub use wires::{SensorOrder, SensorPulses, ServedProgram, Unwired, Wires};

/// A machine tool at work.
#[derive(Debug)]
pub struct VirtualMachine<W> {
    scene: Scene,
    wires: W,
    random: Random,
    /// Where the axes were sent, machine coordinates.
    position: Vector3<f64>,
    /// Angles of the rotary axes, in the order of the scene.
    turned: Vec<f64>,
    seconds: f64,
    /// The probe's signal is on: from a skip up to the motion that frees the stylus.
    signal: bool,
    /// Phase of the control's looks at the skip signal, of their interval.
    poll_phase: f64,
    spindle: Spindle,
    /// The spindle turns.
    turns: bool,
    outputs: [bool; 36],
    hits: Vec<SkippedTouch>,
    feed_mm_per_min: f64,
    /// The distance sensor, if there is one.
    sensing: Option<Sensing>,
}

fn micros(seconds: f64) -> Micros {
    Micros((seconds * 1e6) as u64)
}

/// What is in the spindle.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Spindle {
    Empty,
    Probe,
    Tool(ToolSpec),
    /// The distance sensor.
    Sensor,
}

/// A touch, with what everyone has seen of it.
#[derive(Clone, Debug, PartialEq)]
pub struct SkippedTouch {
    /// The body.
    pub body: String,
    /// The tip's true centre at first contact.
    pub contact: Point,
    /// The body's outward normal there.
    pub normal: Vector3<f64>,
    /// Travel of the tip between contact and trigger, along the path.
    pub pretravel_mm: f64,
    /// When the skip line rose.
    pub at: Micros,
    /// The encoders' counts at that instant.
    pub counts: [i64; 3],
    /// The encoders' position at that instant.
    pub latched: Point,
    /// How long the control took, milliseconds.
    pub delay_ms: f64,
    /// What the control stored.
    pub stored: Point,
    /// Speed at the skip edge, mm/min.
    pub feed_mm_per_min: f64,
}

/// What a live view shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MachineStatus {
    /// Where the axes are.
    pub position: Point,
    /// What the counters of their encoders hold.
    pub counts: [i64; 3],
    /// What stands on the encoders' wires.
    pub signals: [Signals; 3],
    /// Feed of the latest motion.
    pub feed_mm_per_min: f64,
    /// Time since the machine was switched on.
    pub seconds: f64,
    /// Touches so far.
    pub hits: usize,
}

impl<W: Wires> VirtualMachine<W> {
    /// Switches a machine on: the probe is in the spindle. The same seed gives the same
    /// noise.
    pub fn new(scene: Scene, seed: u64, wires: W) -> Self {
        let mut random = Random::new(seed);
        let start = Vector3::from(scene.machine.start_mm);
        let mut machine = Self {
            position: start,
            turned: scene.machine.rotary.iter().map(|r| r.start_deg).collect(),
            poll_phase: random.between(0.0, 1.0),
            random,
            wires,
            seconds: 0.0,
            signal: false,
            spindle: Spindle::Probe,
            turns: false,
            outputs: [false; 36],
            hits: Vec::new(),
            feed_mm_per_min: 0.0,
            sensing: scene
                .point_sensor
                .clone()
                .map(|spec| Sensing::new(spec, seed)),
            scene,
        };
        machine.tell_turned();
        machine.arrive(start);
        machine
    }

    /// What stands on the table.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What stands on the table, to move it between programs.
    pub fn scene_mut(&mut self) -> &mut Scene {
        &mut self.scene
    }

    /// The other end of the wires.
    pub fn wires(&self) -> &W {
        &self.wires
    }

    /// The other end of the wires.
    pub fn wires_mut(&mut self) -> &mut W {
        &mut self.wires
    }

    /// Switches the machine off; the wires remain.
    pub fn into_wires(self) -> W {
        self.wires
    }

    /// All touches, oldest first.
    pub fn hits(&self) -> &[SkippedTouch] {
        &self.hits
    }

    /// For a live view.
    pub fn status(&self) -> MachineStatus {
        let counts = self.counts(&self.position);
        let [x, y, z] = self.encoders();
        let [at_x, at_y, at_z] = counts;
        MachineStatus {
            position: Point { mm: self.position },
            counts,
            signals: [x.signals(at_x), y.signals(at_y), z.signals(at_z)],
            feed_mm_per_min: self.feed_mm_per_min,
            seconds: self.seconds,
            hits: self.hits.len(),
        }
    }

    /// What the encoders' counters hold at a position of the axes.
    #[must_use]
    pub fn counts(&self, encoder_mm: &Vector3<f64>) -> [i64; 3] {
        let [x, y, z] = self.encoders();
        [
            x.counts(encoder_mm.x),
            y.counts(encoder_mm.y),
            z.counts(encoder_mm.z),
        ]
    }

    /// The encoders of X, Y and Z: for the signals of a motion, edge by edge.
    #[must_use]
    pub fn encoders(&self) -> [Encoder; 3] {
        let machine = &self.scene.machine;
        let [x, y, z] = machine.counts_per_mm;
        let [at_x, at_y, at_z] = machine.origin_counts;
        [(x, at_x), (y, at_y), (z, at_z)].map(|(counts_per_mm, origin_counts)| Encoder {
            counts_per_mm,
            origin_counts,
            index_counts: machine.index_counts,
        })
    }

    /// Truth less encoder at this position, now.
    fn truth(&self, encoder_mm: &Vector3<f64>) -> Vector3<f64> {
        let machine = &self.scene.machine;
        let warm = 1.0 - libm::exp(-self.seconds / machine.drift_time_s);
        let scale = Vector3::from(machine.scale_error_ppm) * 1e-6;
        encoder_mm.component_mul(&scale)
            + Vector3::from(machine.homing_error_mm)
            + Vector3::from(machine.drift_mm) * warm
    }

    fn now(&self) -> Micros {
        micros(self.seconds)
    }

    /// The axes move along a chain until then, and rest there.
    fn go(&mut self, chain: &[Vector3<f64>], profile: &Profile, until_s: f64, rest: Vector3<f64>) {
        self.go_falling(chain, profile, until_s, rest, None);
    }

    /// As [`Self::go`]; the probe's signal goes off at this time of the motion.
    fn go_falling(
        &mut self,
        chain: &[Vector3<f64>],
        profile: &Profile,
        until_s: f64,
        rest: Vector3<f64>,
        falls_s: Option<f64>,
    ) {
        let step_s = self.wires.sampling_s().filter(|step_s| *step_s > 0.0);
        let step_s = step_s.unwrap_or(f64::INFINITY);
        let mut along = Along::new(chain);
        let mut falls_s = falls_s.map(|falls_s| falls_s.min(until_s));
        let mut sample_s = step_s;
        loop {
            let falls = falls_s.is_some_and(|falls_s| falls_s <= sample_s);
            let time_s = match falls_s.take_if(|_| falls) {
                Some(falls_s) => falls_s,
                None if sample_s < until_s => sample_s,
                None => break,
            };
            let counts = self.counts(&along.at(profile.travelled_mm(time_s)));
            let at = micros(self.seconds + time_s);
            if falls {
                self.wires.skip_falls(at, counts);
            } else {
                self.wires.moved(at, counts);
                sample_s += step_s;
            }
        }
        self.sense_along(chain, profile, until_s);
        self.wait(until_s);
        self.arrive(rest);
    }

    /// The axes rest there.
    fn arrive(&mut self, rest: Vector3<f64>) {
        self.position = rest;
        self.sense_arrived();
        if self.wires.sampling_s().is_some() {
            let (now, counts) = (self.now(), self.counts(&rest));
            self.wires.moved(now, counts);
        }
    }

    /// Time passes with the axes at rest.
    fn pass(&mut self, seconds: f64) {
        self.sense_at_rest(self.seconds + seconds.max(0.0));
        self.wait(seconds);
    }

    fn wait(&mut self, seconds: f64) {
        self.seconds += seconds.max(0.0);
        let now = self.now();
        self.wires.time(now);
    }

    /// From the gauge line to the centre of the ball that may touch, and its radius.
    fn ball(&self) -> Option<(Vector3<f64>, f64)> {
        let down = |mm: f64| Vector3::new(0.0, 0.0, -mm);
        match self.spindle {
            // The housing of the sensor is more than one ball: its stem, as a probe has one.
            Spindle::Empty | Spindle::Sensor => None,
            Spindle::Probe => {
                let probe = &self.scene.probe;
                Some((down(probe.length_mm), probe.tip_radius_mm))
            }
            Spindle::Tool(tool) => Some((down(tool.length_mm - tool.radius_mm), tool.radius_mm)),
        }
    }

    fn within_travel(&self, to: &Vector3<f64>) -> Result<(), Trip> {
        let machine = &self.scene.machine;
        let limits = machine.travel_min_mm.iter().zip(machine.travel_max_mm);
        for ((axis, mm), (least, most)) in ["X", "Y", "Z"].iter().zip(to).zip(limits) {
            if !(*least..=most).contains(mm) {
                return Err(Trip {
                    message: format!(
                        "over-travel: {axis} {mm:.3} is outside {least} to {most} (machine coordinates, mm)"
                    ),
                });
            }
        }
        Ok(())
    }
}
