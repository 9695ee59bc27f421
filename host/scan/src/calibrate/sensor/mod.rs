//! The mount of the sensor, from planes or balls that it saw.
//!
//! Minimised is the sum of squares of `n·p - d` (plane) or `|p - c| - R` (ball) over all
//! observations, `p = flange · X · (x, 0, z)` in the workpiece's frame. Unknown are X, and
//! each plane, each centre that is not known, and one radius if it is free.

mod distance;
mod lines;
mod mirror;
mod rivals;
mod sides;
mod starts;

use std::collections::HashMap;

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use serde::Serialize;
use umi_kinematics::Pose;

use super::axis::across;
use super::bar::{self, BallBar, BarAnswer};
use super::features::{
    SampleSights, algebraic_centre, cuts, middles, plane_through, points_by_feature,
};
use super::misfit::{self, Grouping, Misfit, PoseScatter, Suspects};
use super::naming::{name_directions, open_in_words};
use super::observations::{Observation, Observations};
use super::solve::scatter::{left_of_column, scatter_covariance, unit_uncertainty};
use super::solve::{MOST_NOISE_MM, Model, Solution, TakeRow, descend, solve};
use crate::ScanError;
use crate::rigid::rotation_vector;
use lines::numbers_over;
use sides::step_mount;
use starts::best_start;

/// What the sensor looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Artefact {
    /// Planes.
    Plane,
    /// Balls.
    Sphere,
}

/// How the mount is calibrated.
#[derive(Debug, Clone)]
pub struct SensorOptions {
    /// What was looked at.
    pub on: Artefact,
    /// The balls' radius in mm; none where it is free.
    pub radius_mm: Option<f64>,
    /// Centres that are known, in the workpiece's frame, by the features' names.
    pub centres: Option<HashMap<String, Vector3<f64>>>,
    /// Which components of the shift stay as they are.
    pub hold: [bool; 3],
    /// Ball bars whose length is looked at.
    pub bars: Vec<BallBar>,
    /// Answer also where the poses grossly disagree.
    pub allow_misfit: bool,
}

/// The answer of `umi scan calibrate sensor`.
#[derive(Debug, Clone, Serialize)]
pub struct SensorAnswer {
    /// Three rows.
    pub rotation: [[f64; 3]; 3],
    /// The shift of X.
    pub translation_mm: [f64; 3],
    /// Observations.
    pub n: usize,
    /// Observations less unknowns.
    pub dof: usize,
    /// Standard deviation of a residual; none without degrees of freedom.
    pub sigma_mm: Option<f64>,
    /// First six rows and columns of `inv(JᵀJ)`: wx wy wz tx ty tz.
    pub covariance_unit: [[f64; 6]; 6],
    /// `sigma²` times that: rad², rad·mm, mm².
    pub covariance: Option<[[f64; 6]; 6]>,
    /// The same where residuals are not alike everywhere: from each residual's own size.
    pub covariance_scatter: Option<[[f64; 6]; 6]>,
    /// The degrees of freedom of that, for a region of all that was sought (Hotelling).
    pub dof_scatter: Option<f64>,
    /// The same where poses have errors of their own: from what each pose is off as a whole.
    pub covariance_poses: Option<[[f64; 6]; 6]>,
    /// The degrees of freedom of that.
    pub dof_poses: Option<f64>,
    /// Whether the poses agree with one another; none where too little is left to say so.
    pub misfit: Option<Misfit>,
    /// Of the balls.
    pub radius_mm: Option<f64>,
    /// What was seen, in the workpiece's frame.
    pub features: Vec<FeatureAnswer>,
    /// Ball bars beside their certificates.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bars: Vec<BarAnswer>,
    /// The least singular value over the largest, rotations worth 100 mm.
    pub conditioning: f64,
    /// The residual of each observation in mm, in their order.
    #[serde(skip)]
    pub residuals_mm: Vec<f64>,
    /// What is odd, but no reason to refuse.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

impl SensorAnswer {
    /// The covariance to go on with: by the poses where they disagree, else by the residuals' own scatter.
    #[must_use]
    pub fn best_covariance(&self) -> Option<&[[f64; 6]; 6]> {
        let disagree = self.misfit.as_ref().is_some_and(Misfit::stands_out);
        let poses = self.covariance_poses.as_ref().filter(|_| disagree);
        poses
            .or(self.covariance_scatter.as_ref())
            .or(self.covariance.as_ref())
    }

