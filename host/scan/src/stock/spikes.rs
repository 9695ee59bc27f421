//! Points that no neighbour is like: dust, reflections, a hair on the part.

use crate::cloud::tree::PointTree;
use crate::parallel::Threads;
use crate::rigid::Vec3;
use crate::solve::{Measured, median};

/// Neighbours that are asked.
const ASKED: usize = 16;

/// The numbers of the spikes, and the other points.
///
/// A spike differs from the median of its neighbours by more than twelve times what neighbours differ by and 0.2 mm,
/// and none of them differs by more than three quarters as much: an edge is no spike. Where material is missing none
/// differs by more than a quarter of that limit: two points show a pit, and its tip is true. When in doubt a point stays:
/// to leave out a true one could turn NG into OK. A low point that is not inside the part after all, as `is_inside` says, is
/// one, and shows no pit.
pub(super) fn part(
    points: &[Vec3],
    measured: &[Measured],
    is_inside: impl Fn(&Vec3) -> bool + Sync,
    threads: Threads,
) -> (Vec<usize>, Vec<Vec3>) {
    let tree = PointTree::new(points);
    let around = |i: usize| {
        let mut found = Vec::new();
        tree.nearest(&points[i], ASKED + 1, &mut found);
        found.retain(|(_, k)| *k as usize != i);
        found
    };
    let stock = |i: usize| measured[i].distance_mm;
    // What each point's neighbours have, and what it has more.
    let own: Vec<(f64, f64)> = threads.each(points.len(), |i| {
        let mut stocks: Vec<f64> = around(i).iter().map(|(_, k)| stock(*k as usize)).collect();
        let middle = median(&mut stocks);
        (middle, stock(i) - middle)
    });
    let mut sizes: Vec<f64> = own.iter().map(|(_, own)| own.abs()).collect();
    let limit = 12.0 * 1.4826 * median(&mut sizes) + 0.2;
    let is_misjudged: Vec<bool> = threads.each(points.len(), |i| {
        own[i].1 < -limit && stock(i) < 0.0 && !is_inside(&points[i])
    });
    let spike: Vec<bool> = threads.each(points.len(), |i| {
        let (middle, own) = own[i];
        if own.abs() <= limit || is_misjudged[i] {
            return is_misjudged[i];
        }
        let unlike = if own < 0.0 { 0.25 * limit } else { 0.75 * own };
        let mut others = around(i).into_iter().map(|(_, k)| k as usize);
        others.all(|k| is_misjudged[k] || (stock(k) - middle) * own.signum() < unlike)
    });
    let is_spike = |i: usize| spike[i];
    let spikes: Vec<usize> = (0..points.len()).filter(|&i| is_spike(i)).collect();
    let kept = (0..points.len())
        .filter(|&i| !is_spike(i))
        .map(|i| points[i])
        .collect();
    (spikes, kept)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two low points show a pit. If they are not inside the part, a needle of a triangle has misjudged them: both are left
    /// out, and neither vouches for the other.
    #[test]
    fn two_low_points_are_a_pit_unless_they_lie_outside() {
        let points: Vec<Vec3> = (0..400)
            .map(|k| Vec3::new(f64::from(k % 20), f64::from(k / 20), 0.0))
            .collect();
        let low = [210, 211];
        let measured: Vec<Measured> = (0..points.len())
            .map(|k| Measured {
                distance_mm: if low.contains(&k) { -0.5 } else { 1.0 },
                direction: Vec3::z(),
                face: 0,
            })
            .collect();
        let spikes = |inside: bool| part(&points, &measured, |_| inside, Threads::new(1)).0;
        assert_eq!(spikes(true), [0; 0]);
        assert_eq!(spikes(false), low);
    }
}
