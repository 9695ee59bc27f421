//! Cone: apex, axis and half angle.

use nalgebra::Vector3;

use crate::fit::solve::axis::Axis;
use crate::fit::solve::axis_search::{Axial, search, search_near};
use crate::fit::solve::cloud::{Cloud, count};
use crate::fit::solve::least_squares::{Minimum, Surface, Term, minimise};
use crate::fit::solve::linalg::{Cholesky, added, largest_variance, norm, propagate, ridged};
use crate::fit::{FitError, PointSet, Quantity, Statistics, limits};
use crate::units::{Mm, Point, Rad};

/// Points that a cone needs.
pub const MIN_POINTS: usize = 6;

/// A cone fitted by orthogonal least squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConeFit {
    /// Apex.
    pub apex: Point,
    /// Unit direction of the axis, from the apex into the points.
    pub direction: Vector3<f64>,
    /// Half of the opening angle, between 0 and π/2.
    pub half_angle: Rad,
    /// Foot of the centroid of the points on the axis.
    pub point: Point,
    /// Radius of the cone at `point`, across the axis.
    pub radius_at_point: Mm,
    /// Statistics of the residuals; `dof` is n - 6.
    pub stats: Statistics,
    /// Covariance of the apex for unit noise.
    pub cov_unit_apex: [[f64; 3]; 3],
    /// Covariance of the direction for unit noise, 1/mm², rank 2.
    pub cov_unit_direction: [[f64; 3]; 3],
    /// Variance of the half angle for unit noise, 1/mm².
    pub var_unit_half_angle: f64,
}

/// Fits a cone; finds its axis by itself.
///
/// # Errors
/// * `too_few_points` below six points, `not_finite`, `degenerate` for coplanar
///   or collinear points;
/// * `ill_conditioned` if the half angle cannot be told from 0 (a cylinder) or
///   π/2 (a plane), if the points say too little about apex or axis, or if
///   different cones fit about as well: then [`fit_near`] helps;
/// * `no_convergence` if no minimum was found.
pub fn fit(points: &[Point]) -> Result<ConeFit, FitError> {
    let cloud = Cloud::new(points, PointSet::Points, MIN_POINTS)?;
    let spread = cloud.spread();
    spread.require_space()?;
    fit_from(&cloud, search(&cloud, &spread)?)
}

/// Fits the best cone whose axis is within 30 degrees of a nominal direction (any
/// length, either sense). For a hint off by less than 5 degrees it is what [`fit`]
/// finds.
///
/// # Errors
/// As [`fit`], but only another answer within those 30 degrees makes it
/// ambiguous; `degenerate` if `direction` has no length; `no_convergence` if there
/// is no minimum in that range.
pub fn fit_near(points: &[Point], direction: &Vector3<f64>) -> Result<ConeFit, FitError> {
    let cloud = Cloud::new(points, PointSet::Points, MIN_POINTS)?;
    cloud.spread().require_space()?;
    fit_from(&cloud, search_near(&cloud, direction)?)
}

fn fit_from(cloud: &Cloud<'_>, start: Funnel) -> Result<ConeFit, FitError> {
    let Minimum { surface, cov_unit } =
        minimise(start, &cloud.sample(usize::MAX)).map_err(|stopped| FitError::NoConvergence {
            iterations: stopped.iterations,
        })?;
    let funnel = surface.opening_forward();
    let stats = Statistics::new(
        cloud.local().map(|q| cloud.mm(funnel.distance(&q)).0),
        cloud.len() - MIN_POINTS,
        cloud.rounding(),
    );
    let per_mm = 1.0 / cloud.scale();
    let [.., [.., half_angle_variance, _], _] = cov_unit;
    let var_unit_half_angle = half_angle_variance * per_mm * per_mm;
    let open = funnel
        .half_angle
        .min(core::f64::consts::FRAC_PI_2 - funnel.half_angle);
    limits::uncertain(&stats, Quantity::HalfAngle, var_unit_half_angle, open)?;

    // The apex of the fitted surface lies `apex_along` (signed) from its foot:
    // minus the offset over the sine.
    let Funnel {
        axis: Axis {
            e1, e2, direction, ..
        },
        half_angle,
        offset,
    } = surface;
    let sine = libm::sin(half_angle);
    let apex_along = -offset / sine;
    limits::conditioned(Quantity::Apex, apex_along * apex_along)?;
    // Its derivatives by the steps (a, b, α, β, h, offset).
    let by_angle = -apex_along * libm::cos(half_angle) / sine;
    let row = |e1: f64, e2: f64, w: f64| {
        [
            e1,
            e2,
            e1 * apex_along,
            e2 * apex_along,
            w * by_angle,
            -w / sine,
        ]
    };
    let cov_unit_apex = propagate(
        &[
            row(e1.x, e2.x, direction.x),
            row(e1.y, e2.y, direction.y),
            row(e1.z, e2.z, direction.z),
        ],
        &cov_unit,
    );
    let tilt = |x: f64, y: f64| [0.0, 0.0, x * per_mm, y * per_mm, 0.0, 0.0];
    let cov_unit_direction = propagate(
        &[tilt(e1.x, e2.x), tilt(e1.y, e2.y), tilt(e1.z, e2.z)],
        &cov_unit,
    );

    let foot = funnel.axis.foot;
    let result = ConeFit {
        apex: cloud.point_at(&(foot + direction * apex_along)),
        direction: funnel.axis.direction,
        half_angle: Rad(funnel.half_angle),
        point: cloud.point_at(&foot),
        radius_at_point: cloud.mm(funnel.offset / libm::cos(funnel.half_angle)),
        stats,
        cov_unit_apex,
        cov_unit_direction,
        var_unit_half_angle,
    };
    result.check(cloud.scale())?;
    Ok(result)
}