    /// The mount, as a machine file has it.
    #[must_use]
    pub fn mount(&self) -> Pose {
        Pose {
            rotation: Matrix3::from_fn(|i, k| self.rotation[i][k]),
            translation_mm: self.translation_mm.into(),
        }
    }
}

/// A plane or a ball that was seen.
#[derive(Debug, Clone, Serialize)]
pub struct FeatureAnswer {
    /// Its name in the observations.
    pub feature: String,
    /// Observations of it.
    pub n: usize,
    /// Of a plane.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normal: Option<[f64; 3]>,
    /// Of a plane: `normal · p`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_mm: Option<f64>,
    /// Of a ball.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub center_mm: Option<[f64; 3]>,
    /// Root mean square of its residuals.
    pub rms_mm: f64,
    /// The largest of its residuals, by size.
    pub max_mm: f64,
}

/// What a radian of the mount is worth beside a millimetre.
const REACH_MM: f64 = 100.0;
/// A standard uncertainty above this is no calibration: 1 mm, 1 mrad.
const MOST_UNCERTAIN: [f64; 2] = [1e-3, 1.0];
/// Unknowns of the mount, by their names.
const NAMES: [&str; 6] = ["wx", "wy", "wz", "tx", "ty", "tz"];

#[derive(Clone)]
struct MountModel<'a> {
    all: &'a Observations,
    mount: Pose,
    features: Vec<SampleSights>,
    radius_mm: f64,
    radius_free: bool,
    centres_known: bool,
    /// Which of the six are sought.
    sought: [bool; 6],
}

/// An observation by a mount: where it is on the artefact, and what changes its residual.
struct Sight {
    value: f64,
    /// In the workpiece's frame.
    at_mm: Vector3<f64>,
    /// From the flange's origin, in its frame.
    arm_mm: Vector3<f64>,
    by_place: Vector3<f64>,
    by_feature: [f64; 3],
}

impl MountModel<'_> {
    /// An observation by this mount.
    fn sight(&self, seen: &Observation) -> Sight {
        let arm_mm = self.mount.rotation * seen.seen_mm;
        let at_mm = self.all.flanges[seen.flange].point(&(arm_mm + self.mount.translation_mm));
        let (value, by_place, by_feature) = match &self.features[seen.feature] {
            SampleSights::Plane {
                normal,
                anchor_mm,
                height_mm,
            } => {
                let from = at_mm - anchor_mm;
                let (e1, e2) = across(normal);
                let by = [e1.dot(&from), e2.dot(&from), -1.0];
                (normal.dot(&from) - height_mm, *normal, by)
            }
            SampleSights::Ball { centre_mm } => {
                let from = at_mm - centre_mm;
                let distance = from.norm();
                let out = if distance > 0.0 {
                    from / distance
                } else {
                    Vector3::z()
                };
                (distance - self.radius_mm, out, (-out).into())
            }
        };
        Sight {
            value,
            at_mm,
            arm_mm,
            by_place,
            by_feature,
        }
    }

    /// The same of other observations.
    fn of<'b>(&self, all: &'b Observations) -> MountModel<'b> {
        MountModel {
            all,
            mount: self.mount,
            features: self.features.clone(),
            radius_mm: self.radius_mm,
            radius_free: self.radius_free,
            centres_known: self.centres_known,
            sought: self.sought,
        }
    }

    /// Unknowns of all features.
    fn of_features(&self) -> usize {
        if self.centres_known {
            0
        } else {
            3 * self.features.len()
        }
    }
}

