//! Symmetric systems of a few unknowns, also where they have no full rank.

use nalgebra::SMatrix;
use nalgebra::SVector;

/// Eigenvalues (ascending) and eigenvectors (columns) of a symmetric matrix, by Jacobi's rotations: exact to the last
/// digits also for the small ones.
#[must_use]
pub fn eigen<const N: usize>(matrix: &SMatrix<f64, N, N>) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
    let mut a = *matrix;
    let mut v = SMatrix::<f64, N, N>::identity();
    for _ in 0..60 {
        let mut off = 0.0;
        for p in 0..N {
            for q in p + 1..N {
                off += a[(p, q)] * a[(p, q)];
            }
        }
        if off.is_nan() || off <= 1e-40 * a.norm_squared() {
            break;
        }
        for p in 0..N {
            for q in p + 1..N {
                if a[(p, q)] == 0.0 {
                    continue;
                }
                let theta = (a[(q, q)] - a[(p, p)]) / (2.0 * a[(p, q)]);
                let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for k in 0..N {
                    let (x, y) = (a[(k, p)], a[(k, q)]);
                    a[(k, p)] = c * x - s * y;
                    a[(k, q)] = s * x + c * y;
                }
                for k in 0..N {
                    let (x, y) = (a[(p, k)], a[(q, k)]);
                    a[(p, k)] = c * x - s * y;
                    a[(q, k)] = s * x + c * y;
                    let (x, y) = (v[(k, p)], v[(k, q)]);
                    v[(k, p)] = c * x - s * y;
                    v[(k, q)] = s * x + c * y;
                }
            }
        }
    }
    let mut order: [usize; N] = std::array::from_fn(|i| i);
    order.sort_by(|&i, &j| a[(i, i)].total_cmp(&a[(j, j)]));
    (
        SVector::from_fn(|i, _| a[(order[i], order[i])]),
        SMatrix::from_fn(|k, i| v[(k, order[i])]),
    )
}

/// The shortest `x` with `matrix · x = right` for a symmetric matrix that is not negative; directions whose eigenvalue
/// is less than `least` of the largest stay zero.
#[must_use]
pub fn pseudo_solve<const N: usize>(
    matrix: &SMatrix<f64, N, N>,
    right: &SVector<f64, N>,
    least: f64,
) -> SVector<f64, N> {
    let (values, vectors) = eigen(matrix);
    let floor = values[N - 1].max(0.0) * least;
    let mut x = SVector::<f64, N>::zeros();
    for i in 0..N {
        if values[i] > floor {
            let v = vectors.column(i);
            x += v * (v.dot(right) / values[i]);
        }
    }
    x
}

/// The median; 0 of nothing. The order of `values` changes.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    #[test]
    fn a_system_without_full_rank_has_its_shortest_solution() {
        let a = Vector3::new(1.0, 2.0, -1.0);
        let b = Vector3::new(0.5, 0.0, 3.0);
        let matrix: Matrix3<f64> = a * a.transpose() * 3.0 + b * b.transpose();
        let x = a * 0.3 - b * 2.0;
        assert!((pseudo_solve(&matrix, &(matrix * x), 1e-12) - x).norm() < 1e-12);
        let (values, vectors) = eigen(&matrix);
        assert!(values[0].abs() < 1e-14);
        assert!((matrix * vectors.column(2) - vectors.column(2) * values[2]).norm() < 1e-12);
    }
}
