//! Where a part is in a scan, without a first guess, or why the scan does not say.

mod alone;
pub mod fiducials;
mod field;
mod fit;
mod oriented;
mod pairs;
mod rivals;
pub mod scans;
mod scene;
mod symmetry;
#[cfg(test)]
mod tests;
mod uncertainty;
mod verdict;

use serde_json::{Value, json};

use crate::ScanError;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};
use crate::solve::{Kernel, Measured, measure};
use crate::surface::{CompositeSurface, Mesh};

pub use symmetry::SymmetryAxis;
pub use uncertainty::Certainty;
use uncertainty::Groups;

/// What is asked.
#[derive(Clone, Debug)]
pub struct LocaliseTask<'a> {
    /// The part.
    pub model: &'a Mesh,
    /// The scan in mm.
    pub points: &'a [Vec3],
    /// Where the part is about (scan from part): nothing is searched then.
    pub start: Option<Pose>,
    /// A stated problem over all points; without it noise and outliers are estimated.
    pub kernel: Option<Kernel>,
    /// Whether one of several poses that look alike will do.
    pub accept_symmetry: bool,
    /// The largest standard uncertainty at a corner of the part, in mm.
    pub limit_mm: Option<f64>,
    /// By how much the scale may be off, in ppm.
    pub scale_limit_ppm: f64,
    /// Another seed begins the search with other points.
    pub seed: u64,
    /// Threads.
    pub threads: Threads,
    /// The scans that the points are of, if they are sure as a whole only.
    groups: Groups<'a>,
}

/// The part's pose in the scan.
#[derive(Clone, Debug)]
pub struct Located {
    /// Scan from part.
    pub motion: Pose,
    /// Points on the part.
    pub n_used: usize,
    /// The share of the part's surface that the scan shows.
    pub overlap: f64,
    /// Root of the mean squared distance in mm: of the points on the part, of all points with `Kernel::None`.
    pub rms_mm: f64,
    /// The noise along the normals in mm.
    pub sigma_mm: f64,
    /// Covariance and scale.
    pub certainty: Certainty,
    /// Other poses that look alike, where they were accepted.
    pub symmetries: Vec<SymmetryAxis>,
    /// The points that count, by number, with their signed distances in mm.
    pub on: Vec<(usize, f64)>,
    /// Why the verdict is NG; OK if there is nothing.
    pub reasons: Vec<ScanError>,
}

/// Points that a search needs.
const LEAST_POINTS: usize = 30;

