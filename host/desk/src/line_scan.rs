//! A laser line scanner beside a live board: the board's pulses trigger it, or its own latch the
//! axes on the board; its profiles go out over TCP.
//!
//! Profiles are computed in a thread of their own, in the order of their triggers: they come
//! somewhat later than they would from a sensor, with the stamps of their moments.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use nalgebra::Vector3;
use umi_client::problem::Problem;
use umi_protocol::latch::{LatchCause, LatchReport};
use umi_virtual::scanner::{DataChannel, LineScanner, PulseFate, ScannerTally};
use umi_virtual::scene::{LineScannerSpec, MachineSpec, Scene};

/// How long the virtual board's pulses last: more than a sensor needs.
const PULSE_US: f64 = 50.0;

/// The sensor as the desk sees it.
pub struct LineScan {
    /// Where its data channel is, as `host:port`.
    pub address: String,
    shots: Sender<Shot>,
    every_us: f64,
    /// Pulses of its own so far.
    own: u32,
    tally: Arc<Mutex<ScannerTally>>,
}

/// A pulse at the sensor.
struct Shot {
    at_us: f64,
    counts: [i64; 3],
    /// Counts per microsecond.
    speed: [f64; 3],
}

impl LineScan {
    /// Switches the sensor of a scene on and opens its data channel; 0: any free port.
    ///
    /// # Errors
    /// The scene has none, or the port is taken.
    pub fn new(scene: &Scene, seed: u64, port: u16) -> Result<Self, Problem> {
        let Some(spec) = scene.line_scanner.clone() else {
            return Err(Problem::refused(
                "scene",
                "the scene has no [line_scanner]: add one, as `[line_scanner]` with `preset = \
                 \"gocator\"` and where it is mounted",
            ));
        };
        let trouble = |error| Problem::trouble("virtual_scanner", error);
        let channel_out = DataChannel::open(port).map_err(trouble)?;
        let address = channel_out.address.clone();
        let (shots, incoming) = channel();
        let tally = Arc::default();
        let every_us = spec.every_us;
        let sensor = Sensor {
            scanner: LineScanner::new(spec, seed),
            scene: scene.clone(),
            channel: channel_out,
            tally: Arc::clone(&tally),
        };
        thread::Builder::new()
            .name("virtual scanner's eye".into())
            .spawn(move || sensor.work(&incoming))
            .map_err(trouble)?;
        Ok(Self {
            address,
            shots,
            every_us,
            own: 0,
            tally,
        })
    }

    /// What the sensor has counted.
    #[must_use]
    pub fn tally(&self) -> ScannerTally {
        *self.tally.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The axes went from one place to the next, and the board sent these pulses on the way.
    /// The latches of the sensor's own pulses, if it has a rhythm of its own.
    pub fn moved(
        &mut self,
        from: (u64, [i64; 3]),
        to: (u64, [i64; 3]),
        pulses: &[LatchReport],
    ) -> Vec<LatchReport> {
        let passed_us = to.0.saturating_sub(from.0) as f64;
        let speed = std::array::from_fn(|axis| {
            if passed_us > 0.0 {
                (to.1[axis] - from.1[axis]) as f64 / passed_us
            } else {
                0.0
            }
        });
        if self.every_us == 0.0 {
            for pulse in pulses {
                let counts = |axis: usize| pulse.counts.get(axis).copied().unwrap_or(0);
                self.shoot(pulse.t_ns as f64 * 1e-3, std::array::from_fn(counts), speed);
            }
            return Vec::new();
        }
        let mut latches = Vec::new();
        let mut line = (from.0 as f64 / self.every_us).floor() + 1.0;
        while line * self.every_us <= to.0 as f64 {
            let at_us = line * self.every_us;
            let since = at_us - from.0 as f64;
            let counts =
                std::array::from_fn(|axis| from.1[axis] + (speed[axis] * since).round() as i64);
            self.shoot(at_us, counts, speed);
            latches.push(LatchReport {
                number: self.own,
                cause: LatchCause::Trigger,
                counts: counts.into_iter().collect(),
                t_ns: (at_us * 1e3).round() as u64,
                missed: 0,
            });
            self.own = self.own.wrapping_add(1);
            line += 1.0;
        }
        latches
    }

    fn shoot(&self, at_us: f64, counts: [i64; 3], speed: [f64; 3]) {
        // The sensor's thread ends with this value only.
        let _ = self.shots.send(Shot {
            at_us,
            counts,
            speed,
        });
    }
}

/// The sensor's own thread.
struct Sensor {
    scanner: LineScanner,
    scene: Scene,
    channel: DataChannel,
    tally: Arc<Mutex<ScannerTally>>,
}

impl Sensor {
    fn work(mut self, incoming: &Receiver<Shot>) {
        while let Ok(shot) = incoming.recv() {
            if self.scanner.pulse(shot.at_us, PULSE_US) == PulseFate::Taken {
                self.take(&shot);
            }
            *self.tally.lock().unwrap_or_else(PoisonError::into_inner) = self.scanner.tally();
        }
    }

    fn take(&mut self, shot: &Shot) {
        let spec = self.scanner.spec();
        // The scene's file was checked.
        let mount = spec
            .mount()
            .unwrap_or_else(|_| umi_kinematics::Pose::identity());
        let encoder = encoder(spec, shot);
        let machine = &self.scene.machine;
        let profile = self.scanner.take(&self.scene, |us| {
            let counts =
                std::array::from_fn(|axis| shot.counts[axis] as f64 + shot.speed[axis] * us);
            umi_kinematics::Pose::shift_mm(place_mm(machine, counts)).after(&mount)
        });
        let bytes = self.scanner.send(shot.at_us, encoder, &profile);
        self.channel.send(&bytes);
    }
}

fn encoder(spec: &LineScannerSpec, shot: &Shot) -> i64 {
    let axis = usize::from(spec.encoder_axis);
    shot.counts.get(axis).copied().unwrap_or(0)
}

/// Where the axes are in truth when their encoders show these counts: homing and scale are
/// errors that nobody at the machine sees.
fn place_mm(machine: &MachineSpec, counts: [f64; 3]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| {
        let shown =
            (counts[axis] - machine.origin_counts[axis] as f64) / machine.counts_per_mm[axis];
        shown * (1.0 + machine.scale_error_ppm[axis] * 1e-6) + machine.homing_error_mm[axis]
    })
}
