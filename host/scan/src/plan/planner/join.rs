//! Rows of passes in their order, with the links between them, and the ways from the top of Z and back there.

use super::super::drive::around::Beside;
use super::super::drive::links::{clear_above, link};
use super::super::drive::order::{Tour, wound};
use super::super::drive::realise::{Obstructed, Pass};
use super::super::proof::row::PathRow;
use super::Workshop;
use crate::ScanError;

/// A pass that no way leads to is tried again behind so many of those that follow, and at the end.
const MOST_TRIES: usize = 3;

/// What is said of a path whose end no program can come from or leave.
const NO_WAY_UP: &str = "No way was found on which the sensor comes straight down to the path's beginning, or leaves its end, and touches nothing: --nc and `umi scan drive` refuse such a path (nc_approach).";

/// A path, its passes, and what its user should know.
pub(super) struct Joined {
    pub rows: Vec<PathRow>,
    pub passes: Vec<Pass>,
    pub warning: Option<&'static str>,
    /// Passes that no way leads to.
    left: Vec<Pass>,
}

/// Joins the passes of a tour. Its ends are such that the way straight up from them is free, wherever another way of the
/// axes, or a link, leads to such a place. A pass that no safe way leads to is left out; the proof tells what that costs.
///
/// # Errors
/// `time_limit`.
pub(super) fn join(
    shop: &Workshop<'_>,
    tour: &Tour,
    obstructed: &mut Obstructed,
) -> Result<Joined, ScanError> {
    let (spec, scenery) = (shop.spec, &shop.realiser.scenery);
    let clear = |axes: &[f64]| clear_above(&spec.machine, scenery, axes);
    let ends_clear = |joined: &Joined| {
        let ends = [joined.rows.first(), joined.rows.last()];
        ends.into_iter().flatten().all(|row| clear(&row.axes))
    };
    let mut beside = Beside::new(spec, scenery, shop.deadline);
    let mut joined = linked(shop, &mut beside, wound(spec, tour, |_| true))?;
    if !ends_clear(&joined) {
        let other = linked(shop, &mut beside, wound(spec, tour, clear))?;
        if ends_clear(&other) && other.passes.len() >= joined.passes.len() {
            joined = other;
        } else if !(led(shop, &mut beside, &mut joined)) {
            joined.warning = Some(NO_WAY_UP);
        }
    }
    for pass in &joined.left {
        let tips = pass.poses.iter();
        let tips = tips.map(|p| p.origin_mm + p.beam * spec.sensor.reference_mm);
        obstructed.collision.extend(tips);
    }
    obstructed.unlinked = joined.left.len();
    Ok(joined)
}

fn link_row(shop: &Workshop<'_>, axes: Vec<f64>) -> PathRow {
    PathRow {
        pass: -1,
        laser: false,
        pose: shop.spec.machine.forward(&axes),
        axes,
    }
}

/// Links before the path's beginning and behind its end, to places from which the way straight up is free; whether there
/// are such places.
fn led(shop: &Workshop<'_>, beside: &mut Beside<'_>, joined: &mut Joined) -> bool {
    let (Some(first), Some(last)) = (joined.rows.first(), joined.rows.last()) else {
        return true;
    };
    let (Some(before), Some(behind)) = (beside.out(&first.axes), beside.out(&last.axes)) else {
        return false;
    };
    let before = before.into_iter().rev().map(|axes| link_row(shop, axes));
    joined.rows.splice(0..0, before);
    let behind = behind.into_iter().map(|axes| link_row(shop, axes));
    joined.rows.extend(behind);
    true
}

/// The passes in their order. What no way leads to from the pass before it is tried again behind others; where more is left
/// out than is joined, it is begun with that.
fn linked(
    shop: &Workshop<'_>,
    beside: &mut Beside<'_>,
    passes: Vec<Pass>,
) -> Result<Joined, ScanError> {
    let joined = linked_from(shop, beside, passes)?;
    let way = |passes: &[Pass]| passes.iter().map(|p| p.length_mm(shop.spec)).sum::<f64>();
    if way(&joined.left) <= way(&joined.passes) {
        return Ok(joined);
    }
    let begun_with = joined.left.iter().chain(&joined.passes).cloned().collect();
    let other = linked_from(shop, beside, begun_with)?;
    Ok(if way(&other.passes) > way(&joined.passes) {
        other
    } else {
        joined
    })
}

fn linked_from(
    shop: &Workshop<'_>,
    beside: &mut Beside<'_>,
    passes: Vec<Pass>,
) -> Result<Joined, ScanError> {
    let mut joined = Joined {
        rows: Vec::new(),
        passes: Vec::with_capacity(passes.len()),
        warning: None,
        left: Vec::new(),
    };
    let mut waiting: Vec<(Pass, usize)> = Vec::new();
    for pass in passes {
        shop.deadline.check()?;
        if let Some(pass) = joined.append(shop, beside, pass) {
            waiting.push((pass, 0));
            continue;
        }
        let tried: Vec<(Pass, usize)> = std::mem::take(&mut waiting);
        for (pass, tries) in tried {
            if tries >= MOST_TRIES {
                waiting.push((pass, tries));
            } else if let Some(pass) = joined.append_either(shop, beside, pass) {
                waiting.push((pass, tries + 1));
            }
        }
    }
    for (pass, _) in waiting {
        shop.deadline.check()?;
        let left = joined.append_either(shop, beside, pass);
        joined.left.extend(left);
    }
    Ok(joined)
}

impl Joined {
    /// Adds a pass behind a link; gives it back where no way leads to it.
    fn append(&mut self, shop: &Workshop<'_>, beside: &mut Beside<'_>, pass: Pass) -> Option<Pass> {
        if let (Some(before), Some(first)) = (self.rows.last(), pass.axes.first()) {
            let over = link(shop.spec, &shop.realiser.scenery, &before.axes, first);
            let Some(way) = over.or_else(|| beside.between(&before.axes, first)) else {
                return Some(pass);
            };
            let way = way.into_iter().map(|axes| link_row(shop, axes));
            self.rows.extend(way);
        }
        for (axes, pose) in pass.axes.iter().zip(&pass.poses) {
            self.rows.push(PathRow {
                pass: self.passes.len() as i32,
                laser: true,
                axes: axes.clone(),
                pose: *pose,
            });
        }
        self.passes.push(pass);
        None
    }

    /// The same, either way round.
    fn append_either(
        &mut self,
        shop: &Workshop<'_>,
        beside: &mut Beside<'_>,
        pass: Pass,
    ) -> Option<Pass> {
        let mut pass = self.append(shop, beside, pass)?;
        pass.reverse();
        self.append(shop, beside, pass)
    }
}
