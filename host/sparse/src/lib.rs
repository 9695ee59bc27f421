//! Large sparse systems of least squares, by `faer`'s Cholesky factorisation.
//!
//! The order of elimination keeps the factor of a surface's mesh sparse: memory and time grow little faster than the
//! mesh. One thread, so that the same system has the same bits on every machine.

use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Side, prelude::Solve};

/// A symmetric matrix without negative eigenvalues, of which the lower half is told.
#[derive(Debug)]
pub struct SparseSystem {
    size: usize,
    entries: Vec<Triplet<u32, u32, f64>>,
}

/// Added to the diagonal as a share of it, so that rounding does not make a pivot negative.
const SHIFT: f64 = 1e-13;

impl SparseSystem {
    /// A matrix of zeros; `entries` is how many numbers it will be told, about.
    #[must_use]
    pub fn new(size: u32, entries: usize) -> Self {
        Self {
            size: size as usize,
            entries: Vec::with_capacity(entries),
        }
    }

    /// Adds to an element; whole elements as well as their parts may be told. Above the diagonal nothing is kept: there
    /// the matrix is as below it. A place outside makes [`Self::solve`] give none.
    pub fn add(&mut self, row: u32, column: u32, value: f64) {
        if row >= column {
            self.entries.push(Triplet {
                row,
                col: column,
                val: value * if row == column { 1.0 + SHIFT } else { 1.0 },
            });
        }
    }

    /// The solution for a right side; none where the matrix is singular or has a negative eigenvalue, where a number in it
    /// is not finite, or where the right side has another length.
    #[must_use]
    pub fn solve(self, right: &[f64]) -> Option<Vec<f64>> {
        if right.len() != self.size {
            return None;
        }
        let matrix =
            SparseColMat::try_new_from_triplets(self.size, self.size, &self.entries).ok()?;
        drop(self.entries);
        let factor = matrix.sp_cholesky(Side::Lower).ok()?;
        let solution = factor.solve(&Mat::from_fn(self.size, 1, |k, _| right[k]));
        let found: Vec<f64> = (0..self.size).map(|k| solution[(k, 0)]).collect();
        found.iter().all(|v| v.is_finite()).then_some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::SparseSystem;

    fn system(size: u32, entries: &[(u32, u32, f64)]) -> SparseSystem {
        let mut system = SparseSystem::new(size, entries.len());
        for (row, column, value) in entries {
            system.add(*row, *column, *value);
        }
        system
    }

    #[test]
    fn a_system_is_solved() {
        // By hand: 4x + y = 6, x + 3y = 7, 2z = 5. The second element is told in two parts.
        let entries = [
            (0, 0, 4.0),
            (1, 0, 0.25),
            (1, 0, 0.75),
            (0, 1, 1.0),
            (1, 1, 3.0),
            (2, 2, 2.0),
        ];
        let x = system(3, &entries).solve(&[6.0, 7.0, 5.0]).unwrap();
        for (found, wanted) in x.iter().zip([1.0, 2.0, 2.5]) {
            assert!((*found - wanted).abs() < 1e-11_f64, "{x:?}");
        }
    }

    #[test]
    fn a_chain_of_springs_stretches_evenly() {
        // The first end is held at 0, the last pulled with 1: x_k = k + 1.
        let n = 20_000;
        let mut chain = SparseSystem::new(n, 3 * n as usize);
        for k in 0..n {
            chain.add(k, k, if k + 1 < n { 2.0 } else { 1.0 });
            if k > 0 {
                chain.add(k, k - 1, -1.0);
            }
        }
        let mut right = vec![0.0; n as usize];
        right[n as usize - 1] = 1.0;
        let x = chain.solve(&right).unwrap();
        for (k, found) in x.iter().enumerate() {
            assert!((found / (k as f64 + 1.0) - 1.0).abs() < 1e-4, "{k} {found}");
        }
    }

    #[test]
    fn what_has_no_solution_has_none() {
        assert!(
            system(2, &[(0, 0, 1.0), (1, 0, -2.0), (1, 1, 1.0)])
                .solve(&[1.0, 1.0])
                .is_none()
        );
        assert!(system(2, &[(0, 0, 1.0)]).solve(&[1.0, 1.0]).is_none());
        assert!(system(1, &[(0, 0, f64::NAN)]).solve(&[1.0]).is_none());
        assert!(system(1, &[(0, 0, 1.0)]).solve(&[1.0, 1.0]).is_none());
        assert!(system(1, &[(3, 0, 1.0)]).solve(&[1.0]).is_none());
        assert_eq!(system(0, &[]).solve(&[]), Some(Vec::new()));
    }
}
