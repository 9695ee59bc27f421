//! Sphere: centre and radius.

use nalgebra::Vector3;

use crate::fit::solve::cloud::Cloud;
use crate::fit::solve::least_squares::{Minimum, Surface, Term, minimise};
use crate::fit::solve::linalg::{Qr, block3, largest_variance, norm, trace};
use crate::fit::{FitError, PointSet, Quantity, Statistics, limits};
use crate::units::{Mm, Point};

/// Points that a sphere needs.
pub const MIN_POINTS: usize = 4;

/// A sphere fitted by orthogonal least squares.
///
/// Four degrees of freedom go into the parameters. With few points left over
/// (five points: one) some errors leave no residual at all, however small
/// `rms` is: in the pattern of a top and two opposite pairs, a wrong top hit
/// moves `center` and nothing else shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereFit {
    /// Centre.
    pub center: Point,
    /// Radius.
    pub radius: Mm,
    /// Statistics of the residuals; `dof` is n - 4.
    pub stats: Statistics,
    /// `inv(JᵀJ)`: covariance for unit noise, in the order centre x, y, z,
    /// radius. Dimensionless.
    pub cov_unit: [[f64; 4]; 4],
}

/// The solution of the linear problem `Σ(|p-c|² - r²)² = min` (Kasa, IEEE
/// Trans. Instrum. Meas. 25, 1976): the start value of the fit. It is biased
/// for small caps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearSphere {
    /// Centre.
    pub center: Point,
    /// Radius.
    pub radius: Mm,
}

/// Fits a sphere.
///
/// # Accuracy
/// Standard uncertainties of the result for independent noise of 1 on every
/// coordinate, and the distance within which 99 % of the centres lie (asserted
/// by simulation in the tests); so micrometres for a micrometre of noise:
///
/// | points                    | centre across | along | radius | 99 % within |
/// |---------------------------|---------------|-------|--------|-------------|
/// | top and two pairs (5)     | 0.71          | 1.12  | 0.50   | 3.5         |
/// | 25 on a cap of 120 degrees| 0.45          | 1.39  | 1.05   | 4.0         |
/// | 50 on a cap of 20 degrees | 1.65          | 32.3  | 32.1   | 90          |
///
/// # Errors
/// * `too_few_points` below four points, `not_finite`, `degenerate` for
///   coplanar points (see [`crate::fit::SPREAD_LIMIT`]);
/// * `cap_too_small` if the standard uncertainty of the radius is above
///   [`crate::fit::MAX_RELATIVE_UNCERTAINTY`] of it, or if the best surface is flat;
/// * `ill_conditioned` if that of the centre is, or if centre or radius have a
///   condition above [`crate::fit::MAX_CONDITION`];
/// * `no_convergence` if no minimum was found.
pub fn fit(points: &[Point]) -> Result<SphereFit, FitError> {
    let cloud = Cloud::new(points, PointSet::Points, MIN_POINTS)?;
    cloud.require_space()?;
    let start = linear_local(&cloud)?;
    let Minimum { surface, cov_unit } = minimise(start, &cloud.local())
        .map_err(|stopped| limits::stopped(&stopped, stopped.surface.radius))?;
    let result = SphereFit {
        center: cloud.point_at(&surface.center),
        radius: cloud.mm(surface.radius),
        stats: Statistics::new(
            cloud.local().map(|q| cloud.mm(surface.distance(&q)).0),
            cloud.len() - MIN_POINTS,
            cloud.rounding(),
        ),
        cov_unit,
    };
    result.check()?;
    Ok(result)
}

/// The linear problem on its own, without refinement.
///
/// # Errors
/// As [`fit`], without the limits on condition and uncertainty.
pub fn fit_linear(points: &[Point]) -> Result<LinearSphere, FitError> {
    let cloud = Cloud::new(points, PointSet::Points, MIN_POINTS)?;
    cloud.require_space()?;
    let Ball { center, radius } = linear_local(&cloud)?;
    Ok(LinearSphere {
        center: cloud.point_at(&center),
        radius: cloud.mm(radius),
    })
}

impl SphereFit {
    /// Distance of a point from the surface, positive outside.
    #[must_use]
    pub fn residual(&self, p: Point) -> Mm {
        Mm(norm(&(p.mm - self.center.mm)) - self.radius.0)
    }

