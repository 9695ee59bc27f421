//! Nonlinear least squares in two kinds of unknowns, with a look at what they leave open.
//!
//! *Nuisances* are what is seen (planes, centres); *targets* are what is wanted (the mount).
//! A motion of the targets that changes no residual to first order, whatever the nuisances
//! do, is found by projecting the nuisances' columns away: R of one QR decomposition holds
//! all that is needed, whatever the number of observations.
//!
//! Levenberg-Marquardt from afar; then Gauss-Newton steps through singular values, where
//! directions that nothing sees do not move.

mod jacobi;
mod lifted;
pub(super) mod scatter;

use nalgebra::{DMatrix, DVector};

use jacobi::Jacobi;
use lifted::free_directions;

/// A direction whose singular value is below this share of the largest is degenerate, exact
/// up to rounding.
const DEGENERATE: f64 = 1e-8;
/// A direction below this share may be a degenerate one that noise has lifted. Sets that
/// determine the targets have at least 1e-3.
const DOUBTFUL: f64 = 1e-4;
/// The same for nuisances, which may be as badly seen as they like.
const UNSEEN_NUISANCE: f64 = 1e-10;
/// Singular values below this share of the targets' own columns are rounding: where the nuisances take
/// all of them, the largest is no measure.
const TAKEN: f64 = 1e-12;
/// Residuals that scatter by more are no noise: the model does not fit, and what they would hide is not open.
pub(super) const MOST_NOISE_MM: f64 = 1.0;
/// Steps of Levenberg and Marquardt.
const MOST_STEPS: usize = 200;
/// A sum of squares, in mm², that is nothing but rounding: 0.1 nm.
const ROUNDING: f64 = 1e-14 * 1e-6;
/// Steps of Gauss and Newton at the end.
const LAST_STEPS: usize = 40;

/// Fills in the derivatives of a residual.
pub(super) type Derivatives<'a> = dyn FnMut(&mut [f64]) + 'a;
/// Takes a residual and what fills in its derivatives.
pub(super) type TakeRow<'a> = dyn FnMut(f64, &mut Derivatives<'_>) + 'a;

