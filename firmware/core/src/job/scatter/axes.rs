//! Hits that scatter by another sigma along each axis: what their fits carry of it.

use nalgebra::{Matrix3, Vector3};
use umi_protocol::feature::{FitReport, Shape};

use crate::fit::solve::linalg::{Qr, Square, perpendicular_frame};

/// What is stated of each axis, and what each has its part in.
#[derive(Clone, Copy, Debug)]
pub struct ByAxis {
    /// Variances of a hit along X, Y and Z, mm².
    hit: Vector3<f64>,
    /// What the control's step adds along any normal, mm².
    step: f64,
    /// Degrees of freedom of each of these variances.
    dof: f64,
    /// Degrees of freedom of all residuals, and each axis' part in them.
    residuals: f64,
    of_residuals: Vector3<f64>,
    /// Sum of the places' variances, mm², and each axis' part in it.
    places: f64,
    of_places: Vector3<f64>,
}

impl ByAxis {
    pub fn new(sigma_mm: [f64; 3], step: f64, dof: f64) -> Self {
        Self {
            hit: sigma_mm.map(|sigma_mm| sigma_mm * sigma_mm).into(),
            step,
            dof,
            residuals: 0.0,
            of_residuals: Vector3::zeros(),
            places: 0.0,
            of_places: Vector3::zeros(),
        }
    }

    /// A place counts: its covariance, and each axis' part in the trace of it.
    pub fn place(&mut self, place: &Matrix3<f64>, of_axis: &Vector3<f64>) {
        self.places += place.trace();
        self.of_places += of_axis;
    }

    /// A fit's residuals count.
    pub fn residuals(&mut self, carried: &CarriedScatter) {
        self.residuals += carried.dof;
        self.of_residuals += carried.of_squares * (carried.dof / carried.squares);
    }

    /// Degrees of freedom of the places' variances, where the factor of all has rested on so many.
    pub fn dof(&self, pooled: f64) -> f64 {
        let known = self.of_places / self.places - self.of_residuals / pooled;
        1.0 / (known.norm_squared() / self.dof + self.residuals / (pooled * pooled))
    }
}

/// What a fit carries of its hits, each of them with the stated variance.
#[derive(Clone, Copy, Debug)]
pub struct CarriedScatter {
    /// The covariance of its place, mm².
    pub place: Matrix3<f64>,
    /// What each axis has of its trace.
    pub of_place: Vector3<f64>,
    /// The sum of the residuals' squares that is expected, mm².
    pub squares: f64,
    /// What each axis has of it.
    pub of_squares: Vector3<f64>,
    /// Degrees of freedom of that sum.
    pub dof: f64,
}

/// By its hits; none where it has no place.
#[inline(never)]
pub fn carried(fit: &FitReport, points: &[[f64; 3]], axes: &ByAxis) -> Option<CarriedScatter> {
    match &fit.shape {
        Shape::Sphere {
            center_mm,
            cov_unit,
            ..
        } => Some(round(center_mm, &Vector3::zeros(), cov_unit, points, axes)),
        Shape::Circle {
            center_mm,
            normal,
            cov_unit,
            ..
        } => {
            let normal = Vector3::from(*normal);
            Some(round(center_mm, &normal, cov_unit, points, axes))
        }
        Shape::Cone {
            apex_mm,
            direction,
            half_angle_rad,
            ..
        } => Cone::new(apex_mm, direction, *half_angle_rad, points).carried(points, axes),
        _ => None,
    }
}

/// Of a sphere, or of a circle across `axis`: a residual goes with the centre and with the radius.
#[inline(never)]
fn round(
    center: &[f64; 3],
    axis: &Vector3<f64>,
    unit: &Square<4>,
    points: &[[f64; 3]],
    axes: &ByAxis,
) -> CarriedScatter {
    // As if the parameters that only a cone has did nothing.
    let mut wide = [[0.0; 6]; 6];
    for (wide, row) in wide.iter_mut().zip(unit) {
        for (wide, value) in wide.iter_mut().zip(row) {
            *wide = *value;
        }
    }
    let zero = Vector3::zeros();
    let to_place = [Vector3::x(), Vector3::y(), Vector3::z(), zero, zero, zero];
    let mut sums = Sums::new(axes);
    for point in points {
        let arm = Vector3::from(*point) - Vector3::from(*center);
        let arm = arm - axis * axis.dot(&arm);
        let normal = arm / libm::sqrt(arm.norm_squared());
        let row = [normal.x, normal.y, normal.z, 1.0, 0.0, 0.0];
        sums.add(&wide, &normal, &row, &to_place);
    }
    sums.carried()
}

/// A cone, as its hits see it.
struct Cone {
    apex: Vector3<f64>,
    direction: Vector3<f64>,
    e1: Vector3<f64>,
    e2: Vector3<f64>,
    sine: f64,
    cosine: f64,
    /// The hits along the surface, from the apex: their mean, and how far they are from it.
    mean: f64,
    spread: f64,
}