impl Model for MountModel<'_> {
    fn unknowns(&self) -> (usize, usize) {
        (
            self.of_features() + usize::from(self.radius_free),
            self.sought.iter().filter(|sought| **sought).count(),
        )
    }

    fn residuals(&self) -> usize {
        self.all.points.len()
    }

    fn seen_share(&self) -> f64 {
        // Noise of 20 µm tilts a plane by so much that a free direction gets up to 0.003.
        const OF_PLANES: f64 = 1e-2;
        const OF_BALLS: f64 = 1e-3;
        match self.features.first() {
            Some(SampleSights::Plane { .. }) => OF_PLANES,
            _ => OF_BALLS,
        }
    }

    fn rows(&self, row: &mut TakeRow<'_>) {
        let (nuisances, _) = self.unknowns();
        for seen in &self.all.points {
            let flange = &self.all.flanges[seen.flange];
            let Sight {
                value,
                arm_mm,
                by_place,
                by_feature,
                ..
            } = self.sight(seen);
            row(value, &mut |line| {
                if !self.centres_known {
                    line[3 * seen.feature..3 * seen.feature + 3].copy_from_slice(&by_feature);
                }
                if self.radius_free {
                    line[nuisances - 1] = -1.0;
                }
                let by_shift = flange.rotation.tr_mul(&by_place);
                let by_turn = arm_mm.cross(&by_shift);
                let by = by_turn.iter().chain(&by_shift);
                let sought = by.zip(&self.sought).filter(|(_, sought)| **sought);
                for (place, (by, _)) in sought.enumerate() {
                    line[nuisances + place] = *by;
                }
            });
        }
    }

    fn step(&mut self, step: &[f64]) {
        let (features, others) = step.split_at(self.of_features());
        for (feature, step) in self.features.iter_mut().zip(features.chunks_exact(3)) {
            match feature {
                SampleSights::Plane {
                    normal, height_mm, ..
                } => {
                    let (e1, e2) = across(normal);
                    *normal = (*normal + e1 * step[0] + e2 * step[1]).normalize();
                    *height_mm += step[2];
                }
                SampleSights::Ball { centre_mm } => *centre_mm += Vector3::from_column_slice(step),
            }
        }
        let mount = if self.radius_free {
            self.radius_mm += others[0];
            &others[1..]
        } else {
            others
        };
        step_mount(&mut self.mount, &self.sought, mount);
    }
}

/// Finds the mount, from a first guess that is up to 6° and 20 mm off.
///
/// # Errors
/// `too_few_points`, `unidentifiable` with `free` and `unobservable`, `uncertain`,
/// `missing_centre`, `no_convergence`, `far_from_start`, `bar_length`, `misfit`; `angle_unit` where none of it is a reason once the angles are
/// taken for radians.
pub fn sensor(
    all: &Observations,
    start: &Pose,
    options: &SensorOptions,
) -> Result<SensorAnswer, ScanError> {
    sensor_by(all, start, options, "give --centres")
}

/// The same for another command. `give_centres`: how a ball's centre is made known to it.
pub(super) fn sensor_by(
    all: &Observations,
    start: &Pose,
    options: &SensorOptions,
    give_centres: &str,
) -> Result<SensorAnswer, ScanError> {
    let found = mount(all, start, options, give_centres);
    // Radians taken for degrees leave millimetres, or turns too small to show anything.
    const MUCH_MM: f64 = 0.05;
    let bad = match &found {
        Ok(answer) => answer.sigma_mm.is_some_and(|sigma| sigma > MUCH_MM),
        Err(error) => matches!(
            error.code,
            "uncertain" | "no_convergence" | "unidentifiable" | "misfit"
        ),
    };
    let Some(flanges) = all.flanges_by_radians.as_ref().filter(|_| bad) else {
        return found;
    };
    let by_radians = Observations {
        flanges: flanges.clone(),
        flanges_by_radians: None,
        ..all.clone()
    };
    match mount(&by_radians, start, options, give_centres) {
        Ok(answer) if answer.sigma_mm.is_some_and(|sigma| sigma < 0.2 * MUCH_MM) => {
            Err(ScanError::refused(
                "angle_unit",
                "the angles of the positions look like radians: they are wanted in degrees",
            ))
        }
        _ => found,
    }
}

