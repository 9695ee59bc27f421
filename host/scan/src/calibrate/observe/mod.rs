//! Observations straight from a scan: the ball or the plane in every profile, and where the machine
//! held the sensor.

pub mod centres;

use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::Path;

use nalgebra::Vector3;
use serde::Serialize;
use umi_kinematics::AxisChain;

use super::sensor::Artefact;
use super::shapes::{FoundShape, ProfileShape, Wanted, find};
use crate::ScanError;
use crate::format::profiles::{self, Depth};
use crate::format::triggers::Triggers;
use crate::merge::Merger;
use crate::pair::{PairOptions, pair};
use crate::rigid::Vec3;

/// What is looked for, and how.
#[derive(Debug, Clone)]
pub struct ObserveOptions {
    /// How profiles find their latches.
    pub pairing: PairOptions,
    /// The sensor sees so many microseconds after the edge.
    pub latency_us: f64,
    /// Balls or a plane.
    pub on: Artefact,
    /// Of the balls; none where it is free.
    pub radius_mm: Option<f64>,
    /// Known centres in the workpiece's frame, by the features' names.
    pub centres: Option<HashMap<String, Vec3>>,
    /// A sample within this of the shape may be of it; then within four standard deviations.
    pub within_mm: f64,
    /// Balls are further apart than this: cuts that are nearer are of one.
    pub apart_mm: f64,
    /// At most so many samples of a profile are kept, evenly.
    pub samples: usize,
}

/// What was used, and what was not.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Observed {
    /// Profiles that were read.
    pub profiles: u64,
    /// With a latch.
    pub paired: u64,
    /// In which the artefact was found.
    pub used: u64,
    /// In which it was not.
    pub nothing_found: u64,
    /// Whose arc is of none of the known balls.
    pub of_no_centre: u64,
    /// Observations that were written.
    pub observations: u64,
    /// Samples of used profiles that lie beside the artefact.
    pub samples_beside: u64,
    /// Samples on it that are steeper than 65 degrees.
    pub samples_steep: u64,
    /// Samples on it that were left out for the number wanted.
    pub samples_thinned: u64,
    /// Profiles by feature.
    pub features: Vec<SeenFeature>,
}

/// A ball or plane, and in how many profiles it was found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SeenFeature {
    /// Its name.
    pub feature: String,
    /// Profiles.
    pub profiles: u64,
}

/// The two tables of `umi scan calibrate sensor`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ObservedTables {
    /// `profile,feature,x_mm,z_mm`.
    pub observations: String,
    /// `profile` and the joints.
    pub positions: String,
}

