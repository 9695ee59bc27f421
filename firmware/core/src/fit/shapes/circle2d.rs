//! Circle in a known plane: centre and radius from two coordinates.

use nalgebra::Vector3;

use crate::fit::solve::cloud::Cloud;
use crate::fit::solve::least_squares::{Minimum, Surface, Term, minimise};
use crate::fit::solve::linalg::{Qr, Square};
use crate::fit::{Degeneracy, FitError, PointSet, Quantity, SPREAD_LIMIT, Statistics, limits};
use crate::units::{Mm, Point};

/// Points that a circle needs.
pub const MIN_POINTS: usize = 3;

/// A circle in the XY plane, fitted by orthogonal least squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle2dFit {
    /// Centre x.
    pub center_x: Mm,
    /// Centre y.
    pub center_y: Mm,
    /// Radius.
    pub radius: Mm,
    /// Statistics of the residuals; `dof` is n - 3.
    pub stats: Statistics,
    /// `inv(JᵀJ)`: covariance for unit noise in the order centre x, y, radius.
    pub cov_unit: [[f64; 3]; 3],
}

/// Fits a circle to x and y of the points and leaves z aside, as for the hits
/// in a ring gauge.
///
/// # Errors
/// * `too_few_points` below three points, `not_finite`, `degenerate` for points
///   that are collinear in the plane;
/// * `cap_too_small` if the arc says too little about the radius,
///   `ill_conditioned` if too little about the centre (see
///   [`crate::fit::MAX_RELATIVE_UNCERTAINTY`] and [`crate::fit::MAX_CONDITION`]);
/// * `no_convergence` if no minimum was found.
pub fn fit(points: &[Point]) -> Result<Circle2dFit, FitError> {
    let cloud = Cloud::new(points, PointSet::Points, MIN_POINTS)?;
    let frame = InPlane {
        e1: Vector3::new(1.0, 0.0, 0.0),
        e2: Vector3::new(0.0, 1.0, 0.0),
    };
    let (disc, stats, cov_unit) = fit_disc(&cloud, &frame)?;
    let center = cloud.point_at(&Vector3::new(disc.x, disc.y, 0.0)).mm;
    Ok(Circle2dFit {
        center_x: Mm(center.x),
        center_y: Mm(center.y),
        radius: cloud.mm(disc.radius),
        stats,
        cov_unit,
    })
}

impl Circle2dFit {
    /// Distance of a point from the circle in the plane, positive outside.
    #[must_use]
    pub fn residual(&self, p: Point) -> Mm {
        let (x, y) = (p.mm.x - self.center_x.0, p.mm.y - self.center_y.0);
        Mm(libm::sqrt(x * x + y * y) - self.radius.0)
    }

    /// Covariance in the order centre x, y, radius, mm².
    #[must_use]
    pub fn cov(&self) -> Option<[[f64; 3]; 3]> {
        self.stats.covariance(&self.cov_unit)
    }

    /// Standard uncertainties of centre x, centre y and radius.
    #[must_use]
    pub fn uncertainty(&self) -> Option<[Mm; 3]> {
        self.stats.uncertainties(&self.cov_unit).map(|u| u.map(Mm))
    }
}

/// Two orthonormal directions that span a plane.
pub(crate) struct InPlane {
    pub(crate) e1: Vector3<f64>,
    pub(crate) e2: Vector3<f64>,
}

/// A circle in the local coordinates of a plane through the centroid.
#[derive(Clone, Copy)]
pub(crate) struct Disc {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) radius: f64,
}

/// The circle fit in the plane through the centroid of the points.
pub(crate) fn fit_disc(
    cloud: &Cloud<'_>,
    plane: &InPlane,
) -> Result<(Disc, Statistics, Square<3>), FitError> {
    let (e1, e2) = (plane.e1, plane.e2);
    let flat_points = cloud
        .local()
        .map(move |q| Vector3::new(e1.dot(&q), e2.dot(&q), 0.0));
    require_width(cloud, flat_points.clone())?;

    let start = Disc::linear(flat_points.clone()).ok_or_else(limits::flat)?;
    let Minimum { surface, cov_unit } = minimise(start, &flat_points)
        .map_err(|stopped| limits::stopped(&stopped, stopped.surface.radius))?;
    let stats = Statistics::new(
        flat_points.map(|q| cloud.mm(surface.distance(&q)).0),
        cloud.len() - MIN_POINTS,
        cloud.rounding(),
    );
    let radius = cloud.mm(surface.radius).0;
    let [[xx, xy, _], [_, yy, _], [.., rr]] = cov_unit;
    let half = 0.5 * (xx - yy);
    let center_variance = 0.5 * (xx + yy) + libm::sqrt(half * half + xy * xy);
    limits::curved(&stats, rr, radius)?;
    limits::uncertain(&stats, Quantity::Center, center_variance, radius)?;
    limits::conditioned(Quantity::Radius, rr)?;
    limits::conditioned(Quantity::Center, center_variance)?;
    Ok((surface, stats, cov_unit))
}

/// Refuses points that are one point or collinear once z is left aside.
fn require_width(
    cloud: &Cloud<'_>,
    flat_points: impl Iterator<Item = Vector3<f64>>,
) -> Result<(), FitError> {
    let mut qr = Qr::<3>::new();
    for q in flat_points {
        qr.add([q.x, q.y, 0.0], 0.0);
    }
    let [long, wide, _] = qr.triangle().svd().values;
    let floor = cloud.spread_floor();
    let why = if long <= floor {
        Degeneracy::Coincident
    } else if wide <= SPREAD_LIMIT * long || wide <= floor {
        Degeneracy::Collinear
    } else {
        return Ok(());
    };
    Err(FitError::Degenerate {
        set: PointSet::Points,
        why,
    })
}

impl Disc {
    /// The linear (Kasa) start value.
    fn linear(points: impl Iterator<Item = Vector3<f64>>) -> Option<Self> {
        let mut qr = Qr::<3>::new();
        for q in points {
            qr.add([2.0 * q.x, 2.0 * q.y, 1.0], q.x * q.x + q.y * q.y);
        }
        let [x, y, h] = qr.triangle().solve()?;
        let radius = libm::sqrt(h + x * x + y * y);
        (radius > 0.0 && radius < limits::FLAT).then_some(Self { x, y, radius })
    }

    fn distance(&self, q: &Vector3<f64>) -> f64 {
        let (x, y) = (q.x - self.x, q.y - self.y);
        libm::sqrt(x * x + y * y) - self.radius
    }
}

impl Surface<3> for Disc {
    fn term(&self, q: &Vector3<f64>) -> Option<Term<3>> {
        let (x, y) = (q.x - self.x, q.y - self.y);
        let distance = libm::sqrt(x * x + y * y);
        let inverse = 1.0 / distance;
        if !inverse.is_finite() {
            return None;
        }
        // As the sphere in one dimension less: ∇²d = (I - u uᵀ) / |v|.
        let (ux, uy) = (x * inverse, y * inverse);
        Some(Term {
            residual: distance - self.radius,
            gradient: [-ux, -uy, -1.0],
            second: [
                [uy * uy * inverse, 0.0, 0.0],
                [-ux * uy * inverse, ux * ux * inverse, 0.0],
                [0.0; 3],
            ],
        })
    }

    fn moved(&self, [x, y, r]: &[f64; 3]) -> Option<Self> {
        let radius = self.radius + r;
        (radius > 0.0 && radius < limits::FLAT).then(|| Self {
            x: self.x + x,
            y: self.y + y,
            radius,
        })
    }

    fn magnitude(&self) -> f64 {
        1.0 + self.radius
    }
}
