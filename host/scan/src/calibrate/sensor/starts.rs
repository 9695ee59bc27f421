//! Where the search for a mount begins.

use nalgebra::Vector3;

use super::lines::{Within, valleys};
use super::model::MountModel;
use super::sides::by_sides;
use crate::calibrate::features::SampleSights;
use crate::calibrate::features::{Cut, cuts};
use crate::calibrate::observations::Observations;
use crate::calibrate::solve::{Model, descend};
use crate::rigid::rotation;

/// The best of descents from the first guess and from around it: balls have a second valley
/// where they are looked for on the wrong side of the laser's plane, planes at few poses have some, too.
pub(super) fn best_start(first: MountModel<'_>) -> MountModel<'_> {
    /// Observations that are enough to choose a valley.
    const ENOUGH: usize = 2000;
    let cuts = match first.features.first() {
        Some(SampleSights::Ball { .. }) => cuts(first.all),
        _ => return best_of_planes(first, ENOUGH),
    };
    if first.all.points.len() <= ENOUGH {
        return best_of_starts(first, &cuts);
    }
    let thin = thinned(first.all, ENOUGH);
    best_of_starts(first.of(&thin), &cuts).of(first.all)
}

/// The same of planes, whose valleys are looked for where the first descents leave more than noise.
fn best_of_planes(first: MountModel<'_>, enough: usize) -> MountModel<'_> {
    /// So many of the valleys are looked at with all points.
    const BEST: usize = 4;
    let turned = (0..3).flat_map(|axis| [-0.07, 0.07].map(|angle| Vector3::ith(axis, angle)));
    let thin = thinned(first.all, enough);
    let of_thin = first.of(&thin);
    let starts = std::iter::once(Vector3::zeros()).chain(turned).map(|turn| {
        let mut turned = of_thin.clone();
        turned.mount.rotation = rotation(&turn) * turned.mount.rotation;
        turned
    });
    let (_, found) = least_of(&of_thin, starts.collect());
    let (least, found) = least_of(&first, vec![found.of(first.all)]);
    if Within::of(&found).is_some_and(|within| within.fits(least)) {
        return found;
    }
    let valleys = valleys(&first, &first.mount).into_iter().take(BEST);
    let (beside, other) = least_of(&first, valleys.collect());
    if beside < 0.999 * least { other } else { found }
}

/// So many observations at most, spread over all.
fn thinned(all: &Observations, most: usize) -> Observations {
    let every = all.points.len().div_ceil(most);
    Observations {
        features: all.features.clone(),
        profiles: all.profiles.clone(),
        flanges_by_radians: None,
        flanges: all.flanges.clone(),
        slips: Vec::new(),
        points: all.points.iter().step_by(every).copied().collect(),
    }
}

/// The least that descents from the first guess and from around it reach. Where balls leave more than their cuts' own
/// noise, the mount is looked for by the sides of the laser's plane that they may be on; where balls of known centres
/// still stand beside their points, on a grid about the guess.
fn best_of_starts<'a>(first: MountModel<'a>, cuts: &[Cut]) -> MountModel<'a> {
    /// A fit that leaves more than this share of the ball's radius has not found the ball.
    const BESIDE: f64 = 0.01;
    /// Observations that are enough for the many descents of a grid.
    const ENOUGH_OF_GRID: usize = 300;
    let mut starts = vec![first.clone()];
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut turned = first.clone();
            let w = Vector3::ith(axis, 0.07 * sign);
            turned.mount.rotation = rotation(&w) * turned.mount.rotation;
            starts.push(turned);
            let mut shifted = first.clone();
            for feature in &mut shifted.features {
                if let (SampleSights::Ball { centre_mm }, false) = (feature, first.centres_known) {
                    *centre_mm += Vector3::ith(axis, 8.0 * sign);
                }
            }
            starts.push(shifted);
        }
    }
    let (mut least, mut best) = least_of(&first, starts);
    if fits(&best, least, cuts) {
        return best;
    }
    for mut begin in by_sides(&first, cuts) {
        // A radius that is free runs away from a mount that is not found yet.
        begin.radius_free = false;
        descend(&mut begin, 30);
        begin.radius_free = first.radius_free;
        let (beside, other) = least_of(&first, vec![begin]);
        if beside < 0.999 * least {
            (least, best) = (beside, other);
        }
        if fits(&best, least, cuts) {
            return best;
        }
    }
    let n = first.all.points.len() as f64;
    if !first.centres_known || (least / n).sqrt() <= BESIDE * best.radius_mm {
        return best;
    }
    let thin = thinned(first.all, ENOUGH_OF_GRID);
    let on_grid = MountModel {
        all: &thin,
        ..first.clone()
    };
    let (_, grid) = least_of(&on_grid, around(&on_grid));
    let grid = MountModel {
        all: first.all,
        ..grid
    };
    let (beside, grid) = least_of(&first, vec![grid]);
    if beside < least { grid } else { best }
}

