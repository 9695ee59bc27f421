//! Deviation of a cut surface from its nominal.

use nalgebra::{Matrix4, Vector4};

use super::{CylinderArc, Grid, Workpiece};

/// The deviation of every node from the nominal surface, along its normal.
#[derive(Clone, Debug)]
pub struct SurfaceDeviations {
    grid: Grid,
    /// Row by row.
    mm: Vec<f64>,
    cut: Vec<bool>,
}

/// Figures of a region, as a deviation report of a scan states them. All but the
/// counts are of the nodes that a tool has touched (0 if there are none): raw surface
/// says nothing of how well was cut.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeviationStatistics {
    /// Nodes in the region.
    pub nodes: usize,
    /// Of these, nodes that no tool has touched.
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

impl DeviationStatistics {
    /// Nodes that a tool has touched.
    #[must_use]
    pub fn cut(&self) -> usize {
        self.nodes.saturating_sub(self.uncut)
    }

    /// Part of the nodes that no tool has touched, 0 to 1; 0 without nodes.
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "node counts are far below 2^52")]
    pub fn share_uncut(&self) -> f64 {
        self.uncut as f64 / self.nodes.max(1) as f64
    }
}

impl SurfaceDeviations {
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

    /// The deviations from the nominal surface after it was laid on the cut nodes of
    /// the region that `inside` (x, y in mm) selects, by least squares of the
    /// deviations. None if these nodes do not say how it lies.
    ///
    /// The motion is a small rigid one. Of its six parts a cylinder about X shows four:
    /// with `a` the angle about the axis, counted from the region's middle, a shift along
    /// the normal there changes the deviation by `cos a`, one along the tangent (about
    /// the same as a tilt about X) by `sin a`, and turning about the tangent and the
    /// normal by `x cos a` and `x sin a`. The radius stays nominal.
    #[must_use]
    pub fn laid_on(
        &self,
        nominal: &CylinderArc,
        inside: impl Fn(f64, f64) -> bool,
    ) -> Option<Self> {
        let all: Vec<(f64, f64, f64)> = self.nodes().map(|(x, y, mm, _)| (x, y, mm)).collect();
        let mut cut = self.cut.iter();
        let wanted: Vec<bool> = all
            .iter()
            .map(|(x, y, _)| cut.next().is_some_and(|cut| *cut) && inside(*x, *y))
            .collect();
        let mm = lay(nominal, self.grid.x_mm(), &all, &wanted)?;
        Some(Self {
            grid: self.grid,
            mm,
            cut: self.cut.clone(),
        })
    }

    /// Every node: x, y, deviation, whether it was cut; row by row.
    fn nodes(&self) -> impl Iterator<Item = (f64, f64, f64, bool)> + '_ {
        let columns = self.grid.columns();
        let values = self.mm.iter().zip(&self.cut).enumerate();
        values.map(move |(node, (&mm, &cut))| {
            let x = self.grid.column_mm(node % columns);
            (x, self.grid.row_mm(node / columns), mm, cut)
        })
    }

    /// The figures of the region that `inside` (x, y in mm) selects; None if it
    /// has no node.
    #[must_use]
    pub fn statistics(&self, inside: impl Fn(f64, f64) -> bool) -> Option<DeviationStatistics> {
        let mut sum = Sum::default();
        for (x, y, mm, cut) in self.nodes() {
            if inside(x, y) {
                sum.take(mm, cut);
            }
        }
        sum.finish()
    }
}

/// What [`SurfaceDeviations::laid_on`] does, for any points: x, y and deviation of each from an arc
/// about X, and between which x they lie.
#[must_use]
pub fn laid_on(
    nominal: &CylinderArc,
    x_mm: [f64; 2],
    points: &[(f64, f64, f64)],
    inside: impl Fn(f64, f64) -> bool,
) -> Option<Vec<f64>> {
    let wanted: Vec<bool> = points.iter().map(|(x, y, _)| inside(*x, *y)).collect();
    lay(nominal, x_mm, points, &wanted)
}

fn lay(
    nominal: &CylinderArc,
    [left, right]: [f64; 2],
    points: &[(f64, f64, f64)],
    wanted: &[bool],
) -> Option<Vec<f64>> {
    let angle = |y: f64| {
        let sine = (y - nominal.axis_y_mm) / nominal.radius_mm;
        sine.clamp(-1.0, 1.0).asin()
    };
    let inside = || {
        let all = points.iter().zip(wanted);
        all.filter_map(|(point, wanted)| wanted.then_some(point))
    };
    let (mut sum, mut count) = (0.0, 0.0);
    for (_, y, _) in inside() {
        sum += angle(*y);
        count += 1.0;
    }
    let middle = sum / count;
    let shape = |x: f64, y: f64| {
        let (sin, cos) = (angle(y) - middle).sin_cos();
        // -1 to 1, so that all parts are of one size.
        let along = (2.0 * x - left - right) / (right - left);
        Vector4::new(cos, sin, along * cos, along * sin)
    };
    let (mut squares, mut right_side) = (Matrix4::zeros(), Vector4::zeros());
    for (x, y, mm) in inside() {
        let row = shape(*x, *y);
        squares += row * row.transpose();
        right_side += row * *mm;
    }
    let motion = squares.cholesky()?.solve(&right_side);
    let laid = points.iter();
    let mm: Vec<f64> = laid
        .map(|(x, y, mm)| mm - shape(*x, *y).dot(&motion))
        .collect();
    mm.iter().all(|mm| mm.is_finite()).then_some(mm)
}

/// Running sums (mean and squares: B. P. Welford, Technometrics 4, 1962, so that
/// no digits are lost in a difference of large sums).
#[derive(Default)]
struct Sum {
    figures: DeviationStatistics,
    squares: f64,
    above: (f64, f64),
    below: (f64, f64),
}

impl Sum {
    #[allow(clippy::cast_precision_loss, reason = "node counts are far below 2^52")]
    fn take(&mut self, mm: f64, cut: bool) {
        let figures = &mut self.figures;
        figures.nodes += 1;
        if !cut {
            figures.uncut += 1;
            return;
        }
        let count = figures.cut();
        if count == 1 {
            (figures.min_mm, figures.max_mm) = (mm, mm);
        }
        let off = mm - figures.mean_mm;
        figures.mean_mm += off / count as f64;
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
    fn finish(self) -> Option<DeviationStatistics> {
        let mean = |(sum, count): (f64, f64)| if count > 0.0 { sum / count } else { 0.0 };
        let mut figures = self.figures;
        if figures.nodes == 0 {
            return None;
        }
        if figures.cut() > 1 {
            figures.std_mm = (self.squares / (figures.cut() - 1) as f64).sqrt();
        }
        figures.mean_above_mm = mean(self.above);
        figures.mean_below_mm = mean(self.below);
        Some(figures)
    }
}
