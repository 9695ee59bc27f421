//! Places along a curve that keeps neighbours near each other (G. M. Morton, *A computer oriented geodetic data base*, 1966).

use crate::rigid::Vec3;
use crate::surface::bounds;

/// Cells of the curve along each axis, as a power of two.
const BITS: u32 = 21;

/// How far along the curve through a cube a place lies: from its `low` corner on, `across` mm.
pub(crate) fn along(low: Vec3, across: f64) -> impl Fn(&Vec3) -> u64 {
    move |v| {
        // The cells' borders lie askew to the halves and quarters of the cube, where regular meshes have their vertices.
        let cell = |k: usize| {
            let share = (v[k] - low[k]) / across * 0.761 + 0.137;
            (share * f64::from(1_u32 << BITS)) as u64
        };
        let cells = [cell(0), cell(1), cell(2)];
        (0..BITS).fold(0, |code, bit| {
            let three = (0..3).fold(0, |three, k| three << 1 | (cells[k] >> bit & 1));
            code | three << (3 * bit)
        })
    }
}

/// Some of the points, by number, in the order of the curve: of two that come after each other, the nearest triangle of a
/// surface is mostly the same, or the next one, and is found sooner.
pub(crate) fn in_order(points: &[Vec3], some: Vec<usize>) -> Vec<usize> {
    let (low, high) = bounds(some.iter().map(|&k| &points[k]));
    let along = along(low, (high - low).amax());
    let mut all: Vec<(u64, usize)> = some.into_iter().map(|k| (along(&points[k]), k)).collect();
    all.sort_unstable();
    all.into_iter().map(|(_, k)| k).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a lattice of 16 by 16 by 16 in disorder: each point once, and most steps are to a neighbour.
    #[test]
    fn neighbours_come_after_each_other() {
        let place = |i: usize| Vec3::new((i % 16) as f64, (i / 16 % 16) as f64, (i / 256) as f64);
        let points: Vec<Vec3> = (0..4096).map(|i| place(i * 1237 % 4096)).collect();
        let order = in_order(&points, (0..4096).collect());
        let mut each = order.clone();
        each.sort_unstable();
        assert!(each.into_iter().eq(0..4096));
        let steps = order
            .windows(2)
            .map(|w| (points[w[0]] - points[w[1]]).norm());
        let mean = steps.sum::<f64>() / 4095.0;
        assert!(mean < 2.0, "{mean}");
        assert_eq!(in_order(&[Vec3::x(); 3], vec![2, 0]), [0, 2]);
        assert!(in_order(&[], Vec::new()).is_empty());
    }
}