/// Whether a sum of squares is what the points scatter about their own cuts' circles. Of cuts of hardly any points nothing
/// says so.
fn fits(model: &MountModel<'_>, ssq: f64, cuts: &[Cut]) -> bool {
    /// Half-way valleys leave more than that of the noise; what is beyond takes time, nothing else.
    const TIMES: f64 = 1.5;
    /// What rounding leaves, of the radius.
    const ROUNDED: f64 = 1e-6;
    let (mut squares, mut left) = (0.0, 0);
    for cut in cuts {
        // Off the circle by a mm, a point is off the ball by less.
        let share = (cut.radius_mm / model.radius_mm).min(1.0);
        squares += cut.off_circle * share * share;
        left += cut.points.saturating_sub(3);
    }
    if left == 0 {
        return false;
    }
    let noise_mm = (squares / left as f64).sqrt();
    let (nuisances, targets) = model.unknowns();
    let dof = model.residuals().saturating_sub(nuisances + targets).max(1);
    (ssq / dof as f64).sqrt() <= TIMES * noise_mm + ROUNDED * model.radius_mm
}

/// Mounts about the first guess, 20 mm and 6° around it.
fn around<'a>(first: &MountModel<'a>) -> Vec<MountModel<'a>> {
    const SHIFTS_MM: [f64; 3] = [-12.0, 0.0, 12.0];
    let turns = (0..3).flat_map(|axis| [-0.07, 0.07].map(|angle| Vector3::ith(axis, angle)));
    let mut mounts = Vec::new();
    for turn in turns.chain([Vector3::zeros()]) {
        for place in 0..SHIFTS_MM.len().pow(3) {
            let shift = Vector3::from_fn(|axis, _| {
                let by = SHIFTS_MM[place / SHIFTS_MM.len().pow(axis as u32) % SHIFTS_MM.len()];
                if first.sought[3 + axis] { by } else { 0.0 }
            });
            let mut moved = first.clone();
            moved.mount.rotation = rotation(&turn) * moved.mount.rotation;
            moved.mount.translation_mm += shift;
            mounts.push(moved);
        }
    }
    mounts
}

/// The least sum of squares that these reach, near the first guess.
fn least_of<'a>(first: &MountModel<'a>, starts: Vec<MountModel<'a>>) -> (f64, MountModel<'a>) {
    let mut best: Option<(f64, MountModel<'_>)> = None;
    for mut model in starts {
        let ssq = descend(&mut model, 60);
        let far = (model.mount.translation_mm - first.mount.translation_mm).norm() > 200.0;
        let better = best.as_ref().is_none_or(|(least, _)| ssq < 0.999 * least);
        if better && !far {
            best = Some((ssq, model));
        }
    }
    best.unwrap_or_else(|| (f64::INFINITY, first.clone()))
}
