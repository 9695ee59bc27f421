//! What errors neighbours share, estimated from patches of the residuals.
//!
//! The points are cut into patches of equally many, each of one place and one direction. The mean of a patch's residuals
//! shows what its points share, however many they are: errors over one millimetre in a dense cloud, and errors over the whole
//! part below the noise. Where a point lies is its foot on the model: a cut across a face that divided points by their own
//! noise would put those in front of the face into one patch and those behind it into another, and their means would show
//! as large an error as the noise itself. The means are taken for normal with the covariance a (1 + λ K): a patch's own part, and what
//! patches share. Several K are tried: errors that fall with the distance, from less than a patch on, and errors of faces
//! as a whole, as views have that are not registered well.
//!
//! Residuals of a fit are smaller than the errors: the pose has taken its part of them, and the more, the further they are
//! shared. So what is compared with the data is not K but what the fit leaves of it, (1 − H) K (1 − H), with the fit's own
//! H = A (AᵀA)⁻¹ Aᵀ: restricted maximum likelihood (Patterson and Thompson, Biometrika 58, 1971). Data rarely decide for one
//! K and one λ: the answer is the mean over all of them, weighed by their likelihoods. Where none is evidently better than
//! noise that is each point's own, the answer is that noise. And few patches say little of what is shared widely: its part
//! is as much wider as F of six and ν degrees of freedom is wider than χ², about, with the ν that K leaves (Satterthwaite:
//! tr(M)² / tr(M²)).

use nalgebra::{DMatrix, DVector, SMatrix, SVector, SymmetricTridiagonal};

use crate::rigid::Vec3;

/// Patches at most, and points that one needs.
const PATCHES: usize = 256;
const LEAST: usize = 4;
/// Places are told apart to this share of the points' radius: what the rounding of numbers leaves of the noise is less.
const APART: f64 = 1e-6;
/// What a difference of directions counts beside one of places, over the points' radius, where patches are cut.
const TURNED: f64 = 3.0;
/// Lengths that are tried: the first over the extent of the points, each next one so many times as long.
const FIRST: f64 = 0.003;
const LONGER: f64 = 1.8;
const LENGTHS: i32 = 8;
/// Of errors of faces: how far their near part reaches, and how much larger the part is that all faces of one direction have.
const NEAR: f64 = 0.3;
const WHOLE: f64 = 100.0;
/// How fast that part falls with the directions' difference, beside how fast the nearer ones do.
const ALIKE: f64 = 0.3;
/// Ratios λ that are tried, so many to a decade: what K leaves, λ tr(M²) / tr(M), is 0.1 to 10⁸ times a patch's own part.
const DECADE: i32 = 4;
const DECADES: i32 = 8;
/// Without need none large: the weight falls with this power of it.
const FALLING: f64 = 2.0;
/// By so much the logarithm of the likelihood must be better than that of noise of each point's own before anything is taken
/// for shared: else white noise would be stated 1.3 to 1.4 times as wide as it is.
const EVIDENT: f64 = 3.0;
/// Degrees of freedom are not taken for fewer.
const FREEDOM: f64 = 3.0;

/// A point, as far as this goes.
#[derive(Clone, Copy, Debug)]
struct Sample<const N: usize> {
    at: [f64; 6],
    residual: f64,
    row: SVector<f64, N>,
}

/// Points of about one place and one direction, as their mean.
#[derive(Clone, Copy, Debug)]
struct Patch<const N: usize> {
    mean: Sample<N>,
    /// The mean square of the distances from the middle, in a plane and one direction of it.
    spread: f64,
}

