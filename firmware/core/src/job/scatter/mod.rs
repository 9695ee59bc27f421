//! What a correction may be wrong by, from what one hit scatters.
//!
//! # Rule
//!
//! The variance of one hit is pooled from the job's probing sigma and from the residuals of
//! all datum features of the setup, each weighted with its degrees of freedom (JCGM 100:2008,
//! 4.2.4). With five hits a ball has one of its own, so three balls alone say next to nothing:
//! without the prior a lucky setup would state 0.1 µm.
//!
//! To the prior comes what the control's step adds: a coordinate that is rounded to whole steps is
//! off evenly by up to half of one, with the variance step²/12 along any normal (JCGM 100:2008,
//! F.2.2.1). That is known and not estimated, so the prior's degrees of freedom grow by the square
//! of what its variance grows by (G.4.1). The residuals have the step in them.
//!
//! Where the job states another sigma for each axis, the variance of a hit is `Σ nₖ² σₖ²` along its
//! surface's normal n, and the step's. The fits are unweighted all the same, so each carries the
//! covariance `A Jᵀ V J A` with `A = (JᵀJ)⁻¹` and V the hits' variances (H. White, Econometrica 48,
//! 1980). What the residuals tell is one factor by which all stated variances are wrong: with the
//! hat matrix `H = J A Jᵀ` of a fit it is `Σ r² / tr((I-H) V)`, with
//! `tr((I-H) V)² / tr(((I-H) V)²)` degrees of freedom (F. E. Satterthwaite, Biometrics Bulletin 2,
//! 1946; JCGM 100:2008, G.4.1). By the job alone it is 1. Both are pooled as above. With three
//! alike all of that is the rule above, and is worked out as there, to the same bits.
//!
//! Residuals of the sides say nothing of a sigma of Z that is wrong. With cₖ the part of axis k in
//! the variances of the places, wₖ its part in what the residuals are expected to be, D their
//! degrees of freedom, ν those of each sigma and P = D / (ν + D) what the residuals count, what is
//! stated has `1 / (Σ (cₖ - P wₖ)² / ν + P² / D)` of them: the three sigmas and the residuals are
//! independent, and the relative variance of a variance is 2 / ν (G.4.2). The reference is taken to have
//! been measured as the part stands now: in one that is turned by a right angle X and Y change
//! places.
//!
//! It is carried through each fit (its unit covariance) and through the registration to the
//! part: with n places at arms aᵢ from their centroid, `H = Σ (|aᵢ|² I - aᵢ aᵢᵀ)`, an error eᵢ of
//! place i moves a point at arm d by `Mᵢ eᵢ`, `Mᵢ = I/n - [d]× H⁻¹ [aᵢ]×`. The place of a feature
//! that was probed k times is their mean, and has the sum of their covariances divided by k². A
//! taught reference was measured the same way, so it counts as much again.
//!
//! Where warmth is fitted, the scale is `Σ aᵢ·eᵢ / Σ |aᵢ|²` off: the part's corner at arm d goes
//! with it, so `Mᵢ` has `d aᵢᵀ / Σ |aᵢ|²` besides. A rigid correction leaves the part's growth
//! about its middle, a known error b of each corner.
//!
//! The stated error holds at all corners of the part at once: `E = max |e|²` over them. Its mean m
//! and variance come from a cubature over the seven errors that move them (place, turn, scale),
//! exact where E is a polynomial of them up to the fifth degree, which it is but for the change
//! from corner to corner (A. H. Stroud, Approximate Calculation of Multiple Integrals, 1971,
//! Eₙ 5-2). The 95 % error is `√(m F)`, F the 95 % point of the F distribution with `2 m² / var`
//! and `ν (m / (m - |b|²))²` degrees of freedom, ν the pooled ones: a sum of squares whose parts
//! differ, after F. E. Satterthwaite (Biometrics Bulletin 2, 1946), and with a known part after
//! P. B. Patnaik (Biometrika 36, 1949).

mod axes;

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use umi_protocol::feature::{FitReport, Shape};
use umi_protocol::job::{CorrectionSpec, MAX_DATUMS, ProbingSpec};

use self::axes::{ByAxis, carried};
use crate::correction;
use crate::registration::Registration;
use crate::units::Point;

