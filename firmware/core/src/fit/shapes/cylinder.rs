//! Cylinder: axis and radius.

use nalgebra::Vector3;

use crate::fit::solve::axis::Axis;
use crate::fit::solve::axis_search::{Axial, search, search_near};
use crate::fit::solve::cloud::Cloud;
use crate::fit::solve::least_squares::{Minimum, Surface, Term, minimise};
use crate::fit::solve::linalg::{
    Cholesky, added, canonical_sign, largest_variance, norm, propagate,
};
use crate::fit::{FitError, PointSet, Quantity, Statistics, limits};
use crate::units::{Mm, Point};

/// Points that a cylinder needs.
pub const MIN_POINTS: usize = 5;

/// A cylinder fitted by orthogonal least squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CylinderFit {
    /// Foot of the centroid of the points on the axis.
    pub point: Point,
    /// Unit direction of the axis; its largest component is positive.
    pub direction: Vector3<f64>,
    /// Radius.
    pub radius: Mm,
    /// Statistics of the residuals; `dof` is n - 5.
    pub stats: Statistics,
    /// Covariance of `point` across the axis for unit noise, rank 2.
    pub cov_unit_point: [[f64; 3]; 3],
    /// Covariance of the direction for unit noise, 1/mm², rank 2.
    pub cov_unit_direction: [[f64; 3]; 3],
    /// Variance of the radius for unit noise.
    pub var_unit_radius: f64,
}

/// Fits a cylinder; finds its axis by itself.
///
/// # Errors
/// * `too_few_points` below five points, `not_finite`, `degenerate` for coplanar
///   or collinear points;
/// * `cap_too_small` if the arc says too little about the radius;
/// * `ill_conditioned` if the points say too little about axis or radius, or if
///   cylinders in different directions fit about as well (eight corners of a box
///   lie on three; five points always lie on several): then [`fit_near`] helps;
/// * `no_convergence` if no minimum was found.
pub fn fit(points: &[Point]) -> Result<CylinderFit, FitError> {
    let cloud = Cloud::new(points, PointSet::Points, MIN_POINTS)?;
    let spread = cloud.spread();
    spread.require_space()?;
    fit_from(&cloud, search(&cloud, &spread)?)
}

/// Fits the best cylinder whose axis is within 30 degrees of a nominal direction
/// (any length, either sense). For a hint off by less than 10 degrees, 5 for
/// partial arcs, it is what [`fit`] finds.
///
/// # Errors
/// As [`fit`], but only another answer within those 30 degrees makes it
/// ambiguous; `degenerate` if `direction` has no length; `no_convergence` if there
/// is no minimum in that range.
pub fn fit_near(points: &[Point], direction: &Vector3<f64>) -> Result<CylinderFit, FitError> {
    let cloud = Cloud::new(points, PointSet::Points, MIN_POINTS)?;
    cloud.spread().require_space()?;
    fit_from(&cloud, search_near(&cloud, direction)?)
}

fn fit_from(cloud: &Cloud<'_>, start: Tube) -> Result<CylinderFit, FitError> {
    let Minimum {
        surface: Tube { axis, radius },
        cov_unit,
    } = minimise(start, &cloud.sample(usize::MAX))
        .map_err(|stopped| limits::stopped(&stopped, stopped.surface.radius))?;
    let surface = Tube { axis, radius };
    let stats = Statistics::new(
        cloud.local().map(|q| cloud.mm(surface.distance(&q)).0),
        cloud.len() - MIN_POINTS,
        cloud.rounding(),
    );
    let (e1, e2) = (axis.e1, axis.e2);
    // Steps (a, b) shift the foot, (α, β) tilt the direction, along (e1, e2).
    let shift = [e1.x, e2.x, 0.0, 0.0, 0.0];
    let cov_unit_point = propagate(
        &[
            shift,
            [e1.y, e2.y, 0.0, 0.0, 0.0],
            [e1.z, e2.z, 0.0, 0.0, 0.0],
        ],
        &cov_unit,
    );
    let per_mm = 1.0 / cloud.scale();
    let tilt = |x: f64, y: f64| [0.0, 0.0, x * per_mm, y * per_mm, 0.0];
    let cov_unit_direction = propagate(
        &[tilt(e1.x, e2.x), tilt(e1.y, e2.y), tilt(e1.z, e2.z)],
        &cov_unit,
    );
    let [.., [.., var_unit_radius]] = cov_unit;
    let result = CylinderFit {
        point: cloud.point_at(&axis.foot),
        direction: canonical_sign(&axis.direction),
        radius: cloud.mm(radius),
        stats,
        cov_unit_point,
        cov_unit_direction,
        var_unit_radius,
    };
    result.check(cloud.scale())?;
    Ok(result)
}

impl CylinderFit {
    /// Distance of a point from the surface, positive outside.
    #[must_use]
    pub fn residual(&self, p: Point) -> Mm {
        let v = p.mm - self.point.mm;
        Mm(norm(&(v - self.direction * self.direction.dot(&v))) - self.radius.0)
    }