impl<const N: usize> Patch<N> {
    fn of(samples: &[Sample<N>]) -> Self {
        let count = samples.len() as f64;
        let mut mean = Sample {
            at: [0.0; 6],
            residual: 0.0,
            row: SVector::zeros(),
        };
        for s in samples {
            for k in 0..6 {
                mean.at[k] += s.at[k] / count;
            }
            mean.residual += s.residual / count;
            mean.row += s.row / count;
        }
        let square =
            |s: &Sample<N>| -> f64 { (0..3).map(|k| (s.at[k] - mean.at[k]).powi(2)).sum() };
        let spread = samples.iter().map(square).sum::<f64>() / (2.0 * count);
        Self { mean, spread }
    }
}

/// Cuts at the median of what differs most, until there are `count` patches (a power of two).
fn cut<const N: usize>(samples: &mut [Sample<N>], count: usize, into: &mut Vec<Patch<N>>) {
    if count < 2 {
        into.push(Patch::of(samples));
        return;
    }
    let mut sums = [(0.0, 0.0); 6];
    for s in &*samples {
        for (sum, x) in sums.iter_mut().zip(s.at) {
            sum.0 += x;
            sum.1 += x * x;
        }
    }
    let differs = |k: usize| sums[k].1 - sums[k].0 * sums[k].0 / samples.len() as f64;
    let widest = (1..6).fold(0, |a, b| if differs(b) > differs(a) { b } else { a });
    let half = samples.len() / 2;
    samples.select_nth_unstable_by(half, |a, b| a.at[widest].total_cmp(&b.at[widest]));
    let (low, high) = samples.split_at_mut(half);
    cut(low, count / 2, into);
    cut(high, count / 2, into);
}

/// What patches share: K, of which 1 is the mean of the diagonal.
fn covariances<const N: usize>(patches: &[Patch<N>], faces: bool) -> Vec<DMatrix<f64>> {
    let squares = |a: usize, b: usize, of: std::ops::Range<usize>| -> f64 {
        let (a, b) = (&patches[a].mean.at, &patches[b].mean.at);
        of.map(|k| (a[k] - b[k]).powi(2)).sum()
    };
    let count = patches.len();
    let apart = DMatrix::from_fn(count, count, |a, b| squares(a, b, 0..3));
    let turned = DMatrix::from_fn(count, count, |a, b| squares(a, b, 3..6) / (TURNED * TURNED));
    let wide = DMatrix::from_fn(count, count, |a, b| {
        2.0 * (patches[a].spread + patches[b].spread)
    });
    let extent = apart.max().sqrt();
    let all = |k: &dyn Fn(f64, f64, f64) -> f64| -> DMatrix<f64> {
        let k = DMatrix::from_fn(count, count, |a, b| {
            k(apart[(a, b)], wide[(a, b)], turned[(a, b)])
        });
        let mean = k.trace() / count as f64;
        k / mean.max(1e-300)
    };
    // The mean of exp(−r²/L²) over two patches, taken for normal in their planes.
    let mut shared: Vec<DMatrix<f64>> = (0..LENGTHS)
        .map(|step| {
            let square = (FIRST * LONGER.powi(step) * extent).powi(2);
            all(&|r2, wide, turned| {
                square / (square + wide) * (-r2 / (square + wide) - turned).exp()
            })
        })
        .collect();
    if faces {
        shared.push(all(&|r2, wide, turned| {
            let near = (-(r2 + wide).sqrt() / (NEAR * extent)).exp();
            (WHOLE + near) * (-ALIKE * turned).exp()
        }));
    }
    shared
}

