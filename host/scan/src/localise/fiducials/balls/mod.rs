//! Balls of a known radius: every point says that the centre lies one radius away along its normal.

pub(super) mod radius;

use crate::cloud::tree::PointTree;
use crate::localise::search::oriented::Oriented;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};

/// How near votes must come to each other, in radii.
const NEAR: f64 = 0.14;
/// Votes that a centre needs, and points that a sphere does.
const LEAST: usize = 7;
/// Votes that are counted at most.
const MOST: usize = 48;
/// Centres that are tried at most.
const TRIED: usize = 120;

/// Places where a ball may be, most likely first.
pub(super) fn starts(places: &[Oriented], radius_mm: f64, threads: Threads) -> Vec<Pose> {
    let votes: Vec<Vec3> = places
        .iter()
        .filter(|o| o.is_oriented())
        .flat_map(|o| [o.at + o.normal * radius_mm, o.at - o.normal * radius_mm])
        .collect();
    let tree = PointTree::new(&votes);
    let reach = NEAR * radius_mm;
    let mut counted: Vec<(usize, usize)> = threads
        .each(votes.len(), |i| {
            let mut found = Vec::new();
            tree.within(&votes[i], reach, MOST, &mut found);
            (found.len(), i)
        })
        .into_iter()
        .filter(|(count, _)| *count >= LEAST)
        .collect();
    counted.sort_unstable_by_key(|(count, i)| (std::cmp::Reverse(*count), *i));
    let mut centres: Vec<Vec3> = Vec::new();
    let mut found = Vec::new();
    for (_, i) in counted {
        if centres.len() >= TRIED {
            break;
        }
        if centres
            .iter()
            .any(|c| (c - votes[i]).norm() < 0.35 * radius_mm)
        {
            continue;
        }
        tree.within(&votes[i], reach, 4 * MOST, &mut found);
        let sum: Vec3 = found.iter().map(|f| votes[f.1 as usize]).sum();
        centres.push(sum / found.len() as f64);
    }
    centres
        .into_iter()
        .map(|centre| Pose {
            translation_mm: centre,
            ..Pose::identity()
        })
        .collect()
}
