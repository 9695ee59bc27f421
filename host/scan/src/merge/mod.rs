//! Profiles and positions become points.
//!
//! * [`Merger`]: the pose of the sensor for each paired profile, at the moment of its exposure.
//! * [`merge`]: everything from files to a file, streaming.
//!
//! Points are not held in memory: stamps first, which are tens of bytes a profile, then every
//! profile once.

mod axes;
mod moment;
mod mount;

use std::collections::{HashMap, HashSet};
use std::path::Path;

use nalgebra::Vector3;
use serde::Serialize;
use umi_kinematics::{AxisChain, Drive, Pose};

use crate::ScanError;
use crate::format::points::PointSink;
use crate::format::profiles::{self, Depth};
use crate::format::triggers::{TriggerLatch, Triggers};
use crate::pair::{PairOptions, ScanPairing, pair};
use crate::rigid::FARTHEST_MM;
use moment::{between, counts_at};
use mount::MountShare;
pub use mount::MountUncertainty;

/// The answer of `umi scan merge`.
#[derive(Debug, Clone, Serialize)]
pub struct Merged {
    /// As `umi scan pair` answers; its pairs are those whose counts are right.
    #[serde(flatten)]
    pub pairing: ScanPairing,
    /// How many profiles were read.
    pub profiles: u64,
    /// How many have a latch whose counts are right, as many as `pairs`.
    pub paired: u64,
    /// Profiles that were left out because the board lost motion before their latch
    /// ([`MergeOptions::until_loss`]).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub behind_loss: Vec<u64>,
    /// How many points were written.
    pub points: u64,
    /// Samples of paired profiles that the file holds without a range.
    pub invalid: u64,
    /// Profiles without a latch whose place was taken from the latches before and behind them;
    /// only where that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interpolated: Option<Vec<u64>>,
    /// How uncertain the points are by the mount alone, where the machine file has its covariance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount_u_mm: Option<MountUncertainty>,
    /// What the points span; none without points.
    pub bounds_mm: Option<Bounds>,
}

/// How profiles become points.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MergeOptions {
    /// How profiles find their latches.
    pub pairing: PairOptions,
    /// The sensor sees so many microseconds after the edge; before it, if negative.
    pub latency_us: f64,
    /// If the board lost motion of an axis, take the profiles before.
    pub until_loss: bool,
    /// A profile without a latch gets its place from the latches before and behind it, where these
    /// are at most so many microseconds apart.
    pub interpolate_us: Option<f64>,
    /// Each point gets its standard uncertainty by the mount.
    pub uncertainties: bool,
    /// Each point gets the intensity of its sample.
    pub intensities: bool,
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

    /// The greatest coordinate, whichever its sign.
    #[must_use]
    pub fn farthest_mm(&self) -> f64 {
        let all = self.min.iter().chain(&self.max);
        all.fold(0.0, |most, mm| mm.abs().max(most))
    }

    fn take(&mut self, point: &[f64; 3]) {
        for ((min, max), &value) in self.min.iter_mut().zip(&mut self.max).zip(point) {
            *min = min.min(value);
            *max = max.max(value);
        }
    }
}

/// What is longer than ten seconds is another unit.
const LONGEST_LATENCY_US: f64 = 1e7;

/// What is shorter is in seconds or milliseconds.
const LEAST_LATENCY_US: f64 = 1.0;

