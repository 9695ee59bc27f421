//! How far a pose can be off: noise by the residuals, and what neighbours share of it.

#[cfg(test)]
mod coverage;
mod faces;
mod shared;

pub(super) use faces::on_faces;
use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector6};

use crate::localise::uncertainty::shared::shared;
use crate::rigid::{Pose, Vec3};
use crate::solve::median;
use crate::solve::{Measured, eigen};

/// What the data say about a pose.
#[derive(Clone, Debug)]
pub struct Certainty {
    /// The covariance of (rotation vector w, translation): R_true = exp(w×) R, the translation at the source's origin.
    pub cov: Matrix6<f64>,
    /// The scale beside the pose: the scan is so many times as large as the model. Not applied.
    pub scale: f64,
    /// Its standard uncertainty; infinite, with a scale of 1, where the points do not say.
    pub u_scale: f64,
    /// How many more points lie on the part by that scale than by the pose alone, where they are more than chance. A scale
    /// that no face holds can show by them, by the edges alone.
    pub by_size: usize,
    /// How much larger shared errors make the standard uncertainty, at the worst; 1 if neighbours share nothing.
    pub shared: f64,
    /// Motions that the points do not determine: turn (with unit length times the arm) and shift, in the frame of the
    /// scan about `about_mm`.
    pub free: Vec<Vector6<f64>>,
    /// Where those turns go through.
    pub about_mm: Vec3,
    /// What each common cause ([`Group::common`]) does to the pose, as `cov` has it; in it already.
    pub(super) common: Vec<Matrix6<f64>>,
}

/// A direction is free if the points hold it less than this share of the best one, in squares.
const FREE: f64 = 2e-4;
/// The scale is not held if less than this share of what the points say of it is left beside the pose.
const SCALED: f64 = 1e-5;
/// What Tukey's kernel keeps of the information of normal noise.
const EFFICIENCY: f64 = 0.95;

/// Points that stand or fall together: those of one fiducial, or of one scan.
#[derive(Clone, Debug)]
pub(super) struct Group {
    /// A place in the frame of the scan.
    pub at: Vec3,
    /// How sure the group's own place is: the covariance of its turn (rad) about `at` and of its shift (mm).
    pub cov: Matrix6<f64>,
    /// What causes that other groups have too do to it: the factors F of the part ΣFFᵀ of `cov`, by cause. Where a ball truly
    /// stands is as wrong in each of several scans.
    pub common: Vec<Matrix6<f64>>,
}

impl Group {
    /// From its turn about `at` and its shift to turns about `about`, in units of the arm, and shifts.
    fn carry(&self, about: &Vec3, arm: f64) -> Matrix6<f64> {
        let mut carry = Matrix6::identity();
        for i in 0..3 {
            carry[(i, i)] = arm;
        }
        let lever = (about - self.at).cross_matrix();
        carry.fixed_view_mut::<3, 3>(3, 0).copy_from(&-lever);
        carry
    }
}

/// The groups, and that of each point; nothing of either if all points belong to one body whose place is what is sought.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Groups<'a> {
    pub all: &'a [Group],
    pub of: &'a [usize],
}

impl Groups<'_> {
    /// What a group's own doubt leaves of a row of its points, for each group: (1 + H P)⁻¹ with the group's information
    /// H and covariance P. It is what remains if the group's own motion is solved for beside the pose.
    pub fn damping<const N: usize>(
        &self,
        information: &[SMatrix<f64, N, N>],
        about: &Vec3,
        arm: f64,
        sigma2: f64,
    ) -> Vec<SMatrix<f64, N, N>> {
        let whole = SMatrix::<f64, N, N>::identity();
        self.doubts(about, arm)
            .zip(information)
            .map(|(p, h)| (whole + h * p / sigma2).try_inverse().unwrap_or(whole))
            .collect()
    }

    /// That motion of each group, (H + P⁻¹)⁻¹ g, by what its points say beside the pose (g).
    fn own<const N: usize>(
        &self,
        damping: &[SMatrix<f64, N, N>],
        said: &[SVector<f64, N>],
        about: &Vec3,
        arm: f64,
        sigma2: f64,
    ) -> Vec<SVector<f64, N>> {
        self.doubts(about, arm)
            .zip(damping.iter().zip(said))
            .map(|(p, (d, g))| p * (d * g) / sigma2)
            .collect()
    }

    /// How sure each group's place is, as turns about `about`, in units of the arm, and shifts.
    fn doubts<const N: usize>(
        &self,
        about: &Vec3,
        arm: f64,
    ) -> impl Iterator<Item = SMatrix<f64, N, N>> {
        self.all.iter().map(move |group| {
            let carry = group.carry(about, arm);
            let mut p = SMatrix::<f64, N, N>::zeros();
            p.fixed_view_mut::<6, 6>(0, 0)
                .copy_from(&(carry * group.cov * carry.transpose()));
            p
        })
    }

    /// The group of the point `i`; 0 where there are none.
    pub fn of(&self, i: usize) -> usize {
        self.of.get(i).copied().unwrap_or(0)
    }
}