/// A model with residuals.
pub(super) trait Model: Clone {
    /// How many nuisances and targets there are.
    fn unknowns(&self) -> (usize, usize);
    /// How many residuals there are.
    fn residuals(&self) -> usize;
    /// Calls `row` for each residual: its value, and its derivatives by the nuisances and
    /// then the targets, which `row` leaves at 0.
    fn rows(&self, row: &mut TakeRow<'_>);
    /// Moves all unknowns.
    fn step(&mut self, step: &[f64]);

    /// A direction that has this share of the best seen is no free one, whatever the noise: sets that determine the
    /// targets have it in all directions.
    fn seen_share(&self) -> f64 {
        1e-3
    }

    /// The sum of the squared residuals.
    fn ssq(&self) -> f64 {
        let mut sum = 0.0;
        self.rows(&mut |value, _| sum += value * value);
        sum
    }
}

/// What the data say about the targets at the optimum.
pub(super) struct Solution<M> {
    pub model: M,
    pub ssq: f64,
    /// Directions of the targets that nothing sees, in the targets' own units.
    pub unseen: Vec<DVector<f64>>,
    /// The targets' block of `inv(JᵀJ)`, over what is seen.
    pub covariance_unit: DMatrix<f64>,
    /// Singular values over the largest, falling.
    pub seen: Vec<f64>,
    /// The last step over the standard uncertainty, or over rounding where that is 0.
    pub converged: bool,
}

impl<M: Model> Solution<M> {
    /// The standard deviation of a residual.
    pub fn sigma_mm(&self) -> f64 {
        sigma_mm(&self.model, self.ssq)
    }
}

fn sigma_mm<M: Model>(model: &M, ssq: f64) -> f64 {
    let (nuisances, targets) = model.unknowns();
    let dof = model.residuals().saturating_sub(nuisances + targets).max(1);
    (ssq / dof as f64).sqrt()
}

/// R of `[J r]`, cut into its parts.
pub(super) struct Reduced {
    nuisances: usize,
    targets: usize,
    /// `[R; 0]`, without the column of residuals.
    pub r: DMatrix<f64>,
    residual: DVector<f64>,
}

/// From where a model stands to its optimum. `scale`: what a unit of each target is worth.
pub(super) fn solve<M: Model>(mut model: M, scale: &[f64]) -> Solution<M> {
    descend(&mut model, MOST_STEPS);
    let careful = refine(model, scale, DOUBTFUL);
    // Badly seen may be seen: the optimum along these directions, too. It says what noise there is.
    let whole =
        (!careful.unseen.is_empty()).then(|| refine(careful.model.clone(), scale, DEGENERATE));
    let ssq = whole.as_ref().map_or(careful.ssq, |whole| whole.ssq);
    let sigma_mm = sigma_mm(&careful.model, ssq);
    let noise_mm = if sigma_mm > MOST_NOISE_MM {
        0.0
    } else {
        sigma_mm
    };
    let free = free_directions(&careful.model, scale, noise_mm);
    if free.is_empty() {
        return whole.unwrap_or(careful);
    }
    Solution {
        unseen: free,
        ..careful
    }
}

/// Gauss-Newton over all directions above `least` times the largest singular value.
fn refine<M: Model>(mut model: M, scale: &[f64], least: f64) -> Solution<M> {
    let mut converged = false;
    let mut last = model.ssq();
    for _ in 0..LAST_STEPS {
        let reduced = reduce(&model);
        let step = reduced.seen(scale, least).step;
        // The change of the residuals that the step promises, beside the noise in them.
        let promised = (&reduced.r * &step).norm_squared();
        converged = promised <= 1e-12 * last + ROUNDING;
        let Some((next, ssq)) = shortened(&model, &step, last) else {
            // Nothing lowers the sum any more: what is left may be a hundred-thousandth of the noise.
            converged = promised <= 1e-10 * last + ROUNDING;
            break;
        };
        model = next;
        last = ssq;
        if promised <= 1e-24 * ssq + 1e-28 {
            break;
        }
    }
    let seen = reduce(&model).seen(scale, least);
    Solution {
        ssq: last,
        model,
        unseen: seen.unseen,
        covariance_unit: seen.covariance_unit,
        seen: seen.shares,
        converged,
    }
}

/// The step, or a half, a quarter of it: what is badly seen goes too far by the first.
fn shortened<M: Model>(model: &M, step: &DVector<f64>, last: f64) -> Option<(M, f64)> {
    const HALVINGS: i32 = 10;
    (0..HALVINGS).find_map(|halvings| {
        let mut next = model.clone();
        next.step((step * 0.5_f64.powi(halvings)).as_slice());
        let ssq = next.ssq();
        // A whole step at the optimum may be worse by rounding.
        let most = match halvings {
            0 => last * (1.0 + 1e-9) + ROUNDING,
            _ => last,
        };
        (ssq <= most).then_some((next, ssq))
    })
}

/// Levenberg-Marquardt; ends where the sum of squares falls no more. The sum it reaches.
pub(super) fn descend<M: Model>(model: &mut M, most: usize) -> f64 {
    let mut ssq = model.ssq();
    let mut damping = 1e-3;
    for _ in 0..most {
        let reduced = reduce(model);
        let mut better = false;
        while damping < 1e12 {
            let Some(step) = reduced.damped_step(damping) else {
                damping *= 10.0;
                continue;
            };
            let mut next = model.clone();
            next.step(step.as_slice());
            let new = next.ssq();
            if new < ssq {
                better = (ssq - new) > 1e-12 * ssq;
                *model = next;
                ssq = new;
                // Never so small that a direction which nothing sees could run away.
                damping = (damping * 0.1).max(1e-7);
                break;
            }
            damping *= 10.0;
        }
        if !better || ssq == 0.0 {
            break;
        }
    }
    ssq
}

/// What the data say, to first order.
struct SeenUnknowns {
    /// The Gauss-Newton step over all that is seen.
    step: DVector<f64>,
    /// Directions of the targets that are not.
    unseen: Vec<DVector<f64>>,
    /// The targets' block of `inv(JᵀJ)`, over what is seen.
    covariance_unit: DMatrix<f64>,
    /// Singular values over the largest, falling.
    shares: Vec<f64>,
}

/// How many rows are reduced at once.
const BLOCK: usize = 4096;

pub(super) fn reduce<M: Model>(model: &M) -> Reduced {
    let (nuisances, targets) = model.unknowns();
    let width = nuisances + targets + 1;
    let mut block = DMatrix::<f64>::zeros(BLOCK.min(model.residuals()) + width, width);
    let mut used = width;
    let mut line = vec![0.0; width - 1];
    model.rows(&mut |value, derivatives| {
        line.fill(0.0);
        derivatives(&mut line);
        for (column, &derivative) in line.iter().enumerate() {
            block[(used, column)] = derivative;
        }
        block[(used, width - 1)] = value;
        used += 1;
        if used == block.nrows() {
            fold(&mut block, width);
            used = width;
        }
    });
    block.rows_mut(used, block.nrows() - used).fill(0.0);
    fold(&mut block, width);
    Reduced {
        nuisances,
        targets,
        r: block.view((0, 0), (width, width - 1)).into_owned(),
        residual: block
            .view((0, width - 1), (width, 1))
            .column(0)
            .into_owned(),
    }
}

/// Replaces the first `width` rows by R of all rows, and the rest by 0.
fn fold(block: &mut DMatrix<f64>, width: usize) {
    let whole = std::mem::replace(block, DMatrix::zeros(0, 0));
    let rows = whole.nrows();
    let r = whole.qr().r();
    let mut next = DMatrix::zeros(rows, width);
    next.view_mut((0, 0), (width, width)).copy_from(&r);
    *block = next;
}

/// The columns of all unknowns, ready to be judged.
struct Parts {
    /// Of the nuisances, of unit length, and how long they were.
    f: DMatrix<f64>,
    norms: Vec<f64>,
    /// Of the targets, scaled.
    m: DMatrix<f64>,
    /// Of what the nuisances leave of those.
    svd: Jacobi,
    /// What is not above this is rounding.
    floor: f64,
}

impl Parts {
    /// Singular values that are not above this show nothing, `least` of the largest being nothing.
    fn none(&self, least: f64) -> f64 {
        (least * self.svd.largest()).max(self.floor)
    }
}

/// A direction of the scaled targets in the targets' own units.
fn scaled(direction: DVector<f64>, scale: &[f64]) -> DVector<f64> {
    DVector::from_iterator(
        direction.len(),
        direction.iter().zip(scale).map(|(v, s)| v * s),
    )
}

impl Reduced {
    fn damped_step(&self, damping: f64) -> Option<DVector<f64>> {
        let mut normal = self.r.tr_mul(&self.r);
        let largest = normal.diagonal().amax();
        for i in 0..normal.nrows() {
            let d = normal[(i, i)];
            normal[(i, i)] = d + damping * d.max(largest * 1e-12).max(1e-300);
        }
        let step = normal.cholesky()?.solve(&(-self.r.tr_mul(&self.residual)));
        step.iter().all(|v| v.is_finite()).then_some(step)
    }

