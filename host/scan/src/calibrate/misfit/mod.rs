//! Whether the poses of a calibration agree with one another.
//!
//! A zero of an axis that is wrong leaves residuals that are small, and differ from pose to pose more than they
//! scatter within one. Two tests say so:
//!
//! * *Lack of fit*: each pose gets a mean of its own. What that takes from the sum of squares, beside what is left
//!   within the poses, each by its degrees of freedom, has an F distribution where poses agree: the general linear
//!   hypothesis (Seber and Lee, Linear Regression Analysis, 2003, section 4.3). Exact for errors that are alike and
//!   normal; the columns of the fit are counted once, whether the means take part of them or not.
//! * *Slips*: what may be wrong about the machine's axes ([`slips`]), each alone beside all that was fitted. Its t has to
//!   stand out of the scatter of single residuals, and out of that of the poses, which is greater where they disagree
//!   for no reason at all.
//!
//! Where they disagree, the covariance is that of their scatter: with `a` the change of the unknowns by all residuals
//! of a pose together, the sum of `a aᵀ` (CR3 of Bell and McCaffrey, 2002). It holds for errors that a pose has for
//! itself. What is wrong in all poses alike moves the mount and shows in no covariance: that is what the slips are for.

pub mod slips;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use umi_core::job::beta_ratio;

use super::solve::Model;
use super::solve::scatter::whiten;

/// One false alarm in so many calibrations of poses that agree.
pub const ALARM: f64 = 1e-3;
/// A column of the fit of which the poses' means leave less than this share is one of theirs. (A shift across the laser's
/// plane changes all residuals of a ball's profile alike, but for what noise bends of it.)
pub(super) const TAKEN: f64 = 1e-3;
/// A slip of which less than this share is left beside the fit is not seen.
const UNSEEN: f64 = 1e-6;
/// Poses that scatter by so many times the scatter within them, or one that lies off so far, are no calibration.
const GROSS_SCATTER: f64 = 10.0;
/// A slip that moves the mount by so many of its standard uncertainties, too.
const GROSS_MOVE: f64 = 5.0;
/// Residuals below this, in mm, are rounding.
pub(super) const ROUNDING_MM: f64 = 1e-7;
/// What the gain of a slip may differ from the best one's, in variances, to be as good a reason.
const AS_GOOD: f64 = 9.0;
/// Below this a chance is told as such only.
const LEAST_P: f64 = 1e-12;
/// So many sums of squares are kept for the poses, 160 MB; beyond it only the F test is made.
const MOST_SUMS: usize = 20_000_000;
/// More degrees of freedom than this are as good as endless, and too many for the continued fraction.
const MOST_DOF: f64 = 1e4;

/// How far the poses disagree.
#[derive(Debug, Clone, Serialize)]
pub struct Misfit {
    /// The mean square between poses over that within them.
    pub f: f64,
    /// Degrees of freedom between poses.
    pub dof_between: usize,
    /// Degrees of freedom within them.
    pub dof_within: usize,
    /// The chance of so large an F where poses agree.
    pub p: f64,
    /// Standard deviation of a residual within its pose, in mm.
    pub within_mm: f64,
    /// Standard deviation of what a pose has for itself, beyond what the scatter within explains, in mm.
    pub between_mm: f64,
    /// The pose whose residuals stand out most: its profile, their mean in mm, and that over its standard uncertainty.
    pub worst: WorstPose,
    /// What is wrong about an axis, where that explains it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slip: Option<FoundSlip>,
}

/// The pose whose residuals stand out most.
#[derive(Debug, Clone, Serialize)]
pub struct WorstPose {
    /// The profile, or the angle of an axis.
    pub pose: String,
    /// The mean of its residuals in mm.
    pub mean_mm: f64,
    /// That over the standard uncertainty that it has by the scatter within poses.
    pub t: f64,
}