fn mount(
    all: &Observations,
    start: &Pose,
    options: &SensorOptions,
    give_centres: &str,
) -> Result<SensorAnswer, ScanError> {
    let first = first_model(all, start, options)?;
    let (nuisances, targets) = first.unknowns();
    let unknowns = nuisances + targets;
    let n = all.points.len();
    if n < unknowns || n == 0 {
        return Err(ScanError::refused(
            "too_few_points",
            format_args!("{n} observations for {unknowns} unknowns"),
        ));
    }
    let scale: Vec<f64> = (0..6)
        .filter(|&i| first.sought[i])
        .map(|i| if i < 3 { 1.0 / REACH_MM } else { 1.0 })
        .collect();
    let solution = solve(best_start(first), &scale);
    refuse_unseen(&solution, &scale, give_centres)?;
    refuse_few_profiles(&solution.model)?;
    let solution = rivals::decided(solution, start, &scale)?;
    refuse_unseen(&solution, &scale, give_centres)?;
    let radius = radius_wanted(&solution, options);
    let with_radius = |mut error: ScanError| {
        if let Some(radius) = &radius {
            error.message += &format!("; {radius}");
        }
        error
    };
    refuse_apart(&solution).map_err(with_radius)?;
    let dof = n - unknowns;
    let sigma_mm = (dof > 0).then(|| (solution.ssq / dof as f64).sqrt());
    let covariance_unit = all_six(&solution.covariance_unit, &solution.model.sought);
    let covariance =
        sigma_mm.map(|sigma| covariance_unit.map(|row| row.map(|v| v * sigma * sigma)));
    if let Some(covariance) = &covariance {
        refuse_uncertain(covariance).map_err(with_radius)?;
    }
    if !solution.converged {
        return Err(ScanError::refused(
            "no_convergence",
            "no mount near the first guess fits: [sensor] of the machine file must be right within \
             6° and 20 mm",
        ));
    }
    refuse_far(&solution.model.mount, start)?;
    let model = &solution.model;
    let bars = bars(model, options, sigma_mm)?;
    let mut residuals_mm = Vec::with_capacity(n);
    model.rows(&mut |value, _| residuals_mm.push(value));
    let scatter = scatter_covariance(model);
    let dof_scatter = scatter.as_ref().map(|(_, dof)| *dof);
    let covariance_scatter = scatter.map(|(covariance, _)| all_six(&covariance, &model.sought));
    let answered = covariance_scatter.or(covariance).unwrap_or_default();
    let poses = poses(model, &answered);
    let covariance_poses = poses.covariance.as_ref();
    let covariance_poses = covariance_poses.map(|(of, _)| all_six(of, &model.sought));
    let mut warnings: Vec<String> = radius.into_iter().collect();
    let is_radius_told = !warnings.is_empty();
    warnings.extend(farther_than_asked(&model.mount, start));
    warnings.extend(few_lines(model));
    if let Some(misfit) = poses.misfit.as_ref().filter(|found| found.stands_out()) {
        // A radius that is wrong makes poses disagree, too, and is told by its own name.
        // What too few poses are off by says nothing of what the mount is off by.
        let is_told = covariance_poses.is_some();
        if (misfit.is_gross() || !is_told) && !is_radius_told && !options.allow_misfit {
            let mut error = refused(misfit);
            if !is_told {
                error.message += ". There are too few poses to say how wrong: take more";
            }
            return Err(error);
        }
        warnings.push(format!("misfit: {}", misfit.words()));
    }
    Ok(SensorAnswer {
        rotation: model.mount.rows(),
        translation_mm: model.mount.translation_mm.into(),
        n,
        dof,
        sigma_mm,
        covariance_unit,
        covariance,
        covariance_scatter,
        dof_scatter,
        covariance_poses,
        dof_poses: poses.covariance.map(|(_, dof)| dof),
        misfit: poses.misfit,
        radius_mm: (options.on == Artefact::Sphere).then_some(model.radius_mm),
        features: features(model),
        bars,
        conditioning: solution.seen.last().copied().unwrap_or(1.0),
        residuals_mm,
        warnings,
    })
}

/// Whether the poses agree, and the covariance by them. `answered`: the one that they are held against.
fn poses(model: &MountModel<'_>, answered: &[[f64; 6]; 6]) -> PoseScatter {
    let points = &model.all.points;
    let pose: Vec<usize> = points.iter().map(|seen| seen.flange).collect();
    // A pose that sees two features sees each of them off by something else.
    let mut groups: HashMap<(usize, usize), usize> = HashMap::new();
    let group = points.iter().map(|seen| {
        let next = groups.len();
        *groups.entry((seen.flange, seen.feature)).or_insert(next)
    });
    let group: Vec<usize> = group.collect();
    let names = |pose: usize| {
        let name = model.all.profiles.get(pose);
        format!(
            "profile {}",
            name.map_or_else(|| pose.to_string(), Clone::clone)
        )
    };
    let slips = &model.all.slips;
    let fill = |place: usize, column: &mut [f64]| {
        let seen = &points[place];
        let sight = model.sight(seen);
        for (by, slip) in column.iter_mut().zip(slips) {
            *by = sight
                .by_place
                .dot(&slip.moves[seen.flange].at(&sight.at_mm));
        }
    };
    let grouping = Grouping {
        group: &group,
        pose: &pose,
        names: &names,
    };
    let suspects = Suspects {
        names: slips
            .iter()
            .map(|slip| (slip.what.clone(), slip.unit))
            .collect(),
        turns: 3,
        fill: &fill,
    };
    let u: Vec<f64> = (0..6)
        .filter(|&i| model.sought[i])
        .map(|i| answered[i][i].sqrt())
        .collect();
    misfit::look(model, &grouping, &suspects, &u)
}