/// By how much the sum over all pairs of points of what they share of each other's rows, each with itself, is more than
/// noise of the square `sigma2` that is each point's own would make; in mm².
/// `residual`: what a fit has left of a point's distance, in mm; `direction`: of its distance; `row`: what of the fit moves it;
/// `faces`: whether faces may err as a whole.
pub(in crate::localise) fn shared<const N: usize>(
    points: &[Vec3],
    on_part: &[usize],
    sigma2: f64,
    residual: &impl Fn(usize) -> f64,
    direction: &impl Fn(usize) -> Vec3,
    row: &impl Fn(usize) -> SVector<f64, N>,
    faces: bool,
) -> SMatrix<f64, N, N> {
    let zero = SMatrix::zeros();
    let count = match on_part.len() / LEAST {
        0..8 => return zero,
        fits => PATCHES.min(1 << fits.ilog2()),
    };
    let Some(arm) = radius(points, on_part) else {
        return zero;
    };
    let mut samples: Vec<Sample<N>> = on_part
        .iter()
        .map(|&i| {
            let foot = points[i] - direction(i) * residual(i);
            let p = ((foot - points[on_part[0]]) / arm).map(|x| (x / APART).round() * APART);
            let n = TURNED * direction(i);
            Sample {
                at: [p.x, p.y, p.z, n.x, n.y, n.z],
                residual: residual(i),
                row: row(i),
            }
        })
        .collect();
    let mut patches = Vec::with_capacity(count);
    cut(&mut samples, count, &mut patches);
    let each = on_part.len() as f64 / count as f64;
    let rows = DMatrix::from_fn(count, N, |a, k| patches[a].mean.row[k]);
    let own = rows.transpose() * &rows;
    let Some(inverse) = own.clone().try_inverse() else {
        return zero;
    };
    let taken = &rows * inverse;
    let mut means = DVector::from_fn(count, |a, _| patches[a].mean.residual * each.sqrt());
    means -= &taken * (rows.transpose() * &means);
    let square = means.norm_squared();
    if square <= 0.0 {
        return zero;
    }
    let freedom = (count - N) as f64;
    // The logarithm of the likelihood, and the sum over pairs, of each covariance.
    let own = SMatrix::from_fn(|i, j| own[(i, j)]);
    let mut tried = vec![(
        -0.5 * freedom * (square / freedom).ln(),
        own * (square / freedom),
    )];
    for whole in covariances(&patches, faces) {
        let left = without(&whole, &rows, &taken);
        let (trace, squares) = (left.trace(), left.norm_squared().max(1e-300));
        let nu = (trace * trace / squares).max(FREEDOM);
        // The 95 % point of F, six times, over that of χ²: within 3 % of this from 8 degrees of freedom on.
        let wider = (nu + 2.0) / (nu - 2.0);
        let of_pairs = rows.transpose() * &whole * &rows;
        let of_pairs: SMatrix<f64, N, N> = SMatrix::from_fn(|i, j| of_pairs[(i, j)]);
        let (diagonal, beside) = tridiagonal(&left, &means);
        for step in -DECADE..=DECADES * DECADE {
            let felt = 10.0_f64.powf(f64::from(step) / f64::from(DECADE));
            let ratio = felt * trace / squares;
            // 1 + λK in a basis that begins with the means: its determinant and the first element of its inverse.
            let (mut log, mut last) = (0.0, f64::INFINITY);
            for k in (0..diagonal.len()).rev() {
                let off = beside.get(k).map_or(0.0, |b| ratio * b);
                last = (1.0 + ratio * diagonal[k] - off * off / last).max(1e-12);
                log += last.ln();
            }
            let a = square / last / freedom;
            let likely = -0.5 * (freedom * a.ln() + log) - FALLING * felt.ln_1p();
            tried.push((likely, (own + of_pairs * (ratio * wider)) * a));
        }
    }
    let best = tried.iter().map(|t| t.0).fold(f64::NEG_INFINITY, f64::max);
    let alone = tried[0];
    if best < alone.0 + EVIDENT {
        return (alone.1 - own * sigma2) * each;
    }
    let weights: f64 = tried.iter().map(|t| (t.0 - best).exp()).sum();
    let mean: SMatrix<f64, N, N> = tried
        .iter()
        .map(|t| t.1 * ((t.0 - best).exp() / weights))
        .sum();
    (mean - own * sigma2) * each
}