/// What is wrong about an axis, by the residuals.
#[derive(Debug, Clone, Serialize)]
pub struct FoundSlip {
    /// In words: "the zero of A".
    pub what: String,
    /// What must be added to it.
    pub add: f64,
    /// Its standard uncertainty, by the poses' scatter.
    pub u: f64,
    /// Of both.
    pub unit: &'static str,
    /// What would explain it as well, with what must be added.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub or: Vec<String>,
    /// How far the mount that is answered would move, in rad and mm.
    pub mount_turn_rad: f64,
    /// As `mount_turn_rad`.
    pub mount_shift_mm: f64,
    /// The largest of its moves, over the standard uncertainty that the answer has without it.
    pub mount_moves_u: f64,
}

impl Misfit {
    /// Whether poses that agree would be so rarely.
    #[must_use]
    pub fn stands_out(&self) -> bool {
        self.p < ALARM || self.slip.is_some()
    }

    /// Whether the answer is none.
    #[must_use]
    pub fn is_gross(&self) -> bool {
        let moved = |slip: &FoundSlip| slip.mount_moves_u > GROSS_MOVE;
        self.slip.as_ref().is_some_and(moved)
            || (self.p < ALARM
                && self.between_mm.max(self.worst.mean_mm.abs()) > GROSS_SCATTER * self.within_mm)
    }

    /// What is to be said of it.
    #[must_use]
    pub fn words(&self) -> String {
        let p = if self.p < LEAST_P {
            format!("p below {LEAST_P:e}")
        } else {
            format!("p = {:.1e}", self.p)
        };
        let mut text = format!(
            "the poses disagree with one another by more than the scatter within each explains: F({}, {}) = {:.1}, {p}; \
             {} is worst, its residuals lie {:+.4} mm off on the mean ({:+.1} standard uncertainties)",
            self.dof_between,
            self.dof_within,
            self.f,
            self.worst.pose,
            self.worst.mean_mm,
            self.worst.t,
        );
        match &self.slip {
            Some(slip) => {
                text += &format!(
                    ". They would agree better with {:+.4} {} (standard uncertainty {:.4}) added to {}",
                    slip.add, slip.unit, slip.u, slip.what
                );
                for other in &slip.or {
                    text += &format!(", or {other}");
                }
                text += &format!(
                    "; the mount then moves by {:.4} mm and {:.3} mrad",
                    slip.mount_shift_mm,
                    slip.mount_turn_rad * 1e3
                );
            }
            None => {
                text += ". Look at that pose, whether the artefact or a clamp moved, at the axes' zeros and places, and whether \
                         neighbouring samples share their errors (speckle: take fewer of each profile)"
            }
        }
        text
    }
}

/// What the residuals belong to, each by its place.
pub(super) struct Grouping<'a> {
    /// What has a mean of its own.
    pub group: &'a [usize],
    /// What the errors may be common to: one or several groups.
    pub pose: &'a [usize],
    /// The names of the poses.
    pub names: &'a dyn Fn(usize) -> String,
}

/// What may be wrong: fills in the change of the residual at a place by a unit of each.
pub(super) struct Suspects<'a> {
    /// What it is, and its unit.
    pub names: Vec<(String, &'static str)>,
    /// How many of the targets are turns; they come first.
    pub turns: usize,
    /// The change of the residual at a place by a unit of each.
    pub fill: &'a dyn Fn(usize, &mut [f64]),
}

/// What poses say of a fit.
pub(super) struct PoseScatter {
    /// None where no pose has more than one residual to spare, or there is nothing but rounding.
    pub misfit: Option<Misfit>,
    /// The targets' covariance by the poses' scatter, and its degrees of freedom; none where a pose alone decides an
    /// unknown.
    pub covariance: Option<(DMatrix<f64>, f64)>,
}

/// Sums of a group of residuals: their number, theirs, and of their whitened rows.
#[derive(Clone)]
struct Mean {
    n: f64,
    sum: f64,
    rows: DVector<f64>,
}

