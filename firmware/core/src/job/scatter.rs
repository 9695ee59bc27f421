//! What a correction may be wrong by, from what one hit scatters.
//!
//! # Rule
//!
//! The variance of one hit is pooled from the job's probing sigma and from the residuals of
//! all datum features of the setup, each weighted with its degrees of freedom (JCGM 100:2008,
//! 4.2.4). With five hits a ball has one of its own, so three balls alone say next to nothing:
//! without the prior a lucky setup would state 0.1 µm.
//!
//! It is carried through each fit (its unit covariance) and through the registration to the
//! part: with n places at arms aᵢ from their centroid, `H = Σ (|aᵢ|² I - aᵢ aᵢᵀ)`, an error eᵢ of
//! place i moves a point at arm d by `Mᵢ eᵢ`, `Mᵢ = I/n - [d]× H⁻¹ [aᵢ]×`. A taught reference was
//! measured the same way, so it counts as much again.
//!
//! The 95 % error is `√(tr C · F)`, F the 95 % point of the F distribution with
//! `h = (tr C)² / tr C²` and the pooled degrees of freedom: the length of an error whose
//! covariance is not a sphere's, after F. E. Satterthwaite (Biometrics Bulletin 2, 1946).

use nalgebra::{Matrix3, Vector3};
use umi_protocol::feature::{FitReport, Shape};
use umi_protocol::job::{MAX_DATUMS, ProbingSpec};

use crate::registration::Registration;
use crate::units::Point;

/// The pooled variance of a hit, and the unit covariances of the datum places.
#[derive(Clone, Debug)]
pub struct Scatter {
    /// Sum of squares, mm².
    squares: f64,
    /// Degrees of freedom.
    dof: f64,
    places: heapless::Vec<Matrix3<f64>, MAX_DATUMS>,
    /// The reference was measured, too.
    taught: bool,
}

/// What a correction may be wrong by at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Expected root mean square of the error's length, mm.
    pub rms_mm: f64,
    /// 95 of 100 errors are shorter, mm.
    pub error_95_mm: f64,
}

impl Scatter {
    /// What the job says before anything is measured.
    pub fn of(probing: ProbingSpec, taught: bool) -> Self {
        let dof = f64::from(probing.dof);
        Self {
            squares: dof * probing.sigma_mm * probing.sigma_mm,
            dof,
            places: heapless::Vec::new(),
            taught,
        }
    }

    /// A datum feature was fitted.
    pub fn add(&mut self, fit: &FitReport) {
        if let Some(sigma) = fit.sigma_mm {
            let dof = f64::from(fit.dof);
            self.squares += dof * sigma * sigma;
            self.dof += dof;
        }
        let unit = match &fit.shape {
            Shape::Sphere { cov_unit, .. } | Shape::Circle { cov_unit, .. } => corner(cov_unit),
            Shape::Cone { cov_unit_apex, .. } => corner(cov_unit_apex),
            _ => Matrix3::identity(),
        };
        // Bounded: the job check limits the datums.
        let _ = self.places.push(unit);
    }

    /// Standard deviation of one hit, mm.
    pub fn sigma_mm(&self) -> f64 {
        libm::sqrt(self.squares / self.dof)
    }

    /// What the image of `at` may be wrong by; none where it cannot be told. `unsure`: by what
    /// all images are off besides, for hits that scatter by 1 mm.
    pub fn at(
        &self,
        fit: &Registration,
        measured: &[Point],
        at: Point,
        unsure: Vector3<f64>,
    ) -> Option<Expected> {
        let besides = unsure * unsure.transpose() * (self.squares / self.dof);
        let cov = self.covariance(fit, measured, at)? + besides;
        let trace = cov.trace();
        let effective = trace * trace / (cov * cov).trace();
        let expected = Expected {
            rms_mm: libm::sqrt(trace),
            error_95_mm: libm::sqrt(trace * f_95(effective, self.dof)),
        };
        (expected.rms_mm.is_finite() && expected.error_95_mm.is_finite()).then_some(expected)
    }

    /// Sum of the three variances of the image of `at`: cheap, to find the worst corner.
    pub fn variance(&self, fit: &Registration, measured: &[Point], at: Point) -> Option<f64> {
        Some(self.covariance(fit, measured, at)?.trace())
    }