fn refused(misfit: &Misfit) -> ScanError {
    let error = ScanError::refused(
        "misfit",
        format_args!(
            "{}. The mount is wrong by far more than its uncertainty says: put that right and scan again; or see the \
             answer all the same with --allow-misfit",
            misfit.words()
        ),
    );
    match serde_json::to_value(misfit) {
        Ok(value) => error.with("misfit", value),
        Err(_) => error,
    }
}

/// The ball bars, each within what is allowed.
fn bars(
    model: &MountModel<'_>,
    options: &SensorOptions,
    sigma_mm: Option<f64>,
) -> Result<Vec<BarAnswer>, ScanError> {
    let (nuisances, targets) = model.unknowns();
    let mut found = Vec::with_capacity(options.bars.len());
    for bar in &options.bars {
        let mut places = [0; 2];
        let mut centres = [Vector3::zeros(); 2];
        for (i, name) in bar.balls.iter().enumerate() {
            let place = model.all.features.iter().position(|known| known == name);
            let seen = place.and_then(|place| model.features.get(place).map(|seen| (place, seen)));
            let Some((place, SampleSights::Ball { centre_mm })) = seen else {
                return Err(ScanError::refused(
                    "missing_centre",
                    format_args!("the ball {name} of a bar is not among the observations"),
                ));
            };
            (places[i], centres[i]) = (place, *centre_mm);
        }
        let (found_mm, along) = bar::length(&centres[0], &centres[1]);
        let gradient = bar::gradient(&along, places, nuisances + targets);
        let answer = BarAnswer {
            balls: bar.balls.clone(),
            certified_mm: bar.length_mm,
            found_mm,
            off_mm: found_mm - bar.length_mm,
            u_mm: sigma_mm.map(|sigma| sigma * unit_uncertainty(model, &gradient)),
        };
        bar::refuse_off(bar, &answer)?;
        found.push(answer);
    }
    Ok(found)
}

fn first_model<'a>(
    all: &'a Observations,
    start: &Pose,
    options: &SensorOptions,
) -> Result<MountModel<'a>, ScanError> {
    let points = points_by_feature(all, start);
    let mut radius_mm = options.radius_mm.unwrap_or(0.0);
    let sphere = options.on == Artefact::Sphere;
    let radius_free = sphere && options.radius_mm.is_none();
    let features: Vec<SampleSights> = match (options.on, &options.centres) {
        (Artefact::Plane, _) => points.iter().map(|points| plane_through(points)).collect(),
        (Artefact::Sphere, Some(centres)) => all
            .features
            .iter()
            .map(|name| {
                let centre_mm = *centres.get(name).ok_or_else(|| {
                    ScanError::refused(
                        "missing_centre",
                        format_args!("the centre of feature {name} is not among the centres"),
                    )
                })?;
                Ok(SampleSights::Ball { centre_mm })
            })
            .collect::<Result<_, ScanError>>()?,
        (Artefact::Sphere, None) => {
            let middles = middles(all, &cuts(all), start);
            let centres = middles.into_iter().zip(&points).map(|(middle, points)| {
                let centre_mm = middle.unwrap_or_else(|| algebraic_centre(points));
                SampleSights::Ball { centre_mm }
            });
            centres.collect()
        }
    };
    if radius_free {
        // A cut through the middle of the ball is the largest there is.
        let mut radii: Vec<f64> = cuts(all).iter().map(|cut| cut.radius_mm).collect();
        radii.sort_by(f64::total_cmp);
        radius_mm = radii.get(radii.len() * 9 / 10).copied().unwrap_or(10.0);
    }
    Ok(MountModel {
        all,
        mount: *start,
        features,
        radius_mm,
        radius_free,
        centres_known: sphere && options.centres.is_some(),
        sought: std::array::from_fn(|i| i < 3 || !options.hold[i - 3]),
    })
}

