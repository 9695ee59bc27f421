//! Samples that lie off all others: reflections, or digits that were written down wrong.
//!
//! Samples scatter by no one law: more on flanks and far away, and speckle has tails. So one is a stray beyond six times what
//! nine of ten residuals stay below, wherever that is. Each residual is the one by all others, `r / (1 - h)` with its
//! leverage `h` (Cook and Weisberg, Residuals and Influence in Regression, 1982, section 2.2). The worst is left out, the
//! mount fitted anew, and the next looked for, so that strays neither hide each other nor make their neighbours look like
//! strays.

use nalgebra::DVector;
use serde::Serialize;

use super::model::MountModel;
use crate::calibrate::solve::scatter::whiten;
use crate::calibrate::solve::{Model, descend};

/// Of residuals so many stay below the size that strays are held against.
const MOST: f64 = 0.9;
/// Ten standard deviations of errors that are normal.
const TIMES: f64 = 6.0;
/// Below this, in mm, residuals are rounding.
const ROUNDING_MM: f64 = 1e-6;
/// What alone decides an unknown cannot be off.
const LEAST_LEFT: f64 = 1e-3;
/// So many are named; where there are more, something else is wrong.
pub(super) const MOST_NAMED: usize = 20;
/// Steps of a fit without some samples, from that with all of them.
const STEPS: usize = 20;

/// A sample that lies off all others.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SampleOutlier {
    /// Its row in the file, counted from 1 behind the header.
    pub row: usize,
    /// Its profile, in words.
    pub profile: String,
    /// What it was taken for a part of.
    pub feature: String,
    /// Its distance from the surface that all others have, in mm; positive outside.
    pub off_mm: f64,
}

/// What is to be said of them.
pub(super) fn words(outliers: &[SampleOutlier]) -> Option<String> {
    let worst = outliers.first()?;
    let (rows, lie) = rows(outliers);
    let more = if outliers.len() >= MOST_NAMED {
        ", and there may be more"
    } else {
        ""
    };
    Some(format!(
        "outlier: {rows} {lie} {:+.4} mm off the surface that all others have{more}: look at what was written there, or leave them \
         out with --drop-outliers",
        worst.off_mm
    ))
}

/// What is to be said of those that were left out.
pub(super) fn dropped(outliers: &[SampleOutlier]) -> Option<String> {
    let worst = outliers.first()?;
    let (rows, lie) = rows(outliers);
    Some(format!(
        "dropped: {rows} {lie} {:+.4} mm off the surface that all others have: left out",
        worst.off_mm
    ))
}

/// Their rows with profile and feature, and the word for what they do.
fn rows(outliers: &[SampleOutlier]) -> (String, &'static str) {
    let named = |one: &SampleOutlier| format!("{} ({}, {})", one.row, one.profile, one.feature);
    let all: Vec<String> = outliers.iter().map(named).collect();
    match &all[..] {
        [row] => (format!("row {row}"), "lies"),
        _ => (format!("rows {}", all.join(", ")), "lie up to"),
    }
}

/// Looks for them at the optimum, the worst first.
pub(super) fn outliers(model: &MountModel<'_>) -> Vec<SampleOutlier> {
    let mut found = Vec::new();
    let Some(mut worst) = worst(model) else {
        return found;
    };
    let mut kept = model.all.clone();
    let mut rows: Vec<usize> = (1..=kept.points.len()).collect();
    loop {
        let (place, off_mm) = worst;
        let seen = kept.points.remove(place);
        found.push(SampleOutlier {
            row: rows.remove(place),
            profile: model.all.profile_name(seen.flange),
            feature: model.all.features[seen.feature].clone(),
            off_mm,
        });
        let mut others = model.of(&kept);
        descend(&mut others, STEPS);
        match self::worst(&others) {
            Some(next) if found.len() < MOST_NAMED => worst = next,
            _ => return found,
        }
    }
}

/// The place of the sample that lies off most, and by how much; none where it lies where samples do.
fn worst(model: &MountModel<'_>) -> Option<(usize, f64)> {
    let (nuisances, targets) = model.unknowns();
    let whiten = whiten(model);
    let mut line = DVector::zeros(nuisances + targets);
    let mut sizes = Vec::with_capacity(model.residuals());
    let mut worst: Option<(usize, f64)> = None;
    model.rows(&mut |value, derivatives| {
        line.fill(0.0);
        derivatives(line.as_mut_slice());
        let left = 1.0 - (&whiten * &line).norm_squared();
        let off_mm = value / left;
        if left > LEAST_LEFT && worst.is_none_or(|(_, most)| off_mm.abs() > most.abs()) {
            worst = Some((sizes.len(), off_mm));
        }
        sizes.push(value.abs());
    });
    let place = ((sizes.len() as f64 * MOST) as usize).min(sizes.len().checked_sub(1)?);
    let (_, most, _) = sizes.select_nth_unstable_by(place, f64::total_cmp);
    worst.filter(|(_, off_mm)| off_mm.abs() > TIMES * most.max(ROUNDING_MM))
}