impl ConeFit {
    /// Distance of a point from the surface, `rho cos h - t sin h`, positive
    /// outside.
    #[must_use]
    pub fn residual(&self, p: Point) -> Mm {
        // From the foot and not the apex, which may be far away.
        let v = p.mm - self.point.mm;
        let along = self.direction.dot(&v);
        let away = norm(&(v - self.direction * along));
        let (sine, cosine) = (libm::sin(self.half_angle.0), libm::cos(self.half_angle.0));
        Mm((away - self.radius_at_point.0) * cosine - along * sine)
    }

    /// Covariance of the apex, mm².
    #[must_use]
    pub fn cov_apex(&self) -> Option<[[f64; 3]; 3]> {
        self.stats.covariance(&self.cov_unit_apex)
    }

    /// Covariance of the direction, dimensionless.
    #[must_use]
    pub fn cov_direction(&self) -> Option<[[f64; 3]; 3]> {
        self.stats.covariance(&self.cov_unit_direction)
    }

    /// Variance of the half angle, rad².
    #[must_use]
    pub fn var_half_angle(&self) -> Option<f64> {
        self.stats
            .variance_mm2()
            .map(|variance| variance * self.var_unit_half_angle)
    }

    /// Standard uncertainties of the direction's x, y and z (radians).
    #[must_use]
    pub fn direction_uncertainty(&self) -> Option<[f64; 3]> {
        self.stats.uncertainties(&self.cov_unit_direction)
    }

    fn check(&self, extent: f64) -> Result<(), FitError> {
        let direction = largest_variance(&self.cov_unit_direction);
        limits::uncertain(&self.stats, Quantity::Direction, direction, 1.0)?;
        limits::conditioned(Quantity::Direction, direction * extent * extent)?;
        limits::conditioned(
            Quantity::HalfAngle,
            self.var_unit_half_angle * extent * extent,
        )?;
        limits::conditioned(Quantity::Apex, largest_variance(&self.cov_unit_apex))
    }
}

/// A cone in local coordinates, described at the foot of the centroid so that a
/// slender one is as well behaved as a wide one:
/// `d = away cos(h) - along sin(h) - offset`.
#[derive(Clone, Copy)]
struct Funnel {
    axis: Axis,
    /// Opens along the axis if positive, against it if negative.
    half_angle: f64,
    /// Distance of the foot from the surface, `radius cos(h)`.
    offset: f64,
}

impl Funnel {
    fn distance(&self, q: &Vector3<f64>) -> f64 {
        let [x, y, z] = self.axis.coordinates(q);
        let away = libm::sqrt(x * x + y * y);
        away * libm::cos(self.half_angle) - z * libm::sin(self.half_angle) - self.offset
    }

    /// The same cone with the axis from the apex into the points.
    fn opening_forward(&self) -> Self {
        if self.half_angle < 0.0 {
            Self {
                axis: self.axis.reversed(),
                half_angle: -self.half_angle,
                ..*self
            }
        } else {
            *self
        }
    }
}

