//! The machine, its sensor and the board.

use nalgebra::Vector3;
use umi_kinematics::{AxisChain, Drive, Pose};
use umi_scan::ScanError;
use umi_scan::format::profiles::{Depth, gocator};
use umi_scan::format::triggers::{LatchSignal, TriggerLatch, Triggers};
use umi_scan::merge::Merger;
use umi_scan::pair::{PairOptions, pair};
use umi_scan::parallel::Threads;
use umi_scan::profile::{ProfilePoint, Stamp};
use umi_virtual::scanner::{LaserTarget, LineScanner};
use umi_virtual::scene::LineScannerSpec;

/// The board's pulses are longer than the sensor needs.
const PULSE_US: f64 = 50.0;

/// S2's machine: X, Y, Z carry the sensor, A and C the workpiece; a micrometre a count. The
/// sensor's line goes along Y, so that a scan steps along X.
const MACHINE: &str = r#"
[[joint]]
name = "X"
kind = "linear"
direction = [1, 0, 0]
column = "x"
counts_per_mm = 1000
[[joint]]
name = "Y"
kind = "linear"
direction = [0, 1, 0]
column = "y"
counts_per_mm = 1000
[[joint]]
name = "Z"
kind = "linear"
direction = [0, 0, 1]
column = "z"
counts_per_mm = 1000
[[joint]]
name = "A"
kind = "rotary"
direction = [1, 0, 0]
point_mm = [0, 0, -60]
column = "w"
counts_per_deg = 10000
[[joint]]
name = "C"
kind = "rotary"
direction = [0, 0, 1]
point_mm = [0, 0, 0]
column = "axis5"
counts_per_deg = 10000
[chain]
sensor = ["X", "Y", "Z"]
workpiece = ["A", "C"]
[sensor]
rotation = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
translation_mm = [0, 15, -75]
"#;

/// Where the axes are at a trigger: X, Y, Z in mm, A, C in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// The joints.
    pub q: [f64; 5],
    /// Their speeds, a second.
    pub speed: [f64; 5],
    /// When, from the begin of the recording.
    pub at_us: f64,
}

/// A profile in the workpiece's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// Samples in the sensor's frame.
    pub samples: Vec<ProfilePoint>,
    /// The same in the workpiece's frame.
    pub points: Vec<Vector3<f64>>,
}

/// What a scan left: the sensor's channel and the board's table.
#[derive(Clone, Debug)]
pub struct Recording {
    /// Byte for byte.
    pub channel: Vec<u8>,
    /// The latches.
    pub triggers: Triggers,
}

/// The machine with its sensor, which nobody knows exactly.
#[derive(Clone, Debug)]
pub struct TableMachine {
    /// The machine as it is.
    pub truth: AxisChain,
    /// The machine file: the mount as drawn.
    pub drawn: AxisChain,
    scanner: LineScanner,
    /// When the next recording begins, on the board's clock: it never goes back.
    begin_us: f64,
}

impl TableMachine {
    /// The machine with a sensor whose mount is off by some degrees and millimetres.
    ///
    /// # Panics
    /// Never: the machine file is a constant of this file.
    #[must_use]
    pub fn new(spec: LineScannerSpec, seed: u64) -> Self {
        let Ok(drawn) = AxisChain::parse(MACHINE) else {
            unreachable!("the machine file is a constant")
        };
        let mut truth = drawn.clone();
        let tilt = Pose::turn(
            &Vector3::new(0.6, -0.5, 0.62),
            &Vector3::zeros(),
            1.3_f64.to_radians(),
        );
        truth.sensor = Pose {
            translation_mm: drawn.sensor.translation_mm + Vector3::new(2.4, -1.7, 3.1),
            ..tilt.after(&drawn.sensor)
        };
        Self {
            truth,
            drawn,
            scanner: LineScanner::new(spec, seed),
            begin_us: 0.0,
        }
    }

