//! The guarded Newton iteration behind the non-linear fits.
//!
//! Newton's method with the full Hessian, damped after Levenberg and Marquardt
//! (Marquardt, SIAM J. Appl. Math. 11, 1963) whenever a step would not lower
//! the sum of squares. It ends when the step is down to rounding, and the
//! result counts only if the Hessian there is positive definite: a maximum, a
//! saddle or a run to infinity is [`Stopped`], never an answer.

use nalgebra::Vector3;

use super::cloud::count;
use super::linalg::{Cholesky, Qr, Square, quadratic_form};
use crate::fit::MIN_CURVATURE;

/// What one point adds at the current parameters.
pub(crate) struct Term<const K: usize> {
    /// Orthogonal residual d.
    pub(crate) residual: f64,
    /// First derivatives of d.
    pub(crate) gradient: [f64; K],
    /// Second derivatives of d; only the lower triangle is read.
    pub(crate) second: Square<K>,
}

/// A surface with K parameters, in local coordinates (size about 1), and what
/// is held against it: points, or what a sensor saw.
pub(crate) trait Surface<const K: usize, Seen = Vector3<f64>>: Copy {
    /// Residual and derivatives at a point; None where they do not exist (the
    /// point is the centre of the sphere, or on the axis).
    fn term(&self, q: &Seen) -> Option<Term<K>>;

    /// The sum of squares at these parameters. None where a term does not exist.
    fn system<I>(&self, points: &I) -> Option<System<K>>
    where
        I: Iterator<Item = Seen> + Clone,
    {
        System::at(self, points)
    }

    /// The surface after a step; None if it is no such surface any more.
    fn moved(&self, step: &[f64; K]) -> Option<Self>;

    /// Size of the numbers whose difference is the residual: what rounding
    /// multiplies.
    fn magnitude(&self) -> f64;
}

/// The iteration ended without a minimum.
pub(crate) struct Stopped<S> {
    /// Where it ended.
    pub(crate) surface: S,
    /// Sum of squares there.
    pub(crate) sum: f64,
    /// Steps tried.
    pub(crate) iterations: u32,
}

/// A proved minimum.
pub(crate) struct Minimum<S, const K: usize> {
    pub(crate) surface: S,
    /// `inv(JᵀJ)` in local units.
    pub(crate) cov_unit: Square<K>,
}

/// Steps after which a fit gives up. Good data need three to six.
pub(crate) const MAX_STEPS: u32 = 200;

/// Refines `start` and proves the result.
pub(crate) fn minimise<const K: usize, S, I>(
    start: S,
    points: &I,
) -> Result<Minimum<S, K>, Stopped<S>>
where
    S: Surface<K, I::Item>,
    I: Iterator + Clone,
{
    let Converged {
        surface,
        system,
        steps,
    } = descend(start, points, MAX_STEPS)?;
    let stopped = Stopped {
        surface,
        sum: system.sum,
        iterations: steps,
    };
    if !system.is_minimum() {
        return Err(stopped);
    }
    let mut qr = Qr::new();
    for q in points.clone() {
        let Some(term) = surface.term(&q) else {
            return Err(stopped);
        };
        qr.add(term.gradient, 0.0);
    }
    match qr.triangle().inverse_gram() {
        Some(cov_unit) => Ok(Minimum { surface, cov_unit }),
        None => Err(stopped),
    }
}

/// A surface at which the gradient is zero to rounding.
pub(crate) struct Converged<S, const K: usize> {
    pub(crate) surface: S,
    pub(crate) system: System<K>,
    steps: u32,
}

/// Goes downhill from `start` until steps are down to rounding.
pub(crate) fn descend<const K: usize, S, I>(
    start: S,
    points: &I,
    max_steps: u32,
) -> Result<Converged<S, K>, Stopped<S>>
where
    S: Surface<K, I::Item>,
    I: Iterator + Clone,
{
    /// Damping beyond which steps are too short to matter.
    const MAX_DAMPING: f64 = 1e12;

    let mut surface = start;
    let Some(mut system) = surface.system(points) else {
        return Err(Stopped {
            surface,
            sum: f64::INFINITY,
            iterations: 0,
        });
    };
    let mut damping = 0.0;
    // Squared length (in residual space) of the last undamped Newton step.
    let mut last_length2 = f64::INFINITY;
    for steps in 0..max_steps {
        let Some((step, newton)) = system.step(damping) else {
            damping = raised(damping);
            if damping > MAX_DAMPING {
                break;
            }
            continue;
        };
        let length2 = quadratic_form(&system.gram, &step);
        let rounding = 8.0 * f64::EPSILON * surface.magnitude();
        let rounding2 = system.count * rounding * rounding;
        if newton && length2 <= rounding2 {
            let surface = surface.moved(&step).unwrap_or(surface);
            return Ok(Converged {
                surface,
                system,
                steps,
            });
        }
        // Near the minimum the sum of squares is blind to the last half of the
        // digits: residuals carry the rounding of coordinates, the sum that of
        // its terms. There the step itself must contract, as Newton's does, and
        // when it does so no longer, rounding is reached as well.
        let sum_noise = (1e-12 + 8.0 * f64::EPSILON * system.count) * system.sum
            + 8.0 * libm::sqrt(system.sum * rounding2);
        let blind = newton && length2 <= sum_noise + 1e4 * rounding2;
        if blind && length2 > 0.25 * last_length2 {
            return Ok(Converged {
                surface,
                system,
                steps,
            });
        }
        let next = surface
            .moved(&step)
            .and_then(|s| s.system(points).map(|system| (s, system)));
        match next {
            Some((next_surface, next_system)) if blind || next_system.sum < system.sum => {
                surface = next_surface;
                system = next_system;
                last_length2 = if newton { length2 } else { f64::INFINITY };
                damping = if damping < 1e-5 { 0.0 } else { damping * 0.1 };
            }
            _ => {
                damping = raised(damping);
                if damping > MAX_DAMPING {
                    break;
                }
            }
        }
    }
    Err(Stopped {
        surface,
        sum: system.sum,
        iterations: max_steps,
    })
}

