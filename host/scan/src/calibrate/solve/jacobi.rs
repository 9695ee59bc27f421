//! Singular values of small matrices by rotations of their columns (Hestenes, 1958; Drmač and Veselić,
//! 2008): exact up to rounding also where columns depend on each other, which is what the solver asks
//! about. (nalgebra's own decomposition gave wrong directions for some matrices of rank 1.)

use nalgebra::{DMatrix, DVector};

/// Sweeps over all pairs of columns; a handful are enough.
const MOST_SWEEPS: usize = 60;

/// `A = U diag(values) Vᵀ`, values falling.
pub(super) struct Jacobi {
    /// Orthonormal columns; a column of zeros where the value is 0.
    pub u: DMatrix<f64>,
    /// Singular values.
    pub values: DVector<f64>,
    /// Orthogonal.
    pub v: DMatrix<f64>,
}

impl Jacobi {
    /// Decomposes.
    pub fn new(mut a: DMatrix<f64>) -> Self {
        let columns = a.ncols();
        let mut v = DMatrix::identity(columns, columns);
        for _ in 0..MOST_SWEEPS {
            let mut turned = false;
            for p in 0..columns {
                for q in p + 1..columns {
                    turned |= turn(&mut a, &mut v, p, q);
                }
            }
            if !turned {
                break;
            }
        }
        let norms: Vec<f64> = a.column_iter().map(|column| column.norm()).collect();
        let mut order: Vec<usize> = (0..columns).collect();
        order.sort_by(|&i, &k| norms[k].total_cmp(&norms[i]));
        let mut u = a.select_columns(&order);
        let values = DVector::from_iterator(columns, order.iter().map(|&i| norms[i]));
        for (mut column, norm) in u.column_iter_mut().zip(values.iter()) {
            if *norm > 0.0 {
                column /= *norm;
            }
        }
        Self {
            u,
            values,
            v: v.select_columns(&order),
        }
    }

    /// The largest singular value, 0 of no columns.
    pub fn largest(&self) -> f64 {
        self.values.iter().copied().next().unwrap_or(0.0)
    }
}

/// Makes two columns square to each other; whether they were not.
fn turn(a: &mut DMatrix<f64>, v: &mut DMatrix<f64>, p: usize, q: usize) -> bool {
    let (x, y) = (a.column(p).norm(), a.column(q).norm());
    // Columns of unit length first: squares of small ones would be lost.
    if x == 0.0 || y == 0.0 {
        return false;
    }
    let cosine = a.column(p).dot(&a.column(q)) / x / y;
    if cosine.is_nan() || cosine.abs() <= 1e-15 {
        return false;
    }
    let zeta = (y / x - x / y) / (2.0 * cosine);
    let t = if zeta.is_finite() {
        zeta.signum() / (zeta.abs() + zeta.hypot(1.0))
    } else {
        0.0
    };
    let c = 1.0 / t.hypot(1.0);
    let s = c * t;
    for matrix in [a, v] {
        for i in 0..matrix.nrows() {
            let (one, other) = (matrix[(i, p)], matrix[(i, q)]);
            matrix[(i, p)] = c * one - s * other;
            matrix[(i, q)] = s * one + c * other;
        }
    }
    t != 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(a: &DMatrix<f64>, within: f64) -> Jacobi {
        let found = Jacobi::new(a.clone());
        let back = &found.u * DMatrix::from_diagonal(&found.values) * found.v.transpose();
        assert!((back - a).amax() <= within * a.amax(), "{a}");
        let square = found.v.tr_mul(&found.v);
        assert!((square - DMatrix::identity(a.ncols(), a.ncols())).amax() < 1e-14);
        assert!(found.values.iter().is_sorted_by(|a, b| a >= b));
        found
    }

    /// Any rank, down to 1 and 0, and columns of very different size.
    #[test]
    fn what_is_taken_apart_comes_together_again() {
        let mut state = 1_u64;
        let mut random = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        for rank in 0..=6 {
            for _ in 0..20 {
                let left = DMatrix::from_fn(10, rank, |_, _| random());
                let right = DMatrix::from_fn(rank, 6, |_, _| random());
                let found = check(&(left * right), 1e-14);
                let seen = found
                    .values
                    .iter()
                    .filter(|v| **v > 1e-13 * found.largest());
                assert_eq!(seen.count(), rank);
            }
        }
        let graded = DMatrix::from_fn(8, 4, |_, k| random() * 10_f64.powi(-5 * k as i32));
        check(&graded, 1e-14);
        assert_eq!(Jacobi::new(DMatrix::zeros(5, 0)).largest(), 0.0);
    }
}
