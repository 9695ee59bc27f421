//! The largest least value: maximise `s` with `m_i + a_i·y ≥ s` for all i and |y_j| ≤ R.
//!
//! Solved by the simplex method on the dual, whose basis is as small as y: weights λ of the rows that hold the
//! solution. A step prices all rows, so that a million of them take no more memory than they are.

use nalgebra::{SMatrix, SVector};

/// Components of y at most.
pub const WIDTH: usize = 6;
const SIZE: usize = WIDTH + 1;

/// A row: the value where y = 0 and its gradient.
#[derive(Clone, Copy, Debug)]
pub struct MarginRow {
    /// m.
    pub value: f64,
    /// a; zero where a component is locked.
    pub gradient: [f64; WIDTH],
}

/// The solution.
#[derive(Clone, Copy, Debug)]
pub struct Highest {
    /// y.
    pub step: [f64; WIDTH],
    /// The least value there, s.
    pub least: f64,
}

/// Columns of the dual: a row of the programme, or the upper or lower bound of a component.
#[derive(Clone, Copy, PartialEq)]
enum Column {
    MarginRow(usize),
    Bound(usize, f64),
}

/// Pivots at most; what is found by then is feasible and is returned.
const PIVOTS: usize = 2000;

/// Maximises the least of `rows` within |y| ≤ `reach`. None without rows.
#[must_use]
pub fn highest(rows: &[MarginRow], reach: f64) -> Option<Highest> {
    let first = (0..rows.len()).min_by(|&i, &j| rows[i].value.total_cmp(&rows[j].value))?;
    // Dual: minimise Σ λ m + R Σ (u + v) with Σ λ a + u − v = 0, Σ λ = 1; all ≥ 0.
    let mut basis = [Column::MarginRow(first); SIZE];
    for (j, slope) in rows[first].gradient.iter().enumerate() {
        basis[j] = Column::Bound(j, if *slope > 0.0 { -1.0 } else { 1.0 });
    }
    let column = |c: Column| -> SVector<f64, SIZE> {
        let mut v = SVector::<f64, SIZE>::zeros();
        match c {
            Column::MarginRow(i) => {
                for j in 0..WIDTH {
                    v[j] = rows[i].gradient[j];
                }
                v[WIDTH] = 1.0;
            }
            Column::Bound(j, sign) => v[j] = sign,
        }
        v
    };
    let price = |c: Column| match c {
        Column::MarginRow(i) => rows[i].value,
        Column::Bound(..) => reach,
    };
    let mut right = SVector::<f64, SIZE>::zeros();
    right[WIDTH] = 1.0;
    let mut best = Highest {
        step: [0.0; WIDTH],
        least: rows[first].value,
    };
    for pivot in 0..PIVOTS {
        let matrix = SMatrix::<f64, SIZE, SIZE>::from_fn(|r, c| column(basis[c])[r]);
        let Some(inverse) = matrix.try_inverse() else {
            break;
        };
        let prices = SVector::<f64, SIZE>::from_fn(|c, _| price(basis[c]));
        // y = −π, s = π of the last equation: reduced costs are what the rows are short of.
        let multipliers = inverse.tr_mul(&prices);
        let reduced_row = |row: &MarginRow| {
            let mut sum = row.value - multipliers[WIDTH];
            for j in 0..WIDTH {
                sum -= multipliers[j] * row.gradient[j];
            }
            sum
        };
        let mut enter = None;
        // The tolerance is far below what is asked of the result (1e-3 mm), and above rounding.
        let mut low = -1e-11;
        // After many pivots the first candidate instead of the best: that cannot go in a circle.
        let bland = pivot > PIVOTS / 2;
        for j in 0..WIDTH {
            for sign in [1.0, -1.0] {
                let reduced = reach - sign * multipliers[j];
                if reduced < low && !(bland && enter.is_some()) {
                    (low, enter) = (reduced, Some(Column::Bound(j, sign)));
                }
            }
        }
        let mut short = f64::INFINITY;
        for (i, row) in rows.iter().enumerate() {
            let reduced = reduced_row(row);
            short = short.min(reduced);
            if reduced < low && !(bland && enter.is_some()) {
                (low, enter) = (reduced, Some(Column::MarginRow(i)));
            }
        }
        // Every basis gives a y; where it is within reach, the least value there counts.
        let step: [f64; WIDTH] = std::array::from_fn(|j| (-multipliers[j]).clamp(-reach, reach));
        if enter.is_none() {
            best = Highest {
                step,
                least: multipliers[WIDTH] + short.min(0.0),
            };
            break;
        }
        let Some(enter) = enter else { break };
        let direction = inverse * column(enter);
        let amounts = inverse * right;
        let mut leave = None;
        let mut ratio = f64::INFINITY;
        for k in 0..SIZE {
            if direction[k] > 1e-12 {
                let this = amounts[k].max(0.0) / direction[k];
                if this < ratio {
                    (ratio, leave) = (this, Some(k));
                }
            }
        }
        let Some(leave) = leave else { break };
        basis[leave] = enter;
    }
    Some(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_is_centred_between_its_walls() {
        // Six walls of a box, each with its own distance: the middle of the narrowest pair counts.
        let mut rows = Vec::new();
        for (axis, low, high) in [(0, 1.0, 3.0), (1, 5.0, 2.0), (2, 0.5, 0.9)] {
            let mut gradient = [0.0; WIDTH];
            gradient[axis] = 1.0;
            rows.push(MarginRow {
                value: low,
                gradient,
            });
            gradient[axis] = -1.0;
            rows.push(MarginRow {
                value: high,
                gradient,
            });
        }
        let free = highest(&rows, 10.0).unwrap();
        assert!((free.least - 0.7).abs() < 1e-12, "{free:?}");
        assert!((free.step[2] - 0.2).abs() < 1e-12);
        let near = highest(&rows, 0.1).unwrap();
        assert!((near.least - 0.6).abs() < 1e-12, "{near:?}");
    }

    #[test]
    fn no_better_step_is_found_by_trying() {
        let mut state = 5_u64;
        let mut random = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
        };
        let rows: Vec<MarginRow> = (0..200)
            .map(|_| MarginRow {
                value: random(),
                gradient: std::array::from_fn(|_| random()),
            })
            .collect();
        let least = |y: &[f64; WIDTH]| {
            rows.iter()
                .map(|r| r.value + (0..WIDTH).map(|j| r.gradient[j] * y[j]).sum::<f64>())
                .fold(f64::INFINITY, f64::min)
        };
        for reach in [1e-3, 0.1, 5.0] {
            let best = highest(&rows, reach).unwrap();
            assert!((least(&best.step) - best.least).abs() < 1e-9);
            assert!(best.least > least(&[0.0; WIDTH]));
            for _ in 0..2000 {
                let y = std::array::from_fn(|j| {
                    (best.step[j] + random() * reach * 0.1).clamp(-reach, reach)
                });
                assert!(least(&y) <= best.least + 1e-9);
            }
        }
    }
}