/// Sums of a pose.
#[derive(Clone)]
struct OfPose {
    /// Of row times residual.
    pull: DVector<f64>,
    /// Of row times its transpose.
    share: DMatrix<f64>,
    /// For each suspect: of its column times residual, of its square, and of its column times row.
    suspects: Vec<(f64, f64, DVector<f64>)>,
}

/// Looks at a model at its optimum. `u`: the standard uncertainties of the targets, as they are answered.
pub(super) fn look<M: Model>(
    model: &M,
    grouping: &Grouping<'_>,
    suspects: &Suspects<'_>,
    u: &[f64],
) -> PoseScatter {
    let (nuisances, targets) = model.unknowns();
    let n = model.residuals();
    let whiten = whiten(model);
    let seen = whiten.nrows();
    let groups = grouping.group.iter().max().map_or(0, |most| most + 1);
    let poses = grouping.pose.iter().max().map_or(0, |most| most + 1);
    let mut means = vec![
        Mean {
            n: 0.0,
            sum: 0.0,
            rows: DVector::zeros(seen),
        };
        groups
    ];
    let few = poses.saturating_mul(seen * seen) <= MOST_SUMS;
    let (kept, tried) = if few {
        (seen, suspects.names.len())
    } else {
        (0, 0)
    };
    let empty = OfPose {
        pull: DVector::zeros(kept),
        share: DMatrix::zeros(kept, kept),
        suspects: vec![(0.0, 0.0, DVector::zeros(kept)); tried],
    };
    let mut of_pose = vec![empty; poses];
    let mut pose_of_group = vec![0; groups];
    let mut line = DVector::zeros(nuisances + targets);
    let mut column = vec![0.0; suspects.names.len()];
    let (mut ssq, mut place) = (0.0, 0);
    model.rows(&mut |value, derivatives| {
        line.fill(0.0);
        derivatives(line.as_mut_slice());
        let white = &whiten * &line;
        let (group, pose) = (grouping.group[place], grouping.pose[place]);
        pose_of_group[group] = pose;
        let mean = &mut means[group];
        mean.n += 1.0;
        mean.sum += value;
        mean.rows += &white;
        ssq += value * value;
        place += 1;
        if !few {
            return;
        }
        let of = &mut of_pose[pose];
        of.pull.axpy(value, &white, 1.0);
        of.share.ger(1.0, &white, &white, 1.0);
        (suspects.fill)(place - 1, &mut column);
        for (sums, y) in of.suspects.iter_mut().zip(&column) {
            sums.0 += y * value;
            sums.1 += y * y;
            sums.2.axpy(*y, &white, 1.0);
        }
    });
    let to_targets = whiten.columns(nuisances, targets).transpose();
    let covariance = few.then(|| covariance(&to_targets, &of_pose)).flatten();
    let test = n
        .checked_sub(seen)
        .filter(|dof| *dof > 0 && (ssq / *dof as f64).sqrt() > ROUNDING_MM)
        .and_then(|dof| lack_of_fit(&means, ssq, dof));
    let misfit = test.map(|test| {
        let (group, mean_mm, t) = test.worst;
        Misfit {
            f: test.f,
            dof_between: test.dof_between,
            dof_within: test.dof_within,
            p: test.p,
            within_mm: test.within_mm,
            between_mm: test.between_mm,
            worst: WorstPose {
                pose: (grouping.names)(pose_of_group[group]),
                mean_mm,
                t,
            },
            slip: few
                .then(|| slip(&of_pose, suspects, (ssq, n - seen), &to_targets, u))
                .flatten(),
        }
    });
    PoseScatter { misfit, covariance }
}

struct LackOfFit {
    f: f64,
    dof_between: usize,
    dof_within: usize,
    p: f64,
    within_mm: f64,
    between_mm: f64,
    /// Its group, the mean, and that over its standard uncertainty.
    worst: (usize, f64, f64),
}

