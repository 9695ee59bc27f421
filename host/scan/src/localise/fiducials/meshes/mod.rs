//! Bodies of any shape: pairs of oriented points vote for poses, as for a part, but near to where they are.

pub(super) mod sides;

use crate::cloud::tree::PointTree;
use crate::localise::search::oriented::Oriented;
use crate::localise::search::pairs::{Prepared, Proposal, sort, spread};
use crate::localise::search::rough::Points;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3, rotation};
use crate::surface::Mesh;

/// Points that vote at most.
const VOTERS: usize = 500;
/// Points that a proposal is judged by.
const JUDGES: usize = 300;
/// Poses that are tried at most, and at one place.
const TRIED: usize = 160;
const AT_ONE_PLACE: usize = 16;
/// Poses that are alike, in diagonals.
const ALIKE: f64 = 0.08;
/// Turns about the voter's normal within what its vote resolves, in rad.
const TURNS: [f64; 3] = [-0.07, 0.0, 0.07];

/// Poses that the mesh may have, most likely first.
pub(super) fn starts(mesh: &Mesh, places: &[Oriented], threads: Threads) -> Vec<Pose> {
    let prepared = Prepared::new(mesh, threads);
    let scene: Vec<Oriented> = places.iter().filter(|o| o.is_oriented()).copied().collect();
    let at: Vec<Vec3> = scene.iter().map(|o| o.at).collect();
    let tree = PointTree::new(&at);
    let around = |i: usize| {
        let mut found = Vec::new();
        tree.within(&at[i], prepared.diagonal, 4000, &mut found);
        found
            .into_iter()
            .map(|f| f.1 as usize)
            .collect::<Vec<usize>>()
    };
    // Where all is flat nothing votes.
    let edged: Vec<usize> = threads
        .each(scene.len(), |i| {
            let mut found = Vec::new();
            tree.within(&at[i], 0.5 * prepared.diagonal, 300, &mut found);
            let turned =
                |f: &&(f64, u32)| scene[f.1 as usize].normal.dot(&scene[i].normal).abs() < 0.9;
            (10 * found.iter().filter(turned).count() > found.len()).then_some(i)
        })
        .into_iter()
        .flatten()
        .collect();
    let voters = spread(edged.len(), VOTERS);
    let mut all: Vec<Proposal> = threads
        .each(voters.len(), |k| {
            let i = edged[voters[k]];
            let near = around(i);
            let local: Vec<Oriented> = std::iter::once(i)
                .chain(near.iter().copied().filter(|&j| j != i))
                .map(|j| scene[j])
                .collect();
            // Judged by a share of the points about it: as dense there as here.
            let chosen = spread(local.len(), JUDGES);
            let per = local.len() as f64 / chosen.len().max(1) as f64;
            let judges = Points::new(chosen.into_iter().map(|j| &local[j]));
            let mut all = Vec::new();
            for sign in [1.0, -1.0] {
                all.extend(prepared.vote(&local, 0, sign));
            }
            for proposal in &mut all {
                let votes = TURNS.map(|angle| {
                    let motion = turned(&proposal.motion, &scene[i], angle);
                    let score = per * prepared.rough.score(&judges, &motion);
                    Proposal { motion, score }
                });
                for vote in votes {
                    if vote.score > proposal.score {
                        *proposal = vote;
                    }
                }
            }
            sort(&mut all);
            all.truncate(6);
            all
        })
        .concat();
    sort(&mut all);
    let middle = prepared.corners.iter().sum::<Vec3>() / 8.0;
    let mut kept: Vec<Pose> = Vec::new();
    for Proposal { motion, .. } in &all {
        let apart = |k: &Pose| k.apart_mm(motion, &prepared.corners) / prepared.diagonal;
        let place = |k: &Pose| (k.point(&middle) - motion.point(&middle)).norm();
        let here = |k: &&Pose| place(k) < 0.3 * prepared.diagonal;
        if kept.len() < TRIED
            && kept.iter().filter(here).count() < AT_ONE_PLACE
            && kept.iter().all(|k| apart(k) > ALIKE)
        {
            kept.push(*motion);
        }
    }
    kept
}

/// A pose turned about the normal of a point that stays.
fn turned(motion: &Pose, about: &Oriented, angle: f64) -> Pose {
    let turn = rotation(&(about.normal * angle));
    Pose {
        rotation: turn * motion.rotation,
        translation_mm: turn * (motion.translation_mm - about.at) + about.at,
    }
}
