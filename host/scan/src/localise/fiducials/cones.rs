//! Cones of a known angle: two points with their normals say where the apex is and which way the axis goes.

use crate::cloud::tree::PointTree;
use crate::localise::search::oriented::Oriented;
use crate::localise::search::pairs::spread;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};

/// Points that vote at most, and the partners that each asks.
const VOTERS: usize = 6000;
const PARTNERS: usize = 20;
/// How near apexes must come to each other, in heights, and how alike axes must be (the cosine).
const NEAR: f64 = 0.12;
const ALIKE: f64 = 0.97;
/// Votes that a cone needs.
const LEAST: usize = 8;
/// Cones that are tried at most.
const TRIED: usize = 60;

/// The frame of a cone.
struct Vote {
    apex: Vec3,
    axis: Vec3,
}

/// Places where a cone may be, most likely first.
pub(super) fn starts(
    places: &[Oriented],
    half_angle_rad: f64,
    height_mm: f64,
    threads: Threads,
) -> Vec<Pose> {
    let oriented: Vec<&Oriented> = places.iter().filter(|o| o.is_oriented()).collect();
    let at: Vec<Vec3> = oriented.iter().map(|o| o.at).collect();
    let tree = PointTree::new(&at);
    let voters = spread(at.len(), VOTERS);
    let reach = height_mm.max(2.0 * height_mm * half_angle_rad.tan());
    let votes: Vec<Vote> = threads
        .each(voters.len(), |k| {
            let i = voters[k];
            let mut found = Vec::new();
            tree.within(&at[i], reach, 600, &mut found);
            let mut votes = Vec::new();
            // Few of a flat neighbourhood count: those that look another way are asked.
            let turned: Vec<usize> = found
                .iter()
                .map(|f| f.1 as usize)
                .filter(|&j| oriented[i].normal.dot(&oriented[j].normal).abs() < 0.95)
                .collect();
            for j in spread(turned.len(), PARTNERS) {
                for sign in [1.0, -1.0] {
                    let two = (oriented[i], oriented[turned[j]]);
                    pair(two, sign, half_angle_rad, height_mm, &mut votes);
                }
            }
            votes
        })
        .into_iter()
        .flatten()
        .collect();
    gathered(&votes, height_mm, threads)
}

/// The cones that two points with their normals can lie on; `sign` turns the second normal.
fn pair(
    (first, second): (&Oriented, &Oriented),
    sign: f64,
    half_angle_rad: f64,
    height_mm: f64,
    votes: &mut Vec<Vote>,
) {
    let (s, c) = half_angle_rad.sin_cos();
    let (n1, n2) = (first.normal, second.normal * sign);
    let cosine = n1.dot(&n2);
    // n·a = sin(half angle) for both normals and |a| = 1.
    let along = s / (1.0 + cosine);
    let across = 1.0 - 2.0 * along * s;
    if cosine < -0.99 || across < 0.0 {
        return;
    }
    let normal = n1.cross(&n2).normalize();
    for side in [1.0, -1.0] {
        let axis = (n1 + n2) * along + normal * (side * across.sqrt());
        let g1 = (axis - n1 * s) / c;
        let g2 = (axis - n2 * s) / c;
        // Where the two generators come nearest to each other.
        let (b, d) = (g1.dot(&g2), second.at - first.at);
        let square = 1.0 - b * b;
        if square < 1e-3 {
            continue;
        }
        let t = (d.dot(&g1) - b * d.dot(&g2)) / square;
        let u = (b * d.dot(&g1) - d.dot(&g2)) / square;
        let slant = height_mm / c;
        let fits = |x: f64| (0.02..1.1).contains(&(x.abs() / slant));
        let (a1, a2) = (first.at + g1 * t, second.at + g2 * u);
        if t * u > 0.0 && fits(t) && fits(u) && (a1 - a2).norm() < 0.06 * height_mm {
            votes.push(Vote {
                apex: (a1 + a2) / 2.0,
                axis: axis * t.signum(),
            });
        }
    }
}

/// Where many votes agree.
fn gathered(votes: &[Vote], height_mm: f64, threads: Threads) -> Vec<Pose> {
    let apexes: Vec<Vec3> = votes.iter().map(|v| v.apex).collect();
    let tree = PointTree::new(&apexes);
    let reach = NEAR * height_mm;
    let alike = |i: usize, found: &mut Vec<(f64, u32)>| {
        tree.within(&apexes[i], reach, 150, found);
        found.retain(|f| votes[f.1 as usize].axis.dot(&votes[i].axis) > ALIKE);
    };
    let mut counted: Vec<(usize, usize)> = threads
        .each(votes.len(), |i| {
            let mut found = Vec::new();
            alike(i, &mut found);
            (found.len(), i)
        })
        .into_iter()
        .filter(|(count, _)| *count >= LEAST)
        .collect();
    counted.sort_unstable_by_key(|(count, i)| (std::cmp::Reverse(*count), *i));
    let mut kept: Vec<Vote> = Vec::new();
    let mut found = Vec::new();
    for (_, i) in counted {
        if kept.len() >= TRIED {
            break;
        }
        let known = |v: &Vote| {
            (v.apex - apexes[i]).norm() < 2.0 * reach && v.axis.dot(&votes[i].axis) > 0.9
        };
        if kept.iter().any(known) {
            continue;
        }
        alike(i, &mut found);
        let n = found.len() as f64;
        let sum = |of: &dyn Fn(&Vote) -> Vec3| -> Vec3 {
            found.iter().map(|f| of(&votes[f.1 as usize])).sum()
        };
        kept.push(Vote {
            apex: sum(&|v| v.apex) / n,
            axis: sum(&|v| v.axis).normalize(),
        });
    }
    kept.iter()
        .map(|v| Pose {
            rotation: crate::localise::search::pairs::frame(&v.axis),
            translation_mm: v.apex,
        })
        .collect()
}