/// The test of a mean for each group beside all that was fitted.
fn lack_of_fit(means: &[Mean], ssq: f64, dof: usize) -> Option<LackOfFit> {
    let seen = means.first()?.rows.len();
    // The rows and residuals without the means of their groups: whitened rows have the unit matrix as their squares.
    let mut squares = DMatrix::identity(seen, seen);
    let mut pull = DVector::zeros(seen);
    let mut left = ssq;
    let mut spread = 0.0;
    let groups = means.iter().filter(|mean| mean.n > 0.0);
    for mean in groups.clone() {
        squares.ger(-1.0 / mean.n, &mean.rows, &mean.rows, 1.0);
        pull.axpy(-mean.sum / mean.n, &mean.rows, 1.0);
        left -= mean.sum * mean.sum / mean.n;
        spread += mean.n - mean.rows.norm_squared();
    }
    let axes = squares.symmetric_eigen();
    let mut rank = 0;
    for (value, direction) in axes.eigenvalues.iter().zip(axes.eigenvectors.column_iter()) {
        if *value > TAKEN {
            rank += 1;
            left -= direction.dot(&pull).powi(2) / value;
        }
    }
    let unknowns = groups.count() + rank;
    let dof_between = unknowns.checked_sub(seen).filter(|dof| *dof > 0)?;
    let dof_within = dof.checked_sub(dof_between).filter(|dof| *dof > 0)?;
    let within = left.max(0.0) / dof_within as f64;
    let between = (ssq - left).max(0.0) / dof_between as f64;
    if within <= ROUNDING_MM * ROUNDING_MM {
        return None;
    }
    let own = |mean: &Mean| mean.n - mean.rows.norm_squared();
    let of = |(group, mean): (usize, &Mean)| {
        let t = mean.sum / (within * own(mean)).sqrt();
        (group, mean.sum / mean.n, t)
    };
    let worst = means
        .iter()
        .enumerate()
        .filter(|(_, mean)| mean.n > 0.0 && own(mean) > TAKEN * mean.n)
        .map(of)
        .max_by(|a, b| a.2.abs().total_cmp(&b.2.abs()))?;
    let f = between / within;
    // The mean square between poses is the variance within, and that of the poses so many times.
    let each = (spread / dof_between as f64).max(1.0);
    Some(LackOfFit {
        f,
        dof_between,
        dof_within,
        p: beyond_f(f, dof_between as f64, dof_within as f64),
        within_mm: within.sqrt(),
        between_mm: ((between - within) / each).max(0.0).sqrt(),
        worst,
    })
}

/// The chance of an F beyond this one.
pub(super) fn beyond_f(f: f64, between: f64, within: f64) -> f64 {
    let (between, within) = (between.min(MOST_DOF), within.min(MOST_DOF));
    beta_ratio(within / 2.0, between / 2.0, within / (within + between * f))
}

