//! Passes that others make needless are left out.
//!
//! Passes of several charts and those that were filled in see the same places twice. From the one that alone sees the least
//! for its way, each is left out as long as hardly anything goes unseen by that, and neighbours still overlap.

use super::super::drive::realise::Pass;
use super::super::proof::figures::overlap;
use super::super::proof::see::{Eye, SampleSights, SightDepth};
use super::Workshop;
use super::chart_passes::enough_overlap;
use super::fill::SPARE;
use crate::parallel::Threads;

/// A pass may go that alone sees less than this share of its strip.
const NEEDLESS: f64 = 0.06;

/// Share of the part that may go unseen by all that is left out.
const LOST: f64 = 0.004;

/// Each pass has a way to it, in mm, about.
const LINK_MM: f64 = 4.0;

/// Leaves needless passes out.
pub fn thin(shop: &Workshop<'_>, passes: &mut Vec<Pass>) {
    let all: Vec<&Pass> = passes.iter().collect();
    let eye = Eye::new(&shop.spec.sensor, &shop.realiser.scenery, &shop.samples);
    let mut seen = eye.see(&all, SightDepth::Range, Threads::all());
    let total = shop.samples.len() as f64;
    let per_sample = shop.part.surface.area_mm2() / total;
    let line = shop.spec.sensor.line_mm;
    let ways: Vec<f64> = passes
        .iter()
        .map(|p| p.length_mm(shop.spec) + LINK_MM)
        .collect();
    let share = seen.share();
    let spare = share - (shop.spec.plan.min_coverage + SPARE);
    // What is not enough anyway may lose a little, too; what is enough stays so.
    let mut budget = if share < shop.spec.plan.min_coverage {
        LOST * total
    } else {
        spare.clamp(0.0, LOST) * total
    };
    let least = |seen: &SampleSights| {
        let apart_mm = per_sample.sqrt();
        overlap(
            shop.spec,
            &all,
            &shop.samples,
            seen,
            apart_mm,
            shop.deadline,
        )
        .map(|o| o.tenth)
    };
    let needed = least(&seen).map(|o| o.min(enough_overlap(shop, per_sample)));
    let mut keep = vec![true; passes.len()];
    let mut open = keep.clone();
    while shop.deadline.more() {
        let (mut alone, mut sees) = (vec![0.0; passes.len()], vec![0.0; passes.len()]);
        for sights in &seen.sights {
            for s in sights {
                sees[s.pass as usize] += 1.0;
            }
            if let [only] = sights.as_slice() {
                alone[only.pass as usize] += 1.0;
            }
        }
        let worth = |p: usize, count: f64| count * per_sample / (ways[p] * line);
        let needless =
            |p: &usize| open[*p] && alone[*p] <= budget && worth(*p, alone[*p]) < NEEDLESS;
        let Some(p) = (0..passes.len()).filter(needless).min_by(|a, b| {
            worth(*a, alone[*a])
                .total_cmp(&worth(*b, alone[*b]))
                .then(worth(*a, sees[*a]).total_cmp(&worth(*b, sees[*b])))
        }) else {
            break;
        };
        open[p] = false;
        let mut without = seen.clone();
        for sights in &mut without.sights {
            sights.retain(|s| s.pass as usize != p);
        }
        let overlaps = match &shop.overlap_points {
            Some(points) => {
                let left = || passes.iter().zip(&keep).enumerate();
                let left: Vec<&Pass> = left()
                    .filter(|(k, (_, kept))| **kept && *k != p)
                    .map(|(_, (pass, _))| pass)
                    .collect();
                points
                    .judge(shop.spec, &shop.realiser.scenery, &left, shop.deadline)
                    .is_none_or(|o| o.holds())
            }
            None => match (needed, least(&without)) {
                (Some(needed), Some(found)) => found >= needed - 1e-9,
                _ => true,
            },
        };
        if overlaps && shop.deadline.more() {
            keep[p] = false;
            budget -= alone[p];
            seen = without;
        }
    }
    let mut kept = keep.into_iter();
    passes.retain(|_| kept.next().unwrap_or(true));
}