    /// `sigma² inv(JᵀJ)` in mm², in the order centre x, y, z, radius.
    #[must_use]
    pub fn cov(&self) -> Option<[[f64; 4]; 4]> {
        self.stats.covariance(&self.cov_unit)
    }

    /// Standard uncertainties of the centre's x, y and z.
    #[must_use]
    pub fn center_uncertainty(&self) -> Option<[Mm; 3]> {
        self.stats
            .uncertainties(&block3(&self.cov_unit))
            .map(|u| u.map(Mm))
    }

    /// Standard uncertainty of the radius.
    #[must_use]
    pub fn radius_uncertainty(&self) -> Option<Mm> {
        let [.., [.., variance]] = self.cov_unit;
        self.stats.standard_uncertainty(variance).map(Mm)
    }

    /// The documented limits on condition and uncertainty.
    fn check(&self) -> Result<(), FitError> {
        let [.., [.., radius_variance]] = self.cov_unit;
        limits::curved(&self.stats, radius_variance, self.radius.0)?;
        // The sum of the variances is above the largest: where it is good, that is, too.
        let center = block3(&self.cov_unit);
        let is_surely_good = |variance| {
            limits::uncertain(&self.stats, Quantity::Center, variance, self.radius.0).is_ok()
                && limits::conditioned(Quantity::Center, variance).is_ok()
        };
        let bound = trace(&center);
        let center_variance = if is_surely_good(bound) {
            bound
        } else {
            largest_variance(&center)
        };
        limits::uncertain(
            &self.stats,
            Quantity::Center,
            center_variance,
            self.radius.0,
        )?;
        limits::conditioned(Quantity::Radius, radius_variance)?;
        limits::conditioned(Quantity::Center, center_variance)
    }
}

/// A sphere in local coordinates.
#[derive(Clone, Copy)]
struct Ball {
    center: Vector3<f64>,
    radius: f64,
}

impl Ball {
    fn distance(&self, q: &Vector3<f64>) -> f64 {
        norm(&(q - self.center)) - self.radius
    }
}

impl Surface<4> for Ball {
    fn term(&self, q: &Vector3<f64>) -> Option<Term<4>> {
        let v = q - self.center;
        let distance = norm(&v);
        // d = |v| - r; ∇d = (-u, -1); ∇²d = (I - u uᵀ) / |v| in the centre.
        let inverse = 1.0 / distance;
        if !inverse.is_finite() {
            return None;
        }
        let u = v * inverse;
        Some(Term {
            residual: distance - self.radius,
            gradient: [-u.x, -u.y, -u.z, -1.0],
            second: [
                [(1.0 - u.x * u.x) * inverse, 0.0, 0.0, 0.0],
                [-u.x * u.y * inverse, (1.0 - u.y * u.y) * inverse, 0.0, 0.0],
                [
                    -u.x * u.z * inverse,
                    -u.y * u.z * inverse,
                    (1.0 - u.z * u.z) * inverse,
                    0.0,
                ],
                [0.0; 4],
            ],
        })
    }

    fn moved(&self, [x, y, z, r]: &[f64; 4]) -> Option<Self> {
        let radius = self.radius + r;
        (radius > 0.0 && radius < limits::FLAT).then(|| Self {
            center: self.center + Vector3::new(*x, *y, *z),
            radius,
        })
    }

    fn magnitude(&self) -> f64 {
        1.0 + self.radius
    }
}

fn linear_local(cloud: &Cloud<'_>) -> Result<Ball, FitError> {
    // |q|² = 2 c·q + h with h = r² - |c|².
    let mut qr = Qr::<4>::new();
    for q in cloud.local() {
        qr.add([2.0 * q.x, 2.0 * q.y, 2.0 * q.z, 1.0], q.dot(&q));
    }
    let [x, y, z, h] = qr.triangle().solve().ok_or_else(limits::flat)?;
    let center = Vector3::new(x, y, z);
    let radius = libm::sqrt(h + center.dot(&center));
    // Also false for NaN.
    if radius > 0.0 && radius < limits::FLAT {
        Ok(Ball { center, radius })
    } else {
        Err(limits::flat())
    }
}