/// What the residuals say of a stated radius, where they want another one clearly.
fn radius_wanted(solution: &Solution<MountModel<'_>>, options: &SensorOptions) -> Option<String> {
    /// Standard uncertainties by which it must be off.
    const CLEARLY: f64 = 5.0;
    /// What a certificate leaves open.
    const LEAST_MM: f64 = 0.001;
    /// Where the other unknowns leave less of its column, the radius is not determined: balls that are cut alike at all
    /// poses, whose distance from the laser's plane takes its place.
    const LEAST_LEFT: f64 = 1e-4;
    let stated = options
        .radius_mm
        .filter(|_| options.on == Artefact::Sphere)?;
    let mut model = solution.model.clone();
    model.radius_free = true;
    let (nuisances, targets) = model.unknowns();
    let dof = model
        .residuals()
        .checked_sub(nuisances + targets)
        .filter(|dof| *dof > 0)?;
    let (whole, left) = left_of_column(&model, nuisances - 1);
    let ssq = descend(&mut model, 60);
    let sigma_mm = (ssq / dof as f64).sqrt();
    // Noise within the laser's plane changes the distance from a ball by the less the larger that is: so the sum of squares
    // falls by 2 n / R for each mm of radius, whatever the radius is. That must be nothing beside what the data say of it.
    let by_noise = 2.0 * model.residuals() as f64 * sigma_mm / stated;
    if left <= by_noise.max(LEAST_LEFT * whole) {
        return None;
    }
    let off = model.radius_mm - stated;
    let u_mm = sigma_mm / left;
    // What the radius alone gains is (off / u)² sigma².
    let gained = (solution.ssq - ssq) / (ssq / dof as f64).max(1e-18);
    let is_off = off.abs() > LEAST_MM.max(CLEARLY * u_mm);
    (is_off && gained > CLEARLY * CLEARLY).then(|| {
        format!(
            "radius: the residuals want a radius of {:.4} mm, not {stated} mm ({:.0} standard \
             uncertainties off)",
            model.radius_mm,
            gained.sqrt()
        )
    })
}

/// A mount as far as this from where it was said to be is another one: a ball seen in a mirror fits as
/// well, half a turn away.
fn refuse_far(mount: &Pose, start: &Pose) -> Result<(), ScanError> {
    const MOST_TURN_DEG: f64 = 30.0;
    const MOST_SHIFT_MM: f64 = 200.0;
    let turn = rotation_vector(&(mount.rotation * start.rotation.transpose()));
    let turn_deg = turn.norm().to_degrees();
    let shift_mm = (mount.translation_mm - start.translation_mm).norm();
    if turn_deg <= MOST_TURN_DEG && shift_mm <= MOST_SHIFT_MM {
        return Ok(());
    }
    Err(ScanError::refused(
        "far_from_start",
        format_args!(
            "the mount that fits is turned by {turn_deg:.1}° and shifted by {shift_mm:.1} mm from \
             [sensor] of the machine file, which must be right within 6° and 20 mm: look whether x \
             of the profiles runs the other way, or measure the sensor's place again"
        ),
    )
    .with("turn_deg", turn_deg)
    .with("shift_mm", shift_mm))
}

/// The warning, where the first guess was not as near as it is asked for: the search looks no farther than that.
fn farther_than_asked(mount: &Pose, start: &Pose) -> Option<String> {
    if rivals::is_within(mount, start, rivals::CLEARLY_FARTHER) {
        return None;
    }
    let (shift_mm, turn_deg) = distance::apart(mount, start);
    let (most_mm, most_deg) = rivals::GUESS;
    Some(format!(
        "far_from_start: the mount is turned by {turn_deg:.1}° and shifted by {shift_mm:.1} mm from [sensor] of the machine file, \
         which must be right within {most_deg}° and {most_mm} mm. Farther off the search may find another mount that fits less \
         well. Measure the sensor's place again, put it into [sensor] and calibrate once more: the answer must stay the same"
    ))
}

/// Poses that no mount brings together give no mount, however well they would determine it.
fn refuse_apart(solution: &Solution<MountModel<'_>>) -> Result<(), ScanError> {
    let sigma_mm = solution.sigma_mm();
    if sigma_mm <= MOST_NOISE_MM {
        return Ok(());
    }
    Err(ScanError::refused(
        "no_convergence",
        format_args!(
            "no mount near the first guess brings the poses together: the best leaves {sigma_mm:.2} mm. Look whether an axis \
             counts the other way than the machine file says, at the axes' zeros and order, and at [sensor], which must be \
             right within 6° and 20 mm"
        ),
    )
    .with("sigma_mm", sigma_mm))
}