/// Where the machine held the sensor at each latch.
pub struct Merger<'a> {
    machine: &'a AxisChain,
    /// Those whose counts are right.
    latches: &'a [TriggerLatch],
    /// Motion was lost behind them.
    is_cut: bool,
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
    /// `missing_axis`; `not_finite` or `latency` for the latency; `too_few_latches` where there is a
    /// latency, but no motion to take from one latch; `motion_lost` where no latch is right.
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
        if latency_us.abs() > LONGEST_LATENCY_US {
            return Err(ScanError::refused(
                "latency",
                format_args!(
                    "no sensor sees {latency_us:e} µs from its edge: give --latency-us in microseconds"
                ),
            ));
        }
        let latches = &triggers.latches[..triggers.right()];
        if triggers.right_until_ns.is_some() && latches.is_empty() {
            return Err(lost_from_the_start());
        }
        if latency_us != 0.0 && latches.len() < 2 {
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
            latches,
            is_cut: triggers.right_until_ns.is_some(),
            sources,
            latency_us,
        })
    }

    /// Whether it is known where the sensor was when it saw what belongs to the latch at a place of the table. Behind the
    /// last latch before a loss of motion nobody knows, whatever the latches behind the loss say.
    #[must_use]
    pub fn knows(&self, latch: usize) -> bool {
        let (Some(of), Some(last)) = (self.latches.get(latch), self.latches.last()) else {
            return false;
        };
        let left_ns = last.t_ns.saturating_sub(of.t_ns) as f64;
        !self.is_cut || self.latency_us * 1e3 <= left_ns
    }

    /// How far outside the time of the latches the sensor saw what belongs to the latch at a place, in intervals of the
    /// two latches there.
    fn outside(&self, latch: usize) -> f64 {
        let since_ns = |from: usize, to: usize| {
            self.latches[to]
                .t_ns
                .saturating_sub(self.latches[from].t_ns) as f64
        };
        let last = self.latches.len() - 1;
        if last == 0 || self.latency_us == 0.0 {
            return 0.0;
        }
        let moment_ns = since_ns(0, latch) + self.latency_us * 1e3;
        let before = -moment_ns / since_ns(0, 1);
        let behind = (moment_ns - since_ns(0, last)) / since_ns(last - 1, last);
        before.max(behind).max(0.0)
    }

    /// The sensor in the workpiece's frame for the latch at a place of the table, one that it [knows](Self::knows).
    #[must_use]
    pub fn pose(&self, latch: usize) -> Pose {
        self.pose_by(|axis| counts_at(self.latches, latch, axis, self.latency_us))
    }

    /// When the sensor saw what belongs to the latch at a place of the table, in microseconds of the board's clock.
    #[must_use]
    pub fn seen_us(&self, latch: usize) -> f64 {
        let t_ns = self.latches.get(latch).map_or(0, |latch| latch.t_ns);
        t_ns as f64 / 1e3 + self.latency_us
    }

    /// The sensor for an edge at a moment of the board's clock that no latch tells, on the straight
    /// line between those before and behind it; none where these are more than `most_us` apart.
    #[must_use]
    pub fn pose_between(&self, t_us: f64, most_us: f64) -> Option<Pose> {
        let (left, share) = between(self.latches, (t_us + self.latency_us) * 1e3)?;
        let (a, b) = (&self.latches[left], &self.latches[left + 1]);
        if b.t_ns.saturating_sub(a.t_ns) as f64 > most_us * 1e3 {
            return None;
        }
        Some(self.pose_by(|axis| {
            let (from, to) = (a.counts[axis].unwrap_or(0), b.counts[axis].unwrap_or(0));
            from as f64 + share * to.saturating_sub(from) as f64
        }))
    }

    /// Whether no encoder of the machine counted between the first latch and the last.
    fn stands_still(&self) -> bool {
        let axes = self.sources.iter().filter_map(|source| match source {
            Source::Constant(_) => None,
            Source::Counts(axis) => Some(*axis),
        });
        let axes: Vec<usize> = axes.collect();
        let still = |axis: usize| {
            let first = self.latches.first().and_then(|latch| latch.counts[axis]);
            self.latches.iter().all(|latch| latch.counts[axis] == first)
        };
        self.latches.len() > 2 && !axes.is_empty() && axes.into_iter().all(still)
    }

    /// The joints' values at the latch at a place of the table, mm and degrees.
    #[must_use]
    pub fn joints(&self, latch: usize) -> Vec<f64> {
        self.joints_by(|axis| counts_at(self.latches, latch, axis, self.latency_us))
    }

    fn pose_by(&self, counts: impl Fn(usize) -> f64) -> Pose {
        self.machine.sensor_in_workpiece(&self.joints_by(counts))
    }

    fn joints_by(&self, counts: impl Fn(usize) -> f64) -> Vec<f64> {
        self.sources
            .iter()
            .zip(&self.machine.joints)
            .map(|(source, joint)| match source {
                Source::Constant(value) => *value,
                Source::Counts(axis) => joint.value(counts(*axis)).unwrap_or(0.0),
            })
            .collect()
    }
}

