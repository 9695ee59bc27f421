//! Circles in a graph.

use std::collections::{BTreeMap, BTreeSet};

/// The sets of nodes that reach each other, of two nodes and more; each in order.
#[must_use]
pub fn circles<N: Ord + Clone>(arrows: &BTreeMap<N, BTreeSet<N>>) -> Vec<Vec<N>> {
    let reach: BTreeMap<&N, BTreeSet<&N>> = arrows
        .keys()
        .map(|from| (from, reached(arrows, from)))
        .collect();
    let mut circles: Vec<Vec<N>> = Vec::new();
    for (from, to) in &reach {
        let circle: Vec<N> = to
            .iter()
            .filter(|to| **to != *from && reach.get(*to).is_some_and(|back| back.contains(from)))
            .chain([from])
            .map(|node| (*node).clone())
            .collect::<BTreeSet<N>>()
            .into_iter()
            .collect();
        if circle.len() > 1 && !circles.contains(&circle) {
            circles.push(circle);
        }
    }
    circles
}

fn reached<'a, N: Ord>(arrows: &'a BTreeMap<N, BTreeSet<N>>, from: &'a N) -> BTreeSet<&'a N> {
    let mut seen = BTreeSet::new();
    let mut open = vec![from];
    while let Some(node) = open.pop() {
        for next in arrows.get(node).into_iter().flatten() {
            if seen.insert(next) {
                open.push(next);
            }
        }
    }
    seen
}
