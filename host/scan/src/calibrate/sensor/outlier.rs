//! A sample that lies off all others: a reflection, or a digit that was written down wrong.

use serde::Serialize;

use super::model::MountModel;
use crate::calibrate::misfit::stray::{Observed, stray};
use crate::calibrate::solve::Model as _;

/// Samples scatter by no one law: on flanks and far away by some times more. One is a stray beyond so many standard
/// deviations of all others, and of those of its profile. These are by medians, which a second stray hardly moves.
const MOST_SIGMAS: f64 = 8.0;
/// The standard deviation of normal errors, over the median of their sizes.
const OF_MEDIAN: f64 = 1.4826;

/// A sample that lies off all others.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SampleOutlier {
    /// Its row in the file, counted from 1 behind the header.
    pub row: usize,
    /// Its profile, in words.
    pub profile: String,
    /// What it was taken for a part of.
    pub feature: String,
    /// Its distance from the surface that all others have, in mm; signed as the residuals.
    pub off_mm: f64,
    /// The chance that one of so many lies so far off where all belong together.
    pub p: f64,
    /// So many others lie off as far.
    pub more: usize,
}

impl SampleOutlier {
    /// What is to be said of it.
    #[must_use]
    pub fn words(&self) -> String {
        let more = match self.more {
            0 => String::new(),
            1 => " (so does one more)".to_owned(),
            more => format!(" (so do {more} more)"),
        };
        format!(
            "row {} ({}, {}) lies {:+.4} mm off the surface that all others have{more}: leave it out, or look at what was \
             written there",
            self.row, self.profile, self.feature, self.off_mm
        )
    }
}

/// Looks for one at the optimum.
pub(super) fn outlier(model: &MountModel<'_>) -> Option<SampleOutlier> {
    let each = Observed {
        of: &|place| place,
        residuals: &|_| 1,
    };
    let found = stray(model, &each)?;
    let (number, off_mm) = (*found.numbers.first()?, found.off_mm[0]);
    let seen = model.all.points.get(number)?;
    let mut sizes = Vec::with_capacity(model.residuals());
    model.rows(&mut |value, _| sizes.push(value.abs()));
    let points = model.all.points.iter();
    let mut beside: Vec<f64> = (points.zip(&sizes))
        .filter(|(point, _)| point.flange == seen.flange)
        .map(|(_, size)| *size)
        .collect();
    let mut all = sizes.clone();
    let limit_mm = MOST_SIGMAS * sigma_of(&mut all).max(sigma_of(&mut beside));
    (off_mm.abs() > limit_mm).then(|| SampleOutlier {
        row: number + 1,
        profile: model.all.profile_name(seen.flange),
        feature: model.all.features[seen.feature].clone(),
        off_mm,
        p: found.p,
        more: sizes
            .iter()
            .enumerate()
            .filter(|(place, size)| *place != number && **size > limit_mm)
            .count(),
    })
}

/// By the median of sizes.
fn sigma_of(sizes: &mut [f64]) -> f64 {
    if sizes.is_empty() {
        return 0.0;
    }
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
    OF_MEDIAN * *median
}