fn raised(damping: f64) -> f64 {
    (damping * 8.0).max(1e-3)
}

/// What the terms of `L` parameters add up to; only the lower triangles are read.
pub(crate) struct Sums<const L: usize> {
    /// `Σ d²`.
    pub(crate) sum: f64,
    /// `Jᵀd`.
    pub(crate) gradient: [f64; L],
    /// `JᵀJ`.
    pub(crate) gram: Square<L>,
    /// `JᵀJ + Σ d ∇²d`.
    pub(crate) hessian: Square<L>,
}

/// The sum of squares at some parameters, with its derivatives.
pub(crate) struct System<const K: usize> {
    /// Number of points.
    count: f64,
    /// `Σ d²`.
    pub(crate) sum: f64,
    /// `Jᵀd`, half the gradient.
    gradient: [f64; K],
    /// `JᵀJ`, the Gauss-Newton matrix.
    gram: Square<K>,
    /// `JᵀJ + Σ d ∇²d`, half the Hessian.
    hessian: Square<K>,
}

// Indices run over 0..K of arrays of length K.
#[allow(clippy::indexing_slicing, clippy::needless_range_loop)]
impl<const K: usize> System<K> {
    pub(crate) fn at<S, I>(surface: &S, points: &I) -> Option<Self>
    where
        S: Surface<K, I::Item>,
        I: Iterator + Clone,
    {
        let mut system = Self {
            count: 0.0,
            sum: 0.0,
            gradient: [0.0; K],
            gram: [[0.0; K]; K],
            hessian: [[0.0; K]; K],
        };
        let mut n = 0_usize;
        for q in points.clone() {
            n += 1;
            let Term {
                residual,
                gradient,
                second,
            } = surface.term(&q)?;
            system.sum += residual * residual;
            for i in 0..K {
                system.gradient[i] += gradient[i] * residual;
                for j in 0..=i {
                    let square = gradient[i] * gradient[j];
                    system.gram[i][j] += square;
                    system.hessian[i][j] += square + residual * second[i][j];
                }
            }
        }
        system.closed(n)
    }

    /// Of `n` points, whose terms were summed up in the lower triangles.
    fn closed(mut self, n: usize) -> Option<Self> {
        for i in 0..K {
            for j in 0..i {
                self.gram[j][i] = self.gram[i][j];
                self.hessian[j][i] = self.hessian[i][j];
            }
        }
        self.count = count(n);
        self.sum.is_finite().then_some(self)
    }

    /// Of `n` points; the first `L` parameters are all that there are.
    pub(crate) fn of<const L: usize>(n: usize, sums: &Sums<L>) -> Option<Self> {
        let mut system = Self {
            count: 0.0,
            sum: sums.sum,
            gradient: [0.0; K],
            gram: [[0.0; K]; K],
            hessian: [[0.0; K]; K],
        };
        for i in 0..K.min(L) {
            system.gradient[i] = sums.gradient[i];
            for j in 0..=i {
                system.gram[i][j] = sums.gram[i][j];
                system.hessian[i][j] = sums.hessian[i][j];
            }
        }
        system.closed(n)
    }

    /// The next step, and whether it is an undamped Newton step. None if no
    /// matrix was positive definite: damp more.
    fn step(&self, damping: f64) -> Option<([f64; K], bool)> {
        let damped = |matrix: &Square<K>| {
            let mut matrix = *matrix;
            for i in 0..K {
                matrix[i][i] += damping * self.gram[i][i];
            }
            Cholesky::new(&matrix)
        };
        let (factor, newton) = match damped(&self.hessian) {
            Some(factor) => (factor, damping == 0.0),
            None => (damped(&self.gram)?, false),
        };
        Some((factor.solve(&self.gradient.map(|g| -g)), newton))
    }

    /// Whether the Hessian is positive definite, and not just so.
    fn is_minimum(&self) -> bool {
        let mut matrix = self.hessian;
        for i in 0..K {
            for j in 0..K {
                matrix[i][j] -= MIN_CURVATURE * self.gram[i][j];
            }
        }
        Cholesky::new(&matrix).is_some()
    }
}