/// The root of the mean squared distance from the middle, in mm; none if there is no extent.
fn radius(points: &[Vec3], on_part: &[usize]) -> Option<f64> {
    let first = points[*on_part.first()?];
    let count = on_part.len() as f64;
    let middle = on_part.iter().map(|&i| points[i] - first).sum::<Vec3>() / count;
    let squares = |&i: &usize| (points[i] - first - middle).norm_squared();
    let radius = (on_part.iter().map(squares).sum::<f64>() / count).sqrt();
    (radius > 0.0).then_some(radius)
}

/// A symmetric matrix in an orthonormal basis that begins with `first`: its diagonal, and what stands beside that.
fn tridiagonal(matrix: &DMatrix<f64>, first: &DVector<f64>) -> (Vec<f64>, Vec<f64>) {
    let count = first.len();
    // Householder's reflections, begun with a column that `first` borders the matrix with.
    let mut bordered = DMatrix::zeros(count + 1, count + 1);
    bordered.view_mut((1, 1), (count, count)).copy_from(matrix);
    bordered.view_mut((1, 0), (count, 1)).copy_from(first);
    bordered
        .view_mut((0, 1), (1, count))
        .copy_from(&first.transpose());
    let (diagonal, beside) = SymmetricTridiagonal::new(bordered).unpack_tridiagonal();
    (
        diagonal.as_slice()[1..].to_vec(),
        beside.as_slice()[1..].to_vec(),
    )
}

/// (1 − H) C (1 − H), with H = `taken` · `rows`ᵀ.
fn without(whole: &DMatrix<f64>, rows: &DMatrix<f64>, taken: &DMatrix<f64>) -> DMatrix<f64> {
    let once = whole - taken * (rows.transpose() * whole);
    &once - (&once * rows) * taken.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::localise::tests::Random;

    /// Two steps of one direction, of a bar of 76 mm: the widest cut goes through one of them, along its normal. White noise
    /// is no error that neighbours share, then either. Cut by where the points are measured, the patches' means would have 20 to
    /// 30 times the noise's square.
    #[test]
    fn no_cut_divides_the_points_of_a_face_by_their_own_noise() {
        let mut random = Random(61);
        let mut of_scan = |_: usize| {
            let (u, v) = (random.next(), random.next());
            let (foot, normal) = match (random.next() * 10.0) as usize {
                0..3 => (Vec3::new(76.0 * u, 15.0 * v, 0.0), Vec3::z()),
                3..5 => (Vec3::new(76.0 * u, 15.0 + 10.0 * v, -14.0), Vec3::z()),
                5..9 => (Vec3::new(76.0 * u, 0.0, -40.0 * v), -Vec3::y()),
                _ => (Vec3::new(0.0, 25.0 * u, -40.0 * v), -Vec3::x()),
            };
            (foot, normal, 0.15 * random.vector().x)
        };
        let all: Vec<(Vec3, Vec3, f64)> = (0..60_000).map(&mut of_scan).collect();
        let points: Vec<Vec3> = all.iter().map(|(foot, n, off)| foot + n * *off).collect();
        let on_part: Vec<usize> = (0..all.len()).collect();
        let sigma2 = all.iter().map(|one| one.2 * one.2).sum::<f64>() / all.len() as f64;
        let row = |i: usize| {
            let (n, turn) = (all[i].1, points[i].cross(&all[i].1) / 40.0);
            SVector::from([-turn.x, -turn.y, -turn.z, -n.x, -n.y, -n.z])
        };
        let by = |faces: bool| {
            let (left, direction) = (|i: usize| all[i].2, |i: usize| all[i].1);
            shared::<6>(&points, &on_part, sigma2, &left, &direction, &row, faces).trace()
        };
        let squares = |i: &usize| row(*i).norm_squared();
        let own = sigma2 * on_part.iter().map(squares).sum::<f64>();
        for faces in [false, true] {
            assert!(by(faces).abs() < 0.4 * own, "{} {own}", by(faces));
        }
    }
}