impl LocaliseTask<'_> {
    /// The pose with its uncertainty and verdict.
    ///
    /// # Errors
    /// Refused by name where the data do not decide: `ambiguous`, `degenerate`, `too_little_overlap`, `no_fit`,
    /// `mirrored`, `wrong_scale`, `too_few_points`.
    pub fn find(&self) -> Result<Located, ScanError> {
        let least = if self.start.is_some() {
            6
        } else {
            LEAST_POINTS
        };
        if self.points.len() < least {
            return Err(ScanError::refused(
                "too_few_points",
                format_args!(
                    "{} points are too few: at least {least} are needed, spread over the part",
                    self.points.len()
                ),
            ));
        }
        let surface = CompositeSurface::from(self.model.clone());
        let (motion, sigma_mm, symmetries) = match (&self.start, self.kernel) {
            (Some(start), Some(_)) => (*start, None, Vec::new()),
            (Some(start), None) => {
                let fit = self.near_start(&surface, start)?;
                (fit.motion, Some(fit.sigma_mm), Vec::new())
            }
            (None, _) => {
                let found = verdict::decide(self, &surface)?;
                (found.fit.motion, Some(found.fit.sigma_mm), found.symmetries)
            }
        };
        self.finish(&surface, &motion, sigma_mm, symmetries)
    }

    /// From a pose that is about right.
    fn near_start(&self, surface: &CompositeSurface, start: &Pose) -> Result<fit::Fit, ScanError> {
        let diagonal = self.model.diagonal_mm();
        let floor = diagonal * 1e-7;
        fit::settle(surface, self.points, start, diagonal * 0.05, floor, 40, self.threads)
            .filter(|fit| fit.sigma_mm < diagonal * 0.01 && fit.inliers >= 20)
            .ok_or_else(|| {
                ScanError::refused(
                    "no_fit",
                    "the part does not fit the scan near the start: is the start right? Without --start it is searched",
                )
            })
    }

    fn finish(
        &self,
        surface: &CompositeSurface,
        motion: &Pose,
        sigma_mm: Option<f64>,
        symmetries: Vec<SymmetryAxis>,
    ) -> Result<Located, ScanError> {
        let mut motion = *motion;
        let mut measured;
        // How many times the points are that the pose was fitted to.
        let mut more = 1.0;
        if let Some(kernel) = self.kernel {
            let settled = fit::task(surface, self.points, kernel, 300, self.threads).solve(&motion);
            motion = settled.motion;
            measured = settled.measured;
        } else {
            measured = measure(surface, self.points, &motion, &[], self.threads);
        }
        let (sigma, on_part): (f64, Vec<usize>) = match self.kernel {
            Some(Kernel::None) => {
                let sum: f64 = measured.iter().map(|m| m.distance_mm.powi(2)).sum();
                let dof = (measured.len() as f64 - 6.0).max(1.0);
                ((sum / dof).sqrt(), (0..measured.len()).collect())
            }
            Some(Kernel::Huber(c) | Kernel::Tukey(c)) => {
                let sigma = fit::noise(&measured, 10.0 * c);
                (sigma, near(&measured, fit::INLIER * sigma))
            }
            None => {
                let sigma = sigma_mm
                    .unwrap_or_else(|| fit::noise(&measured, self.model.diagonal_mm() * 0.01));
                // All points now: the search and its refinement have used some thousands.
                let places = near(&measured, 10.0 * sigma);
                let used = pairs::spread(places.len(), MANY);
                more = places.len() as f64 / used.len().max(1) as f64;
                let places: Vec<usize> = used.into_iter().map(|k| places[k]).collect();
                let kernel = Kernel::Tukey(fit::TUKEY * sigma);
                let kept: Vec<Vec3> = places.iter().map(|&i| self.points[i]).collect();
                motion = fit::task(surface, &kept, kernel, 40, self.threads)
                    .solve(&motion)
                    .motion;
                if self.groups.all.len() > 1 {
                    let of: Vec<usize> = places.iter().map(|&i| self.groups.of(i)).collect();
                    let groups = Groups {
                        of: &of,
                        ..self.groups
                    };
                    motion = fit::weighed(surface, &kept, groups, &motion, sigma, self.threads);
                }
                measured = measure(surface, self.points, &motion, &[], self.threads);
                (sigma, near(&measured, fit::INLIER * sigma))
            }
        };
        let certainty = uncertainty::certainty(
            self.points,
            &measured,
            &on_part,
            &motion,
            sigma,
            self.groups,
        )
        .widened(self.spread(&measured, &on_part, sigma))
        .widened(more);
        if !certainty.free.is_empty() {
            return Err(degenerate(&certainty, "part"));
        }
        let squares: f64 = on_part
            .iter()
            .map(|&i| measured[i].distance_mm.powi(2))
            .sum();
        let shown: Vec<Vec3> = on_part
            .iter()
            .map(|&i| motion.undo(&self.points[i]))
            .collect();
        let mut located = Located {
            motion,
            n_used: on_part.len(),
            overlap: scene::coverage(self.model, &shown),
            rms_mm: (squares / on_part.len().max(1) as f64).sqrt(),
            sigma_mm: sigma,
            certainty,
            symmetries,
            on: on_part
                .iter()
                .map(|&i| (i, measured[i].distance_mm))
                .collect(),
            reasons: Vec::new(),
        };
        located.reasons = verdict_reasons(
            &located,
            &self.model.corners(),
            self.limit_mm,
            self.scale_limit_ppm,
            "part",
        );
        Ok(located)
    }
}

