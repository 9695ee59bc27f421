//! Bias, scatter and length of errors: an average of lengths alone does not tell a frame that is off from noise.

use nalgebra::Vector3;

/// Errors over clampings, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorFigures {
    /// The mean error.
    pub mean_mm: Vector3<f64>,
    /// Its length: what all clampings share.
    pub bias_mm: f64,
    /// Root of the mean square of what is left.
    pub scatter_mm: f64,
    /// The mean of the errors' lengths.
    pub length_mm: f64,
    /// The longest one.
    pub worst_mm: f64,
}

impl ErrorFigures {
    /// Of these errors in mm; all zero for none.
    #[must_use]
    pub fn of(errors: &[Vector3<f64>]) -> Self {
        let n = errors.len().max(1) as f64;
        let mean_mm = errors.iter().sum::<Vector3<f64>>() / n;
        let squares: f64 = errors.iter().map(|e| (e - mean_mm).norm_squared()).sum();
        let lengths = errors.iter().map(nalgebra::Matrix::norm);
        Self {
            mean_mm,
            bias_mm: mean_mm.norm(),
            scatter_mm: (squares / n).sqrt(),
            length_mm: lengths.clone().sum::<f64>() / n,
            worst_mm: lengths.fold(0.0, f64::max),
        }
    }
}
