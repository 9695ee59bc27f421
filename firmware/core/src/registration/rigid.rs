//! The least-squares rigid registration of point pairs.
//!
//! The rotation comes from the singular value decomposition of the
//! cross-covariance (Arun, Huang and Blostein, IEEE PAMI 9, 1987), with the
//! reflection handled by the determinant rule (Kabsch, Acta Cryst. A32, 1976;
//! Umeyama, IEEE PAMI 13, 1991). That rule has no test for a zero singular
//! value: three points are always coplanar, so the smallest one is zero up to
//! rounding and the sign of the plain product is chance. Here the third
//! singular vectors are the vector products of the first two, which is the
//! determinant rule without any branch.
//!
//! The closed form squares the coordinates, so its rotation is then polished
//! by Gauss-Newton steps on the residuals themselves.

use nalgebra::{Matrix3, Vector3};

use super::transform::{Quaternion, RigidTransform, rotated};
use crate::fit::solve::cloud::{Cloud, count};
use crate::fit::solve::linalg::{
    Qr, Square, Svd3, Triangle, all_finite, largest_variance, orthonormal, propagate, scaled, trace,
};
use crate::fit::{FitError, MAX_CONDITION, PointSet, Quantity, SPREAD_LIMIT, Statistics};
use crate::units::{Mm, Point, Rad};

/// Pairs that a registration needs.
pub const MIN_PAIRS: usize = 3;

/// The rigid transform that carries the source points onto the target points
/// with the least sum of squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registration {
    /// `q = R p + t`, from the source to the target frame.
    pub transform: RigidTransform,
    /// Angle of the rotation, 0 to π.
    pub angle: Rad,
    /// Axis of the rotation; None if there is none.
    pub axis: Option<Vector3<f64>>,
    /// Statistics of the residual vectors `R p + t - q`: `rms` and
    /// `max_abs_residual` of their lengths, `dof` is 3n - 6, `sigma` that of one
    /// coordinate of one target point (source points taken as exact).
    pub stats: Statistics,
    /// `inv(JᵀJ)` for unit noise: small rotation vector w (three rows, 1/mm²)
    /// with `R_true = exp([w]×) R`, then the translation at the origin of the
    /// source frame (three rows).
    pub cov_unit: [[f64; 6]; 6],
    /// Where the transform is known best: the centroid of the source points.
    pub centroid: Point,
    /// Covariance of w alone for unit noise (block of `cov_unit`), 1/mm².
    pub cov_unit_rotvec: [[f64; 3]; 3],
}

/// Registers `source` (nominal, CAD) to `target` (measured, MCS).
///
/// # Errors
/// * `length_mismatch`, `too_few_points` below three pairs, `not_finite`;
/// * `degenerate` if the points of either side are collinear;
/// * `ill_conditioned` if the two sides match so badly (a mirror image, wrong
///   pairs) that the rotation is not unique, or if its condition is above
///   [`MAX_CONDITION`].
pub fn register(source: &[Point], target: &[Point]) -> Result<Registration, FitError> {
    if source.len() != target.len() {
        return Err(FitError::LengthMismatch {
            source: source.len(),
            target: target.len(),
        });
    }
    let from = Cloud::new(source, PointSet::Source, MIN_PAIRS)?;
    let to = Cloud::new(target, PointSet::Target, MIN_PAIRS)?;
    let triangle = from.require_plane()?;
    to.require_plane()?;

    let start = closed_form(&from, &to)?;
    let (quaternion, cov_w_local) = polish(&from, &to, &triangle, start)?;
    let rotation = quaternion.to_rotation();

    let zero = Vector3::zeros();
    let (from_centroid, to_centroid) = (from.point_at(&zero), to.point_at(&zero));
    let arm = rotated(&rotation, &from_centroid.mm);
    let transform = RigidTransform {
        rotation,
        translation_mm: to_centroid.mm - arm,
    };
    let cov_unit_rotvec = scaled(&cov_w_local, 1.0 / (from.scale() * from.scale()));
    let cov_unit = at_origin(&cov_unit_rotvec, &arm, from.count());

    let lengths = pairs(&from, &to).map(|(p, q)| {
        let residual = rotated(&rotation, &p) * from.scale() - q * to.scale();
        crate::fit::solve::linalg::norm(&residual)
    });
    let dof = 3 * from.len() - 6;
    let rounding = Mm(from.rounding().0 + to.rounding().0);
    let stats = Statistics::new(lengths, dof, rounding);
    let (angle, axis) = transform.angle_axis();
    if !all_finite(&cov_unit) {
        return Err(not_unique(f64::INFINITY));
    }
    Ok(Registration {
        transform,
        angle,
        axis,
        stats,
        cov_unit,
        centroid: from_centroid,
        cov_unit_rotvec,
    })
}