/// A point without one would be as dark as one that was seen to be.
fn no_intensity(profile: u64) -> ScanError {
    ScanError::refused(
        "no_intensity",
        format_args!(
            "nothing says how bright the samples of profile {profile} were: let the sensor send intensities (in CSV, the column              `intensity`), or merge without --intensity-too"
        ),
    )
    .with("profile", profile)
}

fn lost_from_the_start() -> ScanError {
    ScanError::refused(
        "motion_lost",
        "the board lost motion of an axis before the first profile: no profile has counts that are \
         right; scan again",
    )
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
/// `no_intensity` where intensities are wanted and a profile has none;
/// `motion_lost` where the counts of a pair are wrong and not only those before ([`MergeOptions::until_loss`]) are
/// wanted; those of [`pair`], [`Merger::new`] and the files. What was written until then is for the
/// caller to throw away.
pub fn merge(
    profiles: &Path,
    triggers: &Triggers,
    machine: &AxisChain,
    options: &MergeOptions,
    sink: &mut dyn PointSink,
) -> Result<Merged, ScanError> {
    let merger = Merger::new(machine, triggers, options.latency_us)?;
    if options.uncertainties && machine.sensor_covariance.is_none() {
        return Err(ScanError::refused(
            "no_uncertainty",
            "the machine file does not say how uncertain the mount is: [sensor] has no covariance; umi scan calibrate \
             sensor -o writes it",
        ));
    }
    let came = profiles::stamps(profiles)?;
    let mut pairing = pair(&came.stamps, triggers, &options.pairing)?;
    pairing.warnings.extend(came.warning());
    let stamps = came.stamps;
    let right = triggers.right();
    let (known, wrong): (Vec<_>, Vec<_>) = std::mem::take(&mut pairing.pairs)
        .into_iter()
        .partition(|pair| merger.knows(pair.latch));
    if known.is_empty() && !wrong.is_empty() {
        return Err(lost_from_the_start());
    }
    if !wrong.is_empty() && !options.until_loss {
        return Err(ScanError::refused(
            "motion_lost",
            format_args!(
                "the board lost motion of an axis, and behind that the counts of {} latches are \
                 wrong: scan again, or take the {} profiles before it with --until-loss",
                triggers.latches.len() - right,
                known.len()
            ),
        )
        .with("right_latches", right as u64)
        .with("wrong_profiles", wrong.len() as u64));
    }
    pairing.pairs = known;
    let latches: HashMap<u64, usize> = pairing
        .pairs
        .iter()
        .map(|pair| (pair.profile, pair.latch))
        .collect();
    let between: HashMap<u64, (f64, Pose)> = options
        .interpolate_us
        .map(|most_us| {
            let drift = 1.0 + pairing.clock.drift_ppm * 1e-6;
            let unpaired: HashSet<u64> = pairing.unpaired_profiles.iter().copied().collect();
            let unpaired = stamps.iter().filter(|s| unpaired.contains(&s.profile));
            let places = unpaired.filter_map(|stamp| {
                let t_us = pairing.clock.offset_us + drift * stamp.t_us;
                let pose = merger.pose_between(t_us, most_us)?;
                Some((stamp.profile, (t_us + options.latency_us, pose)))
            });
            places.collect()
        })
        .unwrap_or_default();
    pairing
        .warnings
        .extend(crate::format::machine::warnings(machine));
    let mut merged = Merged {
        profiles: stamps.len() as u64,
        paired: latches.len() as u64,
        behind_loss: wrong.iter().map(|pair| pair.profile).collect(),
        points: 0,
        invalid: 0,
        interpolated: options.interpolate_us.map(|_| {
            let mut profiles: Vec<u64> = between.keys().copied().collect();
            profiles.sort_unstable();
            profiles
        }),
        mount_u_mm: None,
        bounds_mm: None,
        pairing,
    };
    if !between.is_empty() {
        sink.interpolating()?;
    }
    let mut mount = MountShare::of(machine);
    let mut points = Vec::new();
    let mut uncertainties = Vec::new();
    let depth = if options.intensities {
        Depth::Intensities
    } else {
        Depth::Samples
    };
    profiles::visit(profiles, depth, |profile| {
        let number = profile.stamp.profile;
        let of_latch = latches
            .get(&number)
            .map(|&latch| (merger.seen_us(latch), merger.pose(latch)));
        let is_between = of_latch.is_none();
        let Some((t_us, pose)) = of_latch.or_else(|| between.get(&number).copied()) else {
            return Ok(());
        };
        points.clear();
        points.extend(profile.samples.iter().map(|sample| {
            let point = pose.point(&Vector3::new(sample.x_mm, 0.0, sample.z_mm));
            (sample.index, <[f64; 3]>::from(point))
        }));
        if points
            .iter()
            .flat_map(|(_, at)| at)
            .any(|mm| mm.is_nan() || mm.abs() > FARTHEST_MM)
        {
            return Err(ScanError::refused(
                "not_finite",
                format_args!(
                    "a point of profile {number} is not finite, or farther out than 1000 km: look at the scales of the machine's \
                     axes, their counts and the latency"
                ),
            )
            .with("profile", number));
        }
        if let Some(mount) = &mut mount {
            uncertainties.clear();
            uncertainties.extend(
                profile
                    .samples
                    .iter()
                    .map(|sample| mount.take(&Vector3::new(sample.x_mm, 0.0, sample.z_mm))),
            );
        }
        if let Some((_, first)) = points.first() {
            let bounds = merged.bounds_mm.get_or_insert_with(|| Bounds::of(*first));
            points.iter().for_each(|(_, point)| bounds.take(point));
        }
        merged.points += points.len() as u64;
        merged.invalid += profile.invalid;
        sink.pose(number, &pose)?;
        sink.time(t_us);
        sink.interpolated(is_between);
        if options.uncertainties {
            sink.uncertainties(&uncertainties);
        }
        if options.intensities {
            match profile.intensities {
                Some(intensities) => sink.intensities(intensities),
                None if profile.samples.is_empty() => sink.intensities(&[]),
                None => return Err(no_intensity(number)),
            }
        }
        sink.profile(number, &points)
    })?;
    if merged.points == 0 {
        merged.pairing.warnings.push(
            "no_range: no sample of a profile with a latch has a range: the cloud is empty".into(),
        );
    }
    let latency_us = options.latency_us.abs();
    if latency_us > 0.0 && latency_us < LEAST_LATENCY_US {
        merged.pairing.warnings.push(format!(
            "latency: {} µs moves nothing, and no exposure is so short: --latency-us is in microseconds",
            options.latency_us
        ));
    }
    let outside = latches.values().map(|&latch| merger.outside(latch));
    let far: Vec<f64> = outside.filter(|intervals| *intervals > 1.0).collect();
    if let Some(most) = far.iter().copied().reduce(f64::max) {
        merged.pairing.warnings.push(format!(
            "extrapolated: with this latency {} profiles were seen up to {most:.0} intervals of the trigger before the first \
             latch or behind the last: their places are guessed; look at the unit of --latency-us",
            far.len()
        ));
    }
    let moved = axes::warnings(machine, merger.latches);
    merged.pairing.warnings.extend(moved);
    if merger.stands_still() {
        merged.pairing.warnings.push(
            "stationary: no axis of the machine moved between the latches: all profiles lie in one \
             plane of the workpiece"
                .into(),
        );
    }
    sink.finish(merged.points)?;
    merged.mount_u_mm = mount.and_then(|mount| mount.finish());
    Ok(merged)
}