impl Surface<6> for Funnel {
    fn term(&self, q: &Vector3<f64>) -> Option<Term<6>> {
        let term = self.axis.term(q)?;
        let (s, c) = (libm::sin(self.half_angle), libm::cos(self.half_angle));
        let [ra, rb, rc, rd] = term.away_gradient;
        let [za, zb, zc, zd] = term.along_gradient;
        let first = |r: f64, z: f64| r * c - z * s;
        // d/dh of the first derivatives.
        let turned = |r: f64, z: f64| -r * s - z * c;
        let row = |[ra, rb, rc, rd]: [f64; 4], [za, zb, zc, zd]: [f64; 4]| {
            [
                first(ra, za),
                first(rb, zb),
                first(rc, zc),
                first(rd, zd),
                0.0,
                0.0,
            ]
        };
        let [r0, r1, r2, r3] = term.away_second;
        let [z0, z1, z2, z3] = term.along_second;
        Some(Term {
            residual: first(term.away, term.along) - self.offset,
            gradient: [
                first(ra, za),
                first(rb, zb),
                first(rc, zc),
                first(rd, zd),
                turned(term.away, term.along),
                -1.0,
            ],
            second: [
                row(r0, z0),
                row(r1, z1),
                row(r2, z2),
                row(r3, z3),
                [
                    turned(ra, za),
                    turned(rb, zb),
                    turned(rc, zc),
                    turned(rd, zd),
                    -first(term.away, term.along),
                    0.0,
                ],
                [0.0; 6],
            ],
        })
    }

    fn moved(&self, [a, b, alpha, beta, h, s]: &[f64; 6]) -> Option<Self> {
        let half_angle = self.half_angle + h;
        // Beyond a right angle the cone is turned inside out.
        if half_angle.abs() >= core::f64::consts::FRAC_PI_2 {
            return None;
        }
        let (axis, slid) = self.axis.moved([*a, *b, *alpha, *beta])?;
        let offset = self.offset + s + slid * libm::sin(half_angle);
        (offset > 0.0 && offset < limits::FLAT).then_some(Self {
            axis,
            half_angle,
            offset,
        })
    }

    fn magnitude(&self) -> f64 {
        1.0 + self.offset
    }
}

impl Axial<6> for Funnel {
    fn guess<I>(direction: &Vector3<f64>, points: &I) -> Option<(Self, f64)>
    where
        I: Iterator<Item = Vector3<f64>> + Clone,
    {
        // With the direction held, away² is a linear combination of x, y, 1, z
        // and z². It gives the position of the axis; two rings leave z² open, so
        // the equations carry a small ridge. A straight line through
        // away over along then gives radius and slope.
        let across = Axis::new(&Vector3::zeros(), direction)?;
        let mut gram = [[0.0; 5]; 5];
        let mut right = [0.0; 5];
        for q in points.clone() {
            let [x, y, z] = across.coordinates(&q);
            let square = x * x + y * y;
            let row = [x, y, 1.0, z, z * z];
            gram = added(&gram, &row);
            for (sum, value) in right.iter_mut().zip(row) {
                *sum += value * square;
            }
        }
        let [x, y, ..] = Cholesky::new(&ridged(&gram, 1e-9))?.solve(&right);
        let axis = Axis {
            foot: across.e1 * (0.5 * x) + across.e2 * (0.5 * y),
            ..across
        };

        let (mut n, mut radius, mut zr, mut zz) = (0_usize, 0.0, 0.0, 0.0);
        for q in points.clone() {
            let [x, y, z] = axis.coordinates(&q);
            let away = libm::sqrt(x * x + y * y);
            n = n.saturating_add(1);
            radius += away;
            zr += z * away;
            zz += z * z;
        }
        // The centroid is at z = 0 (of a sample: nearly), so the sums separate.
        let radius = radius / count(n.max(1));
        let half_angle = if zz > 0.0 { libm::atan(zr / zz) } else { 0.0 };
        let offset = radius * libm::cos(half_angle);
        if !(offset > 0.0 && offset < limits::FLAT) {
            return None;
        }
        let funnel = Self {
            axis,
            half_angle,
            offset,
        };
        let sum = points.clone().fold(0.0, |sum, q| {
            let d = funnel.distance(&q);
            sum + d * d
        });
        Some((funnel, sum))
    }

    fn axis(&self) -> &Axis {
        &self.axis
    }

    fn agrees(&self, other: &Self) -> bool {
        let (one, other) = (self.opening_forward().axis, other.opening_forward().axis);
        one.agrees(&other) && one.direction.dot(&other.direction) > 0.0
    }
}