impl Registration {
    /// The image of a source point in the target frame.
    #[must_use]
    pub fn apply(&self, p: Point) -> Point {
        self.transform.apply(p)
    }

    /// The transform from the target back to the source frame.
    #[must_use]
    pub fn inverse(&self) -> RigidTransform {
        self.transform.inverse()
    }

    /// `R p + t - q` of one pair, millimetres: transformed minus measured.
    #[must_use]
    pub fn residual_mm(&self, source: Point, target: Point) -> Vector3<f64> {
        self.apply(source).mm - target.mm
    }

    /// Covariance of rotation vector (rad²) and translation at the origin (mm²).
    #[must_use]
    pub fn cov(&self) -> Option<[[f64; 6]; 6]> {
        self.stats.covariance(&self.cov_unit)
    }

    /// Covariance of the rotation vector, rad².
    #[must_use]
    pub fn cov_rotvec(&self) -> Option<[[f64; 3]; 3]> {
        self.stats.covariance(&self.cov_unit_rotvec)
    }

    /// Covariance of the translation at the origin of the source frame, mm².
    #[must_use]
    pub fn cov_t(&self) -> Option<[[f64; 3]; 3]> {
        self.stats.covariance(&self.cov_unit_at(Point {
            mm: Vector3::zeros(),
        }))
    }

    /// Covariance of the image of a source point for unit noise, dimensionless:
    /// what the uncertainty of the registration means there.
    #[must_use]
    pub fn cov_unit_at(&self, p: Point) -> [[f64; 3]; 3] {
        let arm = rotated(&self.transform.rotation, &(p.mm - self.centroid.mm));
        let mut cov = propagate(&cross_negative(&arm), &self.cov_unit_rotvec);
        let at_centroid = 1.0 / count(self.stats.n);
        let [[xx, ..], [_, yy, _], [.., zz]] = &mut cov;
        for diagonal in [xx, yy, zz] {
            *diagonal += at_centroid;
        }
        cov
    }

    /// Expected error of the image of a source point: the root of the sum of
    /// the three variances, that is the expected rms length of the error
    /// (target registration error; Fitzpatrick, West and Maurer, IEEE Trans.
    /// Med. Imaging 17, 1998). None without `sigma`.
    #[must_use]
    pub fn expected_error_at(&self, p: Point) -> Option<Mm> {
        let [[xx, ..], [_, yy, _], [.., zz]] = self.cov_unit_at(p);
        self.stats.standard_uncertainty(xx + yy + zz).map(Mm)
    }
}

fn pairs<'a>(
    from: &Cloud<'a>,
    to: &Cloud<'a>,
) -> impl Iterator<Item = (Vector3<f64>, Vector3<f64>)> + Clone + use<'a> {
    from.local().zip(to.local())
}

/// The rotation by singular value decomposition.
fn closed_form(from: &Cloud<'_>, to: &Cloud<'_>) -> Result<Matrix3<f64>, FitError> {
    let mut sum = Matrix3::zeros();
    for (p, q) in pairs(from, to) {
        sum += Matrix3::new(
            p.x * q.x,
            p.x * q.y,
            p.x * q.z, //
            p.y * q.x,
            p.y * q.y,
            p.y * q.z, //
            p.z * q.x,
            p.z * q.y,
            p.z * q.z,
        );
    }
    let svd = Svd3::new(&[
        [sum.m11, sum.m12, sum.m13],
        [sum.m21, sum.m22, sum.m23],
        [sum.m31, sum.m32, sum.m33],
    ]);
    let [first, second, third] = svd.values;
    // The rotation is unique if the second singular value exceeds the third
    // where the third counts negative, i.e. where the best orthogonal matrix is
    // a reflection.
    let determinant = sum.m11 * (sum.m22 * sum.m33 - sum.m23 * sum.m32)
        - sum.m12 * (sum.m21 * sum.m33 - sum.m23 * sum.m31)
        + sum.m13 * (sum.m21 * sum.m32 - sum.m22 * sum.m31);
    let gap = second + if determinant < 0.0 { -third } else { third };
    if gap <= SPREAD_LIMIT * SPREAD_LIMIT * first {
        return Err(not_unique(first / gap.max(0.0)));
    }
    let [u1, u2] = svd.left;
    let [u1, u2, u3] = orthonormal(&u1, &u2);
    let [v1, v2, v3] = svd.right;
    // R = V Uᵀ for H = Σ p qᵀ = U S Vᵀ, column by column.
    let x = v1 * u1.x + v2 * u2.x + v3 * u3.x;
    let y = v1 * u1.y + v2 * u2.y + v3 * u3.y;
    let z = v1 * u1.z + v2 * u2.z + v3 * u3.z;
    Ok(Matrix3::new(
        x.x, y.x, z.x, //
        x.y, y.y, z.y, //
        x.z, y.z, z.z,
    ))
}