/// What the job states of one hit, and what the control's step adds.
#[derive(Clone, Copy, Debug)]
pub struct StatedScatter {
    /// Variance of a hit along the axis that scatters most, mm².
    hit: f64,
    /// With the step's, mm².
    variance: f64,
    /// Degrees of freedom.
    dof: f64,
    /// Where the axes do not scatter alike.
    axes: Option<ByAxis>,
}

impl StatedScatter {
    /// By the job, and by the step of the control's coordinates.
    pub fn of(probing: ProbingSpec, step_mm: f64) -> Self {
        let sigma_mm = probing.worst_mm();
        let hit = sigma_mm * sigma_mm;
        let step = step_mm * step_mm / 12.0;
        let dof = f64::from(probing.dof);
        let is_alike = probing.same_mm().is_some();
        Self {
            hit,
            variance: hit + step,
            dof,
            axes: (!is_alike).then(|| ByAxis::new(probing.sigma_mm, step, dof)),
        }
    }
}

/// The pooled variance of a hit, and the covariances of the datum places in its units.
#[derive(Clone, Debug)]
pub struct Scatter {
    /// Sum of squares, mm²; of what is stated, where the axes do not scatter alike.
    squares: f64,
    /// Degrees of freedom.
    dof: f64,
    places: heapless::Vec<Matrix3<f64>, MAX_DATUMS>,
    /// The reference was measured, too.
    taught: bool,
}

/// What a correction may be wrong by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Expected root mean square of the error's length at the corner where that is most, mm.
    pub rms_mm: f64,
    /// Of 95 of 100 corrections all corners are closer, mm.
    pub error_95_mm: f64,
}

impl Scatter {
    /// What the job says before anything is measured.
    pub fn of(stated: &StatedScatter, taught: bool) -> Self {
        let grows = stated.variance / stated.hit;
        let dof = stated.dof * grows * grows;
        let unit = match stated.axes {
            None => stated.variance,
            Some(_) => 1.0,
        };
        Self {
            squares: dof * unit,
            dof,
            places: heapless::Vec::new(),
            taught,
        }
    }