    fn covariance(
        &self,
        fit: &Registration,
        measured: &[Point],
        at: Point,
    ) -> Option<Matrix3<f64>> {
        let count = f64::from(u8::try_from(measured.len()).ok()?);
        let centroid = measured.iter().map(|p| p.mm).sum::<Vector3<f64>>() / count;
        let mut inertia = Matrix3::zeros();
        for place in measured {
            let arm = place.mm - centroid;
            inertia += Matrix3::identity() * arm.norm_squared() - arm * arm.transpose();
        }
        let inverse = inertia.try_inverse()?;
        let turned = cross(&(fit.apply(at).mm - centroid)) * inverse;
        let mut cov = Matrix3::zeros();
        for (place, unit) in measured.iter().zip(&self.places) {
            let moves = Matrix3::identity() / count - turned * cross(&(place.mm - centroid));
            cov += moves * unit * moves.transpose();
        }
        let twice = if self.taught { 2.0 } else { 1.0 };
        Some(cov * (twice * self.squares / self.dof))
    }
}

/// `[v]×`
fn cross(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// The position's part of a unit covariance.
fn corner<const N: usize>(rows: &[[f64; N]; N]) -> Matrix3<f64> {
    let at = |row: usize, column: usize| {
        let row = rows.get(row);
        row.and_then(|row| row.get(column))
            .copied()
            .unwrap_or(f64::NAN)
    };
    Matrix3::from_fn(at)
}

/// The 95 % point of the F distribution with `h` and `dof` degrees of freedom, divided by
/// nothing: `P(χ²_h / h < F · χ²_dof / dof) = 0.95`.
fn f_95(h: f64, dof: f64) -> f64 {
    // F grows without bound as x goes to 1: the bisection is over x = hF / (hF + dof).
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if beta_ratio(h / 2.0, dof / 2.0, middle) < 0.95 {
            low = middle;
        } else {
            high = middle;
        }
    }
    let x = 0.5 * (low + high);
    dof * x / (h * (1.0 - x))
}

/// The regularised incomplete beta function `I_x(a, b)`, by its continued fraction
/// (NIST DLMF 8.17.22), which converges fast below the mean; above it by its complement.
fn beta_ratio(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    let scale = libm::exp(
        ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * libm::log(x) + b * libm::log(1.0 - x),
    );
    if x < (a + 1.0) / (a + b + 2.0) {
        scale * fraction(a, b, x) / a
    } else {
        1.0 - scale * fraction(b, a, 1.0 - x) / b
    }
}

/// The logarithm of the gamma function of a positive number, by Stirling's series (NIST DLMF
/// 5.11.1) from 10 on, where it is good to 2e-14. The library's, for any number, takes 2 KB.
fn ln_gamma(mut x: f64) -> f64 {
    let mut product = 1.0;
    for _ in 0..10 {
        if x < 10.0 {
            product *= x;
            x += 1.0;
        }
    }
    let r = 1.0 / (x * x);
    let tail =
        1.0 / 12.0 - r * (1.0 / 360.0 - r * (1.0 / 1260.0 - r * (1.0 / 1680.0 - r / 1188.0)));
    const HALF_LN_2PI: f64 = 0.918_938_533_204_672_8;
    (x - 0.5) * libm::log(x) - x + HALF_LN_2PI + tail / x - libm::log(product)
}

/// That continued fraction, by Lentz's method.
fn fraction(a: f64, b: f64, x: f64) -> f64 {
    const TINY: f64 = 1e-30;
    let away = |value: f64| if value.abs() < TINY { TINY } else { value };
    let mut c = 1.0;
    let mut d = 1.0 / away(1.0 - (a + b) * x / (a + 1.0));
    let mut sum = d;
    for step in 1..200_u8 {
        let m = f64::from(step);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        let mut change = 1.0;
        for term in [even, odd] {
            d = 1.0 / away(1.0 + term * d);
            c = away(1.0 + term / c);
            change = c * d;
            sum *= change;
        }
        if (change - 1.0).abs() < 1e-12 {
            break;
        }
    }
    sum
}

#[cfg(test)]
mod tests;