/// The certainty of `motion` by the points on the part (`on_part`, with noise `sigma_mm`).
pub(super) fn certainty(
    points: &[Vec3],
    measured: &[Measured],
    on_part: &[usize],
    motion: &Pose,
    sigma_mm: f64,
    groups: Groups<'_>,
) -> Certainty {
    by(points, measured, on_part, motion, sigma_mm, groups, true)
}

/// The same if each point's error is its own: at a fraction of the cost, and enough to say what is free.
pub(super) fn white(
    points: &[Vec3],
    measured: &[Measured],
    on_part: &[usize],
    motion: &Pose,
    sigma_mm: f64,
) -> Certainty {
    let groups = Groups::default();
    by(points, measured, on_part, motion, sigma_mm, groups, false)
}

fn by(
    points: &[Vec3],
    measured: &[Measured],
    on_part: &[usize],
    motion: &Pose,
    sigma_mm: f64,
    groups: Groups<'_>,
    may_share: bool,
) -> Certainty {
    let about = {
        let first = on_part.first().map_or_else(Vec3::zeros, |&i| points[i]);
        first
            + on_part.iter().map(|&i| points[i] - first).sum::<Vec3>() / on_part.len().max(1) as f64
    };
    let arm = (on_part
        .iter()
        .map(|&i| (points[i] - about).norm_squared())
        .sum::<f64>()
        / on_part.len().max(1) as f64)
        .sqrt()
        .max(1e-6);
    // Turns about the middle of the points, in units of the arm: all components of like size.
    let row = |i: usize| {
        let n = measured[i].direction;
        let m = (points[i] - about).cross(&n) / arm;
        Vector6::new(-m.x, -m.y, -m.z, -n.x, -n.y, -n.z)
    };
    let count = groups.all.len().max(1);
    let mut sevens = vec![SMatrix::<f64, 7, 7>::zeros(); count];
    let mut rights = vec![SVector::<f64, 7>::zeros(); count];
    let grown = |i: usize| {
        let r = row(i);
        // Of the foot on the model: the point's own noise would look like growth.
        let m = &measured[i];
        let foot = points[i] - m.direction * m.distance_mm;
        let grow = -m.direction.dot(&(foot - about)) / arm;
        SVector::<f64, 7>::from([r[0], r[1], r[2], r[3], r[4], r[5], grow])
    };
    for &i in on_part {
        let full = grown(i);
        let k = groups.of(i);
        sevens[k] += full * full.transpose();
        rights[k] -= full * measured[i].distance_mm;
    }
    let sigma2 = sigma_mm * sigma_mm / EFFICIENCY;
    let mut damping = groups.damping(&sevens, &about, arm, sigma2);
    damping.resize(count, SMatrix::identity());
    let bare: SMatrix<f64, 7, 7> = sevens.iter().sum();
    let seven: SMatrix<f64, 7, 7> = sevens.iter().zip(&damping).map(|(h, d)| d * h).sum();
    let right: SVector<f64, 7> = rights.iter().zip(&damping).map(|(g, d)| d * g).sum();
    let six: Matrix6<f64> = bare.fixed_view::<6, 6>(0, 0).into_owned();
    let (values, vectors) = eigen(&six);
    let free: Vec<Vector6<f64>> = (0..6)
        .filter(|&k| values[k] <= FREE * values[5])
        .map(|k| {
            let v = vectors.column(k);
            Vector6::new(v[0] / arm, v[1] / arm, v[2] / arm, v[3], v[4], v[5])
        })
        .collect();
    let six: Matrix6<f64> = seven.fixed_view::<6, 6>(0, 0).into_owned();
    let inverse = ((six + six.transpose()) / 2.0)
        .try_inverse()
        .unwrap_or_else(Matrix6::zeros);
    let white = inverse * sigma2;
    let row =
        |i: usize| -> Vector6<f64> { damping[groups.of(i)].fixed_view::<6, 6>(0, 0) * row(i) };
    // What a group's own doubt explains is in `inverse`, and no error that neighbours share.
    let own = groups.own(&damping, &rights, &about, arm, sigma2);
    let left = |i: usize| {
        let own = own.get(groups.of(i)).map_or(0.0, |x| grown(i).dot(x));
        measured[i].distance_mm + own
    };
    let direction = |i: usize| measured[i].direction;
    // Where scans are told apart, their own doubts say how they differ.
    let faces = groups.all.is_empty();
    let extra = if may_share {
        let of_pairs = shared(points, on_part, sigma2, &left, &direction, &row, faces);
        inverse * of_pairs * inverse
    } else {
        Matrix6::zeros()
    };
    // What is added must not make anything more certain.
    let (added, directions) = eigen(&extra);
    let mut cov = white;
    for k in 0..6 {
        if added[k] > 0.0 {
            let v = directions.column(k);
            cov += v * v.transpose() * added[k];
        }
    }
    let ratio = (0..6)
        .map(|k| {
            if white[(k, k)] > 0.0 {
                (cov[(k, k)] / white[(k, k)]).sqrt()
            } else {
                1.0
            }
        })
        .fold(1.0, f64::max);
    // The groups' doubts were taken for each one's own: what a common cause does to all of them adds up.
    let mut common: Vec<Matrix6<f64>> = Vec::new();
    for (k, group) in groups.all.iter().enumerate() {
        let held = damping[k] * sevens[k];
        let answer = inverse * held.fixed_view::<6, 6>(0, 0) * group.carry(&about, arm);
        common.resize(group.common.len(), Matrix6::zeros());
        for (all, cause) in common.iter_mut().zip(&group.common) {
            let one = answer * cause;
            cov -= one * one.transpose();
            *all += one;
        }
    }
    for all in &common {
        cov += all * all.transpose();
    }
    // What holds the scale, with all that the pose can do taken out: faces that meet in one point hold none of it.
    let growth: Vector6<f64> = seven.fixed_view::<6, 1>(0, 6).into_owned();
    let held = seven[(6, 6)] - growth.dot(&(inverse * growth));
    let solved = seven
        .try_inverse()
        .filter(|_| held > SCALED * seven[(6, 6)]);
    // What is left with the scale in the fit: a wrong scale looks like errors that neighbours share.
    let (scale, u_scale) = solved.map_or((1.0, f64::INFINITY), |inverse| {
        let delta = inverse * right;
        let said: Vec<_> = rights
            .iter()
            .zip(&sevens)
            .map(|(g, h)| g - h * delta)
            .collect();
        let own = groups.own(&damping, &said, &about, arm, sigma2);
        let left = |i: usize| {
            let own = own.get(groups.of(i)).copied().unwrap_or_default();
            measured[i].distance_mm + grown(i).dot(&(delta + own))
        };
        let mut all: Vec<f64> = on_part.iter().map(|&i| left(i).abs()).collect();
        let sigma = sigma_mm.min(1.4826 * median(&mut all));
        let row = |i: usize| damping[groups.of(i)] * grown(i);
        let extra = if ratio > 1.0 {
            let sigma2 = sigma * sigma;
            inverse * shared(points, on_part, sigma2, &left, &direction, &row, faces) * inverse
        } else {
            SMatrix::zeros()
        };
        let square = inverse[(6, 6)].max(0.0) * sigma * sigma + extra[(6, 6)].max(0.0);
        (1.0 + delta[6] / arm, square.sqrt() / arm)
    });
    let origin = at_origin(arm, &about, motion);
    Certainty {
        cov: origin * cov * origin.transpose(),
        common: common.iter().map(|all| origin * all).collect(),
        scale,
        u_scale,
        by_size: 0,
        shared: ratio,
        free,
        about_mm: about,
    }
}