    /// A datum feature was fitted to points, each time that it was probed: its place is their mean.
    pub fn add<'a>(
        &mut self,
        stated: &mut StatedScatter,
        times: impl Iterator<Item = (&'a FitReport, &'a [[f64; 3]])>,
    ) {
        let (mut sum, mut count, mut of_axis) = (Matrix3::zeros(), 0.0, Vector3::zeros());
        for (fit, points) in times {
            sum += match &mut stated.axes {
                None => self.one(fit),
                Some(axes) => self.one_by_axis(fit, points, axes, &mut of_axis),
            };
            count += 1.0;
        }
        let place = sum / (count * count);
        if let Some(axes) = &mut stated.axes {
            axes.place(&place, &(of_axis / (count * count)));
        }
        // Bounded: the job check limits the datums.
        let _ = self.places.push(place);
    }

    /// Takes a fit's residuals in; the unit covariance of its place.
    fn one(&mut self, fit: &FitReport) -> Matrix3<f64> {
        if let Some(sigma) = fit.sigma_mm {
            let dof = f64::from(fit.dof);
            self.squares += dof * sigma * sigma;
            self.dof += dof;
        }
        match &fit.shape {
            Shape::Sphere { cov_unit, .. } | Shape::Circle { cov_unit, .. } => corner(cov_unit),
            Shape::Cone { cov_unit_apex, .. } => corner(cov_unit_apex),
            _ => Matrix3::identity(),
        }
    }

    /// The same; the stated covariance, and each axis' part. Not a number where it cannot be told, and so is
    /// all else then.
    #[inline(never)]
    fn one_by_axis(
        &mut self,
        fit: &FitReport,
        points: &[[f64; 3]],
        axes: &mut ByAxis,
        of_axis: &mut Vector3<f64>,
    ) -> Matrix3<f64> {
        let Some(carried) = carried(fit, points, axes) else {
            return Matrix3::from_element(f64::NAN);
        };
        *of_axis += carried.of_place;
        if let Some(sigma) = fit.sigma_mm {
            axes.residuals(&carried);
            let squares = f64::from(fit.dof) * sigma * sigma;
            self.squares += carried.dof * squares / carried.squares;
            self.dof += carried.dof;
        }
        carried.place
    }

    /// All datum features are in it.
    pub fn settle(&mut self, stated: &StatedScatter) {
        if let Some(axes) = &stated.axes {
            let dof = axes.dof(self.dof).min(MOST_DOF);
            self.squares *= dof / self.dof;
            self.dof = dof;
        }
    }

    /// Variance of one hit, mm²; counted twice where the reference was measured, too.
    fn variance(&self) -> f64 {
        let twice = if self.taught { 2.0 } else { 1.0 };
        twice * self.squares / self.dof
    }

    /// Standard deviation of a scale that was fitted to the distances between these places.
    pub fn scale_sigma(&self, places: &[Point]) -> f64 {
        let Some(centroid) = centroid(places) else {
            return f64::NAN;
        };
        let (mut sum, mut arms) = (0.0, 0.0);
        for (place, unit) in places.iter().zip(&self.places) {
            let arm = place.mm - centroid;
            sum += arm.dot(&(unit * arm));
            arms += arm.norm_squared();
        }
        libm::sqrt(sum * self.variance()) / arms
    }

    /// What the images of the part's corners may be wrong by; none where it cannot be told.
    /// `scale`: by how much more than 1 the part has grown, where warmth is fitted.
    pub fn expected(
        &self,
        fit: &Registration,
        measured: &[Point],
        spec: &CorrectionSpec,
        scale: Option<f64>,
    ) -> Option<Expected> {
        let part = Part::new(fit, spec, scale.unwrap_or_default());
        let errors = self.errors(fit, measured, &part, scale.is_some())?;
        let (mean, variance) = part.moments(&errors);
        let known = mean / (mean - part.known);
        let dof = self.dof * known * known;
        // Beyond, nothing changes in what is printed, and the fraction takes longer.
        let f = f_95(
            (2.0 * mean * mean / variance).min(MOST_DOF),
            dof.min(MOST_DOF),
        );
        let expected = Expected {
            rms_mm: libm::sqrt(part.square(&errors)),
            error_95_mm: libm::sqrt(mean * f),
        };
        (expected.rms_mm.is_finite() && expected.error_95_mm.is_finite()).then_some(expected)
    }

    /// The covariance of what moves the part's corners: three of its middle's place, three of its
    /// turn, one of its scale.
    #[inline(never)]
    fn errors(
        &self,
        fit: &Registration,
        measured: &[Point],
        part: &Part,
        scaled: bool,
    ) -> Option<Errors> {
        let count = f64::from(u8::try_from(measured.len()).ok()?);
        let centroid = centroid(measured)?;
        let (mut inertia, mut arms) = (Matrix3::zeros(), 0.0);
        for place in measured {
            let arm = place.mm - centroid;
            arms += arm.norm_squared();
            inertia += Matrix3::identity() * arm.norm_squared() - arm * arm.transpose();
        }
        let inverse = inertia.try_inverse()?;
        let out = fit.apply(Point { mm: part.middle }).mm - centroid;
        let mut errors = Errors::zeros();
        for (place, unit) in measured.iter().zip(&self.places) {
            let arm = place.mm - centroid;
            let turns = inverse * cross(&arm);
            let grows = if scaled { arm / arms } else { Vector3::zeros() };
            let moves = Matrix3::identity() / count - cross(&out) * turns + out * grows.transpose();
            let mut by = SMatrix::<f64, 7, 3>::zeros();
            by.fixed_rows_mut::<3>(0).copy_from(&moves);
            by.fixed_rows_mut::<3>(3).copy_from(&turns);
            by.fixed_rows_mut::<1>(6).copy_from(&grows.transpose());
            errors += by * unit * by.transpose();
        }
        Some(errors * self.variance())
    }
}

/// Covariance of the errors of a part's place, turn and scale.
type Errors = SMatrix<f64, 7, 7>;

/// A part as it stands, and what a rigid correction leaves of its growth.
struct Part {
    /// Its middle, in the reference's coordinates.
    middle: Vector3<f64>,
    /// From there to its eight corners, as it stands.
    arms: [Vector3<f64>; 8],
    /// The scale's excess over 1: the known error of a corner is so much of its arm.
    scale: f64,
    /// Square of the known error, of any corner.
    known: f64,
}

