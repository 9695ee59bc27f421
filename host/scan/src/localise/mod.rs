//! Where a part is in a scan, without a first guess, or why the scan does not say.

pub mod fiducials;
mod fit;
pub mod scans;
mod search;
mod size;
#[cfg(test)]
mod tests;
mod uncertainty;
mod verdict;

use serde_json::{Value, json};

use crate::ScanError;
use crate::cloud::curve;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};
use crate::solve::{self, Kernel, Measured};
use crate::surface::{CompositeSurface, Mesh};

use search::{pairs, scene};
pub use uncertainty::Certainty;
use uncertainty::Groups;
pub use verdict::symmetry::SymmetryAxis;

/// What is asked.
#[derive(Clone, Debug)]
pub struct LocaliseTask<'a> {
    /// The part.
    pub model: &'a Mesh,
    /// The scan in mm.
    pub points: &'a [Vec3],
    /// Where the part is about (scan from part). A pose that explains the scan better elsewhere refuses it.
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
    /// What others set by hand.
    pub chosen: Chosen,
    /// Why the verdict is NG; OK if there is nothing.
    pub reasons: Vec<ScanError>,
}

/// What other programs have as parameters, and model and scan said here. None of it where it was not needed: a stated
/// problem has its own kernel, and fiducials are found by their shapes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Chosen {
    /// Edge of the cubes of which one point each was searched with, in mm: by the part's area, wider in a large scan.
    pub search_mm: Option<f64>,
    /// From how far around a point its normal was taken, in mm.
    pub normals_mm: Option<f64>,
    /// Points farther than this from the part did not count in the end, in mm: by the noise.
    pub reach_mm: Option<f64>,
    /// The fit ended at a step below this, in mm.
    pub enough_mm: Option<f64>,
}

/// By how much the noise of all points may be more than that of the search's.
const WORSE: f64 = 1.1;
/// Points that a search needs.
const LEAST_POINTS: usize = 30;
/// Points that scatter about the part by more than this, over its diagonal, are not of it.
const ROUGH: f64 = 0.01;

