//! Profiles and positions become points.
//!
//! * [`Merger`]: the pose of the sensor for each paired profile, at the moment of its exposure.
//! * [`merge`]: everything from files to a file, streaming.
//!
//! Points are not held in memory: stamps first, which are tens of bytes a profile, then every
//! profile once.

mod moment;

use std::collections::HashMap;
use std::path::Path;

use nalgebra::Vector3;
use serde::Serialize;
use umi_kinematics::{AxisChain, Drive, Pose};

use crate::ScanError;
use crate::format::points::PointSink;
use crate::format::profiles::{self, Depth};
use crate::format::triggers::{TriggerLatch, Triggers};
use crate::pair::{PairOptions, ScanPairing, pair};
use moment::counts_at;

/// The answer of `umi scan merge`.
#[derive(Debug, Clone, Serialize)]
pub struct Merged {
    /// As `umi scan pair` answers.
    #[serde(flatten)]
    pub pairing: ScanPairing,
    /// How many profiles were read.
    pub profiles: u64,
    /// How many have a latch.
    pub paired: u64,
    /// How many points were written.
    pub points: u64,
    /// Samples of paired profiles that the file holds without a range.
    pub invalid: u64,
    /// What the points span; none without points.
    pub bounds_mm: Option<Bounds>,
}

/// The least and the greatest coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Bounds {
    /// The least x, y and z.
    pub min: [f64; 3],
    /// The greatest x, y and z.
    pub max: [f64; 3],
}

impl Bounds {
    fn of(point: [f64; 3]) -> Self {
        Self {
            min: point,
            max: point,
        }
    }

    fn take(&mut self, point: &[f64; 3]) {
        for ((min, max), &value) in self.min.iter_mut().zip(&mut self.max).zip(point) {
            *min = min.min(value);
            *max = max.max(value);
        }
    }
}

/// Where the machine held the sensor at each latch.
pub struct Merger<'a> {
    machine: &'a AxisChain,
    latches: &'a [TriggerLatch],
    /// For every joint a constant, or the place of its counts.
    sources: Vec<Source>,
    latency_us: f64,
}

enum Source {
    Constant(f64),
    Counts(usize),
}

impl<'a> Merger<'a> {
    /// Checks that the table has counts for every joint of the machine. The sensor sees
    /// `latency_us` after the edge, or before it where that is negative.
    ///
    /// # Errors
    /// `missing_axis`; `not_finite` for the latency; `too_few_latches` where there is a
    /// latency, but no motion to take from one latch.
    pub fn new(
        machine: &'a AxisChain,
        triggers: &'a Triggers,
        latency_us: f64,
    ) -> Result<Self, ScanError> {
        if !latency_us.is_finite() {
            return Err(ScanError::refused(
                "not_finite",
                "the latency is not finite",
            ));
        }
        if latency_us != 0.0 && triggers.latches.len() < 2 {
            return Err(ScanError::refused(
                "too_few_latches",
                "with one latch nobody knows where the axes were before or after it",
            ));
        }
        let mut sources: Vec<Source> = machine
            .joints
            .iter()
            .map(|joint| Source::Constant(joint.constant().unwrap_or(0.0)))
            .collect();
        for (place, joint) in machine.moving() {
            let Drive::Encoder { column, .. } = joint.drive else {
                if joint.constant().is_some() {
                    continue;
                }
                return Err(missing_axis(
                    &joint.name,
                    "has no encoder in the machine file",
                ));
            };
            let axis = umi_kinematics::COLUMNS
                .iter()
                .position(|&known| known == column)
                .unwrap_or(0);
            if let Some(latch) = triggers.latches.iter().find(|l| l.counts[axis].is_none()) {
                return Err(missing_axis(
                    &joint.name,
                    &format!("has no {column}_counts at latch {}", latch.number),
                ));
            }
            sources[place] = Source::Counts(axis);
        }
        Ok(Self {
            machine,
            latches: &triggers.latches,
            sources,
            latency_us,
        })
    }

    /// The sensor in the workpiece's frame for the latch at a place of the table.
    #[must_use]
    pub fn pose(&self, latch: usize) -> Pose {
        let q: Vec<f64> = self
            .sources
            .iter()
            .zip(&self.machine.joints)
            .map(|(source, joint)| match source {
                Source::Constant(value) => *value,
                Source::Counts(axis) => {
                    let counts = counts_at(self.latches, latch, *axis, self.latency_us);
                    joint.value(counts).unwrap_or(0.0)
                }
            })
            .collect();
        self.machine.sensor_in_workpiece(&q)
    }
}

fn missing_axis(joint: &str, what: &str) -> ScanError {
    ScanError::refused(
        "missing_axis",
        format_args!("the joint {joint:?} of the machine {what}"),
    )
    .with("joint", joint)
}

/// Pairs the profiles of a file, and writes a point for each valid sample of those that have
/// a latch.
///
/// # Errors
/// `motion_lost` where the counts of a pair are wrong and not only those before (`until_loss`) are
/// wanted; those of [`pair`], [`Merger::new`] and the files. What was written until then is for the
/// caller to throw away.
pub fn merge(
    profiles: &Path,
    triggers: &Triggers,
    machine: &AxisChain,
    latency_us: f64,
    options: &PairOptions,
    until_loss: bool,
    sink: &mut dyn PointSink,
) -> Result<Merged, ScanError> {
    let merger = Merger::new(machine, triggers, latency_us)?;
    let stamps = profiles::stamps(profiles)?;
    let pairing = pair(&stamps, triggers, options)?;
    let right = triggers.right();
    let wrong = pairing.pairs.iter().filter(|pair| pair.latch >= right);
    let wrong = wrong.count();
    if wrong > 0 && !until_loss {
        return Err(ScanError::refused(
            "motion_lost",
            format_args!(
                "the board lost motion of an axis, and behind that the counts of {} latches are \
                 wrong: scan again, or take the {} profiles before it with --until-loss",
                triggers.latches.len() - right,
                pairing.pairs.len() - wrong
            ),
        )
        .with("right_latches", right as u64)
        .with("wrong_profiles", wrong as u64));
    }
    let latches: HashMap<u64, usize> = pairing
        .pairs
        .iter()
        .filter(|pair| pair.latch < right)
        .map(|pair| (pair.profile, pair.latch))
        .collect();
    let mut merged = Merged {
        profiles: stamps.len() as u64,
        paired: latches.len() as u64,
        points: 0,
        invalid: 0,
        bounds_mm: None,
        pairing,
    };
    let mut points = Vec::new();
    profiles::visit(profiles, Depth::Samples, |profile| {
        let Some(&latch) = latches.get(&profile.stamp.profile) else {
            return Ok(());
        };
        let pose = merger.pose(latch);
        points.clear();
        points.extend(profile.samples.iter().map(|sample| {
            let point = pose.point(&Vector3::new(sample.x_mm, 0.0, sample.z_mm));
            (sample.index, <[f64; 3]>::from(point))
        }));
        if let Some((_, first)) = points.first() {
            let bounds = merged.bounds_mm.get_or_insert_with(|| Bounds::of(*first));
            points.iter().for_each(|(_, point)| bounds.take(point));
        }
        merged.points += points.len() as u64;
        merged.invalid += profile.invalid;
        sink.profile(profile.stamp.profile, &points)
    })?;
    sink.finish(merged.points)?;
    Ok(merged)
}
