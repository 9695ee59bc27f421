//! A laser line scanner beside a live board: the board's pulses trigger it, or its own latch the
//! axes on the board; its profiles go out over TCP.
//!
//! Profiles are computed in a thread of their own, in the order of their triggers: they come
//! somewhat later than they would from a sensor, with the stamps of their moments.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use umi_client::problem::Problem;
use umi_protocol::latch::{LatchCause, LatchReport};
use umi_virtual::board::SentPulses;
use umi_virtual::scanner::{DataChannel, LineScanner, PulseFate, ScannerTally};
use umi_virtual::scene::{LineScannerSpec, Scene};

use crate::AxisCounts;
use crate::shot::{Shot, rise, speed};

/// The sensor as the desk sees it.
pub struct LineScan {
    /// Where its data channel is, as `host:port`.
    pub address: String,
    shots: Sender<Shot>,
    rhythm: Rhythm,
    /// Pulses of its own so far.
    own: u32,
    tally: Arc<Mutex<ScannerTally>>,
}

/// What makes the sensor expose.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Rhythm {
    /// The board's pulses.
    Board,
    /// So many microseconds of its own.
    Time(f64),
    /// So many counts of the axis that its encoder input sees.
    Counts { axis: usize, every: i64 },
}

impl Rhythm {
    fn of(spec: &LineScannerSpec) -> Self {
        if spec.every_us > 0.0 {
            Self::Time(spec.every_us)
        } else if spec.every_counts > 0 {
            Self::Counts {
                axis: usize::from(spec.encoder_axis),
                every: i64::from(spec.every_counts),
            }
        } else {
            Self::Board
        }
    }