/// The one slip of an axis that explains most, where it stands out of residuals and of poses.
fn slip(
    poses: &[OfPose],
    suspects: &Suspects<'_>,
    (ssq, dof): (f64, usize),
    to_targets: &DMatrix<f64>,
    u: &[f64],
) -> Option<FoundSlip> {
    let within = (dof.checked_sub(1)? as f64).max(1.0);
    let freely = poses.len().checked_sub(to_targets.ncols() + 1)?;
    let tried = suspects.names.len() as f64;
    struct Tried {
        place: usize,
        add: f64,
        u: f64,
        gain: f64,
        stands_out: bool,
        fitted: DVector<f64>,
    }
    let mut all = Vec::new();
    for place in 0..suspects.names.len() {
        let (mut squares, mut fitted) = (0.0, DVector::zeros(to_targets.ncols()));
        for pose in poses {
            squares += pose.suspects[place].1;
            fitted += &pose.suspects[place].2;
        }
        // What of its column the fit does not take.
        let seen = squares - fitted.norm_squared();
        if seen.is_nan() || seen <= UNSEEN * squares {
            continue;
        }
        let scores = poses.iter().map(|pose| {
            let (with_residual, square, with_row) = &pose.suspects[place];
            let score = with_residual - fitted.dot(&pose.pull);
            let own = square - 2.0 * fitted.dot(with_row) + fitted.dot(&(&pose.share * &fitted));
            (score, own)
        });
        let scores: Vec<(f64, f64)> = scores.collect();
        let add = -scores.iter().map(|(score, _)| score).sum::<f64>() / seen;
        let gain = add * add * seen;
        let single = (ssq - gain).max(0.0) / within;
        let of_poses: f64 = scores
            .iter()
            .map(|(score, own)| (score + add * own).powi(2))
            .sum();
        // Fewer poses are free than there are.
        let u = (of_poses * poses.len() as f64 / freely.max(1) as f64).sqrt() / seen;
        let chance = |f: f64, dof: f64| tried * beyond_f(f, 1.0, dof);
        all.push(Tried {
            place,
            add,
            u,
            gain,
            stands_out: freely > 0
                && chance(gain / single.max(1e-300), within) < ALARM
                && chance((add / u.max(1e-300)).powi(2), freely as f64) < ALARM,
            fitted,
        });
    }
    let most = all
        .iter()
        .filter(|tried| tried.stands_out)
        .max_by(|a, b| a.gain.total_cmp(&b.gain))?;
    let single = (ssq - most.gain).max(0.0) / within;
    let mut as_good = all
        .iter()
        .filter(|other| most.gain - other.gain < AS_GOOD * single);
    // What happens most comes first.
    let best = as_good.next()?;
    let others = as_good;
    let or = others.map(|other| {
        let (what, unit) = &suspects.names[other.place];
        format!("{:+.4} {unit} to {what}", other.add)
    });
    let moves = to_targets * &best.fitted * -best.add;
    let by_u = moves.iter().zip(u).map(|(by, u)| by.abs() / u.max(1e-300));
    let (what, unit) = suspects.names[best.place].clone();
    Some(FoundSlip {
        what,
        add: best.add,
        u: best.u,
        unit,
        or: or.collect(),
        mount_turn_rad: moves.rows(0, suspects.turns).norm(),
        mount_shift_mm: moves
            .rows(suspects.turns, moves.len() - suspects.turns)
            .norm(),
        mount_moves_u: by_u.fold(0.0, f64::max),
    })
}

/// The targets' covariance by the scatter of poses, and its degrees of freedom as [`super::solve::scatter`] counts
/// them, of poses instead of residuals.
fn covariance(to_targets: &DMatrix<f64>, poses: &[OfPose]) -> Option<(DMatrix<f64>, f64)> {
    let targets = to_targets.nrows();
    let unit = DMatrix::identity(to_targets.ncols(), to_targets.ncols());
    let alike = (to_targets * to_targets.transpose()).cholesky()?;
    let lower = alike.l();
    let mut sum = DMatrix::zeros(targets, targets);
    let mut shares = 0.0;
    for pose in poses {
        // Its residuals as they would be if it had no say: (1 - H)⁻¹ r, by the identity of Woodbury.
        let alone = (&unit - &pose.share).cholesky()?;
        let change = to_targets * alone.solve(&pose.pull);
        sum.ger(1.0, &change, &change, 1.0);
        let part = lower.solve_lower_triangular(to_targets)?;
        let own = &part * &pose.share * part.transpose();
        shares += own.trace().powi(2) + (&own * &own).trace();
    }
    let (k, n) = (targets as f64, poses.len() as f64);
    let dof = k * (k + 1.0) / shares;
    (dof > k).then(|| (sum * ((n - 1.0) / n), dof))
}
