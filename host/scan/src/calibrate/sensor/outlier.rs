//! A sample that lies off all others: a reflection, or a digit that was written down wrong.

use serde::Serialize;

use super::model::MountModel;
use crate::calibrate::misfit::stray::{Observed, stray};
use crate::calibrate::solve::Model as _;

/// Samples scatter by no one law: on flanks and far away by some times more. One is a stray beyond so many standard
/// deviations of all others, and of those of its profile.
const MOST_SIGMAS: f64 = 8.0;

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
}

impl SampleOutlier {
    /// What is to be said of it.
    #[must_use]
    pub fn words(&self) -> String {
        format!(
            "row {} ({}, {}) lies {:+.4} mm off the surface that all others have: leave it out, or look at what was \
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
    let off_mm = found.off_mm[0];
    let seen = model.all.points.get(found.number)?;
    let (mut n, mut squares, mut place) = (0_usize, 0.0, 0);
    model.rows(&mut |value, _| {
        if place != found.number && model.all.points[place].flange == seen.flange {
            n += 1;
            squares += value * value;
        }
        place += 1;
    });
    let beside_mm = (squares / n.max(1) as f64).sqrt();
    (off_mm.abs() > MOST_SIGMAS * found.others_mm.max(beside_mm)).then(|| SampleOutlier {
        row: found.number + 1,
        profile: model.all.profile_name(seen.flange),
        feature: model.all.features[seen.feature].clone(),
        off_mm,
        p: found.p,
    })
}