impl Part {
    fn new(fit: &Registration, spec: &CorrectionSpec, scale: f64) -> Self {
        let (min, max) = (spec.part_min_mm.into(), spec.part_max_mm.into());
        let middle = (min + max) * 0.5;
        let turn = fit.transform.rotation;
        let mut arms = [Vector3::zeros(); 8];
        for (arm, corner) in arms.iter_mut().zip(correction::corners(&min, &max)) {
            *arm = turn * (corner - middle);
        }
        let known = scale * scale * (max - min).norm_squared() * 0.25;
        Self {
            middle,
            arms,
            scale,
            known,
        }
    }

    /// The largest square of an error of the corners, by what moves them.
    fn most(&self, by: &SVector<f64, 7>) -> f64 {
        let (moves, turns) = (by.fixed_rows::<3>(0), by.fixed_rows::<3>(3));
        let (moves, turns): (Vector3<f64>, Vector3<f64>) = (moves.into(), turns.into());
        let grows = by[6] - self.scale;
        self.arms.iter().fold(0.0, |most: f64, arm| {
            most.max((moves + turns.cross(arm) + arm * grows).norm_squared())
        })
    }

    /// Mean and variance of that.
    #[inline(never)]
    fn moments(&self, errors: &Errors) -> (f64, f64) {
        const N: usize = 7;
        let root = root(errors);
        let all = f64::from(N as u8);
        let (far, near) = (libm::sqrt(all + 2.0), libm::sqrt((all + 2.0) / 2.0));
        let square = (all + 2.0) * (all + 2.0);
        let (mut mean, mut squares) = (0.0, 0.0);
        let mut take = |weight: f64, by: &SVector<f64, 7>| {
            let most = self.most(by);
            mean += weight * most;
            squares += weight * most * most;
        };
        take(2.0 / (all + 2.0), &SVector::zeros());
        for (at, one) in root.column_iter().enumerate() {
            for sign in [far, -far] {
                take((4.0 - all) / (2.0 * square), &(one * sign));
            }
            for other in root.column_iter().skip(at + 1) {
                for (a, b) in [(near, near), (near, -near), (-near, near), (-near, -near)] {
                    take(1.0 / square, &(one * a + other * b));
                }
            }
        }
        (mean, squares - mean * mean)
    }

    /// Expected square of the error of the corner where that is most.
    fn square(&self, errors: &Errors) -> f64 {
        let mut most = 0.0;
        for arm in &self.arms {
            let mut sees = SMatrix::<f64, 3, 7>::zeros();
            sees.fixed_columns_mut::<3>(0)
                .copy_from(&Matrix3::identity());
            sees.fixed_columns_mut::<3>(3).copy_from(&-cross(arm));
            sees.fixed_columns_mut::<1>(6).copy_from(arm);
            let square = (sees * errors * sees.transpose()).trace();
            most = f64::max(most, square);
        }
        most + self.known
    }
}

/// A matrix whose product with its transpose is this, column by column (A.-L. Cholesky); what
/// does not vary stays zero.
fn root(of: &Errors) -> Errors {
    let (mut rest, mut root) = (*of, Errors::zeros());
    for (number, mut column) in root.column_iter_mut().enumerate() {
        let source = rest.column(number).into_owned();
        let pivot = source.get(number).copied().unwrap_or_default();
        if pivot > 0.0 {
            let taken = source / libm::sqrt(pivot);
            rest -= taken * taken.transpose();
            column.copy_from(&taken);
        }
    }
    root
}

/// Degrees of freedom from which on an F distribution is as good as its limit.
const MOST_DOF: f64 = 10_000.0;

fn centroid(places: &[Point]) -> Option<Vector3<f64>> {
    let count = f64::from(u8::try_from(places.len()).ok()?);
    Some(places.iter().map(|p| p.mm).sum::<Vector3<f64>>() / count)
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
/// (NIST DLMF 8.17.22), which converges fast below the mean; above it by its complement. For
/// `a` and `b` of at most some thousands.
#[must_use]
pub fn beta_ratio(a: f64, b: f64, x: f64) -> f64 {
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
