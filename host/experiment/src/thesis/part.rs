//! The workpiece of A. Sawula's thesis (2013, section 4.1): part of a cylindrical
//! surface, finished with a ball-nose tool in passes along its axis.
//!
//! The tips of the passes that appendix E prints lie on a circle about (y 0.003,
//! z -67.53) with radius 92.87. The ball's centres are 4 mm above the tips, and the
//! surface that they leave is 4 mm inside of them: radius 88.87 about (0.003, -63.53).
//!
//! Appendix E counts Z from the part's seat. The probing of chapters 4 and 5 counts it
//! from elsewhere: the plate's surface is at 64 (table 5.4). Both belong together here,
//! so the part stands on the plate: [`SEAT_MM`] is added to every Z of the appendix.

use umi_virtual::cutting::{CylinderArc, Grid, GridFault, Workpiece};

/// Height of the plate's surface, on which the part stands, mm (table 5.4: 63.9985 to
/// 64.0017).
pub const SEAT_MM: f64 = 64.0;

/// Radius of the ball-nose tool, mm (appendix E: 8.0 mm diameter).
pub const BALL_RADIUS_MM: f64 = 4.0;

/// The surface as it is meant to be, in the coordinates of the reference clamping.
pub const NOMINAL: CylinderArc = CylinderArc {
    axis_y_mm: 0.003,
    axis_z_mm: SEAT_MM - 67.53 + BALL_RADIUS_MM,
    radius_mm: 92.87 - BALL_RADIUS_MM,
};

/// Where the passes begin and end in X, mm (appendix E).
pub const PASS_X_MM: [f64; 2] = [-25.399, 25.391];

/// The outermost pass, as the angle about the arc's axis: its tip is at y 35.004
/// (appendix E), `sin = (35.004 - 0.003) / 92.87`.
pub const OUTERMOST_SINE: f64 = (35.004 - 0.003) / 92.87;

/// The surface is measured between these borders in X, mm: as far as the passes go.
pub const MEASURED_X_MM: [f64; 2] = [-25.39, 25.39];

/// What the band saw has left above the nominal surface, mm. Our choice; the thesis
/// gives no figure.
pub const STOCK_MM: f64 = 3.0;

/// Sections of the surface, one for each clamping (figure 4.3).
pub const SECTIONS: usize = 5;

/// Y of the surface's border, mm: under the outermost pass.
#[must_use]
pub fn border_y_mm() -> f64 {
    NOMINAL.radius_mm * OUTERMOST_SINE
}

/// The raw part on a grid with about these pitches in X and Y.
///
/// # Errors
/// The pitches make no grid.
pub fn blank(pitch_mm: [f64; 2]) -> Result<Workpiece, GridFault> {
    let half = border_y_mm();
    let y_mm = [NOMINAL.axis_y_mm - half, NOMINAL.axis_y_mm + half];
    let grid = Grid::new(MEASURED_X_MM, y_mm, pitch_mm)?;
    let saw = CylinderArc {
        radius_mm: NOMINAL.radius_mm + STOCK_MM,
        ..NOMINAL
    };
    // The arc is far wider than the part: it has a height everywhere on it.
    Ok(Workpiece::new(grid, |_, y| {
        saw.height_mm(y).unwrap_or(saw.axis_z_mm)
    }))
}