/// Gauss-Newton on `Σ|R p - q|²` over the rotation vector, and `inv(JᵀJ)` in
/// units of the source's local coordinates.
///
/// `JᵀJ = R Σ(|p|² - p pᵀ) Rᵀ` knows the points by `Σ p pᵀ` alone: the three rows of
/// `triangle`, the source's, stand for all of them, and no step decomposes anew. A step solves
/// the seminormal equations, and the next corrects what rounding left of it (Björck, Linear
/// Algebra Appl. 88, 1987).
fn polish(
    from: &Cloud<'_>,
    to: &Cloud<'_>,
    triangle: &Triangle<3>,
    start: Matrix3<f64>,
) -> Result<(Quaternion, Square<3>), FitError> {
    /// The closed form is already within rounding times condition: one step
    /// does, a second proves it.
    const STEPS: u32 = 4;
    let mut qr = Qr::<3>::new();
    for p in triangle.rows() {
        for row in cross_negative(&p) {
            qr.add(row, 0.0);
        }
    }
    let unturned = (qr.triangle().inverse_gram()).ok_or_else(|| not_unique(f64::INFINITY))?;
    let ratio = to.scale() / from.scale();
    let mut quaternion = Quaternion::from_rotation(&start);
    let mut cov = unturned;
    for _ in 0..STEPS {
        let rotation = quaternion.to_rotation();
        // Jᵀ times what is wanted: w × y = q - y, in least squares.
        let pull = pairs(from, to).fold(Vector3::zeros(), |sum: Vector3<f64>, (p, q)| {
            let y = rotated(&rotation, &p);
            sum + y.cross(&(q * ratio - y))
        });
        let m = rotation;
        let rows = [
            [m.m11, m.m12, m.m13],
            [m.m21, m.m22, m.m23],
            [m.m31, m.m32, m.m33],
        ];
        cov = propagate(&rows, &unturned);
        let w = Vector3::from(cov.map(|row| Vector3::from(row).dot(&pull)));
        quaternion = quaternion.turned_by(&w);
        if w.amax() <= 2.0 * f64::EPSILON {
            break;
        }
    }
    // The sum of the variances is above the largest: where it is good, that is, too.
    let is_well_conditioned = libm::sqrt(trace(&cov)) <= MAX_CONDITION;
    if !is_well_conditioned {
        let condition = libm::sqrt(largest_variance(&cov));
        if condition > MAX_CONDITION {
            return Err(not_unique(condition));
        }
    }
    Ok((quaternion, cov))
}

/// The matrix of `w ↦ w × y`, that is `-[y]×`.
fn cross_negative(y: &Vector3<f64>) -> [[f64; 3]; 3] {
    [[0.0, y.z, -y.y], [-y.z, 0.0, y.x], [y.y, -y.x, 0.0]]
}

/// The 6x6 covariance of (w, t at the origin) from that of w: the image of the
/// centroid, at `arm` = R p̄ from the turned origin, has variance 1/n and does
/// not depend on w, and t = image - w × arm.
fn at_origin(cov_w: &Square<3>, arm: &Vector3<f64>, n: f64) -> [[f64; 6]; 6] {
    let [a, b, c] = cross_negative(&-arm);
    // Rows of d(w, t)/d(w, image of the centroid).
    let jacobian = [
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        [a[0], a[1], a[2], 1.0, 0.0, 0.0],
        [b[0], b[1], b[2], 0.0, 1.0, 0.0],
        [c[0], c[1], c[2], 0.0, 0.0, 1.0],
    ];
    let [x, y, z] = *cov_w;
    let variance = 1.0 / n;
    let blocks = [
        [x[0], x[1], x[2], 0.0, 0.0, 0.0],
        [y[0], y[1], y[2], 0.0, 0.0, 0.0],
        [z[0], z[1], z[2], 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, variance, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, variance, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, variance],
    ];
    propagate(&jacobian, &blocks)
}

fn not_unique(condition: f64) -> FitError {
    FitError::IllConditioned {
        quantity: Quantity::Rotation,
        condition,
        limit: MAX_CONDITION,
    }
}
