//! What is off at one place of the laser line in every profile: the sensor's linearity, or a step in what was taken for one
//! surface.
//!
//! The mount takes part of it, and no covariance knows of it: profiles agree with one another. So the line is cut into
//! parts, each with a mean of its own ([`misfit`]); they are told where such a mean stands out by more than chance, and is
//! larger than single samples scatter. A linearity of some micrometres, as each sensor has, is not.

use super::model::MountModel;
use crate::calibrate::misfit::{self, ALARM, Grouping, Suspects};

/// Parts of the line.
const PARTS: usize = 10;

/// What is to be said of the line; none where single samples scatter more.
pub(super) fn along_line(model: &MountModel<'_>) -> Option<String> {
    let x = || model.all.points.iter().map(|seen| seen.seen_mm.x);
    let (low, high) = (
        x().fold(f64::INFINITY, f64::min),
        x().fold(-f64::INFINITY, f64::max),
    );
    let step = (high - low) / PARTS as f64;
    if step.is_nan() || step <= 0.0 {
        return None;
    }
    let part: Vec<usize> = x()
        .map(|x| (((x - low) / step) as usize).min(PARTS - 1))
        .collect();
    let names = |part: usize| {
        let from = low + step * part as f64;
        format!("x from {from:.1} to {:.1} mm", from + step)
    };
    let grouping = Grouping {
        group: &part,
        pose: &part,
        names: &names,
    };
    let suspects = Suspects {
        names: Vec::new(),
        turns: 3,
        fill: &|_, _| {},
    };
    let found = misfit::look(model, &grouping, &suspects, &[]).misfit?;
    let stands_out = found.p < ALARM && found.worst.mean_mm.abs() > found.within_mm;
    stands_out.then(|| {
        format!(
            "along the line: samples at {} lie {:+.4} mm off on the mean of all profiles, where single ones scatter by {:.4} mm. That \
             is the sensor's linearity, or a step in what was taken for one surface; the mount has part of it, and its uncertainty does \
             not know",
            found.worst.pose, found.worst.mean_mm, found.within_mm
        )
    })
}