/// The refusal of a start that leads nowhere.
fn not_near() -> ScanError {
    ScanError::refused(
        "no_fit",
        "the part does not fit the scan near the start: is the start right? Without --start it is searched",
    )
}

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
        let mut found = match (&self.start, self.kernel) {
            (Some(start), Some(kernel)) => return self.stated(&surface, start, kernel),
            (Some(start), None) => {
                let begun = self.near_start(&surface, start)?;
                verdict::decide(self, &surface, Some(begun))?
            }
            (None, _) => verdict::decide(self, &surface, None)?,
        };
        let cell_mm = found.cell_mm;
        let mut located = match self.kernel {
            Some(kernel) => Located {
                symmetries: found.symmetries.clone(),
                ..self.stated(&surface, &found.fit.motion, kernel)?
            },
            None => self.finish(&surface, &mut found)?,
        };
        if let Some(refusal) = found.refusal(&located) {
            return Err(refusal);
        }
        if self.kernel.is_some() {
            return Ok(located);
        }
        if !found.doubts.is_empty() {
            located.certainty = located.certainty.or_moved(&found.doubts);
            located.reasons = verdict_reasons(
                &located,
                &self.model.corners(),
                self.limit_mm,
                self.scale_limit_ppm,
                "part",
            );
        }
        located.chosen.search_mm = Some(cell_mm);
        located.chosen.normals_mm = Some(scene::NORMALS * cell_mm);
        Ok(located)
    }

    /// From a pose that is about right.
    fn near_start(&self, surface: &CompositeSurface, start: &Pose) -> Result<fit::Fit, ScanError> {
        let diagonal = self.model.diagonal_mm();
        let floor = diagonal * 1e-7;
        fit::settle(
            surface,
            self.points,
            start,
            diagonal * 0.05,
            floor,
            40,
            self.threads,
        )
        .filter(|fit| fit.sigma_mm < diagonal * ROUGH && fit.inliers >= 20)
        .ok_or_else(not_near)
    }

    /// The end with a stated kernel, which is about all points.
    fn stated(
        &self,
        surface: &CompositeSurface,
        start: &Pose,
        kernel: Kernel,
    ) -> Result<Located, ScanError> {
        let settled = fit::task(surface, self.points, kernel, 300, self.threads).solve(start);
        let measured = settled.measured;
        let (sigma, on_part): (f64, Vec<usize>) = match kernel {
            Kernel::None => {
                let sum: f64 = measured.iter().map(|m| m.distance_mm.powi(2)).sum();
                let dof = (measured.len() as f64 - 6.0).max(1.0);
                ((sum / dof).sqrt(), (0..measured.len()).collect())
            }
            Kernel::Huber(c) | Kernel::Tukey(c) => {
                let sigma = fit::noise(&measured, 10.0 * c);
                (sigma, near(&measured, fit::INLIER * sigma))
            }
        };
        let certainty = uncertainty::certainty(
            self.points,
            &measured,
            &on_part,
            &settled.motion,
            sigma,
            self.groups,
        )
        .widened(spread(self.points, &measured, &on_part, sigma, self.groups));
        // Without a kernel no point is left out, so none is astray by the size.
        let certainty = if kernel == Kernel::None {
            certainty
        } else {
            self.sized(surface, &settled.motion, sigma, certainty).0
        };
        let on = on_part.iter().map(|&i| (i, measured[i].distance_mm));
        let mut located =
            self.judged(&settled.motion, sigma, certainty, on.collect(), Vec::new())?;
        let share = located.n_used as f64 / measured.len() as f64;
        // Stray points are in the sum of squares, but no sign of a wrong place.
        let scatter = match kernel {
            Kernel::None => fit::noise(&measured, f64::INFINITY),
            _ => sigma,
        };
        if scatter > self.model.diagonal_mm() * ROUGH || share < verdict::SHARE {
            located.reasons.push(ScanError::refused(
                "no_fit",
                format_args!(
                    "the part does not lie on the scan: {:.0} % of the points are on it, and these scatter by {scatter:.3} mm; \
                     begin nearer, or leave --start and --kernel out",
                    100.0 * share
                ),
            ));
        }
        Ok(located)
    }

    /// The end of a search or of a refinement. A pose that lies on few of the points of the part, and the rest of them for
    /// strays, is seen by the size: another pose of the right size explains more. The end is begun anew from there then, and
    /// that pose is judged as what the search finds is, and takes the place of what was `found`. Where it is refused, so is
    /// the scan: the first one lies on fewer.
    fn finish(
        &self,
        surface: &CompositeSurface,
        found: &mut verdict::Decided,
    ) -> Result<Located, ScanError> {
        let (motion, sigma) = (found.fit.motion, found.fit.sigma_mm);
        let (first, better) =
            self.finish_from(surface, &motion, sigma, found.symmetries.clone())?;
        let Some(better) = better else {
            return Ok(first);
        };
        let mut again = match self.finish_from(surface, &better, sigma, Vec::new()) {
            Ok((again, _)) if again.n_used > first.n_used && again.sigma_mm <= WORSE * sigma => {
                again
            }
            _ => return Ok(first),
        };
        let corners = self.model.corners();
        let moved_mm = again.motion.apart_mm(&first.motion, &corners);
        if moved_mm < sigma {
            // The same place: what judged the one has judged the other.
            again.symmetries = first.symmetries;
            return Ok(again);
        }
        let mut others = std::mem::take(&mut found.all);
        others.push(first.motion);
        let fit = fit::Fit {
            motion: again.motion,
            sigma_mm: again.sigma_mm,
            inliers: again.n_used,
            worth: 0,
        };
        *found = verdict::again::judged(self, surface, &fit, &others)?;
        again.symmetries.clone_from(&found.symmetries);
        let (more, chance) =
            verdict::rivals::advantage(&self.marked(&again.on), &self.marked(&first.on));
        if more <= chance {
            // So few more are no choice between the two: either may be the place.
            again.certainty = again.certainty.off_by(moved_mm);
            again.reasons = verdict_reasons(
                &again,
                &corners,
                self.limit_mm,
                self.scale_limit_ppm,
                "part",
            );
        }
        Ok(again)
    }

    /// Which of all points these are.
    fn marked(&self, on: &[(usize, f64)]) -> Vec<bool> {
        let mut marked = vec![false; self.points.len()];
        for (i, _) in on {
            marked[*i] = true;
        }
        marked
    }

    /// The search, or a refinement, has used some thousands of points: now the fit is to all on the part, or to [`MANY`] of
    /// them, and the covariance is that of the points fitted to. With the pose that explains more by its size, if there is
    /// one.
    fn finish_from(
        &self,
        surface: &CompositeSurface,
        motion: &Pose,
        sigma: f64,
        symmetries: Vec<SymmetryAxis>,
    ) -> Result<(Located, Option<Pose>), ScanError> {
        // What is farther than this cannot come onto the part any more.
        let reach = 10.0 * sigma;
        let about = self.within(surface, motion, 2.0 * reach);
        let points: Vec<Vec3> = about.iter().map(|&i| self.points[i]).collect();
        let measured = solve::measure_within(surface, &points, motion, &[], reach, self.threads);
        let places = near(&measured, reach);
        let fitted = pairs::spread(places.len(), MANY).into_iter();
        let fitted = curve::in_order(&points, fitted.map(|k| places[k]).collect());
        let kept: Vec<Vec3> = fitted.iter().map(|&k| points[k]).collect();
        let before = fitted.iter().map(|&k| measured[k]).collect();
        let of: Vec<usize> = fitted.iter().map(|&k| self.groups.of(about[k])).collect();
        let groups = Groups {
            of: &of,
            ..self.groups
        };
        let limit = fit::TUKEY * sigma;
        let settled = fit::robust(surface, &kept, limit, 40, self.threads).solve_on(motion, before);
        let (mut motion, mut there) = (settled.motion, settled.measured);
        if groups.all.len() > 1 {
            motion = fit::weighed(surface, &kept, groups, &motion, sigma, self.threads);
            there = solve::measure_within(surface, &kept, &motion, &[], limit, self.threads);
        }
        // The noise of all of them, where so far it was that of some; not so much more that it asks for what was not measured.
        let floor = self.model.diagonal_mm() * 1e-7;
        let sigma = fit::noise(&there, limit).max(floor).min(sigma * WORSE);
        let on_part = near(&there, fit::INLIER * sigma);
        let threads = self.threads;
        let held = uncertainty::on_faces(surface, &kept, &there, &on_part, &motion, sigma, threads);
        let certainty = uncertainty::certainty(&kept, &there, &held, &motion, sigma, groups)
            .widened(spread(&kept, &there, &held, sigma, groups));
        let (certainty, better) = self.sized(surface, &motion, sigma, certainty);
        let on: Vec<(usize, f64)> = if kept.len() == places.len() {
            let on_part = on_part.iter();
            let at = |k: usize| (about[fitted[k]], there[k].distance_mm);
            on_part.map(|&k| at(k)).collect()
        } else {
            let limit = fit::INLIER * sigma;
            let measured =
                solve::measure_within(surface, &points, &motion, &[], limit, self.threads);
            let on = near(&measured, limit).into_iter();
            on.map(|k| (about[k], measured[k].distance_mm)).collect()
        };
        let mut located = self.judged(&motion, sigma, certainty, on, symmetries)?;
        located.chosen.reach_mm = Some(limit);
        located.chosen.enough_mm = Some(fit::ENOUGH * limit);
        Ok((located, better))
    }

    /// The points in the part's box, widened by `limit` mm.
    fn within(&self, surface: &CompositeSurface, motion: &Pose, limit: f64) -> Vec<usize> {
        let inside = fit::boxed(surface, motion, limit);
        self.threads
            .chunks(self.points.len(), 1 << 16, |range| {
                range
                    .filter(|&i| inside(&self.points[i]))
                    .collect::<Vec<usize>>()
            })
            .concat()
    }

    /// What was found, with its verdict. `on`: the points on the part with their distances.
    fn judged(
        &self,
        motion: &Pose,
        sigma_mm: f64,
        certainty: Certainty,
        on: Vec<(usize, f64)>,
        symmetries: Vec<SymmetryAxis>,
    ) -> Result<Located, ScanError> {
        if !certainty.free.is_empty() {
            return Err(degenerate(&certainty.free, &certainty.about_mm, "part"));
        }
        let squares: f64 = on.iter().map(|(_, distance)| distance.powi(2)).sum();
        let shown: Vec<Vec3> = pairs::spread(on.len(), MANY)
            .into_iter()
            .map(|k| motion.undo(&self.points[on[k].0]))
            .collect();
        let mut located = Located {
            motion: *motion,
            n_used: on.len(),
            overlap: scene::coverage(self.model, &shown),
            rms_mm: (squares / on.len().max(1) as f64).sqrt(),
            sigma_mm,
            certainty,
            symmetries,
            on,
            chosen: Chosen::default(),
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

/// By how much more several scans differ than their own doubts and the noise say: χ² over its degrees of freedom.
fn spread(
    points: &[Vec3],
    measured: &[Measured],
    on_part: &[usize],
    sigma: f64,
    groups: Groups<'_>,
) -> f64 {
    if groups.all.len() < 2 {
        return 1.0;
    }
    let each = misfits(points, measured, on_part, sigma, groups);
    let misfit: f64 = each.iter().map(|(misfit, _)| misfit).sum();
    let freedom: usize = each.iter().map(|(_, held)| held).sum();
    misfit / (freedom.saturating_sub(6).max(1)) as f64
}

/// How far each group's own points put the part from where it is measured: χ² by its doubts and the noise, and the motions
/// that they hold.
fn misfits(
    points: &[Vec3],
    measured: &[Measured],
    on_part: &[usize],
    sigma: f64,
    groups: Groups<'_>,
) -> Vec<(f64, usize)> {
    let count = groups.all.len();
    let places: Vec<Vec3> = on_part.iter().map(|&i| points[i]).collect();
    let about = fit::middle(&places);
    let arm = places
        .iter()
        .map(|q| (q - about).norm())
        .fold(1e-3, f64::max);
    let mut h = vec![nalgebra::Matrix6::zeros(); count];
    let mut g = vec![nalgebra::Vector6::zeros(); count];
    for &i in on_part {
        let r = fit::row(&points[i], &measured[i], &about, arm);
        h[groups.of(i)] += r * r.transpose();
        g[groups.of(i)] -= r * measured[i].distance_mm;
    }
    let sigma2 = sigma * sigma;
    let damping = groups.damping(&h, &about, arm, sigma2);
    (0..count)
        .map(|k| {
            let (values, _) = crate::solve::eigen(&h[k]);
            let held = values.iter().filter(|v| **v > FREE * values[5]).count();
            let own = crate::solve::pseudo_solve(&h[k], &g[k], FREE);
            (own.dot(&(damping[k] * h[k] * own)) / sigma2, held)
        })
        .collect()
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
    if off_ppm.abs() > scale_limit_ppm && c.is_off_size() {
        let more = match c.by_size {
            0 => String::new(),
            more => format!(
                "; {more} of the points about the {what} lie on it by that size alone, and the pose is not of them"
            ),
        };
        let face = match what {
            "part" => {
                ", or a face that is off all over, by wear or stock: where one of two opposite faces was not scanned, or the \
                 noise is as large, these look alike"
            }
            _ => "",
        };
        reasons.push(ScanError::refused(
            "scale",
            format_args!(
                "the scan is {:.6} times as large as it should be ({off_ppm:+.0} ppm, limit {scale_limit_ppm} ppm){more}: \
                 shrinkage, temperature, the scanner's calibration{face}",
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

/// The refusal for motions that no point holds: turns about a place, and shifts.
fn degenerate(free: &[nalgebra::Vector6<f64>], about_mm: &Vec3, what: &str) -> ScanError {
    let free: Vec<Value> = free
        .iter()
        .map(|v| json!({"turn": [v[0], v[1], v[2]], "shift": [v[3], v[4], v[5]], "about_mm": about_mm.as_slice()}))
        .collect();
    ScanError::refused(
        "degenerate",
        format_args!(
            "what the scan shows of the {what} does not hold the pose: {} of its 6 motions (three shifts, three turns) {} free; \
             scan also faces that look in other directions",
            free.len(),
            if free.len() == 1 { "is" } else { "are" }
        ),
    )
    .with("free", free)
}
