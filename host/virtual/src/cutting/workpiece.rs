//! A workpiece as heights above a grid.

use nalgebra::Vector3;
use umi_core::registration::RigidTransform;

use super::Capsule;

/// A grid of nodes in plan, first and last node on the borders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    x_mm: [f64; 2],
    y_mm: [f64; 2],
    columns: usize,
    rows: usize,
}

/// Why there is no such grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GridFault {
    /// A border or pitch is not a number, or the borders are exchanged.
    Borders,
    /// The pitch is not above zero, or wider than the workpiece.
    Pitch,
    /// More nodes than [`Grid::MAX_NODES`].
    TooFine,
}

impl std::fmt::Display for GridFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Borders => "the grid's borders must be numbers, the lower one first",
            Self::Pitch => "the grid's pitch must be above zero and no wider than the workpiece",
            Self::TooFine => "the grid is too fine for the memory: choose a wider pitch",
        })
    }
}

impl std::error::Error for GridFault {}

impl Grid {
    /// The most nodes of a grid.
    pub const MAX_NODES: usize = 50_000_000;

    /// A grid with nodes on its borders and about this pitch between them, mm.
    ///
    /// # Errors
    /// [`GridFault`].
    pub fn new(x_mm: [f64; 2], y_mm: [f64; 2], pitch_mm: [f64; 2]) -> Result<Self, GridFault> {
        let columns = Self::nodes(x_mm, pitch_mm[0])?;
        let rows = Self::nodes(y_mm, pitch_mm[1])?;
        match columns.checked_mul(rows) {
            Some(nodes) if nodes <= Self::MAX_NODES => Ok(Self {
                x_mm,
                y_mm,
                columns,
                rows,
            }),
            _ => Err(GridFault::TooFine),
        }
    }

    fn nodes([low, high]: [f64; 2], pitch_mm: f64) -> Result<usize, GridFault> {
        let width = high - low;
        if !(low.is_finite() && high.is_finite() && width > 0.0) {
            return Err(GridFault::Borders);
        }
        if !(pitch_mm > 0.0 && pitch_mm <= width) {
            return Err(GridFault::Pitch);
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at least 1, and a float's cast saturates"
        )]
        let steps = (width / pitch_mm).round() as usize;
        Ok(steps.saturating_add(1))
    }

    /// Nodes along X.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Nodes along Y.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The borders in X, mm.
    #[must_use]
    pub fn x_mm(&self) -> [f64; 2] {
        self.x_mm
    }

    /// The borders in Y, mm.
    #[must_use]
    pub fn y_mm(&self) -> [f64; 2] {
        self.y_mm
    }

    /// X of a column, mm.
    #[must_use]
    pub fn column_mm(&self, column: usize) -> f64 {
        place(self.x_mm, self.columns, column)
    }

    /// Y of a row, mm.
    #[must_use]
    pub fn row_mm(&self, row: usize) -> f64 {
        place(self.y_mm, self.rows, row)
    }

    /// The columns from one X to another, both included.
    fn columns_in(&self, [low, high]: [f64; 2]) -> std::ops::Range<usize> {
        indices(self.x_mm, self.columns, low, high)
    }

    fn rows_in(&self, [low, high]: [f64; 2]) -> std::ops::Range<usize> {
        indices(self.y_mm, self.rows, low, high)
    }
}

#[allow(clippy::cast_precision_loss, reason = "node counts are far below 2^52")]
fn place([low, high]: [f64; 2], nodes: usize, index: usize) -> f64 {
    low + (high - low) * (index as f64 / (nodes - 1) as f64)
}

#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "node counts are far below 2^52; a float's cast saturates"
)]
fn indices(border: [f64; 2], nodes: usize, low: f64, high: f64) -> std::ops::Range<usize> {
    let per_mm = (nodes - 1) as f64 / (border[1] - border[0]);
    let first = ((low - border[0]) * per_mm).ceil().max(0.0) as usize;
    let last = ((high - border[0]) * per_mm).floor();
    if last < 0.0 {
        return 0..0;
    }
    first.min(nodes)..(last as usize).saturating_add(1).min(nodes)
}

/// Part of a round bar with its axis along X: the test workpiece of A. Sawula
/// (thesis, 2013, section 4.1), convex upwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CylinderArc {
    /// Y of the axis, mm.
    pub axis_y_mm: f64,
    /// Z of the axis, mm.
    pub axis_z_mm: f64,
    /// Radius, mm.
    pub radius_mm: f64,
}