/// A rotation for turns and shifts.
pub(super) fn turning(rotation: &Matrix3<f64>) -> Matrix6<f64> {
    let mut turn = Matrix6::zeros();
    turn.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation);
    turn.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation);
    turn
}

/// From turns in units of the arm about the middle of the points, to turns in rad with the translation at the source's origin.
pub(super) fn at_origin(arm: f64, about: &Vec3, motion: &Pose) -> Matrix6<f64> {
    let mut carry = Matrix6::identity();
    for i in 0..3 {
        carry[(i, i)] = 1.0 / arm;
    }
    // δt = d + w × (t − about).
    let lever = (motion.translation_mm - about).cross_matrix();
    carry
        .fixed_view_mut::<3, 3>(3, 0)
        .copy_from(&(-lever / arm));
    carry
}

impl Certainty {
    /// Wider where groups differ by more than their own doubts and the noise say: by the ratio of what is left of them
    /// (mm² over the noise) to what was expected, if that is more than one.
    #[must_use]
    pub(super) fn widened(mut self, ratio: f64) -> Self {
        self.cov *= ratio.max(1.0);
        self.u_scale *= ratio.max(1.0).sqrt();
        self
    }

    /// The same of bodies that were fitted each by itself: what their points share with each other makes them differ, too.
    #[must_use]
    pub(super) fn differing(self, ratio: f64) -> Self {
        let shared = self.shared * self.shared;
        self.widened(ratio / shared)
    }