    /// The sensor.
    #[must_use]
    pub const fn spec(&self) -> &LineScannerSpec {
        self.scanner.spec()
    }

    /// The linear axes at which a place of the workpiece is at a place of the sensor, as the
    /// machine file has the mount, with the table turned like this.
    #[must_use]
    pub fn aim(&self, place: &Vector3<f64>, seen: &Vector3<f64>, a: f64, c: f64) -> [f64; 5] {
        // The flange in the workpiece's frame with the linear axes at 0.
        let flange = self.drawn.flange_in_workpiece(&[0.0, 0.0, 0.0, a, c]);
        let t = flange.undo(place) - self.drawn.sensor.point(seen);
        [t.x, t.y, t.z, a, c]
    }

    /// Triggers the sensor at each stop. Encoders show where the axes are to a count; what the
    /// sensor sees is where they are.
    pub fn record(&mut self, surface: &dyn LaserTarget, stops: &[Stop]) -> Recording {
        let optics = self.scanner.optics().clone();
        let truth = &self.truth;
        let clean = Threads::all().chunks(stops.len(), 1, |range| {
            let stop = &stops[range.start];
            optics.profile(surface, |us| {
                let q: Vec<f64> = stop
                    .q
                    .iter()
                    .zip(&stop.speed)
                    .map(|(q, speed)| q + speed * us * 1e-6)
                    .collect();
                truth.sensor_in_workpiece(&q)
            })
        });
        let mut channel = Vec::new();
        let mut latches = Vec::new();
        for ((stop, profile), number) in stops.iter().zip(clean).zip(0..) {
            let at_us = self.begin_us + stop.at_us;
            // What is dropped has a latch all the same.
            let fate = self.scanner.pulse(at_us, PULSE_US);
            if fate == umi_virtual::scanner::PulseFate::Taken {
                let profile = self.scanner.noisy(profile);
                channel.extend(self.scanner.send(at_us, 0, &profile));
            }
            let mut counts = [None; umi_kinematics::COLUMNS.len()];
            for ((joint, q), place) in self.drawn.joints.iter().zip(stop.q).zip(&mut counts) {
                if let Drive::Encoder {
                    counts_per_unit, ..
                } = joint.drive
                {
                    *place = Some((q * counts_per_unit).round() as i64);
                }
            }
            latches.push(TriggerLatch {
                number,
                t_ns: (at_us * 1e3).round() as i64,
                counts,
            });
        }
        self.begin_us += stops.last().map_or(0.0, |stop| stop.at_us);
        Recording {
            channel,
            triggers: Triggers {
                cause: LatchSignal::Output,
                latches,
                missed: 0,
                lost_runs: Vec::new(),
                right_until_ns: None,
            },
        }
    }
}

/// Pairs and merges a recording with a machine file: the commands `pair` and `merge`, in memory.
///
/// # Errors
/// Theirs.
pub fn place(recording: &Recording, machine: &AxisChain) -> Result<Vec<Placed>, ScanError> {
    let mut stamps: Vec<Stamp> = Vec::new();
    let mut samples: Vec<Vec<ProfilePoint>> = Vec::new();
    gocator::visit(
        recording.channel.as_slice(),
        "the scanner",
        Depth::Samples,
        |profile| {
            stamps.push(profile.stamp);
            samples.push(profile.samples.to_vec());
            Ok(())
        },
    )?;
    let pairing = pair(&stamps, &recording.triggers, &PairOptions::default())?;
    let merger = Merger::new(machine, &recording.triggers, 0.0)?;
    Ok(pairing
        .pairs
        .iter()
        .filter_map(|found| {
            let pose = merger.pose(found.latch);
            let samples = samples.get(usize::try_from(found.profile).ok()?)?.clone();
            let point = |s: &ProfilePoint| pose.point(&Vector3::new(s.x_mm, 0.0, s.z_mm));
            let points = samples.iter().map(point).collect();
            Some(Placed { samples, points })
        })
        .collect())
}
