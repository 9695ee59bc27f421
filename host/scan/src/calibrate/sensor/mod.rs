//! The mount of the sensor, from planes or balls that it saw.
//!
//! Minimised is the sum of squares of `n·p - d` (plane) or `|p - c| - R` (ball) over all
//! observations, `p = flange · X · (x, 0, z)` in the workpiece's frame. Unknown are X, and
//! each plane, each centre that is not known, and one radius if it is free.

mod along;
mod distance;
mod lines;
mod mirror;
mod model;
mod outlier;
mod refusals;
mod rivals;
mod sides;
mod starts;

use std::collections::HashMap;

use nalgebra::{DMatrix, Matrix3, Vector3};
use serde::Serialize;
use umi_kinematics::Pose;

use super::bar::{self, BallBar, BarAnswer};
use super::features::{
    SampleSights, algebraic_centre, cuts, middles, plane_through, points_by_feature,
};
use super::misfit::{self, Grouping, Misfit, PoseScatter, Suspects};
use super::observations::Observations;
use super::solve::scatter::{scatter_covariance, unit_uncertainty};
use super::solve::{Model, solve};
use crate::ScanError;
use model::MountModel;
pub use outlier::SampleOutlier;
use refusals::{
    REACH_MM, farther_than_asked, few_lines, radius_wanted, refuse_apart, refuse_far,
    refuse_few_profiles, refuse_uncertain, refuse_unseen, refused,
};
pub(super) use refusals::{uncertain, widest_in_words};
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
    /// Leave out samples that lie off all others.
    pub drop_outliers: bool,
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
    /// The samples that lie off all others, the worst first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub outliers: Vec<SampleOutlier>,
    /// Those that were left out for that.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub dropped: Vec<SampleOutlier>,
    /// Of the balls.
    pub radius_mm: Option<f64>,
    /// What was seen, in the workpiece's frame.
    pub features: Vec<FeatureAnswer>,
    /// Ball bars beside their certificates.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bars: Vec<BarAnswer>,
    /// The least singular value over the largest, rotations worth 100 mm.
    pub conditioning: f64,
    /// The residual of each observation in mm, in their order; no number for one that was left out.
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

    /// Refuses a mount that is too uncertain to go into a machine file, by the covariance that goes with it, or one of
    /// samples of which one lies off all others.
    ///
    /// # Errors
    /// `outlier`, and which; `uncertain`.
    pub fn refuse_doubtful(&self) -> Result<(), ScanError> {
        if let Some(words) = outlier::words(&self.outliers) {
            return Err(ScanError::refused("outlier", words));
        }
        self.best_covariance().map_or(Ok(()), refuse_uncertain)
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
    let mut solution = rivals::decided(solution, start, &scale)?;
    refuse_unseen(&solution, &scale, give_centres)?;
    solution.model.face_the_sensor();
    let radius = radius_wanted(&solution, options);
    let outliers = outlier::outliers(&solution.model);
    if options.drop_outliers && !outliers.is_empty() {
        return without(all, outliers, start, options, give_centres);
    }
    let stray = outlier::words(&outliers);
    let with_hints = |mut error: ScanError| {
        for hint in [&radius, &stray].into_iter().flatten() {
            error.message += &format!("; {hint}");
        }
        error
    };
    refuse_apart(&solution).map_err(with_hints)?;
    let dof = n - unknowns;
    let sigma_mm = (dof > 0).then(|| (solution.ssq / dof as f64).sqrt());
    let covariance_unit = all_six(&solution.covariance_unit, &solution.model.sought);
    let covariance =
        sigma_mm.map(|sigma| covariance_unit.map(|row| row.map(|v| v * sigma * sigma)));
    if let Some(covariance) = &covariance {
        refuse_uncertain(covariance).map_err(with_hints)?;
    }
    if !solution.converged {
        return Err(with_hints(ScanError::refused(
            "no_convergence",
            "no mount near the first guess fits: [sensor] of the machine file must be right within \
             6° and 20 mm",
        )));
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
            if let Some(stray) = &stray {
                error.message += &format!("; {stray}");
            }
            return Err(error);
        }
        warnings.push(format!("misfit: {}", misfit.words()));
    }
    warnings.extend(stray);
    warnings.extend(along::along_line(model));
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
        outliers,
        dropped: Vec::new(),
        radius_mm: (options.on == Artefact::Sphere).then_some(model.radius_mm),
        features: features(model),
        bars,
        conditioning: solution.seen.last().copied().unwrap_or(1.0),
        residuals_mm,
        warnings,
    })
}

/// The mount without these samples.
fn without(
    all: &Observations,
    outliers: Vec<SampleOutlier>,
    start: &Pose,
    options: &SensorOptions,
    give_centres: &str,
) -> Result<SensorAnswer, ScanError> {
    if outliers.len() >= outlier::MOST_NAMED {
        return Err(ScanError::refused(
            "outlier",
            format_args!(
                "{} samples and maybe more lie off all others: that is no stray, look at what was taken for the artefact",
                outliers.len()
            ),
        ));
    }
    let mut rows: Vec<usize> = outliers.iter().map(|outlier| outlier.row - 1).collect();
    rows.sort_unstable();
    let mut kept = all.clone();
    for row in rows.iter().rev() {
        kept.points.remove(*row);
    }
    let options = SensorOptions {
        drop_outliers: false,
        ..options.clone()
    };
    let mut answer = mount(&kept, start, &options, give_centres)?;
    for row in rows {
        answer.residuals_mm.insert(row, f64::NAN);
    }
    answer.warnings.extend(outlier::dropped(&outliers));
    answer.dropped = outliers;
    Ok(answer)
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
    let names = |pose: usize| model.all.profile_name(pose);
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