    /// The columns, and what is left of the targets' behind the nuisances'.
    fn parts(&self, scale: &[f64]) -> Parts {
        let rows = self.r.nrows();
        let mut f = self.r.view((0, 0), (rows, self.nuisances)).into_owned();
        let norms: Vec<f64> = f
            .column_iter()
            .map(|column| column.norm().max(1e-300))
            .collect();
        for (mut column, norm) in f.column_iter_mut().zip(&norms) {
            column /= *norm;
        }
        let mut m = self
            .r
            .view((0, self.nuisances), (rows, self.targets))
            .into_owned();
        for (mut column, scale) in m.column_iter_mut().zip(scale) {
            column *= *scale;
        }
        let basis = range(&f);
        let project = |v: DMatrix<f64>| &v - &basis * basis.tr_mul(&v);
        // Twice, so that nothing of what was projected away is left but rounding.
        let svd = Jacobi::new(project(project(m.clone())));
        Parts {
            floor: TAKEN * m.norm(),
            f,
            norms,
            m,
            svd,
        }
    }

    /// What the data say about the unknowns, to first order.
    fn seen(&self, scale: &[f64], least: f64) -> SeenUnknowns {
        let parts = self.parts(scale);
        let none = parts.none(least);
        let Parts {
            f, norms, m, svd, ..
        } = parts;
        let mut targets = DVector::zeros(self.targets);
        let mut covariance = DMatrix::zeros(self.targets, self.targets);
        let mut unseen = Vec::new();
        for (i, &value) in svd.values.iter().enumerate() {
            let direction = svd.v.column(i).into_owned();
            if value <= none {
                unseen.push(scaled(direction, scale));
                continue;
            }
            targets -= &direction * (svd.u.column(i).dot(&self.residual) / value);
            let direction = scaled(direction, scale) / value;
            covariance += &direction * direction.transpose();
        }
        let left = &self.residual + &m * &targets;
        let nuisances = pseudo_solve(&f, &left);
        let mut step = DVector::zeros(self.nuisances + self.targets);
        for (i, value) in nuisances.iter().enumerate() {
            step[i] = -value / norms[i];
        }
        for (i, value) in scaled(targets, scale).iter().enumerate() {
            step[self.nuisances + i] = *value;
        }
        let largest = svd.largest();
        let shares: Vec<f64> = svd
            .values
            .iter()
            .map(|value| value / largest.max(1e-300))
            .collect();
        SeenUnknowns {
            step,
            unseen,
            covariance_unit: covariance,
            shares,
        }
    }
}

/// An orthonormal basis of what the columns reach, by Gram and Schmidt, the largest rest first.
fn range(f: &DMatrix<f64>) -> DMatrix<f64> {
    let mut rest = f.clone();
    let mut basis: Vec<DVector<f64>> = Vec::with_capacity(f.ncols());
    let mut largest = 0.0;
    while basis.len() < f.ncols() {
        let norms = rest.column_iter().map(|column| column.norm());
        let (mut most, mut place) = (0.0, 0);
        for (i, norm) in norms.enumerate() {
            if norm > most {
                (most, place) = (norm, i);
            }
        }
        largest = f64::max(largest, most);
        if most <= UNSEEN_NUISANCE * largest {
            break;
        }
        let mut next = rest.column(place) / most;
        // What rounding left of the others: twice is enough.
        for _ in 0..2 {
            for other in &basis {
                let along = other.dot(&next);
                next.axpy(-along, other, 1.0);
            }
        }
        let next = next.normalize();
        let along = rest.tr_mul(&next);
        rest -= &next * along.transpose();
        basis.push(next);
    }
    DMatrix::from_fn(f.nrows(), basis.len(), |i, k| basis[k][i])
}

/// The shortest `x` that comes nearest to `f x = b`.
fn pseudo_solve(f: &DMatrix<f64>, b: &DVector<f64>) -> DVector<f64> {
    if f.ncols() == 0 {
        return DVector::zeros(0);
    }
    let svd = Jacobi::new(f.clone());
    let least = UNSEEN_NUISANCE * svd.largest();
    let mut x = DVector::zeros(f.ncols());
    for (i, &value) in svd.values.iter().enumerate() {
        if value > least {
            x.axpy(svd.u.column(i).dot(b) / value, &svd.v.column(i), 1.0);
        }
    }
    x
}