/// A cut through a ball shows three numbers: its middle, and by its radius how far the ball is from the laser's plane, but not
/// on which side. So cuts that show just as many numbers as are sought fit several mounts exactly, and none tells them apart.
fn refuse_few_profiles(model: &MountModel<'_>) -> Result<(), ScanError> {
    if !matches!(model.features.first(), Some(SampleSights::Ball { .. })) {
        return refuse_few_lines(model);
    }
    let mut cuts: Vec<(usize, &Pose)> = Vec::new();
    let (nuisances, targets) = model.unknowns();
    let unknowns = nuisances + targets;
    for seen in &model.all.points {
        let cut = (seen.feature, &model.all.flanges[seen.flange]);
        if !cuts.contains(&cut) {
            cuts.push(cut);
        }
        if 3 * cuts.len() > unknowns {
            return Ok(());
        }
    }
    Err(ScanError::refused(
        "uncertain",
        format_args!(
            "{} poses cut balls: each shows three numbers, for {unknowns} unknowns, and not on which side of the laser's plane \
             the ball is. Several mounts fit exactly: take profiles at {} poses or more",
            cuts.len(),
            unknowns / 3 + 1
        ),
    ))
}

/// A profile of a plane is a line, which shows two numbers. Profiles that show no more numbers than are sought fit several mounts
/// exactly; of those that show a few more other mounts are looked for ([`rivals`]).
fn refuse_few_lines(model: &MountModel<'_>) -> Result<(), ScanError> {
    const LEAST_OVER: i64 = 1;
    let (over, profiles) = numbers_over(model);
    if over >= LEAST_OVER {
        return Ok(());
    }
    let (nuisances, targets) = model.unknowns();
    let unknowns = nuisances + targets;
    let wanted = (unknowns + LEAST_OVER as usize).div_ceil(2);
    Err(ScanError::refused(
        "uncertain",
        format_args!(
            "{profiles} profiles of planes differ. Each is a line and shows two numbers, fewer where no rotary axis moved between \
             them, for {unknowns} unknowns. So few fit several mounts. Take {} profiles or more, each with the rotary axes at \
             other angles",
            wanted.max(profiles + 1)
        ),
    ))
}

/// What few profiles of planes leave unsaid: with errors of the axes they fit as well, at another mount.
fn few_lines(model: &MountModel<'_>) -> Option<String> {
    /// From so many numbers over on, errors of the axes show (of 400 sets with errors of 5 to 20 um none was silent).
    const ENOUGH: i64 = 12;
    if !matches!(model.features.first(), Some(SampleSights::Plane { .. })) {
        return None;
    }
    let (over, profiles) = numbers_over(model);
    let more = (ENOUGH - over + 1) / 2;
    (over < ENOUGH).then(|| {
        format!(
            "few_profiles: {profiles} profiles show {over} numbers more than is sought. Errors of the axes do not show by so few, and \
             no uncertainty here holds them: take {more} profiles more, at other angles"
        )
    })
}

fn refuse_unseen(
    solution: &Solution<MountModel<'_>>,
    scale: &[f64],
    give_centres: &str,
) -> Result<(), ScanError> {
    if solution.unseen.is_empty() {
        return Ok(());
    }
    let unobservable = name_directions(&solution.unseen, &names(&solution.model.sought), scale);
    let free = solution.unseen.len();
    Err(ScanError::refused(
        "unidentifiable",
        format_args!(
            "{}. {}",
            open_in_words(&unobservable, scale.len()),
            to_show(&solution.model, give_centres)
        ),
    )
    .with("free", free)
    .with("unobservable", unobservable)
    .with("singular_values", solution.seen.clone()))
}

/// The names of what is sought.
fn names(sought: &[bool; 6]) -> Vec<&'static str> {
    let names = NAMES.iter().zip(sought).filter(|(_, sought)| **sought);
    names.map(|(name, _)| *name).collect()
}

/// What would show what is open.
fn to_show(model: &MountModel<'_>, give_centres: &str) -> String {
    let is_ball = matches!(model.features.first(), Some(SampleSights::Ball { .. }));
    let of = if is_ball {
        "a ball"
    } else {
        "an inclined plane"
    };
    let turned = |flange: &Pose| (flange.rotation - model.all.flanges[0].rotation).amax() > 1e-6;
    // On three axes there is nothing to turn.
    let take = if model.all.flanges.iter().any(turned) {
        format!("Take profiles of {of} at more poses, with all rotary axes moved")
    } else {
        format!(
            "No rotary axis moved. On a machine with one take profiles of {of} at several of its angles"
        )
    };
    let centres = if is_ball && !model.centres_known {
        format!("; or {give_centres}")
    } else {
        String::new()
    };
    format!("{take}{centres}; or hold a shift with --hold")
}