/// Finds the artefact in all profiles of a scan.
///
/// # Errors
/// Those of pairing and merging; `motion_lost`; `too_few_points` where nothing was found.
pub fn observe(
    path: &Path,
    triggers: &Triggers,
    machine: &AxisChain,
    options: &ObserveOptions,
) -> Result<(Observed, ObservedTables), ScanError> {
    let merger = Merger::new(machine, triggers, options.latency_us)?;
    let stamps = profiles::stamps(path)?.stamps;
    let pairing = pair(&stamps, triggers, &options.pairing)?;
    if pairing.pairs.iter().any(|pair| !merger.knows(pair.latch)) {
        return Err(ScanError::refused(
            "motion_lost",
            "the board lost motion of an axis during this scan: scan again",
        ));
    }
    let latches: HashMap<u64, usize> = pairing
        .pairs
        .iter()
        .map(|pair| (pair.profile, pair.latch))
        .collect();
    let moving: Vec<usize> = machine
        .moving()
        .filter(|(_, joint)| joint.constant().is_none())
        .map(|(place, _)| place)
        .collect();
    let mut tables = ObservedTables {
        observations: "profile,feature,x_mm,z_mm\n".into(),
        positions: String::from("profile"),
    };
    for &place in &moving {
        tables.positions += ",";
        tables.positions += &machine.joints[place].name;
    }
    tables.positions += "\n";
    let mut seen = Observed {
        profiles: stamps.len() as u64,
        paired: latches.len() as u64,
        used: 0,
        nothing_found: 0,
        of_no_centre: 0,
        observations: 0,
        samples_beside: 0,
        samples_steep: 0,
        samples_thinned: 0,
        features: Vec::new(),
    };
    let mut balls = Balls::of(options);
    let wanted = match options.on {
        Artefact::Plane => Wanted::Line,
        Artefact::Sphere => Wanted::Arc(options.radius_mm),
    };
    profiles::visit(path, Depth::Samples, |profile| {
        let number = profile.stamp.profile;
        let Some(&latch) = latches.get(&number) else {
            return Ok(());
        };
        let Some(found) = find(profile.samples, wanted, options.within_mm) else {
            seen.nothing_found += 1;
            return Ok(());
        };
        let q = merger.joints(latch);
        let feature = match found.shape {
            ProfileShape::Line { .. } => Some("0".to_owned()),
            ProfileShape::Circle { x, z, .. } => {
                let pose = machine.sensor_in_workpiece(&q);
                balls.name(&pose.point(&Vector3::new(x, 0.0, z)))
            }
        };
        let Some(feature) = feature else {
            seen.of_no_centre += 1;
            return Ok(());
        };
        let FoundShape { kept, steep, .. } = found;
        let every = kept.len().div_ceil(options.samples.max(1));
        seen.used += 1;
        seen.samples_steep += steep as u64;
        seen.samples_beside += (profile.samples.len() - kept.len() - steep) as u64;
        for &place in kept.iter().step_by(every) {
            let sample = &profile.samples[place];
            // Writing to a string cannot fail.
            let _ = writeln!(
                tables.observations,
                "{number},{feature},{},{}",
                sample.x_mm, sample.z_mm
            );
            seen.observations += 1;
        }
        seen.samples_thinned += (kept.len() - kept.len().div_ceil(every)) as u64;
        let _ = write!(tables.positions, "{number}");
        for &place in &moving {
            let _ = write!(tables.positions, ",{}", q[place]);
        }
        tables.positions += "\n";
        match seen.features.iter_mut().find(|f| f.feature == feature) {
            Some(known) => known.profiles += 1,
            None => seen.features.push(SeenFeature {
                feature,
                profiles: 1,
            }),
        }
        Ok(())
    })?;
    if seen.used == 0 {
        return Err(ScanError::refused(
            "too_few_points",
            format_args!(
                "in none of {} profiles with a latch was the artefact found: is it the right one, \
                 with the right radius?",
                seen.paired
            ),
        ));
    }
    Ok((seen, tables))
}

/// Which ball a cut is of, by where the machine file's mount puts it.
pub(super) struct Balls {
    known: Option<Vec<(String, Vec3)>>,
    /// Where the others were seen first.
    found: Vec<Vec3>,
    apart_mm: f64,
}

impl Balls {
    fn of(options: &ObserveOptions) -> Self {
        let known = options.centres.as_ref().map(|centres| {
            let mut known: Vec<(String, Vec3)> = centres
                .iter()
                .map(|(name, at)| (name.clone(), *at))
                .collect();
            known.sort_by(|a, b| a.0.cmp(&b.0));
            known
        });
        Self {
            known,
            found: Vec::new(),
            apart_mm: options.apart_mm,
        }
    }

    /// Those that nobody has told of.
    pub fn unknown(apart_mm: f64) -> Self {
        Self {
            known: None,
            found: Vec::new(),
            apart_mm,
        }
    }

    pub fn name(&mut self, at: &Vec3) -> Option<String> {
        let nearest = |all: &mut dyn Iterator<Item = (usize, f64)>| {
            all.min_by(|a, b| a.1.total_cmp(&b.1))
                .filter(|(_, distance)| *distance < self.apart_mm)
        };
        if let Some(known) = &self.known {
            let mut all = known.iter().map(|(_, ball)| (ball - at).norm()).enumerate();
            return nearest(&mut all).map(|(place, _)| known[place].0.clone());
        }
        let mut all = self.found.iter().map(|ball| (ball - at).norm()).enumerate();
        let place = nearest(&mut all).map(|(place, _)| place);
        Some(
            place
                .unwrap_or_else(|| {
                    self.found.push(*at);
                    self.found.len() - 1
                })
                .to_string(),
        )
    }
}