impl LocaliseTask<'_> {
    /// By how much more several scans differ than their own doubts and the noise say: χ² over its degrees of freedom.
    fn spread(&self, measured: &[Measured], on_part: &[usize], sigma: f64) -> f64 {
        let count = self.groups.all.len();
        if count < 2 {
            return 1.0;
        }
        let places: Vec<Vec3> = on_part.iter().map(|&i| self.points[i]).collect();
        let about = fit::middle(&places);
        let arm = places
            .iter()
            .map(|q| (q - about).norm())
            .fold(1e-3, f64::max);
        let mut h = vec![nalgebra::Matrix6::zeros(); count];
        let mut g = vec![nalgebra::Vector6::zeros(); count];
        for &i in on_part {
            let r = fit::row(&self.points[i], &measured[i], &about, arm);
            h[self.groups.of(i)] += r * r.transpose();
            g[self.groups.of(i)] -= r * measured[i].distance_mm;
        }
        let sigma2 = sigma * sigma;
        let damping = self.groups.damping(&h, &about, arm, sigma2);
        let (mut misfit, mut freedom) = (0.0, 0);
        for k in 0..count {
            let (values, _) = crate::solve::eigen(&h[k]);
            freedom += values.iter().filter(|v| **v > FREE * values[5]).count();
            let own = crate::solve::pseudo_solve(&h[k], &g[k], FREE);
            misfit += own.dot(&(damping[k] * h[k] * own)) / sigma2;
        }
        misfit / (freedom.saturating_sub(6).max(1)) as f64
    }
}

/// A motion of one scan's part is held if its points hold it by this share of the best one, in squares.
const FREE: f64 = 1e-3;

/// What makes a pose NG: too uncertain at these places, or a scale that is off. `what` has these corners.
fn verdict_reasons(
    located: &Located,
    corners: &[Vec3],
    limit_mm: Option<f64>,
    scale_limit_ppm: f64,
    what: &str,
) -> Vec<ScanError> {
    let mut reasons = Vec::new();
    let worst = corners
        .iter()
        .map(|p| {
            located
                .certainty
                .at(&located.motion, p)
                .trace()
                .max(0.0)
                .sqrt()
        })
        .fold(0.0, f64::max);
    if let Some(limit) = limit_mm.filter(|limit| worst > *limit) {
        reasons.push(ScanError::refused(
            "uncertain",
            format_args!("at a corner of the {what} the pose is uncertain by {worst:.4} mm (one standard uncertainty); the limit is {limit} mm"),
        ));
    }
    let c = &located.certainty;
    let off_ppm = (c.scale - 1.0) * 1e6;
    if off_ppm.abs() > scale_limit_ppm && (c.scale - 1.0).abs() > 4.0 * c.u_scale {
        reasons.push(ScanError::refused(
            "scale",
            format_args!(
                "the scan is {:.6} times as large as it should be ({off_ppm:+.0} ppm, limit {scale_limit_ppm} ppm): shrinkage, temperature, or the scanner's calibration",
                c.scale
            ),
        ));
    }
    reasons
}

/// Of more points on the part than these, so many are fitted to, spread evenly; the covariance is theirs.
const MANY: usize = 300_000;

/// The points within `limit` mm.
fn near(measured: &[Measured], limit: f64) -> Vec<usize> {
    (0..measured.len())
        .filter(|&i| measured[i].distance_mm.abs() < limit)
        .collect()
}

/// The refusal for motions that no point holds.
fn degenerate(certainty: &Certainty, what: &str) -> ScanError {
    let free: Vec<Value> = certainty
        .free
        .iter()
        .map(|v| json!({"turn": [v[0], v[1], v[2]], "shift": [v[3], v[4], v[5]], "about_mm": certainty.about_mm.as_slice()}))
        .collect();
    ScanError::refused(
        "degenerate",
        format_args!(
            "what the scan shows of the {what} does not hold the pose: {} of its 6 motions {} free; scan more",
            free.len(),
            if free.len() == 1 { "is" } else { "are" }
        ),
    )
    .with("free", free)
}