impl Cone {
    #[inline(never)]
    fn new(apex: &[f64; 3], direction: &[f64; 3], half_angle: f64, points: &[[f64; 3]]) -> Self {
        let direction = Vector3::from(*direction);
        let (e1, e2) = perpendicular_frame(&direction);
        let (sine, cosine) = libm::sincos(half_angle);
        let mut cone = Self {
            apex: Vector3::from(*apex),
            direction,
            e1,
            e2,
            sine,
            cosine,
            mean: 0.0,
            spread: 1.0,
        };
        let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for point in points {
            let (_, along) = cone.out_and_along(point);
            count += 1.0;
            sum += along;
            squares += along * along;
        }
        cone.mean = sum / count;
        cone.spread = libm::sqrt(squares / count - cone.mean * cone.mean);
        cone
    }

    /// Outward across the axis, of length 1, and how far from the apex along the surface.
    fn out_and_along(&self, point: &[f64; 3]) -> (Vector3<f64>, f64) {
        let arm = Vector3::from(*point) - self.apex;
        let height = arm.dot(&self.direction);
        let out = arm - self.direction * height;
        let away = libm::sqrt(out.norm_squared());
        (out / away, height * self.cosine + away * self.sine)
    }

    /// A hit's normal, and what its residual goes with. With u and v outward across the axis and m
    /// how far the hit is from the mean along the surface that is u, v, 1, m u, m v, m: they depend
    /// on each other least so.
    fn row(&self, point: &[f64; 3]) -> (Vector3<f64>, [f64; 6]) {
        let (out, along) = self.out_and_along(point);
        let m = (along - self.mean) / self.spread;
        let (u, v) = (out.dot(&self.e1), out.dot(&self.e2));
        let normal = out * self.cosine - self.direction * self.sine;
        (normal, [u, v, 1.0, m * u, m * v, m])
    }

    /// By what the apex moves with each of them. A move a of it, a tilt t of the axis and an opening o are
    /// u: a₁ cos + mean t₁, v: a₂ cos + mean t₂, 1: mean o - a₃ sin, m u: t₁ spread, m v: t₂ spread,
    /// m: o spread.
    fn to_apex(&self) -> [Vector3<f64>; 6] {
        let back = -self.mean / self.spread;
        let (u, v) = (self.e1 / self.cosine, self.e2 / self.cosine);
        let one = -self.direction / self.sine;
        [u, v, one, u * back, v * back, one * back]
    }

    #[inline(never)]
    fn unit(&self, points: &[[f64; 3]]) -> Option<Square<6>> {
        let mut qr = Qr::<6>::new();
        for point in points {
            qr.add(self.row(point).1, 0.0);
        }
        qr.triangle().inverse_gram()
    }

    #[inline(never)]
    fn carried(&self, points: &[[f64; 3]], axes: &ByAxis) -> Option<CarriedScatter> {
        let unit = self.unit(points)?;
        let (mut sums, to_apex) = (Sums::new(axes), self.to_apex());
        for point in points {
            let (normal, row) = self.row(point);
            sums.add(&unit, &normal, &row, &to_apex);
        }
        Some(sums.carried())
    }
}

/// With V the hits' variances, J the rows and A the unit covariance of a fit, hit by hit.
struct Sums<'a> {
    axes: &'a ByAxis,
    /// `A Jᵀ V J`
    inner: Square<6>,
    /// `tr(V²) - 2 tr(H V²)`, with `H = J A Jᵀ`.
    pairs: f64,
    /// Its squares are `tr((I-H) V)`.
    carried: CarriedScatter,
}

impl<'a> Sums<'a> {
    fn new(axes: &'a ByAxis) -> Self {
        Self {
            axes,
            inner: [[0.0; 6]; 6],
            pairs: 0.0,
            carried: CarriedScatter {
                place: Matrix3::zeros(),
                of_place: Vector3::zeros(),
                squares: 0.0,
                of_squares: Vector3::zeros(),
                dof: 0.0,
            },
        }
    }

    /// `to_place`: what each parameter moves the place by.
    #[inline(never)]
    fn add(
        &mut self,
        unit: &Square<6>,
        normal: &Vector3<f64>,
        row: &[f64; 6],
        to_place: &[Vector3<f64>; 6],
    ) {
        let of_axis = normal.component_mul(normal).component_mul(&self.axes.hit);
        let variance = of_axis.sum() + self.axes.step;
        // What the parameters follow of an error of this hit, and what they take of it.
        let follow = unit.map(|unit| dot(&unit, row));
        let left = 1.0 - dot(&follow, row);
        let carried = &mut self.carried;
        carried.squares += variance * left;
        carried.of_squares += of_axis * left;
        self.pairs += variance * variance * (2.0 * left - 1.0);
        for (sums, follow) in self.inner.iter_mut().zip(&follow) {
            for (sum, value) in sums.iter_mut().zip(row) {
                *sum += variance * follow * value;
            }
        }
        let moved: Vector3<f64> = to_place
            .iter()
            .zip(&follow)
            .map(|(by, share)| by * *share)
            .sum();
        carried.place += moved * moved.transpose() * variance;
        carried.of_place += of_axis * moved.norm_squared();
    }

    /// All hits are in it.
    fn carried(mut self) -> CarriedScatter {
        // tr(H V H V) = tr((A Jᵀ V J)²)
        let mut pairs = self.pairs;
        for (at, row) in self.inner.iter().enumerate() {
            for (value, other) in row.iter().zip(&self.inner) {
                pairs += value * other.get(at).copied().unwrap_or(f64::NAN);
            }
        }
        self.carried.dof = self.carried.squares * self.carried.squares / pairs;
        self.carried
    }
}

#[inline(never)]
fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