    /// Whether the scale is surely off: beyond its own doubt, or by the points that it alone explains.
    pub(super) fn is_off_size(&self) -> bool {
        self.by_size > 0 || (self.scale - 1.0).abs() > 4.0 * self.u_scale
    }

    /// With every place moved by up to so many mm, wherever it is.
    #[must_use]
    pub(super) fn off_by(mut self, mm: f64) -> Self {
        for k in 3..6 {
            self.cov[(k, k)] += mm * mm / 3.0;
        }
        self
    }

    /// With every place moved by any of these, or not, in mm.
    #[must_use]
    pub(super) fn or_moved(mut self, ways: &[Vec3]) -> Self {
        let mut places = self.cov.fixed_view_mut::<3, 3>(3, 3);
        for way in ways {
            places += way * way.transpose();
        }
        self
    }

    /// That of `motion` after `first`, which is exact.
    #[must_use]
    pub(super) fn before(self, motion: &Pose, first: &Pose) -> Self {
        let mut carry = Matrix6::identity();
        let lever = (motion.rotation * first.translation_mm).cross_matrix();
        carry.fixed_view_mut::<3, 3>(3, 0).copy_from(&-lever);
        self.carried(&carry)
    }

    /// That of the inverse of `motion`.
    #[must_use]
    pub(super) fn inverted(self, motion: &Pose) -> Self {
        let back = -motion.rotation.transpose();
        let mut carry = Matrix6::zeros();
        carry.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
        carry.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
        let lever = back * motion.translation_mm.cross_matrix();
        carry.fixed_view_mut::<3, 3>(3, 0).copy_from(&lever);
        self.carried(&carry)
    }

    fn carried(mut self, carry: &Matrix6<f64>) -> Self {
        self.cov = carry * self.cov * carry.transpose();
        for cause in &mut self.common {
            *cause = carry * *cause;
        }
        self
    }

    /// The covariance of the image of `p` (source coordinates) in mm².
    #[must_use]
    pub fn at(&self, motion: &Pose, p: &Vec3) -> nalgebra::Matrix3<f64> {
        let mut carry = SMatrix::<f64, 3, 6>::zeros();
        carry
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&-(motion.rotation * p).cross_matrix());
        carry
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&nalgebra::Matrix3::identity());
        carry * self.cov * carry.transpose()
    }
}
