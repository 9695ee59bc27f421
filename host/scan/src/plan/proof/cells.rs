//! Points in cells, so that a question looks at those near by alone.

use nalgebra::Vector3;

/// Points by the cell they lie in.
pub struct Cells {
    size: f64,
    low: Vector3<f64>,
    counts: [usize; 3],
    starts: Vec<u32>,
    order: Vec<u32>,
}

impl Cells {
    /// Cells of `wanted_mm`, or larger where they would be more than the points deserve.
    pub fn new(points: &[Vector3<f64>], wanted_mm: f64) -> Self {
        let (low, high) = points.iter().fold(
            (
                Vector3::repeat(f64::INFINITY),
                Vector3::repeat(f64::NEG_INFINITY),
            ),
            |(l, h), p| (l.inf(p), h.sup(p)),
        );
        let counts_at = |size: f64| -> [usize; 3] {
            std::array::from_fn(|k| {
                let n = (high[k] - low[k]) / size;
                // Not a number where there is no point.
                if n.is_finite() { n as usize + 1 } else { 1 }
            })
        };
        let most = 8 * points.len() + 64;
        let mut size = wanted_mm.max(1e-6);
        let mut counts = counts_at(size);
        while counts.iter().fold(1, |p: usize, n| p.saturating_mul(*n)) > most {
            size *= 1.3;
            counts = counts_at(size);
        }
        let mut cells = Cells {
            size,
            low,
            counts,
            starts: vec![0; counts.iter().product::<usize>() + 1],
            order: vec![0; points.len()],
        };
        let homes: Vec<usize> = points.iter().map(|p| cells.home(p)).collect();
        for &h in &homes {
            cells.starts[h + 1] += 1;
        }
        for k in 1..cells.starts.len() {
            cells.starts[k] += cells.starts[k - 1];
        }
        let mut next = cells.starts.clone();
        for (i, &h) in homes.iter().enumerate() {
            cells.order[next[h] as usize] = i as u32;
            next[h] += 1;
        }
        cells
    }

    fn place(&self, at: &Vector3<f64>, k: usize) -> usize {
        (((at[k] - self.low[k]) / self.size).max(0.0) as usize).min(self.counts[k] - 1)
    }

    fn home(&self, at: &Vector3<f64>) -> usize {
        (self.place(at, 0) * self.counts[1] + self.place(at, 1)) * self.counts[2]
            + self.place(at, 2)
    }

    /// Calls for every point in the cells that an upright box meets: all that lie in it, and some beside it.
    pub fn within(&self, low: &Vector3<f64>, high: &Vector3<f64>, mut each: impl FnMut(usize)) {
        self.any(low, high, |i| {
            each(i);
            false
        });
    }

    /// Does the question hold for any point in the cells that an upright box meets?
    pub fn any(
        &self,
        low: &Vector3<f64>,
        high: &Vector3<f64>,
        mut holds: impl FnMut(usize) -> bool,
    ) -> bool {
        let beyond = |k: usize| {
            // The cells end where the points do.
            high[k] < self.low[k] || low[k] > self.low[k] + self.size * self.counts[k] as f64
        };
        if self.order.is_empty() || (0..3).any(beyond) {
            return false;
        }
        for x in self.place(low, 0)..=self.place(high, 0) {
            for y in self.place(low, 1)..=self.place(high, 1) {
                let row = (x * self.counts[1] + y) * self.counts[2];
                let (from, to) = (row + self.place(low, 2), row + self.place(high, 2));
                let here = self.starts[from] as usize..self.starts[to + 1] as usize;
                if self.order[here].iter().any(|&i| holds(i as usize)) {
                    return true;
                }
            }
        }
        false
    }

    /// Does the question hold for any point within `reach` of a place, and some beside it?
    pub fn any_near(
        &self,
        at: &Vector3<f64>,
        reach: f64,
        holds: impl FnMut(usize) -> bool,
    ) -> bool {
        let r = Vector3::repeat(reach);
        self.any(&(at - r), &(at + r), holds)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::Cells;

    #[test]
    fn every_point_of_a_box_is_asked_for() {
        let golden = |k: usize, by: f64| (k as f64 * by).fract();
        let points: Vec<Vector3<f64>> = (0..500)
            .map(|k| {
                Vector3::new(
                    golden(k, 0.754_877) * 90.0,
                    golden(k, 0.569_840) * 40.0,
                    golden(k, 0.618_034) * 3.0,
                )
            })
            .collect();
        let cells = Cells::new(&points, 2.0);
        for k in 0..200 {
            let low = points[k] - Vector3::new(7.0, 3.0 * golden(k, 0.31), 1.0);
            let high = points[k] + Vector3::new(0.0, 5.0, 20.0 * golden(k, 0.77));
            let mut asked = vec![false; points.len()];
            cells.within(&low, &high, |i| asked[i] = true);
            for (i, p) in points.iter().enumerate() {
                let inside = (0..3).all(|k| p[k] >= low[k] && p[k] <= high[k]);
                assert!(!inside || asked[i]);
            }
        }
        assert!(!cells.any_near(&Vector3::new(500.0, 0.0, 0.0), 9.0, |_| true));
        assert!(!Cells::new(&[], 2.0).any_near(&Vector3::zeros(), 9.0, |_| true));
    }
}