    /// Covariance of `point` across the axis, mm².
    #[must_use]
    pub fn cov_point(&self) -> Option<[[f64; 3]; 3]> {
        self.stats.covariance(&self.cov_unit_point)
    }

    /// Covariance of the direction, dimensionless.
    #[must_use]
    pub fn cov_direction(&self) -> Option<[[f64; 3]; 3]> {
        self.stats.covariance(&self.cov_unit_direction)
    }

    /// Variance of the radius, mm².
    #[must_use]
    pub fn var_radius(&self) -> Option<f64> {
        self.stats
            .variance_mm2()
            .map(|variance| variance * self.var_unit_radius)
    }

    /// Standard uncertainties of x, y and z of `point` across the axis.
    #[must_use]
    pub fn point_uncertainty(&self) -> Option<[Mm; 3]> {
        self.stats
            .uncertainties(&self.cov_unit_point)
            .map(|u| u.map(Mm))
    }

    /// Standard uncertainties of the direction's x, y and z (radians).
    #[must_use]
    pub fn direction_uncertainty(&self) -> Option<[f64; 3]> {
        self.stats.uncertainties(&self.cov_unit_direction)
    }

    /// Standard uncertainty of the radius.
    #[must_use]
    pub fn radius_uncertainty(&self) -> Option<Mm> {
        self.stats
            .standard_uncertainty(self.var_unit_radius)
            .map(Mm)
    }

    fn check(&self, extent: f64) -> Result<(), FitError> {
        let radius = self.radius.0;
        let position = largest_variance(&self.cov_unit_point);
        let direction = largest_variance(&self.cov_unit_direction);
        limits::curved(&self.stats, self.var_unit_radius, radius)?;
        limits::uncertain(&self.stats, Quantity::Position, position, radius)?;
        limits::uncertain(&self.stats, Quantity::Direction, direction, 1.0)?;
        limits::conditioned(Quantity::Radius, self.var_unit_radius)?;
        limits::conditioned(Quantity::Position, position)?;
        limits::conditioned(Quantity::Direction, direction * extent * extent)
    }
}

/// A cylinder in local coordinates.
#[derive(Clone, Copy)]
struct Tube {
    axis: Axis,
    radius: f64,
}

impl Tube {
    fn distance(&self, q: &Vector3<f64>) -> f64 {
        let [x, y, _] = self.axis.coordinates(q);
        libm::sqrt(x * x + y * y) - self.radius
    }
}

impl Surface<5> for Tube {
    fn term(&self, q: &Vector3<f64>) -> Option<Term<5>> {
        let term = self.axis.term(q)?;
        let [a, b, c, d] = term.away_gradient;
        let [r0, r1, r2, r3] = term.away_second.map(|[a, b, c, d]| [a, b, c, d, 0.0]);
        Some(Term {
            residual: term.away - self.radius,
            gradient: [a, b, c, d, -1.0],
            second: [r0, r1, r2, r3, [0.0; 5]],
        })
    }

    fn moved(&self, [a, b, alpha, beta, r]: &[f64; 5]) -> Option<Self> {
        let (axis, _) = self.axis.moved([*a, *b, *alpha, *beta])?;
        let radius = self.radius + r;
        (radius > 0.0 && radius < limits::FLAT).then_some(Self { axis, radius })
    }

    fn magnitude(&self) -> f64 {
        1.0 + self.radius
    }
}

impl Axial<5> for Tube {
    fn guess<I>(direction: &Vector3<f64>, points: &I) -> Option<(Self, f64)>
    where
        I: Iterator<Item = Vector3<f64>> + Clone,
    {
        // Across the axis the cylinder is a circle; its linear problem by normal
        // equations, good enough for a start.
        let across = Axis::new(&Vector3::zeros(), direction)?;
        let mut gram = [[0.0; 3]; 3];
        let mut right = [0.0; 3];
        for q in points.clone() {
            let [x, y, _] = across.coordinates(&q);
            let square = x * x + y * y;
            gram = added(&gram, &[x, y, 1.0]);
            let [rx, ry, r1] = &mut right;
            *rx += x * square;
            *ry += y * square;
            *r1 += square;
        }
        let [x, y, h] = Cholesky::new(&gram)?.solve(&right);
        let (x, y) = (0.5 * x, 0.5 * y);
        let radius = libm::sqrt(h + x * x + y * y);
        if !(radius > 0.0 && radius < limits::FLAT) {
            return None;
        }
        let axis = Axis {
            foot: across.e1 * x + across.e2 * y,
            ..across
        };
        let tube = Self { axis, radius };
        let sum = points.clone().fold(0.0, |sum, q| {
            let d = tube.distance(&q);
            sum + d * d
        });
        Some((tube, sum))
    }

    fn axis(&self) -> &Axis {
        &self.axis
    }

    fn agrees(&self, other: &Self) -> bool {
        self.axis.agrees(&other.axis)
    }
}
