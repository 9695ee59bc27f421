//! A surface that was cut against the one that was meant.

use super::{CylinderArc, Grid, Workpiece};

/// The deviation of every node from the nominal surface, along its normal.
#[derive(Clone, Debug)]
pub struct Deviations {
    grid: Grid,
    /// Row by row.
    mm: Vec<f64>,
    cut: Vec<bool>,
}

/// Figures of a region, as a deviation report of a scan states them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Nodes in the region.
    pub nodes: usize,
    /// Of these, nodes that no tool has touched; they count with the raw surface.
    pub uncut: usize,
    /// Mean, mm.
    pub mean_mm: f64,
    /// Standard deviation about the mean, mm (divided by n - 1).
    pub std_mm: f64,
    /// Smallest, mm.
    pub min_mm: f64,
    /// Largest, mm.
    pub max_mm: f64,
    /// Mean of the deviations above zero, mm; 0 if there are none. Inspection
    /// reports print "average +a/-b": this is a.
    pub mean_above_mm: f64,
    /// Mean of the deviations below zero, mm; 0 if there are none. This is -b.
    pub mean_below_mm: f64,
}

impl Deviations {
    /// Measures a workpiece against its nominal surface, in the workpiece's frame.
    #[must_use]
    pub fn of(workpiece: &Workpiece, nominal: &CylinderArc) -> Self {
        let grid = *workpiece.grid();
        let mm = workpiece
            .heights_mm()
            .chunks(grid.columns())
            .enumerate()
            .flat_map(|(row, heights)| {
                let y = grid.row_mm(row);
                heights.iter().map(move |&z| nominal.deviation_mm(y, z))
            })
            .collect();
        Self {
            grid,
            mm,
            cut: workpiece.cut().to_vec(),
        }
    }

    /// The grid.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The deviation of a node, mm, and whether a tool has touched it; None outside
    /// the grid.
    #[must_use]
    pub fn at(&self, column: usize, row: usize) -> Option<(f64, bool)> {
        if column >= self.grid.columns() {
            return None;
        }
        let node = row.checked_mul(self.grid.columns())?.checked_add(column)?;
        Some((*self.mm.get(node)?, *self.cut.get(node)?))
    }

    /// The figures of the region that `inside` (x, y in mm) selects; None if it
    /// has no node.
    #[must_use]
    pub fn statistics(&self, inside: impl Fn(f64, f64) -> bool) -> Option<Statistics> {
        let mut sum = Sum::default();
        let rows = self.mm.chunks(self.grid.columns());
        let cut = self.cut.chunks(self.grid.columns());
        for (row, (deviations, cut)) in rows.zip(cut).enumerate() {
            let y = self.grid.row_mm(row);
            for (column, (&mm, &cut)) in deviations.iter().zip(cut).enumerate() {
                if inside(self.grid.column_mm(column), y) {
                    sum.take(mm, cut);
                }
            }
        }
        sum.finish()
    }
}

/// Running sums (mean and squares: B. P. Welford, Technometrics 4, 1962, so that
/// no digits are lost in a difference of large sums).
#[derive(Default)]
struct Sum {
    figures: Statistics,
    squares: f64,
    above: (f64, f64),
    below: (f64, f64),
}

impl Sum {
    #[allow(clippy::cast_precision_loss, reason = "node counts are far below 2^52")]
    fn take(&mut self, mm: f64, cut: bool) {
        let figures = &mut self.figures;
        if figures.nodes == 0 {
            (figures.min_mm, figures.max_mm) = (mm, mm);
        }
        figures.nodes += 1;
        figures.uncut += usize::from(!cut);
        let off = mm - figures.mean_mm;
        figures.mean_mm += off / figures.nodes as f64;
        self.squares += off * (mm - figures.mean_mm);
        figures.min_mm = figures.min_mm.min(mm);
        figures.max_mm = figures.max_mm.max(mm);
        let side = if mm > 0.0 {
            &mut self.above
        } else if mm < 0.0 {
            &mut self.below
        } else {
            return;
        };
        side.0 += mm;
        side.1 += 1.0;
    }

    #[allow(clippy::cast_precision_loss, reason = "node counts are far below 2^52")]
    fn finish(self) -> Option<Statistics> {
        let mean = |(sum, count): (f64, f64)| if count > 0.0 { sum / count } else { 0.0 };
        let mut figures = self.figures;
        if figures.nodes == 0 {
            return None;
        }
        if figures.nodes > 1 {
            figures.std_mm = (self.squares / (figures.nodes - 1) as f64).sqrt();
        }
        figures.mean_above_mm = mean(self.above);
        figures.mean_below_mm = mean(self.below);
        Some(figures)
    }
}