impl CylinderArc {
    /// Height of the surface, mm; None beside the bar.
    #[must_use]
    pub fn height_mm(&self, y_mm: f64) -> Option<f64> {
        let beside = y_mm - self.axis_y_mm;
        let squared = self.radius_mm * self.radius_mm - beside * beside;
        (squared >= 0.0).then(|| self.axis_z_mm + squared.sqrt())
    }

    /// Distance of a point from the surface along the surface's normal, mm:
    /// positive where material was left, negative where too much is gone.
    #[must_use]
    pub fn deviation_mm(&self, y_mm: f64, z_mm: f64) -> f64 {
        let (y, z) = (y_mm - self.axis_y_mm, z_mm - self.axis_z_mm);
        (y * y + z * z).sqrt() - self.radius_mm
    }
}

/// What one sweep took away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Removed {
    /// Nodes that became lower.
    pub nodes: usize,
    /// The most that one of them sank, mm.
    pub deepest_mm: f64,
}

/// Material under a grid of heights, and where it is clamped.
#[derive(Clone, Debug)]
pub struct Workpiece {
    grid: Grid,
    /// Row by row.
    heights_mm: Vec<f64>,
    cut: Vec<bool>,
    highest_mm: f64,
    pose: RigidTransform,
    back: RigidTransform,
}

impl Workpiece {
    /// A raw part: `height_mm` of (x, y) in its own frame. It is clamped so that its
    /// frame is the machine's.
    #[must_use]
    pub fn new(grid: Grid, height_mm: impl Fn(f64, f64) -> f64) -> Self {
        let mut heights_mm = Vec::with_capacity(grid.rows * grid.columns);
        for row in 0..grid.rows {
            let y = grid.row_mm(row);
            heights_mm.extend((0..grid.columns).map(|column| height_mm(grid.column_mm(column), y)));
        }
        Self {
            grid,
            cut: vec![false; heights_mm.len()],
            highest_mm: heights_mm.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            heights_mm,
            pose: RigidTransform::identity(),
            back: RigidTransform::identity(),
        }
    }

    /// Clamps it anew: its frame in machine coordinates.
    pub fn clamp(&mut self, pose: RigidTransform) {
        self.pose = pose;
        self.back = pose.inverse();
    }

    /// Its frame in machine coordinates.
    #[must_use]
    pub fn pose(&self) -> &RigidTransform {
        &self.pose
    }

    /// Its grid.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Heights, mm, row by row.
    #[must_use]
    pub fn heights_mm(&self) -> &[f64] {
        &self.heights_mm
    }

    /// Whether a tool has touched the node, row by row.
    #[must_use]
    pub fn cut(&self) -> &[bool] {
        &self.cut
    }

    /// A ball sweeps from one place to another, centres in machine coordinates.
    /// None if it takes nothing away.
    pub fn sweep(
        &mut self,
        from: Vector3<f64>,
        to: Vector3<f64>,
        radius_mm: f64,
    ) -> Option<Removed> {
        let place = |p: Vector3<f64>| self.back.rotate(&p) + self.back.translation_mm;
        self.lower(&Capsule::new(place(from), place(to), radius_mm))
    }

    /// Lowers every node to the lower side of a capsule in its own frame.
    fn lower(&mut self, capsule: &Capsule) -> Option<Removed> {
        if capsule.bottom_mm() >= self.highest_mm {
            return None;
        }
        let [x, y] = capsule.plan_box();
        let columns = self.grid.columns_in(x);
        let mut removed: Option<Removed> = None;
        for row in self.grid.rows_in(y) {
            let y_mm = self.grid.row_mm(row);
            for column in columns.clone() {
                let node = row * self.grid.columns + column;
                let Some(height) = self.heights_mm.get_mut(node) else {
                    continue;
                };
                let Some(lowest) = capsule.lowest_above(self.grid.column_mm(column), y_mm) else {
                    continue;
                };
                if lowest < *height {
                    let sum = removed.get_or_insert(Removed {
                        nodes: 0,
                        deepest_mm: 0.0,
                    });
                    sum.nodes += 1;
                    sum.deepest_mm = sum.deepest_mm.max(*height - lowest);
                    *height = lowest;
                    if let Some(cut) = self.cut.get_mut(node) {
                        *cut = true;
                    }
                }
            }
        }
        removed
    }
}