fn refuse_uncertain(covariance: &[[f64; 6]; 6]) -> Result<(), ScanError> {
    let Some(worst) = uncertain(covariance) else {
        return Ok(());
    };
    Err(ScanError::refused(
        "uncertain",
        format_args!("{worst}: use more poses that differ more, or look for outliers"),
    )
    .with("component", worst.component)
    .with("standard_uncertainty", worst.uncertainty))
}

/// A component of a mount that is too uncertain.
pub(super) struct UncertainComponent {
    pub component: &'static str,
    /// In mm or rad.
    pub uncertainty: f64,
    most: f64,
    unit: &'static str,
}

impl std::fmt::Display for UncertainComponent {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            component,
            uncertainty,
            most,
            unit,
        } = self;
        write!(
            f,
            "the standard uncertainty of {component} would be {uncertainty:.3e} {unit} (at most {most} {unit})"
        )
    }
}

/// The first component that nobody could use.
pub(super) fn uncertain(covariance: &[[f64; 6]; 6]) -> Option<UncertainComponent> {
    (0..6).find_map(|i| {
        let (most, unit) = if i < 3 {
            (MOST_UNCERTAIN[0], "rad")
        } else {
            (MOST_UNCERTAIN[1], "mm")
        };
        let uncertainty = covariance[i][i].sqrt();
        // A covariance that is no number is no certainty either.
        (uncertainty.is_nan() || uncertainty > most).then_some(UncertainComponent {
            component: NAMES[i],
            uncertainty,
            most,
            unit,
        })
    })
}

/// The motion of which the least is known, in words: where a covariance is widest, turns worth 100 mm a radian.
pub(super) fn widest_in_words(covariance: &[[f64; 6]; 6]) -> String {
    let scale = |i: usize| if i < 3 { 1.0 / REACH_MM } else { 1.0 };
    let scaled = DMatrix::from_fn(6, 6, |i, k| covariance[i][k] / scale(i) / scale(k));
    let eigen = scaled.symmetric_eigen();
    let widest = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let direction = DVector::from_fn(6, |i, _| widest[i] * scale(i));
    name_directions(&[direction], &NAMES, &[0, 1, 2, 3, 4, 5].map(scale)).join(", ")
}

/// Six by six, zero where held.
fn all_six(sought_only: &DMatrix<f64>, sought: &[bool; 6]) -> [[f64; 6]; 6] {
    let places: Vec<usize> = (0..6).filter(|&i| sought[i]).collect();
    let mut all = [[0.0; 6]; 6];
    for (a, &i) in places.iter().enumerate() {
        for (b, &k) in places.iter().enumerate() {
            all[i][k] = 0.5 * (sought_only[(a, b)] + sought_only[(b, a)]);
        }
    }
    all
}

fn features(model: &MountModel<'_>) -> Vec<FeatureAnswer> {
    let mut sums = vec![(0_usize, 0.0_f64, 0.0_f64); model.features.len()];
    let mut points = model.all.points.iter();
    model.rows(&mut |value, _| {
        if let Some(point) = points.next() {
            let sum = &mut sums[point.feature];
            sum.0 += 1;
            sum.1 += value * value;
            if value.abs() > sum.2.abs() {
                sum.2 = value;
            }
        }
    });
    let seen = model.features.iter().zip(&model.all.features).zip(sums);
    seen.map(|((seen, name), (n, squares, max_mm))| {
        let (normal, distance_mm, center_mm) = match seen {
            SampleSights::Plane {
                normal,
                anchor_mm,
                height_mm,
            } => (
                Some((*normal).into()),
                Some(normal.dot(anchor_mm) + height_mm),
                None,
            ),
            SampleSights::Ball { centre_mm } => (None, None, Some((*centre_mm).into())),
        };
        FeatureAnswer {
            feature: name.clone(),
            n,
            normal,
            distance_mm,
            center_mm,
            rms_mm: (squares / n.max(1) as f64).sqrt(),
            max_mm,
        }
    })
    .collect()
}
