//! A board's axes: their names, and counts as millimetres where the job says how.

use umi_protocol::job::Job;
use umi_protocol::latch::MAX_AXES;

/// Names of the axes in the order of a board's encoder inputs.
pub const NAMES: [&str; MAX_AXES] = ["x", "y", "z", "w", "axis5", "axis6"];

/// What a job's witness section says about the encoders.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scale {
    counts_per_mm: Option<[f64; 3]>,
    origin_counts: Option<[f64; 3]>,
}

impl Scale {
    /// Of a job; unknown without one, and without a witness section.
    #[must_use]
    pub fn of(job: Option<&Job>) -> Self {
        let witness = job.and_then(|job| job.witness);
        Self {
            counts_per_mm: witness.map(|witness| witness.counts_per_mm),
            origin_counts: witness.and_then(|witness| witness.origin_counts),
        }
    }

    /// Counts per millimetre of an axis, from 0.
    #[must_use]
    pub fn counts_per_mm(&self, axis: usize) -> Option<f64> {
        self.counts_per_mm
            .as_ref()
            .and_then(|scale| scale.get(axis).copied())
    }

    /// Whether millimetres are the control's coordinates, because the job says where
    /// their origin is; else they begin where the counter shows 0.
    #[must_use]
    pub const fn has_origin(&self) -> bool {
        self.origin_counts.is_some()
    }

    /// The position of an axis; none where its scale is not known.
    #[must_use]
    pub fn mm(&self, axis: usize, counts: i64) -> Option<f64> {
        let origin = self.origin_counts.as_ref().and_then(|all| all.get(axis));
        Some((counts as f64 - origin.copied().unwrap_or(0.0)) / self.counts_per_mm(axis)?)
    }

    /// The positions of all axes whose scale is known, the first ones.
    #[must_use]
    pub fn position_mm(&self, counts: &[i64]) -> Vec<f64> {
        let axes = counts.iter().enumerate();
        axes.map_while(|(axis, counts)| self.mm(axis, *counts))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counts are millimetres from the origin where there is one, also on an axis that
    /// counts down; a fourth axis has counts only.
    #[test]
    fn counts_become_millimetres() {
        let mut scale = Scale {
            counts_per_mm: Some([1000.0, -2000.0, 500.0]),
            origin_counts: None,
        };
        assert_eq!(scale.position_mm(&[1500, 500, -50, 9]), [1.5, -0.25, -0.1]);
        scale.origin_counts = Some([500.0, 0.0, 0.5]);
        assert_eq!(scale.mm(0, 1500), Some(1.0));
        assert_eq!(scale.mm(2, 0), Some(-0.001));
        assert_eq!(scale.mm(3, 7), None);
        assert!(Scale::of(None).position_mm(&[1, 2, 3]).is_empty());
    }
}