    /// The moments, in microseconds, at which it exposes by itself while the axes go from one place to the next.
    fn moments(self, from: (u64, AxisCounts), to: (u64, AxisCounts)) -> Vec<f64> {
        let (begin, end) = (from.0 as f64, to.0 as f64);
        match self {
            Self::Board => Vec::new(),
            Self::Time(every_us) => {
                let first = (begin / every_us).floor() + 1.0;
                let lines = (0..).map(|k| (first + f64::from(k)) * every_us);
                lines.take_while(|at_us| *at_us <= end).collect()
            }
            Self::Counts { axis, every } => {
                let at = |counts: &AxisCounts| counts.all.get(axis).copied().unwrap_or(0);
                let (a, b) = (at(&from.1), at(&to.1));
                let (forth, low, high) = (b > a, a.min(b), a.max(b));
                // The mark that it stands on was passed before.
                let first = if forth {
                    low.div_euclid(every) + 1
                } else {
                    -(-low).div_euclid(every)
                };
                let last = if forth {
                    high.div_euclid(every)
                } else {
                    -(-high).div_euclid(every) - 1
                };
                let moment = |mark: i64| {
                    let share = (mark * every - a) as f64 / (b - a) as f64;
                    begin + share * (end - begin)
                };
                let mut moments: Vec<f64> = (first..=last).map(moment).collect();
                moments.sort_by(f64::total_cmp);
                moments
            }
        }
    }
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
        let rhythm = Rhythm::of(&spec);
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
            rhythm,
            own: 0,
            tally,
        })
    }

    /// What the sensor has counted.
    #[must_use]
    pub fn tally(&self) -> ScannerTally {
        *self.tally.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The axes went from one place to the next, and the board sent this on the way.
    /// The latches of the sensor's own pulses, if it has a rhythm of its own.
    pub(crate) fn moved(
        &mut self,
        from: (u64, AxisCounts),
        to: (u64, AxisCounts),
        sent: &SentPulses,
    ) -> Vec<LatchReport> {
        let speed = speed(from, to);
        if self.rhythm == Rhythm::Board {
            // Without counts there was no pulse: it tells of others that could not be sent.
            for latch in sent.latches.iter().filter(|latch| !latch.counts.is_empty()) {
                self.shoot(rise(latch, sent.pulse, to.1.axes, speed));
            }
            return Vec::new();
        }
        let mut latches = Vec::new();
        for at_us in self.rhythm.moments(from, to) {
            let since = at_us - from.0 as f64;
            let passed = |axis: usize| (speed[axis] * since).round() as i64;
            let counts = AxisCounts {
                all: std::array::from_fn(|axis| from.1.all[axis] + passed(axis)),
                axes: to.1.axes,
            };
            self.shoot(Shot {
                at_us,
                counts,
                speed,
                // Its own, as long as it needs.
                high_us: f64::INFINITY,
            });
            latches.push(LatchReport {
                number: self.own,
                cause: LatchCause::Trigger,
                counts: counts.each().collect(),
                t_ns: (at_us * 1e3).round() as u64,
                missed: 0,
            });
            self.own = self.own.wrapping_add(1);
        }
        latches
    }

    fn shoot(&self, shot: Shot) {
        // The sensor's thread ends with this value only.
        let _ = self.shots.send(shot);
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
            if self.scanner.pulse(shot.at_us, shot.high_us) == PulseFate::Taken {
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
        let chain = machine.chain(mount);
        let profile = self.scanner.take(&self.scene, |us| {
            chain.sensor_in_workpiece(&shot.places(machine, us))
        });
        let bytes = self.scanner.send(shot.at_us, encoder, &profile);
        self.channel.send(&bytes);
    }
}

fn encoder(spec: &LineScannerSpec, shot: &Shot) -> i64 {
    let axis = usize::from(spec.encoder_axis);
    shot.counts.all.get(axis).copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};
    use umi_protocol::latch::{SignalLevel, TriggerPulse};

    fn sent(width_us: u16, rests: SignalLevel) -> SentPulses {
        let latch = |number: u32| LatchReport {
            number,
            cause: LatchCause::Output,
            counts: [i64::from(number) * 100, 0, 0].into_iter().collect(),
            t_ns: 5_000_000 * u64::from(number + 1),
            missed: 0,
        };
        let told = LatchReport {
            counts: Default::default(),
            missed: 3,
            ..latch(3)
        };
        SentPulses {
            latches: vec![latch(0), latch(1), latch(2), told],
            pulse: TriggerPulse { width_us, rests },
        }
    }

    /// What the sensor has made of three pulses.
    fn tally(sent: &SentPulses) -> ScannerTally {
        let scene = Scene::parse("[line_scanner]\npreset = \"gocator\"\n").unwrap();
        let mut scan = LineScan::new(&scene, 1, 0).unwrap();
        scan.moved(
            (0, AxisCounts::new([0; 3], &[])),
            (15_000, AxisCounts::new([200, 0, 0], &[])),
            sent,
        );
        let begun = Instant::now();
        loop {
            let tally = scan.tally();
            if tally.taken + tally.short + tally.busy == 3 || begun.elapsed().as_secs() > 20 {
                return tally;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// A Gocator takes pulses of 20 us, which are the default, and counts shorter ones as none. A
    /// latch without counts is no pulse.
    #[test]
    fn a_pulse_must_be_as_long_as_the_sensor_needs() {
        for (width_us, taken) in [(1, 0), (19, 0), (20, 3), (1000, 3)] {
            let tally = tally(&sent(width_us, SignalLevel::Low));
            assert_eq!((tally.taken, tally.short), (taken, 3 - taken), "{width_us}");
        }
        let usual = TriggerPulse::default();
        assert_eq!(tally(&sent(usual.width_us, usual.rests)).taken, 3);
    }

    /// By its encoder the sensor exposes at each mark that the axis passes, either way, and once at each: also where a stretch
    /// ends or begins on one.
    #[test]
    fn its_encoder_triggers_at_each_mark() {
        let rhythm = Rhythm::Counts { axis: 1, every: 10 };
        let at = |us: u64, y: i64| (us, AxisCounts::new([7, y, -3], &[]));
        let moments = |from, to| rhythm.moments(from, to);
        assert_eq!(moments(at(0, -15), at(3000, 15)), [500.0, 1500.0, 2500.0]);
        assert_eq!(moments(at(0, 15), at(3000, -15)), [500.0, 1500.0, 2500.0]);
        assert_eq!(moments(at(100, 0), at(200, 10)), [200.0]);
        assert_eq!(moments(at(200, 10), at(300, 20)), [300.0]);
        assert_eq!(moments(at(300, 20), at(400, 10)), [400.0]);
        assert!(moments(at(400, 10), at(500, 1)).is_empty());
        assert!(moments(at(500, 5), at(900, 5)).is_empty());
        let time = Rhythm::Time(100.0);
        assert_eq!(time.moments(at(0, 0), at(300, 0)), [100.0, 200.0, 300.0]);
    }

    /// With an output that rests high the line rises when the pulse ends, and the axes have moved.
    #[test]
    fn an_output_that_rests_high_triggers_at_its_end() {
        let sent = sent(300, SignalLevel::High);
        let shot = rise(
            &sent.latches[1],
            sent.pulse,
            3,
            [0.1, 0.0, -1.0, 0.0, 0.0, 0.0],
        );
        assert_eq!(
            (shot.at_us, shot.counts.all),
            (10_300.0, [130, 0, -300, 0, 0, 0])
        );
        assert_eq!(tally(&sent).taken, 3);
    }
}
